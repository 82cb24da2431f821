//! SVG plots with logarithmic axes, without dependencies.
//!
//! They are readable on light and dark pages: the colours follow the reader's colour scheme. Every
//! point has a `<title>`, which browsers show as a tooltip.

#![forbid(unsafe_code)]

use std::fmt::Write;

/// Width of a panel, in pixels.
pub const WIDTH: f64 = 420.0;
/// Its height.
pub const HEIGHT: f64 = 260.0;
/// Left edge of the first panel.
pub const LEFT: f64 = 56.0;
/// Top edge of all panels.
pub const TOP: f64 = 34.0;
/// Left edge of the second panel.
pub const SECOND: f64 = LEFT + WIDTH + 70.0;
/// Smaller values are drawn here, because zero has no logarithm.
const LEAST: f64 = 1e-18;
/// The colour-blind safe palette of Okabe and Ito.
pub const COLORS: [&str; 7] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8a7f00",
];

/// Maps decades to a range of pixels.
#[derive(Clone, Copy, Debug)]
pub struct Axis {
    /// Exponent at the start.
    first: f64,
    /// Exponent at the end.
    last: f64,
    from: f64,
    to: f64,
    /// Smaller values are drawn here.
    least: f64,
}

impl Axis {
    /// Whole decades around all finite values. Values below 1e-18, including zero, are drawn at
    /// 1e-18.
    pub fn around(values: impl Iterator<Item = f64>, from: f64, to: f64) -> Self {
        Self::above(LEAST, values, from, to)
    }

    /// Whole decades around all positive values, however small.
    pub fn around_all(values: impl Iterator<Item = f64>, from: f64, to: f64) -> Self {
        Self::above(f64::from_bits(1), values, from, to)
    }

    fn above(floor: f64, values: impl Iterator<Item = f64>, from: f64, to: f64) -> Self {
        let logs: Vec<f64> = values
            .filter(|value| value.is_finite())
            .map(|value| value.max(floor).log10())
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
            least: floor,
        }
    }

    /// The axis in the opposite direction.
    #[must_use]
    pub fn reversed(self) -> Self {
        Self {
            from: self.to,
            to: self.from,
            ..self
        }
    }

    /// The pixel position of a value.
    pub fn at(&self, value: f64) -> f64 {
        self.at_power(value.max(self.least).log10())
    }

    /// The pixel position of ten to the given power, which may be fractional.
    fn at_power(&self, power: f64) -> f64 {
        let part = (power - self.first) / (self.last - self.first);
        self.from + part.clamp(0.0, 1.0) * (self.to - self.from)
    }

    /// At most about eight labelled decades.
    fn ticks(&self) -> impl Iterator<Item = i32> {
        let (first, last) = (self.first as i32, self.last as i32);
        (first..=last).step_by(((last - first) as usize).div_ceil(8).max(1))
    }
}

/// Escapes the characters that are special in XML.
pub fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            // Separates the description of a point from its command.
            '\n' => safe.push(c),
            c if c.is_control() => safe.push(' '),
            c => safe.push(c),
        }
    }
    safe
}

/// A figure under construction: two panels side by side, and lines of text below.
#[derive(Debug)]
pub struct Figure {
    text: String,
}

impl Figure {
    /// Starts a figure. `title` is the accessible title, `heading` the text at the top, and `below`
    /// the number of text lines under the panels.
    pub fn new(title: &str, heading: &str, below: usize) -> Self {
        let (wide, high) = (
            SECOND + WIDTH + 16.0,
            TOP + HEIGHT + 44.0 + 18.0 * below.max(1) as f64,
        );
        Self {
            text: format!(
                "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {wide} {high}\" font-family=\"sans-serif\" font-size=\"11\">\n\
                 <title>{}</title>\n\
                 <style>text {{ fill: #222 }} .ink {{ stroke: #888; fill: none }} .grid {{ stroke: #ddd }}\n\
                 @media (prefers-color-scheme: dark) {{ text {{ fill: #ddd }} .grid {{ stroke: #444 }} }}</style>\n\
                 <text x=\"{LEFT}\" y=\"16\" font-weight=\"bold\">{}</text>\n",
                escaped(title),
                escaped(heading)
            ),
        }
    }

    /// A frame with labelled decades and grid lines.
    pub fn panel(&mut self, left: f64, across: &Axis, up: &Axis, name: &str) {
        let bottom = TOP + HEIGHT;
        for decade in up.ticks() {
            let y = up.at_power(f64::from(decade));
            self.line(&format!(
                "<path class=\"grid\" d=\"M {left} {y:.1} h {WIDTH}\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">1e{decade}</text>",
                left - 5.0,
                y + 4.0
            ));
        }
        for decade in across.ticks() {
            let x = across.at_power(f64::from(decade));
            self.line(&format!(
                "<path class=\"grid\" d=\"M {x:.1} {TOP} V {bottom}\"/><text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">1e{decade}</text>",
                bottom + 16.0
            ));
        }
        self.line(&format!(
            "<rect class=\"ink\" x=\"{left}\" y=\"{TOP}\" width=\"{WIDTH}\" height=\"{HEIGHT}\"/>"
        ));
        self.line(&format!(
            "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            left + 0.5 * WIDTH,
            bottom + 34.0,
            escaped(name)
        ));
    }

    /// A dashed horizontal line across a panel, with a label.
    pub fn level(&mut self, left: f64, y: f64, name: &str) {
        self.line(&format!(
            "<path class=\"ink\" stroke-dasharray=\"5 4\" d=\"M {left} {y:.1} h {WIDTH}\"/><text x=\"{}\" y=\"{:.1}\">{}</text>",
            left + 4.0,
            y - 4.0,
            escaped(name)
        ));
    }

    /// A dashed vertical line from the top of the panels to the bottom.
    pub fn upright(&mut self, x: f64, ink: &str) {
        let bottom = TOP + HEIGHT;
        self.line(&format!(
            "<path stroke=\"{ink}\" stroke-dasharray=\"2 3\" d=\"M {x:.1} {TOP} V {bottom}\"/>"
        ));
    }

    /// Line segments through the points.
    pub fn polyline(&mut self, ink: &str, dashed: bool, points: impl Iterator<Item = [f64; 2]>) {
        let points: Vec<String> = points.map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let dashes = if dashed { " stroke-dasharray=\"6 3\"" } else { "" };
        self.line(&format!(
            "<polyline fill=\"none\" stroke=\"{ink}\" stroke-width=\"1.6\"{dashes} points=\"{}\"/>",
            points.join(" ")
        ));
    }

    /// A point with a tooltip. An open point (`full` = false) is unusable, or no claim is made
    /// about it.
    pub fn dot(&mut self, [x, y]: [f64; 2], ink: &str, full: bool, label: &str) {
        let fill = if full { ink } else { "none" };
        self.line(&format!(
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.2\" fill=\"{fill}\" stroke=\"{ink}\" pointer-events=\"all\"><title>{}</title></circle>",
            escaped(label)
        ));
    }

    /// A horizontal bar: the spread of a point.
    pub fn bar(&mut self, from: f64, to: f64, y: f64, ink: &str) {
        self.line(&format!(
            "<path stroke=\"{ink}\" stroke-opacity=\"0.6\" d=\"M {from:.1} {y:.1} H {to:.1}\"/>"
        ));
    }

    /// An entry of the legend, at a column and line below the panels.
    pub fn legend(&mut self, column: f64, line: usize, ink: &str, name: &str) {
        let y = TOP + HEIGHT + 50.0 + 18.0 * line as f64;
        self.line(&format!(
            "<circle cx=\"{}\" cy=\"{y}\" r=\"4\" fill=\"{ink}\"/><text x=\"{}\" y=\"{}\">{}</text>",
            column + 6.0,
            column + 16.0,
            y + 4.0,
            escaped(name)
        ));
    }

    fn line(&mut self, text: &str) {
        let _ = writeln!(self.text, "{text}");
    }

    /// The complete SVG text.
    pub fn finish(self) -> String {
        self.text + "</svg>\n"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decades_are_where_they_should_be() {
        let axis = Axis::around([0.02, 30.0, f64::NAN].into_iter(), 0.0, 400.0);
        assert_eq!(
            [0.01, 1.0, 100.0, 1e9, 0.0].map(|x| axis.at(x)),
            [0.0, 200.0, 400.0, 400.0, 0.0]
        );
        assert_eq!(axis.ticks().collect::<Vec<_>>(), [-2, -1, 0, 1, 2]);
        assert_eq!(axis.reversed().at(0.01), 400.0);
        // Down to the smallest positive double.
        let axis = Axis::around_all([1e-300, 5e-324].into_iter(), 0.0, 24.0);
        assert_eq!(
            [1e-300, 1e-312, 5e-324].map(|x| axis.at(x).round()),
            [24.0, 12.0, 1.0]
        );
        // An empty plot is no error.
        assert_eq!(Axis::around(std::iter::empty(), 0.0, 1.0).at(1.0), 0.0);
    }

    #[test]
    fn texts_cannot_end_their_element() {
        let mut figure = Figure::new("a < b", "\"c\"", 1);
        figure.dot([1.0, 2.0], "red", true, "</title><script>");
        let text = figure.finish();
        assert!(text.contains("&lt;/title&gt;&lt;script&gt;") && !text.contains("<script>"));
    }
}
