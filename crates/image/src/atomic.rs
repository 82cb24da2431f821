//! Atomic file writes: a file is either complete or unchanged.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Start and end of the names of temporary files.
const PREFIX: &str = ".whitstone-";
const SUFFIX: &str = ".tmp";

/// A file could not be written. The previous file is unchanged, unless `step` is
/// [`Step::SyncFolder`].
#[derive(Debug, thiserror::Error)]
#[error("{}: cannot {step}: {source}", path.display())]
pub struct WriteError {
    /// The file that was to be written.
    pub path: PathBuf,
    /// What failed.
    pub step: Step,
    /// The reason.
    pub source: io::Error,
}

impl WriteError {
    fn new(path: &Path, step: Step, source: io::Error) -> Self {
        Self {
            path: path.to_owned(),
            step,
            source,
        }
    }
}

/// The steps of writing a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Step {
    /// Inspect the path: it must be a regular file or not exist.
    Inspect,
    /// Create the temporary file next to it.
    Create,
    /// Write the contents.
    Fill,
    /// Sync the contents to the disk.
    Sync,
    /// Rename the temporary file to the path.
    Rename,
    /// Sync the folder's entry to the disk. The new file is already in place.
    SyncFolder,
}

impl std::fmt::Display for Step {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Inspect => "write to this path",
            Self::Create => "create a file in its folder",
            Self::Fill => "write",
            Self::Sync => "sync",
            Self::Rename => "rename the finished temporary file to it",
            Self::SyncFolder => "sync its folder",
        })
    }
}

/// Writes a file atomically. `fill` writes a temporary file in the same folder (open for reading
/// and writing, at its start), which is then synced and renamed to `path`. Readers of `path` see
/// the old or the new contents, never a part.
///
/// The new file has default permissions (0666 less the umask, on Unix), even if it replaces a file
/// with others. A symbolic link is kept, and the file that it points to is replaced. A path that
/// exists and is no regular file (a folder, a device, a pipe) is rejected.
///
/// # Errors
/// [`WriteError`], which names the path and the step that failed. An error of `fill` is returned as
/// one of [`Step::Fill`].
pub fn write(
    path: impl AsRef<Path>,
    fill: impl FnOnce(&mut File) -> io::Result<()>,
) -> Result<(), WriteError> {
    let path = path.as_ref();
    let (target, mut temporary) = begin(path)?;
    let _mark = Mark::new(temporary.path());
    let failed = |step| move |source| WriteError::new(path, step, source);
    fill(temporary.as_file_mut()).map_err(failed(Step::Fill))?;
    temporary.as_file().sync_all().map_err(failed(Step::Sync))?;
    temporary
        .persist(&target)
        .map_err(|error| failed(Step::Rename)(error.error))?;
    sync_folder(folder_of(&target)).map_err(failed(Step::SyncFolder))
}

/// The temporary files and folders of this process that exist, for [`remove_temporaries`].
static TEMPORARIES: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Removes the temporary files and folders of this process. Call it only before the process exits
/// early: whoever writes them fails afterwards.
pub fn remove_temporaries() {
    let paths = TEMPORARIES.lock().unwrap_or_else(PoisonError::into_inner);
    for path in &*paths {
        // One that is finished in this moment has been renamed or removed.
        let _ = match path.is_dir() {
            true => fs::remove_dir_all(path),
            false => fs::remove_file(path),
        };
    }
}

/// Marks a temporary file or folder while it exists.
struct Mark(PathBuf);

impl Mark {
    fn new(path: &Path) -> Self {
        let mut paths = TEMPORARIES.lock().unwrap_or_else(PoisonError::into_inner);
        paths.insert(path.to_owned());
        Self(path.to_owned())
    }
}

impl Drop for Mark {
    fn drop(&mut self) {
        let mut paths = TEMPORARIES.lock().unwrap_or_else(PoisonError::into_inner);
        paths.remove(&self.0);
    }
}

/// A temporary folder, removed when dropped.
pub struct TemporaryFolder {
    folder: tempfile::TempDir,
    /// Its lock tells [`sweep()`] that the folder is in use; `None` where there are no locks.
    _lock: Option<File>,
    _mark: Mark,
}

/// The locked file in a temporary folder.
const LOCK: &str = ".lock";

impl TemporaryFolder {
    /// Creates a folder in another one.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn new_in(parent: &Path) -> io::Result<Self> {
        loop {
            let folder = tempfile::Builder::new()
                .prefix(PREFIX)
                .suffix(SUFFIX)
                .tempdir_in(parent)?;
            let mark = Mark::new(folder.path());
            // On Windows an open file would keep the folder from being removed.
            let lock = match cfg!(windows) {
                true => None,
                false => match lock(&folder.path().join(LOCK)) {
                    Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
                    lock => lock?,
                },
            };
            // Another process may have swept it before it was locked.
            if lock.is_none() || folder.path().is_dir() {
                return Ok(Self {
                    folder,
                    _lock: lock,
                    _mark: mark,
                });
            }
        }
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }
}

/// Creates a file and locks it; none where there are no locks.
fn lock(path: &Path) -> io::Result<Option<File>> {
    let file = File::create(path)?;
    if file.lock().is_ok() {
        return Ok(Some(file));
    }
    // A file without a lock would say that the folder is not in use.
    fs::remove_file(path)?;
    Ok(None)
}

/// Removes temporary files and folders in `folder` that a process left behind when it was killed.
/// A file is in use as long as its process holds its lock, and a folder as long as the file `.lock`
/// in it is. Where there are no locks, age decides: another process may still use those that are
/// younger than a day.
pub fn sweep(folder: &Path) {
    const AGE: Duration = Duration::from_secs(24 * 3600);
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if !(name.starts_with(PREFIX) && name.ends_with(SUFFIX)) {
            continue;
        }
        let is_old = || {
            let modified = entry.metadata().and_then(|data| data.modified());
            modified.is_ok_and(|time| time.elapsed().is_ok_and(|age| age > AGE))
        };
        let path = entry.path();
        // A link is not followed.
        let (lock, remove): (_, fn(PathBuf) -> io::Result<()>) = match entry.file_type() {
            Ok(kind) if kind.is_dir() => (path.join(LOCK), fs::remove_dir_all),
            Ok(kind) if kind.is_file() => (path.clone(), fs::remove_file),
            _ => continue,
        };
        let _ = match in_use(&lock) {
            // The lock is held until the file is removed: see `create_in`.
            Some((false, _held)) => remove(path),
            Some((true, _)) => Ok(()),
            None if is_old() => remove(path),
            None => Ok(()),
        };
    }
}

/// Whether a process holds the lock of a file; if not, it is now locked by the returned handle.
/// `None` where locks are not supported.
fn in_use(path: &Path) -> Option<(bool, File)> {
    // To open a pipe would wait.
    fs::symlink_metadata(path).ok().filter(fs::Metadata::is_file)?;
    let file = File::open(path).ok()?;
    match file.try_lock() {
        Ok(()) => Some((false, file)),
        Err(fs::TryLockError::WouldBlock) => Some((true, file)),
        Err(fs::TryLockError::Error(_)) => None,
    }
}

/// [`sweep()`], once in the life of the process.
fn sweep_once(folder: &Path) {
    static SWEPT: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    let mut swept = SWEPT.lock().unwrap_or_else(PoisonError::into_inner);
    if swept.insert(folder.to_owned()) {
        sweep(folder);
    }
}

/// Removes a symbolic link, so that the next [`write()`] to its path does not replace the file that
/// it points to. Anything else stays. Call it for the program's own files, in caches, where a link
/// can only come from someone else.
///
/// # Errors
/// If the link cannot be removed.
pub fn remove_link(path: &Path) -> io::Result<()> {
    match path.symlink_metadata() {
        Ok(found) if found.is_symlink() => fs::remove_file(path),
        _ => Ok(()),
    }
}

/// Checks whether [`write()`] could begin. Call it before long work whose result is a file. Leaves
/// no files behind.
///
/// # Errors
/// As [`write()`].
pub fn check(path: impl AsRef<Path>) -> Result<(), WriteError> {
    begin(path.as_ref()).map(drop)
}

/// The final path of a file, and a temporary file next to it.
fn begin(path: &Path) -> Result<(PathBuf, tempfile::NamedTempFile), WriteError> {
    let target = resolve(path).map_err(|source| WriteError::new(path, Step::Inspect, source))?;
    sweep_once(folder_of(&target));
    let temporary = create_in(folder_of(&target));
    Ok((
        target,
        temporary.map_err(|source| WriteError::new(path, Step::Create, source))?,
    ))
}

/// The folder that contains a file.
fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// As [`write()`], with contents in memory.
///
/// # Errors
/// As [`write()`].
pub fn write_bytes(path: impl AsRef<Path>, bytes: &[u8]) -> Result<(), WriteError> {
    write(path, |file| file.write_all(bytes))
}

/// The target path of the rename, with links resolved.
fn resolve(path: &Path) -> io::Result<PathBuf> {
    match fs::symlink_metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(path.to_owned()),
        Err(error) => Err(error),
        Ok(found) => {
            let target = if found.is_symlink() {
                fs::canonicalize(path)?
            } else {
                path.to_owned()
            };
            // A rename would replace a device such as /dev/null by a file.
            if fs::metadata(&target)?.is_file() {
                Ok(target)
            } else {
                Err(io::Error::other("not a regular file"))
            }
        }
    }
}

fn create_in(folder: &Path) -> io::Result<tempfile::NamedTempFile> {
    if !folder.is_dir() {
        let problem = format!("the folder {} does not exist", folder.display());
        return Err(io::Error::new(io::ErrorKind::NotFound, problem));
    }
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX).suffix(SUFFIX);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        // Temporary files are private by default, but these become ordinary files; the system
        // applies the umask.
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    loop {
        let temporary = builder.tempfile_in(folder)?;
        // Tells `sweep` that the file is in use. Where there are no locks, its age does.
        let locked = !cfg!(windows) && temporary.as_file().lock().is_ok();
        // Another process may have swept it before it was locked.
        let is_gone = fs::symlink_metadata(temporary.path())
            .is_err_and(|error| error.kind() == io::ErrorKind::NotFound);
        if !(locked && is_gone) {
            return Ok(temporary);
        }
    }
}

#[cfg(unix)]
fn sync_folder(folder: &Path) -> io::Result<()> {
    match File::open(folder)?.sync_all() {
        // Some file systems cannot sync a folder. The file is complete and in place nevertheless.
        Err(error)
            if matches!(
                error.kind(),
                io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported
            ) =>
        {
            Ok(())
        }
        other => other,
    }
}

#[cfg(not(unix))]
fn sync_folder(_folder: &Path) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entries(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_is_replaced_as_a_whole_and_no_other_remains() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_bytes(&path, b"one").unwrap();
        write_bytes(&path, b"second").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
        assert_eq!(entries(folder.path()), ["a.txt"]);
    }

    #[test]
    fn a_failure_keeps_the_old_contents() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_bytes(&path, b"old").unwrap();
        let error = write(&path, |file| {
            file.write_all(b"half of the n")?;
            Err(io::Error::other("disk full"))
        })
        .unwrap_err();
        assert_eq!(error.step, Step::Fill);
        assert!(
            error.to_string().contains("a.txt") && error.to_string().contains("disk full"),
            "{error}"
        );
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(entries(folder.path()), ["a.txt"]);
    }

    #[test]
    fn a_panic_leaves_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let outcome = std::panic::catch_unwind(|| write(&path, |_| panic!("on purpose")));
        assert!(outcome.is_err());
        assert!(entries(folder.path()).is_empty());
    }

    #[test]
    fn temporaries_of_ended_processes_are_swept() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let old = std::time::SystemTime::now() - Duration::from_secs(48 * 3600);
        let held = create_in(folder.path()).unwrap();
        held.as_file().set_modified(old).unwrap();
        for name in [".whitstone-left.tmp", "other.tmp"] {
            File::create(path(name)).unwrap().set_modified(old).unwrap();
        }
        for (name, time) in [("old", old), ("young", std::time::SystemTime::now())] {
            let folder = path(&format!(".whitstone-{name}-folder.tmp"));
            fs::create_dir(&folder).unwrap();
            File::open(folder).unwrap().set_modified(time).unwrap();
        }
        let in_use = TemporaryFolder::new_in(folder.path()).unwrap();
        // As a process that was killed leaves it.
        fs::create_dir(path(".whitstone-left-folder.tmp")).unwrap();
        File::create(path(".whitstone-left-folder.tmp/.lock")).unwrap();
        sweep(folder.path());
        let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
        let mut expected = [
            name(held.path()),
            name(in_use.path()),
            ".whitstone-young-folder.tmp".to_owned(),
            "other.tmp".to_owned(),
        ];
        expected.sort();
        assert_eq!(entries(folder.path()), expected);
    }

    /// What a killed process left is gone after the first file that the next one writes there.
    #[test]
    fn writing_sweeps() {
        let folder = tempfile::tempdir().unwrap();
        File::create(folder.path().join(".whitstone-left.tmp")).unwrap();
        write_bytes(folder.path().join("file"), b"new").unwrap();
        assert_eq!(entries(folder.path()), ["file"]);
    }

    #[test]
    fn a_missing_folder_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let error = write_bytes(folder.path().join("none/a.txt"), b"").unwrap_err();
        assert_eq!(error.step, Step::Create);
        assert!(error.to_string().contains("none"), "{error}");
    }

    #[test]
    fn a_folder_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(write_bytes(folder.path(), b"").unwrap_err().step, Step::Inspect);
    }

    #[cfg(unix)]
    #[test]
    fn permissions_are_those_of_a_plain_file() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().unwrap();
        let (ours, plain) = (folder.path().join("ours"), folder.path().join("plain"));
        write_bytes(&ours, b"").unwrap();
        fs::write(&plain, b"").unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&plain));
    }

    #[cfg(unix)]
    #[test]
    fn links_are_kept_and_devices_are_rejected() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        write_bytes(&file, b"old").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write_bytes(&link, b"new").unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&file).unwrap(), b"new");
        assert_eq!(write_bytes("/dev/null", b"x").unwrap_err().step, Step::Inspect);
    }
}
