//! Where a level set stands: what isosurface, implicit and fractal have in common.

use crate::crossings::{Along, Crossing, crossings};
use std::ops::ControlFlow;
use whitstone_core::{
    Aabb, DMat3, DVec2, DVec3, Interval, PrimitiveHit, Ray, Spans, SurfacePoint, Transform, solid,
};

/// Half the distance from 1 to the next number: the relative error of one rounding.
const UNIT: f64 = 0.5 * f64::EPSILON;

/// Relative to its size, how much larger a box is than the set in it where it cuts nothing off: a
/// ray that enters it a rounding later must still be outside of the set, and of a ray from a
/// billion sizes away (towards a copy as thin as that) a rounding is 1e-7 of the size.
pub(crate) const ROOM: f64 = 1.0 / (1u64 << 7) as f64;
/// Relative to the size of the box: a ray that leaves the surface starts no farther from it.
const START: f64 = 1.0 / (1u64 << 20) as f64;
/// Relative to the size of the box: a hit is no farther from the surface, however far the ray came.
const STRAY: f64 = 1.0 / (1u64 << 8) as f64;

/// A function at a point of object space, negative inside.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    pub value: f64,
    pub gradient: DVec3,
    /// How far the value may be from the true one.
    pub error: f64,
}

/// The box of a level set in its object space, and where that is.
pub(crate) struct Level {
    transform: Transform,
    min: DVec3,
    max: DVec3,
    /// How far a unit step along each axis (column) can lead away, along each axis, from where rays
    /// see it.
    tilt: DMat3,
}

/// The part of a ray inside the box, in front of its origin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Segment {
    /// The object-space ray, from where the part begins, its direction as long as the part.
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
        // As in `frame`: the inverse is rounded, so rays see a slightly other place than points are
        // put at.
        let residual = inverse * forward - DMat3::IDENTITY;
        Self {
            tilt: residual.abs() + 4.0 * UNIT * (inverse.abs() * forward.abs()),
            transform,
            min,
            max,
        }
    }

    pub(crate) fn min(&self) -> DVec3 {
        self.min
    }

    pub(crate) fn max(&self) -> DVec3 {
        self.max
    }

    /// In world space.
    pub(crate) fn bounds(&self) -> Aabb {
        let aabb = self.transform.aabb_to_world(&Aabb {
            min: self.min,
            max: self.max,
        });
        let origin = self.transform.world_from_object().translation;
        let reach = (aabb.min.abs().max(aabb.max.abs())).max_element() + origin.abs().max_element();
        // More than its rounding.
        aabb.padded(16.0 * UNIT * reach)
    }

    /// The ray in object space.
    pub(crate) fn ray(&self, ray: &Ray) -> Ray {
        self.transform.ray_to_object(ray)
    }

    /// The part of an object-space ray that lies in the box and in front of its origin.
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
            // 0/0 is NaN and changes nothing: the ray runs in that face.
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

    /// The first crossing beyond `min` of a ray, out of `visit`ed ones in their order.
    ///
    /// A ray that leaves the surface may find its start again, moved in front of it by rounding.
    /// The ray's first crossing is the start if it goes the same way through the surface as the ray
    /// did: true crossings alternate.
    pub(crate) fn filter<'a>(
        &'a self,
        ray: &'a Ray,
        segment: &'a Segment,
        leaves: Option<f64>,
        min: f64,
    ) -> impl FnMut(Crossing) -> Option<f64> + 'a {
        let near = START * (self.max - self.min).length() / ray.direction.length();
        let mut first = true;
        move |crossing| {
            let t = segment.parameter(crossing.s);
            // `leaves` is the slope at the start: negative if the ray goes inside.
            let start = first && t < near && leaves.is_some_and(|slope| (slope < 0.0) == crossing.enters);
            first = false;
            (t > min && !start).then_some(t)
        }
    }

    /// The nearest hit of an object-space ray: the first change of sign of `f`, the function along
    /// a segment of it, that [`Self::filter`] lets through.
    pub(crate) fn closest(
        &self,
        ray: &Ray,
        segment: &Segment,
        f: &impl Along,
        leaves: Option<f64>,
        interval: Interval,
    ) -> Option<PrimitiveHit> {
        let mut filter = self.filter(ray, segment, leaves, interval.min);
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

    /// The parts of the whole line of an object-space ray that lie in the set, of which the box
    /// cuts nothing off. `visit` tells of every crossing of a segment, in order. What lies behind
    /// the origin is looked for from there on as well, so that what lies in front are the hits of
    /// `closest`.
    pub(crate) fn spans(
        &self,
        ray: &Ray,
        spans: &mut Spans,
        visit: impl Fn(&Segment, &mut dyn FnMut(Crossing, DVec2)),
    ) {
        let mut ends = Vec::new();
        for (side, direction) in [(-1.0, -ray.direction), (1.0, ray.direction)] {
            // From far behind to far ahead.
            ends.reverse();
            if let Some(segment) = self.clip(&Ray::new(ray.origin, direction)) {
                visit(&segment, &mut |crossing, params| {
                    let end = PrimitiveHit {
                        params,
                        ..PrimitiveHit::plain(side * segment.parameter(crossing.s))
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
                // What has no partner is a rounding.
                _ => {}
            }
        }
    }

    /// A hit near a point of object space: moved onto the surface, so that it is as good as
    /// coordinates allow, from however far the ray came.
    pub(crate) fn surface(&self, ray: &Ray, p: DVec3, sample: impl Fn(DVec3) -> Sample) -> SurfacePoint {
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
        // A function may be level where it should not: the tip of a cone, and noise at the depth of
        // fractals.
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
            // Beyond that the surface is so rough that there is no telling.
            error += (2.0 * off).min(START * (linear.abs() * (self.max - self.min)).length());
        }
        let position = linear * p + origin;
        SurfacePoint::new(position, error, n)
    }
}

/// A hit of a shape that has no parts.
pub(crate) fn whole(t: f64, interval: Interval, params: DVec2) -> Option<PrimitiveHit> {
    interval.contains(t).then_some(PrimitiveHit {
        t,
        primitive: 0,
        params,
    })
}
