//! A checkered plane up to the horizon.

use crate::{About, Answer, Engine, Family, Lab, Sample, decades};
use std::f64::consts::PI;
use whitstone_core::Scratch;
use whitstone_oracle::naive::{DoubleDouble, Real};

/// Number of pixels, in a single row.
const WIDTH: u32 = 16;
/// Height of the camera above the plane: about nine and a half squares, so that no ray ends at a
/// border of squares, where every filter shows the mean.
const HEIGHT: f64 = 3.0 * PI;
/// Tangent of half of the field of view: a pixel is a thousandth of a radian wide.
const HALF: f64 = 8e-3;
/// The brighter of the two colours of the image; a square is 16 texels wide.
const BRIGHT: f64 = 240.0 / 255.0;
const DARK: f64 = 30.0 / 255.0;

/// More and more squares per pixel at ever more grazing angles, until every pixel shows the mean.
pub(crate) struct Horizon;

impl Horizon {
    /// The camera looks along x and down to the plane by `slope`.
    fn scene(slope: f64, filter: &str) -> String {
        format!(
            "film = {{ width = {WIDTH}, height = 1 }}\n\
             [camera]\ntype = \"perspective\"\nwindow = {{ l = {l:?}, r = {HALF:?}, b = {b:?}, t = {t:?} }}\n\
             look_at = {{ origin = [0, 0, 0], target = [1, 0, {down:?}], up = [0, 0, 1] }}\n\
             [[shape]]\ntype = \"plane\"\ntransform = {{ translate = [0, 0, {under:?}] }}\n\
             [shape.material]\ntype = \"emissive\"\nradiance = {{ type = \"image\", file = \"assets/checker.png\", \
             color_space = \"linear\", scale = 0.125, filter = \"{filter}\" }}\n",
            l = -HALF,
            b = -HALF / f64::from(WIDTH),
            t = HALF / f64::from(WIDTH),
            down = -slope,
            under = -HEIGHT,
        )
    }
}

impl Family for Horizon {
    fn about(&self) -> About {
        About {
            name: "horizon",
            catalogue: &[23],
            parameter: "slope of the view direction towards a checkered plane, 9.4 squares below the camera",
            measure: "distance of a pixel from the mean of both colours, over their difference",
            promise: "1/255 with either filter, no NaN or infinity",
            pass: 1.0 / 255.0,
            usable: 0.05,
            reach: 1e-12,
            floor: 1.0 / 255.0,
            limit: None,
        }
    }

    fn parameters(&self) -> Vec<f64> {
        // The first step has pixels a third of a square wide and ten squares long.
        std::iter::once(3e-2).chain(decades(-2, -18)).collect()
    }

    fn step(&self, slope: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let pixels: Vec<[u32; 2]> = (0..WIDTH).map(|x| [x, 0]).collect();
        let add =
            |sample: &mut Sample, value: f64| sample.add(((value - DARK) / (BRIGHT - DARK) - 0.5).abs());
        let [mut ours, mut wide, mut double, mut single] = [Sample::default(); 4];
        for filter in ["trilinear", "ewa"] {
            let pipeline = lab.pipeline(&Self::scene(slope, filter))?;
            let mut scratch = Scratch::default();
            for pixel in &pixels {
                add(&mut ours, pipeline.pixel(*pixel, &mut scratch).r);
            }
        }
        for [x, _] in &pixels {
            let across = HALF * (2.0 * (f64::from(*x) + 0.5) / f64::from(WIDTH) - 1.0);
            add(&mut wide, point_sampled::<DoubleDouble>(slope, across));
            add(&mut double, point_sampled::<f64>(slope, across));
            add(&mut single, point_sampled::<f32>(slope, across));
        }
        // Its textures have no mipmaps: "bilinear" is the best of its filters.
        let theirs = lab.mitsuba_pixels(&Self::scene(slope, "bilinear"), &pixels);
        let theirs = theirs.map(|values| {
            let mut sample = Sample::default();
            values.into_iter().for_each(|value| add(&mut sample, value));
            sample
        });
        Ok(vec![
            (Engine::Whitstone, Ok(ours)),
            (Engine::Mitsuba, theirs),
            (Engine::NaiveDoubleDouble, Ok(wide)),
            (Engine::NaiveF64, Ok(double)),
            (Engine::NaiveF32, Ok(single)),
        ])
    }
}

/// The colour of the square at the centre of a pixel.
fn point_sampled<R: Real>(slope: f64, across: f64) -> f64 {
    let t = R::of(HEIGHT) / R::of(slope);
    let [x, y] = [t, t * R::of(across)].map(|place| place.to_f64().floor());
    if (x + y).rem_euclid(2.0) == 0.0 {
        BRIGHT
    } else {
        DARK
    }
}
