//! The near limit of a pinhole camera: rays start at it.

use crate::support::pinhole::{Pinhole, normalize};
use crate::support::view::Frame;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Spanned;
use whitstone_core::config::Finite;
use whitstone_core::simd::select;
use whitstone_core::{DVec2, DVec3, SceneError, SceneErrors};

/// Shape of the near limit.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema, PartialEq)]
#[serde(rename_all = "snake_case")]
pub(crate) enum NearKind {
    /// A plane perpendicular to the view axis.
    #[default]
    Planar,
    /// A sphere around the camera.
    Spherical,
}

/// Distance along a ray from the camera to the near limit. Without a limit, rays start bitwise at
/// the camera position.
pub(crate) struct Near {
    /// For a planar limit, its distance relative to that of the window; otherwise its distance in
    /// metres.
    factor: f64,
    spherical: bool,
}

impl Near {
    /// The limit at `near` metres.
    pub(crate) fn new(
        near: Option<&Spanned<Finite>>,
        kind: NearKind,
        frame: &Frame,
        pinhole: &Pinhole,
    ) -> Result<Self, SceneErrors> {
        let distance = near.map_or(0.0, |near| near.get_ref().get());
        let spherical = kind == NearKind::Spherical;
        let factor = if spherical {
            distance
        } else {
            distance / pinhole.distance
        };
        let limit = Self { factor, spherical };
        let film = pinhole.film();
        let corners = [
            DVec2::ZERO,
            DVec2::new(film.x, 0.0),
            DVec2::new(0.0, film.y),
            film,
        ];
        let reached = corners.into_iter().all(|raster| {
            let through = pinhole.through(frame, raster);
            limit.start(frame, through, normalize(through)).is_finite()
        });
        match near {
            Some(near) if !reached => {
                let message = "rays cannot start so far from the camera";
                Err(SceneError::at(near.span(), message).into())
            }
            _ => Ok(limit),
        }
    }

    /// Start of a ray; `through` is the vector from the camera to the window.
    #[inline(always)]
    pub(crate) fn start(&self, frame: &Frame, through: DVec3, direction: DVec3) -> DVec3 {
        let pick = |direction: f64, through: f64| select(self.spherical, direction, through);
        let along = DVec3::new(
            pick(direction.x, through.x),
            pick(direction.y, through.y),
            pick(direction.z, through.z),
        );
        frame.origin + self.factor * along
    }

    /// Distance of that start along the ray from the camera; negative behind it.
    pub(crate) fn distance(&self, through: DVec3) -> f64 {
        if self.spherical {
            self.factor
        } else {
            self.factor * through.length()
        }
    }
}
