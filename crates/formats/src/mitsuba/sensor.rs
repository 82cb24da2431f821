//! Sensors and films.
//!
//! Mitsuba's cameras look along +z of their space, with +x to the left and +y up.

use super::translate::{Fields, Translator};
use crate::document::{numbers, table, typed};
use crate::files::shorten;
use toml::{Table, Value};
use whitstone_core::{DAffine3, DVec3};

/// Mitsuba's default for `near_clip`, in metres.
const NEAR: f64 = 1e-2;

/// A film: its full size, and the part of it that is rendered, in pixels.
#[derive(Clone, Copy)]
struct Film {
    size: [f64; 2],
    crop: [f64; 2],
    offset: [f64; 2],
}

impl Film {
    fn aspect(&self) -> f64 {
        self.size[0] / self.size[1]
    }

    fn is_cropped(&self) -> bool {
        self.crop != self.size || self.offset != [0.0; 2]
    }

    /// The rendered part of the window l, r, b, t of the full film.
    fn cut(&self, [l, r, b, t]: [f64; 4]) -> [f64; 4] {
        let x = |pixel: f64| l + (r - l) * pixel / self.size[0];
        let y = |pixel: f64| t - (t - b) * pixel / self.size[1];
        [
            x(self.offset[0]),
            x(self.offset[0] + self.crop[0]),
            y(self.offset[1] + self.crop[1]),
            y(self.offset[1]),
        ]
    }
}

impl<'a> Translator<'a> {
    /// Adds the camera, the film and the sampler of a sensor.
    pub(super) fn sensor(&mut self, index: usize) {
        let mut fields = self.fields(index);
        let plugin = fields.object.plugin.as_str();
        let at = fields.at();
        if !["perspective", "orthographic", "thinlens"].contains(&plugin) {
            return self.unknown(index);
        }
        let mut film = Film {
            size: [768.0, 576.0],
            crop: [768.0, 576.0],
            offset: [0.0; 2],
        };
        let mut sampler = None;
        let (mut has_film, mut has_sampler) = (false, false);
        for (_, child) in self.children(&mut fields, &["film", "sampler"]) {
            if self.scene.objects[child].family == "film" {
                has_film = true;
                film = self.film(child);
            } else {
                has_sampler = true;
                sampler = self.sampler(child);
            }
        }
        if !has_film {
            // The default film has a Gaussian filter.
            self.note("rfilter", at);
        }
        if fields.has("srf") {
            fields.take("srf");
            self.note("srf", at);
        }
        for name in ["shutter_open", "shutter_close"] {
            if self
                .optional_number(&mut fields, name)
                .is_some_and(|time| time != 0.0)
            {
                self.note("shutter_open, shutter_close", at);
            }
        }
        if fields.take("far_clip").is_some() {
            self.note("far_clip", at);
        }
        let near_is_given = fields.has("near_clip");
        let near = self.number(&mut fields, "near_clip", NEAR);
        let world = self.options.transform * self.transform(&mut fields, "to_world");
        if world.matrix3.determinant() < 0.0 {
            self.note("to_world of a sensor that mirrors", at);
        }
        let mut camera = match plugin {
            "orthographic" => orthographic(&film, &world),
            _ => self.perspective(&mut fields, &film),
        };
        let mut set = |key: &str, value: Value| camera.insert(key.to_owned(), value);
        let look_at = table([
            ("origin", numbers(world.translation.to_array())),
            (
                "target",
                numbers((world.translation + world.matrix3.z_axis).to_array()),
            ),
            ("up", numbers(world.matrix3.y_axis.to_array())),
        ]);
        set("look_at", Value::Table(look_at));
        match plugin {
            "thinlens" => {
                set("type", Value::String("thin_lens".into()));
                set("aperture", Value::Float(0.0));
                set("focus_distance", Value::Float(1.0));
                if near_is_given {
                    self.note("near_clip of a lens", at);
                }
                match self.optional_number(&mut fields, "aperture_radius") {
                    Some(radius) => drop(camera.insert("aperture".to_owned(), Value::Float(radius))),
                    None => self.error(at, "the sensor \"thinlens\" needs \"aperture_radius\""),
                }
                let distance = self.optional_number(&mut fields, "focus_distance");
                // The default is Mitsuba's default of far_clip.
                let distance = distance.unwrap_or(1e4);
                camera.insert("focus_distance".to_owned(), Value::Float(distance));
            }
            _ => {
                set("near", Value::Float(near));
                // All of Mitsuba's cameras have it; only a lens uses it.
                fields.take("focus_distance");
            }
        }
        self.finish(fields);
        let [width, height] = film.crop.map(|pixels| Value::Integer(pixels as i64));
        let film = table([("width", width), ("height", height)]);
        self.document.single.push(("film", film));
        self.document.single.push(("camera", camera));
        if !has_sampler {
            // Mitsuba's default has four samples.
            self.note("sampler", at);
            sampler = Some(typed("sobol", [("samples", Value::Integer(4))]));
        }
        if let Some(sampler) = sampler {
            self.document.single.push(("sampler", sampler));
        }
    }

    fn film(&mut self, index: usize) -> Film {
        let mut fields = self.fields(index);
        let at = fields.at();
        if fields.object.plugin != "hdrfilm" {
            self.unknown(index);
        }
        let ignored = [
            "file_format",
            "pixel_format",
            "component_format",
            "sample_border",
            "compensate",
            "banner",
            "attach_log",
        ];
        for name in ignored {
            fields.take(name);
        }
        let filters = self.children(&mut fields, &["rfilter"]);
        if !filters
            .iter()
            .any(|(_, filter)| self.scene.objects[*filter].plugin == "box")
        {
            self.note("rfilter", filters.first().map_or(at, |(entry, _)| entry.at));
        }
        let mut pixels = |name: &str, default: f64, least: f64| {
            let value = self.integer(&mut fields, name, default as i64) as f64;
            if (least..=65536.0).contains(&value) {
                return value;
            }
            self.error(at, format!("expected {least} to 65536 pixels as \"{name}\""));
            default
        };
        let size = [pixels("width", 768.0, 1.0), pixels("height", 576.0, 1.0)];
        let crop = [
            pixels("crop_width", size[0], 1.0),
            pixels("crop_height", size[1], 1.0),
        ];
        let offset = [
            pixels("crop_offset_x", 0.0, 0.0),
            pixels("crop_offset_y", 0.0, 0.0),
        ];
        self.finish(fields);
        Film { size, crop, offset }
    }

    fn perspective(&mut self, fields: &mut Fields<'a>, film: &Film) -> Table {
        let [x, y] = ["principal_point_offset_x", "principal_point_offset_y"]
            .map(|name| self.number(fields, name, 0.0));
        let simple = !film.is_cropped() && x == 0.0 && y == 0.0;
        let axis = fields
            .object
            .entries
            .iter()
            .find(|entry| entry.name == "fov_axis")
            .map(|entry| &entry.value);
        let plain_axis = match axis {
            None => Some("x"),
            Some(super::xml::Data::Text(text)) => ["x", "y", "smaller", "larger"]
                .into_iter()
                .find(|name| *name == text),
            Some(_) => None,
        };
        let written = fields
            .object
            .entries
            .iter()
            .find(|entry| entry.name == "fov")
            .map(|entry| &entry.value);
        let written = match written {
            Some(super::xml::Data::Float(fov)) => Some(*fov),
            Some(super::xml::Data::Integer(fov)) => Some(*fov as f64),
            _ => None,
        };
        let fov_x = self.fov(fields, film.aspect());
        if simple && let (Some(axis), Some(fov)) = (plain_axis, written) {
            let mut camera = typed("perspective", [("fov", Value::Float(fov))]);
            if axis != "x" {
                camera.insert("fov_axis".to_owned(), Value::String(axis.into()));
            }
            return camera;
        }
        let half_x = libm::tan((fov_x / 2.0).to_radians());
        let half_y = half_x / film.aspect();
        // The offset is a part of the film's size, to the left and up as the image moves.
        let (move_x, move_y) = (x * 2.0 * half_x, -y * 2.0 * half_y);
        let window = film.cut([move_x - half_x, move_x + half_x, move_y - half_y, move_y + half_y]);
        typed("perspective", [("window", window_table(window))])
    }

    /// The field of view along x in degrees, from `fov` and `fov_axis` or from `focal_length`;
    /// `aspect` is width divided by height.
    pub(super) fn fov(&mut self, fields: &mut Fields<'a>, aspect: f64) -> f64 {
        let at = fields.at();
        let axis = self.text(fields, "fov_axis").unwrap_or("x").to_ascii_lowercase();
        let (fov, axis) = match self.optional_number(fields, "fov") {
            Some(fov) => {
                if fields.take("focal_length").is_some() {
                    self.error(at, "expected either \"fov\" or \"focal_length\", found both");
                }
                (fov, axis)
            }
            None => {
                let text = self.text(fields, "focal_length").unwrap_or("50mm");
                let number = text.trim().trim_end_matches("mm").trim().parse::<f64>();
                let length = number.ok().filter(|length| *length > 0.0 && length.is_finite());
                let length = length.unwrap_or_else(|| {
                    self.error(
                        at,
                        format!("expected a length such as \"50mm\", found \"{}\"", shorten(text)),
                    );
                    50.0
                });
                // The diagonal of a film of 36 x 24 mm.
                let half = libm::atan(libm::hypot(36.0_f64, 24.0) / (2.0 * length));
                (2.0 * half.to_degrees(), "diagonal".to_owned())
            }
        };
        if !(fov > 0.0 && fov < 180.0) {
            self.error(
                at,
                format!("expected a field of view between 0 and 180 degrees, found {fov}"),
            );
            return 45.0;
        }
        let half = libm::tan((fov / 2.0).to_radians());
        let half_x = match axis.as_str() {
            "x" => return fov,
            "y" => half * aspect,
            "smaller" => {
                if aspect > 1.0 {
                    half * aspect
                } else {
                    return fov;
                }
            }
            "larger" => {
                if aspect > 1.0 {
                    return fov;
                } else {
                    half * aspect
                }
            }
            "diagonal" => half / (1.0 + 1.0 / (aspect * aspect)).sqrt(),
            _ => {
                let expected =
                    "expected \"x\", \"y\", \"diagonal\", \"smaller\" or \"larger\" as \"fov_axis\"";
                self.error(at, format!("{expected}, found \"{}\"", shorten(&axis)));
                return fov;
            }
        };
        2.0 * libm::atan(half_x).to_degrees()
    }
}

/// An orthographic camera without its position. Mitsuba's sees [-1, 1] along x before the
/// transform.
fn orthographic(film: &Film, world: &DAffine3) -> Table {
    let half = |axis: DVec3| axis.length();
    let half_x = half(world.matrix3.x_axis);
    let half_y = half(world.matrix3.y_axis) / film.aspect();
    let square = (half_x - half_y * film.aspect()).abs() <= 1e-12 * half_x;
    if square && !film.is_cropped() {
        return typed("orthographic", [("width", Value::Float(2.0 * half_x))]);
    }
    let window = film.cut([-half_x, half_x, -half_y, half_y]);
    typed("orthographic", [("window", window_table(window))])
}

fn window_table([l, r, b, t]: [f64; 4]) -> Value {
    Value::Table(table([
        ("l", Value::Float(l)),
        ("r", Value::Float(r)),
        ("b", Value::Float(b)),
        ("t", Value::Float(t)),
    ]))
}
