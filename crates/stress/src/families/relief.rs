//! Bump and normal maps of any amplitude, from almost flat to almost vertical.
//!
//! Displacement moves the surface itself, and rays hit ordinary triangles.
//! `crates/shapes/src/mesh/displacement.rs` tests that their normals are right at any amplitude.

use crate::{About, Answer, Engine, Family, Lab, Sample, decades};
use whitstone_core::{DVec3, SpecularRays, SurfaceInteraction};
use whitstone_oracle::naive::{DoubleDouble, Real};
use whitstone_testkit::Random;

/// The slope of the height along x, divided by the amplitude.
const RISE: f64 = 2.0;

/// A ramp on a mirror, as a bump map and as a normal map: the direction of the reflected ray
/// reveals its normal.
pub(crate) struct Relief;

impl Relief {
    /// The scenes with their normals.
    fn scenes(amplitude: f64) -> [(String, DVec3); 2] {
        let mirror = |detail: &str| {
            format!(
                "[[shape]]\ntype = \"rectangle\"\nmaterial = {{ {detail}, material = {{ type = \"mirror\" }} }}\n"
            )
        };
        // Between the centres of two voxels, at a quarter and three quarters of a metre.
        let bump = format!(
            "type = \"bump\", scale = {amplitude:?}, \
             height = {{ type = \"solid\", size = [2, 1, 1], values = [0, 1], wrap = \"clamp\" }}"
        );
        let slope = RISE * amplitude;
        // The map stores components from -1 to 1. The expected normal follows from the doubles as
        // written.
        let largest = slope.max(1.0);
        let [x, z] = [-slope, 1.0].map(|part| 0.5 + 0.5 * part / largest);
        let map = format!("type = \"normal_map\", map = [{x:?}, 0.5, {z:?}]");
        [
            (mirror(&bump), DVec3::new(-slope, 0.0, 1.0)),
            (mirror(&map), DVec3::new(2.0 * x - 1.0, 0.0, 2.0 * z - 1.0)),
        ]
    }
}

impl Family for Relief {
    fn about(&self) -> About {
        About {
            name: "relief",
            catalogue: &[44],
            parameter: "amplitude of a bump or normal map, over half a metre",
            measure: "distance between the unit direction of the reflected ray and the true one",
            promise: "1e-12",
            pass: 1e-12,
            usable: 1e-3,
            reach: 1e3,
            floor: 4.0 * f64::EPSILON,
            limit: None,
        }
    }

    fn parameters(&self) -> Vec<f64> {
        decades(-12, 17)
    }

    fn step(&self, amplitude: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let [mut ours, mut wide, mut double, mut single] = [Sample::default(); 4];
        for (scene, normal) in Self::scenes(amplitude) {
            let pipeline = lab.pipeline(&scene)?;
            let normal = normal.normalize();
            let mut random = Random::new(amplitude.to_bits());
            for _ in 0..lab.rays {
                let (view, towards) = loop {
                    let view = random.direction();
                    let towards = normal.dot(view);
                    // A viewer who looks along either surface is on no clear side.
                    if towards.abs().min(view.z.abs()) > 1e-3 {
                        break (view, towards);
                    }
                };
                let place = DVec3::new(0.5 + 0.2 * random.signed(), 0.1, 0.0);
                let mut branches = SpecularRays::default();
                let point = SurfaceInteraction::new(place, 0.0, DVec3::Z);
                pipeline.scene.materials[0].specular_rays(&point, view, &mut branches);
                // A viewer above the surface who sees the perturbed surface from behind sees the
                // unperturbed surface.
                let seen = if towards * view.z > 0.0 { normal } else { DVec3::Z };
                let truth = mirrored(seen, view);
                match branches.iter().next() {
                    Some(branch) => ours.add(branch.direction.distance(truth)),
                    None => ours.failures += 1,
                }
                wide.add(textbook::<DoubleDouble>(amplitude, place.x, view).distance(truth));
                double.add(textbook::<f64>(amplitude, place.x, view).distance(truth));
                single.add(textbook::<f32>(amplitude, place.x, view).distance(truth));
            }
        }
        Ok(vec![
            (Engine::Whitstone, Ok(ours)),
            (
                Engine::Mitsuba,
                Err("the perturbed shading frame is a formula of the driver".to_owned()),
            ),
            (Engine::NaiveDoubleDouble, Ok(wide)),
            (Engine::NaiveF64, Ok(double)),
            (Engine::NaiveF32, Ok(single)),
        ])
    }
}

fn mirrored(normal: DVec3, view: DVec3) -> DVec3 {
    2.0 * normal.dot(view) * normal - view
}

/// Textbook bump mapping (Blinn): finite differences over a small step, without a check whether the
/// perturbed normal faces away.
fn textbook<R: Real>(amplitude: f64, x: f64, view: DVec3) -> DVec3 {
    let (one, step) = (R::of(1.0), R::of(1e-4));
    let height = |x: R| R::of(amplitude) * (R::of(RISE) * x - R::of(0.5));
    let x = R::of(x);
    let slope = (height(x + step) - height(x)) / step;
    let [vx, vy, vz] = view.to_array().map(R::of);
    let length = (slope * slope + one).sqrt();
    let (nx, nz) = (-slope / length, one / length);
    let twice = R::of(2.0) * (nx * vx + nz * vz);
    DVec3::from_array([twice * nx - vx, -vy, twice * nz - vz].map(R::to_f64))
}
