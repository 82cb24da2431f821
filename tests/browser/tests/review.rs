//! What a user of `compare --review` does: look at the pictures of a pair, accept it, undo it, end.
//! And the page of `compare --html`, which has the same viewer.

use libtest_mimic::{Arguments, Failed, Trial};
use std::path::Path;
use std::sync::Mutex;
use whitstone_browser::{Browser, Driver, Problem, UNEXPLAINED, images};
use whitstone_validate::report::{
    ReviewDetails, ReviewPixel, ReviewRow, compare_page, review_details, review_page,
};
use whitstone_validate::{Pictures, Stop};
use whitstone_view::{Pairs, Review, Standing};

const NAMES: [&str; 2] = ["deep/<b>ball</b>.exr", "wall.exr"];

/// Two pairs that differ, and those that are accepted.
#[derive(Default)]
struct Two(Mutex<[bool; 2]>);

impl Two {
    fn decide(&self, pair: usize, accepted: bool) -> Standing {
        let mut all = self.0.lock().expect("no test panics with it");
        all[pair] = accepted;
        Standing {
            word: if accepted { "accepted" } else { "differs" },
            is_right: accepted,
            left: all.iter().filter(|accepted| !**accepted).count(),
        }
    }
}

impl Pairs for Two {
    fn count(&self) -> usize {
        2
    }

    fn page(&self, nonce: &str) -> String {
        let problems = ["1 pixels are over tolerance; the limit is 0".to_owned()];
        let rows = NAMES.map(|name| ReviewRow {
            name,
            word: "differs",
            is_right: false,
            problems: &problems,
            writes: Some(format!("references/{name}")),
            accepted: false,
            details: "",
        });
        review_page("renders and references", &rows, nonce)
    }

    fn details(&self, _: usize) -> String {
        let [ours, reference] = images();
        let [x, y] = UNEXPLAINED;
        let at = |image: &whitstone_image::Image| {
            let planes = image.rgb().expect("it is made of R, G and B");
            planes.map(|plane| plane[y * image.width() + x])
        };
        review_details(&ReviewDetails {
            pictures: Pictures::new(&ours, &reference, [(UNEXPLAINED, None)].into_iter()),
            images: [Some(&ours), Some(&reference)],
            figures: vec![("rmse".to_owned(), "1e-5".to_owned())],
            worst: vec![ReviewPixel {
                at: UNEXPLAINED,
                ours: at(&ours),
                reference: at(&reference),
                relative: 1.0,
            }],
            notes: vec!["compared with <i>references</i>".to_owned()],
        })
    }

    fn accept(&self, pair: usize) -> Result<Standing, String> {
        match pair {
            0 => Ok(self.decide(0, true)),
            _ => Err("wall.exr has changed".to_owned()),
        }
    }

    fn undo(&self, pair: usize) -> Result<Standing, String> {
        Ok(self.decide(pair, false))
    }
}

fn check(holds: bool, problem: &str) -> Result<(), Problem> {
    holds.then_some(()).ok_or_else(|| problem.into())
}

fn test(browser: &Browser, pairs: &Two) -> Result<(), Problem> {
    let accepted = || pairs.0.lock().map(|all| *all).unwrap_or_default();
    let pair = "details[data-pair='0']";
    // The first pair that differs is open, and its pixels are drawn by the viewer of the report.
    browser.wait("document.querySelector('.pictures[data-ready=true] canvas.beside')")?;
    check(
        browser.text(&format!("{pair} h3"))? == NAMES[0],
        "a name is an element",
    )?;
    let hidden = "document.querySelector('details[data-pair=\"1\"] .pictures') === null";
    browser.wait(hidden)?;
    browser.run("const s = document.querySelector('.viewer .split'); s.value = 50; s.dispatchEvent(new Event('input'))")?;
    browser.wait("document.querySelector('.frame.is-split')")?;
    browser.click(".worst .place button")?;
    let readout = browser.text(".readout")?;
    let place = format!("pixel ({}, {})", UNEXPLAINED[0], UNEXPLAINED[1]);
    check(
        readout.contains(&place) && readout.contains("over tolerance"),
        &readout,
    )?;
    // The style of the page is not blocked by its policy.
    let width = "document.querySelector('.pictures figure').getBoundingClientRect().width > 200";
    browser.wait(width)?;
    check(accepted() == [false; 2], "looking accepts nothing")?;

    browser.click(&format!("{pair} .accept"))?;
    browser.wait("document.getElementById('left').textContent === '1 image to review'")?;
    check(accepted() == [true, false], "the wrong pair was accepted")?;
    check(
        browser.text(&format!("{pair} .badge"))? == "accepted",
        "the badge is old",
    )?;
    browser.click(&format!("{pair} .undo"))?;
    browser.wait("document.getElementById('left').textContent === '2 images to review'")?;
    check(accepted() == [false; 2], "undo did nothing")?;
    // A refusal is shown, and the pair stays as it is.
    browser.run("document.querySelector(\"details[data-pair='1']\").open = true")?;
    browser.click("details[data-pair='1'] .accept")?;
    browser.wait("document.getElementById('message').textContent === 'wall.exr has changed'")?;
    check(
        browser.text("details[data-pair='1'] .badge")? == "differs",
        "the badge changed",
    )?;

    browser.click(&format!("{pair} .accept"))?;
    browser.wait("document.getElementById('left').textContent === '1 image to review'")?;
    browser.click("#done")?;
    browser.wait("document.getElementById('left').textContent.startsWith('The review has ended')")
}

fn run(driver: &Driver, pictures: &Path) -> Result<(), Problem> {
    let review = Review::open(0)?;
    let pairs = Two::default();
    let stop = Stop::default();
    std::thread::scope(|scope| {
        let server = scope.spawn(|| review.run(&pairs, &stop));
        let found = Browser::visit(driver, &review.url(), "review", pictures)
            .and_then(|browser| {
                let found = test(&browser, &pairs);
                browser.close(found)
            })
            .and_then(|()| {
                // The button has ended it.
                for _ in 0..100 {
                    if server.is_finished() {
                        return Ok(());
                    }
                    std::thread::sleep(std::time::Duration::from_millis(50));
                }
                Err("the server did not end".into())
            });
        stop.request();
        found
    })
}

/// The page of `--html` from disk: the pair that differs is open, and its viewer works.
fn page_of_html(driver: &Driver, pictures: &Path) -> Result<(), Problem> {
    let details = Two::default().details(0);
    let row = |name: &'static str, is_right: bool| ReviewRow {
        name,
        word: if is_right { "pass" } else { "differs" },
        is_right,
        problems: &[],
        writes: None,
        accepted: false,
        details: &details,
    };
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("compare.html");
    std::fs::write(&file, compare_page("a and b", &[row("a", true), row("b", false)]))?;
    let address = format!("file://{}", file.display());
    Browser::visit(driver, &address, "compare", pictures).and_then(|browser| {
        let found = look(&browser);
        browser.close(found)
    })
}

fn look(browser: &Browser) -> Result<(), Problem> {
    let pair = "details[data-pair='1']";
    browser.wait(&format!(
        "document.querySelector(\"{pair} .pictures[data-ready=true] canvas.beside\")"
    ))?;
    let closed = "!document.querySelector(\"details[data-pair='0']\").open";
    browser.wait(closed)?;
    let width =
        format!("document.querySelector(\"{pair} .pictures figure\").getBoundingClientRect().width > 200");
    browser.wait(&width)?;
    browser.click(&format!("{pair} .worst .place button"))?;
    let readout = browser.text(&format!("{pair} .readout"))?;
    check(readout.contains("over tolerance"), &readout)?;
    check(
        browser.text("h1")? == "2 images compared, 1 with differences",
        "the heading",
    )
}

fn main() {
    let arguments = Arguments::from_args();
    let required = std::env::var("WHITSTONE_BROWSER").is_ok_and(|value| value == "required");
    let driver = Driver::start();
    let absent = driver.is_err();
    if let (Err(problem), false) = (&driver, required) {
        eprintln!("the test is ignored: {problem}");
    }
    let pictures = Path::new(env!("CARGO_TARGET_TMPDIR")).join("review");
    let trial = move || -> Result<(), Failed> {
        let driver = driver?;
        run(&driver, &pictures)?;
        Ok(page_of_html(&driver, &pictures)?)
    };
    let trial = Trial::test("review", trial).with_ignored_flag(absent && !required);
    libtest_mimic::run(&arguments, vec![trial]).exit();
}
