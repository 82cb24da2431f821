//! The Embree program, compiled if a C++ compiler and Embree are installed, and controlled line by
//! line.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

const SOURCE: &str = include_str!("embree_backend.cpp");

/// Compiles the program into a folder. The error names the missing parts.
pub(super) fn compile(folder: &Path) -> Result<PathBuf, String> {
    let (source, program) = (
        folder.join("embree_backend.cpp"),
        folder.join("embree_backend_lines"),
    );
    if std::fs::read_to_string(&source).is_ok_and(|text| text == SOURCE) && program.is_file() {
        return Ok(program);
    }
    std::fs::write(&source, SOURCE).map_err(|error| error.to_string())?;
    let mut why = String::new();
    for library in ["-lembree4", "-lembree3"] {
        let made = Command::new("c++")
            .args(["-O3", "-march=native", "-o"])
            .arg(&program)
            .arg(&source)
            .arg(library)
            .output();
        match made {
            Ok(output) if output.status.success() => return Ok(program),
            Ok(output) => why = String::from_utf8_lossy(&output.stderr).into_owned(),
            Err(error) => return Err(format!("no C++ compiler: {error}")),
        }
    }
    let first = why.lines().next().unwrap_or_default();
    Err(format!(
        "cannot compile with Embree; is it installed (Debian: libembree-dev)? {first}"
    ))
}

/// A running Embree program with one mesh.
pub(super) struct Backend {
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
    pub(super) version: String,
    pub(super) build_seconds: f64,
    pub(super) bytes: f64,
}

impl Backend {
    pub(super) fn start(program: &Path, folder: &Path, mesh: &str, quality: &str) -> Result<Self, String> {
        let mut child = Command::new(program)
            .args([folder.as_os_str(), mesh.as_ref(), quality.as_ref()])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| error.to_string())?;
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            return Err("the Embree program has no pipes".to_owned());
        };
        let mut backend = Self {
            child,
            input,
            output: BufReader::new(output),
            version: String::new(),
            build_seconds: f64::NAN,
            bytes: f64::NAN,
        };
        let line = backend.line()?;
        let [_, version, seconds, bytes] = line.split_whitespace().collect::<Vec<_>>()[..] else {
            return Err(format!("unexpected output of the Embree program: \"{line}\""));
        };
        backend.version = version.to_owned();
        backend.build_seconds = seconds.parse().unwrap_or(f64::NAN);
        backend.bytes = bytes.parse().unwrap_or(f64::NAN);
        Ok(backend)
    }

    fn line(&mut self) -> Result<String, String> {
        let mut line = String::new();
        match self.output.read_line(&mut line) {
            Ok(n) if n > 0 => Ok(line),
            Ok(_) => Err("the Embree program has ended".to_owned()),
            Err(error) => Err(error.to_string()),
        }
    }

    /// Seconds of one pass over a set of rays, and the number of hits.
    pub(super) fn trace(&mut self, set: &str, stride: usize) -> Result<(f64, usize), String> {
        writeln!(self.input, "{set} {stride}").map_err(|error| error.to_string())?;
        let line = self.line()?;
        let mut words = line.split_whitespace();
        let seconds = words.next().and_then(|word| word.parse().ok());
        let hits = words.next().and_then(|word| word.parse().ok());
        seconds
            .zip(hits)
            .ok_or_else(|| format!("unexpected output of the Embree program: \"{line}\""))
    }
}

impl Drop for Backend {
    fn drop(&mut self) {
        // Kills it without waiting for an answer.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
