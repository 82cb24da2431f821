//! From a binary hierarchy to one of eight children a node.
//!
//! Ylitie, Karras, Laine, *Efficient incoherent ray traversal on GPUs through compressed wide BVHs*, HPG 2017,
//! section 3.1: of all ways to take inner nodes of the binary hierarchy out, the one of least cost by the
//! surface area heuristic, found by dynamic programming from the leaves up.

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
        let opaque = geometry
            .shapes()
            .iter()
            .any(|shape| !matches!(shape, Shape::Triangles(_)));
        let mut builder = Builder {
            tree,
            items,
            geometry,
            most: if opaque { WIDTH - 1 } else { WIDTH },
            costs: vec![[0.0; WIDTH - 1]; tree.nodes.len()],
        };
        builder.prepare(0);
        let root = builder.child(&mut wide, 0, 0);
        wide.root = Some(root);
        wide.cost /= f64::from(tree.nodes[0].aabb.half_area().max(f32::MIN_POSITIVE));
        wide.numbers.resize(wide.numbers.len() + WINDOW, 0.0);
        wide.nodes.shrink_to_fit();
        wide
    }
}

/// Time of a step into a node.
const NODE: f32 = 1.0;

/// Time of a step into a leaf, and of each triangle there.
const LEAF: (f32, f32) = (0.9, 0.05);

struct Builder<'a> {
    tree: &'a Tree,
    items: &'a Items,
    geometry: &'a Geometry,
    /// Most elements of a leaf.
    most: usize,
    /// By binary node, by i: the least cost of all below it as `i + 1` children of some wide node at most.
    costs: Vec<[f32; WIDTH - 1]>,
}

impl Builder<'_> {
    /// Fills `costs`, children before parents; returns the number of elements below a node.
    fn prepare(&mut self, node: u32) -> usize {
        let binary = &self.tree.nodes[node as usize];
        let area = binary.aabb.half_area();
        let most = self.most;
        let leaf = |count: usize| {
            if count <= most {
                area * (LEAF.0 + LEAF.1 * count as f32)
            } else {
                f32::INFINITY
            }
        };
        match binary.kind {
            BinaryKind::Leaf(_, count) => {
                self.costs[node as usize] = [leaf(count as usize); WIDTH - 1];
                count as usize
            }
            BinaryKind::Inner(second) => {
                let count = self.prepare(node + 1) + self.prepare(second);
                let mut costs = [0.0; WIDTH - 1];
                let inner = NODE * area + self.split(node + 1, second, WIDTH).0;
                costs[0] = inner.min(leaf(count));
                for i in 1..WIDTH - 1 {
                    costs[i] = self.split(node + 1, second, i + 1).0.min(costs[i - 1]);
                }
                self.costs[node as usize] = costs;
                count
            }
        }
    }

    /// The least cost of two binary nodes as `places` children at most, and how many are the first's.
    fn split(&self, first: u32, second: u32, places: usize) -> (f32, usize) {
        let (a, b) = (&self.costs[first as usize], &self.costs[second as usize]);
        let mut best = (f32::INFINITY, 1);
        for of_first in 1..places {
            let cost = a[of_first - 1] + b[places - of_first - 1];
            if cost < best.0 {
                best = (cost, of_first);
            }
        }
        best
    }

    /// Adds the children that a binary node becomes in `places` places at most.
    fn choose(&self, node: u32, places: usize, children: &mut [u32; WIDTH], count: &mut usize) {
        let costs = &self.costs[node as usize];
        let fewest = (1..places)
            .find(|&i| costs[i - 1] <= costs[places - 1])
            .unwrap_or(places);
        match self.tree.nodes[node as usize].kind {
            BinaryKind::Inner(second) if fewest > 1 => {
                let (_, of_first) = self.split(node + 1, second, fewest);
                self.choose(node + 1, of_first, children, count);
                self.choose(second, fewest - of_first, children, count);
            }
            _ => {
                children[*count] = node;
                *count += 1;
            }
        }
    }

    /// Appends what is below a binary node.
    fn child(&self, wide: &mut Wide, node: u32, depth: usize) -> Child {
        wide.depth = wide.depth.max(depth);
        let aabb = self.aabb(node);
        wide.cost += f64::from(aabb.half_area());
        let (first, count) = self.range(node);
        let BinaryKind::Inner(second) = self.tree.nodes[node as usize].kind else {
            return self.leaf(wide, first, count);
        };
        let (cost, of_first) = self.split(node + 1, second, WIDTH);
        if count <= self.most && self.costs[node as usize][0] < NODE * aabb.half_area() + cost {
            return self.leaf(wide, first, count);
        }
        let (mut children, mut count) = ([0u32; WIDTH], 0);
        self.choose(node + 1, of_first, &mut children, &mut count);
        self.choose(second, WIDTH - of_first, &mut children, &mut count);
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
            node.children[i] = child.0;
        }
        Child::new(Kind::Inner(index))
    }

    fn aabb(&self, node: u32) -> Box4 {
        self.tree.nodes[node as usize].aabb
    }

    /// The items below a node: first and number.
    fn range(&self, node: u32) -> (usize, usize) {
        let end = |mut node: u32| loop {
            match self.tree.nodes[node as usize].kind {
                BinaryKind::Inner(second) => node = second,
                BinaryKind::Leaf(first, count) => return (first + count) as usize,
            }
        };
        let mut start = node;
        loop {
            match self.tree.nodes[start as usize].kind {
                BinaryKind::Inner(_) => start += 1,
                BinaryKind::Leaf(first, _) => return (first as usize, end(node) - first as usize),
            }
        }
    }

    fn leaf(&self, wide: &mut Wide, first: usize, count: usize) -> Child {
        let start = wide.slots.len();
        let items = &self.tree.items[first..][..count];
        wide.leaves += 1;
        let elements = items
            .iter()
            .map(|item| self.items.element(self.geometry, item.number()));
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
