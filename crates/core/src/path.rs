//! Rays on their way through a tree of rays.

use crate::{BranchKind, Inside, Ray, Rgb, Skip, Spread};
use std::fmt;

/// A ray of the tree under a camera ray, waiting to be traced.
#[derive(Clone, Copy, Debug)]
pub struct PathState {
    /// In world space, unit direction.
    pub ray: Ray,
    /// The primitive it leaves.
    pub skip: Skip,
    /// Factor on its radiance in the pixel.
    pub throughput: Rgb,
    /// Absorption coefficient of the medium it travels in, per metre.
    pub absorption: Rgb,
    /// The bodies that it is in, of those that may overlap.
    pub inside: Inside,
    /// Bounces before it: 0 for a camera ray.
    pub depth: u32,
    /// For [`Scratch::record`](crate::Scratch::record): the number there of the node that it comes
    /// from, and the letter of the branch; `None` for a camera ray.
    pub origin: Option<(u32, PathLetter)>,
    /// How far apart it is from its neighbours, where textures ask for it.
    pub spread: Option<Spread>,
}

impl PathState {
    /// The start of a tree: a camera ray, in empty space.
    #[inline]
    pub fn camera(ray: Ray) -> Self {
        Self {
            ray,
            skip: Skip::NOTHING,
            throughput: Rgb::WHITE,
            absorption: Rgb::BLACK,
            inside: Inside::NOTHING,
            depth: 0,
            origin: None,
            spread: None,
        }
    }
}

/// What a ray travels in.
#[derive(Clone, Copy, Debug)]
pub struct Medium {
    /// Absorption coefficient, per metre.
    pub absorption: Rgb,
    /// The bodies that it is in, of those that may overlap.
    pub inside: Inside,
}

impl Medium {
    /// In no body that may overlap others.
    pub const fn absorbing(absorption: Rgb) -> Self {
        let inside = Inside::NOTHING;
        Self { absorption, inside }
    }
}

/// Which branch a ray is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathLetter {
    /// Reflection.
    R,
    /// Transmission.
    T,
    /// One of the directions of a reflection that is spread, by its number.
    Among(u8),
}

impl PathLetter {
    /// Of reflection number `number` out of so many.
    pub fn among(reflections: u32, number: u8) -> Self {
        if reflections > 1 {
            Self::Among(number)
        } else {
            Self::R
        }
    }
}

impl fmt::Display for PathLetter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::R => f.write_str("R"),
            Self::T => f.write_str("T"),
            Self::Among(number) => write!(f, "R{number:02}"),
        }
    }
}

impl From<BranchKind> for PathLetter {
    fn from(kind: BranchKind) -> Self {
        match kind {
            BranchKind::Reflection => Self::R,
            BranchKind::Transmission { .. } | BranchKind::Straight => Self::T,
        }
    }
}
