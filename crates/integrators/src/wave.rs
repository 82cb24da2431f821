//! Streams of camera rays, wave by wave: each wave traces the next ray of every pixel that has one left.
//!
//! A pixel's rays come in the same order as from the explicit stack of the single-ray code, depth first and
//! reflection before transmission, so that sums have the same bits and memory stays bounded: what waits is
//! one ray a level and pixel.

use crate::rules::{Beyond, Limits, Rules, endless};
use std::mem::swap;
use whitstone_core::stream::{Colors, HitStream, LANES, Lanes, NO_SHAPE, PointStream, RayStream};
use whitstone_core::{
    BranchStream, BranchStreams, Counters, LightMemory, Lobes, Material, PathState, Rgb, Scratch, World, simd,
};

/// Rays of a wave with what they are worth.
#[derive(Default)]
struct Paths {
    rays: RayStream,
    throughput: Colors,
    absorption: Colors,
    /// Whether any ray may travel in a medium that absorbs.
    absorbing: bool,
    /// Bounces before the ray.
    depth: Values<u32>,
    /// Which camera ray it belongs to.
    slot: Values<u16>,
}

struct Values<T>(Lanes<T>);

impl<T: Copy + Default> Default for Values<T> {
    fn default() -> Self {
        Self([T::default(); LANES])
    }
}

/// Working memory: about 200 KiB a thread.
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
    /// Radiance along the rays of a group, and what it adds to the pixels.
    radiance: Colors,
    branches: BranchStreams,
    reflected: Followed,
    transmitted: Followed,
    waiting: Waiting,
    order: Vec<u64>,
}

/// The rays of one kind of branch, lane by lane of the points.
#[derive(Default)]
struct Followed {
    rays: RayStream,
    throughput: Colors,
    /// Whether the branch counts for anything.
    alive: Values<bool>,
}

/// The rays that were put off, a stack for each camera ray.
#[derive(Default)]
struct Waiting {
    stacks: Vec<Vec<PathState>>,
    /// On all stacks together.
    count: usize,
}

impl Paths {
    fn start(&mut self, rays: &RayStream) {
        self.rays.clone_from(rays);
        self.throughput.fill(rays.len, Rgb::WHITE);
        self.absorption.fill(rays.len, Rgb::BLACK);
        self.absorbing = false;
        self.depth.0.fill(0);
        for (slot, number) in self.slot.0.iter_mut().zip(0..) {
            *slot = number;
        }
    }

    fn clear(&mut self) {
        self.rays.len = 0;
        self.absorbing = false;
    }

    #[inline(always)]
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

impl Waiting {
    /// Goes on with the ray of this pixel that was put off last, if any is left.
    #[inline(always)]
    fn resume(&mut self, next: &mut Paths, slot: u16) {
        if self.count > 0
            && let Some(path) = self.stacks[slot as usize].pop()
        {
            self.count -= 1;
            next.push(&path, slot);
        }
    }

    fn push(&mut self, slot: u16, path: PathState) {
        self.stacks.resize_with(LANES, Vec::new);
        self.stacks[slot as usize].push(path);
        self.count += 1;
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
        m.current.start(rays);
        out.fill(rays.len, Rgb::BLACK);
        m.trace(world, &mut scratch.counters);
        self.waves(world, m, &mut scratch.counters, out);
        scratch.put_memory(memory);
    }

    /// [`Self::radiance_stream`] of rays whose nearest hits are known; they are no longer after it.
    pub(crate) fn shade_stream(
        &self,
        world: &World,
        rays: &RayStream,
        hits: &mut Box<HitStream>,
        scratch: &mut Scratch,
        out: &mut Colors,
    ) {
        let mut memory = scratch.take_memory::<Memory>();
        let m = &mut *memory;
        m.current.start(rays);
        out.fill(rays.len, Rgb::BLACK);
        swap(&mut m.hits, hits);
        self.waves(world, m, &mut scratch.counters, out);
        scratch.put_memory(memory);
    }

    /// Goes on until no pixel has a ray left. The hits of the current rays are known.
    fn waves(&self, world: &World, m: &mut Memory, counters: &mut Counters, out: &mut Colors) {
        while m.current.rays.len > 0 {
            self.wave(world, m, counters, out);
            swap(&mut m.current, &mut m.next);
            if m.current.rays.len > 0 {
                m.trace(world, counters);
            }
        }
    }

    /// Shades the hits of the current rays and leaves in `next` the ray of each pixel that comes after.
    fn wave(&self, world: &World, m: &mut Memory, counters: &mut Counters, out: &mut Colors) {
        m.next.clear();
        let len = m.current.rays.len;
        if m.current.absorbing {
            absorb(&mut m.current, &mut m.hits);
        }
        let shapes = &m.hits.id.shape[..len];
        if shapes.iter().all(|shape| *shape == shapes[0]) {
            let shape = shapes[0];
            swap(&mut m.group, &mut m.current);
            swap(&mut m.group_hits, &mut m.hits);
            self.shade(world, shape, m, counters, out);
            return;
        }
        let mut order = std::mem::take(&mut m.order);
        order.clear();
        order.extend(
            shapes
                .iter()
                .zip(0..)
                .map(|(shape, lane)| u64::from(*shape) << 32 | lane),
        );
        order.sort_unstable();
        for lanes in order.chunk_by(|a, b| a >> 32 == b >> 32) {
            m.group.rays.len = lanes.len();
            m.group.absorbing = m.current.absorbing;
            for (to, key) in lanes.iter().enumerate().take(LANES) {
                let lane = *key as u32 as usize % LANES;
                m.group.copy(to, &m.current, lane);
                m.group_hits.copy(to, &m.hits, lane);
            }
            self.shade(world, (lanes[0] >> 32) as u32, m, counters, out);
        }
        m.order = order;
    }

    /// What the rays in `group`, all of which hit this shape or none, add to their pixels, and the rays that
    /// come after them.
    fn shade(&self, world: &World, shape: u32, m: &mut Memory, counters: &mut Counters, out: &mut Colors) {
        if shape == NO_SHAPE {
            background(world, &m.group, &mut m.radiance);
            weigh(&m.group, &mut m.radiance);
            add(&m.group, &m.radiance, out);
            m.resume_all();
            return;
        }
        let len = m.group.rays.len;
        world.surface_stream(shape, &m.group.rays, &m.group_hits, &mut m.points);
        let material = &*world.materials[shape as usize];
        let lobes = material.lobes();
        if lobes.contains(Lobes::LOCAL) {
            let (points, leaves, media) = (&m.points, &m.group_hits.id, &m.group.absorption);
            let shadows = self.shadows.into();
            world.gather_lights_stream(points, leaves, media, shadows, &mut m.lights, counters);
            material.local_stream(points, world.ambient, &m.lights.samples, &mut m.radiance);
        } else {
            m.radiance.fill(len, Rgb::BLACK);
        }
        if lobes.contains(Lobes::EMISSION) {
            m.glow(material);
        }
        if lobes.intersects(Lobes::SHOWN) {
            weigh(&m.group, &mut m.radiance);
        }
        match self.branches {
            Some(limits) if lobes.intersects(Lobes::BRANCHES) => {
                material.branches_stream(&m.points, &mut m.branches);
                if lobes.contains(Lobes::STRAIGHT) {
                    m.stay();
                }
                m.follow(limits);
                m.stop_at_limit(world, limits);
                add(&m.group, &m.radiance, out);
                m.go_on();
            }
            _ => {
                add(&m.group, &m.radiance, out);
                m.resume_all();
            }
        }
    }
}

impl Memory {
    /// Finds what the current rays hit.
    fn trace(&mut self, world: &World, counters: &mut Counters) {
        counters.closest += self.current.rays.len as u64;
        world
            .accelerator
            .closest_stream(&self.current.rays, &mut self.hits);
    }

    /// Adds what the surface gives off by itself.
    fn glow(&mut self, material: &dyn Material) {
        let mut emission = Colors::default();
        material.emission_stream(&self.points, &mut emission);
        for lane in 0..self.group.rays.len {
            self.radiance
                .set(lane, self.radiance.get(lane) + emission.get(lane));
        }
    }

    /// Keeps the rays that go straight on in the medium that they come from.
    fn stay(&mut self) {
        for lane in (0..self.group.rays.len).filter(|lane| self.branches.straight.0[*lane]) {
            let medium = self.group.absorption.get(lane);
            self.branches.absorption.set(lane, medium);
        }
    }

    /// Goes on with what was put off, where a ray has no branches.
    fn resume_all(&mut self) {
        if self.waiting.count > 0 {
            for slot in &self.group.slot.0[..self.group.rays.len] {
                self.waiting.resume(&mut self.next, *slot);
            }
        }
    }

    /// Finds the branches that count.
    fn follow(&mut self, limits: Limits) {
        let Self {
            group,
            points,
            branches,
            ..
        } = self;
        let least = limits.min_contribution;
        follow(
            group,
            points,
            &branches.reflection,
            Side::Same,
            least,
            &mut self.reflected,
        );
        follow(
            group,
            points,
            &branches.transmission,
            Side::Other,
            least,
            &mut self.transmitted,
        );
    }

    /// Puts the background in the place of branches beyond the depth limit.
    fn stop_at_limit(&mut self, world: &World, limits: Limits) {
        let depths = &self.group.depth.0[..self.group.rays.len];
        if depths.iter().all(|depth| *depth < limits.max_depth) {
            return;
        }
        // Backwards, as for a single ray.
        let kinds = [
            (&mut self.transmitted, &self.branches.absorption),
            (&mut self.reflected, &self.group.absorption),
        ];
        for (branch, absorption) in kinds {
            for lane in (0..depths.len()).filter(|lane| depths[*lane] >= limits.max_depth) {
                let alive = std::mem::take(&mut branch.alive.0[lane]);
                if alive && limits.beyond == Beyond::Background {
                    let seen = endless(world, absorption.get(lane), branch.rays.direction.get(lane));
                    let sum = self.radiance.get(lane) + branch.throughput.get(lane) * seen;
                    self.radiance.set(lane, sum);
                }
            }
        }
    }

    /// Takes the first branch of each ray into the next wave and puts its second one off.
    fn go_on(&mut self) {
        let Self {
            group,
            group_hits,
            branches,
            reflected,
            transmitted,
            waiting,
            next,
            ..
        } = self;
        next.absorbing |= group.absorbing;
        for lane in 0..group.rays.len.min(LANES) {
            let (slot, depth) = (group.slot.0[lane], group.depth.0[lane] + 1);
            let (first, absorption) = match (reflected.alive.0[lane], transmitted.alive.0[lane]) {
                (false, false) => {
                    waiting.resume(next, slot);
                    continue;
                }
                (false, true) => (&*transmitted, branches.absorption.get(lane)),
                (true, second) => {
                    if second {
                        let path = PathState {
                            ray: transmitted.rays.ray(lane),
                            skip: group_hits.id.skip(lane),
                            throughput: transmitted.throughput.get(lane),
                            absorption: branches.absorption.get(lane),
                            depth,
                            origin: None,
                        };
                        waiting.push(slot, path);
                    }
                    (&*reflected, group.absorption.get(lane))
                }
            };
            let to = next.rays.len % LANES;
            next.rays.len += 1;
            next.rays.origin.set(to, first.rays.origin.get(lane));
            next.rays.direction.set(to, first.rays.direction.get(lane));
            next.rays.skip.copy(to, &group_hits.id, lane);
            next.throughput.set(to, first.throughput.get(lane));
            next.absorption.set(to, absorption);
            next.absorbing |= !absorption.is_black();
            next.depth.0[to] = depth;
            next.slot.0[to] = slot;
        }
    }
}

/// Weakens the rays by the media they came through. One of which nothing is left has hit nothing.
fn absorb(paths: &mut Paths, hits: &mut HitStream) {
    for lane in 0..paths.rays.len {
        if hits.id.shape[lane] == NO_SHAPE {
            continue;
        }
        let through = paths.absorption.get(lane).transmittance(hits.t.0[lane]);
        let throughput = paths.throughput.get(lane) * through;
        paths.throughput.set(lane, throughput);
        if throughput.is_black() {
            hits.id.shape[lane] = NO_SHAPE;
        }
    }
}

/// What rays see that hit nothing.
fn background(world: &World, paths: &Paths, radiance: &mut Colors) {
    let len = paths.rays.len;
    world.background_stream(len, &paths.rays.direction, radiance);
    if paths.absorbing {
        for lane in 0..len {
            let through = paths.absorption.get(lane).transmittance(f64::INFINITY);
            radiance.set(lane, through * radiance.get(lane));
        }
    }
}

/// Multiplies radiance by the throughput of its ray.
fn weigh(paths: &Paths, radiance: &mut Colors) {
    simd::dispatch(
        #[inline(always)]
        || {
            for lane in 0..paths.rays.len.min(LANES) {
                radiance.set(lane, paths.throughput.get(lane) * radiance.get(lane));
            }
        },
    );
}

/// Adds to the pixels.
fn add(paths: &Paths, values: &Colors, out: &mut Colors) {
    for (lane, slot) in paths.slot.0.iter().enumerate().take(paths.rays.len) {
        let slot = *slot as usize % LANES;
        out.set(slot, out.get(slot) + values.get(lane));
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
