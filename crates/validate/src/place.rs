//! Maps problems that a driver reports to their places in the scene's files.

use std::path::Path;
use whitstone_core::{Registry, SceneError, SceneErrors, SourceSpan};
use whitstone_scene::{Description, Sources};

/// Converts the problems that a driver reports to errors with file and line. Each line of
/// `problems` begins with a place in the document (`shape[3].material: ...`).
pub(crate) fn report(path: &Path, overrides: &[String], registry: &Registry, problems: &str) -> String {
    let Ok(sources) = Sources::load(path, overrides, registry) else {
        return problems.to_owned();
    };
    let Ok(description) = Description::parse(&sources).into_result() else {
        return problems.to_owned();
    };
    let errors = problems.lines().map(|line| {
        let (place, text) = split_place(line);
        match span(&description, place) {
            Some(span) => SceneError::at(span, text),
            None => SceneError::anywhere(line),
        }
    });
    sources.report(&SceneErrors(errors.collect()), false)
}

/// Splits a driver's line into the place and the problem.
pub(crate) fn split_place(line: &str) -> (&str, &str) {
    line.split_once(": ").unwrap_or(("", line))
}

/// The span of the `type` key of the plugin that contains a place in the document.
fn span(description: &Description<'_>, place: &str) -> Option<SourceSpan> {
    let (first, rest) = place.split_once('.').unwrap_or((place, ""));
    let (name, index) = match first.split_once('[') {
        Some((name, index)) => (name, index.strip_suffix(']')?.parse::<usize>().ok()),
        None => (first, None),
    };
    let id = rest.split('.').next().unwrap_or("");
    let of = |span: &SourceSpan| Some(span.clone()).filter(|span| !span.is_empty());
    match (name, index) {
        ("camera", _) => of(&description.camera.name_span),
        ("sampler", _) => of(&description.sampler.as_ref()?.name_span),
        ("integrator", _) => of(&description.integrator.as_ref()?.name_span),
        ("light", Some(index)) => of(&description.lights.get(index)?.name_span),
        ("shape", Some(index)) => {
            let shape = description.shapes.get(index)?;
            match &shape.material {
                Some((span, _)) if id == "material" => of(span),
                _ => of(&shape.plugin.name_span),
            }
        }
        ("material", _) => of(&description.materials.get(id)?.name_span),
        ("texture", _) => of(&description.textures.get(id)?.name_span),
        ("group", _) => {
            let index = rest.split('[').nth(1)?.split(']').next()?.parse::<usize>().ok()?;
            let shape = description.groups.get(id)?.shapes.get(index)?;
            of(&shape.plugin.name_span)
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_problem_is_told_at_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.toml");
        let lines = [
            "[camera]",
            "type = \"perspective\"",
            "look_at = { origin = [0, 0, 1], target = [0, 0, 0] }",
            "[group.wheel]",
            "[[group.wheel.shape]]",
            "type = \"sphere\"",
            "[material.gold]",
            "type = \"mirror\"",
            "[[light]]",
            "type = \"point\"",
            "[[shape]]",
            "type = \"sphere\"",
            "material = { type = \"matte\" }",
        ];
        std::fs::write(&path, lines.join("\n")).unwrap();
        for (place, line) in [
            ("camera", 2),
            ("group.wheel.shape[0]", 6),
            ("material.gold", 8),
            ("light[0].position", 10),
            ("shape[0]", 12),
            ("shape[0].material.reflectance", 13),
        ] {
            let told = report(&path, &[], &Registry::default(), &format!("{place}: has no twin"));
            assert!(
                told.contains(&format!("scene.toml:{line}:")) && told.contains("has no twin"),
                "{place}: {told}"
            );
        }
        assert!(
            report(&path, &[], &Registry::default(), "film.aovs: nothing").contains("film.aovs: nothing")
        );
    }
}
