//! Converts scene-referred linear values to 8-bit display values, and the sRGB transfer functions.

/// How values after the exposure become display values in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ToneCurve {
    /// Values are kept, and those above 1 are white. Equal pixels mean equal values, as comparisons
    /// need.
    #[default]
    Clamp,
    /// [`ACES`]: dark values gain contrast, and bright ones approach white slowly, as on film.
    Filmic,
}

/// A filmic tone curve: the fit of K. Narkowicz, *ACES Filmic Tone Mapping Curve* (2016), to the
/// reference rendering transform of the Academy Color Encoding System, with his factor of 0.6,
/// which keeps the exposure of that transform.
///
/// The numbers are a to f of `(a x² + b x + c) / (d x² + e x + f)`, limited to [0, 1].
pub const ACES: [f64; 6] = [0.36 * 2.51, 0.6 * 0.03, 0.0, 0.36 * 2.43, 0.6 * 0.59, 0.14];

impl ToneCurve {
    /// The display value, in [0, 1], of a linear value; NaN stays NaN. Values below 0 give 0, and
    /// infinity gives 1.
    #[must_use]
    pub fn apply(self, linear: f64) -> f64 {
        match self {
            Self::Clamp => linear.clamp(0.0, 1.0),
            Self::Filmic => {
                let [a, b, c, d, e, f] = ACES;
                // From about 9.2 on the quotient is above 1; the limit keeps its squares finite.
                let x = linear.clamp(0.0, 1e6);
                ((a * x * x + b * x + c) / (d * x * x + e * x + f)).clamp(0.0, 1.0)
            }
        }
    }
}

/// Exposure and tone curve for previews. The steps, for each channel separately: multiply by
/// 2^exposure, apply the curve, encode with [`linear_to_srgb`], multiply by 255 and round half up.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ToneMap {
    /// Exposure in stops: 0 leaves values as they are, 1 doubles them.
    pub exposure: f64,
    /// The curve after the exposure.
    pub curve: ToneCurve,
}

impl ToneMap {
    /// The 8-bit code of a linear value. NaN gives 0 here;
    /// [`Raster::preview`](crate::Raster::preview) shows it as an unmistakable colour.
    #[must_use]
    pub fn encode(&self, linear: f64) -> u8 {
        let shown = self.curve.apply(linear * libm::exp2(self.exposure));
        // The cast clamps, and maps NaN to 0.
        (linear_to_srgb(shown) * 255.0 + 0.5).floor() as u8
    }
}

/// sRGB decoding (IEC 61966-2-1): encoded value in [0, 1] to linear value in [0, 1].
///
/// `c / 12.92` for c <= 0.04045, else `((c + 0.055) / 1.055)^2.4`.
#[must_use]
pub fn srgb_to_linear(encoded: f64) -> f64 {
    if encoded <= 0.04045 {
        encoded / 12.92
    } else {
        libm::pow((encoded + 0.055) / 1.055, 2.4)
    }
}

/// sRGB encoding (IEC 61966-2-1): linear value in [0, 1] to encoded value in [0, 1].
///
/// `12.92 c` for c <= 0.0031308, else `1.055 c^(1/2.4) - 0.055`.
#[must_use]
pub fn linear_to_srgb(linear: f64) -> f64 {
    if linear <= 0.0031308 {
        linear * 12.92
    } else {
        1.055 * libm::pow(linear, 1.0 / 2.4) - 0.055
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    #[test]
    fn known_values() {
        assert_eq!(srgb_to_linear(0.0), 0.0);
        assert_eq!(srgb_to_linear(1.0), 1.0);
        assert_eq!(srgb_to_linear(0.04045), 0.04045 / 12.92);
        // 188 is the code nearest to half intensity.
        assert_abs_diff_eq!(srgb_to_linear(188.0 / 255.0), 0.5028864580325687, epsilon = 1e-15);
        assert_eq!(ToneMap::default().encode(0.5), 188);
        assert_eq!(ToneMap::default().encode(0.18), 118);
    }

    #[test]
    fn every_code_round_trips() {
        for code in 0..=255_u8 {
            assert_eq!(
                ToneMap::default().encode(srgb_to_linear(f64::from(code) / 255.0)),
                code
            );
        }
        for code in 0..=65535 {
            let encoded = f64::from(code) / 65535.0;
            // The two branches of the standard meet only to about 3e-8.
            assert_abs_diff_eq!(linear_to_srgb(srgb_to_linear(encoded)), encoded, epsilon = 1e-7);
        }
    }

    fn exposed(exposure: f64) -> ToneMap {
        ToneMap {
            exposure,
            ..ToneMap::default()
        }
    }

    #[test]
    fn exposure_is_in_stops_and_values_are_clamped() {
        assert_eq!(exposed(1.0).encode(0.25), ToneMap::default().encode(0.5));
        assert_eq!(exposed(-2.0).encode(2.0), ToneMap::default().encode(0.5));
        assert_eq!(ToneMap::default().encode(7.0), 255);
        assert_eq!(ToneMap::default().encode(-1.0), 0);
        assert_eq!(exposed(f64::INFINITY).encode(0.0), 0);
        assert_eq!(exposed(f64::NAN).encode(0.5), 0);
    }

    #[test]
    fn the_filmic_curve_is_the_published_one_and_never_falls() {
        // As published: (x (2.51 x + 0.03)) / (x (2.43 x + 0.59) + 0.14), of 0.6 times the value.
        let published = |value: f64| {
            let x = 0.6 * value;
            (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)
        };
        for value in [0.0, 0.01, 0.18, 0.5, 1.0, 4.0] {
            assert_abs_diff_eq!(ToneCurve::Filmic.apply(value), published(value), epsilon = 1e-15);
        }
        let values: Vec<f64> = (0..2000).map(|k| f64::from(k) / 100.0).collect();
        let shown = values.iter().map(|&value| ToneCurve::Filmic.apply(value));
        assert!(shown.is_sorted());
        for (value, expected) in [(-1.0, 0.0), (100.0, 1.0), (f64::INFINITY, 1.0), (f64::MAX, 1.0)] {
            assert_eq!(ToneCurve::Filmic.apply(value), expected);
        }
        let filmic = ToneMap {
            curve: ToneCurve::Filmic,
            ..ToneMap::default()
        };
        assert_eq!(filmic.encode(f64::NAN), 0);
        // A value that clamps to white still has room above it.
        assert!(filmic.encode(1.0) < filmic.encode(2.0) && filmic.encode(2.0) < 255);
    }

    #[test]
    fn halves_round_up() {
        // The linear value whose code lies exactly between 99 and 100, and its neighbour below.
        let middle = srgb_to_linear(99.5 / 255.0);
        assert_eq!(ToneMap::default().encode(middle * (1.0 + 1e-12)), 100);
        assert_eq!(ToneMap::default().encode(middle * (1.0 - 1e-12)), 99);
    }
}
