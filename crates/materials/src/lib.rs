//! Materials: one file is one plugin is one Cargo feature is one TOML `type`.
//!
//! All are described in section 8 of `docs/whitted-model.md`.

#![cfg_attr(
    not(feature = "all"),
    allow(unused, reason = "some parts serve single plugins")
)]

use whitstone_core::{DuplicateType, Materials, Registry};

mod body;
mod gloss;
mod optics;
mod reflectance;

#[cfg(feature = "blinn_phong")]
pub mod blinn_phong;
#[cfg(feature = "dielectric")]
pub mod dielectric;
#[cfg(feature = "matte")]
pub mod matte;
#[cfg(feature = "mirror")]
pub mod mirror;
#[cfg(feature = "phong")]
pub mod phong;
#[cfg(feature = "whitted")]
pub mod whitted;

/// Adds every material whose feature is on.
pub fn register(registry: &mut Registry) -> Result<(), DuplicateType> {
    let from = env!("CARGO_PKG_NAME");
    #[cfg(feature = "blinn_phong")]
    registry.add::<Materials, blinn_phong::BlinnPhong>(from)?;
    #[cfg(feature = "dielectric")]
    registry.add::<Materials, dielectric::Dielectric>(from)?;
    #[cfg(feature = "matte")]
    registry.add::<Materials, matte::Matte>(from)?;
    #[cfg(feature = "mirror")]
    registry.add::<Materials, mirror::Mirror>(from)?;
    #[cfg(feature = "phong")]
    registry.add::<Materials, phong::Phong>(from)?;
    #[cfg(feature = "whitted")]
    registry.add::<Materials, whitted::Whitted>(from)?;
    Ok(())
}
