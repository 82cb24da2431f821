use crate::config::{self, FilePath, GroupRef, MaterialRef, SolidRef, Table, TextureRef};
use crate::{
    Accelerator, Camera, ColorSource, DuplicateType, FilmSize, Geometry, Group, Integrator, Light, Material,
    Primitive, Sampler, SceneError, SceneErrors, Shape, Texture, Transform, TriangleMesh, nearest,
};
use schemars::JsonSchema;
#[cfg(feature = "schema")]
use schemars::{Schema, SchemaGenerator};
use serde::de::DeserializeOwned;
use std::any::Any;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// A kind of plugin: what it makes, and what it is given besides its own parameters.
pub trait Family: 'static {
    /// The name, as in "unknown shape type".
    const NAME: FamilyName;
    /// What a plugin of the family builds.
    type Product;
    /// What it builds from besides its configuration.
    type Input<'a>;
}

/// The families by name.
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
    /// All of them, in the order of the documentation.
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

    /// In singular, as in messages and as the TOML table.
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

    /// In plural, as the crate's folder is called.
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
    /// Cameras know the size of the image.
    Cameras = Camera, Box<dyn Camera>, FilmSize;
    /// Shapes know where they stand: `world_from_object`.
    Shapes = Shape, Shape, Transform;
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

/// One plugin: a type that can be named in a scene.
pub trait Plugin<F: Family> {
    /// The TOML `type`; also the stem of its file, its Cargo feature and its example scene.
    const TYPE: &'static str;
    /// Its parameters. The first line of its documentation is the one-line summary in
    /// `whitstone list`.
    type Config: DeserializeOwned + JsonSchema;

    /// Builds it. Errors without a place are shown at the plugin's table.
    fn build(
        config: Self::Config,
        input: F::Input<'_>,
        context: &mut dyn Context,
    ) -> Result<F::Product, SceneErrors>;
}

/// What a plugin may ask of the scene while it is built.
pub trait Context {
    /// The texture or constant that a parameter names. Built once, however often it is named.
    fn texture(&mut self, reference: &TextureRef) -> Result<ColorSource, SceneErrors>;

    /// The material that is a part of another one. Built once if it is shared; one that contains
    /// itself is an error.
    fn material(&mut self, reference: &MaterialRef) -> Result<Arc<dyn Material>, SceneErrors> {
        Err(SceneError::at(reference.span.clone(), "no materials here").into())
    }

    /// The path of a file that a parameter names; the file exists and is a regular file.
    fn file(&self, file: &FilePath) -> Result<PathBuf, SceneError>;

    /// The picture in a file: what the texture `image` makes of it with its border around it, with
    /// its errors at the file.
    fn picture(&mut self, file: &FilePath) -> Result<Arc<dyn Texture>, SceneErrors> {
        Err(SceneError::at(file.span.clone(), "no pictures here").into())
    }

    /// The triangles of a mesh file where they stand: what the shape `mesh` makes of it, with its
    /// errors at the file.
    fn triangles(&mut self, file: &FilePath, transform: &Transform) -> Result<TriangleMesh, SceneErrors> {
        let _ = transform;
        Err(SceneError::at(file.span.clone(), "no meshes here").into())
    }

    /// The group of shapes that a parameter names. Built once, however often it is placed.
    fn group(&self, group: &GroupRef) -> Result<Arc<Group>, SceneErrors> {
        Err(group.no_groups().into())
    }

    /// The solid that is an operand of a shape which stands at `around`: the operand's own
    /// transform comes before it. What bounds no volume is an error at the operand.
    fn solid(&mut self, operand: &SolidRef, around: &Transform) -> Result<Box<dyn Primitive>, SceneErrors> {
        let _ = around;
        Err(SceneError::at(operand.span.clone(), "no operands here").into())
    }

    /// Says before so many bytes are allocated that they will be: an error where the scene may not
    /// have them. What grows with a number in the scene or with a file asks; what is small need
    /// not.
    fn reserve(&mut self, bytes: u64) -> Result<(), SceneErrors> {
        let _ = bytes;
        Ok(())
    }

    /// What was kept of these parts, if it is so many bytes. The parts are all that it is made
    /// from, and a name with a version.
    fn recall(&self, parts: &[&[u8]], length: usize) -> Option<Vec<u8>> {
        let _ = (parts, length);
        None
    }

    /// Keeps what was made of these parts for later runs, if anything is kept at all: for what
    /// takes longer to make than to read.
    fn keep(&mut self, parts: &[&[u8]], made: &[u8]) {
        let _ = (parts, made);
    }

    /// Tells the user something that is no error.
    fn warn(&mut self, warning: SceneError);
}

type BuildFn<F> = for<'a> fn(
    &Table<'_>,
    <F as Family>::Input<'a>,
    &mut dyn Context,
) -> Result<<F as Family>::Product, SceneErrors>;

/// What the registry knows of a plugin. Nothing is built until a scene names it.
pub struct Entry {
    /// Its family.
    pub family: FamilyName,
    /// Its TOML `type`.
    pub name: &'static str,
    /// The crate that registered it.
    pub crate_name: &'static str,
    #[cfg(feature = "schema")]
    schema: fn() -> Schema,
    /// A `BuildFn` of the family, which `build` downcasts again.
    build: Box<dyn Any + Send + Sync>,
}

#[cfg(feature = "schema")]
impl Entry {
    /// JSON Schema of its parameters, without `type` and the keys common to the family.
    pub fn schema(&self) -> Schema {
        (self.schema)()
    }

    /// First line of the documentation of its parameters.
    pub fn summary(&self) -> String {
        let schema = self.schema();
        let text = schema.get("description").and_then(|d| d.as_str());
        let first_paragraph = text.unwrap_or_default().split("\n\n").next();
        first_paragraph.unwrap_or_default().replace('\n', " ")
    }
}

/// The plugins that can be named in a scene. Registration is explicit: every family crate has a
/// `register` function, and a third party's crate has its own.
#[derive(Default)]
pub struct Registry {
    entries: BTreeMap<(FamilyName, &'static str), Entry>,
    /// Of slim binaries: family, type and crate.
    absent: &'static [(FamilyName, &'static str, &'static str)],
    twins: Vec<Twin>,
}

/// What a reference renderer needs to render a plugin from outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Twin {
    /// The reference, such as `mitsuba`.
    pub reference: &'static str,
    /// A file name for the text.
    pub file: &'static str,
    /// The text, in the language of the reference's driver.
    pub text: &'static str,
}

impl Registry {
    /// Adds a plugin, on behalf of the crate `crate_name` (`env!("CARGO_PKG_NAME")`).
    pub fn add<F: Family, P: Plugin<F>>(&mut self, crate_name: &'static str) -> Result<(), DuplicateType> {
        let entry = Entry {
            family: F::NAME,
            name: P::TYPE,
            crate_name,
            #[cfg(feature = "schema")]
            schema: || SchemaGenerator::default().into_root_schema_for::<P::Config>(),
            build: Box::new(build_plugin::<F, P> as BuildFn<F>),
        };
        match self.entries.insert((F::NAME, P::TYPE), entry) {
            None => Ok(()),
            Some(first) => Err(DuplicateType {
                family: F::NAME.singular(),
                name: P::TYPE,
                first: first.crate_name,
                second: crate_name,
            }),
        }
    }

    /// Tells what this program was built without, as family, type and crate, for the message about
    /// a scene that names it.
    pub fn leave_out(&mut self, absent: &'static [(FamilyName, &'static str, &'static str)]) {
        self.absent = absent;
    }

    /// Adds the twin of a plugin from outside, so that its scenes can be validated: for `mitsuba` a
    /// Python file as `references/mitsuba/whitstone_mitsuba/twins.py` describes it.
    pub fn add_twin(&mut self, reference: &'static str, file: &'static str, text: &'static str) {
        self.twins.push(Twin {
            reference,
            file,
            text,
        });
    }

    /// The twins of plugins from outside for a reference.
    pub fn twins(&self, reference: &str) -> impl Iterator<Item = &Twin> {
        self.twins.iter().filter(move |twin| twin.reference == reference)
    }

    /// All plugins, by family and name.
    pub fn entries(&self) -> impl Iterator<Item = &Entry> {
        self.entries.values()
    }

    /// The plugin of a type. The error says which types there are and which is nearest; it has no
    /// place.
    pub fn get(&self, family: FamilyName, name: &str) -> Result<&Entry, SceneError> {
        if let Some((_, entry)) = self.entries.iter().find(|((f, n), _)| *f == family && *n == name) {
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
                "add the feature `{name}` of `{from}` to its package, or make it anew: `cargo xtask slim SCENE`"
            )));
        }
        let error = SceneError::anywhere(format!("unknown {kind} type \"{name}\""));
        Err(error.with_help(match nearest(name, known.iter().copied()) {
            Some(near) => format!("did you mean \"{near}\"?"),
            None if known.is_empty() => format!(
                "no {kind} is built in; build with the features of `whitstone-{}`",
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
    use glam::DVec2;
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

    impl Context for NoContext {
        fn texture(&mut self, _: &TextureRef) -> Result<ColorSource, SceneErrors> {
            Err(SceneError::anywhere("no textures here").into())
        }
        fn file(&self, _: &FilePath) -> Result<PathBuf, SceneError> {
            Err(SceneError::anywhere("no files here"))
        }
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
    fn what_was_left_out_names_its_feature() {
        let mut registry = Registry::default();
        registry.add::<Samplers, Dot>("one").unwrap();
        registry.leave_out(&[(FamilyName::Sampler, "line", "two")]);
        let error = registry.get(FamilyName::Sampler, "line").err().unwrap();
        assert!(error.message.contains("built without the sampler type \"line\""));
        assert!(error.help.unwrap().contains("the feature `line` of `two`"));
        // Another family has no such type at all.
        let error = registry.get(FamilyName::Shape, "line").err().unwrap();
        assert!(error.message.contains("unknown shape type"));
    }

    #[test]
    fn unknown_keys_are_refused_with_their_place() {
        let mut registry = Registry::default();
        registry.add::<Samplers, Dot>("one").unwrap();
        let table = DeTable::parse("seed = 3").unwrap();
        let result = registry.build::<Samplers>("dot", &table, (), &mut NoContext);
        let error = result.err().unwrap().0.remove(0);
        assert_eq!(error.span, Some(0..4));
        assert_eq!(error.message, "unknown key `seed`");
    }
}
