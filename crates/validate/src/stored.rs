//! Stored references: `references/images/<scene>/{mitsuba.exr,mitsuba.variants.exr,meta.toml}`, and
//! the corresponding files of POV-Ray.
//!
//! A pixel is stored with its variation if it varies by more than a fraction of the tolerance under
//! [`crate::explain::trials`]. The second file holds the values that the reference takes
//! ([`Variants`]), and the image holds their range. So edges can be distinguished from faults
//! without a live renderer.

use crate::explain::{Explanation, Range, Reason, Trial, explain};
use crate::renderer::Renderer;
use crate::tolerance::color_at;
use crate::variants::Variants;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use thiserror::Error;
use whitstone_image::{Image, Limits, atomic, exr_io};
use whitstone_metrics::Tolerance;
use whitstone_metrics::range::{LAYERS, Ranges};

/// The metadata of a stored reference.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Meta {
    /// "mitsuba", "mitsuba-stock" or "povray".
    pub renderer: String,
    /// Version of the renderer.
    pub version: String,
    /// The variant, such as `llvm_ad_rgb`; none for POV-Ray.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub variant: String,
    /// The integrator, for stock Mitsuba.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub integrator: String,
    /// Spawn offset.
    pub k: f64,
    /// LLVM library and version; none for POV-Ray.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub libllvm: String,
    /// Name of the processor.
    pub cpu: String,
    /// Hash of the flattened scene.
    pub scene_hash: String,
    /// Hash of the other lines here, and of the files of the image and of the variants. It is set
    /// when they are written.
    #[serde(default, alias = "files_hash")]
    pub hash: String,
    /// How independent the twin is: "native", "hosted" or "formula".
    pub twin: String,
    /// Its own error: see [`crate::floor`].
    pub floor: f64,
    /// Number of pixels over tolerance between the reference and its worst variation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moved: Option<usize>,
    /// Samples per pixel.
    pub samples: u32,
    /// Rendering time in seconds, for the record.
    pub seconds: f64,
    /// Rays traced: nearest-hit and shadow rays.
    pub rays: [u64; 2],
    /// Number of re-hits: spawned rays that hit again the surface that they had just left. Such an
    /// image alone proves nothing.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub rehits: u64,
    /// The driver's notes on coincident surfaces that are not separated.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
}

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "serde calls it with a reference"
)]
fn is_zero(number: &u64) -> bool {
    *number == 0
}

/// A stored reference.
pub struct Stored {
    /// Radiance, layers and ranges.
    pub image: Image,
    /// The values of the pixels that vary; empty for references that were stored with ranges only.
    pub variants: Variants,
    /// Its metadata.
    pub meta: Meta,
}

/// Why a stored reference cannot be used.
#[derive(Debug, Error)]
pub enum StoredError {
    /// It does not exist.
    #[error("no stored reference of {renderer} in {}", folder.display())]
    Missing {
        /// The renderer.
        renderer: Renderer,
        /// The expected folder.
        folder: PathBuf,
    },
    /// It belongs to another version of the scene.
    #[error("the stored reference is of another version of this scene (hash {stored}, now {current})")]
    Stale {
        /// The hash in the metadata.
        stored: String,
        /// The hash of the scene.
        current: String,
    },
    /// It cannot be read or written.
    #[error("{}: {problem}", path.display())]
    Broken {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
}

fn broken(path: &Path, problem: impl ToString) -> StoredError {
    StoredError::Broken {
        path: path.to_owned(),
        problem: problem.to_string(),
    }
}

/// Reads the values in a file of variants; none if the file does not exist.
///
/// # Errors
/// If it cannot be read, or is not an image of variants.
pub fn read_variants(path: &Path) -> Result<Variants, StoredError> {
    if !path.is_file() {
        return Ok(Variants::default());
    }
    let file = exr_io::read(path, Limits::IMAGE).map_err(|error| broken(path, error))?;
    Variants::from_image(&file).ok_or_else(|| broken(path, "it lacks one of the channels R, G, B, X and Y"))
}

/// The key `hash` of a reference: of the text of its metadata without this line, and of the files
/// of the image and of the variants (empty if there is none).
pub fn hash(meta: &str, files: [&[u8]; 2]) -> String {
    let others = meta.lines().filter(|line| !line.starts_with("hash = "));
    let text: String = others.flat_map(|line| [line, "\n"]).collect();
    let mut hasher = blake3::Hasher::new();
    for bytes in [text.as_bytes(), files[0], files[1]] {
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    }
    hasher.finalize().to_hex()[..32].to_owned()
}

/// As [`hash()`], of the files in a folder.
fn hash_in(folder: &Path, renderer: Renderer, meta: &str) -> Result<String, StoredError> {
    let read = |name: String| {
        let path = folder.join(name);
        match std::fs::read(&path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Vec::new()),
            read => read.map_err(|error| broken(&path, error)),
        }
    };
    let (image, variants) = (read(renderer.image_file())?, read(renderer.variants_file())?);
    Ok(hash(meta, [&image, &variants]))
}

impl Stored {
    /// Reads the reference in a folder and checks that it belongs to the scene.
    pub fn read(folder: &Path, renderer: Renderer, scene_hash: &str) -> Result<Self, StoredError> {
        let stored = Self::read_any(folder, renderer)?;
        if stored.meta.scene_hash == scene_hash {
            Ok(stored)
        } else {
            Err(StoredError::Stale {
                stored: stored.meta.scene_hash,
                current: scene_hash.to_owned(),
            })
        }
    }

    /// Whether there is a reference in the folder, for any version of the scene.
    pub fn is_in(folder: &Path, renderer: Renderer) -> bool {
        folder.join(renderer.image_file()).is_file() && folder.join(renderer.meta_file()).is_file()
    }

    /// Reads the reference in a folder, for any version of the scene.
    pub fn read_any(folder: &Path, renderer: Renderer) -> Result<Self, StoredError> {
        if !Self::is_in(folder, renderer) {
            return Err(StoredError::Missing {
                renderer,
                folder: folder.to_owned(),
            });
        }
        let (exr, meta) = (
            folder.join(renderer.image_file()),
            folder.join(renderer.meta_file()),
        );
        let text = std::fs::read_to_string(&meta).map_err(|error| broken(&meta, error))?;
        let path = meta;
        let meta: Meta = toml::from_str(&text).map_err(|error| broken(&path, error))?;
        if !(meta.floor.is_finite() && meta.floor >= 0.0) {
            return Err(broken(&path, "`floor` is no error"));
        }
        if meta.hash != hash_in(folder, renderer, &text)? {
            let problem = "the metadata and the image files do not belong together: writing was interrupted, \
                or one of them was replaced or changed; store the reference again";
            return Err(broken(&path, problem));
        }
        let image = exr_io::read(&exr, Limits::IMAGE).map_err(|error| broken(&exr, error))?;
        let variants = read_variants(&folder.join(renderer.variants_file()))?;
        Ok(Self {
            image,
            variants,
            meta,
        })
    }

    /// Writes the reference to a folder. The metadata comes last and identifies the other files, so
    /// that an interrupted write is detected.
    pub fn write(&self, folder: &Path, renderer: Renderer) -> Result<(), StoredError> {
        std::fs::create_dir_all(folder).map_err(|error| broken(folder, error))?;
        let exr = folder.join(renderer.image_file());
        exr_io::write(&exr, &self.image).map_err(|error| broken(&exr, error))?;
        let path = folder.join(renderer.variants_file());
        match self.variants.to_image() {
            Some(image) => exr_io::write(&path, &image).map_err(|error| broken(&path, error))?,
            // Variants of an earlier version must not be used for this one.
            None if path.exists() => std::fs::remove_file(&path).map_err(|error| broken(&path, error))?,
            None => {}
        }
        let path = folder.join(renderer.meta_file());
        let text = |hash: String| {
            let meta = Meta {
                hash,
                ..self.meta.clone()
            };
            toml::to_string(&meta).map_err(|error| broken(&path, error))
        };
        let text = text(hash_in(folder, renderer, &text(String::new())?)?)?;
        atomic::write_bytes(&path, text.as_bytes()).map_err(|error| broken(&path, error))
    }

    /// Adds the ranges of all pixels to an image. Pixels without one are written as zeros.
    pub fn add_ranges(image: &mut Image, ranges: &[Option<Range>]) -> Result<(), StoredError> {
        for (index, name) in LAYERS.into_iter().enumerate() {
            let value = |range: &Option<Range>| {
                let range = range.as_ref()?;
                let side = if index < 3 { range.min } else { range.max };
                Some(side[index % 3] as f32)
            };
            let samples = ranges.iter().map(|range| value(range).unwrap_or(0.0)).collect();
            image
                .add_channel(name, samples)
                .map_err(|error| broken(Path::new("the image"), error))?;
        }
        Ok(())
    }

    /// The variation that explains our values.
    pub fn variation(&self) -> Variation<'_> {
        Variation {
            reference: &self.image,
            // An incomplete set of range layers counts as none.
            ranges: Ranges::of(&self.image).unwrap_or_default(),
            variants: &self.variants,
        }
    }
}

/// The variation of a stored reference, from its files.
#[derive(Clone, Copy, Debug)]
pub struct Variation<'a> {
    /// The reference itself.
    pub reference: &'a Image,
    /// Its ranges.
    pub ranges: Option<Ranges<'a>>,
    /// Its values; empty where only ranges were stored.
    pub variants: &'a Variants,
}

impl Variation<'_> {
    /// The values that the reference takes in a pixel. If only the range was stored, they are its
    /// ends, and everything between them is ambiguous.
    fn values(&self, pixel: [usize; 2]) -> Vec<[f64; 3]> {
        if let Some(values) = self.variants.of(pixel) {
            return values.to_vec();
        }
        let range = self.ranges.and_then(|ranges| ranges.at(pixel));
        range.map_or_else(Vec::new, |ends| ends.to_vec())
    }

    /// The explanation of our value in a pixel over tolerance; `mean` is the mean of the reference.
    pub fn explain(&self, ours: &Image, pixel: [usize; 2], tolerance: Tolerance, mean: f64) -> Explanation {
        let trial = [Trial {
            reason: Reason::Stored,
            settings: Vec::new(),
        }];
        let nominal = color_at(self.reference, pixel);
        let allowed = nominal.map(|v| tolerance.relative * v.abs() + tolerance.absolute * mean);
        explain(
            color_at(ours, pixel),
            nominal,
            allowed,
            &trial,
            &[self.values(pixel)],
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stored(value: f32) -> Stored {
        let mut image = Image::new(2, 1).unwrap();
        for name in ["R", "G", "B"] {
            image.add_channel(name, vec![value; 2]).unwrap();
        }
        Stored {
            image,
            variants: Variants::default(),
            meta: Meta {
                renderer: "mitsuba".to_owned(),
                version: String::new(),
                variant: String::new(),
                integrator: String::new(),
                k: 4.0,
                libllvm: String::new(),
                cpu: String::new(),
                scene_hash: "s".to_owned(),
                hash: String::new(),
                twin: "native".to_owned(),
                floor: f64::from(value),
                moved: None,
                samples: 1,
                seconds: 0.0,
                rays: [0, 0],
                rehits: 0,
                notes: Vec::new(),
            },
        }
    }

    /// An image of one write and the metadata of another, as after an interruption.
    #[test]
    fn files_of_different_writes_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        let read = || Stored::read(at, Renderer::MITSUBA, "s");
        stored(1.0).write(at, Renderer::MITSUBA).unwrap();
        assert_eq!(read().ok().unwrap().meta.floor, 1.0);
        let meta = at.join(Renderer::MITSUBA.meta_file());
        let old = std::fs::read(&meta).unwrap();
        stored(2.0).write(at, Renderer::MITSUBA).unwrap();
        assert_eq!(read().ok().unwrap().meta.floor, 2.0);
        std::fs::write(&meta, &old).unwrap();
        let error = read().err().unwrap().to_string();
        assert!(error.contains("writing was interrupted"), "{error}");
        // A number of the metadata alone.
        stored(1.0).write(at, Renderer::MITSUBA).unwrap();
        let text = String::from_utf8(old).unwrap();
        std::fs::write(&meta, text.replace("floor = 1.0", "floor = 1.5")).unwrap();
        assert!(read().err().unwrap().to_string().contains("changed"));
        // A checkout with other ends of lines changes nothing.
        std::fs::write(&meta, text.replace('\n', "\r\n")).unwrap();
        assert_eq!(read().ok().unwrap().meta.floor, 1.0);
        std::fs::write(&meta, text.replace("floor = 1.0", "floor = nan")).unwrap();
        assert!(read().err().unwrap().to_string().contains("`floor`"));
    }
}
