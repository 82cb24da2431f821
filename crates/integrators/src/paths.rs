//! Storage for the rays of one wave (the next ray of each pixel) and for the rays that wait; copies
//! rays between them, given lists of lanes.

use whitstone_core::stream::{Colors, Ids, LANES, Lanes, RayStream, filter_lanes, gather};
use whitstone_core::{DVec3, RayDifferential, Rgb, TreeLimits, simd};

/// Rays of a wave with their throughput and medium. Their `limit`s stay infinite.
#[derive(Default)]
pub(crate) struct Paths {
    pub(crate) rays: RayStream,
    pub(crate) throughput: Colors,
    /// Absorption coefficient per lane; black in all lanes unless `absorbing`.
    pub(crate) absorption: Colors,
    /// Whether any ray may be in an absorbing medium.
    pub(crate) absorbing: bool,
    /// Number of bounces before the ray.
    pub(crate) depth: Values<u32>,
    /// Index of the ray's camera ray.
    pub(crate) slot: Values<u16>,
}

/// A value for each lane.
pub(crate) struct Values<T>(pub(crate) Lanes<T>);

impl<T: Copy + Default> Default for Values<T> {
    fn default() -> Self {
        Self([T::default(); LANES])
    }
}

/// A list of lane indices, in order.
#[derive(Default)]
pub(crate) struct List {
    lanes: Values<u16>,
    len: usize,
}

impl List {
    /// Replaces the list by those of the first `len` lanes for which `counts`.
    #[inline(always)]
    pub(crate) fn filter(&mut self, len: usize, counts: impl Fn(usize) -> bool) {
        self.len = filter_lanes(&mut self.lanes.0, len, counts);
    }

    #[inline(always)]
    pub(crate) fn lanes(&self) -> &[u16] {
        &self.lanes.0[..self.len.min(LANES)]
    }
}

/// One branch, reflected or transmitted, of each surface point: lane i belongs to point i.
#[derive(Default)]
pub(crate) struct Followed {
    pub(crate) rays: RayStream,
    pub(crate) throughput: Colors,
    /// Whether the branch is traced.
    pub(crate) alive: Values<bool>,
}

impl Paths {
    pub(crate) fn start(&mut self, rays: &RayStream) {
        self.rays.copy_first(rays);
        self.throughput.fill(rays.len, Rgb::WHITE);
        self.leave_media();
        self.depth.0.fill(0);
        for (slot, number) in self.slot.0.iter_mut().zip(0..) {
            *slot = number;
        }
    }

    pub(crate) fn clear(&mut self) {
        self.rays.len = 0;
        self.rays.differential.turn_off();
        self.leave_media();
    }

    fn leave_media(&mut self) {
        if self.absorbing {
            self.absorption.fill(LANES, Rgb::BLACK);
            self.absorbing = false;
        }
    }

    /// Replaces the contents by some lanes of `from`, without the primitives that the rays leave,
    /// which are not read again.
    pub(crate) fn take(&mut self, from: &Self, lanes: &[u16]) {
        self.clear();
        self.rays.len = lanes.len();
        self.absorbing = from.absorbing;
        simd::dispatch(
            #[inline(always)]
            || {
                self.rays.gather_lines(0, &from.rays, lanes);
                self.throughput.gather(0, &from.throughput, lanes);
                if from.absorbing {
                    self.absorption.gather(0, &from.absorption, lanes);
                }
                gather(&mut self.depth.0, 0, &from.depth.0, lanes);
                gather(&mut self.slot.0, 0, &from.slot.0, lanes);
            },
        );
    }

    /// Appends some branches of the rays of a group. They leave the primitives `origin_primitive`
    /// and enter the media `media` (`None`: no absorption).
    pub(crate) fn append(
        &mut self,
        group: &Self,
        origin_primitive: &Ids,
        branch: &Followed,
        media: Option<&Colors>,
        lanes: &[u16],
    ) {
        if lanes.is_empty() {
            return;
        }
        self.absorbing |= media.is_some();
        let start = self.rays.len;
        self.rays.len += lanes.len();
        simd::dispatch(
            #[inline(always)]
            || {
                self.rays.gather_lines(start, &branch.rays, lanes);
                self.rays.skip.gather(start, origin_primitive, lanes);
                self.throughput.gather(start, &branch.throughput, lanes);
                if let Some(media) = media {
                    self.absorption.gather(start, media, lanes);
                }
                let places = start..self.rays.len.min(LANES);
                for (to, &lane) in self.depth.0[places].iter_mut().zip(lanes) {
                    *to = group.depth.0[lane as usize % LANES] + 1;
                }
                gather(&mut self.slot.0, start, &group.slot.0, lanes);
            },
        );
    }
}

/// A pending ray.
#[derive(Clone, Copy)]
struct Later {
    origin: DVec3,
    direction: DVec3,
    throughput: Rgb,
    origin_primitive: [u32; 3],
    depth: u32,
    /// Index of the previously pushed ray of the same camera ray.
    below: u32,
}

// With the other lists of a row. A list that grows exists twice.
const _: () = assert!(
    3 * (size_of::<Later>() + size_of::<RayDifferential>() + size_of::<Rgb>() + size_of::<u32>()) as u64
        <= TreeLimits::PENDING_BYTES
);

/// End of a stack.
const BOTTOM: u32 = u32::MAX;

/// The pending rays: a stack for each camera ray. All stacks share one list, whose entries are
/// reused.
pub(crate) struct Waiting {
    rows: Vec<Later>,
    /// Ray differentials of the rows, if textures need them; otherwise empty.
    differentials: Vec<RayDifferential>,
    /// Absorption coefficients of the media of the rows; empty until one of them absorbs.
    absorptions: Vec<Rgb>,
    free: Vec<u32>,
    tops: Lanes<u32>,
    /// Number of pending rays on all stacks.
    count: usize,
    /// Camera rays with a pending ray.
    found: List,
}

impl Default for Waiting {
    fn default() -> Self {
        Self {
            rows: Vec::new(),
            differentials: Vec::new(),
            absorptions: Vec::new(),
            free: Vec::new(),
            tops: [BOTTOM; LANES],
            count: 0,
            found: List::default(),
        }
    }
}

impl Waiting {
    /// Number of pending rays.
    pub(crate) fn len(&self) -> usize {
        self.count
    }

    /// Pushes some branches; the arguments are those of [`Paths::append`].
    pub(crate) fn push(
        &mut self,
        group: &Paths,
        origin_primitive: &Ids,
        branch: &Followed,
        media: Option<&Colors>,
        lanes: &[u16],
    ) {
        if self.count == 0 {
            self.absorptions.clear();
        }
        self.count += lanes.len();
        for &lane in lanes {
            let lane = lane as usize % LANES;
            let top = &mut self.tops[group.slot.0[lane] as usize % LANES];
            let row = Later {
                origin: branch.rays.origin.get(lane),
                direction: branch.rays.direction.get(lane),
                throughput: branch.throughput.get(lane),
                origin_primitive: [
                    origin_primitive.instance[lane],
                    origin_primitive.shape[lane],
                    origin_primitive.primitive[lane],
                ],
                depth: group.depth.0[lane] + 1,
                below: *top,
            };
            *top = match self.free.pop() {
                Some(place) => {
                    self.rows[place as usize] = row;
                    place
                }
                None => {
                    self.rows.push(row);
                    self.rows.len() as u32 - 1
                }
            };
            if let Some(differential) = branch.rays.differential(lane) {
                self.differentials
                    .resize(self.rows.len(), RayDifferential::default());
                self.differentials[*top as usize] = differential;
            }
            if media.is_some() || !self.absorptions.is_empty() {
                self.absorptions.resize(self.rows.len(), Rgb::BLACK);
                self.absorptions[*top as usize] = media.map_or(Rgb::BLACK, |media| media.get(lane));
            }
        }
    }

    /// Pops the latest pending ray of the camera rays of these lanes, where there is one, and
    /// appends it to `next`.
    pub(crate) fn resume(&mut self, next: &mut Paths, group: &Paths, lanes: impl Iterator<Item = usize>) {
        if self.count == 0 {
            return;
        }
        // Collects them first, so that no conditional jump waits for a load.
        // The counter stays in a register: through the list it would be written each time.
        let (mut found, list) = (0, &mut self.found.lanes.0);
        for lane in lanes {
            let slot = group.slot.0[lane % LANES] as usize % LANES;
            list[found % LANES] = slot as u16;
            found += usize::from(self.tops[slot] != BOTTOM);
        }
        self.found.len = found;
        self.count -= self.found.lanes().len();
        for &slot in self.found.lanes() {
            let top = &mut self.tops[slot as usize % LANES];
            let row = &self.rows[*top as usize];
            if group.rays.differential.get().is_some() {
                let differential = &self.differentials[*top as usize];
                next.rays
                    .differential
                    .turn_on()
                    .set(next.rays.len % LANES, differential);
            }
            let to = next.rays.len % LANES;
            if let Some(absorption) = self.absorptions.get(*top as usize) {
                next.absorbing |= !absorption.is_black();
                next.absorption.set(to, *absorption);
            }
            self.free.push(*top);
            *top = row.below;
            next.rays.len += 1;
            next.rays.origin.set(to, row.origin);
            next.rays.direction.set(to, row.direction);
            let skip = &mut next.rays.skip;
            [skip.instance[to], skip.shape[to], skip.primitive[to]] = row.origin_primitive;
            next.throughput.set(to, row.throughput);
            next.depth.0[to] = row.depth;
            next.slot.0[to] = slot;
        }
    }
}

/// Number of parts of a wave with their own counters, so that consecutive increments do not wait
/// for each other.
const PARTS: usize = 4;

/// Visits all `len` lanes, alternating between the parts; those of one part are in order.
#[inline(always)]
fn side_by_side(len: usize, mut each: impl FnMut(usize, usize)) {
    let length = len / PARTS;
    for k in 0..length {
        for part in 0..PARTS {
            each(part, part * length + k);
        }
    }
    for lane in PARTS * length..len {
        each(PARTS - 1, lane);
    }
}

/// The lanes of a wave, grouped by the shape that they hit.
#[derive(Default)]
pub(crate) struct ByShape {
    /// For each shape and part of the wave: first the number of lanes that hit it, then the index
    /// in `order` of the next one. Zero between waves.
    counts: Vec<[u16; PARTS]>,
    /// Whether a shape is in `hit`.
    is_hit: Vec<bool>,
    /// The shapes that were hit.
    hit: Vec<u32>,
    order: Values<u16>,
}

impl ByShape {
    /// Sorts lanes. Values of at least `shapes` are misses.
    pub(crate) fn sort(&mut self, hits: &[u32], shapes: usize) {
        self.hit.clear();
        self.counts.resize(shapes + 1, [0; PARTS]);
        self.is_hit.resize(shapes + 1, false);
        // Slices of the exact length avoid bounds checks below.
        let (counts, is_hit) = (&mut self.counts[..=shapes], &mut self.is_hit[..=shapes]);
        let (hit, order) = (&mut self.hit, &mut self.order);
        let index = |shape: u32| (shape as usize).min(shapes);
        side_by_side(hits.len(), |part, lane| {
            let shape = hits[lane];
            counts[index(shape)][part] += 1;
            if !is_hit[index(shape)] {
                is_hit[index(shape)] = true;
                hit.push(shape);
            }
        });
        let mut start = 0;
        for &shape in hit.iter() {
            for count in &mut counts[index(shape)] {
                start += std::mem::replace(count, start);
            }
        }
        side_by_side(hits.len(), |part, lane| {
            let place = &mut counts[index(hits[lane])][part];
            order.0[*place as usize % LANES] = lane as u16;
            *place += 1;
        });
    }

    /// Removes all shapes and visits each with its lanes.
    pub(crate) fn groups(&mut self, mut each: impl FnMut(u32, &[u16])) {
        let mut start = 0;
        for place in 0..self.hit.len() {
            let shape = self.hit[place];
            let end = self.forget(shape) as usize;
            each(shape, &self.order.0[start..end]);
            start = end;
        }
    }

    /// Clears the entries of a shape and returns the end of its lanes in `order`.
    fn forget(&mut self, shape: u32) -> u16 {
        let index = (shape as usize).min(self.counts.len() - 1);
        self.is_hit[index] = false;
        std::mem::take(&mut self.counts[index])[PARTS - 1]
    }
}
