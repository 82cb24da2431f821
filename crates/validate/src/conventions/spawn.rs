//! How far from a surface a subject starts its shadow rays.
//!
//! The camera looks straight down on a floor. Two walls stand on it along the middle column, so
//! that they are hardly seen themselves, and the light comes over them at 45 degrees. A ray that
//! starts beyond a distance from its origin misses the wall near its foot: a strip of light. A ray
//! that starts above the floor passes over the lower wall earlier: its shadow is shorter. The same
//! image is that of a scene whose walls stand further away and are lower, which is what is fitted.

use super::choices::{Choice, Number, Others, Picked, descend};
use super::image::{Free, Guess, SIZE, compose, fit};
use super::probe::{Camera, Lab, Probe};
use super::{Finding, is_clear};
use crate::subject::render::SubjectError;
use std::f64::consts::FRAC_1_SQRT_2;

/// Widths of the view in metres, the smallest first. What is too large for one is seen in the next.
const WIDTHS: [f64; 3] = [5e-4, 1e-2, 0.2];
const FOLDERS: [&str; 3] = ["contact-1", "contact-2", "contact-3"];
/// Offsets above this are findings: a thousandth of the size of a scene of metres is seen.
const LARGE: f64 = 5e-4;
/// Offsets in pixels that are tried first.
const TRIED: [f64; 12] = [1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 11.0, 15.0, 20.0, 26.0, 40.0];
/// A larger part of the view is not measured in it.
const SATURATED: f64 = 25.0;
/// The largest error of an image that is understood.
const UNDERSTOOD: f64 = 0.1;
/// Half the length of both walls together.
const LENGTH: f64 = 0.3;
/// The height of the camera above the floor. A near clip of 1 m does not matter.
const EYE: f64 = 2.0;

/// What the probe shows: a finding, or the offset as words.
pub(super) enum Spawn {
    Finding(Vec<Finding>),
    Measured(String),
    Skipped(String),
}

/// The height of the lower wall: its shadow ends in the image.
fn low(width: f64) -> f64 {
    0.3 * width
}

/// The height of the higher wall: its shadow ends outside of the image.
fn high(width: f64) -> f64 {
    0.75 * width
}

fn wall(distance: f64, height: f64, side: f64) -> String {
    format!(
        "[{{scale=[{:?},{:?},1]}},{{rotate={{axis=[0,1,0],degrees=90}}}},{{translate=[{distance:?},{:?},{:?}]}}]",
        0.5 * LENGTH,
        0.5 * height,
        0.5 * height,
        0.5 * side * LENGTH,
    )
}

fn probe(width: f64, folder: &'static str) -> Probe {
    let shape = |transform: &str| {
        format!(
            "[[shape]]\ntype = \"rectangle\"\ntransform = {transform}\nmaterial = {{ type = \"matte\", reflectance = 0.7 }}\n"
        )
    };
    let floor = "[{ scale = 0.5 }, { rotate = { axis = [1, 0, 0], degrees = -90 } }]";
    Probe {
        name: "a shadow at a contact",
        folder,
        camera: Camera {
            origin: [0.0, EYE, 0.0],
            target: [0.0; 3],
            up: [0.0, 0.0, -1.0],
            fov: 2.0 * (0.5 * width / EYE).atan().to_degrees(),
        },
        body: [
            shape(floor),
            shape(&wall(0.0, high(width), -1.0)),
            shape(&wall(0.0, low(width), 1.0)),
        ]
        .concat(),
        lights: "[[light]]\ntype = \"directional\"\ndirection = [1, -1, 0]\nirradiance = 3\n".to_owned(),
        exactly: None,
    }
}

/// Measures the offset of shadow rays.
pub(super) fn measure(lab: &Lab<'_>, guess: &Guess, free: Free) -> Result<Spawn, SubjectError> {
    let mut result = Spawn::Skipped("its shadows are further from their walls than 0.1 m".to_owned());
    for (width, folder) in WIDTHS.into_iter().zip(FOLDERS) {
        let probe = probe(width, folder);
        let image = lab.subject(&probe)?;
        (lab.stage)(&format!("examining {}", probe.name));
        let pixel = width / SIZE[0] as f64;
        // In pixels: the strip next to the walls, and the part by which the lower one is lower.
        let number = |convention| Choice {
            convention,
            others: Others::Number(Number {
                tried: TRIED.to_vec(),
                changes: Box::new(|_| Vec::new()),
                sentence: Box::new(|_| String::new()),
            }),
        };
        let choices = [number("strip"), number("height")];
        let mut error = |picked: &Picked| -> Result<f64, String> {
            let [strip, lower] = [picked[0], picked[1]].map(|part| pixel * part.unwrap_or(0.0));
            // Walls that are not there at all would not be invertible.
            let height = (low(width) - strip - lower).max(1e-9 * width);
            let changes = match picked.iter().any(Option::is_some) {
                false => Vec::new(),
                true => vec![
                    format!("shape.1.transform={}", wall(strip, high(width), -1.0)),
                    format!("shape.2.transform={}", wall(strip, height, 1.0)),
                ],
            };
            let samples = lab.samples(&probe, &changes, guess)?;
            let found = fit(&compose(&samples, guess), &image, guess, free);
            Ok(found.error)
        };
        let mut examined = || -> Result<_, String> {
            let (least, picked) = descend(&choices, &mut error)?;
            let without = error(&vec![None; 2])?;
            // The table of the subject may switch shadows off.
            let has_shadows = error(&vec![Some(SATURATED), None])? != without;
            Ok((least, without, has_shadows.then_some(picked)))
        };
        let (least, without, picked) = examined().map_err(SubjectError::Environment)?;
        let Some(picked) = picked else {
            return Ok(Spawn::Skipped("no scene has shadows".to_owned()));
        };
        let [strip, lower] = [picked[0], picked[1]].map(|part| part.unwrap_or(0.0));
        if strip > SATURATED || lower > SATURATED || least.is_infinite() {
            continue;
        }
        if least > UNDERSTOOD {
            result = Spawn::Skipped(format!(
                "its image is not that of shadows on a floor: the error is {least:.1e}"
            ));
            continue;
        }
        // The strip is the projection of a ray of 45 degrees.
        let along = strip * pixel / FRAC_1_SQRT_2;
        let above = lower * pixel;
        let mut parts = Vec::new();
        if along > 0.0 {
            parts.push(format!("{along:.1e} m along the ray"));
        }
        if above > 0.0 {
            parts.push(format!("{above:.1e} m above the surface"));
        }
        if parts.is_empty() {
            return Ok(Spawn::Measured(format!(
                "shadow rays start less than {pixel:.0e} m from their surface"
            )));
        }
        let sentence = format!("shadow rays start {}", parts.join(" and "));
        let is_large = along.max(above) > LARGE && is_clear(least, without);
        return Ok(match is_large {
            false => Spawn::Measured(sentence),
            true => Spawn::Finding(vec![Finding {
                convention: "spawn offset",
                sentence: format!("{sentence}: shadows do not reach the contact of surfaces"),
                error: least,
                error_without: without,
                key: None,
            }]),
        });
    }
    Ok(result)
}
