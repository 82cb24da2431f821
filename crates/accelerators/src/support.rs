//! Shared by the accelerators: elements and their bounds, split rules, leaves.

pub(crate) mod automatic;
#[cfg(any(feature = "bvh2", feature = "obb_bvh", feature = "slab_bvh"))]
pub(crate) mod binary;
pub(crate) mod elements;
#[cfg(any(feature = "obb_bvh", feature = "slab_bvh"))]
pub(crate) mod hierarchy;
#[cfg(any(feature = "bvh", feature = "kdtree"))]
pub(crate) mod leaves;
pub(crate) mod oversized;
#[cfg(any(feature = "bsp", feature = "kdtree"))]
pub(crate) mod partition;
pub(crate) mod polyhedron;
#[cfg(feature = "bvh")]
pub(crate) mod precision;
#[cfg(any(feature = "bsp", feature = "obb_bvh"))]
pub(crate) mod principal;
pub(crate) mod split;
