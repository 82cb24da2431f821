//! POV-Ray's scene description language as a format that is written.
//!
//! The driver of POV-Ray translates the scene; this module applies the changes without which
//! POV-Ray cannot render it, and writes the text.

use crate::driver::{Driver, DriverError};
use crate::environment::{Environment, Installation};
use crate::renderer::{Adaptation, Renderer};
use serde_json::json;
use std::path::Path;
use std::time::Duration;
use toml::{Table, Value};
use whitstone_core::{ExportScene, Feature, FormatError, FormatErrors, Note, Notes, SceneFormat, Treatment};
use whitstone_image::atomic;

/// POV-Ray's scenes; only written.
#[derive(Default)]
pub struct PovRayFormat {
    /// Where the driver is.
    pub installation: Installation,
}

/// Time limit for the translation of a scene.
const LIMIT: Duration = Duration::from_secs(600);

const KEPT: &str = "[scene]";
const NEAR: &str = "[camera] near of perspective";
const LAYERS: &str = "[film] layers";
const DEPTH: &str = "[integrator] at_max_depth";
const CUTOFF: &str = "[integrator] min_contribution";
const LIGHT_CUTOFF: &str = "[integrator] light_cutoff";
const LENS: &str = "[camera] thin_lens";
const SAMPLES: &str = "[sampler]";
const CHANNELS: &str = "[texture] of three channels";

const FEATURES: &[Feature] = &[
    Feature {
        name: KEPT,
        treatment: Treatment::Kept,
        how: "The driver of POV-Ray writes what it can express; the rest is an error.",
    },
    Feature {
        name: DEPTH,
        treatment: Treatment::Approximated,
        how: "POV-Ray shows black beyond its depth limit.",
    },
    Feature {
        name: CUTOFF,
        treatment: Treatment::Approximated,
        how: "No faint rays are left out: POV-Ray's rule is another one.",
    },
    Feature {
        name: LIGHT_CUTOFF,
        treatment: Treatment::Approximated,
        how: "All lights count, however faint.",
    },
    Feature {
        name: LENS,
        treatment: Treatment::Dropped,
        how: "A pinhole camera: the blur of POV-Ray's lens is random.",
    },
    Feature {
        name: SAMPLES,
        treatment: Treatment::Approximated,
        how: "One sample in the middle of each pixel; POV-Ray's option +A smooths edges.",
    },
    Feature {
        name: CHANNELS,
        treatment: Treatment::Approximated,
        how: "A file for each channel, such as scene-red.pov.",
    },
    Feature {
        name: NEAR,
        treatment: Treatment::Dropped,
        how: "POV-Ray's perspective camera has no near limit.",
    },
    Feature {
        name: LAYERS,
        treatment: Treatment::Dropped,
        how: "POV-Ray has no layers other than the radiance.",
    },
];

impl SceneFormat for PovRayFormat {
    fn name(&self) -> &'static str {
        "povray"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["pov"]
    }

    fn features(&self) -> &'static [Feature] {
        FEATURES
    }

    fn export(&self, scene: &ExportScene<'_>, path: &Path) -> Option<Result<Vec<Note>, FormatErrors>> {
        Some(self.write(scene, path))
    }
}

impl PovRayFormat {
    fn write(&self, scene: &ExportScene<'_>, path: &Path) -> Result<Vec<Note>, FormatErrors> {
        let mut document = scene.document.clone();
        let mut notes = Notes::default();
        notes.add(FEATURES, KEPT, path.display().to_string());
        for Adaptation { change, .. } in Renderer::POVRAY.adaptations(&document) {
            let feature = match change.split(['=', '.']).collect::<Vec<_>>()[..] {
                ["film", ..] => LAYERS,
                ["integrator", "min_contribution", ..] => CUTOFF,
                ["integrator", "light_cutoff", ..] => LIGHT_CUTOFF,
                _ => DEPTH,
            };
            notes.add(FEATURES, feature, change.clone());
            set(&mut document, &change);
        }
        if document.remove("sampler").is_some() {
            notes.add(FEATURES, SAMPLES, "sampler");
        }
        if let Some(lens) = remove_lens(&mut document) {
            notes.add(FEATURES, LENS, format!("camera.aperture={lens}"));
        }
        if let Some(near) = remove_near(&mut document) {
            notes.add(FEATURES, NEAR, format!("camera.near={near}"));
        }
        let text = toml::to_string(&document).map_err(wrong)?;
        let texts = self.translate(&text, scene.base)?;
        if let [text] = &texts[..] {
            save(path, text)?;
        } else {
            let stem = path.file_stem().unwrap_or_default().to_string_lossy();
            for (text, channel) in texts.iter().zip(["red", "green", "blue"]) {
                let path = path.with_file_name(format!("{stem}-{channel}.pov"));
                notes.add(FEATURES, CHANNELS, path.display().to_string());
                save(&path, text)?;
            }
        }
        Ok(notes.into_sorted())
    }

    /// The scene in POV-Ray's language: one text, or one for each channel.
    fn translate(&self, text: &str, base: &Path) -> Result<Vec<String>, FormatErrors> {
        let environment = Environment::of_povray(&self.installation).map_err(wrong)?;
        let mut driver = Driver::start(&environment, LIMIT).map_err(wrong)?;
        let answer = driver.request(&json!({ "op": "write", "scene": text, "base": base }));
        let answer = match answer {
            Err(DriverError::Unsupported(problems) | DriverError::Refused(problems)) => {
                let error = |line: &str| match line.split_once(": ") {
                    Some((place, problem)) if !place.contains(' ') => FormatError::at(place, problem),
                    _ => FormatError::anywhere(line),
                };
                return Err(FormatErrors(problems.lines().map(error).collect()));
            }
            other => other.map_err(wrong)?,
        };
        let texts: Option<Vec<String>> = answer["scenes"].as_array().and_then(|scenes| {
            let text = |scene: &serde_json::Value| scene.as_str().map(str::to_owned);
            scenes.iter().map(text).collect()
        });
        texts.ok_or_else(|| FormatError::anywhere("the driver of POV-Ray gave no scene").into())
    }
}

fn wrong(error: impl std::fmt::Display) -> FormatErrors {
    FormatError::anywhere(error.to_string()).into()
}

fn save(path: &Path, text: &str) -> Result<(), FormatErrors> {
    atomic::write_bytes(path, text.as_bytes()).map_err(wrong)
}

/// Turns a thin lens into a pinhole. Returns its aperture, unless that is 0 anyway.
fn remove_lens(document: &mut Table) -> Option<Value> {
    let camera = document.get_mut("camera")?.as_table_mut()?;
    if camera.get("type")?.as_str()? != "thin_lens" {
        return None;
    }
    camera.remove("lens_samples");
    let aperture = camera.insert("aperture".to_owned(), Value::Float(0.0))?;
    let zero = aperture.as_float() == Some(0.0) || aperture.as_integer() == Some(0);
    (!zero).then_some(aperture)
}

/// Removes the near limit of a perspective camera, unless rays start at the camera anyway.
fn remove_near(document: &mut Table) -> Option<Value> {
    let camera = document.get_mut("camera")?.as_table_mut()?;
    if camera.get("type")?.as_str()? != "perspective" {
        return None;
    }
    camera.remove("near_kind");
    let near = camera.remove("near")?;
    let zero = near.as_float() == Some(0.0) || near.as_integer() == Some(0);
    (!zero).then_some(near)
}

/// Applies a change of the form `table.key=value` or `table=value`.
fn set(document: &mut Table, change: &str) {
    let Some((path, value)) = change.split_once('=') else {
        return;
    };
    let parsed = format!("value = {value}").parse::<Table>();
    let Some(value) = parsed.ok().and_then(|mut table| table.remove("value")) else {
        return;
    };
    match path.split_once('.') {
        None => drop(document.insert(path.to_owned(), value)),
        Some((table, key)) => {
            let table = document
                .entry(table)
                .or_insert_with(|| Value::Table(Table::new()));
            if let Value::Table(table) = table {
                table.insert(key.to_owned(), value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lens_becomes_a_pinhole() {
        let camera = |text: &str| {
            format!("[camera]\ntype = 'thin_lens'\n{text}")
                .parse::<Table>()
                .unwrap()
        };
        let mut document = camera("aperture = 0.2\nlens_samples = 3");
        assert_eq!(remove_lens(&mut document), Some(Value::Float(0.2)));
        assert_eq!(document, camera("aperture = 0.0"));
        assert_eq!(remove_lens(&mut document), None);
    }
}
