//! Mipmaps: section 10, *Levels*, *Trilinear* and *EWA*.

use super::wrap::Wrap;
use whitstone_core::{DVec2, Rgb};

/// Filters over the footprint of a sample.
pub(super) enum Mean {
    Trilinear,
    /// With the maximum anisotropy: the largest ratio of the axes.
    Ewa(f64),
}

/// A mipmap level with linear values, the top row first.
pub(super) struct Level {
    pub(super) size: [usize; 2],
    pub(super) texels: Vec<Rgb>,
}

/// Splits a line into `many` and into `few` equal parts. Returns the fine parts that coarse part
/// `k` covers, each with its share of the coarse part.
fn covered(many: usize, few: usize, k: usize) -> impl Iterator<Item = (usize, f64)> + Clone {
    let ratio = many as f64 / few as f64;
    let (start, end) = (k as f64 * ratio, (k + 1) as f64 * ratio);
    (0..many).filter_map(move |i| {
        let share = (end.min((i + 1) as f64) - start.max(i as f64)) / ratio;
        (share > 0.0).then_some((i, share))
    })
}

impl Level {
    /// The next coarser level.
    fn halved(&self) -> Self {
        let size = self.size.map(|n| (n / 2).max(1));
        let mut texels = Vec::new();
        for row in 0..size[1] {
            let rows: Vec<_> = covered(self.size[1], size[1], row).collect();
            for column in 0..size[0] {
                let mut sum = Rgb::splat(0.0);
                for (i, of_i) in covered(self.size[0], size[0], column) {
                    for (j, of_j) in &rows {
                        sum += self.texels[j * self.size[0] + i] * (of_i * of_j);
                    }
                }
                texels.push(sum);
            }
        }
        Self { size, texels }
    }

    /// This level and all coarser ones.
    pub(super) fn pyramid(self) -> Vec<Self> {
        let mut all = vec![self];
        while let Some(last) = all.last()
            && last.size != [1, 1]
        {
            let next = last.halved();
            all.push(next);
        }
        all
    }

    pub(super) fn extent(&self) -> DVec2 {
        DVec2::new(self.size[0] as f64, self.size[1] as f64)
    }

    pub(super) fn texel(&self, wrap: [Wrap; 2], column: f64, row: f64) -> Rgb {
        let [i, j] = [
            wrap[0].index(column, self.size[0]),
            wrap[1].index(row, self.size[1]),
        ];
        self.texels[j * self.size[0] + i]
    }

    /// Bilinear interpolation; the image is the unit square, with (0, 0) at the top left.
    pub(super) fn bilinear(&self, wrap: [Wrap; 2], place: DVec2) -> Rgb {
        let x = place * self.extent() - 0.5;
        let (low, part) = (x.floor(), x - x.floor());
        let row =
            |j: f64| self.texel(wrap, low.x, j) * (1.0 - part.x) + self.texel(wrap, low.x + 1.0, j) * part.x;
        row(low.y) * (1.0 - part.y) + row(low.y + 1.0) * part.y
    }

    /// The weighted mean over an ellipse with these half axes, in units of the image.
    fn elliptical(&self, wrap: [Wrap; 2], place: DVec2, axes: [DVec2; 2]) -> Rgb {
        if self.size == [1, 1] {
            return self.texels[0];
        }
        let middle = place * self.extent() - 0.5;
        let [a, b] = axes.map(|axis| {
            let axis = axis * self.extent();
            axis * (1.0 / axis.length()).max(1.0)
        });
        let reach = DVec2::new(a.x.hypot(b.x), a.y.hypot(b.y));
        let (first, last) = ((middle - reach).ceil(), (middle + reach).floor());
        let (mut sum, mut weights) = (Rgb::splat(0.0), 0.0);
        for row in 0..=(last.y - first.y) as u32 {
            for column in 0..=(last.x - first.x) as u32 {
                let at = first + DVec2::new(f64::from(column), f64::from(row));
                // By Cramer's rule, in fractions of the half axes.
                let off = at - middle;
                let parts = DVec2::new(off.perp_dot(b), a.perp_dot(off)) / a.perp_dot(b);
                let x = 1.0 - parts.length_squared();
                if x > 0.0 {
                    let weight = x * (0.3053604 + x * (0.3825704 + x * (0.0182518 + 0.2935583 * x)));
                    sum += self.texel(wrap, at.x, at.y) * weight;
                    weights += weight;
                }
            }
        }
        sum * (1.0 / weights)
    }
}

/// Interpolates between the levels around `x`.
fn between(levels: &[Level], x: f64, of: impl Fn(&Level) -> Rgb) -> Rgb {
    let last = levels.len() - 1;
    if x.is_nan() || x >= last as f64 {
        return levels[last].texels[0];
    }
    let part = x - x.floor();
    let [fine, coarse] = [x.floor() as usize, x.floor() as usize + 1].map(|level| of(&levels[level]));
    fine * (1.0 - part) + coarse * part
}

impl Mean {
    /// The filtered value over a footprint, in units of the image.
    pub(super) fn over(&self, levels: &[Level], wrap: [Wrap; 2], place: DVec2, steps: [DVec2; 2]) -> Rgb {
        let finest = &levels[0];
        let [s, t] = steps.map(|step| step * finest.extent());
        if !(s.is_finite() && t.is_finite()) {
            return levels[levels.len() - 1].texels[0];
        }
        match self {
            Self::Trilinear => {
                let m = s.length().max(t.length());
                if m <= 1.0 {
                    return finest.bilinear(wrap, place);
                }
                between(levels, m.log2(), |level| level.bilinear(wrap, place))
            }
            Self::Ewa(most) => {
                let q = (-2.0_f64).exp();
                let r = ((1.0 - 3.0 * q) / (3.0 * (1.0 - 5.0 * q))).sqrt();
                let (s, t) = (s * r, t * r);
                // The angle that maximises the length of s cos(phi) + t sin(phi).
                let phi = 0.5 * (2.0 * s.dot(t)).atan2(s.length_squared() - t.length_squared());
                let long = s * phi.cos() + t * phi.sin();
                let a = long.length();
                if a <= 1.0 {
                    return finest.bilinear(wrap, place);
                }
                let b = (s.perp_dot(t).abs() / a).max(a / most);
                let axes = [long, long.perp() * (b / a)].map(|axis| axis / finest.extent());
                let mean = between(levels, b.log2().max(0.0), |level| {
                    level.elliptical(wrap, place, axes)
                });
                let part = (a - 1.0).min(1.0);
                finest.bilinear(wrap, place) * (1.0 - part) + mean * part
            }
        }
    }
}
