//! The command `view`: its address, its exit codes, and its end.
#![cfg(unix)]

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const SCENE: &str = "film = { width = 8, height = 8 }\n\
    camera = { type = \"perspective\", look_at = { origin = [0, 0, 4], target = [0, 0, 0] } }\n";

fn command(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_whitstone"));
    command
        .current_dir(folder)
        .arg("view")
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// The exit code and the message of a command that ends by itself.
fn refused(folder: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let output: Output = command(folder, arguments).output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    (output.status.code(), text)
}

/// A view that runs, and its address.
fn start(folder: &Path, arguments: &[&str]) -> (Child, String) {
    let mut child = command(folder, arguments).spawn().unwrap();
    let mut line = String::new();
    let output = child.stdout.take().unwrap();
    BufReader::new(output).read_line(&mut line).unwrap();
    (child, line.trim().to_owned())
}

#[test]
fn wrong_command_lines_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    let (code, text) = refused(folder.path(), &["none.toml"]);
    assert_eq!(code, Some(2), "{text}");
    assert!(text.contains("none.toml: No such file"), "{text}");
    let (code, text) = refused(folder.path(), &["scene.toml", "--tev", "localhost"]);
    assert_eq!(code, Some(2), "{text}");
    assert!(text.contains("expected HOST:PORT"), "{text}");
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let (code, text) = refused(folder.path(), &["scene.toml", "--port", &port]);
    assert_eq!(code, Some(3), "{text}");
    assert!(
        text.contains(&format!("port {port} of 127.0.0.1 cannot be used")),
        "{text}"
    );
}

/// A scene with errors is served, and they are printed too. A signal ends the command at once.
#[test]
fn a_view_is_served_until_a_signal() {
    for (signal, code) in [("-INT", 130), ("-TERM", 143)] {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(
            folder.path().join("scene.toml"),
            SCENE.replace("look_at", "lok_at"),
        )
        .unwrap();
        let (mut child, url) = start(folder.path(), &["scene.toml"]);
        let place = url.strip_prefix("http://127.0.0.1:").unwrap();
        let (port, path) = place.split_once('/').unwrap();
        assert_eq!(path.len(), 33, "{url}");
        let mut stream = TcpStream::connect(format!("127.0.0.1:{port}")).unwrap();
        let request = format!("GET /{path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n\r\n");
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        assert!(
            answer.starts_with("HTTP/1.1 200") && answer.contains("<h1>scene.toml</h1>"),
            "{answer}"
        );
        std::thread::sleep(Duration::from_millis(500));
        let start = Instant::now();
        let status = Command::new("kill")
            .args([signal, &child.id().to_string()])
            .status();
        assert!(status.unwrap().success());
        let status = child.wait().unwrap();
        assert_eq!(status.code(), Some(code));
        assert!(start.elapsed() < Duration::from_secs(30), "{:?}", start.elapsed());
        let mut text = String::new();
        child.stderr.take().unwrap().read_to_string(&mut text).unwrap();
        assert!(text.contains("lok_at") && text.contains("scene.toml:2"), "{text}");
    }
}
