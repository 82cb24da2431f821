//! The answers of the server, and the requests that it refuses.
//!
//! Everything that the browser may ask for is in one table of exact paths below a random token, so
//! that no other page and no other user of the machine can reach it. The name in `Host` is checked
//! against DNS rebinding, `Origin` against requests of other pages.

use crate::reference;
use crate::renderer::halves;
use crate::scene::Aspect;
use crate::state::{Frame, Reference, Shared, Wish};
use crate::{camera::LookAt, heat::Shown, pixel};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use std::io::Read;
use std::sync::Arc;
use std::time::Duration;
use tiny_http::{Header, Method, Request, Response, Server};
use whitstone_core::Registry;

const PAGE: &str = include_str!("page/view.html");
const SCRIPT: &str = include_str!("page/view.js");
const STYLE: &str = include_str!("page/view.css");

/// Maximum length of a request target in bytes.
const MAX_TARGET: usize = 1024;
/// Maximum length of a request body in bytes.
pub(crate) const MAX_BODY: usize = 16 << 10;
/// How long a request for news waits for some.
const PATIENCE: Duration = Duration::from_secs(4);

/// What the page may load: what it contains, and answers of this server.
fn policy(token: &str) -> String {
    format!(
        "default-src 'none'; script-src 'nonce-{token}'; style-src 'nonce-{token}'; connect-src 'self'; \
         img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
}

/// The page with its style and script: one request less before the first picture.
pub(crate) fn page(name: &str, token: &str) -> String {
    // The name last, so that nothing in it is replaced.
    PAGE.replace("TOKEN", token)
        .replace("STYLE", STYLE)
        .replace("SCRIPT", SCRIPT)
        .replace("SCENE", &escaped(name))
}

/// An answer before it is sent.
struct Answer {
    status: u16,
    kind: &'static str,
    body: Vec<u8>,
}

impl Answer {
    fn new(kind: &'static str, body: impl Into<Vec<u8>>) -> Self {
        Self {
            status: 200,
            kind,
            body: body.into(),
        }
    }

    fn json(value: &Value) -> Self {
        Self::new("application/json", value.to_string())
    }

    fn refusal(status: u16, why: impl Into<String>) -> Self {
        Self {
            status,
            kind: "text/plain; charset=utf-8",
            body: why.into().into_bytes(),
        }
    }
}

/// Answers requests.
pub(crate) struct Site<'a> {
    pub(crate) shared: &'a Shared,
    pub(crate) registry: &'a Registry,
    pub(crate) token: &'a str,
    pub(crate) port: u16,
    /// The page.
    pub(crate) page: &'a str,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Open {
    takes_over: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Close {
    page: u64,
}

/// A change of the wish.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Change {
    page: u64,
    look_at: Option<LookAt>,
    accelerator: Option<String>,
    shown: Shown,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Pixel {
    page: u64,
    x: u32,
    y: u32,
    sample: u32,
}

impl Site<'_> {
    /// Answers requests until the view ends. Several threads may do so.
    pub(crate) fn serve(&self, server: &Server) {
        while !self.shared.state().ended {
            match server.recv_timeout(Duration::from_millis(200)) {
                Ok(Some(request)) => self.respond(request),
                Ok(None) => {}
                Err(_) => return,
            }
        }
    }

    fn respond(&self, mut request: Request) {
        let answer = self.answer(&mut request).unwrap_or_else(|refusal| refusal);
        let policy = policy(self.token);
        let fixed = [
            ("Content-Type", answer.kind),
            ("Content-Security-Policy", policy.as_str()),
            ("X-Content-Type-Options", "nosniff"),
            ("Referrer-Policy", "no-referrer"),
            ("Cross-Origin-Resource-Policy", "same-origin"),
            ("Cache-Control", "no-store"),
        ];
        let mut response = Response::from_data(answer.body)
            .with_status_code(answer.status)
            .with_chunked_threshold(usize::MAX);
        for (name, value) in fixed {
            if let Ok(header) = Header::from_bytes(name, value) {
                response.add_header(header);
            }
        }
        // A page that has gone needs no answer.
        let _ = request.respond(response);
    }

    fn answer(&self, request: &mut Request) -> Result<Answer, Answer> {
        let target = request.url().to_owned();
        self.check_host(request)?;
        self.check_origin(request)?;
        if target.len() > MAX_TARGET {
            return Err(Answer::refusal(414, "the address is too long"));
        }
        let path = self.below_token(&target)?;
        let (path, query) = path.split_once('?').unwrap_or((path, ""));
        let is_post = *request.method() == Method::Post;
        if !is_post && *request.method() != Method::Get {
            return Err(Answer::refusal(405, "expected GET or POST"));
        }
        match (path, is_post) {
            ("", false) => Ok(Answer::new("text/html; charset=utf-8", self.page)),
            ("drawing.json", false) => Ok(Answer::new(
                "application/json",
                whitstone_validate::report::drawing(),
            )),
            ("frame", false) => self.frame(query),
            ("reference", false) => self.reference(query),
            ("errors", false) => self.errors(query),
            ("open", true) => {
                let Open { takes_over } = body(request)?;
                let page = self.shared.change(|state| state.open(takes_over));
                let why = "another page shows this view; close it, or take over";
                let page = page.ok_or_else(|| Answer::refusal(409, why))?;
                Ok(Answer::json(&json!({ "page": page })))
            }
            ("close", true) => {
                let Close { page } = body(request)?;
                self.shared.change(|state| state.close(page));
                Ok(Answer::json(&json!({})))
            }
            ("wish", true) => self.wish(request),
            ("pixel", true) => self.pixel(request),
            ("live", true) => {
                let Close { page } = body(request)?;
                self.check_page(page)?;
                self.shared.change(|state| {
                    if !matches!(state.reference, Reference::Working(_)) {
                        state.asks_for_reference = true;
                        state.reference = Reference::Working("waiting".to_owned());
                        state.news += 1;
                    }
                });
                Ok(Answer::json(&json!({})))
            }
            ("" | "drawing.json" | "frame" | "reference" | "errors", true) => {
                Err(Answer::refusal(405, "expected GET"))
            }
            ("open" | "close" | "wish" | "pixel" | "live", false) => {
                Err(Answer::refusal(405, "expected POST"))
            }
            _ => Err(Answer::refusal(404, "there is nothing here")),
        }
    }

    /// The names under which this server may be addressed: not those that another server's DNS
    /// points to it.
    fn names(&self) -> [String; 2] {
        ["127.0.0.1", "localhost"].map(|host| format!("{host}:{}", self.port))
    }

    fn check_host(&self, request: &Request) -> Result<(), Answer> {
        let hosts = headers(request, "Host");
        match &hosts[..] {
            [host] if self.names().contains(host) => Ok(()),
            _ => Err(Answer::refusal(
                403,
                "wrong Host: expected the address that was printed",
            )),
        }
    }

    /// Browsers name the page that sends a POST request.
    fn check_origin(&self, request: &Request) -> Result<(), Answer> {
        let origins = headers(request, "Origin");
        let is_own = |origin: &String| {
            self.names()
                .iter()
                .any(|name| *origin == format!("http://{name}"))
        };
        match &origins[..] {
            [] if *request.method() != Method::Post => Ok(()),
            [origin] if is_own(origin) => Ok(()),
            _ => Err(Answer::refusal(
                403,
                "wrong Origin: expected a request of the page itself",
            )),
        }
    }

    /// The rest of a target below the token.
    fn below_token<'t>(&self, target: &'t str) -> Result<&'t str, Answer> {
        let rest = target.strip_prefix('/').and_then(|rest| rest.split_once('/'));
        match rest {
            Some((token, rest)) if equal(token, self.token) => Ok(rest),
            _ => Err(Answer::refusal(
                403,
                "wrong token: expected the address that was printed",
            )),
        }
    }

    fn check_page(&self, page: u64) -> Result<(), Answer> {
        let why = "another page shows this view now";
        let is_served = self.shared.state().see(page);
        is_served.then_some(()).ok_or_else(|| Answer::refusal(409, why))
    }

    /// The facts, with the picture if it is new. Waits for news.
    fn frame(&self, query: &str) -> Result<Answer, Answer> {
        let page = number(query, "page")?;
        let (news, has) = (number(query, "news")?, number(query, "frame")?);
        self.check_page(page)?;
        let (mut facts, frame, frame_number) = {
            let state = self.shared.wait(PATIENCE, |state| state.news != news);
            (state.facts(), state.frame.clone(), state.frame_number)
        };
        self.check_page(page)?;
        let frame = frame.filter(|_| frame_number != has);
        facts["frame_number"] = frame_number.into();
        facts["frame"] = frame.as_ref().map_or(Value::Null, |frame| frame.facts.clone());
        let mut head = facts.to_string().into_bytes();
        // The picture starts at a multiple of four bytes.
        head.resize(head.len().next_multiple_of(4), b' ');
        let mut bytes = (head.len() as u32).to_le_bytes().to_vec();
        bytes.extend(head);
        bytes.extend(frame.iter().flat_map(|frame| &frame.bytes));
        Ok(Answer::new("application/octet-stream", bytes))
    }

    fn image(&self) -> Result<(Arc<whitstone_image::Image>, String), Answer> {
        match &self.shared.state().reference {
            Reference::Ready { image, key, .. } => Ok((image.clone(), key.clone())),
            _ => Err(Answer::refusal(404, "there is no reference")),
        }
    }

    /// The reference as half floats, after its width and height.
    fn reference(&self, query: &str) -> Result<Answer, Answer> {
        self.check_page(number(query, "page")?)?;
        let (image, _) = self.image()?;
        let pixels = reference::pixels(&image).map_err(|problem| Answer::refusal(500, problem))?;
        let sides = [image.width(), image.height()].map(|side| (side as u32).to_le_bytes());
        Ok(Answer::new(
            "application/octet-stream",
            [&sides.concat()[..], &halves(&pixels)].concat(),
        ))
    }

    /// The errors of the finished picture.
    fn errors(&self, query: &str) -> Result<Answer, Answer> {
        self.check_page(number(query, "page")?)?;
        let (image, key) = self.image()?;
        let frame = self.shared.state().frame.clone();
        let fits = |frame: &Arc<Frame>| frame.is_final && frame.key == key && !frame.rgb.is_empty();
        let why = "the finished picture is not that of the reference";
        let frame = frame.filter(fits).ok_or_else(|| Answer::refusal(404, why))?;
        let errors = reference::errors(frame.size, &frame.rgb, &image);
        let errors = errors.map_err(|problem| Answer::refusal(409, problem))?;
        Ok(Answer::new("application/octet-stream", errors))
    }

    fn wish(&self, request: &mut Request) -> Result<Answer, Answer> {
        let change: Change = body(request)?;
        self.check_page(change.page)?;
        if let Some(name) = &change.accelerator {
            let known = self.registry.get(whitstone_core::FamilyName::Accelerator, name);
            known.map_err(|error| Answer::refusal(400, error.message))?;
        }
        let number = self.shared.change(|state| {
            state.wish(|wish| {
                *wish = Wish {
                    look_at: change.look_at,
                    accelerator: change.accelerator,
                    shown: change.shown,
                    files: wish.files,
                }
            });
            state.wishes
        });
        Ok(Answer::json(&json!({ "wish": number })))
    }

    fn pixel(&self, request: &mut Request) -> Result<Answer, Answer> {
        let Pixel { page, x, y, sample } = body(request)?;
        self.check_page(page)?;
        let wish = self.shared.state().wish.clone();
        let report = self.shared.with_scene(|scene| {
            let aspect = Aspect {
                look_at: wish.look_at.filter(|_| !scene.depends_on_camera),
                divisor: 1,
                preview: false,
            };
            pixel::report(scene, aspect, [x, y], sample, self.registry)
        });
        match report {
            None => Err(Answer::refusal(409, "the scene cannot be built")),
            Some(Err(problem)) => Err(Answer::refusal(400, problem)),
            Some(Ok(report)) => Ok(Answer::json(&report)),
        }
    }
}

fn headers(request: &Request, name: &'static str) -> Vec<String> {
    let all = request.headers().iter();
    let named = all.filter(|header| header.field.equiv(name));
    named.map(|header| header.value.as_str().to_owned()).collect()
}

/// Compares without ending at the first difference, whose place would take time to find out.
fn equal(a: &str, b: &str) -> bool {
    let differences = a.bytes().zip(b.bytes()).fold(0, |all, (a, b)| all | (a ^ b));
    a.len() == b.len() && differences == 0
}

fn number(query: &str, key: &str) -> Result<u64, Answer> {
    let mut pairs = query.split('&').filter_map(|pair| pair.split_once('='));
    let value = pairs.find(|(name, _)| *name == key).map(|(_, value)| value);
    value
        .and_then(|value| value.parse().ok())
        .ok_or_else(|| Answer::refusal(400, format!("expected a number \"{key}\"")))
}

/// The body of a request as JSON.
fn body<T: DeserializeOwned>(request: &mut Request) -> Result<T, Answer> {
    let too_large = || Answer::refusal(413, format!("expected at most {MAX_BODY} bytes"));
    if request.body_length().is_some_and(|length| length > MAX_BODY) {
        return Err(too_large());
    }
    let mut bytes = Vec::new();
    let read = request
        .as_reader()
        .take(MAX_BODY as u64 + 1)
        .read_to_end(&mut bytes);
    read.map_err(|error| Answer::refusal(400, error.to_string()))?;
    if bytes.len() > MAX_BODY {
        return Err(too_large());
    }
    serde_json::from_slice(&bytes).map_err(|error| Answer::refusal(400, error.to_string()))
}

/// Text for HTML.
fn escaped(text: &str) -> String {
    let mut safe = String::new();
    for letter in text.chars() {
        match letter {
            '&' => safe += "&amp;",
            '<' => safe += "&lt;",
            '>' => safe += "&gt;",
            '"' => safe += "&quot;",
            _ => safe.push(letter),
        }
    }
    safe
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_are_equal_as_a_whole() {
        assert!(equal("abc", "abc"));
        for other in ["", "ab", "abcd", "abd", "Abc"] {
            assert!(!equal(other, "abc"), "{other}");
        }
    }

    #[test]
    fn the_page_is_complete() {
        let page = page("SCRIPT <b>.toml", "f00d");
        assert!(page.contains("<title>SCRIPT &lt;b&gt;.toml"));
        assert_eq!(page.matches("nonce=\"f00d\"").count(), 2);
        // Else the browser would see the end of the script in it.
        assert_eq!(page.matches("</script>").count(), 1);
        assert_eq!(page.matches("</style>").count(), 1);
        assert!(page.contains("\"use strict\";") && page.contains("color-scheme"));
    }

    #[test]
    fn names_of_files_cannot_become_elements() {
        assert_eq!(escaped("a<b>\"&c"), "a&lt;b&gt;&quot;&amp;c");
    }
}
