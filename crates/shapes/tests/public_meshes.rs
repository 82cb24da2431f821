//! Tests with third-party meshes, read from `meshes/` in the folder that `WHITSTONE_TEST_DATA`
//! names. Tests whose files are absent print "skipped".

use std::io::Write as _;
use std::path::{Path, PathBuf};
use whitstone_core::{LoweredShape, Shapes, Transform, TriangleMesh};
use whitstone_shapes::mesh::Mesh;
use whitstone_testkit::{TestContext, build_in};

fn folder() -> Option<PathBuf> {
    let folder = std::env::var_os("WHITSTONE_TEST_DATA")
        .filter(|data| !data.is_empty())
        .map(|data| Path::new(&data).join("meshes"));
    let folder = folder.filter(|folder| folder.is_dir());
    if folder.is_none() {
        let _ = writeln!(
            std::io::stderr(),
            "skipped: WHITSTONE_TEST_DATA names no folder with meshes"
        );
    }
    folder
}

fn load(folder: &Path, name: &str) -> Result<(TriangleMesh, usize), String> {
    let mut context = TestContext::in_folder(folder);
    let text = format!("file = \"{name}\"");
    match build_in::<Shapes, Mesh>(&text, Transform::IDENTITY, &mut context) {
        Ok(LoweredShape::Triangles(mesh)) => Ok((mesh, context.warnings.len())),
        Ok(_) => Err("not triangles".to_owned()),
        Err(errors) => Err(errors.to_string()),
    }
}

#[test]
fn well_known_meshes_have_as_many_triangles_as_they_are_said_to() {
    let Some(folder) = folder() else { return };
    for (name, triangles, normals, uvs) in [
        ("stanford_bunny_69k.ply", 69_451, false, false),
        ("stanford_bunny_7k.ply", 6_966, false, false),
        ("stanford_armadillo_86k.ply", 86_482, false, false),
        ("teapot.obj", 15_704, false, true),
        ("pirate.obj", 5_010, true, true),
    ] {
        if !folder.join(name).is_file() {
            let _ = writeln!(std::io::stderr(), "skipped: {name} is not there");
            continue;
        }
        let (mesh, warnings) = load(&folder, name).unwrap();
        println!("{name}: {} positions, {warnings} warnings", mesh.positions.len());
        assert_eq!(mesh.triangles.len(), triangles, "{name}");
        assert_eq!(
            (!mesh.normals.is_empty(), !mesh.uvs.is_empty()),
            (normals, uvs),
            "{name}"
        );
        assert!(mesh.positions.iter().all(|p| p.is_finite()));
    }
}

#[test]
fn odd_files_load_or_are_told_to_be_wrong() {
    let Some(folder) = folder() else { return };
    for kind in ["obj_edge_cases_tobj", "primitives"] {
        let Ok(entries) = std::fs::read_dir(folder.join(kind)) else {
            let _ = writeln!(std::io::stderr(), "skipped: {kind} is not there");
            continue;
        };
        let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        for path in paths
            .iter()
            .filter(|path| path.extension().is_some_and(|e| e == "obj" || e == "ply"))
        {
            let name = format!("{kind}/{}", path.file_name().unwrap().to_str().unwrap());
            match load(&folder, &name) {
                Ok((mesh, _)) => println!("{name}: {} triangles", mesh.triangles.len()),
                Err(error) => println!("{error}"),
            }
        }
    }
}
