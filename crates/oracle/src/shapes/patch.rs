//! Bicubic Bézier patches.
//!
//! A line is the intersection of two planes, so it meets the patch where two bicubic functions are
//! zero at once. A piece of the patch holds no root if all control values of one function, or of a
//! combination of both, have the same sign. Otherwise the functions are combined to approximate the
//! parameters themselves. If each combination has opposite signs on opposite sides (Miranda's
//! theorem), the piece holds exactly one root. Other pieces are split in two. Krawczyk's operator
//! encloses the root (Moore, Kearfott, Cloud, *Introduction to Interval Analysis*, 2009, 8.2 and
//! 8.3).

use super::Surface;
use crate::interval::{Decided, Interval, Undecided};
use crate::root::{Root, Roots};
use crate::vector::{Line, Vector};
use serde::Deserialize;
use std::cmp::Ordering;
use whitstone_core::{DVec3, SceneError, SceneErrors};

/// Where pieces are split: not where control points are often hit.
const CUT: f64 = 0.4853515625;

/// Number of pieces of one patch to examine before giving up. A line that passes an edge or touches
/// the patch would need infinitely many.
const MAX_PIECES: usize = 600;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Patches {
    points: Option<Vec<[f64; 3]>>,
    vertices: Option<Vec<[f64; 3]>>,
    patches: Option<Vec<Vec<usize>>>,
}

/// Control points, sixteen per patch.
pub(crate) struct Nets(pub(crate) Vec<[[f64; 3]; 16]>);

impl Patches {
    pub(crate) fn read(self) -> Result<Nets, SceneErrors> {
        let malformed = || SceneErrors::from(SceneError::anywhere("malformed patches"));
        let sixteen = |points: Vec<[f64; 3]>| points.try_into().map_err(|_| malformed());
        let (vertices, patches) = (
            self.vertices.unwrap_or_default(),
            self.patches.unwrap_or_default(),
        );
        let numbered = patches.iter().map(|patch| {
            let points = patch.iter().map(|number| vertices.get(*number).copied());
            sixteen(points.collect::<Option<_>>().ok_or_else(malformed)?)
        });
        let nets: Result<Vec<_>, _> = self.points.map(sixteen).into_iter().chain(numbered).collect();
        Ok(Nets(nets?))
    }
}

impl Surface for Nets {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        let mut all = Vec::new();
        for (points, number) in self.0.iter().zip(0..) {
            all.extend(meet(points, number, line)?);
        }
        Ok(Roots::new(all))
    }
}

fn meet(points: &[[f64; 3]; 16], number: u32, line: &Line) -> Decided<Vec<Root>> {
    let points: Vec<Vector> = points.iter().map(|point| line.point(*point)).collect();
    // Two vectors perpendicular to the line, built from its largest component: their products with
    // the direction are exactly zero.
    let d = line.direction.nearest().abs();
    let axis = d.max_position();
    let across = [1, 2].map(|k| {
        let mut normal = line.point([0.0; 3]);
        normal.0[(axis + k) % 3] = line.direction.0[axis].clone();
        normal.0[axis] = -&line.direction.0[(axis + k) % 3];
        normal
    });
    let seen = across.map(|normal| Net::new(|k| normal.dot(&points[k].minus(&line.origin))));
    let unit = [line.number(0.0), line.number(1.0)];
    let mut waiting = vec![Piece {
        seen,
        u: unit.clone(),
        v: unit,
    }];
    let surface = [0, 1, 2].map(|axis| Net::new(|k| points[k].0[axis].clone()));
    let mut roots = Vec::new();
    for _ in 0..MAX_PIECES {
        let Some(piece) = waiting.pop() else {
            return Ok(roots);
        };
        match piece.look() {
            Look::Nothing => {}
            Look::One(straight) => {
                let [u, v] = straight.refine()?;
                roots.push(root(&surface, &u, &v, number, line)?);
            }
            Look::Cut => waiting.extend(piece.cut()),
        }
    }
    Err(Undecided)
}

/// The point on the line at these parameters.
fn root(surface: &[Net; 3], u: &Interval, v: &Interval, number: u32, line: &Line) -> Decided<Root> {
    let at = |along: Option<Way>| {
        Vector([0, 1, 2].map(|axis| match along {
            None => surface[axis].at(u, v),
            Some(way) => surface[axis].derivative_at(way, u, v),
        }))
    };
    let d = &line.direction;
    let t = at(None).minus(&line.origin).dot(d).over(&d.dot(d))?;
    let normal = at(Some(Way::U)).cross(&at(Some(Way::V)));
    // Weighted by the control points.
    let weighted = [0, 1, 2].map(|axis| surface[axis].map(Interval::abs).at(u, v).nearest());
    let n = normal.nearest();
    let root = Root::new(
        t,
        number,
        &normal.dot(d),
        n,
        n.abs().dot(DVec3::from_array(weighted)),
    )?;
    Ok(Root {
        parameters: Some([u.nearest(), v.nearest()]),
        ..root
    })
}

/// A parameter direction of the patch.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Way {
    U,
    V,
}

/// Control values of a bicubic function; each row runs along u, the rows follow each other along v.
#[derive(Clone)]
struct Net(Vec<Interval>);

/// A Bernstein polynomial at a point or over an interval, by de Casteljau's algorithm.
fn casteljau(mut row: Vec<Interval>, t: &Interval) -> Interval {
    while row.len() > 1 {
        row = row
            .windows(2)
            .map(|pair| &pair[0] + (&pair[1] - &pair[0]) * t)
            .collect();
    }
    row.remove(0)
}

impl Net {
    fn new(value: impl Fn(usize) -> Interval) -> Self {
        Self((0..16).map(value).collect())
    }

    fn map(&self, f: impl Fn(&Interval) -> Interval) -> Self {
        Self(self.0.iter().map(f).collect())
    }

    /// The four rows of four control values along a direction, by their index in the net.
    fn rows(&self, way: Way) -> [[usize; 4]; 4] {
        let step = |row: usize, k: usize| match way {
            Way::U => 4 * row + k,
            Way::V => 4 * k + row,
        };
        [0, 1, 2, 3].map(|row| [0, 1, 2, 3].map(|k| step(row, k)))
    }

    fn at(&self, u: &Interval, v: &Interval) -> Interval {
        let rows = self.0.chunks(4).map(|row| casteljau(row.to_vec(), u));
        casteljau(rows.collect(), v)
    }

    fn derivative_at(&self, way: Way, u: &Interval, v: &Interval) -> Interval {
        let (along, across) = if way == Way::U { (u, v) } else { (v, u) };
        let rows = self.rows(way).map(|row| casteljau(self.differences(row), along));
        casteljau(rows.to_vec(), across)
    }

    fn differences(&self, row: [usize; 4]) -> Vec<Interval> {
        let three = self.0[0].like(3.0);
        row.windows(2)
            .map(|pair| (&self.0[pair[1]] - &self.0[pair[0]]) * &three)
            .collect()
    }

    /// Encloses the derivative over the net.
    fn slope(&self, way: Way) -> Interval {
        let differences = self.rows(way).into_iter().flat_map(|row| self.differences(row));
        differences.reduce(|a, b| a.hull(&b)).expect("a net has rows")
    }

    /// The common sign of all values, if they have one.
    fn sign(values: impl IntoIterator<Item = Interval>) -> Option<Ordering> {
        let mut signs = values
            .into_iter()
            .map(|value| value.sign().ok().filter(|sign| sign.is_ne()));
        let first = signs.next()??;
        signs.all(|sign| sign == Some(first)).then_some(first)
    }

    /// The values on one side of the square: at the low or the high end of a direction.
    fn side(&self, way: Way, high: bool) -> impl Iterator<Item = Interval> {
        let rows = self.rows(way);
        rows.map(|row| self.0[row[if high { 3 } else { 0 }]].clone())
            .into_iter()
    }

    /// Splits the net in two by de Casteljau's algorithm.
    fn cut(&self, way: Way, at: &Interval) -> [Self; 2] {
        let (mut low, mut high) = (self.clone(), self.clone());
        for places in self.rows(way) {
            let mut row: Vec<Interval> = places.iter().map(|place| self.0[*place].clone()).collect();
            for k in 0..4 {
                low.0[places[k]] = row[0].clone();
                high.0[places[3 - k]] = row[row.len() - 1].clone();
                row = row
                    .windows(2)
                    .map(|pair| &pair[0] + (&pair[1] - &pair[0]) * at)
                    .collect();
            }
        }
        [low, high]
    }
}

/// A piece of a patch: two functions of two parameters in [0, 1], and the range of the patch
/// parameters that these cover.
struct Piece {
    seen: [Net; 2],
    u: [Interval; 2],
    v: [Interval; 2],
}

/// The point at the fraction `at` between both.
fn between([from, to]: &[Interval; 2], at: &Interval) -> Interval {
    from + (to - from) * at
}

enum Look {
    Nothing,
    /// Exactly one root; the piece holds the combined functions.
    One(Box<Piece>),
    Cut,
}

/// The matrix that combines both functions.
type Combination = [[Interval; 2]; 2];

impl Piece {
    fn look(&self) -> Look {
        if self
            .seen
            .iter()
            .any(|net| Net::sign(net.0.iter().cloned()).is_some())
        {
            return Look::Nothing;
        }
        let slopes = self.slopes();
        let Some(inverse) = inverse(&slopes) else {
            return Look::Cut;
        };
        let straight = inverse.clone().map(|[a, b]| {
            let [f, g] = &self.seen;
            Net::new(|k| &f.0[k] * &a + &g.0[k] * &b)
        });
        if straight
            .iter()
            .any(|net| Net::sign(net.0.iter().cloned()).is_some())
        {
            return Look::Nothing;
        }
        let ways = [Way::U, Way::V];
        let crossed = (0..2).all(|k| {
            let side = |high| Net::sign(straight[k].side(ways[k], high));
            matches!((side(false), side(true)), (Some(low), Some(high)) if low != high)
        });
        // Nearly equal to the parameters themselves, so that each step contracts fourfold.
        let quarter = slopes[0][0].like(0.25);
        let straightened = (0..2).all(|k| {
            let own = straight[k].slope(ways[k]) - quarter.like(1.0);
            let off = own.abs() + straight[k].slope(ways[1 - k]).abs();
            off.to().compare(&quarter) == Ok(Ordering::Less)
        });
        if !(crossed && straightened) {
            return Look::Cut;
        }
        Look::One(Box::new(Self {
            seen: straight,
            u: self.u.clone(),
            v: self.v.clone(),
        }))
    }

    /// Encloses the derivatives of both functions by both parameters over the piece.
    fn slopes(&self) -> Combination {
        [0, 1].map(|k| [self.seen[k].slope(Way::U), self.seen[k].slope(Way::V)])
    }

    /// Splits the piece in two across its longer direction.
    fn cut(&self) -> [Self; 2] {
        let length = |[from, to]: &[Interval; 2]| to - from;
        let longer_v = length(&self.u).compare(&length(&self.v)) == Ok(Ordering::Less);
        self.cut_at(if longer_v { Way::V } else { Way::U }, &self.u[0].like(CUT))
    }

    fn cut_at(&self, way: Way, at: &Interval) -> [Self; 2] {
        let [[f0, f1], [g0, g1]] = [0, 1].map(|k| self.seen[k].cut(way, at));
        let parts = |whole: &[Interval; 2]| {
            let middle = between(whole, at);
            [[whole[0].clone(), middle.clone()], [middle, whole[1].clone()]]
        };
        let ([u0, u1], [v0, v1]) = match way {
            Way::U => (parts(&self.u), [self.v.clone(), self.v.clone()]),
            Way::V => ([self.u.clone(), self.u.clone()], parts(&self.v)),
        };
        let piece = |f, g, u, v| Self { seen: [f, g], u, v };
        [piece(f0, g0, u0, v0), piece(f1, g1, u1, v1)]
    }

    /// The part between two parameters along a direction; `to` must not be 0.
    fn part(&self, way: Way, from: &Interval, to: &Interval) -> Decided<Self> {
        let [low, _] = self.cut_at(way, to);
        let [_, part] = low.cut_at(way, &from.over(to)?);
        Ok(part)
    }

    /// The patch parameters of the only root.
    fn refine(mut self) -> Decided<[Interval; 2]> {
        let zero = self.u[0].like(0.0);
        let unit = zero.hull(&zero.like(1.0));
        let half = zero.like(0.5);
        loop {
            let slopes = self.slopes();
            let inverse = inverse(&slopes).ok_or(Undecided)?;
            let values = [0, 1].map(|k| self.seen[k].at(&half, &half));
            let mut at = [unit.clone(), unit.clone()];
            for k in 0..2 {
                let [a, b] = &inverse[k];
                // Krawczyk's operator: m - Y f(m) + (1 - Y F'(X)) (X - m).
                let mut next = &half - (a * &values[0] + b * &values[1]);
                for j in 0..2 {
                    let same = zero.like(f64::from(u8::from(j == k)));
                    next = next + (same - (a * &slopes[0][j] + b * &slopes[1][j])) * (&unit - &half);
                }
                at[k] = unit.common(&next).ok_or(Undecided)?;
            }
            // A step that keeps three quarters of the width has reached the limit of this
            // precision.
            let stuck = |at: &Interval| at.width().compare(&zero.like(0.75)) != Ok(Ordering::Less);
            if at.iter().all(stuck) {
                return Ok([&self.u, &self.v].map(|[from, to]| from.hull(to)));
            }
            for (way, at) in [Way::U, Way::V].into_iter().zip(&at) {
                self = self.part(way, &at.from(), &at.to())?;
            }
        }
    }
}

/// The inverse of the midpoint of an interval matrix, in doubles. Any matrix is valid; a good one
/// gives narrow bounds.
fn inverse(matrix: &Combination) -> Option<Combination> {
    let [[a, b], [c, d]] = [0, 1].map(|i| [0, 1].map(|j| matrix[i][j].nearest()));
    let determinant = a * d - b * c;
    let entries = [[d, -b], [-c, a]].map(|row| row.map(|x| x / determinant));
    let good = entries.iter().flatten().all(|x| x.is_finite());
    good.then(|| entries.map(|row| row.map(|x| matrix[0][0].like(x))))
}
