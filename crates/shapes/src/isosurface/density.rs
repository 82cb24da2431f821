//! Sources of density values.

use super::{Config, Format, Generator};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::borrow::Cow;
use std::fmt;
use whitstone_core::config::Finite;
use whitstone_core::hash::mix;
use whitstone_core::{Context, DVec3, SceneError, SceneErrors, SourceSpan};

/// A list of finite numbers.
#[derive(Debug)]
pub(super) struct Values(Vec<f64>);

impl<'de> Deserialize<'de> for Values {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct List;
        impl<'de> Visitor<'de> for List {
            type Value = Values;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an array of numbers")
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Values, A::Error> {
                let mut values = Vec::new();
                while let Some(value) = seq.next_element::<Finite>()? {
                    values.push(value.get());
                }
                Ok(Values(values))
            }
        }
        deserializer.deserialize_seq(List)
    }
}

impl JsonSchema for Values {
    fn schema_name() -> Cow<'static, str> {
        "Values".into()
    }
    fn inline_schema() -> bool {
        true
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "array", "items": { "type": "number" } })
    }
}

/// The values at all vertices, x fastest: finite, and as many as `size` requires.
pub(super) fn read(
    config: Config,
    size: [usize; 3],
    context: &mut dyn Context,
) -> Result<Vec<f64>, SceneErrors> {
    let mut errors = SceneErrors::default();
    let count = size.iter().product::<usize>();
    let [x, y, z] = size;
    let expected = format!("{count} values for a grid of {x} x {y} x {z}");
    let mut refuse = |span: SourceSpan, message: &str| errors.0.push(SceneError::at(span, message));
    if let (Some(format), None) = (&config.format, &config.file) {
        refuse(format.span(), "`format` needs a `file`");
    }
    if let (Some(seed), None) = (&config.seed, &config.generator) {
        refuse(seed.span(), "`seed` needs a `generator`");
    }
    let metaballs = config
        .generator
        .as_ref()
        .is_some_and(|g| *g.get_ref() == Generator::Metaballs);
    if let (Some(balls), false) = (&config.balls, metaballs) {
        refuse(balls.span(), "`balls` needs the generator \"metaballs\"");
    }
    let sources = [
        config.values.as_ref().map(|values| values.span()),
        config.file.as_ref().map(|file| file.span.clone()),
        config.generator.as_ref().map(|generator| generator.span()),
    ];
    for second in sources.into_iter().flatten().skip(1) {
        refuse(
            second,
            "more than one source of values: expected one of `values`, `file` and `generator`",
        );
    }
    errors.into_result(())?;
    if let Some(values) = config.values {
        let (span, Values(values)) = (values.span(), values.into_inner());
        if values.len() == count {
            return Ok(values);
        }
        return Err(SceneError::at(span, format!("expected {expected}, found {}", values.len())).into());
    }
    if let Some(file) = config.file {
        let format = config.format.map(|format| *format.get_ref()).unwrap_or_default();
        let path = context.file(&file)?;
        let error = |text: String| {
            SceneErrors::from(SceneError::at(
                file.span.clone(),
                format!("{}: {text}", file.path),
            ))
        };
        // Check the length before reading the file, which may be arbitrarily large.
        let length = std::fs::metadata(&path).map_or(0, |metadata| metadata.len());
        let bytes_each = if format == Format::F32 { 4 } else { 1 };
        if length != bytes_each * count as u64 {
            return Err(error(format!(
                "expected {expected}, {} bytes, found {length} bytes",
                bytes_each * count as u64
            )));
        }
        let bytes = std::fs::read(&path).map_err(|e| error(format!("cannot be read: {e}")))?;
        return decode(&bytes, format).map_err(error);
    }
    let Some(generator) = config.generator else {
        let message = "no values: expected one of `values`, `file` and `generator`";
        return Err(SceneError::anywhere(message).into());
    };
    let seed = config.seed.map_or(0, |seed| seed.get_ref().get());
    Ok(match generator.into_inner() {
        Generator::Noise => noise(size, seed),
        Generator::Metaballs => metaballs_of(
            size,
            seed,
            config
                .balls
                .map_or(super::DEFAULT_BALLS, |balls| balls.get_ref().get()),
        ),
    })
}

fn decode(bytes: &[u8], format: Format) -> Result<Vec<f64>, String> {
    let values: Vec<f64> = match format {
        Format::U8 => bytes.iter().map(|byte| f64::from(*byte)).collect(),
        Format::F32 => bytes
            .chunks_exact(4)
            .map(|four| f64::from(f32::from_le_bytes([four[0], four[1], four[2], four[3]])))
            .collect(),
    };
    match values.iter().position(|value| !value.is_finite()) {
        Some(number) => Err(format!(
            "value number {number} is {}, expected a finite number",
            values[number]
        )),
        None => Ok(values),
    }
}

/// Maps a hash to [0, 1).
fn unit(hash: u32) -> f64 {
    f64::from(hash) / 2f64.powi(32)
}

fn noise([nx, ny, nz]: [usize; 3], seed: u32) -> Vec<f64> {
    let mut values = Vec::with_capacity(nx * ny * nz);
    for k in 0..nz as u32 {
        for j in 0..ny as u32 {
            for i in 0..nx as u32 {
                let of_i = mix(seed.wrapping_add(i));
                values.push(unit(mix(mix(of_i.wrapping_add(j)).wrapping_add(k))));
            }
        }
    }
    values
}

fn metaballs_of(size: [usize; 3], seed: u32, balls: u32) -> Vec<f64> {
    let mut values = vec![0.0; size.iter().product()];
    let place = |axis: usize, i: usize| 2.0 * i as f64 / (size[axis] - 1) as f64 - 1.0;
    for ball in 0..balls {
        let random = |a: u32| unit(mix(mix(seed.wrapping_add(mix(ball))).wrapping_add(a)));
        let center = DVec3::new(random(0) - 0.5, random(1) - 0.5, random(2) - 0.5);
        let radius = 0.3 + 0.15 * random(3);
        // Only the vertices within the radius.
        let near =
            |axis: usize| (0..size[axis]).filter(move |i| (place(axis, *i) - center[axis]).abs() <= radius);
        for k in near(2) {
            for j in near(1) {
                for i in near(0) {
                    let p = DVec3::new(place(0, i), place(1, j), place(2, k));
                    let inside = 1.0 - (p - center).length_squared() / (radius * radius);
                    if inside > 0.0 {
                        values[i + size[0] * (j + size[1] * k)] += inside * inside;
                    }
                }
            }
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn generators_give_what_the_model_says() {
        let found = noise([2, 3, 2], 5);
        let expected = unit(mix(mix(mix(6).wrapping_add(2)).wrapping_add(1)));
        assert_eq!(found[11], expected);
        // The value of a single metaball at a vertex.
        let found = metaballs_of([9, 9, 9], 7, 1);
        let random = |a: u32| f64::from(mix(mix(7 + mix(0)).wrapping_add(a))) / 4294967296.0;
        let p = [4, 3, 5].map(|i: i32| f64::from(i) / 4.0 - 1.0);
        let squared: f64 = (0..3).map(|a| (p[a] - (random(a as u32) - 0.5)).powi(2)).sum();
        let radius = 0.3 + 0.15 * random(3);
        let expected = (1.0 - squared / radius.powi(2)).max(0.0).powi(2);
        assert!((found[4 + 9 * (3 + 9 * 5)] - expected).abs() < 1e-15);
        assert!(found.iter().any(|value| *value > 0.3));
        // No metaball reaches the border.
        let edge = |i: usize| {
            [0, 8].contains(&(i % 9)) || [0, 8].contains(&(i / 9 % 9)) || [0, 8].contains(&(i / 81))
        };
        let all = metaballs_of([9, 9, 9], 1, 64);
        assert!(all.iter().enumerate().all(|(i, value)| !edge(i) || *value == 0.0));
    }

    #[test]
    fn files_are_decoded_and_not_a_number_is_named() {
        assert_eq!(decode(&[0, 7, 255], Format::U8).unwrap(), [0.0, 7.0, 255.0]);
        let bytes: Vec<u8> = [1.5f32, f32::NAN].iter().flat_map(|f| f.to_le_bytes()).collect();
        assert_eq!(decode(&bytes[..4], Format::F32).unwrap(), [1.5]);
        let message = decode(&bytes, Format::F32).unwrap_err();
        assert_eq!(message, "value number 1 is NaN, expected a finite number");
    }
}
