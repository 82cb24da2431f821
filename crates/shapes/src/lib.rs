//! Shape plugins: one file, one Cargo feature and one TOML `type` per plugin.
//!
//! Section 9 of `docs/whitted-model.md` specifies all of them.
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

use whitstone_core::{DuplicateType, FamilyName, Registry, Shapes};

mod support;

#[cfg(feature = "cone")]
pub mod cone;
#[cfg(feature = "csg")]
pub mod csg;
#[cfg(feature = "box")]
#[path = "box.rs"]
pub mod cuboid;
#[cfg(feature = "cylinder")]
pub mod cylinder;
#[cfg(feature = "disk")]
pub mod disk;
#[cfg(feature = "ellipsoid")]
pub mod ellipsoid;
#[cfg(feature = "fractal")]
pub mod fractal;
#[cfg(feature = "heightfield")]
pub mod heightfield;
#[cfg(feature = "hyperboloid")]
pub mod hyperboloid;
#[cfg(feature = "implicit")]
pub mod implicit;
#[cfg(feature = "instance")]
pub mod instance;
#[cfg(feature = "isosurface")]
pub mod isosurface;
#[cfg(feature = "lathe")]
pub mod lathe;
#[cfg(feature = "mesh")]
pub mod mesh;
#[cfg(feature = "paraboloid")]
pub mod paraboloid;
#[cfg(feature = "patch")]
pub mod patch;
#[cfg(feature = "plane")]
pub mod plane;
#[cfg(feature = "polygon")]
pub mod polygon;
#[cfg(feature = "prism")]
pub mod prism;
#[cfg(feature = "quadric")]
pub mod quadric;
#[cfg(feature = "rectangle")]
pub mod rectangle;
#[cfg(feature = "sphere")]
pub mod sphere;
#[cfg(feature = "torus")]
pub mod torus;
#[cfg(feature = "triangle")]
pub mod triangle;

/// Adds every shape whose feature is on.
pub fn register(registry: &mut Registry) -> Result<(), DuplicateType> {
    let from = env!("CARGO_PKG_NAME");
    registry.set_default(FamilyName::Shape, "mesh");
    #[cfg(feature = "box")]
    registry.add::<Shapes, cuboid::Cuboid>(from)?;
    #[cfg(feature = "cone")]
    registry.add::<Shapes, cone::Cone>(from)?;
    #[cfg(feature = "csg")]
    registry.add::<Shapes, csg::Csg>(from)?;
    #[cfg(feature = "cylinder")]
    registry.add::<Shapes, cylinder::Cylinder>(from)?;
    #[cfg(feature = "disk")]
    registry.add::<Shapes, disk::Disk>(from)?;
    #[cfg(feature = "ellipsoid")]
    registry.add::<Shapes, ellipsoid::Ellipsoid>(from)?;
    #[cfg(feature = "fractal")]
    registry.add::<Shapes, fractal::Fractal>(from)?;
    #[cfg(feature = "heightfield")]
    registry.add::<Shapes, heightfield::Heightfield>(from)?;
    #[cfg(feature = "hyperboloid")]
    registry.add::<Shapes, hyperboloid::Hyperboloid>(from)?;
    #[cfg(feature = "implicit")]
    registry.add::<Shapes, implicit::Implicit>(from)?;
    #[cfg(feature = "instance")]
    registry.add::<Shapes, instance::Placed>(from)?;
    #[cfg(feature = "isosurface")]
    registry.add::<Shapes, isosurface::Isosurface>(from)?;
    #[cfg(feature = "lathe")]
    registry.add::<Shapes, lathe::Lathe>(from)?;
    #[cfg(feature = "mesh")]
    registry.add::<Shapes, mesh::Mesh>(from)?;
    #[cfg(feature = "paraboloid")]
    registry.add::<Shapes, paraboloid::Paraboloid>(from)?;
    #[cfg(feature = "patch")]
    registry.add::<Shapes, patch::Patch>(from)?;
    #[cfg(feature = "plane")]
    registry.add::<Shapes, plane::Plane>(from)?;
    #[cfg(feature = "polygon")]
    registry.add::<Shapes, polygon::Polygon>(from)?;
    #[cfg(feature = "prism")]
    registry.add::<Shapes, prism::Prism>(from)?;
    #[cfg(feature = "quadric")]
    registry.add::<Shapes, quadric::Quadric>(from)?;
    #[cfg(feature = "rectangle")]
    registry.add::<Shapes, rectangle::Rectangle>(from)?;
    #[cfg(feature = "sphere")]
    registry.add::<Shapes, sphere::Sphere>(from)?;
    #[cfg(feature = "torus")]
    registry.add::<Shapes, torus::Torus>(from)?;
    #[cfg(feature = "triangle")]
    registry.add::<Shapes, triangle::Triangle>(from)?;
    Ok(())
}
