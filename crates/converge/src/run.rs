//! Runs a study: first the truth, then every configuration once, then all of them repeatedly in
//! turns.

use crate::cache::{Cache, Record};
use crate::errors::{Measured, rounding};
use crate::lab::{Lab, Ready};
use crate::report::{Point, SeriesReport, StudyReport, TruthReport};
use crate::study::{Engine, Series, Study, Truth};
use crate::usage::Ticks;
use whitstone_image::Image;
use whitstone_metrics::Mask;
use whitstone_validate::quoted;

/// A setting of a series that is being measured.
struct Job<'s> {
    series: usize,
    setting: usize,
    /// The cache key; empty if the scene is invalid.
    key: String,
    ready: Option<Ready>,
    record: Result<Record, String>,
    study: &'s Study,
}

/// The truth of a series.
struct True {
    /// Hash of its pixels.
    hash: String,
    image: Image,
    edges: Mask,
    floor: f64,
}

impl Lab<'_> {
    /// First measuring session: takes the first half of the times of a study and stores them.
    ///
    /// A later [`Self::measure`] adds a second session. Everything is rebuilt between the two, and
    /// the state of the machine may have changed.
    ///
    /// # Errors
    ///
    /// As [`Self::measure`].
    pub fn measure_first_session(&mut self, study: &Study, progress: &dyn Fn(&str)) -> Result<(), String> {
        if study.stress.is_some() {
            return Ok(());
        }
        self.halfway = true;
        let sat = self.measure(study, progress);
        self.halfway = false;
        sat.map(drop)
    }

    /// Measures a study. `progress` receives progress messages.
    ///
    /// # Errors
    ///
    /// If the study or its scene is invalid, or there is no truth. Later failures are in the
    /// report.
    pub fn measure(&mut self, study: &Study, progress: &dyn Fn(&str)) -> Result<StudyReport, String> {
        if study.stress.is_some() {
            #[cfg(feature = "stress")]
            return self.measure_family(study, progress);
            #[cfg(not(feature = "stress"))]
            return Err(format!("{}: built without the feature `stress`", study.name));
        }
        self.check(study)?;
        let mut truths = Vec::new();
        let mut problems = Vec::new();
        let takes_part: Vec<&Series> = study
            .series
            .iter()
            .filter(|series| self.absent(series.engine).is_none())
            .collect();
        for (number, series) in study.series.iter().enumerate() {
            if number == 0 || study.truth_of_series {
                progress("the truth");
                truths.push(self.truth(study, series, &mut problems)?);
            }
        }
        let truth_of = |series: usize| &truths[series.min(truths.len() - 1)];
        let mut jobs = Vec::new();
        for (series, of) in study.series.iter().enumerate() {
            if !takes_part.iter().any(|part| std::ptr::eq(*part, of)) {
                continue;
            }
            for setting in 0..of.settings.len() {
                progress(&format!(
                    "{}, {}: {}",
                    of.name,
                    of.engine.name(),
                    of.settings[setting].label
                ));
                let job = self.first_look(study, series, setting, truth_of(series));
                let hopeless = of.subject.is_some() && job.record.is_err();
                jobs.push(job);
                if hopeless {
                    break;
                }
            }
        }
        self.rounds(&mut jobs, progress);
        let series = study.series.iter().enumerate().map(|(number, of)| {
            let points = jobs
                .iter()
                .filter(|job| job.series == number)
                .map(|job| self.point(job));
            let absent = self
                .absent(of.engine)
                .filter(|_| !jobs.iter().any(|job| job.series == number));
            SeriesReport::new(
                of,
                points.collect(),
                truth_of(number).floor,
                study.against,
                absent,
            )
        });
        let series: Vec<SeriesReport> = series.collect();
        let floor = truths.iter().map(|truth| truth.floor).fold(0.0, f64::max);
        let truth = self.truth_report(study);
        let records = jobs.iter().filter_map(|job| job.record.as_ref().ok());
        let others = records.map(|record| record.used).sum::<Ticks>().others();
        Ok(StudyReport::new(study, truth, floor, series, problems, others))
    }

    /// Builds the first and the last setting of each series, so that an unknown path is reported
    /// before anything is rendered.
    fn check(&self, study: &Study) -> Result<(), String> {
        let mut reports: Vec<String> = Vec::new();
        let takes_part = |series: &&Series| self.absent(series.engine).is_none();
        for series in study.series.iter().filter(takes_part) {
            let ends = [series.settings.first(), series.settings.last()];
            for setting in ends.into_iter().flatten() {
                if let Err(report) = self.build(study, &study.changes(series, setting))
                    && !reports.contains(&report)
                {
                    reports.push(report);
                }
            }
        }
        if reports.is_empty() {
            Ok(())
        } else {
            Err(reports.join("\n\n"))
        }
    }

    /// The truth of a series, with the distance of its check renderings.
    fn truth(&mut self, study: &Study, series: &Series, problems: &mut Vec<String>) -> Result<True, String> {
        let image = self.true_image(study, series, &study.truth)?;
        let edges = self.edges(study, &study.truth_changes(&study.truth, series))?;
        let mut floor = rounding(&image);
        for check in &study.checks {
            if let Some(why) = self.absent(check.engine) {
                problems.push(format!(
                    "the truth is not checked against {}: {why}",
                    check.engine.name()
                ));
                continue;
            }
            let other = self.true_image(study, series, check)?;
            let apart = Measured::between(&other, &image, &edges)?;
            if apart.finite < 1.0 {
                return Err(format!(
                    "{}: the truth has values that are not finite",
                    study.name
                ));
            }
            floor = floor.max(apart.whole.rmse);
        }
        Ok(True {
            hash: Cache::key(&[&format!("{:?}", image.rgb()), &format!("{:?}", edges.as_slice())]),
            image,
            edges,
            floor,
        })
    }

    fn true_image(&mut self, study: &Study, series: &Series, truth: &Truth) -> Result<Image, String> {
        let changes = study.truth_changes(truth, series);
        let flattened = self.flatten(study, &changes)?;
        let key = self.key("truth", truth.engine, &flattened, "");
        if let Some(image) = self.cache.image(&key) {
            return Ok(image);
        }
        if let Some(why) = self.absent(truth.engine) {
            return Err(format!(
                "{}: the truth is a rendering by {}, which takes no part: {why}",
                study.name,
                truth.engine.name()
            ));
        }
        let (_, shot) = self.first(study, truth.engine, &changes)?;
        self.cache.keep_image(&key, &shot.image)?;
        Ok(shot.image)
    }

    /// Renders a setting once and measures its error, or takes both from the cache.
    fn first_look<'s>(&mut self, study: &'s Study, series: usize, setting: usize, truth: &True) -> Job<'s> {
        let mut job = Job {
            series,
            setting,
            key: String::new(),
            ready: None,
            record: Err(String::new()),
            study,
        };
        job.record = self.look(&mut job, truth);
        job
    }

    fn look(&mut self, job: &mut Job<'_>, truth: &True) -> Result<Record, String> {
        let (study, series) = (job.study, &job.study.series[job.series]);
        let setting = &series.settings[job.setting];
        let flattened = self.flatten(study, &study.changes(series, setting))?;
        let kind = match &series.subject {
            None => "point".to_owned(),
            Some(subject) => format!("{} {}", subject.name, setting.label),
        };
        job.key = self.key(&kind, series.engine, &flattened, &truth.hash);
        // A command, or the library that is installed, may be another one in the next run.
        let is_known = series.subject.is_none() && series.engine != Engine::Embree;
        let known = match is_known {
            true => self.cache.record(&job.key),
            false => self.cache.record_of_this_run(&job.key),
        };
        let known = known.map(|record| Record {
            // More repeats may be wanted than last time.
            repeats: self.repeats(study, record.affordable),
            ..record
        });
        if let Some(record) = known.clone().filter(Record::is_complete) {
            return Ok(record);
        }
        let (ready, shot) = self.first_of(study, series, setting)?;
        job.ready = Some(ready);
        // Times of the first session, or of an interrupted run, still count.
        if let Some(record) = known {
            return Ok(record);
        }
        let errors = Measured::between(&shot.image, &truth.image, &truth.edges)?;
        let record = self.record(study, &shot, errors);
        self.cache.keep(&job.key, &record)?;
        Ok(record)
    }

    /// Measures every configuration once per round, alternately forwards and backwards. A temporary
    /// disturbance or a gradual slowdown of the machine then affects all of them alike.
    fn rounds(&mut self, jobs: &mut [Job<'_>], progress: &dyn Fn(&str)) {
        let rounds = jobs
            .iter()
            .filter_map(|job| job.record.as_ref().ok())
            .map(|record| record.repeats)
            .max();
        for round in 0..rounds.unwrap_or(0) {
            let mut order: Vec<usize> = (0..jobs.len()).collect();
            if round % 2 == 1 {
                order.reverse();
            }
            for index in order {
                let job = &mut jobs[index];
                let (Some(ready), Ok(record)) = (&job.ready, &mut job.record) else {
                    continue;
                };
                let half = record.repeats.div_ceil(2);
                let sat = self.halfway && record.times.len() >= half;
                if record.times.len() > round || record.is_complete() || sat {
                    continue;
                }
                progress(&format!("round {} of {}", round + 1, rounds.unwrap_or(0)));
                let timed = self.time(ready, record);
                let kept = timed.and_then(|()| self.cache.keep(&job.key, record));
                if let Err(problem) = kept {
                    // Earlier measurements stay in the cache; the next run continues from there.
                    job.record = Err(problem);
                }
            }
        }
    }

    fn point(&self, job: &Job<'_>) -> Point {
        let (study, series) = (job.study, &job.study.series[job.series]);
        let setting = &series.settings[job.setting];
        let changes = study.changes(series, setting);
        let command = match series.engine {
            Engine::Whitstone => {
                let sets: String = changes
                    .iter()
                    .map(|change| format!(" --set {}", quoted(&change.text)))
                    .collect();
                let scene = quoted(&study.scene_path.display().to_string());
                format!("{} render {scene}{sets} -o ours.exr", self.options.program)
            }
            _ => self.command(study),
        };
        Point::new(setting, job.record.as_ref(), command)
    }

    /// The command that measures this study again.
    pub(crate) fn command(&self, study: &Study) -> String {
        let quick = if study.quick { " --quick" } else { "" };
        let file = quoted(study.sources.name());
        format!("{} converge {file}{quick}", self.options.program)
    }

    fn truth_report(&self, study: &Study) -> TruthReport {
        let texts =
            |truth: &Truth| -> Vec<String> { truth.set.iter().map(|change| change.text.clone()).collect() };
        TruthReport {
            engine: study.truth.engine,
            configuration: texts(&study.truth).join(" "),
            of_series: study.truth_of_series,
            checks: study
                .checks
                .iter()
                .map(|check| {
                    format!("{} {}", check.engine.name(), texts(check).join(" "))
                        .trim()
                        .to_owned()
                })
                .collect(),
            command: self.command(study),
        }
    }
}
