//! The triangles of shapes that are built to them, and PLY files of them.

use crate::table;
use std::path::{Path, PathBuf};
use toml::{Table, Value};
use whitstone_core::config::{FilePath, TextureRef, TextureValue};
use whitstone_core::{
    ColorSource, DVec3, Diagnostics, LoweredShape, Registry, Resources, SceneError, SceneErrors, Shapes,
    Storage, Transform, TriangleMesh,
};
use whitstone_gltf::Document;
use whitstone_gltf::json::mesh::Semantic;
use whitstone_gltf::json::validation::Checked;

/// Largest memory in bytes for reading a mesh.
const MAX_BYTES: u64 = 8 << 30;

/// Keys of a shape that do not change its triangles in object space.
const PLACEMENT: [&str; 6] = ["type", "id", "material", "transform", "motion", "casts_shadow"];

/// Why a shape has no triangles.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Missing {
    /// Its surface does not consist of triangles.
    Curved,
    /// It cannot be read, or not be written in single precision.
    Faulty(String),
}

/// Whether a glTF file stores the tangents of the mesh of a shape.
fn stores_tangents(shape: &Table, base: &Path) -> bool {
    let Some(file) = table::text(shape, "file") else {
        return false;
    };
    let Ok(document) = Document::open(&base.join(file)) else {
        return false;
    };
    let index = |key: &str| shape.get(key).and_then(Value::as_integer).unwrap_or(0) as usize;
    let mesh = document.root.meshes.get(index("mesh"));
    let primitive = mesh.and_then(|mesh| mesh.primitives.get(index("primitive")));
    primitive.is_some_and(|primitive| {
        let has = |semantic| primitive.attributes.contains_key(&Checked::Valid(semantic));
        has(Semantic::Tangents) && has(Semantic::Normals)
    })
}

/// The mesh of a shape that is built to triangles, in object space.
pub(crate) fn built(shape: &Table, base: &Path) -> Result<TriangleMesh, Missing> {
    let kind = table::kind(shape);
    let mut keys = shape.clone();
    for key in PLACEMENT {
        keys.remove(key);
    }
    if kind == "mesh" && stores_tangents(shape, base) {
        // They count only with normals.
        keys.remove("shading");
    } else if kind == "mesh" {
        // Other tangents are computed again from the texture coordinates.
        keys.remove("tangents");
    }
    let told = |error: &dyn std::fmt::Display| Missing::Faulty(error.to_string());
    let mut registry = Registry::default();
    whitstone_shapes::register(&mut registry).map_err(|error| told(&error))?;
    let text = keys.to_string();
    let parsed = toml::de::DeTable::parse(&text).map_err(|error| told(&error))?;
    let mut context = Files { base, reserved: 0 };
    let built = registry.build::<Shapes>(kind, &parsed, Transform::IDENTITY, &mut context);
    match built {
        Ok(LoweredShape::Triangles(mesh)) => Ok(mesh),
        Ok(_) => Err(Missing::Curved),
        Err(errors) => Err(Missing::Faulty(
            errors
                .0
                .first()
                .map_or(String::new(), |error| error.message.clone()),
        )),
    }
}

/// A binary PLY file: positions, and normals and texture coordinates if the mesh has them. The
/// numbers have single precision if it holds all of them.
pub(crate) fn ply(mesh: &TriangleMesh) -> Vec<u8> {
    let split;
    let mesh = if mesh.normals.contains(&DVec3::ZERO) {
        split = with_normals(mesh);
        &split
    } else {
        mesh
    };
    let mut names = vec!["x", "y", "z"];
    if !mesh.normals.is_empty() {
        names.extend(["nx", "ny", "nz"]);
    }
    if !mesh.uvs.is_empty() {
        names.extend(["u", "v"]);
    }
    let count = mesh.positions.len();
    let values = (0..count).flat_map(|k| {
        let normal = mesh.normals.get(k).into_iter().flat_map(|n| n.to_array());
        let uv = mesh.uvs.get(k).into_iter().flat_map(|uv| uv.to_array());
        mesh.positions[k].to_array().into_iter().chain(normal).chain(uv)
    });
    let is_single = values.clone().all(|x| f64::from(x as f32) == x);
    let kind = if is_single { "float" } else { "double" };
    let mut bytes = format!("ply\nformat binary_little_endian 1.0\nelement vertex {count}\n").into_bytes();
    for name in names {
        bytes.extend(format!("property {kind} {name}\n").bytes());
    }
    let faces = mesh.triangles.len();
    let list = "property list uchar int vertex_indices\nend_header\n";
    bytes.extend(format!("element face {faces}\n{list}").bytes());
    for x in values {
        if is_single {
            bytes.extend((x as f32).to_le_bytes());
        } else {
            bytes.extend(x.to_le_bytes());
        }
    }
    for triangle in &mesh.triangles {
        bytes.push(3);
        bytes.extend(triangle.iter().flat_map(|index| index.to_le_bytes()));
    }
    bytes
}

/// Gives corners without a normal that of their triangle, as vertices of their own.
fn with_normals(mesh: &TriangleMesh) -> TriangleMesh {
    let mut split = TriangleMesh {
        positions: mesh.positions.clone(),
        normals: mesh.normals.clone(),
        uvs: mesh.uvs.clone(),
        triangles: mesh.triangles.clone(),
        orientation: mesh.orientation,
        attributes: None,
    };
    for triangle in &mut split.triangles {
        let [a, b, c] = triangle.map(|k| mesh.positions[k as usize]);
        let normal = (b - a).cross(c - a).normalize_or(DVec3::Z);
        for corner in triangle {
            let k = *corner as usize;
            if mesh.normals[k] != DVec3::ZERO {
                continue;
            }
            *corner = split.positions.len() as u32;
            split.positions.push(mesh.positions[k]);
            split.normals.push(normal);
            if let Some(uv) = mesh.uvs.get(k) {
                split.uvs.push(*uv);
            }
        }
    }
    // Vertices that no triangle uses any more.
    for normal in &mut split.normals {
        if *normal == DVec3::ZERO {
            *normal = DVec3::Z;
        }
    }
    split
}

/// The files of a scene, for shapes that read them.
struct Files<'a> {
    base: &'a Path,
    reserved: u64,
}

impl Resources for Files<'_> {
    fn texture(&mut self, reference: &TextureRef) -> Result<ColorSource, SceneErrors> {
        match reference.value {
            TextureValue::Constant(color) => Ok(ColorSource::Constant(color)),
            TextureValue::Plugin(_) => Err(SceneError::anywhere("textures are not available here").into()),
        }
    }

    fn file(&self, file: &FilePath) -> Result<PathBuf, SceneError> {
        let path = self.base.join(&file.path);
        if path.is_file() {
            Ok(path)
        } else {
            let message = format!("expected a regular file, found none at \"{}\"", file.path);
            Err(SceneError::at(file.span.clone(), message))
        }
    }
}

impl Storage for Files<'_> {
    fn reserve(&mut self, bytes: u64) -> Result<(), SceneErrors> {
        self.reserved = self.reserved.saturating_add(bytes);
        if self.reserved > MAX_BYTES {
            return Err(SceneError::anywhere("is too large for the memory of an export").into());
        }
        Ok(())
    }
}

impl Diagnostics for Files<'_> {
    fn warn(&mut self, _: SceneError) {}
}
