use crate::shading::light_tree::LightTree;
use crate::shading::shadow::shadow_ray;
use crate::simd;
use crate::simd::select;
use crate::stream::{
    Colors, GROUP, HitStream, Ids, LANES, Lanes, RayStream, SampleStreams, SurfaceStream, Vectors,
    filter_lanes, gather, groups, whole_groups,
};
use crate::{
    Aabb, Accelerator, BsdfFlags, Context, DirectLighting, Footprint, Geometry, IncidentLight, Interval,
    Light, LightFlags, LightSample, Material, MediumInterface, MediumStack, MediumState, NestedDielectrics,
    ObjectOrder, PathClasses, PathState, PathSums, PreliminaryIntersection, Ray, RayDifferential, Refused,
    Rgb, SelfHitFilter, ShadowMode, SpecularRays, SurfaceAttributes, SurfaceInteraction, VertexAttributes,
    View,
};
use glam::DVec3;
use std::any::Any;
use std::sync::{Arc, OnceLock};

/// Computes the radiance that arrives along a camera ray.
pub trait Integrator: Send + Sync {
    /// Whether it follows the specular rays of materials. If not, the plan skips everything that
    /// only specular rays need.
    fn follows_branches(&self) -> bool;

    /// Whether [`Self::radiance`] fills [`Scratch::paths`]. If not, scenes with path classes are
    /// refused.
    fn splits_paths(&self) -> bool {
        false
    }

    /// Upper bound on path length when every bounce splits into `directions` equally weighted rays.
    /// The pipeline rejects scenes whose ray count would explode.
    fn max_split_depth(&self, directions: u32) -> u32 {
        let _ = directions;
        0
    }

    /// Radiance along the ray, a pure function of `scene` and `ray`.
    ///
    /// `scratch` is working memory that one thread keeps between calls. It counts the rays and, if
    /// it has a record, stores every ray there.
    fn radiance(&self, scene: &Scene, ray: &Ray, scratch: &mut Scratch) -> Rgb;

    /// [`Self::radiance`] for every ray of a stream of camera rays, with identical bits and counts.
    fn radiance_stream(&self, scene: &Scene, rays: &RayStream, scratch: &mut Scratch, out: &mut Colors) {
        for lane in 0..rays.len {
            scratch.differential = rays.differential(lane);
            out.set(lane, self.radiance(scene, &rays.ray(lane), scratch));
        }
    }

    /// [`Self::radiance_stream`] for rays whose nearest hits are known, which may be overwritten.
    /// They count as rays of this call.
    fn shade_stream(
        &self,
        scene: &Scene,
        rays: &RayStream,
        hits: &mut Box<HitStream>,
        scratch: &mut Scratch,
        out: &mut Colors,
    ) {
        let _ = hits;
        self.radiance_stream(scene, rays, scratch, out);
    }

    /// For object-order methods, which project shapes to pixels: a prepared renderer that returns
    /// the radiance along camera rays, or the reason why the scene is refused. `None` for methods
    /// that trace rays from pixels to objects.
    fn object_order(
        &self,
        view: &View<'_>,
        context: &mut dyn Context,
    ) -> Result<Option<Box<dyn ObjectOrder>>, Refused> {
        let _ = (view, context);
        Ok(None)
    }
}

/// Number of lights from which culling them per stream of points pays off.
const MANY_LIGHTS: usize = 8;

/// Maximum number of light samples per point in streams, which take 60 MB then.
const MAX_STREAMED_SAMPLES: usize = 4096;

/// A scene as integrators see it, ready to trace.
pub struct Scene {
    /// All shapes.
    pub geometry: Arc<Geometry>,
    /// Built over the geometry.
    pub accelerator: Box<dyn Accelerator>,
    /// The material of each shape, by its number, then those of the variants.
    pub materials: Vec<Arc<dyn Material>>,
    /// Lights that give samples, in the order of the scene.
    pub lights: Vec<Arc<dyn Light>>,
    /// Lights that are seen by rays that hit nothing.
    pub backgrounds: Vec<Arc<dyn Light>>,
    /// Whether lights that reach no point of a stream are skipped before they are sampled. The
    /// image does not change.
    pub culls_lights: bool,
    /// The hierarchy over `lights`, built when an integrator first needs it.
    light_tree: OnceLock<LightTree>,
    /// Sum of the ambient radiances.
    pub ambient: Rgb,
    /// Additional distance before a light at which shadow rays end, in metres, beyond the margin
    /// for rounding. It is positive if surfaces that coincide with lights have been moved.
    pub light_margin: f64,
    /// The nested dielectrics, if there are any. Rays are then traced one at a time.
    pub bodies: Option<NestedDielectrics>,
    /// Whether some material spreads its specular rays, each traced by several rays.
    pub(crate) has_glossy_rays: bool,
    /// See [`Scene::requires_scalar_tracing`].
    requires_scalar_tracing: bool,
    /// The shape of each variant: see [`Self::set_variants`].
    variants: Vec<u32>,
    /// The attributes that each material reads, by shape, cached here to avoid a call per hit.
    needs: Vec<SurfaceAttributes>,
    /// The responses of each material, in the same order.
    responses: Vec<BsdfFlags>,
    /// Union of the responses of all materials.
    pub(crate) flags: BsdfFlags,
    /// Whether any material reads footprints.
    footprints: bool,
}

impl Scene {
    /// Builds the scene and sorts the lights by their contributions.
    pub fn new(
        geometry: Arc<Geometry>,
        accelerator: Box<dyn Accelerator>,
        materials: Vec<Arc<dyn Material>>,
        lights: Vec<Arc<dyn Light>>,
    ) -> Self {
        let mut needs: Vec<SurfaceAttributes> = materials.iter().map(|material| material.needs()).collect();
        let responses: Vec<BsdfFlags> = materials.iter().map(|material| material.flags()).collect();
        let flags = responses
            .iter()
            .fold(BsdfFlags::NOTHING, |all, flags| all | *flags);
        let footprints = needs
            .iter()
            .any(|needs| needs.contains(SurfaceAttributes::FOOTPRINT));
        if footprints {
            // Rays that are reflected or transmitted must keep their ray differentials.
            for (needs, flags) in needs.iter_mut().zip(&responses) {
                if flags.intersects(BsdfFlags::SPECULAR) {
                    *needs |= SurfaceAttributes::FOOTPRINT;
                }
            }
        }
        let ambient = lights.iter().map(|light| light.ambient()).sum();
        let giving = |what| -> Vec<Arc<dyn Light>> {
            let mut chosen = lights.clone();
            chosen.retain(|light| light.flags().contains(what));
            chosen
        };
        let bodies = NestedDielectrics::of(&materials);
        let has_glossy_rays = materials
            .iter()
            .any(|material| material.reflections() > 1 || material.transmissions() > 1);
        let (samplers, backgrounds) = (giving(LightFlags::SAMPLES), giving(LightFlags::BACKGROUND));
        Self {
            geometry,
            accelerator,
            materials,
            culls_lights: samplers.len() >= MANY_LIGHTS,
            light_tree: OnceLock::new(),
            lights: samplers,
            backgrounds,
            ambient,
            light_margin: 0.0,
            requires_scalar_tracing: bodies.is_some() || has_glossy_rays,
            bodies,
            has_glossy_rays,
            variants: Vec::new(),
            needs,
            responses,
            flags,
            footprints,
        }
    }

    /// Declares that the last numbers of `materials` are variants of other shapes: the same shape
    /// with another material, as instances show it ([`crate::Instance::set_variants`]). `variants`
    /// holds the number of the shape of each.
    pub fn set_variants(&mut self, variants: Vec<u32>) {
        assert!(variants.len() <= self.materials.len());
        self.variants = variants;
    }

    /// The number of a shape in the scene file, given the number of a hit, which may be that of a
    /// variant.
    pub fn shape_id(&self, shape: u32) -> u32 {
        let shapes = self.materials.len() - self.variants.len();
        match (shape as usize).checked_sub(shapes) {
            None => shape,
            Some(variant) => self.variants[variant],
        }
    }

    /// Makes shapes (or variants of shapes) cast no shadow.
    pub fn let_light_through(&mut self, shapes: impl IntoIterator<Item = u32>) {
        for shape in shapes {
            let flags = &mut self.responses[shape as usize];
            *flags = *flags | BsdfFlags::NO_SHADOW;
            self.flags = self.flags | BsdfFlags::NO_SHADOW;
        }
    }

    /// Disables all scene-specific specialisation (attribute needs, lobe flags, light culling). The
    /// image is bit-identical; the extra cost is what specialisation saves.
    #[must_use]
    pub fn without_specialization(mut self) -> Self {
        self.needs.fill(SurfaceAttributes::ALL);
        self.footprints = true;
        self.culls_lights = false;
        for flags in &mut self.responses {
            *flags = *flags | BsdfFlags::ZERO_IF_ABSENT;
        }
        self.flags = self.flags | BsdfFlags::ZERO_IF_ABSENT | BsdfFlags::CUT_OUTS;
        self
    }

    /// The responses of a shape's material.
    pub fn flags_of(&self, shape: u32) -> BsdfFlags {
        self.responses[shape as usize]
    }

    /// The attributes that are read of a shape's surface points.
    pub(crate) fn needs_of(&self, shape: u32) -> SurfaceAttributes {
        self.needs[shape as usize]
    }

    /// True if rays need state (a [`MediumStack`]) or branching that `RayStream` cannot store, so
    /// integrators must use the scalar path.
    pub fn requires_scalar_tracing(&self) -> bool {
        self.requires_scalar_tracing
    }

    /// Whether some texture in use reads footprints, so that rays must carry ray differentials.
    pub fn reads_footprints(&self) -> bool {
        self.footprints
    }

    /// Counts shaded points of a shape.
    #[inline]
    pub fn count_shaded(&self, shape: u32, points: usize, counters: &mut Counters) {
        let needs = self.needs[shape as usize];
        let counted = |need| if needs.contains(need) { points as u64 } else { 0 };
        counters.shaded += points as u64;
        counters.uv += counted(SurfaceAttributes::UV);
        counters.textured += counted(SurfaceAttributes::TEXTURE);
    }

    /// The interface of a nested dielectric, for a ray in the bodies `inside`; `None` for all other
    /// surfaces.
    pub fn face(
        &self,
        shape: u32,
        inside: MediumStack,
        point: &SurfaceInteraction,
        view: DVec3,
    ) -> Option<MediumInterface> {
        let bodies = self.bodies.as_ref()?;
        bodies.face(shape, inside, point.n_g.dot(view) > 0.0)
    }

    /// The specular rays at a surface, for a ray in the bodies `inside`.
    pub fn specular_rays(
        &self,
        shape: u32,
        inside: MediumStack,
        point: &SurfaceInteraction,
        view: DVec3,
        out: &mut SpecularRays,
    ) {
        let material = &*self.materials[shape as usize];
        match (self.face(shape, inside, point, view), material.prioritized()) {
            (Some(face), Some(body)) => face.specular_rays(body, point, view, out),
            _ => material.specular_rays(point, view, out),
        }
    }

    /// The background radiance, seen by a ray that hits nothing.
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

    /// The surface at a hit, with the normals and texture coordinates that its material reads.
    pub fn surface(&self, ray: &Ray, hit: &PreliminaryIntersection) -> SurfaceInteraction {
        let needs = self.needs[hit.shape as usize];
        let mut point = self.geometry.surface(ray, hit, needs);
        if needs.contains(SurfaceAttributes::UV_GRADIENT) {
            point.uv_gradient = self.geometry.uv_gradient(&point, hit);
        }
        point
    }

    /// The footprint of a ray at its hit, with the attributes that the material reads; none if the
    /// ray carries no ray differentials.
    pub fn footprint(
        &self,
        ray: &Ray,
        hit: &PreliminaryIntersection,
        point: &SurfaceInteraction,
        differential: Option<&RayDifferential>,
    ) -> Footprint {
        let needs = self.needs[hit.shape as usize];
        match differential {
            Some(differential) if needs.contains(SurfaceAttributes::FOOTPRINT) => {
                differential.footprint(&self.geometry, ray, hit, point, needs)
            }
            _ => Footprint::NONE,
        }
    }

    /// [`Self::surface`] for every ray of a stream, all of which hit this shape, after rule S.
    pub fn surface_stream(&self, shape: u32, rays: &RayStream, hits: &HitStream, points: &mut SurfaceStream) {
        points.len = rays.len;
        let needs = self.needs[shape as usize];
        let of_vertices =
            SurfaceAttributes::VERTEX_COLOR | SurfaceAttributes::SECOND_UV | SurfaceAttributes::TANGENT;
        if needs.intersects(of_vertices) {
            // Shapes without such attributes write none.
            points.vertex.turn_on().0.fill(VertexAttributes::NONE);
        } else {
            points.vertex.turn_off();
        }
        self.geometry.surface_stream(shape, rays, hits, needs, points);
        if needs.contains(SurfaceAttributes::UV_GRADIENT) {
            for lane in 0..rays.len.min(LANES) {
                let [u, v] = self.geometry.uv_gradient(&points.get(lane), &hits.hit(lane));
                let gradients = points.uv_gradient.memory();
                gradients.u.set(lane, u);
                gradients.v.set(lane, v);
            }
            points.uv_gradient.turn_on();
        } else {
            points.uv_gradient.turn_off();
        }
        match rays.differential.get() {
            Some(differentials) if needs.contains(SurfaceAttributes::FOOTPRINT) => {
                for lane in 0..rays.len.min(LANES) {
                    let (ray, hit, point) = (rays.ray(lane), hits.hit(lane), points.get(lane));
                    let differential = differentials.get(lane);
                    let found = differential.footprint(&self.geometry, &ray, &hit, &point, needs);
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

    /// Union of the attributes that the materials in use read.
    pub fn needs(&self) -> SurfaceAttributes {
        self.needs
            .iter()
            .fold(SurfaceAttributes::NOTHING, |all, needs| all | *needs)
    }

    /// Gathers the lights that reach a surface point on the side of `view` into `scratch.incoming`.
    /// `medium` is the medium on that side.
    pub fn gather_lights(
        &self,
        point: &SurfaceInteraction,
        view: DVec3,
        skip: SelfHitFilter,
        lighting: DirectLighting,
        medium: MediumState,
        scratch: &mut Scratch,
    ) {
        let DirectLighting {
            shadows,
            light_cutoff,
        } = lighting;
        let through = self.lets_through(shadows);
        scratch.incoming.clear();
        scratch.samples.clear();
        let (lights, samples) = (&mut scratch.lights, &mut scratch.samples);
        if self.bright_lights(light_cutoff, || Aabb::around([point.position]), lights) {
            for light in lights {
                self.lights[*light as usize].samples(point.position, samples);
            }
        } else {
            for light in &self.lights {
                light.samples(point.position, samples);
            }
        }
        let n = point.n_towards(view);
        for sample in &scratch.samples {
            let lit = n.dot(sample.direction) > 0.0
                && point.same_side(view, sample.direction)
                && !sample.irradiance.is_black()
                && sample.irradiance.max_component() >= light_cutoff;
            if !lit {
                continue;
            }
            let mut irradiance = sample.irradiance;
            if shadows != ShadowMode::None {
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
            scratch.incoming.push(IncidentLight {
                direction: sample.direction,
                irradiance,
            });
        }
    }
}

impl Scene {
    /// Finds the lights that can reach the cutoff at some point of a box, in the order of the
    /// scene. Returns false if there are too few lights, or no cutoff, for this to pay off.
    fn bright_lights(&self, cutoff: f64, points: impl FnOnce() -> Aabb, out: &mut Vec<u32>) -> bool {
        let searches = cutoff > 0.0 && self.culls_lights;
        if searches {
            let tree = self.light_tree.get_or_init(|| LightTree::new(&self.lights));
            tree.find(&points(), cutoff, out);
        }
        searches
    }
}

/// Shadow rays of a stream of points.
#[derive(Default)]
struct ShadowRays {
    /// Indexed by point; valid only in lit lanes.
    all: RayStream,
    /// The lit lanes of `all`, compacted.
    lit: RayStream,
    hidden: Hidden,
}

/// The result of [`Accelerator::occluded_stream`].
struct Hidden(Lanes<bool>);

impl Default for Hidden {
    fn default() -> Self {
        Self([false; LANES])
    }
}

/// Working memory for the lights of a stream of points.
#[derive(Default)]
pub struct LightMemory {
    /// Light samples; after [`Scene::gather_lights_stream`], those that do not reach their points
    /// are black.
    pub samples: SampleStreams,
    /// Indices of the lights that can reach the cutoff.
    bright: Vec<u32>,
    shadows: Box<ShadowRays>,
}

impl Scene {
    /// [`Self::gather_lights`] for every point of a stream, into `memory.samples`.
    /// `origin_primitive` contains the primitives that the points lie on, `media` the absorption
    /// coefficients on the viewers' sides.
    ///
    /// Returns false, without a result, if there are too many samples to keep those of all points
    /// at once.
    #[must_use]
    pub fn gather_lights_stream(
        &self,
        points: &SurfaceStream,
        origin_primitive: &Ids,
        media: &Colors,
        lighting: DirectLighting,
        memory: &mut LightMemory,
        counters: &mut Counters,
    ) -> bool {
        let DirectLighting {
            shadows,
            light_cutoff,
        } = lighting;
        let LightMemory {
            samples,
            bright,
            shadows: rays,
        } = memory;
        let ShadowRays { all, lit, hidden } = &mut **rays;
        samples.clear();
        let near = self.culls_lights.then(|| points.position.bounds(points.len));
        let mut add = |light: &dyn Light| {
            if near.as_ref().is_none_or(|near| light.affects_bounds(near)) {
                light.samples_stream(points.len, &points.position, samples);
            }
            samples.len() <= MAX_STREAMED_SAMPLES
        };
        let bounds = || near.unwrap_or(Aabb::EVERYTHING);
        let fits = if self.bright_lights(light_cutoff, bounds, bright) {
            bright.iter().all(|light| add(&*self.lights[*light as usize]))
        } else {
            self.lights.iter().all(|light| add(&**light))
        };
        if !fits {
            return false;
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
                                & !sample.irradiance.is_black()
                                & (sample.irradiance.max_component() >= light_cutoff);
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
            if shadows == ShadowMode::None {
                continue;
            }
            if self.lets_through(shadows) {
                for lane in (0..len).filter(|lane| faces[*lane]) {
                    let ray = Ray::new(all.origin.get(lane), all.direction.get(lane));
                    let (free, skip) = (all.limit[lane], origin_primitive.skip(lane));
                    let medium = MediumState::absorbing(media.get(lane));
                    let part = self.light_through(ray, free, skip, medium, shadows, counters);
                    samples.irradiance.set(lane, samples.irradiance.get(lane) * part);
                }
                continue;
            }
            let mut lanes = [0_u16; LANES];
            lit.len = simd::dispatch(
                #[inline(always)]
                || filter_lanes(&mut lanes, len, |lane| faces[lane]),
            );
            counters.shadow += lit.len as u64;
            if lit.len == 0 {
                continue;
            }
            let lanes = &lanes[..lit.len];
            if lit.len == len {
                all.len = len;
                all.skip.copy_first(len, origin_primitive);
                self.accelerator.occluded_stream(all, &mut hidden.0);
                simd::dispatch(
                    #[inline(always)]
                    || {
                        for lane in whole_groups(len) {
                            let arrives = samples.irradiance.get(lane);
                            let shown = if hidden.0[lane] { Rgb::BLACK } else { arrives };
                            samples.irradiance.set(lane, shown);
                        }
                    },
                );
                continue;
            }
            simd::dispatch(
                #[inline(always)]
                || {
                    lit.gather_lines(0, all, lanes);
                    gather(&mut lit.limit, 0, &all.limit, lanes);
                    lit.skip.gather(0, origin_primitive, lanes);
                },
            );
            self.accelerator.occluded_stream(lit, &mut hidden.0);
            for (&lane, hidden) in lanes.iter().zip(&hidden.0) {
                let lane = lane as usize % LANES;
                let arrives = samples.irradiance.get(lane);
                let [r, g, b] = [arrives.r, arrives.g, arrives.b].map(|part| select(*hidden, 0.0, part));
                samples.irradiance.set(lane, Rgb::new(r, g, b));
            }
        }
        true
    }
}

/// Limits on the ray tree of a camera sample, so that no scene takes time and memory without end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TreeLimits {
    /// Maximum number of rays.
    pub rays: u32,
    /// Maximum number of pending rays; in a stream, of all its samples together.
    pub pending: usize,
}

impl TreeLimits {
    /// Memory of a pending ray in bytes, also while its list grows and exists twice.
    pub const PENDING_BYTES: u64 = 1024;
}

impl Default for TreeLimits {
    fn default() -> Self {
        Self {
            rays: 1 << 20,
            pending: 1 << 18,
        }
    }
}

/// A ray tree that exceeds its limits. It is not finished.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLarge {
    /// The lane of the camera ray in its stream; 0 for a single ray.
    pub lane: usize,
    /// The limits.
    pub limits: TreeLimits,
    /// Whether it has too many rays; otherwise it has too many pending rays.
    pub by_rays: bool,
}

/// Working memory of one thread.
#[derive(Default)]
pub struct Scratch {
    /// Limits on the ray trees.
    pub limits: TreeLimits,
    /// A ray tree that exceeded them; integrators then stop, and the radiance is not valid.
    pub too_large: Option<TooLarge>,
    /// Light samples before the shadow test.
    pub samples: Vec<LightSample>,
    /// Indices of the lights that are sampled.
    lights: Vec<u32>,
    /// Lights that reach the point being shaded.
    pub incoming: Vec<IncidentLight>,
    /// Rays that are still to be traced.
    pub pending: Vec<PathState>,
    /// Rays traced so far by this thread.
    pub counters: Counters,
    /// Working memory private to the integrator; see [`Scratch::take_memory`].
    memory: Option<Box<dyn Any + Send>>,
    /// Ray differentials of the camera ray that the next call of [`Integrator::radiance`] traces,
    /// if textures read footprints ([`Scene::reads_footprints`]). That call takes them.
    pub differential: Option<RayDifferential>,
    /// If present, integrators record every ray of the tree here, for debugging.
    pub record: Option<Vec<TreeNode>>,
    /// If present, [`Integrator::radiance`] of integrators that split paths
    /// ([`Integrator::splits_paths`]) adds the radiance by path class here.
    pub paths: Option<PathSums>,
}

impl Scratch {
    /// Working memory for trees within these limits.
    pub fn within(limits: TreeLimits) -> Self {
        Self {
            limits,
            ..Self::default()
        }
    }

    /// Working memory with an empty record.
    pub fn recording() -> Self {
        Self {
            record: Some(Vec::new()),
            ..Self::default()
        }
    }

    /// Working memory for trees within these limits, with sums of 0 for these path classes.
    pub fn splitting(limits: TreeLimits, classes: Arc<PathClasses>) -> Self {
        Self {
            paths: Some(PathSums::new(classes)),
            ..Self::within(limits)
        }
    }

    /// The working memory that was put back last, if it has this type; otherwise new memory.
    pub fn take_memory<M: Default + Send + 'static>(&mut self) -> Box<M> {
        let kept = self.memory.take().and_then(|memory| memory.downcast().ok());
        kept.unwrap_or_default()
    }

    /// Whether a tree with this many rays and pending rays is within the limits. If not, sets
    /// [`Self::too_large`].
    #[inline]
    pub fn allows(&mut self, lane: usize, rays: u32, pending: usize) -> bool {
        let limits = self.limits;
        let allowed = rays <= limits.rays && pending <= limits.pending;
        if !allowed {
            self.too_large = Some(TooLarge {
                lane,
                limits,
                by_rays: rays > limits.rays,
            });
        }
        allowed
    }

    /// Keeps working memory for the next call.
    pub fn put_memory<M: Send + 'static>(&mut self, memory: Box<M>) {
        self.memory = Some(memory);
    }

    /// Adds a ray to the record, if there is one, and returns its index.
    #[inline]
    pub fn note(
        &mut self,
        path: &PathState,
        found: Option<(&PreliminaryIntersection, &SurfaceInteraction)>,
        throughput: Rgb,
        local: Rgb,
    ) -> u32 {
        match &mut self.record {
            None => 0,
            Some(nodes) => Self::note_in(nodes, path, found, throughput, local),
        }
    }

    /// Adds to the record, if there is one, a branch that is not followed because of the depth
    /// limit, with the radiance used in its place.
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
        found: Option<(&PreliminaryIntersection, &SurfaceInteraction)>,
        throughput: Rgb,
        local: Rgb,
    ) -> u32 {
        let name = path.origin.map_or_else(String::new, |(parent, letter)| {
            format!("{}{letter}", nodes[parent as usize].path)
        });
        let (hit, point) = found.unzip();
        nodes.push(TreeNode {
            path: name,
            ray: path.ray,
            shape: hit.map_or(-1, |hit| i64::from(hit.shape)),
            primitive: hit.map_or(-1, |hit| i64::from(hit.primitive)),
            instance: hit.map_or(0, |hit| hit.instance.0),
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

/// A node of a ray tree: a ray and the surface that it hits. The sum of `throughput * local` over
/// all nodes is the radiance along the camera ray.
#[derive(Clone, Debug, PartialEq)]
pub struct TreeNode {
    /// "" for the camera ray, then a letter per branch: R for reflection, T for transmission. If
    /// the branch is one of several (glossy reflection, rough glass), its number in two digits
    /// follows.
    pub path: String,
    /// The ray itself, in world space, with unit direction.
    pub ray: Ray,
    /// Number of the shape that was hit; -1 if none.
    pub shape: i64,
    /// Number of the primitive in the shape; -1 if none.
    pub primitive: i64,
    /// Instance of the shape; 0 if it is not instanced.
    pub instance: u32,
    /// Distance in metres; infinite for a miss.
    pub t: f64,
    /// The point that was hit.
    pub position: DVec3,
    /// Shading normal.
    pub n_s: DVec3,
    /// Factor on the node's radiance in the pixel.
    pub throughput: Rgb,
    /// Radiance that the node itself adds: local illumination and emission, or the background.
    pub local: Rgb,
    /// Whether this branch exceeds the depth limit and was not traced: a leaf with the radiance
    /// used in its place.
    pub limit: bool,
}

/// Numbers of rays traced and of points shaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Nearest-hit queries: camera rays and specular rays.
    pub closest: u64,
    /// Shadow rays.
    pub shadow: u64,
    /// Shaded points, including surfaces that shadow rays pass through.
    pub shaded: u64,
    /// Shaded points whose texture coordinates were computed.
    pub uv: u64,
    /// Shaded points at which textures were evaluated.
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
