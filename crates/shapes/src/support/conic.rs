//! Common code of the quadrics: `sum of l_i y_i² + 2 g_i y_i + k = 0` in canonical space, clipped
//! by an object-space box, with or without caps.
//!
//! Rays are transformed to canonical space; transforming the matrix to world space instead would
//! lose all digits of stretched shapes. The ray is reparameterised from its point nearest to the
//! center, clamped to the box, so that the squares of distant origins do not cancel. The
//! discriminant is Kahan's (*On the cost of floating-point computation without extra-precise
//! arithmetic*, 2004); the roots are the non-cancelling forms of Press et al., *Numerical Recipes*,
//! 5.6.

use crate::support::frame::{Frame, UNIT};
use crate::support::near::{comes_near_ball, goes_on};
use whitstone_core::simd::select;
use whitstone_core::{
    Aabb, DMat3, DVec2, DVec3, NO_PRIMITIVE, PreliminaryIntersection, Ray, SceneError, ShapeHit, ShapeKernel,
    Spans, SurfaceAttributes, SurfaceInteraction, SurfacePart, Transform, solid,
};

/// Upper limit on the coordinates of finite bounds, in metres: keeps squares finite.
const MAX_REACH: f64 = 1e150;

/// Condition number of a transform above which the nearest point of a ray to the center is computed
/// in two steps: the rounding error of the first step grows with the condition number.
const STRETCHED: f64 = (1u64 << 40) as f64;
/// A condition number for which the second step is not enough.
const MAX_STRETCH: f64 = 1e30;

/// A quadric in object space. Its inside is where the function is at most 0.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Conic {
    /// Orthonormal rows: the axes of canonical space.
    pub(crate) turn: DMat3,
    /// Origin of canonical space.
    pub(crate) center: DVec3,
    /// Coefficients of the squares.
    pub(crate) square: DVec3,
    /// Half the coefficients of the linear terms.
    pub(crate) linear: DVec3,
    pub(crate) constant: f64,
    /// The clipping box, infinite along some axes.
    pub(crate) min: DVec3,
    pub(crate) max: DVec3,
    /// Whether caps close the shape where it is clipped.
    pub(crate) caps: bool,
    /// The box face that is primitive 1.
    pub(crate) first_face: u32,
    /// The normal where the gradient is zero.
    pub(crate) tip: DVec3,
}

/// Maps a surface point in object space to texture coordinates.
pub(crate) trait Mapping: Clone + Send + Sync {
    fn uv(&self, p: DVec3, primitive: u32) -> DVec2;

    /// See [`whitstone_core::Shape::parts`].
    fn parts(&self, frame: &Frame) -> Vec<SurfacePart> {
        let _ = frame;
        Vec::new()
    }
}

/// A quadric in world space. Primitive 0 is the quadric itself; the others are the caps.
#[derive(Clone)]
pub(crate) struct Clipped<M> {
    frame: Frame,
    conic: Conic,
    /// Whether the transform is [`STRETCHED`].
    stretched: bool,
    mapping: M,
    bounds: Aabb,
    /// Center and radius of a bounding sphere.
    center: DVec3,
    radius: f64,
}

/// An entry into the inside or an exit from it.
#[derive(Clone, Copy)]
struct End {
    t: f64,
    primitive: u32,
}

/// An interval of a line on which it is inside, valid if `there` is set.
#[derive(Clone, Copy)]
struct Part {
    enter: End,
    exit: End,
    there: bool,
}

impl Conic {
    /// Intersects a line with the box; the entry lies behind the exit if the line misses it.
    #[inline(always)]
    fn slabs(&self, origin: DVec3, direction: DVec3) -> [End; 2] {
        let mut entry = End {
            t: f64::NEG_INFINITY,
            primitive: 0,
        };
        let mut exit = End {
            t: f64::INFINITY,
            primitive: 0,
        };
        for axis in 0..3_u32 {
            let (o, d) = (origin[axis as usize], direction[axis as usize]);
            let (min, max) = (self.min[axis as usize], self.max[axis as usize]);
            let downwards = d.is_sign_negative();
            let near = (select(downwards, max, min) - o) / d;
            let far = (select(downwards, min, max) - o) / d;
            let face = (2 * axis + 1).wrapping_sub(self.first_face);
            // As in `box`: 0/0 has no effect, and the lowest face wins.
            let later = near > entry.t;
            entry.t = select(later, near, entry.t);
            entry.primitive = select(later, face.wrapping_add(u32::from(downwards)), entry.primitive);
            let sooner = far < exit.t;
            exit.t = select(sooner, far, exit.t);
            exit.primitive = select(sooner, face.wrapping_add(u32::from(!downwards)), exit.primitive);
        }
        [entry, exit]
    }

    /// The two intervals, in object space, on which the line of a ray may be inside.
    #[inline(always)]
    fn parts(&self, ray: &Ray, stretched: bool) -> [Part; 2] {
        let [entry, exit] = self.slabs(ray.origin, ray.direction);
        let start = self.turn * (ray.origin - self.center);
        let d = self.turn * ray.direction;
        let weight = self.square.abs();
        let from_nearest = |y: DVec3| (weight * y).dot(d) / (weight * d).dot(d);
        let nearest = -from_nearest(start);
        // NaN (no squared term determines the nearest point) is ignored.
        let moved = nearest.max(entry.t).min(exit.t);
        // From here on t is measured from `near`, not the ray origin: the rounding error of a
        // distant origin would make the order of close roots random where the box is thin.
        let near = ray.origin + moved * ray.direction;
        let (near, moved) = if stretched {
            let rest = -from_nearest(self.turn * (near - self.center));
            // Where the first step was cut off at the box, so is this one.
            let rest = select(moved == nearest, rest, 0.0);
            (near + rest * ray.direction, moved + rest)
        } else {
            (near, moved)
        };
        let [entry, exit] = self.slabs(near, ray.direction);
        let y = self.turn * (near - self.center);
        // -0 would flip the sign of the root at infinity.
        let a = (self.square * d).dot(d) + 0.0;
        let b = (self.square * y + self.linear).dot(d);
        let c = (self.square * y).dot(y) + 2.0 * self.linear.dot(y) + self.constant;
        let ac = a * c;
        let discriminant = b.mul_add(b, -ac) + (-a).mul_add(c, ac);
        let q = -(b + discriminant.sqrt().copysign(b));
        // One root is infinite if the line meets the surface only once, and NaN if both roots are
        // equal.
        let (one, other) = (c / q, q / a);
        let (first, last) = (one.min(other), one.max(other));

        let rootless = discriminant.is_nan() | (discriminant < 0.0) | ((a == 0.0) & (b == 0.0));
        let all = rootless & (c <= 0.0);
        let (between, around) = (!rootless & (a >= 0.0), !rootless & (a < 0.0));
        let (low, high) = (f64::NEG_INFINITY, f64::INFINITY);
        let enter = |t: f64| {
            let surface = t >= entry.t;
            End {
                t: select(surface, t, entry.t),
                primitive: select(surface, 0, entry.primitive),
            }
        };
        let leave = |t: f64| {
            let surface = t <= exit.t;
            End {
                t: select(surface, t, exit.t),
                primitive: select(surface, 0, exit.primitive),
            }
        };
        // A touching point counts as a hit, except between two intervals: the line does not enter
        // there.
        let part = |enter: End, exit: End| {
            // Where a cap and the quadric meet at a grazing angle, equal parameters of a ray from a
            // distant origin decide nothing; test the position instead.
            let rim = (enter.primitive == 0) != (exit.primitive == 0);
            let touched = (enter.t == exit.t) & !around & (!rim | self.holds(near + enter.t * ray.direction));
            let there = (enter.t < exit.t) | touched;
            let [enter, exit] = [enter, exit].map(|end| End {
                t: moved + end.t,
                ..end
            });
            Part { enter, exit, there }
        };
        [
            part(
                enter(select(between, first, select(all | around, low, high))),
                leave(select(
                    between,
                    last,
                    select(all, high, select(around, first, low)),
                )),
            ),
            part(
                enter(select(around, last, high)),
                leave(select(around, high, low)),
            ),
        ]
    }

    /// Whether a point, clamped to the box, is on the quadric or inside, up to a few roundings.
    #[inline(always)]
    fn holds(&self, p: DVec3) -> bool {
        let y = self.turn * (p.max(self.min).min(self.max) - self.center);
        let (squares, lines) = (self.square * y * y, 2.0 * self.linear * y);
        let value = squares.element_sum() + lines.element_sum() + self.constant;
        let terms = squares.abs().element_sum() + lines.abs().element_sum() + self.constant.abs();
        value <= 64.0 * UNIT * terms
    }

    /// Whether a ray that starts on a primitive goes inside.
    #[inline(always)]
    fn goes_inside(&self, ray: &Ray, primitive: u32) -> bool {
        let y = self.turn * (ray.origin - self.center);
        let across = (self.square * y + self.linear).dot(self.turn * ray.direction);
        let outward = self.face_normal(primitive).dot(ray.direction);
        select(primitive == 0, across, outward) < 0.0
    }

    /// Outward normal of a cap in object space.
    #[inline(always)]
    fn face_normal(&self, primitive: u32) -> DVec3 {
        let face = primitive.wrapping_add(self.first_face).wrapping_sub(1);
        let side = select(face & 1 == 0, -1.0, 1.0);
        let along = |axis| select(face >> 1 == axis, side, 0.0);
        DVec3::new(along(0), along(1), along(2))
    }

    /// Projects `p` onto the quadric: the point, half the gradient, and a bound on half the
    /// absolute function value there, all in object space.
    ///
    /// Uses Newton's method along the gradient. Two steps leave only rounding errors; four suffice
    /// even if `p` is off by a tenth of the thinnest dimension, as with a very distant ray origin.
    /// The error of the function is at most six roundings of the sum of its absolute terms; the
    /// error of the point comes from two rotations and a sum.
    #[inline(always)]
    fn project(&self, p: DVec3) -> (DVec3, DVec3, f64) {
        let mut y = self.turn * (p - self.center);
        for _ in 0..4 {
            let half = self.square * y + self.linear;
            let value = y.dot(half) + self.linear.dot(y) + self.constant;
            let length = half.length_squared();
            y -= select(length > 0.0, value / (2.0 * length), 0.0) * half;
        }
        let half = self.square * y + self.linear;
        let terms =
            (self.square * y).abs().dot(y.abs()) + 2.0 * self.linear.abs().dot(y.abs()) + self.constant.abs();
        let moved = y.abs().element_sum() + self.center.abs().element_sum();
        let slack = UNIT * (3.0 * terms + 5.0 * half.abs().element_sum() * moved);
        let back = self.turn.transpose();
        (back * y + self.center, back * half, slack)
    }
}

impl<M: Mapping> Clipped<M> {
    /// Builds the quadric under a transform; `bounds` returns its world-space bounds.
    pub(crate) fn new(
        transform: Transform,
        conic: Conic,
        mapping: M,
        bounds: impl FnOnce(&Frame) -> Aabb,
    ) -> Result<Self, SceneError> {
        let maps = [transform.world_from_object(), transform.object_from_world()];
        let largest = maps.map(|map| {
            map.matrix3
                .to_cols_array()
                .map(f64::abs)
                .into_iter()
                .fold(0.0, f64::max)
        });
        // Within a factor of 9 of the condition number.
        let stretch = largest[0] * largest[1];
        if stretch > MAX_STRETCH {
            return Err(SceneError::anywhere(format!(
                "the shape is {stretch:.0e} times as long as thick; the limit is {MAX_STRETCH:.0e}"
            )));
        }
        let frame = Frame::new(transform);
        let bounds = bounds(&frame);
        let reach = bounds.min.abs().max(bounds.max.abs());
        // Written so that NaN fails.
        if !reach.cmplt(DVec3::splat(MAX_REACH)).all() {
            return Err(SceneError::anywhere(format!(
                "the shape reaches coordinates of {:e} m after the transform; the limit is {MAX_REACH:e} m",
                reach.max_element()
            )));
        }
        let center = bounds.center();
        // Upper bound on the rounding error of the center and the extent.
        let rounding = 4.0 * f64::EPSILON * center.abs().max_element();
        Ok(Self {
            radius: (0.5 + 1e-9) * bounds.extent().length() + rounding,
            center,
            bounds,
            frame,
            conic,
            stretched: stretch > STRETCHED,
            mapping,
        })
    }
}

impl<M: Mapping> Clipped<M> {
    /// The surface of a part near a point of object space, also beyond the box.
    #[inline(always)]
    fn surface_near(&self, p: DVec3, primitive: u32, needs: SurfaceAttributes) -> SurfaceInteraction {
        let conic = &self.conic;
        let (on_quadric, half, slack) = conic.project(p);
        let smooth = select(half.length_squared() > 0.0, 1.0, 0.0);
        let gradient = half + (1.0 - smooth) * conic.tip;
        let n = conic.face_normal(primitive);
        let cap = primitive != 0;
        let on_face = |n: f64, low: f64, high: f64, p: f64| select(n < 0.0, low, select(n > 0.0, high, p));
        let part = |i: usize| {
            let flat = on_face(n[i], conic.min[i], conic.max[i], p[i]);
            (select(cap, flat, on_quadric[i]), select(cap, n[i], gradient[i]))
        };
        let ((x, g_x), (y, g_y), (z, g_z)) = (part(0), part(1), part(2));
        let (p, gradient) = (DVec3::new(x, y, z), DVec3::new(g_x, g_y, g_z));
        let slack = select(cap, 0.0, slack);
        let (position, error, n_g) = self.frame.point_with_gradient(p, gradient, slack);
        let mut point = SurfaceInteraction::new(position, error, n_g);
        if needs.contains(SurfaceAttributes::UV) {
            point.uv = self.mapping.uv(p, primitive);
        }
        point
    }
}

impl<M: Mapping> ShapeKernel for Clipped<M> {
    fn bounds(&self) -> Aabb {
        self.bounds
    }

    #[inline(always)]
    fn may_hit(&self, ray: &Ray) -> bool {
        comes_near_ball(ray, self.center, self.radius)
    }

    #[inline(always)]
    fn hit(&self, ray: &Ray, min: f64, origin_primitive: u32) -> ShapeHit {
        let conic = &self.conic;
        let ray = self.frame.ray_to_object(ray);
        let [first, again] = conic.parts(&ray, self.stretched);
        let (one, two) = (first.there, again.there);
        // A ray spawned inward meets an exit first, a ray spawned outward an entry. This tells the
        // spawn point from the far side without an estimate of how far rounding has moved it.
        let leaving = origin_primitive != NO_PRIMITIVE;
        let inward = leaving & conic.goes_inside(&ray, origin_primitive);
        let outward = leaving & !inward;
        let (entered, left) = (one & (first.enter.t > 0.0), one & (first.exit.t > 0.0));
        let entered_again = entered | two & (again.enter.t > 0.0);
        let counts = |end: End, there: bool| there & (end.t > min) & (conic.caps | (end.primitive == 0));
        let ends = [
            (again.exit, two & (!outward | entered_again)),
            (again.enter, two & (!inward | left)),
            (first.exit, one & (!outward | entered)),
            (first.enter, one & !inward),
        ];
        let mut found = ShapeHit::plain(f64::NAN);
        for (end, there) in ends {
            let here = counts(end, there);
            found.t = select(here, end.t, found.t);
            found.primitive = select(here, end.primitive, found.primitive);
        }
        found
    }

    #[inline(always)]
    fn surface(
        &self,
        ray: &Ray,
        hit: &PreliminaryIntersection,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction {
        let p = self.frame.point_to_object(ray.at(hit.t));
        let p = p.max(self.conic.min).min(self.conic.max);
        self.surface_near(p, hit.primitive, needs)
    }

    fn parts(&self) -> Vec<SurfacePart> {
        self.mapping.parts(&self.frame)
    }

    fn surface_at_offset(
        &self,
        point: &SurfaceInteraction,
        hit: &PreliminaryIntersection,
        q: DVec3,
        needs: SurfaceAttributes,
    ) -> Option<SurfaceInteraction> {
        let q = self.frame.point_to_object(q);
        Some(goes_on(self.surface_near(q, hit.primitive, needs), point))
    }

    fn is_solid(&self) -> bool {
        self.conic.caps
    }

    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        let ray = self.frame.ray_to_object(ray);
        for part in self.conic.parts(&ray, self.stretched) {
            let [enter, exit] = [part.enter, part.exit].map(|end| ShapeHit {
                primitive: end.primitive,
                ..ShapeHit::plain(end.t)
            });
            solid::push(spans, enter, exit);
        }
    }

    fn primitives(&self) -> u32 {
        7
    }
}

/// phi/2pi of the point (x, y), in [0, 1).
pub(crate) fn angle(x: f64, y: f64) -> f64 {
    let turns = libm::atan2(y, x) / std::f64::consts::TAU;
    // An angle less than one rounding below zero would become a full turn.
    let turns = if turns < 0.0 { turns + 1.0 } else { turns };
    if turns < 1.0 { turns } else { 0.0 }
}
