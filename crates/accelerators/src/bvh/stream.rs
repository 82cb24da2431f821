//! Traversal of ray streams. The work before and after traversal is done for many rays at once in
//! SIMD registers. During traversal, rays of one octant go together (`packet`).

use super::packet::{Packet, Wanted, WantedStack};
use super::search::{SingleRay, Stack};
use super::{Eight, RaySets};
use crate::support::leaves::Slot;
use crate::support::leaves::child::Child;
use crate::support::leaves::frame::{Alone, LocalLane, LocalRays};
use crate::support::leaves::state::{Query, State, Streamed};
use whitstone_core::stream::{GROUP, HitStream, LANES, Lanes as RayLanes, RayStream};
use whitstone_core::triangle::{ShearedStream, TriangleHit};
use whitstone_core::{DVec2, DVec3, InstanceId, PreliminaryIntersection, ShapeHit};
use whitstone_simd::{Kernel, Level, Machine, with_lanes};

/// Finds the nearest hits of a stream; `hits` must be clear.
pub(super) fn intersect(bvh: &Eight, rays: &RayStream, hits: &mut HitStream) {
    search::<false>(bvh, rays, hits)
}

/// Finds whether each ray of a stream hits anything.
pub(super) fn occluded(bvh: &Eight, rays: &RayStream, hidden: &mut RayLanes<bool>) {
    search::<true>(bvh, rays, hidden);
}

/// Destination of the results.
pub(super) trait Answers {
    /// Stores the final result of a ray.
    fn set(&mut self, lane: usize, hit: Option<PreliminaryIntersection>);
    fn hits(&mut self) -> Option<&mut HitStream>;
}

impl Answers for HitStream {
    #[inline(always)]
    fn set(&mut self, lane: usize, hit: Option<PreliminaryIntersection>) {
        if let Some(hit) = hit {
            HitStream::set(self, lane, &hit);
        }
    }
    #[inline(always)]
    fn hits(&mut self) -> Option<&mut HitStream> {
        Some(self)
    }
}

impl Answers for RayLanes<bool> {
    #[inline(always)]
    fn set(&mut self, lane: usize, hit: Option<PreliminaryIntersection>) {
        self[lane] = hit.is_some();
    }
    #[inline(always)]
    fn hits(&mut self) -> Option<&mut HitStream> {
        None
    }
}

fn search<const ANY: bool>(bvh: &Eight, rays: &RayStream, answers: &mut impl Answers) {
    match bvh.root {
        Some(root) if !bvh.deep => {
            with_lanes(
                Level::Avx512,
                Stream::<ANY, _> {
                    bvh,
                    root,
                    rays,
                    answers,
                },
            );
        }
        _ => {
            for lane in 0..rays.len.min(LANES) {
                let (ray, skip) = (rays.ray(lane), rays.skip.skip(lane));
                let query = Query {
                    ray: &ray,
                    interval: rays.interval(lane),
                    skip,
                };
                answers.set(lane, bvh.find::<ANY>(&query));
            }
        }
    }
}

struct Stream<'a, const ANY: bool, A> {
    bvh: &'a Eight,
    root: Child,
    rays: &'a RayStream,
    answers: &'a mut A,
}

impl<const ANY: bool, A: Answers> Kernel for Stream<'_, ANY, A> {
    type Output = ();

    #[inline(always)]
    fn run<M: Machine>(self, m: M) {
        let Self {
            bvh,
            root,
            rays,
            answers,
        } = self;
        let mut stack = Stack::new();
        let mut wanted: WantedStack = [Wanted::default(); _];
        let mut candidates = Candidates([None; LANES]);
        let mut states = [State::new(&bvh.leaves, Streamed { rays, lane: 0 }); GROUP];
        let mut local = LocalRays::default();
        let mut alone = Alone::default();
        for start in rays.groups() {
            rays.prefetch(start + GROUP);
            bvh.leaves.frame.rays(rays, start, &mut local);
            let len = GROUP.min(rays.len - start);
            for k in 0..len {
                states[k].restart(start + k);
            }
            alone.clear();
            let mut limits = [f32::NEG_INFINITY; GROUP];
            for k in 0..len {
                let done = states[k].resolve_unbounded() && ANY;
                if !local.sound[k] {
                    states[k].resolve_all(bvh.leaves.slots.iter().map(|slot| slot.element()));
                } else if !done {
                    limits[k] = states[k].limit(&LocalLane(&local, k));
                }
            }
            let packed = len == GROUP && bvh.sets != RaySets::None;
            let octant = if packed { local.octant() } else { None };
            if let Some(octant) = octant {
                let mut packet = Packet {
                    bvh,
                    rays: &local,
                    alone: &mut alone,
                    states: &mut states,
                    limits,
                    octant,
                    axes: local.axes(),
                };
                packet.traverse::<ANY, M>(m, root, (1 << GROUP) - 1, &mut wanted, &mut stack);
                limits = packet.limits;
            } else {
                for k in 0..len {
                    if limits[k] > f32::NEG_INFINITY {
                        let one = SingleRay::<ANY> {
                            bvh,
                            state: &mut states[k],
                            local: alone.get(&local, k),
                            child: root,
                            stack: &mut stack,
                            limit: limits[k],
                        };
                        limits[k] = one.traverse();
                    }
                }
            }
            for k in 0..len {
                let lane = start + k;
                if !ANY {
                    if let Some((leaf, place)) = states[k].candidate() {
                        candidates.0[lane] = Some((leaf, place as u8));
                        continue;
                    }
                    states[k].resolve_pending(&LocalLane(&local, k), limits[k]);
                }
                answers.set(lane, states[k].best);
            }
        }
        if let Some(hits) = answers.hits() {
            candidates.decide(bvh, rays, hits);
        }
    }
}

/// For each ray, the only remaining triangle if there is just one; it is certainly hit.
struct Candidates([Option<(Child, u8)>; LANES]);

impl Candidates {
    /// Computes the hits in double precision, as [`State`] does one by one.
    #[inline(always)]
    fn decide(&self, bvh: &Eight, rays: &RayStream, hits: &mut HitStream) {
        let sheared = ShearedStream::new(rays);
        for start in rays.groups() {
            let mut corners = [[DVec3::ZERO; 3]; GROUP];
            let mut slots = [Slot::default(); GROUP];
            let mut any = false;
            for k in 0..GROUP {
                if let Some((leaf, place)) = self.0[start + k] {
                    (slots[k], corners[k]) = bvh.leaves.triangle(leaf, usize::from(place));
                    any = true;
                }
            }
            if !any {
                continue;
            }
            let mut found = [[0.0; GROUP]; 3];
            for k in 0..GROUP {
                let TriangleHit { t, u, v } = sheared.intersect(rays, start + k, corners[k]);
                (found[0][k], found[1][k], found[2][k]) = (t, u, v);
            }
            for k in 0..GROUP {
                let (lane, t) = (start + k, found[0][k]);
                if t > 0.0 && t < rays.limit[lane] {
                    let hit = ShapeHit {
                        t,
                        primitive: slots[k].triangle,
                        prim_uv: DVec2::new(found[1][k], found[2][k]),
                    };
                    hits.set(lane, &hit.of_shape(InstanceId::TOP_LEVEL, slots[k].shape));
                }
            }
        }
    }
}
