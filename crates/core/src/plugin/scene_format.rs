//! Scene formats other than TOML: how they are imported and exported.
//!
//! An importer translates a file to a scene in TOML, an exporter a scene to a file. Each reports
//! what it kept, approximated and dropped, in terms of a table that also generates the
//! documentation of the format.

use glam::DAffine3;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// A format of scene files, such as glTF.
pub trait SceneFormat: Send + Sync {
    /// The name, as in messages and for `--from` and `--to`.
    fn name(&self) -> &'static str;

    /// File extensions, in lower case and without the dot.
    fn extensions(&self) -> &'static [&'static str];

    /// What is kept, approximated and dropped; every [`Note`] refers to one of these.
    fn features(&self) -> &'static [Feature];

    /// Translates a file to a scene in TOML; `None` if the format is only written.
    fn import(&self, path: &Path, options: &ImportOptions) -> Option<Result<Imported, FormatErrors>> {
        let _ = (path, options);
        None
    }

    /// Writes a scene to a file, and its meshes and textures to the same folder; `None` if the
    /// format is only read.
    fn export(&self, scene: &ExportScene<'_>, path: &Path) -> Option<Result<Vec<Note>, FormatErrors>> {
        let _ = (scene, path);
        None
    }
}

/// What to import, and how; [`Self::all`] imports everything.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImportOptions {
    /// Name of the format; by default the extension of the file decides.
    pub format: Option<String>,
    /// Prefix of the ids that the imported scene defines, so that several files do not collide.
    pub prefix: String,
    /// Transform of everything, applied after the transforms in the file.
    pub transform: DAffine3,
    /// Name or index of the scene to import, if the file has several.
    pub scene: Option<String>,
    /// Name or index of the node to import, with all nodes below it.
    pub node: Option<String>,
    /// Name or index of the camera; the first one by default.
    pub camera: Option<String>,
    /// Whether the file is a part of another scene: a missing camera and missing lights are then
    /// not added.
    pub part: bool,
    /// Whether the lights of the file are imported.
    pub lights: bool,
    /// Whether intensities of lights in photometric units (candela, lux) are converted to
    /// radiometric ones by 683 lm/W. Otherwise the numbers are used as they are.
    pub photometric: bool,
    /// Materials to use instead of those of the file: name in the file to id in the scene.
    pub materials: BTreeMap<String, String>,
    /// Whether files outside of the folder of the imported file may be read.
    pub allow_outside: bool,
    /// The folder that must contain all files that the scene names, after links are followed; by
    /// default they may be anywhere. With it, `allow_outside` has no effect.
    pub root: Option<PathBuf>,
    /// Memory limit in bytes for the texts of the scene; by default there is only a limit on their
    /// size.
    pub max_memory: Option<u64>,
}

impl ImportOptions {
    /// Everything in the file.
    pub fn all() -> Self {
        Self {
            lights: true,
            ..Self::default()
        }
    }
}

/// An imported scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Imported {
    /// The scene in TOML. Its paths are relative to the folder of the imported file.
    pub text: String,
    /// What was approximated and dropped, and what was kept that is worth telling.
    pub notes: Vec<Note>,
    /// Files that the imported file refers to and the scene does not name, such as buffers.
    pub files: Vec<PathBuf>,
}

/// A scene to export.
#[derive(Clone, Copy, Debug)]
pub struct ExportScene<'a> {
    /// The flattened document: includes and imports are resolved, defaults are not filled in.
    pub document: &'a toml::Table,
    /// The folder that its paths are relative to.
    pub base: &'a Path,
}

/// A feature of a format, as documented and as reported by [`Note`]s.
#[derive(Debug, PartialEq, Eq)]
pub struct Feature {
    /// The name in the format, such as `KHR_materials_sheen`.
    pub name: &'static str,
    /// What happens to it.
    pub treatment: Treatment,
    /// How it is kept or approximated, or why it is dropped: one sentence.
    pub how: &'static str,
}

/// What a conversion does with a feature.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Treatment {
    /// The same image.
    Kept,
    /// A similar image.
    Approximated,
    /// No effect on the image.
    Dropped,
}

/// Features of one kind in a converted file.
#[derive(Clone, Debug, PartialEq)]
pub struct Note {
    /// The feature.
    pub feature: &'static Feature,
    /// Where it occurs: names, or places in the file.
    pub places: Vec<String>,
}

/// The notes of a conversion, one for each feature.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Notes {
    notes: Vec<Note>,
    /// Names of features and places that are noted: a file may have very many.
    known: BTreeSet<(&'static str, String)>,
}

impl Notes {
    /// Adds an occurrence of the feature with this name, which must be in `features`.
    pub fn add(&mut self, features: &'static [Feature], name: &str, place: impl Into<String>) {
        let feature = features
            .iter()
            .find(|feature| feature.name == name)
            .unwrap_or_else(|| unreachable!("the table of features lacks `{name}`"));
        let place = place.into();
        if !self.known.insert((feature.name, place.clone())) {
            return;
        }
        match self
            .notes
            .iter_mut()
            .find(|note| note.feature.name == feature.name)
        {
            Some(note) => note.places.push(place),
            None => self.notes.push(Note {
                feature,
                places: vec![place],
            }),
        }
    }

    /// The notes: kept, then approximated, then dropped; each in the order of their first
    /// occurrence.
    pub fn into_sorted(mut self) -> Vec<Note> {
        self.notes.sort_by_key(|note| note.feature.treatment);
        self.notes
    }
}

/// Errors of a conversion: as many at once as can be found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FormatErrors(pub Vec<FormatError>);

/// An error of a conversion.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FormatError {
    /// The place: a JSON pointer, a line, or line and column; empty for the file as a whole.
    pub place: String,
    /// The error.
    pub message: String,
    /// A hint.
    pub help: Option<String>,
}

impl FormatError {
    /// An error at a place in the file.
    pub fn at(place: impl Into<String>, message: impl Into<String>) -> Self {
        Self {
            place: place.into(),
            message: message.into(),
            help: None,
        }
    }

    /// An error of the file as a whole.
    pub fn anywhere(message: impl Into<String>) -> Self {
        Self::at("", message)
    }

    /// Adds a hint.
    #[must_use]
    pub fn with_help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

impl From<FormatError> for FormatErrors {
    fn from(error: FormatError) -> Self {
        Self(vec![error])
    }
}
