//! PLY text bodies: one element per line.
//!
//! Hand-written because the library rejects numbers such as `.5` and `1.`, rounds to single
//! precision, and reports errors in the terms of its grammar.

use crate::mesh::{FileError, shorten};
use ply_rs_bw::ply::{ElementDef, Property, PropertyAccess, PropertyType, ScalarType};
use std::str::SplitAsciiWhitespace;

/// The lines of a text body that are not blank.
pub(super) struct Lines<'a> {
    rest: Option<&'a [u8]>,
    /// Number of the line read last.
    number: usize,
}

impl<'a> Lines<'a> {
    pub(super) fn new(body: &'a [u8], header_lines: usize) -> Self {
        Self {
            rest: Some(body),
            number: header_lines,
        }
    }

    /// The next line that has words.
    fn line(&mut self) -> Result<Option<Words<'a>>, FileError> {
        while let Some(rest) = self.rest {
            let end = rest.iter().position(|&byte| byte == b'\n');
            let (line, after) = end.map_or((rest, None), |end| (&rest[..end], Some(&rest[end + 1..])));
            self.rest = after;
            self.number += 1;
            let line = line.trim_ascii();
            if !line.is_empty() {
                let line = std::str::from_utf8(line)
                    .map_err(|_| FileError::at(self.number, "expected UTF-8 text"))?;
                return Ok(Some(Words {
                    words: line.split_ascii_whitespace(),
                    line: self.number,
                }));
            }
        }
        Ok(None)
    }

    /// Reads all elements of one kind.
    pub(super) fn elements<E: PropertyAccess>(&mut self, element: &ElementDef) -> Result<Vec<E>, FileError> {
        let mut elements = Vec::new();
        for number in 0..element.count {
            let mut words = self.line()?.ok_or_else(|| {
                FileError::anywhere(format!(
                    "expected {} of the element `{}`, one a line, found {number}",
                    element.count,
                    shorten(&element.name)
                ))
            })?;
            elements.push(words.element(element)?);
        }
        Ok(elements)
    }
}

/// The words of a line.
struct Words<'a> {
    words: SplitAsciiWhitespace<'a>,
    line: usize,
}

impl Words<'_> {
    fn element<E: PropertyAccess>(&mut self, element: &ElementDef) -> Result<E, FileError> {
        let mut value = E::new();
        for (name, property) in &element.properties {
            match &property.data_type {
                PropertyType::Scalar(scalar) => {
                    let number = self.number(scalar)?;
                    // The number is in the range of its type. Real ones keep all their digits.
                    let property = match scalar {
                        ScalarType::Char => Property::Char(number as i8),
                        ScalarType::UChar => Property::UChar(number as u8),
                        ScalarType::Short => Property::Short(number as i16),
                        ScalarType::UShort => Property::UShort(number as u16),
                        ScalarType::Int => Property::Int(number as i32),
                        ScalarType::UInt => Property::UInt(number as u32),
                        ScalarType::Float | ScalarType::Double => Property::Double(number),
                    };
                    value.set_property(name, property);
                }
                PropertyType::List(count, scalar) => {
                    // No preallocation: the words of a line run out long before a wrong count is
                    // reached.
                    let mut list = Vec::new();
                    for _ in 0..self.count(count)? {
                        list.push(self.number(scalar)?);
                    }
                    value.set_property(name, list_property(list, scalar));
                }
            }
        }
        match self.words.next() {
            None => Ok(value),
            Some(word) => {
                let message = format!(
                    "expected nothing behind the properties of the element `{}`, found \"{}\"",
                    shorten(&element.name),
                    shorten(word)
                );
                Err(FileError::at(self.line, message))
            }
        }
    }

    fn count(&mut self, scalar: &ScalarType) -> Result<u32, FileError> {
        let count = self.number(scalar)?;
        if count.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&count) {
            return Ok(count as u32);
        }
        let message = format!("expected the length of a list, found {count}");
        Err(FileError::at(self.line, message))
    }

    /// Parses a number, if a property of that type can have its value.
    fn number(&mut self, scalar: &ScalarType) -> Result<f64, FileError> {
        let (expected, range) = match scalar {
            ScalarType::Char => ("a whole number from -128 to 127", -128.0..=127.0),
            ScalarType::UChar => ("a whole number from 0 to 255", 0.0..=255.0),
            ScalarType::Short => ("a whole number from -32768 to 32767", -32768.0..=32767.0),
            ScalarType::UShort => ("a whole number from 0 to 65535", 0.0..=65535.0),
            ScalarType::Int => (
                "a whole number of 32 bits",
                f64::from(i32::MIN)..=f64::from(i32::MAX),
            ),
            ScalarType::UInt => ("a whole number of 32 bits from 0", 0.0..=f64::from(u32::MAX)),
            ScalarType::Float | ScalarType::Double => ("a finite number", f64::MIN..=f64::MAX),
        };
        let found = match self.words.next() {
            None => "the end of the line".to_owned(),
            Some(word) => match word.parse::<f64>() {
                Ok(x) if range.contains(&x) && (is_real(scalar) || x.fract() == 0.0) => return Ok(x),
                _ => format!("\"{}\"", shorten(word)),
            },
        };
        Err(FileError::at(
            self.line,
            format!("expected {expected}, found {found}"),
        ))
    }
}

fn is_real(scalar: &ScalarType) -> bool {
    matches!(scalar, ScalarType::Float | ScalarType::Double)
}

/// Stores vertex indices as unsigned integers; faces reject all other lists.
fn list_property(list: Vec<f64>, scalar: &ScalarType) -> Property {
    if is_real(scalar) || list.iter().any(|&x| x < 0.0) {
        Property::ListDouble(list)
    } else {
        Property::ListUInt(list.into_iter().map(|x| x as u32).collect())
    }
}
