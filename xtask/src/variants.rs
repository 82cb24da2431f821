//! Generates docs/variants.md: the errors of formulas of the lecture notes that differ from the
//! Whitted model, against the tracer.

use crate::readme::of_text;
use std::fmt::Write as _;
use whitstone::Failure;
use whitstone::core::{DVec3, Interval, Ray, Registry, SelfHitFilter};
use whitstone::image::{Limits, texels};
use whitstone::render::{Film, Pipeline, RenderOptions};
use whitstone_oracle::naive::notes;

/// The page.
pub(crate) const PAGE: &str = "docs/variants.md";

/// Width and height of the images.
const SIDE: u32 = 64;

/// The page.
pub(crate) fn page(registry: &Registry) -> Result<String, Failure> {
    let mut page = String::from(
        "# Variants of the lecture notes\n\n\
         <!-- Written by `cargo xtask readme`. -->\n\n\
         The lecture notes that Whitstone follows contain formulas that differ from the\n\
         [Whitted model](whitted-model.md). They are in the naive set of the oracle\n\
         (`crates/oracle/src/naive/notes.rs`), as named variants. The tables show their errors against\n\
         images of the tracer. The tracer agrees with the model to single precision in all of these\n\
         images; the model is checked by the references and the oracle.\n",
    );
    for section in [highlight, offset, bilinear, vectors] {
        page += &section(registry)?;
    }
    Ok(page)
}

fn rendered(registry: &Registry, text: &str) -> Result<(Pipeline, Film), Failure> {
    let pipeline = of_text(registry, text)?;
    let film = pipeline.render(RenderOptions::default());
    Ok((pipeline, film))
}

/// The raster coordinates of the middle of each pixel, in [-1, 1] with y up, row by row.
fn pixels() -> impl Iterator<Item = [f64; 2]> {
    let middle = |k: u32| 2.0 * (f64::from(k) + 0.5) / f64::from(SIDE) - 1.0;
    (0..SIDE).flat_map(move |j| (0..SIDE).map(move |i| [middle(i), -middle(j)]))
}

/// A camera that sees [-1, 1] x [-1, 1] along -z.
fn view() -> String {
    format!(
        "[film]\nwidth = {SIDE}\nheight = {SIDE}\n[camera]\ntype = \"orthographic\"\nwidth = 2\n\
         look_at = {{ origin = [0, 0, 5], target = [0, 0, 0] }}\n"
    )
}

/// `naive::notes::shade` on a sphere under a light from several directions.
fn highlight(registry: &Registry) -> Result<String, Failure> {
    let mut text = String::from(
        "\n## Highlight without k_s and max\n\n\
         `naive::notes::shade`: `c = c_r (c_a + c_l max(0, n·l)) + c_l (h·n)^p` (002). The model has\n\
         `k_s max(0, n·h)^p`, and no light where `n·l <= 0`. A sphere with reflectance 0.5 under a\n\
         light of 1, at an angle to the viewing direction, compared with `blinn_phong`. Errors are\n\
         differences of radiance. With k_s = 1 only the `max` is missing, with k_s = 0.2 the coefficient\n\
         is missing too.\n\n\
         | angle | exponent | largest error, k_s = 1 | negative pixels | largest error, k_s = 0.2 |\n\
         |---|---|---|---|---|\n",
    );
    for degrees in [30.0, 90.0, 120.0, 150.0_f64] {
        for exponent in [8, 9] {
            let l = DVec3::new(degrees.to_radians().sin(), 0.0, degrees.to_radians().cos());
            let (mut worst, mut negative) = ([0.0_f64; 2], 0);
            for (worst, k_s) in worst.iter_mut().zip([1.0, 0.2]) {
                let scene = format!(
                    "{}[integrator]\ntype = \"appel\"\nshadows = \"none\"\n[[light]]\ntype = \"directional\"\n\
                     direction = [{}, 0, {}]\nirradiance = 1\n[[light]]\ntype = \"ambient\"\nradiance = 0.1\n\
                     [[shape]]\ntype = \"sphere\"\nmaterial = {{ type = \"blinn_phong\", k_d = 0.5, \
                     k_s = {k_s}, exponent = {exponent} }}\n",
                    view(),
                    -l.x,
                    -l.z,
                );
                let (_, film) = rendered(registry, &scene)?;
                negative = 0;
                for ([x, y], ours) in pixels().zip(&film.rgb) {
                    let square = x * x + y * y;
                    if square < 1.0 {
                        let n = DVec3::new(x, y, (1.0 - square).sqrt());
                        let found = notes::shade(0.5, 0.1, 1.0, exponent, [n, l, DVec3::Z]);
                        *worst = worst.max((found - f64::from(ours[1])).abs());
                        negative += usize::from(found < 0.0);
                    }
                }
            }
            let _ = writeln!(
                text,
                "| {degrees}° | {exponent} | {} | {negative} | {} |",
                short(worst[0]),
                short(worst[1])
            );
        }
    }
    Ok(text)
}

/// `naive::notes::offset_along_direction` on a sphere, by angle and distance.
fn offset(registry: &Registry) -> Result<String, Failure> {
    let mut text = String::from(
        "\n## Offset along the direction of the ray\n\n\
         `naive::notes::offset_along_direction` (003) moves the start of a secondary ray by a fixed\n\
         distance along the ray. At a grazing angle it hardly leaves the surface; and it jumps over\n\
         surfaces that are closer than the distance. The table has the share of 4096 rays from a unit\n\
         sphere that hit their own sphere again, at 1 milliradian to the surface. Points are rounded to\n\
         single precision, or kept in double precision. The tracer's rays start on the surface, and the\n\
         self-intersection filter excludes the primitive that they leave.\n\n\
         | centre at | offset | again, points in f32 | again, points in f64 | again, tracer | thinnest gap that is seen |\n\
         |---|---|---|---|---|---|\n",
    );
    for far in [0.0, 100.0] {
        let scene = format!("{}[[shape]]\ntype = \"sphere\"\ncenter = [{far}, 0, 0]\n", view());
        let pipeline = of_text(registry, &scene)?;
        let rays = grazing(&pipeline, far);
        let again = |start: &dyn Fn(&Leaving) -> DVec3, filtered: bool| {
            let hits = rays.iter().filter(|leaving| {
                let ray = Ray::new(start(leaving), leaving.direction);
                let skip = if filtered {
                    leaving.skip
                } else {
                    SelfHitFilter::NOTHING
                };
                pipeline
                    .scene
                    .accelerator
                    .intersect(&ray, Interval::FORWARD, skip)
                    .is_some()
            });
            100.0 * hits.count() as f64 / rays.len() as f64
        };
        let ours = again(&|leaving| leaving.start, true);
        for distance in [1e-6, 1e-4, 1e-2] {
            let double = again(
                &|leaving| notes::offset_along_direction(leaving.point, leaving.direction, distance),
                false,
            );
            let single = again(
                &|leaving| {
                    let point = leaving.point.as_vec3().as_dvec3();
                    let moved = notes::offset_along_direction(point, leaving.direction, distance);
                    moved.as_vec3().as_dvec3()
                },
                false,
            );
            let _ = writeln!(
                text,
                "| {far} | {} | {single:.1} % | {double:.1} % | {ours:.1} % | {} |",
                short(distance),
                short(distance)
            );
        }
    }
    Ok(text)
}

/// A ray that leaves a sphere.
struct Leaving {
    point: DVec3,
    direction: DVec3,
    /// Where the tracer starts it.
    start: DVec3,
    skip: SelfHitFilter,
}

/// Rays at one milliradian to the surface of the only sphere, whose points the tracer found.
fn grazing(pipeline: &Pipeline, far: f64) -> Vec<Leaving> {
    let center = DVec3::new(far, 0.0, 0.0);
    let mut found = Vec::new();
    for number in 0..4096 {
        // Points of a Fibonacci spiral.
        let z = 1.0 - (f64::from(number) + 0.5) / 2048.0;
        let phi = 2.399_963_229_728_653 * f64::from(number);
        let ring = (1.0 - z * z).sqrt();
        let outward = DVec3::new(ring * phi.cos(), ring * phi.sin(), z);
        let ray = Ray::new(center + 3.0 * outward, -outward);
        let accelerator = &pipeline.scene.accelerator;
        let Some(hit) = accelerator.intersect(&ray, Interval::FORWARD, SelfHitFilter::NOTHING) else {
            continue;
        };
        let point = pipeline.scene.surface(&ray, &hit).seen_from(outward);
        let along = outward.any_orthonormal_vector();
        let direction = (along * 1e-3_f64.cos() + outward * 1e-3_f64.sin()).normalize();
        found.push(Leaving {
            point: point.position,
            direction,
            start: point.spawn_origin(direction),
            skip: SelfHitFilter::leaving(&hit),
        });
    }
    found
}

/// The image of the example of the texture `image`, on a square that fills the view.
const IMAGE: &str = "scenes/assets/corners.png";

/// `naive::notes::bilinear` of an image, against the texture `image`.
fn bilinear(registry: &Registry) -> Result<String, Failure> {
    let mut text = format!(
        "\n## Bilinear interpolation without the half-texel shift\n\n\
         `naive::notes::bilinear` (002) takes `floor(u n_x)` as the lower texel: texels lie at the corners\n\
         of their squares. In the model they lie in the middle, at `(i + 0.5)/n_x`. The texture is\n\
         `{IMAGE}`, on a square of {SIDE} x {SIDE} pixels. If the image is\n\
         moved by half a texel, the variant has the values of the model.\n\n\
         | variant | largest error | mean error |\n|---|---|---|\n"
    );
    let square = |filter: &str, side: [u32; 2]| {
        format!(
            "[film]\nwidth = {}\nheight = {}\n[camera]\ntype = \"orthographic\"\n\
             window = {{ l = -1, r = 1, b = -1, t = 1 }}\n\
             look_at = {{ origin = [0, 0, 5], target = [0, 0, 0] }}\n\
             [[shape]]\ntype = \"rectangle\"\nmaterial = {{ type = \"emissive\", \
             radiance = {{ type = \"image\", file = \"{IMAGE}\", filter = \"{filter}\" }} }}\n",
            side[0], side[1]
        )
    };
    let read = texels::read(IMAGE, Limits::TEXTURE).map_err(Failure::environment)?;
    let size = [read.width, read.height];
    // One pixel for each texel: the middle of each, whatever the filter.
    let (_, texels) = rendered(registry, &square("nearest", size.map(|side| side as u32)))?;
    let texel = |[i, j]: [usize; 2]| {
        // Rows from the bottom, as v.
        f64::from(texels.rgb[(size[1] - 1 - j) * size[0] + i][1])
    };
    let (_, film) = rendered(registry, &square("bilinear", [SIDE, SIDE]))?;
    for (name, shift) in [("as in the notes", 0.0), ("moved by half a texel", 0.5)] {
        let (mut worst, mut sum) = (0.0_f64, 0.0);
        for ([x, y], ours) in pixels().zip(&film.rgb) {
            let uv = [0, 1].map(|axis| ([x, y][axis] + 1.0) / 2.0 - shift / size[axis] as f64);
            let error = (notes::bilinear(texel, size, uv) - f64::from(ours[1])).abs();
            worst = worst.max(error);
            sum += error;
        }
        let mean = sum / f64::from(SIDE * SIDE);
        let _ = writeln!(text, "| {name} | {} | {} |", short(worst), short(mean));
    }
    Ok(text)
}

/// `naive::notes::interpolated` on a triangle, by the distance of light and viewer.
fn vectors(registry: &Registry) -> Result<String, Failure> {
    let mut text = String::from(
        "\n## Interpolated vectors to viewer and light\n\n\
         `naive::notes::interpolated` (000) interpolates b (to the viewer), n and s (to the light) over a\n\
         triangle and shades with them. The model interpolates n only; b and s follow from the point. A\n\
         triangle with sides of about 2, with k_d = 0.5, k_s = 0.5 and an exponent of 32, with the viewer\n\
         and a point light above its middle, compared with `phong`. Errors are relative to\n\
         the largest radiance.\n\n\
         | height of viewer and light | largest error | mean error |\n|---|---|---|\n",
    );
    let corners = [
        DVec3::new(-1.0, -0.8, 0.0),
        DVec3::new(1.0, -0.8, 0.0),
        DVec3::new(0.0, 0.9, 0.0),
    ];
    for height in [0.5, 1.0, 2.0, 4.0, 8.0, 16.0] {
        let (eye, lamp) = (DVec3::new(0.1, -0.2, height), DVec3::new(-0.1, 0.0, height));
        let scene = format!(
            "[film]\nwidth = {SIDE}\nheight = {SIDE}\n[camera]\ntype = \"perspective\"\n\
             look_at = {{ origin = [{0}, {1}, {2}], target = [{0}, {1}, 0] }}\n\
             window = {{ l = {3}, r = {4}, b = {5}, t = {6}, d = {2} }}\n\
             [integrator]\ntype = \"appel\"\nshadows = \"none\"\n\
             [[light]]\ntype = \"point\"\nposition = [{7}, {8}, {9}]\nintensity = 1\nfalloff = \"none\"\n\
             [[shape]]\ntype = \"triangle\"\nvertices = [[-1, -0.8, 0], [1, -0.8, 0], [0, 0.9, 0]]\n\
             material = {{ type = \"phong\", k_d = 0.5, k_s = 0.5, exponent = 32 }}\n",
            eye.x,
            eye.y,
            eye.z,
            -1.0 - eye.x,
            1.0 - eye.x,
            -1.0 - eye.y,
            1.0 - eye.y,
            lamp.x,
            lamp.y,
            lamp.z,
        );
        let (_, film) = rendered(registry, &scene)?;
        let vertices = corners.map(|corner| notes::Vertex {
            b: (eye - corner).normalize(),
            n: DVec3::Z,
            s: (lamp - corner).normalize(),
        });
        let (mut worst, mut sum, mut count, mut peak) = (0.0_f64, 0.0, 0, 0.0_f64);
        for ([x, y], ours) in pixels().zip(&film.rgb) {
            let Some(weights) = barycentric(corners, DVec3::new(x, y, 0.0)) else {
                continue;
            };
            let notes::Vertex { b, n, s } = notes::interpolated(vertices, weights);
            let r = 2.0 * n.dot(s) * n - s;
            let found = 0.5 * n.dot(s).max(0.0) + 0.5 * r.dot(b).max(0.0).powi(32);
            let error = (found - f64::from(ours[1])).abs();
            worst = worst.max(error);
            peak = peak.max(f64::from(ours[1]));
            sum += error;
            count += 1;
        }
        let (worst, mean) = (worst / peak, sum / f64::from(count) / peak);
        let _ = writeln!(
            text,
            "| {height} | {:.2} % | {:.2} % |",
            100.0 * worst,
            100.0 * mean
        );
    }
    Ok(text)
}

/// Barycentric coordinates of a point well inside of a triangle of the plane z = 0.
fn barycentric(corners: [DVec3; 3], point: DVec3) -> Option<[f64; 3]> {
    let [a, b, c] = corners;
    let area = |a: DVec3, b: DVec3, c: DVec3| (b - a).cross(c - a).z;
    let all = area(a, b, c);
    let weights = [area(point, b, c), area(a, point, c), area(a, b, point)].map(|part| part / all);
    weights.iter().all(|weight| *weight > 1e-6).then_some(weights)
}

/// A number with two digits.
fn short(value: f64) -> String {
    if value == 0.0 || (1e-2..1e3).contains(&value) {
        format!("{value:.2}")
    } else {
        format!("{value:.0e}")
    }
}
