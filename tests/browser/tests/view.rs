//! What a user of the live view does: first picture, orbit, changed file, errors, pixels, heat
//! maps, accelerators, comparison. `numbers` prints the times that docs/view.md reports.

use libtest_mimic::{Arguments, Failed, Trial};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use thirtyfour::Key;
use whitstone_browser::{Browser, Driver, Problem};
use whitstone_core::Registry;
use whitstone_validate::{REFERENCES, Stop};
use whitstone_view::{Options, View};

/// The scene of the tests, whose picture is compared with its stored reference.
const CLASSIC: &str = "scenes/showcase/classic.toml";

/// A view that runs, and the page that shows it.
struct Test<'a> {
    browser: &'a Browser,
    /// A copy of the scene, which a test may change.
    scene: &'a Path,
    url: &'a str,
}

fn check(holds: bool, problem: impl std::fmt::Display) -> Result<(), Problem> {
    if holds {
        Ok(())
    } else {
        Err(problem.to_string().into())
    }
}

impl Test<'_> {
    fn finished(&self) -> Result<(), Problem> {
        self.browser.wait("document.body.dataset.final === 'true'")
    }

    fn data(&self, key: &str) -> Result<String, Problem> {
        let value = self
            .browser
            .run(&format!("return document.body.dataset.{key} ?? ''"))?;
        Ok(value.as_str().unwrap_or_default().to_owned())
    }

    /// Waits for a finished picture of another version or view.
    fn another(&self, key: &str) -> Result<(), Problem> {
        let key = Value::from(key);
        self.browser.wait(&format!(
            "document.body.dataset.key !== {key} && document.body.dataset.final === 'true'"
        ))
    }

    /// Red, green, blue of a canvas at fractions of its sides.
    fn color(&self, canvas: &str, [x, y]: [f64; 2]) -> Result<[i64; 3], Problem> {
        let value = self.browser.run(&format!(
            "const canvas = document.getElementById('{canvas}'); \
             return [...canvas.getContext('2d').getImageData(canvas.width * {x}, canvas.height * {y}, 1, 1).data]"
        ))?;
        let part = |index: usize| value[index].as_i64().ok_or(format!("no colour: {value}"));
        Ok([part(0)?, part(1)?, part(2)?])
    }

    fn change(&self, from: &str, to: &str) -> Result<(), Problem> {
        let text = fs::read_to_string(self.scene)?;
        check(text.contains(from), format!("the scene has no {from}"))?;
        Ok(fs::write(self.scene, text.replace(from, to))?)
    }

    fn select(&self, id: &str, value: &str) -> Result<(), Problem> {
        self.browser.run(&format!(
            "const select = document.getElementById('{id}'); select.value = '{value}'; \
             select.dispatchEvent(new Event('change'))"
        ))?;
        Ok(())
    }
}

fn first_picture(test: &Test<'_>) -> Result<(), Problem> {
    test.finished()?;
    let status = test.browser.text("#status")?;
    check(
        status.contains("192 × 192") && status.contains("finished"),
        &status,
    )?;
    // The red ball in the middle, below.
    let [r, g, b] = test.color("ours", [0.5, 0.72])?;
    check(
        r > 60 && 2 * r > 3 * g && 2 * r > 3 * b,
        format!("not red: {r} {g} {b}"),
    )?;
    check(test.browser.text("h1")?.ends_with("scene.toml"), "no name")
}

fn orbit(test: &Test<'_>) -> Result<(), Problem> {
    test.finished()?;
    let (key, before) = (test.data("key")?, test.color("ours", [0.5, 0.72])?);
    test.browser.drag("#frame", [20, 0], 8)?;
    test.another(&key)?;
    let after = test.color("ours", [0.5, 0.72])?;
    check(before != after, format!("the picture is the same: {before:?}"))?;
    check(
        test.browser.text("#caption")? == "ours"
            && test
                .browser
                .run("return document.getElementById('pixel').hidden")?
                == true,
        "a drag is not a click",
    )?;
    // The distance from the target stays.
    for keys in [Key::Left, Key::Up] {
        let key = test.data("key")?;
        test.browser.keys("#frame", &keys.value().to_string())?;
        test.another(&key)?;
    }
    let moved = test.data("key")?;
    test.browser.keys("#frame", &Key::Home.value().to_string())?;
    test.another(&moved)?;
    check(test.data("key")? == key, "Home does not reset the camera")
}

fn changed_file(test: &Test<'_>) -> Result<(), Problem> {
    test.finished()?;
    let key = test.data("key")?;
    test.change("[0.8, 0.2, 0.2]", "[0.2, 0.2, 0.8]")?;
    test.another(&key)?;
    let [r, _, b] = test.color("ours", [0.5, 0.72])?;
    check(2 * b > 3 * r, format!("not blue: {r} {b}"))
}

fn error_at_its_line(test: &Test<'_>) -> Result<(), Problem> {
    test.finished()?;
    test.change("fov = 45", "fow = 45")?;
    test.browser.wait("document.body.dataset.problems === '1'")?;
    let line = fs::read_to_string(test.scene)?
        .lines()
        .position(|line| line.starts_with("fow"))
        .map_or(0, |index| index + 1);
    let text = test.browser.text("#problems")?;
    for part in [&format!("scene.toml:{line}:1"), "fow", "fov"] {
        check(text.contains(part), format!("{part} is not in: {text}"))?;
    }
    // The last picture stays.
    check(test.color("ours", [0.5, 0.72])?[0] > 60, "the picture is gone")?;
    test.change("fow = 45", "fov = 45")?;
    test.browser.wait("document.getElementById('problems').hidden")
}

fn pixel(test: &Test<'_>) -> Result<(), Problem> {
    test.finished()?;
    // The middle is between both balls; to the right is the glass ball.
    test.browser.run(
        "const box = document.getElementById('frame').getBoundingClientRect(); \
         const at = { clientX: box.left + 0.68 * box.width, clientY: box.top + 0.5 * box.height, bubbles: true, pointerId: 1, button: 0 }; \
         const frame = document.getElementById('frame'); frame.setPointerCapture = () => {}; \
         frame.dispatchEvent(new PointerEvent('pointerdown', at)); frame.dispatchEvent(new PointerEvent('pointerup', at))",
    )?;
    test.browser
        .wait("document.querySelectorAll('#rays li').length > 3")?;
    let title = test.browser.text("#pixel h2")?;
    check(title == "Pixel (130, 96)", &title)?;
    let values = test.browser.text("#pixel .values")?;
    for part in [
        "value",
        "depth.Z",
        "normal.X",
        "uv.U",
        "shape_id.I",
        "primitive_id.I",
    ] {
        check(values.contains(part), format!("{part} is not in: {values}"))?;
    }
    let rays = test.browser.text("#rays")?;
    check(
        rays.contains("camera ray: hits sphere \"glass\"") && rays.contains("ray T"),
        &rays,
    )?;
    let lines = || {
        test.browser
            .run("return document.querySelectorAll('#overlay line:not(.outline)').length")
    };
    check(lines()?.as_u64() > Some(2), "the rays are not drawn")?;
    // Stepping shows one ray more each time.
    test.browser.keys("#frame", "nn")?;
    let told = test.browser.text("#ray")?;
    check(told.contains("The reflected ray R goes from"), &told)?;
    let current = test
        .browser
        .run("return document.querySelectorAll('#rays [aria-current=true]').length")?;
    check(current == 1, current)?;
    test.browser.keys("#frame", &Key::Escape.value().to_string())?;
    test.browser.wait("document.getElementById('pixel').hidden")
}

fn heat_maps_and_accelerators(test: &Test<'_>) -> Result<(), Problem> {
    test.finished()?;
    test.select("shown", "rays")?;
    test.browser
        .wait("!document.getElementById('heat-scale').hidden")?;
    test.browser
        .wait("document.getElementById('caption').textContent.includes('rays traced for each pixel')")?;
    test.select("accelerator", "kdtree")?;
    test.browser
        .wait("document.getElementById('status').textContent.includes('kdtree')")?;
    test.select("shown", "steps")?;
    test.browser
        .wait("document.getElementById('caption').textContent.includes('inner nodes')")?;
    test.select("shown", "picture")?;
    test.browser.wait("document.getElementById('heat-scale').hidden")
}

fn comparison(test: &Test<'_>) -> Result<(), Problem> {
    test.browser.wait("!document.getElementById('split').disabled")?;
    let reference = test.browser.text("#reference")?;
    check(
        reference.contains("Mitsuba") && reference.contains("stored"),
        &reference,
    )?;
    test.browser.wait("!document.getElementById('errors').hidden")?;
    let clip = || {
        test.browser
            .run("return getComputedStyle(document.getElementById('beside')).clipPath")
    };
    check(clip()? == "inset(0px 0px 0px 100%)", "only ours is seen at first")?;
    test.browser
        .keys("#split", &Key::Left.value().to_string().repeat(40))?;
    check(clip()? == "inset(0px 0px 0px 60%)", clip()?)?;
    let (ours, theirs) = (
        test.color("ours", [0.5, 0.72])?,
        test.color("beside", [0.5, 0.72])?,
    );
    let far = ours.iter().zip(theirs).any(|(a, b)| (a - b).abs() > 1);
    check(!far, format!("{ours:?} is not {theirs:?}"))?;
    test.browser.click("#flip")?;
    check(clip()? == "inset(0px 0px 0px 0%)", clip()?)?;
    for (name, caption) in [
        ("signed", "with its sign"),
        ("flip", "FLIP"),
        ("absolute", "absolute"),
    ] {
        test.select("error", name)?;
        let found = test.browser.text("#errors figcaption")?;
        check(found.contains(caption), found)?;
    }
    // Another view has no reference.
    test.browser.keys("#frame", &Key::Left.value().to_string())?;
    test.browser
        .wait("document.getElementById('split').disabled && document.getElementById('errors').hidden")
}

fn second_page(test: &Test<'_>) -> Result<(), Problem> {
    test.finished()?;
    // A frame of the page cannot be opened, so the second page is asked for as the script does.
    let status = test.browser.run(
        "const request = new XMLHttpRequest(); request.open('POST', 'open', false); \
         request.send('{\"takes_over\":false}'); return request.status",
    )?;
    check(status == 409, status)?;
    test.browser.run(&format!("location.href = '{}'", test.url))?;
    // The page that is left makes room for the next one.
    test.browser.wait("document.body?.dataset.final === 'true'")
}

/// Prints the times of the first picture, of updates while orbiting, and of a changed file.
fn numbers(test: &Test<'_>) -> Result<(), Problem> {
    test.finished()?;
    println!(
        "first picture of classic.toml at 192 x 192: {} ms after opening the page",
        test.data("first")?
    );
    let mut changes = Vec::new();
    for (from, to) in [
        ("[0.8, 0.2, 0.2]", "[0.2, 0.2, 0.8]"),
        ("[0.2, 0.2, 0.8]", "[0.8, 0.2, 0.2]"),
    ] {
        let key = test.data("key")?;
        test.change(from, to)?;
        let start = SystemTime::now()
            .duration_since(SystemTime::UNIX_EPOCH)?
            .as_millis() as f64;
        test.browser
            .wait(&format!("document.body.dataset.key !== {}", Value::from(key)))?;
        changes.push(test.data("drawn")?.parse::<f64>()? - start);
        test.finished()?;
    }
    println!("changed file: drawn after {changes:?} ms");
    let key = test.data("key")?;
    test.change("width = 192\nheight = 192", "width = 640\nheight = 360")?;
    test.another(&key)?;
    test.browser.run(
        "window.shown = []; const frame = document.getElementById('frame'); let last = document.body.dataset.frame; \
         window.spin = setInterval(() => frame.dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowRight' })), 16); \
         new MutationObserver(() => { const { frame, width } = document.body.dataset; \
         if (frame !== last) { last = frame; window.shown.push(width); } }).observe(document.body, { attributes: true })",
    )?;
    std::thread::sleep(Duration::from_secs(4));
    let shown = test
        .browser
        .run("clearInterval(window.spin); return window.shown")?;
    let shown: Vec<&str> = shown
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(Value::as_str)
        .collect();
    let mut widths: Vec<&str> = shown.clone();
    widths.sort_unstable();
    widths.dedup();
    let counted = widths.iter().map(|width| {
        let count = shown.iter().filter(|other| other == &width).count();
        format!("{count} of width {width}")
    });
    println!(
        "orbiting at 640 x 360: {:.1} updates/s ({})",
        shown.len() as f64 / 4.0,
        counted.collect::<Vec<_>>().join(", ")
    );
    Ok(())
}

type Run = fn(&Test<'_>) -> Result<(), Problem>;

const TESTS: [(&str, Run); 9] = [
    ("first_picture", first_picture),
    ("orbit", orbit),
    ("changed_file", changed_file),
    ("error_at_its_line", error_at_its_line),
    ("pixel", pixel),
    ("heat_maps_and_accelerators", heat_maps_and_accelerators),
    ("comparison", comparison),
    ("second_page", second_page),
    ("numbers", numbers),
];

/// The plugins of the scene.
fn registry() -> Registry {
    let mut registry = Registry::default();
    for register in [
        whitstone_accelerators::register,
        whitstone_cameras::register,
        whitstone_integrators::register,
        whitstone_lights::register,
        whitstone_materials::register,
        whitstone_samplers::register,
        whitstone_shapes::register,
        whitstone_textures::register,
    ] {
        register(&mut registry).expect("the families have distinct types");
    }
    registry
}

/// Runs a test with a view of its own.
fn run(name: &str, test: Run, driver: &Driver, pictures: &Path) -> Result<(), Problem> {
    let folder = tempfile::tempdir()?;
    // The stored reference belongs to the scene in its place.
    let copied = folder.path().join("scene.toml");
    let is_compared = name == "comparison";
    let scene = if is_compared {
        PathBuf::from(CLASSIC)
    } else {
        copied
    };
    if !is_compared {
        fs::copy(CLASSIC, &scene)?;
    }
    let options = Options {
        scene: scene.clone(),
        references: PathBuf::from(REFERENCES),
        target: folder.path().join("target"),
        ..Options::default()
    };
    let registry = registry();
    let view = View::open(options, &registry)?;
    let url = view.url();
    let stop = Stop::default();
    std::thread::scope(|scope| {
        scope.spawn(|| view.run(&stop, &|text| eprintln!("{text}")));
        let found = Browser::visit(driver, &url, name, pictures).and_then(|browser| {
            let found = test(&Test {
                browser: &browser,
                scene: &scene,
                url: &url,
            });
            browser.close(found)
        });
        stop.request();
        found
    })
}

fn main() {
    let mut arguments = Arguments::from_args();
    // Windows and renderers that share two cores wait for each other.
    arguments.test_threads = arguments.test_threads.or(Some(1));
    let required = std::env::var("WHITSTONE_BROWSER").is_ok_and(|value| value == "required");
    // Stored references are named after the folder of the scenes.
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let driver = std::env::set_current_dir(root)
        .map_err(|error| error.to_string())
        .and_then(|()| Driver::start().map_err(|problem| problem.to_string()));
    let driver = driver.map(Arc::new);
    let absent = driver.is_err();
    if let (Err(problem), false) = (&driver, required) {
        eprintln!("the tests are ignored: {problem}");
    }
    let pictures = Path::new(env!("CARGO_TARGET_TMPDIR")).join("view");
    let trials = TESTS.map(|(name, test)| {
        let (driver, pictures) = (driver.clone(), pictures.clone());
        let trial = move || -> Result<(), Failed> {
            let driver: Arc<Driver> = driver?;
            Ok(run(name, test, &driver, &pictures)?)
        };
        Trial::test(name, trial).with_ignored_flag(absent && !required)
    });
    let conclusion = libtest_mimic::run(&arguments, trials.into());
    // Before the process ends: what ends it closes nothing.
    drop(driver);
    conclusion.exit();
}
