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

/// At most two branches: reflection and transmission.
#[derive(Clone, Copy, Debug, Default)]
pub struct Branches {
    items: [Option<Branch>; 2],
}

impl Branches {
    /// Adds a branch. A third one is a fault of the material and panics.
    pub fn push(&mut self, branch: Branch) {
        let slot = self.items.iter_mut().find(|slot| slot.is_none());
        *slot.expect("a material has at most two branches") = Some(branch);
    }

    /// The branches in the order in which they were added.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = &Branch> {
        self.items.iter().flatten()
    }
}
