//! Radiance as a function of direction: a latitude-longitude map or a cube map.
//!
//! Blinn and Newell, *Texture and reflection in computer generated images*, 1976; Greene,
//! *Environment mapping and other applications of world projections*, 1986.

use crate::config::{FilePath, TextureRef};
use crate::{ColorSource, Context, DVec2, DVec3, Rgb, SceneError, SceneErrors, SurfaceInteraction, Texture};
use schemars::JsonSchema;
use serde::Deserialize;
use std::f64::consts::FRAC_1_PI;
use std::sync::Arc;
use toml::Spanned;

/// The faces of a cube map, each as seen by a camera at the centre, with +y up unless stated
/// otherwise.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(
    deny_unknown_fields,
    expecting = "a table of six faces: px, nx, py, ny, pz, nz"
)]
pub struct Faces {
    /// Towards +x.
    pub px: Face,
    /// Towards -x.
    pub nx: Face,
    /// Towards +y, with +z up.
    pub py: Face,
    /// Towards -y, with -z up.
    pub ny: Face,
    /// Towards +z.
    pub pz: Face,
    /// Towards -z.
    pub nz: Face,
}

/// A face of a cube map.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, expecting = "a face: a table with `file`")]
pub struct Face {
    /// A PNG, JPEG, WebP, EXR or HDR file, relative to the scene.
    pub file: FilePath,
}

/// Radiance as a function of direction.
pub enum DirectionMap {
    /// A latitude-longitude map.
    Sphere(ColorSource),
    /// A cube map: +x, -x, +y, -y, +z, -z.
    Cube([Arc<dyn Texture>; 6]),
}

impl DirectionMap {
    /// From the keys `radiance` and `faces`, exactly one of which must be given.
    pub fn new(
        radiance: Option<&TextureRef>,
        faces: Option<&Spanned<Faces>>,
        context: &mut dyn Context,
    ) -> Result<Self, SceneErrors> {
        match (radiance, faces) {
            (Some(radiance), None) => Ok(Self::Sphere(context.texture(radiance)?)),
            (None, Some(faces)) => Ok(Self::Cube(cube(faces.get_ref(), context)?)),
            (None, None) => Err(SceneError::anywhere("missing key `radiance` or `faces`").into()),
            (Some(_), Some(faces)) => {
                let message = "`faces` and `radiance` exclude each other";
                Err(SceneError::at(faces.span(), message).into())
            }
        }
    }

    /// The radiance in a unit direction.
    pub fn value(&self, direction: DVec3) -> Rgb {
        self.at(place(direction), direction)
    }

    /// The same for a direction whose latitude-longitude coordinates are `uv`.
    pub fn at(&self, uv: DVec2, direction: DVec3) -> Rgb {
        let mut point = SurfaceInteraction::new(direction, 0.0, direction);
        match self {
            Self::Sphere(radiance) => {
                point.uv = uv;
                radiance.value(&point)
            }
            Self::Cube(faces) => {
                let (face, uv) = on_cube(direction);
                point.uv = uv;
                faces[face].value(&point)
            }
        }
    }

    /// Columns and rows of the image or of a face, if it is made of images.
    pub fn size(&self) -> Option<[usize; 2]> {
        match self {
            Self::Sphere(ColorSource::Constant(_)) => None,
            Self::Sphere(ColorSource::Texture(texture)) => texture.size(),
            Self::Cube([face, ..]) => face.size(),
        }
    }

    /// Whether it is known to be zero everywhere without evaluating it.
    pub fn is_black(&self) -> bool {
        matches!(self, Self::Sphere(radiance) if radiance.is_black())
    }
}

/// Resolves the images of the faces and checks that their sizes match.
fn cube(faces: &Faces, context: &mut dyn Context) -> Result<[Arc<dyn Texture>; 6], SceneErrors> {
    let Faces {
        px,
        nx,
        py,
        ny,
        pz,
        nz,
    } = faces;
    let mut errors = SceneErrors::default();
    let mut first = None;
    let pictures = [px, nx, py, ny, pz, nz].map(|Face { file }| {
        let picture = errors.take(context.image(file))?;
        if let Some([width, height]) = picture.size() {
            let expected = *first.get_or_insert(width);
            if [width, height] != [expected; 2] {
                let message = if width == height {
                    format!("expected an image of {expected} x {expected} pixels like the other faces, found {width} x {height}")
                } else {
                    format!("expected a square image, found {width} x {height}")
                };
                errors.0.push(SceneError::at(file.span.clone(), message));
            }
        }
        Some(picture)
    });
    match pictures {
        [Some(px), Some(nx), Some(py), Some(ny), Some(pz), Some(nz)] => {
            errors.into_result([px, nx, py, ny, pz, nz])
        }
        _ => Err(errors),
    }
}

/// The cube face that a direction hits (on an edge, that of the first axis), and the (u, v) on its
/// image.
fn on_cube(d: DVec3) -> (usize, DVec2) {
    let size = d.abs();
    // `right` and `up` are the components along the axes of the face's image.
    let (face, distance, right, up) = if size.x >= size.y && size.x >= size.z {
        let side = d.x.signum();
        (usize::from(d.x < 0.0), size.x, side * d.z, d.y)
    } else if size.y >= size.z {
        let side = d.y.signum();
        (2 + usize::from(d.y < 0.0), size.y, d.x, side * d.z)
    } else {
        let side = d.z.signum();
        (4 + usize::from(d.z < 0.0), size.z, -side * d.x, d.y)
    };
    (face, 0.5 + 0.5 * DVec2::new(right, up) / distance)
}

/// (u, v) of a direction: v is 1 straight up; u is 1/2 towards -z and grows to the right.
fn place(direction: DVec3) -> DVec2 {
    let DVec3 { x, y, z } = direction;
    let u = 0.5 + 0.5 * FRAC_1_PI * libm::atan2(x, -z);
    let v = 0.5 + FRAC_1_PI * libm::atan2(y, libm::hypot(x, z));
    DVec2::new(u, v)
}
