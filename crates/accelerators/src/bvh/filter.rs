//! The test of a ray against the triangles of a leaf in single precision: it says which the test in double
//! precision certainly hits, which it may hit, and where.
//!
//! The watertight test of the core crate (Woop, Benthin, Wald, JCGT 2(1), 2013) on eight triangles at once,
//! with a bound on the error of the edge functions; proof in `docs/accelerators.md`.

use super::frame::{LocalRay, ROUNDING};
use super::node::WIDTH;
use whitstone_simd::Lanes;

/// Numbers of a triangle: three corners of three coordinates.
pub(super) const NUMBERS: usize = 9;

/// From the start of a leaf so many numbers can be read, of whatever.
pub(super) const WINDOW: usize = NUMBERS * WIDTH;

/// What the filter says of a leaf, by triangle.
pub(super) struct Filtered {
    /// Certainly hit; bits.
    pub(super) sure: u32,
    /// Perhaps hit; bits.
    pub(super) unsure: u32,
    /// Bounds of the ray parameter where `sure`.
    pub(super) low: [f32; WIDTH],
    pub(super) high: [f32; WIDTH],
}

/// The triangles of a leaf: `numbers` holds, for each coordinate of each corner, that of all `count`
/// triangles, and then something else.
#[inline(always)]
pub(super) fn filter<L: Lanes>(
    l: L,
    ray: &LocalRay,
    numbers: &[f32; WINDOW],
    count: usize,
    limit: f32,
) -> Option<Filtered> {
    let count = count.min(WIDTH);
    let a = corner(l, ray, numbers, count, 0);
    let b = corner(l, ray, numbers, count, 1);
    let c = corner(l, ray, numbers, count, 2);
    let weights = [edge(l, c, b), edge(l, a, c), edge(l, b, a)];
    let largest = l.max(
        l.max(size(l, a), size(l, b)),
        l.max(size(l, c), l.splat(ray.error)),
    );
    let error = l.mul(largest, l.splat(8.0 * ray.error));
    let minus_error = l.mul(largest, l.splat(-8.0 * ray.error));
    let lowest = l.min(l.min(weights[0], weights[1]), weights[2]);
    let highest = l.max(l.max(weights[0], weights[1]), weights[2]);
    let valid = (1u32 << count) - 1;
    let possible = (l.at_most(minus_error, lowest) | l.at_most(highest, error)) & valid;
    if possible == 0 {
        return None;
    }

    // Few get here: once more, with the errors of these very numbers.
    let sizes = l.max(l.max(l.abs(a[2]), l.abs(b[2])), l.abs(c[2]));
    let shift = l.mul_add(
        l.max(largest, sizes),
        l.splat(8.0 * ROUNDING),
        l.splat(2.5 * ray.conversion),
    );
    let largest = l.max(largest, shift);
    let factor = l.mul_add(l.splat(5.0), shift, l.mul(l.splat(4.0 * ROUNDING), largest));
    let error = l.mul(largest, factor);
    let minus_error = l.sub(l.splat(0.0), error);
    let sure = l.at_most(error, lowest) | l.at_most(highest, minus_error);
    let possible = possible & (l.at_most(minus_error, lowest) | l.at_most(highest, error));

    let determinant = l.abs(l.add(l.add(weights[0], weights[1]), weights[2]));
    let reciprocal = l.div(l.splat(1.0), determinant);
    let sign = l.splat(ray.sign);
    let [za, zb, zc] = [l.mul(a[2], sign), l.mul(b[2], sign), l.mul(c[2], sign)];
    let nearest = l.min(l.min(za, zb), zc);
    let farthest = l.max(l.max(za, zb), zc);
    let range = l.sub(farthest, nearest);
    let sum = l.mul_add(
        l.abs(weights[2]),
        l.sub(zc, za),
        l.mul(l.abs(weights[1]), l.sub(zb, za)),
    );
    let t = l.mul_add(sum, reciprocal, za);
    let relative = l.mul(l.mul(l.splat(4.0), error), reciprocal);
    let base = l.mul(l.splat(3.0), shift);
    let slack = l.mul_add(range, relative, base);
    let (low, high) = (l.sub(t, slack), l.add(t, slack));
    let (limit, min) = (l.splat(limit), l.splat(ray.min));
    let sure_reached = l.at_most(low, limit) & l.at_most(min, high);
    let reached = l.at_most(l.sub(nearest, base), limit) & l.at_most(min, l.add(farthest, base));
    Some(Filtered {
        sure: sure & sure_reached & possible,
        unsure: possible & !sure & reached,
        low: l.store(low),
        high: l.store(high),
    })
}

/// A corner as the ray sees it: sheared, so that the ray is the third axis.
///
/// Functions instead of closures, here and below: these would not be compiled for the lanes.
#[inline(always)]
fn corner<L: Lanes>(
    l: L,
    ray: &LocalRay,
    numbers: &[f32; WINDOW],
    count: usize,
    corner: usize,
) -> [L::Floats; 3] {
    let x = coordinate(l, ray, numbers, count, corner, 0);
    let y = coordinate(l, ray, numbers, count, corner, 1);
    let z = coordinate(l, ray, numbers, count, corner, 2);
    [
        l.neg_mul_add(l.splat(ray.shear[0]), z, x),
        l.neg_mul_add(l.splat(ray.shear[1]), z, y),
        z,
    ]
}

/// A coordinate of a corner, from the origin of the ray.
#[inline(always)]
fn coordinate<L: Lanes>(
    l: L,
    ray: &LocalRay,
    numbers: &[f32; WINDOW],
    count: usize,
    corner: usize,
    i: usize,
) -> L::Floats {
    let start = (3 * corner + ray.axes[i].min(2)) * count;
    // The last of 9 rows begins at 8 times the count at most.
    match numbers[start..].first_chunk::<WIDTH>() {
        Some(row) => l.sub(l.load(row), l.splat(ray.origin[i])),
        None => l.splat(0.0),
    }
}

/// Twice the area of the triangle of the ray and two corners.
#[inline(always)]
fn edge<L: Lanes>(l: L, p: [L::Floats; 3], q: [L::Floats; 3]) -> L::Floats {
    l.neg_mul_add(p[1], q[0], l.mul(p[0], q[1]))
}

/// How far a corner is from the ray at most.
#[inline(always)]
fn size<L: Lanes>(l: L, p: [L::Floats; 3]) -> L::Floats {
    l.max(l.abs(p[0]), l.abs(p[1]))
}
