//! Generates docs/comparisons.md: methods of the lecture notes compared in numbers.

use crate::readme::of_text;
use std::fmt::Write as _;
use whitstone::Failure;
use whitstone::core::{DVec3, Registry};
use whitstone::render::{Film, RenderOptions};

/// The page.
pub(crate) const PAGE: &str = "docs/comparisons.md";

/// Width and height of the images of spheres.
const SIDE: u32 = 96;

/// The page.
pub(crate) fn page(registry: &Registry) -> Result<String, Failure> {
    Ok(format!(
        "# Methods compared\n\n<!-- Written by `cargo xtask readme`. -->\n\n\
         The lecture notes compare methods in words. These are the numbers.\n{}{}",
        shading(registry)?,
        order(registry)?
    ))
}

fn render(registry: &Registry, text: &str) -> Result<Film, Failure> {
    Ok(of_text(registry, text)?.render(RenderOptions::default()))
}

/// The triangles of an octahedron whose edges were halved several times, on the unit sphere.
fn sphere(levels: u32) -> Vec<[DVec3; 3]> {
    let mut triangles = Vec::new();
    for x in [DVec3::X, DVec3::NEG_X] {
        for y in [DVec3::Y, DVec3::NEG_Y] {
            for z in [DVec3::Z, DVec3::NEG_Z] {
                triangles.push([x, y, z]);
            }
        }
    }
    for _ in 0..levels {
        let quarters = triangles.iter().flat_map(|&[a, b, c]| {
            let [ab, bc, ca] = [a + b, b + c, c + a].map(DVec3::normalize);
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        });
        triangles = quarters.collect();
    }
    // Counter-clockwise from outside.
    for [a, b, c] in &mut triangles {
        if (*b - *a).cross(*c - *a).dot(*a) < 0.0 {
            std::mem::swap(b, c);
        }
    }
    triangles
}

/// Flat, Gouraud and Phong shading of triangulated spheres, against a sphere.
fn shading(registry: &Registry) -> Result<String, Failure> {
    let mut text = String::from(
        "\n## Flat, Gouraud and Phong shading\n\n\
         A sphere of triangles with the material `phong` (k_d = 0.5, k_s = 0.5, exponent 32) under a\n\
         point light, without shadows, against the shape `sphere`. Errors are relative to the largest\n\
         radiance of the sphere, over its inner part, to nine tenths of its radius in the image, where\n\
         outlines do not count.\n\n\
         | triangles | flat, RMS | Gouraud, RMS | Phong, RMS | flat, largest | Gouraud, largest | Phong, largest |\n\
         |---|---|---|---|---|---|---|\n",
    );
    let head = |integrator: &str| {
        format!(
            "[film]\nwidth = {SIDE}\nheight = {SIDE}\n[camera]\ntype = \"perspective\"\nfov = 24\n\
             look_at = {{ origin = [0, 0, 5], target = [0, 0, 0] }}\n\
             [integrator]\nshadows = \"none\"\n{integrator}\n\
             [[light]]\ntype = \"point\"\nposition = [2, 3, 4]\nintensity = 40\n\
             [material.shiny]\ntype = \"phong\"\nk_d = 0.5\nk_s = 0.5\nexponent = 32\n"
        )
    };
    let exact = format!(
        "{}[[shape]]\ntype = \"sphere\"\nmaterial = \"shiny\"\n",
        head("type = \"appel\"")
    );
    let exact = render(registry, &exact)?;
    let peak = exact
        .rgb
        .iter()
        .fold(0.0_f64, |peak, rgb| peak.max(f64::from(rgb[1])));
    // The outline of the sphere is at the tangent of its apparent radius.
    let outline = (1.0_f64 / 5.0).asin().tan() / 12.0_f64.to_radians().tan();
    for levels in 1..=5 {
        let triangles = sphere(levels);
        let mut errors = Vec::new();
        for (integrator, smooth) in [
            ("type = \"appel\"", false),
            ("type = \"rasterizer\"\ninterpolation = \"gouraud\"", true),
            ("type = \"appel\"", true),
        ] {
            let mut scene = head(integrator);
            for corners in &triangles {
                let points = corners.map(|p| format!("[{}, {}, {}]", p.x, p.y, p.z)).join(", ");
                let _ = write!(
                    scene,
                    "[[shape]]\ntype = \"triangle\"\nmaterial = \"shiny\"\nvertices = [{points}]\n"
                );
                if smooth {
                    let _ = writeln!(scene, "normals = [{points}]");
                }
            }
            let film = render(registry, &scene)?;
            let (mut sum, mut count, mut worst) = (0.0, 0, 0.0_f64);
            for (pixel, (ours, exact)) in film.rgb.iter().zip(&exact.rgb).enumerate() {
                let place = [pixel as u32 % SIDE, pixel as u32 / SIDE];
                let place = place.map(|k| 2.0 * (f64::from(k) + 0.5) / f64::from(SIDE) - 1.0);
                if place[0].hypot(place[1]) > 0.9 * outline {
                    continue;
                }
                let error = (f64::from(ours[1]) - f64::from(exact[1])) / peak;
                sum += error * error;
                worst = worst.max(error.abs());
                count += 1;
            }
            errors.push([(sum / f64::from(count)).sqrt(), worst]);
        }
        let _ = write!(text, "| {} |", triangles.len());
        for kind in [0, 1] {
            for error in &errors {
                let _ = write!(text, " {:.1} % |", 100.0 * error[kind]);
            }
        }
        text.push('\n');
    }
    Ok(text)
}

/// Rasterization and ray casting: the same images, and the rays of both.
fn order(registry: &Registry) -> Result<String, Failure> {
    let mut text = String::from(
        "\n## Object order and image order\n\n\
         The integrator `rasterizer` projects each triangle to the image and keeps the nearest one per\n\
         pixel in a depth buffer. `appel` traces a ray for each pixel. Both shade the same way, and\n\
         `rasterizer` solves for the exact hit in the end, so their images agree to the bit. The scene is\n\
         a heightfield under a point light, with shadow rays. `cargo xtask bench rasterizer` measures\n\
         their times.\n\n\
         | triangles | image | pixels that differ | camera rays, `appel` | `rasterizer` | shadow rays of both |\n\
         |---|---|---|---|---|---|\n",
    );
    for columns in [16, 64, 256] {
        for [width, height] in [[64, 48], [640, 480]] {
            let scene = |integrator: &str| {
                format!(
                    "[film]\nwidth = {width}\nheight = {height}\n[camera]\ntype = \"perspective\"\n\
                     look_at = {{ origin = [0.3, 0.9, 1.9], target = [0, 0, 0] }}\n\
                     [integrator]\ntype = \"{integrator}\"\n\
                     [[light]]\ntype = \"point\"\nposition = [2, 2, 1]\nintensity = 20\n\
                     [[shape]]\ntype = \"heightfield\"\ncolumns = {columns}\nrows = {columns}\n\
                     transform = {{ rotate = {{ axis = [1, 0, 0], degrees = -90 }} }}\n"
                )
            };
            let drawn = render(registry, &scene("rasterizer"))?;
            let cast = render(registry, &scene("appel"))?;
            let bits = |rgb: &[f32; 3]| rgb.map(f32::to_bits);
            let differing = drawn
                .rgb
                .iter()
                .zip(&cast.rgb)
                .filter(|(a, b)| bits(a) != bits(b));
            let _ = writeln!(
                text,
                "| {} | {width} x {height} | {} | {} | {} | {} |",
                2 * columns * columns,
                differing.count(),
                cast.counters.closest,
                drawn.counters.closest,
                cast.counters.shadow
            );
            if drawn.counters.shadow != cast.counters.shadow {
                let message = "rasterizer and appel trace different shadow rays";
                return Err(Failure::environment(message));
            }
        }
    }
    Ok(text)
}
