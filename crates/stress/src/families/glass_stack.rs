//! Panes of glass in nested instances.

use crate::families::gaps::offset;
use crate::families::optics::fresnel;
use crate::lab::{rows, textbook_of, tree};
use crate::{About, Answer, Engine, Family, Lab, Limit, Sample, decades};
use serde_json::json;
use whitstone_core::{DVec3, Ray};
use whitstone_oracle::naive::{DoubleDouble, Real, Textbook};
use whitstone_oracle::optics::{power, refract};
use whitstone_render::Pipeline;
use whitstone_testkit::Random;

/// Number of panes. Each one is in a group, with an instance of the group of the next.
const PANES: u32 = 8;
/// Indices of refraction of the glass.
const INDICES: [f64; 3] = [1.0 + 1e-6, 1.5, 2.0];

/// Panes that become thinner towards a plane. Each nested instance flattens all further ones.
pub(crate) struct GlassStack;

impl GlassStack {
    /// Every pane lies between 0.6 and 1 of the height of its group. The background sends the light
    /// that passes; reflected rays carry too little to be followed far.
    fn scene(ratio: f64, ior: f64) -> String {
        let flat = ratio.powf(-1.0 / f64::from(PANES - 1));
        let mut scene = format!(
            "integrator = {{ type = \"whitted\", max_depth = {}, min_contribution = 0.02 }}\n\
             [[shape]]\ntype = \"instance\"\ngroup = \"pane1\"\n",
            2 * PANES + 1
        );
        for pane in 1..=PANES {
            scene += &format!(
                "[[group.pane{pane}.shape]]\ntype = \"box\"\n\
                 transform = [{{ scale = [8, 8, 0.2] }}, {{ translate = [0, 0, 0.8] }}]\n\
                 material = {{ type = \"dielectric\", interior_ior = {ior:?} }}\n"
            );
            if pane < PANES {
                let next = pane + 1;
                scene += &format!(
                    "[[group.pane{pane}.shape]]\ntype = \"instance\"\ngroup = \"pane{next}\"\n\
                     transform = {{ scale = [1, 1, {flat:?}] }}\n"
                );
            }
        }
        scene
    }

    /// The ray that goes straight on through all faces: its share of the light.
    fn passed(pipeline: &Pipeline, ray: &Ray) -> Option<f64> {
        let nodes = tree(pipeline, ray);
        let straight = nodes
            .iter()
            .filter(|node| node.path.bytes().all(|letter| letter == b'T'));
        let (faces, behind): (Vec<_>, Vec<_>) = straight.partition(|node| node.shape >= 0);
        match &behind[..] {
            [last] if faces.len() as u32 == 2 * PANES => Some(last.throughput.r),
            _ => None,
        }
    }
}

impl Family for GlassStack {
    fn about(&self) -> About {
        About {
            name: "glass_stack",
            catalogue: &[13, 36],
            parameter: "thickness of the first of 8 panes of glass in nested instances over that of the last",
            measure: "relative error of the light that passes all faces; another number of faces is a wrong answer",
            promise: "16 faces, 1e-12",
            pass: 1e-12,
            usable: 1e-3,
            reach: 1e12,
            floor: 64.0 * f64::EPSILON,
            limit: Some(Limit::Format),
        }
    }

    fn parameters(&self) -> Vec<f64> {
        decades(3, 24)
    }

    fn step(&self, ratio: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let [mut ours, mut wide, mut double, mut single_precision] = [Sample::default(); 4];
        let mut theirs: Answer = Ok(Sample::default());
        for ior in INDICES {
            let scene = Self::scene(ratio, ior);
            let pipeline = lab.pipeline(&scene)?;
            let textbooks = (
                textbook_of::<DoubleDouble>(&scene, 0)?,
                textbook_of::<f64>(&scene, 0)?,
                textbook_of::<f32>(&scene, 0)?,
            );
            let mut random = Random::new(ratio.to_bits());
            let mut rays = Vec::new();
            for _ in 0..lab.rays.min(100) {
                let origin = DVec3::new(random.signed(), random.signed(), 2.0);
                let across = 0.5 * random.cube();
                rays.push(Ray::new(origin, DVec3::new(across.x, across.y, -1.0).normalize()));
            }
            for ray in &rays {
                let exact = refract(ray.direction, DVec3::Z, ior).ok_or("total internal reflection")?;
                let truth = power(1.0 - exact.reflectance, 2 * PANES);
                let add = |sample: &mut Sample, found: Option<f64>| match found {
                    Some(found) => sample.add((found / truth - 1.0).abs()),
                    None => sample.failures += 1,
                };
                add(&mut ours, Self::passed(&pipeline, ray));
                add(&mut wide, through(&*textbooks.0, ray, ior));
                add(&mut double, through(&*textbooks.1, ray, ior));
                add(&mut single_precision, through(&*textbooks.2, ray, ior));
            }
            let request = json!({ "op": "walk", "scene": scene, "rays": rows(&rays), "mode": "through", "limit": 4 * PANES });
            theirs = theirs.and_then(|mut sample| {
                let answer = lab.mitsuba(request)?;
                let counts = answer["counts"].as_array().ok_or("no counts")?;
                let wrong = counts
                    .iter()
                    .filter(|count| count.as_u64() != Some(u64::from(2 * PANES)));
                sample.failures += wrong.count() as u64;
                Ok(sample)
            });
        }
        Ok(vec![
            (Engine::Whitstone, Ok(ours)),
            (Engine::Mitsuba, theirs),
            (Engine::NaiveDoubleDouble, Ok(wide)),
            (Engine::NaiveF64, Ok(double)),
            (Engine::NaiveF32, Ok(single_precision)),
        ])
    }
}

/// The light that passes all panes, by the textbook: refraction at horizontal faces in turn, into
/// the glass and out of it, with a constant offset behind each. `None` for another number of faces.
fn through<R: Real>(stack: &dyn Textbook<R>, ray: &Ray, ior: f64) -> Option<f64> {
    let mut origin = ray.origin.to_array().map(R::of);
    let mut direction = ray.direction.to_array().map(R::of);
    let (mut light, mut faces) = (R::of(1.0), 0);
    while let Some(t) = stack.intersect(origin, direction) {
        faces += 1;
        if faces > 2 * PANES {
            return None;
        }
        let ior = R::of(ior);
        let eta = if faces % 2 == 1 { ior } else { R::of(1.0) / ior };
        let [reflectance, cosine] = fresnel(-direction[2], eta)?;
        light = light * (R::of(1.0) - reflectance);
        let place = [0, 1, 2].map(|i| origin[i] + t * direction[i]);
        direction = [direction[0] / eta, direction[1] / eta, -cosine];
        origin = [0, 1, 2].map(|i| place[i] + offset::<R>() * direction[i]);
    }
    (faces == 2 * PANES).then(|| light.to_f64())
}
