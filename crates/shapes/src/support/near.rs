//! Bounding sphere test and seamless angular texture coordinates.

use whitstone_core::{DVec3, Ray, SceneError, SurfaceInteraction};

/// Rejects a radius whose square is not a normal double: with lost digits, misses would become hits
/// and normals would not have unit length.
pub(crate) fn check_radius(radius: f64) -> Result<(), SceneError> {
    if (radius * radius).is_normal() {
        return Ok(());
    }
    Err(SceneError::anywhere(format!(
        "expected a radius from 1.5e-154 to 1.3e154 m, found {radius:e} m"
    )))
}

/// Unwraps the texture coordinates of a point near `here` across the seam of a full turn.
pub(crate) fn goes_on(mut there: SurfaceInteraction, here: &SurfaceInteraction) -> SurfaceInteraction {
    there.uv -= (there.uv - here.uv).round();
    there
}

/// Conservative ray/sphere test: false only if the ray certainly misses.
#[inline(always)]
pub(crate) fn comes_near_ball(ray: &Ray, center: DVec3, radius: f64) -> bool {
    let (l, d) = (ray.origin - center, ray.direction);
    let (a, b) = (d.length_squared(), l.dot(d));
    // The squares below are accurate to a few roundings of the larger one. A margin of 1e-12 of it
    // leaves every doubtful ray to the full test.
    let (l_squared, r_squared) = (l.length_squared(), radius * radius);
    let far = a * l_squared;
    let passes_by = far - b * b > a * r_squared + 1e-12 * far;
    // Outside and moving away.
    let behind = (b > 0.0) & (l_squared > r_squared + 1e-12 * l_squared);
    !(passes_by | behind)
}
