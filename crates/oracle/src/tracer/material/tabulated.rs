//! A BRDF as a table over the angles of the half vector (section 8 of the model).

use std::f64::consts::PI;
use whitstone_core::{DVec3, Rgb};

/// Steps of Simpson's rule between two kinks of the table.
const STEPS: u32 = 512;

pub(super) struct Brdf {
    rows: Vec<Vec<Rgb>>,
    square_root: bool,
    /// At normal incidence.
    albedo: Rgb,
}

impl Brdf {
    /// `None` if the rows are no table of at least 2 x 2 entries.
    pub(super) fn new(rows: Vec<Vec<Rgb>>, square_root: bool) -> Option<Self> {
        let columns = rows.first()?.len();
        if rows.len() < 2 || columns < 2 || rows.iter().any(|row| row.len() != columns) {
            return None;
        }
        let mut brdf = Self {
            rows,
            square_root,
            albedo: Rgb::splat(0.0),
        };
        brdf.albedo = brdf.integrated();
        Some(brdf)
    }

    pub(super) fn albedo(&self) -> Rgb {
        self.albedo
    }

    /// The BRDF for light from `l`, seen from `v`.
    pub(super) fn at(&self, n: DVec3, l: DVec3, v: DVec3) -> Rgb {
        let m = l + v;
        let theta_h = if m == DVec3::ZERO {
            0.0
        } else {
            f64::atan2(n.cross(m).length(), n.dot(m))
        };
        self.value(theta_h, f64::atan2((l - v).length(), m.length()))
    }

    /// Position of an angle among the rows.
    fn row(&self, theta_h: f64) -> f64 {
        let share = theta_h / (PI / 2.0);
        let share = if self.square_root { share.sqrt() } else { share };
        (self.rows.len() - 1) as f64 * share
    }

    fn value(&self, theta_h: f64, theta_d: f64) -> Rgb {
        // The two nearest entries, and their weights.
        let pair = |x: f64, last: usize| {
            let x = x.clamp(0.0, last as f64);
            let low = x.floor().min(last as f64 - 1.0);
            [(low as usize, low + 1.0 - x), (low as usize + 1, x - low)]
        };
        let last = self.rows[0].len() - 1;
        let [across, down] = [
            pair(theta_d / (PI / 2.0) * last as f64, last),
            pair(self.row(theta_h), self.rows.len() - 1),
        ];
        let mut sum = Rgb::splat(0.0);
        for (i, of_row) in down {
            for (j, of_entry) in across {
                sum += self.rows[i][j] * (of_row * of_entry);
            }
        }
        sum
    }

    /// The integral of `2 pi f(theta, theta) sin(4 theta)` from 0 to pi/4, over the square root of
    /// theta, in which the table has no infinite slope.
    fn integrated(&self) -> Rgb {
        let end = (PI / 4.0).sqrt();
        let share = |i: usize, count: usize| i as f64 / (count - 1) as f64;
        let right = (PI / 2.0).sqrt();
        let rows = (0..self.rows.len()).map(|i| {
            let share = share(i, self.rows.len());
            right * if self.square_root { share } else { share.sqrt() }
        });
        let columns = self.rows[0].len();
        let columns = (0..columns).map(|j| right * share(j, columns).sqrt());
        let mut kinks: Vec<f64> = rows.chain(columns).filter(|root| *root < end).collect();
        kinks.push(end);
        kinks.sort_by(f64::total_cmp);
        let integrand = |root: f64| {
            let theta = root * root;
            self.value(theta, theta) * (2.0 * PI * (4.0 * theta).sin() * 2.0 * root)
        };
        let mut sum = Rgb::splat(0.0);
        for ends in kinks.windows(2) {
            let width = (ends[1] - ends[0]) / f64::from(STEPS);
            for step in 0..=STEPS {
                let weight = match step {
                    0 | STEPS => 1.0,
                    _ if step % 2 == 1 => 4.0,
                    _ => 2.0,
                };
                sum += integrand(ends[0] + f64::from(step) * width) * (weight * width / 3.0);
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn brdf(rows: &[&[f64]], square_root: bool) -> Brdf {
        let rows = rows
            .iter()
            .map(|row| row.iter().map(|x| Rgb::splat(*x)).collect());
        Brdf::new(rows.collect(), square_root).expect("a table")
    }

    #[test]
    fn known_values() {
        let even = brdf(&[&[1.0, 2.0, 3.0], &[4.0, 5.0, 6.0], &[7.0, 8.0, 9.0]], false);
        // At normal incidence, lit at an angle of 45 degrees, both angles are a quarter of 90
        // degrees.
        let l = DVec3::new(0.5f64.sqrt(), 0.0, 0.5f64.sqrt());
        assert!((even.at(DVec3::Z, l, DVec3::Z).g - 3.0).abs() < 1e-14);
        let roots = brdf(&[&[1.0, 2.0, 3.0], &[4.0, 5.0, 6.0], &[7.0, 8.0, 9.0]], true);
        assert!((roots.at(DVec3::Z, l, DVec3::Z).g - 4.5).abs() < 1e-14);
        assert_eq!(even.at(DVec3::Z, DVec3::X, -DVec3::X).g, 3.0);
    }

    #[test]
    fn the_albedo_of_a_constant_and_of_a_ramp() {
        for square_root in [false, true] {
            let constant = brdf(&[&[0.2, 0.2], &[0.2, 0.2], &[0.2, 0.2]], square_root);
            assert!((constant.albedo().g - 0.2 * PI).abs() < 1e-8);
            // 2 pi times the integral of 2/pi theta sin(4 theta), which is pi/16.
            let ramp = brdf(&[&[0.0, 1.0], &[0.0, 1.0]], square_root);
            assert!((ramp.albedo().g - PI / 4.0).abs() < 1e-8);
        }
    }
}
