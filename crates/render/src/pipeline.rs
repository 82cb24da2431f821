//! The built scene.

use crate::builder::{BuildOptions, Builder, BuiltGroup};
use crate::coincident::{self, Coincidence, Seen};
use crate::shared::Shared;
use crate::unused::unused_parts;
use crate::{limits, reach};
use std::collections::{BTreeSet, HashSet};
use std::sync::Arc;
use std::time::Instant;
use whitstone_core::{
    BsdfFlags, Camera, Cameras, FamilyName, Integrator, Integrators, Lights, Material, ObjectOrder, Registry,
    Sampler, Samplers, Scene, SceneError, SceneErrors, Texture, TreeLimits, View,
};
use whitstone_scene::{Checked, Description, FilmTable, Omitted, Plan, Sources};

/// A scene that is built and ready to render.
pub struct Pipeline {
    /// The size of the image, and its AOVs.
    pub film: FilmTable,
    /// The camera.
    pub camera: Box<dyn Camera>,
    /// The sampler, which places samples in a pixel.
    pub sampler: Box<dyn Sampler>,
    /// The integrator.
    pub integrator: Box<dyn Integrator>,
    /// The visibility of all objects, computed before rendering, if the integrator is an
    /// object-order method.
    pub object_order: Option<Box<dyn ObjectOrder>>,
    /// The scene that it renders, at the first time of the film.
    pub scene: Scene,
    /// The scene at each further time of the film; empty if no shape moves.
    pub later: Vec<Moment>,
    /// Limits on the ray trees of its samples, if memory is not limited.
    usual_tree_limits: TreeLimits,
    /// The memory for pending rays in bytes, if it is limited.
    pub(crate) memory_left: Option<u64>,
    /// The memory that is reserved, in bytes.
    memory_taken: u64,
    /// Hash of the flattened scene.
    pub scene_hash: String,
    /// The accelerator in use, and the reason if the scene leaves the choice.
    pub accelerator: (String, String),
    /// The instantiated groups, by id.
    pub groups: Vec<BuiltGroup>,
    /// The textures that are evaluated during rendering, each once, with their types.
    pub textures: Vec<(String, Arc<dyn Texture>)>,
    /// The plugins that it is built from.
    pub used: BTreeSet<(FamilyName, &'static str)>,
    /// The parts that were not built, with the reasons.
    pub omitted: Vec<Omitted>,
    /// The pairs of shapes with coincident surfaces, by their numbers in the scene.
    pub coincident: Vec<Coincidence>,
    /// Reasons why the search for coincident surfaces was skipped, one for the scene or each group.
    pub coincident_unknown: Vec<String>,
    /// Warnings.
    pub warnings: Vec<SceneError>,
    /// Build time in seconds, including reading files.
    pub build_seconds: f64,
}

/// The scene at one time.
pub struct Moment {
    /// The scene.
    pub scene: Scene,
    /// See [`Pipeline::object_order`].
    pub object_order: Option<Box<dyn ObjectOrder>>,
}

/// A thread may always have this many pending rays: no usual scene has more.
const FEWEST_PENDING: usize = 4096;
/// The memory is divided among at least this many threads, so that whether a scene is refused does
/// not depend on the threads of usual machines.
const FEWEST_SHARES: usize = 16;

impl Pipeline {
    /// Limits on the ray trees of its samples if this many threads trace them and share the memory.
    pub fn tree_limits(&self, threads: usize) -> TreeLimits {
        let of_thread = |left: u64| left / threads.max(FEWEST_SHARES) as u64 / TreeLimits::PENDING_BYTES;
        let most = self.memory_left.map_or(u64::MAX, of_thread);
        let most = usize::try_from(most).unwrap_or(usize::MAX).max(FEWEST_PENDING);
        TreeLimits {
            pending: self.usual_tree_limits.pending.min(most),
            ..self.usual_tree_limits
        }
    }

    /// Reads, plans and builds a scene in one pass, which reports the errors of all steps.
    pub fn load(
        sources: &Sources,
        registry: &Registry,
        options: BuildOptions<'_>,
    ) -> Result<Self, SceneErrors> {
        let (pipeline, ()) = Self::load_and(sources, registry, options, |_| ())?;
        Ok(pipeline)
    }

    /// Like [`Self::load`], and also returns the result of `note` for the planned scene.
    pub fn load_and<T>(
        sources: &Sources,
        registry: &Registry,
        options: BuildOptions<'_>,
        note: impl FnOnce(&Plan<'_, '_>) -> T,
    ) -> Result<(Self, T), SceneErrors> {
        let mut errors = SceneErrors::default();
        // The build also reports an unknown type that the plan has reported.
        let mut known = HashSet::new();
        let mut add = |found: SceneErrors| {
            let new = found.0.into_iter().filter(|error| known.insert(error.clone()));
            errors.0.extend(new);
        };
        let built = (|| {
            let description = Description::parse(sources);
            add(description.errors);
            let description = description.value?;
            let plan = Plan::new(&description, registry);
            add(plan.errors);
            let plan = plan.value?;
            let pipeline = Self::build(&plan, registry, options);
            add(pipeline.errors);
            Some((pipeline.value?, note(&plan)))
        })();
        match built {
            Some(built) => errors.into_result(built),
            None => Err(errors),
        }
    }

    /// Builds the planned scene, at each time of its film. There is no pipeline if a part of it has
    /// errors.
    pub fn build(plan: &Plan<'_, '_>, registry: &Registry, options: BuildOptions<'_>) -> Checked<Self> {
        let description = plan.description;
        let times = &description.film.times;
        if times.len() == 1 || !description.moves() {
            let mut built = Self::build_moment(plan, registry, options, None);
            if let Some(pipeline) = built.value.as_mut().filter(|_| times.len() > 1) {
                pipeline.omitted.push(Omitted {
                    what: format!("{} of the {} times of the film", times.len() - 1, times.len()),
                    why: "no shape moves".to_owned(),
                });
            }
            return built;
        }
        let start = Instant::now();
        // Files are read once for all times.
        let shared = Shared::default();
        let options = BuildOptions {
            shared: options.shared.or(Some(&shared)),
            ..options
        };
        let mut built = Self::build_moment(plan, registry, options, None);
        let Some(first) = &mut built.value else {
            return built;
        };
        if first.moment_samples().checked_mul(times.len() as u32).is_none() {
            let (samples, times) = (first.moment_samples(), times.len());
            let message =
                format!("a pixel has {samples} samples at each of {times} times, more than 2^32 in all");
            let place = description.film.span.clone().unwrap_or_default();
            let errors = SceneError::at(place, message).into();
            return Checked { value: None, errors };
        }
        for time in &times[1..] {
            let moment = description.at(*time).and_then(|description| {
                let built = Plan::new(&description, registry).into_result().and_then(|plan| {
                    Self::build_moment(&plan, registry, options, Some(first.memory_taken)).into_result()
                });
                built.map_err(|mut errors| {
                    // The place is that of a transform that is valid by itself.
                    errors
                        .0
                        .iter_mut()
                        .for_each(|error| error.message = format!("at {time} s: {}", error.message));
                    errors
                })
            });
            match moment {
                Ok(moment) => first.append(moment),
                // The other times may have the same errors.
                Err(errors) => return Checked { value: None, errors },
            }
        }
        first.build_seconds = start.elapsed().as_secs_f64();
        built
    }

    /// Adds the same scene at a later time.
    fn append(&mut self, moment: Self) {
        (self.memory_left, self.memory_taken) = (moment.memory_left, moment.memory_taken);
        // A pair may be separated at one time and not at another.
        let kind = |pair: &Coincidence| (pair.shapes, pair.form, pair.gap.is_none());
        let is_new = |pair: &Coincidence| self.coincident.iter().all(|known| kind(known) != kind(pair));
        let pairs: Vec<Coincidence> = moment.coincident.into_iter().filter(is_new).collect();
        self.coincident.extend(pairs);
        for why in moment.coincident_unknown {
            if !self.coincident_unknown.contains(&why) {
                self.coincident_unknown.push(why);
            }
        }
        for warning in moment.warnings {
            if !self.warnings.contains(&warning) {
                self.warnings.push(warning);
            }
        }
        self.later.push(Moment {
            scene: moment.scene,
            object_order: moment.object_order,
        });
    }

    /// Builds the planned scene at the time of its description; `taken` is the memory of earlier
    /// times, with that of the image.
    fn build_moment(
        plan: &Plan<'_, '_>,
        registry: &Registry,
        options: BuildOptions<'_>,
        taken: Option<u64>,
    ) -> Checked<Self> {
        let usual = TreeLimits::default();
        let start = Instant::now();
        let description = plan.description;
        let mut errors = SceneErrors::default();
        let mut builder = Builder::new(description, registry, options);
        let size = description.film.size;
        // The part of the image that is rendered.
        let mut part = description.film.clone();
        if let Some(region) = options.region.map(|region| region.within(size)) {
            (part.size.width, part.size.height) = (region.width, region.height);
        }
        match taken {
            Some(taken) => builder.memory.resume(taken),
            None => {
                errors.take(builder.memory.take_film(&part));
            }
        }
        let camera = errors.take(builder.one::<Cameras>(&description.camera, size));
        let sampler =
            (plan.sampler.as_ref()).and_then(|table| errors.take(builder.one::<Samplers>(table, ())));
        let integrator =
            (plan.integrator.as_ref()).and_then(|table| errors.take(builder.one::<Integrators>(table, ())));

        let mut lights = Vec::new();
        for light in &description.lights {
            lights.extend(errors.take(builder.plugin::<Lights>(light, ())));
        }
        let materials = builder.materials(plan, &mut errors);
        if errors.0.is_empty() {
            limits::prioritized(plan, &materials, &mut errors);
        }
        if let Some(integrator) = &integrator {
            limits::glossy_rays(plan, &materials, &**integrator, &mut errors);
        }
        let complete = builder.groups(plan, &mut errors);
        let seen = Seen {
            from: camera
                .as_deref()
                .map_or_else(Vec::new, |camera| coincident::eyes(camera, size)),
            lights: &lights,
        };
        let images = [
            part.size.width,
            part.size.height,
            sampler.as_ref().map_or(1, |sampler| sampler.count()),
        ];
        builder.expected_rays =
            (options.single_image).then(|| expected_rays(images, lights.len(), &materials));
        let built = builder.structure(
            plan,
            (&description.shapes, &description.accelerator),
            (0, &seen),
            &mut errors,
        );
        let mut omitted = builder.unused_materials();
        omitted.extend_from_slice(&plan.omitted);
        omitted.extend(builder.unused_textures());
        if let Some(built) = &built
            && errors.0.is_empty()
        {
            let tables = &description.lights;
            omitted.extend(reach::omit_lights(
                tables,
                &mut lights,
                &built.geometry,
                &materials,
            ));
        }
        if let Some(integrator) = &integrator {
            omitted.extend(unused_parts(
                description,
                &lights,
                &materials,
                integrator.as_ref(),
            ));
        }
        if let (Some(paths), Some(integrator)) = (&description.film.paths, &integrator)
            && !integrator.splits_paths()
        {
            let error = SceneError::at(paths.span.clone(), "the integrator does not split its paths");
            let help = "remove the path classes, or use the integrator \"whitted\" or \"appel\"";
            errors.0.push(error.with_help(help));
        }
        let object_order = match (&camera, &integrator, &plan.integrator, &built) {
            (Some(camera), Some(integrator), Some(table), Some(built)) => {
                let view = View {
                    geometry: &built.geometry,
                    camera: &**camera,
                    film: size,
                };
                let built = builder.object_order(&**integrator, table, &view);
                errors.take(built).flatten()
            }
            _ => None,
        };
        let (memory_left, memory_taken) = (builder.memory.left(), builder.memory.taken());
        let (warnings, used) = (builder.warnings, builder.used);
        let (coincident, coincident_unknown) = (builder.coincident, builder.coincident_unknown);
        let groups = builder.groups.into_values().collect();
        // Drop textures that were only needed during the build.
        drop(builder.textures);
        let textures = builder.looked_up.kept(&mut omitted);
        let pipeline = match (camera, sampler, integrator, built) {
            (Some(camera), Some(sampler), Some(integrator), Some(built))
                if complete && errors.0.is_empty() =>
            {
                let mut scene = Scene::new(built.geometry, built.accelerator, materials, lights);
                let shown = || plan.appearances.all.iter().zip(0..);
                let variants = shown().skip(plan.appearances.shapes());
                scene.set_variants(variants.map(|(variant, _)| variant.shape).collect());
                let without = shown().filter(|(appearance, _)| !appearance.casts_shadow);
                scene.let_light_through(without.map(|(_, number)| number));
                scene.light_margin = built.light_margin;
                Some(Self {
                    film: description.film.clone(),
                    camera,
                    sampler,
                    integrator,
                    object_order,
                    scene,
                    later: Vec::new(),
                    usual_tree_limits: TreeLimits {
                        rays: options.max_tree_rays.unwrap_or(usual.rays),
                        ..usual
                    },
                    memory_left,
                    memory_taken,
                    scene_hash: description.flattened.hash.clone(),
                    accelerator: built.chosen,
                    groups,
                    textures,
                    used,
                    omitted,
                    coincident,
                    coincident_unknown,
                    warnings,
                    build_seconds: start.elapsed().as_secs_f64(),
                })
            }
            _ => None,
        };
        Checked {
            value: pipeline,
            errors,
        }
    }
}

impl Pipeline {
    /// The number of times at which the scene is seen.
    pub fn moments(&self) -> u32 {
        1 + self.later.len() as u32
    }

    /// The scene at the time with this number, below [`Self::moments`].
    pub(crate) fn moment(&self, number: u32) -> (&Scene, Option<&dyn ObjectOrder>) {
        match number
            .checked_sub(1)
            .and_then(|later| self.later.get(later as usize))
        {
            Some(moment) => (&moment.scene, moment.object_order.as_deref()),
            None => (&self.scene, self.object_order.as_deref()),
        }
    }

    /// The same image without what the scene needs being known in advance: for measurements.
    #[must_use]
    pub fn without_specialization(mut self) -> Self {
        self.scene = self.scene.without_specialization();
        let later = self.later.into_iter().map(|moment| Moment {
            scene: moment.scene.without_specialization(),
            ..moment
        });
        self.later = later.collect();
        self
    }
}

/// About how many rays an image takes: for each camera sample one ray, and one to each light;
/// and for materials that reflect or refract, several times as many.
fn expected_rays([width, height, samples]: [u32; 3], lights: usize, materials: &[Arc<dyn Material>]) -> u64 {
    let specular = |material: &Arc<dyn Material>| material.flags().intersects(BsdfFlags::SPECULAR);
    let bounces = if materials.iter().any(specular) { 8 } else { 1 };
    [width, height, samples]
        .into_iter()
        .map(u64::from)
        .fold(bounces * (1 + lights as u64), u64::saturating_mul)
}
