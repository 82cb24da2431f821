//! The picture of docs/accelerators.md that shows the work of a ray in each accelerator.

use crate::backends;
use crate::diagrams::{GAP, grid};
use crate::labels::{self, LINE, PAPER, grouped};
use crate::readme::build;
use std::path::Path;
use whitstone::Failure;
use whitstone::core::{FamilyName, Registry};
use whitstone::image::{Raster, ToneMap};
use whitstone::metrics::ColorMap;
use whitstone::render::RenderOptions;
use whitstone::view::heat::{self, Shown};

/// The scene.
const SCENE: &str = "studies/scenes/work.toml";
/// Tiles in a row.
const COLUMNS: usize = 3;
/// Colours from 1 to the largest number: few, so that areas of equal work have visible borders.
const COLORS: usize = 32;

/// The work in one accelerator.
struct Heat {
    name: &'static str,
    /// Steps and tests of the ray through each pixel.
    counts: Vec<f32>,
    mean: f64,
}

/// A tile for each built-in accelerator, by falling mean; below them the scene and the colours.
pub(crate) fn picture(registry: &Registry) -> Result<Raster, Failure> {
    let accelerators = registry
        .entries()
        .filter(|entry| entry.family == FamilyName::Accelerator && entry.crate_name != backends::CRATE);
    let heats: Result<Vec<Heat>, Failure> = accelerators.map(|entry| heat(registry, entry.name)).collect();
    let mut heats = heats?;
    heats.sort_by(|a, b| b.mean.total_cmp(&a.mean));
    let scene = build(registry, Path::new(SCENE), &[])?;
    let (width, height) = (scene.film.size.width as usize, scene.film.size.height as usize);
    let counts = heats.iter().flat_map(|heat| &heat.counts);
    let scale = Scale::new(counts.copied().fold(1.0, f32::max));
    let tile = |heat: &Heat| {
        let title = format!("{}: {}", heat.name, mean(heat.mean));
        let colors = Raster::from_fn(width, height, |x, y| scale.color(heat.counts[y * width + x]));
        titled(&title, &colors)
    };
    let mut tiles: Vec<Raster> = heats.iter().map(tile).collect();
    let image = scene.render(RenderOptions::default());
    let image = image.to_image(&scene.scene_hash).map_err(Failure::usage)?;
    let image = Raster::preview(&image, ToneMap::default()).map_err(Failure::usage)?;
    let elements = scene.scene.accelerator.statistics().get("elements").copied();
    let title = format!(
        "the scene: {} elements",
        grouped(elements.unwrap_or_default() as u64)
    );
    tiles.push(titled(&title, &image));
    let legend_at = tiles.len();
    let mut all = grid(&tiles, COLUMNS);
    let place = |k: usize| [k % COLUMNS * (width + GAP), k / COLUMNS * (height + LINE + GAP)];
    scale.legend(&mut all, place(legend_at));
    Ok(all)
}

/// Counts the work of the rays through the centres of all pixels.
fn heat(registry: &Registry, name: &'static str) -> Result<Heat, Failure> {
    // Otherwise the work would depend on the processor.
    let width = if name == "bvh" { ", width = \"eight\"" } else { "" };
    let accelerator = format!("accelerator={{ type = \"{name}\"{width} }}");
    let pipeline = build(registry, Path::new(SCENE), &[accelerator])?;
    let count = |shown: Shown| {
        heat::numbers(&pipeline, shown, &|| true)
            .ok_or_else(|| Failure::usage(format!("the accelerator \"{name}\" does not count its work")))
    };
    let (steps, tests) = (count(Shown::Steps)?, count(Shown::Tests)?);
    let counts: Vec<f32> = steps
        .iter()
        .zip(tests)
        .map(|(steps, tests)| steps + tests)
        .collect();
    let mean = counts.iter().copied().map(f64::from).sum::<f64>() / counts.len() as f64;
    Ok(Heat { name, counts, mean })
}

/// A mean with a digit after the point if it is small.
fn mean(value: f64) -> String {
    match value < 100.0 {
        true => format!("{value:.1}"),
        false => grouped(value.round() as u64),
    }
}

/// A picture below its title.
fn titled(title: &str, picture: &Raster) -> Raster {
    let mut titled = Raster::filled(picture.width(), picture.height() + LINE, PAPER);
    labels::write(&mut titled, title, [2, 0]);
    titled.draw(picture, 0, LINE);
    titled
}

/// Logarithmic colours.
struct Scale {
    table: [[u8; 3]; 256],
    /// The largest number.
    most: f64,
}

impl Scale {
    fn new(most: f32) -> Self {
        Self {
            table: ColorMap::Turbo.table(),
            most: f64::from(most),
        }
    }

    /// The place of a number from 0 to 1.
    fn part(&self, number: f64) -> f64 {
        (number.max(1.0).ln() / self.most.ln()).min(1.0)
    }

    fn color(&self, number: f32) -> [u8; 3] {
        let color = (self.part(f64::from(number)) * COLORS as f64)
            .floor()
            .min(COLORS as f64 - 1.0);
        self.table[(color * 255.0 / (COLORS as f64 - 1.0)) as usize]
    }

    /// Draws the colours with their numbers, and what they mean.
    fn legend(&self, picture: &mut Raster, [left, top]: [usize; 2]) {
        const WIDTH: usize = 480;
        const HEIGHT: usize = 18;
        let lines = [
            "Colour: work of the ray through the pixel, that is",
            "steps (inner nodes or cells that it visits)",
            "+ tests (elements that it is tested with).",
            "Above each picture: the mean over its pixels.",
        ];
        let (left, mut top) = (left + 20, top + 2 * LINE);
        for line in lines {
            labels::write(picture, line, [left, top]);
            top += LINE;
        }
        top += LINE / 2;
        let bar = Raster::from_fn(WIDTH, HEIGHT, |x, _| {
            self.color(self.most.powf((x as f64 + 0.5) / WIDTH as f64) as f32)
        });
        picture.draw(&bar, left, top);
        let powers = (0..)
            .map(|power| 10f64.powi(power))
            .take_while(|&number| number <= self.most);
        for number in powers {
            let x = left + (self.part(number) * WIDTH as f64) as usize;
            picture.draw(&Raster::filled(1, 6, [0; 3]), x, top + HEIGHT);
            let text = grouped(number as u64);
            let start = x.saturating_sub(labels::width(&text) / 2).max(left);
            labels::write(picture, &text, [start, top + HEIGHT + 5]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_logarithmic_and_end_with_the_largest_number() {
        let scale = Scale::new(1e4);
        assert_eq!(
            [1.0, 10.0, 100.0, 1e4, 1e9].map(|number| scale.part(number)),
            [0.0, 0.25, 0.5, 1.0, 1.0]
        );
        assert_eq!(scale.color(0.0), scale.table[0]);
        assert_eq!(scale.color(1.0), scale.table[0]);
        assert_eq!(scale.color(1e4), scale.table[255]);
        assert_ne!(scale.color(90.0), scale.color(140.0));
    }
}
