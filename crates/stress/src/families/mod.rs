//! The families.

mod shapes;
mod sphere;

use crate::Family;

/// All of them, in the order of the catalogue.
pub static FAMILIES: [&dyn Family; 13] = [
    &sphere::DISTANCE,
    &sphere::PLANET,
    &sphere::TANGENT,
    &sphere::OFFSET,
    &shapes::SLIVER,
    &sphere::NEAR,
    &shapes::CONDITION,
    &shapes::NEEDLE,
    &shapes::APEX,
    &shapes::WIRE,
    &shapes::FAR_RING,
    &shapes::COPY,
    &shapes::LENGTH,
];
