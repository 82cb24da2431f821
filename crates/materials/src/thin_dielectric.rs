//! A dielectric pane of zero thickness: a window, a soap bubble, the wall of an empty glass.
//!
//! Stokes 1862, *On the intensity of the light reflected from or transmitted through a pile of
//! plates*. Each of the two faces has the Fresnel reflectance R and the transmittance `T = 1 - R`.
//! All interreflections sum to the reflectance `R + T² R (1 + R² + R⁴ + ...) = 2R/(1 + R)` and the
//! transmittance `T²/(1 - R²) = (1 - R)/(1 + R)`. The transmitted ray keeps its direction. There is
//! no interference.
//!
//! - Twin: Mitsuba `thindielectric` (native).
//! - Example: `scenes/materials/thin_dielectric.toml`.

use crate::support::optics::{Interface, reflect};
use crate::support::reflectance::share;
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::{Positive, TextureRef};
use whitstone_core::stream::{GROUP, SurfaceStream, groups};
use whitstone_core::{
    BsdfFlags, ColorSource, Context, DVec3, Material, Materials, Plugin, Rgb, SceneErrors, SpecularRay,
    SpecularRayKind, SpecularRayStreams, SpecularRays, SurfaceAttributes, SurfaceInteraction, Transmittance,
    simd,
};

/// A dielectric pane of zero thickness, with all reflections between its two faces.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Index of refraction of the pane.
    #[serde(default = "glass")]
    interior_ior: Positive,
    /// Index of refraction on both sides of the pane.
    #[serde(default = "vacuum")]
    exterior_ior: Positive,
    /// Factor on the transmitted radiance, from 0 to 1; a texture or a colour.
    #[serde(default = "one")]
    tint: TextureRef,
}

fn glass() -> Positive {
    Positive::new(1.5).expect("1.5 is positive")
}

fn vacuum() -> Positive {
    Positive::new(1.0).expect("1 is positive")
}

fn one() -> TextureRef {
    TextureRef::grey(1.0)
}

/// The `thin_dielectric` material; see the module documentation.
pub struct ThinDielectric {
    face: Interface,
    tint: ColorSource,
}

impl Plugin<Materials> for ThinDielectric {
    const TYPE: &'static str = "thin_dielectric";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        Ok(Arc::new(Self {
            face: Interface::new(config.exterior_ior.get(), config.interior_ior.get()),
            tint: share(&config.tint, "a tint", context)?,
        }))
    }
}

impl ThinDielectric {
    /// Reflectance and transmittance of the whole pane, both faces included.
    #[inline(always)]
    fn shares(&self, n: DVec3, view: DVec3) -> (f64, f64) {
        let fresnel = self.face.shares(n, view);
        let whole = 1.0 + fresnel.reflected;
        (2.0 * fresnel.reflected / whole, fresnel.transmitted / whole)
    }
}

impl Material for ThinDielectric {
    fn flags(&self) -> BsdfFlags {
        let mut lobes = BsdfFlags::NOTHING;
        if !self.face.is_open() {
            lobes = lobes | BsdfFlags::REFLECTION;
        }
        if !self.tint.is_black() {
            lobes = lobes | BsdfFlags::NULL | BsdfFlags::TRANSPARENT_SHADOWS;
        }
        lobes
    }

    fn needs(&self) -> SurfaceAttributes {
        SurfaceAttributes::SHADING_NORMAL | self.tint.needs()
    }

    fn shadow_transmittance(
        &self,
        point: &SurfaceInteraction,
        direction: DVec3,
        filtered: bool,
    ) -> Transmittance {
        if !filtered {
            return Transmittance::OPAQUE;
        }
        let (_, transmitted) = self.shares(point.n_towards(-direction), -direction);
        Transmittance::straight(self.tint.value(point) * transmitted)
    }

    fn specular_rays(&self, point: &SurfaceInteraction, view: DVec3, out: &mut SpecularRays) {
        let n = point.n_towards(view);
        let (reflected, transmitted) = self.shares(n, view);
        if reflected > 0.0 {
            out.push(SpecularRay {
                direction: reflect(n, view),
                weight: Rgb::splat(reflected),
                kind: SpecularRayKind::Reflection,
            });
        }
        let weight = self.tint.value(point) * transmitted;
        if !weight.is_black() {
            out.push(SpecularRay {
                direction: -view,
                weight,
                kind: SpecularRayKind::Null,
            });
        }
    }

    fn specular_rays_stream(&self, points: &SurfaceStream, out: &mut SpecularRayStreams) {
        self.tint.value_stream(points, &mut out.transmission.weight);
        out.undeviated.0[..points.len].fill(true);
        simd::dispatch(
            #[inline(always)]
            || {
                for start in groups(points.len) {
                    for lane in start..start + GROUP {
                        let view = points.view.get(lane);
                        let n = points.get(lane).n_towards(view);
                        let (reflected, transmitted) = self.shares(n, view);
                        out.reflection.direction.set(lane, reflect(n, view));
                        out.reflection.weight.set(lane, Rgb::splat(reflected));
                        out.transmission.direction.set(lane, -view);
                        let tint = out.transmission.weight.get(lane);
                        out.transmission.weight.set(lane, tint * transmitted);
                        out.absorption.set(lane, Rgb::BLACK);
                    }
                }
            },
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{build, furnace_laws, material_laws};

    fn specular_rays(text: &str, view: DVec3) -> Vec<SpecularRay> {
        let mut out = SpecularRays::default();
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        build::<Materials, ThinDielectric>(text, ())
            .unwrap()
            .specular_rays(&point, view, &mut out);
        out.iter().copied().collect()
    }

    #[test]
    fn laws() {
        for text in [
            "",
            "tint = [1, 0.3, 0]",
            "interior_ior = 1",
            "interior_ior = 1\nexterior_ior = 1.5",
            "interior_ior = 1e6\ntint = 0",
            "interior_ior = 1.000000000001",
        ] {
            let material = build::<Materials, ThinDielectric>(text, ()).unwrap();
            material_laws(&*material);
            furnace_laws(&*material);
        }
    }

    #[test]
    fn both_faces_together() {
        // R = 0.04 at each face: 0.08/1.04 is reflected.
        for view in [DVec3::Z, DVec3::NEG_Z] {
            let found = specular_rays("tint = [1, 0.5, 0]", view);
            let [r, t] = found[..] else { panic!("{found:?}") };
            assert!((r.weight.g - 0.08 / 1.04).abs() < 1e-16);
            assert!((t.weight.r - 0.96 / 1.04).abs() < 1e-15);
            assert_eq!((t.weight.g, t.weight.b), (0.5 * t.weight.r, 0.0));
            assert_eq!((t.direction, t.kind), (-view, SpecularRayKind::Null));
        }
    }

    #[test]
    fn a_pane_of_two_faces_is_the_sum_of_all_paths_in_it() {
        // R + T R T + T R R R T + ...
        let view = DVec3::new(0.8, 0.0, 0.6);
        let face = Interface::new(1.0, 1.7);
        let fresnel = face.fresnel(&face.cross(DVec3::Z, view));
        let (r, t) = (fresnel.reflected, fresnel.transmitted);
        let (mut back, mut on, mut inside) = (r, 0.0, t);
        for _ in 0..60 {
            on += inside * t;
            inside *= r;
            back += inside * t;
            inside *= r;
        }
        let found = specular_rays("interior_ior = 1.7", view);
        assert!((found[0].weight.g - back).abs() < 1e-15);
        assert!((found[1].weight.g - on).abs() < 1e-15);
    }

    #[test]
    fn a_pane_of_air_reflects_totally() {
        let found = specular_rays("interior_ior = 1\nexterior_ior = 1.5", DVec3::new(0.8, 0.0, 0.6));
        let [r] = found[..] else { panic!("{found:?}") };
        assert_eq!((r.weight, r.kind), (Rgb::WHITE, SpecularRayKind::Reflection));
    }

    #[test]
    fn a_pane_of_what_is_around_it_reflects_nothing() {
        let found = specular_rays("interior_ior = 1", DVec3::Z);
        let [t] = found[..] else { panic!("{found:?}") };
        assert_eq!((t.weight, t.kind), (Rgb::WHITE, SpecularRayKind::Null));
    }

    #[test]
    fn only_filtered_shadows_go_through() {
        let material = build::<Materials, ThinDielectric>("tint = 0.5", ()).unwrap();
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        assert_eq!(
            material.shadow_transmittance(&point, DVec3::Z, false),
            Transmittance::OPAQUE
        );
        let filter = material.shadow_transmittance(&point, DVec3::Z, true);
        assert!((filter.weight.g - 0.5 * 0.96 / 1.04).abs() < 1e-15);
        assert_eq!(filter.medium, None);
    }

    #[test]
    fn bad_values_are_refused() {
        for text in [
            "interior_ior = 0",
            "exterior_ior = -1",
            "tint = 1.5",
            "absorption = 1",
        ] {
            assert!(build::<Materials, ThinDielectric>(text, ()).is_err(), "{text}");
        }
    }
}
