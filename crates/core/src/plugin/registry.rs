use crate::config::{self, Table};
use crate::{
    Accelerator, Camera, Context, DuplicateType, FilmSize, Geometry, Integrator, Light, LoweredShape,
    Material, Sampler, SceneError, SceneErrors, SceneFormat, Texture, Transform, nearest,
};
use schemars::JsonSchema;
#[cfg(feature = "schema")]
use schemars::{Schema, SchemaGenerator};
use serde::de::DeserializeOwned;
use std::any::Any;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// A kind of plugin: the type that it builds and the input that it receives besides its parameters.
pub trait Family: 'static {
    /// The name, as in "unknown shape type".
    const NAME: FamilyName;
    /// What a plugin of the family builds.
    type Product;
    /// The input besides the configuration.
    type Input<'a>;
}

/// The plugin families.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FamilyName {
    /// Cameras.
    Camera,
    /// Shapes.
    Shape,
    /// Accelerators.
    Accelerator,
    /// Materials.
    Material,
    /// Textures.
    Texture,
    /// Lights.
    Light,
    /// Samplers.
    Sampler,
    /// Integrators.
    Integrator,
}

impl FamilyName {
    /// All families, in the order of the documentation.
    pub const ALL: [Self; 8] = [
        Self::Camera,
        Self::Shape,
        Self::Accelerator,
        Self::Material,
        Self::Texture,
        Self::Light,
        Self::Sampler,
        Self::Integrator,
    ];

    /// The singular, as in messages and as the name of the TOML table.
    pub const fn singular(self) -> &'static str {
        match self {
            Self::Camera => "camera",
            Self::Shape => "shape",
            Self::Accelerator => "accelerator",
            Self::Material => "material",
            Self::Texture => "texture",
            Self::Light => "light",
            Self::Sampler => "sampler",
            Self::Integrator => "integrator",
        }
    }

    /// The plural, as in the name of the crate's folder.
    pub const fn plural(self) -> &'static str {
        match self {
            Self::Camera => "cameras",
            Self::Shape => "shapes",
            Self::Accelerator => "accelerators",
            Self::Material => "materials",
            Self::Texture => "textures",
            Self::Light => "lights",
            Self::Sampler => "samplers",
            Self::Integrator => "integrators",
        }
    }
}

macro_rules! families {
    ($($(#[$doc:meta])* $family:ident = $name:ident, $product:ty, $input:ty;)*) => {$(
        $(#[$doc])*
        pub enum $family {}

        impl Family for $family {
            const NAME: FamilyName = FamilyName::$name;
            type Product = $product;
            type Input<'a> = $input;
        }
    )*};
}

families! {
    /// Cameras receive the image size.
    Cameras = Camera, Box<dyn Camera>, FilmSize;
    /// Shapes receive their `world_from_object` transform.
    Shapes = Shape, LoweredShape, Transform;
    /// Accelerators are built over the whole geometry.
    Accelerators = Accelerator, Box<dyn Accelerator>, Arc<Geometry>;
    /// Materials are shared by shapes.
    Materials = Material, Arc<dyn Material>, ();
    /// Textures are shared by materials.
    Textures = Texture, Arc<dyn Texture>, ();
    /// Lights.
    Lights = Light, Arc<dyn Light>, ();
    /// Samplers.
    Samplers = Sampler, Box<dyn Sampler>, ();
    /// Integrators.
    Integrators = Integrator, Box<dyn Integrator>, ();
}

/// A plugin: a type that a scene can name.
pub trait Plugin<F: Family> {
    /// The TOML `type`; also the stem of its file, its Cargo feature and its example scene.
    const TYPE: &'static str;
    /// Its parameters. The first paragraph of the documentation is the summary that `whitstone
    /// list` prints.
    type Config: DeserializeOwned + JsonSchema;

    /// Builds the product. Errors without a position are reported at the plugin's table.
    fn build(
        config: Self::Config,
        input: F::Input<'_>,
        context: &mut dyn Context,
    ) -> Result<F::Product, SceneErrors>;
}

type BuildFn<F> = for<'a> fn(
    &Table<'_>,
    <F as Family>::Input<'a>,
    &mut dyn Context,
) -> Result<<F as Family>::Product, SceneErrors>;

/// A registered plugin. It builds nothing until a scene names it.
pub struct Entry {
    /// Its family.
    pub family: FamilyName,
    /// Its TOML `type`.
    pub name: &'static str,
    /// The crate that registered it.
    pub crate_name: &'static str,
    #[cfg(feature = "schema")]
    schema: fn() -> Schema,
    /// A `BuildFn` of the family; `build` downcasts it.
    build: Box<dyn Any + Send + Sync>,
}

#[cfg(feature = "schema")]
impl Entry {
    /// JSON Schema of its parameters, without `type` and the keys that all plugins of the family
    /// have.
    pub fn schema(&self) -> Schema {
        (self.schema)()
    }

    /// First paragraph of the documentation of its parameters.
    pub fn summary(&self) -> String {
        let schema = self.schema();
        let text = schema.get("description").and_then(|d| d.as_str());
        let first_paragraph = text.unwrap_or_default().split("\n\n").next();
        first_paragraph.unwrap_or_default().replace('\n', " ")
    }
}

/// The plugins that a scene can name. Registration is explicit: every crate of plugins, third-party
/// ones included, has a `register` function.
#[derive(Default)]
pub struct Registry {
    /// By family and type.
    entries: BTreeMap<FamilyName, BTreeMap<&'static str, Entry>>,
    /// Plugins missing from a slim binary: family, type and crate.
    absent: &'static [(FamilyName, &'static str, &'static str)],
    twins: Vec<Twin>,
    defaults: BTreeMap<FamilyName, &'static str>,
    automatic: Option<AutomaticAccelerator>,
    formats: Vec<Box<dyn SceneFormat>>,
}

/// Chooses the accelerator of a scene that leaves the choice: a registered type, and the reason.
pub type AutomaticAccelerator = fn(&Geometry, &Registry) -> (String, String);

/// The reference implementation of a third-party plugin, in the language of a reference renderer's
/// driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Twin {
    /// The reference, such as `mitsuba`.
    pub reference: &'static str,
    /// File name for the source text.
    pub file: &'static str,
    /// The source text, in the language of the reference's driver.
    pub text: &'static str,
}

impl Registry {
    /// Adds a plugin of the crate `crate_name` (`env!("CARGO_PKG_NAME")`).
    pub fn add<F: Family, P: Plugin<F>>(&mut self, crate_name: &'static str) -> Result<(), DuplicateType> {
        let entry = Entry {
            family: F::NAME,
            name: P::TYPE,
            crate_name,
            #[cfg(feature = "schema")]
            schema: || SchemaGenerator::default().into_root_schema_for::<P::Config>(),
            build: Box::new(build_plugin::<F, P> as BuildFn<F>),
        };
        match self.entries.entry(F::NAME).or_default().insert(P::TYPE, entry) {
            None => Ok(()),
            Some(first) => Err(DuplicateType {
                family: F::NAME.singular(),
                name: P::TYPE,
                first: first.crate_name,
                second: crate_name,
            }),
        }
    }

    /// Declares the plugins that this binary was built without, as family, type and crate. The
    /// error about a scene that names one uses them.
    pub fn omit(&mut self, absent: &'static [(FamilyName, &'static str, &'static str)]) {
        self.absent = absent;
    }

    /// Declares the type that a scene uses without naming it: the sampler or integrator of a scene
    /// without one, the material of a shape without one, the accelerator, and the texture or shape
    /// that reads an image or mesh file for another plugin.
    pub fn set_default(&mut self, family: FamilyName, name: &'static str) {
        self.defaults.insert(family, name);
    }

    /// The type of a family that a scene uses without naming it; see [`Self::set_default`].
    pub fn default_type(&self, family: FamilyName) -> Result<&'static str, SceneErrors> {
        let found = self.defaults.get(&family).copied();
        found.ok_or_else(|| {
            let error =
                SceneError::anywhere(format!("this program has no default {} type", family.singular()));
            let help = format!("rebuild it with the features of `whitstone-{}`", family.plural());
            error.with_help(help).into()
        })
    }

    /// Declares the rule that chooses the accelerator of a scene that leaves the choice.
    pub fn set_automatic_accelerator(&mut self, choose: AutomaticAccelerator) {
        self.automatic = Some(choose);
    }

    /// The accelerator for a scene that leaves the choice: its type, and the reason.
    pub fn automatic_accelerator(&self, geometry: &Geometry) -> Result<(String, String), SceneErrors> {
        match self.automatic {
            Some(choose) => Ok(choose(geometry, self)),
            None => Ok((
                self.default_type(FamilyName::Accelerator)?.to_owned(),
                "the default of this program".to_owned(),
            )),
        }
    }

    /// Adds the reference implementation (twin) of a third-party plugin, so that its scenes can be
    /// validated. For `mitsuba` it is a Python file in the form that
    /// `references/mitsuba/whitstone_mitsuba/twins.py` describes.
    pub fn add_twin(&mut self, reference: &'static str, file: &'static str, text: &'static str) {
        self.twins.push(Twin {
            reference,
            file,
            text,
        });
    }

    /// The twins of third-party plugins for a reference.
    pub fn twins(&self, reference: &str) -> impl Iterator<Item = &Twin> {
        self.twins.iter().filter(move |twin| twin.reference == reference)
    }

    /// Adds a format of scene files.
    pub fn add_format(&mut self, format: impl SceneFormat + 'static) {
        self.formats.push(Box::new(format));
    }

    /// The formats of scene files other than TOML, in the order in which they were added.
    pub fn formats(&self) -> impl Iterator<Item = &dyn SceneFormat> {
        self.formats.iter().map(|format| &**format)
    }

    /// The format of files with the extension of this path.
    pub fn format_of(&self, path: &Path) -> Option<&dyn SceneFormat> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        self.formats()
            .find(|format| format.extensions().contains(&extension.as_str()))
    }

    /// All plugins, sorted by family and name.
    pub fn entries(&self) -> impl Iterator<Item = &Entry> {
        self.entries.values().flat_map(BTreeMap::values)
    }

    /// The plugin of a type. The error names the nearest type, or else all types; for a type that
    /// this binary was built without, its feature. It has no position.
    pub fn get(&self, family: FamilyName, name: &str) -> Result<&Entry, SceneError> {
        if let Some(entry) = self.entries.get(&family).and_then(|entries| entries.get(name)) {
            return Ok(entry);
        }
        let known: Vec<&str> = self
            .entries()
            .filter(|entry| entry.family == family)
            .map(|entry| entry.name)
            .collect();
        let kind = family.singular();
        if let Some((_, _, from)) = self.absent.iter().find(|(f, n, _)| *f == family && *n == name) {
            let error = SceneError::anywhere(format!(
                "this program was built without the {kind} type \"{name}\""
            ));
            return Err(error.with_help(format!(
                "enable the feature `{name}` of `{from}` in its package, or rebuild it with `cargo xtask slim SCENE`"
            )));
        }
        let error = SceneError::anywhere(format!("unknown {kind} type \"{name}\""));
        Err(error.with_help(match nearest(name, known.iter().copied()) {
            Some(near) => format!("did you mean \"{near}\"?"),
            None if known.is_empty() => format!(
                "this program was built without any {kind} type; rebuild it with the features of `whitstone-{}`",
                family.plural()
            ),
            None => format!("known {kind} types are {}", known.join(", ")),
        }))
    }

    /// Builds the plugin of a type from its table.
    pub fn build<F: Family>(
        &self,
        name: &str,
        table: &Table<'_>,
        input: F::Input<'_>,
        context: &mut dyn Context,
    ) -> Result<F::Product, SceneErrors> {
        let entry = self.get(F::NAME, name)?;
        let build = entry
            .build
            .downcast_ref::<BuildFn<F>>()
            .expect("`add` stores the build function of the entry's own family");
        build(table, input, context).map_err(|errors| errors.or_at(&table.span()))
    }
}

fn build_plugin<F: Family, P: Plugin<F>>(
    table: &Table<'_>,
    input: F::Input<'_>,
    context: &mut dyn Context,
) -> Result<F::Product, SceneErrors> {
    P::build(config::decode(table)?, input, context)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{FilePath, TextureRef};
    use crate::{ColorSource, Diagnostics, Resources, Storage};
    use glam::DVec2;
    use std::path::PathBuf;
    use toml::de::DeTable;

    struct Dot;

    /// One sample in a corner.
    #[derive(serde::Deserialize, JsonSchema)]
    #[serde(deny_unknown_fields)]
    struct Config {}

    impl Sampler for Dot {
        fn count(&self) -> u32 {
            1
        }
        fn position(&self, _: [u32; 2], _: u32) -> DVec2 {
            DVec2::ZERO
        }
    }

    impl Plugin<Samplers> for Dot {
        const TYPE: &'static str = "dot";
        type Config = Config;
        fn build(_: Config, (): (), _: &mut dyn Context) -> Result<Box<dyn Sampler>, SceneErrors> {
            Ok(Box::new(Self))
        }
    }

    struct NoContext;

    impl Resources for NoContext {
        fn texture(&mut self, _: &TextureRef) -> Result<ColorSource, SceneErrors> {
            Err(SceneError::anywhere("textures are not available here").into())
        }
        fn file(&self, _: &FilePath) -> Result<PathBuf, SceneError> {
            Err(SceneError::anywhere("files are not available here"))
        }
    }

    impl Storage for NoContext {}

    impl Diagnostics for NoContext {
        fn warn(&mut self, _: SceneError) {}
    }

    #[test]
    fn a_plugin_is_found_by_its_type_and_only_once() {
        let mut registry = Registry::default();
        registry.add::<Samplers, Dot>("one").unwrap();
        let again = registry.add::<Samplers, Dot>("two").unwrap_err();
        assert_eq!((again.first, again.second), ("one", "two"));

        let table = DeTable::parse("").unwrap();
        let sampler = registry
            .build::<Samplers>("dot", &table, (), &mut NoContext)
            .unwrap();
        assert_eq!(sampler.count(), 1);
        let unknown = registry.build::<Samplers>("dott", &table, (), &mut NoContext);
        let error = unknown.err().unwrap().0.remove(0);
        assert_eq!(error.help.as_deref(), Some("did you mean \"dot\"?"));
        #[cfg(feature = "schema")]
        assert_eq!(
            registry.entries().next().unwrap().summary(),
            "One sample in a corner."
        );
    }

    #[test]
    fn the_error_about_an_absent_plugin_names_its_feature() {
        let mut registry = Registry::default();
        registry.add::<Samplers, Dot>("one").unwrap();
        registry.omit(&[(FamilyName::Sampler, "line", "two")]);
        let error = registry.get(FamilyName::Sampler, "line").err().unwrap();
        assert!(error.message.contains("built without the sampler type \"line\""));
        assert!(error.help.unwrap().contains("the feature `line` of `two`"));
        // Another family does not have this type.
        let error = registry.get(FamilyName::Shape, "line").err().unwrap();
        assert!(error.message.contains("unknown shape type"));
    }

    #[test]
    fn unknown_keys_are_rejected_with_their_position() {
        let mut registry = Registry::default();
        registry.add::<Samplers, Dot>("one").unwrap();
        let table = DeTable::parse("seed = 3").unwrap();
        let result = registry.build::<Samplers>("dot", &table, (), &mut NoContext);
        let error = result.err().unwrap().0.remove(0);
        assert_eq!(error.span, Some(0..4));
        assert_eq!(error.message, "unknown key `seed`");
    }
}
