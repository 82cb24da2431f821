use std::fmt;
use std::ops::Range;
use thiserror::Error;

/// A byte range in the scene's source text. The files of a scene share one range, one after the
/// other; the scene crate's source map converts a range to file, line and column.
pub type SourceSpan = Range<usize>;

/// An error in a scene, with its position.
#[derive(Clone, Debug, Error, PartialEq, Eq, Hash)]
#[error("{message}")]
pub struct SceneError {
    /// The offending value; `None` only if there is no position (an empty document).
    pub span: Option<SourceSpan>,
    /// The fault, and what was expected.
    pub message: String,
    /// A hint on how to fix it.
    pub help: Option<String>,
}

impl SceneError {
    /// An error at a position.
    pub fn at(span: SourceSpan, message: impl Into<String>) -> Self {
        Self {
            span: Some(span),
            message: message.into(),
            help: None,
        }
    }

    /// An error without a position; the caller that knows the plugin's table adds it.
    pub fn anywhere(message: impl Into<String>) -> Self {
        Self {
            span: None,
            message: message.into(),
            help: None,
        }
    }

    /// Adds a hint.
    #[must_use]
    pub fn with_help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

/// All errors of a scene; never empty if returned as an error.
#[derive(Clone, Debug, Default, Error, PartialEq, Eq)]
pub struct SceneErrors(pub Vec<SceneError>);

impl SceneErrors {
    /// Collects the errors of a failed step, or returns the value of a successful one.
    pub fn take<T>(&mut self, result: Result<T, Self>) -> Option<T> {
        match result {
            Ok(value) => Some(value),
            Err(errors) => {
                self.0.extend(errors.0);
                None
            }
        }
    }

    /// Sets `span` as the position of errors that have none.
    #[must_use]
    pub fn or_at(mut self, span: &SourceSpan) -> Self {
        for error in &mut self.0 {
            error.span.get_or_insert_with(|| span.clone());
        }
        self
    }

    /// `Ok(value)` if there are no errors, otherwise all of them.
    pub fn into_result<T>(self, value: T) -> Result<T, Self> {
        if self.0.is_empty() { Ok(value) } else { Err(self) }
    }
}

impl From<SceneError> for SceneErrors {
    fn from(error: SceneError) -> Self {
        Self(vec![error])
    }
}

impl fmt::Display for SceneErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, error) in self.0.iter().enumerate() {
            if i > 0 {
                f.write_str("\n")?;
            }
            write!(f, "{error}")?;
        }
        Ok(())
    }
}

/// A plugin type was registered twice.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{family} type \"{name}\" is registered twice: by {first} and by {second}")]
pub struct DuplicateType {
    /// The family, such as "shape".
    pub family: &'static str,
    /// The TOML `type`.
    pub name: &'static str,
    /// The crate that registered it first.
    pub first: &'static str,
    /// The crate that registered it again.
    pub second: &'static str,
}

/// The candidate nearest to `name` by edit distance, if near enough to be a typo.
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    candidates
        .into_iter()
        .map(|candidate| (edit_distance(name, candidate), candidate))
        .min()
        .filter(|(distance, candidate)| *distance <= 1 + candidate.len().max(name.len()) / 4)
        .map(|(_, candidate)| candidate)
}

/// Number of letters to insert, remove, replace or swap with a neighbour (optimal string
/// alignment).
fn edit_distance(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let mut before: Vec<usize> = Vec::new();
    let mut above: Vec<usize> = (0..=b.len()).collect();
    for i in 0..a.len() {
        let mut row = vec![i + 1];
        for j in 0..b.len() {
            let replaced = above[j] + usize::from(a[i] != b[j]);
            let mut least = replaced.min(row[j] + 1).min(above[j + 1] + 1);
            if i > 0 && j > 0 && a[i] == b[j - 1] && a[i - 1] == b[j] {
                least = least.min(before[j - 1] + 1);
            }
            row.push(least);
        }
        before = std::mem::replace(&mut above, row);
    }
    above[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn typos_are_found_and_other_names_are_not() {
        let known = ["sphere", "plane", "rectangle"];
        assert_eq!(nearest("shpere", known), Some("sphere"));
        assert_eq!(nearest("rectangel", known), Some("rectangle"));
        assert_eq!(nearest("bhv", ["bvh"]), Some("bvh"));
        assert_eq!(nearest("teapot", known), None);
        assert_eq!(nearest("", known), None);
    }
}
