//! The merged TOML document of a scene, with source positions.

use crate::Sources;
use crate::companions::companions;
use serde::Serialize as _;
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::thread;
use toml::Spanned;
use toml::de::{DeTable, DeValue};
use whitstone_core::{SceneError, SceneErrors, SourceSpan, nearest};

pub(crate) type Value<'s> = Spanned<DeValue<'s>>;

/// All keys that the top level of a scene may have.
pub(crate) const TOP_LEVEL: [&str; 13] = [
    "include",
    "import",
    "film",
    "camera",
    "sampler",
    "integrator",
    "accelerator",
    "light",
    "texture",
    "material",
    "group",
    "shape",
    "expect",
];

/// The keys that are lists.
const LISTS: [&str; 2] = ["shape", "light"];

/// The keys that are a single table.
const SINGLE: [&str; 6] = ["film", "camera", "sampler", "integrator", "accelerator", "expect"];

/// Length of a list from which a thread is worth its start.
const MANY: usize = 4096;

/// Maximum number of keys in the path of an override. The parser does not allow deeper tables in a
/// file either.
const MAX_PATH: usize = 64;

/// The top-level key nearest to `name` (`name` itself if it is one); `None` if none is near enough
/// to be a typing error.
pub fn nearest_top_level(name: &str) -> Option<&'static str> {
    nearest(name, TOP_LEVEL)
}

/// Whether a text may have `include` or `import`. If not, it need not be parsed to find them, which
/// takes a third of the time of reading a large scene. A key in quotes may be written with escapes.
pub(crate) fn may_refer(text: &str) -> bool {
    text.contains("include") || text.contains("import") || text.contains('\\')
}

/// The `include`s of a document, and the errors in them.
pub(crate) fn includes(table: &DeTable<'_>) -> (Vec<(SourceSpan, String)>, SceneErrors) {
    let mut errors = SceneErrors::default();
    let mut found = Vec::new();
    let list: Vec<&Value<'_>> = match table.get("include").map(|value| (value, value.get_ref())) {
        None => Vec::new(),
        Some((_, DeValue::Array(items))) => items.iter().collect(),
        Some((value, _)) => vec![value],
    };
    for item in list {
        match item.get_ref() {
            DeValue::String(path) => found.push((item.span(), path.to_string())),
            other => errors.0.push(SceneError::at(
                item.span(),
                format!("expected the path of a scene file, found {}", type_name(other)),
            )),
        }
    }
    (found, errors)
}

pub(crate) fn parse(padded: &str) -> (DeTable<'_>, SceneErrors) {
    let (table, errors) = DeTable::parse_recoverable(padded);
    let errors = errors
        .into_iter()
        .map(|error| SceneError {
            help: error.span().and_then(|span| list_help(padded, &span)),
            span: error.span(),
            message: error.message().trim().to_owned(),
        })
        .collect();
    (table.into_inner(), SceneErrors(errors))
}

/// Advice for a second `[shape]` or `[light]`, which the parser reports as a duplicate key at its
/// name.
fn list_help(text: &str, span: &SourceSpan) -> Option<String> {
    let name = text.get(span.clone())?;
    let in_brackets = text[..span.start].ends_with('[') && text[span.end..].starts_with(']');
    (LISTS.contains(&name) && in_brackets).then(|| two_brackets(name))
}

fn two_brackets(name: &str) -> String {
    format!("write [[{name}]], with two brackets")
}

/// Merges all files and applies the overrides.
///
/// A file is merged after the files that it includes. Its `[[shape]]`s and `[[light]]`s are
/// appended, its shared materials, textures and groups replace those of the same id, and its other
/// tables replace whole tables.
///
/// Also returns all errors at the top level.
///
/// # Errors
///
/// If a file is not valid TOML, because too many other errors would follow.
pub(crate) fn merge(sources: &Sources) -> Result<(DeTable<'_>, SceneErrors), SceneErrors> {
    let mut merged = DeTable::new();
    let mut errors = SceneErrors::default();
    let mut meant = Vec::new();
    let mut tables = Vec::new();
    let mut syntax = SceneErrors::default();
    for padded in sources.padded_files() {
        let (table, found) = parse(padded);
        syntax.0.extend(found.0);
        tables.push(table);
    }
    if !syntax.0.is_empty() {
        return Err(syntax);
    }
    for table in tables {
        for (key, value) in table {
            match key.get_ref().as_ref() {
                "include" | "import" => {}
                name if !TOP_LEVEL.contains(&name) => {
                    errors.0.push(unknown_top_level(&key));
                    meant.extend(nearest_top_level(name).map(|name| (key.span(), name, value)));
                }
                name if LISTS.contains(&name) => append(&mut merged, key, value, &mut errors),
                "material" | "texture" | "group" => insert_all(&mut merged, key, value, &mut errors),
                _ => {
                    merged.insert(key, value);
                }
            }
        }
    }
    for (start, padded, value) in sources.overrides() {
        if let Err(error) = apply(&mut merged, start, padded, value) {
            errors.0.push(error);
        }
    }
    // A table with a misspelt name is still checked, under the right name, which then is not
    // missing.
    for (span, name, value) in meant {
        if SINGLE.contains(&name) && !merged.contains_key(name) {
            merged.insert(Spanned::new(span, Cow::Borrowed(name)), value);
        }
    }
    Ok((merged, errors))
}

fn unknown_top_level(key: &Spanned<Cow<'_, str>>) -> SceneError {
    let error = SceneError::at(key.span(), format!("unknown table `{}`", key.get_ref()));
    error.with_help(match nearest_top_level(key.get_ref()) {
        Some(name) => format!("did you mean `{name}`?"),
        None => format!("known tables are {}", TOP_LEVEL.join(", ")),
    })
}

fn append<'s>(
    merged: &mut DeTable<'s>,
    key: Spanned<Cow<'s, str>>,
    value: Value<'s>,
    errors: &mut SceneErrors,
) {
    let span = value.span();
    let DeValue::Array(items) = value.into_inner() else {
        let name = key.get_ref();
        let error = SceneError::at(key.span(), format!("expected a list of {name}s"));
        errors.0.push(error.with_help(two_brackets(name)));
        return;
    };
    let list = merged
        .entry(key)
        .or_insert_with(|| Spanned::new(span, DeValue::Array(Default::default())));
    if let DeValue::Array(list) = list.get_mut() {
        for item in items {
            list.push(item);
        }
    }
}

fn insert_all<'s>(
    merged: &mut DeTable<'s>,
    key: Spanned<Cow<'s, str>>,
    value: Value<'s>,
    errors: &mut SceneErrors,
) {
    let span = value.span();
    let DeValue::Table(items) = value.into_inner() else {
        let name = key.get_ref();
        let error = SceneError::at(key.span(), format!("expected {name}s by id"));
        errors
            .0
            .push(error.with_help(format!("write [{name}.ID], then its keys")));
        return;
    };
    let table = merged
        .entry(key)
        .or_insert_with(|| Spanned::new(span, DeValue::Table(DeTable::new())));
    if let DeValue::Table(table) = table.get_mut() {
        table.extend(items);
    }
}

/// Applies `path=value`. The path consists of keys and indices, separated by dots; an element of a
/// list is named by its index or its `id`. The value is TOML, or else a string.
fn apply<'s>(
    merged: &mut DeTable<'s>,
    start: usize,
    padded: &'s str,
    padded_value: &'s str,
) -> Result<(), SceneError> {
    let whole = start..padded.len();
    let Some(equals) = padded.find('=') else {
        let error = SceneError::at(whole, "expected path=value");
        return Err(error.with_help("for example --set camera.fov=30"));
    };
    let parsed = DeTable::parse(padded_value).ok().map(Spanned::into_inner);
    let value = parsed
        .filter(|table| table.len() == 1)
        .and_then(|mut table| table.remove("v"))
        .unwrap_or_else(|| {
            let text = Cow::Borrowed(padded[equals + 1..].trim());
            Spanned::new(equals + 1..padded.len(), DeValue::String(text))
        });

    let mut keys: Vec<(SourceSpan, &str)> = Vec::new();
    let mut from = start;
    for part in padded[start..equals].split(['.', '[']) {
        let key = part.trim().trim_end_matches(']');
        keys.push((from..from + part.len(), key));
        from += part.len() + 1;
    }
    if let Some((span, _)) = keys.iter().find(|(_, key)| key.is_empty()) {
        return Err(SceneError::at(
            span.start..span.end.max(span.start + 1),
            "empty key in the path",
        ));
    }
    if keys.len() > MAX_PATH {
        return Err(SceneError::at(
            whole,
            format!("the path has more than {MAX_PATH} keys"),
        ));
    }
    let (first_span, first) = keys[0].clone();
    if first == "include" || first == "import" {
        let message = format!("`{first}` cannot be set by an override");
        return Err(SceneError::at(first_span, message));
    }
    if !TOP_LEVEL.contains(&first) {
        return Err(unknown_top_level(&Spanned::new(first_span, Cow::Borrowed(first))));
    }
    set_in_table(merged, &keys, value)
}

fn set_in_table<'s>(
    table: &mut DeTable<'s>,
    keys: &[(SourceSpan, &'s str)],
    value: Value<'s>,
) -> Result<(), SceneError> {
    let (span, key) = keys[0].clone();
    let spanned_key = Spanned::new(span.clone(), Cow::Borrowed(key));
    let [_, rest @ ..] = keys else {
        unreachable!("paths have at least one key")
    };
    if rest.is_empty() {
        table.remove(key);
        table.insert(spanned_key, value);
        return Ok(());
    }
    let entry = table
        .entry(spanned_key)
        .or_insert_with(|| Spanned::new(span.clone(), DeValue::Table(DeTable::new())));
    set_in_value(entry, &span, rest, value)
}

fn set_in_value<'s>(
    entry: &mut Value<'s>,
    parent: &SourceSpan,
    keys: &[(SourceSpan, &'s str)],
    value: Value<'s>,
) -> Result<(), SceneError> {
    match entry.get_mut() {
        DeValue::Table(table) => set_in_table(table, keys, value),
        DeValue::Array(items) => {
            let (span, key) = keys[0].clone();
            let has_id =
                |item: &Value<'_>| item.get_ref().get("id").and_then(|id| id.get_ref().as_str()) == Some(key);
            let index = key
                .parse::<usize>()
                .ok()
                .or_else(|| items.iter().position(has_id))
                .filter(|index| *index < items.len());
            let Some(index) = index else {
                return Err(SceneError::at(
                    span,
                    format!(
                        "no element `{key}`: expected an id, or an index below {}",
                        items.len()
                    ),
                ));
            };
            let element = items.get_mut(index).expect("the index is in range");
            if keys.len() == 1 {
                *element = value;
                return Ok(());
            }
            set_in_value(element, &span, &keys[1..], value)
        }
        other => Err(SceneError::at(
            parent.clone(),
            format!("this is {} and has no keys", type_name(other)),
        )),
    }
}

/// The type of a value, with its article.
pub(crate) fn type_name(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "a string",
        DeValue::Integer(_) => "an integer",
        DeValue::Float(_) => "a number",
        DeValue::Boolean(_) => "a boolean",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "an array",
        DeValue::Table(_) => "a table",
    }
}

/// The single document that every renderer receives.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Flattened {
    /// TOML with includes resolved and overrides applied, without defaults. Paths of files are
    /// relative to the base folder.
    pub text: String,
    /// Folder that the paths are relative to; absolute if the working folder is known.
    pub base: PathBuf,
    /// Hash of everything that the image depends on: the document without `accelerator` and
    /// `expect`, and the bytes of every file that it or a glTF file of a mesh names.
    pub hash: String,
    /// The named files, and those that a glTF file of a mesh names, relative to the working folder.
    pub files: Vec<PathBuf>,
}

/// The merged document without positions, and the files that it names.
pub(crate) struct Plain {
    table: toml::Table,
    /// As the text names them.
    files: Vec<String>,
}

impl Plain {
    /// Copies the values.
    pub(crate) fn new(merged: &DeTable<'_>, sources: &Sources) -> (Self, SceneErrors) {
        let mut errors = SceneErrors::default();
        let mut files = Vec::new();
        let mut table = toml::Table::new();
        for (key, value) in merged.iter() {
            let value = match value.get_ref() {
                DeValue::Array(items) if items.len() > MANY => {
                    toml::Value::Array(plain_list(items, sources, &mut files, &mut errors))
                }
                _ => plain(value, Some(key.get_ref()), sources, &mut files, &mut errors),
            };
            table.insert(key.get_ref().to_string(), value);
        }
        (Self { table, files }, errors)
    }

    /// Writes the text, and hashes it and the files.
    pub(crate) fn flatten(self, sources: &Sources) -> Flattened {
        let Self { mut table, files } = self;
        let text = to_text(&table);
        let removed = [table.remove("accelerator"), table.remove("expect")];
        let mut is_shorter = removed.iter().any(Option::is_some);
        if let Some(groups) = table.get_mut("group").and_then(toml::Value::as_table_mut) {
            for (_, group) in groups.iter_mut() {
                let removed = group.as_table_mut().and_then(|group| group.remove("accelerator"));
                is_shorter |= removed.is_some();
            }
        }
        let mut hasher = blake3::Hasher::new();
        let shorter = is_shorter.then(|| to_text(&table));
        hasher.update(shorter.as_ref().unwrap_or(&text).as_bytes());
        let mut files: Vec<_> = files.iter().map(|path| sources.base().join(path)).collect();
        files.extend_from_slice(sources.companions());
        let mut known: BTreeSet<PathBuf> = files.iter().cloned().collect();
        for path in known.clone() {
            let of_mesh = companions(&path).into_iter();
            files.extend(
                of_mesh.filter(|path| sources.check_root(path).is_ok() && known.insert(path.clone())),
            );
        }
        let mut hashes = BTreeMap::new();
        for path in &files {
            // A file is read once, however often the scene names it.
            hasher.update(hashes.entry(path.clone()).or_insert_with(|| content_hash(path)));
        }
        let hash = hasher.finalize().to_hex()[..32].to_owned();
        let base = std::path::absolute(sources.base()).unwrap_or_else(|_| sources.base().to_owned());
        Flattened {
            text,
            base,
            hash,
            files,
        }
    }
}

/// Maximum size of a file whose contents are hashed, in bytes.
const MAX_HASHED: u64 = 16 << 30;

/// Hash of a file's bytes. Zeros for an unreadable file, which the plugin that needs it reports.
fn content_hash(path: &Path) -> [u8; 32] {
    let read = || {
        // Opening a pipe would wait for a writer, and files of the system without a length may
        // never end. Nothing reads a file beyond the limit.
        let metadata = std::fs::metadata(path).ok()?;
        if !metadata.is_file() || !(1..=MAX_HASHED).contains(&metadata.len()) {
            return None;
        }
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(std::fs::File::open(path).ok()?).ok()?;
        Some(*hasher.finalize().as_bytes())
    };
    read().unwrap_or_default()
}

fn to_text(table: &toml::Table) -> String {
    // Not `toml::to_string`: it inserts tables that precede values of their parent into the
    // finished text one by one, which takes quadratic time.
    let mut buffer = toml::ser::Buffer::new();
    table
        .serialize(toml::Serializer::new(&mut buffer))
        .expect("a table of plain values can be written");
    buffer.to_string()
}

/// The values of a long list without positions. One half is copied in another thread, if there is
/// one.
fn plain_list(
    items: &[Value<'_>],
    sources: &Sources,
    files: &mut Vec<String>,
    errors: &mut SceneErrors,
) -> Vec<toml::Value> {
    let copy = |items: &[Value<'_>]| {
        let (mut files, mut errors) = (Vec::new(), SceneErrors::default());
        let copied: Vec<toml::Value> = items
            .iter()
            .map(|item| plain(item, None, sources, &mut files, &mut errors))
            .collect();
        (copied, files, errors)
    };
    let (first, second) = items.split_at(items.len() / 2);
    let halves = thread::scope(|scope| {
        let worker = thread::Builder::new().spawn_scoped(scope, || copy(second));
        let first = copy(first);
        let second = match worker {
            Ok(worker) => worker.join().unwrap_or_else(|panic| resume_unwind(panic)),
            Err(_) => copy(second),
        };
        [first, second]
    });
    let mut list = Vec::with_capacity(items.len());
    for (copied, named, found) in halves {
        list.extend(copied);
        files.extend(named);
        errors.0.extend(found.0);
    }
    list
}

/// The value without positions. Paths under the key `file` are made relative to the base and
/// collected.
fn plain(
    value: &Value<'_>,
    key: Option<&str>,
    sources: &Sources,
    files: &mut Vec<String>,
    errors: &mut SceneErrors,
) -> toml::Value {
    match value.get_ref() {
        DeValue::String(text) if key == Some("file") => {
            let path = slashes(&sources.relative_to_base(&value.span(), text));
            if let Err(problem) = sources.check_root(&sources.base().join(&path)) {
                errors.0.push(SceneError::at(value.span(), problem));
                return toml::Value::String(path);
            }
            files.push(path.clone());
            toml::Value::String(path)
        }
        DeValue::String(text) => toml::Value::String(text.to_string()),
        DeValue::Integer(number) => match i64::from_str_radix(number.as_str(), number.radix()) {
            Ok(number) => toml::Value::Integer(number),
            Err(_) => {
                let message = format!("{} is not a 64-bit integer", number.as_str());
                errors.0.push(SceneError::at(value.span(), message));
                toml::Value::Integer(0)
            }
        },
        DeValue::Float(number) => toml::Value::Float(number.as_str().parse().unwrap_or(f64::NAN)),
        DeValue::Boolean(flag) => toml::Value::Boolean(*flag),
        DeValue::Datetime(time) => toml::Value::Datetime(*time),
        DeValue::Array(items) => toml::Value::Array(
            items
                .iter()
                .map(|item| plain(item, None, sources, files, errors))
                .collect(),
        ),
        DeValue::Table(table) => toml::Value::Table(
            table
                .iter()
                .map(|(key, item)| {
                    let name = key.get_ref().to_string();
                    let item = plain(item, Some(&name), sources, files, errors);
                    (name, item)
                })
                .collect(),
        ),
    }
}

fn slashes(path: &Path) -> String {
    path.to_string_lossy().replace('\\', "/")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(shapes: usize) -> toml::Table {
        let shape = "[[shape]]\nmaterial = { type = \"matte\", reflectance = 0.5 }\nradius = 0.01\n";
        shape.repeat(shapes).parse().unwrap()
    }

    #[test]
    fn the_text_is_that_of_the_toml_crate() {
        let text = "a = 1\n[[shape]]\nb = { c = 2, d = { e = [3.5] } }\nf = true\n[[shape]]\n[group.g]\n";
        for table in [table(3), text.parse().unwrap(), toml::Table::new()] {
            assert_eq!(to_text(&table), toml::to_string(&table).unwrap());
        }
    }
}
