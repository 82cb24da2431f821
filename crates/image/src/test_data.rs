//! Public files for tests, which are not part of the project.

use std::io::Write as _;
use std::path::PathBuf;

/// The environment variable with the folder of the files.
const VARIABLE: &str = "WHITSTONE_TEST_DATA";

/// Files of a folder of the test data, sorted. Without the folder, prints that the test is skipped
/// and returns `None`.
pub(crate) fn files(folder: &str) -> Option<Vec<PathBuf>> {
    let Some(root) = std::env::var_os(VARIABLE).filter(|root| !root.is_empty()) else {
        let _ = writeln!(std::io::stderr(), "skipped: {VARIABLE} is not set");
        return None;
    };
    let folder = PathBuf::from(root).join(folder);
    let Ok(entries) = std::fs::read_dir(&folder) else {
        let _ = writeln!(std::io::stderr(), "skipped: no folder {}", folder.display());
        return None;
    };
    let mut files: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.is_file())
        .collect();
    files.sort();
    Some(files)
}
