//! The range of values that a reference takes under its own variations, stored with it.
//!
//! A stored reference has six more layers: `min.R` to `max.B`. In a pixel in which they differ, the
//! reference itself took these values when its sample position or its rounding was varied. Such a
//! pixel is at an edge or ill-conditioned.

use crate::metrics::{CompareError, Pair, Side};
use whitstone_image::Image;

/// The layers: smallest values of R, G, B, then largest.
pub const LAYERS: [&str; 6] = ["min.R", "min.G", "min.B", "max.R", "max.G", "max.B"];

/// The layers of an image that has all of them.
#[derive(Clone, Copy, Debug)]
pub struct Ranges<'a> {
    layers: [&'a [f32]; 6],
    width: usize,
}

impl<'a> Ranges<'a> {
    /// The ranges of a reference; `None` if it has no such layers.
    ///
    /// # Errors
    /// [`CompareError`]: a reference with only some of the six layers.
    pub fn of(reference: &'a Image) -> Result<Option<Self>, CompareError> {
        if LAYERS.iter().all(|name| reference.channel(name).is_none()) {
            return Ok(None);
        }
        let mut layers: [&[f32]; 6] = [&[]; 6];
        for (layer, name) in layers.iter_mut().zip(LAYERS) {
            *layer = reference
                .require_channel(name)
                .map_err(|error| CompareError::Channel {
                    side: Side::Reference,
                    error,
                })?;
        }
        Ok(Some(Self {
            layers,
            width: reference.width(),
        }))
    }

    /// Smallest and largest value of each channel in a pixel; `None` if the reference does not vary
    /// there.
    pub fn at(&self, [x, y]: [usize; 2]) -> Option<[[f64; 3]; 2]> {
        let index = y * self.width + x;
        let [a, b, c, d, e, f] = self.layers.map(|layer| f64::from(layer[index]));
        let (min, max) = ([a, b, c], [d, e, f]);
        (min != max).then_some([min, max])
    }
}

/// Whether the comparison is vacuous: each image shows a single colour in all pixels.
///
/// # Errors
/// [`CompareError`]: images that cannot be compared.
pub fn is_vacuous(ours: &Image, reference: &Image) -> Result<bool, CompareError> {
    let pair = Pair::new(ours, reference)?;
    let first = pair.at(0);
    Ok((1..pair.pixels()).all(|index| pair.at(index) == first))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_is_known_where_the_reference_varies() {
        let plain = Image::from_fn(4, 2, |_, _| [2.0; 3]).unwrap();
        assert!(Ranges::of(&plain).unwrap().is_none());
        let mut partial = plain.clone();
        partial.add_channel("min.R", vec![0.0; 8]).unwrap();
        assert!(Ranges::of(&partial).is_err());
        let mut reference = plain.clone();
        for (index, name) in LAYERS.into_iter().enumerate() {
            let value = if index < 3 { 1.0 } else { 3.0 };
            let layer = (0..8).map(|pixel| if pixel == 5 { value } else { 0.0 });
            reference.add_channel(name, layer.collect()).unwrap();
        }
        let ranges = Ranges::of(&reference).unwrap().unwrap();
        assert_eq!(ranges.at([1, 1]), Some([[1.0; 3], [3.0; 3]]));
        assert_eq!(ranges.at([0, 1]), None);
    }

    #[test]
    fn one_colour_is_vacuous() {
        let black = Image::from_fn(4, 2, |_, _| [0.0; 3]).unwrap();
        let grey = Image::from_fn(4, 2, |_, _| [0.5; 3]).unwrap();
        let dot = Image::from_fn(4, 2, |x, _| [if x == 3 { 1.0 } else { 0.0 }; 3]).unwrap();
        assert!(is_vacuous(&black, &grey).unwrap());
        assert!(!is_vacuous(&black, &dot).unwrap());
        assert!(!is_vacuous(&dot, &black).unwrap());
    }
}
