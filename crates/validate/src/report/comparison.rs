//! The page that compares several subjects: a matrix of scenes and subjects, and the error between
//! each two of them.

use super::number::{Number, short};
use super::view::{SORT, STYLE, ScaleView};
use crate::pixels::ERROR_VIEW;
use crate::{CaseResult, Results, Status, counted};
use askama::Template;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use whitstone_image::Image;
use whitstone_metrics::{CompareOptions, compare};

/// The name of the reference in the table of pairs.
const REFERENCE: &str = "reference";

/// The validation of one subject.
#[derive(Debug)]
pub struct Compared {
    /// Its name.
    pub name: String,
    /// Its own report, relative to the page.
    pub page: String,
    /// The results.
    pub results: Results,
    /// Its images by scene, after its conventions were applied.
    pub images: BTreeMap<String, Image>,
    /// What its images show: the changes of every scene and the offset of its samples. Images of
    /// subjects with other conditions cannot be compared.
    pub conditions: String,
}

/// Several subjects that rendered the same scenes.
#[derive(Debug, Serialize)]
pub struct Comparison {
    /// The error between each two subjects, and between each subject and the reference.
    pub pairs: Vec<Pair>,
    /// The results of the subjects, in their order.
    pub subjects: Vec<NamedResults>,
}

/// The results of a subject in JSON.
#[derive(Debug, Serialize)]
pub struct NamedResults {
    /// Its name.
    pub name: String,
    /// As `validate` writes them for one subject.
    #[serde(flatten)]
    pub results: Results,
    #[serde(skip)]
    page: String,
}

/// The errors between two renderers, over the scenes of which both have an image.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Pair {
    /// The first one.
    pub a: String,
    /// The second one, or "reference".
    pub b: String,
    /// Number of scenes.
    pub scenes: usize,
    /// Median over the scenes of the root mean square difference, relative to the mean of the
    /// images.
    pub median: Option<f64>,
    /// The scene with the largest one, and its value.
    pub worst: Option<(String, f64)>,
    /// Why they cannot be compared.
    pub why: Option<String>,
}

impl Pair {
    fn new(a: &str, b: &str, mut errors: Vec<(String, f64)>) -> Self {
        errors.sort_by(|x, y| x.1.total_cmp(&y.1));
        Self {
            a: a.to_owned(),
            b: b.to_owned(),
            scenes: errors.len(),
            median: errors.get(errors.len() / 2).map(|(_, error)| *error),
            worst: errors.last().cloned(),
            why: errors
                .is_empty()
                .then(|| "they have no image of the same scene".to_owned()),
        }
    }

    /// The pair of two subjects.
    fn of(a: &Compared, b: &Compared) -> Self {
        if a.conditions != b.conditions {
            return Self {
                why: Some(format!(
                    "their scenes differ: {} has {}, {} has {}",
                    a.name, a.conditions, b.name, b.conditions
                )),
                a: a.name.clone(),
                b: b.name.clone(),
                ..Self::default()
            };
        }
        let both = a.images.iter().filter_map(|(scene, image)| {
            let other = b.images.get(scene)?;
            let there = compare(image, other, &CompareOptions::default()).ok()?;
            let back = compare(other, image, &CompareOptions::default()).ok()?;
            let mean = 0.5 * (there.mean_reference + back.mean_reference);
            Some((scene.clone(), relative(there.rmse, mean)))
        });
        Self::new(&a.name, &b.name, both.collect())
    }

    /// The pair of a subject and its reference.
    fn with_reference(a: &Compared) -> Self {
        let errors = a.results.results.iter().filter_map(|case| {
            let error = relative(case.rmse?, case.mean_reference?);
            Some((case.scene.clone(), error))
        });
        Self::new(&a.name, REFERENCE, errors.collect())
    }
}

/// Two black images agree.
fn relative(rmse: f64, mean: f64) -> f64 {
    if rmse == 0.0 { 0.0 } else { rmse / mean }
}

impl Comparison {
    /// Compares the images of all pairs.
    pub fn new(subjects: Vec<Compared>) -> Self {
        let mut pairs = Vec::new();
        for (index, a) in subjects.iter().enumerate() {
            pairs.extend(subjects[index + 1..].iter().map(|b| Pair::of(a, b)));
            pairs.push(Pair::with_reference(a));
        }
        let named = subjects.into_iter().map(|subject| NamedResults {
            name: subject.name,
            results: subject.results,
            page: subject.page,
        });
        Self {
            pairs,
            subjects: named.collect(),
        }
    }

    /// The pair of these names, in either order.
    pub fn pair(&self, a: &str, b: &str) -> Option<&Pair> {
        let is_it = |pair: &&Pair| (pair.a == a && pair.b == b) || (pair.a == b && pair.b == a);
        self.pairs.iter().find(is_it)
    }

    /// The page, without anything from a network.
    pub fn html(&self) -> String {
        Page::new(self).to_string()
    }
}

#[derive(Template)]
#[template(path = "comparison.html", config = "src/report/askama.toml")]
struct Page<'a> {
    style: &'static str,
    script: &'static str,
    passed: bool,
    title: String,
    subjects: Vec<Head<'a>>,
    rows: Vec<Row<'a>>,
    heat: Vec<HeatRow<'a>>,
    names: Vec<&'a str>,
    scale: ScaleView,
}

/// A subject in the headings.
struct Head<'a> {
    name: &'a str,
    page: &'a str,
    right: usize,
    rendered: usize,
    skipped: usize,
}

/// A scene.
struct Row<'a> {
    scene: &'a str,
    cells: Vec<Cell<'a>>,
}

/// What a subject made of a scene.
enum Cell<'a> {
    Case {
        case: &'a CaseResult,
        /// The address of the case.
        link: String,
        right: bool,
        word: &'static str,
        error: Number,
        seconds: Number,
    },
    Skipped(&'a str),
    Nothing,
}

struct HeatRow<'a> {
    name: &'a str,
    cells: Vec<HeatCell>,
}

/// The error of a pair, with its colour.
struct HeatCell {
    text: String,
    title: String,
    style: String,
}

impl<'a> Page<'a> {
    fn new(all: &'a Comparison) -> Self {
        let subjects: Vec<Head> = all.subjects.iter().map(head).collect();
        let scenes: BTreeSet<&str> = all
            .subjects
            .iter()
            .flat_map(|subject| {
                let cases = subject.results.results.iter().map(|case| case.scene.as_str());
                let skipped = subject.results.skipped.iter().map(|left| left.scene.as_str());
                cases.chain(skipped)
            })
            .collect();
        let rows = scenes.iter().map(|scene| Row {
            scene,
            cells: all.subjects.iter().map(|subject| cell(subject, scene)).collect(),
        });
        let right = subjects.iter().all(|subject| subject.right == subject.rendered);
        let rendered: usize = subjects.iter().map(|subject| subject.rendered).sum();
        let names: Vec<&str> = subjects.iter().map(|subject| subject.name).collect();
        let columns: Vec<&str> = names.iter().copied().chain([REFERENCE]).collect();
        let heat = columns.iter().map(|a| HeatRow {
            name: a,
            cells: columns.iter().map(|b| heat(all, a, b)).collect(),
        });
        Self {
            style: STYLE,
            script: SORT,
            passed: right && rendered > 0,
            title: format!(
                "{} with {}",
                counted(subjects.len(), "subject"),
                counted(scenes.len(), "scene")
            ),
            rows: rows.collect(),
            heat: heat.collect(),
            names: columns,
            subjects,
            scale: ScaleView::new(),
        }
    }
}

fn head(subject: &NamedResults) -> Head<'_> {
    let results = &subject.results;
    let is_right = |case: &&CaseResult| case.status.is_some_and(Status::is_right);
    Head {
        name: &subject.name,
        page: &subject.page,
        right: results.results.iter().filter(is_right).count(),
        rendered: results.results.len(),
        skipped: results.skipped.len(),
    }
}

fn cell<'a>(subject: &'a NamedResults, scene: &str) -> Cell<'a> {
    let cases = &subject.results.results;
    if let Some(index) = cases.iter().position(|case| case.scene == scene) {
        let case = &cases[index];
        let status = case.status.unwrap_or(Status::Undecided);
        // With more cases, each scene has its own page.
        let link = match cases.len() <= super::ON_ONE_PAGE {
            true => format!("{}#case-{}", subject.page, index + 1),
            false => subject.page.clone(),
        };
        return Cell::Case {
            case,
            link,
            right: status.is_right(),
            word: status.word(),
            error: Number::error(case.rmse),
            seconds: Number::plain(case.render_s),
        };
    }
    let skipped = subject.results.skipped.iter().find(|left| left.scene == scene);
    skipped.map_or(Cell::Nothing, |left| Cell::Skipped(&left.reason))
}

fn heat(all: &Comparison, a: &str, b: &str) -> HeatCell {
    let empty = |text: &str, title: String| HeatCell {
        text: text.to_owned(),
        title,
        style: String::new(),
    };
    if a == b {
        return empty("", String::new());
    }
    let Some(pair) = all.pair(a, b) else {
        return empty("–", String::new());
    };
    let Some(median) = pair.median else {
        return empty("–", pair.why.clone().unwrap_or_default());
    };
    let [red, green, blue] = ERROR_VIEW.scale.color(median);
    let bright = 2 * u32::from(red) + 5 * u32::from(green) + u32::from(blue) > 8 * 128;
    let worst = pair.worst.as_ref();
    let worst = worst.map_or(String::new(), |(scene, error)| {
        format!("; at most {} in {scene}", short(*error))
    });
    HeatCell {
        text: short(median),
        title: format!(
            "{} and {}: median of {}{worst}",
            pair.a,
            pair.b,
            counted(pair.scenes, "scene")
        ),
        style: format!(
            "background: rgb({red} {green} {blue}); color: {}",
            if bright { "#000" } else { "#fff" }
        ),
    }
}
