//! State of the rays of a ray tree.

use crate::{MediumStack, Ray, RayDifferential, Rgb, SelfHitFilter, SpecularRayKind, TreeLimits};
use std::fmt;

/// A ray of a ray tree that is still to be traced.
#[derive(Clone, Copy, Debug)]
pub struct PathState {
    /// In world space, with unit direction.
    pub ray: Ray,
    /// The primitive that it starts on.
    pub skip: SelfHitFilter,
    /// Factor on its radiance in the pixel.
    pub throughput: Rgb,
    /// Absorption coefficient of the medium that it travels in, per metre.
    pub absorption: Rgb,
    /// The nested dielectrics that it is inside.
    pub inside: MediumStack,
    /// Number of bounces so far: 0 for a camera ray.
    pub depth: u32,
    /// For [`Scratch::record`](crate::Scratch::record): index of the parent node and letter of the
    /// branch; `None` for a camera ray.
    pub origin: Option<(u32, PathLetter)>,
    /// For [`Scratch::paths`](crate::Scratch::paths): the state of the automaton of path classes.
    pub class_state: u32,
    /// Ray differentials, if textures read footprints.
    pub differential: Option<RayDifferential>,
}

// A list that grows exists twice, and is then up to twice as long as it needs to be.
const _: () = assert!(3 * size_of::<PathState>() as u64 <= TreeLimits::PENDING_BYTES);

impl PathState {
    /// A camera ray in empty space: the root of a tree.
    #[inline]
    pub fn camera(ray: Ray) -> Self {
        Self {
            ray,
            skip: SelfHitFilter::NOTHING,
            throughput: Rgb::WHITE,
            absorption: Rgb::BLACK,
            inside: MediumStack::NOTHING,
            depth: 0,
            origin: None,
            class_state: 0,
            differential: None,
        }
    }
}

/// The medium that a ray travels in.
#[derive(Clone, Copy, Debug)]
pub struct MediumState {
    /// Absorption coefficient, per metre.
    pub absorption: Rgb,
    /// The nested dielectrics that the ray is inside.
    pub inside: MediumStack,
}

impl MediumState {
    /// A medium outside all nested dielectrics.
    pub const fn absorbing(absorption: Rgb) -> Self {
        let inside = MediumStack::NOTHING;
        Self { absorption, inside }
    }
}

/// How a ray was spawned from its parent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathLetter {
    /// Reflection.
    R,
    /// Transmission.
    T,
    /// One ray of a glossy reflection, by its number.
    Among(u8),
    /// One ray of a transmission that is spread, by its number.
    Through(u8),
}

impl PathLetter {
    /// Ray `number` of a specular ray that is spread over `rays` rays; R or T if there is only one.
    pub fn among(kind: SpecularRayKind, rays: u32, number: u8) -> Self {
        match Self::from(kind) {
            Self::R if rays > 1 => Self::Among(number),
            Self::T if rays > 1 => Self::Through(number),
            letter => letter,
        }
    }
}

impl fmt::Display for PathLetter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::R => f.write_str("R"),
            Self::T => f.write_str("T"),
            Self::Among(number) => write!(f, "R{number:02}"),
            Self::Through(number) => write!(f, "T{number:02}"),
        }
    }
}

impl From<SpecularRayKind> for PathLetter {
    fn from(kind: SpecularRayKind) -> Self {
        match kind {
            SpecularRayKind::Reflection => Self::R,
            SpecularRayKind::Transmission { .. } | SpecularRayKind::Null => Self::T,
        }
    }
}
