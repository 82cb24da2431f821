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
mod tests {
    use super::*;
    use crate::support::pyramid::{Ellipse, Grid, elliptical};
    use crate::support::wrap::Wrap;
    use whitstone_core::{DVec2, DVec3, Rgb, SurfaceInteraction, Vec4};
    use whitstone_image::planes;
    use whitstone_image::png;
    use whitstone_image::tone::srgb_to_linear;
    use whitstone_testkit::{TestContext, build_in, texture_laws};

    /// An image of 4 x 2 texels with the codes 10 (column + 1) + row.
    fn picture(extra: &str) -> Arc<dyn Texture> {
        let raster = png::Raster::from_fn(4, 2, |x, y| [(10 * (x + 1) + y) as u8, 0, 255]);
        let folder = tempfile::tempdir().unwrap();
        raster.write_png(folder.path().join("a.png")).unwrap();
        build(folder.path(), &format!("file = \"a.png\"\n{extra}")).unwrap()
    }

    fn build(folder: &Path, text: &str) -> Result<Arc<dyn Texture>, SceneErrors> {
        build_in::<Textures, Image>(text, (), &mut TestContext::in_folder(folder))
    }

    fn at(texture: &dyn Texture, u: f64, v: f64) -> Rgb {
        let mut point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        point.uv = DVec2::new(u, v);
        texture.value(&point)
    }

    fn code(texture: &dyn Texture, u: f64, v: f64) -> f64 {
        at(texture, u, v).r * 255.0
    }

    #[test]
    fn laws() {
        for filter in ["nearest", "bilinear", "trilinear", "ewa"] {
            for wrap in ["repeat", "clamp", "mirror"] {
                let text = format!("filter = \"{filter}\"\nwrap = \"{wrap}\"\nscale = [-3, 1e200]");
                texture_laws(&*picture(&text));
                texture_laws(&*picture(&format!("filter = \"{filter}\"\nwrap = \"{wrap}\"")));
            }
        }
    }

    #[test]
    fn a_file_is_decoded_once_for_all_textures_that_read_the_same_from_it() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.png");
        let write = |code: u8| {
            png::Raster::from_fn(4, 2, |_, _| [code; 3])
                .write_png(&file)
                .unwrap()
        };
        let mut context = TestContext::in_folder(folder.path());
        let mut build = |text: &str| {
            let text = format!("file = \"{text}");
            build_in::<Textures, Image>(&text, (), &mut context).unwrap()
        };
        let linear = "color_space = \"linear\"";
        write(10);
        let first = build(&format!("a.png\"\n{linear}"));
        // Whoever decodes the file again sees another picture.
        write(20);
        let same = [
            format!("a.png\"\n{linear}\nwrap = \"clamp\"\nscale = 2"),
            format!("./a.png\"\n{linear}\nfilter = \"ewa\""),
            format!("a.png\"\n{linear}\nfilter = \"trilinear\"\nchannel = \"color\""),
        ];
        let same = same.map(|text| build(&text));
        let others = [
            "\ncolor_space = \"srgb\"",
            "\nchannel = \"red\"\ncolor_space = \"linear\"",
        ];
        let others = others.map(|text| build(&format!("a.png\"{text}")));
        let shared = |texture: &dyn Texture| texture.bytes().unwrap().shared;
        for texture in &same {
            assert!((code(&**texture, 0.5, 0.5) - 10.0).abs() < 1e-12);
            assert_eq!(shared(&**texture), shared(&*first));
        }
        for texture in &others {
            assert_ne!(shared(&**texture), shared(&*first));
        }
        assert!((code(&*others[1], 0.5, 0.5) - 20.0).abs() < 1e-12);
        // Three pictures, of which one has a mip map.
        let bytes = |texture: &dyn Texture| texture.bytes().unwrap();
        let texels = bytes(&*first).texels;
        assert_eq!(context.reserved, 3 * texels + bytes(&*same[1]).levels);
    }

    #[test]
    fn texel_centres_are_where_the_model_says() {
        for filter in ["nearest", "bilinear"] {
            let texture = picture(&format!("filter = \"{filter}\"\ncolor_space = \"linear\""));
            for i in 0..4 {
                for j in 0..2 {
                    let (u, v) = ((f64::from(i) + 0.5) / 4.0, 1.0 - (f64::from(j) + 0.5) / 2.0);
                    let expected = f64::from(10 * (i + 1) + j);
                    assert!(
                        (code(&*texture, u, v) - expected).abs() < 1e-13,
                        "{filter} {i} {j}"
                    );
                }
            }
        }
    }

    #[test]
    fn bilinear_is_the_mean_between_centres() {
        let texture = picture("color_space = \"linear\"");
        assert!((code(&*texture, 0.25, 0.75) - 15.0).abs() < 1e-13);
        assert!((code(&*texture, 0.25, 0.5) - 15.5).abs() < 1e-13);
        // Across the seam, columns 3 and 0 are interpolated.
        assert!((code(&*texture, 0.0, 0.75) - 25.0).abs() < 1e-13);
        let clamped = picture("color_space = \"linear\"\nwrap = \"clamp\"");
        assert!((code(&*clamped, 0.0, 0.75) - 10.0).abs() < 1e-13);
        assert!((code(&*clamped, 7.0, 2.0) - 40.0).abs() < 1e-13);
    }

    #[test]
    fn pictures_are_wrapped() {
        let columns = |wrap: &str| -> Vec<f64> {
            let texture = picture(&format!(
                "filter = \"nearest\"\ncolor_space = \"linear\"\nwrap = \"{wrap}\""
            ));
            (-5..10)
                .map(|i| (code(&*texture, (f64::from(i) + 0.5) / 4.0, 0.75) / 10.0).round() - 1.0)
                .collect()
        };
        let [r, c, m] = ["repeat", "clamp", "mirror"].map(columns);
        assert_eq!(r, [3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1].map(f64::from));
        assert_eq!(c, [0, 0, 0, 0, 0, 0, 1, 2, 3, 3, 3, 3, 3, 3, 3].map(f64::from));
        assert_eq!(m, [3, 3, 2, 1, 0, 0, 1, 2, 3, 3, 2, 1, 0, 0, 1].map(f64::from));
    }

    /// Each axis has its own wrap rule: repeat horizontally, clamp vertically, or the reverse.
    #[test]
    fn each_axis_is_wrapped_by_its_own_word() {
        for filter in ["bilinear", "trilinear", "ewa"] {
            let texture = picture(&format!(
                "filter = \"{filter}\"\ncolor_space = \"linear\"\nwrap = [\"repeat\", \"clamp\"]"
            ));
            assert!((code(&*texture, 0.0, 0.75) - 25.0).abs() < 1e-13);
            assert!((code(&*texture, 0.125, 1.0) - 10.0).abs() < 1e-13);
            assert!((code(&*texture, 0.125, 0.0) - 11.0).abs() < 1e-13);
            let texture = picture(&format!(
                "filter = \"{filter}\"\ncolor_space = \"linear\"\nwrap = [\"clamp\", \"repeat\"]"
            ));
            assert!((code(&*texture, 0.0, 0.75) - 10.0).abs() < 1e-13);
            assert!((code(&*texture, 0.125, 1.0) - 10.5).abs() < 1e-13);
        }
        let folder = tempfile::tempdir().unwrap();
        png::Raster::from_fn(2, 2, |_, _| [1, 2, 3])
            .write_png(folder.path().join("a.png"))
            .unwrap();
        for (wrap, place) in [
            ("\"around\"", "\"around\""),
            ("[\"repeat\"]", "[\"repeat\"]"),
            ("[\"repeat\", \"over\"]", "\"over\""),
            (
                "[\"repeat\", \"clamp\", \"clamp\"]",
                "[\"repeat\", \"clamp\", \"clamp\"]",
            ),
        ] {
            let text = format!("file = \"a.png\"\nwrap = {wrap}");
            let error = build(folder.path(), &text).err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], place, "{}", error.message);
        }
    }

    #[test]
    fn huge_indices_wrap_exactly() {
        // 2^60 + 4096 is a multiple of 4 and exactly representable.
        let index = f64::exp2(60.0) + 4096.0;
        assert_eq!(Wrap::Repeat.index(index, 3), ((1_u64 << 60) + 4096) as usize % 3);
        assert_eq!(Wrap::Mirror.index(-1.0, 3), 0);
        assert_eq!(Wrap::Repeat.index(f64::MAX, 7), f64::MAX.rem_euclid(7.0) as usize);
        for wrap in [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror] {
            for index in [f64::INFINITY, f64::NEG_INFINITY, f64::NAN, -1e300, 1e300] {
                assert!(wrap.index(index, 5) < 5);
            }
        }
    }

    #[test]
    fn codes_are_decoded_before_filtering() {
        let texture = picture("");
        let decoded = |code: f64| srgb_to_linear(code / 255.0);
        assert_eq!(at(&*texture, 0.125, 0.75), Rgb::new(decoded(10.0), 0.0, 1.0));
        let middle = 0.5 * decoded(10.0) + 0.5 * decoded(20.0);
        assert!((at(&*texture, 0.25, 0.75).r - middle).abs() < 1e-17);
    }

    #[test]
    fn scale_comes_before_offset() {
        let texture =
            picture("filter = \"nearest\"\ncolor_space = \"linear\"\nscale = [2, 1]\noffset = [0.25, 0]");
        assert_eq!(code(&*texture, 0.0, 0.75).round(), 20.0);
        assert_eq!(code(&*texture, 0.25, 0.75).round(), 40.0);
    }

    #[test]
    fn floats_are_linear_unless_said_otherwise() {
        let folder = tempfile::tempdir().unwrap();
        let image = planes::Image::from_rgb(1, 1, &[[0.5, 7.0, 0.0]]).unwrap();
        whitstone_image::exr_io::write(folder.path().join("a.exr"), &image).unwrap();
        let value = |extra: &str| {
            at(
                &*build(folder.path(), &format!("file = \"a.exr\"\n{extra}")).unwrap(),
                0.3,
                0.3,
            )
        };
        assert_eq!(value(""), Rgb::new(0.5, 7.0, 0.0));
        assert!((value("color_space = \"srgb\"").r - srgb_to_linear(0.5)).abs() < 1e-16);
    }

    #[test]
    fn alpha_is_a_grey_that_is_never_decoded() {
        let folder = tempfile::tempdir().unwrap();
        let planes = [("R", 0.5), ("G", 0.5), ("B", 0.5), ("A", 0.25)];
        let mut image = planes::Image::new(1, 1).unwrap();
        for (name, value) in planes {
            image.add_channel(name, vec![value]).unwrap();
        }
        whitstone_image::exr_io::write(folder.path().join("a.exr"), &image).unwrap();
        let leaf = whitstone_testkit::assets::generate();
        let (_, bytes) = leaf.iter().find(|(name, _)| *name == "leaf.png").unwrap();
        std::fs::write(folder.path().join("leaf.png"), bytes).unwrap();
        let seen = |text: &str| at(&*build(folder.path(), text).unwrap(), 0.5, 0.5);
        assert_eq!(seen("file = \"a.exr\""), Rgb::splat(0.5));
        assert_eq!(seen("file = \"a.exr\"\nchannel = \"color\""), Rgb::splat(0.5));
        assert_eq!(seen("file = \"a.exr\"\nchannel = \"alpha\""), Rgb::splat(0.25));
        let leaf = build(
            folder.path(),
            "file = \"leaf.png\"\nchannel = \"alpha\"\nfilter = \"nearest\"",
        )
        .unwrap();
        texture_laws(&*leaf);
        // Opaque, transparent and partial coverage; the codes have their exact values.
        let values: Vec<Rgb> = (0..32 * 32)
            .map(|k| {
                at(
                    &*leaf,
                    (f64::from(k % 32) + 0.5) / 32.0,
                    (f64::from(k / 32) + 0.5) / 32.0,
                )
            })
            .collect();
        for expected in [0.0, 1.0] {
            assert!(
                values
                    .iter()
                    .filter(|value| **value == Rgb::splat(expected))
                    .count()
                    > 100
            );
        }
        let in_part = values.iter().find(|value| (0.2..0.8).contains(&value.r)).unwrap();
        assert!((in_part.r * 255.0).fract().min(1.0 - (in_part.r * 255.0).fract()) < 1e-12);
        picture("channel = \"color\"");
    }

    #[test]
    fn alpha_that_is_not_there_is_an_error_at_the_word() {
        let folder = tempfile::tempdir().unwrap();
        png::Raster::from_fn(2, 2, |_, _| [1, 2, 3])
            .write_png(folder.path().join("a.png"))
            .unwrap();
        let mut negative = planes::Image::new(1, 1).unwrap();
        negative.add_channel("A", vec![-1.0]).unwrap();
        whitstone_image::exr_io::write(folder.path().join("a.exr"), &negative).unwrap();
        for (text, place, why) in [
            (
                "file = \"a.png\"\nchannel = \"alpha\"",
                "\"alpha\"",
                "has no alpha channel",
            ),
            (
                "file = \"a.png\"\nchannel = \"violet\"",
                "\"violet\"",
                "unknown value",
            ),
            (
                "file = \"a.exr\"\nchannel = \"alpha\"",
                "\"a.exr\"",
                "alpha is negative",
            ),
            (
                "file = \"a.exr\"\nchannel = \"alpha\"\ncolor_space = \"srgb\"",
                "\"srgb\"",
                "no color space",
            ),
        ] {
            let error = build(folder.path(), text).err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], place, "{}", error.message);
            assert!(error.message.contains(why), "{}", error.message);
        }
    }

    #[test]
    fn images_inside_gltf_files_are_chosen_by_number() {
        let folder = tempfile::tempdir().unwrap();
        for (name, code) in [("a.png", 10), ("b.png", 20)] {
            let raster = png::Raster::from_fn(2, 2, |_, _| [code; 3]);
            raster.write_png(folder.path().join(name)).unwrap();
        }
        let text = r#"{"asset": {"version": "2.0"}, "images": [{"uri": "a.png"}, {"uri": "b.png"}]}"#;
        std::fs::write(folder.path().join("two.gltf"), text).unwrap();
        let seen = |text: &str| {
            let text = format!("file = \"two.gltf\"\n{text}");
            code(&*build(folder.path(), &text).unwrap(), 0.5, 0.5).round()
        };
        assert_eq!(seen("color_space = \"linear\""), 10.0);
        assert_eq!(seen("color_space = \"linear\"\nimage = 1"), 20.0);
        // An image without alpha is opaque.
        assert_eq!(seen("image = 1\nchannel = \"alpha\""), 255.0);
        let text = "file = \"a.png\"\nimage = 1";
        let error = build(folder.path(), text).err().unwrap().0.remove(0);
        assert_eq!(&text[error.span.unwrap()], "1");
    }

    #[test]
    fn bad_files_are_refused_at_their_place() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("text.png"), "no picture").unwrap();
        let negative = planes::Image::from_rgb(2, 1, &[[0.0; 3], [0.0, -1.0, 0.0]]).unwrap();
        whitstone_image::exr_io::write(folder.path().join("negative.exr"), &negative).unwrap();
        for (name, why) in [
            ("text.png", "cannot be used as a texture"),
            ("negative.exr", "negative at column 1, row 0"),
            ("missing.png", "missing.png"),
        ] {
            let text = format!("file = \"{name}\"");
            let error = build(folder.path(), &text).err().unwrap().0.remove(0);
            assert_eq!(error.span, Some(7..text.len()), "{name}");
            assert!(error.message.contains(why), "{}", error.message);
        }
    }

    #[test]
    fn an_image_beyond_the_memory_limit_is_not_decoded() {
        let folder = tempfile::tempdir().unwrap();
        let raster = png::Raster::from_fn(10, 10, |_, _| [9; 3]);
        raster.write_png(folder.path().join("a.png")).unwrap();
        let text = "file = \"a.png\"";
        let build = |limit: u64| {
            let mut context = TestContext::in_folder(folder.path());
            context.limit = Some(limit);
            let built = build_in::<Textures, Image>(text, (), &mut context);
            built.map(|_| context.reserved)
        };
        let needed = (100.0 * 12.0 * DECODING) as u64;
        assert_eq!(build(needed).unwrap(), 3 * 100 + 256 * 8);
        let error = build(needed - 1).err().unwrap().0.remove(0);
        assert_eq!(error.span, Some(7..text.len()));
        assert!(error.message.contains("of 2999 bytes"), "{}", error.message);
    }

    /// An image of noise, so that different means are distinguishable.
    fn noise(width: u32, height: u32, extra: &str) -> Arc<dyn Texture> {
        let code = |x: usize, y: usize, c: u32| {
            let number = 3 * (y as u32 * width + x as u32) + c;
            (whitstone_core::hash::mix(number) >> 24) as u8
        };
        let raster = png::Raster::from_fn(width as usize, height as usize, |x, y| {
            [0, 1, 2].map(|c| code(x, y, c))
        });
        let folder = tempfile::tempdir().unwrap();
        raster.write_png(folder.path().join("a.png")).unwrap();
        let text = format!("file = \"a.png\"\ncolor_space = \"linear\"\n{extra}");
        build(folder.path(), &text).unwrap()
    }

    /// The value of a sample with these steps to its neighbours.
    fn filtered(texture: &dyn Texture, at: [f64; 2], steps: [[f64; 2]; 2]) -> Rgb {
        let mut point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        point.uv = at.into();
        point.footprint.uv = steps.map(|step| DVec2::from(step).as_vec2());
        texture.value(&point)
    }

    /// Half axis of an ellipse, in texels per texel of a sample's step.
    const RADIUS: f64 = 0.782_549_4;

    fn distance(a: Rgb, b: Rgb) -> f64 {
        (a + b * -1.0)
            .to_array()
            .into_iter()
            .fold(0.0, |most, c| most.max(c.abs()))
    }

    #[test]
    fn one_colour_stays_itself_under_every_filter() {
        let folder = tempfile::tempdir().unwrap();
        let raster = png::Raster::from_fn(13, 6, |_, _| [90, 7, 255]);
        raster.write_png(folder.path().join("a.png")).unwrap();
        let expected = Rgb::from([90.0, 7.0, 255.0].map(|code| srgb_to_linear(code / 255.0)));
        for filter in ["trilinear", "ewa"] {
            for wrap in ["repeat", "clamp", "mirror"] {
                let text = format!("file = \"a.png\"\nfilter = \"{filter}\"\nwrap = \"{wrap}\"");
                let texture = build(folder.path(), &text).unwrap();
                for step in [0.0, 1e-3, 0.05, 0.3, 1.7, 50.0] {
                    for other in [1e-4, 0.1, 3.0] {
                        let found =
                            filtered(&*texture, [0.3, 2.6], [[step, 0.2 * step], [-0.1 * other, other]]);
                        // At most one single-precision rounding per texel of the longest ellipse.
                        let most = 1024.0 * f64::from(f32::EPSILON);
                        assert!(
                            distance(found, expected) < most,
                            "{filter} {wrap} {step} {other}: {found:?}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn where_samples_are_closer_than_texels_all_filters_are_bilinear() {
        let pictures = ["bilinear", "trilinear", "ewa"].map(|f| noise(16, 16, &format!("filter = \"{f}\"")));
        for k in 0..40 {
            let at = [0.07 * f64::from(k), 0.31 * f64::from(k)];
            let steps = [[0.9 / 16.0, 0.01], [-0.03, 0.8 / 16.0]];
            let [plain, trilinear, ewa] = [0, 1, 2].map(|i| filtered(&*pictures[i], at, steps));
            assert_eq!((plain, plain), (trilinear, ewa), "{k}");
        }
        // For larger steps they differ.
        let wide = [[3.0 / 16.0, 0.0], [0.0, 3.0 / 16.0]];
        let [plain, trilinear, ewa] = [0, 1, 2].map(|i| filtered(&*pictures[i], [0.2, 0.4], wide));
        assert!(plain != trilinear && plain != ewa && trilinear != ewa);
    }

    #[test]
    fn values_change_continuously_with_the_size_of_a_sample() {
        let [trilinear, ewa] = ["trilinear", "ewa"].map(|f| noise(16, 8, &format!("filter = \"{f}\"")));
        let at = [3.8 / 16.0, 3.7 / 8.0];
        let steps = |wide: f64, high: f64| [[wide / 16.0, 0.0], [0.0, high / 8.0]];
        for [across, down] in [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]] {
            let of =
                |texture: &dyn Texture, size: f64| filtered(texture, at, steps(across * size, down * size));
            // Between two levels the logarithm of the longest step counts.
            let [two, four] = [2.0, 4.0].map(|size| of(&*trilinear, size));
            assert!(distance(two, four) > 0.01, "{two:?} {four:?}");
            let between = of(&*trilinear, 2.0 * 2.0_f64.powf(0.25));
            assert!(
                distance(between, two * 0.75 + four * 0.25) < 1e-6,
                "{across} {down}"
            );
        }
        // From the bilinear value at one texel to the mean over an ellipse at two, and from level
        // to level.
        let of = |size: f64| filtered(&*ewa, at, steps(size, size));
        for size in [1.0, 2.0, 4.0].map(|half_axis| half_axis / RADIUS) {
            let (before, after) = (of(size * (1.0 - 1e-5)), of(size * (1.0 + 1e-5)));
            assert!(distance(before, after) < 1e-3, "{size}: {before:?} {after:?}");
        }
        for [one, other] in [[0.9, 1.6], [1.6, 2.2], [2.2, 3.1]] {
            assert!(distance(of(one), of(other)) > 0.01, "{one} {other}");
        }
    }

    #[test]
    fn the_mean_over_an_ellipse_is_blended_in_between_one_texel_and_two() {
        let [nearest, bilinear, ewa] =
            ["nearest", "bilinear", "ewa"].map(|f| noise(16, 8, &format!("filter = \"{f}\"")));
        let grid = || Grid {
            width: 16,
            height: 8,
            wrap: [Wrap::Repeat; 2],
        };
        // Rows go down while v goes up.
        let texel = |index: usize| {
            let (i, j) = ((index % 16) as f64, (index / 16) as f64);
            let [r, g, b] = at(&*nearest, (i + 0.5) / 16.0, 1.0 - (j + 0.5) / 8.0).to_array();
            Vec4::new(r as f32, g as f32, b as f32, 0.0)
        };
        // The half axis in texels, and the share of the mean.
        for (long, part) in [
            (1.01, 0.01),
            (1.25, 0.25),
            (1.5, 0.5),
            (1.75, 0.75),
            (2.0, 1.0),
            (3.0, 1.0),
        ] {
            let step = long / RADIUS;
            let (place, steps) = ([3.8 / 16.0, 3.7 / 8.0], [[step / 16.0, 0.0], [0.0, 0.5 / 8.0]]);
            let ellipse = Ellipse::new(steps.map(DVec2::from), DVec2::new(16.0, 8.0), 16.0);
            assert!((ellipse.long - long).abs() < 1e-12);
            let mean = elliptical(grid(), texel, DVec2::new(place[0], 1.0 - place[1]), &ellipse);
            let plain = filtered(&*bilinear, place, steps);
            assert!(distance(mean, plain) > 1e-3, "{mean:?} {plain:?}");
            let expected = plain * (1.0 - part) + mean * part;
            let found = filtered(&*ewa, place, steps);
            assert!(distance(found, expected) < 1e-5, "{long}: {found:?} {expected:?}");
        }
    }

    #[test]
    fn samples_are_scaled_with_the_image() {
        for filter in ["nearest", "trilinear", "ewa"] {
            let [plain, scaled] =
                ["", "scale = [2, 4]"].map(|scale| noise(16, 8, &format!("filter = \"{filter}\"\n{scale}")));
            assert_eq!(scaled.size(), Some([16, 8]));
            let (at, steps) = ([0.11, 0.17], [[0.125, 0.03125], [-0.0625, 0.125]]);
            let expected = filtered(
                &*plain,
                [2.0 * at[0], 4.0 * at[1]],
                steps.map(|[s, t]| [2.0 * s, 4.0 * t]),
            );
            assert_eq!(filtered(&*scaled, at, steps), expected, "{filter}");
        }
    }

    /// Compares filtered noise over circles and ellipses with the mean over many points of the
    /// sample's square or parallelogram, which the filters approximate.
    #[test]
    fn ellipses_are_nearer_to_the_mean_over_a_sample_than_levels_are() {
        let [plain, trilinear, ewa] =
            ["bilinear", "trilinear", "ewa"].map(|f| noise(64, 64, &format!("filter = \"{f}\"")));
        let mean = |at: [f64; 2], [s, t]: [[f64; 2]; 2]| {
            let points = 64;
            let mut sum = Rgb::BLACK;
            for k in 0..points * points {
                let part = |k: i32| (f64::from(k) + 0.5) / f64::from(points) - 0.5;
                let (a, b) = (part(k % points), part(k / points));
                let at = [at[0] + a * s[0] + b * t[0], at[1] + a * s[1] + b * t[1]];
                sum += filtered(&*plain, at, [[0.0; 2]; 2]);
            }
            sum * (1.0 / f64::from(points * points))
        };
        // In texels, for nearly round and for elongated samples: (error of trilinear, error of
        // EWA).
        let errors = |s: [f64; 2], t: [f64; 2]| {
            let steps = [s, t].map(|step| step.map(|x| x / 64.0));
            let of = |texture: &dyn Texture| {
                let square = |k: i32| {
                    let at = [0.013 + 0.17 * f64::from(k), 0.029 + 0.11 * f64::from(k)];
                    distance(filtered(texture, at, steps), mean(at, steps)).powi(2)
                };
                ((0..24).map(square).sum::<f64>() / 24.0).sqrt()
            };
            (of(&*trilinear), of(&*ewa))
        };
        let (levels, ellipses) = errors([4.0, 0.0], [0.0, 4.0]);
        assert!(
            ellipses < levels && levels < 0.15,
            "round: {levels} and {ellipses}"
        );
        for (s, t) in [
            ([24.0, 0.0], [0.0, 2.0]),
            ([0.0, 24.0], [2.0, 0.0]),
            ([17.0, 17.0], [-1.4, 1.4]),
            ([17.0, -17.0], [16.0, -18.5]),
        ] {
            let (levels, ellipses) = errors(s, t);
            assert!(
                3.0 * ellipses < 2.0 * levels,
                "{s:?} {t:?}: {levels} and {ellipses}"
            );
        }
    }

    #[test]
    fn far_away_there_is_one_colour_and_it_is_the_mean() {
        for (width, height) in [(16, 16), (13, 7), (1, 5), (1, 1)] {
            let plain = noise(width, height, "filter = \"nearest\"");
            let mut mean = Rgb::BLACK;
            for k in 0..width * height {
                let (i, j) = (f64::from(k % width) + 0.5, f64::from(k / width) + 0.5);
                mean += at(&*plain, i / f64::from(width), j / f64::from(height));
            }
            mean = mean * (1.0 / f64::from(width * height));
            for filter in ["trilinear", "ewa"] {
                let texture = noise(width, height, &format!("filter = \"{filter}\""));
                for far in [1e4, 1e30, f64::INFINITY] {
                    let found = filtered(&*texture, [0.2, 0.9], [[far, 0.0], [0.0, far]]);
                    assert!(
                        distance(found, mean) < 1e-6,
                        "{filter} {width} x {height}, {far}: {found:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn long_ellipses_are_bounded_and_the_bound_is_heard() {
        let [one, sixteen] =
            ["1", "16"].map(|n| noise(64, 64, &format!("filter = \"ewa\"\nmax_anisotropy = {n}")));
        let steps = [[0.5, 0.0], [0.0, 1.0 / 64.0]];
        assert!(filtered(&*one, [0.3, 0.3], steps) != filtered(&*sixteen, [0.3, 0.3], steps));
        let usual = noise(64, 64, "filter = \"ewa\"");
        assert_eq!(
            filtered(&*usual, [0.3, 0.3], steps),
            filtered(&*sixteen, [0.3, 0.3], steps)
        );
        // Both steps along one line: the ellipse has zero width.
        let flat = [[0.5, 0.25], [1.0, 0.5]];
        assert!(is_colour(filtered(&*usual, [0.3, 0.3], flat)));
        let folder = tempfile::tempdir().unwrap();
        png::Raster::from_fn(2, 2, |_, _| [0; 3])
            .write_png(folder.path().join("a.png"))
            .unwrap();
        for (filter, bad) in [
            ("ewa", "0"),
            ("ewa", "65"),
            ("ewa", "inf"),
            ("ewa", "2.5"),
            ("trilinear", "8"),
            ("bilinear", "8"),
        ] {
            let text = format!("file = \"a.png\"\nfilter = \"{filter}\"\nmax_anisotropy = {bad}");
            let error = build(folder.path(), &text).err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], bad, "{}", error.message);
        }
    }

    fn is_colour(color: Rgb) -> bool {
        color.to_array().into_iter().all(|c| c.is_finite() && c >= 0.0)
    }

    #[test]
    fn levels_are_there_only_where_they_are_read_and_their_memory_is_told() {
        let bytes = |filter: &str| noise(64, 32, &format!("filter = \"{filter}\"")).bytes().unwrap();
        let table = 256 * size_of::<f64>() as u64;
        for filter in ["nearest", "bilinear"] {
            assert_eq!(
                (bytes(filter).texels, bytes(filter).levels),
                (3 * 64 * 32 + table, 0)
            );
        }
        // 32 x 16 + 16 x 8 + 8 x 4 + 4 x 2 + 2 x 1 + 1 x 1 texels of three numbers each, and one
        // texel of padding for each of the six levels.
        for filter in ["trilinear", "ewa"] {
            assert_eq!(bytes(filter).levels, (683 + 6) * 12);
        }
    }
}
