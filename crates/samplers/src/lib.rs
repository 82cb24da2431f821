//! The samplers.
