//! The threads that render.

use std::error::Error;
use std::io;
use std::num::NonZeroUsize;
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Starts as many threads as there are cores, or as many as the system allows. Without any, the
/// current thread does all the work.
///
/// The pool of `rayon` panics at its first use if one of its threads cannot be started, and a
/// second attempt is not possible. So threads are tried before, and a thread that cannot be started
/// after that is tried for a while.
///
/// # Errors
/// The system allowed the threads, and then did not. Nothing can be rendered.
pub fn start_threads() -> Result<(), io::Error> {
    let wanted = thread::available_parallelism().map_or(1, NonZeroUsize::get);
    let pool = rayon::ThreadPoolBuilder::new().spawn_handler(patiently);
    let pool = match startable_threads(wanted) {
        all if all == wanted => pool,
        some if some > SPARE_THREADS => pool.num_threads(some - SPARE_THREADS),
        _ => pool.num_threads(1).use_current_thread(),
    };
    match pool.build_global() {
        Err(error) if error.source().is_some() => Err(io::Error::other(error)),
        // The program that embeds this one has started the pool already.
        _ => Ok(()),
    }
}

/// Starts a thread of the pool, at the latest after two seconds.
fn patiently(worker: rayon::ThreadBuilder) -> io::Result<()> {
    // A closure that cannot be started is lost, so the worker is kept outside.
    let worker = Arc::new(Mutex::new(Some(worker)));
    let start = Instant::now();
    loop {
        let own = worker.clone();
        let started = thread::Builder::new().spawn(move || {
            let worker = own.lock().unwrap_or_else(PoisonError::into_inner).take();
            if let Some(worker) = worker {
                worker.run();
            }
        });
        match started {
            Ok(_) => return Ok(()),
            Err(error) if start.elapsed() > Duration::from_secs(2) => return Err(error),
            Err(_) => thread::sleep(Duration::from_millis(10)),
        }
    }
}

/// Number of threads that are left where the system allows few: for the readers of a driver's
/// output, or for a server and its page.
pub const SPARE_THREADS: usize = 16;

/// How many threads can be started now, up to `wanted`.
pub fn startable_threads(wanted: usize) -> usize {
    let mut waiting = Vec::new();
    while waiting.len() < wanted {
        let (end, ended) = channel::<()>();
        match thread::Builder::new().spawn(move || ended.recv().is_ok()) {
            Ok(thread) => waiting.push((end, thread)),
            Err(_) => break,
        }
    }
    let count = waiting.len();
    for (end, thread) in waiting {
        drop(end);
        // It does nothing that could panic.
        let _ = thread.join();
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_are_counted() {
        assert_eq!(startable_threads(0), 0);
        assert_eq!(startable_threads(3), 3);
    }
}
