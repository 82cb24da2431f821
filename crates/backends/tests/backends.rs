//! Compares images of backends with ours; tests of Embree are ignored where it is not installed.

#[cfg(any(feature = "embree", feature = "obvhs"))]
mod backends {
    use libtest_mimic::{Failed, Trial};
    use std::path::Path;
    use whitstone::core::{FamilyName, Registry};
    use whitstone::render::{BuildOptions, Pipeline, RenderOptions};
    use whitstone::scene::Sources;

    /// Maximum fraction of pixels that are not close: a ray near an edge may hit another triangle,
    /// and then the pixel shows something else.
    const MAX_OTHERS: f64 = 0.02;

    /// Tolerance of all other pixels: single-precision rounding, carried on by refraction and
    /// reflection.
    const CLOSE: f32 = 1e-3;

    fn registry() -> Registry {
        let mut registry = whitstone::registry();
        // When the whole workspace is built, the features are enabled in both crates.
        if !["embree", "obvhs"]
            .iter()
            .any(|backend| registry.get(FamilyName::Accelerator, backend).is_ok())
        {
            whitstone_backends::register(&mut registry).expect("the types are distinct");
        }
        registry
    }

    /// Renders a small image of a scene with an accelerator. Returns it with the accelerator's
    /// approximation note, or the error report.
    fn picture(scene: &str, accelerator: &str) -> Result<(Vec<[f32; 3]>, Option<String>), String> {
        let registry = registry();
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../../scenes")
            .join(scene);
        let size = "film={ width = 120, height = 90, aovs = [] }".to_owned();
        let overrides = [size, format!("accelerator={accelerator}")];
        let sources = Sources::load(&path, &overrides, &registry)
            .map_err(|error| error.sources.report(&error.errors, false))?;
        let report = |errors| sources.report(&errors, false);
        let pipeline = Pipeline::load(&sources, &registry, BuildOptions::default()).map_err(report)?;
        let approximation_note = pipeline.scene.accelerator.approximation_note().map(str::to_owned);
        Ok((pipeline.render(RenderOptions::default()).rgb, approximation_note))
    }

    fn is_close(a: &[f32; 3], b: &[f32; 3]) -> bool {
        a.iter()
            .zip(b)
            .all(|(a, b)| (a - b).abs() <= CLOSE * (1.0 + b.abs()))
    }

    fn agrees(scene: &str, has_mesh: bool, accelerator: &str) -> Result<(), Failed> {
        let (theirs, approximation_note) = picture(scene, accelerator)?;
        let (ours, none) = picture(scene, "{ type = \"bvh\" }")?;
        let others = theirs.iter().zip(&ours).filter(|(a, b)| !is_close(a, b)).count();
        let differ = theirs.iter().zip(&ours).filter(|(a, b)| a != b).count();
        let all = ours.len();
        println!("{accelerator}, {scene}: {differ} of {all} pixels differ, {others} by more than {CLOSE}");
        if others as f64 > MAX_OTHERS * all as f64 {
            return Err(format!("{others} of {all} pixels are not close").into());
        }
        // A mesh that looks exactly like ours was not rendered by the backend; all else must look
        // exactly like ours.
        if (differ == 0) == has_mesh {
            return Err(format!("{differ} pixels differ").into());
        }
        match (approximation_note, none) {
            (Some(_), None) => Ok(()),
            told => Err(format!("{told:?}").into()),
        }
    }

    fn pictures(accelerator: &'static str) -> impl Iterator<Item = Trial> {
        let scenes = [
            ("showcase/glass_mesh.toml", true),
            ("showcase/textured_mesh.toml", true),
            ("showcase/classic.toml", false),
        ];
        scenes.into_iter().map(move |(scene, has_mesh)| {
            Trial::test(format!("{accelerator} renders {scene}"), move || {
                agrees(scene, has_mesh, accelerator)
            })
        })
    }

    /// Checks the error of a scene with Embree where Embree is missing, by running this program
    /// again with no library to find.
    #[cfg(feature = "embree")]
    fn absent() -> Result<(), Failed> {
        let output = std::process::Command::new(std::env::current_exe()?)
            .env(ABSENT, "1")
            .env("WHITSTONE_EMBREE", "/no/such/library")
            .output()?;
        let said = String::from_utf8_lossy(&output.stdout);
        let expected = [
            "Embree cannot be loaded",
            "accelerator=",
            "install it",
            "libembree3-3",
        ];
        match expected.iter().find(|part| !said.contains(*part)) {
            None => Ok(()),
            Some(part) => Err(format!("\"{part}\" is not in:\n{said}").into()),
        }
    }

    /// Set for the process that [`absent`] runs.
    #[cfg(feature = "embree")]
    pub(super) const ABSENT: &str = "WHITSTONE_TEST_ABSENT";

    #[cfg(feature = "embree")]
    pub(super) fn say_what_is_absent() {
        match picture("showcase/classic.toml", "{ type = \"embree\" }") {
            Ok(_) => println!("it renders"),
            Err(report) => println!("{report}"),
        }
    }

    #[cfg(feature = "embree")]
    pub(super) fn embree() -> Vec<Trial> {
        use whitstone_backends::embree::{Embree, version};
        let laws = || {
            for text in ["", "quality = \"low\"", "quality = \"medium\"", "robust = true"] {
                whitstone_testkit::backend_laws::<Embree>(text);
            }
            Ok(())
        };
        let missing = version().err();
        if let Some(why) = &missing {
            eprintln!("skipped, Embree cannot be loaded: {why}");
        }
        let mut trials = vec![Trial::test("embree obeys the laws of backends", laws)];
        trials.extend(pictures(
            "{ type = \"embree\", quality = \"high\", robust = true }",
        ));
        let mut trials: Vec<Trial> = trials
            .into_iter()
            .map(|trial| trial.with_ignored_flag(missing.is_some()))
            .collect();
        trials.push(Trial::test("embree, where it is absent, is told of", absent));
        trials
    }

    #[cfg(feature = "obvhs")]
    pub(super) fn obvhs() -> Vec<Trial> {
        use whitstone_backends::obvhs::Obvhs;
        let laws = || {
            for text in ["", "quality = \"fastest\"", "structure = \"bvh2\""] {
                whitstone_testkit::backend_laws::<Obvhs>(text);
            }
            Ok(())
        };
        let mut trials = vec![Trial::test("obvhs obeys the laws of backends", laws)];
        trials.extend(pictures("{ type = \"obvhs\" }"));
        trials
    }
}

fn main() {
    #[cfg(feature = "embree")]
    if std::env::var_os(backends::ABSENT).is_some() {
        return backends::say_what_is_absent();
    }
    let mut trials = Vec::new();
    #[cfg(feature = "embree")]
    trials.extend(backends::embree());
    #[cfg(feature = "obvhs")]
    trials.extend(backends::obvhs());
    trials.extend(std::iter::empty::<libtest_mimic::Trial>());
    libtest_mimic::run(&libtest_mimic::Arguments::from_args(), trials).exit();
}
