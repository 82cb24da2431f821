//! Shared code of the lights that project an image.

use std::ops::Range;
use toml::Spanned;
use whitstone_core::config::Vector3;
use whitstone_core::{ColorSource, DVec2, DVec3, Rgb, SceneError, SceneErrors, SurfaceInteraction};

use super::emission;

/// The right and up axes of an image that is projected along the unit vector `axis`. `up` is the
/// key of that name; without it the image is upright along +y, and errors are at `target`.
pub(crate) fn image_axes(
    axis: DVec3,
    up: Option<&Spanned<Vector3>>,
    target: Range<usize>,
) -> Result<[DVec3; 2], SceneErrors> {
    let place = up.map_or(target, Spanned::span);
    let up = up.map_or(DVec3::Y, |up| up.get_ref().get());
    let Some((up, _)) = emission::direction_and_length(up) else {
        return Err(SceneError::at(place, "`up` has no direction: all its components are zero").into());
    };
    let right = axis.cross(up);
    if right.length() <= 1e-12 {
        let error = SceneError::at(place, "`up` is parallel to the axis");
        let help = match axis.z.abs() < 0.9 {
            true => "give another `up`, such as [0, 0, 1] for an image that is projected straight down",
            false => "give another `up`, such as [0, 1, 0] for an image that is projected along z",
        };
        return Err(error.with_help(help).into());
    }
    // If `up` is nearly parallel to the axis, rounding leaves a component along the axis. Remove
    // it.
    let right = right.normalize();
    let right = (right - axis * axis.dot(right)).normalize();
    Ok([right, right.cross(axis)])
}

/// The colour of a projected image at its texture coordinates.
pub(crate) fn image_color(image: &ColorSource, uv: DVec2) -> Rgb {
    let mut place = SurfaceInteraction::new(uv.extend(0.0), 0.0, DVec3::Z);
    place.uv = uv;
    image.value(&place)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The cross product of nearly parallel vectors has few digits.
    #[test]
    fn axes_are_perpendicular_even_if_up_is_nearly_parallel() {
        let axis = DVec3::new(1.0, 2.0, 3.0).normalize();
        for tilt in [1.0, 1e-6, 1e-11] {
            let up = axis + tilt * DVec3::new(0.3, -0.7, 0.2);
            let up = Spanned::new(0..0, Vector3::new(up.x, up.y, up.z));
            let [right, upward] = image_axes(axis, Some(&up), 0..0).unwrap();
            for dot in [axis.dot(right), axis.dot(upward), right.dot(upward)] {
                assert!(dot.abs() < 1e-15, "{tilt}: {dot}");
            }
        }
    }
}
