//! `bench import`: the speed at which mesh files are read, in megabytes a second, beside trimesh
//! and Mitsuba.

use super::machine::load;
use super::median;
use super::prepare::{generated, read_mesh};
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;
use whitstone::core::{Registry, TriangleMesh};
use whitstone::validate::Installation;
use whitstone::validate::environment::Environment;
use whitstone::{Exit, Failure};

/// Benchmark reading mesh files, interleaved with trimesh and Mitsuba where they are installed
///
/// One generated mesh is written in each format. A time is that from the path of a file to vertices
/// and triangles in memory; the file is in the cache of the operating system.
#[derive(Args, Debug)]
#[command(help_template = whitstone::commands::HELP_TEMPLATE)]
pub(super) struct Arguments {
    /// Number of rounds; each reads every file once with every program
    #[arg(long, value_name = "COUNT", default_value_t = 5)]
    rounds: usize,
    /// Folder for the files, some 300 MB
    #[arg(long, value_name = "DIR", default_value = "target/bench-import")]
    folder: PathBuf,
    /// Python with trimesh [default: that of tests/independent]
    #[arg(
        long,
        value_name = "FILE",
        default_value = "target/independent/python/bin/python"
    )]
    trimesh: PathBuf,
    /// Write the results to this file as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// A file and whether it is text.
type File = (PathBuf, bool);

/// Prints the seconds for one file, or nothing if the format is unknown to the program.
const TRIMESH: &str = "
import sys, time, trimesh
begin = time.perf_counter()
mesh = trimesh.load(sys.argv[1], force='mesh', process=False)
assert len(mesh.faces) > 0
print(time.perf_counter() - begin)
";

const MITSUBA: &str = "
import sys, time, mitsuba as mi
mi.set_variant('scalar_rgb')
kind = sys.argv[1].rsplit('.', 1)[-1]
if kind in ('ply', 'obj'):
    begin = time.perf_counter()
    mesh = mi.load_dict({'type': kind, 'filename': sys.argv[1]})
    assert mesh.face_count() > 0
    print(time.perf_counter() - begin)
";

/// Runs the command.
pub(super) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let files = write(&arguments.folder).map_err(Failure::environment)?;
    let mitsuba = Environment::existing(&Installation::default());
    let mitsuba = mitsuba.map(|environment| environment.python);
    let trimesh = arguments.trimesh.is_file().then(|| arguments.trimesh.clone());
    for (name, found) in [("trimesh", &trimesh), ("Mitsuba", &mitsuba)] {
        if found.is_none() {
            eprintln!("skipped: {name}, which is not installed");
        }
    }
    let peers = [(trimesh, TRIMESH), (mitsuba, MITSUBA)];
    println!(
        "load {:.1}; MB/s of the file: median of {} rounds",
        load(),
        arguments.rounds
    );
    println!(
        "{:<24} {:>8} {:>11} {:>11} {:>11}",
        "file", "MB", "Whitstone", "trimesh", "Mitsuba"
    );
    let mut rows = Vec::new();
    for (file, is_text) in &files {
        let megabytes = fs::metadata(file).map_err(Failure::environment)?.len() as f64 / 1e6;
        let mut seconds: [Vec<f64>; 3] = Default::default();
        for _ in 0..arguments.rounds {
            let begin = Instant::now();
            read_mesh(file, registry).map_err(Failure::environment)?;
            seconds[0].push(begin.elapsed().as_secs_f64());
            for ((python, script), seconds) in peers.iter().zip(&mut seconds[1..]) {
                if let Some(python) = python {
                    seconds.extend(peer(python, script, file)?);
                }
            }
        }
        let rates = seconds.map(|mut seconds| megabytes / median(&mut seconds));
        let show = |rate: f64| match rate.is_nan() {
            true => "–".to_owned(),
            false => format!("{rate:.0}"),
        };
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        let [ours, trimesh, mitsuba] = rates.map(show);
        println!("{name:<24} {megabytes:>8.1} {ours:>11} {trimesh:>11} {mitsuba:>11}");
        let rate = |rate: f64| if rate.is_nan() { Value::Null } else { json!(rate) };
        rows.push(json!({
            "file": name, "text": is_text, "megabytes": megabytes, "whitstone": rate(rates[0]),
            "trimesh": rate(rates[1]), "mitsuba": rate(rates[2]),
        }));
    }
    if let Some(path) = &arguments.json {
        let text = serde_json::to_string_pretty(&rows).map_err(Failure::environment)?;
        fs::write(path, text).map_err(Failure::environment)?;
    }
    Ok(Exit::Pass)
}

/// The seconds that another program needs for a file.
fn peer(python: &Path, script: &str, file: &Path) -> Result<Option<f64>, Failure> {
    let output = Command::new(python).arg("-c").arg(script).arg(file).output();
    let output = output.map_err(Failure::environment)?;
    if !output.status.success() {
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        return Err(Failure::environment(format!("{}: {told}", file.display())));
    }
    Ok(String::from_utf8_lossy(&output.stdout).trim().parse().ok())
}

/// Writes a mesh in every format.
fn write(folder: &Path) -> Result<Vec<File>, String> {
    fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mesh = generated("terrain").ok_or("no mesh is generated")?;
    let files = [
        ("terrain.ply", false, ply(&mesh)),
        ("terrain.glb", false, glb(&mesh)),
        ("terrain.stl", false, stl(&mesh)),
        ("terrain-text.ply", true, text_ply(&mesh)),
        ("terrain.obj", true, obj(&mesh)),
    ];
    let mut written = Vec::new();
    for (name, is_text, bytes) in files {
        let path = folder.join(name);
        fs::write(&path, bytes).map_err(|error| format!("{}: {error}", path.display()))?;
        written.push((path, is_text));
    }
    Ok(written)
}

fn header(mesh: &TriangleMesh, format: &str) -> String {
    format!(
        "ply\nformat {format} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.positions.len(),
        mesh.triangles.len()
    )
}

fn ply(mesh: &TriangleMesh) -> Vec<u8> {
    let mut bytes = header(mesh, "binary_little_endian").into_bytes();
    for p in &mesh.positions {
        bytes.extend(p.as_vec3().to_array().iter().flat_map(|x| x.to_le_bytes()));
    }
    for triangle in &mesh.triangles {
        bytes.push(3);
        bytes.extend(triangle.iter().flat_map(|index| index.to_le_bytes()));
    }
    bytes
}

fn text_ply(mesh: &TriangleMesh) -> Vec<u8> {
    let mut text = header(mesh, "ascii");
    for p in &mesh.positions {
        let [x, y, z] = p.as_vec3().to_array();
        let _ = writeln!(text, "{x} {y} {z}");
    }
    for [a, b, c] in &mesh.triangles {
        let _ = writeln!(text, "3 {a} {b} {c}");
    }
    text.into_bytes()
}

fn obj(mesh: &TriangleMesh) -> Vec<u8> {
    let mut text = String::new();
    for p in &mesh.positions {
        let [x, y, z] = p.as_vec3().to_array();
        let _ = writeln!(text, "v {x} {y} {z}");
    }
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|index| index + 1);
        let _ = writeln!(text, "f {a} {b} {c}");
    }
    text.into_bytes()
}

fn stl(mesh: &TriangleMesh) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((mesh.triangles.len() as u32).to_le_bytes());
    for triangle in &mesh.triangles {
        bytes.extend([0; 12]);
        for index in triangle {
            let p = mesh.positions[*index as usize].as_vec3().to_array();
            bytes.extend(p.iter().flat_map(|x| x.to_le_bytes()));
        }
        bytes.extend([0; 2]);
    }
    bytes
}

fn glb(mesh: &TriangleMesh) -> Vec<u8> {
    let positions = mesh.positions.iter().map(|p| p.as_vec3());
    let low = positions.clone().reduce(|low, p| low.min(p)).unwrap_or_default();
    let high = positions
        .clone()
        .reduce(|high, p| high.max(p))
        .unwrap_or_default();
    let mut binary: Vec<u8> = positions
        .flat_map(|p| p.to_array())
        .flat_map(f32::to_le_bytes)
        .collect();
    let start = binary.len();
    binary.extend(
        mesh.triangles
            .iter()
            .flatten()
            .flat_map(|index| index.to_le_bytes()),
    );
    let document = json!({
        "asset": { "version": "2.0" },
        "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": mesh.positions.len(), "type": "VEC3",
              "min": low.to_array(), "max": high.to_array() },
            { "bufferView": 1, "componentType": 5125, "count": 3 * mesh.triangles.len(), "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": start },
            { "buffer": 0, "byteOffset": start, "byteLength": binary.len() - start },
        ],
        "buffers": [{ "byteLength": binary.len() }],
    });
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    let whole = 12 + 8 + json.len() + 8 + binary.len();
    for (length, kind, chunk) in [(json.len(), *b"JSON", &json), (binary.len(), *b"BIN\0", &binary)] {
        if bytes.len() == 4 {
            bytes.extend([2_u32, whole as u32].iter().flat_map(|x| x.to_le_bytes()));
        }
        bytes.extend((length as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    bytes
}
