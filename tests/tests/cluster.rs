//! Jobs on a Dask cluster whose workers are killed, stopped, late or of another version, and whose
//! scheduler goes away: the image has the bytes of one process, and nothing is done twice.
#![cfg(unix)]

use serde_json::Value;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use whitstone_tests::{dask, entries, root, skipped};

const PROGRAM: &str = env!("CARGO_BIN_EXE_whitstone-under-test");

/// Longest wait for something that happens within seconds on an idle machine.
const PATIENCE: Duration = Duration::from_secs(100);

/// A process that is killed at the end of the test, stopped or not.
struct Process(Child);

impl Process {
    fn start(command: &mut Command) -> Self {
        Self(command.stdin(Stdio::null()).spawn().unwrap())
    }

    fn send(&self, signal: &str) {
        let status = Command::new("kill")
            .args([signal, &self.0.id().to_string()])
            .status();
        assert!(status.unwrap().success(), "kill {signal}");
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn wait_until(what: &str, mut holds: impl FnMut() -> bool) {
    let start = Instant::now();
    while !holds() {
        assert!(start.elapsed() < PATIENCE, "no {what} after {PATIENCE:?}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// A folder with a scheduler, and what is rendered there.
struct Cluster {
    python: PathBuf,
    folder: tempfile::TempDir,
    schedulers: u32,
}

impl Cluster {
    fn new(python: &Path) -> Self {
        Self {
            python: python.to_owned(),
            folder: tempfile::tempdir().unwrap(),
            schedulers: 0,
        }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn dask(&self, kind: &str) -> Command {
        let mut command = Command::new(&self.python);
        command.args(["-m", &format!("distributed.cli.dask_{kind}"), "--no-dashboard"]);
        let log = fs::File::options()
            .create(true)
            .append(true)
            .open(self.at("dask.log"))
            .unwrap();
        command.stdout(Stdio::null()).stderr(log);
        command
    }

    fn file(&self) -> PathBuf {
        self.at(&format!("scheduler-{}.json", self.schedulers))
    }

    /// Starts a scheduler, which gives a worker up after five seconds without a sign of life.
    fn scheduler(&mut self) -> Process {
        self.schedulers += 1;
        let mut command = self.dask("scheduler");
        command
            .args(["--host", "127.0.0.1", "--port", "0", "--scheduler-file"])
            .arg(self.file())
            .env("DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL", "5s");
        let scheduler = Process::start(&mut command);
        wait_until("scheduler", || self.address().is_some());
        scheduler
    }

    fn address(&self) -> Option<String> {
        let text = fs::read_to_string(self.file()).ok()?;
        let value: Value = serde_json::from_str(&text).ok()?;
        Some(value["address"].as_str()?.to_owned())
    }

    /// Starts a worker that finds `program` as its Whitstone.
    fn worker(&self, program: &Path) -> Process {
        self.worker_in(program, &self.at("workers"))
    }

    /// Starts a worker with its files in a folder.
    fn worker_in(&self, program: &Path, folder: &Path) -> Process {
        let mut command = self.dask("worker");
        command
            .args(["--no-nanny", "--nthreads", "1", "--scheduler-file"])
            .arg(self.file())
            .arg("--local-directory")
            .arg(folder)
            .env("WHITSTONE", program);
        Process::start(&mut command)
    }

    /// The arguments that run a command on this cluster.
    fn on_it(&self) -> Vec<OsString> {
        let mut words = vec![OsString::from("--cluster"), self.address().unwrap().into()];
        words.extend(["--dask".into(), self.python.clone().into()]);
        words.extend(["--target".into(), self.at("target").into()]);
        words
    }

    /// Starts the rendering of an image in 12 tiles, each of which takes some tenths of a second.
    fn render(&self, scheduler: &str, more: &[&str]) -> Child {
        command(&["-o"])
            .arg(self.at("out.exr"))
            .args(["--tile-size", "16", "--cluster", scheduler, "--dask"])
            .arg(&self.python)
            .arg("--target")
            .arg(self.at("target"))
            .args(more)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    }

    /// Number of finished jobs that wait to be merged.
    fn finished(&self) -> usize {
        let all = entries(&self.at("target/jobs"));
        all.iter().filter(|name| name.ends_with(".json")).count()
    }

    /// Whether a process runs a job of the workers of this cluster.
    fn runs_jobs(&self) -> bool {
        let folder = self.folder.path().as_os_str().as_encoded_bytes();
        let all = fs::read_dir("/proc").into_iter().flatten().flatten();
        all.filter_map(|process| fs::read(process.path().join("cmdline")).ok())
            .any(|line| {
                let has = |part: &[u8]| line.windows(part.len()).any(|bytes| bytes == part);
                has(b"run-job") && has(folder)
            })
    }

    fn told(&self, output: &Output) -> String {
        let dask = fs::read_to_string(self.at("dask.log")).unwrap_or_default();
        format!("{}\n{dask}", String::from_utf8_lossy(&output.stderr))
    }

    fn succeeds(&self, child: Child, whole: &[u8]) -> String {
        let output = child.wait_with_output().unwrap();
        assert!(output.status.success(), "{}", self.told(&output));
        assert!(fs::read(self.at("out.exr")).unwrap() == whole);
        // Nothing that was merged stays.
        assert!(entries(&self.at("target/jobs")).is_empty());
        String::from_utf8_lossy(&output.stderr).into_owned()
    }
}

fn command(more: &[&str]) -> Command {
    let mut command = Command::new(PROGRAM);
    command
        .env("RUST_BACKTRACE", "0")
        .arg("render")
        .arg(root().join("scenes/showcase/classic.toml"))
        .args(["--set", "film={width=64,height=48}", "--threads", "1"])
        .args(["--set", "sampler={type='grid',samples_per_axis=64}"])
        .args(more);
    command
}

/// The image of one process.
fn whole(folder: &Path) -> Vec<u8> {
    let path = folder.join("whole.exr");
    let output = command(&["-o"]).arg(&path).output().unwrap();
    assert!(output.status.success());
    fs::read(path).unwrap()
}

/// The same program with another hash.
fn other_version(folder: &Path) -> PathBuf {
    let path = folder.join("other");
    fs::copy(PROGRAM, &path).unwrap();
    let mut bytes = fs::read(&path).unwrap();
    bytes.push(0);
    fs::write(&path, bytes).unwrap();
    path
}

/// A program that kills itself at the job of the first tile.
fn poisoned(folder: &Path) -> PathBuf {
    let path = folder.join("poisoned");
    let script = format!(
        "#!/bin/sh\n\
         if [ \"$2\" = --program ]; then exec '{PROGRAM}' \"$@\"; fi\n\
         read -r line\n\
         case \"$line\" in *'\"tile\":[0,0,'*) kill -9 $$ ;; esac\n\
         file=$(mktemp '{}/job-XXXXXX')\n\
         printf '%s\\n' \"$line\" >\"$file\"\n\
         shift 3\n\
         exec '{PROGRAM}' run-job \"$file\" \"$@\"\n",
        folder.display()
    );
    fs::write(&path, script).unwrap();
    fs::set_permissions(&path, std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
    path
}

#[test]
fn a_local_cluster_gives_the_bytes_of_one_process() {
    let Some(python) = dask() else { return };
    let cluster = Cluster::new(&python);
    let whole = whole(cluster.folder.path());
    cluster.succeeds(cluster.render("local", &["--workers", "2"]), &whole);
    wait_until("end of the workers", || !cluster.runs_jobs());
}

#[test]
fn lost_late_and_foreign_workers_change_nothing() {
    let Some(python) = dask() else { return };
    let mut cluster = Cluster::new(&python);
    let whole = whole(cluster.folder.path());
    let _scheduler = cluster.scheduler();
    let good = Path::new(PROGRAM);
    let killed: [Process; 5] = std::array::from_fn(|_| cluster.worker(good));
    let stopped = cluster.worker(good);
    let _foreign = cluster.worker(&other_version(cluster.folder.path()));
    let rendering = cluster.render(&cluster.address().unwrap(), &[]);
    wait_until("first results", || cluster.finished() >= 1);
    killed.iter().for_each(|worker| worker.send("-KILL"));
    stopped.send("-STOP");
    assert!(cluster.finished() < 10, "the jobs were too short for this test");
    let _late = cluster.worker(good);
    let told = cluster.succeeds(rendering, &whole);
    assert!(told.contains("is not used: it needs whitstone"), "{told}");
    // The jobs of killed workers have ended by themselves; that of the stopped one ends with it.
    drop(stopped);
    wait_until("end of the jobs of lost workers", || !cluster.runs_jobs());
}

/// The values that do not depend on time and place, by their paths.
fn lasting(value: &Value, path: &str, found: &mut BTreeMap<String, Value>) {
    match value {
        Value::Object(map) => {
            for (key, value) in map {
                let is_time = key.ends_with("_s") || key == "seconds" || key == "ns_per_op";
                if !is_time && key != "threads" {
                    lasting(value, &format!("{path}.{key}"), found);
                }
            }
        }
        Value::Array(values) => {
            for (k, value) in values.iter().enumerate() {
                lasting(value, &format!("{path}.{k}"), found);
            }
        }
        value => drop(found.insert(path.to_owned(), value.clone())),
    }
}

/// Runs a command here and on a cluster, of which a worker is killed; both have the same results
/// and the same exit code.
fn same_results(cluster: &mut Cluster, folder: &Path, words: &[&str], code: i32) {
    let _scheduler = cluster.scheduler();
    let good = Path::new(PROGRAM);
    let (killed, _other) = (cluster.worker(good), cluster.worker(good));
    let json = ["here.json", "there.json"].map(|name| cluster.at(name));
    let command = |json: &Path| {
        let mut command = Command::new(PROGRAM);
        command
            .current_dir(folder)
            .args(words)
            .arg("--json")
            .arg(json)
            .env("RUST_BACKTRACE", "0")
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    };
    let there = command(&json[1]).args(cluster.on_it()).spawn().unwrap();
    wait_until("first results", || cluster.finished() >= 1);
    killed.send("-KILL");
    let there = there.wait_with_output().unwrap();
    assert_eq!(there.status.code(), Some(code), "{}", cluster.told(&there));
    assert!(entries(&cluster.at("target/jobs")).is_empty());
    let here = command(&json[0]).output().unwrap();
    assert_eq!(here.status.code(), Some(code), "{}", cluster.told(&here));
    let [here, there] = json.map(|path| {
        let value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
        let mut found = BTreeMap::new();
        lasting(&value, "", &mut found);
        found
    });
    let other = here.iter().find(|(path, value)| there.get(*path) != Some(value));
    assert!(other.is_none(), "{other:?}");
    assert_eq!(here.len(), there.len());
}

#[test]
fn validation_on_a_cluster_has_the_results_of_one_process() {
    let Some(python) = dask() else { return };
    let mut cluster = Cluster::new(&python);
    let common = ["validate", "--threads=1", "--reference=stored"];
    let words = [&common[..], &["scenes/shapes", "--matrix"]].concat();
    same_results(&mut cluster, &root(), &words, 0);
    // Pictures travel too.
    let page = fs::read_to_string(cluster.at("target/validate/index.html")).unwrap();
    assert!(page.contains("data:image/png"), "no pictures");
    // A scene with an error, or without a reference, is one result among others.
    let folder = cluster.folder.path().to_owned();
    fs::write(folder.join("wrong.toml"), "[camera]\ntype = \"perspectiv\"\n").unwrap();
    fs::copy(root().join("scenes/shapes/sphere.toml"), folder.join("new.toml")).unwrap();
    let words = [&common[..], &["new.toml", "wrong.toml"]].concat();
    same_results(&mut cluster, &folder, &words, 2);
}

#[test]
fn families_on_a_cluster_have_the_results_of_one_process() {
    let Some(python) = dask() else { return };
    let mut cluster = Cluster::new(&python);
    let words = [
        "stress",
        "planet",
        "telephoto",
        "thin_pane",
        "--quick",
        "--no-mitsuba",
    ];
    same_results(&mut cluster, &root(), &words, 0);
}

#[test]
fn studies_on_a_cluster_have_the_errors_of_one_process() {
    let Some(python) = dask() else { return };
    let cluster = Cluster::new(&python);
    let json = cluster.at("converge.json");
    let output = Command::new(PROGRAM)
        .current_dir(root())
        .args(["converge", "patterns", "--quick", "--cluster", "local", "--dask"])
        .arg(&python)
        .arg("--target")
        .arg(cluster.at("target"))
        .arg("--json")
        .arg(&json)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", cluster.told(&output));
    let value: Value = serde_json::from_slice(&fs::read(json).unwrap()).unwrap();
    let study = &value["studies"][0];
    assert_eq!(study["study"], "patterns");
    let points = study["series"][0]["points"].as_array().unwrap();
    assert!(points.iter().all(|point| point["rmse"].as_f64().is_some()));
}

#[test]
fn jobs_end_when_nobody_waits_for_them() {
    let Some(python) = dask() else { return };
    let mut cluster = Cluster::new(&python);
    let _scheduler = cluster.scheduler();
    let _worker = cluster.worker(Path::new(PROGRAM));
    let address = cluster.address().unwrap();
    // One job of some minutes.
    let long = ["--set", "sampler.samples_per_axis=1000", "--job-time", "1000"];
    let rendering = cluster.render(&address, &long);
    wait_until("a running job", || cluster.runs_jobs());
    let id = rendering.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-INT", &id])
            .status()
            .unwrap()
            .success()
    );
    let output = rendering.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", cluster.told(&output));
    wait_until("end of the jobs", || !cluster.runs_jobs());
}

/// A worker that can store nothing is not used; the other one does all jobs.
#[cfg(target_os = "linux")]
#[test]
fn a_worker_with_a_full_disk_is_not_used() {
    let Some(python) = dask() else { return };
    let mut cluster = Cluster::new(&python);
    let full = cluster.at("full");
    fs::create_dir(&full).unwrap();
    let mounted = Command::new("mount")
        .args(["-t", "tmpfs", "-o", "size=2m", "tmpfs"])
        .arg(&full)
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success());
    if !mounted {
        return skipped("a full disk: this user cannot mount a file system");
    }
    struct Mounted(PathBuf);
    impl Drop for Mounted {
        fn drop(&mut self) {
            let _ = Command::new("umount").arg("-l").arg(&self.0).status();
        }
    }
    let _mounted = Mounted(full.clone());
    let whole = whole(cluster.folder.path());
    let _scheduler = cluster.scheduler();
    let good = Path::new(PROGRAM);
    let _bad = cluster.worker_in(good, &full);
    let address = cluster.address().unwrap();
    wait_until("files of the worker", || !entries(&full).is_empty());
    // Nothing is left for files of jobs.
    let _ = fs::write(full.join("filler"), vec![0; 2 << 20]);
    let rendering = cluster.render(&address, &["--retries", "0"]);
    wait_until("connection", || cluster.at("target/cluster.log").exists());
    std::thread::sleep(Duration::from_secs(2));
    let _other = cluster.worker(good);
    let told = cluster.succeeds(rendering, &whole);
    assert!(told.contains("No space left on device"), "{told}");
}

/// The Python of the examples, with dask-jobqueue.
fn jobqueue() -> Option<PathBuf> {
    let requirements = root().join("examples/cluster/requirements.txt");
    let installation = whitstone::validate::Installation::default();
    let python = whitstone::validate::dask_python(&installation, &requirements, &|_| ());
    python
        .map_err(|error| skipped(&format!("the examples of clusters: {error}")))
        .ok()
}

/// Writes a program in a folder of `PATH`.
fn script(path: &Path, text: &str) {
    fs::write(path, format!("#!/bin/sh\n{text}")).unwrap();
    fs::set_permissions(path, std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
}

/// With programs that do on this machine what those of Slurm do.
#[test]
fn workers_that_are_jobs_of_slurm_give_the_bytes_of_one_process() {
    let Some(python) = jobqueue() else { return };
    let cluster = Cluster::new(&python);
    let whole = whole(cluster.folder.path());
    let bin = cluster.at("bin");
    fs::create_dir(&bin).unwrap();
    let log = cluster.at("slurm.log");
    script(
        &bin.join("sbatch"),
        &format!(
            "grep -q '^#SBATCH -n 1' \"$1\" || exit 1\n\
             cp \"$1\" \"$1.job\"\nsetsid bash \"$1.job\" >>'{0}' 2>&1 </dev/null &\n\
             echo \"Submitted batch job $!\"\n",
            log.display()
        ),
    );
    script(&bin.join("scancel"), "kill -- -\"$1\"\n");
    let path = std::env::var("PATH").unwrap_or_default();
    let output = Command::new(&python)
        .arg(root().join("examples/cluster/slurm.py"))
        .args(["--jobs", "2", "--cores", "1", "--memory", "1GiB", "--"])
        .arg(PROGRAM)
        .args(command(&["-o"]).get_args())
        .arg(cluster.at("out.exr"))
        .args(["--tile-size", "16", "--target"])
        .arg(cluster.at("target"))
        .current_dir(cluster.folder.path())
        .env("PATH", format!("{}:{path}", bin.display()))
        .env("TMPDIR", cluster.folder.path())
        .env("WHITSTONE", PROGRAM)
        .output()
        .unwrap();
    let slurm = fs::read_to_string(&log).unwrap_or_default();
    assert!(output.status.success(), "{}{slurm}", cluster.told(&output));
    assert!(fs::read(cluster.at("out.exr")).unwrap() == whole);
    wait_until("end of the jobs", || !cluster.runs_jobs());
}

/// The containers as processes of this machine.
#[test]
fn workers_on_kubernetes_give_the_bytes_of_one_process() {
    let Some(python) = dask() else { return };
    let cluster = Cluster::new(&python);
    let whole = whole(cluster.folder.path());
    let to_json = "import json, sys, yaml; print(json.dumps(list(yaml.safe_load_all(open(sys.argv[1])))))";
    let output = Command::new(&python)
        .args(["-c", to_json])
        .arg(root().join("examples/cluster/kubernetes.yaml"))
        .output()
        .unwrap();
    let objects: Vec<Value> = serde_json::from_slice(&output.stdout).unwrap();
    let [service, scheduler, worker] = &objects[..] else {
        panic!("{objects:?}")
    };
    for deployment in [scheduler, worker] {
        let spec = &deployment["spec"];
        assert_eq!(
            spec["selector"]["matchLabels"],
            spec["template"]["metadata"]["labels"]
        );
    }
    assert_eq!(
        service["spec"]["selector"],
        scheduler["spec"]["template"]["metadata"]["labels"]
    );
    let name = service["metadata"]["name"].as_str().unwrap();
    let port = service["spec"]["ports"][0]["targetPort"].to_string();
    let free = std::net::TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .port();
    let start = |deployment: &Value| {
        let container = &deployment["spec"]["template"]["spec"]["containers"][0];
        let words = container["command"].as_array().unwrap().iter();
        let words = words.map(|word| {
            word.as_str()
                .unwrap()
                .replace(name, "127.0.0.1")
                .replace(&port, &free.to_string())
                .replace("/scratch", &cluster.at("scratch").display().to_string())
        });
        let words: Vec<String> = words.collect();
        assert_eq!(words[0], "dask");
        let mut command = Command::new(python.with_file_name("dask"));
        command
            .args(&words[1..])
            .env("WHITSTONE", PROGRAM)
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        Process::start(&mut command)
    };
    let _scheduler = start(scheduler);
    let _workers = [start(worker), start(worker)];
    let rendering = cluster.render(&format!("tcp://127.0.0.1:{free}"), &[]);
    cluster.succeeds(rendering, &whole);
}

#[test]
fn a_lost_scheduler_and_a_poison_job_leave_what_is_finished() {
    let Some(python) = dask() else { return };
    let mut cluster = Cluster::new(&python);
    let whole = whole(cluster.folder.path());
    let good = Path::new(PROGRAM);
    let scheduler = cluster.scheduler();
    let worker = cluster.worker(good);
    let rendering = cluster.render(&cluster.address().unwrap(), &[]);
    wait_until("first results", || cluster.finished() >= 2);
    scheduler.send("-KILL");
    let output = rendering.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(3), "{}", cluster.told(&output));
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(text.contains("the scheduler is gone"), "{text}");
    assert!(
        text.contains("of 12 jobs are finished; the same command continues"),
        "{text}"
    );
    let before = cluster.finished();
    assert!((2..12).contains(&before), "{before}");
    drop(worker);
    drop(scheduler);

    let _scheduler = cluster.scheduler();
    let address = cluster.address().unwrap();
    let worker = cluster.worker(&poisoned(cluster.folder.path()));
    // That tile may be finished already; it is not if its result is gone.
    let first = poisoned_result(&cluster);
    let before = before - first;
    // With its neighbour in one task, which is not to blame.
    let output = cluster
        .render(&address, &["--retries", "1", "--chunk", "2"])
        .wait_with_output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{}", cluster.told(&output));
    assert!(
        text.contains(&format!("{before} of 12 jobs were finished before")),
        "{text}"
    );
    assert!(
        text.contains("tile [0, 0, 16, 16] of classic.toml, failed"),
        "{text}"
    );
    assert!(text.contains("ended by signal 9"), "{text}");
    assert!(text.contains("11 of 12 jobs are finished"), "{text}");
    assert!(!cluster.at("out.exr").exists());
    drop(worker);

    let _worker = cluster.worker(good);
    let told = cluster.succeeds(cluster.render(&address, &[]), &whole);
    assert!(told.contains("11 of 12 jobs were finished before"), "{told}");
}

/// Removes the result of the first tile; returns the number of results that it removed.
fn poisoned_result(cluster: &Cluster) -> usize {
    let jobs = cluster.at("jobs.jsonl");
    let planned = Command::new(PROGRAM)
        .arg("plan")
        .arg(root().join("scenes/showcase/classic.toml"))
        .args(["--set", "film={width=64,height=48}", "--tile-size", "16"])
        .args(["--set", "sampler={type='grid',samples_per_axis=64}", "-o"])
        .arg(&jobs)
        .output()
        .unwrap();
    assert!(planned.status.success());
    let text = fs::read_to_string(jobs).unwrap();
    let job: Value = serde_json::from_str(text.lines().next().unwrap()).unwrap();
    let record = format!("target/jobs/{}.json", job["id"].as_str().unwrap());
    usize::from(fs::remove_file(cluster.at(&record)).is_ok())
}
