//! Mitsuba 3 as a Whitted ray tracer: `references/mitsuba` drives its intersections, BSDFs and
//! emitters.

use crate::driver::{Driver, DriverError};
use crate::environment::{Environment, EnvironmentError, Installation};
use crate::explain::{self, Trial};
use crate::floor;
use crate::protocol::{Setting, Versions};
use crate::reference::Reference;

pub(super) struct Mitsuba;

/// Maximum limit of a scene without textures.
pub(super) const LARGEST_LIMIT: f64 = 5e-5;

impl Reference for Mitsuba {
    fn title(&self) -> &'static str {
        "Mitsuba"
    }

    fn name(&self) -> &'static str {
        "mitsuba"
    }

    /// The name dates from when there was only one reference.
    fn meta_file(&self) -> String {
        "meta.toml".to_owned()
    }

    fn environment(
        &self,
        installation: &Installation,
        say: &dyn Fn(&str),
    ) -> Result<Environment, EnvironmentError> {
        Environment::ensure(installation, say)
    }

    fn versions(&self, driver: &mut Driver) -> Result<Versions, DriverError> {
        driver.hello().map(Versions::Mitsuba)
    }

    fn has_ray_trees(&self) -> bool {
        true
    }

    fn trials(&self) -> Vec<Trial> {
        explain::trials()
    }

    fn roundings(&self) -> Vec<Trial> {
        let mut trials = explain::roundings(self.trials());
        trials.push(explain::of_largest_component());
        trials
    }

    fn variations(&self) -> Vec<Setting> {
        floor::settings().to_vec()
    }

    fn largest_limit(&self) -> f64 {
        LARGEST_LIMIT
    }

    fn is_single_precision(&self) -> bool {
        true
    }
}
