//! The requests and answers of `references/mitsuba/PROTOCOL.md` as types.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::Path;

/// The settings of the reference's tracer: see the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Setting {
    /// Spawn offset in units of 2^-24 (1 + max |p|).
    pub k: f64,
    /// Embree's robust intersections.
    pub robust: bool,
    /// Shift of the sample positions to the right, in pixels.
    pub dx: f64,
    /// Shift downwards, in pixels.
    pub dy: f64,
    /// Perturbation of every ray, in units of 2^-24.
    pub ulps: f64,
    /// Seed of the perturbation and of the rounding of vertices.
    pub seed: u32,
    /// Whether the numbers of meshes are rounded to single precision in a random direction instead
    /// of to the nearest.
    pub vertices: bool,
    /// Whether a perturbation is in units of the largest component of its vector instead of each
    /// component. Mitsuba only.
    #[serde(skip_serializing_if = "is_false")]
    pub largest: bool,
    /// Factor on all light, divided out of the image again. POV-Ray only, whose images have half
    /// precision.
    #[serde(skip_serializing_if = "is_one")]
    pub exposure: f64,
}

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "serde calls it with a reference"
)]
fn is_one(number: &f64) -> bool {
    *number == 1.0
}

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "serde calls it with a reference"
)]
fn is_false(value: &bool) -> bool {
    !value
}

impl Default for Setting {
    fn default() -> Self {
        Self {
            k: 4.0,
            robust: true,
            dx: 0.0,
            dy: 0.0,
            ulps: 0.0,
            seed: 0,
            vertices: false,
            largest: false,
            exposure: 1.0,
        }
    }
}

/// Versions and machine of Mitsuba's driver.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Hello {
    /// Version of Mitsuba.
    pub mitsuba: String,
    /// Version of Dr.Jit.
    pub drjit: String,
    /// The variant, such as `llvm_ad_rgb`.
    pub variant: String,
    /// Version of Python.
    pub python: String,
    /// File name of the LLVM library.
    pub libllvm: String,
    /// Version of LLVM.
    pub llvm_version: String,
    /// Name of the processor.
    pub cpu: String,
    /// Threads that it uses by default.
    pub threads: u32,
}

/// Versions and machine of POV-Ray's driver.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct PovRay {
    /// Version of POV-Ray.
    pub povray: String,
    /// Version of the Python that runs the driver.
    pub python: String,
    /// Name of the processor.
    pub cpu: String,
    /// Number of processor threads.
    pub threads: u32,
}

/// Versions of the reference renderer.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Versions {
    /// Mitsuba.
    Mitsuba(Hello),
    /// POV-Ray.
    PovRay(PovRay),
}

/// A scene as the driver receives it.
#[derive(Clone, Copy)]
pub struct SceneText<'a> {
    /// The flattened TOML.
    pub text: &'a str,
    /// Folder that its files are relative to.
    pub base: &'a Path,
}

/// The properties of a rendering by the driver.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Rendered {
    /// Wall time.
    pub seconds: RenderedSeconds,
    /// Number of rays, if they are counted.
    #[serde(default)]
    pub rays: Rays,
    /// The integrator, for stock Mitsuba.
    #[serde(default)]
    pub integrator: String,
    /// How independent the twin is: "native", "hosted" or "formula".
    pub twin: String,
    /// Plugins that are not native, with the reason.
    #[serde(default)]
    pub hosted: Value,
    /// Number of spawned rays that hit the surface they left.
    #[serde(default)]
    pub rehits: u64,
    /// The coincident surfaces, if the driver reports them.
    #[serde(default)]
    pub coincident: Vec<Coincident>,
    /// Samples per pixel.
    pub samples: u32,
    /// Peak growth of the driver's memory in bytes, if the system reports it.
    #[serde(default)]
    pub memory: Option<u64>,
}

/// Two shapes that coincide, or why none were searched: see `references/mitsuba/PROTOCOL.md`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Coincident {
    /// Their indices in the list of the scene.
    #[serde(default)]
    pub shapes: Vec<u32>,
    /// The gap between them in metres; none if they are not separated.
    #[serde(default)]
    pub gap: Option<f64>,
    /// Why surfaces were not compared.
    #[serde(default)]
    pub not_examined: Option<String>,
}

impl Coincident {
    /// A note, if rounding decides which surface the reference hits first.
    pub(crate) fn note(&self) -> Option<String> {
        match (&self.not_examined, &self.gap, &self.shapes[..]) {
            (Some(why), _, _) => Some(format!(
                "the reference has not searched for coincident surfaces: {why}"
            )),
            (None, None, [one, two]) => Some(format!(
                "the reference has not separated the coincident shapes {one} and {two}"
            )),
            _ => None,
        }
    }
}

/// Times of a rendering in seconds; see [`Rendered`].
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct RenderedSeconds {
    /// Time to build the Mitsuba scene.
    pub load: f64,
    /// Tracing time, including kernel compilation.
    pub trace: f64,
    /// Processor time of all threads, for both; 0 if the driver does not report it.
    #[serde(default)]
    pub cpu: f64,
}

/// Numbers of rays; see [`Rendered`].
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Rays {
    /// Nearest-hit queries.
    pub closest: u64,
    /// Shadow rays.
    pub shadow: u64,
}

/// A number that JSON may not be able to represent.
pub(crate) fn number<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Number::deserialize(deserializer).map(|number| number.0)
}

/// Three such numbers.
pub(crate) fn numbers<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<[f64; 3], D::Error> {
    <[Number; 3]>::deserialize(deserializer).map(|three| three.map(|number| number.0))
}

/// Either a JSON number, or the text of one that JSON cannot represent.
pub(crate) struct Number(pub(crate) f64);

impl<'de> Deserialize<'de> for Number {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match Value::deserialize(deserializer)? {
            Value::Number(number) => Ok(Self(number.as_f64().unwrap_or(f64::NAN))),
            Value::String(text) => match text.as_str() {
                "nan" => Ok(Self(f64::NAN)),
                "inf" => Ok(Self(f64::INFINITY)),
                "-inf" => Ok(Self(f64::NEG_INFINITY)),
                other => Err(serde::de::Error::custom(format!("\"{other}\" is not a number"))),
            },
            other => Err(serde::de::Error::custom(format!("{other} is not a number"))),
        }
    }
}
