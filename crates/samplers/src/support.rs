//! Shared by the samplers.

pub(crate) mod scrambled;
