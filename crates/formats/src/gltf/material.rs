//! Materials.
//!
//! A metallic-roughness material has a base colour c, a metalness m and a roughness r. It becomes
//! the material `whitted` with
//!
//! - the diffuse albedo D = c (1 - m (1 - r)): a rough metal scatters widely, a smooth one
//!   reflects; `k_d` = D/pi, `k_a` = D;
//! - the reflectance at normal incidence F = f (1 - m) + c m, f = ((ior - 1)/(ior + 1))², 0.04 by
//!   default, times the factor and the colour of KHR_materials_specular;
//! - a highlight `k_s` = F (1 - r) (e + 1)/(2 pi), whose lobe then reflects F (1 - r) in all. The
//!   exponent e = max(1, (2/r⁴ - 2)/4) is that of a Blinn-Phong lobe with the same width, over 4 as
//!   angles to r count twice (Walter et al., *Microfacet models for refraction*, EGSR 2007; Fisher
//!   and Woo, *R.E versus N.H specular highlights*, Graphics Gems IV), and at most 2000;
//! - mirror reflection `k_refl` = F (1 - r)² where r < 0.5.

use super::import::{Importer, shortest};
use super::sampler::TextureUse;
use crate::document::{color, table};
use std::f64::consts::PI;
use toml::{Table, Value};
use whitstone_core::FormatError;
use whitstone_gltf::Document;
use whitstone_gltf::json;
use whitstone_gltf::json::extensions::texture::TextureTransform;
use whitstone_gltf::json::material::AlphaMode;
use whitstone_gltf::json::validation::Checked;

/// A material, and what its meshes must provide.
#[derive(Clone, Debug, Default)]
pub(crate) struct Translated {
    /// Id of the shared material.
    pub(crate) id: String,
    /// The sets of texture coordinates that it uses.
    pub(crate) uv_sets: Vec<u32>,
    /// Whether it reads vertex colours.
    pub(crate) colors: bool,
    /// Whether it reads tangents.
    pub(crate) tangents: bool,
}

/// Roughness from which on mirror reflection is not followed.
const ROUGH: f64 = 0.5;
/// Largest exponent of a highlight.
const MAX_EXPONENT: f64 = 2000.0;
/// Reflectance at normal incidence at the default index of refraction, 1.5.
const DIELECTRIC: f64 = 0.04;

/// Extensions of materials that have no effect, which the table of features names.
const WITHOUT_EFFECT: [&str; 7] = [
    "KHR_materials_clearcoat",
    "KHR_materials_sheen",
    "KHR_materials_iridescence",
    "KHR_materials_anisotropy",
    "KHR_materials_dispersion",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_pbrSpecularGlossiness",
];

/// A colour parameter: a constant or the value of a texture key.
#[derive(Clone, Debug, PartialEq)]
enum Source {
    Constant([f64; 3]),
    Texture(Value),
}

impl Source {
    const ONE: Self = Self::Constant([1.0; 3]);

    fn grey(value: f64) -> Self {
        Self::Constant([value; 3])
    }

    fn is(&self, value: f64) -> bool {
        matches!(self, Self::Constant(color) if *color == [value; 3])
    }

    fn value(self) -> Value {
        match self {
            Self::Constant(value) => color(value),
            Self::Texture(value) => value,
        }
    }

    /// The product; constants are multiplied here.
    fn product(factors: impl IntoIterator<Item = Self>) -> Self {
        let mut constant = [1.0; 3];
        let mut textures = Vec::new();
        for factor in factors {
            match factor {
                Self::Constant(value) => {
                    for (part, factor) in constant.iter_mut().zip(value) {
                        *part *= factor;
                    }
                }
                Self::Texture(value) => textures.push(value),
            }
        }
        if textures.is_empty() || constant == [0.0; 3] {
            return Self::Constant(constant);
        }
        if constant != [1.0; 3] {
            textures.insert(0, color(constant));
        }
        match textures.as_slice() {
            [one] => Self::Texture(one.clone()),
            _ => Self::Texture(Value::Table(table([
                ("type", Value::String("product".into())),
                ("factors", Value::Array(textures)),
            ]))),
        }
    }

    /// a (1 - weight) + b weight.
    fn mix(a: Self, b: Self, weight: &Self) -> Self {
        match (&a, &b, weight) {
            (Self::Constant(a), Self::Constant(b), Self::Constant(weight)) => {
                Self::Constant(std::array::from_fn(|k| {
                    a[k] * (1.0 - weight[k]) + b[k] * weight[k]
                }))
            }
            _ if weight.is(0.0) || a == b => a,
            _ if weight.is(1.0) => b,
            _ => Self::Texture(Value::Table(table([
                ("type", Value::String("mix".into())),
                ("a", a.value()),
                ("b", b.value()),
                ("weight", weight.clone().value()),
            ]))),
        }
    }
}

/// The textures of a material, by their keys in the file.
struct Textures {
    base: Option<TextureUse>,
    metallic_roughness: Option<TextureUse>,
    normal: Option<TextureUse>,
    emissive: Option<TextureUse>,
    transmission: Option<TextureUse>,
}

impl Textures {
    fn of(material: &json::Material, at: &str) -> Self {
        let info = |info: &Option<json::texture::Info>, key: &str| {
            info.as_ref().map(|info| TextureUse {
                texture: info.index.value(),
                tex_coord: info.tex_coord,
                transform: info
                    .extensions
                    .as_ref()
                    .and_then(|extensions| extensions.texture_transform.clone()),
                pointer: format!("{at}/{key}"),
            })
        };
        let pbr = &material.pbr_metallic_roughness;
        Self {
            base: info(&pbr.base_color_texture, "pbrMetallicRoughness/baseColorTexture"),
            metallic_roughness: info(
                &pbr.metallic_roughness_texture,
                "pbrMetallicRoughness/metallicRoughnessTexture",
            ),
            normal: material.normal_texture.as_ref().map(|normal| TextureUse {
                texture: normal.index.value(),
                tex_coord: normal.tex_coord,
                transform: normal
                    .extensions
                    .as_ref()
                    .and_then(|extensions| extensions.others.get("KHR_texture_transform"))
                    .and_then(|value| json::deserialize::from_value::<TextureTransform>(value.clone()).ok()),
                pointer: format!("{at}/normalTexture"),
            }),
            emissive: info(&material.emissive_texture, "emissiveTexture"),
            transmission: material
                .extensions
                .as_ref()
                .and_then(|extensions| extensions.transmission.as_ref())
                .and_then(|transmission| {
                    let key = "extensions/KHR_materials_transmission/transmissionTexture";
                    info(&transmission.transmission_texture, key)
                }),
        }
    }

    /// The sets of texture coordinates in use, at most two. That of the normal map comes first,
    /// since tangents are computed from it.
    fn sets(&self) -> Vec<u32> {
        let mut sets: Vec<u32> = Vec::new();
        for used in [
            &self.normal,
            &self.base,
            &self.emissive,
            &self.metallic_roughness,
            &self.transmission,
        ]
        .into_iter()
        .flatten()
        {
            if !sets.contains(&used.set()) && sets.len() < 2 {
                sets.push(used.set());
            }
        }
        sets
    }
}

impl Importer<'_> {
    /// The material of a primitive. `colors` and `tangents` say which attributes it has.
    pub(crate) fn material(
        &mut self,
        index: Option<usize>,
        colors: bool,
        tangents: bool,
        place: &str,
    ) -> Result<Translated, FormatError> {
        if let Some(known) = self.translated.get(&(index, colors)) {
            return Ok(known.clone());
        }
        let root = &self.document.root;
        let nothing = json::Material::default();
        let (material, at) = match index {
            None => {
                self.note("no material", place);
                (&nothing, String::new())
            }
            Some(index) => {
                let pointer = || format!("{place}/material");
                let found =
                    Document::item(&root.materials, index, "materials", pointer).map_err(self.told())?;
                (found, format!("/materials/{index}"))
            }
        };
        let name = material.name.clone().unwrap_or_else(|| match index {
            Some(index) => format!("material{index}"),
            None => "default".to_owned(),
        });
        let translated = if let Some(id) = self.options.materials.get(&name) {
            // The other material may read anything.
            Translated {
                id: id.clone(),
                uv_sets: vec![0],
                colors,
                tangents: false,
            }
        } else {
            self.whole(material, &at, &name, colors, tangents)?
        };
        self.translated.insert((index, colors), translated.clone());
        Ok(translated)
    }

    fn whole(
        &mut self,
        material: &json::Material,
        at: &str,
        name: &str,
        colors: bool,
        tangents: bool,
    ) -> Result<Translated, FormatError> {
        self.dropped(material, at);
        let textures = Textures::of(material, at);
        let sets = textures.sets();
        let extensions = material.extensions.clone().unwrap_or_default();
        let pbr = &material.pbr_metallic_roughness;
        let [r, g, b, alpha] = pbr.base_color_factor.0.map(number);
        let vertex = |channel: &str| {
            let mut keys = table([("type", Value::String("vertex_color".into()))]);
            if channel != "color" {
                keys.insert("channel".into(), Value::String(channel.into()));
            }
            Source::Texture(Value::Table(keys))
        };
        let vertex_colors = if colors { vertex("color") } else { Source::ONE };
        let base_image = match &textures.base {
            Some(used) => self.source(used, "color", None, &sets)?,
            None => Source::ONE,
        };
        let base = Source::product([Source::Constant([r, g, b]), base_image, vertex_colors]);

        let mut refracts = false;
        let mut surface = if extensions.unlit.is_some() {
            self.note("KHR_materials_unlit", at);
            table([
                ("type", Value::String("emissive".into())),
                ("radiance", base.value()),
            ])
        } else {
            let (surface, glass) = self.lit(material, &extensions, &textures, &sets, base, at)?;
            refracts = glass;
            surface
        };
        let mut mapped = false;
        if let (Some(used), Some(normal), None) =
            (&textures.normal, &material.normal_texture, &extensions.unlit)
            && let Some(map) = self.texture(used, "color", Some("linear"), &sets)?
        {
            mapped = true;
            if !tangents {
                self.note("tangents from texture coordinates", at);
            }
            let mut keys = table([
                ("type", Value::String("normal_map".into())),
                ("map", map),
                ("tangent", Value::String("mesh".into())),
                ("material", Value::Table(surface)),
            ]);
            let strength = shortest(normal.scale);
            if strength != 1.0 {
                keys.insert("strength".into(), Value::Float(strength));
            }
            surface = keys;
        }
        if extensions.unlit.is_none() {
            surface = self.emission(material, &extensions, &textures, &sets, surface)?;
        }
        let mode = match material.alpha_mode {
            Checked::Valid(mode) => mode,
            Checked::Invalid => {
                let place = format!("{at}/alphaMode");
                return Err(FormatError::at(
                    place,
                    "expected \"OPAQUE\", \"MASK\" or \"BLEND\"",
                ));
            }
        };
        let mut alphas = false;
        if mode != AlphaMode::Opaque {
            let image = match &textures.base {
                Some(used) => self.source(used, "alpha", None, &sets)?,
                None => Source::ONE,
            };
            alphas = colors;
            let of_vertices = if colors { vertex("alpha") } else { Source::ONE };
            let mut opacity = Source::product([Source::grey(alpha.min(1.0)), image, of_vertices]);
            if mode == AlphaMode::Mask {
                let cutoff = material.alpha_cutoff.unwrap_or_default().0;
                opacity = match opacity {
                    Source::Constant([value, ..]) => Source::grey(f64::from(value as f32 >= cutoff)),
                    Source::Texture(value) => Source::Texture(Value::Table(table([
                        ("type", Value::String("threshold".into())),
                        ("input", value),
                        ("at", Value::Float(number(cutoff))),
                    ]))),
                };
            }
            if refracts && !opacity.is(1.0) {
                self.note("alpha of refracting materials", at);
            } else if !opacity.is(1.0) {
                let feature = match mode {
                    AlphaMode::Mask => "alpha mode MASK",
                    AlphaMode::Blend | AlphaMode::Opaque => "alpha mode BLEND",
                };
                self.note(feature, at);
                surface = table([
                    ("type", Value::String("mask".into())),
                    ("opacity", opacity.value()),
                    ("material", Value::Table(surface)),
                ]);
            }
        }
        if !material.double_sided {
            self.note("single-sided materials", at);
        }
        let id = self.ids.unique(name);
        self.scene.materials.push((id.clone(), surface));
        Ok(Translated {
            id,
            uv_sets: sets,
            colors: colors || alphas,
            tangents: mapped,
        })
    }

    /// The surface without normal map, emission and alpha, and whether it refracts.
    fn lit(
        &mut self,
        material: &json::Material,
        extensions: &json::extensions::material::Material,
        textures: &Textures,
        sets: &[u32],
        base: Source,
        at: &str,
    ) -> Result<(Table, bool), FormatError> {
        let pbr = &material.pbr_metallic_roughness;
        let roughness = number(pbr.roughness_factor.0).min(1.0);
        let mut metalness = Source::grey(number(pbr.metallic_factor.0).min(1.0));
        if let Some(used) = &textures.metallic_roughness {
            if !metalness.is(0.0) {
                let image = self.source(used, "blue", Some("linear"), sets)?;
                metalness = Source::product([metalness, image]);
            }
            self.note("roughness texture", at);
        }
        self.note("metallic-roughness", at);
        let ior = extensions.ior.as_ref().map_or(1.5, |ior| number(ior.ior.0));
        let mut normal = [DIELECTRIC; 3];
        if extensions.ior.is_some() {
            self.note("KHR_materials_ior", at);
            // The value 0 stands for a reflectance of 1.
            normal = [if ior == 0.0 {
                1.0
            } else {
                ((ior - 1.0) / (ior + 1.0)).powi(2)
            }; 3];
        }
        if let Some(specular) = &extensions.specular {
            self.note("KHR_materials_specular", at);
            let factor = number(specular.specular_factor.0);
            for (part, tint) in normal.iter_mut().zip(specular.specular_color_factor.0) {
                *part = (*part * number(tint)).min(1.0) * factor;
            }
        }
        let share = Source::grey(1.0 - roughness);
        let diffuse = Source::mix(
            base.clone(),
            Source::product([base.clone(), Source::grey(roughness)]),
            &metalness,
        );
        let facing = Source::mix(Source::Constant(normal), base.clone(), &metalness);
        let exponent = (2.0 / roughness.powi(4).max(1e-12) - 2.0) / 4.0;
        let exponent = exponent.clamp(1.0, MAX_EXPONENT);
        let highlight = Source::product([
            facing.clone(),
            share.clone(),
            Source::grey((exponent + 1.0) / (2.0 * PI)),
        ]);
        let mut surface = table([
            ("type", Value::String("whitted".into())),
            (
                "k_d",
                Source::product([diffuse.clone(), Source::grey(1.0 / PI)]).value(),
            ),
            ("k_a", diffuse.value()),
        ]);
        if !highlight.is(0.0) {
            surface.insert("k_s".into(), highlight.value());
            surface.insert("exponent".into(), Value::Float(exponent));
        }
        if roughness < ROUGH {
            let mirror = Source::product([facing, share.clone(), share]);
            surface.insert("k_refl".into(), mirror.value());
        }
        let Some(transmission) = &extensions.transmission else {
            return Ok((surface, false));
        };
        // Metals transmit nothing.
        let mut weight = Source::product([
            Source::grey(number(transmission.transmission_factor.0).min(1.0)),
            Source::mix(Source::ONE, Source::grey(0.0), &metalness),
        ]);
        if let (Some(used), false) = (&textures.transmission, weight.is(0.0)) {
            let image = self.source(used, "red", Some("linear"), sets)?;
            weight = Source::product([weight, image]);
        }
        self.note("KHR_materials_transmission", at);
        if weight.is(0.0) {
            return Ok((surface, false));
        }
        let volume = extensions.volume.as_ref();
        let thick = volume.is_some_and(|volume| volume.thickness_factor.0 > 0.0);
        let ior = if ior == 0.0 { 1.5 } else { ior };
        let glass = if let (true, Some(volume)) = (thick, volume) {
            self.note("KHR_materials_volume", at);
            // From the transmittance over a distance; black would be an infinite absorption.
            let absorption = |part: f64, distance: f64| {
                if distance > 0.0 && distance.is_finite() {
                    -libm::log(part.clamp(1e-6, 1.0)) / distance
                } else {
                    0.0
                }
            };
            let distance = number(volume.attenuation_distance.0);
            let mut total = volume
                .attenuation_color
                .0
                .map(|part| absorption(number(part), distance));
            // The base colour tints the light at the surface. A `dielectric` has no such tint, so
            // the volume absorbs it.
            if !base.is(1.0) {
                self.note("base colour of a volume", at);
            }
            if let Source::Constant(base) = &base {
                let thickness = number(volume.thickness_factor.0);
                for (total, part) in total.iter_mut().zip(base) {
                    *total += absorption(*part, thickness);
                }
            }
            table([
                ("type", Value::String("dielectric".into())),
                ("interior_ior", Value::Float(ior)),
                ("absorption", color(total)),
            ])
        } else {
            table([
                ("type", Value::String("thin_dielectric".into())),
                ("interior_ior", Value::Float(ior)),
                ("tint", base.value()),
            ])
        };
        if weight.is(1.0) {
            return Ok((glass, thick));
        }
        let mixed = table([
            ("type", Value::String("mix".into())),
            ("a", Value::Table(surface)),
            ("b", Value::Table(glass)),
            ("weight", weight.value()),
        ]);
        Ok((mixed, thick))
    }

    fn emission(
        &mut self,
        material: &json::Material,
        extensions: &json::extensions::material::Material,
        textures: &Textures,
        sets: &[u32],
        surface: Table,
    ) -> Result<Table, FormatError> {
        let factor = material.emissive_factor.0.map(number);
        let strength = extensions.emissive_strength.as_ref();
        let strength = strength.map_or(1.0, |strength| number(strength.emissive_strength.0));
        if factor == [0.0; 3] || strength == 0.0 {
            return Ok(surface);
        }
        let image = match &textures.emissive {
            Some(used) => self.source(used, "color", None, sets)?,
            None => Source::ONE,
        };
        let radiance = Source::product([Source::Constant(factor), Source::grey(strength), image]);
        Ok(table([
            ("type", Value::String("emissive".into())),
            ("radiance", radiance.value()),
            ("material", Value::Table(surface)),
        ]))
    }

    fn source(
        &mut self,
        used: &TextureUse,
        channel: &str,
        color_space: Option<&str>,
        sets: &[u32],
    ) -> Result<Source, FormatError> {
        let found = self.texture(used, channel, color_space, sets)?;
        Ok(found.map_or(Source::ONE, Source::Texture))
    }

    /// Notes the parts of a material that have no effect.
    fn dropped(&mut self, material: &json::Material, at: &str) {
        if material.occlusion_texture.is_some() {
            self.note("occlusion textures", at);
        }
        let others = material
            .extensions
            .iter()
            .flat_map(|extensions| extensions.others.keys());
        for name in others {
            match WITHOUT_EFFECT.iter().find(|known| *known == name) {
                Some(known) => self.note(known, at),
                None => self.note("unknown extensions", &format!("{at}/extensions/{name}")),
            }
        }
    }
}

/// A number that must not be negative; others count as 0.
fn number(value: f32) -> f64 {
    let value = shortest(value);
    if value.is_nan() { 0.0 } else { value.max(0.0) }
}
