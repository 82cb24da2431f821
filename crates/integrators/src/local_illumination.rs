//! Shared code of the integrators: emission and local illumination.

use whitstone_core::{
    BsdfFlags, DVec3, DirectLighting, IncidentLight, LightSamples, MediumState, PathEnd, Rgb, Scene, Scratch,
    SelfHitFilter, SurfaceInteraction,
};

/// Radiance towards `view`: emission, and reflected light of the ambient term and of the lights
/// that `point` sees. `medium`: the medium on the viewer's side.
#[allow(clippy::too_many_arguments, reason = "all that shading depends on")]
pub(crate) fn local_illumination(
    lighting: DirectLighting,
    scene: &Scene,
    shape: u32,
    point: &SurfaceInteraction,
    view: DVec3,
    skip: SelfHitFilter,
    medium: MediumState,
    scratch: &mut Scratch,
) -> Rgb {
    let (material, flags) = (&scene.materials[shape as usize], scene.flags_of(shape));
    let mut sum = Rgb::BLACK;
    if flags.contains(BsdfFlags::LOCAL) {
        scene.gather_lights(point, view, skip, lighting, medium, scratch);
        let light = LightSamples {
            ambient: scene.ambient,
            lights: &scratch.incoming,
        };
        sum = material.local_illumination(point, view, &light);
    }
    if flags.contains(BsdfFlags::EMISSION) {
        sum += material.emission(point, view);
    }
    sum
}

/// The parts of [`local_illumination`] by the ends of their paths. Their sum is equal to it, except
/// for rounding. `lights`: those that it gathered.
pub(crate) fn split_local_illumination(
    scene: &Scene,
    shape: u32,
    point: &SurfaceInteraction,
    view: DVec3,
    lights: &[IncidentLight],
    mut add: impl FnMut(PathEnd, Rgb),
) {
    let (material, flags) = (&scene.materials[shape as usize], scene.flags_of(shape));
    if flags.contains(BsdfFlags::LOCAL) {
        let parts = [
            (PathEnd::Light, Rgb::BLACK, lights),
            (PathEnd::Ambient, scene.ambient, &[]),
        ];
        for (end, ambient, lights) in parts {
            add(
                end,
                material.local_illumination(point, view, &LightSamples { ambient, lights }),
            );
        }
    }
    if flags.contains(BsdfFlags::EMISSION) {
        add(PathEnd::Emission, material.emission(point, view));
    }
}
