//! The renderers that serve as references, and in what they differ for the harness.

use crate::driver::Setting;
use crate::explain::{self, Trial};
use crate::floor;
use std::fmt;
use toml::Value;

/// Who renders the other side.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Renderer {
    /// Mitsuba 3, traced by `references/mitsuba`.
    #[default]
    Mitsuba,
    /// POV-Ray 3.7, whose scenes `references/povray` writes.
    PovRay,
}

impl fmt::Display for Renderer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Mitsuba => "Mitsuba",
            Self::PovRay => "POV-Ray",
        })
    }
}

/// A change that makes a scene one that the reference can show, on both sides.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Adaptation {
    /// `path=value`, as for `--set`.
    pub change: String,
    /// Why.
    pub reason: &'static str,
}

impl Renderer {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Mitsuba, Self::PovRay];

    /// As files and results call it; also its folder below `references/`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mitsuba => "mitsuba",
            Self::PovRay => "povray",
        }
    }

    /// The Python package of its driver.
    pub(crate) fn package(self) -> &'static str {
        match self {
            Self::Mitsuba => "whitstone_mitsuba",
            Self::PovRay => "whitstone_povray",
        }
    }

    /// File of a stored image.
    pub fn image_file(self) -> String {
        format!("{}.exr", self.name())
    }

    /// File next to it with the values of the pixels that vary.
    pub fn variants_file(self) -> String {
        format!("{}.variants.exr", self.name())
    }

    /// File next to it that says what made it.
    pub fn meta_file(self) -> &'static str {
        match self {
            Self::Mitsuba => "meta.toml",
            Self::PovRay => "povray.toml",
        }
    }

    /// Whether its driver tells ray trees.
    pub(crate) fn tells_trees(self) -> bool {
        self == Self::Mitsuba
    }

    /// In which ways it is made to vary, to explain pixels.
    pub fn trials(self) -> Vec<Trial> {
        match self {
            Self::Mitsuba => explain::trials(),
            Self::PovRay => explain::trials_of_povray(),
        }
    }

    /// In which ways it is made to vary, to measure its own error.
    pub(crate) fn variations(self) -> Vec<Setting> {
        match self {
            Self::Mitsuba => floor::settings().to_vec(),
            Self::PovRay => floor::settings_of_povray().to_vec(),
        }
    }

    /// What of a scene, as it is flattened, has to be changed for it on both sides. What Mitsuba confirms of what is changed
    /// needs no second opinion; all else of the scene then can have one.
    pub fn adaptations(self, flattened: &str) -> Vec<Adaptation> {
        let Ok(scene) = flattened.parse::<toml::Table>() else {
            return Vec::new();
        };
        if self == Self::Mitsuba {
            return Vec::new();
        }
        let mut found = Vec::new();
        let mut change = |text: &str, reason| {
            found.push(Adaptation {
                change: text.to_owned(),
                reason,
            });
        };
        let film = scene.get("film").and_then(|film| film.get("aovs"));
        if film
            .and_then(Value::as_array)
            .is_some_and(|aovs| !aovs.is_empty())
        {
            change("film.aovs=[]", "POV-Ray has no layers beside the radiance");
        }
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
                change(text, "POV-Ray shows black where it goes no deeper");
            }
            if key("min_contribution").is_some() {
                change(
                    "integrator.min_contribution=0",
                    "POV-Ray cuts off faint branches by another rule",
                );
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changes(scene: &str) -> Vec<String> {
        let found = Renderer::PovRay.adaptations(scene);
        found.into_iter().map(|adaptation| adaptation.change).collect()
    }

    #[test]
    fn only_what_povray_cannot_show_is_changed() {
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
        assert_eq!(Renderer::Mitsuba.adaptations(sky), Vec::new());
    }
}
