//! Triangles of OBJ, PLY, STL and glTF files, with the attributes of their vertices.

mod displacement;
mod gltf;
mod obj;
mod ply;
mod stl;
mod subdivision;
mod tangents;
#[cfg(test)]
mod tests;

use serde::Deserialize;
use subdivision::Joined;
use whitstone_core::config::FilePath;
use whitstone_core::{SceneError, SceneErrors};
use whitstone_scene::Description;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Config {
    file: FilePath,
    subdivision: Option<Subdivision>,
    shading: Option<String>,
    displacement: Option<displacement::Config>,
    part: Option<String>,
    mesh: Option<usize>,
    primitive: Option<usize>,
    skin: Option<usize>,
    weights: Option<Vec<f64>>,
    uv_sets: Option<Vec<u32>>,
    vertex_colors: Option<bool>,
    tangents: Option<bool>,
}

impl Config {
    /// The mesh of a file as a light uses it, without subdivision or displacement.
    pub(crate) fn of(file: FilePath) -> Self {
        Self {
            file,
            subdivision: None,
            shading: None,
            displacement: None,
            part: None,
            mesh: None,
            primitive: None,
            skin: None,
            weights: None,
            uv_sets: None,
            vertex_colors: None,
            tangents: None,
        }
    }

    /// The sets of texture coordinates that are read.
    fn sets(&self) -> &[u32] {
        self.uv_sets.as_deref().unwrap_or(&[0])
    }

    /// A key that the oracle does not support in a file with this extension.
    fn unsupported(&self, extension: &str) -> Option<String> {
        let gltf = ["gltf", "glb"].contains(&extension);
        let indices = [self.mesh, self.primitive, self.skin];
        let foreign = !gltf
            && (indices.iter().any(Option::is_some)
                || self.weights.is_some()
                || self.sets().iter().any(|set| *set != 0));
        let changed = self.subdivision.is_some() || self.displacement.is_some();
        let added = self.part.is_some()
            || self.vertex_colors == Some(true)
            || self.tangents == Some(true)
            || ![&[][..], &[0]].contains(&self.sets());
        if !["obj", "ply", "stl", "gltf", "glb"].contains(&extension) {
            Some(format!("meshes in files named .{extension}"))
        } else if foreign || (self.part.is_some() && extension != "obj") {
            Some(format!("keys of other files in a mesh of .{extension}"))
        } else if changed && added {
            Some("attributes of meshes that are subdivided or displaced".to_owned())
        } else if self.sets().len() > 2 {
            Some("more than two sets of texture coordinates".to_owned())
        } else {
            let other = self.subdivision.as_ref().filter(|how| how.scheme != "loop");
            other.map(|how| format!("the subdivision \"{}\"", how.scheme))
        }
    }
}

/// Loop subdivision, the only scheme.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Subdivision {
    scheme: String,
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
    /// The second set of texture coordinates. This list and those below may be empty.
    seconds: Vec<Option<[[f64; 2]; 3]>>,
    /// Vertex colours: R, G, B and alpha.
    colors: Vec<[[f64; 4]; 3]>,
    tangents: Vec<Option<MeshTangent>>,
    /// The number of each vertex in the file.
    vertices: Vec<[usize; 3]>,
}

/// The mesh tangents of the vertices of a triangle, and the sign of the bitangent.
type MeshTangent = ([[f64; 3]; 3], f64);

/// A vertex of a face.
#[derive(Clone, Copy)]
struct Corner {
    /// Its number in the file.
    vertex: usize,
    place: [f64; 3],
    normal: Option<[f64; 3]>,
    uv: Option<[f64; 2]>,
    second: Option<[f64; 2]>,
    color: Option<[f64; 4]>,
}

impl Corner {
    /// Vertex 0 without attributes.
    fn at(place: [f64; 3]) -> Self {
        Self {
            vertex: 0,
            place,
            normal: None,
            uv: None,
            second: None,
            color: None,
        }
    }
}

impl Mesh {
    /// Triangles, each with its normals and texture coordinates.
    pub(crate) fn of(
        triangles: Vec<[[f64; 3]; 3]>,
        normals: Option<[[f64; 3]; 3]>,
        uvs: Option<[[f64; 2]; 3]>,
    ) -> Self {
        Self {
            normals: vec![normals; triangles.len()],
            uvs: vec![uvs; triangles.len()],
            triangles,
            ..Self::default()
        }
    }

    /// Adds a face as a triangle fan from its first vertex.
    fn add(&mut self, corners: &[Corner]) {
        for pair in corners.windows(2).skip(1) {
            let three = [corners[0], pair[0], pair[1]];
            self.triangles.push(three.map(|corner| corner.place));
            self.normals.push(all(three.map(|corner| corner.normal)));
            self.uvs.push(all(three.map(|corner| corner.uv)));
            self.seconds.push(all(three.map(|corner| corner.second)));
            self.colors
                .push(three.map(|corner| corner.color.unwrap_or([1.0; 4])));
            self.vertices.push(three.map(|corner| corner.vertex));
        }
    }

    /// The second texture coordinates of a triangle, if it has them.
    pub(crate) fn seconds(&self, triangle: usize) -> Option<[[f64; 2]; 3]> {
        self.seconds.get(triangle).copied().flatten()
    }

    pub(crate) fn colors(&self, triangle: usize) -> Option<[[f64; 4]; 3]> {
        self.colors.get(triangle).copied()
    }

    /// The mesh tangents of a triangle, if it has them.
    pub(crate) fn tangents(&self, triangle: usize) -> Option<MeshTangent> {
        self.tangents.get(triangle).copied().flatten()
    }

    /// Whether it has only normals and one set of texture coordinates.
    pub(crate) fn is_plain(&self) -> bool {
        self.colors.is_empty() && self.tangents.is_empty() && self.seconds.iter().all(Option::is_none)
    }
}

fn all<T: Copy>([a, b, c]: [Option<T>; 3]) -> Option<[T; 3]> {
    Some([a?, b?, c?])
}

pub(crate) fn read(description: &Description<'_>, config: &Config) -> Result<Mesh, SceneErrors> {
    let error = |message: String| SceneErrors::from(SceneError::at(config.file.span.clone(), message));
    let path = description.sources.path_of(&config.file);
    let extension = path
        .extension()
        .unwrap_or_default()
        .to_string_lossy()
        .to_lowercase();
    let unsupported = |what: &str| error(format!("the oracle does not support {what}"));
    if let Some(what) = config.unsupported(&extension) {
        return Err(unsupported(&what));
    }
    let file = || std::fs::read(&path).map_err(|fault| error(fault.to_string()));
    let malformed = || unsupported("this mesh file");
    let colored = config.vertex_colors == Some(true);
    let because = |reason: String| unsupported(&format!("this mesh file: {reason}"));
    let mut mesh = match &*extension {
        "obj" => {
            // A character per byte: names may be in any encoding.
            let text: String = file()?.into_iter().map(char::from).collect();
            obj::read(&text, config.part.as_deref(), colored).ok_or_else(malformed)?
        }
        "ply" => ply::read(&file()?).ok_or_else(malformed)?,
        "stl" => stl::read(&file()?).ok_or_else(malformed)?,
        _ => gltf::read(&path, config).map_err(because)?,
    };
    if config.sets().is_empty() {
        mesh.uvs.fill(None);
    }
    if config.tangents == Some(true) && mesh.tangents.is_empty() {
        mesh.add_tangents().map_err(because)?;
    }
    if !colored {
        mesh.colors.clear();
    }
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
