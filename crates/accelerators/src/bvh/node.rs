//! The nodes, and the test of a ray against the eight boxes of one.

use crate::leaves::child::WIDTH;
use crate::leaves::frame::{LocalRay, Planes};
use whitstone_simd::Lanes;

/// An inner node: the boxes of its children in own coordinates, and what is in them.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(super) struct Node {
    /// By axis, by side (0 smallest, 1 largest coordinate), by child. Where there is no child, the
    /// box is inside out, so that no ray meets it.
    pub(super) planes: [[[f32; WIDTH]; 2]; 3],
    /// [`Child`]ren.
    pub(super) children: [u32; WIDTH],
}

impl Node {
    pub(super) const EMPTY: Self = Self {
        planes: [[[f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]]; 3],
        children: [0; WIDTH],
    };

    /// Which boxes the ray may meet between its `min` and `limit`, as bits, and where it enters
    /// them at the earliest. Never leaves out a box that holds a hit of the double precision tests:
    /// the pad of the ray pays for every rounding (`docs/accelerators.md`).
    #[inline(always)]
    pub(super) fn enter<L: Lanes<WIDTH>>(&self, l: L, ray: &LocalRay, limit: f32) -> (u32, L::Floats) {
        // Functions of the axis instead of a loop: the three planes are independent, and two maxima
        // wait for one another, not three.
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

    /// Eight planes; they are always there.
    #[inline(always)]
    fn load<L: Lanes<WIDTH>>(&self, l: L, planes: Planes) -> L::Floats {
        let all = self.planes.as_flattened().as_flattened();
        match all[planes as usize..].first_chunk() {
            Some(planes) => l.load(planes),
            None => l.splat(f32::NAN),
        }
    }
}
