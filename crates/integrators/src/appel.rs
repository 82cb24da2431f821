//! Ray casting: local illumination with shadows, without reflected or refracted rays.
//!
//! Appel 1968, *Some techniques for shading machine renderings of solids*. Purely specular
//! materials are black; an `emissive` around one shows its emission.
//!
//! - Twin: the Mitsuba driver at depth 0, without branches.
//! - Example: `scenes/integrators/appel.toml`.

use crate::rules::{Rules, zero};
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::config::NonNegative;
use whitstone_core::stream::{Colors, HitStream, RayStream};
use whitstone_core::{
    Context, DirectLighting, Integrator, Integrators, Plugin, Ray, Rgb, Scene, SceneErrors, Scratch,
    ShadowMode,
};

/// Ray casting: local illumination with shadows, without reflected or refracted rays.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// "opaque": surfaces block light, except in the holes of the material `mask` and on shapes
    /// with `casts_shadow = false`; "filtered": transparent surfaces also let light pass straight
    /// through, attenuated; "none": no shadows.
    #[serde(default)]
    shadows: ShadowMode,
    /// A light sample (a light, or a point of an area light) does not count where its irradiance is
    /// below this in every channel, in W/m².
    #[serde(default = "zero")]
    light_cutoff: NonNegative,
}

/// The `appel` integrator; see the module documentation.
pub struct Appel {
    rules: Rules,
}

impl Plugin<Integrators> for Appel {
    const TYPE: &'static str = "appel";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Box<dyn Integrator>, SceneErrors> {
        Ok(Box::new(Self {
            rules: Rules {
                lighting: DirectLighting {
                    shadows: config.shadows,
                    light_cutoff: config.light_cutoff.get(),
                },
                branches: None,
            },
        }))
    }
}

impl Integrator for Appel {
    fn follows_branches(&self) -> bool {
        false
    }

    fn splits_paths(&self) -> bool {
        true
    }

    fn radiance(&self, scene: &Scene, ray: &Ray, scratch: &mut Scratch) -> Rgb {
        self.rules.radiance(scene, ray, scratch)
    }

    fn radiance_stream(&self, scene: &Scene, rays: &RayStream, scratch: &mut Scratch, out: &mut Colors) {
        self.rules.radiance_stream(scene, rays, scratch, out);
    }

    fn shade_stream(
        &self,
        scene: &Scene,
        rays: &RayStream,
        hits: &mut Box<HitStream>,
        scratch: &mut Scratch,
        out: &mut Colors,
    ) {
        if scene.requires_scalar_tracing() {
            self.radiance_stream(scene, rays, scratch, out);
        } else {
            scratch.counters.closest += rays.len as u64;
            self.rules.shade_stream(scene, rays, hits, scratch, out);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{build, integrator_laws};

    #[test]
    fn laws() {
        for (text, shadows) in [("", true), ("shadows = \"none\"", false)] {
            integrator_laws(&*build::<Integrators, Appel>(text, ()).unwrap(), shadows);
        }
    }
}
