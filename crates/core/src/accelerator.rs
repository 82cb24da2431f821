use crate::stream::{HitStream, Lanes, RayStream};
use crate::{Interval, RawHit, Ray, Skip};
use std::collections::BTreeMap;

/// A structure over a [`crate::Geometry`] that finds hits faster than trying everything.
///
/// **Same answer law**: every accelerator returns bit for bit what trying every element in order would
/// return: the nearest hit, at equal distance the lowest (shape, primitive). A node may be left out only
/// if it is *strictly* farther than the best hit.
pub trait Accelerator: Send + Sync {
    /// The nearest hit inside the interval.
    fn closest(&self, ray: &Ray, interval: Interval, skip: Skip) -> Option<RawHit>;

    /// Whether anything is hit inside the interval.
    fn occluded(&self, ray: &Ray, interval: Interval, skip: Skip) -> bool;

    /// [`Self::closest`] for every ray of a stream.
    fn closest_stream(&self, rays: &RayStream, hits: &mut HitStream) {
        hits.clear(rays);
        for lane in 0..rays.len {
            let skip = rays.skip.skip(lane);
            if let Some(hit) = self.closest(&rays.ray(lane), rays.interval(lane), skip) {
                hits.set(lane, &hit);
            }
        }
    }

    /// [`Self::occluded`] for every ray of a stream.
    fn occluded_stream(&self, rays: &RayStream, hidden: &mut Lanes<bool>) {
        for (lane, hidden) in hidden.iter_mut().enumerate().take(rays.len) {
            *hidden = self.occluded(&rays.ray(lane), rays.interval(lane), rays.skip.skip(lane));
        }
    }

    /// What was built, for people.
    fn statistics(&self) -> Statistics;
}

/// Figures that an accelerator reports about itself, by name, such as `nodes`, `leaves`, `depth`,
/// `bytes`, `sah_cost`, `build_seconds`.
pub type Statistics = BTreeMap<&'static str, f64>;
