//! Footprints of texture filters that are long and thin.

use crate::{About, Answer, Engine, Family, Lab, Sample, decades};
use whitstone_core::Scratch;
use whitstone_oracle::naive::{DoubleDouble, Real};
use whitstone_testkit::Random;

/// Texels of the image along each side, and of one of its squares.
const SIDE: f64 = 128.0;
const SQUARE: f64 = 16.0;
/// The pixel is this many texels long: so few that it fits into a square.
const LENGTH: f64 = 8.0;
/// The lowest and the highest `max_anisotropy`: the filter must not become wide where it is capped.
const CAPS: [u32; 2] = [8, 64];
/// The two colours of the image.
const BRIGHT: f64 = 240.0 / 255.0;
const DARK: f64 = 30.0 / 255.0;

/// A pixel that is a line on the texture: it lies within one square, and shows its colour.
pub(crate) struct FilterFootprint;

/// A pixel over the stretched image.
#[derive(Clone, Copy)]
struct Look {
    /// Its centre on the image, in texels from the left and from the bottom.
    center: [f64; 2],
    /// Angle by which the pixel is turned, in degrees.
    turn: f64,
    /// Angle by which the image is turned before it is stretched, in degrees.
    lean: f64,
}

impl Look {
    fn random(random: &mut Random) -> Self {
        // Far enough from the borders of a square for the whole footprint.
        let center = [0, 1].map(|_| {
            let square = random.below((SIDE / SQUARE) as usize) as f64 + 0.5;
            SQUARE * square + random.signed()
        });
        Self {
            center,
            turn: 360.0 * random.unit(),
            lean: 360.0 * random.unit(),
        }
    }

    fn scene(&self, anisotropy: f64, cap: u32) -> String {
        // The image covers a square of 128 m, which is turned, and then stretched along x.
        let size = 0.5 * SIDE;
        let (sine, cosine) = self.lean.to_radians().sin_cos();
        let [u, v] = self.center.map(|place| place - size);
        let (x, y) = (anisotropy * (cosine * u - sine * v), sine * u + cosine * v);
        let (up_x, up_y) = self.turn.to_radians().sin_cos();
        let half = 0.5 * LENGTH;
        format!(
            "film = {{ width = 1, height = 1 }}\n\
             [camera]\ntype = \"orthographic\"\nwindow = {{ l = -{half:?}, r = {half:?}, b = -{half:?}, t = {half:?} }}\n\
             look_at = {{ origin = [{x:?}, {y:?}, 1], target = [{x:?}, {y:?}, 0], up = [{up_x:?}, {up_y:?}, 0] }}\n\
             [[shape]]\ntype = \"rectangle\"\n\
             transform = [{{ scale = {size:?} }}, {{ rotate = {{ axis = [0, 0, 1], degrees = {lean:?} }} }}, {{ scale = [{anisotropy:?}, 1, 1] }}]\n\
             [shape.material]\ntype = \"emissive\"\nradiance = {{ type = \"image\", file = \"assets/checker.png\", \
             color_space = \"linear\", filter = \"ewa\", max_anisotropy = {cap} }}\n",
            lean = self.lean
        )
    }

    /// The colour of the square: the top left one is bright, and their number is even.
    fn truth(&self) -> f64 {
        let [i, j] = self.center.map(|place| (place / SQUARE).floor());
        if (i + j).rem_euclid(2.0) == 1.0 {
            BRIGHT
        } else {
            DARK
        }
    }

    /// The two derivatives of the place on the image, in texels per pixel.
    fn derivatives<R: Real>(&self, anisotropy: f64) -> [[R; 2]; 2] {
        let (sine, cosine) = self.turn.to_radians().sin_cos();
        let lean = self.lean.to_radians();
        let (lean_sine, lean_cosine) = (R::of(lean.sin()), R::of(lean.cos()));
        [[cosine, -sine], [sine, cosine]].map(|side| {
            let [x, y] = [LENGTH * side[0] / anisotropy, LENGTH * side[1]].map(R::of);
            [lean_cosine * x + lean_sine * y, lean_cosine * y - lean_sine * x]
        })
    }
}

impl Family for FilterFootprint {
    fn about(&self) -> About {
        About {
            name: "filter_footprint",
            catalogue: &[23],
            parameter: "length of a pixel's footprint on a texture over its width",
            measure: "distance of the pixel from the colour of the square that it lies in, over the difference of both colours",
            promise: "1e-6 with the lowest and the highest cap of the anisotropy: texels are in single precision",
            pass: 1e-6,
            usable: 0.05,
            reach: 1e12,
            floor: 1e-6,
            limit: None,
        }
    }

    fn parameters(&self) -> Vec<f64> {
        decades(1, 15)
    }

    fn step(&self, anisotropy: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let mut random = Random::new(anisotropy.to_bits());
        let [mut ours, mut wide, mut double, mut single] = [Sample::default(); 4];
        let mut scratch = Scratch::default();
        for _ in 0..lab.rays.min(100) {
            let look = Look::random(&mut random);
            let truth = look.truth();
            let add = |sample: &mut Sample, value: f64| sample.add(((value - truth) / (BRIGHT - DARK)).abs());
            for cap in CAPS {
                let pipeline = lab.pipeline(&look.scene(anisotropy, cap))?;
                add(&mut ours, pipeline.pixel([0, 0], &mut scratch).r);
                add(&mut wide, textbook::<DoubleDouble>(&look, anisotropy, cap));
                add(&mut double, textbook::<f64>(&look, anisotropy, cap));
                add(&mut single, textbook::<f32>(&look, anisotropy, cap));
            }
        }
        Ok(vec![
            (Engine::Whitstone, Ok(ours)),
            (
                Engine::Mitsuba,
                Err("no twin: Mitsuba has no texture filter with footprints".to_owned()),
            ),
            (Engine::NaiveDoubleDouble, Ok(wide)),
            (Engine::NaiveF64, Ok(double)),
            (Engine::NaiveF32, Ok(single)),
        ])
    }
}

/// The textbook filter: the axes of the ellipse by the eigenvalues of its quadratic form (Heckbert,
/// *Fundamentals of Texture Mapping and Image Warping*, 1989), and a mean of probes along the
/// longer one (McCormack et al., *Feline*, 1999). The difference that gives the shorter axis
/// cancels.
fn textbook<R: Real>(look: &Look, anisotropy: f64, cap: u32) -> f64 {
    let [[su, sv], [tu, tv]] = look.derivatives::<R>(anisotropy);
    let half = R::of(0.5);
    let (a, b, c) = (su * su + tu * tu, su * sv + tu * tv, sv * sv + tv * tv);
    let root = ((a - c) * (a - c) + R::of(4.0) * b * b).sqrt();
    let major = (half * (a + c + root)).sqrt();
    let mut minor = (half * (a + c - root)).sqrt();
    let least = major / R::of(f64::from(cap));
    if minor < least {
        minor = least;
    }
    // The eigenvector of the larger eigenvalue.
    let square = major * major;
    let (x, y) = if a > c { (square - c, b) } else { (b, square - a) };
    let length = (x * x + y * y).sqrt();
    let axis = [x, y].map(|part| (half * major * part / length).to_f64());
    let count = (major / minor).to_f64().ceil() as u32;
    let mut sum = 0.0;
    for k in 0..count {
        let along = (2.0 * f64::from(k) + 1.0) / f64::from(count) - 1.0;
        let at = Look {
            center: [0, 1].map(|i| look.center[i] + along * axis[i]),
            ..*look
        };
        sum += at.truth();
    }
    sum / f64::from(count)
}
