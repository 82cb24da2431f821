//! Workloads of the kernel benchmarks: each is one call over a stream of 256 rays, whose setup is
//! not counted.

use std::sync::Arc;
use whitstone_accelerators::bvh::Bvh;
use whitstone_cameras::perspective::Perspective;
use whitstone_core::stream::{HitStream, LANES, Lanes, RayStream};
use whitstone_core::{
    Accelerator, Accelerators, Camera, Cameras, DVec2, DVec3, FilmSize, Geometry, Interval, LoweredShape,
    Plugin, Ray, SelfHitFilter, Shapes, Transform, TriangleMesh,
};
use whitstone_shapes::cuboid::Cuboid;
use whitstone_shapes::sphere::Sphere;
use whitstone_testkit::build;

/// 16 by 16 rays from z = -4 through a square of the plane z = 0 around the origin.
pub fn rays(half_side: f64) -> Box<RayStream> {
    let mut rays = Box::new(RayStream {
        len: LANES,
        ..RayStream::default()
    });
    for lane in 0..LANES {
        let place = |i: usize| half_side * ((2 * i + 1) as f64 / 16.0 - 1.0);
        let origin = DVec3::new(0.1, 0.2, -4.0);
        let target = DVec3::new(place(lane % 16), place(lane / 16), 0.0);
        let ray = Ray::new(origin, (target - origin).normalize());
        rays.set(lane, ray, f64::INFINITY, SelfHitFilter::NOTHING);
    }
    rays
}

/// A stream of rays, and the target that it is traced against.
pub struct Traced<T> {
    /// The accelerator or shape to intersect.
    pub target: T,
    /// 256 rays.
    pub rays: Box<RayStream>,
    /// Destination of the hits.
    pub hits: Box<HitStream>,
}

impl<T> Traced<T> {
    fn new(target: T, half_side: f64) -> Self {
        Self {
            target,
            rays: rays(half_side),
            hits: Box::default(),
        }
    }
}

/// Triangles with the given edge length and first corners, facing the rays.
fn triangles(centers: impl Iterator<Item = DVec3>, edge: f64) -> TriangleMesh {
    let mut mesh = TriangleMesh {
        orientation: 1.0,
        ..TriangleMesh::default()
    };
    for center in centers {
        let first = mesh.positions.len() as u32;
        let corners = [DVec3::ZERO, edge * DVec3::X, edge * DVec3::Y];
        mesh.positions.extend(corners.map(|corner| center + corner));
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    mesh
}

fn bvh(mesh: TriangleMesh) -> Box<dyn Accelerator> {
    let geometry = Arc::new(Geometry::new(vec![LoweredShape::Triangles(mesh)]));
    build::<Accelerators, Bvh>("", geometry).expect("it is a hierarchy")
}

/// Eight leaves in the corners of a cube, with rays that pass between them. Measures the node test
/// and the fixed cost of a search.
pub fn node() -> Traced<Box<dyn Accelerator>> {
    let corner = |i: u32| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)) * 2.0 - 1.0;
    let centers = (0..8).flat_map(|i| (0..8).map(move |k| corner(i) + 1e-3 * f64::from(k)));
    Traced::new(bvh(triangles(centers, 0.01)), 0.3)
}

/// Eight large triangles, one behind the other; every ray hits their boxes in the half that they do
/// not fill. Measures the triangle filter.
pub fn leaf() -> Traced<Box<dyn Accelerator>> {
    let centers = (0..8).map(|i| DVec3::new(-9.0, -9.0, 0.1 * f64::from(i)));
    Traced::new(bvh(triangles(centers, 12.0)), 0.3)
}

/// Eight large triangles, one behind the other, that every ray hits. Measures the filter and one
/// double-precision test per ray.
pub fn hit() -> Traced<Box<dyn Accelerator>> {
    let centers = (0..8).map(|i| DVec3::new(-3.0, -3.0, 0.1 * f64::from(i)));
    Traced::new(bvh(triangles(centers, 12.0)), 0.3)
}

fn shape<P: Plugin<Shapes>>(text: &str) -> Traced<LoweredShape> {
    let shape = build::<Shapes, P>(text, Transform::IDENTITY).expect("it is a shape");
    Traced::new(shape, 1.5)
}

/// Half of the rays hit it.
pub fn sphere() -> Traced<LoweredShape> {
    shape::<Sphere>("")
}

/// Half of the rays hit it.
pub fn cuboid() -> Traced<LoweredShape> {
    shape::<Cuboid>("")
}

/// One triangle, tested by the watertight test in double precision; half of the rays hit it.
pub fn triangle() -> Traced<LoweredShape> {
    let center = DVec3::new(-1.5, -1.5, 0.0);
    Traced::new(
        LoweredShape::Triangles(triangles(std::iter::once(center), 3.0)),
        1.5,
    )
}

/// Finds the nearest hits of the stream. Returns their number, so that the work is not optimised
/// away.
pub fn intersect<T>(traced: &mut Traced<T>, trace: impl FnOnce(&T, &RayStream, &mut HitStream)) -> usize {
    trace(&traced.target, &traced.rays, &mut traced.hits);
    (0..traced.rays.len)
        .filter(|&lane| traced.hits.get(lane).is_some())
        .count()
}

/// The same for an accelerator, ray by ray.
pub fn closest_single(traced: &Traced<Box<dyn Accelerator>>) -> usize {
    let rays = &traced.rays;
    let hit = |lane: &usize| {
        let ray = rays.ray(*lane);
        traced
            .target
            .intersect(&ray, Interval::FORWARD, SelfHitFilter::NOTHING)
            .is_some()
    };
    (0..rays.len).filter(hit).count()
}

/// Finds the nearest hits with one shape.
pub fn closest_shape(shape: &LoweredShape, rays: &RayStream, hits: &mut HitStream) {
    hits.clear(rays);
    match shape {
        LoweredShape::Triangles(mesh) => mesh.intersect_stream(0, rays, hits),
        LoweredShape::Custom(primitive) => primitive.intersect_stream(0, rays, hits),
        _ => {}
    }
}

/// A camera and raster positions.
pub struct Tile {
    /// The camera.
    pub camera: Box<dyn Camera>,
    /// Raster positions, 16 by 16.
    pub raster: Box<Lanes<DVec2>>,
    /// Destination of the rays.
    pub rays: Box<RayStream>,
}

/// A camera and the pixels of a tile.
pub fn camera() -> Tile {
    let text = "look_at = { origin = [0, 2, 6], target = [0, 1, 0], up = [0, 1, 0] }\nfov = 45";
    let size = FilmSize {
        width: 640,
        height: 360,
    };
    let camera = build::<Cameras, Perspective>(text, size).expect("it is a camera");
    let mut raster = Box::new([DVec2::ZERO; LANES]);
    for (lane, place) in raster.iter_mut().enumerate() {
        *place = DVec2::new((lane % 16) as f64 + 0.5, (lane / 16) as f64 + 0.5);
    }
    Tile {
        camera,
        raster,
        rays: rays(1.0),
    }
}
