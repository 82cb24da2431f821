//! Laws of solids, in addition to those of shapes.

use crate::broken::law;
use crate::random::Random;
use whitstone_core::{
    DVec3, InstanceId, Interval, Ray, Shape, ShapeHit, Span, Spans, SurfaceAttributes, solid,
};

/// Checks the spans along a ray: they are ordered and disjoint; normals at their ends point
/// outside; the nearest hits are their ends; a point between two ends is consistently inside or
/// outside along any other line; and a ray spawned at an end is correctly classified as entering
/// the solid or not. `size` is the extent of the shape.
pub(crate) fn check_solid(
    shape: &dyn Shape,
    ray: &Ray,
    size: f64,
    random: &mut Random,
) -> Result<(), String> {
    let spans = spans_of(shape, ray);
    let mut before = f64::NEG_INFINITY;
    for span in &spans {
        law(
            before < span.enter.t && span.enter.t < span.exit.t
                || before == span.enter.t && before.is_infinite(),
            "entries and exits must alternate and come in order",
        )?;
        before = span.exit.t;
    }
    agree_with_hits(shape, ray, &spans)?;
    for span in &spans {
        for (end, inward) in [(span.enter, 1.0), (span.exit, -1.0)] {
            // From very far away, rounding decides which side of a thin part is hit.
            if end.t.abs() * ray.direction.length() < 1e3 * size {
                check_end(shape, ray, &end, inward)?;
            }
        }
    }
    // In metres: shorter spans and gaps are not checked.
    let least = 1e-4 * size;
    let scale = ray.direction.length();
    let from = Ray::new(ray.origin, ray.direction / scale);
    let mut ends = vec![f64::NEG_INFINITY];
    ends.extend(
        spans
            .iter()
            .flat_map(|span| [span.enter.t * scale, span.exit.t * scale]),
    );
    ends.push(f64::INFINITY);
    for (number, pair) in ends.windows(2).enumerate() {
        let a = if pair[0].is_finite() {
            pair[0]
        } else {
            pair[1] - size
        };
        let b = if pair[1].is_finite() {
            pair[1]
        } else {
            pair[0] + size
        };
        let middle = 0.5 * (a + b);
        // A line without hits has no ends to start from, and far from the ray's origin rounding
        // decides.
        if b - a > least && middle.abs() < 1e3 * size {
            let place = Ray::new(from.at(middle), random.direction());
            check_place(shape, &place, number % 2 == 1)?;
        }
    }
    Ok(())
}

fn spans_of(shape: &dyn Shape, ray: &Ray) -> Spans {
    let mut spans = Spans::new();
    shape.spans(ray, &mut spans);
    spans
}

/// Checks that the ends in front of the ray are its successive hits.
fn agree_with_hits(shape: &dyn Shape, ray: &Ray, spans: &[Span]) -> Result<(), String> {
    let mut interval = Interval::FORWARD;
    loop {
        let end = solid::first_end(spans, interval, None);
        let hit = shape.intersect(ray, interval, None);
        let same = match (&end, &hit) {
            (None, None) => return Ok(()),
            (Some(end), Some(hit)) => same_bits(end, hit),
            // A tangent point, or an empty span.
            (None, Some(hit)) => return law(touched(shape, ray, hit), "every hit must be the end of a span"),
            (Some(_), None) => false,
        };
        let skipped =
            matches!((&end, &hit), (Some(end), Some(hit)) if hit.t < end.t && touched(shape, ray, hit));
        law(same || skipped, "the ends of spans must be hits, bit for bit")?;
        interval.min = hit.map_or(f64::INFINITY, |hit| hit.t);
    }
}

fn same_bits(a: &ShapeHit, b: &ShapeHit) -> bool {
    let bits = |hit: &ShapeHit| [hit.t, hit.prim_uv.x, hit.prim_uv.y].map(f64::to_bits);
    a.primitive == b.primitive && bits(a) == bits(b)
}

/// Whether the ray only grazes the surface at the hit.
fn touched(shape: &dyn Shape, ray: &Ray, hit: &ShapeHit) -> bool {
    let (n, d) = (normal(shape, ray, hit), ray.direction.normalize());
    let next = shape.intersect(
        ray,
        Interval {
            min: hit.t,
            max: f64::INFINITY,
        },
        None,
    );
    n.dot(d).abs() < 1e-6 || next.is_some_and(|next| next.t - hit.t < 1e-9 * hit.t)
}

fn normal(shape: &dyn Shape, ray: &Ray, hit: &ShapeHit) -> DVec3 {
    let hit = hit.of_shape(InstanceId::TOP_LEVEL, 0);
    shape.surface(ray, &hit, SurfaceAttributes::NOTHING).n_g
}

/// `inward` is 1 where the line enters, -1 where it leaves.
fn check_end(shape: &dyn Shape, ray: &Ray, end: &ShapeHit, inward: f64) -> Result<(), String> {
    law(
        end.primitive < shape.primitives(),
        "the sub-primitive must be below the declared number",
    )?;
    let (n, d) = (normal(shape, ray, end), ray.direction.normalize());
    law(
        inward * n.dot(d) < 1e-6,
        "normals must point out of the solid at the ends of spans",
    )?;
    if n.dot(d).abs() < 1e-3 {
        return Ok(());
    }
    let hit = end.of_shape(InstanceId::TOP_LEVEL, 0);
    let start = shape
        .surface(ray, &hit, SurfaceAttributes::NOTHING)
        .spawn_origin(ray.direction);
    let onward = Ray::new(start, ray.direction);
    law(
        shape.goes_inside(&onward, end.primitive) == (inward > 0.0),
        "`goes_inside` must tell whether a spawned ray enters the solid",
    )
}

/// A ray from a point that must be inside the solid or not.
fn check_place(shape: &dyn Shape, ray: &Ray, inside: bool) -> Result<(), String> {
    let spans = spans_of(shape, ray);
    let around = spans.iter().any(|span| span.enter.t < 0.0 && span.exit.t > 0.0);
    law(
        around == inside,
        "a point between two ends must be on the same side for every line",
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ball::Ball;
    use whitstone_core::{Aabb, PreliminaryIntersection, SurfaceInteraction};

    #[derive(Clone, Copy, Debug, PartialEq)]
    enum Fault {
        None,
        Backwards,
        NoSpans,
        OnlyInFront,
        Hollow,
        InsideOut,
        OtherRounding,
        WrongNumber,
        LostWhenLeaving,
    }

    /// A correct ball, or one with a deliberate fault.
    struct Faulty {
        ball: Ball,
        fault: Fault,
    }

    impl Shape for Faulty {
        fn bounds(&self) -> Aabb {
            self.ball.bounds()
        }

        fn intersect(
            &self,
            ray: &Ray,
            interval: Interval,
            origin_primitive: Option<u32>,
        ) -> Option<ShapeHit> {
            self.ball.intersect(ray, interval, origin_primitive)
        }

        fn surface(
            &self,
            ray: &Ray,
            hit: &PreliminaryIntersection,
            needs: SurfaceAttributes,
        ) -> SurfaceInteraction {
            let mut point = self.ball.surface(ray, hit, needs);
            if self.fault == Fault::InsideOut {
                point.n_g = -point.n_g;
            }
            point
        }

        fn is_solid(&self) -> bool {
            true
        }

        fn spans(&self, ray: &Ray, spans: &mut Spans) {
            let mut whole = Spans::new();
            self.ball.spans(ray, &mut whole);
            for Span { mut enter, mut exit } in whole {
                match self.fault {
                    Fault::NoSpans => continue,
                    Fault::Backwards => std::mem::swap(&mut enter, &mut exit),
                    Fault::OnlyInFront => enter.t = enter.t.max(0.0),
                    Fault::OtherRounding => exit.t = exit.t.next_up(),
                    Fault::WrongNumber => exit.primitive = 1,
                    _ => {}
                }
                if self.fault == Fault::Hollow && exit.t > 0.0 {
                    enter.t = 0.5 * (enter.t + exit.t);
                }
                spans.push(Span { enter, exit });
            }
        }

        fn goes_inside(&self, ray: &Ray, primitive: u32) -> bool {
            self.fault != Fault::LostWhenLeaving && self.ball.goes_inside(ray, primitive)
        }
    }

    fn verdict(fault: Fault) -> Result<(), String> {
        let ball = Ball {
            center: DVec3::new(0.5, -0.25, 1.0),
            radius: 1.5,
        };
        let mut random = Random::new(7);
        (0..400).try_for_each(|_| {
            let target = ball.center + ball.radius * random.cube();
            let origin = ball.center + 3.0 * random.cube();
            let ray = Ray::new(origin, target - origin);
            check_solid(&Faulty { ball, fault }, &ray, ball.radius, &mut random)
        })
    }

    #[test]
    fn a_good_ball_passes() {
        assert_eq!(verdict(Fault::None), Ok(()));
    }

    #[test]
    fn every_fault_is_found_by_its_law() {
        for (fault, expected) in [
            (Fault::Backwards, "entries and exits must alternate"),
            (Fault::NoSpans, "every hit must be the end of a span"),
            (Fault::OnlyInFront, "a point between two ends"),
            (Fault::Hollow, "the ends of spans must be hits"),
            (Fault::InsideOut, "normals must point out"),
            (Fault::OtherRounding, "the ends of spans must be hits"),
            (Fault::WrongNumber, "the ends of spans must be hits"),
            (Fault::LostWhenLeaving, "`goes_inside` must tell whether"),
        ] {
            let found = verdict(fault)
                .err()
                .unwrap_or_else(|| panic!("{fault:?} must be found"));
            assert!(found.starts_with(expected), "{fault:?}: {found}");
        }
    }
}
