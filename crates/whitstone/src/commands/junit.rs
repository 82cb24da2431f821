//! Results as JUnit XML, which most CI systems display: one suite with a case for each comparison.

use crate::terminal::Failure;
use quick_junit::{NonSuccessKind, Report, SerializeError, TestCase, TestCaseStatus, TestSuite};
use std::path::Path;
use std::time::Duration;
use whitstone_image::atomic;

/// A comparison.
pub(super) struct Case {
    /// The name of the comparison.
    pub(super) name: String,
    /// The duration of the comparison in seconds.
    pub(super) seconds: f64,
    /// The outcome of the comparison.
    pub(super) outcome: Outcome,
}

/// The outcome of a comparison.
pub(super) enum Outcome {
    /// The images agree.
    Pass,
    /// The images differ, with the reason.
    Fails(String),
    /// Nothing could be compared, with the reason.
    Error(String),
    /// The comparison was skipped, with the reason.
    Skipped(String),
}

impl Outcome {
    fn status(&self) -> TestCaseStatus {
        let (mut status, text) = match self {
            Self::Pass => return TestCaseStatus::success(),
            Self::Fails(text) => (TestCaseStatus::non_success(NonSuccessKind::Failure), text),
            Self::Error(text) => (TestCaseStatus::non_success(NonSuccessKind::Error), text),
            Self::Skipped(text) => (TestCaseStatus::skipped(), text),
        };
        let text = allowed(text);
        status.set_message(text.lines().next().unwrap_or_default());
        status.set_description(&text);
        status
    }
}

/// Writes a suite to a file, atomically.
pub(super) fn write(path: &Path, suite: &str, cases: &[Case]) -> Result<(), Failure> {
    let text = xml(suite, cases).map_err(Failure::environment)?;
    atomic::write_bytes(path, text.as_bytes()).map_err(Failure::environment)
}

fn xml(name: &str, cases: &[Case]) -> Result<String, SerializeError> {
    let mut suite = TestSuite::new(name);
    for case in cases {
        let mut test = TestCase::new(allowed(&case.name), case.outcome.status());
        test.set_classname(name).set_time(duration(case.seconds));
        suite.add_test_case(test);
    }
    let total = duration(cases.iter().map(|case| case.seconds).sum());
    suite.set_time(total);
    let mut report = Report::new(name);
    report.set_time(total).add_test_suite(suite);
    report.to_string()
}

/// Zero for a number that is no duration.
fn duration(seconds: f64) -> Duration {
    Duration::try_from_secs_f64(seconds).unwrap_or_default()
}

/// A text without the characters that XML 1.0 cannot represent (section 2.2). `quick_junit` would
/// drop some of them, with everything up to the end of an escape sequence, but not U+FFFE and
/// U+FFFF. It also drops tabs.
fn allowed(text: &str) -> String {
    let replaced = |c: char| match c {
        '\t' => ' ',
        '\n' | '\r' | ' '..='\u{fffd}' | '\u{10000}'.. => c,
        _ => '\u{fffd}',
    };
    text.chars().map(replaced).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use quick_xml::Reader;
    use quick_xml::events::Event;

    const HOSTILE: &str = "a]]></failure><x y=\"1\"> & 'quoted'\u{0}\u{1b}[31m\u{fffe}\nsecond line";

    fn cases() -> Vec<Case> {
        let case = |outcome| Case {
            name: HOSTILE.to_owned(),
            seconds: 0.25,
            outcome,
        };
        let text = || HOSTILE.to_owned();
        vec![
            case(Outcome::Pass),
            case(Outcome::Fails(text())),
            case(Outcome::Error(text())),
            case(Outcome::Skipped(text())),
        ]
    }

    /// The names of the elements in order, their attributes, and all text; or the error if the XML
    /// is not well-formed.
    fn read(xml: &str) -> Result<(Vec<String>, Vec<String>, String), String> {
        let string = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).map_err(|error| error.to_string());
        let mut reader = Reader::from_str(xml);
        reader.config_mut().check_end_names = true;
        let (mut names, mut values, mut text, mut open) = (Vec::new(), Vec::new(), String::new(), 0);
        loop {
            let event = reader.read_event().map_err(|error| error.to_string())?;
            open += match &event {
                Event::Start(_) => 1,
                Event::End(_) => -1,
                _ => 0,
            };
            match event {
                Event::Start(element) | Event::Empty(element) => {
                    names.push(string(element.name().as_ref())?);
                    for attribute in element.attributes() {
                        let attribute = attribute.map_err(|error| error.to_string())?;
                        let value = string(&attribute.value)?;
                        if value.contains(['<', '"']) {
                            return Err(format!("attribute {value}"));
                        }
                        values.push(value);
                    }
                }
                Event::Text(part) => text.push_str(&string(&part)?),
                Event::Eof => break,
                _ => {}
            }
        }
        if open == 0 {
            Ok((names, values, text))
        } else {
            Err(format!("{open} elements are open"))
        }
    }

    #[test]
    fn a_suite_is_well_formed_whatever_it_says() {
        let xml = xml("a suite", &cases()).unwrap();
        let (names, values, text) = read(&xml).unwrap();
        assert_eq!(
            names,
            [
                "testsuites",
                "testsuite",
                "testcase",
                "testcase",
                "failure",
                "testcase",
                "error",
                "testcase",
                "skipped"
            ]
        );
        let counts = ["a suite", "4", "1", "1", "1", "1.000"];
        assert_eq!(
            (&values[..6], &values[6..12]),
            (&counts.map(String::from)[..], &counts.map(String::from)[..])
        );
        assert_eq!(values.iter().filter(|value| *value == "0.250").count(), 4);
        assert!(
            values
                .iter()
                .any(|value| value.contains("&lt;x y=&quot;1&quot;&gt; &amp;"))
        );
        assert!(xml.contains("second line") && text.contains("second line"));
        assert!(!xml.contains(['\u{0}', '\u{1b}', '\u{fffe}']) && xml.contains('\u{fffd}'));
        assert!(!xml.contains("]]>"), "not allowed in text");
    }

    #[test]
    fn no_text_is_lost_and_no_duration_panics() {
        let case = |seconds| Case {
            name: "a\tb \u{1b}]0;an unfinished escape sequence".to_owned(),
            seconds,
            outcome: Outcome::Pass,
        };
        let xml = xml("a", &[case(f64::NAN), case(-1.0)]).unwrap();
        let (_, values, _) = read(&xml).unwrap();
        let name = "a b \u{fffd}]0;an unfinished escape sequence";
        assert_eq!(
            values.iter().filter(|value| *value == name).count(),
            2,
            "{values:?}"
        );
        assert_eq!(values.iter().filter(|value| *value == "0.000").count(), 4);
    }

    #[test]
    fn the_check_sees_what_is_not_well_formed() {
        let xml = xml("a", &cases()).unwrap();
        for (from, to) in [("</testsuite>", ""), ("&lt;x", "<x"), ("</error>", "</failure>")] {
            assert!(read(&xml.replacen(from, to, 1)).is_err(), "{from}");
        }
    }
}
