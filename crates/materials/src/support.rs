//! Shared by the materials: optics, highlights, reflectances.

pub(crate) mod body;
pub(crate) mod detail;
pub(crate) mod gloss;
pub(crate) mod optics;
pub(crate) mod reflectance;
