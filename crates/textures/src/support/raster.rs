//! Grids of texels and their lookup.
//!
//! Texels are stored as in the file, as codes or floating-point numbers, and decoded by a table at
//! lookup. The linear value is therefore exact in double precision, and a texel of an 8-bit file
//! needs 3 bytes.

use crate::support::mapping::TextureFunction;
use crate::support::pyramid::{Ellipse, Grid, Pyramid, elliptical};
use crate::support::wrap::Wrap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::{Arc, OnceLock};
use toml::Spanned;
use whitstone_core::config::IntegerIn;
use whitstone_core::{Context, DVec2, DVec3, Rgb, SceneError, SceneErrors, TextureBytes, Vec4};
use whitstone_image::texels::{Encoding, Texels};
use whitstone_image::tone::srgb_to_linear;

/// Texture filter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Filter {
    /// Interpolates between the four nearest texels.
    #[default]
    Bilinear,
    /// The nearest texel.
    Nearest,
    /// Interpolates between the two mip map levels whose texel spacing brackets the sample spacing.
    Trilinear,
    /// Elliptical weighted average over the footprint of a sample.
    Ewa,
}

/// Maximum ratio of the axes of a sample's ellipse.
pub(crate) type MaxAnisotropy = Option<Spanned<IntegerIn<1, 64>>>;

pub(crate) const DEFAULT_MAX_ANISOTROPY: u32 = 16;

/// Encoding of the values in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum ColorSpace {
    /// Depends on the file format.
    #[default]
    Auto,
    /// Encoded as in IEC 61966-2-1.
    Srgb,
    /// Linear in radiance.
    Linear,
}

/// A grid of texels.
pub(crate) struct Raster {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) data: Arc<Data>,
    pub(crate) lookup: Lookup,
    /// Additional data of the filter.
    coarse: Coarse,
}

/// Lookup parameters of a grid.
pub(crate) struct Lookup {
    pub(crate) filter: Filter,
    /// Rules along u and along v.
    pub(crate) wrap: [Wrap; 2],
    pub(crate) scale: DVec2,
    pub(crate) offset: DVec2,
}

/// Texels and their mip map, which several textures may share.
pub(crate) struct Data {
    pub(crate) store: Store,
    /// Built for the first texture that needs it.
    pyramid: OnceLock<Arc<Pyramid>>,
}

impl Data {
    pub(crate) fn new(store: Store) -> Arc<Self> {
        Arc::new(Self {
            store,
            pyramid: OnceLock::new(),
        })
    }

    /// The mip map, given the size of the image.
    fn pyramid(
        &self,
        [width, height]: [usize; 2],
        context: &mut dyn Context,
    ) -> Result<Arc<Pyramid>, SceneErrors> {
        if self.pyramid.get().is_none() {
            context.reserve(Pyramid::bytes(width, height))?;
        }
        let texel = |at| self.store.texel(at).to_array().map(single);
        let new = || Arc::new(Pyramid::new(width, height, texel));
        Ok(self.pyramid.get_or_init(new).clone())
    }
}

/// Additional data of the filters that use footprints.
enum Coarse {
    /// No additional data.
    None,
    Trilinear(Arc<Pyramid>),
    Ewa(Ewa),
}

struct Ewa {
    pyramid: Arc<Pyramid>,
    max_anisotropy: f64,
    /// Linear values of 8-bit codes.
    linear: Option<Box<[f32; 256]>>,
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
    /// Creates a store from the texels of a file.
    pub(crate) fn new(texels: Texels, color_space: ColorSpace) -> Self {
        let encoded = match color_space {
            ColorSpace::Auto => texels.encoding != Encoding::Linear,
            ColorSpace::Srgb => true,
            ColorSpace::Linear => false,
        };
        // Rounding recovers the code, whose value is the nearest f32.
        match texels.encoding {
            Encoding::Srgb8 => {
                let code = |value: f32| (f64::from(value) * 255.0 + 0.5) as u8;
                Self::eight(texels.data.iter().map(|texel| texel.map(code)).collect(), encoded)
            }
            Encoding::Srgb16 => {
                let code = |value: f32| (f64::from(value) * 65535.0 + 0.5) as u16;
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

    /// Creates a store of 8-bit codes, sRGB-encoded or linear.
    pub(crate) fn eight(codes: Vec<[u8; 3]>, encoded: bool) -> Self {
        Self::Eight(codes, table(255, encoded))
    }

    pub(crate) fn bytes(&self) -> u64 {
        let bytes = match self {
            Self::Eight(codes, linear) => size_of_val(&**codes) + size_of_val(&**linear),
            Self::Sixteen(codes, linear) => size_of_val(&**codes) + size_of_val(&**linear),
            Self::Linear(values) => size_of_val(&**values),
            Self::Decoded(values) => size_of_val(&**values),
        };
        bytes as u64
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

/// Linear values of all codes.
fn table(last: u32, encoded: bool) -> Vec<f64> {
    let linear = |value: f64| if encoded { srgb_to_linear(value) } else { value };
    (0..=last)
        .map(|code| linear(f64::from(code) / f64::from(last)))
        .collect()
}

impl Raster {
    /// Creates a grid with the data that its filter needs.
    ///
    /// # Errors
    ///
    /// If there is not enough memory, or if a key has no effect.
    pub(crate) fn new(
        [width, height]: [usize; 2],
        data: Arc<Data>,
        lookup: Lookup,
        max_anisotropy: MaxAnisotropy,
        context: &mut dyn Context,
    ) -> Result<Self, SceneErrors> {
        if let Some(value) = &max_anisotropy
            && lookup.filter != Filter::Ewa
        {
            return Err(SceneError::at(value.span(), "only the filter \"ewa\" has this key").into());
        }
        let mut pyramid = || data.pyramid([width, height], context);
        let coarse = match lookup.filter {
            Filter::Bilinear | Filter::Nearest => Coarse::None,
            Filter::Trilinear => Coarse::Trilinear(pyramid()?),
            Filter::Ewa => Coarse::Ewa(Ewa {
                pyramid: pyramid()?,
                max_anisotropy: f64::from(
                    max_anisotropy.map_or(DEFAULT_MAX_ANISOTROPY, |n| n.get_ref().get()),
                ),
                linear: match &data.store {
                    Store::Eight(_, linear) => {
                        Some(Box::new(std::array::from_fn(|code| single(linear[code]))))
                    }
                    _ => None,
                },
            }),
        };
        Ok(Self {
            width,
            height,
            data,
            lookup,
            coarse,
        })
    }

    /// Maps texture space to the image: (0, 0) is its top left corner, (1, 1) the bottom right one.
    #[inline(always)]
    fn place(&self, q: DVec3) -> DVec2 {
        let uv = q.truncate() * self.lookup.scale + self.lookup.offset;
        DVec2::new(uv.x, 1.0 - uv.y)
    }

    /// Bilinear interpolation in the image.
    fn bilinear(&self, place: DVec2) -> Rgb {
        let texel = |at| self.data.store.texel(at);
        bilinear([self.width, self.height], self.lookup.wrap, place, texel)
    }

    /// Bilinear interpolation in a level of the mip map.
    fn bilinear_at(&self, pyramid: &Pyramid, level: usize, place: DVec2) -> Rgb {
        let Some(level) = level.checked_sub(1).map(|above| &pyramid.0[above]) else {
            return self.bilinear(place);
        };
        let texel = |at: usize| linear(level.texel(at));
        bilinear([level.width, level.height], self.lookup.wrap, place, texel)
    }

    /// Interpolates between the two levels next to a fractional level.
    fn between(&self, pyramid: &Pyramid, level: f64, of: impl Fn(usize) -> Rgb) -> Rgb {
        let last = pyramid.0.len();
        if level.is_nan() || level >= last as f64 {
            return match pyramid.0.last() {
                Some(level) => linear(level.texel(0)),
                // The image is a single texel.
                None => self.data.store.texel(0),
            };
        }
        let below = level.floor();
        let part = level - below;
        let fine = of(below as usize);
        if part == 0.0 {
            return fine;
        }
        fine * (1.0 - part) + of(below as usize + 1) * part
    }

    fn trilinear(&self, pyramid: &Pyramid, place: DVec2, steps: [DVec2; 2]) -> Rgb {
        let size = DVec2::new(self.width as f64, self.height as f64);
        let (s, t) = ((steps[0] * size).length(), (steps[1] * size).length());
        let longest = s.max(t);
        if longest <= 1.0 {
            return self.bilinear(place);
        }
        // Non-finite steps select the coarsest level.
        self.between(pyramid, libm::log2(longest), |level| {
            self.bilinear_at(pyramid, level, place)
        })
    }

    fn ewa(&self, ewa: &Ewa, place: DVec2, steps: [DVec2; 2]) -> Rgb {
        let Ewa {
            pyramid,
            max_anisotropy,
            linear,
        } = ewa;
        let size = DVec2::new(self.width as f64, self.height as f64);
        let ellipse = Ellipse::new(steps, size, *max_anisotropy);
        // The ellipse is smaller than a texel, so no filtering is needed.
        if ellipse.long <= 1.0 {
            return self.bilinear(place);
        }
        // Non-finite steps select the coarsest level.
        let level = if ellipse.long.is_finite() {
            libm::log2(ellipse.short).max(0.0)
        } else {
            f64::INFINITY
        };
        let wrap = self.lookup.wrap;
        let found = self.between(pyramid, level, |level| match level.checked_sub(1) {
            None => {
                let grid = Grid {
                    width: self.width,
                    height: self.height,
                    wrap,
                };
                match (&self.data.store, linear) {
                    (Store::Eight(codes, _), Some(linear)) => {
                        let (codes, linear) = (&codes[..], &**linear);
                        let value = move |code: u8| linear[usize::from(code)];
                        let texel = move |at: usize| {
                            let [r, g, b] = codes[at];
                            Vec4::new(value(r), value(g), value(b), 0.0)
                        };
                        elliptical(grid, texel, place, &ellipse)
                    }
                    (store, _) => {
                        let texel = |at| {
                            let [r, g, b] = store.texel(at).to_array().map(single);
                            Vec4::new(r, g, b, 0.0)
                        };
                        elliptical(grid, texel, place, &ellipse)
                    }
                }
            }
            Some(above) => {
                let level = &pyramid.0[above];
                let grid = Grid {
                    width: level.width,
                    height: level.height,
                    wrap,
                };
                elliptical(grid, level.four(), place, &ellipse)
            }
        });
        // Blends with the bilinear value to avoid a discontinuity.
        let part = ellipse.long - 1.0;
        if part < 1.0 {
            self.bilinear(place) * (1.0 - part) + found * part
        } else {
            found
        }
    }
}

/// The nearest finite f32.
#[inline(always)]
fn single(value: f64) -> f32 {
    (value as f32).min(f32::MAX)
}

#[inline(always)]
fn linear([r, g, b]: [f32; 3]) -> Rgb {
    Rgb::new(f64::from(r), f64::from(g), f64::from(b))
}

/// Interpolates between the four nearest texel centres.
#[inline(always)]
fn bilinear(
    [width, height]: [usize; 2],
    [along_u, along_v]: [Wrap; 2],
    place: DVec2,
    texel: impl Fn(usize) -> Rgb,
) -> Rgb {
    let (x, y) = (place.x * width as f64 - 0.5, place.y * height as f64 - 0.5);
    let (column, row) = (x.floor(), y.floor());
    let part = |t: f64| if t.is_finite() { t } else { 0.0 };
    let (right, down) = (part(x - column), part(y - row));
    let texel = |column, row| texel(along_v.index(row, height) * width + along_u.index(column, width));
    let mean = |row: f64| texel(column, row) * (1.0 - right) + texel(column + 1.0, row) * right;
    mean(row) * (1.0 - down) + mean(row + 1.0) * down
}

impl TextureFunction for Raster {
    fn at(&self, q: DVec3) -> Rgb {
        let place = self.place(q);
        if self.lookup.filter != Filter::Nearest {
            return self.bilinear(place);
        }
        let (column, row) = (
            (place.x * self.width as f64).floor(),
            (place.y * self.height as f64).floor(),
        );
        let [along_u, along_v] = self.lookup.wrap;
        let (i, j) = (along_u.index(column, self.width), along_v.index(row, self.height));
        self.data.store.texel(j * self.width + i)
    }

    fn filters(&self) -> bool {
        !matches!(self.coarse, Coarse::None)
    }

    fn filtered(&self, q: DVec3, steps: [DVec3; 2]) -> Rgb {
        let place = self.place(q);
        // Rows go down while v goes up.
        let scale = self.lookup.scale * DVec2::new(1.0, -1.0);
        let steps = [steps[0].truncate() * scale, steps[1].truncate() * scale];
        match &self.coarse {
            Coarse::None => self.at(q),
            Coarse::Trilinear(pyramid) => self.trilinear(pyramid, place, steps),
            Coarse::Ewa(ewa) => self.ewa(ewa, place, steps),
        }
    }

    fn bytes(&self) -> TextureBytes {
        let levels = match self.coarse {
            Coarse::None => 0,
            Coarse::Trilinear(_) | Coarse::Ewa(_) => Pyramid::bytes(self.width, self.height),
        };
        TextureBytes {
            texels: self.data.store.bytes(),
            levels,
            shared: Some(Arc::as_ptr(&self.data) as usize),
        }
    }

    fn size(&self) -> Option<[usize; 2]> {
        Some([self.width, self.height])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_image::tone::srgb_to_linear;

    #[test]
    fn stores_keep_every_code_and_know_their_memory() {
        let texels = |encoding, data: [[f32; 3]; 2]| Texels {
            width: 2,
            height: 1,
            data: data.to_vec(),
            encoding,
        };
        for (encoding, most, color, bytes) in [
            (Encoding::Srgb8, 255_u16, ColorSpace::Srgb, 2 * 3 + 256 * 8),
            (Encoding::Srgb8, 255, ColorSpace::Linear, 2 * 3 + 256 * 8),
            (Encoding::Srgb16, 65535, ColorSpace::Auto, 2 * 6 + 65536 * 8),
            (Encoding::Srgb16, 65535, ColorSpace::Linear, 2 * 6 + 65536 * 8),
        ] {
            for code in [0, 1, 77, most / 2, most - 1, most] {
                let other = most - code;
                let file = [[code, other, 0], [0, most, code]];
                let data = file.map(|texel| texel.map(|code| f32::from(code) / f32::from(most)));
                let store = Store::new(texels(encoding, data), color);
                assert_eq!(store.bytes(), bytes);
                for (at, texel) in file.into_iter().enumerate() {
                    let expected = texel.map(|code| {
                        let value = f64::from(code) / f64::from(most);
                        if matches!(color, ColorSpace::Linear) {
                            value
                        } else {
                            srgb_to_linear(value)
                        }
                    });
                    assert_eq!(store.texel(at).to_array(), expected, "{encoding:?} {code}");
                }
            }
        }
        let data = [[0.25, -3.0, 1e30], [0.5, 0.0, 1e-30]];
        let store = Store::new(texels(Encoding::Linear, data), ColorSpace::Auto);
        assert_eq!(
            (store.bytes(), store.texel(0).to_array()),
            (24, data[0].map(f64::from))
        );
        let store = Store::new(texels(Encoding::Linear, data), ColorSpace::Srgb);
        assert_eq!(store.bytes(), 48);
        assert_eq!(store.texel(0).r, srgb_to_linear(0.25));
    }
}
