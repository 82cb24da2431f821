//! A voxel grid of colours, as a solid texture.
//!
//! Peachey, *Solid texturing of complex surfaces*, 1985, section 3.
//!
//! - Twin: Mitsuba, hosted: a Python texture, written from the model.
//! - Example: `scenes/textures/solid.toml`.

use crate::support::mapping::{Mapping, Projection, TextureFunction};
use crate::support::wrap::Wrap;
use schemars::JsonSchema;
use serde::de::{SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::fmt;
use std::path::Path;
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::{FilePath, IntegerIn, NonNegative};
use whitstone_core::{Context, DVec3, Plugin, Rgb, SceneError, SceneErrors, Texture, TextureBytes, Textures};

/// A voxel grid of colours, as a solid texture.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Voxels along x, y and z; together they fill the unit cube of texture space.
    #[schemars(with = "[IntegerIn<1, 4096>; 3]")]
    size: Spanned<[IntegerIn<1, 4096>; 3]>,
    /// Numbers per voxel: 1 (grey) or 3 (linear RGB).
    #[serde(default)]
    #[schemars(with = "u8")]
    channels: Channels,
    /// The numbers, each at least 0. Those of a voxel are adjacent; voxels are ordered along x
    /// first, then y, then z.
    #[serde(default)]
    #[schemars(extend("x-default" = "none: this or `file` is required"), with = "Vec<NonNegative>")]
    values: Option<Spanned<Values>>,
    /// A raw file that contains only the numbers; path relative to the scene.
    #[serde(default)]
    #[schemars(extend("x-default" = "none: this or `values` is required"))]
    file: Option<FilePath>,
    /// Format of the file: "u8" (bytes, 255 means 1) or "f32" (little-endian).
    #[serde(default)]
    #[schemars(extend("default" = "u8"), with = "Format")]
    format: Option<Spanned<Format>>,
    /// "trilinear" interpolates between voxel centres; "nearest" uses the nearest voxel.
    #[serde(default)]
    filter: Filter,
    /// Continuation outside of the grid: "repeat", "clamp" to its border, or "mirror".
    #[serde(default)]
    wrap: Wrap,
    /// Mapping of the texture.
    #[serde(default)]
    #[schemars(extend("x-default" = "by world-space position"))]
    mapping: Mapping,
}

/// A list of numbers, each with its own error location.
#[derive(Debug)]
struct Values(Vec<f64>);

impl<'de> Deserialize<'de> for Values {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct List;
        impl<'de> Visitor<'de> for List {
            type Value = Values;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an array of numbers")
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Values, A::Error> {
                let mut values = Vec::new();
                while let Some(value) = seq.next_element::<NonNegative>()? {
                    values.push(value.get());
                }
                Ok(Values(values))
            }
        }
        deserializer.deserialize_seq(List)
    }
}

/// Numbers per voxel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(try_from = "u8", into = "u8")]
enum Channels {
    /// Grey.
    #[default]
    One,
    /// Linear RGB.
    Three,
}

impl TryFrom<u8> for Channels {
    type Error = String;
    fn try_from(count: u8) -> Result<Self, String> {
        match count {
            1 => Ok(Self::One),
            3 => Ok(Self::Three),
            _ => Err(format!("expected 1 or 3, found {count}")),
        }
    }
}

impl From<Channels> for u8 {
    fn from(channels: Channels) -> Self {
        match channels {
            Channels::One => 1,
            Channels::Three => 3,
        }
    }
}

/// Format of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Format {
    /// Bytes; 255 means 1.
    #[default]
    U8,
    /// Little-endian single-precision floating-point numbers.
    F32,
}

/// Texture filter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Filter {
    /// Interpolates between the eight nearest voxels.
    #[default]
    Trilinear,
    /// The nearest voxel.
    Nearest,
}

/// The `solid` texture; see the module documentation.
pub struct Solid {
    size: [usize; 3],
    channels: Channels,
    store: Store,
    filter: Filter,
    wrap: Wrap,
}

/// The numbers in their original type, to save memory.
enum Store {
    U8(Vec<u8>),
    F32(Vec<f32>),
    F64(Vec<f64>),
}

impl Store {
    #[inline(always)]
    fn number(&self, index: usize) -> f64 {
        match self {
            Self::U8(codes) => f64::from(codes[index]) / 255.0,
            Self::F32(values) => f64::from(values[index]),
            Self::F64(values) => values[index],
        }
    }

    fn bytes(&self) -> u64 {
        let bytes = match self {
            Self::U8(codes) => size_of_val(&**codes),
            Self::F32(values) => size_of_val(&**values),
            Self::F64(values) => size_of_val(&**values),
        };
        bytes as u64
    }
}

impl Plugin<Textures> for Solid {
    const TYPE: &'static str = "solid";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Texture>, SceneErrors> {
        let size = config.size.get_ref().map(|n| n.get() as usize);
        let channels = match config.channels {
            Channels::One => 1,
            Channels::Three => 3,
        };
        // At most 2^38, so no overflow.
        let count = channels * size[0] * size[1] * size[2];
        let store = match (config.values, config.file, config.format) {
            (Some(values), None, None) => {
                let found = values.get_ref().0.len();
                if found != count {
                    let message = format!("expected {count} numbers by `size` and `channels`, found {found}");
                    return Err(SceneError::at(values.span(), message).into());
                }
                Store::F64(values.into_inner().0)
            }
            (None, Some(file), format) => {
                let path = context.file(&file)?;
                let format = format.map_or(Format::U8, Spanned::into_inner);
                let width = match format {
                    Format::U8 => 1,
                    Format::F32 => 4,
                };
                let bytes = (width * count) as u64;
                let refuse = |why: String| {
                    let message = format!("\"{}\" does not hold these numbers: {why}", file.path);
                    SceneErrors::from(SceneError::at(file.span.clone(), message))
                };
                // Checked before reading, so that a file of another size is not loaded.
                let found = std::fs::metadata(&path)
                    .map_err(|error| refuse(error.to_string()))?
                    .len();
                if found != bytes {
                    return Err(refuse(format!("expected {bytes} bytes, found {found}")));
                }
                // The file is first read as bytes.
                context.reserve(match format {
                    Format::U8 => bytes,
                    Format::F32 => 2 * bytes,
                })?;
                read(&path, format).map_err(refuse)?
            }
            (Some(_), None, Some(format)) => {
                return Err(SceneError::at(format.span(), "only a `file` has a format").into());
            }
            _ => {
                let message = "expected either `values` or `file`";
                return Err(SceneError::at(config.size.span(), message).into());
            }
        };
        let pattern = Self {
            size,
            channels: config.channels,
            store,
            filter: config.filter,
            wrap: config.wrap,
        };
        config.mapping.put(Projection::Solid, pattern)
    }
}

/// The numbers of a file, or the error in one of them.
fn read(path: &Path, format: Format) -> Result<Store, String> {
    let metadata = std::fs::metadata(path).map_err(|error| error.to_string())?;
    if !metadata.is_file() {
        return Err("it is not a regular file".to_owned());
    }
    let bytes = std::fs::read(path).map_err(|error| error.to_string())?;
    match format {
        Format::U8 => Ok(Store::U8(bytes)),
        Format::F32 => {
            let values: Vec<f32> = bytes
                .as_chunks::<4>()
                .0
                .iter()
                .map(|value| f32::from_le_bytes(*value))
                .collect();
            match values.iter().position(|x| !(x.is_finite() && *x >= 0.0)) {
                Some(at) => Err(format!(
                    "number {at} (from 0) is {}, expected a finite number of at least 0",
                    values[at]
                )),
                None => Ok(Store::F32(values)),
            }
        }
    }
}

impl Solid {
    /// The voxel at integer coordinates of any size.
    fn voxel(&self, i: f64, j: f64, k: f64) -> Rgb {
        let [nx, ny, nz] = self.size;
        let (i, j, k) = (
            self.wrap.index(i, nx),
            self.wrap.index(j, ny),
            self.wrap.index(k, nz),
        );
        let index = (k * ny + j) * nx + i;
        match self.channels {
            Channels::One => Rgb::splat(self.store.number(index)),
            Channels::Three => {
                let number = |channel| self.store.number(3 * index + channel);
                Rgb::new(number(0), number(1), number(2))
            }
        }
    }
}

impl TextureFunction for Solid {
    fn at(&self, q: DVec3) -> Rgb {
        let p = q * DVec3::from_array(self.size.map(|n| n as f64));
        if self.filter == Filter::Nearest {
            let p = p.floor();
            return self.voxel(p.x, p.y, p.z);
        }
        let p = p - 0.5;
        let low = p.floor();
        // Infinite coordinates have no fractional part.
        let part = (p - low).to_array().map(|t| if t.is_finite() { t } else { 0.0 });
        let between = |a: Rgb, b: Rgb, t: f64| a * (1.0 - t) + b * t;
        let along_x =
            |j: f64, k: f64| between(self.voxel(low.x, j, k), self.voxel(low.x + 1.0, j, k), part[0]);
        let along_y = |k: f64| between(along_x(low.y, k), along_x(low.y + 1.0, k), part[1]);
        between(along_y(low.z), along_y(low.z + 1.0), part[2])
    }

    fn bytes(&self) -> TextureBytes {
        TextureBytes {
            texels: self.store.bytes(),
            ..TextureBytes::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::SurfaceInteraction;
    use whitstone_testkit::{TestContext, build, build_in, texture_laws};

    const VALUES: &str = "size = [2, 3, 1]\nvalues = [0, 1, 2, 3, 4, 5]\n";

    fn at(texture: &dyn Texture, position: [f64; 3]) -> f64 {
        texture
            .value(&SurfaceInteraction::new(position.into(), 0.0, DVec3::Z))
            .g
    }

    fn fault(text: &str, context: &mut TestContext) -> (String, String) {
        let error = build_in::<Textures, Solid>(text, (), context)
            .err()
            .unwrap()
            .0
            .remove(0);
        (text[error.span.unwrap()].to_owned(), error.message)
    }

    #[test]
    fn laws() {
        for filter in ["nearest", "trilinear"] {
            for wrap in ["repeat", "clamp", "mirror"] {
                let text = format!("{VALUES}filter = \"{filter}\"\nwrap = \"{wrap}\"");
                texture_laws(&*build::<Textures, Solid>(&text, ()).unwrap());
            }
        }
    }

    #[test]
    fn voxels_have_their_middles_where_the_model_says() {
        for filter in ["nearest", "trilinear"] {
            let texture = build::<Textures, Solid>(&format!("{VALUES}filter = \"{filter}\""), ()).unwrap();
            for i in 0..2 {
                for j in 0..3 {
                    let middle = [(f64::from(i) + 0.5) / 2.0, (f64::from(j) + 0.5) / 3.0, 0.5];
                    let found = at(&*texture, middle);
                    assert!((found - f64::from(2 * j + i)).abs() < 1e-14, "{filter} {i} {j}");
                }
            }
        }
    }

    #[test]
    fn between_the_middles_lies_a_mean() {
        let texture = build::<Textures, Solid>(&format!("{VALUES}wrap = \"clamp\""), ()).unwrap();
        // A linear function is interpolated exactly: 4y'/... = 2 (3y - 1/2) + (2x - 1/2).
        for (x, y) in [(0.3, 0.2), (0.5, 0.5), (0.7, 0.8)] {
            let expected = 2.0 * (3.0 * y - 0.5) + (2.0 * x - 0.5);
            assert!((at(&*texture, [x, y, -7.0]) - expected).abs() < 1e-14);
        }
        assert_eq!(at(&*texture, [-9.0, -9.0, 0.0]), 0.0);
        assert_eq!(at(&*texture, [9.0, 9.0, 0.0]), 5.0);
    }

    #[test]
    fn layers_follow_each_other() {
        let text = "size = [2, 3, 2]\nvalues = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]\nwrap = \"clamp\"";
        let texture = build::<Textures, Solid>(text, ()).unwrap();
        for (x, y, z) in [(0.3, 0.2, 0.3), (0.5, 0.5, 0.6), (0.7, 0.8, 0.75)] {
            let expected = 6.0 * (2.0 * z - 0.5) + 2.0 * (3.0 * y - 0.5) + (2.0 * x - 0.5);
            assert!((at(&*texture, [x, y, z]) - expected).abs() < 1e-14);
        }
        assert_eq!(texture.bytes().unwrap().texels, 12 * 8);
    }

    #[test]
    fn channels_are_written_as_they_are_read() {
        for count in [1, 3] {
            assert_eq!(u8::from(Channels::try_from(count).unwrap()), count);
        }
    }

    #[test]
    fn files_hold_bytes_or_numbers() {
        let folder = tempfile::tempdir().unwrap();
        let mut context = TestContext::in_folder(folder.path());
        std::fs::write(folder.path().join("bytes"), [0, 51, 255]).unwrap();
        let numbers: Vec<u8> = [0.5f32, 7.0, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        std::fs::write(folder.path().join("numbers"), &numbers).unwrap();
        let mut value = |text: &str| {
            let texture = build_in::<Textures, Solid>(text, (), &mut context).unwrap();
            at(&*texture, [0.5, 0.5, 0.5])
        };
        assert_eq!(value("size = [3, 1, 1]\nfile = \"bytes\""), 0.2);
        assert_eq!(
            value("size = [1, 1, 1]\nchannels = 3\nfile = \"numbers\"\nformat = \"f32\""),
            7.0
        );
        // A file of floats is in memory twice while it is read.
        assert_eq!(context.reserved, 3 + 2 * 12);
    }

    #[test]
    fn bad_blocks_are_refused_at_their_places() {
        let folder = tempfile::tempdir().unwrap();
        let mut context = TestContext::in_folder(folder.path());
        std::fs::write(folder.path().join("a"), f32::NAN.to_le_bytes()).unwrap();
        std::fs::write(folder.path().join("negative"), (-1_f32).to_le_bytes()).unwrap();
        for (text, place, why) in [
            (
                "size = [2, 1, 1]\nvalues = [1]",
                "[1]",
                "expected 2 numbers by `size` and `channels`, found 1",
            ),
            ("size = [1, 1, 1]\nvalues = [nan]", "nan", "at least 0"),
            ("size = [0, 1, 1]\nvalues = []", "0", "an integer from 1"),
            (
                "size = [1, 1, 1]\nchannels = 2\nvalues = [1, 1]",
                "2",
                "expected 1 or 3",
            ),
            (
                "size = [1, 1, 1]\nfile = \"a\"",
                "\"a\"",
                "expected 1 bytes, found 4",
            ),
            (
                "size = [1, 1, 1]\nfile = \"a\"\nformat = \"f32\"",
                "\"a\"",
                "number 0 (from 0) is NaN",
            ),
            (
                "size = [1, 1, 1]\nfile = \"negative\"\nformat = \"f32\"",
                "\"negative\"",
                "number 0 (from 0) is -1",
            ),
            ("size = [1, 1, 1]\nvalues = 7", "7", "an array of numbers"),
            ("size = [1, 1, 1]", "[1, 1, 1]", "either `values` or `file`"),
            (
                "size = [1, 1, 1]\nvalues = [1]\nformat = \"u8\"",
                "\"u8\"",
                "only a `file`",
            ),
        ] {
            let (found, message) = fault(text, &mut context);
            assert_eq!(found, place, "{text}: {message}");
            assert!(message.contains(why), "{text}: {message}");
        }
    }
}
