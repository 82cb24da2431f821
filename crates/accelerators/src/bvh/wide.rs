//! Collapses a binary hierarchy into one with eight children a node.
//!
//! Ylitie, Karras, Laine, *Efficient incoherent ray traversal on GPUs through compressed wide
//! BVHs*, HPG 2017, section 3.1: of all ways to remove inner nodes of the binary hierarchy, this
//! takes the one of least SAH cost, found by dynamic programming from the leaves up.
//!
//! The nodes at the top are made first, then the subtrees below them, each by itself. This division
//! depends on the hierarchy only, so the result does not depend on the number of threads.

use super::node::Node;
use super::tree::Binary;
use crate::support::leaves::child::{Child, Kind, WIDTH};
use crate::support::leaves::filter::NUMBERS;
use crate::support::leaves::items::Contents;
use crate::support::leaves::{Slot, by_coordinate};
use rayon::prelude::*;

/// Subtrees of at most this many items are made by one thread.
const PART: usize = 4096;

/// The wide hierarchy.
#[derive(Default)]
pub(super) struct Wide {
    pub(super) nodes: Vec<Node>,
    /// Elements of all leaves, concatenated.
    pub(super) slots: Vec<Slot>,
    /// The corners of the triangles of `slots` in local coordinates; see `filter`.
    pub(super) numbers: Vec<f32>,
    pub(super) root: Option<Child>,
    pub(super) leaves: usize,
    pub(super) depth: usize,
    /// SAH cost: expected number of nodes and leaves visited by a ray that hits the root's box.
    pub(super) cost: f64,
}

impl Wide {
    /// Builds from the nodes of a binary hierarchy and the contents of its leaves.
    pub(super) fn new(binary: &[Binary], contents: Contents) -> Self {
        if binary.is_empty() {
            return Self::default();
        }
        let Contents { slots, corners } = contents;
        let mut numbers = corners.into_flattened();
        let mixed = slots.par_iter().with_min_len(PART).any(|slot| slot.is_custom());
        let most = if mixed { WIDTH - 1 } else { WIDTH };
        let mut costs = vec![[0.0; WIDTH - 1]; binary.len()];
        prepare(binary, &mut costs, most);
        let maker = Maker {
            binary,
            costs: &costs,
            slots: &slots,
            mixed,
            most,
        };
        let mut top = Top::default();
        maker.top(&mut top, Place::default(), None);
        let mut rest = numbers.as_mut_slice();
        let mut parts = Vec::with_capacity(top.below.len());
        for (place, _) in &top.below {
            // Together the parts hold all items, in order.
            let length = NUMBERS * binary[place.node].count();
            let numbers = rest.split_off_mut(..length).unwrap_or_default();
            parts.push((*place, numbers));
        }
        let parts = parts.into_par_iter().map(|(place, numbers)| {
            let mut part = Part::default();
            part.root = maker.part(&mut part, place, numbers);
            part
        });
        let parts: Vec<Part> = parts.collect();
        top.join(&parts, &binary[0], slots, numbers)
    }
}

/// Cost of a step into a node.
const NODE: f32 = 1.0;

/// Cost of a step into a leaf, and of each triangle in it.
const LEAF: (f32, f32) = (0.9, 0.05);

/// Entry `i` is the least cost of a binary subtree that becomes at most `i + 1` children of a wide
/// node.
type Costs = [f32; WIDTH - 1];

/// Cost of `count` items as one leaf; infinite if there are more than `most`.
fn leaf_cost(area: f32, count: usize, most: usize) -> f32 {
    if count <= most {
        area * (LEAF.0 + LEAF.1 * count as f32)
    } else {
        f32::INFINITY
    }
}

/// Computes the costs of the nodes of a subtree, children before parents.
fn prepare(nodes: &[Binary], costs: &mut [Costs], most: usize) {
    let root = 0;
    if let Some(second) = nodes[root].second()
        && nodes.len() > PART
    {
        let (first_costs, second_costs) = costs[1..].split_at_mut(second - 1);
        rayon::join(
            || prepare(&nodes[1..second], first_costs, most),
            || prepare(&nodes[second..], second_costs, most),
        );
        costs[root] = own_costs(nodes, costs, root, most);
    } else {
        for node in (0..nodes.len()).rev() {
            costs[node] = own_costs(nodes, costs, node, most);
        }
    }
}

/// The costs of a node, from those of its children.
fn own_costs(nodes: &[Binary], costs: &[Costs], node: usize, most: usize) -> Costs {
    let binary = &nodes[node];
    let area = binary.aabb().half_area();
    let leaf = leaf_cost(area, binary.count(), most);
    let Some(second) = binary.second() else {
        return [leaf; WIDTH - 1];
    };
    let (first, second) = (&costs[node + 1], &costs[node + second]);
    // Indexed by the number of children minus two.
    let mut both = [f32::INFINITY; WIDTH - 1];
    for i in 0..WIDTH - 1 {
        for j in 0..WIDTH - 1 - i {
            both[i + j] = both[i + j].min(first[i] + second[j]);
        }
    }
    let inner = NODE * area + both[WIDTH - 2];
    let mut least = inner.min(leaf);
    let mut own = [least; WIDTH - 1];
    for i in 1..WIDTH - 1 {
        least = least.min(both[i - 1]);
        own[i] = least;
    }
    own
}

/// A subtree: its binary node, its first item, its depth in the wide hierarchy.
#[derive(Clone, Copy, Default)]
struct Place {
    node: usize,
    first: usize,
    depth: usize,
}

/// The wide nodes at the top of the hierarchy.
#[derive(Default)]
struct Top {
    nodes: Vec<Node>,
    /// The sum of the areas of their boxes.
    cost: f64,
    /// The subtrees below, in order, each with its parent node and its index among the children.
    below: Vec<(Place, Option<(usize, usize)>)>,
}

impl Top {
    /// Appends the nodes of the subtrees and links them to their parents.
    fn join(self, parts: &[Part], root: &Binary, slots: Vec<Slot>, numbers: Vec<f32>) -> Wide {
        let count = |part: &Part| part.nodes.len();
        let mut wide = Wide {
            nodes: Vec::with_capacity(self.nodes.len() + parts.iter().map(count).sum::<usize>()),
            root: Some(Child::new(Kind::Inner(0))),
            slots,
            numbers,
            cost: self.cost,
            ..Wide::default()
        };
        wide.nodes.extend(self.nodes);
        for (part, (_, parent)) in parts.iter().zip(self.below) {
            let start = wide.nodes.len();
            let child = part.root.behind(start);
            match parent {
                Some((node, i)) => wide.nodes[node].children[i] = child.0,
                None => wide.root = Some(child),
            }
            wide.nodes.extend(part.nodes.iter().map(|node| Node {
                children: node.children.map(|child| Child(child).behind(start).0),
                ..*node
            }));
            wide.leaves += part.leaves;
            wide.depth = wide.depth.max(part.depth);
            wide.cost += part.cost;
        }
        wide.cost /= f64::from(root.aabb().half_area().max(f32::MIN_POSITIVE));
        wide
    }
}

/// The wide nodes of a subtree, with indices relative to its first node.
#[derive(Default)]
struct Part {
    nodes: Vec<Node>,
    root: Child,
    leaves: usize,
    depth: usize,
    cost: f64,
}

struct Maker<'a> {
    binary: &'a [Binary],
    costs: &'a [Costs],
    slots: &'a [Slot],
    /// Whether some element is not a triangle.
    mixed: bool,
    /// Maximum number of items in a leaf.
    most: usize,
}

impl Maker<'_> {
    /// Builds the nodes at the top; `parent` is the parent of the first one and the child index in
    /// it.
    fn top(&self, top: &mut Top, place: Place, parent: Option<(usize, usize)>) {
        let binary = &self.binary[place.node];
        let Some(second) = binary.second().filter(|_| binary.count() > PART) else {
            top.below.push((place, parent));
            return;
        };
        top.cost += f64::from(binary.aabb().half_area());
        let (children, node) = self.node(place.node + 1, place.node + second);
        let index = top.nodes.len();
        top.nodes.push(node);
        if let Some((parent, i)) = parent {
            top.nodes[parent].children[i] = Child::new(Kind::Inner(index)).0;
        }
        for (i, place) in self.places(&children, place).enumerate() {
            self.top(top, place, Some((index, i)));
        }
    }

    /// Appends the subtree of a binary node; `numbers` are those of its items.
    fn part(&self, part: &mut Part, place: Place, numbers: &mut [f32]) -> Child {
        let binary = &self.binary[place.node];
        let area = binary.aabb().half_area();
        part.depth = part.depth.max(place.depth);
        part.cost += f64::from(area);
        // Divide only if that costs less than a leaf.
        let leaf = leaf_cost(area, binary.count(), self.most);
        let second = binary.second().filter(|_| self.costs[place.node][0] < leaf);
        let Some(second) = second else {
            part.leaves += 1;
            return self.leaf(place.first, binary.count(), numbers);
        };
        let (children, node) = self.node(place.node + 1, place.node + second);
        let index = part.nodes.len();
        part.nodes.push(node);
        let mut rest = numbers;
        for (i, place) in self.places(&children, place).enumerate() {
            let length = NUMBERS * self.binary[place.node].count();
            let (numbers, behind) = rest.split_at_mut(length);
            rest = behind;
            part.nodes[index].children[i] = self.part(part, place, numbers).0;
        }
        Child::new(Kind::Inner(index))
    }

    /// The children of the wide node over two binary nodes, and the node with their boxes but
    /// without references to them.
    fn node(&self, first: usize, second: usize) -> (Children, Node) {
        let mut children = Children::default();
        self.divide(first, second, WIDTH, &mut children);
        let mut node = Node::EMPTY;
        for (i, &child) in children.nodes[..children.count].iter().enumerate() {
            let aabb = self.binary[child].aabb();
            let (min, max) = (aabb.min.to_array(), aabb.max.to_array());
            for axis in 0..3 {
                node.planes[axis][0][i] = min[axis];
                node.planes[axis][1][i] = max[axis];
            }
        }
        (children, node)
    }

    /// Adds the children that two binary nodes become, at most `places` in total.
    fn divide(&self, first: usize, second: usize, places: usize, children: &mut Children) {
        let (a, b) = (&self.costs[first], &self.costs[second]);
        let (mut least, mut of_first) = (f32::INFINITY, 1);
        for i in 1..places {
            let cost = a[i - 1] + b[places - i - 1];
            if cost < least {
                (least, of_first) = (cost, i);
            }
        }
        self.choose(first, of_first, children);
        self.choose(second, places - of_first, children);
    }

    /// Adds the children that a binary node becomes, at most `places`.
    fn choose(&self, node: usize, places: usize, children: &mut Children) {
        let costs = &self.costs[node];
        let fewest = (1..places)
            .find(|&i| costs[i - 1] <= costs[places - 1])
            .unwrap_or(places);
        match self.binary[node].second() {
            Some(second) if fewest > 1 => self.divide(node + 1, node + second, fewest, children),
            _ => {
                children.nodes[children.count] = node;
                children.count += 1;
            }
        }
    }

    /// The subtrees of the children of the wide node over a subtree.
    fn places(&self, children: &Children, Place { first, depth, .. }: Place) -> impl Iterator<Item = Place> {
        let mut next = first;
        children.nodes.into_iter().take(children.count).map(move |node| {
            let first = next;
            next += self.binary[node].count();
            Place {
                node,
                first,
                depth: depth + 1,
            }
        })
    }

    /// Makes a leaf of `count` items and reorders their numbers by coordinate.
    fn leaf(&self, first: usize, count: usize, numbers: &mut [f32]) -> Child {
        by_coordinate(numbers, count);
        let slots = &self.slots[first..][..count];
        Child::new(if self.mixed && slots.iter().any(|slot| slot.is_custom()) {
            Kind::Mixed(first, count)
        } else {
            Kind::Triangles(first, count)
        })
    }
}

/// The binary nodes that become the children of a wide one.
#[derive(Default)]
struct Children {
    nodes: [usize; WIDTH],
    count: usize,
}
