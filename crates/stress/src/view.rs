//! Scenes of families for renderers that only give images.

use whitstone_core::{DVec3, Ray};

/// Columns and rows of the images.
pub(crate) const SIZE: [u32; 2] = [8, 6];

/// A scene of shapes, seen from the origin of a ray along the ray, in light from there. The field
/// of view has room for a ball of `radius` around `target`, up to 90 degrees.
pub(crate) fn along(scene: &str, ray: &Ray, target: DVec3, radius: f64) -> String {
    // Of any length.
    let direction = (ray.direction / ray.direction.abs().max_element()).normalize();
    let distance = ray.origin.distance(target);
    let fov = (2.0 * radius.atan2(distance).to_degrees()).min(90.0);
    // As far as the coordinates are large, so that the target is not rounded to the origin.
    let far = distance.max(ray.origin.length());
    let light = format!(
        "[[light]]\ntype = \"directional\"\ndirection = {:?}\nirradiance = 4\n",
        direction.to_array()
    );
    seen(
        &format!("{light}{scene}"),
        ray.origin,
        ray.origin + far * direction,
        fov,
    )
}

/// A scene of shapes and lights, seen from a place.
pub(crate) fn seen(scene: &str, origin: DVec3, target: DVec3, fov: f64) -> String {
    let [width, height] = SIZE;
    let forward = target - origin;
    let up = match forward.y.abs() < 0.9 * forward.length() {
        true => [0, 1, 0],
        false => [1, 0, 0],
    };
    format!(
        "film = {{ width = {width}, height = {height} }}\n\
         camera = {{ type = \"perspective\", fov = {fov:?}, look_at = {{ origin = {:?}, target = {:?}, up = {up:?} }} }}\n{scene}",
        origin.to_array(),
        target.to_array()
    )
}
