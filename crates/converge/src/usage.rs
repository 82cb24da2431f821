//! What the system says of this process and of the machine.

use std::fs;

/// Processor time of all threads of this process, in seconds.
#[cfg(unix)]
pub fn processor_time() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// Not known here.
#[cfg(not(unix))]
pub fn processor_time() -> f64 {
    f64::NAN
}

/// Processes that ran or waited to run in the last minute, on average, where the system says so.
pub fn load() -> Option<f64> {
    let text = fs::read_to_string("/proc/loadavg").ok()?;
    text.split_whitespace().next()?.parse().ok()
}

/// The processor's name, where the system says so.
pub fn processor() -> Option<String> {
    let text = fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

/// How much the process grows from here on, at its highest.
#[derive(Debug)]
pub struct Memory(Option<u64>);

impl Memory {
    /// From now on.
    pub fn start() -> Self {
        // The highest so far is forgotten.
        let forgotten = fs::write("/proc/self/clear_refs", "5").is_ok();
        Self(if forgotten { status("VmRSS:") } else { None })
    }

    /// In bytes, where the system tells.
    pub fn grown(&self) -> Option<u64> {
        Some(status("VmHWM:")?.saturating_sub(self.0?))
    }
}

fn status(key: &str) -> Option<u64> {
    let text = fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(key))?;
    Some(line.split_whitespace().next()?.parse::<u64>().ok()? * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(target_os = "linux")]
    #[test]
    fn memory_that_is_taken_is_seen() {
        let memory = Memory::start();
        let taken = vec![1_u8; 64 << 20];
        let sum: u64 = taken.iter().map(|byte| u64::from(*byte)).sum();
        assert_eq!(sum, 64 << 20);
        // Some systems do not let a process forget its highest.
        assert!(
            memory.grown().is_none_or(|grown| grown > 60 << 20),
            "{:?}",
            memory.grown()
        );
    }
}
