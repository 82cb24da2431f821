//! Questions that single precision cannot tell from the one that was asked.
//!
//! A renderer in single precision rounds the numbers of the scene when it reads them, and every
//! result of its arithmetic. Backward error analysis attributes all of it to the input: the answer
//! is exact for a scene and for rays that differ by a few units in the last place. The coordinates
//! of a point are moved by units of the largest of them, because transforms mix them. Factors of a
//! scale are moved by their own units.

use std::path::PathBuf;
use std::sync::OnceLock;
use std::time::Instant;
use toml::Value as Number;
use whitstone_oracle::tracer::{Care, Tracer, Value};
use whitstone_scene::{Description, Flattened, Sources};
use whitstone_testkit::Random;

/// Number of changed scenes.
const SCENES: u64 = 32;
/// The largest change of a number of the scene: the rounding of the number itself, and those of a
/// few operations on it, such as the product of two transforms.
const SCENE_ULPS: f64 = 4.0;
/// The largest change of points and directions of rays, as for [`crate::Sample::excused`].
const RAY_ULPS: f64 = 16.0;
/// Number of changes of the rays of each size. Where a shape is as small as the roundings of its
/// place, about one in twenty changes meets it.
const REPEATS: u64 = 128;
/// Smaller changes are tried too, each a half or a quarter of the one before: far from the origin,
/// the largest one leads far past a shape that the roundings of a renderer still hit.
const SIZES: i32 = 4;
/// A unit in the last place of single precision in those of double precision.
const ULP: f64 = f32::EPSILON as f64 / f64::EPSILON;
/// Tables whose numbers are not those of geometry or light.
const EXACT: [&str; 4] = ["film", "sampler", "integrator", "expect"];

/// The scene as it is, and changed scenes, which are made when they are first needed.
pub(crate) struct Questions<'a> {
    text: &'a str,
    base: PathBuf,
    exact: &'a Tracer,
    changed: OnceLock<Vec<Tracer>>,
}

impl<'a> Questions<'a> {
    pub(crate) fn new(scene: &'a Flattened, exact: &'a Tracer) -> Self {
        Self {
            text: &scene.text,
            base: scene.base.clone(),
            exact,
            changed: OnceLock::new(),
        }
    }

    /// All values that a pixel takes; none if the oracle cannot decide one of the questions.
    pub(crate) fn answers(&self, pixel: [u32; 2], deadline: Instant) -> Option<Vec<[f64; 3]>> {
        let changed = self.changed.get_or_init(|| {
            let made = (1..=SCENES).map(|seed| self.change(seed));
            made.collect::<Option<_>>().unwrap_or_default()
        });
        if changed.is_empty() {
            return None;
        }
        let care = |repeats, ulps: f64| Care {
            repeats,
            ulps: ulps * ULP,
        };
        let exact = (0..SIZES).map(|size| (self.exact, care(REPEATS, RAY_ULPS * 0.25_f64.powi(size))));
        let changed = changed.iter().map(|tracer| (tracer, care(2, 1.0)));
        let mut values = Vec::new();
        for (tracer, care) in exact.chain(changed) {
            match tracer.pixel_before(pixel, care, deadline) {
                Value::Known { seen, .. } => values.extend(seen),
                Value::Unknown(_) => return None,
            }
        }
        Some(values)
    }

    /// A changed scene; none if the change makes it invalid.
    fn change(&self, seed: u64) -> Option<Tracer> {
        let mut table: toml::Table = self.text.parse().ok()?;
        let mut change = Change {
            random: Random::new(seed),
            ulps: SCENE_ULPS * 0.5_f64.powi(seed as i32 % SIZES),
        };
        for (key, value) in &mut table {
            if !EXACT.contains(&key.as_str()) {
                change.apply(key, value);
            }
        }
        let text = toml::to_string(&table).ok()?;
        let sources = Sources::from_text("stress", &text, &self.base, &[]).ok()?;
        let description = Description::parse(&sources).into_result().ok()?;
        Tracer::new(&description).ok()
    }
}

fn number(value: &Number) -> Option<f64> {
    let whole = value.as_integer().map(|whole| whole as f64);
    value.as_float().or(whole)
}

/// A random change of at most `ulps` units in the last place of single precision.
struct Change {
    random: Random,
    ulps: f64,
}

impl Change {
    fn moved(&mut self, value: f64, size: f64) -> f64 {
        value + self.random.signed() * self.ulps * f64::from(f32::EPSILON) * size
    }

    /// Changes all numbers of a value. A whole number that is not a coordinate counts something.
    fn apply(&mut self, key: &str, value: &mut Number) {
        match value {
            Number::Float(float) => *float = self.moved(*float, float.abs()),
            Number::Table(table) => {
                for (key, value) in table {
                    self.apply(key, value);
                }
            }
            Number::Array(parts) => {
                let numbers: Option<Vec<f64>> = parts.iter().map(number).collect();
                let Some(numbers) = numbers.filter(|numbers| numbers.len() == 3) else {
                    for part in parts {
                        self.apply(key, part);
                    }
                    return;
                };
                let largest = numbers.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
                for (part, value) in parts.iter_mut().zip(numbers) {
                    let size = if key == "scale" { value.abs() } else { largest };
                    *part = Number::Float(self.moved(value, size));
                }
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_move_by_units_of_their_point() {
        let text = "film = { width = 8 }\nradius = 2.0\ndepth = 3\ncenter = [0, 1e6, 1]\n\
                    transform = [{ scale = [1e-6, 1, 1e6] }, { translate = [0.5, 0, 0] }]\n";
        let mut table: toml::Table = text.parse().unwrap();
        let before = table.clone();
        let mut change = Change {
            random: Random::new(1),
            ulps: SCENE_ULPS,
        };
        for (key, value) in &mut table {
            if !EXACT.contains(&key.as_str()) {
                change.apply(key, value);
            }
        }
        let most = SCENE_ULPS * f64::from(f32::EPSILON);
        let check = |before: &Number, after: &Number, size: f64| {
            let change = (number(after).unwrap() - number(before).unwrap()).abs();
            assert!(change > 0.0 && change <= most * size * 1.001, "{before} {after}");
        };
        check(&before["radius"], &table["radius"], 2.0);
        assert_eq!(
            (&table["depth"], &table["film"]),
            (&before["depth"], &before["film"])
        );
        for axis in 0..3 {
            check(&before["center"][axis], &table["center"][axis], 1e6);
            let [scale, by] = [0, 1].map(|step| (&before["transform"][step], &table["transform"][step]));
            let own = number(&scale.0["scale"][axis]).unwrap();
            check(&scale.0["scale"][axis], &scale.1["scale"][axis], own);
            check(&by.0["translate"][axis], &by.1["translate"][axis], 0.5);
        }
    }

    /// A shadow whose edge lies in the pixel to within single precision takes both values; farther
    /// inside, it is dark only.
    #[test]
    fn only_edges_take_several_values() {
        let scene = |gap: f64| {
            format!(
                "film = {{ width = 1, height = 1 }}\n\
                 camera = {{ type = \"perspective\", fov = 1, look_at = {{ origin = [0, -1, 1], target = [0, 0, 0], up = [0, 0, 1] }} }}\n\
                 [[light]]\ntype = \"directional\"\ndirection = [0, 0, -1]\nirradiance = 1\n\
                 [[shape]]\ntype = \"rectangle\"\n\
                 [[shape]]\ntype = \"rectangle\"\ntransform = {{ translate = [{:?}, 0, 2] }}\n",
                1.0 - gap
            )
        };
        let values = |gap: f64| {
            let text = scene(gap);
            let sources = Sources::from_text("stress", &text, std::path::Path::new("."), &[]).unwrap();
            let description = Description::parse(&sources).into_result().unwrap();
            let tracer = Tracer::new(&description).unwrap();
            let flattened = whitstone_validate::flatten_sources(&sources).unwrap();
            let questions = Questions::new(&flattened, &tracer);
            let deadline = Instant::now() + std::time::Duration::from_secs(60);
            let mut values = questions.answers([0, 0], deadline).unwrap();
            values.sort_by(|a, b| a[0].total_cmp(&b[0]));
            [values[0][0], values[values.len() - 1][0]]
        };
        let [dark, bright] = values(1e-8);
        assert!(dark == 0.0 && bright > 0.1, "{dark} {bright}");
        assert_eq!(values(1e-4), [0.0, 0.0]);
        let lit = values(-1e-4);
        assert!(lit[0] > 0.1, "{lit:?}");
    }
}
