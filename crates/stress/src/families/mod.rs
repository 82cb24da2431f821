//! The families.

mod camera;
mod gaps;
mod optics;
mod scale;
mod shapes;
mod sphere;

use crate::Family;

/// All of them, in the order of the catalogue.
pub static FAMILIES: [&dyn Family; 26] = [
    &sphere::DISTANCE,
    &sphere::PLANET,
    &sphere::TANGENT,
    &sphere::OFFSET,
    &scale::PowerOfTwo,
    &scale::PowerOfTen,
    &shapes::SLIVER,
    &gaps::Leaks,
    &gaps::ShadowGap,
    &gaps::ThinPane,
    &optics::IndexNearOne,
    &optics::CriticalAngle,
    &gaps::ParallelMirrors,
    &sphere::NEAR,
    &camera::WideView,
    &camera::NarrowView,
    &optics::PhongExponent,
    &optics::NearLamp,
    &shapes::CONDITION,
    &shapes::NEEDLE,
    &shapes::APEX,
    &shapes::WIRE,
    &shapes::FAR_RING,
    &shapes::COPY,
    &shapes::LENGTH,
    &optics::Absorption,
];
