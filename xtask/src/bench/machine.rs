//! System information on this process and the machine.

/// Processor time of this process, in seconds.
pub(super) fn processor_time() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// Load average of the last minute: processes that run or wait to run. Wall-clock results are
/// meaningful only if it is not far above the number of our own threads. NaN if the system does not
/// report it.
pub(super) fn load() -> f64 {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let first = text.split_whitespace().next();
    first.and_then(|word| word.parse().ok()).unwrap_or(f64::NAN)
}
