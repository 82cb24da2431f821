use crate::simd;
use crate::stream::{GROUP, HitStream, LANES, Lanes, RayStream, SurfaceStream};
use crate::{
    Aabb, InstanceId, Interval, PreliminaryIntersection, Ray, Shape, ShapeHit, Spans, SurfaceAttributes,
    SurfaceInteraction, SurfacePart,
};
use glam::{DVec2, DVec3};

/// The value of `origin_primitive` for rays that start on no sub-primitive.
pub const NO_PRIMITIVE: u32 = u32::MAX;

/// A [`Shape`] with branchless arithmetic: written once for a single ray, and vectorised for
/// streams of rays.
///
/// Mark every method `#[inline(always)]`. Select with `if a { b } else { c }` between *values* that
/// are both computed, combine conditions with `&` and `|`, and return NaN instead of returning
/// early. Methods are also called for unused lanes and must not panic. (Repeated `if`s on the same
/// condition may compile to a branch; [`simd::select`] never does.)
pub trait ShapeKernel: Clone + Send + Sync {
    /// Whether texture coordinates, too, need no function without a vector form (such as `atan2`).
    const VECTOR_UV: bool = false;

    /// See [`Shape::bounds`].
    fn bounds(&self) -> Aabb;

    /// A cheap conservative test: false only if the ray cannot hit. A group of rays that all fail
    /// it is skipped.
    fn may_hit(&self, ray: &Ray) -> bool;

    /// The nearest hit beyond `min`; `t` is NaN if there is none. `origin_primitive` is the
    /// sub-primitive of this object that the ray starts on, or [`NO_PRIMITIVE`].
    fn hit(&self, ray: &Ray, min: f64, origin_primitive: u32) -> ShapeHit;

    /// Whether the ray needs all of [`Self::hit`], instead of [`Self::hit_near`].
    fn is_far(&self, ray: &Ray) -> bool {
        let _ = ray;
        true
    }

    /// The same as [`Self::hit`], to the bit, for rays that are not far ([`Self::is_far`]): less
    /// work if the shape has cases that only distant rays need.
    fn hit_near(&self, ray: &Ray, min: f64, origin_primitive: u32) -> ShapeHit {
        self.hit(ray, min, origin_primitive)
    }

    /// See [`Shape::surface`]. `n_s` must not depend on `needs`: streams request only `UV` (if
    /// `VECTOR_UV`) or nothing. A shape with interpolated normals implements [`Shape`] instead.
    fn surface(
        &self,
        ray: &Ray,
        hit: &PreliminaryIntersection,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction;

    /// See [`Shape::surface_at_offset`]; may branch.
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

    /// See [`Shape::is_solid`].
    fn is_solid(&self) -> bool {
        false
    }

    /// See [`Shape::spans`]; may branch.
    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        let _ = (ray, spans);
    }

    /// See [`Shape::primitives`].
    fn primitives(&self) -> u32 {
        1
    }

    /// See [`Shape::parts`]; may branch.
    fn parts(&self) -> Vec<SurfacePart> {
        Vec::new()
    }
}

impl<P: ShapeKernel> Shape for P {
    fn bounds(&self) -> Aabb {
        ShapeKernel::bounds(self)
    }

    fn intersect(&self, ray: &Ray, interval: Interval, origin_primitive: Option<u32>) -> Option<ShapeHit> {
        if !self.may_hit(ray) {
            return None;
        }
        let hit = self.hit(ray, interval.min, origin_primitive.unwrap_or(NO_PRIMITIVE));
        interval.contains(hit.t).then_some(hit)
    }

    fn surface(
        &self,
        ray: &Ray,
        hit: &PreliminaryIntersection,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction {
        ShapeKernel::surface(self, ray, hit, needs)
    }

    fn surface_at_offset(
        &self,
        point: &SurfaceInteraction,
        hit: &PreliminaryIntersection,
        q: DVec3,
        needs: SurfaceAttributes,
    ) -> Option<SurfaceInteraction> {
        ShapeKernel::surface_at_offset(self, point, hit, q, needs)
    }

    fn is_solid(&self) -> bool {
        ShapeKernel::is_solid(self)
    }

    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        ShapeKernel::spans(self, ray, spans);
    }

    fn primitives(&self) -> u32 {
        ShapeKernel::primitives(self)
    }

    fn parts(&self) -> Vec<SurfacePart> {
        ShapeKernel::parts(self)
    }

    fn intersect_stream(&self, shape: u32, rays: &RayStream, hits: &mut HitStream) {
        // An unaliased local copy: its fields stay in registers.
        let kernel = self.clone();
        simd::dispatch(
            #[inline(always)]
            || {
                for start in rays.groups() {
                    let near = near(&kernel, rays, start);
                    if !any(&near) {
                        continue;
                    }
                    let mut t = [0.0; GROUP];
                    let (mut u, mut v) = (t, t);
                    let mut sub_primitive = [0; GROUP];
                    // Twice the same loop: the choice is made once for a group.
                    if any_far(&kernel, rays, start) {
                        for k in 0..GROUP {
                            let lane = start + k;
                            let hit = kernel.hit(&rays.ray(lane), 0.0, origin_primitive(rays, lane, shape));
                            (t[k], u[k], v[k]) = (hit.t, hit.prim_uv.x, hit.prim_uv.y);
                            sub_primitive[k] = hit.primitive;
                        }
                    } else {
                        for k in 0..GROUP {
                            let lane = start + k;
                            let origin = origin_primitive(rays, lane, shape);
                            let hit = kernel.hit_near(&rays.ray(lane), 0.0, origin);
                            (t[k], u[k], v[k]) = (hit.t, hit.prim_uv.x, hit.prim_uv.y);
                            sub_primitive[k] = hit.primitive;
                        }
                    }
                    for k in 0..GROUP {
                        let hit = ShapeHit {
                            t: t[k],
                            primitive: sub_primitive[k],
                            prim_uv: DVec2::new(u[k], v[k]),
                        };
                        hits.offer(start + k, near[k], shape, &hit);
                    }
                }
            },
        );
    }

    fn occluded_stream(&self, shape: u32, rays: &RayStream, hidden: &mut Lanes<bool>) {
        let kernel = self.clone();
        simd::dispatch(
            #[inline(always)]
            || {
                for start in rays.groups() {
                    let near = near(&kernel, rays, start);
                    if !any(&near) {
                        continue;
                    }
                    let mut hit = [false; GROUP];
                    if any_far(&kernel, rays, start) {
                        for k in 0..GROUP {
                            let lane = start + k;
                            let origin = origin_primitive(rays, lane, shape);
                            let t = kernel.hit(&rays.ray(lane), 0.0, origin).t;
                            hit[k] = near[k] & (t > 0.0) & (t < rays.limit[lane]);
                        }
                    } else {
                        for k in 0..GROUP {
                            let lane = start + k;
                            let origin = origin_primitive(rays, lane, shape);
                            let t = kernel.hit_near(&rays.ray(lane), 0.0, origin).t;
                            hit[k] = near[k] & (t > 0.0) & (t < rays.limit[lane]);
                        }
                    }
                    for k in 0..GROUP {
                        hidden[start + k] |= hit[k];
                    }
                }
            },
        );
    }

    fn surface_stream(
        &self,
        rays: &RayStream,
        hits: &HitStream,
        needs: SurfaceAttributes,
        points: &mut SurfaceStream,
    ) {
        let kernel = self.clone();
        // Texture coordinates may need functions without a vector form.
        if needs.contains(SurfaceAttributes::UV) && !P::VECTOR_UV {
            for lane in 0..rays.len.min(LANES) {
                let point = ShapeKernel::surface(&kernel, &rays.ray(lane), &hits.hit(lane), needs);
                points.set_geometry(lane, &point);
            }
            return;
        }
        let last = kernel.primitives() - 1;
        simd::dispatch(
            #[inline(always)]
            || {
                // Constants, so that the compiler drops what is not needed.
                let needs = match P::VECTOR_UV {
                    true => SurfaceAttributes::UV,
                    false => SurfaceAttributes::NOTHING,
                };
                for start in rays.groups() {
                    for lane in start..start + GROUP {
                        let mut hit = hits.hit(lane);
                        // An unused lane may contain the number of another shape's primitive.
                        hit.primitive = hit.primitive.min(last);
                        let point = ShapeKernel::surface(&kernel, &rays.ray(lane), &hit, needs);
                        points.set_geometry(lane, &point);
                    }
                }
            },
        );
    }
}

#[inline(always)]
fn origin_primitive(rays: &RayStream, lane: usize, shape: u32) -> u32 {
    let this = (rays.skip.shape[lane] == shape) & (rays.skip.instance[lane] == InstanceId::TOP_LEVEL.0);
    simd::select(this, rays.skip.primitive[lane], NO_PRIMITIVE)
}

/// Which rays of a group may hit.
#[inline(always)]
fn near(kernel: &impl ShapeKernel, rays: &RayStream, start: usize) -> [bool; GROUP] {
    let mut near = [false; GROUP];
    for (k, near) in near.iter_mut().enumerate() {
        *near = kernel.may_hit(&rays.ray(start + k));
    }
    near
}

/// Whether any ray of a group is far.
#[inline(always)]
fn any_far(kernel: &impl ShapeKernel, rays: &RayStream, start: usize) -> bool {
    let mut far = [false; GROUP];
    for (k, far) in far.iter_mut().enumerate() {
        *far = kernel.is_far(&rays.ray(start + k));
    }
    any(&far)
}

#[inline(always)]
fn any(near: &[bool; GROUP]) -> bool {
    near.iter().fold(false, |any, near| any | near)
}
