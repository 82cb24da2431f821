//! What the integrators share: how they treat shadows, and local shading.

use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::{DVec3, Illumination, Material, Rgb, Scratch, Skip, SurfacePoint, World};

/// What stands between a surface and a light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Shadows {
    /// Every surface hides the lights behind it.
    #[default]
    Opaque,
    /// Every light is visible.
    None,
}

impl Shadows {
    /// Whether surfaces hide lights.
    pub(crate) fn hide(self) -> bool {
        self == Self::Opaque
    }

    /// Radiance towards `view` from the lights that reach the point.
    pub(crate) fn local(
        self,
        world: &World,
        material: &dyn Material,
        point: &SurfacePoint,
        view: DVec3,
        skip: Skip,
        scratch: &mut Scratch,
    ) -> Rgb {
        world.gather_lights(point, view, skip, self.hide(), scratch);
        let light = Illumination {
            ambient: world.ambient,
            lights: &scratch.incoming,
        };
        material.local(point, view, &light)
    }
}
