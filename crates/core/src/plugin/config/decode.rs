//! Decoding of a plugin's table into its `Config`, with all of its errors.

use super::{INLINE, Table};
use crate::{SceneError, SceneErrors, SourceSpan, nearest};
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

/// How an inline plugin is described in messages.
const INLINE_TABLE: &str = "a table with `type`";

/// Maximum number of errors reported per table. Finding each one costs a copy of the table.
const MOST_ERRORS: usize = 32;

/// Decodes a plugin's table into its `Config` and reports *all* its errors, up to `MOST_ERRORS`.
///
/// Serde stops at the first error. To find the others, the faulty entry is removed and the rest is
/// decoded again; that a removed key is then missing is not reported.
pub fn decode<C: DeserializeOwned>(table: &Table<'_>) -> Result<C, SceneErrors> {
    let mut rest = table.clone();
    let mut removed: Vec<String> = Vec::new();
    let mut errors = SceneErrors::default();
    loop {
        let deserializer =
            ValueDeserializer::from(Spanned::new(rest.span(), DeValue::Table(rest.get_ref().clone())));
        let error = match C::deserialize(deserializer) {
            Ok(config) => return errors.into_result(config),
            Err(error) => error,
        };
        let mut message = error.message().trim().to_owned();
        // An error about a missing key is spurious if that key, or an alternative to it, was
        // removed.
        let missing = message.strip_prefix("missing field ").unwrap_or_default();
        let mut missing = missing.split('`').skip(1).step_by(2);
        let news = !missing.any(|key| removed.iter().any(|removed| removed == key));
        let mut span = error.span().unwrap_or_else(|| table.span());
        if let Some((index, fault)) = split_element(&message)
            && let Some(element) = rest
                .get_ref()
                .values()
                .find_map(|v| element_span(v, &span, index))
        {
            (span, message) = (element, fault.to_owned());
        }
        let path = match span == table.span() {
            true => Vec::new(),
            false => path_to(rest.get_ref(), &span),
        };
        if news {
            errors.0.push(explain(message, span));
        }
        // An error of the table as a whole, such as a missing key, cannot be removed, so decoding
        // stops.
        if path.is_empty() || errors.0.len() >= MOST_ERRORS {
            return Err(errors);
        }
        // A nested table that lacks a removed key is removed as a whole.
        let depth = if news { path.len() } else { 1 };
        removed.push(take_out(rest.get_mut(), &path[..depth]));
    }
}

/// The keys of the nested tables that lead to the value at `span`.
fn path_to(table: &DeTable<'_>, span: &SourceSpan) -> Vec<String> {
    let covers = |outer: SourceSpan| outer.start <= span.start && span.end <= outer.end;
    let mut entries = table.iter();
    let Some((key, value)) = entries.find(|(key, value)| covers(key.span()) || covers(value.span())) else {
        return Vec::new();
    };
    let mut path = vec![key.get_ref().to_string()];
    if let DeValue::Table(inner) = value.get_ref() {
        path.extend(path_to(inner, span));
    }
    path
}

/// Removes the entry at `path`, or the enclosing table if it has no other entry. Returns the
/// removed key.
fn take_out(table: &mut DeTable<'_>, path: &[String]) -> String {
    let [key, inner @ ..] = path else {
        return String::new();
    };
    if !inner.is_empty()
        && let Some(value) = table.get_mut(key.as_str())
        && let DeValue::Table(table) = value.get_mut()
        && table.len() > 1
    {
        return take_out(table, inner);
    }
    table.remove(key.as_str());
    key.clone()
}

/// Splits a message of [`ArrayVisitor`] about one element into its index and the error.
fn split_element(message: &str) -> Option<(usize, &str)> {
    let (index, fault) = message.strip_prefix("element ")?.split_once(": ")?;
    Some((index.parse().ok()?, fault))
}

/// The span of element `index` of the array at `span` in `value`. The TOML deserializer reports the
/// span of the whole array.
fn element_span(value: &Spanned<DeValue<'_>>, span: &SourceSpan, index: usize) -> Option<SourceSpan> {
    match value.get_ref() {
        DeValue::Array(items) if value.span() == *span => Some(items.get(index)?.span()),
        DeValue::Array(items) => items.iter().find_map(|item| element_span(item, span, index)),
        DeValue::Table(table) => table.values().find_map(|item| element_span(item, span, index)),
        _ => None,
    }
}

/// Serde's message with a hint: the nearest known key for an unknown one.
fn explain(message: String, span: SourceSpan) -> SceneError {
    // Type names of the program mean nothing to users.
    let message = match message.split_once("expected struct ") {
        Some((before, _)) => format!("{before}expected a table"),
        None => message.replace(" as i128", ""),
    };
    let mut error = SceneError::at(span, message);
    if let Some(rest) = error.message.strip_prefix("unknown field `")
        && let Some((wrong, known)) = rest.split_once('`')
    {
        let known: Vec<&str> = known.split('`').skip(1).step_by(2).collect();
        let (wrong, help) = (
            wrong.to_owned(),
            match nearest(wrong, known.iter().copied()) {
                Some(name) => format!("did you mean `{name}`?"),
                None if known.is_empty() => "this type has no parameters".to_owned(),
                None => format!("known keys are {}", quoted(&known)),
            },
        );
        error.message = format!("unknown key `{wrong}`");
        error.help = Some(help);
    } else if let Some(rest) = error.message.strip_prefix("unknown variant `")
        && let Some((wrong, known)) = rest.split_once('`')
    {
        let known: Vec<&str> = known.split('`').skip(1).step_by(2).collect();
        let (message, help) = (
            match wrong.starts_with(INLINE) {
                true => format!("wrong type: {INLINE_TABLE}, expected a text"),
                false => format!("unknown value \"{wrong}\""),
            },
            match nearest(wrong, known.iter().copied()) {
                Some(name) => format!("did you mean \"{name}\"?"),
                None => format!("known values are {}", known.join(", ")),
            },
        );
        error.message = message;
        error.help = Some(help);
    } else if let Some(rest) = error.message.strip_prefix("missing field ") {
        error.message = format!("missing key {rest}");
    } else if let Some(rest) = error.message.strip_prefix("invalid type: ") {
        error.message = format!("wrong type: {}", as_written(rest));
    }
    error
}

/// A Serde message in TOML terms, with the user's text in place of an [`inline_reference`].
fn as_written(message: &str) -> String {
    let reference = format!("string \"{}", INLINE.escape_debug());
    let replaced = message.split_once(&reference).and_then(|(before, after)| {
        let (_, after) = after.split_once('"')?;
        Some(format!("{before}{INLINE_TABLE}{after}"))
    });
    let words = replaced.unwrap_or_else(|| message.to_owned());
    words
        .replacen("map, ", "a table, ", 1)
        .replacen("sequence, ", "an array, ", 1)
}

/// `a`, `b`, `c`.
fn quoted(names: &[&str]) -> String {
    let quoted: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
    quoted.join(", ")
}
