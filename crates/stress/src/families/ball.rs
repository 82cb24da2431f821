//! A ray trapped in a glass ball.

use crate::lab::{textbook_of, tree};
use crate::{About, Answer, Engine, Family, Lab, Sample, decades};
use whitstone_core::{DVec3, Ray};
use whitstone_oracle::naive::{DoubleDouble, Real, Textbook};

/// Repeated total internal reflection; every chord is 0.8 radii from the centre.
pub(crate) struct InsideBall;

impl Family for InsideBall {
    fn about(&self) -> About {
        About {
            name: "inside_ball",
            catalogue: &[17],
            parameter: "number of reflections inside a glass ball",
            measure: "position error of the last reflection, in radii",
            promise: "4 ulp x condition of the chain, no ray lost",
            pass: 4.0,
            usable: 1e-5,
            reach: 1e3,
            floor: 4.0,
            limit: None,
        }
    }

    fn parameters(&self) -> Vec<f64> {
        decades(0, 4)
    }

    fn step(&self, bounces: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let scene = format!(
            "integrator = {{ type = \"whitted\", max_depth = {bounces} }}\n\
             [[shape]]\ntype = \"sphere\"\nmaterial = {{ type = \"dielectric\", interior_ior = 1.5 }}\n"
        );
        let ray = Ray::new(DVec3::new(0.0, 0.8, 0.0), DVec3::X);
        let pipeline = lab.pipeline(&scene)?;
        // The ray starts at the middle of a chord; a chord subtends twice this angle at the centre.
        let half = 0.8f64.acos();
        let angle = std::f64::consts::FRAC_PI_2 - half - 2.0 * bounces * half;
        let truth = DVec3::new(angle.cos(), angle.sin(), 0.0);
        let judge = |place: DVec3| Sample {
            error: place.distance(truth),
            strict: place.distance(truth) / (f64::EPSILON * chain(bounces + 1.0) / half.sin()),
            ..Sample::default()
        };
        let nodes = tree(&pipeline, &ray);
        let last = nodes.iter().filter(|node| node.shape >= 0).collect::<Vec<_>>();
        let mut ours = Sample::default();
        match last.last() {
            Some(node) if last.len() as f64 == bounces + 1.0 => ours = judge(node.position),
            _ => ours.failures = 1,
        }
        let naive = |place: [f64; 3]| Ok(judge(DVec3::from_array(place)));
        Ok(vec![
            (Engine::Whitstone, Ok(ours)),
            (
                Engine::Mitsuba,
                Err("the driver computes the reflections, not Mitsuba".to_owned()),
            ),
            (
                Engine::NaiveDoubleDouble,
                naive(walk::<DoubleDouble>(
                    &*textbook_of(&scene, 0)?,
                    DVec3::ZERO,
                    &ray,
                    bounces as u32,
                )),
            ),
            (
                Engine::NaiveF64,
                naive(walk::<f64>(
                    &*textbook_of(&scene, 0)?,
                    DVec3::ZERO,
                    &ray,
                    bounces as u32,
                )),
            ),
            (
                Engine::NaiveF32,
                naive(walk::<f32>(
                    &*textbook_of(&scene, 0)?,
                    DVec3::ZERO,
                    &ray,
                    bounces as u32,
                )),
            ),
        ])
    }

    fn is_continuous(&self) -> bool {
        false
    }
}

/// The factor by which roundings of a chain of `n` chords move its end, before the division by the
/// sine of half of a chord's angle. A rounding of one direction turns all later chords, by twice
/// its size each. Independent roundings add by their squares.
fn chain(n: f64) -> f64 {
    2.0 * (n * (n + 1.0) * (2.0 * n + 1.0) / 6.0).sqrt()
}

/// Grazing reflections along the inside of a glass ball, a whispering gallery.
pub(crate) struct GrazingGallery;

/// Numbers of reflections at each step.
const GALLERY: [u32; 3] = [10, 100, 1000];

impl Family for GrazingGallery {
    fn about(&self) -> About {
        About {
            name: "grazing_gallery",
            catalogue: &[17],
            parameter: "distance of the chords from the surface of a glass ball, in radii",
            measure: "position error of the last of 10, 100 and 1000 reflections, in radii",
            promise: "4 ulp x condition of the chain, no ray lost",
            pass: 4.0,
            usable: 1e-5,
            reach: 1e-10,
            floor: 4.0,
            limit: None,
        }
    }

    fn parameters(&self) -> Vec<f64> {
        decades(-1, -15)
    }

    fn step(&self, depth: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        // With the top of the ball at the origin, the depth is exact in single precision.
        let (center, depth) = (DVec3::NEG_Y, f64::from(depth as f32));
        let ray = Ray::new(-depth * DVec3::Y, DVec3::X);
        // Half of the angle that a chord subtends at the centre: 2 sin²(half / 2) is its depth.
        let half = 2.0 * (0.5 * depth).sqrt().asin();
        let [mut ours, mut double_double, mut double, mut single] = [Sample::default(); 4];
        for bounces in GALLERY {
            let scene = format!(
                "integrator = {{ type = \"whitted\", max_depth = {bounces} }}\n\
                 [[shape]]\ntype = \"sphere\"\ncenter = [0, -1, 0]\nmaterial = {{ type = \"dielectric\", interior_ior = 1.5 }}\n"
            );
            let turn = half * f64::from(2 * bounces + 1);
            let truth = center + DVec3::new(turn.sin(), turn.cos(), 0.0);
            let condition = chain(f64::from(bounces + 1)) / half.sin();
            let add = |sample: &mut Sample, place: DVec3| {
                let error = place.distance(truth);
                let strict = error / (f64::EPSILON * condition);
                sample.join(&Sample {
                    error,
                    strict,
                    ..Sample::default()
                });
            };
            let pipeline = lab.pipeline(&scene)?;
            let nodes = tree(&pipeline, &ray);
            let met: Vec<_> = nodes.iter().filter(|node| node.shape >= 0).collect();
            match met.last() {
                Some(node) if met.len() as u32 == bounces + 1 => add(&mut ours, node.position),
                _ => ours.failures += 1,
            }
            let place = walk::<DoubleDouble>(&*textbook_of(&scene, 0)?, center, &ray, bounces);
            add(&mut double_double, DVec3::from_array(place));
            let place = walk::<f64>(&*textbook_of(&scene, 0)?, center, &ray, bounces);
            add(&mut double, DVec3::from_array(place));
            let place = walk::<f32>(&*textbook_of(&scene, 0)?, center, &ray, bounces);
            add(&mut single, DVec3::from_array(place));
        }
        Ok(vec![
            (Engine::Whitstone, Ok(ours)),
            (
                Engine::Mitsuba,
                Err("the driver computes the reflections, not Mitsuba".to_owned()),
            ),
            (Engine::NaiveDoubleDouble, Ok(double_double)),
            (Engine::NaiveF64, Ok(double)),
            (Engine::NaiveF32, Ok(single)),
        ])
    }
}

/// Follows the reflections inside a unit sphere; each ray starts a constant offset along its
/// direction.
fn walk<R: Real>(ball: &dyn Textbook<R>, center: DVec3, ray: &Ray, bounces: u32) -> [f64; 3] {
    let center = center.to_array().map(R::of);
    let mut origin = ray.origin.to_array().map(R::of);
    let mut direction = ray.direction.to_array().map(R::of);
    // Short chords need a shorter offset than the usual one.
    let offset = R::of(
        1e-4 * (1.0
            - ray
                .origin
                .distance_squared(DVec3::from_array(center.map(R::to_f64))))
        .sqrt(),
    );
    for bounce in 0..=bounces {
        if bounce > 0 {
            origin = [0, 1, 2].map(|i| origin[i] + offset * direction[i]);
        }
        let Some(t) = ball.intersect(origin, direction) else {
            break;
        };
        origin = [0, 1, 2].map(|i| origin[i] + t * direction[i]);
        let normal = [0, 1, 2].map(|i| origin[i] - center[i]);
        let along = normal[0] * direction[0] + normal[1] * direction[1] + normal[2] * direction[2];
        direction = [0, 1, 2].map(|i| direction[i] - R::of(2.0) * along * normal[i]);
    }
    origin.map(R::to_f64)
}
