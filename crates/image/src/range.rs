//! The range of values that a reference takes under its own variations, kept with it.
//!
//! A stored reference has six more layers: `min.R` to `max.B`. Where they differ, the reference itself took these values when its sample
//! position or its rounding was varied: an edge, or an ill-conditioned pixel. Our value is *explained* where it lies within them.

use crate::mask::Mask;
use crate::metrics::{CompareError, Pair, Side, Tolerance};
use crate::planes::Image;

/// The layers: smallest values of R, G, B, then largest.
pub const LAYERS: [&str; 6] = ["min.R", "min.G", "min.B", "max.R", "max.G", "max.B"];

/// The pixels of `over` that the range of the reference explains: it varies there, and all our channels lie within the range or outside by at
/// most the tolerance. `None` if the reference has no such layers.
///
/// # Errors
/// [`CompareError`]: images that cannot be compared, a reference with some of the six layers only.
pub fn explained(
    ours: &Image,
    reference: &Image,
    over: &Mask,
    tolerance: Tolerance,
) -> Result<Option<Mask>, CompareError> {
    if LAYERS.iter().all(|name| reference.channel(name).is_none()) {
        return Ok(None);
    }
    let pair = Pair::new(ours, reference)?;
    let mut layers: [&[f32]; 6] = [&[]; 6];
    for (layer, name) in layers.iter_mut().zip(LAYERS) {
        *layer = reference
            .require_channel(name)
            .map_err(|error| CompareError::Channel {
                side: Side::Reference,
                error,
            })?;
    }
    let mean = pair.mean_reference();
    let holds = |x: usize, y: usize| {
        let index = y * pair.width + x;
        let range = |channel: usize| [channel, channel + 3].map(|layer| f64::from(layers[layer][index]));
        let varies = (0..3).any(|channel| range(channel)[0] < range(channel)[1]);
        // What is not finite is within nothing.
        varies
            && pair
                .at(index)
                .into_iter()
                .enumerate()
                .all(|(channel, (ours, reference))| {
                    let allowed = tolerance.relative * reference.abs() + tolerance.absolute * mean;
                    let [min, max] = range(channel);
                    ours.is_finite() && ours >= min - allowed && ours <= max + allowed
                })
    };
    Ok(Some(Mask::from_fn(pair.width, pair.height, |x, y| {
        over.contains(x, y) && holds(x, y)
    })))
}

/// Whether both images show the same colour in all pixels, each its own: then nothing but this colour is compared.
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
    use crate::metrics::over_tolerance;

    /// Grey, with a range from 1 to 3 in one pixel.
    fn reference() -> Image {
        let mut image = Image::from_fn(4, 2, |_, _| [2.0; 3]).unwrap();
        for (index, name) in LAYERS.into_iter().enumerate() {
            let value = if index < 3 { 1.0 } else { 3.0 };
            let layer = (0..8).map(|pixel| if pixel == 5 { value } else { 0.0 });
            image.add_channel(name, layer.collect()).unwrap();
        }
        image
    }

    fn count(ours: &Image, reference: &Image) -> [usize; 2] {
        let over = over_tolerance(ours, reference, Tolerance::default()).unwrap();
        let explained = explained(ours, reference, &over, Tolerance::default()).unwrap();
        [over.count(), explained.map_or(0, |mask| mask.count())]
    }

    #[test]
    fn a_range_explains_its_own_pixel_only() {
        let reference = reference();
        let at = |pixel: usize, value: f32| {
            Image::from_fn(4, 2, |x, y| [if 4 * y + x == pixel { value } else { 2.0 }; 3]).unwrap()
        };
        assert_eq!(count(&at(5, 2.9), &reference), [1, 1]);
        // Beyond the range, and where the reference does not vary.
        assert_eq!(count(&at(5, 3.1), &reference), [1, 0]);
        assert_eq!(count(&at(5, f32::NAN), &reference), [1, 0]);
        assert_eq!(count(&at(4, 2.9), &reference), [1, 0]);
        let plain = Image::from_fn(4, 2, |_, _| [2.0; 3]).unwrap();
        let over = Mask::new(4, 2);
        assert!(
            explained(&plain, &plain, &over, Tolerance::default())
                .unwrap()
                .is_none()
        );
        let mut partial = plain.clone();
        partial.add_channel("min.R", vec![0.0; 8]).unwrap();
        assert!(explained(&plain, &partial, &over, Tolerance::default()).is_err());
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
