//! Nodes, and the test of a ray against the eight boxes of a node.

use crate::support::leaves::child::{Child, WIDTH};
use crate::support::leaves::frame::{LocalRay, Planes};
use crate::support::leaves::items::Box4;
use glam::Vec4;
use whitstone_core::DVec3;
use whitstone_simd::Lanes;

/// An inner node: its children, and their boxes in local coordinates.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(super) struct Node<const N: usize> {
    /// Indexed by axis, side (0 minimum, 1 maximum) and child. The box of an empty child slot is
    /// inverted, so that no ray hits it.
    pub(super) planes: [[[f32; N]; 2]; 3],
    /// [`Child`]ren.
    pub(super) children: [u32; N],
}

impl<const N: usize> Node<N> {
    pub(super) const EMPTY: Self = Self {
        planes: [[[f32::INFINITY; N], [f32::NEG_INFINITY; N]]; 3],
        children: [0; N],
    };

    /// The places of its children. The box of an empty place is inverted.
    pub(super) fn used(&self) -> impl Iterator<Item = usize> + use<N> {
        let empty = self.planes[0][0].map(|min| min == f32::INFINITY);
        (0..N).filter(move |&i| !empty[i])
    }

    /// The box of a child.
    pub(super) fn get(&self, i: usize) -> Box4 {
        let corner = |side: usize| Vec4::from_array([0, 1, 2, 2].map(|axis| self.planes[axis][side][i]));
        Box4 {
            min: corner(0),
            max: corner(1),
        }
    }

    /// Sets the box of a child.
    pub(super) fn set(&mut self, i: usize, aabb: Box4) {
        for axis in 0..3 {
            self.planes[axis][0][i] = aabb.min[axis];
            self.planes[axis][1][i] = aabb.max[axis];
        }
    }

    /// The box around all children.
    pub(super) fn whole(&self) -> Box4 {
        self.used().fold(Box4::EMPTY, |whole, i| whole.union(self.get(i)))
    }

    /// The children, each with the corners of its box.
    pub(super) fn boxes(&self) -> impl Iterator<Item = (Child, [DVec3; 2])> {
        (0..N).filter_map(|i| {
            let corner = |side: usize| self.planes.map(|sides| f64::from(sides[side][i])).into();
            let [min, max]: [DVec3; 2] = [corner(0), corner(1)];
            // The box of an empty child slot is inverted (min > max).
            min.cmple(max)
                .all()
                .then(|| (Child(self.children[i]), [min, max]))
        })
    }
}

impl Node<WIDTH> {
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
