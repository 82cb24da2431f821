//! Mitsuba in `bench shapes`, if this program is built with it.

use whitstone::core::Ray;
use whitstone::{Exit, Failure};
use whitstone_oracle::Oracle;
use whitstone_oracle::agreement::Errors;

/// Mitsuba inside this process.
#[cfg(feature = "mitsuba")]
pub(super) struct LiveMitsuba(whitstone_mitsuba::Mitsuba);

#[cfg(feature = "mitsuba")]
impl LiveMitsuba {
    /// Starts in the environment of the harness, which is created if needed.
    pub(super) fn start() -> Result<Self, Failure> {
        use whitstone::validate::Installation;
        use whitstone::validate::environment::Environment;
        let environment = Environment::ensure(&Installation::default(), &|what| eprintln!("{what}"));
        let environment = environment.map_err(Failure::environment)?;
        let mitsuba = whitstone_mitsuba::Mitsuba::start(&environment).map_err(Failure::environment)?;
        Ok(Self(mitsuba))
    }

    /// The errors of Mitsuba's hits.
    pub(super) fn errors(&self, scene: &str, oracle: &Oracle, rays: &[Ray]) -> Result<Errors, &'static str> {
        use std::path::Path;
        use whitstone::core::Interval;
        let camera =
            "camera = { type = \"perspective\", look_at = { origin = [0, 0, 9], target = [0, 0, 0] } }\n";
        let found = self
            .0
            .intersect(&format!("{camera}{scene}"), Path::new("scenes"), rays);
        let found = found
            .map_err(|_| "Mitsuba failed")?
            .ok_or("Mitsuba has no such shape")?;
        let mut errors = Errors::default();
        for (ray, t) in rays.iter().zip(found) {
            errors.add(&oracle.nearest(ray, Interval::FORWARD), t);
        }
        Ok(errors)
    }

    /// Ends the process immediately, because Python must not see its normal end.
    pub(super) fn end(&self, exit: Exit) -> Exit {
        self.0.exit(u8::from(!matches!(exit, Exit::Pass)))
    }
}

/// Mitsuba is not built in.
#[cfg(not(feature = "mitsuba"))]
pub(super) struct LiveMitsuba;

#[cfg(not(feature = "mitsuba"))]
impl LiveMitsuba {
    /// Nothing to start.
    pub(super) fn start() -> Result<Self, Failure> {
        Ok(Self)
    }

    /// Always an error, which says how to build with Mitsuba.
    pub(super) fn errors(&self, _: &str, _: &Oracle, _: &[Ray]) -> Result<Errors, &'static str> {
        Err(
            "not built with Mitsuba; run `cargo run --release --package xtask --features mitsuba -- bench shapes`",
        )
    }

    /// Returns the exit code unchanged.
    pub(super) fn end(&self, exit: Exit) -> Exit {
        exit
    }
}
