//! A cache for data that takes long to compute, keyed by a hash of everything that it depends on.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};
use whitstone_image::atomic;

/// A folder of cached plugin data, for [`crate::BuildOptions`].
#[derive(Clone, Copy, Debug)]
pub struct Cache<'a> {
    /// The folder, created on first use.
    pub folder: &'a Path,
    /// Whether the data of earlier runs is used.
    pub reuse: bool,
}

impl Cache<'_> {
    fn path(&self, parts: &[&[u8]]) -> PathBuf {
        let mut hasher = blake3::Hasher::new();
        for part in parts {
            hasher.update(&(part.len() as u64).to_le_bytes()).update(part);
        }
        self.folder
            .join(format!("{}.bin", &hasher.finalize().to_hex()[..24]))
    }

    /// Reads an entry of `length` bytes. A file of another length, or with a wrong checksum, counts
    /// as missing.
    pub(crate) fn cached(&self, parts: &[&[u8]], length: usize) -> Option<Vec<u8>> {
        if !self.reuse {
            return None;
        }
        let mut bytes = Vec::new();
        let most = (blake3::OUT_LEN + length) as u64 + 1;
        let file = File::open(self.path(parts)).ok()?;
        file.take(most).read_to_end(&mut bytes).ok()?;
        let (hash, made) = bytes.split_at_checked(blake3::OUT_LEN)?;
        (made.len() == length && *blake3::hash(made).as_bytes() == *hash).then(|| made.to_vec())
    }

    /// Writes an entry. Failures are ignored, because they only cost time.
    pub(crate) fn cache(&self, parts: &[&[u8]], made: &[u8]) {
        let bytes = [blake3::hash(made).as_bytes(), made].concat();
        if fs::create_dir_all(self.folder).is_ok() {
            let _ = atomic::write_bytes(self.path(parts), &bytes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARTS: [&[u8]; 2] = [b"stones", b"seed 3"];
    const MADE: &[u8] = b"a picture";

    fn cache(folder: &Path) -> Cache<'_> {
        Cache { folder, reuse: true }
    }

    #[test]
    fn an_entry_is_found_only_by_all_parts_of_its_key() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("a/b");
        let cache = cache(&inner);
        assert_eq!(cache.cached(&PARTS, MADE.len()), None);
        cache.cache(&PARTS, MADE);
        assert_eq!(cache.cached(&PARTS, MADE.len()).as_deref(), Some(MADE));
        let others: [&[&[u8]]; 3] = [
            &[b"stones", b"seed 4"],
            &[b"stonesseed 3"],
            &[b"stonesse", b"ed 3"],
        ];
        for other in others {
            assert_eq!(cache.cached(other, MADE.len()), None);
        }
        let fresh = Cache {
            reuse: false,
            ..cache
        };
        assert_eq!(fresh.cached(&PARTS, MADE.len()), None);
    }

    #[test]
    fn a_damaged_entry_is_ignored_and_rewritten() {
        let folder = tempfile::tempdir().unwrap();
        let cache = cache(folder.path());
        cache.cache(&PARTS, MADE);
        let path = cache.path(&PARTS);
        let whole = fs::read(&path).unwrap();
        for at in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[at] ^= 1;
            for broken in [&damaged[..], &whole[..at], &[&whole[..], b"!"].concat()] {
                fs::write(&path, broken).unwrap();
                assert_eq!(cache.cached(&PARTS, MADE.len()), None, "{at}");
            }
        }
        cache.cache(&PARTS, MADE);
        assert_eq!(cache.cached(&PARTS, MADE.len()).as_deref(), Some(MADE));
        assert_eq!(cache.cached(&PARTS, 3), None);
    }

    #[test]
    fn a_folder_that_cannot_be_created_is_no_error() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        let cache = cache(&file);
        cache.cache(&PARTS, MADE);
        assert_eq!(cache.cached(&PARTS, MADE.len()), None);
    }
}
