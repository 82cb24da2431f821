//! Tests of the report, the review and the live view in a real browser, by WebDriver: what a reader
//! does, and what must then be seen.
//!
//! `cargo test -p whitstone-browser --features browser` runs them. They need `chromedriver` and a
//! Chromium, and are listed as ignored where these are not, unless `WHITSTONE_BROWSER=required`
//! says that this is a failure. `WHITSTONE_REPORT=FILE` names a report of a whole run, whose size
//! and time to load are then held to their limits too.

#[cfg(feature = "browser")]
mod browser;
mod page;

#[cfg(feature = "browser")]
pub use browser::{Browser, Driver};
pub use page::{DOT, SIZE, UNEXPLAINED, images, page};

/// What a test finds wrong, or cannot do.
pub type Problem = Box<dyn std::error::Error + Send + Sync>;
