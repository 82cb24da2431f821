//! The shading sum of the lecture notes, shared by `phong`, `blinn_phong` and `whitted`.

use crate::support::optics::{Angle, reflect};
use whitstone_core::config::TextureRef;
use whitstone_core::stream::{
    Colors, LANES, Lanes, SampleStream, SampleStreams, SurfaceStream, whole_groups,
};
use whitstone_core::{
    ColorSource, Context, DVec3, LightSamples, Rgb, SceneErrors, SurfaceAttributes, SurfaceInteraction, simd,
};

/// `k_a I_a + sum of (k_d [n·l]+ + k_s highlight^exponent) E`.
pub(crate) struct Gloss {
    k_a: ColorSource,
    k_d: ColorSource,
    k_s: ColorSource,
    exponent: f64,
}

/// The cosine that is raised to the exponent of the highlight.
#[derive(Clone, Copy)]
pub(crate) enum Highlight {
    /// Between the mirrored light direction and the viewer.
    Phong,
    /// Between the normal and the half vector.
    BlinnPhong,
}

impl Highlight {
    #[inline(always)]
    fn angle(self, n: DVec3, l: DVec3, view: DVec3) -> Angle {
        match self {
            Self::Phong => Angle::between(reflect(n, l), view),
            Self::BlinnPhong => {
                let sum = l + view;
                let scale = sum.length_recip();
                // There is no half vector if l = -view, and no highlight.
                let half = simd::select(scale.is_finite(), scale, 0.0) * sum;
                Angle::between(n, half)
            }
        }
    }
}

/// Radiance by one light: `k_d` times the cosine plus `k_s` times the power, times the irradiance.
#[inline(always)]
fn reflected([k_d, k_s]: [Rgb; 2], [cosine, power]: [f64; 2], irradiance: Rgb) -> Rgb {
    (k_d * cosine + k_s * power) * irradiance
}

/// What a light sample contributes to the points of a stream.
struct Lit {
    /// Cosine between the normal and the light.
    cosine: Lanes<f64>,
    /// Whether the light reaches the front of the surface.
    counts: Lanes<bool>,
    angle: Lanes<Angle>,
    /// The cosine of the highlight to its power.
    power: Lanes<f64>,
}

impl Gloss {
    /// Creates the sum; `k_a` defaults to `k_d`.
    pub(crate) fn new(
        k_a: Option<&TextureRef>,
        k_d: &TextureRef,
        k_s: &TextureRef,
        exponent: f64,
        context: &mut dyn Context,
    ) -> Result<Self, SceneErrors> {
        let mut errors = SceneErrors::default();
        let k_d = errors.take(context.texture(k_d));
        let k_s = errors.take(context.texture(k_s));
        let k_a = match k_a {
            Some(k_a) => errors.take(context.texture(k_a)),
            None => k_d.clone(),
        };
        match (k_a, k_d, k_s) {
            (Some(k_a), Some(k_d), Some(k_s)) => errors.into_result(Self {
                k_a,
                k_d,
                k_s,
                exponent,
            }),
            _ => Err(errors),
        }
    }

    pub(crate) fn is_black(&self) -> bool {
        self.k_a.is_black() && self.k_d.is_black() && self.k_s.is_black()
    }

    pub(crate) fn needs(&self) -> SurfaceAttributes {
        SurfaceAttributes::SHADING_NORMAL | self.k_a.needs() | self.k_d.needs() | self.k_s.needs()
    }

    pub(crate) fn local_illumination(
        &self,
        highlight: Highlight,
        point: &SurfaceInteraction,
        view: DVec3,
        light: &LightSamples<'_>,
    ) -> Rgb {
        let mut sum = if light.ambient.is_black() {
            Rgb::BLACK
        } else {
            self.k_a.value(point) * light.ambient
        };
        if light.lights.is_empty() {
            return sum;
        }
        let n = point.n_towards(view);
        let (k_d, k_s) = (self.k_d.value(point), self.k_s.value(point));
        for incoming in light.lights {
            let l = incoming.direction;
            let cosine = n.dot(l);
            if cosine <= 0.0 {
                continue;
            }
            let power = if k_s.is_black() {
                0.0
            } else {
                highlight.angle(n, l, view).cosine_power(self.exponent)
            };
            sum += reflected([k_d, k_s], [cosine, power], incoming.irradiance);
        }
        sum
    }

    /// [`Self::local_illumination`] for every point of a stream.
    pub(crate) fn local_illumination_stream(
        &self,
        highlight: Highlight,
        points: &SurfaceStream,
        ambient: Rgb,
        lights: &SampleStreams,
        out: &mut Colors,
    ) {
        let len = points.len;
        if ambient.is_black() {
            out.fill(len, Rgb::BLACK);
        } else {
            self.k_a.value_stream(points, out);
            for lane in whole_groups(len) {
                out.set(lane, out.get(lane) * ambient);
            }
        }
        if lights.is_empty() {
            return;
        }
        let [mut k_d, mut k_s] = [Colors::default(), Colors::default()];
        self.k_d.value_stream(points, &mut k_d);
        self.k_s.value_stream(points, &mut k_s);
        let mut lit = Lit {
            cosine: [0.0; LANES],
            counts: [false; LANES],
            angle: [Angle::default(); LANES],
            power: [0.0; LANES],
        };
        for light in lights.iter() {
            // Each loop knows its highlight, so that both are vectorised.
            match highlight {
                Highlight::Phong => lit.angles(Highlight::Phong, points, light),
                Highlight::BlinnPhong => lit.angles(Highlight::BlinnPhong, points, light),
            }
            for lane in 0..len {
                lit.power[lane] = if lit.counts[lane] & !k_s.get(lane).is_black() {
                    lit.angle[lane].cosine_power(self.exponent)
                } else {
                    0.0
                };
            }
            simd::dispatch(
                #[inline(always)]
                || {
                    for lane in whole_groups(len) {
                        let coefficients = [k_d.get(lane), k_s.get(lane)];
                        let cosines = [lit.cosine[lane], lit.power[lane]];
                        let before = out.get(lane);
                        let after = before + reflected(coefficients, cosines, light.irradiance.get(lane));
                        out.set(lane, if lit.counts[lane] { after } else { before });
                    }
                },
            );
        }
    }
}

impl Lit {
    /// Computes everything but the powers.
    #[inline(always)]
    fn angles(&mut self, highlight: Highlight, points: &SurfaceStream, light: &SampleStream) {
        simd::dispatch(
            #[inline(always)]
            || {
                for lane in whole_groups(points.len) {
                    let view = points.view.get(lane);
                    let n = points.get(lane).n_towards(view);
                    let l = light.direction.get(lane);
                    let cosine = n.dot(l);
                    self.cosine[lane] = cosine;
                    self.counts[lane] = (cosine > 0.0) & !light.irradiance.get(lane).is_black();
                    self.angle[lane] = highlight.angle(n, l, view);
                }
            },
        );
    }
}
