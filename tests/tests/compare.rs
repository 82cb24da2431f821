//! `compare` of folders, of images with noise, by edges and by areas, and the JUnit XML that it
//! writes.

use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::Output;
use whitstone::image::{Image, Raster, ToneMap, exr_io};
use whitstone::validate::Variants;
use whitstone_tests::{program, root};

fn run(arguments: &[&str]) -> Output {
    program!().current_dir(root()).args(arguments).output().unwrap()
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

fn check(arguments: &[&str], code: i32, parts: &[&str]) -> String {
    let output = run(arguments);
    let text = text(&output);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {text}");
    for part in parts {
        assert!(text.contains(part), "{arguments:?}: {part} is not in {text}");
    }
    text
}

/// A wall: its left half has the id 0 and is dark, the right one is bright and has the id 1.
fn wall(change: impl Fn(usize, usize) -> f32) -> Image {
    let left = |x: usize| x < 8;
    let mut image = Image::from_fn(16, 16, |x, y| {
        [if left(x) { 0.25 } else { 0.75 } + change(x, y); 3]
    })
    .unwrap();
    let ids = (0..256).map(|i| if left(i % 16) { 0.0 } else { 1.0 });
    image.add_channel("shape_id.I", ids.collect()).unwrap();
    image
}

fn put(folder: &Path, name: &str, image: &Image) -> String {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    exr_io::write(&path, image).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn folders_are_matched_by_path_and_what_is_missing_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (ours, reference) = (at("ours"), at("reference"));
    let good = wall(|_, _| 0.0);
    for (name, image) in [("a.exr", &good), ("deep/er/b.EXR", &good), ("deep/c.exr", &good)] {
        for side in ["ours", "reference"] {
            put(folder.path(), &format!("{side}/{name}"), image);
        }
    }
    fs::write(folder.path().join("ours/notes.txt"), "not an image").unwrap();
    let (json, junit, pictures) = (at("all.json"), at("all.xml"), at("pictures"));
    let both = [ours.as_str(), reference.as_str()];
    let all = |extra: &[&'static str]| [&["compare"], &both[..], extra].concat();
    check(
        &all(&[]),
        0,
        &[
            "3 images: 3 passed, 0 failed, 0 could not be compared",
            "deep/er/b.EXR",
        ],
    );

    // One that only one side has: nothing differs, but something could not be compared.
    put(folder.path(), "reference/only.exr", &good);
    check(
        &all(&[]),
        2,
        &["ERROR  only.exr", "missing in", "could not be compared: 1"],
    );

    // A damaged and a differing one beside it: the others are compared all the same.
    fs::write(folder.path().join("ours/a.exr"), "no image").unwrap();
    put(
        folder.path(),
        "ours/deep/c.exr",
        &wall(|x, y| if (x, y) == (3, 3) { 0.5 } else { 0.0 }),
    );
    let arguments = [
        &["compare"],
        &both[..],
        &["--json", &json, "--junit", &junit, "--png", &pictures],
    ]
    .concat();
    check(
        &arguments,
        1,
        &[
            "FAIL   deep/c.exr",
            "ERROR  a.exr",
            "4 images: 1 passed, 1 failed, 2 could not be compared",
        ],
    );
    let value: Value = serde_json::from_slice(&fs::read(json).unwrap()).unwrap();
    assert_eq!(
        (&value["summary"]["errors"], &value["images"][1]["name"]),
        (&Value::from(2), &Value::from("deep/c.exr"))
    );
    assert_eq!(value["images"][1]["metrics"]["width"], 16);
    let junit = fs::read_to_string(junit).unwrap();
    for part in [
        "<testsuite name=\"whitstone compare\" tests=\"4\" skipped=\"0\" errors=\"2\" failures=\"1\"",
        "<testcase name=\"deep/er/b.EXR\"",
        "<failure message=\"1 pixels are over tolerance; the limit is 0\"",
        "<error message=",
    ] {
        assert!(junit.contains(part), "{part} is not in {junit}");
    }
    assert!(folder.path().join("pictures/deep/c.png").is_file());
    assert!(!folder.path().join("pictures/only.png").exists());

    check(
        &["compare", &ours, &at("reference/only.exr")],
        2,
        &["is a folder and"],
    );
    check(
        &["compare", &at("pictures"), &at("pictures")],
        2,
        &["there are no files *.exr"],
    );
}

/// 8-bit codes are compared exactly, however small the difference of the light is, and not with
/// floating-point numbers.
#[test]
fn masked_pixels_and_other_references_are_accepted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let put = |name: &str, image: &Image| put(path, name, image);
    let dot = |x: usize, y: usize| x == 3 && y == 4;
    let reference = put("reference/a.exr", &wall(|_, _| 0.0));
    let ours = put("ours/a.exr", &wall(|x, y| if dot(x, y) { f32::NAN } else { 0.0 }));
    let mask = |around: fn(usize, usize) -> bool| {
        Image::from_fn(16, 16, |x, y| [if around(x, y) { 0.0 } else { 1.0 }; 3]).unwrap()
    };
    let right = put(
        "masks/a.exr",
        &mask(|x, y| (2..5).contains(&x) && (3..6).contains(&y)),
    );
    let wrong = put("wrong.exr", &mask(|x, _| x > 8));
    check(&["compare", &ours, &reference], 1, &["not finite"]);
    check(
        &["compare", &ours, &reference, "--mask", &right],
        0,
        &["0 of 256"],
    );
    check(
        &["compare", &ours, &reference, "--mask", &wrong],
        1,
        &["not finite"],
    );
    let small = put("small.exr", &Image::from_fn(2, 2, |_, _| [0.0; 3]).unwrap());
    let text = ["the mask has 2 x 2 pixels", "16 x 16"];
    check(&["compare", &ours, &reference, "--mask", &small], 2, &text);

    let darker = put("other/a.exr", &wall(|x, _| if x < 8 { -0.1 } else { 0.0 }));
    let also = put("also/a.exr", &wall(|x, _| if x < 8 { -0.1 } else { 0.0 }));
    check(
        &["compare", &darker, &reference],
        1,
        &["128 pixels are over tolerance"],
    );
    check(
        &["compare", &darker, &reference, "--or", &also],
        0,
        &["compared with", "also"],
    );
    // If none passes, the nearest one is shown.
    let far = put("far.exr", &wall(|_, _| 5.0));
    let text = ["128 pixels are over tolerance", "reference/a.exr"];
    check(&["compare", &darker, &far, "--or", &reference], 1, &text);
    // So are other channels than colours.
    let mut other_ids = wall(|_, _| 0.0);
    other_ids.channel_mut("shape_id.I").unwrap().fill(7.0);
    let other_ids = put("other_ids.exr", &other_ids);
    let one_pixel = wall(|x, y| if (x, y) == (3, 3) { 0.5 } else { 0.0 });
    let one_pixel = put("one_pixel.exr", &one_pixel);
    let same = put("same.exr", &wall(|_, _| 0.0));
    for pair in [[&other_ids, &one_pixel], [&one_pixel, &other_ids]] {
        let arguments = [
            "compare",
            &same,
            pair[0],
            "--or",
            pair[1],
            "--channel",
            "shape_id.I",
        ];
        check(&arguments, 1, &[&format!("compared with          {one_pixel}")]);
    }

    let at = |name: &str| path.join(name).to_str().unwrap().to_owned();
    let folders = |more: &[&str], code| {
        let (ours, reference) = (at("ours"), at("reference"));
        check(&[&["compare", &ours, &reference], more].concat(), code, &[]);
    };
    folders(&[], 1);
    folders(&["--mask", &at("masks")], 0);
    fs::create_dir(path.join("empty")).unwrap();
    folders(&["--mask", &at("empty")], 1);
    fs::copy(&darker, path.join("ours/a.exr")).unwrap();
    folders(&["--or", &at("empty")], 1);
    folders(&["--or", &at("empty"), "--or", &at("also")], 0);
    let text = ["should be a folder"];
    check(
        &["compare", &at("ours"), &at("reference"), "--mask", &right],
        2,
        &text,
    );
}

#[test]
fn codes_are_compared_exactly() {
    let folder = tempfile::tempdir().unwrap();
    let png = |name: &str, image: &Image| {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        let raster = Raster::preview(image, ToneMap::default()).unwrap();
        raster.write_png(&path).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let plain = png("a/plain.png", &wall(|_, _| 0.0));
    // A code of the bright half is 0.0075 wide.
    let changed = wall(|x, y| if (x, y) == (12, 3) { 0.01 } else { 0.0 });
    let changed = png("b/plain.png", &changed);
    check(
        &["compare", &plain, &plain],
        0,
        &["other codes", "0 pixels", "flip"],
    );
    let told = [
        "1 pixels have other codes",
        "the largest difference is 1, of 8-bit codes",
    ];
    check(&["compare", &changed, &plain], 1, &told);
    check(
        &["compare", &changed, &plain, "--max-code-difference", "1"],
        0,
        &["pass"],
    );
    // The tolerance of floating-point images does not hide it.
    check(&["compare", &changed, &plain, "--relative", "1"], 1, &told);
    check(&["compare", &changed, &plain, "--max-flip", "0"], 1, &["flip"]);
    let exr = put(folder.path(), "plain.exr", &wall(|_, _| 0.0));
    check(
        &["compare", &plain, &exr],
        2,
        &["ours has 8-bit codes", "cannot be compared"],
    );
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    check(&["compare", &at("a"), &at("b")], 2, &["there are no files *.exr"]);
    let both = [
        "compare",
        &at("a"),
        &at("b"),
        "--extension",
        "exr",
        "--extension",
        "png",
    ];
    check(&both, 1, &["FAIL", "plain.png"]);
}

#[test]
fn a_layer_is_compared_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let layered = |value: f32| {
        let mut image = wall(|_, _| 0.0);
        for (name, value) in [("Beauty.R", value), ("Beauty.G", 0.5), ("Beauty.B", 0.5)] {
            image.add_channel(name, vec![value; 256]).unwrap();
        }
        image
    };
    let (a, b) = (
        put(folder.path(), "a.exr", &layered(0.5)),
        put(folder.path(), "b.exr", &layered(0.6)),
    );
    check(&["compare", &a, &b], 0, &["pass"]);
    for layer in ["Beauty", "Beauty.R"] {
        check(
            &["compare", &a, &b, "--layer", layer],
            1,
            &["256 pixels are over tolerance"],
        );
    }
    check(&["compare", &a, &b, "--layer", "shape_id.I"], 0, &["pass"]);
    check(
        &["compare", &a, &b, "--layer", "Beuty.R"],
        2,
        &["did you mean Beauty.R?"],
    );
}

/// Each channel has its own limit, and ids are compared exactly.
#[test]
fn other_channels_have_limits_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let with = |id: f32, depth: f32| {
        let mut image = wall(|_, _| 0.0);
        image.channel_mut("shape_id.I").unwrap()[17] = id;
        image.add_channel("depth.Z", vec![depth; 256]).unwrap();
        image
    };
    let reference = put(folder.path(), "reference.exr", &with(0.0, 2.0));
    let ours = put(folder.path(), "ours.exr", &with(1.0, 2.001));
    let compare = |more: &[&str], code, parts: &[&str]| {
        check(&[&["compare", &ours, &reference], more].concat(), code, parts)
    };
    compare(&[], 0, &["channels not compared  depth.Z, shape_id.I"]);
    let text = compare(
        &["--channel", "depth.Z=0.01"],
        0,
        &["no pixel differs by more than 0.01"],
    );
    assert!(text.contains("channels not compared  shape_id.I"), "{text}");
    compare(
        &["--channel", "depth.Z=1e-4"],
        1,
        &["DIFFERS: depth.Z: 256 pixels differ by more than 0.0001; worst: pixel (0, 0)"],
    );
    let id = "shape_id.I: 1 pixel differs by more than 0; worst: pixel (1, 1), ours 1, reference 0";
    compare(&["--channel", "depth.Z=1", "--channel", "*"], 1, &[id]);
    compare(&["--channel", "dept.Z"], 2, &["did you mean depth.Z?"]);
    compare(&["--channel", "depth.Z=x"], 2, &["depth.Z=x"]);
    // What is masked agrees.
    let mask = Image::from_fn(16, 16, |x, y| [if (x, y) == (1, 1) { 0.0 } else { 1.0 }; 3]).unwrap();
    let mask = put(folder.path(), "mask.exr", &mask);
    compare(&["--channel", "shape_id.I", "--mask", &mask], 0, &["pass"]);
    let json = folder.path().join("compare.json");
    compare(
        &["--channel", "shape_id.I", "--json", json.to_str().unwrap()],
        1,
        &[],
    );
    let json: Value = serde_json::from_slice(&fs::read(json).unwrap()).unwrap();
    assert_eq!(json["channels"][0]["worst"]["at"], serde_json::json!([1, 1]));
}

/// The page has all images.
#[test]
fn a_page_shows_all_images() {
    let folder = tempfile::tempdir().unwrap();
    for (name, image) in [
        ("ours/<b>.exr", wall(|_, _| 0.0)),
        ("refs/<b>.exr", wall(|_, _| 0.0)),
        ("ours/other.exr", wall(|x, _| 0.01 * x as f32)),
        ("refs/other.exr", wall(|_, _| 0.0)),
        ("ours/new.exr", wall(|_, _| 0.0)),
    ] {
        put(folder.path(), name, &image);
    }
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let page = |ours: &str, refs: &str, code: i32| {
        check(
            &["compare", &at(ours), &at(refs), "--html", &at("page.html")],
            code,
            &[],
        );
        fs::read_to_string(at("page.html")).unwrap()
    };
    let html = page("ours", "refs", 1);
    for words in [
        "3 images compared, 2 with differences",
        "&#60;b&#62;.exr",
        "other.exr",
        "pixels are over tolerance; the limit is 0",
        "not comparable",
        "missing in ",
    ] {
        assert!(html.contains(words), "{words}");
    }
    // Ours, the reference and the error of both pairs, and the new image alone.
    assert_eq!(html.matches("<figcaption>").count(), 7);
    assert_eq!(html.matches("data-pixels=").count(), 2);
    assert!(
        !html.contains("class=\"accept\"") && !html.contains("id=\"done\""),
        "no buttons"
    );
    let html = page("ours/other.exr", "refs/other.exr", 1);
    assert!(html.contains("1 image compared, 1 with differences"));
    let html = page("ours/<b>.exr", "refs/<b>.exr", 0);
    assert!(html.contains("1 image compared, no differences"));
    let html = page("ours/new.exr", "refs/none.exr", 2);
    assert!(html.contains("not comparable") && html.contains("none.exr"));
    // The files for programs tell it, too.
    let [json, junit] = ["all.json", "all.xml"].map(at);
    let words = ["compare", &at("ours/new.exr"), &at("refs/none.exr")];
    check(
        &[&words[..], &["--json", &json, "--junit", &junit]].concat(),
        2,
        &[],
    );
    let json: Value = serde_json::from_slice(&fs::read(json).unwrap()).unwrap();
    assert_eq!(json["status"], "error");
    assert!(json["problems"][0].as_str().unwrap().contains("none.exr"));
    let junit = fs::read_to_string(junit).unwrap();
    assert!(
        junit.contains("<error") && junit.contains("errors=\"1\""),
        "{junit}"
    );
}

#[test]
fn edges_are_left_out_of_the_interior() {
    let folder = tempfile::tempdir().unwrap();
    let plain = put(folder.path(), "plain.exr", &wall(|_, _| 0.0));
    let edge = put(
        folder.path(),
        "edge.exr",
        &wall(|x, _| if x == 8 { 0.1 } else { 0.0 }),
    );
    let inside = put(
        folder.path(),
        "inside.exr",
        &wall(|x, _| if x == 10 { 0.1 } else { 0.0 }),
    );
    let limit = ["--max-rel-rmse-interior", "1e-6"];
    let with = |image: &str, extra: &[&str]| {
        let fixed = ["compare", image, &plain];
        [&fixed[..], &limit, extra]
            .concat()
            .iter()
            .map(ToString::to_string)
            .collect::<Vec<String>>()
    };
    let check = |arguments: Vec<String>, code, parts: &[&str]| {
        check(
            &arguments.iter().map(String::as_str).collect::<Vec<_>>(),
            code,
            parts,
        )
    };
    check(with(&edge, &[]), 1, &["no pixel excluded"]);
    check(
        with(&edge, &["--edges-of", "shape_id.I"]),
        0,
        &["32 pixels at edges excluded"],
    );
    check(
        with(&inside, &["--edges-of", "shape_id.I"]),
        1,
        &["rel_rmse_interior"],
    );
    check(
        with(&edge, &["--edges-of", "R=0.3"]),
        0,
        &["32 pixels at edges excluded"],
    );
    check(with(&edge, &["--edges-of", "R=0"]), 0, &[]);
    check(
        with(&edge, &["--edges-of", "none.I"]),
        2,
        &["no channel `none.I`"],
    );
    check(with(&edge, &["--edges-of", "R"]), 2, &["R=STEP"]);
}

#[test]
fn areas_and_structure_have_limits() {
    let folder = tempfile::tempdir().unwrap();
    let plain = put(folder.path(), "plain.exr", &wall(|_, _| 0.0));
    let hole = |x: usize, y: usize| {
        if (2..5).contains(&x) && (4..6).contains(&y) {
            0.2
        } else {
            0.0
        }
    };
    let spots = |x: usize, y: usize| if x % 5 == 1 && y % 5 == 1 { 0.2 } else { 0.0 };
    let hole = put(folder.path(), "hole.exr", &wall(hole));
    let spots = put(folder.path(), "spots.exr", &wall(spots));
    check(
        &["compare", &hole, &plain, "--max-area", "6"],
        0,
        &["6 pixels within (2, 4) to (4, 5)"],
    );
    check(
        &["compare", &hole, &plain, "--max-area", "5"],
        1,
        &["6 connected pixels"],
    );
    check(
        &["compare", &spots, &plain, "--max-area", "1"],
        0,
        &["pixels over tolerance"],
    );
    check(
        &["compare", &plain, &plain, "--min-ssim", "1"],
        0,
        &["ssim                   1.000000"],
    );
    check(
        &["compare", &hole, &plain, "--min-ssim", "0.99"],
        1,
        &["is below the limit 0.990000"],
    );
    check(
        &["compare", &hole, &plain, "--ssim", "--max-over", "6"],
        0,
        &["ssim"],
    );
}

#[test]
fn noise_explains_what_it_can() {
    let folder = tempfile::tempdir().unwrap();
    let noisy = |fault: f32| {
        let noise = |x: usize, y: usize| ((x * 7 + y * 11) % 5) as f32 * 0.01 - 0.02;
        let mut image = wall(|x, y| noise(x, y) + if (x, y) == (9, 9) { fault } else { 0.0 });
        for channel in ["R", "G", "B"] {
            image
                .add_channel(format!("variance.{channel}"), vec![0.04; 256])
                .unwrap();
        }
        image.add_channel("samples.N", vec![400.0; 256]).unwrap();
        image
    };
    let plain = put(folder.path(), "plain.exr", &wall(|_, _| 0.0));
    let good = put(folder.path(), "good.exr", &noisy(0.0));
    let bad = put(folder.path(), "bad.exr", &noisy(0.2));
    let level = ["--significance", "0.01"];
    for (ours, reference) in [(&good, &plain), (&plain, &good), (&good, &good)] {
        check(
            &[&["compare", ours, reference], &level[..]].concat(),
            0,
            &["not explained by noise 0 pixels"],
        );
    }
    for (ours, reference, test) in [
        (&bad, &plain, "Student's test"),
        (&plain, &bad, "Student's test"),
        (&bad, &good, "Welch's"),
    ] {
        let arguments = [&["compare", ours, reference], &level[..]].concat();
        check(
            &arguments,
            1,
            &["noise does not explain 1 pixel at the level 0.01", test],
        );
    }
    // Without the option it is told and decides nothing.
    check(
        &["compare", &bad, &good, "--max-over", "9"],
        0,
        &["1 pixel at the level 0.01"],
    );
    check(
        &["compare", &plain, &plain, "--significance", "0.01"],
        2,
        &["needs layers variance.R"],
    );
    check(
        &["compare", &good, &plain, "--significance", "1"],
        2,
        &["below 1"],
    );
}

/// A value that a stored reference takes explains a pixel; a mixture of two does not.
#[test]
fn the_values_of_a_reference_explain() {
    let folder = tempfile::tempdir().unwrap();
    let mut reference = wall(|_, _| 0.0);
    for (side, value) in [("min", 0.25), ("max", 1.25)] {
        for channel in ["R", "G", "B"] {
            let layer = (0..256).map(|pixel| if pixel == 8 { value } else { 0.0 });
            reference
                .add_channel(format!("{side}.{channel}"), layer.collect())
                .unwrap();
        }
    }
    let stored = put(folder.path(), "stored.exr", &reference);
    let moved = |at: (usize, usize), by: f32| wall(move |x, y| if (x, y) == at { by } else { 0.0 });
    let at = |name: &str, by: f32| put(folder.path(), name, &moved((8, 0), by));
    let (end, middle) = (at("end.exr", -0.5), at("middle.exr", 0.25));
    let (mixture, far) = (at("mixture.exr", -0.25), at("far.exr", 0.75));
    let other = put(folder.path(), "other.exr", &moved((9, 0), -0.5));
    let explained = ["explained              1 pixel with a value that the reference takes"];
    let between = [
        "ambiguous              1 pixel between values that the reference takes",
        "1 pixels are over tolerance",
    ];
    // Of the range alone, its ends are values.
    let text = check(&["compare", &end, &stored], 0, &explained);
    assert!(!text.contains("min.R") && !text.contains("vacuous"), "{text}");
    for image in [&middle, &mixture] {
        check(&["compare", image, &stored], 1, &between);
    }
    for image in [&far, &other] {
        let text = check(&["compare", image, &stored], 1, &["1 pixels are over tolerance"]);
        assert!(!text.contains("ambiguous"), "{text}");
    }

    // With all values next to it, as `reference` stores them.
    let mut variants = Variants::default();
    for value in [0.25, 1.0, 1.25] {
        variants.add([8, 0], [0.75; 3], [value; 3], [1e-3; 3]);
    }
    put(
        folder.path(),
        "stored.variants.exr",
        &variants.to_image().unwrap(),
    );
    for image in [&end, &middle] {
        check(&["compare", image, &stored], 0, &explained);
    }
    check(&["compare", &mixture, &stored], 1, &between);
    check(
        &["compare", &mixture, &stored, "--max-rel-rmse-interior", "1e-6"],
        1,
        &["no pixel excluded"],
    );
    check(&["compare", &far, &stored], 1, &["1 pixels are over tolerance"]);

    // In a folder it is no image of its own.
    let (ours, references) = (folder.path().join("ours"), folder.path().join("references"));
    put(&ours, "stored.exr", &moved((8, 0), 0.25));
    for name in ["stored.exr", "stored.variants.exr"] {
        fs::create_dir_all(&references).unwrap();
        fs::copy(folder.path().join(name), references.join(name)).unwrap();
    }
    let [ours, references] = [&ours, &references].map(|path| path.to_str().unwrap());
    check(
        &["compare", ours, references],
        0,
        &["1 image: 1 passed, 0 failed, 0 could not be compared"],
    );
    put(
        folder.path(),
        "stored.variants.exr",
        &Image::from_fn(4, 4, |_, _| [0.0; 3]).unwrap(),
    );
    check(
        &["compare", &end, &stored],
        2,
        &["stored.variants.exr: it lacks one"],
    );
    let black = put(
        folder.path(),
        "black.exr",
        &Image::from_fn(4, 4, |_, _| [0.0; 3]).unwrap(),
    );
    check(&["compare", &black, &black], 0, &["each image shows one colour"]);
}

/// The limits of idiff, with one hyphen, on floats and on codes; warnings do not fail.
#[test]
fn limits_of_idiff_have_its_meaning() {
    let folder = tempfile::tempdir().unwrap();
    let reference = put(folder.path(), "reference.exr", &wall(|_, _| 0.0));
    // 4 of 256 pixels, 1.5625 %, differ by 0.01, one of them by 0.5.
    let change = |x: usize, y: usize| match (x, y) {
        (2, 2) => 0.5,
        (3..6, 2) => 0.01,
        _ => 0.0,
    };
    let ours = put(folder.path(), "ours.exr", &wall(change));
    let with = |extra: &[&'static str], code: i32, parts: &[&str]| {
        check(&[&["compare", &ours, &reference], extra].concat(), code, parts)
    };
    with(&["-fail", "0.6"], 0, &["pass"]);
    with(
        &["-fail", "0.001"],
        1,
        &["4 of 256 pixels, 1.5625 %, differ by more than 0.001; the limit is 0 %"],
    );
    with(&["-fail", "0.001", "-failpercent", "1.6"], 0, &["pass"]);
    with(
        &["-failpercent", "1.6", "-hardfail", "0.4"],
        1,
        &["a pixel differs by 0.500000; the limit is 0.4"],
    );
    with(
        &["-fail", "0.6", "-warn", "0.1", "-warnpercent", "0.1"],
        0,
        &["WARNING: 1 of 256 pixels", "pass"],
    );
    // Other limits still count.
    with(&["-fail", "0.6", "--max-over", "0"], 1, &["over tolerance"]);
    with(&["-failpercent", "200"], 2, &["from 0 to 100"]);

    let picture = |name: &str, code: u8| {
        let path = folder.path().join(name);
        let raster = Raster::from_fn(16, 16, |x, _| [if x == 0 { code } else { 100 }; 3]);
        raster.write_png(&path).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let (a, b) = (picture("a.png", 100), picture("b.png", 101));
    check(&["compare", &a, &b, "-fail", "0.004"], 0, &["pass"]);
    check(&["compare", &a, &b, "-fail", "0.0039"], 1, &["16 of 256 pixels"]);
}

/// Every value between those of two images is accepted, and no value outside.
#[test]
fn a_range_of_references_is_accepted() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str, change: f32| put(folder.path(), name, &wall(|_, _| change));
    let (least, most) = (at("min.exr", -0.1), at("max.exr", 0.1));
    let reference = at("reference.exr", 0.0);
    let range = ["--reference-range", least.as_str(), most.as_str()];
    let with = |ours: &str, range: &[&str], code, parts: &[&str]| {
        check(&[&["compare", ours, &reference], range].concat(), code, parts)
    };
    let inside = at("inside.exr", 0.09);
    with(&inside, &[], 1, &["over tolerance"]);
    with(&inside, &range, 0, &["pass"]);
    with(
        &at("outside.exr", 0.11),
        &range,
        1,
        &["256 pixels are over tolerance"],
    );
    with(&at("nan.exr", f32::NAN), &range, 1, &["not finite"]);
    let swapped = ["--reference-range", most.as_str(), least.as_str()];
    with(&inside, &swapped, 2, &["is not above", "pixel (0, 0)"]);
    let small = folder.path().join("small.exr");
    exr_io::write(&small, &Image::from_fn(2, 2, |_, _| [1.0; 3]).unwrap()).unwrap();
    let other_size = ["--reference-range", least.as_str(), small.to_str().unwrap()];
    with(
        &inside,
        &other_size,
        2,
        &["of the size and kind of the reference"],
    );
    with(&inside, &["--reference-range", &least, "no.exr"], 2, &["no.exr"]);
}

/// Accepting writes the reference and nothing else, and only where the images differ.
#[test]
fn images_are_accepted_where_told() {
    let folder = tempfile::tempdir().unwrap();
    let (good, other) = (wall(|_, _| 0.0), wall(|x, _| 0.01 * x as f32));
    let ours = put(folder.path(), "ours.exr", &other);
    let reference = put(folder.path(), "reference.exr", &good);
    let accept = |ours: &str, reference: &str, code, parts: &[&str]| {
        check(&["compare", ours, reference, "--accept"], code, parts)
    };
    check(&["compare", &ours, &reference], 1, &[]);
    accept(&ours, &reference, 0, &["DIFFERS", "accepted: "]);
    assert_eq!(fs::read(&ours).unwrap(), fs::read(&reference).unwrap());
    assert!(!accept(&ours, &reference, 0, &["pass"]).contains("accepted"));
    // One that does not exist yet, in a folder that does not exist yet.
    let new = folder.path().join("new/er.exr").to_str().unwrap().to_owned();
    accept(&ours, &new, 0, &["not comparable", "accepted: "]);
    check(&["compare", &ours, &new], 0, &[]);
    // What is no reference is not accepted.
    let before = fs::read(&reference).unwrap();
    let broken = put(folder.path(), "broken.exr", &wall(|_, _| f32::NAN));
    accept(
        &broken,
        &reference,
        2,
        &["is not accepted: it has 768 values that are not finite"],
    );
    fs::write(folder.path().join("damaged.exr"), "no image").unwrap();
    let damaged = folder.path().join("damaged.exr").to_str().unwrap().to_owned();
    accept(&damaged, &reference, 2, &["damaged.exr"]);
    accept(&ours, "reference.png", 2, &["has another extension"]);
    assert_eq!(fs::read(&reference).unwrap(), before);
    assert!(!root().join("reference.png").exists());
    // Stored references record their variation, and belong to `validate`.
    let stored = root().join("references/images/shapes/sphere/mitsuba.exr");
    let kept = fs::read(&stored).unwrap();
    accept(
        &ours,
        stored.to_str().unwrap(),
        2,
        &["is a stored reference of `validate`"],
    );
    assert_eq!(fs::read(&stored).unwrap(), kept);

    // Of folders, each image on its own.
    for (name, image) in [
        ("ours/same.exr", &good),
        ("refs/same.exr", &good),
        ("ours/deep/other.exr", &other),
        ("refs/deep/other.exr", &good),
        ("ours/new/one.exr", &other),
        ("refs/only.exr", &good),
    ] {
        put(folder.path(), name, image);
    }
    let at = |name: &str| folder.path().join(name);
    let both = [at("ours"), at("refs")].map(|path| path.to_str().unwrap().to_owned());
    let only = fs::read(at("refs/only.exr")).unwrap();
    accept(
        &both[0],
        &both[1],
        2,
        &[
            "ACCEPT deep/other.exr",
            "ACCEPT new/one.exr",
            "ERROR  only.exr",
            "1 passed, 0 failed, 1 could not be compared, 2 accepted",
        ],
    );
    assert_eq!(fs::read(at("refs/only.exr")).unwrap(), only);
    fs::remove_file(at("refs/only.exr")).unwrap();
    check(&["compare", &both[0], &both[1]], 0, &["3 passed"]);
    let stray = fs::read_dir(at("refs")).unwrap().count();
    assert_eq!(stray, 3, "deep, new, same.exr");
}
