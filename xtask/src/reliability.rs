//! `reliability`: injects faults into the program and counts the harm.

mod damage;
mod faults;
mod kills;
mod memory;
mod page;
mod processors;
mod references;
mod soak;
mod times;

use clap::Args;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};
use whitstone::image::atomic;
use whitstone::{Exit, Failure};
use whitstone_testkit::Random;

pub(crate) use page::{PAGE, RESULT, page};

/// Inject faults into the program, kill it, feed it damaged files, and count the harm
///
/// Each promise of docs/reliability.md is tried many times on the program `whitstone` in the folder
/// of this one. Faults of system calls need strace (Debian: apt-get install strace), and the
/// promises about references a live Mitsuba (see `whitstone doctor`); without them they are
/// skipped, and the report says so. So is the promise about processors without a compiler and an
/// emulator for arm64, unless --quick is given (Debian: apt-get install gcc-aarch64-linux-gnu
/// libc6-dev-arm64-cross qemu-user; rustup target add aarch64-unknown-linux-gnu).
///
/// Exit code 0 if no attempt broke a promise, 1 if one did.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  cargo xtask reliability --quick\n  cargo xtask reliability soak --soak 3600\n  cargo xtask reliability --json studies/results/reliability.json"
)]
pub(crate) struct Arguments {
    /// The promises to test [default: all]
    #[arg(value_name = "PROMISE", value_parser = PROMISES.map(|promise| promise.key))]
    promises: Vec<String>,
    /// Few attempts of each kind: about three minutes
    #[arg(long)]
    quick: bool,
    /// How long one program must run without growing memory, at least [default: 600, with --quick
    /// 5]
    #[arg(long, value_name = "SECONDS")]
    soak: Option<u64>,
    /// Another program to test [default: whitstone, in the folder of this program]
    #[arg(long, value_name = "PROGRAM")]
    program: Option<PathBuf>,
    /// Write the counts to this file as JSON, after each promise; those of promises that are not
    /// tested stay
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// What is tested.
struct Subject {
    /// The program.
    program: PathBuf,
    /// The repository.
    root: PathBuf,
    quick: bool,
    /// How long a program is watched for growing memory.
    soak: Duration,
}

/// The attempts on one promise.
#[derive(Default)]
struct Tally {
    tried: u64,
    /// What was seen where it was broken.
    broken: Vec<String>,
    /// Why it was not tried.
    skipped: Option<String>,
    /// When the count was last printed.
    told: Option<Instant>,
}

impl Tally {
    /// Counts an attempt.
    fn count(&mut self, seen: Result<(), String>) {
        self.tried += 1;
        self.broken.extend(seen.err());
        let told = *self.told.get_or_insert_with(Instant::now);
        if told.elapsed() >= Duration::from_secs(30) {
            eprintln!("         {} attempts, {} broken", self.tried, self.broken.len());
            self.told = Some(Instant::now());
        }
    }
}

/// A promise and how it is tested.
struct Promise {
    /// On the command line.
    key: &'static str,
    name: &'static str,
    how: &'static str,
    run: fn(&Subject) -> Result<Tally, Failure>,
}

const PROMISES: [Promise; 8] = [
    Promise {
        key: "calls",
        name: "A system call that fails does no harm.",
        how: "Each command runs under `strace`, which lets one system call fail: the first, the second, and so on, for each kind of call and error. The command ends with a documented exit code, without a panic; every file is absent, as it was, or complete; exit code 0 means that all files are there.",
        run: faults::run,
    },
    Promise {
        key: "kills",
        name: "A killed command leaves whole files, and the next run is undisturbed.",
        how: "The test kills the command with SIGKILL at a random moment. After that every file is absent, as it was, or complete. The command then runs again: its files are, bit for bit, those of a run that was never killed, except measured times, what `converge` derives from them, and the load of the machine. No temporary file is left. A measurement that `converge` has stored keeps its times.",
        run: kills::run,
    },
    Promise {
        key: "drivers",
        name: "A driver does not outlive its command.",
        how: "The test kills `validate --fresh` with a live Mitsuba with SIGKILL at a random moment, in at least one attempt while a driver is alive. One second later no process that the command started is alive. The files are as after every kill, and the next run gives the same results.",
        run: references::drivers,
    },
    Promise {
        key: "references",
        name: "The files of a stored reference belong together.",
        how: "`reference --accept` replaces a reference of the same scene that has another image and another floor, and ends by SIGKILL at a random moment or, under `strace`, before one of its last renames. The files are then those of the old reference or those of the new one, or `validate` refuses them. The next run stores the new ones.",
        run: references::stored,
    },
    Promise {
        key: "damage",
        name: "A damaged file causes neither a crash nor a hang.",
        how: "The test changes, removes or repeats bytes of scenes, meshes and images of every format that is read. The command ends within 10 s with a documented exit code, without a panic.",
        run: damage::run,
    },
    Promise {
        key: "memory",
        name: "Memory is bounded.",
        how: "The test renders scenes whose size follows from numbers in the file, with `--max-memory`. The peak of the resident memory is at most 1.1 times the limit plus 64 MiB, whether the scene is rendered or refused.",
        run: memory::run,
    },
    Promise {
        key: "processors",
        name: "An image does not depend on the processor.",
        how: "The test renders every scene of the repository at 32 x 24 pixels with the mathematics functions that glibc has for older x86-64 processors, with fewer vector instructions, and by a program for arm64 under `qemu-aarch64`. The files are equal, byte for byte. A quick run tries some of the scenes, without arm64.",
        run: processors::run,
    },
    Promise {
        key: "soak",
        name: "Memory does not grow.",
        how: "`whitstone view` shows every scene of the repository in turn, each by a change of its file, again and again for some time (the option `--soak`). No later round has a peak of the resident memory above 1.1 times that of the first two rounds plus 16 MiB.",
        run: soak::run,
    },
];

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<Exit, Failure> {
    let program = match &arguments.program {
        Some(program) => program.clone(),
        None => std::env::current_exe()
            .map_err(Failure::environment)?
            .with_file_name("whitstone"),
    };
    let program = program.canonicalize().map_err(|error| {
        Failure::usage(format!(
            "{}: {error}; build it, or name it with --program",
            program.display()
        ))
    })?;
    let subject = Subject {
        program,
        root: std::env::current_dir().map_err(Failure::environment)?,
        quick: arguments.quick,
        soak: Duration::from_secs(arguments.soak.unwrap_or(if arguments.quick { 5 } else { 600 })),
    };
    let is_chosen = |promise: &&Promise| {
        let mut keys = arguments.promises.iter();
        arguments.promises.is_empty() || keys.any(|key| key == promise.key)
    };
    let (mut harm, mut skipped, mut tried) = (0, 0, 0);
    for promise in PROMISES.iter().filter(is_chosen) {
        eprintln!("trying   {}", promise.name);
        let start = Instant::now();
        let mut tally = (promise.run)(&subject)?;
        if tally.tried == 0 && tally.skipped.is_none() {
            tally.broken.push("no attempt was made".to_owned());
        }
        tried += 1;
        harm += tally.broken.len();
        skipped += usize::from(tally.skipped.is_some());
        let seconds = start.elapsed().as_secs();
        match &tally.skipped {
            Some(why) => println!("skipped  {} {why}", promise.name),
            None => println!(
                "{:<8} {} {} attempts, {} broken, {seconds} s",
                if tally.broken.is_empty() { "kept" } else { "BROKEN" },
                promise.name,
                tally.tried,
                tally.broken.len(),
            ),
        }
        for seen in tally.broken.iter().take(10) {
            println!("         {seen}");
        }
        if let Some(path) = &arguments.json {
            let result = json!({
                "promise": promise.name, "how": promise.how, "quick": subject.quick, "seconds": seconds,
                "tried": tally.tried, "failed": tally.broken.len(), "skipped": tally.skipped,
            });
            store(path, result)?;
        }
    }
    println!("promises: {tried}, skipped: {skipped}, broken attempts: {harm}");
    Ok(if harm == 0 { Exit::Pass } else { Exit::Differs })
}

/// Replaces the result of one promise in a file, which need not exist.
fn store(path: &Path, result: Value) -> Result<(), Failure> {
    let before: Value = match fs::read(path) {
        Ok(bytes) => serde_json::from_slice(&bytes)
            .map_err(|error| Failure::usage(format!("{}: {error}", path.display())))?,
        Err(_) => Value::Null,
    };
    let results: Vec<&Value> = (PROMISES.iter())
        .filter_map(|promise| match result["promise"] == promise.name {
            true => Some(&result),
            false => stored(&before, promise),
        })
        .collect();
    let report = json!({ "program": env!("CARGO_PKG_VERSION"), "promises": results });
    let mut text = serde_json::to_string_pretty(&report).map_err(Failure::environment)?;
    text.push('\n');
    atomic::write_bytes(path, text.as_bytes()).map_err(Failure::environment)
}

/// The result of a promise in a report.
fn stored<'r>(report: &'r Value, promise: &Promise) -> Option<&'r Value> {
    let mut results = report["promises"].as_array()?.iter();
    results.find(|result| result["promise"] == promise.name)
}

/// A command line whose files are compared.
struct Case {
    name: &'static str,
    /// Whether it is also killed: others write one small file or none before they end.
    is_killed: bool,
    /// `@` stands for the folder of its files, and `%` for the repository.
    arguments: &'static [&'static str],
}

impl Case {
    /// The exit code of an undisturbed run.
    fn exit_code(&self) -> i32 {
        // It finds a difference.
        i32::from(self.name == "compare")
    }
}

/// The commands that write files.
const CASES: [Case; 11] = [
    Case {
        name: "render",
        is_killed: true,
        arguments: &[
            "render",
            "%/scenes/showcase/classic.toml",
            "-o",
            "@/x.exr",
            "--png",
            "--json",
            "@/r.json",
            "--set",
            "film.width=32",
            "--set",
            "film.height=24",
            "--target",
            "@/target",
        ],
    },
    Case {
        name: "compare",
        is_killed: true,
        arguments: &[
            "compare", "@/a.exr", "@/b.exr", "--png", "@/d.png", "--json", "@/c.json", "--junit", "@/j.xml",
        ],
    },
    Case {
        name: "validate",
        is_killed: true,
        arguments: &[
            "validate",
            "scenes/materials/matte.toml",
            "--reference",
            "stored",
            "--target",
            "@/target",
            "--json",
            "@/v.json",
            "--junit",
            "@/j.xml",
        ],
    },
    Case {
        name: "convert",
        is_killed: true,
        arguments: &["convert", "%/scenes/assets/crystal.glb", "@/c.toml"],
    },
    Case {
        name: "init",
        is_killed: false,
        arguments: &["init", "@/project"],
    },
    Case {
        name: "explain",
        is_killed: false,
        arguments: &[
            "explain",
            "%/scenes/showcase/classic.toml",
            "--pixel",
            "3,4",
            "--json",
            "@/e.json",
            "--reference",
            "none",
            "--target",
            "@/target",
        ],
    },
    Case {
        name: "plan",
        is_killed: false,
        arguments: &[
            "plan",
            "%/scenes/showcase/textured_mesh.toml",
            "-o",
            "@/jobs.jsonl",
            "--json",
            "@/p.json",
        ],
    },
    Case {
        name: "run-job",
        is_killed: true,
        arguments: &[
            "run-job",
            "@/ready.jsonl",
            "--index",
            "0",
            "--results",
            "@/out",
            "--target",
            "@/target",
            "--json",
            "@/r.json",
        ],
    },
    Case {
        name: "merge",
        is_killed: true,
        arguments: &["merge", "@/ready.jsonl", "-o", "@/m.exr", "--json", "@/m.json"],
    },
    Case {
        name: "stress",
        is_killed: false,
        arguments: &[
            "stress",
            "planet",
            "--rays",
            "5",
            "--no-mitsuba",
            "--json",
            "@/s.json",
            "--target",
            "@/target",
        ],
    },
    Case {
        name: "bake",
        is_killed: false,
        arguments: &["bake", "cubemap", "@/a.exr", "--size", "8", "-o", "@/sky"],
    },
];

/// A short study. Its many system calls would take hours to fail one by one, so it is only killed.
const CONVERGE: Case = Case {
    name: "converge",
    is_killed: true,
    arguments: &[
        "converge",
        "@/study.toml",
        "--no-mitsuba",
        "--threads",
        "1",
        "--repeats",
        "3",
        "--json",
        "@/c.json",
        "--target",
        "@/target",
    ],
};

/// `%` stands for the repository.
const STUDY: &str = r#"title = "A study"
about = "For `cargo xtask reliability`."
scene = "%/scenes/showcase/classic.toml"
set = ["film.width=16", "film.height=12"]
[truth]
set = ['sampler={ type = "grid", samples_per_axis = 8 }']
check = [{ set = ['sampler={ type = "sobol", samples = 64 }'] }]
[[series]]
name = "grid"
set = ['sampler={ type = "grid" }']
sweep = { "sampler.samples_per_axis" = [1, 2, 3] }
"#;

/// Files that commands read, in the folder of each.
fn is_input(name: &str) -> bool {
    ["a.exr", "b.exr", "study.toml"].contains(&name) || name.starts_with("ready.")
}

impl Subject {
    /// The command of a case, after `before` (such as strace and its options).
    fn command(&self, before: &[String], case: &Case, folder: &Path) -> Command {
        let (folder, root) = (folder.to_string_lossy(), self.root.to_string_lossy());
        let own = case
            .arguments
            .iter()
            .map(|argument| argument.replace('@', &folder).replace('%', &root));
        let program = self.program.to_string_lossy().into_owned();
        let words: Vec<String> = before
            .iter()
            .cloned()
            .chain(std::iter::once(program))
            .chain(own)
            .collect();
        self.plain(&words)
    }

    /// A command of these words, in the repository.
    fn plain(&self, words: &[String]) -> Command {
        let mut command = Command::new(&words[0]);
        command
            .args(&words[1..])
            .current_dir(&self.root)
            // The number of system calls does not depend on the machine.
            .env("RAYON_NUM_THREADS", "2")
            .env("RUST_BACKTRACE", "0")
            .stdin(Stdio::null());
        command
    }

    /// A new folder with the files that the commands read.
    fn folder(&self) -> Result<tempfile::TempDir, Failure> {
        let folder = tempfile::tempdir().map_err(Failure::environment)?;
        for (name, width) in [("a.exr", 16), ("b.exr", 16)] {
            let path = folder.path().join(name);
            let scene = if name == "a.exr" {
                "classic"
            } else {
                "facing_mirrors"
            };
            let words = [
                self.program.display().to_string(),
                "render".to_owned(),
                format!("scenes/showcase/{scene}.toml"),
                "-o".to_owned(),
                path.display().to_string(),
                "--set".to_owned(),
                format!("film={{width={width},height=12}}"),
            ];
            self.succeeds(&words)?;
        }
        let study = STUDY.replace('%', &self.root.to_string_lossy());
        fs::write(folder.path().join("study.toml"), study).map_err(Failure::environment)?;
        let program = self.program.display().to_string();
        let jobs = folder.path().join("ready.jsonl").display().to_string();
        let small = "film={width=16,height=12}";
        let scene = "scenes/showcase/classic.toml";
        let plan = [
            &program,
            "plan",
            scene,
            "--set",
            small,
            "--tile-size",
            "8",
            "-o",
            &jobs,
        ];
        self.succeeds(&plan.map(str::to_owned))?;
        for index in ["0", "1", "2", "3"] {
            let run = [&program, "run-job", &jobs, "--index", index];
            self.succeeds(&run.map(str::to_owned))?;
        }
        Ok(folder)
    }

    /// Runs a command that prepares files.
    fn succeeds(&self, words: &[String]) -> Result<(), Failure> {
        let output = self.plain(words).output().map_err(Failure::environment)?;
        match output.status.success() {
            true => Ok(()),
            false => {
                let text = String::from_utf8_lossy(&output.stderr).into_owned();
                Err(Failure::environment(format!("{}: {text}", words.join(" "))))
            }
        }
    }
}

impl Subject {
    /// An error if a command wrote nothing: then nothing would be tested.
    fn check_outputs(&self, case: &Case, files: &BTreeMap<String, Vec<u8>>) -> Result<(), Failure> {
        match files.keys().filter(|name| !is_input(name)).count() {
            0 => Err(Failure::environment(format!(
                "{} {} writes no file",
                self.program.display(),
                case.name
            ))),
            _ => Ok(()),
        }
    }

    /// A new folder with the input files of [`Self::folder`], which are among these.
    fn folder_with(&self, files: &BTreeMap<String, Vec<u8>>) -> Result<tempfile::TempDir, Failure> {
        let folder = tempfile::tempdir().map_err(Failure::environment)?;
        let inputs = files.iter().filter(|(name, _)| is_input(name));
        put(folder.path(), inputs)?;
        Ok(folder)
    }
}

/// Writes files into a folder.
fn put<'f>(folder: &Path, files: impl Iterator<Item = (&'f String, &'f Vec<u8>)>) -> Result<(), Failure> {
    for (name, bytes) in files {
        let path = folder.join(name);
        path.parent()
            .map_or(Ok(()), fs::create_dir_all)
            .and_then(|()| fs::write(&path, bytes))
            .map_err(Failure::environment)?;
    }
    Ok(())
}

/// A random number below `count`, the same in every run.
fn pick(seed: u64, count: usize) -> usize {
    Random::new(seed).below(count.max(1))
}

/// Runs a command with a time limit; `None` if it did not end.
fn run_within(command: &mut Command, limit: Duration) -> std::io::Result<Option<Output>> {
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn()?;
    let mut pipe = child.stderr.take();
    let reader = std::thread::Builder::new().spawn(move || {
        let mut text = Vec::new();
        if let Some(pipe) = &mut pipe {
            // What came before an error of the pipe is enough.
            let _ = pipe.read_to_end(&mut text);
        }
        text
    })?;
    let start = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            let stderr = reader.join().unwrap_or_default();
            return Ok(Some(Output {
                status,
                stdout: Vec::new(),
                stderr,
            }));
        }
        if start.elapsed() > limit {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// The files below a folder, by relative name.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(at) = open.pop() {
        let Ok(entries) = fs::read_dir(&at) else { continue };
        for path in entries.flatten().map(|entry| entry.path()) {
            if path.is_dir() {
                open.push(path);
            } else if let Ok(bytes) = fs::read(&path) {
                let name = path.strip_prefix(folder).unwrap_or(&path);
                found.insert(name.to_string_lossy().into_owned(), bytes);
            }
        }
    }
    found
}

/// Whether a file is temporary, or in a temporary folder.
fn is_temporary(name: &str) -> bool {
    name.split('/').any(|part| extension(part) == "tmp")
}

/// The extension of a file, or nothing.
fn extension(name: &str) -> &str {
    let extension = Path::new(name).extension();
    extension
        .and_then(|extension| extension.to_str())
        .unwrap_or_default()
}

/// Whether a file is complete: equal to that of an undisturbed run, or, where it contains times, of
/// its format.
fn is_whole(name: &str, bytes: &[u8], undisturbed: Option<&Vec<u8>>) -> bool {
    let text = || std::str::from_utf8(bytes);
    match extension(name) {
        "json" => serde_json::from_slice::<Value>(bytes).is_ok(),
        "html" => text().is_ok_and(|text| text.trim_end().ends_with("</html>")),
        "xml" => text().is_ok_and(|text| text.trim_end().ends_with("</testsuites>")),
        "toml" if name.ends_with("meta.toml") => times::table(bytes).is_some(),
        _ => undisturbed.is_some_and(|expected| expected == bytes),
    }
}
