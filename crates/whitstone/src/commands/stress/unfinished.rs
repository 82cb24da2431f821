//! The results of an interrupted run.

use crate::terminal::{Failure, make_folder};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::SystemTime;
use whitstone_image::atomic;
use whitstone_stress::FamilyReport;
use whitstone_validate::hashed;

/// Finished families, in a file that exists only while the run is unfinished.
pub(super) struct Unfinished {
    path: PathBuf,
    kept: Kept,
}

#[derive(Serialize, Deserialize, Default)]
struct Kept {
    /// Identifies the program and its settings: results of any other run are not reused.
    run: String,
    families: Vec<FamilyReport>,
}

impl Unfinished {
    /// The results of an unfinished run with the same program and settings; none with `fresh`.
    pub(super) fn new(target: &Path, settings: &str, fresh: bool) -> Self {
        let program = std::env::current_exe().and_then(|path| {
            let file = path.metadata()?;
            let changed = file.modified()?.duration_since(SystemTime::UNIX_EPOCH);
            Ok((file.len(), changed.unwrap_or_default()))
        });
        let run = format!("{program:?} {settings}");
        let path = target.join("stress-unfinished.json");
        let bytes = std::fs::read(&path).unwrap_or_default();
        let kept: Kept = hashed::from_bytes(&bytes).unwrap_or_default();
        Self {
            path,
            kept: match kept.run == run && !fresh {
                true => kept,
                false => Kept {
                    run,
                    families: Vec::new(),
                },
            },
        }
    }

    pub(super) fn find(&self, family: &str) -> Option<&FamilyReport> {
        self.kept.families.iter().find(|report| report.family == family)
    }

    pub(super) fn add(&mut self, report: FamilyReport) -> Result<(), Failure> {
        self.kept.families.push(report);
        let bytes = hashed::to_bytes(&self.kept).map_err(Failure::environment)?;
        if let Some(folder) = self.path.parent() {
            make_folder(folder)?;
        }
        atomic::write_bytes(&self.path, &bytes).map_err(Failure::environment)
    }

    /// Deletes the file when the run is complete.
    pub(super) fn end(self) {
        // A missing file is no error; any other problem shows when the next run begins.
        let _ = std::fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_stress::{FAMILIES, Lab};

    #[test]
    fn an_interrupted_run_continues_where_it_stopped() {
        let folder = tempfile::tempdir().unwrap();
        let registry = crate::registry();
        let lab = Lab::new(&registry, None, 2);
        let family = FAMILIES[0];
        let name = family.about().name;
        let report = FamilyReport::measure(family, &lab, &|_| {}).unwrap();
        let begin = |settings: &str, fresh| Unfinished::new(folder.path(), settings, fresh);
        let mut first = begin("2 rays", false);
        assert!(first.find(name).is_none());
        first.add(report.clone()).unwrap();
        assert_eq!(begin("2 rays", false).find(name), Some(&report));
        // Other settings run other queries.
        assert!(begin("3 rays", false).find(name).is_none());
        assert!(begin("2 rays", true).find(name).is_none());
        begin("2 rays", false).end();
        assert!(begin("2 rays", false).find(name).is_none());
    }
}
