//! The hierarchy for processors with AVX-512: nodes of sixteen boxes in single precision, and
//! leaves whose triangles are tested in double precision, eight at once.
//!
//! `search` traverses with one ray, `packet` with sixteen coherent ones, and `stream` with many
//! others at a time.

mod leaf;
mod node;
mod packet;
mod ray;
mod search;
mod stack;
mod stream;

use super::RaySets;
use super::stream::Answers;
use super::wide::Wide;
use crate::support::leaves::Leaves;
use crate::support::leaves::child::Child;
use crate::support::leaves::state::{Query, Tally};
use node::Node;
use stream::{Places, Stream};
use whitstone_core::PreliminaryIntersection;
use whitstone_core::stream::RayStream;
use whitstone_simd::with_wide_lanes;

/// The hierarchy, with its leaves.
pub(super) struct Sixteen {
    pub(super) leaves: Leaves,
    nodes: Vec<Node>,
    /// Arbitrary if there are no elements.
    pub(super) root: Child,
    depth: usize,
    pub(super) sets: RaySets,
}

impl Sixteen {
    pub(super) fn new(wide: &Wide<16>, leaves: Leaves) -> Self {
        Self {
            leaves,
            nodes: node::sorted(&wide.nodes),
            root: wide.root.unwrap_or_default(),
            depth: wide.depth,
            sets: RaySets::default(),
        }
    }

    /// The nodes as they were before they were sorted, without leaves.
    pub(super) fn wide(&self) -> Wide<16> {
        Wide {
            nodes: self.nodes.iter().map(|node| node.boxes).collect(),
            root: (!self.leaves.slots.is_empty()).then_some(self.root),
            depth: self.depth,
            ..Wide::default()
        }
    }

    /// The boxes and the children of a node.
    pub(super) fn node(&self, node: usize) -> &super::node::Node<16> {
        &self.nodes[node].boxes
    }

    /// Size in memory, in bytes.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.nodes) + self.leaves.bytes()
    }

    /// Finds any hit if `ANY`, else the nearest.
    #[inline(always)]
    pub(super) fn find<const ANY: bool>(
        &self,
        query: &Query<'_>,
        tally: impl Tally,
    ) -> Option<PreliminaryIntersection> {
        let tree = self;
        with_wide_lanes(search::Search::<ANY, _> { tree, query, tally })
    }

    /// The same for each ray of a stream.
    #[inline(always)]
    pub(super) fn find_stream<const ANY: bool>(&self, rays: &RayStream, answers: &mut impl Answers) {
        Places::with(|places| {
            with_wide_lanes(Stream::<ANY, _> {
                tree: self,
                rays,
                answers,
                places,
            });
        });
    }
}
