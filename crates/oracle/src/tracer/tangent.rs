//! Tangent frames: section 8 of the model, `normal_map`.

use super::mapping::Place;
use whitstone_core::DVec3;

/// The tangent of a normal map or a displacement, its x axis.
pub(crate) enum Tangent {
    /// This vector, projected onto the surface.
    Along(DVec3),
    /// Around this axis.
    Around(DVec3),
    /// The mesh tangent.
    Mesh,
}

impl Tangent {
    pub(crate) fn new(along: Option<[f64; 3]>, axis: Option<[f64; 3]>) -> Self {
        match axis {
            Some(axis) => Self::Around(DVec3::from_array(axis).normalize()),
            None => Self::Along(along.map_or(DVec3::X, DVec3::from_array).normalize()),
        }
    }

    /// The tangent and the bitangent as unit vectors, if there are any.
    pub(super) fn at(&self, n_s: DVec3, spot: &Place) -> Option<[DVec3; 2]> {
        let across = |x: DVec3| x - x.dot(n_s) * n_s;
        let (t, sign) = match self {
            Self::Along(x) => (across(*x), 1.0),
            Self::Around(axis) => (axis.cross(n_s), 1.0),
            Self::Mesh => {
                let (along, sign) = spot.tangent?;
                (across(along.try_normalize()?), sign)
            }
        };
        let t = t.try_normalize().filter(|_| t.length() > 1e-9)?;
        Some([t, sign * n_s.cross(t)])
    }

    /// The vector with these parts along the tangent, the bitangent and the normal at a vertex of
    /// object space.
    pub(crate) fn at_vertex(&self, n: DVec3, [x, y, z]: [f64; 3]) -> Option<DVec3> {
        let [t, across] = self.at(n, &Place::default())?;
        Some(x * t + y * across + z * n)
    }
}
