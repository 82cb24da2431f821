//! Shadow rays: what hides a light, and what lets a part of it through.

use crate::{Counters, Interval, LightSample, Lobes, Medium, Ray, Rgb, Skip, SurfacePoint, World};
use glam::DVec3;

/// Light of which less than this is left in every channel counts as none: the cut of the lecture
/// notes.
const CUT: f64 = 0.002;

/// A shadow ray that has gone through so many surfaces is hidden.
const MOST_CROSSINGS: usize = 1000;

/// What stands between a surface and a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shadowing {
    /// Nothing: every light is visible.
    None,
    /// All surfaces, but for their holes.
    Opaque,
    /// All surfaces; what is transparent lets light through.
    Filtered,
}

impl Shadowing {
    /// What surfaces do that matters to shadow rays.
    pub(crate) fn passing(self) -> Lobes {
        match self {
            Self::None => Lobes::NOTHING,
            Self::Opaque => Lobes::HOLES,
            Self::Filtered => Lobes::HOLES | Lobes::FILTERS,
        }
    }
}

/// The ray from a point to a light, and how far it must be free: some roundings of the coordinates
/// less than to the light. So a surface that holds the light does not hide it, as the model demands
/// of anything that is not strictly between. `margin`: see [`World::light_margin`].
#[inline(always)]
pub(crate) fn shadow_ray(point: &SurfacePoint, sample: &LightSample, margin: f64) -> (Ray, f64) {
    let coordinates = point.position.abs().max_element() + sample.distance;
    let free = if sample.distance == f64::INFINITY {
        f64::INFINITY
    } else {
        sample.distance - (8.0 * f64::EPSILON * coordinates + margin)
    };
    let ray = Ray::new(point.position, sample.direction);
    aim(&ray, free, point.leave(sample.direction))
}

/// The ray from `start` to where another one, that begins nearly there, is after `free` metres, and
/// its length. In the direction of the other one it would cross a plane through that place earlier,
/// by the way between the two over the slope.
#[inline(always)]
fn aim(ray: &Ray, free: f64, start: DVec3) -> (Ray, f64) {
    let moved = start - ray.origin;
    let way = ray.direction * free - moved;
    let length = way.length();
    // Neither without end nor behind the start; written so that NaN does not pass.
    if (way.dot(ray.direction) > 0.0) & (length < f64::INFINITY) {
        (Ray::new(start, way / length), length)
    } else {
        (Ray::new(start, ray.direction), free - moved.dot(ray.direction))
    }
}

impl World {
    /// Whether some surface lets light through, so that it does not do to ask if any is hit.
    pub(crate) fn lets_through(&self, shadowing: Shadowing) -> bool {
        self.lobes.intersects(shadowing.passing())
    }

    /// The share of light that comes along a shadow ray from `free` metres away. `medium` is what
    /// the ray starts in; only filtered shadows see it.
    pub(crate) fn light_through(
        &self,
        ray: Ray,
        free: f64,
        skip: Skip,
        medium: Medium,
        shadowing: Shadowing,
        counters: &mut Counters,
    ) -> Rgb {
        let filtered = shadowing == Shadowing::Filtered;
        let Medium {
            absorption,
            mut inside,
        } = medium;
        let mut medium = if filtered { absorption } else { Rgb::BLACK };
        let (mut ray, mut free, mut skip) = (ray, free, skip);
        let mut left = Rgb::WHITE;
        for _ in 0..MOST_CROSSINGS {
            counters.shadow += 1;
            let Some(hit) = self.accelerator.closest(&ray, Interval::up_to(free), skip) else {
                return left * medium.transmittance(free.max(0.0));
            };
            let material = &self.materials[hit.shape as usize];
            if !self.lobes_of(hit.shape).intersects(shadowing.passing()) {
                return Rgb::BLACK;
            }
            self.count_shaded(hit.shape, 1, counters);
            let point = self.surface(&ray, &hit).seen_from(-ray.direction);
            let face = self.face(hit.shape, inside, &point, -ray.direction);
            let filter = match (face, material.overlapping()) {
                (Some(face), Some(body)) if filtered => {
                    inside = face.behind;
                    face.filter(body, &point, ray.direction)
                }
                _ => material.shadow(&point, ray.direction, filtered),
            };
            left = left * medium.transmittance(hit.t) * filter.weight;
            if left.max_component() < CUT {
                return Rgb::BLACK;
            }
            medium = filter.medium.unwrap_or(medium);
            (ray, free) = aim(&ray, free, point.leave(ray.direction));
            skip = Skip::leaving(&hit);
        }
        Rgb::BLACK
    }
}
