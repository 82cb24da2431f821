//! Streams of camera rays, wave by wave: each wave traces the next ray of every pixel that has one left.
//!
//! A pixel's rays come in the same order as from the explicit stack of the single-ray code, depth first and
//! reflection before transmission, so that sums have the same bits and memory stays bounded: what waits is
//! one ray a level and pixel.

use crate::rules::{Beyond, Rules, endless};
use std::mem::swap;
use whitstone_core::stream::{Colors, HitStream, LANES, Lanes, NO_SHAPE, PointStream, RayStream};
use whitstone_core::{
    BranchStream, BranchStreams, Counters, LightMemory, Lobes, PathState, Rgb, Scratch, World, simd,
};

/// Rays of a wave with what they are worth.
#[derive(Default)]
struct Paths {
    rays: RayStream,
    throughput: Colors,
    absorption: Colors,
    /// Whether any ray travels in a medium that absorbs.
    absorbing: bool,
    /// Bounces before the ray.
    depth: Numbers<u32>,
    /// Which camera ray it belongs to.
    slot: Numbers<u16>,
}

struct Numbers<T>(Lanes<T>);

impl<T: Copy + Default> Default for Numbers<T> {
    fn default() -> Self {
        Self([T::default(); LANES])
    }
}

/// Working memory: about half a megabyte a thread.
#[derive(Default)]
pub(crate) struct Memory {
    current: Box<Paths>,
    next: Box<Paths>,
    hits: Box<HitStream>,
    /// The rays of a wave that hit one shape.
    group: Box<Paths>,
    group_hits: Box<HitStream>,
    points: PointStream,
    lights: LightMemory,
    local: Colors,
    branches: BranchStreams,
    reflected: Followed,
    transmitted: Followed,
    /// What waits, by camera ray.
    pending: Vec<Vec<PathState>>,
    order: Vec<u64>,
}

/// The rays of one kind of branch, lane by lane of the points.
#[derive(Default)]
struct Followed {
    rays: RayStream,
    throughput: Colors,
    /// Whether the branch counts for anything.
    alive: Numbers<bool>,
}

impl Paths {
    fn copy(&mut self, to: usize, from: &Self, lane: usize) {
        self.rays.copy(to, &from.rays, lane);
        self.throughput.set(to, from.throughput.get(lane));
        self.absorption.set(to, from.absorption.get(lane));
        self.depth.0[to] = from.depth.0[lane];
        self.slot.0[to] = from.slot.0[lane];
    }

    fn push(&mut self, path: &PathState, slot: u16) {
        let to = self.rays.len;
        self.rays.set(to, path.ray, f64::INFINITY, path.skip);
        self.throughput.set(to, path.throughput);
        self.absorption.set(to, path.absorption);
        self.absorbing |= !path.absorption.is_black();
        self.depth.0[to] = path.depth;
        self.slot.0[to] = slot;
        self.rays.len += 1;
    }
}

impl Rules {
    pub(crate) fn radiance_stream(
        &self,
        world: &World,
        rays: &RayStream,
        scratch: &mut Scratch,
        out: &mut Colors,
    ) {
        let mut memory = scratch.take_memory::<Memory>();
        let m = &mut *memory;
        m.pending.resize_with(LANES, Vec::new);
        m.current.rays.clone_from(rays);
        m.current.throughput.fill(rays.len, Rgb::WHITE);
        m.current.absorption.fill(rays.len, Rgb::BLACK);
        m.current.absorbing = false;
        for lane in 0..rays.len {
            m.current.depth.0[lane] = 0;
            m.current.slot.0[lane] = lane as u16;
        }
        out.fill(rays.len, Rgb::BLACK);
        while m.current.rays.len > 0 {
            self.wave(world, m, &mut scratch.counters, out);
            swap(&mut m.current, &mut m.next);
        }
        scratch.put_memory(memory);
    }

    /// Traces the current rays and leaves in `next` the one of each pixel that comes after.
    fn wave(&self, world: &World, m: &mut Memory, counters: &mut Counters, out: &mut Colors) {
        m.next.rays.len = 0;
        m.next.absorbing = false;
        let len = m.current.rays.len;
        counters.closest += len as u64;
        world.accelerator.closest_stream(&m.current.rays, &mut m.hits);
        if m.current.absorbing {
            for lane in 0..len {
                if m.hits.id.shape[lane] == NO_SHAPE {
                    continue;
                }
                let path = &mut m.current;
                let through = path.absorption.get(lane).transmittance(m.hits.t.0[lane]);
                let throughput = path.throughput.get(lane) * through;
                path.throughput.set(lane, throughput);
                if throughput.is_black() {
                    // Nothing that is seen there reaches the pixel.
                    m.hits.id.shape[lane] = NO_SHAPE;
                }
            }
        }
        m.order.clear();
        let keys = m.hits.id.shape[..len].iter().zip(0_u64..);
        m.order
            .extend(keys.map(|(shape, lane)| u64::from(*shape) << 32 | lane));
        let first = m.hits.id.shape[0];
        let alike = m.hits.id.shape[..len].iter().all(|shape| *shape == first);
        if !alike {
            m.order.sort_unstable();
        }
        let order = std::mem::take(&mut m.order);
        for lanes in order.chunk_by(|a, b| a >> 32 == b >> 32) {
            let shape = (lanes[0] >> 32) as u32;
            if shape == NO_SHAPE {
                for lane in lanes.iter().map(|key| *key as u32 as usize) {
                    let direction = m.current.rays.direction.get(lane);
                    let seen = endless(world, m.current.absorption.get(lane), direction);
                    let slot = m.current.slot.0[lane];
                    add(out, slot, m.current.throughput.get(lane) * seen);
                    resume(&mut m.pending, &mut m.next, slot);
                }
                continue;
            }
            if alike {
                swap(&mut m.group, &mut m.current);
                swap(&mut m.group_hits, &mut m.hits);
            } else {
                m.group.rays.len = lanes.len();
                for (to, key) in lanes.iter().enumerate() {
                    let lane = *key as u32 as usize % LANES;
                    m.group.copy(to % LANES, &m.current, lane);
                    m.group_hits.copy(to % LANES, &m.hits, lane);
                }
            }
            self.shade(world, shape, m, counters, out);
        }
        m.order = order;
    }

    /// Local radiance and branches of the rays in `group`, all of which hit this shape.
    fn shade(&self, world: &World, shape: u32, m: &mut Memory, counters: &mut Counters, out: &mut Colors) {
        let group = &m.group;
        let len = group.rays.len;
        world.surface_stream(shape, &group.rays, &m.group_hits, &mut m.points);
        let material = &*world.materials[shape as usize];
        let lobes = material.lobes();
        m.local.fill(len, Rgb::BLACK);
        if lobes.contains(Lobes::LOCAL) {
            let (points, leaves) = (&m.points, &m.group_hits.id);
            world.gather_lights_stream(points, leaves, self.shadows.hide(), &mut m.lights, counters);
            material.local_stream(points, world.ambient, &m.lights.samples, &mut m.local);
        }
        let branching = match self.branches {
            Some(_) if lobes.intersects(Lobes::REFLECTION | Lobes::TRANSMISSION) => self.branches,
            _ => None,
        };
        let Some(limits) = branching else {
            for lane in 0..len {
                let slot = group.slot.0[lane];
                add(out, slot, group.throughput.get(lane) * m.local.get(lane));
                resume(&mut m.pending, &mut m.next, slot);
            }
            return;
        };
        material.branches_stream(&m.points, &mut m.branches);
        let least = limits.min_contribution;
        follow(
            group,
            &m.points,
            &m.branches.reflection,
            Side::Same,
            least,
            &mut m.reflected,
        );
        follow(
            group,
            &m.points,
            &m.branches.transmission,
            Side::Other,
            least,
            &mut m.transmitted,
        );
        for lane in 0..len {
            let slot = group.slot.0[lane];
            let depth = group.depth.0[lane];
            let skip = m.group_hits.id.skip(lane);
            let mut sum = group.throughput.get(lane) * m.local.get(lane);
            let mut first = None;
            // Backwards: what comes last is traced first.
            let kinds = [
                (&m.transmitted, &m.branches.absorption),
                (&m.reflected, &group.absorption),
            ];
            for (branch, absorption) in kinds {
                if !branch.alive.0[lane] {
                    continue;
                }
                let absorption = absorption.get(lane);
                let throughput = branch.throughput.get(lane);
                if depth < limits.max_depth {
                    let child = PathState {
                        ray: branch.rays.ray(lane),
                        skip,
                        throughput,
                        absorption,
                        depth: depth + 1,
                        origin: None,
                    };
                    m.pending[slot as usize].extend(first.replace(child));
                } else if limits.beyond == Beyond::Background {
                    sum += throughput * endless(world, absorption, branch.rays.direction.get(lane));
                }
            }
            add(out, slot, sum);
            match first {
                Some(child) => m.next.push(&child, slot),
                None => resume(&mut m.pending, &mut m.next, slot),
            }
        }
    }
}

fn add(out: &mut Colors, slot: u16, value: Rgb) {
    let slot = slot as usize;
    out.set(slot, out.get(slot) + value);
}

/// Goes on with the ray of this pixel that was put off last, if any is left.
fn resume(pending: &mut [Vec<PathState>], next: &mut Paths, slot: u16) {
    if let Some(path) = pending[slot as usize].pop() {
        next.push(&path, slot);
    }
}

/// Which side of the surface a branch must go to, by rule G.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    Same,
    Other,
}

/// The rays of one kind of branch; see `Whitted::follow` for one.
fn follow(
    group: &Paths,
    points: &PointStream,
    branch: &BranchStream,
    side: Side,
    least: f64,
    out: &mut Followed,
) {
    simd::dispatch(
        #[inline(always)]
        || {
            for lane in 0..group.rays.len.min(LANES) {
                let (point, view) = (points.get(lane), points.view.get(lane));
                let direction = branch.direction.get(lane);
                let allowed = match side {
                    Side::Same => point.same_side(view, direction),
                    Side::Other => point.opposite_sides(view, direction),
                };
                let throughput = group.throughput.get(lane) * branch.weight.get(lane);
                let contribution = throughput.max_component();
                out.alive.0[lane] = allowed & (contribution > 0.0) & (contribution >= least);
                out.rays.origin.set(lane, point.leave(direction));
                out.rays.direction.set(lane, direction);
                out.throughput.set(lane, throughput);
            }
        },
    );
}
