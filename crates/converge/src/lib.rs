//! Measures error against run time (work-precision diagrams). A study names a scene, the parameters
//! to sweep, and the truth; each configuration is a curve of error over time.
//!
//! Reports claim only what the measurement supports. They claim no error within twice the error of
//! the truth itself, which is estimated from other renderings of the truth. They claim no time
//! beyond the measured points, and no ratio whose bounds are farther apart than a factor of two.

mod cache;
pub mod errors;
mod lab;
pub mod plot;
#[cfg(feature = "stress")]
mod precision;
mod report;
mod run;
pub mod statistics;
mod study;
mod table;
pub mod usage;

pub use cache::Cache;
pub use lab::{Lab, Options};
pub use report::{Point, Reached, SeriesReport, StudyReport, TimeTo, TruthReport, Verdict, level_name};
pub use study::{Against, Change, Engine, Series, Setting, Study};
pub use table::{csv, headline, table};
