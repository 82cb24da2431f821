//! The interface of a renderer that serves as a reference.

use crate::driver::{Driver, DriverError};
use crate::environment::{Environment, EnvironmentError, Installation};
use crate::explain::{self, Trial};
use crate::protocol::{Rendered, SceneText, Setting, Versions};
use std::path::Path;

/// A renderer that serves as a reference, with a driver that speaks
/// `references/mitsuba/PROTOCOL.md`.
pub trait Reference: Sync {
    /// The name for people.
    fn title(&self) -> &'static str;

    /// The name in files and results.
    fn name(&self) -> &'static str;

    /// The file next to a stored image with its metadata.
    fn meta_file(&self) -> String {
        format!("{}.toml", self.name())
    }

    /// The environment of its driver, created on first use. Calls `say` before slow steps.
    ///
    /// # Errors
    /// If it cannot run here.
    fn environment(
        &self,
        installation: &Installation,
        say: &dyn Fn(&str),
    ) -> Result<Environment, EnvironmentError>;

    /// The versions of the renderer.
    ///
    /// # Errors
    /// Those of the driver.
    fn versions(&self, driver: &mut Driver) -> Result<Versions, DriverError>;

    /// Renders a scene into an EXR file. An image with layers `variance.*` is noisy, and is
    /// compared by a significance test.
    ///
    /// # Errors
    /// Those of the driver.
    fn render(
        &self,
        driver: &mut Driver,
        scene: SceneText<'_>,
        out: &Path,
        setting: Setting,
    ) -> Result<Rendered, DriverError> {
        driver.render(scene, out, setting, 0)
    }

    /// Whether its driver reports ray trees.
    fn has_ray_trees(&self) -> bool {
        false
    }

    /// Whether its images can be stored.
    fn can_be_stored(&self) -> bool {
        true
    }

    /// The variations that explain pixels.
    fn trials(&self) -> Vec<Trial>;

    /// The variations that measure its own error in a pixel: only those of its roundings.
    fn roundings(&self) -> Vec<Trial> {
        explain::roundings(self.trials())
    }

    /// The variations that measure its floor.
    fn variations(&self) -> Vec<Setting>;

    /// The upper bound of the limit of a scene without textures.
    fn largest_limit(&self) -> f64;

    /// Whether it computes in single precision, so that distant or tiny scenes show its rounding
    /// errors.
    fn is_single_precision(&self) -> bool;

    /// Changes of a scene that both sides need so that this renderer can render it. Mitsuba already
    /// checks the changed parts; the second reference then checks the rest of the scene.
    fn adaptations(&self, _scene: &toml::Table) -> Vec<Adaptation> {
        Vec::new()
    }
}

/// A change on both sides that lets the reference render the scene.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Adaptation {
    /// `path=value`, as for `--set`.
    pub change: String,
    /// The reason.
    pub reason: &'static str,
}

impl Adaptation {
    pub(crate) fn new(change: impl Into<String>, reason: &'static str) -> Self {
        Self {
            change: change.into(),
            reason,
        }
    }
}

/// Removes the layers other than the radiance, if a scene has some.
pub(crate) fn without_layers(scene: &toml::Table, reason: &'static str) -> impl Iterator<Item = Adaptation> {
    let film = scene.get("film").and_then(toml::Value::as_table);
    let has = move |key: &str| match film.and_then(|film| film.get(key)) {
        Some(toml::Value::Array(aovs)) => !aovs.is_empty(),
        Some(toml::Value::Table(paths)) => !paths.is_empty(),
        _ => false,
    };
    let changes = [("aovs", "film.aovs=[]"), ("paths", "film.paths={}")];
    let present = changes.into_iter().filter(move |(key, _)| has(key));
    present.map(move |(_, change)| Adaptation::new(change, reason))
}
