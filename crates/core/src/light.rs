use crate::stream::{Colors, SampleStreams, Vectors};
use crate::{Aabb, Rgb};
use glam::DVec3;
use std::ops::{BitOr, BitOrAssign};

/// A source of light. A light gives some of: samples that reach a point along a direction, a
/// uniform ambient radiance, the radiance of what lies behind everything.
pub trait Light: Send + Sync {
    /// Which of the methods below give something.
    fn gives(&self) -> LightGives;

    /// Adds what arrives at a point, not yet tested for shadows: at most a fixed number of samples.
    fn samples(&self, point: DVec3, out: &mut Vec<LightSample>) {
        let _ = (point, out);
    }

    /// [`Self::samples`] for the first `len` points of a stream. What arrives at different points
    /// as the k-th sample shares a stream; where there is none, its irradiance is black.
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

    /// Whether [`Self::samples`] may give anything but black at any point of a box, which may be
    /// endless. `true` where that is not known: a light is left out of a scene if this is `false`
    /// for all that could show it, and, where there are many lights, of a stream of points if it is
    /// `false` for the box around them. That box may be a point: rounding is on the side of `true`.
    fn reaches(&self, bounds: &Aabb) -> bool {
        let _ = bounds;
        true
    }

    /// Uniform radiance from all around, for the materials' ambient terms.
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

/// Light that may reach a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSample {
    /// Unit direction from the point to the light.
    pub direction: DVec3,
    /// In metres; infinite for directional lights.
    pub distance: f64,
    /// Irradiance in W/m² on a surface that faces the light.
    pub irradiance: Rgb,
}

/// Which contributions a light makes, as a set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LightGives(u8);

impl LightGives {
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

impl BitOr for LightGives {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl BitOrAssign for LightGives {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}
