//! `compare --review` as a browser and other programs on the machine see it: what is written, what
//! is refused, and how it ends.
#![cfg(unix)]

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Output, Stdio};
use whitstone::image::{Image, exr_io};

/// A small image, which is brighter by `change` in one pixel.
fn put(folder: &Path, name: &str, change: f32) -> PathBuf {
    let value = |x: usize, y: usize| 0.25 + if (x, y) == (3, 2) { change } else { 0.0 };
    let image = Image::from_fn(12, 8, |x, y| [value(x, y), 0.5, 0.1 * x as f32]).unwrap();
    let path = folder.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    exr_io::write(&path, &image).unwrap();
    path
}

/// Two folders: one image agrees, two differ, one is new and one is missing.
fn folders() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, change) in [
        ("ours/same.exr", 0.0),
        ("refs/same.exr", 0.0),
        ("ours/deep/a.exr", 0.5),
        ("refs/deep/a.exr", 0.0),
        ("ours/z<i>.exr", 0.25),
        ("refs/z<i>.exr", 0.0),
        ("ours/new/er/b.exr", 0.75),
    ] {
        put(folder.path(), name, change);
    }
    folder
}

fn command(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_whitstone"));
    command
        .current_dir(folder)
        .arg("compare")
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// The contents of all files below a folder.
fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(path) = open.pop() {
        for entry in fs::read_dir(path).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else {
                let bytes = fs::read(&path).unwrap();
                found.push((path, bytes));
            }
        }
    }
    found.sort();
    found
}

/// A review that runs.
struct Client {
    process: Child,
    output: BufReader<ChildStdout>,
    /// What it has printed.
    printed: String,
    host: String,
    token: String,
}

/// Ends it also if a test fails.
impl Drop for Client {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Client {
    fn start(folder: &Path, arguments: &[&str]) -> Self {
        let mut process = command(folder, arguments).spawn().unwrap();
        let mut output = BufReader::new(process.stdout.take().unwrap());
        let mut printed = String::new();
        let address = loop {
            let mut line = String::new();
            assert_ne!(output.read_line(&mut line).unwrap(), 0, "no address: {printed}");
            printed += &line;
            if let Some(rest) = line.trim().strip_prefix("http://") {
                break rest.to_owned();
            }
        };
        let (host, token) = address.split_once('/').unwrap();
        Self {
            process,
            output,
            printed,
            host: host.to_owned(),
            token: token.trim_end_matches('/').to_owned(),
        }
    }

    /// The status and the body of an answer.
    fn send(&self, method: &str, target: &str, headers: &str, body: &str) -> (u16, String) {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        let length = body.len();
        let request = format!(
            "{method} {target} HTTP/1.1\r\n{headers}Connection: close\r\nContent-Length: {length}\r\n\r\n{body}"
        );
        stream.write_all(request.as_bytes()).unwrap();
        let mut bytes = Vec::new();
        let _ = stream.read_to_end(&mut bytes);
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let (head, body) = text.split_once("\r\n\r\n").unwrap();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        (status, body.to_owned())
    }

    fn get(&self, path: &str) -> (u16, String) {
        let own = format!("Host: {}\r\n", self.host);
        self.send("GET", &format!("/{}/{path}", self.token), &own, "")
    }

    fn post(&self, path: &str, body: &str) -> (u16, String) {
        let own = format!("Host: {0}\r\nOrigin: http://{0}\r\n", self.host);
        self.send("POST", &format!("/{}/{path}", self.token), &own, body)
    }

    /// The number of a pair on the page.
    fn pair(&self, name: &str) -> usize {
        let (status, page) = self.get("");
        assert_eq!(status, 200, "{page}");
        let heading = format!("<h3>{name}</h3>");
        let before = page.split(&heading).next().unwrap();
        assert!(before.len() < page.len(), "{name} is not on the page");
        let (_, rest) = before.rsplit_once("data-pair=\"").unwrap();
        rest.split('"').next().unwrap().parse().unwrap()
    }

    fn choose(&self, path: &str, pair: usize) -> (u16, String) {
        self.post(path, &format!("{{\"pair\":{pair}}}"))
    }

    /// Waits for the end; returns the exit code and all output.
    fn wait(&mut self) -> (Option<i32>, String) {
        let status = self.process.wait().unwrap();
        self.output.read_to_string(&mut self.printed).unwrap();
        let mut errors = String::new();
        let stream = self.process.stderr.as_mut().unwrap();
        stream.read_to_string(&mut errors).unwrap();
        (status.code(), format!("{}{errors}", self.printed))
    }
}

const BOTH: [&str; 3] = ["ours", "refs", "--review"];

#[test]
fn each_image_is_accepted_and_undone_alone() {
    let folder = folders();
    let before = contents(folder.path());
    let at = |name: &str| folder.path().join(name);
    let read = |name: &str| fs::read(at(name)).unwrap();
    let former = read("refs/deep/a.exr");
    let mut client = Client::start(folder.path(), &[&BOTH[..], &["--json", "found.json"]].concat());
    let [a, b, z] = ["deep/a.exr", "new/er/b.exr", "z&#60;i&#62;.exr"].map(|name| client.pair(name));
    // Looking writes nothing.
    let (status, details) = client.get(&format!("details?pair={a}"));
    assert_eq!(status, 200);
    for part in ["data-pixels=", "(3, 2)", "pixels over tolerance", "rmse"] {
        assert!(details.contains(part), "{part} is not in {details}");
    }
    assert!(
        !client
            .get(&format!("details?pair={b}"))
            .1
            .contains("data-pixels=")
    );
    assert_eq!(contents(folder.path()), before);

    let (status, answer) = client.choose("accept", a);
    let answer: serde_json::Value = serde_json::from_str(&answer).unwrap();
    let expected = serde_json::json!({ "word": "accepted", "is_right": true, "left": 2 });
    assert_eq!((status, answer), (200, expected));
    assert_eq!(read("refs/deep/a.exr"), read("ours/deep/a.exr"));
    // A second click changes nothing.
    assert_eq!(client.choose("accept", a).0, 200);
    let (status, answer) = client.choose("undo", a);
    assert_eq!((status, answer.contains("\"left\":3")), (200, true), "{answer}");
    assert_eq!(contents(folder.path()), before);
    assert_eq!(client.choose("undo", a).0, 409, "it is not accepted");

    // A new one in new folders, which an undo removes.
    assert_eq!(client.choose("accept", b).0, 200);
    assert_eq!(read("refs/new/er/b.exr"), read("ours/new/er/b.exr"));
    assert_eq!(client.choose("undo", b).0, 200);
    assert!(!at("refs/new").exists());

    for pair in [a, b] {
        assert_eq!(client.choose("accept", pair).0, 200);
    }
    // A page that is loaded again shows what was done.
    let (_, page) = client.get("");
    assert!(page.contains("1 image to review"), "{page}");
    assert_eq!(page.matches(">accepted</span>").count(), 2);
    assert_eq!(client.post("done", "{}").0, 200);
    let (code, text) = client.wait();
    assert_eq!(code, Some(1), "{text}");
    for part in [
        "accepted: refs/deep/a.exr now has the contents of ours/deep/a.exr",
        "undone: refs/deep/a.exr has its former contents",
        "undone: refs/new/er/b.exr is removed",
        "review ended: 2 images accepted, 1 left",
    ] {
        assert!(text.contains(part), "{part} is not in {text}");
    }
    assert_ne!(read("refs/deep/a.exr"), former);
    let json: serde_json::Value = serde_json::from_slice(&read("found.json")).unwrap();
    let status = |name: &str| {
        let images = json["images"].as_array().unwrap();
        let image = images.iter().find(|image| image["name"] == name).unwrap();
        image["status"].as_str().unwrap().to_owned()
    };
    assert_eq!(
        ["deep/a.exr", "new/er/b.exr", "same.exr", "z<i>.exr"].map(status),
        ["accepted", "accepted", "pass", "fail"]
    );
    assert_eq!(json["summary"]["failed"], 1);

    // Nothing else was written.
    let written = ["found.json", "refs/deep/a.exr", "refs/new/er/b.exr"].map(at);
    let others = |all: Vec<(PathBuf, Vec<u8>)>| -> Vec<_> {
        let all = all.into_iter();
        all.filter(|(path, _)| !written.contains(path)).collect()
    };
    assert_eq!(others(contents(folder.path())), others(before));

    // The rest is accepted, and nothing is left.
    let mut client = Client::start(folder.path(), &BOTH);
    assert_eq!(client.pair("z&#60;i&#62;.exr"), z);
    assert_eq!(client.choose("accept", z).0, 200);
    client.post("done", "{}");
    assert_eq!(client.wait().0, Some(0));
    let Output { status, stdout, .. } = command(folder.path(), &BOTH).output().unwrap();
    let text = String::from_utf8(stdout).unwrap();
    assert_eq!(
        (status.code(), text.contains("nothing to review")),
        (Some(0), true)
    );
}

#[test]
fn requests_of_others_write_nothing() {
    let folder = folders();
    let before = contents(folder.path());
    let mut client = Client::start(folder.path(), &BOTH);
    let pair = client.pair("deep/a.exr");
    let accept = format!("{{\"pair\":{pair}}}");
    let (host, target) = (client.host.clone(), format!("/{}/accept", client.token));
    let port = host.split(':').nth(1).unwrap();
    let own = format!("Host: {host}\r\n");
    let origin = format!("Origin: http://{host}\r\n");
    for (target, headers) in [
        // Another token, or none.
        (format!("/{}/accept", "0".repeat(32)), format!("{own}{origin}")),
        ("/accept".to_owned(), format!("{own}{origin}")),
        // A name whose DNS entry was changed to 127.0.0.1.
        (
            target.clone(),
            format!("Host: evil.example:{port}\r\nOrigin: http://evil.example:{port}\r\n"),
        ),
        (target.clone(), format!("Host: evil.example\r\n{origin}")),
        // A form of another page, a page of a file, and a program without an origin.
        (target.clone(), format!("{own}Origin: http://evil.example\r\n")),
        (target.clone(), format!("{own}Origin: null\r\n")),
        (target.clone(), own.clone()),
    ] {
        let (status, text) = client.send("POST", &target, &headers, &accept);
        assert_eq!(status, 403, "{target} {headers}: {text}");
    }
    // An image that is tagged on another page sends GET.
    assert_eq!(client.send("GET", &target, &own, "").0, 405);
    // Pairs that are not in the list, and files by their names.
    for (body, status) in [
        ("{\"pair\":4}", 404),
        ("{\"pair\":18446744073709551615}", 404),
        ("{\"pair\":-1}", 400),
        ("{\"pair\":\"deep/a.exr\"}", 400),
        ("{\"path\":\"../../etc/passwd\"}", 400),
        ("{\"pair\":0,\"path\":\"refs/same.exr\"}", 400),
        ("", 400),
    ] {
        let (found, text) = client.post("accept", body);
        assert_eq!(found, status, "{body}: {text}");
    }
    for path in [
        "refs/deep/a.exr",
        "../Cargo.toml",
        "details?pair=4",
        "details/0",
        "accept/0",
    ] {
        assert!(matches!(client.get(path).0, 404 | 405), "{path}");
    }
    assert_eq!(client.get("details?pair=x").0, 400);
    // What agrees is not written.
    let (status, text) = client.choose("accept", client.pair("same.exr"));
    assert_eq!((status, text.as_str()), (409, "there is nothing to accept"));
    assert_eq!(contents(folder.path()), before);
    client.post("done", "{}");
    assert_eq!(client.wait().0, Some(1));
}

/// What is accepted is what was seen, and a reference that somebody else wrote stays.
#[test]
fn changed_files_are_refused() {
    let folder = folders();
    let mut client = Client::start(folder.path(), &BOTH);
    let [a, b, z] = ["deep/a.exr", "new/er/b.exr", "z&#60;i&#62;.exr"].map(|name| client.pair(name));
    let refused = |path: &str, pair: usize, why: &str| {
        let before = contents(folder.path());
        let (status, text) = client.choose(path, pair);
        assert_eq!((status, text.contains(why)), (409, true), "{text}");
        assert_eq!(contents(folder.path()), before);
    };
    put(folder.path(), "ours/deep/a.exr", 1.0);
    refused("accept", a, "ours/deep/a.exr has changed since it was compared");
    put(folder.path(), "refs/new/er/b.exr", 0.5);
    refused("accept", b, "refs/new/er/b.exr has changed since it was compared");
    assert_eq!(client.choose("accept", z).0, 200);
    put(folder.path(), "refs/z<i>.exr", 0.125);
    refused("undo", z, "refs/z<i>.exr has changed since it was accepted");
    let broken = put(folder.path(), "ours/deep/a.exr", f32::NAN);
    refused("accept", a, "values that are not finite");
    fs::remove_file(broken).unwrap();
    refused("accept", a, "deep/a.exr");
    let pid = client.process.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-INT", &pid])
            .status()
            .unwrap()
            .success()
    );
    let (code, text) = client.wait();
    assert_eq!(code, Some(1), "{text}");
}

/// Two files; Ctrl-C ends it with the exit code of what is left.
#[test]
fn two_files_are_reviewed() {
    let folder = tempfile::tempdir().unwrap();
    for (name, change) in [("ours.exr", 0.5), ("ref.exr", 0.0), ("same.exr", 0.5)] {
        put(folder.path(), name, change);
    }
    let end = |mut client: Client| {
        let pid = client.process.id().to_string();
        let status = Command::new("kill").args(["-INT", &pid]).status();
        assert!(status.unwrap().success());
        client.wait()
    };
    let both = ["ours.exr", "ref.exr", "--review"];
    let client = Client::start(folder.path(), &both);
    assert_eq!(end(client).0, Some(1));
    let client = Client::start(folder.path(), &both);
    assert_eq!(client.choose("accept", client.pair("ours.exr")).0, 200);
    let (code, text) = end(client);
    assert_eq!(code, Some(0), "{text}");
    assert_eq!(
        fs::read(folder.path().join("ref.exr")).unwrap(),
        fs::read(folder.path().join("ours.exr")).unwrap()
    );
    // A reference that does not exist yet, and other command lines.
    let client = Client::start(folder.path(), &["ours.exr", "new.exr", "--review"]);
    assert_eq!(client.choose("accept", 0).0, 200);
    assert_eq!(end(client).0, Some(0));
    let client = Client::start(folder.path(), &["ours.exr", "newer.exr", "--review"]);
    assert_eq!(end(client).0, Some(2), "nothing to compare with remains");
    let code = |arguments: &[&str]| {
        let output = command(folder.path(), arguments).output().unwrap();
        output.status.code()
    };
    assert_eq!(code(&["ours.exr", "same.exr", "--review"]), Some(0));
    assert_eq!(code(&["none.exr", "ref.exr", "--review"]), Some(2));
    assert_eq!(code(&["ours.exr", "same.exr", "--review", "--accept"]), Some(2));
    assert_eq!(code(&["ours.exr", "same.exr", "--port", "1"]), Some(2));
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    put(folder.path(), "other.exr", 0.0);
    assert_eq!(
        code(&["ours.exr", "other.exr", "--review", "--port", &port]),
        Some(3)
    );
}
