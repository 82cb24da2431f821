//! Textures.

use super::material::Sides;
use super::node::{Item, Node};
use super::{Exporter, table};
use crate::mitsuba::texture::FLIP;
use std::collections::HashSet;
use toml::{Table, Value};
use whitstone_core::{DAffine3, DVec3};

impl<'a> Exporter<'a> {
    /// A texture or colour; one without a counterpart becomes a colour, with a note.
    pub(super) fn texture(&mut self, value: &'a Value, sides: Sides, name: &str) -> Item {
        if let Some(color) = table::as_color(value) {
            return Item::Color(color);
        }
        let Some(texture) = self.plugin("texture", value) else {
            return Item::Color([0.5; 3]);
        };
        let place = match value {
            Value::String(id) => id.as_str(),
            _ => name,
        };
        let kind = table::kind(texture);
        match kind {
            "constant" => Item::Color(table::color(texture, "value", [0.5; 3])),
            "image" if text_or(texture, "channel", "color") != "color" => {
                self.mean(texture, "[texture] image with a channel", place)
            }
            "image" if !is_bitmap(text_or(texture, "file", "")) => {
                self.mean(texture, "[texture] image of another format", place)
            }
            "checker" | "image" => match uv(texture) {
                Some(map) => Item::Node(self.by_uv(texture, kind, &map, sides, place)),
                None => self.mean(texture, "[texture] mapping", place),
            },
            _ => self.mean(texture, "[texture] of another type", place),
        }
    }

    /// Whether a value is an image that is mapped by (u, v), which Mitsuba can derive.
    pub(super) fn is_uv_image(&self, value: Option<&'a Value>) -> bool {
        let texture = value.and_then(|value| self.plugin("texture", value));
        texture.is_some_and(|texture| {
            table::kind(texture) == "image"
                && text_or(texture, "channel", "color") == "color"
                && is_bitmap(text_or(texture, "file", ""))
                && uv(texture).is_some()
        })
    }

    /// The mean of the colours a and b, or grey.
    fn mean(&mut self, texture: &Table, feature: &str, place: &str) -> Item {
        self.note(feature, place);
        let (a, b) = (
            table::color(texture, "a", [0.8; 3]),
            table::color(texture, "b", [0.2; 3]),
        );
        Item::Color([0, 1, 2].map(|channel| (a[channel] + b[channel]) / 2.0))
    }

    fn by_uv(&mut self, texture: &'a Table, kind: &str, map: &DAffine3, sides: Sides, place: &str) -> Node {
        let scale = table::pair(texture, "scale", 1.0);
        let offset = table::pair(texture, "offset", 0.0);
        let by = DAffine3::from_translation(DVec3::new(offset[0], offset[1], 0.0))
            * DAffine3::from_scale(DVec3::new(scale[0], scale[1], 1.0));
        // From Mitsuba's (u, v) to the model's, and then to the texture.
        let shape = if sides.flip_v { FLIP } else { DAffine3::IDENTITY };
        let map = by * *map * shape;
        if kind == "checker" {
            // Mitsuba's cells are half a unit wide.
            let half = DAffine3::from_scale(DVec3::new(0.5, 0.5, 1.0));
            return Node::new("texture", "checkerboard")
                .with("color0", Item::Color(table::color(texture, "a", [0.8; 3])))
                .with("color1", Item::Color(table::color(texture, "b", [0.2; 3])))
                .with("to_uv", Item::Transform(half * map));
        }
        let file = table::text(texture, "file").unwrap_or_default();
        let is_exr = file.to_lowercase().ends_with(".exr");
        let raw = match text_or(texture, "color_space", "auto") {
            "linear" => !is_exr,
            "srgb" if is_exr => {
                self.note("[texture] color_space", place);
                false
            }
            _ => false,
        };
        let filter = match text_or(texture, "filter", "bilinear") {
            "nearest" => "nearest",
            "bilinear" => "bilinear",
            _ => {
                self.note("[texture] filter", place);
                "bilinear"
            }
        };
        let wrap = match texture.get("wrap") {
            Some(Value::String(word)) => word.as_str(),
            Some(Value::Array(words)) => {
                let word = |place: usize| words.get(place).and_then(Value::as_str).unwrap_or("repeat");
                if word(0) != word(1) {
                    self.note("[texture] wrap", place);
                }
                word(0)
            }
            _ => "repeat",
        };
        let mut node = Node::new("texture", "bitmap")
            .with("filename", Item::Text(self.file(file)))
            .with("filter_type", Item::Text(filter.into()))
            .with("wrap_mode", Item::Text(wrap.into()))
            // Mitsuba's v points down.
            .with("to_uv", Item::Transform(FLIP * map));
        if raw {
            node.push("raw", Item::Boolean(true));
        }
        node
    }

    /// Whether a material depends on the texture coordinates of its shape.
    pub(super) fn lies_by_uv(&self, material: &'a Value) -> bool {
        let mut seen = HashSet::new();
        let mut pending = vec![material];
        while let Some(value) = pending.pop() {
            // A name is that of a material or of a texture.
            for family in ["material", "texture"] {
                if let Value::String(id) = value
                    && !seen.insert((family, id))
                {
                    continue;
                }
                let Some(table) = self.plugin(family, value) else {
                    continue;
                };
                if matches!(table::kind(table), "image" | "checker" | "normal_map") {
                    return true;
                }
                let inner = table
                    .iter()
                    .filter(|(key, _)| !["type", "file", "metal"].contains(&key.as_str()));
                pending.extend(inner.map(|(_, inner)| inner));
            }
        }
        false
    }
}

/// Whether Mitsuba reads an image file of this name: not those of glTF, nor WebP.
pub(super) fn is_bitmap(file: &str) -> bool {
    let extension = file.rsplit('.').next().unwrap_or_default().to_lowercase();
    !["gltf", "glb", "webp"].contains(&extension.as_str())
}

fn text_or<'t>(table: &'t Table, key: &str, default: &'static str) -> &'t str {
    table::text(table, key).unwrap_or(default)
}

/// The map of a texture by (u, v), in the plane; none if it is mapped by something else.
fn uv(texture: &Table) -> Option<DAffine3> {
    let Some(mapping) = table::table(texture, "mapping") else {
        return Some(DAffine3::IDENTITY);
    };
    let map = table::transform(mapping);
    let flat = map.matrix3.x_axis.z == 0.0 && map.matrix3.y_axis.z == 0.0;
    let by_uv = matches!(table::text(mapping, "projection"), None | Some("uv"));
    (by_uv && flat && !mapping.contains_key("uv_set")).then_some(map)
}
