//! `stress --subject`: a conforming renderer has no wrong pixels, planted faults are found at the
//! values at which they show, and what a renderer cannot do is reported.
#![cfg(unix)]

use serde_json::Value;
use std::fs;
use whitstone_tests::program;

const CONFORMING: &str = env!("CARGO_BIN_EXE_whitstone-under-test");
const SMALL: &str = env!("CARGO_BIN_EXE_small-tracer");

/// The exit code, the output and the results for a command and further keys.
fn stress(command: &str, more: &str, families: &[&str]) -> (Option<i32>, String, Value) {
    let folder = tempfile::tempdir().unwrap();
    let text = format!("[subject.tracer]\ncommand = \"{command}\"\n{more}\n");
    fs::write(folder.path().join("whitstone.toml"), text).unwrap();
    let output = program!()
        .current_dir(whitstone_tests::root())
        .arg("stress")
        .args(families)
        .args(["--subject", "tracer", "--config"])
        .arg(folder.path().join("whitstone.toml"))
        .arg("--target")
        .arg(folder.path())
        .arg("--json")
        .arg(folder.path().join("stress.json"))
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&[&output.stdout[..], &output.stderr[..]].concat()).into_owned();
    let json = fs::read_to_string(folder.path().join("stress.json")).unwrap_or_default();
    let results = serde_json::from_str(&json).unwrap_or(Value::Null);
    (output.status.code(), text, results)
}

/// The result of a family.
fn family<'a>(results: &'a Value, name: &str) -> &'a Value {
    let all = results["families"].as_array().unwrap();
    all.iter().find(|report| report["family"] == name).unwrap()
}

#[test]
fn a_conforming_renderer_has_no_wrong_pixels() {
    let names = [
        "sphere_distance",
        "planet",
        "tangent",
        "world_offset",
        "shrunk_scene",
        "shadow_gap",
        "near_lamp",
        "cone_apex",
        "watertight",
        "index_near_one",
        "direction_length",
    ];
    let command = format!("{CONFORMING} render {{scene}} -o {{output}}");
    let (code, text, results) = stress(&command, "", &names);
    assert_eq!(code, Some(0), "{text}");
    assert!(
        text.contains("families: 9 rendered, 2 skipped; tracer: 0 with wrong pixels"),
        "{text}"
    );
    assert!(
        text.contains("skipped: its answers are numbers that no image shows"),
        "{text}"
    );
    assert!(text.contains("skipped: no small image shows its rays"), "{text}");
    for name in &names[..9] {
        let report = family(&results, name);
        let steps = report["steps"].as_array().unwrap();
        // The easy steps are decided, and have something to see.
        assert!(steps.len() >= 4, "{name}: {report}");
        assert!(
            steps[0]["subject"]["right"].as_u64() > Some(24),
            "{name}: {report}"
        );
        assert_eq!(report["whitstone_wrong_at"], Value::Null, "{name}: {report}");
    }
    // The sweep ends where Whitstone promises nothing any more.
    let last = |name: &str| {
        let steps = family(&results, name)["steps"].as_array().unwrap();
        steps[steps.len() - 1]["parameter"].as_f64().unwrap()
    };
    assert!(last("shadow_gap") >= 1e-13 && last("planet") <= 1e8, "{text}");
}

/// One that rounds the scene and its points to single precision is right, or excused.
#[test]
fn single_precision_is_excused() {
    let names = ["planet", "tangent", "world_offset", "shadow_gap", "near_lamp"];
    let command = format!("{SMALL} {{scene}} {{output}} single");
    let (code, text, results) = stress(&command, "output = \"pfm\"", &names);
    assert_eq!(code, Some(0), "{text}");
    let excused = |name: &str| {
        let steps = family(&results, name)["steps"].as_array().unwrap();
        let each = steps
            .iter()
            .map(|step| step["subject"]["excused"].as_u64().unwrap());
        each.sum::<u64>()
    };
    // Its lamp moves by a part of its height.
    assert!(excused("near_lamp") > 0, "{text}");
}

/// A fixed offset of shadow rays is found at the same value as that of the naive variant.
#[test]
fn a_fixed_offset_is_found_where_the_naive_variant_breaks() {
    let command = format!("{SMALL} {{scene}} {{output}} small-bias");
    let (code, text, results) = stress(&command, "output = \"pfm\"", &["shadow_gap"]);
    assert_eq!(code, Some(1), "{text}");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("naive.json");
    let output = program!()
        .current_dir(whitstone_tests::root())
        .args(["stress", "shadow_gap", "--no-mitsuba", "--quick", "--target"])
        .arg(folder.path())
        .arg("--json")
        .arg(&file)
        .output()
        .unwrap();
    let naive: Value = serde_json::from_slice(&fs::read(file).unwrap_or_default())
        .unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&output.stderr)));
    let engines = family(&naive, "shadow_gap")["engines"]
        .as_array()
        .unwrap()
        .clone();
    let single = engines
        .iter()
        .find(|engine| engine["engine"] == "naive f32")
        .unwrap();
    let frontier = single["frontier"].as_f64().unwrap();
    assert_eq!(
        family(&results, "shadow_gap")["wrong_at"].as_f64(),
        Some(frontier),
        "{text}"
    );
}

#[test]
fn planted_faults_are_found_where_they_show() {
    let names = ["shrunk_scene", "near_lamp"];
    let with = |faults: &str| {
        let command = format!("{SMALL} {{scene}} {{output}} {faults}");
        stress(&command, "output = \"pfm\"", &names)
    };
    let wrong_at = |results: &Value, name: &str| family(results, name)["wrong_at"].as_f64();
    // Without a fault, only its own offset of 1e-9 m is too long for a scene of that size.
    let (code, text, results) = with("");
    assert_eq!(code, Some(1), "{text}");
    assert!(wrong_at(&results, "shrunk_scene") >= Some(1e6), "{text}");
    assert_eq!(wrong_at(&results, "near_lamp"), None, "{text}");
    // Shadow rays start a millimetre from the surface.
    let (code, text, results) = with("bias");
    assert_eq!(code, Some(1), "{text}");
    let at = wrong_at(&results, "shrunk_scene").unwrap();
    assert!((10.0..=1e4).contains(&at), "{text}");
    // No shadows: wrong in the easiest scene.
    let (code, text, results) = with("no-shadows");
    assert_eq!(code, Some(1), "{text}");
    assert_eq!(wrong_at(&results, "shrunk_scene"), Some(1.0), "{text}");
    assert!(
        text.contains("pixel (") && text.contains("the oracle ["),
        "{text}"
    );
    assert_eq!(
        family(&results, "shrunk_scene")["whitstone_wrong_at"],
        Value::Null,
        "{text}"
    );
}

#[test]
fn renderers_without_images_are_named() {
    let crash = stress(
        "sh -c 'echo no licence; exit 2' {scene} {output}",
        "",
        &["planet"],
    );
    assert_eq!(crash.0, Some(1), "{}", crash.1);
    assert!(crash.1.contains("no licence"), "{}", crash.1);
    let cannot = stress(
        "sh -c 'echo no spheres; exit 77' {scene} {output}",
        "",
        &["planet"],
    );
    assert_eq!(cannot.0, Some(3), "{}", cannot.1);
    assert!(
        cannot
            .1
            .contains("skipped: the command cannot render this scene: no spheres"),
        "{}",
        cannot.1
    );
    let noisy = stress("sh -c 'exit 0' {scene} {output} {seed}", "runs = 4", &["planet"]);
    assert_eq!(noisy.0, Some(2), "{}", noisy.1);
    assert!(noisy.1.contains("have noise"), "{}", noisy.1);
}
