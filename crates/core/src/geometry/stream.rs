//! Streams of rays as structures of arrays: lane `i` of every array belongs to the same ray.
//!
//! Plugins process a whole stream per call, which amortises the virtual call and lets the
//! arithmetic be vectorised. A plugin with branchless arithmetic writes it once, for one lane,
//! marks it `#[inline(always)]`, and loops over the lanes inside [`crate::simd::dispatch`]. Any
//! other plugin inherits a loop over its scalar method. **Both give the same bits**: that is a law
//! of every trait with a stream method.
//!
//! Lanes from `len` on hold stale values: arithmetic on them is harmless and the results are never
//! read.

use crate::ray_differential::{FootprintStream, RayDifferentialStream};
use crate::simd::{self, prefetch, select};
use crate::{
    Aabb, Footprint, InstanceId, Interval, LightSample, PreliminaryIntersection, Ray, RayDifferential, Rgb,
    SelfHitFilter, ShapeHit, SurfaceInteraction, VertexAttributeStream, VertexAttributes,
};
use glam::{DVec2, DVec3};
use std::ops::Range;

/// Capacity of a stream.
pub const LANES: usize = 256;

/// Number of lanes per loop iteration: two registers of the widest kind.
pub const GROUP: usize = 16;
const _: () = assert!(LANES.is_multiple_of(GROUP));

/// The first lanes of the groups that cover `len` lanes; the last group may contain unused lanes.
///
/// A loop over a group has a fixed length and so needs no remainder loop, which would take longer
/// than the main loop if streams are short.
#[inline(always)]
pub fn groups(len: usize) -> impl Iterator<Item = usize> {
    (0..len.min(LANES).div_ceil(GROUP)).map(|group| group * GROUP)
}

/// The lanes of the groups that cover `len` rays. For loops with a short body: of two nested loops
/// the compiler would unroll the inner one and vectorise the outer one, with gathers and scatters.
#[inline(always)]
pub fn whole_groups(len: usize) -> Range<usize> {
    0..len.min(LANES).div_ceil(GROUP) * GROUP
}

/// One value for each ray of a stream.
pub type Lanes<T> = [T; LANES];

/// The shape number for "none": a miss, or a ray that starts on no primitive.
pub const NO_SHAPE: u32 = u32::MAX;

/// Replaces the first entries of `list` by those of the first `len` lanes for which `counts`, in
/// order, and returns their number.
#[inline(always)]
pub fn filter_lanes(list: &mut Lanes<u16>, len: usize, counts: impl Fn(usize) -> bool) -> usize {
    let mut found = 0;
    for start in groups(len) {
        let mut mask = 0_u32;
        for k in 0..GROUP {
            mask |= u32::from(counts(start + k) & (start + k < len)) << k;
        }
        // Most groups agree.
        if mask == (1 << GROUP) - 1 && found + GROUP <= LANES {
            for k in 0..GROUP {
                list[found + k] = (start + k) as u16;
            }
            found += GROUP;
            continue;
        }
        while mask != 0 {
            list[found % LANES] = (start + mask.trailing_zeros() as usize) as u16;
            found += 1;
            mask &= mask - 1;
        }
    }
    found
}

/// Appends selected lanes of a column, in this order, after its first `start` lanes.
#[inline(always)]
pub fn gather<T: Copy>(to: &mut Lanes<T>, start: usize, from: &Lanes<T>, lanes: &[u16]) {
    let to = &mut to[start..];
    let len = lanes.len().min(to.len());
    let (runs, rest) = lanes[..len].as_chunks::<GROUP>();
    let (places_of_runs, places_of_rest) = to[..len].as_chunks_mut::<GROUP>();
    for (places, run) in places_of_runs.iter_mut().zip(runs) {
        // Neighbouring rays often do the same: most runs are copied as a whole.
        let first = usize::from(run[0]);
        let mut consecutive = true;
        for (k, lane) in run.iter().enumerate() {
            consecutive &= usize::from(*lane) == first + k;
        }
        match from.get(first..).and_then(|from| from.first_chunk()) {
            Some(from) if consecutive => *places = *from,
            _ => {
                for (to, &lane) in places.iter_mut().zip(run) {
                    *to = from[lane as usize % LANES];
                }
            }
        }
    }
    for (to, &lane) in places_of_rest.iter_mut().zip(rest) {
        *to = from[lane as usize % LANES];
    }
}

/// A column that is present only if something reads it. Its memory is reused.
#[derive(Clone)]
pub struct Optional<T> {
    on: bool,
    memory: Option<Box<T>>,
}

impl<T> Default for Optional<T> {
    fn default() -> Self {
        Self {
            on: false,
            memory: None,
        }
    }
}

impl<T: Default> Optional<T> {
    /// The column, if present.
    #[inline(always)]
    pub fn get(&self) -> Option<&T> {
        if self.on { self.memory.as_deref() } else { None }
    }

    /// The column, if present.
    #[inline(always)]
    pub fn get_mut(&mut self) -> Option<&mut T> {
        if self.on { self.memory.as_deref_mut() } else { None }
    }

    /// Makes the column present and returns it, with stale contents.
    pub fn turn_on(&mut self) -> &mut T {
        self.on = true;
        self.memory()
    }

    /// The column, present or not.
    pub fn memory(&mut self) -> &mut T {
        self.memory.get_or_insert_default()
    }

    /// Makes the column absent.
    #[inline(always)]
    pub fn turn_off(&mut self) {
        self.on = false;
    }
}

/// A column of vectors.
#[derive(Clone)]
#[repr(align(64))]
pub struct Vectors {
    x: Lanes<f64>,
    y: Lanes<f64>,
    z: Lanes<f64>,
}

impl Default for Vectors {
    fn default() -> Self {
        let [x, y, z] = [[0.0; LANES]; 3];
        Self { x, y, z }
    }
}

impl Vectors {
    /// The vector of a lane.
    #[inline(always)]
    pub fn get(&self, lane: usize) -> DVec3 {
        DVec3::new(self.x[lane], self.y[lane], self.z[lane])
    }

    /// The coordinates of all lanes, axis by axis.
    #[inline(always)]
    pub fn columns(&self) -> [&Lanes<f64>; 3] {
        [&self.x, &self.y, &self.z]
    }

    /// Replaces the vector of a lane.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, value: DVec3) {
        (self.x[lane], self.y[lane], self.z[lane]) = (value.x, value.y, value.z);
    }

    /// The bounding box of the first `len` vectors.
    pub fn bounds(&self, len: usize) -> Aabb {
        let range = |values: &Lanes<f64>| {
            let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
            for value in &values[..len.min(LANES)] {
                ends = [ends[0].min(*value), ends[1].max(*value)];
            }
            ends
        };
        let mut ends = [[0.0; 2]; 3];
        simd::dispatch(
            #[inline(always)]
            || ends = [&self.x, &self.y, &self.z].map(range),
        );
        let [x, y, z] = ends;
        Aabb {
            min: DVec3::new(x[0], y[0], z[0]),
            max: DVec3::new(x[1], y[1], z[1]),
        }
    }

    /// Copies the first `len` lanes of another stream.
    #[inline(always)]
    pub fn copy_first(&mut self, len: usize, from: &Self) {
        self.x[..len].copy_from_slice(&from.x[..len]);
        self.y[..len].copy_from_slice(&from.y[..len]);
        self.z[..len].copy_from_slice(&from.z[..len]);
    }

    /// Appends selected lanes of another stream, in this order, after the first `start` lanes:
    /// column by column, which is faster than lane by lane.
    #[inline(always)]
    pub fn gather(&mut self, start: usize, from: &Self, lanes: &[u16]) {
        gather(&mut self.x, start, &from.x, lanes);
        gather(&mut self.y, start, &from.y, lanes);
        gather(&mut self.z, start, &from.z, lanes);
    }
}

/// A column of colours.
#[derive(Clone)]
#[repr(align(64))]
pub struct Colors {
    r: Lanes<f64>,
    g: Lanes<f64>,
    b: Lanes<f64>,
}

impl Default for Colors {
    fn default() -> Self {
        let [r, g, b] = [[0.0; LANES]; 3];
        Self { r, g, b }
    }
}

impl Colors {
    /// The colour of a lane.
    #[inline(always)]
    pub fn get(&self, lane: usize) -> Rgb {
        Rgb::new(self.r[lane], self.g[lane], self.b[lane])
    }

    /// Replaces the colour of a lane.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, value: Rgb) {
        (self.r[lane], self.g[lane], self.b[lane]) = (value.r, value.g, value.b);
    }

    /// See [`Vectors::gather`].
    #[inline(always)]
    pub fn gather(&mut self, start: usize, from: &Self, lanes: &[u16]) {
        gather(&mut self.r, start, &from.r, lanes);
        gather(&mut self.g, start, &from.g, lanes);
        gather(&mut self.b, start, &from.b, lanes);
    }

    /// Sets the first `len` lanes to one colour.
    pub fn fill(&mut self, len: usize, value: Rgb) {
        self.r[..len].fill(value.r);
        self.g[..len].fill(value.g);
        self.b[..len].fill(value.b);
    }
}

/// A column of primitive ids.
#[derive(Clone)]
#[repr(align(64))]
pub struct Ids {
    /// Instance of the shape.
    pub instance: Lanes<u32>,
    /// Number of the shape, or [`NO_SHAPE`].
    pub shape: Lanes<u32>,
    /// Number of the primitive in the shape.
    pub primitive: Lanes<u32>,
}

impl Default for Ids {
    fn default() -> Self {
        Self {
            instance: [0; LANES],
            shape: [NO_SHAPE; LANES],
            primitive: [0; LANES],
        }
    }
}

impl Ids {
    /// See [`Vectors::gather`].
    #[inline(always)]
    pub fn gather(&mut self, start: usize, from: &Self, lanes: &[u16]) {
        gather(&mut self.instance, start, &from.instance, lanes);
        gather(&mut self.shape, start, &from.shape, lanes);
        gather(&mut self.primitive, start, &from.primitive, lanes);
    }

    /// Copies the first `len` lanes of another stream.
    #[inline(always)]
    pub fn copy_first(&mut self, len: usize, from: &Self) {
        self.instance[..len].copy_from_slice(&from.instance[..len]);
        self.shape[..len].copy_from_slice(&from.shape[..len]);
        self.primitive[..len].copy_from_slice(&from.primitive[..len]);
    }

    /// Whether a lane contains this primitive of this shape, outside any instance.
    #[inline(always)]
    pub fn names(&self, lane: usize, shape: u32, primitive: u32) -> bool {
        (self.shape[lane] == shape)
            & (self.primitive[lane] == primitive)
            & (self.instance[lane] == InstanceId::TOP_LEVEL.0)
    }

    /// The primitive in this lane, to be skipped by a ray that starts on it.
    #[inline(always)]
    pub fn skip(&self, lane: usize) -> SelfHitFilter {
        match self.shape[lane] {
            NO_SHAPE => SelfHitFilter::NOTHING,
            shape => SelfHitFilter::of(InstanceId(self.instance[lane]), shape, self.primitive[lane]),
        }
    }

    /// Stores the primitive that `skip` names in a lane.
    pub fn set_skip(&mut self, lane: usize, skip: SelfHitFilter) {
        let (instance, shape, primitive) = skip.id().unwrap_or((InstanceId::TOP_LEVEL, NO_SHAPE, 0));
        (self.instance[lane], self.shape[lane], self.primitive[lane]) = (instance.0, shape, primitive);
    }
}

/// A stream of rays. A hit counts if its parameter is strictly between 0 and the ray's limit.
#[derive(Clone)]
#[repr(align(64))]
pub struct RayStream {
    /// Number of rays.
    pub len: usize,
    /// Origins, in metres.
    pub origin: Vectors,
    /// Directions of any length except 0: rays inside a group are not normalised.
    pub direction: Vectors,
    /// Upper ends of the rays' intervals, in units of the length of the direction.
    pub limit: Lanes<f64>,
    /// The primitives that the rays start on.
    pub skip: Ids,
    /// Ray differentials, if textures read footprints: present for all rays or for none.
    pub differential: Optional<RayDifferentialStream>,
}

impl Default for RayStream {
    fn default() -> Self {
        Self {
            len: 0,
            origin: Vectors::default(),
            direction: Vectors::default(),
            limit: [f64::INFINITY; LANES],
            skip: Ids::default(),
            differential: Optional::default(),
        }
    }
}

impl RayStream {
    /// The ray of a lane.
    #[inline(always)]
    pub fn ray(&self, lane: usize) -> Ray {
        Ray::new(self.origin.get(lane), self.direction.get(lane))
    }

    /// The first lanes of the groups that cover the rays; the last group may contain unused lanes.
    #[inline(always)]
    pub fn groups(&self) -> impl Iterator<Item = usize> + use<> {
        groups(self.len)
    }

    /// The interval in which the ray of a lane counts hits.
    #[inline(always)]
    pub fn interval(&self, lane: usize) -> Interval {
        Interval::up_to(self.limit[lane])
    }

    /// Prefetches the group that begins at `start`, if there is one.
    #[inline(always)]
    pub fn prefetch(&self, start: usize) {
        let Self {
            origin,
            direction,
            limit,
            skip,
            ..
        } = self;
        for numbers in [
            &origin.x,
            &origin.y,
            &origin.z,
            &direction.x,
            &direction.y,
            &direction.z,
            limit,
        ] {
            prefetch(numbers.get(start..start + GROUP).unwrap_or_default());
        }
        for numbers in [&skip.shape, &skip.instance, &skip.primitive] {
            prefetch(numbers.get(start..start + GROUP).unwrap_or_default());
        }
    }

    /// Replaces a lane.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, ray: Ray, limit: f64, skip: SelfHitFilter) {
        self.origin.set(lane, ray.origin);
        self.direction.set(lane, ray.direction);
        self.limit[lane] = limit;
        self.skip.set_skip(lane, skip);
    }

    /// Copies another stream; unused lanes keep their contents.
    pub fn copy_first(&mut self, from: &Self) {
        self.len = from.len;
        let len = from.len.min(LANES);
        self.origin.copy_first(len, &from.origin);
        self.direction.copy_first(len, &from.direction);
        self.limit[..len].copy_from_slice(&from.limit[..len]);
        self.skip.copy_first(len, &from.skip);
        match from.differential.get() {
            None => self.differential.turn_off(),
            Some(differential) => self.differential.turn_on().clone_from(differential),
        }
    }

    /// See [`Vectors::gather`]; copies neither limits nor skipped primitives.
    #[inline(always)]
    pub fn gather_lines(&mut self, start: usize, from: &Self, lanes: &[u16]) {
        self.origin.gather(start, &from.origin, lanes);
        self.direction.gather(start, &from.direction, lanes);
        match from.differential.get() {
            None => self.differential.turn_off(),
            Some(differential) => self.differential.turn_on().gather(start, differential, lanes),
        }
    }

    /// The ray differentials of a lane, if present.
    #[inline]
    pub fn differential(&self, lane: usize) -> Option<RayDifferential> {
        self.differential.get().map(|differential| differential.get(lane))
    }
}

/// The nearest hits of a [`RayStream`], lane by lane.
#[derive(Clone, Default)]
#[repr(align(64))]
pub struct HitStream {
    /// Ray parameters; for a miss, the limit of the ray.
    pub t: Numbers,
    /// First surface parameter.
    pub u: Numbers,
    /// Second surface parameter.
    pub v: Numbers,
    /// The primitives that were hit.
    pub id: Ids,
}

/// A column of numbers.
#[derive(Clone)]
#[repr(align(64))]
pub struct Numbers(pub Lanes<f64>);

impl Default for Numbers {
    fn default() -> Self {
        Self([0.0; LANES])
    }
}

impl HitStream {
    /// Sets all lanes to misses, with the limits of the rays.
    pub fn clear(&mut self, rays: &RayStream) {
        self.t.0[..rays.len].copy_from_slice(&rays.limit[..rays.len]);
        self.id.shape[..rays.len].fill(NO_SHAPE);
    }

    /// The hit of a lane.
    #[inline(always)]
    pub fn get(&self, lane: usize) -> Option<PreliminaryIntersection> {
        (self.id.shape[lane] != NO_SHAPE).then(|| self.hit(lane))
    }

    /// The hit of a lane, which must not be a miss.
    #[inline(always)]
    pub fn hit(&self, lane: usize) -> PreliminaryIntersection {
        PreliminaryIntersection {
            t: self.t.0[lane],
            prim_uv: DVec2::new(self.u.0[lane], self.v.0[lane]),
            instance: InstanceId(self.id.instance[lane]),
            shape: self.id.shape[lane],
            primitive: self.id.primitive[lane],
        }
    }

    /// Sets a lane to a hit.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, hit: &PreliminaryIntersection) {
        self.t.0[lane] = hit.t;
        (self.u.0[lane], self.v.0[lane]) = (hit.prim_uv.x, hit.prim_uv.y);
        self.id.instance[lane] = hit.instance.0;
        self.id.shape[lane] = hit.shape;
        self.id.primitive[lane] = hit.primitive;
    }

    /// Stores a hit of a shape in a lane if it is the nearest there so far. Call it in ascending
    /// order of shapes, so that the lowest one wins at equal distance. `counts` is false if the hit
    /// must be ignored.
    #[inline(always)]
    pub fn offer(&mut self, lane: usize, counts: bool, shape: u32, hit: &ShapeHit) {
        let nearer = counts & (hit.t > 0.0) & (hit.t < self.t.0[lane]);
        let choose = |new: f64, old: f64| select(nearer, new, old);
        let choose_id = |new: u32, old: u32| select(nearer, new, old);
        self.t.0[lane] = choose(hit.t, self.t.0[lane]);
        self.u.0[lane] = choose(hit.prim_uv.x, self.u.0[lane]);
        self.v.0[lane] = choose(hit.prim_uv.y, self.v.0[lane]);
        self.id.instance[lane] = choose_id(InstanceId::TOP_LEVEL.0, self.id.instance[lane]);
        self.id.shape[lane] = choose_id(shape, self.id.shape[lane]);
        self.id.primitive[lane] = choose_id(hit.primitive, self.id.primitive[lane]);
    }

    /// See [`Vectors::gather`].
    #[inline(always)]
    pub fn gather(&mut self, start: usize, from: &Self, lanes: &[u16]) {
        gather(&mut self.t.0, start, &from.t.0, lanes);
        gather(&mut self.u.0, start, &from.u.0, lanes);
        gather(&mut self.v.0, start, &from.v.0, lanes);
        self.id.gather(start, &from.id, lanes);
    }
}

/// Gradients of the texture coordinates for each point of a stream.
#[derive(Clone, Default)]
#[repr(align(64))]
pub struct UvGradientStream {
    /// Of u.
    pub u: Vectors,
    /// Of v.
    pub v: Vectors,
}

/// A stream of surface interactions.
#[derive(Clone, Default)]
#[repr(align(64))]
pub struct SurfaceStream {
    /// Number of points.
    pub len: usize,
    /// See [`SurfaceInteraction::position`].
    pub position: Vectors,
    /// See [`SurfaceInteraction::error`].
    pub error: Numbers,
    /// See [`SurfaceInteraction::n_g`].
    pub n_g: Vectors,
    /// See [`SurfaceInteraction::n_s`].
    pub n_s: Vectors,
    /// First texture coordinate.
    pub u: Numbers,
    /// Second texture coordinate.
    pub v: Numbers,
    /// Unit directions to the viewers.
    pub view: Vectors,
    /// See [`SurfaceInteraction::uv_gradient`]; present if the material reads it.
    pub uv_gradient: Optional<UvGradientStream>,
    /// See [`SurfaceInteraction::footprint`]; present if the material reads it.
    pub footprint: Optional<FootprintStream>,
    /// See [`SurfaceInteraction::vertex`]; present if the material reads it.
    pub vertex: Optional<VertexAttributeStream>,
}

impl SurfaceStream {
    /// The point of a lane.
    #[inline(always)]
    pub fn get(&self, lane: usize) -> SurfaceInteraction {
        SurfaceInteraction {
            position: self.position.get(lane),
            error: self.error.0[lane],
            n_g: self.n_g.get(lane),
            n_s: self.n_s.get(lane),
            uv: DVec2::new(self.u.0[lane], self.v.0[lane]),
            uv_gradient: match self.uv_gradient.get() {
                None => [DVec3::ZERO; 2],
                Some(gradients) => [gradients.u.get(lane), gradients.v.get(lane)],
            },
            footprint: match self.footprint.get() {
                None => Footprint::NONE,
                Some(footprint) => footprint.get(lane),
            },
            vertex: match self.vertex.get() {
                None => VertexAttributes::NONE,
                Some(vertex) => vertex.0[lane],
            },
        }
    }

    /// Replaces the position, the normals and (u, v) of a lane.
    #[inline(always)]
    pub fn set_geometry(&mut self, lane: usize, point: &SurfaceInteraction) {
        self.position.set(lane, point.position);
        self.error.0[lane] = point.error;
        self.n_g.set(lane, point.n_g);
        self.n_s.set(lane, point.n_s);
        (self.u.0[lane], self.v.0[lane]) = (point.uv.x, point.uv.y);
    }

    /// Replaces the point of a lane, except view, gradients of (u, v) and footprint.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, point: &SurfaceInteraction) {
        self.set_geometry(lane, point);
        if let Some(vertex) = self.vertex.get_mut() {
            vertex.0[lane] = point.vertex;
        }
    }
}

/// One light sample for each point of a stream.
#[derive(Clone, Default)]
#[repr(align(64))]
pub struct SampleStream {
    /// Unit directions from the points to the light.
    pub direction: Vectors,
    /// In metres; infinite for directional lights.
    pub distance: Numbers,
    /// Irradiance in W/m² on surfaces that face the light; black if no light arrives.
    pub irradiance: Colors,
}

impl SampleStream {
    /// The sample of a lane.
    #[inline(always)]
    pub fn get(&self, lane: usize) -> LightSample {
        LightSample {
            direction: self.direction.get(lane),
            distance: self.distance.0[lane],
            irradiance: self.irradiance.get(lane),
        }
    }

    /// Replaces the sample of a lane.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, sample: &LightSample) {
        self.direction.set(lane, sample.direction);
        self.distance.0[lane] = sample.distance;
        self.irradiance.set(lane, sample.irradiance);
    }
}

/// The light samples of a stream of points. Memory is reused.
#[derive(Default)]
pub struct SampleStreams {
    used: usize,
    streams: Vec<Box<SampleStream>>,
}

impl SampleStreams {
    /// Removes all samples.
    pub fn clear(&mut self) {
        self.used = 0;
    }

    /// Adds one sample per point; its lanes have stale contents.
    pub fn add(&mut self) -> &mut SampleStream {
        if self.used == self.streams.len() {
            self.streams.push(Box::default());
        }
        self.used += 1;
        &mut self.streams[self.used - 1]
    }

    /// Number of samples per point.
    pub fn len(&self) -> usize {
        self.used
    }

    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.used == 0
    }

    /// Sample number `place` of every point, in the order of addition.
    pub fn stream(&mut self, place: usize) -> &mut SampleStream {
        &mut self.streams[..self.used][place]
    }

    /// The samples in the order of addition.
    pub fn iter(&self) -> impl Iterator<Item = &SampleStream> {
        self.streams[..self.used].iter().map(|stream| &**stream)
    }

    /// The samples in the order of addition.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut SampleStream> {
        self.streams[..self.used].iter_mut().map(|stream| &mut **stream)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lists of lanes with runs that start anywhere, and with gaps.
    fn lists() -> impl Iterator<Item = Vec<u16>> {
        let every = |step: usize, start: u16| (start..LANES as u16).step_by(step).collect::<Vec<_>>();
        let pieces = [0..16, 17..49, 60..61, 100..131].into_iter().flatten().collect();
        let swapped = [1, 0].into_iter().chain(2..32).collect();
        let reversed = (0..LANES as u16).rev().collect();
        let ends = [(0..15).chain(16..17).collect(), (0..15).chain(200..217).collect()];
        (0..20)
            .map(move |start| every(1, start * 13))
            .chain([
                every(2, 0),
                every(1, 0)[..31].to_vec(),
                pieces,
                swapped,
                reversed,
                Vec::new(),
            ])
            .chain(ends)
    }

    #[test]
    fn gathers_what_the_list_names() {
        let from: Lanes<u32> = std::array::from_fn(|lane| 1000 + lane as u32);
        for (lanes, start) in lists().flat_map(|lanes| [0, 1, 200].map(|start| (lanes.clone(), start))) {
            let mut to: Lanes<u32> = std::array::from_fn(|lane| lane as u32);
            gather(&mut to, start, &from, &lanes);
            for (place, found) in to.iter().enumerate() {
                let lane = place.checked_sub(start).and_then(|k| lanes.get(k));
                let expected = lane.map_or(place as u32, |lane| 1000 + u32::from(*lane));
                assert_eq!(*found, expected, "place {place} after {start} of {lanes:?}");
            }
        }
    }

    #[test]
    fn filters_lanes_in_order() {
        let ways: [fn(usize) -> bool; 5] = [
            |_| true,
            |_| false,
            |lane| lane % 3 == 1,
            |lane| lane != 20,
            |lane| lane / GROUP % 2 == 1,
        ];
        for (len, counts) in (0..=LANES).flat_map(|len| ways.map(|counts| (len, counts))) {
            let mut list = [7; LANES];
            let found = filter_lanes(&mut list, len, counts);
            let expected: Vec<u16> = (0..len)
                .filter(|lane| counts(*lane))
                .map(|lane| lane as u16)
                .collect();
            assert_eq!(list[..found], expected, "{len} lanes");
        }
    }
}
