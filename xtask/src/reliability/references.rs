//! Commands with a live Mitsuba that are killed.

use super::faults;
use super::kills::{Files, LIMIT, Quiet, again, clear, kill, kill_after, moment, undisturbed, whole};
use super::times::is_same;
use super::{Subject, Tally, files, is_temporary, put, run_within};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;
use whitstone::Failure;

/// A scene that takes little time.
const SCENE: &str = "scenes/materials/matte.toml";
/// Makes the processes of a command known.
const MARK: &str = "WHITSTONE_RELIABILITY";

/// A command with a live Mitsuba, and the folder of its files.
struct Live<'s> {
    subject: &'s Subject,
    folder: tempfile::TempDir,
    python: String,
}

impl<'s> Live<'s> {
    /// The inner error is the reason why there is no live Mitsuba.
    fn find(subject: &'s Subject) -> Result<Result<Self, String>, Failure> {
        if !cfg!(target_os = "linux") {
            return Ok(Err("the processes are known on Linux only.".to_owned()));
        }
        let program = subject.program.display().to_string();
        let words = [&program, "doctor", "--no-install", "--json", "-"];
        let output = subject.plain(&words.map(str::to_owned)).output();
        let output = output.map_err(Failure::environment)?;
        let found: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
        let Some(python) = found["live"]["python"].as_str() else {
            return Ok(Err(
                "there is no live Mitsuba (`whitstone doctor` installs it).".to_owned()
            ));
        };
        Ok(Ok(Self {
            subject,
            folder: tempfile::tempdir().map_err(Failure::environment)?,
            python: python.to_owned(),
        }))
    }

    /// A command, after `before` (such as strace and its options), with these arguments. `@` stands
    /// for the folder.
    fn command(&self, before: &[String], arguments: &[&str]) -> Command {
        let folder = self.folder.path().display().to_string();
        let program = [self.subject.program.display().to_string()];
        let own = arguments.iter().map(|argument| argument.replace('@', &folder));
        let usual = ["--mitsuba", &self.python].map(str::to_owned);
        let words: Vec<String> = (before.iter().cloned())
            .chain(program)
            .chain(own)
            .chain(usual)
            .collect();
        let mut command = self.subject.plain(&words);
        command.env(MARK, folder);
        command
    }

    /// The processes of this command and of the programs that it started, with their numbers.
    fn alive(&self) -> Vec<(String, String)> {
        let mark = format!("{MARK}={}", self.folder.path().display());
        let is_marked = |process: &Path| {
            let environment = fs::read(process.join("environ")).unwrap_or_default();
            environment
                .split(|byte| *byte == 0)
                .any(|entry| entry == mark.as_bytes())
        };
        let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
        let marked = processes.map(|entry| entry.path()).filter(|path| is_marked(path));
        let describe = |path: PathBuf| {
            let number = path
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned();
            let words = fs::read(path.join("cmdline")).unwrap_or_default();
            let words = String::from_utf8_lossy(&words).replace('\0', " ");
            (number, words.trim().to_owned())
        };
        marked.map(describe).collect()
    }
}

/// Kills validations with a live Mitsuba.
pub(super) fn drivers(subject: &Subject) -> Result<Tally, Failure> {
    let mut tally = Tally::default();
    let live = match Live::find(subject)? {
        Ok(live) => live,
        Err(why) => {
            tally.skipped = Some(why);
            return Ok(tally);
        }
    };
    let folder = live.folder.path();
    let arguments = [
        "validate",
        SCENE,
        "--reference",
        "live",
        "--fresh",
        "--no-oracle",
        "--json",
        "@/v.json",
        "--target",
        "@/target",
    ];
    let command = || live.command(&[], &arguments);
    let (undisturbed, time) = undisturbed(&mut command(), folder)?;
    let mut with_driver = 0;
    for attempt in 0..if subject.quick { 3 } else { 60 } {
        clear(folder)?;
        let moment = moment(attempt, time);
        let child = command().spawn_quietly()?;
        std::thread::sleep(moment);
        let own = child.id().to_string();
        let has_driver = live.alive().iter().any(|(number, _)| *number != own);
        if !kill(child)? {
            continue;
        }
        with_driver += usize::from(has_driver);
        std::thread::sleep(Duration::from_secs(1));
        let mut seen = match live.alive().first() {
            Some((_, process)) => Err(format!("after 1 s, this is alive: {process}")),
            None => whole(&files(folder), &undisturbed, true),
        };
        seen = seen.and(again(&mut command(), folder, &undisturbed)?);
        tally.count(seen.map_err(|seen| format!("validate, killed after {moment:.0?}: {seen}")));
    }
    if with_driver == 0 {
        let seen = "no attempt was killed while a driver was alive";
        tally.broken.push(seen.to_owned());
    }
    Ok(tally)
}

/// Kills commands that store references.
pub(super) fn stored(subject: &Subject) -> Result<Tally, Failure> {
    let mut tally = Tally::default();
    let live = match Live::find(subject)? {
        Ok(live) => live,
        Err(why) => {
            tally.skipped = Some(why);
            return Ok(tally);
        }
    };
    let folder = live.folder.path();
    let arguments = [
        "reference",
        SCENE,
        "--accept",
        "--all",
        "--target",
        "@/target",
        "--references",
        "@/images",
        "--set",
        "film={width=32,height=24}",
    ];
    let command = |before: &[String], more: &[&str]| live.command(before, &[&arguments, more].concat());
    let (mut old, _) = undisturbed(&mut command(&[], &["--set", "camera.fov=60"]), folder)?;
    clear(folder)?;
    let (new, time) = undisturbed(&mut command(&[], &[]), folder)?;
    if is_refused(&live, &arguments)?.is_ok() {
        return Err(Failure::environment("`validate` does not use a stored reference"));
    }
    old.retain(|name, _| is_stored(name));
    make_older(&mut old, &new)?;
    let start = || clear(folder).and_then(|()| put(folder, old.iter()));

    // How each attempt ends: at a moment, or before a system call.
    let mut ends: Vec<(String, Vec<String>, Duration)> = (0..if subject.quick { 1 } else { 20 })
        .map(|number| moment(number, time))
        .map(|moment| (format!("after {moment:.0?}"), Vec::new(), moment))
        .collect();
    if faults::is_available() {
        start()?;
        let counts = faults::counts(&[], false, |before| command(before, &[]))?;
        for (call, count) in counts.iter().filter(|(call, _)| call.starts_with("rename")) {
            // The last ones replace the reference.
            let first = count.saturating_sub(if subject.quick { 3 } else { 12 });
            ends.extend((first + 1..=*count).map(|number| {
                let inject = format!("inject={call}:signal=SIGKILL:when={number}");
                let options = ["strace", "-qq", "-o", "/dev/null", "-e"].map(str::to_owned);
                let before = options.into_iter().chain([inject.clone()]).collect();
                (inject, before, LIMIT)
            }));
        }
    } else {
        println!("skipped  kills before each rename: strace is not installed");
    }
    for (end, before, moment) in ends {
        start()?;
        let mut command_that_ends = command(&before, &[]);
        if before.is_empty() {
            if !kill_after(command_that_ends.spawn_quietly()?, moment)? {
                continue;
            }
        } else if run_within(&mut command_that_ends, moment)
            .map_err(Failure::environment)?
            .is_none()
        {
            return Err(Failure::environment(format!(
                "the command with {end} does not end"
            )));
        }
        let mut found = files(folder);
        found.retain(|name, _| is_stored(name) && !is_temporary(name));
        let stored = new.iter().filter(|(name, _)| is_stored(name));
        let of = |all: &Files| found.len() == all.len() && whole(&found, all, false).is_ok();
        let mut seen = Ok(());
        if !of(&old)
            && !of(&stored
                .map(|(name, bytes)| (name.clone(), bytes.clone()))
                .collect())
        {
            seen = is_refused(&live, &arguments)?;
        }
        seen = seen.and(again(&mut command(&[], &[]), folder, &new)?);
        tally.count(seen.map_err(|seen| format!("reference, {end}: {seen}")));
    }
    Ok(tally)
}

/// Whether a file belongs to a stored reference.
fn is_stored(name: &str) -> bool {
    name.starts_with("images/")
}

/// Makes the reference of another scene one of the same scene, with another floor.
fn make_older(old: &mut Files, new: &Files) -> Result<(), Failure> {
    let bad = || Failure::environment("a stored reference has no metadata");
    let read =
        |bytes: &Vec<u8>| -> Option<toml::Table> { toml::from_str(std::str::from_utf8(bytes).ok()?).ok() };
    let (name, bytes) = old
        .iter_mut()
        .find(|(name, _)| name.ends_with("meta.toml"))
        .ok_or_else(bad)?;
    let mut meta = read(bytes).ok_or_else(bad)?;
    let current = new.get(name).and_then(read).ok_or_else(bad)?;
    let hash = current.get("scene_hash").ok_or_else(bad)?;
    meta.insert("scene_hash".to_owned(), hash.clone());
    meta.insert("floor".to_owned(), 0.125.into());
    *bytes = meta.to_string().into_bytes();
    // Otherwise no mixture would be seen.
    let same = old
        .iter()
        .any(|(name, bytes)| is_same(name, bytes, new.get(name)));
    if same {
        Err(Failure::environment("the old and the new reference are the same"))
    } else {
        Ok(())
    }
}

/// An error if `validate` uses the stored reference.
fn is_refused(live: &Live<'_>, arguments: &[&str]) -> Result<Result<(), String>, Failure> {
    let scene = &arguments[6..];
    // Its report is not one of the files that are compared.
    let target = tempfile::tempdir().map_err(Failure::environment)?;
    let target = target.path().to_string_lossy();
    let words = [
        &[
            "validate",
            SCENE,
            "--reference",
            "stored",
            "--no-oracle",
            "--json",
            "-",
            "--target",
            &target,
        ],
        scene,
    ]
    .concat();
    let output = live.command(&[], &words).output().map_err(Failure::environment)?;
    let results: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
    let results = results["results"].as_array().map_or(&[][..], Vec::as_slice);
    Ok(match results.iter().any(|result| result["compared"] == true) {
        true => Err("the image of one reference is used with the floor of another".to_owned()),
        false => Ok(()),
    })
}
