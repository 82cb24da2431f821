//! Shared by the shapes: frames, bounded root search, quadrics, outlines, level sets.

pub(crate) mod conic;
pub(crate) mod crossings;
pub(crate) mod enclosure;
pub(crate) mod frame;
pub(crate) mod level;
pub(crate) mod lower;
pub(crate) mod near;
pub(crate) mod outline;
pub(crate) mod revolution;
