//! Samplers: section 5 of the model.

use super::unknown;
use crate::shapes::heightfield::m;
use serde::Deserialize;
use whitstone_core::SceneErrors;
use whitstone_core::config::decode;
use whitstone_scene::PluginTable;

/// Sample positions in a pixel.
pub(super) enum Sampler {
    /// The same positions in every pixel.
    Fixed(Vec<[f64; 2]>),
    /// `n` strata along each axis.
    Stratified { n: u32, seed: u32 },
    /// Points of the Sobol sequence.
    Sobol { samples: u32, seed: u32 },
    /// `initial_samples` of these points, then more up to `samples` where they are needed.
    Adaptive {
        samples: u32,
        seed: u32,
        first: usize,
        threshold: f64,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Adaptive {
    samples: Option<u32>,
    initial_samples: Option<u32>,
    threshold: Option<f64>,
    #[serde(default)]
    seed: u32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Cells {
    #[serde(default = "two")]
    samples_per_axis: u32,
    #[serde(default)]
    seed: u32,
}

fn two() -> u32 {
    2
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sobol {
    #[serde(default = "four")]
    samples: u32,
    #[serde(default)]
    seed: u32,
}

fn four() -> u32 {
    4
}

impl Sampler {
    /// Section 5 of the model: without a table, one sample in the centre.
    pub(super) fn new(plugin: Option<&PluginTable<'_>>) -> Result<Self, SceneErrors> {
        let Some(plugin) = plugin else {
            return Ok(Self::Fixed(vec![[0.5; 2]]));
        };
        Ok(match &*plugin.name {
            "center" => Self::Fixed(vec![[0.5; 2]]),
            "grid" => {
                let Cells {
                    samples_per_axis: n, ..
                } = decode(&plugin.table)?;
                let at = |i: u32| (f64::from(i) + 0.5) / f64::from(n);
                Self::Fixed((0..n).flat_map(|b| (0..n).map(move |a| [at(a), at(b)])).collect())
            }
            "stratified" => {
                let Cells {
                    samples_per_axis: n,
                    seed,
                } = decode(&plugin.table)?;
                Self::Stratified { n, seed }
            }
            "sobol" => {
                let Sobol { samples, seed } = decode(&plugin.table)?;
                Self::Sobol { samples, seed }
            }
            "adaptive" => {
                let config: Adaptive = decode(&plugin.table)?;
                let samples = config.samples.unwrap_or(256);
                Self::Adaptive {
                    samples,
                    seed: config.seed,
                    first: config.initial_samples.unwrap_or(samples.min(8)) as usize,
                    threshold: config.threshold.unwrap_or(0.01),
                }
            }
            _ => return Err(unknown(plugin, "sampler")),
        })
    }

    /// Number of samples per pixel; for adaptive sampling, of the first pass.
    pub(super) fn at_first(&self) -> usize {
        match self {
            Self::Fixed(all) => all.len(),
            Self::Stratified { n, .. } => (n * n) as usize,
            Self::Sobol { samples, .. } => *samples as usize,
            Self::Adaptive { first, .. } => *first,
        }
    }

    /// All positions in a pixel, in their order.
    pub(super) fn positions(&self, [i, j]: [u32; 2]) -> Vec<[f64; 2]> {
        let pixel = |seed: u32| m(m(m(seed).wrapping_add(j)).wrapping_add(i));
        match *self {
            Self::Fixed(ref all) => all.clone(),
            Self::Stratified { n, seed } => {
                let p = pixel(seed);
                let side = f64::from(n);
                let place = |s: u32| {
                    let h = m(p.wrapping_add(s));
                    let [x, y] = [1, 2].map(|k| part(m(h.wrapping_add(k))));
                    [(f64::from(s % n) + x) / side, (f64::from(s / n) + y) / side]
                };
                (0..n * n).map(place).collect()
            }
            Self::Sobol { samples, seed } | Self::Adaptive { samples, seed, .. } => {
                let p = pixel(seed);
                let place = |s: u32| {
                    let x = s.reverse_bits();
                    let mut y = 0;
                    let mut v = 1_u32 << 31;
                    for bit in 0..32 {
                        if s >> bit & 1 == 1 {
                            y ^= v;
                        }
                        v ^= v >> 1;
                    }
                    let scrambled = |x: u32, k: u32| {
                        part(laine_karras(x.reverse_bits(), m(p.wrapping_add(k))).reverse_bits())
                    };
                    [scrambled(x, 1), scrambled(y, 2)]
                };
                (0..samples).map(place).collect()
            }
        }
    }
}

/// A number in [0, 1).
fn part(x: u32) -> f64 {
    f64::from(x) / 4_294_967_296.0
}

fn laine_karras(mut x: u32, q: u32) -> u32 {
    x = x.wrapping_add(q);
    for k in [0x6c50_b47c_u32, 0xb82f_1e52, 0xc7af_e638, 0x8d22_f6e6] {
        x ^= x.wrapping_mul(k);
    }
    x
}
