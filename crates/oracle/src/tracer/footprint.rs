//! Section 10, *Footprints*: how rays of neighbouring samples lie to each other, and what they see
//! of a surface.
//!
//! Derivatives are central differences of the functions that the rest of this tracer consists of:
//! of the camera, of what a line across a surface meets, of the branches of a material. So nothing
//! is derived by hand, whatever the shape or the material is.

use whitstone_core::{DVec2, DVec3, Ray};

/// The least cosine between a ray and the normal by which a step is prolonged.
const GRAZING: f64 = 1.0 / (1 << 20) as f64;
/// The longest derivative of a branch's direction, in radians per sample.
const WIDEST: f64 = 1.0;
/// How far apart rays are that are compared, in sample distances.
pub(super) const APART: f64 = 1.0 / (1 << 12) as f64;
/// How far apart points of a surface or of texture space are that are compared, as a part of their
/// coordinates.
pub(super) const NEAR: f64 = 1.0 / (1 << 20) as f64;

/// Towards the next sample to the right and the next one below.
pub(super) type Sides<T> = [T; 2];

/// Derivatives of a ray, per sample.
#[derive(Clone, Copy)]
pub(super) struct Differential {
    pub(super) origin: Sides<DVec3>,
    pub(super) direction: Sides<DVec3>,
}

/// Derivatives of a surface point, per sample.
#[derive(Clone, Copy, Default)]
pub(super) struct Footprint {
    pub(super) p: Sides<DVec3>,
    pub(super) uv: Sides<DVec2>,
    pub(super) n_s: Sides<DVec3>,
}

impl Differential {
    /// Of a ray whose neighbours in these four places are `moved` away from it, in pixels; samples
    /// are so far apart.
    pub(super) fn between([left, right, above, below]: [&Ray; 4], moved: f64, samples: f64) -> Self {
        let per = samples / (2.0 * moved);
        Self {
            origin: [right.origin - left.origin, below.origin - above.origin].map(|x| x * per),
            direction: [
                right.direction - left.direction,
                below.direction - above.direction,
            ]
            .map(|x| x * per),
        }
    }

    /// The steps in the tangent plane of a surface that the ray meets at t.
    pub(super) fn steps(&self, ray: &Ray, t: f64, n_g: DVec3) -> Sides<DVec3> {
        let c = ray.direction.dot(n_g);
        let c = c.abs().max(GRAZING).copysign(c);
        [0, 1].map(|side| {
            let m = self.origin[side] + t * self.direction[side];
            m - m.dot(n_g) / c * ray.direction
        })
    }
}

/// A derivative of a direction, of bounded length.
pub(super) fn bounded(d: DVec3) -> DVec3 {
    if d.is_finite() {
        d.clamp_length_max(WIDEST)
    } else {
        DVec3::ZERO
    }
}

/// The derivative from values on both sides, that far away each, and in the middle, of which one
/// outside may be missing.
pub(super) fn slope<T>(before: Option<T>, here: T, after: Option<T>, away: f64) -> T
where
    T: std::ops::Sub<Output = T> + std::ops::Mul<f64, Output = T> + Default,
{
    match (before, after) {
        (Some(before), Some(after)) => (after - before) * (0.5 / away),
        (None, Some(after)) => (after - here) * (1.0 / away),
        (Some(before), None) => (here - before) * (1.0 / away),
        (None, None) => T::default(),
    }
}
