//! Shared by the textures: mapping, images, filters.

#[cfg(any(
    feature = "checker3d",
    feature = "gradient",
    feature = "rings",
    feature = "stripes"
))]
pub(crate) mod cells;
pub(crate) mod combine;
pub(crate) mod mapping;
#[cfg(any(feature = "image", feature = "synthesized"))]
pub(crate) mod pyramid;
#[cfg(any(feature = "image", feature = "synthesized"))]
pub(crate) mod raster;
pub(crate) mod wrap;
