//! Cameras and lights.

use super::{Exporter, table};
use crate::gltf::import::shortest;
use serde_json::json;
use toml::Table;
use whitstone_core::{DAffine3, DMat3, DVec3};

/// The near limit in metres of a perspective camera without one; glTF requires one.
const NEAR: f64 = 0.001;

/// The part of the view's plane that a camera shows, and the distance of that plane.
struct Window {
    l: f64,
    r: f64,
    b: f64,
    t: f64,
    d: f64,
}

impl Window {
    fn of(table: &Table) -> Option<Self> {
        let number = |key: &str| table::number(table, key);
        Some(Self {
            l: number("l")?,
            r: number("r")?,
            b: number("b")?,
            t: number("t")?,
            d: number("d").unwrap_or(1.0),
        })
    }

    /// Half of its width and height.
    fn half(&self) -> [f64; 2] {
        [(self.r - self.l) / 2.0, (self.t - self.b) / 2.0]
    }

    fn middle(&self) -> [f64; 2] {
        [(self.r + self.l) / 2.0, (self.t + self.b) / 2.0]
    }
}

impl<'a> Exporter<'a> {
    pub(super) fn camera(&mut self) {
        let document: &'a Table = self.document;
        let Some(camera) = table::table(document, "camera") else {
            return;
        };
        let film = table::table(document, "film");
        let size = |key: &str| film.and_then(|film| table::number(film, key)).unwrap_or(512.0);
        let [width, height] = [size("width"), size("height")];
        let Some(mut world) = frame(camera) else {
            return;
        };
        let near = table::number(camera, "near").unwrap_or(0.0);
        let given = table::table(camera, "window").and_then(Window::of);
        let keys = match table::kind(camera) {
            kind @ ("perspective" | "thin_lens") => {
                if kind == "thin_lens" {
                    self.note("[camera] thin_lens", "camera");
                }
                if near < 0.0 {
                    self.note("[camera] negative near", "camera");
                }
                if table::text(camera, "near_kind") == Some("spherical") {
                    self.note("[camera] near_kind", "camera");
                }
                let window = given.unwrap_or_else(|| {
                    let [x, y] = field(camera, width, height);
                    Window {
                        l: -x,
                        r: x,
                        b: -y,
                        t: y,
                        d: 1.0,
                    }
                });
                let [x, y] = window.half();
                if window.middle().iter().any(|part| part.abs() > 1e-9 * (x + y)) {
                    self.note("[camera] window that is not centred", "camera");
                }
                json!({
                    "type": "perspective",
                    "perspective": {
                        "yfov": single(2.0 * libm::atan(y / window.d)),
                        "aspectRatio": single(x / y),
                        "znear": single(if near > 0.0 { near } else { NEAR }),
                    },
                })
            }
            "orthographic" => {
                let window = given.unwrap_or_else(|| {
                    let x = table::number(camera, "width").unwrap_or(2.0) / 2.0;
                    let y = x * height / width;
                    Window {
                        l: -x,
                        r: x,
                        b: -y,
                        t: y,
                        d: 1.0,
                    }
                });
                let [x, y] = window.half();
                // The camera stands in the middle of the window, at the near limit if rays start
                // behind the origin.
                let [right, up] = window.middle();
                let backwards = (-near).max(0.0);
                world.translation = world.transform_point3(DVec3::new(right, up, backwards));
                let near = near.max(0.0);
                let (low, high) = (self.bounds.low, self.bounds.high);
                let far = if low.cmple(high).all() {
                    world.translation.distance((low + high) / 2.0) + low.distance(high)
                } else {
                    1000.0
                };
                json!({
                    "type": "orthographic",
                    "orthographic": {
                        "xmag": single(x),
                        "ymag": single(y),
                        "znear": single(near),
                        "zfar": single(near + 1.0 + 2.0 * far),
                    },
                })
            }
            other => {
                let place = format!("camera {other}");
                return self.note("[camera] of another type", &place);
            }
        };
        self.root.cameras.push(keys);
        let node = self.node("camera", &world);
        self.root.nodes[node]["camera"] = json!(0);
        self.root.roots.push(node);
    }

    pub(super) fn lights(&mut self) {
        let document: &'a Table = self.document;
        for (place, light) in table::tables(document, "light").into_iter().enumerate() {
            let name = format!("light[{place}]");
            let position = table::vector(light, "position").unwrap_or_default();
            let kind = table::kind(light);
            let (key, world) = match kind {
                "point" => ("intensity", DAffine3::from_translation(position)),
                "directional" => {
                    let direction = table::vector(light, "direction").unwrap_or(DVec3::NEG_Y);
                    ("irradiance", looking(DVec3::ZERO, direction))
                }
                "spot" => {
                    let target = table::vector(light, "target").unwrap_or_default();
                    ("intensity", looking(position, target - position))
                }
                _ => {
                    let place = format!("{name} {kind}");
                    self.note("[[light]] of another type", &place);
                    continue;
                }
            };
            if table::text(light, "falloff") == Some("none") {
                self.note("[[light]] falloff none", &name);
            }
            let power = table::color(light, key, [0.0; 3]);
            let largest = power.into_iter().fold(0.0, f64::max);
            let mut keys = json!({ "type": kind, "name": name, "intensity": single(largest) });
            if largest > 0.0 && power != [largest; 3] {
                keys["color"] = power.map(|part| single(part / largest)).to_vec().into();
            }
            if kind == "spot" {
                let outer = table::number(light, "cutoff_angle").unwrap_or(20.0);
                let inner = table::number(light, "beam_width").unwrap_or(0.75 * outer);
                self.note("spot light falloff", &name);
                if light.contains_key("image") {
                    self.note("[[light]] image of a spot", &name);
                }
                keys["spot"] = json!({
                    "innerConeAngle": single(inner.to_radians()),
                    "outerConeAngle": single(outer.to_radians()),
                });
            }
            let number = self.root.lights.len();
            self.root.lights.push(keys);
            self.root.uses("KHR_lights_punctual");
            let node = self.node(&name, &world);
            self.root.nodes[node]["extensions"] = json!({ "KHR_lights_punctual": { "light": number } });
            self.root.roots.push(node);
        }
    }
}

/// A number as a file in single precision holds it.
pub(super) fn single(value: f64) -> f64 {
    shortest(value as f32)
}

/// Half of the width and height of the view at the distance 1.
fn field(camera: &Table, width: f64, height: f64) -> [f64; 2] {
    let half = libm::tan(table::number(camera, "fov").unwrap_or(45.0).to_radians() / 2.0);
    let along_x = match table::text(camera, "fov_axis") {
        Some("y") => false,
        Some("smaller") => width <= height,
        Some("larger") => width >= height,
        _ => true,
    };
    if along_x {
        [half, half * height / width]
    } else {
        [half * width / height, half]
    }
}

/// The frame of a camera: x to the right, y up, and -z in the direction of the view.
fn frame(camera: &Table) -> Option<DAffine3> {
    let look_at = table::table(camera, "look_at")?;
    let origin = table::vector(look_at, "origin")?;
    let target = table::vector(look_at, "target")?;
    let up = table::vector(look_at, "up").unwrap_or(DVec3::Y);
    let w = (origin - target).try_normalize()?;
    let u = up.cross(w).try_normalize()?;
    let matrix = DMat3::from_cols(u, w.cross(u), w);
    Some(DAffine3::from_mat3_translation(matrix, origin))
}

/// A frame whose -z points forward.
fn looking(position: DVec3, forward: DVec3) -> DAffine3 {
    let w = -forward.try_normalize().unwrap_or(DVec3::NEG_Z);
    let u = w.any_orthonormal_vector();
    DAffine3::from_mat3_translation(DMat3::from_cols(u, w.cross(u), w), position)
}
