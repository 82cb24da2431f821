//! Reads the images of a comparison.

use crate::terminal::Failure;
use rayon::prelude::*;
use std::path::Path;
use whitstone_image::planes::RGB;
use whitstone_image::{Codes, Image, Limits, Picture, Transfer, picture};
use whitstone_metrics::Mask;

/// An image of a comparison.
pub(super) struct Input {
    /// Its values, or the codes of a file that has some, normalised.
    image: Image,
    /// The numbers of the file.
    codes: Codes,
    /// How the numbers represent light.
    transfer: Transfer,
}

impl Input {
    /// The linear values.
    pub(super) fn linear(mut self) -> Image {
        self.transfer.apply(&mut self.image);
        self.image
    }
}

/// Reads an image. `layer` names the channels of an EXR file that are its colours; codes are
/// decoded by `transfer`.
pub(super) fn read(path: &Path, layer: Option<&str>, transfer: Transfer) -> Result<Input, Failure> {
    let Picture { mut image, codes } = picture::read(path, Limits::IMAGE).map_err(Failure::usage)?;
    if let Some(layer) = layer {
        choose(&mut image, layer)
            .map_err(|problem| Failure::usage(format!("{}: {problem}", path.display())))?;
    }
    Ok(Input {
        image,
        codes,
        transfer: if codes.is_float() {
            Transfer::Linear
        } else {
            transfer
        },
    })
}

/// Makes the channels `LAYER.R`, `LAYER.G`, `LAYER.B`, or the single channel `LAYER`, the colours
/// of an image. `LAYER` may be the name of one of the three, such as `Beauty.R`.
fn choose(image: &mut Image, layer: &str) -> Result<(), String> {
    let stem = RGB
        .iter()
        .find_map(|name| layer.strip_suffix(&format!(".{name}")));
    let stem = stem.unwrap_or(layer);
    let of = |image: &Image, name: &str| image.channel(name).map(<[f32]>::to_vec);
    let planes: Option<Vec<Vec<f32>>> = RGB
        .iter()
        .map(|name| of(image, &format!("{stem}.{name}")))
        .collect();
    let planes = planes.or_else(|| of(image, layer).map(|plane| vec![plane; 3]));
    let Some(planes) = planes else {
        let names: Vec<&str> = image.channels().map(|(name, _)| name).collect();
        let near = whitstone_core::nearest(layer, names.iter().copied());
        return Err(match near {
            Some(near) => format!("there is no layer {layer}; did you mean {near}?"),
            None => format!("there is no layer {layer}; its channels are {}", names.join(", ")),
        });
    };
    for (name, plane) in RGB.into_iter().zip(planes) {
        image.remove_channel(name);
        image
            .add_channel(name, plane)
            .map_err(|error| error.to_string())?;
    }
    Ok(())
}

/// Makes ours equal to the reference where all colours of the image `mask` are 0. Values of the
/// reference that are not finite become 0 there.
pub(super) fn hide(inputs: &mut [Input; 2], mask: &Path) -> Result<(), String> {
    let read = picture::read(mask, Limits::IMAGE).map_err(|error| error.to_string())?;
    let of_mask = |problem: String| format!("{}: {problem}", mask.display());
    let colors = read.image.rgb().map_err(|error| of_mask(error.to_string()))?;
    let hidden: Vec<usize> = (0..read.image.pixel_count())
        .filter(|&index| colors.iter().all(|plane| plane[index] == 0.0))
        .collect();
    let [ours, reference] = inputs;
    let size = |image: &Image| [image.width(), image.height()];
    if size(&read.image) != size(&reference.image) {
        let ([width, height], [of_mask_x, of_mask_y]) = (size(&reference.image), size(&read.image));
        return Err(of_mask(format!(
            "the mask has {of_mask_x} x {of_mask_y} pixels, and the reference {width} x {height}"
        )));
    }
    if size(&ours.image) != size(&reference.image) {
        // The sizes are reported by the comparison.
        return Ok(());
    }
    let (ours, reference) = (&mut ours.image, &mut reference.image);
    let names: Vec<String> = reference.channels().map(|(name, _)| name.to_owned()).collect();
    for name in &names {
        let (Some(ours), Some(reference)) = (ours.channel_mut(name), reference.channel_mut(name)) else {
            continue;
        };
        let is_color = RGB.contains(&name.as_str());
        for &index in &hidden {
            if is_color && !reference[index].is_finite() || reference[index].is_nan() {
                reference[index] = 0.0;
            }
            ours[index] = reference[index];
        }
    }
    Ok(())
}

/// Takes each value of the reference to the nearest one to ours between those of two images, and of
/// the reference itself.
pub(super) fn widen(inputs: &mut [Input; 2], range: [&Path; 2]) -> Result<(), String> {
    let [least, most] = range.map(|path| {
        let read = picture::read(path, Limits::IMAGE).map_err(|error| error.to_string())?;
        Ok::<_, String>((path, read))
    });
    let (least, most) = (least?, most?);
    let [ours, reference] = inputs;
    for (path, read) in [&least, &most] {
        let of = |image: &Image| [image.width(), image.height()];
        if of(&read.image) != of(&reference.image) || !same_kind(read.codes, reference.codes) {
            return Err(format!(
                "{}: a range needs an image of the size and kind of the reference",
                path.display()
            ));
        }
    }
    if [ours.image.width(), ours.image.height()] != [reference.image.width(), reference.image.height()] {
        // The sizes are reported by the comparison.
        return Ok(());
    }
    // Decoding keeps the order of codes.
    for name in RGB {
        let channel = |read: &'_ Picture| {
            let plane = read.image.channel(name).map(<[f32]>::to_vec);
            plane.ok_or_else(|| format!("the range has no channel {name}"))
        };
        let (low, high) = (channel(&least.1)?, channel(&most.1)?);
        let (Some(ours), Some(plane)) = (ours.image.channel(name), reference.image.channel_mut(name)) else {
            continue;
        };
        let width = least.1.image.width();
        for (index, value) in plane.iter_mut().enumerate() {
            let (low, high) = (low[index], high[index]);
            if low > high || low.is_nan() || high.is_nan() {
                return Err(format!(
                    "{} is not above {} in channel {name} of pixel ({}, {})",
                    most.0.display(),
                    least.0.display(),
                    index % width,
                    index / width
                ));
            }
            // The comparison reports values that are not finite.
            if ours[index].is_finite() && value.is_finite() {
                *value = ours[index].clamp(low.min(*value), high.max(*value));
            }
        }
    }
    Ok(())
}

/// Whether the numbers of two images are comparable.
fn same_kind(one: Codes, other: Codes) -> bool {
    one == other || one.is_float() && other.is_float()
}

/// How the codes of two images differ.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub(super) struct CodeDifference {
    /// The kind of the codes.
    pub(super) kind: String,
    /// Pixels with a code that differs by more than the limit.
    pub(super) pixels: usize,
    /// Pixels with a code that differs at all.
    pub(super) differing: usize,
    /// The largest difference of a code.
    pub(super) largest: u32,
    #[serde(skip)]
    pub(super) mask: Mask,
    /// The largest difference of the codes of each pixel.
    #[serde(skip)]
    differences: Vec<u16>,
    /// The last code.
    #[serde(skip)]
    last: f64,
}

impl CodeDifference {
    /// The largest difference of the codes of each pixel, from 0 to 1.
    pub(super) fn normalised(&self) -> impl Iterator<Item = f64> {
        self.differences.iter().map(|code| f64::from(*code) / self.last)
    }
}

/// Compares the codes of two images exactly; `None` if both have floating-point numbers. Codes that
/// differ by at most `limit` count as equal.
pub(super) fn codes(ours: &Input, reference: &Input, limit: u32) -> Result<Option<CodeDifference>, String> {
    match (ours.codes, reference.codes) {
        (ours, reference) if ours.is_float() && reference.is_float() => return Ok(None),
        (kind, reference) if reference.is_float() => {
            return Err(mixed(
                "ours has",
                kind,
                "the reference has floating-point numbers",
            ));
        }
        (ours, kind) if ours.is_float() => {
            return Err(mixed(
                "the reference has",
                kind,
                "ours has floating-point numbers",
            ));
        }
        (ours, reference) if ours != reference => {
            return Err(format!("ours has {ours}, and the reference has {reference}"));
        }
        _ => {}
    }
    let last = if ours.codes == Codes::Bits8 {
        255.0
    } else {
        65535.0
    };
    let names = ["R", "G", "B", "A"];
    let [mine, theirs] = [ours, reference].map(|input| -> Vec<&[f32]> {
        names
            .into_iter()
            .filter_map(|name| input.image.channel(name))
            .collect()
    });
    if mine.len() != theirs.len() {
        return Err("only one of the images has alpha".to_owned());
    }
    let [width, height] = [ours.image.width(), ours.image.height()];
    if [width, height] != [reference.image.width(), reference.image.height()] {
        // The sizes are reported by the comparison.
        return Ok(None);
    }
    let code = |value: f32| (value * last + 0.5) as u16;
    let mut differences = vec![0; width * height];
    differences
        .par_chunks_mut(width)
        .enumerate()
        .for_each(|(y, out)| {
            let row = y * width..(y + 1) * width;
            for (mine, theirs) in mine.iter().zip(&theirs) {
                let (mine, theirs) = (&mine[row.clone()], &theirs[row.clone()]);
                if mine != theirs {
                    for ((out, mine), theirs) in out.iter_mut().zip(mine).zip(theirs) {
                        *out = (*out).max(code(*mine).abs_diff(code(*theirs)));
                    }
                }
            }
        });
    let mask = Mask::from_rows(width, height, |y, flags| {
        let row = &differences[y * width..];
        flags
            .iter_mut()
            .zip(row)
            .for_each(|(flag, code)| *flag = u32::from(*code) > limit);
    });
    Ok(Some(CodeDifference {
        kind: ours.codes.to_string(),
        pixels: mask.count(),
        differing: differences.iter().filter(|difference| **difference > 0).count(),
        largest: differences.iter().copied().max().map_or(0, u32::from),
        mask,
        differences,
        last: f64::from(last),
    }))
}

fn mixed(side: &str, kind: Codes, other: &str) -> String {
    format!("{side} {kind}, and {other}: they cannot be compared, since codes are rounded and clipped")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn input(values: &[[f32; 3]], codes: Option<Codes>) -> Input {
        let image = Image::from_rgb(values.len(), 1, values).unwrap();
        Input {
            image,
            codes: codes.unwrap_or(Codes::Float),
            transfer: Transfer::Linear,
        }
    }

    #[test]
    fn codes_are_compared_exactly() {
        let of = |codes: &[u8]| {
            let values: Vec<[f32; 3]> = codes.iter().map(|code| [f32::from(*code) / 255.0; 3]).collect();
            input(&values, Some(Codes::Bits8))
        };
        let all: Vec<u8> = (0..=254).collect();
        let next: Vec<u8> = (1..=255).collect();
        let found = codes(&of(&all), &of(&next), 0).unwrap().unwrap();
        assert_eq!((found.pixels, found.largest), (255, 1));
        let found = codes(&of(&all), &of(&next), 1).unwrap().unwrap();
        assert_eq!((found.pixels, found.differing), (0, 255));
        assert_eq!(codes(&of(&all), &of(&all), 0).unwrap().unwrap().differing, 0);
    }

    #[test]
    fn codes_and_floats_are_not_mixed() {
        let one = [[0.5; 3]];
        let eight = input(&one, Some(Codes::Bits8));
        let sixteen = input(&one, Some(Codes::Bits16));
        let float = input(&one, None);
        assert_eq!(codes(&float, &float, 0), Ok(None));
        assert!(
            codes(&eight, &float, 0)
                .unwrap_err()
                .contains("cannot be compared")
        );
        assert!(
            codes(&float, &eight, 0)
                .unwrap_err()
                .contains("the reference has 8-bit")
        );
        assert!(codes(&eight, &sixteen, 0).unwrap_err().contains("16-bit"));
    }

    #[test]
    fn a_layer_is_chosen_by_its_name_or_one_of_its_channels() {
        let mut image = Image::new(1, 1).unwrap();
        for (value, name) in ["Beauty.R", "Beauty.G", "Beauty.B", "Depth.Z"]
            .into_iter()
            .enumerate()
        {
            image.add_channel(name, vec![value as f32]).unwrap();
        }
        for (layer, expected) in [
            ("Beauty", [0.0, 1.0, 2.0]),
            ("Beauty.R", [0.0, 1.0, 2.0]),
            ("Depth.Z", [3.0; 3]),
        ] {
            let mut image = image.clone();
            choose(&mut image, layer).unwrap();
            assert_eq!(image.rgb().unwrap().map(|plane| plane[0]), expected, "{layer}");
        }
        let error = choose(&mut image, "Dept.Z").unwrap_err();
        assert!(error.contains("did you mean Depth.Z?"), "{error}");
    }
}
