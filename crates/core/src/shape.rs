use crate::stream::{HitStream, Lanes, PointStream, RayStream};
use crate::{Aabb, Footprint, Instance, Interval, Ray, Spans, SurfacePart, TriangleMesh};
use glam::{DVec2, DVec3};
use std::ops::{BitOr, BitOrAssign};

/// What a shape turns itself into: all that an accelerator sees. Its number in the scene
/// (`shape_id`) is the place of its table in the file; the shapes of groups are numbered behind all
/// others.
#[non_exhaustive]
pub enum Shape {
    /// Triangles in world space.
    Triangles(TriangleMesh),
    /// Anything else that can intersect a ray.
    Opaque(Box<dyn Primitive>),
    /// A copy of a group of shapes.
    Instance(Box<Instance>),
}

/// A thing that rays hit and that is not made of triangles, in world space.
///
/// **Purity law**: what is returned depends on the ray, the skipped primitive and the object only;
/// the interval merely filters. Without it, images would depend on the order in which an
/// accelerator visits its nodes.
pub trait Primitive: Send + Sync {
    /// A box that holds every point that a ray can hit; infinite for endless shapes.
    fn bounds(&self) -> Aabb;

    /// The nearest hit inside the interval. `leaves` names the sub-primitive that the ray was
    /// spawned on, if it is one of this object's: a planar one is not hit again; a curved one
    /// ignores the root that is the start itself.
    fn closest(&self, ray: &Ray, interval: Interval, leaves: Option<u32>) -> Option<PrimitiveHit>;

    /// The surface at a hit that `closest` returned for this ray. Only what `needs` names must be
    /// right in the result.
    fn surface(&self, ray: &Ray, hit: &RawHit, needs: Needs) -> SurfacePoint;

    /// The surface next to a hit, nearest to `q`, which is beside it in its tangent plane: the same
    /// sub-primitive, which goes on beyond its border, with texture coordinates that go on too
    /// where they start anew. Of `point`, the surface at the hit, only position and texture
    /// coordinates are read; of the result only the shading normal and what `needs` names. `None`
    /// from shapes that cannot tell: textures of (u, v) show their finest level there, and mirrors
    /// count as flat.
    fn beside(&self, point: &SurfacePoint, hit: &RawHit, q: DVec3, needs: Needs) -> Option<SurfacePoint> {
        let _ = (point, hit, q, needs);
        None
    }

    /// Whether it bounds a volume, so that it may be an operand of constructive solid geometry.
    fn solid(&self) -> bool {
        false
    }

    /// Adds the parts of the *whole line* of the ray that lie inside, if this is a solid. What lies
    /// in front of the ray's start are the hits of [`Self::closest`], bit for bit, but for those
    /// that touch at a single point.
    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        let _ = (ray, spans);
    }

    /// How many sub-primitives a solid has: their numbers are below.
    fn primitives(&self) -> u32 {
        1
    }

    /// Whether a ray that starts on this sub-primitive of a solid goes inside. By default what the
    /// normal at the start says, for solids whose normal follows from point and number.
    fn goes_inside(&self, ray: &Ray, primitive: u32) -> bool {
        let start = PrimitiveHit {
            t: 0.0,
            primitive,
            params: DVec2::ZERO,
        };
        let point = self.surface(ray, &start.of_shape(InstancePath::WORLD, 0), Needs::NOTHING);
        point.n_g.dot(ray.direction) < 0.0
    }

    /// The parts of its surface that are flat, spherical or cylindrical, which may coincide with
    /// those of other shapes. By default none: surfaces that nobody knows of are met in the order
    /// of the distances as they are computed.
    fn parts(&self) -> Vec<SurfacePart> {
        Vec::new()
    }

    /// [`Self::closest`] for every ray of a stream; `shape` is the number of this object. Hits that
    /// were found before are replaced by nearer ones.
    fn closest_stream(&self, shape: u32, rays: &RayStream, hits: &mut HitStream) {
        for lane in 0..rays.len {
            let interval = Interval::up_to(hits.t.0[lane]);
            let leaves = rays.skip.skip(lane).of_shape(InstancePath::WORLD, shape);
            if let Some(hit) = self.closest(&rays.ray(lane), interval, leaves) {
                hits.offer(lane, true, shape, &hit);
            }
        }
    }

    /// Sets the lanes of the rays that this object hits inside their intervals.
    fn occluded_stream(&self, shape: u32, rays: &RayStream, hidden: &mut Lanes<bool>) {
        for (lane, hidden) in hidden.iter_mut().enumerate().take(rays.len) {
            let leaves = rays.skip.skip(lane).of_shape(InstancePath::WORLD, shape);
            *hidden = *hidden
                || self
                    .closest(&rays.ray(lane), rays.interval(lane), leaves)
                    .is_some();
        }
    }

    /// [`Self::surface`] for every ray of a stream, all of which hit this object.
    fn surface_stream(&self, rays: &RayStream, hits: &HitStream, needs: Needs, points: &mut PointStream) {
        for lane in 0..rays.len {
            points.set(lane, &self.surface(&rays.ray(lane), &hits.hit(lane), needs));
        }
    }
}

/// A hit as a primitive sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrimitiveHit {
    /// Ray parameter.
    pub t: f64,
    /// Number of the sub-primitive (the face of a box); 0 where there is one only.
    pub primitive: u32,
    /// Two surface parameters; their meaning is the primitive's own.
    pub params: DVec2,
}

impl PrimitiveHit {
    /// As an accelerator returns it.
    #[inline]
    pub fn of_shape(self, instance: InstancePath, shape: u32) -> RawHit {
        RawHit {
            t: self.t,
            params: self.params,
            instance,
            shape,
            primitive: self.primitive,
        }
    }
}

/// Which copy of a shape was hit: [`InstancePath::WORLD`] for what is not instanced. Copies are
/// numbered depth first in the order of the scene, copies within a copy right behind it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct InstancePath(pub u32);

impl InstancePath {
    /// Not inside any instance.
    pub const WORLD: Self = Self(0);
}

/// A hit as an accelerator returns it: no normals, no texture coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RawHit {
    /// Ray parameter.
    pub t: f64,
    /// Two surface parameters; for triangles the barycentric weights of the second and third
    /// vertex.
    pub params: DVec2,
    /// Copy of the shape.
    pub instance: InstancePath,
    /// Number of the shape in the scene.
    pub shape: u32,
    /// Number of the primitive in the shape.
    pub primitive: u32,
}

impl RawHit {
    /// The order in which hits at the same distance win: lowest first.
    #[inline]
    pub fn id(&self) -> (InstancePath, u32, u32) {
        (self.instance, self.shape, self.primitive)
    }

    /// Whether this hit is to be preferred to `other`: nearer, or equally near and lower in number.
    #[inline]
    pub fn beats(&self, other: &Self) -> bool {
        self.t < other.t || (self.t == other.t && self.id() < other.id())
    }
}

/// The primitive that a spawned ray starts on, so that it is not hit again by rounding.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Skip(Option<(InstancePath, u32, u32)>);

impl Skip {
    /// A camera ray: nothing is skipped.
    pub const NOTHING: Self = Self(None);

    /// A ray that leaves the primitive of `hit`.
    pub fn leaving(hit: &RawHit) -> Self {
        Self(Some(hit.id()))
    }

    /// A ray that leaves this primitive of this shape.
    pub const fn of(instance: InstancePath, shape: u32, primitive: u32) -> Self {
        Self(Some((instance, shape, primitive)))
    }

    /// What is skipped, if anything is: copy, shape, primitive.
    pub const fn id(&self) -> Option<(InstancePath, u32, u32)> {
        self.0
    }

    /// The sub-primitive of this shape that is left, if it is one of this shape's.
    #[inline]
    pub fn of_shape(&self, instance: InstancePath, shape: u32) -> Option<u32> {
        match self.0 {
            Some((i, s, primitive)) if i == instance && s == shape => Some(primitive),
            _ => None,
        }
    }
}

/// What a consumer of surface points wants computed, as a set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Needs(u32);

impl Needs {
    /// Position, error bound and geometric normal only: these are always given.
    pub const NOTHING: Self = Self(0);
    /// The interpolated normal; without it the shading normal equals the geometric one.
    pub const SHADING_NORMAL: Self = Self(1);
    /// Texture coordinates.
    pub const UV: Self = Self(2);
    /// Some texture is asked: nothing that a shape computes, but the counters of
    /// `explain --measure` tell it.
    pub const TEXTURE: Self = Self(4);
    /// What neighbouring rays see: nothing that a shape computes in `surface`, but rays then carry
    /// how far apart they are.
    pub const FOOTPRINT: Self = Self(8);
    /// All of these.
    pub const EVERYTHING: Self = Self(15);

    /// Whether all of `other` is in this set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

impl BitOr for Needs {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl BitOrAssign for Needs {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

/// A point on a surface, in world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// On the surface up to `error`.
    pub position: DVec3,
    /// Bound on the distance of `position` from the surface, in metres, along its normal: rays
    /// leave from this far above the surface.
    pub error: f64,
    /// Unit normal of the geometry; it points outside.
    pub n_g: DVec3,
    /// Unit normal for shading.
    pub n_s: DVec3,
    /// Texture coordinates.
    pub uv: DVec2,
    /// What the neighbouring rays see: the integrator adds it where the material reads it.
    pub footprint: Footprint,
}

impl SurfacePoint {
    /// A point whose shading normal is the geometric one and whose texture coordinates are zero.
    #[inline(always)]
    pub const fn new(position: DVec3, error: f64, n_g: DVec3) -> Self {
        Self {
            position,
            error,
            n_g,
            n_s: n_g,
            uv: DVec2::ZERO,
            footprint: Footprint::NONE,
        }
    }

    /// Where a ray in direction `d` leaves: on that side of the surface, beyond its error bound.
    #[inline(always)]
    pub fn leave(&self, d: DVec3) -> DVec3 {
        self.position + (self.error * self.n_g.dot(d).signum()) * self.n_g
    }

    /// Rule S of the model: the shading normal, made to agree with the geometric one about the side
    /// that the viewer (in direction `view`) is on.
    #[must_use]
    #[inline(always)]
    pub fn seen_from(mut self, view: DVec3) -> Self {
        if self.n_s.dot(view) * self.n_g.dot(view) < 0.0 {
            self.n_s = -self.n_s;
        }
        self
    }

    /// The shading normal turned towards a viewer in direction `view`; after [`Self::seen_from`].
    #[inline(always)]
    pub fn n_towards(&self, view: DVec3) -> DVec3 {
        if self.n_g.dot(view) >= 0.0 {
            self.n_s
        } else {
            -self.n_s
        }
    }

    /// Rule G of the model for directions that must be on the viewer's side of the geometry.
    #[inline(always)]
    pub fn same_side(&self, a: DVec3, b: DVec3) -> bool {
        self.n_g.dot(a) * self.n_g.dot(b) > 0.0
    }

    /// Rule G for transmitted directions.
    #[inline(always)]
    pub fn opposite_sides(&self, a: DVec3, b: DVec3) -> bool {
        self.n_g.dot(a) * self.n_g.dot(b) < 0.0
    }
}
