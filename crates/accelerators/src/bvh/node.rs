//! Nodes, and the test of a ray against the eight boxes of a node.

use crate::support::leaves::child::WIDTH;
use crate::support::leaves::frame::{LocalRay, Planes};
use whitstone_simd::Lanes;

/// An inner node: its children, and their boxes in local coordinates.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(super) struct Node {
    /// Indexed by axis, side (0 minimum, 1 maximum) and child. The box of an empty child slot is
    /// inverted, so that no ray hits it.
    pub(super) planes: [[[f32; WIDTH]; 2]; 3],
    /// [`Child`]ren.
    pub(super) children: [u32; WIDTH],
}

impl Node {
    pub(super) const EMPTY: Self = Self {
        planes: [[[f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]]; 3],
        children: [0; WIDTH],
    };

    /// Which boxes the ray may hit between its `min` and `limit`, as a bit mask, and lower bounds
    /// on their entry distances. No box that holds a hit of the double-precision tests is missed:
    /// the padding of the ray covers every rounding (`docs/accelerators.md`).
    #[inline(always)]
    pub(super) fn enter<L: Lanes<WIDTH>>(&self, l: L, ray: &LocalRay, limit: f32) -> (u32, L::Floats) {
        // Closures instead of a loop over the axes: the three planes are independent, and the
        // dependency chain has two maxima instead of three.
        let enter = |axis: usize| {
            let plane = self.load(l, ray.planes[0][axis]);
            l.mul_add(plane, l.splat(ray.reciprocal[axis]), l.splat(ray.near[axis]))
        };
        let leave = |axis: usize| {
            let plane = self.load(l, ray.planes[1][axis]);
            l.mul_add(plane, l.splat(ray.reciprocal[axis]), l.splat(ray.far[axis]))
        };
        let near = l.max(l.max(enter(0), enter(1)), l.max(enter(2), l.splat(ray.min)));
        let far = l.min(l.min(leave(0), leave(1)), l.min(leave(2), l.splat(limit)));
        (l.at_most(near, far), near)
    }

    /// Loads eight planes; the index is always in range.
    #[inline(always)]
    fn load<L: Lanes<WIDTH>>(&self, l: L, planes: Planes) -> L::Floats {
        let all = self.planes.as_flattened().as_flattened();
        match all[planes as usize..].first_chunk() {
            Some(planes) => l.load(planes),
            None => l.splat(f32::NAN),
        }
    }
}
