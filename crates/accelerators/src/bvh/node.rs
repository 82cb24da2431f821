//! Nodes, and the test of a ray against all boxes of a node.

use crate::support::leaves::child::Child;
use crate::support::leaves::frame::LocalRay;
use whitstone_simd::{Lanes, pack_order};

/// An inner node: its children, and their boxes in local coordinates.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Node<const N: usize> {
    /// Indexed by axis, side (0 minimum, 1 maximum) and child. The box of an empty child slot is
    /// inverted, so that no ray hits it.
    pub(super) planes: [[[f32; N]; 2]; 3],
    /// [`Child`]ren.
    pub(super) children: [u32; N],
    /// For each octant of directions, the children in the order in which rays leave them, the
    /// farthest first, as [`pack_order`] packs them.
    pub(super) orders: [u32; N],
}

/// The boxes that a ray may hit.
pub(super) struct Entered<F> {
    /// As a bit mask.
    pub(super) mask: u32,
    /// Lower bounds on the entry distances.
    near: F,
    /// Upper bounds on the exit distances.
    far: F,
}

impl<const N: usize> Node<N> {
    pub(super) const EMPTY: Self = Self {
        planes: [[[f32::INFINITY; N], [f32::NEG_INFINITY; N]]; 3],
        children: [0; N],
        orders: [0; N],
    };

    /// Sorts the first `count` children for each octant by the centers of their boxes.
    ///
    /// Fuetterling et al., *Accelerated single ray tracing for wide vector units*, HPG 2017: an
    /// order that is known beforehand replaces sorting by distance.
    pub(super) fn sort(&mut self, count: usize) {
        let centers: [[f32; 3]; N] =
            std::array::from_fn(|i| [0, 1, 2].map(|axis| self.planes[axis][0][i] + self.planes[axis][1][i]));
        for octant in 0..8 {
            let along = |i: usize| {
                let sign = |axis: usize| if octant >> axis & 1 == 0 { 1.0 } else { -1.0 };
                let [x, y, z] = centers[i];
                sign(0) * x + sign(1) * y + sign(2) * z
            };
            let mut order: [usize; N] = std::array::from_fn(|i| i);
            let keys: [f32; N] = std::array::from_fn(along);
            order[..count].sort_by(|&i, &j| keys[j].total_cmp(&keys[i]));
            pack_order(order, &mut self.orders, octant);
        }
    }

    /// Which boxes the ray may hit between its `min` and `limit`. No box that holds a hit of the
    /// double-precision tests is missed: the padding of the ray covers every rounding
    /// (`docs/accelerators.md`).
    #[inline(always)]
    pub(super) fn enter<L: Lanes<N>>(&self, l: L, ray: &LocalRay, limit: f32) -> Entered<L::Floats> {
        let near = [
            self.reach(l, ray, 0, 0),
            self.reach(l, ray, 0, 1),
            self.reach(l, ray, 0, 2),
        ];
        let far = [
            self.reach(l, ray, 1, 0),
            self.reach(l, ray, 1, 1),
            self.reach(l, ray, 1, 2),
        ];
        // Pairwise, so that the dependency chain has two maxima instead of three.
        let near = l.max(l.max(near[0], near[1]), l.max(near[2], l.splat(ray.min)));
        let far = l.min(l.min(far[0], far[1]), l.min(far[2], l.splat(limit)));
        Entered {
            mask: l.at_most(near, far),
            near,
            far,
        }
    }

    /// The only child that is entered.
    #[inline(always)]
    pub(super) fn only<F>(&self, entered: &Entered<F>) -> Child {
        Child(self.children[entered.mask.trailing_zeros() as usize % N])
    }

    /// The children that are entered, the farthest first: their mask, entry distances and numbers.
    #[inline(always)]
    pub(super) fn sorted<L: Lanes<N>>(
        &self,
        l: L,
        octant: usize,
        entered: &Entered<L::Floats>,
    ) -> (u32, L::Floats, L::Words) {
        let order = l.order(&self.orders, octant);
        let near = l.permute(entered.near, order);
        let far = l.permute(entered.far, order);
        let children = l.permute_words(l.load_words(&self.children), order);
        (l.at_most(near, far), near, children)
    }

    /// Bounds on the parameters where the ray crosses the near (0) or far (1) planes of all boxes.
    ///
    /// No closures, here and below: they would not be compiled for the lanes' instruction set.
    #[inline(always)]
    fn reach<L: Lanes<N>>(&self, l: L, ray: &LocalRay, side: usize, axis: usize) -> L::Floats {
        let all = self.planes.as_flattened().as_flattened();
        let planes = match all[ray.planes[side][axis] as usize / (16 / N)..].first_chunk() {
            Some(planes) => l.load(planes),
            None => l.splat(f32::NAN),
        };
        let offset = [&ray.near, &ray.far][side][axis];
        l.mul_add(planes, l.splat(ray.reciprocal[axis]), l.splat(offset))
    }
}
