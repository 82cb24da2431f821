//! Laws of shapes.

use crate::broken::{Broken, law};
use crate::random::Random;
use crate::solids::check_solid;
use crate::streams::{accelerator_streams, surface_streams};
use std::f64::consts::TAU;
use whitstone_core::stream::{HitStream, Lanes, RayStream};
use whitstone_core::triangle::ShearedRay;
use whitstone_core::{
    Aabb, Accelerator, DAffine3, DMat3, DVec2, DVec3, Geometry, Interval, LoweredShape, Plugin,
    PreliminaryIntersection, Ray, SelfHitFilter, Shapes, Statistics, SurfaceAttributes, SurfaceInteraction,
    Transform,
};

/// The transforms that a shape is tested with: identity, rotated, mirrored, tiny, huge, far away,
/// thin and sheared. Those that preserve angles come first.
pub fn placements() -> Vec<(&'static str, Transform)> {
    let turn = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 0.8);
    let place = |matrix, x, y, z| DAffine3::from_mat3_translation(matrix, DVec3::new(x, y, z));
    let diagonal = |x, y, z| DMat3::from_diagonal(DVec3::new(x, y, z));
    [
        ("untransformed", DAffine3::IDENTITY),
        ("rotated and translated", place(turn, 3.0, -2.0, 5.0)),
        ("mirrored", place(diagonal(1.0, 1.0, -1.0) * turn, 0.5, 0.0, 0.0)),
        ("tiny", place(turn * diagonal(1e-8, 1e-8, 1e-8), 1e-8, 0.0, 0.0)),
        ("huge", place(turn * diagonal(1e8, 1e8, 1e8), 1e7, 0.0, 0.0)),
        ("far away", place(turn, 1e6, -1e6, 1e6)),
        ("thin", place(turn * diagonal(2.0, 2.0, 1e-6), 1.0, 0.0, 0.0)),
        ("stretched", place(turn * diagonal(1.0, 30.0, 0.2), 0.0, 1.0, 0.0)),
        (
            "sheared",
            place(
                DMat3::from_cols(DVec3::X, DVec3::new(0.7, 1.0, 0.0), DVec3::new(0.1, -0.4, 1.0)),
                0.0,
                1.0,
                0.0,
            ),
        ),
    ]
    .into_iter()
    .map(|(name, matrix)| (name, Transform::new(matrix).expect("these are invertible")))
    .collect()
}

/// Maximum number of rays per batch: all are stored until their streams have been compared.
const BATCH: u32 = 20_000;

/// The number of rays of each of `parts` parts: `samples`, or this part's share of the environment
/// variable `WHITSTONE_LAW_RAYS` if that is more.
fn rays_of_part(samples: u32, parts: usize) -> u32 {
    let wished = std::env::var("WHITSTONE_LAW_RAYS").ok();
    let wished: usize = wished.map_or(0, |rays| rays.parse().expect("WHITSTONE_LAW_RAYS is a number"));
    samples.max(wished.div_ceil(parts) as u32)
}

/// Builds the shape in every one of the [`placements`] that it accepts and checks [`shape_laws`].
///
/// # Panics
///
/// If a law is broken, or if the shape cannot be built without a transform.
pub fn shape_laws_everywhere<P: Plugin<Shapes>>(text: &str, samples: u32) {
    let placements = placements();
    let rays = rays_of_part(samples, placements.len());
    for (name, transform) in placements {
        match crate::build::<Shapes, P>(text, transform) {
            Ok(shape) => {
                let broken = first_broken(shape, rays).err().map(|broken| broken.law);
                assert_eq!(broken, None, "{} that is {name}", P::TYPE);
            }
            Err(error) if name == "untransformed" => panic!("{}: {error}", P::TYPE),
            Err(_) => {}
        }
    }
}

/// Checks the laws of shapes:
///
/// - The bounds contain all hits.
/// - Surface points lie on the surface within their error bounds, however far away the ray starts;
///   their normals have unit length.
/// - The ray parameter is inversely proportional to the length of the direction.
/// - A spawned ray does not hit its start again.
/// - A hit depends only on the ray, not on the interval or on earlier queries.
/// - Streams of rays give the same bits.
/// - Texture coordinates are finite. `surface_at_offset`, if it returns anything, agrees with the
///   surface that a ray finds there, in texture coordinates and normal.
/// - A shape that declares itself a solid is one: entries and exits alternate, and points between
///   them are inside as seen from every direction.
///
/// The environment variable `WHITSTONE_LAW_RAYS` requests more rays than `samples`.
///
/// # Panics
///
/// If the shape breaks one of these laws; the message says which and where.
pub fn shape_laws(shape: LoweredShape, samples: u32) {
    let broken = first_broken(shape, rays_of_part(samples, 1)).err();
    assert_eq!(broken.map(|broken| broken.law), None);
}

/// The first law that the shape breaks. Equal `samples` give equal rays.
pub(crate) fn first_broken(shape: LoweredShape, samples: u32) -> Result<(), Broken> {
    let bench = Bench::new(shape);
    let mut random = Random::new(u64::from(samples));
    let mut from = 0;
    while from < samples {
        let to = samples.min(from + BATCH);
        check_batch(&bench, from..to, &mut random)?;
        from = to;
    }
    Ok(())
}

fn check_batch(bench: &Bench, numbers: std::ops::Range<u32>, random: &mut Random) -> Result<(), Broken> {
    let samples = numbers.end - numbers.start;
    let (mut hits, mut queries, mut surfaces) = (0, Vec::new(), Vec::new());
    for i in numbers {
        let ray = bench.aim.ray(i, random);
        if let Some(solid) = bench.solid() {
            let checked = check_solid(solid, &ray, bench.size(), random);
            checked.map_err(|law| Broken::at(&ray, format!("{law}; {ray:?}")))?;
        }
        queries.push((ray, f64::INFINITY, SelfHitFilter::NOTHING));
        let Some(hit) = bench.intersect(&ray, Interval::FORWARD, SelfHitFilter::NOTHING) else {
            continue;
        };
        hits += 1;
        // Shorter, longer, and spawned on the hit.
        queries.push((ray, hit.t, SelfHitFilter::NOTHING));
        queries.push((ray, hit.t.next_up(), SelfHitFilter::NOTHING));
        queries.push((
            Ray::new(ray.at(hit.t), ray.direction),
            f64::INFINITY,
            SelfHitFilter::leaving(&hit),
        ));
        surfaces.push((ray, hit));
        let checked = bench
            .pure(&ray, &hit)
            .and_then(|()| bench.scales(&ray, &hit))
            .and_then(|()| bench.on_surface(&ray, &hit, random))
            .and_then(|()| bench.extrapolates(&ray, &hit));
        checked.map_err(|law| Broken::at(&ray, format!("{law}; {ray:?}, {hit:?}")))?;
    }
    accelerator_streams(bench, &queries)?;
    surface_streams(&bench.geometry, &surfaces)?;
    if samples >= 50 && hits < samples / 50 {
        return Err(format!("too few of {samples} rays hit the shape: {hits}").into());
    }
    Ok(())
}

/// Calls the stream methods of the shape itself.
impl Accelerator for Bench {
    fn intersect(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<PreliminaryIntersection> {
        Bench::intersect(self, ray, interval, skip)
    }

    fn occluded(&self, ray: &Ray, interval: Interval, skip: SelfHitFilter) -> bool {
        Bench::intersect(self, ray, interval, skip).is_some()
    }

    fn intersect_stream(&self, rays: &RayStream, hits: &mut HitStream) {
        hits.clear(rays);
        match &self.geometry.shapes()[0] {
            LoweredShape::Custom(primitive) => primitive.intersect_stream(0, rays, hits),
            LoweredShape::Instance(instance) => instance.intersect_stream(rays, hits),
            _ => {
                for lane in 0..rays.len {
                    let (interval, skip) = (rays.interval(lane), rays.skip.skip(lane));
                    if let Some(hit) = Bench::intersect(self, &rays.ray(lane), interval, skip) {
                        hits.set(lane, &hit);
                    }
                }
            }
        }
    }

    fn occluded_stream(&self, rays: &RayStream, hidden: &mut Lanes<bool>) {
        hidden[..rays.len].fill(false);
        match &self.geometry.shapes()[0] {
            LoweredShape::Custom(primitive) => primitive.occluded_stream(0, rays, hidden),
            LoweredShape::Instance(instance) => instance.occluded_stream(rays, hidden),
            _ => {
                for (lane, hidden) in hidden.iter_mut().enumerate().take(rays.len) {
                    let (interval, skip) = (rays.interval(lane), rays.skip.skip(lane));
                    *hidden = Bench::intersect(self, &rays.ray(lane), interval, skip).is_some();
                }
            }
        }
    }

    fn statistics(&self) -> Statistics {
        Statistics::new()
    }
}

/// Generates rays towards a box.
#[derive(Clone, Copy, Debug)]
pub struct Aim {
    center: DVec3,
    /// Half the edge lengths of the box.
    half: DVec3,
}

impl Aim {
    /// Aims at a box, or at the centre of the world if the box is unbounded.
    pub fn at(bounds: Aabb) -> Self {
        let endless = Aabb::around([DVec3::splat(-10.0), DVec3::splat(10.0)]);
        let aim = if bounds.is_finite() { bounds } else { endless };
        Self {
            center: aim.center(),
            half: 0.5 * aim.extent(),
        }
    }

    /// Half the longest edge.
    pub fn size(&self) -> f64 {
        self.half.max_element()
    }

    /// A ray from around, from inside, from nearby or from far away, towards the box or slightly
    /// past it.
    pub fn ray(&self, number: u32, random: &mut Random) -> Ray {
        let target = self.center + 1.05 * self.half * random.cube();
        let distance = [0.5, 3.0, 30.0, 1e5][number as usize % 4];
        let origin = self.center + distance * self.size() * random.direction();
        let direction = target - origin;
        let length = [1.0, 0.01, 77.0][number as usize % 3];
        Ray::new(origin, length * direction.normalize())
    }
}

/// How far a surface may deviate from its tangent plane, relative to the step along the plane:
/// eight times the deviation of a sphere that fills the box.
const FLAT: f64 = 8.0 / (1u32 << 21) as f64;

/// A scene that consists of a single shape.
struct Bench {
    geometry: Geometry,
    bounds: Aabb,
    aim: Aim,
}

impl Bench {
    fn new(shape: LoweredShape) -> Self {
        let geometry = Geometry::new(vec![shape]);
        let elements = geometry.elements().map(|element| geometry.bounds(element));
        let bounds = elements.fold(Aabb::EMPTY, Aabb::union);
        Self {
            geometry,
            bounds,
            aim: Aim::at(bounds),
        }
    }

    fn solid(&self) -> Option<&dyn whitstone_core::Shape> {
        match &self.geometry.shapes()[0] {
            LoweredShape::Custom(primitive) if primitive.is_solid() => Some(primitive.as_ref()),
            _ => None,
        }
    }

    fn size(&self) -> f64 {
        self.aim.size()
    }

    fn intersect(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<PreliminaryIntersection> {
        let sheared = ShearedRay::new(ray);
        self.geometry
            .elements()
            .filter_map(|element| self.geometry.intersect(element, ray, &sheared, interval, skip))
            .reduce(|best, hit| if hit.is_nearer_than(&best) { hit } else { best })
    }

    /// Checks that the ray gives the same hit in every interval that contains it.
    fn pure(&self, ray: &Ray, hit: &PreliminaryIntersection) -> Result<(), String> {
        let ask = |min: f64, max: f64| self.intersect(ray, Interval { min, max }, SelfHitFilter::NOTHING);
        let same = |found: Option<PreliminaryIntersection>| {
            found.as_ref().is_some_and(|found| same_bits(found, hit))
        };
        let (before, after) = (hit.t.next_down(), hit.t.next_up());
        law(
            same(ask(0.0, f64::INFINITY)),
            "a second query must give the same hit",
        )?;
        law(
            same(ask(0.0, after)) && same(ask(before, f64::INFINITY)) && same(ask(before, after)),
            "the hit must not depend on an interval that contains it",
        )?;
        law(
            ask(0.0, hit.t).is_none(),
            "nothing may be hit before the nearest hit",
        )?;
        law(
            ask(hit.t, f64::INFINITY).is_none_or(|next| next.t > hit.t),
            "the hit must lie inside the interval",
        )?;
        // From the other end, the last hit comes first.
        let end = hit.t + 10.0 * self.size() / ray.direction.length();
        let back = Ray::new(ray.at(end), -ray.direction);
        let last = self
            .intersect(&back, Interval::up_to(end), SelfHitFilter::NOTHING)
            .map_or(0.0, |back| end - back.t);
        // At grazing incidence, a small error along the normal is a large one along the ray.
        let point = self.geometry.surface(ray, hit, SurfaceAttributes::NOTHING);
        let rounding = f64::EPSILON * (point.position.abs().max_element() + self.size());
        let grazing = 2.0 * (point.error + 8.0 * rounding) / point.n_g.dot(ray.direction).abs();
        law(
            last <= hit.t + 1e-9 * end + grazing || ask(hit.t, f64::INFINITY).is_some(),
            "a hit behind the nearest one must be found by an interval that starts between them",
        )
    }

    /// Checks that the parameter is in units of the direction's length; powers of two are exact.
    fn scales(&self, ray: &Ray, hit: &PreliminaryIntersection) -> Result<(), String> {
        for scale in [1024.0, 1.0 / (1u64 << 40) as f64] {
            let longer = Ray::new(ray.origin, scale * ray.direction);
            let found = self
                .intersect(&longer, Interval::FORWARD, SelfHitFilter::NOTHING)
                .map(|hit| hit.t * scale);
            let good = found.is_some_and(|t| (t - hit.t).abs() <= 8.0 * f64::EPSILON * hit.t);
            law(
                good,
                "t must be inversely proportional to the length of the direction",
            )?;
        }
        Ok(())
    }

    fn on_surface(
        &self,
        ray: &Ray,
        hit: &PreliminaryIntersection,
        random: &mut Random,
    ) -> Result<(), String> {
        let point = self.geometry.surface(
            ray,
            hit,
            SurfaceAttributes::SHADING_NORMAL | SurfaceAttributes::UV,
        );
        let SurfaceInteraction {
            position,
            error,
            n_g,
            n_s,
            uv,
            uv_gradient: _,
            footprint: _,
            vertex: _,
        } = point;
        law(
            [n_g, n_s].iter().all(|n| (n.length() - 1.0).abs() < 1e-14),
            "normals must have unit length",
        )?;
        law(uv.is_finite(), "texture coordinates must be finite")?;
        law(
            error.is_finite() && error >= 0.0,
            "the error must be finite and not negative",
        )?;

        // The rounding of the coordinates themselves is a lower limit for any bound.
        let rounding = f64::EPSILON * (position.abs().max_element() + self.size());
        let slack = error + 8.0 * rounding;
        let padded = self.bounds.padded(slack);
        law(
            position.cmpge(padded.min).all() && position.cmple(padded.max).all(),
            "the bounds must contain the hit",
        )?;

        law(
            self.is_on_surface(position, n_g, slack),
            "the position must lie on the surface up to its error",
        )?;

        // Directions on both sides, not so grazing that another hit nearby is legitimate.
        for side in [1.0, -1.0] {
            let sideways = n_g.cross(random.direction());
            let d = (side * n_g + 3.0 * sideways).normalize();
            // From above the surface, to test the error bound, and from the surface itself, to test
            // the skipped primitive.
            for origin in [point.spawn_origin(d), position] {
                let away = Ray::new(origin, d);
                let again = self.intersect(&away, Interval::FORWARD, SelfHitFilter::leaving(hit));
                let near = again.filter(|again| again.t <= 1e3 * slack);
                if let Some(near) = near.filter(|near| !self.is_behind_an_edge(&away, near, hit, side)) {
                    return Err(format!(
                        "a spawned ray must not hit its start again: {away:?}, {near:?}"
                    ));
                }
            }
        }
        Ok(())
    }

    /// Checks that the surface that a shape extrapolates near a hit is the surface that a ray finds
    /// there.
    fn extrapolates(&self, ray: &Ray, hit: &PreliminaryIntersection) -> Result<(), String> {
        let needs = SurfaceAttributes::SHADING_NORMAL | SurfaceAttributes::UV;
        let here = self.geometry.surface(ray, hit, needs);
        let (a, b) = here.n_g.any_orthonormal_pair();
        let along = 0.8 * a - 0.6 * b;
        // A step far above rounding, yet so small that most surfaces are flat to a millionth over
        // it.
        let step = self.size() / (1u32 << 20) as f64;
        let q = here.position + step * along;
        let Some(extrapolated) = self.geometry.surface_at_offset(&here, hit, q, needs) else {
            return Ok(());
        };
        let above = 1e-3 * self.size();
        let down = Ray::new(q + above * here.n_g, -here.n_g);
        let found = self.intersect(&down, Interval::up_to(2.0 * above), SelfHitFilter::NOTHING);
        // If the surface bends within the step, the difference says nothing about derivatives.
        let flat = |found: &PreliminaryIntersection| (found.t - above).abs() <= FLAT * step;
        let Some(found) = found.filter(|found| found.id() == hit.id() && flat(found)) else {
            return Ok(());
        };
        let there = self.geometry.surface(&down, &found, needs);
        // Angles wrap around after a full turn.
        let folded = |uv: DVec2| uv - uv.round();
        let (change, wrong) = (folded(there.uv - here.uv), folded(extrapolated.uv - there.uv));
        // The effect of the error of the point, which is large where a shape is thin.
        let moved = |side: f64| {
            let q = q + (side * here.error) * here.n_g;
            self.geometry
                .surface_at_offset(&here, hit, q, needs)
                .map_or((DVec2::ZERO, DVec3::ZERO), |found| (found.uv, found.n_s))
        };
        let ((uv, n_s), (other_uv, other_n_s)) = (moved(-4.0), moved(4.0));
        let unsure = (uv - other_uv).length() + (n_s - other_n_s).length();
        let rounding = 1e-9 * (1.0 + here.uv.length()) + 64.0 * here.error / self.size() + unsure;
        let [u, v] = self.geometry.uv_gradient(&here, hit);
        let risen = step * DVec2::new(u.dot(along), v.dot(along));
        let off = (risen - folded(extrapolated.uv - here.uv)).length();
        law(
            change.length() > 1e-3 || off <= 1e-3 * risen.length() + rounding,
            "the gradients of (u, v) must agree with the extrapolated surface",
        )?;
        // Near poles, coordinates change too fast to be compared.
        law(
            change.length() > 1e-3 || wrong.length() <= 0.05 * change.length() + rounding,
            "extrapolated texture coordinates must equal those that a ray finds there",
        )?;
        let turned = there.n_s - here.n_s;
        law(
            turned.length() > 1e-3
                || (extrapolated.n_s - there.n_s).length() <= 0.05 * turned.length() + rounding,
            "the extrapolated normal must equal the one that a ray finds there",
        )
    }

    /// Near an edge, a ray spawned on one part of the surface may legitimately hit the next part at
    /// a tiny distance; among a million rays some start that close. A self-intersection would hit
    /// the same part, or the wrong side: entries and exits alternate, so a ray that leaves to the
    /// outside (`side` is 1) enters next, and a ray that leaves to the inside exits next.
    fn is_behind_an_edge(
        &self,
        ray: &Ray,
        met: &PreliminaryIntersection,
        left: &PreliminaryIntersection,
        side: f64,
    ) -> bool {
        let n = self.geometry.surface(ray, met, SurfaceAttributes::NOTHING).n_g;
        met.id() != left.id() && side * n.dot(ray.direction) < 0.0
    }

    /// Whether the surface is at this position, within `slack`, as seen from just above. The
    /// position error is bounded only along the normal: sideways, rays from very far away may end
    /// beyond an edge by their rounding error.
    fn is_on_surface(&self, position: DVec3, n: DVec3, slack: f64) -> bool {
        let (a, b) = n.any_orthonormal_pair();
        let around = (0..8).map(|part| DVec2::from_angle(TAU / 8.0 * f64::from(part)));
        let rounding = slack.max(1e-9 * self.size());
        let aside = around.map(|on| position + rounding * (on.x * a + on.y * b));
        std::iter::once(position)
            .chain(aside)
            .any(|place| self.is_under(place, n, slack))
    }

    /// Whether a ray from above finds the surface at a position.
    fn is_under(&self, position: DVec3, n: DVec3, slack: f64) -> bool {
        // A power of two near a thousandth of the size, to minimise rounding.
        let above = (0.001 * self.size()).log2().floor().exp2().max(64.0 * slack);
        let ray = Ray::new(position + above * n, -n);
        let rounding = 16.0 * f64::EPSILON * (position.abs().max_element() + self.size());
        let tolerance = slack + rounding;
        let around = Interval {
            min: above - tolerance,
            max: above + tolerance,
        };
        self.intersect(&ray, around, SelfHitFilter::NOTHING).is_some()
    }
}

/// Bitwise equality: distinguishes +0 and -0.
pub(crate) fn same_bits(a: &PreliminaryIntersection, b: &PreliminaryIntersection) -> bool {
    let bits = |hit: &PreliminaryIntersection| [hit.t, hit.prim_uv.x, hit.prim_uv.y].map(f64::to_bits);
    a.id() == b.id() && bits(a) == bits(b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ball::Ball;
    use std::sync::atomic::{AtomicU32, Ordering};
    use whitstone_core::{Shape, ShapeHit};

    /// A correct ball, or one with a deliberate fault.
    struct Faulty {
        ball: Ball,
        fault: Fault,
        calls: AtomicU32,
    }

    #[derive(Clone, Copy, Debug, PartialEq)]
    enum Fault {
        None,
        BoundsTooSmall,
        PointOffTheSurface,
        PointOnTheRay,
        LongNormal,
        ParameterInMetres,
        MeetsItselfAgain,
        MeetsItselfAsAnother,
        NearerInNarrowIntervals,
        IgnoresTheInterval,
        Forgetful,
        Nowhere,
    }

    impl Shape for Faulty {
        fn bounds(&self) -> Aabb {
            match self.fault {
                Fault::BoundsTooSmall => self.ball.bounds().padded(-0.02),
                _ => self.ball.bounds(),
            }
        }

        fn intersect(
            &self,
            ray: &Ray,
            interval: Interval,
            origin_primitive: Option<u32>,
        ) -> Option<ShapeHit> {
            let calls = self.calls.fetch_add(1, Ordering::Relaxed);
            let asked = match self.fault {
                Fault::Nowhere => return None,
                Fault::MeetsItselfAgain => return self.ball.intersect(ray, interval, None),
                Fault::MeetsItselfAsAnother => {
                    let primitive = u32::from(origin_primitive.is_some());
                    let hit = self.ball.intersect(ray, interval, None);
                    return hit.map(|hit| ShapeHit { primitive, ..hit });
                }
                Fault::IgnoresTheInterval | Fault::ParameterInMetres => Interval::FORWARD,
                _ => interval,
            };
            let mut hit = self.ball.intersect(ray, asked, origin_primitive)?;
            match self.fault {
                Fault::ParameterInMetres => hit.t *= ray.direction.length(),
                Fault::NearerInNarrowIntervals if interval.max.is_finite() => hit.t = hit.t.next_down(),
                Fault::Forgetful => hit.prim_uv.x = f64::from(calls % 7),
                _ => {}
            }
            (self.fault == Fault::IgnoresTheInterval || interval.contains(hit.t)).then_some(hit)
        }

        fn surface(
            &self,
            ray: &Ray,
            hit: &PreliminaryIntersection,
            needs: SurfaceAttributes,
        ) -> SurfaceInteraction {
            let mut point = self.ball.surface(ray, hit, needs);
            match self.fault {
                Fault::PointOffTheSurface => point.position += 1e-12 * point.n_g,
                Fault::PointOnTheRay => point.position = ray.at(hit.t),
                Fault::LongNormal => point.n_s *= 1.0 + 1e-12,
                _ => {}
            }
            point
        }
    }

    fn verdict(fault: Fault) -> Result<(), String> {
        let ball = Ball {
            center: DVec3::new(0.5, -0.25, 1.0),
            radius: 1.5,
        };
        let calls = AtomicU32::new(0);
        let shape = LoweredShape::Custom(Box::new(Faulty { ball, fault, calls }));
        first_broken(shape, 400).map_err(|broken| broken.law)
    }

    #[test]
    fn a_good_ball_passes() {
        assert_eq!(verdict(Fault::None), Ok(()));
    }

    #[test]
    fn every_fault_is_found_by_its_law() {
        for (fault, expected) in [
            (Fault::BoundsTooSmall, "the bounds must contain"),
            (Fault::PointOffTheSurface, "the position must lie on the surface"),
            (Fault::PointOnTheRay, "the position must lie on the surface"),
            (Fault::LongNormal, "normals must have unit length"),
            (Fault::ParameterInMetres, "t must be inversely proportional"),
            (Fault::MeetsItselfAgain, "a spawned ray must not hit its start"),
            (
                Fault::MeetsItselfAsAnother,
                "a spawned ray must not hit its start",
            ),
            (
                Fault::NearerInNarrowIntervals,
                "the hit must not depend on an interval",
            ),
            (Fault::IgnoresTheInterval, "a hit behind the nearest one"),
            (Fault::Forgetful, "a second query"),
            (Fault::Nowhere, "too few of 400 rays"),
        ] {
            let found = verdict(fault)
                .err()
                .unwrap_or_else(|| panic!("{fault:?} must be found"));
            assert!(found.starts_with(expected), "{fault:?}: {found}");
        }
    }
}
