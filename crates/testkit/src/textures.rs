//! Laws of textures.

use crate::streams::texture_streams;
use whitstone_core::{
    DVec2, DVec3, Footprint, Rgb, SurfaceAttributes, SurfaceInteraction, Texture, Vec2, Vec3,
};

/// Checks the laws of textures: for all texture coordinates and positions, values are finite, not
/// negative, deterministic and identical in streams. They depend on the coordinates only if the
/// texture declares so, and equal the constant that it declares.
///
/// # Panics
///
/// If the texture breaks one of these laws; the message says which and where.
pub fn texture_laws(texture: &dyn Texture) {
    let coordinates = [
        0.0,
        -0.0,
        0.1,
        0.5,
        1.0 - f64::EPSILON,
        1.0,
        -1e-300,
        -1e-17,
        -0.3,
        1.7,
        -5.5,
        255.0,
        1e6 + 0.25,
        -1e9 - 0.5,
        9_007_199_254_740_993.0,
        -9.3e18,
        9.3e18,
        1.8e19,
        -1e30,
        1e300,
        f64::MAX,
        f64::MIN,
        f64::MIN_POSITIVE,
        5e-324,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NAN,
    ];
    let at = |u: f64, v: f64| {
        let mut point = SurfaceInteraction::new(DVec3::new(0.3, -1.0, 2.0), 0.0, DVec3::Z);
        point.uv = DVec2::new(u, v);
        point
    };
    let value = |u: f64, v: f64| texture.value(&at(u, v));
    let points: Vec<SurfaceInteraction> = coordinates
        .into_iter()
        .flat_map(|u| coordinates.map(|v| at(u, v)))
        .collect();
    let broken = texture_streams(texture, &points).err();
    assert_eq!(broken, None, "streams must give the same values as single calls");
    let reads_uv = texture.needs().contains(SurfaceAttributes::UV);
    let elsewhere = value(0.7, 0.2);
    for u in coordinates {
        for v in coordinates {
            let found = value(u, v);
            assert!(
                is_colour(found),
                "the value at ({u}, {v}) must be finite and not negative, found {found:?}"
            );
            assert_eq!(
                value(u, v),
                found,
                "the value at ({u}, {v}) must be deterministic"
            );
            assert!(
                reads_uv || found == elsewhere,
                "a texture that reads (u, v) must declare that it needs it"
            );
            assert!(
                texture.constant().is_none_or(|constant| constant == found),
                "a texture declared constant must have that value at ({u}, {v})"
            );
        }
    }
    // Footprints may be arbitrary, and affect only textures that read them.
    let reads_footprints = texture.needs().contains(SurfaceAttributes::FOOTPRINT);
    let steps = [
        0.0,
        1e-9,
        -0.01,
        0.3,
        40.0,
        1e30,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::NAN,
    ];
    let footprints: Vec<SurfaceInteraction> = (0..steps.len().pow(3))
        .map(|number| {
            let step = |place: u32| steps[number / steps.len().pow(place) % steps.len()];
            let mut point = at(0.7, 0.2);
            point.footprint = Footprint {
                position: [Vec3::new(step(0), step(1), 0.5), Vec3::new(-0.1, step(2), 0.1)],
                uv: [Vec2::new(step(0), step(1)), Vec2::new(step(2), 0.02)],
            };
            point
        })
        .collect();
    let broken = texture_streams(texture, &footprints).err();
    assert_eq!(
        broken, None,
        "streams with footprints must give the same values as single calls"
    );
    for point in footprints {
        let (footprint, found) = (point.footprint, texture.value(&point));
        assert!(
            is_colour(found),
            "the value over {footprint:?} must be finite and not negative, found {found:?}"
        );
        assert!(
            reads_footprints || found == elsewhere,
            "a texture that reads footprints must declare that it needs them"
        );
    }
    // For solid textures: a third coordinate from elsewhere in the list.
    let places: Vec<SurfaceInteraction> = (0..coordinates.len())
        .flat_map(|i| coordinates.map(|y| (i, y)))
        .enumerate()
        .map(|(number, (i, y))| {
            let z = coordinates[7 * number % coordinates.len()];
            let mut point = at(0.7, 0.2);
            point.position = DVec3::new(coordinates[i], y, z);
            point
        })
        .collect();
    let broken = texture_streams(texture, &places).err();
    assert_eq!(
        broken, None,
        "streams of positions must give the same values as single calls"
    );
    for point in places {
        let (place, found) = (point.position, texture.value(&point));
        assert!(
            is_colour(found),
            "the value at {place} must be finite and not negative, found {found:?}"
        );
        assert_eq!(
            texture.value(&point),
            found,
            "the value at {place} must be deterministic"
        );
        assert!(
            texture.constant().is_none_or(|constant| constant == found),
            "a texture declared constant must have that value at {place}"
        );
    }
}

/// Whether all channels are finite and not negative.
pub(crate) fn is_colour(color: Rgb) -> bool {
    color.to_array().into_iter().all(|c| c.is_finite() && c >= 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Made<F>(SurfaceAttributes, F);

    impl<F: Fn(DVec2) -> f64 + Send + Sync> Texture for Made<F> {
        fn needs(&self) -> SurfaceAttributes {
            self.0
        }
        fn value(&self, point: &SurfaceInteraction) -> Rgb {
            Rgb::splat((self.1)(point.uv))
        }
    }

    #[test]
    fn a_correct_texture_passes() {
        texture_laws(&Made(SurfaceAttributes::UV, |uv: DVec2| f64::from(uv.x > 0.5)));
    }

    #[test]
    #[should_panic(expected = "finite and not negative")]
    fn a_nan_value_is_found() {
        texture_laws(&Made(SurfaceAttributes::UV, |uv: DVec2| uv.x.abs().fract()));
    }

    #[test]
    #[should_panic(expected = "finite and not negative")]
    fn a_negative_value_is_found() {
        texture_laws(&Made(SurfaceAttributes::NOTHING, |_| -0.1));
    }

    struct InSpace;

    impl Texture for InSpace {
        fn needs(&self) -> SurfaceAttributes {
            SurfaceAttributes::NOTHING
        }
        fn value(&self, point: &SurfaceInteraction) -> Rgb {
            Rgb::splat(point.position.z.abs().fract())
        }
    }

    #[test]
    #[should_panic(expected = "finite and not negative")]
    fn a_nan_value_at_a_position_is_found() {
        texture_laws(&InSpace);
    }

    #[test]
    #[should_panic(expected = "must declare that it needs it")]
    fn an_undeclared_need_is_found() {
        texture_laws(&Made(SurfaceAttributes::NOTHING, |uv: DVec2| {
            f64::from(uv.x > 0.5)
        }));
    }

    struct Wide;

    impl Texture for Wide {
        fn needs(&self) -> SurfaceAttributes {
            SurfaceAttributes::NOTHING
        }
        fn value(&self, point: &SurfaceInteraction) -> Rgb {
            Rgb::splat(f64::from(point.footprint.uv[0].x.abs().min(1.0)))
        }
    }

    #[test]
    #[should_panic(expected = "footprints must declare that it needs them")]
    fn an_undeclared_need_of_footprints_is_found() {
        texture_laws(&Wide);
    }

    struct Claims;

    impl Texture for Claims {
        fn needs(&self) -> SurfaceAttributes {
            SurfaceAttributes::UV
        }
        fn value(&self, point: &SurfaceInteraction) -> Rgb {
            Rgb::splat(f64::from(point.uv.x > 0.5))
        }
        fn constant(&self) -> Option<Rgb> {
            Some(Rgb::BLACK)
        }
    }

    #[test]
    #[should_panic(expected = "a texture declared constant")]
    fn a_false_constant_is_found() {
        texture_laws(&Claims);
    }
}
