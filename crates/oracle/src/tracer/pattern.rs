//! Images and two-dimensional patterns: section 10 of the model.

use super::mapping::{MappingConfig, TextureFunction};
use super::pyramid::{Level, Mean};
use super::wrap::{Wrap, Wraps};
use crate::gltf::{self, Gltf};
use serde::Deserialize;
use std::fmt::Display;
use std::path::Path;
use whitstone_core::config::{Color, FilePath};
use whitstone_core::{DVec2, DVec3, Rgb};
use whitstone_image::limits::{Limits, ReadFault};
use whitstone_image::texels::{self, Encoding, Texels};
use whitstone_scene::Sources;

/// One number for both axes, or two numbers.
#[derive(Clone, Copy, Deserialize)]
#[serde(untagged)]
pub(super) enum Pair {
    One(f64),
    Two([f64; 2]),
}

impl Pair {
    fn get(self) -> DVec2 {
        match self {
            Self::One(both) => DVec2::splat(both),
            Self::Two(pair) => pair.into(),
        }
    }
}

/// `scale` and `offset`.
struct Placing([DVec2; 2]);

impl Placing {
    fn new(scale: Option<Pair>, offset: Option<Pair>) -> Self {
        Self([
            scale.map_or(DVec2::ONE, Pair::get),
            offset.map_or(DVec2::ZERO, Pair::get),
        ])
    }

    fn at(&self, q: DVec3) -> DVec2 {
        q.truncate() * self.0[0] + self.0[1]
    }
}

/// The two colours of a pattern.
pub(super) fn colors(a: Option<Color>, b: Option<Color>, usual: [f64; 2]) -> [Rgb; 2] {
    let [first, second] = usual.map(Rgb::splat);
    [a.map_or(first, Color::get), b.map_or(second, Color::get)]
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CheckerConfig {
    a: Option<Color>,
    b: Option<Color>,
    scale: Option<Pair>,
    offset: Option<Pair>,
    pub(super) mapping: Option<MappingConfig>,
}

pub(super) struct Checker([Rgb; 2], Placing);

impl Checker {
    pub(super) fn new(config: &CheckerConfig) -> Self {
        Self(
            colors(config.a, config.b, [0.8, 0.2]),
            Placing::new(config.scale, config.offset),
        )
    }
}

impl TextureFunction for Checker {
    fn at(&self, q: DVec3) -> Rgb {
        let cell = self.1.at(q).floor();
        self.0[usize::from((cell.x + cell.y).rem_euclid(2.0) != 0.0)]
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LinesConfig {
    a: Option<Color>,
    b: Option<Color>,
    width: Option<Pair>,
    scale: Option<Pair>,
    offset: Option<Pair>,
    pub(super) mapping: Option<MappingConfig>,
}

pub(super) struct Lines {
    colors: [Rgb; 2],
    half: DVec2,
    placing: Placing,
}

impl Lines {
    pub(super) fn new(config: &LinesConfig) -> Self {
        Self {
            colors: colors(config.a, config.b, [0.8, 0.2]),
            half: 0.5 * config.width.map_or(DVec2::splat(0.1), Pair::get),
            placing: Placing::new(config.scale, config.offset),
        }
    }
}

impl TextureFunction for Lines {
    fn at(&self, q: DVec3) -> Rgb {
        let part = self.placing.at(q);
        let part = part - part.floor();
        let near = part.min(1.0 - part);
        self.colors[usize::from(near.x < self.half.x || near.y < self.half.y)]
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PictureConfig {
    file: FilePath,
    filter: Option<String>,
    #[serde(default)]
    wrap: Wraps,
    channel: Option<String>,
    image: Option<usize>,
    color_space: Option<String>,
    scale: Option<Pair>,
    offset: Option<Pair>,
    max_anisotropy: Option<f64>,
    pub(super) mapping: Option<MappingConfig>,
}

/// An image with linear values, the top row first.
pub(super) struct Picture {
    /// The mipmap levels; only one unless the image is filtered by footprints.
    levels: Vec<Level>,
    nearest: bool,
    mean: Option<Mean>,
    wrap: [Wrap; 2],
    placing: Placing,
}

/// How to look up the texels of an image.
pub(super) struct Lookup<'a> {
    pub(super) filter: Option<&'a str>,
    pub(super) max_anisotropy: Option<f64>,
    pub(super) wrap: [Wrap; 2],
    pub(super) scale: Option<Pair>,
    pub(super) offset: Option<Pair>,
}

/// An image with the numbers of its file. Integer formats keep their codes, and `most` is the
/// largest one.
#[derive(Clone)]
pub(super) struct Codes {
    pub(super) size: [usize; 2],
    pub(super) values: Vec<[f64; 3]>,
    pub(super) most: Option<f64>,
}

impl Codes {
    pub(super) fn read(file: &FilePath, sources: &Sources) -> Result<Self, String> {
        Self::new(texels::read(sources.path_of(file), Limits::TEXTURE))
    }

    fn new(texels: Result<Texels, impl Display>) -> Result<Self, String> {
        let texels = texels.map_err(|error| format!("this picture: {error}"))?;
        let most = match texels.encoding {
            Encoding::Srgb8 => Some(255.0),
            Encoding::Srgb16 => Some(65535.0),
            Encoding::Linear => None,
        };
        // Recovers the integer code: single precision stores only the value nearest to it.
        let code = |value: f32| most.map_or(f64::from(value), |most| (f64::from(value) * most).round());
        Ok(Self {
            size: [texels.width, texels.height],
            values: texels.data.iter().map(|texel| texel.map(code)).collect(),
            most,
        })
    }
}

impl Codes {
    /// Image `index` of a glTF file: its colours, or its alpha channel, 1 without one.
    fn of_gltf(path: &Path, index: usize, alpha: bool) -> Result<Self, String> {
        let bytes = Gltf::read(path).and_then(|file| file.image(index));
        let bytes = bytes.map_err(|error| format!("this picture: {error}"))?;
        if alpha {
            match texels::decode_alpha(&bytes, Limits::TEXTURE) {
                Err(ReadFault::NoAlpha) => {}
                codes => return Self::new(codes),
            }
        }
        let mut codes = Self::new(texels::decode(&bytes, Limits::TEXTURE))?;
        if codes.most.is_none() {
            return Err("this picture: EXR in glTF".to_owned());
        }
        if alpha {
            codes.values.fill([codes.most.unwrap_or(1.0); 3]);
        }
        Ok(codes)
    }
}

impl Picture {
    pub(super) fn new(config: &PictureConfig, sources: &Sources) -> Result<Self, String> {
        let (alpha, channel) = match config.channel.as_deref() {
            None | Some("color") => (false, None),
            Some("alpha") => (true, None),
            Some("red") => (false, Some(0)),
            Some("green") => (false, Some(1)),
            Some("blue") => (false, Some(2)),
            Some(other) => return Err(format!("the channel \"{other}\" of images")),
        };
        let path = sources.path_of(&config.file);
        let mut codes = match (gltf::is_gltf(&path), alpha) {
            (true, _) => Codes::of_gltf(&path, config.image.unwrap_or(0), alpha)?,
            (false, _) if config.image.is_some() => return Err("`image` of this file".to_owned()),
            (false, true) => Codes::new(texels::read_alpha(path, Limits::TEXTURE))?,
            (false, false) => Codes::read(&config.file, sources)?,
        };
        if let Some(channel) = channel {
            for texel in &mut codes.values {
                *texel = [texel[channel]; 3];
            }
        }
        let lookup = Lookup {
            filter: config.filter.as_deref(),
            max_anisotropy: config.max_anisotropy,
            wrap: config.wrap.each(),
            scale: config.scale,
            offset: config.offset,
        };
        let space = if alpha {
            Some("linear")
        } else {
            config.color_space.as_deref()
        };
        Self::of(&codes, space, &lookup)
    }

    pub(super) fn of(codes: &Codes, color_space: Option<&str>, lookup: &Lookup<'_>) -> Result<Self, String> {
        let (nearest, mean) = match lookup.filter {
            None | Some("bilinear") => (false, None),
            Some("nearest") => (true, None),
            Some("trilinear") => (false, Some(Mean::Trilinear)),
            Some("ewa") => (false, Some(Mean::Ewa(lookup.max_anisotropy.unwrap_or(16.0)))),
            Some(other) => return Err(format!("the filter \"{other}\"")),
        };
        let encoded = match color_space {
            Some("srgb") => true,
            Some("linear") => false,
            _ => codes.most.is_some(),
        };
        let value = |code: f64| {
            let c = code / codes.most.unwrap_or(1.0);
            match encoded {
                false => c,
                true if c <= 0.04045 => c / 12.92,
                true => ((c + 0.055) / 1.055).powf(2.4),
            }
        };
        let texels = codes.values.iter().map(|texel| Rgb::from(texel.map(value)));
        let picture = Level {
            size: codes.size,
            texels: texels.collect(),
        };
        Ok(Self {
            levels: match mean {
                None => vec![picture],
                Some(_) => picture.pyramid(),
            },
            nearest,
            mean,
            wrap: lookup.wrap,
            placing: Placing::new(lookup.scale, lookup.offset),
        })
    }

    /// Maps a point to the unit square of the image, with (0, 0) at the top left.
    fn place(&self, q: DVec3) -> DVec2 {
        let place = self.placing.at(q);
        DVec2::new(place.x, 1.0 - place.y)
    }
}

impl TextureFunction for Picture {
    fn size(&self) -> Option<[usize; 2]> {
        Some(self.levels[0].size)
    }

    fn at(&self, q: DVec3) -> Rgb {
        let picture = &self.levels[0];
        let place = self.place(q);
        if self.nearest {
            let x = place * picture.extent();
            return picture.texel(self.wrap, x.x.floor(), x.y.floor());
        }
        picture.bilinear(self.wrap, place)
    }

    fn filters(&self) -> bool {
        self.mean.is_some()
    }

    fn filtered(&self, q: DVec3, steps: [DVec3; 2]) -> Rgb {
        let Some(mean) = &self.mean else {
            return self.at(q);
        };
        let steps = steps.map(|step| step.truncate() * self.placing.0[0] * DVec2::new(1.0, -1.0));
        mean.over(&self.levels, self.wrap, self.place(q), steps)
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct VoxelsConfig {
    size: [usize; 3],
    channels: Option<usize>,
    values: Option<Vec<f64>>,
    file: Option<FilePath>,
    format: Option<String>,
    filter: Option<String>,
    #[serde(default)]
    wrap: Wrap,
    pub(super) mapping: Option<MappingConfig>,
}

pub(super) struct Voxels {
    size: [usize; 3],
    values: Vec<Rgb>,
    nearest: bool,
    wrap: Wrap,
}

impl Voxels {
    pub(super) fn new(config: VoxelsConfig, sources: &Sources) -> Result<Self, String> {
        let numbers = match (config.values, &config.file) {
            (Some(values), _) => values,
            (None, Some(file)) => {
                let bytes = std::fs::read(sources.path_of(file));
                let bytes = bytes.map_err(|error| format!("this block of voxels: {error}"))?;
                match config.format.as_deref() {
                    Some("f32") => bytes
                        .chunks_exact(4)
                        .map(|four| f64::from(f32::from_le_bytes([four[0], four[1], four[2], four[3]])))
                        .collect(),
                    _ => bytes.iter().map(|byte| f64::from(*byte) / 255.0).collect(),
                }
            }
            (None, None) => Vec::new(),
        };
        let channels = config.channels.unwrap_or(1);
        let values = numbers.chunks_exact(channels.max(1)).map(|voxel| match *voxel {
            [r, g, b] => Rgb::from([r, g, b]),
            _ => Rgb::splat(voxel[0]),
        });
        Ok(Self {
            size: config.size,
            values: values.collect(),
            nearest: config.filter.as_deref() == Some("nearest"),
            wrap: config.wrap,
        })
    }

    fn voxel(&self, place: [f64; 3]) -> Rgb {
        let [i, j, k]: [usize; 3] = std::array::from_fn(|axis| self.wrap.index(place[axis], self.size[axis]));
        self.values[(k * self.size[1] + j) * self.size[0] + i]
    }
}

impl TextureFunction for Voxels {
    fn at(&self, q: DVec3) -> Rgb {
        let x: [f64; 3] = std::array::from_fn(|axis| self.size[axis] as f64 * q[axis]);
        if self.nearest {
            return self.voxel(x.map(f64::floor));
        }
        let low = x.map(|x| (x - 0.5).floor());
        let mut sum = Rgb::splat(0.0);
        for corner in 0..8_usize {
            let upper: [f64; 3] = std::array::from_fn(|axis| ((corner >> axis) & 1) as f64);
            let place: [f64; 3] = std::array::from_fn(|axis| low[axis] + upper[axis]);
            let weight = (0..3).map(|axis| {
                let part = x[axis] - 0.5 - low[axis];
                if upper[axis] == 1.0 { part } else { 1.0 - part }
            });
            sum += self.voxel(place) * weight.product::<f64>();
        }
        sum
    }
}
