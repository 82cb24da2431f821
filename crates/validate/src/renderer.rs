//! The renderers that serve as references. The file of each renderer contains everything that is
//! specific to it.

mod mitsuba;
mod povray;
mod stock;

pub use crate::reference::{Adaptation, Reference};
use std::fmt;
use std::ops::Deref;

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
