//! The binary hierarchy that a build makes first.

use super::items::{Box4, Item};

/// A binary hierarchy over items.
pub(super) struct Tree {
    /// In depth-first order: the first child of a node follows it. The root is 0.
    pub(super) nodes: Vec<Binary>,
    /// In the order of the leaves. An element may be there more than once, in parts.
    pub(super) items: Vec<Item>,
}

impl Tree {
    /// Puts another one behind this; its root is where this one's nodes end.
    pub(super) fn append(&mut self, other: Self) {
        append(&mut self.nodes, other.nodes, self.items.len() as u32);
        self.items.extend(other.items);
    }
}

/// Puts nodes behind others, with their leaves moved on by `items`.
pub(super) fn append(nodes: &mut Vec<Binary>, behind: Vec<Binary>, items: u32) {
    let first = nodes.len() as u32;
    nodes.extend(behind.into_iter().map(|node| Binary {
        kind: match node.kind {
            BinaryKind::Inner(second) => BinaryKind::Inner(second + first),
            BinaryKind::Leaf(start, count) => BinaryKind::Leaf(start + items, count),
        },
        ..node
    }));
}

/// A node.
#[derive(Clone, Copy, Debug)]
pub(super) struct Binary {
    pub(super) aabb: Box4,
    pub(super) kind: BinaryKind,
}

/// What is in a node.
#[derive(Clone, Copy, Debug)]
pub(super) enum BinaryKind {
    /// The second child.
    Inner(u32),
    /// First item and their number.
    Leaf(u32, u32),
}
