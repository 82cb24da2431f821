use crate::{Aabb, Transform};
use glam::DVec3;

/// A part of the surface of a shape that has a simple form, in world space. What
/// [`crate::Primitive::parts`] returns is compared between shapes at build, to find surfaces that
/// coincide.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum SurfacePart {
    /// An endless plane.
    Plane {
        /// Any point of it.
        point: DVec3,
        /// Unit normal; it points outside.
        normal: DVec3,
    },
    /// A flat face.
    Polygon {
        /// Unit normal; it points outside.
        normal: DVec3,
        /// Corners of a convex polygon that holds the face, in order around it.
        corners: Vec<DVec3>,
        /// Whether the face fills the polygon, up to a thousandth of its size. If not, whoever
        /// needs to know where the face is sends rays.
        filled: bool,
    },
    /// A whole sphere; outside is away from the center.
    Sphere {
        /// In metres.
        center: DVec3,
        /// In metres.
        radius: f64,
    },
    /// The side of a circular cylinder; outside is away from the axis.
    Cylinder {
        /// Both ends of the axis.
        ends: [DVec3; 2],
        /// In metres.
        radius: f64,
    },
}

impl SurfacePart {
    /// This part under a transform; `None` if it then has none of these forms.
    pub fn transformed(&self, transform: &Transform) -> Option<Self> {
        let point = |p: &DVec3| transform.point_to_world(*p);
        let similar = || transform.similarity_scale();
        Some(match self {
            Self::Plane { point: p, normal } => Self::Plane {
                point: point(p),
                normal: transform.normal_to_world(*normal),
            },
            Self::Polygon {
                normal,
                corners,
                filled,
            } => Self::Polygon {
                normal: transform.normal_to_world(*normal),
                corners: corners.iter().map(point).collect(),
                filled: *filled,
            },
            Self::Sphere { center, radius } => Self::Sphere {
                center: point(center),
                radius: radius * similar()?,
            },
            Self::Cylinder { ends, radius } => Self::Cylinder {
                ends: [point(&ends[0]), point(&ends[1])],
                radius: radius * similar()?,
            },
        })
    }

    /// A box around it.
    pub fn bounds(&self) -> Aabb {
        match self {
            Self::Plane { .. } => Aabb::EVERYTHING,
            Self::Polygon { corners, .. } => Aabb::around(corners.iter().copied()),
            Self::Sphere { center, radius } => Aabb::around([*center]).padded(*radius),
            Self::Cylinder { ends, radius } => Aabb::around(*ends).padded(*radius),
        }
    }
}
