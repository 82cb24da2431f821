//! An image file, or one of its channels.
//!
//! Alpha is coverage (Porter and Duff, *Compositing digital images*, 1984). Colours are neither
//! multiplied nor divided by it. A `mask` multiplies them by the opacity, so it needs a file whose
//! colours are not premultiplied: PNG files are not, EXR files mostly are.
//! `scenes/showcase/cutout.toml` uses an alpha channel for leaves.
//!
//! - Twin: Mitsuba `bitmap` (native); the filters `trilinear` and `ewa` are hosted.
//! - Example: `scenes/textures/image.toml`.

use crate::support::mapping::{Mapping, Projection};
use crate::support::raster::{
    ColorSpace, DEFAULT_MAX_ANISOTROPY, Data, Filter, Lookup, MaxAnisotropy, Raster, Store,
};
use crate::support::wrap::Wraps;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::{FilePath, IntegerIn, Scale2, Vector2};
use whitstone_core::{Context, Plugin, SceneError, SceneErrors, Texture, Textures};
use whitstone_gltf::Document;
use whitstone_image::limits::{Limits, ReadFault};
use whitstone_image::texels::{self, Texels};

/// An image from a PNG, JPEG, WebP, EXR, HDR or glTF file.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Path of the file, relative to the scene.
    file: FilePath,
    /// For a .gltf or .glb file: index of the image in it.
    #[serde(default)]
    #[schemars(extend("default" = 0), with = "u32")]
    image: Option<Spanned<u32>>,
    /// "nearest" uses the nearest texel, "bilinear" interpolates between texel centres. Two filters
    /// average where the footprint of a ray covers several texels: "trilinear" looks up a mip map;
    /// "ewa" averages over the ellipse of the footprint. Both are bilinear where it is smaller than
    /// a texel, and need 4 more bytes per texel.
    #[serde(default)]
    filter: Filter,
    /// For "ewa": maximum ratio of the axes of a footprint's ellipse. Longer ellipses are widened,
    /// which bounds the number of texels read.
    #[serde(default)]
    #[schemars(extend("default" = DEFAULT_MAX_ANISOTROPY), with = "IntegerIn<1, 64>")]
    max_anisotropy: MaxAnisotropy,
    /// Continuation outside of the image: "repeat", "clamp" to its border, or "mirror". Two words
    /// give the horizontal and the vertical rule; a latitude-longitude sky needs ["repeat",
    /// "clamp"].
    #[serde(default)]
    wrap: Wraps,
    /// Channel of the image: "color": the colours, decoded by `color_space`, neither multiplied nor
    /// divided by alpha; "alpha" as a grey, for example for the `opacity` of a `mask`; "red",
    /// "green" or "blue" as a grey.
    #[serde(default)]
    #[schemars(extend("default" = "color"), with = "Channel")]
    channel: Option<Spanned<Channel>>,
    /// Encoding of the values in the file: "srgb", "linear", or "auto" (linear for EXR, sRGB
    /// for the others). Alpha is always linear.
    #[serde(default)]
    #[schemars(extend("default" = "auto"), with = "ColorSpace")]
    color_space: Option<Spanned<ColorSpace>>,
    /// Repetitions of the image per unit of u and of v.
    #[serde(default = "one")]
    scale: Scale2,
    /// Offset added to (u, v) after scaling.
    #[serde(default = "zero")]
    offset: Vector2,
    /// Mapping of the texture.
    #[serde(default)]
    #[schemars(extend("x-default" = "by (u, v)"))]
    mapping: Mapping,
}

/// A channel of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Channel {
    /// Its colours.
    #[default]
    Color,
    /// Its alpha (coverage).
    Alpha,
    /// Its first channel.
    Red,
    /// Its second channel.
    Green,
    /// Its third channel.
    Blue,
}

fn one() -> Scale2 {
    Scale2::splat(1.0)
}

fn zero() -> Vector2 {
    Vector2::new(0.0, 0.0)
}

/// The `image` texture; see the module documentation.
pub struct Image;

impl Plugin<Textures> for Image {
    const TYPE: &'static str = "image";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Texture>, SceneErrors> {
        let path = context.file(&config.file)?;
        let alpha = config
            .channel
            .as_ref()
            .filter(|channel| *channel.get_ref() == Channel::Alpha);
        if let Some(index) = config.image.as_ref().filter(|_| !is_gltf(&path)) {
            let message = "`image` needs a .gltf or .glb `file`";
            return Err(SceneError::at(index.span(), message).into());
        }
        let color_space = match (&config.color_space, alpha) {
            (None, None) => ColorSpace::Auto,
            (Some(space), None) => *space.get_ref(),
            (None, Some(_)) => ColorSpace::Linear,
            (Some(space), Some(_)) => {
                let message = "an alpha channel has no color space: it is linear";
                return Err(SceneError::at(space.span(), message).into());
            }
        };
        // A file is decoded once for all textures that read the same from it.
        let key = format!(
            "image {:?}, {:?}, {:?}, {color_space:?}",
            path.canonicalize().unwrap_or_else(|_| path.clone()),
            config.image.as_ref().map_or(0, |index| *index.get_ref()),
            config
                .channel
                .as_ref()
                .map_or(Channel::Color, |channel| *channel.get_ref()),
        );
        let shared = context.shared(&key).and_then(|picture| picture.downcast().ok());
        let picture: Arc<Picture> = match shared {
            Some(picture) => picture,
            None => {
                let texels = decode(&config, &path, context)?;
                let size = [texels.width, texels.height];
                let store = Store::new(texels, color_space);
                context.reserve(store.bytes())?;
                let picture = Arc::new(Picture {
                    size,
                    data: Data::new(store),
                });
                context.share(key, picture.clone());
                picture
            }
        };
        let lookup = Lookup {
            filter: config.filter,
            wrap: config.wrap.0,
            scale: config.scale.get(),
            offset: config.offset.get(),
        };
        let data = picture.data.clone();
        let pattern = Raster::new(picture.size, data, lookup, config.max_anisotropy, context)?;
        config.mapping.put(Projection::Uv, pattern)
    }
}

/// A decoded image.
struct Picture {
    size: [usize; 2],
    data: Arc<Data>,
}

/// Reads the channel of a file that a texture uses. Negative values are an error.
/// Bytes that decoding an EXR file, the largest case, takes for each byte of its texels: its planes
/// of four channels, and the texels.
const DECODING: f64 = 2.5;

fn decode(config: &Config, path: &Path, context: &mut dyn Context) -> Result<Texels, SceneErrors> {
    let limits = Limits {
        max_bytes: Limits::TEXTURE
            .max_bytes
            .min((context.reservable() as f64 / DECODING) as u64),
        ..Limits::TEXTURE
    };
    let why = |why: String| {
        let message = format!("\"{}\" cannot be used as a texture: {why}", config.file.path);
        SceneErrors::from(SceneError::at(config.file.span.clone(), message))
    };
    let mut refuse = |refusal: Refusal| {
        // Beyond the limit of memory, but not beyond that of textures.
        if let Some(bytes) = refusal.bytes.filter(|bytes| *bytes <= Limits::TEXTURE.max_bytes)
            && let Err(error) = context.reserve((bytes as f64 * DECODING) as u64)
        {
            return error.or_at(&config.file.span);
        }
        why(refusal.why)
    };
    let channel = config.channel.as_ref();
    let alpha = channel.filter(|channel| *channel.get_ref() == Channel::Alpha);
    let texels = if is_gltf(path) {
        let index = config.image.as_ref().map_or(0, |index| *index.get_ref() as usize);
        from_gltf(path, index, alpha.is_some(), limits).map_err(refuse)?
    } else {
        let texels = match alpha {
            None => texels::read(path, limits),
            Some(_) => texels::read_alpha(path, limits),
        };
        texels.map_err(|error| match (error.fault, alpha) {
            (ReadFault::NoAlpha, Some(alpha)) => {
                let message = format!("\"{}\" has no alpha channel", config.file.path);
                SceneError::at(alpha.span(), message).into()
            }
            (fault, _) => refuse(fault.into()),
        })?
    };
    let texels = match channel.map(|channel| channel.get_ref()) {
        Some(Channel::Red) => one_channel(texels, 0),
        Some(Channel::Green) => one_channel(texels, 1),
        Some(Channel::Blue) => one_channel(texels, 2),
        Some(Channel::Color | Channel::Alpha) | None => texels,
    };
    let is_negative = |texel: &[f32; 3]| texel.iter().any(|value| *value < 0.0);
    if let Some(at) = texels.data.iter().position(is_negative) {
        let (x, y) = (at % texels.width, at / texels.width);
        let what = if alpha.is_some() { "alpha" } else { "a colour" };
        return Err(why(format!("{what} is negative at column {x}, row {y}")));
    }
    Ok(texels)
}

fn is_gltf(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    extension == "gltf" || extension == "glb"
}

/// Why a file is no texture.
struct Refusal {
    why: String,
    /// The bytes of its texels, if they are too many.
    bytes: Option<u64>,
}

impl From<ReadFault> for Refusal {
    fn from(fault: ReadFault) -> Self {
        let bytes = match &fault {
            ReadFault::TooLarge { bytes, .. } => u64::try_from(*bytes).ok(),
            _ => None,
        };
        let why = fault.to_string();
        Self { why, bytes }
    }
}

/// An image of a glTF file, or its alpha: 1 if it has none.
fn from_gltf(path: &Path, index: usize, alpha: bool, limits: Limits) -> Result<Texels, Refusal> {
    let outside = |why: String| Refusal { why, bytes: None };
    let document = Document::open(path).map_err(|error| outside(error.to_string()))?;
    let bytes = document
        .image(index)
        .map_err(|error| outside(error.to_string()))?;
    let faulty = |fault: ReadFault| {
        let refusal = Refusal::from(fault);
        Refusal {
            why: format!("/images/{index}: {}", refusal.why),
            ..refusal
        }
    };
    let colors = |bytes: &[u8]| texels::decode(bytes, limits).map_err(faulty);
    if !alpha {
        return colors(&bytes);
    }
    match texels::decode_alpha(&bytes, limits) {
        Err(ReadFault::NoAlpha) => {
            let mut texels = colors(&bytes)?;
            texels.data.fill([1.0; 3]);
            Ok(texels)
        }
        other => other.map_err(faulty),
    }
}

fn one_channel(mut texels: Texels, channel: usize) -> Texels {
    for texel in &mut texels.data {
        *texel = [texel[channel]; 3];
    }
    texels
}

#[cfg(test)]
mod tests;
