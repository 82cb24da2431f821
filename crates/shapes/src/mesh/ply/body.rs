//! The bodies of PLY files, as numbers in the order of the header.

use super::{Element, Scalar};
use crate::mesh::{FileError, shorten};
use rayon::prelude::*;
use std::str::SplitAsciiWhitespace;

/// A body, from its beginning to its end.
pub(super) trait Body {
    /// The most elements of this kind that the rest can hold.
    fn most(&self, element: &Element) -> u64;

    /// Begins an element, given its number among those of its kind.
    fn begin(&mut self, element: &Element, number: u64) -> Result<(), FileError>;

    /// The next number.
    fn number(&mut self, scalar: Scalar) -> Result<f64, FileError>;

    /// The next number as the length of a list.
    fn length(&mut self, scalar: Scalar) -> Result<u32, FileError>;

    /// Ends an element.
    fn end(&mut self, element: &Element) -> Result<(), FileError>;
}

/// A binary body.
pub(super) struct Binary<'a, const BIG: bool> {
    rest: &'a [u8],
    /// The number and name of the elements that are being read, for messages.
    place: String,
    /// The number of the current one, from 0.
    number: u64,
}

impl<'a, const BIG: bool> Binary<'a, BIG> {
    pub(super) fn new(body: &'a [u8]) -> Self {
        Self {
            rest: body,
            place: String::new(),
            number: 0,
        }
    }

    #[inline(always)]
    fn take<const N: usize>(&mut self) -> Result<[u8; N], FileError> {
        let Some((bytes, rest)) = self.rest.split_first_chunk::<N>() else {
            let message = format!("expected {}, but the file ends after {}", self.place, self.number);
            return Err(FileError::anywhere(message));
        };
        self.rest = rest;
        Ok(*bytes)
    }
}

macro_rules! take {
    ($from:expr, $type:ty) => {{
        let bytes = $from.take()?;
        f64::from(match BIG {
            true => <$type>::from_be_bytes(bytes),
            false => <$type>::from_le_bytes(bytes),
        })
    }};
}

impl<const BIG: bool> Body for Binary<'_, BIG> {
    fn most(&self, element: &Element) -> u64 {
        (self.rest.len() / element.least_size().max(1)) as u64
    }

    fn begin(&mut self, element: &Element, number: u64) -> Result<(), FileError> {
        if number == 0 {
            self.place = format!("{} of the element `{}`", element.count, shorten(&element.name));
        }
        self.number = number;
        Ok(())
    }

    #[inline(always)]
    fn number(&mut self, scalar: Scalar) -> Result<f64, FileError> {
        Ok(match scalar {
            Scalar::I8 => take!(self, i8),
            Scalar::U8 => take!(self, u8),
            Scalar::I16 => take!(self, i16),
            Scalar::U16 => take!(self, u16),
            Scalar::I32 => take!(self, i32),
            Scalar::U32 => take!(self, u32),
            Scalar::F32 => take!(self, f32),
            Scalar::F64 => take!(self, f64),
        })
    }

    #[inline(always)]
    fn length(&mut self, scalar: Scalar) -> Result<u32, FileError> {
        let length = self.number(scalar)?;
        length_of(length).ok_or_else(|| {
            let message = format!(
                "expected the length of a list in number {} of {}, found {length}",
                self.number, self.place
            );
            FileError::anywhere(message)
        })
    }

    fn end(&mut self, _: &Element) -> Result<(), FileError> {
        Ok(())
    }
}

/// A text body: one element per line, and blank lines anywhere.
///
/// Numbers are read as exporters write them, such as `.5` and `1.`, and in double precision
/// whatever type the header states.
pub(super) struct Text<'a> {
    rest: Option<&'a [u8]>,
    words: SplitAsciiWhitespace<'a>,
    /// Number of the current line.
    line: usize,
}

impl<'a> Text<'a> {
    pub(super) fn new(body: &'a [u8], header_lines: usize) -> Self {
        Self {
            rest: Some(body),
            words: "".split_ascii_whitespace(),
            line: header_lines,
        }
    }

    fn fault(&self, message: impl Into<String>) -> FileError {
        FileError::at(self.line, message)
    }
}

impl Body for Text<'_> {
    fn most(&self, element: &Element) -> u64 {
        // A number and a blank take two bytes.
        let rest = self.rest.map_or(0, <[u8]>::len);
        (rest / (2 * element.properties.len()).max(1)) as u64
    }

    fn begin(&mut self, element: &Element, number: u64) -> Result<(), FileError> {
        while let Some(rest) = self.rest {
            let end = rest.iter().position(|&byte| byte == b'\n');
            let (line, after) = end.map_or((rest, None), |end| (&rest[..end], Some(&rest[end + 1..])));
            self.rest = after;
            self.line += 1;
            let line = line.trim_ascii();
            if !line.is_empty() {
                let line = std::str::from_utf8(line).map_err(|_| self.fault("expected UTF-8 text"))?;
                self.words = line.split_ascii_whitespace();
                return Ok(());
            }
        }
        Err(FileError::anywhere(format!(
            "expected {} of the element `{}`, one a line, found {number}",
            element.count,
            shorten(&element.name)
        )))
    }

    fn number(&mut self, scalar: Scalar) -> Result<f64, FileError> {
        let found = match self.words.next() {
            None => "the end of the line".to_owned(),
            Some(word) => match parsed(word).filter(|&x| is_of_type(x, scalar)) {
                Some(x) => return Ok(x),
                None => format!("\"{}\"", shorten(word)),
            },
        };
        let expected = match scalar {
            Scalar::I8 => "a whole number from -128 to 127",
            Scalar::U8 => "a whole number from 0 to 255",
            Scalar::I16 => "a whole number from -32768 to 32767",
            Scalar::U16 => "a whole number from 0 to 65535",
            Scalar::I32 => "a whole number of 32 bits",
            Scalar::U32 => "a whole number of 32 bits from 0",
            Scalar::F32 | Scalar::F64 => "a finite number",
        };
        Err(self.fault(format!("expected {expected}, found {found}")))
    }

    fn length(&mut self, scalar: Scalar) -> Result<u32, FileError> {
        let length = self.number(scalar)?;
        length_of(length).ok_or_else(|| self.fault(format!("expected the length of a list, found {length}")))
    }

    fn end(&mut self, element: &Element) -> Result<(), FileError> {
        match self.words.next() {
            None => Ok(()),
            Some(word) => Err(self.fault(format!(
                "expected nothing behind the properties of the element `{}`, found \"{}\"",
                shorten(&element.name),
                shorten(word)
            ))),
        }
    }
}

/// A text body whose numbers are parsed on all threads, a block of lines at a time. It serves files
/// without errors: where it fails, [`Text`] reads the file again and finds the error with its line.
pub(super) struct ParallelText<'a> {
    rest: &'a [u8],
    block: Vec<Lines>,
    /// The position in the block: lines of one part, and numbers of them.
    part: usize,
    line: usize,
    number: usize,
    /// The end of the numbers of the current line.
    end: usize,
}

/// The numbers of consecutive lines that are not blank. NaN stands for words that are no numbers.
#[derive(Default)]
struct Lines {
    numbers: Vec<f64>,
    /// The end of each line in `numbers`.
    ends: Vec<usize>,
}

impl Lines {
    fn parse(text: &[u8]) -> Self {
        let mut lines = Self::default();
        for line in text.split(|&byte| byte == b'\n') {
            match std::str::from_utf8(line.trim_ascii()) {
                Ok("") => continue,
                Ok(line) => {
                    let words = line.split_ascii_whitespace();
                    lines
                        .numbers
                        .extend(words.map(|word| parsed(word).unwrap_or(f64::NAN)));
                }
                Err(_) => lines.numbers.push(f64::NAN),
            }
            lines.ends.push(lines.numbers.len());
        }
        lines
    }
}

/// Bytes of a part of a block, and parts of a block.
const PART: usize = 1 << 16;
const PARTS: usize = 32;

impl<'a> ParallelText<'a> {
    pub(super) fn new(body: &'a [u8]) -> Self {
        Self {
            rest: body,
            block: Vec::new(),
            part: 0,
            line: 0,
            number: 0,
            end: 0,
        }
    }

    /// Whether it is worthwhile.
    pub(super) fn suits(body: &[u8]) -> bool {
        body.len() > PART * PARTS && rayon::current_num_threads() > 1
    }

    /// Parses the next block. Its memory is bounded: a long line is left to [`Text`].
    fn read_block(&mut self) -> Result<(), FileError> {
        let mut parts = Vec::new();
        while !self.rest.is_empty() && parts.len() < PARTS {
            let ahead = self.rest.get(PART..).unwrap_or_default();
            let end = ahead.iter().position(|&byte| byte == b'\n');
            let (part, after) = self
                .rest
                .split_at(end.map_or(self.rest.len(), |end| PART + end + 1));
            if part.len() > 2 * PART {
                return Err(irregular());
            }
            parts.push(part);
            self.rest = after;
        }
        self.block = parts.into_par_iter().map(Lines::parse).collect();
        (self.part, self.line) = (0, 0);
        Ok(())
    }
}

impl Body for ParallelText<'_> {
    fn most(&self, element: &Element) -> u64 {
        // Of the whole file, as far as it is not parsed.
        let parsed: usize = self.block.iter().map(|lines| lines.ends.len()).sum();
        (self.rest.len() / (2 * element.properties.len()).max(1) + parsed) as u64
    }

    fn begin(&mut self, _: &Element, _: u64) -> Result<(), FileError> {
        loop {
            let Some(lines) = self.block.get(self.part) else {
                if self.rest.is_empty() {
                    return Err(irregular());
                }
                self.read_block()?;
                continue;
            };
            if let Some(&end) = lines.ends.get(self.line) {
                self.number = self.line.checked_sub(1).map_or(0, |before| lines.ends[before]);
                self.line += 1;
                self.end = end;
                return Ok(());
            }
            (self.part, self.line) = (self.part + 1, 0);
        }
    }

    #[inline(always)]
    fn number(&mut self, scalar: Scalar) -> Result<f64, FileError> {
        let number = self.number;
        self.number += 1;
        let found = (self.block.get(self.part)).and_then(|lines| lines.numbers.get(number));
        let good = found.filter(|&&x| number < self.end && is_of_type(x, scalar));
        good.copied().ok_or_else(irregular)
    }

    fn length(&mut self, scalar: Scalar) -> Result<u32, FileError> {
        length_of(self.number(scalar)?).ok_or_else(irregular)
    }

    fn end(&mut self, _: &Element) -> Result<(), FileError> {
        if self.number == self.end {
            Ok(())
        } else {
            Err(irregular())
        }
    }
}

fn irregular() -> FileError {
    FileError::anywhere("an irregular line")
}

/// A number. Most are indices of a few digits.
fn parsed(word: &str) -> Option<f64> {
    short_whole(word).or_else(|| word.parse().ok())
}

/// Whether a property of this type can have this value.
fn is_of_type(x: f64, scalar: Scalar) -> bool {
    let range = match scalar {
        Scalar::I8 => -128.0..=127.0,
        Scalar::U8 => 0.0..=255.0,
        Scalar::I16 => -32768.0..=32767.0,
        Scalar::U16 => 0.0..=65535.0,
        Scalar::I32 => f64::from(i32::MIN)..=f64::from(i32::MAX),
        Scalar::U32 => 0.0..=f64::from(u32::MAX),
        Scalar::F32 | Scalar::F64 => return x.is_finite(),
    };
    range.contains(&x) && x.fract() == 0.0
}

/// A number of a few digits, as most indices are: several times as fast as the general way.
fn short_whole(word: &str) -> Option<f64> {
    let is_short = (1..10).contains(&word.len());
    let whole = word.bytes().try_fold(0, |sum: u32, byte| {
        let digit = byte.wrapping_sub(b'0');
        (digit < 10).then(|| sum.wrapping_mul(10).wrapping_add(digit.into()))
    });
    whole.filter(|_| is_short).map(f64::from)
}

/// The length of a list, if it can be one.
fn length_of(number: f64) -> Option<u32> {
    let whole = number.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&number);
    whole.then_some(number as u32)
}

#[cfg(test)]
mod tests {
    use super::short_whole;

    #[test]
    fn short_numbers_are_read_as_all_others() {
        let digits = ["0", "7", "007", "42", "871414", "999999999"];
        for word in digits {
            assert_eq!(short_whole(word), word.parse().ok(), "{word}");
        }
        for word in [
            "",
            "-1",
            "+1",
            "1.",
            ".5",
            "1e3",
            "1234567890",
            "99999999999999999999",
            "٣",
        ] {
            assert_eq!(short_whole(word), None, "{word}");
        }
    }
}
