//! Shared code of the lights with a position: directions and distances at any scale, and the
//! falloff.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use whitstone_core::stream::{GROUP, SampleStreams, Vectors, groups};
use whitstone_core::{Aabb, DVec3, LightBounds, LightSample, Rgb, simd};

/// Falloff of a light with a position, as a function of the distance d.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Falloff {
    /// Proportional to 1/d².
    #[default]
    InverseSquare,
    /// No falloff, as in the lecture notes.
    None,
}

/// Unit direction and length of a vector; `None` for zero.
pub(crate) fn direction_and_length(v: DVec3) -> Option<(DVec3, f64)> {
    if is_usual(v) {
        let length = v.length();
        return Some((v / length, length));
    }
    let largest = v.abs().max_element();
    if largest == 0.0 {
        return None;
    }
    let scaled = v / largest;
    let length = scaled.length();
    Some((scaled / length, length * largest))
}

/// Centre and radius of the bounding sphere of a box. If the box is unbounded, the radius is
/// infinite and the centre may be NaN.
pub(crate) fn ball_around(bounds: &Aabb) -> (DVec3, f64) {
    let center = bounds.center();
    // Rounding may put points of a surface outside of its box.
    let rounding = 1e-12 * center.abs().max_element();
    (center, (bounds.max - center).length() * (1.0 + 1e-12) + rounding)
}

/// The cube whose bounding sphere has this centre and radius, for tests.
#[cfg(test)]
pub(crate) fn cube_in_ball(center: [f64; 3], radius: f64) -> Aabb {
    let (center, half) = (DVec3::from(center), radius / 3.0_f64.sqrt());
    Aabb::around([center - half, center + half])
}

/// The bounds of a light that emits at most `max_intensity` from each of its positions.
pub(crate) fn bounds(positions: &[DVec3], max_intensity: f64, falloff: Falloff) -> Option<LightBounds> {
    (falloff == Falloff::InverseSquare).then(|| LightBounds {
        bounds: Aabb::around(positions.iter().copied()),
        max_intensity,
    })
}

/// [`sample`] for every point of a stream.
pub(crate) fn sample_stream(
    position: DVec3,
    len: usize,
    points: &Vectors,
    intensity: Rgb,
    falloff: Falloff,
    out: &mut SampleStreams,
) {
    let out = out.add();
    let usual = simd::dispatch(
        #[inline(always)]
        || {
            // Copied into registers: captured references could alias the output.
            let (position, intensity) = (position, intensity);
            let mut usual = true;
            for start in groups(len) {
                for lane in start..start + GROUP {
                    let v = position - points.get(lane);
                    usual &= is_usual(v) | (lane >= len);
                    out.set(lane, &usual_sample(v, intensity, falloff));
                }
            }
            usual
        },
    );
    if !usual {
        for lane in 0..len {
            match sample(position, points.get(lane), intensity, falloff) {
                Some(sample) => out.set(lane, &sample),
                None => out.irradiance.set(lane, Rgb::BLACK),
            }
        }
    }
}

/// Whether the squares of the components neither overflow nor underflow.
#[inline(always)]
#[expect(clippy::manual_range_contains, reason = "both are tested without a jump")]
fn is_usual(v: DVec3) -> bool {
    let largest = v.abs().max_element();
    (largest >= 1e-140) & (largest < 1e140)
}

/// The light that a source at `position` sends to `point`; `None` at the source itself.
pub(crate) fn sample(position: DVec3, point: DVec3, intensity: Rgb, falloff: Falloff) -> Option<LightSample> {
    let to_light = position - point;
    if is_usual(to_light) {
        return Some(usual_sample(to_light, intensity, falloff));
    }
    let (direction, distance) = direction_and_length(to_light)?;
    let irradiance = match falloff {
        // Divided twice, because d² may underflow although the quotient is finite. Overflow is
        // clamped to the largest finite number, so that infinity times zero does not occur.
        Falloff::InverseSquare => intensity.map(|i| (i / distance / distance).min(f64::MAX)),
        Falloff::None => intensity,
    };
    Some(LightSample {
        direction,
        distance,
        irradiance,
    })
}

/// [`sample`] at distances whose squares neither overflow nor underflow.
#[inline(always)]
fn usual_sample(to_light: DVec3, intensity: Rgb, falloff: Falloff) -> LightSample {
    let squared = to_light.length_squared();
    let distance = squared.sqrt();
    // A jump would prevent the vectorisation of streams.
    let per = simd::select(falloff == Falloff::InverseSquare, squared, 1.0);
    LightSample {
        direction: to_light / distance,
        distance,
        irradiance: intensity.map(|i| (i / per).min(f64::MAX)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_right_at_any_scale() {
        for scale in [5e-324, 1e-200, 1.0, 1e200, 3e307] {
            let (direction, length) = direction_and_length(DVec3::new(0.0, 3.0, -4.0) * scale).unwrap();
            assert!((direction.length() - 1.0).abs() < 1e-15);
            assert!((length / scale - 5.0).abs() < 1e-14, "{scale}: {length}");
        }
        assert_eq!(direction_and_length(DVec3::ZERO), None);
    }

    #[test]
    fn balls_contain_their_boxes_despite_rounding() {
        for (center, margin) in [(0.0, 3_f64.sqrt() * 1e-12), (1000.0, 1e-9)] {
            let box_of = Aabb::around([DVec3::splat(center - 1.0), DVec3::splat(center + 1.0)]);
            let (found, radius) = ball_around(&box_of);
            assert_eq!(found, DVec3::splat(center));
            let beyond = radius - 3_f64.sqrt();
            assert!(
                beyond > 0.9 * margin && beyond < 1.1 * margin,
                "{center}: {beyond}"
            );
        }
    }

    #[test]
    fn nearness_does_not_overflow() {
        let sample = |d: f64| {
            sample(
                DVec3::ZERO,
                DVec3::new(0.0, d, 0.0),
                Rgb::new(1.0, 0.0, 1e-30),
                Falloff::InverseSquare,
            )
        };
        assert_eq!(
            sample(1e-300).unwrap().irradiance,
            Rgb::new(f64::MAX, 0.0, f64::MAX)
        );
        assert_eq!(sample(0.0), None);
    }
}
