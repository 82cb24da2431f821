//! Object space of level sets (isosurface, implicit, fractal), with rounding error bounds.

use crate::support::crossings::{Along, Crossing, crossings};
use std::ops::ControlFlow;
use whitstone_core::{
    Aabb, DMat3, DVec2, DVec3, Interval, LimitReached, Ray, SearchLimit, Shape, ShapeHit, Spans,
    SurfaceInteraction, Transform, solid,
};

/// Unit roundoff: half the distance from 1 to the next number, the relative error of one rounding.
const UNIT: f64 = 0.5 * f64::EPSILON;

/// Margin between a level set and its box, relative to the size of the box, if the box does not
/// clip the set.
///
/// A ray that enters the box one rounding late must still be outside the set. For a ray from a
/// billion sizes away (towards an instance as thin as that), one rounding is 1e-7 of the size.
pub(crate) const BOX_MARGIN: f64 = 1.0 / (1u64 << 7) as f64;
/// Maximum distance of a spawn point from the surface, relative to the size of the box.
const START: f64 = 1.0 / (1u64 << 20) as f64;
/// Maximum distance of a hit from the surface, relative to the size of the box, however distant the
/// ray origin.
const STRAY: f64 = 1.0 / (1u64 << 8) as f64;

/// Value and gradient of a function at a point of object space; negative inside.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    pub value: f64,
    pub gradient: DVec3,
    /// Bound on the error of the value.
    pub error: f64,
}

/// The object-space box of a level set, and its transform.
pub(crate) struct Level {
    transform: Transform,
    min: DVec3,
    max: DVec3,
    /// Bound on how far a point at unit distance along each axis (column) deviates, along each axis
    /// (row), from where rays see it.
    tilt: DMat3,
    limit: SearchLimit,
}

/// The part of a ray inside the box and in front of its origin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Segment {
    /// Start point and vector of the segment in object space.
    pub origin: DVec3,
    pub direction: DVec3,
    /// Ray parameters of the ends.
    pub begin: f64,
    pub end: f64,
}

impl Segment {
    /// The point at `s`, from 0 to 1.
    #[inline]
    pub(crate) fn at(&self, s: f64) -> DVec3 {
        self.origin + s * self.direction
    }

    /// The ray parameter at `s`.
    #[inline]
    pub(crate) fn parameter(&self, s: f64) -> f64 {
        self.begin + s * (self.end - self.begin)
    }
}

impl Level {
    pub(crate) fn new(transform: Transform, min: DVec3, max: DVec3) -> Self {
        let forward = transform.world_from_object().matrix3;
        let inverse = transform.object_from_world().matrix3;
        // As in `frame`: the inverse is rounded, so rays see the surface displaced relative to
        // transformed points.
        let residual = inverse * forward - DMat3::IDENTITY;
        Self {
            tilt: residual.abs() + 4.0 * UNIT * (inverse.abs() * forward.abs()),
            transform,
            min,
            max,
            limit: SearchLimit::default(),
        }
    }

    /// Counts a ray whose search reached its limit at this point of object space.
    pub(crate) fn limit_reached(&self, p: DVec3) {
        self.limit.count(|| self.transform.point_to_world(p));
    }

    /// Forgets the rays of [`check_search`].
    pub(crate) fn reset_search_limit(&mut self) {
        self.limit.reset();
    }

    /// See [`Shape::search_limit`].
    pub(crate) fn search_limit(&self) -> Option<LimitReached> {
        self.limit.reached()
    }

    pub(crate) fn min(&self) -> DVec3 {
        self.min
    }

    pub(crate) fn max(&self) -> DVec3 {
        self.max
    }

    /// World-space bounds.
    pub(crate) fn bounds(&self) -> Aabb {
        let aabb = self.transform.aabb_to_world(&Aabb {
            min: self.min,
            max: self.max,
        });
        let origin = self.transform.world_from_object().translation;
        let reach = (aabb.min.abs().max(aabb.max.abs())).max_element() + origin.abs().max_element();
        // More than the rounding error of the box.
        aabb.padded(16.0 * UNIT * reach)
    }

    /// Transforms a ray to object space.
    pub(crate) fn ray(&self, ray: &Ray) -> Ray {
        self.transform.ray_to_object(ray)
    }

    /// Clips an object-space ray to the box, in front of its origin.
    pub(crate) fn clip(&self, ray: &Ray) -> Option<Segment> {
        let (mut begin, mut end) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let (o, d) = (ray.origin[axis], ray.direction[axis]);
            let (low, high) = (self.min[axis], self.max[axis]);
            let (near, far) = if d.is_sign_negative() {
                (high, low)
            } else {
                (low, high)
            };
            // 0/0 is NaN and has no effect: the ray runs within that face.
            begin = begin.max((near - o) / d);
            end = end.min((far - o) / d);
        }
        let whole = begin < end && end.is_finite();
        whole.then(|| Segment {
            origin: ray.at(begin).clamp(self.min, self.max),
            direction: (end - begin) * ray.direction,
            begin,
            end,
        })
    }

    /// Returns a filter that accepts the crossings of a ray beyond `min`, called in order.
    ///
    /// A ray spawned on the surface may find its spawn point again, moved in front of the origin by
    /// rounding. The first crossing is the spawn point if it crosses the surface in the same
    /// direction as the ray does at its origin: true crossings alternate.
    pub(crate) fn filter<'a>(
        &'a self,
        ray: &'a Ray,
        segment: &'a Segment,
        origin_primitive: Option<f64>,
        min: f64,
    ) -> impl FnMut(Crossing) -> Option<f64> + 'a {
        let near = START * (self.max - self.min).length() / ray.direction.length();
        let mut first = true;
        move |crossing| {
            let t = segment.parameter(crossing.s);
            // `origin_primitive` is the slope at the origin: negative if the ray goes inside.
            let start =
                first && t < near && origin_primitive.is_some_and(|slope| (slope < 0.0) == crossing.enters);
            first = false;
            (t > min && !start).then_some(t)
        }
    }

    /// The nearest hit of an object-space ray: the first change of sign of `f`, the function along
    /// a segment of the ray, that [`Self::filter`] accepts.
    pub(crate) fn intersect(
        &self,
        ray: &Ray,
        segment: &Segment,
        f: &impl Along,
        origin_primitive: Option<f64>,
        interval: Interval,
    ) -> Option<ShapeHit> {
        let mut filter = self.filter(ray, segment, origin_primitive, interval.min);
        let mut found = None;
        crossings(f, |crossing| {
            found = filter(crossing);
            match found {
                Some(_) => ControlFlow::Break(()),
                None => ControlFlow::Continue(()),
            }
        });
        whole(found?, interval, DVec2::ZERO)
    }

    /// The intervals of the whole line of an object-space ray that lie in the set; the box must not
    /// clip the set.
    ///
    /// `visit` reports every crossing of a segment, in order. The half line behind the origin is
    /// traced from the origin as well, so that the crossings in front are exactly the hits of
    /// `intersect`.
    pub(crate) fn spans(
        &self,
        ray: &Ray,
        spans: &mut Spans,
        visit: impl Fn(&Segment, &mut dyn FnMut(Crossing, DVec2)),
    ) {
        let mut ends = Vec::new();
        for (side, direction) in [(-1.0, -ray.direction), (1.0, ray.direction)] {
            // From the farthest behind to the farthest ahead.
            ends.reverse();
            if let Some(segment) = self.clip(&Ray::new(ray.origin, direction)) {
                visit(&segment, &mut |crossing, prim_uv| {
                    let end = ShapeHit {
                        prim_uv,
                        ..ShapeHit::plain(side * segment.parameter(crossing.s))
                    };
                    ends.push((end, crossing.enters == (side > 0.0)));
                });
            }
        }
        let mut entered = None;
        for (end, enters) in ends {
            match (entered, enters) {
                (None, true) => entered = Some(end),
                (Some(enter), false) => {
                    solid::push(spans, enter, end);
                    entered = None;
                }
                // An unpaired crossing is a rounding error.
                _ => {}
            }
        }
    }

    /// Projects a hit near an object-space point onto the surface, so that its error is a few
    /// roundings of its coordinates, however distant the ray origin.
    pub(crate) fn surface(
        &self,
        ray: &Ray,
        p: DVec3,
        sample: impl Fn(DVec3) -> Sample,
    ) -> SurfaceInteraction {
        let reach = STRAY * (self.max - self.min).length();
        let (mut p, mut found) = (p, sample(p));
        for _ in 0..5 {
            let step = (found.value / found.gradient.length_squared()) * found.gradient;
            let next = sample(p - step);
            let good = step.length() < reach && next.value.abs() < found.value.abs();
            if !good {
                break;
            }
            (p, found) = (p - step, next);
        }
        let inverse = &self.transform.object_from_world().matrix3;
        let gradient = inverse.transpose() * found.gradient;
        let steepness = gradient.length();
        // The gradient may vanish or overflow: at the tip of a cone, or as noise in deep fractals.
        let steep = steepness > 0.0 && steepness.is_finite();
        let n = if steep {
            (gradient / steepness).normalize()
        } else {
            -ray.direction.normalize()
        };
        let linear = self.transform.world_from_object().matrix3;
        let origin = self.transform.world_from_object().translation;
        let terms = linear.abs() * p.abs() + origin.abs();
        let mut error = 5.0 * UNIT * n.abs().dot(terms);
        if steep {
            let value = found.value.abs() + found.error;
            let moved = self.tilt * p.abs() + 2.0 * UNIT * p.abs();
            let off = (value + found.gradient.abs().dot(moved)) / steepness;
            // The cap: beyond it the surface is too rough for the bound to be meaningful.
            error += (2.0 * off).min(START * (linear.abs() * (self.max - self.min)).length());
        }
        let position = linear * p + origin;
        SurfaceInteraction::new(position, error, n)
    }
}

/// Number of rays that [`check_search`] traces.
const PROBES: u32 = 16;
/// Largest share of them, in percent, that may reach the limit of the search.
const MAX_LIMITED: u64 = 25;

/// Rejects a shape if the search for its surface reaches its limit on too many rays through its
/// box: parts of it would be missing. The rays are a low-discrepancy sequence (Richtmyer 1951).
///
/// # Errors
///
/// The message.
pub(crate) fn check_search(shape: &impl Shape) -> Result<(), String> {
    let bounds = shape.bounds();
    let radius = bounds.extent().length();
    for k in 1..=PROBES {
        let [u, v, x, y, z] =
            [2.0, 3.0, 5.0, 7.0, 11.0].map(|prime: f64| (f64::from(k) * prime.sqrt()).fract());
        let (sine, cosine) = libm::sincos(std::f64::consts::TAU * u);
        let height = 2.0 * v - 1.0;
        let around = (1.0 - height * height).sqrt();
        let origin = bounds.center() + radius * DVec3::new(around * cosine, around * sine, height);
        let target = bounds.min + DVec3::new(x, y, z) * bounds.extent();
        shape.intersect(&Ray::new(origin, target - origin), Interval::FORWARD, None);
    }
    match shape.search_limit() {
        Some(reached) if 100 * reached.rays > MAX_LIMITED * u64::from(PROBES) => Err(format!(
            "{reached}, of {PROBES} through its box: parts of the surface would be missing"
        )),
        _ => Ok(()),
    }
}

/// A hit of a shape with a single primitive.
pub(crate) fn whole(t: f64, interval: Interval, prim_uv: DVec2) -> Option<ShapeHit> {
    interval.contains(t).then_some(ShapeHit {
        t,
        primitive: 0,
        prim_uv,
    })
}
