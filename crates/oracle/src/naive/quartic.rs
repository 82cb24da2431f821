//! Closed-form roots of cubic and quartic polynomials: Schwarze, *Cubic and quartic roots*,
//! Graphics Gems (1990).

use super::{Real, Roots};

/// Ascending roots of `c0 + c1 x + ... + c4 x⁴`, by Ferrari's formula.
pub(super) fn quartic<R: Real>([c0, c1, c2, c3, c4]: [R; 5]) -> Roots<R> {
    let zero = R::of(0.0);
    let [a, b, c, d] = [c3 / c4, c2 / c4, c1 / c4, c0 / c4];
    // x = y - a/4 removes the cubic term.
    let aa = a * a;
    let p = b - R::of(0.375) * aa;
    let q = c + R::of(0.125) * aa * a - R::of(0.5) * a * b;
    let r = d - R::of(3.0 / 256.0) * aa * aa + R::of(0.0625) * aa * b - R::of(0.25) * a * c;
    let z = cubic([
        R::of(0.5) * r * p - R::of(0.125) * q * q,
        -r,
        R::of(-0.5) * p,
        R::of(1.0),
    ]);
    let (u, v) = (z * z - r, R::of(2.0) * z - p);
    let mut roots = Roots::new();
    if u < zero || v < zero {
        return roots;
    }
    let (u, v) = (u.sqrt(), if q < zero { -v.sqrt() } else { v.sqrt() });
    for (v, constant) in [(v, z - u), (-v, z + u)] {
        let half = R::of(0.5) * v;
        let discriminant = half * half - constant;
        if discriminant >= zero {
            let root = discriminant.sqrt();
            roots.extend([-half - root, -half + root].map(|y| y - R::of(0.25) * a));
        }
    }
    roots.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    roots
}

/// The largest root of `c0 + c1 x + c2 x² + c3 x³`, by Cardano's formula.
#[inline]
fn cubic<R: Real>([c0, c1, c2, c3]: [R; 4]) -> R {
    let (third, zero) = (R::of(1.0) / R::of(3.0), R::of(0.0));
    let [a, b, c] = [c2 / c3, c1 / c3, c0 / c3];
    let p = third * (b - third * a * a);
    let q = R::of(0.5) * (R::of(2.0) / R::of(27.0) * a * a * a - third * a * b + c);
    let discriminant = q * q + p * p * p;
    let y = if discriminant < zero {
        let angle = third * (-q / (-p * p * p).sqrt()).acos();
        R::of(2.0) * (-p).sqrt() * angle.cos()
    } else {
        let root = discriminant.sqrt();
        (root - q).cbrt() - (root + q).cbrt()
    };
    y - third * a
}
