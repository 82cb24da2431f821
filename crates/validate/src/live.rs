//! A live reference and the cache of its answers.

use crate::driver::{Driver, DriverError};
use crate::environment::Environment;
use crate::explain::{Range, Trial};
use crate::floor;
use crate::hashed;
use crate::protocol::{Coincident, Rendered, SceneText, Setting, Versions};
use crate::renderer::Renderer;
use crate::stop::Stop;
use crate::stored::{Meta, Stored, StoredError};
use crate::variants::Variants;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;
use thiserror::Error;
use whitstone_image::{Image, Limits, atomic, exr_io};
use whitstone_metrics::{Tolerance, metrics};

/// A driver that starts on demand, and a cache folder of its answers.
pub struct Live {
    renderer: Renderer,
    environment: Environment,
    driver: Option<Driver>,
    /// The versions of the renderer; known once the driver has reported them.
    versions: Option<Versions>,
    warning: Option<String>,
    /// Hash of the driver's source and of the variations that measure the floor. Answers with
    /// another hash are not reused.
    driver_hash: String,
    cache: PathBuf,
    reuse: bool,
    limit: Duration,
    stop: Stop,
}

/// Why a live reference is not available.
#[derive(Debug, Error)]
pub enum LiveError {
    /// An error of the driver.
    #[error(transparent)]
    Driver(#[from] DriverError),
    /// An error in the files of the cache.
    #[error(transparent)]
    Stored(#[from] StoredError),
    /// An error in the driver's image.
    #[error("the driver's image: {0}")]
    Image(String),
    /// The environment has another version of Mitsuba than the pinned one.
    #[error("Mitsuba {found} is installed, {pinned} is pinned; remove {} and run again", environment.display())]
    Version {
        /// The version that answered.
        found: String,
        /// The version in the requirements.
        pinned: String,
        /// Folder of the environment.
        environment: PathBuf,
    },
}

/// The error of a driver's image that cannot be compared with a variant of itself.
fn unusable(error: metrics::CompareError) -> LiveError {
    LiveError::Image(match error {
        metrics::CompareError::NotFinite { count, .. } => format!(
            "{} of its values are not finite; they may exceed single precision",
            count.ours.max(count.reference)
        ),
        error => error.to_string(),
    })
}

#[derive(Default, Serialize, Deserialize)]
struct ProbeCache {
    /// Maps "x,y" to the values of all trials. `None` stands for a number that JSON cannot
    /// represent.
    pixels: BTreeMap<String, Vec<Vec<[Option<f64>; 3]>>>,
}

impl Live {
    /// Starts the driver once to query its versions. `cache` is a folder for its answers, which are
    /// reused if `reuse` is set.
    pub fn start(
        renderer: Renderer,
        environment: Environment,
        cache: PathBuf,
        reuse: bool,
        limit: Duration,
    ) -> Result<Self, LiveError> {
        // What a killed process has left.
        atomic::sweep(&cache);
        let driver_hash = hash_sources(renderer, &environment);
        let hello_path = cache.join(format!("hello-{driver_hash}.json"));
        // Another installation may have changed.
        let is_private = environment.is_private;
        let known = std::fs::read(&hello_path).ok().filter(|_| reuse && is_private);
        let mut live = Self {
            renderer,
            environment,
            driver: None,
            versions: None,
            warning: None,
            driver_hash,
            cache,
            reuse,
            limit,
            stop: Stop::default(),
        };
        let versions = match known.and_then(|bytes| hashed::from_bytes(&bytes)) {
            Some(versions) => versions,
            None => {
                let versions = renderer.versions(live.driver()?)?;
                let text =
                    hashed::to_bytes(&versions).map_err(|error| LiveError::Image(error.to_string()))?;
                write(&hello_path, &text)?;
                versions
            }
        };
        live.check_version(&versions)?;
        if !is_private {
            // The cached images are those of the installed version.
            let version = match &versions {
                Versions::Mitsuba(found) => &found.mitsuba,
                Versions::PovRay(found) => &found.povray,
            };
            let version = blake3::hash(version.as_bytes()).to_hex();
            live.driver_hash = format!("{}-{}", live.driver_hash, &version[..6]);
        }
        live.versions = Some(versions);
        Ok(live)
    }

    /// Rejects another version in the private environment: its images would be compared under wrong
    /// assumptions. In the user's own environment it leads to a warning.
    fn check_version(&mut self, versions: &Versions) -> Result<(), LiveError> {
        let Versions::Mitsuba(hello) = versions else {
            // The driver itself checks the version.
            return Ok(());
        };
        let requirements = self.environment.package.join("requirements.txt");
        let text = std::fs::read_to_string(requirements).unwrap_or_default();
        let pinned = text
            .lines()
            .find_map(|line| line.strip_prefix("mitsuba=="))
            .and_then(|rest| rest.split_whitespace().next());
        match pinned {
            Some(pinned) if pinned != hello.mitsuba && self.environment.is_private => {
                Err(LiveError::Version {
                    found: hello.mitsuba.clone(),
                    pinned: pinned.to_owned(),
                    environment: self.environment.folder().to_owned(),
                })
            }
            Some(pinned) if pinned != hello.mitsuba => {
                self.warning = Some(format!(
                    "{} has Mitsuba {}; the driver and its tolerances are tested with {pinned}",
                    self.environment.python.display(),
                    hello.mitsuba
                ));
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// Sets the request that stops the driver.
    pub fn set_stop(&mut self, stop: Stop) {
        if let Some(driver) = &mut self.driver {
            driver.set_stop(stop.clone());
        }
        self.stop = stop;
    }

    /// What is unusual about the installation.
    pub fn warning(&self) -> Option<&str> {
        self.warning.as_deref()
    }

    /// The renderer.
    pub fn renderer(&self) -> Renderer {
        self.renderer
    }

    /// The versions; `None` only before the driver has reported them.
    pub fn versions(&self) -> Option<&Versions> {
        self.versions.as_ref()
    }

    /// The driver, started if it is not running.
    pub fn driver(&mut self) -> Result<&mut Driver, DriverError> {
        let driver = match self.driver.take() {
            Some(driver) => driver,
            None => {
                let mut driver = Driver::start(&self.environment, self.limit)?;
                driver.set_stop(self.stop.clone());
                driver
            }
        };
        Ok(self.driver.insert(driver))
    }

    /// Sends a request to the driver. If the driver itself fails, it is dropped, and the next
    /// request starts another one.
    fn ask<T>(
        &mut self,
        question: impl FnOnce(&mut Driver) -> Result<T, DriverError>,
    ) -> Result<T, DriverError> {
        let result = question(self.driver()?);
        if !matches!(
            result,
            Ok(_) | Err(DriverError::Refused(_) | DriverError::Unsupported(_))
        ) {
            self.driver = None;
        }
        result
    }

    fn folder(&self, scene_hash: &str) -> PathBuf {
        self.cache.join(format!("{scene_hash}-{}", self.driver_hash))
    }

    /// The reference of a scene with its measured floor, rendered or taken from an earlier run.
    ///
    /// `progress` receives the number of finished renderings and their total.
    pub fn reference(
        &mut self,
        scene: SceneText<'_>,
        scene_hash: &str,
        progress: &dyn Fn(usize, usize),
    ) -> Result<Stored, LiveError> {
        let folder = self.folder(scene_hash);
        if self.reuse
            && let Ok(stored) = Stored::read(&folder, self.renderer(), scene_hash)
        {
            return Ok(stored);
        }
        let variations = self.renderer().variations();
        progress(0, 1 + variations.len());
        let (image, rendered) = self.render(scene, Setting::default())?;
        let mut worst = floor::SMALLEST_FLOOR;
        let mut moved = 0;
        for (done, &setting) in variations.iter().enumerate() {
            progress(1 + done, 1 + variations.len());
            let (varied, _) = self.render(scene, setting)?;
            let between = floor::between(&image, &varied).map_err(unusable)?;
            worst = worst.max(between.error);
            moved = moved.max(between.moved);
        }
        let [version, variant, libllvm, cpu] = match &self.versions {
            Some(Versions::Mitsuba(hello)) => [
                hello.mitsuba.clone(),
                hello.variant.clone(),
                format!("{} ({})", hello.libllvm, hello.llvm_version),
                hello.cpu.clone(),
            ],
            Some(Versions::PovRay(found)) => [
                found.povray.clone(),
                String::new(),
                String::new(),
                found.cpu.clone(),
            ],
            None => Default::default(),
        };
        let stored = Stored {
            variants: Variants::default(),
            image,
            meta: Meta {
                renderer: self.renderer().name().to_owned(),
                version,
                variant,
                integrator: rendered.integrator,
                k: Setting::default().k,
                libllvm,
                cpu,
                scene_hash: scene_hash.to_owned(),
                hash: String::new(),
                twin: rendered.twin,
                floor: worst,
                moved: Some(moved),
                samples: rendered.samples,
                seconds: rendered.seconds.trace,
                rays: [rendered.rays.closest, rendered.rays.shadow],
                rehits: rendered.rehits,
                notes: rendered.coincident.iter().filter_map(Coincident::note).collect(),
            },
        };
        let renderer = self.renderer();
        remove_link(&folder)?;
        for name in [
            renderer.image_file(),
            renderer.variants_file(),
            renderer.meta_file(),
        ] {
            remove_link(&folder.join(name))?;
        }
        stored.write(&folder, renderer)?;
        Ok(stored)
    }

    fn render(&mut self, scene: SceneText<'_>, setting: Setting) -> Result<(Image, Rendered), LiveError> {
        std::fs::create_dir_all(&self.cache).map_err(DriverError::Io)?;
        // Concurrent runs must not share the file.
        let folder = atomic::TemporaryFolder::new_in(&self.cache).map_err(DriverError::Io)?;
        // The driver may have another working folder.
        let out = std::path::absolute(folder.path().join("image.exr")).map_err(DriverError::Io)?;
        let renderer = self.renderer();
        let rendered = self.ask(|driver| renderer.render(driver, scene, &out, setting))?;
        let image = exr_io::read(&out, Limits::IMAGE).map_err(|e| LiveError::Image(e.to_string()))?;
        Ok((image, rendered))
    }

    /// The values of pixels under trials: `[pixel][trial][setting]`.
    pub fn probe(
        &mut self,
        scene: SceneText<'_>,
        scene_hash: &str,
        pixels: &[[usize; 2]],
        trials: &[Trial],
    ) -> Result<Vec<Vec<Vec<[f64; 3]>>>, LiveError> {
        let of_trials = blake3::hash(format!("{trials:?}").as_bytes()).to_hex();
        let name = format!("probes-{}.json", &of_trials[..12]);
        let path = self.folder(scene_hash).join(name);
        let known = std::fs::read(&path).ok().filter(|_| self.reuse);
        let mut cache: ProbeCache = known
            .and_then(|bytes| hashed::from_bytes(&bytes))
            .unwrap_or_default();
        let key = |[x, y]: [usize; 2]| format!("{x},{y}");
        let missing: Vec<[usize; 2]> = pixels
            .iter()
            .copied()
            .filter(|pixel| {
                cache
                    .pixels
                    .get(&key(*pixel))
                    .is_none_or(|found| !fits(found, trials))
            })
            .collect();
        if !missing.is_empty() {
            let settings: Vec<Setting> = trials.iter().flat_map(|trial| trial.settings.clone()).collect();
            let values = self.ask(|driver| driver.probe(scene, &missing, &settings))?;
            for (index, pixel) in missing.iter().enumerate() {
                let mut of_pixel = values.iter().map(|setting| setting[index].map(finite));
                let grouped = trials
                    .iter()
                    .map(|trial| of_pixel.by_ref().take(trial.settings.len()).collect())
                    .collect();
                cache.pixels.insert(key(*pixel), grouped);
            }
            let text = hashed::to_bytes(&cache).map_err(|error| LiveError::Image(error.to_string()))?;
            write(&path, &text)?;
        }
        let plain = |pixel: &[usize; 2]| -> Vec<Vec<[f64; 3]>> {
            cache.pixels[&key(*pixel)]
                .iter()
                .map(|trial| trial.iter().map(|v| v.map(|c| c.unwrap_or(f64::NAN))).collect())
                .collect()
        };
        Ok(pixels.iter().map(plain).collect())
    }

    /// The ray tree of a sample of a pixel.
    pub fn tree(
        &mut self,
        scene: SceneText<'_>,
        pixel: [usize; 2],
        sample: u32,
    ) -> Result<Vec<crate::tree::Node>, DriverError> {
        self.ask(|driver| driver.tree(scene, pixel, sample))
    }

    /// A reference to be stored. It includes its values in each pixel that varies, so that edges
    /// can be distinguished from faults without a live renderer.
    ///
    /// `progress` receives the number of finished renderings and their total.
    pub fn reference_with_variants(
        &mut self,
        scene: SceneText<'_>,
        scene_hash: &str,
        progress: &dyn Fn(usize, usize),
    ) -> Result<Stored, LiveError> {
        let mut stored = self.reference(scene, scene_hash, progress)?;
        let mean = metrics::mean_reference(&stored.image).map_err(|e| LiveError::Image(e.to_string()))?;
        let Tolerance { relative, absolute } = Tolerance::default();
        let (width, pixels) = (stored.image.width(), stored.image.pixel_count());
        let at = |image: &Image, index: usize| -> Option<[f64; 3]> {
            let planes = image.rgb().ok()?;
            Some(planes.map(|plane| f64::from(plane[index])))
        };
        let nominal: Vec<[f64; 3]> = (0..pixels)
            .map(|index| at(&stored.image, index).unwrap_or([0.0; 3]))
            .collect();
        let settings: Vec<Setting> = (self.renderer().trials().into_iter())
            .flat_map(|trial| trial.settings)
            .collect();
        let mut ranges: Vec<Range> = nominal.iter().map(|value| Range::of(*value)).collect();
        let mut variants = Variants::default();
        for (done, setting) in settings.iter().enumerate() {
            progress(done, settings.len());
            let (varied, _) = self.render(scene, *setting)?;
            for (index, range) in ranges.iter_mut().enumerate() {
                if let Some(value) = at(&varied, index) {
                    range.include(value);
                    let tolerance = nominal[index].map(|v| relative * v.abs() + absolute * mean);
                    variants.add([index % width, index / width], nominal[index], value, tolerance);
                }
            }
        }
        let kept: Vec<Option<Range>> = (ranges.into_iter().enumerate())
            .map(|(index, range)| {
                let varies = variants.of([index % width, index / width]).is_some();
                varies.then_some(range)
            })
            .collect();
        variants.keep_beyond(|value| value.map(|v| relative * v.abs() + absolute * mean));
        Stored::add_ranges(&mut stored.image, &kept)?;
        stored.variants = variants;
        Ok(stored)
    }
}

fn fits(values: &[Vec<[Option<f64>; 3]>], trials: &[Trial]) -> bool {
    values.len() == trials.len()
        && values
            .iter()
            .zip(trials)
            .all(|(v, t)| v.len() == t.settings.len())
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// A link in the cache must not lead to other files, which would be overwritten.
fn remove_link(path: &Path) -> Result<(), LiveError> {
    atomic::remove_link(path).map_err(|error| LiveError::Driver(DriverError::Io(error)))
}

/// Writes a file of the cache.
fn write(path: &Path, bytes: &[u8]) -> Result<(), LiveError> {
    remove_link(path)?;
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(DriverError::Io)?;
    }
    atomic::write_bytes(path, bytes).map_err(|error| LiveError::Image(error.to_string()))
}

/// A hash of the driver's Python files and requirements, of the package that all drivers share, and
/// of the driver's requests for a floor. Answers are reused only if it is unchanged.
pub fn hash_sources(renderer: Renderer, environment: &Environment) -> String {
    let Environment {
        package,
        module,
        twins,
        ..
    } = environment;
    let mut files = vec![package.join("requirements.txt")];
    files.extend_from_slice(twins);
    let mut open = vec![
        package.join(module),
        package.with_file_name("protocol").join("whitstone_protocol"),
    ];
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|extension| extension == "py") {
                files.push(path);
            }
        }
    }
    files.sort();
    let mut hasher = blake3::Hasher::new();
    hasher.update(format!("{:?}", renderer.variations()).as_bytes());
    for path in files {
        hasher.update(&std::fs::read(&path).unwrap_or_default());
    }
    hasher.finalize().to_hex()[..12].to_owned()
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::explain::Reason;
    use std::fs;
    use std::process::Command;

    /// A driver that counts its requests in a file, and whose values are always the same.
    fn live(folder: &Path) -> Live {
        let script =
            r#"while read -r line; do echo >>"$0"; echo '{"ok":true,"values":[[[0.25,1.5,2]]]}'; done"#;
        let mut command = Command::new("sh");
        command.args(["-c", script]).arg(folder.join("requests"));
        let limit = Duration::from_secs(60);
        Live {
            renderer: Renderer::MITSUBA,
            environment: Environment {
                python: PathBuf::new(),
                package: PathBuf::new(),
                module: "",
                twins: Vec::new(),
                is_private: true,
            },
            driver: Some(Driver::spawn(command, limit).unwrap()),
            versions: None,
            warning: None,
            driver_hash: "d".to_owned(),
            cache: folder.to_owned(),
            reuse: true,
            limit,
            stop: Stop::default(),
        }
    }

    /// Even if it is still a JSON file.
    #[test]
    fn damaged_probes_are_made_again() {
        let folder = tempfile::tempdir().unwrap();
        let trials = [Trial {
            reason: Reason::Stored,
            settings: vec![Setting::default()],
        }];
        let probe = || {
            let scene = SceneText {
                text: "",
                base: Path::new(""),
            };
            let found = live(folder.path()).probe(scene, "s", &[[3, 4]], &trials).unwrap();
            assert_eq!(found, [[[[0.25, 1.5, 2.0]]]]);
            fs::read_to_string(folder.path().join("requests"))
                .unwrap()
                .lines()
                .count()
        };
        assert_eq!([probe(), probe()], [1, 1]);
        let kept = fs::read_dir(folder.path().join("s-d"))
            .unwrap()
            .next()
            .unwrap()
            .unwrap();
        let text = fs::read_to_string(kept.path()).unwrap();
        fs::write(kept.path(), text.replace("0.25", "0.75")).unwrap();
        assert_eq!([probe(), probe()], [2, 2]);
        fs::write(kept.path(), &text[..text.len() / 2]).unwrap();
        assert_eq!(probe(), 3);
    }
}
