//! Lights of KHR_lights_punctual.

use super::import::{Importer, shortest};
use crate::document::{color, numbers, table};
use std::f32::consts::FRAC_PI_4;
use toml::Value;
use whitstone_core::{DAffine3, FormatError};
use whitstone_gltf::Document;
use whitstone_gltf::json::extensions::scene::khr_lights_punctual::Type;
use whitstone_gltf::json::validation::Checked;

/// The luminous efficacy of monochromatic light of 540 THz, in lm/W, which defines the candela
/// (BIPM, *The International System of Units*, 9th edition, 2019, section 2.3.1).
const LUMENS_PER_WATT: f64 = 683.0;

impl Importer<'_> {
    /// Adds a light that stands at a place.
    pub(crate) fn add_light(
        &mut self,
        index: usize,
        world: &DAffine3,
        place: &str,
    ) -> Result<(), FormatError> {
        let extensions = self.document.root.extensions.as_ref();
        let lights = extensions.and_then(|extensions| extensions.khr_lights_punctual.as_ref());
        let lights = lights.map_or(&[][..], |lights| &lights.lights);
        let pointer = || format!("{place}/extensions/KHR_lights_punctual/light");
        let light = Document::item(lights, index, "extensions/KHR_lights_punctual/lights", pointer)
            .map_err(self.told())?;
        let at = format!("/extensions/KHR_lights_punctual/lights/{index}");
        let Checked::Valid(kind) = light.type_ else {
            let message = "expected \"directional\", \"point\" or \"spot\"";
            return Err(FormatError::at(format!("{at}/type"), message));
        };
        let mut strength = shortest(light.intensity);
        if self.options.photometric {
            strength /= LUMENS_PER_WATT;
        }
        let power = color(light.color.map(|part| (shortest(part) * strength).max(0.0)));
        let Some(forward) = (-world.matrix3.z_axis).try_normalize() else {
            self.note("nodes without volume", place);
            return Ok(());
        };
        let position = world.translation;
        if light.range.is_some() {
            self.note("light range", &at);
        }
        self.note("KHR_lights_punctual", &at);
        let kind_key = |name: &str| ("type", Value::String(name.into()));
        let keys = match kind {
            Type::Directional => table([
                kind_key("directional"),
                ("direction", numbers(forward.to_array())),
                ("irradiance", power),
            ]),
            Type::Point => table([
                kind_key("point"),
                ("position", numbers(position.to_array())),
                ("intensity", power),
            ]),
            Type::Spot => {
                // Without `spot`, its numbers have their defaults.
                let angles = light.spot.as_ref().map_or([FRAC_PI_4, 0.0], |spot| {
                    [spot.outer_cone_angle, spot.inner_cone_angle]
                });
                let [outer, inner] = angles.map(|angle| shortest(angle).to_degrees());
                // A hard border is a narrow one, and a cone ends before it is a half-space.
                let outer = outer.clamp(0.01, 89.99);
                let inner = inner.clamp(0.0, outer * 0.9999);
                self.note("spot light falloff", &at);
                table([
                    kind_key("spot"),
                    ("position", numbers(position.to_array())),
                    ("target", numbers((position + forward).to_array())),
                    ("intensity", power),
                    ("cutoff_angle", Value::Float(outer)),
                    ("beam_width", Value::Float(inner)),
                ])
            }
        };
        self.scene.lights.push(keys);
        Ok(())
    }
}
