//! Decoding of a plugin's table into its `Config`, with all of its errors.

use super::Table;
use super::value::Value;
use crate::{SceneErrors, SourceSpan};
use serde::de::DeserializeOwned;
use std::borrow::Cow;
use toml::de::{DeTable, DeValue};

/// Maximum number of errors reported per table. Finding each one costs another decoding.
const MAX_ERRORS: usize = 32;

/// Decodes a plugin's table into its `Config` and reports *all* its errors, up to `MAX_ERRORS`.
///
/// Serde stops at the first error. To find the others, the faulty entry is removed and the rest is
/// decoded again; that a removed key is then missing is not reported. A type that requires one of
/// several keys reports `missing_field("a or b")`.
pub fn decode<C: DeserializeOwned>(table: &Table<'_>) -> Result<C, SceneErrors> {
    let mut rest = Cow::Borrowed(table);
    let mut removed: Vec<String> = Vec::new();
    let mut errors = SceneErrors::default();
    loop {
        let error = match C::deserialize(Value::from(&*rest)) {
            Ok(config) => return errors.into_result(config),
            Err(error) => error,
        };
        // An error about a missing key is spurious if that key, or an alternative to it, was
        // removed.
        let mut missing = error.fault.missing_keys();
        let news = !missing.any(|key| removed.iter().any(|removed| removed == key));
        let path = match &error.span {
            Some(span) if *span != table.span() => path_to(rest.get_ref(), span),
            _ => Vec::new(),
        };
        if news {
            errors.0.push(error.report(table.span()));
        }
        // An error of the table as a whole, such as a missing key, cannot be removed, so decoding
        // stops.
        if path.is_empty() || errors.0.len() >= MAX_ERRORS {
            return Err(errors);
        }
        // A nested table that lacks a removed key is removed as a whole.
        let depth = if news { path.len() } else { 1 };
        removed.push(take_out(rest.to_mut().get_mut(), &path[..depth]));
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
