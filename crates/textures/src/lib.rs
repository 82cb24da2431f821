//! The textures.
