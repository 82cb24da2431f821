//! The section of docs/comparisons.md on textures synthesised from a sample: the choices of
//! `synthesized`, measured against the statistics of the sample.

use crate::readme::of_text_in;
use std::fmt::Write as _;
use whitstone::Failure;
use whitstone::core::Registry;
use whitstone::image::{Limits, texels};
use whitstone::render::RenderOptions;

/// The sample, in the folder of the scenes' assets.
const SAMPLE: &str = "stones.png";

/// Width and height of the images in texels.
const SIDE: u32 = 96;

/// The choices: their names, and the value of `optimize`.
const CHOICES: [(&str, &str); 7] = [
    ("quilt", ""),
    ("least squares, 16", "{}"),
    ("least squares, 32, 16, 8", "{ neighborhoods = [32, 16, 8] }"),
    (
        "least squares, 32, 16, 8, three resolutions",
        "{ neighborhoods = [32, 16, 8], resolutions = 3 }",
    ),
    ("robust, 16", "{ robust = true }"),
    (
        "robust, 32, 16, 8",
        "{ neighborhoods = [32, 16, 8], robust = true }",
    ),
    (
        "robust, 32, 16, 8, three resolutions",
        "{ neighborhoods = [32, 16, 8], resolutions = 3, robust = true }",
    ),
];

/// Sides of the neighbourhoods that are compared with the sample.
const SIDES: [usize; 2] = [8, 16];

/// The section.
pub(crate) fn section(registry: &Registry) -> Result<String, Failure> {
    let mut text = format!(
        "\n## Textures synthesised from a sample\n\n\
         Images of {SIDE} x {SIDE} texels by the texture [`synthesized`](plugins/textures/synthesized.md) from\n\
         `{SAMPLE}`, which has 48 x 48. *Histogram* is the earth mover's distance of the histograms of\n\
         image and sample, in 8-bit codes, the mean of the channels. *Edges* is the mean difference of\n\
         adjacent texels, as a part of that of the sample. *Energy* is that of Kwatra et al. 2005, for\n\
         neighbourhoods of 8 x 8 or 16 x 16 texels a quarter of a side apart: the error to the nearest piece\n\
         of the sample to the power of 0.8, per texel; seams and blur raise it. The quilt is made of pieces\n\
         of the sample, so its histogram is close, but its seams show. Plain least squares with one size of\n\
         neighbourhoods blur, and change the histogram. Several sizes at three resolutions keep it, and\n\
         robust weights lower the energy further.\n\n\
         | choice | histogram | edges | energy, 8 x 8 | energy, 16 x 16 |\n|---|---|---|---|---|\n"
    );
    for (name, optimize) in CHOICES {
        let Quality {
            histogram,
            edges,
            energies: [small, large],
        } = measure(registry, optimize)?;
        let _ = writeln!(
            text,
            "| {name} | {histogram:.2} | {:.0} % | {small:.2} | {large:.2} |",
            100.0 * edges
        );
    }
    Ok(text)
}

/// An image compared with the sample.
struct Quality {
    /// Earth mover's distance of the histograms in codes, the mean of the channels.
    histogram: f64,
    /// Mean difference of adjacent texels, relative to the sample.
    edges: f64,
    /// By side of the neighbourhoods: their errors to the power of 0.8, per texel.
    energies: [f64; 2],
}

/// Width and codes, the top row first.
struct Codes {
    width: usize,
    data: Vec<[u8; 3]>,
}

fn measure(registry: &Registry, optimize: &str) -> Result<Quality, Failure> {
    let folder = crate::root().join("scenes/assets");
    let optimize = match optimize {
        "" => String::new(),
        how => format!(", optimize = {how}"),
    };
    // One pixel for each texel.
    let scene = format!(
        "[film]\nwidth = {SIDE}\nheight = {SIDE}\n[camera]\ntype = \"orthographic\"\n\
         window = {{ l = -1, r = 1, b = -1, t = 1 }}\n\
         look_at = {{ origin = [0, 0, 5], target = [0, 0, 0] }}\n\
         [[shape]]\ntype = \"rectangle\"\nmaterial = {{ type = \"emissive\", radiance = {{ \
         type = \"synthesized\", file = \"{SAMPLE}\", size = [{SIDE}, {SIDE}], block = 12, overlap = 2, \
         seed = 5, filter = \"nearest\", color_space = \"linear\"{optimize} }} }}\n"
    );
    let film = of_text_in(registry, &scene, &folder)?.render(RenderOptions::default());
    let image = Codes {
        width: SIDE as usize,
        data: film
            .rgb
            .iter()
            .map(|rgb| rgb.map(|value| (255.0 * value).round() as u8))
            .collect(),
    };
    let read = texels::read(folder.join(SAMPLE), Limits::TEXTURE).map_err(Failure::environment)?;
    let code = |value: f32| (255.0 * value).round() as u8;
    let sample = Codes {
        width: read.width,
        data: read.data.iter().map(|texel| texel.map(code)).collect(),
    };
    Ok(Quality {
        histogram: histogram_distance(&image, &sample),
        edges: image.edges() / sample.edges(),
        energies: SIDES.map(|side| energy(&image, &sample, side)),
    })
}

impl Codes {
    fn height(&self) -> usize {
        self.data.len() / self.width
    }

    fn row(&self, x: usize, y: usize, length: usize) -> &[u8] {
        self.data[y * self.width + x..][..length].as_flattened()
    }

    /// For each channel and code, the share of texels up to this code.
    fn shares(&self) -> [[f64; 256]; 3] {
        [0, 1, 2].map(|channel| {
            let mut counts = [0.0; 256];
            self.data
                .iter()
                .for_each(|texel| counts[usize::from(texel[channel])] += 1.0);
            let mut sum = 0.0;
            counts.map(|count| {
                sum += count / self.data.len() as f64;
                sum
            })
        })
    }

    /// Mean difference of adjacent texels in codes, along rows and columns.
    fn edges(&self) -> f64 {
        let apart = |a: &[u8], b: &[u8]| -> (f64, usize) {
            let all = a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b)));
            (all.sum(), a.len())
        };
        let rows = (0..self.height()).map(|y| {
            let length = self.width - 1;
            apart(self.row(0, y, length), self.row(1, y, length))
        });
        let columns =
            (1..self.height()).map(|y| apart(self.row(0, y - 1, self.width), self.row(0, y, self.width)));
        let (sum, count) = rows
            .chain(columns)
            .fold((0.0, 0), |(sum, count), (more, texels)| {
                (sum + more, count + texels)
            });
        sum / count as f64
    }
}

fn histogram_distance(image: &Codes, sample: &Codes) -> f64 {
    let [a, b] = [image, sample].map(Codes::shares);
    let apart = a
        .as_flattened()
        .iter()
        .zip(b.as_flattened())
        .map(|(a, b)| (a - b).abs());
    apart.sum::<f64>() / 3.0
}

/// The mean over neighbourhoods, a quarter of a side apart, of the error to the power of 0.8, per
/// texel of a neighbourhood.
fn energy(image: &Codes, sample: &Codes, side: usize) -> f64 {
    let starts = |length: usize| (0..=length - side).step_by(side / 4);
    let (mut sum, mut count) = (0.0, 0.0);
    for y in starts(image.height()) {
        for x in starts(image.width) {
            let mut least = u64::MAX;
            for v in 0..=sample.height() - side {
                for u in 0..=sample.width - side {
                    let mut error = 0;
                    for j in 0..side {
                        let both = image.row(x, y + j, side).iter().zip(sample.row(u, v + j, side));
                        let row: u32 = both.map(|(a, b)| u32::from(a.abs_diff(*b)).pow(2)).sum();
                        error += u64::from(row);
                        if error >= least {
                            break;
                        }
                    }
                    least = least.min(error);
                }
            }
            sum += (least as f64).powf(0.4);
            count += 1.0;
        }
    }
    sum / count / (side * side) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_have_known_values() {
        let codes = |data: &[u8]| Codes {
            width: 2,
            data: data.iter().map(|code| [*code; 3]).collect(),
        };
        // One of four texels moves by 8 codes.
        let (a, b) = (codes(&[10, 20, 30, 40]), codes(&[40, 28, 30, 10]));
        assert!((histogram_distance(&a, &b) - 2.0).abs() < 1e-12);
        assert_eq!(histogram_distance(&a, &a), 0.0);
        // 10, 10, 20, 20 between neighbours.
        assert_eq!(a.edges(), 15.0);
    }

    #[test]
    fn robust_neighbourhood_levels_are_nearest_to_the_sample() {
        let registry = whitstone::registry();
        let all = CHOICES.map(|(_, optimize)| measure(&registry, optimize).unwrap());
        let [quilt, plain, _, _, robust, _, levels] = &all;
        for k in 0..SIDES.len() {
            let least = all
                .iter()
                .map(|quality| quality.energies[k])
                .fold(f64::MAX, f64::min);
            assert_eq!(levels.energies[k], least);
            assert!(levels.energies[k] < 0.6 * quilt.energies[k]);
        }
        // What plain least squares lose.
        assert!(2.0 * levels.histogram < plain.histogram);
        assert!(robust.histogram < plain.histogram && robust.edges > plain.edges);
    }
}
