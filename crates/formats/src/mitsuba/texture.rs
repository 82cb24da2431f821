//! Textures.
//!
//! Mitsuba's rows of an image are counted from the top: v = 0 is the top row.

use super::material::Look;
use super::translate::{Fields, Translator};
use super::xml::{At, Data};
use crate::document::{color, numbers, table, transform, typed};
use crate::files::{self, Named, shorten};
use crate::table::as_color;
use toml::{Table, Value};
use whitstone_core::{DAffine3, DMat3, DVec3};

impl<'a> Translator<'a> {
    /// A parameter that is a colour or a texture.
    pub(super) fn texture_or_color(
        &mut self,
        fields: &mut Fields<'a>,
        name: &str,
        default: [f64; 3],
        look: &Look,
    ) -> Value {
        let Some(entry) = fields.take(name) else {
            return color(default);
        };
        match entry.value {
            Data::Color(value) => color(value),
            Data::Float(value) => Value::Float(value),
            Data::Integer(value) => Value::Float(value as f64),
            Data::Object(index) if self.scene.objects[index].family == "texture" => self.texture(index, look),
            _ => {
                self.wrong(entry, "a colour or a texture");
                color(default)
            }
        }
    }

    /// A share, `opacity` or `weight`: Mitsuba evaluates textures to one number there.
    pub(super) fn share(&mut self, fields: &mut Fields<'a>, name: &str, look: &Look) -> Value {
        let child = fields.object.entries.iter().rfind(|entry| entry.name == name);
        if let Some(Data::Object(index)) = child.map(|entry| &entry.value) {
            match self.scene.objects[*index].plugin.as_str() {
                "checkerboard" => {
                    fields.take(name);
                    return Value::Table(self.checkerboard(*index, look, true));
                }
                "bitmap" => self.note("opacity or weight by a bitmap", fields.at()),
                _ => {}
            }
        }
        mean(self.texture_or_color(fields, name, [0.5; 3], look))
    }

    /// A texture, for surfaces with this look.
    pub(super) fn texture(&mut self, index: usize, look: &Look) -> Value {
        if let Some(value) = self.constant_texture(index) {
            return color(value);
        }
        let key = format!("texture {index} {}", look.flip_v);
        if let Some(known) = self.memo.get(&key) {
            return known.clone();
        }
        if !self.enter(index) {
            return Value::Float(0.5);
        }
        let object = &self.scene.objects[index];
        let translated = match object.plugin.as_str() {
            "bitmap" => self.bitmap(index, look),
            "checkerboard" => Some(self.checkerboard(index, look, false)),
            _ => {
                self.unknown(index);
                None
            }
        };
        self.leave();
        let value = match (translated, &object.id) {
            (None, _) => Value::Float(0.5),
            (Some(table), None) => Value::Table(table),
            (Some(table), Some(id)) => self.share_texture(id, table),
        };
        self.memo.insert(key, value.clone());
        value
    }

    /// The colour of a texture that is the same everywhere.
    pub(super) fn constant_texture(&mut self, index: usize) -> Option<[f64; 3]> {
        let name = match self.scene.objects[index].plugin.as_str() {
            "uniform" | "rawconstant" => "value",
            "srgb" => "color",
            "d65" => {
                let mut fields = self.fields(index);
                let value = self.color(&mut fields, "color", [1.0; 3]);
                let scale = self.number(&mut fields, "scale", 1.0);
                self.finish(fields);
                return Some(value.map(|value| value * scale));
            }
            _ => return None,
        };
        let mut fields = self.fields(index);
        fields.take("unbounded");
        let value = match fields
            .object
            .entries
            .iter()
            .find(|entry| entry.name == name)
            .map(|entry| &entry.value)
        {
            Some(Data::Vector(value)) => {
                fields.take(name);
                value.to_array()
            }
            _ => self.color(&mut fields, name, [1.0; 3]),
        };
        self.finish(fields);
        Some(value)
    }

    /// Reports an image file of another format.
    pub(super) fn check_image(&mut self, named: &Named, at: At) {
        if !files::is_image(&named.path) {
            let name = shorten(&named.relative);
            self.error(
                at,
                format!("\"{name}\" has a format that is not read; convert it to EXR or PNG"),
            );
        }
    }

    fn bitmap(&mut self, index: usize, look: &Look) -> Option<Table> {
        let mut fields = self.fields(index);
        let at = fields.at();
        for ignored in ["format", "accel", "max_anisotropy", "gamma"] {
            fields.take(ignored);
        }
        let named = self.file(&mut fields, "filename");
        let raw = self.boolean(&mut fields, "raw", false);
        let filter = self.text(&mut fields, "filter_type").unwrap_or("bilinear");
        let wrap = self.text(&mut fields, "wrap_mode").unwrap_or("repeat");
        let uv = self.uv_transform(&mut fields);
        self.finish(fields);
        let named = named?;
        self.check_image(&named, at);
        let mut image = typed("image", [("file", Value::String(named.relative))]);
        let mut set = |key: &str, value: &str| image.insert(key.to_owned(), Value::String(value.to_owned()));
        if raw {
            set("color_space", "linear");
        }
        match filter {
            "bilinear" | "trilinear" | "ewa" => {}
            "nearest" => drop(set("filter", "nearest")),
            _ => self.error(at, format!("unknown filter_type \"{}\"", shorten(filter))),
        }
        match wrap {
            "repeat" => {}
            "clamp" | "mirror" => drop(set("wrap", wrap)),
            _ => self.error(at, format!("unknown wrap_mode \"{}\"", shorten(wrap))),
        }
        place(&mut image, &(FLIP * uv * look.uv()), 1.0);
        Some(image)
    }

    /// `share`: whether it is evaluated to one number, for which Mitsuba exchanges the colours (the
    /// functions `eval` and `eval_1` of its checkerboard.cpp).
    fn checkerboard(&mut self, index: usize, look: &Look, share: bool) -> Table {
        let mut fields = self.fields(index);
        let uv = self.uv_transform(&mut fields);
        let mut a = self.texture_or_color(&mut fields, "color0", [0.4; 3], look);
        let mut b = self.texture_or_color(&mut fields, "color1", [0.2; 3], look);
        self.finish(fields);
        if share {
            (a, b) = (mean(b), mean(a));
        }
        let constant = |value: &Value| matches!(value, Value::Float(_) | Value::Array(_));
        let mut checker = if constant(&a) && constant(&b) {
            typed("checker", [("a", a), ("b", b)])
        } else {
            let mut weight = typed("checker", [("a", Value::Float(0.0)), ("b", Value::Float(1.0))]);
            place(&mut weight, &(uv * look.uv()), 2.0);
            return typed("mix", [("a", a), ("b", b), ("weight", Value::Table(weight))]);
        };
        // Mitsuba's cells are half a unit wide.
        place(&mut checker, &(uv * look.uv()), 2.0);
        checker
    }

    /// `to_uv` as a map of (u, v, 0).
    fn uv_transform(&mut self, fields: &mut Fields<'a>) -> DAffine3 {
        let map = self.transform(fields, "to_uv");
        // Of Mitsuba 0.x.
        let mut old = |name: &str, default: f64| self.number(fields, name, default);
        let scale = DVec3::new(old("uscale", 1.0), old("vscale", 1.0), 1.0);
        let offset = DVec3::new(old("uoffset", 0.0), old("voffset", 0.0), 0.0);
        let map = DAffine3::from_scale(scale) * DAffine3::from_translation(offset) * map;
        let [x, y] = [map.matrix3.x_axis, map.matrix3.y_axis].map(|axis| DVec3::new(axis.x, axis.y, 0.0));
        let matrix = DMat3::from_cols(x, y, DVec3::Z);
        let moved = DVec3::new(map.translation.x, map.translation.y, 0.0);
        if matrix.determinant() == 0.0 {
            self.error(fields.at(), "\"to_uv\" cannot be inverted");
            return DAffine3::IDENTITY;
        }
        DAffine3::from_mat3_translation(matrix, moved)
    }
}

/// The mean of the channels of a colour; a texture stays.
fn mean(value: Value) -> Value {
    match as_color(&value) {
        Some([r, g, b]) if r != g || g != b => Value::Float((r + g + b) / 3.0),
        _ => value,
    }
}

/// v becomes 1 - v.
pub(super) const FLIP: DAffine3 = DAffine3 {
    matrix3: DMat3::from_cols(DVec3::X, DVec3::new(0.0, -1.0, 0.0), DVec3::Z),
    translation: DVec3::new(0.0, 1.0, 0.0),
};

/// Sets `scale` and `offset`, or `mapping`, for texture coordinates that are mapped and then
/// multiplied by `times`.
fn place(texture: &mut Table, map: &DAffine3, times: f64) {
    let [x, y] = [map.matrix3.x_axis, map.matrix3.y_axis];
    let (mut scale, mut offset) = ([times; 2], [0.0; 2]);
    if x.y == 0.0 && y.x == 0.0 {
        scale = [times * x.x, times * y.y];
        offset = [times * map.translation.x, times * map.translation.y];
    } else {
        let mapping = table([("transform", transform(map))]);
        texture.insert("mapping".to_owned(), Value::Table(mapping));
    }
    if scale != [1.0; 2] {
        texture.insert("scale".to_owned(), numbers(scale));
    }
    if offset != [0.0; 2] {
        texture.insert("offset".to_owned(), numbers(offset));
    }
}
