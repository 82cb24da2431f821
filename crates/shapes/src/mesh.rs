//! A triangle mesh from a file.
//!
//! - Formats: Wavefront OBJ (polygons with texture coordinates and normals; see `obj`), PLY (Turk,
//!   *The PLY polygon file format*, 1994; see `ply`), STL (see `stl`) and glTF 2.0 (see `gltf`).
//! - Optional Loop subdivision (Loop 1987; see `subdivision`) and displacement along the normals
//!   (Cook 1984; see `displacement`).
//! - Twin: Mitsuba meshes (native). The driver reads, subdivides and displaces the file itself, and
//!   sets `face_normals` where there are no normals.
//! - Example: `scenes/shapes/mesh.toml`.

mod displacement;
mod gltf;
mod obj;
mod ply;
mod stl;
mod subdivision;
mod tangents;

use crate::support::lower::{Lowered, Triangles, lower};
use displacement::Displacement;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;
use subdivision::{Subdivision, Surface};
use toml::Spanned;
use whitstone_core::config::{FilePath, Finite};
use whitstone_core::{Context, LoweredShape, Plugin, SceneError, SceneErrors, Shapes, Transform};
use whitstone_gltf::Request;

/// A triangle mesh from an OBJ, PLY, STL or glTF file; front faces are counter-clockwise.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Path of a file that ends in .obj, .ply, .stl, .gltf or .glb. Polygons are triangulated as
    /// fans; materials in the file are ignored.
    file: FilePath,
    /// For OBJ: only the faces under `usemtl` with this name; "" for those before any.
    #[serde(default)]
    #[schemars(extend("x-default" = "all faces"), with = "String")]
    part: Option<Spanned<String>>,
    /// For glTF: index of the mesh.
    #[serde(default)]
    #[schemars(extend("default" = 0), with = "u32")]
    mesh: Option<Spanned<u32>>,
    /// For glTF: index of the primitive in the mesh.
    #[serde(default)]
    #[schemars(extend("default" = 0), with = "u32")]
    primitive: Option<Spanned<u32>>,
    /// For glTF: index of the skin that deforms the mesh.
    #[serde(default)]
    #[schemars(extend("x-default" = "none"), with = "u32")]
    skin: Option<Spanned<u32>>,
    /// For glTF: weights of the morph targets.
    #[serde(default)]
    #[schemars(extend("x-default" = "those of the file"), with = "Vec<Finite>")]
    weights: Option<Spanned<Vec<Finite>>>,
    /// Indices of at most two sets of texture coordinates in the file. The first becomes (u, v).
    /// Textures with `uv_set = 1` use the second. Sets other than 0 exist only in glTF.
    #[serde(default)]
    #[schemars(extend("default" = [0]), with = "Vec<u32>")]
    uv_sets: Option<Spanned<Vec<u32>>>,
    /// Whether to read vertex colours, for the texture `vertex_color`.
    #[serde(default)]
    vertex_colors: bool,
    /// Whether the mesh has tangents, for a `normal_map` or `bump` with `tangent = "mesh"`: those
    /// of the glTF file, otherwise computed from (u, v).
    #[serde(default)]
    tangents: bool,
    /// How normals vary over a triangle: "smooth" or "flat".
    #[serde(default)]
    shading: Shading,
    /// Subdivides the mesh into a smooth surface; the normals in the file are discarded.
    #[serde(default)]
    #[schemars(extend("x-default" = "none"), with = "Subdivision")]
    subdivision: Option<Subdivision>,
    /// Displaces the vertices along their normals by a `height`, or by a `vector_map`, after
    /// subdivision; the normals in the file are discarded.
    #[serde(default)]
    #[schemars(extend("x-default" = "none"), with = "Displacement")]
    displacement: Option<Spanned<Displacement>>,
}

/// How normals vary over a triangle.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema, PartialEq)]
#[serde(rename_all = "snake_case")]
enum Shading {
    /// Interpolated between the vertex normals: those of the file, or after subdivision or
    /// displacement the computed ones. Without any: flat.
    #[default]
    Smooth,
    /// Constant over each triangle: its geometric normal.
    Flat,
}

/// Lowers to triangles in world space.
pub struct Mesh;

/// A mesh file error, with its line number if known.
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

    fn build(
        config: Config,
        transform: Transform,
        context: &mut dyn Context,
    ) -> Result<LoweredShape, SceneErrors> {
        let path = context.file(&config.file)?;
        let mut object = read(&path, &config, context)?;
        let Config {
            file,
            shading,
            subdivision,
            displacement,
            ..
        } = config;
        let error = |message: String| SceneError::at(file.span.clone(), message);
        if subdivision.is_some() || displacement.is_some() {
            let mut surface = Surface::new(object);
            if displacement.is_some() {
                let levels = subdivision.as_ref().map_or(0, Subdivision::levels);
                context.reserve(displacement::bytes(&surface, levels))?;
            }
            if let Some(how) = &subdivision {
                subdivision::subdivide(&mut surface, how, context)?;
            }
            if let Some(how) = &displacement {
                displacement::displace(&mut surface, how, context)?;
            }
            object = surface.finish();
        }
        if shading == Shading::Flat {
            object.normals.clear();
        }
        let Lowered { mesh, flat } = lower(object, &transform).ok_or_else(|| {
            error(format!(
                "{}: the transform moves a vertex out of the range of double precision",
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
        Ok(LoweredShape::Triangles(mesh))
    }
}

/// The kind of a file, by its extension.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Obj,
    Ply,
    Stl,
    Gltf,
}

impl Kind {
    fn of(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_ascii_lowercase();
        Some(match extension.to_str()? {
            "obj" => Self::Obj,
            "ply" => Self::Ply,
            "stl" => Self::Stl,
            "gltf" | "glb" => Self::Gltf,
            _ => return None,
        })
    }
}

/// Reports keys that this kind of file does not allow, and keys that exclude each other.
fn check_keys(config: &Config, kind: Kind) -> SceneErrors {
    let mut errors = SceneErrors::default();
    let mut refuse = |span: Option<std::ops::Range<usize>>, message: &str| {
        if let Some(span) = span {
            errors.0.push(SceneError::at(span, message));
        }
    };
    if kind != Kind::Obj {
        refuse(
            config.part.as_ref().map(Spanned::span),
            "`part` needs an OBJ file",
        );
    }
    if kind != Kind::Gltf {
        let only = "this key needs a glTF file";
        refuse(config.mesh.as_ref().map(Spanned::span), only);
        refuse(config.primitive.as_ref().map(Spanned::span), only);
        refuse(config.skin.as_ref().map(Spanned::span), only);
        refuse(config.weights.as_ref().map(Spanned::span), only);
    }
    if let Some(sets) = &config.uv_sets {
        let list = sets.get_ref();
        if list.len() > 2 || (list.len() == 2 && list[0] == list[1]) {
            refuse(Some(sets.span()), "expected at most two sets, without repetition");
        } else if kind != Kind::Gltf && list.iter().any(|set| *set != 0) {
            refuse(Some(sets.span()), "sets other than 0 need a glTF file");
        }
    }
    let changes = config.subdivision.is_some() || config.displacement.is_some();
    let more = config.part.is_some()
        || config.vertex_colors
        || config.tangents
        || config
            .uv_sets
            .as_ref()
            .is_some_and(|sets| !matches!(sets.get_ref()[..], [] | [0]));
    if changes && more {
        let message = "`subdivision` and `displacement` cannot be combined with `part`, `vertex_colors`, `tangents` or `uv_sets` other than [0] or []";
        refuse(Some(config.file.span.clone()), message);
    }
    errors
}

/// What was read for earlier shapes of the scene.
enum Earlier {
    /// Once, and not kept: most meshes are read once.
    Once,
    /// The mesh, and the memory that its reading needs.
    Kept(Triangles, u64),
}

/// Reads a file like [`parse`]. If several shapes read the same from a file, it is parsed twice at
/// most.
fn read(path: &Path, config: &Config, context: &mut dyn Context) -> Result<Triangles, SceneErrors> {
    let index = |key: &Option<Spanned<u32>>| key.as_ref().map(|index| *index.get_ref());
    // All that decides what is read.
    let key = format!(
        "mesh {:?}, {:?}, {:?}, {:?}, {:?}, {:?}, {:?}, {}, {}, {:?}",
        path.canonicalize().unwrap_or_else(|_| path.to_owned()),
        config.part.as_ref().map(Spanned::get_ref),
        index(&config.mesh),
        index(&config.primitive),
        index(&config.skin),
        config.weights.as_ref().map(Spanned::get_ref),
        config.uv_sets.as_ref().map(Spanned::get_ref),
        config.vertex_colors,
        config.tangents,
        config.shading,
    );
    let earlier = context.shared(&key).and_then(|earlier| earlier.downcast().ok());
    if let Some(Earlier::Kept(object, bytes)) = earlier.as_deref() {
        // A mesh that is not parsed again needs the check of its keys too.
        let kind = Kind::of(path).map(|kind| check_keys(config, kind));
        if let Some(errors) = kind.filter(|errors| !errors.0.is_empty()) {
            return Err(errors);
        }
        context.reserve(*bytes)?;
        return Ok(object.clone());
    }
    let (object, bytes) = parse(path, config, context)?;
    let now = match earlier.as_deref() {
        None => Earlier::Once,
        Some(_) => {
            context.reserve(bytes)?;
            Earlier::Kept(object.clone(), bytes)
        }
    };
    context.share(key, Arc::new(now));
    Ok(object)
}

/// Reads a file: at least one triangle, all indices in range, all numbers finite. Also returns the
/// memory that it has reserved.
fn parse(path: &Path, config: &Config, context: &mut dyn Context) -> Result<(Triangles, u64), SceneErrors> {
    let file = &config.file;
    let mut reserved = 0;
    let told = |FileError { line, message }: FileError| {
        let text = match line {
            Some(line) => format!("{}, line {line}: {message}", file.path),
            None => format!("{}: {message}", file.path),
        };
        SceneError::at(file.span.clone(), text)
    };
    let Some(kind) = Kind::of(path) else {
        let expected = "expected a file that ends in .obj, .ply, .stl, .gltf or .glb";
        return Err(told(FileError::anywhere(expected)).into());
    };
    let errors = check_keys(config, kind);
    if !errors.0.is_empty() {
        return Err(errors);
    }
    let uv_sets = config.uv_sets.as_ref().map_or(&[0][..], |sets| sets.get_ref());
    let mut object = if kind == Kind::Gltf {
        let index = |key: &Option<Spanned<u32>>| key.as_ref().map(|index| *index.get_ref() as usize);
        let weights: Option<Vec<f64>> = config
            .weights
            .as_ref()
            .map(|weights| weights.get_ref().iter().map(|weight| weight.get()).collect());
        let request = Request {
            mesh: index(&config.mesh).unwrap_or(0),
            primitive: index(&config.primitive).unwrap_or(0),
            normals: config.shading == Shading::Smooth,
            uv_sets,
            colors: config.vertex_colors,
            tangents: config.tangents,
            weights: weights.as_deref(),
            skin: index(&config.skin),
            compute_tangents: None,
        };
        let reserve = |bytes| {
            reserved = bytes;
            context.reserve(bytes)
        };
        gltf::read(path, &request, reserve).map_err(told)??
    } else {
        // The memory for the file and the parsed mesh is estimated as three times the file size.
        let metadata = std::fs::metadata(path)
            .map_err(|error| told(FileError::anywhere(format!("cannot be read: {error}"))))?;
        // Reading a pipe or a file of the system could wait for ever.
        if !metadata.is_file() || metadata.len() == 0 {
            let what = if metadata.is_file() {
                "it is empty"
            } else {
                "it is not a regular file"
            };
            return Err(told(FileError::anywhere(format!("cannot be read: {what}"))).into());
        }
        reserved = metadata.len().saturating_mul(3);
        context.reserve(reserved)?;
        let bytes = std::fs::read(path)
            .map_err(|error| told(FileError::anywhere(format!("cannot be read: {error}"))))?;
        let part = config.part.as_ref().map(|part| part.get_ref().as_str());
        let colors = config.vertex_colors;
        let parsed = match kind {
            Kind::Obj => obj::parse(&bytes, obj::Request { part, colors }),
            Kind::Ply => ply::parse(&bytes, colors),
            Kind::Stl | Kind::Gltf => stl::parse(&bytes),
        };
        parsed.map_err(told)?
    };
    if uv_sets.is_empty() {
        object.uvs.clear();
    }
    if object.triangles.is_empty() {
        let what = match &config.part {
            Some(part) => format!(
                "expected at least one face of the part \"{}\", found none",
                part.get_ref()
            ),
            None => "expected at least one face, found none".to_owned(),
        };
        return Err(told(FileError::anywhere(what)).into());
    }
    if config.tangents {
        tangents::add(&mut object);
    }
    Ok((object, reserved))
}

/// Triangulates a polygon as a fan around its first corner.
fn fan(polygon: &[u32]) -> impl Iterator<Item = [u32; 3]> + '_ {
    polygon
        .windows(2)
        .skip(1)
        .map(|side| [polygon[0], side[0], side[1]])
}

/// Truncates a word for error messages.
fn shorten(word: &str) -> Cow<'_, str> {
    match word.char_indices().nth(40) {
        Some((end, _)) => format!("{}...", &word[..end]).into(),
        None => word.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;
    use whitstone_testkit::{TestContext, build_in, shape_laws, shape_laws_everywhere};

    const SMALL: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 -1\nvn 1 1 1\n\
                         f 1//1 3//1 2//1\nf 2//2 3//2 4//2\nf 1 2 4\nf 1 4 3\nf 1 2 2\n";

    fn scratch(name: &str, bytes: &[u8]) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("whitstone-mesh-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join(name), bytes).unwrap();
        folder
    }

    fn load(name: &str, bytes: &[u8], more: &str) -> (Result<LoweredShape, SceneErrors>, TestContext) {
        let folder = scratch(name, bytes);
        let mut context = TestContext::in_folder(&folder);
        let text = format!("file = \"{name}\"\n{more}");
        let result = build_in::<Shapes, Mesh>(&text, Transform::IDENTITY, &mut context);
        std::fs::remove_dir_all(&folder).unwrap();
        (result, context)
    }

    #[test]
    fn a_file_that_many_shapes_name_is_parsed_twice() {
        let mut vertices = Vec::new();
        let mut context = TestContext::default();
        for number in 1..=4 {
            // The file changes in each round, so the vertex shows when it was parsed.
            let text = format!("v {number} 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n");
            context.folder = scratch("often.obj", text.as_bytes());
            for more in ["", "part = \"\""] {
                let text = format!("file = \"often.obj\"\n{more}");
                let built = build_in::<Shapes, Mesh>(&text, Transform::IDENTITY, &mut context).unwrap();
                let LoweredShape::Triangles(mesh) = built else {
                    panic!("expected a mesh")
                };
                vertices.push(mesh.positions[0].x);
            }
        }
        assert_eq!(vertices, [1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0]);
        let error = "file = \"often.obj\"\nmesh = 0";
        assert!(build_in::<Shapes, Mesh>(error, Transform::IDENTITY, &mut context).is_err());
        std::fs::remove_dir_all(&context.folder).unwrap();
    }

    fn fails(name: &str, bytes: &[u8]) -> SceneError {
        load(name, bytes, "").0.err().unwrap().0.remove(0)
    }

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws(load("a.obj", SMALL.as_bytes(), "").0.unwrap(), 4_000);
        let folder = scratch("everywhere.obj", SMALL.as_bytes());
        let path = folder.join("everywhere.obj");
        shape_laws_everywhere::<Mesh>(&format!("file = '{}'", path.display()), 2_000);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn colours_of_gltf_are_limited_and_tangents_need_normals() {
        // Positions, colours from -1 to 3, normals z, and tangents y with the sign -1.
        const DATA: &str = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAACAvwAAAD8AAABAAAAAAAAAgD8AAMA/AABA\
                           QAAAAL8AAIA+AAAAAAAAAAAAAIA/AAAAAAAAAAAAAIA/AAAAAAAAAAAAAIA/AAAAAAAAgD8AAAAAAACAvwAA\
                           AAAAAIA/AAAAAAAAgL8AAAAAAACAPwAAAAAAAIC/";
        let views = [(0, 36), (36, 36), (72, 36), (108, 48)].map(|(offset, length)| {
            format!("{{ \"buffer\": 0, \"byteOffset\": {offset}, \"byteLength\": {length} }}")
        });
        let accessors = [(0, "VEC3"), (1, "VEC3"), (2, "VEC3"), (3, "VEC4")].map(|(view, kind)| {
            format!(
                "{{ \"bufferView\": {view}, \"componentType\": 5126, \"count\": 3, \"type\": \"{kind}\" }}"
            )
        });
        let file = format!(
            r#"{{ "asset": {{ "version": "2.0" }}, "meshes": [{{ "primitives": [{{ "attributes":
                {{ "POSITION": 0, "COLOR_0": 1, "NORMAL": 2, "TANGENT": 3 }} }}] }}],
                "accessors": [{}], "bufferViews": [{}], "buffers": [{{ "byteLength": 156,
                "uri": "data:;base64,{DATA}" }}] }}"#,
            accessors.join(", "),
            views.join(", ")
        );
        let attributes = |file: &str| {
            let keys = "tangents = true\nvertex_colors = true";
            let LoweredShape::Triangles(mesh) = load("m.gltf", file.as_bytes(), keys).0.unwrap() else {
                panic!("a mesh is triangles")
            };
            mesh.attributes.unwrap()
        };
        let all = attributes(&file);
        assert_eq!(
            all.colors,
            [[0.0, 0.5, 1.0, 1.0], [0.0, 1.0, 1.0, 1.0], [1.0, 0.0, 0.25, 1.0]]
        );
        assert_eq!(all.tangents, [whitstone_core::DVec3::Y; 3]);
        assert_eq!(all.handedness, [-1.0]);
        // Computed from texture coordinates, of which there are none.
        let ignored = attributes(&file.replace("\"NORMAL\": 2, ", ""));
        assert_eq!(ignored.tangents, [whitstone_core::DVec3::ZERO; 3]);
        assert_eq!(ignored.handedness, [1.0]);
    }

    #[test]
    fn flat_shading_forgets_the_normals_and_flat_triangles_are_told() {
        let (shape, context) = load("b.obj", SMALL.as_bytes(), "shading = \"flat\"");
        let Ok(LoweredShape::Triangles(mesh)) = shape else {
            panic!("a mesh is triangles")
        };
        assert!(mesh.normals.is_empty());
        assert_eq!(mesh.triangles.len(), 5);
        let warning = &context.warnings[0];
        assert_eq!(
            warning.message,
            "b.obj: 1 of 5 triangles have no area and are never hit"
        );
        assert_eq!(warning.span, Some(7..14));
    }

    #[test]
    fn subdivided_meshes_are_shapes_as_others_and_know_their_size_before() {
        let more = "subdivision = { scheme = \"loop\", levels = 2 }";
        let (shape, context) = load("h.obj", SMALL.as_bytes(), more);
        let Ok(LoweredShape::Triangles(mesh)) = shape else {
            panic!("a mesh is triangles")
        };
        // The degenerate triangle is removed before subdivision.
        assert_eq!(mesh.triangles.len(), 4 * 16);
        assert_eq!(mesh.normals.len(), mesh.positions.len());
        assert!(context.warnings.is_empty());
        shape_laws(LoweredShape::Triangles(mesh), 4_000);
        // 8 levels of 4094 triangles are too many.
        let fan: String = (0..2049).map(|k| format!("v {k} {} 0\n", k * k)).collect();
        let faces: String = (2..2049).map(|k| format!("f 1 {k} {}\n", k + 1)).collect();
        let file = format!("{fan}{faces}{faces}");
        let more = "subdivision = { scheme = \"loop\", levels = 8 }";
        let errors = load("i.obj", file.as_bytes(), more).0.err().unwrap();
        assert_eq!(
            errors.0[0].message,
            "8 levels make 268304384 triangles, more than 134217728"
        );
        let point = load("j.obj", b"v 0 0 0\nv 0 0 0\nv 1 0 0\nf 1 2 3\n", more)
            .0
            .err()
            .unwrap();
        assert!(point.0[0].message.contains("all triangles are degenerate"));
        for wrong in [
            "{ scheme = \"butterfly\", levels = 1 }",
            "{ scheme = \"loop\", levels = 9 }",
            "2",
        ] {
            let more = format!("subdivision = {wrong}");
            assert!(load("k.obj", SMALL.as_bytes(), &more).0.is_err(), "{wrong}");
        }
    }

    #[test]
    fn what_is_wrong_with_a_file_is_told_at_its_name() {
        let error = fails("c.obj", b"v 0 0 0\nv 1 x 0\n");
        assert_eq!(
            error.message,
            "c.obj, line 2: expected a finite number, found \"x\""
        );
        assert_eq!(error.span, Some(7..14));
        assert!(fails("d.obj", b"").message.contains("it is empty"));
        assert!(
            fails("d.obj", b"# nothing\n")
                .message
                .contains("at least one face, found none")
        );
        assert!(fails("e.ply", b"").message.starts_with("e.ply"));
        assert!(fails("f.off", b"OFF").message.contains("ends in .obj, .ply"));
        let far = "v 0 0 0\nv 1e308 0 0\nv 0 1 0\nf 1 2 3\n";
        let folder = scratch("g.obj", far.as_bytes());
        let huge = Transform::new(whitstone_core::DAffine3::from_scale(
            whitstone_core::DVec3::splat(100.0),
        ));
        let mut context = TestContext::in_folder(&folder);
        let result = build_in::<Shapes, Mesh>("file = \"g.obj\"", huge.unwrap(), &mut context);
        assert!(
            result.err().unwrap().0[0]
                .message
                .contains("out of the range of double precision")
        );
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
