use crate::plugin::config::Vector3;
use crate::{DVec3, SceneError, SceneErrors};
use toml::Spanned;

/// Tangents no longer than this share of the vector or the axis count as none: they are rounding
/// errors of a normal that is parallel to it.
const SHORTEST: f64 = 1e-9;

/// The tangents of a surface for vectors in tangent space, exact on every shape.
#[derive(Clone, Copy, Debug)]
pub enum TangentField {
    /// The projection of this unit vector onto the surface.
    Along(DVec3),
    /// In circles around this unit vector, as on a globe.
    Around(DVec3),
}

impl TangentField {
    /// From the keys `tangent` and `axis`, of which only one may be given; +x by default.
    pub fn new(
        tangent: Option<&Spanned<Vector3>>,
        axis: Option<&Spanned<Vector3>>,
    ) -> Result<Self, SceneErrors> {
        let unit = |vector: &Spanned<Vector3>| {
            let error = || SceneError::at(vector.span(), "expected a direction, found a zero vector");
            vector.get_ref().get().try_normalize().ok_or_else(error)
        };
        Ok(match (tangent, axis) {
            (None, None) => Self::Along(DVec3::X),
            (Some(direction), None) => Self::Along(unit(direction)?),
            (None, Some(axis)) => Self::Around(unit(axis)?),
            (Some(_), Some(axis)) => {
                let message = "`tangent` and `axis` exclude each other";
                return Err(SceneError::at(axis.span(), message).into());
            }
        })
    }

    /// The same for vectors in tangent space only; otherwise both keys are errors.
    pub fn of_space(
        is_tangent: bool,
        tangent: Option<&Spanned<Vector3>>,
        axis: Option<&Spanned<Vector3>>,
    ) -> Result<Option<Self>, SceneErrors> {
        if is_tangent {
            return Self::new(tangent, axis).map(Some);
        }
        let mut errors = SceneErrors::default();
        for given in [tangent, axis].into_iter().flatten() {
            let message = "`tangent` and `axis` have no effect outside of tangent space";
            let error = SceneError::at(given.span(), message).with_help("add space = \"tangent\"");
            errors.0.push(error);
        }
        errors.into_result(None)
    }

    /// The vector with these components along the tangent, the bitangent and the unit normal;
    /// `None` where the tangent has no direction.
    pub fn vector(&self, parts: DVec3, normal: DVec3) -> Option<DVec3> {
        let (from, tangent) = match self {
            Self::Along(direction) => (direction, direction - direction.dot(normal) * normal),
            Self::Around(axis) => (axis, axis.cross(normal)),
        };
        let is_long = tangent.length_squared() > SHORTEST.powi(2) * from.length_squared();
        let t = tangent.try_normalize().filter(|_| is_long)?;
        Some(parts.x * t + parts.y * normal.cross(t) + parts.z * normal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rounding_error_is_no_tangent() {
        let parts = DVec3::new(0.5, 0.25, 1.0);
        for (field, normal) in [
            (TangentField::Around(DVec3::Y), DVec3::Y),
            (TangentField::Along(DVec3::X), DVec3::X),
            // A vector that is not normalised.
            (TangentField::Along(1e-12 * DVec3::X), DVec3::X),
        ] {
            for (lean, valid) in [
                (0.0, false),
                (1e-16, false),
                (5e-10, false),
                (2e-9, true),
                (0.1, true),
            ] {
                let leaning = (normal + lean * DVec3::Z).normalize();
                assert_eq!(field.vector(parts, leaning).is_some(), valid, "{field:?} {lean}");
            }
        }
        assert_eq!(TangentField::Along(DVec3::ZERO).vector(parts, DVec3::Z), None);
    }
}
