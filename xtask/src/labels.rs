//! Lines of text in generated pictures.

use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};
use whitstone::image::Raster;

/// Height of a line of text, in pixels.
pub(crate) const LINE: usize = 20;
/// Height of the letters, with room above and below in the line.
const SIZE: RasterHeight = RasterHeight::Size16;
/// Colour of pictures behind text, and of text.
pub(crate) const PAPER: [u8; 3] = [255; 3];
const INK: [u8; 3] = [25; 3];

/// Width of a text in pixels.
pub(crate) fn width(text: &str) -> usize {
    text.chars().count() * get_raster_width(FontWeight::Regular, SIZE)
}

/// Writes a line with its top left corner at `(x, y)`. Characters outside ASCII are blank.
pub(crate) fn write(picture: &mut Raster, text: &str, [x, y]: [usize; 2]) {
    let top = y + (LINE - SIZE.val()) / 2;
    for (place, character) in text.chars().enumerate() {
        let Some(glyph) = get_raster(character, FontWeight::Regular, SIZE) else {
            continue;
        };
        let left = x + place * glyph.width();
        for (row, covers) in glyph.raster().iter().enumerate() {
            for (column, &cover) in covers.iter().enumerate() {
                let (x, y) = (left + column, top + row);
                let Some(below) = picture.pixel(x, y) else {
                    continue;
                };
                let mix = |i: usize| {
                    let (ink, below, cover) = (i32::from(INK[i]), i32::from(below[i]), i32::from(cover));
                    (below + (ink - below) * cover / 255) as u8
                };
                picture.set(x, y, [0, 1, 2].map(mix));
            }
        }
    }
}

/// A whole number with its thousands apart: `12,345`.
pub(crate) fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut grouped = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            grouped.push(',');
        }
        grouped.push(digit);
    }
    grouped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_as_wide_as_it_says() {
        for text in ["H", "HHH", "brute_force: 12"] {
            let mut picture = Raster::filled(200, LINE, PAPER);
            write(&mut picture, text, [0, 0]);
            let dark = |x: usize| (0..LINE).any(|y| picture.pixel(x, y) != Some(PAPER));
            let last = (0..200).rev().find(|&x| dark(x)).unwrap();
            assert!(last < width(text) && last + 3 > width(text), "{text}: {last}");
        }
    }

    #[test]
    fn thousands_are_apart() {
        let found = [0, 999, 1000, 12_345, 1_234_567].map(grouped);
        assert_eq!(found, ["0", "999", "1,000", "12,345", "1,234,567"]);
    }
}
