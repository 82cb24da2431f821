//! Rays of the caller.

use crate::Pipeline;
use rayon::prelude::*;
use whitstone_core::stream::{HitStream, LANES, RayStream};
use whitstone_core::{PreliminaryIntersection, Ray, SelfHitFilter};

impl Pipeline {
    /// The nearest hit of each ray, on all threads of the current pool. Directions must be of unit
    /// length.
    pub fn trace(&self, rays: &[Ray]) -> Vec<Option<PreliminaryIntersection>> {
        let mut found = vec![None; rays.len()];
        rays.par_chunks(LANES)
            .zip(found.par_chunks_mut(LANES))
            .for_each_init(
                Default::default,
                |memory: &mut (Box<RayStream>, Box<HitStream>), (rays, found)| {
                    let (stream, hits) = memory;
                    stream.len = rays.len();
                    for (lane, ray) in rays.iter().enumerate() {
                        stream.set(lane, *ray, f64::INFINITY, SelfHitFilter::NOTHING);
                    }
                    self.scene.accelerator.intersect_stream(stream, hits);
                    for (lane, found) in found.iter_mut().enumerate() {
                        *found = hits.get(lane);
                    }
                },
            );
        found
    }
}
