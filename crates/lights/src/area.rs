//! An area light: fixed points on its surface, each with its share of the area.
//!
//! Soft shadows as in Cook, Porter and Carpenter, *Distributed ray tracing*, 1984, but with a fixed
//! quadrature instead of random points, so that two renderers that agree on the points must agree
//! on the image. Each point has an intensity of radiance times its area times the cosine with the
//! normal; its irradiance falls off with the square of the distance unless `falloff` is "none".
//! The surface itself is invisible; place a shape of material `emissive` there to show it. Each
//! triangle of a mesh is divided into equal triangles, with one point at the centroid of each. This
//! keeps the area exact and avoids a selection of triangles that could depend on rounding.
//! `scenes/showcase/mesh_light.toml` has a mesh light, `scenes/showcase/even_area.toml` lights
//! without falloff.
//!
//! - Twin: hosted: Python emitters around Mitsuba `point` lights at the same points.
//! - Example: `scenes/lights/area.toml`.

use crate::support::emission::{self, Falloff};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::{Color, FilePath, IntegerIn, TransformSteps};
use whitstone_core::simd::{self, select};
use whitstone_core::stream::{GROUP, SampleStreams, Vectors, groups};
use whitstone_core::{
    Aabb, Context, DVec3, Light, LightBounds, LightFlags, LightSample, Lights, Plugin, Rgb, SceneError,
    SceneErrors, Transform, TriangleMesh,
};

/// Upper limit of points of a mesh; each one costs a shadow ray per surface point.
const MAX_POINTS: usize = 4096;

/// Default points along each side of the grid, and default parts of each side of a mesh triangle.
const GRID_SAMPLES: u32 = 4;
const MESH_SAMPLES: u32 = 1;

/// An area light, sampled at a fixed grid of points.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Shape of the light, of the size that a shape of that type has by default: "rectangle" and
    /// "disk" emit along +z, "sphere" emits outwards; "mesh" is the triangles of `file`, which emit
    /// along the normals given by their winding.
    #[serde(default = "rectangle")]
    #[schemars(with = "Surface")]
    shape: Spanned<Surface>,
    /// For "mesh" only: a file as for the shape `mesh`. Its vertex normals are ignored. It need not
    /// be closed.
    #[serde(default)]
    #[schemars(extend("x-default" = "none: required for \"mesh\""), with = "FilePath")]
    file: Option<FilePath>,
    /// Placement of the light: one step, or steps in the order in which they are applied. For a
    /// sphere it must be a similarity.
    #[serde(default = "none")]
    #[schemars(with = "TransformSteps")]
    transform: Spanned<TransformSteps>,
    /// Emitted radiance in W/(m² sr), the same in all directions.
    radiance: Color,
    /// Points along each side of the grid, or parts of each side of a mesh triangle. The square of
    /// this is the number of shadow rays per surface point; for a mesh, per triangle, up to 4096 in
    /// total.
    #[serde(default)]
    #[schemars(extend("x-default" = format!("{GRID_SAMPLES}; {MESH_SAMPLES} for \"mesh\"")), with = "IntegerIn<1, 32>")]
    samples: Option<Spanned<IntegerIn<1, 32>>>,
    /// Falloff of the irradiance with the distance d of a point: "inverse_square" (1/d²), or
    /// "none": radiance times area is then the irradiance in W/m² on the normal, at any distance.
    #[serde(default)]
    falloff: Falloff,
}

fn none() -> Spanned<TransformSteps> {
    Spanned::new(0..0, TransformSteps::NONE)
}

fn rectangle() -> Spanned<Surface> {
    Spanned::new(0..0, Surface::Rectangle)
}

/// Shape of the light.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema, PartialEq)]
#[serde(rename_all = "snake_case")]
enum Surface {
    /// z = 0, -1 <= x, y <= 1.
    Rectangle,
    /// z = 0, x² + y² <= 1.
    Disk,
    /// x² + y² + z² = 1.
    Sphere,
    /// The triangles of a file.
    Mesh,
}

/// Offset of the points from the surface along its normal, relative to the size of the light
/// (model, section 7). It exceeds the rounding errors of the point and of a shape at the same
/// place, so that the shape never hides the light.
const OFF_SURFACE: f64 = 32.0 * f64::EPSILON;

/// A point of the surface, offset by [`OFF_SURFACE`].
struct LightPoint {
    position: DVec3,
    /// Unit normal.
    normal: DVec3,
    /// Its share of the area, in m².
    area: f64,
}

impl LightPoint {
    /// The same point, moved by `by` metres along the normal.
    fn moved(self, by: f64) -> Self {
        Self {
            position: self.position + self.normal * by,
            ..self
        }
    }
}

/// The `area` light; see the module documentation.
pub struct Area {
    points: Vec<LightPoint>,
    /// For each point, the intensity along its normal: radiance times its share of the area.
    intensities: Vec<Rgb>,
    falloff: Falloff,
}

impl Plugin<Lights> for Area {
    const TYPE: &'static str = "area";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Light>, SceneErrors> {
        let transform = config.transform.get_ref().get();
        let is_mesh = *config.shape.get_ref() == Surface::Mesh;
        let (points, place) = match (is_mesh, &config.file) {
            (true, Some(file)) => (mesh(&config, file, &transform, context)?, file.span.clone()),
            (false, None) => (grid(&config, &transform)?, config.transform.span()),
            (true, None) => {
                let error = SceneError::at(config.shape.span(), "`shape = \"mesh\"` needs a `file`");
                return Err(error.with_help("add `file = \"lamp.obj\"` or `.ply`").into());
            }
            (false, Some(file)) => {
                let error = SceneError::at(file.span.clone(), "only the shape \"mesh\" has a file");
                return Err(error.with_help("add `shape = \"mesh\"`").into());
            }
        };
        let radiance = config.radiance.get();
        let intensities: Vec<Rgb> = points.iter().map(|point| radiance * point.area).collect();
        if !intensities
            .iter()
            .all(|intensity| intensity.max_component().is_finite())
        {
            return Err(SceneError::at(place, "the surface is too large for double precision").into());
        }
        Ok(Arc::new(Self {
            points,
            intensities,
            falloff: config.falloff,
        }))
    }
}

/// The points of a rectangle, a disk or a sphere.
fn grid(config: &Config, transform: &Transform) -> Result<Vec<LightPoint>, SceneErrors> {
    let surface = *config.shape.get_ref();
    let n = config
        .samples
        .as_ref()
        .map_or(GRID_SAMPLES, |n| n.get_ref().get());
    let area = area(surface, transform).ok_or_else(|| {
        let message = "the transform of a spherical light must be a similarity";
        SceneError::at(config.transform.span(), message).with_help("scale all axes by the same factor")
    })?;
    let middle = |k: u32| (f64::from(k) + 0.5) / f64::from(n);
    let cells = (0..n).flat_map(|j| (0..n).map(move |i| (middle(i), middle(j))));
    let share = area / f64::from(n * n);
    let off = OFF_SURFACE * size(transform);
    Ok(cells
        .map(|(u, v)| light_point(surface, transform, u, v, share).moved(off))
        .collect())
}

/// Size of the light: the largest coordinate of the image of the cube [-1, 1]³.
fn size(transform: &Transform) -> f64 {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| transform.vector_to_world(axis).abs());
    let reach = axes.iter().sum::<DVec3>() + transform.point_to_world(DVec3::ZERO).abs();
    reach.max_element()
}

/// The points of the triangles of a mesh file.
fn mesh(
    config: &Config,
    file: &FilePath,
    transform: &Transform,
    context: &mut dyn Context,
) -> Result<Vec<LightPoint>, SceneErrors> {
    let mesh = context.triangles(file, transform)?;
    let n = config
        .samples
        .as_ref()
        .map_or(MESH_SAMPLES, |n| n.get_ref().get());
    let each = n as usize * n as usize;
    let most = mesh.triangles.len().saturating_mul(each);
    if most > MAX_POINTS {
        let span = config.samples.as_ref().map_or(file.span.clone(), Spanned::span);
        let triangles = mesh.triangles.len();
        let message = format!("{triangles} triangles have {most} light points, more than {MAX_POINTS}");
        let error = SceneError::at(span, message);
        return Err(error
            .with_help("each point costs a shadow ray: use a coarser mesh or fewer `samples`")
            .into());
    }
    let size = mesh
        .positions
        .iter()
        .map(|p| p.abs().max_element())
        .fold(0.0, f64::max);
    let points: Vec<LightPoint> = (0..mesh.triangles.len() as u32)
        .filter_map(|triangle| centroids(&mesh, triangle, n))
        .flatten()
        .map(|point| point.moved(OFF_SURFACE * size))
        .collect();
    if points.is_empty() {
        let message = format!("{}: all triangles have zero area", file.path);
        return Err(SceneError::at(file.span.clone(), message).into());
    }
    Ok(points)
}

/// The centroids of the n² equal parts of a triangle, upright parts first; `None` if it has no
/// area.
fn centroids(mesh: &TriangleMesh, triangle: u32, n: u32) -> Option<impl Iterator<Item = LightPoint>> {
    let [a, b, c] = mesh.corners(triangle);
    let (b, c) = (b - a, c - a);
    let across = b.cross(c);
    let normal = across.try_normalize()? * mesh.orientation;
    let area = 0.5 * across.length() / f64::from(n * n);
    // In thirds of a part: 1 is the centroid of an upright part, 2 that of an inverted one.
    let parts = [(1, n), (2, n - 1)].into_iter().flat_map(|(third, rows)| {
        let row = move |j: u32| (0..rows - j).map(move |i| (3 * i + third, 3 * j + third));
        (0..rows).flat_map(row)
    });
    Some(parts.map(move |(i, j)| LightPoint {
        position: a + b * (f64::from(i) / f64::from(3 * n)) + c * (f64::from(j) / f64::from(3 * n)),
        normal,
        area,
    }))
}

/// Area in m²; `None` if a sphere is no sphere in world space.
fn area(surface: Surface, transform: &Transform) -> Option<f64> {
    let across = transform
        .vector_to_world(DVec3::X)
        .cross(transform.vector_to_world(DVec3::Y))
        .length();
    match surface {
        // Not called for a mesh: `centroids` computes the areas of its triangles.
        Surface::Rectangle | Surface::Mesh => Some(4.0 * across),
        Surface::Disk => Some(PI * across),
        Surface::Sphere => transform
            .similarity_scale()
            .map(|radius| 4.0 * PI * radius * radius),
    }
}

/// Maps (u, v) of the unit square to a point on the surface; the mapping preserves relative areas.
fn light_point(surface: Surface, transform: &Transform, u: f64, v: f64, area: f64) -> LightPoint {
    let (sin, cos) = libm::sincos(TAU * u);
    let (point, normal) = match surface {
        Surface::Rectangle | Surface::Mesh => (DVec3::new(2.0 * u - 1.0, 2.0 * v - 1.0, 0.0), DVec3::Z),
        Surface::Disk => {
            let r = v.sqrt();
            (DVec3::new(r * cos, r * sin, 0.0), DVec3::Z)
        }
        Surface::Sphere => {
            let z = 1.0 - 2.0 * v;
            let r = (1.0 - z * z).sqrt();
            let point = DVec3::new(r * cos, r * sin, z);
            (point, point)
        }
    };
    LightPoint {
        position: transform.point_to_world(point),
        normal: transform.normal_to_world(normal),
        area,
    }
}

/// Cosine between the normal and the direction towards the receiver, clamped to 0. `direction`
/// points to the light.
#[inline(always)]
fn facing(normal: DVec3, direction: DVec3) -> f64 {
    (-normal.dot(direction)).max(0.0)
}

impl Light for Area {
    fn flags(&self) -> LightFlags {
        LightFlags::SAMPLES
    }

    fn samples(&self, point: DVec3, out: &mut Vec<LightSample>) {
        for (LightPoint { position, normal, .. }, intensity) in self.points.iter().zip(&self.intensities) {
            let sample = emission::sample(*position, point, *intensity, self.falloff);
            out.extend(sample.map(|sample| LightSample {
                irradiance: sample.irradiance * facing(*normal, sample.direction),
                ..sample
            }));
        }
    }

    fn samples_stream(&self, len: usize, points: &Vectors, out: &mut SampleStreams) {
        for (LightPoint { position, normal, .. }, intensity) in self.points.iter().zip(&self.intensities) {
            let place = out.len();
            emission::sample_stream(*position, len, points, *intensity, self.falloff, out);
            let stream = out.stream(place);
            simd::dispatch(
                #[inline(always)]
                || {
                    let normal = *normal;
                    for start in groups(len) {
                        for lane in start..start + GROUP {
                            let irradiance = stream.irradiance.get(lane);
                            let cosine = facing(normal, stream.direction.get(lane));
                            // Lanes without irradiance have no valid direction.
                            let factor = select(irradiance.is_black(), 0.0, cosine);
                            stream.irradiance.set(lane, irradiance * factor);
                        }
                    }
                },
            );
        }
    }

    /// Whether any point emits towards the bounding sphere of the box.
    fn affects_bounds(&self, bounds: &Aabb) -> bool {
        let (center, radius) = emission::ball_around(bounds);
        let faces_bounds = |point: &LightPoint| {
            let out = center - point.position;
            // True also if a distance is NaN.
            let behind = point.normal.dot(out) + radius < -1e-9 * (out.length() + radius);
            !behind
        };
        let shines = self.intensities.iter().any(|intensity| !intensity.is_black());
        shines && self.points.iter().any(faces_bounds)
    }

    fn bounds(&self) -> Option<LightBounds> {
        let positions: Vec<DVec3> = self.points.iter().map(|point| point.position).collect();
        let intensities = self.intensities.iter().map(|intensity| intensity.max_component());
        emission::bounds(&positions, intensities.fold(0.0, f64::max), self.falloff)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::Resources;
    use whitstone_testkit::{TestContext, build, build_in, light_laws};

    fn irradiance(text: &str, point: DVec3, normal: DVec3) -> f64 {
        let mut samples = Vec::new();
        build::<Lights, Area>(text, ())
            .unwrap()
            .samples(point, &mut samples);
        samples
            .iter()
            .map(|sample| sample.irradiance.g * normal.dot(sample.direction).max(0.0))
            .sum()
    }

    #[test]
    fn laws() {
        for text in [
            "radiance = [1, 0, 7]",
            "radiance = 3\nshape = \"disk\"\nsamples = 3\ntransform = { scale = [1, 2, 3] }",
            "radiance = 3\nshape = \"disk\"\nfalloff = \"none\"",
            "radiance = 3\nshape = \"sphere\"\nsamples = 2\ntransform = [{ scale = 0.5 }, { translate = [1, 0, 0] }]",
        ] {
            light_laws(&*build::<Lights, Area>(text, ()).unwrap());
        }
    }

    /// Compares with closed forms of the irradiance below the middle. The error of the quadrature
    /// falls with the square of the point spacing.
    #[test]
    fn it_converges_to_the_integral() {
        // A disk of radius 1 at height 1 gives pi L/(1 + h²); a sphere of radius 1 with its centre
        // at height 2 gives pi L (r/d)².
        let below = "transform = { rotate = { axis = [1, 0, 0], degrees = 180 } }";
        for (shape, height, expected) in [("disk", 1.0, PI), ("sphere", 2.0, 2.0 * PI / 4.0)] {
            let error = |n: u32| {
                let text = format!("shape = \"{shape}\"\nradiance = 2\nsamples = {n}\n{below}");
                let point = DVec3::new(0.0, 0.0, -height);
                (irradiance(&text, point, DVec3::Z) / expected - 1.0).abs()
            };
            let (coarse, fine) = (error(4), error(32));
            assert!(coarse < 0.5 && fine < coarse / 20.0, "{shape}: {coarse} {fine}");
        }
    }

    /// Meshes: a square of side 2 that faces +z, as two triangles with a zero-area sliver on one of
    /// them; and the corner of a cube.
    fn meshes() -> TestContext {
        let square = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let square = square.map(|[x, y]| DVec3::new(x, y, 0.0)).to_vec();
        let corner = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        TestContext::default()
            .with_mesh(
                "square.obj",
                square.clone(),
                vec![[0, 1, 2], [1, 1, 2], [0, 2, 3]],
            )
            .with_mesh(
                "corner.obj",
                corner,
                vec![[0, 2, 1], [0, 3, 2], [0, 1, 3], [1, 2, 3]],
            )
            .with_mesh("line.obj", square, vec![[0, 1, 1], [2, 2, 2]])
            .with_mesh(
                "many.obj",
                vec![DVec3::ZERO, DVec3::X, DVec3::Y],
                vec![[0, 1, 2]; 1025],
            )
            .with_mesh(
                "fewer.obj",
                vec![DVec3::ZERO, DVec3::X, DVec3::Y],
                vec![[0, 1, 2]; 500],
            )
            .with_mesh(
                "some.obj",
                vec![DVec3::ZERO, DVec3::X, DVec3::Y],
                vec![[0, 1, 2]; 1024],
            )
    }

    fn of_mesh(text: &str) -> Result<Arc<dyn Light>, SceneErrors> {
        let text = format!("shape = \"mesh\"\n{text}");
        build_in::<Lights, Area>(&text, (), &mut meshes())
    }

    /// Irradiance at a point, with the cosine of each sample to a normal.
    fn from_mesh(text: &str, point: DVec3, normal: DVec3) -> f64 {
        let mut samples = Vec::new();
        of_mesh(text).unwrap().samples(point, &mut samples);
        let cosine = |sample: &LightSample| normal.dot(sample.direction).max(0.0);
        samples.iter().map(|s| s.irradiance.g * cosine(s)).sum()
    }

    #[test]
    fn meshes_are_lights_as_others() {
        for text in [
            "file = \"square.obj\"\nradiance = [1, 0, 7]",
            "file = \"corner.obj\"\nradiance = 3\nsamples = 3\ntransform = { scale = [1, -2, 3] }",
            "file = \"corner.obj\"\nradiance = 3\nfalloff = \"none\"",
        ] {
            light_laws(&*of_mesh(text).unwrap());
        }
    }

    /// Seen from far away along the axes, the mesh gives the projected area that faces that way.
    #[test]
    fn the_points_of_a_mesh_share_its_area() {
        let far = 1e7;
        for n in [1, 2, 5] {
            for (axis, scale, expected) in [
                // Only the slanted face has a projected area towards +x; the face perpendicular to
                // x faces -x.
                (DVec3::X, "[1, 1, 1]", 0.5),
                (DVec3::NEG_X, "[1, 1, 1]", 0.5),
                (DVec3::NEG_Y, "[2, 5, 3]", 3.0),
                // A mirroring transform keeps the outside outside.
                (DVec3::Z, "[1, 1, -1]", 0.5),
                (DVec3::NEG_Z, "[1, 1, -1]", 0.5),
            ] {
                let text = format!(
                    "file = \"corner.obj\"\nradiance = 2\nsamples = {n}\ntransform = {{ scale = {scale} }}"
                );
                let found = from_mesh(&text, far * axis, -axis) * far * far / 2.0;
                assert!(
                    (found / expected - 1.0).abs() < 1e-5,
                    "{n} {axis} {scale}: {found}"
                );
            }
        }
        // The order and the positions of the points of a triangle match the model.
        let mut context = meshes();
        let file: Config = whitstone_core::config::decode(
            &toml::de::DeTable::parse("shape = \"mesh\"\nfile = \"many.obj\"\nradiance = 1").unwrap(),
        )
        .unwrap();
        let one = context
            .triangles(&file.file.unwrap(), &Transform::IDENTITY)
            .unwrap();
        let places: Vec<[f64; 2]> = centroids(&one, 0, 3)
            .unwrap()
            .map(|point| [9.0 * point.position.x, 9.0 * point.position.y].map(f64::round))
            .collect();
        let (upright, turned) = (
            [[1, 1], [4, 1], [7, 1], [1, 4], [4, 4], [1, 7]],
            [[2, 2], [5, 2], [2, 5]],
        );
        let expected: Vec<[f64; 2]> = upright.iter().chain(&turned).map(|p| p.map(f64::from)).collect();
        assert_eq!(places, expected);
    }

    /// Compares with the closed form of a square seen from a point on its axis (Howell, *A catalog
    /// of radiation heat transfer configuration factors*, B-4, four times a corner). The error
    /// falls with the square of the number of parts.
    #[test]
    fn a_square_of_triangles_converges_to_its_closed_form() {
        let height: f64 = 0.8;
        let (x, root) = (1.0 / height, (1.0 + 1.0 / (height * height)).sqrt());
        let factor = 4.0 / TAU * 2.0 * (x / root) * (x / root).atan();
        let error = |n: u32| {
            let text = format!("file = \"square.obj\"\nradiance = 3\nsamples = {n}");
            let found = from_mesh(&text, DVec3::new(0.0, 0.0, height), DVec3::NEG_Z);
            (found / (3.0 * PI * factor) - 1.0).abs()
        };
        let (coarse, fine) = (error(4), error(32));
        assert!(coarse < 0.05 && fine < coarse / 32.0, "{coarse} {fine}");
    }

    #[test]
    fn meshes_that_cannot_shine_are_refused_at_their_places() {
        for (text, place) in [
            ("radiance = 1", "\"mesh\""),
            ("radiance = 1\nfile = \"none.obj\"", "\"none.obj\""),
            ("radiance = 1\nfile = \"line.obj\"", "\"line.obj\""),
            ("radiance = 1\nfile = \"many.obj\"\nsamples = 2", "2"),
            ("radiance = 1\nfile = \"fewer.obj\"\nsamples = 3", "3"),
            (
                "radiance = 1e300\nfile = \"square.obj\"\ntransform = { scale = 1e10 }",
                "\"square.obj\"",
            ),
        ] {
            let error = of_mesh(text).err().unwrap().0.remove(0);
            let text = format!("shape = \"mesh\"\n{text}");
            assert_eq!(&text[error.span.unwrap()], place, "{}", error.message);
        }
        assert!(of_mesh("radiance = 1\nfile = \"many.obj\"").is_ok());
        // As many points as are allowed.
        assert!(of_mesh("radiance = 1\nfile = \"some.obj\"\nsamples = 2").is_ok());
        let text = "radiance = 1\nfile = \"square.obj\"";
        let error = build_in::<Lights, Area>(text, (), &mut meshes())
            .err()
            .unwrap()
            .0
            .remove(0);
        assert_eq!(&text[error.span.unwrap()], "\"square.obj\"");
    }

    /// Without falloff, every point gives its radiance times its area times both cosines, at any
    /// distance.
    #[test]
    fn without_falloff_the_distance_has_no_effect() {
        let none = "falloff = \"none\"";
        for height in [0.01, 1.0, 1e9] {
            // Far away, all points are in the direction of the normal.
            for (shape, area) in [("rectangle", 4.0), ("disk", PI)] {
                let text = format!("radiance = 2\nshape = \"{shape}\"\n{none}");
                let found = irradiance(&text, DVec3::new(0.0, 0.0, 1e9 * height), DVec3::NEG_Z);
                assert!((found / (2.0 * area) - 1.0).abs() < 1e-12, "{shape}: {found}");
            }
            let text = format!("radiance = 3\nsamples = 1\n{none}");
            let at = DVec3::new(0.6 * height, 0.0, 0.8 * height);
            let found = irradiance(&text, at, DVec3::NEG_Z);
            assert!((found - 3.0 * 4.0 * 0.64).abs() < 1e-9, "{height}: {found}");
            // Two triangles of area 2, with their centroids at (±1/3, ∓1/3, 0).
            let text = format!("file = \"square.obj\"\nradiance = 3\n{none}");
            let found = from_mesh(&text, DVec3::new(0.0, 0.0, height), DVec3::NEG_Z);
            let cosine = height * height / (height * height + 2.0 / 9.0);
            assert!((found - 3.0 * 4.0 * cosine).abs() < 1e-9, "{height}: {found}");
        }
        let text = "radiance = 2\nfalloff = \"linear\"";
        let error = build::<Lights, Area>(text, ()).err().unwrap().0.remove(0);
        assert_eq!(&text[error.span.unwrap()], "\"linear\"");
    }

    fn config(text: &str) -> Config {
        whitstone_core::config::decode(&toml::de::DeTable::parse(text).unwrap()).unwrap()
    }

    /// The points of the surface, before the offset.
    #[test]
    fn points_are_where_the_model_says() {
        let points = |text: &str| {
            let config = config(&format!("radiance = 1\nsamples = 2\n{text}"));
            grid(&config, &config.transform.get_ref().get()).unwrap()
        };
        let half = 0.75_f64.sqrt();
        for (text, area, expected) in [
            (
                "transform = { scale = [2, 3, 1] }",
                24.0,
                [
                    [-1.0, -1.5, 0.0],
                    [1.0, -1.5, 0.0],
                    [-1.0, 1.5, 0.0],
                    [1.0, 1.5, 0.0],
                ],
            ),
            (
                "shape = \"disk\"\ntransform = { scale = [2, 3, 1] }",
                6.0 * PI,
                [
                    [0.0, 1.5, 0.0],
                    [0.0, -1.5, 0.0],
                    [0.0, 3.0 * half, 0.0],
                    [0.0, -3.0 * half, 0.0],
                ],
            ),
            (
                "shape = \"sphere\"\ntransform = { scale = 2 }",
                16.0 * PI,
                [
                    [0.0, 2.0 * half, 1.0],
                    [0.0, -2.0 * half, 1.0],
                    [0.0, 2.0 * half, -1.0],
                    [0.0, -2.0 * half, -1.0],
                ],
            ),
        ] {
            let found = points(text);
            assert_eq!(found.len(), 4);
            for (point, expected) in found.iter().zip(expected) {
                let off = (point.position - DVec3::from(expected)).length();
                assert!(off < 1e-13, "{text}: {} {expected:?}", point.position);
                assert!((point.area / area - 0.25).abs() < 1e-15);
            }
        }
    }

    /// Points are off the surface by 32 epsilon of the largest coordinate of the light.
    #[test]
    fn points_are_in_front_of_the_surface() {
        let transform = "transform = [{ scale = [2, 3, 1] }, { translate = [20, 0, 0] }]";
        let expected = 32.0 * f64::EPSILON * 22.0;
        let of_rectangle = config(&format!("radiance = 1\n{transform}"));
        let points = grid(&of_rectangle, &of_rectangle.transform.get_ref().get()).unwrap();
        assert!(points.iter().all(|point| point.position.z == expected));
        let text = format!("shape = \"mesh\"\nfile = \"square.obj\"\nradiance = 1\n{transform}");
        let of_mesh = config(&text);
        let placed = of_mesh.transform.get_ref().get();
        let points = mesh(&of_mesh, of_mesh.file.as_ref().unwrap(), &placed, &mut meshes()).unwrap();
        assert!(points.iter().all(|point| point.position.z == expected));
    }

    #[test]
    fn what_is_behind_is_not_affected() {
        let light = |text: &str| {
            let text = format!("transform = {{ translate = [0, 0, 5] }}\n{text}");
            build::<Lights, Area>(&text, ()).unwrap()
        };
        let white = light("radiance = [1, 3, 2]");
        for (center, radius, expected) in [
            ([0.0, 0.0, 6.0], 0.5, true),
            ([0.0, 0.0, 4.0], 0.5, false),
            ([0.0, 0.0, 4.0], 1.5, true),
            // In the plane of the light, and behind it by less than rounding.
            ([0.0, 3.0, 5.0], 0.0, true),
            ([0.0, 1e3, 5.0 - 1e-7], 0.0, true),
            ([0.0, 1e3, 5.0 - 1e-5], 0.0, false),
            ([0.0, 0.0, 4.0 - 1.5e-9], 1.0, true),
        ] {
            let found = white.affects_bounds(&emission::cube_in_ball(center, radius));
            assert_eq!(found, expected, "{center:?} {radius}");
        }
        assert!(!light("radiance = 0").affects_bounds(&Aabb::EVERYTHING));
        let bounds = white.bounds().unwrap();
        // 4 x 4 points.
        let middle = DVec3::new(0.75, 0.75, 5.0);
        assert!((bounds.bounds.max - middle).length() < 1e-13);
        assert_eq!(bounds.max_intensity, 3.0 * 0.25);
    }

    #[test]
    fn the_back_is_dark() {
        let text = "radiance = 1";
        assert_eq!(irradiance(text, DVec3::NEG_Z, DVec3::Z), 0.0);
        assert!(irradiance(text, DVec3::Z, DVec3::NEG_Z) > 0.0);
    }

    #[test]
    fn bad_values_are_refused_at_their_places() {
        for (text, place) in [
            ("radiance = -1", "-1"),
            ("radiance = 1\nsamples = 0", "0"),
            ("radiance = 1\nshape = \"cube\"", "\"cube\""),
            (
                "radiance = 1\nshape = \"sphere\"\ntransform = { scale = [1, 2, 1] }",
                "{ scale = [1, 2, 1] }",
            ),
            (
                "radiance = 1e300\ntransform = { scale = 1e10 }",
                "{ scale = 1e10 }",
            ),
        ] {
            let error = build::<Lights, Area>(text, ()).err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], place);
        }
    }
}
