//! Sums of light of very different intensity.

use crate::lab::radiance;
use crate::{About, Answer, Engine, Family, Lab, Limit, Sample, decades};
use std::f64::consts::PI;
use whitstone_core::{DVec3, Ray, Scratch};
use whitstone_oracle::naive::{DoubleDouble, Real};
use whitstone_testkit::Random;

/// Number of faint lamps.
const FAINT: u32 = 1000;
/// Samples of the pixel along each axis.
const SAMPLES: u32 = 32;

/// One bright lamp among a thousand faint ones, and one pixel of which half is bright: the faint
/// light must not get lost in the sum.
pub(crate) struct IntensityRange;

impl IntensityRange {
    /// The intensities in the order of the file: numbers whose sum is exact.
    fn lamps(bright: f64, is_first: bool) -> Vec<f64> {
        let mut random = Random::new(22);
        // 41 bits each: the sum is exact.
        let faint = (0..FAINT).map(|_| 1.0 + (random.unit() * 2f64.powi(40)).floor() / 2f64.powi(40));
        let mut all: Vec<f64> = faint.collect();
        all.insert(if is_first { 0 } else { all.len() }, bright);
        all
    }

    /// A white floor; all lamps are a metre above the origin.
    fn lit(lamps: &[f64]) -> String {
        let lamps: String = lamps
            .iter()
            .map(|intensity| {
                format!("[[light]]\ntype = \"point\"\nposition = [0, 0, 1]\nintensity = {intensity:?}\n")
            })
            .collect();
        format!(
            "{lamps}[[shape]]\ntype = \"rectangle\"\nmaterial = {{ type = \"matte\", reflectance = 1 }}\n"
        )
    }

    /// A pixel over four by four squares of an emissive checkerboard.
    fn sampled(bright: f64) -> String {
        format!(
            "film = {{ width = 1, height = 1 }}\nsampler = {{ type = \"grid\", samples_per_axis = {SAMPLES} }}\n\
             [camera]\ntype = \"orthographic\"\nwidth = 2\nlook_at = {{ origin = [0, 0, 1], target = [0, 0, 0] }}\n\
             [[shape]]\ntype = \"rectangle\"\n\
             material = {{ type = \"emissive\", radiance = {{ type = \"checker\", scale = 4, a = 1, b = {bright:?} }} }}\n"
        )
    }
}

impl Family for IntensityRange {
    fn about(&self) -> About {
        About {
            name: "intensity_range",
            catalogue: &[],
            parameter: "intensity of one lamp over that of each of a thousand others, and of half of a pixel over the other half",
            measure: "error of the sum, over the light of the faint lamps or of the faint half",
            promise: "500 ulp x condition (the sum over the faint part): half an ulp for each of 1000 additions",
            pass: 500.0,
            usable: 1e-2,
            reach: 1e12,
            floor: 4.0,
            limit: Some(Limit::Format),
        }
    }

    fn parameters(&self) -> Vec<f64> {
        decades(0, 18)
    }

    fn step(&self, bright: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let [mut ours, mut double_double, mut double, mut single] = [Sample::default(); 4];
        // `found` is the sum of the faint part and of the bright one.
        let add = |sample: &mut Sample, found: f64, bright: f64, faint: f64| {
            let error = ((found - bright) - faint).abs() / faint;
            let condition = (bright + faint) / faint;
            sample.join(&Sample {
                error,
                strict: error / (f64::EPSILON * condition),
                ..Sample::default()
            });
        };
        let faint: f64 = Self::lamps(0.0, true).iter().sum();
        for is_first in [true, false] {
            let lamps = Self::lamps(bright, is_first);
            let pipeline = lab.pipeline(&Self::lit(&lamps))?;
            let found = radiance(
                &pipeline,
                &Ray::new(DVec3::new(1.0, 0.0, 1.0), DVec3::new(-1.0, 0.0, -1.0)),
            );
            add(&mut ours, found.r * PI, bright, faint);
            add(
                &mut double_double,
                summed::<DoubleDouble>(lamps.iter().copied()),
                bright,
                faint,
            );
            add(&mut double, summed::<f64>(lamps.iter().copied()), bright, faint);
            add(&mut single, summed::<f32>(lamps.iter().copied()), bright, faint);
        }
        let pipeline = lab.pipeline(&Self::sampled(bright))?;
        let found = pipeline.pixel([0, 0], &mut Scratch::default());
        let count = SAMPLES * SAMPLES;
        let half = f64::from(count / 2);
        add(&mut ours, found.r * f64::from(count), half * bright, half);
        let square = SAMPLES / 4;
        let samples = (0..count).map(|k| {
            let (row, column) = (k / SAMPLES, k % SAMPLES);
            let is_bright = (row / square + column / square) % 2 == 1;
            if is_bright { bright } else { 1.0 }
        });
        let wide = summed::<DoubleDouble>(samples.clone());
        add(&mut double_double, wide, half * bright, half);
        add(&mut double, summed::<f64>(samples.clone()), half * bright, half);
        add(&mut single, summed::<f32>(samples), half * bright, half);
        Ok(vec![
            (Engine::Whitstone, Ok(ours)),
            (
                Engine::Mitsuba,
                Err("the driver adds lights and samples, not Mitsuba".to_owned()),
            ),
            (Engine::NaiveDoubleDouble, Ok(double_double)),
            (Engine::NaiveF64, Ok(double)),
            (Engine::NaiveF32, Ok(single)),
        ])
    }
}

/// The plain sum, from the first to the last.
fn summed<R: Real>(numbers: impl Iterator<Item = f64>) -> f64 {
    numbers
        .fold(R::of(0.0), |sum, number| sum + R::of(number))
        .to_f64()
}
