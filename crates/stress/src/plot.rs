//! Pictures of a family: error against the knob, with the frontiers, and error against time, both with logarithmic axes.
//!
//! Readable on light and dark pages: ink and paper follow the reader's colour scheme.

use crate::{Engine, EngineReport, FamilyReport};
use std::fmt::Write;

const WIDTH: f64 = 420.0;
const HEIGHT: f64 = 260.0;
const LEFT: f64 = 56.0;
const TOP: f64 = 34.0;
const GAP: f64 = 70.0;
/// What is below is drawn here: zero has no logarithm.
const LEAST: f64 = 1e-18;

/// Okabe and Ito's colours, told apart by everyone.
fn color(engine: Engine) -> &'static str {
    match engine {
        Engine::Whitstone => "#0072b2",
        Engine::Mitsuba => "#d55e00",
        Engine::NaiveF64 => "#009e73",
        Engine::NaiveF32 => "#cc79a7",
    }
}

/// Of decades, onto a stretch of pixels.
struct Axis {
    first: f64,
    last: f64,
    from: f64,
    to: f64,
}

impl Axis {
    fn around(values: impl Iterator<Item = f64>, from: f64, to: f64) -> Self {
        let logs: Vec<f64> = values
            .filter(|value| value.is_finite())
            .map(|value| value.max(LEAST).log10())
            .collect();
        let least = logs.iter().copied().fold(f64::INFINITY, f64::min).floor();
        let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max).ceil();
        let (first, last) = if least.is_finite() {
            (least, most.max(least + 1.0))
        } else {
            (0.0, 1.0)
        };
        Self {
            first,
            last,
            from,
            to,
        }
    }

    fn at(&self, value: f64) -> f64 {
        let part = (value.max(LEAST).log10() - self.first) / (self.last - self.first);
        self.from + part.clamp(0.0, 1.0) * (self.to - self.from)
    }

    /// At most eight decades with a label.
    fn ticks(&self) -> impl Iterator<Item = i32> {
        let (first, last) = (self.first as i32, self.last as i32);
        (first..=last).step_by(((last - first) as usize).div_ceil(8).max(1))
    }
}

/// As an SVG file.
pub fn svg(report: &FamilyReport) -> String {
    let engines: Vec<&EngineReport> = report
        .engines
        .iter()
        .filter(|engine| !engine.steps.is_empty())
        .collect();
    let steps = || engines.iter().flat_map(|engine| &engine.steps);
    let bottom = TOP + HEIGHT;
    // The stiff end is on the right, also where the knob goes down.
    let reversed = report.knobs.first() > report.knobs.last();
    let mut knobs = Axis::around(report.knobs.iter().copied(), LEFT, LEFT + WIDTH);
    if reversed {
        std::mem::swap(&mut knobs.from, &mut knobs.to);
    }
    let levels = std::iter::once(report.usable_level).filter(|level| *level > 0.0);
    let errors = Axis::around(steps().map(|step| step.error).chain(levels), bottom, TOP);
    let second = LEFT + WIDTH + GAP;
    let times = Axis::around(steps().filter_map(|step| step.ns_per_op), second, second + WIDTH);
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" font-family=\"sans-serif\" font-size=\"11\">\n\
         <title>{}: error against the knob and against time</title>\n\
         <style>text {{ fill: #222 }} .ink {{ stroke: #888; fill: none }} .grid {{ stroke: #ddd }}\n\
         @media (prefers-color-scheme: dark) {{ text {{ fill: #ddd }} .grid {{ stroke: #444 }} }}</style>\n",
        second + WIDTH + 16.0,
        bottom + 62.0,
        report.family,
    );
    let middle = LEFT + 0.5 * WIDTH;
    let _ = writeln!(
        text,
        "<text x=\"{LEFT}\" y=\"16\" font-weight=\"bold\">{}: {}</text>",
        report.family, report.measure
    );
    panel(&mut text, LEFT, &knobs, &errors);
    let _ = writeln!(
        text,
        "<text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
        bottom + 34.0,
        report.knob
    );
    let timed = steps().any(|step| step.ns_per_op.is_some());
    if timed {
        panel(&mut text, second, &times, &errors);
        let _ = writeln!(
            text,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">nanoseconds for each operation</text>",
            second + 0.5 * WIDTH,
            bottom + 34.0
        );
    }
    if report.usable_level > 0.0 {
        let y = errors.at(report.usable_level);
        let _ = writeln!(
            text,
            "<path class=\"ink\" stroke-dasharray=\"5 4\" d=\"M {LEFT} {y} h {WIDTH}\"/><text x=\"{}\" y=\"{}\">of use below</text>",
            LEFT + 4.0,
            y - 4.0
        );
    }
    for (number, engine) in engines.iter().enumerate() {
        let ink = color(engine.engine);
        let points: Vec<String> = engine
            .steps
            .iter()
            .map(|step| format!("{:.1},{:.1}", knobs.at(step.knob), errors.at(step.error)))
            .collect();
        let _ = writeln!(
            text,
            "<polyline fill=\"none\" stroke=\"{ink}\" stroke-width=\"1.6\" points=\"{}\"/>",
            points.join(" ")
        );
        for step in &engine.steps {
            let (x, y) = (knobs.at(step.knob), errors.at(step.error));
            // Filled where it is of use, open where it is not: also where the class is wrong and the error says nothing.
            let fill = if step.usable { ink } else { "none" };
            let label = format!(
                "{} at {:.0e}: error {:.1e}, wrong {}",
                engine.engine.name(),
                step.knob,
                step.error,
                step.failures
            );
            let dot = |x: f64, label: &str| {
                format!(
                    "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.2\" fill=\"{fill}\" stroke=\"{ink}\"><title>{label}</title></circle>\n"
                )
            };
            text.push_str(&dot(x, &label));
            if let Some(ns) = step.ns_per_op {
                text.push_str(&dot(times.at(ns), &format!("{label}, {ns:.0} ns")));
            }
        }
        if let Some(frontier) = engine.frontier {
            let x = knobs.at(frontier);
            let _ = writeln!(
                text,
                "<path stroke=\"{ink}\" stroke-dasharray=\"2 3\" d=\"M {x:.1} {TOP} V {bottom}\"/>"
            );
        }
        let _ = writeln!(
            text,
            "<circle cx=\"{x}\" cy=\"{y}\" r=\"4\" fill=\"{ink}\"/><text x=\"{tx}\" y=\"{ty}\">{} (frontier {})</text>",
            engine.engine.name(),
            report.frontier(engine.engine),
            x = LEFT + 6.0 + 210.0 * number as f64,
            y = bottom + 50.0,
            tx = LEFT + 16.0 + 210.0 * number as f64,
            ty = bottom + 54.0,
        );
    }
    text.push_str("</svg>\n");
    text
}

/// A frame with its decades.
fn panel(text: &mut String, left: f64, across: &Axis, up: &Axis) {
    let bottom = TOP + HEIGHT;
    for decade in up.ticks() {
        let y = up.at(10f64.powi(decade));
        let _ = writeln!(
            text,
            "<path class=\"grid\" d=\"M {left} {y:.1} h {WIDTH}\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">1e{decade}</text>",
            left - 5.0,
            y + 4.0
        );
    }
    for decade in across.ticks() {
        let x = across.at(10f64.powi(decade));
        let _ = writeln!(
            text,
            "<path class=\"grid\" d=\"M {x:.1} {TOP} V {bottom}\"/><text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">1e{decade}</text>",
            bottom + 16.0
        );
    }
    let _ = writeln!(
        text,
        "<rect class=\"ink\" x=\"{left}\" y=\"{TOP}\" width=\"{WIDTH}\" height=\"{HEIGHT}\"/>"
    );
}
