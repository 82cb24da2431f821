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
#[serde(deny_unknown_fields)]
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
    let extension = path
        .extension()
        .unwrap_or_default()
        .to_string_lossy()
        .to_lowercase();
    let unsupported = |what: &str| error(format!("the oracle does not support {what}"));
    if !["obj", "ply"].contains(&&*extension) {
        return Err(unsupported(&format!("meshes in files named .{extension}")));
    }
    if let Some(how) = config.subdivision.as_ref().filter(|how| how.scheme != "loop") {
        return Err(unsupported(&format!("the subdivision \"{}\"", how.scheme)));
    }
    let bytes = std::fs::read(&path).map_err(|fault| error(fault.to_string()))?;
    let mesh = match &*extension {
        "ply" => ply::read(&bytes),
        _ => obj::read(&String::from_utf8_lossy(&bytes)),
    };
    let mut mesh = mesh.ok_or_else(|| unsupported("this mesh file"))?;
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

#[cfg(test)]
mod tests {
    use crate::Oracle;
    use crate::tracer::Tracer;
    use std::path::Path;
    use whitstone_scene::{Description, Sources};

    /// The errors of the oracle and of its tracer for a scene, with these files next to it.
    fn refusals(text: &str, files: &[(&str, &[u8])]) -> [Option<String>; 2] {
        let folder = tempfile::tempdir().unwrap();
        for (name, bytes) in files {
            std::fs::write(folder.path().join(name), bytes).unwrap();
        }
        let look = "look_at = { origin = [0, 0, 9], target = [0, 0, 0] }";
        let text = format!("[camera]\ntype = \"perspective\"\n{look}\n{text}");
        let sources = Sources::from_text("scene.toml", &text, Path::new(folder.path()), &[]).unwrap();
        let description = Description::parse(&sources).into_result().unwrap();
        let first = |errors: whitstone_core::SceneErrors| errors.0[0].message.clone();
        [
            Oracle::new(&description, 0).err().map(first),
            Tracer::new(&description).err().map(first),
        ]
    }

    const TRIANGLE: &[u8] = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

    #[test]
    fn unsupported_files_and_keys_are_refused() {
        let mesh = |keys: &str| format!("[[shape]]\ntype = \"mesh\"\n{keys}");
        let names = ["m.obj", "m.OBJ", "m.xyz", "m.glb", "m.gltf", "m.stl"];
        let files = names.map(|name| (name, TRIANGLE));
        for keys in ["file = \"m.obj\"", "file = \"m.OBJ\""] {
            assert_eq!(refusals(&mesh(keys), &files), [None, None], "{keys}");
        }
        for name in &names[2..] {
            for refusal in refusals(&mesh(&format!("file = \"{name}\"")), &files) {
                let refusal = refusal.unwrap();
                assert!(
                    refusal.starts_with("the oracle does not support"),
                    "{name}: {refusal}"
                );
            }
        }
        for keys in [
            "bogus = 1",
            "subdivision = { scheme = \"loop\", levels = 1, bogus = 1 }",
            "subdivision = { scheme = \"other\", levels = 1 }",
            "displacement = { height = 1, bogus = 1 }",
        ] {
            let text = mesh(&format!("file = \"m.obj\"\n{keys}"));
            assert!(refusals(&text, &files).iter().all(Option::is_some), "{keys}");
        }
    }
}
