//! A study as it is written in TOML: a scene, what is swept, and what the errors are measured
//! against.

use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::Spanned;
use toml::de::DeTable;
use whitstone_core::config::decode;
use whitstone_core::{SceneError, SceneErrors, SourceSpan};
use whitstone_scene::Sources;

/// Largest study that is read, in bytes.
const MAX_BYTES: u64 = 1 << 20;
/// Errors to be reached where a study names none.
const LEVELS: [f64; 2] = [1e-2, 1e-3];

/// Who renders.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Deserialize, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Engine {
    /// The plugins.
    Whitstone,
    /// Mitsuba, by the driver of the harness.
    Mitsuba,
    /// Embree over the same triangles, in single precision; of families of stress cases only.
    Embree,
    /// Textbook forms in double precision; of families of stress cases only.
    #[serde(rename = "naive f64")]
    NaiveF64,
    /// The same in single precision.
    #[serde(rename = "naive f32")]
    NaiveF32,
}

/// Who can be asked for a rendering.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Renderer {
    Whitstone,
    Mitsuba,
}

impl From<Renderer> for Engine {
    fn from(renderer: Renderer) -> Self {
        match renderer {
            Renderer::Whitstone => Self::Whitstone,
            Renderer::Mitsuba => Self::Mitsuba,
        }
    }
}

impl Engine {
    /// As people read it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Whitstone => "whitstone",
            Self::Mitsuba => "mitsuba",
            Self::Embree => "embree",
            Self::NaiveF64 => "naive f64",
            Self::NaiveF32 => "naive f32",
        }
    }
}

/// What the slope is taken against.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Against {
    /// Samples a pixel.
    #[default]
    Samples,
    /// Rays traced.
    Rays,
    /// Triangles and other primitives.
    Primitives,
    /// The value that is swept.
    Value,
}

impl Against {
    /// As people read it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Samples => "samples a pixel",
            Self::Rays => "rays",
            Self::Primitives => "primitives",
            Self::Value => "value",
        }
    }
}

/// A text with its place.
type Text = Spanned<String>;
/// The values that a path of `--set` goes through.
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
    /// Whether each series has a truth of its own, with the changes of the series.
    #[serde(default)]
    of_series: bool,
    /// Other renderings of the truth, which tell how far it can be trusted.
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

/// A study of a family of stress cases: rays at one shape, judged by the oracle.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct StressTable {
    title: String,
    about: String,
    /// Name of the family.
    stress: Text,
}

/// A smaller study with the same claims, where only what does not depend on time counts.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct QuickTable {
    #[serde(default)]
    set: Vec<Text>,
    #[serde(default)]
    truth: Vec<Text>,
    /// At most so many settings of each series, the first ones.
    points: Option<usize>,
    levels: Option<Vec<f64>>,
}

/// What must come out; nothing of it depends on time.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExpectTable {
    /// All series have the same error at the same setting, to the bit.
    #[serde(default)]
    pub same_error: bool,
    /// Pairs of series: the first falls faster, and the intervals of the slopes do not touch.
    #[serde(default)]
    pub steeper: Vec<[String; 2]>,
    /// Pairs of series: the first has the smaller error at each setting that both have.
    #[serde(default)]
    pub smaller: Vec<[String; 2]>,
    /// Errors that Whitstone must reach.
    #[serde(default)]
    pub reached: Vec<f64>,
}

/// A change of the scene and where the study says it.
#[derive(Clone, Debug)]
pub struct Change {
    /// `path=value`.
    pub text: String,
    /// In the study.
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
    /// Such as `sampler.n=4`.
    pub label: String,
    /// The value of the first path, if it is a number.
    pub value: Option<f64>,
    /// What it changes.
    pub changes: Vec<Change>,
}

/// A configuration that is swept by one engine.
#[derive(Clone, Debug)]
pub struct Series {
    /// As the study calls it.
    pub name: String,
    /// Who renders.
    pub engine: Engine,
    /// What all its settings have in common.
    pub set: Vec<Change>,
    /// In the order of the study.
    pub settings: Vec<Setting>,
    /// Where the slope must lie, if the study says so.
    pub slope: Option<[f64; 2]>,
}

/// A rendering that is taken for true, or that tells how true another one is.
#[derive(Clone, Debug)]
pub struct Truth {
    /// Who renders.
    pub engine: Engine,
    /// Its changes of the scene.
    pub set: Vec<Change>,
}

/// A study that is read.
#[derive(Debug)]
pub struct Study {
    /// Name of the file without its extension.
    pub name: String,
    /// One line.
    pub title: String,
    /// What it is to show.
    pub about: String,
    /// As the study names it.
    pub scene: String,
    /// The scene's file.
    pub scene_path: PathBuf,
    /// Changes that all renderings have.
    pub set: Vec<Change>,
    /// What slopes are taken against.
    pub against: Against,
    /// How often each setting is timed, if the study says so.
    pub repeats: Option<u32>,
    /// Errors to be reached.
    pub levels: Vec<f64>,
    /// The truth.
    pub truth: Truth,
    /// Whether each series has a truth of its own.
    pub truth_of_series: bool,
    /// Other renderings of it.
    pub checks: Vec<Truth>,
    /// Everything that is measured.
    pub series: Vec<Series>,
    /// What must come out.
    pub expect: ExpectTable,
    /// The family of stress cases that takes the place of a scene.
    pub stress: Option<Change>,
    /// Whether it has a quick form.
    pub has_quick: bool,
    /// Whether this is it.
    pub quick: bool,
    /// For reports of errors at their places.
    pub sources: Sources,
}

impl Study {
    /// Reads a study; `quick` is its small form.
    ///
    /// # Errors
    ///
    /// All that is wrong with it, as a report with places.
    pub fn load(path: &Path, quick: bool) -> Result<Self, String> {
        let shown = path.display().to_string();
        let metadata = std::fs::metadata(path).map_err(|error| format!("{shown}: {error}"))?;
        if !metadata.is_file() || metadata.len() > MAX_BYTES {
            return Err(format!("{shown}: not a file of at most {MAX_BYTES} bytes"));
        }
        let text = std::fs::read_to_string(path).map_err(|error| format!("{shown}: {error}"))?;
        Self::parse(&shown, &text, path.parent().unwrap_or(Path::new("")), quick)
    }

    /// A study in memory. `name` is that of its file, `base` the folder that its scene is relative
    /// to.
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

    /// The changes of one setting, in the order in which they are made.
    pub fn changes(&self, series: &Series, setting: &Setting) -> Vec<Change> {
        [&self.set[..], &series.set, &setting.changes].concat()
    }

    /// The changes of a truth, for one series.
    pub fn truth_changes(&self, truth: &Truth, series: &Series) -> Vec<Change> {
        let of_series: &[Change] = if self.truth_of_series { &series.set } else { &[] };
        [&self.set[..], of_series, &truth.set].concat()
    }

    /// An error of the study, or of the scene that it changes.
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
        fail(table.series.span(), "a study needs a [[series]]");
    }
    for series in table.series.get_ref() {
        let sweep = series.sweep.get_ref();
        if sweep.is_empty() {
            fail(
                series.sweep.span(),
                "an empty sweep: name a path of the scene and its values",
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
                    "the paths of a sweep go on together: expected as many values as the others have",
                );
            }
        }
    }
    let names = |name: &String| table.series.get_ref().iter().any(|series| series.name == *name);
    let pairs = table.expect.steeper.iter().chain(&table.expect.smaller);
    for name in pairs.flatten().filter(|name| !names(name)) {
        fail(
            table.series.span(),
            &format!("[expect] names a series \"{name}\" that is not there"),
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
        .map(|engine| Series {
            name: table.name.clone(),
            engine: (*engine).into(),
            set: changes(&table.set),
            settings: settings.clone(),
            slope: table.slope,
        })
        .collect()
}
