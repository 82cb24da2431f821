//! Watches the files of the scene.
//!
//! By their times and sizes, many times a second: a scene has few files, and this also sees files
//! that do not exist yet, files on network drives, and editors that write a new file and rename it.

use crate::state::Shared;
use std::path::PathBuf;
use std::thread;
use std::time::{Duration, SystemTime};

/// Time between two looks.
const INTERVAL: Duration = Duration::from_millis(25);

/// A time of modification may be this much too early: file systems take it from a clock that
/// advances with the ticks of the kernel, every 10 ms at most.
const TICK: Duration = Duration::from_millis(20);

/// What identifies a version of a file; `None` if there is none.
type Mark = Option<(SystemTime, u64)>;

fn marks(files: &[PathBuf]) -> Vec<(PathBuf, Mark)> {
    let mark = |file: &PathBuf| -> Mark {
        let found = std::fs::metadata(file).ok()?;
        Some((found.modified().ok()?, found.len()))
    };
    files.iter().map(|file| (file.clone(), mark(file))).collect()
}

/// Whether a file with this time of modification may have been written after a time of the clock.
fn may_be_later(modified: SystemTime, time: SystemTime) -> bool {
    modified.checked_add(TICK).is_none_or(|latest| latest > time)
}

/// Wishes for a new version of the scene whenever a file has changed, until the view ends.
pub(crate) fn run(shared: &Shared) {
    let mut before: Vec<(PathBuf, Mark)> = Vec::new();
    let mut is_changing = false;
    loop {
        let (files, read_at) = {
            let state = shared.state();
            if state.ended {
                return;
            }
            (state.watched.clone(), state.read_at)
        };
        let now = marks(&files);
        let differs = now.iter().any(|(file, mark)| {
            match before.iter().find(|(other, _)| other == file) {
                Some((_, known)) => known != mark,
                // Watched from now on: it may have changed since it was read.
                None => mark
                    .zip(read_at)
                    .is_some_and(|((modified, _), read_at)| may_be_later(modified, read_at)),
            }
        });
        if differs {
            // It may still be written: wait until it is the same twice.
            is_changing = true;
        } else if is_changing {
            is_changing = false;
            shared.change(|state| state.wish(|wish| wish.files += 1));
        }
        before = now;
        thread::sleep(INTERVAL);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_written_after_a_time_is_found_in_spite_of_the_coarse_clock() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        for _ in 0..200 {
            let time = SystemTime::now();
            std::fs::write(&file, "new").unwrap();
            let modified = std::fs::metadata(&file).unwrap().modified().unwrap();
            assert!(may_be_later(modified, time), "{modified:?} {time:?}");
        }
        let time = SystemTime::now() + Duration::from_secs(1);
        assert!(!may_be_later(SystemTime::now(), time));
    }
}
