//! Optics at surfaces: indices close to 1, the critical angle, sharp highlights, strong absorption,
//! close light sources.

use crate::families::gaps::offset;
use crate::lab::{radiance, tree};
use crate::{About, Answer, Engine, Family, Lab, Limit, Sample, decades, view};
use serde_json::json;
use whitstone_core::{DVec3, Ray};
use whitstone_oracle::naive::{DoubleDouble, Real};
use whitstone_oracle::optics::{decay, lobe, refract};
use whitstone_testkit::Random;

/// Textbook Fresnel equations: reflectance and cosine of the transmitted ray. `None` for total
/// internal reflection.
pub(crate) fn fresnel<R: Real>(here: R, eta: R) -> Option<[R; 2]> {
    let one = R::of(1.0);
    let square = one - (one - here * here) / (eta * eta);
    if square < R::of(0.0) {
        return None;
    }
    let there = square.sqrt();
    let s = (here - eta * there) / (here + eta * there);
    let p = (eta * here - there) / (eta * here + there);
    Some([R::of(0.5) * (s * s + p * p), there])
}

/// The results of [`fresnel`] in this precision, as doubles.
fn textbook_fresnel<R: Real>(cosine: f64, ior: f64) -> Option<[f64; 2]> {
    fresnel(R::of(cosine), R::of(ior)).map(|both| both.map(R::to_f64))
}

/// Mitsuba's results, in the form of [`textbook_fresnel`].
fn mitsuba(lab: &Lab<'_>, cosines: &[f64], ior: f64) -> Result<Vec<Option<[f64; 2]>>, String> {
    let answer = lab.mitsuba(json!({ "op": "fresnel", "cosines": cosines, "ior": ior }))?;
    let number = |key: &str, at: usize| answer[key][at].as_f64().unwrap_or(f64::NAN);
    let both = (0..cosines.len()).map(|at| {
        let cosine = number("cosine", at).abs();
        (cosine != 0.0).then(|| [number("reflectance", at), cosine])
    });
    Ok(both.collect())
}

/// Glass whose index is almost that of its surroundings.
pub(crate) struct IndexNearOne;

impl Family for IndexNearOne {
    fn about(&self) -> About {
        About {
            name: "index_near_one",
            catalogue: &[14],
            parameter: "index of refraction minus 1",
            measure: "relative error of the reflectance",
            promise: "1e-12",
            pass: 1e-12,
            usable: 1e-2,
            reach: 1e-12,
            floor: 4.0 * f64::EPSILON,
            limit: Some(Limit::Format),
        }
    }

    fn parameters(&self) -> Vec<f64> {
        decades(-1, -17)
    }

    fn step(&self, parameter: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let ior = 1.0 + parameter;
        if ior == 1.0 {
            return Err("the index of refraction rounds to 1".to_owned());
        }
        let pipeline = lab.pipeline(&format!(
            "integrator = {{ type = \"whitted\", max_depth = 1 }}\n[[light]]\ntype = \"background\"\nradiance = 1\n\
             [[shape]]\ntype = \"rectangle\"\nmaterial = {{ type = \"dielectric\", interior_ior = {ior:?} }}\n"
        ))?;
        let mut random = Random::new(14);
        let directions: Vec<DVec3> = (0..lab.rays)
            .map(|_| {
                let mut direction = random.direction();
                direction.z = -direction.z.abs() - 0.3;
                direction.normalize()
            })
            .collect();
        let truths: Vec<f64> = directions
            .iter()
            .map(|direction| refract(*direction, DVec3::Z, ior).map_or(1.0, |exact| exact.reflectance))
            .collect();
        let judged = |found: &mut dyn FnMut(usize) -> Option<f64>| {
            let mut sample = Sample::default();
            for (number, truth) in truths.iter().enumerate() {
                match found(number) {
                    Some(reflectance) => sample.add((reflectance / truth - 1.0).abs()),
                    None => sample.failures += 1,
                }
            }
            sample
        };
        let ours = judged(&mut |number| {
            let nodes = tree(&pipeline, &Ray::new(-directions[number], directions[number]));
            let reflected = nodes.iter().find(|node| node.path == "R");
            reflected.map(|node| node.throughput.r)
        });
        let cosines: Vec<f64> = directions.iter().map(|direction| -direction.z).collect();
        let theirs = mitsuba(lab, &cosines, ior)
            .map(|all| judged(&mut |number| all[number].map(|[reflectance, _]| reflectance)));
        let wide =
            judged(&mut |number| textbook_fresnel::<DoubleDouble>(cosines[number], ior).map(|[r, _]| r));
        let double = judged(&mut |number| textbook_fresnel::<f64>(cosines[number], ior).map(|[r, _]| r));
        let single = judged(&mut |number| textbook_fresnel::<f32>(cosines[number], ior).map(|[r, _]| r));
        Ok(vec![
            (Engine::Whitstone, Ok(ours)),
            (Engine::Mitsuba, theirs),
            (Engine::NaiveDoubleDouble, Ok(wide)),
            (Engine::NaiveF64, Ok(double)),
            (Engine::NaiveF32, Ok(single)),
        ])
    }
}

/// Light leaves glass of index 2 just below the critical angle of 30 degrees.
pub(crate) struct CriticalAngle;

impl Family for CriticalAngle {
    fn about(&self) -> About {
        About {
            name: "critical_angle",
            catalogue: &[15],
            parameter: "difference from the critical angle, in radians",
            measure: "relative error of the cosine of transmission; false or missing total internal reflection is a wrong answer",
            promise: "16 ulp x condition (1 + 1/cos²), right class",
            pass: 16.0,
            usable: 1e-2,
            reach: 1e-12,
            floor: 4.0,
            limit: Some(Limit::Condition),
        }
    }

    fn parameters(&self) -> Vec<f64> {
        decades(-1, -16)
    }

    fn step(&self, parameter: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        // The transmitted ray hits a plane at height 1, at a distance of 1 / cos.
        let pipeline = lab.pipeline(
            "integrator = { type = \"whitted\", max_depth = 1 }\n\
             [[shape]]\ntype = \"plane\"\nmaterial = { type = \"dielectric\", interior_ior = 2 }\n\
             [[shape]]\ntype = \"plane\"\ntransform = { translate = [0, 0, 1] }\n",
        )?;
        let critical = std::f64::consts::FRAC_PI_6;
        let mut random = Random::new(parameter.to_bits());
        let directions: Vec<DVec3> = (0..lab.rays)
            .map(|number| {
                let side = if number % 2 == 0 { -1.0 } else { 1.0 };
                let angle = critical + side * parameter * (1.0 + random.unit());
                let turn = std::f64::consts::TAU * random.unit();
                DVec3::new(angle.sin() * turn.cos(), angle.sin() * turn.sin(), angle.cos())
            })
            .collect();
        let judged = |found: &mut dyn FnMut(usize) -> Option<f64>| {
            let mut sample = Sample::default();
            for (number, direction) in directions.iter().enumerate() {
                match (refract(*direction, DVec3::Z, 0.5), found(number)) {
                    (Some(exact), Some(cosine)) if cosine.is_finite() => {
                        let error = (cosine / exact.cosine - 1.0).abs();
                        let condition = 1.0 + 1.0 / (exact.cosine * exact.cosine);
                        sample.error = sample.error.max(error);
                        sample.strict = sample.strict.max(error / (f64::EPSILON * condition));
                    }
                    (Some(_), Some(_)) => sample.nonfinite += 1,
                    (None, None) => {}
                    _ => sample.failures += 1,
                }
            }
            sample
        };
        let mut ours = judged(&mut |number| {
            let nodes = tree(&pipeline, &Ray::new(-directions[number], directions[number]));
            let out = nodes.iter().find(|node| node.path == "T");
            out.map(|node| 1.0 / node.t)
        });
        // So close to the critical angle, a few roundings of the direction decide the class.
        if parameter < 16.0 * f64::EPSILON {
            ours.excused = ours.failures;
        }
        let cosines: Vec<f64> = directions.iter().map(|direction| direction.z).collect();
        let theirs = mitsuba(lab, &cosines, 0.5)
            .map(|all| judged(&mut |number| all[number].map(|[_, cosine]| cosine)));
        let wide = judged(&mut |number| {
            textbook_fresnel::<DoubleDouble>(cosines[number], 0.5).map(|[_, cosine]| cosine)
        });
        let double =
            judged(&mut |number| textbook_fresnel::<f64>(cosines[number], 0.5).map(|[_, cosine]| cosine));
        let single =
            judged(&mut |number| textbook_fresnel::<f32>(cosines[number], 0.5).map(|[_, cosine]| cosine));
        Ok(vec![
            (Engine::Whitstone, Ok(ours)),
            (Engine::Mitsuba, theirs),
            (Engine::NaiveDoubleDouble, Ok(wide)),
            (Engine::NaiveF64, Ok(double)),
            (Engine::NaiveF32, Ok(single)),
        ])
    }
}

/// A very sharp specular highlight.
pub(crate) struct PhongExponent;

impl Family for PhongExponent {
    fn about(&self) -> About {
        About {
            name: "phong_exponent",
            catalogue: &[20],
            parameter: "exponent of a Phong highlight",
            measure: "relative error of the highlight",
            promise: "1e-7",
            pass: 1e-7,
            usable: 1e-3,
            reach: 1e8,
            floor: 4.0 * f64::EPSILON,
            limit: Some(Limit::Condition),
        }
    }

    fn parameters(&self) -> Vec<f64> {
        decades(0, 17)
    }

    fn step(&self, exponent: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let mut random = Random::new(exponent.to_bits());
        let [mut ours, mut wide, mut double, mut single] = [Sample::default(); 4];
        for _ in 0..lab.rays.min(100) {
            // The mirror direction of the lamp, and a viewer offset from it so that about 1/e of
            // the highlight is left.
            let mut lamp = random.direction();
            lamp.z = lamp.z.abs() + 0.5;
            let mirrored = DVec3::new(-lamp.x, -lamp.y, lamp.z).normalize();
            let angle = (2.0 / exponent).sqrt().min(0.3) * (0.5 + random.unit());
            let side = mirrored.any_orthonormal_vector();
            let eye = (mirrored + angle.tan() * side).normalize();
            if eye.z < 0.05 {
                continue;
            }
            let [x, y, z] = lamp.to_array();
            let scene = |exponent: f64| {
                format!(
                    "[[light]]\ntype = \"point\"\nposition = [{x:?}, {y:?}, {z:?}]\nintensity = 1\n\
                     [[shape]]\ntype = \"rectangle\"\nmaterial = {{ type = \"phong\", k_d = 0, k_s = 1, exponent = {exponent:?} }}\n"
                )
            };
            // Divide by the value for an exponent of 1, to cancel all other factors of the model.
            let ray = Ray::new(eye, -eye);
            let [value, plain] = [exponent, 1.0].map(|exponent| {
                lab.pipeline(&scene(exponent))
                    .map(|pipeline| radiance(&pipeline, &ray).r)
            });
            let unmirrored = DVec3::new(-lamp.x, -lamp.y, lamp.z);
            let [truth, base] = [exponent, 1.0].map(|exponent| lobe(unmirrored, eye, exponent));
            ours.add(((value? / plain?) / (truth / base) - 1.0).abs());
            let add = |sample: &mut Sample, found: f64| sample.add((found / truth - 1.0).abs());
            add(&mut wide, highlight::<DoubleDouble>(unmirrored, eye, exponent));
            add(&mut double, highlight::<f64>(unmirrored, eye, exponent));
            add(&mut single, highlight::<f32>(unmirrored, eye, exponent));
        }
        Ok(vec![
            (Engine::Whitstone, Ok(ours)),
            (
                Engine::Mitsuba,
                Err("the Phong highlight is a formula of the driver".to_owned()),
            ),
            (Engine::NaiveDoubleDouble, Ok(wide)),
            (Engine::NaiveF64, Ok(double)),
            (Engine::NaiveF32, Ok(single)),
        ])
    }
}

/// The textbook highlight: a power of the cosine.
fn highlight<R: Real>(mirrored: DVec3, eye: DVec3, exponent: f64) -> f64 {
    let [mirrored, eye] = [mirrored, eye].map(|v| v.to_array().map(R::of));
    let dot = |a: [R; 3], b: [R; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let length = dot(mirrored, mirrored).sqrt();
    dot(mirrored.map(|part| part / length), eye)
        .powf(R::of(exponent))
        .to_f64()
}

/// Glass that absorbs nearly everything.
pub(crate) struct Absorption;

impl Family for Absorption {
    fn about(&self) -> About {
        About {
            name: "absorption",
            catalogue: &[40],
            parameter: "optical depth of a pane",
            measure: "relative error of the transmitted light",
            promise: "16 ulp x depth, or exactly 0 below the smallest double",
            pass: 16.0,
            usable: 1e-3,
            reach: 1e6,
            floor: 4.0,
            limit: None,
        }
    }

    fn parameters(&self) -> Vec<f64> {
        decades(0, 8)
    }

    fn step(&self, depth: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let [mut ours, mut wide, mut double, mut single] = [Sample::default(); 4];
        for part in [1.0, 0.77, 0.5, 0.3] {
            let sigma = depth * part;
            let pipeline = lab.pipeline(&format!(
                "integrator = {{ type = \"whitted\", max_depth = 2 }}\n[[shape]]\ntype = \"box\"\ntransform = {{ scale = [1, 1, 0.5] }}\n\
                 material = {{ type = \"dielectric\", interior_ior = 1.5, absorption = {sigma:?} }}\n"
            ))?;
            let nodes = tree(&pipeline, &Ray::new(DVec3::new(0.125, 0.25, 2.0), DVec3::NEG_Z));
            let through = nodes
                .iter()
                .find(|node| node.path == "TT")
                .map_or(0.0, |node| node.throughput.r);
            let truth = decay(sigma);
            let judge = |sample: &mut Sample, found: f64| {
                // Below the smallest normal number, only the absolute size of the error counts.
                let error = if truth < f64::MIN_POSITIVE {
                    (found - truth).abs() / f64::MIN_POSITIVE
                } else {
                    (found / truth - 1.0).abs()
                };
                sample.add(error);
                sample.strict = sample.strict.max(error / (f64::EPSILON * sigma.max(1.0)));
            };
            judge(&mut ours, through / (0.96 * 0.96));
            judge(&mut wide, DoubleDouble::of(-sigma).exp().to_f64());
            judge(&mut double, f64::of(-sigma).exp());
            judge(&mut single, f32::of(-sigma).exp().to_f64());
        }
        Ok(vec![
            (Engine::Whitstone, Ok(ours)),
            (
                Engine::Mitsuba,
                Err("absorption is a formula of the driver".to_owned()),
            ),
            (Engine::NaiveDoubleDouble, Ok(wide)),
            (Engine::NaiveF64, Ok(double)),
            (Engine::NaiveF32, Ok(single)),
        ])
    }
}

/// A lamp just above the surface that it lights, a metre or more from the origin.
pub(crate) struct NearLamp;

/// Where the surface is, in metres.
const LEVEL: f64 = 1.0;

impl NearLamp {
    fn scene(height: f64) -> String {
        format!(
            "[[light]]\ntype = \"point\"\nposition = [0, 0, {:?}]\nintensity = 1\n\
             [[shape]]\ntype = \"rectangle\"\ntransform = {{ translate = [0, 0, {LEVEL:?}] }}\nmaterial = {{ type = \"matte\", reflectance = 1 }}\n",
            LEVEL + height
        )
    }
}

impl Family for NearLamp {
    fn about(&self) -> About {
        About {
            name: "near_lamp",
            catalogue: &[21],
            parameter: "height of a lamp above a surface, in metres",
            measure: "relative error of the light",
            promise: "1e-9 down to 1e-6, as coordinates of a metre have 1e-16",
            pass: 1e-9,
            usable: 1e-2,
            reach: 1e-6,
            floor: 4.0 * f64::EPSILON,
            limit: Some(Limit::Format),
        }
    }

    fn parameters(&self) -> Vec<f64> {
        decades(-1, -17)
    }

    fn view(&self, height: f64, _: &Lab<'_>) -> Result<String, String> {
        // A few heights of the surface below the lamp.
        let fov = (4.0 * height).atan().to_degrees();
        let (origin, target) = (DVec3::new(-1.0, 0.0, LEVEL + 1.0), DVec3::new(0.0, 0.0, LEVEL));
        Ok(view::seen(&Self::scene(height), origin, target, fov))
    }

    fn step(&self, height: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let (level, lamp) = (LEVEL, LEVEL + height);
        let pipeline = lab.pipeline(&Self::scene(height))?;
        // From the side, at the point below the lamp; `exact` is the distance of the lamp as
        // rounded to doubles.
        let (slope, exact) = (0.5f64.sqrt(), lamp - level);
        let ray = Ray::new(DVec3::new(-1.0, 0.0, level + 1.0), DVec3::new(slope, 0.0, -slope));
        let value = radiance(&pipeline, &ray).r * std::f64::consts::PI * exact * exact;
        let naive = [
            naive_lamp::<DoubleDouble>(&ray, lamp, level),
            naive_lamp::<f64>(&ray, lamp, level),
            naive_lamp::<f32>(&ray, lamp, level),
        ];
        let [wide, double, single] = naive.map(|light| Sample::new((light * exact * exact - 1.0).abs()));
        Ok(vec![
            (Engine::Whitstone, Ok(Sample::new((value - 1.0).abs()))),
            (
                Engine::Mitsuba,
                Err("the driver computes direct lighting, not Mitsuba".to_owned()),
            ),
            (Engine::NaiveDoubleDouble, Ok(wide)),
            (Engine::NaiveF64, Ok(double)),
            (Engine::NaiveF32, Ok(single)),
        ])
    }
}

/// Textbook lighting: the hit point by the ray equation, with a constant offset above the surface
/// to avoid self-shadowing.
fn naive_lamp<R: Real>(ray: &Ray, lamp: f64, level: f64) -> f64 {
    let (o, d) = (
        ray.origin.to_array().map(R::of),
        ray.direction.to_array().map(R::of),
    );
    let t = (R::of(level) - o[2]) / d[2];
    let [x, y, z] = [0, 1, 2].map(|i| o[i] + t * d[i]);
    let up = R::of(lamp) - (z + offset::<R>());
    let square = x * x + y * y + up * up;
    (up / (square * square.sqrt())).to_f64()
}
