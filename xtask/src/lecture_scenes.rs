//! Generates `docs/lecture-scenes.md`: the scenes whose run times the lecture notes report, and
//! ours, from the stored results of `bench scale`, `bench lights` and `bench --fps`.
//!
//! The picture of the first scene takes gigabytes to render, so `readme` never renders it. The
//! result has the hash of the scene that the picture shows, and the hash of the picture.

use crate::bench::scale::SCENE;
use crate::pictures;
use crate::run_time::wrapped;
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use whitstone::Failure;
use whitstone::core::Registry;

/// The page.
pub(crate) const PAGE: &str = "docs/lecture-scenes.md";
/// Result of `bench scale`.
pub(crate) const VALLEY: &str = "studies/results/valley.json";
/// Copy of its picture.
pub(crate) const COPY: &str = "docs/images/valley.jpg";
/// Result of `bench lights`.
pub(crate) const LIGHTS: &str = "studies/results/lights.json";
/// Result of `bench --fps`.
pub(crate) const FRAMES: &str = "studies/results/frames.json";
/// Frames per second of the notes' simple scene.
const WANTED: f64 = 60.0;

fn text<'v>(value: &'v Value, key: &str) -> &'v str {
    value[key].as_str().unwrap_or_default()
}

fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or(f64::NAN)
}

/// Where and when a result was measured.
fn machine(result: &Value) -> String {
    let threads = number(result, "threads");
    format!(
        "{}, {threads} thread{}, {}, load average {:.1} before",
        text(result, "processor"),
        if threads == 1.0 { "" } else { "s" },
        text(result, "date"),
        number(result, "load"),
    )
}

/// The whole page.
pub(crate) fn page(valley: &Value, lights: &Value, frames: &Value) -> String {
    let mut page = format!(
        "# Scenes of the lecture notes\n\n{}\n",
        wrapped(&format!(
            "The lecture notes report run times of three scenes. This page has ours, of scenes with as \
             many elements. `cargo xtask readme` generates it from `{VALLEY}`, `{LIGHTS}` and `{FRAMES}`."
        ))
    );
    frame_of_a_film(&mut page, valley);
    many_lights(&mut page, lights);
    let none = Vec::new();
    simple_scenes(&mut page, frames["bench"].as_array().unwrap_or(&none));
    page
}

fn section(page: &mut String, title: &str, paragraphs: &[&str]) {
    let _ = write!(page, "\n## {title}\n");
    for paragraph in paragraphs {
        let _ = write!(page, "\n{}\n", wrapped(paragraph));
    }
}

fn frame_of_a_film(page: &mut String, result: &Value) {
    let image = COPY.trim_start_matches("docs/");
    let then = number(result, "hours_in_the_notes");
    let millions = |key: &str| number(result, key) / 1e6;
    let gib = number(result, "peak_bytes") / f64::from(1 << 30);
    let total = number(result, "total_s");
    section(page, "240 million quads, 80 million rays", &[]);
    let _ = write!(
        page,
        "\n![A valley of 240 million quads with a lake]({image})\n\n\
         | | quads | rays | time | peak memory |\n|---|---:|---:|---:|---:|\n\
         | a film frame, in the notes | 240 million | 80 million | {then:.0} h | – |\n\
         | the picture above | {:.0} million | {:.0} million | {total:.0} s | {gib:.1} GiB |\n",
        millions("quads"),
        millions("rays"),
    );
    let paragraphs = [
        format!(
            "The notes report \"more than four days without and about eight hours with optimisation\" for \
             a frame with 15 cars (Christensen et al. 2006), on a machine of that time. That frame had \
             other shading, so the ratio of the times, {:.0}, compares more than two renderers.",
            then * 3600.0 / total
        ),
        format!(
            "The [scene](../{SCENE}) has {} instances of one height field of 16 million quads. Its heights \
             are noise (displacement). Noise by height and slope gives rock, grass and snow. The lake is \
             glass with the index of water: it reflects, refracts and absorbs, and the sun shines \
             through it. The haze is a blend of materials by distance. The picture has {} x {} pixels with \
             {} samples each: {:.1} million camera, reflected and refracted rays, and {:.1} million shadow \
             rays. Measured on {}: {:.1} s to build and {:.1} s to render.",
            result["instances"],
            result["width"],
            result["height"],
            result["samples"],
            millions("closest_rays"),
            millions("shadow_rays"),
            machine(result),
            number(result, "build_s"),
            number(result, "render_s"),
        ),
        "`cargo xtask bench scale --page` measures it again and renders the picture; the large one is \
         `target/pictures/valley.png`. With `--quick`, it takes a sixteenth of the quads and pixels."
            .to_owned(),
    ];
    for paragraph in paragraphs {
        let _ = write!(page, "\n{}\n", wrapped(&paragraph));
    }
}

fn many_lights(page: &mut String, result: &Value) {
    let row = |culling: bool| {
        let mut rows = result["rows"].as_array().into_iter().flatten();
        let row = rows.find(|row| row["culling"] == culling);
        row.cloned().unwrap_or_default()
    };
    let (fast, slow) = (row(true), row(false));
    let seconds = number(&fast, "seconds");
    let picture = &result["picture"];
    section(
        page,
        "380 thousand triangles, 104 lights",
        &[
            "![A harbour at night under 104 lamps](images/pictures/harbour.jpg)",
            &format!(
                "The notes report \"in real time\", with global illumination. Whitstone computes direct \
                 light with shadows, and mirrors and glass, but no global illumination. It renders a \
                 landscape of {} triangles under {} lights at {size} x {size} pixels with one sample each, \
                 {:.1} million rays, in {seconds:.2} s: **{:.2} frames per second** ({}, median of {} \
                 rounds). Without light culling, a frame takes {:.2} s and has the same pixels.",
                result["triangles"],
                result["lights"],
                number(&fast, "rays") / 1e6,
                1.0 / seconds,
                machine(result),
                result["rounds"],
                number(&slow, "seconds"),
                size = result["size"],
            ),
            &format!(
                "The [picture](../{scene}) above has a height field of as many triangles, and {lights} \
                 lights, 104 of them lamps. Its water is a mirror with waves. At {} x {} pixels, one \
                 sample each, a frame of {:.0} million rays takes {:.0} s on the same machine: {:.0} \
                 rays for each pixel, {:.1} million rays per second. That is a picture, not a scene in \
                 real time.",
                picture["width"],
                picture["height"],
                number(picture, "rays") / 1e6,
                number(picture, "seconds"),
                number(picture, "rays") / (number(picture, "width") * number(picture, "height")),
                number(picture, "rays") / 1e6 / number(picture, "seconds"),
                scene = text(picture, "scene"),
                lights = picture["lights"],
            ),
            &format!("`cargo xtask bench lights --json {LIGHTS}` measures this."),
        ],
    );
}

fn simple_scenes(page: &mut String, frames: &[Value]) {
    section(
        page,
        "A simple scene at 1080p",
        &["The notes report 60 frames per second on a GPU."],
    );
    for frame in frames {
        let rate = number(frame, "frames_per_s");
        let rays = number(frame, "rays");
        let ns = number(frame, "ns_per_ray_and_thread");
        let text = format!(
            "Whitstone renders [{scene}](../{scene}) at {} x {} pixels with **{rate:.1} frames per second** \
             ({}, median of {} frames): {:.2} million rays a frame, shadow rays included, at {ns:.0} ns a \
             ray and thread. {WANTED} frames per second need {:.0} million rays per second, or {:.2} ns a \
             ray: {:.0} such threads, if all scale as these, or a GPU.",
            frame["width"],
            frame["height"],
            machine(frame),
            frame["frames"],
            rays / 1e6,
            WANTED * rays / 1e6,
            1e9 / (WANTED * rays),
            (WANTED / rate * number(frame, "threads")).ceil(),
            scene = text(frame, "scene"),
        );
        let _ = write!(page, "\n{}\n", wrapped(&text));
    }
    let text = format!("`cargo xtask bench --fps --json {FRAMES}` measures this.");
    let _ = write!(page, "\n{}\n", wrapped(&text));
}

/// What is wrong with the picture: it must show the scene as it is, and be the one that was
/// measured.
pub(crate) fn problems(registry: &Registry, valley: &Value) -> Result<Vec<String>, Failure> {
    let hash = pictures::scene_hash(registry, Path::new(SCENE), &[])?;
    let copy = fs::read(COPY).map_or(String::new(), |bytes| pictures::hash_of(&bytes));
    Ok(found(valley, &hash, &copy))
}

fn found(valley: &Value, scene: &str, copy: &str) -> Vec<String> {
    let again = "run `cargo xtask bench scale --page`, then `cargo xtask readme`";
    let mut problems = Vec::new();
    if valley["scene_hash"] != scene {
        problems.push(format!("{VALLEY}: measured with another {SCENE}; {again}"));
    }
    if valley["copy_hash"] != copy {
        problems.push(format!("{COPY}: not the picture of {VALLEY}; {again}"));
    }
    problems
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn another_scene_and_another_picture_are_reported() {
        let valley = json!({ "scene_hash": "a", "copy_hash": "b" });
        assert!(found(&valley, "a", "b").is_empty());
        for (scene, copy, file) in [("x", "b", VALLEY), ("a", "x", COPY)] {
            let problems = found(&valley, scene, copy);
            assert!(
                problems.len() == 1 && problems[0].starts_with(file),
                "{problems:?}"
            );
        }
    }

    #[test]
    fn figures_follow_from_the_results() {
        let valley = json!({
            "hours_in_the_notes": 8.0, "total_s": 100.0, "quads": 240_000_000_u64, "rays": 81_000_000,
            "peak_bytes": 3_u64 << 30, "threads": 2, "processor": "P", "date": "D", "load": 0.5,
        });
        let row = |culling, seconds| json!({ "culling": culling, "seconds": seconds, "rays": 5_000_000 });
        let lights = json!({ "rows": [row(false, 1.0), row(true, 0.25)], "threads": 1 });
        let frame = json!({
            "frames_per_s": 15.0, "rays": 10_000_000, "threads": 2, "ns_per_ray_and_thread": 13.3,
            "scene": "s.toml",
        });
        let page = page(&valley, &lights, &json!({ "bench": [frame] }));
        for expected in [
            "| 240 million | 81 million | 100 s | 3.0 GiB |",
            "the times, 288,",
            "P, 2 threads, D, load average 0.5 before",
            "**4.00 frames per second**",
            "600 million rays per second",
            "1.67 ns",
            "8 such threads",
        ] {
            let words: Vec<&str> = page.split_whitespace().collect();
            assert!(words.join(" ").contains(expected), "{expected}: {page}");
        }
    }
}
