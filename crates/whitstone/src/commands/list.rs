//! `list`: lists the plugins.

use crate::terminal::{Exit, Failure};
use clap::Args;
use serde_json::{Value, json};
use whitstone_core::{Entry, FamilyName, Registry, nearest};

/// List all plugins that a scene can name, with their crate and a description
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Examples:\n  whitstone list\n  whitstone list shapes"
)]
pub struct Arguments {
    /// List only this family: cameras, shapes, accelerators, materials, textures, lights, samplers,
    /// integrators [default: all]
    family: Option<String>,
    /// Print JSON, with each plugin's twin in a reference renderer, its example scene, and the laws
    /// (property tests) that it passes
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let only = arguments.family.as_deref().map(family).transpose()?;
    let families = FamilyName::ALL
        .into_iter()
        .filter(|name| only.is_none_or(|only| only == *name));
    let entries = |name: FamilyName| registry.entries().filter(move |entry| entry.family == name);
    if arguments.json {
        let notes = notes();
        let describe = |entry| describe(entry, &notes);
        let list: Vec<Value> = families
            .flat_map(|name| entries(name).map(describe).chain(choice(name)))
            .collect();
        println!("{:#}", Value::from(list));
        return Ok(Exit::Pass);
    }
    let widest = |field: fn(&Entry) -> &str| {
        registry
            .entries()
            .map(|entry| field(entry).len())
            .max()
            .unwrap_or(0)
    };
    let (type_width, crate_width) = (widest(|entry| entry.name), widest(|entry| entry.crate_name));
    for (number, name) in families.enumerate() {
        if number > 0 {
            println!();
        }
        println!("{}", name.plural());
        for entry in entries(name) {
            println!(
                "  {:<type_width$}  {:<crate_width$}  {}",
                entry.name,
                entry.crate_name,
                entry.summary()
            );
        }
        if name == FamilyName::Accelerator {
            println!("  {AUTO:<type_width$}  {:<crate_width$}  {AUTO_SUMMARY}", "-");
        }
    }
    Ok(Exit::Pass)
}

/// Not a plugin: a value that a scene may use as the type of its accelerator.
const AUTO: &str = "auto";
const AUTO_SUMMARY: &str = "Lets Whitstone choose the accelerator, as if the scene named none; `explain` prints the choice and the reason.";

/// The other values that a scene may name in this family.
fn choice(family: FamilyName) -> Option<Value> {
    (family == FamilyName::Accelerator).then(|| {
        json!({ "family": family.singular(), "type": AUTO, "crate": Value::Null, "summary": AUTO_SUMMARY })
    })
}

/// The header comments of the plugins' files, as data; `cargo xtask readme` writes it.
const NOTES: &str = include_str!("../plugins.json");

/// All notes; null for a plugin without notes, such as one of another crate.
fn notes() -> Value {
    serde_json::from_str(NOTES).unwrap_or_default()
}

fn describe(entry: &Entry, notes: &Value) -> Value {
    let family = entry.family.plural();
    let own = entry.crate_name == format!("whitstone-{family}");
    let note = |key: &str| {
        if own {
            &notes[family][entry.name][key]
        } else {
            &Value::Null
        }
    };
    json!({
        "family": entry.family.singular(),
        "type": entry.name,
        "crate": entry.crate_name,
        "summary": entry.summary(),
        "twin": note("twin"),
        "example": note("example"),
        "laws": note("laws"),
    })
}

/// The family of this name, in singular or plural.
pub fn family(name: &str) -> Result<FamilyName, Failure> {
    let wanted = name.to_lowercase();
    let named = |family: &FamilyName| [family.singular(), family.plural()].contains(&wanted.as_str());
    FamilyName::ALL.into_iter().find(named).ok_or_else(|| {
        let known = FamilyName::ALL.map(FamilyName::plural);
        let advice = match nearest(&wanted, known) {
            Some(near) => format!("did you mean \"{near}\"?"),
            None => format!("expected one of {}", known.join(", ")),
        };
        Failure::usage(format!("unknown family \"{name}\": {advice}"))
    })
}
