//! The tree in memory, and the way of a ray through it.
//!
//! In order, with an interval of the ray for each cell (the notes' t_min, t*, t_max; Havran,
//! *Heuristic ray shooting algorithms*, 2000, appendix C). The ray is as wide as rounding may need
//! (see `elements`), so it arrives at a plane before it leaves the side before, and the intervals
//! overlap a little.

use crate::elements::{Item, Mailbox, Structure, Visitor, WideRay, bounds};
use crate::partition::{Content, Cut, MAX_DEPTH, Tree};
use crate::polyhedron::{Plane, Polyhedron};
use whitstone_core::{Aabb, Element, Outline, Statistics};

/// The tree.
pub(super) struct Partition {
    /// Around all elements.
    bounds: Aabb,
    /// The root is 0.
    nodes: Vec<Node>,
    /// What the leaves hold: indices of elements.
    references: Vec<u32>,
    elements: Vec<Element>,
    depth: usize,
    sah_cost: f64,
}

#[derive(Clone, Copy, Debug)]
enum Node {
    /// Two children side by side, the first below the plane.
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
            // Relative to the chance of hitting the whole; a flat point has none.
            sah_cost: tree.cost / bounds.half_area().max(f64::MIN_POSITIVE),
        };
        built.flatten(tree, 0);
        built
    }

    /// Puts a subtree at a place among the nodes, and what is below it behind all others.
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

    fn outline(&self, node: u32, cell: &Polyhedron, depth: usize, deepest: usize, found: &mut Vec<Outline>) {
        found.push(Outline {
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

/// A cell that is visited later: its node and the part of the ray in it.
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
                    // t* of the notes, which is two for a wide ray. A NaN changes nothing; the
                    // methods `min` and `max` would say so too, in four instructions each instead
                    // of one.
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
                // At equal distance an element of lower number may be in there.
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

    fn outlines(&self, deepest: usize) -> Vec<Outline> {
        let mut found = Vec::new();
        if !self.elements.is_empty() {
            self.outline(0, &Polyhedron::of_box(&self.bounds), 0, deepest, &mut found);
        }
        found
    }
}

/// Whether a plane follows no coordinate axis.
fn is_askew(plane: &Plane) -> bool {
    plane.normal.abs().max_element() < 1.0
}
