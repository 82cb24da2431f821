//! An environment map at its poles, where all meridians meet, and at its seam.

use crate::lab::radiance;
use crate::{About, Answer, Engine, Family, Lab, Sample, decades};
use std::f64::consts::{PI, TAU};
use whitstone_core::{DVec3, Ray};
use whitstone_oracle::naive::{DoubleDouble, Real};
use whitstone_testkit::Random;

/// Columns and rows of the image.
const SIZE: [usize; 2] = [8, 4];

/// Directions close to a critical place of the environment.
pub(crate) struct Sky {
    about: About,
    /// The largest angle, as a power of ten.
    first: i32,
    /// A direction at about this angle from the place, and its exact (u, v), derived from the same
    /// angles without cancellation.
    look: fn(f64, &mut Random) -> (DVec3, [f64; 2]),
    /// Whether the textbook variant wraps the image around.
    naive_wraps: bool,
}

/// Straight up and straight down.
pub(crate) static POLE: Sky = Sky {
    about: About {
        name: "environment_pole",
        catalogue: &[43],
        parameter: "angle between a direction and a pole of the environment map, in radians",
        ..ABOUT
    },
    first: -1,
    look: |angle, random| {
        let (u, theta) = (random.unit(), angle * (1.0 + random.unit()));
        let (sin, cos) = (TAU * (u - 0.5)).sin_cos();
        let (y, v) = match random.below(2) {
            0 => (theta.cos(), 1.0 - theta / PI),
            _ => (-theta.cos(), theta / PI),
        };
        (DVec3::new(theta.sin() * sin, y, -theta.sin() * cos), [u, v])
    },
    naive_wraps: true,
};

/// On both sides of the half circle where u starts.
pub(crate) static SEAM: Sky = Sky {
    about: About {
        name: "environment_seam",
        catalogue: &[43],
        parameter: "angle between a direction and the seam of the environment map, in radians",
        ..ABOUT
    },
    first: 0,
    look: |angle, random| {
        let turn = (angle * (1.0 + random.unit())).copysign(random.signed());
        // Not high enough for the poles to matter.
        let height = 1.1 * random.signed();
        let direction = DVec3::new(height.cos() * turn.sin(), height.sin(), height.cos() * turn.cos());
        (direction, [-turn / TAU, 0.5 + height / PI])
    },
    naive_wraps: false,
};

const ABOUT: About = About {
    name: "",
    catalogue: &[],
    parameter: "",
    measure: "error of the radiance, which is at most 1",
    promise: "1e-12",
    pass: 1e-12,
    usable: 1e-2,
    reach: 1e-15,
    floor: 4.0 * f64::EPSILON,
    limit: None,
};

impl Family for Sky {
    fn about(&self) -> About {
        self.about
    }

    fn parameters(&self) -> Vec<f64> {
        decades(self.first, -15)
    }

    fn step(&self, angle: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let [columns, rows] = SIZE;
        let values = (0..rows).flat_map(|row| (0..columns).map(move |column| texel(column, row)));
        let pipeline = lab.pipeline(&format!(
            "[[light]]\ntype = \"environment\"\nradiance = {{ type = \"solid\", size = [{columns}, {rows}, 1], \
             values = {:?}, mapping = {{ projection = \"uv\" }} }}\n",
            values.collect::<Vec<f64>>()
        ))?;
        let mut random = Random::new(angle.to_bits());
        let [mut ours, mut wide, mut double, mut single] = [Sample::default(); 4];
        for _ in 0..lab.rays {
            let (direction, place) = (self.look)(angle, &mut random);
            let truth = shown(place, true);
            let found = radiance(&pipeline, &Ray::new(DVec3::ZERO, direction)).r;
            ours.add((found - truth).abs());
            wide.add((shown(textbook::<DoubleDouble>(direction), self.naive_wraps) - truth).abs());
            double.add((shown(textbook::<f64>(direction), self.naive_wraps) - truth).abs());
            single.add((shown(textbook::<f32>(direction), self.naive_wraps) - truth).abs());
        }
        Ok(vec![
            (Engine::Whitstone, Ok(ours)),
            (
                Engine::Mitsuba,
                Err("the mapping of directions to texture coordinates is a formula of the driver".to_owned()),
            ),
            (Engine::NaiveDoubleDouble, Ok(wide)),
            (Engine::NaiveF64, Ok(double)),
            (Engine::NaiveF32, Ok(single)),
        ])
    }
}

/// A texel that differs from its neighbours, including those across the seam and between the lowest
/// and the highest row, which are neighbours in the model.
fn texel(column: usize, row: usize) -> f64 {
    ((3 * column + 7 * row) % 16) as f64 / 16.0
}

/// Bilinear interpolation. At the border the image wraps around, or is clamped.
fn shown(place: [f64; 2], wraps: bool) -> f64 {
    let at = [0, 1].map(|axis| place[axis] * SIZE[axis] as f64 - 0.5);
    let low = at.map(f64::floor);
    let mut sum = 0.0;
    for corner in 0..4 {
        let mut share = 1.0;
        let texels = [0, 1].map(|axis| {
            let next = corner >> axis & 1;
            let part = at[axis] - low[axis];
            share *= if next == 1 { part } else { 1.0 - part };
            let (k, count) = (low[axis] as i64 + next, SIZE[axis] as i64);
            (if wraps {
                k.rem_euclid(count)
            } else {
                k.clamp(0, count - 1)
            }) as usize
        });
        sum += share * texel(texels[0], texels[1]);
    }
    sum
}

/// (u, v) by inverse cosines, the textbook form of spherical coordinates: half of all digits are
/// lost where the cosine is flat.
fn textbook<R: Real>(direction: DVec3) -> [f64; 2] {
    let [x, y, z] = direction.to_array().map(R::of);
    let sine = (R::of(1.0) - y * y).sqrt();
    let turn = (-z / sine).acos();
    let turn = if x < R::of(0.0) { -turn } else { turn };
    let (u, v) = (turn / (R::of(2.0) * R::PI), y.acos() / R::PI);
    [(R::of(0.5) + u).to_f64(), (R::of(1.0) - v).to_f64()]
}
