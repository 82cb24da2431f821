//! A study in TOML: a scene, the parameters to sweep, and the truth that errors are measured
//! against.

use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::Spanned;
use toml::de::DeTable;
use whitstone_core::config::decode;
use whitstone_core::{SceneError, SceneErrors, SourceSpan};
use whitstone_scene::Sources;
use whitstone_validate::Subject;

/// Largest accepted study file, in bytes.
const MAX_BYTES: u64 = 1 << 20;
/// Default error levels.
const LEVELS: [f64; 2] = [1e-2, 1e-3];

/// A renderer or library that is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Deserialize, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Engine {
    /// Whitstone's plugins.
    Whitstone,
    /// Mitsuba, through the driver of the harness.
    Mitsuba,
    /// Mitsuba's own integrator on the exported scene: noisy, without Python while it renders.
    #[serde(rename = "stock mitsuba")]
    StockMitsuba,
    /// The whole command of a renderer: it starts, reads, builds, renders and writes.
    Command,
    /// Embree on the same triangles, in single precision: an accelerator of Whitstone.
    Embree,
    /// The hierarchies of the crate obvhs, likewise.
    Obvhs,
    /// Textbook formulas with numbers of 106 bits; only in studies of stress families.
    #[serde(rename = "naive double-double")]
    NaiveDoubleDouble,
    /// Textbook formulas in double precision; only in studies of stress families.
    #[serde(rename = "naive f64")]
    NaiveF64,
    /// Textbook formulas in single precision; only in studies of stress families.
    #[serde(rename = "naive f32")]
    NaiveF32,
}

/// A renderer that a study file can name.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Renderer {
    Whitstone,
    Mitsuba,
    MitsubaStock,
    Embree,
    Obvhs,
}

impl From<Renderer> for Engine {
    fn from(renderer: Renderer) -> Self {
        match renderer {
            Renderer::Whitstone => Self::Whitstone,
            Renderer::Mitsuba => Self::Mitsuba,
            Renderer::MitsubaStock => Self::StockMitsuba,
            Renderer::Embree => Self::Embree,
            Renderer::Obvhs => Self::Obvhs,
        }
    }
}

impl Engine {
    /// All that render scenes.
    pub const RENDERERS: [Self; 6] = [
        Self::Whitstone,
        Self::Mitsuba,
        Self::StockMitsuba,
        Self::Command,
        Self::Embree,
        Self::Obvhs,
    ];

    /// The type of Whitstone's accelerator that it is, for kernels of others.
    pub(crate) fn accelerator(self) -> Option<&'static str> {
        matches!(self, Self::Embree | Self::Obvhs).then(|| self.name())
    }

    /// The name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Whitstone => "whitstone",
            Self::Mitsuba => "mitsuba",
            Self::StockMitsuba => "stock mitsuba",
            Self::Command => "whole command",
            Self::Embree => "embree",
            Self::Obvhs => "obvhs",
            Self::NaiveDoubleDouble => "naive double-double",
            Self::NaiveF64 => "naive f64",
            Self::NaiveF32 => "naive f32",
        }
    }
}

/// The variable of the slopes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Against {
    /// Samples per pixel.
    #[default]
    Samples,
    /// Rays traced.
    Rays,
    /// Number of triangles and other primitives.
    Primitives,
    /// The swept value.
    Value,
}

impl Against {
    /// The name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Samples => "samples per pixel",
            Self::Rays => "rays",
            Self::Primitives => "primitives",
            Self::Value => "value",
        }
    }
}

/// The numbers of samples of a command.
const SAMPLES: &[u32] = &[1, 4, 16, 64, 256];

/// A text with its position in the file.
type Text = Spanned<String>;
/// The values of each path, in the syntax of `--set`.
type Sweep = BTreeMap<Text, Spanned<Vec<Spanned<toml::Value>>>>;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct StudyTable {
    title: String,
    about: String,
    scene: Text,
    #[serde(default)]
    set: Vec<Text>,
    #[serde(default)]
    against: Against,
    repeats: Option<Spanned<u32>>,
    levels: Option<Spanned<Vec<f64>>>,
    truth: TruthTable,
    series: Spanned<Vec<SeriesTable>>,
    quick: Option<QuickTable>,
    #[serde(default)]
    expect: ExpectTable,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TruthTable {
    #[serde(default = "whitstone")]
    engine: Renderer,
    #[serde(default)]
    set: Vec<Text>,
    /// Whether each series has its own truth, with the changes of the series.
    #[serde(default)]
    of_series: bool,
    /// Other renderings of the truth, to estimate its error.
    #[serde(default)]
    check: Vec<CheckTable>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CheckTable {
    engine: Option<Renderer>,
    #[serde(default)]
    set: Vec<Text>,
}

fn whitstone() -> Renderer {
    Renderer::Whitstone
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SeriesTable {
    name: String,
    #[serde(default = "one_engine")]
    engines: Vec<Renderer>,
    #[serde(default)]
    set: Vec<Text>,
    sweep: Spanned<Sweep>,
    slope: Option<[f64; 2]>,
}

fn one_engine() -> Vec<Renderer> {
    vec![Renderer::Whitstone]
}

/// A study of a stress family: rays at one shape, judged by the oracle.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct StressTable {
    title: String,
    about: String,
    /// Name of the family.
    stress: Text,
}

/// A smaller version of the study with the same expectations, of which only those that do not
/// depend on time count.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct QuickTable {
    #[serde(default)]
    set: Vec<Text>,
    #[serde(default)]
    truth: Vec<Text>,
    /// Use at most this many settings of each series, the first ones.
    points: Option<usize>,
    levels: Option<Vec<f64>>,
}

/// Expectations; none of them depends on time.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExpectTable {
    /// All series have bit-identical errors at equal settings.
    #[serde(default)]
    pub same_error: bool,
    /// Pairs of series: the error of the first falls faster, and the intervals of the slopes do not
    /// overlap.
    #[serde(default)]
    pub steeper: Vec<[String; 2]>,
    /// Pairs of series: the first has the smaller error at each setting that both have.
    #[serde(default)]
    pub smaller: Vec<[String; 2]>,
    /// Errors that Whitstone must reach.
    #[serde(default)]
    pub reached: Vec<f64>,
}

/// A change of the scene, with its position in the study.
#[derive(Clone, Debug)]
pub struct Change {
    /// `path=value`.
    pub text: String,
    /// Position in the study.
    pub span: SourceSpan,
}

impl From<&Text> for Change {
    fn from(text: &Text) -> Self {
        Self {
            text: text.get_ref().clone(),
            span: text.span(),
        }
    }
}

/// One setting of a series.
#[derive(Clone, Debug)]
pub struct Setting {
    /// The setting, such as `sampler.samples_per_axis=4`.
    pub label: String,
    /// The value of the first path, if it is a number.
    pub value: Option<f64>,
    /// The changes that it makes.
    pub changes: Vec<Change>,
}

/// A configuration that is swept by one engine.
#[derive(Clone, Debug)]
pub struct Series {
    /// The name in the study.
    pub name: String,
    /// The renderer.
    pub engine: Engine,
    /// Its command, for [`Engine::Command`].
    pub subject: Option<Subject>,
    /// The changes that all settings share.
    pub set: Vec<Change>,
    /// In the order of the study.
    pub settings: Vec<Setting>,
    /// The expected range of the slope, if the study gives one.
    pub slope: Option<[f64; 2]>,
}

/// A rendering that serves as the truth or as a check of it.
#[derive(Clone, Debug)]
pub struct Truth {
    /// The renderer.
    pub engine: Engine,
    /// Its changes of the scene.
    pub set: Vec<Change>,
}

/// A parsed study.
#[derive(Debug)]
pub struct Study {
    /// Name of the file without its extension.
    pub name: String,
    /// The title, one line.
    pub title: String,
    /// The purpose of the study.
    pub about: String,
    /// The scene, as the study names it.
    pub scene: String,
    /// Path of the scene file.
    pub scene_path: PathBuf,
    /// Changes that apply to all renderings.
    pub set: Vec<Change>,
    /// The variable of the slopes.
    pub against: Against,
    /// Number of repeats, if the study sets it.
    pub repeats: Option<u32>,
    /// Error levels.
    pub levels: Vec<f64>,
    /// The truth.
    pub truth: Truth,
    /// Whether each series has its own truth.
    pub truth_of_series: bool,
    /// Other renderings of the truth.
    pub checks: Vec<Truth>,
    /// All series to measure.
    pub series: Vec<Series>,
    /// The expectations.
    pub expect: ExpectTable,
    /// The stress family that replaces a scene.
    pub stress: Option<Change>,
    /// Whether it has a quick version.
    pub has_quick: bool,
    /// Whether this is the quick version.
    pub quick: bool,
    /// The sources, for error reports with positions.
    pub sources: Sources,
}

impl Study {
    /// Reads a study file; `quick` selects its quick version.
    ///
    /// # Errors
    ///
    /// All errors in it, as a report with positions.
    pub fn load(path: &Path, quick: bool) -> Result<Self, String> {
        let shown = path.display().to_string();
        let metadata = std::fs::metadata(path).map_err(|error| format!("{shown}: {error}"))?;
        if !metadata.is_file() || metadata.len() > MAX_BYTES {
            return Err(format!("{shown}: expected a file of at most {MAX_BYTES} bytes"));
        }
        let text = std::fs::read_to_string(path).map_err(|error| format!("{shown}: {error}"))?;
        Self::parse(&shown, &text, path.parent().unwrap_or(Path::new("")), quick)
    }

    /// Parses a study in memory. `name` is the name of its file; the scene path is relative to the
    /// folder `base`.
    ///
    /// # Errors
    ///
    /// As [`Self::load`].
    pub fn parse(name: &str, text: &str, base: &Path, quick: bool) -> Result<Self, String> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let sources = Sources::from_text(name, text, base, &[])
            .map_err(|error| error.sources.report(&error.errors, false))?;
        let report = |errors: SceneErrors| sources.report(&errors, false);
        let table = DeTable::parse(text).map_err(|error| {
            let span = error.span().unwrap_or_default();
            report(SceneError::at(span, error.message().trim().to_owned()).into())
        })?;
        let stem = Path::new(name).file_stem().unwrap_or_default();
        let stem = stem.to_string_lossy().into_owned();
        if table.get_ref().contains_key("stress") {
            let table: StressTable = decode(&table).map_err(report)?;
            return Ok(Self::of_stress(stem, &table, quick, sources));
        }
        let table: StudyTable = decode(&table).map_err(report)?;
        let mut errors = SceneErrors::default();
        check(&table, &mut errors);
        if !errors.0.is_empty() {
            return Err(report(errors));
        }
        let mut study = Self {
            name: stem,
            title: table.title.clone(),
            about: table.about.clone(),
            scene: table.scene.get_ref().clone(),
            scene_path: base.join(table.scene.get_ref()),
            set: changes(&table.set),
            against: table.against,
            repeats: table.repeats.as_ref().map(|repeats| *repeats.get_ref()),
            levels: table
                .levels
                .as_ref()
                .map_or(LEVELS.to_vec(), |levels| levels.get_ref().clone()),
            truth: Truth {
                engine: table.truth.engine.into(),
                set: changes(&table.truth.set),
            },
            truth_of_series: table.truth.of_series,
            checks: table
                .truth
                .check
                .iter()
                .map(|check| Truth {
                    engine: check.engine.unwrap_or(table.truth.engine).into(),
                    set: changes(&check.set),
                })
                .collect(),
            series: table.series.get_ref().iter().flat_map(series).collect(),
            expect: table.expect.clone(),
            stress: None,
            has_quick: table.quick.is_some(),
            quick,
            sources,
        };
        if let Some(table) = table.quick.filter(|_| quick) {
            study.make_quick(table);
        }
        Ok(study)
    }

    fn of_stress(name: String, table: &StressTable, quick: bool, sources: Sources) -> Self {
        Self {
            name,
            title: table.title.clone(),
            about: table.about.clone(),
            scene: String::new(),
            scene_path: PathBuf::new(),
            set: Vec::new(),
            against: Against::Value,
            repeats: None,
            levels: Vec::new(),
            truth: Truth {
                engine: Engine::Whitstone,
                set: Vec::new(),
            },
            truth_of_series: false,
            checks: Vec::new(),
            series: Vec::new(),
            expect: ExpectTable::default(),
            stress: Some(Change::from(&table.stress)),
            has_quick: false,
            quick,
            sources,
        }
    }

    fn make_quick(&mut self, table: QuickTable) {
        self.set.extend(changes(&table.set));
        self.truth.set.extend(changes(&table.truth));
        self.repeats = Some(1);
        if let Some(levels) = table.levels {
            self.expect.reached.clone_from(&levels);
            self.levels = levels;
        }
        let points = table.points.unwrap_or(usize::MAX).max(1);
        for series in &mut self.series {
            series.settings.truncate(points);
        }
    }

    /// Adds a series that renders the scene by a command, with more and more samples. The changes
    /// that the command needs apply to all series and to the truth.
    pub fn add_command(&mut self, subject: &Subject) {
        let change = |text: &str| Change {
            text: text.to_owned(),
            span: 0..0,
        };
        self.set.extend(subject.set.iter().map(|text| change(text)));
        let samples = if subject.takes_samples() {
            SAMPLES
        } else {
            &SAMPLES[..1]
        };
        let settings = samples.iter().map(|&samples| Setting {
            label: format!("samples={samples}"),
            value: Some(samples.into()),
            changes: Vec::new(),
        });
        self.series.push(Series {
            name: subject.name.clone(),
            engine: Engine::Command,
            subject: Some(subject.clone()),
            // The sampler is the command's own.
            set: vec![change("sampler={ type = \"center\" }")],
            settings: settings.collect(),
            slope: None,
        });
    }

    /// The changes of one setting, in the order of application.
    pub fn changes(&self, series: &Series, setting: &Setting) -> Vec<Change> {
        [&self.set[..], &series.set, &setting.changes].concat()
    }

    /// The changes of a truth, for one series.
    pub fn truth_changes(&self, truth: &Truth, series: &Series) -> Vec<Change> {
        let of_series: &[Change] = if self.truth_of_series { &series.set } else { &[] };
        [&self.set[..], of_series, &truth.set].concat()
    }

    /// Formats errors of the study or of the scene that it changes.
    pub fn report(&self, errors: &SceneErrors) -> String {
        self.sources.report(errors, false)
    }
}

fn changes(texts: &[Text]) -> Vec<Change> {
    texts.iter().map(Change::from).collect()
}

fn check(table: &StudyTable, errors: &mut SceneErrors) {
    let mut fail = |span: SourceSpan, message: &str| errors.0.push(SceneError::at(span, message));
    if let Some(repeats) = &table.repeats
        && !(1..=1000).contains(repeats.get_ref())
    {
        fail(repeats.span(), "expected 1 to 1000 repeats");
    }
    if let Some(levels) = &table.levels
        && !levels
            .get_ref()
            .iter()
            .all(|level| *level > 0.0 && level.is_finite())
    {
        fail(levels.span(), "expected errors greater than 0");
    }
    if table.series.get_ref().is_empty() {
        fail(table.series.span(), "a study needs at least one `[[series]]`");
    }
    for series in table.series.get_ref() {
        let sweep = series.sweep.get_ref();
        if sweep.is_empty() {
            fail(
                series.sweep.span(),
                "an empty sweep: expected at least one path of the scene with its values",
            );
        }
        let longest = sweep.values().map(|values| values.get_ref().len()).max();
        for (path, values) in sweep {
            if values.get_ref().is_empty() {
                fail(
                    values.span(),
                    &format!("an empty sweep: `{}` has no values", path.get_ref()),
                );
            } else if Some(values.get_ref().len()) != longest {
                fail(
                    values.span(),
                    "the paths of a sweep advance together: expected as many values as the others have",
                );
            }
        }
    }
    let names = |name: &String| table.series.get_ref().iter().any(|series| series.name == *name);
    let pairs = table.expect.steeper.iter().chain(&table.expect.smaller);
    for name in pairs.flatten().filter(|name| !names(name)) {
        fail(
            table.series.span(),
            &format!(
                "`[expect]` names a series \"{name}\" that does not exist; expected the name of a `[[series]]`"
            ),
        );
    }
}

fn series(table: &SeriesTable) -> Vec<Series> {
    let sweep = table.sweep.get_ref();
    let count = sweep
        .values()
        .map(|values| values.get_ref().len())
        .min()
        .unwrap_or(0);
    let setting = |number: usize| {
        let values = sweep
            .iter()
            .map(|(path, values)| (path, values.get_ref()[number].get_ref()));
        let changes: Vec<Change> = values
            .clone()
            .map(|(path, value)| Change {
                text: format!("{}={value}", path.get_ref()),
                span: path.span(),
            })
            .collect();
        let labels: Vec<&str> = changes.iter().map(|change| change.text.as_str()).collect();
        let number = |value: &toml::Value| value.as_float().or(value.as_integer().map(|whole| whole as f64));
        Setting {
            label: labels.join(" "),
            value: values.clone().find_map(|(_, value)| number(value)),
            changes,
        }
    };
    let settings: Vec<Setting> = (0..count).map(setting).collect();
    table
        .engines
        .iter()
        .map(|engine| {
            let engine = Engine::from(*engine);
            let accelerator = engine.accelerator().map(|name| Change {
                text: format!("accelerator={{ type = \"{name}\" }}"),
                span: table.sweep.span(),
            });
            Series {
                name: table.name.clone(),
                engine,
                subject: None,
                set: changes(&table.set).into_iter().chain(accelerator).collect(),
                settings: settings.clone(),
                slope: table.slope,
            }
        })
        .collect()
}
