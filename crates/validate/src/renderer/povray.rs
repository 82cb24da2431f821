//! POV-Ray 3.7: `references/povray` writes its scenes. It computes in double precision and shares
//! no code with Mitsuba.

use crate::driver::{Driver, DriverError};
use crate::environment::{Environment, EnvironmentError, Installation};
use crate::explain::{self, Trial};
use crate::floor;
use crate::protocol::{Setting, Versions};
use crate::reference::{Adaptation, Reference, without_layers};
use toml::Value;

pub(super) struct PovRay;

/// Maximum limit of a scene without textures. Its images are half floats. The driver brackets their
/// rounding error, to an eighth of it: 2^-14 of the value, or 6e-5.
const LARGEST_LIMIT: f64 = 1e-4;

impl Reference for PovRay {
    fn title(&self) -> &'static str {
        "POV-Ray"
    }

    fn name(&self) -> &'static str {
        "povray"
    }

    fn environment(
        &self,
        installation: &Installation,
        _say: &dyn Fn(&str),
    ) -> Result<Environment, EnvironmentError> {
        Environment::of_povray(installation)
    }

    fn versions(&self, driver: &mut Driver) -> Result<Versions, DriverError> {
        driver.hello_of_povray().map(Versions::PovRay)
    }

    fn trials(&self) -> Vec<Trial> {
        explain::trials_of_povray()
    }

    fn variations(&self) -> Vec<Setting> {
        floor::settings_of_povray().to_vec()
    }

    fn largest_limit(&self) -> f64 {
        LARGEST_LIMIT
    }

    fn is_single_precision(&self) -> bool {
        false
    }

    fn adaptations(&self, scene: &toml::Table) -> Vec<Adaptation> {
        let mut found = Vec::from_iter(without_layers(
            scene,
            "POV-Ray has no layers other than the radiance",
        ));
        let integrator = scene.get("integrator");
        let key = |name: &str| integrator.and_then(|table| table.get(name));
        let kind = key("type").and_then(Value::as_str);
        if kind.is_none_or(|kind| kind == "whitted") {
            let shows_background = key("at_max_depth").and_then(Value::as_str) != Some("black");
            let lights = scene.get("light").and_then(Value::as_array);
            let is_background =
                |light: &Value| light.get("type").and_then(Value::as_str) == Some("background");
            if shows_background && lights.is_some_and(|lights| lights.iter().any(is_background)) {
                let text = match integrator {
                    Some(_) => "integrator.at_max_depth=\"black\"",
                    None => "integrator={type=\"whitted\",at_max_depth=\"black\"}",
                };
                found.push(Adaptation::new(
                    text,
                    "POV-Ray returns black beyond its depth limit",
                ));
            }
            if key("min_contribution").is_some() {
                found.push(Adaptation::new(
                    "integrator.min_contribution=0",
                    "POV-Ray prunes faint rays by another rule",
                ));
            }
        }
        if key("light_cutoff").is_some() {
            found.push(Adaptation::new(
                "integrator.light_cutoff=0",
                "POV-Ray cuts off no faint lights",
            ));
        }
        found
    }
}
