//! Camera fields of view.

use crate::{About, Answer, Engine, Family, Lab, Sample};
use serde_json::json;
use whitstone_core::DVec3;

/// Size of the image in pixels, in both directions.
const SIZE: u32 = 64;

/// A field of view of almost 180 degrees.
pub(crate) struct WideView;

impl Family for WideView {
    fn about(&self) -> About {
        About {
            name: "wide_view",
            catalogue: &[19],
            parameter: "180 degrees minus the field of view, in degrees",
            measure: "distance of the ray from its pixel, in pixels",
            promise: "1e-9 pixels",
            pass: 1e-9,
            usable: 1e-2,
        }
    }

    fn parameters(&self) -> Vec<f64> {
        vec![90.0, 10.0, 1.0, 0.1, 0.01, 0.001]
    }

    fn step(&self, parameter: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        look(180.0 - parameter, 1.0 / (0.5 * parameter).to_radians().tan(), lab)
    }
}

/// Checks one field of view; `half` is the tangent of half of the angle.
fn look(fov: f64, half: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
    let scene = format!(
        "film = {{ width = {SIZE}, height = {SIZE} }}\n\
         camera = {{ type = \"perspective\", fov = {fov:?}, look_at = {{ origin = [0, 0, 0], target = [0, 0, -1] }} }}\n\
         [[shape]]\ntype = \"sphere\"\n"
    );
    let pipeline = lab.pipeline(&scene)?;
    let size = f64::from(SIZE);
    let pixels: Vec<[u32; 2]> = (0..SIZE).flat_map(|y| (0..SIZE).map(move |x| [x, y])).collect();
    let center = |pixel: [u32; 2]| pixel.map(|k| f64::from(k) + 0.5);
    // Error of the position on the film that a direction leads to, in pixels.
    let off = |pixel: [u32; 2], d: DVec3| {
        let [x, y] = center(pixel);
        let at = [d.x / -d.z, -d.y / -d.z].map(|tangent| 0.5 * size * (1.0 + tangent / half));
        (at[0] - x).hypot(at[1] - y)
    };
    let judge = |direction: &dyn Fn(usize, [u32; 2]) -> DVec3| {
        let mut sample = Sample::default();
        for (number, pixel) in pixels.iter().enumerate() {
            sample.add(off(*pixel, direction(number, *pixel)));
        }
        sample
    };
    let ours = judge(&|_, pixel| pipeline.camera_ray(pixel, 0).direction);
    let positions: Vec<[f64; 2]> = pixels
        .iter()
        .map(|pixel| center(*pixel).map(|k| k / size))
        .collect();
    let theirs = lab.mitsuba(json!({ "op": "camera", "scene": scene, "positions": positions }));
    let theirs = theirs.map(|answer| {
        let number = |at: usize, axis: usize| answer["directions"][at][axis].as_f64().unwrap_or(f64::NAN);
        judge(&|at, _| DVec3::new(number(at, 0), number(at, 1), number(at, 2)))
    });
    // The image window by the textbook formula.
    let single = judge(&|_, pixel| {
        let half = (fov as f32 * std::f32::consts::PI / 360.0).tan();
        let [x, y] = center(pixel).map(|k| (2.0 * k as f32 / SIZE as f32 - 1.0) * half);
        let length = (x * x + y * y + 1.0).sqrt();
        DVec3::new(
            f64::from(x / length),
            f64::from(-y / length),
            f64::from(-1.0 / length),
        )
    });
    Ok(vec![
        (Engine::Whitstone, Ok(ours)),
        (Engine::Mitsuba, theirs),
        (Engine::NaiveF32, Ok(single)),
    ])
}
