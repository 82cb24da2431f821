//! The pages of `compare`: pairs of images. That of `--review` asks for the pictures of a pair when
//! the pair is opened; that of `--html` contains all of them.

use super::case::{LARGEST_SCALE, PICTURE_WIDTH, data_uri};
use super::script::drawing;
use super::view::{STYLE, ScaleView};
use crate::{Pictures, counted};
use askama::Template;
use whitstone_image::Image;

/// A pair on the page.
#[derive(Clone, Debug)]
pub struct ReviewRow<'a> {
    /// The name of our image.
    pub name: &'a str,
    /// The word of its verdict.
    pub word: &'static str,
    /// Whether nothing remains to be done about it.
    pub is_right: bool,
    /// Each limit that it exceeds, or why there is no comparison.
    pub problems: &'a [String],
    /// The reference that accepting writes; none if there is nothing to accept.
    pub writes: Option<String>,
    /// Whether it was accepted.
    pub accepted: bool,
    /// What is shown when the pair is opened, by [`review_details`]; empty if the page asks for it.
    pub details: &'a str,
}

#[derive(Template)]
#[template(path = "review.html", config = "src/report/askama.toml")]
struct Page<'a> {
    nonce: &'a str,
    title: &'a str,
    style: &'static str,
    scripts: [&'static str; 2],
    scale: ScaleView,
    drawing: String,
    /// Whether images can be accepted on it.
    is_review: bool,
    left: usize,
    rows: &'a [ReviewRow<'a>],
}

/// The page that lists pairs. It has nothing from a network and no inline styles; its own style and
/// scripts carry `nonce`.
pub fn review_page(title: &str, rows: &[ReviewRow<'_>], nonce: &str) -> String {
    page(title, rows, Some(nonce))
}

/// The page of compared pairs as one file, which needs nothing else.
pub fn compare_page(title: &str, rows: &[ReviewRow<'_>]) -> String {
    page(title, rows, None)
}

/// With a nonce it is a review.
fn page(title: &str, rows: &[ReviewRow<'_>], nonce: Option<&str>) -> String {
    let script = match nonce {
        Some(_) => include_str!("review.js"),
        None => include_str!("compare.js"),
    };
    Page {
        nonce: nonce.unwrap_or_default(),
        title,
        style: STYLE,
        scripts: [include_str!("viewer.js"), script],
        scale: ScaleView::new(),
        drawing: drawing(),
        is_review: nonce.is_some(),
        left: rows.iter().filter(|row| !row.is_right).count(),
        rows,
    }
    .to_string()
}

/// A pixel over tolerance.
#[derive(Clone, Debug)]
pub struct ReviewPixel {
    /// Column and row.
    pub at: [usize; 2],
    /// Our red, green and blue.
    pub ours: [f32; 3],
    /// Those of the reference.
    pub reference: [f32; 3],
    /// The relative difference.
    pub relative: f64,
}

/// What is shown of an open pair.
#[derive(Debug, Default)]
pub struct ReviewDetails<'a> {
    /// Ours and the reference, as far as they can be read.
    pub images: [Option<&'a Image>; 2],
    /// If they can be compared: their pictures.
    pub pictures: Option<Pictures>,
    /// Names and values.
    pub figures: Vec<(String, String)>,
    /// The worst pixels.
    pub worst: Vec<ReviewPixel>,
    /// What else has to be known.
    pub notes: Vec<String>,
}

/// A picture of a pair.
struct Picture {
    caption: &'static str,
    data: String,
    /// Width on the page.
    width: usize,
    size: [usize; 2],
    is_error: bool,
}

#[derive(Template)]
#[template(path = "review_details.html", config = "src/report/askama.toml")]
struct Details<'a> {
    details: &'a ReviewDetails<'a>,
    pictures: Vec<Picture>,
    /// The packed pixels, for the viewer.
    pixels: String,
    scale: ScaleView,
}

/// The pictures and figures of a pair, as HTML for the page.
pub fn review_details(details: &ReviewDetails<'_>) -> String {
    let picture = |caption, image: &Image, png: &[u8], is_error| {
        let size = [image.width(), image.height()];
        let scale = ((PICTURE_WIDTH + size[0] / 2) / size[0].max(1)).clamp(1, LARGEST_SCALE);
        Picture {
            caption,
            data: data_uri(png),
            width: size[0] * scale,
            size,
            is_error,
        }
    };
    let (mut pictures, mut pixels) = (Vec::new(), String::new());
    match (&details.pictures, details.images) {
        (Some(all), [Some(image), Some(_)]) => {
            pixels = super::case::base64(&all.pixels);
            pictures = vec![
                picture("ours", image, &all.ours, false),
                picture("reference", image, &all.reference, false),
                picture("relative error", image, &all.error, true),
            ];
        }
        (_, images) => {
            for (image, caption) in images.into_iter().zip(["ours", "reference"]) {
                if let Some((image, png)) = image.and_then(|image| Some((image, crate::pixels::png(image)?)))
                {
                    pictures.push(picture(caption, image, &png, false));
                }
            }
        }
    }
    Details {
        details,
        pictures,
        pixels,
        scale: ScaleView::new(),
    }
    .to_string()
}

impl Page<'_> {
    fn heading(&self) -> String {
        match (self.left, self.is_review) {
            (0, true) => "Nothing is left to review".to_owned(),
            (left, true) => format!("{} to review", counted(left, "image")),
            (0, false) => format!("{} compared, no differences", counted(self.rows.len(), "image")),
            (left, false) => format!(
                "{} compared, {left} with differences",
                counted(self.rows.len(), "image")
            ),
        }
    }
}
