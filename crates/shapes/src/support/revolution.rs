//! Common code of cylinder, cone, paraboloid and hyperboloid: quadrics of revolution about the z
//! axis, clipped between two heights.

use crate::support::conic::{Clipped, Conic, Mapping, angle};
use crate::support::frame::Frame;
use crate::support::near::check_radius;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use whitstone_core::config::Vector2;
use whitstone_core::{Aabb, DMat3, DVec2, DVec3, LoweredShape, SceneErrors, SurfacePart, Transform};

/// Two heights, the lower one first.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Heights(pub(crate) [f64; 2]);

impl Serialize for Heights {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Heights {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let [low, high] = Vector2::deserialize(deserializer)?.get().to_array();
        if low < high {
            return Ok(Self([low, high]));
        }
        let message = format!("expected two heights in ascending order, found [{low}, {high}]");
        Err(serde::de::Error::custom(message))
    }
}

/// x² + y² = square z² + 2 linear z + constant, with z relative to `origin`.
pub(crate) struct Revolution {
    pub(crate) square: f64,
    pub(crate) linear: f64,
    pub(crate) constant: f64,
    pub(crate) origin: f64,
    pub(crate) heights: Heights,
    /// Radii at the two heights.
    pub(crate) radii: [f64; 2],
    pub(crate) caps: bool,
    /// The outward direction at the apex, where the radius is 0.
    pub(crate) tip: DVec3,
}

/// Texture coordinates: angle and relative height on the side, radius and angle on a cap.
#[derive(Clone)]
struct Around {
    heights: [f64; 2],
    radii: [f64; 2],
    caps: bool,
    /// Whether the side is a cylinder.
    straight: bool,
}

impl Mapping for Around {
    fn uv(&self, p: DVec3, primitive: u32) -> DVec2 {
        let [low, high] = self.heights;
        match primitive {
            0 => DVec2::new(angle(p.x, p.y), (p.z - low) / (high - low)),
            _ => DVec2::new(
                p.truncate().length() / self.radii[usize::from(primitive == 2)],
                angle(p.x, p.y),
            ),
        }
    }

    fn parts(&self, frame: &Frame) -> Vec<SurfacePart> {
        let mut parts = Vec::new();
        if self.straight {
            let ends = self.heights.map(|z| frame.point(DVec3::new(0.0, 0.0, z), 2).0);
            if let Some(radius) = frame.similarity_scale().map(|scale| scale * self.radii[0]) {
                parts.push(SurfacePart::Cylinder { ends, radius });
            }
        }
        for (side, place) in [(-1.0, 0), (1.0, 1)] {
            if self.caps && self.radii[place] > 0.0 {
                parts.push(frame.round_face(side, self.heights[place], self.radii[place]));
            }
        }
        parts
    }
}

impl Revolution {
    /// Builds the shape under a transform. `widest` returns disks (height and radius) that,
    /// together with the end disks, bound the shape: none if its outline is straight or bends
    /// inward.
    pub(crate) fn build(
        self,
        transform: Transform,
        widest: impl FnOnce(&Transform) -> Vec<[f64; 2]>,
    ) -> Result<LoweredShape, SceneErrors> {
        let Heights([low, high]) = self.heights;
        check_radius(self.radii[0].max(self.radii[1]))?;
        let conic = Conic {
            turn: DMat3::IDENTITY,
            center: DVec3::new(0.0, 0.0, self.origin),
            square: DVec3::new(1.0, 1.0, -self.square),
            linear: DVec3::new(0.0, 0.0, -self.linear),
            constant: -self.constant,
            min: DVec3::new(f64::NEG_INFINITY, f64::NEG_INFINITY, low),
            max: DVec3::new(f64::INFINITY, f64::INFINITY, high),
            caps: self.caps,
            first_face: 4,
            tip: self.tip,
        };
        let mapping = Around {
            heights: [low, high],
            radii: self.radii,
            caps: self.caps,
            straight: self.square == 0.0 && self.linear == 0.0,
        };
        let mut disks = widest(&transform);
        disks.extend([[low, self.radii[0]], [high, self.radii[1]]]);
        let bounds = |frame: &Frame| {
            let around = |[z, radius]: [f64; 2]| frame.around_disk(DVec3::new(0.0, 0.0, z), radius);
            disks.into_iter().map(around).fold(Aabb::EMPTY, Aabb::union)
        };
        let clipped = Clipped::new(transform, conic, mapping, bounds)?;
        Ok(LoweredShape::Custom(Box::new(clipped)))
    }
}
