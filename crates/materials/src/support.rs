//! Shared by the materials: optics, highlights, lobes, reflectances.

pub(crate) mod body;
pub(crate) mod detail;
pub(crate) mod gloss;
pub(crate) mod lobe;
pub(crate) mod optics;
pub(crate) mod reflectance;
