//! Mitsuba's XML as a list of objects: parameters are substituted, includes are read, references
//! are resolved.
//!
//! All input is bounded before it is parsed: size, number and depth of elements, attributes of one
//! element, included files.

use crate::files::{self, Folder, Named, folder_of, shorten};
use crate::spectrum::{self, Sampled};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use whitstone_core::transform_steps::rotation;
use whitstone_core::{DAffine3, DMat3, DVec3, FormatError, FormatErrors};

/// Largest file in bytes.
const MAX_BYTES: u64 = 16 << 20;
/// Largest sum of all files in bytes.
const MAX_TOTAL_BYTES: u64 = 64 << 20;
/// Largest number of files.
const MAX_FILES: usize = 256;
/// Maximum depth of includes, counting the main file.
const MAX_INCLUDE_DEPTH: usize = 8;
/// Elements inside each other.
const MAX_DEPTH: usize = 64;
/// Tags of one file.
const MAX_TAGS: usize = 1 << 21;
/// Attributes of one element.
const MAX_ATTRIBUTES: usize = 64;
/// Length of an attribute after the substitution of parameters, in bytes.
const MAX_VALUE: usize = 1 << 20;
/// Errors after which a file is given up.
const MAX_ERRORS: usize = 100;

/// A place in one of the files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct At {
    file: usize,
    offset: usize,
}

/// An object: an element with a `type`, or the scene.
#[derive(Clone, Debug)]
pub(super) struct Object {
    /// The name of the element, such as `bsdf`; `texture` for a `spectrum` with a type.
    pub(super) family: &'static str,
    /// The `type`; empty for the scene.
    pub(super) plugin: String,
    pub(super) id: Option<String>,
    pub(super) at: At,
    pub(super) entries: Vec<Entry>,
}

/// A child of an object.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    /// Empty if it has none.
    pub(super) name: String,
    pub(super) value: Data,
    pub(super) at: At,
}

/// The value of a child.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Data {
    Boolean(bool),
    Integer(i64),
    Float(f64),
    Text(String),
    Vector(DVec3),
    Color([f64; 3]),
    Transform(DAffine3),
    /// The index of an object.
    Object(usize),
    /// An id that is not yet resolved.
    Reference(String),
}

/// All objects of a scene. The first one is the scene.
#[derive(Debug, Default)]
pub(super) struct Scene {
    pub(super) objects: Vec<Object>,
    /// Folders for other files, as `path` elements name them, the latest first, and "" for the
    /// folder of the scene.
    pub(super) search: Vec<String>,
    /// Places of spectra that vary with the wavelength.
    pub(super) spectra: Vec<At>,
    files: Vec<Lines>,
}

/// The name of a file and the starts of its lines.
#[derive(Debug)]
struct Lines {
    name: String,
    starts: Vec<usize>,
}

impl Scene {
    /// Line and column, after the name of the file unless it is the main file.
    pub(super) fn place(&self, at: At) -> String {
        let Some(file) = self.files.get(at.file) else {
            return String::new();
        };
        let line = file.starts.partition_point(|start| *start <= at.offset);
        let column = at.offset - file.starts.get(line.wrapping_sub(1)).unwrap_or(&0) + 1;
        if at.file == 0 {
            format!("{line}:{column}")
        } else {
            format!("{}:{line}:{column}", file.name)
        }
    }

    /// The file that is written as `name`. The error is a message.
    pub(super) fn find(&self, folder: &Folder, name: &str) -> Result<Named, String> {
        let mut refused = None;
        for inside in &self.search {
            match folder.find(inside, name) {
                Ok(named) if named.path.exists() => return Ok(named),
                Ok(_) => {}
                Err(message) => refused = Some(message),
            }
        }
        Err(refused.unwrap_or_else(|| format!("there is no file \"{}\"", shorten(name))))
    }
}

/// Reads a file and its includes.
pub(super) fn load(path: &Path, folder: &Folder) -> Result<Scene, FormatErrors> {
    let mut loader = Loader {
        folder,
        scene: Scene {
            search: vec![String::new()],
            ..Scene::default()
        },
        ids: HashMap::new(),
        parameters: Vec::new(),
        errors: Vec::new(),
        open: Vec::new(),
        bytes: 0,
    };
    let name = path
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    let main = Named {
        relative: name,
        path: path.to_owned(),
    };
    if let Err(error) = loader.file(&main, None) {
        loader.errors.push(error);
    }
    loader.resolve();
    if loader.errors.is_empty() {
        Ok(loader.scene)
    } else {
        loader.errors.truncate(MAX_ERRORS);
        Err(FormatErrors(loader.errors))
    }
}

struct Loader<'f> {
    folder: &'f Folder,
    scene: Scene,
    ids: HashMap<String, usize>,
    /// `$name` and value, longest names first.
    parameters: Vec<(String, String)>,
    errors: Vec<FormatError>,
    /// The files that are being read, the main file first.
    open: Vec<PathBuf>,
    bytes: u64,
}

/// An XML element of the file with this number.
#[derive(Clone, Copy)]
struct Element<'a, 'i> {
    node: roxmltree::Node<'a, 'i>,
    file: usize,
    /// Whether the file is of Mitsuba 0.x, whose names are in camel case.
    old: bool,
}

impl<'a, 'i> Element<'a, 'i> {
    fn at(&self) -> At {
        At {
            file: self.file,
            offset: self.node.range().start,
        }
    }

    fn children(self) -> impl Iterator<Item = Element<'a, 'i>> {
        self.node
            .children()
            .filter(roxmltree::Node::is_element)
            .map(move |node| Element { node, ..self })
    }

    fn name(&self) -> &'a str {
        self.node.tag_name().name()
    }
}

impl Loader<'_> {
    fn error(&self, at: At, message: impl Into<String>) -> FormatError {
        FormatError::at(self.scene.place(at), message)
    }

    /// Reads a file; `parent`: the object that includes it, and the name of the child.
    fn file(&mut self, named: &Named, parent: Option<(usize, &str, At)>) -> Result<(), FormatError> {
        let here = |message: String| match parent {
            None => FormatError::anywhere(message),
            Some((_, _, at)) => FormatError::at(self.scene.place(at), message),
        };
        let name = shorten(&named.relative);
        let identity = named.path.canonicalize().unwrap_or_else(|_| named.path.clone());
        if self.open.contains(&identity) {
            return Err(here(format!("\"{name}\" includes itself")));
        }
        if self.open.len() >= MAX_INCLUDE_DEPTH {
            return Err(here(format!(
                "includes are nested more than {} levels deep",
                MAX_INCLUDE_DEPTH - 1
            )));
        }
        if self.scene.files.len() >= MAX_FILES {
            return Err(here(format!("expected at most {MAX_FILES} files")));
        }
        let bytes = files::read(&named.path, MAX_BYTES)
            .map_err(|problem| here(format!("cannot read \"{name}\": {problem}")))?;
        self.bytes += bytes.len() as u64;
        if self.bytes > MAX_TOTAL_BYTES {
            return Err(here(format!(
                "the files have more than {} MiB in all",
                MAX_TOTAL_BYTES >> 20
            )));
        }
        let text = String::from_utf8(bytes).map_err(|_| here(format!("\"{name}\" is not UTF-8 text")))?;
        let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
        let file = self.scene.files.len();
        let line_ends = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n');
        self.scene.files.push(Lines {
            name: named.relative.clone(),
            starts: std::iter::once(0)
                .chain(line_ends.map(|(at, _)| at + 1))
                .collect(),
        });
        let text = &check(text).map_err(|(offset, message)| self.error(At { file, offset }, message))?;
        let options = roxmltree::ParsingOptions {
            nodes_limit: 2 * MAX_TAGS as u32,
            ..roxmltree::ParsingOptions::default()
        };
        let document = roxmltree::Document::parse_with_options(text, options).map_err(|error| {
            let place = error.pos();
            let prefix = if file == 0 {
                String::new()
            } else {
                format!("{}:", named.relative)
            };
            let message = error.to_string();
            // The message ends with the place.
            let message = message
                .rsplit_once(" at ")
                .map_or(&*message, |(message, _)| message);
            FormatError::at(
                format!("{prefix}{}:{}", place.row, place.col),
                format!("invalid XML: {message}"),
            )
        })?;
        let node = document.root_element();
        let version = node.attribute("version").unwrap_or_default();
        let major = version
            .split('.')
            .next()
            .and_then(|number| number.parse::<u32>().ok());
        let root = Element {
            node,
            file,
            old: major.is_some_and(|major| major < 2),
        };
        if major.is_none() {
            return Err(self.error(root.at(), format!("expected <{} version=\"3.0.0\">", root.name())));
        }
        self.open.push(identity);
        let result = self.root(root, parent);
        self.open.pop();
        result
    }

    fn root(&mut self, root: Element<'_, '_>, parent: Option<(usize, &str, At)>) -> Result<(), FormatError> {
        match parent {
            None if root.name() != "scene" => Err(self.error(
                root.at(),
                format!("expected <scene>, found <{}>", shorten(root.name())),
            )),
            None => {
                self.scene.objects.push(Object {
                    family: "scene",
                    plugin: String::new(),
                    id: None,
                    at: root.at(),
                    entries: Vec::new(),
                });
                self.children(root, 0);
                Ok(())
            }
            Some((parent, _, _)) if root.name() == "scene" => {
                self.children(root, parent);
                Ok(())
            }
            Some((parent, name, _)) => self.child(root, parent, Some(name)),
        }
    }

    fn children(&mut self, element: Element<'_, '_>, parent: usize) {
        for child in element.children() {
            if self.errors.len() >= MAX_ERRORS {
                return;
            }
            if let Err(error) = self.child(child, parent, None) {
                self.errors.push(error);
            }
        }
    }

    /// An attribute with its parameters substituted.
    fn attribute(&self, element: Element<'_, '_>, name: &str) -> Result<Option<String>, FormatError> {
        let Some(written) = element.node.attribute(name) else {
            return Ok(None);
        };
        if !written.contains('$') {
            return Ok(Some(written.to_owned()));
        }
        let mut value = String::new();
        let mut rest = written;
        while let Some(found) = rest.find('$') {
            value.push_str(&rest[..found]);
            let after = &rest[found..];
            if value.ends_with('\\') {
                value.pop();
                value.push('$');
                rest = &after[1..];
                continue;
            }
            let parameter = self
                .parameters
                .iter()
                .find(|(name, _)| after.starts_with(name.as_str()));
            let Some((name, substituted)) = parameter else {
                let end = after[1..].find(|c: char| !c.is_alphanumeric() && c != '_');
                let name = &after[..end.map_or(after.len(), |end| end + 1)];
                let error = self.error(
                    element.at(),
                    format!("the parameter {} has no value", shorten(name)),
                );
                return Err(error.with_help(format!(
                    "add <default name=\"{}\" value=\"...\"/> before it",
                    shorten(&name[1..])
                )));
            };
            value.push_str(substituted);
            rest = &after[name.len()..];
            if value.len() > MAX_VALUE {
                return Err(self.error(element.at(), "the value of an attribute is too long"));
            }
        }
        value.push_str(rest);
        Ok(Some(value))
    }

    fn required(&self, element: Element<'_, '_>, name: &str) -> Result<String, FormatError> {
        self.attribute(element, name)?.ok_or_else(|| {
            self.error(
                element.at(),
                format!("<{}> needs the attribute \"{name}\"", element.name()),
            )
        })
    }

    /// Adds a child to an object; `name` replaces its name.
    fn child(
        &mut self,
        element: Element<'_, '_>,
        parent: usize,
        name: Option<&str>,
    ) -> Result<(), FormatError> {
        let at = element.at();
        let tag = element.name();
        let value = match tag {
            "default" => return self.default(element),
            "alias" => return self.alias(element),
            "path" => return self.search(element, parent),
            "include" => {
                let written = self.required(element, "filename")?;
                let name = self.attribute(element, "name")?.unwrap_or_default();
                let named = self.included(element, &written)?;
                return self.file(&named, Some((parent, &name, at)));
            }
            "ref" => Data::Reference(self.required(element, "id")?),
            "spectrum" if element.node.attribute("type").is_none() => {
                let emits = self.scene.objects[parent].family == "emitter";
                Data::Color(self.spectrum(element, emits)?)
            }
            "rgb" => self.rgb(element)?,
            "float" => Data::Float(self.number(element, &self.required(element, "value")?)?),
            "integer" => {
                let written = self.required(element, "value")?;
                let value = written.trim().parse();
                Data::Integer(value.map_err(|_| {
                    self.error(
                        at,
                        format!("expected an integer, found \"{}\"", shorten(&written)),
                    )
                })?)
            }
            "boolean" => match self.required(element, "value")?.to_ascii_lowercase().as_str() {
                "true" => Data::Boolean(true),
                "false" => Data::Boolean(false),
                written => {
                    let message = format!("expected \"true\" or \"false\", found \"{}\"", shorten(written));
                    return Err(self.error(at, message));
                }
            },
            "string" => Data::Text(self.required(element, "value")?),
            "vector" | "point" => Data::Vector(self.xyz(element, 0.0)?),
            "transform" => Data::Transform(self.transform(element)?),
            _ => {
                let Some(family) = FAMILIES
                    .iter()
                    .find(|(name, _)| *name == tag)
                    .map(|(_, family)| *family)
                else {
                    return Err(self.error(at, format!("unknown element <{}>", shorten(tag))));
                };
                Data::Object(self.object(element, family)?)
            }
        };
        let name = match name {
            Some(name) => name.to_owned(),
            None => self.attribute(element, "name")?.unwrap_or_default(),
        };
        let nameless = matches!(value, Data::Object(_) | Data::Reference(_));
        if name.is_empty() && !nameless {
            return Err(self.error(at, format!("<{tag}> needs the attribute \"name\"")));
        }
        if !matches!(value, Data::Object(_) | Data::Transform(_))
            && let Some(inner) = element.children().next()
        {
            let message = format!("<{tag}> cannot contain <{}>", shorten(inner.name()));
            return Err(self.error(inner.at(), message));
        }
        let name = if element.old { snake_case(&name) } else { name };
        let entries = &mut self.scene.objects[parent].entries;
        entries.push(Entry { name, value, at });
        Ok(())
    }

    fn object(&mut self, element: Element<'_, '_>, family: &'static str) -> Result<usize, FormatError> {
        let plugin = self.required(element, "type")?;
        let id = self.attribute(element, "id")?.filter(|id| !id.is_empty());
        let index = self.scene.objects.len();
        if let Some(id) = &id
            && let Some(other) = self.ids.insert(id.clone(), index)
        {
            let place = self.scene.place(self.scene.objects[other].at);
            let message = format!("the id \"{}\" is already used at {place}", shorten(id));
            return Err(self.error(element.at(), message));
        }
        self.scene.objects.push(Object {
            family,
            plugin,
            id,
            at: element.at(),
            entries: Vec::new(),
        });
        self.children(element, index);
        Ok(index)
    }

    fn default(&mut self, element: Element<'_, '_>) -> Result<(), FormatError> {
        let name = self.required(element, "name")?;
        let value = self.required(element, "value")?;
        if name.is_empty() {
            return Err(self.error(element.at(), "a parameter needs a name"));
        }
        let name = format!("${name}");
        if self.parameters.iter().all(|(known, _)| *known != name) {
            let place = self
                .parameters
                .partition_point(|(known, _)| known.len() >= name.len());
            self.parameters.insert(place, (name, value));
        }
        Ok(())
    }

    fn alias(&mut self, element: Element<'_, '_>) -> Result<(), FormatError> {
        let (id, new) = (self.required(element, "id")?, self.required(element, "as")?);
        let Some(index) = self.ids.get(&id).copied() else {
            return Err(self.error(element.at(), format!("no object has the id \"{}\"", shorten(&id))));
        };
        if self.ids.insert(new.clone(), index).is_some() {
            return Err(self.error(
                element.at(),
                format!("the id \"{}\" is already used", shorten(&new)),
            ));
        }
        Ok(())
    }

    fn search(&mut self, element: Element<'_, '_>, parent: usize) -> Result<(), FormatError> {
        let written = self.required(element, "value")?;
        if parent != 0 {
            return Err(self.error(element.at(), "<path> must be a child of <scene>"));
        }
        let inside = folder_of(&self.scene.files[element.file].name).to_owned();
        let found = self.folder.find(&inside, &written);
        let named = found.map_err(|message| self.error(element.at(), message))?;
        if !named.path.is_dir() {
            return Err(self.error(
                element.at(),
                format!("there is no folder \"{}\"", shorten(&written)),
            ));
        }
        self.scene.search.insert(0, named.relative);
        Ok(())
    }

    /// A file that an `include` names: relative to the including file, else in the search paths.
    fn included(&self, element: Element<'_, '_>, written: &str) -> Result<Named, FormatError> {
        let inside = folder_of(&self.scene.files[element.file].name);
        let near = self.folder.find(inside, written);
        match near {
            Ok(named) if named.path.exists() => Ok(named),
            near => self
                .scene
                .find(self.folder, written)
                .map_err(|message| self.error(element.at(), near.err().unwrap_or(message))),
        }
    }

    fn number(&self, element: Element<'_, '_>, text: &str) -> Result<f64, FormatError> {
        let value = text.trim().parse().ok().filter(|value: &f64| value.is_finite());
        value.ok_or_else(|| {
            self.error(
                element.at(),
                format!("expected a finite number, found \"{}\"", shorten(text)),
            )
        })
    }

    fn numbers(&self, element: Element<'_, '_>, text: &str) -> Result<Vec<f64>, FormatError> {
        words(text).map(|word| self.number(element, word)).collect()
    }

    fn rgb(&self, element: Element<'_, '_>) -> Result<Data, FormatError> {
        let values = self.numbers(element, &self.required(element, "value")?)?;
        match values[..] {
            [value] => Ok(Data::Color([value; 3])),
            [r, g, b] => Ok(Data::Color([r, g, b])),
            _ => {
                let message = format!("expected one or three numbers, found {}", values.len());
                Err(self.error(element.at(), message))
            }
        }
    }

    /// The colour of a spectrum: one value, or pairs of a wavelength and a value. One value is grey
    /// as a reflectance; as an emission it is the colour of even light, as in Mitsuba.
    fn spectrum(&mut self, element: Element<'_, '_>, emits: bool) -> Result<[f64; 3], FormatError> {
        let Some(written) = self.attribute(element, "value")? else {
            let error = self.error(element.at(), "a spectrum in a file of its own is not read");
            return Err(error.with_help("write <rgb>, or the spectrum as value=\"400:0.1, 700:0.2\""));
        };
        if !written.contains(':') {
            let value = self.number(element, &written)?;
            let even = if emits { spectrum::even_light() } else { [1.0; 3] };
            return Ok(even.map(|channel| value * channel));
        }
        let mut samples = Vec::new();
        for pair in words(&written) {
            let (nm, value) = pair.split_once(':').ok_or_else(|| {
                let message = format!("expected a pair such as 400:0.1, found \"{}\"", shorten(pair));
                self.error(element.at(), message)
            })?;
            samples.extend([self.number(element, nm)?, self.number(element, value)?]);
        }
        let pairs: &[[f64; 2]] = samples.as_chunks().0;
        if !pairs.is_sorted_by(|a, b| a[0] < b[0]) || pairs.iter().any(|[_, value]| *value < 0.0) {
            let message = "expected ascending wavelengths, and values that are not negative";
            return Err(self.error(element.at(), message));
        }
        self.scene.spectra.push(element.at());
        let samples = Sampled(&samples);
        Ok(if emits {
            samples.radiance()
        } else {
            samples.color()
        })
    }

    /// Three numbers, by `value` or by `x`, `y`, `z`.
    fn xyz(&self, element: Element<'_, '_>, default: f64) -> Result<DVec3, FormatError> {
        if let Some(written) = self.attribute(element, "value")? {
            let values = self.numbers(element, &written)?;
            return match values[..] {
                [value] => Ok(DVec3::splat(value)),
                [x, y, z] => Ok(DVec3::new(x, y, z)),
                _ => {
                    let message = format!("expected one or three numbers, found {}", values.len());
                    Err(self.error(element.at(), message))
                }
            };
        }
        let number = |name: &str| match self.attribute(element, name)? {
            None => Ok(default),
            Some(written) => self.number(element, &written),
        };
        Ok(DVec3::new(number("x")?, number("y")?, number("z")?))
    }

    fn triple(&self, element: Element<'_, '_>, written: &str) -> Result<DVec3, FormatError> {
        let values = self.numbers(element, written)?;
        let triple = <[f64; 3]>::try_from(values);
        triple.map(DVec3::from).map_err(|values| {
            self.error(
                element.at(),
                format!("expected three numbers, found {}", values.len()),
            )
        })
    }

    fn transform(&self, element: Element<'_, '_>) -> Result<DAffine3, FormatError> {
        let mut result = DAffine3::IDENTITY;
        for step in element.children() {
            let map = match step.name() {
                "translate" => DAffine3::from_translation(self.xyz(step, 0.0)?),
                "scale" => DAffine3::from_scale(self.xyz(step, 1.0)?),
                "rotate" => {
                    let axis = self.xyz(step, 0.0)?;
                    let unit = axis.try_normalize();
                    let unit = unit.ok_or_else(|| self.error(step.at(), "the axis must not be zero"))?;
                    let angle = self.number(step, &self.required(step, "angle")?)?;
                    DAffine3::from_mat3(if (axis.length() - 1.0).abs() < 1e-6 {
                        rotation(unit, angle)
                    } else {
                        turned(axis, angle)
                    })
                }
                "lookat" | "lookAt" => self.look_at(step)?,
                "matrix" => self.matrix(step)?,
                name => {
                    let message = format!("unknown element <{}> of a transform", shorten(name));
                    return Err(self.error(step.at(), message));
                }
            };
            result = map * result;
            if !result.is_finite() {
                return Err(self.error(step.at(), "the numbers of the transform are too large"));
            }
        }
        Ok(result)
    }

    fn look_at(&self, step: Element<'_, '_>) -> Result<DAffine3, FormatError> {
        let origin = self.triple(step, &self.required(step, "origin")?)?;
        let target = self.triple(step, &self.required(step, "target")?)?;
        let up = match self.attribute(step, "up")? {
            None => DVec3::ZERO,
            Some(written) => self.triple(step, &written)?,
        };
        let same = || self.error(step.at(), "the origin and the target must differ");
        let forward = (target - origin).try_normalize().ok_or_else(same)?;
        let up = if up == DVec3::ZERO {
            basis(forward).x_axis
        } else {
            up
        };
        let parallel = || self.error(step.at(), "\"up\" must not be parallel to the direction");
        let left = up.cross(forward).try_normalize().ok_or_else(parallel)?;
        let matrix = DMat3::from_cols(left, forward.cross(left), forward);
        Ok(DAffine3::from_mat3_translation(matrix, origin))
    }

    fn matrix(&self, step: Element<'_, '_>) -> Result<DAffine3, FormatError> {
        let values = self.numbers(step, &self.required(step, "value")?)?;
        let width = match values.len() {
            16 => 4,
            9 => 3,
            count => {
                return Err(self.error(step.at(), format!("expected 9 or 16 numbers, found {count}")));
            }
        };
        let column = |j: usize| DVec3::new(values[j], values[width + j], values[2 * width + j]);
        let matrix = DMat3::from_cols(column(0), column(1), column(2));
        if width == 3 {
            return Ok(DAffine3::from_mat3(matrix));
        }
        if values[12..] != [0.0, 0.0, 0.0, 1.0] {
            return Err(self.error(step.at(), "the last row must be 0 0 0 1"));
        }
        Ok(DAffine3::from_mat3_translation(matrix, column(3)))
    }

    /// Replaces ids by objects.
    fn resolve(&mut self) {
        let mut errors = Vec::new();
        let scene = &mut self.scene;
        let mut unresolved = Vec::new();
        for object in &mut scene.objects {
            for entry in &mut object.entries {
                let Data::Reference(id) = &entry.value else {
                    continue;
                };
                match self.ids.get(id) {
                    Some(index) => entry.value = Data::Object(*index),
                    None => unresolved.push((entry.at, shorten(id))),
                }
            }
        }
        for (at, id) in unresolved.into_iter().take(MAX_ERRORS) {
            errors.push(self.error(at, format!("no object has the id \"{id}\"")));
        }
        self.errors.extend(errors);
    }
}

/// Elements that are objects, and the names of their families.
const FAMILIES: &[(&str, &str)] = &[
    ("bsdf", "bsdf"),
    ("emitter", "emitter"),
    ("film", "film"),
    ("integrator", "integrator"),
    ("medium", "medium"),
    ("phase", "phase"),
    ("rfilter", "rfilter"),
    ("sampler", "sampler"),
    ("sensor", "sensor"),
    ("shape", "shape"),
    ("spectrum", "texture"),
    ("texture", "texture"),
    ("volume", "volume"),
];

/// Numbers are separated by spaces and commas.
fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| c == ',' || c.is_whitespace())
        .filter(|word| !word.is_empty())
}

/// Rodrigues' formula with an axis of any length, as Mitsuba computes it: a rotation only if the
/// axis is a unit vector.
fn turned(axis: DVec3, degrees: f64) -> DMat3 {
    let (sin, cos) = libm::sincos(degrees.to_radians());
    let column = |e: DVec3| cos * e + sin * axis.cross(e) + (1.0 - cos) * axis.dot(e) * axis;
    DMat3::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z))
}

/// The rotation whose z axis is this unit vector, as Mitsuba completes a basis (Duff et al. 2017).
pub(super) fn basis(n: DVec3) -> DMat3 {
    let sign = 1_f64.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    DMat3::from_cols(
        DVec3::new(sign * n.x * n.x * a + 1.0, sign * b, -sign * n.x),
        DVec3::new(b, n.y * n.y * a + sign, -n.y),
        n,
    )
}

/// `toWorld` becomes `to_world`.
fn snake_case(name: &str) -> String {
    let mut result = String::new();
    let mut previous_is_lower = false;
    for c in name.chars() {
        if c.is_ascii_uppercase() {
            if previous_is_lower {
                result.push('_');
            }
            let joined = previous_is_lower
                || result
                    .chars()
                    .last()
                    .is_some_and(|last| last.is_ascii_lowercase());
            result.push(if joined { c.to_ascii_lowercase() } else { c });
        } else {
            result.push(c);
        }
        previous_is_lower = c.is_ascii_lowercase();
    }
    result
}

/// Limits that bound the time and memory of the XML parser. Returns the text with spaces instead of
/// comments: Mitsuba's parser takes `--` inside them. The error is an offset and a message.
fn check(text: &str) -> Result<String, (usize, String)> {
    let bytes = text.as_bytes();
    let mut comments = Vec::new();
    let (mut depth, mut tags) = (0_usize, 0_usize);
    let mut at = 0;
    while let Some(found) = text[at..].find('<') {
        let start = at + found;
        let rest = &text[start..];
        let skip_to = |end: &str| rest.find(end).map(|found| start + found + end.len());
        tags += 1;
        if tags > MAX_TAGS {
            return Err((start, format!("expected at most {MAX_TAGS} tags")));
        }
        let next = if rest.starts_with("<!--") {
            let end = skip_to("-->");
            comments.extend(end.map(|end| start..end));
            end
        } else if rest.starts_with("<![CDATA[") {
            skip_to("]]>")
        } else if rest.starts_with("<?") {
            skip_to("?>")
        } else if rest.starts_with("<!") {
            let message = "<!DOCTYPE> and entities of the file are not supported";
            return Err((start, message.to_owned()));
        } else if rest.starts_with("</") {
            depth = depth.saturating_sub(1);
            skip_to(">")
        } else {
            let mut quote = None;
            let mut attributes = 0;
            let mut end = None;
            for (offset, byte) in bytes[start..].iter().enumerate().skip(1) {
                match (quote, byte) {
                    (Some(open), byte) if open == *byte => quote = None,
                    (Some(_), _) => {}
                    (None, b'"' | b'\'') => quote = Some(*byte),
                    (None, b'=') => attributes += 1,
                    (None, b'>') => {
                        end = Some(start + offset);
                        break;
                    }
                    (None, _) => {}
                }
                if attributes > MAX_ATTRIBUTES {
                    let message = format!("expected at most {MAX_ATTRIBUTES} attributes");
                    return Err((start, message));
                }
            }
            if end.is_some_and(|end| bytes[end - 1] != b'/') {
                depth += 1;
                if depth > MAX_DEPTH {
                    let message = format!("elements are nested more than {MAX_DEPTH} deep");
                    return Err((start, message));
                }
            }
            end.map(|end| end + 1)
        };
        // What does not end is reported by the parser.
        let Some(next) = next else { break };
        at = next;
    }
    let mut whole = bytes.to_vec();
    for comment in comments {
        let letters = whole[comment].iter_mut().filter(|byte| **byte != b'\n');
        letters.for_each(|byte| *byte = b' ');
    }
    // Whole characters were replaced.
    String::from_utf8(whole).map_err(|_| (0, "is not UTF-8 text".to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use whitstone_core::ImportOptions;

    /// Loads the first of several files in one folder.
    fn load_files(files: &[(&str, &str)]) -> Result<Scene, Vec<(String, String)>> {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        let path = folder.path().join(files[0].0);
        let inside = Folder::of(&path, &ImportOptions::all());
        load(&path, &inside).map_err(|errors| {
            let pair = |error: FormatError| (error.place, error.message);
            errors.0.into_iter().map(pair).collect()
        })
    }

    fn scene(content: &str) -> Result<Scene, Vec<(String, String)>> {
        load_files(&[("a.xml", &format!("<scene version=\"3.0.0\">{content}</scene>"))])
    }

    fn first_error(content: &str) -> (String, String) {
        scene(content).unwrap_err().remove(0)
    }

    fn entry<'s>(scene: &'s Scene, object: usize, name: &str) -> &'s Data {
        let entries = &scene.objects[object].entries;
        &entries.iter().find(|entry| entry.name == name).unwrap().value
    }

    #[test]
    fn values_parameters_and_references_are_read() {
        let scene = scene(
            "<default name='n' value='2'/><default name='nn' value='7'/><default name='n' value='9'/>
             <bsdf type='diffuse' id='b'><rgb name='c' value='0.1, 0.2 $n'/><rgb name='g' value='1'/></bsdf>
             <alias id='b' as='other'/>
             <shape type='sphere'><float name='f' value='$nn$n'/><integer name='i' value=' 3 '/>
             <boolean name='t' value='True'/><string name='s' value='a\\$n'/><point name='p' x='1' z='3'/>
             <vector name='v' value='4'/><spectrum name='e' value='0.5'/><ref id='other'/></shape>",
        )
        .unwrap();
        assert_eq!(*entry(&scene, 1, "c"), Data::Color([0.1, 0.2, 2.0]));
        assert_eq!(*entry(&scene, 1, "g"), Data::Color([1.0; 3]));
        assert_eq!(*entry(&scene, 2, "f"), Data::Float(72.0));
        assert_eq!(*entry(&scene, 2, "i"), Data::Integer(3));
        assert_eq!(*entry(&scene, 2, "t"), Data::Boolean(true));
        assert_eq!(*entry(&scene, 2, "s"), Data::Text("a$n".into()));
        assert_eq!(*entry(&scene, 2, "p"), Data::Vector(DVec3::new(1.0, 0.0, 3.0)));
        assert_eq!(*entry(&scene, 2, "v"), Data::Vector(DVec3::splat(4.0)));
        assert_eq!(*entry(&scene, 2, "e"), Data::Color([0.5; 3]));
        assert_eq!(*entry(&scene, 2, ""), Data::Object(1));
        assert_eq!(scene.place(scene.objects[2].at), "4:14");
    }

    #[test]
    fn transforms_are_applied_in_the_order_of_the_file() {
        let scene = scene(
            "<shape type='a'><transform name='t'><scale value='2'/><rotate z='1' angle='90'/><translate x='1'/></transform>
             <transform name='l'><lookat origin='1 2 3' target='1 2 8' up='0 1 0'/></transform>
             <transform name='r'><rotate x='1' y='1' angle='40'/></transform>
             <transform name='m'><matrix value='1 0 0 5 0 1 0 6 0 0 1 7 0 0 0 1'/></transform></shape>",
        )
        .unwrap();
        let map = |name: &str| match entry(&scene, 1, name) {
            Data::Transform(map) => *map,
            _ => panic!(),
        };
        let moved = map("t").transform_point3(DVec3::X);
        assert!((moved - DVec3::new(1.0, 2.0, 0.0)).length() < 1e-12);
        assert_eq!(map("l").matrix3.x_axis, DVec3::X);
        // Mitsuba does not normalise the axis.
        let columns = [[1.0, 0.233956, -0.642788], [0.642788, -0.642788, 0.766044]];
        let turned = map("r").matrix3;
        for (column, expected) in [turned.x_axis, turned.z_axis].into_iter().zip(columns) {
            assert!((column - DVec3::from(expected)).length() < 1e-6, "{column}");
        }
        assert_eq!(map("l").translation, DVec3::new(1.0, 2.0, 3.0));
        assert_eq!(map("m").translation, DVec3::new(5.0, 6.0, 7.0));
    }

    #[test]
    fn includes_are_spliced_and_keep_their_places() {
        let scene = load_files(&[
            (
                "a.xml",
                "<scene version='3.0.0'><include filename='b/b.xml'/><include filename='b/c.xml'/></scene>",
            ),
            (
                "b/b.xml",
                "<scene version='0.6.0'>\n<shape type='x'><float name='aB' value='1'/></shape></scene>",
            ),
            ("b/c.xml", "<bsdf version='3.0.0' type='y' id='i'/>"),
        ])
        .unwrap();
        assert_eq!(scene.objects[0].entries.len(), 2);
        assert_eq!(*entry(&scene, 1, "a_b"), Data::Float(1.0));
        assert_eq!(scene.place(scene.objects[1].at), "b/b.xml:2:1");
        assert_eq!(scene.objects[2].plugin, "y");
        assert_eq!(
            ["toWorld", "intIOR", "filename", "maxDepth"].map(snake_case),
            ["to_world", "int_ior", "filename", "max_depth"]
        );
    }

    #[test]
    fn all_errors_have_places() {
        let errors =
            scene("\n<shape/>\n <float name='x' value='1e999'/>\n<foo/><ref id='q'/><string value=''/>")
                .unwrap_err();
        let places: Vec<&str> = errors.iter().map(|(place, _)| place.as_str()).collect();
        assert_eq!(places, ["2:1", "3:2", "4:1", "4:20", "4:7"]);
        assert_eq!(errors[1].1, "expected a finite number, found \"1e999\"");
        for (content, message) in [
            (
                "<string name='x' value='$a_b/c'/>",
                "the parameter $a_b has no value",
            ),
            (
                "<include filename='../x.xml'/>",
                "\"../x.xml\" is outside of the folder of the scene; `convert --allow-outside` reads it",
            ),
            ("<include filename='x.xml'/>", "there is no file \"x.xml\""),
            (
                "<bsdf type='a' id='i'/><bsdf type='a' id='i'/>",
                "the id \"i\" is already used at 1:24",
            ),
            (
                "<transform name='t'><matrix value='1 2'/></transform>",
                "expected 9 or 16 numbers, found 2",
            ),
            (
                "<spectrum name='s' filename='a.spd'/>",
                "a spectrum in a file of its own is not read",
            ),
            (
                "<spectrum name='s' value='400:1, 700'/>",
                "expected a pair such as 400:0.1, found \"700\"",
            ),
            (
                "<spectrum name='s' value='700:1, 400:1'/>",
                "expected ascending wavelengths, and values that are not negative",
            ),
            (
                "<float name='f' value='1'><float/></float>",
                "<float> cannot contain <float>",
            ),
        ] {
            assert_eq!(first_error(content).1, message);
        }
    }

    #[test]
    fn hostile_files_give_errors_in_bounded_time() {
        let bomb = "<!DOCTYPE x [<!ENTITY a 'aaaa'><!ENTITY b '&a;&a;'>]><scene version='3.0.0'>&b;</scene>";
        let error = load_files(&[("a.xml", bomb)]).unwrap_err().remove(0);
        assert_eq!(
            error,
            (
                "1:1".into(),
                "<!DOCTYPE> and entities of the file are not supported".into()
            )
        );
        let deep = "<bsdf type='a'>".repeat(100_000);
        assert!(first_error(&deep).1.contains("nested more than 64 deep"));
        let wide: String = (0..100_000).map(|i| format!(" a{i}='1'")).collect();
        assert!(
            first_error(&format!("<bsdf type='a'{wide}/>"))
                .1
                .contains("at most 64 attributes")
        );
        let cycle = "<scene version='3.0.0'><include filename='a.xml'/></scene>";
        assert_eq!(
            load_files(&[("a.xml", cycle)]).unwrap_err()[0].1,
            "\"a.xml\" includes itself"
        );
        let chain: Vec<(String, String)> = (0..9)
            .map(|i| {
                (
                    format!("{i}.xml"),
                    format!(
                        "<scene version='3.0.0'><include filename='{}.xml'/></scene>",
                        i + 1
                    ),
                )
            })
            .collect();
        let chain: Vec<(&str, &str)> = chain
            .iter()
            .map(|(name, text)| (name.as_str(), text.as_str()))
            .collect();
        let error = load_files(&chain).unwrap_err().remove(0);
        assert_eq!(
            error,
            (
                "7.xml:1:24".into(),
                "includes are nested more than 7 levels deep".into()
            )
        );
        // Each parameter doubles the one before.
        let doubling: String = (1..64)
            .map(|i| format!("<default name='p{i}x' value='$p{0}x$p{0}x'/>", i - 1))
            .collect();
        let error = first_error(&format!("<default name='p0x' value='0123456789'/>{doubling}"));
        assert_eq!(error.1, "the value of an attribute is too long");
        let garbage: String = (0..1_u32 << 20)
            .map(|i| char::from((i.wrapping_mul(2_654_435_761) >> 25) as u8))
            .collect();
        assert!(load_files(&[("a.xml", &garbage)]).is_err());
        for text in [
            "",
            "<",
            "<scene",
            "<scene version='3'",
            "<a version='3'/>",
            "<scene version='x'/>",
            "<!-- ",
        ] {
            assert!(load_files(&[("a.xml", text)]).is_err(), "{text:?}");
        }
    }
}
