//! BSDFs.

use super::texture::FLIP;
use super::translate::{Fields, Translator};
use super::xml::Data;
use crate::coat;
use crate::combine::{self, Nearest};
use crate::document::{color, typed};
use crate::files::shorten;
use crate::table::as_color;
use std::collections::HashSet;
use std::f64::consts::PI;
use toml::{Table, Value};
use whitstone_core::DAffine3;

/// What a material needs to know of the shape that has it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Look {
    /// Whether Mitsuba's v is 1 - v here.
    pub(super) flip_v: bool,
    /// Whether Mitsuba's normal points to the other side.
    pub(super) flip: bool,
    /// Whether the material is inside a `twosided`, and so not black from behind.
    pub(super) bare: bool,
    /// Whether a `twosided` shows it from behind: it mirrors directions at the surface, so that the
    /// normals of maps lean as they do in front.
    pub(super) behind: bool,
    /// The key that gives the direction of increasing u: `tangent` or `axis`.
    pub(super) tangent: Option<(&'static str, Value)>,
}

impl Look {
    /// From (u, v) to Mitsuba's.
    pub(super) fn uv(&self) -> DAffine3 {
        if self.flip_v { FLIP } else { DAffine3::IDENTITY }
    }
}

/// Plugins whose normals lean by a map.
const LEANING: &[&str] = &["normalmap", "bumpmap"];

/// The step of a bump map in (u, v). Mitsuba derives between the texels; a much smaller step would
/// lose digits of single-precision heights.
const BUMP_STEP: f64 = 1e-4;

/// Names of indices of refraction (Mitsuba's `ior.h`).
const IORS: [(&str, f64); 23] = [
    ("vacuum", 1.0),
    ("helium", 1.000036),
    ("hydrogen", 1.000132),
    ("air", 1.000277),
    ("carbon dioxide", 1.00045),
    ("water", 1.333),
    ("acetone", 1.36),
    ("ethanol", 1.361),
    ("carbon tetrachloride", 1.461),
    ("glycerol", 1.4729),
    ("benzene", 1.501),
    ("silicone oil", 1.52045),
    ("bromine", 1.661),
    ("water ice", 1.31),
    ("fused quartz", 1.458),
    ("pyrex", 1.47),
    ("acrylic glass", 1.49),
    ("polypropylene", 1.49),
    ("bk7", 1.5046),
    ("sodium chloride", 1.544),
    ("amber", 1.55),
    ("pet", 1.575),
    ("diamond", 2.419),
];

/// Metals of the material `conductor`, with eta and k.
pub(crate) const METALS: [(&str, [f64; 3], [f64; 3]); 10] = [
    ("Ag", [0.15528, 0.11673, 0.13839], [4.82835, 3.12222, 2.14690]),
    ("Al", [1.65750, 0.88040, 0.52124], [9.22381, 6.26950, 4.83700]),
    ("Au", [0.14304, 0.37531, 1.44205], [3.98300, 2.38556, 1.60336]),
    ("Be", [4.18501, 3.18503, 2.78406], [3.83547, 3.01012, 2.86899]),
    ("Cr", [4.36967, 2.91651, 1.65490], [5.20655, 4.23131, 3.75470]),
    ("Cu", [0.20101, 0.92375, 1.10222], [3.91326, 2.45305, 2.14209]),
    ("Hg", [2.39894, 1.44003, 0.90957], [6.32759, 4.37192, 3.42176]),
    ("Ir", [3.08630, 2.08219, 1.61791], [5.59215, 4.06709, 3.26731]),
    ("Ni", [2.36730, 1.66337, 1.46708], [4.49881, 3.05015, 2.34544]),
    ("W", [4.37082, 3.30025, 2.99841], [3.50064, 2.60487, 2.27323]),
];

/// The metal of a conductor.
enum Metal {
    /// A perfect mirror.
    None,
    Named(&'static str),
    Index([f64; 3], [f64; 3]),
}

/// A material as a table of its own; a shared one is on both sides.
fn surface(material: Value) -> Table {
    match material {
        Value::Table(table) => table,
        shared => typed("two_sided", [("front", shared.clone()), ("back", shared)]),
    }
}

/// A matte material that reflects nothing.
pub(super) fn black() -> Table {
    typed("matte", [("reflectance", Value::Float(0.0))])
}

impl<'a> Translator<'a> {
    /// A BSDF as the value of the key `material`.
    pub(super) fn bsdf(&mut self, index: usize, look: &Look) -> Value {
        let object = &self.scene.objects[index];
        if let Some(id) = &object.id
            && let Some(own) = self.options.materials.get(id)
        {
            self.replaced.insert(id);
            return Value::String(own.clone());
        }
        let key = format!("bsdf {index} {look:?}");
        if let Some(known) = self.memo.get(&key) {
            return known.clone();
        }
        if !self.enter(index) {
            return Value::Table(black());
        }
        let table = self.bsdf_table(index, look);
        self.leave();
        let value = match &object.id {
            Some(id) => self.share_material(id, table),
            None => Value::Table(table),
        };
        self.memo.insert(key, value.clone());
        value
    }

    /// A material that Mitsuba shows from one side.
    fn sided(&self, table: Table, look: &Look) -> Table {
        if look.bare {
            return table;
        }
        let (front, back) = if look.flip {
            (black(), table)
        } else {
            (table, black())
        };
        typed(
            "two_sided",
            [("front", Value::Table(front)), ("back", Value::Table(back))],
        )
    }

    fn bsdf_table(&mut self, index: usize, look: &Look) -> Table {
        let mut fields = self.fields(index);
        let at = fields.at();
        let result = match fields.object.plugin.as_str() {
            "diffuse" => {
                if fields.has("diffuse_reflectance") && !fields.has("reflectance") {
                    // Of Mitsuba 0.x.
                    let reflectance =
                        self.texture_or_color(&mut fields, "diffuse_reflectance", [0.5; 3], look);
                    self.sided(typed("matte", [("reflectance", reflectance)]), look)
                } else {
                    let reflectance = self.texture_or_color(&mut fields, "reflectance", [0.5; 3], look);
                    self.sided(typed("matte", [("reflectance", reflectance)]), look)
                }
            }
            "dielectric" => self.dielectric(&mut fields, look),
            "roughdielectric" => {
                self.note("bsdf roughdielectric", at);
                self.roughness(&mut fields);
                self.dielectric(&mut fields, look)
            }
            "thindielectric" => {
                let (interior, exterior) = self.iors(&mut fields, "bk7");
                if fields.has("specular_reflectance") {
                    fields.take("specular_reflectance");
                    self.note("specular_reflectance, specular_transmittance of glass", at);
                }
                let tint = self.texture_or_color(&mut fields, "specular_transmittance", [1.0; 3], look);
                typed(
                    "thin_dielectric",
                    [
                        ("interior_ior", Value::Float(interior)),
                        ("exterior_ior", Value::Float(exterior)),
                        ("tint", tint),
                    ],
                )
            }
            "conductor" => {
                let metal = self.metal(&mut fields);
                let tint = self.texture_or_color(&mut fields, "specular_reflectance", [1.0; 3], look);
                let table = match metal {
                    Metal::None => typed("mirror", [("reflectance", tint)]),
                    Metal::Named(name) => typed(
                        "conductor",
                        [("metal", Value::String(name.into())), ("tint", tint)],
                    ),
                    Metal::Index(eta, k) => typed(
                        "conductor",
                        [("eta", color(eta)), ("k", color(k)), ("tint", tint)],
                    ),
                };
                self.sided(table, look)
            }
            "roughconductor" => {
                self.note("bsdf roughconductor", at);
                let metal = self.metal(&mut fields);
                let exponent = self.roughness(&mut fields);
                let tint = self.texture_or_color(&mut fields, "specular_reflectance", [1.0; 3], look);
                let reflectance = match metal {
                    Metal::None => [1.0; 3],
                    Metal::Index(eta, k) => normal_reflectance(eta, k),
                    Metal::Named(name) => {
                        let (_, eta, k) = METALS
                            .iter()
                            .find(|(known, _, _)| *known == name)
                            .unwrap_or(&METALS[0]);
                        normal_reflectance(*eta, *k)
                    }
                };
                // The lobe is about the reflected direction, not about the normal.
                let exponent = (exponent / 4.0).max(1.0);
                let table = typed(
                    "glossy",
                    [
                        ("reflectance", product(reflectance, tint)),
                        ("exponent", Value::Float(exponent)),
                    ],
                );
                self.sided(table, look)
            }
            "plastic" => self.plastic(&mut fields, look),
            "roughplastic" => self.rough_plastic(&mut fields, look),
            "twosided" => self.two_sided(&mut fields, look),
            "mask" => {
                let opacity = self.share(&mut fields, "opacity", look);
                if self.opaque_holes && as_color(&opacity) != Some([1.0; 3]) {
                    self.note("holes in path and direct", at);
                }
                let material = self.nested(&mut fields, look);
                match combine::mask(material, opacity, &self.rays) {
                    Nearest::Exact(table) => table,
                    Nearest::Part(part) => {
                        self.note("mask of glass", at);
                        surface(part)
                    }
                }
            }
            "blendbsdf" => {
                let weight = self.share(&mut fields, "weight", look);
                let parts = self.children(&mut fields, &["bsdf"]);
                match parts[..] {
                    [(_, a), (_, b)] => {
                        let (a, b) = (self.bsdf(a, look), self.bsdf(b, look));
                        match combine::mix(a, b, weight, &self.rays) {
                            Nearest::Exact(table) => table,
                            Nearest::Part(part) => {
                                self.note("blendbsdf of two directions", at);
                                surface(part)
                            }
                        }
                    }
                    _ => {
                        self.error(
                            at,
                            format!("expected two bsdfs in \"blendbsdf\", found {}", parts.len()),
                        );
                        black()
                    }
                }
            }
            "normalmap" => self.normal_map(&mut fields, look),
            "bumpmap" => self.bump_map(&mut fields, look),
            "null" => {
                if self.opaque_holes {
                    self.note("holes in path and direct", at);
                }
                combine::open()
            }
            _ => {
                self.unknown(index);
                return black();
            }
        };
        self.finish(fields);
        result
    }

    fn bump_map(&mut self, fields: &mut Fields<'a>, look: &Look) -> Table {
        self.note("bsdf bumpmap", fields.at());
        self.shadowing(fields);
        let scale = self.number(fields, "scale", 1.0);
        // Heights rise along Mitsuba's normal.
        let scale = if look.flip != look.behind { -scale } else { scale };
        let heights = self.children(fields, &["texture"]);
        let height = match heights[..] {
            [(_, height)] => self.texture(height, look),
            _ => {
                let found = heights.len();
                self.error(
                    fields.at(),
                    format!("expected one texture in \"bumpmap\", found {found}"),
                );
                Value::Float(0.0)
            }
        };
        let material = self.nested(fields, look);
        typed(
            "bump",
            [
                ("height", height),
                ("scale", Value::Float(scale)),
                ("step", Value::Float(BUMP_STEP)),
                ("material", material),
            ],
        )
    }

    /// The single BSDF in another one.
    fn nested(&mut self, fields: &mut Fields<'a>, look: &Look) -> Value {
        let parts = self.children(fields, &["bsdf"]);
        if let [(_, part)] = parts[..] {
            return self.bsdf(part, look);
        }
        let plugin = shorten(&fields.object.plugin);
        self.error(
            fields.at(),
            format!("expected one bsdf in \"{plugin}\", found {}", parts.len()),
        );
        Value::Table(black())
    }

    fn two_sided(&mut self, fields: &mut Fields<'a>, look: &Look) -> Table {
        let inner = Look {
            bare: true,
            ..look.clone()
        };
        let parts = self.children(fields, &["bsdf"]);
        match parts[..] {
            [(_, part)] if !self.contains(part, LEANING) => surface(self.bsdf(part, &inner)),
            [(_, a)] | [(_, a), (_, _)] => {
                let b = parts.last().map_or(a, |(_, b)| *b);
                let behind = Look {
                    behind: self.contains(b, LEANING),
                    ..inner.clone()
                };
                let (a, b) = (self.bsdf(a, &inner), self.bsdf(b, &behind));
                let (front, back) = if look.flip { (b, a) } else { (a, b) };
                typed("two_sided", [("front", front), ("back", back)])
            }
            _ => {
                self.error(
                    fields.at(),
                    format!("expected one or two bsdfs in \"twosided\", found {}", parts.len()),
                );
                black()
            }
        }
    }

    fn dielectric(&mut self, fields: &mut Fields<'a>, look: &Look) -> Table {
        let (interior, exterior) = self.iors(fields, "bk7");
        for name in ["specular_reflectance", "specular_transmittance"] {
            if fields.has(name) {
                fields.take(name);
                self.note(
                    "specular_reflectance, specular_transmittance of glass",
                    fields.at(),
                );
            }
        }
        let (inside, outside) = if look.flip {
            (exterior, interior)
        } else {
            (interior, exterior)
        };
        typed(
            "dielectric",
            [
                ("interior_ior", Value::Float(inside)),
                ("exterior_ior", Value::Float(outside)),
            ],
        )
    }

    /// `int_ior` and `ext_ior`.
    fn iors(&mut self, fields: &mut Fields<'a>, interior: &str) -> (f64, f64) {
        let mut read = |name: &str, default: &str| {
            let known = |name: &str| IORS.iter().find(|(known, _)| *known == name).map(|(_, ior)| *ior);
            let default = known(default).unwrap_or(1.5);
            let Some(entry) = fields.take(name) else {
                return default;
            };
            let ior = match &entry.value {
                Data::Float(value) => Some(*value),
                Data::Integer(value) => Some(*value as f64),
                Data::Text(text) => known(&text.to_ascii_lowercase()),
                _ => None,
            };
            ior.filter(|ior| *ior > 0.0).unwrap_or_else(|| {
                self.wrong(entry, "a number above 0 or the name of a material");
                default
            })
        };
        (read("int_ior", interior), read("ext_ior", "air"))
    }

    fn metal(&mut self, fields: &mut Fields<'a>) -> Metal {
        let name = self.text(fields, "material").unwrap_or("none");
        if fields.has("eta") || fields.has("k") {
            let (eta, k) = (
                self.color(fields, "eta", [0.0; 3]),
                self.color(fields, "k", [1.0; 3]),
            );
            // A perfect mirror, as of the material "none".
            if eta == [0.0; 3] {
                return Metal::None;
            }
            return Metal::Index(eta, k);
        }
        if name == "none" {
            return Metal::None;
        }
        match METALS.iter().find(|(known, _, _)| *known == name) {
            Some((known, _, _)) => Metal::Named(known),
            None => {
                let known = METALS.map(|(name, _, _)| name).join(", ");
                let message = format!("unknown metal \"{}\"; known metals are {known}", shorten(name));
                self.error(fields.at(), message);
                Metal::None
            }
        }
    }

    /// The exponent of a Blinn-Phong lobe about the normal that is as wide as the roughness.
    fn roughness(&mut self, fields: &mut Fields<'a>) -> f64 {
        for ignored in ["distribution", "sample_visible"] {
            fields.take(ignored);
        }
        let at = fields.at();
        let mut read = |name: &str| {
            let is_texture = fields
                .object
                .entries
                .iter()
                .any(|entry| entry.name == name && matches!(entry.value, Data::Object(_)));
            if is_texture {
                fields.take(name);
                self.note("texture of alpha", at);
                return None;
            }
            fields.has(name).then(|| self.color(fields, name, [0.1; 3])[0])
        };
        let (both, u, v) = (read("alpha"), read("alpha_u"), read("alpha_v"));
        let alpha = both
            .or(u.zip(v).map(|(u, v)| (u * v).abs().sqrt()))
            .unwrap_or(0.1);
        (2.0 / (alpha * alpha).max(1e-8) - 2.0).max(1.0)
    }

    fn plastic(&mut self, fields: &mut Fields<'a>, look: &Look) -> Table {
        let at = fields.at();
        let (interior, exterior) = self.iors(fields, "polypropylene");
        let diffuse = self.texture_or_color(fields, "diffuse_reflectance", [0.5; 3], look);
        let specular = self.texture_or_color(fields, "specular_reflectance", [1.0; 3], look);
        if as_color(&specular) != Some([1.0; 3]) {
            self.note("specular_reflectance of plastic", at);
        }
        let table = if self.boolean(fields, "nonlinear", false) {
            if as_color(&diffuse).is_none() {
                self.note("nonlinear plastic with a texture", at);
            }
            coat::of_albedo(diffuse, interior, exterior)
        } else {
            coat::plastic(diffuse, interior, exterior)
        };
        self.sided(table, look)
    }

    fn rough_plastic(&mut self, fields: &mut Fields<'a>, look: &Look) -> Table {
        self.note("bsdf roughplastic", fields.at());
        fields.take("nonlinear");
        let (interior, exterior) = self.iors(fields, "polypropylene");
        let reflected = ((interior - exterior) / (interior + exterior)).powi(2);
        let diffuse = self.texture_or_color(fields, "diffuse_reflectance", [0.5; 3], look);
        let specular = self.texture_or_color(fields, "specular_reflectance", [1.0; 3], look);
        let passed = 1.0 - reflected;
        let exponent = self.roughness(fields);
        let peak = reflected * (exponent + 2.0) / (8.0 * PI);
        let table = typed(
            "blinn_phong",
            [
                ("k_d", product([passed / PI; 3], diffuse.clone())),
                ("k_a", product([passed; 3], diffuse)),
                ("k_s", product([peak; 3], specular)),
                ("exponent", Value::Float(exponent)),
            ],
        );
        self.sided(table, look)
    }

    /// The parameters that a normal map and a bump map share.
    fn shadowing(&mut self, fields: &mut Fields<'a>) {
        fields.take("flip_invalid_normals");
        if self.boolean(fields, "use_shadowing_function", true) {
            self.note("use_shadowing_function", fields.at());
        }
    }

    fn normal_map(&mut self, fields: &mut Fields<'a>, look: &Look) -> Table {
        self.shadowing(fields);
        let map = self.texture_or_color(fields, "normalmap", [0.5, 0.5, 1.0], look);
        let material = self.nested(fields, look);
        let Some((key, direction)) = look.tangent.clone() else {
            self.note("normalmap without tangents", fields.at());
            return surface(material);
        };
        if direction.as_str() == Some("mesh") {
            self.note("normalmap on a mesh", fields.at());
        }
        let mut table = typed(
            "normal_map",
            [("map", map), ("material", material), (key, direction)],
        );
        if look.behind {
            table.insert("strength".to_owned(), Value::Float(-1.0));
        }
        table
    }

    /// Whether an object or one inside it is one of these plugins.
    pub(super) fn contains(&mut self, index: usize, plugins: &'static [&'static str]) -> bool {
        if let Some(known) = self.contained.get(&(index, plugins)) {
            return *known;
        }
        let found = self.search(index, plugins);
        self.contained.insert((index, plugins), found);
        found
    }

    fn search(&self, index: usize, plugins: &[&str]) -> bool {
        let mut seen = HashSet::from([index]);
        let mut pending = vec![index];
        while let Some(index) = pending.pop() {
            let object = &self.scene.objects[index];
            if plugins.contains(&object.plugin.as_str()) {
                return true;
            }
            for entry in &object.entries {
                if let Data::Object(inner) = entry.value
                    && seen.insert(inner)
                {
                    pending.push(inner);
                }
            }
        }
        false
    }
}

/// The reflectance of a metal at normal incidence.
pub(crate) fn normal_reflectance(eta: [f64; 3], k: [f64; 3]) -> [f64; 3] {
    let channel = |i: usize| {
        let (eta, k) = (eta[i], k[i]);
        ((eta - 1.0).powi(2) + k * k) / ((eta + 1.0).powi(2) + k * k)
    };
    [channel(0), channel(1), channel(2)]
}

/// A colour times a colour or texture.
pub(crate) fn product(factor: [f64; 3], value: Value) -> Value {
    let by = |value: [f64; 3]| color([0, 1, 2].map(|i| factor[i] * value[i]));
    match value {
        Value::Float(value) => by([value; 3]),
        Value::Array(values) => {
            let channel = |i: usize| values.get(i).and_then(Value::as_float).unwrap_or(0.0);
            by([channel(0), channel(1), channel(2)])
        }
        texture => {
            let factors = Value::Array(vec![color(factor), texture]);
            Value::Table(typed("product", [("factors", factors)]))
        }
    }
}
