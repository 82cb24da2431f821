//! `[[import]]`: scenes in other formats as parts of a scene.

use crate::document::type_name;
use crate::transform;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;
use toml::Spanned;
use toml::de::{DeTable, DeValue};
use whitstone_core::config::decode;
use whitstone_core::{
    FormatError, ImportOptions, Registry, SceneError, SceneErrors, SceneFormat, SourceSpan,
};

/// An `[[import]]` of a scene file.
pub(crate) struct Import {
    /// The place of its file name.
    pub(crate) span: SourceSpan,
    /// The file, as written.
    pub(crate) file: String,
    pub(crate) options: ImportOptions,
}

/// The keys of an `[[import]]`, without `transform`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    file: Spanned<String>,
    prefix: Option<String>,
    scene: Option<Selection>,
    node: Option<Selection>,
    camera: Option<Selection>,
    lights: Option<bool>,
    #[serde(default)]
    photometric: bool,
    #[serde(default)]
    materials: BTreeMap<String, String>,
    #[serde(default)]
    allow_outside: bool,
}

/// A name or an index.
#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a name or an index")]
enum Selection {
    Index(u32),
    Name(String),
}

impl Selection {
    fn text(self) -> String {
        match self {
            Self::Index(index) => index.to_string(),
            Self::Name(name) => name,
        }
    }
}

/// Removes the `[[import]]`s of a document and returns them, with the errors in them.
pub(crate) fn imports(table: &mut DeTable<'_>) -> (Vec<Import>, SceneErrors) {
    let mut errors = SceneErrors::default();
    let mut found = Vec::new();
    let Some(value) = table.remove("import") else {
        return (found, errors);
    };
    let span = value.span();
    let DeValue::Array(items) = value.into_inner() else {
        let error = SceneError::at(span, "expected a list of imports");
        errors
            .0
            .push(error.with_help("write [[import]], with two brackets"));
        return (found, errors);
    };
    for item in items {
        let span = item.span();
        match item.into_inner() {
            DeValue::Table(keys) => {
                found.extend(errors.take(import(Spanned::new(span, keys), found.len())));
            }
            other => errors.0.push(SceneError::at(
                span,
                format!("expected a table with `file`, found {}", type_name(&other)),
            )),
        }
    }
    (found, errors)
}

fn import(mut table: Spanned<DeTable<'_>>, number: usize) -> Result<Import, SceneErrors> {
    let mut errors = SceneErrors::default();
    let transform = table.get_mut().remove("transform");
    let transform = transform.and_then(|steps| errors.take(transform::parse(&steps)));
    let Some(keys) = errors.take(decode::<Keys>(&table)) else {
        return Err(errors);
    };
    let span = keys.file.span();
    let file = keys.file.into_inner();
    let stem = Path::new(&file).file_stem().unwrap_or_default();
    let prefix = keys.prefix.unwrap_or_else(|| {
        // Two imports of one file need different prefixes.
        let stem = stem.to_string_lossy();
        if number == 0 {
            format!("{stem}/")
        } else {
            format!("{stem}{number}/")
        }
    });
    errors.into_result(Import {
        span,
        file,
        options: ImportOptions {
            format: None,
            prefix,
            transform: transform.map_or(Default::default(), |transform| *transform.world_from_object()),
            scene: keys.scene.map(Selection::text),
            node: keys.node.map(Selection::text),
            camera: keys.camera.map(Selection::text),
            part: true,
            lights: keys.lights.unwrap_or(true),
            photometric: keys.photometric,
            materials: keys.materials,
            allow_outside: keys.allow_outside,
            root: None,
            max_memory: None,
        },
    })
}

/// An error of an importer as an error of the scene that imports the file, at the place that names
/// the file.
pub(crate) fn located(error: FormatError, file: &str, at: Option<&SourceSpan>) -> SceneError {
    let message = if error.place.is_empty() {
        format!("{file}: {}", error.message)
    } else if error.place.starts_with(|c: char| c.is_ascii_digit()) {
        // Line and column.
        format!("{file}:{}: {}", error.place, error.message)
    } else {
        format!("{file}, at {}: {}", error.place, error.message)
    };
    SceneError {
        span: at.cloned(),
        message,
        help: error.help,
    }
}

/// The extensions of all formats that can be imported, after `others`, as in ".glb, .gltf or .obj".
pub(crate) fn extensions(registry: &Registry, others: &[&str]) -> String {
    // Formats that are only written return none instead of an error for the missing file.
    let is_read = |format: &&dyn SceneFormat| {
        let missing = format.import(Path::new(""), &ImportOptions::all());
        missing.is_some() && format.name() != "toml"
    };
    let formats = registry.formats().filter(is_read);
    let formats = formats.flat_map(|format| format.extensions());
    let formats = formats.map(|extension| format!(".{extension}"));
    let others = others.iter().map(|other| (*other).to_owned());
    let all: Vec<String> = others.chain(formats).collect();
    match all.split_last() {
        None => "a known format".to_owned(),
        Some((last, [])) => last.clone(),
        Some((last, rest)) => format!("{} or {last}", rest.join(", ")),
    }
}
