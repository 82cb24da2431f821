//! Reflection, refraction, Fresnel's equations and powers of cosines, without cancellation.
//!
//! Notation of the model: `n` is the normal on the viewer's side, `v` points to the viewer, `eta = n_i/n_t`,
//! `s = |n x v|` the sine and `c_i = n·v` the cosine of the angle of incidence, `c_t` that of refraction.
//! Sine and cosine come from the vectors independently, each accurate where it is small.
//!
//! **Cosine of refraction.** `c_t² = 1 - eta² s²` is `(1 - eta s)(1 + eta s)`, which cancels only where
//! `eta s` is near 1. There, since `s² + c_i² = 1`, with `g = 1 - eta² = (n_t - n_i)(n_t + n_i)/n_t²`, which is
//! exact up to rounding because the difference of near numbers is exact:
//!
//! - into the denser medium (`eta <= 1`): `c_t² = g + (eta c_i)²`, a sum of positive numbers;
//! - `1 < eta² < 2`: `c_t² = (eta c_i - q)(eta c_i + q)`, `q = sqrt(-g)`: the critical angle is at a small
//!   `c_i`, which carries it to full relative accuracy even if the indices differ by 1e-12;
//! - beyond, the first form stays: there the critical angle is at a small s.
//!
//! **Fresnel.** The numerators of the textbook form cancel for near indices. Multiplied by their conjugates,
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

use whitstone_core::DVec3;

/// The mirror direction of `v`.
pub(crate) fn reflect(n: DVec3, v: DVec3) -> DVec3 {
    nearly_unit(2.0 * n.dot(v) * n - v)
}

/// A step of Newton's method for 1/|v|: rounding errors must not add up over many bounces.
fn nearly_unit(v: DVec3) -> DVec3 {
    v * (1.5 - 0.5 * v.length_squared())
}

/// `[a·b]+` to a power, for unit vectors. Near 1 the cosine has lost what a high exponent reads: there
/// it is taken from the sine.
pub(crate) fn cosine_power(a: DVec3, b: DVec3, exponent: f64) -> f64 {
    let cosine = a.dot(b);
    if cosine <= 0.0 {
        return 0.0;
    }
    let sine_squared = a.cross(b).length_squared();
    if sine_squared < 0.5 {
        (exponent * 0.5 * (-sine_squared).ln_1p()).exp()
    } else {
        cosine.powf(exponent)
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
    /// sqrt(-g) where that is a number.
    q: f64,
}

/// A ray that goes through an interface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Crossing {
    /// Unit direction into the other side.
    pub(crate) direction: DVec3,
    cos_i: f64,
    sin_i: f64,
    cos_t: f64,
}

/// How the radiance is shared out at a crossing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fresnel {
    /// R.
    pub(crate) reflected: f64,
    /// 1 - R.
    pub(crate) transmitted: f64,
}

impl Interface {
    /// From the index on the viewer's side and that on the other one, both positive. Ratios beyond 1e150
    /// are taken for that, so that squares stay numbers.
    pub(crate) fn new(n_i: f64, n_t: f64) -> Self {
        let unit = n_i.max(n_t);
        // Subtracted before scaling: the difference of near numbers is exact, that of rounded quotients
        // is not.
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

    /// Whether the indices are equal: nothing is reflected or bent, from either side.
    pub(crate) fn is_open(&self) -> bool {
        self.difference == 0.0
    }

    /// n_i/n_t.
    pub(crate) fn eta(&self) -> f64 {
        self.eta
    }

    /// The refracted ray, or `None` at total internal reflection.
    pub(crate) fn cross(&self, n: DVec3, v: DVec3) -> Option<Crossing> {
        let cosine = n.dot(v);
        // A normal that looks away can only come from a view along the geometry, where rule G drops the
        // branch: any unit direction will do.
        let (n, cos_i) = if cosine < 0.0 { (-n, -cosine) } else { (n, cosine) };
        let sine = n.cross(v);
        let sin_i = sine.length();
        if self.is_open() {
            return Some(Crossing {
                direction: -v,
                cos_i,
                sin_i,
                cos_t: cos_i,
            });
        }
        let Self { eta, g, q, .. } = *self;
        let (a, b) = (eta * sin_i, eta * cos_i);
        let cos_t_squared = if a * a < 0.5 || g <= -1.0 {
            (1.0 - a) * (1.0 + a)
        } else if eta <= 1.0 {
            g + b * b
        } else {
            (b - q) * (b + q)
        };
        if cos_t_squared <= 0.0 {
            return None;
        }
        let cos_t = cos_t_squared.sqrt();
        // (n x v) x n is v without its part along n, and as long as the sine: a unit vector even for a
        // huge eta.
        let direction = nearly_unit(-(cos_t * n + eta * sine.cross(n)));
        Some(Crossing {
            direction,
            cos_i,
            sin_i,
            cos_t,
        })
    }

    /// Fresnel's equations for unpolarised light.
    pub(crate) fn fresnel(&self, crossing: &Crossing) -> Fresnel {
        let Self {
            n_i,
            n_t,
            difference,
            eta,
            ..
        } = *self;
        if self.is_open() {
            return Fresnel {
                reflected: 0.0,
                transmitted: 1.0,
            };
        }
        let Crossing {
            cos_i, sin_i, cos_t, ..
        } = *crossing;
        let d_s = n_i * cos_i + n_t * cos_t;
        let d_p = n_t * cos_i + n_i * cos_t;
        let r_s = difference * (n_i + n_t) / d_s / d_s;
        let r_p = difference * (n_i + n_t) * (eta * sin_i - cos_i) * (eta * sin_i + cos_i) / d_p / d_p;
        let both = (n_i * cos_i) * (n_t * cos_t);
        Fresnel {
            reflected: 0.5 * (r_s * r_s + r_p * r_p),
            transmitted: 2.0 * (both / d_s / d_s + both / d_p / d_p),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The plane of incidence is turned, so that no component is zero by luck.
    fn incidence(sin: f64, cos: f64) -> (DVec3, DVec3) {
        (DVec3::Z, DVec3::new(sin, 0.0, cos))
    }

    /// n_i, n_t, sine and cosine of v, R, 1 - R, cosine of refraction; the last three to 20 digits, by
    /// mpmath at 80 digits from the textbook formulas for the exact binary values of the first four (the
    /// angle is that of the vector (sine, cosine), whose length is not quite 1).
    const FRESNEL: &[[f64; 7]] = &[
        [1.0, 1.5, 0.0, 1.0, 0.04, 0.96, 1.0],
        [1.0, 1.5, 1e-08, 1.0, 0.04, 0.96, 0.99999999999999997778],
        [
            1.0,
            1.5,
            0.29552020666133955,
            0.955336489125606,
            0.040141638474671996073,
            0.95985836152532800393,
            0.98040078141653413147,
        ],
        [
            1.0,
            1.5,
            0.644217687237691,
            0.7648421872844885,
            0.045807898596632761766,
            0.95419210140336723823,
            0.90307710300828209595,
        ],
        [
            1.0,
            1.5,
            0.9320390859672263,
            0.3623577544766736,
            0.15610597775721422858,
            0.84389402224278577142,
            0.78352569048978924912,
        ],
        [
            1.0,
            1.5,
            0.9974949866040544,
            0.0707372016677029,
            0.67042270267207584976,
            0.32957729732792415024,
            0.74684633305647354514,
        ],
        [
            1.0,
            1.5,
            0.9999996829318346,
            0.0007963267107332633,
            0.99538261089327925323,
            0.0046173891067207467672,
            0.74535618156280162496,
        ],
        [1.5, 1.0, 0.0, 1.0, 0.04, 0.96, 1.0],
        [1.5, 1.0, 1e-08, 1.0, 0.04, 0.96, 0.9999999999999998875],
        [
            1.5,
            1.0,
            0.29552020666133955,
            0.955336489125606,
            0.040856402350134055546,
            0.95914359764986594445,
            0.89638304690204181984,
        ],
        [
            1.5,
            1.0,
            0.644217687237691,
            0.7648421872844885,
            0.25491517550504376225,
            0.74508482449495623775,
            0.25731893782380498669,
        ],
        [
            1.0,
            2.4,
            0.0,
            1.0,
            0.16955017301038061018,
            0.83044982698961938982,
            1.0,
        ],
        [
            1.0,
            2.4,
            1e-08,
            1.0,
            0.16955017301038061018,
            0.83044982698961938982,
            0.99999999999999999132,
        ],
        [
            1.0,
            2.4,
            0.29552020666133955,
            0.955336489125606,
            0.16969788858926617654,
            0.83030211141073382346,
            0.99239012541261469891,
        ],
        [
            1.0,
            2.4,
            0.644217687237691,
            0.7648421872844885,
            0.17498435775126611249,
            0.82501564224873388751,
            0.9633008547230145411,
        ],
        [
            1.0,
            2.4,
            0.9320390859672263,
            0.3623577544766736,
            0.25850158128580723998,
            0.74149841871419276002,
            0.92151211240206242032,
        ],
        [
            1.0,
            2.4,
            0.9974949866040544,
            0.0707372016677029,
            0.67408778119151003035,
            0.32591221880848996965,
            0.90953702276554488749,
        ],
        [
            1.0,
            2.4,
            0.9999996829318346,
            0.0007963267107332633,
            0.99508341472224381781,
            0.0049165852777561821864,
            0.90905940343961263135,
        ],
        [
            2.4,
            1.0,
            0.0,
            1.0,
            0.16955017301038061018,
            0.83044982698961938982,
            1.0,
        ],
        [
            2.4,
            1.0,
            1e-08,
            1.0,
            0.16955017301038061018,
            0.83044982698961938982,
            0.999999999999999712,
        ],
        [
            2.4,
            1.0,
            0.29552020666133955,
            0.955336489125606,
            0.17898749638714351774,
            0.82101250361285648226,
            0.70495855973232468156,
        ],
        [
            1.0,
            1.001,
            0.0,
            1.0,
            2.4975018737502309361e-7,
            0.99999975024981262498,
            1.0,
        ],
        [
            1.0,
            1.001,
            1e-08,
            1.0,
            2.4975018737502309361e-7,
            0.99999975024981262498,
            0.9999999999999999501,
        ],
        [
            1.0,
            1.001,
            0.29552020666133955,
            0.955336489125606,
            2.5203198818691718049e-7,
            0.99999974796801181308,
            0.95542776293775578007,
        ],
        [
            1.0,
            1.001,
            0.644217687237691,
            0.7648421872844885,
            3.7502556444228425668e-7,
            0.99999962497443555772,
            0.76538379974750424431,
        ],
        [
            1.0,
            1.001,
            0.9320390859672263,
            0.3623577544766736,
            0.000011017228120115940833,
            0.99998898277187988406,
            0.36474365426254394041,
        ],
        [
            1.0,
            1.001,
            0.9974949866040544,
            0.0707372016677029,
            0.0069568405682211987102,
            0.99304315943177880129,
            0.083610783889690760157,
        ],
        [
            1.0,
            1.001,
            0.9999996829318346,
            0.0007963267107332633,
            0.93120547896444898347,
            0.068794521035551016527,
            0.044694931086907556792,
        ],
        [
            1.0,
            1.0000001,
            0.0,
            1.0,
            2.4999997529193541971e-15,
            0.9999999999999975,
            1.0,
        ],
        [
            1.0,
            1.0000001,
            1e-08,
            1.0,
            2.4999997529193541971e-15,
            0.9999999999999975,
            0.99999999999999995,
        ],
        [
            1.0,
            1.0000001,
            0.29552020666133955,
            0.955336489125606,
            2.5228906669297422152e-15,
            0.99999999999999747711,
            0.95533649826711585605,
        ],
        [
            1.0,
            1.0000001,
            0.644217687237691,
            0.7648421872844885,
            3.7582964467056230052e-15,
            0.9999999999999962417,
            0.76484224154618568548,
        ],
        [
            1.0,
            1.0000001,
            0.9320390859672263,
            0.3623577544766736,
            1.1192727029754987892e-13,
            0.99999999999988807273,
            0.36235799421114319798,
        ],
        [
            1.0,
            1.0000001,
            0.9974949866040544,
            0.0707372016677029,
            9.8851889719592231472e-11,
            0.99999999990114811028,
            0.070738608263077928967,
        ],
        [
            1.0,
            1.0000001,
            0.9999996829318346,
            0.0007963267107332633,
            0.0046821299297392410633,
            0.99531787007026075894,
            0.00091331050224817232878,
        ],
        [1.0, 1.000000000001, 0.0, 1.0, 2.5004445226674882427e-25, 1.0, 1.0],
        [
            1.0,
            1.000000000001,
            1e-08,
            1.0,
            2.5004445226674882427e-25,
            1.0,
            0.99999999999999995,
        ],
        [
            1.0,
            1.000000000001,
            0.29552020666133955,
            0.955336489125606,
            2.5233395141698091109e-25,
            1.0,
            0.95533648912569744767,
        ],
        [
            1.0,
            1.000000000001,
            0.644217687237691,
            0.7648421872844885,
            3.7589655076685600455e-25,
            1.0,
            0.76484218728503113825,
        ],
        [
            1.0,
            1.000000000001,
            0.9320390859672263,
            0.3623577544766736,
            1.1194734975189481004e-23,
            1.0,
            0.36235775447907119528,
        ],
        [
            1.0,
            1.000000000001,
            0.9974949866040544,
            0.0707372016677029,
            9.8873427947495948035e-21,
            0.99999999999999999999,
            0.07073720168177025158,
        ],
        [
            1.0,
            1.000000000001,
            0.9999996829318346,
            0.0007963267107332633,
            6.2179921526155016539e-13,
            0.99999999999937820078,
            0.00079632796660910463341,
        ],
        [1.000000000001, 1.0, 0.0, 1.0, 2.5004445226674882427e-25, 1.0, 1.0],
        [
            1.000000000001,
            1.0,
            1e-08,
            1.0,
            2.5004445226674882427e-25,
            1.0,
            0.99999999999999995,
        ],
        [
            1.000000000001,
            1.0,
            0.29552020666133955,
            0.955336489125606,
            2.523339514169909463e-25,
            1.0,
            0.95533648912551460119,
        ],
        [
            1.000000000001,
            1.0,
            0.644217687237691,
            0.7648421872844885,
            3.7589655076771663239e-25,
            1.0,
            0.76484218728394580763,
        ],
        [
            1.000000000001,
            1.0,
            0.9320390859672263,
            0.3623577544766736,
            1.119473497552292812e-23,
            1.0,
            0.36235775447427607734,
        ],
        [
            1.000000000001,
            1.0,
            0.9974949866040544,
            0.0707372016677029,
            9.8873428026540411596e-21,
            0.99999999999999999999,
            0.070737201653635559209,
        ],
        [
            1.000000000001,
            1.0,
            0.9999996829318346,
            0.0007963267107332633,
            6.2180313780327149182e-13,
            0.99999999999937819686,
            0.0007963254548554414426,
        ],
        [
            0.001,
            1.0,
            0.0,
            1.0,
            0.99600798801598002389,
            0.0039920119840199761109,
            1.0,
        ],
        [
            0.001,
            1.0,
            1e-08,
            1.0,
            0.99600798801598002389,
            0.0039920119840199761109,
            1.0,
        ],
        [
            0.001,
            1.0,
            0.29552020666133955,
            0.955336489125606,
            0.99600384515681704568,
            0.0039961548431829543172,
            0.99999995633390277406,
        ],
        [
            0.001,
            1.0,
            0.644217687237691,
            0.7648421872844885,
            0.99586455899378680271,
            0.0041354410062131972851,
            0.99999979249176419523,
        ],
        [
            0.001,
            1.0,
            0.9320390859672263,
            0.3623577544766736,
            0.99378674248381654579,
            0.0062132575161834542125,
            0.99999956565147678537,
        ],
        [
            0.001,
            1.0,
            0.9974949866040544,
            0.0707372016677029,
            0.97236765569491205186,
            0.02763234430508794814,
            0.99999950250175209764,
        ],
        [
            0.001,
            1.0,
            0.9999996829318346,
            0.0007963267107332633,
            0.50642625555946798975,
            0.49357374444053201025,
            0.99999950000019206821,
        ],
        [
            1000000.0,
            1.0,
            0.0,
            1.0,
            0.999996000007999988,
            3.999992000011999984e-6,
            1.0,
        ],
        [
            1000000.0,
            1.0,
            1e-08,
            1.0,
            0.99999600000799498754,
            3.999992005012460027e-6,
            0.9999499987499374961,
        ],
    ];

    #[test]
    fn fresnel_agrees_with_high_precision() {
        for &[n_i, n_t, sin, cos, r, t, cos_t] in FRESNEL {
            let interface = Interface::new(n_i, n_t);
            let (n, v) = incidence(sin, cos);
            let crossing = interface.cross(n, v).unwrap();
            let found = interface.fresnel(&crossing);
            let error = |a: f64, b: f64| ((a - b) / b).abs();
            let what = format!("n_i {n_i} n_t {n_t} sin {sin}: {found:?}");
            // Relative errors; what the direction's own rounding does to a steep function is allowed for.
            assert!(
                error(crossing.cos_t, cos_t) < 4e-15,
                "{what}: {}",
                error(crossing.cos_t, cos_t)
            );
            assert!(
                error(found.reflected, r) < 1e-14,
                "{what}: {}",
                error(found.reflected, r)
            );
            assert!(
                error(found.transmitted, t) < 1e-14,
                "{what}: {}",
                error(found.transmitted, t)
            );
            assert!((crossing.direction.length() - 1.0).abs() < 4e-16);
            assert!((crossing.direction.z + cos_t).abs() < 4e-16);
        }
    }

    #[test]
    fn total_internal_reflection_begins_at_the_critical_angle() {
        // Sines 1e-12 on either side of n_t/n_i, which is not near 1.
        for (n_i, n_t) in [(1.5, 1.0), (1.33, 1.2), (2.4, 1.0), (1e9, 1.0)] {
            let interface = Interface::new(n_i, n_t);
            for (offset, total) in [(-1e-12, false), (1e-12, true)] {
                let sin: f64 = n_t / n_i * (1.0 + offset);
                let (n, v) = incidence(sin, ((1.0 - sin) * (1.0 + sin)).sqrt());
                assert_eq!(interface.cross(n, v).is_none(), total, "{n_i} {n_t} {offset}");
            }
        }
        // Near indices: cos_i² = 1 - (n_t/n_i)² at the critical angle.
        let (n_i, n_t) = (1.0_f64 + 1e-12, 1.0_f64);
        let critical = ((n_i - n_t) * (n_i + n_t)).sqrt() / n_i;
        for (offset, total) in [(1e-9, false), (-1e-9, true)] {
            let cos: f64 = critical * (1.0 + offset);
            let (n, v) = incidence((1.0 - cos * cos).sqrt(), cos);
            assert_eq!(Interface::new(n_i, n_t).cross(n, v).is_none(), total, "{offset}");
        }
    }

    #[test]
    fn equal_indices_change_nothing() {
        let interface = Interface::new(1.3, 1.3);
        let (n, v) = (
            DVec3::new(0.1, 0.2, 0.5).normalize(),
            DVec3::new(0.7, -0.1, 0.3).normalize(),
        );
        let crossing = interface.cross(n, v).unwrap();
        assert_eq!(crossing.direction, -v);
        assert_eq!(
            interface.fresnel(&crossing),
            Fresnel {
                reflected: 0.0,
                transmitted: 1.0
            }
        );
    }

    #[test]
    fn the_shares_sum_to_one_at_every_angle_and_ratio() {
        for exponent in -300..=300 {
            let interface = Interface::new(f64::powi(10.0, exponent), 1.0);
            for i in 0..=100 {
                let (sin, cos) = (f64::from(i) / 100.0 * std::f64::consts::FRAC_PI_2).sin_cos();
                let (n, v) = incidence(sin, cos);
                let Some(crossing) = interface.cross(n, v) else {
                    continue;
                };
                let Fresnel {
                    reflected,
                    transmitted,
                } = interface.fresnel(&crossing);
                assert!(
                    (reflected + transmitted - 1.0).abs() < 1e-14,
                    "1e{exponent} {i}: {reflected} {transmitted}"
                );
                assert!((crossing.direction.length() - 1.0).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn reflection_stays_unit_over_many_bounces() {
        let n = DVec3::new(0.3, -0.4, 0.8).normalize();
        let first = DVec3::new(0.2, 0.9, 0.1).normalize();
        let v = (0..100_000).fold(first, |v, _| reflect(n, v));
        assert!((v.length() - 1.0).abs() < 1e-15);
        assert!((v - first).length() < 1e-10);
    }

    /// Sine, cosine, exponent, power: the last to 20 digits by mpmath, as above.
    const POWERS: &[[f64; 4]] = &[
        [
            9.999999983333334e-05,
            0.999999995,
            100000000.0,
            0.60653065920719116194,
        ],
        [
            0.0009999998333333417,
            0.9999995000000417,
            1000000.0,
            0.60653060916840040399,
        ],
        [
            0.009999833334166664,
            0.9999500004166653,
            10000.0,
            0.6065256051767416304,
        ],
        [
            0.09983341664682815,
            0.9950041652780258,
            100.0,
            0.60602407721540859505,
        ],
        [
            0.479425538604203,
            0.8775825618903728,
            32.0,
            0.015318474517563730294,
        ],
        [
            0.7032794192004101,
            0.7109135380122773,
            1000.0,
            6.55819958242148563e-149,
        ],
        [
            0.7103532724176078,
            0.7038453156522361,
            1000.0,
            3.0007137488943408096e-153,
        ],
        [
            0.9974949866040544,
            0.0707372016677029,
            2.0,
            0.0050037516997772707004,
        ],
        [
            2.99999999955e-05,
            0.99999999955,
            10000000000.0,
            0.011108996530743732393,
        ],
        [0.0, 1.0, 100000000.0, 1.0],
    ];

    #[test]
    fn high_powers_agree_with_high_precision() {
        for &[sin, cos, exponent, power] in POWERS {
            let (a, b) = incidence(sin, cos);
            let found = cosine_power(a, b, exponent);
            assert!(
                (found / power - 1.0).abs() < 1e-12,
                "{sin} {exponent}: {found} {power}"
            );
        }
        assert_eq!(cosine_power(DVec3::X, DVec3::Y, 1e-300), 0.0);
        assert_eq!(cosine_power(DVec3::X, DVec3::X, f64::MAX), 1.0);
    }
}
