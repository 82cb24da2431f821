use crate::{Aabb, Transform};
use glam::DVec3;

/// A part of a shape's surface with a simple form, in world space. At build, the results of
/// [`crate::Shape::parts`] are compared between shapes to find coincident surfaces.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum SurfacePart {
    /// An infinite plane.
    Plane {
        /// Any point of the plane.
        point: DVec3,
        /// Unit normal; it points outside.
        normal: DVec3,
    },
    /// A flat face.
    Polygon {
        /// Unit normal; it points outside.
        normal: DVec3,
        /// Corners, in order, of a convex polygon that contains the face.
        corners: Vec<DVec3>,
        /// Whether the face fills the polygon, to a thousandth of its size. If not, rays must be
        /// traced to find where the face is.
        filled: bool,
    },
    /// A whole sphere; outside is away from the centre.
    Sphere {
        /// In metres.
        center: DVec3,
        /// In metres.
        radius: f64,
    },
    /// The lateral surface of a circular cylinder; outside is away from the axis.
    Cylinder {
        /// Both ends of the axis.
        ends: [DVec3; 2],
        /// In metres.
        radius: f64,
    },
}

impl SurfacePart {
    /// This part under a transform; `None` if the result has none of these forms.
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

    /// The bounding box.
    pub fn bounds(&self) -> Aabb {
        match self {
            Self::Plane { .. } => Aabb::EVERYTHING,
            Self::Polygon { corners, .. } => Aabb::around(corners.iter().copied()),
            Self::Sphere { center, radius } => Aabb::around([*center]).padded(*radius),
            Self::Cylinder { ends, radius } => Aabb::around(*ends).padded(*radius),
        }
    }
}
