//! Resource usage of this process and of the machine.

use serde::{Deserialize, Serialize};
use std::fs;
use std::iter::Sum;

/// Processor time of all threads of this process, in seconds.
#[cfg(unix)]
pub fn processor_time() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// Unknown on this system.
#[cfg(not(unix))]
pub fn processor_time() -> f64 {
    f64::NAN
}

/// The load average of the last minute (running and waiting processes), if the system reports it.
pub fn load() -> Option<f64> {
    let text = fs::read_to_string("/proc/loadavg").ok()?;
    text.split_whitespace().next()?.parse().ok()
}

/// The name of the processor, if the system reports it.
pub fn processor() -> Option<String> {
    let text = fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

/// Processor time since some moment, in system ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ticks {
    /// Of the whole machine.
    pub all: u64,
    /// Of this process and of the named ones.
    pub own: u64,
}

impl Ticks {
    /// Since the start of the machine and of the processes, if the system reports it.
    pub fn now(processes: &[u32]) -> Option<Self> {
        let text = fs::read_to_string("/proc/stat").ok()?;
        let line = text.lines().next()?.strip_prefix("cpu ")?;
        let columns: Vec<u64> = line.split_whitespace().filter_map(|n| n.parse().ok()).collect();
        // User, nice, system; idle and iowait; irq and softirq, stolen.
        let [user, nice, system, _, _, hard, soft, stolen] = columns[..].first_chunk().copied()?;
        let own = processes.iter().copied().chain([std::process::id()]).map(ticks);
        Some(Self {
            all: user + nice + system + hard + soft + stolen,
            own: own.sum::<Option<u64>>()?,
        })
    }

    /// Adds the usage between `before` and `now`.
    #[must_use]
    pub fn more(self, before: Self, now: Self) -> Self {
        Self {
            all: self.all + now.all.saturating_sub(before.all),
            own: self.own + now.own.saturating_sub(before.own),
        }
    }

    /// The fraction that other processes used, 0 to 1; `None` if too little time has passed.
    pub fn others(self) -> Option<f64> {
        (self.all >= 100).then(|| (1.0 - self.own as f64 / self.all as f64).max(0.0))
    }
}

impl Sum for Ticks {
    fn sum<I: Iterator<Item = Self>>(parts: I) -> Self {
        parts.fold(Self::default(), |sum, part| sum.more(Self::default(), part))
    }
}

/// Processor time of all threads of a process and of its children that have ended, in ticks.
fn ticks(process: u32) -> Option<u64> {
    let text = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    // The name may contain anything, including parentheses. The process id and the name precede the
    // first column here.
    let (_, rest) = text.rsplit_once(')')?;
    let columns = rest.split_whitespace().skip(11).take(4);
    columns.map(|column| column.parse::<u64>().ok()).sum()
}

/// Peak growth of the memory of this process.
#[derive(Debug)]
pub struct Memory(Option<u64>);

impl Memory {
    /// Starts measuring.
    pub fn start() -> Self {
        // Resets the recorded peak.
        let forgotten = fs::write("/proc/self/clear_refs", "5").is_ok();
        Self(if forgotten { status("VmRSS:") } else { None })
    }

    /// The growth in bytes, if the system reports it.
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

    /// A busy child process, once as an unknown one and once as one of ours.
    #[cfg(target_os = "linux")]
    #[test]
    fn what_others_do_is_seen() {
        let mut child = std::process::Command::new("sh");
        let mut child = child.args(["-c", "while :; do :; done"]).spawn().unwrap();
        let spent = |ours: &[u32]| {
            let before = Ticks::now(ours).unwrap();
            std::thread::sleep(std::time::Duration::from_millis(300));
            let used = Ticks::default().more(before, Ticks::now(ours).unwrap());
            used.all - used.own.min(used.all)
        };
        let without = spent(&[]);
        let with = Ticks::now(&[child.id()]).unwrap().own - Ticks::now(&[]).unwrap().own;
        child.kill().unwrap();
        child.wait().unwrap();
        // 100 ticks per second, on a machine that may be busy.
        assert!(without >= 5 && with >= 5, "{without} and {with}");
        let half = Ticks { all: 200, own: 100 };
        assert_eq!((half.others(), Ticks::default().others()), (Some(0.5), None));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn memory_that_is_taken_is_seen() {
        let memory = Memory::start();
        let taken = vec![1_u8; 64 << 20];
        let sum: u64 = taken.iter().map(|byte| u64::from(*byte)).sum();
        assert_eq!(sum, 64 << 20);
        // Some systems do not let a process reset its peak.
        assert!(
            memory.grown().is_none_or(|grown| grown > 60 << 20),
            "{:?}",
            memory.grown()
        );
    }
}
