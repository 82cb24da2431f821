//! Rays of the caller.

use crate::Pipeline;
use rayon::prelude::*;
use whitstone_core::stream::{HitStream, LANES, RayStream};
use whitstone_core::{PreliminaryIntersection, Ray, SelfHitFilter};

impl Pipeline {
    /// The nearest hit of each ray, on all threads of the current pool. Directions need not be of
    /// unit length; the parameter of a hit is its distance.
    ///
    /// # Panics
    /// `hits` has another length than `rays`.
    pub fn trace_into(&self, rays: &[Ray], hits: &mut [Option<PreliminaryIntersection>]) {
        assert_eq!(rays.len(), hits.len(), "the numbers of rays and of hits differ");
        rays.par_chunks(LANES)
            .zip(hits.par_chunks_mut(LANES))
            .for_each_init(
                Default::default,
                |memory: &mut (Box<RayStream>, Box<HitStream>), (rays, hits)| {
                    let (stream, found) = memory;
                    stream.len = rays.len();
                    for (lane, ray) in rays.iter().enumerate() {
                        let unit = Ray::new(ray.origin, ray.direction.normalize());
                        stream.set(lane, unit, f64::INFINITY, SelfHitFilter::NOTHING);
                    }
                    self.scene.accelerator.intersect_stream(stream, found);
                    for (lane, hit) in hits.iter_mut().enumerate() {
                        *hit = found.get(lane);
                    }
                },
            );
    }
}
