//! A picture of any size, quilted out of pieces of a small sample.
//!
//! Efros and Freeman, *Image quilting for texture synthesis and transfer*, 2001, section 2: each square is a piece of the sample that nearly agrees with its
//! neighbours where they overlap, and is cut along the path on which they differ least. All errors are whole numbers, so that every machine, and the
//! reference, choose the same pieces.
//!
//! - Twin: Mitsuba `bitmap` (native), of a picture quilted in Python, written from the model.
//! - Example: `scenes/textures/synthesized.toml`.

use crate::mapping::{Mapping, Projection};
use crate::raster::{ColorSpace, Filter, Lookup, MaxAnisotropy, Raster};
use crate::wrap::Wraps;
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::{FilePath, IntegerIn, NonNegative, Scale2, Vector2};
use whitstone_core::hash::mix;
use whitstone_core::{Context, Plugin, SceneError, SceneErrors, Texture, Textures};
use whitstone_image::limits::Limits;
use whitstone_image::texels::{self, Encoding, Texels};

/// A picture of any size, quilted out of pieces of a small sample.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The sample, a PNG or JPEG file of 8 bits, relative to the scene.
    file: FilePath,
    /// Columns and rows of texels to make.
    #[schemars(with = "[IntegerIn<1, 4096>; 2]")]
    size: Spanned<[IntegerIn<1, 4096>; 2]>,
    /// Side of the square pieces in texels: about the size of what is to be recognised.
    #[schemars(with = "Option<IntegerIn<2, 256>>")]
    block: Option<Spanned<IntegerIn<2, 256>>>,
    /// Texels by which neighbours overlap, at most half a block; a quarter of it, at least 1, if left out.
    #[schemars(with = "Option<IntegerIn<1, 128>>")]
    overlap: Option<Spanned<IntegerIn<1, 128>>>,
    /// How much worse than the best a piece may fit, as a share of its error: with 0 the sample is repeated more.
    #[serde(default = "tenth")]
    tolerance: NonNegative,
    /// Chooses other pieces.
    #[serde(default = "first")]
    seed: IntegerIn<0, { u32::MAX }>,
    /// Between texel centres: "bilinear" interpolation, or the "nearest" texel. What several texels fall into one sample of: "trilinear" looks up a
    /// pyramid of ever coarser levels, "ewa" takes the mean over the ellipse that a sample covers; both are bilinear where samples are closer than texels,
    /// and take 4 bytes more for each texel.
    #[serde(default)]
    filter: Filter,
    /// Of "ewa": how many times longer than wide the ellipse of a sample may be; a longer one is made wider, so that no lookup reads texels
    /// without end. 16 if left out.
    #[schemars(with = "Option<IntegerIn<1, 64>>")]
    max_anisotropy: MaxAnisotropy,
    /// Outside of the picture: "repeat" it, "clamp" to its border, or "mirror" it.
    #[serde(default)]
    wrap: Wraps,
    /// What the values in the file are: "srgb", "linear", or "auto", which is sRGB.
    #[serde(default)]
    color_space: ColorSpace,
    /// Pictures in a unit of u and of v.
    #[serde(default = "one")]
    scale: Scale2,
    /// Added after scaling.
    #[serde(default = "zero")]
    offset: Vector2,
    /// Where the texture lies; by (u, v) if left out.
    #[serde(default)]
    mapping: Mapping,
}

fn tenth() -> NonNegative {
    NonNegative::new(0.1).expect("0.1 is not negative")
}

fn first() -> IntegerIn<0, { u32::MAX }> {
    IntegerIn::new(0).expect("0 is in range")
}

fn one() -> Scale2 {
    Scale2::splat(1.0)
}

fn zero() -> Vector2 {
    Vector2::new(0.0, 0.0)
}

/// The most channels that are compared: some seconds.
const MOST_STEPS: u64 = 1 << 33;

/// See the module.
pub struct Synthesized;

impl Plugin<Textures> for Synthesized {
    const TYPE: &'static str = "synthesized";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Texture>, SceneErrors> {
        let path = context.file(&config.file)?;
        let refuse = |why: String| {
            let message = format!("\"{}\" is no sample: {why}", config.file.path);
            SceneErrors::from(SceneError::at(config.file.span.clone(), message))
        };
        let texels = texels::read(&path, Limits::TEXTURE).map_err(|error| refuse(error.fault.to_string()))?;
        if texels.encoding != Encoding::Srgb8 {
            return Err(refuse("expected 8 bits a channel".to_owned()));
        }
        let sample = Codes::of(&texels);
        let block = config.block.as_ref().map_or(16, |n| n.get_ref().get()) as usize;
        if block > sample.width.min(sample.height) {
            let message = format!(
                "expected a block within the sample, which has {} x {} texels, found {block}",
                sample.width, sample.height
            );
            let place = config.block.map_or(config.file.span, |block| block.span());
            return Err(SceneError::at(place, message).into());
        }
        let overlap = match &config.overlap {
            None => (block / 4).max(1),
            Some(overlap) => {
                let found = overlap.get_ref().get() as usize;
                if 2 * found > block {
                    let message = format!("expected at most half a block, which is {block}, found {found}");
                    return Err(SceneError::at(overlap.span(), message).into());
                }
                found
            }
        };
        let quilt = Quilt {
            size: config.size.get_ref().map(|n| n.get() as usize),
            block,
            overlap,
            tolerance: config.tolerance.get(),
            seed: config.seed.get(),
        };
        let steps = quilt.steps(&sample);
        if steps > MOST_STEPS {
            let message = format!("to make this takes {steps} comparisons, more than {MOST_STEPS}");
            return Err(SceneError::at(config.size.span(), message)
                .with_help("choose a smaller size or sample, or larger blocks")
                .into());
        }
        context.reserve(quilt.bytes())?;
        let store = quilt.make(&sample).store(config.color_space);
        let lookup = Lookup {
            filter: config.filter,
            wrap: config.wrap.0,
            scale: config.scale.get(),
            offset: config.offset.get(),
        };
        let pattern = Raster::new(quilt.size, store, lookup, config.max_anisotropy, context)?;
        config.mapping.put(Projection::Uv, pattern)
    }
}

/// 8-bit texels, the top row first.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Codes {
    width: usize,
    height: usize,
    data: Vec<[u8; 3]>,
}

impl Codes {
    fn of(texels: &Texels) -> Self {
        // Rounding gives back the code, of which the value is the nearest f32.
        let code = |value: f32| (f64::from(value) * 255.0).round() as u8;
        Self {
            width: texels.width,
            height: texels.height,
            data: texels.data.iter().map(|texel| texel.map(code)).collect(),
        }
    }

    fn row(&self, x: usize, y: usize, length: usize) -> &[[u8; 3]] {
        &self.data[y * self.width + x..][..length]
    }

    fn store(self, color_space: ColorSpace) -> crate::raster::Store {
        crate::raster::Store::eight(self.data, color_space != ColorSpace::Linear)
    }
}

/// How two texels differ: the sum of the squares over the channels.
fn difference(a: [u8; 3], b: [u8; 3]) -> u32 {
    (0..3).map(|k| u32::from(a[k].abs_diff(b[k])).pow(2)).sum()
}

/// The same of rows; at most 256 texels long, so that nothing overflows.
fn differences(a: &[[u8; 3]], b: &[[u8; 3]]) -> u32 {
    a.iter().zip(b).map(|(a, b)| difference(*a, *b)).sum()
}

/// What is to be made.
struct Quilt {
    size: [usize; 2],
    block: usize,
    overlap: usize,
    tolerance: f64,
    seed: u32,
}

impl Quilt {
    /// How many blocks stand side by side along an axis.
    fn count(&self, axis: usize) -> usize {
        1 + self.size[axis]
            .saturating_sub(self.block)
            .div_ceil(self.block - self.overlap)
    }

    /// Texels of all blocks along an axis.
    fn extent(&self, axis: usize) -> usize {
        self.block + (self.count(axis) - 1) * (self.block - self.overlap)
    }

    /// Comparisons of channels, at most.
    fn steps(&self, sample: &Codes) -> u64 {
        let places = (sample.width - self.block + 1) as u64 * (sample.height - self.block + 1) as u64;
        let strip = (self.overlap * (2 * self.block - self.overlap)) as u64;
        // At most 2^28 * 2^16 * 2^24: the last may overflow.
        (3 * strip * places).saturating_mul((self.count(0) * self.count(1)) as u64)
    }

    /// Memory for the canvas and for what is cut out of it.
    fn bytes(&self) -> u64 {
        3 * (self.extent(0) * self.extent(1) + self.size[0] * self.size[1]) as u64
    }

    fn make(&self, sample: &Codes) -> Codes {
        let (width, height) = (self.extent(0), self.extent(1));
        let mut canvas = Codes {
            width,
            height,
            data: vec![[0; 3]; width * height],
        };
        for r in 0..self.count(1) {
            for c in 0..self.count(0) {
                self.place(&mut canvas, sample, c, r);
            }
        }
        let [columns, rows] = self.size;
        Codes {
            width: columns,
            height: rows,
            data: (0..rows)
                .flat_map(|j| canvas.row(0, j, columns).to_vec())
                .collect(),
        }
    }

    /// Puts a piece at column c and row r of the blocks.
    fn place(&self, canvas: &mut Codes, sample: &Codes, c: usize, r: usize) {
        let step = self.block - self.overlap;
        let corner = [c * step, r * step];
        let (from_left, from_top) = (c > 0, r > 0);
        let [x, y] = self.choose(canvas, sample, corner, [c, r]);
        let error = |i: usize, j: usize| {
            let old = canvas.data[(corner[1] + j) * canvas.width + corner[0] + i];
            difference(old, sample.data[(y + j) * sample.width + x + i])
        };
        let left = from_left.then(|| self.seam(|along, across| error(across, along)));
        let top = from_top.then(|| self.seam(error));
        for j in 0..self.block {
            for i in 0..self.block {
                let inside = left.as_ref().is_none_or(|seam| i >= seam[j])
                    && top.as_ref().is_none_or(|seam| j >= seam[i]);
                if inside {
                    let at = (corner[1] + j) * canvas.width + corner[0] + i;
                    canvas.data[at] = sample.data[(y + j) * sample.width + x + i];
                }
            }
        }
    }

    /// Which piece of the sample: its left top corner.
    fn choose(&self, canvas: &Codes, sample: &Codes, corner: [usize; 2], [c, r]: [usize; 2]) -> [usize; 2] {
        let columns = sample.width - self.block + 1;
        let rows = sample.height - self.block + 1;
        let mut errors = Vec::with_capacity(columns * rows);
        for y in 0..rows {
            for x in 0..columns {
                let mut sum = 0;
                for j in 0..self.block {
                    let length = match (r > 0 && j < self.overlap, c > 0) {
                        (true, _) => self.block,
                        (false, true) => self.overlap,
                        (false, false) => break,
                    };
                    let old = canvas.row(corner[0], corner[1] + j, length);
                    sum += u64::from(differences(old, sample.row(x, y + j, length)));
                }
                errors.push(sum);
            }
        }
        // Of the least that is not 0: where the sample goes on as it does there, that would be the only one.
        let least = errors.iter().copied().filter(|e| *e > 0).min().unwrap_or(0);
        let most = least as f64 * (1.0 + self.tolerance);
        let fits = |e: &u64| *e as f64 <= most;
        let count = errors.iter().filter(|e| fits(e)).count();
        let hash = mix(mix(mix(self.seed).wrapping_add(r as u32)).wrapping_add(c as u32));
        let chosen = hash as usize % count;
        let at = (0..errors.len())
            .filter(|at| fits(&errors[*at]))
            .nth(chosen)
            .expect("one of those that were counted");
        [at % columns, at / columns]
    }

    /// For each step along a strip, the first texel across it that is new: a path on which both sides differ least in sum.
    fn seam(&self, error: impl Fn(usize, usize) -> u32) -> Vec<usize> {
        // The least sum up to each texel, step by step.
        let mut sums: Vec<Vec<u32>> = Vec::with_capacity(self.block);
        let around = |across: usize| across.saturating_sub(1)..(across + 2).min(self.overlap);
        for along in 0..self.block {
            let row = (0..self.overlap)
                .map(|across| {
                    let before = sums.last().map_or(0, |sums| {
                        sums[around(across)]
                            .iter()
                            .copied()
                            .min()
                            .expect("at least itself")
                    });
                    before + error(along, across)
                })
                .collect();
            sums.push(row);
        }
        // `min_by_key` gives the first of several.
        let lowest = |sums: &[u32], among: std::ops::Range<usize>| {
            among.min_by_key(|across| sums[*across]).expect("at least one")
        };
        let mut seam = vec![0; self.block];
        let mut among = 0..self.overlap;
        for along in (0..self.block).rev() {
            seam[along] = lowest(&sums[along], among);
            among = around(seam[along]);
        }
        seam
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{TestContext, build_in, texture_laws};

    /// Noise of two tones, from the hash.
    fn sample(width: usize, height: usize) -> Codes {
        let texel = |at: usize| {
            let hash = mix(at as u32 / 3);
            [(hash & 0xff) as u8, (hash >> 8 & 0x3f) as u8, 7]
        };
        Codes {
            width,
            height,
            data: (0..width * height).map(texel).collect(),
        }
    }

    fn quilt(seed: u32) -> Quilt {
        Quilt {
            size: [41, 30],
            block: 8,
            overlap: 3,
            tolerance: 0.2,
            seed,
        }
    }

    fn write(folder: &std::path::Path) {
        let sample = sample(20, 17);
        let raster = whitstone_image::png::Raster::from_fn(20, 17, |x, y| sample.data[y * 20 + x]);
        raster.write_png(folder.join("a.png")).unwrap();
        let deep = whitstone_image::planes::Image::from_rgb(1, 1, &[[0.5; 3]]).unwrap();
        whitstone_image::exr_io::write(folder.join("a.exr"), &deep).unwrap();
    }

    fn build(text: &str) -> Result<Arc<dyn Texture>, SceneErrors> {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path());
        build_in::<Textures, Synthesized>(text, (), &mut TestContext::in_folder(folder.path()))
    }

    #[test]
    fn laws() {
        for more in [
            "filter = \"nearest\"\nwrap = \"mirror\"",
            "scale = 1e200\nseed = 4294967295",
        ] {
            texture_laws(&*build(&format!("file = \"a.png\"\nsize = [33, 20]\nblock = 6\n{more}")).unwrap());
        }
    }

    #[test]
    fn every_texel_is_one_of_the_sample_and_seeds_differ() {
        let from = sample(20, 17);
        let made = [0, 1].map(|seed| quilt(seed).make(&from));
        assert_eq!((made[0].width, made[0].height), (41, 30));
        assert!(made[0] != made[1]);
        assert_eq!(made[0], quilt(0).make(&from));
        assert!(made[0].data.iter().all(|texel| from.data.contains(texel)));
    }

    #[test]
    fn neighbours_agree() {
        // Smooth waves: where pieces do not fit, neighbouring texels differ.
        let wave = |x: usize, y: usize| {
            (128.0 + 60.0 * (0.7 * x as f64).sin() + 60.0 * (0.5 * y as f64).cos()) as u8
        };
        let from = Codes {
            width: 20,
            height: 20,
            data: (0..400).map(|at| [wave(at % 20, at / 20); 3]).collect(),
        };
        let roughness = |tolerance: f64| -> u32 {
            let made = Quilt {
                tolerance,
                ..quilt(5)
            }
            .make(&from);
            (0..30)
                .map(|j| differences(&made.row(0, j, 41)[1..], made.row(0, j, 40)))
                .sum()
        };
        let (chosen, random) = (roughness(0.0), roughness(1e9));
        assert!(3 * chosen < 2 * random, "{chosen}, at random {random}");
    }

    #[test]
    fn seams_are_the_cheapest_paths() {
        let quilt = Quilt {
            block: 6,
            overlap: 3,
            ..quilt(0)
        };
        for case in 0..50 {
            let error = |along: usize, across: usize| mix(case * 1000 + (along * 3 + across) as u32) % 16;
            let cost = |seam: &[usize]| -> u32 { (0..6).map(|along| error(along, seam[along])).sum() };
            // All paths, one by one.
            let least = (0..3usize.pow(6))
                .map(|number| (0..6).map(|k| number / 3usize.pow(k) % 3).collect::<Vec<_>>())
                .filter(|seam| seam.windows(2).all(|pair| pair[0].abs_diff(pair[1]) <= 1))
                .map(|seam| cost(&seam))
                .min()
                .unwrap();
            let found = quilt.seam(error);
            assert!(found.windows(2).all(|pair| pair[0].abs_diff(pair[1]) <= 1));
            assert_eq!(cost(&found), least);
        }
    }

    #[test]
    fn what_cannot_be_made_is_refused_at_its_place() {
        for (text, place, why) in [
            ("file = \"a.exr\"\nsize = [9, 9]", "\"a.exr\"", "8 bits"),
            (
                "file = \"a.png\"\nsize = [9, 9]\nblock = 18",
                "18",
                "20 x 17 texels",
            ),
            (
                "file = \"a.png\"\nsize = [9, 9]\nblock = 9\noverlap = 5",
                "5",
                "half a block",
            ),
            ("file = \"a.png\"\nsize = [0, 9]", "0", "an integer from 1"),
        ] {
            let error = build(text).err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], place, "{text}");
            assert!(error.message.contains(why), "{}", error.message);
        }
        let huge = Quilt {
            size: [4096, 4096],
            block: 2,
            overlap: 1,
            ..quilt(0)
        };
        assert!(huge.steps(&sample(512, 512)) > MOST_STEPS);
    }
}
