//! Memory of a program that runs for a long time.

use super::memory::of_status;
use super::{Subject, Tally};
use serde_json::{Value, json};
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};
use whitstone::Failure;
use whitstone::image::atomic;

const MIB: u64 = 1 << 20;
/// A quick run shows every twentieth scene.
const QUICK_STEP: usize = 20;
/// Rounds over all scenes in which memory may still grow, and those in which it may not.
const ROUNDS: [usize; 2] = [2, 3];
/// Within this time a picture must be finished.
const PATIENCE: Duration = Duration::from_secs(120);
/// Images of other sizes would take longer.
const SMALL: [&str; 4] = ["--set", "film.width=32", "--set", "film.height=24"];

/// Most memory that may be resident after this peak of the first rounds.
fn most(first: u64) -> u64 {
    first + first / 10 + 16 * MIB
}

pub(super) fn run(subject: &Subject) -> Result<Tally, Failure> {
    let mut tally = Tally::default();
    if !cfg!(target_os = "linux") {
        tally.skipped = Some("the resident memory is known on Linux only.".to_owned());
        return Ok(tally);
    }
    let scenes = whitstone::validate::find_scenes(&[subject.root.join("scenes")]);
    let scenes = scenes.map_err(Failure::environment)?;
    let step = if subject.quick { QUICK_STEP } else { 1 };
    let texts: Vec<(String, String)> = (scenes.iter().step_by(step))
        .map(|scene| Ok((scene.display().to_string(), moved(scene)?)))
        .collect::<Result<_, std::io::Error>>()
        .map_err(Failure::environment)?;
    let mut view = View::start(subject)?;
    let end = Instant::now() + subject.soak;
    let mut peaks = Vec::new();
    while peaks.len() < ROUNDS[0] + ROUNDS[1] || Instant::now() < end {
        let mut peak = 0;
        for (name, text) in &texts {
            let seen = view.show(text).map_err(|seen| format!("{name}: {seen}"));
            let is_lost = seen.is_err();
            tally.count(seen);
            if is_lost {
                return Ok(tally);
            }
            let resident = of_status(view.child.id(), "VmRSS:");
            let resident = resident.ok_or_else(|| Failure::environment("`view` has ended"))?;
            peak = peak.max(resident);
        }
        peaks.push(peak);
    }
    tally.broken.extend(growth(&peaks));
    Ok(tally)
}

/// What is wrong with the peaks of memory of the rounds.
fn growth(peaks: &[u64]) -> Option<String> {
    let (first, later) = peaks.split_at(ROUNDS[0].min(peaks.len()));
    let (first, later) = (first.iter().max()?, later.iter().max()?);
    (*later > most(*first)).then(|| {
        format!(
            "memory grows from {} to {} MiB in {} rounds",
            first / MIB,
            later / MIB,
            peaks.len()
        )
    })
}

/// The text of a scene for a file in another folder.
fn moved(scene: &Path) -> Result<String, std::io::Error> {
    let folder = scene.parent().unwrap_or(Path::new(""));
    let text = fs::read_to_string(scene)?;
    let table: toml::Table = text.parse().map_err(std::io::Error::other)?;
    let mut table = toml::Value::Table(table);
    absolute(&mut table, folder);
    toml::to_string(&table).map_err(std::io::Error::other)
}

/// Makes names of existing files absolute.
fn absolute(value: &mut toml::Value, folder: &Path) {
    match value {
        toml::Value::String(text) => {
            let path = folder.join(&*text);
            if text.contains('.') && path.is_file() {
                *text = path.display().to_string();
            }
        }
        toml::Value::Array(values) => values.iter_mut().for_each(|value| absolute(value, folder)),
        toml::Value::Table(values) => values.iter_mut().for_each(|(_, value)| absolute(value, folder)),
        _ => {}
    }
}

/// A `whitstone view` and its page.
struct View {
    child: Child,
    folder: tempfile::TempDir,
    host: String,
    token: String,
    page: Value,
    news: Value,
    frame: Value,
    /// The version of the scene that was shown last.
    shown: Value,
}

impl View {
    fn start(subject: &Subject) -> Result<Self, Failure> {
        let folder = tempfile::tempdir().map_err(Failure::environment)?;
        let scene = folder.path().join("scene.toml");
        fs::write(&scene, "").map_err(Failure::environment)?;
        let words = [subject.program.as_path(), "view".as_ref(), &scene];
        let mut words = words.map(|word| word.display().to_string()).to_vec();
        words.extend(SMALL.map(str::to_owned));
        let mut child = (subject.plain(&words))
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .map_err(Failure::environment)?;
        let mut url = String::new();
        if let Some(pipe) = child.stdout.take() {
            BufReader::new(pipe)
                .read_line(&mut url)
                .map_err(Failure::environment)?;
        }
        let address = url.trim().trim_end_matches('/').strip_prefix("http://");
        let (host, token) = address
            .and_then(|address| address.split_once('/'))
            .map(|(host, token)| (host.to_owned(), token.to_owned()))
            .unwrap_or_default();
        let mut view = Self {
            child,
            folder,
            host,
            token,
            page: Value::Null,
            news: json!(0),
            frame: json!(0),
            shown: Value::Null,
        };
        let opened = view.ask("POST", "open", r#"{"takes_over":false}"#);
        let opened = opened.map_err(Failure::environment)?;
        let opened: Value = serde_json::from_slice(&opened).map_err(Failure::environment)?;
        view.page = opened["page"].clone();
        Ok(view)
    }

    /// Sends a request; returns the body of the answer.
    fn ask(&self, method: &str, path: &str, body: &str) -> Result<Vec<u8>, String> {
        let (host, token, length) = (&self.host, &self.token, body.len());
        let request = format!(
            "{method} /{token}/{path} HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n\
             Connection: close\r\nContent-Length: {length}\r\n\r\n{body}"
        );
        let talk = || -> std::io::Result<Vec<u8>> {
            let mut stream = TcpStream::connect(host)?;
            stream.set_read_timeout(Some(PATIENCE))?;
            stream.write_all(request.as_bytes())?;
            let mut answer = Vec::new();
            stream.read_to_end(&mut answer)?;
            Ok(answer)
        };
        let mut answer = talk().map_err(|error| format!("view does not answer: {error}"))?;
        let end = answer.windows(4).position(|part| part == b"\r\n\r\n");
        match end {
            Some(end) if answer.starts_with(b"HTTP/1.1 200") => Ok(answer.split_off(end + 4)),
            _ => Err(format!("view answers {}", String::from_utf8_lossy(&answer))),
        }
    }

    /// The next news of the page.
    fn next(&mut self) -> Result<Value, String> {
        let path = format!("frame?page={}&news={}&frame={}", self.page, self.news, self.frame);
        let body = self.ask("GET", &path, "")?;
        // The facts, behind their length; then the picture.
        let length = body.first_chunk().map_or(0, |length| u32::from_le_bytes(*length));
        let facts = body.get(4..4 + length as usize).unwrap_or_default();
        let facts: Value = serde_json::from_slice(facts).map_err(|error| error.to_string())?;
        self.news = facts["news"].clone();
        if !facts["frame"].is_null() {
            self.frame = facts["frame_number"].clone();
        }
        Ok(facts)
    }

    /// Changes the file of the scene, and waits for the finished picture.
    fn show(&mut self, text: &str) -> Result<(), String> {
        // As a whole, as editors write: half a file would be shown as an error.
        let file = self.folder.path().join("scene.toml");
        atomic::write_bytes(&file, text.as_bytes()).map_err(|error| error.to_string())?;
        let start = Instant::now();
        while start.elapsed() < PATIENCE {
            let facts = self.next()?;
            let frame = &facts["frame"];
            if frame["is_final"] == true && frame["key"] != self.shown {
                self.shown = frame["key"].clone();
                return Ok(());
            }
            if facts["problems"] != json!([]) && !self.shown.is_null() {
                return Err(facts["problems"].to_string());
            }
        }
        Err(format!("no picture within {} s", PATIENCE.as_secs()))
    }
}

impl Drop for View {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_leak_is_found() {
        let mib = |numbers: &[u64]| numbers.iter().map(|number| number * MIB).collect::<Vec<_>>();
        assert_eq!(growth(&mib(&[80, 100, 99, 101, 100])), None);
        // Five MiB a round.
        let leak: Vec<u64> = (0..20).map(|round| 100 + 5 * round).collect();
        let seen = growth(&mib(&leak)).unwrap();
        assert_eq!(seen, "memory grows from 105 to 195 MiB in 20 rounds");
        assert!(growth(&mib(&[100, 100, 127])).is_some());
    }

    #[test]
    fn files_of_a_scene_are_found_from_another_folder() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let text = moved(&root.join("scenes/textures/image.toml")).unwrap();
        let file = root.join("scenes/textures").display().to_string();
        assert!(text.contains(&file), "{text}");
    }
}
