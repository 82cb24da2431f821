//! The tree of a field: its TOML form and its evaluation.

use crate::support::enclosure::{Enclosure, Number};
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::DVec3;
use whitstone_core::config::{Finite, IntegerIn, Positive, Vector3};

/// Maximum nesting depth of fields.
const MAX_DEPTH: u32 = 12;
/// Maximum number of evaluated fields; each copy of a repeated field counts.
const MAX_FIELDS: u64 = 1024;
/// The maximum slope of (1 - r²)², at r = 1/sqrt(3).
const KERNEL_SLOPE: f64 = 1.539_600_717_839_002_1;

/// A field in TOML: a table with one key.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Node {
    /// A sphere about the origin.
    Sphere(Sphere),
    /// An axis-aligned box about the origin.
    Box(Cuboid),
    /// A torus around the z axis.
    Torus(Torus),
    /// All points within a radius of the segment from a to b.
    Capsule(Capsule),
    /// The half-space below a plane.
    Plane(HalfSpace),
    /// Metaballs: soft spheres that blend into one another.
    Metaballs(Metaballs),
    /// The union of fields.
    Union(Vec<Node>),
    /// The intersection of fields.
    Intersection(Vec<Node>),
    /// The first field minus all others.
    Difference(Vec<Node>),
    /// A union with a smooth blend.
    SmoothUnion(SmoothUnion),
    /// A translated field.
    Translate(Translate),
    /// A rotated field.
    Rotate(Rotate),
    /// A uniformly scaled field.
    Scale(Scale),
    /// A field twisted about z in proportion to the height.
    Twist(Twist),
    /// Copies of a field on a regular grid.
    Repeat(Repeat),
}

/// See [`Node::Sphere`].
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Sphere {
    /// Radius in metres.
    #[serde(default = "one")]
    radius: Positive,
}

/// See [`Node::Box`].
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Cuboid {
    /// Half of the edge lengths in metres.
    #[serde(default = "ones")]
    half: [Positive; 3],
}

/// See [`Node::Torus`].
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Torus {
    /// Distance from the axis to the center of the tube, in metres.
    #[serde(default = "one")]
    major: Positive,
    /// Radius of the tube in metres.
    #[serde(default = "quarter")]
    minor: Positive,
}

/// See [`Node::Capsule`].
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Capsule {
    /// One end of the segment, in metres.
    a: Vector3,
    /// The other end, in metres.
    b: Vector3,
    /// Radius in metres.
    #[serde(default = "quarter")]
    radius: Positive,
}

/// See [`Node::Plane`].
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct HalfSpace {
    /// Outward normal, nonzero, of any length.
    normal: Vector3,
    /// Distance from the origin along the normal, in metres.
    #[serde(default = "zero")]
    offset: Finite,
}

/// See [`Node::Metaballs`].
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Metaballs {
    /// 1 to 64 metaballs.
    balls: Vec<Ball>,
    /// Threshold: the inside is where the sum of the metaballs exceeds it.
    #[serde(default = "half")]
    threshold: Positive,
}

/// One metaball.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Ball {
    /// Center in metres.
    center: Vector3,
    /// Radius of influence in metres.
    radius: Positive,
    /// Value at the center; may be negative.
    #[serde(default = "plain")]
    strength: Finite,
}

/// See [`Node::SmoothUnion`].
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct SmoothUnion {
    /// Width of the blend in metres.
    k: Positive,
    /// The fields.
    of: Vec<Node>,
}

/// See [`Node::Translate`].
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Translate {
    /// Translation in metres.
    by: Vector3,
    /// The field.
    of: Box<Node>,
}

/// See [`Node::Rotate`].
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Rotate {
    /// Rotation axis, nonzero, of any length.
    axis: Vector3,
    /// Angle in degrees, counter-clockwise looking against the axis.
    degrees: Finite,
    /// The field.
    of: Box<Node>,
}

/// See [`Node::Scale`].
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Scale {
    /// The scale factor.
    by: Positive,
    /// The field.
    of: Box<Node>,
}

/// See [`Node::Twist`].
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Twist {
    /// Angle in degrees per metre of height, counter-clockwise seen from +z.
    degrees_per_metre: Finite,
    /// The field.
    of: Box<Node>,
}

/// See [`Node::Repeat`].
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Repeat {
    /// Distance between copies along each axis, in metres.
    period: [Positive; 3],
    /// Number of copies along each axis; the grid is centered on the origin.
    count: [IntegerIn<1, 64>; 3],
    /// The field.
    of: Box<Node>,
}

fn positive(value: f64) -> Positive {
    Positive::new(value).expect("it is positive")
}

fn one() -> Positive {
    positive(1.0)
}

fn ones() -> [Positive; 3] {
    [one(); 3]
}

fn half() -> Positive {
    positive(0.5)
}

fn quarter() -> Positive {
    positive(0.25)
}

fn zero() -> Finite {
    Finite::new(0.0).expect("0 is finite")
}

fn plain() -> Finite {
    Finite::new(1.0).expect("1 is finite")
}

/// A field in evaluable form.
#[derive(Debug)]
pub(crate) enum Field {
    Sphere {
        radius: f64,
    },
    Box {
        half: [f64; 3],
    },
    Torus {
        major: f64,
        minor: f64,
    },
    Capsule {
        a: DVec3,
        /// The vector from a to b, and that vector over its squared length.
        along: DVec3,
        per_along: DVec3,
        radius: f64,
    },
    Plane {
        normal: DVec3,
        offset: f64,
    },
    /// Center, 1/r² and strength of each metaball.
    Metaballs {
        balls: Vec<(DVec3, f64, f64)>,
        threshold: f64,
    },
    /// A smooth union if k > 0.
    Union {
        k: f64,
        of: Vec<Field>,
    },
    Intersection {
        of: Vec<Field>,
    },
    /// The first field minus the others.
    Difference {
        of: Vec<Field>,
    },
    Moved {
        by: DVec3,
        of: Box<Field>,
    },
    /// The rows of the inverse rotation.
    Turned {
        back: [DVec3; 3],
        of: Box<Field>,
    },
    Scaled {
        by: f64,
        of: Box<Field>,
    },
    /// Radians per metre.
    Twisted {
        rate: f64,
        of: Box<Field>,
    },
    Repeated {
        offsets: Vec<DVec3>,
        of: Box<Field>,
    },
}

type Point<N> = [N; 3];

fn length<N: Number>(p: &[N]) -> N {
    let squares = p.iter().map(|c| c.square());
    squares
        .reduce(|sum, square| sum + square)
        .unwrap_or(N::constant(0.0))
        .root()
}

fn dot<N: Number>(p: &Point<N>, v: DVec3) -> N {
    p[0].times(v.x) + p[1].times(v.y) + p[2].times(v.z)
}

fn shift<N: Number>(p: Point<N>, by: DVec3) -> Point<N> {
    [p[0].plus(-by.x), p[1].plus(-by.y), p[2].plus(-by.z)]
}

impl Field {
    /// Builds the field; the error is a message for the user.
    pub(crate) fn new(node: Node) -> Result<Self, String> {
        let mut fields = 0;
        Self::build(node, 1, 1, &mut fields)
    }

    fn build(node: Node, depth: u32, copies: u64, fields: &mut u64) -> Result<Self, String> {
        *fields += copies;
        if depth > MAX_DEPTH {
            return Err(format!("fields are nested more than {MAX_DEPTH} deep"));
        }
        if *fields > MAX_FIELDS {
            return Err(format!(
                "more than {MAX_FIELDS} fields, counting every repetition"
            ));
        }
        let mut one =
            |node: Box<Node>, copies: u64| Self::build(*node, depth + 1, copies, fields).map(Box::new);
        Ok(match node {
            Node::Sphere(sphere) => Self::Sphere {
                radius: sphere.radius.get(),
            },
            Node::Box(cuboid) => Self::Box {
                half: cuboid.half.map(Positive::get),
            },
            Node::Torus(torus) => Self::Torus {
                major: torus.major.get(),
                minor: torus.minor.get(),
            },
            Node::Capsule(capsule) => {
                let (a, b) = (capsule.a.get(), capsule.b.get());
                let along = b - a;
                let per_along = along / along.length_squared();
                if !per_along.is_finite() {
                    return Err("the ends of a capsule must differ".to_owned());
                }
                Self::Capsule {
                    a,
                    along,
                    per_along,
                    radius: capsule.radius.get(),
                }
            }
            Node::Plane(plane) => Self::Plane {
                normal: plane
                    .normal
                    .get()
                    .try_normalize()
                    .ok_or("the normal of a plane must not have length zero")?,
                offset: plane.offset.get(),
            },
            Node::Metaballs(Metaballs { balls, threshold }) => {
                if !(1..=64).contains(&balls.len()) {
                    return Err(format!("expected 1 to 64 metaballs, found {}", balls.len()));
                }
                *fields += copies * balls.len() as u64;
                let ball = |ball: &Ball| {
                    (
                        ball.center.get(),
                        1.0 / (ball.radius.get() * ball.radius.get()),
                        ball.strength.get(),
                    )
                };
                let balls: Vec<_> = balls.iter().map(ball).collect();
                if !balls
                    .iter()
                    .all(|(_, per_square, _)| per_square.is_finite() && *per_square > 0.0)
                {
                    return Err("the radius of a metaball is out of range".to_owned());
                }
                Self::Metaballs {
                    balls,
                    threshold: threshold.get(),
                }
            }
            Node::Union(of) => Self::Union {
                k: 0.0,
                of: Self::list(of, "union", depth, copies, fields)?,
            },
            Node::SmoothUnion(SmoothUnion { k, of }) => Self::Union {
                k: k.get(),
                of: Self::list(of, "smooth_union", depth, copies, fields)?,
            },
            Node::Intersection(of) => Self::Intersection {
                of: Self::list(of, "intersection", depth, copies, fields)?,
            },
            Node::Difference(of) => Self::Difference {
                of: Self::list(of, "difference", depth, copies, fields)?,
            },
            Node::Translate(Translate { by, of }) => Self::Moved {
                by: by.get(),
                of: one(of, copies)?,
            },
            Node::Rotate(Rotate { axis, degrees, of }) => {
                let axis = axis
                    .get()
                    .try_normalize()
                    .ok_or("the axis of a rotation must not have length zero")?;
                let turn = whitstone_core::transform_steps::rotation(axis, degrees.get());
                // The columns of a rotation are the rows of its inverse.
                Self::Turned {
                    back: [turn.x_axis, turn.y_axis, turn.z_axis],
                    of: one(of, copies)?,
                }
            }
            Node::Scale(Scale { by, of }) => Self::Scaled {
                by: by.get(),
                of: one(of, copies)?,
            },
            Node::Twist(Twist {
                degrees_per_metre,
                of,
            }) => Self::Twisted {
                rate: degrees_per_metre.get().to_radians(),
                of: one(of, copies)?,
            },
            Node::Repeat(repeat) => return Self::repeated(repeat, depth, copies, fields),
        })
    }

    fn list(
        nodes: Vec<Node>,
        name: &str,
        depth: u32,
        copies: u64,
        fields: &mut u64,
    ) -> Result<Vec<Self>, String> {
        if nodes.is_empty() {
            return Err(format!("`{name}` is empty: expected at least one field"));
        }
        nodes
            .into_iter()
            .map(|node| Self::build(node, depth + 1, copies, fields))
            .collect()
    }

    fn repeated(repeat: Repeat, depth: u32, copies: u64, fields: &mut u64) -> Result<Self, String> {
        let (count, period) = (repeat.count.map(IntegerIn::get), repeat.period.map(Positive::get));
        let all = count.iter().map(|n| u64::from(*n)).product::<u64>();
        let of = Box::new(Self::build(*repeat.of, depth + 1, copies * all, fields)?);
        let along = |k: usize, i: u32| (f64::from(i) - 0.5 * f64::from(count[k] - 1)) * period[k];
        let mut offsets = Vec::new();
        for z in 0..count[2] {
            for y in 0..count[1] {
                for x in 0..count[0] {
                    offsets.push(DVec3::new(along(0, x), along(1, y), along(2, z)));
                }
            }
        }
        Ok(Self::Repeated { offsets, of })
    }

    /// The value at a point.
    pub(crate) fn eval<N: Number>(&self, p: Point<N>) -> N {
        let all = |of: &[Self], join: &dyn Fn(N, N) -> N| {
            let mut values = of.iter().map(|field| field.eval(p));
            let first = values.next().unwrap_or(N::constant(f64::INFINITY));
            values.fold(first, join)
        };
        match self {
            Self::Sphere { radius } => length(&p).plus(-radius),
            Self::Box { half } => {
                let q: Point<N> = std::array::from_fn(|k| p[k].magnitude().plus(-half[k]));
                let outside = length(&q.map(|c| c.greatest(N::constant(0.0))));
                outside + q[0].greatest(q[1]).greatest(q[2]).least(N::constant(0.0))
            }
            Self::Torus { major, minor } => {
                let from_ring = length(&p[..2]).plus(-major);
                length(&[from_ring, p[2]]).plus(-minor)
            }
            Self::Capsule {
                a,
                along,
                per_along,
                radius,
            } => {
                let q = shift(p, *a);
                let h = dot(&q, *per_along)
                    .greatest(N::constant(0.0))
                    .least(N::constant(1.0));
                let off: Point<N> = std::array::from_fn(|k| q[k] - h.times(along[k]));
                length(&off).plus(-radius)
            }
            Self::Plane { normal, offset } => dot(&p, *normal).plus(-offset),
            Self::Metaballs { balls, threshold } => {
                let mut sum = N::constant(0.0);
                for (center, per_square, strength) in balls {
                    let q = shift(p, *center);
                    let squared = q[0].square() + q[1].square() + q[2].square();
                    let inside = (-squared.times(*per_square)).plus(1.0).greatest(N::constant(0.0));
                    sum = sum + inside.square().times(*strength);
                }
                (-sum).plus(*threshold)
            }
            Self::Union { k, of } if *k > 0.0 => all(of, &|a, b| {
                let near = (-(a - b).magnitude()).plus(*k).greatest(N::constant(0.0));
                a.least(b) - near.square().times(0.25 / k)
            }),
            Self::Union { of, .. } => all(of, &N::least),
            Self::Intersection { of } => all(of, &N::greatest),
            Self::Difference { of } => match of.split_first() {
                Some((first, others)) if !others.is_empty() => {
                    first.eval(p).greatest(-all(others, &N::least))
                }
                _ => all(of, &N::least),
            },
            Self::Moved { by, of } => of.eval(shift(p, *by)),
            Self::Turned { back, of } => of.eval(back.map(|row| dot(&p, row))),
            Self::Scaled { by, of } => of.eval(p.map(|c| c.times(1.0 / by))).times(*by),
            Self::Twisted { rate, of } => {
                let (sine, cosine) = p[2].times(*rate).sine_cosine();
                // The inverse rotation, clockwise.
                of.eval([p[0] * cosine + p[1] * sine, p[1] * cosine - p[0] * sine, p[2]])
            }
            Self::Repeated { offsets, of } => {
                let values = offsets.iter().map(|offset| of.eval(shift(p, *offset)));
                values.reduce(N::least).unwrap_or(N::constant(f64::INFINITY))
            }
        }
    }

    /// A box that contains all points where the field is below `value`; infinite along unbounded
    /// axes.
    pub(crate) fn bounds_below(&self, value: f64) -> Point<Enclosure> {
        const NONE: Enclosure = Enclosure::new(f64::INFINITY, f64::NEG_INFINITY);
        const ALL: Enclosure = Enclosure::new(f64::NEG_INFINITY, f64::INFINITY);
        let around = |x: f64, y: f64, z: f64| [x, y, z].map(|r| Enclosure::new(-r, r));
        let zip = |a: Point<Enclosure>,
                   b: Point<Enclosure>,
                   join: fn(Enclosure, Enclosure) -> Enclosure|
         -> Point<Enclosure> { std::array::from_fn(|k| join(a[k], b[k])) };
        // An empty range stays empty when it is translated.
        let moved = |a: Point<Enclosure>, by: DVec3| -> Point<Enclosure> {
            std::array::from_fn(|k| Enclosure::new(a[k].lo + by[k], a[k].hi + by[k]))
        };
        let empty = |a: &Point<Enclosure>| a.iter().any(|range| range.lo > range.hi);
        match self {
            Self::Sphere { radius } => around(radius + value, radius + value, radius + value),
            Self::Box { half: [x, y, z] } => around(x + value, y + value, z + value),
            Self::Torus { major, minor } => {
                let tube = minor + value;
                around(major + tube, major + tube, tube)
            }
            Self::Capsule { a, along, radius, .. } => {
                let (a, b, r) = (*a, *a + *along, radius + value);
                std::array::from_fn(|k| Enclosure::new(a[k].min(b[k]) - r, a[k].max(b[k]) + r))
            }
            Self::Plane { .. } => [ALL; 3],
            Self::Metaballs { balls, threshold } => {
                if value >= *threshold {
                    return [ALL; 3];
                }
                let positive = balls.iter().filter(|(_, _, strength)| *strength > 0.0);
                positive.fold([NONE; 3], |all, (center, per_square, _)| {
                    let radius = per_square.sqrt().recip();
                    zip(
                        all,
                        moved(around(radius, radius, radius), *center),
                        Enclosure::union,
                    )
                })
            }
            Self::Union { k, of } => {
                // Each blend adds at most a quarter of its width.
                let value = value + 0.25 * k * (of.len() - 1) as f64;
                let boxes = of
                    .iter()
                    .map(|field| field.bounds_below(value))
                    .filter(|found| !empty(found));
                boxes.fold([NONE; 3], |all, found| zip(all, found, Enclosure::union))
            }
            Self::Intersection { of } => {
                let boxes = of.iter().map(|field| field.bounds_below(value));
                boxes.fold([ALL; 3], |all, found| zip(all, found, Enclosure::intersection))
            }
            Self::Difference { of } => of.first().map_or([NONE; 3], |first| first.bounds_below(value)),
            Self::Moved { by, of } => moved(of.bounds_below(value), *by),
            Self::Turned { back, of } => {
                let inner = of.bounds_below(value);
                if empty(&inner) {
                    return inner;
                }
                if inner.iter().any(|range| range.reach() == f64::INFINITY) {
                    return [ALL; 3];
                }
                // Rows of the inverse are columns of the rotation.
                std::array::from_fn(|k| {
                    let terms = [0, 1, 2].map(|i| inner[i].times(back[i][k]));
                    terms[0] + terms[1] + terms[2]
                })
            }
            Self::Scaled { by, of } => {
                let inner = of.bounds_below(value / by);
                inner.map(|range| Enclosure::new(by * range.lo, by * range.hi))
            }
            Self::Twisted { of, .. } => {
                let inner = of.bounds_below(value);
                if empty(&inner) {
                    return inner;
                }
                let radius = libm::hypot(inner[0].reach(), inner[1].reach());
                let [x, y, _] = around(radius, radius, 0.0);
                [x, y, inner[2]]
            }
            Self::Repeated { offsets, of } => {
                let inner = of.bounds_below(value);
                offsets.iter().fold([NONE; 3], |all, offset| {
                    zip(all, moved(inner, *offset), Enclosure::union)
                })
            }
        }
    }

    /// Number of turns by which the field is twisted inside a box, of all its twists together.
    pub(crate) fn turns(&self, region: Point<Enclosure>) -> f64 {
        match self {
            Self::Sphere { .. }
            | Self::Box { .. }
            | Self::Torus { .. }
            | Self::Capsule { .. }
            | Self::Plane { .. }
            | Self::Metaballs { .. } => 0.0,
            Self::Union { of, .. } | Self::Intersection { of } | Self::Difference { of } => {
                of.iter().map(|field| field.turns(region)).sum()
            }
            Self::Moved { by, of } => of.turns(shift(region, *by)),
            Self::Turned { back, of } => of.turns(back.map(|row| dot(&region, row))),
            Self::Scaled { by, of } => of.turns(region.map(|range| range.times(1.0 / by))),
            Self::Twisted { rate, of } => {
                let radius = libm::hypot(region[0].reach(), region[1].reach());
                let round = Enclosure::new(-radius, radius);
                let height = region[2].hi - region[2].lo;
                let own = rate.abs() * height / std::f64::consts::TAU;
                own + of.turns([round, round, region[2]])
            }
            Self::Repeated { offsets, of } => {
                let all = offsets.iter().map(|offset| of.turns(shift(region, *offset)));
                all.fold(0.0, f64::max)
            }
        }
    }

    /// Lipschitz bound per metre inside a box.
    pub(crate) fn steepest(&self, region: Point<Enclosure>) -> f64 {
        let all = |of: &[Self]| of.iter().map(|field| field.steepest(region)).fold(0.0, f64::max);
        match self {
            Self::Sphere { .. }
            | Self::Box { .. }
            | Self::Torus { .. }
            | Self::Capsule { .. }
            | Self::Plane { .. } => 1.0,
            Self::Metaballs { balls, .. } => {
                let slopes = balls
                    .iter()
                    .map(|(_, per_square, strength)| strength.abs() * per_square.sqrt());
                KERNEL_SLOPE * slopes.sum::<f64>()
            }
            // A blend interpolates between two slopes.
            Self::Union { of, .. } | Self::Intersection { of } | Self::Difference { of } => all(of),
            Self::Moved { by, of } => of.steepest(shift(region, *by)),
            Self::Turned { back, of } => of.steepest(back.map(|row| dot(&region, row))),
            Self::Scaled { by, of } => of.steepest(region.map(|range| range.times(1.0 / by))),
            Self::Twisted { rate, of } => {
                let radius = libm::hypot(region[0].reach(), region[1].reach());
                let round = Enclosure::new(-radius, radius);
                // The largest singular value of the shear that approximates a twist near a point.
                let shear = rate.abs() * radius;
                0.5 * (shear + (shear * shear + 4.0).sqrt()) * of.steepest([round, round, region[2]])
            }
            Self::Repeated { offsets, of } => {
                let regions = offsets.iter().map(|offset| of.steepest(shift(region, *offset)));
                regions.fold(0.0, f64::max)
            }
        }
    }
}
