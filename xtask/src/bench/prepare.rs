//! Creates the meshes and rays for `bench accelerators`, if they do not exist.

use super::choice::{Choice, build};
use super::data::{self, Query};
use super::fetch;
use std::f64::consts::TAU;
use std::path::Path;
use std::sync::Arc;
use whitstone::core::{
    Aabb, DVec3, Geometry, Interval, LoweredShape, PreliminaryIntersection, Ray, Registry, SelfHitFilter,
    Shapes, SurfaceAttributes, Transform, TriangleMesh,
};
use whitstone_testkit::TestContext;

/// The public meshes for which published results exist. Used if they are in the folder.
const PUBLIC: [&str; 3] = ["bunny", "sponza", "dragon"];

/// The meshes that replace them.
const GENERATED: [&str; 3] = ["knot", "columns", "terrain"];

/// Rows and columns of the picture whose rays are traced.
const SIZE: usize = 1024;

/// Ensures that the meshes and their rays are in the folder; returns the names.
pub(super) fn prepare(folder: &Path, meshes: &[String], registry: &Registry) -> Result<Vec<String>, String> {
    let known =
        |name: &str| folder.join(format!("{name}.tri")).is_file() || fetch::source(folder, name).is_some();
    let mut names: Vec<String> = meshes.to_vec();
    if names.is_empty() {
        names = PUBLIC
            .iter()
            .filter(|name| known(name))
            .map(|&name| name.to_owned())
            .collect();
    }
    if names.is_empty() {
        eprintln!(
            "none of {PUBLIC:?} is in {}: using generated meshes; --fetch downloads the public ones",
            folder.display()
        );
        names = GENERATED.map(str::to_owned).to_vec();
    }
    let mut prepared = Vec::new();
    for name in names {
        let path = Path::new(&name);
        let stem = path
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let file = folder.join(format!("{stem}.tri"));
        if !file.is_file() {
            let mesh = match generated(&name) {
                Some(mesh) => mesh,
                None => read_mesh(&fetch::source(folder, &name).unwrap_or(path.to_owned()), registry)?,
            };
            data::write_mesh(&file, &mesh)?;
        }
        if !folder.join(format!("{stem}_bounce.rays")).is_file() {
            write_rays(folder, &stem, registry)?;
        }
        prepared.push(stem);
    }
    Ok(prepared)
}

/// Reads a mesh file, with the shape plugin for its format.
/// A mesh of a file; of a glTF file the first primitive of the first mesh.
pub(super) fn read_mesh(path: &Path, registry: &Registry) -> Result<TriangleMesh, String> {
    let path = path
        .canonicalize()
        .map_err(|error| format!("{}: {error}", path.display()))?;
    let text = format!("file = {:?}", path.display().to_string());
    let table = toml::de::DeTable::parse(&text).map_err(|error| error.to_string())?;
    let shape = registry
        .build::<Shapes>("mesh", &table, Transform::IDENTITY, &mut TestContext::default())
        .map_err(|error| format!("{}: {error}", path.display()))?;
    match shape {
        LoweredShape::Triangles(mesh) => Ok(mesh),
        _ => Err(format!("{}: expected a triangle mesh", path.display())),
    }
}

pub(super) fn generated(name: &str) -> Option<TriangleMesh> {
    match name {
        "knot" => Some(grid(1400, 48, |u, v| tube(knot, u, v, 0.35))),
        "terrain" => Some(grid(660, 660, |u, v| {
            let wave = |f: f64| (TAU * f * u + f).sin() * (TAU * f * v).cos() / f;
            let height: f64 = [1.0, 2.3, 5.1, 11.7, 23.9, 61.3].map(wave).iter().sum();
            DVec3::new(8.0 * u - 4.0, 0.4 * height, 8.0 * v - 4.0)
        })),
        "columns" => {
            let mut mesh = grid(2, 2, |u, v| DVec3::new(12.0 * u, 0.0, 12.0 * v));
            for i in 0..36 {
                let foot =
                    DVec3::new(f64::from(i % 6), 0.0, f64::from(i / 6)) * 2.0 + DVec3::new(1.0, 0.0, 1.0);
                let side = grid(24, 40, |u, v| {
                    let radius = 0.3 + 0.1 * (2.0 * v - 1.0).powi(8);
                    foot + DVec3::new(radius * (TAU * u).cos(), 4.0 * v, radius * (TAU * u).sin())
                });
                let first = mesh.positions.len() as u32;
                mesh.positions.extend(side.positions);
                mesh.triangles
                    .extend(side.triangles.iter().map(|t| t.map(|i| i + first)));
            }
            Some(mesh)
        }
        _ => None,
    }
}

fn knot(u: f64) -> DVec3 {
    let (a, b) = (2.0 * TAU * u, 3.0 * TAU * u);
    DVec3::new(a.cos() * (2.0 + b.cos()), b.sin(), a.sin() * (2.0 + b.cos()))
}

fn tube(line: fn(f64) -> DVec3, u: f64, v: f64, radius: f64) -> DVec3 {
    let along = (line(u + 1e-4) - line(u)).normalize();
    let across = along.any_orthonormal_vector();
    line(u) + radius * ((TAU * v).cos() * across + (TAU * v).sin() * along.cross(across))
}

/// Two triangles for each of `m * n` cells of the unit square.
fn grid(m: u32, n: u32, at: impl Fn(f64, f64) -> DVec3) -> TriangleMesh {
    let mut mesh = TriangleMesh {
        orientation: 1.0,
        ..TriangleMesh::default()
    };
    for j in 0..=n {
        for i in 0..=m {
            mesh.positions
                .push(at(f64::from(i) / f64::from(m), f64::from(j) / f64::from(n)));
        }
    }
    for j in 0..n {
        for i in 0..m {
            let a = j * (m + 1) + i;
            let (b, c, d) = (a + 1, a + m + 1, a + m + 2);
            mesh.triangles.extend([[a, b, d], [a, d, c]]);
        }
    }
    mesh
}

/// The camera of a picture.
struct View {
    eye: DVec3,
    target: DVec3,
    light: DVec3,
    /// Field of view in degrees.
    angle: f64,
}

impl View {
    /// For the public meshes, the views of published results: inside the building, in front of the
    /// others.
    fn of(name: &str, bounds: &Aabb) -> Self {
        if name == "sponza" {
            return Self {
                eye: DVec3::new(-11.0, 4.0, -0.5),
                target: DVec3::new(5.0, 5.0, 0.3),
                light: DVec3::new(1.0, 11.0, 0.5),
                angle: 70.0,
            };
        }
        let (x, angle) = if name == "dragon" {
            (0.15, 38.0)
        } else {
            (0.25, 36.0)
        };
        let (center, size) = (bounds.center(), bounds.extent().length());
        Self {
            eye: center + 1.25 * size * DVec3::new(x, 0.2, 1.0).normalize(),
            target: center,
            light: center + size * DVec3::new(0.8, 1.2, 0.9),
            angle,
        }
    }
}

/// Camera rays of a picture of the whole mesh, rays from their hits towards a light, and rays from
/// there in random directions with a cosine distribution.
fn write_rays(folder: &Path, name: &str, registry: &Registry) -> Result<(), String> {
    let mesh = data::mesh(&folder.join(format!("{name}.tri")))?;
    // A file may contain vertices that no triangle uses.
    let corners = mesh.triangles.as_flattened().iter();
    let bounds = Aabb::around(corners.map(|&i| mesh.positions[i as usize]));
    let size = bounds.extent().length();
    let geometry = Arc::new(Geometry::new(vec![LoweredShape::Triangles(mesh)]));
    let accelerator = build(registry, &Choice::parse("bvh2"), &geometry)?;
    let View {
        eye,
        target,
        light,
        angle,
    } = View::of(name, &bounds);
    let w = (target - eye).normalize();
    let u = w.cross(DVec3::Y).normalize();
    let v = u.cross(w);
    let reach = (0.5 * angle.to_radians()).tan();
    let (mut primary, mut shadow, mut bounce) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..SIZE * SIZE {
        let place = |i: usize| reach * (2.0 * (i as f64 + 0.5) / SIZE as f64 - 1.0);
        let ray = Ray::new(eye, (w + place(i % SIZE) * u - place(i / SIZE) * v).normalize());
        let (ray, interval) = rounded(&(ray, Interval::FORWARD));
        primary.push((ray, interval));
        let Some(hit) = accelerator.intersect(&ray, interval, SelfHitFilter::NOTHING) else {
            continue;
        };
        let (p, n) = surface(&geometry, &ray, &hit, size);
        let to_light = light - p;
        if to_light.dot(n) > 0.0 {
            let distance = to_light.length();
            shadow.push((
                Ray::new(p, to_light / distance),
                Interval::up_to(0.9999 * distance),
            ));
        }
        // A point on the unit sphere around the tip of the normal gives a cosine distribution.
        bounce.push((
            Ray::new(p, (n + 0.999 * on_ball(i)).normalize()),
            Interval::FORWARD,
        ));
    }
    for (set, rays) in [("primary", primary), ("shadow", shadow), ("bounce", bounce)] {
        data::write_rays(&folder.join(format!("{name}_{set}.rays")), &rays)?;
    }
    Ok(())
}

/// Point i of a sequence that covers the unit sphere, with consecutive points far from each other.
fn on_ball(i: usize) -> DVec3 {
    // Roberts, *The unreasonable effectiveness of quasirandom sequences*, 2018: powers of the
    // plastic number.
    let part = |step: f64| (step * i as f64).fract();
    let (z, angle) = (
        2.0 * part(0.754_877_666_246_693) - 1.0,
        TAU * part(0.569_840_290_998_053),
    );
    let radius = (1.0 - z * z).sqrt();
    DVec3::new(radius * angle.cos(), radius * angle.sin(), z)
}

/// A point a little above the surface, and its normal on that side.
fn surface(geometry: &Geometry, ray: &Ray, hit: &PreliminaryIntersection, size: f64) -> (DVec3, DVec3) {
    let point = geometry.surface(ray, hit, SurfaceAttributes::NOTHING);
    let n = -point.n_g * point.n_g.dot(ray.direction).signum();
    (point.position + 1e-5 * size * n, n)
}

/// The query, rounded as in the file.
fn rounded((ray, interval): &Query) -> Query {
    let round = |v: DVec3| v.as_vec3().as_dvec3();
    (Ray::new(round(ray.origin), round(ray.direction)), *interval)
}
