//! Level sets: the boundary of the region where a function is negative.
//!
//! Along a line the function depends on the ray parameter only. An interval of it is finished if
//! the function certainly has no zero in it. It is also finished if the function is certainly
//! monotonic in it, because the signs at both ends then tell whether there is one root or none. All
//! other intervals are bisected (Moore, Kearfott, Cloud 2009, ch. 8; Snyder 1992, *Interval
//! analysis for computer graphics*). Doubles with outward rounding decide most intervals. Arbitrary
//! precision is used only for the rest, and to narrow the roots.

pub(crate) mod fractal;
pub(crate) mod implicit;
pub(crate) mod isosurface;
mod jet;
mod number;

use super::Surface;
use crate::interval::{Decided, Interval, Undecided};
use crate::root::{Root, Roots};
use crate::vector::Line;
pub(crate) use jet::Jet;
use number::Fast;
pub(crate) use number::Number;
use std::cmp::Ordering;
use std::ops::ControlFlow;
use whitstone_core::DVec3;

/// Where intervals are split: not in the middle, where symmetric shapes are often hit.
const CUT: f64 = 0.487_3;
/// An undecided interval of doubles of this length, relative to its distance along the line, is
/// repeated in arbitrary precision.
const FAST: f64 = 1e-9;
/// The same limit for arbitrary precision: below it, the line touches the surface.
const LEAST: f64 = 1e-25;
/// Maximum number of intervals of a line that are examined in doubles, and in arbitrary precision.
/// Where the function is almost 0 along the whole line, for example in a plateau at the iso value,
/// neither intervals nor slopes decide, however short they are. The line then has no answer.
const MOST: [u32; 2] = [1 << 17, 1 << 9];

/// A function that is negative inside.
pub(crate) trait Level: Send + Sync {
    /// Value and derivative at a point.
    fn at<N: Number>(&self, p: &[Jet<N>; 3]) -> Jet<N>;

    /// The box that clips the surface, if any; and a radius around the origin beyond which the
    /// function is positive, if known.
    fn bounds(&self) -> (Option<[DVec3; 2]>, Option<f64>);
}

/// A level function as a shape.
pub(crate) struct LevelSet<L>(pub(crate) L);

impl<L: Level> LevelSet<L> {
    /// A radius around the origin that contains the whole surface, if known.
    pub(crate) fn reach(&self) -> Option<f64> {
        let (bounds, radius) = self.0.bounds();
        let boxed = bounds.map(|[min, max]| min.abs().max(max.abs()).length());
        boxed.into_iter().chain(radius).reduce(f64::min)
    }

    /// The function at parameter `t` of the line; `t` may be an interval.
    fn along<N: Number>(&self, [origin, direction]: [&[N; 3]; 2], t: &N) -> Jet<N> {
        let t = Jet::variable(t.clone());
        let p = [0, 1, 2].map(|axis| {
            let start = Jet::exact(origin[axis].clone());
            start.plus(&t.times(&Jet::exact(direction[axis].clone())))
        });
        self.0.at(&p)
    }

    /// Visits the intervals between two parameters with one root each, in ascending order, until
    /// `visit` breaks.
    fn isolate(
        &self,
        line: &Line,
        from: f64,
        to: f64,
        mut visit: impl FnMut([f64; 2]) -> Decided<ControlFlow<()>>,
    ) -> Decided<()> {
        let fast = [&line.origin, &line.direction].map(|v| v.0.each_ref().map(Fast::of));
        let exact = [&line.origin.0, &line.direction.0];
        let mut left = MOST;
        let mut stack = vec![[from, to]];
        while let Some([a, b]) = stack.pop() {
            let (doubles, digits) = (
                |t: &Fast| self.along([&fast[0], &fast[1]], t),
                |t: &Interval| self.along(exact, t),
            );
            let size = a.abs().max(b.abs());
            left[0] = left[0].checked_sub(1).ok_or(Undecided)?;
            let mut look = look(&doubles, [a, b], |t| Fast::new(t, t));
            if look == Look::Cut && b - a <= FAST * size {
                left[1] = left[1].checked_sub(1).ok_or(Undecided)?;
                look = self::look(&digits, [a, b], |t| line.number(t));
                if look == Look::Cut && b - a <= LEAST.max(4.0 * f64::EPSILON * size) {
                    return Err(Undecided);
                }
            }
            match look {
                Look::None => {}
                Look::One => {
                    if visit([a, b])?.is_break() {
                        break;
                    }
                }
                Look::Cut => {
                    let middle = a + (b - a) * CUT;
                    if middle <= a || middle >= b {
                        return Err(Undecided);
                    }
                    stack.extend([[middle, b], [a, middle]]);
                }
            }
        }
        Ok(())
    }

    /// Narrows the only root between two parameters by the interval Newton method.
    fn narrow(&self, line: &Line, [a, b]: [f64; 2]) -> Decided<(Interval, Ordering)> {
        let at = |t: &Interval| self.along([&line.origin.0, &line.direction.0], t);
        let rising = at(&line.number(b)).value.sign()?;
        let mut t = line.number(a).hull(&line.number(b));
        let steps = 64 + 2 * line.bits();
        for _ in 0..steps {
            if t.is_narrow() {
                break;
            }
            let middle = t.within(CUT);
            let there = at(&middle).value;
            let newton = at(&t).slope.and_then(|slope| there.over(&slope).ok());
            let next = newton.and_then(|step| t.common(&(middle.clone() - step)));
            let halved = |t: &Interval| -> Decided<Interval> {
                Ok(match there.sign()? {
                    Ordering::Equal => middle.clone(),
                    order if order == rising => t.from().hull(&middle),
                    _ => middle.hull(&t.to()),
                })
            };
            t = match next {
                Some(next) if next.width().compare(&(t.width() * line.number(0.5))) == Ok(Ordering::Less) => {
                    next
                }
                _ => halved(&t)?,
            };
        }
        Ok((t, rising))
    }
}

#[derive(PartialEq)]
enum Look {
    None,
    One,
    Cut,
}

/// Bounds the number of roots of a function between two parameters.
fn look<N: Number>(at: &dyn Fn(&N) -> Jet<N>, [a, b]: [f64; 2], number: impl Fn(f64) -> N) -> Look {
    let [first, last] = [a, b].map(&number);
    let whole = first.hull(&last);
    let there = at(&whole);
    if !there.value.has_zero() {
        return Look::None;
    }
    let Some(slope) = there.slope else {
        return Look::Cut;
    };
    if !slope.has_zero() {
        let [p, q] = [first, last].map(|t| at(&t).value);
        return match (p.has_zero(), q.has_zero()) {
            (false, false) if p.is_above() != q.is_above() => Look::One,
            (false, false) => Look::None,
            _ => Look::Cut,
        };
    }
    // The mean value form: the value in the middle, plus the largest possible change from there.
    let middle = number(a + (b - a) * CUT);
    let rest = whole.plus(&middle.negated());
    match at(&middle).value.plus(&slope.times(&rest)).has_zero() {
        true => Look::Cut,
        false => Look::None,
    }
}

impl<L: Level> Surface for LevelSet<L> {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        self.roots(line, None)
    }

    fn meet_beyond(&self, line: &Line, from: f64) -> Decided<Roots> {
        self.roots(line, Some(from))
    }
}

impl<L: Level> LevelSet<L> {
    /// All roots; or, if `first` is given, only the first one that is certainly beyond it.
    fn roots(&self, line: &Line, first: Option<f64>) -> Decided<Roots> {
        let (o, d) = (line.origin.nearest(), line.direction.nearest());
        // A segment of the line that certainly contains every intersection.
        let reach = 1.001 * self.reach().ok_or(Undecided)? + 1e-9 * o.length();
        let middle = -o.dot(d) / d.length_squared();
        let away = (o + middle * d).length();
        if away > reach {
            return Ok(Roots::default());
        }
        let half = 1.01 * reach / d.length();
        let (begin, end) = (middle - half, middle + half);
        let begin = first.map_or(begin, |first| begin.max(first));
        if begin >= end {
            return Ok(Roots::default());
        }
        let mut all = Vec::new();
        self.isolate(line, begin, end, |between| {
            let Some(root) = self.root(line, between)? else {
                return Ok(ControlFlow::Continue(()));
            };
            let is_last = match first {
                None => false,
                Some(first) => root.t.compare(&line.number(first))? == Ordering::Greater,
            };
            all.push(root);
            Ok(match is_last {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            })
        })?;
        Ok(Roots::new(all))
    }

    /// The only root between two parameters; `None` if it lies outside of the clipping box.
    fn root(&self, line: &Line, between: [f64; 2]) -> Decided<Option<Root>> {
        let (t, rising) = self.narrow(line, between)?;
        let place = line.at(&t);
        if let (Some(bounds), _) = &self.0.bounds()
            && !is_inside(&place.0, bounds)?
        {
            return Ok(None);
        }
        let slopes = [0, 1, 2].map(|axis| {
            let seeded = [0, 1, 2].map(|other| match axis == other {
                true => Jet::variable(place.0[other].clone()),
                false => Jet::exact(place.0[other].clone()),
            });
            self.0.at(&seeded)
        });
        let moves = slopes[0].moves;
        let mut gradient = [0.0; 3];
        for (axis, slope) in slopes.into_iter().enumerate() {
            gradient[axis] = slope.slope.ok_or(Undecided)?.nearest();
        }
        let along = match rising {
            Ordering::Greater => line.number(1.0),
            _ => line.number(-1.0),
        };
        Root::new(t, 0, &along, gradient.into(), moves).map(Some)
    }
}

/// Whether a point lies in a closed box.
fn is_inside(p: &[Interval; 3], [min, max]: &[DVec3; 2]) -> Decided<bool> {
    for (axis, x) in p.iter().enumerate() {
        if x.compare(&x.like(min[axis]))? == Ordering::Less
            || x.compare(&x.like(max[axis]))? == Ordering::Greater
        {
            return Ok(false);
        }
    }
    Ok(true)
}
