//! Materials: each plugin is one file, one Cargo feature and one TOML `type`.
//!
//! Section 8 of `docs/whitted-model.md` specifies all of them.
//!
//! `docs/glossary.md` explains *twin*, *native*, *hosted*, *formula* and *lecture notes*.

#![cfg_attr(
    not(test),
    warn(clippy::disallowed_methods, reason = "the same image on every machine")
)]
#![cfg_attr(
    not(feature = "all"),
    allow(unused, reason = "some parts serve single plugins")
)]

use whitstone_core::{DuplicateType, FamilyName, Materials, Registry};

mod support;

#[cfg(feature = "blinn_phong")]
pub mod blinn_phong;
#[cfg(feature = "bump")]
pub mod bump;
#[cfg(feature = "conductor")]
pub mod conductor;
#[cfg(feature = "dielectric")]
pub mod dielectric;
#[cfg(feature = "emissive")]
pub mod emissive;
#[cfg(feature = "glossy")]
pub mod glossy;
#[cfg(feature = "mask")]
pub mod mask;
#[cfg(feature = "matte")]
pub mod matte;
#[cfg(feature = "mirror")]
pub mod mirror;
#[cfg(feature = "mix")]
pub mod mix;
#[cfg(feature = "normal_map")]
pub mod normal_map;
#[cfg(feature = "phong")]
pub mod phong;
#[cfg(feature = "plastic")]
pub mod plastic;
#[cfg(feature = "reflection_map")]
pub mod reflection_map;
#[cfg(feature = "rough")]
pub mod rough;
#[cfg(feature = "tabulated")]
pub mod tabulated;
#[cfg(feature = "thin_dielectric")]
pub mod thin_dielectric;
#[cfg(feature = "two_sided")]
pub mod two_sided;
#[cfg(feature = "whitted")]
pub mod whitted;

#[cfg(all(test, feature = "all"))]
mod without_effect;

/// Registers every material whose feature is enabled.
pub fn register(registry: &mut Registry) -> Result<(), DuplicateType> {
    let from = env!("CARGO_PKG_NAME");
    registry.set_default(FamilyName::Material, "matte");
    #[cfg(feature = "blinn_phong")]
    registry.add::<Materials, blinn_phong::BlinnPhong>(from)?;
    #[cfg(feature = "bump")]
    registry.add::<Materials, bump::Bump>(from)?;
    #[cfg(feature = "conductor")]
    registry.add::<Materials, conductor::Conductor>(from)?;
    #[cfg(feature = "dielectric")]
    registry.add::<Materials, dielectric::Dielectric>(from)?;
    #[cfg(feature = "emissive")]
    registry.add::<Materials, emissive::Emissive>(from)?;
    #[cfg(feature = "glossy")]
    registry.add::<Materials, glossy::Glossy>(from)?;
    #[cfg(feature = "mask")]
    registry.add::<Materials, mask::Mask>(from)?;
    #[cfg(feature = "matte")]
    registry.add::<Materials, matte::Matte>(from)?;
    #[cfg(feature = "mirror")]
    registry.add::<Materials, mirror::Mirror>(from)?;
    #[cfg(feature = "mix")]
    registry.add::<Materials, mix::Mix>(from)?;
    #[cfg(feature = "normal_map")]
    registry.add::<Materials, normal_map::NormalMap>(from)?;
    #[cfg(feature = "phong")]
    registry.add::<Materials, phong::Phong>(from)?;
    #[cfg(feature = "plastic")]
    registry.add::<Materials, plastic::Plastic>(from)?;
    #[cfg(feature = "reflection_map")]
    registry.add::<Materials, reflection_map::ReflectionMap>(from)?;
    #[cfg(feature = "rough")]
    registry.add::<Materials, rough::Rough>(from)?;
    #[cfg(feature = "tabulated")]
    registry.add::<Materials, tabulated::Tabulated>(from)?;
    #[cfg(feature = "thin_dielectric")]
    registry.add::<Materials, thin_dielectric::ThinDielectric>(from)?;
    #[cfg(feature = "two_sided")]
    registry.add::<Materials, two_sided::TwoSided>(from)?;
    #[cfg(feature = "whitted")]
    registry.add::<Materials, whitted::Whitted>(from)?;
    Ok(())
}
