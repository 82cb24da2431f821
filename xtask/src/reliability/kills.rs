//! Commands that are killed.

use super::times::is_same;
use super::{
    CASES, CONVERGE, Subject, Tally, files, is_input, is_temporary, is_whole, pick, put, run_within,
};
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

pub(super) fn run(subject: &Subject) -> Result<Tally, Failure> {
    let mut tally = Tally::default();
    let attempts = if subject.quick { 8 } else { 150 };
    let cases = CASES.iter().filter(|case| case.is_killed).chain([&CONVERGE]);
    for (number, case) in cases.enumerate() {
        let folder = subject.folder()?;
        let command = || subject.command(&[], case, folder.path());
        let (undisturbed, time) = undisturbed(&mut command(), folder.path())?;
        subject.check_outputs(case, &undisturbed)?;
        for attempt in 0..attempts {
            // The folder is the same one, because files contain its path.
            clear(folder.path())?;
            let inputs = undisturbed.iter().filter(|(name, _)| is_input(name));
            put(folder.path(), inputs)?;
            // Half of them over files of an earlier run.
            if attempt % 2 == 1 && case.name != "validate" {
                let outputs = undisturbed.keys().filter(|name| !is_input(name));
                let old = OLD.to_vec();
                put(folder.path(), outputs.map(|name| (name, &old)))?;
            }
            let moment = moment(number * attempts + attempt, time);
            if !kill_after(command().spawn_quietly()?, moment)? {
                continue;
            }
            let seen = whole(&files(folder.path()), &undisturbed, true);
            let seen = seen.and(again(&mut command(), folder.path(), &undisturbed)?);
            tally.count(seen.map_err(|seen| format!("{}, killed after {moment:.0?}: {seen}", case.name)));
        }
    }
    Ok(tally)
}

/// Runs a command; returns its files and the time that it takes.
pub(super) fn undisturbed(command: &mut Command, folder: &Path) -> Result<(Files, Duration), Failure> {
    let start = Instant::now();
    let ended = run_within(command, LIMIT).map_err(Failure::environment)?;
    // `compare` finds a difference.
    if !ended.is_some_and(|output| matches!(output.status.code(), Some(0 | 1))) {
        return Err(Failure::environment(format!("{command:?} fails")));
    }
    Ok((files(folder), start.elapsed()))
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
fn is_killed(status: std::process::ExitStatus) -> bool {
    const SIGKILL: i32 = 9;
    std::os::unix::process::ExitStatusExt::signal(&status) == Some(SIGKILL)
}

#[cfg(not(unix))]
fn is_killed(status: std::process::ExitStatus) -> bool {
    !status.success()
}

/// Removes everything in a folder.
pub(super) fn clear(folder: &Path) -> Result<(), Failure> {
    fs::remove_dir_all(folder)
        .and_then(|()| fs::create_dir(folder))
        .map_err(Failure::environment)
}

/// Runs a killed command again: its files must be those of an undisturbed run.
pub(super) fn again(
    command: &mut Command,
    folder: &Path,
    undisturbed: &Files,
) -> Result<Result<(), String>, Failure> {
    if run_within(command, LIMIT)
        .map_err(Failure::environment)?
        .is_none()
    {
        return Ok(Err("the next run does not end".to_owned()));
    }
    let found = files(folder);
    Ok(whole(&found, undisturbed, false).and_then(|()| {
        let missing = undisturbed.keys().find(|name| !found.contains_key(*name));
        missing.map_or(Ok(()), |name| Err(format!("the next run does not write {name}")))
    }))
}

/// Whether all files are complete. After a kill, temporaries and files of earlier runs may be
/// there; after the next run, all are those of an undisturbed one.
pub(super) fn whole(found: &Files, undisturbed: &Files, killed: bool) -> Result<(), String> {
    for (name, bytes) in found {
        let expected = undisturbed.get(name);
        let passes = match (is_temporary(name), killed) {
            (true, _) => killed,
            (false, true) => bytes == OLD || is_whole(name, bytes, expected),
            (false, false) => is_same(name, bytes, expected),
        };
        if !passes && killed {
            return Err(format!("after the kill, {name} is not whole"));
        }
        if !passes {
            return Err(format!(
                "after the next run, {name} is not that of an undisturbed run"
            ));
        }
    }
    Ok(())
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
        let undisturbed = BTreeMap::from([
            ("x.exr".to_owned(), b"image".to_vec()),
            ("c.json".to_owned(), br#"{"rmse": 0.25, "seconds": 1.0}"#.to_vec()),
        ]);
        for (found, killed, passes) in [
            (files("x.exr", b"image"), false, true),
            (files("x.exr", b"ima"), true, false),
            (files("x.exr", OLD), true, true),
            (files("x.exr", OLD), false, false),
            (files("c.json", br#"{"rmse": 0.25, "seconds": 2.0}"#), false, true),
            (
                files("c.json", br#"{"rmse": 0.26, "seconds": 1.0}"#),
                false,
                false,
            ),
            (files("c.json", br#"{"rmse": 0.26"#), true, false),
            (files(".whitstone-a.tmp", b""), true, true),
            (files(".whitstone-a.tmp", b""), false, false),
        ] {
            assert_eq!(
                whole(&found, &undisturbed, killed).is_ok(),
                passes,
                "{found:?} {killed}"
            );
        }
    }
}
