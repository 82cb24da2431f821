//! References from nodes to nodes and leaves.

/// Maximum number of triangles in a leaf, and of children of a node.
pub(crate) const WIDTH: usize = 8;

/// An inner node, a leaf of triangles, or a leaf of any elements, packed into 32 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Child(pub(crate) u32);

/// What a [`Child`] is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Inner(usize),
    /// First slot and number of triangles, at most 8.
    Triangles(usize, usize),
    /// First slot and number of elements, at most 7.
    Mixed(usize, usize),
}

impl Child {
    const BITS: u32 = 28;

    /// Exclusive upper bound on the indices of slots and nodes.
    pub(crate) const LIMIT: usize = 1 << Self::BITS;

    /// Neither a node nor a leaf.
    pub(crate) const NONE: Self = Self(u32::MAX);

    pub(crate) fn new(kind: Kind) -> Self {
        let (tag, index) = match kind {
            Kind::Inner(node) => (0, node),
            Kind::Triangles(first, count) => (count, first),
            Kind::Mixed(first, count) => (count + WIDTH, first),
        };
        Self((tag as u32) << Self::BITS | index as u32)
    }

    /// The same reference once `nodes` other nodes precede those counted from 0; slots keep their
    /// indices.
    pub(crate) fn behind(self, nodes: usize) -> Self {
        Self(if self.is_inner() {
            self.0 + nodes as u32
        } else {
            self.0
        })
    }

    #[inline(always)]
    pub(crate) fn is_inner(self) -> bool {
        self.0 < 1 << Self::BITS
    }

    #[inline(always)]
    pub(crate) fn is_leaf(self) -> bool {
        !self.is_inner() & (self != Self::NONE)
    }

    /// The node or first slot.
    #[inline(always)]
    pub(crate) fn index(self) -> usize {
        (self.0 & (Self::LIMIT as u32 - 1)) as usize
    }

    /// Number of elements of a leaf; 0 for an inner node.
    #[inline(always)]
    pub(crate) fn elements(self) -> usize {
        match self.kind() {
            Kind::Inner(_) => 0,
            Kind::Triangles(_, count) | Kind::Mixed(_, count) => count,
        }
    }

    #[inline(always)]
    pub(crate) fn kind(self) -> Kind {
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
