use crate::stream::{HitStream, Lanes, RayStream, SurfaceStream};
use crate::{
    Aabb, Footprint, Instance, Interval, LimitReached, Ray, Spans, SurfacePart, TriangleMesh,
    VertexAttributes,
};
use glam::{DVec2, DVec3};
use std::ops::{BitOr, BitOrAssign};

/// The geometry that a shape plugin produces; accelerators see nothing else.
///
/// Coordinates are those of the scene, or of the group that the shape belongs to.
///
/// The number of a shape (`shape_id`) is the index of its table in the flattened scene. Shapes
/// inside groups are numbered after all others.
#[non_exhaustive]
pub enum LoweredShape {
    /// Triangles.
    Triangles(TriangleMesh),
    /// Any other shape, with its own intersection test.
    Custom(Box<dyn Shape>),
    /// An instance of a group of shapes.
    Instance(Box<Instance>),
}

/// A shape that is not made of triangles, in the space of the scene or of its group.
///
/// **Purity law**: results depend only on the ray, the skipped primitive and the object; the
/// interval only filters hits. Otherwise images would depend on the order in which an accelerator
/// visits its nodes.
pub trait Shape: Send + Sync {
    /// A box that contains every point that a ray can hit; infinite for unbounded shapes.
    fn bounds(&self) -> Aabb;

    /// The nearest hit inside the interval.
    ///
    /// `origin_primitive` is the sub-primitive that the ray was spawned on, if it belongs to this
    /// object. A planar sub-primitive is not hit again; a curved one ignores the root at the ray's
    /// start.
    fn intersect(&self, ray: &Ray, interval: Interval, origin_primitive: Option<u32>) -> Option<ShapeHit>;

    /// The surface at a hit that `intersect` returned for this ray. Only the attributes in `needs`
    /// must be valid in the result.
    fn surface(
        &self,
        ray: &Ray,
        hit: &PreliminaryIntersection,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction;

    /// Evaluates the same sub-primitive at the point nearest `q`, which lies in the tangent plane
    /// close to `hit`. Used for ray differentials.
    ///
    /// The primitive is extrapolated past its edge and (u, v) is unwrapped across seams, so that
    /// finite differences stay small. The result depends only on position and (u, v) of `point`,
    /// the surface at the hit. Only the shading normal and the attributes in `needs` are valid in
    /// the result. Shapes without derivatives return `None`: textures of (u, v) then use their
    /// finest level, and reflections treat the surface as flat.
    fn surface_at_offset(
        &self,
        point: &SurfaceInteraction,
        hit: &PreliminaryIntersection,
        q: DVec3,
        needs: SurfaceAttributes,
    ) -> Option<SurfaceInteraction> {
        let _ = (point, hit, q, needs);
        None
    }

    /// Whether the shape bounds a volume, so that it may be an operand of constructive solid
    /// geometry.
    fn is_solid(&self) -> bool {
        false
    }

    /// Adds the parts of the *whole line* of the ray that lie inside the shape, if it is a solid.
    /// The span ends in front of the ray's start equal the hits of [`Self::intersect`] bit for bit,
    /// except where the ray only touches the surface at a point.
    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        let _ = (ray, spans);
    }

    /// Number of sub-primitives of a solid; their ids range from 0 to one less.
    fn primitives(&self) -> u32 {
        1
    }

    /// Whether a ray that starts on this sub-primitive of a solid enters the solid. The default
    /// uses the normal at the start, which suits solids whose normal follows from point and
    /// sub-primitive.
    fn goes_inside(&self, ray: &Ray, primitive: u32) -> bool {
        let start = ShapeHit {
            t: 0.0,
            primitive,
            prim_uv: DVec2::ZERO,
        };
        let point = self.surface(
            ray,
            &start.of_shape(InstanceId::TOP_LEVEL, 0),
            SurfaceAttributes::NOTHING,
        );
        point.n_g.dot(ray.direction) < 0.0
    }

    /// The rays so far on which the search for hits reached its limit, so that a hit may be
    /// missing. `None` if there are none, or if the search has no limit.
    fn search_limit(&self) -> Option<LimitReached> {
        None
    }

    /// The flat, spherical and cylindrical parts of the surface, which may coincide with parts of
    /// other shapes. The default is none: hits on undeclared parts are ordered by computed
    /// distance.
    fn parts(&self) -> Vec<SurfacePart> {
        Vec::new()
    }

    /// [`Self::intersect`] for every ray of a stream. `shape` is the number of this object. Nearer
    /// hits replace those already in `hits`.
    fn intersect_stream(&self, shape: u32, rays: &RayStream, hits: &mut HitStream) {
        for lane in 0..rays.len {
            let interval = Interval::up_to(hits.t.0[lane]);
            let origin_primitive = rays.skip.skip(lane).of_shape(InstanceId::TOP_LEVEL, shape);
            if let Some(hit) = self.intersect(&rays.ray(lane), interval, origin_primitive) {
                hits.offer(lane, true, shape, &hit);
            }
        }
    }

    /// Sets `hidden` in the lanes whose rays hit this object inside their intervals. Other lanes
    /// keep their values.
    fn occluded_stream(&self, shape: u32, rays: &RayStream, hidden: &mut Lanes<bool>) {
        for (lane, hidden) in hidden.iter_mut().enumerate().take(rays.len) {
            let origin_primitive = rays.skip.skip(lane).of_shape(InstanceId::TOP_LEVEL, shape);
            *hidden = *hidden
                || self
                    .intersect(&rays.ray(lane), rays.interval(lane), origin_primitive)
                    .is_some();
        }
    }

    /// [`Self::surface`] for every ray of a stream, all of which hit this object.
    fn surface_stream(
        &self,
        rays: &RayStream,
        hits: &HitStream,
        needs: SurfaceAttributes,
        points: &mut SurfaceStream,
    ) {
        for lane in 0..rays.len {
            points.set(lane, &self.surface(&rays.ray(lane), &hits.hit(lane), needs));
        }
    }
}

/// A hit as returned by a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeHit {
    /// Ray parameter.
    pub t: f64,
    /// Number of the sub-primitive (for a box, its face); 0 if there is only one.
    pub primitive: u32,
    /// Two numbers that `intersect` passes to `surface`. Each shape defines their meaning: surface
    /// parameters, or for example a position on the ray.
    pub prim_uv: DVec2,
}

impl ShapeHit {
    /// Converts to the form that an accelerator returns.
    #[inline]
    pub fn of_shape(self, instance: InstanceId, shape: u32) -> PreliminaryIntersection {
        PreliminaryIntersection {
            t: self.t,
            prim_uv: self.prim_uv,
            instance,
            shape,
            primitive: self.primitive,
        }
    }
}

/// The instance that a hit shape belongs to: [`InstanceId::TOP_LEVEL`] if it is not instanced.
/// Instances are numbered depth first in scene order; nested instances directly follow their
/// parent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct InstanceId(pub u32);

impl InstanceId {
    /// Not inside any instance.
    pub const TOP_LEVEL: Self = Self(0);
}

/// A hit as returned by an accelerator: without normals and texture coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PreliminaryIntersection {
    /// Ray parameter.
    pub t: f64,
    /// Two surface parameters; for triangles the barycentric weights of the second and third
    /// vertex.
    pub prim_uv: DVec2,
    /// Instance of the shape.
    pub instance: InstanceId,
    /// Number of the shape in the scene.
    pub shape: u32,
    /// Number of the primitive in the shape.
    pub primitive: u32,
}

impl PreliminaryIntersection {
    /// The identifiers that break ties between hits at equal distance: the lowest wins.
    #[inline]
    pub fn id(&self) -> (InstanceId, u32, u32) {
        (self.instance, self.shape, self.primitive)
    }

    /// Whether this hit wins over `other`: it is nearer, or equally near with a lower id.
    #[inline]
    pub fn is_nearer_than(&self, other: &Self) -> bool {
        self.t < other.t || (self.t == other.t && self.id() < other.id())
    }
}

/// The primitive that a spawned ray starts on, which it must not hit again (self-intersection
/// filter).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SelfHitFilter(Option<(InstanceId, u32, u32)>);

impl SelfHitFilter {
    /// Nothing is skipped: for camera rays.
    pub const NOTHING: Self = Self(None);

    /// A ray that leaves the primitive of `hit`.
    pub fn leaving(hit: &PreliminaryIntersection) -> Self {
        Self(Some(hit.id()))
    }

    /// A ray that leaves this primitive of this shape.
    pub const fn of(instance: InstanceId, shape: u32, primitive: u32) -> Self {
        Self(Some((instance, shape, primitive)))
    }

    /// The skipped primitive, if any: instance, shape, primitive.
    pub const fn id(&self) -> Option<(InstanceId, u32, u32)> {
        self.0
    }

    /// The skipped sub-primitive, if it belongs to this shape.
    #[inline]
    pub fn of_shape(&self, instance: InstanceId, shape: u32) -> Option<u32> {
        match self.0 {
            Some((i, s, primitive)) if i == instance && s == shape => Some(primitive),
            _ => None,
        }
    }
}

/// The set of surface attributes that a consumer of surface interactions reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SurfaceAttributes(u32);

impl SurfaceAttributes {
    /// Position, error bound and geometric normal only, which are always computed.
    pub const NOTHING: Self = Self(0);
    /// The interpolated normal; without it the shading normal equals the geometric one.
    pub const SHADING_NORMAL: Self = Self(1);
    /// Texture coordinates.
    pub const UV: Self = Self(2);
    /// Some texture is evaluated. Shapes ignore this; it feeds the counters of `explain --measure`.
    pub const TEXTURE: Self = Self(4);
    /// The footprint. Shapes ignore this in `surface`, but rays then carry ray differentials.
    pub const FOOTPRINT: Self = Self(8);
    /// The vertex colour of a mesh.
    pub const VERTEX_COLOR: Self = Self(16);
    /// The second texture coordinates of a mesh.
    pub const SECOND_UV: Self = Self(32);
    /// The tangent of a mesh.
    pub const TANGENT: Self = Self(64);
    /// The gradients of the texture coordinates. Shapes ignore this; the scene computes them.
    pub const UV_GRADIENT: Self = Self(128);
    /// All of these.
    pub const ALL: Self = Self(255);

    /// Whether any of `other` is in this set.
    pub const fn intersects(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// Whether all of `other` is in this set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

impl BitOr for SurfaceAttributes {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl BitOrAssign for SurfaceAttributes {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

/// A point on a surface, in the space of the scene or of its group.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceInteraction {
    /// On the surface, within `error`.
    pub position: DVec3,
    /// Upper bound on the distance of `position` from the surface, in metres along the normal. The
    /// origin of a spawned ray is offset from `position` by this distance, so it must also cover
    /// the rounding of [`Self::spawn_origin`]: one more unit roundoff of the coordinates.
    pub error: f64,
    /// Unit geometric normal; it points to the outside of the surface.
    pub n_g: DVec3,
    /// Unit shading normal.
    pub n_s: DVec3,
    /// Texture coordinates.
    pub uv: DVec2,
    /// Gradients of u and v on the surface, per metre; see [`crate::Geometry::uv_gradient`]. The
    /// scene adds them if the material reads them; otherwise they are zero.
    pub uv_gradient: [DVec3; 2],
    /// Footprint of the ray; the integrator adds it if the material reads it.
    pub footprint: Footprint,
    /// Attributes that only meshes have.
    pub vertex: VertexAttributes,
}

impl SurfaceInteraction {
    /// A point whose shading normal is the geometric one and whose texture coordinates are zero.
    #[inline(always)]
    pub const fn new(position: DVec3, error: f64, n_g: DVec3) -> Self {
        Self {
            position,
            error,
            n_g,
            n_s: n_g,
            uv: DVec2::ZERO,
            uv_gradient: [DVec3::ZERO; 2],
            footprint: Footprint::NONE,
            vertex: VertexAttributes::NONE,
        }
    }

    /// Origin of a ray spawned in direction `d`: `position`, offset along the normal by `error` to
    /// the side that `d` points to.
    #[inline(always)]
    pub fn spawn_origin(&self, d: DVec3) -> DVec3 {
        self.position + (self.error * self.n_g.dot(d).signum()) * self.n_g
    }

    /// Rule S of the model: flips the shading normal if it disagrees with the geometric normal
    /// about which side the viewer (in direction `view`) is on.
    #[must_use]
    #[inline(always)]
    pub fn seen_from(mut self, view: DVec3) -> Self {
        if self.n_s.dot(view) * self.n_g.dot(view) < 0.0 {
            self.n_s = -self.n_s;
        }
        self
    }

    /// The shading normal, oriented towards a viewer in direction `view`; call after
    /// [`Self::seen_from`].
    #[inline(always)]
    pub fn n_towards(&self, view: DVec3) -> DVec3 {
        if self.n_g.dot(view) >= 0.0 {
            self.n_s
        } else {
            -self.n_s
        }
    }

    /// Rule G of the model for reflected directions: `a` and `b` are on the same side of the
    /// geometry.
    #[inline(always)]
    pub fn same_side(&self, a: DVec3, b: DVec3) -> bool {
        self.n_g.dot(a) * self.n_g.dot(b) > 0.0
    }

    /// Rule G for transmitted directions: `a` and `b` are on opposite sides of the geometry.
    #[inline(always)]
    pub fn opposite_sides(&self, a: DVec3, b: DVec3) -> bool {
        self.n_g.dot(a) * self.n_g.dot(b) < 0.0
    }
}
