//! Perlin noise: single, in octaves, and as marble and wood.
//!
//! Perlin, *Improving noise*, 2002: gradients towards the edges of a cube are chosen by a table and
//! blended by a polynomial of degree five. The sums of octaves and marble are those of Perlin, *An
//! image synthesizer*, 1985; wood is rings, after Peachey in Ebert et al., *Texturing and
//! Modeling*, 1994.
//!
//! - Twin: Mitsuba, hosted: a Python texture, written from the model.
//! - Example: `scenes/textures/noise.toml`.

use crate::support::mapping::{Mapping, Projection, TextureFunction};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::{Color, Finite, IntegerIn, Positive};
use whitstone_core::hash::mix;
use whitstone_core::{Context, DVec3, Plugin, Rgb, SceneError, SceneErrors, Texture, Textures};

/// Default number of octaves, and factors from one octave to the next.
const DEFAULT_OCTAVES: u32 = 4;
const DEFAULT_LACUNARITY: f64 = 2.0;
const DEFAULT_GAIN: f64 = 0.5;
/// Default displacement of marble and wood, in waves.
const DEFAULT_DISTORTION: f64 = 1.0;

/// Perlin noise: single, in octaves, and as marble and wood.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// "perlin": one octave; "fbm": the mean of the octaves, weighted by amplitude; "turbulence":
    /// the same mean of their absolute values; "marble": waves along x distorted by turbulence;
    /// "wood": rings around the z axis distorted by fbm.
    #[serde(default)]
    kind: Kind,
    /// Colour at the minimum of the noise.
    #[serde(default = "dark")]
    a: Color,
    /// Colour at the maximum of the noise.
    #[serde(default = "light")]
    b: Color,
    /// Cells of the first octave per unit of texture space (a metre by default); for marble and
    /// wood also the number of waves.
    #[serde(default = "one")]
    scale: Positive,
    /// Number of octaves; not for "perlin", which has one.
    #[serde(default)]
    #[schemars(extend("default" = DEFAULT_OCTAVES), with = "IntegerIn<1, 16>")]
    octaves: Option<Spanned<IntegerIn<1, 16>>>,
    /// Factor on the frequency from one octave to the next.
    #[serde(default)]
    #[schemars(extend("default" = DEFAULT_LACUNARITY), with = "Positive")]
    lacunarity: Option<Spanned<Positive>>,
    /// Factor on the amplitude from one octave to the next.
    #[serde(default)]
    #[schemars(extend("default" = DEFAULT_GAIN), with = "Positive")]
    gain: Option<Spanned<Positive>>,
    /// Displacement of "marble" and "wood" by noise, in waves.
    #[serde(default)]
    #[schemars(extend("default" = DEFAULT_DISTORTION), with = "Finite")]
    distortion: Option<Spanned<Finite>>,
    /// Seed that shuffles the permutation table.
    #[serde(default)]
    #[schemars(extend("x-default" = "Perlin's own table"))]
    seed: Option<IntegerIn<0, { u32::MAX }>>,
    /// Mapping of the texture.
    #[serde(default)]
    #[schemars(extend("x-default" = "by world-space position"))]
    mapping: Mapping,
}

fn dark() -> Color {
    Color::grey(0.2)
}

fn light() -> Color {
    Color::grey(0.8)
}

fn one() -> Positive {
    Positive::new(1.0).expect("1 is positive")
}

/// Combination of the octaves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Kind {
    /// One octave.
    #[default]
    Perlin,
    /// Fractional Brownian motion: a weighted mean.
    Fbm,
    /// A weighted mean of absolute values.
    Turbulence,
    /// Waves along x, distorted by turbulence.
    Marble,
    /// Rings around z, distorted by fbm.
    Wood,
}

/// Upper limit of the frequency of the last octave relative to the first, and of the sum of
/// amplitudes.
const MAX: f64 = 1e100;

/// The `noise` texture; see the module documentation.
pub struct Noise {
    kind: Kind,
    a: Rgb,
    b: Rgb,
    scale: f64,
    octaves: u32,
    lacunarity: f64,
    gain: f64,
    /// 1 over the sum of the amplitudes of all octaves.
    share: f64,
    distortion: f64,
    table: Table,
}

impl Plugin<Textures> for Noise {
    const TYPE: &'static str = "noise";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Texture>, SceneErrors> {
        let mut errors = SceneErrors::default();
        let mut useless = |written: Option<std::ops::Range<usize>>, kinds: &str| {
            if let Some(span) = written {
                errors.0.push(SceneError::at(
                    span,
                    format!("only noise of kind {kinds} has this key"),
                ));
            }
        };
        if config.kind == Kind::Perlin {
            let kinds = "\"fbm\", \"turbulence\", \"marble\" or \"wood\"";
            useless(config.octaves.as_ref().map(Spanned::span), kinds);
            useless(config.lacunarity.as_ref().map(Spanned::span), kinds);
            useless(config.gain.as_ref().map(Spanned::span), kinds);
        }
        if !matches!(config.kind, Kind::Marble | Kind::Wood) {
            useless(
                config.distortion.as_ref().map(Spanned::span),
                "\"marble\" or \"wood\"",
            );
        }
        let octaves = match config.kind {
            Kind::Perlin => 1,
            _ => config
                .octaves
                .map_or(DEFAULT_OCTAVES, |octaves| octaves.into_inner().get()),
        };
        let number =
            |key: &Option<Spanned<Positive>>, usual| key.as_ref().map_or(usual, |n| n.get_ref().get());
        let (gain, lacunarity) = (
            number(&config.gain, DEFAULT_GAIN),
            number(&config.lacunarity, DEFAULT_LACUNARITY),
        );
        let amplitudes: f64 = (0..octaves).map(|k| gain.powi(k as i32)).sum();
        // Neither coordinates nor sums may overflow.
        let finest = lacunarity.powi(octaves as i32 - 1);
        for (key, found, what) in [
            (
                &config.lacunarity,
                finest,
                "`lacunarity` to the power of `octaves` - 1",
            ),
            (
                &config.gain,
                amplitudes,
                "the sum of the amplitudes of all octaves",
            ),
        ] {
            if let Some(key) = key
                && found > MAX
            {
                let message = format!("{what} is {found:e}, more than {MAX:e}");
                errors.0.push(
                    SceneError::at(key.span(), message).with_help("choose fewer octaves or a smaller factor"),
                );
            }
        }
        let pattern = Self {
            kind: config.kind,
            a: config.a.get(),
            b: config.b.get(),
            scale: config.scale.get(),
            octaves,
            lacunarity,
            gain,
            share: 1.0 / amplitudes,
            distortion: config
                .distortion
                .map_or(DEFAULT_DISTORTION, |distortion| distortion.into_inner().get()),
            table: Table::new(config.seed.map(IntegerIn::get)),
        };
        match errors.take(config.mapping.put(Projection::Solid, pattern)) {
            Some(texture) => errors.into_result(texture),
            None => Err(errors),
        }
    }
}

impl Noise {
    /// The mean of all octaves weighted by amplitude, after applying `shape` to each.
    #[inline(always)]
    fn octaves(&self, q: DVec3, shape: impl Fn(f64) -> f64) -> f64 {
        let (mut q, mut amplitude, mut sum) = (q, 1.0, 0.0);
        for _ in 0..self.octaves {
            sum += amplitude * shape(self.table.noise(q));
            q *= self.lacunarity;
            amplitude *= self.gain;
        }
        sum * self.share
    }
}

impl TextureFunction for Noise {
    #[inline(always)]
    fn at(&self, q: DVec3) -> Rgb {
        let q = q * self.scale;
        let wave = |s: f64| 0.5 + 0.5 * libm::sin(TAU * s);
        let t = match self.kind {
            Kind::Perlin | Kind::Fbm => 0.5 + 0.5 * self.octaves(q, |n| n),
            Kind::Turbulence => self.octaves(q, f64::abs),
            Kind::Marble => wave(q.x + self.distortion * self.octaves(q, f64::abs)),
            Kind::Wood => wave(q.truncate().length() + self.distortion * self.octaves(q, |n| n)),
        };
        // NaN, which occurs far outside of every scene, becomes 0.
        let t = if t > 0.0 { t.min(1.0) } else { 0.0 };
        self.a * (1.0 - t) + self.b * t
    }
}

/// A permutation of the numbers below 256.
struct Table([u8; 256]);

impl Table {
    fn new(seed: Option<u32>) -> Self {
        let Some(seed) = seed else {
            return Self(PERLIN);
        };
        // The Fisher-Yates shuffle.
        let mut table: [u8; 256] = std::array::from_fn(|i| i as u8);
        for i in (1..256u32).rev() {
            let j = mix(seed.wrapping_add(mix(i))) % (i + 1);
            table.swap(i as usize, j as usize);
        }
        Self(table)
    }

    /// Noise at a point: 0 at integer coordinates, between about -1 and 1.
    #[inline(always)]
    fn noise(&self, q: DVec3) -> f64 {
        let cell = q.floor();
        let p = q - cell;
        // The remainder is exact for every finite number; NaN becomes 0.
        let corner = (cell - 256.0 * (cell / 256.0).floor())
            .to_array()
            .map(|x| x as usize);
        let at = |i: usize| usize::from(self.0[i & 255]);
        let ease = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
        let between = |t: f64, a: f64, b: f64| a + t * (b - a);
        let slope = |i: usize, j: usize, k: usize| {
            let hash = at(at(at(corner[0] + i) + corner[1] + j) + corner[2] + k);
            let (x, y, z) = (p.x - i as f64, p.y - j as f64, p.z - k as f64);
            let [gx, gy, gz] = GRADIENTS[hash & 15];
            gx * x + gy * y + gz * z
        };
        let (u, v, w) = (ease(p.x), ease(p.y), ease(p.z));
        let along_x = |j: usize, k: usize| between(u, slope(0, j, k), slope(1, j, k));
        let along_y = |k: usize| between(v, along_x(0, k), along_x(1, k));
        between(w, along_y(0), along_y(1))
    }
}

/// Directions to the midpoints of the twelve edges of a cube; four of them appear twice.
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

/// The permutation of Perlin's reference implementation, 2002.
#[rustfmt::skip]
const PERLIN: [u8; 256] = [
    151, 160, 137, 91, 90, 15, 131, 13, 201, 95, 96, 53, 194, 233, 7, 225, 140, 36, 103, 30, 69, 142, 8, 99, 37, 240, 21, 10, 23, 190, 6, 148,
    247, 120, 234, 75, 0, 26, 197, 62, 94, 252, 219, 203, 117, 35, 11, 32, 57, 177, 33, 88, 237, 149, 56, 87, 174, 20, 125, 136, 171, 168, 68, 175,
    74, 165, 71, 134, 139, 48, 27, 166, 77, 146, 158, 231, 83, 111, 229, 122, 60, 211, 133, 230, 220, 105, 92, 41, 55, 46, 245, 40, 244, 102, 143, 54,
    65, 25, 63, 161, 1, 216, 80, 73, 209, 76, 132, 187, 208, 89, 18, 169, 200, 196, 135, 130, 116, 188, 159, 86, 164, 100, 109, 198, 173, 186, 3, 64,
    52, 217, 226, 250, 124, 123, 5, 202, 38, 147, 118, 126, 255, 82, 85, 212, 207, 206, 59, 227, 47, 16, 58, 17, 182, 189, 28, 42, 223, 183, 170, 213,
    119, 248, 152, 2, 44, 154, 163, 70, 221, 153, 101, 155, 167, 43, 172, 9, 129, 22, 39, 253, 19, 98, 108, 110, 79, 113, 224, 232, 178, 185, 112, 104,
    218, 246, 97, 228, 251, 34, 242, 193, 238, 210, 144, 12, 191, 179, 162, 241, 81, 51, 145, 235, 249, 14, 239, 107, 49, 192, 214, 31, 181, 199, 106, 157,
    184, 84, 204, 176, 115, 121, 50, 45, 127, 4, 150, 254, 138, 236, 205, 93, 222, 114, 67, 29, 24, 72, 243, 141, 128, 195, 78, 66, 215, 61, 156, 180,
];

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::SurfaceInteraction;
    use whitstone_testkit::{build, texture_laws};

    #[test]
    fn laws() {
        for kind in ["perlin", "fbm", "turbulence", "marble", "wood"] {
            for more in ["", "scale = 1e200", "seed = 7\nmapping = { projection = \"uv\" }"] {
                let text = format!("kind = \"{kind}\"\n{more}");
                texture_laws(&*build::<Textures, Noise>(&text, ()).unwrap());
            }
        }
    }

    #[test]
    fn noise_is_that_of_perlins_program() {
        // The output of Perlin's Java program of 2002.
        let found = Table::new(None).noise(DVec3::new(314.0 / 100.0, 42.0, 7.0));
        assert!((found - 0.136_919_958_784_000_12).abs() < 1e-15, "{found}");
    }

    /// Noise with the gradients of Perlin's program, from the bits of the hash.
    fn by_bits(table: &Table, q: DVec3) -> f64 {
        let p = |i: usize| usize::from(table.0[i % 256]);
        let ease = |t: f64| t.powi(3) * (10.0 - 15.0 * t + 6.0 * t.powi(2));
        let corner = |number: usize| {
            let side = [number & 1, number >> 1 & 1, number >> 2];
            let [mut weight, mut hash, mut offset] = [1.0, 0.0, 0.0].map(|x| [x; 3]);
            for axis in 0..3 {
                let cell = q[axis].floor();
                let share = ease(q[axis] - cell);
                weight[axis] = [1.0 - share, share][side[axis]];
                hash[axis] = cell.rem_euclid(256.0) + side[axis] as f64;
                offset[axis] = q[axis] - cell - side[axis] as f64;
            }
            let [i, j, k] = hash.map(|i| i as usize);
            let h = p(p(p(i) + j) + k) & 15;
            let [x, y, z] = offset;
            let u = if h < 8 { x } else { y };
            let v = match h {
                0..4 => y,
                12 | 14 => x,
                _ => z,
            };
            let signed = |bit: usize, t: f64| if h & bit == 0 { t } else { -t };
            weight.into_iter().product::<f64>() * (signed(1, u) + signed(2, v))
        };
        (0..8).map(corner).sum()
    }

    #[test]
    fn noise_is_the_sum_over_eight_corners() {
        for table in [Table::new(None), Table::new(Some(3))] {
            for i in 0..200 {
                let q = DVec3::new(7.37, 3.61, 5.83) * f64::from(i) - DVec3::splat(400.0);
                let (found, expected) = (table.noise(q), by_bits(&table, q));
                assert!((found - expected).abs() < 1e-13, "{q}: {found}, not {expected}");
            }
        }
    }

    /// Each kind, written out for two octaves.
    #[test]
    fn kinds_are_sums_of_octaves() {
        let table = Table::new(None);
        for i in 0..40 {
            let p = DVec3::new(0.173, 0.311, -0.247) * f64::from(i);
            let q = 1.5 * p;
            let octaves =
                |shape: fn(f64) -> f64| (shape(table.noise(q)) + 0.25 * shape(table.noise(3.0 * q))) / 1.25;
            let wave = |s: f64| 0.5 + 0.5 * (TAU * s).sin();
            let [signed, positive] = [octaves(|n| n), octaves(f64::abs)];
            for (kind, t) in [
                ("fbm", 0.5 + 0.5 * signed),
                ("turbulence", positive),
                ("marble", wave(q.x + 0.75 * positive)),
                ("wood", wave(q.x.hypot(q.y) + 0.75 * signed)),
            ] {
                let waves = ["marble", "wood"].contains(&kind);
                let distortion = if waves { "distortion = 0.75" } else { "" };
                let text = format!(
                    "kind = \"{kind}\"\na = 0.25\nb = 2\nscale = 1.5\noctaves = 2\nlacunarity = 3\ngain = 0.25\n{distortion}"
                );
                let point = SurfaceInteraction::new(p, 0.0, DVec3::Z);
                let found = build::<Textures, Noise>(&text, ()).unwrap().value(&point).g;
                let expected = 0.25 * (1.0 - t) + 2.0 * t;
                assert!(
                    (found - expected).abs() < 1e-12,
                    "{kind} at {p}: {found}, not {expected}"
                );
            }
        }
    }

    #[test]
    fn tables_are_permutations_and_differ() {
        let tables = [None, Some(0), Some(1)].map(|seed| Table::new(seed).0);
        for mut table in tables {
            table.sort_unstable();
            assert!(table.iter().enumerate().all(|(i, x)| i == usize::from(*x)));
        }
        assert!(tables[0] != tables[1] && tables[1] != tables[2]);
    }

    #[test]
    fn noise_repeats_after_256_cells_and_is_smooth_across_them() {
        let table = Table::new(Some(3));
        for i in 0..200 {
            let q = DVec3::new(0.37, 0.61, 0.83) * f64::from(i) - DVec3::splat(40.0);
            let far = table.noise(q + DVec3::new(256.0, -512.0, 1024.0));
            assert!((table.noise(q) - far).abs() < 1e-11, "{q}");
            let edge = DVec3::new(q.x.floor(), q.y, q.z);
            let slope = |d: f64| (table.noise(edge + DVec3::X * d) - table.noise(edge)) / d;
            assert!((slope(1e-6) - slope(-1e-6)).abs() < 1e-4, "{edge}");
            assert!(table.noise(q).abs() <= 1.1);
        }
    }

    #[test]
    fn octaves_are_a_mean_and_colours_lie_between_both() {
        let value = |text: &str, x: f64| {
            let point = SurfaceInteraction::new(DVec3::new(x, 0.4, 0.7), 0.0, DVec3::Z);
            let texture = build::<Textures, Noise>(&format!("a = 0\nb = 1\n{text}"), ()).unwrap();
            texture.value(&point).g
        };
        for i in 0..20 {
            let x = 0.173 * f64::from(i);
            let single = value("", x);
            assert_eq!(value("kind = \"fbm\"\noctaves = 1", x), single);
            // With equal octaves, the mean is each of them.
            let alike = value("kind = \"fbm\"\noctaves = 3\nlacunarity = 1\ngain = 0.7", x);
            assert!((alike - single).abs() < 1e-15);
            let turbulence = value("kind = \"turbulence\"\noctaves = 1", x);
            assert!((turbulence - (2.0 * single - 1.0).abs()).abs() < 1e-15);
        }
    }

    #[test]
    fn keys_without_effect_are_refused_at_their_places() {
        let text = "octaves = 3\ndistortion = 1";
        let errors = build::<Textures, Noise>(text, ()).err().unwrap().0;
        let places: Vec<&str> = errors.iter().map(|e| &text[e.span.clone().unwrap()]).collect();
        assert_eq!(places, ["3", "1"]);
    }

    #[test]
    fn octaves_that_overflow_are_refused_at_their_places() {
        let text = "kind = \"fbm\"\nlacunarity = 1e40\ngain = 1e300";
        let errors = build::<Textures, Noise>(text, ()).err().unwrap().0;
        let places: Vec<&str> = errors.iter().map(|e| &text[e.span.clone().unwrap()]).collect();
        assert_eq!(places, ["1e40", "1e300"]);
        // The highest frequency is that of the last octave, and the limit itself is allowed.
        let lacunarity = |text: &str| build::<Textures, Noise>(&format!("kind = \"fbm\"\n{text}"), ());
        assert!(lacunarity("octaves = 2\nlacunarity = 1e100").is_ok());
        assert!(lacunarity("octaves = 3\nlacunarity = 1e51").is_err());
    }
}
