//! Materials: section 8 of the model.

pub(super) mod bodies;
pub(super) mod medium;
mod read;
mod tabulated;

use super::camera::lens;
use super::footprint::{APART, Differential, bounded, slope};
use super::light::Sky;
use super::mapping::Place;
use super::tangent::Tangent;
use super::texture::Texture;
use bodies::Face;
use medium::{Medium, MediumState};
use read::Source;
use std::f64::consts::{FRAC_PI_2, PI};
use tabulated::Brdf;
use whitstone_core::config::{Color, PluginRef};
use whitstone_core::{DVec2, DVec3, Rgb, SceneErrors};
use whitstone_scene::Description;

/// A direction in which the ray tree continues.
pub(super) struct SpecularRay {
    pub(super) direction: DVec3,
    /// The direction to take the derivative of: for glossy materials, the mirror direction.
    course: DVec3,
    pub(super) weight: Rgb,
    pub(super) medium: MediumState,
    /// Whether it crosses the surface.
    pub(super) transmitted: bool,
}

/// Indices of refraction and absorption inside and outside.
struct Interface {
    ior: [f64; 2],
    media: [MediumState; 2],
}

impl Interface {
    fn new(ior: [Option<f64>; 2], absorption: [Option<Color>; 2]) -> Self {
        let medium = |color: Option<Color>| MediumState::of(color.map_or(Rgb::splat(0.0), Color::get));
        Self {
            ior: [ior[0].unwrap_or(1.5), ior[1].unwrap_or(1.0)],
            media: absorption.map(medium),
        }
    }

    /// The interface between the media on the viewer's side and on the far side; `outside` tells
    /// where the viewer is.
    fn seen(outside: bool, [here, there]: [Medium; 2]) -> Self {
        let [inner, outer] = if outside { [there, here] } else { [here, there] };
        Self {
            ior: [inner.ior, outer.ior],
            media: [inner.absorption, outer.absorption].map(MediumState::of),
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
        /// Only for `whitted`.
        specular_rays: Option<Box<([Texture; 2], Interface)>>,
    },
    /// A BRDF and its tint.
    Tabulated(Brdf, Texture),
    Mirror(Texture),
    /// The material whose rays are spread, and directions about +z, equally weighted.
    Spread(Box<Kind>, Vec<DVec3>),
    Plastic {
        reflectance: Texture,
        /// Index of refraction of the coat relative to outside.
        index: f64,
        /// 1 - F.
        entered: f64,
    },
    Dielectric(Interface),
    /// Index of refraction inside relative to outside, and the tint.
    Pane(f64, Texture),
    Metal {
        eta: Rgb,
        k: Rgb,
        tint: Texture,
    },
    /// One of the prioritised dielectrics.
    Body(Face),
    Emissive(Texture, Option<Box<Kind>>),
    /// Reflections are looked up in a map.
    Mapped(Sky, Box<Kind>),
    /// The weight of the second material.
    Mix(Texture, [Box<Kind>; 2]),
    /// The material in front, and the one behind.
    Sides([Box<Kind>; 2]),
    /// The opacity: 0 is a hole.
    Mask(Texture, Box<Kind>),
    NormalMap {
        map: Texture,
        tangent: Tangent,
        strength: f64,
        inner: Box<Kind>,
    },
    Bump {
        height: Texture,
        scale: f64,
        step: f64,
        inner: Box<Kind>,
    },
    /// Vectors to add to the normal; in world space if there is no tangent.
    BumpVectors(Texture, f64, Option<Tangent>, Box<Kind>),
}

/// The material of a shape.
pub(super) struct Material(Kind);

impl Material {
    pub(super) fn of_shape(
        description: &Description<'_>,
        shown: Option<&PluginRef>,
    ) -> Result<Self, SceneErrors> {
        Ok(Self(match shown {
            None => Kind::Matte(Texture::Constant(Rgb::splat(0.5))),
            Some(reference) => Source { description }.kind(reference)?,
        }))
    }

    /// The material of a prioritised dielectric.
    pub(super) fn of_body(face: Face) -> Self {
        Self(Kind::Body(face))
    }

    /// The material at a surface point, with the geometric normal and the direction to the viewer.
    pub(super) fn at(&self, spot: Place, n_g: DVec3, viewer: DVec3) -> At<'_> {
        At::new(&self.0, spot, n_g, viewer)
    }

    /// Whether it contains a mask.
    pub(super) fn has_masks(&self) -> bool {
        self.0.contains(&|kind| matches!(kind, Kind::Mask(..)))
    }

    /// Whether it contains a height, whose slope needs the gradients of (u, v).
    pub(super) fn has_heights(&self) -> bool {
        self.0.contains(&|kind| matches!(kind, Kind::Bump { .. }))
    }
}

impl Kind {
    /// Whether it or one of its parts is one of these.
    fn contains(&self, wanted: &dyn Fn(&Kind) -> bool) -> bool {
        wanted(self)
            || match self {
                Self::Emissive(_, inner) => inner.as_ref().is_some_and(|inner| inner.contains(wanted)),
                Self::Mask(_, inner)
                | Self::Spread(inner, _)
                | Self::Mapped(_, inner)
                | Self::NormalMap { inner, .. }
                | Self::Bump { inner, .. }
                | Self::BumpVectors(.., inner) => inner.contains(wanted),
                Self::Mix(_, two) | Self::Sides(two) => two.iter().any(|one| one.contains(wanted)),
                _ => false,
            }
    }
}

/// A material at a surface point.
pub(super) struct At<'a> {
    kind: &'a Kind,
    spot: Place,
    n_g: DVec3,
    viewer: DVec3,
    /// The shading normal on the outside.
    n_s: DVec3,
    /// The shading normal on the viewer's side.
    n: DVec3,
}

impl<'a> At<'a> {
    fn new(kind: &'a Kind, spot: Place, n_g: DVec3, viewer: DVec3) -> Self {
        let at = At {
            kind,
            spot,
            n_g,
            viewer,
            n_s: n_g,
            n: n_g,
        };
        // Rule S of the model.
        let same_side = viewer.dot(spot.n_s) * viewer.dot(n_g) >= 0.0;
        at.facing(if same_side { spot.n_s } else { -spot.n_s })
    }
}

impl At<'_> {
    /// The ray differentials of its specular rays. `arriving` is that of the incoming ray, which
    /// travelled in `medium`.
    pub(super) fn differentials(
        &self,
        specular_rays: &[SpecularRay],
        arriving: &Differential,
        medium: MediumState,
    ) -> Vec<Differential> {
        let footprint = self.spot.footprint;
        // The specular rays at offset points: left and right, above and below. The step changes
        // (u, v), n_s and the point, but neither vertex colours nor mesh tangents.
        let neighbours = [0, 1].map(|side| {
            [-APART, APART].map(|away| {
                let spot = Place {
                    uv: self.spot.uv + away * footprint.uv[side],
                    p: self.spot.p + away * footprint.p[side],
                    n_s: (self.spot.n_s + away * footprint.n_s[side]).normalize(),
                    ..self.spot
                };
                let viewer = (self.viewer - away * arriving.direction[side]).normalize();
                At::new(self.kind, spot, self.n_g, viewer).specular_rays(medium)
            })
        });
        let of = |specular_ray: &SpecularRay| Differential {
            origin: footprint.p,
            direction: [0, 1].map(|side| {
                let [before, after] = [0, 1].map(|k| {
                    let there = &neighbours[side][k];
                    let same = there
                        .iter()
                        .find(|one| one.transmitted == specular_ray.transmitted);
                    same.map(|one| one.course)
                });
                bounded(slope(before, specular_ray.course, after, APART))
            }),
        };
        specular_rays.iter().map(of).collect()
    }

    pub(super) fn place(&self) -> &Place {
        &self.spot
    }

    /// The shading normal on the viewer's side.
    pub(super) fn n(&self) -> DVec3 {
        self.n
    }

    /// The same with another shading normal.
    fn facing(self, n_s: DVec3) -> Self {
        let outside = self.viewer.dot(self.n_g) >= 0.0;
        Self {
            n_s,
            n: if outside { n_s } else { -n_s },
            ..self
        }
    }

    /// Applies a normal map or bump map; the new normal must be on the viewer's side to count.
    fn perturbed(&self) -> Option<At<'_>> {
        let n_s = self.n_s;
        let (inner, perturbed) = match self.kind {
            Kind::NormalMap {
                map,
                tangent,
                strength,
                inner,
            } => {
                let [r, g, b] = map.at(&self.spot).to_array().map(|c| 2.0 * c - 1.0);
                let axes = tangent.at(n_s, &self.spot);
                let n = axes.map(|[t, across]| strength * (r * t + g * across) + b * n_s);
                (inner, n)
            }
            Kind::BumpVectors(vectors, scale, tangent, inner) => {
                let [r, g, b] = vectors.at(&self.spot).to_array().map(|c| 2.0 * c - 1.0);
                let w = match tangent {
                    None => Some(DVec3::new(r, g, b)),
                    Some(tangent) => {
                        let axes = tangent.at(n_s, &self.spot);
                        axes.map(|[t, across]| r * t + g * across + b * n_s)
                    }
                };
                (inner, w.map(|w| n_s + *scale * w))
            }
            Kind::Bump {
                height,
                scale,
                step,
                inner,
            } => {
                let h = |place: Place| scale * height.at(&place).to_array()[0];
                let spot = self.spot;
                let slope = |at: &dyn Fn(f64) -> Place| (h(at(*step)) - h(at(-*step))) / (2.0 * step);
                let by_point = DVec3::AXES.map(|axis| {
                    slope(&|s| Place {
                        p: spot.p + s * axis,
                        ..spot
                    })
                });
                let by_uv = DVec2::AXES.map(|axis| {
                    slope(&|s| Place {
                        uv: spot.uv + s * axis,
                        ..spot
                    })
                });
                let [u, v] = spot.gradients;
                let g = DVec3::from_array(by_point) + by_uv[0] * u + by_uv[1] * v;
                (inner, Some(n_s - (g - g.dot(n_s) * n_s)))
            }
            _ => return None,
        };
        let perturbed = perturbed.and_then(DVec3::try_normalize);
        let seen = perturbed.filter(|n| self.viewer.dot(*n) * self.viewer.dot(self.n_g) > 0.0);
        Some(self.with(inner).facing(seen.unwrap_or(n_s)))
    }

    /// The same point with another material.
    fn with<'b>(&self, kind: &'b Kind) -> At<'b> {
        At {
            kind,
            spot: self.spot,
            n_g: self.n_g,
            viewer: self.viewer,
            n_s: self.n_s,
            n: self.n,
        }
    }

    /// The side that the viewer sees.
    fn side<'b>(&self, sides: &'b [Box<Kind>; 2]) -> At<'b> {
        self.with(&sides[usize::from(self.viewer.dot(self.n_g) <= 0.0)])
    }

    /// For composite materials, the weighted sum of `of` over the components.
    fn blended(&self, of: &dyn Fn(&At<'_>) -> Rgb) -> Option<Rgb> {
        Some(match self.kind {
            Kind::Sides(sides) => of(&self.side(sides)),
            Kind::Mix(weight, [a, b]) => {
                let w = weight.at(&self.spot);
                w.map(|w| 1.0 - w) * of(&self.with(a)) + w * of(&self.with(b))
            }
            Kind::Mask(opacity, inner) => opacity.at(&self.spot) * of(&self.with(inner)),
            Kind::Spread(inner, _) => of(&self.with(inner)),
            _ => of(&self.perturbed()?),
        })
    }

    pub(super) fn emission(&self) -> Rgb {
        match self.kind {
            Kind::Emissive(radiance, inner) => {
                let more = inner.as_ref().map(|inner| self.with(inner).emission());
                radiance.at(&self.spot) + more.unwrap_or(Rgb::splat(0.0))
            }
            Kind::Mapped(map, inner) => {
                let at = self.with(inner);
                let rays = at.specular_rays(MediumState::default()).into_iter();
                // Rule G of the model.
                let kept = |d: DVec3| self.n_g.dot(d) * self.n_g.dot(self.viewer) > 0.0;
                rays.filter(|ray| !ray.transmitted && kept(ray.direction))
                    .fold(at.emission(), |sum, ray| {
                        sum + ray.weight * map.seen(ray.direction)
                    })
            }
            _ => self.blended(&|at| at.emission()).unwrap_or(Rgb::splat(0.0)),
        }
    }

    pub(super) fn ambient(&self, radiance: Rgb) -> Rgb {
        match self.kind {
            Kind::Matte(reflectance) => reflectance.at(&self.spot) * radiance,
            Kind::Plastic {
                reflectance, index, ..
            } => reflectance.at(&self.spot) * radiance * (1.0 - fresnel(self.n.dot(self.viewer), *index)),
            Kind::Gloss { k, .. } => k[2].at(&self.spot) * radiance,
            Kind::Tabulated(brdf, tint) => tint.at(&self.spot) * brdf.albedo() * radiance,
            Kind::Emissive(_, Some(inner)) | Kind::Mapped(_, inner) => self.with(inner).ambient(radiance),
            _ => {
                let blended = self.blended(&|at| at.ambient(radiance));
                blended.unwrap_or(Rgb::splat(0.0))
            }
        }
    }

    /// Reflected radiance for an irradiance of 1 on a surface that faces a light in direction `l`.
    pub(super) fn eval(&self, l: DVec3) -> Rgb {
        let cosine = self.n.dot(l).max(0.0);
        match self.kind {
            Kind::Matte(reflectance) => reflectance.at(&self.spot) * (cosine / PI),
            Kind::Plastic {
                reflectance,
                index,
                entered,
            } => {
                let passed = |direction: DVec3| 1.0 - fresnel(self.n.dot(direction), *index);
                let both = passed(self.viewer) * passed(l) / entered;
                reflectance.at(&self.spot) * (both * cosine / PI)
            }
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
                k[0].at(&self.spot) * cosine + k[1].at(&self.spot) * base.max(0.0).powf(*exponent)
            }
            Kind::Tabulated(brdf, tint) => {
                tint.at(&self.spot) * brdf.at(self.n, l, self.viewer) * Rgb::splat(cosine)
            }
            Kind::Emissive(_, Some(inner)) | Kind::Mapped(_, inner) => self.with(inner).eval(l),
            _ => {
                let blended = self.blended(&|at| at.eval(l));
                blended.unwrap_or(Rgb::splat(0.0))
            }
        }
    }

    /// The specular rays: reflection, then transmission, then the undeviated ray.
    pub(super) fn specular_rays(&self, medium: MediumState) -> Vec<SpecularRay> {
        let reflected = |weight: Rgb| SpecularRay {
            direction: self.mirrored(),
            course: self.mirrored(),
            weight,
            medium,
            transmitted: false,
        };
        let straight = |weight: Rgb| SpecularRay {
            direction: -self.viewer,
            course: -self.viewer,
            weight,
            medium,
            transmitted: true,
        };
        let scaled = |specular_rays: Vec<SpecularRay>, factor: Rgb| {
            specular_rays.into_iter().map(move |specular_ray| SpecularRay {
                weight: specular_ray.weight * factor,
                ..specular_ray
            })
        };
        match self.kind {
            Kind::Matte(_)
            | Kind::Tabulated(..)
            | Kind::Gloss {
                specular_rays: None, ..
            }
            | Kind::Emissive(_, None) => Vec::new(),
            Kind::Mirror(reflectance) => vec![reflected(reflectance.at(&self.spot))],
            Kind::Spread(inner, lobe) => {
                let mut all = Vec::new();
                for ray in self.with(inner).specular_rays(medium) {
                    let n = if ray.transmitted { -self.n } else { self.n };
                    let [x, y] = across(n, ray.direction);
                    all.extend(lobe.iter().map(|q| SpecularRay {
                        // `course` remains the direction in the middle.
                        direction: q.x * x + q.y * y + q.z * ray.direction,
                        weight: ray.weight * (1.0 / lobe.len() as f64),
                        ..ray
                    }));
                }
                all
            }
            Kind::Plastic { index, .. } => {
                vec![reflected(Rgb::splat(fresnel(self.n.dot(self.viewer), *index)))]
            }
            Kind::Metal { eta, k, tint } => {
                let c = self.n.dot(self.viewer);
                let [eta, k] = [eta.to_array(), k.to_array()];
                let r: [f64; 3] = std::array::from_fn(|channel| metal(eta[channel], k[channel], c));
                vec![reflected(tint.at(&self.spot) * Rgb::from(r))]
            }
            Kind::Pane(eta, tint) => {
                let r = fresnel(self.n.dot(self.viewer), *eta);
                vec![
                    reflected(Rgb::splat(2.0 * r / (1.0 + r))),
                    straight(tint.at(&self.spot) * ((1.0 - r) / (1.0 + r))),
                ]
            }
            Kind::Emissive(_, Some(inner)) => self.with(inner).specular_rays(medium),
            Kind::Mapped(_, inner) => {
                let rays = self.with(inner).specular_rays(medium).into_iter();
                rays.filter(|ray| ray.transmitted).collect()
            }
            Kind::Sides(sides) => self.side(sides).specular_rays(medium),
            Kind::NormalMap { .. } | Kind::Bump { .. } | Kind::BumpVectors(..) => self
                .perturbed()
                .map_or_else(Vec::new, |perturbed| perturbed.specular_rays(medium)),
            Kind::Mask(opacity, inner) => {
                let o = opacity.at(&self.spot);
                let mut all: Vec<SpecularRay> = scaled(self.with(inner).specular_rays(medium), o).collect();
                all.push(straight(o.map(|o| 1.0 - o)));
                all
            }
            Kind::Mix(weight, [a, b]) => {
                let w = weight.at(&self.spot);
                // A ray without weight is none: with another index, its direction would replace
                // that of a ray it is merged with.
                let counts = |ray: &SpecularRay| !ray.weight.is_black();
                let mut all: Vec<SpecularRay> =
                    scaled(self.with(a).specular_rays(medium), w.map(|w| 1.0 - w))
                        .filter(counts)
                        .collect();
                let of_a = all.len();
                for specular_ray in scaled(self.with(b).specular_rays(medium), w).filter(counts) {
                    // Specular rays in the same direction are merged, also for the contribution
                    // limit. A glossy material has several.
                    let mut of_a = all[..of_a].iter_mut();
                    let same = of_a.find(|one| one.transmitted == specular_ray.transmitted);
                    match same {
                        Some(one) => one.weight += specular_ray.weight,
                        None => all.push(specular_ray),
                    }
                }
                all
            }
            Kind::Dielectric(interface) => self.glass(interface, medium),
            Kind::Body(face) => {
                let [own, other] = face.sets(self.is_outside(), medium.inside);
                let mut all = match face.between(own, other) {
                    None => vec![straight(Rgb::splat(1.0))],
                    Some(two) => self.glass(&Interface::seen(self.is_outside(), two), medium),
                };
                for specular_ray in &mut all {
                    specular_ray.medium.inside = if specular_ray.transmitted { other } else { own };
                }
                all
            }
            Kind::Gloss {
                specular_rays: Some(specular_rays),
                ..
            } => {
                let ([k_refl, k_refr], interface) = &**specular_rays;
                let [refl, refr] = [k_refl.at(&self.spot), k_refr.at(&self.spot)];
                match self.refracted(interface) {
                    None => vec![reflected(refl + refr)],
                    Some((mut specular_ray, _, _)) => {
                        specular_ray.medium.inside = medium.inside;
                        specular_ray.weight = refr;
                        vec![reflected(refl), specular_ray]
                    }
                }
            }
        }
    }

    /// Transmittance of an undeviated shadow ray from the viewer's side (section 7), and the medium
    /// behind the surface if it changes. Unless `filtered`, only the holes of masks let light pass.
    pub(super) fn transmittance(&self, filtered: bool, medium: MediumState) -> (Rgb, Option<MediumState>) {
        let nothing = (Rgb::splat(0.0), None);
        let behind = |interface: &Interface| {
            let there = interface.media[usize::from(!self.is_outside())];
            Some(there.within(medium.inside))
        };
        match self.kind {
            Kind::Emissive(_, Some(inner)) | Kind::Mapped(_, inner) => {
                self.with(inner).transmittance(filtered, medium)
            }
            Kind::Spread(inner, _) => self.with(inner).transmittance(filtered, medium),
            Kind::Sides(sides) => self.side(sides).transmittance(filtered, medium),
            Kind::Mask(opacity, inner) => {
                let o = opacity.at(&self.spot);
                let (left, medium) = self.with(inner).transmittance(filtered, medium);
                (o.map(|o| 1.0 - o) + o * left, medium)
            }
            Kind::Mix(weight, [a, b]) => {
                let w = weight.at(&self.spot);
                let (a, b) = (
                    self.with(a).transmittance(filtered, medium),
                    self.with(b).transmittance(filtered, medium),
                );
                (w.map(|w| 1.0 - w) * a.0 + w * b.0, a.1.or(b.1))
            }
            Kind::NormalMap { .. } | Kind::Bump { .. } | Kind::BumpVectors(..) => self
                .perturbed()
                .map_or(nothing, |perturbed| perturbed.transmittance(filtered, medium)),
            Kind::Dielectric(interface) if filtered => (self.passes(interface), behind(interface)),
            Kind::Body(face) if filtered => {
                let [own, other] = face.sets(self.is_outside(), medium.inside);
                match face.between(own, other) {
                    None => (Rgb::splat(1.0), Some(medium.within(other))),
                    Some(two) => {
                        let interface = Interface::seen(self.is_outside(), two);
                        let there = behind(&interface).map(|there| there.within(other));
                        (self.passes(&interface), there)
                    }
                }
            }
            Kind::Pane(eta, tint) if filtered => {
                let r = fresnel(self.n.dot(self.viewer), *eta);
                (tint.at(&self.spot) * ((1.0 - r) / (1.0 + r)), None)
            }
            Kind::Gloss {
                specular_rays: Some(specular_rays),
                ..
            } if filtered => {
                let ([_, k_refr], interface) = &**specular_rays;
                match k_refr.is_black() {
                    true => nothing,
                    false => (k_refr.at(&self.spot), behind(interface)),
                }
            }
            _ => nothing,
        }
    }

    /// The Fresnel transmittance of undeviated light.
    fn passes(&self, interface: &Interface) -> Rgb {
        let [a, b] = interface.ior;
        let r = fresnel(self.n.dot(self.viewer).abs(), a.max(b) / a.min(b));
        Rgb::splat(1.0 - r)
    }

    fn mirrored(&self) -> DVec3 {
        2.0 * self.n.dot(self.viewer) * self.n - self.viewer
    }

    fn is_outside(&self) -> bool {
        self.viewer.dot(self.n_g) > 0.0
    }

    /// Reflection and refraction by the Fresnel equations.
    fn glass(&self, interface: &Interface, medium: MediumState) -> Vec<SpecularRay> {
        let reflected = |weight: f64| SpecularRay {
            direction: self.mirrored(),
            course: self.mirrored(),
            weight: Rgb::splat(weight),
            medium,
            transmitted: false,
        };
        match self.refracted(interface) {
            None => vec![reflected(1.0)],
            Some((mut specular_ray, r, eta)) => {
                specular_ray.medium.inside = medium.inside;
                specular_ray.weight = Rgb::splat((1.0 - r) * eta * eta);
                vec![reflected(r), specular_ray]
            }
        }
    }

    /// The transmitted ray, the reflectance and the relative index; `None` for total internal
    /// reflection.
    fn refracted(&self, interface: &Interface) -> Option<(SpecularRay, f64, f64)> {
        let outside = self.is_outside();
        let [interior, exterior] = interface.ior;
        let (n_i, n_t, medium) = if outside {
            (exterior, interior, interface.media[0])
        } else {
            (interior, exterior, interface.media[1])
        };
        let specular_ray = |direction| SpecularRay {
            direction,
            course: direction,
            weight: Rgb::splat(0.0),
            medium,
            transmitted: true,
        };
        if n_i == n_t {
            return Some((specular_ray(-self.viewer), 0.0, 1.0));
        }
        let eta = n_i / n_t;
        let cos_i = self.n.dot(self.viewer);
        let sine = eta * eta * (1.0 - cos_i * cos_i);
        if sine >= 1.0 {
            return None;
        }
        let cos_t = (1.0 - sine).sqrt();
        let direction = (eta * cos_i - cos_t) * self.n - eta * self.viewer;
        Some((specular_ray(direction), fresnel(cos_i, n_t / n_i), eta))
    }
}

/// The axes of a lobe about a direction: the frame of the model is rotated along the shortest path
/// to the normal, then to the direction.
fn across(n: DVec3, direction: DVec3) -> [DVec3; 2] {
    let turned = |q: DVec3, a: DVec3, b: DVec3| {
        let m = (a + b).try_normalize();
        m.map_or(q, |m| q - 2.0 * q.dot(m) * m)
    };
    let (x, z) = (DVec3::new(0.8, -0.6, 0.0), DVec3::new(0.48, 0.64, 0.6));
    let x = turned(turned(x, z, n), n, direction);
    [x, direction.cross(x)]
}

/// Directions through n x n strata of the lobe cos^exponent about +z.
fn lobe(n: u32, exponent: f64) -> Vec<DVec3> {
    let about = |[x, y]: [f64; 2]| {
        let disk = DVec2::new(x, y);
        let cosine = (1.0 - disk.length_squared()).powf(1.0 / (exponent + 1.0));
        let flat = disk.normalize_or_zero() * (1.0 - cosine * cosine).sqrt();
        flat.extend(cosine)
    };
    lens(1.0, n).into_iter().map(about).collect()
}

/// Fresnel reflectance of a dielectric for unpolarised light. `index` is the index behind the
/// surface relative to that in front. 1 for total internal reflection.
fn fresnel(cosine: f64, index: f64) -> f64 {
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

/// 1 - F of `plastic` for a relative index, by tanh-sinh quadrature of the definition (Takahasi and
/// Mori 1974), whose points crowd at both ends.
fn diffuse_transmittance(index: f64) -> f64 {
    if index < 1.0 {
        return index * index * diffuse_transmittance(1.0 / index);
    }
    const STEPS_PER_UNIT: i32 = 64;
    let step = 1.0 / f64::from(STEPS_PER_UNIT);
    let part = |k: i32| {
        let t = step * f64::from(k);
        let arc = FRAC_PI_2 * t.sinh();
        // (1 + tanh)/2 in a form that is accurate near 0.
        let cosine = 1.0 / (1.0 + (-2.0 * arc).exp());
        let slope = FRAC_PI_2 * t.cosh() * 0.5 / (arc.cosh() * arc.cosh());
        step * slope * 2.0 * cosine * (1.0 - fresnel(cosine, index))
    };
    (-4 * STEPS_PER_UNIT..=4 * STEPS_PER_UNIT).map(part).sum()
}

/// Fresnel reflectance of a metal with the index `eta + i k`.
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
