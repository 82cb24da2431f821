//! Studies of a stress family: the same rays by robust and by textbook formulas, as error against
//! time per ray.

use crate::lab::Lab;
use crate::report::{Point, SeriesReport, StudyReport, TruthReport};
use crate::study::{Engine, Series, Setting, Study};
use whitstone_core::{SceneError, nearest};
use whitstone_stress::{FAMILIES, FamilyReport};

/// Queries at each step of the parameter.
const RAYS: usize = 400;
/// Rounding of the oracle's answers, which is the floor of the errors.
const FLOOR: f64 = f64::EPSILON / 2.0;

impl Lab<'_> {
    /// Measures the study of a family. The field for the root mean square error holds the largest
    /// error in the family's own measure.
    pub(crate) fn measure_family(
        &mut self,
        study: &Study,
        progress: &dyn Fn(&str),
    ) -> Result<StudyReport, String> {
        let Some(name) = &study.stress else {
            return Err("the study names no stress family".to_owned());
        };
        let family = FAMILIES.iter().find(|family| family.about().name == name.text);
        let family = family.ok_or_else(|| {
            let message = format!("there is no stress family \"{}\"", name.text);
            let mut error = SceneError::at(name.span.clone(), message);
            let near = nearest(&name.text, FAMILIES.iter().map(|family| family.about().name));
            error.help = near.map(|near| format!("did you mean \"{near}\"?"));
            study.report(&error.into())
        })?;
        let about = family.about();
        let lab = whitstone_stress::Lab::new(self.registry, self.mitsuba.take(), RAYS);
        let report = FamilyReport::measure(*family, &lab, &|parameter| progress(&format!("{parameter:e}")));
        self.mitsuba = lab.into_driver();
        let report = report?;
        let series = report.engines.iter().filter_map(|engine| {
            let command = format!("{} stress {} --steps", self.options.program, about.name);
            let points = engine.steps.iter().map(|step| {
                let setting = Setting {
                    label: format!("{}={:e}", about.parameter, step.parameter),
                    value: Some(step.parameter),
                    changes: Vec::new(),
                };
                let mut point = Point::new(&setting, Err(&String::new()), command.clone());
                point.problem = None;
                point.seconds = step.ns_per_op.map(|ns| 1e-9 * ns);
                point.rmse = Some(step.error).filter(|error| error.is_finite());
                point.max = point.rmse;
                point
            });
            let of = Series {
                name: about.name.to_owned(),
                engine: engine_of(engine.engine)?,
                subject: None,
                set: Vec::new(),
                settings: Vec::new(),
                slope: None,
            };
            Some(SeriesReport::new(
                &of,
                points.collect(),
                FLOOR,
                study.against,
                engine.absent.as_deref(),
            ))
        });
        let truth = TruthReport {
            engine: Engine::Whitstone,
            configuration: "the oracle, in arbitrary precision".to_owned(),
            of_series: false,
            checks: Vec::new(),
            command: self.command(study),
        };
        let mut found = StudyReport::new(study, truth, FLOOR, series.collect(), Vec::new(), None);
        found.measure = about.measure.to_owned();
        found.parameter = about.parameter.to_owned();
        Ok(found)
    }
}

/// `None` for those that studies leave out: the same programs without their robust flag.
fn engine_of(engine: whitstone_stress::Engine) -> Option<Engine> {
    Some(match engine {
        whitstone_stress::Engine::MitsubaNotRobust | whitstone_stress::Engine::EmbreeNotRobust => {
            return None;
        }
        whitstone_stress::Engine::Obvhs => Engine::Obvhs,
        whitstone_stress::Engine::NaiveDoubleDouble => Engine::NaiveDoubleDouble,
        whitstone_stress::Engine::Whitstone => Engine::Whitstone,
        whitstone_stress::Engine::Mitsuba => Engine::Mitsuba,
        whitstone_stress::Engine::Embree => Engine::Embree,
        whitstone_stress::Engine::NaiveF64 => Engine::NaiveF64,
        whitstone_stress::Engine::NaiveF32 => Engine::NaiveF32,
    })
}
