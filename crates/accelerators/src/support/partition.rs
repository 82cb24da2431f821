//! Top-down build of trees that divide space recursively by planes of any kind: `kdtree` and `bsp`.
//!
//! An element on both sides of a plane is referred to from both, at most `MAX_REFERENCES` times on
//! average. Once that budget is spent, cells are not divided further, so memory is linear in the
//! number of elements. If costs decide, a subtree becomes one leaf again where that costs less,
//! which is known only after it is built.

/// Maximum depth of a tree.
pub(crate) const MAX_DEPTH: usize = 64;

/// SAH cost factor for splits that cut off empty space (pbrt: emptyBonus).
const EMPTY_BONUS: f64 = 0.8;

/// Upper bound on references; their indices must fit 28 bits.
const MAX_IN_ALL: usize = 1 << 28;

/// A kind of splitting plane.
pub(crate) trait Cut: Copy + Send + Sync {
    /// The cells that it divides.
    type Cell: Send;

    /// Half the surface area of a cell.
    fn half_area(cell: &Self::Cell) -> f64;

    /// The parts of a cell below and above the plane.
    fn halves(&self, cell: &Self::Cell) -> [Self::Cell; 2];
}

/// A strategy for cutting cells.
pub(crate) trait Cutter: Sync {
    type Cut: Cut;
    /// An element, or its part inside a cell.
    type Part: Send;

    /// Cost of a traversal step, in the unit of `leaf_cost`.
    const STEP_COST: f64;

    /// Maximum number of references per element, on average.
    const MAX_REFERENCES: usize;

    /// From this number of parts, both sides are built in parallel.
    const PARALLEL: usize;

    /// The number of the element.
    fn item(part: &Self::Part) -> u32;

    /// Whether a cell of `count` parts is never cut.
    fn is_leaf(&self, count: usize) -> bool;

    /// Whether a cell is cut only if that lowers the cost.
    fn asks_cost(&self) -> bool;

    /// Cost of a leaf of `count` parts.
    fn leaf_cost(count: usize) -> f64;

    /// Whether this cut of a cell of `count` parts is not worth trying.
    fn is_hopeless(&self, count: usize, half_area: f64, choice: &Choice<Self::Cut>) -> bool;

    /// The best plane; `None` if there is none.
    fn choose(&self, parts: &[Self::Part], cell: &<Self::Cut as Cut>::Cell) -> Option<Choice<Self::Cut>>;

    /// The parts on each side; `None` if the cut makes no progress.
    fn sides(&self, parts: &[Self::Part], choice: &Choice<Self::Cut>) -> Option<[Vec<Self::Part>; 2]>;
}

/// A plane to cut by, with its cost.
#[derive(Clone, Copy)]
pub(crate) struct Choice<C> {
    pub(crate) cut: C,
    /// Side of the elements that lie in the plane: 0 below, 1 above.
    pub(crate) flat_side: usize,
    /// Area times count, summed over both sides; see [`cost`].
    pub(crate) cost: f64,
}

/// The cheaper of two cuts, the first if they cost the same.
pub(crate) fn cheaper<C>(first: Choice<C>, second: Choice<C>) -> Choice<C> {
    if second.cost < first.cost { second } else { first }
}

/// Cost of a cut with these areas and numbers of parts on each side.
pub(crate) fn cost(areas: [f64; 2], counts: [usize; 2]) -> f64 {
    bonus(counts) * (areas[0] * counts[0] as f64 + areas[1] * counts[1] as f64)
}

/// Factor on the cost of a cut with these numbers of parts on each side.
pub(crate) fn bonus(counts: [usize; 2]) -> f64 {
    if counts.contains(&0) { EMPTY_BONUS } else { 1.0 }
}

/// The subtree of a cell.
pub(crate) struct Tree<C> {
    pub(crate) half_area: f64,
    /// Expected cost inside the cell, times the area.
    pub(crate) cost: f64,
    pub(crate) content: Content<C>,
}

/// Contents of a cell.
pub(crate) enum Content<C> {
    /// The numbers of the elements.
    Leaf(Vec<u32>),
    /// A plane, and the subtrees below and above it.
    Inner(C, Box<[Tree<C>; 2]>),
}

impl<C: Cut> Tree<C> {
    /// Builds a tree over the parts of all elements in a cell. The result depends only on these,
    /// not on the number of threads.
    pub(crate) fn new<K: Cutter<Cut = C>>(
        cutter: &K,
        parts: Vec<K::Part>,
        cell: C::Cell,
        max_depth: Option<u32>,
    ) -> Self {
        let usual = 8.0 + 1.3 * libm::log2(parts.len().max(1) as f64);
        let levels = max_depth.map_or(usual as usize, |depth| depth as usize);
        let spare = ((K::MAX_REFERENCES - 1) * parts.len()).min(MAX_IN_ALL.saturating_sub(parts.len()));
        grow(cutter, parts, cell, levels.min(MAX_DEPTH), spare)
    }

    /// Length of the longest path from here.
    pub(crate) fn depth(&self) -> usize {
        match &self.content {
            Content::Leaf(_) => 0,
            Content::Inner(_, children) => 1 + children[0].depth().max(children[1].depth()),
        }
    }

    fn leaf<K: Cutter<Cut = C>>(held: Vec<u32>, half_area: f64) -> Self {
        Self {
            half_area,
            cost: half_area * K::leaf_cost(held.len()),
            content: Content::Leaf(held),
        }
    }
}

/// Only cells of at most this many elements can become one leaf again.
const MAX_HELD: usize = 64;

/// Builds the subtree of a cell with at most `levels` levels and `spare` additional references.
fn grow<K: Cutter>(
    cutter: &K,
    parts: Vec<K::Part>,
    cell: <K::Cut as Cut>::Cell,
    levels: usize,
    spare: usize,
) -> Tree<K::Cut> {
    let (n, half_area) = (parts.len(), K::Cut::half_area(&cell));
    let held = |parts: &[K::Part]| parts.iter().map(K::item).collect();
    let leaf = |parts: &[K::Part]| Tree::leaf::<K>(held(parts), half_area);
    if levels == 0 || n == 0 || cutter.is_leaf(n) {
        return leaf(&parts);
    }
    let Some(choice) = cutter.choose(&parts, &cell) else {
        return leaf(&parts);
    };
    if cutter.asks_cost() && cutter.is_hopeless(n, half_area, &choice) {
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
    let held = if cutter.asks_cost() && n <= MAX_HELD {
        held(&parts)
    } else {
        Vec::new()
    };
    drop(parts);
    let cut = choice.cut;
    // The remaining budget is divided in proportion to size.
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
    let cost = K::STEP_COST * half_area + below.cost + above.cost;
    if !held.is_empty() && K::leaf_cost(n) * half_area <= cost {
        return Tree::leaf::<K>(held, half_area);
    }
    Tree {
        half_area,
        cost,
        content: Content::Inner(cut, Box::new([below, above])),
    }
}
