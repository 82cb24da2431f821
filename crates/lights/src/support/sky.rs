//! Illumination by an environment map: directions placed by luminance.
//!
//! Debevec, *A median cut algorithm for light probe sampling*, 2005, with three differences. The
//! weight is a power of the luminance instead of the luminance, because a small sun needs few
//! directions whatever its energy is. Cuts may pass through cells, so directions move continuously
//! with the radiance and rounding errors cannot make them jump. Each direction is the centroid of
//! its region.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::ops::Range;
use whitstone_core::{DVec2, DVec3, LightSample, Rgb};

/// Rows of the table, with equal steps of latitude.
const ROWS: usize = 512;
/// Columns of the table, with equal steps of longitude.
const COLUMNS: usize = 2 * ROWS;
/// Exponent of the luminance in the weight that is divided equally among directions. A region that
/// is cut by the horizon of a surface has an error of about its energy times its diameter. With a
/// density of rho directions, the sum of the squared errors is proportional to the integral of
/// `L² rho^(-5/2)`, which is least for rho proportional to `L^(4/7)`.
const POWER: f64 = 4.0 / 7.0;
/// Fraction of the mean weight that is added everywhere, so that the position of every cut is
/// unique even in black areas.
const FLOOR: f64 = 0.01;
/// A region is cut across its longitudes if `ASPECT` times their span exceeds that of its
/// latitudes.
const ASPECT: f64 = 0.65;

/// Returns at most `count` directions with their irradiance. `look` gives the radiance (>= 0) at
/// (u, v), whose direction is also passed. Each cell of the table is the mean of `parts`² lookups.
pub(crate) fn directions(count: usize, parts: usize, look: impl Fn(DVec2, DVec3) -> Rgb) -> Vec<LightSample> {
    let Some((table, peak)) = Table::new(parts, look) else {
        return Vec::new();
    };
    let mut found = Vec::with_capacity(count);
    let sphere = Region {
        y: [-1.0, 1.0],
        phi: [-PI, PI],
    };
    table.place(&sphere, count, &mut |direction, energy| {
        found.push(LightSample {
            direction,
            distance: f64::INFINITY,
            irradiance: energy.map(|e| (e * peak).min(f64::MAX)),
        });
    });
    found
}

/// Number of lookups along each axis of a cell, for a picture of this size.
pub(crate) fn parts_of_picture([columns, rows]: [usize; 2]) -> usize {
    columns.div_ceil(2 * COLUMNS).max(rows.div_ceil(2 * ROWS)).max(1)
}

/// As [`parts_of_picture`], for a cube map.
pub(crate) fn parts_of_cube(side: usize) -> usize {
    side.div_ceil(ROWS).max(1)
}

/// The unit direction of (u, v).
fn towards(u: f64, v: f64) -> DVec3 {
    let (sin_phi, cos_phi) = libm::sincos(TAU * (u - 0.5));
    let (sin, cos) = libm::sincos(PI * (v - 0.5));
    DVec3::new(cos * sin_phi, sin, -cos * cos_phi)
}

fn luminance(l: Rgb) -> f64 {
    0.2126 * l.r + 0.7152 * l.g + 0.0722 * l.b
}

/// Lower edge of a row, as the sine of the latitude.
fn row_edge(row: usize) -> f64 {
    libm::sin(PI * (row as f64 / ROWS as f64 - 0.5))
}

/// Lower edge of a column, as the longitude.
fn column_edge(column: usize) -> f64 {
    TAU * (column as f64 / COLUMNS as f64 - 0.5)
}

/// A sky with constant radiance in each cell.
struct Table {
    /// Divided by the largest value, so that no sum overflows.
    radiance: Vec<Rgb>,
    /// Weight per solid angle; it is divided equally among directions.
    weight: Vec<f64>,
    /// Edges of the rows, as sines of the latitude.
    y: Vec<f64>,
    /// Edges of the columns, as longitudes.
    phi: Vec<f64>,
}

/// A region of the sphere, bounded by latitudes and longitudes.
struct Region {
    /// Range of the sine of the latitude.
    y: [f64; 2],
    /// Range of the longitude.
    phi: [f64; 2],
}

impl Table {
    /// Creates the table and returns it with its normalisation factor; `None` for a black sky.
    fn new(parts: usize, look: impl Fn(DVec2, DVec3) -> Rgb) -> Option<(Self, f64)> {
        let middle = |cell: usize, part: usize, cells: usize| {
            ((cell * parts + part) as f64 + 0.5) / (cells * parts) as f64
        };
        let each = 1.0 / (parts * parts) as f64;
        let mut radiance = Vec::with_capacity(ROWS * COLUMNS);
        for row in 0..ROWS {
            for column in 0..COLUMNS {
                let mut sum = Rgb::splat(0.0);
                for (a, b) in (0..parts).flat_map(|b| (0..parts).map(move |a| (a, b))) {
                    let uv = DVec2::new(middle(column, a, COLUMNS), middle(row, b, ROWS));
                    sum += look(uv, towards(uv.x, uv.y)) * each;
                }
                radiance.push(sum);
            }
        }
        let peak = radiance
            .iter()
            .fold(0.0_f64, |peak, l| peak.max(l.max_component()));
        if peak == 0.0 {
            return None;
        }
        for value in &mut radiance {
            *value = value.map(|l| l / peak);
        }
        let y: Vec<f64> = (0..=ROWS).map(row_edge).collect();
        let phi = (0..=COLUMNS).map(column_edge).collect();
        let mut weight: Vec<f64> = radiance.iter().map(|l| libm::pow(luminance(*l), POWER)).collect();
        let rows = weight.chunks_exact(COLUMNS).zip(y.windows(2));
        let mean: f64 = rows
            .map(|(row, y)| row.iter().sum::<f64>() * (y[1] - y[0]) / (2 * COLUMNS) as f64)
            .sum();
        for value in &mut weight {
            *value += FLOOR * mean;
        }
        let table = Self {
            radiance,
            weight,
            y,
            phi,
        };
        Some((table, peak))
    }

    /// Divides a region among `count` directions and passes each one with its energy to `out`.
    fn place(&self, region: &Region, count: usize, out: &mut impl FnMut(DVec3, Rgb)) {
        if count == 1 {
            self.gather(region, out);
            return;
        }
        let Region { y, phi } = *region;
        let least = if y[0] < 0.0 && y[1] > 0.0 {
            0.0
        } else {
            y[0].abs().min(y[1].abs())
        };
        let widest = (1.0 - least * least).sqrt();
        let across = ASPECT * (phi[1] - phi[0]) * widest > libm::asin(y[1]) - libm::asin(y[0]);
        let (rows, columns) = (pieces(&self.y, y), pieces(&self.phi, phi));
        let first = count / 2;
        let share = first as f64 / count as f64;
        let (a, b);
        if across {
            let mut weights = vec![0.0; columns.len()];
            for (row, [from, to]) in rows {
                let row = &self.weight[row * COLUMNS..][columns.range.clone()];
                for (sum, weight) in weights.iter_mut().zip(row) {
                    *sum += weight * (to - from);
                }
            }
            let at = quantile(columns, &weights, share);
            a = Region { y, phi: [phi[0], at] };
            b = Region { y, phi: [at, phi[1]] };
        } else {
            let mut weights = Vec::with_capacity(rows.len());
            for (row, _) in rows.clone() {
                let columns = columns.clone();
                let cells =
                    columns.map(|(column, [from, to])| self.weight[row * COLUMNS + column] * (to - from));
                weights.push(cells.sum());
            }
            let at = quantile(rows, &weights, share);
            a = Region { y: [y[0], at], phi };
            b = Region { y: [at, y[1]], phi };
        }
        self.place(&a, first, out);
        self.place(&b, count - first, out);
    }

    /// Passes the centroid and the energy of a region to `out`.
    fn gather(&self, region: &Region, out: &mut impl FnMut(DVec3, Rgb)) {
        let (rows, columns) = (pieces(&self.y, region.y), pieces(&self.phi, region.phi));
        let columns: Vec<_> = columns
            .map(|(column, [a, b])| {
                (
                    column,
                    b - a,
                    libm::cos(a) - libm::cos(b),
                    libm::sin(a) - libm::sin(b),
                )
            })
            .collect();
        let (mut energy, mut moment) = (Rgb::splat(0.0), DVec3::ZERO);
        for (row, [a, b]) in rows {
            let (height, up, out) = (b - a, 0.5 * (b * b - a * a), outwards(b) - outwards(a));
            for (column, width, x, z) in &columns {
                let l = self.radiance[row * COLUMNS + column];
                energy += l * (height * width);
                moment += luminance(l) * DVec3::new(out * x, up * width, out * z);
            }
        }
        if !energy.is_black() {
            out(moment.try_normalize().unwrap_or(DVec3::Y), energy);
        }
    }
}

/// The integral of sqrt(1 - y²).
fn outwards(y: f64) -> f64 {
    let y = y.clamp(-1.0, 1.0);
    0.5 * (y * (1.0 - y * y).sqrt()
        + if y.abs() == 1.0 {
            y * FRAC_PI_2
        } else {
            libm::asin(y)
        })
}

/// The rows or columns that an interval overlaps, each with the overlapped part.
#[derive(Clone)]
struct Pieces<'a> {
    edges: &'a [f64],
    range: Range<usize>,
    interval: [f64; 2],
}

fn pieces(edges: &[f64], interval: [f64; 2]) -> Pieces<'_> {
    let start = edges
        .partition_point(|edge| *edge <= interval[0])
        .saturating_sub(1);
    let end = edges.partition_point(|edge| *edge < interval[1]);
    // Rounding may leave an interval empty.
    let start = start.min(edges.len() - 2);
    Pieces {
        edges,
        range: start..end.clamp(start + 1, edges.len() - 1),
        interval,
    }
}

impl Iterator for Pieces<'_> {
    type Item = (usize, [f64; 2]);

    fn next(&mut self) -> Option<Self::Item> {
        let index = self.range.next()?;
        let [from, to] = self.interval;
        Some((
            index,
            [self.edges[index].max(from), self.edges[index + 1].min(to)],
        ))
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        self.range.size_hint()
    }
}

impl ExactSizeIterator for Pieces<'_> {}

/// The position below which the given share of the total weight lies.
fn quantile(pieces: Pieces<'_>, weights: &[f64], share: f64) -> f64 {
    let total: f64 = pieces
        .clone()
        .zip(weights)
        .map(|((_, [a, b]), weight)| weight * (b - a))
        .sum();
    let [low, high] = pieces.interval;
    let mut left = share * total;
    for ((_, [a, b]), weight) in pieces.zip(weights) {
        let piece = weight * (b - a);
        if left <= piece && piece > 0.0 {
            return (a + (b - a) * (left / piece)).clamp(low, high);
        }
        left -= piece;
    }
    high
}

#[cfg(test)]
mod tests;
