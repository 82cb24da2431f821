//! The server as a program on the same machine sees it: what it refuses, and what it shows.

use serde_json::{Value, json};
use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use whitstone_core::Registry;
use whitstone_render::{BuildOptions, Pipeline, RenderOptions};
use whitstone_scene::Sources;
use whitstone_validate::Stop;
use whitstone_view::{Options, View};

const SCENE: &str = r#"
film = { width = 40, height = 24 }
camera = { type = "perspective", look_at = { origin = [0, 0.5, 4], target = [0, 0, 0] } }
sampler = { type = "grid", samples_per_axis = 2 }

[[light]]
type = "point"
position = [3, 5, 4]
intensity = 60

[[shape]]
id = "glass"
type = "sphere"
material = { type = "dielectric", interior_ior = 1.5 }

[[shape]]
id = "floor"
type = "plane"
transform = [{ rotate = { axis = [1, 0, 0], degrees = -90 } }, { translate = [0, -1, 0] }]
"#;

fn registry() -> Registry {
    let mut registry = Registry::default();
    for register in [
        whitstone_accelerators::register,
        whitstone_cameras::register,
        whitstone_integrators::register,
        whitstone_lights::register,
        whitstone_materials::register,
        whitstone_samplers::register,
        whitstone_shapes::register,
        whitstone_textures::register,
    ] {
        register(&mut registry).unwrap();
    }
    registry
}

/// A view that runs.
struct Client {
    port: u16,
    token: String,
    page: u64,
    news: u64,
    frame: u64,
}

/// An answer: status, head and body.
struct Answer {
    status: u16,
    head: String,
    body: Vec<u8>,
}

impl Answer {
    fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }
}

/// News of the view.
struct News {
    facts: Value,
    picture: Vec<u8>,
}

impl Client {
    /// Sends a request as it is, and reads all of the answer.
    fn send(&self, request: &[u8]) -> Answer {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        // A server that refuses a request early may not read all of it.
        let _ = stream.write_all(request);
        let mut bytes = Vec::new();
        let _ = stream.read_to_end(&mut bytes);
        let end = bytes
            .windows(4)
            .position(|part| part == b"\r\n\r\n")
            .expect("an answer has a head");
        let head = String::from_utf8_lossy(&bytes[..end]).into_owned();
        Answer {
            status: head.split(' ').nth(1).unwrap().parse().unwrap(),
            head,
            body: bytes[end + 4..].to_vec(),
        }
    }

    fn host(&self) -> String {
        format!("127.0.0.1:{}", self.port)
    }

    fn get(&self, path: &str) -> Answer {
        let (host, token) = (self.host(), &self.token);
        self.send(
            format!("GET /{token}/{path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").as_bytes(),
        )
    }

    fn post(&self, path: &str, body: &Value) -> Answer {
        let (host, token, body) = (self.host(), &self.token, body.to_string());
        let length = body.len();
        let request = format!(
            "POST /{token}/{path} HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nConnection: close\r\n\
             Content-Length: {length}\r\n\r\n{body}"
        );
        self.send(request.as_bytes())
    }

    fn open(&mut self) {
        let answer = self.post("open", &json!({ "takes_over": false }));
        assert_eq!(answer.status, 200, "{}", answer.text());
        let page: Value = serde_json::from_slice(&answer.body).unwrap();
        self.page = page["page"].as_u64().unwrap();
    }

    fn wish(&self, look_at: Value, accelerator: Value, shown: &str) -> Answer {
        let wish =
            json!({ "page": self.page, "look_at": look_at, "accelerator": accelerator, "shown": shown });
        self.post("wish", &wish)
    }

    /// Waits for the next news.
    fn news(&mut self) -> News {
        let answer = self.get(&format!(
            "frame?page={}&news={}&frame={}",
            self.page, self.news, self.frame
        ));
        assert_eq!(answer.status, 200, "{}", answer.text());
        let length = u32::from_le_bytes(answer.body[..4].try_into().unwrap()) as usize;
        let facts: Value = serde_json::from_slice(&answer.body[4..4 + length]).unwrap();
        self.news = facts["news"].as_u64().unwrap();
        if !facts["frame"].is_null() {
            self.frame = facts["frame_number"].as_u64().unwrap();
        }
        News {
            facts,
            picture: answer.body[4 + length..].to_vec(),
        }
    }

    /// Waits until news fulfil a condition.
    fn until(&mut self, what: &str, holds: impl Fn(&Value) -> bool) -> News {
        let start = Instant::now();
        loop {
            let news = self.news();
            if holds(&news.facts) {
                return news;
            }
            assert!(
                start.elapsed() < Duration::from_secs(60),
                "never {what}: {}",
                news.facts
            );
        }
    }

    fn finished(&mut self) -> News {
        self.until("finished", |facts| facts["frame"]["is_final"] == true)
    }
}

fn options(scene: &Path) -> Options {
    Options {
        scene: scene.to_owned(),
        references: PathBuf::from("none"),
        target: scene.with_file_name("target"),
        ..Options::default()
    }
}

/// Runs a view of a scene while a test looks at it.
fn with_view(text: &str, test: impl FnOnce(&mut Client, &Path)) {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.toml");
    fs::write(&scene, text).unwrap();
    let registry = registry();
    let view = View::open(options(&scene), &registry).unwrap();
    let url = view.url();
    let rest = url.strip_prefix("http://127.0.0.1:").unwrap();
    let (port, token) = rest.split_once('/').unwrap();
    let mut client = Client {
        port: port.parse().unwrap(),
        token: token.trim_end_matches('/').to_owned(),
        page: 0,
        news: 0,
        frame: 0,
    };
    /// Ends the view also if the test fails.
    struct End(Stop);
    impl Drop for End {
        fn drop(&mut self) {
            self.0.request();
        }
    }
    let stop = Stop::default();
    std::thread::scope(|scope| {
        scope.spawn(|| view.run(&stop, &|_| {}));
        let _end = End(stop.clone());
        test(&mut client, &scene);
    });
}

#[test]
fn requests_of_others_are_refused() {
    with_view(SCENE, |client, _| {
        let (host, token) = (client.host(), client.token.clone());
        let get = |target: &str, headers: &str| {
            client.send(format!("GET {target} HTTP/1.1\r\n{headers}Connection: close\r\n\r\n").as_bytes())
        };
        let page = format!("/{token}/");
        let own = format!("Host: {host}\r\n");
        assert_eq!(get(&page, &own).status, 200);
        let by_name = format!("Host: localhost:{}\r\n", client.port);
        assert_eq!(get(&page, &by_name).status, 200);

        // A name whose DNS entry was changed to 127.0.0.1, another port, none, two.
        for wrong in [
            "Host: evil.example\r\n".to_owned(),
            format!("Host: evil.example:{}\r\n", client.port),
            "Host: 127.0.0.1:1\r\n".to_owned(),
            "Host: 127.0.0.1\r\n".to_owned(),
            String::new(),
            format!("{own}Host: evil.example\r\n"),
        ] {
            let answer = get(&page, &wrong);
            assert!(matches!(answer.status, 400 | 403), "{wrong}: {}", answer.head);
            assert!(!answer.text().contains("<html"), "{wrong}");
        }
        for wrong in ["http://evil.example", "null", "https://127.0.0.1:1", "file://"] {
            let answer = get(&page, &format!("{own}Origin: {wrong}\r\n"));
            assert_eq!(
                (answer.status, answer.text().contains("wrong Origin")),
                (403, true),
                "{wrong}"
            );
        }
        // A form of another page, and a program without an origin.
        for origin in ["Origin: http://evil.example\r\n", ""] {
            let request = format!(
                "POST /{token}/open HTTP/1.1\r\n{own}{origin}Connection: close\r\nContent-Length: 20\r\n\r\n{{\"takes_over\":false}}"
            );
            assert_eq!(client.send(request.as_bytes()).status, 403, "{origin}");
        }
        let other = "0".repeat(token.len());
        for target in [
            "/",
            "/drawing.json",
            &format!("/{other}/"),
            &format!("/{other}/drawing.json"),
            &format!("/{token}"),
        ] {
            let answer = get(target, &own);
            assert_eq!(
                (answer.status, answer.text().contains("wrong token")),
                (403, true),
                "{target}"
            );
        }
    });
}

#[test]
fn only_its_own_files_are_served() {
    with_view(SCENE, |client, _| {
        for (path, kind) in [("", "text/html"), ("drawing.json", "application/json")] {
            let answer = client.get(path);
            assert_eq!(answer.status, 200, "{path}");
            let head = answer.head.to_lowercase();
            for part in [
                kind,
                "content-security-policy: default-src 'none'",
                "nosniff",
                "no-store",
                "no-referrer",
            ] {
                assert!(head.contains(part), "{path}: {part} is not in {head}");
            }
        }
        for path in [
            "../Cargo.toml",
            "..%2f..%2fetc/passwd",
            "/etc/passwd",
            "scene.toml",
            "drawing.json/",
            "./drawing.json",
            "view.html",
            "view.js",
            "%2e%2e/",
        ] {
            assert_eq!(client.get(path).status, 404, "{path}");
        }
        assert_eq!(client.get("wish").status, 405);
        assert_eq!(client.post("drawing.json", &json!({})).status, 405);
        let put = format!(
            "PUT /{}/drawing.json HTTP/1.1\r\nHost: {}\r\nConnection: close\r\nContent-Length: 0\r\n\r\n",
            client.token,
            client.host()
        );
        assert!(matches!(client.send(put.as_bytes()).status, 403 | 405));
    });
}

#[test]
fn huge_and_wrong_requests_are_refused() {
    with_view(SCENE, |client, _| {
        client.open();
        assert_eq!(client.get(&"a".repeat(2000)).status, 414);
        let long = json!({ "page": client.page, "filler": "a".repeat(20_000) });
        assert_eq!(client.post("close", &long).status, 413);
        for (path, body) in [
            ("open", json!({})),
            ("open", json!({ "takes_over": 1 })),
            ("wish", json!([])),
            ("wish", json!({ "page": client.page, "shown": "everything" })),
            (
                "pixel",
                json!({ "page": client.page, "x": -1, "y": 0, "sample": 0 }),
            ),
            (
                "pixel",
                json!({ "page": client.page, "x": 0, "y": 0, "sample": 0, "more": 1 }),
            ),
        ] {
            assert_eq!(client.post(path, &body).status, 400, "{path} {body}");
        }
        assert_eq!(client.get("frame?page=x&news=0&frame=0").status, 400);
        client.finished();
        let outside = json!({ "page": client.page, "x": 40, "y": 0, "sample": 0 });
        let answer = client.post("pixel", &outside);
        assert_eq!(
            (answer.status, answer.text().contains("40 x 24")),
            (400, true),
            "{}",
            answer.text()
        );
        let answer = client.wish(Value::Null, json!("bwh"), "picture");
        assert_eq!(
            (answer.status, answer.text().contains("\"bwh\"")),
            (400, true),
            "{}",
            answer.text()
        );
    });
}

#[test]
fn a_second_page_is_refused_until_it_takes_over() {
    with_view(SCENE, |client, _| {
        client.open();
        let answer = client.post("open", &json!({ "takes_over": false }));
        assert_eq!(
            (answer.status, answer.text().contains("another page")),
            (409, true)
        );
        let first = client.page;
        let answer = client.post("open", &json!({ "takes_over": true }));
        assert_eq!(answer.status, 200);
        // Requests of the first page are refused from now on.
        assert_eq!(
            client.get(&format!("frame?page={first}&news=0&frame=0")).status,
            409
        );
        assert_eq!(client.wish(Value::Null, Value::Null, "rays").status, 409);
        let page: Value = serde_json::from_slice(&answer.body).unwrap();
        assert_eq!(client.post("close", &page).status, 200);
        client.open();
    });
}

/// The finished picture of the page is that of `render`.
#[test]
fn the_picture_becomes_that_of_render() {
    with_view(SCENE, |client, scene| {
        client.open();
        let news = client.finished();
        let registry = registry();
        let sources = Sources::load(scene, &[], &registry).unwrap();
        let pipeline = Pipeline::load(&sources, &registry, BuildOptions::default()).unwrap();
        let film = pipeline.render(RenderOptions::default());
        let expected: Vec<u8> = film
            .rgb
            .as_flattened()
            .iter()
            .flat_map(|value| half::f16::from_f32(value.min(65504.0)).to_le_bytes())
            .collect();
        assert!(news.picture == expected, "the pictures differ");
        assert_eq!(news.facts["frame"]["samples"], 4);
        assert_eq!(news.facts["frame"]["rays"], film.counters.total());
    });
}

#[test]
fn the_camera_moves_and_returns() {
    with_view(SCENE, |client, _| {
        client.open();
        let first = client.finished();
        let look_at = json!({ "origin": [4.0, 0.5, 0.0], "target": [0.0, 0.0, 0.0], "up": [0.0, 1.0, 0.0] });
        assert_eq!(client.wish(look_at.clone(), Value::Null, "picture").status, 200);
        let is_there =
            |facts: &Value| facts["frame"]["is_final"] == true && facts["frame"]["look_at"] == look_at;
        let moved = client.until("moved", is_there);
        assert!(moved.picture != first.picture);
        assert_ne!(moved.facts["frame"]["key"], first.facts["frame"]["key"]);
        client.wish(Value::Null, Value::Null, "picture");
        let key = first.facts["frame"]["key"].clone();
        let back = client.until("back", |facts| {
            facts["frame"]["is_final"] == true && facts["frame"]["key"] == key
        });
        assert!(back.picture == first.picture, "it is another picture");
        // A view that no camera has is a remark, and the next one works.
        let nowhere = json!({ "origin": [0.0, 0.0, 0.0], "target": [0.0, 0.0, 0.0], "up": [0.0, 1.0, 0.0] });
        client.wish(nowhere, Value::Null, "picture");
        let news = client.until("told", |facts| facts["remark"].is_string());
        let remark = news.facts["remark"].as_str().unwrap().to_owned();
        assert!(remark.contains("`target` equals `origin`"), "{remark}");
        client.wish(look_at.clone(), Value::Null, "picture");
        client.until("moved again", |facts| {
            facts["frame"]["look_at"] == look_at && facts["remark"].is_null()
        });
    });
}

#[test]
fn errors_are_shown_at_their_line_and_go_when_they_are_mended() {
    let wrong = SCENE.replace("intensity = 60", "intensty = 60");
    with_view(&wrong, |client, scene| {
        client.open();
        let news = client.until("told", |facts| facts["problems"][0].is_object());
        let problem = &news.facts["problems"][0];
        let place = format!("{}:9:1", scene.display());
        assert_eq!(problem["place"], place, "{problem}");
        assert!(
            problem["message"].as_str().unwrap().contains("intensty"),
            "{problem}"
        );
        fs::write(scene, SCENE).unwrap();
        let news = client.finished();
        assert_eq!(news.facts["problems"], json!([]));
        // A later error keeps the last picture.
        fs::write(scene, "film = {").unwrap();
        client.until("told again", |facts| {
            facts["problems"][0]["place"]
                .as_str()
                .is_some_and(|place| place.contains(":1:"))
        });
        let pixel = json!({ "page": client.page, "x": 20, "y": 12, "sample": 0 });
        assert_eq!(client.post("pixel", &pixel).status, 200);
    });
}

#[test]
fn every_file_of_the_scene_is_watched() {
    let include = "include = [\"shapes.toml\"]\n".to_owned() + SCENE;
    with_view(&include, |client, scene| {
        client.open();
        let shapes = scene.with_file_name("shapes.toml");
        let news = client.until("told", |facts| facts["problems"][0].is_object());
        assert!(
            news.facts["problems"][0]["message"]
                .as_str()
                .unwrap()
                .contains("shapes.toml")
        );
        let mesh = |height: f64| {
            let corners = format!("v 0 0 0\nv 1 0 0\nv 0 {height} 0\nf 1 2 3\n");
            fs::write(scene.with_file_name("mesh.obj"), corners).unwrap();
        };
        mesh(1.0);
        fs::write(&shapes, "[[shape]]\ntype = \"mesh\"\nfile = \"mesh.obj\"\n").unwrap();
        // The missing file is not among those that were read, so the scene itself is touched.
        fs::write(scene, include.clone() + "\n").unwrap();
        let first = client.finished();
        mesh(2.5);
        // Files that were written just before they were read may be read once more.
        let mut shown = first.facts["frame"]["key"].clone();
        loop {
            let next = client.until("changed", |facts| {
                facts["frame"]["is_final"] == true && facts["frame"]["key"] != shown
            });
            if next.picture != first.picture {
                break;
            }
            shown = next.facts["frame"]["key"].clone();
        }
    });
}

#[test]
fn a_pixel_has_a_value_layers_and_rays_in_the_picture() {
    with_view(SCENE, |client, _| {
        client.open();
        client.finished();
        let pixel = json!({ "page": client.page, "x": 20, "y": 12, "sample": 1 });
        let answer = client.post("pixel", &pixel);
        let report: Value = serde_json::from_slice(&answer.body).unwrap();
        let layers: Vec<&str> = report["layers"]
            .as_array()
            .unwrap()
            .iter()
            .filter_map(|layer| layer[0].as_str())
            .collect();
        assert_eq!(layers.len(), 8, "{layers:?}");
        let layer = |name: &str| {
            let all = report["layers"].as_array().unwrap();
            all.iter().find(|layer| layer[0] == name).unwrap()[1].clone()
        };
        assert_eq!(layer("shape_id.I"), json!(0.0));
        let rays = report["rays"].as_array().unwrap();
        assert_eq!(
            (rays[0]["path"].clone(), rays[0]["name"].clone()),
            (json!(""), json!("sphere \"glass\""))
        );
        let transmitted = rays.iter().find(|ray| ray["path"] == "T").unwrap();
        // It starts where the camera ray ends.
        for axis in 0..3 {
            let [from, to] = [&transmitted["origin"][axis], &rays[0]["position"][axis]]
                .map(|value| value.as_f64().unwrap());
            assert!((from - to).abs() < 1e-9, "{from} {to}");
        }
        let start = &transmitted["line"][0];
        let near = |value: &Value, pixel: f64| (value.as_f64().unwrap() - pixel).abs() < 1.0;
        assert!(near(&start[0], 20.5) && near(&start[1], 12.5), "{start}");
        // The sum over all rays is the value of the sample; the mean of all samples is the pixel.
        let total: f64 = (0..4)
            .map(|sample| {
                let pixel = json!({ "page": client.page, "x": 20, "y": 12, "sample": sample });
                let report: Value = serde_json::from_slice(&client.post("pixel", &pixel).body).unwrap();
                let rays = report["rays"].as_array().unwrap().iter();
                rays.map(|ray| ray["throughput"][0].as_f64().unwrap() * ray["local"][0].as_f64().unwrap())
                    .sum::<f64>()
            })
            .sum();
        let value = report["value"][0].as_f64().unwrap();
        assert!((total / 4.0 - value).abs() < 1e-5 * value, "{total} {value}");
        // The picture after it is the one of before.
        client.wish(Value::Null, json!("bvh"), "picture");
        client.finished();
    });
}

#[test]
fn accelerators_are_switched_and_their_work_is_shown() {
    with_view(SCENE, |client, _| {
        client.open();
        let first = client.finished();
        let known = first.facts["scene"]["accelerators"].as_array().unwrap().clone();
        assert!(known.contains(&json!("kdtree")) && known.len() >= 9, "{known:?}");
        let mut pictures = Vec::new();
        for name in ["kdtree", "brute_force"] {
            client.wish(Value::Null, json!(name), "picture");
            let done =
                |facts: &Value| facts["frame"]["is_final"] == true && facts["scene"]["accelerator"] == name;
            pictures.push(client.until(name, done).picture);
        }
        assert!(
            pictures.iter().all(|picture| *picture == first.picture),
            "an accelerator changes the picture"
        );
        for shown in ["rays", "tests"] {
            client.wish(Value::Null, json!("kdtree"), shown);
            let news = client.until(shown, |facts| {
                facts["frame"]["shown"] == shown && facts["frame"]["width"] == 40
            });
            let numbers = news
                .picture
                .chunks_exact(4)
                .map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap()));
            let numbers: Vec<f32> = numbers.collect();
            assert_eq!(numbers.len(), 40 * 24);
            assert!(numbers.iter().any(|number| *number > 1.0), "{shown}");
        }
    });
}

#[test]
fn a_port_in_use_is_an_error_that_names_it() {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let registry = registry();
    let taken = Options {
        port,
        ..options(Path::new("scene.toml"))
    };
    let error = View::open(taken, &registry).err().unwrap().to_string();
    assert!(
        error.contains(&port.to_string()) && error.contains("--port"),
        "{error}"
    );
    let wrong = Options {
        tev: Some("localhost".to_owned()),
        ..options(Path::new("scene.toml"))
    };
    let error = View::open(wrong, &registry).err().unwrap().to_string();
    assert!(error.contains("HOST:PORT"), "{error}");
}
