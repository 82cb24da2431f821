//! Builds the plugins of a scene and the plugins that they refer to.

use crate::cache::Cache;
use crate::coincident::{self, Coincidence, Seen};
use crate::memory::Memory;
use crate::operands::Operands;
use crate::render::Region;
use crate::shared::Shared;
use crate::unused::LookedUp;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use toml::Spanned;
use toml::de::DeTable;
use whitstone_core::config::{PluginRef, SolidRef, inline_plugins};
use whitstone_core::{
    Accelerator, Accelerators, Family, FamilyName, Geometry, Group, Integrator, LoweredShape, Material,
    Materials, ObjectOrder, Refused, Registry, Resources, SceneError, SceneErrors, Shapes, SourceSpan,
    Texture, Textures, Transform, View,
};
use whitstone_scene::{AUTO, Description, Omitted, Plan, PluginTable, ShapeTable, unknown_id};

/// Maximum nesting of materials: each hit evaluates all of them.
const MAX_NESTING: usize = 16;

/// A built group.
pub struct BuiltGroup {
    /// The id, as in `[group.ID]`.
    pub id: String,
    /// Its shapes and their accelerator.
    pub group: Arc<Group>,
    /// The accelerator in use, and the reason if the scene leaves the choice.
    pub accelerator: (String, String),
}

/// Options of the build. They do not affect the image.
#[derive(Clone, Copy, Default)]
pub struct BuildOptions<'a> {
    /// Memory limit in bytes for meshes and accelerators, including their construction; by default
    /// the available memory.
    pub max_memory: Option<u64>,
    /// Maximum number of rays into which a camera ray may branch; by default that of
    /// [`whitstone_core::TreeLimits`].
    pub max_tree_rays: Option<u32>,
    /// The cache for data that takes long to compute; by default none.
    pub cache: Option<Cache<'a>>,
    /// Contents of files that earlier builds have read; by default none.
    pub shared: Option<&'a Shared>,
    /// Called with the part that is about to be built.
    pub progress: Option<&'a dyn Fn(&str)>,
    /// The part of the image that will be rendered, if not all of it: memory is reserved for it
    /// alone.
    pub region: Option<Region>,
    /// Whether one image is all that will be rendered: an accelerator may then weigh its own build
    /// time against that of the rays. By default many rays are expected.
    pub single_image: bool,
}

/// Shapes and their accelerator.
pub(crate) struct Structure {
    pub(crate) geometry: Arc<Geometry>,
    pub(crate) accelerator: Box<dyn Accelerator>,
    /// The type of the accelerator, and the reason.
    pub(crate) chosen: (String, String),
    /// See [`Scene::light_margin`].
    pub(crate) light_margin: f64,
}

/// Builds plugins and the plugins that they refer to.
pub(crate) struct Builder<'d, 's, 'o> {
    pub(crate) description: &'d Description<'s>,
    pub(crate) registry: &'d Registry,
    /// Textures by id or place. `None` if the build failed and the error is already reported.
    pub(crate) textures: BTreeMap<Key, Option<Arc<dyn Texture>>>,
    /// All built textures, including pictures without a table.
    pub(crate) looked_up: LookedUp,
    /// Materials, like textures.
    pub(crate) materials: BTreeMap<Key, Option<Arc<dyn Material>>>,
    /// Textures and materials that are being built. Meeting one of them again is a cycle.
    pub(crate) open: Vec<(FamilyName, Key)>,
    /// The groups that are built so far, by id.
    pub(crate) groups: BTreeMap<&'d str, BuiltGroup>,
    pub(crate) operands: Operands,
    /// Inline shapes whose errors are already reported.
    pub(crate) faulty_operands: BTreeSet<usize>,
    pub(crate) used: BTreeSet<(FamilyName, &'static str)>,
    /// See [`Storage::share`](whitstone_core::Storage::share); for a build that has no
    /// [`BuildOptions::shared`].
    pub(crate) shared: Shared,
    pub(crate) memory: Memory,
    pub(crate) options: BuildOptions<'o>,
    pub(crate) warnings: Vec<SceneError>,
    pub(crate) coincident: Vec<Coincidence>,
    pub(crate) coincident_unknown: Vec<String>,
    /// See [`Resources::expected_rays`].
    pub(crate) expected_rays: Option<u64>,
}

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Key {
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

impl<'d, 's, 'o> Builder<'d, 's, 'o> {
    pub(crate) fn new(
        description: &'d Description<'s>,
        registry: &'d Registry,
        options: BuildOptions<'o>,
    ) -> Self {
        Self {
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
            shared: Shared::default(),
            memory: Memory::new(options.max_memory),
            options,
            warnings: Vec::new(),
            coincident: Vec::new(),
            coincident_unknown: Vec::new(),
            expected_rays: None,
        }
    }

    pub(crate) fn plugin<F: Family>(
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
    pub(crate) fn one<F: Family>(
        &mut self,
        plugin: &PluginTable<'s>,
        input: F::Input<'_>,
    ) -> Result<F::Product, SceneErrors> {
        if self.description.faulty.tables.contains(F::NAME.singular()) {
            return Err(SceneErrors::default());
        }
        self.plugin::<F>(plugin, input)
    }

    /// The material of each shape and of each variant. Shared ones are built once.
    pub(crate) fn materials(
        &mut self,
        plan: &Plan<'d, 's>,
        errors: &mut SceneErrors,
    ) -> Vec<Arc<dyn Material>> {
        let mut default: Option<Arc<dyn Material>> = None;
        // An instance has no material.
        let mut materials: Vec<Option<Arc<dyn Material>>> = Vec::new();
        for shape in &plan.appearances.all {
            if shape.table.group.is_some() {
                if let Some((span, _)) = &shape.material {
                    let error = SceneError::at(span.clone(), "an instance must not have a `material`");
                    let help = "set the materials of the shapes in its group, or replace them by `materials`";
                    errors.0.push(error.with_help(help));
                }
                for replaced in &shape.table.materials {
                    let (span, reference) = &replaced.by;
                    errors.take(self.shared_material(reference, span));
                }
                materials.push(None);
                continue;
            }
            match &shape.material {
                None => {
                    if default.is_none() {
                        default = errors.take(self.default_material(&shape.table.plugin));
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
    pub(crate) fn groups(&mut self, plan: &Plan<'d, 's>, errors: &mut SceneErrors) -> bool {
        let mut complete = true;
        for planned in &plan.groups {
            let table = &self.description.groups[planned.id];
            let seen = Seen {
                from: Vec::new(),
                lights: &[],
            };
            let first = planned.first_shape;
            match self.structure(plan, (&table.shapes, &table.accelerator), (first, &seen), errors) {
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
    pub(crate) fn structure(
        &mut self,
        plan: &Plan<'d, 's>,
        (tables, accelerator): (&[ShapeTable<'s>], &PluginTable<'s>),
        (first_shape, seen): (u32, &Seen<'_>),
        errors: &mut SceneErrors,
    ) -> Option<Structure> {
        let mut shapes = Vec::new();
        for (shape, number) in tables.iter().zip(0..) {
            let kind = &shape.plugin.name;
            self.tell(|| format!("shape {} of {}: {kind}", number + 1, tables.len()));
            let mut built = errors.take(self.plugin::<Shapes>(&shape.plugin, shape.transform));
            let variants = plan.appearances.of_instances.get(&(first_shape + number));
            if let (Some(LoweredShape::Instance(instance)), Some(variants)) = (&mut built, variants) {
                instance.set_variants(variants.clone());
            }
            shapes.extend(built);
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
        let (name, why) = if accelerator.name == AUTO {
            errors.take(self.registry.automatic_accelerator(&geometry))?
        } else {
            (accelerator.name.clone(), "named by the scene".to_owned())
        };
        let elements = geometry.elements().count();
        let room = self.memory.take_structure(elements);
        let at = |error: SceneError| match tables.first() {
            Some(first) => SceneErrors::from(error).or_at(&first.plugin.name_span),
            None => error.into(),
        };
        errors.take(room.map_err(at))?;
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
    pub(crate) fn object_order(
        &mut self,
        integrator: &dyn Integrator,
        table: &PluginTable<'s>,
        view: &View<'_>,
    ) -> Result<Option<Box<dyn ObjectOrder>>, SceneErrors> {
        let description = self.description;
        let found = integrator.object_order(view, self);
        found.map_err(|Refused { shape, error }| {
            let shape = shape.and_then(|shape| description.shapes.get(shape as usize));
            let plugin = shape.map_or(table, |shape| &shape.plugin);
            SceneErrors::from(error).or_at(&plugin.name_span)
        })
    }

    fn tell(&self, what: impl FnOnce() -> String) {
        if let Some(progress) = self.options.progress {
            progress(&what());
        }
    }

    fn default_material(&mut self, shape: &PluginTable<'s>) -> Result<Arc<dyn Material>, SceneErrors> {
        let table = PluginTable {
            table: Spanned::new(shape.table.span(), DeTable::new()),
            ..PluginTable::named(self.registry.default_type(FamilyName::Material)?)
        };
        self.plugin::<Materials>(&table, ())
    }

    pub(crate) fn unused_materials(&self) -> Vec<Omitted> {
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

    pub(crate) fn unused_textures(&self) -> Vec<Omitted> {
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
    pub(crate) fn shared_texture(
        &mut self,
        key: Key,
        span: &SourceSpan,
    ) -> Result<Arc<dyn Texture>, SceneErrors> {
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
    pub(crate) fn shared_material(
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
        F: for<'a> Family<Input<'a> = ()>,
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
