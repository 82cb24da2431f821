//! Triangles of OBJ and PLY files, with the normals and texture coordinates of their vertices.

mod displacement;
mod obj;
mod ply;
mod subdivision;

use serde::Deserialize;
use std::path::Path;
use subdivision::Joined;
use whitstone_core::config::FilePath;
use whitstone_core::{SceneError, SceneErrors};
use whitstone_scene::Description;

#[derive(Debug, Deserialize)]
pub(crate) struct Config {
    file: FilePath,
    subdivision: Option<Subdivision>,
    shading: Option<String>,
    displacement: Option<displacement::Config>,
}

impl Config {
    /// The mesh of a file as a light uses it, without subdivision or displacement.
    pub(crate) fn of(file: FilePath) -> Self {
        Self {
            file,
            subdivision: None,
            shading: None,
            displacement: None,
        }
    }
}

/// Loop subdivision, the only scheme.
#[derive(Debug, Deserialize)]
struct Subdivision {
    levels: u32,
}

/// Attributes by triangle, in the order of the file.
#[derive(Debug, Default)]
pub(crate) struct Mesh {
    pub(crate) triangles: Vec<[[f64; 3]; 3]>,
    /// Normals of the triangles whose vertices have them.
    pub(crate) normals: Vec<Option<[[f64; 3]; 3]>>,
    /// Texture coordinates of the triangles whose vertices have them.
    pub(crate) uvs: Vec<Option<[[f64; 2]; 3]>>,
}

/// A vertex of a face.
#[derive(Clone, Copy)]
struct Corner {
    place: [f64; 3],
    normal: Option<[f64; 3]>,
    uv: Option<[f64; 2]>,
}

impl Mesh {
    /// Adds a face as a triangle fan from its first vertex.
    fn add(&mut self, corners: &[Corner]) {
        for pair in corners.windows(2).skip(1) {
            let three = [corners[0], pair[0], pair[1]];
            self.triangles.push(three.map(|corner| corner.place));
            self.normals.push(all(three.map(|corner| corner.normal)));
            self.uvs.push(all(three.map(|corner| corner.uv)));
        }
    }
}

fn all<T: Copy>([a, b, c]: [Option<T>; 3]) -> Option<[T; 3]> {
    Some([a?, b?, c?])
}

pub(crate) fn read(description: &Description<'_>, config: &Config) -> Result<Mesh, SceneErrors> {
    let error = |message: String| SceneErrors::from(SceneError::at(config.file.span.clone(), message));
    let path = description.sources.base().join(Path::new(&config.file.path));
    let bytes = std::fs::read(&path).map_err(|fault| error(fault.to_string()))?;
    let mesh = match bytes.starts_with(b"ply") {
        true => ply::read(&bytes),
        false => obj::read(&String::from_utf8_lossy(&bytes)),
    };
    let mut mesh = mesh.ok_or_else(|| error("the oracle cannot read this mesh".to_owned()))?;
    if config.subdivision.is_some() || config.displacement.is_some() {
        let levels = config.subdivision.as_ref().map_or(0, |how| how.levels);
        let mut joined = Joined::new(&mesh).subdivided(levels);
        if let Some(how) = &config.displacement {
            displacement::displace(&mut joined, how, description)?;
        }
        mesh = joined.mesh();
    }
    if config.shading.as_deref() == Some("flat") {
        mesh.normals.fill(None);
    }
    Ok(mesh)
}
