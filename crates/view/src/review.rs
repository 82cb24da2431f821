//! A page on the loopback interface on which differences between images are approved, one by one.

use crate::gate::{Answer, Gate, StartError, Wanted, body, number, start};
use serde::Deserialize;
use serde_json::json;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tiny_http::Request;
use whitstone_validate::Stop;

/// Threads that answer requests: a picture takes time, and a click must not wait for it.
const THREADS: usize = 2;

/// Pairs of images, numbered from 0. All methods may be called by several threads at once.
pub trait Pairs: Sync {
    /// The number of pairs.
    fn count(&self) -> usize;
    /// The page that lists them. Its styles and scripts carry `nonce`.
    fn page(&self, nonce: &str) -> String;
    /// The pictures and figures of a pair, as HTML that is inserted into the page.
    fn details(&self, pair: usize) -> String;
    /// Makes our image the reference, and returns how the pair is then listed.
    ///
    /// # Errors
    /// It cannot be accepted, with the reason.
    fn accept(&self, pair: usize) -> Result<Standing, String>;
    /// Takes back what [`Self::accept`] did.
    ///
    /// # Errors
    /// It was not accepted, or the file was changed since.
    fn undo(&self, pair: usize) -> Result<Standing, String>;
}

/// How a pair is listed.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Standing {
    /// The word of its verdict.
    pub word: &'static str,
    /// Whether nothing remains to be done about it.
    pub is_right: bool,
    /// The number of pairs about which something remains to be done.
    pub left: usize,
}

/// A review whose port is open.
pub struct Review {
    gate: Gate,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Chosen {
    pair: usize,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Nothing {}

impl Review {
    /// Opens a port of 127.0.0.1; 0 stands for any free one. Nothing is answered before
    /// [`Self::run`].
    ///
    /// # Errors
    /// The port is in use, or no server can be started.
    pub fn open(port: u16) -> Result<Self, StartError> {
        Ok(Self {
            gate: Gate::open(port)?,
        })
    }

    /// The address of the page. Whoever knows it can accept images.
    pub fn url(&self) -> String {
        self.gate.url()
    }

    /// Serves the page until its button "Done" is pressed or `stop` is requested.
    ///
    /// # Errors
    /// A thread cannot be started.
    pub fn run(&self, pairs: &dyn Pairs, stop: &Stop) -> Result<(), StartError> {
        let done = AtomicBool::new(false);
        let ended = || done.load(Ordering::SeqCst);
        std::thread::scope(|scope| {
            let serve = || {
                self.gate.serve(ended, |request, wanted| {
                    self.answer(pairs, &done, request, wanted)
                });
            };
            let started = (0..THREADS).try_for_each(|_| start(scope, serve));
            while started.is_ok() && !ended() && !stop.is_requested() {
                std::thread::sleep(Duration::from_millis(50));
            }
            done.store(true, Ordering::SeqCst);
            started
        })
    }

    fn answer(
        &self,
        pairs: &dyn Pairs,
        done: &AtomicBool,
        request: &mut Request,
        wanted: &Wanted<'_>,
    ) -> Result<Answer, Answer> {
        let known = |pair: usize| match pair < pairs.count() {
            true => Ok(pair),
            false => Err(Answer::refusal(404, format!("there is no pair {pair}"))),
        };
        let stand = |found: Result<Standing, String>| match found {
            Ok(standing) => Ok(Answer::json(&json!(standing))),
            Err(why) => Err(Answer::refusal(409, why)),
        };
        match (wanted.path, wanted.is_post) {
            ("", false) => Ok(Answer::html(pairs.page(self.gate.token()))),
            ("details", false) => {
                let pair = usize::try_from(number(wanted.query, "pair")?).unwrap_or(usize::MAX);
                Ok(Answer::html(pairs.details(known(pair)?)))
            }
            ("accept", true) => stand(pairs.accept(known(body::<Chosen>(request)?.pair)?)),
            ("undo", true) => stand(pairs.undo(known(body::<Chosen>(request)?.pair)?)),
            ("done", true) => {
                let Nothing {} = body(request)?;
                done.store(true, Ordering::SeqCst);
                Ok(Answer::json(&json!({})))
            }
            ("" | "details", true) => Err(Answer::refusal(405, "expected GET")),
            ("accept" | "undo" | "done", false) => Err(Answer::refusal(405, "expected POST")),
            _ => Err(Answer::refusal(404, "there is nothing here")),
        }
    }
}
