//! Mitsuba's own integrators on the scene that `convert` exports, in a process of their own. No
//! Python runs while they render.
//!
//! They follow one random branch per hit and choose one random point of a light, so their images
//! are noisy.

use crate::environment::Environment;
use crate::lifeline::{self, Lifeline};
use serde::Deserialize;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use whitstone_core::{ExportScene, Registry, Treatment};
use whitstone_scene::Flattened;

/// Answers each line of standard input with a line of JSON.
const PROGRAM: &str = "
import json, sys, time
import whitstone_mitsuba
from whitstone_protocol.serve import end_with_the_parent
end_with_the_parent()
from whitstone_mitsuba.runtime import dr, mi
mi.set_variant(sys.argv[1])
dr.set_thread_count(int(sys.argv[2]))
scene = image = None
for line in sys.stdin:
    words = line.rstrip('\\n').split(' ', 2)
    wall, processor = time.perf_counter(), time.process_time()
    if words[0] == 'load':
        scene = mi.load_file(words[2])
    elif words[0] == 'render':
        image = mi.render(scene, spp=int(words[1]), seed=int(words[2]))
        if 'llvm' in sys.argv[1]:
            dr.eval(image)
            dr.sync_thread()
    elif words[0] == 'write':
        mi.Bitmap(image).write(words[2])
    times = {'wall': time.perf_counter() - wall, 'processor': time.process_time() - processor}
    print(json.dumps(times), flush=True)
";

/// Times of a request, in seconds.
#[derive(Clone, Copy, Debug, Deserialize)]
pub struct Seconds {
    /// Wall time.
    pub wall: f64,
    /// Processor time of all threads.
    pub processor: f64,
}

/// A process of one variant of Mitsuba, such as `llvm_ad_rgb`. It ends when this is dropped, or
/// soon after this process has ended.
pub struct ExportedMitsuba {
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
    _lifeline: Lifeline,
}

impl ExportedMitsuba {
    /// Starts it; 0 threads mean one per core.
    ///
    /// # Errors
    ///
    /// If the process cannot be started.
    pub fn start(environment: &Environment, variant: &str, threads: usize) -> Result<Self, String> {
        let threads = match threads {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            count => count,
        };
        let mut command = Command::new(&environment.python);
        command
            .args(["-c", PROGRAM, variant, &threads.to_string()])
            .env("PYTHONPATH", &environment.package)
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped());
        let (mut child, lifeline) =
            lifeline::spawn(&mut command).map_err(|error| format!("cannot start Mitsuba: {error}"))?;
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            unreachable!("both are configured as pipes");
        };
        let output = BufReader::new(output);
        Ok(Self {
            child,
            input,
            output,
            _lifeline: lifeline,
        })
    }

    /// The number of the process.
    pub fn process(&self) -> u32 {
        self.child.id()
    }

    /// Loads a scene.
    ///
    /// # Errors
    ///
    /// If Mitsuba fails; its message is on standard error.
    pub fn load(&mut self, file: &Path) -> Result<Seconds, String> {
        self.ask(&format!("load 0 {}", file.display()))
    }

    /// Renders the loaded scene. The first rendering compiles kernels.
    ///
    /// # Errors
    ///
    /// As [`Self::load`].
    pub fn render(&mut self, samples: u32, seed: u32) -> Result<Seconds, String> {
        self.ask(&format!("render {samples} {seed}"))
    }

    /// Writes the last image as EXR.
    ///
    /// # Errors
    ///
    /// As [`Self::load`].
    pub fn write(&mut self, file: &Path) -> Result<(), String> {
        self.ask(&format!("write 0 {}", file.display())).map(drop)
    }

    fn ask(&mut self, request: &str) -> Result<Seconds, String> {
        let told = |error: std::io::Error| format!("Mitsuba ended: {error}");
        writeln!(self.input, "{request}").map_err(told)?;
        let mut line = String::new();
        self.output.read_line(&mut line).map_err(told)?;
        serde_json::from_str(&line).map_err(|_| format!("Mitsuba failed at `{request}`"))
    }
}

impl Drop for ExportedMitsuba {
    fn drop(&mut self) {
        // It has ended, or it ends now.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// What a conversion may approximate: Mitsuba takes other samples of pixels and of area lights.
const SAMPLES: [&str; 2] = ["[sampler]", "[[light]] area"];

/// In Mitsuba a glowing surface lights others. That matters unless the integrator is one for scenes
/// in which no surface scatters light; otherwise the exporter notes that too.
const GLOW: &str = "[material] emissive";
const SCATTERS: &str = "<integrator type=\"direct\"";

/// A scene as Mitsuba's XML.
pub struct Export {
    /// The file.
    pub file: PathBuf,
    /// Features of the scene without which Mitsuba's image does not converge to that of the scene.
    pub lost: Vec<&'static str>,
}

/// Writes a scene as Mitsuba's XML into a folder.
///
/// # Errors
///
/// If the program cannot write XML, or the scene cannot be exported.
pub fn export(registry: &Registry, document: &Flattened, folder: &Path) -> Result<Export, String> {
    let file = folder.join("scene.xml");
    let table: toml::Table = document
        .text
        .parse()
        .map_err(|error: toml::de::Error| error.to_string())?;
    let scene = ExportScene {
        document: &table,
        base: &document.base,
    };
    let exported = registry
        .format_of(&file)
        .and_then(|format| format.export(&scene, &file))
        .ok_or("this program cannot write Mitsuba's XML")?;
    let notes = exported.map_err(|errors| {
        let all: Vec<String> = errors.0.into_iter().map(|error| error.message).collect();
        all.join("\n")
    })?;
    let text = std::fs::read_to_string(&file).map_err(|error| error.to_string())?;
    let glow_matters = text.contains(SCATTERS);
    let is_harmless = |name: &str| SAMPLES.contains(&name) || name == GLOW && !glow_matters;
    let features = notes.into_iter().map(|note| note.feature);
    let lost = features
        .filter(|feature| feature.treatment != Treatment::Kept && !is_harmless(feature.name))
        .map(|feature| feature.name)
        .collect();
    Ok(Export { file, lost })
}
