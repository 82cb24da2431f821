//! Converts scene-referred linear values to 8-bit display values, and the sRGB transfer functions.

/// Exposure for previews. The steps, for each channel separately: multiply by 2^exposure, clamp to
/// [0, 1], encode with [`linear_to_srgb`], multiply by 255 and round half up.
///
/// There is no tone curve: values above 1 after the exposure are white, so that equal pixels mean
/// equal values.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ToneMap {
    /// Exposure in stops: 0 leaves values as they are, 1 doubles them.
    pub exposure: f64,
}

impl ToneMap {
    /// The 8-bit code of a linear value. NaN gives 0 here;
    /// [`Raster::preview`](crate::Raster::preview) shows it as an unmistakable colour.
    #[must_use]
    pub fn encode(&self, linear: f64) -> u8 {
        let shown = (linear * self.exposure.exp2()).clamp(0.0, 1.0);
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
        ((encoded + 0.055) / 1.055).powf(2.4)
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
        1.055 * linear.powf(1.0 / 2.4) - 0.055
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

    #[test]
    fn exposure_is_in_stops_and_values_are_clamped() {
        assert_eq!(
            ToneMap { exposure: 1.0 }.encode(0.25),
            ToneMap::default().encode(0.5)
        );
        assert_eq!(
            ToneMap { exposure: -2.0 }.encode(2.0),
            ToneMap::default().encode(0.5)
        );
        assert_eq!(ToneMap::default().encode(7.0), 255);
        assert_eq!(ToneMap::default().encode(-1.0), 0);
        assert_eq!(
            ToneMap {
                exposure: f64::INFINITY
            }
            .encode(0.0),
            0
        );
        assert_eq!(ToneMap { exposure: f64::NAN }.encode(0.5), 0);
    }

    #[test]
    fn halves_round_up() {
        // The linear value whose code lies exactly between 99 and 100, and its neighbour below.
        let middle = srgb_to_linear(99.5 / 255.0);
        assert_eq!(ToneMap::default().encode(middle * (1.0 + 1e-12)), 100);
        assert_eq!(ToneMap::default().encode(middle * (1.0 - 1e-12)), 99);
    }
}
