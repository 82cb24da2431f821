//! Spectra as linear RGB.
//!
//! The colour matching functions are the fits of Wyman, Sloan and Shirley 2013.

use crate::mitsuba::material::METALS;
use whitstone_core::{DMat3, DVec3};

/// Named glasses of pbrt, with their indices of refraction at 587.6 nm.
const GLASSES: [(&str, f64); 10] = [
    ("glass-BK7", 1.5168),
    ("glass-BAF10", 1.67003),
    ("glass-FK51A", 1.48656),
    ("glass-LASF9", 1.85025),
    ("glass-F5", 1.6727),
    ("glass-SF5", 1.6727),
    ("glass-F10", 1.72825),
    ("glass-SF10", 1.72825),
    ("glass-F11", 1.78472),
    ("glass-SF11", 1.78472),
];

/// Shortest and longest wavelengths that are seen, and the step of integrals, in nm.
const RANGE: (usize, usize, usize) = (360, 830, 5);
/// The wavelength that stands for all where an index of refraction is one number, in nm.
pub(crate) const YELLOW: f64 = 587.6;

/// The index of refraction of a named glass.
pub(crate) fn glass(name: &str) -> Option<f64> {
    GLASSES
        .iter()
        .find(|(known, _)| *known == name)
        .map(|(_, ior)| *ior)
}

/// The names of all glasses.
pub(crate) fn glasses() -> impl Iterator<Item = &'static str> {
    GLASSES.iter().map(|(name, _)| *name)
}

/// The metal of "metal-Au-eta", and whether the spectrum is that of k.
pub(crate) fn metal(name: &str) -> Option<(&'static str, bool)> {
    let rest = name.strip_prefix("metal-")?;
    let (metal, is_k) = match rest.strip_suffix("-eta") {
        Some(metal) => (metal, false),
        None => (rest.strip_suffix("-k")?, true),
    };
    // pbrt has no spectra of the other metals.
    ["Ag", "Al", "Au", "Cu"]
        .into_iter()
        .find(|known| *known == metal)
        .map(|known| (known, is_k))
}

/// eta or k of a metal as a colour.
pub(crate) fn metal_color(metal: &str, is_k: bool) -> [f64; 3] {
    let found = METALS.iter().find(|(known, _, _)| *known == metal);
    let (_, eta, k) = found.unwrap_or(&METALS[0]);
    if is_k { *k } else { *eta }
}

/// The standard illuminant D65 from 360 to 830 nm in steps of 10 nm (ISO 11664-2).
const D65: [f64; 48] = [
    46.6383, 52.0891, 49.9755, 54.6482, 82.7549, 91.486, 93.4318, 86.6823, 104.865, 117.008, 117.812,
    114.861, 115.923, 108.811, 109.354, 107.802, 104.79, 107.689, 104.405, 104.046, 100.0, 96.3342, 95.788,
    88.6856, 90.0062, 89.5991, 87.6987, 83.2886, 83.6992, 80.0268, 80.2146, 82.2778, 78.2842, 69.7213,
    71.6091, 74.349, 61.604, 69.8856, 75.087, 63.5927, 46.4182, 66.8054, 63.3828, 64.304, 59.4519, 51.959,
    57.4406, 60.3125,
];

/// D65 at a wavelength within [`RANGE`]: linear between its samples.
fn daylight(nm: f64) -> f64 {
    let place = (nm - RANGE.0 as f64) / 10.0;
    let below = (place as usize).min(D65.len() - 2);
    D65[below] + (D65[below + 1] - D65[below]) * (place - below as f64)
}

/// x, y and z of the CIE 1931 observer.
fn observer(nm: f64) -> DVec3 {
    let lobe = |middle: f64, below: f64, above: f64| {
        let t = (nm - middle) / if nm < middle { below } else { above };
        libm::exp(-0.5 * t * t)
    };
    DVec3::new(
        1.056 * lobe(599.8, 37.9, 31.0) + 0.362 * lobe(442.0, 16.0, 26.7) - 0.065 * lobe(501.1, 20.4, 26.2),
        0.821 * lobe(568.8, 46.9, 40.5) + 0.286 * lobe(530.9, 16.3, 31.1),
        1.217 * lobe(437.0, 11.8, 36.0) + 0.681 * lobe(459.0, 26.0, 13.8),
    )
}

/// Linear RGB (Rec. 709) of CIE XYZ.
fn rgb(xyz: DVec3) -> DVec3 {
    let matrix = DMat3::from_cols(
        DVec3::new(3.240_969_94, -0.969_243_64, 0.055_630_08),
        DVec3::new(-1.537_383_18, 1.875_967_5, -0.203_976_96),
        DVec3::new(-0.498_610_76, 0.041_555_06, 1.056_971_51),
    );
    matrix * xyz
}

fn integral(spectrum: impl Fn(f64) -> f64) -> DVec3 {
    let (first, last, step) = RANGE;
    (first..=last)
        .step_by(step)
        .map(|nm| observer(nm as f64) * spectrum(nm as f64))
        .sum()
}

/// The colour of a light with this spectrum, of luminance 1; black if it is not visible. Negative
/// channels are 0.
fn light(spectrum: impl Fn(f64) -> f64) -> [f64; 3] {
    let xyz = integral(spectrum);
    let color = rgb(xyz) / xyz.y;
    if color.is_finite() {
        color.max(DVec3::ZERO).to_array()
    } else {
        [0.0; 3]
    }
}

/// The colour of a black body at a temperature in kelvin, of luminance 1.
pub(crate) fn blackbody(kelvin: f64) -> [f64; 3] {
    // Relative to 600 nm, so that nothing overflows.
    let exponent = |nm: f64| 1.438_776_877e7 / (nm * kelvin);
    let middle = exponent(600.0);
    light(|nm| {
        let relative = libm::exp(exponent(nm) - middle) * (1.0 - libm::exp(-exponent(nm)));
        (600.0 / nm).powi(5) / relative
    })
}

/// The colour of a light with the same energy at all wavelengths, of luminance 1.
pub(crate) fn even_light() -> [f64; 3] {
    light(|_| 1.0)
}

/// A spectrum from pairs of a wavelength in nm, ascending, and a value.
pub(crate) struct Sampled<'a>(pub(crate) &'a [f64]);

impl Sampled<'_> {
    /// The value at a wavelength: linear between the samples, and 0 outside.
    pub(crate) fn at(&self, nm: f64) -> f64 {
        let pairs: &[[f64; 2]] = self.0.as_chunks().0;
        let after = pairs.partition_point(|[place, _]| *place < nm);
        match (after.checked_sub(1).map(|before| pairs[before]), pairs.get(after)) {
            (_, Some([place, value])) if *place == nm => *value,
            (Some([x0, y0]), Some([x1, y1])) => y0 + (y1 - y0) * (nm - x0) / (x1 - x0),
            _ => 0.0,
        }
    }

    /// The one value of a spectrum that is constant.
    pub(crate) fn constant(&self) -> Option<f64> {
        let pairs: &[[f64; 2]] = self.0.as_chunks().0;
        let (first, rest) = pairs.split_first()?;
        rest.iter()
            .all(|[_, value]| *value == first[1])
            .then_some(first[1])
    }

    /// The colour of a light with this spectrum, of luminance 1.
    pub(crate) fn light(&self) -> [f64; 3] {
        light(|nm| self.at(nm))
    }

    /// The colour of a light with this spectrum. Its luminance is the mean of the values, weighted
    /// by the observer's y. Negative channels are 0.
    pub(crate) fn radiance(&self) -> [f64; 3] {
        let color = rgb(integral(|nm| self.at(nm))) / integral(|_| 1.0).y;
        color.max(DVec3::ZERO).to_array()
    }

    /// The colour of a reflectance, or of an index of refraction, under daylight (D65), which is
    /// the white of the RGB space: a constant is grey.
    pub(crate) fn color(&self) -> [f64; 3] {
        if let Some(value) = self.constant() {
            return [value; 3];
        }
        let color = rgb(integral(|nm| self.at(nm) * daylight(nm))) / rgb(integral(daylight));
        if color.is_finite() {
            color.max(DVec3::ZERO).to_array()
        } else {
            [0.0; 3]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn black_bodies_have_luminance_one() {
        for kelvin in [1.0, 800.0, 2700.0, 6500.0, 2e4, 1e9] {
            let [r, g, b] = blackbody(kelvin);
            assert!([r, g, b].iter().all(|value| value.is_finite()), "{kelvin}");
            if kelvin > 2000.0 {
                let luminance = 0.2126 * r + 0.7152 * g + 0.0722 * b;
                assert!((luminance - 1.0).abs() < 0.02, "{kelvin}: {luminance}");
            }
        }
        let [r, g, b] = blackbody(6500.0);
        assert!((r - 1.0).abs() < 0.1 && (g - 1.0).abs() < 0.1 && (b - 1.0).abs() < 0.1);
        let [r, _, b] = blackbody(2700.0);
        assert!(r > 1.5 && b < 0.3);
    }

    #[test]
    fn samples_are_interpolated() {
        let samples = Sampled(&[400.0, 1.0, 500.0, 3.0, 600.0, 3.0]);
        assert_eq!(
            [399.0, 400.0, 450.0, 600.0, 601.0].map(|nm| samples.at(nm)),
            [0.0, 1.0, 2.0, 3.0, 0.0]
        );
        assert_eq!(Sampled(&[400.0, 2.0, 700.0, 2.0]).color(), [2.0; 3]);
        let red = Sampled(&[600.0, 0.0, 620.0, 1.0, 700.0, 1.0]).color();
        assert!(red[0] > red[1] && red[0] > red[2]);
    }
}
