//! A ray tracer of textbook formulas, in the precision `R`, for balls in the light of a sun.
//!
//! The rays of the camera are Whitstone's, rounded. All else is computed in `R`.

use crate::readme::build;
use std::path::Path;
use toml::{Table, Value};
use whitstone::Failure;
use whitstone::core::Registry;
use whitstone::image::{Image, Raster, ToneMap};
use whitstone::scene::{Description, Sources};
use whitstone_oracle::naive::{Real, Textbook, Vector, textbook};

const AXES: [usize; 3] = [0, 1, 2];

/// A ball.
struct Ball<R> {
    shape: Box<dyn Textbook<R>>,
    center: Vector<R>,
    reflectance: [f64; 3],
}

/// A scene: its lights are a directional one, ambient light and a background.
struct Scene<R> {
    balls: Vec<Ball<R>>,
    /// Unit vector towards the sun.
    sun: Vector<R>,
    irradiance: [f64; 3],
    ambient: [f64; 3],
    background: [f64; 3],
}

/// The picture of a scene.
pub(super) fn picture<R: Real>(registry: &Registry, path: &Path) -> Result<Raster, Failure> {
    let scene = Scene::<R>::read(registry, path)?;
    let pipeline = build(registry, path, &[])?;
    let size = pipeline.film.size;
    let image = Image::from_fn(size.width as usize, size.height as usize, |x, y| {
        let ray = pipeline.camera_ray([x as u32, y as u32], 0);
        let [origin, direction] = [ray.origin, ray.direction].map(|v| v.to_array().map(R::of));
        scene.radiance(origin, direction).map(|value| value as f32)
    });
    let image = image.map_err(Failure::usage)?;
    Raster::preview(&image, ToneMap::default()).map_err(Failure::usage)
}

impl<R: Real> Scene<R> {
    fn read(registry: &Registry, path: &Path) -> Result<Self, Failure> {
        let sources = Sources::load(path, &[], registry)
            .map_err(|error| Failure::usage(error.sources.report(&error.errors, false)))?;
        let report = |errors| Failure::usage(sources.report(&errors, false));
        let description = Description::parse(&sources).into_result().map_err(report)?;
        let text = std::fs::read_to_string(path).map_err(Failure::environment)?;
        let document: Table = toml::from_str(&text).map_err(Failure::usage)?;
        let other = |what: &str| Failure::usage(format!("{}: expected {what}", path.display()));
        let tables = |key: &str| {
            document
                .get(key)
                .and_then(Value::as_array)
                .cloned()
                .unwrap_or_default()
        };
        let [mut direction, mut irradiance, mut ambient, mut background] = [[0.0; 3]; 4];
        for light in tables("light") {
            match light["type"].as_str() {
                Some("directional") => {
                    direction = color(light.get("direction"));
                    irradiance = color(light.get("irradiance"));
                }
                Some("ambient") => ambient = color(light.get("radiance")),
                Some("background") => background = color(light.get("radiance")),
                _ => return Err(other("lights that are directional, ambient or background")),
            }
        }
        let mut balls = Vec::new();
        for (number, shape) in tables("shape").iter().enumerate() {
            if shape["type"].as_str() != Some("sphere") || shape.get("transform").is_some() {
                return Err(other("spheres without a transform"));
            }
            balls.push(Ball {
                shape: textbook(&description, number).map_err(report)?,
                center: color(shape.get("center")).map(R::of),
                reflectance: color(
                    shape
                        .get("material")
                        .and_then(|material| material.get("reflectance")),
                ),
            });
        }
        Ok(Self {
            balls,
            sun: unit(direction.map(|part| R::of(-part))),
            irradiance,
            ambient,
            background,
        })
    }

    /// The nearest ball, and the ray parameter of its hit.
    fn nearest(&self, origin: Vector<R>, direction: Vector<R>) -> Option<(R, &Ball<R>)> {
        let balls = self.balls.iter();
        let hits = balls.filter_map(|ball| Some((ball.shape.intersect(origin, direction)?, ball)));
        hits.reduce(|a, b| if b.0 < a.0 { b } else { a })
    }

    fn radiance(&self, origin: Vector<R>, direction: Vector<R>) -> [f64; 3] {
        let Some((t, ball)) = self.nearest(origin, direction) else {
            return self.background;
        };
        let place = AXES.map(|axis| origin[axis] + t * direction[axis]);
        let normal = unit(AXES.map(|axis| place[axis] - ball.center[axis]));
        let cosine = dot(normal, self.sun).to_f64().max(0.0);
        // An offset in proportion to the coordinates, as robust textbook code has it, and as large
        // as that of `stress`.
        let size = |most: R, axis: &usize| {
            if place[*axis].abs() > most {
                place[*axis].abs()
            } else {
                most
            }
        };
        let offset = R::of(1024.0 * R::EPSILON) * AXES.iter().fold(R::of(0.0), size);
        let start = AXES.map(|axis| place[axis] + offset * self.sun[axis]);
        let lit = cosine > 0.0 && self.nearest(start, self.sun).is_none();
        AXES.map(|axis| {
            let sun = if lit {
                cosine * self.irradiance[axis] / std::f64::consts::PI
            } else {
                0.0
            };
            ball.reflectance[axis] * (self.ambient[axis] + sun)
        })
    }
}

fn dot<R: Real>(a: Vector<R>, b: Vector<R>) -> R {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit<R: Real>(v: Vector<R>) -> Vector<R> {
    let length = dot(v, v).sqrt();
    v.map(|part| part / length)
}

/// Three numbers, or one that counts for all three; 0 where there is none.
fn color(value: Option<&Value>) -> [f64; 3] {
    let number = |value: &Value| value.as_float().or(value.as_integer().map(|value| value as f64));
    match value {
        Some(Value::Array(parts)) => AXES.map(|axis| parts.get(axis).and_then(number).unwrap_or(0.0)),
        Some(value) => [number(value).unwrap_or(0.0); 3],
        None => [0.0; 3],
    }
}
