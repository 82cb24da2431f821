//! The lights.
