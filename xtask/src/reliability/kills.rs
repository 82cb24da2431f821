//! Commands that are killed.

use super::{CASES, Subject, Tally, files, is_input, is_temporary, is_whole, pick, run_within};
use std::collections::BTreeMap;
use std::fs;
use std::process::Stdio;
use std::time::{Duration, Instant};
use whitstone::Failure;

/// Contents of the files that are there before.
const OLD: &[u8] = b"the file of an earlier run";

const LIMIT: Duration = Duration::from_secs(60);

pub(super) fn run(subject: &Subject) -> Result<Tally, Failure> {
    let mut tally = Tally::default();
    let attempts = if subject.quick { 8 } else { 150 };
    for (number, case) in CASES.iter().filter(|case| case.is_killed).enumerate() {
        let folder = subject.folder()?;
        let start = Instant::now();
        let ended = run_within(&mut subject.command(&[], case, folder.path()), LIMIT);
        ended.map_err(Failure::environment)?;
        let time = start.elapsed();
        let undisturbed = files(folder.path());
        subject.check_outputs(case, &undisturbed)?;
        for attempt in 0..attempts {
            let folder = subject.folder_with(&undisturbed)?;
            // Half of them over files of an earlier run.
            let overwrites = attempt % 2 == 1 && case.name != "validate";
            let outputs = undisturbed.keys().filter(|name| !is_input(name));
            for name in outputs.filter(|_| overwrites) {
                let path = folder.path().join(name);
                let made = path.parent().map_or(Ok(()), fs::create_dir_all);
                made.and_then(|()| fs::write(&path, OLD))
                    .map_err(Failure::environment)?;
            }
            let mut child = subject
                .command(&[], case, folder.path())
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn()
                .map_err(Failure::environment)?;
            let moment = pick((number * attempts + attempt) as u64, 1000) as f64 / 1000.0;
            std::thread::sleep(time.mul_f64(moment));
            child.kill().map_err(Failure::environment)?;
            child.wait().map_err(Failure::environment)?;
            let mut seen = whole(&files(folder.path()), &undisturbed, true);
            let again = run_within(&mut subject.command(&[], case, folder.path()), LIMIT);
            let again = again.map_err(Failure::environment)?;
            if again.is_none() {
                seen = seen.and(Err("the next run does not end".to_owned()));
            }
            let found = files(folder.path());
            seen = seen
                .and_then(|()| whole(&found, &undisturbed, false))
                .and_then(|()| {
                    let missing = undisturbed.keys().find(|name| !found.contains_key(*name));
                    missing.map_or(Ok(()), |name| Err(format!("the next run does not write {name}")))
                });
            tally.count(seen.map_err(|seen| {
                format!(
                    "{}, killed after {:.0} ms: {seen}",
                    case.name,
                    1e3 * time.mul_f64(moment).as_secs_f64()
                )
            }));
        }
    }
    Ok(tally)
}

/// Whether all files are complete. After a kill, temporaries and files of earlier runs may be
/// there.
fn whole(
    found: &BTreeMap<String, Vec<u8>>,
    undisturbed: &BTreeMap<String, Vec<u8>>,
    killed: bool,
) -> Result<(), String> {
    for (name, bytes) in found {
        let passes = match is_temporary(name) {
            true => killed,
            false => (killed && bytes == OLD) || is_whole(name, bytes, undisturbed.get(name)),
        };
        if !passes {
            let when = if killed {
                "after the kill"
            } else {
                "after the next run"
            };
            return Err(format!("{when}, {name} is not whole"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn harm_is_found() {
        let files = |name: &str, bytes: &[u8]| BTreeMap::from([(name.to_owned(), bytes.to_vec())]);
        let undisturbed = files("x.exr", b"image");
        for (found, killed, passes) in [
            (files("x.exr", b"image"), false, true),
            (files("x.exr", b"ima"), true, false),
            (files("x.exr", OLD), true, true),
            (files("x.exr", OLD), false, false),
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
