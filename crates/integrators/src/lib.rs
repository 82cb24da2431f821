//! The integrators.
