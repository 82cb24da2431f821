//! The nodes, and the test of a ray against the eight boxes of one.

use super::frame::LocalRay;
use whitstone_simd::Lanes;

/// Children of a node, and the most triangles of a leaf.
pub(super) const WIDTH: usize = 8;

/// An inner node: the boxes of its children in own coordinates, and what is in them.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(super) struct Node {
    /// By axis, by side (0 smallest, 1 largest coordinate), by child. Where there is no child, the box is
    /// inside out, so that no ray meets it.
    pub(super) planes: [[[f32; WIDTH]; 2]; 3],
    /// [`Child`]ren.
    pub(super) children: [u32; WIDTH],
}

impl Node {
    pub(super) const EMPTY: Self = Self {
        planes: [[[f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]]; 3],
        children: [0; WIDTH],
    };

    /// Which boxes the ray may meet between its `min` and `limit`, as bits, and where it enters them at
    /// the earliest. Never leaves out a box that holds a hit of the double precision tests: the pad of the
    /// ray pays for every rounding (`docs/accelerators.md`).
    #[inline(always)]
    pub(super) fn enter<L: Lanes<WIDTH>>(&self, l: L, ray: &LocalRay, limit: f32) -> (u32, L::Floats) {
        let mut near = l.splat(ray.min);
        let mut far = l.splat(limit);
        for axis in 0..3 {
            let sides = &self.planes[axis];
            let side = ray.side[axis] & 1;
            let reciprocal = l.splat(ray.reciprocal[axis]);
            let enter = l.mul_add(l.load(&sides[side]), reciprocal, l.splat(ray.near[axis]));
            let leave = l.mul_add(l.load(&sides[side ^ 1]), reciprocal, l.splat(ray.far[axis]));
            near = l.max(enter, near);
            far = l.min(leave, far);
        }
        (l.at_most(near, far), near)
    }
}

/// An inner node, a leaf of triangles, or a leaf of anything.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Child(pub(super) u32);

/// What a [`Child`] is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Inner(usize),
    /// First slot and number of triangles, at most 8.
    Triangles(usize, usize),
    /// First slot and number of elements, at most 7.
    Mixed(usize, usize),
}

impl Child {
    const BITS: u32 = 28;

    /// Slots and nodes are numbered below this.
    pub(super) const LIMIT: usize = 1 << Self::BITS;

    pub(super) fn new(kind: Kind) -> Self {
        let (tag, index) = match kind {
            Kind::Inner(node) => (0, node),
            Kind::Triangles(first, count) => (count, first),
            Kind::Mixed(first, count) => (count + WIDTH, first),
        };
        Self((tag as u32) << Self::BITS | index as u32)
    }

    /// The same where the nodes counted from 0 begin behind others; slots stay what they are.
    pub(super) fn behind(self, nodes: usize) -> Self {
        Self(if self.is_inner() {
            self.0 + nodes as u32
        } else {
            self.0
        })
    }

    #[inline(always)]
    pub(super) fn is_inner(self) -> bool {
        self.0 < 1 << Self::BITS
    }

    /// The node or first slot.
    #[inline(always)]
    pub(super) fn index(self) -> usize {
        (self.0 & (Self::LIMIT as u32 - 1)) as usize
    }

    #[inline(always)]
    pub(super) fn kind(self) -> Kind {
        let index = self.index();
        match (self.0 >> Self::BITS) as usize {
            0 => Kind::Inner(index),
            count if count <= WIDTH => Kind::Triangles(index, count),
            count => Kind::Mixed(index, count - WIDTH),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_child_is_what_it_was_made_of() {
        for kind in [
            Kind::Inner(0),
            Kind::Inner(Child::LIMIT - 1),
            Kind::Triangles(5, 1),
            Kind::Triangles(Child::LIMIT - 1, 8),
            Kind::Mixed(0, 1),
            Kind::Mixed(Child::LIMIT - 1, 7),
        ] {
            let child = Child::new(kind);
            assert_eq!(child.kind(), kind);
            assert_eq!(child.is_inner(), matches!(kind, Kind::Inner(_)));
        }
    }
}
