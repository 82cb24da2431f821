//! Texture functions and the mappings from surface points to their domain: section 10 of the model.

use super::footprint::{Footprint, NEAR, slope};
use serde::Deserialize;
use std::f64::consts::{PI, TAU};
use whitstone_core::transform_steps::TransformSteps;
use whitstone_core::{DAffine3, DVec2, DVec3, Rgb};

/// A surface point, as textures see it.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// Texture coordinates of the shape.
    pub(super) uv: DVec2,
    /// In world space; for displacement and height fields, in the object space of the shape.
    pub(super) p: DVec3,
    /// The shading normal; its sign does not matter.
    pub(super) n_s: DVec3,
    /// The gradients of (u, v) on the surface; zero if they are not needed.
    pub(super) gradients: [DVec3; 2],
    /// Derivatives of all of this per sample; zero if they are not needed.
    pub(super) footprint: Footprint,
    /// The second set of texture coordinates.
    pub(super) second: DVec2,
    /// The mesh tangent in world space, of any length, and the sign of the bitangent.
    pub(super) tangent: Option<(DVec3, f64)>,
    /// The vertex colour, R, G, B and alpha; 1 if there is none.
    pub(super) color: [f64; 4],
    /// The side on which undecided thresholds fall: 0, or -1 and 1 in perturbed runs.
    pub(super) nudge: f64,
}

impl Default for Place {
    fn default() -> Self {
        Self {
            uv: DVec2::ZERO,
            p: DVec3::ZERO,
            n_s: DVec3::ZERO,
            gradients: [DVec3::ZERO; 2],
            footprint: Footprint::default(),
            second: DVec2::ZERO,
            tangent: None,
            color: [1.0; 4],
            nudge: 0.0,
        }
    }
}

/// A function on texture space.
pub(super) trait TextureFunction: Send + Sync {
    fn at(&self, q: DVec3) -> Rgb;

    /// Columns and rows, if it is an image.
    fn size(&self) -> Option<[usize; 2]> {
        None
    }

    /// Whether it filters over the footprint.
    fn filters(&self) -> bool {
        false
    }

    /// The filtered value; `steps` are the derivatives of the point.
    fn filtered(&self, q: DVec3, steps: [DVec3; 2]) -> Rgb {
        let _ = steps;
        self.at(q)
    }
}

/// The key `mapping`.
#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(super) struct MappingConfig {
    projection: Option<String>,
    transform: Option<TransformSteps>,
    sharpness: Option<f64>,
    uv_set: Option<u32>,
}

/// How a surface point becomes a point of texture space.
#[derive(Clone, Copy)]
pub(super) enum Projection {
    Uv,
    /// By the second set of texture coordinates.
    SecondUv,
    Solid,
    Planar,
    Spherical,
    Cylindrical,
    Cube,
    Triplanar(f64),
}

/// Maps surface points to texture space.
pub(super) struct Mapping {
    projection: Projection,
    map: DAffine3,
}

impl Mapping {
    pub(super) fn new(config: Option<MappingConfig>, usual: Projection) -> Result<Self, String> {
        let config = config.unwrap_or_default();
        let usual = match (usual, config.projection.as_deref(), config.uv_set) {
            (_, _, None) | (Projection::Uv, None, Some(0)) | (_, Some("uv"), Some(0)) => usual,
            (Projection::Uv, None, Some(1)) | (_, Some("uv"), Some(1)) => Projection::SecondUv,
            _ => return Err("this `uv_set`".to_owned()),
        };
        Ok(Self {
            projection: match config.projection.as_deref() {
                Some("uv") if config.uv_set == Some(1) => usual,
                Some("uv") => Projection::Uv,
                Some("solid") => Projection::Solid,
                Some("planar") => Projection::Planar,
                Some("spherical") => Projection::Spherical,
                Some("cylindrical") => Projection::Cylindrical,
                Some("cube") => Projection::Cube,
                Some("triplanar") => Projection::Triplanar(config.sharpness.unwrap_or(4.0)),
                None => usual,
                Some(other) => return Err(format!("the projection \"{other}\"")),
            },
            map: config
                .transform
                .map_or(DAffine3::IDENTITY, |steps| *steps.get().world_from_object()),
        })
    }

    pub(super) fn look(&self, pattern: &dyn TextureFunction, spot: &Place) -> Rgb {
        let q = match self.projection {
            Projection::Uv => self.map.transform_point3(spot.uv.extend(0.0)),
            Projection::SecondUv => self.map.transform_point3(spot.second.extend(0.0)),
            _ => self.map.transform_point3(spot.p),
        };
        let steps = match self.projection {
            Projection::Uv => spot.footprint.uv.map(|step| step.extend(0.0)),
            Projection::SecondUv => [DVec3::ZERO; 2],
            _ => spot.footprint.p,
        };
        let steps = steps.map(|step| self.map.matrix3 * step);
        if let Projection::Triplanar(sharpness) = self.projection {
            let n = (self.map.matrix3.inverse().transpose() * spot.n_s).abs();
            let (mut sum, mut weights) = (Rgb::splat(0.0), 0.0);
            for a in 0..3 {
                let plane = |q: DVec3| DVec3::new(q[(a + 1) % 3], q[(a + 2) % 3], 0.0);
                let w = (n[a] / n.max_element()).powf(sharpness);
                sum += pattern.filtered(plane(q), steps.map(plane)) * w;
                weights += w;
            }
            return sum * (1.0 / weights);
        }
        let far = q.abs().max_element();
        let face = (0..3).find(|a| q[*a].abs() == far).unwrap_or(0);
        let here = self.projection.point(q, face);
        if !pattern.filters() {
            return pattern.at(here);
        }
        let steps = steps.map(|step| match self.projection {
            Projection::Uv | Projection::SecondUv | Projection::Solid | Projection::Planar => step,
            _ if step == DVec3::ZERO => step,
            _ => {
                let away = NEAR * far / step.length();
                let [before, after] = [-away, away].map(|away| {
                    let there = self.projection.point(q + away * step, face);
                    // Unwraps angles across the seam.
                    DVec3::new(there.x - (there.x - here.x).round(), there.y, 0.0)
                });
                slope(Some(before), here, Some(after), away)
            }
        });
        pattern.filtered(here, steps)
    }
}

impl Projection {
    /// The point of texture space; `face` is the face of "cube".
    fn point(self, q: DVec3, face: usize) -> DVec3 {
        let turn = around(q.x, q.y) / TAU;
        match self {
            Self::Uv | Self::SecondUv | Self::Solid | Self::Triplanar(_) => q,
            Self::Planar => DVec3::new(q.x, q.y, 0.0),
            Self::Spherical => {
                let theta = q.x.hypot(q.y).atan2(q.z);
                DVec3::new(turn, (PI - theta) / PI, 0.0)
            }
            Self::Cylindrical => DVec3::new(turn, q.z, 0.0),
            Self::Cube => {
                let m = q[face].abs();
                let [b, c] = [(face + 1) % 3, (face + 2) % 3].map(|k| 0.5 * (q[k] / m + 1.0));
                DVec3::new(b, c, 0.0)
            }
        }
    }
}

/// The angle from +x towards +y, in [0, 2pi).
pub(super) fn around(x: f64, y: f64) -> f64 {
    let phi = y.atan2(x);
    if phi < 0.0 { phi + TAU } else { phi }
}
