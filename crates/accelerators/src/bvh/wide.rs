//! From a binary hierarchy to one of eight children a node.
//!
//! Wald, Benthin, Boulos, *Getting rid of packets*, 2008: a node takes the children of those children whose
//! boxes are largest, until it has eight.

use super::filter::{NUMBERS, WINDOW};
use super::items::{Box4, Items};
use super::node::{Child, Kind, Node, WIDTH};
use super::search::Slot;
use super::tree::{BinaryKind, Tree};
use whitstone_core::{Element, Geometry, Shape};

/// The wide hierarchy.
#[derive(Default)]
pub(super) struct Wide {
    pub(super) nodes: Vec<Node>,
    /// What the leaves hold, leaf after leaf.
    pub(super) slots: Vec<Slot>,
    /// The corners of the triangles of `slots` in own coordinates; see `filter`.
    pub(super) numbers: Vec<f32>,
    pub(super) root: Option<Child>,
    pub(super) leaves: usize,
    pub(super) depth: usize,
    /// Surface area heuristic: nodes and leaves that a ray through the whole meets, in the mean.
    pub(super) cost: f64,
}

impl Wide {
    pub(super) fn new(tree: &Tree, items: &Items, geometry: &Geometry) -> Self {
        let mut wide = Self::default();
        if tree.nodes.is_empty() {
            return wide;
        }
        wide.slots.reserve(tree.items.len());
        wide.numbers.reserve(tree.items.len() * NUMBERS + WINDOW);
        let builder = Builder { tree, items, geometry };
        let root = builder.child(&mut wide, 0, 0);
        wide.root = Some(root);
        wide.cost /= f64::from(tree.nodes[0].aabb.half_area().max(f32::MIN_POSITIVE));
        wide.numbers.resize(wide.numbers.len() + WINDOW, 0.0);
        wide.nodes.shrink_to_fit();
        wide
    }
}

struct Builder<'a> {
    tree: &'a Tree,
    items: &'a Items,
    geometry: &'a Geometry,
}

impl Builder<'_> {
    /// Appends what is below a binary node.
    fn child(&self, wide: &mut Wide, node: u32, depth: usize) -> Child {
        wide.depth = wide.depth.max(depth);
        let binary = &self.tree.nodes[node as usize];
        wide.cost += f64::from(binary.aabb.half_area());
        let BinaryKind::Inner(second) = binary.kind else {
            return self.leaf(wide, node);
        };
        let mut children = [0u32; WIDTH];
        children[..2].copy_from_slice(&[node + 1, second]);
        let mut count = 2;
        while count < WIDTH {
            let area = |i: usize| self.aabb(children[i]).half_area();
            let inner = (0..count).filter(|&i| self.second(children[i]).is_some());
            let Some(largest) = inner.max_by(|&i, &j| area(i).total_cmp(&area(j))) else {
                break;
            };
            let opened = children[largest];
            children[largest] = opened + 1;
            children[count] = self.second(opened).unwrap_or_default();
            count += 1;
        }
        let index = wide.nodes.len();
        wide.nodes.push(Node::EMPTY);
        for (i, &child) in children[..count].iter().enumerate() {
            let aabb = self.aabb(child);
            let child = self.child(wide, child, depth + 1);
            let node = &mut wide.nodes[index];
            for axis in 0..3 {
                node.planes[axis][0][i] = aabb.min[axis];
                node.planes[axis][1][i] = aabb.max[axis];
            }
            node.children[i] = child;
        }
        Child::new(Kind::Inner(index))
    }

    fn aabb(&self, node: u32) -> Box4 {
        self.tree.nodes[node as usize].aabb
    }

    fn second(&self, node: u32) -> Option<u32> {
        match self.tree.nodes[node as usize].kind {
            BinaryKind::Inner(second) => Some(second),
            BinaryKind::Leaf(..) => None,
        }
    }

    fn leaf(&self, wide: &mut Wide, node: u32) -> Child {
        let BinaryKind::Leaf(first, count) = self.tree.nodes[node as usize].kind else {
            return Child::default();
        };
        let (start, count) = (wide.slots.len(), count as usize);
        let items = &self.tree.items[first as usize..][..count];
        wide.leaves += 1;
        let elements = items.iter().map(|item| self.items.element(self.geometry, item.number()));
        wide.slots.extend(elements.map(Slot::new));
        let numbers = wide.numbers.len();
        wide.numbers.resize(numbers + count * NUMBERS, 0.0);
        let mut kind = Kind::Triangles(start, count);
        for i in 0..count {
            let Element::Triangle { shape, triangle } = wide.slots[start + i].element() else {
                kind = Kind::Mixed(start, count);
                break;
            };
            let Shape::Triangles(mesh) = &self.geometry.shapes()[shape as usize] else {
                continue;
            };
            for (corner, p) in mesh.corners(triangle).into_iter().enumerate() {
                let p = self.items.frame.point(p).as_vec3();
                for axis in 0..3 {
                    wide.numbers[numbers + (3 * corner + axis) * count + i] = p[axis];
                }
            }
        }
        Child::new(kind)
    }
}
