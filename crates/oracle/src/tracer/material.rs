//! Section 8.

use super::texture::{Texture, table};
use super::{unknown, unknown_part};
use serde::Deserialize;
use std::f64::consts::PI;
use whitstone_core::config::{Color, TextureRef, decode};
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

impl Material {
    pub(super) fn of_shape(
        description: &Description<'_>,
        shape: &ShapeTable<'_>,
    ) -> Result<Self, SceneErrors> {
        let kind = match &shape.material {
            None => Kind::Matte(Texture::Constant(Rgb::splat(0.5))),
            Some((span, reference)) => {
                let plugin = table(description, &description.materials, reference);
                let plugin = plugin.ok_or_else(|| SceneError::at(span.clone(), "no such material"))?;
                let on = &*shape.plugin.name;
                let texture = |given: Option<TextureRef>, default: f64| {
                    Texture::new(description, &given.unwrap_or(TextureRef::grey(default)), on)
                };
                match &*plugin.name {
                    "matte" => Kind::Matte(texture(decode::<Matte>(&plugin.table)?.reflectance, 0.5)?),
                    "mirror" => Kind::Mirror(texture(decode::<Matte>(&plugin.table)?.reflectance, 1.0)?),
                    "dielectric" => {
                        let glass: Glass = decode(&plugin.table)?;
                        Kind::Dielectric(Interface::new(
                            [glass.interior_ior, glass.exterior_ior],
                            [glass.absorption, glass.exterior_absorption],
                        ))
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
                        let branches = [texture(gloss.k_refl, 0.0)?, texture(gloss.k_refr, 0.0)?];
                        Kind::Gloss {
                            k: Box::new([
                                texture(gloss.k_d, default)?,
                                texture(gloss.k_s, default)?,
                                texture(ambient, default)?,
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
                }
            }
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

    /// None of the materials that it knows shines.
    pub(super) fn emission(&self) -> Rgb {
        Rgb::splat(0.0)
    }

    pub(super) fn ambient(&self, radiance: Rgb) -> Rgb {
        match self.kind {
            Kind::Matte(reflectance) => reflectance.at(self.uv) * radiance,
            Kind::Gloss { k, .. } => k[2].at(self.uv) * radiance,
            Kind::Mirror(_) | Kind::Dielectric(_) => Rgb::splat(0.0),
        }
    }

    /// Radiance for an irradiance of 1 on a surface that faces a light in direction l.
    pub(super) fn answer(&self, l: DVec3) -> Rgb {
        let cosine = self.n.dot(l).max(0.0);
        match self.kind {
            Kind::Matte(reflectance) => reflectance.at(self.uv) * (cosine / PI),
            Kind::Mirror(_) | Kind::Dielectric(_) => Rgb::splat(0.0),
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
        }
    }

    /// Reflection, then transmission.
    pub(super) fn branches(&self, medium: Medium) -> Vec<Branch> {
        let reflected = |weight: Rgb| Branch {
            direction: 2.0 * self.n.dot(self.viewer) * self.n - self.viewer,
            weight,
            medium,
            transmitted: false,
        };
        match self.kind {
            Kind::Matte(_) | Kind::Gloss { branches: None, .. } => Vec::new(),
            Kind::Mirror(reflectance) => vec![reflected(reflectance.at(self.uv))],
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
        let r_s = (n_i * cos_i - n_t * cos_t) / (n_i * cos_i + n_t * cos_t);
        let r_p = (n_t * cos_i - n_i * cos_t) / (n_t * cos_i + n_i * cos_t);
        let direction = (eta * cos_i - cos_t) * self.n - eta * self.viewer;
        Some((branch(direction), 0.5 * (r_s * r_s + r_p * r_p), eta))
    }
}
