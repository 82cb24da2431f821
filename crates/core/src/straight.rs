use crate::simd;
use crate::stream::{GROUP, HitStream, LANES, Lanes, PointStream, RayStream};
use crate::{
    Aabb, InstancePath, Interval, Needs, Primitive, PrimitiveHit, RawHit, Ray, Spans, SurfacePart,
    SurfacePoint,
};
use glam::{DVec2, DVec3};

/// The value of `leaves` for rays that start on no sub-primitive.
pub const LEAVES_NOTHING: u32 = u32::MAX;

/// A [`Primitive`] with branchless arithmetic: written once for a single ray, and vectorised for
/// streams of rays.
///
/// Mark every method `#[inline(always)]`. Select with `if a { b } else { c }` between *values* that
/// are both computed, combine conditions with `&` and `|`, and return NaN instead of returning
/// early. Methods are also called for unused lanes and must not panic. (Repeated `if`s on the same
/// condition may compile to a branch; [`simd::select`] never does.)
pub trait Straight: Clone + Send + Sync {
    /// See [`Primitive::bounds`].
    fn bounds(&self) -> Aabb;

    /// A cheap conservative test: false only if the ray cannot hit. A group of rays that all fail
    /// it is skipped.
    fn comes_near(&self, ray: &Ray) -> bool;

    /// The nearest hit beyond `min`; `t` is NaN if there is none. `leaves` is the sub-primitive of
    /// this object that the ray starts on, or [`LEAVES_NOTHING`].
    fn hit(&self, ray: &Ray, min: f64, leaves: u32) -> PrimitiveHit;

    /// See [`Primitive::surface`].
    fn surface(&self, ray: &Ray, hit: &RawHit, needs: Needs) -> SurfacePoint;

    /// See [`Primitive::beside`]; may branch.
    fn beside(&self, point: &SurfacePoint, hit: &RawHit, q: DVec3, needs: Needs) -> Option<SurfacePoint> {
        let _ = (point, hit, q, needs);
        None
    }

    /// See [`Primitive::solid`].
    fn solid(&self) -> bool {
        false
    }

    /// See [`Primitive::spans`]; may branch.
    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        let _ = (ray, spans);
    }

    /// See [`Primitive::primitives`].
    fn primitives(&self) -> u32 {
        1
    }

    /// See [`Primitive::parts`]; may branch.
    fn parts(&self) -> Vec<SurfacePart> {
        Vec::new()
    }
}

impl<P: Straight> Primitive for P {
    fn bounds(&self) -> Aabb {
        Straight::bounds(self)
    }

    fn closest(&self, ray: &Ray, interval: Interval, leaves: Option<u32>) -> Option<PrimitiveHit> {
        if !self.comes_near(ray) {
            return None;
        }
        let hit = self.hit(ray, interval.min, leaves.unwrap_or(LEAVES_NOTHING));
        interval.contains(hit.t).then_some(hit)
    }

    fn surface(&self, ray: &Ray, hit: &RawHit, needs: Needs) -> SurfacePoint {
        Straight::surface(self, ray, hit, needs)
    }

    fn beside(&self, point: &SurfacePoint, hit: &RawHit, q: DVec3, needs: Needs) -> Option<SurfacePoint> {
        Straight::beside(self, point, hit, q, needs)
    }

    fn solid(&self) -> bool {
        Straight::solid(self)
    }

    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        Straight::spans(self, ray, spans);
    }

    fn primitives(&self) -> u32 {
        Straight::primitives(self)
    }

    fn parts(&self) -> Vec<SurfacePart> {
        Straight::parts(self)
    }

    fn closest_stream(&self, shape: u32, rays: &RayStream, hits: &mut HitStream) {
        // An unaliased local copy: its fields stay in registers.
        let primitive = self.clone();
        simd::dispatch(
            #[inline(always)]
            || {
                for start in rays.groups() {
                    let near = near(&primitive, rays, start);
                    if !any(&near) {
                        continue;
                    }
                    let mut t = [0.0; GROUP];
                    let (mut u, mut v) = (t, t);
                    let mut sub_primitive = [0; GROUP];
                    for k in 0..GROUP {
                        let lane = start + k;
                        let hit = primitive.hit(&rays.ray(lane), 0.0, leaves(rays, lane, shape));
                        (t[k], u[k], v[k]) = (hit.t, hit.params.x, hit.params.y);
                        sub_primitive[k] = hit.primitive;
                    }
                    for k in 0..GROUP {
                        let hit = PrimitiveHit {
                            t: t[k],
                            primitive: sub_primitive[k],
                            params: DVec2::new(u[k], v[k]),
                        };
                        hits.offer(start + k, near[k], shape, &hit);
                    }
                }
            },
        );
    }

    fn occluded_stream(&self, shape: u32, rays: &RayStream, hidden: &mut Lanes<bool>) {
        let primitive = self.clone();
        simd::dispatch(
            #[inline(always)]
            || {
                for start in rays.groups() {
                    let near = near(&primitive, rays, start);
                    if !any(&near) {
                        continue;
                    }
                    let mut hit = [false; GROUP];
                    for k in 0..GROUP {
                        let lane = start + k;
                        let t = primitive.hit(&rays.ray(lane), 0.0, leaves(rays, lane, shape)).t;
                        hit[k] = near[k] & (t > 0.0) & (t < rays.limit[lane]);
                    }
                    for k in 0..GROUP {
                        hidden[start + k] |= hit[k];
                    }
                }
            },
        );
    }

    fn surface_stream(&self, rays: &RayStream, hits: &HitStream, needs: Needs, points: &mut PointStream) {
        let primitive = self.clone();
        let len = rays.len.min(LANES);
        // Texture coordinates may need functions without a vector form.
        if needs.contains(Needs::UV) {
            for lane in 0..len {
                points.set(
                    lane,
                    &Straight::surface(&primitive, &rays.ray(lane), &hits.hit(lane), needs),
                );
            }
            return;
        }
        simd::dispatch(
            #[inline(always)]
            || {
                // Not in whole groups: a lane without a hit may contain an id that is no
                // sub-primitive of this shape.
                for lane in 0..len {
                    let (ray, hit) = (rays.ray(lane), hits.hit(lane));
                    points.set(lane, &Straight::surface(&primitive, &ray, &hit, Needs::NOTHING));
                }
            },
        );
    }
}

#[inline(always)]
fn leaves(rays: &RayStream, lane: usize, shape: u32) -> u32 {
    let this = (rays.skip.shape[lane] == shape) & (rays.skip.instance[lane] == InstancePath::WORLD.0);
    simd::select(this, rays.skip.primitive[lane], LEAVES_NOTHING)
}

/// Which rays of a group may hit.
#[inline(always)]
fn near(primitive: &impl Straight, rays: &RayStream, start: usize) -> [bool; GROUP] {
    let mut near = [false; GROUP];
    for (k, near) in near.iter_mut().enumerate() {
        *near = primitive.comes_near(&rays.ray(start + k));
    }
    near
}

#[inline(always)]
fn any(near: &[bool; GROUP]) -> bool {
    near.iter().fold(false, |any, near| any | near)
}
