//! Light sources.
//!
//! pbrt normalises the spectra of lights: one with the colour 1 and the scale 1 has luminance 1.

use super::params::Args;
use super::scene::{Area, Importer};
use crate::document::{color, numbers, typed};
use std::f64::consts::PI;
use toml::Value;
use whitstone_core::DVec3;

/// `samples` of an environment: it lights from twice the square of this number of directions.
const ENVIRONMENT_SAMPLES: i64 = 4;
const LIGHTS: [&str; 4] = ["point", "distant", "spot", "infinite"];

impl Importer<'_> {
    /// Colour times scale.
    fn emission(&mut self, args: &mut Args, name: &'static str) -> [f64; 3] {
        let value = self.color(args, name, true).unwrap_or([1.0; 3]);
        let scale = self.number(args, "scale", 1.0);
        if scale < 0.0 {
            self.error(args.at, "\"scale\" must not be negative");
        }
        value.map(|value| value * scale * self.exposure)
    }

    /// A power or illuminance that is given, and not negative: then it has no effect.
    fn target(&mut self, args: &mut Args, name: &'static str) -> Option<f64> {
        self.optional_number(args, name).filter(|value| *value > 0.0)
    }

    pub(super) fn light(&mut self, plugin: &str, mut args: Args) {
        let at = args.at;
        let map = self.world_map() * self.state.ctm;
        if !self.can_invert(&map) {
            self.error(at, "the transform of a light cannot be inverted or is too large");
        }
        let origin = |importer: &mut Self, args: &mut Args| {
            let from = importer.point(args, "from", DVec3::ZERO);
            (from, map.transform_point3(from))
        };
        let light = match plugin {
            "point" => {
                let mut intensity = self.emission(&mut args, "I");
                if let Some(power) = self.target(&mut args, "power") {
                    intensity = intensity.map(|value| value * power / (4.0 * PI));
                }
                let (_, position) = origin(self, &mut args);
                typed(
                    "point",
                    [
                        ("position", numbers(position.to_array())),
                        ("intensity", color(intensity)),
                    ],
                )
            }
            "distant" => {
                let mut irradiance = self.emission(&mut args, "L");
                if let Some(illuminance) = self.target(&mut args, "illuminance") {
                    irradiance = irradiance.map(|value| value * illuminance);
                }
                let (from, _) = origin(self, &mut args);
                let to = self.point(&mut args, "to", DVec3::Z);
                let direction = map.transform_vector3(to - from);
                if direction.try_normalize().is_none() {
                    self.error(at, "\"from\" and \"to\" of a light must differ");
                }
                typed(
                    "directional",
                    [
                        ("direction", numbers(direction.to_array())),
                        ("irradiance", color(irradiance)),
                    ],
                )
            }
            "spot" => {
                let mut intensity = self.emission(&mut args, "I");
                let cone = self.number(&mut args, "coneangle", 30.0);
                let delta = self.number(&mut args, "conedeltaangle", 5.0);
                if !(cone > 0.0 && cone < 90.0 && delta >= 0.0) {
                    let message =
                        "expected \"coneangle\" between 0 and 90 and \"conedeltaangle\" of at least 0";
                    self.error(at, message);
                }
                let inner = (cone - delta).max(0.0);
                if let Some(power) = self.target(&mut args, "power") {
                    let (outer_cos, inner_cos) = (
                        libm::cos(cone.to_radians()),
                        libm::cos((cone - delta).to_radians()),
                    );
                    let unit = 2.0 * PI * ((1.0 - inner_cos) + (inner_cos - outer_cos) / 2.0);
                    intensity = intensity.map(|value| value * power / unit);
                }
                let (from, position) = origin(self, &mut args);
                let to = self.point(&mut args, "to", DVec3::Z);
                let target = map.transform_point3(to);
                if from == to || position == target {
                    self.error(at, "\"from\" and \"to\" of a light must differ");
                }
                self.note("LightSource spot", at);
                typed(
                    "spot",
                    [
                        ("position", numbers(position.to_array())),
                        ("target", numbers(target.to_array())),
                        ("intensity", color(intensity)),
                        ("cutoff_angle", Value::Float(cone)),
                        // A border without a width is not allowed.
                        ("beam_width", Value::Float(inner.min(cone * (1.0 - 1e-9)))),
                    ],
                )
            }
            "infinite" => {
                if args.has("filename") || args.has("portal") {
                    let fault =
                        self.fault(at, "an infinite light with an image or a portal is not supported");
                    let help =
                        "its map is equal-area; convert it with `imgtool` and add an environment light";
                    self.report(fault.with_help(help));
                    args.ignore(&["filename", "portal"]);
                }
                self.note("LightSource infinite", at);
                let mut radiance = self.emission(&mut args, "L");
                if let Some(illuminance) = self.target(&mut args, "illuminance") {
                    radiance = radiance.map(|value| value * illuminance / PI);
                }
                typed(
                    "environment",
                    [
                        ("radiance", color(radiance)),
                        ("samples", Value::Integer(ENVIRONMENT_SAMPLES)),
                    ],
                )
            }
            _ => return self.unknown_plugin("light", plugin, &LIGHTS, at),
        };
        self.done(args);
        self.push_light(light, at);
    }

    /// The emission of the shapes that follow.
    pub(super) fn area(&mut self, plugin: &str, mut args: Args) -> Option<Area> {
        let at = args.at;
        if plugin != "diffuse" {
            self.unknown_plugin("area light", plugin, &["diffuse"], at);
            return None;
        }
        if args.has("filename") {
            args.ignore(&["filename"]);
            self.error(at, "an area light with an image is not supported");
        }
        let area = Area {
            radiance: self.emission(&mut args, "L"),
            power: self.target(&mut args, "power"),
            two_sided: self.boolean(&mut args, "twosided", false),
            at,
        };
        self.done(args);
        Some(area)
    }
}
