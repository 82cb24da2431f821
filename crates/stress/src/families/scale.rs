//! The same scene in other units and at other positions.

use crate::families::gaps::offset;
use crate::lab::{radiance, textbook_of};
use crate::{About, Answer, Engine, Family, Lab, Limit, Sample, view};
use whitstone_core::{DVec3, Ray, Scratch};
use whitstone_oracle::naive::{DoubleDouble, Real, Textbook};

const WIDTH: u32 = 24;
const HEIGHT: u32 = 16;
/// Number of shapes in the scene.
const SHAPES: usize = 3;

/// Units that are a power of two of a metre: the result must not change, because rounding does not.
pub(crate) struct PowerOfTwo;

/// Units that are a power of ten of a metre, larger or smaller than one.
pub(crate) struct PowerOfTen {
    is_enlarged: bool,
}

pub(crate) static ENLARGED: PowerOfTen = PowerOfTen { is_enlarged: true };
pub(crate) static SHRUNK: PowerOfTen = PowerOfTen { is_enlarged: false };

impl Family for PowerOfTwo {
    fn about(&self) -> About {
        About {
            name: "scale_power_of_two",
            catalogue: &[4],
            parameter: "scale factor of the scene, or its inverse",
            measure: "share of well-conditioned pixels that differ from the unscaled scene by 1 % or more",
            promise: "bit-identical",
            pass: 0.0,
            usable: 0.0,
            reach: 2f64.powi(320),
            floor: 0.0,
            limit: Some(Limit::Format),
        }
    }

    fn parameters(&self) -> Vec<f64> {
        let near = (0..=20).step_by(4);
        near.chain((40..=520).step_by(40))
            .map(|power| 2f64.powi(power))
            .collect()
    }

    fn step(&self, parameter: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        step([parameter, 1.0 / parameter].as_slice(), lab)
    }

    fn view(&self, parameter: f64, _: &Lab<'_>) -> Result<String, String> {
        Ok(image(parameter))
    }

    fn is_continuous(&self) -> bool {
        false
    }
}

impl Family for PowerOfTen {
    fn about(&self) -> About {
        About {
            name: if self.is_enlarged {
                "enlarged_scene"
            } else {
                "shrunk_scene"
            },
            catalogue: &[5],
            parameter: match self.is_enlarged {
                true => "scale factor of the scene",
                false => "inverse of the scale factor of the scene",
            },
            promise: "1e-9 of the mean",
            pass: 1e-9,
            reach: 1e100,
            floor: 1e-12,
            ..PowerOfTwo.about()
        }
    }

    fn parameters(&self) -> Vec<f64> {
        let near = crate::decades(0, 6);
        let far = (1..=15).map(|k| format!("1e{}", 10 * k).parse().unwrap_or(f64::NAN));
        near.into_iter().chain(far).collect()
    }

    fn step(&self, parameter: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let scale = if self.is_enlarged {
            parameter
        } else {
            1.0 / parameter
        };
        step(&[scale], lab)
    }

    fn view(&self, parameter: f64, _: &Lab<'_>) -> Result<String, String> {
        Ok(image(if self.is_enlarged {
            parameter
        } else {
            1.0 / parameter
        }))
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

/// Matte balls on a floor and their shadows, for renderers that only give images.
fn image(s: f64) -> String {
    let place = |x: f64, y: f64, z: f64| s * DVec3::new(x, y, z);
    let shapes: String = [(-0.75, 0.5), (0.75, 0.5)]
        .map(|(x, y)| {
            format!(
                "[[shape]]\ntype = \"sphere\"\ncenter = {:?}\nradius = {:?}\n",
                place(x, y, 0.0).to_array(),
                0.5 * s
            )
        })
        .concat();
    let scene = format!(
        "[[light]]\ntype = \"point\"\nposition = {lamp:?}\nintensity = {:?}\n{shapes}\
         [[shape]]\ntype = \"rectangle\"\ntransform = [{{ scale = {:?} }}, {{ rotate = {{ axis = [1, 0, 0], degrees = -90 }} }}]\n",
        20.0 * s * s,
        4.0 * s,
        lamp = place(3.0, 3.0, 1.0).to_array(),
    );
    view::seen(&scene, place(0.0, 2.5, 3.5), place(0.0, 0.3, 0.0), 45.0)
}

fn step(scales: &[f64], lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
    let plain = ours(lab, 1.0)?;
    let clear = well_conditioned(lab)?;
    let mean = plain.iter().sum::<f64>() / plain.len() as f64;
    let judge = |sample: &mut Sample, clear: &[bool], found: &[f64], expected: &[f64]| {
        let pairs = found.iter().zip(expected).zip(clear).filter(|(_, clear)| **clear);
        let errors: Vec<f64> = pairs.map(|((a, b), _)| (a - b).abs() / mean).collect();
        let wrong = errors
            .iter()
            .filter(|error| error.is_nan() || **error >= 0.01)
            .count();
        sample.error = sample.error.max(wrong as f64 / errors.len() as f64);
        sample.strict = errors.iter().fold(sample.strict, |most, error| most.max(*error));
        sample.nonfinite += errors.iter().filter(|error| !error.is_finite()).count() as u64;
    };
    let mut whitstone = Sample::default();
    let [mut wide, mut double, mut single] = [Sample::default(); 3];
    let straight = DVec3::ZERO;
    let wide_plain = lit::<DoubleDouble>(1.0, straight)?;
    let f64_plain = lit::<f64>(1.0, straight)?;
    let f32_plain = lit::<f32>(1.0, straight)?;
    let mut is_same = vec![true; f64_plain.len()];
    for side in SIDES {
        for (is_same, (a, b)) in is_same
            .iter_mut()
            .zip(f64_plain.iter().zip(lit::<f64>(1.0, TURN * side)?))
        {
            *is_same &= *a == b;
        }
    }
    let mut mitsuba: Answer = Ok(Sample::default());
    for scale in scales.iter().copied() {
        judge(&mut whitstone, &clear, &ours(lab, scale)?, &plain);
        judge(
            &mut wide,
            &is_same,
            &lit::<DoubleDouble>(scale, straight)?,
            &wide_plain,
        );
        judge(&mut double, &is_same, &lit::<f64>(scale, straight)?, &f64_plain);
        judge(&mut single, &is_same, &lit::<f32>(scale, straight)?, &f32_plain);
        mitsuba = mitsuba.and_then(|mut sample| {
            judge(&mut sample, &clear, &theirs(lab, scale)?, &theirs(lab, 1.0)?);
            Ok(sample)
        });
    }
    Ok(vec![
        (Engine::Whitstone, Ok(whitstone)),
        (Engine::Mitsuba, mitsuba),
        (Engine::NaiveDoubleDouble, Ok(wide)),
        (Engine::NaiveF64, Ok(double)),
        (Engine::NaiveF32, Ok(single)),
    ])
}

fn pixels() -> impl Iterator<Item = [u32; 2]> {
    (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| [x, y]))
}

/// Directions in which rays are turned by [`TURN`] radians, far more than single precision does:
/// pixels that change are ill-conditioned.
const SIDES: [DVec3; 4] = [DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y];
const TURN: f64 = 1e-5;

/// The pixels whose value does not change by 1 % if their rays are turned.
fn well_conditioned(lab: &Lab<'_>) -> Result<Vec<bool>, String> {
    let pipeline = lab.pipeline(&scene(1.0))?;
    let is_clear = |pixel: [u32; 2]| {
        let ray = pipeline.camera_ray(pixel, 0);
        let value = radiance(&pipeline, &ray).r;
        SIDES
            .into_iter()
            .map(|side| Ray::new(ray.origin, (ray.direction + TURN * side).normalize()))
            .all(|ray| (radiance(&pipeline, &ray).r - value).abs() < 0.01 * value)
    };
    Ok(pixels().map(is_clear).collect())
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

/// The pixels that see a lit point, by textbook formulas; `turned` is added to the directions.
fn lit<R: Real>(scale: f64, turned: DVec3) -> Result<Vec<f64>, String> {
    let text = scene(scale);
    let shapes: Vec<Box<dyn Textbook<R>>> = (0..SHAPES)
        .map(|number| textbook_of(&text, number))
        .collect::<Result<_, _>>()?;
    let intersect = |o: [R; 3], d: [R; 3]| {
        let hits = shapes.iter().filter_map(|shape| shape.intersect(o, d));
        hits.reduce(|a, b| if b < a { b } else { a })
    };
    let place = |place: DVec3| (scale * place).to_array().map(R::of);
    let (eye, lamp) = (place(DVec3::new(0.0, 1.0, 4.0)), place(DVec3::new(2.0, 4.0, 2.0)));
    let axes = [0, 1, 2];
    Ok(pixels()
        .map(|[x, y]| {
            let [across, down] =
                [(x, WIDTH), (y, HEIGHT)].map(|(k, of)| f64::from(k) + 0.5 - 0.5 * f64::from(of));
            let direction = DVec3::new(across, -down, -1.2 * f64::from(WIDTH)).normalize();
            let direction = (direction + turned).to_array().map(R::of);
            let Some(t) = intersect(eye, direction) else {
                return 0.0;
            };
            let place = axes.map(|axis| eye[axis] + t * direction[axis]);
            let to = axes.map(|axis| lamp[axis] - place[axis]);
            let length = (to[0] * to[0] + to[1] * to[1] + to[2] * to[2]).sqrt();
            let to = to.map(|part| part / length);
            // An offset in proportion to the coordinates, as robust textbook code has it.
            let largest = axes.iter().fold(R::of(0.0), |most, &axis| {
                let size = place[axis].abs();
                if size > most { size } else { most }
            });
            let off = offset::<R>() * largest;
            let origin = axes.map(|axis| place[axis] + off * to[axis]);
            f64::from(u8::from(intersect(origin, to).is_none()))
        })
        .collect())
}
