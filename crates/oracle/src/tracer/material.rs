//! Section 8.

use super::texture::{Texture, table};
use super::{unknown, unknown_part};
use serde::Deserialize;
use std::f64::consts::PI;
use whitstone_core::config::{Color, PluginRef, TextureRef, decode};
use whitstone_core::{DVec2, DVec3, Rgb, SceneError, SceneErrors};
use whitstone_scene::{Description, ShapeTable};

/// What a ray travels in.
#[derive(Clone, Copy, Debug)]
pub(super) struct Medium(Rgb);

impl Default for Medium {
    fn default() -> Self {
        Self(Rgb::splat(0.0))
    }
}

impl Medium {
    pub(super) fn over(self, length: f64) -> Rgb {
        self.0.map(|a| (-a * length).exp())
    }

    pub(super) fn endless(self) -> Rgb {
        self.0.map(|a| if a == 0.0 { 1.0 } else { 0.0 })
    }
}

/// A direction in which a ray goes on.
pub(super) struct Branch {
    pub(super) direction: DVec3,
    pub(super) weight: Rgb,
    pub(super) medium: Medium,
    /// Whether it goes to the other side.
    pub(super) transmitted: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Matte {
    reflectance: Option<TextureRef>,
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
    #[serde(rename = "metal")]
    _metal: Option<String>,
    eta: Option<Color>,
    k: Option<Color>,
    tint: Option<TextureRef>,
}

/// The id of a material, or one that is written in its place.
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

/// Indices and absorption inside and outside.
struct Interface {
    ior: [f64; 2],
    media: [Medium; 2],
}

impl Interface {
    fn new(ior: [Option<f64>; 2], absorption: [Option<Color>; 2]) -> Self {
        let medium = |color: Option<Color>| Medium(color.map_or(Rgb::splat(0.0), Color::get));
        Self {
            ior: [ior[0].unwrap_or(1.5), ior[1].unwrap_or(1.0)],
            media: absorption.map(medium),
        }
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Highlight {
    Phong,
    Blinn,
}

enum Kind {
    Matte(Texture),
    Gloss {
        k: Box<[Texture; 3]>,
        exponent: f64,
        highlight: Highlight,
        /// Of whitted.
        branches: Option<Box<([Texture; 2], Interface)>>,
    },
    Mirror(Texture),
    Dielectric(Interface),
    /// Index inside over that outside, and the tint.
    Pane(f64, Texture),
    Metal {
        eta: Rgb,
        k: Rgb,
        tint: Texture,
    },
    Emissive(Texture, Option<Box<Kind>>),
    /// How much of the second.
    Mix(Texture, [Box<Kind>; 2]),
    /// In front, and behind.
    Sides([Box<Kind>; 2]),
}

/// A material on a shape.
pub(super) struct Material {
    kind: Kind,
    /// What texture coordinates of a sphere are relative to, in object space.
    center: DVec3,
}

#[derive(Deserialize)]
struct Centered {
    #[serde(default)]
    center: [f64; 3],
}

/// Where a material is looked for.
struct Source<'a, 's> {
    description: &'a Description<'s>,
    /// The type of the shape.
    on: &'a str,
}

impl Source<'_, '_> {
    fn texture(&self, given: Option<TextureRef>, default: f64) -> Result<Texture, SceneErrors> {
        let given = given.unwrap_or(TextureRef::grey(default));
        Texture::new(self.description, &given, self.on)
    }

    fn boxed(&self, reference: &MaterialRef) -> Result<Box<Kind>, SceneErrors> {
        self.kind(&reference.0).map(Box::new)
    }

    fn kind(&self, reference: &PluginRef) -> Result<Kind, SceneErrors> {
        let plugin = table(self.description, &self.description.materials, reference);
        let plugin = plugin.ok_or_else(|| SceneError::anywhere("no such material"))?;
        Ok(match &*plugin.name {
            "matte" => Kind::Matte(self.texture(decode::<Matte>(&plugin.table)?.reflectance, 0.5)?),
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
                let (Some(eta), Some(k)) = (metal.eta, metal.k) else {
                    return Err(unknown_part(plugin, "metals by their names"));
                };
                Kind::Metal {
                    eta: eta.get(),
                    k: k.get(),
                    tint: self.texture(metal.tint, 1.0)?,
                }
            }
            "emissive" => {
                let emissive: Emissive = decode(&plugin.table)?;
                let inner = emissive.material.as_ref().map(|inner| self.boxed(inner));
                Kind::Emissive(self.texture(emissive.radiance, 1.0)?, inner.transpose()?)
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
            "phong" | "blinn_phong" | "whitted" => {
                let whitted = plugin.name == "whitted";
                let gloss: Gloss = decode(&plugin.table)?;
                let default = if whitted { 0.0 } else { 0.5 };
                let ambient = gloss.k_a.or_else(|| gloss.k_d.clone());
                let interface = Interface::new(
                    [gloss.interior_ior, gloss.exterior_ior],
                    [gloss.absorption, gloss.exterior_absorption],
                );
                let branches = [self.texture(gloss.k_refl, 0.0)?, self.texture(gloss.k_refr, 0.0)?];
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
                    branches: whitted.then(|| Box::new((branches, interface))),
                }
            }
            _ => return Err(unknown(plugin, "material")),
        })
    }
}

impl Material {
    pub(super) fn of_shape(
        description: &Description<'_>,
        shape: &ShapeTable<'_>,
    ) -> Result<Self, SceneErrors> {
        let source = Source {
            description,
            on: &shape.plugin.name,
        };
        let kind = match &shape.material {
            None => Kind::Matte(Texture::Constant(Rgb::splat(0.5))),
            Some((_, reference)) => source.kind(reference)?,
        };
        let center = match &*shape.plugin.name {
            "sphere" => decode::<Centered>(&shape.plugin.table)
                .map_err(|_| unknown_part(&shape.plugin, "this sphere"))?
                .center
                .into(),
            _ => DVec3::ZERO,
        };
        Ok(Self { kind, center })
    }

    /// What texture coordinates are relative to.
    pub(super) fn center(&self) -> DVec3 {
        self.center
    }

    /// At a surface point, with the geometric normal and the direction to the viewer.
    pub(super) fn at(&self, uv: DVec2, n_g: DVec3, viewer: DVec3) -> At<'_> {
        At {
            kind: &self.kind,
            uv,
            n_g,
            viewer,
            // Rule S has nothing to do: n_s is n_g.
            n: if viewer.dot(n_g) >= 0.0 { n_g } else { -n_g },
        }
    }
}

/// A material at a surface point.
pub(super) struct At<'a> {
    kind: &'a Kind,
    uv: DVec2,
    n_g: DVec3,
    viewer: DVec3,
    n: DVec3,
}

impl At<'_> {
    /// The normal on the viewer's side.
    pub(super) fn n(&self) -> DVec3 {
        self.n
    }

    /// The same place with another material.
    fn with<'b>(&self, kind: &'b Kind) -> At<'b> {
        At {
            kind,
            uv: self.uv,
            n_g: self.n_g,
            viewer: self.viewer,
            n: self.n,
        }
    }

    /// The side that the viewer sees.
    fn side<'b>(&self, sides: &'b [Box<Kind>; 2]) -> At<'b> {
        self.with(&sides[usize::from(self.viewer.dot(self.n_g) <= 0.0)])
    }

    /// What is made of others: of each part of a material, with its weight.
    fn blended(&self, of: &dyn Fn(&At<'_>) -> Rgb) -> Option<Rgb> {
        Some(match self.kind {
            Kind::Sides(sides) => of(&self.side(sides)),
            Kind::Mix(weight, [a, b]) => {
                let w = weight.at(self.uv);
                w.map(|w| 1.0 - w) * of(&self.with(a)) + w * of(&self.with(b))
            }
            _ => return None,
        })
    }

    pub(super) fn emission(&self) -> Rgb {
        match self.kind {
            Kind::Emissive(radiance, inner) => {
                let more = inner.as_ref().map(|inner| self.with(inner).emission());
                radiance.at(self.uv) + more.unwrap_or(Rgb::splat(0.0))
            }
            _ => self.blended(&|at| at.emission()).unwrap_or(Rgb::splat(0.0)),
        }
    }

    pub(super) fn ambient(&self, radiance: Rgb) -> Rgb {
        match self.kind {
            Kind::Matte(reflectance) => reflectance.at(self.uv) * radiance,
            Kind::Gloss { k, .. } => k[2].at(self.uv) * radiance,
            Kind::Emissive(_, Some(inner)) => self.with(inner).ambient(radiance),
            _ => {
                let blended = self.blended(&|at| at.ambient(radiance));
                blended.unwrap_or(Rgb::splat(0.0))
            }
        }
    }

    /// Radiance for an irradiance of 1 on a surface that faces a light in direction l.
    pub(super) fn answer(&self, l: DVec3) -> Rgb {
        let cosine = self.n.dot(l).max(0.0);
        match self.kind {
            Kind::Matte(reflectance) => reflectance.at(self.uv) * (cosine / PI),
            Kind::Gloss {
                k,
                exponent,
                highlight,
                ..
            } => {
                let base = match highlight {
                    Highlight::Phong => (2.0 * self.n.dot(l) * self.n - l).dot(self.viewer),
                    Highlight::Blinn => match (l + self.viewer).try_normalize() {
                        Some(h) => self.n.dot(h),
                        None => 0.0,
                    },
                };
                k[0].at(self.uv) * cosine + k[1].at(self.uv) * base.max(0.0).powf(*exponent)
            }
            Kind::Emissive(_, Some(inner)) => self.with(inner).answer(l),
            _ => {
                let blended = self.blended(&|at| at.answer(l));
                blended.unwrap_or(Rgb::splat(0.0))
            }
        }
    }

    /// Reflection, then transmission, then straight on.
    pub(super) fn branches(&self, medium: Medium) -> Vec<Branch> {
        let reflected = |weight: Rgb| Branch {
            direction: 2.0 * self.n.dot(self.viewer) * self.n - self.viewer,
            weight,
            medium,
            transmitted: false,
        };
        let straight = |weight: Rgb| Branch {
            direction: -self.viewer,
            weight,
            medium,
            transmitted: true,
        };
        let scaled = |branches: Vec<Branch>, factor: Rgb| {
            branches.into_iter().map(move |branch| Branch {
                weight: branch.weight * factor,
                ..branch
            })
        };
        match self.kind {
            Kind::Matte(_) | Kind::Gloss { branches: None, .. } | Kind::Emissive(_, None) => Vec::new(),
            Kind::Mirror(reflectance) => vec![reflected(reflectance.at(self.uv))],
            Kind::Metal { eta, k, tint } => {
                let c = self.n.dot(self.viewer);
                let [eta, k] = [eta.to_array(), k.to_array()];
                let r: [f64; 3] = std::array::from_fn(|channel| metal(eta[channel], k[channel], c));
                vec![reflected(tint.at(self.uv) * Rgb::from(r))]
            }
            Kind::Pane(eta, tint) => {
                let r = reflectance(self.n.dot(self.viewer), *eta);
                vec![
                    reflected(Rgb::splat(2.0 * r / (1.0 + r))),
                    straight(tint.at(self.uv) * ((1.0 - r) / (1.0 + r))),
                ]
            }
            Kind::Emissive(_, Some(inner)) => self.with(inner).branches(medium),
            Kind::Sides(sides) => self.side(sides).branches(medium),
            Kind::Mix(weight, [a, b]) => {
                let w = weight.at(self.uv);
                let mut all: Vec<Branch> =
                    scaled(self.with(a).branches(medium), w.map(|w| 1.0 - w)).collect();
                for branch in scaled(self.with(b).branches(medium), w) {
                    // Those in one direction are one, also for the least contribution.
                    let same = all.iter_mut().find(|one| one.transmitted == branch.transmitted);
                    match same {
                        Some(one) => one.weight += branch.weight,
                        None => all.push(branch),
                    }
                }
                all
            }
            Kind::Dielectric(interface) => match self.refracted(interface) {
                None => vec![reflected(Rgb::splat(1.0))],
                Some((mut branch, r, eta)) => {
                    branch.weight = Rgb::splat((1.0 - r) * eta * eta);
                    vec![reflected(Rgb::splat(r)), branch]
                }
            },
            Kind::Gloss {
                branches: Some(branches),
                ..
            } => {
                let ([k_refl, k_refr], interface) = &**branches;
                let [refl, refr] = [k_refl.at(self.uv), k_refr.at(self.uv)];
                match self.refracted(interface) {
                    None => vec![reflected(refl + refr)],
                    Some((mut branch, _, _)) => {
                        branch.weight = refr;
                        vec![reflected(refl), branch]
                    }
                }
            }
        }
    }

    /// The transmitted branch, the reflectance and the relative index; `None` for total reflection.
    fn refracted(&self, interface: &Interface) -> Option<(Branch, f64, f64)> {
        let outside = self.viewer.dot(self.n_g) > 0.0;
        let [interior, exterior] = interface.ior;
        let (n_i, n_t, medium) = if outside {
            (exterior, interior, interface.media[0])
        } else {
            (interior, exterior, interface.media[1])
        };
        let branch = |direction| Branch {
            direction,
            weight: Rgb::splat(0.0),
            medium,
            transmitted: true,
        };
        if n_i == n_t {
            return Some((branch(-self.viewer), 0.0, 1.0));
        }
        let eta = n_i / n_t;
        let cos_i = self.n.dot(self.viewer);
        let sine = eta * eta * (1.0 - cos_i * cos_i);
        if sine >= 1.0 {
            return None;
        }
        let cos_t = (1.0 - sine).sqrt();
        let direction = (eta * cos_i - cos_t) * self.n - eta * self.viewer;
        Some((branch(direction), reflectance(cos_i, n_t / n_i), eta))
    }
}

/// Of unpolarised light, by the index behind over that in front; 1 at total reflection.
fn reflectance(cosine: f64, index: f64) -> f64 {
    if index == 1.0 {
        return 0.0;
    }
    let sine = (1.0 - cosine * cosine) / (index * index);
    if sine >= 1.0 {
        return 1.0;
    }
    let behind = (1.0 - sine).sqrt();
    let r_s = (cosine - index * behind) / (cosine + index * behind);
    let r_p = (index * cosine - behind) / (index * cosine + behind);
    0.5 * (r_s * r_s + r_p * r_p)
}

/// Of a metal, by its index `eta + i k`.
fn metal(eta: f64, k: f64, c: f64) -> f64 {
    let s = 1.0 - c * c;
    let base = eta * eta - k * k - s;
    let large = (base * base + 4.0 * eta * eta * k * k).sqrt();
    let a = (0.5 * (large + base)).max(0.0).sqrt();
    let ratio = |x: f64, y: f64| if y == 0.0 { 1.0 } else { x / y };
    let r_s = ratio(large - 2.0 * a * c + c * c, large + 2.0 * a * c + c * c);
    let p = ratio(
        c * c * large - 2.0 * a * c * s + s * s,
        c * c * large + 2.0 * a * c * s + s * s,
    );
    0.5 * (r_s + r_s * p)
}
