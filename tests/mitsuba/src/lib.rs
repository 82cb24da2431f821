//! Mitsuba 3 inside this process, so that it can be asked about single rays: only for comparisons,
//! and only with the feature `python`, which needs the shared library of Python. The shapes are
//! those of the driver in `references/mitsuba`, in the environment that the harness makes for it.

#[cfg(feature = "python")]
mod embedded;

#[cfg(feature = "python")]
pub use embedded::Mitsuba;
