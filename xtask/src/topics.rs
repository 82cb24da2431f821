//! `topics`: the topics of the lecture notes, from `xtask/topics.toml`: where they are in
//! Whitstone, what checks them, and what is missing.

use crate::run_time::wrapped;
use clap::{Args, CommandFactory};
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;
use whitstone::core::{FamilyName, Registry};
use whitstone::validate::{CaseResult, Status};
use whitstone::{Exit, Failure};

/// The page.
pub(crate) const PAGE: &str = "docs/topics.md";
/// The declarations.
const DECLARED: &str = "xtask/topics.toml";
/// Number of topics of the notes.
const COUNT: usize = 52;

/// List the topics of the lecture notes, with what implements and checks each, and what is missing
///
/// `cargo xtask readme` writes the same list with errors to docs/topics.md, and `cargo xtask tidy`
/// checks that everything it names exists.
///
/// Exit code 0 if all topics work, 1 if not.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  cargo xtask topics\n  cargo xtask topics --missing"
)]
pub(crate) struct Arguments {
    /// Only list topics of which a part is missing
    #[arg(long)]
    missing: bool,
}

/// How much of a topic works.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Class {
    /// It works, and a reference, the oracle or a closed form checks it.
    Works,
    /// A part of it is missing or unchecked.
    Partly,
    Missing,
}

impl Class {
    fn words(self) -> &'static str {
        match self {
            Self::Works => "works and is checked",
            Self::Partly => "partly",
            Self::Missing => "missing",
        }
    }
}

/// A topic as declared.
struct Topic {
    number: usize,
    title: String,
    class: Class,
    /// Family and type.
    plugins: Vec<String>,
    commands: Vec<String>,
    /// Paths below `scenes`, without the extension.
    scenes: Vec<String>,
    /// Names of studies.
    studies: Vec<String>,
    /// Pages of the documentation.
    pages: Vec<String>,
    /// A file and a test function in it.
    tests: Vec<String>,
    missing: String,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<Exit, Failure> {
    let topics = declared().map_err(Failure::usage)?;
    let shown = topics
        .iter()
        .filter(|topic| !arguments.missing || topic.class != Class::Works);
    for topic in shown {
        println!("{:>2} {:<21} {}", topic.number, topic.class.words(), topic.title);
        if !topic.missing.is_empty() {
            println!("   missing: {}", topic.missing);
        }
    }
    println!("{}", counts(&topics));
    let all = topics.iter().all(|topic| topic.class == Class::Works);
    Ok(if all { Exit::Pass } else { Exit::Differs })
}

fn counts(topics: &[Topic]) -> String {
    let count = |class| topics.iter().filter(|topic| topic.class == class).count();
    format!(
        "{} of {} topics work and are checked, {} work partly, {} are missing.",
        count(Class::Works),
        topics.len(),
        count(Class::Partly),
        count(Class::Missing)
    )
}

/// The declarations, or what is wrong with them.
fn declared() -> Result<Vec<Topic>, String> {
    let text = std::fs::read_to_string(DECLARED).map_err(|error| format!("{DECLARED}: {error}"))?;
    parse(&text).map_err(|error| format!("{DECLARED}: {error}"))
}

fn parse(text: &str) -> Result<Vec<Topic>, String> {
    let root: toml::Table = text.parse().map_err(|error: toml::de::Error| error.to_string())?;
    let tables = root.get("topic").and_then(toml::Value::as_array);
    tables.into_iter().flatten().map(topic).collect()
}

fn topic(value: &toml::Value) -> Result<Topic, String> {
    let mut table = value.as_table().cloned().unwrap_or_default();
    let number = table.remove("number").and_then(|number| number.as_integer());
    let number = number.and_then(|number| usize::try_from(number).ok());
    let number = number.ok_or("a topic has no number")?;
    let mut list = |key: &str| -> Result<Vec<String>, String> {
        let Some(value) = table.remove(key) else {
            return Ok(Vec::new());
        };
        let words = value.as_array().into_iter().flatten();
        let words: Vec<String> = words.filter_map(|word| Some(word.as_str()?.to_owned())).collect();
        if words.is_empty() {
            return Err(format!("topic {number}: `{key}` is no list of words"));
        }
        Ok(words)
    };
    let [plugins, commands, scenes, studies, pages, tests] =
        ["plugins", "commands", "scenes", "studies", "pages", "tests"].map(&mut list);
    let mut word = |key: &str| table.remove(key).and_then(|word| Some(word.as_str()?.to_owned()));
    let class = match word("class").as_deref() {
        Some("works") => Class::Works,
        Some("partly") => Class::Partly,
        Some("missing") => Class::Missing,
        other => return Err(format!("topic {number}: unknown class {other:?}")),
    };
    let topic = Topic {
        number,
        title: word("title").unwrap_or_default(),
        class,
        plugins: plugins?,
        commands: commands?,
        scenes: scenes?,
        studies: studies?,
        pages: pages?,
        tests: tests?,
        missing: word("missing").unwrap_or_default(),
    };
    match table.keys().next() {
        Some(key) => Err(format!("topic {number}: unknown key `{key}`")),
        None => Ok(topic),
    }
}

/// What the declarations name that does not exist, and classes that nothing supports.
pub(crate) fn check(registry: &Registry) -> Vec<String> {
    match declared() {
        Ok(topics) => problems(&topics, registry),
        Err(error) => vec![error],
    }
}

fn problems(topics: &[Topic], registry: &Registry) -> Vec<String> {
    let mut problems = Vec::new();
    let numbers: BTreeSet<usize> = topics.iter().map(|topic| topic.number).collect();
    if topics.len() != COUNT || numbers != (1..=COUNT).collect() {
        problems.push(format!("{DECLARED}: expected the topics 1 to {COUNT}, each once"));
    }
    for topic in topics {
        let mut report = |what: String| problems.push(format!("{DECLARED}: topic {}: {what}", topic.number));
        if topic.title.is_empty() {
            report("it has no title".to_owned());
        }
        let evidence = topic.scenes.len() + topic.tests.len();
        match topic.class {
            Class::Works if evidence == 0 => report("it works, but names no scene and no test".to_owned()),
            Class::Works if !topic.missing.is_empty() => {
                report("it works, but something is missing".to_owned())
            }
            Class::Partly | Class::Missing if topic.missing.is_empty() => {
                report("it does not say what is missing".to_owned());
            }
            _ => {}
        }
        for plugin in &topic.plugins {
            if !is_plugin(plugin, registry) {
                report(format!("there is no plugin \"{plugin}\""));
            }
        }
        for command in &topic.commands {
            if !is_command(command) {
                report(format!("there is no command `{command}`"));
            }
        }
        let files = [
            ("scenes", "toml", &topic.scenes),
            ("studies", "toml", &topic.studies),
            ("docs", "md", &topic.pages),
        ];
        for (folder, extension, names) in files {
            for name in names {
                let path = Path::new(folder).join(format!("{name}.{extension}"));
                if !path.is_file() {
                    report(format!("there is no {}", path.display()));
                }
            }
        }
        for test in &topic.tests {
            if !is_test(test) {
                report(format!("there is no test \"{test}\""));
            }
        }
    }
    problems
}

fn is_plugin(plugin: &str, registry: &Registry) -> bool {
    let family = |word: &str| {
        FamilyName::ALL
            .into_iter()
            .find(|family| family.singular() == word)
    };
    plugin
        .split_once(' ')
        .is_some_and(|(word, name)| family(word).is_some_and(|family| registry.get(family, name).is_ok()))
}

/// Whether it is a command of this program, which has those of `whitstone` too.
fn is_command(words: &str) -> bool {
    let mut command = crate::Arguments::command();
    words.split(' ').all(|word| match command.find_subcommand(word) {
        Some(found) => {
            command = found.clone();
            true
        }
        None => false,
    })
}

fn is_test(test: &str) -> bool {
    test.split_once(' ').is_some_and(|(file, name)| {
        let text = std::fs::read_to_string(file).unwrap_or_default();
        let declared = format!("fn {name}(");
        // The attribute is on one of the lines before.
        text.split(&declared).next().is_some_and(|before| {
            before.len() < text.len()
                && before
                    .trim_end()
                    .lines()
                    .next_back()
                    .is_some_and(|line| line.trim() == "#[test]")
        })
    })
}

/// The page. `cases`: the comparisons with stored images of Mitsuba.
pub(crate) fn page(cases: &[CaseResult]) -> Result<String, Failure> {
    let topics = declared().map_err(Failure::usage)?;
    let mut text = format!(
        "# The topics of the lecture notes\n\n<!-- Written by `cargo xtask readme` from {DECLARED}. -->\n\n"
    );
    text += &wrapped(&format!(
        "Whitstone follows lecture notes on ray tracing, which are not published. This table lists their {COUNT} topics, and what implements and checks each. {} A topic *works and is checked* if a reference renderer, the oracle or a closed form confirms it. The error is the largest interior error of its scenes against the stored images of Mitsuba ([definition](validation.md)); *oracle* means that the oracle confirms Whitstone in a scene in which Mitsuba is inaccurate. Scenes without an error have a reference of POV-Ray only. `cargo xtask tidy` checks that everything in the table exists.",
        counts(&topics)
    ));
    text += "\n\n| # | topic | class | plugin, command or page | scenes | error | tests |\n|---|---|---|---|---|---|---|\n";
    for topic in &topics {
        let error = error(topic, cases)?;
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {error} | {} |",
            topic.number,
            topic.title,
            topic.class.words(),
            or_dash(means(topic)),
            or_dash(topic.scenes.iter().map(|scene| {
                let name = scene.rsplit('/').next().unwrap_or(scene);
                format!("[{name}](../scenes/{scene}.toml)")
            })),
            or_dash(topic.tests.iter().map(|test| {
                let (file, name) = test.split_once(' ').unwrap_or((test, test));
                format!("[{name}](../{file})")
            })),
        );
    }
    text += "\n## What is missing\n\n";
    for topic in topics.iter().filter(|topic| topic.class != Class::Works) {
        let item = wrapped(&format!(
            "- {}, {}: {}.",
            topic.number, topic.title, topic.missing
        ));
        let _ = writeln!(text, "{}", item.replace('\n', "\n  "));
    }
    Ok(text)
}

fn or_dash(words: impl IntoIterator<Item = String>) -> String {
    let words: Vec<String> = words.into_iter().collect();
    if words.is_empty() {
        "–".to_owned()
    } else {
        words.join(", ")
    }
}

/// The plugins, commands, studies and pages of a topic, with links.
fn means(topic: &Topic) -> Vec<String> {
    let plural = |word: &str| {
        let family = FamilyName::ALL
            .into_iter()
            .find(|family| family.singular() == word);
        family.map_or("", FamilyName::plural)
    };
    let plugins = topic.plugins.iter().map(|plugin| {
        let (family, name) = plugin.split_once(' ').unwrap_or((plugin, plugin));
        format!("[`{name}`](plugins/{}/{name}.md)", plural(family))
    });
    let commands = topic.commands.iter().map(|command| format!("`{command}`"));
    let studies = topic
        .studies
        .iter()
        .map(|study| format!("[study {study}](../studies/{study}.toml)"));
    let pages = topic.pages.iter().map(|page| format!("[{page}]({page}.md)"));
    plugins.chain(commands).chain(studies).chain(pages).collect()
}

/// The largest error of the scenes, in one digit. An error if one of them does not pass although
/// the topic works.
fn error(topic: &Topic, cases: &[CaseResult]) -> Result<String, Failure> {
    let mut largest: Option<f64> = None;
    let mut confirmed = false;
    for scene in &topic.scenes {
        let Some(case) = cases.iter().find(|case| case.scene == *scene) else {
            continue;
        };
        let passes = matches!(case.status, Some(Status::Pass | Status::Confirmed));
        if topic.class == Class::Works && !passes {
            let message = format!(
                "{DECLARED}: topic {} works, but scene {scene} does not pass",
                topic.number
            );
            return Err(Failure::usage(message));
        }
        confirmed |= case.status == Some(Status::Confirmed);
        largest = largest.into_iter().chain(case.rel_rmse_interior).reduce(f64::max);
    }
    // One digit, because the second depends on the platform's mathematical functions.
    let number = largest.map_or_else(|| "–".to_owned(), |error| format!("{error:.0e}"));
    Ok(if confirmed {
        format!("{number}, oracle")
    } else {
        number
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(text: &str) -> Vec<String> {
        let mut found = problems(&parse(text).unwrap(), &whitstone::registry());
        // The number of topics.
        found.remove(0);
        found
    }

    #[test]
    fn what_does_not_exist_is_found() {
        std::env::set_current_dir(crate::root()).unwrap();
        let good = "[[topic]]\nnumber = 1\ntitle = \"a\"\nclass = \"works\"\nplugins = [\"shape sphere\"]\n\
                    commands = [\"bench rasterizer\", \"explain\"]\nscenes = [\"shapes/sphere\"]\n\
                    tests = [\"xtask/src/topics.rs what_does_not_exist_is_found\"]\n";
        assert_eq!(found(good), Vec::<String>::new());
        for (old, new, expected) in [
            ("shape sphere", "shape spere", "no plugin"),
            ("shape sphere", "material sphere", "no plugin"),
            ("bench rasterizer", "bench rasteriser", "no command"),
            ("\"explain\"", "\"exlpain\"", "no command"),
            ("shapes/sphere", "shapes/spere", "no scenes/shapes/spere.toml"),
            ("_is_found\"]", "_is_lost\"]", "no test"),
            // A function that is no test.
            ("what_does_not_exist_is_found", "or_dash", "no test"),
            ("\"works\"", "\"partly\"", "does not say what is missing"),
            (
                "title = \"a\"",
                "title = \"a\"\nmissing = \"b\"",
                "something is missing",
            ),
        ] {
            let found = found(&good.replace(old, new));
            assert_eq!(found.len(), 1, "{new}: {found:?}");
            assert!(found[0].contains(expected), "{new}: {found:?}");
        }
        let nothing = "[[topic]]\nnumber = 1\ntitle = \"a\"\nclass = \"works\"\n";
        assert!(found(nothing)[0].contains("no scene and no test"));
        assert!(parse("[[topic]]\nnumber = 1\nclass = \"done\"\n").is_err());
        assert!(parse(&good.replace("title", "titel")).is_err());
    }
}
