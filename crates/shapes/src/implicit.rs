//! An implicit surface: the zero level set of a function that is negative inside.
//!
//! A tree of operations builds the function from distance functions and metaballs. Distances: Hart,
//! *Sphere tracing: a geometric method for the antialiased ray tracing of implicit surfaces*, The
//! Visual Computer 12(10), 1996. The smooth union is the quadratic polynomial of Quilez, *Smooth
//! minimum*, <https://iquilezles.org/articles/smin/>. Interval bounds of values and slopes isolate
//! the roots (Mitchell 1990, see `support/crossings.rs`). A Lipschitz bound on the function is
//! derived from the tree or asserted by the scene. With it, one evaluation skips a range far from
//! the surface, as in sphere tracing.
//!
//! - Twin: POV-Ray `isosurface` with the same formulas, `blob` for a field that is one `metaballs`.
//! - Example: `scenes/shapes/implicit.toml`.

mod tree;

use crate::support::crossings::{Along, RootCount, STEPS, crossings};
use crate::support::enclosure::{Dual, Enclosure};
use crate::support::level::{BOX_MARGIN, Level, Sample, Segment, check_search};
use schemars::JsonSchema;
use serde::Deserialize;
use std::ops::ControlFlow;
use toml::Spanned;
use tree::{Field, Node};
use whitstone_core::config::{Positive, Vector3};
use whitstone_core::{
    Aabb, Context, DVec2, DVec3, Interval, LimitReached, LoweredShape, Plugin, PreliminaryIntersection, Ray,
    SceneError, SceneErrors, Shape, ShapeHit, Shapes, Spans, SurfaceAttributes, SurfaceInteraction,
    Transform,
};

/// Number of sample points at which an asserted Lipschitz bound is checked.
const SAMPLES: u32 = 4096;
/// Maximum number of parts of the box faces that [`Implicit::is_closed`] examines.
const FACE_PARTS: u32 = 1 << 14;
/// Maximum number of turns by which the field may be twisted inside the box. A ray needs more
/// ranges the more turns there are; crossings could be skipped without them.
const MAX_TURNS: f64 = 2048.0;
/// Ranges per turn that a ray may examine at full resolution, in addition to the usual number:
/// at least twice as many as the worst ray of the tests needs.
const STEPS_PER_TURN: f64 = 256.0;
/// Bound on the rounding error of the function, relative to the Lipschitz bound times the sum of
/// the diagonal of the box and its largest absolute coordinate. Values of smaller magnitude are not
/// distinguished from zero.
const SMALL: f64 = 1.0 / (1u64 << 44) as f64;

/// An implicit surface: the zero level set of a function that is negative inside and positive
/// outside.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The function: a table with one key, which names a shape or an operation on other fields.
    /// Lengths are in metres.
    #[schemars(with = "Node")]
    field: Spanned<Node>,
    /// The box in object space in which rays search for the surface. Where it cuts the inside, the
    /// shape is open.
    #[serde(default)]
    #[schemars(extend("x-default" = "the bounds of the inside; required if it may be infinite"), with = "Bounds")]
    bounds: Option<Spanned<Bounds>>,
    /// An asserted bound on the change of the function per metre (Lipschitz constant). A sample
    /// point at which the gradient exceeds it is an error.
    #[serde(default)]
    #[schemars(extend("x-default" = "a derived bound"), with = "Positive")]
    lipschitz: Option<Spanned<Positive>>,
}

/// A box in object space, in metres.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Bounds {
    /// Minimum corner.
    min: Vector3,
    /// Maximum corner.
    max: Vector3,
}

/// The implicit surface in its object space.
pub struct Implicit {
    level: Level,
    field: Field,
    /// Lipschitz bound of the field in the box, per metre.
    steepest: f64,
    /// Bound on the rounding error of the field.
    small: f64,
    /// See [`Along::steps`].
    steps: u32,
}

impl Plugin<Shapes> for Implicit {
    const TYPE: &'static str = "implicit";
    type Config = Config;

    fn build(config: Config, transform: Transform, _: &mut dyn Context) -> Result<LoweredShape, SceneErrors> {
        let place = config.field.span();
        let field = Field::new(config.field.into_inner())
            .map_err(|message| SceneError::at(place.clone(), message))?;
        let (min, max) = match &config.bounds {
            Some(bounds) => {
                let (min, max) = (bounds.get_ref().min.get(), bounds.get_ref().max.get());
                if !min.cmplt(max).all() {
                    let message = "expected `min` below `max` along all three axes";
                    return Err(SceneError::at(bounds.span(), message).into());
                }
                (min, max)
            }
            None => derived_bounds(&field).map_err(|error| SceneError {
                span: Some(place.clone()),
                ..error
            })?,
        };
        let turns = field.turns([0, 1, 2].map(|k| Enclosure::new(min[k], max[k])));
        if turns > MAX_TURNS {
            let message = format!(
                "the field is twisted by {turns:.0} turns inside its box; at most {MAX_TURNS} are supported, because rays could skip crossings"
            );
            let help = "reduce `degrees_per_metre`, or the height of the box with `bounds`";
            return Err(SceneError::at(place, message).with_help(help).into());
        }
        let mut shape = Self::new(
            field,
            min,
            max,
            transform,
            config.lipschitz.as_ref().map(|l| l.get_ref().get()),
        );
        if let Some(asserted) = &config.lipschitz {
            shape
                .check_lipschitz(asserted.get_ref().get())
                .map_err(|message| {
                    SceneError::at(asserted.span(), message).with_help("remove it: a bound is then derived")
                })?;
        }
        check_search(&shape).map_err(|message| {
            SceneError::at(place, message)
                .with_help("use a field that changes less abruptly, or smaller `bounds`")
        })?;
        shape.level.reset_search_limit();
        Ok(LoweredShape::Custom(Box::new(shape)))
    }
}

/// A box around the set with a margin, so that rays enter it outside the set despite their rounding
/// errors.
fn derived_bounds(field: &Field) -> Result<(DVec3, DVec3), SceneError> {
    let around = field.bounds_below(0.0);
    if around.iter().any(|range| range.lo >= range.hi) {
        return Err(SceneError::anywhere(
            "the field is nowhere negative: the shape is empty",
        ));
    }
    let [x, y, z] = around;
    let (min, max) = (DVec3::new(x.lo, y.lo, z.lo), DVec3::new(x.hi, y.hi, z.hi));
    if !(min.is_finite() && max.is_finite()) {
        return Err(
            SceneError::anywhere("the field may be negative in an unbounded region")
                .with_help("limit the region: bounds = { min = [..], max = [..] }"),
        );
    }
    let margin = BOX_MARGIN * (max - min).max_element();
    Ok((min - margin, max + margin))
}

impl Implicit {
    fn new(field: Field, min: DVec3, max: DVec3, transform: Transform, asserted: Option<f64>) -> Self {
        let region = [0, 1, 2].map(|k| Enclosure::new(min[k], max[k]));
        let steepest = asserted.unwrap_or_else(|| field.steepest(region));
        let size = (max - min).length() + min.abs().max(max.abs()).max_element();
        Self {
            level: Level::new(transform, min, max),
            steps: STEPS + (STEPS_PER_TURN * field.turns(region).min(MAX_TURNS)) as u32,
            field,
            small: SMALL * size * steepest,
            steepest,
        }
    }

    /// Rejects an asserted Lipschitz bound if the gradient exceeds it at a sample point.
    fn check_lipschitz(&self, asserted: f64) -> Result<(), String> {
        // Steps of the additive recurrence R3 (Roberts, 2018), a low-discrepancy sequence.
        const STEP: [f64; 3] = [
            0.819_172_513_396_164_5,
            0.671_043_606_703_789_3,
            0.549_700_477_901_970_3,
        ];
        let (min, max) = (self.level.min(), self.level.max());
        for i in 0..SAMPLES {
            let unit = DVec3::from_array(STEP).map(|step| (0.5 + step * f64::from(i)).fract());
            let p = min + unit * (max - min);
            let found = self.sample(p).gradient.length();
            if found > asserted * (1.0 + 1e-9) {
                return Err(format!(
                    "the field changes by {found:.6} per metre at [{:.6}, {:.6}, {:.6}], {:.4} times as fast as `lipschitz` states",
                    p.x,
                    p.y,
                    p.z,
                    found / asserted
                ));
            }
        }
        Ok(())
    }

    fn sample(&self, p: DVec3) -> Sample {
        let axis = |k: usize| Dual {
            value: p[k],
            slopes: std::array::from_fn(|i| f64::from(u8::from(i == k))),
        };
        let found: Dual<f64, 3> = self.field.eval([axis(0), axis(1), axis(2)]);
        let around = self.field.eval(p.to_array().map(|c| Enclosure::new(c, c)));
        Sample {
            value: found.value,
            gradient: DVec3::from_array(found.slopes),
            error: (around.hi - around.lo).abs(),
        }
    }

    /// Whether the field is certainly positive on all faces of the box, so that the box does not
    /// clip the set.
    fn is_closed(&self) -> bool {
        let (min, max) = (self.level.min(), self.level.max());
        let whole = [0, 1, 2].map(|k| Enclosure::new(min[k], max[k]));
        let mut open: Vec<_> = (0..6)
            .map(|face| {
                let (mut part, axis) = (whole, face / 2);
                let at = if face % 2 == 0 { min[axis] } else { max[axis] };
                part[axis] = Enclosure::new(at, at);
                part
            })
            .collect();
        for _ in 0..FACE_PARTS {
            let Some(part) = open.pop() else {
                return true;
            };
            if self.field.eval(part).lo > self.small {
                continue;
            }
            let longest =
                |a: &usize, b: &usize| (part[*a].hi - part[*a].lo).total_cmp(&(part[*b].hi - part[*b].lo));
            let axis = (0..3).max_by(longest).unwrap_or(0);
            let Enclosure { lo, hi } = part[axis];
            let middle = 0.5 * (lo + hi);
            for [from, to] in [[lo, middle], [middle, hi]] {
                let mut half = part;
                half[axis] = Enclosure::new(from, to);
                open.push(half);
            }
        }
        false
    }

    fn along<'a>(&'a self, segment: &'a Segment) -> Line<'a> {
        Line {
            shape: self,
            segment,
            length: segment.direction.length(),
        }
    }
}

/// The field along the part of a ray inside the box.
struct Line<'a> {
    shape: &'a Implicit,
    segment: &'a Segment,
    length: f64,
}

impl Along for Line<'_> {
    fn at(&self, s: f64) -> (f64, f64) {
        let p = self.segment.at(s);
        let axis = |k: usize| Dual {
            value: p[k],
            slopes: [self.segment.direction[k]],
        };
        let found = self.shape.field.eval([axis(0), axis(1), axis(2)]);
        (found.value, found.slopes[0])
    }

    fn over(&self, lo: f64, hi: f64) -> RootCount {
        let Implicit {
            field,
            steepest,
            small,
            ..
        } = self.shape;
        // By the Lipschitz bound, the field cannot reach 0 in this range.
        let value = field.eval(self.segment.at(0.5 * (lo + hi)).to_array());
        if value.abs() > 0.5 * (hi - lo) * self.length * steepest + small {
            return RootCount::Zero;
        }
        let axis = |k: usize| {
            // The ends are rounded as in `Segment::at`. Rounding is monotonic, so every point of
            // the range that is computed there lies between them.
            let (a, b) = (self.segment.at(lo)[k], self.segment.at(hi)[k]);
            Dual {
                value: Enclosure::new(a.min(b), a.max(b)),
                slopes: [Enclosure::new(
                    self.segment.direction[k],
                    self.segment.direction[k],
                )],
            }
        };
        let found = field.eval([axis(0), axis(1), axis(2)]);
        if !found.value.has_zero() {
            RootCount::Zero
        } else if !found.slopes[0].has_zero() || found.value.reach() < *small {
            RootCount::AtMostOne
        } else {
            RootCount::Unknown
        }
    }

    fn steps(&self) -> u32 {
        self.shape.steps
    }

    fn limit_reached(&self, s: f64) {
        self.shape.level.limit_reached(self.segment.at(s));
    }
}

impl Shape for Implicit {
    fn bounds(&self) -> Aabb {
        self.level.bounds()
    }

    fn intersect(&self, ray: &Ray, interval: Interval, origin_primitive: Option<u32>) -> Option<ShapeHit> {
        let ray = self.level.ray(ray);
        let segment = self.level.clip(&ray)?;
        let slope_at_origin = origin_primitive.map(|_| self.sample(ray.origin).gradient.dot(ray.direction));
        let line = self.along(&segment);
        self.level
            .intersect(&ray, &segment, &line, slope_at_origin, interval)
    }

    fn surface(&self, ray: &Ray, hit: &PreliminaryIntersection, _: SurfaceAttributes) -> SurfaceInteraction {
        let p = self.level.ray(ray).at(hit.t);
        self.level.surface(ray, p, |p| self.sample(p))
    }

    fn surface_at_offset(
        &self,
        point: &SurfaceInteraction,
        hit: &PreliminaryIntersection,
        q: DVec3,
        needs: SurfaceAttributes,
    ) -> Option<SurfaceInteraction> {
        let there = PreliminaryIntersection { t: 0.0, ..*hit };
        Some(self.surface(&Ray::new(q, point.n_g), &there, needs))
    }

    fn is_solid(&self) -> bool {
        self.is_closed()
    }

    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        self.level.spans(&self.level.ray(ray), spans, |segment, tell| {
            crossings(&self.along(segment), |crossing| {
                tell(crossing, DVec2::ZERO);
                ControlFlow::Continue(())
            });
        });
    }

    fn search_limit(&self) -> Option<LimitReached> {
        self.level.search_limit()
    }

    fn goes_inside(&self, ray: &Ray, _: u32) -> bool {
        let ray = self.level.ray(ray);
        self.sample(ray.origin).gradient.dot(ray.direction) < 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::InstanceId;
    use whitstone_testkit::{Random, build, shape_laws_everywhere};

    fn implicit(text: &str) -> Implicit {
        let table = toml::de::DeTable::parse(text).unwrap();
        let config: Config = whitstone_core::config::decode(&table).unwrap();
        let field = Field::new(config.field.into_inner()).unwrap();
        let (min, max) = match config.bounds {
            Some(bounds) => (bounds.get_ref().min.get(), bounds.get_ref().max.get()),
            None => derived_bounds(&field).unwrap(),
        };
        Implicit::new(field, min, max, Transform::IDENTITY, None)
    }

    /// A tree that combines as many operations as possible.
    const TREE: &str = r#"
        [field]
        smooth_union.k = 0.2
        [[field.smooth_union.of]]
        difference = [
            { twist = { degrees_per_metre = 60, of = { box = { half = [0.4, 0.5, 0.8] } } } },
            { translate = { by = [0, 0.3, 0.2], of = { rotate = { axis = [1, 1, 0], degrees = 40, of = { torus = { major = 0.5 } } } } } },
        ]
        [[field.smooth_union.of]]
        capsule = { a = [-0.5, 0, -0.5], b = [0.6, 0.4, 0.7], radius = 0.2 }
        [[field.smooth_union.of]]
        intersection = [
            { plane = { normal = [0, 1, 1], offset = -0.2 } },
            { repeat = { period = [0.7, 0.8, 1], count = [2, 2, 1], of = { scale = { by = 0.4, of = { sphere = {} } } } } },
        ]
    "#;

    const BALLS: &str = "field.metaballs = { threshold = 0.4, balls = [{ center = [0, 0, 0], radius = 1 },
        { center = [0.7, 0.2, 0], radius = 0.8, strength = 1.5 }, { center = [0.3, 0.1, 0.2], radius = 0.3, strength = -1 }] }";

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws_everywhere::<Implicit>("field.sphere = {}", 2_000);
        shape_laws_everywhere::<Implicit>("field.box.half = [0.5, 1, 2]", 2_000);
        shape_laws_everywhere::<Implicit>(BALLS, 2_000);
        shape_laws_everywhere::<Implicit>(TREE, 300);
        let cut = "field.plane = { normal = [1, 2, 3] }\nbounds = { min = [-1, -1, -1], max = [1, 1, 1] }";
        shape_laws_everywhere::<Implicit>(cut, 2_000);
    }

    #[test]
    fn spheres_boxes_and_tori_are_hit_where_they_are() {
        let hit = |text: &str, origin: [f64; 3], direction: [f64; 3]| {
            let shape = implicit(text);
            let ray = Ray::new(origin.into(), direction.into());
            let hit = shape.intersect(&ray, Interval::FORWARD, None)?;
            let n = shape
                .surface(
                    &ray,
                    &hit.of_shape(InstanceId::TOP_LEVEL, 0),
                    SurfaceAttributes::NOTHING,
                )
                .n_g;
            Some((hit.t, n))
        };
        let close = |found: Option<(f64, DVec3)>, t: f64, n: DVec3| {
            let (found_t, found_n) = found.unwrap();
            assert!(
                (found_t - t).abs() < 1e-13 && (found_n - n).length() < 1e-12,
                "{found_t} {found_n}"
            );
        };
        close(
            hit("field.sphere.radius = 0.5", [0.3, 0.0, 4.0], [0.0, 0.0, -1.0]),
            3.6,
            DVec3::new(0.6, 0.0, 0.8),
        );
        close(
            hit("field.box.half = [1, 2, 3]", [0.5, 9.0, 1.0], [0.0, -2.0, 0.0]),
            3.5,
            DVec3::Y,
        );
        close(
            hit("field.torus = {}", [-5.0, 0.0, 0.0], [1.0, 0.0, 0.0]),
            3.75,
            DVec3::NEG_X,
        );
        // Through the hole.
        assert_eq!(hit("field.torus = {}", [0.1, 0.1, 5.0], [0.0, 0.0, -1.0]), None);
        // Twisted by a quarter turn per metre: at z = 1, the x axis of the box lies along y.
        let twisted = "field.twist = { degrees_per_metre = 90, of = { box = { half = [0.9, 0.1, 2] } } }";
        let (t, _) = hit(twisted, [0.0, 5.0, 1.0], [0.0, -1.0, 0.0]).unwrap();
        assert!((t - 4.1).abs() < 1e-12, "{t}");
        assert!(hit(twisted, [0.0, 5.0, 0.0], [0.0, -1.0, 0.0]).unwrap().0 - 4.9 < 1e-12);
    }

    #[test]
    fn derived_boxes_hold_the_whole_set_and_derived_slopes_are_the_steepest() {
        let mut random = Random::new(5);
        for text in [TREE, BALLS] {
            let shape = implicit(text);
            let (min, max) = (shape.level.min(), shape.level.max());
            let mut steepest = 0.0_f64;
            for _ in 0..40_000 {
                let p = 3.0 * random.cube();
                let outside = p.cmplt(min).any() || p.cmpgt(max).any();
                let found = shape.sample(p);
                assert!(!(outside && found.value < 0.0), "{p}");
                if !outside {
                    steepest = steepest.max(found.gradient.length());
                }
            }
            assert!(
                steepest <= shape.steepest * (1.0 + 1e-12) && steepest > 0.2 * shape.steepest,
                "{steepest}"
            );
        }
    }

    /// The first root by interval bounds alone, without a Lipschitz bound.
    fn by_ranges(shape: &Implicit, ray: &Ray) -> Option<f64> {
        struct Ranges<'a>(Line<'a>);
        impl Along for Ranges<'_> {
            fn at(&self, s: f64) -> (f64, f64) {
                self.0.at(s)
            }
            fn over(&self, lo: f64, hi: f64) -> RootCount {
                let Line { shape, segment, .. } = &self.0;
                let (a, b) = (segment.at(lo), segment.at(hi));
                let found = shape
                    .field
                    .eval([0, 1, 2].map(|k| Enclosure::new(a[k].min(b[k]), a[k].max(b[k]))));
                if found.has_zero() {
                    RootCount::Unknown
                } else {
                    RootCount::Zero
                }
            }
            fn limit_reached(&self, _: f64) {}
        }
        let segment = shape.level.clip(ray)?;
        let mut found = None;
        crossings(&Ranges(shape.along(&segment)), |crossing| {
            found = Some(segment.parameter(crossing.s));
            ControlFlow::Break(())
        });
        found
    }

    /// A box that is twisted so that the gradient reaches about `shear`.
    fn pillar(shear: f64) -> String {
        let rate = (shear / 0.5_f64).to_degrees();
        format!(
            "field.twist = {{ degrees_per_metre = {rate}, of = {{ box = {{ half = [0.4, 0.3, 0.2] }} }} }}"
        )
    }

    #[test]
    fn a_true_bound_misses_nothing_and_a_false_one_is_found() {
        let mut random = Random::new(28);
        let (mut hits, mut misses_of_false) = (0, 0);
        for shear in [0.0, 1.0, 10.0, 100.0, 1000.0] {
            let text = pillar(shear);
            let shape = implicit(&text);
            assert!(
                shape.steepest >= shear.max(1.0) && shape.steepest < 2.0 * shear + 2.0,
                "{}",
                shape.steepest
            );
            let mut wrong = implicit(&text);
            wrong.steepest /= 20.0;
            for _ in 0..150 {
                let origin = 2.0 * random.direction();
                let ray = Ray::new(origin, 0.5 * random.cube() - origin);
                let truth = by_ranges(&shape, &ray);
                let found = shape.intersect(&ray, Interval::FORWARD, None).map(|hit| hit.t);
                match (truth, found) {
                    (Some(a), Some(b)) => assert!((a - b).abs() < 1e-11, "{shear}: {a} {b} {ray:?}"),
                    _ => assert_eq!(truth, found, "{shear}: {ray:?}"),
                }
                hits += usize::from(truth.is_some());
                let by_wrong = wrong.intersect(&ray, Interval::FORWARD, None).map(|hit| hit.t);
                let same =
                    by_wrong.zip(truth).is_some_and(|(a, b)| (a - b).abs() < 1e-9) || by_wrong == truth;
                misses_of_false += usize::from(!same);
            }
            // An asserted bound is accepted if it is true, and rejected if it is false.
            let promise = |bound: f64| {
                build::<Shapes, Implicit>(&format!("lipschitz = {bound}\n{text}"), Transform::IDENTITY)
                    .map(drop)
            };
            assert_eq!(promise(shape.steepest), Ok(()));
            let message = promise(0.5 * shape.steepest).unwrap_err().0.remove(0).message;
            assert!(
                message.starts_with("the field changes by") && message.contains("times as fast"),
                "{message}"
            );
        }
        assert!(hits > 300, "{hits}");
        assert!(misses_of_false > 20, "{misses_of_false}");
    }

    /// A bar that is twisted so fast that it looks like a screw thread: no crossing is skipped.
    /// Dense samples give the truth.
    #[test]
    fn fast_twists_have_no_gaps() {
        let bar = |rate: f64| {
            format!(
                "field.twist = {{ degrees_per_metre = {rate:e}, of = {{ box = {{ half = [0.8, 0.1, 1] }} }} }}"
            )
        };
        let mut random = Random::new(12);
        let mut skipped_by_few = 0;
        for rate in [3e3, 3e4, 3e5] {
            let shape = implicit(&bar(rate));
            let mut few = implicit(&bar(rate));
            few.steps = STEPS;
            let mut most = 0;
            for _ in 0..60 {
                let origin = 2.0 * random.direction();
                let ray = Ray::new(origin, random.cube() - origin);
                let Some(segment) = shape.level.clip(&ray) else {
                    continue;
                };
                let line = shape.along(&segment);
                most = most.max(crossings(&line, |_| ControlFlow::Break(())));
                let found = shape.intersect(&ray, Interval::FORWARD, None).map(|hit| hit.t);
                let samples = 1 << 20;
                let inside = |k: &u32| line.at(f64::from(*k) / f64::from(samples)).0 < -shape.small;
                let truth = (0..=samples).find(inside);
                let truth = truth.map(|k| segment.parameter(f64::from(k) / f64::from(samples)));
                let step = (segment.end - segment.begin) / f64::from(samples);
                let is_skipped =
                    |found: Option<f64>| truth.is_some_and(|truth| found.is_none_or(|t| t > truth + step));
                assert!(!is_skipped(found), "{rate:e}: {found:?} {truth:?} {ray:?}");
                let by_few = few.intersect(&ray, Interval::FORWARD, None).map(|hit| hit.t);
                skipped_by_few += u32::from(is_skipped(by_few));
            }
            let limit = shape.steps;
            assert!(most < limit / 2, "{rate:e}: {most} of {limit} ranges");
        }
        assert!(skipped_by_few > 0, "the usual number of ranges must be too small");
        let too_fast = build::<Shapes, Implicit>(&bar(1e6), Transform::IDENTITY)
            .err()
            .unwrap();
        let message = &too_fast.0[0].message;
        assert!(message.starts_with("the field is twisted by 5"), "{message}");
    }

    #[test]
    fn an_exhausted_search_is_counted_and_refused_if_it_is_frequent() {
        let mut shape = implicit("field.box.half = [0.5, 1, 2]");
        let ray = Ray::new(DVec3::new(0.2, 0.3, 9.0), DVec3::NEG_Z);
        shape.intersect(&ray, Interval::FORWARD, None);
        assert_eq!(shape.search_limit(), None);
        assert_eq!(check_search(&shape), Ok(()));
        // So few ranges suffice for no ray.
        shape.steps = 0;
        shape.intersect(&ray, Interval::FORWARD, None);
        shape.intersect(&ray, Interval::FORWARD, None);
        let reached = shape.search_limit().unwrap();
        assert_eq!(reached.rays, 2);
        // At the start of the search, where the ray enters the box.
        assert!((reached.place - DVec3::new(0.2, 0.3, shape.level.max().z)).length() < 1e-9);
        shape.level.reset_search_limit();
        let message = check_search(&shape).unwrap_err();
        assert!(
            message.starts_with("the search for hits reached its limit on 16 rays, on one near ["),
            "{message}"
        );
        assert!(message.contains("of 16 through its box"), "{message}");
    }

    #[test]
    fn steps_are_few_and_bounded() {
        let shape = implicit(TREE);
        let mut random = Random::new(6);
        let (mut sum, mut most) = (0, 0);
        for _ in 0..2_000 {
            let origin = 3.0 * random.direction();
            let ray = Ray::new(origin, random.cube() - origin);
            let Some(segment) = shape.level.clip(&ray) else {
                continue;
            };
            let steps = crossings(&shape.along(&segment), |_| ControlFlow::Continue(()));
            (sum, most) = (sum + steps, most.max(steps));
        }
        assert!(sum / 2_000 < 200 && most < 3_000, "{} {most}", sum / 2_000);
        // Along a face, where the field is zero throughout.
        let cube = implicit("field.box = {}");
        let ray = Ray::new(DVec3::new(-3.0, 0.3, 1.0), DVec3::X);
        let segment = cube.level.clip(&ray).unwrap();
        let steps = crossings(&cube.along(&segment), |_| ControlFlow::Continue(()));
        assert!(steps < 500, "{steps}");
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let message = |text: &str| {
            let error = build::<Shapes, Implicit>(text, Transform::IDENTITY)
                .err()
                .unwrap()
                .0
                .remove(0);
            error.message
        };
        assert!(message("field.plane.normal = [0, 0, 1]").contains("in an unbounded region"));
        assert!(message("field.plane.normal = [0, 0, 0]").contains("normal of a plane"));
        assert!(message("field.union = []").contains("is empty"));
        assert!(message("field.intersection = [{ sphere = { radius = -1 } }]").contains("greater than 0"));
        let apart = "field.intersection = [{ sphere = {} }, { translate = { by = [5, 0, 0], of = { sphere = {} } } }]";
        assert!(message(apart).contains("nowhere negative"));
        let many = "field.repeat = { period = [1, 1, 1], count = [64, 64, 1], of = { sphere = {} } }";
        assert!(message(many).contains("more than 1024"));
        let mut deep = "{ sphere = {} }".to_owned();
        for _ in 0..12 {
            deep = format!("{{ scale = {{ by = 2, of = {deep} }} }}");
        }
        assert!(message(&format!("field = {deep}")).contains("more than 12"));
        let turned = "field.sphere = {}\nbounds = { min = [1, 0, 0], max = [0, 1, 1] }";
        assert!(message(turned).contains("`min` below `max`"));
    }
}
