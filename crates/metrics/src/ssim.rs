//! SSIM: the structural similarity of two pictures, as they are displayed on a screen.
//!
//! Wang, Bovik, Sheikh, Simoncelli, *Image Quality Assessment: From Error Visibility to Structural
//! Similarity*, IEEE Transactions on Image Processing 13(4), 2004, section III.B: a Gaussian window
//! of 11 x 11 pixels with a deviation of 1.5, K1 = 0.01 and K2 = 0.03. Only windows that lie in the
//! image count, so there are none at its border.
//!
//! The paper defines SSIM for displayed values. Values are therefore tone mapped like previews
//! (clamped to [0, 1], then encoded as sRGB), but not rounded to codes. The result is the mean over
//! the windows and over R, G, B. Implemented from the paper; the tests contain values of
//! scikit-image 0.26 (`gaussian_weights`, population covariance).

use crate::metrics::{CompareError, Pair};
use crate::sum::Sum;
use whitstone_image::Image;
use whitstone_image::tone::{ToneMap, linear_to_srgb};

/// Side of the window in pixels.
pub const WINDOW: usize = 11;

/// Standard deviation of the window's Gaussian in pixels.
const DEVIATION: f64 = 1.5;
/// (K L)^2 of the paper, where the largest value L is 1.
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// The mean similarity, at most 1, which only equal pictures reach; `None` for an image smaller
/// than the window.
///
/// # Errors
/// [`CompareError`]: sizes, placements or channels that differ, values that are not finite.
pub fn ssim(ours: &Image, reference: &Image, tone: ToneMap) -> Result<Option<f64>, CompareError> {
    let pair = Pair::new(ours, reference)?;
    pair.check_finite()?;
    if pair.width < WINDOW || pair.height < WINDOW {
        return Ok(None);
    }
    let factor = libm::exp2(tone.exposure);
    let shown = |linear: f64| linear_to_srgb((linear * factor).clamp(0.0, 1.0));
    let kernel = kernel();
    let mean = |plane: &dyn Fn(usize) -> f64| {
        let plane: Vec<f64> = (0..pair.pixels()).map(plane).collect();
        windows(&plane, pair.width, &kernel)
    };
    let mut sum = Sum::default();
    let mut count = 0_usize;
    for channel in 0..3 {
        let values: Vec<[f64; 2]> = (0..pair.pixels())
            .map(|index| {
                let (ours, reference) = pair.at(index)[channel];
                [shown(ours), shown(reference)]
            })
            .collect();
        let x = mean(&|i| values[i][0]);
        let y = mean(&|i| values[i][1]);
        let xx = mean(&|i| values[i][0] * values[i][0]);
        let yy = mean(&|i| values[i][1] * values[i][1]);
        let xy = mean(&|i| values[i][0] * values[i][1]);
        for i in 0..x.len() {
            let (x, y) = (x[i], y[i]);
            let (variances, covariance) = (xx[i] - x * x + yy[i] - y * y, xy[i] - x * y);
            let same = (2.0 * x * y + C1) * (2.0 * covariance + C2);
            sum.add(same / ((x * x + y * y + C1) * (variances + C2)));
        }
        count += x.len();
    }
    Ok(Some(sum.total() / count as f64))
}

/// The one-dimensional window, normalised to 1.
fn kernel() -> [f64; WINDOW] {
    let middle = (WINDOW / 2) as f64;
    let weights: [f64; WINDOW] =
        std::array::from_fn(|i| libm::exp(-0.5 * ((i as f64 - middle) / DEVIATION).powi(2)));
    let total: f64 = weights.iter().sum();
    weights.map(|weight| weight / total)
}

/// The weighted means of all windows that lie inside the plane, row by row.
fn windows(plane: &[f64], width: usize, kernel: &[f64; WINDOW]) -> Vec<f64> {
    let weighted = |values: &mut dyn Iterator<Item = f64>| -> f64 {
        values.zip(kernel).map(|(value, weight)| value * weight).sum()
    };
    let columns = width - WINDOW + 1;
    let across: Vec<f64> = plane
        .chunks(width)
        .flat_map(|row| row.windows(WINDOW))
        .map(|window| weighted(&mut window.iter().copied()))
        .collect();
    let rows = across.len() / columns - WINDOW + 1;
    (0..rows * columns)
        .map(|first| weighted(&mut across[first..].iter().copied().step_by(columns)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    fn image(of: impl Fn(usize, usize, usize) -> f32) -> Image {
        Image::from_fn(40, 30, |x, y| [0, 1, 2].map(|c| of(x, y, c))).unwrap()
    }

    fn pattern(k: usize) -> impl Fn(usize, usize, usize) -> f32 {
        move |x, y, c| {
            let blocks = (x / 8 + y / 6) % 2 * 12;
            (blocks + (x * 7 + y * 13 + c * 5 + k * (x / 5) + k * c * 3) % 20) as f32 / 32.0
        }
    }

    #[test]
    fn values_equal_those_of_scikit_image() {
        // structural_similarity(srgb(a), srgb(b), data_range=1, gaussian_weights=True, sigma=1.5,
        // use_sample_covariance=False, channel_axis=-1), version 0.26.0, of the same values in
        // double precision.
        let reference = image(pattern(0));
        let of = |other: &Image, exposure: f64| {
            let tone = ToneMap {
                exposure,
                ..ToneMap::default()
            };
            let found = ssim(other, &reference, tone);
            found.unwrap().unwrap()
        };
        let shifted = |x: usize, y: usize, c: usize| pattern(0)((x + 39) % 40, y, c);
        let dimmed = |x: usize, y: usize, c: usize| pattern(0)(x, y, c) * 0.9 + 0.02;
        for (found, expected) in [
            (of(&image(pattern(1)), 0.0), STORED[0]),
            (of(&image(shifted), 0.0), STORED[1]),
            (of(&image(dimmed), 0.0), STORED[2]),
            (of(&image(dimmed), 2.0), STORED[3]),
        ] {
            assert_abs_diff_eq!(found, expected, epsilon = 1e-9);
        }
    }

    const STORED: [f64; 4] = [
        0.3094880059639654,
        0.05525149742387725,
        0.9898707155471937,
        0.9728983925728888,
    ];

    #[test]
    fn equal_pictures_have_ssim_1_and_small_ones_have_none() {
        let same = image(pattern(0));
        assert_eq!(ssim(&same, &same, ToneMap::default()).unwrap(), Some(1.0));
        let least = |w, h| Image::from_fn(w, h, |x, _| [x as f32 / 16.0; 3]).unwrap();
        assert_eq!(
            ssim(&least(11, 11), &least(11, 11), ToneMap::default()).unwrap(),
            Some(1.0)
        );
        assert_eq!(
            ssim(&least(10, 40), &least(10, 40), ToneMap::default()).unwrap(),
            None
        );
        assert!(ssim(&image(|_, _, _| f32::NAN), &same, ToneMap::default()).is_err());
    }
}
