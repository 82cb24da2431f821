//! Ray casting: local shading with shadows, without reflected or refracted rays.
//!
//! Appel 1968, *Some techniques for shading machine renderings of solids*. Delta materials are black.
//!
//! - Twin: the driver at depth 0, without branches.
//! - Example: `scenes/integrators/appel.toml`.

use crate::shadows::Shadows;
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::{
    Context, Integrator, Integrators, Interval, Lobes, PathState, Plugin, Ray, Rgb, SceneErrors, Scratch,
    Skip, World,
};

/// Ray casting: local shading with shadows, without reflected or refracted rays.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// "opaque": surfaces hide lights; "none": every light is visible.
    #[serde(default)]
    shadows: Shadows,
}

/// See the module.
pub struct Appel {
    shadows: Shadows,
}

impl Plugin<Integrators> for Appel {
    const TYPE: &'static str = "appel";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Box<dyn Integrator>, SceneErrors> {
        Ok(Box::new(Self {
            shadows: config.shadows,
        }))
    }
}

impl Integrator for Appel {
    fn follows_branches(&self) -> bool {
        false
    }

    fn radiance(&self, world: &World, ray: &Ray, scratch: &mut Scratch) -> Rgb {
        scratch.counters.closest += 1;
        let path = PathState::camera(*ray);
        let Some(hit) = world.accelerator.closest(ray, Interval::FORWARD, Skip::NOTHING) else {
            let background = world.background(ray.direction);
            scratch.note(&path, None, Rgb::WHITE, background);
            return background;
        };
        let material = &*world.materials[hit.shape as usize];
        let view = -ray.direction;
        let point = world.surface(ray, &hit).seen_from(view);
        let mut local = Rgb::BLACK;
        if material.lobes().contains(Lobes::LOCAL) {
            let skip = Skip::leaving(&hit);
            local = self.shadows.local(world, material, &point, view, skip, scratch);
        }
        scratch.note(&path, Some((&hit, &point)), Rgb::WHITE, local);
        local
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
