//! Collapses a binary hierarchy into one with up to `N` children a node.
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
use crate::support::leaves::items::Box4;
use crate::support::leaves::{Number, Slot, by_coordinate};
use rayon::prelude::*;

/// Subtrees of at most this many items are made by one thread.
const PART: usize = 4096;

/// The wide hierarchy.
#[derive(Default)]
pub(super) struct Wide<const N: usize> {
    pub(super) nodes: Vec<Node<N>>,
    pub(super) root: Option<Child>,
    pub(super) leaves: usize,
    pub(super) depth: usize,
    /// SAH cost: expected number of nodes and leaves visited by a ray that hits the root's box.
    pub(super) cost: f64,
}

impl<const N: usize> Wide<N> {
    /// Builds from the nodes of a binary hierarchy and the elements of its leaves. Reorders their
    /// numbers by coordinate in each leaf.
    pub(super) fn new<T: Number>(binary: &[Binary], slots: &[Slot], numbers: &mut [T]) -> Self {
        if binary.is_empty() {
            return Self::default();
        }
        let mixed = slots.par_iter().with_min_len(PART).any(|slot| slot.is_custom());
        let most = if mixed { WIDTH - 1 } else { WIDTH };
        let mut costs = vec![[0.0; N]; binary.len()];
        prepare(binary, &mut costs, most);
        let maker = Maker {
            binary,
            costs: &costs,
            slots,
            mixed,
            most,
        };
        let mut top = Top::default();
        maker.top(&mut top, Place::default(), None);
        let mut rest = numbers;
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
        let parts: Vec<Part<N>> = parts.collect();
        top.join(&parts, &binary[0])
    }
}

impl<const N: usize> Wide<N> {
    /// Fits the boxes of all nodes anew; `boxes` are those of the elements of all leaves, in order.
    pub(super) fn refit(&mut self, boxes: &[Box4]) {
        let Some(root) = self.root else { return };
        let around = |first: usize, count: usize| {
            let items = boxes[first..][..count].iter();
            items.fold(Box4::EMPTY, |whole, aabb| whole.union(*aabb))
        };
        let leaf = |child: Child| match child.kind() {
            Kind::Inner(_) => None,
            Kind::Triangles(first, count) | Kind::Mixed(first, count) => Some(around(first, count)),
        };
        self.nodes.par_iter_mut().with_min_len(PART).for_each(|node| {
            for i in node.used() {
                if let Some(aabb) = leaf(Child(node.children[i])) {
                    node.set(i, aabb);
                }
            }
        });
        // Children follow their parents.
        for number in (0..self.nodes.len()).rev() {
            for i in self.nodes[number].used() {
                if let Kind::Inner(child) = Child(self.nodes[number].children[i]).kind() {
                    let aabb = self.nodes[child].whole();
                    self.nodes[number].set(i, aabb);
                }
            }
        }
        let whole = leaf(root).unwrap_or_else(|| self.nodes[root.index()].whole());
        let area = |aabb: Box4| f64::from(aabb.half_area());
        let children = self
            .nodes
            .iter()
            .flat_map(|node| node.used().map(|i| area(node.get(i))));
        self.cost = (area(whole) + children.sum::<f64>()) / area(whole).max(f64::from(f32::MIN_POSITIVE));
    }

    /// The slots of all leaves: the first and the number, in order.
    pub(super) fn leaves(&self) -> Vec<(usize, usize)> {
        let inside = self
            .nodes
            .iter()
            .flat_map(|node| node.used().map(|i| Child(node.children[i])));
        let all = self.root.into_iter().chain(inside);
        let mut leaves: Vec<(usize, usize)> = all
            .filter_map(|child| match child.kind() {
                Kind::Inner(_) => None,
                Kind::Triangles(first, count) | Kind::Mixed(first, count) => Some((first, count)),
            })
            .collect();
        leaves.sort_unstable();
        leaves
    }
}

/// Cost of a step into a node.
const NODE: f32 = 1.0;

/// Cost of a step into a leaf, and of each triangle in it.
const LEAF: (f32, f32) = (0.9, 0.05);

/// Entry `i` is the least cost of a binary subtree that becomes at most `i + 1` children of a wide
/// node.
type Costs<const N: usize> = [f32; N];

/// Cost of `count` items as one leaf; infinite if there are more than `most`.
fn leaf_cost(area: f32, count: usize, most: usize) -> f32 {
    if count <= most {
        area * (LEAF.0 + LEAF.1 * count as f32)
    } else {
        f32::INFINITY
    }
}

/// Computes the costs of the nodes of a subtree, children before parents.
fn prepare<const N: usize>(nodes: &[Binary], costs: &mut [Costs<N>], most: usize) {
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
fn own_costs<const N: usize>(nodes: &[Binary], costs: &[Costs<N>], node: usize, most: usize) -> Costs<N> {
    let binary = &nodes[node];
    let area = binary.aabb().half_area();
    let leaf = leaf_cost(area, binary.count(), most);
    let Some(second) = binary.second() else {
        return [leaf; N];
    };
    let (first, second) = (&costs[node + 1], &costs[node + second]);
    // Entry `i` is the least cost of `i + 1` children or fewer, with at least one from each side.
    let mut both = [f32::INFINITY; N];
    for i in 0..N - 1 {
        for j in 0..N - 1 - i {
            both[i + j + 1] = both[i + j + 1].min(first[i] + second[j]);
        }
    }
    let inner = NODE * area + both[N - 1];
    let mut least = inner.min(leaf);
    both.map(|both| {
        least = least.min(both);
        least
    })
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
struct Top<const N: usize> {
    nodes: Vec<Node<N>>,
    /// The sum of the areas of their boxes.
    cost: f64,
    /// The subtrees below, in order, each with its parent node and its index among the children.
    below: Vec<(Place, Option<(usize, usize)>)>,
}

impl<const N: usize> Top<N> {
    /// Appends the nodes of the subtrees and links them to their parents.
    fn join(self, parts: &[Part<N>], root: &Binary) -> Wide<N> {
        let count = |part: &Part<N>| part.nodes.len();
        let mut wide = Wide {
            nodes: Vec::with_capacity(self.nodes.len() + parts.iter().map(count).sum::<usize>()),
            root: Some(Child::new(Kind::Inner(0))),
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
struct Part<const N: usize> {
    nodes: Vec<Node<N>>,
    root: Child,
    leaves: usize,
    depth: usize,
    cost: f64,
}

struct Maker<'a, const N: usize> {
    binary: &'a [Binary],
    costs: &'a [Costs<N>],
    slots: &'a [Slot],
    /// Whether some element is not a triangle.
    mixed: bool,
    /// Maximum number of items in a leaf.
    most: usize,
}

impl<const N: usize> Maker<'_, N> {
    /// Builds the nodes at the top; `parent` is the parent of the first one and the child index in
    /// it.
    fn top(&self, top: &mut Top<N>, place: Place, parent: Option<(usize, usize)>) {
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
    fn part<T: Number>(&self, part: &mut Part<N>, place: Place, numbers: &mut [T]) -> Child {
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
    fn node(&self, first: usize, second: usize) -> (Children<N>, Node<N>) {
        let mut children = Children::default();
        self.divide(first, second, N, &mut children);
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
    fn divide(&self, first: usize, second: usize, places: usize, children: &mut Children<N>) {
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
    fn choose(&self, node: usize, places: usize, children: &mut Children<N>) {
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
    fn places(
        &self,
        children: &Children<N>,
        Place { first, depth, .. }: Place,
    ) -> impl Iterator<Item = Place> {
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
    fn leaf<T: Number>(&self, first: usize, count: usize, numbers: &mut [T]) -> Child {
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
struct Children<const N: usize> {
    nodes: [usize; N],
    count: usize,
}

impl<const N: usize> Default for Children<N> {
    fn default() -> Self {
        Self {
            nodes: [0; N],
            count: 0,
        }
    }
}
