//! Camera fields of view.

use crate::{About, Answer, Engine, Family, Lab, Limit, Sample};
use serde_json::json;
use whitstone_core::DVec3;
use whitstone_oracle::naive::{DoubleDouble, Real};

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
            promise: "4 ulp x condition (180 degrees over the difference)",
            pass: 4.0,
            usable: 1e-2,
            reach: 0.001,
            floor: 4.0,
            limit: None,
        }
    }

    fn parameters(&self) -> Vec<f64> {
        let near = (-14..=1)
            .rev()
            .map(|k| format!("1e{k}").parse().unwrap_or(f64::NAN));
        std::iter::once(90.0).chain(near).collect()
    }

    fn step(&self, parameter: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        // The difference of the angle as rounded to a double is exact.
        let fov = 180.0 - parameter;
        let difference = 180.0 - fov;
        if difference == 0.0 {
            return Err("the field of view rounds to 180 degrees".to_owned());
        }
        look(
            fov,
            1.0 / (0.5 * difference).to_radians().tan(),
            180.0 / difference,
            &Basis {
                right: DVec3::X,
                up: DVec3::Y,
                forward: DVec3::NEG_Z,
            },
            lab,
        )
    }
}

/// A field of view of almost 0 degrees.
pub(crate) struct Telephoto;

impl Family for Telephoto {
    fn about(&self) -> About {
        About {
            name: "telephoto",
            parameter: "field of view, in degrees",
            promise: "8 ulp x condition (1 over half of the angle)",
            pass: 8.0,
            reach: 1e-10,
            limit: Some(Limit::Condition),
            ..WideView.about()
        }
    }

    fn parameters(&self) -> Vec<f64> {
        crate::decades(1, -14)
    }

    fn step(&self, fov: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        // Along no axis: a direction is then rounded by its whole length.
        let half = (0.5 * fov).to_radians().tan();
        let basis = Basis {
            right: DVec3::new(-3.0, 6.0, -2.0),
            up: DVec3::new(6.0, 2.0, -3.0),
            forward: DVec3::new(2.0, 3.0, 6.0),
        };
        look(fov, half, 1.0 + 1.0 / half, &basis, lab)
    }
}

/// Orthogonal vectors of equal, integer length along the axes of a camera.
struct Basis {
    right: DVec3,
    up: DVec3,
    forward: DVec3,
}

/// Checks one field of view; `half` is the tangent of half of the angle. The position on the film
/// changes by `condition` times a rounding, in units of half of the image.
fn look(
    fov: f64,
    half: f64,
    condition: f64,
    basis: &Basis,
    lab: &Lab<'_>,
) -> Result<Vec<(Engine, Answer)>, String> {
    let scene = format!(
        "film = {{ width = {SIZE}, height = {SIZE} }}\n\
         camera = {{ type = \"perspective\", fov = {fov:?}, look_at = {{ origin = [0, 0, 0], target = {:?}, up = {:?} }} }}\n\
         [[shape]]\ntype = \"sphere\"\n",
        basis.forward.to_array(),
        basis.up.to_array()
    );
    let pipeline = lab.pipeline(&scene)?;
    let size = f64::from(SIZE);
    let pixels: Vec<[u32; 2]> = (0..SIZE).flat_map(|y| (0..SIZE).map(move |x| [x, y])).collect();
    let center = |pixel: [u32; 2]| pixel.map(|k| f64::from(k) + 0.5);
    // Error of the position on the film that a direction leads to, in pixels.
    let off = |pixel: [u32; 2], d: DVec3| {
        let [x, y] = center(pixel);
        let [right, up, forward] = [basis.right, basis.up, basis.forward].map(|axis| axis.dot(d));
        let at = [right / forward, -up / forward].map(|tangent| 0.5 * size * (1.0 + tangent / half));
        (at[0] - x).hypot(at[1] - y)
    };
    let judge = |direction: &dyn Fn(usize, [u32; 2]) -> DVec3| {
        let mut sample = Sample::default();
        for (number, pixel) in pixels.iter().enumerate() {
            sample.add(off(*pixel, direction(number, *pixel)));
        }
        sample.strict = sample.error / (f64::EPSILON * 0.5 * size * condition);
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
    let wide = judge(&|_, pixel| textbook::<DoubleDouble>(fov, center(pixel), basis));
    let double = judge(&|_, pixel| textbook::<f64>(fov, center(pixel), basis));
    let single = judge(&|_, pixel| textbook::<f32>(fov, center(pixel), basis));
    Ok(vec![
        (Engine::Whitstone, Ok(ours)),
        (Engine::Mitsuba, theirs),
        (Engine::NaiveDoubleDouble, Ok(wide)),
        (Engine::NaiveF64, Ok(double)),
        (Engine::NaiveF32, Ok(single)),
    ])
}

/// The image window by the textbook formula.
fn textbook<R: Real>(fov: f64, center: [f64; 2], basis: &Basis) -> DVec3 {
    let half = (R::of(fov) * R::PI / R::of(360.0)).tan();
    let [x, y] = center.map(|k| (R::of(2.0 * k) / R::of(f64::from(SIZE)) - R::of(1.0)) * half);
    let square = basis.forward.to_array().map(|k| R::of(k) * R::of(k));
    let scale = (square[0] + square[1] + square[2]).sqrt();
    let [right, up, forward] =
        [basis.right, basis.up, basis.forward].map(|axis| axis.to_array().map(|k| R::of(k) / scale));
    let d = [0, 1, 2].map(|k| forward[k] + x * right[k] - y * up[k]);
    let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
    DVec3::from_array(d.map(|k| (k / length).to_f64()))
}
