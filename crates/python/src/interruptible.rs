//! Long work that Ctrl-C can stop.

use pyo3::prelude::*;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

/// Time between two looks at Python's signals.
const INTERVAL: Duration = Duration::from_millis(50);

/// How far the work is, and whether it is to stop.
#[derive(Default)]
pub(crate) struct Watch {
    done: AtomicU64,
    total: AtomicU64,
    stopped: AtomicBool,
}

impl Watch {
    /// Reports progress.
    pub(crate) fn report(&self, done: u64, total: u64) -> ControlFlow<()> {
        self.done.fetch_max(done, Ordering::Relaxed);
        self.total.store(total, Ordering::Relaxed);
        match self.stopped.load(Ordering::Relaxed) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }
}

/// Does some work on another thread, without the interpreter's lock. Meanwhile this thread calls
/// `progress(done, total)` and handles Python's signals; an exception of either stops the work and
/// is returned.
pub(crate) fn run<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Watch) -> T + Send,
) -> PyResult<T> {
    let watch = Watch::default();
    let progress = progress.map(|progress| progress.clone().unbind());
    py.detach(|| {
        thread::scope(|scope| {
            let (sender, receiver) = channel();
            let watch = &watch;
            scope.spawn(move || {
                let result = work(watch);
                // Fails only if the other side has an exception to return.
                let _ = sender.send(result);
            });
            let look = || -> PyResult<()> {
                Python::attach(|py| {
                    py.check_signals()?;
                    if let Some(progress) = &progress {
                        let done = watch.done.load(Ordering::Relaxed);
                        let total = watch.total.load(Ordering::Relaxed);
                        progress.call1(py, (done, total))?;
                    }
                    Ok(())
                })
            };
            loop {
                match receiver.recv_timeout(INTERVAL) {
                    Ok(result) => {
                        look()?;
                        return Ok(result);
                    }
                    Err(RecvTimeoutError::Timeout) => {
                        if let Err(exception) = look() {
                            watch.stopped.store(true, Ordering::Relaxed);
                            return Err(exception);
                        }
                    }
                    // The thread panicked; the scope passes the panic on.
                    Err(RecvTimeoutError::Disconnected) => {
                        return Err(pyo3::exceptions::PyRuntimeError::new_err("the work failed"));
                    }
                }
            }
        })
    })
}
