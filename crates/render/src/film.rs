//! The rendered image.

use std::mem;
use std::ops::ControlFlow;
use whitstone_core::{Counters, TooLarge, TreeLimits};
use whitstone_image::planes::RGB;
use whitstone_image::{Image, ImageError};

/// A rendered image.
#[derive(Clone, Debug, Default)]
pub struct Film {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Radiance in W/(m² sr), linear Rec. 709, row by row from the top.
    pub rgb: Vec<[f32; 3]>,
    /// Layers by EXR channel name, each `width * height` values in the same order.
    pub layers: Vec<(String, Vec<f32>)>,
    /// Samples per pixel.
    pub samples: u32,
    /// Rays traced for the radiance.
    pub counters: Counters,
    /// Wall time of the rendering in seconds.
    pub render_seconds: f64,
    /// Whether all pixels are finished. If the rendering was stopped, the others are black.
    pub is_complete: bool,
    /// A pixel whose ray tree exceeds its limits; the rendering was stopped there.
    pub too_large: Option<([u32; 2], TooLarge)>,
}

/// A film that is no image.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FilmError {
    /// A ray tree exceeds its limits.
    #[error("{}", too_large(*pixel, *tree))]
    TooLarge {
        /// The pixel: column and row.
        pixel: [u32; 2],
        /// The tree.
        tree: TooLarge,
    },
    /// The values are no image.
    #[error(transparent)]
    Image(#[from] ImageError),
}

fn too_large([x, y]: [u32; 2], tree: TooLarge) -> String {
    let limits = tree.limits;
    let (found, also) = if tree.by_rays {
        (
            format!(
                "one sample of pixel ({x}, {y}) becomes more than {} rays",
                limits.rays
            ),
            ", or set another limit (`--max-tree-rays`, `max_tree_rays` in Python)",
        )
    } else {
        (
            format!(
                "the samples of a tile, pixel ({x}, {y}) among them, have more than {} pending rays",
                limits.pending
            ),
            match limits.pending < TreeLimits::default().pending {
                true => ", or allow more memory with `--max-memory`, in GiB",
                false => "",
            },
        )
    };
    format!("{found}: decrease `max_depth` of the integrator, or increase its `min_contribution`{also}")
}

/// A vector of `count` zeros. It uses the memory of `old` if that is large enough.
fn zeros<T: Clone + Default>(mut old: Vec<T>, count: usize) -> Vec<T> {
    if old.capacity() < count {
        // Memory that the system provides is zero: it is not written here.
        return vec![T::default(); count];
    }
    old.clear();
    old.resize(count, T::default());
    old
}

/// Called with the number of finished pixels and the total, from any thread. `Break` stops the
/// rendering.
pub type Progress<'a> = &'a (dyn Fn(u64, u64) -> ControlFlow<()> + Sync);

impl Film {
    /// Makes it a black, complete image of this size with these layers.
    pub(crate) fn prepare(
        &mut self,
        [width, height]: [u32; 2],
        layers: impl Iterator<Item = impl AsRef<str>>,
    ) {
        let count = width as usize * height as usize;
        let mut old = mem::take(&mut self.layers).into_iter();
        let layer = |name| {
            let (mut own_name, values) = old.next().unwrap_or_default();
            AsRef::<str>::as_ref(&name).clone_into(&mut own_name);
            (own_name, zeros(values, count))
        };
        *self = Self {
            width,
            height,
            rgb: zeros(mem::take(&mut self.rgb), count),
            layers: layers.map(layer).collect(),
            samples: 0,
            counters: Counters::default(),
            render_seconds: 0.0,
            is_complete: true,
            too_large: None,
        };
    }

    /// Notes a ray tree that exceeds its limits, after which the rendering stops.
    pub(crate) fn stop_at(&mut self, too_large: Option<([u32; 2], TooLarge)>) {
        if too_large.is_some() {
            self.is_complete = false;
            self.too_large = too_large;
        }
    }

    /// Whether all pixels are valid: an error if a ray tree exceeded its limits.
    pub fn check(&self) -> Result<(), FilmError> {
        match self.too_large {
            Some((pixel, tree)) => Err(FilmError::TooLarge { pixel, tree }),
            None => Ok(()),
        }
    }

    /// Number of pixels whose radiance the image cannot represent: it overflows `f32`, or is NaN.
    pub fn not_finite(&self) -> usize {
        // Without conditional jumps, so that it can be vectorised.
        let unfit = |[r, g, b]: &[f32; 3]| !(r.is_finite() & g.is_finite() & b.is_finite());
        self.rgb.iter().map(|rgb| usize::from(unfit(rgb))).sum()
    }

    /// A copy as an image with all layers and provenance attributes.
    pub fn to_image(&self, scene_hash: &str) -> Result<Image, FilmError> {
        self.check()?;
        let mut image = Image::from_rgb(self.width as usize, self.height as usize, &self.rgb)?;
        for (name, values) in &self.layers {
            image.add_channel(name, values.clone())?;
        }
        self.describe(image, scene_hash)
    }

    /// Converts to an image like [`Self::to_image`], in hardly more memory than the film itself.
    pub fn into_image(mut self, scene_hash: &str) -> Result<Image, FilmError> {
        self.check()?;
        let mut image = Image::new(self.width as usize, self.height as usize)?;
        let planes = take_planes(&mut self.rgb);
        for (name, plane) in RGB.into_iter().zip(planes) {
            image.add_channel(name, plane)?;
        }
        for (name, values) in mem::take(&mut self.layers) {
            image.add_channel(name, values)?;
        }
        self.describe(image, scene_hash)
    }

    fn describe(&self, mut image: Image, scene_hash: &str) -> Result<Image, FilmError> {
        image.set_attribute("scene_hash", scene_hash)?;
        image.set_attribute("samples", self.samples.to_string())?;
        image.set_attribute("version", env!("CARGO_PKG_VERSION"))?;
        if !self.is_complete {
            image.set_attribute("unfinished", "true")?;
        }
        Ok(image)
    }
}

/// Number of pixels that are moved at a time.
const MOVED: usize = 1 << 22;

/// The channels of pixels. The pixels are freed in parts, from the last one on, as the memory of
/// the channels comes into use.
fn take_planes(pixels: &mut Vec<[f32; 3]>) -> [Vec<f32>; 3] {
    let mut planes = [(); 3].map(|()| vec![0.0; pixels.len()]);
    while !pixels.is_empty() {
        let start = (pixels.len() - 1) / MOVED * MOVED;
        let [r, g, b] = planes.each_mut().map(|plane| plane[start..].iter_mut());
        for (((r, g), b), pixel) in r.zip(g).zip(b).zip(&pixels[start..]) {
            [*r, *g, *b] = *pixel;
        }
        pixels.truncate(start);
        pixels.shrink_to_fit();
    }
    planes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_hold_every_pixel_once() {
        for count in [1, 5, MOVED, MOVED + 3] {
            let mut pixels: Vec<[f32; 3]> = (0..count).map(|i| [i as f32, -(i as f32), 0.5]).collect();
            let expected: [Vec<f32>; 3] =
                [0, 1, 2].map(|channel| pixels.iter().map(|pixel| pixel[channel]).collect());
            let planes: [Vec<f32>; 3] = take_planes(&mut pixels);
            assert_eq!(planes, expected);
            assert_eq!(pixels.capacity(), 0);
        }
    }

    #[test]
    fn both_conversions_give_the_same_image() {
        let film = Film {
            width: 2,
            height: 1,
            rgb: vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]],
            layers: vec![("depth.Z".to_owned(), vec![7.0, 8.0])],
            samples: 4,
            counters: Counters::default(),
            render_seconds: 0.0,
            is_complete: true,
            too_large: None,
        };
        let copy = film.to_image("hash").unwrap();
        assert_eq!(copy.rgb().unwrap()[1], [2.0, 5.0]);
        assert_eq!(film.into_image("hash").unwrap(), copy);
    }
}
