//! The cameras.
