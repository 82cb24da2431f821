//! Compares AOV layers: counts differing ids, measures differences of floats.
//!
//! A layer is one channel, such as `shape_id.I` or `depth.Z`. Ids must be equal exactly; floats are
//! measured.

use serde::Serialize;

use crate::mask::Mask;
use crate::metrics::{CompareError, NotFinite, Side, check_geometry, check_mask_size};
use crate::sum::Sum;
use whitstone_image::Image;

/// A pixel at which two layers differ.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LayerPixel {
    /// Column.
    pub x: usize,
    /// Row.
    pub y: usize,
    /// Our value.
    pub ours: f32,
    /// The reference's value.
    pub reference: f32,
}

/// The result of [`compare_ids`].
#[derive(Debug, Clone, PartialEq)]
pub struct IdDifference {
    /// Pixels that were compared.
    pub pixels: usize,
    /// Pixels with different ids.
    pub differing: Mask,
    /// The first of them, row by row from the top.
    pub first: Option<LayerPixel>,
}

/// The result of [`compare_floats`].
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FloatDifference {
    /// Pixels that were compared.
    pub pixels: usize,
    /// Pixels with a NaN or an infinity on either side. They are excluded from the other numbers,
    /// and should fail the comparison.
    pub not_finite: NotFinite,
    /// Root mean square difference, in units of the layer; 0 if no pixel is finite on both sides.
    pub rms: f64,
    /// Largest absolute difference, in units of the layer.
    pub max_abs: f64,
    /// The pixel with the largest difference; `None` if nothing differs.
    pub worst: Option<LayerPixel>,
}

/// Compares a layer of ids exactly. NaN equals nothing. Pixels of `exclude` are ignored.
///
/// # Errors
/// [`CompareError`]: sizes or placements that differ, the channel missing on either side, a mask of
/// another size.
pub fn compare_ids(
    ours: &Image,
    reference: &Image,
    channel: &str,
    exclude: Option<&Mask>,
) -> Result<IdDifference, CompareError> {
    let layers = Layers::new(ours, reference, channel, exclude)?;
    let mut differing = Mask::new(layers.width, ours.height());
    let mut found = IdDifference {
        pixels: 0,
        differing: Mask::new(0, 0),
        first: None,
    };
    for pixel in layers.pixels() {
        found.pixels += 1;
        if pixel.ours != pixel.reference {
            differing.set(pixel.x, pixel.y, true);
            found.first.get_or_insert(pixel);
        }
    }
    found.differing = differing;
    Ok(found)
}

/// Compares a layer of floats. Pixels of `exclude` are ignored (for depths and normals, those in
/// which ids differ).
///
/// # Errors
/// As [`compare_ids`].
pub fn compare_floats(
    ours: &Image,
    reference: &Image,
    channel: &str,
    exclude: Option<&Mask>,
) -> Result<FloatDifference, CompareError> {
    let layers = Layers::new(ours, reference, channel, exclude)?;
    let mut found = FloatDifference {
        pixels: 0,
        not_finite: NotFinite::default(),
        rms: 0.0,
        max_abs: 0.0,
        worst: None,
    };
    let mut squares = Sum::default();
    let mut finite = 0_usize;
    for pixel in layers.pixels() {
        found.pixels += 1;
        found.not_finite.ours += usize::from(!pixel.ours.is_finite());
        found.not_finite.reference += usize::from(!pixel.reference.is_finite());
        if !(pixel.ours.is_finite() && pixel.reference.is_finite()) {
            continue;
        }
        finite += 1;
        let difference = (f64::from(pixel.ours) - f64::from(pixel.reference)).abs();
        squares.add(difference * difference);
        if difference > found.max_abs {
            found.max_abs = difference;
            found.worst = Some(pixel);
        }
    }
    if finite > 0 {
        found.rms = (squares.total() / finite as f64).sqrt();
    }
    Ok(found)
}

struct Layers<'a> {
    width: usize,
    ours: &'a [f32],
    reference: &'a [f32],
    exclude: Option<&'a Mask>,
}

impl<'a> Layers<'a> {
    fn new(
        ours: &'a Image,
        reference: &'a Image,
        channel: &str,
        exclude: Option<&'a Mask>,
    ) -> Result<Self, CompareError> {
        check_geometry(ours, reference)?;
        check_mask_size(exclude, (ours.width(), ours.height()))?;
        let plane = |image: &'a Image, side| {
            image
                .require_channel(channel)
                .map_err(|error| CompareError::Channel { side, error })
        };
        let (ours_plane, reference_plane) = (plane(ours, Side::Ours)?, plane(reference, Side::Reference)?);
        Ok(Self {
            width: ours.width(),
            ours: ours_plane,
            reference: reference_plane,
            exclude,
        })
    }

    /// The pixels that are not excluded.
    fn pixels(&self) -> impl Iterator<Item = LayerPixel> {
        self.ours
            .iter()
            .zip(self.reference)
            .enumerate()
            .filter(|&(index, _)| self.exclude.is_none_or(|mask| !mask.as_slice()[index]))
            .map(|(index, (&ours, &reference))| LayerPixel {
                x: index % self.width,
                y: index / self.width,
                ours,
                reference,
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layer(samples: [f32; 6]) -> Image {
        let mut image = Image::new(3, 2).unwrap();
        image.add_channel("depth.Z", samples.to_vec()).unwrap();
        image
    }

    #[test]
    fn ids_are_exact() {
        let a = layer([-1.0, 0.0, 1.0, 2.0, 3.0, f32::NAN]);
        let b = layer([-1.0, 0.0, 1.0, 7.0, 3.0, f32::NAN]);
        let found = compare_ids(&a, &b, "depth.Z", None).unwrap();
        assert_eq!((found.pixels, found.differing.count()), (6, 2));
        assert_eq!(
            found.first,
            Some(LayerPixel {
                x: 0,
                y: 1,
                ours: 2.0,
                reference: 7.0
            })
        );
        let found = compare_ids(&a, &b, "depth.Z", Some(&found.differing)).unwrap();
        assert_eq!((found.pixels, found.differing.count(), found.first), (4, 0, None));
    }

    #[test]
    fn floats_are_measured_and_bad_ones_counted() {
        let a = layer([1.0, 2.0, 3.0, 4.0, f32::NAN, f32::INFINITY]);
        let b = layer([1.0, 2.0, 6.0, 0.0, 5.0, f32::INFINITY]);
        let found = compare_floats(&a, &b, "depth.Z", None).unwrap();
        assert_eq!(
            found.not_finite,
            NotFinite {
                ours: 2,
                reference: 1
            }
        );
        assert_eq!((found.pixels, found.rms, found.max_abs), (6, 2.5, 4.0));
        assert_eq!(
            found.worst,
            Some(LayerPixel {
                x: 0,
                y: 1,
                ours: 4.0,
                reference: 0.0
            })
        );
        assert_eq!(compare_floats(&b, &b, "depth.Z", None).unwrap().worst, None);
    }

    #[test]
    fn a_missing_layer_is_an_error() {
        let a = layer([0.0; 6]);
        let error = compare_floats(&a, &Image::new(3, 2).unwrap(), "depth.Z", None).unwrap_err();
        assert!(
            matches!(
                error,
                CompareError::Channel {
                    side: Side::Reference,
                    ..
                }
            ),
            "{error}"
        );
        assert!(matches!(
            compare_ids(&a, &Image::new(2, 3).unwrap(), "depth.Z", None),
            Err(CompareError::Size { .. })
        ));
        let mask = Mask::new(2, 3);
        assert!(matches!(
            compare_ids(&a, &a, "depth.Z", Some(&mask)),
            Err(CompareError::MaskSize { .. })
        ));
    }
}
