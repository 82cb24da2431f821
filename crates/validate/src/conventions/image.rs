//! The image of a probe under a hypothesis about sampling, filter, orientation and codes, and the
//! hypothesis that fits best.

use super::probe::VIEWS;
use serde::Serialize;
use std::fmt;
use whitstone_image::{Image, Transfer};

/// Samples per pixel along each axis: the resolution of an offset.
pub(super) const SUPER: usize = 8;
/// Pixels at the border that are not compared: some hypotheses look beyond it.
const MARGIN: usize = 3;
/// Size of the probe images. They are not square, so that the axis of the field of view shows.
pub(super) const SIZE: [usize; 2] = [96, 64];
/// Largest offset along an axis, in pixels.
const FARTHEST: i32 = 1;

/// A reconstruction filter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Filter {
    /// One sample.
    Point,
    /// The mean over a square of this width in pixels.
    Box(f64),
    /// A tent of this radius in pixels.
    Tent(f64),
    /// A Gaussian of this standard deviation in pixels.
    Gaussian(f64),
}

impl fmt::Display for Filter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Point => write!(f, "one sample"),
            Self::Box(width) => write!(f, "a box of {width} pixels"),
            Self::Tent(radius) => write!(f, "a tent with a radius of {radius} pixels"),
            Self::Gaussian(deviation) => write!(f, "a Gaussian with a deviation of {deviation} pixels"),
        }
    }
}

/// The filters that are tried.
const FILTERS: [Filter; 8] = [
    Filter::Point,
    Filter::Box(1.0),
    Filter::Box(2.0),
    Filter::Tent(1.0),
    Filter::Gaussian(0.25),
    Filter::Gaussian(0.375),
    Filter::Gaussian(0.5),
    Filter::Gaussian(0.75),
];

impl Filter {
    /// Distances in samples, and their weights.
    fn weights(self) -> Vec<(i32, f64)> {
        let unit = SUPER as f64;
        let (reach, weight): (f64, Box<dyn Fn(f64) -> f64>) = match self {
            Self::Point => (0.0, Box::new(|_| 1.0)),
            Self::Box(width) => {
                let half = 0.5 * width * unit;
                // The samples at both ends count by half.
                (
                    half,
                    Box::new(move |d: f64| if d.abs() < half { 1.0 } else { 0.5 }),
                )
            }
            Self::Tent(radius) => (radius * unit, Box::new(move |d: f64| radius * unit - d.abs())),
            Self::Gaussian(deviation) => {
                let deviation = deviation * unit;
                let reach = (3.0 * deviation).min(2.0 * unit);
                (
                    reach,
                    Box::new(move |d: f64| (-0.5 * (d / deviation).powi(2)).exp()),
                )
            }
        };
        let reach = reach as i32;
        let all: Vec<(i32, f64)> = (-reach..=reach).map(|d| (d, weight(f64::from(d)))).collect();
        let sum: f64 = all.iter().map(|(_, weight)| weight).sum();
        all.into_iter().map(|(d, weight)| (d, weight / sum)).collect()
    }
}

/// The transfer functions that are tried, with their names in a sentence.
pub(super) const TRANSFERS: [(Transfer, &str); 3] = [
    (Transfer::Linear, "linear"),
    (Transfer::Srgb, "sRGB"),
    (Transfer::Gamma(2.2), "a gamma of 2.2"),
];

/// The orders of channels that are tried: the channel of the image for red, green and blue.
pub(super) const ORDERS: [[usize; 3]; 2] = [[0, 1, 2], [2, 1, 0]];

/// A hypothesis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Guess {
    /// In samples, to the right and down.
    pub(super) offset: [i32; 2],
    pub(super) flip: [bool; 2],
    /// Index in [`VIEWS`].
    pub(super) view: usize,
    /// Index in [`TRANSFERS`].
    pub(super) transfer: usize,
    /// Index in [`ORDERS`].
    pub(super) order: usize,
    pub(super) filter: Filter,
}

/// A subject by the model.
pub(super) const CONFORMING: Guess = Guess {
    offset: [0; 2],
    flip: [false; 2],
    view: 0,
    transfer: 0,
    order: 0,
    filter: Filter::Point,
};

/// Whitstone's samples of a probe.
pub(super) struct Samples {
    /// Samples per pixel along each axis: [`SUPER`], with position (x, y) at (x, y)/[`SUPER`]
    /// pixels; or 1, with the one sample where the hypothesis has it.
    pub(super) factor: usize,
    /// The image.
    pub(super) color: [Vec<f32>; 3],
    /// The image with ambient light of radiance 1 and no other light.
    pub(super) ambient: [Vec<f32>; 3],
    /// The image with a background of radiance 1 and no light.
    pub(super) empty: Vec<f32>,
}

/// A probe's images under a hypothesis, without flips.
pub(super) struct Composed {
    color: [Vec<f64>; 3],
    ambient: [Vec<f64>; 3],
    pub(super) empty: Vec<f64>,
}

/// The images of a probe under a hypothesis.
pub(super) fn compose(samples: &Samples, guess: &Guess) -> Composed {
    let weights = guess.filter.weights();
    let plane = |plane: &Vec<f32>| match samples.factor {
        1 => plane.iter().map(|&value| f64::from(value)).collect(),
        _ => filtered(plane, &weights, guess.offset),
    };
    Composed {
        color: samples.color.each_ref().map(plane),
        ambient: samples.ambient.each_ref().map(plane),
        empty: plane(&samples.empty),
    }
}

fn filtered(plane: &[f32], weights: &[(i32, f64)], offset: [i32; 2]) -> Vec<f64> {
    let [width, height] = SIZE;
    let (columns, rows) = (width * SUPER, height * SUPER);
    let half = SUPER as i32 / 2;
    let at = |pixel: usize, offset: i32, d: i32, end: usize| {
        let place = (pixel * SUPER) as i32 + half + offset + d;
        place.clamp(0, end as i32 - 1) as usize
    };
    // Plain loops over slices: this is nearly all of the time of a search.
    let places: Vec<usize> = (0..width)
        .flat_map(|x| weights.iter().map(move |&(d, _)| at(x, offset[0], d, columns)))
        .collect();
    let mut across = vec![0.0; width * rows];
    for (row, sums) in plane.chunks_exact(columns).zip(across.chunks_exact_mut(width)) {
        for (sum, places) in sums.iter_mut().zip(places.chunks_exact(weights.len())) {
            for (&place, &(_, weight)) in places.iter().zip(weights) {
                *sum += weight * f64::from(row[place]);
            }
        }
    }
    let mut image = vec![0.0; width * height];
    for (y, sums) in image.chunks_exact_mut(width).enumerate() {
        for &(d, weight) in weights {
            let row = &across[at(y, offset[1], d, rows) * width..][..width];
            for (sum, &value) in sums.iter_mut().zip(row) {
                *sum += weight * value;
            }
        }
    }
    image
}

/// Unknown numbers that are fitted together with a hypothesis, and not searched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Free {
    /// A factor of all values.
    pub(super) factor: bool,
    /// Ambient light.
    pub(super) ambient: bool,
    /// What is seen where nothing is hit, a quadratic function of the row.
    pub(super) background: bool,
}

/// All numbers are fitted.
pub(super) const ALL_FREE: Free = Free {
    factor: true,
    ambient: true,
    background: true,
};

/// How well a hypothesis fits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fit {
    /// In units of the mean of the image.
    pub(super) error: f64,
    /// Takes the subject's values to the model's.
    pub(super) factor: f64,
    /// The ambient radiance, in the model's units.
    pub(super) ambient: [f64; 3],
    /// The background in the middle of the image, in the model's units.
    pub(super) background: [f64; 3],
}

const NO_FIT: Fit = Fit {
    error: f64::INFINITY,
    factor: 1.0,
    ambient: [0.0; 3],
    background: [0.0; 3],
};

/// Fits the free numbers of a hypothesis by least squares.
pub(super) fn fit(expected: &Composed, image: &Image, guess: &Guess, free: Free) -> Fit {
    let Ok(planes) = image.rgb() else {
        return NO_FIT;
    };
    let [width, height] = SIZE;
    let transfer = TRANSFERS[guess.transfer].0;
    let pixels = || (MARGIN..height - MARGIN).flat_map(|y| (MARGIN..width - MARGIN).map(move |x| [x, y]));
    let mut parts = Vec::new();
    for (channel, &from) in ORDERS[guess.order].iter().enumerate() {
        let plane = planes[from];
        let values: Vec<f64> = pixels()
            .map(|[x, y]| {
                let from_x = if guess.flip[0] { width - 1 - x } else { x };
                let from_y = if guess.flip[1] { height - 1 - y } else { y };
                transfer.decode(f64::from(plane[from_y * width + from_x]))
            })
            .collect();
        let part = |plane: &[f64]| pixels().map(|[x, y]| plane[y * width + x]).collect::<Vec<f64>>();
        let color = part(&expected.color[channel]);
        let mut basis = Vec::new();
        if free.ambient {
            basis.push(part(&expected.ambient[channel]));
        }
        if free.background {
            let empty = part(&expected.empty);
            let row = |y: usize| 2.0 * y as f64 / height as f64 - 1.0;
            for power in 0..3 {
                let of = pixels().zip(&empty);
                basis.push(of.map(|([_, y], empty)| empty * row(y).powi(power)).collect());
            }
        }
        parts.push(Part::new(values, color, basis));
    }
    let count = (3 * (width - 2 * MARGIN) * (height - 2 * MARGIN)) as f64;
    let sum = |of: &dyn Fn(&Part) -> f64| parts.iter().map(of).sum::<f64>();
    // In the subject's units.
    let gain = match free.factor {
        true => sum(&|part| dot(&part.values, &part.color)) / sum(&|part| dot(&part.color, &part.color)),
        false => 1.0,
    };
    if !(gain.is_finite() && gain > 0.0) {
        return NO_FIT;
    }
    let squares = sum(&|part| {
        let pairs = part.values.iter().zip(&part.color);
        pairs.map(|(value, color)| (value - gain * color).powi(2)).sum()
    });
    let mean = sum(&|part| part.mean) / 3.0;
    let error = (squares / count).sqrt() / (gain * mean);
    if !error.is_finite() {
        return NO_FIT;
    }
    let number = |index: usize| {
        let of = |part: &Part| (part.of_values[index] - gain * part.of_color[index]) / gain;
        [of(&parts[0]), of(&parts[1]), of(&parts[2])]
    };
    Fit {
        error,
        factor: 1.0 / gain,
        ambient: if free.ambient { number(0) } else { [0.0; 3] },
        background: match free.background {
            true => number(usize::from(free.ambient)),
            false => [0.0; 3],
        },
    }
}

/// One channel of a fit.
struct Part {
    /// The subject's values, without the part that the basis explains.
    values: Vec<f64>,
    /// The model's values, likewise.
    color: Vec<f64>,
    /// The mean of the model's values.
    mean: f64,
    /// The coefficients of that part.
    of_values: Vec<f64>,
    of_color: Vec<f64>,
}

impl Part {
    fn new(mut values: Vec<f64>, mut color: Vec<f64>, basis: Vec<Vec<f64>>) -> Self {
        let mean = color.iter().sum::<f64>() / color.len() as f64;
        let project = |values: &mut Vec<f64>| {
            let coefficients = least_squares(&basis, values);
            for (column, coefficient) in basis.iter().zip(&coefficients) {
                for (value, part) in values.iter_mut().zip(column) {
                    *value -= coefficient * part;
                }
            }
            coefficients
        };
        let of_values = project(&mut values);
        let of_color = project(&mut color);
        Self {
            values,
            color,
            mean,
            of_values,
            of_color,
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The coefficients of the columns whose sum is nearest to the values; 0 of a column without
/// contents.
fn least_squares(columns: &[Vec<f64>], values: &[f64]) -> Vec<f64> {
    let count = columns.len();
    let mut rows: Vec<Vec<f64>> = columns
        .iter()
        .map(|row| {
            let products = columns.iter().map(|column| dot(row, column));
            products.chain([dot(row, values)]).collect()
        })
        .collect();
    for (index, row) in rows.iter_mut().enumerate() {
        // An empty column gets the coefficient 0.
        row[index] += 1e-12 * row[index] + 1e-9;
    }
    for pivot in 0..count {
        let row = rows[pivot].clone();
        for other in pivot + 1..count {
            let factor = rows[other][pivot] / row[pivot];
            for (value, part) in rows[other].iter_mut().zip(&row) {
                *value -= factor * part;
            }
        }
    }
    let mut result = vec![0.0; count];
    for pivot in (0..count).rev() {
        let known: f64 = (pivot + 1..count)
            .map(|column| rows[pivot][column] * result[column])
            .sum();
        result[pivot] = (rows[pivot][count] - known) / rows[pivot][pivot];
    }
    result
}

/// All hypotheses that differ from one in a single convention.
fn neighbours(guess: &Guess, offsets: &[i32]) -> Vec<Guess> {
    let mut found = Vec::new();
    for &x in offsets {
        for &y in offsets {
            found.push(Guess {
                offset: [x, y],
                ..*guess
            });
        }
    }
    for flip in FLIPS {
        found.push(Guess { flip, ..*guess });
    }
    found.extend((0..VIEWS.len()).map(|view| Guess { view, ..*guess }));
    found.extend((0..TRANSFERS.len()).map(|transfer| Guess { transfer, ..*guess }));
    found.extend((0..ORDERS.len()).map(|order| Guess { order, ..*guess }));
    found.extend(FILTERS.map(|filter| Guess { filter, ..*guess }));
    found
}

const FLIPS: [[bool; 2]; 4] = [[false, false], [true, false], [false, true], [true, true]];

/// The hypothesis with the smallest error among those that `allowed` accepts. `samples` are those
/// of each view.
pub(super) fn best(samples: &[Samples], image: &Image, allowed: &dyn Fn(&Guess) -> bool) -> (f64, Guess) {
    let mut best = (f64::INFINITY, CONFORMING);
    // Most hypotheses share their images with others.
    let mut keys = Vec::new();
    let mut images: Vec<Composed> = Vec::new();
    let mut consider = |guess: &Guess, best: &mut (f64, Guess)| {
        if allowed(guess) && guess.view < samples.len() {
            let key = (guess.view, guess.offset, guess.filter);
            let known = keys.iter().position(|known| *known == key);
            let index = known.unwrap_or_else(|| {
                keys.push(key);
                images.push(compose(&samples[guess.view], guess));
                images.len() - 1
            });
            let fit = fit(&images[index], image, guess, ALL_FREE);
            // Of equal ones the first, which is nearest to the model.
            if fit.error < best.0 {
                *best = (fit.error, *guess);
            }
        }
    };
    // What is discrete, on a coarse grid.
    for view in 0..VIEWS.len() {
        for flip in FLIPS {
            for transfer in 0..TRANSFERS.len() {
                for order in 0..ORDERS.len() {
                    let guess = Guess {
                        view,
                        flip,
                        transfer,
                        order,
                        ..CONFORMING
                    };
                    consider(&guess, &mut best);
                }
            }
        }
    }
    let half = SUPER as i32 / 2;
    let far = FARTHEST * SUPER as i32;
    for _ in 0..4 {
        let before = best;
        let coarse: Vec<i32> = (-far..=far).step_by(half as usize).collect();
        for guess in neighbours(&before.1, &coarse) {
            consider(&guess, &mut best);
        }
        let [x, y] = best.1.offset;
        for dx in -half + 1..half {
            for dy in -half + 1..half {
                let guess = Guess {
                    offset: [(x + dx).clamp(-far, far), (y + dy).clamp(-far, far)],
                    ..best.1
                };
                consider(&guess, &mut best);
            }
        }
        if best == before {
            break;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coefficients_are_those_of_the_sum() {
        let columns = [vec![1.0, 0.0, 1.0, 2.0], vec![0.0; 4], vec![0.0, 1.0, 1.0, 5.0]];
        let values: Vec<f64> = (0..4)
            .map(|k| 3.0 * columns[0][k] - 2.0 * columns[2][k])
            .collect();
        let found = least_squares(&columns, &values);
        for (found, expected) in found.iter().zip([3.0, 0.0, -2.0]) {
            assert!((found - expected).abs() < 1e-7, "{found} {expected}");
        }
    }
}
