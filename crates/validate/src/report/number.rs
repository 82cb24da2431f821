//! Numbers formatted for people: few digits, a value next to its limit, a dash for an absent value.

use crate::Check;
use askama::Template;
use askama::filters::HtmlSafe;

/// The default reason why a number of a case is absent.
pub(super) const NOT_COMPARED: &str = "there was no comparison";

/// A number to print; an en dash with a reason if it is absent.
#[derive(Clone, Debug, PartialEq, Template)]
#[template(
    ext = "html",
    source = r#"{% match text %}{% when Some(text) %}{{ text }}{% when None %}<span class="absent" title="{{ absent }}">–</span>{% endmatch %}"#
)]
pub(super) struct Number {
    text: Option<String>,
    absent: &'static str,
    value: Option<f64>,
}

// Its template escapes its contents.
impl HtmlSafe for Number {}

impl Number {
    fn of<T>(value: Option<T>, as_f64: impl Fn(&T) -> f64, text: impl Fn(&T) -> String) -> Self {
        Self {
            text: value.as_ref().map(text),
            absent: NOT_COMPARED,
            value: value.as_ref().map(as_f64),
        }
    }

    /// Three digits with an exponent, for errors, whose order of magnitude matters.
    pub(super) fn error(value: impl Into<Option<f64>>) -> Self {
        Self::of(value.into(), |v| *v, |v| scientific(*v))
    }

    /// Three digits.
    pub(super) fn plain(value: impl Into<Option<f64>>) -> Self {
        Self::of(value.into(), |v| *v, |v| plain(*v))
    }

    /// Three digits and a unit.
    pub(super) fn with_unit(value: impl Into<Option<f64>>, unit: &str) -> Self {
        // A no-break space: value and unit stay on one line.
        Self::of(value.into(), |v| *v, |v| format!("{}\u{a0}{unit}", plain(*v)))
    }

    /// All digits, in groups of three.
    pub(super) fn count(value: impl Into<Option<u64>>) -> Self {
        Self::of(value.into(), |v| *v as f64, |v| grouped(*v))
    }

    /// Sets another reason for a dash.
    pub(super) fn or(self, why: &'static str) -> Self {
        Self { absent: why, ..self }
    }

    fn is_known(&self) -> bool {
        self.text.is_some()
    }

    /// The key by which a table is sorted; empty if absent.
    pub(super) fn sort(&self) -> String {
        self.value.map(|value| format!("{value:e}")).unwrap_or_default()
    }
}

/// A value and the largest one that passes; only a dash if there is no value.
#[derive(Clone, Debug, PartialEq, Template)]
#[template(
    ext = "html",
    source = r#"{% if over %}<span class="cross" aria-hidden="true">✗</span> <span class="unseen">over the limit: </span>{% endif %}<span class="value">{{ value }}</span>{% if value.is_known() %} <span class="limit"><span class="relation">{% if over %}&gt;{% else %}≤{% endif %}</span> {{ limit }}</span>{% endif %}"#
)]
pub(super) struct Limited {
    pub(super) value: Number,
    pub(super) limit: Number,
    pub(super) over: bool,
}

impl HtmlSafe for Limited {}

impl Limited {
    /// Formatted like [`Number::error`].
    pub(super) fn error(check: Check<f64>) -> Self {
        Self {
            value: Number::error(check.value),
            limit: Number::error(check.limit).or("the limit comes with the reference"),
            over: check.is_over(),
        }
    }

    /// Formatted like [`Number::count`].
    pub(super) fn count(check: Check<usize>) -> Self {
        let number = |count: Option<usize>| Number::count(count.map(|count| count as u64));
        Self {
            value: number(check.value),
            limit: number(check.limit),
            over: check.is_over(),
        }
    }

    /// For a style sheet: the used fraction of the limit, from 0 to 1. None if that is meaningless.
    pub(super) fn used(&self) -> Option<String> {
        match (self.value.value, self.limit.value) {
            (Some(value), Some(limit)) if limit > 0.0 && !self.over => {
                Some(format!("{:.2}", (value / limit).clamp(0.0, 1.0)))
            }
            _ => None,
        }
    }
}

/// Three digits with an exponent: `1.23e-6`, `0`.
pub(super) fn scientific(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return special(value);
    }
    format!("{value:.2e}")
}

/// Three digits, without an exponent if that is short: `0.0123`, `12.3`, `1,235`, `1.23e-6`.
pub(super) fn plain(value: f64) -> String {
    digits(value, 3)
}

/// A round number in its shortest form: `1e-4`.
pub(super) fn short(value: f64) -> String {
    let rounded: f64 = format!("{value:.2e}").parse().unwrap_or(value);
    format!("{rounded:e}")
}

/// A small number without trailing zeros.
pub(super) fn plain_count(value: f64) -> String {
    if value.fract() == 0.0 {
        format!("{value:.0}")
    } else {
        plain(value)
    }
}

/// Six digits: enough to see a difference of a thousandth.
pub(super) fn precise(value: f64) -> String {
    digits(value, 6)
}

fn digits(value: f64, significant: i32) -> String {
    if value == 0.0 || !value.is_finite() {
        return special(value);
    }
    let places = (significant - 1) as usize;
    let scientific = format!("{value:.places$e}");
    // The exponent after rounding, so that 0.9996 becomes 1.00.
    let exponent: i32 = scientific
        .rsplit('e')
        .next()
        .and_then(|e| e.parse().ok())
        .unwrap_or(0);
    match exponent {
        _ if !(-3..9).contains(&exponent) => scientific,
        _ if exponent < significant - 1 => format!("{value:.*}", (significant - 1 - exponent) as usize),
        _ if value < 0.0 => format!("-{}", grouped((-value).round() as u64)),
        _ => grouped(value.round() as u64),
    }
}

fn special(value: f64) -> String {
    if value == 0.0 {
        "0".to_owned()
    } else if value.is_nan() {
        "NaN".to_owned()
    } else if value > 0.0 {
        "∞".to_owned()
    } else {
        "-∞".to_owned()
    }
}

/// `1234567` as `1,234,567`.
pub(super) fn grouped(value: u64) -> String {
    let digits = value.to_string();
    let mut text = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_digits() {
        let shown = [
            0.0, 1.234e-6, 0.012345, 0.99961, 9.996, 12.345, 123.45, 1234.5, -1234.5, 4.2e9,
        ]
        .map(plain);
        assert_eq!(
            shown,
            [
                "0", "1.23e-6", "0.0123", "1.00", "10.0", "12.3", "123", "1,235", "-1,235", "4.20e9"
            ]
        );
        assert_eq!(
            [1.0, 5e-5, -0.0, f64::NAN].map(scientific),
            ["1.00e0", "5.00e-5", "0", "NaN"]
        );
        assert_eq!(
            [0.5, 1234.56789, 1e-7].map(precise),
            ["0.500000", "1234.57", "1.00000e-7"]
        );
        assert_eq!([f64::INFINITY, f64::NEG_INFINITY].map(precise), ["∞", "-∞"]);
        assert_eq!(
            [0, 999, 1000, 1234567].map(grouped),
            ["0", "999", "1,000", "1,234,567"]
        );
    }

    #[test]
    fn values_beside_limits() {
        let check = |value, limit| Limited::error(Check { value, limit });
        let kept = check(Some(1e-6), Some(2e-6));
        assert!(!kept.over && kept.to_string().contains('≤'));
        assert_eq!(kept.used().as_deref(), Some("0.50"));
        let over = Limited::count(Check {
            value: Some(3),
            limit: Some(2),
        });
        assert!(over.over && over.to_string().contains("over the limit"));
        assert_eq!(over.used(), None);
        assert!(check(Some(f64::NAN), Some(1.0)).over);
        let absent = check(None, None);
        assert!(!absent.over && absent.to_string().contains("no comparison"));
        assert_eq!(absent.value.sort(), "");
    }
}
