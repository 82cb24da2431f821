//! Pictures of the difference between an image and its reference.
//!
//! A map shows one number per pixel, for the channel (R, G, B) whose difference has the largest
//! magnitude: the difference itself, or the relative residual of [`metrics`](crate::metrics).
//! Values that are not finite on either side are [`NOT_FINITE`], a colour that is in no colour map.
//! The legend and [`ErrorView::scale`] always state the range; values outside it get the colour of
//! the nearer end.

use serde::Serialize;

use crate::metrics::{CompareError, Pair, relative_residual};
use whitstone_image::Image;
use whitstone_image::png::{NOT_FINITE, Raster};
use whitstone_image::tone::ToneMap;

/// The number that is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Quantity {
    /// ours - reference, in units of radiance.
    #[default]
    Difference,
    /// (ours - reference)/(|reference| + mean_reference).
    Relative,
}

impl Quantity {
    /// The caption of a picture of it.
    fn caption(self) -> &'static str {
        match self {
            Self::Difference => "DIFFERENCE",
            Self::Relative => "RELATIVE ERROR",
        }
    }
}

/// The mapping from numbers to colours.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Scale {
    /// The magnitude, linear from 0 to `max`: dark blue over green to dark red (Turbo).
    Absolute {
        /// Upper end, finite and > 0.
        max: f64,
    },
    /// With sign, linear from `-max` to `max`: blue where ours is darker, nearly white at 0, red
    /// where ours is brighter.
    Signed {
        /// Upper end, finite and > 0.
        max: f64,
    },
    /// The magnitude, logarithmic from `min` to `max`, in the colours of `Absolute`. Values below
    /// `min`, including 0, have the colour of `min`.
    Log {
        /// Lower end, finite and > 0.
        min: f64,
        /// Upper end, finite and > `min`.
        max: f64,
    },
}

impl Scale {
    /// The numbers at the left and right ends of the legend.
    #[must_use]
    pub fn ends(self) -> (f64, f64) {
        match self {
            Self::Absolute { max } => (0.0, max),
            Self::Signed { max } => (-max, max),
            Self::Log { min, max } => (min, max),
        }
    }

    /// The number in the middle of the legend.
    #[must_use]
    pub fn middle(self) -> f64 {
        match self {
            Self::Absolute { max } => max / 2.0,
            Self::Signed { .. } => 0.0,
            Self::Log { min, max } => min.sqrt() * max.sqrt(),
        }
    }

    /// The colour of a number; [`NOT_FINITE`] if it is not finite.
    #[must_use]
    pub fn color(self, value: f64) -> [u8; 3] {
        if !value.is_finite() {
            return NOT_FINITE;
        }
        self.color_at(match self {
            Self::Absolute { max } => value.abs() / max,
            Self::Signed { max } => 0.5 + 0.5 * (value / max).clamp(-1.0, 1.0),
            Self::Log { min, max } => libm::log(value.abs() / min) / libm::log(max / min),
        })
    }

    /// The colour at a fraction of the legend, 0 at the left end and 1 at the right.
    fn color_at(self, fraction: f64) -> [u8; 3] {
        let fraction = fraction.clamp(0.0, 1.0);
        let color = match self {
            // RdBu goes from red to blue.
            Self::Signed { .. } => colorous::RED_BLUE.eval_continuous(1.0 - fraction),
            Self::Absolute { .. } | Self::Log { .. } => colorous::TURBO.eval_continuous(fraction),
        };
        [color.r, color.g, color.b]
    }

    fn check(self) -> Result<(), CompareError> {
        let (min, max) = match self {
            Self::Absolute { max } | Self::Signed { max } => (None, max),
            Self::Log { min, max } => (Some(min), max),
        };
        let positive = |value: f64| value > 0.0 && value.is_finite();
        if !positive(max) {
            return Err(CompareError::Option {
                name: "max",
                range: "finite and > 0",
                value: max,
            });
        }
        match min {
            Some(value) if !(positive(value) && value < max) => Err(CompareError::Option {
                name: "min",
                range: "> 0 and < max",
                value,
            }),
            _ => Ok(()),
        }
    }
}

/// The contents of an error map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ErrorView {
    /// The number to show.
    pub quantity: Quantity,
    /// Its colours.
    pub scale: Scale,
}

impl Default for ErrorView {
    /// Relative residuals, logarithmic from 1e-6 to 1.
    fn default() -> Self {
        Self {
            quantity: Quantity::Relative,
            scale: Scale::Log { min: 1e-6, max: 1.0 },
        }
    }
}

/// The map, with one pixel per pixel of the images.
///
/// # Errors
/// [`CompareError`]: sizes, placements or channels that differ, a scale out of range.
pub fn error_map(ours: &Image, reference: &Image, view: ErrorView) -> Result<Raster, CompareError> {
    let pair = Pair::new(ours, reference)?;
    view.scale.check()?;
    let mean = pair.mean_reference();
    Ok(Raster::from_fn(pair.width, pair.height, |x, y| {
        view.scale
            .color(shown(&pair, y * pair.width + x, view.quantity, mean))
    }))
}

/// The number at a pixel; NaN if a value is not finite.
fn shown(pair: &Pair, index: usize, quantity: Quantity, mean: f64) -> f64 {
    pair.at(index)
        .into_iter()
        .fold(0.0, |shown: f64, (ours, reference)| {
            if !(ours.is_finite() && reference.is_finite()) {
                return f64::NAN;
            }
            let value = match quantity {
                Quantity::Difference => ours - reference,
                Quantity::Relative => relative_residual(ours, reference, mean),
            };
            // NaN is kept.
            if value.abs() > shown.abs() { value } else { shown }
        })
}

/// The differences ours - reference, as channels R, G, B rounded to `f32`, for an EXR file.
///
/// # Errors
/// [`CompareError`]: sizes, placements or channels that differ.
pub fn difference_image(ours: &Image, reference: &Image) -> Result<Image, CompareError> {
    let pair = Pair::new(ours, reference)?;
    let difference = |x: usize, y: usize| {
        pair.at(y * pair.width + x)
            .map(|(ours, reference)| (ours - reference) as f32)
    };
    let size = (pair.width, pair.height);
    // Two images of this size exist already.
    let mut image = Image::from_fn(pair.width, pair.height, difference).map_err(|_| CompareError::Size {
        ours: size,
        reference: size,
    })?;
    image.set_placement(ours.placement());
    Ok(image)
}

/// Height of a legend in pixels: the strip, its ticks and its numbers.
pub const LEGEND_HEIGHT: usize = STRIP_HEIGHT + TICK_HEIGHT + 2 + GLYPH_SCALE * GLYPH_HEIGHT + 2;

/// Height of a caption in pixels, with the space below it.
const CAPTION_HEIGHT: usize = GLYPH_SCALE * GLYPH_HEIGHT + 4;

const STRIP_HEIGHT: usize = 12;
const TICK_HEIGHT: usize = 4;
const GAP: usize = 8;
const BACKGROUND: [u8; 3] = [32, 32, 32];
const INK: [u8; 3] = [230, 230, 230];

/// A strip with all colours of a scale, and the numbers at its ends and (if there is room) in the
/// middle. `width` is at least 1; below about 60 pixels the numbers are cut off.
///
/// # Errors
/// [`CompareError::Option`]: a scale out of range.
pub fn legend(scale: Scale, width: usize) -> Result<Raster, CompareError> {
    scale.check()?;
    let mut raster = Raster::filled(width, LEGEND_HEIGHT, BACKGROUND);
    let width = raster.width();
    for x in 0..width {
        let color = scale.color_at(x as f64 / (width - 1).max(1) as f64);
        for y in 0..STRIP_HEIGHT {
            raster.set(x, y, color);
        }
    }
    let (low, high) = scale.ends();
    let (low, middle, high) = (number(low), number(scale.middle()), number(high));
    let mut label = |text: &str, tick: usize, left: usize| {
        for y in STRIP_HEIGHT..STRIP_HEIGHT + TICK_HEIGHT {
            raster.set(tick, y, INK);
        }
        write_text(&mut raster, text, left, STRIP_HEIGHT + TICK_HEIGHT + 2);
    };
    label(&low, 0, 0);
    label(&high, width - 1, width.saturating_sub(text_width(&high)));
    if text_width(&low) + text_width(&middle) + text_width(&high) + 4 * GAP <= width {
        label(&middle, width / 2, (width - text_width(&middle)) / 2);
    }
    Ok(raster)
}

/// The text below a panel, cut off at its width: of several words only the last one if there is no
/// room for all.
fn caption(text: &str, width: usize) -> Raster {
    let mut raster = Raster::filled(width, CAPTION_HEIGHT, BACKGROUND);
    let last = text.rsplit(' ').next().unwrap_or(text);
    let fitting = if text_width(text) > width { last } else { text };
    write_text(&mut raster, fitting, 0, 0);
    raster
}

/// Our image, the reference and the error map side by side, with the same exposure, with captions,
/// and with the legend below the map.
///
/// # Errors
/// [`CompareError`]: sizes, placements or channels that differ, a scale out of range.
pub fn trio(ours: &Image, reference: &Image, tone: ToneMap, view: ErrorView) -> Result<Raster, CompareError> {
    use crate::metrics::Side;
    let map = error_map(ours, reference, view)?;
    let preview =
        |image, side| Raster::preview(image, tone).map_err(|error| CompareError::Channel { side, error });
    let panels = [
        preview(ours, Side::Ours)?,
        preview(reference, Side::Reference)?,
        map,
    ];
    let (width, height) = (ours.width(), ours.height());
    let below = height + GAP;
    let mut picture = Raster::filled(
        3 * width + 2 * GAP,
        below + CAPTION_HEIGHT + LEGEND_HEIGHT,
        BACKGROUND,
    );
    let captions = ["OURS", "REFERENCE", view.quantity.caption()];
    for (index, (panel, text)) in panels.iter().zip(captions).enumerate() {
        let left = index * (width + GAP);
        picture.draw(panel, left, 0);
        picture.draw(&caption(text, width), left, below);
    }
    let legend = legend(view.scale, width)?;
    picture.draw(&legend, 2 * (width + GAP), below + CAPTION_HEIGHT);
    Ok(picture)
}

/// A number in its shortest form: `0`, `0.5`, `1e-6`.
fn number(value: f64) -> String {
    // Three digits are enough for a legend.
    let rounded: f64 = format!("{value:.2e}").parse().unwrap_or(value);
    let (plain, scientific) = (format!("{rounded}"), format!("{rounded:e}"));
    if plain.len() <= scientific.len() + 1 {
        plain
    } else {
        scientific
    }
}

const GLYPH_WIDTH: usize = 3;
const GLYPH_HEIGHT: usize = 5;
const GLYPH_SCALE: usize = 2;

/// Rows of a glyph from the top, three bits each; the left pixel is the highest bit. Only the
/// characters of numbers and of captions exist.
fn glyph(character: char) -> [u8; GLYPH_HEIGHT] {
    match character {
        '0' => [0b111, 0b101, 0b101, 0b101, 0b111],
        '1' => [0b010, 0b110, 0b010, 0b010, 0b111],
        '2' => [0b111, 0b001, 0b111, 0b100, 0b111],
        '3' => [0b111, 0b001, 0b111, 0b001, 0b111],
        '4' => [0b101, 0b101, 0b111, 0b001, 0b001],
        '5' => [0b111, 0b100, 0b111, 0b001, 0b111],
        '6' => [0b111, 0b100, 0b111, 0b101, 0b111],
        '7' => [0b111, 0b001, 0b001, 0b010, 0b010],
        '8' => [0b111, 0b101, 0b111, 0b101, 0b111],
        '9' => [0b111, 0b101, 0b111, 0b001, 0b111],
        '.' => [0, 0, 0, 0, 0b010],
        '-' => [0, 0, 0b111, 0, 0],
        'e' => [0, 0b010, 0b111, 0b100, 0b011],
        'A' => [0b010, 0b101, 0b111, 0b101, 0b101],
        'C' => [0b011, 0b100, 0b100, 0b100, 0b011],
        'D' => [0b110, 0b101, 0b101, 0b101, 0b110],
        'E' => [0b111, 0b100, 0b110, 0b100, 0b111],
        'F' => [0b111, 0b100, 0b110, 0b100, 0b100],
        'I' => [0b111, 0b010, 0b010, 0b010, 0b111],
        'L' => [0b100, 0b100, 0b100, 0b100, 0b111],
        'N' => [0b110, 0b101, 0b101, 0b101, 0b101],
        'O' => [0b010, 0b101, 0b101, 0b101, 0b010],
        'R' => [0b110, 0b101, 0b110, 0b101, 0b101],
        'S' => [0b011, 0b100, 0b010, 0b001, 0b110],
        'T' => [0b111, 0b010, 0b010, 0b010, 0b010],
        'U' => [0b101, 0b101, 0b101, 0b101, 0b111],
        'V' => [0b101, 0b101, 0b101, 0b101, 0b010],
        _ => [0; GLYPH_HEIGHT],
    }
}

fn text_width(text: &str) -> usize {
    text.chars().count() * GLYPH_SCALE * (GLYPH_WIDTH + 1)
}

fn write_text(raster: &mut Raster, text: &str, left: usize, top: usize) {
    for (place, character) in text.chars().enumerate() {
        for (row, bits) in glyph(character).into_iter().enumerate() {
            for column in (0..GLYPH_WIDTH).filter(|column| bits >> (GLYPH_WIDTH - 1 - column) & 1 == 1) {
                let x = left + GLYPH_SCALE * (place * (GLYPH_WIDTH + 1) + column);
                raster.draw(
                    &Raster::filled(GLYPH_SCALE, GLYPH_SCALE, INK),
                    x,
                    top + GLYPH_SCALE * row,
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(value: [f32; 3]) -> Image {
        Image::from_fn(3, 2, |_, _| value).unwrap()
    }

    #[test]
    fn colours_at_the_ends_and_beyond() {
        let turbo = |t| {
            let color = colorous::TURBO.eval_continuous(t);
            [color.r, color.g, color.b]
        };
        let absolute = Scale::Absolute { max: 2.0 };
        assert_eq!(
            [0.0, -1.0, 1.0, 2.0, 9.0].map(|v| absolute.color(v)),
            [0.0, 0.5, 0.5, 1.0, 1.0].map(turbo)
        );
        let log = Scale::Log { min: 1e-4, max: 1.0 };
        assert_eq!(
            [0.0, 1e-9, 1e-4, 1.0, 5.0].map(|v| log.color(v)),
            [0.0, 0.0, 0.0, 1.0, 1.0].map(turbo)
        );
        let close = |a: [u8; 3], b: [u8; 3]| a.iter().zip(b).all(|(a, b)| a.abs_diff(b) <= 1);
        assert!(close(log.color(-1e-2), turbo(0.5)));

        let signed = Scale::Signed { max: 0.5 };
        let [r, _, b] = signed.color(0.4);
        assert!(r > b, "ours brighter is red");
        let [r, _, b] = signed.color(-0.4);
        assert!(b > r, "ours darker is blue");
        assert!(
            signed.color(0.0).iter().all(|&c| c > 230),
            "no difference is white: {:?}",
            signed.color(0.0)
        );
        assert_eq!(signed.color(7.0), signed.color(0.5));
    }

    #[test]
    fn magenta_is_in_no_colour_map_and_marks_values_that_are_not_finite() {
        for scale in [Scale::Absolute { max: 1.0 }, Scale::Signed { max: 1.0 }] {
            for step in 0..=1000 {
                let [r, g, b] = scale.color_at(f64::from(step) / 1000.0);
                assert!(
                    !(r > 200 && g < 80 && b > 200),
                    "{scale:?} at {step}: {r} {g} {b}"
                );
            }
        }
        let good = flat([1.0; 3]);
        for bad in [f32::NAN, f32::INFINITY] {
            for (ours, reference) in [
                (flat([bad, 1.0, 1.0]), good.clone()),
                (good.clone(), flat([1.0, 1.0, bad])),
            ] {
                let map = error_map(&ours, &reference, ErrorView::default()).unwrap();
                assert!(map.pixels().iter().all(|&pixel| pixel == NOT_FINITE));
            }
        }
    }

    #[test]
    fn the_channel_with_the_largest_difference_is_shown() {
        let (ours, reference) = (flat([1.25, 0.0, 2.0]), flat([1.0, 0.5, 2.0]));
        let view = ErrorView {
            quantity: Quantity::Difference,
            scale: Scale::Signed { max: 1.0 },
        };
        let map = error_map(&ours, &reference, view).unwrap();
        assert_eq!((map.width(), map.height()), (3, 2));
        assert_eq!(map.pixel(2, 1).unwrap(), view.scale.color(-0.5));
        let view = ErrorView {
            quantity: Quantity::Relative,
            ..view
        };
        // The mean of the reference is 3.5/3.
        let map = error_map(&ours, &reference, view).unwrap();
        assert_eq!(
            map.pixel(0, 0).unwrap(),
            view.scale.color(-0.5 / (0.5 + 3.5 / 3.0))
        );
    }

    #[test]
    fn differences_are_exported_as_an_image() {
        let image = difference_image(&flat([1.25, 0.0, 2.0]), &flat([1.0, 0.5, 2.0])).unwrap();
        assert_eq!(image.rgb().unwrap().map(|plane| plane[5]), [0.25, -0.5, 0.0]);
    }

    #[test]
    fn scales_out_of_range_are_rejected() {
        let image = flat([1.0; 3]);
        for scale in [
            Scale::Absolute { max: 0.0 },
            Scale::Signed { max: f64::NAN },
            Scale::Absolute { max: f64::INFINITY },
            Scale::Log { min: 0.0, max: 1.0 },
            Scale::Log { min: 1.0, max: 1.0 },
        ] {
            let view = ErrorView {
                quantity: Quantity::Difference,
                scale,
            };
            assert!(
                matches!(error_map(&image, &image, view), Err(CompareError::Option { .. })),
                "{scale:?}"
            );
            assert!(legend(scale, 100).is_err());
        }
    }

    #[test]
    fn numbers_are_short() {
        let shown = [0.0, 0.5, -1.0, 1e-6, 1e-3, 100.0, 12345.678, 1.0 / 3.0, -2.5e-10].map(number);
        assert_eq!(
            shown,
            [
                "0", "0.5", "-1", "1e-6", "0.001", "100", "12300", "0.333", "-2.5e-10"
            ]
        );
        // Each has a glyph.
        assert!(
            shown
                .concat()
                .chars()
                .all(|character| glyph(character) != [0; GLYPH_HEIGHT])
        );
    }

    #[test]
    fn captions_have_glyphs_and_stay_below_their_panels() {
        for quantity in [Quantity::Difference, Quantity::Relative] {
            for text in ["OURS", "REFERENCE", quantity.caption()] {
                let letters = text.chars().filter(|letter| *letter != ' ');
                assert!(
                    letters.clone().all(|letter| glyph(letter) != [0; GLYPH_HEIGHT]),
                    "{text}"
                );
            }
        }
        let wide = Image::from_fn(120, 2, |_, _| [0.0; 3]).unwrap();
        let picture = trio(&wide, &wide, ToneMap::default(), ErrorView::default()).unwrap();
        let ink = |columns: std::ops::Range<usize>| {
            let rows = 2 + GAP..2 + GAP + CAPTION_HEIGHT;
            let pixels = rows.flat_map(|y| columns.clone().map(move |x| (x, y)));
            pixels.filter(|&(x, y)| picture.pixel(x, y) == Some(INK)).count()
        };
        let panels = [0, 1, 2].map(|panel| ink(panel * (120 + GAP)..panel * (120 + GAP) + 120));
        assert!(panels.iter().all(|count| *count > 50), "{panels:?}");
        assert!(panels.is_sorted(), "{panels:?}");
        assert_eq!(ink(120..120 + GAP), 0);
    }

    #[test]
    fn a_legend_has_all_colours_and_its_numbers() {
        let scale = Scale::Log { min: 1e-6, max: 1.0 };
        let strip = legend(scale, 200).unwrap();
        assert_eq!((strip.width(), strip.height()), (200, LEGEND_HEIGHT));
        assert_eq!(strip.pixel(0, 0).unwrap(), scale.color(1e-6));
        assert_eq!(strip.pixel(199, 0).unwrap(), scale.color(1.0));
        let ink = |raster: &Raster| raster.pixels().iter().filter(|&&pixel| pixel == INK).count();
        assert!(ink(&strip) > 100);
        // There is no room for the middle number.
        assert!(ink(&legend(scale, 70).unwrap()) < ink(&strip));
        assert_eq!(legend(scale, 0).unwrap().width(), 1);
    }

    #[test]
    fn three_panels_in_order() {
        let (ours, reference) = (flat([1.0, 0.0, 0.0]), flat([0.0, 1.0, 0.0]));
        let view = ErrorView {
            quantity: Quantity::Difference,
            scale: Scale::Absolute { max: 1.0 },
        };
        let picture = trio(&ours, &reference, ToneMap::default(), view).unwrap();
        assert_eq!(
            (picture.width(), picture.height()),
            (3 * 3 + 2 * GAP, 2 + GAP + CAPTION_HEIGHT + LEGEND_HEIGHT)
        );
        assert_eq!(picture.pixel(0, 0).unwrap(), [255, 0, 0]);
        assert_eq!(picture.pixel(3, 0).unwrap(), BACKGROUND);
        assert_eq!(picture.pixel(3 + GAP, 0).unwrap(), [0, 255, 0]);
        assert_eq!(picture.pixel(2 * (3 + GAP), 1).unwrap(), view.scale.color(1.0));
        let other = Image::from_fn(2, 2, |_, _| [0.0; 3]).unwrap();
        assert!(matches!(
            trio(&ours, &other, ToneMap::default(), view),
            Err(CompareError::Size { .. })
        ));
    }
}
