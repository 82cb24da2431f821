//! Texture synthesis: an image of any size, quilted from pieces of a small sample.
//!
//! Efros and Freeman, *Image quilting for texture synthesis and transfer*, 2001, section 2: each
//! square is a piece of the sample that nearly matches its neighbours in the overlap, and is cut
//! along the path with the least difference. Optionally, the result is then brought closer to the
//! sample (Kwatra, Essa, Bobick and Kwatra, *Texture optimization for example-based synthesis*,
//! 2005), by plain or by robust least squares, with neighbourhoods of several sides and at several
//! resolutions. All errors and weights are integers, so every machine and the reference choose the
//! same pieces. `scenes/showcase/texture_optimization.toml` shows a quilt without and with plain
//! least squares, and `docs/comparisons.md` measures all choices against the sample.
//!
//! - Twin: Mitsuba `bitmap` (native; `trilinear` and `ewa` are hosted), of a picture quilted in
//!   Python, written from the model.
//! - Example: `scenes/textures/synthesized.toml`.

mod codes;
mod optimization;
mod quilt;

use crate::support::mapping::{Mapping, Projection};
use crate::support::raster::{
    ColorSpace, DEFAULT_MAX_ANISOTROPY, Data, Filter, Lookup, MaxAnisotropy, Raster,
};
use crate::support::wrap::Wraps;
use codes::Codes;
use optimization::Optimization;
use quilt::Quilt;
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use std::time::{Duration, Instant};
use toml::Spanned;
use whitstone_core::config::{FilePath, IntegerIn, NonNegative, Scale2, Vector2};
use whitstone_core::{Context, Plugin, SceneError, SceneErrors, SourceSpan, Texture, Textures};
use whitstone_image::limits::Limits;
use whitstone_image::texels::{self, Encoding};

/// Default side of the pieces, and of the neighbourhoods of the optimisation, in texels.
const DEFAULT_BLOCK: u32 = 16;
const DEFAULT_NEIGHBORHOOD: u32 = 16;

/// Texture synthesis: an image of any size, quilted from pieces of a small sample.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The sample, an 8-bit PNG or JPEG file; path relative to the scene.
    file: FilePath,
    /// Columns and rows of texels of the image.
    #[schemars(with = "[IntegerIn<1, 4096>; 2]")]
    size: Spanned<[IntegerIn<1, 4096>; 2]>,
    /// Side of the square pieces in texels: about the size of the features to preserve.
    #[serde(default)]
    #[schemars(extend("default" = DEFAULT_BLOCK), with = "IntegerIn<2, 256>")]
    block: Option<Spanned<IntegerIn<2, 256>>>,
    /// Overlap of adjacent pieces in texels, at most half a block.
    #[serde(default)]
    #[schemars(extend("x-default" = "a quarter of `block`, at least 1"), with = "IntegerIn<1, 128>")]
    overlap: Option<Spanned<IntegerIn<1, 128>>>,
    /// Tolerated error of a piece above the best one, as a fraction of the best error. With 0, the
    /// sample repeats more visibly.
    #[serde(default = "tenth")]
    tolerance: NonNegative,
    /// Seed of the choice of pieces.
    #[serde(default = "first")]
    seed: IntegerIn<0, { u32::MAX }>,
    /// Optimisation after quilting, which improves the match with the sample across seams.
    #[serde(default)]
    #[schemars(extend("x-default" = "none"), with = "Optimize")]
    optimize: Option<Spanned<Optimize>>,
    /// "nearest" uses the nearest texel, "bilinear" interpolates between texel centres. Two filters
    /// average where the footprint of a ray covers several texels: "trilinear" looks up a mip map;
    /// "ewa" averages over the ellipse of the footprint. Both are bilinear where it is smaller than
    /// a texel, and need 4 more bytes per texel.
    #[serde(default)]
    filter: Filter,
    /// For "ewa": maximum ratio of the axes of a footprint's ellipse. Longer ellipses are widened,
    /// which bounds the number of texels read.
    #[serde(default)]
    #[schemars(extend("default" = DEFAULT_MAX_ANISOTROPY), with = "IntegerIn<1, 64>")]
    max_anisotropy: MaxAnisotropy,
    /// Continuation outside of the image: "repeat", "clamp" to its border, or "mirror".
    #[serde(default)]
    wrap: Wraps,
    /// Encoding of the values in the file: "srgb", "linear", or "auto", which is sRGB.
    #[serde(default)]
    color_space: ColorSpace,
    /// Repetitions of the image per unit of u and of v.
    #[serde(default = "one")]
    scale: Scale2,
    /// Offset added to (u, v) after scaling.
    #[serde(default = "zero")]
    offset: Vector2,
    /// Mapping of the texture.
    #[serde(default)]
    #[schemars(extend("x-default" = "by (u, v)"))]
    mapping: Mapping,
}

/// Texture optimisation. Each iteration lowers the sum of squared differences between all
/// neighbourhoods of the image and their nearest pieces of the sample, or a robust one.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Optimize {
    /// Side of the square neighbourhoods in texels; they are spaced a quarter of it apart. Larger
    /// features are not preserved, smaller ones become smoother.
    #[serde(default)]
    #[schemars(extend("default" = DEFAULT_NEIGHBORHOOD), with = "IntegerIn<4, 256>")]
    neighborhood: Option<Spanned<IntegerIn<4, 256>>>,
    /// In place of `neighborhood`: 1 to 8 sides, one after the other at each resolution, usually
    /// from large to small. At coarse resolutions those that do not fit are left out.
    #[serde(default)]
    #[schemars(extend("x-default" = "`neighborhood` alone"), with = "Vec<IntegerIn<4, 256>>")]
    neighborhoods: Option<Spanned<Vec<IntegerIn<4, 256>>>>,
    /// Number of resolutions, the coarsest first: each has half the texels along a side of the
    /// next. Coarse ones arrange large features.
    #[serde(default)]
    #[schemars(extend("default" = 1), with = "IntegerIn<1, 8>")]
    resolutions: Option<Spanned<IntegerIn<1, 8>>>,
    /// Weight neighbourhoods that match badly less: instead of the sum of squared errors, that of
    /// errors to the power of 0.8 is lowered. The image becomes sharper.
    #[serde(default)]
    robust: bool,
    /// Number of iterations, of each side at each resolution: each one searches all pieces, and
    /// sets each texel to the mean of the pieces that cover it. 0 with one resolution keeps the
    /// quilt.
    #[serde(default = "four")]
    iterations: IntegerIn<0, 64>,
}

impl Optimize {
    /// Validates the optimisation of an image of this size. It is an error if its steps and the
    /// `before` previous ones exceed [`MAX_STEPS`].
    fn for_image(
        &self,
        sample: &Codes,
        size: [usize; 2],
        before: u64,
        place: SourceSpan,
    ) -> Result<Optimization, SceneErrors> {
        let (sides, where_sides) = self.sides(&place)?;
        let most = optimization::smallest(sample, size);
        let refuse = |place: SourceSpan, message: String| Err(SceneError::at(place, message).into());
        if let Some(side) = sides.iter().find(|side| **side > most) {
            let message = format!(
                "expected a neighborhood within the sample and the image, at most {most}, found {side}"
            );
            return refuse(where_sides, message);
        }
        let resolutions = self.resolutions.as_ref().map_or(1, |n| n.get_ref().get());
        let coarse = most >> (resolutions - 1);
        if sides.iter().all(|side| *side > coarse) {
            let message = format!(
                "expected a neighborhood that fits the coarsest of {resolutions} resolutions, at most {coarse}"
            );
            return refuse(self.resolutions.as_ref().map_or(place, |n| n.span()), message);
        }
        let optimization = Optimization {
            sides,
            resolutions,
            iterations: self.iterations.get(),
            robust: self.robust,
        };
        let steps = before.saturating_add(optimization.steps(sample, size));
        if steps > MAX_STEPS {
            let message = format!("this takes {steps} comparisons, more than {MAX_STEPS}");
            return Err(SceneError::at(place, message)
                .with_help("choose fewer iterations, smaller neighborhoods, or a smaller size or sample")
                .into());
        }
        Ok(optimization)
    }

    /// The sides of the neighbourhoods, and where they are.
    fn sides(&self, place: &SourceSpan) -> Result<(Vec<usize>, SourceSpan), SceneErrors> {
        let Some(sides) = &self.neighborhoods else {
            let side = self.neighborhood.as_ref();
            return Ok((
                vec![side.map_or(DEFAULT_NEIGHBORHOOD, |n| n.get_ref().get()) as usize],
                side.map_or(place.clone(), |n| n.span()),
            ));
        };
        let count = sides.get_ref().len();
        if self.neighborhood.is_some() || !(1..=8).contains(&count) {
            let message = match count {
                1..=8 => "expected `neighborhood` or `neighborhoods`, found both".to_owned(),
                _ => format!("expected 1 to 8 neighborhoods, found {count}"),
            };
            return Err(SceneError::at(sides.span(), message).into());
        }
        let sides_of = sides.get_ref().iter().map(|n| n.get() as usize);
        Ok((sides_of.collect(), sides.span()))
    }
}

fn four() -> IntegerIn<0, 64> {
    IntegerIn::new(4).expect("4 is in range")
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

/// Upper limit of channel comparisons; they take some seconds.
const MAX_STEPS: u64 = 1 << 33;

/// The `synthesized` texture; see the module documentation.
pub struct Synthesized;

impl Plugin<Textures> for Synthesized {
    const TYPE: &'static str = "synthesized";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Texture>, SceneErrors> {
        let path = context.file(&config.file)?;
        let refuse = |why: String| {
            let message = format!("\"{}\" cannot be used as a sample: {why}", config.file.path);
            SceneErrors::from(SceneError::at(config.file.span.clone(), message))
        };
        let texels = texels::read(&path, Limits::TEXTURE).map_err(|error| refuse(error.fault.to_string()))?;
        if texels.encoding != Encoding::Srgb8 {
            return Err(refuse("expected 8 bits a channel".to_owned()));
        }
        let sample = Codes::of(&texels);
        let block = config.block.as_ref().map_or(DEFAULT_BLOCK, |n| n.get_ref().get()) as usize;
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
                    let message =
                        format!("expected at most half of the block of {block} texels, found {found}");
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
        if steps > MAX_STEPS {
            let message = format!("this takes {steps} comparisons, more than {MAX_STEPS}");
            return Err(SceneError::at(config.size.span(), message)
                .with_help("choose a smaller size or sample, or larger blocks")
                .into());
        }
        let optimization = match &config.optimize {
            None => None,
            Some(optimize) => Some(optimize.get_ref().for_image(
                &sample,
                quilt.size,
                steps,
                optimize.span(),
            )?),
        };
        context.reserve(quilt.bytes())?;
        if let Some(optimization) = &optimization {
            context.reserve(optimization.bytes(&sample, quilt.size))?;
        }
        let picture = recalled_or_made(&sample, &quilt, optimization.as_ref(), SHORT, context);
        let store = picture.store(config.color_space);
        let lookup = Lookup {
            filter: config.filter,
            wrap: config.wrap.0,
            scale: config.scale.get(),
            offset: config.offset.get(),
        };
        let data = Data::new(store);
        let pattern = Raster::new(quilt.size, data, lookup, config.max_anisotropy, context)?;
        config.mapping.put(Projection::Uv, pattern)
    }
}

/// Version of the algorithm in the cache key. Change it whenever the same parameters give another
/// image.
const VERSION: &[u8] = b"synthesized 2";

/// Images that are made faster than this are not cached.
const SHORT: Duration = Duration::from_millis(50);

/// The image from the cache, or newly made; it is cached if making it takes longer than `short`.
fn recalled_or_made(
    sample: &Codes,
    quilt: &Quilt,
    optimization: Option<&Optimization>,
    short: Duration,
    context: &mut dyn Context,
) -> Codes {
    let [width, height] = quilt.size;
    // The key contains everything that affects the image, but not the lookup of its texels.
    let how = format!(
        "{} x {}, {quilt:?}, {optimization:?}",
        sample.width, sample.height
    );
    let parts = [VERSION, how.as_bytes(), sample.data.as_flattened()];
    if let Some(bytes) = context.cached(&parts, 3 * width * height) {
        let data = bytes.as_chunks().0.to_vec();
        return Codes { width, height, data };
    }
    let start = Instant::now();
    let mut picture = quilt.make(sample);
    if let Some(optimization) = optimization {
        optimization.improve(&mut picture, sample);
    }
    if start.elapsed() > short {
        context.cache(&parts, picture.data.as_flattened());
    }
    picture
}

#[cfg(test)]
mod tests {
    use super::quilt::tests::quilt;
    use super::*;
    use whitstone_core::hash::mix;
    use whitstone_core::{DVec2, DVec3, Rgb, SurfaceInteraction};
    use whitstone_testkit::{TestContext, build_in, texture_laws};

    /// Noise in two channels from the hash, the same for three texels in a row.
    pub(super) fn noise(width: usize, height: usize) -> Codes {
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

    fn write(folder: &std::path::Path) {
        let sample = noise(20, 17);
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
            "optimize = { neighborhood = 9, iterations = 2 }",
            "optimize = { neighborhoods = [8, 4], resolutions = 3, robust = true, iterations = 1 }",
        ] {
            texture_laws(&*build(&format!("file = \"a.png\"\nsize = [33, 20]\nblock = 6\n{more}")).unwrap());
        }
    }

    #[test]
    fn what_took_long_is_kept_and_belongs_to_all_that_it_is_made_of() {
        let mut context = TestContext::default();
        let from = noise(20, 17);
        let improve = |iterations, resolutions, robust| Optimization {
            sides: vec![6],
            resolutions,
            iterations,
            robust,
        };
        let made = recalled_or_made(&from, &quilt(0), None, Duration::MAX, &mut context);
        assert!(context.kept.is_empty());
        let mut changed = from.clone();
        changed.data[77][1] ^= 1;
        let other = Quilt {
            tolerance: 0.2_f64.next_up(),
            ..quilt(0)
        };
        for (number, (sample, quilt, optimization)) in [
            (&from, quilt(0), None),
            (&changed, quilt(0), None),
            (&from, quilt(1), None),
            (&from, other, None),
            (&from, quilt(0), Some(improve(1, 1, false))),
            (&from, quilt(0), Some(improve(2, 1, false))),
            (&from, quilt(0), Some(improve(2, 2, false))),
            (&from, quilt(0), Some(improve(2, 2, true))),
        ]
        .into_iter()
        .enumerate()
        {
            let again = |context: &mut TestContext| {
                recalled_or_made(sample, &quilt, optimization.as_ref(), Duration::ZERO, context)
            };
            let first = again(&mut context);
            assert_eq!(context.kept.len(), number + 1);
            assert!(number > 0 || first == made);
            // Verifies that the cached image is used.
            let kept = context.kept.clone();
            for bytes in context.kept.values_mut() {
                *bytes = bytes.iter().map(|byte| !byte).collect();
            }
            let recalled = again(&mut context);
            assert!(
                recalled
                    .data
                    .iter()
                    .zip(&first.data)
                    .all(|(a, b)| *a == b.map(|code| !code))
            );
            context.kept = kept;
            assert_eq!(again(&mut context), first);
        }
    }

    #[test]
    fn limits_are_allowed() {
        for text in [
            "block = 17",
            "block = 16\noverlap = 8",
            "block = 8\noptimize = { neighborhood = 17, iterations = 0 }",
            "block = 8\noptimize = { neighborhoods = [17, 4], resolutions = 3, iterations = 0 }",
        ] {
            let found = build(&format!("file = \"a.png\"\nsize = [20, 17]\n{text}"));
            assert!(found.is_ok(), "{text}");
        }
    }

    #[test]
    fn blocks_overlap_by_a_quarter_by_default() {
        let seen = |overlap: &str| -> Vec<Rgb> {
            let text =
                format!("file = \"a.png\"\nsize = [40, 30]\nblock = 9\nfilter = \"nearest\"\n{overlap}");
            let texture = build(&text).unwrap();
            let mut point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
            let texels = (0..40 * 30).map(|k| DVec2::new(f64::from(k % 40) + 0.5, f64::from(k / 40) + 0.5));
            texels
                .map(|at| {
                    point.uv = at / DVec2::new(40.0, 30.0);
                    texture.value(&point)
                })
                .collect()
        };
        assert_eq!(seen(""), seen("overlap = 2"));
        assert_ne!(seen(""), seen("overlap = 1"));
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
                "half of the block of 9 texels",
            ),
            ("file = \"a.png\"\nsize = [0, 9]", "0", "an integer from 1"),
            (
                "file = \"a.png\"\nsize = [90, 90]\noptimize = { neighborhood = 18 }",
                "18",
                "at most 17",
            ),
            (
                "file = \"a.png\"\nsize = [15, 90]\noptimize = {}",
                "{}",
                "at most 15",
            ),
            (
                "file = \"a.png\"\nsize = [4096, 4096]\noptimize = { neighborhood = 4 }",
                "{ neighborhood = 4 }",
                "comparisons",
            ),
            (
                "file = \"a.png\"\nsize = [4096, 4096]\nblock = 2",
                "[4096, 4096]",
                "comparisons",
            ),
            (
                "file = \"a.png\"\nsize = [90, 90]\noptimize = { neighborhoods = [18, 8] }",
                "[18, 8]",
                "at most 17",
            ),
            (
                "file = \"a.png\"\nsize = [90, 90]\noptimize = { neighborhoods = [] }",
                "[]",
                "1 to 8",
            ),
            (
                "file = \"a.png\"\nsize = [90, 90]\noptimize = { neighborhood = 8, neighborhoods = [7] }",
                "[7]",
                "found both",
            ),
            (
                "file = \"a.png\"\nsize = [90, 90]\noptimize = { neighborhoods = [16, 5], resolutions = 3 }",
                "3",
                "at most 4",
            ),
            (
                "file = \"a.png\"\nsize = [9, 9]\noptimize = { iterations = 65 }",
                "65",
                "an integer from 0",
            ),
        ] {
            let error = build(text).err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], place, "{text}");
            assert!(error.message.contains(why), "{}", error.message);
        }
    }
}
