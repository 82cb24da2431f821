//! A hierarchy of boxes, for searches among the shapes of a scene before it has an accelerator.

use std::ops::ControlFlow::{self, Break, Continue};
use std::ops::Range;
use whitstone_core::{Aabb, DVec3};

/// Maximum number of boxes in a leaf.
const LEAF: usize = 8;

/// A hierarchy over numbered boxes. Its depth is logarithmic, whatever the boxes are.
pub(crate) struct BoxTree<'a> {
    boxes: &'a [Aabb],
    /// In depth-first order, the root first.
    nodes: Vec<Node>,
    /// The numbers of the boxes, leaf by leaf.
    numbers: Vec<usize>,
    /// The position of each number.
    places: Vec<usize>,
}

struct Node {
    aabb: Aabb,
    /// The position of its first number.
    first: usize,
    /// For a leaf, the number of its boxes; 0 for an inner node.
    count: usize,
    /// The node that follows the subtree of this one.
    next: usize,
}

impl<'a> BoxTree<'a> {
    /// A hierarchy over boxes, which are numbered from 0.
    pub(crate) fn new(boxes: &'a [Aabb]) -> Self {
        let mut numbers: Vec<usize> = (0..boxes.len()).collect();
        let mut nodes = Vec::new();
        if !boxes.is_empty() {
            let centers: Vec<DVec3> = boxes.iter().map(Aabb::center).collect();
            build(boxes, &centers, &mut numbers, 0, &mut nodes);
        }
        let mut places = vec![0; boxes.len()];
        for (place, number) in numbers.iter().enumerate() {
            places[*number] = place;
        }
        Self {
            boxes,
            nodes,
            numbers,
            places,
        }
    }

    /// Calls `found` for each box for which `enter` holds, until it breaks. A subtree is skipped if
    /// `enter` does not hold for the box around it. The search begins around the box `start`.
    pub(crate) fn visit_from(
        &self,
        start: usize,
        mut enter: impl FnMut(&Aabb) -> bool,
        mut found: impl FnMut(usize) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        let mut siblings = Vec::new();
        let mut at = 0;
        // Down to the leaf, with the subtrees next to the path.
        while self.nodes[at].count == 0 {
            let (left, right) = (at + 1, self.nodes[at + 1].next);
            let end = self.nodes[at].next;
            let own = if self.places[start] < self.nodes[right].first {
                siblings.push(right..end);
                left
            } else {
                siblings.push(left..right);
                right
            };
            at = own;
        }
        let leaf = at..self.nodes[at].next;
        for nodes in std::iter::once(leaf).chain(siblings.into_iter().rev()) {
            self.visit(nodes, &mut enter, &mut found)?;
        }
        Continue(())
    }

    fn visit(
        &self,
        nodes: Range<usize>,
        mut enter: impl FnMut(&Aabb) -> bool,
        mut found: impl FnMut(usize) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        let mut at = nodes.start;
        while at < nodes.end {
            let node = &self.nodes[at];
            if !enter(&node.aabb) {
                at = node.next;
                continue;
            }
            for &number in &self.numbers[node.first..node.first + node.count] {
                if enter(&self.boxes[number]) {
                    found(number)?;
                }
            }
            at += 1;
        }
        Continue(())
    }

    /// Whether a property holds for any box. It must hold for each box that contains one for which
    /// it holds.
    pub(crate) fn any(&self, holds: impl FnMut(&Aabb) -> bool) -> bool {
        self.visit(0..self.nodes.len(), holds, |_| Break(())).is_break()
    }
}

/// Appends the subtree over some boxes, whose numbers begin at the position `first`.
fn build(boxes: &[Aabb], centers: &[DVec3], numbers: &mut [usize], first: usize, nodes: &mut Vec<Node>) {
    let aabb = numbers
        .iter()
        .fold(Aabb::EMPTY, |whole, number| whole.union(boxes[*number]));
    let at = nodes.len();
    let is_leaf = numbers.len() <= LEAF;
    nodes.push(Node {
        aabb,
        first,
        count: if is_leaf { numbers.len() } else { 0 },
        next: 0,
    });
    if !is_leaf {
        let extent = aabb.extent();
        let axis = (0..3)
            .max_by(|a, b| extent[*a].total_cmp(&extent[*b]))
            .unwrap_or(0);
        let middle = numbers.len() / 2;
        numbers.select_nth_unstable_by(middle, |a, b| {
            let (one, two) = (centers[*a][axis], centers[*b][axis]);
            one.total_cmp(&two).then(a.cmp(b))
        });
        let (left, right) = numbers.split_at_mut(middle);
        build(boxes, centers, left, first, nodes);
        build(boxes, centers, right, first + middle, nodes);
    }
    nodes[at].next = nodes.len();
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(center: f64, half: f64) -> Aabb {
        Aabb::around([DVec3::splat(center - half), DVec3::splat(center + half)])
    }

    #[test]
    fn exactly_the_boxes_of_a_property_are_found_and_few_are_visited() {
        let mut boxes: Vec<Aabb> = (0..1000).map(|i| cube(f64::from(i * 7 % 1000), 0.4)).collect();
        boxes.push(Aabb::EVERYTHING);
        let tree = BoxTree::new(&boxes);
        for place in [-1.0, 0.0, 0.5, 370.2, 999.0, 2000.0] {
            let holds = |aabb: &Aabb| aabb.min.x <= place && place <= aabb.max.x;
            let (mut found, mut visited) = (Vec::new(), 0);
            let all = tree.visit_from(
                37,
                |aabb| {
                    visited += 1;
                    holds(aabb)
                },
                |number| {
                    found.push(number);
                    Continue(())
                },
            );
            found.sort_unstable();
            let expected: Vec<usize> = (0..boxes.len()).filter(|i| holds(&boxes[*i])).collect();
            assert_eq!((all, found), (Continue(()), expected));
            assert!(visited < 80, "{visited}");
        }
        assert!(tree.any(|aabb| aabb.max.x > 999.0));
        assert!(!BoxTree::new(&boxes[..1000]).any(|aabb| aabb.max.x > 1000.0));
        assert!(!BoxTree::new(&[]).any(|_| true));
    }
}
