use crate::stream::{Colors, PointStream, SampleStreams, Vectors};
use crate::{Needs, Rgb, SurfacePoint};
use glam::DVec3;
use std::ops::BitOr;

/// How a surface answers light.
///
/// The surface points passed in have been through rule S ([`SurfacePoint::seen_from`]); rule G is the
/// integrator's business for lights and branches alike.
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

    /// [`Self::local`] for every point of a stream. Lanes of light samples that are black do not reach
    /// their points.
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
    /// No response at all.
    pub const NOTHING: Self = Self(0);

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
            BranchKind::Transmission { .. } => &mut self.transmission,
        };
        assert!(slot.is_none(), "a material has at most one branch of a kind");
        *slot = Some(branch);
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
                &mut self.transmission
            }
        };
        stream.direction.set(lane, branch.direction);
        stream.weight.set(lane, branch.weight);
    }
}
