//! Shared by the lights.

pub(crate) mod emission;
#[cfg(feature = "environment")]
pub(crate) mod sky;
