//! `bench worst-cases`: families of geometry that a parameter makes worse and worse.
//!
//! The time of a ray is in nanoseconds; no other benchmark of this program looks at geometry that
//! no structure likes. The limits that it checks are those of `docs/accelerators.md`.

use super::backend::{self, Backend};
use super::choice::{Choice, build};
use super::data;
use super::machine::{date, load, processor};
use clap::Args;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;
use whitstone::core::{
    Accelerator, DVec3, FamilyName, Geometry, Interval, LoweredShape, Ray, Registry, SelfHitFilter,
    TriangleMesh,
};
use whitstone::{Exit, Failure};
use whitstone_testkit::{Random, tiny_ball};

/// Upper bound on the time of the default relative to the best structure.
const MAX_RATIO: f64 = 3.0;
/// Upper bound on the time of the default per ray, in nanoseconds, where any structure is below it.
const MAX_NANOSECONDS: f64 = 5000.0;
/// Times are stored from this on only: below, the overhead of a call decides.
const LEAST_NANOSECONDS: f64 = 100.0;
/// A structure that takes longer to build, in seconds, is left out of the next steps of a family.
const MAX_BUILD: f64 = 5.0;
/// The same for tracing all rays once.
const MAX_TRACE: f64 = 2.0;

/// Benchmark every accelerator on geometry that gets worse step by step: sizes, offsets, slivers,
/// fans, coincident triangles, clusters
///
/// Prints nanoseconds per ray; where Embree is installed, also of Embree, which has single
/// precision. Exit code 1 if the automatic choice takes more than three times as long as the best
/// structure, or more than 5 microseconds per ray where the best takes less than 5.
#[derive(Args, Debug)]
pub(crate) struct Arguments {
    /// Families to run [default: all]
    #[arg(value_name = "FAMILY")]
    families: Vec<String>,
    /// Number of rays
    #[arg(long, value_name = "COUNT", default_value_t = 400)]
    rays: usize,
    /// Number of triangles, where the family does not vary it
    #[arg(long, value_name = "COUNT", default_value_t = 20_000)]
    triangles: usize,
    /// Write the results to this file as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// A family of meshes.
struct FamilyOfMeshes {
    name: &'static str,
    /// What the parameter is.
    parameter: &'static str,
    steps: &'static [f64],
    /// The mesh of a step, with the usual number of triangles.
    mesh: fn(f64, usize) -> TriangleMesh,
    /// The middle of what rays aim at, and its extent.
    aim: fn(f64) -> (DVec3, f64),
}

const FAMILIES: [FamilyOfMeshes; 6] = [
    FamilyOfMeshes {
        name: "size",
        parameter: "size of one additional triangle, relative to the ball of all others",
        steps: &[1e0, 1e3, 1e4, 1e5, 1e6, 1e9, 1e12],
        mesh: |ratio, _| tiny_ball(ratio, 0.0),
        aim: |_| (DVec3::ZERO, 0.5),
    },
    FamilyOfMeshes {
        name: "offset",
        parameter: "distance from the origin, in sizes of the mesh",
        steps: &[0.0, 1e6, 1e9, 1e12, 1e13, 1e14],
        mesh: |offset, _| tiny_ball(1.0, offset),
        aim: |offset| (DVec3::splat(offset), 0.5),
    },
    FamilyOfMeshes {
        name: "slivers",
        parameter: "length of slanted triangles, in widths",
        steps: &[1e0, 1e1, 1e2, 1e3, 1e4],
        mesh: slivers,
        aim: |_| (DVec3::ZERO, 0.6),
    },
    FamilyOfMeshes {
        name: "fan",
        parameter: "triangles with one common vertex",
        steps: &[1e2, 1e3, 1e4, 1e5],
        mesh: |count, _| fan(count as usize),
        aim: |_| (DVec3::ZERO, 0.4),
    },
    FamilyOfMeshes {
        name: "coincident",
        parameter: "triangles in one place",
        steps: &[1e1, 1e2, 1e3, 1e4],
        mesh: |copies, _| coincident(copies as usize),
        aim: |_| (DVec3::ZERO, 0.4),
    },
    FamilyOfMeshes {
        name: "cluster",
        parameter: "extent of the scene, in sizes of a cluster with nine tenths of the triangles",
        steps: &[1e0, 1e1, 1e2, 1e3, 1e4, 1e5],
        mesh: cluster,
        aim: |_| (DVec3::ZERO, 0.5),
    },
];

/// Triangles from three corners each.
fn mesh(corners: impl IntoIterator<Item = [DVec3; 3]>) -> TriangleMesh {
    let positions: Vec<DVec3> = corners.into_iter().flatten().collect();
    let triangle = |i: u32| [3 * i, 3 * i + 1, 3 * i + 2];
    TriangleMesh {
        triangles: (0..positions.len() as u32 / 3).map(triangle).collect(),
        positions,
        orientation: 1.0,
        ..TriangleMesh::default()
    }
}

/// Triangles of a constant area in a cube, along its diagonal.
fn slivers(ratio: f64, count: usize) -> TriangleMesh {
    let mut random = Random::new(3);
    // The area is that of as many squares that cover the faces of the cube.
    let width = (6.0 / count as f64 / ratio).sqrt();
    let length = (ratio * width).min(1.0);
    mesh((0..count).map(move |_| {
        let along = length * (DVec3::ONE + 0.2 * random.cube()).normalize();
        let start = 0.5 * random.cube() - 0.5 * along;
        let across = width * random.direction().cross(along).normalize();
        [start, start + along, start + 0.5 * along + across]
    }))
}

/// A disk of triangles with one common vertex, in a plane that no axis is parallel to.
fn fan(count: usize) -> TriangleMesh {
    let (e, f) = DVec3::new(1.0, 2.0, 3.0).normalize().any_orthonormal_pair();
    let at = |k: usize| {
        let (s, c) = (std::f64::consts::TAU * k as f64 / count as f64).sin_cos();
        0.5 * (c * e + s * f)
    };
    mesh((0..count).map(|k| [DVec3::ZERO, at(k), at(k + 1)]))
}

fn coincident(copies: usize) -> TriangleMesh {
    let triangle = [[0.5, 0.1, -0.4], [-0.5, 0.3, -0.1], [0.1, -0.5, 0.5]].map(DVec3::from_array);
    mesh(std::iter::repeat_n(triangle, copies))
}

/// Small triangles: most of them in a cube of size 1, the rest in one of size `extent` around it.
fn cluster(extent: f64, count: usize) -> TriangleMesh {
    let mut random = Random::new(4);
    mesh((0..count).map(move |k| {
        let size = if k % 10 == 0 { extent } else { 1.0 };
        let middle = 0.5 * size * random.cube();
        [0, 1, 2].map(|_| middle + 0.02 * size * random.cube())
    }))
}

/// Rays from outside of the aim through points in it.
fn rays(count: usize, (middle, extent): (DVec3, f64)) -> Vec<Ray> {
    let mut random = Random::new(1);
    let ray = |_| {
        let origin = middle + 6.0 * extent * random.direction();
        Ray::new(origin, middle + extent * random.cube() - origin)
    };
    (0..count).map(ray).collect()
}

/// Nanoseconds per ray: the best of some rounds, so that other processes count little.
fn nanoseconds(accelerator: &dyn Accelerator, rays: &[Ray]) -> f64 {
    let round = || {
        let start = Instant::now();
        let hits = |ray: &&Ray| {
            accelerator
                .intersect(ray, Interval::FORWARD, SelfHitFilter::NOTHING)
                .is_some()
        };
        std::hint::black_box(rays.iter().filter(hits).count());
        start.elapsed().as_secs_f64()
    };
    let first = round();
    let rounds = ((0.1 / first.max(1e-9)) as usize).min(50);
    let best = (0..rounds).map(|_| round()).fold(first, f64::min);
    1e9 * best / rays.len() as f64
}

/// The column of Embree.
const EMBREE: &str = "Embree";

/// The compiled Embree program, and the folder for its files.
struct Embree<'a> {
    program: PathBuf,
    folder: &'a Path,
}

impl Embree<'_> {
    /// Nanoseconds per ray, the best of some rounds, and seconds of building, at high quality.
    fn time(&self, mesh: &TriangleMesh, rays: &[Ray]) -> Result<(f64, f64), String> {
        let queries: Vec<_> = rays.iter().map(|ray| (*ray, Interval::FORWARD)).collect();
        data::write_mesh(&self.folder.join("worst.tri"), mesh)?;
        data::write_rays(&self.folder.join("worst_bounce.rays"), &queries)?;
        let mut backend = Backend::start(&self.program, self.folder, "worst", "HIGH")?;
        let (mut best, start) = (f64::INFINITY, Instant::now());
        for _ in 0..50 {
            best = best.min(backend.trace("bounce", 1)?.0);
            if start.elapsed().as_secs_f64() > 0.1 {
                break;
            }
        }
        Ok((1e9 * best / rays.len() as f64, backend.build_seconds))
    }
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    for name in &arguments.families {
        if !FAMILIES.iter().any(|family| family.name == name) {
            let known = FAMILIES.map(|family| family.name).join(", ");
            return Err(Failure::usage(format!("there is no family \"{name}\": {known}")));
        }
    }
    let structures: Vec<&str> = registry
        .entries()
        .filter(|entry| entry.family == FamilyName::Accelerator)
        .map(|entry| entry.name)
        .collect();
    let folder = tempfile::tempdir().map_err(Failure::environment)?;
    let embree = match backend::compile(folder.path()) {
        Ok(program) => Some(Embree {
            program,
            folder: folder.path(),
        }),
        Err(why) => {
            eprintln!("without Embree: {why}");
            None
        }
    };
    let (mut stored, mut problems) = (Vec::new(), Vec::new());
    for family in &FAMILIES {
        let wanted = |name: &String| name == family.name;
        if !arguments.families.is_empty() && !arguments.families.iter().any(wanted) {
            continue;
        }
        let rows = steps(
            family,
            &structures,
            embree.as_ref(),
            arguments,
            registry,
            &mut problems,
        )?;
        stored.push(json!({ "family": family.name, "parameter": family.parameter, "steps": rows }));
    }
    for problem in &problems {
        println!("problem: {problem}");
    }
    if let Some(path) = &arguments.json {
        let all = json!({
            "date": date(), "processor": processor(), "load": load(), "rays": arguments.rays,
            "triangles": arguments.triangles, "families": stored,
        });
        let text = format!("{all:#}\n");
        whitstone::image::atomic::write_bytes(path, text.as_bytes()).map_err(Failure::environment)?;
    }
    Ok(if problems.is_empty() {
        Exit::Pass
    } else {
        Exit::Differs
    })
}

/// The rows of a family. What is wrong with the automatic choice goes to `problems`.
fn steps(
    family: &FamilyOfMeshes,
    structures: &[&str],
    embree: Option<&Embree<'_>>,
    arguments: &Arguments,
    registry: &Registry,
    problems: &mut Vec<String>,
) -> Result<Vec<Value>, Failure> {
    println!("\n{}: {}; nanoseconds per ray\n", family.name, family.parameter);
    let heads: Vec<String> = structures.iter().map(|name| format!("{name:>12}")).collect();
    println!("{:>8}{}{:>12}  auto", "", heads.concat(), EMBREE);
    let mut slow = vec![false; structures.len()];
    let mut rows = Vec::new();
    for &step in family.steps {
        let mesh = (family.mesh)(step, arguments.triangles);
        let rays = rays(arguments.rays, (family.aim)(step));
        let theirs = embree.map(|embree| embree.time(&mesh, &rays)).transpose();
        let theirs = theirs.map_err(Failure::environment)?;
        let geometry = Arc::new(Geometry::new(vec![LoweredShape::Triangles(mesh)]));
        let auto = registry.automatic_accelerator(&geometry);
        let auto = auto
            .map_err(|errors| Failure::environment(format!("{errors:?}")))?
            .0;
        let mut times = serde_json::Map::new();
        print!("{step:8.0e}");
        for (name, slow) in structures.iter().zip(&mut slow) {
            if *slow {
                print!("{:>12}", "-");
                continue;
            }
            let begin = Instant::now();
            let accelerator = match build(registry, &Choice::parse(name), &geometry) {
                Ok(accelerator) => accelerator,
                // Backends in single precision refuse large coordinates.
                Err(why) => {
                    print!("{:>12}", "-");
                    if *name == auto {
                        problems.push(format!("{} {step:e}: {why}", family.name));
                    }
                    continue;
                }
            };
            let built = begin.elapsed().as_secs_f64();
            let time = nanoseconds(&*accelerator, &rays);
            *slow = built > MAX_BUILD || 1e-9 * time * rays.len() as f64 > MAX_TRACE;
            print!("{time:12.0}");
            times.insert((*name).to_owned(), json!({ "ns": time, "build_s": built }));
        }
        match theirs {
            Some((time, built)) => {
                print!("{time:12.0}");
                times.insert(EMBREE.to_owned(), json!({ "ns": time, "build_s": built }));
            }
            None => print!("{:>12}", "-"),
        }
        println!("  {auto}");
        let of = |name: &str| times.get(name).and_then(|time| time["ns"].as_f64());
        let best = structures
            .iter()
            .filter_map(|name| of(name))
            .fold(f64::INFINITY, f64::min);
        if let Some(time) = of(&auto) {
            let ratio = time / best.max(LEAST_NANOSECONDS);
            if ratio > MAX_RATIO || (time > MAX_NANOSECONDS && best < MAX_NANOSECONDS) {
                problems.push(format!(
                    "{} {step:e}: {auto} takes {time:.0} ns per ray, {ratio:.1} times the best",
                    family.name
                ));
            }
        }
        rows.push(json!({ "parameter": step, "auto": auto, "times": times }));
    }
    Ok(rows)
}
