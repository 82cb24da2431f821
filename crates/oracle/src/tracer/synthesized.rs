//! Texture synthesis by image quilting: section 10 of the model.

use super::mapping::MappingConfig;
use super::pattern::{Codes, Lookup, Pair, Picture};
use super::wrap::Wraps;
use crate::shapes::heightfield::m;
use serde::Deserialize;
use whitstone_core::config::FilePath;
use whitstone_scene::Sources;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SynthesizedConfig {
    file: FilePath,
    size: [usize; 2],
    block: Option<usize>,
    overlap: Option<usize>,
    tolerance: Option<f64>,
    #[serde(default)]
    seed: u32,
    optimize: Option<Optimize>,
    filter: Option<String>,
    #[serde(default)]
    wrap: Wraps,
    color_space: Option<String>,
    scale: Option<Pair>,
    offset: Option<Pair>,
    max_anisotropy: Option<f64>,
    pub(super) mapping: Option<MappingConfig>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Optimize {
    neighborhood: Option<usize>,
    neighborhoods: Option<Vec<usize>>,
    resolutions: Option<u32>,
    #[serde(default)]
    robust: bool,
    iterations: Option<u32>,
}

type Texel = [f64; 3];

pub(super) fn synthesized(config: &SynthesizedConfig, sources: &Sources) -> Result<Picture, String> {
    let sample = Codes::read(&config.file, sources)?;
    let lookup = Lookup {
        filter: config.filter.as_deref(),
        max_anisotropy: config.max_anisotropy,
        wrap: config.wrap.each(),
        scale: config.scale,
        offset: config.offset,
    };
    let quilted = Codes {
        size: config.size,
        values: quilted(config, &sample),
        most: sample.most,
    };
    let quilted = match &config.optimize {
        None => quilted,
        Some(how) => optimized(quilted, &sample, how),
    };
    Picture::of(&quilted, config.color_space.as_deref(), &lookup)
}

fn quilted(config: &SynthesizedConfig, sample: &Codes) -> Vec<Texel> {
    let block = config.block.unwrap_or(16);
    let overlap = config.overlap.unwrap_or((block / 4).max(1));
    let step = block - overlap;
    let count = |side: usize| 1 + side.saturating_sub(block).div_ceil(step);
    let [columns, rows] = config.size.map(count);
    let width = (columns - 1) * step + block;
    let height = (rows - 1) * step + block;
    let mut canvas = vec![[0.0; 3]; width * height];
    for r in 0..rows {
        for c in 0..columns {
            let corner = [c * step, r * step];
            let at = |i: usize, j: usize| (corner[1] + j) * width + corner[0] + i;
            let piece =
                |[x, y]: [usize; 2], i: usize, j: usize| sample.values[(y + j) * sample.size[0] + x + i];
            let in_overlap = |i: usize, j: usize| (c > 0 && i < overlap) || (r > 0 && j < overlap);
            let places = || (0..block).flat_map(|j| (0..block).map(move |i| (i, j)));
            let shared: Vec<(usize, usize)> = places().filter(|(i, j)| in_overlap(*i, *j)).collect();
            let [w, h] = sample.size;
            let pieces = (0..=h - block).flat_map(|y| (0..=w - block).map(move |x| [x, y]));
            let errors: Vec<([usize; 2], f64)> = pieces
                .map(|place| {
                    let errors = shared
                        .iter()
                        .map(|(i, j)| difference(piece(place, *i, *j), canvas[at(*i, *j)]));
                    (place, errors.sum())
                })
                .collect();
            let some = errors
                .iter()
                .map(|(_, error)| *error)
                .filter(|error| *error > 0.0);
            let least = some.fold(f64::INFINITY, f64::min);
            let least = if least.is_finite() { least } else { 0.0 };
            let most = least * (1.0 + config.tolerance.unwrap_or(0.1));
            let candidates: Vec<[usize; 2]> = errors
                .iter()
                .filter(|(_, error)| *error <= most)
                .map(|(place, _)| *place)
                .collect();
            let number = m(m(m(config.seed).wrapping_add(r as u32)).wrapping_add(c as u32));
            let chosen = candidates[number as usize % candidates.len()];
            let apart = |i: usize, j: usize| difference(piece(chosen, i, j), canvas[at(i, j)]);
            let left = (c > 0).then(|| seam(block, overlap, &|across, along| apart(across, along)));
            let top = (r > 0).then(|| seam(block, overlap, &|across, along| apart(along, across)));
            for (i, j) in places() {
                let kept = left.as_ref().is_some_and(|seam| i < seam[j])
                    || top.as_ref().is_some_and(|seam| j < seam[i]);
                if !kept {
                    canvas[at(i, j)] = piece(chosen, i, j);
                }
            }
        }
    }
    let [w, h] = config.size;
    (0..h)
        .flat_map(|j| canvas[j * width..j * width + w].to_vec())
        .collect()
}

/// The image after all iterations at all resolutions.
fn optimized(quilted: Codes, sample: &Codes, how: &Optimize) -> Codes {
    let sides = match &how.neighborhoods {
        Some(sides) => sides.clone(),
        None => vec![how.neighborhood.unwrap_or(16)],
    };
    let fitting = |picture: &Codes, sample: &Codes| -> Vec<usize> {
        let fits = |side: &&usize| picture.size.iter().chain(&sample.size).all(|n| n >= *side);
        sides.iter().filter(fits).copied().collect()
    };
    let coarser = how.resolutions.unwrap_or(1) - 1;
    let at = |codes: &Codes, resolution: u32| (0..resolution).fold(codes.clone(), |codes, _| halved(&codes));
    let mut picture = at(&quilted, coarser);
    for resolution in (0..=coarser).rev() {
        let sample = at(sample, resolution);
        for side in fitting(&picture, &sample) {
            for _ in 0..how.iterations.unwrap_or(4) {
                picture = nearer(&picture, &sample, side, how.robust);
            }
        }
        if resolution > 0 {
            let [w, h] = quilted.size.map(|n| n >> (resolution - 1));
            let from = |i: usize, j: usize| {
                let [x, y] = [(i / 2).min(picture.size[0] - 1), (j / 2).min(picture.size[1] - 1)];
                picture.values[y * picture.size[0] + x]
            };
            let values = (0..h).flat_map(|j| (0..w).map(move |i| (i, j)));
            picture = Codes {
                size: [w, h],
                values: values.map(|(i, j)| from(i, j)).collect(),
                most: picture.most,
            };
        }
    }
    picture
}

/// The next coarser resolution.
fn halved(fine: &Codes) -> Codes {
    let [w, h] = fine.size.map(|n| n / 2);
    let mean = |i: usize, j: usize| {
        [0, 1, 2].map(|c| {
            let code = |a: usize, b: usize| fine.values[(2 * j + b) * fine.size[0] + 2 * i + a][c];
            ((code(0, 0) + code(1, 0) + code(0, 1) + code(1, 1) + 2.0) / 4.0).floor()
        })
    };
    Codes {
        size: [w, h],
        values: (0..h).flat_map(|j| (0..w).map(move |i| mean(i, j))).collect(),
        most: fine.most,
    }
}

/// The weight of a neighbourhood with this error.
fn weight(error: f64) -> f64 {
    let cube = (error as u128).pow(3);
    // Bisection: errors are below 2^34, and so their power 0.6 is below 2^21.
    let (mut low, mut high) = (0_u128, 1 << 21);
    while high - low > 1 {
        let middle = (low + high) / 2;
        if middle.pow(5) <= cube {
            low = middle;
        } else {
            high = middle;
        }
    }
    ((1_u64 << 32) / low.max(1) as u64) as f64
}

/// The image after one iteration: means of the patches that are nearest to its neighbourhoods of
/// n x n texels.
fn nearer(picture: &Codes, sample: &Codes, n: usize, robust: bool) -> Codes {
    let starts = |length: usize| {
        let apart = (0..length).filter(move |at| at % (n / 4) == 0 && *at < length - n);
        apart.chain([length - n])
    };
    let [width, height] = picture.size;
    let all = || (0..n).flat_map(|j| (0..n).map(move |i| (i, j)));
    let piece = |[x, y]: [usize; 2], (i, j): (usize, usize)| sample.values[(y + j) * sample.size[0] + x + i];
    let mut covering: Vec<Vec<(f64, Texel)>> = vec![Vec::new(); width * height];
    for y in starts(height) {
        for x in starts(width) {
            let at = |(i, j): (usize, usize)| (y + j) * width + x + i;
            let apart = |place| -> f64 {
                all()
                    .map(|k| difference(piece(place, k), picture.values[at(k)]))
                    .sum()
            };
            let places = (0..=sample.size[1] - n).flat_map(|y| (0..=sample.size[0] - n).map(move |x| [x, y]));
            let mut nearest = ([0, 0], f64::INFINITY);
            for place in places {
                let error = apart(place);
                if error < nearest.1 {
                    nearest = (place, error);
                }
            }
            let weight = if robust { weight(nearest.1) } else { 1.0 };
            all().for_each(|k| covering[at(k)].push((weight, piece(nearest.0, k))));
        }
    }
    // All sums are integers below 2^53.
    let mean = |texels: &Vec<(f64, Texel)>| {
        let count: f64 = texels.iter().map(|(weight, _)| weight).sum();
        [0, 1, 2].map(|c| {
            let sum: f64 = texels.iter().map(|(weight, texel)| weight * texel[c]).sum();
            ((2.0 * sum + count) / (2.0 * count)).floor()
        })
    };
    Codes {
        size: picture.size,
        values: covering.iter().map(mean).collect(),
        most: picture.most,
    }
}

fn difference(a: Texel, b: Texel) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// The minimum-cost seam along a block: for each row the column that it crosses. `d` is the
/// difference at a column and row.
fn seam(block: usize, overlap: usize, d: &dyn Fn(usize, usize) -> f64) -> Vec<usize> {
    // The neighbours of a position.
    let near = |i: usize| i.saturating_sub(1)..(i + 2).min(overlap);
    let mut sums: Vec<Vec<f64>> = vec![(0..overlap).map(|i| d(i, 0)).collect()];
    for j in 1..block {
        let before = &sums[j - 1];
        let least = |i: usize| near(i).map(|k| before[k]).fold(f64::INFINITY, f64::min);
        let row = (0..overlap).map(|i| d(i, j) + least(i)).collect();
        sums.push(row);
    }
    let lowest = |row: &[f64], mut places: std::ops::Range<usize>| {
        let first = places.next().unwrap_or(0);
        places.fold(first, |best, i| if row[i] < row[best] { i } else { best })
    };
    let mut way = vec![0; block];
    way[block - 1] = lowest(&sums[block - 1], 0..overlap);
    for j in (0..block - 1).rev() {
        way[j] = lowest(&sums[j], near(way[j + 1]));
    }
    way
}
