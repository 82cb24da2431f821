//! Types for the parameters of plugin tables. Each rejects values outside its range, with the
//! position of the value.
//!
//! A plugin's `Config` is a struct of these types with `#[serde(deny_unknown_fields)]`, so that an
//! error points to the one value that is wrong.

mod decode;
mod value;

pub use self::decode::decode;
pub use crate::geometry::instance::GroupRef;
pub use crate::shading::material::MaterialRef;
pub use crate::solid::SolidRef;
pub use crate::transform_steps::TransformSteps;
use crate::{Rgb, SourceSpan};
use glam::{DVec2, DVec3};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;
use std::fmt;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// The table of one plugin, without the keys that the scene crate removes (`type`, `id`, ...).
pub type Table<'s> = Spanned<DeTable<'s>>;

/// The placeholder for inline plugin number `index`, whose table was hoisted out of its parent: see
/// [`PluginRef`].
pub fn inline_reference(index: usize) -> String {
    format!("{INLINE}{index}")
}

/// U+0001 cannot occur in a TOML key and is unlikely in an id, so no id is mistaken for a
/// placeholder.
const INLINE: char = '\u{1}';

/// The number of the inline plugin that a placeholder stands for.
fn inline_index(text: &str) -> Option<usize> {
    text.strip_prefix(INLINE)?.parse().ok()
}

/// The numbers of all inline plugins that a table refers to, in order.
pub fn inline_plugins(table: &Table<'_>) -> Vec<usize> {
    fn gather(value: &DeValue<'_>, found: &mut Vec<usize>) {
        match value {
            DeValue::String(text) => found.extend(inline_index(text)),
            DeValue::Array(items) => items.iter().for_each(|item| gather(item.get_ref(), found)),
            DeValue::Table(table) => table.values().for_each(|item| gather(item.get_ref(), found)),
            _ => {}
        }
    }
    let mut found = Vec::new();
    for value in table.get_ref().values() {
        gather(value.get_ref(), &mut found);
    }
    found
}

/// Components as users write them: one number if all are equal.
fn one_or_all<S: Serializer>(values: &[f64], serializer: S) -> Result<S::Ok, S::Error> {
    match values {
        [first, rest @ ..] if rest.iter().all(|value| value == first) => first.serialize(serializer),
        _ => values.serialize(serializer),
    }
}

macro_rules! number {
    ($(#[$doc:meta])* $name:ident, $expected:literal, $schema:tt, $accept:expr) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
        pub struct $name(f64);

        impl $name {
            /// The value, if it is in range.
            pub fn new(value: f64) -> Option<Self> {
                let accept: fn(f64) -> bool = $accept;
                accept(value).then_some(Self(value))
            }

            /// The value.
            pub const fn get(self) -> f64 {
                self.0
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let value = deserializer.deserialize_any(NumberVisitor($expected))?;
                Self::new(value)
                    .ok_or_else(|| D::Error::custom(format!("expected {}, found {value}", $expected)))
            }
        }

        impl Serialize for $name {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                self.0.serialize(serializer)
            }
        }

        impl JsonSchema for $name {
            fn schema_name() -> Cow<'static, str> {
                stringify!($name).into()
            }
            fn inline_schema() -> bool {
                true
            }
            fn json_schema(_: &mut SchemaGenerator) -> Schema {
                json_schema!($schema)
            }
        }
    };
}

number!(
    /// A finite number.
    Finite, "a finite number", { "type": "number" }, f64::is_finite
);
number!(
    /// A finite number greater than 0.
    Positive, "a finite number greater than 0", { "type": "number", "exclusiveMinimum": 0 },
    |x| x.is_finite() && x > 0.0
);
number!(
    /// A finite number of at least 0.
    NonNegative, "a finite number of at least 0", { "type": "number", "minimum": 0 },
    |x| x.is_finite() && x >= 0.0
);
number!(
    /// A number from 0 to 1.
    UnitInterval, "a number from 0 to 1", { "type": "number", "minimum": 0, "maximum": 1 },
    |x| (0.0..=1.0).contains(&x)
);

/// An integer from `MIN` to `MAX`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IntegerIn<const MIN: u32, const MAX: u32>(u32);

impl<const MIN: u32, const MAX: u32> IntegerIn<MIN, MAX> {
    /// The value, if it is in range.
    pub fn new(value: u32) -> Option<Self> {
        (MIN..=MAX).contains(&value).then_some(Self(value))
    }

    /// A constant in range, for defaults: `#[serde(default = "IntegerIn::of::<8>")]`. A value out
    /// of range does not compile.
    pub const fn of<const VALUE: u32>() -> Self {
        const { assert!(MIN <= VALUE && VALUE <= MAX, "the constant is out of range") };
        Self(VALUE)
    }

    /// The value.
    pub const fn get(self) -> u32 {
        self.0
    }
}

impl<'de, const MIN: u32, const MAX: u32> Deserialize<'de> for IntegerIn<MIN, MAX> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct InRange<const MIN: u32, const MAX: u32>;
        impl<const MIN: u32, const MAX: u32> Visitor<'_> for InRange<MIN, MAX> {
            type Value = IntegerIn<MIN, MAX>;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "an integer from {MIN} to {MAX}")
            }
            fn visit_i64<E: Error>(self, value: i64) -> Result<Self::Value, E> {
                u32::try_from(value).ok().and_then(IntegerIn::new).ok_or_else(|| {
                    E::custom(format!("expected an integer from {MIN} to {MAX}, found {value}"))
                })
            }
        }
        deserializer.deserialize_any(InRange::<MIN, MAX>)
    }
}

impl<const MIN: u32, const MAX: u32> Serialize for IntegerIn<MIN, MAX> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u32(self.0)
    }
}

impl<const MIN: u32, const MAX: u32> JsonSchema for IntegerIn<MIN, MAX> {
    fn schema_name() -> Cow<'static, str> {
        format!("IntegerFrom{MIN}To{MAX}").into()
    }
    fn inline_schema() -> bool {
        true
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "integer", "minimum": MIN, "maximum": MAX })
    }
}

struct NumberVisitor(&'static str);

impl Visitor<'_> for NumberVisitor {
    type Value = f64;
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0)
    }
    fn visit_f64<E: Error>(self, value: f64) -> Result<f64, E> {
        Ok(value)
    }
    fn visit_i64<E: Error>(self, value: i64) -> Result<f64, E> {
        Ok(value as f64)
    }
    fn visit_u64<E: Error>(self, value: u64) -> Result<f64, E> {
        Ok(value as f64)
    }
}

/// A point or a vector: three finite numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vector3(DVec3);

impl Vector3 {
    /// From components, which must be finite.
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Self(DVec3::new(x, y, z))
    }

    /// The components.
    pub const fn get(self) -> DVec3 {
        self.0
    }
}

impl<'de> Deserialize<'de> for Vector3 {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let [x, y, z] = deserializer.deserialize_seq(ArrayVisitor::<Finite, 3>::new())?;
        Ok(Self::new(x.get(), y.get(), z.get()))
    }
}

impl Serialize for Vector3 {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.to_array().serialize(serializer)
    }
}

impl JsonSchema for Vector3 {
    fn schema_name() -> Cow<'static, str> {
        "Vector3".into()
    }
    fn inline_schema() -> bool {
        true
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "array", "items": { "type": "number" }, "minItems": 3, "maxItems": 3 })
    }
}

/// A pair of finite numbers, such as texture coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vector2(DVec2);

impl Vector2 {
    /// From components, which must be finite.
    pub const fn new(x: f64, y: f64) -> Self {
        Self(DVec2::new(x, y))
    }

    /// The components.
    pub const fn get(self) -> DVec2 {
        self.0
    }
}

impl<'de> Deserialize<'de> for Vector2 {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let [x, y] = deserializer.deserialize_seq(ArrayVisitor::<Finite, 2>::new())?;
        Ok(Self::new(x.get(), y.get()))
    }
}

impl Serialize for Vector2 {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.to_array().serialize(serializer)
    }
}

impl JsonSchema for Vector2 {
    fn schema_name() -> Cow<'static, str> {
        "Vector2".into()
    }
    fn inline_schema() -> bool {
        true
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "array", "items": { "type": "number" }, "minItems": 2, "maxItems": 2 })
    }
}

/// A scale along two axes: one number for both, or a pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale2(DVec2);

impl Scale2 {
    /// The same factor along both axes.
    pub const fn splat(value: f64) -> Self {
        Self(DVec2::splat(value))
    }

    /// The factors.
    pub const fn get(self) -> DVec2 {
        self.0
    }
}

impl<'de> Deserialize<'de> for Scale2 {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let visitor = GreyOr::<Finite, 2>::new("a number or a pair of numbers");
        let [x, y] = deserializer.deserialize_any(visitor)?;
        Ok(Self(DVec2::new(x.get(), y.get())))
    }
}

impl Serialize for Scale2 {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        one_or_all(&self.0.to_array(), serializer)
    }
}

impl JsonSchema for Scale2 {
    fn schema_name() -> Cow<'static, str> {
        "Scale2".into()
    }
    fn inline_schema() -> bool {
        true
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [
            { "type": "number" },
            { "type": "array", "items": { "type": "number" }, "minItems": 2, "maxItems": 2 }
        ] })
    }
}

/// A colour, each channel at least 0: a number (grey) or three numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Color(Rgb);

impl Color {
    /// Grey; `value` must be finite and at least 0.
    pub const fn grey(value: f64) -> Self {
        Self(Rgb::splat(value))
    }

    /// The colour.
    pub const fn get(self) -> Rgb {
        self.0
    }
}

impl<'de> Deserialize<'de> for Color {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let visitor = GreyOr::<NonNegative, 3>::new("a colour: a number or three numbers");
        let [r, g, b] = deserializer.deserialize_any(visitor)?;
        Ok(Self(Rgb::new(r.get(), g.get(), b.get())))
    }
}

impl Serialize for Color {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        one_or_all(&self.0.to_array(), serializer)
    }
}

impl JsonSchema for Color {
    fn schema_name() -> Cow<'static, str> {
        "Color".into()
    }
    fn inline_schema() -> bool {
        true
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [
            { "type": "number", "minimum": 0 },
            { "type": "array", "items": { "type": "number", "minimum": 0 }, "minItems": 3, "maxItems": 3 }
        ] })
    }
}

/// A reference to a plugin: the id of a shared plugin, or an inline table. The scene crate hoists
/// inline tables beforehand and replaces them by [`inline_reference`].
#[derive(Clone, Debug, PartialEq)]
pub enum PluginRef {
    /// The id of a shared plugin.
    Shared(String),
    /// The number of a hoisted inline table.
    Inline(usize),
}

impl From<&str> for PluginRef {
    fn from(text: &str) -> Self {
        inline_index(text).map_or_else(|| Self::Shared(text.to_owned()), Self::Inline)
    }
}

impl Serialize for PluginRef {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Shared(id) => serializer.serialize_str(id),
            Self::Inline(index) => serializer.serialize_str(&inline_reference(*index)),
        }
    }
}

/// A colour parameter as written: a number, three numbers, the id of a shared texture, or an inline
/// texture. [`crate::Resources::texture`] turns it into a [`crate::ColorSource`].
#[derive(Clone, Debug)]
pub struct TextureRef {
    /// Position in the source; `None` for a default.
    pub span: Option<SourceSpan>,
    /// The value.
    pub value: TextureValue,
}

/// See [`TextureRef`].
#[derive(Clone, Debug, PartialEq)]
pub enum TextureValue {
    /// A constant colour.
    Constant(Rgb),
    /// A texture.
    Plugin(PluginRef),
}

impl TextureRef {
    /// A grey default.
    pub const fn grey(value: f64) -> Self {
        Self {
            span: None,
            value: TextureValue::Constant(Rgb::splat(value)),
        }
    }
}

impl<'de> Deserialize<'de> for TextureRef {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let value = Spanned::<TextureValue>::deserialize(deserializer)?;
        Ok(Self {
            span: Some(value.span()),
            value: value.into_inner(),
        })
    }
}

impl<'de> Deserialize<'de> for TextureValue {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct AnyTexture;
        impl<'de> Visitor<'de> for AnyTexture {
            type Value = TextureValue;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a colour, the id of a texture, or a table with a `type`")
            }
            fn visit_str<E: Error>(self, text: &str) -> Result<TextureValue, E> {
                Ok(TextureValue::Plugin(text.into()))
            }
            fn visit_f64<E: Error>(self, value: f64) -> Result<TextureValue, E> {
                let value = NonNegative::new(value)
                    .ok_or_else(|| E::custom(format!("expected a colour of at least 0, found {value}")))?;
                Ok(TextureValue::Constant(Rgb::splat(value.get())))
            }
            fn visit_i64<E: Error>(self, value: i64) -> Result<TextureValue, E> {
                self.visit_f64(value as f64)
            }
            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<TextureValue, A::Error> {
                let [r, g, b] = ArrayVisitor::<NonNegative, 3>::new().visit_seq(seq)?;
                Ok(TextureValue::Constant(Rgb::new(r.get(), g.get(), b.get())))
            }
        }
        deserializer.deserialize_any(AnyTexture)
    }
}

impl Serialize for TextureRef {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match &self.value {
            TextureValue::Constant(color) => one_or_all(&color.to_array(), serializer),
            TextureValue::Plugin(reference) => reference.serialize(serializer),
        }
    }
}

impl JsonSchema for TextureRef {
    fn schema_name() -> Cow<'static, str> {
        "TextureRef".into()
    }
    fn inline_schema() -> bool {
        true
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [
            { "type": "number", "minimum": 0 },
            { "type": "array", "items": { "type": "number", "minimum": 0 }, "minItems": 3, "maxItems": 3 },
            { "type": "string", "description": "id of a shared texture" },
            {
                "type": "object",
                "properties": { "type": { "type": "string" } },
                "required": ["type"],
                // The schema of whole scenes replaces this by the available types.
                "x-family": "texture"
            }
        ] })
    }
}

/// The path of a file, relative to the folder of the scene, with its position in the source. Its
/// key is always called `file`.
#[derive(Clone, Debug)]
pub struct FilePath {
    /// Position in the source.
    pub span: SourceSpan,
    /// As written.
    pub path: String,
}

impl<'de> Deserialize<'de> for FilePath {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let path = Spanned::<String>::deserialize(deserializer)?;
        Ok(Self {
            span: path.span(),
            path: path.into_inner(),
        })
    }
}

impl JsonSchema for FilePath {
    fn schema_name() -> Cow<'static, str> {
        "FilePath".into()
    }
    fn inline_schema() -> bool {
        true
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "string", "description": "path relative to the scene file" })
    }
}

/// Exactly N values.
struct ArrayVisitor<T, const N: usize>(std::marker::PhantomData<T>);

impl<T, const N: usize> ArrayVisitor<T, N> {
    fn new() -> Self {
        Self(std::marker::PhantomData)
    }
}

impl<'de, T: Deserialize<'de> + Copy, const N: usize> Visitor<'de> for ArrayVisitor<T, N> {
    type Value = [T; N];
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "an array of {N} numbers")
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<[T; N], A::Error> {
        let mut values = Vec::with_capacity(N);
        while let Some(value) = seq.next_element::<T>()? {
            // Further values are counted but not stored.
            if values.len() == N {
                return Err(A::Error::custom(format!(
                    "expected an array of {N} numbers, found more"
                )));
            }
            values.push(value);
        }
        let found = values.len();
        values
            .try_into()
            .map_err(|_| A::Error::custom(format!("expected an array of {N} numbers, found {found}")))
    }
}

/// One number for all N components, or exactly N numbers.
struct GreyOr<T, const N: usize> {
    expected: &'static str,
    array: ArrayVisitor<T, N>,
}

impl<T, const N: usize> GreyOr<T, N> {
    fn new(expected: &'static str) -> Self {
        Self {
            expected,
            array: ArrayVisitor::new(),
        }
    }
}

impl<'de, T: Deserialize<'de> + Copy, const N: usize> Visitor<'de> for GreyOr<T, N> {
    type Value = [T; N];
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.expected)
    }
    fn visit_f64<E: Error>(self, value: f64) -> Result<[T; N], E> {
        let deserializer: serde::de::value::F64Deserializer<E> =
            serde::de::IntoDeserializer::into_deserializer(value);
        Ok([T::deserialize(deserializer)?; N])
    }
    fn visit_i64<E: Error>(self, value: i64) -> Result<[T; N], E> {
        self.visit_f64(value as f64)
    }
    fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<[T; N], A::Error> {
        self.array.visit_seq(seq)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SceneErrors;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "only decoding is tested")]
    struct Ball {
        center: Vector3,
        radius: Positive,
        tint: Option<Color>,
        albedo: Option<TextureRef>,
    }

    fn decode_text(text: &str) -> Result<Ball, SceneErrors> {
        decode(&DeTable::parse(text).unwrap())
    }

    #[test]
    fn all_errors_of_a_table_are_reported_at_their_positions() {
        let text = "center = [0, nan, 0]\nradius = -1\nradios = 2\ntint = [1, 2]\n";
        let errors = decode_text(text).unwrap_err().0;
        let mut found: Vec<(&str, String)> = errors
            .iter()
            .map(|e| (&text[e.span.clone().unwrap()], e.message.clone()))
            .collect();
        found.sort();
        assert_eq!(found[0].0, "-1");
        assert_eq!(found[0].1, "expected a finite number greater than 0, found -1");
        assert_eq!(found[1].0, "[1, 2]");
        assert_eq!(found[2].0, "nan");
        assert_eq!(found[3].0, "radios");
        assert_eq!(found.len(), 4);
    }

    #[test]
    fn integers_count_as_numbers_and_missing_keys_are_named() {
        assert!(decode_text("center = [0, 1, 0]\nradius = 1\nalbedo = 1").is_ok());
        let errors = decode_text("radius = 1").unwrap_err();
        assert_eq!(errors.0[0].message, "missing key `center`");
    }

    #[test]
    fn inline_references_differ_from_ids() {
        assert_eq!(PluginRef::from("floor"), PluginRef::Shared("floor".into()));
        assert_eq!(
            PluginRef::from(inline_reference(7).as_str()),
            PluginRef::Inline(7)
        );
    }
}
