//! Selects the settings of a scene that are worth a cell of the matrix.

use std::collections::BTreeSet;
use toml::{Table, Value};
use whitstone_core::{FamilyName, Registry};

/// Names of the sweeps.
const ACCELERATOR: &str = "accelerator";
pub(super) const THREADS: &str = "threads";
const DEPTH: &str = "max_depth";
const FILTER: &str = "filter";

/// This many elements fit into one leaf, so that an accelerator divides nothing.
const ONE_LEAF: usize = 4;
/// Side of a tile in pixels: a smaller image is a single task.
const TILE: u32 = 16;
/// Number of element tests that take about ten seconds.
const MAX_TESTS: u64 = 1 << 30;
/// No recursion; the depth that both glass and a mirror need; depths that show them in each other.
const DEPTHS: [i64; 4] = [0, 1, 2, 4];
/// One thread, and a number that divides no tiling evenly.
const COUNTS: [usize; 2] = [1, 3];

/// The properties of a scene that determine its cells.
#[derive(Clone, Debug, Default)]
pub(super) struct Facts {
    /// Triangles, whole shapes and instances at the top level.
    pub(super) elements: usize,
    /// Number of rays of the scene's own picture.
    pub(super) rays: u64,
    /// Columns and rows.
    pub(super) pixels: [u32; 2],
    /// Threads of the run; 0 for all cores.
    pub(super) threads: usize,
    /// The type of the integrator.
    pub(super) integrator: &'static str,
    /// Whether the integrator follows reflection and transmission.
    pub(super) follows_branches: bool,
    /// Whether a material in use reflects or transmits.
    pub(super) branches: bool,
    /// The accelerator in use.
    pub(super) accelerator: String,
    /// The texture types in use.
    pub(super) textures: Vec<&'static str>,
    /// The scene as one document.
    pub(super) flattened: String,
}

/// The settings of a sweep.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Sweep {
    /// Skipped, with the reason.
    Skipped(String),
    /// The settings to run.
    Settings(Vec<Setting>),
}

/// A setting to run.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Setting {
    pub(super) name: String,
    /// Changes of the scene on both sides; none if the picture must not depend on the setting.
    pub(super) overrides: Vec<String>,
    /// Why it is skipped, if so.
    pub(super) skipped: Option<String>,
}

impl Setting {
    fn named(name: impl ToString) -> Self {
        Self {
            name: name.to_string(),
            ..Self::default()
        }
    }
}

/// A texture table with the key `filter`.
struct Filtered {
    /// Its path, as for `--set`.
    path: String,
    /// The values that the key supports.
    values: Vec<String>,
    /// The current value, if the scene sets it.
    value: Option<String>,
}

impl Facts {
    /// Every sweep with its settings.
    pub(super) fn sweeps(&self, registry: &Registry) -> [(&'static str, Sweep); 4] {
        let document: Table = self.flattened.parse().unwrap_or_default();
        [
            (ACCELERATOR, self.accelerators(registry)),
            (THREADS, self.counts()),
            (DEPTH, self.depths(&document, registry)),
            (FILTER, self.filters(&document, registry)),
        ]
    }

    fn accelerators(&self, registry: &Registry) -> Sweep {
        let count = self.elements;
        if count <= ONE_LEAF {
            let elements = crate::counted(count, "element");
            return Sweep::Skipped(format!(
                "{elements} fit into one leaf: there is nothing to subdivide"
            ));
        }
        let entries = registry
            .entries()
            .filter(|entry| entry.family == FamilyName::Accelerator);
        let others = entries.filter(|entry| entry.name != self.accelerator);
        let setting = |name: &str| {
            let tests = self.rays.saturating_mul(count as u64);
            let expensive = name == "brute_force" && tests > MAX_TESTS;
            let why = || {
                format!(
                    "testing {count} elements for each of {} rays takes too long",
                    self.rays
                )
            };
            Setting {
                skipped: expensive.then(why),
                ..Setting::named(name)
            }
        };
        Sweep::Settings(others.map(|entry| setting(entry.name)).collect())
    }

    fn counts(&self) -> Sweep {
        let [width, height] = self.pixels;
        if width <= TILE && height <= TILE {
            return Sweep::Skipped("the image is one tile, so one thread renders it".to_owned());
        }
        let others = COUNTS.into_iter().filter(|count| *count != self.threads);
        Sweep::Settings(others.map(Setting::named).collect())
    }

    fn depths(&self, document: &Table, registry: &Registry) -> Sweep {
        if !self.follows_branches {
            return Sweep::Skipped(format!(
                "{} does not follow reflections or refractions",
                self.integrator
            ));
        }
        if !self.branches {
            return Sweep::Skipped("no material in use reflects or refracts".to_owned());
        }
        let Ok(entry) = registry.get(FamilyName::Integrator, self.integrator) else {
            return Sweep::Skipped("the integrator is not registered".to_owned());
        };
        let schema = entry.schema().to_value();
        let property = &schema["properties"][DEPTH];
        if property.is_null() {
            return Sweep::Skipped(format!("{} has no {DEPTH}", self.integrator));
        }
        let table = document.get("integrator");
        let written = table.and_then(|table| table.get(DEPTH)?.as_integer());
        let change = |depth: i64| match table {
            Some(_) => format!("integrator.{DEPTH}={depth}"),
            // The default integrator, which a scene need not name.
            None => format!("integrator={{type=\"{}\",{DEPTH}={depth}}}", self.integrator),
        };
        let own = written.or(property["default"].as_i64());
        let others = DEPTHS.into_iter().filter(|depth| Some(*depth) != own);
        Sweep::Settings(
            others
                .map(|depth| Setting {
                    overrides: vec![change(depth)],
                    ..Setting::named(depth)
                })
                .collect(),
        )
    }

    fn filters(&self, document: &Table, registry: &Registry) -> Sweep {
        if self.textures.is_empty() {
            return Sweep::Skipped("no texture in use".to_owned());
        }
        let mut found = Vec::new();
        for (key, value) in document {
            self.find(key.clone(), value, registry, &mut found);
        }
        if found.is_empty() {
            return Sweep::Skipped("no texture in use has a filter".to_owned());
        }
        let values: BTreeSet<&String> = found.iter().flat_map(|texture| &texture.values).collect();
        let settings = values.into_iter().map(|value| {
            let other =
                |texture: &&Filtered| texture.values.contains(value) && texture.value.as_ref() != Some(value);
            let change = |texture: &Filtered| format!("{}.{FILTER}={value}", texture.path);
            Setting {
                overrides: found.iter().filter(other).map(change).collect(),
                ..Setting::named(value)
            }
        });
        // A setting without a change is the scene itself. One that names the default is found to be
        // identical later.
        Sweep::Settings(settings.filter(|setting| !setting.overrides.is_empty()).collect())
    }

    /// Finds the textures in a value and below it that have a filter and a path.
    fn find(&self, path: String, value: &Value, registry: &Registry, found: &mut Vec<Filtered>) {
        match value {
            Value::Array(items) => {
                for (index, item) in items.iter().enumerate() {
                    self.find(format!("{path}.{index}"), item, registry, found);
                }
            }
            Value::Table(table) => {
                if let Some(values) = self.filter_values(table, registry) {
                    let value = table.get(FILTER).and_then(Value::as_str).map(str::to_owned);
                    let path = path.clone();
                    found.push(Filtered { path, values, value });
                }
                let plain = |key: &str| !key.is_empty() && !key.contains(['.', '[', ']', '=', ' ']);
                for (key, value) in table.iter().filter(|(key, _)| plain(key)) {
                    self.find(format!("{path}.{key}"), value, registry, found);
                }
            }
            _ => {}
        }
    }

    /// The values of the filter of a table, if it is a texture in use that has one.
    fn filter_values(&self, table: &Table, registry: &Registry) -> Option<Vec<String>> {
        let kind = table.get("type")?.as_str()?;
        let name = self.textures.iter().find(|name| **name == kind)?;
        let schema = registry.get(FamilyName::Texture, name).ok()?.schema().to_value();
        let property = &schema["properties"][FILTER];
        let place = property["$ref"]
            .as_str()
            .and_then(|place| place.strip_prefix('#'));
        let words = place.map_or(Some(property), |place| schema.pointer(place))?;
        let listed = words["enum"].as_array().into_iter().flatten();
        let told = words["oneOf"].as_array().into_iter().flatten();
        let told = told.flat_map(|form| {
            let one = form.get("const").into_iter();
            one.chain(form["enum"].as_array().into_iter().flatten())
        });
        let values: Vec<String> = listed
            .chain(told)
            .filter_map(|word| Some(word.as_str()?.to_owned()))
            .collect();
        (!values.is_empty()).then_some(values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_that_names_no_integrator_has_depths_too() {
        let mut registry = Registry::default();
        whitstone_integrators::register(&mut registry).expect("they have names of their own");
        let depths = |flattened: &str| {
            let facts = Facts {
                integrator: "whitted",
                follows_branches: true,
                branches: true,
                ..Facts::default()
            };
            match facts.depths(&flattened.parse().expect("it is TOML"), &registry) {
                Sweep::Settings(settings) => settings
                    .into_iter()
                    .flat_map(|setting| setting.overrides)
                    .collect(),
                Sweep::Skipped(why) => vec![why],
            }
        };
        let all = |form: &dyn Fn(i64) -> String| DEPTHS.map(form).to_vec();
        assert_eq!(
            depths(""),
            all(&|depth| format!("integrator={{type=\"whitted\",max_depth={depth}}}"))
        );
        assert_eq!(
            depths("[integrator]\ntype = \"whitted\"\n"),
            all(&|depth| format!("integrator.max_depth={depth}"))
        );
    }
}
