//! The same scene in other units and at other positions.

use crate::lab::textbook_of;
use crate::{About, Answer, Engine, Family, Lab, Sample};
use whitstone_core::{DVec3, Ray, Scratch};
use whitstone_oracle::naive::{Real, Textbook};

const WIDTH: u32 = 24;
const HEIGHT: u32 = 16;
/// Number of shapes in the scene.
const SHAPES: usize = 3;

/// Units that are a power of two of a metre: the result must not change, because rounding does not.
pub(crate) struct PowerOfTwo;

/// Units that are a power of ten of a metre.
pub(crate) struct PowerOfTen;

impl Family for PowerOfTwo {
    fn about(&self) -> About {
        About {
            name: "scale_power_of_two",
            catalogue: &[4],
            parameter: "scale factor of the scene, or its inverse",
            measure: "RMSE against the unscaled scene, relative to its mean",
            promise: "bit-identical",
            pass: 0.0,
            usable: 1e-3,
        }
    }

    fn parameters(&self) -> Vec<f64> {
        (0..=20).step_by(4).map(|power| f64::from(1 << power)).collect()
    }

    fn step(&self, parameter: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        step(parameter, lab)
    }
}

impl Family for PowerOfTen {
    fn about(&self) -> About {
        About {
            name: "scale_power_of_ten",
            catalogue: &[5],
            promise: "RMSE 1e-9",
            pass: 1e-9,
            ..PowerOfTwo.about()
        }
    }

    fn parameters(&self) -> Vec<f64> {
        crate::decades(0, 6)
    }

    fn step(&self, parameter: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        step(parameter, lab)
    }
}

/// A glass ball and a mirror on a floor, under a lamp.
fn scene(s: f64) -> String {
    let v = |x: f64, y: f64, z: f64| format!("[{:?}, {:?}, {:?}]", x * s, y * s, z * s);
    format!(
        "film = {{ width = {WIDTH}, height = {HEIGHT} }}\n\
         camera = {{ type = \"perspective\", look_at = {{ origin = {eye}, target = {target} }} }}\n\
         integrator = {{ type = \"whitted\", max_depth = 6 }}\n\
         [[light]]\ntype = \"point\"\nposition = {lamp}\nintensity = {intensity:?}\n\
         [[light]]\ntype = \"background\"\nradiance = 0.25\n\
         [[shape]]\ntype = \"sphere\"\ncenter = {ball}\nradius = {half:?}\nmaterial = {{ type = \"dielectric\" }}\n\
         [[shape]]\ntype = \"sphere\"\ncenter = {other}\nradius = {half:?}\nmaterial = {{ type = \"mirror\" }}\n\
         [[shape]]\ntype = \"box\"\ntransform = [{{ scale = {large:?} }}, {{ translate = {down} }}]\nmaterial = {{ type = \"matte\" }}\n",
        eye = v(0.0, 1.0, 4.0),
        target = v(0.0, 0.5, 0.0),
        lamp = v(2.0, 4.0, 2.0),
        intensity = 20.0 * s * s,
        ball = v(-0.75, 0.5, 0.0),
        other = v(0.75, 0.5, 0.0),
        half = 0.5 * s,
        large = 4.0 * s,
        down = v(0.0, -4.0, 0.0),
    )
}

fn step(parameter: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
    let plain = ours(lab, 1.0)?;
    let mut whitstone = Sample::default();
    let [mut double, mut single] = [Sample::default(); 2];
    let (f64_plain, f32_plain) = (lit::<f64>(1.0)?, lit::<f32>(1.0)?);
    let mut mitsuba: Answer = Ok(Sample::default());
    for scale in [parameter, 1.0 / parameter] {
        whitstone.add(rmse(&ours(lab, scale)?, &plain));
        double.add(rmse(&lit::<f64>(scale)?, &f64_plain));
        single.add(rmse(&lit::<f32>(scale)?, &f32_plain));
        mitsuba = mitsuba.and_then(|mut sample| {
            sample.add(rmse(&theirs(lab, scale)?, &theirs(lab, 1.0)?));
            Ok(sample)
        });
    }
    Ok(vec![
        (Engine::Whitstone, Ok(whitstone)),
        (Engine::Mitsuba, mitsuba),
        (Engine::NaiveF64, Ok(double)),
        (Engine::NaiveF32, Ok(single)),
    ])
}

fn pixels() -> impl Iterator<Item = [u32; 2]> {
    (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| [x, y]))
}

fn ours(lab: &Lab<'_>, scale: f64) -> Result<Vec<f64>, String> {
    let pipeline = lab.pipeline(&scene(scale))?;
    let mut scratch = Scratch::default();
    Ok(pixels()
        .map(|pixel| pipeline.pixel(pixel, &mut scratch).r)
        .collect())
}

/// By the Mitsuba driver: Mitsuba intersects rays and shapes; ray origins follow the model.
fn theirs(lab: &Lab<'_>, scale: f64) -> Result<Vec<f64>, String> {
    let all: Vec<[u32; 2]> = pixels().collect();
    lab.mitsuba_pixels(&scene(scale), &all)
}

/// The pixels that see a lit point, by textbook formulas with a constant shadow ray offset.
fn lit<R: Real>(scale: f64) -> Result<Vec<f64>, String> {
    let text = scene(scale);
    let shapes: Vec<Box<dyn Textbook<R>>> = (0..SHAPES)
        .map(|number| textbook_of(&text, number))
        .collect::<Result<_, _>>()?;
    let intersect = |ray: &Ray| {
        let [o, d] = [ray.origin, ray.direction].map(|v| v.to_array().map(R::of));
        let hits = shapes.iter().filter_map(|shape| shape.intersect(o, d));
        hits.reduce(|a, b| if b < a { b } else { a }).map(R::to_f64)
    };
    let lamp = scale * DVec3::new(2.0, 4.0, 2.0);
    Ok(pixels()
        .map(|[x, y]| {
            let [across, down] =
                [(x, WIDTH), (y, HEIGHT)].map(|(k, of)| f64::from(k) + 0.5 - 0.5 * f64::from(of));
            let direction = DVec3::new(across, -down, -1.2 * f64::from(WIDTH)).normalize();
            let ray = Ray::new(scale * DVec3::new(0.0, 1.0, 4.0), direction);
            let Some(t) = intersect(&ray) else { return 0.0 };
            let place = ray.at(t);
            let to = (lamp - place).normalize();
            f64::from(u8::from(intersect(&Ray::new(place + 1e-4 * to, to)).is_none()))
        })
        .collect())
}

/// Root mean square error relative to the mean of `expected`.
fn rmse(found: &[f64], expected: &[f64]) -> f64 {
    let count = expected.len() as f64;
    let mean = expected.iter().sum::<f64>() / count;
    let squares: f64 = found.iter().zip(expected).map(|(a, b)| (a - b) * (a - b)).sum();
    (squares / count).sqrt() / mean
}
