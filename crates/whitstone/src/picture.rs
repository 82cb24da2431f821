//! Pictures for people: the samplers of `--quality`, tone curves, and images in the terminal.

use crate::commands::finite;
use crate::terminal::{Failure, trusted};
use clap::{Args, ValueEnum};
use std::fmt::Write;
use std::path::Path;
use whitstone_image::{Image, Raster, ToneCurve, ToneMap};

/// How a command shows an image.
#[derive(Args, Clone, Debug)]
#[group(skip)]
pub struct View {
    /// Exposure of the PNG file and of --preview, in stops: 1 doubles all values [default: 0]
    #[arg(long, value_name = "STOPS", allow_negative_numbers = true, value_parser = finite)]
    exposure: Option<f64>,
    /// How the PNG file and --preview show values after the exposure, before these are encoded as
    /// sRGB [default: clamp]
    #[arg(long, value_name = "CURVE")]
    tone_map: Option<Curve>,
    /// Also draw the image in the terminal, with half blocks in 24-bit colour, at most as wide as
    /// the terminal (80 columns if the output is no terminal); small images are not enlarged
    #[arg(long)]
    pub preview: bool,
}

/// A tone curve on the command line.
#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
enum Curve {
    /// Values are kept, and those above 1 are white: equal pixels mean equal values
    Clamp,
    /// Bright values approach white slowly: Narkowicz's fit to the ACES curve (2016), with its
    /// factor of 0.6. Middle grey becomes darker; an exposure of 0.7 restores it
    Filmic,
}

impl View {
    /// Checks that the options have an effect and can be followed. `has_png`: whether the command
    /// writes a PNG file.
    pub fn check(&self, has_png: bool) -> Result<(), Failure> {
        for (option, is_given) in [
            ("--exposure", self.exposure.is_some()),
            ("--tone-map", self.tone_map.is_some()),
        ] {
            if is_given && !has_png && !self.preview {
                return Err(Failure::usage(format!(
                    "{option} changes only pictures: expected --png, -o FILE.png or --preview with it"
                )));
            }
        }
        if self.preview && std::env::var_os("NO_COLOR").is_some() {
            return Err(Failure::usage(
                "--preview draws in 24-bit colour, and NO_COLOR is set: unset it, or write a PNG file with --png",
            ));
        }
        Ok(())
    }

    fn tone(&self) -> ToneMap {
        ToneMap {
            exposure: self.exposure.unwrap_or_default(),
            curve: match self.tone_map {
                Some(Curve::Filmic) => ToneCurve::Filmic,
                Some(Curve::Clamp) | None => ToneCurve::Clamp,
            },
        }
    }

    /// Writes the PNG file, and draws the image in the terminal with `--preview`.
    pub fn show(&self, image: &Image, png: Option<&Path>) -> Result<(), Failure> {
        if png.is_none() && !self.preview {
            return Ok(());
        }
        let raster = Raster::preview(image, self.tone()).map_err(Failure::usage)?;
        if let Some(path) = png {
            raster.write_png(path).map_err(Failure::environment)?;
        }
        if self.preview {
            let columns = terminal_size::terminal_size().map_or(80, |(width, _)| usize::from(width.0));
            trusted(&half_blocks(&raster, columns));
        }
        Ok(())
    }
}

/// How many samples a picture has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Quality {
    /// One sample in the middle of each pixel: `type = "center"`
    Draft,
    /// 8 to 64 samples per pixel: `type = "adaptive", samples = 64, threshold = 0.02`
    Good,
    /// 16 to 1024 samples per pixel: `type = "adaptive", samples = 1024, initial_samples = 16,
    /// threshold = 0.005`
    Best,
}

impl Quality {
    /// The override of a scene that gives it the sampler of this quality.
    pub fn sampler(self) -> &'static str {
        match self {
            Self::Draft => "sampler={ type = \"center\" }",
            Self::Good => "sampler={ type = \"adaptive\", samples = 64, threshold = 0.02 }",
            Self::Best => {
                "sampler={ type = \"adaptive\", samples = 1024, initial_samples = 16, threshold = 0.005 }"
            }
        }
    }
}

/// The picture as lines of text, reduced to at most `columns` columns: each character cell shows
/// two pixels, as its upper half and its background, in 24-bit colour (SGR 38 and 48 of ISO
/// 8613-6). A last row without a partner has the terminal's own background.
fn half_blocks(picture: &Raster, columns: usize) -> String {
    let columns = columns.clamp(1, picture.width());
    let rows = (picture.height() * columns).div_ceil(picture.width());
    let picture = picture.reduced(columns, rows);
    let mut text = String::new();
    for y in (0..picture.height()).step_by(2) {
        for x in 0..picture.width() {
            let [r, g, b] = picture.pixel(x, y).unwrap_or_default();
            let _ = write!(text, "\u{1b}[38;2;{r};{g};{b}");
            if let Some([r, g, b]) = picture.pixel(x, y + 1) {
                let _ = write!(text, ";48;2;{r};{g};{b}");
            }
            text.push_str("m▀");
        }
        text.push_str("\u{1b}[0m\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_blocks_show_every_pixel_of_a_small_picture() {
        let picture = Raster::from_fn(2, 3, |x, y| [x as u8, y as u8, 8]);
        let expected = "\u{1b}[38;2;0;0;8;48;2;0;1;8m▀\u{1b}[38;2;1;0;8;48;2;1;1;8m▀\u{1b}[0m\n\
                        \u{1b}[38;2;0;2;8m▀\u{1b}[38;2;1;2;8m▀\u{1b}[0m\n";
        assert_eq!(half_blocks(&picture, 80), expected);
    }

    #[test]
    fn a_large_picture_is_as_wide_as_the_terminal() {
        for (width, height, columns, lines) in [(640, 360, 80, 23), (1, 9, 5, 5), (9, 1, 5, 1), (7, 5, 0, 1)]
        {
            let text = half_blocks(&Raster::filled(width, height, [9; 3]), columns);
            assert_eq!(text.lines().count(), lines, "{width} x {height}");
            let cells = columns.clamp(1, width);
            assert!(text.lines().all(|line| line.matches('▀').count() == cells));
        }
    }
}
