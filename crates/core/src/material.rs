use crate::config::PluginRef;
use crate::stream::{Colors, LANES, Lanes, PointStream, SampleStreams, Vectors};
use crate::{Distribution, Needs, Overlapping, Rgb, SourceSpan, SurfacePoint};
use glam::DVec3;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer};
use std::borrow::Cow;
use std::fmt;
use std::ops::BitOr;
use toml::Spanned;

/// How a surface answers light.
///
/// The surface points passed in have been through rule S ([`SurfacePoint::seen_from`]); rule G is
/// the integrator's business for lights and branches alike.
pub trait Material: Send + Sync {
    /// Which of the methods below can give something.
    fn lobes(&self) -> Lobes;

    /// What it reads of a surface point.
    fn needs(&self) -> Needs;

    /// Radiance towards `view` (unit, away from the surface) from ambient light and from the lights
    /// that reach the point.
    fn local(&self, point: &SurfacePoint, view: DVec3, light: &Illumination<'_>) -> Rgb {
        let _ = (point, view, light);
        Rgb::BLACK
    }

    /// [`Self::local`] for every point of a stream. Lanes of light samples that are black do not
    /// reach their points.
    fn local_stream(&self, points: &PointStream, ambient: Rgb, lights: &SampleStreams, out: &mut Colors) {
        let mut incoming = Vec::with_capacity(lights.len());
        for lane in 0..points.len {
            incoming.clear();
            let samples = lights.iter().map(|stream| stream.get(lane));
            incoming.extend(
                samples
                    .filter(|s| !s.irradiance.is_black())
                    .map(|sample| Incoming {
                        direction: sample.direction,
                        irradiance: sample.irradiance,
                    }),
            );
            let light = Illumination {
                ambient,
                lights: &incoming,
            };
            out.set(lane, self.local(&points.get(lane), points.view.get(lane), &light));
        }
    }

    /// Radiance that the surface gives off by itself towards `view`, in light and in the dark.
    fn emission(&self, point: &SurfacePoint, view: DVec3) -> Rgb {
        let _ = (point, view);
        Rgb::BLACK
    }

    /// [`Self::emission`] for every point of a stream.
    fn emission_stream(&self, points: &PointStream, out: &mut Colors) {
        for lane in 0..points.len {
            out.set(lane, self.emission(&points.get(lane), points.view.get(lane)));
        }
    }

    /// What a shadow ray in this direction keeps when it goes straight on through the surface. The
    /// point is as a viewer sees it where the ray comes from. `filtered`: also what is transparent,
    /// not holes only.
    fn shadow(&self, point: &SurfacePoint, direction: DVec3, filtered: bool) -> Filter {
        let _ = (point, direction, filtered);
        Filter::OPAQUE
    }

    /// Itself as a body that may overlap others, if it has a priority among them: then what its
    /// faces do depends on what a ray is in.
    fn overlapping(&self) -> Option<&dyn Overlapping> {
        None
    }

    /// [`Self::branches`] for every point of a stream.
    fn branches_stream(&self, points: &PointStream, out: &mut BranchStreams) {
        for lane in 0..points.len {
            let mut branches = Branches::default();
            self.branches(&points.get(lane), points.view.get(lane), &mut branches);
            out.clear(lane);
            for branch in branches.iter() {
                out.set(lane, branch);
            }
        }
    }

    /// The directions in which a Whitted integrator goes on, reflection first.
    fn branches(&self, point: &SurfacePoint, view: DVec3, out: &mut Branches) {
        let _ = (point, view, out);
    }

    /// Over how many directions the reflected branch is spread at most: over 1, its own, but by
    /// what is glossy.
    fn reflections(&self) -> u32 {
        1
    }

    /// How the reflected branch, which goes in the mirror direction, is spread over directions;
    /// `None` where it is not.
    fn distribution(&self, point: &SurfacePoint, view: DVec3) -> Option<Distribution<'_>> {
        let _ = (point, view);
        None
    }
}

/// The light at a surface point.
#[derive(Clone, Copy, Debug)]
pub struct Illumination<'a> {
    /// Uniform radiance from all around.
    pub ambient: Rgb,
    /// Lights on the viewer's side of the geometry that are not shadowed.
    pub lights: &'a [Incoming],
}

/// Light that reaches a surface point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Incoming {
    /// Unit direction from the point to the light.
    pub direction: DVec3,
    /// Irradiance in W/m² on a surface that faces the light.
    pub irradiance: Rgb,
}

/// Kinds of response, as a set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lobes(u8);

impl Lobes {
    /// [`Material::local`] can be other than black.
    pub const LOCAL: Self = Self(1);
    /// [`Material::branches`] can reflect.
    pub const REFLECTION: Self = Self(2);
    /// [`Material::branches`] can transmit.
    pub const TRANSMISSION: Self = Self(4);
    /// [`Material::branches`] can go straight on.
    pub const STRAIGHT: Self = Self(8);
    /// [`Material::emission`] can be other than black.
    pub const EMISSION: Self = Self(16);
    /// [`Material::shadow`] can let light through, also where shadows are not filtered.
    pub const HOLES: Self = Self(32);
    /// [`Material::shadow`] can let light through where shadows are filtered.
    pub const FILTERS: Self = Self(64);
    /// It answers by other normals than those of the shape.
    pub const OWN_NORMAL: Self = Self(128);
    /// Every kind of branch.
    pub const BRANCHES: Self = Self(2 + 4 + 8);
    /// Everything that the surface shows without following a ray.
    pub const SHOWN: Self = Self(1 + 16);
    /// What a material can be asked for although it says that it has none of it, and the answer is
    /// nothing.
    pub const HARMLESS: Self = Self(1 + 2 + 4 + 16);
    /// No response at all.
    pub const NOTHING: Self = Self(0);

    /// What is in this set and not in `other`.
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

impl BitOr for Lobes {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// Which side of the surface a branch goes to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BranchKind {
    /// Back to the viewer's side, staying in the medium that the viewer is in.
    Reflection,
    /// To the other side, into a medium with this absorption coefficient (per metre).
    Transmission {
        /// Per metre, each channel at least 0.
        absorption: Rgb,
    },
    /// Straight on to the other side, staying in the medium that the ray travels in: there is no
    /// body behind the surface.
    Straight,
}

/// What a surface does to the light of a shadow ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Filter {
    /// Factor on the light.
    pub weight: Rgb,
    /// The medium behind the surface, by its absorption coefficient (per metre), if it is another
    /// one.
    pub medium: Option<Rgb>,
}

impl Filter {
    /// Nothing goes through.
    pub const OPAQUE: Self = Self::straight(Rgb::BLACK);

    /// Without a body behind the surface.
    pub const fn straight(weight: Rgb) -> Self {
        Self { weight, medium: None }
    }
}

/// The value of a parameter where a material is expected inside another one: one written where it
/// stands, or the id of a shared one.
#[derive(Clone, Debug)]
pub struct MaterialRef {
    /// Place in the source.
    pub span: SourceSpan,
    /// What is there.
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

/// A direction in which to go on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Branch {
    /// Unit direction away from the surface.
    pub direction: DVec3,
    /// Factor on the radiance that comes from there.
    pub weight: Rgb,
    /// Side and medium.
    pub kind: BranchKind,
}

/// At most two branches: a reflection and a transmission.
#[derive(Clone, Copy, Debug, Default)]
pub struct Branches {
    reflection: Option<Branch>,
    transmission: Option<Branch>,
}

impl Branches {
    /// Adds a branch. A second one of its kind is a fault of the material and panics.
    pub fn push(&mut self, branch: Branch) {
        let slot = match branch.kind {
            BranchKind::Reflection => &mut self.reflection,
            BranchKind::Transmission { .. } | BranchKind::Straight => &mut self.transmission,
        };
        assert!(slot.is_none(), "a material has at most one branch of a kind");
        *slot = Some(branch);
    }

    /// Adds a share of the branches of a part of the material; one that is there already in the
    /// same direction takes it up.
    pub fn merge(&mut self, parts: &Self, share: Rgb) {
        for part in parts.iter() {
            let weight = part.weight * share;
            let slot = match part.kind {
                BranchKind::Reflection => &mut self.reflection,
                BranchKind::Transmission { .. } | BranchKind::Straight => &mut self.transmission,
            };
            match slot {
                Some(branch) => branch.weight += weight,
                None if weight.is_black() => {}
                None => *slot = Some(Branch { weight, ..*part }),
            }
        }
    }

    /// The branches, reflection first.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = &Branch> {
        self.reflection.iter().chain(&self.transmission)
    }
}

/// One branch of each point of a stream, where it has it.
#[derive(Clone, Default)]
pub struct BranchStream {
    /// Unit directions away from the surfaces.
    pub direction: Vectors,
    /// Factors on the radiance that comes from there; a branch of weight zero is none.
    pub weight: Colors,
}

/// The branches of the points of a stream: at most a reflection and a transmission each.
#[derive(Clone, Default)]
pub struct BranchStreams {
    /// On the viewer's side, in the medium that the viewer is in.
    pub reflection: BranchStream,
    /// To the other side.
    pub transmission: BranchStream,
    /// Absorption coefficients (per metre) of the media that transmitted rays travel in.
    pub absorption: Colors,
    /// Whether the transmitted ray goes straight on in its medium, instead of in that of
    /// `absorption`. Read only of materials that have this lobe.
    pub straight: Flags,
}

/// A yes or no for each lane.
#[derive(Clone)]
pub struct Flags(pub Lanes<bool>);

impl Default for Flags {
    fn default() -> Self {
        Self([false; LANES])
    }
}

impl BranchStreams {
    /// Takes both branches from a lane.
    #[inline(always)]
    pub fn clear(&mut self, lane: usize) {
        self.reflection.weight.set(lane, Rgb::BLACK);
        self.transmission.weight.set(lane, Rgb::BLACK);
    }

    /// Replaces the branch of its kind in a lane.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, branch: &Branch) {
        let stream = match branch.kind {
            BranchKind::Reflection => &mut self.reflection,
            BranchKind::Transmission { absorption } => {
                self.absorption.set(lane, absorption);
                self.straight.0[lane] = false;
                &mut self.transmission
            }
            BranchKind::Straight => {
                self.absorption.set(lane, Rgb::BLACK);
                self.straight.0[lane] = true;
                &mut self.transmission
            }
        };
        stream.direction.set(lane, branch.direction);
        stream.weight.set(lane, branch.weight);
    }
}
