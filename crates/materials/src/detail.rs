//! Perturbed shading normals, shared by `bump` and `normal_map`.

use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::Vector3;
use whitstone_core::{
    Branches, ColorSource, DVec3, Distribution, Filter, Illumination, Lobes, Material, Needs, Rgb,
    SceneError, SceneErrors, SurfacePoint,
};

/// Decodes a colour into a vector: 2 * colour - 1.
pub(crate) fn coded(colors: &ColorSource, point: &SurfacePoint) -> DVec3 {
    DVec3::from_array(colors.value(point).to_array().map(|part| 2.0 * part - 1.0))
}

/// Tangent frame, defined by a tangent direction or by an axis around which tangents run.
pub(crate) enum Frame {
    Along(DVec3),
    Around(DVec3),
}

impl Frame {
    /// Creates a frame from a world-space tangent or axis; the tangent is +x by default.
    pub(crate) fn new(
        tangent: Option<&Spanned<Vector3>>,
        axis: Option<&Spanned<Vector3>>,
    ) -> Result<Self, SceneErrors> {
        let unit = |vector: &Spanned<Vector3>| {
            let error = || {
                SceneError::at(
                    vector.span(),
                    "expected a direction, found a vector without length",
                )
            };
            vector.get_ref().get().try_normalize().ok_or_else(error)
        };
        Ok(match (tangent, axis) {
            (None, None) => Self::Along(DVec3::X),
            (Some(tangent), None) => Self::Along(unit(tangent)?),
            (None, Some(axis)) => Self::Around(unit(axis)?),
            (Some(_), Some(axis)) => {
                let message = "either the tangent or the axis that it goes around";
                return Err(SceneError::at(axis.span(), message).into());
            }
        })
    }

    /// Decodes a tangent-space vector into world space; `None` where the tangent is degenerate.
    pub(crate) fn vector(&self, parts: &ColorSource, point: &SurfacePoint) -> Option<DVec3> {
        let n = point.n_s;
        let t = match self {
            Self::Along(direction) => direction - direction.dot(n) * n,
            Self::Around(axis) => axis.cross(n),
        };
        let t = t.try_normalize()?;
        let DVec3 { x, y, z } = coded(parts, point);
        Some(x * t + y * n.cross(t) + z * n)
    }
}

/// A source of perturbed shading normals.
pub(crate) trait Detail: Send + Sync {
    /// The surface attributes that it reads.
    fn needs(&self) -> Needs;

    /// The unit normal that replaces n_s, on the outside of the surface; `None` to keep n_s.
    fn normal(&self, point: &SurfacePoint) -> Option<DVec3>;
}

/// A material that is shaded with perturbed normals.
pub(crate) struct Detailed<D> {
    pub(crate) detail: D,
    pub(crate) inner: Arc<dyn Material>,
}

impl<D: Detail> Detailed<D> {
    /// The point with the perturbed normal. Keeps n_s where the viewer would be on different sides
    /// of the perturbed and the geometric normal.
    fn at(&self, point: &SurfacePoint, view: DVec3) -> SurfacePoint {
        let mut turned = *point;
        if let Some(n) = self.detail.normal(point)
            && n.dot(view) * point.n_g.dot(view) > 0.0
        {
            turned.n_s = n;
        }
        turned
    }
}

impl<D: Detail> Material for Detailed<D> {
    fn lobes(&self) -> Lobes {
        self.inner.lobes() | Lobes::OWN_NORMAL
    }

    fn needs(&self) -> Needs {
        self.inner.needs() | self.detail.needs() | Needs::SHADING_NORMAL
    }

    fn local(&self, point: &SurfacePoint, view: DVec3, light: &Illumination<'_>) -> Rgb {
        self.inner.local(&self.at(point, view), view, light)
    }

    fn emission(&self, point: &SurfacePoint, view: DVec3) -> Rgb {
        self.inner.emission(&self.at(point, view), view)
    }

    fn shadow(&self, point: &SurfacePoint, direction: DVec3, filtered: bool) -> Filter {
        self.inner
            .shadow(&self.at(point, -direction), direction, filtered)
    }

    fn branches(&self, point: &SurfacePoint, view: DVec3, out: &mut Branches) {
        self.inner.branches(&self.at(point, view), view, out);
    }

    fn reflections(&self) -> u32 {
        self.inner.reflections()
    }

    fn distribution(&self, point: &SurfacePoint, view: DVec3) -> Option<Distribution<'_>> {
        self.inner.distribution(&self.at(point, view), view)
    }
}
