//! Materials and textures.

use super::{Exporter, MAX_NESTING, Pattern, floats, key, matrix, mean, parameter, quoted, rgb, table, text};
use crate::coat;
use crate::mitsuba::material::METALS;
use std::collections::HashSet;
use std::f64::consts::PI;
use toml::{Table, Value};
use whitstone_core::{DAffine3, DMat3, DVec3};

/// The emission of a material.
pub(super) struct Emission<'a> {
    pub(super) radiance: Option<&'a Value>,
    pub(super) front: bool,
    pub(super) back: bool,
}

impl<'a> Exporter<'a> {
    /// Writes a material; its name, and the alpha of the shape.
    pub(super) fn material(&mut self, value: &'a Value, place: &str) -> (String, Option<Pattern>) {
        let mut value = value;
        let mut alpha = None;
        // A mask is the alpha of its shape.
        if let Some(material) = self.plugin("material", value)
            && table::kind(material) == "mask"
            && let Some(inner) = material.get("material")
        {
            let opacity = match material.get("opacity") {
                Some(opacity) => self.texture(opacity, true, place),
                None => Pattern::Color([0.5; 3]),
            };
            if let Pattern::Color(color) = opacity
                && color != [color[0]; 3]
            {
                self.note("[material] coloured weight", place);
            }
            alpha = Some(opacity);
            value = inner;
        }
        (self.named(value, place), alpha)
    }

    /// Writes a material; its name.
    fn named(&mut self, value: &'a Value, place: &str) -> String {
        let known = key(value);
        if let Some(name) = self.materials.get(&known) {
            return name.clone();
        }
        let place = value.as_str().unwrap_or(place);
        self.depth += 1;
        let text = match self.plugin("material", value) {
            Some(material) if self.depth <= MAX_NESTING => self.material_text(material, place),
            _ => diffuse(&Pattern::Color([0.5; 3])),
        };
        self.depth -= 1;
        let name = self.unique(value.as_str().unwrap_or("material"));
        self.line(format!("MakeNamedMaterial {} {text}\n", quoted(&name)));
        self.materials.insert(known, name.clone());
        name
    }

    /// A colour or texture of a material.
    fn look(&mut self, material: &'a Table, key: &str, default: f64, place: &str) -> Pattern {
        match material.get(key) {
            None => Pattern::Color([default; 3]),
            Some(value) => self.texture(value, false, place),
        }
    }

    /// A constant colour; a texture is the default, with a note.
    fn constant(&mut self, material: &'a Table, key: &str, default: f64, place: &str) -> [f64; 3] {
        match self.look(material, key, default, place) {
            Pattern::Color(value) => value,
            Pattern::Named(_) => {
                self.note("[material] texture of a highlight or reflection", place);
                [default; 3]
            }
        }
    }

    /// The material in another one, instead of which it is written.
    fn inner(&mut self, material: &'a Table, key: &str, place: &str) -> String {
        let inner = material.get(key).and_then(|value| self.plugin("material", value));
        let Some(inner) = inner.filter(|_| self.depth <= MAX_NESTING) else {
            return diffuse(&Pattern::Color([0.0; 3]));
        };
        self.depth += 1;
        let text = self.material_text(inner, place);
        self.depth -= 1;
        text
    }

    /// The type and the parameters of a material.
    fn material_text(&mut self, material: &'a Table, place: &str) -> String {
        match table::kind(material) {
            "matte" => diffuse(&self.look(material, "reflectance", 0.5, place)),
            "mirror" => {
                self.note("[material] mirror", place);
                let reflectance = self.look(material, "reflectance", 1.0, place);
                format!(
                    "\"string type\" \"conductor\" {}",
                    parameter("reflectance", &reflectance, false)
                )
            }
            "glossy" => {
                self.note("[material] glossy", place);
                let reflectance = self.look(material, "reflectance", 1.0, place);
                format!(
                    "\"string type\" \"conductor\" {} {}",
                    parameter("reflectance", &reflectance, false),
                    roughness(material)
                )
            }
            "conductor" => {
                if self.constant(material, "tint", 1.0, place) != [1.0; 3] {
                    self.note("[material] tint", place);
                }
                let named = table::text(material, "metal");
                let metal = METALS.iter().find(|(known, _, _)| Some(*known) == named);
                if let Some((name @ ("Ag" | "Al" | "Au" | "Cu"), _, _)) = metal {
                    return format!(
                        "\"string type\" \"conductor\" \"spectrum eta\" \"metal-{name}-eta\" \"spectrum k\" \"metal-{name}-k\""
                    );
                }
                let (eta, k) = match metal {
                    Some((_, eta, k)) => (*eta, *k),
                    None => (
                        table::color(material, "eta", [1.0; 3]),
                        table::color(material, "k", [1.0; 3]),
                    ),
                };
                format!(
                    "\"string type\" \"conductor\" {} {}",
                    rgb("eta", eta),
                    rgb("k", k)
                )
            }
            "dielectric" => {
                for (key, feature) in [
                    ("absorption", "[material] absorption"),
                    ("exterior_absorption", "[material] absorption"),
                    ("priority", "[material] priority"),
                ] {
                    if material
                        .get(key)
                        .is_some_and(|value| table::as_color(value) != Some([0.0; 3]))
                    {
                        self.note(feature, place);
                    }
                }
                format!(
                    "\"string type\" \"dielectric\" {}",
                    floats("eta", &[relative_ior(material)])
                )
            }
            "thin_dielectric" => {
                if self.constant(material, "tint", 1.0, place) != [1.0; 3] {
                    self.note("[material] tint", place);
                }
                format!(
                    "\"string type\" \"thindielectric\" {}",
                    floats("eta", &[relative_ior(material)])
                )
            }
            "mix" => {
                let weight = match material.get("weight") {
                    Some(weight) => self.texture(weight, true, place),
                    None => Pattern::Color([0.5; 3]),
                };
                if let Pattern::Color(color) = weight
                    && color != [color[0]; 3]
                {
                    self.note("[material] coloured weight", place);
                }
                let mut part = |key: &str| match material.get(key) {
                    Some(part) => self.named(part, place),
                    None => "interface".to_owned(),
                };
                let (a, b) = (part("a"), part("b"));
                format!(
                    "\"string type\" \"mix\" \"string materials\" [{} {}] {}",
                    quoted(&a),
                    quoted(&b),
                    parameter("amount", &weight, true)
                )
            }
            "phong" | "blinn_phong" | "whitted" => self.phong(material, place),
            "two_sided" => {
                let (front, back) = (material.get("front"), material.get("back"));
                if self.unlit(front) != self.unlit(back) {
                    self.note("[material] two_sided", place);
                }
                self.inner(material, "front", place)
            }
            "normal_map" | "bump" => {
                self.note("[material] normal_map, bump", place);
                self.inner(material, "material", place)
            }
            "reflection_map" => {
                self.note("[material] reflection_map", place);
                self.inner(material, "material", place)
            }
            "mask" => {
                self.note("[material] mask in another material", place);
                self.inner(material, "material", place)
            }
            "plastic" => {
                self.note("[material] plastic", place);
                let ior = relative_ior(material);
                let base = match self.look(material, "reflectance", 0.5, place) {
                    Pattern::Color(reflectance) => Pattern::Color(coat::albedo(reflectance, ior)),
                    named => named,
                };
                let text = format!(
                    "\"string type\" \"coateddiffuse\" {} {}",
                    parameter("reflectance", &base, false),
                    floats("eta", &[ior])
                );
                match material.get("samples").and_then(Value::as_integer) {
                    Some(2..) => format!("{text} {}", roughness(material)),
                    _ => text,
                }
            }
            "rough" => {
                self.note("[material] rough", place);
                let text = self.inner(material, "material", place);
                let takes = ["conductor", "dielectric"];
                match takes
                    .iter()
                    .any(|kind| text.starts_with(&format!("\"string type\" \"{kind}\"")))
                {
                    true => format!("{text} {}", roughness(material)),
                    false => text,
                }
            }
            "tabulated" => {
                self.note("[material] tabulated", place);
                diffuse(&Pattern::Color([0.5; 3]))
            }
            // Its radiance is the area light of the shape.
            "emissive" => self.inner(material, "material", place),
            _ => {
                self.note("[*] plugins of third parties", place);
                diffuse(&Pattern::Color([0.5; 3]))
            }
        }
    }

    /// A material without its emission, for comparison.
    fn unlit(&self, value: Option<&'a Value>) -> Option<&'a Value> {
        let value = value?;
        match self.plugin("material", value) {
            Some(material) if table::kind(material) == "emissive" => material.get("material"),
            _ => Some(value),
        }
    }

    /// A diffuse material, mixed with a metal for the reflection.
    fn phong(&mut self, material: &'a Table, place: &str) -> String {
        self.note("[material] phong, blinn_phong, whitted", place);
        let whitted = table::kind(material) == "whitted";
        let transmits = |value: &Value| table::as_color(value) != Some([0.0; 3]);
        if whitted && material.get("k_refr").is_some_and(transmits) {
            self.note("[material] k_refr", place);
        }
        let reflected = if whitted {
            mean(self.constant(material, "k_refl", 0.0, place)).min(1.0)
        } else {
            0.0
        };
        let diffused = match self.look(material, "k_d", if whitted { 0.0 } else { 0.5 }, place) {
            Pattern::Color(value) => {
                let rest = if reflected < 1.0 { 1.0 - reflected } else { 1.0 };
                Pattern::Color(value.map(|value| (PI * value / rest).min(1.0)))
            }
            texture => {
                self.note("[material] texture of k_d", place);
                texture
            }
        };
        if reflected == 0.0 {
            return diffuse(&diffused);
        }
        let (a, b) = (self.unique("diffuse"), self.unique("mirror"));
        let text = diffuse(&diffused);
        self.line(format!("MakeNamedMaterial {} {text}", quoted(&a)));
        self.line(format!(
            "MakeNamedMaterial {} \"string type\" \"conductor\" {}",
            quoted(&b),
            rgb("reflectance", [1.0; 3])
        ));
        format!(
            "\"string type\" \"mix\" \"string materials\" [{} {}] {}",
            quoted(&a),
            quoted(&b),
            floats("amount", &[reflected])
        )
    }

    /// The emission of a material, or of the sides of a two-sided one.
    pub(super) fn emission(&self, value: &'a Value) -> Option<Emission<'a>> {
        let material = self.plugin("material", value)?;
        let side = |key: &str| {
            let side = self.plugin("material", material.get(key)?)?;
            (table::kind(side) == "emissive").then_some(side)
        };
        let (front, back) = match table::kind(material) {
            "emissive" => (Some(material), Some(material)),
            "two_sided" => (side("front"), side("back")),
            _ => return None,
        };
        Some(Emission {
            radiance: front.or(back)?.get("radiance"),
            front: front.is_some(),
            back: back.is_some(),
        })
    }

    /// Whether a material depends on (u, v).
    pub(super) fn is_textured(&self, value: &'a Value) -> bool {
        let mut pending = vec![value];
        let mut seen = HashSet::new();
        while let Some(value) = pending.pop() {
            match value {
                Value::String(id) if seen.insert(id) => {
                    for family in ["material", "texture"] {
                        let shared = table::table(self.document, family);
                        pending.extend(shared.and_then(|shared| shared.get(id)));
                    }
                }
                Value::Table(table) => {
                    if matches!(table::kind(table), "image" | "checker" | "grid_lines") {
                        return true;
                    }
                    pending.extend(
                        table
                            .iter()
                            .filter(|(key, _)| *key != "type")
                            .map(|(_, value)| value),
                    );
                }
                Value::Array(values) => pending.extend(values),
                _ => {}
            }
        }
        false
    }

    /// Writes a texture, of float if that is needed.
    pub(super) fn texture(&mut self, value: &'a Value, float: bool, place: &str) -> Pattern {
        if let Some(color) = table::as_color(value) {
            return Pattern::Color(color);
        }
        let known = (key(value), float);
        if let Some(pattern) = self.textures.get(&known) {
            return pattern.clone();
        }
        let Some(texture) = self
            .plugin("texture", value)
            .filter(|_| self.depth <= MAX_NESTING)
        else {
            return Pattern::Color([0.5; 3]);
        };
        let place = value.as_str().unwrap_or(place);
        self.depth += 1;
        let pattern = match self.texture_text(texture, float, place) {
            Ok((text, space)) => {
                let name = self.unique(value.as_str().unwrap_or("texture"));
                let kind = if float { "float" } else { "spectrum" };
                let line = format!("Texture {} \"{kind}\" {text}", quoted(&name));
                match space {
                    None => self.line(line + "\n"),
                    Some(map) => {
                        let map = matrix(&map);
                        self.line(format!(
                            "TransformBegin\nConcatTransform {map}\n{line}\nTransformEnd\n"
                        ));
                    }
                }
                Pattern::Named(name)
            }
            Err(pattern) => pattern,
        };
        self.depth -= 1;
        self.textures.insert(known, pattern.clone());
        pattern
    }

    /// The class and parameters of a texture, and world from texture where that matters; or another
    /// pattern for one that has no counterpart.
    fn texture_text(
        &mut self,
        texture: &'a Table,
        float: bool,
        place: &str,
    ) -> Result<(String, Option<DAffine3>), Pattern> {
        match table::kind(texture) {
            "constant" => Err(Pattern::Color(table::color(texture, "value", [0.5; 3]))),
            "image" => {
                let mapping = self.mapping(texture, place)?;
                let file = table::text(texture, "file").unwrap_or_default();
                let lower = file.to_lowercase();
                if lower.ends_with(".gltf") || lower.ends_with(".glb") || lower.ends_with(".webp") {
                    return Err(self.mean_of(texture, "[texture] image of another format", place));
                }
                if !matches!(table::text(texture, "channel"), None | Some("color")) {
                    return Err(self.mean_of(texture, "[texture] image with a channel", place));
                }
                let mut line = format!("\"imagemap\" {}", text("filename", &self.copied(file)));
                match table::text(texture, "color_space") {
                    Some("linear") if lower.ends_with(".png") => {
                        line.push_str(" \"string encoding\" \"linear\"")
                    }
                    Some("linear") if !lower.ends_with(".exr") => self.note("[texture] color_space", place),
                    Some("srgb") if lower.ends_with(".exr") => self.note("[texture] color_space", place),
                    _ => {}
                }
                match table::text(texture, "filter") {
                    Some("nearest") => line.push_str(" \"string filter\" \"point\""),
                    Some("trilinear") => line.push_str(" \"string filter\" \"trilinear\""),
                    Some("ewa") => {
                        let limit = table::number(texture, "max_anisotropy").unwrap_or(16.0);
                        line.push_str(&format!(
                            " \"string filter\" \"EWA\" {}",
                            floats("maxanisotropy", &[limit])
                        ));
                    }
                    _ => {}
                }
                let word = |value: &Value| value.as_str().unwrap_or("repeat").to_owned();
                let wrap = match texture.get("wrap") {
                    Some(Value::Array(words)) => {
                        let words: Vec<String> = words.iter().map(word).collect();
                        if words.first() != words.last() {
                            self.note("[texture] wrap", place);
                        }
                        words.first().cloned().unwrap_or_default()
                    }
                    Some(value) => word(value),
                    None => "repeat".to_owned(),
                };
                match wrap.as_str() {
                    "clamp" => line.push_str(" \"string wrap\" \"clamp\""),
                    "mirror" => self.note("[texture] wrap", place),
                    _ => {}
                }
                Ok((line + &mapping, None))
            }
            "checker" => {
                let mapping = self.mapping(texture, place)?;
                let line = format!(
                    "\"checkerboard\" {} {}",
                    parameter(
                        "tex1",
                        &Pattern::Color(table::color(texture, "a", [0.8; 3])),
                        float
                    ),
                    parameter(
                        "tex2",
                        &Pattern::Color(table::color(texture, "b", [0.2; 3])),
                        float
                    )
                );
                Ok((line + &mapping, None))
            }
            "checker3d" => {
                let mapping = table::table(texture, "mapping");
                let projection = mapping.and_then(|mapping| table::text(mapping, "projection"));
                if !matches!(projection, None | Some("solid")) {
                    return Err(self.mean_of(texture, "[texture] mapping", place));
                }
                let map = mapping.map_or(DAffine3::IDENTITY, table::transform);
                let scale = table::number(texture, "scale").unwrap_or(1.0);
                let offset = table::vector(texture, "offset").unwrap_or(DVec3::ZERO);
                let map =
                    DAffine3::from_translation(offset) * DAffine3::from_scale(DVec3::splat(scale)) * map;
                let line = format!(
                    "\"checkerboard\" \"integer dimension\" [3] {} {}",
                    parameter(
                        "tex1",
                        &Pattern::Color(table::color(texture, "a", [0.8; 3])),
                        float
                    ),
                    parameter(
                        "tex2",
                        &Pattern::Color(table::color(texture, "b", [0.2; 3])),
                        float
                    )
                );
                Ok((line, (map != DAffine3::IDENTITY).then(|| map.inverse())))
            }
            "mix" => {
                let mut part = |key: &str, float: bool, default: f64| match texture.get(key) {
                    Some(value) => self.texture(value, float, place),
                    None => Pattern::Color([default; 3]),
                };
                let (a, b) = (part("a", float, 0.0), part("b", float, 1.0));
                let weight = part("weight", true, 0.5);
                if let Pattern::Color(color) = weight
                    && color != [color[0]; 3]
                {
                    self.note("[material] coloured weight", place);
                }
                let line = format!(
                    "\"mix\" {} {} {}",
                    parameter("tex1", &a, float),
                    parameter("tex2", &b, float),
                    parameter("amount", &weight, true)
                );
                Ok((line, None))
            }
            "product" => {
                let factors = texture.get("factors").and_then(Value::as_array);
                let mut constant = [1.0; 3];
                let mut names = Vec::new();
                for factor in factors.into_iter().flatten() {
                    match self.texture(factor, float, place) {
                        Pattern::Color(value) => constant = [0, 1, 2].map(|i| constant[i] * value[i]),
                        Pattern::Named(name) => names.push(name),
                    }
                }
                let Some(first) = names.first() else {
                    return Err(Pattern::Color(constant));
                };
                if names.len() > 1 || constant != [constant[0]; 3] {
                    self.note("[texture] product", place);
                }
                let line = format!(
                    "\"scale\" {} {}",
                    parameter("tex", &Pattern::Named(first.clone()), float),
                    floats("scale", &[mean(constant)])
                );
                Ok((line, None))
            }
            _ => Err(self.mean_of(texture, "[texture] of another type", place)),
        }
    }

    /// The mean of the colours a and b, or grey.
    fn mean_of(&mut self, texture: &Table, feature: &str, place: &str) -> Pattern {
        self.note(feature, place);
        let (a, b) = (
            table::color(texture, "a", [0.8; 3]),
            table::color(texture, "b", [0.2; 3]),
        );
        Pattern::Color([0, 1, 2].map(|i| (a[i] + b[i]) / 2.0))
    }

    /// The parameters of the mapping of a texture by (u, v) or in a plane.
    fn mapping(&mut self, texture: &'a Table, place: &str) -> Result<String, Pattern> {
        let scale = table::pair(texture, "scale", 1.0);
        let offset = table::pair(texture, "offset", 0.0);
        let empty = Table::new();
        let mapping = table::table(texture, "mapping").unwrap_or(&empty);
        let by = DAffine3::from_mat3_translation(
            DMat3::from_diagonal(DVec3::new(scale[0], scale[1], 1.0)),
            DVec3::new(offset[0], offset[1], 0.0),
        );
        let map = by * table::transform(mapping);
        let [x, y] = [map.matrix3.row(0), map.matrix3.row(1)];
        let moved = map.translation;
        let delta = |line: &mut String| {
            for (name, value) in [("udelta", moved.x), ("vdelta", moved.y)] {
                if value != 0.0 {
                    line.push_str(&format!(" {}", floats(name, &[value])));
                }
            }
        };
        let mut line = String::new();
        match table::text(mapping, "projection") {
            None | Some("uv") if x.y == 0.0 && y.x == 0.0 && !mapping.contains_key("uv_set") => {
                for (name, value) in [("uscale", x.x), ("vscale", y.y)] {
                    if value != 1.0 {
                        line.push_str(&format!(" {}", floats(name, &[value])));
                    }
                }
                delta(&mut line);
            }
            Some("planar") => {
                line.push_str(" \"string mapping\" \"planar\"");
                for (name, row) in [("v1", x), ("v2", y)] {
                    line.push_str(&format!(" \"vector3 {name}\" {}", super::list(&row.to_array())));
                }
                delta(&mut line);
            }
            _ => return Err(self.mean_of(texture, "[texture] mapping", place)),
        }
        Ok(line)
    }
}

fn diffuse(reflectance: &Pattern) -> String {
    format!(
        "\"string type\" \"diffuse\" {}",
        parameter("reflectance", reflectance, false)
    )
}

/// The roughness that is as wide as the lobe of a material.
fn roughness(material: &Table) -> String {
    let alpha = floats("roughness", &[table::alpha(material)]);
    format!("{alpha} \"bool remaproughness\" false")
}

/// The index of refraction of the inside relative to the outside.
fn relative_ior(material: &Table) -> f64 {
    let ior = |key: &str, default: f64| table::number(material, key).unwrap_or(default);
    ior("interior_ior", 1.5) / ior("exterior_ior", 1.0)
}
