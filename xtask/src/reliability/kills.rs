//! Commands that are killed.

use super::times::difference;
use super::{
    CASES, CONVERGE, Subject, Tally, extension, files, is_input, is_temporary, is_whole, pick, put,
    run_within,
};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use whitstone::Failure;

/// The files of a folder, by relative name.
pub(super) type Files = BTreeMap<String, Vec<u8>>;

/// Contents of the files that are there before.
const OLD: &[u8] = b"the file of an earlier run";

pub(super) const LIMIT: Duration = Duration::from_secs(60);

/// At most this many undisturbed runs show which values differ from run to run.
const MOST_RUNS: usize = 6;

pub(super) fn run(subject: &Subject) -> Result<Tally, Failure> {
    let mut tally = Tally::default();
    let attempts = if subject.quick { 8 } else { 150 };
    let cases = CASES.iter().filter(|case| case.is_killed).chain([&CONVERGE]);
    for (number, case) in cases.enumerate() {
        let folder = subject.folder()?;
        let command = || subject.command(&[], case, folder.path());
        let mut undisturbed = Undisturbed::run(command, folder.path(), case.exit_code())?;
        subject.check_outputs(case, undisturbed.files())?;
        let mut records = 0;
        for attempt in 0..attempts {
            // The folder is the same one, because files contain its path.
            undisturbed.start()?;
            // Half of them over files of an earlier run.
            if attempt % 2 == 1 && case.name != "validate" {
                let outputs = undisturbed.files().keys().filter(|name| !is_input(name));
                let old = OLD.to_vec();
                put(folder.path(), outputs.map(|name| (name, &old)))?;
            }
            let moment = moment(number * attempts + attempt, undisturbed.time);
            if !kill_after(command().spawn_quietly()?, moment)? {
                continue;
            }
            let killed = files(folder.path());
            records += killed
                .keys()
                .filter(|name| record(name, &killed).is_some())
                .count();
            let mut seen = whole(&killed, undisturbed.files());
            seen = seen.and(undisturbed.again(&killed)?);
            tally.count(seen.map_err(|seen| format!("{}, killed after {moment:.0?}: {seen}", case.name)));
        }
        if case.name == CONVERGE.name && records == 0 {
            let seen = "no `converge` that was killed had stored a measurement";
            tally.broken.push(seen.to_owned());
        }
    }
    Ok(tally)
}

/// A command that is not killed, and the files of several runs of it.
pub(super) struct Undisturbed<'c, C> {
    command: C,
    folder: &'c Path,
    /// The files that are there before.
    inputs: Files,
    exit_code: i32,
    /// The files after each run. Two show which values differ from run to run; others follow where
    /// a killed command differs in one more.
    runs: Vec<Files>,
    /// How long a run takes.
    pub(super) time: Duration,
}

impl<'c, C: Fn() -> Command> Undisturbed<'c, C> {
    /// Runs a command twice, with the files in the folder. It must end with this exit code.
    pub(super) fn run(command: C, folder: &'c Path, exit_code: i32) -> Result<Self, Failure> {
        let mut undisturbed = Self {
            command,
            folder,
            inputs: files(folder),
            exit_code,
            runs: Vec::new(),
            time: Duration::ZERO,
        };
        for _ in 0..2 {
            let start = Instant::now();
            undisturbed.run_once()?;
            undisturbed.time = start.elapsed();
        }
        Ok(undisturbed)
    }

    fn run_once(&mut self) -> Result<(), Failure> {
        self.start()?;
        self.ends()?.map_err(Failure::environment)?;
        self.runs.push(files(self.folder));
        Ok(())
    }

    /// Restores the files that are there before.
    pub(super) fn start(&self) -> Result<(), Failure> {
        clear(self.folder)?;
        put(self.folder, self.inputs.iter())
    }

    /// The files after the first run.
    pub(super) fn files(&self) -> &Files {
        &self.runs[0]
    }

    /// Runs the command. The inner error is an end that is not the expected one.
    fn ends(&self) -> Result<Result<(), String>, Failure> {
        let mut command = (self.command)();
        let ended = run_within(&mut command, LIMIT).map_err(Failure::environment)?;
        Ok(match ended {
            None => Err(format!("{command:?} does not end")),
            Some(output) if output.status.code() == Some(self.exit_code) => Ok(()),
            Some(output) => Err(format!(
                "{command:?} ends with {}, not with exit code {}: {}",
                output.status,
                self.exit_code,
                String::from_utf8_lossy(&output.stderr).trim()
            )),
        })
    }

    /// Runs a killed command again: its files must be those of an undisturbed run, and the
    /// measurements that it had stored must be kept.
    pub(super) fn again(&mut self, killed: &Files) -> Result<Result<(), String>, Failure> {
        if let Err(seen) = self.ends()? {
            return Ok(Err(format!("the next run: {seen}")));
        }
        let found = files(self.folder);
        let mut seen = self.are_same(&found);
        while seen.is_err() && self.runs.len() < MOST_RUNS {
            self.run_once()?;
            seen = self.are_same(&found);
        }
        Ok(seen.and(continues(killed, &found)))
    }

    /// Whether all files are those of the undisturbed runs.
    fn are_same(&self, found: &Files) -> Result<(), String> {
        self.are_same_among(found, |_| true)
    }

    /// The same, of the files of some names.
    pub(super) fn are_same_among(&self, found: &Files, is_of: fn(&str) -> bool) -> Result<(), String> {
        for (name, bytes) in found {
            let expected: Option<Vec<&Vec<u8>>> = self.runs.iter().map(|run| run.get(name)).collect();
            let place = match expected {
                Some(expected) if !is_temporary(name) => difference(name, bytes, &expected),
                _ => Some(String::new()),
            };
            if let Some(place) = place {
                let seen = format!("after the next run, {name} is not that of an undisturbed run");
                return Err(if place.is_empty() {
                    seen
                } else {
                    format!("{seen}: {place}")
                });
            }
        }
        let mut expected = self.files().keys().filter(|name| is_of(name));
        let missing = expected.find(|name| !found.contains_key(*name));
        missing.map_or(Ok(()), |name| Err(format!("the next run does not write {name}")))
    }
}

/// The times of a measurement that `converge` stores, and how many are needed.
fn record(name: &str, files: &Files) -> Option<(Vec<Value>, usize)> {
    if is_temporary(name) || extension(name) != "json" {
        return None;
    }
    let record: Value = serde_json::from_slice(files.get(name)?).ok()?;
    let contents = &record["contents"];
    let repeats = contents["repeats"].as_u64()?;
    Some((contents["times"].as_array()?.clone(), repeats as usize))
}

/// Whether the measurements that were stored before a kill are kept: those with all times byte for
/// byte, and others with more times after the ones that they had.
fn continues(killed: &Files, found: &Files) -> Result<(), String> {
    for (name, bytes) in killed {
        let Some((before, repeats)) = record(name, killed) else {
            continue;
        };
        let is_kept = match record(name, found) {
            Some(_) if before.len() >= repeats => found.get(name) == Some(bytes),
            Some((after, _)) => after.starts_with(&before),
            None => false,
        };
        if !is_kept {
            return Err(format!("the next run measures {name} again"));
        }
    }
    Ok(())
}

/// A random moment of a run, the same for each number.
pub(super) fn moment(number: usize, time: Duration) -> Duration {
    time.mul_f64(pick(number as u64, 1000) as f64 / 1000.0)
}

/// Starts a command without output.
pub(super) trait Quiet {
    fn spawn_quietly(&mut self) -> Result<std::process::Child, Failure>;
}

impl Quiet for Command {
    fn spawn_quietly(&mut self) -> Result<std::process::Child, Failure> {
        let quiet = self.stdout(Stdio::null()).stderr(Stdio::null());
        quiet.spawn().map_err(Failure::environment)
    }
}

/// Kills a command at a moment; returns whether that was before its end.
pub(super) fn kill_after(child: std::process::Child, moment: Duration) -> Result<bool, Failure> {
    std::thread::sleep(moment);
    kill(child)
}

/// Kills a command; returns whether that was before its end.
pub(super) fn kill(mut child: std::process::Child) -> Result<bool, Failure> {
    child.kill().map_err(Failure::environment)?;
    child.wait().map(is_killed).map_err(Failure::environment)
}

#[cfg(unix)]
pub(super) fn is_killed(status: std::process::ExitStatus) -> bool {
    const SIGKILL: i32 = 9;
    std::os::unix::process::ExitStatusExt::signal(&status) == Some(SIGKILL)
}

#[cfg(not(unix))]
pub(super) fn is_killed(status: std::process::ExitStatus) -> bool {
    !status.success()
}

/// Removes everything in a folder.
pub(super) fn clear(folder: &Path) -> Result<(), Failure> {
    fs::remove_dir_all(folder)
        .and_then(|()| fs::create_dir(folder))
        .map_err(Failure::environment)
}

/// Whether all files are complete after a kill. Temporaries and files of earlier runs may be there.
pub(super) fn whole(found: &Files, undisturbed: &Files) -> Result<(), String> {
    let bad = found.iter().find(|(name, bytes)| {
        !is_temporary(name) && *bytes != OLD && !is_whole(name, bytes, undisturbed.get(*name))
    });
    bad.map_or(Ok(()), |(name, _)| {
        Err(format!("after the kill, {name} is not whole"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn only_a_command_that_did_not_end_is_killed() {
        let ended = Command::new("true").spawn_quietly().unwrap();
        assert!(!kill_after(ended, Duration::from_millis(500)).unwrap());
        let sleeps = Command::new("sleep").arg("60").spawn_quietly().unwrap();
        assert!(kill_after(sleeps, Duration::ZERO).unwrap());
    }

    #[test]
    fn harm_is_found() {
        let files = |name: &str, bytes: &[u8]| BTreeMap::from([(name.to_owned(), bytes.to_vec())]);
        let run = |seconds: &str| {
            BTreeMap::from([
                ("x.exr".to_owned(), b"image".to_vec()),
                (
                    "c.json".to_owned(),
                    format!(r#"{{"rmse": 0.25, "seconds": {seconds}}}"#).into_bytes(),
                ),
            ])
        };
        let undisturbed = Undisturbed {
            command: || Command::new("true"),
            folder: Path::new(""),
            inputs: Files::new(),
            exit_code: 0,
            runs: vec![run("1.0"), run("1.5")],
            time: Duration::ZERO,
        };
        for (found, passes) in [
            (files("x.exr", b"image"), true),
            (files("x.exr", b"ima"), false),
            (files("x.exr", OLD), true),
            (files("c.json", br#"{"rmse": 0.26"#), false),
            (files(".whitstone-a.tmp", b""), true),
        ] {
            assert_eq!(whole(&found, undisturbed.files()).is_ok(), passes, "{found:?}");
        }
        assert_eq!(undisturbed.are_same(&run("2.0")), Ok(()));
        for (name, bytes) in [
            ("x.exr", OLD),
            ("c.json", br#"{"rmse": 0.26, "seconds": 1.0}"#),
            (".whitstone-a.tmp", b""),
        ] {
            let mut found = run("1.0");
            found.extend(files(name, bytes));
            assert!(undisturbed.are_same(&found).is_err(), "{name}");
        }
        assert!(undisturbed.are_same(&files("x.exr", b"image")).is_err());
    }

    #[test]
    fn measurements_are_kept() {
        let file = |times: &str, build: &str| {
            let text = format!(
                r#"{{"hash": "", "contents": {{"times": [{times}], "repeats": 2, "build_s": {build}}}}}"#
            );
            BTreeMap::from([("target/k.json".to_owned(), text.into_bytes())])
        };
        let kept = |before, after| continues(&before, &after).is_ok();
        assert!(kept(file("1.5, 2.5", "1.0"), file("1.5, 2.5", "1.0")));
        assert!(!kept(file("1.5, 2.5", "1.0"), file("1.5, 2.5", "2.0")));
        assert!(kept(file("1.5", "1.0"), file("1.5, 3.5", "1.0")));
        assert!(!kept(file("1.5", "1.0"), file("1.25, 3.5", "1.0")));
        assert!(!kept(file("1.5", "1.0"), Files::new()));
    }
}
