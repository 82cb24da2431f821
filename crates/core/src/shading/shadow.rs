//! Shadow rays: occlusion and transmittance between a surface and a light.

use crate::{
    BsdfFlags, Counters, Interval, LightSample, MediumState, Ray, Rgb, Scene, SelfHitFilter,
    SurfaceInteraction, Transmittance,
};
use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Transmittance below this in every channel counts as zero: the threshold of the lecture notes.
const CUT: f64 = 0.002;

/// A shadow ray that crosses this many surfaces counts as blocked.
const MAX_CROSSINGS: usize = 1000;

/// Treatment of surfaces between a surface point and a light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ShadowMode {
    /// Every surface hides the lights behind it, except through its holes, and except shapes that
    /// cast no shadow.
    #[default]
    Opaque,
    /// Transparent surfaces attenuate the light that passes straight through them.
    Filtered,
    /// Every light is visible.
    None,
}

/// The lights that count at a surface point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DirectLighting {
    /// Treatment of surfaces between the point and a light.
    pub shadows: ShadowMode,
    /// A light sample does not count if its irradiance is below this in every channel, in W/m².
    pub light_cutoff: f64,
}

impl ShadowMode {
    /// The BSDF flags of surfaces that let light through.
    pub(crate) fn passing(self) -> BsdfFlags {
        match self {
            Self::None => BsdfFlags::NOTHING,
            Self::Opaque => BsdfFlags::CUT_OUTS | BsdfFlags::NO_SHADOW,
            Self::Filtered => BsdfFlags::CUT_OUTS | BsdfFlags::NO_SHADOW | BsdfFlags::TRANSPARENT_SHADOWS,
        }
    }
}

/// The shadow ray from a point to a light, and the length that must be unoccluded: the distance
/// minus some roundings of the coordinates. A surface that coincides with the light therefore does
/// not block it; the model requires blockers to lie strictly between. `margin`: see
/// [`Scene::light_margin`].
#[inline(always)]
pub(crate) fn shadow_ray(point: &SurfaceInteraction, sample: &LightSample, margin: f64) -> (Ray, f64) {
    let coordinates = point.position.abs().max_element() + sample.distance;
    let free = if sample.distance == f64::INFINITY {
        f64::INFINITY
    } else {
        sample.distance - (8.0 * f64::EPSILON * coordinates + margin)
    };
    let ray = Ray::new(point.position, sample.direction);
    aim(&ray, free, point.spawn_origin(sample.direction))
}

/// The ray from `start`, near the origin of `ray`, to the point of `ray` at `free` metres, and its
/// length. With the direction of `ray` instead, it would reach a surface through that point too
/// early, by the offset between the rays over the slope.
#[inline(always)]
fn aim(ray: &Ray, free: f64, start: DVec3) -> (Ray, f64) {
    let moved = start - ray.origin;
    let way = ray.direction * free - moved;
    let length = way.length();
    // Fails for infinite lengths, points behind the start, and NaN.
    if (way.dot(ray.direction) > 0.0) & (length < f64::INFINITY) {
        (Ray::new(start, way / length), length)
    } else {
        (Ray::new(start, ray.direction), free - moved.dot(ray.direction))
    }
}

impl Scene {
    /// Whether some surface lets light through, so that an occlusion test does not suffice.
    pub(crate) fn lets_through(&self, shadowing: ShadowMode) -> bool {
        self.flags.intersects(shadowing.passing())
    }

    /// Transmittance of a shadow ray from its origin up to `free` metres. `medium` is the medium at
    /// the origin; only filtered shadows use it.
    pub(crate) fn light_through(
        &self,
        ray: Ray,
        free: f64,
        skip: SelfHitFilter,
        medium: MediumState,
        shadowing: ShadowMode,
        counters: &mut Counters,
    ) -> Rgb {
        let filtered = shadowing == ShadowMode::Filtered;
        let MediumState {
            absorption,
            mut inside,
        } = medium;
        let mut medium = if filtered { absorption } else { Rgb::BLACK };
        let (mut ray, mut free, mut skip) = (ray, free, skip);
        let mut left = Rgb::WHITE;
        for _ in 0..MAX_CROSSINGS {
            counters.shadow += 1;
            let Some(hit) = self.accelerator.intersect(&ray, Interval::up_to(free), skip) else {
                return left * medium.transmittance(free.max(0.0));
            };
            let material = &self.materials[hit.shape as usize];
            if !self.flags_of(hit.shape).intersects(shadowing.passing()) {
                return Rgb::BLACK;
            }
            let point = self.surface(&ray, &hit).seen_from(-ray.direction);
            let filter = if self.flags_of(hit.shape).intersects(BsdfFlags::NO_SHADOW) {
                Transmittance::straight(Rgb::WHITE)
            } else {
                self.count_shaded(hit.shape, 1, counters);
                let face = self.face(hit.shape, inside, &point, -ray.direction);
                match (face, material.prioritized()) {
                    (Some(face), Some(body)) if filtered => {
                        inside = face.behind;
                        face.filter(body, &point, ray.direction)
                    }
                    _ => material.shadow_transmittance(&point, ray.direction, filtered),
                }
            };
            left = left * medium.transmittance(hit.t) * filter.weight;
            if left.max_component() < CUT {
                return Rgb::BLACK;
            }
            medium = filter.medium.unwrap_or(medium);
            (ray, free) = aim(&ray, free, point.spawn_origin(ray.direction));
            skip = SelfHitFilter::leaving(&hit);
        }
        Rgb::BLACK
    }
}
