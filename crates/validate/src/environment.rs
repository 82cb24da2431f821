//! The drivers of the references and their Python: a private environment for Mitsuba, the system's
//! Python for POV-Ray.

use etcetera::BaseStrategy as _;
use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};
use thiserror::Error;
use whitstone_core::Registry;
use whitstone_image::atomic;
use whitstone_references::FILES;

/// The default folder of the stored references, relative to the current one.
pub const REFERENCES: &str = "references/images";

/// The default folder of results and caches, relative to the current one.
pub const TARGET: &str = "target/whitstone";

/// Time limit for the installation: Mitsuba is a download of about 100 MB.
const INSTALL_LIMIT: Duration = Duration::from_secs(900);

/// The oldest Python 3 that Mitsuba supports (minor version).
const MINOR: u32 = 9;
/// The oldest Python 3 with a TOML parser in its standard library (minor version).
const MINOR_OF_POVRAY: u32 = 11;

/// The oldest Python 3 that Dask supports (minor version).
const MINOR_OF_DASK: u32 = 10;

/// The Python package of Mitsuba's driver.
const MODULE: &str = "whitstone_mitsuba";
/// The Python package of POV-Ray's driver.
const MODULE_OF_POVRAY: &str = "whitstone_povray";

/// Where the drivers and the Python environment of Mitsuba are.
///
/// By default they are in the user's cache folder, so that all projects share them.
#[derive(Clone, Debug)]
pub struct Installation {
    /// Folder for the unpacked drivers and the Python environment.
    pub folder: PathBuf,
    /// Folder with `mitsuba`, `povray` and `protocol`, in place of the drivers in this program.
    pub drivers: Option<PathBuf>,
    /// A Python with Mitsuba, in place of the private environment.
    pub mitsuba: Option<PathBuf>,
}

impl Default for Installation {
    /// Where there is no home folder, the drivers are next to the results.
    fn default() -> Self {
        let user = etcetera::choose_base_strategy();
        Self::at(user.map_or_else(|_| TARGET.into(), |user| user.cache_dir().join("whitstone")))
    }
}

impl Installation {
    /// An installation in a folder.
    pub fn at(folder: PathBuf) -> Self {
        Self {
            folder,
            drivers: None,
            mitsuba: None,
        }
    }

    /// The folder with `mitsuba`, `povray` and `protocol`. Writes the drivers of this program if
    /// they are not there, or are not those of this program.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn drivers(&self) -> Result<PathBuf, EnvironmentError> {
        if let Some(folder) = &self.drivers {
            return Ok(folder.clone());
        }
        let mut hasher = blake3::Hasher::new();
        for file in FILES {
            hasher.update(file.path.as_bytes()).update(file.bytes);
        }
        let folder = self
            .folder
            .join(format!("drivers-{}", &hasher.finalize().to_hex()[..12]));
        for file in FILES {
            let path = folder.join(file.path);
            if fs::read(&path).is_ok_and(|bytes| bytes == file.bytes) {
                continue;
            }
            let parent = path.parent().unwrap_or(&folder);
            fs::create_dir_all(parent)
                .map_err(|error| error.to_string())
                .and_then(|()| atomic::write_bytes(&path, file.bytes).map_err(|error| error.to_string()))
                .map_err(|problem| EnvironmentError::Drivers {
                    folder: folder.clone(),
                    problem,
                })?;
        }
        Ok(folder)
    }
}

/// An environment in which a driver can run.
#[derive(Clone, Debug)]
pub struct Environment {
    /// The interpreter of the environment.
    pub python: PathBuf,
    /// Folder that contains the driver's Python package. Third-party plugins refer to the renderer
    /// by the name of this folder.
    pub package: PathBuf,
    /// Name of the driver's Python package.
    pub module: &'static str,
    /// Files with the twins of third-party plugins.
    pub twins: Vec<PathBuf>,
    /// Whether the renderer is installed for Whitstone alone, so that its version changes only with
    /// its requirements.
    pub is_private: bool,
}

/// Why there is no environment, and how to fix it.
#[derive(Debug, Error)]
pub enum EnvironmentError {
    /// No usable Python.
    #[error(
        "no Python 3.{minor} or newer was found (tried {tried}); install one, or set `WHITSTONE_PYTHON` to its path"
    )]
    NoPython {
        /// The oldest usable minor version.
        minor: u32,
        /// The interpreters that were tried, and the results.
        tried: String,
    },
    /// The given folder has no drivers.
    #[error("the driver of the reference is not in {}; `--drivers` takes the folder `references` of a Whitstone checkout", .0.display())]
    NoPackage(PathBuf),
    /// The drivers of this program cannot be written.
    #[error("cannot write the drivers of the references to {}: {problem}; choose another folder with `--target`", folder.display())]
    Drivers {
        /// Their folder.
        folder: PathBuf,
        /// The cause.
        problem: String,
    },
    /// The Python environment cannot be written.
    #[error("cannot write the Python environment of {of} to {}: {problem}; choose another folder with `--target`, or use an installed {of} with `--{}`", folder.display(), of.to_lowercase())]
    Folder {
        /// The program that it is for.
        of: &'static str,
        /// Its folder.
        folder: PathBuf,
        /// The cause.
        problem: std::io::Error,
    },
    /// The given Python does not work.
    #[error("`--mitsuba {}`: {problem}", python.display())]
    Python {
        /// The given interpreter.
        python: PathBuf,
        /// The cause.
        problem: String,
    },
    /// A step of the installation failed.
    #[error("cannot {step}:\n{output}")]
    Step {
        /// The name of the step.
        step: &'static str,
        /// Its output, or why it did not run.
        output: String,
    },
}

impl Environment {
    /// The environment of Mitsuba, created on first use. Calls `say` before slow steps.
    ///
    /// Its folder is keyed by the pinned requirements and the Python that created it, so a change
    /// of either creates a new one. Concurrent processes wait for each other.
    pub fn ensure(installation: &Installation, say: &dyn Fn(&str)) -> Result<Self, EnvironmentError> {
        if let Some(environment) = Self::given(installation)? {
            return Ok(environment);
        }
        let (place, environment) = Self::private(installation)?;
        place.ensure(say, || {
            say("installing Mitsuba (once; about 100 MB)");
            run(
                &mut environment.install("requirements.txt"),
                "install Mitsuba (is PyPI reachable?)",
            )?;
            // The package is for this platform only. Elsewhere the driver says what is missing.
            if cfg!(all(target_os = "linux", target_arch = "x86_64")) && !environment.finds_llvm() {
                say("installing LLVM (once; about 35 MB), because this machine has no libLLVM 16 or newer");
                run(
                    &mut environment.install("requirements-llvm.txt"),
                    "install LLVM (is PyPI reachable? A system package such as libllvm19 serves as well)",
                )?;
            }
            Ok(())
        })?;
        Ok(environment)
    }

    /// The private environment, whether or not it exists.
    fn private(installation: &Installation) -> Result<(Place, Self), EnvironmentError> {
        let package = installation.drivers()?.join("mitsuba");
        let Ok(pinned) = fs::read(package.join("requirements.txt")) else {
            return Err(EnvironmentError::NoPackage(package));
        };
        let place = Place::find(installation, "Mitsuba", &pinned, MINOR)?;
        let environment = Self {
            python: interpreter(&place.folder),
            package,
            module: MODULE,
            twins: Vec::new(),
            is_private: true,
        };
        Ok((place, environment))
    }

    /// The environment of Mitsuba if it exists.
    pub fn existing(installation: &Installation) -> Option<Self> {
        if let Some(environment) = Self::given(installation).ok()? {
            return Some(environment);
        }
        let (place, environment) = Self::private(installation).ok()?;
        place.is_complete().then_some(environment)
    }

    /// The environment that the installation names, if it names one.
    fn given(installation: &Installation) -> Result<Option<Self>, EnvironmentError> {
        let Some(python) = &installation.mitsuba else {
            return Ok(None);
        };
        if let Err(problem) = version_of(python) {
            return Err(EnvironmentError::Python {
                python: python.clone(),
                problem,
            });
        }
        Ok(Some(Self {
            // The driver may run in another folder.
            python: if python.components().count() > 1 {
                std::path::absolute(python).unwrap_or_else(|_| python.clone())
            } else {
                python.clone()
            },
            package: installation.drivers()?.join("mitsuba"),
            module: MODULE,
            twins: Vec::new(),
            is_private: false,
        }))
    }

    /// The system's Python with the driver of POV-Ray, which needs nothing else.
    pub fn of_povray(installation: &Installation) -> Result<Self, EnvironmentError> {
        let package = installation.drivers()?.join("povray");
        if !package.join(MODULE_OF_POVRAY).is_dir() {
            return Err(EnvironmentError::NoPackage(package));
        }
        Ok(Self {
            python: find_python(MINOR_OF_POVRAY)?.0,
            package,
            module: MODULE_OF_POVRAY,
            twins: Vec::new(),
            is_private: false,
        })
    }

    /// Adds the twins of the registry's third-party plugins, which are written below `target`.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn with_twins(mut self, registry: &Registry, target: &Path) -> std::io::Result<Self> {
        let renderer = self.package.file_name().and_then(OsStr::to_str);
        for twin in registry.twins(renderer.unwrap_or_default()) {
            let hash = blake3::hash(twin.text.as_bytes()).to_hex();
            let folder = target.join("twins").join(&hash[..12]);
            fs::create_dir_all(&folder)?;
            let path = std::path::absolute(folder.join(twin.file))?;
            atomic::write_bytes(&path, twin.text.as_bytes()).map_err(std::io::Error::other)?;
            self.twins.push(path);
        }
        Ok(self)
    }

    /// The folder of the environment, which is the parent of its folder of programs.
    pub fn folder(&self) -> &Path {
        let programs = self.python.parent();
        programs.and_then(Path::parent).unwrap_or(&self.python)
    }

    /// The command that installs pinned requirements of the driver.
    fn install(&self, requirements: &str) -> Command {
        install(&self.python, &self.package.join(requirements))
    }

    /// Whether the driver finds the LLVM that Dr.Jit needs.
    fn finds_llvm(&self) -> bool {
        let status = Command::new(&self.python)
            .args(["-m", "whitstone_mitsuba.llvm"])
            .env("PYTHONPATH", &self.package)
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status();
        status.is_ok_and(|status| status.success())
    }
}

/// The place of a private Python environment, whether or not it exists.
struct Place {
    /// The program that it is for.
    of: &'static str,
    /// The interpreter that creates it, and its version.
    python: PathBuf,
    version: String,
    folder: PathBuf,
}

impl Place {
    /// The place for these pinned requirements and the first Python of the minor version or newer.
    fn find(
        installation: &Installation,
        of: &'static str,
        pinned: &[u8],
        minor: u32,
    ) -> Result<Self, EnvironmentError> {
        let (python, version) = find_python(minor)?;
        let mut hasher = blake3::Hasher::new();
        hasher.update(pinned).update(version.as_bytes());
        let key = &hasher.finalize().to_hex()[..12];
        let folder = installation.folder.join(format!("python-{key}"));
        Ok(Self {
            of,
            python,
            version,
            folder,
        })
    }

    fn is_complete(&self) -> bool {
        self.folder.join("complete").is_file() && interpreter(&self.folder).exists()
    }

    /// Creates the environment if it does not exist. Concurrent processes wait for each other.
    fn ensure(
        &self,
        say: &dyn Fn(&str),
        install: impl FnOnce() -> Result<(), EnvironmentError>,
    ) -> Result<(), EnvironmentError> {
        let folder = &self.folder;
        let complete = folder.join("complete");
        if self.is_complete() {
            return Ok(());
        }
        let unwritable = |problem| EnvironmentError::Folder {
            of: self.of,
            folder: folder.clone(),
            problem,
        };
        let lock = File::create(folder.with_extension("lock")).map_err(unwritable)?;
        lock.lock().map_err(unwritable)?;
        if complete.is_file() {
            return Ok(());
        }
        // The remains of an interrupted installation.
        if folder.exists() {
            fs::remove_dir_all(folder).map_err(unwritable)?;
        }
        say(&format!("creating a Python environment in {}", folder.display()));
        run(
            Command::new(&self.python).args(["-m", "venv"]).arg(folder),
            "create a Python environment (on Debian: apt-get install python3-venv)",
        )?;
        install()?;
        fs::write(&complete, &self.version).map_err(unwritable)
    }
}

/// The Python of Dask in a private environment, created on first use, like that of Mitsuba.
/// `requirements` is a file with the pinned packages. Calls `say` before slow steps.
///
/// # Errors
/// If there is no Python, or a step of the installation fails.
pub fn dask_python(
    installation: &Installation,
    requirements: &Path,
    say: &dyn Fn(&str),
) -> Result<PathBuf, EnvironmentError> {
    let unwritable = |problem| EnvironmentError::Folder {
        of: "Dask",
        folder: installation.folder.clone(),
        problem,
    };
    let pinned = fs::read(requirements).map_err(unwritable)?;
    let place = Place::find(installation, "Dask", &pinned, MINOR_OF_DASK)?;
    let python = interpreter(&place.folder);
    place.ensure(say, || {
        say("installing Dask (once; about 10 MB)");
        run(
            &mut install(&python, requirements),
            "install Dask (is PyPI reachable?)",
        )
    })?;
    Ok(python)
}

/// The command that installs pinned requirements.
fn install(python: &Path, requirements: &Path) -> Command {
    let mut command = Command::new(python);
    command
        .args(["-m", "pip", "install", "--disable-pip-version-check"])
        .args(["--no-input", "-q", "--require-hashes", "-r"])
        .arg(requirements);
    command
}

fn interpreter(folder: &Path) -> PathBuf {
    if cfg!(windows) {
        folder.join("Scripts").join("python.exe")
    } else {
        folder.join("bin").join("python")
    }
}

/// The first Python that is new enough, and its version.
fn find_python(minor: u32) -> Result<(PathBuf, String), EnvironmentError> {
    let named = std::env::var_os("WHITSTONE_PYTHON").map(PathBuf::from);
    let candidates = match named {
        Some(python) => vec![python],
        None => ["python3", "python"].map(PathBuf::from).to_vec(),
    };
    let mut tried = Vec::new();
    for python in candidates {
        let version = version_of(&python).unwrap_or_else(|problem| problem);
        let mut numbers = version.split('.').map(|part| part.parse::<u32>().unwrap_or(0));
        if (numbers.next().unwrap_or(0), numbers.next().unwrap_or(0)) >= (3, minor) {
            return Ok((python, version));
        }
        tried.push(format!("{}: {version}", python.display()));
    }
    Err(EnvironmentError::NoPython {
        minor,
        tried: tried.join("; "),
    })
}

/// The version of a Python, such as "3.11.2", or why it has none.
fn version_of(python: &Path) -> Result<String, String> {
    let script = "import sys; print('%d.%d.%d' % sys.version_info[:3])";
    let output = Command::new(python)
        .args(["-c", script])
        .stdin(Stdio::null())
        .output();
    match output {
        Ok(output) if output.status.success() => {
            Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
        }
        Ok(output) => Err(format!("fails with {}", output.status)),
        Err(error) => Err(error.to_string()),
    }
}

/// Runs a step until it ends or reaches the time limit.
fn run(command: &mut Command, step: &'static str) -> Result<(), EnvironmentError> {
    let fail = |output: String| EnvironmentError::Step { step, output };
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|error| fail(error.to_string()))?;
    let stderr = child.stderr.take();
    let reader = thread::Builder::new().spawn(move || {
        let mut text = Vec::new();
        if let Some(stderr) = stderr {
            // The text before a read error is still useful.
            let _ = stderr.take(1 << 20).read_to_end(&mut text);
        }
        String::from_utf8_lossy(&text).into_owned()
    });
    let reader = reader.map_err(|error| {
        let _ = child.kill();
        let _ = child.wait();
        fail(error.to_string())
    })?;
    let start = Instant::now();
    let status = loop {
        match child.try_wait() {
            Ok(Some(status)) => break status,
            Ok(None) if start.elapsed() < INSTALL_LIMIT => thread::sleep(Duration::from_millis(50)),
            Ok(None) => {
                let _ = child.kill();
                let _ = child.wait();
                return Err(fail(format!("not finished after {} s", INSTALL_LIMIT.as_secs())));
            }
            Err(error) => return Err(fail(error.to_string())),
        }
    };
    if status.success() {
        return Ok(());
    }
    let text = reader.join().unwrap_or_default();
    let mut lines: Vec<&str> = text.lines().collect();
    // pip repeats the fault of the network for each try.
    let is_retry = |line: &str| line.starts_with("WARNING: Retrying");
    lines.dedup_by(|second, first| is_retry(second) && is_retry(first));
    let tail = lines[lines.len().saturating_sub(20)..].join("\n");
    Err(fail(format!("{status}\n{tail}")))
}
