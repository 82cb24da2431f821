//! The cheap test of round and compact shapes, and texture coordinates that are angles.

use whitstone_core::{DVec3, Ray, SceneError, SurfacePoint};

/// Refuses a radius whose square is no double with all of its digits: misses would be hits, and
/// normals of another length than 1.
pub(crate) fn check_radius(radius: f64) -> Result<(), SceneError> {
    if (radius * radius).is_normal() {
        return Ok(());
    }
    Err(SceneError::anywhere(
        "the radius is too large or too small to compute with",
    ))
}

/// A point beside another one, with texture coordinates that go on where they start anew after a
/// turn.
pub(crate) fn goes_on(mut there: SurfacePoint, here: &SurfacePoint) -> SurfacePoint {
    there.uv -= (there.uv - here.uv).round();
    there
}

/// Whether a ray may meet a ball: false only if it certainly does not.
#[inline(always)]
pub(crate) fn comes_near_ball(ray: &Ray, center: DVec3, radius: f64) -> bool {
    let (l, d) = (ray.origin - center, ray.direction);
    let (a, b) = (d.length_squared(), l.dot(d));
    // The squares below are right to a few roundings of the larger one, so a margin of 1e-12 of it
    // leaves every doubtful ray to the careful form.
    let (l_squared, r_squared) = (l.length_squared(), radius * radius);
    let far = a * l_squared;
    let passes_by = far - b * b > a * r_squared + 1e-12 * far;
    // Outside and going away.
    let behind = (b > 0.0) & (l_squared > r_squared + 1e-12 * l_squared);
    !(passes_by | behind)
}
