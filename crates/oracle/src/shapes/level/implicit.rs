//! Trees of implicit fields.

use super::jet::Jet;
use super::number::Number;
use super::{Level, LevelSet};
use serde::Deserialize;
use whitstone_core::DVec3;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Implicit {
    field: Field,
    bounds: Option<Bounds>,
    #[serde(rename = "lipschitz")]
    _lipschitz: Option<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Bounds {
    min: [f64; 3],
    max: [f64; 3],
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum Field {
    Sphere {
        #[serde(default = "one")]
        radius: f64,
    },
    Box {
        #[serde(default = "ones")]
        half: [f64; 3],
    },
    Torus {
        #[serde(default = "one")]
        major: f64,
        #[serde(default = "quarter")]
        minor: f64,
    },
    Capsule {
        a: [f64; 3],
        b: [f64; 3],
        #[serde(default = "quarter")]
        radius: f64,
    },
    Plane {
        normal: [f64; 3],
        #[serde(default)]
        offset: f64,
    },
    Metaballs {
        balls: Vec<Ball>,
        #[serde(default = "half")]
        threshold: f64,
    },
    Union(Vec<Field>),
    Intersection(Vec<Field>),
    Difference(Vec<Field>),
    SmoothUnion {
        k: f64,
        of: Vec<Field>,
    },
    Translate {
        by: [f64; 3],
        of: Box<Field>,
    },
    Rotate {
        axis: [f64; 3],
        degrees: f64,
        of: Box<Field>,
    },
    Scale {
        by: f64,
        of: Box<Field>,
    },
    Twist {
        degrees_per_metre: f64,
        of: Box<Field>,
    },
    Repeat {
        period: [f64; 3],
        count: [u32; 3],
        of: Box<Field>,
    },
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Ball {
    center: [f64; 3],
    radius: f64,
    #[serde(default = "one")]
    strength: f64,
}

fn one() -> f64 {
    1.0
}

fn ones() -> [f64; 3] {
    [1.0; 3]
}

fn quarter() -> f64 {
    0.25
}

fn half() -> f64 {
    0.5
}

type Place<N> = [Jet<N>; 3];

fn minus<N: Number>(a: &Place<N>, b: &Place<N>) -> Place<N> {
    std::array::from_fn(|axis| a[axis].minus(&b[axis]))
}

fn constants<N: Number>(p: &Place<N>, v: [f64; 3]) -> Place<N> {
    v.map(|x| p[0].constant(x))
}

/// A unit vector; `v` must not be zero.
fn normalized<N: Number>(v: &Place<N>) -> Place<N> {
    let length = Jet::length(v);
    v.each_ref().map(|x| x.over(&length).unwrap_or_else(|| x.clone()))
}

fn least<N: Number>(all: impl Iterator<Item = Jet<N>>) -> Jet<N> {
    all.reduce(|a, b| a.min(&b)).expect("there is at least one")
}

impl Field {
    fn at<N: Number>(&self, p: &Place<N>) -> Jet<N> {
        let constant = |x: f64| p[0].constant(x);
        let zero = p[0].number(0.0);
        match self {
            Self::Sphere { radius } => Jet::length(p).minus(&constant(*radius)),
            Self::Box { half } => {
                let q: Place<N> = std::array::from_fn(|axis| p[axis].abs().minus(&constant(half[axis])));
                let largest = q[0].max(&q[1]).max(&q[2]);
                let outside = q
                    .iter()
                    .filter(|x| x.value.is_above() || x.value.has_zero())
                    .count();
                if outside < 2 {
                    // The signed distance from a face.
                    return largest;
                }
                let beyond = q.each_ref().map(|x| x.max(&zero));
                Jet::length(&beyond).plus(&largest.min(&zero))
            }
            Self::Torus { major, minor } => {
                let level = p[0]
                    .squared()
                    .plus(&p[1].squared())
                    .root()
                    .minus(&constant(*major));
                let square = level.squared().plus(&p[2].squared());
                square.root().minus(&constant(*minor))
            }
            Self::Capsule { a, b, radius } => {
                let [a, b] = [*a, *b].map(|v| constants(p, v));
                let (way, to) = (minus(&b, &a), minus(p, &a));
                let part = Jet::dot(&to, &way).over(&Jet::dot(&way, &way));
                let part = part.unwrap_or_else(|| zero.clone()).clamped();
                let rest = std::array::from_fn(|axis| to[axis].minus(&way[axis].times(&part)));
                Jet::length(&rest).minus(&constant(*radius))
            }
            Self::Plane { normal, offset } => {
                let n = normalized(&constants(p, *normal));
                Jet::dot(&n, p).minus(&constant(*offset))
            }
            Self::Metaballs { balls, threshold } => balls.iter().fold(constant(*threshold), |sum, ball| {
                let to = minus(p, &constants(p, ball.center));
                let square = Jet::dot(&to, &to);
                let part = square.over(&constant(ball.radius).squared()).unwrap_or(square);
                let left = p[0].number(1.0).minus(&part).max(&zero);
                sum.minus(&left.squared().times(&constant(ball.strength)))
            }),
            Self::Union(fields) => least(fields.iter().map(|field| field.at(p))),
            Self::Intersection(fields) => least(fields.iter().map(|field| field.at(p).negated())).negated(),
            Self::Difference(fields) => {
                let each = fields.iter().enumerate().map(|(number, field)| match number {
                    0 => field.at(p).negated(),
                    _ => field.at(p),
                });
                least(each).negated()
            }
            Self::SmoothUnion { k, of } => {
                let k = constant(*k);
                let all = of.iter().map(|field| field.at(p));
                let two = |a: Jet<N>, b: Jet<N>| {
                    let near = k.minus(&a.minus(&b).abs()).max(&zero);
                    let h = near.over(&k).unwrap_or(near);
                    let round = h.squared().times(&k).times(&p[0].number(0.25));
                    a.min(&b).minus(&round)
                };
                all.reduce(two).expect("there is at least one")
            }
            Self::Translate { by, of } => of.at(&minus(p, &constants(p, *by))),
            Self::Rotate { axis, degrees, of } => {
                let n = normalized(&constants(p, *axis));
                let [cos, sin] = constant(-degrees).turn();
                let along = Jet::dot(&n, p).times(&p[0].number(1.0).minus(&cos));
                let turned = std::array::from_fn(|a| {
                    let [b, c] = [(a + 1) % 3, (a + 2) % 3];
                    let across = n[b].times(&p[c]).minus(&n[c].times(&p[b]));
                    p[a].times(&cos)
                        .plus(&across.times(&sin))
                        .plus(&n[a].times(&along))
                });
                of.at(&turned)
            }
            Self::Scale { by, of } => {
                let by = constant(*by);
                let inside = p.each_ref().map(|x| x.over(&by).unwrap_or_else(|| x.clone()));
                of.at(&inside).times(&by)
            }
            Self::Twist {
                degrees_per_metre,
                of,
            } => {
                let [cos, sin] = p[2].times(&constant(-degrees_per_metre)).turn();
                let [x, y, z] = p;
                of.at(&[
                    x.times(&cos).minus(&y.times(&sin)),
                    x.times(&sin).plus(&y.times(&cos)),
                    z.clone(),
                ])
            }
            Self::Repeat { period, count, of } => {
                let [nx, ny, nz] = *count;
                let copies = (0..nx).flat_map(|i| (0..ny).flat_map(move |j| (0..nz).map(move |k| [i, j, k])));
                least(copies.map(|copy| {
                    let moved = std::array::from_fn(|axis| {
                        let steps = f64::from(copy[axis]) - 0.5 * f64::from(count[axis] - 1);
                        p[axis].minus(&p[axis].number(steps).times(&constant(period[axis])))
                    });
                    of.at(&moved)
                }))
            }
        }
    }
}

impl Field {
    /// A radius around the origin beyond which the field is greater than `e` >= 0; infinite if none
    /// is known.
    fn reach(&self, e: f64) -> f64 {
        let far = |v: [f64; 3]| DVec3::from_array(v).length();
        let most = |fields: &[Self], e: f64| fields.iter().map(|field| field.reach(e)).fold(0.0, f64::max);
        match self {
            Self::Sphere { radius } => radius + e,
            Self::Box { half } => far(*half) + e,
            Self::Torus { major, minor } => major + minor + e,
            Self::Capsule { a, b, radius } => far(*a).max(far(*b)) + radius + e,
            Self::Plane { .. } => f64::INFINITY,
            Self::Metaballs { balls, threshold } if *threshold > e => {
                let each = balls.iter().map(|ball| far(ball.center) + ball.radius);
                each.fold(0.0, f64::max)
            }
            Self::Metaballs { .. } => f64::INFINITY,
            Self::Union(fields) => most(fields, e),
            Self::Intersection(fields) => fields
                .iter()
                .map(|field| field.reach(e))
                .fold(f64::INFINITY, f64::min),
            Self::Difference(fields) => fields[0].reach(e),
            // Each smooth joint lowers the field by at most k/4.
            Self::SmoothUnion { k, of } => most(of, e + 0.25 * k * (of.len() - 1) as f64),
            Self::Translate { by, of } => far(*by) + of.reach(e),
            Self::Rotate { of, .. } | Self::Twist { of, .. } => of.reach(e),
            Self::Scale { by, of } => by * of.reach(e / by),
            Self::Repeat { period, count, of } => {
                let last = [0, 1, 2].map(|axis| 0.5 * period[axis] * f64::from(count[axis] - 1));
                far(last) + of.reach(e)
            }
        }
    }
}

impl Implicit {
    pub(crate) fn shape(self) -> LevelSet<Self> {
        LevelSet(self)
    }
}

impl Level for Implicit {
    fn at<N: Number>(&self, p: &[Jet<N>; 3]) -> Jet<N> {
        self.field.at(p)
    }

    fn bounds(&self) -> (Option<[DVec3; 2]>, Option<f64>) {
        let corners = self.bounds.as_ref().map(|bounds| [bounds.min, bounds.max]);
        let corners = corners.map(|corners| corners.map(DVec3::from_array));
        let reach = self.field.reach(0.0);
        (corners, reach.is_finite().then_some(reach))
    }
}
