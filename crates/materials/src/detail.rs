//! Surface detail: another normal for shading, over any material.

use std::sync::Arc;
use whitstone_core::{Branches, DVec3, Filter, Illumination, Lobes, Material, Needs, Rgb, SurfacePoint};

/// Where a normal for shading comes from.
pub(crate) trait Detail: Send + Sync {
    /// What it reads of a surface point.
    fn needs(&self) -> Needs;

    /// The unit normal in the place of n_s, which points outside; `None` where there is none.
    fn normal(&self, point: &SurfacePoint) -> Option<DVec3>;
}

/// A material that is shaded by other normals.
pub(crate) struct Detailed<D> {
    pub(crate) detail: D,
    pub(crate) inner: Arc<dyn Material>,
}

impl<D: Detail> Detailed<D> {
    /// The point with the other normal, unless a viewer who sees one side of the surface would see the other one of the normal.
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
}
