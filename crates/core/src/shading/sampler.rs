use crate::stream::Lanes;
use glam::DVec2;

/// The fixed pattern of sample positions inside a pixel.
pub trait Sampler: Send + Sync {
    /// Maximum number of samples per pixel, at least 1.
    fn count(&self) -> u32;

    /// Position of sample `index` (below `count`) in a pixel, in `[0, 1)²` from its top left
    /// corner.
    fn position(&self, pixel: [u32; 2], index: u32) -> DVec2;

    /// Raster coordinates of [`Self::position`] in each of some pixels (at most as many as a stream
    /// has lanes).
    fn raster_stream(&self, pixels: &[[u32; 2]], index: u32, out: &mut Lanes<DVec2>) {
        for (out, [x, y]) in out.iter_mut().zip(pixels) {
            *out = DVec2::new(f64::from(*x), f64::from(*y)) + self.position([*x, *y], index);
        }
    }

    /// The stopping rule for adaptive sampling; `None` if every pixel takes all samples.
    fn refinement(&self) -> Option<Refinement> {
        None
    }
}

/// Adaptive sampling: a pixel takes more samples while its error, estimated from the range of its
/// samples, is above a threshold. Section 5 of `docs/whitted-model.md` has the rule.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refinement {
    /// Samples that every pixel takes, at least 1.
    pub initial_samples: u32,
    /// Target error, a radiance.
    pub threshold: f64,
}

impl Refinement {
    /// Whether a pixel needs more than the `taken` samples. `own` is the range (maximum minus
    /// minimum) of their radiances in the channel where it is largest. `near` is the largest range
    /// of the first samples of any neighbour.
    pub fn continues(&self, taken: u32, own: f64, near: f64) -> bool {
        let n = f64::from(taken);
        // The larger of two errors: of an edge through the pixel, sampled as evenly as Sobol
        // points, and of an edge that all samples missed.
        let estimate = (OWN * own / libm::pow(n, 0.75)).max(NEAR * near / n);
        estimate > self.threshold
    }
}

/// Error per range for n samples, times n^(3/4): the root mean square for straight edges at random
/// positions.
const OWN: f64 = 0.3;

/// Error per range of the neighbours, times n: an edge that no sample detects cuts off less than
/// one sample's share of the pixel.
const NEAR: f64 = 0.15;
