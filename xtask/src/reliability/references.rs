//! Commands with a live Mitsuba that are killed.

use super::faults;
use super::kills::{Files, LIMIT, Quiet, Undisturbed, clear, is_killed, kill, kill_after, moment, whole};
use super::{Subject, Tally, files, is_temporary, put, run_within};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};
use whitstone::Failure;
use whitstone::validate::environment::Environment;
use whitstone::validate::{Installation, Renderer, stored};

/// A scene that takes little time.
const SCENE: &str = "scenes/materials/matte.toml";
/// The options of the stored reference, of `reference` and of `validate`.
const STORED: [&str; 4] = ["--references", "@/images", "--set", "film={width=32,height=24}"];
/// The reason for which `validate` refuses files of different references.
const REFUSED: &str = "the metadata and the image files do not belong together";
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
        let Some(environment) = Environment::existing(&Installation::default()) else {
            return Ok(Err(
                "there is no live Mitsuba (`whitstone doctor` installs it).".to_owned()
            ));
        };
        Ok(Ok(Self {
            subject,
            folder: tempfile::tempdir().map_err(Failure::environment)?,
            python: environment.python.display().to_string(),
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
    let mut undisturbed = Undisturbed::run(command, folder, 0)?;
    let mut with_driver = 0;
    for attempt in 0..if subject.quick { 3 } else { 60 } {
        undisturbed.start()?;
        let moment = moment(attempt, undisturbed.time);
        let child = command().spawn_quietly()?;
        std::thread::sleep(moment);
        let own = child.id().to_string();
        let has_driver = live.alive().iter().any(|(number, _)| *number != own);
        if !kill(child)? {
            continue;
        }
        with_driver += usize::from(has_driver);
        let killed_at = Instant::now();
        while killed_at.elapsed() < ENDED && !live.alive().is_empty() {
            std::thread::sleep(Duration::from_millis(50));
        }
        let killed = files(folder);
        let mut seen = match live.alive().first() {
            Some((_, process)) => Err(format!("after {ENDED:.0?}, this is alive: {process}")),
            None => whole(&killed, undisturbed.files()),
        };
        seen = seen.and(undisturbed.again(&killed)?);
        tally.count(seen.map_err(|seen| format!("validate, killed after {moment:.0?}: {seen}")));
    }
    if with_driver == 0 {
        let seen = "no attempt was killed while a driver was alive";
        tally.broken.push(seen.to_owned());
    }
    Ok(tally)
}

/// After this time, all processes of a killed command must have ended.
const ENDED: Duration = Duration::from_secs(1);

/// Kills commands that store references.
pub(super) fn stored(subject: &Subject) -> Result<Tally, Failure> {
    let mut tally = Tally::default();
    if !faults::is_available() {
        tally.skipped = Some(faults::MISSING.to_owned());
        return Ok(tally);
    }
    let live = match Live::find(subject)? {
        Ok(live) => live,
        Err(why) => {
            tally.skipped = Some(why);
            return Ok(tally);
        }
    };
    let folder = live.folder.path();
    let store = ["reference", SCENE, "--accept", "--all", "--target", "@/target"];
    let arguments = [&store[..], &STORED].concat();
    let command = |before: &[String], more: &[&str]| live.command(before, &[&arguments[..], more].concat());
    let other = || command(&[], &["--set", "camera.fov=60"]);
    let mut old = Undisturbed::run(other, folder, 0)?.files().clone();
    clear(folder)?;
    let mut new = Undisturbed::run(|| command(&[], &[]), folder, 0)?;
    must_be_used(&live, "new")?;
    old.retain(|name, _| is_stored(name));
    make_older(&mut old, new.files())?;
    let start = || clear(folder).and_then(|()| put(folder, old.iter()));
    start()?;
    must_be_used(&live, "old")?;

    // How each attempt ends: at a moment, or before a system call.
    let mut ends: Vec<(String, Vec<String>, Duration)> = (0..if subject.quick { 1 } else { 20 })
        .map(|number| moment(number, new.time))
        .map(|moment| (format!("after {moment:.0?}"), Vec::new(), moment))
        .collect();
    start()?;
    let counts = faults::counts(&[], 0, |before| command(before, &[]))?;
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
    for (end, before, moment) in ends {
        start()?;
        let mut command_that_ends = command(&before, &[]);
        let was_killed = if before.is_empty() {
            kill_after(command_that_ends.spawn_quietly()?, moment)?
        } else {
            let ended = run_within(&mut command_that_ends, moment).map_err(Failure::environment)?;
            let ended =
                ended.ok_or_else(|| Failure::environment(format!("the command with {end} does not end")))?;
            // It ends as the command does.
            is_killed(ended.status)
        };
        if !was_killed {
            continue;
        }
        let killed = files(folder);
        let mut found = killed.clone();
        found.retain(|name, _| is_stored(name) && !is_temporary(name));
        let mut seen = Ok(());
        if found != old && new.are_same_among(&found, is_stored).is_err() {
            seen = answer(&live)?.and_then(|answer| match answer {
                Answer::Used => {
                    Err("the image of one reference is used with the floor of another".to_owned())
                }
                Answer::Refused => Ok(()),
            });
        }
        seen = seen.and(new.again(&killed)?);
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
        .iter()
        .find(|(name, _)| name.ends_with("meta.toml"))
        .ok_or_else(bad)?;
    let mut meta = read(bytes).ok_or_else(bad)?;
    let current = new.get(name).and_then(read).ok_or_else(bad)?;
    let hash = current.get("scene_hash").ok_or_else(bad)?;
    meta.insert("scene_hash".to_owned(), hash.clone());
    meta.insert("floor".to_owned(), 0.125.into());
    meta.remove("hash");
    let text = meta.to_string();
    let name = name.clone();
    let of = |file: String| {
        let file = name.replace("meta.toml", &file);
        old.get(&file).map_or(&[][..], Vec::as_slice)
    };
    let (image, variants) = (Renderer::MITSUBA.image_file(), Renderer::MITSUBA.variants_file());
    let hash = stored::hash(&text, [of(image), of(variants)]);
    let text = format!("hash = \"{hash}\"\n{text}");
    old.insert(name, text.into_bytes());
    // Otherwise no mixture would be seen.
    let same = old.iter().any(|(name, bytes)| new.get(name) == Some(bytes));
    if same {
        Err(Failure::environment("the old and the new reference are the same"))
    } else {
        Ok(())
    }
}

/// What `validate` does with the stored reference.
#[derive(Debug, PartialEq)]
enum Answer {
    Used,
    /// Its files do not belong together.
    Refused,
}

/// Runs `validate` with the stored reference. The inner error is neither answer.
fn answer(live: &Live<'_>) -> Result<Result<Answer, String>, Failure> {
    // Its report is not one of the files that are compared.
    let target = tempfile::tempdir().map_err(Failure::environment)?;
    let report = target.path().join("v.json");
    let (target, json) = (target.path().to_string_lossy(), report.to_string_lossy());
    let validate = ["validate", SCENE, "--reference", "stored", "--no-oracle"];
    let files = ["--json", &json, "--target", &target];
    let words = [&validate[..], &files, &STORED].concat();
    let ended = run_within(&mut live.command(&[], &words), LIMIT).map_err(Failure::environment)?;
    Ok(match ended {
        None => Err("`validate` does not end".to_owned()),
        Some(output) => judge(
            output.status.code(),
            &String::from_utf8_lossy(&output.stderr),
            &fs::read(&report).unwrap_or_default(),
        ),
    })
}

fn judge(code: Option<i32>, stderr: &str, report: &[u8]) -> Result<Answer, String> {
    let report: Value = serde_json::from_slice(report).unwrap_or_default();
    let results = report["results"].as_array().map_or(&[][..], Vec::as_slice);
    let [result] = results else {
        return Err(format!("`validate` has no result: {code:?} {}", stderr.trim()));
    };
    let problems = result["problems"].as_array().map_or(&[][..], Vec::as_slice);
    let is_reason = |problem: &Value| problem.as_str().is_some_and(|text| text.contains(REFUSED));
    match (code, result["compared"].as_bool()) {
        (Some(0 | 1), Some(true)) => Ok(Answer::Used),
        // Without a reference, nothing is compared.
        (Some(3), Some(false)) if problems.iter().any(is_reason) => Ok(Answer::Refused),
        _ => Err(format!(
            "`validate` ends with {code:?} and {}: {}",
            result["problems"],
            stderr.trim()
        )),
    }
}

/// The control: a whole reference must be used, otherwise nothing would be tested.
fn must_be_used(live: &Live<'_>, which: &str) -> Result<(), Failure> {
    match answer(live)? {
        Ok(Answer::Used) => Ok(()),
        other => Err(Failure::environment(format!(
            "`validate` does not use the {which} reference: {other:?}"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_expected_refusal_counts() {
        let report = |compared: bool, problem: &str| {
            serde_json::json!({ "results": [{ "compared": compared, "problems": [problem] }] }).to_string()
        };
        let refused = report(
            false,
            "meta.toml: the metadata and the image files do not belong together: ...",
        );
        let judged = |code, report: &str| judge(code, "", report.as_bytes()).ok();
        assert_eq!(judged(Some(3), &refused), Some(Answer::Refused));
        assert_eq!(judged(Some(1), &report(true, "")), Some(Answer::Used));
        for (code, report) in [
            (Some(3), report(false, "no stored reference")),
            (Some(101), refused.clone()),
            (Some(2), refused.clone()),
            (None, refused),
            (Some(101), String::new()),
            (Some(2), report(true, "")),
            (Some(3), r#"{"results": []}"#.to_owned()),
        ] {
            assert_eq!(judged(code, &report), None, "{code:?} {report}");
        }
    }
}
