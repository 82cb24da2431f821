//! The colour of a pixel and its tolerance.

use whitstone_image::Image;
use whitstone_metrics::Tolerance;

/// The colour of a pixel.
pub(crate) fn color_at(image: &Image, [x, y]: [usize; 2]) -> [f64; 3] {
    let index = y * image.width() + x;
    image.rgb().map_or([f64::NAN; 3], |planes| {
        planes.map(|plane| f64::from(plane[index]))
    })
}

/// The tolerance of each channel around the reference's value.
pub(crate) fn allowed(nominal: [f64; 3], mean: f64) -> [f64; 3] {
    let Tolerance { relative, absolute } = Tolerance::default();
    nominal.map(|v| relative * v.abs() + absolute * mean)
}
