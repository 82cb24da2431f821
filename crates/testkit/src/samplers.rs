//! Laws of samplers.

use std::collections::BTreeSet;
use whitstone_core::stream::LANES;
use whitstone_core::{DVec2, Sampler};

/// Some pixels, including the last one.
const PIXELS: [[u32; 2]; 4] = [[0, 0], [1, 0], [7, 13], [65_535, 65_535]];

/// For a sampler with the same pattern in all pixels: there is at least one position; all lie in
/// `[0, 1)²`, are distinct and deterministic, and their mean is the centre of the pixel.
///
/// # Panics
///
/// If the sampler breaks one of these laws; the message says which and where.
pub fn sampler_laws(sampler: &dyn Sampler) {
    common(sampler);
    let count = sampler.count();
    for pixel in PIXELS {
        let mean = (0..count)
            .map(|index| sampler.position(pixel, index))
            .sum::<DVec2>()
            / f64::from(count);
        let off = (mean - 0.5).abs().max_element();
        assert!(
            off < 1e-12,
            "the mean of the samples of {pixel:?} must be the pixel's centre, found {mean}"
        );
    }
}

/// For a sampler with a different pattern in each pixel: as [`sampler_laws`], but the mean is taken
/// over many pixels and must be within five standard deviations, and no two pixels have the same
/// pattern.
///
/// # Panics
///
/// As [`sampler_laws`].
pub fn random_sampler_laws(sampler: &dyn Sampler) {
    common(sampler);
    let count = sampler.count();
    // Two of the positions on a grid of 2^32 may coincide by chance; whole patterns never do.
    let (side, few) = (if count > 64 { 12 } else { 40 }, count.min(16));
    let mut patterns = BTreeSet::new();
    let mut sum = DVec2::ZERO;
    for pixel in (0..side * side).map(|k| [k % side, k / side]) {
        let positions: Vec<DVec2> = (0..few).map(|index| sampler.position(pixel, index)).collect();
        let bits = |p: &DVec2| p.to_array().map(f64::to_bits);
        assert!(
            patterns.insert(positions.iter().map(bits).collect::<Vec<_>>()),
            "{pixel:?} must have its own pattern"
        );
        sum += (0..count)
            .map(|index| sampler.position(pixel, index))
            .sum::<DVec2>()
            / f64::from(count);
    }
    let pixels = f64::from(side * side);
    let off = (sum / pixels - 0.5).abs().max_element();
    let chance = (1.0 / 12.0 / pixels).sqrt();
    assert!(
        off < 5.0 * chance,
        "the mean over all pixels must be the centre, found {off} away from it, expected about {chance}"
    );
}

/// The laws of both kinds of samplers.
fn common(sampler: &dyn Sampler) {
    let count = sampler.count();
    assert!(count >= 1, "a sampler must have at least one sample per pixel");
    for pixel in PIXELS {
        let position = |index| sampler.position(pixel, index);
        let positions: Vec<DVec2> = (0..count).map(position).collect();
        for (index, p) in positions.iter().enumerate() {
            let inside = p.cmpge(DVec2::ZERO).all() && p.cmplt(DVec2::ONE).all();
            assert!(
                inside,
                "sample {index} of {pixel:?} must lie in the pixel, found {p}"
            );
        }
        let again: Vec<DVec2> = (0..count).rev().map(position).collect();
        assert!(
            positions.iter().eq(again.iter().rev()),
            "the samples of {pixel:?} must be deterministic"
        );
        let mut sorted: Vec<[f64; 2]> = positions.iter().map(|p| p.to_array()).collect();
        sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        assert!(
            sorted.windows(2).all(|w| w[0] != w[1]),
            "the samples of {pixel:?} must be distinct"
        );
    }
    for index in [0, count / 2, count - 1] {
        let mut raster = [DVec2::ZERO; LANES];
        sampler.raster_stream(&PIXELS, index, &mut raster);
        for (pixel, found) in PIXELS.into_iter().zip(raster) {
            let expected = DVec2::from(pixel.map(f64::from)) + sampler.position(pixel, index);
            assert!(
                found == expected,
                "`raster_stream` must agree with `position`: sample {index} of {pixel:?} is at {expected}, \
                 not {found}"
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering};
    use whitstone_core::stream::Lanes;

    struct At<F>(u32, F);

    impl<F: Fn(u32) -> f64 + Send + Sync> Sampler for At<F> {
        fn count(&self) -> u32 {
            self.0
        }
        fn position(&self, _: [u32; 2], index: u32) -> DVec2 {
            DVec2::new((self.1)(index), 0.5)
        }
    }

    #[test]
    fn a_correct_sampler_passes() {
        sampler_laws(&At(2, |i| 0.25 + 0.5 * f64::from(i)));
    }

    /// With another position in streams.
    struct Shifted;

    impl Sampler for Shifted {
        fn count(&self) -> u32 {
            1
        }
        fn position(&self, _: [u32; 2], _: u32) -> DVec2 {
            DVec2::splat(0.5)
        }
        fn raster_stream(&self, pixels: &[[u32; 2]], _: u32, out: &mut Lanes<DVec2>) {
            for (out, pixel) in out.iter_mut().zip(pixels) {
                *out = DVec2::from(pixel.map(f64::from));
            }
        }
    }

    #[test]
    #[should_panic(expected = "must agree with `position`")]
    fn a_stream_with_other_positions_is_found() {
        sampler_laws(&Shifted);
    }

    #[test]
    #[should_panic(expected = "must lie in the pixel")]
    fn a_sample_on_the_far_edge_is_found() {
        sampler_laws(&At(2, f64::from));
    }

    #[test]
    #[should_panic(expected = "the mean")]
    fn a_shifted_pattern_is_found() {
        sampler_laws(&At(2, |i| 0.5 * f64::from(i)));
    }

    #[test]
    #[should_panic(expected = "must be distinct")]
    fn a_repeated_sample_is_found() {
        sampler_laws(&At(2, |_| 0.5));
    }

    #[test]
    #[should_panic(expected = "at least one")]
    fn no_samples_are_found() {
        sampler_laws(&At(0, |_| 0.5));
    }

    #[test]
    #[should_panic(expected = "must have its own pattern")]
    fn a_pattern_that_ignores_its_pixel_is_found() {
        random_sampler_laws(&At(2, |i| 0.25 + 0.5 * f64::from(i)));
    }

    #[test]
    #[should_panic(expected = "must be deterministic")]
    fn a_random_pattern_is_found() {
        let calls = AtomicU32::new(0);
        sampler_laws(&At(2, move |_| {
            f64::from(calls.fetch_add(1, Ordering::Relaxed)) * 1e-3
        }));
    }
}
