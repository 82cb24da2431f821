use crate::config::PluginRef;
use crate::stream::{Colors, LANES, Lanes, SampleStreams, SurfaceStream, Vectors};
use crate::{GlossyLobe, PrioritizedDielectric, Rgb, SourceSpan, SurfaceAttributes, SurfaceInteraction};
use glam::DVec3;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;
use std::fmt;
use std::ops::BitOr;
use toml::Spanned;

/// How a surface scatters and emits light.
///
/// Rule S of the model ([`SurfaceInteraction::seen_from`]) has been applied to all surface points
/// passed in. Integrators apply rule G of the model ([`SurfaceInteraction::same_side`]) to lights
/// and to specular rays.
pub trait Material: Send + Sync {
    /// Which of the methods below may return something other than zero.
    fn flags(&self) -> BsdfFlags;

    /// The surface attributes that it reads.
    fn needs(&self) -> SurfaceAttributes;

    /// Local illumination: the radiance towards `view` (unit, away from the surface) due to ambient
    /// light and to the lights that reach the point.
    fn local_illumination(&self, point: &SurfaceInteraction, view: DVec3, light: &LightSamples<'_>) -> Rgb {
        let _ = (point, view, light);
        Rgb::BLACK
    }

    /// [`Self::local_illumination`] for every point of a stream. A light sample that does not reach
    /// its point is black in that lane.
    fn local_illumination_stream(
        &self,
        points: &SurfaceStream,
        ambient: Rgb,
        lights: &SampleStreams,
        out: &mut Colors,
    ) {
        let mut incoming = Vec::with_capacity(lights.len());
        for lane in 0..points.len {
            incoming.clear();
            let samples = lights.iter().map(|stream| stream.get(lane));
            incoming.extend(
                samples
                    .filter(|s| !s.irradiance.is_black())
                    .map(|sample| IncidentLight {
                        direction: sample.direction,
                        irradiance: sample.irradiance,
                    }),
            );
            let light = LightSamples {
                ambient,
                lights: &incoming,
            };
            out.set(
                lane,
                self.local_illumination(&points.get(lane), points.view.get(lane), &light),
            );
        }
    }

    /// Radiance emitted towards `view`, independent of illumination.
    fn emission(&self, point: &SurfaceInteraction, view: DVec3) -> Rgb {
        let _ = (point, view);
        Rgb::BLACK
    }

    /// [`Self::emission`] for every point of a stream.
    fn emission_stream(&self, points: &SurfaceStream, out: &mut Colors) {
        for lane in 0..points.len {
            out.set(lane, self.emission(&points.get(lane), points.view.get(lane)));
        }
    }

    /// Transmittance of an undeviated shadow ray in unit direction `direction`. Rule S has
    /// been applied to `point` for the viewer `-direction`. Its `n_g` still points to the outside,
    /// so that the ray enters the body exactly if `n_g · direction < 0`. If `filtered`, transparent
    /// surfaces attenuate light; otherwise only cut-outs let it pass.
    fn shadow_transmittance(
        &self,
        point: &SurfaceInteraction,
        direction: DVec3,
        filtered: bool,
    ) -> Transmittance {
        let _ = (point, direction, filtered);
        Transmittance::OPAQUE
    }

    /// This material as a nested dielectric, if it has a priority. The media on both sides of its
    /// surface then depend on the bodies that the ray is inside.
    fn prioritized(&self) -> Option<&dyn PrioritizedDielectric> {
        None
    }

    /// [`Self::specular_rays`] for every point of a stream.
    fn specular_rays_stream(&self, points: &SurfaceStream, out: &mut SpecularRayStreams) {
        for lane in 0..points.len {
            let mut branches = SpecularRays::default();
            self.specular_rays(&points.get(lane), points.view.get(lane), &mut branches);
            out.clear(lane);
            for branch in branches.iter() {
                out.set(lane, branch);
            }
        }
    }

    /// The specular rays that a Whitted integrator follows, reflection first.
    fn specular_rays(&self, point: &SurfaceInteraction, view: DVec3, out: &mut SpecularRays) {
        let _ = (point, view, out);
    }

    /// Maximum number of reflection rays per hit, from 1 to 100: 1 unless the material is glossy.
    /// At least the number of directions of each [`Self::glossy_lobe`].
    fn reflections(&self) -> u32 {
        1
    }

    /// Maximum number of transmitted and undeviated rays per hit, from 1 to 100: 1 unless the
    /// material is rough glass.
    fn transmissions(&self) -> u32 {
        1
    }

    /// The lobe over which the specular ray of this kind is spread; `None` if it is not.
    fn glossy_lobe(
        &self,
        point: &SurfaceInteraction,
        view: DVec3,
        kind: SpecularRayKind,
    ) -> Option<GlossyLobe<'_>> {
        let _ = (point, view, kind);
        None
    }
}

/// The light at a surface point.
#[derive(Clone, Copy, Debug)]
pub struct LightSamples<'a> {
    /// Uniform radiance from all directions.
    pub ambient: Rgb,
    /// Light from the viewer's side of the geometric surface, after shadow rays.
    pub lights: &'a [IncidentLight],
}

/// Light that reaches a surface point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IncidentLight {
    /// Unit direction from the point to the light.
    pub direction: DVec3,
    /// Irradiance in W/m² on a surface that faces the light.
    pub irradiance: Rgb,
}

/// The set of responses that a material can have (BSDF flags).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BsdfFlags(u16);

impl BsdfFlags {
    /// [`Material::local_illumination`] can be other than black.
    pub const LOCAL: Self = Self(1);
    /// [`Material::specular_rays`] can reflect.
    pub const REFLECTION: Self = Self(2);
    /// [`Material::specular_rays`] can transmit.
    pub const TRANSMISSION: Self = Self(4);
    /// [`Material::specular_rays`] can continue undeviated.
    pub const NULL: Self = Self(8);
    /// [`Material::emission`] can be other than black.
    pub const EMISSION: Self = Self(16);
    /// [`Material::shadow_transmittance`] can let light through, even if shadows are not filtered.
    pub const CUT_OUTS: Self = Self(32);
    /// [`Material::shadow_transmittance`] can let light through if shadows are filtered.
    pub const TRANSPARENT_SHADOWS: Self = Self(64);
    /// The material shades with a normal other than the shape's (normal or bump map).
    pub const NORMAL_MAPPED: Self = Self(128);
    /// Light passes the surface as if it were not there. A property of the shape, not of its
    /// material: see [`crate::Scene::let_light_through`].
    pub const NO_SHADOW: Self = Self(256);
    /// Every kind of specular ray.
    pub const SPECULAR: Self = Self(2 + 4 + 8);
    /// Everything that the surface shows without following rays: local illumination and emission.
    pub const LOCAL_OR_EMISSIVE: Self = Self(1 + 16);
    /// Responses that may be evaluated for a material that lacks them: the result is then zero.
    pub const ZERO_IF_ABSENT: Self = Self(1 + 2 + 4 + 16);
    /// No response at all.
    pub const NOTHING: Self = Self(0);

    /// The set difference: this set without `other`.
    #[must_use]
    pub const fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// Whether all of `other` is in this set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Whether any of `other` is in this set.
    pub const fn intersects(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }
}

impl BitOr for BsdfFlags {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// The side of the surface that a specular ray goes to, and its medium there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SpecularRayKind {
    /// Back to the viewer's side, in the viewer's medium.
    Reflection,
    /// To the other side, into a medium with the given absorption coefficient.
    Transmission {
        /// Per metre, each channel at least 0.
        absorption: Rgb,
    },
    /// Undeviated to the other side, in the same medium: the surface is no medium interface.
    Null,
}

/// The transmittance of a surface for a shadow ray, and the medium behind the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transmittance {
    /// Transmittance of each channel.
    pub weight: Rgb,
    /// Absorption coefficient (per metre) of the medium behind the surface, if the medium changes.
    pub medium: Option<Rgb>,
}

impl Transmittance {
    /// No light passes.
    pub const OPAQUE: Self = Self::straight(Rgb::BLACK);

    /// With transmittance `weight`, without a change of medium.
    pub const fn straight(weight: Rgb) -> Self {
        Self { weight, medium: None }
    }
}

/// A parameter that expects a material: an inline table or the id of a shared material.
#[derive(Clone, Debug)]
pub struct MaterialRef {
    /// Position in the source.
    pub span: SourceSpan,
    /// The reference or the inline table.
    pub material: PluginRef,
}

impl<'de> Deserialize<'de> for MaterialRef {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Named(PluginRef);
        impl<'de> Deserialize<'de> for Named {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                struct AnyMaterial;
                impl Visitor<'_> for AnyMaterial {
                    type Value = Named;
                    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                        f.write_str("the id of a material or a table with a `type`")
                    }
                    fn visit_str<E: Error>(self, text: &str) -> Result<Named, E> {
                        Ok(Named(text.into()))
                    }
                }
                deserializer.deserialize_any(AnyMaterial)
            }
        }
        let material = Spanned::<Named>::deserialize(deserializer)?;
        Ok(Self {
            span: material.span(),
            material: material.into_inner().0,
        })
    }
}

impl Serialize for MaterialRef {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.material.serialize(serializer)
    }
}

impl JsonSchema for MaterialRef {
    fn schema_name() -> Cow<'static, str> {
        "MaterialRef".into()
    }
    fn inline_schema() -> bool {
        true
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [
            { "type": "string", "description": "id of a shared material" },
            {
                "type": "object",
                "properties": { "type": { "type": "string" } },
                "required": ["type"],
                "x-family": "material"
            }
        ] })
    }
}

/// A specular ray to follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpecularRay {
    /// Unit direction away from the surface.
    pub direction: DVec3,
    /// Factor on the radiance from that direction.
    pub weight: Rgb,
    /// Side and medium.
    pub kind: SpecularRayKind,
}

/// At most two specular rays: a reflection and a transmission.
#[derive(Clone, Copy, Debug, Default)]
pub struct SpecularRays {
    reflection: Option<SpecularRay>,
    transmission: Option<SpecularRay>,
}

impl SpecularRays {
    /// Adds a specular ray. Panics if there is already one on its side, which is a bug in the
    /// material: [`SpecularRayKind::Null`] and `Transmission` rays leave on the same side.
    pub fn push(&mut self, branch: SpecularRay) {
        let slot = match branch.kind {
            SpecularRayKind::Reflection => &mut self.reflection,
            SpecularRayKind::Transmission { .. } | SpecularRayKind::Null => &mut self.transmission,
        };
        assert!(
            slot.is_none(),
            "a material has at most one specular ray of each kind"
        );
        *slot = Some(branch);
    }

    /// Adds the specular rays of a component of the material, scaled by `share`. If there is
    /// already a ray on the same side, only its weight grows; its direction and kind do not change.
    pub fn merge(&mut self, parts: &Self, share: Rgb) {
        for part in parts.iter() {
            let weight = part.weight * share;
            let slot = match part.kind {
                SpecularRayKind::Reflection => &mut self.reflection,
                SpecularRayKind::Transmission { .. } | SpecularRayKind::Null => &mut self.transmission,
            };
            match slot {
                Some(branch) => branch.weight += weight,
                None if weight.is_black() => {}
                None => *slot = Some(SpecularRay { weight, ..*part }),
            }
        }
    }

    /// The specular rays, reflection first.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = &SpecularRay> {
        self.reflection.iter().chain(&self.transmission)
    }
}

/// One kind of specular ray for each point of a stream.
#[derive(Clone, Default)]
pub struct SpecularRayStream {
    /// Unit directions away from the surfaces.
    pub direction: Vectors,
    /// Factors on the radiance from there; weight zero means no ray.
    pub weight: Colors,
}

/// The specular rays of the points of a stream: at most a reflection and a transmission each.
#[derive(Clone, Default)]
pub struct SpecularRayStreams {
    /// On the viewer's side, in the viewer's medium.
    pub reflection: SpecularRayStream,
    /// To the other side.
    pub transmission: SpecularRayStream,
    /// Absorption coefficients (per metre) of the media of the transmitted rays.
    pub absorption: Colors,
    /// Whether the transmitted ray continues undeviated in its current medium, instead of entering
    /// that of `absorption`. Read only for materials with the flag [`BsdfFlags::NULL`].
    pub undeviated: LaneMask,
    /// Whether `absorption` is black in all lanes: set by materials that know it, so that nobody
    /// has to look.
    pub clear_media: bool,
}

/// A boolean per lane.
#[derive(Clone)]
pub struct LaneMask(pub Lanes<bool>);

impl Default for LaneMask {
    fn default() -> Self {
        Self([false; LANES])
    }
}

impl SpecularRayStreams {
    /// Removes both rays of a lane.
    #[inline(always)]
    pub fn clear(&mut self, lane: usize) {
        self.reflection.weight.set(lane, Rgb::BLACK);
        self.transmission.weight.set(lane, Rgb::BLACK);
    }

    /// Replaces the ray of this kind in a lane.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, branch: &SpecularRay) {
        let stream = match branch.kind {
            SpecularRayKind::Reflection => &mut self.reflection,
            SpecularRayKind::Transmission { absorption } => {
                self.absorption.set(lane, absorption);
                self.undeviated.0[lane] = false;
                &mut self.transmission
            }
            SpecularRayKind::Null => {
                self.absorption.set(lane, Rgb::BLACK);
                self.undeviated.0[lane] = true;
                &mut self.transmission
            }
        };
        stream.direction.set(lane, branch.direction);
        stream.weight.set(lane, branch.weight);
    }
}
