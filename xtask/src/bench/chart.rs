//! The results of accelerators as a table and as a bar chart.

use serde_json::Value;
use std::fmt::Write;

/// The rows of one accelerator in one mode, cell by cell.
struct Line {
    label: String,
    cells: Vec<(String, f64)>,
    build: f64,
    bytes: f64,
}

impl Line {
    /// Geometric mean.
    fn mean(&self) -> f64 {
        let sum: f64 = self.cells.iter().map(|cell| cell.1.ln()).sum();
        (sum / self.cells.len().max(1) as f64).exp()
    }
}

/// Ratios to Embree, or millions of rays per second without Embree, and which of the two they are.
fn lines(rows: &[Value]) -> (Vec<Line>, &'static str) {
    let with_embree = rows.iter().all(|row| row["ratio_to_embree"].is_number());
    let (key, what) = match with_embree {
        true => (
            "ratio_to_embree",
            "rays per second relative to Embree (HIGH, single rays)",
        ),
        false => ("mrays_per_s", "million rays per second"),
    };
    let mut lines: Vec<Line> = Vec::new();
    for row in rows {
        let text = |key: &str| row[key].as_str().unwrap_or_default().to_owned();
        let label = [text("accelerator"), text("quality"), text("mode")]
            .join(" ")
            .replace("  ", " ");
        let cell = (
            format!("{} {}", text("mesh"), text("set")),
            row[key].as_f64().unwrap_or(f64::NAN),
        );
        let number = |key: &str| row[key].as_f64().unwrap_or(f64::NAN);
        match lines.iter_mut().find(|line| line.label == label) {
            Some(line) => line.cells.push(cell),
            None => lines.push(Line {
                label,
                cells: vec![cell],
                build: number("build_s"),
                bytes: number("bytes_per_triangle"),
            }),
        }
    }
    (lines, what)
}

/// A line for each accelerator and mode, a column for each cell. Build time and bytes are those of
/// the first mesh.
pub(super) fn table(rows: &[Value]) -> String {
    let (lines, what) = lines(rows);
    let mut text =
        format!("\n{what}; build in seconds and bytes per triangle of the first mesh\n\n| accelerator |");
    let Some(first) = lines.first() else {
        return String::new();
    };
    for (name, _) in &first.cells {
        let _ = write!(text, " {name} |");
    }
    text += " mean | build | bytes |\n|---|";
    text += &"---|".repeat(first.cells.len() + 3);
    for line in &lines {
        let _ = write!(text, "\n| {} |", line.label);
        for (_, value) in &line.cells {
            let _ = write!(text, " {value:.2} |");
        }
        let _ = write!(
            text,
            " {:.3} | {:.3} | {:.1} |",
            line.mean(),
            line.build,
            line.bytes
        );
    }
    text + "\n"
}

/// A bar for each accelerator and mode, with the mean as its length and a tick for each cell.
pub(super) fn bars(rows: &[Value]) -> String {
    const LEFT: f64 = 190.0;
    const WIDE: f64 = 560.0;
    const HIGH: f64 = 22.0;
    let (lines, what) = lines(rows);
    let all = lines.iter().flat_map(|line| &line.cells);
    let most = all
        .map(|cell| cell.1)
        .filter(|value| value.is_finite())
        .fold(1e-9, f64::max);
    let x = |value: f64| LEFT + WIDE * (value / most).clamp(0.0, 1.0);
    let height = 50.0 + HIGH * lines.len() as f64;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {height}\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n\
         <text x=\"8\" y=\"20\">{what}: geometric mean, and each of the cells</text>\n",
        LEFT + WIDE + 70.0
    );
    for (i, line) in lines.iter().enumerate() {
        let y = 34.0 + HIGH * i as f64;
        let (mean, middle) = (line.mean(), y + 12.0);
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{middle}\" text-anchor=\"end\">{}</text>\
             <rect x=\"{LEFT}\" y=\"{y}\" width=\"{:.1}\" height=\"16\" fill=\"#7aa6c2\"/>\
             <text x=\"{}\" y=\"{middle}\">{mean:.2}</text>",
            LEFT - 6.0,
            escaped(&line.label),
            x(mean) - LEFT,
            LEFT + WIDE + 8.0,
        );
        for (name, value) in line.cells.iter().filter(|cell| cell.1.is_finite()) {
            let _ = writeln!(
                svg,
                "<rect x=\"{:.1}\" y=\"{y}\" width=\"2\" height=\"16\" fill=\"#1d3b53\"><title>{}: {value:.2}</title></rect>",
                x(*value) - 1.0,
                escaped(name),
            );
        }
    }
    svg + "</svg>\n"
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn means_are_of_all_cells() {
        let row = |set: &str, ratio: Value| {
            json!({
                "accelerator": "a<b", "quality": "", "mode": "single", "mesh": "m", "set": set,
                "ratio_to_embree": ratio, "mrays_per_s": 3.0, "build_s": 0.5, "bytes_per_triangle": 40.0,
            })
        };
        let rows = [row("primary", json!(0.5)), row("bounce", json!(2.0))];
        let text = table(&rows);
        assert!(
            text.contains("| a<b single | 0.50 | 2.00 | 1.000 | 0.500 | 40.0 |"),
            "{text}"
        );
        let svg = bars(&rows);
        assert!(
            svg.contains("a&lt;b single") && svg.contains("m bounce: 2.00"),
            "{svg}"
        );
        // Without Embree the values are rates.
        assert!(table(&[row("primary", Value::Null)]).contains("million rays per second"));
        assert_eq!(table(&[]), "");
    }
}
