//! The build of the hierarchy.

use super::{Child, MAX_DEPTH, Node, Slot};
use std::ops::Range;
use whitstone_core::{Aabb, DVec3, Element, Geometry, Shape};

/// Time of a step down, in units of the time of one test of an element: measured on triangle meshes.
const STEP_COST: f64 = 0.7;

/// Bins for each axis.
const BINS: usize = 32;

/// Up to this number of elements every split is tried.
const SWEEP: usize = 24;

/// From this number of elements on both sides are built in parallel.
const PARALLEL: usize = 4096;

/// Boxes that reach farther are treated as endless: their areas would overflow.
const FARTHEST: f64 = 1e150;

/// What `Bvh2` is made of.
pub(super) struct Built {
    pub(super) nodes: Vec<Node>,
    pub(super) slots: Vec<Slot>,
    pub(super) unbounded: Vec<Element>,
    pub(super) root: Option<Child>,
    pub(super) reach: f64,
    pub(super) depth: usize,
    pub(super) sah_cost: f64,
}

/// An element during the build.
#[derive(Clone, Copy)]
struct Item {
    aabb: Aabb,
    center: DVec3,
    element: Element,
    /// Place in the order of the geometry: what makes sorting deterministic.
    number: u32,
}

enum Tree {
    Leaf(Range<usize>),
    Inner([(Aabb, Box<Tree>); 2]),
}

/// Builds over all elements. The result depends on the geometry only, not on the number of threads.
pub(super) fn build(geometry: &Geometry, max_leaf: usize) -> Built {
    let (mut items, mut unbounded) = (Vec::new(), Vec::new());
    let mut reach = 0.0f64;
    for (element, number) in geometry.elements().zip(0..) {
        let aabb = geometry.bounds(element);
        let far = aabb.min.abs().max(aabb.max.abs()).max_element();
        if aabb.is_empty() || far.is_nan() || far > FARTHEST {
            unbounded.push(element);
            continue;
        }
        reach = reach.max(far);
        items.push(Item {
            aabb,
            center: aabb.center(),
            element,
            number,
        });
    }
    for item in &mut items {
        item.aabb = item.aabb.padded(needle_pad(geometry, item.element, reach));
    }
    let whole = bounds(&items);
    let builder = Builder { max_leaf };
    let mut built = Built {
        nodes: Vec::new(),
        slots: Vec::new(),
        unbounded,
        root: None,
        reach,
        depth: 0,
        sah_cost: 0.0,
    };
    if items.is_empty() {
        return built;
    }
    let tree = builder.tree(&mut items, 0, 0);
    built.slots = items
        .iter()
        .map(|item| Slot {
            element: item.element,
            last: false,
        })
        .collect();
    let root = built.flatten(&tree, whole.half_area(), 0);
    built.root = Some(root);
    // Relative to the chance of hitting the whole; a flat point has none.
    built.sah_cost /= whole.half_area().max(f64::MIN_POSITIVE);
    built
}

impl Built {
    /// Appends a subtree; children follow their parent, the first one directly.
    fn flatten(&mut self, tree: &Tree, half_area: f64, depth: usize) -> Child {
        self.depth = self.depth.max(depth);
        match tree {
            Tree::Leaf(range) => {
                self.sah_cost += half_area * range.len() as f64;
                self.slots[range.end - 1].last = true;
                Child::leaf(range.start)
            }
            Tree::Inner(children) => {
                self.sah_cost += half_area * STEP_COST;
                let planes = [0, 1, 2].map(|axis| {
                    let side =
                        |of: fn(&Aabb) -> DVec3| [0, 1].map(|child: usize| of(&children[child].0)[axis]);
                    [side(|aabb| aabb.min), side(|aabb| aabb.max)]
                });
                let index = self.nodes.len();
                self.nodes.push(Node {
                    planes,
                    children: [Child::default(); 2],
                });
                for (i, (aabb, subtree)) in children.iter().enumerate() {
                    let child = self.flatten(subtree, aabb.half_area(), depth + 1);
                    self.nodes[index].children[i] = child;
                }
                Child::inner(index)
            }
        }
    }
}

/// What the box of a needle needs beyond the pad of every ray: the error of the triangle test, up to
/// which a hit may seem to lie outside the box. It is never more than the longest edge.
fn needle_pad(geometry: &Geometry, element: Element, reach: f64) -> f64 {
    let (Element::Triangle { shape, triangle }, shapes) = (element, geometry.shapes()) else {
        return 0.0;
    };
    let Shape::Triangles(mesh) = &shapes[shape as usize] else {
        return 0.0;
    };
    let [a, b, c] = mesh.corners(triangle);
    let longest = (b - a).length().max((c - b).length()).max((a - c).length());
    let height = (b - a).cross(c - a).length() / longest;
    if longest <= 256.0 * height || longest == 0.0 {
        return 0.0;
    }
    // 64 roundings of coordinates up to eight times as far as the geometry reaches.
    let error = 512.0 * f64::EPSILON * reach * (longest / height);
    error.min(longest)
}

fn bounds(items: &[Item]) -> Aabb {
    items.iter().fold(Aabb::EMPTY, |aabb, item| aabb.union(item.aabb))
}

struct Builder {
    max_leaf: usize,
}

/// The best split found so far: its cost (area times number, both sides) and how to make it.
struct Split {
    cost: f64,
    axis: usize,
    at: At,
}

enum At {
    /// Items in bins below this one go left.
    Bin(usize),
    /// So many items go left, in the order of their centers.
    Count(usize),
}

impl Builder {
    /// Builds over `items`, which begin at slot `first`, and brings them into the order of the leaves.
    fn tree(&self, items: &mut [Item], first: usize, depth: usize) -> Tree {
        let n = items.len();
        let leaf = Tree::Leaf(first..first + n);
        if n == 1 {
            return leaf;
        }
        let centers = Aabb::around(items.iter().map(|item| item.center));
        // Halving leads to single elements in as many steps as there are bits in n: from where that is all
        // that the stack has room for, halve.
        let must_halve = depth + (usize::BITS - n.leading_zeros()) as usize >= MAX_DEPTH;
        let split = match () {
            () if must_halve => None,
            () if n <= SWEEP => sweep(items),
            () => binned(items, &centers),
        };
        if n <= self.max_leaf {
            let area = bounds(items).half_area();
            let worth = split
                .as_ref()
                .is_some_and(|s| STEP_COST * area + s.cost < n as f64 * area);
            if !worth {
                return leaf;
            }
        }
        let middle = match split {
            Some(Split {
                axis,
                at: At::Bin(bin),
                ..
            }) => {
                let to_bin = ToBin::new(&centers, axis);
                partition(items, |item| to_bin.bin(item) < bin)
            }
            Some(Split {
                axis,
                at: At::Count(count),
                ..
            }) => {
                sort(items, axis);
                count
            }
            None => {
                let e = centers.extent().to_array();
                let axis = (0..3).fold(0, |best, axis| if e[axis] > e[best] { axis } else { best });
                sort(items, axis);
                n / 2
            }
        };
        let (left, right) = items.split_at_mut(middle);
        let boxes = [bounds(left), bounds(right)];
        let build_left = |items: &mut [Item]| Box::new(self.tree(items, first, depth + 1));
        let build_right = |items: &mut [Item]| Box::new(self.tree(items, first + middle, depth + 1));
        let (left, right) = if n >= PARALLEL {
            rayon::join(|| build_left(left), || build_right(right))
        } else {
            (build_left(left), build_right(right))
        };
        Tree::Inner([(boxes[0], left), (boxes[1], right)])
    }
}

/// By the center along an axis, then by number.
fn sort(items: &mut [Item], axis: usize) {
    items.sort_unstable_by(|a, b| {
        a.center[axis]
            .total_cmp(&b.center[axis])
            .then(a.number.cmp(&b.number))
    });
}

/// Brings what `goes_left` to the front, in no particular but a reproducible order; returns how many.
fn partition(items: &mut [Item], goes_left: impl Fn(&Item) -> bool) -> usize {
    let mut middle = 0;
    for i in 0..items.len() {
        if goes_left(&items[i]) {
            items.swap(middle, i);
            middle += 1;
        }
    }
    middle
}

/// The best split of few items, among all along the three axes; `None` if no split has a cost.
fn sweep(items: &mut [Item]) -> Option<Split> {
    let n = items.len();
    let mut best: Option<Split> = None;
    let mut right_areas = [0.0; SWEEP];
    for axis in 0..3 {
        sort(items, axis);
        let mut right = Aabb::EMPTY;
        for i in (1..n).rev() {
            right = right.union(items[i].aabb);
            right_areas[i] = right.half_area();
        }
        let mut left = Aabb::EMPTY;
        for i in 1..n {
            left = left.union(items[i - 1].aabb);
            let cost = left.half_area() * i as f64 + right_areas[i] * (n - i) as f64;
            if best.as_ref().is_none_or(|best| cost < best.cost) {
                best = Some(Split {
                    cost,
                    axis,
                    at: At::Count(i),
                });
            }
        }
    }
    best
}

/// The bin of an item by its center.
struct ToBin {
    axis: usize,
    start: f64,
    scale: f64,
}

impl ToBin {
    fn new(centers: &Aabb, axis: usize) -> Self {
        let extent = centers.max[axis] - centers.min[axis];
        Self {
            axis,
            start: centers.min[axis],
            scale: BINS as f64 / extent,
        }
    }

    fn bin(&self, item: &Item) -> usize {
        // The conversion saturates, so that whatever rounding does the bin is one of them.
        (((item.center[self.axis] - self.start) * self.scale) as usize).min(BINS - 1)
    }
}

/// The best split between bins; `None` if all centers fall into one.
fn binned(items: &[Item], centers: &Aabb) -> Option<Split> {
    let mut best: Option<Split> = None;
    for axis in 0..3 {
        let to_bin = ToBin::new(centers, axis);
        if !to_bin.scale.is_finite() {
            continue;
        }
        let mut bins = [(Aabb::EMPTY, 0usize); BINS];
        for item in items {
            let (aabb, count) = &mut bins[to_bin.bin(item)];
            *aabb = aabb.union(item.aabb);
            *count += 1;
        }
        let mut right_of = [(0.0, 0usize); BINS];
        let (mut right, mut count) = (Aabb::EMPTY, 0);
        for i in (1..BINS).rev() {
            right = right.union(bins[i].0);
            count += bins[i].1;
            right_of[i] = (right.half_area(), count);
        }
        let (mut left, mut count) = (Aabb::EMPTY, 0);
        for i in 1..BINS {
            left = left.union(bins[i - 1].0);
            count += bins[i - 1].1;
            let (right_area, right_count) = right_of[i];
            if count == 0 || right_count == 0 {
                continue;
            }
            let cost = left.half_area() * count as f64 + right_area * right_count as f64;
            if best.as_ref().is_none_or(|best| cost < best.cost) {
                best = Some(Split {
                    cost,
                    axis,
                    at: At::Bin(i),
                });
            }
        }
    }
    best
}
