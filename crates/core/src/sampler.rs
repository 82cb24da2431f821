use glam::DVec2;

/// The fixed pattern of sample positions inside a pixel.
pub trait Sampler: Send + Sync {
    /// Samples a pixel at most, at least 1.
    fn count(&self) -> u32;

    /// Position of sample `index` (below `count`) of a pixel, in `[0, 1)²` from its top left
    /// corner.
    fn position(&self, pixel: [u32; 2], index: u32) -> DVec2;

    /// When a pixel has enough of them; `None` if each takes all.
    fn refinement(&self) -> Option<Refinement> {
        None
    }
}

/// Which pixels take more samples than the first ones: those whose error, estimated from how far
/// apart their samples are, is above a threshold. Section 5 of `docs/whitted-model.md` has the
/// rule.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refinement {
    /// Samples that every pixel takes, at least 1.
    pub first: u32,
    /// Error that is left, a radiance.
    pub threshold: f64,
}

impl Refinement {
    /// Whether a pixel needs more samples than the `taken` that it has. `own` is the range of their
    /// radiances (largest minus smallest, of the channel where it is largest), `near` that of the
    /// first samples of the neighbours, of the one where it is largest.
    pub fn goes_on(&self, taken: u32, own: f64, near: f64) -> bool {
        let n = f64::from(taken);
        // The error of an edge that runs through the pixel, with points as even as Sobol's, and of
        // one that has been missed.
        let estimate = (OWN * own / n.powf(0.75)).max(NEAR * near / n);
        estimate > self.threshold
    }
}

/// Of the range, over the 3/4th power of the samples: the root mean square for straight edges at
/// random places.
const OWN: f64 = 0.3;

/// Of the range of the neighbours, over the samples: an edge that no sample tells cuts off less
/// than a share of one.
const NEAR: f64 = 0.15;
