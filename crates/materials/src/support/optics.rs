//! Reflection, refraction, Fresnel's equations and powers of cosines, without cancellation.
//!
//! Notation, as in the model: `n` is the normal on the viewer's side, `v` points to the viewer,
//! `eta = n_i/n_t`, `s = |n x v|` is the sine and `c_i = n·v` the cosine of the angle of incidence,
//! and `c_t` is the cosine of refraction. Sine and cosine are computed independently from the
//! vectors, so that each is accurate where it is small.
//!
//! **Cosine of refraction.** `c_t² = 1 - eta² s²` is `(1 - eta s)(1 + eta s)`, which cancels only
//! where `eta s` is near 1. There, since `s² + c_i² = 1`, with
//! `g = 1 - eta² = (n_t - n_i)(n_t + n_i)/n_t²`, which is exact up to rounding because the
//! difference of near numbers is exact:
//!
//! - into the denser medium (`eta <= 1`): `c_t² = g + (eta c_i)²`, a sum of positive numbers;
//! - `1 < eta² < 2`: `c_t² = (eta c_i - q)(eta c_i + q)`, `q = sqrt(-g)`: the critical angle is at
//!   a small `c_i`, which carries it to full relative accuracy even if the indices differ by 1e-12;
//! - beyond, the first form stays: there the critical angle is at a small s.
//!
//! **Fresnel.** The numerators of the textbook form cancel for near indices. Multiplied by their
//! conjugates,
//!
//! - `(n_i c_i - n_t c_t)(n_i c_i + n_t c_t) = n_i² (1 - s²) - n_t² (1 - eta² s²) = n_i² - n_t²`,
//! - `(n_t c_i - n_i c_t)(n_t c_i + n_i c_t) = n_t² (1 - s²) - n_i² (1 - eta² s²)
//!   = (n_t² - n_i²)(1 - s² - eta² s²) = (n_t² - n_i²)(c_i - eta s)(c_i + eta s)`,
//!
//! so that with `D_s = n_i c_i + n_t c_t` and `D_p = n_t c_i + n_i c_t`
//!
//! - `r_s = (n_i - n_t)(n_i + n_t)/D_s²`,
//! - `r_p = (n_t - n_i)(n_t + n_i)(c_i - eta s)(c_i + eta s)/D_p²`, zero at Brewster's angle,
//! - `1 - R = 2 n_i n_t c_i c_t (1/D_s² + 1/D_p²)`, from `(a + b)² - (a - b)² = 4 a b`.
//!
//! **Diffuse reflectance.** `F`, the mean of R over the hemisphere weighted by the cosine, has a
//! closed form (Walsh 1926, cited by Duntley, *The optical properties of diffusing materials*,
//! 1942). Its terms cancel for near indices, and `1 - F`, by which materials divide, for distant
//! ones. With `c_i = q sinh u`, `m c_t = q cosh u`, `q² = m² - 1`, `m = n_t/n_i > 1` and
//! `w = e^(-2u)`, the amplitudes are rational: `r_s = -w`, `r_p = (b - w)/(1 - b w)` with
//! `b = (m² - 1)/(m² + 1)`, so that with `a = (m - 1)/(m + 1)`
//!
//! - `1 - F = a/(2 (1 - a)²) (integral from a to 1 of (1 - w²)²/w² (1 + (1 - b²)/(1 - b w)²) dw)`,
//!
//! where nothing is negative. Partial fractions integrate it. For a small b they cancel, and the
//! series of `1/(1 - b w)²` is integrated instead. From the denser side,
//! `1 - F(1/m) = (1 - F(m))/m²`.

use whitstone_core::DVec3;
use whitstone_core::simd::select;

/// The mirror direction of `v`.
#[inline(always)]
pub(crate) fn reflect(n: DVec3, v: DVec3) -> DVec3 {
    nearly_unit(2.0 * n.dot(v) * n - v)
}

/// Renormalises by one Newton step for 1/|v|, so that rounding errors do not grow over many
/// bounces.
#[inline(always)]
fn nearly_unit(v: DVec3) -> DVec3 {
    v * (1.5 - 0.5 * v.length_squared())
}

/// The angle between two unit vectors.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Angle {
    cosine: f64,
    sine_squared: f64,
}

impl Angle {
    #[inline(always)]
    pub(crate) fn between(a: DVec3, b: DVec3) -> Self {
        Self {
            cosine: a.dot(b),
            sine_squared: a.cross(b).length_squared(),
        }
    }

    /// `[cosine]+` to a power. Near 1 the cosine is too coarse for high exponents, so the logarithm
    /// is computed from the sine.
    pub(crate) fn cosine_power(self, exponent: f64) -> f64 {
        let Self { cosine, sine_squared } = self;
        if cosine <= 0.0 {
            0.0
        } else if sine_squared < 0.5 {
            libm::exp(exponent * 0.5 * libm::log1p(-sine_squared))
        } else {
            libm::pow(cosine, exponent)
        }
    }
}

/// The boundary between two media, seen from one side.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Interface {
    /// Index on the viewer's side, in units of the larger one.
    n_i: f64,
    /// Index on the other side, in units of the larger one.
    n_t: f64,
    /// n_i - n_t in the same unit, rounded once.
    difference: f64,
    /// n_i/n_t.
    eta: f64,
    /// 1 - eta².
    g: f64,
    /// sqrt(-g), where it is real.
    q: f64,
}

/// Refraction of a ray at an interface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Crossing {
    /// Total internal reflection: nothing is transmitted, and the other fields are meaningless.
    pub(crate) total: bool,
    /// Unit direction of the refracted ray.
    pub(crate) direction: DVec3,
    cos_i: f64,
    sin_i: f64,
    cos_t: f64,
}

/// Fresnel reflectance and transmittance at a crossing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fresnel {
    /// R.
    pub(crate) reflected: f64,
    /// 1 - R.
    pub(crate) transmitted: f64,
}

impl Interface {
    /// Creates an interface from the indices on the viewer's side and on the other side, both
    /// positive. Ratios beyond 1e150 are clamped to that, so that squares stay finite.
    pub(crate) fn new(n_i: f64, n_t: f64) -> Self {
        let unit = n_i.max(n_t);
        // Subtracted before scaling: the difference of near numbers is exact, that of rounded
        // quotients is not.
        let difference = (n_i - n_t) / unit;
        let (n_i, n_t) = ((n_i / unit).max(1e-150), (n_t / unit).max(1e-150));
        let g = -difference * ((n_i + n_t) / n_t / n_t);
        Self {
            n_i,
            n_t,
            difference,
            eta: n_i / n_t,
            g,
            q: (-g).max(0.0).sqrt(),
        }
    }

    /// Whether the indices are equal, so that rays are neither reflected nor bent, from either
    /// side.
    #[inline(always)]
    pub(crate) fn is_open(&self) -> bool {
        self.difference == 0.0
    }

    /// n_i/n_t.
    #[inline(always)]
    pub(crate) fn eta(&self) -> f64 {
        self.eta
    }

    /// Selects one of two interfaces without a conditional jump.
    #[inline(always)]
    pub(crate) fn choose(first: bool, a: &Self, b: &Self) -> Self {
        let pick = |a: f64, b: f64| select(first, a, b);
        Self {
            n_i: pick(a.n_i, b.n_i),
            n_t: pick(a.n_t, b.n_t),
            difference: pick(a.difference, b.difference),
            eta: pick(a.eta, b.eta),
            g: pick(a.g, b.g),
            q: pick(a.q, b.q),
        }
    }

    /// The refracted ray. Branchless, so that streams can vectorise it.
    #[inline(always)]
    pub(crate) fn cross(&self, n: DVec3, v: DVec3) -> Crossing {
        let cosine = n.dot(v);
        // The normal can face away only for a view that grazes the geometric surface. Rule G
        // of the Whitted model (section 8) drops that branch, so any unit direction is acceptable.
        let (n, cos_i) = if cosine < 0.0 { (-n, -cosine) } else { (n, cosine) };
        let sine = n.cross(v);
        let sin_i = sine.length();
        let Self { eta, g, q, .. } = *self;
        let (a, b) = (eta * sin_i, eta * cos_i);
        let by_sine = (1.0 - a) * (1.0 + a);
        let into_denser = g + b * b;
        let into_thinner = (b - q) * (b + q);
        let by_cosine = select(eta <= 1.0, into_denser, into_thinner);
        let sine_will_do = (a * a < 0.5) | (g <= -1.0);
        let cos_t_squared = select(sine_will_do, by_sine, by_cosine);
        let cos_t = cos_t_squared.max(0.0).sqrt();
        // (n x v) x n is the component of v perpendicular to n. Its length is the sine, so the
        // result is a unit vector even for a huge eta.
        let bent = nearly_unit(-(cos_t * n + eta * sine.cross(n)));
        let open = self.is_open();
        Crossing {
            total: (cos_t_squared <= 0.0) & !open,
            direction: if open { -v } else { bent },
            cos_i,
            sin_i,
            cos_t: select(open, cos_i, cos_t),
        }
    }

    /// Fresnel's equations for unpolarised light.
    #[inline(always)]
    pub(crate) fn fresnel(&self, crossing: &Crossing) -> Fresnel {
        let Self {
            n_i,
            n_t,
            difference,
            eta,
            ..
        } = *self;
        let Crossing {
            cos_i, sin_i, cos_t, ..
        } = *crossing;
        let d_s = n_i * cos_i + n_t * cos_t;
        let d_p = n_t * cos_i + n_i * cos_t;
        let r_s = difference * (n_i + n_t) / d_s / d_s;
        let r_p = difference * (n_i + n_t) * (eta * sin_i - cos_i) * (eta * sin_i + cos_i) / d_p / d_p;
        let both = (n_i * cos_i) * (n_t * cos_t);
        let transmitted = 2.0 * (both / d_s / d_s + both / d_p / d_p);
        let open = self.is_open();
        Fresnel {
            reflected: select(open, 0.0, 0.5 * (r_s * r_s + r_p * r_p)),
            transmitted: select(open, 1.0, transmitted),
        }
    }
}

impl Interface {
    /// Fresnel reflectance and transmittance of a ray; 1 and 0 at total internal reflection.
    #[inline(always)]
    pub(crate) fn shares(&self, n: DVec3, v: DVec3) -> Fresnel {
        let crossing = self.cross(n, v);
        let fresnel = self.fresnel(&crossing);
        Fresnel {
            reflected: select(crossing.total, 1.0, fresnel.reflected),
            transmitted: select(crossing.total, 0.0, fresnel.transmitted),
        }
    }

    /// 1 - F: the share of light that the interface transmits, if its radiance is the same from all
    /// directions. See the module documentation.
    pub(crate) fn diffuse_transmittance(&self) -> f64 {
        if self.is_open() {
            return 1.0;
        }
        // The indices are in units of the larger one: 1 and u = 1/m.
        let (d, u) = (self.difference.abs(), self.n_i.min(self.n_t));
        let (s, square) = (1.0 + u, 1.0 + u * u);
        let (a, b) = (d / s, d * s / square);
        // ln(1/a).
        let log_a = libm::log1p(2.0 * u / d);
        let polarised_s = 2.0 * u * (2.0 + u) / (3.0 * s * s);
        let polarised_p = if b < 0.25 {
            // a times the integral of w^j (1 - w²)², for j = -2, -1, 0, ...
            let first = [
                (1.0 - a).powi(3) * (3.0 + a) / 3.0,
                a * (log_a - (1.0 - a * a) + 0.25 * (1.0 - a.powi(4))),
            ];
            let part = |j: i32| (1.0 - a.powi(j)) / f64::from(j);
            let others = (0..SERIES).map(|j| a * (part(j + 1) - 2.0 * part(j + 3) + part(j + 5)));
            let terms = first.into_iter().chain(others).zip(0..);
            let sum: f64 = terms
                .map(|(integral, k)| f64::from(k + 1) * b.powi(k) * integral)
                .sum();
            (1.0 - b) * (1.0 + b) / (2.0 * (1.0 - a) * (1.0 - a)) * sum
        } else {
            let log_m = if d < 0.5 { -libm::log1p(-d) } else { -libm::log(u) };
            // 1 - b² = x².
            let x = 2.0 * u / square;
            let (b2, b3) = (b * b, b * b * b);
            let integral = 2.0 * u / (b2 * s) + 2.0 * b * log_a + 2.0 * u / d
                - 2.0 * x * x * (1.0 + b2) / b3 * log_m
                + x * x * (x / u) * d / b3;
            b * integral / (2.0 * square)
        };
        let denser = polarised_s + polarised_p;
        if self.n_i < self.n_t {
            denser
        } else {
            denser * u * u
        }
    }
}

/// Terms of the series for the diffuse reflectance, of which each is less than a quarter of the one
/// before.
const SERIES: i32 = 30;

#[cfg(test)]
mod tests;
