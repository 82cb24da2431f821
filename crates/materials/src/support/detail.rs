//! Perturbed shading normals, shared by `bump` and `normal_map`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::Vector3;
use whitstone_core::{
    BsdfFlags, ColorSource, DVec3, GlossyLobe, LightSamples, Material, Rgb, SceneErrors, SpecularRayKind,
    SpecularRays, SurfaceAttributes, SurfaceInteraction, TangentField, Transmittance,
};

/// The key `tangent`: a direction, or "mesh".
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(untagged, expecting = "expected a direction as three numbers, or \"mesh\"")]
pub(crate) enum Tangent {
    /// A direction in world space.
    Direction(Vector3),
    /// That of the mesh.
    Of(OfMesh),
}

/// The word "mesh".
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum OfMesh {
    /// The tangents of a mesh with `tangents = true`.
    Mesh,
}

/// Tangent frame of the surface or of a mesh.
pub(crate) enum Frame {
    Field(TangentField),
    Mesh,
}

impl Frame {
    /// Creates a frame from a world-space tangent or axis; the tangent is +x by default.
    pub(crate) fn new(
        tangent: Option<Spanned<Tangent>>,
        axis: Option<&Spanned<Vector3>>,
    ) -> Result<Self, SceneErrors> {
        let tangent = match tangent.map(|tangent| (tangent.span(), tangent.into_inner())) {
            Some((_, Tangent::Of(OfMesh::Mesh))) if axis.is_none() => return Ok(Self::Mesh),
            // Any direction: given with `axis` it is an error.
            Some((span, Tangent::Of(OfMesh::Mesh))) => Some(Spanned::new(span, Vector3::new(1.0, 0.0, 0.0))),
            Some((span, Tangent::Direction(direction))) => Some(Spanned::new(span, direction)),
            None => None,
        };
        TangentField::new(tangent.as_ref(), axis).map(Self::Field)
    }

    /// Decodes a tangent-space vector into world space; `None` where the tangent is degenerate.
    ///
    /// `strength` scales its components along the tangents.
    pub(crate) fn vector(
        &self,
        parts: &ColorSource,
        strength: f64,
        point: &SurfaceInteraction,
    ) -> Option<DVec3> {
        let (field, handedness) = match self {
            Self::Field(field) => (*field, 1.0),
            Self::Mesh => (TangentField::Along(point.vertex.tangent), point.vertex.handedness),
        };
        let scale = DVec3::new(strength, strength * handedness, 1.0);
        field.vector(scale * parts.value(point).to_vector(), point.n_s)
    }

    /// The surface attributes that it reads besides the shading normal.
    pub(crate) fn needs(&self) -> SurfaceAttributes {
        match self {
            Self::Mesh => SurfaceAttributes::TANGENT,
            Self::Field(_) => SurfaceAttributes::NOTHING,
        }
    }
}

/// A source of perturbed shading normals.
pub(crate) trait Detail: Send + Sync {
    /// The surface attributes that it reads.
    fn needs(&self) -> SurfaceAttributes;

    /// The unit normal that replaces n_s, on the outside of the surface; `None` to keep n_s.
    fn normal(&self, point: &SurfaceInteraction) -> Option<DVec3>;
}

/// A material that is shaded with perturbed normals.
pub(crate) struct Detailed<D> {
    pub(crate) detail: D,
    pub(crate) inner: Arc<dyn Material>,
}

impl<D: Detail> Detailed<D> {
    /// The point with the perturbed normal. Keeps n_s where the viewer would be on different sides
    /// of the perturbed and the geometric normal.
    fn at(&self, point: &SurfaceInteraction, view: DVec3) -> SurfaceInteraction {
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
    fn flags(&self) -> BsdfFlags {
        self.inner.flags() | BsdfFlags::NORMAL_MAPPED
    }

    fn needs(&self) -> SurfaceAttributes {
        self.inner.needs() | self.detail.needs() | SurfaceAttributes::SHADING_NORMAL
    }

    fn local_illumination(&self, point: &SurfaceInteraction, view: DVec3, light: &LightSamples<'_>) -> Rgb {
        self.inner.local_illumination(&self.at(point, view), view, light)
    }

    fn emission(&self, point: &SurfaceInteraction, view: DVec3) -> Rgb {
        self.inner.emission(&self.at(point, view), view)
    }

    fn shadow_transmittance(
        &self,
        point: &SurfaceInteraction,
        direction: DVec3,
        filtered: bool,
    ) -> Transmittance {
        self.inner
            .shadow_transmittance(&self.at(point, -direction), direction, filtered)
    }

    fn specular_rays(&self, point: &SurfaceInteraction, view: DVec3, out: &mut SpecularRays) {
        self.inner.specular_rays(&self.at(point, view), view, out);
    }

    fn reflections(&self) -> u32 {
        self.inner.reflections()
    }

    fn transmissions(&self) -> u32 {
        self.inner.transmissions()
    }

    fn glossy_lobe(
        &self,
        point: &SurfaceInteraction,
        view: DVec3,
        kind: SpecularRayKind,
    ) -> Option<GlossyLobe<'_>> {
        self.inner.glossy_lobe(&self.at(point, view), view, kind)
    }
}
