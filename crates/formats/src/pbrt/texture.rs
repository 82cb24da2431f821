//! Textures.
//!
//! pbrt's (0, 0) is the lower left corner of an image, as in the model.

use super::params::Args;
use super::scene::{Importer, MAX_NESTING};
use crate::document::{numbers, transform, typed};
use crate::files::{self, shorten};
use toml::{Table, Value};
use whitstone_core::{DAffine3, DMat3, DVec3};

const CLASSES: [&str; 5] = ["constant", "scale", "mix", "imagemap", "checkerboard"];

/// A texture or a colour, whether it depends on (u, v), and the depth of its nesting.
pub(super) type Pattern = (Value, bool, usize);

impl Importer<'_> {
    /// A named texture.
    pub(super) fn texture(&mut self, name: &str, float: bool, class: &str, mut args: Args) -> Pattern {
        let at = args.at;
        let part = |importer: &mut Self, args: &mut Args, name: &'static str, default: f64| {
            if float {
                importer.texture_or_number(args, name, default)
            } else {
                importer.texture_or_color(args, name, default)
            }
        };
        let (table, uv, depth) = match class {
            "constant" => {
                let value = if float {
                    Value::Float(self.number(&mut args, "value", 1.0))
                } else {
                    crate::document::color(self.color(&mut args, "value", false).unwrap_or([1.0; 3]))
                };
                self.done(args);
                return (value, false, 0);
            }
            "scale" => {
                let (a, a_uv, a_depth) = part(self, &mut args, "tex", 1.0);
                let (b, b_uv, b_depth) = self.texture_or_number(&mut args, "scale", 1.0);
                let factors = Value::Array(vec![a, b]);
                (
                    typed("product", [("factors", factors)]),
                    a_uv || b_uv,
                    a_depth.max(b_depth),
                )
            }
            "mix" => {
                let (a, a_uv, a_depth) = part(self, &mut args, "tex1", 0.0);
                let (b, b_uv, b_depth) = part(self, &mut args, "tex2", 1.0);
                let (weight, w_uv, w_depth) = self.texture_or_number(&mut args, "amount", 0.5);
                let mix = typed("mix", [("a", a), ("b", b), ("weight", weight)]);
                (mix, a_uv || b_uv || w_uv, a_depth.max(b_depth).max(w_depth))
            }
            "checkerboard" => {
                let (a, a_uv, a_depth) = part(self, &mut args, "tex1", 1.0);
                let (b, b_uv, b_depth) = part(self, &mut args, "tex2", 0.0);
                let dimension = self.integer(&mut args, "dimension", 2);
                let constant = |value: &Value| matches!(value, Value::Float(_) | Value::Array(_));
                let plain = constant(&a) && constant(&b);
                let (first, second) = if plain {
                    (a.clone(), b.clone())
                } else {
                    (Value::Float(0.0), Value::Float(1.0))
                };
                let kind = if dimension == 3 { "checker3d" } else { "checker" };
                let mut checker = typed(kind, [("a", first), ("b", second)]);
                let mut uv = false;
                match dimension {
                    2 => uv = self.mapping(&mut args, &mut checker),
                    3 => {
                        let map = self.world_from_texture();
                        self.set_mapping(&mut checker, None, &map.inverse(), at);
                    }
                    _ => self.error(
                        at,
                        format!("a checkerboard has the dimension 2 or 3, not {dimension}"),
                    ),
                }
                if plain {
                    (checker, uv, 0)
                } else {
                    let mix = typed("mix", [("a", a), ("b", b), ("weight", Value::Table(checker))]);
                    (mix, uv || a_uv || b_uv, a_depth.max(b_depth))
                }
            }
            "imagemap" => self.imagemap(&mut args, float),
            _ => {
                self.unknown_plugin("texture", class, &CLASSES, at);
                return (Value::Float(0.5), false, 0);
            }
        };
        self.done(args);
        if depth >= MAX_NESTING {
            self.error(at, format!("textures are nested more than {MAX_NESTING} deep"));
            return (Value::Float(0.5), false, 0);
        }
        (self.share_texture(name, table), uv, depth + 1)
    }

    /// World from the space of the texture: the current transform.
    fn world_from_texture(&mut self) -> DAffine3 {
        self.world_map() * self.state.ctm
    }

    fn imagemap(&mut self, args: &mut Args, float: bool) -> (Table, bool, usize) {
        let at = args.at;
        let mut image = typed("image", []);
        if let Some(named) = self.file(args, "filename") {
            let extension = named.path.extension().unwrap_or_default();
            let extension = extension.to_string_lossy().to_ascii_lowercase();
            if !files::is_image(&named.path) {
                let message = format!("\"{}\" has a format that is not read", shorten(&named.relative));
                let fault = self.fault(at, message);
                self.report(fault.with_help("convert it to EXR or PNG"));
            }
            image.insert("file".to_owned(), Value::String(named.relative));
            let encoding = self.optional_text(args, "encoding");
            let space = match encoding.as_deref() {
                None => None,
                // pbrt reads the others as they are.
                Some(_) if extension != "png" => None,
                Some("sRGB") => None,
                Some("linear") => Some("linear"),
                Some(gamma) if gamma.starts_with("gamma ") => {
                    self.note("encoding gamma", at);
                    None
                }
                Some(other) => {
                    self.error(at, format!("unknown encoding \"{}\"", shorten(other)));
                    None
                }
            };
            if let Some(space) = space {
                image.insert("color_space".to_owned(), Value::String(space.into()));
            }
        }
        if float {
            self.note("float imagemap", at);
        }
        let mut set =
            |key: &str, value: &str| drop(image.insert(key.to_owned(), Value::String(value.to_owned())));
        let filter = self
            .optional_text(args, "filter")
            .unwrap_or("bilinear".to_owned());
        let anisotropy = self.number(args, "maxanisotropy", 8.0);
        match filter.to_ascii_lowercase().as_str() {
            "bilinear" => {}
            "point" => set("filter", "nearest"),
            "trilinear" => set("filter", "trilinear"),
            "ewa" => set("filter", "ewa"),
            _ => {
                let near = ["point", "bilinear", "trilinear", "EWA"];
                self.unknown_plugin("filter", &filter, &near, at);
            }
        }
        if filter.eq_ignore_ascii_case("ewa") {
            let anisotropy = anisotropy.clamp(1.0, 64.0) as i64;
            image.insert("max_anisotropy".to_owned(), Value::Integer(anisotropy));
        }
        let wrap = self.optional_text(args, "wrap").unwrap_or("repeat".to_owned());
        let mut set = |value: &str| drop(image.insert("wrap".to_owned(), Value::String(value.to_owned())));
        match wrap.as_str() {
            "repeat" => {}
            "clamp" => set("clamp"),
            "black" => {
                set("clamp");
                self.note("wrap black", at);
            }
            _ => self.unknown_plugin("wrap mode", &wrap, &["repeat", "clamp", "black"], at),
        }
        let uv = self.mapping(args, &mut image);
        let scale = self.number(args, "scale", 1.0);
        let invert = self.boolean(args, "invert", false);
        if scale > 1.0 {
            self.note("scale above 1", at);
        }
        if scale != 1.0 {
            let factors = Value::Array(vec![Value::Float(scale), Value::Table(image)]);
            image = typed("product", [("factors", factors)]);
        }
        if invert {
            let (one, zero) = (Value::Float(1.0), Value::Float(0.0));
            image = typed("mix", [("a", one), ("b", zero), ("weight", Value::Table(image))]);
        }
        (image, uv, usize::from(scale != 1.0) + usize::from(invert))
    }

    /// Sets `scale`, `offset` and `mapping`; whether the texture depends on (u, v).
    fn mapping(&mut self, args: &mut Args, texture: &mut Table) -> bool {
        let at = args.at;
        let mapping = self.optional_text(args, "mapping").unwrap_or("uv".to_owned());
        match mapping.as_str() {
            "uv" => {
                let mut pair = |names: [&'static str; 2], default: f64| {
                    names.map(|name| self.number(args, name, default))
                };
                let scale = pair(["uscale", "vscale"], 1.0);
                let offset = pair(["udelta", "vdelta"], 0.0);
                if scale != [1.0; 2] {
                    texture.insert("scale".to_owned(), numbers(scale));
                }
                if offset != [0.0; 2] {
                    texture.insert("offset".to_owned(), numbers(offset));
                }
                true
            }
            "planar" => {
                let v1 = self.point(args, "v1", DVec3::X);
                let v2 = self.point(args, "v2", DVec3::Y);
                let offset = ["udelta", "vdelta"].map(|name| self.number(args, name, 0.0));
                let rows = DMat3::from_cols(v1, v2, v1.cross(v2)).transpose();
                let offset = DVec3::new(offset[0], offset[1], 0.0);
                let map = DAffine3::from_mat3_translation(rows, offset) * self.world_from_texture().inverse();
                self.set_mapping(texture, Some("planar"), &map, at);
                false
            }
            "cylindrical" => {
                // pbrt's u is 0 at -x.
                let turn = DAffine3::from_scale(DVec3::new(-1.0, -1.0, 1.0));
                let map = turn * self.world_from_texture().inverse();
                self.set_mapping(texture, Some("cylindrical"), &map, at);
                false
            }
            _ => {
                self.unknown_plugin("mapping", &mapping, &["uv", "planar", "cylindrical"], at);
                true
            }
        }
    }

    fn set_mapping(
        &mut self,
        texture: &mut Table,
        projection: Option<&str>,
        map: &DAffine3,
        at: super::token::At,
    ) {
        if !self.can_invert(map) {
            return self.error(at, "the transform of a texture cannot be inverted");
        }
        let mut mapping = Table::new();
        if let Some(projection) = projection {
            mapping.insert("projection".to_owned(), Value::String(projection.into()));
        }
        if *map != DAffine3::IDENTITY {
            mapping.insert("transform".to_owned(), transform(map));
        }
        if !mapping.is_empty() {
            texture.insert("mapping".to_owned(), Value::Table(mapping));
        }
    }
}
