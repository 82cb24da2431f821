//! Shared by the cameras.

pub(crate) mod near;
pub(crate) mod pinhole;
pub(crate) mod view;
