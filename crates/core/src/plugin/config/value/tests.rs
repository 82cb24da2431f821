use super::*;
use crate::config::{Finite, PluginRef, Positive, TextureRef, Vector3, inline_reference};
use serde::Deserialize;
use serde::de::{DeserializeOwned, IgnoredAny};
use std::collections::BTreeMap;

#[derive(Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Field {
    Empty,
    Sphere(Ball),
    Union(Vec<Field>),
    Plane { offset: Finite },
    Pair(Finite, Finite),
}

#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Ball {
    radius: Positive,
    name: Option<String>,
}

#[derive(Debug, PartialEq, Deserialize)]
#[serde(expecting = "a face: a table with `file`")]
struct Face {
    file: String,
}

#[derive(Debug, PartialEq, Deserialize)]
#[serde(untagged, expecting = "expected a number or a ball")]
enum Untagged {
    Number(Finite),
    Ball(Ball),
}

#[derive(Debug, PartialEq, Deserialize)]
#[serde(tag = "kind")]
enum Tagged {
    Ball(Ball),
}

#[derive(Debug, PartialEq, Deserialize)]
struct Newtype(f64);

/// The value of `x` in a document.
fn read<T: DeserializeOwned>(text: &str) -> Result<T, Error> {
    let table = DeTable::parse(text).unwrap();
    Value::from(&table.get_ref()["x"]).read(std::marker::PhantomData)
}

/// The error of `x = VALUE`, with the text at its position.
fn fault<T: DeserializeOwned + fmt::Debug>(value: &str) -> (Fault, String) {
    let text = format!("x = {value}");
    let error = read::<T>(&text).unwrap_err();
    (error.fault, text[error.span.unwrap()].to_owned())
}

/// The message of `x = VALUE`, with the text at its position.
fn message<T: DeserializeOwned + fmt::Debug>(value: &str) -> (String, String) {
    let (fault, place) = fault::<T>(value);
    (Error::from(fault).to_string(), place)
}

fn at(message: &str, place: &str) -> (String, String) {
    (message.to_owned(), place.to_owned())
}

fn wrong(found: &str, expected: &str, place: &str) -> (Fault, String) {
    (Error::wrong_type(found, expected).fault, place.to_owned())
}

#[test]
fn values_of_all_types() {
    assert_eq!(read::<String>("x = 'a'").unwrap(), "a");
    assert!(read::<bool>("x = true").unwrap());
    assert_eq!(read::<f64>("x = -2.5").unwrap(), -2.5);
    assert_eq!(read::<f64>("x = -inf").unwrap(), f64::NEG_INFINITY);
    assert!(read::<f64>("x = +nan").unwrap().is_nan());
    assert_eq!(read::<f64>("x = 2").unwrap(), 2.0);
    assert_eq!(read::<i64>("x = 0xff").unwrap(), 255);
    assert_eq!(read::<i128>("x = -1").unwrap(), -1);
    assert_eq!(read::<u64>("x = 18446744073709551615").unwrap(), u64::MAX);
    assert_eq!(read::<Newtype>("x = 1.5").unwrap(), Newtype(1.5));
    assert_eq!(read::<Option<u8>>("x = 1").unwrap(), Some(1));
    assert_eq!(read::<(u8, String)>("x = [1, 'a']").unwrap(), (1, "a".to_owned()));
    assert_eq!(
        read::<Vec<[u8; 2]>>("x = [[1, 2], [3, 4]]").unwrap(),
        [[1, 2], [3, 4]]
    );
    assert_eq!(
        read::<BTreeMap<String, u8>>("x = { a = 1 }").unwrap(),
        BTreeMap::from([("a".to_owned(), 1)])
    );
    for ignored in ["1", "'a'", "[1]", "{ a = 1 }", "2020-01-01", "1e999"] {
        read::<IgnoredAny>(&format!("x = {ignored}")).unwrap();
    }
}

#[test]
fn wrong_types_have_the_span_of_the_value() {
    assert_eq!(
        fault::<Finite>("'a'"),
        wrong("string \"a\"", "a finite number", "'a'")
    );
    assert_eq!(
        fault::<bool>("2.5"),
        wrong("floating point `2.5`", "a boolean", "2.5")
    );
    assert_eq!(fault::<String>("[1]"), wrong("an array", "a string", "[1]"));
    assert_eq!(
        fault::<String>("{ a = 1 }"),
        wrong("a table", "a string", "{ a = 1 }")
    );
    assert_eq!(
        fault::<Finite>("2020-01-01"),
        wrong("a date", "a finite number", "2020-01-01")
    );
    let large = "18446744073709551616";
    assert_eq!(
        fault::<Finite>(large),
        wrong("integer `18446744073709551616`", "a finite number", large)
    );
}

#[test]
fn expected_types_are_those_of_toml() {
    assert_eq!(fault::<Vec<u8>>("1"), wrong("integer `1`", "an array", "1"));
    assert_eq!(
        fault::<BTreeMap<String, u8>>("1"),
        wrong("integer `1`", "a table", "1")
    );
    assert_eq!(fault::<Ball>("1"), wrong("integer `1`", "a table", "1"));
    assert_eq!(fault::<Ball>("[1]"), wrong("an array", "a table", "[1]"));
    assert_eq!(
        fault::<Face>("1"),
        wrong("integer `1`", "a face: a table with `file`", "1")
    );
    assert_eq!(
        fault::<Field>("1"),
        wrong("integer `1`", "one of empty, sphere, union, plane, pair", "1")
    );
    assert_eq!(
        fault::<Vector3>("1"),
        wrong("integer `1`", "an array of 3 numbers", "1")
    );
}

#[test]
fn errors_of_elements_have_the_span_of_the_element() {
    let number = "expected a finite number, found NaN";
    assert_eq!(
        message::<Vec<Vec<Finite>>>("[[0], [1, 2, nan]]"),
        at(number, "nan")
    );
    assert_eq!(message::<[[Finite; 3]; 1]>("[[1, 2, nan]]"), at(number, "nan"));
    assert_eq!(message::<Vec<Vector3>>("[[1, 2, nan]]"), at(number, "nan"));
    assert_eq!(
        fault::<Vec<Vec<u8>>>("[[1], 2]"),
        wrong("integer `2`", "an array", "2")
    );
    let radius = "[{ radius = 1 }, { radius = -1 }]";
    let expected = "expected a finite number greater than 0, found -1";
    assert_eq!(message::<Vec<Ball>>(radius), at(expected, "-1"));
}

#[test]
fn arrays_have_exactly_their_length() {
    let few = "invalid length 2, expected an array of length 3";
    let many = "invalid length 4, expected an array of length 3";
    assert_eq!(message::<[u8; 3]>("[1, 2]"), at(few, "[1, 2]"));
    assert_eq!(message::<[u8; 3]>("[1, 2, 3, 4]"), at(many, "[1, 2, 3, 4]"));
    let more = "expected an array of 3 numbers, found more";
    assert_eq!(
        message::<Vec<Vector3>>("[[1, 2, 3, 4]]"),
        at(more, "[1, 2, 3, 4]")
    );
}

#[test]
fn invalid_values_have_the_span_of_the_value() {
    let range = "invalid value: integer `300`, expected u8";
    assert_eq!(message::<Vec<u8>>("[300]"), at(range, "300"));
    assert_eq!(
        message::<f64>("1e999"),
        at("floating-point number overflowed", "1e999")
    );
}

#[test]
fn unknown_keys_have_the_span_of_the_key() {
    let known: &[&str] = &["radius", "name"];
    let key = "radios".to_owned();
    let unknown = Fault::UnknownKey { key, known };
    assert_eq!(unknown.help().unwrap(), "did you mean `radius`?");
    assert_eq!(
        fault::<Vec<Ball>>("[{ radius = 1, radios = 2 }]"),
        (unknown, "radios".into())
    );
}

#[test]
fn missing_keys_have_the_span_of_the_table() {
    let missing = (Fault::MissingKey("radius"), "{ name = 'a' }".to_owned());
    assert_eq!(fault::<Vec<Ball>>("[{ name = 'a' }]"), missing);
    assert_eq!(fault::<Option<Spanned<Ball>>>("{ name = 'a' }"), missing);
    assert_eq!(fault::<Field>("{ sphere = { name = 'a' } }"), missing);
    let either = Error::missing_field("a or b");
    assert_eq!(either.to_string(), "missing key `a` or `b`");
    assert_eq!(either.fault.missing_keys().collect::<Vec<_>>(), ["a", "b"]);
    assert_eq!(Error::missing_field("a").to_string(), "missing key `a`");
}

#[test]
fn duplicate_keys() {
    assert_eq!(Error::duplicate_field("a").to_string(), "duplicate key `a`");
}

#[test]
fn enums_of_texts_and_tables() {
    let finite = |x| Finite::new(x).unwrap();
    assert_eq!(read::<Field>("x = 'empty'").unwrap(), Field::Empty);
    assert_eq!(
        read::<Field>("x = { union = ['empty', { plane = { offset = 1 } }, { pair = [2, 3] }] }").unwrap(),
        Field::Union(vec![
            Field::Empty,
            Field::Plane { offset: finite(1.0) },
            Field::Pair(finite(2.0), finite(3.0)),
        ])
    );
    let (unknown, place) = fault::<Field>("{ union = ['empti'] }");
    assert_eq!(unknown.help().unwrap(), "did you mean \"empty\"?");
    assert_eq!(Error::from(unknown).to_string(), "unknown value \"empti\"");
    assert_eq!(place, "'empti'");
    let (unknown, place) = fault::<Field>("{ ball = {} }");
    let all = "known values are empty, sphere, union, plane, pair";
    assert_eq!(unknown.help().unwrap(), all);
    assert_eq!(place, "ball");
    for (value, found, expected, place) in [
        (
            "'sphere'",
            "string \"sphere\"",
            "a table with the key `sphere`",
            "'sphere'",
        ),
        ("{ empty = 1 }", "a table", "a text", "{ empty = 1 }"),
        ("{ union = 1 }", "integer `1`", "an array", "1"),
        ("{ plane = 1 }", "integer `1`", "a table", "1"),
        ("{ pair = 'a' }", "string \"a\"", "an array", "'a'"),
    ] {
        assert_eq!(fault::<Field>(value), wrong(found, expected, place), "{value}");
    }
    let two = "{ empty = {}, sphere = {} }";
    let message = message::<Field>(two);
    assert_eq!(message, at("expected a table with exactly one key, found 2", two));
}

#[test]
fn buffered_values_lose_the_inner_span() {
    assert_eq!(
        read::<Untagged>("x = 1").unwrap(),
        Untagged::Number(Finite::new(1.0).unwrap())
    );
    assert!(matches!(read("x = { radius = 1 }"), Ok(Untagged::Ball(_))));
    for value in ["'a'", "nan", "{ radius = -1 }", "2020-01-01", "[2]"] {
        let expected = at("expected a number or a ball", value);
        assert_eq!(message::<Untagged>(value), expected);
    }
    assert!(matches!(
        read("x = { kind = 'Ball', radius = 1 }"),
        Ok(Tagged::Ball(_))
    ));
    let value = "{ kind = 'Ball', radius = 'a' }";
    let expected = wrong("string \"a\"", "a finite number greater than 0", value);
    assert_eq!(fault::<Tagged>(value), expected);
}

#[test]
fn inline_plugins_are_tables_with_a_type() {
    let inline = format!("{:?}", inline_reference(3)).replace("\\u{1}", "\\u0001");
    let albedo: TextureRef = read(&format!("x = {inline}")).unwrap();
    assert!(matches!(
        albedo.value,
        crate::config::TextureValue::Plugin(PluginRef::Inline(3))
    ));
    let table = "a table with `type`";
    assert_eq!(
        fault::<Vector3>(&inline),
        wrong(table, "an array of 3 numbers", &inline)
    );
    let expected = at(&format!("wrong type: {table}, expected a text"), &inline);
    assert_eq!(message::<Field>(&inline), expected);
}

/// `serde_spanned` recognizes `toml::Spanned` by private names. They differ if `toml` changes to
/// another version of it.
#[test]
fn spans_of_values_and_keys() {
    type Deep = Spanned<Option<Spanned<Vec<Spanned<BTreeMap<Spanned<String>, Spanned<u8>>>>>>>;
    let text = "x = [{}, { key = 7 }]";
    let deep: Deep = read(text).unwrap();
    assert_eq!(&text[deep.span()], "[{}, { key = 7 }]");
    let array = deep.into_inner().unwrap();
    assert_eq!(&text[array.span()], "[{}, { key = 7 }]");
    let table = &array.get_ref()[1];
    assert_eq!(&text[table.span()], "{ key = 7 }");
    let (key, value) = table.get_ref().first_key_value().unwrap();
    assert_eq!((&text[key.span()], &text[value.span()]), ("key", "7"));
    assert_eq!((key.get_ref().as_str(), *value.get_ref()), ("key", 7));
}
