//! Section 7.

use super::texture::{Place, Texture};
use super::unknown;
use serde::Deserialize;
use std::f64::consts::{PI, TAU};
use whitstone_core::config::{Color, TextureRef, decode};
use whitstone_core::steps::Steps;
use whitstone_core::{DAffine3, DVec2, DVec3, Rgb, SceneErrors};
use whitstone_scene::Description;

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

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Area {
    shape: Option<String>,
    transform: Option<Steps>,
    radiance: Color,
    #[serde(default = "four")]
    samples: u32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Environment {
    radiance: TextureRef,
    #[serde(default)]
    samples: u32,
}

fn four() -> u32 {
    4
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
    /// One of the points of a surface that shines.
    Facing {
        position: DVec3,
        normal: DVec3,
        /// Its part of the area, times the radiance.
        power: Rgb,
    },
}

/// All of a scene.
pub(super) struct Lights {
    pub(super) all: Vec<Light>,
    pub(super) ambient: Rgb,
    background: Rgb,
    environments: Vec<Texture>,
}

impl Lights {
    pub(super) fn new(description: &Description<'_>) -> Result<Self, SceneErrors> {
        let mut lights = Self {
            all: Vec::new(),
            ambient: Rgb::splat(0.0),
            background: Rgb::splat(0.0),
            environments: Vec::new(),
        };
        let by_square = |falloff: Option<String>| falloff.as_deref() != Some("none");
        for plugin in &description.lights {
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
                "area" => lights.all.extend(area(&decode(&plugin.table)?)),
                "ambient" => lights.ambient += decode::<Uniform>(&plugin.table)?.radiance.get(),
                "background" => lights.background += decode::<Uniform>(&plugin.table)?.radiance.get(),
                "environment" => {
                    let config: Environment = decode(&plugin.table)?;
                    let radiance = Texture::new(description, &config.radiance)?;
                    lights.all.extend(around(&radiance, config.samples));
                    lights.environments.push(radiance);
                }
                _ => return Err(unknown(plugin, "light")),
            }
        }
        Ok(lights)
    }

    /// What a ray sees that hits nothing.
    pub(super) fn background(&self, d: DVec3) -> Rgb {
        let environments = self.environments.iter();
        environments.fold(self.background, |sum, radiance| sum + seen(radiance, d))
    }
}

/// The radiance of an environment from a direction.
fn seen(radiance: &Texture, d: DVec3) -> Rgb {
    let uv = DVec2::new(0.5 + d.x.atan2(-d.z) / TAU, 0.5 + d.y.atan2(d.x.hypot(d.z)) / PI);
    radiance.at(&Place { uv, p: d, n_s: d })
}

/// The lights that an environment is.
fn around(radiance: &Texture, n: u32) -> impl Iterator<Item = Light> {
    (0..2 * n * n).map(move |index| {
        let (i, j) = (f64::from(index % (2 * n)), f64::from(index / (2 * n)));
        let side = f64::from(n);
        let y = 1.0 - 2.0 * (j + 0.5) / side;
        let r = (1.0 - y * y).sqrt();
        let (sin, cos) = (PI * (i + 0.5) / side).sin_cos();
        let towards = DVec3::new(r * cos, y, r * sin);
        Light::Far {
            towards,
            irradiance: seen(radiance, towards) * (TAU / (side * side)),
        }
    })
}

/// The lights that an area light is, one behind the other.
fn area(light: &Area) -> Vec<Light> {
    let transform = light.transform.as_ref();
    let map = transform.map_or(DAffine3::IDENTITY, |steps| *steps.get().world_from_object());
    let [x, y] = [map.matrix3.x_axis, map.matrix3.y_axis];
    let across = x.cross(y).length();
    let kind = light.shape.as_deref().unwrap_or("rectangle");
    let area = match kind {
        "disk" => PI * across,
        "sphere" => 4.0 * PI * x.length_squared(),
        _ => 4.0 * across,
    };
    let n = light.samples;
    let power = light.radiance.get() * (area / f64::from(n * n));
    let normals = map.matrix3.inverse().transpose();
    let place = |k: u32| {
        let at = |i: u32| (f64::from(i) + 0.5) / f64::from(n);
        let (u, v) = (at(k % n), at(k / n));
        let (sin, cos) = (TAU * u).sin_cos();
        let (q, normal) = match kind {
            "disk" => (DVec3::new(v.sqrt() * cos, v.sqrt() * sin, 0.0), DVec3::Z),
            "sphere" => {
                let z = 1.0 - 2.0 * v;
                let r = (1.0 - z * z).sqrt();
                let q = DVec3::new(r * cos, r * sin, z);
                (q, q)
            }
            _ => (DVec3::new(2.0 * u - 1.0, 2.0 * v - 1.0, 0.0), DVec3::Z),
        };
        Light::Facing {
            position: map.transform_point3(q),
            normal: (normals * normal).normalize(),
            power,
        }
    };
    (0..n * n).map(place).collect()
}

impl Light {
    /// Direction to it, its distance and the irradiance of a surface that faces it.
    pub(super) fn at(&self, p: DVec3) -> Option<(DVec3, f64, Rgb)> {
        match *self {
            Self::Far { towards, irradiance } => Some((towards, f64::INFINITY, irradiance)),
            Self::Facing {
                position,
                normal,
                power,
            } => {
                let (l, distance) = towards(position, p)?;
                let part = (-normal.dot(l)).max(0.0) / (distance * distance);
                Some((l, distance, power * part))
            }
            Self::At {
                position,
                intensity,
                by_square,
                cone,
            } => {
                let (l, distance) = towards(position, p)?;
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

/// Direction and distance; a light at the very point gives nothing.
fn towards(position: DVec3, p: DVec3) -> Option<(DVec3, f64)> {
    let to = position - p;
    let distance = to.length();
    (distance != 0.0).then(|| (to / distance, distance))
}
