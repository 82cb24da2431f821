//! The gradients of the texture coordinates on a surface, for bump maps.

use crate::{Aabb, Geometry, LoweredShape, PreliminaryIntersection, SurfaceAttributes, SurfaceInteraction};
use glam::{DVec2, DVec3};

/// The change of (u, v) that the steps of a difference aim at: the truncation error is of the order
/// of its square, since angles are whole turns, and the rounding error 2^-53 divided by it.
const CHANGE: f64 = 1.0 / (1 << 18) as f64;

/// Steps are tried until the change is between `CHANGE` divided and multiplied by this.
const TOLERANCE: f64 = 16.0;

/// Upper bound on the factor between two steps, in both directions.
const FACTOR: f64 = (1_u64 << 40) as f64;

/// Factor on a step that ends where the surface cannot be extrapolated to.
const BEYOND: f64 = 1.0 / (1 << 12) as f64;

/// A change below this is taken for rounding.
const NOISE: f64 = 1.0 / (1_u64 << 46) as f64;

/// Factor between the steps that are tried after steps without any change. Far from a shape (u, v)
/// may be constant, and near a point the change may vanish in rounding.
const SEARCH: f64 = (1_u64 << 20) as f64;

/// Upper bound on the number of steps that are tried.
const TRIES: u32 = 12;

impl Geometry {
    /// The gradients of u and v at a hit, per metre: the vectors across `n_g` whose products with a
    /// step on the surface are the changes of u and v. Zero on surfaces without derivatives
    /// ([`crate::Shape::surface_at_offset`]).
    ///
    /// They are central differences. The first step is relative to the size of the shape. How far
    /// it is curved is unknown here, but not how far its (u, v) change: the step is adapted until
    /// that is neither too small for rounding nor too large for the curvature.
    pub fn uv_gradient(&self, point: &SurfaceInteraction, hit: &PreliminaryIntersection) -> [DVec3; 2] {
        let (e, f) = point.n_g.any_orthonormal_pair();
        let first = CHANGE * self.size_of_hit(hit);
        let (mut step, mut constant) = (first, 0);
        let mut gradients = [DVec3::ZERO; 2];
        for _ in 0..TRIES {
            let [Some((e_change, e_length)), Some((f_change, f_length))] =
                [e, f].map(|along| self.uv_change(point, hit, along, step))
            else {
                // Beyond the shape, or it has no derivatives.
                step *= BEYOND;
                continue;
            };
            let (by_e, by_f) = (e_change / e_length, f_change / f_length);
            gradients = [by_e.x * e + by_f.x * f, by_e.y * e + by_f.y * f];
            // Of both directions: (u, v) need not change along one of them.
            let change = 0.5 * e_change.abs().max(f_change.abs()).max_element();
            if (CHANGE / TOLERANCE..=CHANGE * TOLERANCE).contains(&change) {
                break;
            }
            if change > NOISE {
                step *= (CHANGE / change).clamp(1.0 / FACTOR, FACTOR);
                continue;
            }
            // Alternately shorter and longer than the first.
            let power = constant / 2 + 1;
            step = first * SEARCH.powi(if constant % 2 == 0 { -power } else { power });
            constant += 1;
        }
        gradients.map(|gradient| {
            if gradient.is_finite() {
                gradient
            } else {
                DVec3::ZERO
            }
        })
    }

    /// The size of the triangle, shape or instance that was hit, in metres; 1 if it is unbounded.
    fn size_of_hit(&self, hit: &PreliminaryIntersection) -> f64 {
        let bounds = match self.shapes().get(hit.shape as usize) {
            Some(LoweredShape::Triangles(mesh)) => Aabb::around(mesh.corners(hit.primitive)),
            Some(LoweredShape::Custom(primitive)) => primitive.bounds(),
            Some(LoweredShape::Instance(_)) | None => match self.instance(hit.instance) {
                Some((_, instance)) => instance.bounds(),
                None => Aabb::EVERYTHING,
            },
        };
        let size = bounds.extent().max_element();
        if size > 0.0 && size.is_finite() { size } else { 1.0 }
    }

    /// The change of (u, v) from `step` behind the point to `step` in front of it, along a unit
    /// tangent; and the distance of both, which is rounded.
    fn uv_change(
        &self,
        point: &SurfaceInteraction,
        hit: &PreliminaryIntersection,
        along: DVec3,
        step: f64,
    ) -> Option<(DVec2, f64)> {
        let [before, after] = [-step, step].map(|step| point.position + step * along);
        let at = |q| self.surface_at_offset(point, hit, q, SurfaceAttributes::UV);
        let change = at(after)?.uv - at(before)?.uv;
        change
            .is_finite()
            .then_some((change, (after - before).dot(along)))
    }
}
