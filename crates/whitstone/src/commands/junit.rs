//! Results as JUnit XML, which most CI systems display: one suite with a case for each comparison.

use crate::terminal::Failure;
use quick_xml::Writer;
use quick_xml::events::{BytesDecl, BytesText, Event};
use std::io::{Result, Write};
use std::path::Path;
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
    /// The name of the element, its message, and whether the message is only an attribute.
    fn element(&self) -> Option<(&'static str, &str)> {
        match self {
            Self::Pass => None,
            Self::Fails(text) => Some(("failure", text)),
            Self::Error(text) => Some(("error", text)),
            Self::Skipped(text) => Some(("skipped", text)),
        }
    }
}

/// Writes a suite to a file, atomically.
pub(super) fn write(path: &Path, suite: &str, cases: &[Case]) -> std::result::Result<(), Failure> {
    let text = xml(suite, cases).map_err(Failure::environment)?;
    atomic::write_bytes(path, &text).map_err(Failure::environment)
}

fn xml(suite: &str, cases: &[Case]) -> Result<Vec<u8>> {
    let count = |name: &str| {
        let named = cases.iter().filter_map(|case| case.outcome.element());
        named.filter(|element| element.0 == name).count().to_string()
    };
    let seconds: f64 = cases.iter().map(|case| case.seconds).sum();
    let attributes = [
        ("name", suite.to_owned()),
        ("tests", cases.len().to_string()),
        ("failures", count("failure")),
        ("errors", count("error")),
        ("skipped", count("skipped")),
        ("time", format!("{seconds:.3}")),
    ];
    let attributes = || attributes.iter().map(|(key, value)| (*key, value.as_str()));
    let mut writer = Writer::new_with_indent(Vec::new(), b' ', 2);
    writer.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    writer
        .create_element("testsuites")
        .with_attributes(attributes().filter(|(key, _)| *key != "skipped"))
        .write_inner_content(|writer| {
            writer
                .create_element("testsuite")
                .with_attributes(attributes())
                .write_inner_content(|writer| cases.iter().try_for_each(|one| case(writer, suite, one)))?;
            Ok(())
        })?;
    let mut text = writer.into_inner();
    text.push(b'\n');
    Ok(text)
}

fn case<W: Write>(writer: &mut Writer<W>, suite: &str, case: &Case) -> Result<()> {
    let (name, time) = (allowed(&case.name), format!("{:.3}", case.seconds));
    let attributes = [("name", name.as_str()), ("classname", suite), ("time", &time)];
    let element = writer.create_element("testcase").with_attributes(attributes);
    let Some((outcome, text)) = case.outcome.element() else {
        element.write_empty()?;
        return Ok(());
    };
    let text = allowed(text);
    let first = text.lines().next().unwrap_or_default();
    element.write_inner_content(|writer| {
        writer
            .create_element(outcome)
            .with_attribute(("message", first))
            .write_text_content(BytesText::new(&text))?;
        Ok(())
    })?;
    Ok(())
}

/// A text without the characters that XML 1.0 cannot represent (section 2.2).
fn allowed(text: &str) -> String {
    let fits = |c: char| matches!(c, '\t' | '\n' | '\r' | ' '..='\u{fffd}' | '\u{10000}'..);
    text.chars()
        .map(|c| if fits(c) { c } else { '\u{fffd}' })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use quick_xml::Reader;

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
    fn read(xml: &[u8]) -> std::result::Result<(Vec<String>, Vec<String>, String), String> {
        let mut reader = Reader::from_str(std::str::from_utf8(xml).map_err(|error| error.to_string())?);
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
                    names.push(AsRef::<str>::as_ref(&element.name()).to_owned());
                    for attribute in element.attributes() {
                        let attribute = attribute.map_err(|error| error.to_string())?;
                        let value = attribute.value.to_string();
                        if value.contains(['<', '"']) {
                            return Err(format!("attribute {value}"));
                        }
                        values.push(value);
                    }
                }
                Event::Text(part) => text.push_str(&part),
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
        assert_eq!(values[..5], ["a suite", "4", "1", "1", "1.000"]);
        assert!(
            values
                .iter()
                .any(|value| value.contains("&lt;x y=&quot;1&quot;&gt; &amp;"))
        );
        let all = String::from_utf8(xml).unwrap();
        assert!(all.contains("second line") && text.contains("second line"));
        assert!(!all.contains(['\u{0}', '\u{1b}', '\u{fffe}']) && all.contains('\u{fffd}'));
        assert!(!all.contains("]]>"), "not allowed in text");
    }

    #[test]
    fn the_check_sees_what_is_not_well_formed() {
        let xml = String::from_utf8(xml("a", &cases()).unwrap()).unwrap();
        for (from, to) in [("</testsuite>", ""), ("&lt;x", "<x"), ("</error>", "</failure>")] {
            assert!(read(xml.replacen(from, to, 1).as_bytes()).is_err(), "{from}");
        }
    }
}
