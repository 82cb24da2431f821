//! Laws of lights.

use crate::spread::directions;
use crate::streams::light_streams;
use crate::textures::is_colour;
use whitstone_core::{Aabb, DVec3, Light, LightBounds, LightFlags, LightSample, Rgb};

fn samples(light: &dyn Light, point: DVec3) -> Vec<LightSample> {
    let mut out = Vec::new();
    light.samples(point, &mut out);
    out
}

/// Checks the laws of lights: a light contributes exactly what it declares. Anywhere in space, its
/// samples have unit directions, positive distances and finite, non-negative irradiances. They are
/// appended to the list, are deterministic, and are identical in streams.
///
/// # Panics
///
/// If the light breaks one of these laws; the message says which and where.
pub fn light_laws(light: &dyn Light) {
    let gives = light.flags();
    let mut reached = false;
    let mut points = Vec::new();
    for direction in directions(64) {
        for distance in [0.0, 5e-324, 1e-170, 1e-12, 1.0, 3.0, 1e6, 1e170, 1e300] {
            let point = distance * direction;
            points.push(point);
            let found = samples(light, point);
            for sample in &found {
                let LightSample {
                    direction,
                    distance,
                    irradiance,
                } = *sample;
                let length = direction.length();
                assert!(
                    (length - 1.0).abs() < 1e-14,
                    "the direction at {point} must have unit length, found {length}"
                );
                assert!(
                    distance > 0.0,
                    "the distance from {point} must be positive, found {distance}"
                );
                assert!(
                    is_colour(irradiance),
                    "the irradiance at {point} must be finite and >= 0, found {irradiance:?}"
                );
            }
            reached |= !found.is_empty();
            let mut longer = found.clone();
            light.samples(point, &mut longer);
            let doubled = [found.clone(), found].concat();
            assert_eq!(
                longer, doubled,
                "samples at {point} must be deterministic and appended to those of other lights"
            );
        }
        let seen = light.background(direction);
        assert!(
            is_colour(seen),
            "the background towards {direction} must be finite and >= 0, found {seen:?}"
        );
        let says = gives.contains(LightFlags::BACKGROUND);
        assert!(
            says || seen.is_black(),
            "a light with a background must have the flag `BACKGROUND`"
        );
    }
    let broken = light_streams(light, &points)
        .and_then(|()| light_streams(light, &directions(300).collect::<Vec<_>>()))
        .err();
    assert_eq!(broken, None, "streams must give the same light as single calls");
    dark_where_unaffected(light);
    if let Some(bounds) = light.bounds() {
        points
            .iter()
            .for_each(|point| within_bounds(light, &bounds, *point));
    }
    let ambient = light.ambient();
    assert!(
        is_colour(ambient),
        "the ambient radiance must be finite and >= 0, found {ambient:?}"
    );
    let says = gives.contains(LightFlags::AMBIENT);
    assert!(
        says || ambient.is_black(),
        "a light with ambient radiance must have the flag `AMBIENT`"
    );
    let says = gives.contains(LightFlags::SAMPLES);
    assert!(
        says || !reached,
        "a light with samples must have the flag `SAMPLES`"
    );
}

/// Checks that no sample at a point is brighter than the bounds of the light allow.
fn within_bounds(light: &dyn Light, bounds: &LightBounds, point: DVec3) {
    let LightBounds {
        bounds,
        max_intensity,
    } = *bounds;
    let outside = (bounds.min - point).max(point - bounds.max).max(DVec3::ZERO);
    let distance = outside.length();
    let limit = max_intensity / distance / distance * (1.0 + 1e-9);
    for sample in samples(light, point) {
        let found = sample.irradiance.max_component();
        // True also if the limit is NaN.
        let bright = found > limit;
        assert!(
            !bright,
            "the irradiance {found} at {point} exceeds the bounds of the light, which allow {limit}"
        );
    }
}

/// Checks boxes of many sizes, near and far: where the light does not reach a box, its samples are
/// black at every point of it.
fn dark_where_unaffected(light: &dyn Light) {
    assert!(
        light.affects_bounds(&Aabb::EVERYTHING) || is_dark(light, &Aabb::around([-DVec3::ONE, DVec3::ONE])),
        "a light that does not affect unbounded space must be black everywhere"
    );
    for direction in directions(64) {
        for (distance, half) in [
            (0.0, 1.0),
            (1.0, 0.01),
            (3.0, 1.0),
            (3.0, 1e-6),
            // A box that is a single point.
            (3.0, 0.0),
            (100.0, 60.0),
            (1e6, 1e3),
        ] {
            let center = distance * direction;
            let bounds = Aabb::around([center - half, center + half]);
            assert!(
                light.affects_bounds(&bounds) || is_dark(light, &bounds),
                "a light that does not affect a box of half width {half} around {center} must be black in it"
            );
        }
    }
}

fn is_dark(light: &dyn Light, bounds: &Aabb) -> bool {
    let (center, half) = (bounds.center(), 0.5 * (bounds.max - bounds.min));
    let shares = [-1.0, -0.5, 0.0, 0.5, 1.0];
    let points = shares.iter().flat_map(|x| {
        shares
            .iter()
            .flat_map(move |y| shares.map(|z| DVec3::new(*x, *y, z)))
    });
    points
        .flat_map(|share| samples(light, center + share * half))
        .all(|sample| sample.irradiance.is_black())
}

/// For a light at a position with inverse-square falloff: along `axis` (unit, away from the light)
/// the irradiance follows the inverse square to 1e-9 from 1e8 m down to 1e-8 m, and at the light
/// itself it is zero. Distances of 1e-8 must be representable at the position, as they are at the
/// origin.
///
/// # Panics
///
/// If the light breaks one of these laws; the message says which and where.
pub fn light_near_laws(light: &dyn Light, position: DVec3, intensity: Rgb, axis: DVec3) {
    for exponent in -8..=8 {
        let distance = f64::powi(10.0, exponent);
        let found = samples(light, position + distance * axis);
        let [
            LightSample {
                direction,
                distance: d,
                irradiance,
            },
        ] = found[..]
        else {
            panic!(
                "the light must give one sample at distance {distance}, found {}",
                found.len()
            );
        };
        assert!(
            (direction + axis).length() < 1e-7,
            "at distance {distance} the direction must point to the light"
        );
        assert!(
            (d / distance - 1.0).abs() < 1e-9,
            "the distance must be {distance}, found {d}"
        );
        for (e, i) in irradiance.to_array().into_iter().zip(intensity.to_array()) {
            let expected = i / (distance * distance);
            assert!(
                (e - expected).abs() <= 1e-9 * expected,
                "the irradiance must follow the inverse square at distance {distance}: expected {expected}, found {e}"
            );
        }
    }
    assert_eq!(
        samples(light, position),
        [],
        "a light must give no irradiance at its own position"
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Made<F>(LightFlags, F);

    impl<F: Fn(DVec3) -> LightSample + Send + Sync> Light for Made<F> {
        fn flags(&self) -> LightFlags {
            self.0
        }
        fn samples(&self, point: DVec3, out: &mut Vec<LightSample>) {
            out.push((self.1)(point));
        }
    }

    fn sun(direction: DVec3, irradiance: f64) -> LightSample {
        LightSample {
            direction,
            distance: f64::INFINITY,
            irradiance: Rgb::splat(irradiance),
        }
    }

    #[test]
    fn a_correct_light_passes() {
        light_laws(&Made(LightFlags::SAMPLES, |_| sun(DVec3::Y, 1.0)));
    }

    #[test]
    #[should_panic(expected = "unit length")]
    fn a_long_direction_is_found() {
        light_laws(&Made(LightFlags::SAMPLES, |_| sun(DVec3::ONE, 1.0)));
    }

    #[test]
    #[should_panic(expected = "finite and >= 0")]
    fn negative_light_is_found() {
        light_laws(&Made(LightFlags::SAMPLES, |_| sun(DVec3::Y, -1.0)));
    }

    #[test]
    #[should_panic(expected = "must have the flag `SAMPLES`")]
    fn undeclared_samples_are_found() {
        light_laws(&Made(LightFlags::AMBIENT, |_| sun(DVec3::Y, 1.0)));
    }

    /// A light at the origin, by the textbook formula.
    fn naive(point: DVec3) -> LightSample {
        let distance = point.length();
        LightSample {
            direction: -point / distance,
            distance,
            irradiance: Rgb::splat(1.0 / (distance * distance)),
        }
    }

    #[test]
    #[should_panic(expected = "unit length")]
    fn the_textbook_formula_fails_at_extreme_distances() {
        light_laws(&Made(LightFlags::SAMPLES, naive));
    }

    #[test]
    #[should_panic(expected = "no irradiance at its own position")]
    fn light_at_the_light_is_found() {
        light_near_laws(
            &Made(LightFlags::SAMPLES, naive),
            DVec3::ZERO,
            Rgb::WHITE,
            DVec3::X,
        );
    }

    #[test]
    #[should_panic(expected = "inverse square")]
    fn another_falloff_is_found() {
        let linear = |point: DVec3| LightSample {
            irradiance: Rgb::splat(1.0 / point.length()),
            ..naive(point)
        };
        light_near_laws(
            &Made(LightFlags::SAMPLES, linear),
            DVec3::ZERO,
            Rgb::WHITE,
            DVec3::X,
        );
    }

    /// Claims that it reaches nothing on one side.
    struct Half(f64);

    impl Light for Half {
        fn flags(&self) -> LightFlags {
            LightFlags::SAMPLES
        }
        fn samples(&self, point: DVec3, out: &mut Vec<LightSample>) {
            if point.x > self.0 {
                out.push(sun(DVec3::Y, 1.0));
            }
        }
        fn affects_bounds(&self, bounds: &Aabb) -> bool {
            bounds.max.x > 0.0
        }
    }

    #[test]
    fn a_light_that_affects_one_side_passes() {
        light_laws(&Half(0.0));
    }

    #[test]
    #[should_panic(expected = "a light that does not affect a box")]
    fn a_light_that_exceeds_its_bounds_is_found() {
        light_laws(&Half(-0.5));
    }
}
