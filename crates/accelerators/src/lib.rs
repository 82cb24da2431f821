//! The accelerators.
