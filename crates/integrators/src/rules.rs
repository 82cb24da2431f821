//! Single-ray traversal of ray trees, shared by the integrators.

use crate::local_illumination::{local_illumination, split_local_illumination};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use whitstone_core::config::NonNegative;
use whitstone_core::{
    BsdfFlags, DVec3, DirectLighting, Interval, MediumState, PathEnd, PathState, Ray, Rgb, Scene, Scratch,
    SelfHitFilter, SpecularRay, SpecularRayKind, SpecularRays, SurfaceInteraction,
};

/// The rays that are traced at a surface.
pub(crate) struct Rules {
    pub(crate) lighting: DirectLighting,
    /// `None`: local illumination only.
    pub(crate) branches: Option<Limits>,
}

/// The default of thresholds: nothing is left out.
pub(crate) fn zero() -> NonNegative {
    NonNegative::new(0.0).expect("0 is not negative")
}

/// Limits on tracing branches.
#[derive(Clone, Copy)]
pub(crate) struct Limits {
    pub(crate) max_depth: u32,
    pub(crate) min_contribution: f64,
    pub(crate) beyond: Beyond,
}

/// Radiance of branches beyond the depth limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Beyond {
    /// The background in the direction of the branch.
    #[default]
    Background,
    /// Black.
    Black,
}

impl Rules {
    /// Radiance along one camera ray. Its tree is traversed depth first, within the limits of
    /// `scratch`.
    pub(crate) fn radiance(&self, scene: &Scene, ray: &Ray, scratch: &mut Scratch) -> Rgb {
        scratch.pending.clear();
        let mut sum = Rgb::BLACK;
        let mut next = Some(PathState {
            differential: scratch.differential.take(),
            ..PathState::camera(*ray)
        });
        let mut rays = 0;
        while let Some(path) = next.take().or_else(|| scratch.pending.pop()) {
            rays += 1;
            if !scratch.allows(0, rays, scratch.pending.len()) {
                break;
            }
            sum += self.trace(scene, &path, scratch, &mut next);
        }
        sum
    }

    /// The contribution of this ray alone to the pixel. Its first branch is left in `next`; the
    /// others are pushed to the stack.
    fn trace(
        &self,
        scene: &Scene,
        path: &PathState,
        scratch: &mut Scratch,
        next: &mut Option<PathState>,
    ) -> Rgb {
        scratch.counters.closest += 1;
        let Some(hit) = scene
            .accelerator
            .intersect(&path.ray, Interval::FORWARD, path.skip)
        else {
            let background = endless(scene, path.absorption, path.ray.direction);
            scratch.note(path, None, path.throughput, background);
            let radiance = path.throughput * background;
            if let Some(paths) = &mut scratch.paths {
                paths.add(path.class_state, PathEnd::Background, radiance);
            }
            return radiance;
        };
        let throughput = path.throughput * path.absorption.transmittance(hit.t);
        let view = -path.ray.direction;
        let mut point = scene.surface(&path.ray, &hit).seen_from(view);
        if throughput.is_black() {
            scratch.note(path, Some((&hit, &point)), throughput, Rgb::BLACK);
            return Rgb::BLACK;
        }
        point.footprint = scene.footprint(&path.ray, &hit, &point, path.differential.as_ref());
        let skip = SelfHitFilter::leaving(&hit);
        let lobes = scene.flags_of(hit.shape);
        scene.count_shaded(hit.shape, 1, &mut scratch.counters);
        let mut local = Rgb::BLACK;
        if lobes.intersects(BsdfFlags::LOCAL_OR_EMISSIVE) {
            let medium = MediumState {
                absorption: path.absorption,
                inside: path.inside,
            };
            local = local_illumination(
                self.lighting,
                scene,
                hit.shape,
                &point,
                view,
                skip,
                medium,
                scratch,
            );
            if let Some(paths) = &mut scratch.paths {
                let lights = &scratch.incoming;
                split_local_illumination(scene, hit.shape, &point, view, lights, |end, part| {
                    paths.add(path.class_state, end, throughput * part);
                });
            }
        }
        let node = scratch.note(path, Some((&hit, &point)), throughput, local);
        let mut sum = throughput * local;
        if let Some(limits) = self.branches
            && lobes.intersects(BsdfFlags::SPECULAR)
        {
            let mut branches = SpecularRays::default();
            scene.specular_rays(hit.shape, path.inside, &point, view, &mut branches);
            let face = scene.face(hit.shape, path.inside, &point, view);
            // Visited in reverse, so that the first branch ends up in `next` and is traced first.
            scene.for_each_branch_rev(hit.shape, &point, view, &branches, |branch, letter| {
                let Some(mut child) = follow(path, branch, &point, view, skip, throughput, limits) else {
                    return;
                };
                child.origin = Some((node, letter));
                if let Some(paths) = &scratch.paths {
                    child.class_state = paths.after(path.class_state, letter);
                }
                child.inside = face.map_or(path.inside, |face| face.inside(branch.kind));
                if path.depth < limits.max_depth {
                    child.differential = path.differential.map(|differential| {
                        // All directions of a lobe use the differentials of the specular ray that
                        // is spread.
                        let mut own = branches.iter().filter(|own| own.kind == branch.kind);
                        let direction = own.next().map_or(branch.direction, |own| own.direction);
                        let branch = (branch.kind.into(), direction);
                        scene.differential_of_branch(
                            &differential,
                            &path.ray,
                            &hit,
                            &point,
                            branch,
                            path.inside,
                        )
                    });
                    scratch.pending.extend(next.replace(child));
                } else if limits.beyond == Beyond::Background {
                    let limit = endless(scene, child.absorption, branch.direction);
                    scratch.note_limit(&child, limit);
                    let radiance = child.throughput * limit;
                    if let Some(paths) = &mut scratch.paths {
                        paths.add(child.class_state, PathEnd::Background, radiance);
                    }
                    sum += radiance;
                }
            });
        }
        sum
    }
}

/// The ray of a branch; `None` if rule G (section 8 of the Whitted model) or its
/// weight drops it.
fn follow(
    path: &PathState,
    branch: &SpecularRay,
    point: &SurfaceInteraction,
    view: DVec3,
    skip: SelfHitFilter,
    throughput: Rgb,
    limits: Limits,
) -> Option<PathState> {
    let SpecularRay {
        direction,
        weight,
        kind,
    } = *branch;
    let (allowed, absorption) = match kind {
        SpecularRayKind::Reflection => (point.same_side(view, direction), path.absorption),
        SpecularRayKind::Transmission { absorption } => (point.opposite_sides(view, direction), absorption),
        SpecularRayKind::Null => (point.opposite_sides(view, direction), path.absorption),
    };
    let throughput = throughput * weight;
    let contribution = throughput.max_component();
    // Children of the deepest rays exceed the limit by one; they are never traced.
    let depth = path.depth + 1;
    (allowed && contribution > 0.0 && contribution >= limits.min_contribution).then(|| PathState {
        ray: Ray::new(point.spawn_origin(direction), direction),
        skip,
        throughput,
        absorption,
        inside: path.inside,
        depth,
        origin: None,
        class_state: 0,
        differential: None,
    })
}

/// Background radiance after an endless segment in a medium.
pub(crate) fn endless(scene: &Scene, absorption: Rgb, direction: DVec3) -> Rgb {
    absorption.transmittance(f64::INFINITY) * scene.background(direction)
}
