//! The commands as users call them: what they print, what they write, how they end.

use serde_json::Value;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};
use whitstone::image::{Image, exr_io};
use whitstone_tests::{program, root, scenes};

fn run(arguments: &[&str]) -> Output {
    program!().current_dir(root()).args(arguments).output().unwrap()
}

fn code(output: &Output) -> Option<i32> {
    output.status.code()
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// An image of 8 x 6 pixels of grey 1, but for those that are given.
fn image(folder: &Path, name: &str, others: &[(usize, usize, f32)]) -> String {
    let value = |x, y| {
        others
            .iter()
            .find(|other| (other.0, other.1) == (x, y))
            .map_or(1.0, |other| other.2)
    };
    let image = Image::from_fn(8, 6, |x, y| [value(x, y); 3]).unwrap();
    let path = folder.join(name);
    exr_io::write(&path, &image).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn compare_tells_equal_from_different() {
    let folder = tempfile::tempdir().unwrap();
    let plain = image(folder.path(), "plain.exr", &[]);
    let other = image(folder.path(), "other.exr", &[(3, 2, 1.5)]);
    let (report, picture) = (folder.path().join("report.json"), folder.path().join("trio.png"));
    let extra = [
        "--json",
        report.to_str().unwrap(),
        "--png",
        picture.to_str().unwrap(),
    ];

    let output = run(&[&["compare", &plain, &plain], &extra[..]].concat());
    assert_eq!(code(&output), Some(0), "{}", stderr(&output));
    assert!(stdout(&output).ends_with("pass\n"));
    assert_eq!(json(&report)["metrics"]["rmse"], 0.0);

    let output = run(&[&["compare", &other, &plain], &extra[..]].concat());
    assert_eq!(code(&output), Some(1));
    assert!(stdout(&output).contains("pixel (3, 2): ours [1.5, 1.5, 1.5], reference [1.0, 1.0, 1.0]"));
    let report = json(&report);
    assert_eq!(
        (&report["status"], &report["pixels_over_tolerance"]),
        (&Value::from("fail"), &Value::from(1))
    );
    assert_eq!(
        (&report["worst"][0]["x"], &report["worst"][0]["y"]),
        (&Value::from(3), &Value::from(2))
    );
    assert_eq!(fs::read(picture).unwrap()[..4], *b"\x89PNG");
}

#[test]
fn compare_keeps_to_the_limits_given() {
    let folder = tempfile::tempdir().unwrap();
    let plain = image(folder.path(), "plain.exr", &[]);
    let other = image(folder.path(), "other.exr", &[(3, 2, 1.5)]);
    // One pixel of 48 differs by 0.5: the root mean square is 0.0722, half of it relative.
    for (limits, expected) in [
        (&["--max-over", "1"][..], 0),
        (&["--max-over", "0"], 1),
        (&["--max-rmse", "0.073"], 0),
        (&["--max-rmse", "0.072"], 1),
        (&["--max-rmse", "0.073", "--max-over", "0"], 1),
        (&["--max-rel-rmse-interior", "0.0361"], 0),
        (&["--max-rel-rmse-interior", "0.036"], 1),
        (&["--relative", "0.5"], 0),
        (&["--max-rmse", "nan"], 2),
        (&["--max-rmse", "-1"], 2),
        (&["--relative", "inf"], 2),
    ] {
        let output = run(&[&["compare", &other, &plain], limits].concat());
        assert_eq!(
            code(&output),
            Some(expected),
            "{limits:?}: {}{}",
            stdout(&output),
            stderr(&output)
        );
    }
}

#[test]
fn compare_counts_what_is_not_finite_first() {
    let folder = tempfile::tempdir().unwrap();
    let plain = image(folder.path(), "plain.exr", &[]);
    let bad = image(
        folder.path(),
        "bad.exr",
        &[(0, 0, f32::NAN), (7, 5, f32::INFINITY)],
    );
    let report = folder.path().join("report.json");
    for (pair, ours) in [([&bad, &plain], 6), ([&plain, &bad], 0)] {
        let output = run(&[
            "compare",
            pair[0],
            pair[1],
            "--max-rmse",
            "1e9",
            "--json",
            report.to_str().unwrap(),
        ]);
        assert_eq!(code(&output), Some(1));
        assert!(
            stdout(&output).contains("not finite: 6 values"),
            "{}",
            stdout(&output)
        );
        assert_eq!(json(&report)["nonfinite"]["ours"], ours);
        assert_eq!(json(&report)["metrics"], Value::Null);
    }
}

#[test]
fn compare_refuses_what_cannot_be_compared() {
    let folder = tempfile::tempdir().unwrap();
    let plain = image(folder.path(), "plain.exr", &[]);
    let put = |name: &str, image: &Image| {
        let path = folder.path().join(name);
        exr_io::write(&path, image).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let large = put("large.exr", &Image::from_fn(8, 7, |_, _| [1.0; 3]).unwrap());
    let mut depth = Image::new(8, 6).unwrap();
    depth.add_channel("depth.Z", vec![0.0; 48]).unwrap();
    let depth = put("depth.exr", &depth);
    let cut = folder.path().join("cut.exr");
    let bytes = fs::read(&plain).unwrap();
    fs::write(&cut, &bytes[..bytes.len() - 9]).unwrap();
    let cut = cut.to_str().unwrap();
    for (other, expected) in [
        (large.as_str(), "8 x 6"),
        (&depth, "channel"),
        (cut, "cut.exr"),
        ("none.exr", "none.exr"),
        ("scenes", "scenes"),
        ("Cargo.toml", "not an EXR, PNG"),
    ] {
        for pair in [[plain.as_str(), other], [other, plain.as_str()]] {
            let output = run(&["compare", pair[0], pair[1]]);
            assert_eq!(code(&output), Some(2), "{pair:?}: {}", stderr(&output));
            assert!(
                stderr(&output).contains(expected),
                "{pair:?}: {}",
                stderr(&output)
            );
        }
    }
}

#[test]
fn list_has_every_plugin_with_its_summary() {
    let registry = whitstone::registry();
    let (text, list) = (stdout(&run(&["list"])), stdout(&run(&["list", "--json"])));
    let list: Value = serde_json::from_str(&list).unwrap();
    let list = list.as_array().unwrap();
    // And the word that leaves the choice to the program, as a scene may have it.
    let auto = list.iter().filter(|item| item["type"] == "auto").count();
    assert_eq!((list.len(), auto), (registry.entries().count() + 1, 1));
    let accelerators = stdout(&run(&["list", "accelerators"]));
    assert!(accelerators.contains("\n  auto "), "{accelerators}");
    assert!(!stdout(&run(&["list", "shapes"])).contains("auto"));
    for entry in registry.entries() {
        assert!(!entry.summary().is_empty(), "{} has no summary", entry.name);
        assert!(text.contains(&entry.summary()), "{}", entry.name);
        let item = list
            .iter()
            .find(|item| item["type"] == entry.name && item["crate"] == entry.crate_name)
            .unwrap_or_else(|| panic!("{} is not listed", entry.name));
        let example = item["example"].as_str().unwrap_or_default();
        let laws = item["laws"].as_array().map_or(0, Vec::len);
        assert!(
            item["twin"].is_string() && laws > 0 && root().join(example).is_file(),
            "{item:#}: run `cargo xtask readme`"
        );
    }
    for name in ["shapes", "shape", "SHAPES"] {
        let text = stdout(&run(&["list", name]));
        assert!(text.contains("sphere") && !text.contains("perspective"), "{text}");
    }
    let output = run(&["list", "shaeps"]);
    assert_eq!(code(&output), Some(2));
    assert!(
        stderr(&output).contains("did you mean \"shapes\"?"),
        "{}",
        stderr(&output)
    );
}

/// A scene as the editors' validators see it.
fn as_json(path: &Path) -> Value {
    let table: toml::Table = fs::read_to_string(path).unwrap().parse().unwrap();
    serde_json::to_value(table).unwrap()
}

#[test]
fn the_schema_accepts_every_scene() {
    let schema: Value = serde_json::from_str(&stdout(&run(&["schema"]))).unwrap();
    jsonschema::meta::validate(&schema).unwrap();
    let validator = jsonschema::validator_for(&schema).unwrap();
    for path in scenes() {
        let scene = as_json(&path);
        let errors: Vec<String> = validator
            .iter_errors(&scene)
            .map(|error| format!("{error} at {}", error.instance_path()))
            .collect();
        assert!(errors.is_empty(), "{}: {}", path.display(), errors.join("\n"));
    }
}

#[test]
fn the_schema_refuses_what_can_be_seen_without_the_rest_of_the_scene() {
    let schema: Value = serde_json::from_str(&stdout(&run(&["schema"]))).unwrap();
    let validator = jsonschema::validator_for(&schema).unwrap();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("bad");
    for name in [
        "camera_axis",
        "camera_fov_0",
        "camera_fov_180",
        "camera_orthographic_width",
        "camera_window_distance",
        "expect",
        "film_2_to_31",
        "film_layers",
        "film_layers_twice",
        "film_zero",
        "missing_keys",
        "unknown_inline_type",
        "unknown_key",
        "unknown_table",
        "unknown_type",
        "wrong_tables",
        "wrong_types",
    ] {
        let scene = as_json(&folder.join(format!("{name}.toml")));
        assert!(!validator.is_valid(&scene), "{name}");
    }
}

#[test]
fn the_schema_of_one_plugin() {
    let schema: Value = serde_json::from_str(&stdout(&run(&["schema", "shapes", "sphere"]))).unwrap();
    assert!(schema["properties"]["radius"].is_object(), "{schema}");
    assert_eq!(schema["title"], "sphere");
    jsonschema::meta::validate(&schema).unwrap();
    let validator = jsonschema::validator_for(&schema).unwrap();
    for (table, good) in [
        (
            "type = 'sphere'\nid = 'ball'\nmaterial = 'glass'\ntransform = { scale = 2 }",
            true,
        ),
        (
            "type = 'sphere'\nmaterial = { type = 'mirror' }\ntransform = [{ translate = [1, 2, 3] }]",
            true,
        ),
        ("type = 'sphere'\ntransform = { scal = 2 }", false),
        ("type = 'sphere'\nradius = -1", false),
        ("type = 'plane'", false),
        ("radius = 1", false),
    ] {
        let table: toml::Table = table.parse().unwrap();
        let table = serde_json::to_value(table).unwrap();
        assert_eq!(validator.is_valid(&table), good, "{table}");
    }
    // Of every plugin, without references to what is not there.
    for entry in whitstone::registry().entries() {
        let text = stdout(&run(&["schema", entry.family.singular(), entry.name]));
        let schema: Value = serde_json::from_str(&text).unwrap();
        jsonschema::validator_for(&schema).unwrap_or_else(|error| panic!("{}: {error}", entry.name));
    }
    for (arguments, expected) in [
        (&["schema", "shape", "shpere"][..], "did you mean \"sphere\"?"),
        (&["schema", "shope", "sphere"], "did you mean \"shape"),
        (&["schema", "shape"], "expected a TYPE after shape: one of "),
        (&["schema", "foo"], "unknown family \"foo\""),
        (&["schema", "shaep"], "did you mean \"shape"),
    ] {
        let output = run(arguments);
        assert_eq!(code(&output), Some(2), "{arguments:?}");
        assert!(
            stderr(&output).contains(expected),
            "{arguments:?}: {}",
            stderr(&output)
        );
    }
}

#[test]
fn explain_says_what_is_built_and_follows_a_pixel() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("explain.json");
    let scene = "scenes/showcase/classic.toml";
    let small = ["--set", "film.width=40", "--set", "film.height=40"];
    let written = ["--json", path.to_str().unwrap()];
    let output = run(&[
        &["explain", scene, "--pixel", "20,20", "--reference", "none"],
        &small[..],
        &written[..],
    ]
    .concat());
    assert_eq!(code(&output), Some(0), "{}", stderr(&output));
    let text = stdout(&output);
    for expected in ["accelerator", "omitted", "pixel (20, 20)", "camera ray: "] {
        assert!(text.contains(expected), "no {expected} in\n{text}");
    }
    // The pixel is what its rays add, each by its throughput: also at the depth limit, in absorbing
    // media, and where no branch is followed.
    let nested = "scenes/showcase/nested_dielectrics.toml";
    for (scene, change, limits) in [
        (
            scene,
            "integrator={type=\"whitted\",min_contribution=0.01}",
            false,
        ),
        (scene, "integrator.max_depth=0", true),
        (scene, "integrator={type=\"appel\"}", false),
        (nested, "integrator.max_depth=2", true),
    ] {
        let arguments = [
            "explain",
            scene,
            "--pixel",
            "27,22",
            "--reference",
            "none",
            "--set",
            change,
        ];
        let output = run(&[&arguments[..], &small[..], &written[..]].concat());
        assert_eq!(code(&output), Some(0), "{}", stderr(&output));
        let report = json(&path);
        let rays = report["pixel"]["rays"].as_array().unwrap();
        let value = report["pixel"]["value"][0].as_f64().unwrap();
        let sum: f64 = rays
            .iter()
            .map(|ray| ray["throughput"][0].as_f64().unwrap() * ray["local"][0].as_f64().unwrap())
            .sum();
        assert!(
            (value - sum).abs() <= 1e-12 * value.abs(),
            "{scene}: {value} is not {sum}"
        );
        let found = rays.iter().any(|ray| ray["limit"] == true);
        assert_eq!(found, limits, "{scene}, {change}");
    }
    for (pixel, sample) in [
        ("40,0", "0"),
        ("0,40", "0"),
        ("0,0", "1"),
        ("x,0", "0"),
        ("1", "0"),
        ("-1,0", "0"),
    ] {
        let arguments = ["explain", scene, "--sample", sample, &format!("--pixel={pixel}")];
        let output = run(&[&arguments[..], &small[..]].concat());
        assert_eq!(code(&output), Some(2), "{pixel} {sample}: {}", stdout(&output));
    }
}

/// What a scene makes run, with memory and work: a part appears where the scene needs it, and its
/// numbers are right.
#[test]
fn explain_tells_what_each_part_takes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("explain.json");
    let costs = |scene: &str| {
        let sets = [
            "--set",
            "film={width=20,height=10,aovs=[\"depth\"]}",
            "--json",
            path.to_str().unwrap(),
        ];
        let output = run(&[&["explain", scene], &sets[..]].concat());
        assert_eq!(code(&output), Some(0), "{}", stderr(&output));
        assert!(stdout(&output).contains("costs: bytes"), "{}", stdout(&output));
        json(&path)
    };
    let part = |report: &Value, name: &str| {
        let all = report["costs"].as_array().unwrap();
        all.iter().find(|cost| cost["part"] == name).cloned()
    };
    let plain = costs("scenes/shapes/disk.toml");
    let film = part(&plain, "film").unwrap();
    assert_eq!(film["bytes"], 20 * 10 * 4 * 4);
    assert!(
        film["work"].as_str().unwrap().starts_with("200 camera rays"),
        "{film}"
    );
    assert!(
        part(&plain, "accelerator").unwrap()["work"]
            .as_str()
            .unwrap()
            .contains("brute_force")
    );
    assert!(part(&plain, "meshes").is_none() && part(&plain, "reflected and refracted rays").is_none());
    let mesh = costs("scenes/showcase/textured_mesh.toml");
    assert!(part(&mesh, "meshes").unwrap()["bytes"].as_u64() > Some(1000));
    // 32 x 32 texels of 3 bytes, and what their codes mean.
    assert_eq!(
        part(&mesh, "textures").unwrap()["bytes"],
        32 * 32 * 3 + 256 * size_of::<f64>()
    );
    assert!(part(&mesh, "texture levels").is_none() && part(&mesh, "footprints of rays").is_none());
    assert!(
        part(&mesh, "textures").unwrap()["work"]
            .as_str()
            .unwrap()
            .contains("image")
    );
    let sum: u64 = mesh["costs"]
        .as_array()
        .unwrap()
        .iter()
        .filter_map(|cost| cost["bytes"].as_u64())
        .sum();
    assert_eq!(mesh["bytes_estimated"], sum);
    let glass = costs("scenes/showcase/classic.toml");
    let branches = part(&glass, "reflected and refracted rays").unwrap();
    assert!(
        branches["work"].as_str().unwrap().starts_with("up to 2"),
        "{branches}"
    );
    let shadows = part(&glass, "shadow rays").unwrap();
    assert!(
        shadows["work"].as_str().unwrap().starts_with("about 1 "),
        "{shadows}"
    );
}

#[test]
fn an_exposure_is_a_number() {
    for exposure in ["nan", "inf", "x"] {
        let output = run(&[
            "render",
            "scenes/showcase/classic.toml",
            "--exposure",
            exposure,
            "-o",
            "/dev/null/a.png",
        ]);
        assert_eq!(code(&output), Some(2), "{exposure}: {}", stderr(&output));
        assert!(stderr(&output).contains("number"), "{}", stderr(&output));
    }
}

/// Renders the classic scene at 12 x 8 pixels to `picture.png` in the folder, and returns the PNG
/// and the output.
fn pictured(folder: &Path, arguments: &[&str]) -> (Vec<u8>, Output) {
    let path = folder.join("picture.png");
    let output = program!()
        .current_dir(root())
        .env_remove("NO_COLOR")
        .args([
            "render",
            "scenes/showcase/classic.toml",
            "--set",
            "film={width=12,height=8}",
            "-o",
        ])
        .arg(&path)
        .args(arguments)
        .output()
        .unwrap();
    assert_eq!(code(&output), Some(0), "{arguments:?}: {}", stderr(&output));
    (fs::read(path).unwrap(), output)
}

#[test]
fn pictures_have_exposure_tone_curve_and_quality() {
    let folder = tempfile::tempdir().unwrap();
    let pixels = |arguments: &[&str]| pictured(folder.path(), arguments).0;
    let plain = pixels(&[]);
    assert_eq!(plain, pixels(&["--exposure", "0", "--tone-map", "clamp"]));
    let variants = [
        pixels(&["--exposure", "-1.5"]),
        pixels(&["--tone-map", "filmic"]),
        pixels(&["--quality", "good"]),
    ];
    for (k, variant) in variants.iter().enumerate() {
        assert!(
            !variants[..k].contains(variant) && *variant != plain,
            "variant {k}"
        );
    }
    // Each quality is the sampler that its help names, and --set changes that sampler.
    for (quality, sampler) in [
        ("draft", r#"sampler={type="center"}"#),
        ("good", r#"sampler={type="adaptive",samples=64,threshold=0.02}"#),
        (
            "best",
            r#"sampler={type="adaptive",samples=1024,initial_samples=16,threshold=0.005}"#,
        ),
    ] {
        let help = stdout(&run(&["render", "--help"]))
            .split_whitespace()
            .collect::<String>();
        assert!(
            help.contains(&sampler["sampler={".len()..sampler.len() - 1]),
            "{quality}: {help}"
        );
        assert_eq!(
            pixels(&["--quality", quality]),
            pixels(&["--set", sampler]),
            "{quality}"
        );
    }
    let few = ["--quality", "good", "--set", "sampler.samples=8"];
    assert_eq!(
        pixels(&few),
        pixels(&["--set", r#"sampler={type="adaptive",samples=8,threshold=0.02}"#])
    );
    for (arguments, expected) in [
        (["--quality", "goood"], "draft, good, best"),
        (["--tone-map", "reinhard"], "clamp, filmic"),
    ] {
        let output = run(&[&["render", "scenes/showcase/classic.toml"][..], &arguments].concat());
        assert_eq!(code(&output), Some(2));
        assert!(stderr(&output).contains(expected), "{}", stderr(&output));
    }
}

#[test]
fn a_preview_draws_the_pixels_of_the_png_file() {
    let folder = tempfile::tempdir().unwrap();
    let (png, output) = pictured(folder.path(), &["--preview", "--exposure", "0.5", "--json", "-"]);
    // With `--json -` standard output is for the JSON alone.
    assert!(serde_json::from_slice::<Value>(&output.stdout).is_ok());
    let picture = whitstone::image::picture::decode(&png, whitstone::image::Limits::IMAGE).unwrap();
    let planes = picture.image.rgb().unwrap();
    let code_at = |x: usize, y: usize| {
        let codes = planes.map(|plane| (plane[y * 12 + x] * 255.0).round().to_string());
        codes.join(";")
    };
    let drawn = stderr(&output);
    let lines: Vec<&str> = drawn.lines().filter(|line| line.contains('▀')).collect();
    assert_eq!(lines.len(), 4);
    for (k, line) in lines.iter().enumerate() {
        let cells: Vec<&str> = line.split('▀').collect();
        assert_eq!((cells.len(), cells[12]), (13, "\u{1b}[0m"));
        for (x, cell) in cells[..12].iter().enumerate() {
            let expected = format!(
                "\u{1b}[38;2;{};48;2;{}m",
                code_at(x, 2 * k),
                code_at(x, 2 * k + 1)
            );
            assert_eq!(*cell, expected);
        }
    }
    let output = program!()
        .current_dir(root())
        .env("NO_COLOR", "1")
        .args(["render", "scenes/showcase/classic.toml", "--preview"])
        .output()
        .unwrap();
    assert_eq!(code(&output), Some(2));
    assert!(stderr(&output).contains("NO_COLOR"), "{}", stderr(&output));
}

#[test]
fn an_option_without_effect_is_an_error() {
    let classic = "scenes/showcase/classic.toml";
    for (arguments, named) in [
        (vec!["render", classic, "--exposure", "1"], "--png"),
        (vec!["render", classic, "--tone-map", "filmic"], "--png"),
        (vec!["render", classic, "--tile-size", "8"], "--cluster"),
        (vec!["render", classic, "--workers", "2"], "--cluster"),
        (vec!["explain", classic, "--max-rays", "3"], "--pixel"),
        (
            vec!["validate", classic, "--reference", "stored", "--fresh"],
            "--fresh",
        ),
        (
            vec!["validate", classic, "--no-oracle", "--oracle-time", "3"],
            "--no-oracle",
        ),
    ] {
        let output = run(&arguments);
        assert_eq!(code(&output), Some(2), "{arguments:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(named), "{}", stderr(&output));
    }
}

#[test]
fn completions_and_help_for_every_command() {
    // In a debug build this also runs all checks that clap has for a command line.
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let output = run(&["completions", shell]);
        assert_eq!(code(&output), Some(0), "{}", stderr(&output));
        assert!(stdout(&output).contains("validate"), "{shell}");
    }
    let help = stdout(&run(&["--help"]));
    for command in [
        "render",
        "plan",
        "run-job",
        "merge",
        "explain",
        "compare",
        "validate",
        "list",
        "schema",
        "doctor",
        "completions",
    ] {
        assert!(
            help.contains(&format!("\n  {command} ")),
            "{command} is not in\n{help}"
        );
        let output = run(&[command, "--help"]);
        assert_eq!(code(&output), Some(0), "{command}");
    }
    for command in ["explain", "compare", "list", "schema", "doctor", "completions"] {
        assert!(
            stdout(&run(&[command, "--help"])).contains("Example"),
            "{command}"
        );
    }
    assert_eq!(code(&run(&["teapot"])), Some(2));
    assert_eq!(code(&run(&[])), Some(2));
}

#[test]
fn a_closed_pipe_is_no_panic() {
    for arguments in [
        &["list"][..],
        &["schema"],
        &["completions", "bash"],
        &["explain", "scenes/showcase/classic.toml"],
    ] {
        let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_whitstone-under-test"))
            .current_dir(root())
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        drop(child.stdout.take());
        let mut said = String::new();
        child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        let status = child.wait().unwrap();
        assert!(!said.contains("panicked"), "{arguments:?}: {said}");
        assert_eq!(status.code(), Some(0), "{arguments:?}: {said}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_behind_standard_output_is_told() {
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_whitstone-under-test"))
        .arg("list")
        .stdout(full)
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(3));
    assert!(stderr(&output).contains("standard output"), "{}", stderr(&output));
}

/// A picture that takes some tenths of a second to make is made once; what is kept is not trusted,
/// and belongs to the sample.
#[test]
fn what_took_long_to_make_is_kept_between_runs() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let sample = |changed: bool| {
        let code = |x: usize, y: usize| ((7 * x * y + 31 * x + 17 * y) % 251) as u8;
        let texel = |x, y| [code(x, y), code(y, x), u8::from(changed && (x, y) == (20, 30))];
        let raster = whitstone::image::Raster::from_fn(48, 48, texel);
        raster.write_png(path("sample.png")).unwrap();
    };
    sample(false);
    let scene = "[film]\nwidth = 40\nheight = 30\n[camera]\ntype = \"perspective\"\nlook_at = { origin = [0, 0, 3], target = [0, 0, 0] }\n\
        [[light]]\ntype = \"ambient\"\nradiance = 1\n[[shape]]\ntype = \"rectangle\"\n[shape.material]\ntype = \"matte\"\n\
        reflectance = { type = \"synthesized\", file = \"sample.png\", size = [256, 256], block = 24, optimize = { iterations = 1 } }\n";
    fs::write(path("a.toml"), scene).unwrap();
    let render = |arguments: &[&str]| {
        let output = program!()
            .current_dir(folder.path())
            .args(["render", "a.toml", "--target", "here"])
            .args(arguments)
            .output()
            .unwrap();
        assert_eq!(code(&output), Some(0), "{}", stderr(&output));
        exr_io::read(path("a.exr"), whitstone::image::Limits::IMAGE).unwrap()
    };
    let kept = || -> Vec<PathBuf> {
        let files = fs::read_dir(path("here/kept")).unwrap();
        files.map(|file| file.unwrap().path()).collect()
    };
    let first = render(&[]);
    let [file] = &kept()[..] else {
        panic!("one file: {:?}", kept());
    };
    let whole = fs::read(file).unwrap();
    assert_eq!(whole.len(), 32 + 3 * 256 * 256);
    // That it is read is seen by a picture with another one in it, whose hash is right.
    let grey = vec![128; 3 * 256 * 256];
    let forged = [blake3::hash(&grey).as_bytes().as_slice(), &grey].concat();
    fs::write(file, &forged).unwrap();
    assert!(render(&[]).rgb().unwrap() != first.rgb().unwrap());
    assert!(render(&["--fresh"]).rgb().unwrap() == first.rgb().unwrap());
    assert_eq!(fs::read(file).unwrap(), whole);
    for broken in [&whole[..50], b"", &[&whole[..99], b"?", &whole[100..]].concat()] {
        fs::write(file, broken).unwrap();
        assert!(render(&[]).rgb().unwrap() == first.rgb().unwrap());
        assert_eq!(fs::read(file).unwrap(), whole);
    }
    // Other settings, or a bit of the sample, make other pictures.
    render(&["--set", "shape.0.material.reflectance.seed=1"]);
    assert_eq!(kept().len(), 2);
    sample(true);
    render(&[]);
    assert_eq!(kept().len(), 3);
}

#[test]
fn init_writes_a_project_and_keeps_what_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let whitstone = |arguments: &[&str]| {
        program!()
            .current_dir(folder.path())
            .args(arguments)
            .output()
            .unwrap()
    };
    let output = whitstone(&["init", "images"]);
    assert_eq!(code(&output), Some(0), "{}", stderr(&output));
    let output = whitstone(&["render", "images/scenes/first.toml", "--set", "film.width=16"]);
    assert_eq!(code(&output), Some(0), "{}", stderr(&output));
    // The settings are valid, and what they show becomes so without its comment signs.
    let settings = folder.path().join("images/whitstone.toml");
    let shown = fs::read_to_string(&settings).unwrap();
    let shown: Vec<&str> = shown
        .lines()
        .map(|line| line.trim_start_matches(['#', ' ']))
        .collect();
    let shown = shown.join("\n");
    let table = &shown[shown.find("[subject").unwrap()..];
    let subject = |text: &str| {
        fs::write(&settings, text).unwrap();
        let arguments = ["validate", "scenes/first.toml", "--subject", "mytracer"];
        let folder = folder.path().join("images");
        let output = program!().current_dir(folder).args(arguments).output().unwrap();
        stderr(&output) + &stdout(&output)
    };
    assert!(subject(table).contains("subject: mytracer"), "{}", subject(table));
    assert!(subject("").contains("[subject.mytracer]"), "{}", subject(""));
    let workflow = folder.path().join("images/.github/workflows/images.yml");
    let text = fs::read_to_string(&workflow).unwrap();
    assert!(
        text.contains("whitstone validate scenes") && !text.contains("VERSION"),
        "{text}"
    );
    fs::remove_file(folder.path().join("images/.gitignore")).unwrap();
    let output = whitstone(&["init", "images"]);
    assert_eq!(code(&output), Some(2));
    assert!(stderr(&output).contains("first.toml"), "{}", stderr(&output));
    // Nothing is written, not even the file that is missing.
    assert!(!folder.path().join("images/.gitignore").exists());
}

#[test]
fn the_licences_of_the_program_are_printed() {
    let output = program!().args(["doctor", "--licenses"]).output().unwrap();
    assert_eq!(code(&output), Some(0));
    let text = String::from_utf8_lossy(&output.stdout);
    for name in ["\nexr ", "\nserde ", "Permission is hereby granted"] {
        assert!(text.contains(name), "{name}");
    }
}
