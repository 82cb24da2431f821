use crate::simd::select;
use glam::DVec3;
use std::iter::Sum;
use std::ops::{Add, AddAssign, Mul, MulAssign};

/// A linear Rec. 709 colour, or a quantity in these three channels: radiance in W/(m² sr),
/// irradiance in W/m², or a dimensionless weight.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rgb {
    /// Red.
    pub r: f64,
    /// Green.
    pub g: f64,
    /// Blue.
    pub b: f64,
}

impl Rgb {
    /// Zero in every channel.
    pub const BLACK: Self = Self::splat(0.0);
    /// One in every channel.
    pub const WHITE: Self = Self::splat(1.0);

    /// A colour from its channels.
    pub const fn new(r: f64, g: f64, b: f64) -> Self {
        Self { r, g, b }
    }

    /// The same value in every channel.
    pub const fn splat(value: f64) -> Self {
        Self::new(value, value, value)
    }

    /// Selects one of two colours without a branch.
    #[inline(always)]
    pub fn choose(first: bool, a: Self, b: Self) -> Self {
        let pick = |a: f64, b: f64| select(first, a, b);
        Self::new(pick(a.r, b.r), pick(a.g, b.g), pick(a.b, b.b))
    }

    /// The largest channel.
    #[inline(always)]
    pub fn max_component(self) -> f64 {
        self.r.max(self.g).max(self.b)
    }

    /// Whether every channel is exactly zero.
    #[inline(always)]
    pub fn is_black(self) -> bool {
        self == Self::BLACK
    }

    /// The channels in order.
    pub const fn to_array(self) -> [f64; 3] {
        [self.r, self.g, self.b]
    }

    /// The vector that a texture stores as this colour: 2 * colour - 1, so that mid grey (0.5) is
    /// the zero vector.
    pub fn to_vector(self) -> DVec3 {
        DVec3::from_array(self.map(|channel| 2.0 * channel - 1.0).to_array())
    }

    /// Applies `f` to each channel.
    #[inline(always)]
    pub fn map(self, f: impl Fn(f64) -> f64) -> Self {
        Self::new(f(self.r), f(self.g), f(self.b))
    }

    /// Transmittance exp(-a t) of a segment of `length` metres in a medium with this absorption
    /// coefficient (per metre). Exactly 1 in channels without absorption, even for infinite length.
    pub fn transmittance(self, length: f64) -> Self {
        self.map(|a| if a == 0.0 { 1.0 } else { libm::exp(-a * length) })
    }
}

impl From<[f64; 3]> for Rgb {
    fn from([r, g, b]: [f64; 3]) -> Self {
        Self { r, g, b }
    }
}

impl From<DVec3> for Rgb {
    fn from(v: DVec3) -> Self {
        Self::new(v.x, v.y, v.z)
    }
}

impl Add for Rgb {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self::new(self.r + other.r, self.g + other.g, self.b + other.b)
    }
}

impl AddAssign for Rgb {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Mul for Rgb {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self::new(self.r * other.r, self.g * other.g, self.b * other.b)
    }
}

impl MulAssign for Rgb {
    #[inline(always)]
    fn mul_assign(&mut self, other: Self) {
        *self = *self * other;
    }
}

impl Mul<f64> for Rgb {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        self.map(|c| c * factor)
    }
}

impl Sum for Rgb {
    fn sum<I: Iterator<Item = Self>>(colors: I) -> Self {
        colors.fold(Self::BLACK, Add::add)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transmittance_of_an_infinite_segment_is_one_or_zero() {
        let medium = Rgb::new(0.0, 1e-9, 5.0);
        assert_eq!(medium.transmittance(f64::INFINITY), Rgb::new(1.0, 0.0, 0.0));
        assert_eq!(medium.transmittance(0.0), Rgb::WHITE);
    }
}
