//! Scene files and their names.

use std::io::{Error, ErrorKind};
use std::path::{Component, Path, PathBuf};

/// The name of a scene: its path below `root` without the extension. A scene outside `root` gets a
/// name that none below `root` can have: `./a/b` below the working folder, the whole path
/// elsewhere.
pub fn scene_key(path: &Path, root: &Path) -> String {
    let absolute = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let path = absolute(path).with_extension("");
    let here = absolute(Path::new("."));
    let name = if let Ok(relative) = path.strip_prefix(absolute(root)) {
        relative.to_owned()
    } else if let Ok(relative) = path.strip_prefix(here) {
        Path::new(".").join(relative)
    } else {
        path
    };
    name.to_string_lossy().replace('\\', "/")
}

/// The relative path of the folder that belongs to a scene of this name.
pub(crate) fn folder_of(key: &str) -> PathBuf {
    let place = if key.starts_with("./") {
        "outside"
    } else if Path::new(key).is_absolute() {
        "elsewhere"
    } else {
        ""
    };
    let names = Path::new(key)
        .components()
        .filter_map(|component| match component {
            Component::Normal(name) => Some(name),
            _ => None,
        });
    Path::new(place).join(names.collect::<PathBuf>())
}

/// The folder of the stored references of a scene. `root` is the folder of all scenes, `references`
/// that of all references.
pub fn stored_folder(path: &Path, root: &Path, references: &Path) -> PathBuf {
    references.join(folder_of(&scene_key(path, root)))
}

/// All scene files at or below the given paths, sorted and unique. Folders named `assets` and
/// `parts` contain no scenes. A scene in a folder named `scale` takes minutes and gigabytes, one in
/// a folder named `community` has no stored reference, and Mitsuba takes minutes for one in a
/// folder named `pictures`. These are found only by a path that leads into their folder.
pub fn find_scenes(paths: &[PathBuf]) -> std::io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for path in paths {
        if !path.exists() {
            let problem = format!("{}: no such file or folder", path.display());
            return Err(Error::new(ErrorKind::NotFound, problem));
        }
    }
    let mut open: Vec<PathBuf> = paths.to_vec();
    while let Some(path) = open.pop() {
        let is_part = path
            .file_name()
            .is_some_and(|name| name == "assets" || name == "parts");
        // Large scenes, those without stored references, and those that take Mitsuba minutes, are
        // found only if they are named.
        let is_apart = path
            .file_name()
            .is_some_and(|name| name == "scale" || name == "community" || name == "pictures")
            && !paths.contains(&path);
        if path.is_dir() {
            if !is_part && !is_apart {
                for entry in std::fs::read_dir(&path)? {
                    open.push(entry?.path());
                }
            }
        } else if paths.contains(&path) || path.extension().is_some_and(|e| e == "toml") {
            found.push(path);
        }
    }
    found.sort();
    found.dedup();
    Ok(found)
}

/// A word of a command, quoted for the shell.
pub fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "_./=,:@%+-".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use std::fs;

    #[test]
    fn names_differ_where_paths_do() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("scenes");
        let files = ["scenes/a/b.toml", "scenes/b.toml", "b.toml", "a/b.toml"].map(|name| {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(&path, "").unwrap();
            path
        });
        let keys = files.each_ref().map(|path| scene_key(path, &root));
        assert_eq!(keys[..2], ["a/b", "b"]);
        assert!(Path::new(&keys[2]).is_absolute(), "{}", keys[2]);
        // A scene below the working folder, which is the folder of this package.
        let own = scene_key(Path::new("Cargo.toml"), &root);
        assert_eq!(own, "./Cargo");
        let folders: BTreeSet<PathBuf> = keys.iter().chain([&own]).map(|key| folder_of(key)).collect();
        assert_eq!(folders.len(), 5, "{folders:?}");
        assert!(folders.iter().all(|folder| folder.is_relative()), "{folders:?}");
        assert_eq!(folder_of("a/b"), Path::new("a/b"));
        assert_eq!(folder_of("./a/b"), Path::new("outside/a/b"));
    }

    #[test]
    fn what_is_not_there_is_told_and_nothing_is_found_twice() {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("a.toml");
        fs::write(&scene, "").unwrap();
        fs::create_dir(folder.path().join("parts")).unwrap();
        fs::write(folder.path().join("parts/p.toml"), "").unwrap();
        let both = [folder.path().to_owned(), scene.clone()];
        // Large scenes are found only through their own folder.
        let scale = folder.path().join("scale");
        fs::create_dir(&scale).unwrap();
        fs::write(scale.join("s.toml"), "").unwrap();
        assert_eq!(find_scenes(&both).unwrap(), [scene]);
        assert_eq!(
            find_scenes(std::slice::from_ref(&scale)).unwrap(),
            [scale.join("s.toml")]
        );
        let missing = folder.path().join("none");
        let error = find_scenes(&[missing]).unwrap_err();
        assert!(
            error.to_string().ends_with("none: no such file or folder"),
            "{error}"
        );
    }
}
