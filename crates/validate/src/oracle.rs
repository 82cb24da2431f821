//! Queries the oracle about pixels in which the two renderers differ.

use crate::explain::agree;
use crate::opinion::{Opinion, OraclePolicy, Verdict};
use crate::tolerance::{allowed, color_at};
use crate::validator::Validator;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Instant;
use whitstone_image::Image;
use whitstone_metrics::metrics;

/// The oracle's value of a pixel, its uncertainty per channel, and all values that it found; `None`
/// if it is not known.
pub(crate) type Value = Option<([[f64; 3]; 2], Vec<[f64; 3]>)>;

/// The verdict, given the tolerance of each channel. If the oracle's value is uncertain, ours must
/// equal one of the values that it found.
pub(crate) fn verdict(value: &Value, ours: [f64; 3], reference: [f64; 3], tolerance: [f64; 3]) -> Verdict {
    let Some(([rgb, uncertainty], seen)) = value else {
        return Verdict::Unknown;
    };
    if (0..3).any(|c| !rgb[c].is_finite() || uncertainty[c].is_nan()) {
        return Verdict::Unknown;
    }
    let near = |side: [f64; 3]| (0..3).all(|c| (side[c] - rgb[c]).abs() <= tolerance[c] + uncertainty[c]);
    if (0..3).any(|c| uncertainty[c] > tolerance[c]) {
        let taken = |side: [f64; 3]| seen.iter().any(|value| agree(*value, side, tolerance));
        return match (taken(ours), near(ours)) {
            (true, _) => Verdict::IllPosed,
            (false, true) => Verdict::Unknown,
            (false, false) if near(reference) => Verdict::Reference,
            (false, false) => Verdict::Neither,
        };
    }
    match (near(ours), near(reference)) {
        (true, true) => Verdict::Both,
        (true, false) => Verdict::Ours,
        (false, true) => Verdict::Reference,
        (false, false) => Verdict::Neither,
    }
}

/// The queries and the oracle's answers.
#[derive(Debug, Default)]
pub(crate) struct Hearing {
    /// A pixel and the oracle's value, for each pixel that was answered in time.
    pub(crate) values: Vec<([usize; 2], Value)>,
    pub(crate) out_of_time: bool,
    pub(crate) seconds: f64,
    pub(crate) silent: Option<String>,
}

impl Hearing {
    /// The verdict on each pixel.
    pub(crate) fn verdicts<'a>(
        &'a self,
        ours: &'a Image,
        reference: &'a Image,
    ) -> impl Iterator<Item = ([usize; 2], Verdict)> + 'a {
        let mean = metrics::mean_reference(reference).unwrap_or(0.0);
        self.values.iter().map(move |(pixel, value)| {
            let pixel = *pixel;
            let theirs = color_at(reference, pixel);
            (
                pixel,
                verdict(value, color_at(ours, pixel), theirs, allowed(theirs, mean)),
            )
        })
    }

    /// Summarises the verdicts, given the number `in_question` of pixels in question.
    pub(crate) fn opinion(&self, verdicts: &[([usize; 2], Verdict)], in_question: usize) -> Opinion {
        let mut opinion = Opinion {
            in_question,
            out_of_time: self.out_of_time,
            seconds: self.seconds,
            silent: self.silent.clone(),
            ..Opinion::default()
        };
        verdicts.iter().for_each(|(_, verdict)| opinion.count(*verdict));
        opinion
    }
}

/// A function that returns the oracle's value of a pixel within a deadline, for the scene that both
/// sides rendered.
#[cfg(feature = "oracle")]
fn tracer(
    validator: &Validator<'_>,
    path: &Path,
    overrides: &[String],
) -> Result<impl Fn([u32; 2], bool, Instant) -> Value + Sync + use<>, String> {
    use whitstone_oracle::tracer::{Care, Tracer, Value};
    use whitstone_scene::{Description, Plan, Sources};

    let sources = Sources::load(path, overrides, validator.registry)
        .map_err(|error| error.sources.report(&error.errors, false))?;
    let description = Description::parse(&sources)
        .into_result()
        .map_err(|errors| sources.report(&errors, false))?;
    Plan::new(&description, validator.registry)
        .into_result()
        .map_err(|errors| sources.report(&errors, false))?;
    let tracer = Tracer::new(&description).map_err(|errors| {
        let first = errors.0.first().map(|error| error.message.clone());
        first.unwrap_or_default()
    })?;
    Ok(move |pixel, carefully, deadline| {
        let care = if carefully { Care::GREAT } else { Care::USUAL };
        match tracer.pixel_before(pixel, care, deadline) {
            Value::Known {
                rgb,
                uncertainty,
                seen,
            } => Some(([rgb, uncertainty], seen)),
            Value::Unknown(_) => None,
        }
    })
}

#[cfg(not(feature = "oracle"))]
fn tracer(_: &Validator<'_>, _: &Path, _: &[String]) -> Result<fn([u32; 2], bool, Instant) -> Value, String> {
    Err("this program was built without the oracle; build it with the feature `stress`".to_owned())
}

/// An evenly spaced selection of `most` pixels, in order.
pub(crate) fn choose(pixels: &[[usize; 2]], most: usize) -> Vec<[usize; 2]> {
    if pixels.len() <= most {
        return pixels.to_vec();
    }
    (0..most).map(|i| pixels[i * pixels.len() / most]).collect()
}

impl Validator<'_> {
    /// Sets when the oracle is queried.
    pub fn set_oracle(&mut self, policy: OraclePolicy) {
        self.oracle = policy;
    }

    /// Queries the oracle about pixels, on all threads, until the time limit. Values that
    /// contradict ours are computed again with more care, because the pixel may touch an edge.
    pub(crate) fn hear(
        &self,
        path: &Path,
        pixels: &[[usize; 2]],
        ours: &Image,
        reference: &Image,
    ) -> Hearing {
        let mean = metrics::mean_reference(reference).unwrap_or(0.0);
        let contradicts = |pixel: [usize; 2], value: &Value| {
            let theirs = color_at(reference, pixel);
            let verdict = verdict(value, color_at(ours, pixel), theirs, allowed(theirs, mean));
            matches!(verdict, Verdict::Reference | Verdict::Neither | Verdict::Unknown)
        };
        let mut hearing = Hearing::default();
        if pixels.is_empty() {
            return hearing;
        }
        let start = Instant::now();
        let overrides = self.overrides(path, &mut Vec::new()).map(|mut overrides| {
            overrides.extend(self.options.shared_overrides.iter().cloned());
            overrides
        });
        let tracer = match overrides.and_then(|overrides| tracer(self, path, &overrides)) {
            Ok(tracer) => tracer,
            Err(why) => {
                hearing.silent = Some(why);
                return hearing;
            }
        };
        // Reading the scene does not count.
        let deadline = Instant::now() + self.oracle.budget;
        let threads = match self.options.threads {
            0 => thread::available_parallelism().map_or(1, usize::from),
            threads => threads,
        };
        let (stage, stop) = (&self.stage, &self.stop);
        let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let found = Mutex::new(vec![None; pixels.len()]);
        let work = || {
            loop {
                let index = next.fetch_add(1, Ordering::Relaxed);
                if index >= pixels.len() || Instant::now() >= deadline || stop.is_requested() {
                    return;
                }
                let pixel = pixels[index].map(|p| p as u32);
                let mut value = tracer(pixel, false, deadline);
                if value.is_some() && contradicts(pixels[index], &value) {
                    value = tracer(pixel, true, deadline);
                }
                // A pixel that ran out of time was not answered.
                if value.is_some() || Instant::now() < deadline {
                    let mut found = found.lock().unwrap_or_else(|poison| poison.into_inner());
                    found[index] = Some(value);
                }
                let done = 1 + done.fetch_add(1, Ordering::Relaxed);
                stage(&format!("the oracle, {done} of {} pixels", pixels.len()));
            }
        };
        thread::scope(|scope| {
            for _ in 1..threads.min(pixels.len()) {
                // Without them, this thread does all.
                let _ = thread::Builder::new().spawn_scoped(scope, work);
            }
            work();
        });
        let found = found.into_inner().unwrap_or_else(|poison| poison.into_inner());
        hearing.values = (pixels.iter().zip(found))
            .filter_map(|(&pixel, value)| Some((pixel, value?)))
            .collect();
        hearing.out_of_time = hearing.values.len() < pixels.len();
        hearing.seconds = start.elapsed().as_secs_f64();
        hearing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_is_right() {
        let known = |rgb: f64, uncertainty: f64| {
            let seen = vec![[rgb; 3], [rgb - uncertainty / 4.0; 3]];
            Some(([[rgb; 3], [uncertainty; 3]], seen))
        };
        let judge =
            |value: &Value, ours: f64, reference: f64| verdict(value, [ours; 3], [reference; 3], [0.01; 3]);
        let certain = &known(1.0, 1e-12);
        assert_eq!(judge(certain, 1.001, 1.5), Verdict::Ours);
        assert_eq!(judge(certain, 1.5, 0.995), Verdict::Reference);
        assert_eq!(judge(certain, 1.009, 0.992), Verdict::Both);
        assert_eq!(judge(certain, 1.5, 0.5), Verdict::Neither);
        assert_eq!(judge(certain, f64::NAN, 1.0), Verdict::Reference);
        // At an edge between 1 and 0.5, our value may be on either side, but not in between.
        let edge = &known(1.0, 2.0);
        assert_eq!(judge(edge, 1.0, 0.5), Verdict::IllPosed);
        assert_eq!(judge(edge, 0.5, 1.0), Verdict::IllPosed);
        assert_eq!(judge(edge, 0.75, 1.0), Verdict::Unknown);
        assert_eq!(judge(edge, 4.0, 1.0), Verdict::Reference);
        assert_eq!(judge(edge, 4.0, 5.0), Verdict::Neither);
        assert_eq!(judge(&known(f64::NAN, 0.0), 1.0, 1.5), Verdict::Unknown);
        assert_eq!(judge(&None, 1.0, 1.0), Verdict::Unknown);
    }

    #[test]
    fn an_even_choice_keeps_the_order_and_both_ends_of_the_image() {
        let pixels: Vec<[usize; 2]> = (0..1000).map(|i| [i, 0]).collect();
        assert_eq!(choose(&pixels, 2000), pixels);
        let some = choose(&pixels, 10);
        assert_eq!(some.len(), 10);
        assert_eq!((some[0], some[9]), ([0, 0], [900, 0]));
    }
}
