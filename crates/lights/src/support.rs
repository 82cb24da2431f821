//! Shared by the lights.

pub(crate) mod emission;
#[cfg(any(feature = "projector", feature = "spot"))]
pub(crate) mod projection;
#[cfg(feature = "environment")]
pub(crate) mod sky;
