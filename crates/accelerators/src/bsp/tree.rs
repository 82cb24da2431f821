//! The tree in memory, and its traversal.
//!
//! Front to back, with a ray interval for each cell (t_min, t*, t_max of the lecture notes; Havran,
//! *Heuristic ray shooting algorithms*, 2000, appendix C). The ray is padded to cover rounding
//! errors (see `elements`): it enters the far side of a plane before it leaves the near side, so
//! the intervals overlap slightly.

use crate::support::elements::{Item, Mailbox, Structure, Visitor, WideRay, bounds};
use crate::support::partition::{Content, Cut, MAX_DEPTH, Tree};
use crate::support::polyhedron::{Plane, Polyhedron};
use whitstone_core::{Aabb, DebugBounds, Element, Statistics};

/// The tree.
pub(super) struct Partition {
    /// Bounds of all elements.
    bounds: Aabb,
    /// The nodes; the root is node 0.
    nodes: Vec<Node>,
    /// Element indices of all leaves.
    references: Vec<u32>,
    elements: Vec<Element>,
    depth: usize,
    sah_cost: f64,
}

#[derive(Clone, Copy, Debug)]
enum Node {
    /// Two consecutive children, the first below the plane.
    Inner { cut: Plane, children: u32 },
    /// A range of references.
    Leaf { first: u32, count: u32 },
}

const _: () = assert!(size_of::<Node>() == 40);

impl Partition {
    pub(super) fn new(items: &[Item], tree: &Tree<Plane>) -> Self {
        let bounds = bounds(items);
        let mut built = Self {
            bounds,
            nodes: vec![Node::Leaf { first: 0, count: 0 }],
            references: Vec::new(),
            elements: items.iter().map(|item| item.element).collect(),
            depth: tree.depth(),
            // Normalized by the root's area, which may be zero.
            sah_cost: tree.cost / bounds.half_area().max(f64::MIN_POSITIVE),
        };
        built.flatten(tree, 0);
        built
    }

    /// Writes the root of a subtree to `place` and appends its descendants.
    fn flatten(&mut self, tree: &Tree<Plane>, place: usize) {
        self.nodes[place] = match &tree.content {
            Content::Leaf(held) => {
                let first = self.references.len() as u32;
                self.references.extend(held);
                Node::Leaf {
                    first,
                    count: held.len() as u32,
                }
            }
            Content::Inner(cut, children) => {
                let next = self.nodes.len();
                self.nodes.extend([Node::Leaf { first: 0, count: 0 }; 2]);
                for (side, child) in children.iter().enumerate() {
                    self.flatten(child, next + side);
                }
                Node::Inner {
                    cut: *cut,
                    children: next as u32,
                }
            }
        };
    }

    fn outline(
        &self,
        node: u32,
        cell: &Polyhedron,
        depth: usize,
        deepest: usize,
        found: &mut Vec<DebugBounds>,
    ) {
        found.push(DebugBounds {
            depth,
            segments: cell.edges(),
        });
        if let Node::Inner { cut, children } = &self.nodes[node as usize]
            && depth < deepest
        {
            for (child, cell) in (*children..).zip(&cut.halves(cell)) {
                self.outline(child, cell, depth + 1, deepest, found);
            }
        }
    }
}

/// A deferred cell: its node and the ray interval in it.
type Later = (u32, f64, f64);

impl Structure for Partition {
    #[inline]
    fn visit(&self, ray: &WideRay, min: f64, mut limit: f64, visitor: &mut impl Visitor) -> Option<f64> {
        let Some((mut near, mut far)) = ray.inside(&self.bounds, min, limit) else {
            return Some(limit);
        };
        let mut mailbox = Mailbox::new();
        let mut stack: [Later; MAX_DEPTH] = [(0, 0.0, 0.0); MAX_DEPTH];
        let (mut height, mut node) = (0, 0);
        loop {
            match self.nodes[node as usize] {
                Node::Inner { cut, children } => {
                    visitor.step();
                    let along = ray.along(cut.normal);
                    let (leaves, arrives) = (along.leaves(cut.at), along.arrives(cut.at));
                    let side = u32::from(along.backwards);
                    let (before, beyond) = (children + side, children + 1 - side);
                    // t* of the lecture notes; a padded ray has two. NaN changes nothing. The
                    // methods `min` and `max` would do the same, but take four instructions each
                    // instead of one.
                    let leaves = if leaves < far { leaves } else { far };
                    let arrives = if arrives > near { arrives } else { near };
                    match (near <= leaves, arrives <= far) {
                        (true, true) => {
                            stack[height] = (beyond, arrives, far);
                            height += 1;
                            (node, far) = (before, leaves);
                            continue;
                        }
                        (true, false) => {
                            (node, far) = (before, leaves);
                            continue;
                        }
                        (false, true) => {
                            (node, near) = (beyond, arrives);
                            continue;
                        }
                        (false, false) => {}
                    }
                }
                Node::Leaf { first, count } => {
                    for &element in &self.references[first as usize..(first + count) as usize] {
                        if mailbox.is_new(element) {
                            limit = visitor.test(self.elements[element as usize])?;
                        }
                    }
                }
            }
            loop {
                if height == 0 {
                    return Some(limit);
                }
                height -= 1;
                (node, near, far) = stack[height];
                // `<=`: at equal distance an element of lower index may follow, which wins the tie.
                if near <= limit {
                    break;
                }
            }
        }
    }

    fn statistics(&self) -> Statistics {
        let askew = |node: &&Node| matches!(node, Node::Inner { cut, .. } if is_askew(cut));
        let empty = |node: &&Node| matches!(node, Node::Leaf { count: 0, .. });
        let leaf = |node: &&Node| matches!(node, Node::Leaf { .. });
        let count = |which: &dyn Fn(&&Node) -> bool| self.nodes.iter().filter(which).count() as f64;
        let bytes = size_of_val(&*self.nodes) + size_of_val(&*self.references) + size_of_val(&*self.elements);
        Statistics::from([
            ("nodes", self.nodes.len() as f64 - count(&leaf)),
            ("askew", count(&askew)),
            ("leaves", count(&leaf)),
            ("empty_leaves", count(&empty)),
            ("references", self.references.len() as f64),
            ("depth", self.depth as f64),
            ("sah_cost", self.sah_cost),
            ("bytes", bytes as f64),
        ])
    }

    fn debug_bounds(&self, deepest: usize) -> Vec<DebugBounds> {
        let mut found = Vec::new();
        if !self.elements.is_empty() {
            self.outline(0, &Polyhedron::of_box(&self.bounds), 0, deepest, &mut found);
        }
        found
    }
}

/// Whether a plane is not axis-parallel.
fn is_askew(plane: &Plane) -> bool {
    plane.normal.abs().max_element() < 1.0
}
