//! Rays that leave surfaces: shadows of almost touching objects, thin panes, almost touching
//! mirrors, leaks of closed meshes.

use crate::lab::{Backends, rows, single, textbook_of, tree};
use crate::rays::bounds_of;
use crate::{About, Answer, Engine, Family, Lab, Limit, Sample, decades, view};
use rayon::prelude::*;
use serde_json::json;
use whitstone_core::{DVec3, Interval, LoweredShape, Ray, SelfHitFilter};
use whitstone_oracle::naive::{DoubleDouble, Real, Textbook};
use whitstone_oracle::optics::power;
use whitstone_render::Pipeline;
use whitstone_testkit::Random;

/// Textbook spawn offset along the direction of a ray, for scenes of about a metre: a thousand
/// units in the last place. In single precision this is the usual 1e-4.
pub(crate) fn offset<R: Real>() -> R {
    R::of(1024.0 * R::EPSILON)
}

/// A rectangle that almost lies on another: its shadow must exist, and must end at the right place.
pub(crate) struct ShadowGap;

impl ShadowGap {
    /// A floor, a blocker at height `gap` whose edge is at x = `begins`, and a lamp at height 1
    /// above the shaded point.
    fn scene(gap: f64, begins: f64) -> String {
        let middle = begins + 0.5;
        let lamp = Self::lamp(gap);
        format!(
            "{lamp}[[shape]]\ntype = \"rectangle\"\n[[shape]]\ntype = \"rectangle\"\n\
             transform = [{{ scale = [0.5, 1, 1] }}, {{ translate = [{middle:?}, 0, {gap:?}] }}]\n"
        )
    }

    /// The same scene of triangles, with equal size and edges near the shaded point.
    fn scene_of_triangles(gap: f64, begins: f64) -> String {
        let (lamp, floor, ends) = (Self::lamp(gap), sheet(0.0, true, ""), begins + 2.0);
        format!(
            "{lamp}{floor}[[shape]]\ntype = \"triangle\"\n\
             vertices = [[{begins:?}, 2, {gap:?}], [{begins:?}, -2, {gap:?}], [{ends:?}, 0, {gap:?}]]\n"
        )
    }

    fn lamp(gap: f64) -> String {
        let lamp = 0.5 * gap;
        format!("[[light]]\ntype = \"point\"\nposition = [{lamp:?}, 0, 1]\nintensity = 1\n")
    }

    /// A ray from the side to the point half a gap under the blocker.
    fn ray(gap: f64) -> Ray {
        let slope = 0.5f64.sqrt();
        let origin = DVec3::new(-0.5 * gap, 0.0, gap);
        Ray::new(origin, DVec3::new(slope, 0.0, -slope))
    }
}

impl Family for ShadowGap {
    fn about(&self) -> About {
        About {
            name: "shadow_gap",
            catalogue: &[11],
            parameter: "height of a blocker above the shaded surface, in metres, near the origin",
            measure: "none: only wrong answers count; it must be dark under the blocker and bright next to it",
            promise: "no wrong answer",
            pass: 0.0,
            usable: 0.0,
            reach: 1e-13,
            floor: 0.0,
            limit: Some(Limit::Format),
        }
    }

    fn parameters(&self) -> Vec<f64> {
        decades(-1, -18)
    }

    fn view(&self, gap: f64, _: &Lab<'_>) -> Result<String, String> {
        // The shadow begins in the middle of the image.
        let origin = Self::ray(gap).origin;
        Ok(view::seen(&Self::scene(gap, 0.0), origin, DVec3::ZERO, 40.0))
    }

    fn step(&self, gap: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        // Dark under the blocker; bright where its edge is beyond the point.
        let questions = [(0.0, true), (gap, false)];
        let ray = Self::ray(gap);
        let mut ours = Sample::default();
        let mut naive = [Sample::default(); 3];
        let mut theirs: Answer = Ok(Sample::default());
        let mut backends = Backends::default();
        for (begins, dark) in &questions {
            let scene = &Self::scene(gap, *begins);
            let is_wrong = |pipeline: &Pipeline| {
                let value = crate::lab::radiance(pipeline, &ray).r;
                u64::from((value == 0.0) != *dark)
            };
            ours.failures += is_wrong(&lab.pipeline(scene)?);
            backends.ask(lab, &Self::scene_of_triangles(gap, *begins), &|pipeline| Sample {
                failures: is_wrong(pipeline),
                ..Sample::default()
            });
            let place = DVec3::new(0.5 * gap, 0.0, 0.0);
            naive[0].failures += u64::from(shaded::<f64>(&*textbook_of(scene, 1)?, place) != *dark);
            naive[1].failures += u64::from(shaded::<f32>(&*textbook_of(scene, 1)?, place) != *dark);
            naive[2].failures += u64::from(shaded::<DoubleDouble>(&*textbook_of(scene, 1)?, place) != *dark);
            let request = json!({ "op": "occluded", "scene": scene, "rays": rows(&[ray]), "target": [0.5 * gap, 0.0, 1.0] });
            theirs = theirs.and_then(|mut sample| {
                let answer = lab.mitsuba(request)?;
                sample.failures += u64::from(answer["blocked"][0].as_bool() != Some(*dark));
                Ok(sample)
            });
        }
        let mut answers = vec![
            (Engine::Whitstone, Ok(ours)),
            (Engine::Mitsuba, theirs),
            (Engine::NaiveDoubleDouble, Ok(naive[2])),
            (Engine::NaiveF64, Ok(naive[0])),
            (Engine::NaiveF32, Ok(naive[1])),
        ];
        answers.extend(backends.into_answers());
        Ok(answers)
    }
}

/// Whether a ray straight up from `place`, with a constant offset, hits the blocker.
fn shaded<R: Real>(blocker: &dyn Textbook<R>, place: DVec3) -> bool {
    let [x, y, z] = place.to_array().map(R::of);
    let origin = [x, y, z + offset::<R>()];
    blocker.intersect(origin, [0.0, 0.0, 1.0].map(R::of)).is_some()
}

/// A triangle at height `z`, a few metres wide, whose outside is above or below.
pub(crate) fn sheet(z: f64, above: bool, material: &str) -> String {
    let side = if above { 3 } else { -3 };
    format!(
        "[[shape]]\ntype = \"triangle\"\nvertices = [[{}, -3, {z:?}], [{side}, -3, {z:?}], [0, 6, {z:?}]]\n{material}\n",
        -side
    )
}

/// A glass pane has two faces, however thin it is.
pub(crate) struct ThinPane;

impl Family for ThinPane {
    fn about(&self) -> About {
        About {
            name: "thin_pane",
            catalogue: &[13],
            parameter: "thickness of a pane of glass, in metres, near the origin",
            measure: "relative error of the light that passes both faces; another number of faces is a wrong answer",
            promise: "two faces, 1e-12",
            pass: 1e-12,
            usable: 1e-3,
            reach: 1e-10,
            floor: 4.0 * f64::EPSILON,
            limit: None,
        }
    }

    fn parameters(&self) -> Vec<f64> {
        decades(0, -18)
    }

    fn step(&self, thickness: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let half = 0.5 * thickness;
        let integrator = "integrator = { type = \"whitted\", max_depth = 3 }\n";
        let glass = "material = { type = \"dielectric\", interior_ior = 1.5 }\n";
        let scene = format!(
            "{integrator}[[shape]]\ntype = \"box\"\ntransform = {{ scale = [1, 1, {half:?}] }}\n{glass}"
        );
        let ray = Ray::new(DVec3::new(0.125, 0.25, 2.0), DVec3::NEG_Z);
        let ours = Self::passed(&lab.pipeline(&scene)?, &ray);
        let faces = [sheet(half, true, glass), sheet(-half, false, glass)].concat();
        let mut backends = Backends::default();
        backends.ask(lab, &format!("{integrator}{faces}"), &|pipeline| {
            Self::passed(pipeline, &ray)
        });
        let counted = |count: u64| Sample {
            failures: u64::from(count != 2),
            ..Sample::default()
        };
        let request =
            json!({ "op": "walk", "scene": scene, "rays": rows(&[ray]), "mode": "through", "limit": 8 });
        let theirs = lab
            .mitsuba(request)
            .map(|answer| counted(answer["counts"][0].as_u64().unwrap_or(0)));
        let mut answers = vec![
            (Engine::Whitstone, Ok(ours)),
            (Engine::Mitsuba, theirs),
            (
                Engine::NaiveDoubleDouble,
                Ok(counted(faces_met::<DoubleDouble>(
                    &*textbook_of(&scene, 0)?,
                    &ray,
                ))),
            ),
            (
                Engine::NaiveF64,
                Ok(counted(faces_met::<f64>(&*textbook_of(&scene, 0)?, &ray))),
            ),
            (
                Engine::NaiveF32,
                Ok(counted(faces_met::<f32>(&*textbook_of(&scene, 0)?, &ray))),
            ),
        ];
        answers.extend(backends.into_answers());
        Ok(answers)
    }
}

impl ThinPane {
    /// The radiance of a ray behind all faces, and the number of faces it met.
    fn passed(pipeline: &Pipeline, ray: &Ray) -> Sample {
        let nodes = tree(pipeline, ray);
        let straight = nodes
            .iter()
            .filter(|node| node.path.chars().all(|letter| letter == 'T'));
        let (faces, behind): (Vec<_>, Vec<_>) = straight.partition(|node| node.shape >= 0);
        let mut sample = Sample::default();
        match &behind[..] {
            [last] => sample.add((last.throughput.r / (0.96 * 0.96) - 1.0).abs()),
            _ => sample.failures += 1,
        }
        sample.failures += u64::from(faces.len() != 2);
        sample
    }
}

/// Number of faces that a ray meets; it continues from each one with a constant offset.
pub(crate) fn faces_met<R: Real>(shape: &dyn Textbook<R>, ray: &Ray) -> u64 {
    let mut origin = ray.origin.to_array().map(R::of);
    let direction = ray.direction.to_array().map(R::of);
    let mut faces = 0;
    while let Some(t) = shape.intersect(origin, direction).filter(|_| faces < 8) {
        faces += 1;
        let on = t + offset::<R>();
        origin = [0, 1, 2].map(|i| origin[i] + on * direction[i]);
    }
    faces
}

/// Two parallel mirrors with a thousand reflections between them.
pub(crate) struct ParallelMirrors;

const BOUNCES: u32 = 1000;
const REFLECTANCE: f64 = 0.99;

impl Family for ParallelMirrors {
    fn about(&self) -> About {
        About {
            name: "parallel_mirrors",
            catalogue: &[16],
            parameter: "distance between two mirrors, in metres, near the origin",
            measure: "relative error of 0.99^n after a thousand reflections; another number of reflections is a wrong answer",
            promise: "all reflections, 1e-12",
            pass: 1e-12,
            usable: 1e-3,
            reach: 1e-6,
            floor: 1e-12,
            limit: Some(Limit::Format),
        }
    }

    fn parameters(&self) -> Vec<f64> {
        decades(0, -17)
    }

    fn step(&self, spacing: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let material = format!("material = {{ type = \"mirror\", reflectance = {REFLECTANCE:?} }}");
        let around = format!(
            "integrator = {{ type = \"whitted\", max_depth = {BOUNCES} }}\n\
             [[light]]\ntype = \"background\"\nradiance = 1\n"
        );
        let scene = format!(
            "{around}[[shape]]\ntype = \"rectangle\"\n{material}\n\
             [[shape]]\ntype = \"rectangle\"\ntransform = {{ translate = [0, 0, {spacing:?}] }}\n{material}\n"
        );
        let ray = Ray::new(DVec3::new(0.125, 0.25, 0.5 * spacing), DVec3::NEG_Z);
        let expected = power(REFLECTANCE, BOUNCES + 1);
        let reflected = |pipeline: &Pipeline| {
            let nodes = tree(pipeline, &ray);
            let met = nodes.iter().filter(|node| node.shape >= 0).count();
            let mut sample = Sample::new((crate::lab::radiance(pipeline, &ray).r / expected - 1.0).abs());
            sample.failures = u64::from(met != BOUNCES as usize + 1);
            sample
        };
        let ours = reflected(&lab.pipeline(&scene)?);
        let mirrors = [sheet(0.0, true, &material), sheet(spacing, false, &material)].concat();
        let mut backends = Backends::default();
        backends.ask(lab, &format!("{around}{mirrors}"), &reflected);
        // A ray that escapes brings the background, attenuated by the mirrors that it met.
        let counted = |count: u64| {
            let mut sample = Sample::new((power(REFLECTANCE, count as u32) / expected - 1.0).abs());
            sample.failures = u64::from(count != u64::from(BOUNCES) + 1);
            sample
        };
        let request = json!({ "op": "walk", "scene": scene, "rays": rows(&[ray]), "mode": "reflect", "limit": BOUNCES + 1 });
        let theirs = lab
            .mitsuba(request)
            .map(|answer| counted(answer["counts"][0].as_u64().unwrap_or(0)));
        let mut answers = vec![
            (Engine::Whitstone, Ok(ours)),
            (Engine::Mitsuba, theirs),
            (
                Engine::NaiveDoubleDouble,
                Ok(counted(reflections::<DoubleDouble>(&scene, &ray)?)),
            ),
            (Engine::NaiveF64, Ok(counted(reflections::<f64>(&scene, &ray)?))),
            (Engine::NaiveF32, Ok(counted(reflections::<f32>(&scene, &ray)?))),
        ];
        answers.extend(backends.into_answers());
        Ok(answers)
    }
}

/// Number of reflections, with a constant offset from each mirror.
fn reflections<R: Real>(scene: &str, ray: &Ray) -> Result<u64, String> {
    let mirrors: [Box<dyn Textbook<R>>; 2] = [textbook_of(scene, 0)?, textbook_of(scene, 1)?];
    let mut origin = ray.origin.to_array().map(R::of);
    let mut direction = ray.direction.to_array().map(R::of);
    let mut count = 0;
    while count <= u64::from(BOUNCES) {
        let hits = mirrors
            .iter()
            .filter_map(|mirror| mirror.intersect(origin, direction));
        let Some(t) = hits.reduce(|a, b| if b < a { b } else { a }) else {
            break;
        };
        count += 1;
        origin = [0, 1, 2].map(|i| origin[i] + t * direction[i]);
        direction[2] = -direction[2];
        origin[2] = origin[2] + offset::<R>() * direction[2];
    }
    Ok(count)
}

/// A closed mesh far from the origin, seen from inside: no ray may escape, in particular at a
/// vertex or an edge, with any accelerator.
pub(crate) struct Leaks;

/// Width of the tube of the mesh.
const TUBE: f64 = 0.6;
impl Leaks {
    fn mesh(offset: f64) -> String {
        format!(
            "[[shape]]\ntype = \"mesh\"\nfile = \"assets/torus.obj\"\ntransform = {{ translate = [{offset:?}, {:?}, 0] }}\n",
            -offset
        )
    }
}

/// See [`Sample::excused`].
const EXCUSED_ULPS: f64 = 16.0;

/// Rays per batch.
const BATCH: usize = 1 << 15;

impl Family for Leaks {
    fn about(&self) -> About {
        About {
            name: "watertight",
            catalogue: &[7],
            parameter: "distance of a closed mesh from the origin, in radii of the mesh",
            measure: "none: only leaks count; rays are aimed at vertices, edges and triangles",
            promise: "no leak, with any accelerator",
            pass: 0.0,
            usable: 0.0,
            reach: 1e6,
            floor: 0.0,
            limit: Some(Limit::Format),
        }
    }

    fn parameters(&self) -> Vec<f64> {
        decades(0, 16)
    }

    fn view(&self, offset: f64, lab: &Lab<'_>) -> Result<String, String> {
        let mesh = Self::mesh(offset);
        let bounds = bounds_of(&lab.pipeline(&mesh)?);
        let middle = bounds.center();
        let from = DVec3::new(1.0, 1.0, 3.0);
        let radius = 0.5 * bounds.extent().length();
        Ok(view::along(
            &mesh,
            &Ray::new(middle + from, -from),
            middle,
            radius,
        ))
    }

    fn step(&self, offset: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let mesh = Self::mesh(offset);
        let center = DVec3::new(offset, -offset, 0.0);
        let mut pipelines = Vec::new();
        for accelerator in lab.accelerators() {
            pipelines.push(lab.pipeline(&format!("accelerator = {{ type = \"{accelerator}\" }}\n{mesh}"))?);
        }
        let mut random = Random::new(offset.to_bits());
        let mut ours = Sample::default();
        let wished = lab.rays * 100;
        let mut aimed = Vec::new();
        for begin in (0..wished).step_by(BATCH) {
            let batch = aim(&pipelines[0], center, BATCH.min(wished - begin), &mut random)?;
            let found = pipelines.iter().map(|pipeline| leaks(pipeline, &batch));
            ours.failures += found.sum::<u64>();
            // Other engines get only the first batch. Textbook formulas, which test every triangle,
            // get a part of it.
            if begin == 0 {
                aimed = batch;
            }
        }
        // Where a few units in the last place are longer than the tube is wide, any ray may miss.
        let ulp = offset.next_up() - offset;
        if EXCUSED_ULPS * ulp > TUBE {
            ours.excused = ours.failures;
        }
        let lost = |found: &mut dyn Iterator<Item = bool>| Sample {
            failures: found.filter(|hit| !hit).count() as u64,
            ..Sample::default()
        };
        let theirs = |robust| {
            let answer = lab.mitsuba_closest(&mesh, &aimed, robust);
            answer.map(|(found, _)| lost(&mut found.iter().map(Option::is_some)))
        };
        let mut backends = Backends::default();
        backends.ask(lab, &mesh, &|pipeline| Sample {
            failures: leaks(pipeline, &aimed),
            ..Sample::default()
        });
        let few = &aimed[..aimed.len().min(2000)];
        let (double, single) = (textbook_of::<f64>(&mesh, 0)?, textbook_of::<f32>(&mesh, 0)?);
        let numbers = |ray: &Ray| [ray.origin, ray.direction].map(|v| v.to_array());
        let wide = textbook_of::<DoubleDouble>(&mesh, 0)?;
        let of_wide = |ray: [[f64; 3]; 2]| {
            let [o, d] = ray.map(|v| v.map(DoubleDouble::of));
            wide.intersect(o, d).is_some()
        };
        let of_double = |[o, d]: [[f64; 3]; 2]| double.intersect(o, d).is_some();
        let to_single = |v: [f64; 3]| v.map(|x| x as f32);
        let of_single = |[o, d]: [[f64; 3]; 2]| single.intersect(to_single(o), to_single(d)).is_some();
        let mut answers = vec![
            (Engine::Whitstone, Ok(ours)),
            (Engine::Mitsuba, theirs(true)),
            (Engine::MitsubaNotRobust, theirs(false)),
            (
                Engine::NaiveDoubleDouble,
                Ok(lost(&mut few.iter().map(numbers).map(of_wide))),
            ),
            (
                Engine::NaiveF64,
                Ok(lost(&mut few.iter().map(numbers).map(of_double))),
            ),
            (
                Engine::NaiveF32,
                Ok(lost(&mut few.iter().map(numbers).map(of_single))),
            ),
        ];
        answers.extend(backends.into_answers());
        Ok(answers)
    }
}

/// Number of rays that hit nothing.
fn leaks(pipeline: &Pipeline, rays: &[Ray]) -> u64 {
    let accelerator = &pipeline.scene.accelerator;
    let leaves = |ray: &&Ray| {
        accelerator
            .intersect(ray, Interval::FORWARD, SelfHitFilter::NOTHING)
            .is_none()
    };
    rays.par_iter().filter(leaves).count() as u64
}

/// Rays that start in the tube of a torus with the radius 0.7. One third aims at vertices, one
/// third at points on edges, one third at points inside triangles.
fn aim(pipeline: &Pipeline, center: DVec3, count: usize, random: &mut Random) -> Result<Vec<Ray>, String> {
    let Some(LoweredShape::Triangles(mesh)) = pipeline.scene.geometry.shapes().first() else {
        return Err("the shape is not a mesh".to_owned());
    };
    let rays = (0..count).map(|_| {
        let [a, b, c] = mesh.corners(random.below(mesh.triangles.len()) as u32);
        let target = match random.below(3) {
            0 => a,
            1 => a + random.unit() * (b - a),
            _ => a + random.unit() * (b + random.unit() * (c - b) - a),
        };
        let out = (target - center) * DVec3::new(1.0, 1.0, 0.0);
        let origin = center + 0.7 * out.normalize() + 0.05 * random.cube();
        // Beyond this distance, coordinates in single precision cannot lie in the tube.
        match center.x > 1e6 {
            true => Ray::new(origin, target - origin),
            false => {
                let origin = origin.as_vec3().as_dvec3();
                single(origin, target - origin)
            }
        }
    });
    Ok(rays.collect())
}
