use glam::DVec2;

/// The fixed pattern of sample positions inside a pixel.
pub trait Sampler: Send + Sync {
    /// Samples a pixel, at least 1.
    fn count(&self) -> u32;

    /// Position of sample `index` (below `count`) of a pixel, in `[0, 1)²` from its top left corner.
    fn position(&self, pixel: [u32; 2], index: u32) -> DVec2;
}
