//! Parses the tables of materials.

use super::medium::Medium;
use super::tabulated::Brdf;
use super::{Highlight, Interface, Kind, diffuse_transmittance, lobe};
use crate::tracer::light::{Faces, Sky};
use crate::tracer::tangent::Tangent;
use crate::tracer::texture::{Texture, table};
use crate::tracer::unknown;
use serde::Deserialize;
use whitstone_core::config::{Color, PluginRef, TextureRef, decode};
use whitstone_core::{Rgb, SceneError, SceneErrors};
use whitstone_scene::{Description, ShapeTable};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Matte {
    reflectance: Option<TextureRef>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Glossy {
    reflectance: Option<TextureRef>,
    exponent: Option<f64>,
    samples: Option<u32>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Plastic {
    reflectance: Option<TextureRef>,
    interior_ior: Option<f64>,
    exterior_ior: Option<f64>,
    exponent: Option<f64>,
    samples: Option<u32>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Tabulated {
    values: Vec<Vec<Color>>,
    spacing: Option<String>,
    tint: Option<TextureRef>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Gloss {
    k_d: Option<TextureRef>,
    k_s: Option<TextureRef>,
    k_a: Option<TextureRef>,
    exponent: Option<f64>,
    k_refl: Option<TextureRef>,
    k_refr: Option<TextureRef>,
    interior_ior: Option<f64>,
    exterior_ior: Option<f64>,
    absorption: Option<Color>,
    exterior_absorption: Option<Color>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Glass {
    interior_ior: Option<f64>,
    exterior_ior: Option<f64>,
    absorption: Option<Color>,
    exterior_absorption: Option<Color>,
    priority: Option<u32>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Pane {
    interior_ior: Option<f64>,
    exterior_ior: Option<f64>,
    tint: Option<TextureRef>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Metal {
    metal: Option<String>,
    eta: Option<Color>,
    k: Option<Color>,
    tint: Option<TextureRef>,
}

/// The id of a material, or an inline material.
struct MaterialRef(PluginRef);

impl<'de> Deserialize<'de> for MaterialRef {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        Ok(Self(text.as_str().into()))
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Emissive {
    radiance: Option<TextureRef>,
    material: Option<MaterialRef>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Mix {
    a: MaterialRef,
    b: MaterialRef,
    weight: Option<TextureRef>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sides {
    front: MaterialRef,
    back: MaterialRef,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Mask {
    opacity: Option<TextureRef>,
    material: MaterialRef,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Rough {
    material: MaterialRef,
    exponent: Option<f64>,
    samples: Option<u32>,
}

/// A vector, or `"mesh"`.
#[derive(Deserialize)]
#[serde(untagged)]
enum GivenTangent {
    Vector([f64; 3]),
    Name(String),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NormalMap {
    map: TextureRef,
    strength: Option<f64>,
    tangent: Option<GivenTangent>,
    axis: Option<[f64; 3]>,
    material: MaterialRef,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Mapped {
    radiance: Option<TextureRef>,
    faces: Option<Faces>,
    material: MaterialRef,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Bump {
    height: Option<TextureRef>,
    vector_map: Option<TextureRef>,
    space: Option<String>,
    tangent: Option<[f64; 3]>,
    axis: Option<[f64; 3]>,
    scale: Option<f64>,
    step: Option<f64>,
    material: MaterialRef,
}

/// Named metals: eta and k.
const METALS: [(&str, [f64; 3], [f64; 3]); 10] = [
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

/// The priority and the medium of a shape that is a prioritised dielectric.
pub(super) fn body(
    description: &Description<'_>,
    shape: &ShapeTable<'_>,
) -> Result<Option<(u32, Medium)>, SceneErrors> {
    let reference = shape.material.as_ref().map(|(_, reference)| reference);
    let plugin = reference.and_then(|reference| table(description, &description.materials, reference));
    let Some(plugin) = plugin.filter(|plugin| plugin.name == "dielectric") else {
        return Ok(None);
    };
    let glass: Glass = decode(&plugin.table)?;
    let medium = Medium {
        ior: glass.interior_ior.unwrap_or(1.5),
        absorption: glass.absorption.map_or(Rgb::splat(0.0), Color::get),
    };
    Ok(glass.priority.map(|priority| (priority, medium)))
}

/// A material whose rays are spread over n x n directions.
fn spread(inner: Box<Kind>, n: u32, exponent: Option<f64>) -> Kind {
    Kind::Spread(inner, lobe(n, exponent.unwrap_or(100.0)))
}

/// Where materials are looked up.
pub(super) struct Source<'a, 's> {
    pub(super) description: &'a Description<'s>,
}

impl Source<'_, '_> {
    fn texture(&self, given: Option<TextureRef>, default: f64) -> Result<Texture, SceneErrors> {
        let given = given.unwrap_or(TextureRef::grey(default));
        Texture::new(self.description, &given)
    }

    fn boxed(&self, reference: &MaterialRef) -> Result<Box<Kind>, SceneErrors> {
        self.kind(&reference.0).map(Box::new)
    }

    pub(super) fn kind(&self, reference: &PluginRef) -> Result<Kind, SceneErrors> {
        let plugin = table(self.description, &self.description.materials, reference);
        let plugin = plugin.ok_or_else(|| SceneError::anywhere("no such material"))?;
        Ok(match &*plugin.name {
            "matte" => Kind::Matte(self.texture(decode::<Matte>(&plugin.table)?.reflectance, 0.5)?),
            "glossy" => {
                let glossy: Glossy = decode(&plugin.table)?;
                let mirror = Box::new(Kind::Mirror(self.texture(glossy.reflectance, 1.0)?));
                spread(mirror, glossy.samples.unwrap_or(4), glossy.exponent)
            }
            "rough" => {
                let rough: Rough = decode(&plugin.table)?;
                spread(
                    self.boxed(&rough.material)?,
                    rough.samples.unwrap_or(4),
                    rough.exponent,
                )
            }
            "plastic" => {
                let plastic: Plastic = decode(&plugin.table)?;
                let index = plastic.interior_ior.unwrap_or(1.5) / plastic.exterior_ior.unwrap_or(1.0);
                let coated = Kind::Plastic {
                    reflectance: self.texture(plastic.reflectance, 0.5)?,
                    index,
                    entered: diffuse_transmittance(index),
                };
                spread(Box::new(coated), plastic.samples.unwrap_or(1), plastic.exponent)
            }
            "tabulated" => {
                let given: Tabulated = decode(&plugin.table)?;
                let rows = given.values.iter();
                let rows = rows.map(|row| row.iter().map(|value| value.get()).collect::<Vec<_>>());
                let square_root = given.spacing.as_deref() == Some("square_root");
                let brdf = Brdf::new(rows.collect(), square_root);
                let brdf = brdf.ok_or_else(|| unknown(plugin, "table of the material"))?;
                Kind::Tabulated(brdf, self.texture(given.tint, 1.0)?)
            }
            "mirror" => Kind::Mirror(self.texture(decode::<Matte>(&plugin.table)?.reflectance, 1.0)?),
            "dielectric" => {
                let glass: Glass = decode(&plugin.table)?;
                Kind::Dielectric(Interface::new(
                    [glass.interior_ior, glass.exterior_ior],
                    [glass.absorption, glass.exterior_absorption],
                ))
            }
            "thin_dielectric" => {
                let pane: Pane = decode(&plugin.table)?;
                let [interior, exterior] =
                    [pane.interior_ior.unwrap_or(1.5), pane.exterior_ior.unwrap_or(1.0)];
                Kind::Pane(interior / exterior, self.texture(pane.tint, 1.0)?)
            }
            "conductor" => {
                let metal: Metal = decode(&plugin.table)?;
                let named = METALS
                    .iter()
                    .find(|(name, ..)| Some(*name) == metal.metal.as_deref());
                let [eta, k] = match (named, metal.eta, metal.k) {
                    (Some((_, eta, k)), ..) => [*eta, *k].map(Rgb::from),
                    (None, Some(eta), Some(k)) => [eta.get(), k.get()],
                    _ => return Err(unknown(plugin, "metal of")),
                };
                Kind::Metal {
                    eta,
                    k,
                    tint: self.texture(metal.tint, 1.0)?,
                }
            }
            "emissive" => {
                let emissive: Emissive = decode(&plugin.table)?;
                let inner = emissive.material.as_ref().map(|inner| self.boxed(inner));
                Kind::Emissive(self.texture(emissive.radiance, 1.0)?, inner.transpose()?)
            }
            "reflection_map" => {
                let mapped: Mapped = decode(&plugin.table)?;
                let map = Sky::new(self.description, mapped.radiance.as_ref(), mapped.faces.as_ref())?;
                Kind::Mapped(map, self.boxed(&mapped.material)?)
            }
            "mix" => {
                let mix: Mix = decode(&plugin.table)?;
                let both = [self.boxed(&mix.a)?, self.boxed(&mix.b)?];
                Kind::Mix(self.texture(mix.weight, 0.5)?, both)
            }
            "two_sided" => {
                let sides: Sides = decode(&plugin.table)?;
                Kind::Sides([self.boxed(&sides.front)?, self.boxed(&sides.back)?])
            }
            "mask" => {
                let mask: Mask = decode(&plugin.table)?;
                Kind::Mask(self.texture(mask.opacity, 0.5)?, self.boxed(&mask.material)?)
            }
            "normal_map" => {
                let config: NormalMap = decode(&plugin.table)?;
                let tangent = match config.tangent {
                    None => Tangent::new(None, config.axis),
                    Some(GivenTangent::Vector(along)) => Tangent::new(Some(along), config.axis),
                    Some(GivenTangent::Name(name)) if name == "mesh" => Tangent::Mesh,
                    Some(GivenTangent::Name(_)) => return Err(unknown(plugin, "tangent of")),
                };
                Kind::NormalMap {
                    map: self.texture(Some(config.map), 0.0)?,
                    tangent,
                    strength: config.strength.unwrap_or(1.0),
                    inner: self.boxed(&config.material)?,
                }
            }
            "bump" => {
                let bump: Bump = decode(&plugin.table)?;
                let scale = bump.scale.unwrap_or(1.0);
                let inner = self.boxed(&bump.material)?;
                match bump.vector_map {
                    Some(vectors) => {
                        let own = bump.space.as_deref() == Some("tangent");
                        let tangent = own.then(|| Tangent::new(bump.tangent, bump.axis));
                        Kind::BumpVectors(self.texture(Some(vectors), 0.0)?, scale, tangent, inner)
                    }
                    None => Kind::Bump {
                        height: self.texture(bump.height, 0.0)?,
                        scale,
                        step: bump.step.unwrap_or(1e-3),
                        inner,
                    },
                }
            }
            "phong" | "blinn_phong" | "whitted" => {
                let whitted = plugin.name == "whitted";
                let gloss: Gloss = decode(&plugin.table)?;
                let default = if whitted { 0.0 } else { 0.5 };
                let ambient = gloss.k_a.or_else(|| gloss.k_d.clone());
                let interface = Interface::new(
                    [gloss.interior_ior, gloss.exterior_ior],
                    [gloss.absorption, gloss.exterior_absorption],
                );
                let specular_rays = [self.texture(gloss.k_refl, 0.0)?, self.texture(gloss.k_refr, 0.0)?];
                Kind::Gloss {
                    k: Box::new([
                        self.texture(gloss.k_d, default)?,
                        self.texture(gloss.k_s, default)?,
                        self.texture(ambient, default)?,
                    ]),
                    exponent: gloss.exponent.unwrap_or(32.0),
                    highlight: match plugin.name == "blinn_phong" {
                        true => Highlight::Blinn,
                        false => Highlight::Phong,
                    },
                    specular_rays: whitted.then(|| Box::new((specular_rays, interface))),
                }
            }
            _ => return Err(unknown(plugin, "material")),
        })
    }
}
