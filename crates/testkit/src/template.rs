//! The text of a table in which numbers may be ranges.

use proptest::prelude::*;

/// A TOML table in which `0.1..2` stands for any number from 0.1 to 2, and `1..8` for any integer
/// from 1 to 8.
pub(crate) struct Template {
    /// The text between the ranges: one piece more than there are ranges.
    between: Vec<String>,
    ranges: Vec<Range>,
}

/// Number of steps into which a range of real numbers is divided.
const STEPS: u32 = 10_000;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Range {
    Whole(i64, i64),
    Real(f64, f64),
}

impl Template {
    /// Text that is no range is kept unchanged.
    pub(crate) fn new(text: &str) -> Self {
        let is_number = |c: char| c.is_ascii_digit() || matches!(c, '.' | '-' | '+' | 'e' | 'E');
        let (mut between, mut ranges, mut rest) = (vec![String::new()], Vec::new(), text);
        while let Some(dots) = rest.find("..") {
            let (before, behind) = (&rest[..dots], &rest[dots + 2..]);
            let low = &before[before.trim_end_matches(is_number).len()..];
            let high = &behind[..behind.len() - behind.trim_start_matches(is_number).len()];
            let last = between.len() - 1;
            if let Some(range) = Range::new(low, high) {
                between[last] += &before[..before.len() - low.len()];
                between.push(String::new());
                ranges.push(range);
                rest = &behind[high.len()..];
            } else {
                between[last] += &rest[..dots + 2];
                rest = behind;
            }
        }
        let last = between.len() - 1;
        between[last] += rest;
        Self { between, ranges }
    }

    /// Whether it stands for a single table.
    pub(crate) fn is_fixed(&self) -> bool {
        self.ranges.is_empty()
    }

    /// A strategy for the texts that it stands for; they shrink towards the lower ends.
    pub(crate) fn texts(&self) -> impl Strategy<Value = String> {
        let numbers: Vec<_> = self.ranges.iter().map(|range| range.numbers()).collect();
        let between = self.between.clone();
        numbers.prop_map(move |numbers| {
            let gaps = numbers.iter().map(String::as_str).chain([""]);
            between
                .iter()
                .zip(gaps)
                .flat_map(|(text, number)| [text.as_str(), number])
                .collect()
        })
    }
}

impl Range {
    fn new(low: &str, high: &str) -> Option<Self> {
        if let (Ok(low), Ok(high)) = (low.parse(), high.parse()) {
            return (low <= high).then_some(Self::Whole(low, high));
        }
        let (low, high) = (low.parse().ok()?, high.parse().ok()?);
        (low <= high).then_some(Self::Real(low, high))
    }

    /// A strategy for numbers in TOML syntax. The ends are tried often, since errors are likely
    /// there.
    fn numbers(self) -> BoxedStrategy<String> {
        match self {
            Self::Whole(low, high) => (low..=high).prop_map(|number| number.to_string()).boxed(),
            // In integer steps, which shrink well; floating-point numbers do not.
            Self::Real(low, high) => prop_oneof![1 => Just(0), 6 => 0..=STEPS, 1 => Just(STEPS)]
                .prop_map(move |step| {
                    let share = f64::from(step) / f64::from(STEPS);
                    format!(
                        "{:?}",
                        if step == STEPS {
                            high
                        } else {
                            low + (high - low) * share
                        }
                    )
                })
                .boxed(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::strategy::ValueTree;
    use proptest::test_runner::TestRunner;

    #[test]
    fn ranges_differ_from_other_dots() {
        let template = Template::new("file = \"../a..b\"\nx = [0.5..2, 1..3]\ny = -1e-3..1.0 # ... 2..1");
        assert_eq!(
            template.ranges,
            [Range::Real(0.5, 2.0), Range::Whole(1, 3), Range::Real(-1e-3, 1.0)]
        );
        assert_eq!(
            template.between,
            ["file = \"../a..b\"\nx = [", ", ", "]\ny = ", " # ... 2..1"]
        );
        assert!(Template::new("a = 0.25").is_fixed() && !template.is_fixed());
    }

    #[test]
    fn numbers_lie_in_their_range_and_shrink_to_its_lower_end() {
        let mut runner = TestRunner::deterministic();
        let template = Template::new("x = 0.5..2\nn = 1..3");
        for _ in 0..50 {
            let mut tree = template
                .texts()
                .new_tree(&mut runner)
                .expect("ranges are not empty");
            let read = |text: String| text.parse::<toml::Table>().expect("the text is TOML");
            let table = read(tree.current());
            let (x, n) = (table["x"].as_float().unwrap(), table["n"].as_integer().unwrap());
            assert!((0.5..=2.0).contains(&x) && (1..=3).contains(&n), "{table}");
            while tree.simplify() {}
            assert_eq!(read(tree.current())["n"].as_integer(), Some(1));
        }
    }
}
