//! The rendered image.

use whitstone_core::Counters;
use whitstone_image::{Image, ImageError};

/// A rendered image.
pub struct Film {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Radiance in W/(m² sr), linear Rec. 709, row by row from the top.
    pub rgb: Vec<[f32; 3]>,
    /// Layers by EXR channel name, each `width * height` values in the same order.
    pub layers: Vec<(String, Vec<f32>)>,
    /// Samples per pixel.
    pub samples: u32,
    /// Rays traced for the radiance.
    pub counters: Counters,
    /// Wall time of the rendering in seconds.
    pub render_seconds: f64,
}

/// Called with the number of finished pixels and the total, from any thread.
pub type Progress<'a> = &'a (dyn Fn(u64, u64) + Sync);

impl Film {
    /// Number of pixels whose radiance the image cannot represent: it overflows `f32`, or is NaN.
    pub fn not_finite(&self) -> usize {
        let unfit = |rgb: &&[f32; 3]| !rgb.iter().all(|value| value.is_finite());
        self.rgb.iter().filter(unfit).count()
    }

    /// Converts to an image with all layers and provenance attributes.
    pub fn to_image(&self, scene_hash: &str) -> Result<Image, ImageError> {
        let mut image = Image::from_rgb(self.width as usize, self.height as usize, &self.rgb)?;
        for (name, values) in &self.layers {
            image.add_channel(name, values.clone())?;
        }
        image.set_attribute("scene_hash", scene_hash)?;
        image.set_attribute("samples", self.samples.to_string())?;
        image.set_attribute("version", env!("CARGO_PKG_VERSION"))?;
        Ok(image)
    }
}
