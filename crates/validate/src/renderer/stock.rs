//! Mitsuba's own C++ integrators, with the driver's camera rays: checks that the driver agrees with
//! Mitsuba.
//!
//! `direct` renders scenes of directly lit surfaces, `path` those of surfaces that only reflect and
//! refract, `volpathmis` those of them that absorb. In a scene with both kinds of surfaces, the
//! reflections are disabled on both sides.

use super::mitsuba;
use crate::driver::{Driver, DriverError};
use crate::environment::{Environment, EnvironmentError, Installation};
use crate::explain::Trial;
use crate::protocol::{Rendered, SceneText, Setting, Versions};
use crate::reference::{Adaptation, Reference, without_layers};
use std::path::Path;
use toml::Value;

pub(super) struct Stock;

/// Samples per camera ray of the model, from which the noise is estimated. The driver takes fewer
/// where nothing is random, and more where media absorb.
const REPEATS: u32 = 64;

/// Materials that lights illuminate directly, and those that only reflect and refract.
const LIT: [&str; 5] = ["matte", "phong", "blinn_phong", "whitted", "tabulated"];
const SPECULAR: [&str; 5] = ["mirror", "conductor", "dielectric", "thin_dielectric", "glossy"];

impl Reference for Stock {
    fn title(&self) -> &'static str {
        "stock Mitsuba"
    }

    fn name(&self) -> &'static str {
        "mitsuba-stock"
    }

    fn environment(
        &self,
        installation: &Installation,
        say: &dyn Fn(&str),
    ) -> Result<Environment, EnvironmentError> {
        Environment::ensure(installation, say)
    }

    fn versions(&self, driver: &mut Driver) -> Result<Versions, DriverError> {
        mitsuba::Mitsuba.versions(driver)
    }

    fn render(
        &self,
        driver: &mut Driver,
        scene: SceneText<'_>,
        out: &Path,
        setting: Setting,
    ) -> Result<Rendered, DriverError> {
        driver.stock(scene, out, setting, REPEATS)
    }

    /// It is compared with the driver, whose images are stored.
    fn can_be_stored(&self) -> bool {
        false
    }

    /// Its noise estimate replaces the trials.
    fn trials(&self) -> Vec<Trial> {
        Vec::new()
    }

    fn variations(&self) -> Vec<Setting> {
        Vec::new()
    }

    fn largest_limit(&self) -> f64 {
        mitsuba::LARGEST_LIMIT
    }

    fn is_single_precision(&self) -> bool {
        true
    }

    fn adaptations(&self, scene: &toml::Table) -> Vec<Adaptation> {
        let mut found = Vec::from_iter(without_layers(
            scene,
            "Mitsuba's integrators output only the radiance",
        ));
        let lights = scene.get("light").and_then(Value::as_array);
        for (number, light) in lights.into_iter().flatten().enumerate() {
            if light.get("type").and_then(Value::as_str) == Some("ambient") {
                found.push(Adaptation::new(
                    format!("light.{number}.radiance=0"),
                    "Mitsuba has no ambient light",
                ));
            }
        }
        let integrator = scene.get("integrator");
        let key = |name: &str| {
            integrator
                .and_then(|table| table.get(name))
                .and_then(Value::as_str)
        };
        let adapted = found.len();
        if key("type").is_none_or(|kind| kind == "whitted") {
            let kinds = kinds(scene);
            let has = |some: &[&str]| kinds.iter().any(|kind| some.contains(kind));
            let lit = has(&LIT);
            let shadows = key("shadows").map_or_else(String::new, |how| format!(",shadows=\"{how}\""));
            if lit && (has(&SPECULAR) || kinds.contains(&"whitted")) {
                found.push(Adaptation::new(
                    format!("integrator={{type=\"appel\"{shadows}}}"),
                    "Mitsuba's `direct` follows no reflections",
                ));
            } else if !lit && has(&SPECULAR) {
                let depth = integrator.and_then(|table| table.get("max_depth"));
                let depth = depth.map_or_else(String::new, |depth| format!(",max_depth={depth}"));
                found.push(Adaptation::new(
                    format!("integrator={{type=\"whitted\",at_max_depth=\"black\"{depth}{shadows}}}"),
                    "Mitsuba's `path` and `volpathmis` return black beyond their depth limit, and do not prune faint rays",
                ));
            }
        }
        let cuts = integrator.is_some_and(|table| table.get("light_cutoff").is_some());
        if cuts && found.len() == adapted {
            found.push(Adaptation::new(
                "integrator.light_cutoff=0",
                "Mitsuba cuts off no faint lights",
            ));
        }
        found
    }
}

/// The types of all materials of a scene, both shared ones and those of its shapes and groups.
fn kinds(scene: &toml::Table) -> Vec<&str> {
    let mut found = Vec::new();
    let mut open: Vec<(&Value, bool)> = Vec::new();
    open.extend(scene.get("material").map(|shared| (shared, true)));
    open.extend(scene.get("shape").map(|shapes| (shapes, false)));
    open.extend(scene.get("group").map(|groups| (groups, false)));
    while let Some((value, is_material)) = open.pop() {
        match value {
            Value::Table(table) => {
                if is_material && let Some(kind) = table.get("type").and_then(Value::as_str) {
                    found.push(kind);
                }
                open.extend(
                    table
                        .iter()
                        .map(|(key, value)| (value, is_material || key == "material")),
                );
            }
            Value::Array(items) => open.extend(items.iter().map(|item| (item, is_material))),
            _ => {}
        }
    }
    found
}
