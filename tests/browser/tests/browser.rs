//! What a reader of the report does: slider, exposure, errors, pixels, worst pixels, keys,
//! diagrams, filters.

use libtest_mimic::{Arguments, Failed, Trial};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use thirtyfour::Key;
use whitstone_browser::{Browser, DOT, Driver, Problem, SIZE, UNEXPLAINED, images, page};
use whitstone_image::tone::linear_to_srgb;
use whitstone_metrics::ColorMap;

/// The case that fails, which is open from the start.
const CASE: &str = "#case-2";

fn check(holds: bool, problem: impl std::fmt::Display) -> Result<(), Problem> {
    if holds {
        Ok(())
    } else {
        Err(problem.to_string().into())
    }
}

fn ready(browser: &Browser) -> Result<(), Problem> {
    browser.wait(&format!(
        "document.querySelector('{CASE} .pictures').dataset.ready"
    ))
}

/// Red, green, blue of a pixel of the canvas with a number in the case.
fn color(browser: &Browser, canvas: usize, [x, y]: [usize; 2]) -> Result<[i64; 3], Problem> {
    let value = browser.run(&format!(
        "return [...document.querySelectorAll('{CASE} canvas')[{canvas}].getContext('2d').getImageData({x}, {y}, 1, 1).data]"
    ))?;
    let part = |index: usize| value[index].as_i64().ok_or(format!("no colour: {value}"));
    Ok([part(0)?, part(1)?, part(2)?])
}

fn near(found: [i64; 3], expected: [i64; 3], by: i64) -> bool {
    found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= by)
}

/// In the order of the page: ours, the reference over it, the reference, the error.
const OURS: usize = 0;
const BESIDE: usize = 1;
const REFERENCE: usize = 2;
const ERROR: usize = 3;

fn readout(browser: &Browser) -> Result<String, Problem> {
    browser.text(&format!("{CASE} .readout"))
}

/// What a screen shows of a pixel of an image at an exposure.
fn shown(image: usize, [x, y]: [usize; 2], exposure: f64) -> [i64; 3] {
    let image = &images()[image];
    image.rgb().expect("it is made of R, G and B").map(|plane| {
        let value = f64::from(plane[y * SIZE[0] + x]) * exposure.exp2();
        (linear_to_srgb(value.min(1.0)) * 255.0).round() as i64
    })
}

/// A key as WebDriver writes it.
fn key_text(key: Key) -> String {
    key.value().to_string()
}

/// Moves a slider by keys, as people without a pointer do.
fn slide(browser: &Browser, selector: &str, key: Key, times: usize) -> Result<(), Problem> {
    browser.keys(selector, &key_text(key).repeat(times))
}

fn loads(browser: &Browser) -> Result<(), Problem> {
    ready(browser)?;
    let ours = color(browser, OURS, [3, 4])?;
    check(near(ours, shown(0, [3, 4], 0.0), 1), format!("{ours:?}"))?;
    let text = browser.text("h1")?;
    check(text.contains("1 of 3 cases does not pass"), text)?;
    // A case that is opened later shows its pixels then.
    let later = "document.querySelector('#case-1 canvas')";
    check(
        browser.run(&format!("return {later} === null"))? == true,
        "all cases are unpacked at once",
    )?;
    browser.click("#case-1 summary")?;
    browser.wait(&format!(
        "{later} && document.querySelector('#case-1 .pictures').dataset.ready"
    ))
}

fn slider(browser: &Browser) -> Result<(), Problem> {
    ready(browser)?;
    let clip = || {
        browser.run(&format!(
            "return getComputedStyle(document.querySelector('{CASE} .beside')).clipPath"
        ))
    };
    let caption = || browser.text(&format!("{CASE} figure figcaption"));
    check(clip()? == "inset(0px 0px 0px 100%)", "only ours is seen at first")?;
    check(caption()? == "ours", caption()?)?;
    slide(browser, &format!("{CASE} .split"), Key::Left, 40)?;
    check(clip()? == "inset(0px 0px 0px 60%)", clip()?)?;
    check(caption()? == "ours, then the reference", caption()?)?;
    let beside = color(browser, BESIDE, UNEXPLAINED)?;
    check(
        near(beside, shown(1, UNEXPLAINED, 0.0), 1),
        format!("{beside:?} is not the reference"),
    )?;
    let flip = format!("{CASE} .flip");
    let pressed = || browser.run(&format!("return document.querySelector('{flip}').ariaPressed"));
    browser.click(&flip)?;
    check(
        clip()? == "inset(0px 0px 0px 0%)" && pressed()? == "true",
        format!("{} {}", clip()?, pressed()?),
    )?;
    check(caption()? == "reference, in place of ours", caption()?)?;
    browser.click(&flip)?;
    check(
        clip()? == "inset(0px 0px 0px 100%)" && pressed()? == "false",
        clip()?,
    )
}

fn exposure(browser: &Browser) -> Result<(), Problem> {
    ready(browser)?;
    for (key, times, exposure) in [(Key::Right, 4, 2.0), (Key::Left, 10, -3.0)] {
        slide(browser, &format!("{CASE} .exposure"), key, times)?;
        let stops = browser.text(&format!("{CASE} .stops"))?;
        check(stops.parse() == Ok(exposure), format!("{stops} for {exposure}"))?;
        for (canvas, image) in [(OURS, 0), (BESIDE, 1), (REFERENCE, 1)] {
            for pixel in [[0, 0], UNEXPLAINED, [63, 47]] {
                let found = color(browser, canvas, pixel)?;
                let expected = shown(image, pixel, exposure);
                check(
                    near(found, expected, 1),
                    format!("{canvas} at {pixel:?}: {found:?}, not {expected:?}"),
                )?;
            }
        }
    }
    Ok(())
}

fn errors(browser: &Browser) -> Result<(), Problem> {
    ready(browser)?;
    let relative = |value: f64, ends: [f64; 2]| (value / ends[0]).log10() / (ends[1] / ends[0]).log10();
    let at = |map: ColorMap, part: f64| {
        map.table()[(255.0 * part.clamp(0.0, 1.0)).round() as usize].map(i64::from)
    };
    // At (3, 4) and (60, 4), of the channel that differs most.
    let residual = |[x, y]: [usize; 2]| {
        let [ours, reference] = images();
        let mean = whitstone_metrics::metrics::mean_reference(&reference).expect("it is made of R, G and B");
        let pixel = y * SIZE[0] + x;
        let channels = ours.rgb().into_iter().zip(reference.rgb()).flat_map(|(a, b)| {
            [0, 1, 2].map(|c| {
                let (a, b) = (f64::from(a[c][pixel]), f64::from(b[c][pixel]));
                [(a - b) / (b.abs() + mean), a - b]
            })
        });
        channels
            .reduce(|worst, next| {
                if next[0].abs() > worst[0].abs() {
                    next
                } else {
                    worst
                }
            })
            .unwrap_or_default()
    };
    let select = |name: &str| {
        let script = format!(
            "const select = document.querySelector('{CASE} .error-view'); select.value = '{name}'; \
             select.dispatchEvent(new Event('change')); \
             return [...document.querySelectorAll('{CASE} figure .scale span')].map((span) => span.textContent)"
        );
        browser.run(&script)
    };
    let ends = [1e-7, 1e-1];
    for (name, labels) in [
        ("relative", json!(["≤ 1e-7", "1e-4", "≥ 1e-1"])),
        ("absolute", json!(["≤ 1e-7", "1e-4", "≥ 1e-1"])),
        ("signed", json!(["−0.1", "±1e-7", "+0.1"])),
        ("flip", json!(["0", "0.5", "1"])),
    ] {
        let found = select(name)?;
        check(found == labels, format!("legend of {name}: {found}"))?;
        for pixel in [[3, 4], [60, 4]] {
            let [residual, absolute] = residual(pixel);
            let expected = match name {
                "relative" => at(ColorMap::Turbo, relative(residual.abs(), ends)),
                "absolute" => at(ColorMap::Turbo, relative(absolute.abs(), ends)),
                "signed" => at(
                    ColorMap::Diverging,
                    0.5 + 0.5 * residual.signum() * relative(residual.abs(), ends),
                ),
                _ => at(ColorMap::Magma, 0.0),
            };
            let found = color(browser, ERROR, pixel)?;
            // Residuals are packed to a tenth, which is two of 256 colours; FLIP sees nothing of
            // 1e-5.
            check(
                near(found, expected, 12),
                format!("{name} at {pixel:?}: {found:?}, not {expected:?}"),
            )?;
        }
    }
    let flip = color(browser, ERROR, UNEXPLAINED)?;
    check(
        flip.iter().sum::<i64>() > 150,
        format!("FLIP of a doubled pixel: {flip:?}"),
    )
}

fn pixels(browser: &Browser) -> Result<(), Problem> {
    ready(browser)?;
    let frame = format!("{CASE} .frame");
    let box_ = browser.run(&format!(
        "const box = document.querySelector('{frame}').getBoundingClientRect(); return [box.width, box.height]"
    ))?;
    let point = |[x, y]: [usize; 2]| {
        let offset = |axis: usize, at: usize| {
            let size = box_[axis].as_f64().unwrap_or_default();
            (size * ((at as f64 + 0.5) / SIZE[axis] as f64 - 0.5)).round() as i64
        };
        browser.point(&frame, [offset(0, x), offset(1, y)])
    };
    point([3, 4])?;
    let text = readout(browser)?;
    let parts = [
        "pixel (3, 4)",
        "ours 0.1234, 0.1417, 0.3",
        "reference 0.1234",
        "relative 2.",
        "within tolerance",
    ];
    for part in parts {
        check(text.contains(part), format!("{part} is not in: {text}"))?;
    }
    let value = |name: &str| -> Option<f64> {
        let (_, rest) = text.split_once(name)?;
        rest.split([',', ' ']).find(|part| !part.is_empty())?.parse().ok()
    };
    // 1e-5 of 0.1234, to a tenth.
    let difference = value("difference").ok_or(format!("no number: {text}"))?;
    check(
        (difference / 1.234e-6 - 1.0).abs() < 0.15,
        format!("{difference}"),
    )?;
    point(UNEXPLAINED)?;
    let text = readout(browser)?;
    for part in [
        "pixel (10, 20)",
        "ours 0.356250, 0.616667, 0.600000",
        "reference 0.178125",
        "unexplained",
    ] {
        check(text.contains(part), format!("{part} is not in: {text}"))?;
    }
    // All three pictures show it.
    let marks = browser.run(&format!(
        "return [...document.querySelectorAll('{CASE} .mark')].map((mark) => mark.hidden ? null : parseFloat(mark.style.left))"
    ))?;
    let marks: Vec<f64> = marks
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(Value::as_f64)
        .collect();
    let left = 100.0 * (UNEXPLAINED[0] as f64 + 0.5) / SIZE[0] as f64;
    check(
        marks.len() == 3 && marks.iter().all(|mark| (mark - left).abs() < 0.01),
        format!("{marks:?}, not {left}"),
    )
}

fn worst(browser: &Browser) -> Result<(), Problem> {
    ready(browser)?;
    browser.click(&format!("{CASE} .worst tbody tr:nth-child(2) button"))?;
    browser.point("h1", [0, 0])?;
    let text = readout(browser)?;
    check(
        text.contains("pixel (50, 40)") && text.contains("a shift of 1e-3 pixel"),
        text,
    )?;
    let pictures = format!("{CASE} .pictures");
    browser.keys(&pictures, "n")?;
    check(
        readout(browser)?.contains("pixel (10, 20)"),
        "N does not go round",
    )?;
    browser.keys(&pictures, "p")?;
    check(readout(browser)?.contains("pixel (50, 40)"), "P does not go back")
}

fn keyboard(browser: &Browser) -> Result<(), Problem> {
    ready(browser)?;
    let pictures = format!("{CASE} .pictures");
    // They can be reached without a pointer.
    let stops = browser.run(&format!("return document.querySelector('{pictures}').tabIndex"))?;
    check(stops == 0, stops)?;
    let at = |text: &str| -> Result<(), Problem> {
        let found = readout(browser)?;
        check(found.contains(text), format!("{text} is not in: {found}"))
    };
    browser.keys(&pictures, &key_text(Key::Right))?;
    at("pixel (32, 24)")?;
    browser.keys(&pictures, &key_text(Key::Right))?;
    browser.keys(&pictures, &key_text(Key::Up))?;
    at("pixel (33, 23)")?;
    browser.keys(&pictures, &(key_text(Key::Shift) + key_text(Key::Left).as_str()))?;
    at("pixel (23, 23)")?;
    browser.keys(&pictures, &key_text(Key::Up).repeat(30))?;
    at("pixel (23, 0)")?;
    let state = || {
        browser.run(&format!(
            "const at = (selector) => document.querySelector('{CASE} ' + selector); \
             return [at('.stops').textContent, at('.error-view').value, at('.flip').ariaPressed]"
        ))
    };
    browser.keys(&pictures, "++-ef")?;
    check(state()? == json!(["+0.5", "absolute", "true"]), state()?)?;
    browser.keys(&pictures, "0f")?;
    check(state()? == json!(["0", "absolute", "false"]), state()?)?;
    browser.keys(&pictures, &key_text(Key::Escape))?;
    at("use the arrow keys")
}

fn diagrams(browser: &Browser) -> Result<(), Problem> {
    let output = || browser.text("#studies .point output");
    check(output()?.contains("Point at a dot"), output()?)?;
    browser.point("#studies circle:nth-of-type(2)", [0, 0])?;
    browser.wait("document.querySelector('#studies circle.here')")?;
    check(output()? == DOT.join(" "), output()?)?;
    check(
        browser.text("#studies .point code")? == DOT[1],
        "the command is not told",
    )?;
    browser.run("document.querySelector('#studies circle').focus()")?;
    check(output()?.contains("sampler.samples_per_axis=1"), output()?)?;
    browser.type_keys(&key_text(Key::Right))?;
    check(output()? == DOT.join(" "), output()?)
}

fn filters(browser: &Browser) -> Result<(), Problem> {
    let rows = || -> Result<Value, Problem> {
        browser.run(
            "return [...document.querySelectorAll('.summary tbody tr')].filter((row) => !row.hidden) \
             .map((row) => row.querySelector('th').textContent.trim())",
        )
    };
    check(
        rows()? == json!(["shapes/sphere", "materials/mirror", "shapes/box"]),
        rows()?,
    )?;
    browser.keys("#filter", "shapes/")?;
    check(rows()? == json!(["shapes/sphere", "shapes/box"]), rows()?)?;
    check(browser.text("#shown")? == "2 of 3 shown", browser.text("#shown")?)?;
    browser.run("const text = document.getElementById('filter'); text.value = ''; text.dispatchEvent(new Event('input'))")?;
    // By its first letters, as in every list.
    browser.keys("#plugin", "sph")?;
    check(rows()? == json!(["shapes/sphere", "materials/mirror"]), rows()?)?;
    let hidden = browser.run("return document.getElementById('case-3').hidden")?;
    check(hidden == true, "the section stays")?;
    browser.click("#failures")?;
    check(rows()? == json!(["shapes/sphere"]), rows()?)?;
    browser.keys("#plugin", "all")?;
    browser.click("#failures")?;
    // Sorting by name.
    browser.click(".summary thead th:nth-child(2) button")?;
    check(
        rows()? == json!(["materials/mirror", "shapes/box", "shapes/sphere"]),
        rows()?,
    )
}

/// A report of a whole run, where one is named: it may not be too large, and what is not looked at
/// must not be unpacked, so that it opens fast.
fn whole(path: &Path, browser: &Browser) -> Result<(), Problem> {
    let bytes = std::fs::metadata(path)?.len();
    check(
        bytes < 30_000_000,
        format!("{} has {bytes} bytes", path.display()),
    )?;
    let count = |what: &str| -> Result<u64, Problem> {
        let found = browser.run(&format!("return document.querySelectorAll('{what}').length"))?;
        Ok(found.as_u64().expect("a length is a number"))
    };
    let (cases, elements) = (count("details.case")?, count("*")?);
    let unpacked = count("canvas")?;
    let took = browser.run("return performance.getEntriesByType('navigation')[0].loadEventEnd")?;
    println!(
        "{}: {bytes} bytes, {cases} cases, {elements} elements, {unpacked} canvases, {took} ms",
        path.display()
    );
    check(cases > 1, format!("{cases} cases"))?;
    check(
        elements < 500 * cases && unpacked < cases,
        format!("{elements} elements and {unpacked} canvases for {cases} cases"),
    )?;
    browser.run("document.querySelector('details.case').open = true")?;
    browser.wait("document.querySelector('details.case[open] .pictures').dataset.ready")
}

type Test = fn(&Browser) -> Result<(), Problem>;

const TESTS: [(&str, Test); 9] = [
    ("loads", loads),
    ("slider", slider),
    ("exposure", exposure),
    ("errors", errors),
    ("pixels", pixels),
    ("worst", worst),
    ("keyboard", keyboard),
    ("diagrams", diagrams),
    ("filters", filters),
];

fn main() {
    let mut arguments = Arguments::from_args();
    // Windows that share two cores wait for each other.
    arguments.test_threads = arguments.test_threads.or(Some(1));
    let required = std::env::var("WHITSTONE_BROWSER").is_ok_and(|value| value == "required");
    let driver = Driver::start()
        .map(Arc::new)
        .map_err(|problem| problem.to_string());
    let folder = tempfile::tempdir().map_err(|error| error.to_string());
    let page = folder
        .as_ref()
        .map_err(Clone::clone)
        .and_then(|folder| page(folder.path()).map_err(|error| error.to_string()));
    let absent = driver.is_err();
    if let (Err(problem), false) = (&driver, required) {
        eprintln!("the tests are ignored: {problem}");
    }
    let pictures = Path::new(env!("CARGO_TARGET_TMPDIR")).join("report");
    let mut trials: Vec<Trial> = TESTS
        .map(|(name, test)| {
            let (driver, page, pictures) = (driver.clone(), page.clone(), pictures.clone());
            let run = move || -> Result<(), Failed> {
                let (driver, page): (Arc<Driver>, PathBuf) = (driver?, page?);
                let browser = Browser::open(&driver, &page, name, &pictures)?;
                let found = test(&browser);
                Ok(browser.close(found)?)
            };
            Trial::test(name, run).with_ignored_flag(absent && !required)
        })
        .into();
    if let Some(path) = std::env::var_os("WHITSTONE_REPORT").map(PathBuf::from) {
        let (driver, pictures) = (driver.clone(), pictures.clone());
        let run = move || -> Result<(), Failed> {
            let driver: Arc<Driver> = driver?;
            let browser = Browser::open(&driver, &path, "whole", &pictures)?;
            let found = whole(&path, &browser);
            Ok(browser.close(found)?)
        };
        trials.push(Trial::test("whole", run).with_ignored_flag(absent && !required));
    }
    let conclusion = libtest_mimic::run(&arguments, trials);
    // Before the process ends: what ends it closes nothing.
    drop((driver, folder));
    conclusion.exit();
}
