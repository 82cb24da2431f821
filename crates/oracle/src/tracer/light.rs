//! Section 7.

use super::unknown;
use serde::Deserialize;
use whitstone_core::config::{Color, decode};
use whitstone_core::{DVec3, Rgb, SceneErrors};
use whitstone_scene::PluginTable;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Point {
    position: [f64; 3],
    intensity: Color,
    falloff: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Spot {
    position: [f64; 3],
    target: [f64; 3],
    intensity: Color,
    #[serde(default = "twenty")]
    cutoff_angle: f64,
    beam_width: Option<f64>,
    falloff: Option<String>,
}

fn twenty() -> f64 {
    20.0
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Directional {
    direction: [f64; 3],
    irradiance: Color,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Uniform {
    radiance: Color,
}

/// A light that shines on surfaces.
pub(super) enum Light {
    At {
        position: DVec3,
        intensity: Rgb,
        by_square: bool,
        /// The axis, and the angles of beam and cutoff in radians.
        cone: Option<(DVec3, [f64; 2])>,
    },
    Far {
        towards: DVec3,
        irradiance: Rgb,
    },
}

/// All of a scene.
pub(super) struct Lights {
    pub(super) all: Vec<Light>,
    pub(super) ambient: Rgb,
    background: Rgb,
}

impl Lights {
    pub(super) fn new(plugins: &[PluginTable<'_>]) -> Result<Self, SceneErrors> {
        let mut lights = Self {
            all: Vec::new(),
            ambient: Rgb::splat(0.0),
            background: Rgb::splat(0.0),
        };
        let by_square = |falloff: Option<String>| falloff.as_deref() != Some("none");
        for plugin in plugins {
            match &*plugin.name {
                "point" => {
                    let point: Point = decode(&plugin.table)?;
                    lights.all.push(Light::At {
                        position: point.position.into(),
                        intensity: point.intensity.get(),
                        by_square: by_square(point.falloff),
                        cone: None,
                    });
                }
                "spot" => {
                    let spot: Spot = decode(&plugin.table)?;
                    let [position, target] = [spot.position, spot.target].map(DVec3::from_array);
                    let beam = spot.beam_width.unwrap_or(0.75 * spot.cutoff_angle);
                    let angles = [beam, spot.cutoff_angle].map(f64::to_radians);
                    lights.all.push(Light::At {
                        position,
                        intensity: spot.intensity.get(),
                        by_square: by_square(spot.falloff),
                        cone: Some(((target - position).normalize(), angles)),
                    });
                }
                "directional" => {
                    let far: Directional = decode(&plugin.table)?;
                    lights.all.push(Light::Far {
                        towards: -DVec3::from_array(far.direction).normalize(),
                        irradiance: far.irradiance.get(),
                    });
                }
                "ambient" => lights.ambient += decode::<Uniform>(&plugin.table)?.radiance.get(),
                "background" => lights.background += decode::<Uniform>(&plugin.table)?.radiance.get(),
                _ => return Err(unknown(plugin, "light")),
            }
        }
        Ok(lights)
    }

    pub(super) fn background(&self) -> Rgb {
        self.background
    }
}

impl Light {
    /// Direction to it, its distance and the irradiance of a surface that faces it.
    pub(super) fn at(&self, p: DVec3) -> Option<(DVec3, f64, Rgb)> {
        match *self {
            Self::Far { towards, irradiance } => Some((towards, f64::INFINITY, irradiance)),
            Self::At {
                position,
                intensity,
                by_square,
                cone,
            } => {
                let to = position - p;
                let distance = to.length();
                if distance == 0.0 {
                    return None;
                }
                let l = to / distance;
                let part = cone.map_or(1.0, |(axis, [beam, cutoff])| {
                    // By the sine and the cosine: an arc cosine near 1 has few digits.
                    let angle = axis.cross(-l).length().atan2(axis.dot(-l));
                    if angle <= beam {
                        1.0
                    } else if angle < cutoff {
                        (cutoff - angle) / (cutoff - beam)
                    } else {
                        0.0
                    }
                });
                let square = if by_square { distance * distance } else { 1.0 };
                Some((l, distance, intensity * (part / square)))
            }
        }
    }
}
