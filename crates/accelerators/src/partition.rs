//! What the trees share that cut space in two, and again, by planes of whatever kind: build, traversal, statistics.
//!
//! - Build: top down. What lies on both sides of a plane is referred to from both, at most `MOST_REFERENCES` times on
//!   average: then cells stay as they are, so that memory is linear in the number of elements.
//! - Traversal: in order, with an interval of the ray for each cell (the notes' t_min, t*, t_max; Havran,
//!   *Heuristic ray shooting algorithms*, 2000, appendix C). The ray is as wide as rounding may need (see
//!   `elements`), so it arrives at a plane before it leaves the side before, and the intervals overlap a little.

use crate::elements::{Item, Mailbox, Structure, Visitor, WideRay, bounds};
use whitstone_core::{Aabb, Element, Outline, Statistics};

/// No path from the root is longer.
pub(crate) const MAX_DEPTH: usize = 64;

/// What a cut counts if one side is empty.
const EMPTY_BONUS: f64 = 0.8;

/// Most references to an element, on average.
const MOST_REFERENCES: usize = 8;

/// A plane of a certain kind.
pub(crate) trait Cut: Copy + Send + Sync {
    /// What it divides.
    type Cell: Send;

    /// The cell that is a box.
    fn cell(aabb: &Aabb) -> Self::Cell;

    /// Half the area of the surface of a cell.
    fn half_area(cell: &Self::Cell) -> f64;

    /// The edges of a cell.
    fn outline(depth: usize, cell: &Self::Cell) -> Outline;

    /// The parts of a cell below and above.
    fn halves(&self, cell: &Self::Cell) -> [Self::Cell; 2];

    /// How a ray passes.
    fn passage(&self, ray: &WideRay) -> Passage;

    /// Whether it follows no coordinate axis.
    fn is_askew(&self) -> bool;
}

/// How a ray passes a plane; a number that is NaN says nothing.
pub(crate) struct Passage {
    /// 0 if it comes from below, 1 from above.
    pub(crate) side: u32,
    /// Up to where it touches the side that it comes from.
    pub(crate) leaves: f64,
    /// From where it touches the other side.
    pub(crate) arrives: f64,
}

/// What decides how cells are cut.
pub(crate) trait Cutter: Sync {
    type Cut: Cut;
    /// An element, or the part of it in a cell.
    type Part: Send;

    /// Time of a step down, in units of the time of one test of an element.
    const STEP_COST: f64;

    /// From this number of parts on both sides are built in parallel.
    const PARALLEL: usize;

    /// The number of the element.
    fn item(part: &Self::Part) -> u32;

    /// Whether a cell of so many parts stays as it is.
    fn is_leaf(&self, count: usize) -> bool;

    /// Whether a cell is cut only where that costs less than to leave it.
    fn asks_cost(&self) -> bool;

    /// The best plane; `None` if there is none.
    fn choose(&self, parts: &[Self::Part], cell: &<Self::Cut as Cut>::Cell) -> Option<Choice<Self::Cut>>;

    /// What lies on each side; `None` if the cut brings nothing.
    fn sides(&self, parts: &[Self::Part], choice: &Choice<Self::Cut>) -> Option<[Vec<Self::Part>; 2]>;
}

/// A plane to cut by.
#[derive(Clone, Copy)]
pub(crate) struct Choice<C> {
    pub(crate) cut: C,
    /// Where elements go that lie in the plane: 0 below, 1 above.
    pub(crate) flat_side: usize,
    /// Area times number, both sides; see [`cost`].
    pub(crate) cost: f64,
}

/// The cheaper of two cuts, the first if they cost the same.
pub(crate) fn cheaper<C>(first: Choice<C>, second: Choice<C>) -> Choice<C> {
    if second.cost < first.cost { second } else { first }
}

/// The cost of a cut with so many parts on each side of these areas.
pub(crate) fn cost(areas: [f64; 2], counts: [usize; 2]) -> f64 {
    bonus(counts) * (areas[0] * counts[0] as f64 + areas[1] * counts[1] as f64)
}

/// What the cost of a cut is multiplied by.
pub(crate) fn bonus(counts: [usize; 2]) -> f64 {
    if counts.contains(&0) { EMPTY_BONUS } else { 1.0 }
}

/// The tree.
pub(crate) struct Partition<C> {
    /// Around all elements.
    bounds: Aabb,
    /// The root is 0.
    nodes: Vec<Node<C>>,
    /// What the leaves hold: indices of elements.
    references: Vec<u32>,
    elements: Vec<Element>,
    depth: usize,
    sah_cost: f64,
}

#[derive(Clone, Copy, Debug)]
enum Node<C> {
    /// Two children side by side, the first below the plane.
    Inner { cut: C, children: u32 },
    /// A range of references.
    Leaf { first: u32, count: u32 },
}

enum Tree<C> {
    Leaf {
        held: Vec<u32>,
        half_area: f64,
    },
    Inner {
        cut: C,
        half_area: f64,
        children: Box<[Tree<C>; 2]>,
    },
}

impl<C: Cut> Partition<C> {
    /// Size of a node.
    pub(crate) const NODE_BYTES: usize = size_of::<Node<C>>();

    /// Builds over the parts that are all of the items. The result depends on these only, not on the number of threads.
    pub(crate) fn new<K: Cutter<Cut = C>>(
        cutter: &K,
        items: &[Item],
        parts: Vec<K::Part>,
        max_depth: Option<u32>,
    ) -> Self {
        let usual = 8.0 + 1.3 * (items.len().max(1) as f64).log2();
        let levels = max_depth.map_or(usual as usize, |depth| depth as usize);
        let spare = (MOST_REFERENCES - 1) * items.len();
        let bounds = bounds(items);
        let tree = grow(cutter, parts, C::cell(&bounds), levels.min(MAX_DEPTH), spare);
        let mut built = Self {
            bounds,
            nodes: vec![Node::Leaf { first: 0, count: 0 }],
            references: Vec::new(),
            elements: items.iter().map(|item| item.element).collect(),
            depth: 0,
            sah_cost: 0.0,
        };
        built.flatten(&tree, 0, 0, K::STEP_COST);
        // Relative to the chance of hitting the whole; a flat point has none.
        built.sah_cost /= bounds.half_area().max(f64::MIN_POSITIVE);
        built
    }

    /// Puts a subtree at a place among the nodes, and what is below it behind all others.
    fn flatten(&mut self, tree: &Tree<C>, place: usize, depth: usize, step_cost: f64) {
        self.depth = self.depth.max(depth);
        self.nodes[place] = match tree {
            Tree::Leaf { held, half_area } => {
                self.sah_cost += half_area * held.len() as f64;
                let first = self.references.len() as u32;
                self.references.extend(held);
                Node::Leaf {
                    first,
                    count: held.len() as u32,
                }
            }
            Tree::Inner {
                cut,
                half_area,
                children,
            } => {
                self.sah_cost += half_area * step_cost;
                let next = self.nodes.len();
                self.nodes.extend([Node::Leaf { first: 0, count: 0 }; 2]);
                for (side, child) in children.iter().enumerate() {
                    self.flatten(child, next + side, depth + 1, step_cost);
                }
                Node::Inner {
                    cut: *cut,
                    children: next as u32,
                }
            }
        };
    }

    fn outline(&self, node: u32, cell: &C::Cell, depth: usize, deepest: usize, found: &mut Vec<Outline>) {
        found.push(C::outline(depth, cell));
        if let Node::Inner { cut, children } = &self.nodes[node as usize]
            && depth < deepest
        {
            for (child, cell) in (*children..).zip(&cut.halves(cell)) {
                self.outline(child, cell, depth + 1, deepest, found);
            }
        }
    }
}

/// Builds over a cell, at most so many levels and with so many references more than it has now.
fn grow<K: Cutter>(
    cutter: &K,
    parts: Vec<K::Part>,
    cell: <K::Cut as Cut>::Cell,
    levels: usize,
    spare: usize,
) -> Tree<K::Cut> {
    let (n, half_area) = (parts.len(), K::Cut::half_area(&cell));
    let leaf = |parts: &[K::Part]| Tree::Leaf {
        held: parts.iter().map(K::item).collect(),
        half_area,
    };
    if levels == 0 || n == 0 || cutter.is_leaf(n) {
        return leaf(&parts);
    }
    let Some(choice) = cutter.choose(&parts, &cell) else {
        return leaf(&parts);
    };
    if cutter.asks_cost() && K::STEP_COST * half_area + choice.cost >= n as f64 * half_area {
        return leaf(&parts);
    }
    let Some([below, above]) = cutter.sides(&parts, &choice) else {
        return leaf(&parts);
    };
    let (n_below, n_above) = (below.len(), above.len());
    let more = (n_below + n_above).saturating_sub(n);
    if more > spare {
        return leaf(&parts);
    }
    drop(parts);
    let cut = choice.cut;
    // What may still be added is shared out by size.
    let spare_below = (spare - more) * n_below / (n_below + n_above).max(1);
    let spare_above = spare - more - spare_below;
    let [below_cell, above_cell] = cut.halves(&cell);
    drop(cell);
    let grow_below = move || grow(cutter, below, below_cell, levels - 1, spare_below);
    let grow_above = move || grow(cutter, above, above_cell, levels - 1, spare_above);
    let (below, above) = if n >= K::PARALLEL {
        rayon::join(grow_below, grow_above)
    } else {
        (grow_below(), grow_above())
    };
    Tree::Inner {
        cut,
        half_area,
        children: Box::new([below, above]),
    }
}

/// A cell that is visited later: its node and the part of the ray in it.
type Later = (u32, f64, f64);

impl<C: Cut> Structure for Partition<C> {
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
                    let Passage {
                        side,
                        leaves,
                        arrives,
                    } = cut.passage(ray);
                    let (before, beyond) = (children + side, children + 1 - side);
                    // t* of the notes, which is two for a wide ray. A NaN changes nothing; the methods `min` and `max`
                    // would say so too, in four instructions each instead of one.
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
        let askew = |node: &&Node<C>| matches!(node, Node::Inner { cut, .. } if cut.is_askew());
        let empty = |node: &&Node<C>| matches!(node, Node::Leaf { count: 0, .. });
        let leaf = |node: &&Node<C>| matches!(node, Node::Leaf { .. });
        let count = |which: &dyn Fn(&&Node<C>) -> bool| self.nodes.iter().filter(which).count() as f64;
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
            self.outline(0, &C::cell(&self.bounds), 0, deepest, &mut found);
        }
        found
    }
}
