//! Shared code of the integrators: shadow modes and local illumination.

use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::{
    DVec3, Illumination, Lobes, Medium, Rgb, Scratch, Shadowing, Skip, SurfacePoint, World,
};

/// Treatment of surfaces between a surface point and a light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Shadows {
    /// Every surface hides the lights behind it, except through its holes.
    #[default]
    Opaque,
    /// Transparent surfaces attenuate the light that passes straight through them.
    Filtered,
    /// Every light is visible.
    None,
}

impl From<Shadows> for Shadowing {
    fn from(shadows: Shadows) -> Self {
        match shadows {
            Shadows::Opaque => Self::Opaque,
            Shadows::Filtered => Self::Filtered,
            Shadows::None => Self::None,
        }
    }
}

impl Shadows {
    /// Whether surfaces hide lights.
    pub(crate) fn hide(self) -> bool {
        self != Self::None
    }

    /// Emission plus reflected light from the visible lights, towards `view`. `medium` is the one
    /// on the viewer's side.
    #[allow(clippy::too_many_arguments, reason = "all that shading depends on")]
    pub(crate) fn local(
        self,
        world: &World,
        shape: u32,
        point: &SurfacePoint,
        view: DVec3,
        skip: Skip,
        medium: Medium,
        scratch: &mut Scratch,
    ) -> Rgb {
        let (material, lobes) = (&world.materials[shape as usize], world.lobes_of(shape));
        let mut sum = Rgb::BLACK;
        if lobes.contains(Lobes::LOCAL) {
            world.gather_lights(point, view, skip, self.into(), medium, scratch);
            let light = Illumination {
                ambient: world.ambient,
                lights: &scratch.incoming,
            };
            sum = material.local(point, view, &light);
        }
        if lobes.contains(Lobes::EMISSION) {
            sum += material.emission(point, view);
        }
        sum
    }
}
