//! Wrap rules of grids of texels or voxels.

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::StrDeserializer;
use serde::de::{Error, IgnoredAny, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;
use std::fmt;

/// Continuation outside of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Wrap {
    /// Repeats the image.
    #[default]
    Repeat,
    /// Clamps to its border.
    Clamp,
    /// Mirrors the image.
    Mirror,
}

impl Wrap {
    /// Wraps an index, which is an integer of any size or not finite, into `0..count`.
    pub(crate) fn index(self, index: f64, count: usize) -> usize {
        let n = count as f64;
        if index >= 0.0 && index < n {
            return index as usize;
        }
        // Computed in floating point, which cannot overflow; remainders of integers are exact.
        let inside = match self {
            Self::Repeat => index.rem_euclid(n),
            Self::Clamp => index.clamp(0.0, n - 1.0),
            Self::Mirror => {
                let folded = index.rem_euclid(2.0 * n);
                if folded < n {
                    folded
                } else {
                    2.0 * n - 1.0 - folded
                }
            }
        };
        // NaN, from an infinite index, becomes 0.
        inside as usize
    }
}

/// Horizontal and vertical wrap rules: one word for both, or two.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Wraps(pub(crate) [Wrap; 2]);

impl Serialize for Wraps {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0 {
            [u, v] if u == v => u.serialize(serializer),
            both => both.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Wraps {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct OneOrTwo;
        impl<'de> Visitor<'de> for OneOrTwo {
            type Value = Wraps;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("\"repeat\", \"clamp\" or \"mirror\", or two of them, along u and along v")
            }
            fn visit_str<E: Error>(self, word: &str) -> Result<Wraps, E> {
                let wrap = Wrap::deserialize(StrDeserializer::new(word))?;
                Ok(Wraps([wrap; 2]))
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut words: A) -> Result<Wraps, A::Error> {
                let pair = [words.next_element()?, words.next_element()?];
                match (pair, words.next_element::<IgnoredAny>()?) {
                    ([Some(u), Some(v)], None) => Ok(Wraps([u, v])),
                    _ => Err(A::Error::custom("expected two words, along u and along v")),
                }
            }
        }
        deserializer.deserialize_any(OneOrTwo)
    }
}

impl JsonSchema for Wraps {
    fn schema_name() -> Cow<'static, str> {
        "Wraps".into()
    }
    fn inline_schema() -> bool {
        true
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let word = json_schema!({ "type": "string", "enum": ["repeat", "clamp", "mirror"] });
        json_schema!({ "anyOf": [word, { "type": "array", "items": word, "minItems": 2, "maxItems": 2 }] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
    struct Keys {
        wrap: Wraps,
    }

    #[test]
    fn one_word_or_two_are_read_and_written() {
        for (words, wrap) in [
            ("\"mirror\"", [Wrap::Mirror; 2]),
            ("[\"clamp\", \"repeat\"]", [Wrap::Clamp, Wrap::Repeat]),
        ] {
            let text = format!("wrap = {words}\n");
            let keys = Keys { wrap: Wraps(wrap) };
            assert_eq!(toml::to_string(&keys).unwrap(), text);
            assert_eq!(toml::from_str::<Keys>(&text).unwrap(), keys);
        }
        for (words, expected) in [
            ("3", "two of them"),
            ("[\"clamp\"]", "two words"),
            ("[\"clamp\", \"clamp\", \"clamp\"]", "two words"),
            ("\"tile\"", "`clamp`"),
        ] {
            let error = toml::from_str::<Keys>(&format!("wrap = {words}"))
                .unwrap_err()
                .to_string();
            assert!(error.contains(expected), "{error}");
        }
        let schema = schemars::schema_for!(Keys);
        let kinds = schema
            .pointer("/properties/wrap/anyOf")
            .unwrap()
            .as_array()
            .unwrap();
        assert_eq!(kinds.len(), 2);
    }
}
