//! Laws in configurations that no one thought of: drawn at random, the same in every run, and
//! shrunk where one fails to a scene that shows it.

#[cfg(test)]
mod tests;

use crate::broken::Broken;
use crate::lawful::Lawful;
use crate::template::Template;
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestError, TestRng, TestRunner};
use std::cell::{Cell, RefCell};
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Once;
use whitstone_core::Plugin;

/// Configurations that are drawn for a text with ranges.
const CASES: u32 = 24;
/// Steps of shrinking.
const SHRINKS: u32 = 256;

/// What a plugin breaks, and where.
#[derive(Clone, Debug, PartialEq)]
pub struct Failure {
    /// The type of the plugin.
    pub plugin: &'static str,
    /// The law, in words.
    pub law: String,
    /// A scene as TOML that shows it; see [`holds_in`].
    pub scene: String,
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { plugin, law, scene } = self;
        write!(
            f,
            "{plugin} breaks a law: {law}\n\nThis scene shows it. `render` and `explain --pixel 32,32` tell more; \
             `whitstone_testkit::holds_in` holds it to the laws again.\n\n{scene}"
        )
    }
}

/// Holds a plugin to the laws of its family, for each text of its table. In a text a number may be
/// a range, `0.1..2`: then configurations are drawn at random, and one that fails is shrunk. `laws`
/// are more laws, or, for materials, all of them. The macros `shape_laws!` and so on call this.
///
/// # Panics
///
/// If a law is broken, with a scene that shows it; and if a text can never be built.
pub fn hold<F: Lawful, P: Plugin<F>>(texts: &[&str], laws: &[fn(&F::Product)]) {
    for text in if texts.is_empty() { &[""] } else { texts } {
        if let Err(failure) = first_failure::<F, P>(text, laws) {
            panic!("{failure}");
        }
    }
}

/// What [`hold`] finds for one text.
///
/// # Errors
///
/// The failure, shrunk.
///
/// # Panics
///
/// If the text can never be built.
pub fn first_failure<F: Lawful, P: Plugin<F>>(
    text: &str,
    laws: &[fn(&F::Product)],
) -> Result<(), Box<Failure>> {
    let template = Template::new(text);
    let (built, refused) = (Cell::new(0), RefCell::new(String::new()));
    // Of the last configuration that failed, which is the smallest one when the shrinking ends.
    let found: RefCell<Option<Broken>> = RefCell::new(None);
    let check = |text: &str, place: &F::Place| -> bool {
        match checked::<F, P>(text, place, laws) {
            Err(Refused(errors)) => *refused.borrow_mut() = errors,
            Ok(verdict) => {
                built.set(built.get() + 1);
                if let Err(broken) = verdict {
                    *found.borrow_mut() = Some(broken);
                    return false;
                }
            }
        }
        true
    };
    let failure = |text: &str, place: &F::Place| {
        let broken = found.take().unwrap_or_else(|| String::new().into());
        Box::new(Failure {
            plugin: P::TYPE,
            scene: scene::<F>(P::TYPE, text, place, &broken),
            law: broken.law,
        })
    };
    if template.is_fixed() {
        for place in F::fixed() {
            if !check(text, &place) {
                return Err(failure(text, &place));
            }
        }
    }
    let config = Config {
        cases: CASES,
        max_shrink_iters: SHRINKS,
        failure_persistence: None,
        ..Config::default()
    };
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let outcome = runner.run(&(template.texts(), F::places()), |(text, place)| {
        prop_assert!(check(&text, &place));
        Ok(())
    });
    match outcome {
        Err(TestError::Fail(_, (text, place))) => {
            // The last one that was tried may have held.
            check(&text, &place);
            Err(failure(&text, &place))
        }
        Err(TestError::Abort(why)) => panic!("{}: {why}", P::TYPE),
        Ok(()) => {
            assert!(
                built.get() > 0,
                "{} can never be built of \"{text}\": {}",
                P::TYPE,
                refused.borrow()
            );
            Ok(())
        }
    }
}

/// Whether the plugin that a scene shows obeys the laws in it: for the scenes that [`hold`] prints.
///
/// # Errors
///
/// The law that is broken, or why the scene is none of these.
pub fn holds_in<F: Lawful, P: Plugin<F>>(scene: &str, laws: &[fn(&F::Product)]) -> Result<(), String> {
    let document: toml::Table = scene.parse().map_err(|error| format!("{error}"))?;
    let read = F::read(&document, P::TYPE);
    let (table, place) =
        read.ok_or_else(|| format!("the scene shows no {} \"{}\"", F::NAME.singular(), P::TYPE))?;
    match checked::<F, P>(&table.to_string(), &place, laws) {
        Err(Refused(errors)) => Err(errors),
        Ok(verdict) => verdict.map_err(|broken| broken.law),
    }
}

/// The configuration cannot be built.
struct Refused(String);

fn checked<F: Lawful, P: Plugin<F>>(
    text: &str,
    place: &F::Place,
    laws: &[fn(&F::Product)],
) -> Result<Result<(), Broken>, Refused> {
    // What panics while it is built breaks a law too.
    let built = match caught(|| F::built::<P>(text, place)) {
        Err(broken) => return Ok(Err(broken)),
        Ok(built) => built.map_err(|errors| Refused(errors.to_string()))?,
    };
    Ok(caught(|| F::check::<P>(text, &built, place, laws)).and_then(|verdict| verdict))
}

/// The scene that shows a failure, with the law as a comment.
fn scene<F: Lawful>(kind: &str, text: &str, place: &F::Place, broken: &Broken) -> String {
    let mut table: toml::Table = text.parse().unwrap_or_default();
    table.insert("type".to_owned(), kind.into());
    let law: String = broken.law.lines().map(|line| format!("# {line}\n")).collect();
    format!("{law}\n{}", F::scene(table, place, broken))
}

thread_local! {
    /// Whether a panic of this thread is a finding, and no news.
    static QUIET: Cell<bool> = const { Cell::new(false) };
}

/// Runs something that may panic, and gives the panic as a broken law.
pub(crate) fn caught<T>(run: impl FnOnce() -> T) -> Result<T, Broken> {
    static HOOK: Once = Once::new();
    // Shrinking breaks a law hundreds of times; each would be told.
    HOOK.call_once(|| {
        let told = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if !QUIET.get() {
                told(panic);
            }
        }));
    });
    let before = QUIET.replace(true);
    let outcome = catch_unwind(AssertUnwindSafe(run));
    QUIET.set(before);
    outcome.map_err(|payload| {
        let text = payload.downcast_ref::<String>().cloned();
        let text = text.or_else(|| payload.downcast_ref::<&str>().map(|text| (*text).to_owned()));
        text.unwrap_or_else(|| "it panics".to_owned()).into()
    })
}
