//! Generates docs/comparisons.md: methods of the lecture notes compared in numbers.

use crate::readme::{of_text, of_text_in};
use crate::run_time::wrapped;
use crate::synthesis;
use serde_json::Value;
use std::fmt::Write as _;
use whitstone::Failure;
use whitstone::commands::bake::SceneView;
use whitstone::core::{DVec3, Registry};
use whitstone::render::{Film, RenderOptions};

/// The page.
pub(crate) const PAGE: &str = "docs/comparisons.md";

/// The stored result of `bench rasterizer --sizes`.
pub(crate) const RESULT: &str = "studies/results/rasterizer.json";

/// Quads along a side of the landscapes that `bench rasterizer --sizes` renders, and its images.
pub(crate) const COLUMNS: [u32; 4] = [16, 64, 256, 1024];
pub(crate) const IMAGES: [[u32; 2]; 3] = [[64, 48], [640, 480], [1920, 1080]];

/// Width and height of the images of spheres.
const SIDE: u32 = 96;

/// The page; `times` is the stored result of `bench rasterizer --sizes`.
pub(crate) fn page(registry: &Registry, times: &Value) -> Result<String, Failure> {
    Ok(format!(
        "# Methods compared\n\n<!-- Written by `cargo xtask readme`. -->\n\n\
         The lecture notes compare methods in words. These are the numbers.\n{}{}{}{}{}",
        shading(registry)?,
        order(registry)?,
        order_times(times),
        cube_map(registry)?,
        synthesis::section(registry)?
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
         outlines do not count.\n",
    );
    text += &errors_of_spheres(registry, "none")?;
    text += "\nThe same with shadow rays, and with a ball between the light and the sphere: it throws a round\n\
        shadow. Gouraud shading traces the shadow rays from the vertices, so that the border of the shadow\n\
        is as wide as the triangles. Flat and Phong shading trace them from each point, and the border\n\
        is sharp, but flat triangles also shadow each other where the sphere turns from the light.\n";
    text += &errors_of_spheres(registry, "opaque")?;
    Ok(text)
}

/// A table of the errors of triangulated spheres.
fn errors_of_spheres(registry: &Registry, shadows: &str) -> Result<String, Failure> {
    let mut text = String::from(
        "\n| triangles | flat, RMS | Gouraud, RMS | Phong, RMS | flat, largest | Gouraud, largest | Phong, largest |\n\
         |---|---|---|---|---|---|---|\n",
    );
    // A ball half way to the light, outside of the view.
    let mut ball = String::new();
    if shadows != "none" {
        for corners in sphere(4) {
            triangle(
                &mut ball,
                corners.map(|p| 0.15 * p + DVec3::new(1.0, 1.5, 2.0)),
                None,
            );
        }
    }
    let head = |integrator: &str| {
        format!(
            "[film]\nwidth = {SIDE}\nheight = {SIDE}\n[camera]\ntype = \"perspective\"\nfov = 24\n\
             look_at = {{ origin = [0, 0, 5], target = [0, 0, 0] }}\n\
             [integrator]\nshadows = \"{shadows}\"\n{integrator}\n\
             [[light]]\ntype = \"point\"\nposition = [2, 3, 4]\nintensity = 40\n\
             [material.shiny]\ntype = \"phong\"\nk_d = 0.5\nk_s = 0.5\nexponent = 32\n{ball}"
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
                triangle(&mut scene, *corners, smooth.then_some(*corners));
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

/// Adds a triangle to a scene.
fn triangle(scene: &mut String, corners: [DVec3; 3], normals: Option<[DVec3; 3]>) {
    let list = |points: [DVec3; 3]| points.map(|p| format!("[{}, {}, {}]", p.x, p.y, p.z)).join(", ");
    let _ = write!(
        scene,
        "[[shape]]\ntype = \"triangle\"\nmaterial = \"shiny\"\nvertices = [{}]\n",
        list(corners)
    );
    if let Some(normals) = normals {
        let _ = writeln!(scene, "normals = [{}]", list(normals));
    }
}

/// A landscape of `2 columns²` triangles under a point light.
pub(crate) fn landscape(columns: u32, [width, height]: [u32; 2], integrator: &str, shadows: &str) -> String {
    format!(
        "[film]\nwidth = {width}\nheight = {height}\n[camera]\ntype = \"perspective\"\n\
         look_at = {{ origin = [0.3, 0.9, 1.9], target = [0, 0, 0] }}\n\
         [integrator]\ntype = \"{integrator}\"\nshadows = \"{shadows}\"\n\
         [[light]]\ntype = \"point\"\nposition = [2, 2, 1]\nintensity = 20\n\
         [[shape]]\ntype = \"heightfield\"\ncolumns = {columns}\nrows = {columns}\n\
         transform = {{ rotate = {{ axis = [1, 0, 0], degrees = -90 }} }}\n"
    )
}

/// Number of pixels that differ in any bit.
pub(crate) fn differing(a: &[[f32; 3]], b: &[[f32; 3]]) -> usize {
    let bits = |rgb: &[f32; 3]| rgb.map(f32::to_bits);
    a.iter().zip(b).filter(|(a, b)| bits(a) != bits(b)).count()
}

/// Rasterization and ray casting: the same images, and the rays of both.
fn order(registry: &Registry) -> Result<String, Failure> {
    let mut text = String::from(
        "\n## Object order and image order\n\n\
         The integrator `rasterizer` projects each triangle to the image and keeps the nearest one per\n\
         pixel in a depth buffer. `appel` traces a ray for each pixel. Both shade the same way, and\n\
         `rasterizer` solves for the exact hit in the end, so their images agree to the bit. The scene is\n\
         a heightfield under a point light, with shadow rays.\n\n\
         | triangles | image | pixels that differ | camera rays, `appel` | `rasterizer` | shadow rays of both |\n\
         |---|---|---|---|---|---|\n",
    );
    for columns in [16, 64, 256] {
        for [width, height] in [[64, 48], [640, 480]] {
            let scene = |integrator: &str| landscape(columns, [width, height], integrator, "opaque");
            let drawn = render(registry, &scene("rasterizer"))?;
            let cast = render(registry, &scene("appel"))?;
            let _ = writeln!(
                text,
                "| {} | {width} x {height} | {} | {} | {} | {} |",
                2 * columns * columns,
                differing(&drawn.rgb, &cast.rgb),
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

/// The stored times of both, over the size of the image and the number of triangles.
fn order_times(result: &Value) -> String {
    let number = |row: &Value, key: &str| row[key].as_f64().unwrap_or(f64::NAN);
    let rows = result["rows"].as_array().map_or(&[][..], Vec::as_slice);
    let differing: f64 = rows.iter().map(|row| number(row, "differing")).sum();
    let mut text = format!(
        "\n{}\n\n\
         | triangles | image | rasterized, ms | ray cast, ms | rasterizing takes | build, rasterized, ms | build, ray cast, ms |\n\
         |---|---|---|---|---|---|---|\n",
        wrapped(&format!(
            "The time of visibility and local shading, without shadow rays: processor time on one thread, medians of {} renderings ({}, {}, load average {:.1} before). `cargo xtask bench rasterizer --sizes --json {RESULT}` measures them. All images were compared: {differing} pixels differ. To build is to project the triangles and to sort them into tiles, or to build a `bvh`; the rasterizer also builds that, for shadow rays, and must project again for each new view.",
            result["rounds"],
            result["processor"].as_str().unwrap_or("unknown processor"),
            result["date"].as_str().unwrap_or_default(),
            number(result, "load"),
        ))
    );
    for row in rows {
        let milliseconds = |key: &str| 1e3 * number(row, key);
        let _ = writeln!(
            text,
            "| {} | {} x {} | {:.2} | {:.2} | {:.1} times as long | {:.1} | {:.1} |",
            row["triangles"],
            row["width"],
            row["height"],
            milliseconds("rasterized_s"),
            milliseconds("cast_s"),
            number(row, "rasterized_s") / number(row, "cast_s"),
            milliseconds("rasterized_build_s"),
            milliseconds("cast_build_s"),
        );
    }
    text
}

/// Reflections looked up in a cube map of the scene, against traced ones.
fn cube_map(registry: &Registry) -> Result<String, Failure> {
    let mut text = String::from(
        "\n## Reflections from a cube map\n\n\
         `whitstone bake cubemap SCENE --at X Y Z` renders the six faces of a cube map of the scene, and\n\
         the light `environment` shows them. A mirror ball in the middle of the map reflects them without\n\
         tracing the scene. This is right for a point: the lookup knows the direction of a reflected ray,\n\
         but not where it starts. The ball is in a room of 4 m x 3 m x 3.6 m with walls of noise. Errors\n\
         are differences from the traced reflections, relative to their mean, over the ball without its\n\
         outermost twentieth.\n\n\
         | radius of the ball | texels of a face | error, median | RMS | largest |\n\
         |---|---|---|---|---|\n",
    );
    let folder = tempfile::tempdir().map_err(Failure::environment)?;
    let folder = folder.path();
    let at = DVec3::new(0.4, 0.3, -0.2);
    let eye = DVec3::new(0.4, 0.6, 1.2);
    let room = "[[light]]\ntype = \"point\"\nposition = [-1, 1.1, 0.7]\nintensity = 1\nfalloff = \"none\"\n\
        [[shape]]\ntype = \"box\"\ntransform = { scale = [2, 1.5, 1.8] }\n\
        material = { type = \"matte\", reflectance = { type = \"noise\", mapping = { projection = \"solid\" } } }\n";
    for (radius, sizes) in [
        (0.01, &[16, 64, 256][..]),
        (0.1, &[256]),
        (0.3, &[256]),
        (0.6, &[256]),
    ] {
        // The outline of the ball fills the image.
        let outline = (radius / eye.distance(at)).asin();
        let head = format!(
            "[film]\nwidth = {SIDE}\nheight = {SIDE}\n[camera]\ntype = \"perspective\"\nfov = {}\n\
             look_at = {{ origin = [{}, {}, {}], target = [{}, {}, {}] }}\n\
             [[shape]]\ntype = \"sphere\"\ncenter = [{}, {}, {}]\nradius = {radius}\nmaterial = {{ type = \"mirror\" }}\n",
            2.0 * outline.to_degrees(),
            eye.x,
            eye.y,
            eye.z,
            at.x,
            at.y,
            at.z,
            at.x,
            at.y,
            at.z
        );
        let traced = render(registry, &format!("{head}{room}"))?;
        let scene = folder.join("scene.toml");
        std::fs::write(&scene, format!("{head}{room}")).map_err(Failure::environment)?;
        for &size in sizes {
            let view = SceneView {
                at,
                near: 1.01 * radius,
                size,
                samples: 4,
            };
            view.bake(&scene, folder, registry)?;
            let lookup = format!("include = [\"faces.toml\"]\n{head}");
            let looked_up = of_text_in(registry, &lookup, folder)?.render(RenderOptions::default());
            let inner = (0..SIDE * SIDE).filter(|pixel| {
                let place = [pixel % SIDE, pixel / SIDE];
                let [x, y] = place.map(|k| 2.0 * (f64::from(k) + 0.5) / f64::from(SIDE) - 1.0);
                x.hypot(y) < 0.95
            });
            let inner: Vec<usize> = inner.map(|pixel| pixel as usize).collect();
            let green = |film: &Film, pixel: &usize| f64::from(film.rgb[*pixel][1]);
            let count = inner.len() as f64;
            let mean = inner.iter().map(|pixel| green(&traced, pixel)).sum::<f64>() / count;
            let error = |pixel| (green(&looked_up, pixel) - green(&traced, pixel)).abs() / mean;
            let mut errors: Vec<f64> = inner.iter().map(error).collect();
            errors.sort_by(f64::total_cmp);
            let _ = writeln!(
                text,
                "| {radius} m | {size} x {size} | {:.1} % | {:.1} % | {:.1} % |",
                100.0 * errors[errors.len() / 2],
                100.0 * (errors.iter().map(|error| error * error).sum::<f64>() / count).sqrt(),
                100.0 * errors[errors.len() - 1]
            );
        }
    }
    Ok(text)
}
