//! Thin parts of solids.

use crate::families::gaps::faces_met;
use crate::lab::{single, textbook_of};
use crate::{About, Answer, Engine, Family, Lab, Limit, Sample, decades};
use whitstone_core::{DVec3, Interval, Ray, SelfHitFilter};
use whitstone_oracle::naive::DoubleDouble;
use whitstone_render::Pipeline;
use whitstone_testkit::Random;

/// A hollow ball, the difference of two: a ray through its middle meets four faces. If a shell is
/// thinner than rounding, both of its faces may be left out, but never one of them.
pub(crate) struct Shell;

/// Thickness of the shell, over the radius, below which its faces may be left out in pairs.
const THINNEST: f64 = 1e-14;

impl Family for Shell {
    fn about(&self) -> About {
        About {
            name: "csg_shell",
            catalogue: &[27],
            parameter: "thickness of a hollow ball over its radius",
            measure: "none: only another number of faces than 4 is a wrong answer",
            promise: "4 faces down to 1e-14; below, an even number",
            pass: 0.0,
            usable: 0.0,
            reach: THINNEST,
            floor: 0.0,
            limit: Some(Limit::Format),
        }
    }

    fn parameters(&self) -> Vec<f64> {
        decades(-1, -18)
    }

    fn step(&self, thickness: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let inner = 1.0 - thickness;
        let scene = format!(
            "[[shape]]\ntype = \"csg\"\noperation = \"difference\"\n\
             operands = [{{ type = \"sphere\" }}, {{ type = \"sphere\", radius = {inner:?} }}]\n"
        );
        let pipeline = lab.pipeline(&scene)?;
        let (double, single_precision) = (textbook_of::<f64>(&scene, 0)?, textbook_of::<f32>(&scene, 0)?);
        let double_double = textbook_of::<DoubleDouble>(&scene, 0)?;
        let mut random = Random::new(thickness.to_bits());
        let [mut ours, mut wide, mut naive_f64, mut naive_f32] = [Sample::default(); 4];
        for _ in 0..lab.rays {
            let target = 0.5 * random.cube();
            let origin = 3.0 * random.direction();
            let ray = single(origin, (target - origin).normalize());
            let found = faces(&pipeline, &ray);
            ours.failures += u64::from(found != 4);
            ours.excused += u64::from(found != 4 && found.is_multiple_of(2) && thickness < THINNEST);
            wide.failures += u64::from(faces_met::<DoubleDouble>(&*double_double, &ray) != 4);
            naive_f64.failures += u64::from(faces_met::<f64>(&*double, &ray) != 4);
            naive_f32.failures += u64::from(faces_met::<f32>(&*single_precision, &ray) != 4);
        }
        Ok(vec![
            (Engine::Whitstone, Ok(ours)),
            (
                Engine::Mitsuba,
                Err("no twin: the driver combines the solids, not Mitsuba".to_owned()),
            ),
            (Engine::NaiveDoubleDouble, Ok(wide)),
            (Engine::NaiveF64, Ok(naive_f64)),
            (Engine::NaiveF32, Ok(naive_f32)),
        ])
    }
}

/// Number of faces that a ray meets on its straight way through a scene.
fn faces(pipeline: &Pipeline, ray: &Ray) -> u64 {
    let (mut ray, mut skip, mut count) = (*ray, SelfHitFilter::NOTHING, 0);
    while let Some(hit) = pipeline
        .scene
        .accelerator
        .intersect(&ray, Interval::FORWARD, skip)
    {
        count += 1;
        if count > 16 {
            break;
        }
        let point = pipeline.scene.surface(&ray, &hit);
        ray = Ray::new(point.spawn_origin(ray.direction), ray.direction);
        skip = SelfHitFilter::leaving(&hit);
    }
    count
}

/// A small box far from the origin.
pub(crate) static TINY: crate::rays::RayFamily = crate::rays::RayFamily {
    about: About {
        name: "tiny_and_offset",
        catalogue: &[3],
        parameter: "distance of a box from the origin over half of its size",
        measure: "error of t, in half sizes",
        promise: "16 ulp x condition, no wrong class",
        pass: 16.0,
        usable: 1e-3,
        reach: 1e8,
        floor: 4.0,
        limit: None,
    },
    // Further away, rays from 8 sizes away start in the middle of the box after rounding.
    parameters: || decades(0, 15),
    scene: |ratio| {
        format!(
            "[[shape]]\ntype = \"box\"\ntransform = [{{ scale = {:?} }}, {{ translate = [1, -1, 0.5] }}]\n",
            1.0 / ratio
        )
    },
    ray: |ratio, random| {
        let size = 1.0 / ratio;
        let center = DVec3::new(1.0, -1.0, 0.5);
        let origin = center + 8.0 * size * random.direction();
        // Towards the middle of the box, or clearly past its corners.
        let (miss, edge) = match random.below(4) {
            0 => (1.8 + 0.5 * random.unit(), 1.75),
            _ => (0.9 * random.unit(), 1.0),
        };
        crate::rays::past_in_double(center, origin, miss * size, edge * size, random)
    },
    unit: |ratio, _| 1.0 / ratio,
    one_measure: false,
    shown: crate::rays::Shown::Whole,
};
