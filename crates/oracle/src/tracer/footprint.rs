//! Ray differentials and texture footprints: section 10, *Footprints*.
//!
//! Derivatives are central differences of the functions of this tracer: the camera, the
//! intersection of a surface with a line across it, and the specular rays of a material. No
//! derivative is derived by hand, whatever the shape or the material.

use whitstone_core::{DVec2, DVec3, Ray};

/// The least cosine between a ray and the normal by which a step in the tangent plane is
/// lengthened.
const GRAZING: f64 = 1.0 / (1 << 20) as f64;
/// Upper bound on the derivative of the direction of a specular ray, in radians per sample.
const WIDEST: f64 = 1.0;
/// Offset of the rays in a difference, in sample distances.
pub(super) const APART: f64 = 1.0 / (1 << 12) as f64;
/// Offset of the points in a difference on a surface or in texture space, relative to their
/// coordinates.
pub(super) const NEAR: f64 = 1.0 / (1 << 20) as f64;

/// Derivatives towards the next sample to the right and the next one below.
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
    /// The differential of a ray from its neighbours `moved` pixels away on each side; `samples` is
    /// the sample distance in pixels.
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

    /// The steps per sample in the tangent plane of a surface that the ray hits at t.
    pub(super) fn steps(&self, ray: &Ray, t: f64, n_g: DVec3) -> Sides<DVec3> {
        let c = ray.direction.dot(n_g);
        let c = c.abs().max(GRAZING).copysign(c);
        [0, 1].map(|side| {
            let m = self.origin[side] + t * self.direction[side];
            m - m.dot(n_g) / c * ray.direction
        })
    }
}

/// Clamps the derivative of a direction.
pub(super) fn bounded(d: DVec3) -> DVec3 {
    if d.is_finite() {
        d.clamp_length_max(WIDEST)
    } else {
        DVec3::ZERO
    }
}

/// The derivative from values at -`away`, 0 and `away`, of which one outer value may be missing.
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
