//! The pictures of the course in docs/course.

use crate::diagrams::{grid, picture, size};
use std::path::{Path, PathBuf};
use whitstone::Failure;
use whitstone::core::Registry;
use whitstone::image::Raster;
use whitstone::validate::find_scenes;

/// The chapters, and the scenes that they start with.
pub(crate) const FOLDER: &str = "docs/course";
/// The scenes with the right answers, by the same names.
const ANSWERS: &str = "docs/course/scenes";
/// Quality of the JPEG files. As PNG files they would be three times as large.
const JPEG: u8 = 75;

/// A picture for each chapter: its scene, and the scene with the right answer.
pub(crate) fn pictures(registry: &Registry) -> Result<Vec<(PathBuf, Vec<u8>)>, Failure> {
    let answers = find_scenes(&[PathBuf::from(ANSWERS)]).map_err(Failure::environment)?;
    let file = |answer: &PathBuf| {
        let name = answer.file_name().unwrap_or_default();
        let start = Path::new(FOLDER).join(name);
        let overrides = [
            size(148, 111),
            "sampler={ type = \"grid\", samples_per_axis = 3 }".to_owned(),
        ];
        let both: Result<Vec<Raster>, Failure> = [&start, answer]
            .into_iter()
            .map(|scene| picture(registry, &scene.display().to_string(), &overrides))
            .collect();
        let bytes = grid(&both?, 2).to_jpeg(JPEG).map_err(Failure::environment)?;
        Ok((start.with_extension("jpg"), bytes))
    };
    answers.iter().map(file).collect()
}
