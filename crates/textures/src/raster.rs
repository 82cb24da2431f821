//! Grids of texels, looked up.
//!
//! Texels are kept as they are in the file, as codes or as floating-point numbers, and decoded when looked
//! up, by a table: so the linear value is exact in double precision, and a texel of an 8-bit file takes 3
//! bytes.

use crate::mapping::Pattern;
use crate::wrap::Wrap;
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::{DVec2, DVec3, Rgb};
use whitstone_image::texels::{Encoding, Texels};
use whitstone_image::tone::srgb_to_linear;

/// What lies between texel centres.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Filter {
    /// A mean of the four texels around.
    #[default]
    Bilinear,
    /// The texel whose square it is.
    Nearest,
}

/// What the values in a file are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum ColorSpace {
    /// By the kind of file.
    #[default]
    Auto,
    /// Encoded as in IEC 61966-2-1.
    Srgb,
    /// Proportional to light.
    Linear,
}

/// A grid of texels.
pub(crate) struct Raster {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) store: Store,
    pub(crate) filter: Filter,
    pub(crate) wrap: Wrap,
    pub(crate) scale: DVec2,
    pub(crate) offset: DVec2,
}

/// Texels row by row, the top row first.
pub(crate) enum Store {
    /// 8-bit codes and their 256 linear values.
    Eight(Vec<[u8; 3]>, Vec<f64>),
    /// 16-bit codes and their 65536 linear values.
    Sixteen(Vec<[u16; 3]>, Vec<f64>),
    /// Linear values.
    Linear(Vec<[f32; 3]>),
    /// Linear values of floating-point numbers that were encoded.
    Decoded(Vec<[f64; 3]>),
}

impl Store {
    /// The texels of a file.
    pub(crate) fn new(texels: Texels, color_space: ColorSpace) -> Self {
        let encoded = match color_space {
            ColorSpace::Auto => texels.encoding != Encoding::Linear,
            ColorSpace::Srgb => true,
            ColorSpace::Linear => false,
        };
        // Rounding gives back the code, of which the value is the nearest f32.
        match texels.encoding {
            Encoding::Srgb8 => {
                let code = |value: f32| (f64::from(value) * 255.0).round() as u8;
                Self::eight(texels.data.iter().map(|texel| texel.map(code)).collect(), encoded)
            }
            Encoding::Srgb16 => {
                let code = |value: f32| (f64::from(value) * 65535.0).round() as u16;
                Self::Sixteen(
                    texels.data.iter().map(|texel| texel.map(code)).collect(),
                    table(65535, encoded),
                )
            }
            Encoding::Linear if encoded => {
                let decode = |value: f32| srgb_to_linear(f64::from(value));
                Self::Decoded(texels.data.iter().map(|texel| texel.map(decode)).collect())
            }
            Encoding::Linear => Self::Linear(texels.data),
        }
    }

    /// 8-bit codes, of sRGB or linear.
    pub(crate) fn eight(codes: Vec<[u8; 3]>, encoded: bool) -> Self {
        Self::Eight(codes, table(255, encoded))
    }

    fn texel(&self, index: usize) -> Rgb {
        match self {
            Self::Eight(codes, linear) => codes[index].map(|code| linear[usize::from(code)]).into(),
            Self::Sixteen(codes, linear) => codes[index].map(|code| linear[usize::from(code)]).into(),
            Self::Linear(values) => values[index].map(f64::from).into(),
            Self::Decoded(values) => values[index].into(),
        }
    }
}

/// The linear values of all codes.
fn table(last: u32, encoded: bool) -> Vec<f64> {
    let linear = |value: f64| if encoded { srgb_to_linear(value) } else { value };
    (0..=last)
        .map(|code| linear(f64::from(code) / f64::from(last)))
        .collect()
}

impl Raster {
    fn texel(&self, column: f64, row: f64) -> Rgb {
        let (i, j) = (
            self.wrap.index(column, self.width),
            self.wrap.index(row, self.height),
        );
        self.store.texel(j * self.width + i)
    }
}

impl Pattern for Raster {
    fn at(&self, q: DVec3) -> Rgb {
        let uv = q.truncate() * self.scale + self.offset;
        let (x, y) = (uv.x * self.width as f64, (1.0 - uv.y) * self.height as f64);
        if self.filter == Filter::Nearest {
            return self.texel(x.floor(), y.floor());
        }
        let (x, y) = (x - 0.5, y - 0.5);
        let (column, row) = (x.floor(), y.floor());
        let part = |t: f64| if t.is_finite() { t } else { 0.0 };
        let (right, down) = (part(x - column), part(y - row));
        let mean = |row: f64| self.texel(column, row) * (1.0 - right) + self.texel(column + 1.0, row) * right;
        mean(row) * (1.0 - down) + mean(row + 1.0) * down
    }
}
