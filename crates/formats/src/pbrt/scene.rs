//! The directives of a file and their graphics state.

use super::FEATURES;
use super::material::Look;
use super::params::{Args, KINDS, Kind, Param, Values};
use super::token::{At, Lexer, Token};
use crate::combine::Rays;
use crate::document::{Document, Ids, Shared, transform};
use crate::files::{self, Folder, Named, shorten};
use crate::part::{self, Part};
use crate::spectrum;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use toml::{Table, Value};
use whitstone_core::transform_steps::rotation;
use whitstone_core::{
    DAffine3, DMat3, DVec3, FormatError, FormatErrors, ImportOptions, Imported, Notes, nearest,
};

/// Most bytes of all files together.
const MAX_BYTES: u64 = 256 << 20;
/// Most files, counted each time that they are included.
const MAX_FILES: usize = 10_000;
/// Files that include each other.
const MAX_INCLUDES: usize = 32;
/// States that `AttributeBegin` and the like keep.
const MAX_STATES: usize = 1024;
/// Most values of a parameter.
const MAX_VALUES: usize = 1 << 22;
/// Most values of all `Attribute` parameters.
const MAX_ATTRIBUTES: usize = 1024;
/// Most shapes, materials, textures and lights.
pub(super) const MAX_OBJECTS: usize = 1 << 20;
/// Most errors and places of a note.
const MAX_REPORTS: usize = 100;
/// Most materials or textures inside each other.
pub(super) const MAX_NESTING: usize = 12;

/// Directives, for the nearest name.
const DIRECTIVES: [&str; 40] = [
    "Accelerator",
    "ActiveTransform",
    "AreaLightSource",
    "Attribute",
    "AttributeBegin",
    "AttributeEnd",
    "Camera",
    "ColorSpace",
    "ConcatTransform",
    "CoordSysTransform",
    "CoordinateSystem",
    "Film",
    "Identity",
    "Import",
    "Include",
    "Integrator",
    "LightSource",
    "LookAt",
    "MakeNamedMaterial",
    "MakeNamedMedium",
    "Material",
    "MediumInterface",
    "NamedMaterial",
    "ObjectBegin",
    "ObjectEnd",
    "ObjectInstance",
    "Option",
    "PixelFilter",
    "ReverseOrientation",
    "Rotate",
    "Sampler",
    "Scale",
    "Shape",
    "Texture",
    "Transform",
    "TransformBegin",
    "TransformEnd",
    "TransformTimes",
    "Translate",
    "WorldBegin",
];

/// Targets of `Attribute`.
const TARGETS: [&str; 5] = ["shape", "light", "material", "medium", "texture"];

/// The emission of an area light.
#[derive(Clone, Debug)]
pub(super) struct Area {
    /// Radiance in W/(m² sr), or its colour if a power is given.
    pub(super) radiance: [f64; 3],
    /// The emitted power in W for a radiance of that colour.
    pub(super) power: Option<f64>,
    pub(super) two_sided: bool,
    pub(super) at: At,
}

/// The graphics state.
#[derive(Clone)]
pub(super) struct State {
    /// World from object; of pbrt's world, before the scene is mirrored.
    pub(super) ctm: DAffine3,
    pub(super) reverse: bool,
    /// The material; none is pbrt's default.
    pub(super) material: Option<Look>,
    pub(super) area: Option<Area>,
    /// Parameters of `Attribute`, by target.
    defaults: Rc<BTreeMap<String, Vec<Param>>>,
    /// Whether transforms apply to the time at which the shutter opens.
    active: bool,
}

/// An open file.
struct Source {
    lexer: Lexer,
    path: PathBuf,
    /// If it is imported: the state before it, and the number of kept states.
    before: Option<(State, usize)>,
}

/// The import of a file.
pub(super) struct Importer<'a> {
    folder: &'a Folder,
    pub(super) options: &'a ImportOptions,
    pub(super) document: Document,
    errors: Vec<FormatError>,
    notes: Notes,
    noted: HashMap<&'static str, usize>,
    /// Names of the files, for places; the imported one is empty.
    names: Vec<String>,
    sources: Vec<Source>,
    bytes: u64,
    peeked: Option<(Token, At)>,
    pub(super) state: State,
    /// Kept states, each with the directive that ends it and its place.
    kept: Vec<(State, &'static str, At)>,
    systems: HashMap<String, DAffine3>,
    /// Place of `WorldBegin`.
    world: Option<At>,
    /// `Film`, `Sampler`, `Integrator`, `PixelFilter`: plugin and parameters.
    settings: BTreeMap<&'static str, (String, Args)>,
    /// `Camera` with camera from world.
    camera: Option<(String, Args, DAffine3)>,
    /// Whether the image shows the world as in a mirror, so that the world is mirrored instead.
    mirrored: Option<bool>,
    /// Factor of all light that follows from the exposure.
    pub(super) exposure: f64,
    /// The open object.
    pub(super) group: Option<(String, Vec<Table>)>,
    outer_bounds: Part,
    groups: HashMap<String, (Option<String>, Part)>,
    pub(super) bounds: Part,
    /// Textures by kind (whether they are of float) and name, and whether they depend on (u, v).
    pub(super) textures: HashMap<(bool, String), (Value, bool, usize)>,
    pub(super) materials: HashMap<String, Look>,
    /// Errors in the definitions of textures and materials that nothing has used so far: they count
    /// with the first use.
    faulty_textures: HashMap<(bool, String), Vec<Fault>>,
    faulty_materials: HashMap<String, Vec<Fault>>,
    replaced: BTreeSet<String>,
    /// Tables of shared materials, by id.
    pub(super) tables: HashMap<String, Table>,
    /// Which rays they continue.
    pub(super) rays: HashMap<String, Rays>,
    pub(super) turned: HashMap<String, Value>,
    shared_materials: Shared,
    shared_textures: Shared,
    group_ids: Ids,
    pub(super) meshes: HashMap<PathBuf, crate::mesh_file::MeshInfo>,
}

/// An error that ends a directive.
pub(super) type Fault = FormatError;

impl<'a> Importer<'a> {
    pub(super) fn new(folder: &'a Folder, options: &'a ImportOptions) -> Self {
        Self {
            folder,
            options,
            document: Document::default(),
            errors: Vec::new(),
            notes: Notes::default(),
            noted: HashMap::new(),
            names: vec![String::new()],
            sources: Vec::new(),
            bytes: 0,
            peeked: None,
            state: State {
                ctm: DAffine3::IDENTITY,
                reverse: false,
                material: None,
                area: None,
                defaults: Rc::default(),
                active: true,
            },
            kept: Vec::new(),
            systems: HashMap::new(),
            world: None,
            settings: BTreeMap::new(),
            camera: None,
            mirrored: None,
            exposure: 1.0,
            group: None,
            outer_bounds: Part::EMPTY,
            groups: HashMap::new(),
            bounds: Part::EMPTY,
            textures: HashMap::new(),
            materials: HashMap::new(),
            faulty_textures: HashMap::new(),
            faulty_materials: HashMap::new(),
            replaced: BTreeSet::new(),
            tables: HashMap::new(),
            rays: HashMap::new(),
            turned: HashMap::new(),
            shared_materials: Shared::new(&options.prefix),
            shared_textures: Shared::new(&options.prefix),
            group_ids: Ids::new(&options.prefix),
            meshes: HashMap::new(),
        }
    }

    pub(super) fn import(mut self, path: &Path) -> Result<Imported, FormatErrors> {
        part::no_selection(self.options, "a pbrt scene")?;
        let text = files::read_main(path, MAX_BYTES)?;
        self.open(text, path.to_owned(), 0, None);
        self.run();
        self.finish()
    }

    fn open(&mut self, text: Vec<u8>, path: PathBuf, file: usize, before: Option<(State, usize)>) {
        self.bytes += text.len() as u64;
        self.sources.push(Source {
            lexer: Lexer::new(text, file),
            path,
            before,
        });
    }

    /// Reads all directives.
    fn run(&mut self) {
        while !self.sources.is_empty() && self.errors.len() < MAX_REPORTS {
            let result = match self.next() {
                Ok(Some((Token::Word(word), at))) => self.directive(&word, at),
                Ok(Some((token, at))) => {
                    let message = format!("expected a directive, found {}", token.shown());
                    Err(self.fault(at, message))
                }
                Ok(None) => {
                    self.close();
                    continue;
                }
                Err(fault) => Err(fault),
            };
            if let Err(fault) = result {
                self.report(fault);
                self.skip();
            }
        }
    }

    /// Closes the current file.
    fn close(&mut self) {
        let Some(source) = self.sources.pop() else {
            return;
        };
        if let Some((state, depth)) = source.before {
            if self.kept.len() != depth {
                let at = source.lexer.at();
                self.error(at, "an imported file must end the attributes that it begins");
                self.kept.truncate(depth);
            }
            self.state = state;
        }
    }

    /// Skips to the next directive.
    fn skip(&mut self) {
        loop {
            match self.next() {
                Ok(Some((Token::Word(word), at))) if DIRECTIVES.contains(&word.as_str()) => {
                    self.peeked = Some((Token::Word(word), at));
                    return;
                }
                Ok(Some(_)) => {}
                Ok(None) => return,
                Err(_) => {
                    // A broken string: the rest of the file cannot be read.
                    self.close();
                    return;
                }
            }
        }
    }

    fn finish(mut self) -> Result<Imported, FormatErrors> {
        if let Some((_, end, at)) = self.kept.first() {
            let message = format!("the file ends before its {end}");
            self.error(*at, message);
        }
        if self.group.is_some() {
            self.errors
                .push(FormatError::anywhere("the file ends before its ObjectEnd"));
        }
        let options = self.options;
        for name in options.materials.keys() {
            if !self.replaced.contains(name) {
                let mut known: Vec<String> = self.materials.keys().cloned().collect();
                known.sort();
                self.errors.push(part::unknown_material(name, &known));
            }
        }
        if !options.part && (self.world.is_some() || self.camera.is_some()) {
            self.view();
        } else if !options.part && self.errors.is_empty() {
            let Part { low, high } = self.bounds;
            self.document.single.push(("film", crate::fit::film()));
            self.document
                .single
                .push(("camera", crate::fit::camera(low, high)));
            if self.document.lights.is_empty() && options.lights {
                self.document.lights = crate::fit::lights(low, high);
            }
        }
        if !self.errors.is_empty() {
            self.errors.truncate(MAX_REPORTS);
            return Err(FormatErrors(self.errors));
        }
        self.document.bound_reflections();
        Ok(Imported {
            text: self.document.to_toml(),
            notes: self.notes.into_sorted(),
            files: Vec::new(),
        })
    }

    /// Adds the film, camera, sampler and integrator.
    fn view(&mut self) {
        let default = |name: &str, plugin: &str| {
            (
                plugin.to_owned(),
                Args::new(name.to_owned(), At::default(), Vec::new(), &[]),
            )
        };
        self.is_mirrored();
        let camera = self.camera.take().unwrap_or_else(|| {
            let (plugin, args) = default("Camera \"perspective\"", "perspective");
            (plugin, args, DAffine3::IDENTITY)
        });
        let mut take = |name: &'static str, plugin: &str| {
            self.settings
                .remove(name)
                .unwrap_or_else(|| default(&format!("{name} \"{plugin}\""), plugin))
        };
        let (film, filter) = (take("Film", "rgb"), take("PixelFilter", "gaussian"));
        let (sampler, integrator) = (take("Sampler", "zsobol"), take("Integrator", "volpath"));
        self.add_camera(camera, film, filter);
        self.add_sampler(sampler);
        self.add_integrator(integrator);
    }

    // Tokens.

    fn lexed<T>(&self, result: Result<T, (At, String)>) -> Result<T, Fault> {
        result.map_err(|(at, message)| self.fault(at, message))
    }

    /// The next token of the current file.
    fn next(&mut self) -> Result<Option<(Token, At)>, Fault> {
        if let Some(token) = self.peeked.take() {
            return Ok(Some(token));
        }
        let Some(source) = self.sources.last_mut() else {
            return Ok(None);
        };
        let result = source.lexer.next();
        self.lexed(result)
    }

    /// The next token, which must exist.
    fn needed(&mut self, expected: &str) -> Result<(Token, At), Fault> {
        match self.next()? {
            Some(token) => Ok(token),
            None => {
                let at = self
                    .sources
                    .last()
                    .map_or(At::default(), |source| source.lexer.at());
                Err(self.fault(at, format!("expected {expected}, found the end of the file")))
            }
        }
    }

    fn text(&mut self, expected: &str) -> Result<(String, At), Fault> {
        match self.needed(expected)? {
            (Token::Text(text), at) => Ok((text, at)),
            (token, at) => {
                let fault = self.fault(
                    at,
                    format!("expected {expected} in quotes, found {}", token.shown()),
                );
                if matches!(token, Token::Word(_)) {
                    self.peeked = Some((token, at));
                }
                Err(fault)
            }
        }
    }

    fn parsed(&self, word: &str, at: At) -> Result<f64, Fault> {
        let starts = word.starts_with(|c: char| c.is_ascii_digit() || matches!(c, '+' | '-' | '.'));
        match word.parse::<f64>() {
            Ok(number) if starts && number.abs() <= f64::from(f32::MAX) => Ok(number),
            Ok(_) if starts => Err(self.fault(at, format!("the number `{}` is out of range", shorten(word)))),
            _ => Err(self.fault(at, format!("expected a number, found `{}`", shorten(word)))),
        }
    }

    /// Numbers after a directive, with or without brackets.
    fn numbers<const N: usize>(&mut self) -> Result<[f64; N], Fault> {
        let expected = format!("{N} numbers");
        let mut found = [0.0; N];
        let first = self.needed(&expected)?;
        let bracket = first.0 == Token::Open;
        if !bracket {
            self.peeked = Some(first);
        }
        for value in &mut found {
            *value = match self.needed(&expected)? {
                (Token::Word(word), at) => match self.parsed(&word, at) {
                    Ok(number) => number,
                    Err(fault) => {
                        self.peeked = Some((Token::Word(word), at));
                        return Err(fault);
                    }
                },
                (token, at) => {
                    return Err(self.fault(at, format!("expected {expected}, found {}", token.shown())));
                }
            };
        }
        if bracket {
            match self.needed("`]`")? {
                (Token::Close, _) => {}
                (token, at) => return Err(self.fault(at, format!("expected `]`, found {}", token.shown()))),
            }
        }
        Ok(found)
    }

    /// A parameter list.
    fn params(&mut self) -> Result<Vec<Param>, Fault> {
        let mut params: Vec<Param> = Vec::new();
        loop {
            let (text, at) = match self.next()? {
                Some((Token::Text(text), at)) => (text, at),
                Some(token @ (Token::Word(_), _)) => {
                    self.peeked = Some(token);
                    return Ok(params);
                }
                Some((token, at)) => {
                    let message = format!("expected a parameter or a directive, found {}", token.shown());
                    return Err(self.fault(at, message));
                }
                None => return Ok(params),
            };
            let words: Vec<&str> = text.split_ascii_whitespace().collect();
            let [kind_word, name] = words[..] else {
                let message = format!(
                    "expected \"type name\" of a parameter, found \"{}\"",
                    shorten(&text)
                );
                return Err(self.fault(at, message));
            };
            let Some((_, kind)) = KINDS.iter().find(|(word, _)| *word == kind_word) else {
                let message = format!("unknown type of parameter \"{}\"", shorten(kind_word));
                let near = nearest(kind_word, KINDS.iter().map(|(word, _)| *word));
                return Err(with_nearest(self.fault(at, message), near));
            };
            if params.iter().any(|param| param.name == name) {
                return Err(self.fault(at, format!("the parameter \"{}\" is given twice", shorten(name))));
            }
            let name = name.to_owned();
            let values = self.values(*kind, &name)?;
            params.push(Param {
                kind: *kind,
                name,
                values,
                at,
            });
        }
    }

    /// The values of a parameter.
    fn values(&mut self, kind: Kind, name: &str) -> Result<Values, Fault> {
        let expected = format!("a value of \"{}\"", shorten(name));
        let (first, start) = self.needed(&expected)?;
        let list = first == Token::Open;
        let mut token = (first, start);
        let (mut numbers, mut texts, mut bools) = (Vec::new(), Vec::new(), Vec::new());
        if list {
            token = self.needed(&expected)?;
        }
        loop {
            let at = token.1;
            match token.0 {
                Token::Close if list => break,
                Token::Word(word) if kind == Kind::Bool => match word.as_str() {
                    "true" => bools.push(true),
                    "false" => bools.push(false),
                    _ => {
                        let message = format!("expected true or false, found `{}`", shorten(&word));
                        return Err(self.fault(at, message));
                    }
                },
                Token::Text(word) if kind == Kind::Bool => bools.push(word == "true"),
                Token::Text(text) if matches!(kind, Kind::Text | Kind::Texture | Kind::Spectrum) => {
                    texts.push(text);
                }
                Token::Word(word) if !matches!(kind, Kind::Text | Kind::Texture) => {
                    match self.parsed(&word, at) {
                        Ok(number) => numbers.push(number),
                        Err(fault) => {
                            self.peeked = Some((Token::Word(word), at));
                            return Err(fault);
                        }
                    }
                }
                token => {
                    let message = format!("expected {expected}, a {}, found {}", kind.word(), token.shown());
                    return Err(self.fault(at, message));
                }
            }
            if numbers.len() + texts.len() + bools.len() > MAX_VALUES {
                return Err(self.fault(at, format!("more than {MAX_VALUES} values")));
            }
            if !list {
                break;
            }
            token = self.needed("`]`")?;
        }
        let values = match kind {
            Kind::Bool => Values::Bools(bools),
            Kind::Text | Kind::Texture => Values::Texts(texts),
            Kind::Spectrum if !texts.is_empty() => Values::Texts(texts),
            _ => Values::Numbers(numbers),
        };
        let count = values.len();
        if count == 0 || !count.is_multiple_of(kind.width()) {
            let message = format!(
                "\"{}\" has {count} values, which are no {}",
                shorten(name),
                kind.word()
            );
            return Err(self.fault(start, message));
        }
        if kind == Kind::Integer
            && let Values::Numbers(numbers) = &values
            && let Some(wrong) = numbers
                .iter()
                .find(|number| number.fract() != 0.0 || number.abs() > f64::from(i32::MAX))
        {
            let message = format!(
                "expected an integer of 32 bits in \"{}\", found {wrong}",
                shorten(name)
            );
            return Err(self.fault(start, message));
        }
        Ok(values)
    }

    /// A plugin and its parameters.
    fn plugin(&mut self, directive: &str, target: Option<&str>, at: At) -> Result<(String, Args), Fault> {
        let (plugin, _) = self.text("a type")?;
        let params = self.params()?;
        let what = format!("{directive} \"{}\"", shorten(&plugin));
        let defaults = Rc::clone(&self.state.defaults);
        let defaults = target.and_then(|target| defaults.get(target));
        let args = Args::new(what, at, params, defaults.map_or(&[], Vec::as_slice));
        Ok((plugin, args))
    }

    // Directives.

    fn directive(&mut self, word: &str, at: At) -> Result<(), Fault> {
        match word {
            // As in pbrt-v4, where `TransformBegin` and `TransformEnd` are old names of these.
            "AttributeBegin" | "TransformBegin" => {
                if self.kept.len() >= MAX_STATES {
                    return Err(
                        self.fault(at, format!("more than {MAX_STATES} attributes inside each other"))
                    );
                }
                self.kept.push((self.state.clone(), "AttributeEnd", at));
            }
            "AttributeEnd" | "TransformEnd" => {
                let Some((state, _, _)) = self.kept.pop_if(|(_, end, _)| *end == "AttributeEnd") else {
                    let begin = word.replace("End", "Begin");
                    return Err(self.fault(at, format!("{word} without {begin}")));
                };
                self.state = state;
            }
            "Identity" => self.set(DAffine3::IDENTITY),
            "Translate" => {
                let by = DVec3::from(self.numbers()?);
                self.concat(DAffine3::from_translation(by));
            }
            "Scale" => {
                let by = DVec3::from(self.numbers()?);
                self.concat(DAffine3::from_scale(by));
            }
            "Rotate" => {
                let [degrees, x, y, z] = self.numbers()?;
                let Some(axis) = DVec3::new(x, y, z).try_normalize() else {
                    return Err(self.fault(at, "the axis of a rotation must not be zero"));
                };
                self.concat(DAffine3::from_mat3(rotation(axis, degrees)));
            }
            "LookAt" => {
                let [ex, ey, ez, lx, ly, lz, ux, uy, uz] = self.numbers()?;
                let eye = DVec3::new(ex, ey, ez);
                let forward = (DVec3::new(lx, ly, lz) - eye).try_normalize();
                let up = DVec3::new(ux, uy, uz).try_normalize();
                let right = forward
                    .zip(up)
                    .and_then(|(forward, up)| up.cross(forward).try_normalize());
                let Some((forward, right)) = forward.zip(right) else {
                    let message = "the eye and the target of LookAt must differ, and up must not be parallel";
                    return Err(self.fault(at, message));
                };
                let axes = DMat3::from_cols(right, forward.cross(right), forward);
                let world_from_camera = DAffine3::from_mat3_translation(axes, eye);
                self.concat(world_from_camera.inverse());
            }
            "Transform" => {
                let map = self.matrix(at)?;
                self.set(map);
            }
            "ConcatTransform" => {
                let map = self.matrix(at)?;
                self.concat(map);
            }
            "CoordinateSystem" => {
                let (name, _) = self.text("a name")?;
                self.systems.insert(name, self.state.ctm);
            }
            "CoordSysTransform" => {
                let (name, at) = self.text("the name of a coordinate system")?;
                match self.systems.get(&name) {
                    Some(map) => self.set(*map),
                    None => {
                        let message = format!("no coordinate system is called \"{}\"", shorten(&name));
                        let near = nearest(&name, self.systems.keys().map(String::as_str));
                        return Err(with_nearest(self.fault(at, message), near));
                    }
                }
            }
            "ReverseOrientation" => self.state.reverse = !self.state.reverse,
            "ActiveTransform" => match self.needed("StartTime, EndTime or All")? {
                (Token::Word(word), _) if word == "StartTime" || word == "All" => self.state.active = true,
                (Token::Word(word), at) if word == "EndTime" => {
                    self.state.active = false;
                    self.note("ActiveTransform, TransformTimes", at);
                }
                (token, at) => {
                    let message = format!("expected StartTime, EndTime or All, found {}", token.shown());
                    return Err(self.fault(at, message));
                }
            },
            "TransformTimes" => {
                self.numbers::<2>()?;
                self.note("ActiveTransform, TransformTimes", at);
            }
            "ColorSpace" => {
                let (name, at) = self.text("a color space")?;
                if name != "srgb" {
                    let message = format!("the color space \"{}\" is not supported", shorten(&name));
                    return Err(self.fault(at, message).with_help("colors must be linear sRGB"));
                }
            }
            "Option" => self.option(at)?,
            "Film" | "Sampler" | "Integrator" | "PixelFilter" | "Accelerator" => {
                let (plugin, args) = self.plugin(word, None, at)?;
                self.before_world(word, at);
                let name = DIRECTIVES.iter().find(|name| **name == word).copied();
                match name {
                    Some("Accelerator") | None => {
                        let known = ["bvh", "kdtree"];
                        if !known.contains(&plugin.as_str()) {
                            self.unknown_plugin("accelerator", &plugin, &known, at);
                        }
                    }
                    Some(name) => drop(self.settings.insert(name, (plugin, args))),
                }
            }
            "Camera" => {
                let (plugin, args) = self.plugin(word, None, at)?;
                self.before_world(word, at);
                let map = self.state.ctm;
                if !self.can_invert(&map) {
                    return Err(self.fault(at, "the transform of the camera cannot be inverted"));
                }
                self.systems.insert("camera".to_owned(), map.inverse());
                self.camera = Some((plugin, args, map));
            }
            "WorldBegin" => {
                self.before_world(word, at);
                self.world = Some(at);
                self.is_mirrored();
                let empty = || Args::new(String::new(), at, Vec::new(), &[]);
                let camera = self
                    .camera
                    .as_ref()
                    .map_or_else(empty, |(_, args, _)| args.clone());
                let film = self
                    .settings
                    .get("Film")
                    .map_or_else(empty, |(_, args)| args.clone());
                self.exposure = self.exposure_of(&camera, &film);
                self.state.ctm = DAffine3::IDENTITY;
                self.state.active = true;
                self.systems.insert("world".to_owned(), DAffine3::IDENTITY);
            }
            "Attribute" => self.attribute(at)?,
            "MediumInterface" => {
                self.text("the name of a medium")?;
                if let Some(token) = self.next()?
                    && !matches!(token.0, Token::Text(_))
                {
                    self.peeked = Some(token);
                }
                self.note("MakeNamedMedium, MediumInterface", at);
            }
            "MakeNamedMedium" => {
                self.plugin(word, Some("medium"), at)?;
                self.note("MakeNamedMedium, MediumInterface", at);
            }
            "Material" => {
                let (plugin, args) = self.plugin(word, Some("material"), at)?;
                let look = self.material(&plugin, None, args);
                self.state.material = Some(look);
            }
            "MakeNamedMaterial" => {
                let (name, mut args) = self.plugin(word, Some("material"), at)?;
                if self.materials.contains_key(&name) {
                    return Err(self.fault(at, format!("the material \"{}\" is given twice", shorten(&name))));
                }
                let Some(plugin) = self.optional_text(&mut args, "type") else {
                    return Err(self.fault(at, format!("{} needs \"string type\"", args.what)));
                };
                args.what = format!("Material \"{}\"", shorten(&plugin));
                let before = self.errors.len();
                let look = match self.options.materials.get(&name) {
                    Some(own) => {
                        self.replaced.insert(name.clone());
                        Look::of(Value::String(own.clone()))
                    }
                    None => self.material(&plugin, Some(&name), args),
                };
                let faults = self.errors.split_off(before);
                if !faults.is_empty() {
                    self.faulty_materials.insert(name.clone(), faults);
                }
                self.materials.insert(name, look);
            }
            "NamedMaterial" => {
                let (name, at) = self.text("the name of a material")?;
                let look = self.named_material(&name, at)?;
                self.state.material = Some(look);
            }
            "Texture" => {
                let (name, _) = self.text("a name")?;
                let (kind, kind_at) = self.text("a type")?;
                let (class, args) = self.plugin(word, Some("texture"), at)?;
                let float = match kind.as_str() {
                    "float" => true,
                    "spectrum" => false,
                    _ => {
                        let message = format!("unknown type of texture \"{}\"", shorten(&kind));
                        let near = nearest(&kind, ["float", "spectrum"]);
                        return Err(with_nearest(self.fault(kind_at, message), near));
                    }
                };
                if self.textures.contains_key(&(float, name.clone())) {
                    return Err(self.fault(at, format!("the texture \"{}\" is given twice", shorten(&name))));
                }
                let before = self.errors.len();
                let texture = self.texture(&name, float, &class, args);
                let faults = self.errors.split_off(before);
                if !faults.is_empty() {
                    self.faulty_textures.insert((float, name.clone()), faults);
                }
                self.textures.insert((float, name), texture);
            }
            "LightSource" => {
                let (plugin, args) = self.plugin(word, Some("light"), at)?;
                self.light(&plugin, args);
            }
            "AreaLightSource" => {
                let (plugin, args) = self.plugin(word, Some("light"), at)?;
                self.state.area = self.area(&plugin, args);
            }
            "Shape" => {
                let (plugin, args) = self.plugin(word, Some("shape"), at)?;
                self.shape(&plugin, args);
            }
            "ObjectBegin" => {
                let (name, _) = self.text("a name")?;
                if self.kept.len() >= MAX_STATES || self.group.is_some() {
                    return Err(self.fault(at, "an object must not begin inside another one"));
                }
                if self.groups.contains_key(&name) {
                    return Err(self.fault(at, format!("the object \"{}\" is given twice", shorten(&name))));
                }
                self.kept.push((self.state.clone(), "ObjectEnd", at));
                self.outer_bounds = std::mem::replace(&mut self.bounds, Part::EMPTY);
                self.group = Some((name, Vec::new()));
            }
            "ObjectEnd" => {
                if self.kept.last().is_none_or(|(_, end, _)| *end != "ObjectEnd") {
                    return Err(self.fault(at, "ObjectEnd without ObjectBegin"));
                }
                if let (Some((state, _, _)), Some((name, shapes))) = (self.kept.pop(), self.group.take()) {
                    self.state = state;
                    let bounds = std::mem::replace(&mut self.bounds, self.outer_bounds);
                    let id = (!shapes.is_empty()).then(|| self.group_ids.unique(&name));
                    if let Some(id) = &id {
                        self.document.groups.push((id.clone(), shapes));
                    }
                    self.groups.insert(name, (id, bounds));
                }
            }
            "ObjectInstance" => {
                let (name, name_at) = self.text("the name of an object")?;
                self.instance(&name, name_at)?;
            }
            "Include" | "Import" => {
                let (name, at) = self.text("a file name")?;
                self.include(&name, word == "Import", at)?;
            }
            _ => {
                let message = format!("unknown directive `{}`", shorten(word));
                let near = nearest(word, DIRECTIVES);
                let mut fault = with_nearest(self.fault(at, message), near);
                if word == "WorldEnd" {
                    fault = fault.with_help("the file is for pbrt-v3: convert it with `pbrt --upgrade`");
                }
                return Err(fault);
            }
        }
        Ok(())
    }

    fn set(&mut self, map: DAffine3) {
        if self.state.active {
            self.state.ctm = map;
        }
    }

    fn concat(&mut self, map: DAffine3) {
        self.set(self.state.ctm * map);
    }

    /// Sixteen numbers, column by column.
    fn matrix(&mut self, at: At) -> Result<DAffine3, Fault> {
        let m: [f64; 16] = self.numbers()?;
        if [m[3], m[7], m[11], m[15]] != [0.0, 0.0, 0.0, 1.0] {
            return Err(self.fault(at, "the last row of a transform must be 0 0 0 1"));
        }
        let column = |i: usize| DVec3::new(m[i], m[i + 1], m[i + 2]);
        let matrix = DMat3::from_cols(column(0), column(4), column(8));
        Ok(DAffine3::from_mat3_translation(matrix, column(12)))
    }

    fn option(&mut self, at: At) -> Result<(), Fault> {
        const IGNORED: [&str; 10] = [
            "disablepixeljitter",
            "disabletexturefiltering",
            "disablewavelengthjitter",
            "displacementedgescale",
            "msereferenceimage",
            "msereferenceout",
            "rendercoordsys",
            "seed",
            "pixelstats",
            "wavefront",
        ];
        let (written, name_at) = self.text("the name of an option")?;
        match self.needed("a value")? {
            (Token::Text(_) | Token::Word(_), _) => {}
            (token, at) => return Err(self.fault(at, format!("expected a value, found {}", token.shown()))),
        }
        // The names are compared without underscores and case.
        let name = written.to_ascii_lowercase().replace('_', "");
        if name == "forcediffuse" {
            self.note("Option forcediffuse", at);
        } else if !IGNORED.contains(&name.as_str()) {
            let message = format!("unknown option \"{}\"", shorten(&written));
            let fault = with_nearest(self.fault(name_at, message), nearest(&name, IGNORED));
            self.report(fault);
        }
        Ok(())
    }

    fn attribute(&mut self, at: At) -> Result<(), Fault> {
        let (target, target_at) = self.text("a target")?;
        let params = self.params()?;
        if !TARGETS.contains(&target.as_str()) {
            let message = format!("unknown target of Attribute: \"{}\"", shorten(&target));
            return Err(with_nearest(
                self.fault(target_at, message),
                nearest(&target, TARGETS),
            ));
        }
        let mut defaults = (*self.state.defaults).clone();
        let list = defaults.entry(target).or_default();
        list.retain(|old| params.iter().all(|param| param.name != old.name));
        list.extend(params);
        let count: usize = defaults.values().flatten().map(|param| param.values.len()).sum();
        if count > MAX_ATTRIBUTES {
            return Err(self.fault(at, format!("more than {MAX_ATTRIBUTES} values of attributes")));
        }
        self.state.defaults = Rc::new(defaults);
        Ok(())
    }

    /// Reports a directive that must come before the world.
    fn before_world(&mut self, word: &str, at: At) {
        if self.world.is_some() {
            self.error(at, format!("{word} must come before WorldBegin"));
        }
    }

    fn include(&mut self, name: &str, import: bool, at: At) -> Result<(), Fault> {
        let Some(named) = self.found(name, at) else {
            return Ok(());
        };
        if name.ends_with(".gz") {
            let fault = self.fault(at, "compressed files are not read");
            return Err(fault.with_help("uncompress it with gunzip"));
        }
        if self.sources.len() >= MAX_INCLUDES || self.names.len() >= MAX_FILES {
            let message = format!("more than {MAX_INCLUDES} files inside each other, or {MAX_FILES} files");
            return Err(self.fault(at, message));
        }
        let same = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let path = same(&named.path);
        if self.sources.iter().any(|source| same(&source.path) == path) {
            return Err(self.fault(at, format!("\"{}\" includes itself", shorten(name))));
        }
        let text = match files::read(&named.path, MAX_BYTES - self.bytes.min(MAX_BYTES)) {
            Ok(text) => text,
            Err(problem) => {
                return Err(self.fault(at, format!("cannot read \"{}\": {problem}", shorten(name))));
            }
        };
        let file = self.names.len();
        self.names.push(named.relative);
        let before = import.then(|| (self.state.clone(), self.kept.len()));
        self.open(text, named.path, file, before);
        Ok(())
    }

    fn instance(&mut self, name: &str, at: At) -> Result<(), Fault> {
        let Some((id, bounds)) = self.groups.get(name).cloned() else {
            let message = format!("no object is called \"{}\"", shorten(name));
            let near = nearest(name, self.groups.keys().map(String::as_str));
            return Err(with_nearest(self.fault(at, message), near));
        };
        if self.group.is_some() {
            return Err(self.fault(at, "an object must not contain an instance"));
        }
        let Some(id) = id else {
            // It has no visible shapes.
            return Ok(());
        };
        let map = self.placed();
        let mut table = crate::document::typed("instance", [("group", Value::String(id))]);
        self.place(&mut table, &map, at);
        self.bound(&map, bounds.low, bounds.high);
        self.push_shape(table, at);
        Ok(())
    }

    // What the directives share.

    /// The transform of what is placed now: of the world, or of the open object.
    pub(super) fn placed(&mut self) -> DAffine3 {
        if self.group.is_some() {
            self.state.ctm
        } else {
            self.world_map() * self.state.ctm
        }
    }

    /// From pbrt's world to that of the result.
    pub(super) fn world_map(&mut self) -> DAffine3 {
        if self.is_mirrored() {
            self.options.transform * DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0))
        } else {
            self.options.transform
        }
    }

    /// Whether the camera of the file shows the world as in a mirror. pbrt's camera space is
    /// left-handed; a file without a camera is taken as it is.
    fn is_mirrored(&mut self) -> bool {
        let (camera, world) = (&self.camera, self.world);
        *self.mirrored.get_or_insert_with(|| match camera {
            Some((plugin, _, map)) => (map.matrix3.determinant() > 0.0) != (plugin == "spherical"),
            None => world.is_some(),
        })
    }

    pub(super) fn can_invert(&self, map: &DAffine3) -> bool {
        let lengths: f64 = [map.x_axis, map.y_axis, map.z_axis]
            .iter()
            .map(|axis| axis.length())
            .product();
        // The rule of the model for transforms.
        map.is_finite() && lengths.is_finite() && map.matrix3.determinant().abs() > 1e-15 * lengths
    }

    /// Sets the key `transform`.
    pub(super) fn place(&mut self, table: &mut Table, map: &DAffine3, at: At) {
        if !self.can_invert(map) {
            self.error(
                at,
                "the transform cannot be inverted or has numbers that are too large",
            );
        } else if *map != DAffine3::IDENTITY {
            table.insert("transform".to_owned(), transform(map));
        }
    }

    pub(super) fn bound(&mut self, map: &DAffine3, low: DVec3, high: DVec3) {
        let placed = Part { low, high }.transformed(map);
        self.bounds.add(placed.low);
        self.bounds.add(placed.high);
    }

    /// Adds a shape to the world or to the open object.
    pub(super) fn push_shape(&mut self, table: Table, at: At) {
        let list = match &mut self.group {
            Some((_, shapes)) => shapes,
            None => &mut self.document.shapes,
        };
        if list.len() >= MAX_OBJECTS {
            let message = format!("more than {MAX_OBJECTS} shapes");
            self.error(at, message);
        } else {
            list.push(table);
        }
    }

    pub(super) fn push_light(&mut self, table: Table, at: At) {
        if self.document.lights.len() >= MAX_OBJECTS {
            self.error(at, format!("more than {MAX_OBJECTS} lights"));
        } else if self.options.lights {
            self.document.lights.push(table);
        }
    }

    pub(super) fn named_material(&mut self, name: &str, at: At) -> Result<Look, Fault> {
        if let Some(look) = self.materials.get(name).cloned() {
            let faults = self.faulty_materials.get(name).cloned();
            faults.into_iter().flatten().for_each(|fault| self.report(fault));
            return Ok(look);
        }
        if name == "interface" {
            return Ok(Look::interface());
        }
        let message = format!("no material is called \"{}\" here", shorten(name));
        let near = nearest(name, self.materials.keys().map(String::as_str));
        Err(with_nearest(self.fault(at, message), near))
    }

    /// The id of a shared material; equal ones become one.
    pub(super) fn share_material(&mut self, name: &str, table: Table) -> Value {
        let id = self
            .shared_materials
            .id(&mut self.document.materials, name, table.clone());
        self.rays.insert(id.clone(), Rays::of_table(&table, &self.rays));
        self.tables.insert(id.clone(), table);
        Value::String(id)
    }

    pub(super) fn share_texture(&mut self, name: &str, table: Table) -> Value {
        Value::String(self.shared_textures.id(&mut self.document.textures, name, table))
    }

    /// A place for messages.
    fn place_of(&self, at: At) -> String {
        let name = self.names.get(at.file).map_or("", String::as_str);
        match (name, at.line) {
            (_, 0) => String::new(),
            ("", _) => format!("{}:{}", at.line, at.column),
            _ => format!("{name}:{}:{}", at.line, at.column),
        }
    }

    pub(super) fn fault(&self, at: At, message: impl Into<String>) -> Fault {
        FormatError::at(self.place_of(at), message)
    }

    pub(super) fn report(&mut self, fault: Fault) {
        if self.errors.len() < MAX_REPORTS && !self.errors.contains(&fault) {
            self.errors.push(fault);
        }
    }

    pub(super) fn error(&mut self, at: At, message: impl Into<String>) {
        let fault = self.fault(at, message);
        self.report(fault);
    }

    pub(super) fn note(&mut self, feature: &'static str, at: At) {
        let count = self.noted.entry(feature).or_default();
        *count += 1;
        if *count <= MAX_REPORTS {
            let place = self.place_of(at);
            self.notes.add(FEATURES, feature, place);
        }
    }

    pub(super) fn unknown_plugin(&mut self, family: &str, name: &str, known: &[&str], at: At) {
        let message = format!("the {family} \"{}\" is not supported", shorten(name));
        let fault = with_nearest(self.fault(at, message), nearest(name, known.iter().copied()));
        self.report(fault);
    }

    /// Reports the parameters that were not read.
    pub(super) fn done(&mut self, args: Args) {
        for (at, message, near) in args.unknown() {
            let fault = with_nearest(self.fault(at, message), near);
            self.report(fault);
        }
    }

    // Parameters.

    fn wrong(&mut self, param: &Param, expected: &str) {
        let found = param.kind.word();
        let message = format!(
            "expected {expected} as \"{}\", found {found}",
            shorten(&param.name)
        );
        self.error(param.at, message);
    }

    /// Numbers of one of these types.
    pub(super) fn list(&mut self, args: &mut Args, name: &'static str, kinds: &[Kind]) -> Option<Vec<f64>> {
        let param = args.take(name)?;
        match param.values {
            Values::Numbers(numbers) if kinds.contains(&param.kind) => Some(numbers),
            _ => {
                let expected = kinds.first().map_or("", |kind| kind.word());
                self.wrong(&param, expected);
                None
            }
        }
    }

    pub(super) fn optional_number(&mut self, args: &mut Args, name: &'static str) -> Option<f64> {
        let numbers = self.list(args, name, &[Kind::Float, Kind::Integer])?;
        if let [number] = numbers[..] {
            return Some(number);
        }
        self.error(
            args.at,
            format!("expected one number as \"{name}\", found {}", numbers.len()),
        );
        None
    }

    pub(super) fn number(&mut self, args: &mut Args, name: &'static str, default: f64) -> f64 {
        self.optional_number(args, name).unwrap_or(default)
    }

    pub(super) fn integer(&mut self, args: &mut Args, name: &'static str, default: i64) -> i64 {
        match self.list(args, name, &[Kind::Integer]).as_deref() {
            None => default,
            Some([number]) => *number as i64,
            Some(numbers) => {
                let count = numbers.len();
                self.error(
                    args.at,
                    format!("expected one integer as \"{name}\", found {count}"),
                );
                default
            }
        }
    }

    pub(super) fn boolean(&mut self, args: &mut Args, name: &'static str, default: bool) -> bool {
        let Some(param) = args.take(name) else {
            return default;
        };
        match &param.values {
            Values::Bools(values) if values.len() == 1 => values[0],
            _ => {
                self.wrong(&param, "bool");
                default
            }
        }
    }

    pub(super) fn optional_text(&mut self, args: &mut Args, name: &'static str) -> Option<String> {
        let param = args.take(name)?;
        match &param.values {
            Values::Texts(values) if values.len() == 1 && param.kind == Kind::Text => Some(values[0].clone()),
            _ => {
                self.wrong(&param, "string");
                None
            }
        }
    }

    pub(super) fn point(&mut self, args: &mut Args, name: &'static str, default: DVec3) -> DVec3 {
        match self.list(args, name, &[Kind::Point3, Kind::Vector3]).as_deref() {
            None => default,
            Some([x, y, z]) => DVec3::new(*x, *y, *z),
            Some(_) => {
                self.error(args.at, format!("expected one point as \"{name}\""));
                default
            }
        }
    }

    /// Points, vectors or normals.
    pub(super) fn points(&mut self, args: &mut Args, name: &'static str, kind: Kind) -> Option<Vec<DVec3>> {
        let numbers = self.list(args, name, &[kind])?;
        let triples: &[[f64; 3]] = numbers.as_chunks().0;
        Some(triples.iter().map(|triple| DVec3::from(*triple)).collect())
    }

    fn found(&mut self, name: &str, at: At) -> Option<Named> {
        match self.folder.find("", name) {
            Ok(named) => Some(named),
            Err(message) => {
                self.error(at, message);
                None
            }
        }
    }

    /// A file that a parameter names.
    pub(super) fn file(&mut self, args: &mut Args, name: &'static str) -> Option<Named> {
        let Some(text) = self.optional_text(args, name) else {
            self.error(args.at, format!("{} needs \"string {name}\"", args.what));
            return None;
        };
        let named = self.found(&text, args.at)?;
        if !named.path.is_file() {
            self.error(
                args.at,
                format!("cannot read \"{}\": there is no such file", shorten(&text)),
            );
            return None;
        }
        Some(named)
    }

    /// A colour: of a light, normalised to luminance 1 where it is no RGB, or of a surface.
    pub(super) fn color(&mut self, args: &mut Args, name: &'static str, is_light: bool) -> Option<[f64; 3]> {
        let param = args.take(name)?;
        match (&param.values, param.kind) {
            (Values::Numbers(numbers), Kind::Rgb) => {
                let Ok(rgb) = <[f64; 3]>::try_from(numbers.as_slice()) else {
                    self.wrong(&param, "one color");
                    return None;
                };
                if rgb.iter().any(|value| *value < 0.0) {
                    self.error(param.at, format!("\"{name}\" must not be negative"));
                    return None;
                }
                Some(rgb)
            }
            (Values::Numbers(numbers), Kind::Blackbody) => {
                if let [kelvin] = numbers[..]
                    && kelvin > 0.0
                {
                    self.note("blackbody", param.at);
                    return Some(spectrum::blackbody(kelvin));
                }
                self.error(param.at, "expected one temperature above 0 in kelvin");
                None
            }
            (Values::Numbers(numbers), Kind::Spectrum) => {
                let samples = self.samples(numbers, param.at)?;
                Some(if is_light {
                    samples.light()
                } else {
                    samples.color()
                })
            }
            (Values::Texts(texts), Kind::Spectrum) => {
                let text = texts.first().map_or("", String::as_str);
                if is_light && text == "stdillum-D65" {
                    return Some([1.0; 3]);
                }
                if !is_light && let Some((metal, is_k)) = spectrum::metal(text) {
                    return Some(spectrum::metal_color(metal, is_k));
                }
                self.unknown_spectrum(text, param.at);
                None
            }
            _ => {
                self.wrong(&param, "rgb");
                None
            }
        }
    }

    /// The samples of a spectrum, if they are in order.
    fn samples<'n>(&mut self, numbers: &'n [f64], at: At) -> Option<spectrum::Sampled<'n>> {
        let pairs: &[[f64; 2]] = numbers.as_chunks().0;
        let ordered = pairs.is_sorted_by(|a, b| a[0] < b[0]);
        if !ordered || !numbers.len().is_multiple_of(2) || pairs.iter().flatten().any(|value| *value < 0.0) {
            self.error(
                at,
                "expected pairs of a wavelength, ascending, and a value, none negative",
            );
            return None;
        }
        let samples = spectrum::Sampled(numbers);
        if samples.constant().is_none() {
            self.note("sampled spectra", at);
        }
        Some(samples)
    }

    pub(super) fn unknown_spectrum(&mut self, name: &str, at: At) {
        let metals = [
            "metal-Ag-eta",
            "metal-Ag-k",
            "metal-Al-eta",
            "metal-Al-k",
            "metal-Au-eta",
            "metal-Au-k",
        ];
        let known = spectrum::glasses()
            .chain(metals)
            .chain(["metal-Cu-eta", "metal-Cu-k", "stdillum-D65"]);
        let message = format!("the spectrum \"{}\" is not supported here", shorten(name));
        let fault = with_nearest(self.fault(at, message), nearest(name, known));
        self.report(fault);
    }

    /// An index of refraction: a number, a named glass or a spectrum at one wavelength.
    pub(super) fn ior(&mut self, args: &mut Args, name: &'static str) -> f64 {
        const DEFAULT: f64 = 1.5;
        let Some(param) = args.take(name) else {
            return DEFAULT;
        };
        let value = match (&param.values, param.kind) {
            (Values::Numbers(numbers), Kind::Float | Kind::Integer) if numbers.len() == 1 => Some(numbers[0]),
            (Values::Numbers(numbers), Kind::Spectrum) => self.samples(numbers, param.at).map(|samples| {
                let constant = samples.constant();
                constant.unwrap_or_else(|| samples.at(spectrum::YELLOW))
            }),
            (Values::Texts(texts), Kind::Spectrum) => {
                let text = texts.first().map_or("", String::as_str);
                let glass = spectrum::glass(text);
                match glass {
                    Some(_) => self.note("named glasses", param.at),
                    None => self.unknown_spectrum(text, param.at),
                }
                glass
            }
            _ => {
                self.wrong(&param, "float or spectrum");
                None
            }
        };
        let value = value.unwrap_or(DEFAULT);
        if value <= 0.0 {
            self.error(param.at, format!("\"{name}\" must be above 0"));
            return DEFAULT;
        }
        value
    }

    /// A colour or a texture, and whether it depends on (u, v).
    pub(super) fn texture_or_color(
        &mut self,
        args: &mut Args,
        name: &'static str,
        default: f64,
    ) -> (Value, bool, usize) {
        if let Some(found) = self.named_texture(args, name, false) {
            return found;
        }
        let value = self.color(args, name, false).unwrap_or([default; 3]);
        (crate::document::color(value), false, 0)
    }

    /// A number or a texture of numbers.
    pub(super) fn texture_or_number(
        &mut self,
        args: &mut Args,
        name: &'static str,
        default: f64,
    ) -> (Value, bool, usize) {
        if let Some(found) = self.named_texture(args, name, true) {
            return found;
        }
        (Value::Float(self.number(args, name, default)), false, 0)
    }

    /// The texture that a parameter of type texture names.
    pub(super) fn named_texture(
        &mut self,
        args: &mut Args,
        name: &'static str,
        float: bool,
    ) -> Option<(Value, bool, usize)> {
        let is_texture = args.kind(name) == Some(Kind::Texture);
        if !is_texture {
            return None;
        }
        let param = args.take(name)?;
        let Values::Texts(texts) = &param.values else {
            return None;
        };
        let text = texts.first().cloned().unwrap_or_default();
        let key = (float, text);
        if let Some(found) = self.textures.get(&key).cloned() {
            let faults = self.faulty_textures.get(&key).cloned();
            faults.into_iter().flatten().for_each(|fault| self.report(fault));
            return Some(found);
        }
        let text = key.1;
        let kind = if float { "float" } else { "spectrum" };
        let message = format!("no {kind} texture is called \"{}\" here", shorten(&text));
        let known = self.textures.keys().filter(|(is_float, _)| *is_float == float);
        let near = nearest(&text, known.map(|(_, name)| name.as_str()));
        let fault = with_nearest(self.fault(param.at, message), near);
        self.report(fault);
        Some((Value::Float(0.5), false, 0))
    }
}

/// Adds the nearest known name to an error.
fn with_nearest(fault: FormatError, near: Option<&str>) -> FormatError {
    match near {
        Some(near) => fault.with_help(format!("did you mean \"{near}\"?")),
        None => fault,
    }
}
