//! The nearest metallic-roughness materials, for other programs.
//!
//! The formulas are those of the import, in the opposite direction (see `gltf::material`).

use super::view::single;
use super::{Exporter, table};
use crate::files;
use crate::mitsuba::{METALS, normal_reflectance};
use serde_json::{Map, json};
use std::f64::consts::PI;
use toml::{Table, Value};
use whitstone_core::{DAffine3, DMat3, DVec3};

/// Largest nesting of materials and of textures, by the model.
const MAX_DEPTH: usize = 16;
/// Magnification and minification filters, and wrapping modes.
const NEAREST: u32 = 9728;
const LINEAR: u32 = 9729;
const LINEAR_MIPMAP_LINEAR: u32 = 9987;
const REPEAT: u32 = 10497;
const CLAMP_TO_EDGE: u32 = 33071;
const MIRRORED_REPEAT: u32 = 33648;

/// A material of the file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Written {
    /// Its index.
    pub(super) index: usize,
    /// The sets of texture coordinates that it uses.
    pub(super) uv_sets: [bool; 2],
}

/// How transparent a surface is.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Alpha {
    Opaque,
    Blend,
    Mask(f64),
}

/// The parameters of a metallic-roughness material.
#[derive(Clone, Debug)]
struct Look<'a> {
    base: Tint<'a>,
    metallic: f64,
    roughness: f64,
    emission: Tint<'a>,
    normal: Option<(&'a Table, f64)>,
    alpha: f64,
    mode: Alpha,
    transmission: f64,
    ior: Option<f64>,
    /// The absorption of a body; none of a surface without one.
    absorption: Option<[f64; 3]>,
}

/// A colour times an image.
#[derive(Clone, Copy, Debug)]
struct Tint<'a> {
    color: [f64; 3],
    image: Option<&'a Table>,
}

impl<'a> Tint<'a> {
    fn constant(color: [f64; 3]) -> Self {
        Self { color, image: None }
    }

    fn times(self, factor: f64) -> Self {
        Self {
            color: self.color.map(|part| part * factor),
            ..self
        }
    }

    fn largest(&self) -> f64 {
        self.color.into_iter().fold(0.0, f64::max)
    }

    fn mean(&self) -> f64 {
        self.color.iter().sum::<f64>() / 3.0
    }

    /// The blend by a constant weight; of two images one is kept.
    fn blend(a: Self, b: Self, weight: f64) -> Self {
        let near = if weight <= 0.5 { a } else { b };
        Self {
            color: std::array::from_fn(|k| a.color[k] * (1.0 - weight) + b.color[k] * weight),
            image: near.image.or(a.image).or(b.image),
        }
    }
}

impl<'a> Look<'a> {
    fn new(base: Tint<'a>, metallic: f64, roughness: f64) -> Self {
        Self {
            base,
            metallic,
            roughness,
            emission: Tint::constant([0.0; 3]),
            normal: None,
            alpha: 1.0,
            mode: Alpha::Opaque,
            transmission: 0.0,
            ior: None,
            absorption: None,
        }
    }

    fn blend(a: Self, b: Self, weight: f64) -> Self {
        let number = |a: f64, b: f64| a * (1.0 - weight) + b * weight;
        let (near, other) = if weight <= 0.5 { (&a, &b) } else { (&b, &a) };
        Self {
            base: Tint::blend(a.base, b.base, weight),
            metallic: number(a.metallic, b.metallic),
            roughness: number(a.roughness, b.roughness),
            emission: Tint::blend(a.emission, b.emission, weight),
            normal: near.normal.or(other.normal),
            alpha: number(a.alpha, b.alpha),
            mode: if near.mode == Alpha::Opaque {
                other.mode
            } else {
                near.mode
            },
            transmission: number(a.transmission, b.transmission),
            ior: near.ior.or(other.ior),
            absorption: near.absorption.or(other.absorption),
        }
    }
}

/// The roughness of a surface whose Phong lobe about the reflected direction has this exponent.
fn roughness(exponent: f64) -> f64 {
    libm::pow(2.0 / (4.0 * exponent + 2.0), 0.25).min(1.0)
}

impl<'a> Exporter<'a> {
    /// The material of a shape.
    pub(super) fn material(&mut self, value: Option<&'a Value>, place: &str) -> Written {
        let key = value.map_or(String::new(), Value::to_string);
        if let Some(known) = self.materials.get(&key) {
            return *known;
        }
        let look = match value {
            None => Look::new(Tint::constant([0.5; 3]), 0.0, 1.0),
            Some(value) => self.look(value, place, 0),
        };
        let name = value.and_then(Value::as_str);
        let written = self.write_material(&look, name, place);
        self.materials.insert(key, written);
        written
    }

    fn look(&mut self, value: &'a Value, place: &str, depth: usize) -> Look<'a> {
        let grey = Look::new(Tint::constant([0.5; 3]), 0.0, 1.0);
        let material = self.plugin("material", value).filter(|_| depth < MAX_DEPTH);
        let Some(material) = material else {
            return grey;
        };
        let kind = table::kind(material);
        match kind {
            "matte" => Look::new(self.tint(material, "reflectance", 0.5, place), 0.0, 1.0),
            "phong" | "blinn_phong" | "whitted" => self.shaded(material, kind, place),
            "mirror" => {
                let base = self.tint(material, "reflectance", 1.0, place);
                if base.image.is_some() || base.color != [1.0; 3] {
                    self.note("[material] mirror", place);
                }
                Look::new(base, 1.0, 0.0)
            }
            "glossy" => {
                self.note("[material] glossy", place);
                let exponent = table::number(material, "exponent").unwrap_or(100.0);
                let base = self.tint(material, "reflectance", 1.0, place);
                Look::new(base, 1.0, roughness(exponent))
            }
            "conductor" => {
                self.note("[material] conductor", place);
                let named = table::text(material, "metal");
                let metal = METALS.iter().find(|(known, _, _)| Some(*known) == named);
                let (eta, k) = metal.map_or_else(
                    || {
                        (
                            table::color(material, "eta", [1.0; 3]),
                            table::color(material, "k", [1.0; 3]),
                        )
                    },
                    |(_, eta, k)| (*eta, *k),
                );
                let mut base = self.tint(material, "tint", 1.0, place);
                for (part, reflectance) in base.color.iter_mut().zip(normal_reflectance(eta, k)) {
                    *part *= reflectance;
                }
                Look::new(base, 1.0, 0.0)
            }
            "dielectric" => {
                if material.contains_key("priority") {
                    self.note("[material] priority", place);
                }
                Look {
                    transmission: 1.0,
                    ior: Some(self.relative_ior(material, place)),
                    absorption: Some(table::color(material, "absorption", [0.0; 3])),
                    ..Look::new(Tint::constant([1.0; 3]), 0.0, 0.0)
                }
            }
            "thin_dielectric" => Look {
                transmission: 1.0,
                ior: Some(self.relative_ior(material, place)),
                ..Look::new(self.tint(material, "tint", 1.0, place), 0.0, 0.0)
            },
            "emissive" => {
                let mut look = match material.get("material") {
                    Some(inner) => self.look(inner, place, depth + 1),
                    None => Look::new(Tint::constant([0.0; 3]), 0.0, 1.0),
                };
                look.emission = self.tint(material, "radiance", 1.0, place);
                look
            }
            "mask" => self.mask(material, place, depth),
            "mix" => {
                self.note("[material] mix", place);
                let weight = self.tint(material, "weight", 0.5, place).mean();
                let mut part = |key: &str| match material.get(key) {
                    Some(inner) => self.look(inner, place, depth + 1),
                    None => grey.clone(),
                };
                Look::blend(part("a"), part("b"), weight)
            }
            "two_sided" => {
                self.note("[material] two_sided", place);
                material
                    .get("front")
                    .map_or(grey, |front| self.look(front, place, depth + 1))
            }
            "reflection_map" => {
                self.note("[material] reflection_map", place);
                let inner = material.get("material");
                inner.map_or(grey, |inner| self.look(inner, place, depth + 1))
            }
            "normal_map" | "bump" => {
                let inner = material.get("material");
                let mut look = inner.map_or(grey, |inner| self.look(inner, place, depth + 1));
                let map = material
                    .get("map")
                    .filter(|_| table::text(material, "tangent") == Some("mesh"))
                    .and_then(|map| self.plugin("texture", map))
                    .filter(|map| self.is_image(map, &["linear"]));
                match map {
                    Some(map) => {
                        look.normal = Some((map, table::number(material, "strength").unwrap_or(1.0)));
                    }
                    None => self.note("[material] bump", place),
                }
                look
            }
            other => {
                let place = format!("{place} {other}");
                self.note("[material] of another type", &place);
                grey
            }
        }
    }

    /// phong, blinn_phong and whitted.
    fn shaded(&mut self, material: &'a Table, kind: &str, place: &str) -> Look<'a> {
        self.note("[material] phong, blinn_phong, whitted", place);
        let default = if kind == "whitted" { 0.0 } else { 0.5 };
        let diffuse = self.tint(material, "k_d", default, place).times(PI);
        let highlight = self.tint(material, "k_s", default, place);
        let exponent = table::number(material, "exponent").unwrap_or(32.0);
        // The lobe of blinn_phong is about the normal.
        let exponent = if kind == "blinn_phong" {
            exponent / 4.0
        } else {
            exponent
        };
        let [mirror, through] = ["k_refl", "k_refr"].map(|key| {
            if kind == "whitted" {
                self.tint(material, key, 0.0, place)
            } else {
                Tint::constant([0.0; 3])
            }
        });
        let mut rough = if highlight.largest() > 0.0 {
            roughness(exponent)
        } else {
            1.0
        };
        let all = diffuse.largest() + mirror.largest();
        let metallic = if all > 0.0 { mirror.largest() / all } else { 0.0 };
        if metallic > 0.0 {
            rough = 0.0;
        }
        let mut base = Tint::blend(diffuse.times(2.0), mirror.times(2.0), 0.5);
        base.image = if metallic > 0.5 {
            mirror.image.or(diffuse.image)
        } else {
            diffuse.image.or(mirror.image)
        };
        if through.largest() == 0.0 {
            return Look::new(base, metallic, rough);
        }
        let base = if all > 0.0 && diffuse.largest() > 0.0 {
            base
        } else {
            through
        };
        Look {
            transmission: through.largest().min(1.0),
            ior: Some(self.relative_ior(material, place)),
            absorption: Some(table::color(material, "absorption", [0.0; 3])),
            ..Look::new(base, 0.0, 0.0)
        }
    }

    fn mask(&mut self, material: &'a Table, place: &str, depth: usize) -> Look<'a> {
        let mut look = match material.get("material") {
            Some(inner) => self.look(inner, place, depth + 1),
            None => Look::new(Tint::constant([0.5; 3]), 0.0, 1.0),
        };
        look.mode = Alpha::Blend;
        let Some(opacity) = material.get("opacity") else {
            look.alpha *= 0.5;
            return look;
        };
        if let Some(value) = table::as_color(opacity) {
            look.alpha *= value.iter().sum::<f64>() / 3.0;
            return look;
        }
        let mut texture = self.plugin("texture", opacity);
        if let Some(threshold) = texture.filter(|texture| table::kind(texture) == "threshold") {
            look.mode = Alpha::Mask(table::number(threshold, "at").unwrap_or(0.5));
            texture = threshold
                .get("input")
                .and_then(|input| self.plugin("texture", input));
        }
        let same = |image: &Table| {
            texture.is_some_and(|texture| {
                ["file", "image", "mapping", "scale", "offset"]
                    .into_iter()
                    .all(|key| texture.get(key) == image.get(key))
                    && table::text(texture, "channel") == Some("alpha")
            })
        };
        match look.base.image {
            Some(image) if same(image) => {}
            // An image whose alpha alone counts.
            None if texture.is_some_and(|texture| {
                table::text(texture, "channel") == Some("alpha") && self.is_image(texture, &["alpha"])
            }) =>
            {
                look.base.image = texture;
                self.note("[material] mask", place);
            }
            _ => {
                self.note("[material] mask", place);
                look.mode = Alpha::Blend;
                look.alpha *= self.tint(material, "opacity", 0.5, place).mean();
            }
        }
        look
    }

    /// A texture parameter as a factor and an image.
    fn tint(&mut self, material: &'a Table, key: &str, default: f64, place: &str) -> Tint<'a> {
        match material.get(key) {
            None => Tint::constant([default; 3]),
            Some(value) => self.texture_value(value, place, 0),
        }
    }

    fn texture_value(&mut self, value: &'a Value, place: &str, depth: usize) -> Tint<'a> {
        let grey = Tint::constant([0.5; 3]);
        if let Some(color) = table::as_color(value) {
            return Tint::constant(color);
        }
        let texture = self.plugin("texture", value).filter(|_| depth < MAX_DEPTH);
        let Some(texture) = texture else {
            return grey;
        };
        match table::kind(texture) {
            "constant" => Tint::constant(table::color(texture, "value", [1.0; 3])),
            // They are an attribute of the mesh.
            "vertex_color" => Tint::constant([1.0; 3]),
            "image" if self.is_image(texture, &["auto", "srgb"]) => Tint {
                image: Some(texture),
                ..Tint::constant([1.0; 3])
            },
            "image" => {
                self.note("[texture] image", place);
                grey
            }
            "product" => {
                let factors = texture.get("factors").and_then(Value::as_array);
                let mut all = Tint::constant([1.0; 3]);
                for factor in factors.into_iter().flatten() {
                    let factor = self.texture_value(factor, place, depth + 1);
                    if all.image.is_some() && factor.image.is_some() {
                        self.note("[texture] product", place);
                    }
                    all = Tint {
                        color: std::array::from_fn(|k| all.color[k] * factor.color[k]),
                        image: all.image.or(factor.image),
                    };
                }
                all
            }
            "mix" => {
                self.note("[texture] product", place);
                let mut part = |key: &str| match texture.get(key) {
                    Some(value) => self.texture_value(value, place, depth + 1),
                    None => grey,
                };
                let (a, b, weight) = (part("a"), part("b"), part("weight"));
                Tint::blend(a, b, weight.mean())
            }
            other => {
                let place = format!("{place} {other}");
                self.note("[texture] of another type", &place);
                if let Some(stops) = texture.get("stops").and_then(Value::as_array) {
                    let colors: Vec<[f64; 3]> = stops
                        .iter()
                        .filter_map(Value::as_table)
                        .map(|stop| table::color(stop, "color", [0.5; 3]))
                        .collect();
                    let count = colors.len().max(1) as f64;
                    let mean = |k: usize| colors.iter().map(|color| color[k]).sum::<f64>() / count;
                    return Tint::constant([mean(0), mean(1), mean(2)]);
                }
                let (a, b) = match other {
                    "synthesized" | "solid" | "threshold" | "image" => return grey,
                    _ => (
                        table::color(texture, "a", [0.8; 3]),
                        table::color(texture, "b", [0.2; 3]),
                    ),
                };
                Tint::constant(std::array::from_fn(|k| (a[k] + b[k]) / 2.0))
            }
        }
    }

    /// Whether a texture is an image that glTF can hold, mapped by texture coordinates. `spaces`:
    /// the colour spaces that its use allows, or the channel "alpha".
    fn is_image(&self, texture: &Table, spaces: &[&str]) -> bool {
        let channel = table::text(texture, "channel").unwrap_or("color");
        let fits = match channel {
            "color" => spaces.contains(&table::text(texture, "color_space").unwrap_or("auto")),
            other => spaces.contains(&other),
        };
        let mapping = table::table(texture, "mapping");
        let projection = mapping.and_then(|mapping| table::text(mapping, "projection"));
        table::kind(texture) == "image"
            && fits
            && projection.is_none_or(|projection| projection == "uv")
            && table::text(texture, "file").is_some_and(|file| !file.to_lowercase().ends_with(".exr"))
    }

    /// The index of refraction inside relative to outside. In glTF it is at least 1.
    fn relative_ior(&mut self, material: &Table, place: &str) -> f64 {
        let number = |key: &str, default: f64| table::number(material, key).unwrap_or(default);
        let ratio = number("interior_ior", 1.5) / number("exterior_ior", 1.0);
        if ratio < 1.0 {
            self.note("[material] refraction below 1", place);
        }
        if material.contains_key("exterior_absorption") {
            self.note("[material] exterior_absorption", place);
        }
        ratio.max(1.0)
    }

    fn write_material(&mut self, look: &Look<'a>, name: Option<&str>, place: &str) -> Written {
        let mut written = Written {
            index: self.root.materials.len(),
            ..Written::default()
        };
        // Reserved, since textures are written on the way.
        self.root.materials.push(json!(null));
        let mut textures = |exporter: &mut Self, image: Option<&'a Table>| {
            let found = image.and_then(|image| exporter.texture_info(image, place))?;
            let (info, set) = found;
            written.uv_sets[set] = true;
            Some(info)
        };
        let [r, g, b] = look.base.color.map(|part| single(part.clamp(0.0, 1.0)));
        let mut pbr = json!({
            "baseColorFactor": [r, g, b, single(look.alpha.clamp(0.0, 1.0))],
            "metallicFactor": single(look.metallic),
            "roughnessFactor": single(look.roughness),
        });
        if let Some(info) = textures(self, look.base.image) {
            pbr["baseColorTexture"] = info;
        }
        // The surface of a body has one outside.
        let body = look.transmission > 0.0 && look.absorption.is_some();
        let mut keys = json!({ "pbrMetallicRoughness": pbr, "doubleSided": !body });
        if let Some(name) = name {
            keys["name"] = name.into();
        }
        let mut extensions = Map::new();
        let strength = look.emission.largest();
        if strength > 0.0 {
            let scale = strength.max(1.0);
            keys["emissiveFactor"] = look
                .emission
                .color
                .map(|part| single(part.max(0.0) / scale))
                .to_vec()
                .into();
            if scale > 1.0 {
                extensions.insert(
                    "KHR_materials_emissive_strength".into(),
                    json!({ "emissiveStrength": single(scale) }),
                );
            }
            if let Some(info) = textures(self, look.emission.image) {
                keys["emissiveTexture"] = info;
            }
        }
        if let Some((map, strength)) = look.normal
            && let Some(mut info) = textures(self, Some(map))
        {
            if strength != 1.0 {
                info["scale"] = single(strength).into();
            }
            keys["normalTexture"] = info;
        }
        match look.mode {
            Alpha::Opaque => {}
            Alpha::Blend => keys["alphaMode"] = "BLEND".into(),
            Alpha::Mask(cutoff) => {
                keys["alphaMode"] = "MASK".into();
                keys["alphaCutoff"] = single(cutoff.max(0.0)).into();
            }
        }
        if look.transmission > 0.0 {
            extensions.insert(
                "KHR_materials_transmission".into(),
                json!({ "transmissionFactor": single(look.transmission.min(1.0)) }),
            );
            if let Some(absorption) = look.absorption {
                let mut volume = json!({ "thicknessFactor": 1.0 });
                let largest = absorption.into_iter().fold(0.0, f64::max);
                if largest > 0.0 {
                    volume["attenuationDistance"] = single(1.0 / largest).into();
                    volume["attenuationColor"] = absorption
                        .map(|part| single(libm::exp(-part / largest)))
                        .to_vec()
                        .into();
                }
                extensions.insert("KHR_materials_volume".into(), volume);
            }
        }
        // In glTF, what is no metal has a clear coat unless it says otherwise.
        if look.metallic == 0.0 && look.roughness == 1.0 && look.transmission == 0.0 {
            extensions.insert("KHR_materials_specular".into(), json!({ "specularFactor": 0.0 }));
        }
        if let Some(ior) = look.ior {
            extensions.insert("KHR_materials_ior".into(), json!({ "ior": single(ior) }));
        }
        for extension in extensions.keys() {
            self.root.uses(extension);
        }
        if !extensions.is_empty() {
            keys["extensions"] = extensions.into();
        }
        self.root.materials[written.index] = keys;
        written
    }

    /// A reference to a texture, and its set of texture coordinates.
    fn texture_info(&mut self, texture: &'a Table, place: &str) -> Option<(serde_json::Value, usize)> {
        let image = self.image(texture)?;
        let webp = self.root.images[image]["mimeType"] == "image/webp";
        let filter = table::text(texture, "filter").unwrap_or("bilinear");
        let (magnified, reduced) = match filter {
            "nearest" => (NEAREST, NEAREST),
            "trilinear" | "ewa" => (LINEAR, LINEAR_MIPMAP_LINEAR),
            _ => (LINEAR, LINEAR),
        };
        if filter == "ewa" {
            self.note("[texture] ewa", place);
        }
        let [s, t] = match texture.get("wrap") {
            Some(Value::Array(both)) => [both.first(), both.get(1)],
            both => [both, both],
        }
        .map(|wrap| match wrap.and_then(Value::as_str) {
            Some("clamp") => CLAMP_TO_EDGE,
            Some("mirror") => MIRRORED_REPEAT,
            _ => REPEAT,
        });
        let sampler = json!({ "magFilter": magnified, "minFilter": reduced, "wrapS": s, "wrapT": t });
        let sampler = position(&mut self.root.samplers, sampler);
        let entry = if webp {
            self.root.uses("EXT_texture_webp");
            self.root.requires("EXT_texture_webp");
            json!({ "sampler": sampler, "extensions": { "EXT_texture_webp": { "source": image } } })
        } else {
            json!({ "sampler": sampler, "source": image })
        };
        let index = position(&mut self.root.textures, entry);
        let mapping = table::table(texture, "mapping");
        let set = mapping.and_then(|mapping| table::number(mapping, "uv_set"));
        let set = usize::from(set == Some(1.0));
        let mut info = json!({ "index": index });
        if set != 0 {
            info["texCoord"] = set.into();
        }
        let [su, sv] = table::pair(texture, "scale", 1.0);
        let [ou, ov] = table::pair(texture, "offset", 0.0);
        let own = mapping.map_or(DAffine3::IDENTITY, table::transform);
        let map = DAffine3::from_mat3_translation(
            DMat3::from_diagonal(DVec3::new(su, sv, 1.0)),
            DVec3::new(ou, ov, 0.0),
        ) * own;
        if map != DAffine3::IDENTITY {
            match texture_transform(&map) {
                Some(transform) => {
                    self.root.uses("KHR_texture_transform");
                    info["extensions"] = json!({ "KHR_texture_transform": transform });
                }
                None => self.note("[texture] mapping", place),
            }
        }
        Some((info, set))
    }

    /// The index of the image of a texture; none if it cannot be read.
    pub(super) fn image(&mut self, texture: &Table) -> Option<usize> {
        let file = table::text(texture, "file")?;
        let number = texture.get("image").and_then(Value::as_integer);
        let key = (file.to_owned(), number);
        if let Some(known) = self.images.get(&key) {
            return *known;
        }
        let found = self.read_image(file, number);
        let index = match found {
            Ok(entry) => {
                self.root.images.push(entry);
                Some(self.root.images.len() - 1)
            }
            Err(message) => {
                self.fail(&format!("\"{}\": {message}", files::shorten(file)));
                None
            }
        };
        self.images.insert(key, index);
        index
    }

    fn read_image(&mut self, file: &str, number: Option<i64>) -> Result<serde_json::Value, String> {
        let path = self.base.join(file);
        let of_gltf = path.extension().is_some_and(|extension| {
            extension.eq_ignore_ascii_case("gltf") || extension.eq_ignore_ascii_case("glb")
        });
        let bytes = if of_gltf {
            let document = whitstone_gltf::Document::open(&path).map_err(|error| error.to_string())?;
            let number = usize::try_from(number.unwrap_or(0)).map_err(|error| error.to_string())?;
            document.image(number).map_err(|error| error.to_string())?
        } else {
            files::read(&path, 1 << 30)?
        };
        let kind = match &bytes[..] {
            [0x89, b'P', b'N', b'G', ..] => "image/png",
            [0xff, 0xd8, ..] => "image/jpeg",
            [b'R', b'I', b'F', b'F', ..] => "image/webp",
            _ => return Err("is neither PNG, JPEG nor WebP".to_owned()),
        };
        // Images of glTF files stay in the buffer; a .gltf keeps image files as separate files.
        if of_gltf || self.embedded {
            let view = self.buffer.view(&bytes, None);
            return Ok(json!({ "bufferView": view, "mimeType": kind }));
        }
        let copy = self.copies.copy(file).map_err(|error| error.message)?;
        let mut entry = json!({ "uri": super::uri(&copy) });
        if kind == "image/webp" {
            entry["mimeType"] = kind.into();
        }
        Ok(entry)
    }
}

/// The position of a value in a list, to which it is added if it is new.
fn position(list: &mut Vec<serde_json::Value>, value: serde_json::Value) -> usize {
    list.iter().position(|known| *known == value).unwrap_or_else(|| {
        list.push(value);
        list.len() - 1
    })
}

/// KHR_texture_transform for a map of texture coordinates with v up; none if it shears.
fn texture_transform(map: &DAffine3) -> Option<serde_json::Value> {
    let flip = DAffine3::from_mat3_translation(
        DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0)),
        DVec3::new(0.0, 1.0, 0.0),
    );
    let down = flip * *map * flip;
    let (x, y) = (down.matrix3.x_axis.truncate(), down.matrix3.y_axis.truncate());
    let (sx, length) = (x.length(), y.length());
    if x.dot(y).abs() > 1e-6 * sx * length {
        return None;
    }
    // The columns are sx (cos, -sin) and sy (sin, cos).
    let rotation = libm::atan2(-x.y, x.x);
    let sy = length.copysign(x.perp_dot(y));
    let mut keys = json!({
        "offset": [single(down.translation.x), single(down.translation.y)],
        "scale": [single(sx), single(sy)],
    });
    if rotation != 0.0 {
        keys["rotation"] = single(rotation).into();
    }
    Some(keys)
}
