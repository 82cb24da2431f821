//! The watertight ray-triangle test: all triangle intersection in the workspace is here.
//!
//! Woop, Benthin, Wald, *Watertight Ray/Triangle Intersection*, JCGT 2(1), 2013, in `f64`. A
//! permutation and a shear that depend only on the ray map it to +z. Two triangles that share an
//! edge therefore see the edge at the same two points, and their edge functions differ only in
//! sign. Rust never contracts `a * b - c * d` into a fused multiply-add by itself, which would
//! break that symmetry (one fused operation lets 1.6% of the rays at edges through).
//!
//! A ray exactly through an edge or a vertex hits every triangle there; accelerators keep the
//! lowest (shape, primitive).

use crate::Ray;
use crate::simd::{self, select};
use crate::stream::{LANES, Lanes, RayStream, Vectors};
use glam::DVec3;

/// The ray-dependent terms of the watertight test, computed once per ray.
#[derive(Clone, Copy, Debug)]
pub struct ShearedRay {
    axes: &'static [Axis; 3],
    /// Coordinates along `axes`.
    origin: [f64; 3],
    shear: DVec3,
}

/// An axis; an enumeration, so that indexing needs no bounds check.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Axis {
    /// The first.
    #[default]
    X,
    /// The second.
    Y,
    /// The third.
    Z,
}

impl Axis {
    /// The axis of the largest absolute component, the last one among ties. Branchless: directions
    /// of scattered rays are unpredictable.
    #[inline]
    pub fn longest(v: DVec3) -> Self {
        let a = v.abs();
        let [x_or_z, y_or_z] = [
            select(a.x > a.z, Self::X, Self::Z),
            select(a.y > a.z, Self::Y, Self::Z),
        ];
        select(a.x > a.y, x_or_z, y_or_z)
    }
}

/// Indexed by whether the direction is negative along z, and by the axis that becomes z.
static AXES: [[[Axis; 3]; 3]; 2] = {
    use Axis::*;
    [
        [[Y, Z, X], [Z, X, Y], [X, Y, Z]],
        [[Z, Y, X], [X, Z, Y], [Y, X, Z]],
    ]
};

/// The intersection of a ray and a triangle (a, b, c).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleHit {
    /// Ray parameter; may be negative or zero: the caller must test its interval.
    pub t: f64,
    /// Barycentric weight of b.
    pub u: f64,
    /// Barycentric weight of c.
    pub v: f64,
}

impl ShearedRay {
    /// Section 3.2 of the paper: the axis with the largest direction component becomes z; the other
    /// two keep the handedness.
    #[inline]
    pub fn new(ray: &Ray) -> Self {
        Self::along(ray, Axis::longest(ray.direction))
    }

    /// [`Self::new`] for a known axis.
    #[inline]
    pub fn along(ray: &Ray, z: Axis) -> Self {
        let (o, d) = (ray.origin.to_array(), ray.direction.to_array());
        let axes = &AXES[usize::from(d[z as usize] < 0.0)][z as usize];
        let [x, y, z] = along(axes, d);
        Self {
            axes,
            origin: along(axes, o),
            shear: DVec3::new(x / z, y / z, 1.0 / z),
        }
    }

    /// The world axes that become x, y and z.
    #[inline]
    pub fn axes(&self) -> &'static [Axis; 3] {
        self.axes
    }

    /// Shears a point to the test's coordinates: x and y are offsets from the ray, z runs along it.
    /// Other geometry bounded by edges is watertight next to triangles if it uses these
    /// coordinates.
    #[inline]
    pub fn shear(&self, p: DVec3) -> DVec3 {
        self.shear_turned(along(self.axes, p.to_array()))
    }

    /// [`Self::shear`] for coordinates along [`Self::axes`].
    #[inline]
    fn shear_turned(&self, [x, y, z]: [f64; 3]) -> DVec3 {
        let [x, y, z] = [x - self.origin[0], y - self.origin[1], z - self.origin[2]];
        DVec3::new(x - self.shear.x * z, y - self.shear.y * z, z)
    }

    /// The intersection inside or on the border of the triangle, from either side. `None` for
    /// degenerate triangles and those seen edge-on.
    #[inline]
    pub fn intersect(&self, a: DVec3, b: DVec3, c: DVec3) -> Option<TriangleHit> {
        let turned = |p: DVec3| along(self.axes, p.to_array());
        self.intersect_turned([turned(a), turned(b), turned(c)])
    }

    /// [`Self::intersect`] for corners given by their coordinates along [`Self::axes`].
    #[inline(always)]
    pub fn intersect_turned(&self, [a, b, c]: [[f64; 3]; 3]) -> Option<TriangleHit> {
        // Not `map`, which is a call in builds with debug assertions.
        let [a, b, c] = [self.shear_turned(a), self.shear_turned(b), self.shear_turned(c)];
        // Scaled barycentric coordinates: edge functions opposite a, b and c.
        let weight_a = c.x * b.y - c.y * b.x;
        let weight_b = a.x * c.y - a.y * c.x;
        let weight_c = b.x * a.y - b.y * a.x;
        let lowest = less(less(weight_a, weight_b), weight_c);
        let highest = greater(greater(weight_a, weight_b), weight_c);
        let determinant = weight_a + weight_b + weight_c;
        // All of one sign and not all zero; negated so that NaN (from infinite coordinates) is a
        // miss.
        let one_side = (lowest < 0.0) != (highest > 0.0);
        if !(one_side & (determinant.abs() < f64::INFINITY)) {
            return None;
        }
        let place = place([a, b, c], [weight_a, weight_b, weight_c], determinant);
        Some(TriangleHit {
            t: place.z * self.shear.z,
            u: place.x,
            v: place.y,
        })
    }
}

/// Coordinates along these axes. They are passed by reference, so that indexing needs no bounds
/// check.
#[inline(always)]
fn along(axes: &[Axis; 3], v: [f64; 3]) -> [f64; 3] {
    [v[axes[0] as usize], v[axes[1] as usize], v[axes[2] as usize]]
}

/// The minimum, as a single instruction with a defined sign of zero. If either is NaN, the second.
#[inline(always)]
fn less(x: f64, y: f64) -> f64 {
    select(x < y, x, y)
}

/// The maximum; see [`less`].
#[inline(always)]
fn greater(x: f64, y: f64) -> f64 {
    select(x > y, x, y)
}

/// The crossing of a line and a triangle (a, b, c), and its side: the front is where the corners
/// run counter-clockwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piercing {
    /// The intersection, as for a ray.
    pub at: TriangleHit,
    /// Whether the line arrives from the front.
    pub from_front: bool,
}

impl ShearedRay {
    /// The crossing of the whole line with the triangle.
    ///
    /// For a line through an edge or a vertex, equally many of the adjacent triangles are crossed
    /// from the front and from behind, if both ends of the line are outside. The crossings of a
    /// closed mesh therefore always pair up.
    ///
    /// Exact signs of the edge functions decide the sides of edges. A zero is resolved as if the
    /// line passed at an infinitesimal distance (Edelsbrunner and Mücke, *Simulation of
    /// simplicity*, ACM Transactions on Graphics 9(1), 1990).
    pub fn pierce(&self, a: DVec3, b: DVec3, c: DVec3) -> Option<Piercing> {
        let (a, b, c) = (self.shear(a), self.shear(b), self.shear(c));
        let [of_a, of_b, of_c] = [side(b, c)?, side(c, a)?, side(a, b)?];
        if of_a != of_b || of_b != of_c {
            return None;
        }
        let weights = [
            c.x * b.y - c.y * b.x,
            a.x * c.y - a.y * c.x,
            b.x * a.y - b.y * a.x,
        ];
        let determinant = weights[0] + weights[1] + weights[2];
        let place = if determinant != 0.0 && determinant.is_finite() {
            place([a, b, c], weights, determinant)
        } else {
            DVec3::new(1.0, 1.0, a.z + b.z + c.z) / 3.0
        };
        let at = TriangleHit {
            t: place.z * self.shear.z,
            u: place.x,
            v: place.y,
        };
        // NaN results from unbounded coordinates.
        (!at.t.is_nan()).then_some(Piercing {
            at,
            from_front: !of_a,
        })
    }
}

/// Whether the line, at (0, 0) in x and y, is to the left of the edge from p to q; `None` if the
/// edge projects to a point.
fn side(p: DVec3, q: DVec3) -> Option<bool> {
    let (one, other) = (p.x * q.y, p.y * q.x);
    // Distinct rounded products are ordered like the exact ones.
    if one != other {
        return Some(one > other);
    }
    // The rounding errors of the products decide; if these are equal too, the line is moved by (e,
    // e²): the function grows by e (p.y - q.y) + e² (q.x - p.x).
    let rest = (p.x.mul_add(q.y, -one), p.y.mul_add(q.x, -other));
    let (greater, less) = [rest, (p.y, q.y), (q.x, p.x)].into_iter().find(|(a, b)| a != b)?;
    Some(greater > less)
}

/// Weights of b and c, and the depth, at the intersection of the ray and a triangle.
///
/// The edge functions have rounding errors proportional to products of the triangle's lengths.
/// Divided by the area of a sliver, these move the point off the ray, along the sliver, and so
/// change its depth: by 1e-10 for an aspect ratio of a million. The offset from the ray is known to
/// 1e-16, so one Newton step removes it. The depth is clamped to that of the triangle, on which the
/// bounds of conservative tests rely.
#[inline(always)]
fn place([a, b, c]: [DVec3; 3], [wa, wb, wc]: [f64; 3], determinant: f64) -> DVec3 {
    let reciprocal = 1.0 / determinant;
    let [wa, wb, wc] = [wa * reciprocal, wb * reciprocal, wc * reciprocal];
    let (offset_x, offset_y) = (wa * a.x + wb * b.x + wc * c.x, wa * a.y + wb * b.y + wc * c.y);
    let (e, f) = (b - a, c - a);
    let u = (f.y * offset_x - f.x * offset_y) * reciprocal;
    let v = (e.x * offset_y - e.y * offset_x) * reciprocal;
    let depth = (wa * a.z + wb * b.z + wc * c.z) + (u * e.z + v * f.z);
    let (least, most) = (less(less(a.z, b.z), c.z), greater(greater(a.z, b.z), c.z));
    let within = |x: f64, low: f64, high: f64| less(greater(x, low), high);
    DVec3::new(
        within(wb + u, 0.0, 1.0),
        within(wc + v, 0.0, 1.0),
        within(depth, least, most),
    )
}

/// [`ShearedRay`] for every ray of a stream.
#[repr(align(64))]
pub struct ShearedStream {
    /// The axis that becomes z.
    axis: Lanes<u32>,
    /// Whether the other two axes are exchanged.
    exchanged: Lanes<bool>,
    shear: Vectors,
}

impl ShearedStream {
    /// See [`ShearedRay::new`].
    pub fn new(rays: &RayStream) -> Self {
        let mut sheared = Self {
            axis: [0; LANES],
            exchanged: [false; LANES],
            shear: Vectors::default(),
        };
        simd::dispatch(
            #[inline(always)]
            || {
                for lane in 0..rays.len.min(LANES) {
                    let d = rays.direction.get(lane);
                    let a = d.abs();
                    let x_or_z = select(a.x > a.z, 0, 2);
                    let y_or_z = select(a.y > a.z, 1, 2);
                    let axis = select(a.x > a.y, x_or_z, y_or_z);
                    let d = turned(d, axis);
                    let exchanged = d.x < 0.0;
                    let (x, y) = (select(exchanged, d.z, d.y), select(exchanged, d.y, d.z));
                    sheared.axis[lane] = axis;
                    sheared.exchanged[lane] = exchanged;
                    sheared.shear.set(lane, DVec3::new(x / d.x, y / d.x, 1.0 / d.x));
                }
            },
        );
        sheared
    }

    /// [`ShearedRay::intersect`] for one lane, branchless: `t` is NaN for a miss.
    #[inline(always)]
    pub fn intersect(&self, rays: &RayStream, lane: usize, [a, b, c]: [DVec3; 3]) -> TriangleHit {
        let (origin, shear) = (rays.origin.get(lane), self.shear.get(lane));
        let (axis, exchanged) = (self.axis[lane], self.exchanged[lane]);
        let sheared = |corner: DVec3| {
            let p = turned(corner - origin, axis);
            let (x, y) = (select(exchanged, p.z, p.y), select(exchanged, p.y, p.z));
            DVec3::new(x - shear.x * p.x, y - shear.y * p.x, p.x)
        };
        let [a, b, c] = [sheared(a), sheared(b), sheared(c)];
        let weight_a = c.x * b.y - c.y * b.x;
        let weight_b = a.x * c.y - a.y * c.x;
        let weight_c = b.x * a.y - b.y * a.x;
        let any_negative = (weight_a < 0.0) | (weight_b < 0.0) | (weight_c < 0.0);
        let any_positive = (weight_a > 0.0) | (weight_b > 0.0) | (weight_c > 0.0);
        let determinant = weight_a + weight_b + weight_c;
        let hit = !(any_negative & any_positive) & (determinant != 0.0) & (determinant.abs() < f64::INFINITY);
        let place = place([a, b, c], [weight_a, weight_b, weight_c], determinant);
        TriangleHit {
            t: select(hit, place.z * shear.z, f64::NAN),
            u: place.x,
            v: place.y,
        }
    }
}

/// The coordinates of `p` along this axis and the next two in cyclic order.
#[inline(always)]
fn turned(p: DVec3, axis: u32) -> DVec3 {
    let pick = |x, y, z| select(axis == 0, x, select(axis == 1, y, z));
    DVec3::new(pick(p.x, p.y, p.z), pick(p.y, p.z, p.x), pick(p.z, p.x, p.y))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const A: DVec3 = DVec3::new(0.0, 0.0, 0.0);
    const B: DVec3 = DVec3::new(1.0, 0.0, 0.0);
    const C: DVec3 = DVec3::new(0.0, 1.0, 0.0);

    fn hit(origin: [f64; 3], direction: [f64; 3]) -> Option<TriangleHit> {
        ShearedRay::new(&Ray::new(origin.into(), direction.into())).intersect(A, B, C)
    }

    #[test]
    fn inside_outside_and_behind() {
        let found = hit([0.25, 0.5, 2.0], [0.0, 0.0, -1.0]).unwrap();
        assert_eq!(
            found,
            TriangleHit {
                t: 2.0,
                u: 0.25,
                v: 0.5
            }
        );
        assert!(hit([0.75, 0.5, 2.0], [0.0, 0.0, -1.0]).is_none());
        assert_eq!(hit([0.25, 0.5, 2.0], [0.0, 0.0, 1.0]).unwrap().t, -2.0);
        assert!(hit([0.25, 0.5, 2.0], [1.0, 0.0, 0.0]).is_none());
    }

    #[test]
    fn degenerate_triangles_are_never_hit() {
        let ray = ShearedRay::new(&Ray::new(DVec3::Z, DVec3::NEG_Z));
        assert!(ray.intersect(A, A, A).is_none());
        assert!(ray.intersect(A, B, B).is_none());
        assert!(ray.intersect(A, B, DVec3::splat(f64::NAN)).is_none());
    }

    proptest! {
        /// A triangle fan; rays aimed at its centre vertex and edges must not leak through.
        #[test]
        fn a_fan_does_not_leak(
            eye in prop::array::uniform3(-10.0..10.0f64),
            apex in prop::array::uniform3(-1.0..1.0f64),
            along in 0.0..1.0f64,
            spoke in 0usize..7,
        ) {
            let eye = DVec3::from(eye) + DVec3::Z * 20.0;
            let apex = DVec3::from(apex);
            let rim: Vec<DVec3> = (0..7)
                .map(|i| {
                    let (s, c) = (i as f64 * std::f64::consts::TAU / 7.0).sin_cos();
                    DVec3::new(3.0 * c, 3.0 * s, 0.3 * c * s)
                })
                .collect();
            for target in [apex, apex.lerp(rim[spoke], along * 0.999)] {
                let ray = ShearedRay::new(&Ray::new(eye, target - eye));
                let hits = (0..7).filter(|&i| {
                    ray.intersect(apex, rim[i], rim[(i + 1) % 7]).is_some()
                });
                prop_assert!(hits.count() >= 1);
            }
        }

        /// The reported hit lies on the ray and on the triangle.
        #[test]
        fn the_hit_lies_on_the_ray_and_on_the_triangle(
            origin in prop::array::uniform3(-5.0..5.0f64),
            (u, v) in (0.01..0.48f64, 0.01..0.48f64),
        ) {
            let (a, b, c) = (DVec3::new(-1.0, 0.2, 7.0), DVec3::new(2.0, -0.5, 8.0), DVec3::new(0.1, 2.0, 6.5));
            let target = (1.0 - u - v) * a + u * b + v * c;
            let ray = Ray::new(origin.into(), target - DVec3::from(origin));
            let hit = ShearedRay::new(&ray).intersect(a, b, c).unwrap();
            prop_assert!((hit.t - 1.0).abs() < 1e-12);
            prop_assert!((hit.u - u).abs() < 1e-11 && (hit.v - v).abs() < 1e-11);
        }
    }
}
