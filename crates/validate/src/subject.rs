//! A renderer under test that is not Whitstone: a command that renders an exported scene.
//!
//! A subject is a table `[subject.NAME]` of a file `whitstone.toml`, or `NAME={...}` on the command
//! line. The module `render` exports a scene, runs the command and reads the image.

mod arguments;
mod camera;
mod process;
pub(crate) mod render;

use crate::stop::Stop;
use arguments::Arguments;
pub(crate) use camera::shifted;
pub use render::SubjectError;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;
use toml::Spanned;
use toml::de::DeTable;
use whitstone_core::config::{Finite, IntegerIn, Positive, Table, decode};
use whitstone_core::{Registry, SceneError, SceneErrors, nearest};
use whitstone_image::{Image, Transfer};
use whitstone_scene::{Flattened, Sources};

/// The name of the file with subjects.
pub const CONFIG_FILE: &str = "whitstone.toml";
/// Maximum size of this file in bytes.
const MAX_BYTES: u64 = 1 << 20;
/// Default time limit of a run in seconds.
const TIME_LIMIT: f64 = 300.0;
/// Default memory limit of a run in GiB.
const MEMORY_LIMIT: f64 = 8.0;
/// Bytes in a GiB.
const GIB: f64 = (1_u64 << 30) as f64;

/// A renderer under test.
#[derive(Clone, Debug, PartialEq)]
pub struct Subject {
    /// Its name.
    pub name: String,
    /// The program and its arguments.
    arguments: Arguments,
    /// Working folder of the command: that of the configuration file.
    pub folder: PathBuf,
    /// The format that scenes are exported to.
    pub scene: String,
    /// The extension of the exported file.
    pub extension: String,
    /// The extension of the image.
    pub output: Output,
    /// How codes of a PNG file are decoded.
    pub transfer: Transfer,
    /// The channels with this prefix are the colour of an EXR file; empty for `R`, `G`, `B`.
    pub layer: String,
    /// The value of `{samples}`.
    pub samples: u32,
    /// Number of runs of a noisy subject, each with its own `{seed}`; 1 if it is deterministic.
    pub runs: u32,
    /// Time limit of a run.
    pub time_limit: Duration,
    /// Maximum memory of all processes of a run in bytes.
    pub memory_limit: u64,
    /// Changes of every scene, on both sides.
    pub set: Vec<String>,
    /// Where the subject samples a pixel, relative to its centre, in pixels: to the right and down.
    pub offset: [f64; 2],
    /// Whether the columns, and whether the rows of its images are reversed.
    pub flip: [bool; 2],
    /// The factor that takes its values to those of the model.
    pub scale: f64,
    /// Limits instead of the usual ones, with the reason.
    pub expect: Option<Expect>,
}

/// A single rendering by a subject.
#[derive(Clone, Copy)]
pub struct Once<'a> {
    /// The formats of scenes.
    pub registry: &'a Registry,
    /// The folder of all results.
    pub target: &'a Path,
    /// The folder of the scene's files, relative to that of the subject.
    pub folder: &'a Path,
    /// The scene.
    pub scene: &'a Flattened,
    /// Columns and rows.
    pub size: [usize; 2],
    /// The value of `{samples}`.
    pub samples: u32,
    /// The value of `{threads}`.
    pub threads: usize,
    /// A request to stop early.
    pub stop: &'a Stop,
}

/// Limits of a subject, with the reason.
#[derive(Clone, Debug, PartialEq)]
pub struct Expect {
    /// Limit of the interior error.
    pub interior: Option<f64>,
    /// Limit of the explained pixels.
    pub explained: Option<usize>,
    /// Why the usual limits do not apply.
    pub reason: String,
}

/// The kind of the image that a subject writes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Output {
    /// OpenEXR.
    #[default]
    Exr,
    /// PNG of 8 or 16 bits.
    Png,
    /// Radiance RGBE.
    Hdr,
    /// Portable float map.
    Pfm,
}

impl Output {
    /// The extension of the file.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Exr => "exr",
            Self::Png => "png",
            Self::Hdr => "hdr",
            Self::Pfm => "pfm",
        }
    }
}

/// The names of the transfer functions.
const TRANSFERS: [&str; 3] = ["linear", "srgb", "gamma"];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SubjectTable {
    command: Spanned<String>,
    scene: Option<Spanned<String>>,
    #[serde(default)]
    output: Output,
    transfer: Option<Spanned<String>>,
    gamma: Option<Spanned<Positive>>,
    layer: Option<Spanned<String>>,
    samples: Option<IntegerIn<1, 1_000_000>>,
    runs: Option<Spanned<IntegerIn<4, 4096>>>,
    time_limit: Option<Positive>,
    memory_limit: Option<Spanned<Positive>>,
    #[serde(default)]
    set: Vec<String>,
    offset: Option<[Finite; 2]>,
    flip: Option<Spanned<String>>,
    scale: Option<Positive>,
    expect: Option<Spanned<ExpectTable>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ExpectTable {
    interior: Option<Positive>,
    explained: Option<IntegerIn<0, 1_000_000>>,
    reason: Spanned<String>,
}

impl Subject {
    /// The subject that an argument of the command line names: `NAME`, a table of `config` or of
    /// the file [`CONFIG_FILE`] in the current folder or one of its parents; or `NAME={...}`, the
    /// table itself.
    ///
    /// # Errors
    /// All errors in the table, as a report with positions.
    pub fn find(argument: &str, config: Option<&Path>, registry: &Registry) -> Result<Self, String> {
        let here = std::env::current_dir().map_err(|error| format!("the current folder: {error}"))?;
        if argument.contains('=') {
            let name = format!("--subject {argument}");
            let name_of = |names: Vec<String>| match <[String; 1]>::try_from(names) {
                Ok([name]) => Ok(name),
                Err(_) => Err("expected one subject: NAME = { command = ... }".to_owned()),
            };
            return Self::parse(&name, &format!("subject.{argument}"), &here, registry, name_of);
        }
        let path = match config {
            Some(path) => path.to_owned(),
            None => (here.ancestors().map(|folder| folder.join(CONFIG_FILE)))
                .find(|path| path.is_file())
                .ok_or_else(|| {
                    format!(
                        "subject \"{argument}\": there is no {CONFIG_FILE} in {} or the folders above it",
                        here.display()
                    )
                })?,
        };
        let shown = path.display().to_string();
        let metadata = std::fs::metadata(&path).map_err(|error| format!("{shown}: {error}"))?;
        if !metadata.is_file() || metadata.len() > MAX_BYTES {
            return Err(format!("{shown}: expected a file of at most {MAX_BYTES} bytes"));
        }
        let text = std::fs::read_to_string(&path).map_err(|error| format!("{shown}: {error}"))?;
        let folder = std::path::absolute(&path).map_err(|error| format!("{shown}: {error}"))?;
        let folder = folder.parent().unwrap_or(&here).to_owned();
        Self::parse(&shown, &text, &folder, registry, |names| {
            if names.iter().any(|name| name == argument) {
                return Ok(argument.to_owned());
            }
            let known = names.iter().map(String::as_str);
            Err(match (nearest(argument, known), names.is_empty()) {
                (Some(near), _) => format!("there is no subject \"{argument}\": did you mean \"{near}\"?"),
                (None, true) => format!("there is no table [subject.{argument}], and no other subject"),
                (None, false) => {
                    format!(
                        "there is no subject \"{argument}\": expected one of {}",
                        names.join(", ")
                    )
                }
            })
        })
    }

    /// Parses a configuration. `choose` picks one of the names in it.
    fn parse(
        name: &str,
        text: &str,
        folder: &Path,
        registry: &Registry,
        choose: impl FnOnce(Vec<String>) -> Result<String, String>,
    ) -> Result<Self, String> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Config {
            #[expect(dead_code, reason = "each table is decoded by itself, with its positions")]
            #[serde(default)]
            subject: BTreeMap<String, toml::Value>,
        }
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let sources = Sources::from_text(name, text, folder, &[])
            .map_err(|error| error.sources.report(&error.errors, false))?;
        let report = |errors: SceneErrors| sources.report(&errors, false);
        let table = DeTable::parse(text).map_err(|error| {
            let span = error.span().unwrap_or_default();
            report(SceneError::at(span, error.message().trim().to_owned()).into())
        })?;
        decode::<Config>(&table).map_err(report)?;
        let subjects = table.get_ref().get("subject");
        let subjects = subjects.and_then(|subjects| subjects.get_ref().as_table());
        let all = || subjects.into_iter().flatten();
        let names = all().map(|(key, _)| key.get_ref().to_string()).collect();
        let chosen = choose(names).map_err(|problem| format!("{name}: {problem}"))?;
        let found = all().find(|(key, _)| *key.get_ref() == chosen);
        let Some((key, value)) = found else {
            return Err(format!("{name}: there is no subject \"{chosen}\""));
        };
        let Some(table) = value.get_ref().as_table() else {
            let message = format!("expected a table, found {}", value.get_ref().type_str());
            return Err(report(SceneError::at(value.span(), message).into()));
        };
        if !is_name(&chosen) {
            let error = SceneError::at(key.span(), "expected a name of letters, digits, - and _");
            return Err(report(error.into()));
        }
        let table: Table<'_> = Spanned::new(value.span(), table.clone());
        let decoded: SubjectTable = decode(&table).map_err(report)?;
        Self::new(chosen, decoded, folder, registry).map_err(report)
    }

    fn new(
        name: String,
        table: SubjectTable,
        folder: &Path,
        registry: &Registry,
    ) -> Result<Self, SceneErrors> {
        let mut errors = SceneErrors::default();
        let mut fail = |span, message: String, help: Option<String>| {
            let error = SceneError::at(span, message);
            errors.0.push(match help {
                Some(help) => error.with_help(help),
                None => error,
            });
        };
        let near = |word: &str, known: &[&str]| {
            nearest(word, known.iter().copied()).map(|near| format!("did you mean \"{near}\"?"))
        };
        let command = &table.command;
        let is_noisy = table.runs.is_some();
        let arguments = Arguments::parse(command.get_ref(), is_noisy).unwrap_or_else(|problem| {
            fail(command.span(), problem.message, problem.help);
            Arguments::default()
        });
        let formats: Vec<&str> = registry.formats().map(|format| format.name()).collect();
        let word = table.scene.as_ref().map_or("toml", |scene| scene.get_ref());
        let format =
            (registry.formats()).find(|format| format.name() == word || format.extensions().contains(&word));
        let (scene, extension) = match format {
            Some(format) if format.name() == word => {
                (word, format.extensions().first().copied().unwrap_or(word))
            }
            Some(format) => (format.name(), word),
            None => {
                let message = format!(
                    "unknown format \"{word}\", expected one of {}",
                    formats.join(", ")
                );
                let span = table.scene.as_ref().map(Spanned::span).unwrap_or_default();
                fail(span, message, near(word, &formats));
                (word, word)
            }
        };
        let (scene, extension) = (scene.to_owned(), extension.to_owned());
        let transfer = match (&table.transfer, &table.gamma) {
            (Some(word), gamma) => match (word.get_ref().as_str(), gamma) {
                ("gamma", Some(gamma)) => Transfer::Gamma(gamma.get_ref().get()),
                ("gamma", None) => {
                    fail(
                        word.span(),
                        "the transfer \"gamma\" needs the key `gamma`".to_owned(),
                        None,
                    );
                    Transfer::Linear
                }
                (_, Some(gamma)) => {
                    fail(
                        gamma.span(),
                        "expected the transfer \"gamma\" with this key".to_owned(),
                        None,
                    );
                    Transfer::Linear
                }
                ("linear", None) => Transfer::Linear,
                ("srgb", None) => Transfer::Srgb,
                (other, None) => {
                    let message = format!(
                        "unknown transfer \"{other}\", expected one of {}",
                        TRANSFERS.join(", ")
                    );
                    fail(word.span(), message, near(other, &TRANSFERS));
                    Transfer::Linear
                }
            },
            (None, Some(gamma)) => {
                fail(
                    gamma.span(),
                    "expected the transfer \"gamma\" with this key".to_owned(),
                    None,
                );
                Transfer::Linear
            }
            (None, None) => {
                if table.output == Output::Png {
                    let message = "a PNG file does not state how its codes represent light".to_owned();
                    let help = format!("add `transfer`, one of {}", TRANSFERS.join(", "));
                    fail(command.span(), message, Some(help));
                }
                Transfer::Linear
            }
        };
        if let Some(layer) = &table.layer
            && table.output != Output::Exr
        {
            let message = "only EXR files have layers".to_owned();
            fail(layer.span(), message, None);
        }
        if let Some(limit) = &table.memory_limit
            && !process::MEASURES_MEMORY
        {
            let message = "the memory of a subject can be limited on Linux only".to_owned();
            fail(limit.span(), message, None);
        }
        let flip = match table.flip.as_ref().map(|flip| (flip, flip.get_ref().as_str())) {
            None => [false; 2],
            Some((_, "x")) => [true, false],
            Some((_, "y")) => [false, true],
            Some((_, "xy")) => [true; 2],
            Some((flip, other)) => {
                let message = format!("expected \"x\", \"y\" or \"xy\", found \"{other}\"");
                fail(flip.span(), message, None);
                [false; 2]
            }
        };
        let expect = table.expect.map(|expect| {
            let span = expect.span();
            let expect = expect.into_inner();
            if expect.reason.get_ref().trim().is_empty() {
                fail(expect.reason.span(), "expected a reason".to_owned(), None);
            }
            if expect.interior.is_none() && expect.explained.is_none() {
                fail(span, "expected `interior` or `explained`".to_owned(), None);
            }
            Expect {
                interior: expect.interior.map(Positive::get),
                explained: expect.explained.map(|count| count.get() as usize),
                reason: expect.reason.into_inner(),
            }
        });
        errors.into_result(Self {
            name,
            arguments,
            folder: folder.to_owned(),
            scene,
            extension,
            output: table.output,
            transfer,
            layer: table.layer.map(Spanned::into_inner).unwrap_or_default(),
            samples: table.samples.map_or(1, IntegerIn::get),
            runs: table.runs.map_or(1, |runs| runs.get_ref().get()),
            time_limit: seconds(table.time_limit.map_or(TIME_LIMIT, Positive::get)),
            memory_limit: (GIB
                * table
                    .memory_limit
                    .map_or(MEMORY_LIMIT, |limit| limit.get_ref().get())) as u64,
            set: table.set,
            offset: table.offset.map_or([0.0; 2], |offset| offset.map(Finite::get)),
            flip,
            scale: table.scale.map_or(1.0, Positive::get),
            expect,
        })
    }

    /// The change of a flattened scene, as for `--set`, after which the centres of its pixels are
    /// where the subject samples.
    pub(crate) fn shifted(&self, scene: &str) -> Result<String, String> {
        shifted(scene, self.offset)
    }

    /// Renders a scene once. Returns the image and the wall time of the whole command in seconds.
    ///
    /// # Errors
    /// If its format cannot express the scene, or the command fails.
    pub fn render_once(&self, once: &Once<'_>) -> Result<(Image, f64), SubjectError> {
        let subject = Self {
            samples: once.samples,
            runs: 1,
            ..self.clone()
        };
        let job = render::Job {
            registry: once.registry,
            target: once.target,
            folder: once.folder,
            scene: once.scene,
            size: once.size,
            threads: once.threads,
            stage: &|_| (),
            stop: once.stop,
        };
        let rendered = render::render(&subject, &job)?;
        Ok((rendered.image, rendered.run.seconds))
    }

    /// The change of a flattened scene, as for `--set`, after which the subject samples the centres
    /// of its pixels; none if it does so anyway.
    ///
    /// # Errors
    /// If the camera cannot be shifted by a part of a pixel.
    pub fn centered(&self, scene: &Flattened) -> Result<Option<String>, String> {
        let back = self.offset.map(|part| -part);
        let is_centered = self.offset == [0.0; 2];
        (!is_centered).then(|| shifted(&scene.text, back)).transpose()
    }

    /// Whether its command depends on the number of samples.
    pub fn takes_samples(&self) -> bool {
        self.arguments.has("samples")
    }

    /// Whether its images have noise.
    pub fn is_noisy(&self) -> bool {
        self.runs > 1
    }
}

/// A duration; the longest one if it is longer than that.
fn seconds(seconds: f64) -> Duration {
    Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX)
}

/// Whether a text can be the name of a subject, which is also the name of a folder.
fn is_name(text: &str) -> bool {
    !text.is_empty()
        && text
            .chars()
            .all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_')
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A registry with one format, which is all that the tests need.
    fn registry() -> Registry {
        struct Gltf;
        impl whitstone_core::SceneFormat for Gltf {
            fn name(&self) -> &'static str {
                "gltf"
            }
            fn extensions(&self) -> &'static [&'static str] {
                &["gltf"]
            }
            fn features(&self) -> &'static [whitstone_core::Feature] {
                &[]
            }
        }
        let mut registry = Registry::default();
        registry.add_format(Gltf);
        registry
    }

    fn parsed(text: &str) -> Result<Subject, String> {
        Subject::parse("w.toml", text, Path::new("/c"), &registry(), |names| {
            names
                .first()
                .cloned()
                .ok_or_else(|| "there is no subject".to_owned())
        })
    }

    #[test]
    fn a_table_is_read() {
        let subject = parsed(
            "[subject.tracer]\ncommand = \"./tracer '{scene}' -o{output} --seed {seed}\"\nscene = \"gltf\"\n\
             output = \"png\"\ntransfer = \"gamma\"\ngamma = 2.2\nruns = 16\nsamples = 4\ntime_limit = 1.5\n\
             memory_limit = 0.5\nset = [\"film.width=3\"]\noffset = [0.5, -0.5]\nflip = \"y\"\nscale = 2\n\
             expect = { interior = 1e-4, reason = \"half floats\" }\n",
        )
        .unwrap();
        assert_eq!(
            (subject.name.as_str(), subject.runs, subject.samples),
            ("tracer", 16, 4)
        );
        assert_eq!(
            (subject.output, subject.transfer),
            (Output::Png, Transfer::Gamma(2.2))
        );
        assert_eq!(
            (subject.offset, subject.flip, subject.scale),
            ([0.5, -0.5], [false, true], 2.0)
        );
        assert_eq!(subject.time_limit, Duration::from_millis(1500));
        assert_eq!(subject.memory_limit, 1 << 29);
        let expect = subject.expect.unwrap();
        assert_eq!((expect.interior, expect.explained), (Some(1e-4), None));
    }

    /// Every error names file, line and column, what was expected and the nearest name.
    #[test]
    fn errors_have_positions_and_advice() {
        let head = "[subject.t]\ncommand = \"t {scene} {output}\"\nscene = \"gltf\"\n";
        for (more, place, expected) in [
            ("sample = 3\n", "w.toml:4:1", "samples"),
            ("output = \"bmp\"\n", "w.toml:4:10", "exr"),
            ("output = \"png\"\n", "w.toml:2:11", "add `transfer`"),
            ("transfer = \"sgrb\"\n", "w.toml:4:12", "did you mean \"srgb\"?"),
            ("gamma = 2\n", "w.toml:4:9", "expected the transfer \"gamma\""),
            ("transfer = \"gamma\"\n", "w.toml:4:12", "needs the key `gamma`"),
            ("runs = 3\n", "w.toml:4:8", "from 4 to 4096"),
            ("runs = 4\n", "w.toml:2:11", "{seed}"),
            ("time_limit = -1\n", "w.toml:4:14", "greater than 0"),
            ("flip = \"z\"\n", "w.toml:4:8", "\"x\", \"y\" or \"xy\""),
            ("expect = { interior = 1 }\n", "w.toml:4:10", "reason"),
            (
                "expect = { reason = \"x\" }\n",
                "w.toml:4:10",
                "`interior` or `explained`",
            ),
            (
                "expect = { interior = 1, reason = \" \" }\n",
                "w.toml:4:35",
                "expected a reason",
            ),
            (
                "output = \"pfm\"\nlayer = \"a\"\n",
                "w.toml:5:9",
                "only EXR files have layers",
            ),
        ] {
            let error = parsed(&format!("{head}{more}")).unwrap_err();
            assert!(
                error.contains(place) && error.contains(expected),
                "{more}\n{error}"
            );
        }
        for (text, expected) in [
            (
                "[subject.t]\ncommand = \"t {scene} {output}\"\nscene = \"glft\"\n",
                "did you mean \"gltf\"?",
            ),
            ("[subject.t]\nscene = \"gltf\"\n", "command"),
            ("[subject.\"a/b\"]\ncommand = \"t\"\n", "letters, digits"),
            ("[subject]\nt = 3\n", "expected a table, found integer"),
            ("[subjects.t]\n", "subject"),
            ("x = \n", "w.toml:1:"),
            ("", "subject"),
        ] {
            let error = parsed(text).unwrap_err();
            assert!(error.contains(expected), "{text}\n{error}");
        }
    }

    #[test]
    fn a_table_on_the_command_line_needs_no_file() {
        let table = "t={command='t {scene} {output}', scene='gltf'}";
        assert_eq!(Subject::find(table, None, &registry()).unwrap().name, "t");
        let error = Subject::find("t={command='t {scne} {output}', scene='gltf'}", None, &registry());
        let error = error.unwrap_err();
        assert!(error.contains("did you mean {scene}?"), "{error}");
    }

    #[test]
    fn an_unknown_name_is_reported_with_the_nearest_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("w.toml");
        let text = "[subject.tracer]\ncommand = \"t {scene} {output}\"\nscene = \"gltf\"\n";
        std::fs::write(&path, text).unwrap();
        let find = |name: &str| Subject::find(name, Some(&path), &registry());
        assert_eq!(find("tracer").unwrap().folder, folder.path());
        assert!(find("tarcer").unwrap_err().contains("did you mean \"tracer\"?"));
        assert!(find("x").unwrap_err().contains("expected one of tracer"));
    }
}
