//! The single-precision test of a ray against the triangles of a leaf. It reports which triangles
//! the double-precision test certainly hits, which it may hit, and where.
//!
//! It is the watertight test of the core crate (Woop, Benthin, Wald, JCGT 2(1), 2013) on eight
//! triangles at once, with a bound on the error of the edge functions; proof in
//! `docs/accelerators.md`. The same code tests one triangle against the rays of a packet.

use super::child::WIDTH;
use super::frame::{LocalRay, LocalRays, ROUNDING};
use whitstone_core::stream::GROUP;
use whitstone_core::triangle::Axis;
use whitstone_simd::Lanes;

/// Numbers of a triangle: three corners of three coordinates.
pub(crate) const NUMBERS: usize = 9;

/// This many numbers can be read from the start of any leaf; those past its end are arbitrary.
pub(crate) const WINDOW: usize = NUMBERS * WIDTH;

/// Ray-triangle pairs, one per lane: one ray and the triangles of a leaf, or one triangle and the
/// rays of a packet. The values of a ray are those of [`LocalRay`].
///
/// Methods instead of fields: a value that is the same in all lanes is loaded where it is used; a
/// stored one would be spilled.
pub(crate) trait Pairs<const N: usize, L: Lanes<N>> {
    /// A coordinate of a corner relative to the ray's origin, along the `i`-th axis of the ray.
    fn coordinate(&self, l: L, corner: usize, i: usize) -> L::Floats;
    fn shear(&self, l: L, i: usize) -> L::Floats;
    fn error(&self, l: L) -> L::Floats;
    fn conversion(&self, l: L) -> L::Floats;
    fn sign(&self, l: L) -> L::Floats;
    fn min(&self, l: L) -> L::Floats;
    /// Hits beyond this parameter do not count.
    fn limit(&self, l: L) -> L::Floats;
}

/// Result of the filter, by lane.
pub(crate) struct Filtered<const N: usize> {
    /// Certainly hit, as a bit mask.
    pub(crate) sure: u32,
    /// Possibly hit, as a bit mask.
    pub(crate) unsure: u32,
    /// Bounds of the ray parameter where `sure`.
    pub(crate) low: [f32; N],
    pub(crate) high: [f32; N],
}

/// Tests the lanes named by `valid`; `None` if no lane can be hit.
#[inline(always)]
pub(crate) fn filter<const N: usize, L: Lanes<N>>(
    l: L,
    pairs: &impl Pairs<N, L>,
    valid: u32,
) -> Option<Filtered<N>> {
    let a = corner(l, pairs, 0);
    let b = corner(l, pairs, 1);
    let c = corner(l, pairs, 2);
    let weights = [edge(l, c, b), edge(l, a, c), edge(l, b, a)];
    let largest = l.max(l.max(size(l, a), size(l, b)), l.max(size(l, c), pairs.error(l)));
    let error = l.mul(largest, l.mul(l.splat(8.0), pairs.error(l)));
    let minus_error = l.mul(largest, l.mul(l.splat(-8.0), pairs.error(l)));
    let lowest = l.min(l.min(weights[0], weights[1]), weights[2]);
    let highest = l.max(l.max(weights[0], weights[1]), weights[2]);
    let possible = (l.at_most(minus_error, lowest) | l.at_most(highest, error)) & valid;
    if possible == 0 {
        return None;
    }

    // Few pairs get here: repeat with error bounds for their actual values.
    let sizes = l.max(l.max(l.abs(a[2]), l.abs(b[2])), l.abs(c[2]));
    let shift = l.mul_add(
        l.max(largest, sizes),
        l.splat(8.0 * ROUNDING),
        l.mul(l.splat(2.5), pairs.conversion(l)),
    );
    let largest = l.max(largest, shift);
    let factor = l.mul_add(l.splat(5.0), shift, l.mul(l.splat(4.0 * ROUNDING), largest));
    let error = l.mul(largest, factor);
    let minus_error = l.sub(l.splat(0.0), error);
    let sure = l.at_most(error, lowest) | l.at_most(highest, minus_error);
    let possible = possible & (l.at_most(minus_error, lowest) | l.at_most(highest, error));

    let determinant = l.abs(l.add(l.add(weights[0], weights[1]), weights[2]));
    let reciprocal = l.div(l.splat(1.0), determinant);
    let sign = pairs.sign(l);
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
    let (limit, min) = (pairs.limit(l), pairs.min(l));
    let sure_reached = l.at_most(low, limit) & l.at_most(min, high);
    let reached = l.at_most(l.sub(nearest, base), limit) & l.at_most(min, l.add(farthest, base));
    Some(Filtered {
        sure: sure & sure_reached & possible,
        unsure: possible & !sure & reached,
        low: l.store(low),
        high: l.store(high),
    })
}

/// A corner in sheared coordinates, in which the ray is the third axis.
///
/// Functions instead of closures, here and below: closures would not be compiled for the lanes'
/// instruction set.
#[inline(always)]
fn corner<const N: usize, L: Lanes<N>>(l: L, pairs: &impl Pairs<N, L>, corner: usize) -> [L::Floats; 3] {
    let x = pairs.coordinate(l, corner, 0);
    let y = pairs.coordinate(l, corner, 1);
    let z = pairs.coordinate(l, corner, 2);
    [
        l.neg_mul_add(pairs.shear(l, 0), z, x),
        l.neg_mul_add(pairs.shear(l, 1), z, y),
        z,
    ]
}

/// Edge function: twice the signed area of the triangle of the ray and two corners.
#[inline(always)]
fn edge<const N: usize, L: Lanes<N>>(l: L, p: [L::Floats; 3], q: [L::Floats; 3]) -> L::Floats {
    l.neg_mul_add(p[1], q[0], l.mul(p[0], q[1]))
}

/// Distance of a corner from the ray in the maximum norm.
#[inline(always)]
fn size<const N: usize, L: Lanes<N>>(l: L, p: [L::Floats; 3]) -> L::Floats {
    l.max(l.abs(p[0]), l.abs(p[1]))
}

/// One ray and the triangles of a leaf. `numbers` holds rows of one coordinate of all `count`
/// triangles, axis by axis and corner by corner, and then unrelated data.
pub(crate) struct Leaf<'a> {
    pub(crate) ray: &'a LocalRay,
    pub(crate) numbers: &'a [f32; WINDOW],
    pub(crate) count: usize,
    pub(crate) limit: f32,
}

impl<L: Lanes<WIDTH>> Pairs<WIDTH, L> for Leaf<'_> {
    #[inline(always)]
    fn coordinate(&self, l: L, corner: usize, i: usize) -> L::Floats {
        let count = self.count.min(WIDTH);
        let along = &self.numbers[3 * self.ray.axes[i] as usize * count..];
        // The last of 9 rows begins at 8 times the count at most.
        match along[corner * count..].first_chunk::<WIDTH>() {
            Some(row) => l.sub(l.load(row), l.splat(self.ray.origin[i])),
            None => l.splat(0.0),
        }
    }
    #[inline(always)]
    fn shear(&self, l: L, i: usize) -> L::Floats {
        l.splat(self.ray.shear[i])
    }
    #[inline(always)]
    fn error(&self, l: L) -> L::Floats {
        l.splat(self.ray.error)
    }
    #[inline(always)]
    fn conversion(&self, l: L) -> L::Floats {
        l.splat(self.ray.conversion)
    }
    #[inline(always)]
    fn sign(&self, l: L) -> L::Floats {
        l.splat(self.ray.sign)
    }
    #[inline(always)]
    fn min(&self, l: L) -> L::Floats {
        l.splat(self.ray.min)
    }
    #[inline(always)]
    fn limit(&self, l: L) -> L::Floats {
        l.splat(self.limit)
    }
}

/// One triangle and rays with the same axes. `numbers` holds the triangle's coordinates, `stride`
/// apart.
pub(crate) struct Beam<'a> {
    pub(crate) rays: &'a LocalRays,
    pub(crate) axes: [Axis; 3],
    pub(crate) numbers: &'a [f32],
    pub(crate) stride: usize,
    pub(crate) limits: &'a [f32; GROUP],
}

impl<L: Lanes<GROUP>> Pairs<GROUP, L> for Beam<'_> {
    #[inline(always)]
    fn coordinate(&self, l: L, corner: usize, i: usize) -> L::Floats {
        let number = self.numbers[(3 * self.axes[i] as usize + corner) * self.stride];
        l.sub(l.splat(number), l.load(&self.rays.origin[i]))
    }
    #[inline(always)]
    fn shear(&self, l: L, i: usize) -> L::Floats {
        l.load(&self.rays.shear[i])
    }
    #[inline(always)]
    fn error(&self, l: L) -> L::Floats {
        l.load(&self.rays.error)
    }
    #[inline(always)]
    fn conversion(&self, l: L) -> L::Floats {
        l.load(&self.rays.conversion)
    }
    #[inline(always)]
    fn sign(&self, l: L) -> L::Floats {
        l.load(&self.rays.sign)
    }
    #[inline(always)]
    fn min(&self, l: L) -> L::Floats {
        l.load(&self.rays.min)
    }
    #[inline(always)]
    fn limit(&self, l: L) -> L::Floats {
        l.load(self.limits)
    }
}
