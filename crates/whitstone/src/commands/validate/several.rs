//! `validate` with several subjects: each is validated like a single one, and a page compares them.

use super::{Arguments, find, junit_cases, print_summary, validate};
use crate::commands::junit;
use crate::commands::report;
use crate::interrupt;
use crate::terminal::{Exit, Failure, make_folder, write_json};
use serde_json::json;
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use whitstone_core::Registry;
use whitstone_image::atomic;
use whitstone_validate::report::{Compared, Comparison};
use whitstone_validate::{Subject, scene_key};

/// The folder of the page, in the folder of the results.
const FOLDER: &str = "comparison";

/// Runs the command.
pub(super) fn run(arguments: &Arguments, registry: &Registry, program: &str) -> Result<Exit, Failure> {
    let scenes = arguments.scenes.find(registry)?;
    let subjects: Vec<Subject> = (arguments.subject.iter())
        .map(|name| find(arguments, name, registry))
        .collect::<Result<_, _>>()?;
    let names: BTreeSet<&str> = subjects.iter().map(|subject| subject.name.as_str()).collect();
    if names.len() < subjects.len() {
        return Err(Failure::usage("a subject is named twice"));
    }
    let folder = arguments.scenes.target.folder().join(FOLDER);
    make_folder(&folder)?;
    for subject in &subjects {
        report::check(
            &folder.join(&subject.name),
            arguments.json.iter().chain(&arguments.junit),
        )?;
    }
    let root = arguments.scenes.options(program).scenes;
    let mut compared = Vec::new();
    let mut exits = Vec::new();
    let mut cases = Vec::new();
    for subject in subjects {
        let (name, conditions) = (subject.name.clone(), conditions(&subject));
        let images = RefCell::new(BTreeMap::new());
        let done = validate(
            arguments,
            registry,
            program,
            &scenes,
            Some(subject),
            &|path, image| {
                images.borrow_mut().insert(scene_key(path, &root), image.clone());
            },
        )?;
        report::write(&done.results, &folder.join(&name), None)?;
        print_summary(&done.results.summary, &folder.join(&name).join("validate"));
        let named = junit_cases(&done.results).into_iter().map(|mut case| {
            case.name = format!("{name}, {}", case.name);
            case
        });
        cases.extend(named);
        exits.push(done.exit(arguments, program));
        compared.push(Compared {
            page: format!("{name}/validate/index.html"),
            name,
            results: done.results,
            images: images.into_inner(),
            conditions,
        });
        if interrupt::signal().is_some() {
            break;
        }
    }
    let comparison = Comparison::new(compared);
    let page = folder.join("index.html");
    atomic::write_bytes(&page, comparison.html().as_bytes()).map_err(Failure::environment)?;
    if let Some(path) = &arguments.json {
        write_json(path, &json!(comparison))?;
    }
    if let Some(path) = &arguments.junit {
        junit::write(path, "whitstone validate", &cases)?;
    }
    print(&comparison, &page);
    exit(exits)
}

/// What the images of a subject show: subjects with other conditions render other images.
fn conditions(subject: &Subject) -> String {
    let [x, y] = subject.offset;
    let offset = ([x, y] != [0.0; 2]).then(|| format!("offset = [{x}, {y}]"));
    let set = (!subject.set.is_empty()).then(|| format!("set = {:?}", subject.set));
    let parts: Vec<String> = set.into_iter().chain(offset).collect();
    match parts.is_empty() {
        true => "no changes".to_owned(),
        false => parts.join(", "),
    }
}

/// Prints the pairs.
fn print(comparison: &Comparison, page: &Path) {
    println!(
        "\n{:<24} {:<24} {:>6} {:>8}  largest",
        "which two agree", "", "scenes", "median"
    );
    for pair in &comparison.pairs {
        let number = |value: f64| format!("{value:.2e}");
        let worst = pair.worst.as_ref();
        let worst = worst.map(|(scene, error)| format!("{} in {scene}", number(*error)));
        println!(
            "{:<24} {:<24} {:>6} {:>8}  {}",
            pair.a,
            pair.b,
            pair.scenes,
            pair.median.map_or_else(|| "-".to_owned(), number),
            worst.or_else(|| pair.why.clone()).unwrap_or_default()
        );
    }
    println!("comparison: {}", page.display());
}

/// The exit code of all subjects: one that differs decides, then one that gave no image.
fn exit(exits: Vec<Result<Exit, Failure>>) -> Result<Exit, Failure> {
    let mut first = None;
    let mut differs = false;
    for exit in exits {
        match exit {
            Ok(Exit::Pass) => {}
            Ok(_) => differs = true,
            Err(failure @ Failure::Interrupted { .. }) => return Err(failure),
            Err(failure) => first = first.or(Some(failure)),
        }
    }
    match (differs, first) {
        (true, _) => Ok(Exit::Differs),
        (false, Some(failure)) => Err(failure),
        (false, None) => Ok(Exit::Pass),
    }
}
