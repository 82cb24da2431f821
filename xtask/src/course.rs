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

/// A picture for each chapter: its scene, and the scene with the right answer.
pub(crate) fn pictures(registry: &Registry) -> Result<Vec<(PathBuf, Vec<u8>)>, Failure> {
    let answers = find_scenes(&[PathBuf::from(ANSWERS)]).map_err(Failure::environment)?;
    let file = |answer: &PathBuf| {
        let name = answer.file_name().unwrap_or_default();
        let start = Path::new(FOLDER).join(name);
        let overrides = [
            size(184, 138),
            "sampler={ type = \"grid\", samples_per_axis = 3 }".to_owned(),
        ];
        let both: Result<Vec<Raster>, Failure> = [&start, answer]
            .into_iter()
            .map(|scene| picture(registry, &scene.display().to_string(), &overrides))
            .collect();
        let bytes = grid(&both?, 2).to_png().map_err(Failure::environment)?;
        Ok((start.with_extension("png"), bytes))
    };
    answers.iter().map(file).collect()
}
