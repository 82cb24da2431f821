//! Public files for tests, which are not part of the project.

use std::path::PathBuf;

/// Where the files are said to lie.
const VARIABLE: &str = "WHITSTONE_TEST_DATA";

/// Files of a folder of the test data, sorted, or `None` after saying that the test is skipped.
pub(crate) fn files(folder: &str) -> Option<Vec<PathBuf>> {
    let Some(root) = std::env::var_os(VARIABLE) else {
        println!("skipped: {VARIABLE} is not set");
        return None;
    };
    let folder = PathBuf::from(root).join(folder);
    let Ok(entries) = std::fs::read_dir(&folder) else {
        println!("skipped: no folder {}", folder.display());
        return None;
    };
    let mut files: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.is_file())
        .collect();
    files.sort();
    Some(files)
}
