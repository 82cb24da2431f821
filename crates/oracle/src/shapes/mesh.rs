//! The triangles of an OBJ file: what begins with `v` and `f`.

use super::text;
use super::triangle::Triangles;
use serde::Deserialize;
use whitstone_core::config::FilePath;
use whitstone_core::{SceneError, SceneErrors};
use whitstone_scene::Description;

#[derive(Debug, Deserialize)]
pub(crate) struct Config {
    file: FilePath,
    subdivision: Option<serde::de::IgnoredAny>,
}

pub(crate) fn read(description: &Description<'_>, config: &Config) -> Result<Triangles, SceneErrors> {
    let error = |message: &str| SceneErrors::from(SceneError::at(config.file.span.clone(), message));
    if config.subdivision.is_some() || !config.file.path.ends_with(".obj") {
        return Err(error(
            "the oracle reads meshes from .obj files, without subdivision",
        ));
    }
    let text = text(description, &config.file)?;
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let numbers: Vec<f64> = words.take(3).filter_map(|word| word.parse().ok()).collect();
                vertices.push(<[f64; 3]>::try_from(numbers).map_err(|_| error("a malformed vertex"))?);
            }
            Some("f") => {
                let corner = |word: &str| -> Option<[f64; 3]> {
                    let number: i64 = word.split('/').next()?.parse().ok()?;
                    let from_start = if number < 0 {
                        vertices.len() as i64 + number
                    } else {
                        number - 1
                    };
                    vertices.get(usize::try_from(from_start).ok()?).copied()
                };
                let corners: Option<Vec<_>> = words.map(corner).collect();
                let corners = corners.ok_or_else(|| error("a malformed face"))?;
                let fan = corners.windows(2).skip(1);
                triangles.extend(fan.map(|pair| [corners[0], pair[0], pair[1]]));
            }
            _ => {}
        }
    }
    Ok(Triangles(triangles))
}
