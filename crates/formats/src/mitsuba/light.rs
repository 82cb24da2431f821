//! Emitters, except `area`, which belongs to a shape.

use super::material::Look;
use super::translate::{Fields, Translator};
use super::xml::Data;
use crate::document::{color, numbers, transform, typed};
use crate::image_size::image_size;
use std::f64::consts::PI;
use toml::{Table, Value};
use whitstone_core::{DAffine3, DMat3, DVec3};

/// `samples` of an environment: it lights from twice the square of this number of directions.
const ENVIRONMENT_SAMPLES: i64 = 4;

impl<'a> Translator<'a> {
    /// Adds the lights of an emitter of the scene.
    pub(super) fn emitter(&mut self, index: usize) {
        let mut fields = self.fields(index);
        let at = fields.at();
        // How often it is chosen: here each light counts at each point.
        fields.take("sampling_weight");
        let light = match fields.object.plugin.as_str() {
            "point" => self.point(&mut fields),
            "directional" => self.directional(&mut fields),
            "spot" => self.spot(&mut fields),
            "projector" => self.projector(&mut fields),
            "constant" => {
                self.note("emitter constant", at);
                let radiance = self.color(&mut fields, "radiance", [1.0; 3]);
                environment(color(radiance))
            }
            "envmap" => self.envmap(&mut fields),
            _ => return self.unknown(index),
        };
        self.finish(fields);
        self.document.lights.push(light);
    }

    /// The transform of an emitter in the world.
    fn emitter_to_world(&mut self, fields: &mut Fields<'a>) -> DAffine3 {
        self.options.transform * self.transform(fields, "to_world")
    }

    fn point(&mut self, fields: &mut Fields<'a>) -> Table {
        let intensity = self.color(fields, "intensity", [1.0; 3]);
        let position = match self.vector(fields, "position") {
            Some(position) => self.options.transform.transform_point3(position),
            None => self.emitter_to_world(fields).translation,
        };
        typed(
            "point",
            [
                ("position", numbers(position.to_array())),
                ("intensity", color(intensity)),
            ],
        )
    }

    fn directional(&mut self, fields: &mut Fields<'a>) -> Table {
        let irradiance = self.color(fields, "irradiance", [1.0; 3]);
        let direction = match self.vector(fields, "direction") {
            Some(direction) => self.options.transform.transform_vector3(direction),
            None => self.emitter_to_world(fields).matrix3.z_axis,
        };
        typed(
            "directional",
            [
                ("direction", numbers(direction.to_array())),
                ("irradiance", color(irradiance)),
            ],
        )
    }

    fn spot(&mut self, fields: &mut Fields<'a>) -> Table {
        let intensity = self.color(fields, "intensity", [1.0; 3]);
        let world = self.emitter_to_world(fields);
        let image = fields
            .object
            .entries
            .iter()
            .any(|entry| entry.name == "texture")
            .then(|| self.spot_image(fields, &world));
        let cutoff = self.number(fields, "cutoff_angle", 20.0);
        let beam = self.number(fields, "beam_width", 0.75 * cutoff);
        let mut light = typed(
            "spot",
            [
                ("position", numbers(world.translation.to_array())),
                (
                    "target",
                    numbers((world.translation + world.matrix3.z_axis).to_array()),
                ),
                ("intensity", color(intensity)),
                ("cutoff_angle", Value::Float(cutoff)),
                // A border without a width is not allowed.
                ("beam_width", Value::Float(beam.min(cutoff * (1.0 - 1e-9)))),
            ],
        );
        light.extend(image.into_iter().flatten());
        light
    }

    /// `image` and `up` of a spot light. Mitsuba's u grows along the x axis of `to_world`, its v
    /// along the y axis.
    fn spot_image(&mut self, fields: &mut Fields<'a>, world: &DAffine3) -> [(String, Value); 2] {
        let [x, y, forward] = [world.matrix3.x_axis, world.matrix3.y_axis, world.matrix3.z_axis];
        // With this vector upwards the model's u grows along x, and its v along -y, or along y if
        // the transform mirrors.
        let up = x.cross(forward);
        let look = Look {
            flip_v: up.dot(y) < 0.0,
            ..Look::default()
        };
        let image = self.texture_or_color(fields, "texture", [1.0; 3], &look);
        [
            ("image".to_owned(), image),
            ("up".to_owned(), numbers(up.to_array())),
        ]
    }

    fn projector(&mut self, fields: &mut Fields<'a>) -> Table {
        let scale = self.number(fields, "scale", 1.0);
        let aspect = self
            .resolution(fields, "irradiance")
            .map_or(1.0, |(width, height)| width / height);
        // Mitsuba's v of a projector points down, and that of its bitmaps, too.
        let look = Look {
            flip_v: true,
            ..Look::default()
        };
        let image = self.texture_or_color(fields, "irradiance", [1.0; 3], &look);
        let fov = self.fov(fields, aspect);
        let world = self.emitter_to_world(fields);
        typed(
            "projector",
            [
                ("position", numbers(world.translation.to_array())),
                (
                    "target",
                    numbers((world.translation + world.matrix3.z_axis).to_array()),
                ),
                ("up", numbers(world.matrix3.y_axis.to_array())),
                ("fov", Value::Float(fov)),
                ("aspect", Value::Float(aspect)),
                ("image", image),
                ("intensity", Value::Float(PI * scale)),
            ],
        )
    }

    /// Width and height of the bitmap that a parameter is.
    fn resolution(&mut self, fields: &Fields<'a>, name: &str) -> Option<(f64, f64)> {
        let entry = fields.object.entries.iter().find(|entry| entry.name == name)?;
        let Data::Object(index) = entry.value else {
            return None;
        };
        let texture = &self.scene.objects[index];
        let file = texture.entries.iter().find(|entry| entry.name == "filename")?;
        let Data::Text(name) = &file.value else {
            return None;
        };
        let named = self.scene.find(self.folder, name).ok()?;
        let (width, height) = image_size(&named.path)?;
        Some((f64::from(width), f64::from(height)))
    }

    fn envmap(&mut self, fields: &mut Fields<'a>) -> Table {
        let at = fields.at();
        self.note("emitter envmap", at);
        fields.take("mis_compensation");
        let scale = self.number(fields, "scale", 1.0);
        let world = self.emitter_to_world(fields);
        let Some(named) = self.file(fields, "filename") else {
            return environment(Value::Float(0.0));
        };
        self.check_image(&named, at);
        let mut image = typed(
            "image",
            [
                ("file", Value::String(named.relative)),
                (
                    "wrap",
                    Value::Array(vec![
                        Value::String("repeat".into()),
                        Value::String("clamp".into()),
                    ]),
                ),
            ],
        );
        // Mitsuba puts the first and last row at the poles.
        let rows = match image_size(&named.path) {
            Some((_, height)) => Some(f64::from(height)),
            None => {
                self.note("envmap of unknown size", at);
                None
            }
        };
        let (scale_v, offset_v) = rows.map_or((1.0, 0.0), |rows| ((rows - 1.0) / rows, 0.5 / rows));
        let mut offset_u = 0.0;
        let rotation = world.matrix3;
        if rotation == DMat3::IDENTITY {
            // Mitsuba has -z at the borders of the image.
            offset_u = 0.5;
        } else {
            // In the map's space, -z is at the angle 0, +x at 90 degrees, and +y is the pole.
            let axes = DMat3::from_cols(
                DVec3::new(0.0, 1.0, 0.0),
                DVec3::new(0.0, 0.0, 1.0),
                DVec3::new(-1.0, 0.0, 0.0),
            );
            let map = DAffine3::from_mat3(axes * rotation.inverse());
            let mut mapping = Table::new();
            mapping.insert("projection".to_owned(), Value::String("spherical".into()));
            mapping.insert("transform".to_owned(), transform(&map));
            image.insert("mapping".to_owned(), Value::Table(mapping));
        }
        image.insert("scale".to_owned(), numbers([1.0, scale_v]));
        image.insert("offset".to_owned(), numbers([offset_u, offset_v]));
        let mut radiance = Value::Table(image);
        if scale != 1.0 {
            let factors = Value::Array(vec![Value::Float(scale), radiance]);
            radiance = Value::Table(typed("product", [("factors", factors)]));
        }
        environment(radiance)
    }
}

fn environment(radiance: Value) -> Table {
    typed(
        "environment",
        [
            ("radiance", radiance),
            ("samples", Value::Integer(ENVIRONMENT_SAMPLES)),
        ],
    )
}
