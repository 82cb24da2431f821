//! Scenes by other people against a live Mitsuba: none is judged wrong, and few are undecided.
//!
//! They have no stored references. Without the Python environment of Mitsuba they are listed as
//! ignored. Of every six, five are ignored unless asked for, since all of them take ten minutes:
//! `cargo test --profile ci -p whitstone-tests --test community -- --include-ignored`.

use libtest_mimic::{Arguments, Failed, Trial};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use whitstone::validate::environment::Environment;
use whitstone::validate::{
    Installation, Mode, Options, OraclePolicy, REFERENCES, Renderer, Status, Validator, find_scenes,
};

/// Scenes that nobody can decide, and why. The list is tested: a scene that is decided must leave
/// it.
const UNDECIDED: [(&str, &str); 0] = [];

/// One of so many scenes runs by default.
const SHARE: usize = 6;

/// Level sets: POV-Ray is their reference.
const WITHOUT_TWIN: [&str; 2] = ["pov_blob", "pov_julia"];

fn options() -> Options {
    Options {
        scenes: PathBuf::from("scenes"),
        references: PathBuf::from(REFERENCES),
        installation: Installation::default(),
        target: PathBuf::from("target/whitstone"),
        renderer: Renderer::MITSUBA,
        mode: Mode::Live,
        reuse: true,
        threads: 0,
        overrides: Vec::new(),
        ours_overrides: Vec::new(),
        shared_overrides: Vec::new(),
        time_limit: Duration::from_secs(600),
        program: "whitstone".to_owned(),
        flags: String::new(),
    }
}

fn judge(path: &Path, validator: &Mutex<Option<Validator<'static>>>) -> Result<(), Failed> {
    let mut validator = validator.lock().unwrap_or_else(|poison| poison.into_inner());
    let validator = match &mut *validator {
        Some(validator) => validator,
        none => {
            let registry = Box::leak(Box::new(whitstone::registry()));
            none.insert(Validator::new(registry, options(), &|_| {})?)
        }
    };
    validator.without_pictures();
    // On a slow or busy machine, too, the verdict is to be the oracle's.
    validator.set_oracle(OraclePolicy {
        budget: Duration::from_secs(300),
        ..OraclePolicy::default()
    });
    let case = validator.validate(path);
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let listed = UNDECIDED.iter().any(|(scene, _)| *scene == name);
    let without_twin = WITHOUT_TWIN.iter().any(|scene| *scene == name);
    let told = format!(
        "{:?}: {}\n{}",
        case.status,
        case.verdict,
        case.problems.join("\n")
    );
    match case.status {
        Some(Status::Pass | Status::Confirmed) if !listed && !without_twin => Ok(()),
        Some(Status::Undecided) if listed => Ok(()),
        Some(Status::Undecided) if without_twin && !case.no_twin.is_empty() => Ok(()),
        _ => Err(told.into()),
    }
}

fn main() {
    let mut arguments = Arguments::from_args();
    // One driver answers for all.
    arguments.test_threads = Some(1);
    // Cargo runs tests in the folder of their package; scenes are named from the repository.
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("the package is in the repository");
    std::env::set_current_dir(root).expect("the repository is there");
    let mitsuba = Environment::existing(&Installation::default()).is_some();
    let scenes = find_scenes(&[PathBuf::from("scenes/community")]).expect("the scenes are there");
    let validator = Arc::new(Mutex::new(None));
    let trials = scenes
        .into_iter()
        .enumerate()
        .map(|(number, path)| {
            let ignored = !mitsuba || number % SHARE != 0;
            let validator = validator.clone();
            Trial::test(path.display().to_string(), move || judge(&path, &validator))
                .with_ignored_flag(ignored)
        })
        .collect();
    libtest_mimic::run(&arguments, trials).exit();
}
