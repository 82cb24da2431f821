//! The answers of the server: one table of exact paths.

use crate::gate::{Answer, Gate, Wanted, body, number};
use crate::reference;
use crate::renderer::halves;
use crate::scene::Aspect;
use crate::state::{Frame, Reference, Shared, Wish};
use crate::{camera::LookAt, heat::Shown, pixel};
use serde::Deserialize;
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::Duration;
use tiny_http::Request;
use whitstone_core::Registry;

const PAGE: &str = include_str!("page/view.html");
const SCRIPT: &str = include_str!("page/view.js");
const STYLE: &str = include_str!("page/view.css");

/// How long a request for news waits for some.
const PATIENCE: Duration = Duration::from_secs(4);

/// The page with its style and script: one request less before the first picture.
pub(crate) fn page(name: &str, token: &str) -> String {
    // The name last, so that nothing in it is replaced.
    PAGE.replace("TOKEN", token)
        .replace("STYLE", STYLE)
        .replace("SCRIPT", SCRIPT)
        .replace("SCENE", &escaped(name))
}

/// Answers requests.
pub(crate) struct Site<'a> {
    pub(crate) shared: &'a Shared,
    pub(crate) registry: &'a Registry,
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
    pub(crate) fn serve(&self, gate: &Gate) {
        gate.serve(
            || self.shared.state().ended,
            |request, wanted| self.answer(request, wanted),
        );
    }

    fn answer(&self, request: &mut Request, wanted: &Wanted<'_>) -> Result<Answer, Answer> {
        let query = wanted.query;
        match (wanted.path, wanted.is_post) {
            ("", false) => Ok(Answer::html(self.page)),
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
