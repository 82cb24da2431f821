use crate::plugin::config::Vector3;
use crate::{DVec3, SceneError, SceneErrors};
use toml::Spanned;

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
        let tangent = match self {
            Self::Along(direction) => direction - direction.dot(normal) * normal,
            Self::Around(axis) => axis.cross(normal),
        };
        let t = tangent.try_normalize()?;
        Some(parts.x * t + parts.y * normal.cross(t) + parts.z * normal)
    }
}
