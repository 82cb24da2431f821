//! What lies all around, as a texture on the sphere of directions: seen behind everything and in mirrors, and a light if asked for.
//!
//! Blinn and Newell, *Texture and reflection in computer generated images*, 1976 (the picture by latitude and longitude); Greene, *Environment
//! mapping and other applications of world projections*, 1986. It lights by a fixed quadrature: directions that share the sphere equally.
//!
//! - Twin: through the driver, which looks up the same texture.
//! - Example: `scenes/lights/environment.toml`.

use schemars::JsonSchema;
use serde::Deserialize;
use std::f64::consts::{FRAC_1_PI, PI, TAU};
use std::sync::Arc;
use whitstone_core::config::{IntegerIn, TextureRef};
use whitstone_core::stream::{SampleStreams, Vectors};
use whitstone_core::{
    ColorSource, Context, DVec2, DVec3, Light, LightGives, LightSample, Lights, Plugin, Rgb, SceneErrors,
    SurfacePoint,
};

/// What lies all around: seen behind everything, and a light if asked for.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Radiance in W/(m² sr); a texture on the sphere of directions, such as a picture by latitude and longitude, or a colour.
    radiance: TextureRef,
    /// Rows of directions from which it lights; twice their square is the number of shadow rays at each surface point. 0: it
    /// is seen and lights nothing.
    #[serde(default = "zero")]
    samples: IntegerIn<0, 32>,
}

fn zero() -> IntegerIn<0, 32> {
    IntegerIn::new(0).expect("0 is in range")
}

/// See the module.
pub struct Environment {
    radiance: ColorSource,
    /// From where it lights.
    samples: Vec<LightSample>,
}

impl Plugin<Lights> for Environment {
    const TYPE: &'static str = "environment";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Light>, SceneErrors> {
        let radiance = context.texture(&config.radiance)?;
        let n = config.samples.get();
        let solid_angle = TAU / f64::from(n * n);
        let sample = |j: u32, i: u32| {
            let y = 1.0 - 2.0 * (f64::from(j) + 0.5) / f64::from(n);
            let (sin, cos) = (PI * (f64::from(i) + 0.5) / f64::from(n)).sin_cos();
            let r = (1.0 - y * y).sqrt();
            let direction = DVec3::new(r * cos, y, r * sin);
            LightSample {
                direction,
                distance: f64::INFINITY,
                irradiance: radiance
                    .value(&place(direction))
                    .map(|l| (l * solid_angle).min(f64::MAX)),
            }
        };
        let samples = (0..n).flat_map(|j| (0..2 * n).map(move |i| (j, i)));
        let samples = samples.map(|(j, i)| sample(j, i)).collect();
        Ok(Arc::new(Self { radiance, samples }))
    }
}

/// The point of the sphere of directions: v is 1 straight up, u is 1/2 towards -z and grows to the right from there.
fn place(direction: DVec3) -> SurfacePoint {
    let DVec3 { x, y, z } = direction;
    let mut point = SurfacePoint::new(direction, 0.0, direction);
    let u = 0.5 + 0.5 * FRAC_1_PI * x.atan2(-z);
    let v = 0.5 + FRAC_1_PI * y.atan2(x.hypot(z));
    point.uv = DVec2::new(u, v);
    point
}

impl Light for Environment {
    fn gives(&self) -> LightGives {
        if self.samples.is_empty() {
            LightGives::BACKGROUND
        } else {
            LightGives::BACKGROUND | LightGives::SAMPLES
        }
    }

    fn samples(&self, _: DVec3, out: &mut Vec<LightSample>) {
        out.extend_from_slice(&self.samples);
    }

    fn samples_stream(&self, len: usize, _: &Vectors, out: &mut SampleStreams) {
        for sample in &self.samples {
            let stream = out.add();
            for lane in 0..len {
                stream.set(lane, sample);
            }
        }
    }

    fn background(&self, direction: DVec3) -> Rgb {
        self.radiance.value(&place(direction))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{Needs, Texture};
    use whitstone_testkit::{TestContext, build_in, light_laws};

    /// (u, v) as red and green.
    struct Ramp;

    impl Texture for Ramp {
        fn needs(&self) -> Needs {
            Needs::UV
        }

        fn value(&self, point: &SurfacePoint) -> Rgb {
            Rgb::new(point.uv.x, point.uv.y, 0.0)
        }
    }

    fn environment(text: &str) -> Result<Arc<dyn Light>, SceneErrors> {
        let mut context = TestContext::default().with_texture("ramp", Ramp);
        build_in::<Lights, Environment>(text, (), &mut context)
    }

    #[test]
    fn laws() {
        for text in [
            "radiance = [1, 2, 3]",
            "radiance = \"ramp\"",
            "radiance = \"ramp\"\nsamples = 3",
        ] {
            light_laws(&*environment(text).unwrap());
        }
    }

    #[test]
    fn directions_have_places() {
        let light = environment("radiance = \"ramp\"").unwrap();
        for (direction, u, v) in [
            (DVec3::NEG_Z, 0.5, 0.5),
            (DVec3::X, 0.75, 0.5),
            (DVec3::NEG_X, 0.25, 0.5),
            (DVec3::new(0.0, 0.6, -0.6), 0.5, 0.75),
        ] {
            let found = light.background(direction);
            assert!(
                (found.r - u).abs() < 1e-15 && (found.g - v).abs() < 1e-15,
                "{direction}: {found:?}"
            );
        }
        assert_eq!(light.background(DVec3::Y).g, 1.0);
        assert_eq!(light.background(DVec3::NEG_Y).g, 0.0);
    }

    /// An even sky gives pi times its radiance, whatever the number of directions is.
    #[test]
    fn an_even_sky() {
        for n in [1, 4, 31] {
            let mut samples = Vec::new();
            environment(&format!("radiance = 2\nsamples = {n}"))
                .unwrap()
                .samples(DVec3::ZERO, &mut samples);
            assert_eq!(samples.len(), 2 * n * n);
            let total: f64 = samples.iter().map(|sample| sample.irradiance.g).sum();
            assert!((total / (8.0 * PI) - 1.0).abs() < 1e-13);
            let up: f64 = samples
                .iter()
                .map(|s| s.irradiance.g * s.direction.y.max(0.0))
                .sum();
            let tolerance = 1.0 / f64::from(n as u32);
            assert!((up / (2.0 * PI) - 1.0).abs() <= tolerance, "{n}: {up}");
        }
    }

    #[test]
    fn bad_values_are_refused_at_their_places() {
        let text = "radiance = -1\nsamples = 100";
        assert_eq!(environment(text).err().unwrap().0.len(), 2);
        assert!(environment("samples = 1").is_err());
    }
}
