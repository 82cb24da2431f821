//! Reduces a failing scene to a minimal reproducer.
//!
//! Zeller and Hildebrandt, *Simplifying and isolating failure-inducing input*, IEEE TSE 28(2),
//! 2002: removes elements of lists in halves, quarters and so on, then keys one by one, until
//! nothing more can be removed.

use crate::opinion::Ask;
use crate::validator::flatten;
use crate::{CaseResult, Validator};
use std::path::Path;
use toml::{Table, Value};

/// The film is not reduced below this width or height in pixels.
const SMALLEST_FILM: i64 = 4;

/// A reduced scene that fails like the given one, as TOML with absolute file paths. `progress`
/// receives the number of values of each smaller scene that still fails.
///
/// # Errors
///
/// If the scene cannot be read, does not fail, or cannot be compared at all.
pub fn reduce(
    validator: &mut Validator<'_>,
    scene: &Path,
    overrides: &[String],
    progress: &dyn Fn(usize),
) -> Result<String, String> {
    validator.without_pictures();
    // There are thousands of candidates, and only a difference matters.
    validator.oracle.when = Ask::Never;
    let flattened = flatten(scene, overrides, validator.registry)?;
    let mut document: Table = toml::from_str(&flattened.text).map_err(|error| error.to_string())?;
    absolute(&mut document, &flattened.base);
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let file = folder.path().join("reduced.toml");
    let mut ask = |document: &Table| -> Result<CaseResult, String> {
        std::fs::write(&file, document.to_string()).map_err(|error| error.to_string())?;
        Ok(validator.validate(&file))
    };
    let first = ask(&document)?;
    if !fails(&first) {
        return Err(if first.problems.is_empty() {
            "the scene does not fail: there is nothing to reduce".to_owned()
        } else {
            format!("the scene cannot be compared: {}", first.problems.join("; "))
        });
    }
    // A candidate that cannot be written or compared is rejected.
    minimize(&mut document, &mut |candidate| {
        let still = ask(candidate).is_ok_and(|case| fails(&case));
        if still {
            progress(size(&Value::Table(candidate.clone())));
        }
        still
    });
    Ok(document.to_string())
}

/// Whether both sides render the scene and disagree.
fn fails(case: &CaseResult) -> bool {
    case.compared && !case.scene_error && !case.problems.is_empty()
}

/// Makes paths independent of the scene's location.
fn absolute(table: &mut Table, base: &Path) {
    for (key, value) in table.iter_mut() {
        match value {
            Value::String(path) if key == "file" => *path = base.join(&*path).display().to_string(),
            Value::Table(table) => absolute(table, base),
            Value::Array(values) => values
                .iter_mut()
                .filter_map(Value::as_table_mut)
                .for_each(|table| absolute(table, base)),
            _ => {}
        }
    }
}

/// The number of values of all kinds.
fn size(value: &Value) -> usize {
    match value {
        Value::Table(table) => table.values().map(size).sum(),
        Value::Array(values) => values.iter().map(size).sum(),
        _ => 1,
    }
}

/// Removes everything that can be removed while `fails` holds.
fn minimize(document: &mut Table, fails: &mut dyn FnMut(&Table) -> bool) {
    smaller_film(document, fails);
    loop {
        let before = document.clone();
        for path in lists(document) {
            shorten(document, &path, fails);
        }
        for path in keys(document) {
            let mut candidate = document.clone();
            if remove(&mut candidate, &path) && fails(&candidate) {
                *document = candidate;
            }
        }
        if *document == before {
            return;
        }
    }
}

/// Reduces the film first, because that makes all further steps faster.
fn smaller_film(document: &mut Table, fails: &mut dyn FnMut(&Table) -> bool) {
    for key in ["width", "height"] {
        while let Some(length) = film(document, key)
            && length / 2 >= SMALLEST_FILM
        {
            let mut candidate = document.clone();
            if let Some(Value::Table(film)) = candidate.get_mut("film") {
                film.insert(key.to_owned(), Value::Integer(length / 2));
            }
            if !fails(&candidate) {
                break;
            }
            *document = candidate;
        }
    }
}

fn film(document: &Table, key: &str) -> Option<i64> {
    document.get("film")?.get(key)?.as_integer()
}

/// A path into a document.
type Way = Vec<Step>;

/// A key, or an index into a list.
#[derive(Clone, Debug, PartialEq)]
enum Step {
    Key(String),
    Place(usize),
}

/// All lists of tables, outer ones first.
fn lists(document: &Table) -> Vec<Way> {
    let mut found = Vec::new();
    walk_table(document, &mut Vec::new(), &mut |path, value| {
        if value
            .as_array()
            .is_some_and(|values| values.iter().all(Value::is_table))
        {
            found.push(path.clone());
        }
    });
    found
}

/// All keys, outer ones first. Skips those of the film, which would become large without them.
fn keys(document: &Table) -> Vec<Way> {
    let mut found = Vec::new();
    walk_table(document, &mut Vec::new(), &mut |path, _| {
        if matches!(path.last(), Some(Step::Key(_))) && path[0] != Step::Key("film".to_owned()) {
            found.push(path.clone());
        }
    });
    found
}

fn walk_table(table: &Table, path: &mut Way, found: &mut dyn FnMut(&Way, &Value)) {
    for (key, value) in table {
        path.push(Step::Key(key.clone()));
        walk(value, path, found);
        path.pop();
    }
}

fn walk(value: &Value, path: &mut Way, found: &mut dyn FnMut(&Way, &Value)) {
    found(path, value);
    match value {
        Value::Table(table) => walk_table(table, path, found),
        Value::Array(values) => {
            for (place, value) in values.iter().enumerate() {
                path.push(Step::Place(place));
                walk(value, path, found);
                path.pop();
            }
        }
        _ => {}
    }
}

fn enter<'a>(document: &'a mut Table, path: &[Step]) -> Option<&'a mut Value> {
    let (first, rest) = path.split_first()?;
    let Step::Key(key) = first else { return None };
    rest.iter()
        .try_fold(document.get_mut(key)?, |value, step| match step {
            Step::Key(key) => value.get_mut(key),
            Step::Place(place) => value.get_mut(*place),
        })
}

/// Removes a key, if it still exists.
fn remove(document: &mut Table, path: &[Step]) -> bool {
    let Some((Step::Key(key), parent)) = path.split_last() else {
        return false;
    };
    let table = if parent.is_empty() {
        Some(document)
    } else {
        enter(document, parent).and_then(Value::as_table_mut)
    };
    table.is_some_and(|table| table.remove(key).is_some())
}

/// Removes elements of a list, the last first, because later elements may refer to earlier ones.
fn shorten(document: &mut Table, path: &[Step], fails: &mut dyn FnMut(&Table) -> bool) {
    let length = |document: &mut Table| enter(document, path).and_then(|list| list.as_array().map(Vec::len));
    let Some(mut part) = length(document) else { return };
    while part > 0 {
        let mut end = length(document).unwrap_or(0);
        while end > 0 {
            let start = end.saturating_sub(part);
            let mut candidate = document.clone();
            if let Some(Value::Array(list)) = enter(&mut candidate, path) {
                list.drain(start..end);
            }
            if fails(&candidate) {
                *document = candidate;
            }
            end = start;
        }
        part /= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENE: &str = "
        [film]
        width = 128
        height = 96
        [camera]
        type = 'perspective'
        fov = 40
        [[light]]
        type = 'point'
        [[light]]
        type = 'ambient'
        [[shape]]
        type = 'sphere'
        radius = 1
        [[shape]]
        type = 'mesh'
        file = 'a.ply'
        [[shape]]
        type = 'sphere'
        radius = 2
        material = { type = 'matte', reflectance = 0.5 }
        [[shape]]
        type = 'disk'
        transform = [{ scale = 2 }, { rotate = { axis = [1, 0, 0], degrees = 90 } }]
    ";

    fn shapes(document: &Table, holds: impl Fn(&Value) -> bool) -> usize {
        let shapes = document.get("shape").and_then(Value::as_array);
        shapes.map_or(0, |shapes| shapes.iter().filter(|shape| holds(shape)).count())
    }

    #[test]
    fn what_has_no_part_in_the_failure_goes() {
        let mut document: Table = toml::from_str(SCENE).unwrap();
        let mut asked = 0;
        minimize(&mut document, &mut |candidate| {
            asked += 1;
            // The larger sphere under a camera, at 10 pixels or more.
            candidate.contains_key("camera")
                && film(candidate, "width").is_some_and(|width| width >= 10)
                && shapes(candidate, |shape| shape.get("radius") == Some(&Value::Integer(2))) == 1
        });
        let expected: Table =
            toml::from_str("film = { width = 16, height = 6 }\ncamera = {}\nshape = [{ radius = 2 }]")
                .unwrap();
        assert_eq!(document, expected);
        assert!(asked < 100, "{asked}");
    }

    #[test]
    fn two_that_fail_together_stay_together() {
        let mut document: Table = toml::from_str(SCENE).unwrap();
        minimize(&mut document, &mut |candidate| {
            shapes(candidate, |shape| shape.get("file").is_some()) == 1
                && shapes(candidate, |shape| shape.get("transform").is_some()) == 1
        });
        assert_eq!(shapes(&document, |_| true), 2);
        // The film, a file, and an empty transform.
        assert_eq!(size(&Value::Table(document)), 3);
    }

    #[test]
    fn nothing_goes_where_all_is_needed() {
        let mut document: Table = toml::from_str(SCENE).unwrap();
        let whole = document.clone();
        minimize(&mut document, &mut |candidate| *candidate == whole);
        assert_eq!(document, whole);
    }

    #[test]
    fn files_are_found_from_anywhere() {
        let mut document: Table = toml::from_str(SCENE).unwrap();
        absolute(&mut document, Path::new("/somewhere"));
        let file = document["shape"][1]["file"].as_str().unwrap();
        assert_eq!(Path::new(file), Path::new("/somewhere/a.ply"));
    }
}
