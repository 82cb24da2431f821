//! Faults of system calls.

use super::{CASES, Case, Subject, Tally, files, is_temporary, is_whole, run_within};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::time::Duration;
use whitstone::Failure;

/// The calls that may fail, with their errors. Without `brk`, which reports failure by another
/// value than strace can inject.
const CALLS: &[(&str, &[&str])] = &[
    ("openat", &["ENOSPC", "EIO", "EMFILE", "EACCES"]),
    ("write", &["ENOSPC", "EIO"]),
    ("pwrite64", &["ENOSPC"]),
    ("read", &["EIO"]),
    ("pread64", &["EIO"]),
    ("lseek", &["EIO"]),
    ("fsync", &["EIO"]),
    ("ftruncate", &["ENOSPC"]),
    ("rename", &["EIO"]),
    ("renameat", &["EIO", "ENOSPC"]),
    ("unlink", &["EIO"]),
    ("mkdir", &["EACCES", "ENOSPC"]),
    ("statx", &["EIO"]),
    ("newfstatat", &["EIO"]),
    ("readlink", &["EIO"]),
    ("getcwd", &["ENOENT"]),
    ("getdents64", &["EIO"]),
    ("fcntl", &["EIO"]),
    ("flock", &["EIO"]),
    ("ioctl", &["EIO"]),
    ("socketpair", &["EMFILE"]),
    ("clone3", &["EAGAIN"]),
    ("getrandom", &["ENOSYS"]),
    ("sched_getaffinity", &["EINVAL"]),
    ("copy_file_range", &["EIO"]),
    ("mmap", &["ENOMEM"]),
];

/// The loader and the runtime of Rust end without a message where this fails before `main`. As many
/// calls as `--version` makes are therefore not failed.
const BEFORE_MAIN: &str = "mmap";

const VERSION: Case = Case {
    name: "--version",
    is_killed: false,
    arguments: &["--version"],
};

pub(super) fn run(subject: &Subject) -> Result<Tally, Failure> {
    let mut tally = Tally::default();
    if !is_available() {
        tally.skipped = Some(MISSING.to_owned());
        return Ok(tally);
    }
    let start = count(subject, &VERSION, &subject.root)?
        .get(BEFORE_MAIN)
        .copied()
        .unwrap_or(0);
    let cases = if subject.quick { &CASES[..1] } else { &CASES[..] };
    for case in cases {
        let folder = subject.folder()?;
        let counts = count(subject, case, folder.path())?;
        let undisturbed = files(folder.path());
        subject.check_outputs(case, &undisturbed)?;
        for (call, errors) in CALLS {
            let before = if *call == BEFORE_MAIN { start } else { 0 };
            let last = counts.get(*call).copied().unwrap_or(0);
            let errors = if subject.quick { &errors[..1] } else { errors };
            // In the quick form a few of each kind, the last ones among them, which write files.
            let first = if subject.quick { last.saturating_sub(5) } else { 0 };
            for (error, number) in errors
                .iter()
                .flat_map(|error| (before.max(first) + 1..=last).map(move |n| (error, n)))
            {
                for persistent in ["", "+"] {
                    let inject = format!("{call}:error={error}:when={number}{persistent}");
                    let seen = attempt(subject, case, &inject, &undisturbed)?;
                    tally.count(seen.map_err(|seen| format!("{}, {inject}: {seen}", case.name)));
                }
            }
        }
    }
    Ok(tally)
}

/// Why faults are not tried where it is not installed.
pub(super) const MISSING: &str = "strace is not installed (Debian: apt-get install strace).";

/// Whether strace is installed.
pub(super) fn is_available() -> bool {
    Command::new("strace").arg("-V").output().is_ok()
}

fn strace(options: &[&str]) -> Vec<String> {
    ["strace", "-f", "-qq"]
        .iter()
        .chain(options)
        .map(|word| (*word).to_owned())
        .collect()
}

/// How often the command makes each call.
fn count(subject: &Subject, case: &Case, folder: &Path) -> Result<BTreeMap<String, usize>, Failure> {
    counts(&["-f"], case.exit_code(), |before| {
        subject.command(before, case, folder)
    })
}

/// How often a command makes each system call. It gets the words that come before it.
pub(super) fn counts(
    options: &[&str],
    exit_code: i32,
    command: impl Fn(&[String]) -> Command,
) -> Result<BTreeMap<String, usize>, Failure> {
    let list = tempfile::NamedTempFile::new().map_err(Failure::environment)?;
    let list_name = list.path().to_string_lossy();
    let before = [&["strace", "-qq", "-c", "-o", &list_name], options].concat();
    let before: Vec<String> = before.into_iter().map(str::to_owned).collect();
    let output = command(&before).output().map_err(Failure::environment)?;
    if output.status.code() != Some(exit_code) {
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        return Err(Failure::environment(format!(
            "{command:?}: {text}",
            command = command(&[])
        )));
    }
    let text = std::fs::read_to_string(list.path()).map_err(Failure::environment)?;
    let row = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        Some((words.last()?.to_string(), words.get(3)?.parse().ok()?))
    };
    Ok(text.lines().filter_map(row).collect())
}

/// One command with one fault.
fn attempt(
    subject: &Subject,
    case: &Case,
    inject: &str,
    undisturbed: &BTreeMap<String, Vec<u8>>,
) -> Result<Result<(), String>, Failure> {
    let folder = subject.folder_with(undisturbed)?;
    let call = inject.split(':').next().unwrap_or_default();
    let before = strace(&[
        "-o",
        "/dev/null",
        "-e",
        &format!("trace={call}"),
        "-e",
        &format!("inject={inject}"),
    ]);
    let mut command = subject.command(&before, case, folder.path());
    let ended = run_within(&mut command, Duration::from_secs(30)).map_err(Failure::environment)?;
    Ok(match ended {
        None => Err("it does not end".to_owned()),
        Some(output) => judge(
            case,
            output.status.code(),
            &String::from_utf8_lossy(&output.stderr),
            &files(folder.path()),
            undisturbed,
            // A file that cannot be removed stays.
            call == "unlink",
        ),
    })
}

fn judge(
    case: &Case,
    code: Option<i32>,
    stderr: &str,
    found: &BTreeMap<String, Vec<u8>>,
    undisturbed: &BTreeMap<String, Vec<u8>>,
    temporaries_stay: bool,
) -> Result<(), String> {
    // The loader of the system reports libraries that it cannot open.
    let loader = code == Some(127) && stderr.contains("error while loading shared libraries");
    if stderr.contains("panicked") {
        return Err(stderr.trim().to_owned());
    }
    if !(matches!(code, Some(0..=3)) || loader) {
        return Err(format!("exit code {code:?}: {}", stderr.trim()));
    }
    for (name, bytes) in found {
        if is_temporary(name) {
            if !temporaries_stay {
                return Err(format!("{name} is left"));
            }
        } else if !is_whole(name, bytes, undisturbed.get(name)) {
            return Err(format!("{name} is not whole"));
        }
    }
    let missing = undisturbed.keys().find(|name| !found.contains_key(*name));
    match missing {
        // `explain` writes no file but this.
        Some(name) if code == Some(0) && case.name != "validate" => {
            Err(format!("exit code 0 without {name}"))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn harm_is_found() {
        let files = |found: &[(&str, &[u8])]| -> BTreeMap<String, Vec<u8>> {
            let owned = found
                .iter()
                .map(|(name, bytes)| ((*name).to_owned(), bytes.to_vec()));
            owned.collect()
        };
        let whole: &[(&str, &[u8])] = &[("x.exr", b"image"), ("r.json", b"{}")];
        let undisturbed = files(whole);
        let seen = |code, stderr: &str, found: &[(&str, &[u8])]| {
            judge(&CASES[0], code, stderr, &files(found), &undisturbed, false)
        };
        assert_eq!(seen(Some(0), "", whole), Ok(()));
        assert_eq!(seen(Some(3), "error: x.exr: cannot write", &whole[..1]), Ok(()));
        assert_eq!(seen(Some(3), "", &[]), Ok(()));
        for (code, stderr, found) in [
            (Some(101), "", whole),
            (None, "", whole),
            (Some(3), "thread 'main' panicked at", whole),
            (Some(0), "", &whole[..1]),
            (Some(3), "", &[("x.exr", &b"ima"[..])]),
            (Some(3), "", &[("r.json", &b"{"[..])]),
            (Some(3), "", &[(".whitstone-a.tmp", &b""[..])]),
        ] {
            assert!(seen(code, stderr, found).is_err(), "{code:?} {stderr} {found:?}");
        }
    }
}
