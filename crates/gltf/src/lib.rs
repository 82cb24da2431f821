//! Reads glTF 2.0 files: [`Document`], its accessors, primitives and images.
//!
//! The JSON is deserialised to the types of the `gltf` crate. That crate's own accessors panic on
//! files whose indices are out of range, so this crate checks every index and reads all numbers
//! itself. Every error carries the JSON pointer (RFC 6901) of the faulty value. Only the bytes that
//! a caller asks for are read.

#![cfg_attr(
    not(test),
    warn(clippy::disallowed_methods, reason = "the same image on every machine")
)]

mod accessor;
mod buffers;
mod container;
mod document;
mod nodes;
mod primitive;
mod usage;

pub use accessor::Numbers;
pub use container::MAX_JSON_BYTES;
pub use document::{Document, Error};
pub use gltf::json;
pub use nodes::{MAX_NODE_DEPTH, local_transform, parents, rotation, shortest, world_transform};
pub use primitive::{ComputeTangents, Primitive, Request, has_triangles};
pub use usage::{Usage, usage};
