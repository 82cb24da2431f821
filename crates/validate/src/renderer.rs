//! The renderers that serve as references. The file of each renderer contains everything that is
//! specific to it.

mod mitsuba;
mod povray;
mod stock;

use crate::driver::{Driver, DriverError, Rendered, SceneText, Setting, Versions};
use crate::environment::{Environment, EnvironmentError};
use crate::explain::{self, Trial};
use std::fmt;
use std::ops::Deref;
use std::path::Path;

/// A renderer that serves as a reference, with a driver that speaks
/// `references/mitsuba/PROTOCOL.md`.
pub trait Reference: Sync {
    /// The name for people.
    fn title(&self) -> &'static str;

    /// The name in files and results.
    fn name(&self) -> &'static str;

    /// The Python package of its driver.
    fn package(&self) -> &'static str;

    /// The folder of its driver below `references/`. Third-party plugins use this name, too.
    fn package_folder(&self) -> &'static str {
        self.name()
    }

    /// The file next to a stored image with its metadata.
    fn meta_file(&self) -> String {
        format!("{}.toml", self.name())
    }

    /// Whether it is installed for Whitstone alone, so that its version changes only with its
    /// requirements.
    fn is_private(&self) -> bool;

    /// The environment of its driver, created on first use. Calls `say` before slow steps.
    ///
    /// # Errors
    /// If it cannot run here.
    fn environment(
        &self,
        target: &Path,
        references: &Path,
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

/// A reference renderer.
#[derive(Clone, Copy)]
pub struct Renderer(&'static dyn Reference);

impl Renderer {
    /// Mitsuba 3, driven by `references/mitsuba`.
    pub const MITSUBA: Self = Self(&mitsuba::Mitsuba);
    /// Mitsuba's own integrators, with the same camera rays.
    pub const MITSUBA_STOCK: Self = Self(&stock::Stock);
    /// POV-Ray 3.7, driven by `references/povray`.
    pub const POVRAY: Self = Self(&povray::PovRay);

    /// The built-in renderers.
    pub const ALL: [Self; 3] = [Self::MITSUBA, Self::MITSUBA_STOCK, Self::POVRAY];

    /// A third-party renderer.
    pub const fn new(reference: &'static dyn Reference) -> Self {
        Self(reference)
    }

    /// File of a stored image.
    pub fn image_file(self) -> String {
        format!("{}.exr", self.name())
    }

    /// The file next to it with the values of the pixels that vary.
    pub fn variants_file(self) -> String {
        format!("{}.variants.exr", self.name())
    }

    /// Changes of a flattened scene on both sides: see [`Reference::adaptations`].
    pub fn adaptations_of(self, flattened: &str) -> Vec<Adaptation> {
        let scene = flattened.parse::<toml::Table>();
        scene.map_or_else(|_| Vec::new(), |scene| self.adaptations(&scene))
    }
}

impl Deref for Renderer {
    type Target = dyn Reference;

    fn deref(&self) -> &Self::Target {
        self.0
    }
}

impl PartialEq for Renderer {
    fn eq(&self, other: &Self) -> bool {
        self.name() == other.name()
    }
}

impl Eq for Renderer {}

impl fmt::Debug for Renderer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl fmt::Display for Renderer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.title())
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
    fn new(change: impl Into<String>, reason: &'static str) -> Self {
        Self {
            change: change.into(),
            reason,
        }
    }
}

/// Removes the layers other than the radiance, if a scene has some.
fn without_layers(scene: &toml::Table, reason: &'static str) -> Option<Adaptation> {
    let layers = scene.get("film").and_then(|film| film.get("aovs"));
    let some = layers
        .and_then(toml::Value::as_array)
        .is_some_and(|aovs| !aovs.is_empty());
    some.then(|| Adaptation::new("film.aovs=[]", reason))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changes(renderer: Renderer, scene: &str) -> Vec<String> {
        let found = renderer.adaptations_of(scene);
        found.into_iter().map(|adaptation| adaptation.change).collect()
    }

    #[test]
    fn only_what_povray_cannot_show_is_changed() {
        let changes = |scene: &str| changes(Renderer::POVRAY, scene);
        assert_eq!(
            changes("[film]\nwidth = 3\n[integrator]\ntype = \"appel\"\n"),
            Vec::<String>::new()
        );
        let sky = "[[light]]\ntype = \"background\"\n";
        assert_eq!(
            changes(sky),
            ["integrator={type=\"whitted\",at_max_depth=\"black\"}"]
        );
        assert_eq!(
            changes(&format!("{sky}[integrator]\ntype = \"appel\"\n")),
            Vec::<String>::new()
        );
        let whitted = "[integrator]\ntype = \"whitted\"\nmin_contribution = 0.1\n";
        assert_eq!(changes(whitted), ["integrator.min_contribution=0"]);
        assert_eq!(
            changes(&format!("{sky}{whitted}[film]\naovs = [\"uv\"]\n")),
            [
                "film.aovs=[]",
                "integrator.at_max_depth=\"black\"",
                "integrator.min_contribution=0"
            ]
        );
        assert_eq!(Renderer::MITSUBA.adaptations_of(sky), Vec::new());
    }

    #[test]
    fn mitsubas_integrators_get_what_they_can_render() {
        let changes = |scene: &str| changes(Renderer::MITSUBA_STOCK, scene);
        let matte = "[material.m]\ntype = \"matte\"\n[[shape]]\nmaterial = \"m\"\n";
        let glass = "[material.g]\ntype = \"dielectric\"\n[[shape]]\nmaterial = \"g\"\n";
        assert_eq!(changes(matte), Vec::<String>::new());
        assert_eq!(
            changes(&format!(
                "{matte}[[light]]\ntype = \"point\"\n[[light]]\ntype = \"ambient\"\n"
            )),
            ["light.1.radiance=0"]
        );
        assert_eq!(
            changes(glass),
            ["integrator={type=\"whitted\",at_max_depth=\"black\"}"]
        );
        let of_both = format!("{matte}{glass}");
        assert_eq!(changes(&of_both), ["integrator={type=\"appel\"}"]);
        let filtered = format!("{of_both}[integrator]\nshadows = \"filtered\"\n");
        assert_eq!(
            changes(&filtered),
            ["integrator={type=\"appel\",shadows=\"filtered\"}"]
        );
    }
}
