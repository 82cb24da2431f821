use crate::shadow::shadow_ray;
use crate::simd;
use crate::simd::select;
use crate::stream::{
    Colors, GROUP, HitStream, Ids, LANES, Lanes, PointStream, RayStream, SampleStreams, Vectors, gather,
    groups,
};
use crate::{
    Accelerator, Bodies, Branches, Context, Face, Footprint, Geometry, Incoming, Inside, Interval, Light,
    LightGives, LightSample, Lobes, Material, Medium, Needs, ObjectOrder, PathState, RawHit, Ray, Refused,
    Rgb, Shadowing, Skip, Spread, SurfacePoint, View,
};
use glam::DVec3;
use std::any::Any;
use std::sync::Arc;

/// Computes the radiance that arrives along a camera ray.
pub trait Integrator: Send + Sync {
    /// Whether it follows the branches of materials: if not, the plan leaves out what only branches
    /// need.
    fn follows_branches(&self) -> bool;

    /// How many bounces a ray lives at most that goes on each time in so many directions, in equal
    /// shares of all light: so that scenes without an end in sight can be refused.
    fn bounces(&self, directions: u32) -> u32 {
        let _ = directions;
        0
    }

    /// Radiance along the ray, a pure function of world and ray. `scratch` is working memory, kept
    /// between calls of one thread, and counts the rays; if it has a record, every ray is noted
    /// there.
    fn radiance(&self, world: &World, ray: &Ray, scratch: &mut Scratch) -> Rgb;

    /// [`Self::radiance`] for every ray of a stream of camera rays: the same bits, and the same
    /// counts.
    fn radiance_stream(&self, world: &World, rays: &RayStream, scratch: &mut Scratch, out: &mut Colors) {
        for lane in 0..rays.len {
            scratch.spread = rays.spread(lane);
            out.set(lane, self.radiance(world, &rays.ray(lane), scratch));
        }
    }

    /// For methods that go from objects to pixels: what is asked for the radiance along camera rays
    /// instead, once it has seen the whole scene; or why it cannot show it. `None` for those that
    /// trace rays from pixels to objects.
    fn object_order(
        &self,
        view: &View<'_>,
        context: &mut dyn Context,
    ) -> Result<Option<Box<dyn ObjectOrder>>, Refused> {
        let _ = (view, context);
        Ok(None)
    }
}

/// So many lights that it pays to ask each whether it reaches a stream of points at all.
const MANY_LIGHTS: usize = 8;

/// What an integrator sees of a scene, ready to trace.
pub struct World {
    /// All shapes.
    pub geometry: Arc<Geometry>,
    /// Over the geometry.
    pub accelerator: Box<dyn Accelerator>,
    /// The material of each shape, by its number.
    pub materials: Vec<Arc<dyn Material>>,
    /// Lights that give samples, in the order of the scene.
    pub lights: Vec<Arc<dyn Light>>,
    /// Lights that are seen behind everything.
    pub backgrounds: Vec<Arc<dyn Light>>,
    /// Whether lights are asked, before they give their samples for a stream of points, if they
    /// reach any of them. The image is the same.
    pub culls_lights: bool,
    /// Sum of the ambient radiances.
    pub ambient: Rgb,
    /// By how much earlier shadow rays end before lights than rounding asks for, in metres: more
    /// than 0 where surfaces that hold lights have been moved.
    pub light_margin: f64,
    /// The bodies that may overlap, if there are any: then rays are followed one by one.
    pub bodies: Option<Bodies>,
    /// Whether some material spreads its reflections over directions.
    pub(crate) spreads_reflections: bool,
    /// See [`World::one_by_one`].
    one_by_one: bool,
    /// What each material reads, in the same order: asked once, not at every hit.
    needs: Vec<Needs>,
    /// How each material answers, in the same order.
    responses: Vec<Lobes>,
    /// All that any material does.
    pub(crate) lobes: Lobes,
    /// Whether any material reads footprints.
    footprints: bool,
}

impl World {
    /// Sorts lights by what they give.
    pub fn new(
        geometry: Arc<Geometry>,
        accelerator: Box<dyn Accelerator>,
        materials: Vec<Arc<dyn Material>>,
        lights: Vec<Arc<dyn Light>>,
    ) -> Self {
        let mut needs: Vec<Needs> = materials.iter().map(|material| material.needs()).collect();
        let responses: Vec<Lobes> = materials.iter().map(|material| material.lobes()).collect();
        let lobes = responses.iter().fold(Lobes::NOTHING, |all, lobes| all | *lobes);
        let footprints = needs.iter().any(|needs| needs.contains(Needs::FOOTPRINT));
        if footprints {
            // Rays that go on must know how far apart they are.
            for (needs, lobes) in needs.iter_mut().zip(&responses) {
                if lobes.intersects(Lobes::BRANCHES) {
                    *needs |= Needs::FOOTPRINT;
                }
            }
        }
        let ambient = lights.iter().map(|light| light.ambient()).sum();
        let giving = |what| -> Vec<Arc<dyn Light>> {
            let mut chosen = lights.clone();
            chosen.retain(|light| light.gives().contains(what));
            chosen
        };
        let bodies = Bodies::of(&materials);
        let spreads_reflections = materials.iter().any(|material| material.reflections() > 1);
        let (samplers, backgrounds) = (giving(LightGives::SAMPLES), giving(LightGives::BACKGROUND));
        Self {
            geometry,
            accelerator,
            materials,
            culls_lights: samplers.len() >= MANY_LIGHTS,
            lights: samplers,
            backgrounds,
            ambient,
            light_margin: 0.0,
            one_by_one: bodies.is_some() || spreads_reflections,
            bodies,
            spreads_reflections,
            needs,
            responses,
            lobes,
            footprints,
        }
    }

    /// The same world without what was found out about it: as if every material read everything and
    /// answered in every way that does no harm, and as if shadow rays might go through surfaces.
    /// The same image, by more work: what it costs beside this world is what leaving out saves.
    #[must_use]
    pub fn one_size_fits_all(mut self) -> Self {
        self.needs.fill(Needs::EVERYTHING);
        self.footprints = true;
        self.culls_lights = false;
        for lobes in &mut self.responses {
            *lobes = *lobes | Lobes::HARMLESS;
        }
        self.lobes = self.lobes | Lobes::HARMLESS | Lobes::HOLES;
        self
    }

    /// How the material of a shape answers.
    pub fn lobes_of(&self, shape: u32) -> Lobes {
        self.responses[shape as usize]
    }

    /// What is read of the surface points of a shape.
    pub(crate) fn needs_of(&self, shape: u32) -> Needs {
        self.needs[shape as usize]
    }

    /// Whether rays must be followed one by one: what they carry, or into how many they branch, has
    /// no column in streams.
    pub fn one_by_one(&self) -> bool {
        self.one_by_one
    }

    /// Whether some texture in use reads footprints, so that rays must carry how far apart they
    /// are.
    pub fn reads_footprints(&self) -> bool {
        self.footprints
    }

    /// Counts points of a shape that are shaded.
    #[inline]
    pub fn count_shaded(&self, shape: u32, points: usize, counters: &mut Counters) {
        let needs = self.needs[shape as usize];
        let counted = |need| if needs.contains(need) { points as u64 } else { 0 };
        counters.shaded += points as u64;
        counters.uv += counted(Needs::UV);
        counters.textured += counted(Needs::TEXTURE);
    }

    /// The face of a body that may overlap others, as a ray in these bodies comes to it; `None` of
    /// all other surfaces.
    pub fn face(&self, shape: u32, inside: Inside, point: &SurfacePoint, view: DVec3) -> Option<Face> {
        let bodies = self.bodies.as_ref()?;
        bodies.face(shape, inside, point.n_g.dot(view) > 0.0)
    }

    /// How a ray in these bodies goes on at a surface.
    pub fn branches(
        &self,
        shape: u32,
        inside: Inside,
        point: &SurfacePoint,
        view: DVec3,
        out: &mut Branches,
    ) {
        let material = &*self.materials[shape as usize];
        match (self.face(shape, inside, point, view), material.overlapping()) {
            (Some(face), Some(body)) => face.branches(body, point, view, out),
            _ => material.branches(point, view, out),
        }
    }

    /// What a ray sees that hits nothing.
    pub fn background(&self, direction: DVec3) -> Rgb {
        self.backgrounds
            .iter()
            .map(|light| light.background(direction))
            .sum()
    }

    /// [`Self::background`] in the first `len` directions of a stream.
    pub fn background_stream(&self, len: usize, directions: &Vectors, out: &mut Colors) {
        let Some((first, others)) = self.backgrounds.split_first() else {
            out.fill(len, Rgb::BLACK);
            return;
        };
        first.background_stream(len, directions, out);
        for light in others {
            let mut seen = Colors::default();
            light.background_stream(len, directions, &mut seen);
            for lane in 0..len {
                out.set(lane, out.get(lane) + seen.get(lane));
            }
        }
    }

    /// The surface at a hit, with the normals and coordinates that its material reads.
    pub fn surface(&self, ray: &Ray, hit: &RawHit) -> SurfacePoint {
        self.geometry.surface(ray, hit, self.needs[hit.shape as usize])
    }

    /// The footprint of a ray at its hit, with what the material reads of it; none if the ray does
    /// not carry how far apart it is from others.
    pub fn footprint(
        &self,
        ray: &Ray,
        hit: &RawHit,
        point: &SurfacePoint,
        spread: Option<&Spread>,
    ) -> Footprint {
        let needs = self.needs[hit.shape as usize];
        match spread {
            Some(spread) if needs.contains(Needs::FOOTPRINT) => {
                spread.footprint(&self.geometry, ray, hit, point, needs)
            }
            _ => Footprint::NONE,
        }
    }

    /// [`Self::surface`] for every ray of a stream, all of which hit this shape, as its viewers see
    /// it.
    pub fn surface_stream(&self, shape: u32, rays: &RayStream, hits: &HitStream, points: &mut PointStream) {
        points.len = rays.len;
        let needs = self.needs[shape as usize];
        self.geometry.surface_stream(shape, rays, hits, needs, points);
        match rays.spread.get() {
            Some(spreads) if needs.contains(Needs::FOOTPRINT) => {
                for lane in 0..rays.len.min(LANES) {
                    let (ray, hit, point) = (rays.ray(lane), hits.hit(lane), points.get(lane));
                    let spread = spreads.get(lane);
                    let found = spread.footprint(&self.geometry, &ray, &hit, &point, needs);
                    points.footprint.memory().set(lane, &found);
                }
                points.footprint.turn_on();
            }
            _ => points.footprint.turn_off(),
        }
        simd::dispatch(
            #[inline(always)]
            || {
                for start in rays.groups() {
                    for lane in start..start + GROUP {
                        let view = -rays.direction.get(lane);
                        points.view.set(lane, view);
                        let n_s = points.get(lane).seen_from(view).n_s;
                        points.n_s.set(lane, n_s);
                    }
                }
            },
        );
    }

    /// Union of what the materials in use read.
    pub fn needs(&self) -> Needs {
        self.needs.iter().fold(Needs::NOTHING, |all, needs| all | *needs)
    }

    /// The lights that reach a surface point on the side of `view`, into `scratch.incoming`.
    /// `medium` is that on this side.
    pub fn gather_lights(
        &self,
        point: &SurfacePoint,
        view: DVec3,
        skip: Skip,
        shadows: Shadowing,
        medium: Medium,
        scratch: &mut Scratch,
    ) {
        let through = self.lets_through(shadows);
        scratch.incoming.clear();
        scratch.samples.clear();
        for light in &self.lights {
            light.samples(point.position, &mut scratch.samples);
        }
        let n = point.n_towards(view);
        for sample in &scratch.samples {
            let lit = n.dot(sample.direction) > 0.0
                && point.same_side(view, sample.direction)
                && !sample.irradiance.is_black();
            if !lit {
                continue;
            }
            let mut irradiance = sample.irradiance;
            if shadows != Shadowing::None {
                let (ray, free) = shadow_ray(point, sample, self.light_margin);
                if through {
                    let counters = &mut scratch.counters;
                    irradiance *= self.light_through(ray, free, skip, medium, shadows, counters);
                    if irradiance.is_black() {
                        continue;
                    }
                } else {
                    scratch.counters.shadow += 1;
                    if self.accelerator.occluded(&ray, Interval::up_to(free), skip) {
                        continue;
                    }
                }
            }
            scratch.incoming.push(Incoming {
                direction: sample.direction,
                irradiance,
            });
        }
    }
}

/// Shadow rays of a stream of points.
#[derive(Default)]
struct ShadowRays {
    /// Lane by lane of the points, of use only where lit.
    all: RayStream,
    /// Those of them that are lit, close together.
    lit: RayStream,
    hidden: Hidden,
}

/// What [`Accelerator::occluded_stream`] found.
struct Hidden(Lanes<bool>);

impl Default for Hidden {
    fn default() -> Self {
        Self([false; LANES])
    }
}

/// Working memory for the lights of a stream of points.
#[derive(Default)]
pub struct LightMemory {
    /// Light samples; after [`World::gather_lights_stream`] black where they do not reach their
    /// points.
    pub samples: SampleStreams,
    shadows: Box<ShadowRays>,
}

impl World {
    /// [`Self::gather_lights`] for every point of a stream, into `memory.samples`. `leaves` names
    /// the primitives that the points lie on, `media` the absorption coefficients on their viewers'
    /// sides.
    pub fn gather_lights_stream(
        &self,
        points: &PointStream,
        leaves: &Ids,
        media: &Colors,
        shadows: Shadowing,
        memory: &mut LightMemory,
        counters: &mut Counters,
    ) {
        let LightMemory {
            samples,
            shadows: rays,
        } = memory;
        let ShadowRays { all, lit, hidden } = &mut **rays;
        samples.clear();
        let near = self.culls_lights.then(|| points.position.bounds(points.len));
        for light in &self.lights {
            if near.as_ref().is_none_or(|near| light.reaches(near)) {
                light.samples_stream(points.len, &points.position, samples);
            }
        }
        let (len, margin) = (points.len.min(LANES), self.light_margin);
        for samples in samples.iter_mut() {
            let mut faces = [false; LANES];
            simd::dispatch(
                #[inline(always)]
                || {
                    for start in groups(len) {
                        for lane in start..start + GROUP {
                            let (point, view) = (points.get(lane), points.view.get(lane));
                            let sample = samples.get(lane);
                            let lit = (point.n_towards(view).dot(sample.direction) > 0.0)
                                & point.same_side(view, sample.direction)
                                & !sample.irradiance.is_black();
                            faces[lane] = lit;
                            let (ray, free) = shadow_ray(&point, &sample, margin);
                            all.origin.set(lane, ray.origin);
                            all.direction.set(lane, ray.direction);
                            all.limit[lane] = free;
                            let reaching = if lit { sample.irradiance } else { Rgb::BLACK };
                            samples.irradiance.set(lane, reaching);
                        }
                    }
                },
            );
            if shadows == Shadowing::None {
                continue;
            }
            if self.lets_through(shadows) {
                for lane in (0..len).filter(|lane| faces[*lane]) {
                    let ray = Ray::new(all.origin.get(lane), all.direction.get(lane));
                    let (free, skip) = (all.limit[lane], leaves.skip(lane));
                    let medium = Medium::absorbing(media.get(lane));
                    let part = self.light_through(ray, free, skip, medium, shadows, counters);
                    samples.irradiance.set(lane, samples.irradiance.get(lane) * part);
                }
                continue;
            }
            lit.len = 0;
            let mut lanes = [0_u16; LANES];
            for lane in 0..len {
                lanes[lit.len % LANES] = lane as u16;
                lit.len += usize::from(faces[lane]);
            }
            counters.shadow += lit.len as u64;
            if lit.len == 0 {
                continue;
            }
            let lanes = &lanes[..lit.len];
            if lit.len == len {
                all.len = len;
                all.skip.copy_first(len, leaves);
                self.accelerator.occluded_stream(all, &mut hidden.0);
            } else {
                lit.gather_lines(0, all, lanes);
                gather(&mut lit.limit, 0, &all.limit, lanes);
                lit.skip.gather(0, leaves, lanes);
                self.accelerator.occluded_stream(lit, &mut hidden.0);
            }
            for (&lane, hidden) in lanes.iter().zip(&hidden.0) {
                let lane = lane as usize % LANES;
                let arrives = samples.irradiance.get(lane);
                let [r, g, b] = [arrives.r, arrives.g, arrives.b].map(|part| select(*hidden, 0.0, part));
                samples.irradiance.set(lane, Rgb::new(r, g, b));
            }
        }
    }
}

/// Working memory of one thread.
#[derive(Default)]
pub struct Scratch {
    /// Light samples before the shadow test.
    pub samples: Vec<LightSample>,
    /// Lights that reach the point being shaded.
    pub incoming: Vec<Incoming>,
    /// Rays still to be traced.
    pub pending: Vec<PathState>,
    /// Rays traced so far by this thread.
    pub counters: Counters,
    /// Working memory of the integrator's own kind; see [`Scratch::take_memory`].
    memory: Option<Box<dyn Any + Send>>,
    /// How far the camera ray of the next call of [`Integrator::radiance`] is from its neighbours,
    /// where textures ask for it ([`World::reads_footprints`]): taken by that call.
    pub spread: Option<Spread>,
    /// Where integrators note every ray of the tree, if there is a list: for finding faults.
    pub record: Option<Vec<TreeNode>>,
}

impl Scratch {
    /// With a record, still empty.
    pub fn recording() -> Self {
        Self {
            record: Some(Vec::new()),
            ..Self::default()
        }
    }

    /// The working memory that was put back last, if it is of this kind, else new one.
    pub fn take_memory<M: Default + Send + 'static>(&mut self) -> Box<M> {
        let kept = self.memory.take().and_then(|memory| memory.downcast().ok());
        kept.unwrap_or_default()
    }

    /// Keeps working memory for the next call.
    pub fn put_memory<M: Send + 'static>(&mut self, memory: Box<M>) {
        self.memory = Some(memory);
    }

    /// Notes a ray in the record, if there is one, and returns its number there.
    #[inline]
    pub fn note(
        &mut self,
        path: &PathState,
        found: Option<(&RawHit, &SurfacePoint)>,
        throughput: Rgb,
        local: Rgb,
    ) -> u32 {
        match &mut self.record {
            None => 0,
            Some(nodes) => Self::note_in(nodes, path, found, throughput, local),
        }
    }

    /// Notes in the record, if there is one, a branch that is not followed because it lies beyond
    /// the depth limit, with the radiance that stands for it.
    #[inline]
    pub fn note_limit(&mut self, path: &PathState, local: Rgb) {
        if let Some(nodes) = &mut self.record {
            let node = Self::note_in(nodes, path, None, path.throughput, local);
            nodes[node as usize].limit = true;
        }
    }

    #[cold]
    fn note_in(
        nodes: &mut Vec<TreeNode>,
        path: &PathState,
        found: Option<(&RawHit, &SurfacePoint)>,
        throughput: Rgb,
        local: Rgb,
    ) -> u32 {
        let name = path.origin.map_or_else(String::new, |(parent, letter)| {
            format!("{}{letter}", nodes[parent as usize].path)
        });
        let (hit, point) = found.unzip();
        nodes.push(TreeNode {
            path: name,
            shape: hit.map_or(-1, |hit| i64::from(hit.shape)),
            primitive: hit.map_or(-1, |hit| i64::from(hit.primitive)),
            copy: hit.map_or(0, |hit| hit.instance.0),
            t: hit.map_or(f64::INFINITY, |hit| hit.t),
            position: point.map_or(DVec3::ZERO, |point| point.position),
            n_s: point.map_or(DVec3::ZERO, |point| point.n_s),
            throughput,
            local,
            limit: false,
        });
        nodes.len() as u32 - 1
    }
}

/// A ray of the tree under a camera ray and what it found. The sum of `throughput * local` over all
/// nodes is the radiance along the camera ray.
#[derive(Clone, Debug, PartialEq)]
pub struct TreeNode {
    /// "" for the camera ray, then a letter for each branch: R for reflection, T for transmission.
    /// Where a reflection is spread over directions, R and the number of the direction in two
    /// digits.
    pub path: String,
    /// Number of the shape that was hit; -1 for none.
    pub shape: i64,
    /// Number of the primitive in it; -1 for none.
    pub primitive: i64,
    /// Which copy of the shape; 0 for what is in no copy.
    pub copy: u32,
    /// Distance in metres; infinite for a miss.
    pub t: f64,
    /// The point that was hit.
    pub position: DVec3,
    /// Shading normal.
    pub n_s: DVec3,
    /// Factor on the node's radiance in the pixel.
    pub throughput: Rgb,
    /// Radiance that the node adds by itself: lights at a surface, or the background.
    pub local: Rgb,
    /// Whether this is a branch beyond the depth limit, which was not traced: a leaf with what
    /// stands for it.
    pub limit: bool,
}

/// Rays traced, and what was computed where they ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Nearest-hit queries: camera rays and branches.
    pub closest: u64,
    /// Shadow rays.
    pub shadow: u64,
    /// Points that were shaded, those that shadow rays go through among them.
    pub shaded: u64,
    /// Those of them whose texture coordinates were computed.
    pub uv: u64,
    /// Those of them for which textures were asked.
    pub textured: u64,
}

impl Counters {
    /// Rays of both kinds.
    pub fn total(&self) -> u64 {
        self.closest + self.shadow
    }

    /// Adds the counts of another thread.
    pub fn add(&mut self, other: Self) {
        self.closest += other.closest;
        self.shadow += other.shadow;
        self.shaded += other.shaded;
        self.uv += other.uv;
        self.textured += other.textured;
    }
}
