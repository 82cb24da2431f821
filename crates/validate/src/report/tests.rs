mod page;

use super::{Baseline, Changes, Diagram, Extras, html, pages};
use crate::driver::Hello;
use crate::explain::Reason;
use crate::sensitivity::{Effect, Parameter};
use crate::{CaseResult, LayerResult, Pictures, Provenance, Reference, Results, Status, Summary, WorstPixel};
use page::Page;
use std::collections::{BTreeMap, BTreeSet};
use whitstone_image::Image;
use whitstone_metrics::metrics::BlockBias;

/// Text that a scene file may contain and a page must not.
const HOSTILE: &str =
    r#"</pre><script>alert("1")</script> '"><img src=x onerror=alert(2)> &lt; {{ 7 * 7 }} "#;

/// A ball in front of a wall, with another radius for each picture.
fn ball(size: usize, radius: f32) -> Image {
    let wave = |v: f32| 0.5 + 0.5 * (9.0 * v).sin();
    Image::from_fn(size, size, |x, y| {
        let [u, v] = [x, y].map(|p| (p as f32 + 0.5) / size as f32 * 2.0 - 1.0);
        let rest = radius * radius - u * u - v * v;
        if rest > 0.0 {
            let light = (rest.sqrt() - 0.5 * u - 0.6 * v).max(0.02);
            [0.9 * light, 0.35 * light, 0.2 * light]
        } else {
            [0.08 + 0.1 * wave(u), 0.12, 0.16 + 0.1 * wave(v)]
        }
    })
    .unwrap()
}

fn pictures(size: usize, ours: f32, noise: f32) -> Option<Pictures> {
    let reference = ball(size, 0.6);
    let planes = ball(size, ours);
    let ours = Image::from_fn(size, size, |x, y| {
        let index = y * size + x;
        let factor = 1.0 + noise * ((x * 31 + y * 17) % 23) as f32;
        planes.rgb().unwrap().map(|plane| plane[index] * factor)
    })
    .unwrap();
    Pictures::new(&ours, &reference, [([18, 41], None)].into_iter())
}

fn case(scene: &str, twin: &str) -> CaseResult {
    CaseResult {
        scene: scene.to_owned(),
        config: "default".to_owned(),
        reference: Some(Reference {
            name: "mitsuba".to_owned(),
            version: "3.9.1".to_owned(),
            variant: "llvm_ad_rgb".to_owned(),
            source: "live".to_owned(),
            k: 4.0,
        }),
        twin: twin.to_owned(),
        width: 96,
        height: 96,
        samples: 1,
        compared: true,
        rmse: Some(3.21e-7),
        rel_rmse_interior: Some(4.17e-7),
        limit: 9.6e-7,
        floor: 4.8e-7,
        relmse: Some(1.8e-12),
        mae: Some(1.9e-7),
        max_abs: Some(8.8e-6),
        mean_reference: Some(0.214),
        signed_block_bias: Some(BlockBias {
            bias: -2.4e-7,
            channel: "G",
            x: 32,
            y: 64,
            pixels: 256,
        }),
        bias_limit: 5e-5,
        pixels_over_tolerance: 1,
        explained: 1,
        explained_limit: 8,
        explained_radius_px: 1e-3,
        worst: vec![WorstPixel {
            x: 77,
            y: 40,
            ours: [0.081, 0.12, 0.161],
            reference: [0.31, 0.121, 0.07],
            reason: Some(Reason::Shift { radius_px: 1e-3 }),
            ..WorstPixel::default()
        }],
        layers: vec![
            LayerResult {
                name: "shape_id.I".to_owned(),
                differing: Some(1),
                ..LayerResult::default()
            },
            LayerResult {
                name: "depth.Z".to_owned(),
                rms: Some(2.2e-7),
                max_abs: Some(1.9e-6),
                ..LayerResult::default()
            },
        ],
        drift: Some(0.0),
        build_s: 0.00021,
        render_s: 0.0123,
        reference_s: Some(0.345),
        rays: 181_237,
        mrays_per_s: 14.7,
        status: Some(Status::Pass),
        costs: vec![whitstone_render::Cost {
            part: "film".to_owned(),
            bytes: Some(110_592),
            work: "9216 camera rays, 1 per pixel".to_owned(),
        }],
        plugins: vec!["material/matte".to_owned(), "shape/sphere".to_owned()],
        omitted: vec!["texture coordinates: no texture reads them".to_owned()],
        command: format!("whitstone validate scenes/{scene}.toml"),
        pictures: pictures(96, 0.6, 1e-7),
        ..CaseResult::default()
    }
}

fn failing() -> CaseResult {
    let pixel = |x, y, ours, reference, reason, first: Option<&str>| WorstPixel {
        x,
        y,
        ours,
        reference,
        reason,
        between: None,
        tried: first.map(|_| [[0.05, 0.12, 0.2], [0.0912, 0.13, 0.2]]),
        first_difference: first.map(str::to_owned),
        oracle: None,
    };
    CaseResult {
        rmse: Some(1.07e-2),
        rel_rmse_interior: Some(8.73e-3),
        limit_reason: Some(
            "Total internal reflection near the critical angle is ill-conditioned.".to_owned(),
        ),
        pixels_over_tolerance: 1134,
        explained: 11,
        unexplained: 1123,
        signed_block_bias: Some(BlockBias {
            bias: 1.4e-3,
            channel: "R",
            x: 16,
            y: 16,
            pixels: 251,
        }),
        worst: vec![
            pixel(
                18,
                41,
                [0.9013, 0.350112, 0.2],
                [0.0812, 0.12, 0.2],
                None,
                Some("sample 0: camera ray: ours hits shape 2, primitive 0, the reference nothing"),
            ),
            pixel(
                77,
                52,
                [f32::NAN, 0.3, f32::INFINITY],
                [0.25, 0.3, 0.1],
                None,
                None,
            ),
            pixel(
                60,
                12,
                [0.5012, 0.31, 1e-9],
                [0.5, 0.31, 0.0],
                Some(Reason::Rounding { ulps: 2.0 }),
                None,
            ),
            pixel(
                61,
                12,
                [0.5, 0.33, 0.0],
                [0.5, 0.31, 0.0],
                Some(Reason::SpawnOffset),
                None,
            ),
            pixel(
                62,
                12,
                [0.5, 0.33, 0.0],
                [0.5, 0.31, 0.0],
                Some(Reason::Stored),
                None,
            ),
        ],
        problems: vec![
            "unexplained: 1123 pixels over tolerance".to_owned(),
            "explained: 11 pixels over tolerance, more than 8".to_owned(),
            "rel_rmse_interior 8.73e-3 is above the limit 9.60e-7".to_owned(),
        ],
        inexact: vec!["it varies by more than the tolerance at 2722 pixels".to_owned()],
        status: Some(Status::Fail),
        pictures: pictures(96, 0.63, 3e-6),
        ..case("materials/dielectric", "native")
    }
}

fn not_rendered() -> CaseResult {
    CaseResult {
        scene: "shapes/torus".to_owned(),
        config: "default".to_owned(),
        status: Some(Status::Fail),
        problems: vec![
            "error: unknown shape `torsu`\n --> scenes/shapes/torus.toml:14:8\n   |\n14 | type = \"torsu\"\n   |        ^^^^^^^ known are: `torus`, `sphere`\n".to_owned(),
        ],
        command: "whitstone validate scenes/shapes/torus.toml".to_owned(),
        ..CaseResult::default()
    }
}

fn hostile() -> CaseResult {
    let text = HOSTILE.to_owned();
    CaseResult {
        scene: text.clone(),
        config: text.clone(),
        twin: text.clone(),
        reference: Some(Reference {
            name: text.clone(),
            version: text.clone(),
            variant: text.clone(),
            source: text.clone(),
            k: f64::NAN,
        }),
        limit_reason: Some(text.clone()),
        problems: vec![text.clone()],
        inexact: vec![text.clone()],
        omitted: vec![text.clone()],
        plugins: vec![text.clone()],
        command: text.clone(),
        layers: vec![LayerResult {
            name: text.clone(),
            rms: Some(f64::INFINITY),
            ..LayerResult::default()
        }],
        worst: vec![WorstPixel {
            first_difference: Some(text),
            oracle: None,
            ..failing().worst[0].clone()
        }],
        mean_reference: None,
        ..failing()
    }
}

pub(super) fn results(cases: Vec<CaseResult>, references: &str) -> Results {
    Results {
        summary: Summary::of(&cases, references.to_owned(), 41.27),
        provenance: Provenance {
            whitstone: "0.1.0".to_owned(),
            threads: 0,
            povray: None,
            mitsuba: (references == "live").then(|| Hello {
                mitsuba: "3.9.1".to_owned(),
                drjit: "1.4.0".to_owned(),
                variant: "llvm_ad_rgb".to_owned(),
                python: "3.12.3".to_owned(),
                libllvm: "libLLVM.so.19.1".to_owned(),
                llvm_version: "19.1.7".to_owned(),
                cpu: "An eight-core processor".to_owned(),
                threads: 8,
            }),
        },
        results: cases,
        skipped: Vec::new(),
        matrix: Vec::new(),
    }
}

pub(super) fn example() -> Results {
    let names = [
        ("cameras/perspective", "formula", 4.17e-7),
        ("lights/spot", "native", 8.9e-7),
        ("materials/matte", "native", 2.2e-7),
        ("materials/phong", "hosted", 5.1e-7),
        ("shapes/mesh", "native", 7.7e-7),
        ("shapes/sphere", "native", 3.3e-7),
        ("showcase/still-life", "formula", 6.4e-7),
    ];
    let mut cases: Vec<CaseResult> = names
        .into_iter()
        .map(|(scene, twin, error)| CaseResult {
            rel_rmse_interior: Some(error),
            ..case(scene, twin)
        })
        .collect();
    cases.insert(2, failing());
    cases.insert(6, not_rendered());
    results(cases, "live")
}

fn parse(page: &str) -> Page {
    let page = Page::parse(page);
    assert_eq!(page.errors, Vec::<String>::new(), "the page is not well-formed");
    page
}

fn row(document: &Page, id: &str) -> String {
    document.select(&format!("tr[data-case='{id}']"))[0].text()
}

#[test]
fn the_check_of_well_formed_pages_sees_what_is_left_open() {
    let broken = "<!doctype html><html lang=en><head><title>t</title></head><body><section><p>a</section></div></body></html>";
    assert!(!Page::parse(broken).errors.is_empty());
    let open = "<!doctype html><html lang=en><head><title>t</title></head><body><section>a</body></html>";
    assert!(!Page::parse(open).errors.is_empty());
}

#[test]
fn selectors_find_what_they_name_and_no_more() {
    let page = parse(
        "<!doctype html><html lang=en><head><title>t</title></head><body>\
         <div id=a class='x y'><p class=x>1 <b>2</b>\n3</p></div><p class=y data-n='7'>4</p></body></html>",
    );
    let found = |selector: &str| {
        page.select(selector)
            .iter()
            .map(|node| node.text())
            .collect::<Vec<_>>()
    };
    assert_eq!(found("p"), ["1 2 3", "4"]);
    assert_eq!(found(".x"), ["1 2 3", "1 2 3"]);
    assert_eq!(found("#a p.x"), ["1 2 3"]);
    assert_eq!(found("body #a b"), ["2"]);
    assert_eq!(found("p[data-n]"), ["4"]);
    assert_eq!(found("[data-n='7'].y"), ["4"]);
    for nothing in ["p p", "#a .y", "p.x.y", "[data-n='8']", "b p", ".xy"] {
        assert!(found(nothing).is_empty(), "{nothing}");
    }
}

#[test]
fn every_case_has_its_values_and_limits() {
    let results = example();
    let page = html(&results, &Extras::default());
    let document = parse(&page);
    assert_eq!(
        document.select("table.summary tbody tr").len(),
        results.results.len()
    );
    assert_eq!(document.select("details.case").len(), results.results.len());
    let failed = row(&document, "case-3");
    for part in [
        "FAIL",
        "materials/dielectric",
        "8.73e-3 > 9.60e-7",
        "1.40e-3 > 5.00e-5",
        "11 > 8",
        "1,123 > 0",
    ] {
        assert!(failed.contains(part), "{part} is not in: {failed}");
    }
    let passed = row(&document, "case-1");
    for part in [
        "pass",
        "4.17e-7 ≤ 9.60e-7",
        "2.40e-7 ≤ 5.00e-5",
        "1 ≤ 8",
        "0 ≤ 0",
        "3.21e-7",
        "formula",
        "live",
    ] {
        assert!(passed.contains(part), "{part} is not in: {passed}");
    }
    let section = document.select("#case-1")[0].text();
    for part in [
        "4.17e-7 ≤ 9.60e-7",
        "darker in G of the block at (32, 64)",
        "181,237",
        "whitstone validate scenes/cameras/perspective.toml",
        "depth.Z",
        "an edge: a shift of 1e-3 pixel",
        "texture coordinates: no texture reads them",
    ] {
        assert!(section.contains(part), "{part} is not in: {section}");
    }
    assert!(document.select("dl.provenance")[0].text().contains("19.1.7"));
}

#[test]
fn failures_come_first_are_open_and_marked_by_more_than_colour() {
    let page = html(&example(), &Extras::default());
    let document = parse(&page);
    let first = &document.select("table.summary tbody tr")[0];
    assert_eq!(first.attribute("data-case").as_deref(), Some("case-3"));
    assert_eq!(document.select("details.case[open]").len(), 2);
    assert_eq!(document.select("tr[data-case='case-3'] td.over").len(), 4);
    assert!(
        document
            .select("tr[data-case='case-3'] td.over")
            .into_iter()
            .all(|cell| { cell.text().starts_with("✗ over the limit:") })
    );
    assert!(document.select("tr[data-case='case-1'] td.over").is_empty());
    assert!(
        document.select("h1")[0]
            .text()
            .contains("2 of 9 cases do not pass (2 wrong)")
    );
    assert!(
        document.select(".problems pre")[0]
            .text()
            .contains("unexplained: 1123 pixels")
    );
    let section = document.select("#case-3")[0].text();
    for part in [
        "The reference is inexact here",
        "varies by more than the tolerance at 2722 pixels",
        "range of all variations: 0.0500000, 0.120000, 0.200000 to 0.0912000, 0.130000, 0.200000",
    ] {
        assert!(section.contains(part), "{part} is not in: {section}");
    }
    assert!(!document.select("#case-1")[0].text().contains("inexact here"));
}

#[test]
fn hostile_text_stays_text() {
    let page = html(&results(vec![hostile()], HOSTILE), &Extras::default());
    let document = parse(&page);
    assert_eq!(document.select("script").len(), 1, "only the page's own");
    assert!(!page.contains("alert(\"1\")") && !page.contains("<img src=x"));
    assert!(document.select("[onerror]").is_empty());
    let shown = document.select("#case-1 .problems pre")[0].text();
    assert_eq!(shown, HOSTILE.split_whitespace().collect::<Vec<_>>().join(" "));
}

#[test]
fn absent_numbers_are_dashes_with_a_reason() {
    let page = html(&example(), &Extras::default());
    let document = parse(&page);
    let missing = row(&document, "case-7");
    assert!(missing.contains('–') && !missing.contains("0 ≤ 0"), "{missing}");
    // As black as the reference: there is nothing to explain, but it is compared.
    let alike = CaseResult {
        compared: true,
        ..CaseResult::default()
    };
    let page = html(&results(vec![alike], "live"), &Extras::default());
    assert!(row(&parse(&page), "case-1").contains("0 ≤ 0"));
    for dash in document.select(".absent") {
        assert!(dash.attribute("title").is_some_and(|title| !title.is_empty()));
    }
    // No case at all, and one about which nothing is known.
    let empty = html(
        &results(Vec::new(), "stored (no Python was found)"),
        &Extras::default(),
    );
    assert!(parse(&empty).select("h1")[0].text().contains("No case was run"));
    parse(&html(
        &results(vec![CaseResult::default()], "live"),
        &Extras::default(),
    ));
}

#[test]
fn nothing_is_loaded_and_every_picture_has_words() {
    let page = html(&example(), &Extras::default());
    let document = parse(&page);
    for image in document.select("img") {
        assert!(
            image
                .attribute("src")
                .is_some_and(|src| src.starts_with("data:image/png;base64,"))
        );
        assert!(image.attribute("alt").is_some_and(|alt| !alt.is_empty()));
    }
    assert_eq!(document.select("details.case img").len(), 3 * 8);
    for link in document.select("[href]") {
        let target = link.attribute("href").unwrap_or_default();
        assert!(target.starts_with('#') || target.starts_with("data:"), "{target}");
    }
    let style = document.select("style")[0].text();
    assert!(!style.contains("@import") && !style.contains("http"));
    // Small pictures are magnified by whole numbers.
    let figure = &document.select("#case-1 figure")[0];
    assert_eq!(figure.attribute("style").as_deref(), Some("width: 384px"));
}

/// If `WHITSTONE_REPORT_EXAMPLE` names a folder, writes examples there for inspection.
#[test]
fn examples_to_look_at() {
    let Some(folder) = std::env::var_os("WHITSTONE_REPORT_EXAMPLE") else {
        return;
    };
    let folder = std::path::PathBuf::from(folder);
    let passing: Vec<CaseResult> = example()
        .results
        .into_iter()
        .filter(|case| case.status == Some(Status::Pass))
        .collect();
    let pages = [
        ("mixed.html", example()),
        (
            "passing.html",
            results(passing, "stored (no Python 3.9 or later was found)"),
        ),
        ("hostile.html", results(vec![hostile(), not_rendered()], HOSTILE)),
    ];
    for (name, results) in pages {
        std::fs::write(folder.join(name), html(&results, &Extras::default())).unwrap();
    }
}

#[test]
fn the_matrix_shows_what_fails_and_why_the_rest_was_left_out() {
    use crate::matrix::{Cell, Outcome, Tally};
    let cell = |axis: &str, setting: &str, outcome, detail: &str| Cell {
        scene: "shapes/sphere".to_owned(),
        axis: axis.to_owned(),
        setting: setting.to_owned(),
        outcome,
        against: String::new(),
        detail: detail.to_owned(),
    };
    let mut results = example();
    assert!(!html(&results, &Extras::default()).contains("id=\"matrix\""));
    results.results.retain(|case| case.status == Some(Status::Pass));
    results.matrix = vec![
        cell("accelerator", "bvh", Outcome::Pass, "bit-identical"),
        cell("accelerator", "grid", Outcome::Fail, HOSTILE),
        cell("filter", "all", Outcome::Skipped, "no texture in use"),
    ];
    results.summary.matrix = Tally::of(&results.matrix);
    let text = html(&results, &Extras::default());
    assert!(text.contains("1 setting of the matrix fails"), "the verdict");
    let page = parse(&text);
    let table = page.select("table.matrix")[0].text();
    assert!(
        table.contains("grid") && table.contains("no texture in use"),
        "{table}"
    );
    // A failing setting makes a failing page, though all cases pass.
    assert!(page.select("h1.fail").len() == 1);
    results.matrix.remove(1);
    assert!(parse(&html(&results, &Extras::default())).select("h1.pass").len() == 1);
}

#[test]
fn a_case_shows_what_was_used_and_what_it_takes() {
    let text = html(&example(), &Extras::default());
    assert!(text.contains("material/matte, shape/sphere"));
    assert!(text.contains("film: 110592 bytes; 9216 camera rays, 1 per pixel"));
}

#[test]
fn plugins_can_be_chosen_and_rows_name_theirs() {
    let page = html(&example(), &Extras::default());
    let document = parse(&page);
    let options: Vec<String> = document
        .select("#plugin option")
        .iter()
        .filter_map(|option| option.attribute("value"))
        .collect();
    assert_eq!(options, ["", "material/matte", "shape/sphere"]);
    assert_eq!(
        document.select("tr[data-case='case-1']")[0]
            .attribute("data-plugins")
            .as_deref(),
        Some("material/matte shape/sphere")
    );
    let pixels = document.select("#case-1 .pictures")[0].attribute("data-pixels");
    assert!(pixels.is_some_and(|text| text.len() > 1000));
    let drawing = document.select("main")[0].attribute("data-drawing").unwrap();
    let drawing: serde_json::Value = serde_json::from_str(&drawing).unwrap();
    assert_eq!(drawing["magma"].as_array().map(Vec::len), Some(768));
    assert_eq!(drawing["relative"], serde_json::json!([1e-7, 1e-1]));
}

fn diagram(name: &str) -> Diagram {
    Diagram {
        name: name.to_owned(),
        title: HOSTILE.to_owned(),
        about: HOSTILE.to_owned(),
        verdict: "pass".to_owned(),
        svg: "<svg><circle><title>grid: RMSE 1e-3\nwhitstone render</title></circle></svg>".to_owned(),
    }
}

/// A page of each scene, and an index that leads to all of them and back.
#[test]
fn many_cases_have_a_page_for_each_scene() {
    let mut results = example();
    let few = pages(&results, &Extras::default());
    assert_eq!(few.len(), 1);
    assert_eq!(few[0].0, "index.html");
    let template = results.results[0].clone();
    // Two of these names are equal on some file systems.
    for (scene, count) in [("a/b", 80), ("a-b", 80), ("A/b", 3)] {
        for depth in 0..count {
            let mut case = template.clone();
            case.scene = scene.to_owned();
            case.config = if depth == 0 {
                "default".to_owned()
            } else {
                format!("depth {depth}")
            };
            results.results.push(case);
        }
    }
    let extras = Extras {
        sensitivity: BTreeMap::from([(
            "a/b".to_owned(),
            vec![Parameter {
                path: HOSTILE.to_owned(),
                value: 2.0,
                effect: Effect::Seen {
                    change: 1e-6,
                    problem: HOSTILE.to_owned(),
                },
            }],
        )]),
        ..Extras::default()
    };
    let files: BTreeMap<String, String> = pages(&results, &extras).into_iter().collect();
    let index = parse(&files["index.html"]);
    assert!(index.select("#cases").is_empty() && index.select("details.case").is_empty());
    let links: BTreeSet<String> = index
        .select(".summary a")
        .iter()
        .filter_map(|link| link.attribute("href"))
        .collect();
    let other: BTreeSet<String> = files
        .keys()
        .filter(|path| *path != "index.html")
        .cloned()
        .collect();
    assert_eq!(links, other);
    for expected in ["scenes/a-b.html", "scenes/a-b-2.html", "scenes/A-b-3.html"] {
        assert!(files.contains_key(expected), "{expected}: {:?}", files.keys());
    }
    let mut cases = 0;
    for path in &other {
        let page = parse(&files[path]);
        cases += page.select("details.case").len();
        assert_eq!(
            page.select(".product a")[0].attribute("href").as_deref(),
            Some("../index.html")
        );
        assert!(page.select("[onerror]").is_empty());
    }
    assert_eq!(cases, results.results.len());
    let sensed = parse(&files["scenes/a-b.html"]);
    // For the unchanged scene, not for its settings.
    assert_eq!(sensed.select("table.sensitivity").len(), 1);
    assert!(sensed.select("table.sensitivity")[0].text().contains("5.00e-7"));
}

#[test]
fn changes_and_diagrams_have_their_sections() {
    let page = html(&example(), &Extras::default());
    let document = parse(&page);
    for section in ["#changes", "#studies", "#stress"] {
        assert!(document.select(section).is_empty(), "{section}");
    }
    let mut old = example();
    old.results[0].scene = HOSTILE.to_owned();
    old.results[2].status = Some(Status::Pass);
    let old: Baseline = serde_json::from_str(&serde_json::to_string(&old).unwrap()).unwrap();
    let extras = Extras {
        changes: Some(Changes::between(HOSTILE.to_owned(), &old, &example())),
        stress: vec![diagram("planet")],
        sensitivity: BTreeMap::new(),
        diagrams: vec![diagram("samples")],
    };
    let page = html(&example(), &extras);
    let document = parse(&page);
    let changes = document.select("#changes")[0].text();
    for part in ["broken", "pass FAIL", "gone", "7 cases are unchanged"] {
        assert!(changes.contains(part), "{part} is not in {changes}");
    }
    assert!(
        document.select("#studies circle title")[0]
            .text()
            .contains("whitstone render")
    );
    assert_eq!(document.select("#stress details").len(), 1);
    assert!(document.select("[onerror]").is_empty() && document.select("script").len() == 1);
}

#[test]
fn results_are_read_as_they_were_written() {
    let mut results = example();
    results.results[2].worst[0].tried = Some([[0.0, f64::NEG_INFINITY, 1.0], [1.0; 3]]);
    let text = serde_json::to_string(&results).unwrap();
    let read: Results = serde_json::from_str(&text).unwrap();
    assert!(read.results[2].worst[1].ours[0].is_nan());
    // Values that JSON cannot represent stay absent when they are written again.
    assert_eq!(serde_json::to_string(&read).unwrap(), text);
}
