//! Tables of studies: CSV for programs, Markdown for pages.

use crate::report::{StudyReport, TimeTo, interval, optional};
use crate::usage;
use std::fmt::Write;

/// One line per point.
pub fn csv(reports: &[StudyReport]) -> String {
    let mut text = String::from(
        "study,engine,configuration,setting,seconds,spread,repeats,cpu_seconds,build_seconds,memory_bytes,rays,samples,primitives,rmse,relmse,max,rmse_interior,finite,above_floor,pareto,noisy,problem\n",
    );
    for report in reports {
        for series in &report.series {
            for point in &series.points {
                let real = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:e}"));
                let whole = |value: Option<u64>| value.map_or_else(String::new, |value| value.to_string());
                let cells = [
                    quoted(&report.study),
                    series.engine.name().to_owned(),
                    quoted(&series.configuration),
                    quoted(&point.setting),
                    real(point.seconds),
                    real(point.spread),
                    point.repeats.to_string(),
                    real(point.cpu_seconds),
                    real(point.build_seconds),
                    whole(point.memory_bytes),
                    whole(point.rays),
                    whole(point.samples.map(u64::from)),
                    whole(point.primitives),
                    real(point.rmse),
                    real(point.relmse),
                    real(point.max),
                    real(point.errors.map(|errors| errors.interior.rmse)),
                    real(point.errors.map(|errors| errors.finite)),
                    point.above_floor.to_string(),
                    point.pareto.to_string(),
                    point.noisy.to_string(),
                    quoted(point.problem.as_deref().unwrap_or_default()),
                ];
                text += &cells.join(",");
                text.push('\n');
            }
        }
    }
    text
}

/// A quoted CSV cell.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

/// A paragraph in lines of at most 100 characters.
fn wrapped(text: &str) -> String {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= 100 => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines.join("\n")
}

/// All studies with their curves, as Markdown. `plots` is the folder of the plots, relative to the
/// page.
pub fn table(reports: &[StudyReport], plots: &str) -> String {
    let mut text = String::new();
    for report in reports {
        let scene = if report.scene.is_empty() {
            String::new()
        } else {
            format!(", [scene](../{})", report.scene)
        };
        let study = &report.study;
        let about = format!("{} [Study](../studies/{study}.toml){scene}.", report.about);
        let _ = writeln!(text, "### {}\n\n{}\n", report.title, wrapped(&about));
        let _ = writeln!(
            text,
            "| configuration | engine | settings | {}, first to last | slope against {} (95%) |\n|---|---|---|---|---|",
            report.measure, report.parameter
        );
        for series in &report.series {
            if let Some(why) = &series.absent {
                let _ = writeln!(
                    text,
                    "| {} | {} | – | – | takes no part: {why} |",
                    series.configuration,
                    series.engine.name()
                );
                continue;
            }
            let rmse = |point: Option<&crate::Point>| optional(point.and_then(|point| point.rmse));
            let _ = writeln!(
                text,
                "| {} | {} | {} | {} to {} | {} |",
                series.configuration,
                series.engine.name(),
                series.points.len(),
                rmse(series.points.first()),
                rmse(series.points.last()),
                interval(series)
            );
        }
        let withheld: String = report.withheld.iter().map(|why| format!(" {why}.")).collect();
        let verdict = format!(
            "The truth's own error: {:.1e}.{withheld} Verdict: {}.",
            report.floor_rmse, report.verdict
        );
        let _ = writeln!(text, "\n{}", wrapped(&verdict));
        let _ = writeln!(text, "\n![{}]({plots}/{}.svg)\n", report.title, report.study);
    }
    text.trim_end().to_owned() + "\n"
}

/// Ratios to Mitsuba, for the studies that have any, and the machine they were measured on.
pub fn headline(reports: &[StudyReport]) -> String {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let load = match usage::load() {
        None => "unknown".to_owned(),
        Some(load) if load > 1.25 * cores as f64 => {
            format!("{load:.1}, so other processes used a part of the time")
        }
        Some(load) => format!("{load:.1}"),
    };
    let mut text = format!(
        "Measured on {}, {cores} cores. Load average at the end: {load}.\n\n",
        usage::processor().unwrap_or_else(|| "an unknown processor".to_owned()),
    );
    text += "| study | error (RMSE) | Whitstone, s | Mitsuba, s | ratio |\n|---|---|---|---|---|\n";
    for report in reports {
        for (level, both) in report
            .levels()
            .into_iter()
            .filter(|(_, both)| both.ratio.is_some())
        {
            let seconds = |value: Option<f64>, of: &Option<String>| {
                format!("{} ({})", optional(value), of.as_deref().unwrap_or("–"))
            };
            let _ = writeln!(
                text,
                "| {} | {level} | {} | {} | {} |",
                report.title,
                seconds(both.whitstone_s, &both.whitstone),
                seconds(both.mitsuba_s, &both.mitsuba),
                ratio(both)
            );
        }
    }
    text
}

/// Formats a ratio, or the statement that there is none.
pub(crate) fn ratio(both: &TimeTo) -> String {
    match (both.noisy, both.ratio, both.ratio_interval) {
        (true, ..) => "noisy".to_owned(),
        (false, Some(ratio), Some([least, most])) => format!("{ratio:.3} ({least:.3} to {most:.3})"),
        _ => "–".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::wrapped;

    #[test]
    fn paragraphs_have_at_most_100_columns() {
        let text = "word ".repeat(50);
        let lines = wrapped(&text);
        assert_eq!(lines.lines().count(), 3);
        assert!(lines.lines().all(|line| line.len() <= 100));
        assert_eq!(lines.replace('\n', " "), text.trim());
    }
}
