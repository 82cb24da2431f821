//! Lights: section 7 of the model.

use super::mapping::{Place, TextureFunction};
use super::pattern::{Codes, Lookup, Picture};
use super::texture::Texture;
use super::wrap::Wrap;
use super::{sky, unknown};
use crate::shapes::mesh;
use crate::vector::unit_and_length;
use serde::Deserialize;
use std::f64::consts::{PI, TAU};
use whitstone_core::config::{Color, FilePath, TextureRef, decode};
use whitstone_core::transform_steps::TransformSteps;
use whitstone_core::{DAffine3, DVec2, DVec3, Rgb, SceneError, SceneErrors};
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
    image: Option<TextureRef>,
    up: Option<[f64; 3]>,
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
    file: Option<FilePath>,
    transform: Option<TransformSteps>,
    radiance: Color,
    samples: Option<u32>,
    falloff: Option<String>,
}

/// Whether light falls off with the squared distance.
fn falls_off(falloff: Option<&str>) -> bool {
    falloff != Some("none")
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Projector {
    position: [f64; 3],
    target: [f64; 3],
    up: Option<[f64; 3]>,
    fov: Option<f64>,
    aspect: Option<f64>,
    image: TextureRef,
    intensity: Color,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Environment {
    radiance: Option<TextureRef>,
    faces: Option<Faces>,
    #[serde(default)]
    samples: u32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Faces {
    px: Face,
    nx: Face,
    py: Face,
    ny: Face,
    pz: Face,
    nz: Face,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Face {
    file: FilePath,
}

/// An environment, or the map of `reflection_map`.
pub(super) enum Sky {
    Sphere(Texture),
    /// The faces in the order of the model.
    Cube(Vec<Picture>),
}

/// A projector.
pub(super) struct Slide {
    position: DVec3,
    /// Axes to the right and up, each divided by half the size of the image at 1 m, and the
    /// direction of projection.
    frame: [DVec3; 3],
    intensity: Rgb,
    slide: Texture,
}

/// The image of a spot light.
pub(super) struct SpotImage {
    /// Axes to the right and up, each divided by half the size of the image at 1 m, and the axis of
    /// the light.
    frame: [DVec3; 3],
    texture: Texture,
}

/// A light that illuminates surfaces.
pub(super) enum Light {
    At {
        position: DVec3,
        intensity: Rgb,
        by_square: bool,
        /// The axis, and the angles of beam and cutoff in radians.
        cone: Option<(DVec3, [f64; 2])>,
        image: Option<SpotImage>,
    },
    Far {
        towards: DVec3,
        irradiance: Rgb,
    },
    /// One sample point of an area light.
    Facing {
        position: DVec3,
        normal: DVec3,
        /// Its share of the area, times the radiance.
        power: Rgb,
        by_square: bool,
    },
    Thrown(Slide),
}

/// All lights of a scene.
pub(super) struct Lights {
    pub(super) all: Vec<Light>,
    pub(super) ambient: Rgb,
    background: Rgb,
    environments: Vec<Sky>,
}

impl Lights {
    pub(super) fn new(description: &Description<'_>) -> Result<Self, SceneErrors> {
        let mut lights = Self {
            all: Vec::new(),
            ambient: Rgb::splat(0.0),
            background: Rgb::splat(0.0),
            environments: Vec::new(),
        };
        for plugin in &description.lights {
            match &*plugin.name {
                "point" => {
                    let point: Point = decode(&plugin.table)?;
                    lights.all.push(Light::At {
                        position: point.position.into(),
                        intensity: point.intensity.get(),
                        by_square: falls_off(point.falloff.as_deref()),
                        cone: None,
                        image: None,
                    });
                }
                "spot" => {
                    let spot: Spot = decode(&plugin.table)?;
                    let [position, target] = [spot.position, spot.target].map(DVec3::from_array);
                    let beam = spot.beam_width.unwrap_or(0.75 * spot.cutoff_angle);
                    let angles = [beam, spot.cutoff_angle].map(f64::to_radians);
                    let axis = unit_and_length(target - position).0;
                    let image = match &spot.image {
                        Some(image) => Some(SpotImage {
                            frame: frame(axis, spot.up, angles[1].tan()),
                            texture: Texture::new(description, image)?,
                        }),
                        None if spot.up.is_some() => return Err(unknown(plugin, "light")),
                        None => None,
                    };
                    lights.all.push(Light::At {
                        position,
                        intensity: spot.intensity.get(),
                        by_square: falls_off(spot.falloff.as_deref()),
                        cone: Some((axis, angles)),
                        image,
                    });
                }
                "directional" => {
                    let far: Directional = decode(&plugin.table)?;
                    lights.all.push(Light::Far {
                        towards: -unit_and_length(DVec3::from_array(far.direction)).0,
                        irradiance: far.irradiance.get(),
                    });
                }
                "area" => {
                    let config: Area = decode(&plugin.table)?;
                    match config.file.clone() {
                        Some(file) => {
                            let triangles = mesh::read(description, &mesh::Config::of(file))?.triangles;
                            lights.all.extend(of_triangles(&config, &triangles));
                        }
                        None => lights.all.extend(area(&config)),
                    }
                }
                "projector" => {
                    let config: Projector = decode(&plugin.table)?;
                    let slide = Texture::new(description, &config.image)?;
                    lights.all.push(Light::Thrown(thrown(&config, slide)));
                }
                "ambient" => lights.ambient += decode::<Uniform>(&plugin.table)?.radiance.get(),
                "background" => lights.background += decode::<Uniform>(&plugin.table)?.radiance.get(),
                "environment" => {
                    let config: Environment = decode(&plugin.table)?;
                    let sky = Sky::new(description, config.radiance.as_ref(), config.faces.as_ref())?;
                    if config.samples > 0 {
                        let look = |uv, d| sky.at(uv, d);
                        let far = sky::lights(config.samples, sky.parts(), look).into_iter();
                        let far = far.map(|(towards, irradiance)| Light::Far { towards, irradiance });
                        lights.all.extend(far);
                    }
                    lights.environments.push(sky);
                }
                _ => return Err(unknown(plugin, "light")),
            }
        }
        Ok(lights)
    }

    /// The radiance of a ray that hits nothing.
    pub(super) fn background(&self, d: DVec3) -> Rgb {
        let environments = self.environments.iter();
        environments.fold(self.background, |sum, sky| sum + sky.seen(d))
    }
}

impl Sky {
    pub(super) fn new(
        description: &Description<'_>,
        radiance: Option<&TextureRef>,
        faces: Option<&Faces>,
    ) -> Result<Self, SceneErrors> {
        match (radiance, faces) {
            (Some(radiance), None) => Texture::new(description, radiance).map(Self::Sphere),
            (None, Some(faces)) => cube(description, faces).map(Self::Cube),
            _ => Err(SceneError::anywhere("either `radiance` or `faces`").into()),
        }
    }

    /// The radiance from a direction.
    pub(super) fn seen(&self, d: DVec3) -> Rgb {
        let u = 0.5 + d.x.atan2(-d.z) / TAU;
        self.at(DVec2::new(u, 0.5 + d.y.atan2(d.x.hypot(d.z)) / PI), d)
    }

    /// Number of lookups per cell of its table, along each axis.
    fn parts(&self) -> usize {
        match self {
            Self::Sphere(radiance) => radiance.size().map_or(1, sky::parts),
            // Four of the faces go around the horizon.
            Self::Cube(faces) => faces[0].size().map_or(1, |[m, _]| sky::parts([4 * m, 2 * m])),
        }
    }

    /// The radiance from direction `d`, which is at `uv`.
    fn at(&self, uv: DVec2, d: DVec3) -> Rgb {
        match self {
            Self::Sphere(radiance) => radiance.at(&Place {
                uv,
                p: d,
                n_s: d,
                ..Place::default()
            }),
            Self::Cube(faces) => {
                let m = d.abs().max_element();
                let axis = (0..3).find(|a| d[*a].abs() == m).unwrap_or(0);
                let (face, s, t) = match (axis, d[axis] < 0.0) {
                    (0, false) => (0, d.z, d.y),
                    (0, true) => (1, -d.z, d.y),
                    (1, false) => (2, d.x, d.z),
                    (1, true) => (3, d.x, -d.z),
                    (_, false) => (4, -d.x, d.y),
                    (_, true) => (5, d.x, d.y),
                };
                faces[face].at(DVec3::new((1.0 + s / m) / 2.0, (1.0 + t / m) / 2.0, 0.0))
            }
        }
    }
}

/// The images of the faces.
fn cube(description: &Description<'_>, faces: &Faces) -> Result<Vec<Picture>, SceneErrors> {
    let lookup = Lookup {
        filter: None,
        max_anisotropy: None,
        wrap: [Wrap::Clamp; 2],
        scale: None,
        offset: None,
    };
    let Faces {
        px,
        nx,
        py,
        ny,
        pz,
        nz,
    } = faces;
    let read = |face: &Face| {
        let codes = Codes::read(&face.file, description.sources);
        let picture = codes.and_then(|codes| Picture::of(&codes, None, &lookup));
        picture.map_err(|fault| {
            let message = format!("the oracle does not support {fault}");
            SceneErrors::from(SceneError::at(face.file.span.clone(), message))
        })
    };
    [px, nx, py, ny, pz, nz].into_iter().map(read).collect()
}

/// A projector with its frame.
fn thrown(config: &Projector, slide: Texture) -> Slide {
    let position = DVec3::from_array(config.position);
    let axis = unit_and_length(DVec3::from_array(config.target) - position).0;
    let half = (config.fov.unwrap_or(45.0).to_radians() / 2.0).tan();
    let [u, v, f] = frame(axis, config.up, half);
    Slide {
        position,
        frame: [u, v * config.aspect.unwrap_or(1.0), f],
        intensity: config.intensity.get(),
        slide,
    }
}

/// Axes to the right and up in an image that is projected along f, each divided by `half`, and f.
fn frame(f: DVec3, up: Option<[f64; 3]>, half: f64) -> [DVec3; 3] {
    let up = up.map_or(DVec3::Y, DVec3::from_array);
    let u = unit_and_length(f.cross(unit_and_length(up).0)).0;
    [u / half, u.cross(f) / half, f]
}

/// Offset of the sample points of an area light from its surface, relative to the largest
/// coordinate of the surface.
const OFF: f64 = 1.0 / (1_u64 << 47) as f64;

/// The sample points of a mesh light.
fn of_triangles(light: &Area, triangles: &[[[f64; 3]; 3]]) -> Vec<Light> {
    let transform = light.transform.as_ref();
    let map = transform.map_or(DAffine3::IDENTITY, |steps| *steps.get().world_from_object());
    let outwards = map.matrix3.determinant().signum();
    let n = light.samples.unwrap_or(1);
    let mut lights = Vec::new();
    let placed = |triangle: &[[f64; 3]; 3]| triangle.map(|p| map.transform_point3(p.into()));
    let vertices = triangles.iter().flat_map(placed);
    let size = vertices
        .map(|vertex| vertex.abs().max_element())
        .fold(0.0, f64::max);
    for triangle in triangles {
        let [a, b, c] = placed(triangle);
        let across = (b - a).cross(c - a);
        if across == DVec3::ZERO {
            continue;
        }
        let power = light.radiance.get() * (across.length() / f64::from(2 * n * n));
        // The upright parts of each triangle in rows, then the inverted ones.
        for (third, rows) in [(1, n), (2, n - 1)] {
            for (i, j) in (0..rows).flat_map(|j| (0..rows - j).map(move |i| (i, j))) {
                let [s, t] = [i, j].map(|k| f64::from(3 * k + third) / f64::from(3 * n));
                let normal = outwards * across.normalize();
                lights.push(Light::Facing {
                    position: a + s * (b - a) + t * (c - a) + OFF * size * normal,
                    normal,
                    power,
                    by_square: falls_off(light.falloff.as_deref()),
                });
            }
        }
    }
    lights
}

/// The sample points of an area light, in the order of the model.
fn area(light: &Area) -> Vec<Light> {
    let transform = light.transform.as_ref();
    let map = transform.map_or(DAffine3::IDENTITY, |steps| *steps.get().world_from_object());
    let [x, y] = [map.matrix3.x_axis, map.matrix3.y_axis];
    let size = (x.abs() + y.abs() + map.matrix3.z_axis.abs() + map.translation.abs()).max_element();
    let across = x.cross(y).length();
    let kind = light.shape.as_deref().unwrap_or("rectangle");
    let area = match kind {
        "disk" => PI * across,
        "sphere" => 4.0 * PI * x.length_squared(),
        _ => 4.0 * across,
    };
    let n = light.samples.unwrap_or(4);
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
        let normal = (normals * normal).normalize();
        Light::Facing {
            position: map.transform_point3(q) + OFF * size * normal,
            normal,
            power,
            by_square: falls_off(light.falloff.as_deref()),
        }
    };
    (0..n * n).map(place).collect()
}

impl Light {
    /// Direction to the light, distance, and irradiance of a surface that faces it.
    pub(super) fn at(&self, p: DVec3) -> Option<(DVec3, f64, Rgb)> {
        match *self {
            Self::Thrown(ref slide) => slide.at(p),
            Self::Far { towards, irradiance } => Some((towards, f64::INFINITY, irradiance)),
            Self::Facing {
                position,
                normal,
                power,
                by_square,
            } => {
                let (l, distance) = towards(position, p)?;
                let square = if by_square { distance * distance } else { 1.0 };
                let part = (-normal.dot(l)).max(0.0) / square;
                Some((l, distance, power * part))
            }
            Self::At {
                position,
                intensity,
                by_square,
                cone,
                ref image,
            } => {
                let (l, distance) = towards(position, p)?;
                let part = cone.map_or(1.0, |(axis, [beam, cutoff])| {
                    // The angle from sine and cosine: an arc cosine near 1 loses digits.
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
                let color = match image {
                    Some(image) if part > 0.0 => image.at(p - position),
                    _ => Rgb::splat(1.0),
                };
                Some((l, distance, intensity * color * (part / square)))
            }
        }
    }
}

impl SpotImage {
    /// The colour towards q, seen from the light.
    fn at(&self, q: DVec3) -> Rgb {
        let [x, y, z] = self.frame.map(|axis| axis.dot(q));
        look(&self.texture, DVec2::new(x / z, y / z))
    }
}

/// The colour of a projected image; both coordinates run from -1 to 1.
fn look(image: &Texture, at: DVec2) -> Rgb {
    let uv = (1.0 + at) / 2.0;
    image.at(&Place {
        uv,
        p: uv.extend(0.0),
        n_s: DVec3::Z,
        ..Place::default()
    })
}

impl Slide {
    fn at(&self, p: DVec3) -> Option<(DVec3, f64, Rgb)> {
        let (l, distance) = towards(self.position, p)?;
        let [x, y, z] = self.frame.map(|axis| axis.dot(p - self.position));
        if !(z > 0.0 && x.abs() <= z && y.abs() <= z) {
            return Some((l, distance, Rgb::splat(0.0)));
        }
        let factor = distance / (z * z * z);
        let color = look(&self.slide, DVec2::new(x / z, y / z));
        Some((l, distance, self.intensity * color * factor))
    }
}

/// Direction and distance; `None` if the light is exactly at the point.
fn towards(position: DVec3, p: DVec3) -> Option<(DVec3, f64)> {
    let to = position - p;
    (to != DVec3::ZERO).then(|| unit_and_length(to))
}

#[cfg(test)]
mod tests {
    use crate::testing::{pixel, shows};
    use std::f64::consts::PI;

    /// A rectangle at z = 0 under this light and the ambient light of the test's head, which adds
    /// the reflectance.
    fn lit(light: &str) -> String {
        format!(
            "[[light]]\n{light}\n[[shape]]\ntype = \"rectangle\"\ntransform = {{ scale = 4 }}\n\
            material = {{ type = \"matte\", reflectance = 0.5 }}\n"
        )
    }

    #[test]
    fn lights_far_away() {
        for far in ["1e9", "1e308"] {
            let light = format!(
                "type = \"spot\"\nintensity = 2\nfalloff = \"none\"\nposition = [0, 0, {far}]\ntarget = [0, 0, 0]"
            );
            shows([0.5, 0.0], &lit(&light), &[], [0.5 + 2.0 * 0.5 / PI; 3]);
        }
    }

    #[test]
    fn area_lights_without_falloff() {
        let turn =
            "transform = [{ rotate = { axis = [1, 0, 0], degrees = 180 } }, { translate = [0, 0, 4] }]";
        let one = format!("type = \"area\"\nradiance = [1, 2, 3]\nsamples = 1\n{turn}");
        // At (x, 0, 0), both cosines are 4/d.
        for x in [0.0, 1.5] {
            let d2: f64 = 16.0 + x * x;
            let even = 0.5 / PI * 4.0 * 16.0 / d2;
            let none = format!("{one}\nfalloff = \"none\"");
            shows(
                [x, 0.0],
                &lit(&none),
                &[],
                [1.0, 2.0, 3.0].map(|l| 0.5 + l * even),
            );
            shows(
                [x, 0.0],
                &lit(&one),
                &[],
                [1.0, 2.0, 3.0].map(|l| 0.5 + l * even / d2),
            );
        }
        let file = b"v -1 1 4\nv 1 1 4\nv 0 -2 4\nf 1 2 3\n";
        let mesh = "type = \"area\"\nshape = \"mesh\"\nfile = \"m.obj\"\nradiance = 2\nfalloff = \"none\"";
        shows(
            [0.0, 0.0],
            &lit(mesh),
            &[("m.obj", file)],
            [0.5 + 0.5 / PI * 2.0 * 3.0; 3],
        );
    }

    /// A spot light from 2 m above; the image is 4 m wide at z = 0, with +x to the left and +y
    /// down.
    #[test]
    fn images_of_spot_lights() {
        let spot = "type = \"spot\"\nposition = [0, 0, 2]\ntarget = [0, 0, 0]\nup = [0, -3, 1]\nintensity = 2\n\
            cutoff_angle = 45\nbeam_width = 40\n";
        let ramp = |turn: &str| {
            format!(
                "image = {{ type = \"gradient\", a = 0, b = [1, 2, 3], wrap = \"clamp\", \
                mapping = {{ transform = {{ matrix = {turn} }} }} }}"
            )
        };
        let along_a = ramp("[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]");
        let along_c = ramp("[[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0]]");
        for (x, y) in [(0.0, 0.0), (1.0, 0.5), (-0.25, -1.5)] {
            let d2: f64 = 4.0 + x * x + y * y;
            // The light is seen from below, so that right is -x with -y up.
            for (image, t) in [
                (&along_a, (1.0 - x / 2.0) / 2.0),
                (&along_c, (1.0 - y / 2.0) / 2.0),
            ] {
                let e = 0.5 / PI * 2.0 * t * 2.0 / d2.sqrt();
                let text = format!("{spot}{image}");
                shows(
                    [x, y],
                    &lit(&text),
                    &[],
                    [1.0, 2.0, 3.0].map(|b| 0.5 + b * e / d2),
                );
                let none = format!("{text}\nfalloff = \"none\"");
                shows([x, y], &lit(&none), &[], [1.0, 2.0, 3.0].map(|b| 0.5 + b * e));
            }
        }
        shows([1.6, 1.6], &lit(&format!("{spot}{along_a}")), &[], [0.5; 3]);
        assert!(pixel([0.0; 2], &lit(spot), &[]).is_err());
    }
}
