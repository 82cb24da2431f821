//! Whitstone's own format: one TOML file, and a folder with the files that it names.

use crate::document::Document;
use crate::files::save;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use toml::{Table, Value};
use whitstone_core::{ExportScene, Feature, FormatError, FormatErrors, Note, SceneFormat, Treatment};
use whitstone_image::atomic;

/// TOML scenes, for export. They are read without a format.
pub struct Toml;

/// What happens to a scene.
const FEATURES: &[Feature] = &[Feature {
    name: "scenes",
    treatment: Treatment::Kept,
    how: "One file; includes and imports are resolved, and the files that it names are copied to a folder next to it.",
}];

impl SceneFormat for Toml {
    fn name(&self) -> &'static str {
        "toml"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["toml"]
    }

    fn features(&self) -> &'static [Feature] {
        FEATURES
    }

    fn export(&self, scene: &ExportScene<'_>, path: &Path) -> Option<Result<Vec<Note>, FormatErrors>> {
        Some(export(scene, path))
    }
}

fn export(scene: &ExportScene<'_>, path: &Path) -> Result<Vec<Note>, FormatErrors> {
    let mut files = Copies::new(scene.base, path);
    let mut table = scene.document.clone();
    for (_, value) in table.iter_mut() {
        files.visit(value)?;
    }
    let text = Document::from_table(&table).to_toml();
    save(path, text.as_bytes())?;
    Ok(Vec::new())
}

/// The files of a scene, copied to the folder of another one.
pub(crate) struct Copies<'a> {
    base: &'a Path,
    /// Folder of the written file.
    folder: PathBuf,
    /// Folder of the copies, relative to that.
    into: String,
    /// Copies that were made: name in the scene, name in the written file.
    known: BTreeMap<String, String>,
}

impl<'a> Copies<'a> {
    pub(crate) fn new(base: &'a Path, path: &Path) -> Self {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        Self {
            base,
            folder: path.parent().unwrap_or(Path::new("")).to_owned(),
            into: format!("{stem}-files"),
            known: BTreeMap::new(),
        }
    }

    /// Copies all files that a value names, and changes their names.
    pub(crate) fn visit(&mut self, value: &mut Value) -> Result<(), FormatError> {
        match value {
            Value::Array(items) => items.iter_mut().try_for_each(|item| self.visit(item)),
            Value::Table(table) => {
                if let Some(Value::String(file)) = table.get_mut("file") {
                    *file = self.copy(file)?;
                }
                table.iter_mut().try_for_each(|(_, item)| self.visit(item))
            }
            _ => Ok(()),
        }
    }

    /// The name of a file in the written scene. A file below the folder of the written scene stays
    /// where it is.
    pub(crate) fn copy(&mut self, file: &str) -> Result<String, FormatError> {
        if let Some(known) = self.known.get(file) {
            return Ok(known.clone());
        }
        let from = self.base.join(file);
        let here = |path: &Path| {
            let path = if path.as_os_str().is_empty() {
                Path::new(".")
            } else {
                path
            };
            path.canonicalize().ok()
        };
        if let (Some(file_path), Some(folder)) = (here(&from), here(&self.folder))
            && let Ok(inside) = file_path.strip_prefix(&folder)
        {
            let name = inside.to_string_lossy().replace('\\', "/");
            self.known.insert(file.to_owned(), name.clone());
            return Ok(name);
        }
        let name = from
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let mut to = format!("{}/{name}", self.into);
        let mut number = 2;
        while self.known.values().any(|known| *known == to) {
            to = format!("{}/{number}-{name}", self.into);
            number += 1;
        }
        copy(&from, &self.folder.join(&to))?;
        // The files that a glTF file refers to keep their places relative to it.
        if let Ok(document) = whitstone_gltf::Document::open(&from) {
            let folder = from.parent().unwrap_or(Path::new(""));
            for companion in document.companions() {
                if let Ok(relative) = companion.strip_prefix(folder) {
                    copy(&companion, &self.folder.join(&self.into).join(relative))?;
                }
            }
        }
        self.known.insert(file.to_owned(), to.clone());
        Ok(to)
    }
}

fn copy(from: &Path, to: &Path) -> Result<(), FormatError> {
    let failed = |error: std::io::Error| {
        let message = format!("{} cannot be copied to {}: {error}", from.display(), to.display());
        FormatError::anywhere(message)
    };
    if let Some(folder) = to.parent() {
        fs::create_dir_all(folder).map_err(failed)?;
    }
    let mut source = fs::File::open(from).map_err(failed)?;
    let written = atomic::write(to, |file| std::io::copy(&mut source, file).map(drop));
    written.map_err(|error| FormatError::anywhere(error.to_string()))
}

impl Document {
    /// The document of a flattened scene.
    pub fn from_table(table: &Table) -> Self {
        const SINGLE: [&str; 6] = ["film", "camera", "sampler", "integrator", "accelerator", "expect"];
        let list = |name: &str| {
            let items = table.get(name).and_then(Value::as_array);
            items
                .into_iter()
                .flatten()
                .filter_map(Value::as_table)
                .cloned()
                .collect()
        };
        let named = |name: &str| {
            let items = table.get(name).and_then(Value::as_table);
            items
                .into_iter()
                .flatten()
                .filter_map(|(id, item)| Some((id.clone(), item.as_table()?.clone())))
                .collect()
        };
        let groups: Vec<(String, Table)> = named("group");
        Self {
            single: SINGLE
                .into_iter()
                .filter_map(|name| Some((name, table.get(name)?.as_table()?.clone())))
                .collect(),
            lights: list("light"),
            textures: named("texture"),
            materials: named("material"),
            groups: groups
                .into_iter()
                .map(|(id, group)| {
                    let shapes = group.get("shape").and_then(Value::as_array);
                    (
                        id,
                        shapes
                            .into_iter()
                            .flatten()
                            .filter_map(Value::as_table)
                            .cloned()
                            .collect(),
                    )
                })
                .collect(),
            shapes: list("shape"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_copied_to_a_folder_of_the_scene_once() {
        let folder = tempfile::tempdir().unwrap();
        let (from, to) = (folder.path().join("from"), folder.path().join("to"));
        fs::create_dir_all(from.join("sub")).unwrap();
        fs::create_dir(&to).unwrap();
        fs::write(from.join("a.obj"), "1").unwrap();
        fs::write(from.join("sub/a.obj"), "2").unwrap();
        let document: Table = toml::from_str(
            "[[shape]]\ntype = \"mesh\"\nfile = \"a.obj\"\n[[shape]]\nfile = \"sub/a.obj\"\ntype = \"mesh\"\n\
             [[shape]]\ntype = \"mesh\"\nfile = \"a.obj\"\n[camera]\ntype = \"perspective\"\n",
        )
        .unwrap();
        let scene = ExportScene {
            document: &document,
            base: &from,
        };
        let out = to.join("s.toml");
        assert_eq!(Toml.export(&scene, &out).unwrap(), Ok(Vec::new()));
        let written: Table = fs::read_to_string(&out).unwrap().parse().unwrap();
        let file = |k: usize| written["shape"][k]["file"].as_str().unwrap().to_owned();
        assert_eq!(
            [0, 1, 2].map(file),
            ["s-files/a.obj", "s-files/2-a.obj", "s-files/a.obj"]
        );
        assert_eq!(fs::read_to_string(to.join("s-files/2-a.obj")).unwrap(), "2");
        // In the same folder nothing is copied.
        let beside = from.join("t.toml");
        Toml.export(&scene, &beside).unwrap().unwrap();
        let written: Table = fs::read_to_string(&beside).unwrap().parse().unwrap();
        assert_eq!(written["shape"][1]["file"].as_str(), Some("sub/a.obj"));
        assert!(!from.join("t-files").exists());
    }

    #[test]
    fn images_of_gltf_files_may_be_absent_but_not_buffers() {
        let folder = tempfile::tempdir().unwrap();
        let (from, to) = (folder.path().join("from"), folder.path().join("to"));
        fs::create_dir(&from).unwrap();
        fs::create_dir(&to).unwrap();
        let gltf = r#"{ "asset": { "version": "2.0" }, "buffers": [{ "byteLength": 1, "uri": "b.bin" }],
            "images": [{ "uri": "absent.png" }, { "uri": "there.png" }] }"#;
        fs::write(from.join("m.gltf"), gltf).unwrap();
        fs::write(from.join("there.png"), "1").unwrap();
        let document: Table = "[[shape]]\ntype = \"mesh\"\nfile = \"m.gltf\"\n".parse().unwrap();
        let scene = ExportScene {
            document: &document,
            base: &from,
        };
        let errors = Toml.export(&scene, &to.join("s.toml")).unwrap().unwrap_err();
        assert!(errors.0[0].message.contains("b.bin"));
        fs::write(from.join("b.bin"), "1").unwrap();
        assert_eq!(Toml.export(&scene, &to.join("s.toml")).unwrap(), Ok(Vec::new()));
        assert!(to.join("s-files/there.png").exists() && to.join("s-files/b.bin").exists());
    }

    #[test]
    fn a_document_survives() {
        let text = "[film]\nwidth = 3\n[material.m]\ntype = \"matte\"\n[[group.g.shape]]\ntype = \"sphere\"\n\
                    [[shape]]\ntype = \"instance\"\ngroup = \"g\"\n[[light]]\ntype = \"ambient\"\nradiance = 1.0\n";
        let table: Table = text.parse().unwrap();
        let again: Table = Document::from_table(&table).to_toml().parse().unwrap();
        assert_eq!(table, again);
    }
}
