//! A triangle mesh from a file.
//!
//! - Formats: Wavefront OBJ (polygons and their texture coordinates and normals; see `obj`), and PLY (Turk,
//!   *The PLY polygon file format*, 1994; see `ply`).
//! - Twin: Mitsuba `obj` and `ply` meshes (native), with `face_normals` where the file has no normals.
//! - Example: `scenes/shapes/mesh.toml`.

mod obj;
mod ply;

use crate::lower::{Lowered, Triangles, lower};
use schemars::JsonSchema;
use serde::Deserialize;
use std::path::Path;
use whitstone_core::config::FilePath;
use whitstone_core::{Context, Plugin, SceneError, SceneErrors, Shape, Shapes, Transform};

/// A mesh of triangles from an OBJ or PLY file; seen from outside, corners run counter-clockwise.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// A file that ends in .obj or .ply. Polygons are cut into fans; groups and materials are ignored.
    file: FilePath,
    /// Whether the normals in the file are used.
    #[serde(default)]
    shading: Shading,
}

/// How normals vary over a triangle.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq)]
#[serde(rename_all = "snake_case")]
enum Shading {
    /// Interpolated between the normals in the file, where it has any.
    #[default]
    Smooth,
    /// Constant: that of the triangle.
    Flat,
}

/// Becomes triangles in world space.
pub struct Mesh;

/// What is wrong with a mesh file, and in which line if that is known.
#[derive(Debug, PartialEq)]
struct FileError {
    line: Option<usize>,
    message: String,
}

impl FileError {
    fn at(line: usize, message: impl Into<String>) -> Self {
        Self {
            line: Some(line),
            message: message.into(),
        }
    }

    fn anywhere(message: impl Into<String>) -> Self {
        Self {
            line: None,
            message: message.into(),
        }
    }
}

impl Plugin<Shapes> for Mesh {
    const TYPE: &'static str = "mesh";
    type Config = Config;

    fn build(config: Config, transform: Transform, context: &mut dyn Context) -> Result<Shape, SceneErrors> {
        let Config { file, shading } = config;
        let error = |message: String| SceneError::at(file.span.clone(), message);
        let path = context.file(&file)?;
        let mut object = read(&path).map_err(|FileError { line, message }| match line {
            Some(line) => error(format!("{}, line {line}: {message}", file.path)),
            None => error(format!("{}: {message}", file.path)),
        })?;
        if shading == Shading::Flat {
            object.normals.clear();
        }
        let Lowered { mesh, flat } = lower(object, &transform).ok_or_else(|| {
            error(format!(
                "{}: the transform moves a vertex beyond all numbers",
                file.path
            ))
        })?;
        if flat > 0 {
            let of = mesh.triangles.len();
            let message = format!(
                "{}: {flat} of {of} triangles have no area and are never hit",
                file.path
            );
            context.warn(error(message));
        }
        Ok(Shape::Triangles(mesh))
    }
}

/// The triangles in a file, all indices in range, all numbers finite, at least one triangle.
fn read(path: &Path) -> Result<Triangles, FileError> {
    type Parse = fn(&[u8]) -> Result<Triangles, FileError>;
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    let parse: Parse = match extension.to_str() {
        Some("obj") => obj::parse,
        Some("ply") => ply::parse,
        _ => return Err(FileError::anywhere("expected a file that ends in .obj or .ply")),
    };
    let bytes = std::fs::read(path).map_err(|e| FileError::anywhere(format!("cannot be read: {e}")))?;
    let object = parse(&bytes)?;
    if object.triangles.is_empty() {
        return Err(FileError::anywhere("expected at least one face, found none"));
    }
    Ok(object)
}

/// Cuts a polygon into a fan from its first corner.
fn fan(polygon: &[u32]) -> impl Iterator<Item = [u32; 3]> + '_ {
    polygon
        .windows(2)
        .skip(1)
        .map(|side| [polygon[0], side[0], side[1]])
}
