//! Files that an imported file names.

use std::fs;
use std::io::Read;
use std::path::{Component, Path, PathBuf};
use whitstone_core::{FormatError, ImportOptions};

/// Extensions of images that the texture `image` reads.
const IMAGES: [&str; 6] = ["png", "jpg", "jpeg", "webp", "exr", "hdr"];

/// Whether the texture `image` reads files with this extension.
pub(crate) fn is_image(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    IMAGES.iter().any(|image| extension.eq_ignore_ascii_case(image))
}

/// Writes a file whole or not at all.
pub(crate) fn save(path: &Path, bytes: &[u8]) -> Result<(), FormatError> {
    let written = whitstone_image::atomic::write_bytes(path, bytes);
    written.map_err(|error| FormatError::anywhere(error.to_string()))
}

/// The folder of an imported file, and whether files outside of it may be read.
#[derive(Clone, Debug)]
pub(crate) struct Folder {
    path: PathBuf,
    allow_outside: bool,
}

/// A file that an imported file names.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Named {
    /// The path relative to the folder of the imported file, as a scene file names it.
    pub(crate) relative: String,
    /// The path for reading.
    pub(crate) path: PathBuf,
}

impl Folder {
    /// The folder of `file`.
    pub(crate) fn of(file: &Path, options: &ImportOptions) -> Self {
        Self {
            path: file.parent().unwrap_or(Path::new("")).to_owned(),
            allow_outside: options.allow_outside && options.root.is_none(),
        }
    }

    /// The file that is written as `name`, relative to `inside`, a folder relative to this one. The
    /// error is a message.
    pub(crate) fn find(&self, inside: &str, name: &str) -> Result<Named, String> {
        // Windows programs write backslashes.
        let written = name.replace('\\', "/");
        if written.is_empty() {
            return Err("expected a file name, found none".to_owned());
        }
        if written.contains('\0') {
            return Err("a file name must not contain a zero byte".to_owned());
        }
        let absolute = Path::new(&written).is_absolute();
        let joined = Path::new(inside).join(&written);
        let (relative, outside) = normalized(&joined);
        if !self.allow_outside && (absolute || outside) {
            return Err(outside_message(name));
        }
        let path = self.path.join(&relative);
        // A link may also lead outside.
        let base = if self.path.as_os_str().is_empty() {
            Path::new(".")
        } else {
            &self.path
        };
        if !self.allow_outside
            && let (Ok(real), Ok(base)) = (path.canonicalize(), base.canonicalize())
            && !real.starts_with(base)
        {
            return Err(outside_message(name));
        }
        Ok(Named { relative, path })
    }
}

fn outside_message(name: &str) -> String {
    format!(
        "\"{}\" is outside of the folder of the scene; `convert --allow-outside` reads it",
        shorten(name)
    )
}

/// The path without `.` and inner `..`, with slashes; and whether it leaves its start.
fn normalized(path: &Path) -> (String, bool) {
    let mut parts: Vec<String> = Vec::new();
    let mut outside = false;
    let mut root = "";
    for component in path.components() {
        match component {
            Component::CurDir => {}
            Component::RootDir | Component::Prefix(_) => root = "/",
            Component::ParentDir => {
                if parts.last().is_none_or(|last| last == "..") {
                    outside = true;
                    parts.push("..".to_owned());
                } else {
                    parts.pop();
                }
            }
            Component::Normal(part) => parts.push(part.to_string_lossy().into_owned()),
        }
    }
    (format!("{root}{}", parts.join("/")), outside)
}

/// The folder of a relative path: "a/b.mtl" is in "a".
pub(crate) fn folder_of(relative: &str) -> &str {
    relative.rsplit_once('/').map_or("", |(folder, _)| folder)
}

/// Contents of a file of at most `limit` bytes. The error is a message without the name.
pub(crate) fn read(path: &Path, limit: u64) -> Result<Vec<u8>, String> {
    let metadata = fs::metadata(path).map_err(|error| reason(&error))?;
    if !metadata.is_file() {
        return Err("it is not a regular file".to_owned());
    }
    let file = fs::File::open(path).map_err(|error| reason(&error))?;
    let mut bytes = Vec::new();
    let read = file.take(limit.saturating_add(1)).read_to_end(&mut bytes);
    read.map_err(|error| reason(&error))?;
    if bytes.len() as u64 > limit {
        return Err(format!("it is larger than {} MiB", limit >> 20));
    }
    Ok(bytes)
}

/// Contents of the imported file.
pub(crate) fn read_main(path: &Path, limit: u64) -> Result<Vec<u8>, FormatError> {
    read(path, limit).map_err(|problem| FormatError::anywhere(format!("cannot be read: {problem}")))
}

/// Whether a file that starts like a PNG has an alpha channel; none for other files.
pub(crate) fn png_has_alpha(path: &Path) -> Option<bool> {
    let mut start = [0; 26];
    let found = fs::metadata(path).is_ok_and(|metadata| metadata.is_file())
        && fs::File::open(path).is_ok_and(|mut file| file.read_exact(&mut start).is_ok());
    // Byte 25 is the colour type; 4 is grey and 6 is colour, both with alpha.
    (found && start.starts_with(b"\x89PNG\r\n\x1a\n")).then(|| matches!(start[25], 4 | 6))
}

fn reason(error: &std::io::Error) -> String {
    match error.kind() {
        std::io::ErrorKind::NotFound => "there is no such file".to_owned(),
        _ => error.to_string(),
    }
}

/// Text for a message: at most 60 characters, without control characters.
pub(crate) fn shorten(text: &str) -> String {
    let mut shown: String = text
        .chars()
        .take(60)
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect();
    if text.chars().nth(60).is_some() {
        shown.push_str("...");
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_in_the_folder() {
        let folder = tempfile::tempdir().unwrap();
        let inside = Folder::of(&folder.path().join("a.obj"), &ImportOptions::all());
        let found = |name: &str| inside.find("sub", name).map(|named| named.relative);
        assert_eq!(found("x.png").as_deref(), Ok("sub/x.png"));
        assert_eq!(found("..\\y\\.\\x.png").as_deref(), Ok("y/x.png"));
        for name in ["../../x.png", "/etc/passwd", "", "a\0b"] {
            assert!(found(name).is_err(), "{name:?}");
        }
        let options = ImportOptions {
            allow_outside: true,
            ..ImportOptions::all()
        };
        let outside = Folder::of(&folder.path().join("a.obj"), &options);
        let found = |name: &str| outside.find("sub", name).unwrap().relative;
        assert_eq!(found("../../x.png"), "../x.png");
        assert_eq!(found("/x.png"), "/x.png");
    }

    #[cfg(unix)]
    #[test]
    fn links_do_not_lead_outside() {
        let folder = tempfile::tempdir().unwrap();
        let (inside, outside) = (folder.path().join("in"), folder.path().join("secret.png"));
        fs::create_dir(&inside).unwrap();
        fs::write(&outside, "x").unwrap();
        std::os::unix::fs::symlink(&outside, inside.join("link.png")).unwrap();
        let folder = Folder::of(&inside.join("a.obj"), &ImportOptions::all());
        assert!(folder.find("", "link.png").is_err());
    }
}
