//! Noise textures: section 10 of the model.

use super::mapping::{MappingConfig, TextureFunction};
use super::pattern::colors;
use crate::shapes::heightfield::m;
use serde::Deserialize;
use std::f64::consts::TAU;
use whitstone_core::config::Color;
use whitstone_core::{DVec3, Rgb};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NoiseConfig {
    kind: Option<String>,
    a: Option<Color>,
    b: Option<Color>,
    scale: Option<f64>,
    seed: Option<u32>,
    octaves: Option<i32>,
    lacunarity: Option<f64>,
    gain: Option<f64>,
    distortion: Option<f64>,
    pub(super) mapping: Option<MappingConfig>,
}

pub(super) struct Noise {
    kind: Kind,
    colors: [Rgb; 2],
    scale: f64,
    octaves: i32,
    lacunarity: f64,
    gain: f64,
    distortion: f64,
    table: [usize; 256],
}

enum Kind {
    Perlin,
    Fbm,
    Turbulence,
    Marble,
    Wood,
}

/// Perlin's permutation of 2002.
const PERLIN: [usize; 256] = [
    151, 160, 137, 91, 90, 15, 131, 13, 201, 95, 96, 53, 194, 233, 7, 225, 140, 36, 103, 30, 69, 142, 8, 99,
    37, 240, 21, 10, 23, 190, 6, 148, 247, 120, 234, 75, 0, 26, 197, 62, 94, 252, 219, 203, 117, 35, 11, 32,
    57, 177, 33, 88, 237, 149, 56, 87, 174, 20, 125, 136, 171, 168, 68, 175, 74, 165, 71, 134, 139, 48, 27,
    166, 77, 146, 158, 231, 83, 111, 229, 122, 60, 211, 133, 230, 220, 105, 92, 41, 55, 46, 245, 40, 244,
    102, 143, 54, 65, 25, 63, 161, 1, 216, 80, 73, 209, 76, 132, 187, 208, 89, 18, 169, 200, 196, 135, 130,
    116, 188, 159, 86, 164, 100, 109, 198, 173, 186, 3, 64, 52, 217, 226, 250, 124, 123, 5, 202, 38, 147,
    118, 126, 255, 82, 85, 212, 207, 206, 59, 227, 47, 16, 58, 17, 182, 189, 28, 42, 223, 183, 170, 213, 119,
    248, 152, 2, 44, 154, 163, 70, 221, 153, 101, 155, 167, 43, 172, 9, 129, 22, 39, 253, 19, 98, 108, 110,
    79, 113, 224, 232, 178, 185, 112, 104, 218, 246, 97, 228, 251, 34, 242, 193, 238, 210, 144, 12, 191, 179,
    162, 241, 81, 51, 145, 235, 249, 14, 239, 107, 49, 192, 214, 31, 181, 199, 106, 157, 184, 84, 204, 176,
    115, 121, 50, 45, 127, 4, 150, 254, 138, 236, 205, 93, 222, 114, 67, 29, 24, 72, 243, 141, 128, 195, 78,
    66, 215, 61, 156, 180,
];

const GRADIENTS: [[f64; 3]; 16] = [
    [1.0, 1.0, 0.0],
    [-1.0, 1.0, 0.0],
    [1.0, -1.0, 0.0],
    [-1.0, -1.0, 0.0],
    [1.0, 0.0, 1.0],
    [-1.0, 0.0, 1.0],
    [1.0, 0.0, -1.0],
    [-1.0, 0.0, -1.0],
    [0.0, 1.0, 1.0],
    [0.0, -1.0, 1.0],
    [0.0, 1.0, -1.0],
    [0.0, -1.0, -1.0],
    [1.0, 1.0, 0.0],
    [0.0, -1.0, 1.0],
    [-1.0, 1.0, 0.0],
    [0.0, -1.0, -1.0],
];

impl Noise {
    pub(super) fn new(config: &NoiseConfig) -> Self {
        let table = config.seed.map_or(PERLIN, |seed| {
            let mut table: [usize; 256] = std::array::from_fn(|i| i);
            for i in (1..256_u32).rev() {
                let other = m(seed.wrapping_add(m(i))) % (i + 1);
                table.swap(i as usize, other as usize);
            }
            table
        });
        Self {
            kind: match config.kind.as_deref() {
                Some("fbm") => Kind::Fbm,
                Some("turbulence") => Kind::Turbulence,
                Some("marble") => Kind::Marble,
                Some("wood") => Kind::Wood,
                _ => Kind::Perlin,
            },
            colors: colors(config.a, config.b, [0.2, 0.8]),
            scale: config.scale.unwrap_or(1.0),
            octaves: config.octaves.unwrap_or(4),
            lacunarity: config.lacunarity.unwrap_or(2.0),
            gain: config.gain.unwrap_or(0.5),
            distortion: config.distortion.unwrap_or(1.0),
            table,
        }
    }

    /// The noise N of the model.
    fn one(&self, p: DVec3) -> f64 {
        let c = p.floor();
        let f = p - c;
        let cell = c.to_array().map(|x| x.rem_euclid(256.0) as usize);
        let corner = |i: usize, j: usize, k: usize| {
            let mut h = 0;
            for (number, step) in cell.into_iter().zip([i, j, k]) {
                h = self.table[(h + number + step) % 256];
            }
            let g = DVec3::from_array(GRADIENTS[h % 16]);
            (f - DVec3::new(i as f64, j as f64, k as f64)).dot(g)
        };
        let s = f * f * f * (f * (6.0 * f - 15.0) + 10.0);
        let between = |s: f64, x: f64, y: f64| x + s * (y - x);
        let row = |j: usize, k: usize| between(s.x, corner(0, j, k), corner(1, j, k));
        let sheet = |k: usize| between(s.y, row(0, k), row(1, k));
        between(s.z, sheet(0), sheet(1))
    }

    /// The sum S of the model, or A for absolute values.
    fn sum(&self, p: DVec3, of: fn(f64) -> f64) -> f64 {
        let (mut sum, mut gains) = (0.0, 0.0);
        for k in 0..self.octaves {
            let gain = self.gain.powi(k);
            sum += gain * of(self.one(p * self.lacunarity.powi(k)));
            gains += gain;
        }
        sum / gains
    }
}

impl TextureFunction for Noise {
    fn at(&self, q: DVec3) -> Rgb {
        let p = q * self.scale;
        let plain = |n: f64| n;
        let wave = |x: f64| 0.5 * (1.0 + (TAU * x).sin());
        let t = match self.kind {
            Kind::Perlin => 0.5 * (1.0 + self.one(p)),
            Kind::Fbm => 0.5 * (1.0 + self.sum(p, plain)),
            Kind::Turbulence => self.sum(p, f64::abs),
            Kind::Marble => wave(p.x + self.distortion * self.sum(p, f64::abs)),
            Kind::Wood => wave(p.x.hypot(p.y) + self.distortion * self.sum(p, plain)),
        };
        let t = t.clamp(0.0, 1.0);
        self.colors[0] * (1.0 - t) + self.colors[1] * t
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct WorleyConfig {
    value: Option<String>,
    a: Option<Color>,
    b: Option<Color>,
    scale: Option<f64>,
    #[serde(default)]
    seed: u32,
    pub(super) mapping: Option<MappingConfig>,
}

pub(super) struct Worley {
    /// Weights of the distances F1 and F2.
    weights: [f64; 2],
    colors: [Rgb; 2],
    scale: f64,
    seed: u32,
}

impl Worley {
    pub(super) fn new(config: &WorleyConfig) -> Self {
        Self {
            weights: match config.value.as_deref() {
                Some("f2") => [0.0, 1.0],
                Some("f2_minus_f1") => [-1.0, 1.0],
                _ => [1.0, 0.0],
            },
            colors: colors(config.a, config.b, [0.2, 0.8]),
            scale: config.scale.unwrap_or(1.0),
            seed: config.seed,
        }
    }
}

impl TextureFunction for Worley {
    fn at(&self, q: DVec3) -> Rgb {
        let p = q * self.scale;
        let cell = p.floor();
        let mut nearest = [f64::INFINITY; 2];
        // A feature point lies within sqrt(3) of any point of its cell, and within 2 sqrt(3) of any
        // point of a neighbouring cell.
        for step in 0..9_i32.pow(3) {
            let offset = [step % 9 - 4, step / 9 % 9 - 4, step / 81 - 4];
            let place: [f64; 3] = std::array::from_fn(|axis| cell[axis] + f64::from(offset[axis]));
            // Modulo 2^32.
            let [i, j, k] = place.map(|x| x as i64 as u32);
            let h = m(m(m(m(self.seed).wrapping_add(k)).wrapping_add(j)).wrapping_add(i));
            let part = |n: u32| f64::from(m(h.wrapping_add(n))) / 4_294_967_296.0;
            let feature = DVec3::from_array(place) + DVec3::new(part(1), part(2), part(3));
            let distance = feature.distance(p);
            if distance < nearest[0] {
                nearest = [distance, nearest[0]];
            } else if distance < nearest[1] {
                nearest[1] = distance;
            }
        }
        let t = (self.weights[0] * nearest[0] + self.weights[1] * nearest[1]).clamp(0.0, 1.0);
        self.colors[0] * (1.0 - t) + self.colors[1] * t
    }
}
