//! Laws in random configurations: the same in every run, and shrunk on failure to a scene that
//! demonstrates it.

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

/// Number of configurations drawn for a text with ranges.
const CASES: u32 = 24;
/// Maximum number of shrinking steps.
const SHRINKS: u32 = 256;

/// The law that a plugin breaks, and where.
#[derive(Clone, Debug, PartialEq)]
pub struct Failure {
    /// The type of the plugin.
    pub plugin: &'static str,
    /// A description of the law.
    pub law: String,
    /// A TOML scene that demonstrates it; see [`holds_in`].
    pub scene: String,
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { plugin, law, scene } = self;
        write!(
            f,
            "{plugin} breaks a law: {law}\n\nThe scene below demonstrates it. Inspect it with `render` and `explain --pixel 32,32`, \
             or check the laws again with `whitstone_testkit::holds_in`.\n\n{scene}"
        )
    }
}

/// Checks a plugin against the laws of its family, for each text of its table.
///
/// A number in a text may be a range, `0.1..2`: configurations are then drawn at random, and one
/// that fails is shrunk. `laws` are additional laws or, for materials, all of them. The macros such
/// as `shape_laws!` call this function.
///
/// # Panics
///
/// If a law is broken, with a scene that demonstrates it; and if no drawn configuration can be
/// built.
pub fn hold<F: Lawful, P: Plugin<F>>(texts: &[&str], laws: &[fn(&F::Product)]) {
    for text in if texts.is_empty() { &[""] } else { texts } {
        if let Err(failure) = first_failure::<F, P>(text, laws) {
            panic!("{failure}");
        }
    }
}

/// The result of [`hold`] for one text.
///
/// # Errors
///
/// The failure, shrunk.
///
/// # Panics
///
/// If no drawn configuration can be built.
pub fn first_failure<F: Lawful, P: Plugin<F>>(
    text: &str,
    laws: &[fn(&F::Product)],
) -> Result<(), Box<Failure>> {
    let template = Template::new(text);
    let (built, refused) = (Cell::new(0), RefCell::new(String::new()));
    // The law that the last failing configuration breaks: after shrinking, the smallest one.
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
            // The configuration that was tried last may have passed.
            check(&text, &place);
            Err(failure(&text, &place))
        }
        Err(TestError::Abort(why)) => panic!("{}: {why}", P::TYPE),
        Ok(()) => {
            assert!(
                built.get() > 0,
                "{} cannot be built from any configuration of \"{text}\": {}",
                P::TYPE,
                refused.borrow()
            );
            Ok(())
        }
    }
}

/// Checks the plugin in a scene that [`hold`] printed against the laws.
///
/// # Errors
///
/// The law that is broken, or why the scene is not of this form.
pub fn holds_in<F: Lawful, P: Plugin<F>>(scene: &str, laws: &[fn(&F::Product)]) -> Result<(), String> {
    let document: toml::Table = scene.parse().map_err(|error| format!("{error}"))?;
    let read = F::read(&document, P::TYPE);
    let (table, place) =
        read.ok_or_else(|| format!("the scene contains no {} \"{}\"", F::NAME.singular(), P::TYPE))?;
    match checked::<F, P>(&table.to_string(), &place, laws) {
        Err(Refused(errors)) => Err(errors),
        Ok(verdict) => verdict.map_err(|broken| broken.law),
    }
}

/// The error of a configuration that cannot be built.
struct Refused(String);

fn checked<F: Lawful, P: Plugin<F>>(
    text: &str,
    place: &F::Place,
    laws: &[fn(&F::Product)],
) -> Result<Result<(), Broken>, Refused> {
    // A panic while building breaks a law too.
    let built = match caught(|| F::built::<P>(text, place)) {
        Err(broken) => return Ok(Err(broken)),
        Ok(built) => built.map_err(|errors| Refused(errors.to_string()))?,
    };
    Ok(caught(|| F::check::<P>(text, &built, place, laws)).and_then(|verdict| verdict))
}

/// The scene that demonstrates a failure, with the law as a comment.
fn scene<F: Lawful>(kind: &str, text: &str, place: &F::Place, broken: &Broken) -> String {
    let mut table: toml::Table = text.parse().unwrap_or_default();
    table.insert("type".to_owned(), kind.into());
    let law: String = broken.law.lines().map(|line| format!("# {line}\n")).collect();
    format!("{law}\n{}", F::scene(table, place, broken))
}

thread_local! {
    /// Whether a panic of this thread is an expected finding that must not be printed.
    static QUIET: Cell<bool> = const { Cell::new(false) };
}

/// Runs `run` and converts a panic to a broken law.
pub(crate) fn caught<T>(run: impl FnOnce() -> T) -> Result<T, Broken> {
    static HOOK: Once = Once::new();
    // Shrinking breaks a law hundreds of times; do not print each panic.
    HOOK.call_once(|| {
        let default_hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if !QUIET.get() {
                default_hook(panic);
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
