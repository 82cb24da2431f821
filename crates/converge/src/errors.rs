//! Error metrics of an image compared with the truth.

use serde::{Deserialize, Serialize};
use whitstone_image::{Image, ImageError};
use whitstone_metrics::Mask;

/// Regularisation of the relative error, as in `compare`.
const RELATIVE_FLOOR: f64 = 0.01;

/// Errors over a set of pixels. Pixels that are not finite are excluded, and counted separately.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Root mean square error, in units of radiance.
    pub rmse: f64,
    /// Mean of the squared difference over (truth² + 0.01).
    pub relmse: f64,
    /// Largest absolute difference.
    pub max: f64,
}

/// Errors of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Over all pixels.
    pub whole: Errors,
    /// Over interior pixels: those where the centres of all neighbours show the same surface.
    pub interior: Errors,
    /// Fraction of the pixels that are interior.
    pub interior_fraction: f64,
    /// Fraction of the pixels that are finite in both images.
    pub finite: f64,
}

impl Measured {
    /// Compares an image with the truth. `edges` are the pixels that are not interior.
    ///
    /// # Errors
    ///
    /// If the images differ in size or have no colours.
    pub fn between(image: &Image, truth: &Image, edges: &Mask) -> Result<Self, String> {
        let size = |image: &Image| (image.width(), image.height());
        if size(image) != size(truth) || size(truth) != (edges.width(), edges.height()) {
            return Err("the images differ in size".to_owned());
        }
        let told = |error: ImageError| error.to_string();
        let (ours, theirs) = (image.rgb().map_err(told)?, truth.rgb().map_err(told)?);
        let (mut whole, mut interior) = (Sums::default(), Sums::default());
        let mut finite = 0;
        for (index, edge) in edges.as_slice().iter().enumerate() {
            let pairs = [0, 1, 2].map(|c| [f64::from(ours[c][index]), f64::from(theirs[c][index])]);
            if !pairs.iter().flatten().all(|value| value.is_finite()) {
                continue;
            }
            finite += 1;
            whole.add(pairs);
            if !edge {
                interior.add(pairs);
            }
        }
        let pixels = edges.as_slice().len().max(1) as f64;
        Ok(Self {
            whole: whole.errors(),
            interior: interior.errors(),
            interior_fraction: interior.count / pixels,
            finite: f64::from(finite) / pixels,
        })
    }
}

#[derive(Default)]
struct Sums {
    squared: f64,
    relative: f64,
    max: f64,
    count: f64,
}

impl Sums {
    fn add(&mut self, pairs: [[f64; 2]; 3]) {
        for [ours, truth] in pairs {
            let difference = ours - truth;
            self.squared += difference * difference;
            self.relative += difference * difference / (truth * truth + RELATIVE_FLOOR);
            self.max = self.max.max(difference.abs());
        }
        self.count += 1.0;
    }

    fn errors(&self) -> Errors {
        let numbers = (3.0 * self.count).max(1.0);
        Errors {
            rmse: (self.squared / numbers).sqrt(),
            relmse: self.relative / numbers,
            max: self.max,
        }
    }
}

/// Rounding error of a single-precision image file: the root mean square of the finite values,
/// times half a unit in the last place.
pub fn rounding(image: &Image) -> f64 {
    let values = image
        .rgb()
        .into_iter()
        .flatten()
        .flatten()
        .map(|value| f64::from(*value));
    let values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    let mean = values.iter().map(|value| value * value).sum::<f64>() / values.len().max(1) as f64;
    mean.sqrt() * f64::from(f32::EPSILON) / 2.0
}

/// Pixels with a neighbour, in any of eight directions, whose centre shows another shape; `ids` are
/// row by row from the top.
pub fn edges(width: usize, height: usize, ids: &[f32]) -> Mask {
    Mask::from_fn(width, height, |x, y| {
        let own = ids.get(y * width + x);
        let near = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
        near(y, height).any(|j| near(x, width).any(|i| ids.get(j * width + i) != own))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_metrics::{CompareOptions, compare};

    #[test]
    fn the_numbers_are_those_of_compare() {
        let value = |x: usize, y: usize, k: f32| [0.1 * x as f32 + k, 0.3 * y as f32, 2.0 - k];
        let truth = Image::from_fn(7, 5, |x, y| value(x, y, 0.0)).unwrap();
        let ours = Image::from_fn(7, 5, |x, y| value(x, y, 0.01 * (x * y) as f32)).unwrap();
        let none = Mask::new(7, 5);
        let found = Measured::between(&ours, &truth, &none).unwrap();
        let known = compare(&ours, &truth, &CompareOptions::default()).unwrap();
        assert!((found.whole.rmse - known.rmse).abs() < 1e-12 * known.rmse);
        assert!((found.whole.relmse - known.relmse).abs() < 1e-12 * known.relmse);
        assert_eq!(found.whole.max, known.max_abs);
        assert_eq!((found.whole, found.finite), (found.interior, 1.0));
    }

    #[test]
    fn what_is_no_number_is_counted_and_left_out() {
        let truth = Image::from_fn(2, 1, |_, _| [1.0; 3]).unwrap();
        let ours = Image::from_fn(2, 1, |x, _| [if x == 0 { f32::NAN } else { 1.5 }; 3]).unwrap();
        let found = Measured::between(&ours, &truth, &Mask::new(2, 1)).unwrap();
        assert_eq!((found.finite, found.whole.rmse), (0.5, 0.5));
        assert!(Measured::between(&ours, &truth, &Mask::new(3, 1)).is_err());
    }

    #[test]
    fn edges_are_where_shapes_meet() {
        let ids = [0.0, 0.0, 0.0, 1.0];
        let found = edges(4, 1, &ids);
        assert_eq!(found.as_slice(), [false, false, true, true]);
    }
}
