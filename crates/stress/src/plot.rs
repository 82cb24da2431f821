//! Plots of a family with logarithmic axes: error against the parameter, with the frontiers, and
//! error against time.

use crate::{Engine, EngineReport, FamilyReport};
use whitstone_plot::{Axis, COLORS, Figure, HEIGHT, LEFT, SECOND, TOP, WIDTH};

/// Legend entries per line.
const IN_A_LINE: usize = 4;

fn color(engine: Engine) -> &'static str {
    COLORS[match engine {
        Engine::Whitstone => 0,
        Engine::Mitsuba | Engine::MitsubaNotRobust => 1,
        Engine::NaiveF64 => 2,
        Engine::NaiveF32 => 3,
        Engine::Embree | Engine::EmbreeNotRobust => 4,
        Engine::Obvhs => 5,
        Engine::NaiveDoubleDouble => 6,
    }]
}

/// Engines without their robust flag have the colour of those with it.
fn is_dashed(engine: Engine) -> bool {
    matches!(engine, Engine::MitsubaNotRobust | Engine::EmbreeNotRobust)
}

/// The plot as an SVG file.
pub fn svg(report: &FamilyReport) -> String {
    let engines: Vec<&EngineReport> = report
        .engines
        .iter()
        .filter(|engine| !engine.steps.is_empty())
        .collect();
    let steps = || engines.iter().flat_map(|engine| &engine.steps);
    let bottom = TOP + HEIGHT;
    let mut parameters = Axis::around_all(report.parameters.iter().copied(), LEFT, LEFT + WIDTH);
    // The hard end is on the right, even if the parameter decreases.
    if report.parameters.first() > report.parameters.last() {
        parameters = parameters.reversed();
    }
    let levels = std::iter::once(report.usable_level).filter(|level| *level > 0.0);
    let errors = Axis::around(steps().map(|step| step.error).chain(levels), bottom, TOP);
    let times = Axis::around(steps().filter_map(|step| step.ns_per_op), SECOND, SECOND + WIDTH);
    let mut figure = Figure::new(
        &format!("{}: error against the parameter and against time", report.family),
        &format!("{}: {}", report.family, report.measure),
        engines.len().div_ceil(IN_A_LINE),
    );
    figure.panel(LEFT, &parameters, &errors, &report.parameter);
    if steps().any(|step| step.ns_per_op.is_some()) {
        figure.panel(SECOND, &times, &errors, "nanoseconds per operation");
    }
    if report.usable_level > 0.0 {
        figure.level(LEFT, errors.at(report.usable_level), "usable below");
    }
    for (number, engine) in engines.iter().enumerate() {
        let ink = color(engine.engine);
        let at = |step: &crate::Step| [parameters.at(step.parameter), errors.at(step.error)];
        figure.polyline(ink, is_dashed(engine.engine), engine.steps.iter().map(at));
        for step in &engine.steps {
            let label = format!(
                "{} at {:.0e}: error {:.1e}, wrong {}",
                engine.engine.name(),
                step.parameter,
                step.error,
                step.failures
            );
            // Filled if usable, otherwise open: also if the class is wrong, where the error is
            // meaningless.
            figure.dot(at(step), ink, step.usable, &label);
            if let Some(ns) = step.ns_per_op {
                let label = format!("{label}, {ns:.0} ns");
                figure.dot([times.at(ns), at(step)[1]], ink, step.usable, &label);
            }
        }
        if let Some(frontier) = engine.frontier {
            figure.upright(parameters.at(frontier), ink);
        }
        let name = format!(
            "{} (frontier {})",
            engine.engine.name(),
            report.frontier(engine.engine)
        );
        let (column, line) = (number % IN_A_LINE, number / IN_A_LINE);
        figure.legend(LEFT + 210.0 * column as f64, line, ink, &name);
    }
    figure.finish()
}
