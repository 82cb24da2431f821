//! The drivers of the reference renderers: Python packages that are part of the binary, so that
//! they work where there is no clone of the repository.

/// A file of a driver.
#[derive(Clone, Copy, Debug)]
pub struct File {
    /// Path relative to the folder that contains `mitsuba`, `povray` and `protocol`.
    pub path: &'static str,
    /// Contents.
    pub bytes: &'static [u8],
}

/// All files of the drivers, sorted by path, and the pinned requirements of Mitsuba's.
pub const FILES: &[File] = include!(concat!(env!("OUT_DIR"), "/files.rs"));

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_driver_can_be_started_as_a_module() {
        for package in ["mitsuba/whitstone_mitsuba", "povray/whitstone_povray"] {
            let main = format!("{package}/__main__.py");
            assert!(FILES.iter().any(|file| file.path == main), "{main}");
        }
        for name in ["mitsuba/requirements.txt", "mitsuba/requirements-llvm.txt"] {
            assert!(FILES.iter().any(|file| file.path == name), "{name}");
        }
        let others = FILES.iter().filter(|file| !file.path.ends_with(".py"));
        assert_eq!(others.count(), 2);
        assert!(FILES.is_sorted_by_key(|file| file.path));
    }
}
