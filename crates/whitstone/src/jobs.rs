//! Jobs: parts of commands that processes run on their own, on any machine, and the folder of their
//! results.
//!
//! A job is a tile of an image, or a command for one scene, family or study. It names everything
//! that its result depends on: the program, the input files by their hashes, and what is to be done
//! with them. Its id is the hash of these. A result is therefore never out of date, and two
//! processes that render the same tile write the same bytes.

use crate::terminal::Failure;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{BufRead, BufReader, Read};
use std::path::{Component, Path, PathBuf};
use std::sync::OnceLock;
use whitstone_core::FilmSize;
use whitstone_image::{Image, Limits, atomic, exr_io};
use whitstone_validate::quoted;

/// Maximum number of jobs of one image.
const MAX_JOBS: u64 = 1 << 20;

/// The program that plans and runs a job. Only the same one gives the same bytes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Program {
    /// The version of the package.
    pub(crate) version: String,
    /// Hash of the executable, or of the library in a Python package.
    pub(crate) hash: String,
}

/// The library with the code of this program and the Python that has loaded it, if it is a part of
/// a Python package.
static IN_PYTHON: OnceLock<[PathBuf; 2]> = OnceLock::new();

/// Says that this program is a library in a Python package, loaded by an interpreter.
pub(crate) fn set_python(library: PathBuf, python: PathBuf) {
    // The first call decides: a process has one such library.
    let _ = IN_PYTHON.set([library, python]);
}

/// The Python that has loaded this program.
pub(crate) fn own_python() -> Option<PathBuf> {
    IN_PYTHON.get().map(|[_, python]| python.clone())
}

/// The command that starts this program in another process.
pub(crate) fn own_command() -> Result<Vec<PathBuf>, Failure> {
    if let Some([_, python]) = IN_PYTHON.get() {
        return Ok(vec![python.clone(), "-m".into(), "whitstone".into()]);
    }
    let executable = std::env::current_exe();
    executable
        .map(|executable| vec![executable])
        .map_err(|error| Failure::environment(format!("cannot find this program: {error}")))
}

impl Program {
    /// This program.
    pub(crate) fn this() -> Result<Self, Failure> {
        let path = match IN_PYTHON.get() {
            Some([library, _]) => Ok(library.clone()),
            None => std::env::current_exe(),
        };
        let hash = path.and_then(|path| hash_of(&path));
        let hash =
            hash.map_err(|error| Failure::environment(format!("cannot read this program: {error}")))?;
        Ok(Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            hash,
        })
    }
}

impl std::fmt::Display for Program {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({})", self.version, self.hash)
    }
}

/// A file that a job reads.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Input {
    /// Relative to the folder of the inputs, with `/` on every system.
    pub(crate) path: String,
    /// Hash of its bytes.
    pub(crate) hash: String,
}

/// The image that a job renders a part of.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Picture {
    /// The scene file, one of the inputs.
    pub(crate) scene: String,
    /// The camera of an imported file.
    pub(crate) camera: Option<String>,
    /// The values of `--set`.
    pub(crate) overrides: Vec<String>,
    /// The value of `--max-tree-rays`.
    pub(crate) max_tree_rays: u32,
    /// Columns of the whole image.
    pub(crate) width: u32,
    /// Rows of the whole image.
    pub(crate) height: u32,
}

/// A part of an image, in pixels from its upper left corner: `[x, y, width, height]`.
pub(crate) type Tile = [u32; 4];

/// What a job does.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub(crate) enum Task {
    /// Renders a part of an image.
    Render {
        /// The part of the image.
        tile: Tile,
        /// The image.
        picture: Picture,
    },
    /// Runs a command of this program whose results are JSON.
    Run {
        /// The working folder, relative to that of the inputs; empty if it is the same.
        folder: String,
        /// The name of the command and its arguments.
        arguments: Vec<String>,
    },
}

/// What jobs depend on, apart from their tasks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Inputs {
    /// The program that planned the jobs.
    pub(crate) program: Program,
    /// Where the files are.
    pub(crate) folder: PathBuf,
    /// All files, sorted by path.
    pub(crate) files: Vec<Input>,
}

/// A job: one line of a file of jobs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Job {
    /// Hash of `program`, `inputs` and `task`, in 32 hexadecimal digits.
    pub(crate) id: String,
    /// The names of its results, in the folder of results.
    pub(crate) outputs: [String; 2],
    /// Where the inputs were when the job was planned. Not part of the id.
    pub(crate) folder: PathBuf,
    /// The program that runs it.
    pub(crate) program: Program,
    /// All files that it reads, sorted by path.
    pub(crate) inputs: Vec<Input>,
    /// What it does.
    pub(crate) task: Task,
}

/// The tiles of an image, row by row from the top.
pub(crate) fn tiles(size: FilmSize, side: u32) -> Result<Vec<Tile>, Failure> {
    let (columns, rows) = (size.width.div_ceil(side), size.height.div_ceil(side));
    if u64::from(columns) * u64::from(rows) > MAX_JOBS {
        return Err(Failure::usage(format!(
            "tiles of {side} pixels divide an image of {} x {} pixels into more than {MAX_JOBS} jobs; use a larger --tile-size",
            size.width, size.height
        )));
    }
    let corners = (0..rows).flat_map(|row| (0..columns).map(move |column| [column * side, row * side]));
    Ok(corners
        .map(|[x, y]| [x, y, side.min(size.width - x), side.min(size.height - y)])
        .collect())
}

impl Job {
    pub(crate) fn new(inputs: &Inputs, task: Task) -> Self {
        let Inputs {
            program,
            folder,
            files,
        } = inputs.clone();
        let text = serde_json::to_string(&(&program, &files, &task)).unwrap_or_default();
        let id = blake3::hash(text.as_bytes()).to_hex()[..32].to_owned();
        let result = match task {
            Task::Render { .. } => "exr",
            Task::Run { .. } => "result",
        };
        Self {
            outputs: [result, "json"].map(|extension| format!("{id}.{extension}")),
            id,
            folder,
            program,
            inputs: files,
            task,
        }
    }

    /// What the job depends on, apart from its task.
    pub(crate) fn depends_on(&self) -> Inputs {
        Inputs {
            program: self.program.clone(),
            folder: self.folder.clone(),
            files: self.inputs.clone(),
        }
    }

    /// What it does, for messages.
    pub(crate) fn what(&self) -> String {
        match &self.task {
            Task::Render { tile, picture } => format!("tile {tile:?} of {}", picture.scene),
            Task::Run { arguments, .. } => {
                let words: Vec<String> = arguments.iter().map(|word| quoted(word)).collect();
                format!("`{}`", words.join(" "))
            }
        }
    }

    /// Reads a line of a file of jobs. Whatever the line says, no path leads out of a folder.
    fn parse(line: &str) -> Result<Self, String> {
        let job: Self = serde_json::from_str(line).map_err(|error| format!("not a job: {error}"))?;
        let expected = Self::new(&job.depends_on(), job.task.clone());
        if job != expected {
            return Err(format!(
                "the job was changed after it was planned: its contents have the id {}",
                expected.id
            ));
        }
        let is_below = |path: &str| {
            let mut parts = Path::new(path).components();
            parts.all(|part| matches!(part, Component::Normal(_)))
        };
        let outside = job.inputs.iter().map(|input| &input.path);
        if let Some(path) = outside
            .into_iter()
            .find(|path| path.is_empty() || !is_below(path))
        {
            return Err(format!("input \"{path}\" is not below the folder of the inputs"));
        }
        match &job.task {
            Task::Render { tile, picture } => {
                let [x, y, width, height] = tile.map(u64::from);
                let inside = x + width <= picture.width.into() && y + height <= picture.height.into();
                if !inside || width == 0 || height == 0 {
                    return Err(format!("tile {tile:?} is not in the image"));
                }
                if !job.inputs.iter().any(|input| input.path == picture.scene) {
                    return Err(format!("the scene \"{}\" is not among the inputs", picture.scene));
                }
            }
            Task::Run { folder, .. } if !is_below(folder) => {
                return Err(format!("folder \"{folder}\" is not below that of the inputs"));
            }
            Task::Run { .. } => {}
        }
        Ok(job)
    }

    /// Reads those lines of a file of jobs that `wanted` selects, by their numbers from 0 and their
    /// texts; `-` is standard input.
    pub(crate) fn read(path: &Path, wanted: impl Fn(usize, &str) -> bool) -> Result<Vec<Self>, Failure> {
        let failed = |error| Failure::usage(format!("{}: {error}", path.display()));
        let file: Box<dyn Read> = match path.to_str() {
            Some(crate::terminal::STDOUT) => Box::new(std::io::stdin()),
            _ => Box::new(File::open(path).map_err(failed)?),
        };
        let mut jobs = Vec::new();
        let mut count = 0;
        for line in BufReader::new(file).lines() {
            let line = line.map_err(failed)?;
            count += 1;
            if wanted(count - 1, &line) {
                let job = Self::parse(&line)
                    .map_err(|problem| Failure::usage(format!("{}:{count}: {problem}", path.display())))?;
                jobs.push(job);
            }
        }
        if count == 0 {
            return Err(Failure::usage(format!(
                "{}: no jobs in this file",
                path.display()
            )));
        }
        Ok(jobs)
    }

    /// Whether a line of a file of jobs is that of the job with this id.
    pub(crate) fn is_line_of(line: &str, id: &str) -> bool {
        let rest = line
            .strip_prefix("{\"id\":\"")
            .and_then(|rest| rest.strip_prefix(id));
        rest.is_some_and(|rest| rest.starts_with('"'))
    }

    /// Reads one job from a line.
    pub(crate) fn read_line(line: &str) -> Result<Self, Failure> {
        Self::parse(line.trim_end()).map_err(|problem| Failure::usage(format!("standard input: {problem}")))
    }

    /// The text of a file of jobs.
    pub(crate) fn lines(jobs: &[Self]) -> String {
        let line = |job: &Self| serde_json::to_string(job).unwrap_or_default() + "\n";
        jobs.iter().map(line).collect()
    }

    /// Checks that this program and the inputs in a folder are those of the plan.
    pub(crate) fn check(&self, folder: &Path) -> Result<(), Failure> {
        let this = Program::this()?;
        if this != self.program {
            return Err(Failure::environment(format!(
                "job {}: planned by whitstone {}, but this is {this}; only the same program gives the same bytes",
                self.id, self.program
            )));
        }
        for input in &self.inputs {
            let path = folder.join(&input.path);
            let problem = match hash_of(&path) {
                Ok(hash) if hash == input.hash => continue,
                Ok(_) => "the file changed after the job was planned".to_owned(),
                Err(error) => error.to_string(),
            };
            return Err(Failure::environment(format!(
                "job {}: input {}: {problem}; plan the jobs again, or name the folder of the inputs with --inputs",
                self.id,
                path.display()
            )));
        }
        Ok(())
    }
}

/// The hash of a file.
pub(crate) fn hash_of(path: &Path) -> std::io::Result<String> {
    if !fs::metadata(path)?.is_file() {
        return Err(std::io::Error::other("not a regular file"));
    }
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(File::open(path)?)?;
    Ok(hasher.finalize().to_hex()[..32].to_owned())
}

/// An absolute path without `..`.
fn whole(path: &Path) -> Result<PathBuf, Failure> {
    let path = std::path::absolute(path).map_err(|error| unreadable(path, &error))?;
    Ok(path.components().fold(PathBuf::new(), |mut whole, part| {
        match part {
            Component::ParentDir => drop(whole.pop()),
            part => whole.push(part),
        }
        whole
    }))
}

fn unreadable(path: &Path, error: &std::io::Error) -> Failure {
    Failure::usage(format!("{}: {error}", path.display()))
}

impl Inputs {
    /// Files, relative to the deepest folder that contains them all and the folder `with`.
    pub(crate) fn new(program: &Program, with: &Path, files: &[PathBuf]) -> Result<Self, Failure> {
        let mut all = BTreeSet::new();
        for file in files {
            all.insert(whole(file)?);
            // The buffers and images of a mesh in a glTF file, which the scene does not name.
            if let Ok(document) = whitstone_gltf::Document::open(file) {
                for companion in document.companions() {
                    all.insert(whole(&companion)?);
                }
            }
        }
        let with = whole(with)?;
        let folder = with
            .ancestors()
            .find(|folder| all.iter().all(|file| file.starts_with(folder)));
        let Some(folder) = folder else {
            return Err(Failure::usage("the files of the scene are on several drives"));
        };
        let mut inputs = Self {
            program: program.clone(),
            folder: folder.to_owned(),
            files: Vec::new(),
        };
        for path in &all {
            inputs.files.push(Input {
                path: inputs.name(path)?,
                hash: hash_of(path).map_err(|error| unreadable(path, &error))?,
            });
        }
        Ok(inputs)
    }

    /// The path of a file or folder, relative to the folder of the inputs.
    pub(crate) fn name(&self, path: &Path) -> Result<String, Failure> {
        let path = whole(path)?;
        let relative = path.strip_prefix(&self.folder).unwrap_or(&path);
        let text = relative.to_str().map(|text| text.replace('\\', "/"));
        text.ok_or_else(|| Failure::usage(format!("{}: the name is not valid UTF-8", path.display())))
    }
}

/// Where the inputs of jobs were when they were planned.
pub(crate) fn input_paths(jobs: &[Job]) -> Vec<PathBuf> {
    let files = |job: &Job| {
        let inputs = job.inputs.iter();
        inputs
            .map(|input| job.folder.join(&input.path))
            .collect::<Vec<_>>()
    };
    let all: BTreeSet<PathBuf> = jobs.iter().flat_map(files).collect();
    all.into_iter().collect()
}

/// What is recorded about a finished job. It is written after the result, so that its presence
/// says that the job is finished.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Record {
    /// The job.
    pub(crate) id: String,
    /// Hash of the file of the result.
    pub(crate) hash: String,
    /// Time that the process took, in seconds.
    pub(crate) seconds: f64,
    /// What is known of a tile.
    #[serde(flatten)]
    pub(crate) tile: Option<Rendered>,
}

/// What is recorded about a rendered tile.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Rendered {
    /// Time to build the scene, in seconds.
    pub(crate) build_s: f64,
    /// Time to render, in seconds.
    pub(crate) render_s: f64,
    /// Rays of all kinds.
    pub(crate) rays: u64,
    /// Pixels that are not finite.
    pub(crate) not_finite: usize,
}

/// The folder of results.
pub(crate) struct Results(pub(crate) PathBuf);

impl Results {
    /// The record of a job whose result is complete and has the recorded hash.
    pub(crate) fn find(&self, job: &Job) -> Option<Record> {
        self.load(job).map(|(record, _)| record)
    }

    /// The record and the result of a finished job.
    pub(crate) fn load(&self, job: &Job) -> Option<(Record, Vec<u8>)> {
        let [result, record] = job.outputs.each_ref().map(|name| self.0.join(name));
        let record: Record = serde_json::from_slice(&fs::read(record).ok()?).ok()?;
        let bytes = fs::read(result).ok()?;
        let is_whole = record.id == job.id && blake3::hash(&bytes).to_hex()[..32] == record.hash;
        is_whole.then_some((record, bytes))
    }

    /// The image of a job, which is a tile.
    pub(crate) fn image(&self, job: &Job) -> Result<(Rendered, Image), String> {
        let incomplete = || format!("job {} has no complete result", job.id);
        let (record, bytes) = self.load(job).ok_or_else(incomplete)?;
        let image =
            exr_io::decode(&bytes, Limits::IMAGE).map_err(|fault| format!("job {}: {fault}", job.id))?;
        let Task::Render { tile, .. } = &job.task else {
            return Err(format!("job {} is not a tile of an image", job.id));
        };
        let [_, _, width, height] = tile.map(|pixels| pixels as usize);
        if [image.width(), image.height()] != [width, height] {
            return Err(format!("job {}: the result has another size", job.id));
        }
        Ok((record.tile.ok_or_else(incomplete)?, image))
    }

    /// Writes the result of a job, and then its record.
    pub(crate) fn write(
        &self,
        job: &Job,
        bytes: &[u8],
        seconds: f64,
        tile: Option<Rendered>,
    ) -> Result<Record, Failure> {
        let record = Record {
            id: job.id.clone(),
            hash: blake3::hash(bytes).to_hex()[..32].to_owned(),
            seconds,
            tile,
        };
        let text = serde_json::to_string(&record).map_err(Failure::environment)? + "\n";
        let [result, place] = job.outputs.each_ref().map(|name| self.0.join(name));
        atomic::write_bytes(result, bytes).map_err(Failure::environment)?;
        atomic::write_bytes(place, text.as_bytes()).map_err(Failure::environment)?;
        Ok(record)
    }

    /// What a failed job wrote to standard error.
    pub(crate) fn log(&self, id: &str) -> PathBuf {
        self.0.join(format!("{id}.log"))
    }

    /// Removes the results and the logs of jobs.
    pub(crate) fn remove(&self, jobs: &[Job]) {
        for job in jobs {
            let results = job.outputs.iter().map(|name| self.0.join(name));
            for path in results.chain([self.log(&job.id)]) {
                // What stays is used again, or overwritten.
                let _ = fs::remove_file(path);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn inputs() -> Inputs {
        Inputs {
            program: Program {
                version: "1.0.0".to_owned(),
                hash: "abc".to_owned(),
            },
            folder: PathBuf::from("/x"),
            files: vec![Input {
                path: "a/scene.toml".to_owned(),
                hash: "def".to_owned(),
            }],
        }
    }

    fn picture() -> Picture {
        Picture {
            scene: "a/scene.toml".to_owned(),
            camera: None,
            overrides: vec!["camera.fov=30".to_owned()],
            max_tree_rays: 100,
            width: 30,
            height: 20,
        }
    }

    fn tile(tile: Tile) -> Task {
        Task::Render {
            tile,
            picture: picture(),
        }
    }

    fn command(folder: &str) -> Task {
        Task::Run {
            folder: folder.to_owned(),
            arguments: vec!["validate".to_owned(), "scene.toml".to_owned()],
        }
    }

    #[test]
    fn tiles_cover_the_image_once() {
        let size = FilmSize {
            width: 30,
            height: 20,
        };
        for side in [1, 7, 10, 16, 30, 1000] {
            let mut times = vec![0; 600];
            for [x, y, width, height] in tiles(size, side).unwrap() {
                for place in (y..y + height).flat_map(|y| (x..x + width).map(move |x| y * 30 + x)) {
                    times[place as usize] += 1;
                }
            }
            assert!(times.iter().all(|times| *times == 1), "{side}");
        }
        let large = FilmSize {
            width: 16384,
            height: 16384,
        };
        assert_eq!(tiles(large, 256).unwrap().len(), 4096);
        assert!(tiles(large, 1).unwrap_err().problem().contains("--tile-size"));
    }

    #[test]
    fn the_id_is_of_all_that_the_result_depends_on() {
        let first = [0, 0, 10, 10];
        for task in [tile(first), command("a")] {
            let job = Job::new(&inputs(), task.clone());
            let line = Job::lines(std::slice::from_ref(&job));
            assert_eq!(Job::read_line(&line).unwrap(), job);
            let mut moved = inputs();
            moved.folder = PathBuf::from("/y");
            assert_eq!(Job::new(&moved, task).id, job.id);
        }
        let of_inputs: [fn(&mut Inputs); 4] = [
            |inputs| inputs.program.hash.push('d'),
            |inputs| inputs.program.version.push('0'),
            |inputs| inputs.files[0].hash.push('0'),
            |inputs| inputs.files[0].path.push('0'),
        ];
        let of_picture: [fn(&mut Picture); 5] = [
            |picture| picture.scene.push('0'),
            |picture| picture.overrides.clear(),
            |picture| picture.camera = Some("a".to_owned()),
            |picture| picture.max_tree_rays += 1,
            |picture| picture.width += 1,
        ];
        let mut ids: Vec<String> = [tile(first), tile([10, 0, 10, 10]), command(""), command("a")]
            .map(|task| Job::new(&inputs(), task).id)
            .to_vec();
        ids.extend(of_inputs.iter().map(|change| {
            let mut inputs = inputs();
            change(&mut inputs);
            Job::new(&inputs, tile(first)).id
        }));
        ids.extend(of_picture.iter().map(|change| {
            let mut picture = picture();
            change(&mut picture);
            Job::new(&inputs(), Task::Render { tile: first, picture }).id
        }));
        let different: BTreeSet<&String> = ids.iter().collect();
        assert_eq!(different.len(), 13);
    }

    #[test]
    fn hostile_jobs_are_refused() {
        let refused = |inputs: &Inputs, task: Task, expected: &str| {
            let result = Job::read_line(&Job::lines(&[Job::new(inputs, task)]));
            let problem = result.map_or_else(Failure::problem, |_| "accepted".to_owned());
            assert!(problem.contains(expected), "{problem}");
        };
        let first = [0, 0, 10, 10];
        for path in ["../a", "/etc/passwd", "a/../../b", "./a", ""] {
            let mut wrong = inputs();
            wrong.files[0].path = path.to_owned();
            refused(&wrong, tile(first), "not below the folder");
            refused(&wrong, command(""), "not below the folder");
        }
        for folder in ["..", "/etc", "a/.."] {
            refused(&inputs(), command(folder), "not below that of the inputs");
        }
        let mut other = picture();
        other.scene.push('x');
        let of_other = Task::Render {
            tile: first,
            picture: other,
        };
        refused(&inputs(), of_other, "not among the inputs");
        for outside in [[25, 0, 10, 10], [0, u32::MAX, 10, 10], [0, 0, 0, 10]] {
            refused(&inputs(), tile(outside), "not in the image");
        }
        let named = Job::lines(&[Job::new(&inputs(), tile(first))]).replace(".exr", "/../../x");
        let problem = Job::read_line(&named).unwrap_err().problem();
        assert!(problem.contains("changed after it was planned"), "{problem}");
        assert!(Job::read_line("{").unwrap_err().problem().contains("not a job"));
    }
}
