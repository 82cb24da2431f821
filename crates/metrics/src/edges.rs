//! Finds edge pixels: those in which a layer differs from a neighbour.
//!
//! Two renderers may differ there because a sample lies on either side of an edge. The remaining
//! pixels are the interior, in which they must agree.

use crate::mask::Mask;
use crate::metrics::{CompareError, Side, check_geometry};
use whitstone_image::{Image, ImageError};

/// A layer, and the smallest step that counts as an edge.
#[derive(Debug, Clone, PartialEq)]
pub struct EdgeLayer {
    /// The channel, such as `shape_id.I` or `depth.Z`.
    pub channel: String,
    /// Neighbours that differ by more than this are at an edge; 0 for ids.
    pub step: f64,
}

/// The pixels of either image that differ from one of their eight neighbours by more than the step
/// of any layer. NaN differs from everything.
///
/// # Errors
/// [`CompareError`]: sizes or placements that differ, a layer missing on either side.
pub fn edges(ours: &Image, reference: &Image, layers: &[EdgeLayer]) -> Result<Mask, CompareError> {
    check_geometry(ours, reference)?;
    let mut found = Mask::new(ours.width(), ours.height());
    for (image, side) in [(ours, Side::Ours), (reference, Side::Reference)] {
        for layer in layers {
            mark(&mut found, image, layer).map_err(|error| CompareError::Channel { side, error })?;
        }
    }
    Ok(found)
}

fn mark(found: &mut Mask, image: &Image, layer: &EdgeLayer) -> Result<(), ImageError> {
    let plane = image.require_channel(&layer.channel)?;
    let (width, height) = (image.width(), image.height());
    let at = |x: usize, y: usize| f64::from(plane[y * width + x]);
    let same = |a: f64, b: f64| a == b || (a - b).abs() <= layer.step;
    for y in 0..height {
        for x in 0..width {
            // Each pair of neighbours is visited once, from one of its pixels.
            let right = (x + 1 < width).then_some((x + 1, y));
            let below = (x.saturating_sub(1)..(x + 2).min(width)).map(|x| (x, y + 1));
            for (to_x, to_y) in right.into_iter().chain(below.filter(|_| y + 1 < height)) {
                if !same(at(x, y), at(to_x, to_y)) {
                    found.set(x, y, true);
                    found.set(to_x, to_y, true);
                }
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(of: impl Fn(usize, usize) -> f32) -> Image {
        let mut image = Image::new(6, 5).unwrap();
        let values = (0..30).map(|i| of(i % 6, i / 6)).collect();
        image.add_channel("id.I", values).unwrap();
        image
    }

    fn layer(step: f64) -> [EdgeLayer; 1] {
        [EdgeLayer {
            channel: "id.I".to_owned(),
            step,
        }]
    }

    #[test]
    fn both_sides_of_an_edge_in_either_image() {
        let wall = image(|x, _| if x < 3 { 1.0 } else { 2.0 });
        let flat = image(|_, _| 1.0);
        for (ours, reference) in [(&wall, &flat), (&flat, &wall)] {
            let found = edges(ours, reference, &layer(0.0)).unwrap();
            assert_eq!(found, Mask::from_fn(6, 5, |x, _| x == 2 || x == 3));
        }
        assert_eq!(edges(&flat, &flat, &layer(0.0)).unwrap().count(), 0);
        // All neighbours of a single different pixel are at the edge, including the diagonal ones.
        let dot = image(|x, y| if (x, y) == (1, 3) { 7.0 } else { 1.0 });
        let found = edges(&dot, &flat, &layer(0.0)).unwrap();
        assert_eq!(found, Mask::from_fn(6, 5, |x, y| x <= 2 && y >= 2));
    }

    #[test]
    fn numbers_have_steps_and_nan_is_an_edge() {
        let ramp = image(|x, _| x as f32 + if x > 3 { 2.0 } else { 0.0 });
        let found = edges(&ramp, &ramp, &layer(1.5)).unwrap();
        assert_eq!(found, Mask::from_fn(6, 5, |x, _| x == 3 || x == 4));
        let holed = image(|x, y| if (x, y) == (0, 0) { f32::NAN } else { 1.0 });
        assert_eq!(edges(&holed, &holed, &layer(9.0)).unwrap().count(), 4);
        let empty = image(|_, _| f32::INFINITY);
        assert_eq!(edges(&empty, &empty, &layer(0.0)).unwrap().count(), 0);
        let none = Image::new(6, 5).unwrap();
        assert!(edges(&ramp, &none, &layer(0.0)).is_err());
    }
}
