use crate::cache::Cache;
use crate::choice::{BRUTE_FORCE, choose_accelerator};
use crate::coincident::{self, Coincidence, Seen};
use crate::groups::{BuiltGroup, unknown_id};
use crate::limits;
use crate::memory::Memory;
use crate::operands::{self, Operands};
use crate::reach;
use crate::unused::{LookedUp, unused_parts};
use crate::{Description, FilmTable, Omitted, Plan, PluginTable, ShapeTable};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;
use toml::Spanned;
use toml::de::DeTable;
use whitstone_core::config::{
    FilePath, GroupRef, MaterialRef, PluginRef, SolidRef, TextureRef, TextureValue, inline_plugins,
};
use whitstone_core::{
    Accelerator, Accelerators, Camera, Cameras, ClosedMesh, ColorSource, Context, FamilyName, Geometry,
    Group, Integrator, Integrators, Lights, LoweredShape, Material, Materials, ObjectOrder, Refused,
    Registry, Sampler, Samplers, Scene, SceneError, SceneErrors, Shape, Shapes, SourceSpan, Texture,
    Textures, Transform, TriangleMesh, View,
};

/// Maximum nesting of materials: each hit evaluates all of them.
const MAX_NESTING: usize = 16;

/// A scene that is built and ready to render.
pub struct Pipeline {
    /// Image and layers.
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
    /// The scene that it renders.
    pub scene: Scene,
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
    pub left_out: Vec<Omitted>,
    /// The pairs of shapes with coincident surfaces, by their numbers in the scene.
    pub coincident: Vec<Coincidence>,
    /// Why coincident surfaces were not searched, in the scene or in a group, if so.
    pub coincident_unknown: Vec<String>,
    /// Warnings.
    pub warnings: Vec<SceneError>,
    /// Build time in seconds, including reading files.
    pub build_seconds: f64,
}

/// Options of the build. They do not affect the image.
#[derive(Clone, Copy, Default)]
pub struct BuildOptions<'a> {
    /// Memory limit in bytes for meshes and accelerators, including their construction; by default
    /// the available memory.
    pub max_memory: Option<u64>,
    /// The cache for data that takes long to compute; by default none.
    pub cache: Option<Cache<'a>>,
    /// Called with the part that is about to be built.
    pub progress: Option<&'a dyn Fn(&str)>,
}

impl Pipeline {
    /// Builds the planned scene; reports all errors at once.
    pub fn build(plan: &Plan<'_, '_>, registry: &Registry) -> Result<Self, SceneErrors> {
        Self::build_with(plan, registry, BuildOptions::default())
    }

    /// Like [`Self::build`], with options.
    pub fn build_with(
        plan: &Plan<'_, '_>,
        registry: &Registry,
        options: BuildOptions<'_>,
    ) -> Result<Self, SceneErrors> {
        match Self::build_partly(plan, registry, options) {
            (Some(pipeline), errors) => errors.into_result(pipeline),
            (None, errors) => Err(errors),
        }
    }

    /// Like [`Self::build`], but returns errors together with the pipeline. There is no pipeline
    /// only if a part of it is missing.
    pub(crate) fn build_partly(
        plan: &Plan<'_, '_>,
        registry: &Registry,
        options: BuildOptions<'_>,
    ) -> (Option<Self>, SceneErrors) {
        let start = Instant::now();
        let description = plan.description;
        let mut errors = SceneErrors::default();
        let mut builder = Builder {
            description,
            registry,
            textures: BTreeMap::new(),
            looked_up: LookedUp::default(),
            materials: BTreeMap::new(),
            open: Vec::new(),
            groups: BTreeMap::new(),
            operands: Operands::default(),
            faulty_operands: BTreeSet::new(),
            used: BTreeSet::new(),
            memory: Memory::new(options.max_memory),
            options,
            warnings: Vec::new(),
            coincident: Vec::new(),
            coincident_unknown: Vec::new(),
        };
        let size = description.film.size;
        errors.take(builder.memory.take_film(&description.film));
        let camera = errors.take(builder.one::<Cameras>(&description.camera, size));
        let sampler = errors.take(builder.one::<Samplers>(&description.sampler, ()));
        let integrator = errors.take(builder.one::<Integrators>(&description.integrator, ()));

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
        let built = builder.structure(
            &description.shapes,
            &description.accelerator,
            (0, &seen),
            &mut errors,
        );
        let mut left_out = builder.unused_materials();
        left_out.extend_from_slice(&plan.left_out);
        left_out.extend(builder.unused_textures());
        if let Some(built) = &built
            && errors.0.is_empty()
        {
            let tables = &description.lights;
            left_out.extend(reach::leave_out_lights(
                tables,
                &mut lights,
                &built.geometry,
                &materials,
            ));
        }
        if let Some(integrator) = &integrator {
            left_out.extend(unused_parts(
                description,
                &lights,
                &materials,
                integrator.as_ref(),
            ));
        }
        let object_order = match (&camera, &integrator, &built) {
            (Some(camera), Some(integrator), Some(built)) => {
                let view = View {
                    geometry: &built.geometry,
                    camera: &**camera,
                    film: size,
                };
                errors.take(builder.object_order(&**integrator, &view)).flatten()
            }
            _ => None,
        };
        let (warnings, used) = (builder.warnings, builder.used);
        let (coincident, coincident_unknown) = (builder.coincident, builder.coincident_unknown);
        let groups = builder.groups.into_values().collect();
        // Drop textures that were only needed during the build.
        drop(builder.textures);
        let textures = builder.looked_up.kept(&mut left_out);
        let pipeline = match (camera, sampler, integrator, built) {
            (Some(camera), Some(sampler), Some(integrator), Some(built))
                if complete && errors.0.is_empty() =>
            {
                let mut scene = Scene::new(built.geometry, built.accelerator, materials, lights);
                scene.light_margin = built.light_margin;
                Some(Self {
                    film: description.film.clone(),
                    camera,
                    sampler,
                    integrator,
                    object_order,
                    scene,
                    scene_hash: description.flattened.hash.clone(),
                    accelerator: built.chosen,
                    groups,
                    textures,
                    used,
                    left_out,
                    coincident,
                    coincident_unknown,
                    warnings,
                    build_seconds: start.elapsed().as_secs_f64(),
                })
            }
            _ => None,
        };
        (pipeline, errors)
    }
}

/// Shapes and their accelerator.
struct Structure {
    geometry: Arc<Geometry>,
    accelerator: Box<dyn Accelerator>,
    /// The type of the accelerator, and the reason.
    chosen: (String, String),
    /// See [`Scene::light_margin`].
    light_margin: f64,
}

/// Builds plugins and the plugins that they refer to.
struct Builder<'d, 's, 'o> {
    description: &'d Description<'s>,
    registry: &'d Registry,
    /// Textures by id or place. `None` if the build failed and the error is already reported.
    textures: BTreeMap<Key, Option<Arc<dyn Texture>>>,
    /// All built textures, including pictures without a table.
    looked_up: LookedUp,
    /// Materials, like textures.
    materials: BTreeMap<Key, Option<Arc<dyn Material>>>,
    /// Textures and materials that are being built. Meeting one of them again is a cycle.
    open: Vec<(FamilyName, Key)>,
    /// The groups that are built so far, by id.
    groups: BTreeMap<&'d str, BuiltGroup>,
    operands: Operands,
    /// Inline shapes whose errors are already reported.
    faulty_operands: BTreeSet<usize>,
    used: BTreeSet<(FamilyName, &'static str)>,
    memory: Memory,
    options: BuildOptions<'o>,
    warnings: Vec<SceneError>,
    coincident: Vec<Coincidence>,
    coincident_unknown: Vec<String>,
}

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Key {
    Shared(String),
    Inline(usize),
}

impl From<&PluginRef> for Key {
    fn from(reference: &PluginRef) -> Self {
        match reference {
            PluginRef::Shared(id) => Self::Shared(id.clone()),
            PluginRef::Inline(index) => Self::Inline(*index),
        }
    }
}

impl<'d, 's> Builder<'d, 's, '_> {
    fn plugin<F: whitstone_core::Family>(
        &mut self,
        plugin: &PluginTable<'s>,
        input: F::Input<'_>,
    ) -> Result<F::Product, SceneErrors> {
        let registry = self.registry;
        let entry = registry.get(F::NAME, &plugin.name).map_err(|mut error| {
            error.span = Some(plugin.name_span.clone());
            SceneErrors::from(error)
        })?;
        self.used.insert((F::NAME, entry.name));
        let built = registry.build::<F>(&plugin.name, &plugin.table, input, self);
        built.map_err(|errors| self.and_those_of_parts(errors, plugin))
    }

    /// Adds the errors of the plugins inside a faulty plugin, so that they are not hidden.
    fn and_those_of_parts(&mut self, mut errors: SceneErrors, plugin: &PluginTable<'s>) -> SceneErrors {
        let description = self.description;
        for index in inline_plugins(&plugin.table) {
            let Some(part) = description.inline.get(index) else {
                continue;
            };
            let (span, key) = (part.table.span(), Key::Inline(index));
            let is = |family| self.registry.get(family, &part.name).is_ok();
            let found = if is(FamilyName::Texture) {
                self.shared_texture(key, &span).err()
            } else if is(FamilyName::Material) {
                self.shared_material(&PluginRef::Inline(index), &span).err()
            } else if is(FamilyName::Shape) {
                let shape = PluginRef::Inline(index);
                self.solid(&SolidRef { span, shape }, &Transform::IDENTITY).err()
            } else {
                None
            };
            for error in found.into_iter().flat_map(|found| found.0) {
                if !errors.0.contains(&error) {
                    errors.0.push(error);
                }
            }
        }
        errors
    }

    /// Builds a plugin of a single table. There is no error if the table is known to be faulty.
    fn one<F: whitstone_core::Family>(
        &mut self,
        plugin: &PluginTable<'s>,
        input: F::Input<'_>,
    ) -> Result<F::Product, SceneErrors> {
        if self.description.faulty.tables.contains(F::NAME.singular()) {
            return Err(SceneErrors::default());
        }
        self.plugin::<F>(plugin, input)
    }

    /// The material of each shape. Shared ones are built once.
    fn materials(&mut self, plan: &Plan<'d, 's>, errors: &mut SceneErrors) -> Vec<Arc<dyn Material>> {
        let mut default: Option<Arc<dyn Material>> = None;
        // An instance has no material.
        let mut materials: Vec<Option<Arc<dyn Material>>> = Vec::new();
        for shape in plan.shapes() {
            if shape.group.is_some() {
                if let Some((span, _)) = &shape.material {
                    let error = SceneError::at(span.clone(), "an instance must not have a `material`");
                    let help = "set the materials of the shapes in its group";
                    errors.0.push(error.with_help(help));
                }
                materials.push(None);
                continue;
            }
            match &shape.material {
                None => {
                    if default.is_none() {
                        default = errors.take(self.default_material(&shape.plugin));
                    }
                    materials.push(default.clone());
                }
                Some((span, reference)) => {
                    let material = self.shared_material(reference, span);
                    materials.push(errors.take(material));
                }
            }
        }
        // The material of an instance is never used, so any will do.
        let any = materials.iter().flatten().next().cloned();
        materials
            .into_iter()
            .filter_map(|material| material.or_else(|| any.clone()))
            .collect()
    }

    /// Builds the instantiated groups. Returns whether all succeeded.
    fn groups(&mut self, plan: &Plan<'d, 's>, errors: &mut SceneErrors) -> bool {
        let mut complete = true;
        for planned in &plan.groups {
            let table = &self.description.groups[planned.id];
            let seen = Seen {
                from: Vec::new(),
                lights: &[],
            };
            let first = planned.first_shape;
            match self.structure(&table.shapes, &table.accelerator, (first, &seen), errors) {
                Some(built) => {
                    let group = Group::new(built.geometry, built.accelerator, planned.first_shape);
                    let built = BuiltGroup {
                        id: planned.id.to_owned(),
                        group: Arc::new(group),
                        accelerator: built.chosen,
                    };
                    self.groups.insert(planned.id, built);
                }
                None => complete = false,
            }
        }
        complete
    }

    /// Builds the shapes and their accelerator. Returns none if any shape is missing, because the
    /// accelerator would be useless.
    fn structure(
        &mut self,
        tables: &[ShapeTable<'s>],
        accelerator: &PluginTable<'s>,
        (first_shape, seen): (u32, &Seen<'_>),
        errors: &mut SceneErrors,
    ) -> Option<Structure> {
        let mut shapes = Vec::new();
        for (shape, number) in tables.iter().zip(1..) {
            let kind = &shape.plugin.name;
            self.tell(|| format!("shape {number} of {}: {kind}", tables.len()));
            shapes.extend(errors.take(self.plugin::<Shapes>(&shape.plugin, shape.transform)));
        }
        if shapes.len() < tables.len() {
            return None;
        }
        let (geometry, light_margin) =
            self.separate_coincident(Geometry::new(shapes), tables, first_shape, seen);
        let geometry = Arc::new(geometry);
        if geometry.paths() > u64::from(u32::MAX)
            && let Some(place) = tables.iter().find_map(|shape| shape.group.as_ref())
        {
            let message = format!(
                "nested instances multiply to {:e} instances",
                geometry.paths() as f64
            );
            let error = SceneError::at(place.span.clone(), message);
            errors.0.push(
                error.with_help("at most 4294967295 are possible: nest fewer groups, or use fewer instances"),
            );
            return None;
        }
        let (name, why) = choose_accelerator(accelerator, &geometry, self.registry);
        let elements = geometry.elements().count();
        if name != BRUTE_FORCE {
            let room = self.memory.take_structure(elements);
            let at = |error: SceneError| match tables.first() {
                Some(first) => SceneErrors::from(error).or_at(&first.plugin.name_span),
                None => error.into(),
            };
            errors.take(room.map_err(at))?;
        }
        self.tell(|| format!("{name} over {elements} elements"));
        let table = PluginTable {
            name: name.clone(),
            ..accelerator.clone()
        };
        let accelerator = errors.take(self.one::<Accelerators>(&table, geometry.clone()))?;
        Some(Structure {
            geometry,
            accelerator,
            chosen: (name, why),
            light_margin,
        })
    }

    /// Separates coincident surfaces by small gaps. Returns by how much shadow rays are shortened
    /// before lights.
    fn separate_coincident(
        &mut self,
        geometry: Geometry,
        tables: &[ShapeTable<'s>],
        first_shape: u32,
        seen: &Seen<'_>,
    ) -> (Geometry, f64) {
        let rebuild = |number: usize, moved: &dyn Fn(&Transform) -> Option<Transform>| {
            let table = tables.get(number)?;
            // Warnings of the shape have already been reported.
            let warnings = self.warnings.len();
            let built = self.plugin::<Shapes>(&table.plugin, moved(&table.transform)?);
            self.warnings.truncate(warnings);
            built.ok()
        };
        let (geometry, found) = coincident::separate(geometry, seen, rebuild);
        self.coincident_unknown.extend(found.not_examined);
        let in_scene = |pair: Coincidence| Coincidence {
            shapes: pair.shapes.map(|shape| shape + first_shape),
            ..pair
        };
        self.coincident.extend(found.pairs.into_iter().map(in_scene));
        (geometry, found.light_margin)
    }

    /// The scene as an object-order method sees it. Errors are reported at the shape that it cannot
    /// show, or at its own name.
    fn object_order(
        &mut self,
        integrator: &dyn Integrator,
        view: &View<'_>,
    ) -> Result<Option<Box<dyn ObjectOrder>>, SceneErrors> {
        let description = self.description;
        let found = integrator.object_order(view, self);
        found.map_err(|Refused { shape, error }| {
            let shape = shape.and_then(|shape| description.shapes.get(shape as usize));
            let plugin = shape.map_or(&description.integrator, |shape| &shape.plugin);
            SceneErrors::from(error).or_at(&plugin.name_span)
        })
    }

    fn tell(&self, what: impl FnOnce() -> String) {
        if let Some(progress) = self.options.progress {
            progress(&what());
        }
    }

    fn default_material(&mut self, shape: &PluginTable<'s>) -> Result<Arc<dyn Material>, SceneErrors> {
        let table = Spanned::new(shape.table.span(), DeTable::new());
        self.used.insert((FamilyName::Material, "matte"));
        self.registry.build::<Materials>("matte", &table, (), self)
    }

    fn unused_materials(&self) -> Vec<Omitted> {
        self.description
            .materials
            .keys()
            .filter(|id| !self.materials.contains_key(&Key::Shared((*id).clone())))
            .map(|id| Omitted {
                what: format!("material \"{id}\""),
                why: "no shape uses it".to_owned(),
            })
            .collect()
    }

    fn unused_textures(&self) -> Vec<Omitted> {
        self.description
            .textures
            .keys()
            .filter(|id| !self.textures.contains_key(&Key::Shared((*id).clone())))
            .map(|id| Omitted {
                what: format!("texture \"{id}\""),
                why: "nothing in use refers to it".to_owned(),
            })
            .collect()
    }

    /// The texture, built on first use. The error is empty if it has already been reported.
    fn shared_texture(&mut self, key: Key, span: &SourceSpan) -> Result<Arc<dyn Texture>, SceneErrors> {
        if let Some(built) = self.textures.get(&key) {
            return built.clone().ok_or_else(SceneErrors::default);
        }
        let description = self.description;
        let result = self.nested::<Textures>(&key, &description.textures, span)?;
        if let Ok(built) = &result {
            let (id, table) = match &key {
                Key::Shared(id) => (Some(&**id), description.textures.get(id)),
                Key::Inline(index) => (None, description.inline.get(*index)),
            };
            if let Some(table) = table {
                self.looked_up.add(id, &table.name, built);
            }
        }
        self.textures.insert(key, result.as_ref().ok().cloned());
        result
    }

    /// The material, built on first use. The error is empty if it has already been reported.
    fn shared_material(
        &mut self,
        reference: &PluginRef,
        span: &SourceSpan,
    ) -> Result<Arc<dyn Material>, SceneErrors> {
        let key = Key::from(reference);
        if let Some(built) = self.materials.get(&key) {
            return built.clone().ok_or_else(SceneErrors::default);
        }
        let result = self.nested::<Materials>(&key, &self.description.materials, span)?;
        self.materials.insert(key, result.as_ref().ok().cloned());
        result
    }

    /// Builds a plugin that another one may name as a part. The outer error is one of the
    /// reference, the inner one an error of the plugin.
    #[allow(clippy::type_complexity, reason = "two kinds of errors")]
    fn nested<F>(
        &mut self,
        key: &Key,
        shared: &'d BTreeMap<String, PluginTable<'s>>,
        span: &SourceSpan,
    ) -> Result<Result<F::Product, SceneErrors>, SceneErrors>
    where
        F: for<'a> whitstone_core::Family<Input<'a> = ()>,
    {
        let family = F::NAME.singular();
        let entry = (F::NAME, key.clone());
        if self.open.contains(&entry) {
            return Err(SceneError::at(span.clone(), format!("this {family} refers to itself")).into());
        }
        if self.open.len() == MAX_NESTING {
            let message = format!("{family}s are nested more than {MAX_NESTING} deep");
            return Err(SceneError::at(span.clone(), message).into());
        }
        let description = self.description;
        let plugin = match key {
            Key::Inline(index) => description.inline.get(*index),
            Key::Shared(id) => shared.get(id),
        };
        let Some(plugin) = plugin else {
            let Key::Shared(id) = key else {
                return Err(SceneErrors::default());
            };
            if description.faulty.shared.contains(&(family, id.clone())) {
                return Err(SceneErrors::default());
            }
            return Err(unknown_id(family, span, id, shared.keys()).into());
        };
        self.open.push(entry);
        let result = self.plugin::<F>(plugin, ());
        self.open.pop();
        Ok(result)
    }
}

impl Context for Builder<'_, '_, '_> {
    fn texture(&mut self, reference: &TextureRef) -> Result<ColorSource, SceneErrors> {
        let span = reference.span.clone().unwrap_or(0..0);
        let key = match &reference.value {
            TextureValue::Constant(color) => return Ok(ColorSource::Constant(*color)),
            TextureValue::Plugin(reference) => Key::from(reference),
        };
        let texture = self.shared_texture(key, &span)?;
        Ok(match texture.constant() {
            Some(color) => ColorSource::Constant(color),
            None => ColorSource::Texture(texture),
        })
    }

    fn material(&mut self, reference: &MaterialRef) -> Result<Arc<dyn Material>, SceneErrors> {
        let material = self.shared_material(&reference.material, &reference.span)?;
        if material.prioritized().is_some() {
            let message = "a material with a priority must belong to a shape, not to another material";
            return Err(SceneError::at(reference.span.clone(), message).into());
        }
        Ok(material)
    }

    fn file(&self, file: &FilePath) -> Result<PathBuf, SceneError> {
        let sources = self.description.sources;
        let path = sources
            .base()
            .join(sources.relative_to_base(&file.span, &file.path));
        let fail = |why: String| {
            let error = SceneError::at(file.span.clone(), format!("cannot read \"{}\": {why}", file.path));
            Err(error.with_help(format!("looked for {}", path.display())))
        };
        match std::fs::metadata(&path) {
            Err(error) => fail(error.to_string()),
            Ok(metadata) if !metadata.is_file() => fail("not a regular file".to_owned()),
            Ok(_) => Ok(path),
        }
    }

    fn image(&mut self, file: &FilePath) -> Result<Arc<dyn Texture>, SceneErrors> {
        let table = PluginTable::of_file("image", file, &[("wrap", "clamp")]);
        let built = self.plugin::<Textures>(&table, ())?;
        self.looked_up.add(None, &table.name, &built);
        Ok(built)
    }

    fn triangles(&mut self, file: &FilePath, transform: &Transform) -> Result<TriangleMesh, SceneErrors> {
        match self.plugin::<Shapes>(&PluginTable::of_file("mesh", file, &[]), *transform)? {
            LoweredShape::Triangles(mesh) => Ok(mesh),
            _ => Err(SceneError::at(file.span.clone(), "expected a triangle mesh").into()),
        }
    }

    fn group(&self, group: &GroupRef) -> Result<Arc<Group>, SceneErrors> {
        // The planning or build step has already reported why one is missing.
        let found = self.groups.get(group.id.as_str());
        found
            .map(|built| built.group.clone())
            .ok_or_else(SceneErrors::default)
    }

    fn solid(&mut self, operand: &SolidRef, around: &Transform) -> Result<Box<dyn Shape>, SceneErrors> {
        let description = self.description;
        let table = match &operand.shape {
            PluginRef::Inline(index) => (index, description.inline.get(*index)),
            PluginRef::Shared(_) => return Err(operands::no_id(operand).into()),
        };
        // Tables that could not be read have already been reported.
        let (index, Some(table)) = table else {
            return Err(SceneErrors::default());
        };
        if self.faulty_operands.contains(index) {
            return Err(SceneErrors::default());
        }
        let (plugin, transform) = self.operands.enter(table, operand, around)?;
        let built = self.plugin::<Shapes>(&plugin, transform);
        self.operands.spawn_origin();
        let shape = built.inspect_err(|_| {
            self.faulty_operands.insert(*index);
        })?;
        if let LoweredShape::Triangles(mesh) = &shape {
            self.memory.take(ClosedMesh::bytes(mesh))?;
        }
        operands::solid(shape, &plugin)
    }

    fn reserve(&mut self, bytes: u64) -> Result<(), SceneErrors> {
        Ok(self.memory.take(bytes)?)
    }

    fn cached(&self, parts: &[&[u8]], length: usize) -> Option<Vec<u8>> {
        self.options.cache?.cached(parts, length)
    }

    fn cache(&mut self, parts: &[&[u8]], made: &[u8]) {
        if let Some(cache) = self.options.cache {
            cache.cache(parts, made);
        }
    }

    fn warn(&mut self, warning: SceneError) {
        self.warnings.push(warning);
    }
}
