use crate::document::{self, Flattened, Plain, Value, type_name};
use crate::path_classes::{Expression, compile};
use crate::{AUTO, Checked, Motion, Sources, transform};
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, IgnoredAny, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::panic::resume_unwind;
use std::sync::{Arc, LazyLock, Mutex};
use std::thread;
use toml::Spanned;
use toml::de::{DeString, DeTable, DeValue};
use whitstone_core::config::{
    FilePath, Finite, GroupRef, IntegerIn, PluginRef, Positive, Table, decode, inline_reference,
};
use whitstone_core::{FilmSize, PathClasses, SceneError, SceneErrors, SourceSpan, Transform, nearest};

/// Maximum number of pixels of an image.
const MAX_PIXELS: u64 = 1 << 28;
/// Length of a text in bytes from which a thread is worth its start.
const LONG: usize = 1 << 20;
/// Default width and height.
const DEFAULT_SIDE: u32 = 512;

/// A scene as it is written: the kind of every table is known, but no plugin has been built.
#[derive(Clone)]
pub struct Description<'s> {
    /// The source text.
    pub sources: &'s Sources,
    /// The image.
    pub film: FilmTable,
    /// The camera.
    pub camera: PluginTable<'s>,
    /// The sampler, which places samples in a pixel; `None` for the registry's default.
    pub sampler: Option<PluginTable<'s>>,
    /// The integrator; `None` for the registry's default.
    pub integrator: Option<PluginTable<'s>>,
    /// The accelerator; the type may be [`AUTO`].
    pub accelerator: PluginTable<'s>,
    /// Lights, in the order of the file.
    pub lights: Vec<PluginTable<'s>>,
    /// Shapes, in the order of the file, which defines their numbers.
    pub shapes: Vec<ShapeTable<'s>>,
    /// Shared materials by id.
    pub materials: BTreeMap<String, PluginTable<'s>>,
    /// Shared textures by id.
    pub textures: BTreeMap<String, PluginTable<'s>>,
    /// Groups of shapes by id.
    pub groups: BTreeMap<String, GroupTable<'s>>,
    /// Plugins written inside other tables. Their index is the number in the reference that
    /// replaces them.
    pub inline: Vec<PluginTable<'s>>,
    /// Limits of the validation.
    pub expect: Expect,
    /// The same scene as a single document.
    pub flattened: Flattened,
    /// The parts that could not be read. Later steps continue without them.
    pub faulty: Faulty,
}

/// Parts of a scene that exist but could not be read, so that they are not reported as missing too.
#[derive(Clone, Debug, Default)]
pub struct Faulty {
    /// Names of top-level tables; an empty table replaces each.
    pub tables: BTreeSet<&'static str>,
    /// Shared plugins by family and id.
    pub shared: BTreeSet<(&'static str, String)>,
}

/// The type and parameters of a plugin.
#[derive(Clone, Debug)]
pub struct PluginTable<'s> {
    /// The TOML `type`.
    pub name: String,
    /// Place of the type, or of the table if the type is missing.
    pub name_span: SourceSpan,
    /// The parameters, without `type` and the keys that are common to its family.
    pub table: Table<'s>,
}

impl PluginTable<'_> {
    /// A type without parameters that is not written in the scene.
    pub fn named(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            name_span: 0..0,
            table: Spanned::new(0..0, DeTable::new()),
        }
    }

    /// A plugin that another one builds for a file, with further keys and values. Its errors are
    /// reported at the file's place.
    pub fn of_file(name: &str, file: &FilePath, words: &[(&'static str, &'static str)]) -> Self {
        let span = || file.span.clone();
        let mut table = DeTable::new();
        let path = DeString::Owned(file.path.clone());
        let words = words.iter().map(|(key, word)| (*key, DeString::Borrowed(*word)));
        for (key, word) in words.chain([("file", path)]) {
            let key = Spanned::new(span(), DeString::Borrowed(key));
            table.insert(key, Spanned::new(span(), DeValue::String(word)));
        }
        Self {
            name: name.to_owned(),
            name_span: span(),
            table: Spanned::new(span(), table),
        }
    }

    /// An empty table without a name.
    fn empty() -> Self {
        Self::named("")
    }
}

/// A shape with the keys that all shapes have.
#[derive(Clone, Debug)]
pub struct ShapeTable<'s> {
    /// Type and parameters.
    pub plugin: PluginTable<'s>,
    /// A name for messages and for `--set`.
    pub id: Option<String>,
    /// `None` for the default material.
    pub material: Option<(SourceSpan, PluginRef)>,
    /// Object-to-world transform, of a moving shape at the first time of the film.
    pub transform: Transform,
    /// `None` if it stands still.
    pub motion: Option<Motion>,
    /// Whether it casts shadows.
    pub casts_shadow: bool,
    /// The group that it instantiates, if any: the value of the key `group`.
    pub group: Option<GroupRef>,
    /// Materials that an instance replaces, by the ids of shared ones: the value of the key
    /// `materials`.
    pub materials: Vec<ReplacedMaterial>,
}

/// A material that an instance shows instead of another.
#[derive(Clone, Debug)]
pub struct ReplacedMaterial {
    /// Position of the id.
    pub span: SourceSpan,
    /// The id of the shared material that is replaced.
    pub id: String,
    /// What is shown in its place.
    pub by: (SourceSpan, PluginRef),
}

/// A group of shapes.
#[derive(Clone, Debug)]
pub struct GroupTable<'s> {
    /// The accelerator of the group; the type may be [`AUTO`].
    pub accelerator: PluginTable<'s>,
    /// Shapes, in the order of the file; not empty.
    pub shapes: Vec<ShapeTable<'s>>,
}

/// The `[film]` table.
#[derive(Clone, Debug, PartialEq)]
pub struct FilmTable {
    /// Size in pixels.
    pub size: FilmSize,
    /// The times in seconds at which the scene is seen; the image is the mean over them. At least
    /// one.
    pub times: Vec<f64>,
    /// Layers to write besides the radiance, in the requested order.
    pub aovs: Vec<Aov>,
    /// Layers of path classes, after those.
    pub paths: Option<PathLayers>,
    /// Place of the table, if the scene has one.
    pub span: Option<SourceSpan>,
}

/// The radiance by classes of light paths; section 11 of the model.
#[derive(Clone, Debug, PartialEq)]
pub struct PathLayers {
    /// Place of the table of classes.
    pub span: SourceSpan,
    /// The classes.
    pub classes: Arc<PathClasses>,
}

impl FilmTable {
    /// EXR channels of all layers, in order.
    pub fn channels(&self) -> impl Iterator<Item = Cow<'static, str>> {
        let aovs = self.aovs.iter().flat_map(|aov| aov.channels());
        let paths = self.paths.iter().flat_map(|paths| paths.classes.channels());
        aovs.copied().map(Cow::Borrowed).chain(paths.map(Cow::Owned))
    }

    /// Memory of all pixels in bytes.
    pub fn bytes(&self) -> u64 {
        let pixels = u64::from(self.size.width) * u64::from(self.size.height);
        pixels * (3 + self.channels().count() as u64) * size_of::<f32>() as u64
    }
}

impl Default for FilmTable {
    fn default() -> Self {
        Self {
            size: FilmSize {
                width: DEFAULT_SIDE,
                height: DEFAULT_SIDE,
            },
            times: vec![0.0],
            aovs: Vec::new(),
            paths: None,
            span: None,
        }
    }
}

/// A layer of arbitrary output variables (AOVs); section 11 of the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Aov {
    /// Distance from the camera ray's origin, in metres.
    Depth,
    /// Shading normal in world space.
    Normal,
    /// Texture coordinates.
    Uv,
    /// Index of the shape.
    ShapeId,
    /// Index of the primitive in the shape.
    PrimitiveId,
}

impl Aov {
    /// EXR channels of the layer.
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            Self::Depth => &["depth.Z"],
            Self::Normal => &["normal.X", "normal.Y", "normal.Z"],
            Self::Uv => &["uv.U", "uv.V"],
            Self::ShapeId => &["shape_id.I"],
            Self::PrimitiveId => &["primitive_id.I"],
        }
    }
}

/// The `[expect]` table: limits that differ from the defaults, and the reason.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expect {
    /// Largest `rel_rmse_interior` that passes.
    pub rel_rmse_interior: Option<Positive>,
    /// Largest number of explained pixels that passes.
    #[serde(default, deserialize_with = "count")]
    pub explained: Option<u32>,
    /// Why the numbers differ from the default; required with any of them.
    pub reason: Option<String>,
}

/// With a message that names the range, unlike serde's own message for `u32`.
fn count<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<u32>, D::Error> {
    Ok(Some(
        IntegerIn::<0, { u32::MAX }>::deserialize(deserializer)?.get(),
    ))
}

/// Width or height of the image in pixels.
type Side = IntegerIn<1, 65536>;

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawFilm {
    width: Option<Spanned<Side>>,
    height: Option<Spanned<Side>>,
    #[serde(default)]
    time: FilmTime,
    #[serde(default)]
    aovs: Vec<Spanned<Aov>>,
    /// Read by [`Reader::paths`].
    #[serde(default, rename = "paths")]
    _paths: Option<IgnoredAny>,
}

/// The key `time`: one time in seconds, or the shutter.
#[derive(Clone, Copy)]
enum FilmTime {
    At(f64),
    Shutter(Shutter),
}

/// Equal intervals of time, of which the middles are sampled.
#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct Shutter {
    open: Finite,
    close: Finite,
    count: IntegerIn<1, 256>,
}

impl Default for FilmTime {
    fn default() -> Self {
        Self::At(0.0)
    }
}

impl FilmTime {
    /// All times; section 3 of the model.
    fn all(self) -> Vec<f64> {
        match self {
            Self::At(time) => vec![time],
            Self::Shutter(Shutter { open, close, count }) => {
                let (open, close, count) = (open.get(), close.get(), count.get());
                let middle = |k: u32| open + (close - open) * (f64::from(k) + 0.5) / f64::from(count);
                (0..count).map(middle).collect()
            }
        }
    }
}

impl<'de> Deserialize<'de> for FilmTime {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct TimeVisitor;

        impl<'de> Visitor<'de> for TimeVisitor {
            type Value = FilmTime;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a time in seconds, or { open, close, count }")
            }
            fn visit_i64<E: Error>(self, time: i64) -> Result<FilmTime, E> {
                self.visit_f64(time as f64)
            }
            fn visit_f64<E: Error>(self, time: f64) -> Result<FilmTime, E> {
                let time = Finite::new(time);
                let time = time.ok_or_else(|| E::custom("expected a finite time"))?;
                Ok(FilmTime::At(time.get()))
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<FilmTime, A::Error> {
                let shutter = Shutter::deserialize(MapAccessDeserializer::new(map))?;
                let (open, close) = (shutter.open.get(), shutter.close.get());
                // A difference that overflows has no middle.
                if !(open <= close && (close - open).is_finite()) {
                    let message = format!(
                        "expected `close` not before `open`, and a finite difference, found {open} and {close} s"
                    );
                    return Err(A::Error::custom(message));
                }
                Ok(FilmTime::Shutter(shutter))
            }
        }

        deserializer.deserialize_any(TimeVisitor)
    }
}

impl<'s> Description<'s> {
    /// The same scene at another time, with the transforms that its moving shapes have then.
    ///
    /// # Errors
    ///
    /// A transform that is singular at that time.
    pub fn at(&self, time: f64) -> Result<Self, SceneErrors> {
        let mut moved = self.clone();
        let mut errors = SceneErrors::default();
        let groups = moved.groups.values_mut();
        let shapes = moved
            .shapes
            .iter_mut()
            .chain(groups.flat_map(|group| &mut group.shapes));
        for shape in shapes {
            let found = shape.motion.as_ref().map(|motion| motion.at(time));
            if let Some(transform) = found.and_then(|found| errors.take(found)) {
                shape.transform = transform;
            }
        }
        errors.into_result(moved)
    }

    /// Whether a shape moves.
    pub fn moves(&self) -> bool {
        let groups = self.groups.values();
        let mut shapes = self.shapes.iter().chain(groups.flat_map(|group| &group.shapes));
        shapes.any(|shape| shape.motion.is_some())
    }

    /// Reads the tables. There is no description only if a file is not TOML.
    pub fn parse(sources: &'s Sources) -> Checked<Self> {
        let (merged, errors) = match document::merge(sources) {
            Ok(merged) => merged,
            Err(errors) => return Checked { value: None, errors },
        };
        let (plain, not_flat) = Plain::new(&merged, sources);
        // The thread takes it, or this one if no thread was started.
        let plain = Mutex::new(Some(plain));
        let flatten = || plain.lock().ok()?.take().map(|plain| plain.flatten(sources));
        thread::scope(|scope| {
            // A long document is flattened while its tables are read. Without a thread for it, it
            // is flattened afterwards.
            let is_long = sources.padded_files().any(|text| text.len() > LONG);
            let worker = is_long.then(|| thread::Builder::new().spawn_scoped(scope, flatten));
            let flattened = || match worker {
                Some(Ok(worker)) => worker.join().unwrap_or_else(|panic| resume_unwind(panic)),
                _ => flatten(),
            };
            Self::read(sources, merged, errors, (flattened, not_flat))
        })
    }

    /// Reads the tables of the merged document, which is flattened elsewhere.
    fn read(
        sources: &'s Sources,
        mut merged: DeTable<'s>,
        mut errors: SceneErrors,
        (flattened, not_flat): (impl FnOnce() -> Option<Flattened>, SceneErrors),
    ) -> Checked<Self> {
        let mut inline = Vec::new();
        let mut faulty = Faulty::default();
        let mut reader = Reader {
            inline: &mut inline,
            faulty: &mut faulty,
            errors: &mut errors,
            times: Vec::new(),
        };
        let film = reader.film(merged.remove("film")).unwrap_or_default();
        reader.times.clone_from(&film.times);
        let expect = reader.expect(merged.remove("expect"));
        let camera = merged.remove("camera");
        if camera.is_none() {
            let error = SceneError::anywhere("the scene has no camera");
            reader
                .errors
                .0
                .push(error.with_help("add a [camera] table with type = \"perspective\""));
        }
        let camera = camera.and_then(|value| reader.plugin(value, "camera"));
        let camera = reader.or_empty(camera, "camera");
        let sampler = reader.optional(merged.remove("sampler"), "sampler");
        let integrator = reader.optional(merged.remove("integrator"), "integrator");
        let accelerator = reader.accelerator(merged.remove("accelerator"));
        let lights = reader.list(merged.remove("light"), "light");
        let textures = reader.shared(merged.remove("texture"), "texture");
        let materials = reader.shared(merged.remove("material"), "material");
        let shapes = reader.shapes(merged.remove("shape"));
        let groups = reader.groups(merged.remove("group"));
        // Drop flattening errors at positions already reported by the typed reader.
        let reported: BTreeSet<_> = errors
            .0
            .iter()
            .filter_map(|error| Some(error.span.as_ref()?.start))
            .collect();
        let news = |error: &SceneError| {
            error
                .span
                .as_ref()
                .is_none_or(|span| !reported.contains(&span.start))
        };
        errors.0.extend(not_flat.0.into_iter().filter(news));
        let description = Self {
            sources,
            film,
            camera,
            sampler,
            integrator,
            accelerator,
            lights,
            shapes,
            materials,
            textures,
            groups,
            inline,
            expect: expect.unwrap_or_default(),
            flattened: flattened().expect("the document is flattened once"),
            faulty,
        };
        Checked {
            value: Some(description),
            errors,
        }
    }
}

/// Replaces an inline plugin that could not be read.
static FAULTY_INLINE: LazyLock<String> = LazyLock::new(|| inline_reference(usize::MAX));

/// Splits tables, and collects errors and inline plugins.
struct Reader<'a, 's> {
    inline: &'a mut Vec<PluginTable<'s>>,
    faulty: &'a mut Faulty,
    errors: &'a mut SceneErrors,
    /// The times of the film.
    times: Vec<f64>,
}

impl<'s> Reader<'_, 's> {
    fn error(&mut self, span: SourceSpan, message: impl Into<String>) {
        self.errors.0.push(SceneError::at(span, message));
    }

    fn table(&mut self, value: Value<'s>, what: &str) -> Option<Table<'s>> {
        let span = value.span();
        match value.into_inner() {
            DeValue::Table(table) => Some(Spanned::new(span, table)),
            other => {
                self.error(
                    span,
                    format!("expected the table of the {what}, found {}", type_name(&other)),
                );
                None
            }
        }
    }

    fn film(&mut self, value: Option<Value<'s>>) -> Option<FilmTable> {
        let Some(value) = value else {
            return Some(FilmTable::default());
        };
        let table = self.table(value, "film")?;
        let raw = self.errors.take(decode::<RawFilm>(&table))?;
        let pixels =
            |side: &Option<Spanned<Side>>| side.as_ref().map_or(DEFAULT_SIDE, |side| side.get_ref().get());
        let (width, height) = (pixels(&raw.width), pixels(&raw.height));
        if let Some(at) = raw.width.as_ref().or(raw.height.as_ref())
            && u64::from(width) * u64::from(height) > MAX_PIXELS
        {
            self.error(
                at.span(),
                format!("expected at most {MAX_PIXELS} pixels, found {width} x {height}"),
            );
            return None;
        }
        let mut aovs = Vec::new();
        for aov in raw.aovs {
            if aovs.contains(aov.get_ref()) {
                self.error(aov.span(), "this layer occurs twice in the list");
            } else {
                aovs.push(aov.into_inner());
            }
        }
        let paths = table.get_ref().get("paths").cloned();
        Some(FilmTable {
            size: FilmSize { width, height },
            times: raw.time.all(),
            aovs,
            paths: paths.and_then(|value| self.paths(value)),
            span: Some(table.span()),
        })
    }

    /// The path classes of the film. There are none if a class has an error.
    fn paths(&mut self, value: Value<'s>) -> Option<PathLayers> {
        let table = self.table(value, "path classes")?;
        let span = table.span();
        let errors = self.errors.0.len();
        let mut expressions = Vec::new();
        for (name, value) in table.into_inner() {
            let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-');
            if name.get_ref().is_empty() || !name.get_ref().chars().all(allowed) {
                let message = "expected a name of letters, digits, `_` and `-` for a path class";
                self.error(name.span(), message);
            }
            if let Some((span, text)) = self.text(value, "a path expression, such as \"E S* D L\"") {
                expressions.push(Expression {
                    name: name.into_inner().into_owned(),
                    text,
                    span,
                });
            }
        }
        if expressions.is_empty() {
            return None;
        }
        let compiled = self
            .errors
            .take(compile(&expressions).map_err(|errors| errors.or_at(&span)));
        let classes = Arc::new(compiled.filter(|_| self.errors.0.len() == errors)?);
        Some(PathLayers { span, classes })
    }

    fn expect(&mut self, value: Option<Value<'s>>) -> Option<Expect> {
        let Some(value) = value else {
            return Some(Expect::default());
        };
        let table = self.table(value, "expect")?;
        let expect: Expect = self.errors.take(decode(&table))?;
        let changes = expect.rel_rmse_interior.is_some() || expect.explained.is_some();
        if changes && expect.reason.is_none() {
            self.error(table.span(), "a changed limit needs a `reason`");
        }
        Some(expect)
    }

    /// A plugin that the scene may leave to the registry.
    fn optional(&mut self, value: Option<Value<'s>>, what: &'static str) -> Option<PluginTable<'s>> {
        let plugin = self.plugin(value?, what);
        Some(self.or_empty(plugin, what))
    }

    fn accelerator(&mut self, value: Option<Value<'s>>) -> PluginTable<'s> {
        self.optional(value, "accelerator")
            .unwrap_or_else(|| PluginTable::named(AUTO))
    }

    /// The plugin, or an empty table if it could not be read.
    fn or_empty(&mut self, plugin: Option<PluginTable<'s>>, what: &'static str) -> PluginTable<'s> {
        plugin.unwrap_or_else(|| {
            self.faulty.tables.insert(what);
            PluginTable::empty()
        })
    }

    fn plugin(&mut self, value: Value<'s>, what: &str) -> Option<PluginTable<'s>> {
        let mut table = self.table(value, what)?;
        let Some(name) = table.get_mut().remove("type") else {
            let error = SceneError::at(table.span(), format!("this {what} has no `type`"));
            let near = table
                .get_ref()
                .keys()
                .find(|key| nearest(key.get_ref(), ["type"]).is_some());
            self.errors.0.push(match near {
                Some(key) => error.with_help(format!("did you mean `type` instead of `{}`?", key.get_ref())),
                None => error.with_help(format!("`whitstone list {what}s` shows the types")),
            });
            return None;
        };
        let name_span = name.span();
        let name = match name.into_inner() {
            DeValue::String(name) => name.into_owned(),
            other => {
                self.error(
                    name_span,
                    format!("expected a type in quotes, found {}", type_name(&other)),
                );
                return None;
            }
        };
        let entries = std::mem::take(table.get_mut());
        let hoisted = entries
            .into_iter()
            .map(|(key, value)| (key, self.hoist(value)))
            .collect();
        *table.get_mut() = hoisted;
        Some(PluginTable {
            name,
            name_span,
            table,
        })
    }

    /// Moves plugins written inside a table (tables with a `type`) out of it.
    fn hoist(&mut self, value: Value<'s>) -> Value<'s> {
        let span = value.span();
        let value = match value.into_inner() {
            DeValue::Table(table) if table.contains_key("type") => {
                let plugin = self.plugin(Spanned::new(span.clone(), DeValue::Table(table)), "plugin");
                let reference = match plugin {
                    Some(_) => inline_reference(self.inline.len()),
                    None => FAULTY_INLINE.clone(),
                };
                self.inline.extend(plugin);
                DeValue::String(reference.into())
            }
            // Otherwise it would look like a reference to an inline plugin.
            DeValue::String(text) if matches!(PluginRef::from(text.as_ref()), PluginRef::Inline(_)) => {
                self.error(
                    span.clone(),
                    "a string must not begin with the control character U+0001",
                );
                DeValue::String(FAULTY_INLINE.clone().into())
            }
            DeValue::Array(items) => DeValue::Array(items.into_iter().map(|item| self.hoist(item)).collect()),
            // A table of the plugin itself, which may contain plugins.
            DeValue::Table(table) => {
                let entries = table.into_iter();
                DeValue::Table(entries.map(|(key, value)| (key, self.hoist(value))).collect())
            }
            other => other,
        };
        Spanned::new(span, value)
    }

    fn list(&mut self, value: Option<Value<'s>>, what: &str) -> Vec<PluginTable<'s>> {
        self.items(value, what)
            .into_iter()
            .filter_map(|item| self.plugin(item, what))
            .collect()
    }

    fn items(&mut self, value: Option<Value<'s>>, what: &str) -> Vec<Value<'s>> {
        let Some(value) = value else {
            return Vec::new();
        };
        let span = value.span();
        match value.into_inner() {
            DeValue::Array(items) => items.into_iter().collect(),
            other => {
                self.error(
                    span,
                    format!("expected a list of {what}s, found {}", type_name(&other)),
                );
                Vec::new()
            }
        }
    }

    fn shared(&mut self, value: Option<Value<'s>>, what: &'static str) -> BTreeMap<String, PluginTable<'s>> {
        let Some(value) = value else {
            return BTreeMap::new();
        };
        let Some(table) = self.table(value, what) else {
            return BTreeMap::new();
        };
        let mut plugins = BTreeMap::new();
        for (id, value) in table.into_inner() {
            let id = id.into_inner().into_owned();
            match self.plugin(value, what) {
                Some(plugin) => {
                    plugins.insert(id, plugin);
                }
                None => {
                    self.faulty.shared.insert((what, id));
                }
            }
        }
        plugins
    }

    fn shapes(&mut self, value: Option<Value<'s>>) -> Vec<ShapeTable<'s>> {
        let mut ids: BTreeMap<String, usize> = BTreeMap::new();
        let mut shapes = Vec::new();
        for (number, item) in self.items(value, "shape").into_iter().enumerate() {
            let Some(mut plugin) = self.plugin(item, "shape") else {
                continue;
            };
            let id = plugin
                .table
                .get_mut()
                .remove("id")
                .and_then(|id| self.text(id, "an id"));
            if let Some((span, id)) = &id
                && let Some(first) = ids.insert(id.clone(), number)
            {
                self.error(
                    span.clone(),
                    format!("the id \"{id}\" is already used by shape {first}"),
                );
            }
            let material = plugin.table.get_mut().remove("material");
            let material =
                material.and_then(|value| self.text(value, "the id of a material or a table with a `type`"));
            let transform = match plugin.table.get_mut().remove("transform") {
                None => Some(Transform::IDENTITY),
                Some(value) => self.errors.take(transform::parse(&value)),
            };
            let motion = plugin.table.get_mut().remove("motion");
            let own = transform.unwrap_or(Transform::IDENTITY);
            let motion = motion.and_then(|value| self.motion(&value, &own));
            let first = self.times.first().copied().unwrap_or_default();
            // Errors at the times of the film are already reported.
            let placed = motion.as_ref().and_then(|motion| motion.at(first).ok());
            let group = plugin.table.get_ref().get("group").and_then(|value| {
                Some(GroupRef {
                    span: value.span(),
                    id: value.get_ref().as_str()?.to_owned(),
                })
            });
            let casts_shadow = match plugin.table.get_mut().remove("casts_shadow") {
                None => true,
                Some(value) => self.flag(&value).unwrap_or(true),
            };
            let materials = plugin.table.get_ref().get("materials").map(replaced);
            shapes.push(ShapeTable {
                casts_shadow,
                materials: materials.filter(|_| group.is_some()).unwrap_or_default(),
                plugin,
                group,
                id: id.map(|(_, id)| id),
                material: material.map(|(span, text)| (span, PluginRef::from(text.as_str()))),
                transform: placed.unwrap_or(own),
                motion,
            });
        }
        shapes
    }

    /// The motion of a shape with its own transform, if it is valid at all times of the film.
    fn motion(&mut self, value: &Value<'s>, own: &Transform) -> Option<Motion> {
        let motion = self.errors.take(Motion::parse(value, own))?;
        // The first error is enough: it may be the same at all times.
        let faulty = self.times.iter().find_map(|time| motion.at(*time).err());
        match faulty {
            Some(errors) => {
                self.errors.0.extend(errors.0);
                None
            }
            None => Some(motion),
        }
    }

    fn groups(&mut self, value: Option<Value<'s>>) -> BTreeMap<String, GroupTable<'s>> {
        let mut groups = BTreeMap::new();
        let Some(table) = value.and_then(|value| self.table(value, "group")) else {
            return groups;
        };
        for (id, value) in table.into_inner() {
            let (span, id) = (value.span(), id.into_inner().into_owned());
            let errors = self.errors.0.len();
            let Some(mut table) = self.table(value, "group") else {
                self.faulty.shared.insert(("group", id));
                continue;
            };
            let accelerator = self.accelerator(table.get_mut().remove("accelerator"));
            let shapes = self.shapes(table.get_mut().remove("shape"));
            for key in table.get_ref().keys() {
                let error = SceneError::at(key.span(), format!("unknown key `{}`", key.get_ref()));
                let help = "known keys are `accelerator`, `shape`";
                self.errors.0.push(error.with_help(help));
            }
            if shapes.is_empty() && self.errors.0.len() == errors {
                let error = SceneError::at(span, format!("the group \"{id}\" has no shapes"));
                self.errors
                    .0
                    .push(error.with_help(format!("add [[group.{id}.shape]]")));
            }
            if self.errors.0.len() > errors {
                self.faulty.shared.insert(("group", id.clone()));
            }
            groups.insert(id, GroupTable { accelerator, shapes });
        }
        groups
    }

    fn flag(&mut self, value: &Value<'s>) -> Option<bool> {
        let flag = value.get_ref().as_bool();
        if flag.is_none() {
            let found = type_name(value.get_ref());
            self.error(value.span(), format!("expected true or false, found {found}"));
        }
        flag
    }

    fn text(&mut self, value: Value<'s>, expected: &str) -> Option<(SourceSpan, String)> {
        let span = value.span();
        match value.into_inner() {
            DeValue::String(text) => Some((span, text.into_owned())),
            other => {
                self.error(span, format!("expected {expected}, found {}", type_name(&other)));
                None
            }
        }
    }
}

/// The entries of `materials` that have the right type; the plugin reports the others.
fn replaced(table: &Value<'_>) -> Vec<ReplacedMaterial> {
    let entries = table.get_ref().as_table().into_iter().flatten();
    let replaced = entries.filter_map(|(id, by)| {
        Some(ReplacedMaterial {
            span: id.span(),
            id: id.get_ref().clone().into_owned(),
            by: (by.span(), PluginRef::from(by.get_ref().as_str()?)),
        })
    });
    replaced.collect()
}
