//! The server on the loopback interface, and the requests that it refuses.
//!
//! A page and all that it may ask for is below a random token, so that no other page and no other
//! user of the machine can reach it. The name in `Host` is checked against DNS rebinding, `Origin`
//! against requests of other pages.

use serde::de::DeserializeOwned;
use serde_json::Value;
use std::fmt::Write as _;
use std::io::Read;
use std::net::{Ipv4Addr, TcpListener};
use std::thread;
use std::time::Duration;
use thiserror::Error;
use tiny_http::{Header, Method, Request, Response, Server};
use whitstone_render::{SPARE_THREADS, startable_threads};

/// Maximum length of a request target in bytes.
const MAX_TARGET: usize = 1024;
/// Maximum length of a request body in bytes.
const MAX_BODY: usize = 16 << 10;

/// Why a page is not served.
#[derive(Debug, Error)]
pub enum StartError {
    /// The port cannot be used.
    #[error(
        "port {port} of 127.0.0.1 cannot be used: {error}; choose another one with --port, or 0 for any free one"
    )]
    Port {
        /// The port.
        port: u16,
        /// What the system says.
        error: std::io::Error,
    },
    /// The address of tev has a wrong form.
    #[error("--tev {0}")]
    Tev(String),
    /// The server cannot be started.
    #[error("cannot start the server: {0}")]
    Server(String),
}

/// Starts a thread of a page.
pub(crate) fn start<'scope>(
    scope: &'scope thread::Scope<'scope, '_>,
    work: impl FnOnce() + Send + 'scope,
) -> Result<(), StartError> {
    let started = thread::Builder::new().spawn_scoped(scope, work);
    let failed = |error| StartError::Server(format!("a thread cannot be started: {error}"));
    started.map(drop).map_err(failed)
}

/// An answer before it is sent.
pub(crate) struct Answer {
    status: u16,
    kind: &'static str,
    body: Vec<u8>,
}

impl Answer {
    pub(crate) fn new(kind: &'static str, body: impl Into<Vec<u8>>) -> Self {
        Self {
            status: 200,
            kind,
            body: body.into(),
        }
    }

    pub(crate) fn html(body: impl Into<Vec<u8>>) -> Self {
        Self::new("text/html; charset=utf-8", body)
    }

    pub(crate) fn json(value: &Value) -> Self {
        Self::new("application/json", value.to_string())
    }

    pub(crate) fn refusal(status: u16, why: impl Into<String>) -> Self {
        Self {
            status,
            kind: "text/plain; charset=utf-8",
            body: why.into().into_bytes(),
        }
    }
}

/// What a request asks for, below the token.
pub(crate) struct Wanted<'t> {
    pub(crate) path: &'t str,
    pub(crate) query: &'t str,
    pub(crate) is_post: bool,
}

/// A server whose port is open.
pub(crate) struct Gate {
    server: Server,
    port: u16,
    token: String,
}

impl Gate {
    /// Opens a port of 127.0.0.1; 0 stands for any free one. Nothing is answered before
    /// [`Self::serve`].
    pub(crate) fn open(port: u16) -> Result<Self, StartError> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))
            .map_err(|error| StartError::Port { port, error })?;
        send_at_once(&listener);
        // `tiny_http` panics if its own threads cannot be started.
        let threads = startable_threads(SPARE_THREADS);
        if threads < SPARE_THREADS {
            return Err(StartError::Server(format!(
                "it needs {SPARE_THREADS} threads, and the system allows {threads}"
            )));
        }
        let address = listener
            .local_addr()
            .map_err(|error| StartError::Port { port, error })?;
        let server =
            Server::from_listener(listener, None).map_err(|error| StartError::Server(error.to_string()))?;
        let mut bytes = [0; 16];
        getrandom::fill(&mut bytes)
            .map_err(|error| StartError::Server(format!("no random numbers: {error}")))?;
        let token = bytes.iter().fold(String::new(), |mut text, byte| {
            let _ = write!(text, "{byte:02x}");
            text
        });
        Ok(Self {
            server,
            port: address.port(),
            token,
        })
    }

    /// The address of the page. Whoever knows it can ask for all that the page asks for.
    pub(crate) fn url(&self) -> String {
        format!("http://127.0.0.1:{}/{}/", self.port, self.token)
    }

    pub(crate) fn token(&self) -> &str {
        &self.token
    }

    /// Answers requests until `ended`. Several threads may do so.
    pub(crate) fn serve(
        &self,
        ended: impl Fn() -> bool,
        answer: impl Fn(&mut Request, &Wanted<'_>) -> Result<Answer, Answer>,
    ) {
        while !ended() {
            match self.server.recv_timeout(Duration::from_millis(200)) {
                Ok(Some(request)) => self.respond(request, &answer),
                Ok(None) => {}
                Err(_) => return,
            }
        }
    }

    fn respond(
        &self,
        mut request: Request,
        answer: &impl Fn(&mut Request, &Wanted<'_>) -> Result<Answer, Answer>,
    ) {
        let target = request.url().to_owned();
        let answered = self
            .check(&request, &target)
            .and_then(|wanted| answer(&mut request, &wanted))
            .unwrap_or_else(|refusal| refusal);
        let policy = policy(&self.token);
        let fixed = [
            ("Content-Type", answered.kind),
            ("Content-Security-Policy", policy.as_str()),
            ("X-Content-Type-Options", "nosniff"),
            ("Referrer-Policy", "no-referrer"),
            ("Cross-Origin-Resource-Policy", "same-origin"),
            ("Cache-Control", "no-store"),
        ];
        let mut response = Response::from_data(answered.body)
            .with_status_code(answered.status)
            .with_chunked_threshold(usize::MAX);
        for (name, value) in fixed {
            if let Ok(header) = Header::from_bytes(name, value) {
                response.add_header(header);
            }
        }
        // A page that has gone needs no answer.
        let _ = request.respond(response);
    }

    fn check<'t>(&self, request: &Request, target: &'t str) -> Result<Wanted<'t>, Answer> {
        self.check_host(request)?;
        self.check_origin(request)?;
        if target.len() > MAX_TARGET {
            return Err(Answer::refusal(414, "the address is too long"));
        }
        let path = self.below_token(target)?;
        let (path, query) = path.split_once('?').unwrap_or((path, ""));
        let is_post = *request.method() == Method::Post;
        if !is_post && *request.method() != Method::Get {
            return Err(Answer::refusal(405, "expected GET or POST"));
        }
        Ok(Wanted { path, query, is_post })
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
            Some((token, rest)) if equal(token, &self.token) => Ok(rest),
            _ => Err(Answer::refusal(
                403,
                "wrong token: expected the address that was printed",
            )),
        }
    }
}

/// What a page may load: what it contains, and answers of this server.
fn policy(token: &str) -> String {
    format!(
        "default-src 'none'; script-src 'nonce-{token}'; style-src 'nonce-{token}'; connect-src 'self'; \
         img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
}

/// Makes connections send the end of an answer at once. Otherwise it waits for the browser to
/// acknowledge the part before, which the browser delays by 40 ms (Nagle's algorithm). Connections
/// inherit the option of the socket that accepts them. Without it, the page is only slower.
fn send_at_once(listener: &TcpListener) {
    let _ = socket2::SockRef::from(listener).set_tcp_nodelay(true);
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

/// A number of a query.
pub(crate) fn number(query: &str, key: &str) -> Result<u64, Answer> {
    let mut pairs = query.split('&').filter_map(|pair| pair.split_once('='));
    let value = pairs.find(|(name, _)| *name == key).map(|(_, value)| value);
    value
        .and_then(|value| value.parse().ok())
        .ok_or_else(|| Answer::refusal(400, format!("expected a number \"{key}\"")))
}

/// The body of a request as JSON.
pub(crate) fn body<T: DeserializeOwned>(request: &mut Request) -> Result<T, Answer> {
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
}
