//! Limits with the names and the meaning that they have in OpenImageIO's `idiff`.

use clap::Args;
use serde::Serialize;
use std::ffi::OsString;

/// The threshold of a pixel if only a percentage is given, as in `idiff`.
const DEFAULT: f64 = 1e-6;

/// The limits. A difference is the largest one of a pixel over R, G, B, of codes also A; codes
/// count from 0 to 1.
#[derive(Args, Clone, Debug, Serialize)]
#[group(skip)]
pub(super) struct Thresholds {
    /// Fail if pixels differ by more than X in any channel, as idiff -fail does; codes count from 0
    /// to 1 [default: 1e-6 if --failpercent is given]
    #[arg(long, value_name = "X", value_parser = super::at_least_0)]
    fail: Option<f64>,
    /// Percentage of the pixels that may differ by more than --fail, as idiff -failpercent
    #[arg(long, value_name = "P", value_parser = percentage)]
    failpercent: Option<f64>,
    /// Fail if a single pixel differs by more than X, as idiff -hardfail
    #[arg(long, value_name = "X", value_parser = super::at_least_0)]
    hardfail: Option<f64>,
    /// Warn if pixels differ by more than X, as idiff -warn; the exit code stays 0 [default: 1e-6
    /// if --warnpercent is given]
    #[arg(long, value_name = "X", value_parser = super::at_least_0)]
    warn: Option<f64>,
    /// Percentage of the pixels that may differ by more than --warn, as idiff -warnpercent
    #[arg(long, value_name = "P", value_parser = percentage)]
    warnpercent: Option<f64>,
    /// Warn if a single pixel differs by more than X, as idiff -hardwarn
    #[arg(long, value_name = "X", value_parser = super::at_least_0)]
    hardwarn: Option<f64>,
}

/// The names of the limits.
const NAMES: [&str; 6] = [
    "fail",
    "failpercent",
    "hardfail",
    "warn",
    "warnpercent",
    "hardwarn",
];

/// The arguments of a command line in which the limits of `compare` may have one hyphen.
pub(crate) fn with_two_hyphens(arguments: impl Iterator<Item = OsString>) -> Vec<OsString> {
    let mut arguments: Vec<OsString> = arguments.collect();
    if arguments.first().is_some_and(|command| command == "compare") {
        for argument in &mut arguments {
            let name = argument.to_str().and_then(|text| text.strip_prefix('-'));
            let word = name.map(|name| name.split('=').next().unwrap_or(name));
            if word.is_some_and(|word| NAMES.contains(&word)) {
                let mut long = OsString::from("-");
                long.push(&*argument);
                *argument = long;
            }
        }
    }
    arguments
}

fn percentage(text: &str) -> Result<f64, String> {
    match super::super::finite(text)? {
        value if (0.0..=100.0).contains(&value) => Ok(value),
        _ => Err("expected a percentage from 0 to 100".to_owned()),
    }
}

impl Thresholds {
    /// Whether a limit can fail the comparison.
    pub(super) fn can_fail(&self) -> bool {
        self.fail.is_some() || self.failpercent.is_some() || self.hardfail.is_some()
    }

    /// Whether there is any limit.
    pub(super) fn is_any(&self) -> bool {
        self.can_fail() || self.warn.is_some() || self.warnpercent.is_some() || self.hardwarn.is_some()
    }

    /// The limits that the largest differences of the pixels exceed: those that fail, and those
    /// that warn.
    pub(super) fn check(&self, differences: &[f64]) -> [Vec<String>; 2] {
        [
            (self.fail, self.failpercent, self.hardfail),
            (self.warn, self.warnpercent, self.hardwarn),
        ]
        .map(|(each, percent, hard)| exceeded(differences, each, percent, hard))
    }
}

fn exceeded(differences: &[f64], each: Option<f64>, percent: Option<f64>, hard: Option<f64>) -> Vec<String> {
    let mut broken = Vec::new();
    let count = differences.len() as f64;
    if each.is_some() || percent.is_some() {
        let (each, percent) = (each.unwrap_or(DEFAULT), percent.unwrap_or(0.0));
        let above = differences
            .iter()
            .filter(|difference| **difference > each)
            .count();
        if above as f64 > percent / 100.0 * count {
            broken.push(format!(
                "{above} of {count} pixels, {:.4} %, differ by more than {each}; the limit is {percent} %",
                100.0 * above as f64 / count
            ));
        }
    }
    let largest = differences.iter().copied().fold(0.0, f64::max);
    if let Some(hard) = hard
        && largest > hard
    {
        broken.push(format!("a pixel differs by {largest:.6}; the limit is {hard}"));
    }
    broken
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limits(of: &[&str]) -> Thresholds {
        #[derive(clap::Parser)]
        struct Line {
            #[command(flatten)]
            thresholds: Thresholds,
        }
        let line = ["compare"].iter().chain(of).map(OsString::from);
        let line = with_two_hyphens(line);
        <Line as clap::Parser>::try_parse_from(line).unwrap().thresholds
    }

    /// 100 pixels, of which one differs by 0.5 and four by 0.01.
    fn check(of: &[&str]) -> [usize; 2] {
        let differences: Vec<f64> = (0..100)
            .map(|index| match index {
                7 => 0.5,
                10..14 => 0.01,
                _ => 0.0,
            })
            .collect();
        limits(of).check(&differences).map(|broken| broken.len())
    }

    #[test]
    fn limits_are_those_of_idiff() {
        assert_eq!(check(&[]), [0, 0]);
        assert_eq!(check(&["-fail", "0.1"]), [1, 0]);
        assert_eq!(check(&["-fail", "0.1", "-failpercent", "1"]), [0, 0]);
        assert_eq!(check(&["--fail=0.001", "-failpercent", "4.9"]), [1, 0]);
        assert_eq!(check(&["-fail=0.001", "-failpercent=5"]), [0, 0]);
        assert_eq!(check(&["-failpercent", "4"]), [1, 0]);
        assert_eq!(check(&["-failpercent", "50", "-hardfail", "0.4"]), [1, 0]);
        assert_eq!(check(&["-hardfail", "0.5"]), [0, 0]);
        assert_eq!(check(&["-warn", "0.1", "-fail", "0.6"]), [0, 1]);
        assert_eq!(
            check(&["-warn", "0.001", "-warnpercent", "5", "-hardwarn", "0.2"]),
            [0, 1]
        );
    }

    #[test]
    fn other_commands_and_words_stay() {
        let line = |words: &[&str]| with_two_hyphens(words.iter().map(OsString::from));
        assert_eq!(line(&["render", "-fail"]), ["render", "-fail"]);
        assert_eq!(
            line(&["compare", "-fail", "-o", "--fail"]),
            ["compare", "--fail", "-o", "--fail"]
        );
    }
}
