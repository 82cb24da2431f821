//! A picture from a file.
//!
//! - Twin: Mitsuba `bitmap` (native).
//! - Example: `scenes/textures/image.toml`.

use crate::mapping::{Mapping, Projection};
use crate::raster::{ColorSpace, Filter, Raster, Store};
use crate::wrap::Wrap;
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::{FilePath, Scale2, Vector2};
use whitstone_core::{Context, Plugin, SceneError, SceneErrors, Texture, Textures};
use whitstone_image::limits::Limits;
use whitstone_image::texels;

/// A picture from a PNG, JPEG or EXR file.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The file, relative to the scene.
    file: FilePath,
    /// Between texel centres: "bilinear" interpolation, or the "nearest" texel.
    #[serde(default)]
    filter: Filter,
    /// Outside of the picture: "repeat" it, "clamp" to its border, or "mirror" it.
    #[serde(default)]
    wrap: Wrap,
    /// What the values in the file are: "srgb", "linear", or "auto": sRGB for PNG and JPEG, linear for EXR.
    #[serde(default)]
    color_space: ColorSpace,
    /// Pictures in a unit of u and of v.
    #[serde(default = "one")]
    scale: Scale2,
    /// Added after scaling.
    #[serde(default = "zero")]
    offset: Vector2,
    /// Where the texture lies; by (u, v) if left out.
    #[serde(default)]
    mapping: Mapping,
}

fn one() -> Scale2 {
    Scale2::splat(1.0)
}

fn zero() -> Vector2 {
    Vector2::new(0.0, 0.0)
}

/// See the module.
pub struct Image;

impl Plugin<Textures> for Image {
    const TYPE: &'static str = "image";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Texture>, SceneErrors> {
        let path = context.file(&config.file)?;
        let refuse = |why: String| {
            let message = format!("\"{}\" is no texture: {why}", config.file.path);
            SceneErrors::from(SceneError::at(config.file.span.clone(), message))
        };
        let texels = texels::read(&path, Limits::TEXTURE).map_err(|error| refuse(error.fault.to_string()))?;
        if let Some(at) = texels
            .data
            .iter()
            .position(|texel| texel.iter().any(|value| *value < 0.0))
        {
            let (x, y) = (at % texels.width, at / texels.width);
            return Err(refuse(format!("a colour is negative at column {x}, row {y}")));
        }
        let pattern = Raster {
            width: texels.width,
            height: texels.height,
            store: Store::new(texels, config.color_space),
            filter: config.filter,
            wrap: config.wrap,
            scale: config.scale.get(),
            offset: config.offset.get(),
        };
        config.mapping.put(Projection::Uv, pattern)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{DVec2, DVec3, Rgb, SurfacePoint};
    use whitstone_image::planes;
    use whitstone_image::png;
    use whitstone_image::tone::srgb_to_linear;
    use whitstone_testkit::{TestContext, build_in, texture_laws};

    /// 4 x 2 texels whose codes are 10 (column + 1) + row.
    fn picture(extra: &str) -> Arc<dyn Texture> {
        let raster = png::Raster::from_fn(4, 2, |x, y| [(10 * (x + 1) + y) as u8, 0, 255]);
        let folder = tempfile::tempdir().unwrap();
        raster.write_png(folder.path().join("a.png")).unwrap();
        build(folder.path(), &format!("file = \"a.png\"\n{extra}")).unwrap()
    }

    fn build(folder: &std::path::Path, text: &str) -> Result<Arc<dyn Texture>, SceneErrors> {
        build_in::<Textures, Image>(text, (), &mut TestContext::in_folder(folder))
    }

    fn at(texture: &dyn Texture, u: f64, v: f64) -> Rgb {
        let mut point = SurfacePoint::new(DVec3::ZERO, 0.0, DVec3::Z);
        point.uv = DVec2::new(u, v);
        texture.value(&point)
    }

    fn code(texture: &dyn Texture, u: f64, v: f64) -> f64 {
        at(texture, u, v).r * 255.0
    }

    #[test]
    fn laws() {
        for filter in ["nearest", "bilinear"] {
            for wrap in ["repeat", "clamp", "mirror"] {
                let text = format!("filter = \"{filter}\"\nwrap = \"{wrap}\"\nscale = [-3, 1e200]");
                texture_laws(&*picture(&text));
                texture_laws(&*picture(&format!("filter = \"{filter}\"\nwrap = \"{wrap}\"")));
            }
        }
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
        // Across the seam: columns 3 and 0.
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

    #[test]
    fn huge_indices_wrap_exactly() {
        // 2^60 + 4096 is a multiple of 4 and a number.
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
    fn bad_files_are_refused_at_their_place() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("text.png"), "no picture").unwrap();
        let negative = planes::Image::from_rgb(2, 1, &[[0.0; 3], [0.0, -1.0, 0.0]]).unwrap();
        whitstone_image::exr_io::write(folder.path().join("negative.exr"), &negative).unwrap();
        for (name, why) in [
            ("text.png", "is no texture"),
            ("negative.exr", "negative at column 1, row 0"),
            ("missing.png", "missing.png"),
        ] {
            let text = format!("file = \"{name}\"");
            let error = build(folder.path(), &text).err().unwrap().0.remove(0);
            assert_eq!(error.span, Some(7..text.len()), "{name}");
            assert!(error.message.contains(why), "{}", error.message);
        }
    }
}
