use crate::stream::{Colors, SurfaceStream};
use crate::{Rgb, SurfaceAttributes, SurfaceInteraction};
use std::sync::Arc;

/// A colour that varies over a surface.
pub trait Texture: Send + Sync {
    /// The surface attributes that it reads.
    fn needs(&self) -> SurfaceAttributes;

    /// The linear colour at a point; a filtering texture averages over the footprint.
    fn value(&self, point: &SurfaceInteraction) -> Rgb;

    /// [`Self::value`] for every point of a stream.
    fn value_stream(&self, points: &SurfaceStream, out: &mut Colors) {
        for lane in 0..points.len {
            out.set(lane, self.value(&points.get(lane)));
        }
    }

    /// Its memory use, if reported.
    fn bytes(&self) -> Option<TextureBytes> {
        None
    }

    /// Columns and rows, if it is a single image.
    fn size(&self) -> Option<[usize; 2]> {
        None
    }

    /// The value, if it is constant: the pipeline then replaces the texture by the colour.
    fn constant(&self) -> Option<Rgb> {
        None
    }
}

/// Memory of a texture in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TextureBytes {
    /// Source data: texels, voxels.
    pub texels: u64,
    /// Coarser levels, for filtering.
    pub levels: u64,
    /// If several textures may share the data: a number that is the same for those that do.
    pub shared: Option<usize>,
}

/// A colour parameter of a plugin: constant or textured. A constant needs no virtual call.
#[derive(Clone)]
pub enum ColorSource {
    /// The same everywhere.
    Constant(Rgb),
    /// Looked up at each point.
    Texture(Arc<dyn Texture>),
}

impl ColorSource {
    /// The value at a point.
    #[inline]
    pub fn value(&self, point: &SurfaceInteraction) -> Rgb {
        match self {
            Self::Constant(value) => *value,
            Self::Texture(texture) => texture.value(point),
        }
    }

    /// The values at the points of a stream.
    pub fn value_stream(&self, points: &SurfaceStream, out: &mut Colors) {
        match self {
            Self::Constant(value) => out.fill(points.len, *value),
            Self::Texture(texture) => texture.value_stream(points, out),
        }
    }

    /// The surface attributes that it reads.
    pub fn needs(&self) -> SurfaceAttributes {
        match self {
            Self::Constant(_) => SurfaceAttributes::NOTHING,
            Self::Texture(texture) => texture.needs() | SurfaceAttributes::TEXTURE,
        }
    }

    /// Its value, if it is the same everywhere.
    pub fn constant(&self) -> Option<Rgb> {
        match self {
            Self::Constant(value) => Some(*value),
            Self::Texture(_) => None,
        }
    }

    /// Whether it is known to be zero everywhere without evaluating it.
    pub fn is_black(&self) -> bool {
        matches!(self, Self::Constant(value) if value.is_black())
    }
}
