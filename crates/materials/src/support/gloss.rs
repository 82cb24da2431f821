//! The shading sum of the lecture notes, shared by `phong`, `blinn_phong` and `whitted`.

use crate::support::optics::{cosine_power, reflect};
use whitstone_core::config::TextureRef;
use whitstone_core::{
    ColorSource, Context, DVec3, LightSamples, Rgb, SceneErrors, SurfaceAttributes, SurfaceInteraction,
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
            let mut response = k_d * cosine;
            if !k_s.is_black() {
                let power = match highlight {
                    Highlight::Phong => cosine_power(reflect(n, l), view, self.exponent),
                    // There is no half vector if l = -view.
                    Highlight::BlinnPhong => (l + view)
                        .try_normalize()
                        .map_or(0.0, |h| cosine_power(n, h, self.exponent)),
                };
                response += k_s * power;
            }
            sum += response * incoming.irradiance;
        }
        sum
    }
}
