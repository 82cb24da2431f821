//! Estimates the memory of a scene before it is allocated.

use std::fs;
use whitstone_core::{SceneError, SceneErrors};
use whitstone_scene::FilmTable;

/// Memory of a structure during its construction, in bytes per element. Measured for `bvh`
/// (`docs/accelerators.md`), and approximately right for the others.
const BUILD_BYTES: u64 = 200;

/// The part of it that remains afterwards.
const KEPT_BYTES: u64 = 64;

/// The memory that is reserved so far, and its limit.
#[derive(Debug)]
pub(crate) struct Memory {
    limit: Option<u64>,
    /// Whether the limit is the memory that the machine has available.
    measured: bool,
    taken: u64,
}

impl Memory {
    /// A limit of `limit` bytes; without one, the available memory, if it is known.
    pub(crate) fn new(limit: Option<u64>) -> Self {
        Self {
            limit: limit.or_else(available),
            measured: limit.is_none(),
            taken: 0,
        }
    }

    /// The bytes that are reserved.
    pub(crate) fn taken(&self) -> u64 {
        self.taken
    }

    /// Counts what the scene takes at other times. The memory that is available has lost it
    /// already.
    pub(crate) fn resume(&mut self, taken: u64) {
        if !self.measured {
            self.taken = taken;
        }
    }

    /// Reserves bytes permanently.
    pub(crate) fn take(&mut self, bytes: u64) -> Result<(), SceneError> {
        self.fits(bytes)?;
        self.taken = self.taken.saturating_add(bytes);
        Ok(())
    }

    /// The bytes that are not reserved; `None` without a limit.
    pub(crate) fn left(&self) -> Option<u64> {
        Some(self.limit?.saturating_sub(self.taken))
    }

    /// Reserves the memory of the image.
    pub(crate) fn take_film(&mut self, film: &FilmTable) -> Result<(), SceneErrors> {
        let room = self.take(film.bytes());
        room.map_err(|error| match &film.span {
            Some(span) => SceneErrors::from(error).or_at(span),
            None => error.into(),
        })
    }

    /// Reserves the memory of an accelerator over this many elements.
    pub(crate) fn take_structure(&mut self, elements: usize) -> Result<(), SceneError> {
        let elements = elements as u64;
        self.fits(elements.saturating_mul(BUILD_BYTES))?;
        self.take(elements.saturating_mul(KEPT_BYTES))
    }

    fn fits(&self, bytes: u64) -> Result<(), SceneError> {
        let needed = self.taken.saturating_add(bytes);
        let Some(limit) = self.limit.filter(|limit| needed > *limit) else {
            return Ok(());
        };
        let gib = |bytes: u64| bytes as f64 / (1u64 << 30) as f64;
        let what = if self.measured {
            "the memory that this machine has available"
        } else {
            "the limit"
        };
        let message = format!(
            "with this part, the scene needs about {:.3} GiB of memory, more than {what}: {:.3} GiB",
            gib(needed),
            gib(limit)
        );
        let help = "set another limit with `--max-memory`, in GiB";
        Err(SceneError::anywhere(message).with_help(help))
    }
}

/// The bytes that are available without swapping; known on Linux only.
fn available() -> Option<u64> {
    let text = fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib << 10)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn allocations_beyond_the_limit_are_rejected_and_kept_memory_is_counted() {
        let mut memory = Memory::new(Some(1000 << 10));
        memory.take(400 << 10).unwrap();
        // The construction needs more than what remains.
        memory.take_structure(3000).unwrap();
        assert_eq!(memory.taken, (400 << 10) + 3000 * KEPT_BYTES);
        let error = memory.take_structure(3000).unwrap_err();
        assert_eq!(
            error.message,
            "with this part, the scene needs about 0.001 GiB of memory, more than the limit: 0.001 GiB"
        );
        memory.take(1 << 10).unwrap();
        memory.take(u64::MAX).unwrap_err();
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn the_available_memory_is_known() {
        let bytes = available().unwrap();
        assert!(bytes > 1 << 20);
    }
}
