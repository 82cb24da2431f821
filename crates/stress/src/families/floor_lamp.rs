//! A lamp that almost touches the surface that it lights.

use crate::families::gaps::offset;
use crate::lab::{Backends, radiance, single, textbook_of};
use crate::{About, Answer, Engine, Family, Lab, Limit, Sample, decades, view};
use std::f64::consts::PI;
use whitstone_core::{DVec3, Ray};
use whitstone_oracle::naive::{DoubleDouble, Real, Textbook};
use whitstone_render::Pipeline;
use whitstone_testkit::Random;

/// Corners of two triangles in the plane x + y + z = 3, which is exact. The lamp is at the middle
/// of the first one, the shaded points lie in the second one.
const CORNERS: [[[f64; 3]; 3]; 2] = [
    [[3.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 3.0]],
    [[3.0, 3.0, -3.0], [0.0, 3.0, 0.0], [3.0, 0.0, 0.0]],
];

/// The floor must not hide a lamp just above it, and must get no light from one just below.
pub(crate) struct LightOnSurface;

impl LightOnSurface {
    fn scene(lamp: DVec3) -> String {
        let [x, y, z] = lamp.to_array();
        let floor: String = CORNERS
            .iter()
            .map(|corners| {
                format!(
                    "[[shape]]\ntype = \"triangle\"\nvertices = {corners:?}\nmaterial = {{ type = \"matte\", reflectance = 1 }}\n"
                )
            })
            .collect();
        format!("[[light]]\ntype = \"point\"\nposition = [{x:?}, {y:?}, {z:?}]\nintensity = 1\n{floor}")
    }
}

impl Family for LightOnSurface {
    fn about(&self) -> About {
        About {
            name: "light_on_surface",
            catalogue: &[21],
            parameter: "height of a lamp above or below a floor of two triangles, metres away from the lit points",
            measure: "error of the lamp's height as its light shows it, over the height; light of a lamp below the floor counts like that of one as high above",
            promise: "16 ulp of the coordinates",
            pass: 16.0,
            usable: 1e-2,
            reach: 1e-12,
            floor: 4.0,
            limit: Some(Limit::Format),
        }
    }

    fn parameters(&self) -> Vec<f64> {
        decades(-1, -17)
    }

    fn view(&self, height: f64, _: &Lab<'_>) -> Result<String, String> {
        let scene = Self::scene(DVec3::splat(1.0 + height / 3f64.sqrt()));
        let lit = CORNERS[1].map(DVec3::from_array).into_iter().sum::<DVec3>() / 3.0;
        Ok(view::seen(&scene, lit + 2.0, lit, 30.0))
    }

    fn step(&self, height: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let mut random = Random::new(height.to_bits());
        let rays: Vec<Ray> = (0..lab.rays)
            .map(|_| {
                let [a, b, c] = CORNERS[1].map(DVec3::from_array);
                let (v, w) = (0.1 + 0.3 * random.unit(), 0.1 + 0.3 * random.unit());
                let target = a + v * (b - a) + w * (c - a);
                let origin = target + DVec3::ONE + 0.3 * random.cube();
                single(origin, target - origin)
            })
            .collect();
        let [mut ours, mut double_double, mut double, mut single_precision] = [Sample::default(); 4];
        let mut backends = Backends::default();
        for side in [1.0, -1.0] {
            let lamp = DVec3::splat(1.0 + side * height / 3f64.sqrt());
            // The height of the lamp as rounded.
            let exact = (lamp.x - 1.0) * 3f64.sqrt();
            let scene = Self::scene(lamp);
            let judge = |found: &mut dyn FnMut(&Ray) -> f64| {
                let mut sample = Sample::default();
                for ray in &rays {
                    let t = (3.0 - ray.origin.element_sum()) / ray.direction.element_sum();
                    let square = (lamp - ray.at(t)).length_squared();
                    // The height of the lamp as its light shows it.
                    let shown = found(ray) * PI * square * square.sqrt();
                    let off = (shown - exact.max(0.0)).abs();
                    if !off.is_finite() {
                        sample.nonfinite += 1;
                        continue;
                    }
                    sample.join(&Sample {
                        error: off / height,
                        // In units in the last place of the largest coordinate.
                        strict: off / (3.0 * f64::EPSILON),
                        ..Sample::default()
                    });
                }
                sample
            };
            let lit = |pipeline: &Pipeline| judge(&mut |ray| radiance(pipeline, ray).r);
            ours.join(&lit(&lab.pipeline(&scene)?));
            backends.ask(lab, &scene, &lit);
            double_double.join(&textbook::<DoubleDouble>(&scene, lamp, judge)?);
            double.join(&textbook::<f64>(&scene, lamp, judge)?);
            single_precision.join(&textbook::<f32>(&scene, lamp, judge)?);
        }
        let mut answers = vec![
            (Engine::Whitstone, Ok(ours)),
            (
                Engine::Mitsuba,
                Err("the driver computes direct lighting, not Mitsuba".to_owned()),
            ),
            (Engine::NaiveDoubleDouble, Ok(double_double)),
            (Engine::NaiveF64, Ok(double)),
            (Engine::NaiveF32, Ok(single_precision)),
        ];
        answers.extend(backends.into_answers());
        Ok(answers)
    }
}

/// Textbook lighting: the hit point by the ray equation, and a shadow ray that starts at a constant
/// offset above it.
fn textbook<R: Real>(
    scene: &str,
    lamp: DVec3,
    judge: impl Fn(&mut dyn FnMut(&Ray) -> f64) -> Sample,
) -> Result<Sample, String> {
    let floor: [Box<dyn Textbook<R>>; 2] = [textbook_of(scene, 0)?, textbook_of(scene, 1)?];
    let lamp = lamp.to_array().map(R::of);
    let up = R::of(3f64.sqrt().recip());
    let (zero, one) = (R::of(0.0), R::of(1.0));
    Ok(judge(&mut |ray| {
        let (o, d) = (
            ray.origin.to_array().map(R::of),
            ray.direction.to_array().map(R::of),
        );
        let Some(t) = floor[1].intersect(o, d) else {
            return 0.0;
        };
        let origin = [0, 1, 2].map(|i| o[i] + t * d[i] + offset::<R>() * up);
        let to = [0, 1, 2].map(|i| lamp[i] - origin[i]);
        let along = (to[0] + to[1] + to[2]) * up;
        let hides = |triangle: &dyn Textbook<R>| triangle.intersect(origin, to).is_some_and(|t| t < one);
        if along <= zero || floor.iter().any(|triangle| hides(&**triangle)) {
            return 0.0;
        }
        let square = to[0] * to[0] + to[1] * to[1] + to[2] * to[2];
        (along / (square * square.sqrt())).to_f64() / PI
    }))
}
