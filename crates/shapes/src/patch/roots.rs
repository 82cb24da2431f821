//! All points of a surface that lie on a ray: the common roots of two bicubic functions of two
//! parameters.
//!
//! A piece of the surface is multiplied by the inverse of its mean derivative; a flat piece would
//! then be (u - u0, v - v0). The deviation of its control points from that form bounds the roots
//! (the linear clipping of Nishita, Sederberg, Kakimoto, *Ray Tracing Trimmed Rational Surface
//! Patches*, SIGGRAPH 1990, in the form of an interval Newton step; Toth, *On Ray Tracing
//! Parametric Surfaces*, SIGGRAPH 1985). The piece is clipped to these bounds, or dropped. If the
//! bounds are so narrow that the map is a contraction, at most one root is left, and Newton's
//! method, kept inside, must find it. A piece that cannot be clipped is halved along its longer
//! direction.

use super::net::{Jet, Net, Way};
use whitstone_core::DVec2;

/// Below this width of the bounds, Newton's method contracts by 0.6/0.7 at worst: derivatives
/// differ from the mean one by 6 times the width (three times the differences of control points, in
/// each of two parameters).
const CONTRACTS: f64 = 0.05;

/// A piece is halved unless clipping reduces its area below this fraction.
const SHRINKS: f64 = 0.6;

/// Mean derivatives whose parallelogram is thinner than this have no usable inverse.
const THIN: f64 = 1e-6;

/// Maximum number of pieces examined per leaf. A tangent ray needs a few hundred.
pub(super) const MAX_PIECES: u32 = 8192;

/// Maximum number of Newton steps; usually four.
const MAX_STEPS: u32 = 64;

/// A part of a surface near a ray, and its parameter range.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    /// Control points projected along the ray, which is at the origin.
    pub(super) net: Net<DVec2>,
    pub(super) low: DVec2,
    pub(super) size: DVec2,
}

/// The minimum and maximum of some numbers.
fn range(numbers: impl Iterator<Item = f64>) -> (f64, f64) {
    numbers.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
        (low.min(x), high.max(x))
    })
}

/// Calls `found` with the parameters of every root; some roots may be reported twice. Points within
/// `near` of the ray count as roots. Returns whether all pieces were examined, of which there may
/// be `most`.
#[must_use]
pub(super) fn roots(first: Piece, near: f64, most: u32, mut found: impl FnMut(DVec2)) -> bool {
    let mut next = Some(first);
    // Allocates only if a piece is halved.
    let mut waiting: Vec<Piece> = Vec::new();
    for _ in 0..most {
        let Some(piece) = next.take().or_else(|| waiting.pop()) else {
            return true;
        };
        match piece.look(near) {
            Verdict::Nothing => {}
            Verdict::Root(at) => found(piece.low + at * piece.size),
            Verdict::Between(low, high) => {
                next = Some(piece.part(Way::U, low.x, high.x).part(Way::V, low.y, high.y));
            }
            Verdict::Halves(way) => {
                waiting.push(piece.part(way, 0.5, 1.0));
                next = Some(piece.part(way, 0.0, 0.5));
            }
        }
    }
    next.is_none() && waiting.is_empty()
}

enum Verdict {
    Nothing,
    /// A root at these parameters of the piece.
    Root(DVec2),
    /// All roots lie between these parameters.
    Between(DVec2, DVec2),
    Halves(Way),
}

impl Piece {
    fn part(&self, way: Way, low: f64, high: f64) -> Self {
        let (mut from, mut size) = (self.low, self.size);
        match way {
            Way::U => {
                from.x += low * size.x;
                size.x *= high - low;
            }
            Way::V => {
                from.y += low * size.y;
                size.y *= high - low;
            }
        }
        Self {
            net: self.net.part(way, low, high),
            low: from,
            size,
        }
    }

    fn look(&self, near: f64) -> Verdict {
        let q = &self.net.0;
        let (left, right) = range(q.iter().map(|p| p.x));
        let (below, above) = range(q.iter().map(|p| p.y));
        // Written so that NaN means no root.
        if !(left <= near && right >= -near && below <= near && above >= -near) {
            return Verdict::Nothing;
        }
        if right - left <= near && above - below <= near {
            return Verdict::Root(DVec2::splat(0.5));
        }
        let a = 0.5 * ((q[3] - q[0]) + (q[15] - q[12]));
        let b = 0.5 * ((q[12] - q[0]) + (q[15] - q[3]));
        let determinant = a.perp_dot(b);
        let sizes = [Way::U, Way::V].map(|way| self.net.longest(way, |d| d.abs().element_sum()));
        let longer = if sizes[0] >= sizes[1] { Way::U } else { Way::V };
        if determinant.abs() > THIN * a.length() * b.length() {
            self.clip(a, b, determinant, near)
                .unwrap_or(Verdict::Halves(longer))
        } else {
            self.line(longer, near)
        }
    }

    /// Clips by the mean derivatives a and b; `None` if the bounds are too wide to be useful.
    fn clip(&self, a: DVec2, b: DVec2, determinant: f64, near: f64) -> Option<Verdict> {
        let (to_u, to_v) = (
            DVec2::new(b.y, -b.x) / determinant,
            DVec2::new(-a.y, a.x) / determinant,
        );
        let third = 1.0 / 3.0;
        let points = || self.net.0.iter().enumerate();
        let (u0, u1) = range(points().map(|(k, p)| (k % 4) as f64 * third - to_u.dot(*p)));
        let (v0, v1) = range(points().map(|(k, p)| (k / 4) as f64 * third - to_v.dot(*p)));
        let slack = DVec2::new(to_u.abs().element_sum(), to_v.abs().element_sum()) * near;
        let low = DVec2::new(u0 - slack.x, v0 - slack.y).max(DVec2::ZERO);
        let high = DVec2::new(u1 + slack.x, v1 + slack.y).min(DVec2::ONE);
        if !(low.cmple(high).all()) {
            return Some(Verdict::Nothing);
        }
        if u1 - u0 < CONTRACTS && v1 - v0 < CONTRACTS {
            let root = newton(&self.net, 0.5 * (low + high), near);
            return Some(root.map_or(Verdict::Nothing, Verdict::Root));
        }
        let width = high - low;
        if width.x * width.y >= SHRINKS {
            return None;
        }
        Some(Verdict::Between(low, high))
    }

    /// Examines a piece that projects nearly to a line: at its silhouette, or seen edge-on.
    fn line(&self, longer: Way, near: f64) -> Verdict {
        let chords = [0, 1, 2, 3].map(|k| {
            let line = self.net.line(longer, k);
            line[3] - line[0]
        });
        let chord = chords.into_iter().fold(DVec2::ZERO, |most, d| {
            if d.length_squared() > most.length_squared() {
                d
            } else {
                most
            }
        });
        let along = chord.normalize_or(DVec2::X);
        let (low, high) = range(self.net.0.iter().map(|p| along.perp_dot(*p)));
        let (from, to) = range(self.net.0.iter().map(|p| along.dot(*p)));
        if low > near || high < -near || from > near || to < -near {
            return Verdict::Nothing;
        }
        if high - low > 0.125 * near {
            return Verdict::Halves(longer);
        }
        // The piece is narrower than the tolerance, so a root of the distance along the line is a
        // root of both functions.
        let mut at = DVec2::splat(0.5);
        for _ in 0..8 {
            let jet = self.net.at(at.x, at.y);
            let (parameter, slope) = match longer {
                Way::U => (&mut at.x, jet.u),
                Way::V => (&mut at.y, jet.v),
            };
            let step = along.dot(jet.p) / along.dot(slope);
            if !step.is_finite() {
                break;
            }
            *parameter = (*parameter - step).clamp(0.0, 1.0);
        }
        if self.net.at(at.x, at.y).p.length() <= near {
            Verdict::Root(at)
        } else if to - from > near {
            Verdict::Halves(longer)
        } else {
            Verdict::Nothing
        }
    }
}

/// Newton's method in the unit square; `None` if it does not come within `near` of the ray.
fn newton(net: &Net<DVec2>, start: DVec2, near: f64) -> Option<DVec2> {
    let mut at = start;
    for _ in 0..MAX_STEPS {
        let (away, next) = step(net, at);
        if away <= near {
            return Some(at);
        }
        // Steps that leave the square are clamped to its border.
        let moves = (next - at).abs().max_element() > 1e-15;
        if !moves {
            break;
        }
        at = next;
    }
    // At a grazing angle, rounding may put a root far beyond the border although a point of the
    // border lies on the ray.
    [Way::U, Way::V]
        .into_iter()
        .find_map(|way| along_border(net, way, at, near))
}

/// Searches along a border, from a point on it, for a point within `near` of the ray.
fn along_border(net: &Net<DVec2>, way: Way, start: DVec2, near: f64) -> Option<DVec2> {
    let mut at = start;
    let across = if way == Way::U { at.y } else { at.x };
    if across > 0.0 && across < 1.0 {
        return None;
    }
    for _ in 0..16 {
        let jet = net.at(at.x, at.y);
        if jet.p.length() <= near {
            return Some(at);
        }
        let (parameter, slope) = match way {
            Way::U => (&mut at.x, jet.u),
            Way::V => (&mut at.y, jet.v),
        };
        let step = slope.dot(jet.p) / slope.length_squared();
        if !step.is_finite() {
            return None;
        }
        *parameter = (*parameter - step).clamp(0.0, 1.0);
    }
    None
}

/// The distance of a surface point from the ray, and the next Newton iterate.
fn step(net: &Net<DVec2>, at: DVec2) -> (f64, DVec2) {
    let Jet { p, u, v } = net.at(at.x, at.y);
    let step = DVec2::new(v.perp_dot(p), p.perp_dot(u)) / u.perp_dot(v);
    (p.length(), (at + step).clamp(DVec2::ZERO, DVec2::ONE))
}

/// Refines a root to full precision: steps as long as the distance decreases. `None` if it is not a
/// root.
pub(super) fn polished(net: &Net<DVec2>, root: DVec2, near: f64) -> Option<DVec2> {
    let (mut away, mut next) = step(net, root);
    let mut at = root;
    for _ in 0..MAX_STEPS {
        let (nearer, then) = step(net, next);
        // Without a valid step this is NaN, and not better.
        let better = nearer < away;
        if !better {
            break;
        }
        (at, away, next) = (next, nearer, then);
    }
    (away <= near).then_some(at)
}
