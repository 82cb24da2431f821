//! Nodes, build and statistics of the hierarchies whose volumes are not axis-parallel boxes.

use crate::support::binary::{Builder, Tree};
use crate::support::elements::{Elements, Item};
use rayon::prelude::*;
use std::ops::Range;
use whitstone_core::{DAffine3, DebugBounds, Element, Geometry, Statistics};

/// A convex bounding volume.
pub(crate) trait Volume: Copy + Send + Sync {
    /// The smallest volume of this kind around some elements.
    fn around(items: &[Item], geometry: &Geometry) -> Self;

    /// The smallest volume around the contents of two others; `None` if it must be fitted to the
    /// elements themselves.
    fn joined(first: &Self, second: &Self) -> Option<Self>;

    /// The volume around the contents of this one, rotated and moved; `None` if that is not simpler
    /// than a new fit.
    fn moved(&self, _rigid: &DAffine3) -> Option<Self> {
        None
    }

    /// Half the surface area.
    fn half_area(&self) -> f64;

    /// Its edges.
    fn outline(&self, depth: usize) -> DebugBounds;
}

/// A binary hierarchy of volumes.
pub(crate) struct Hierarchy<V> {
    /// The nodes; the root is node 0.
    nodes: Vec<Node<V>>,
    /// Elements of all leaves, concatenated.
    elements: Vec<Element>,
    depth: usize,
    /// Cost of a traversal step in element tests.
    step_cost: f64,
}

#[derive(Clone, Copy)]
struct Node<V> {
    volume: V,
    /// Inner node: the first of two consecutive children. Leaf: the first of its elements.
    first: u32,
    /// Number of elements of a leaf; 0 for an inner node.
    count: u32,
}

/// Contents of a node.
pub(crate) enum Below<'a> {
    /// The first of two consecutive children.
    Children(u32),
    Elements(&'a [Element]),
}

impl<V: Volume> Hierarchy<V> {
    pub(crate) fn new(geometry: &Geometry, elements: Elements, builder: &Builder) -> Self {
        let mut items = elements.items;
        let mut depth = 0;
        let mut places = Vec::new();
        if !items.is_empty() {
            let tree = builder.build(&mut items);
            places.push(Place::of(&tree));
            lay_out(&tree, 0, &mut places, 0, &mut depth);
        }
        Self {
            nodes: nodes(&places, &items, geometry),
            elements: items.iter().map(|item| item.element).collect(),
            depth,
            step_cost: builder.step_cost,
        }
    }

    /// The same hierarchy around moved elements. `None` if some element is missing among them.
    pub(crate) fn refitted(
        &self,
        geometry: &Geometry,
        items: &[Item],
        rigid: Option<&DAffine3>,
    ) -> Option<Self> {
        // The padding of other elements does not move with them.
        let is_plain = |item: &Item| !item.sliver && matches!(item.element, Element::Triangle { .. });
        let moved = |rigid: &DAffine3| {
            let moved = |node: &Node<V>| {
                Some(Node {
                    volume: node.volume.moved(rigid)?,
                    ..*node
                })
            };
            self.nodes.par_iter().map(moved).collect::<Option<Vec<_>>>()
        };
        // Corners that are equal stay equal, so the same number of items means the same items.
        let same = items.len() == self.elements.len() && items.par_iter().all(is_plain);
        let nodes = match rigid.filter(|_| same).and_then(moved) {
            Some(nodes) => nodes,
            None => nodes(&self.places(), &self.moved_items(items)?, geometry),
        };
        Some(Self {
            nodes,
            elements: self.elements.clone(),
            depth: self.depth,
            step_cost: self.step_cost,
        })
    }

    /// The items in the order of the leaves, from the order of the geometry; `None` if one is
    /// missing.
    fn moved_items(&self, items: &[Item]) -> Option<Vec<Item>> {
        let key = |element: Element| match element {
            Element::Triangle { shape, triangle } => (shape, triangle),
            Element::Custom { shape } => (shape, 0),
        };
        let item = |element: &Element| {
            let place = items.binary_search_by_key(&key(*element), |item| key(item.element));
            Some(items[place.ok()?])
        };
        self.elements.par_iter().map(item).collect()
    }

    /// The nodes without their volumes.
    fn places(&self) -> Vec<Place> {
        let mut ranges = vec![0..0; self.nodes.len()];
        // Children follow their parents.
        for (number, node) in self.nodes.iter().enumerate().rev() {
            let first = node.first as usize;
            ranges[number] = match node.count {
                0 => ranges[first].start..ranges[first + 1].end,
                count => first..first + count as usize,
            };
        }
        let places = self.nodes.iter().zip(ranges);
        let place = |(node, range): (&Node<V>, Range<usize>)| Place {
            first: node.first,
            count: node.count,
            range,
        };
        places.map(place).collect()
    }

    /// The root; `None` if there are no elements.
    #[inline]
    pub(crate) fn root(&self) -> Option<u32> {
        (!self.nodes.is_empty()).then_some(0)
    }

    #[inline]
    pub(crate) fn volume(&self, node: u32) -> &V {
        &self.nodes[node as usize].volume
    }

    #[inline]
    pub(crate) fn below(&self, node: u32) -> Below<'_> {
        let Node { first, count, .. } = self.nodes[node as usize];
        if count == 0 {
            Below::Children(first)
        } else {
            Below::Elements(&self.elements[first as usize..][..count as usize])
        }
    }

    pub(crate) fn volumes(&self) -> impl Iterator<Item = &V> {
        self.nodes.iter().map(|node| &node.volume)
    }

    pub(crate) fn statistics(&self) -> Statistics {
        let leaves = self.nodes.iter().filter(|node| node.count > 0).count();
        let bytes = size_of_val(&*self.nodes) + size_of_val(&*self.elements);
        let cost = |node: &Node<V>| {
            let tests = if node.count == 0 {
                self.step_cost
            } else {
                f64::from(node.count)
            };
            tests * node.volume.half_area()
        };
        // Normalized by the root's area, which may be zero.
        let whole = self.nodes.first().map_or(0.0, |root| root.volume.half_area());
        let cost = self.nodes.iter().map(cost).sum::<f64>() / whole.max(f64::MIN_POSITIVE);
        Statistics::from([
            ("nodes", (self.nodes.len() - leaves) as f64),
            ("leaves", leaves as f64),
            ("depth", self.depth as f64),
            ("sah_cost", cost),
            ("bytes", bytes as f64),
        ])
    }

    pub(crate) fn debug_bounds(&self, deepest: usize) -> Vec<DebugBounds> {
        let mut found = Vec::new();
        let mut waiting: Vec<(u32, usize)> = self.root().map(|root| (root, 0)).into_iter().collect();
        while let Some((node, depth)) = waiting.pop() {
            found.push(self.volume(node).outline(depth));
            if let Below::Children(first) = self.below(node)
                && depth < deepest
            {
                waiting.extend([first, first + 1].map(|child| (child, depth + 1)));
            }
        }
        found
    }
}

/// A node without its volume.
struct Place {
    /// As in [`Node`].
    first: u32,
    count: u32,
    /// The items of the subtree.
    range: Range<usize>,
}

impl Place {
    fn of(tree: &Tree) -> Self {
        let range = tree.range();
        let count = match tree {
            Tree::Leaf(_) => range.len() as u32,
            Tree::Inner(_) => 0,
        };
        Self {
            first: range.start as u32,
            count,
            range,
        }
    }
}

/// Appends the descendants of the node at `place`.
fn lay_out(tree: &Tree, place: usize, places: &mut Vec<Place>, depth: usize, deepest: &mut usize) {
    *deepest = depth.max(*deepest);
    if let Tree::Inner(children) = tree {
        let first = places.len();
        places[place].first = first as u32;
        places.extend(children.iter().map(|(_, child)| Place::of(child)));
        for (i, (_, child)) in children.iter().enumerate() {
            lay_out(child, first + i, places, depth + 1, deepest);
        }
    }
}

/// Fits the volumes, those of the leaves first.
fn nodes<V: Volume>(places: &[Place], items: &[Item], geometry: &Geometry) -> Vec<Node<V>> {
    let around = |place: &Place| V::around(&items[place.range.clone()], geometry);
    let leaf = |place: &Place| (place.count > 0).then(|| around(place));
    let mut volumes: Vec<Option<V>> = places.par_iter().map(leaf).collect();
    // Children follow their parents.
    for (number, place) in places.iter().enumerate().rev() {
        if let Some([Some(first), Some(second)]) =
            volumes.get(place.first as usize..).and_then(<[_]>::first_chunk)
            && place.count == 0
        {
            volumes[number] = V::joined(first, second);
        }
    }
    let node = |(place, volume): (&Place, &Option<V>)| Node {
        volume: volume.unwrap_or_else(|| around(place)),
        first: place.first,
        count: place.count,
    };
    places.par_iter().zip(&volumes).map(node).collect()
}
