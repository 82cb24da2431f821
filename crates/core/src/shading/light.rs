use crate::stream::{Colors, SampleStreams, Vectors};
use crate::{Aabb, LightBounds, Rgb};
use glam::DVec3;
use std::ops::{BitOr, BitOrAssign};

/// A light source. It may contribute light samples at a point, a uniform ambient radiance, and the
/// background radiance along rays that hit nothing.
pub trait Light: Send + Sync {
    /// The contributions that this light makes.
    fn flags(&self) -> LightFlags;

    /// Appends the light samples at a point to `out`, without shadow tests. Their number is
    /// bounded.
    fn samples(&self, point: DVec3, out: &mut Vec<LightSample>) {
        let _ = (point, out);
    }

    /// [`Self::samples`] for the first `len` points of a stream. The k-th samples of all points
    /// form one stream; a point without a k-th sample has black irradiance there.
    fn samples_stream(&self, len: usize, points: &Vectors, out: &mut SampleStreams) {
        let mut streams: Vec<usize> = Vec::new();
        let mut samples = Vec::new();
        for lane in 0..len {
            samples.clear();
            self.samples(points.get(lane), &mut samples);
            for (k, sample) in samples.iter().enumerate() {
                if k == streams.len() {
                    streams.push(out.len());
                    out.add().irradiance.fill(len, Rgb::BLACK);
                }
                out.stream(streams[k]).set(lane, sample);
            }
        }
    }

    /// Whether a sample of [`Self::samples`] can be other than black at any point of a box, which
    /// may be unbounded or a single point.
    ///
    /// A light that affects no surface is removed from the scene. In scenes with many lights, a
    /// light is also skipped for each stream of points whose bounds it does not affect. Return
    /// `true` if unsure; rounding must err towards `true`.
    fn affects_bounds(&self, bounds: &Aabb) -> bool {
        let _ = bounds;
        true
    }

    /// Bounds on the samples, for a light whose irradiance falls off with the squared distance;
    /// `None` for others. Where they are below the `light_cutoff` of a scene, the light is skipped.
    fn bounds(&self) -> Option<LightBounds> {
        None
    }

    /// Uniform radiance from all directions, for the ambient terms of materials.
    fn ambient(&self) -> Rgb {
        Rgb::BLACK
    }

    /// Radiance seen by a ray in unit direction `direction` that hits nothing.
    fn background(&self, direction: DVec3) -> Rgb {
        let _ = direction;
        Rgb::BLACK
    }

    /// [`Self::background`] in the first `len` directions of a stream.
    fn background_stream(&self, len: usize, directions: &Vectors, out: &mut Colors) {
        for lane in 0..len {
            out.set(lane, self.background(directions.get(lane)));
        }
    }
}

/// Light that arrives at a point from one direction, unless a surface blocks it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSample {
    /// Unit direction from the point to the light.
    pub direction: DVec3,
    /// Distance to the light, in metres; infinite for directional lights.
    pub distance: f64,
    /// Irradiance in W/m² on a surface that faces the light.
    pub irradiance: Rgb,
}

/// The set of contributions that a light makes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LightFlags(u8);

impl LightFlags {
    /// [`Light::samples`].
    pub const SAMPLES: Self = Self(1);
    /// [`Light::ambient`].
    pub const AMBIENT: Self = Self(2);
    /// [`Light::background`].
    pub const BACKGROUND: Self = Self(4);

    /// Whether all of `other` is in this set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

impl BitOr for LightFlags {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl BitOrAssign for LightFlags {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}
