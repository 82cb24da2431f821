//! The fuzz target of scenes and meshes. The environment variable `WHITSTONE_FUZZ` names the kind
//! of file that the input is read as, by its extension; `WHITSTONE_FUZZ_FOLDER` the folder where
//! that file is written.
//!
//! An input may be refused with an error. A panic, a hang, too much memory, or an error without a
//! message or place is a finding.

#![no_main]

use libfuzzer_sys::fuzz_target;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use whitstone::core::{ImportOptions, Registry, SceneErrors};
use whitstone::render::{BuildOptions, Pipeline, RenderOptions};
use whitstone::scene::Sources;

/// Memory that a scene may take, in bytes.
const MEMORY: u64 = 256 << 20;
/// Rays that a camera ray may become, so that no image takes long.
const TREE_RAYS: u32 = 1 << 12;

/// Changes that keep images small. Where the scene has no such tables, they are errors.
const SMALL: [&str; 4] = [
    "film.width=4",
    "film.height=3",
    "film.aovs=[]",
    "sampler={ type = \"center\" }",
];

/// A scene around a mesh file.
const AROUND: &str = "[camera]\ntype = \"perspective\"\n\
    look_at = { origin = [3, 2, 4], target = [0, 0, 0] }\n\
    [[light]]\ntype = \"directional\"\ndirection = [-1, -2, -1]\nirradiance = 1\n\
    [[shape]]\ntype = \"mesh\"\n";

struct Target {
    extension: String,
    folder: PathBuf,
    registry: Registry,
}

static TARGET: LazyLock<Target> = LazyLock::new(|| {
    let extension = std::env::var("WHITSTONE_FUZZ").unwrap_or_else(|_| "toml".to_owned());
    let folder = std::env::var_os("WHITSTONE_FUZZ_FOLDER").map_or_else(std::env::temp_dir, PathBuf::from);
    fs::create_dir_all(&folder).expect("the folder for inputs can be made");
    Target {
        extension,
        folder,
        registry: whitstone::registry(),
    }
});

fuzz_target!(|data: &[u8]| {
    let target = &*TARGET;
    let file = target.folder.join(format!("input.{}", target.extension));
    fs::write(&file, data).expect("the input can be written");
    match target.extension.as_str() {
        "obj" | "ply" | "stl" => {
            let text = format!("{AROUND}file = {:?}\n", file.display().to_string());
            let sources = Sources::from_text("scene.toml", &text, &target.folder, &SMALL.map(str::to_owned));
            scene(
                sources.map_err(|error| (error.sources, error.errors)),
                &target.registry,
            );
        }
        "mtl" => {
            // An object whose materials are in the input.
            let object = target.folder.join("object.obj");
            let text = "mtllib input.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n";
            fs::write(&object, text).expect("the input can be written");
            imported(&object, target);
        }
        _ => imported(&file, target),
    }
});

/// Reads a scene file of any format.
fn imported(file: &Path, target: &Target) {
    let options = ImportOptions {
        max_memory: Some(MEMORY),
        root: Some(target.folder.clone()),
        ..ImportOptions::all()
    };
    let sources = Sources::load_with(file, &SMALL.map(str::to_owned), &target.registry, &options);
    scene(
        sources.map_err(|error| (error.sources, error.errors)),
        &target.registry,
    );
}

/// Builds and renders a scene. Errors must say something, at places inside the sources.
fn scene(sources: Result<Sources, (Sources, SceneErrors)>, registry: &Registry) {
    let options = BuildOptions {
        max_memory: Some(MEMORY),
        max_tree_rays: Some(TREE_RAYS),
        ..BuildOptions::default()
    };
    let (sources, errors) = match sources {
        Err(failed) => failed,
        Ok(sources) => match Pipeline::load(&sources, registry, options) {
            Ok(pipeline) => {
                let film = pipeline.render(RenderOptions {
                    threads: 1,
                    ..RenderOptions::default()
                });
                assert_eq!(film.rgb.len(), 12);
                return;
            }
            Err(errors) => (sources, errors),
        },
    };
    assert!(!errors.0.is_empty(), "a failure without an error");
    for error in &errors.0 {
        assert!(!error.message.is_empty(), "an error says nothing");
        if let Some(span) = &error.span {
            assert!(sources.position(span).is_some(), "no place for {span:?}: {error}");
        }
    }
    assert!(!sources.report(&errors, false).is_empty(), "the report is empty");
}
