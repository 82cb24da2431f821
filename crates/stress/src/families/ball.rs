//! A ray trapped in a glass ball.

use crate::lab::{textbook_of, tree};
use crate::{About, Answer, Engine, Family, Lab, Sample, decades};
use whitstone_core::{DVec3, Ray};
use whitstone_oracle::naive::{Real, Textbook};

/// Repeated total internal reflection; every chord is 0.8 radii from the centre.
pub(crate) struct InsideBall;

impl Family for InsideBall {
    fn about(&self) -> About {
        About {
            name: "inside_ball",
            catalogue: &[17],
            parameter: "number of reflections inside a glass ball",
            measure: "position error of the last reflection, in radii",
            promise: "1e-9, no ray lost",
            pass: 1e-9,
            usable: 1e-5,
        }
    }

    fn parameters(&self) -> Vec<f64> {
        decades(0, 3)
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
        let nodes = tree(&pipeline, &ray);
        let last = nodes.iter().filter(|node| node.shape >= 0).collect::<Vec<_>>();
        let mut ours = Sample::default();
        match last.last() {
            Some(node) if last.len() as f64 == bounces + 1.0 => ours.add(node.position.distance(truth)),
            _ => ours.failures = 1,
        }
        let naive = |place: [f64; 3]| Ok(Sample::new(DVec3::from_array(place).distance(truth)));
        Ok(vec![
            (Engine::Whitstone, Ok(ours)),
            (
                Engine::Mitsuba,
                Err("the driver computes the reflections, not Mitsuba".to_owned()),
            ),
            (
                Engine::NaiveF64,
                naive(walk::<f64>(&*textbook_of(&scene, 0)?, &ray, bounces)),
            ),
            (
                Engine::NaiveF32,
                naive(walk::<f32>(&*textbook_of(&scene, 0)?, &ray, bounces)),
            ),
        ])
    }
}

/// Follows the reflections; each ray starts a constant offset along its direction.
fn walk<R: Real>(ball: &dyn Textbook<R>, ray: &Ray, bounces: f64) -> [f64; 3] {
    let mut origin = ray.origin.to_array().map(R::of);
    let mut direction = ray.direction.to_array().map(R::of);
    for bounce in 0..=bounces as u32 {
        if bounce > 0 {
            origin = [0, 1, 2].map(|i| origin[i] + R::of(1e-4) * direction[i]);
        }
        let Some(t) = ball.intersect(origin, direction) else {
            break;
        };
        origin = [0, 1, 2].map(|i| origin[i] + t * direction[i]);
        // The normal of the unit sphere at a point is the point itself.
        let along = origin[0] * direction[0] + origin[1] * direction[1] + origin[2] * direction[2];
        direction = [0, 1, 2].map(|i| direction[i] - R::of(2.0) * along * origin[i]);
    }
    origin.map(R::to_f64)
}
