//! The near limit of a pinhole: rays start beyond it.

use crate::pinhole::{Pinhole, normalize};
use crate::view::Frame;
use schemars::JsonSchema;
use serde::Deserialize;
use toml::Spanned;
use whitstone_core::config::NonNegative;
use whitstone_core::simd::select;
use whitstone_core::{DVec2, DVec3, SceneError, SceneErrors};

/// The form of the near limit.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq)]
#[serde(rename_all = "snake_case")]
pub(crate) enum NearKind {
    /// A plane across the view.
    #[default]
    Planar,
    /// A sphere around the camera.
    Spherical,
}

/// How far along a ray to go from the camera, so that a ray without a near limit starts there to
/// the bit: nothing is added then.
pub(crate) struct Near {
    /// For a planar limit: its distance in distances of the window. Else the distance in metres.
    factor: f64,
    spherical: bool,
}

impl Near {
    /// The limit `near`, in metres.
    pub(crate) fn new(
        near: Option<&Spanned<NonNegative>>,
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

    /// Where a ray starts; `through` leads to the window.
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

    /// How far from the camera that is.
    pub(crate) fn distance(&self, through: DVec3) -> f64 {
        if self.spherical {
            self.factor
        } else {
            self.factor * through.length()
        }
    }
}
