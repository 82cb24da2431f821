//! From Mitsuba's objects to a document.

use super::FEATURES;
use super::xml::{At, Data, Entry, Object, Scene};
use crate::combine::Rays;
use crate::document::{Document, Ids, Shared, typed};
use crate::files::{Folder, Named, shorten};
use crate::mesh_file::MeshInfo;
use crate::part::{self, Part};
use std::collections::{BTreeSet, HashMap};
use std::path::PathBuf;
use toml::{Table, Value};
use whitstone_core::{DAffine3, DVec3, FormatError, FormatErrors, ImportOptions, Imported, Notes};

/// Objects inside each other, by references.
const MAX_NESTING: usize = 16;
/// Most samples of a pixel. Mitsuba needs many for its noise, of which there is none here.
const MAX_SAMPLES: i64 = 64;
/// Most places that a note lists.
const MAX_PLACES: usize = 100;
/// Bounces of an integrator without a limit.
const UNLIMITED_DEPTH: i64 = 16;

/// The state of a translation.
pub(super) struct Translator<'a> {
    pub(super) scene: &'a Scene,
    pub(super) folder: &'a Folder,
    pub(super) options: &'a ImportOptions,
    pub(super) document: Document,
    pub(super) errors: Vec<FormatError>,
    notes: Notes,
    /// Number of occurrences of each noted feature.
    noted: HashMap<String, usize>,
    /// Bounds of the shapes of the list that is translated.
    pub(super) bounds: Part,
    /// Objects that are being translated.
    open: Vec<usize>,
    /// Translated materials and textures, by object and look.
    pub(super) memo: HashMap<String, Value>,
    materials: Shared,
    /// Which rays the shared materials continue.
    pub(super) rays: HashMap<String, Rays>,
    textures: Shared,
    pub(super) group_ids: Ids,
    /// Ids and bounds of groups, by their objects.
    pub(super) groups: HashMap<usize, (String, Part)>,
    pub(super) meshes: HashMap<PathBuf, MeshInfo>,
    /// Whether objects contain one of some plugins.
    pub(super) contained: HashMap<(usize, &'static [&'static str]), bool>,
    /// Whether no surface reflects the light of an emitter, since paths are too short.
    unlit: bool,
    /// Whether holes of surfaces do not let the light of points and directions through.
    pub(super) opaque_holes: bool,
    /// Names in `materials` of the options that were found.
    pub(super) replaced: BTreeSet<&'a str>,
}

/// The children of an object, with marks on those that were read.
pub(super) struct Fields<'a> {
    pub(super) object: &'a Object,
    used: Vec<bool>,
}

impl<'a> Fields<'a> {
    /// Takes the child with this name; the last one if there are several.
    pub(super) fn take(&mut self, name: &str) -> Option<&'a Entry> {
        let mut found = None;
        for (entry, used) in self.object.entries.iter().zip(&mut self.used) {
            if entry.name == name {
                *used = true;
                found = Some(entry);
            }
        }
        found
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.object.entries.iter().any(|entry| entry.name == name)
    }

    pub(super) fn at(&self) -> At {
        self.object.at
    }
}

impl<'a> Translator<'a> {
    pub(super) fn new(scene: &'a Scene, folder: &'a Folder, options: &'a ImportOptions) -> Self {
        Self {
            scene,
            folder,
            options,
            document: Document::default(),
            errors: Vec::new(),
            notes: Notes::default(),
            noted: HashMap::new(),
            bounds: Part::EMPTY,
            open: Vec::new(),
            memo: HashMap::new(),
            materials: Shared::new(&options.prefix),
            rays: HashMap::new(),
            textures: Shared::new(&options.prefix),
            group_ids: Ids::new(&options.prefix),
            groups: HashMap::new(),
            meshes: HashMap::new(),
            contained: HashMap::new(),
            unlit: false,
            opaque_holes: false,
            replaced: BTreeSet::new(),
        }
    }

    pub(super) fn translate(mut self) -> Result<Imported, FormatErrors> {
        let options = self.options;
        for (what, selection) in [("scenes", &options.scene), ("nodes", &options.node)] {
            if selection.is_some() {
                let message = format!("a Mitsuba scene has no {what} to select");
                self.errors.push(FormatError::anywhere(message));
            }
        }
        let mut fields = self.fields(0);
        for &at in &self.scene.spectra {
            self.note("spectrum of wavelengths", at);
        }
        let mut sensors = Vec::new();
        let mut integrator = None;
        let mut shapes = Vec::new();
        let mut emitters = Vec::new();
        for (entry, index) in self.children(&mut fields, &[]) {
            let object = &self.scene.objects[index];
            match object.family {
                "sensor" => sensors.push(index),
                "integrator" => integrator = Some(index),
                "shape" => shapes.push(index),
                // Shared objects are translated where they are used.
                "bsdf" | "texture" => {}
                "emitter" if object.plugin == "area" && self.is_used(index) => {}
                "emitter" => emitters.push(index),
                "medium" | "phase" | "volume" => self.note("medium", entry.at),
                family => {
                    let message = format!(
                        "a scene cannot contain the {family} \"{}\"",
                        shorten(&object.plugin)
                    );
                    self.error(entry.at, message);
                }
            }
        }
        self.finish(fields);
        if !options.part {
            let integrator = match integrator {
                Some(index) => self.integrator(index),
                None => {
                    // Mitsuba's default.
                    self.note("integrator path", self.scene.objects[0].at);
                    self.opaque_holes = true;
                    self.note("unlimited max_depth", self.scene.objects[0].at);
                    None
                }
            };
            let integrator = integrator.unwrap_or_else(|| path(None));
            self.sensor_of(&sensors);
            self.document.single.push(("integrator", integrator));
        } else if options.camera.is_some() {
            self.sensor_of(&sensors);
        }
        let base = options.transform;
        let mut translated = Vec::new();
        for index in shapes {
            self.shape(index, &base, false, &mut translated);
        }
        self.document.shapes = translated;
        if options.lights {
            for index in emitters {
                self.emitter(index);
            }
        }
        if self.unlit {
            self.unlight();
        }
        for name in options.materials.keys() {
            if !self.replaced.contains(name.as_str()) {
                let known: Vec<String> = self
                    .scene
                    .objects
                    .iter()
                    .filter(|object| object.family == "bsdf")
                    .filter_map(|object| object.id.clone())
                    .collect();
                // An object that no shape uses may be replaced, too.
                if !known.contains(name) {
                    self.errors.push(part::unknown_material(name, &known));
                }
            }
        }
        if !self.errors.is_empty() {
            self.errors.truncate(100);
            return Err(FormatErrors(self.errors));
        }
        self.fit();
        self.document.bound_reflections();
        Ok(Imported {
            text: self.document.to_toml(),
            notes: self.notes.into_sorted(),
            files: Vec::new(),
        })
    }

    /// Adds what a whole scene needs and the file lacks.
    fn fit(&mut self) {
        if self.options.part {
            return;
        }
        let Part { low, high } = self.bounds;
        if self.document.single.iter().all(|(name, _)| *name != "camera") {
            self.document.single.insert(0, ("film", crate::fit::film()));
            self.document
                .single
                .insert(1, ("camera", crate::fit::camera(low, high)));
        }
        let is_lit = self.scene.objects.iter().any(|object| object.family == "emitter");
        if !is_lit && self.options.lights {
            self.document.lights = crate::fit::lights(low, high);
        }
    }

    /// Whether rays that leave the scene see light. In Mitsuba a path of `max_depth` edges sees it
    /// at its end, where a surface is not lit any more. Here the last surface is both lit and seen.
    fn is_surrounded(&self) -> bool {
        let around = |object: &Object| ["constant", "envmap"].contains(&object.plugin.as_str());
        self.scene.objects.iter().any(around)
    }

    /// Leaves of the lights only what is visible around the scene.
    fn unlight(&mut self) {
        let lights = &mut self.document.lights;
        lights.retain(|light| light.get("type").and_then(Value::as_str) == Some("environment"));
        for light in lights {
            light.insert("samples".to_owned(), Value::Integer(0));
        }
    }

    /// Translates the selected sensor, or the first one.
    fn sensor_of(&mut self, sensors: &[usize]) {
        let selected = match &self.options.camera {
            None => {
                if let [_, second, ..] = *sensors {
                    let at = self.fields(second).at();
                    self.note("sensors after the first", at);
                }
                sensors.first().copied()
            }
            Some(wanted) => {
                let by_id = sensors
                    .iter()
                    .find(|index| self.scene.objects[**index].id.as_ref() == Some(wanted));
                let by_index = || wanted.parse().ok().and_then(|place: usize| sensors.get(place));
                let found = by_id.or_else(by_index).copied();
                if found.is_none() {
                    let message = format!("no sensor is called \"{}\"", shorten(wanted));
                    let help = format!("there are {} sensors; the first has the number 0", sensors.len());
                    self.errors.push(FormatError::anywhere(message).with_help(help));
                }
                found
            }
        };
        if let Some(index) = selected {
            self.sensor(index);
        }
    }

    fn integrator(&mut self, index: usize) -> Option<Table> {
        if !self.enter(index) {
            return None;
        }
        let mut fields = self.fields(index);
        let plugin = fields.object.plugin.as_str();
        let at = fields.at();
        for ignored in [
            "block_size",
            "samples_per_pass",
            "timeout",
            "rr_depth",
            "use_spatial_caching",
        ] {
            fields.take(ignored);
        }
        if self.boolean(&mut fields, "hide_emitters", false) {
            self.note("hide_emitters", at);
        }
        let result = match plugin {
            "direct" => {
                for ignored in ["shading_samples", "emitter_samples", "bsdf_samples"] {
                    fields.take(ignored);
                }
                self.note("integrator direct", at);
                self.opaque_holes = true;
                Some(typed("appel", []))
            }
            "path" | "volpath" | "volpathmis" => {
                self.note(
                    if plugin == "path" {
                        "integrator path"
                    } else {
                        "integrator volpath"
                    },
                    at,
                );
                let depth = self.integer(&mut fields, "max_depth", -1);
                let depth = (depth >= 0).then_some(depth);
                if depth.is_none() {
                    self.note("unlimited max_depth", at);
                }
                self.opaque_holes = plugin == "path";
                self.unlit = depth.is_some_and(|depth| depth < 2);
                if self.unlit {
                    self.note("max_depth below 2", at);
                }
                Some(path(depth.map(|depth| depth - i64::from(!self.is_surrounded()))))
            }
            "aov" => {
                fields.take("aovs");
                self.note("integrator aov", at);
                let inner = self.children(&mut fields, &["integrator"]);
                inner.first().and_then(|(_, index)| self.integrator(*index))
            }
            _ => {
                self.unknown(index);
                fields.used.fill(true);
                None
            }
        };
        self.finish(fields);
        self.leave();
        result
    }

    pub(super) fn sampler(&mut self, index: usize) -> Option<Table> {
        let mut fields = self.fields(index);
        let at = fields.at();
        let known = [
            "independent",
            "stratified",
            "multijitter",
            "orthogonal",
            "ldsampler",
        ];
        if !known.contains(&fields.object.plugin.as_str()) {
            self.unknown(index);
            return None;
        }
        for ignored in ["seed", "jitter", "strength"] {
            fields.take(ignored);
        }
        let count = self.integer(&mut fields, "sample_count", 4);
        self.finish(fields);
        self.note("sampler", at);
        let count = count.clamp(1, MAX_SAMPLES);
        Some(typed("sobol", [("samples", Value::Integer(count))]))
    }

    // Objects.

    pub(super) fn fields(&self, index: usize) -> Fields<'a> {
        let object = &self.scene.objects[index];
        Fields {
            used: vec![false; object.entries.len()],
            object,
        }
    }

    /// Reports the children that were not read.
    pub(super) fn finish(&mut self, fields: Fields<'a>) {
        let object = fields.object;
        for (entry, _) in object
            .entries
            .iter()
            .zip(&fields.used)
            .filter(|(_, used)| !**used)
        {
            let what = match &entry.value {
                Data::Object(index) => {
                    let child = &self.scene.objects[*index];
                    format!("the {} \"{}\"", child.family, shorten(&child.plugin))
                }
                _ => format!("the parameter \"{}\"", shorten(&entry.name)),
            };
            let message = format!(
                "unknown: {what} of the {} \"{}\"",
                object.family,
                shorten(&object.plugin)
            );
            self.error(entry.at, message);
        }
    }

    /// Reports a plugin that is not known.
    pub(super) fn unknown(&mut self, index: usize) {
        let object = &self.scene.objects[index];
        let message = format!(
            "the {} \"{}\" is not supported",
            object.family,
            shorten(&object.plugin)
        );
        self.error(object.at, message);
    }

    /// Whether an object other than the scene refers to this one.
    fn is_used(&self, index: usize) -> bool {
        let refers = |entry: &Entry| matches!(entry.value, Data::Object(other) if other == index);
        let objects = &self.scene.objects[1..];
        objects.iter().any(|object| object.entries.iter().any(refers))
    }

    /// Begins to translate an object; false, with an error, if it contains itself.
    pub(super) fn enter(&mut self, index: usize) -> bool {
        let object = &self.scene.objects[index];
        let name = object.id.as_deref().unwrap_or(&object.plugin);
        if self.open.contains(&index) {
            self.error(
                object.at,
                format!("the {} \"{}\" contains itself", object.family, shorten(name)),
            );
            return false;
        }
        if self.open.len() >= MAX_NESTING {
            self.error(
                object.at,
                format!("objects are nested more than {MAX_NESTING} deep"),
            );
            return false;
        }
        self.open.push(index);
        true
    }

    pub(super) fn leave(&mut self) {
        self.open.pop();
    }

    pub(super) fn error(&mut self, at: At, message: impl Into<String>) {
        let error = FormatError::at(self.scene.place(at), message);
        if self.errors.len() < 1000 && !self.errors.contains(&error) {
            self.errors.push(error);
        }
    }

    pub(super) fn note(&mut self, feature: &str, at: At) {
        let count = self.noted.entry(feature.to_owned()).or_default();
        *count += 1;
        if *count <= MAX_PLACES {
            self.notes.add(FEATURES, feature, self.scene.place(at));
        }
    }

    /// The id of a shared material; equal ones become one.
    pub(super) fn share_material(&mut self, name: &str, table: Table) -> Value {
        let list = &mut self.document.materials;
        let rays = Rays::of_table(&table, &self.rays);
        let id = self.materials.named_id(list, name, table);
        self.rays.insert(id.clone(), rays);
        Value::String(id)
    }

    /// The id of a shared texture; equal ones become one.
    pub(super) fn share_texture(&mut self, name: &str, table: Table) -> Value {
        Value::String(self.textures.id(&mut self.document.textures, name, table))
    }

    // Parameters.

    pub(super) fn wrong(&mut self, entry: &Entry, expected: &str) {
        let message = format!("expected {expected} as \"{}\"", shorten(&entry.name));
        self.error(entry.at, message);
    }

    pub(super) fn optional_number(&mut self, fields: &mut Fields<'a>, name: &str) -> Option<f64> {
        let entry = fields.take(name)?;
        match entry.value {
            Data::Float(value) => Some(value),
            Data::Integer(value) => Some(value as f64),
            _ => {
                self.wrong(entry, "a number");
                None
            }
        }
    }

    pub(super) fn number(&mut self, fields: &mut Fields<'a>, name: &str, default: f64) -> f64 {
        self.optional_number(fields, name).unwrap_or(default)
    }

    pub(super) fn integer(&mut self, fields: &mut Fields<'a>, name: &str, default: i64) -> i64 {
        match fields.take(name) {
            None => default,
            Some(Entry {
                value: Data::Integer(value),
                ..
            }) => *value,
            Some(entry) => {
                self.wrong(entry, "an integer");
                default
            }
        }
    }

    pub(super) fn boolean(&mut self, fields: &mut Fields<'a>, name: &str, default: bool) -> bool {
        match fields.take(name) {
            None => default,
            Some(Entry {
                value: Data::Boolean(value),
                ..
            }) => *value,
            Some(entry) => {
                self.wrong(entry, "true or false");
                default
            }
        }
    }

    pub(super) fn text(&mut self, fields: &mut Fields<'a>, name: &str) -> Option<&'a str> {
        let entry = fields.take(name)?;
        match &entry.value {
            Data::Text(text) => Some(text),
            _ => {
                self.wrong(entry, "a string");
                None
            }
        }
    }

    pub(super) fn vector(&mut self, fields: &mut Fields<'a>, name: &str) -> Option<DVec3> {
        let entry = fields.take(name)?;
        match entry.value {
            Data::Vector(value) => Some(value),
            _ => {
                self.wrong(entry, "a point or vector");
                None
            }
        }
    }

    /// A transform that can be inverted; the identity by default.
    pub(super) fn transform(&mut self, fields: &mut Fields<'a>, name: &str) -> DAffine3 {
        let Some(entry) = fields.take(name) else {
            return DAffine3::IDENTITY;
        };
        let Data::Transform(map) = entry.value else {
            self.wrong(entry, "a transform");
            return DAffine3::IDENTITY;
        };
        let lengths: f64 = [map.x_axis, map.y_axis, map.z_axis]
            .iter()
            .map(|axis| axis.length())
            .product();
        // The rule of the model for transforms.
        if map.matrix3.determinant().abs() <= 1e-15 * lengths {
            self.error(entry.at, format!("\"{}\" cannot be inverted", shorten(name)));
            return DAffine3::IDENTITY;
        }
        map
    }

    /// A file that a parameter names, which must exist.
    pub(super) fn file(&mut self, fields: &mut Fields<'a>, name: &str) -> Option<Named> {
        let Some(entry) = fields.take(name) else {
            let object = fields.object;
            let message = format!("the {} \"{}\" needs \"{name}\"", object.family, object.plugin);
            self.error(object.at, message);
            return None;
        };
        let Data::Text(text) = &entry.value else {
            self.wrong(entry, "a string");
            return None;
        };
        match self.scene.find(self.folder, text) {
            Ok(named) => Some(named),
            Err(message) => {
                self.error(entry.at, message);
                None
            }
        }
    }

    /// A colour that is the same everywhere.
    pub(super) fn color(&mut self, fields: &mut Fields<'a>, name: &str, default: [f64; 3]) -> [f64; 3] {
        let Some(entry) = fields.take(name) else {
            return default;
        };
        match entry.value {
            Data::Color(value) => value,
            Data::Float(value) => [value; 3],
            Data::Integer(value) => [value as f64; 3],
            Data::Object(index) if self.scene.objects[index].family == "texture" => {
                self.constant_texture(index).unwrap_or_else(|| {
                    self.error(
                        entry.at,
                        format!("\"{}\" must not be a texture here", shorten(name)),
                    );
                    default
                })
            }
            _ => {
                self.wrong(entry, "a colour");
                default
            }
        }
    }

    /// The unread children that are objects of these families, or of all; they count as read.
    pub(super) fn children(&self, fields: &mut Fields<'a>, families: &[&str]) -> Vec<(&'a Entry, usize)> {
        let object = fields.object;
        let mut found = Vec::new();
        for (entry, used) in object.entries.iter().zip(&mut fields.used) {
            if let Data::Object(index) = entry.value
                && !*used
                && (families.is_empty() || families.contains(&self.scene.objects[index].family))
            {
                *used = true;
                found.push((entry, index));
            }
        }
        found
    }
}

/// The integrator for paths whose last surface has this number of edges before it.
fn path(depth: Option<i64>) -> Table {
    let bounces = depth.map_or(UNLIMITED_DEPTH, |depth| (depth - 1).clamp(0, 100_000));
    let mut table = typed(
        "whitted",
        [
            ("max_depth", Value::Integer(bounces)),
            ("at_max_depth", Value::String("black".into())),
        ],
    );
    if bounces >= UNLIMITED_DEPTH {
        table.insert("min_contribution".to_owned(), Value::Float(1e-3));
    }
    table
}
