//! Textbook intersection formulas in single, double or double-double precision, deliberately
//! without care for rounding errors. Only the inverses of transforms are computed with care, so
//! that they are the same matrix in each precision.
//!
//! Sources: Glassner (ed.), *An Introduction to Ray Tracing* (1989), ch. 2 and 3, and those named
//! in the files. Benchmarks use them as the baseline. Every accuracy test must find them
//! inaccurate.

mod conic;
mod csg;
mod double_double;
mod flat;
mod march;
pub mod notes;
mod outline;
mod patch;
mod quartic;
mod round;
mod solid;

use crate::shapes::level::{fractal, implicit, isosurface};
use crate::shapes::{cone, csg as exact_csg, cylinder, ellipsoid, heightfield, hyperboloid, lathe, mesh};
use crate::shapes::{paraboloid, patch as exact_patch, polygon, prism, quadric, sphere, torus, triangle};
use conic::Conic;
pub use double_double::DoubleDouble;
use smallvec::SmallVec;
use std::ops::{Add, Div, Mul, Neg, Sub};
use whitstone_core::config::{GroupRef, decode};
use whitstone_core::{DAffine3, DVec3, SceneError, SceneErrors};
use whitstone_scene::{Description, PluginTable};

/// `f32`, `f64` or [`DoubleDouble`].
pub trait Real:
    Copy
    + PartialOrd
    + Send
    + Sync
    + 'static
    + Neg<Output = Self>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
{
    /// Twice the largest relative error of a rounding.
    const EPSILON: f64;
    /// π.
    const PI: Self;
    /// The nearest number of this precision.
    fn of(x: f64) -> Self;
    /// The nearest number of this precision.
    fn of_wide(x: DoubleDouble) -> Self;
    /// The nearest double.
    fn to_f64(self) -> f64;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// Cube root.
    fn cbrt(self) -> Self;
    /// Cosine of an angle in radians.
    fn cos(self) -> Self;
    /// Tangent of an angle in radians.
    fn tan(self) -> Self;
    /// Arc cosine in radians.
    fn acos(self) -> Self;
    /// Exponential function.
    fn exp(self) -> Self;
    /// A power of a positive number.
    fn powf(self, exponent: Self) -> Self;
}

macro_rules! real {
    ($($float:ident)*) => { $(
        impl Real for $float {
            const EPSILON: f64 = $float::EPSILON as f64;
            const PI: Self = std::$float::consts::PI;
            #[inline]
            fn of(x: f64) -> Self {
                x as Self
            }
            #[inline]
            fn of_wide(x: DoubleDouble) -> Self {
                x.to_f64() as Self
            }
            #[inline]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
            #[inline]
            fn sqrt(self) -> Self {
                self.sqrt()
            }
            #[inline]
            fn abs(self) -> Self {
                self.abs()
            }
            #[inline]
            fn cbrt(self) -> Self {
                self.cbrt()
            }
            #[inline]
            fn cos(self) -> Self {
                self.cos()
            }
            #[inline]
            fn tan(self) -> Self {
                self.tan()
            }
            #[inline]
            fn acos(self) -> Self {
                self.acos()
            }
            #[inline]
            fn exp(self) -> Self {
                self.exp()
            }
            #[inline]
            fn powf(self, exponent: Self) -> Self {
                self.powf(exponent)
            }
        }
    )* };
}

real!(f32 f64);

/// A point or a direction.
pub type Vector<R> = [R; 3];

#[inline]
fn vector<R: Real>(v: [f64; 3]) -> Vector<R> {
    v.map(R::of)
}

#[inline]
fn dot<R: Real>(a: Vector<R>, b: Vector<R>) -> R {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline]
fn minus<R: Real>(a: Vector<R>, b: Vector<R>) -> Vector<R> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline]
fn cross<R: Real>(a: Vector<R>, b: Vector<R>) -> Vector<R> {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[inline]
fn at<R: Real>(o: Vector<R>, d: Vector<R>, t: R) -> Vector<R> {
    [o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2]]
}

/// Roots in ascending order.
type Roots<R> = SmallVec<[R; 8]>;

/// A textbook intersection routine.
pub trait Textbook<R: Real>: Send + Sync {
    /// The least positive ray parameter of a hit.
    fn intersect(&self, o: Vector<R>, d: Vector<R>) -> Option<R>;

    /// All roots on the line in ascending order, entries and exits by turns. Only solids need to
    /// implement it.
    fn roots(&self, o: Vector<R>, d: Vector<R>) -> SmallVec<[R; 8]> {
        self.intersect(o, d).into_iter().collect()
    }

    /// Whether the line is inside the solid at t = -infinity.
    fn starts_inside(&self, _: Vector<R>, _: Vector<R>) -> bool {
        false
    }
}

/// The smaller one that is positive. `first` must not be greater than `second`.
#[inline]
fn first_positive<R: Real>(first: R, second: R) -> Option<R> {
    let zero = R::of(0.0);
    if first > zero {
        Some(first)
    } else if second > zero {
        Some(second)
    } else {
        None
    }
}

/// The matrix from world space to object space by rows, with its translation, rounded.
struct IntoObject<R>([[R; 4]; 3]);

/// The rows of the inverse, from that in double precision by one step of Newton's method.
fn inverse(map: &DAffine3) -> [[DoubleDouble; 4]; 3] {
    let axes = [0, 1, 2];
    let near = map.matrix3.inverse();
    let near = axes.map(|i| near.row(i).to_array());
    // The negative of the product of both, which is almost the identity.
    let rest = near.map(|row| {
        axes.map(|j| {
            let column = map.matrix3.col(j).to_array();
            axes.iter().fold(DoubleDouble::of(0.0), |sum, &k| {
                sum - DoubleDouble::product(row[k], column[k])
            })
        })
    });
    axes.map(|i| {
        let row = axes.map(|j| {
            let own = DoubleDouble::of(2.0 * near[i][j]);
            let product = |k: usize| rest[i][k] * DoubleDouble::of(near[k][j]);
            own + product(0) + product(1) + product(2)
        });
        let moved = |k: usize| row[k] * DoubleDouble::of(map.translation[k]);
        [row[0], row[1], row[2], -(moved(0) + moved(1) + moved(2))]
    })
}

impl<R: Real> IntoObject<R> {
    fn new(world_from_object: &DAffine3) -> Self {
        Self(inverse(world_from_object).map(|row| row.map(R::of_wide)))
    }

    #[inline]
    fn ray(&self, o: Vector<R>, d: Vector<R>) -> (Vector<R>, Vector<R>) {
        let direction = |[a, b, c, _]: &[R; 4]| *a * d[0] + *b * d[1] + *c * d[2];
        let point = |[a, b, c, e]: &[R; 4]| *a * o[0] + *b * o[1] + *c * o[2] + *e;
        let [x, y, z] = &self.0;
        (
            [point(x), point(y), point(z)],
            [direction(x), direction(y), direction(z)],
        )
    }
}

/// A shape in object space with its transform.
struct Placed<R, S> {
    into: IntoObject<R>,
    shape: S,
}

impl<R: Real, S: Textbook<R>> Textbook<R> for Placed<R, S> {
    fn intersect(&self, o: Vector<R>, d: Vector<R>) -> Option<R> {
        let (o, d) = self.into.ray(o, d);
        self.shape.intersect(o, d)
    }

    fn roots(&self, o: Vector<R>, d: Vector<R>) -> SmallVec<[R; 8]> {
        let (o, d) = self.into.ray(o, d);
        self.shape.roots(o, d)
    }

    fn starts_inside(&self, o: Vector<R>, d: Vector<R>) -> bool {
        let (o, d) = self.into.ray(o, d);
        self.shape.starts_inside(o, d)
    }
}

/// The textbook implementation of a shape of a scene.
///
/// # Errors
///
/// As [`crate::Oracle::new`].
pub fn textbook<R: Real>(
    description: &Description<'_>,
    number: usize,
) -> Result<Box<dyn Textbook<R>>, SceneErrors> {
    let shape = &description.shapes[number];
    of_table(description, &shape.plugin, shape.transform.world_from_object())
}

fn of_table<R: Real>(
    description: &Description<'_>,
    plugin: &PluginTable<'_>,
    map: &DAffine3,
) -> Result<Box<dyn Textbook<R>>, SceneErrors> {
    let table = &plugin.table;
    let world = |p: [f64; 3]| map.transform_point3(DVec3::from_array(p)).to_array();
    let triangles = |all: &[[[f64; 3]; 3]]| -> Box<dyn Textbook<R>> {
        Box::new(flat::Triangles::new(all.iter().map(|corners| corners.map(world))))
    };
    fn placed<R: Real>(map: &DAffine3, shape: impl Textbook<R> + 'static) -> Box<dyn Textbook<R>> {
        let into = IntoObject::new(map);
        Box::new(Placed { into, shape })
    }
    Ok(match plugin.name.as_str() {
        "sphere" => {
            let sphere: sphere::Sphere = decode(table)?;
            let lengths = [0, 1, 2].map(|axis| map.matrix3.col(axis).length());
            // Under a non-uniform scale it is no sphere in world space.
            if lengths
                .iter()
                .any(|length| (length / lengths[0] - 1.0).abs() > 1e-12)
            {
                return Ok(placed(map, round::Sphere::new(sphere.center, sphere.radius)));
            }
            let radius = sphere.radius * map.matrix3.x_axis.length();
            Box::new(round::Sphere::new(world(sphere.center), radius))
        }
        "plane" => placed(map, flat::Plane),
        "rectangle" => placed(map, flat::Rectangle),
        "disk" => placed(map, flat::Disk),
        "box" => placed(map, solid::Cuboid),
        "triangle" => triangles(&[decode::<triangle::Triangle>(table)?.vertices]),
        "mesh" => triangles(&mesh::read(description, &decode(table)?)?.triangles),
        "heightfield" => triangles(
            &decode::<heightfield::Heightfield>(table)?
                .triangles(description)?
                .0,
        ),
        "polygon" => {
            let polygon: polygon::Polygon = decode(table)?;
            Box::new(flat::Polygon::new(
                polygon.vertices.into_iter().map(world).collect(),
            ))
        }
        "fractal" => placed(map, march::March(decode::<fractal::Fractal>(table)?.shape())),
        "implicit" => placed(map, march::March(decode::<implicit::Implicit>(table)?.shape())),
        "isosurface" => {
            let config: isosurface::Config = decode(table)?;
            placed(map, march::March(config.read(description)?))
        }
        "ellipsoid" => placed(map, Conic::ellipsoid(&decode::<ellipsoid::Ellipsoid>(table)?)),
        "cylinder" => placed(map, Conic::cylinder(&decode::<cylinder::Cylinder>(table)?)),
        "cone" => placed(map, Conic::cone(&decode::<cone::Cone>(table)?)),
        "paraboloid" => placed(map, Conic::paraboloid(&decode::<paraboloid::Paraboloid>(table)?)),
        "hyperboloid" => placed(
            map,
            Conic::hyperboloid(&decode::<hyperboloid::Hyperboloid>(table)?),
        ),
        "quadric" => placed(map, Conic::quadric(&decode::<quadric::Quadric>(table)?)),
        "torus" => {
            let torus: torus::Torus = decode(table)?;
            placed(map, round::Torus::new(torus.major_radius, torus.minor_radius))
        }
        "prism" => placed(map, outline::Prism::new(&decode::<prism::Prism>(table)?)),
        "lathe" => placed(map, outline::Lathe::new(&decode::<lathe::Lathe>(table)?)),
        "patch" => {
            let nets = decode::<exact_patch::Patches>(table)?.read()?;
            placed(map, patch::Patches::new(&nets.0))
        }
        "csg" => {
            let config: exact_csg::Config = decode(table)?;
            let operands = config.operands(description)?;
            let built: Result<_, SceneErrors> = operands
                .iter()
                .map(|(plugin, own)| of_table(description, plugin, &(*map * *own)))
                .collect();
            Box::new(csg::Csg::new(config.operation, built?))
        }
        "instance" => {
            #[derive(serde::Deserialize)]
            struct Config {
                group: GroupRef,
            }
            let config: Config = decode(table)?;
            let group = description.groups.get(&config.group.id);
            let group = group.ok_or_else(|| SceneError::at(config.group.span.clone(), "no such group"))?;
            let shapes = group.shapes.iter().map(|shape| {
                of_table(
                    description,
                    &shape.plugin,
                    &(*map * *shape.transform.world_from_object()),
                )
            });
            let shapes: Result<_, SceneErrors> = shapes.collect();
            Box::new(Several(shapes?))
        }
        other => {
            let message = format!("there is no textbook form of the shape \"{other}\"");
            return Err(SceneError::at(plugin.name_span.clone(), message).into());
        }
    })
}

/// Several shapes; the nearest hit wins.
struct Several<R>(Vec<Box<dyn Textbook<R>>>);

impl<R: Real> Textbook<R> for Several<R> {
    fn intersect(&self, o: Vector<R>, d: Vector<R>) -> Option<R> {
        let hits = self.0.iter().filter_map(|shape| shape.intersect(o, d));
        hits.reduce(|a, b| if b < a { b } else { a })
    }
}
