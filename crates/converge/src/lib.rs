//! Error against run time, as work-precision sets of numerical software have it: a study names a
//! scene, what is swept, and what is taken for true; every configuration is a curve of error over
//! time.
//!
//! Nothing is claimed that the measurement does not hold: no error within twice the truth's own,
//! which other renderings of the truth tell; no time beyond the points that were measured; no ratio
//! whose bounds are farther apart than a factor of two.

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
pub use study::{Against, Engine, Series, Setting, Study};
pub use table::{csv, headline, table};
