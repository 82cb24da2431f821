use super::{Mesh, read};
use crate::Oracle;
use crate::testing::{base64, shows};
use crate::tracer::Tracer;
use std::path::Path;
use whitstone_core::SceneErrors;
use whitstone_core::config::decode;
use whitstone_scene::{Description, Sources};

fn described<T>(text: &str, files: &[(&str, &[u8])], of: impl FnOnce(&Description<'_>) -> T) -> T {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    let look = "look_at = { origin = [0, 0, 9], target = [0, 0, 0] }";
    let text = format!("[camera]\ntype = \"perspective\"\n{look}\n[[shape]]\ntype = \"mesh\"\n{text}");
    let sources = Sources::from_text("scene.toml", &text, Path::new(folder.path()), &[]).unwrap();
    of(&Description::parse(&sources).into_result().unwrap())
}

fn first(errors: SceneErrors) -> String {
    errors.0[0].message.clone()
}

/// The errors of the oracle and of its tracer for a mesh with these keys.
fn refusals(keys: &str, files: &[(&str, &[u8])]) -> [Option<String>; 2] {
    described(keys, files, |description| {
        [
            Oracle::new(description, 0).err().map(first),
            Tracer::new(description).err().map(first),
        ]
    })
}

/// The mesh with these keys.
fn mesh(keys: &str, files: &[(&str, &[u8])]) -> Result<Mesh, String> {
    described(keys, files, |description| {
        let config = decode(&description.shapes[0].plugin.table).map_err(first)?;
        read(description, &config).map_err(first)
    })
}

const TRIANGLE: &[u8] = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

#[test]
fn faces_of_an_obj_name_what_all_their_corners_name_and_may_come_first() {
    let text = b"\xef\xbb\xbff 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 1 1\nvt 0.5 0.5\n\
        f 1/1/1 2/1/1 3/1/1 1/1\nf 1/1/1 2//1 3/1/1\n";
    let found = mesh("file = \"m.obj\"", &[("m.obj", text)]).unwrap();
    assert_eq!(found.triangles[0], [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let has_normals: Vec<bool> = found.normals.iter().map(Option::is_some).collect();
    assert_eq!(has_normals, [false, false, false, true]);
    let has_uvs: Vec<bool> = found.uvs.iter().map(Option::is_some).collect();
    assert_eq!(has_uvs, [false, true, true, false]);
    for wrong in ["f 1 2 4\n", "f 1 2 0\n", "f 1 2 -1\n", "f 1//2 2 3\n"] {
        let text = [wrong.as_bytes(), TRIANGLE].concat();
        assert!(mesh("file = \"m.obj\"", &[("m.obj", &text)]).is_err(), "{wrong}");
    }
}

#[test]
fn unsupported_files_and_keys_are_refused() {
    let names = ["m.obj", "m.OBJ", "m.xyz", "m.glb", "m.gltf", "m.stl"];
    let files = names.map(|name| (name, TRIANGLE));
    for name in &names[..2] {
        assert_eq!(refusals(&format!("file = \"{name}\""), &files), [None, None]);
    }
    for name in &names[2..] {
        for refusal in refusals(&format!("file = \"{name}\""), &files) {
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
        "displacement = { scale = 1 }",
        "primitive = 0",
        "weights = [1]",
        "uv_sets = [1]",
        "part = \"absent\"",
        "tangents = true\nsubdivision = { scheme = \"loop\", levels = 1 }",
    ] {
        let keys = format!("file = \"m.obj\"\n{keys}");
        assert!(refusals(&keys, &files).iter().all(Option::is_some), "{keys}");
    }
    let operand = "{ type = \"mesh\", file = \"m.obj\", vertex_colors = true }";
    let csg = format!(
        "file = \"m.obj\"\n[[shape]]\ntype = \"csg\"\noperation = \"union\"\n\
        operands = [{operand}, {{ type = \"box\" }}]"
    );
    assert!(refusals(&csg, &files)[1].is_some());
}

/// The vector (0.5, -0.25, 1), twice, along the axes of the object and of the surface.
#[test]
fn vectors_displace() {
    let files = [("m.obj", TRIANGLE)];
    let first = |more: &str| {
        let keys =
            format!("file = \"m.obj\"\ndisplacement = {{ vector_map = [0.75, 0.375, 1], scale = 2{more} }}");
        mesh(&keys, &files).unwrap().triangles[0][0]
    };
    assert_eq!(first(""), [1.0, -0.5, 2.0]);
    assert_eq!(first(", space = \"tangent\""), [1.0, -0.5, 2.0]);
    // The tangent is y, the bitangent -x.
    let along = first(", space = \"tangent\", tangent = [0, 3, 4]");
    assert_eq!(along, [0.5, 1.0, 2.0]);
    assert_eq!(first(", space = \"tangent\", axis = [-2, 0, 0]"), along);
    // Around the normal there is none.
    assert_eq!(first(", space = \"tangent\", axis = [0, 0, 1]"), [0.0; 3]);
}

#[test]
fn parts_and_colors_of_obj() {
    let text = b"v 0 0 0 1 0 0.5\nv 1 0 0 0 1 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\n\
        usemtl  a b \nf 2 4 3\nusemtl c\nf 1 2 4\nusemtl a b\nf 1 4 3\n";
    let files = [("m.obj", &text[..])];
    let triangles =
        |keys: &str| mesh(&format!("file = \"m.obj\"\n{keys}"), &files).map(|mesh| mesh.triangles);
    let all = triangles("").unwrap();
    assert_eq!(all.len(), 4);
    assert_eq!(triangles("part = \"a b\"").unwrap(), [all[1], all[3]]);
    assert_eq!(triangles("part = \"\"").unwrap(), [all[0]]);
    assert!(triangles("part = \"a\"").is_err());
    let colored = mesh("file = \"m.obj\"\nvertex_colors = true", &files).unwrap();
    let expected = [[1.0, 0.0, 0.5, 1.0], [0.0, 1.0, 0.0, 1.0], [1.0; 4]];
    assert_eq!(colored.colors(0), Some(expected));
    assert!(mesh("file = \"m.obj\"", &files).unwrap().is_plain());
    let weighted = [("m.obj", &b"v 0 0 0 1\nv 1 0 0 1\nv 0 1 0 1\nf 1 2 3\n"[..])];
    assert!(mesh("file = \"m.obj\"\nvertex_colors = true", &weighted).is_err());
}

#[test]
fn parts_that_are_not_utf_8_are_latin_1() {
    let text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl gr\xfcn\nf 1 2 3\nusemtl gr\xe0\nf 2 3 1\nf 3 1 2\n\
        usemtl \xc3\xa0\nf 1 2 3\n";
    let files = [("m.obj", &text[..])];
    for (part, count) in [("gr\u{fc}n", 1), ("gr\u{e0}", 2), ("\u{e0}", 1)] {
        let mesh = mesh(&format!("file = \"m.obj\"\npart = \"{part}\""), &files).unwrap();
        assert_eq!(mesh.triangles.len(), count, "{part}");
    }
}

#[test]
fn colors_of_ply() {
    let text = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nproperty uchar red\nproperty ushort green\nproperty float alpha\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 51 65535 0.5\n1 0 0 255 0 1\n0 1 0 0 0 0\n3 0 1 2\n";
    let colored = mesh("file = \"m.ply\"\nvertex_colors = true", &[("m.ply", text)]).unwrap();
    let expected = [[0.2, 1.0, 1.0, 0.5], [1.0, 0.0, 1.0, 1.0], [0.0, 0.0, 1.0, 0.0]];
    assert_eq!(colored.colors(0), Some(expected));
}

#[test]
fn lists_of_vertices_of_ply_are_skipped() {
    let text = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n\
        property list uchar uchar red\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 0\n1 2 7 8 0 0\n0 1 7 1 0\n3 0 1 2\n";
    let found = mesh("file = \"m.ply\"\nvertex_colors = true", &[("m.ply", text)]).unwrap();
    assert_eq!(found.triangles, [[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]);
    assert_eq!(found.colors(0), Some([[1.0; 4]; 3]));
}

#[test]
fn stl_in_both_forms() {
    let text = b"solid vertex of a cube\n facet normal 1 1 1\n  outer loop\n   vertex 0 0 0.5\n\
           vertex 1e0 0 0.5\n   VERTEX 0 1 0.5\n  endloop\n endfacet\nendsolid\n";
    let mut binary = b"solid but binary".to_vec();
    binary.resize(80, 0);
    binary.extend_from_slice(&1_u32.to_le_bytes());
    let numbers = [9.0, 9.0, 9.0, 0.0, 0.0, 0.5, 1.0, 0.0, 0.5, 0.0, 1.0, 0.5_f32];
    binary.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
    binary.extend_from_slice(&[0, 0]);
    let ends = [&b"\n"[..], b"\r\n", b"\r", b" "];
    let texts = ends.map(|end| {
        let lines = text.split(|byte| *byte == b'\n').skip(1);
        [
            &b"solid a cube"[..],
            &lines.flat_map(|line| [end, line].concat()).collect::<Vec<_>>(),
        ]
        .concat()
    });
    for bytes in texts.iter().map(Vec::as_slice).chain([&text[..], &binary]) {
        let mesh = mesh("file = \"m.stl\"", &[("m.stl", bytes)]).unwrap();
        assert_eq!(
            mesh.triangles,
            [[[0.0, 0.0, 0.5], [1.0, 0.0, 0.5], [0.0, 1.0, 0.5]]]
        );
        assert_eq!(mesh.normals, [None]);
    }
    assert!(mesh("file = \"m.stl\"", &[("m.stl", &binary[..100])]).is_err());
}

/// Builds a glTF file with one buffer.
#[derive(Default)]
struct Builder {
    bytes: Vec<u8>,
    views: Vec<String>,
    accessors: Vec<String>,
}

impl Builder {
    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.push(format!(
            r#"{{ "buffer": 0, "byteOffset": {}, "byteLength": {} }}"#,
            self.bytes.len(),
            bytes.len()
        ));
        self.bytes.extend_from_slice(bytes);
        self.views.len() - 1
    }

    fn accessor(&mut self, text: String) -> usize {
        self.accessors.push(text);
        self.accessors.len() - 1
    }

    /// An accessor of floats.
    fn floats<const N: usize>(&mut self, all: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = all.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes);
        let kind = match N {
            1 => "SCALAR",
            2 => "VEC2",
            3 => "VEC3",
            4 => "VEC4",
            _ => "MAT4",
        };
        self.accessor(format!(
            r#"{{ "bufferView": {view}, "componentType": 5126, "count": {}, "type": "{kind}" }}"#,
            all.len()
        ))
    }

    /// An accessor of bytes.
    fn codes<const N: usize>(&mut self, all: &[[u8; N]], kind: &str, more: &str) -> usize {
        let view = self.view(all.as_flattened());
        self.accessor(format!(
            r#"{{ "bufferView": {view}, "componentType": 5121, "count": {}, "type": "{kind}"{more} }}"#,
            all.len()
        ))
    }

    /// The text of a file with these further lists.
    fn file(&self, lists: &str) -> String {
        format!(
            r#"{{ "asset": {{ "version": "2.0" }}, "buffers": [{{ "byteLength": {},
                "uri": "data:application/octet-stream;base64,{}" }}],
                "bufferViews": [{}], "accessors": [{}], {lists} }}"#,
            self.bytes.len(),
            base64(&self.bytes),
            self.views.join(","),
            self.accessors.join(",")
        )
    }
}

/// The mesh of a glTF file.
fn of(file: &str, keys: &str) -> Result<Mesh, String> {
    mesh(
        &format!("file = \"m.gltf\"\n{keys}"),
        &[("m.gltf", file.as_bytes())],
    )
}

/// The corners of a square, and one point.
const POINTS: [[f32; 3]; 5] = [
    [0.0, 0.0, 0.0],
    [1.0, 0.0, 0.0],
    [1.0, 1.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.5, 0.5, 1.0],
];

fn point(number: usize) -> [f64; 3] {
    POINTS[number].map(f64::from)
}

/// A file with one primitive of the points.
fn points(primitive: &str) -> String {
    let mut builder = Builder::default();
    builder.floats(&POINTS);
    builder.codes(&[[0], [1], [2], [0], [2], [3]], "SCALAR", "");
    let attributes = r#""attributes": { "POSITION": 0 }"#;
    builder.file(&format!(
        r#""meshes": [{{ "primitives": [{{ {attributes}{primitive} }}] }}]"#
    ))
}

#[test]
fn modes_of_gltf() {
    let corners = |primitive: &str| {
        let mesh = of(&points(primitive), "")?;
        let of = |three: &[usize; 3]| three.map(point);
        let placed: Vec<_> = mesh.vertices.iter().map(of).collect();
        assert_eq!(mesh.triangles, placed);
        Ok::<_, String>(mesh.vertices)
    };
    let indices = r#", "indices": 1"#;
    assert_eq!(corners(indices).unwrap(), [[0, 1, 2], [0, 2, 3]]);
    let strip = [[0, 1, 2], [1, 3, 2], [2, 3, 4]];
    assert_eq!(corners(r#", "mode": 5"#).unwrap(), strip);
    let fan = [[1, 2, 0], [2, 3, 0], [3, 4, 0]];
    assert_eq!(corners(r#", "mode": 6"#).unwrap(), fan);
    let strip = r#", "mode": 5, "indices": 1"#;
    assert_eq!(
        corners(strip).unwrap(),
        [[0, 1, 2], [1, 0, 2], [2, 0, 2], [0, 3, 2]]
    );
    // Five vertices are no whole number of triangles.
    assert!(corners("").is_err());
    assert!(corners(r#", "mode": 1"#).is_err());
    assert!(corners(r#", "indices": 9"#).is_err());
    assert!(corners(r#", "indices": 0"#).is_err());
    assert!(of(&points(indices), "mesh = 1").is_err());
    assert!(of(&points(indices), "primitive = 1").is_err());
}

#[test]
fn attributes_of_gltf() {
    let mut builder = Builder::default();
    builder.floats(&POINTS[..3]);
    builder.floats(&[[0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 2.0]]);
    builder.floats(&[[0.25, 0.0], [0.5, 0.25], [0.0, 1.0]]);
    builder.codes(
        &[[0, 255, 0, 0], [255, 0, 0, 0], [0, 0, 0, 0]],
        "VEC2",
        r#", "normalized": true"#,
    );
    builder.codes(
        &[[51, 0, 255], [0, 0, 0], [255, 255, 255]],
        "VEC3",
        r#", "normalized": true"#,
    );
    // Four bytes for each pair of numbers, and three numbers for each colour.
    builder.views[3] = builder.views[3].replace(" }", r#", "byteStride": 4 }"#);
    let file = builder.file(
        r#""meshes": [{ "primitives": [] }, { "primitives": [{ "attributes": { "POSITION": 0,
            "NORMAL": 1, "TEXCOORD_0": 2, "TEXCOORD_3": 3, "COLOR_0": 4 } }] }]"#,
    );
    assert!(of(&file, "").is_err());
    let mesh = |keys: &str| of(&file, &format!("mesh = 1\n{keys}")).unwrap();
    let plain = mesh("");
    assert_eq!(plain.triangles, [[point(0), point(1), point(2)]]);
    let normals = [[0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 2.0]];
    assert_eq!(plain.normals, [Some(normals)]);
    let set_0 = Some([[0.25, 1.0], [0.5, 0.75], [0.0, 0.0]]);
    let set_3 = Some([[0.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
    assert_eq!(
        (plain.uvs[0], plain.seconds(0), plain.colors(0)),
        (set_0, None, None)
    );
    let both = mesh("uv_sets = [3, 0]\nvertex_colors = true");
    assert_eq!((both.uvs[0], both.seconds(0)), (set_3, set_0));
    let colors = [[0.2, 0.0, 1.0, 1.0], [0.0, 0.0, 0.0, 1.0], [1.0; 4]];
    assert_eq!(both.colors(0), Some(colors));
    assert_eq!(mesh("uv_sets = []").uvs, [None]);
    assert_eq!(mesh("uv_sets = [1]").uvs, [None]);
    assert_eq!(mesh("shading = \"flat\"").normals, [None]);
}

#[test]
fn sparse_and_signed_accessors() {
    let mut builder = Builder::default();
    let indices = builder.view(&[1, 0, 2, 0]);
    let values: Vec<u8> = [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0_f32]]
        .iter()
        .flatten()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    let values = builder.view(&values);
    builder.accessor(format!(
        r#"{{ "componentType": 5126, "count": 3, "type": "VEC3", "sparse": {{ "count": 2,
            "indices": {{ "bufferView": {indices}, "componentType": 5123 }},
            "values": {{ "bufferView": {values} }} }} }}"#
    ));
    // -128, 127 and 0 in three bytes, the fourth one unused.
    let normals = builder.view(&[0x80, 0x7f, 0, 9, 0x80, 0x7f, 0, 9, 0x80, 0x7f, 0]);
    builder.views[normals] = builder.views[normals].replace(" }", r#", "byteStride": 4 }"#);
    builder.accessor(format!(
        r#"{{ "bufferView": {normals}, "componentType": 5120, "count": 3, "type": "VEC3",
            "normalized": true }}"#
    ));
    let lists = r#""meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "NORMAL": 1 } }] }]"#;
    let mesh = of(&builder.file(lists), "").unwrap();
    assert_eq!(mesh.triangles, [[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0]]]);
    assert_eq!(mesh.normals, [Some([[-1.0, 1.0, 0.0]; 3])]);
    // One byte too few; a sparse index out of range.
    let short = builder
        .file(lists)
        .replace(r#""byteLength": 11"#, r#""byteLength": 10"#);
    assert!(of(&short, "").is_err());
    builder.bytes[2] = 3;
    assert!(of(&builder.file(lists), "").is_err());
}

#[test]
fn extensions_that_change_vertices_are_refused() {
    let primitive = r#", "indices": 1"#;
    let requiring = |name: &str| {
        let file = points(primitive);
        file.replacen('{', &format!(r#"{{ "extensionsRequired": ["{name}"], "#), 1)
    };
    assert!(of(&requiring("KHR_draco_mesh_compression"), "").is_err());
    assert!(of(&requiring("EXT_meshopt_compression"), "").is_err());
    assert!(of(&requiring("KHR_mesh_quantization"), "").is_ok());
}

#[test]
fn morph_targets() {
    let mut builder = Builder::default();
    builder.floats(&POINTS[..3]);
    builder.floats(&[[0.0, 0.0, 1.0]; 3]);
    builder.floats(&[[0.0, 0.0, 4.0], [0.0; 3], [0.0; 3]]);
    builder.floats(&[[2.0, 0.0, 0.0]; 3]);
    let file = builder.file(
        r#""meshes": [{ "weights": [0.25], "primitives": [{ "attributes": { "POSITION": 0,
            "NORMAL": 1 }, "targets": [{ "POSITION": 2 }, { "POSITION": 3, "NORMAL": 2 }] }] }]"#,
    );
    let first = |keys: &str| {
        let mesh = of(&file, keys).unwrap();
        (mesh.triangles[0][0], mesh.normals[0].unwrap()[0])
    };
    assert_eq!(first(""), ([0.0, 0.0, 1.0], [0.0, 0.0, 1.0]));
    assert_eq!(first("weights = []"), ([0.0; 3], [0.0, 0.0, 1.0]));
    assert_eq!(first("weights = [0.5, -1]"), ([-2.0, 0.0, 2.0], [0.0, 0.0, -3.0]));
}

#[test]
fn skins() {
    let mut builder = Builder::default();
    builder.floats(&POINTS[..3]);
    builder.floats(&[[1.0, 0.0, 1.0]; 3]);
    builder.codes(&[[0, 1, 0, 0]; 3], "VEC4", "");
    builder.floats(&[[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.25, 0.75, 0.0, 0.0]]);
    let columns = |moved: [f32; 3]| {
        let [x, y, z] = moved;
        [
            1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, x, y, z, 1.0,
        ]
    };
    builder.floats(&[columns([0.0; 3]), columns([-1.0, 0.0, 0.0])]);
    // Node 2 turns +x to +y and doubles +x, below node 0, which moves by 10 along z.
    let file = builder.file(
        r#""meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "NORMAL": 1,
            "JOINTS_0": 2, "WEIGHTS_0": 3 } }] }],
            "nodes": [{ "translation": [0, 0, 10], "children": [1, 2] },
                { "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 3, 0, 0, 1] },
                { "rotation": [0, 0, 0.7071067811865476, 0.7071067811865476], "scale": [2, 1, 1] }],
            "skins": [{ "joints": [1, 2], "inverseBindMatrices": 4 }, { "joints": [0] }]"#,
    );
    let skinned = of(&file, "skin = 0").unwrap();
    let near = |found: [f64; 3], expected: [f64; 3]| {
        let far = (0..3).any(|k| (found[k] - expected[k]).abs() > 1e-12);
        assert!(!far, "{found:?} instead of {expected:?}");
    };
    // Joint 0 moves by (3, 0, 10). Joint 1 moves by -1 along x first.
    near(skinned.triangles[0][0], [3.0, 0.0, 10.0]);
    near(skinned.triangles[0][1], [0.0, 0.0, 10.0]);
    // (1, 1, 0) goes to (4, 1, 10) and to (-1, 0, 10).
    near(skinned.triangles[0][2], [0.25, 0.25, 10.0]);
    let normals = skinned.normals[0].unwrap();
    near(normals[0], [1.0, 0.0, 1.0]);
    // Half along x, which becomes y.
    near(normals[1], [0.0, 0.5, 1.0]);
    // M has the columns (0.25, 1.5, 0), (-0.75, 0.25, 0) and (0, 0, 1), and its determinant is
    // 0.0625 + 1.125.
    near(normals[2], [0.25 / 1.1875, 0.75 / 1.1875, 1.0]);
    // Skin 1 has one joint only, and there is no skin 2.
    assert!(of(&file, "skin = 1").is_err());
    assert!(of(&file, "skin = 2").is_err());
    let flat = file.replace(r#""scale": [2, 1, 1]"#, r#""scale": [0, 0, 0]"#);
    let flat = of(&flat, "skin = 0").unwrap();
    assert_eq!(flat.normals[0].unwrap()[1], [0.0; 3]);
    let cyclic = file.replace(r#""scale": [2, 1, 1]"#, r#""children": [0]"#);
    assert!(of(&cyclic, "skin = 0").is_err());
}

#[test]
fn tangents_of_gltf() {
    let mut builder = Builder::default();
    builder.floats(&POINTS[..3]);
    builder.floats(&[[0.0, 2.0, 0.0, -1.0], [1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 0.0]]);
    builder.codes(&[[1], [2], [0]], "SCALAR", "");
    builder.floats(&[[0.0, 0.0, 3.0]; 3]);
    let primitive =
        r#""attributes": { "POSITION": 0, "NORMAL": 3, "TANGENT": 1 }, "targets": [{ "TANGENT": 3 }]"#;
    let file = builder.file(&format!(
        r#""meshes": [{{ "primitives": [{{ {primitive} }}, {{ {primitive}, "indices": 2 }}] }}]"#
    ));
    assert_eq!(of(&file, "").unwrap().tangents(0), None);
    let given = of(&file, "tangents = true").unwrap().tangents(0);
    let along = [[0.0, 2.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    assert_eq!(given, Some((along, -1.0)));
    let turned = of(&file, "tangents = true\nprimitive = 1\nweights = [1]").unwrap();
    let moved = [[1.0, 0.0, 3.0], [0.0, 0.0, 4.0], [0.0, 2.0, 3.0]];
    assert_eq!(turned.tangents(0), Some((moved, 1.0)));
    // Without normals they are computed: here there are no texture coordinates.
    let ignored = of(&file.replace(r#""NORMAL": 3, "#, ""), "tangents = true").unwrap();
    assert_eq!(ignored.tangents(0), Some(([[0.0; 3]; 3], 1.0)));
}

#[test]
fn colors_of_gltf_are_limited() {
    let mut builder = Builder::default();
    builder.floats(&POINTS[..3]);
    builder.floats(&[[-1.0, 0.5, 2.0], [0.0, 1.0, 1.5], [3.0, -0.5, 0.25]]);
    let file =
        builder.file(r#""meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "COLOR_0": 1 } }] }]"#);
    let found = of(&file, "vertex_colors = true").unwrap().colors(0);
    let limited = [[0.0, 0.5, 1.0, 1.0], [0.0, 1.0, 1.0, 1.0], [1.0, 0.0, 0.25, 1.0]];
    assert_eq!(found, Some(limited));
    // A byte order mark is no text.
    assert!(of(&format!("\u{feff}{file}"), "").is_ok());
}

#[test]
fn computed_tangents() {
    // Two triangles of a square, the second with a mirrored and turned texture.
    let text = b"v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
        f 1/1 2/2 3/3\nf 1/1 3/3 4/2\nf 1 2 3\n";
    let files = [("m.obj", &text[..])];
    let found = mesh("file = \"m.obj\"\ntangents = true", &files).unwrap();
    // The first has its u along x. The second: uv (0, 0), (1, 1), (1, 0) at (0, 0), (4, 4),
    // (0, 4): D = -1 and T = (0 (4, 4) - 1 (0, 4)) (-1) = (0, 4).
    let (x, y) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
    let both = [1.0, 1.0, 0.0];
    assert_eq!(found.tangents(0), Some(([both, x, both], 1.0)));
    assert_eq!(found.tangents(1), Some(([both, both, y], -1.0)));
    // A face without texture coordinates, whose vertices are others.
    assert_eq!(found.tangents(2), Some(([[0.0; 3]; 3], 1.0)));
    let none = mesh("file = \"m.obj\"\ntangents = true\nuv_sets = []", &files).unwrap();
    assert_eq!(none.tangents(0), Some(([[0.0; 3]; 3], 1.0)));
    // Texture coordinates in a line, exactly and up to rounding.
    let line = |coordinates: &str| {
        let text = format!("v 0 0 0\nv 4 0 0\nv 4 4 0\n{coordinates}\nf 1/1 2/2 3/3\n");
        mesh("file = \"m.obj\"\ntangents = true", &[("m.obj", text.as_bytes())])
    };
    let exact = line("vt 0 0\nvt 0.1 0.3\nvt 0.2 0.6").unwrap();
    assert_eq!(exact.tangents(0), Some(([[0.0; 3]; 3], 1.0)));
    assert!(line("vt 1e-17 1e-17\nvt 0.5 0.5\nvt 1 1").is_err());
}

/// Two triangles that fill a square from -1 to 1, with the colours red, green, blue and white with
/// an alpha of 0, and two sets of texture coordinates.
fn square() -> String {
    let mut builder = Builder::default();
    builder.floats(&[
        [-1.0, -1.0, 0.0],
        [1.0, -1.0, 0.0],
        [1.0, 1.0, 0.0],
        [-1.0, 1.0, 0.0],
    ]);
    builder.codes(&[[0], [1], [2], [0], [2], [3]], "SCALAR", "");
    builder.floats(&[
        [1.0, 0.0, 0.0, 1.0],
        [0.0, 1.0, 0.0, 1.0],
        [0.0, 0.0, 1.0, 1.0],
        [1.0, 1.0, 1.0, 0.0],
    ]);
    builder.floats(&[[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]);
    builder.floats(&[[0.5, 1.0], [0.5, 1.0], [1.0, 0.0], [1.0, 0.0]]);
    builder.file(
        r#""meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "COLOR_0": 2,
            "TEXCOORD_0": 3, "TEXCOORD_1": 4 }, "indices": 1 }] }]"#,
    )
}

/// The square with these keys and this material.
fn shown(keys: &str, material: &str) -> String {
    format!("[[shape]]\ntype = \"mesh\"\nfile = \"m.gltf\"\n{keys}\nmaterial = {material}\n")
}

#[test]
fn attributes_in_pixels() {
    let file = square();
    let files = [("m.gltf", file.as_bytes())];
    let at = [0.5, 0.25];
    // In the first triangle: the barycentric coordinates are 1/4, 1/8 and 5/8.
    let matte = |texture: &str| format!("{{ type = \"matte\", reflectance = {texture} }}");
    let color = matte("{ type = \"vertex_color\" }");
    shows(
        at,
        &shown("vertex_colors = true", &color),
        &files,
        [0.25, 0.125, 0.625],
    );
    shows(at, &shown("", &color), &files, [1.0; 3]);
    // In the second one: 3/8 red, 1/4 blue and 3/8 white, with an alpha of 0.
    let alpha = matte("{ type = \"vertex_color\", channel = \"alpha\" }");
    shows(
        [-0.5, 0.25],
        &shown("vertex_colors = true", &alpha),
        &files,
        [0.625; 3],
    );
    // (u, v) is ((x + 1)/2, (y + 1)/2), and u of the second set (y + 3)/4.
    let ramp = |mapping: &str| {
        matte(&format!(
            "{{ type = \"gradient\", a = 0, b = 1, mapping = {{ projection = \"uv\"{mapping} }} }}"
        ))
    };
    shows(at, &shown("", &ramp("")), &files, [0.75; 3]);
    shows(at, &shown("uv_sets = [0, 1]", &ramp("")), &files, [0.75; 3]);
    shows(
        at,
        &shown("uv_sets = [0, 1]", &ramp(", uv_set = 1")),
        &files,
        [0.8125; 3],
    );
    shows(at, &shown("uv_sets = [1]", &ramp("")), &files, [0.8125; 3]);
    shows(at, &shown("", &ramp(", uv_set = 1")), &files, [0.0; 3]);
    let image = ramp(", uv_set = 2");
    assert!(crate::testing::pixel(at, &shown("", &image), &files).is_err());
}

#[test]
fn mesh_tangents_in_pixels() {
    let file = square();
    let files = [("m.gltf", file.as_bytes())];
    let at = [0.5, 0.25];
    // The map tilts the normal to (0.6, 0, 0.8) or (0, 0.6, 0.8), and the light comes along x or y.
    let lit = |keys: &str, map: &str, more: &str, light: &str| {
        let material = format!(
            "{{ type = \"normal_map\", map = {map}, {more}, \
            material = {{ type = \"matte\", reflectance = 1 }} }}"
        );
        let radiance = "irradiance = 3.141592653589793";
        shown(keys, &material)
            + &format!("[[light]]\ntype = \"directional\"\ndirection = {light}\n{radiance}\n")
    };
    let (right, up) = ("[0.8, 0.5, 0.9]", "[0.5, 0.8, 0.9]");
    let mesh = "tangent = \"mesh\"";
    let (from_x, from_y) = ("[-0.8, 0, -0.6]", "[0, -0.8, -0.6]");
    // The ambient light adds 1.
    let value = |x: f64| [1.0 + x; 3];
    let with = "tangents = true";
    shows(at, &lit(with, right, mesh, from_x), &files, value(0.96));
    shows(at, &lit(with, up, mesh, from_y), &files, value(0.96));
    // Without tangents n_s stays.
    shows(at, &lit("", right, mesh, from_x), &files, value(0.6));
    // Mirrored in x, the tangent is -x and the bitangent is still y.
    let mirrored = "tangents = true\ntransform = { scale = [-1, 1, 1] }";
    shows(at, &lit(mirrored, right, mesh, from_x), &files, value(0.0));
    shows(at, &lit(mirrored, up, mesh, from_y), &files, value(0.96));
    // A tilt of 0.6 * 0.5 against 0.8.
    let half = "tangent = \"mesh\", strength = 0.5";
    let n = 0.3_f64.hypot(0.8);
    let expected = (0.3 * 0.8 + 0.8 * 0.6) / n;
    shows(at, &lit(with, right, half, from_x), &files, value(expected));
    let text = lit(with, right, "tangent = \"other\"", from_x);
    assert!(crate::testing::pixel(at, &text, &files).is_err());
}
