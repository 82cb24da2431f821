//! The values of a reference in the pixels that vary, as stored with the reference.
//!
//! They are in an EXR file of their own, which any tool can read. Each row is a pixel of the
//! reference: its channels `X` and `Y` identify it, and R, G, B hold its distinct values, the
//! nominal one first. All rows have the length of the longest; shorter ones are padded with the
//! nominal value. The values are rounded to 12 bits, a quarter of the tolerance.

use crate::explain::agree;
use std::collections::BTreeMap;
use whitstone_image::Image;

/// Maximum number of values that are stored for a pixel. A pixel with more varies continuously, so
/// that its range describes it as well.
const MAX_VALUES: usize = 64;
/// Values that differ by less than this fraction of the tolerance count as equal.
const SAME: f64 = 0.5;
/// Bits of the mantissa of a stored value. The rounding error is 2^-12 of the value, a quarter of
/// the tolerance; the files are half as large.
const BITS: u32 = 12;

/// Column and row of a pixel, and the values there.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Variants(BTreeMap<[usize; 2], Vec<[f64; 3]>>);

impl Variants {
    /// The values of a pixel, the nominal one first; `None` if the reference does not vary there.
    pub fn of(&self, pixel: [usize; 2]) -> Option<&[[f64; 3]]> {
        self.0.get(&pixel).map(Vec::as_slice)
    }

    /// The number of pixels that vary.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether no pixel varies.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Adds a value that the reference takes in a pixel, unless it is not finite or almost equal to
    /// an existing one.
    pub fn add(&mut self, pixel: [usize; 2], nominal: [f64; 3], value: [f64; 3], tolerance: [f64; 3]) {
        if !value.iter().all(|v| v.is_finite()) {
            return;
        }
        let same = tolerance.map(|t| SAME * t);
        let alone = [nominal];
        let values = self.0.get(&pixel).map_or(&alone[..], Vec::as_slice);
        if values.len() < MAX_VALUES && !values.iter().any(|known| agree(*known, value, same)) {
            self.0.entry(pixel).or_insert_with(|| vec![nominal]).push(value);
        }
    }

    /// Removes the lists of pixels that vary by less than the tolerance; their range describes them
    /// as well. `tolerance` is that of a nominal value.
    pub fn keep_beyond(&mut self, tolerance: impl Fn([f64; 3]) -> [f64; 3]) {
        self.0.retain(|_, values| {
            let (nominal, others) = (values[0], &values[1..]);
            let allowed = tolerance(nominal);
            others.iter().any(|value| !agree(nominal, *value, allowed))
        });
    }

    /// Converts to an image; `None` if no pixel varies, because an image has at least one row.
    pub fn to_image(&self) -> Option<Image> {
        let width = self.0.values().map(Vec::len).max()?;
        let rows: Vec<(&[usize; 2], &Vec<[f64; 3]>)> = self.0.iter().collect();
        let colors = |x: usize, y: usize| {
            let values = rows[y].1;
            values.get(x).unwrap_or(&values[0]).map(|v| rounded(v as f32))
        };
        let mut image = Image::from_fn(width, rows.len(), colors).ok()?;
        for (axis, name) in ["X", "Y"].into_iter().enumerate() {
            let numbers = rows
                .iter()
                .flat_map(|(pixel, _)| vec![pixel[axis] as f32; width])
                .collect();
            image.add_channel(name, numbers).ok()?;
        }
        Some(image)
    }

    /// Converts from an image that [`Self::to_image`] made; `None` if it has other channels.
    pub fn from_image(image: &Image) -> Option<Self> {
        let [red, green, blue] = image.rgb().ok()?;
        let (columns, rows) = (image.channel("X")?, image.channel("Y")?);
        let width = image.width();
        let mut all = BTreeMap::new();
        for y in 0..image.height() {
            let start = y * width;
            let color = |x: usize| [red, green, blue].map(|plane| f64::from(plane[start + x]));
            let nominal = color(0);
            let others = (1..width).map(color).filter(|value| *value != nominal);
            let values = std::iter::once(nominal).chain(others).collect();
            all.insert([columns[start] as usize, rows[start] as usize], values);
        }
        Some(Self(all))
    }
}

/// Rounds a finite number to [`BITS`] bits, to nearest; ties away from zero.
fn rounded(value: f32) -> f32 {
    let dropped = f32::MANTISSA_DIGITS - BITS;
    let bits = value.to_bits() + (1 << (dropped - 1));
    let nearest = f32::from_bits(bits & !((1 << dropped) - 1));
    if nearest.is_finite() { nearest } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_is_to_nearest() {
        for value in [1.0_f32, -0.3, 1e-20, 123.456, 0.0, 1.0 + 1.0 / 2048.0] {
            assert!((rounded(value) - value).abs() <= value.abs() / 4096.0, "{value}");
        }
        assert_eq!(rounded(0.5), 0.5);
    }

    #[test]
    fn values_survive_the_image_and_near_ones_count_as_one() {
        let mut variants = Variants::default();
        assert!(variants.to_image().is_none());
        let mut add = |pixel, value: f64| variants.add(pixel, [1.0; 3], [value; 3], [1e-3; 3]);
        add([3, 2], 1.0001);
        add([3, 2], 0.5);
        add([3, 2], 0.5001);
        add([3, 2], f64::NAN);
        add([7, 1], 0.25);
        add([7, 1], 0.75);
        assert_eq!((variants.len(), variants.is_empty()), (2, false));
        assert_eq!(variants.of([3, 2]), Some(&[[1.0; 3], [0.5; 3]][..]));
        assert_eq!(variants.of([0, 0]), None);
        let image = variants.to_image().unwrap();
        assert_eq!((image.width(), image.height()), (3, 2));
        assert_eq!(Variants::from_image(&image), Some(variants.clone()));
        // The value of the first pixel varies by less than this.
        let mut wide = variants.clone();
        wide.keep_beyond(|_| [0.6; 3]);
        assert_eq!((wide.len(), wide.of([3, 2])), (1, None));
        let other = Image::from_fn(2, 2, |_, _| [1.0; 3]).unwrap();
        assert_eq!(Variants::from_image(&other), None);
    }
}
