//! `(sqrt(x² + y²) - major_radius)² + z² = minor_radius²`, as a quartic polynomial:
//! `(|p|² + R² - r²)² = 4 R² (x² + y²)`.

use super::Surface;
use crate::interval::Decided;
use crate::polynomial::Polynomial;
use crate::quadratic;
use crate::root::{Root, Roots};
use crate::vector::Line;
use serde::Deserialize;
use whitstone_core::DVec3;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Torus {
    #[serde(default = "major")]
    pub(crate) major_radius: f64,
    #[serde(default = "minor")]
    pub(crate) minor_radius: f64,
}

fn major() -> f64 {
    1.0
}

fn minor() -> f64 {
    0.25
}

impl Surface for Torus {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        let (o, d) = (&line.origin, &line.direction);
        let [major, minor] = [self.major_radius, self.minor_radius].map(|x| line.number(x));
        let [a, b, c] = [d.dot(d), o.dot(d), o.dot(o)];
        // The torus lies inside a slightly larger sphere.
        let reach = (&major + &minor) * line.number(1.000_000_1);
        let in_ball = quadratic::roots(&a, &b, &(&c - reach.squared()))?;
        let [(first, _), (last, _)] = &in_ball[..] else {
            return Ok(Roots::default());
        };
        let squares = Polynomial(vec![c + (&major - &minor) * (&major + &minor), &b + &b, a]);
        let flat = |i: usize, j: usize| &o.0[i] * &d.0[j] + &o.0[j] * &d.0[i];
        let four = line.number(4.0) * major.squared();
        let around = Polynomial(vec![
            &four * (o.0[0].squared() + o.0[1].squared()),
            &four * (flat(0, 0) + flat(1, 1)),
            &four * (d.0[0].squared() + d.0[1].squared()),
        ]);
        let quartic = squares.times(&squares).minus(&around);
        let root = |(t, slope)| {
            let p = line.at(&t).nearest();
            let around = DVec3::new(p.x, p.y, 0.0);
            let normal = (p - self.major_radius * around.normalize_or_zero()).normalize_or_zero();
            Root::new(t, 0, &slope, normal, self.major_radius + self.minor_radius)
        };
        let roots = quartic.roots(&first.from(), &last.to())?;
        let all: Decided<_> = roots.into_iter().map(root).collect();
        Ok(Roots::new(all?))
    }

    fn ball(&self) -> Option<(DVec3, f64)> {
        Some((DVec3::ZERO, self.major_radius.abs() + self.minor_radius.abs()))
    }
}
