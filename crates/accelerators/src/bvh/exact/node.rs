//! Nodes, and the test of a ray against the sixteen boxes of a node.

use super::super::node;
use super::ray::BoxRay;
use crate::support::leaves::child::Child;
use rayon::prelude::*;
use whitstone_simd::{Sixteen, pack_order, unpack_order};

/// An inner node.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Node {
    pub(super) boxes: node::Node<16>,
    /// For each octant of directions, the children in the order in which rays leave them, the
    /// farthest first, as [`pack_order`] packs them.
    orders: [u32; 16],
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

/// Sorts the children of nodes for each octant by the centers of their boxes.
///
/// Fuetterling et al., *Accelerated single ray tracing for wide vector units*, HPG 2017: an order
/// that is known beforehand replaces sorting by distance.
pub(super) fn sorted(nodes: &[node::Node<16>]) -> Vec<Node> {
    nodes.par_iter().with_min_len(1024).map(Node::new).collect()
}

impl Node {
    fn new(boxes: &node::Node<16>) -> Self {
        let mut orders = [0; 16];
        // Empty boxes have no center: they stay where they are, behind all others.
        let count = (0..16).filter(|&i| boxes.planes[0][0][i] < f32::INFINITY).count();
        for octant in 0..8 {
            let keys: [f32; 16] = std::array::from_fn(|i| {
                let along = [0, 1, 2].map(|axis| {
                    let [min, max] = boxes.planes[axis];
                    let sign = if octant >> axis & 1 == 0 { 1.0 } else { -1.0 };
                    sign * (min[i] + max[i])
                });
                along[0] + along[1] + along[2]
            });
            let mut order: [usize; 16] = std::array::from_fn(|i| i);
            order[..count].sort_by(|&i, &j| keys[j].total_cmp(&keys[i]));
            pack_order(order, &mut orders, octant);
        }
        Self {
            boxes: *boxes,
            orders,
        }
    }

    /// Which boxes the ray may hit between its `min` and `limit`. No box that holds a hit of the
    /// double-precision tests is missed: the padding of the ray covers every rounding
    /// (`docs/accelerators.md`).
    #[inline(always)]
    pub(super) fn enter<L: Sixteen>(&self, l: L, ray: &BoxRay, limit: f32) -> Entered<L::Floats> {
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
        Child(self.boxes.children[entered.mask.trailing_zeros() as usize % 16])
    }

    /// The children that are entered, the farthest first: their mask, entry distances and numbers.
    #[inline(always)]
    pub(super) fn sorted<L: Sixteen>(
        &self,
        l: L,
        octant: usize,
        entered: &Entered<L::Floats>,
    ) -> (u32, L::Floats, L::Words) {
        let order = l.order(&self.orders, octant);
        let near = l.permute(entered.near, order);
        let far = l.permute(entered.far, order);
        let children = l.permute_words(l.load_words(&self.boxes.children), order);
        (l.at_most(near, far), near, children)
    }

    /// The last child that a mask of [`Self::sorted`] selects, which must not be empty.
    #[inline(always)]
    pub(super) fn last(&self, octant: usize, mask: u32) -> Child {
        let place = (31 - (mask & 0xffff | 1).leading_zeros()) as usize;
        Child(self.boxes.children[unpack_order(&self.orders, octant, place)])
    }

    /// Bounds on the parameters where the ray crosses the near (0) or far (1) planes of all boxes.
    ///
    /// No closures, here and below: they would not be compiled for the lanes' instruction set.
    #[inline(always)]
    fn reach<L: Sixteen>(&self, l: L, ray: &BoxRay, side: usize, axis: usize) -> L::Floats {
        let all = self.boxes.planes.as_flattened().as_flattened();
        let planes = match all[ray.planes[side][axis] as usize..].first_chunk() {
            Some(planes) => l.load(planes),
            None => l.splat(f32::NAN),
        };
        let offset = [&ray.near, &ray.far][side][axis];
        l.mul_add(planes, l.splat(ray.reciprocal[axis]), l.splat(offset))
    }
}
