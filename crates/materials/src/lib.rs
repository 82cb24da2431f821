//! The materials.
