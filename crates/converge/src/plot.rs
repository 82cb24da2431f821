//! Plots of a study with logarithmic axes: error against time, and error against the variable of
//! the slope.

use crate::report::{ABOVE_FLOOR, Point, SeriesReport, StudyReport, interval};
use crate::study::{Against, Engine};
use whitstone_plot::{Axis, COLORS, Figure, HEIGHT, LEFT, SECOND, TOP, WIDTH};

/// The plot as an SVG file.
pub fn svg(report: &StudyReport) -> String {
    let series: Vec<&SeriesReport> = report
        .series
        .iter()
        .filter(|series| !series.points.is_empty())
        .collect();
    let points = || series.iter().flat_map(|series| &series.points);
    let least = ABOVE_FLOOR * report.floor_rmse;
    let bottom = TOP + HEIGHT;
    // A zero error would stretch the axis over empty decades.
    let errors = points().filter_map(|point| point.rmse).filter(|rmse| *rmse > 0.0);
    let errors = Axis::around(errors.chain([least]), bottom, TOP);
    let times = Axis::around(points().filter_map(|point| point.seconds), LEFT, LEFT + WIDTH);
    let works = points().filter_map(|point| work(point, report.against));
    let works = Axis::around(works, SECOND, SECOND + WIDTH);
    let mut figure = Figure::new(
        &format!(
            "{}: error against time and against {}",
            report.study, &report.parameter
        ),
        &format!("{}: {}", report.title, report.measure),
        series.len().div_ceil(2),
    );
    figure.panel(LEFT, &times, &errors, "seconds");
    figure.panel(SECOND, &works, &errors, &report.parameter);
    for left in [LEFT, SECOND] {
        figure.level(
            left,
            errors.at(least),
            "no claim below: twice the truth's own error",
        );
    }
    // One colour per configuration; Mitsuba's lines are dashed.
    let mut names: Vec<&str> = Vec::new();
    for series in &series {
        if !names.contains(&name(series)) {
            names.push(name(series));
        }
    }
    for (number, &series) in series.iter().enumerate() {
        let color = names.iter().position(|known| *known == name(series)).unwrap_or(0);
        let ink = COLORS[color % COLORS.len()];
        let dashed = matches!(series.engine, Engine::Mitsuba | Engine::StockMitsuba);
        let timed = |point: &Point| Some([times.at(point.seconds?), errors.at(point.rmse?)]);
        let worked = |point: &Point| Some([works.at(work(point, report.against)?), errors.at(point.rmse?)]);
        figure.polyline(ink, dashed, series.points.iter().filter_map(timed));
        figure.polyline(ink, dashed, series.points.iter().filter_map(worked));
        for point in &series.points {
            let label = label(series, point);
            if let (Some([from, to]), Some(rmse)) = (point.interval, point.rmse) {
                figure.bar(times.at(from), times.at(to), errors.at(rmse), ink);
            }
            for place in [timed(point), worked(point)].into_iter().flatten() {
                figure.dot(place, ink, point.above_floor, &label);
            }
        }
        let column = LEFT + 450.0 * (number % 2) as f64;
        let entry = format!(
            "{}, {}{}: slope {}",
            series.configuration,
            series.engine.name(),
            if dashed { " (dashed)" } else { "" },
            interval(series)
        );
        figure.legend(column, number / 2, ink, &entry);
    }
    figure.finish()
}

/// What has a colour of its own: a configuration, or the code of others.
fn name(series: &SeriesReport) -> &str {
    match series.engine {
        Engine::Whitstone | Engine::Mitsuba | Engine::StockMitsuba | Engine::Command => &series.configuration,
        engine => engine.name(),
    }
}

fn work(point: &Point, against: Against) -> Option<f64> {
    let x = match against {
        Against::Samples => f64::from(point.samples?),
        Against::Rays => point.rays? as f64,
        Against::Primitives => point.primitives? as f64,
        Against::Value => point.value?,
    };
    (x > 0.0).then_some(x)
}

/// The tooltip of a point, with the command that reproduces it.
fn label(series: &SeriesReport, point: &Point) -> String {
    let number = |value: Option<f64>| value.map_or_else(|| "?".to_owned(), |value| format!("{value:.2e}"));
    format!(
        "{}, {}, {}: RMSE {}, {} s{}\n{}",
        series.engine.name(),
        series.configuration,
        point.setting,
        number(point.rmse),
        number(point.seconds),
        if point.noisy { ", noisy" } else { "" },
        point.command
    )
}
