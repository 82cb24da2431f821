//! A [`Deserializer`] of TOML values with typed errors, each with the span of the innermost value
//! or key that is wrong.

use super::INLINE;
use crate::{SceneError, SourceSpan, nearest};
use serde::de::{
    DeserializeSeed, Deserializer, EnumAccess, Error as _, Expected, IntoDeserializer, MapAccess, SeqAccess,
    Unexpected, VariantAccess, Visitor,
};
use serde::forward_to_deserialize_any;
use serde_spanned::de::{SpannedDeserializer, is_spanned};
use std::borrow::Cow;
use std::convert::Infallible;
use std::fmt;
use toml::Spanned;
use toml::de::{DeArray, DeFloat, DeInteger, DeTable, DeValue};

/// How an inline plugin is described in messages.
const INLINE_TABLE: &str = "a table with `type`";

/// An error, with its position once an enclosing value has added it.
#[derive(Debug)]
pub(super) struct Error {
    pub(super) fault: Fault,
    pub(super) span: Option<SourceSpan>,
}

/// The kinds of errors.
#[derive(Debug, PartialEq)]
pub(super) enum Fault {
    UnknownKey {
        key: String,
        known: &'static [&'static str],
    },
    UnknownValue {
        value: String,
        known: &'static [&'static str],
    },
    /// A key, or alternatives such as "radiance or faces".
    MissingKey(&'static str),
    WrongType {
        found: String,
        expected: String,
    },
    Other(String),
}

impl Error {
    fn wrong_type(found: impl Into<String>, expected: impl Into<String>) -> Self {
        Fault::WrongType {
            found: found.into(),
            expected: expected.into(),
        }
        .into()
    }

    /// Sets the position, unless the error already has one.
    fn or_at(mut self, span: SourceSpan) -> Self {
        self.span.get_or_insert(span);
        self
    }

    /// The error as the user sees it, at `span` if it has no position.
    pub(super) fn report(self, span: SourceSpan) -> SceneError {
        SceneError {
            message: self.to_string(),
            help: self.fault.help(),
            span: self.span.or(Some(span)),
        }
    }
}

impl From<Fault> for Error {
    fn from(fault: Fault) -> Self {
        Self { fault, span: None }
    }
}

impl Fault {
    /// The nearest known key or value, or all of them.
    fn help(&self) -> Option<String> {
        match self {
            Self::UnknownKey { key, known } => Some(match nearest(key, known.iter().copied()) {
                Some(name) => format!("did you mean `{name}`?"),
                None if known.is_empty() => "this type has no parameters".to_owned(),
                None => format!("known keys are `{}`", known.join("`, `")),
            }),
            Self::UnknownValue { value, known } => Some(match nearest(value, known.iter().copied()) {
                Some(name) => format!("did you mean \"{name}\"?"),
                None => format!("known values are {}", known.join(", ")),
            }),
            _ => None,
        }
    }

    /// The alternatives of a missing key.
    pub(super) fn missing_keys(&self) -> impl Iterator<Item = &'static str> + use<> {
        let keys = match self {
            Self::MissingKey(keys) => Some(keys.split(" or ")),
            _ => None,
        };
        keys.into_iter().flatten()
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.fault {
            Fault::UnknownKey { key, .. } => write!(f, "unknown key `{key}`"),
            Fault::UnknownValue { value, .. } if value.starts_with(INLINE) => {
                write!(f, "wrong type: {INLINE_TABLE}, expected a text")
            }
            Fault::UnknownValue { value, .. } => write!(f, "unknown value \"{value}\""),
            Fault::MissingKey(keys) => write!(f, "missing key `{}`", keys.replace(" or ", "` or `")),
            Fault::WrongType { found, expected } => write!(f, "wrong type: {found}, expected {expected}"),
            Fault::Other(message) => f.write_str(message),
        }
    }
}

impl std::error::Error for Error {}

impl serde::de::Error for Error {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Fault::Other(message.to_string()).into()
    }

    fn invalid_type(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::wrong_type(describe(found), expected.to_string())
    }

    fn invalid_value(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::custom(format!("invalid value: {}, expected {expected}", describe(found)))
    }

    fn invalid_length(found: usize, expected: &dyn Expected) -> Self {
        Self::custom(format!("invalid length {found}, expected {expected}"))
    }

    fn unknown_field(key: &str, known: &'static [&'static str]) -> Self {
        let key = key.to_owned();
        Fault::UnknownKey { key, known }.into()
    }

    fn unknown_variant(value: &str, known: &'static [&'static str]) -> Self {
        let value = value.to_owned();
        Fault::UnknownValue { value, known }.into()
    }

    fn missing_field(key: &'static str) -> Self {
        Fault::MissingKey(key).into()
    }

    fn duplicate_field(key: &'static str) -> Self {
        Self::custom(format!("duplicate key `{key}`"))
    }
}

/// A value in TOML terms.
fn describe(found: Unexpected<'_>) -> String {
    match found {
        Unexpected::Str(text) if text.starts_with(INLINE) => INLINE_TABLE.to_owned(),
        Unexpected::Map => "a table".to_owned(),
        Unexpected::Seq => "an array".to_owned(),
        // Only dates are visited as units.
        Unexpected::Unit => "a date".to_owned(),
        other => other.to_string(),
    }
}

/// A borrowed TOML value or key.
#[derive(Debug)]
pub(super) struct Value<'de> {
    node: Node<'de>,
    span: SourceSpan,
}

#[derive(Clone, Copy, Debug)]
enum Node<'de> {
    String(&'de str),
    Integer(&'de DeInteger<'de>),
    Float(&'de DeFloat<'de>),
    Boolean(bool),
    Date,
    Array(&'de DeArray<'de>),
    Table(&'de DeTable<'de>),
}

impl<'de> From<&'de Spanned<DeValue<'de>>> for Value<'de> {
    fn from(value: &'de Spanned<DeValue<'de>>) -> Self {
        let node = match value.get_ref() {
            DeValue::String(text) => Node::String(text),
            DeValue::Integer(number) => Node::Integer(number),
            DeValue::Float(number) => Node::Float(number),
            DeValue::Boolean(truth) => Node::Boolean(*truth),
            DeValue::Datetime(_) => Node::Date,
            DeValue::Array(items) => Node::Array(items),
            DeValue::Table(table) => Node::Table(table),
        };
        let span = value.span();
        Self { node, span }
    }
}

impl<'de> From<&'de Spanned<DeTable<'de>>> for Value<'de> {
    fn from(table: &'de Spanned<DeTable<'de>>) -> Self {
        Self {
            node: Node::Table(table.get_ref()),
            span: table.span(),
        }
    }
}

impl<'de> From<&'de Spanned<Cow<'de, str>>> for Value<'de> {
    fn from(key: &'de Spanned<Cow<'de, str>>) -> Self {
        Self {
            node: Node::String(key.get_ref()),
            span: key.span(),
        }
    }
}

impl<'de> Value<'de> {
    /// Deserializes the value. An error without a position is an error of this value.
    fn read<S: DeserializeSeed<'de>>(self, seed: S) -> Result<S::Value, Error> {
        let span = self.span.clone();
        seed.deserialize(self).map_err(|error| error.or_at(span))
    }

    /// Reports that the value has the wrong type.
    fn refuse<T>(self, expected: String) -> Result<T, Error> {
        match self.deserialize_any(Nothing(expected))? {}
    }
}

/// Visits no value.
struct Nothing(String);

impl Visitor<'_> for Nothing {
    type Value = Infallible;
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// What `visitor` expects. The default text of serde names types of Rust, so `ours` replaces it.
fn expectation(visitor: &dyn Expected, default: &str, ours: impl Into<String>) -> String {
    let text = visitor.to_string();
    if text == default { ours.into() } else { text }
}

impl<'de> Deserializer<'de> for Value<'de> {
    type Error = Error;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.node {
            Node::String(text) => visitor.visit_borrowed_str(text),
            Node::Integer(number) => {
                let (digits, radix) = (number.as_str(), number.radix());
                if let Ok(value) = i64::from_str_radix(digits, radix) {
                    visitor.visit_i64(value)
                } else if let Ok(value) = u64::from_str_radix(digits, radix) {
                    visitor.visit_u64(value)
                } else {
                    let found = format!("integer `{number}`");
                    Err(Error::invalid_type(Unexpected::Other(&found), &visitor))
                }
            }
            Node::Float(number) => match number.as_str().parse::<f64>() {
                Ok(value) if value.is_finite() || value.is_nan() || number.as_str().contains("inf") => {
                    visitor.visit_f64(value)
                }
                _ => Err(Error::custom("floating-point number overflowed")),
            },
            Node::Boolean(truth) => visitor.visit_bool(truth),
            // No parameter is a unit. An untagged enum, which buffers values, accepts it.
            Node::Date => visitor.visit_unit(),
            Node::Array(items) => {
                let mut rest = Items(items.iter());
                let value = visitor.visit_seq(&mut rest)?;
                match rest.0.len() {
                    0 => Ok(value),
                    // A tuple or an array of Rust reads as many elements as it has.
                    more => Err(Error::invalid_length(
                        items.len(),
                        &format!("an array of length {}", items.len() - more).as_str(),
                    )),
                }
            }
            Node::Table(table) => visitor.visit_map(Entries {
                rest: table.iter(),
                value: None,
            }),
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, Error> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.node {
            Node::Array(_) => self.deserialize_any(visitor),
            _ => self.refuse(expectation(&visitor, "a sequence", "an array")),
        }
    }

    fn deserialize_map<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.node {
            Node::Table(_) => self.deserialize_any(visitor),
            _ => self.refuse(expectation(&visitor, "a map", "a table")),
        }
    }

    /// Accepts tables only. Serde would also read a struct from an array.
    fn deserialize_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        match self.node {
            _ if is_spanned(name) => {
                let span = self.span.clone();
                visitor.visit_map(SpannedDeserializer::new(self, span))
            }
            Node::Table(_) => self.deserialize_any(visitor),
            _ => self.refuse(expectation(&visitor, &format!("struct {name}"), "a table")),
        }
    }

    /// A text, or a table whose only key is the variant.
    fn deserialize_enum<V: Visitor<'de>>(
        self,
        name: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        match self.node {
            Node::String(name) => visitor.visit_enum(Variant {
                name,
                span: self.span,
                content: None,
            }),
            Node::Table(table) => {
                let mut entries = table.iter();
                let (Some((key, content)), None) = (entries.next(), entries.next()) else {
                    let message = format!("expected a table with exactly one key, found {}", table.len());
                    return Err(Fault::Other(message).into());
                };
                visitor.visit_enum(Variant {
                    name: key.get_ref(),
                    span: key.span(),
                    content: Some(content.into()),
                })
            }
            _ => {
                let known = format!("one of {}", variants.join(", "));
                self.refuse(expectation(&visitor, &format!("enum {name}"), known))
            }
        }
    }

    fn deserialize_ignored_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_unit()
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf
        unit unit_struct tuple tuple_struct identifier
    }
}

impl<'de> IntoDeserializer<'de, Error> for Value<'de> {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

/// The remaining elements of an array.
struct Items<'de>(std::slice::Iter<'de, Spanned<DeValue<'de>>>);

impl<'de> SeqAccess<'de> for Items<'de> {
    type Error = Error;

    fn next_element_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<Option<S::Value>, Error> {
        self.0.next().map(|item| Value::from(item).read(seed)).transpose()
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.0.len())
    }
}

/// The remaining entries of a table, and the value of the entry whose key was read last.
struct Entries<'de, I> {
    rest: I,
    value: Option<&'de Spanned<DeValue<'de>>>,
}

impl<'de, I> MapAccess<'de> for Entries<'de, I>
where
    I: Iterator<Item = (&'de Spanned<Cow<'de, str>>, &'de Spanned<DeValue<'de>>)>,
{
    type Error = Error;

    fn next_key_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<Option<S::Value>, Error> {
        let Some((key, value)) = self.rest.next() else {
            return Ok(None);
        };
        self.value = Some(value);
        Value::from(key).read(seed).map(Some)
    }

    fn next_value_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<S::Value, Error> {
        let value = self.value.take().expect("serde reads a key first");
        Value::from(value).read(seed)
    }
}

/// A variant of an enum. One that is written as a text has no content.
struct Variant<'de> {
    name: &'de str,
    /// Position of the name.
    span: SourceSpan,
    content: Option<Value<'de>>,
}

impl<'de> Variant<'de> {
    fn content(self) -> Result<Value<'de>, Error> {
        self.content.ok_or_else(|| {
            let found = describe(Unexpected::Str(self.name));
            Error::wrong_type(found, format!("a table with the key `{}`", self.name))
        })
    }
}

impl<'de> EnumAccess<'de> for Variant<'de> {
    type Error = Error;
    type Variant = Self;

    fn variant_seed<S: DeserializeSeed<'de>>(self, seed: S) -> Result<(S::Value, Self), Error> {
        let node = Node::String(self.name);
        let span = self.span.clone();
        Ok((Value { node, span }.read(seed)?, self))
    }
}

impl<'de> VariantAccess<'de> for Variant<'de> {
    type Error = Error;

    fn unit_variant(self) -> Result<(), Error> {
        match self.content {
            None => Ok(()),
            Some(_) => Err(Error::wrong_type("a table", "a text")),
        }
    }

    fn newtype_variant_seed<S: DeserializeSeed<'de>>(self, seed: S) -> Result<S::Value, Error> {
        self.content()?.read(seed)
    }

    fn tuple_variant<V: Visitor<'de>>(self, _: usize, visitor: V) -> Result<V::Value, Error> {
        let content = self.content()?;
        let span = content.span.clone();
        match content.node {
            Node::Array(_) => content.deserialize_any(visitor),
            _ => content.refuse("an array".to_owned()),
        }
        .map_err(|error| error.or_at(span))
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        let content = self.content()?;
        let span = content.span.clone();
        match content.node {
            Node::Table(_) => content.deserialize_any(visitor),
            _ => content.refuse("a table".to_owned()),
        }
        .map_err(|error| error.or_at(span))
    }
}

#[cfg(test)]
mod tests;
