//! Two sheets that almost coincide.

use crate::families::gaps::sheet;
use crate::lab::{Backends, radiance, single, textbook_of};
use crate::{About, Answer, Engine, Family, Lab, Sample, decades};
use whitstone_core::{DVec3, Ray};
use whitstone_oracle::naive::{DoubleDouble, Real, Textbook};
use whitstone_render::Pipeline;
use whitstone_testkit::Random;

/// Height of the lower sheet, in metres.
const LEVEL: f64 = 1.0;
/// The model's limit for coincident faces, in ulp of their largest coordinate.
const TOGETHER: f64 = 16.0;
/// Radiance of the lower and of the upper sheet.
const SHOWN: [f64; 2] = [1.0, 2.0];

/// Wider apart, the nearer sheet is seen; closer together, the model defines which one. The sheets
/// are in the file in either order, and are seen from both sides.
pub(crate) struct Coincident;

/// Two sheets of one colour each.
struct Sheets {
    upper: f64,
    /// Whether the upper one is the first in the file.
    is_upper_first: bool,
}

impl Sheets {
    /// Lists `shape(height, material)` of both sheets in the order of the file.
    fn scene(&self, shape: impl Fn(f64, &str) -> String) -> String {
        let sheets = [(LEVEL, SHOWN[0]), (self.upper, SHOWN[1])];
        let mut sheets = sheets.map(|(height, shown)| {
            shape(
                height,
                &format!("material = {{ type = \"emissive\", radiance = {shown:?} }}"),
            )
        });
        if self.is_upper_first {
            sheets.reverse();
        }
        sheets.concat()
    }

    fn rectangles(&self) -> String {
        self.scene(|height, material| {
            format!("[[shape]]\ntype = \"rectangle\"\ntransform = {{ translate = [0, 0, {height:?}] }}\n{material}\n")
        })
    }

    fn triangles(&self) -> String {
        self.scene(|height, material| sheet(height, true, material))
    }

    /// The radiance that is seen. `largest` is the largest coordinate of the sheets.
    fn truth(&self, from_above: bool, largest: f64) -> f64 {
        let gap = self.upper - LEVEL;
        // Both are open and face upwards: the first in the file is the upper one.
        let is_upper_above = gap > TOGETHER * f64::EPSILON * largest.max(self.upper) || self.is_upper_first;
        SHOWN[usize::from(is_upper_above == from_above)]
    }
}

impl Family for Coincident {
    fn about(&self) -> About {
        About {
            name: "coincident",
            catalogue: &[],
            parameter: "distance of two sheets, in metres, a metre from the origin",
            measure: "none: only the wrong sheet counts",
            promise: "the nearer sheet; up to 16 ulp apart, the one that the model defines",
            pass: 0.0,
            usable: 0.0,
            reach: 1e-18,
            floor: 0.0,
            limit: None,
        }
    }

    fn parameters(&self) -> Vec<f64> {
        decades(-1, -18)
    }

    fn step(&self, gap: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let mut random = Random::new(gap.to_bits());
        let rays: Vec<(Ray, bool)> = (0..lab.rays)
            .map(|_| {
                let from_above = random.below(2) == 0;
                // So far inside that a flat ray meets both sheets at the widest gap, too.
                let target = DVec3::new(0.4 * random.signed(), 0.4 * random.signed(), LEVEL);
                let mut towards = random.direction();
                towards.z = (0.2 + towards.z.abs()).copysign(if from_above { -1.0 } else { 1.0 });
                let origin = target - (2.0 + random.unit()) * towards;
                (single(origin, towards), from_above)
            })
            .collect();
        let counted = |failures: u64| Sample {
            failures,
            ..Sample::default()
        };
        let [mut ours, mut double_double, mut double, mut single_precision] = [0; 4];
        let mut backends = Backends::default();
        let mut theirs = Ok(0);
        for is_upper_first in [true, false] {
            let sheets = Sheets {
                upper: LEVEL + gap,
                is_upper_first,
            };
            let wrong = |largest: f64, seen: &dyn Fn(&Ray) -> f64| {
                let is_wrong =
                    |(ray, from_above): &&(Ray, bool)| seen(ray) != sheets.truth(*from_above, largest);
                rays.iter().filter(is_wrong).count() as u64
            };
            let scene = sheets.rectangles();
            let shown = |pipeline: &Pipeline, ray: &Ray| radiance(pipeline, ray).r;
            let pipeline = lab.pipeline(&scene)?;
            ours += wrong(LEVEL, &|ray| shown(&pipeline, ray));
            let of = |number| SHOWN[usize::from((number == 0) == is_upper_first)];
            let textbook = both::<DoubleDouble>(&scene)?;
            double_double += wrong(LEVEL, &|ray| of(nearer(&textbook, ray)));
            let textbook = both::<f64>(&scene)?;
            double += wrong(LEVEL, &|ray| of(nearer(&textbook, ray)));
            let textbook = both::<f32>(&scene)?;
            single_precision += wrong(LEVEL, &|ray| of(nearer(&textbook, ray)));
            // The triangles reach 6 m from the origin.
            backends.ask(lab, &sheets.triangles(), &|pipeline| {
                counted(wrong(6.0, &|ray| shown(pipeline, ray)))
            });
            for from_above in [true, false] {
                theirs =
                    theirs.and_then(|before| Ok(before + Self::mitsuba(lab, &sheets, &scene, from_above)?));
            }
        }
        let mut answers = vec![
            (Engine::Whitstone, Ok(counted(ours))),
            (Engine::Mitsuba, theirs.map(counted)),
            (Engine::NaiveDoubleDouble, Ok(counted(double_double))),
            (Engine::NaiveF64, Ok(counted(double))),
            (Engine::NaiveF32, Ok(counted(single_precision))),
        ];
        answers.extend(backends.into_answers());
        Ok(answers)
    }
}

impl Coincident {
    /// Wrong pixels of a small image from one side. The driver moves faces that coincide in the
    /// sense of the model; all others are Mitsuba's.
    fn mitsuba(lab: &Lab<'_>, sheets: &Sheets, scene: &str, from_above: bool) -> Result<u64, String> {
        let side = if from_above { 3.0 } else { -1.0 };
        let scene = format!(
            "film = {{ width = 6, height = 6 }}\n\
             camera = {{ type = \"perspective\", fov = 30, look_at = {{ origin = [0.3, 0.4, {side:?}], target = [0, 0, 1], up = [0, 1, 0] }} }}\n{scene}"
        );
        let pixels: Vec<[u32; 2]> = (0..36).map(|k| [k % 6, k / 6]).collect();
        let truth = sheets.truth(from_above, LEVEL);
        let found = lab.mitsuba_pixels(&scene, &pixels)?;
        Ok(found.iter().filter(|value| (*value - truth).abs() > 0.5).count() as u64)
    }
}

fn both<R: Real>(scene: &str) -> Result<[Box<dyn Textbook<R>>; 2], String> {
    Ok([textbook_of(scene, 0)?, textbook_of(scene, 1)?])
}

/// The index of the sheet with the smaller ray parameter; the first one, if they are equal.
fn nearer<R: Real>(sheets: &[Box<dyn Textbook<R>>; 2], ray: &Ray) -> usize {
    let (o, d) = (
        ray.origin.to_array().map(R::of),
        ray.direction.to_array().map(R::of),
    );
    match [0, 1].map(|number| sheets[number].intersect(o, d)) {
        [Some(first), Some(second)] if second < first => 1,
        [None, Some(_)] => 1,
        _ => 0,
    }
}
