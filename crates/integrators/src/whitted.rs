//! Recursive ray tracing: local shading, and a reflected and a refracted ray at each surface that has them.
//!
//! Whitted 1980, *An improved illumination model for shaded display*. The tree of rays is walked depth
//! first, reflection before transmission, on an explicit stack: a hundred thousand bounces must not
//! exhaust that of the thread. Since a ray is replaced by its two branches, of which one is followed
//! first, the stack never holds more than `max_depth + 1` of them.
//!
//! - Twin: Mitsuba through the driver, which walks the same tree by levels.
//! - Example: `scenes/integrators/whitted.toml`.

use crate::shadows::Shadows;
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::config::{IntegerIn, NonNegative};
use whitstone_core::{
    Branch, BranchKind, Branches, Context, DVec3, Integrator, Integrators, Interval, Lobes, PathState,
    Plugin, Ray, Rgb, SceneErrors, Scratch, Skip, SurfacePoint, World,
};

/// Recursive ray tracing: local shading, and a reflected and a refracted ray at each surface that has them.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// How many reflections and refractions a camera ray may go through.
    #[serde(default = "six")]
    max_depth: IntegerIn<0, 100_000>,
    /// A branch is left out if its factor in the pixel is below this in every channel.
    #[serde(default = "zero")]
    min_contribution: NonNegative,
    /// What a branch beyond `max_depth` sees: the "background", as in the lecture notes, or "black".
    #[serde(default)]
    at_max_depth: AtMaxDepth,
    /// "opaque": surfaces hide lights; "none": every light is visible.
    #[serde(default)]
    shadows: Shadows,
}

fn six() -> IntegerIn<0, 100_000> {
    IntegerIn::new(6).expect("6 is in range")
}

fn zero() -> NonNegative {
    NonNegative::new(0.0).expect("0 is not negative")
}

/// What lies beyond the depth limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum AtMaxDepth {
    /// The background in the direction of the branch.
    #[default]
    Background,
    /// Nothing.
    Black,
}

/// See the module.
pub struct Whitted {
    max_depth: u32,
    min_contribution: f64,
    at_max_depth: AtMaxDepth,
    shadows: Shadows,
}

impl Plugin<Integrators> for Whitted {
    const TYPE: &'static str = "whitted";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Box<dyn Integrator>, SceneErrors> {
        Ok(Box::new(Self {
            max_depth: config.max_depth.get(),
            min_contribution: config.min_contribution.get(),
            at_max_depth: config.at_max_depth,
            shadows: config.shadows,
        }))
    }
}

impl Integrator for Whitted {
    fn follows_branches(&self) -> bool {
        true
    }

    fn radiance(&self, world: &World, ray: &Ray, scratch: &mut Scratch) -> Rgb {
        scratch.pending.clear();
        let camera = PathState {
            ray: *ray,
            skip: Skip::NOTHING,
            throughput: Rgb::WHITE,
            absorption: Rgb::BLACK,
            depth: 0,
            origin: None,
        };
        let mut sum = self.trace(world, &camera, scratch);
        while let Some(path) = scratch.pending.pop() {
            sum += self.trace(world, &path, scratch);
        }
        sum
    }
}

impl Whitted {
    /// What this ray alone adds to the pixel; its branches are left on the stack.
    fn trace(&self, world: &World, path: &PathState, scratch: &mut Scratch) -> Rgb {
        scratch.counters.closest += 1;
        let Some(hit) = world.accelerator.closest(&path.ray, Interval::FORWARD, path.skip) else {
            let background = endless(world, path.absorption, path.ray.direction);
            scratch.note(path, None, path.throughput, background);
            return path.throughput * background;
        };
        let throughput = path.throughput * path.absorption.transmittance(hit.t);
        if throughput.is_black() {
            return Rgb::BLACK;
        }
        let view = -path.ray.direction;
        let point = world.surface(&path.ray, &hit).seen_from(view);
        let skip = Skip::leaving(&hit);
        let material = &*world.materials[hit.shape as usize];
        let lobes = material.lobes();
        let mut local = Rgb::BLACK;
        if lobes.contains(Lobes::LOCAL) {
            local = self.shadows.local(world, material, &point, view, skip, scratch);
        }
        let node = scratch.note(path, Some((&hit, &point)), throughput, local);
        let mut sum = throughput * local;
        if lobes.intersects(Lobes::REFLECTION | Lobes::TRANSMISSION) {
            let mut branches = Branches::default();
            material.branches(&point, view, &mut branches);
            // Backwards: what is pushed last is traced first.
            for branch in branches.iter().rev() {
                let Some(mut child) = self.follow(path, branch, &point, view, skip, throughput) else {
                    continue;
                };
                child.origin = Some((node, branch.kind));
                if path.depth < self.max_depth {
                    scratch.pending.push(child);
                } else if self.at_max_depth == AtMaxDepth::Background {
                    sum += child.throughput * endless(world, child.absorption, branch.direction);
                }
            }
        }
        sum
    }

    /// The ray of a branch, unless it counts for nothing: by rule G, or for its weight.
    fn follow(
        &self,
        path: &PathState,
        branch: &Branch,
        point: &SurfacePoint,
        view: DVec3,
        skip: Skip,
        throughput: Rgb,
    ) -> Option<PathState> {
        let Branch {
            direction,
            weight,
            kind,
        } = *branch;
        let (allowed, absorption) = match kind {
            BranchKind::Reflection => (point.same_side(view, direction), path.absorption),
            BranchKind::Transmission { absorption } => (point.opposite_sides(view, direction), absorption),
        };
        let throughput = throughput * weight;
        let contribution = throughput.max_component();
        // One more than the limit for the children of the deepest rays, which are never traced.
        let depth = path.depth + 1;
        (allowed && contribution > 0.0 && contribution >= self.min_contribution).then(|| PathState {
            ray: Ray::new(point.leave(direction), direction),
            skip,
            throughput,
            absorption,
            depth,
            origin: None,
        })
    }
}

/// The background through an endless stretch of a medium.
fn endless(world: &World, absorption: Rgb, direction: DVec3) -> Rgb {
    absorption.transmittance(f64::INFINITY) * world.background(direction)
}
