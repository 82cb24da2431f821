//! Lights that approximate an environment: section 7, sky light.
//!
//! A region is a list of strips along each axis: the parts of rows and columns that lie in it.
//! Splitting a region splits one of the lists. Integrals over a region are sums over all pairs of
//! strips.

use std::f64::consts::{FRAC_PI_2, PI};
use whitstone_core::{DVec2, DVec3, Rgb};

const COLUMNS: usize = 1024;
const ROWS: usize = 512;

/// A part of a row, between two values of y, or of a column, between two values of phi.
#[derive(Clone, Copy)]
struct Strip {
    index: usize,
    from: f64,
    to: f64,
}

/// Number of lookups per cell, along each axis.
pub(super) fn parts([columns, rows]: [usize; 2]) -> usize {
    let most = (columns as f64 / 2048.0).max(rows as f64 / 1024.0);
    most.ceil().max(1.0) as usize
}

fn brightness(t: Rgb) -> f64 {
    0.2126 * t.r + 0.7152 * t.g + 0.0722 * t.b
}

/// The lower bound of a strip: phi of a column, lambda of a row.
fn angle(index: usize, of: usize, full: f64) -> f64 {
    full * index as f64 / of as f64 - full / 2.0
}

/// The lights for n > 0, each as the direction to it and its irradiance. `look` evaluates the
/// texture at (u, v) and a direction.
pub(super) fn lights(n: u32, s: usize, look: impl Fn(DVec2, DVec3) -> Rgb) -> Vec<(DVec3, Rgb)> {
    let cells: Vec<Rgb> = (0..ROWS * COLUMNS)
        .map(|cell| {
            let mut mean = Rgb::splat(0.0);
            for part in 0..s * s {
                let at = |index: usize, part: usize, of: usize| {
                    (index as f64 + (part as f64 + 0.5) / s as f64) / of as f64
                };
                let u = at(cell % COLUMNS, part % s, COLUMNS);
                let v = at(cell / COLUMNS, part / s, ROWS);
                let (phi, lambda) = (PI * (2.0 * u - 1.0), PI * (v - 0.5));
                let level = lambda.cos();
                let d = DVec3::new(level * phi.sin(), lambda.sin(), -level * phi.cos());
                mean += look(DVec2::new(u, v), d);
            }
            mean * (1.0 / (s * s) as f64)
        })
        .collect();
    // Normalises, so that sums of the largest values stay finite.
    let unit = cells.iter().fold(0.0, |unit: f64, t| unit.max(t.max_component()));
    if unit == 0.0 {
        return Vec::new();
    }
    let cells: Vec<Rgb> = cells.into_iter().map(|t| t.map(|l| l / unit)).collect();

    let strips = |of: usize, full: f64, place: fn(f64) -> f64| -> Vec<Strip> {
        let edge = |index| place(angle(index, of, full));
        let strip = |index| Strip {
            index,
            from: edge(index),
            to: edge(index + 1),
        };
        (0..of).map(strip).collect()
    };
    let rows = strips(ROWS, PI, f64::sin);
    let columns = strips(COLUMNS, 2.0 * PI, |phi| phi);

    let mut g: Vec<f64> = cells.iter().map(|t| brightness(*t).powf(4.0 / 7.0)).collect();
    let mut mean = 0.0;
    for row in &rows {
        let cells = &g[row.index * COLUMNS..(row.index + 1) * COLUMNS];
        mean += cells.iter().sum::<f64>() / COLUMNS as f64 * (row.to - row.from) / 2.0;
    }
    g.iter_mut().for_each(|g| *g += 0.01 * mean);

    let mut lights = Vec::new();
    let mut waiting = vec![(rows, columns, 2 * n * n)];
    while let Some((rows, columns, k)) = waiting.pop() {
        if k == 1 {
            lights.extend(direction(&cells, &rows, &columns, unit));
            continue;
        }
        let (y, phi) = (span(&rows), span(&columns));
        let level = |y: f64| (1.0 - y * y).max(0.0).sqrt();
        let c = match y[0] < 0.0 && y[1] > 0.0 {
            true => 1.0,
            false => level(y[0]).max(level(y[1])),
        };
        let first = k / 2;
        let share = f64::from(first) / f64::from(k);
        let wide = 0.65 * (phi[1] - phi[0]) * c > y[1].asin() - y[0].asin();
        let (along, other) = if wide {
            (&columns, &rows)
        } else {
            (&rows, &columns)
        };
        let weigh = |strip: &Strip| {
            let cell = |across: &Strip| match wide {
                true => g[across.index * COLUMNS + strip.index] * (across.to - across.from),
                false => g[strip.index * COLUMNS + across.index] * (across.to - across.from),
            };
            other.iter().map(cell).sum::<f64>() * (strip.to - strip.from)
        };
        let weights: Vec<f64> = along.iter().map(weigh).collect();
        let (low, high) = cut(along, &weights, share);
        if wide {
            waiting.push((rows.clone(), high, k - first));
            waiting.push((rows, low, first));
        } else {
            waiting.push((high, columns.clone(), k - first));
            waiting.push((low, columns, first));
        }
    }
    lights
}

/// The range that the strips cover.
fn span(strips: &[Strip]) -> [f64; 2] {
    [strips[0].from, strips[strips.len() - 1].to]
}

/// Splits the strips so that the first list has this share of the weight. Each list has at least
/// one strip, which may be empty.
fn cut(strips: &[Strip], weights: &[f64], share: f64) -> (Vec<Strip>, Vec<Strip>) {
    let wanted = share * weights.iter().sum::<f64>();
    let mut before = 0.0;
    for (index, (strip, weight)) in strips.iter().zip(weights).enumerate() {
        if before + weight >= wanted || index + 1 == strips.len() {
            // Rounding can produce strips of zero width.
            let part = if *weight > 0.0 {
                (wanted - before) / weight
            } else {
                0.0
            };
            let part = part.clamp(0.0, 1.0);
            let at = strip.from + part * (strip.to - strip.from);
            let mut low = strips[..=index].to_vec();
            let mut high = strips[index..].to_vec();
            low[index].to = at;
            high[0].from = at;
            return (low, high);
        }
        before += weight;
    }
    (strips.to_vec(), strips.to_vec())
}

/// The light that represents a region: the direction to it and its irradiance.
fn direction(cells: &[Rgb], rows: &[Strip], columns: &[Strip], unit: f64) -> Option<(DVec3, Rgb)> {
    let integral = |y: f64| {
        let asin = if y.abs() >= 1.0 {
            FRAC_PI_2 * y.signum()
        } else {
            y.asin()
        };
        (y * (1.0 - y * y).max(0.0).sqrt() + asin) / 2.0
    };
    let mut energy = Rgb::splat(0.0);
    let mut moment = DVec3::ZERO;
    for row in rows {
        let (a, b) = (row.from, row.to);
        let level = integral(b) - integral(a);
        for column in columns {
            let (alpha, beta) = (column.from, column.to);
            let t = cells[row.index * COLUMNS + column.index];
            energy += t * ((b - a) * (beta - alpha));
            moment += brightness(t)
                * DVec3::new(
                    level * (alpha.cos() - beta.cos()),
                    (b * b - a * a) * (beta - alpha) / 2.0,
                    -level * (beta.sin() - alpha.sin()),
                );
        }
    }
    (energy != Rgb::splat(0.0)).then(|| {
        let towards = moment.try_normalize().unwrap_or(DVec3::Y);
        (towards, energy.map(|e| (e * unit).min(f64::MAX)))
    })
}
