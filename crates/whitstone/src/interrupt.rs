//! Ctrl-C and the request to terminate: the first stops the work and keeps what is finished, the
//! second ends the process.

use std::sync::LazyLock;
use std::sync::atomic::{AtomicI32, AtomicUsize, Ordering};
use whitstone_validate::Stop;

/// The number of the signal that arrived; 0 before.
static SIGNAL: AtomicI32 = AtomicI32::new(0);
/// How many parts of the command watch [`stop`] and end early by themselves.
static WATCHING: AtomicUsize = AtomicUsize::new(0);
static STOP: LazyLock<Stop> = LazyLock::new(Stop::default);

/// The request to stop.
pub(crate) fn stop() -> &'static Stop {
    &STOP
}

/// The signal that arrived.
pub(crate) fn signal() -> Option<i32> {
    match SIGNAL.load(Ordering::Relaxed) {
        0 => None,
        signal => Some(signal),
    }
}

/// While it exists, a signal does not end the process: the command watches [`stop`].
pub(crate) struct Watching(());

impl Watching {
    pub(crate) fn new() -> Self {
        WATCHING.fetch_add(1, Ordering::SeqCst);
        Self(())
    }
}

impl Drop for Watching {
    fn drop(&mut self) {
        WATCHING.fetch_sub(1, Ordering::SeqCst);
    }
}

/// Watches for signals from now on. Without it, and on systems other than Unix, they end the
/// process at once.
#[cfg(unix)]
pub fn watch() {
    use signal_hook::consts::{SIGINT, SIGTERM};
    use std::time::Duration;
    use whitstone_image::atomic;

    /// How long a command that watches may take to end.
    const PATIENCE: Duration = Duration::from_secs(10);

    fn end(signal: i32) -> ! {
        atomic::remove_temporaries();
        std::process::exit(128 + signal)
    }
    let Ok(mut signals) = signal_hook::iterator::Signals::new([SIGINT, SIGTERM]) else {
        return;
    };
    let watcher = move || {
        let mut signals = signals.forever();
        let Some(first) = signals.next() else { return };
        SIGNAL.store(first, Ordering::SeqCst);
        STOP.request();
        if WATCHING.load(Ordering::SeqCst) == 0 {
            end(first);
        }
        eprintln!("stopping; press Ctrl-C again to end at once");
        let timer = std::thread::Builder::new().spawn(move || {
            std::thread::sleep(PATIENCE);
            end(first);
        });
        if timer.is_err() {
            end(first);
        }
        if let Some(second) = signals.next() {
            end(second);
        }
    };
    // Without a thread, the default remains: a signal ends the process.
    let _ = std::thread::Builder::new()
        .name("signals".to_owned())
        .spawn(watcher);
}

#[cfg(not(unix))]
pub fn watch() {}
