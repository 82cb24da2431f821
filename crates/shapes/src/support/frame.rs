//! Object space of flat-faced shapes (plane, rectangle, disk, box) and of quadrics, with rounding
//! error bounds.

use whitstone_core::simd::select;
use whitstone_core::{Aabb, DMat3, DVec2, DVec3, NO_PRIMITIVE, Ray, ShapeHit, SurfacePart, Transform};

/// Unit roundoff: half the distance from 1 to the next number, the relative error of one rounding.
pub(crate) const UNIT: f64 = 0.5 * f64::EPSILON;

/// Corners of the polygon that represents a disk; its radius is less than a thousandth larger.
const ROUND_CORNERS: f64 = 96.0;

/// The object space of a shape whose faces are perpendicular to the object axes.
#[derive(Clone)]
pub(crate) struct Frame {
    transform: Transform,
    /// Unit normals in world space of the planes perpendicular to each object axis.
    normals: [DVec3; 3],
    /// For each plane: how far, in metres along its normal, a unit step along each object axis can
    /// deviate from the plane that rays meet.
    tilt: [DVec3; 3],
    /// Bound on the change of each object coordinate (row) by rounding on the way to world space
    /// and back, for a unit step along each object axis (column).
    slant: DMat3,
}

/// The vector of an axis: selected, because a load at a computed place has no vector form.
#[inline(always)]
fn of_axis([x, y, z]: &[DVec3; 3], axis: usize) -> DVec3 {
    let pick = |x, y, z| select(axis == 0, x, select(axis == 1, y, z));
    DVec3::new(pick(x.x, y.x, z.x), pick(x.y, y.y, z.y), pick(x.z, y.z, z.z))
}

impl Frame {
    pub(crate) fn new(transform: Transform) -> Self {
        let forward = transform.world_from_object().matrix3;
        let inverse = transform.object_from_world().matrix3;
        // The inverse is rounded, so the planes that rays meet are tilted relative to those that
        // the matrix columns span. The residual measures the tilt. Its own rounding error (three
        // products, two sums and the subtraction) is added.
        let residual = inverse * forward - DMat3::IDENTITY;
        let terms = inverse.abs() * forward.abs();
        let slant = residual.abs() + 4.0 * UNIT * terms;
        let tilt = [0, 1, 2].map(|axis| slant.row(axis) / inverse.row(axis).length());
        Self {
            normals: DVec3::AXES.map(|axis| transform.normal_to_world(axis)),
            tilt,
            slant,
            transform,
        }
    }

    /// See [`Transform::similarity_scale`].
    pub(crate) fn similarity_scale(&self) -> Option<f64> {
        self.transform.similarity_scale()
    }

    #[inline(always)]
    pub(crate) fn ray_to_object(&self, ray: &Ray) -> Ray {
        self.transform.ray_to_object(ray)
    }

    /// Transforms a world-space point to object space.
    #[inline(always)]
    pub(crate) fn point_to_object(&self, p: DVec3) -> DVec3 {
        self.transform.object_from_world().matrix3 * (p - self.transform.world_from_object().translation)
    }

    /// Intersects a ray with the plane z = 0 of object space: the ray parameter and x, y there.
    /// They are infinite for a parallel ray and NaN for a ray within the plane.
    #[inline(always)]
    pub(crate) fn meet_plane(&self, ray: &Ray) -> (f64, DVec2) {
        let inverse = &self.transform.object_from_world().matrix3;
        let origin = *inverse * (ray.origin - self.transform.world_from_object().translation);
        let direction = *inverse * ray.direction;
        let t = -origin.z / direction.z;
        (t, origin.truncate() + t * direction.truncate())
    }

    /// Whether a ray approaches the plane z = 0 of object space.
    #[inline(always)]
    pub(crate) fn approaches(&self, ray: &Ray) -> bool {
        let inverse = &self.transform.object_from_world().matrix3;
        let origin = ray.origin - self.transform.world_from_object().translation;
        let row = DVec3::new(inverse.x_axis.z, inverse.y_axis.z, inverse.z_axis.z);
        let (height, slope) = (row.dot(origin), row.dot(ray.direction));
        (height > 0.0) & (slope < 0.0) | (height < 0.0) & (slope > 0.0)
    }

    /// Unit normal in world space of the planes perpendicular to an object axis.
    #[inline(always)]
    pub(crate) fn normal(&self, axis: usize) -> DVec3 {
        of_axis(&self.normals, axis)
    }

    /// Transforms the object-space point `p` to world space, with a bound on its distance from the
    /// plane perpendicular to `axis` that rays meet.
    ///
    /// The bound: three products and three sums contribute at most four roundings of the sum of the
    /// absolute terms to each coordinate; spawning a ray along the normal adds one more; then the
    /// tilt is added.
    #[inline(always)]
    pub(crate) fn point(&self, p: DVec3, axis: usize) -> (DVec3, f64) {
        let origin = self.transform.world_from_object().translation;
        let [x, y, z] = self.columns(p);
        let terms = origin.abs() + x.abs() + y.abs() + z.abs();
        let rounding = 5.0 * UNIT * of_axis(&self.normals, axis).abs().dot(terms);
        let error = rounding + of_axis(&self.tilt, axis).dot(p.abs());
        (origin + (x + y + z), error)
    }

    /// Half the extent, along each object axis, of a box that holds the origins of all rays spawned
    /// on the faces of the cube from -1 to 1.
    ///
    /// A spawned ray starts at a point that [`Self::point`] rounds, moved along the normal by the
    /// bound on the error there. Both are largest at a corner.
    pub(crate) fn reach_of_spawned_rays(&self) -> DVec3 {
        let inverse = &self.transform.object_from_world().matrix3;
        let [x, y, z] = self.columns(DVec3::ONE).map(DVec3::abs);
        let terms = self.transform.world_from_object().translation.abs() + x + y + z;
        let rounding = inverse.abs() * (6.0 * UNIT * terms) + self.slant * DVec3::ONE;
        let offset = |axis: usize| {
            let (_, error) = self.point(DVec3::ONE, axis);
            (inverse * self.normals[axis]).abs() * error
        };
        DVec3::ONE + rounding + offset(0).max(offset(1)).max(offset(2))
    }

    /// Transforms a surface point `p` from object to world space, given its gradient: the point, a
    /// bound on its distance from the surface, and the unit normal. `slack` bounds the absolute
    /// value at `p` of the function that has this gradient.
    ///
    /// The distance to the zero of the function is its value divided by the length of its
    /// world-space gradient. The gradient is transformed by the inverse transpose. The other
    /// roundings are those of [`Self::point`].
    #[inline(always)]
    pub(crate) fn point_with_gradient(&self, p: DVec3, gradient: DVec3, slack: f64) -> (DVec3, f64, DVec3) {
        let origin = self.transform.world_from_object().translation;
        let [x, y, z] = self.columns(p);
        let across = self.transform.object_from_world().matrix3.transpose() * gradient;
        let length = across.length();
        let n = across / length;
        let terms = origin.abs() + x.abs() + y.abs() + z.abs();
        let met = (gradient.abs().dot(self.slant * p.abs()) + slack) / length;
        (origin + (x + y + z), 5.0 * UNIT * n.abs().dot(terms) + met, n)
    }

    /// Half the extent along each world axis of the ellipsoid with these semi-axes about the origin
    /// of object space, padded for rounding.
    pub(crate) fn reach_of_ellipsoid(&self, half: DVec3) -> [f64; 3] {
        let [x, y, z] = self.columns(half);
        // Exact if all but one are zero.
        [0, 1, 2].map(|i| match (x[i], y[i], z[i]) {
            (other, 0.0, 0.0) | (0.0, other, 0.0) | (0.0, 0.0, other) => other.abs(),
            (x, y, z) => libm::hypot(libm::hypot(x, y), z) * (1.0 + 4.0 * f64::EPSILON),
        })
    }

    /// World-space bounds of a disk about `center` in the plane z = center.z of object space.
    pub(crate) fn around_disk(&self, center: DVec3, radius: f64) -> Aabb {
        let reach = self.reach_of_ellipsoid(DVec3::new(radius, radius, 0.0));
        let [x, y, z] = self.columns(center);
        let origin = self.transform.world_from_object().translation;
        let low = |i: usize| {
            add_down(
                origin[i],
                add_down(add_down(x[i], y[i]), add_down(z[i], -reach[i])),
            )
        };
        let high = |i: usize| add_up(origin[i], add_up(add_up(x[i], y[i]), add_up(z[i], reach[i])));
        Aabb {
            min: DVec3::from_array([0, 1, 2].map(low)),
            max: DVec3::from_array([0, 1, 2].map(high)),
        }
    }

    /// World-space bounds of an object-space box.
    pub(crate) fn around_box(&self, min: DVec3, max: DVec3) -> Aabb {
        let matrix = self.transform.world_from_object().matrix3;
        let origin = self.transform.world_from_object().translation;
        let mut aabb = Aabb {
            min: origin,
            max: origin,
        };
        for axis in 0..3 {
            let column = matrix.col(axis);
            let (a, b) = (min[axis] * column, max[axis] * column);
            for i in 0..3 {
                aabb.min[i] = add_down(aabb.min[i], a[i].min(b[i]));
                aabb.max[i] = add_up(aabb.max[i], a[i].max(b[i]));
            }
        }
        aabb
    }

    /// World-space bounds of the points whose object coordinates are at most `half` in absolute
    /// value.
    pub(crate) fn bounds(&self, half: DVec3) -> Aabb {
        let [x, y, z] = self.columns(half).map(DVec3::abs);
        self.around([0, 1, 2].map(|i| add_up(add_up(x[i], y[i]), z[i])))
    }

    /// World-space box about the origin of object space with these half extents.
    pub(crate) fn around(&self, reach: [f64; 3]) -> Aabb {
        let center = self.transform.world_from_object().translation;
        Aabb {
            min: DVec3::from_array([0, 1, 2].map(|i| -add_up(-center[i], reach[i]))),
            max: DVec3::from_array([0, 1, 2].map(|i| add_up(center[i], reach[i]))),
        }
    }

    /// A flat face perpendicular to an object axis, as a surface part: a convex polygon with these
    /// object-space corners. `side` is the sign of its outward normal along the axis.
    pub(crate) fn face(
        &self,
        axis: usize,
        side: f64,
        corners: impl IntoIterator<Item = DVec3>,
    ) -> SurfacePart {
        SurfacePart::Polygon {
            normal: side * self.normals[axis],
            corners: corners.into_iter().map(|p| self.point(p, axis).0).collect(),
            filled: true,
        }
    }

    /// Like [`Self::face`], for a disk about the z axis of object space: a circumscribed regular
    /// polygon.
    pub(crate) fn round_face(&self, side: f64, z: f64, radius: f64) -> SurfacePart {
        let circumscribed = radius / libm::cos(std::f64::consts::PI / ROUND_CORNERS);
        let corner = |number: u32| {
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * f64::from(number) / ROUND_CORNERS);
            DVec3::new(circumscribed * cos, circumscribed * sin, z)
        };
        self.face(2, side, (0..ROUND_CORNERS as u32).map(corner))
    }

    /// The columns of the matrix, multiplied by the coordinates of `p`.
    #[inline(always)]
    pub(crate) fn columns(&self, p: DVec3) -> [DVec3; 3] {
        let m = self.transform.world_from_object().matrix3;
        [p.x * m.x_axis, p.y * m.y_axis, p.z * m.z_axis]
    }
}

/// The hit of a ray with the part of a plane selected by `inside`; a ray spawned on the plane does
/// not hit it.
#[inline(always)]
pub(crate) fn flat_hit(t: f64, prim_uv: DVec2, inside: bool, min: f64, origin_primitive: u32) -> ShapeHit {
    let counts = inside & (t > min) & (origin_primitive == NO_PRIMITIVE);
    ShapeHit {
        t: select(counts, t, f64::NAN),
        primitive: 0,
        prim_uv,
    }
}

/// The sum, rounded down if it is not exact.
pub(crate) fn add_down(a: f64, b: f64) -> f64 {
    -add_up(-a, -b)
}

/// The sum, rounded up if it is not exact; exact bounds of axis-aligned shapes stay exact.
pub(crate) fn add_up(a: f64, b: f64) -> f64 {
    let sum = a + b;
    // The exact rounding error (Knuth's TwoSum).
    let b_seen = sum - a;
    let lost = (a - (sum - b_seen)) + (b - b_seen);
    if lost > 0.0 { sum.next_up() } else { sum }
}
