//! The command line of a slim binary, which renders one scene to one EXR file.
//!
//! `cargo xtask slim SCENE` generates a package that links this crate without its features, and
//! only the plugins that the scene names. Argument parsing, progress bars, comparisons and reports
//! belong to the features, so they are not linked.

use crate::terminal::{self, Exit, Failure};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use whitstone_core::{DuplicateType, Registry};
use whitstone_image::exr_io;
use whitstone_render::{BuildOptions, Film, Pipeline, RenderOptions};
use whitstone_scene::Sources;

const USAGE: &str = "SCENE [-o FILE.exr] [--set PATH=VALUE]... [--threads N]";

/// The arguments of the command line.
#[derive(Debug, Default, PartialEq)]
struct Arguments {
    scene: PathBuf,
    output: PathBuf,
    overrides: Vec<String>,
    threads: usize,
}

/// Reads the arguments of the process and renders, with the plugins of `register`.
pub fn run(register: impl FnOnce(&mut Registry) -> Result<(), DuplicateType>) -> ExitCode {
    let mut registry = Registry::default();
    let result = register(&mut registry)
        .map_err(Failure::usage)
        .and_then(|()| parse(std::env::args_os().skip(1)))
        .and_then(|arguments| render(&arguments, &registry));
    terminal::finish(result).into()
}

fn parse(words: impl Iterator<Item = OsString>) -> Result<Arguments, Failure> {
    let mut arguments = Arguments::default();
    let mut words = words;
    let text = |word: Option<OsString>, after: &str| {
        let word = word.ok_or_else(|| Failure::usage(format!("expected a value after {after}")))?;
        word.into_string()
            .map_err(|_| Failure::usage(format!("the value of {after} is not valid UTF-8")))
    };
    while let Some(word) = words.next() {
        match word.to_str() {
            Some("-o" | "--output") => arguments.output = text(words.next(), "-o")?.into(),
            Some("--set") => arguments.overrides.push(text(words.next(), "--set")?),
            Some("--threads") => {
                let count = text(words.next(), "--threads")?.parse().ok();
                let count = count.filter(|count| *count <= 1024);
                arguments.threads = count
                    .ok_or_else(|| Failure::usage("--threads: expected a whole number from 0 to 1024"))?;
            }
            Some(option) if option.starts_with('-') => {
                return Err(Failure::usage(format!("unknown option {option}; usage: {USAGE}")));
            }
            _ if arguments.scene.as_os_str().is_empty() => arguments.scene = word.into(),
            _ => {
                return Err(Failure::usage(format!(
                    "expected one scene, found two; usage: {USAGE}"
                )));
            }
        }
    }
    if arguments.scene.as_os_str().is_empty() {
        return Err(Failure::usage(format!("expected a scene; usage: {USAGE}")));
    }
    if arguments.output.as_os_str().is_empty() {
        let name = arguments.scene.with_extension("exr");
        arguments.output = name.file_name().unwrap_or_default().into();
    }
    if arguments
        .output
        .extension()
        .is_none_or(|extension| extension != "exr")
    {
        let output = arguments.output.display();
        return Err(Failure::usage(format!(
            "{output}: unknown image format; expected a file name that ends in .exr"
        )));
    }
    Ok(arguments)
}

fn render(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let color = terminal::color();
    let sources = Sources::load(&arguments.scene, &arguments.overrides, registry)
        .map_err(|error| Failure::usage(error.sources.report(&error.errors, color)))?;
    let pipeline = Pipeline::load(&sources, registry, BuildOptions::default())
        .map_err(|errors| Failure::usage(sources.report(&errors, color)))?;
    if !pipeline.warnings.is_empty() {
        eprintln!("{}", sources.report_warnings(&pipeline.warnings, color));
    }
    let film = pipeline.render(RenderOptions {
        threads: arguments.threads,
        ..RenderOptions::default()
    });
    let summary = Summary::new(&arguments.output, &pipeline, &film);
    let image = film.into_image(&pipeline.scene_hash).map_err(Failure::usage)?;
    exr_io::write(&arguments.output, &image).map_err(Failure::environment)?;
    summary.print();
    Ok(Exit::Pass)
}

/// What is printed about a rendered image.
pub(crate) struct Summary {
    /// The image and the speed.
    line: String,
    /// The number of pixels that are not finite, and of all.
    not_finite: (usize, usize),
    /// About shapes whose search for hits reached its limit.
    limits: Vec<String>,
}

impl Summary {
    pub(crate) fn new(output: &Path, pipeline: &Pipeline, film: &Film) -> Self {
        Self {
            line: line(output, pipeline, film),
            not_finite: (film.not_finite(), film.rgb.len()),
            limits: pipeline.scene.geometry.search_limit_notes(),
        }
    }

    /// Prints one line with the image and the speed, and warnings if pixels are not finite, or if
    /// hits may be missing.
    pub(crate) fn print(&self) {
        println!("{}", self.line);
        let (unfit, all) = self.not_finite;
        if unfit > 0 {
            eprintln!(
                "warning: {unfit} of {all} pixels are not finite: their radiance is NaN, or exceeds {:.1e}, the \
                 largest 32-bit float",
                f32::MAX
            );
        }
        for limit in &self.limits {
            eprintln!("warning: {limit}");
        }
    }
}

fn line(output: &Path, pipeline: &Pipeline, film: &Film) -> String {
    let rays = film.counters.total();
    format!(
        "{}: {} x {}, {} samples per pixel, {rays} rays in {:.3} s ({:.2} Mrays/s), built in {:.3} s",
        output.display(),
        film.width,
        film.height,
        film.samples,
        film.render_seconds,
        rays as f64 / film.render_seconds / 1e6,
        pipeline.build_seconds,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(words: &str) -> Result<Arguments, String> {
        parse(words.split_whitespace().map(OsString::from)).map_err(Failure::problem)
    }

    #[test]
    fn arguments_are_read() {
        let arguments =
            parsed("a/b.toml --set film.width=1 --threads 2 -o c.exr --set film.height=2").unwrap();
        assert_eq!(arguments.scene, PathBuf::from("a/b.toml"));
        assert_eq!(arguments.output, PathBuf::from("c.exr"));
        assert_eq!(arguments.overrides, ["film.width=1", "film.height=2"]);
        assert_eq!(arguments.threads, 2);
        assert_eq!(parsed("a/b.toml").unwrap().output, PathBuf::from("b.exr"));
    }

    #[test]
    fn invalid_arguments_are_reported() {
        for (words, expected) in [
            ("", "usage"),
            ("a.toml b.toml", "expected one scene"),
            ("a.toml --png", "unknown option --png"),
            ("a.toml -o", "after -o"),
            ("a.toml -o b.png", ".exr"),
            ("a.toml --threads -1", "from 0 to 1024"),
        ] {
            let message = parsed(words).unwrap_err();
            assert!(message.contains(expected), "{words}: {message}");
        }
    }
}
