//! Constructive solid geometry by combining sorted lists of roots (Roth 1982).

use super::{Real, Textbook, Vector};
use crate::shapes::csg::Operation;
use smallvec::SmallVec;

pub(super) struct Csg<R> {
    operation: Operation,
    operands: Vec<Box<dyn Textbook<R>>>,
}

impl<R: Real> Csg<R> {
    pub(super) fn new(operation: Operation, operands: Vec<Box<dyn Textbook<R>>>) -> Self {
        Self { operation, operands }
    }

    /// Calls `found` with each boundary of the solid along the line, until it returns false.
    fn each(&self, o: Vector<R>, d: Vector<R>, mut found: impl FnMut(R) -> bool) {
        let mut inside: SmallVec<[bool; 8]> = SmallVec::new();
        let mut ends: SmallVec<[(R, usize); 16]> = SmallVec::new();
        for (number, operand) in self.operands.iter().enumerate() {
            inside.push(operand.starts_inside(o, d));
            ends.extend(operand.roots(o, d).into_iter().map(|t| (t, number)));
        }
        ends.sort_by(|a, b| a.0.partial_cmp(&b.0).unwrap_or(std::cmp::Ordering::Equal));
        let mut was = self.operation.inside(&inside);
        for (t, number) in ends {
            inside[number] = !inside[number];
            let is = self.operation.inside(&inside);
            if is != was && !found(t) {
                return;
            }
            was = is;
        }
    }
}

impl<R: Real> Textbook<R> for Csg<R> {
    fn intersect(&self, o: Vector<R>, d: Vector<R>) -> Option<R> {
        let mut best = None;
        self.each(o, d, |t| {
            best = (t > R::of(0.0)).then_some(t);
            best.is_none()
        });
        best
    }

    fn roots(&self, o: Vector<R>, d: Vector<R>) -> SmallVec<[R; 8]> {
        let mut roots = SmallVec::new();
        self.each(o, d, |t| {
            roots.push(t);
            true
        });
        roots
    }

    fn starts_inside(&self, o: Vector<R>, d: Vector<R>) -> bool {
        let inside: SmallVec<[bool; 8]> = self
            .operands
            .iter()
            .map(|operand| operand.starts_inside(o, d))
            .collect();
        self.operation.inside(&inside)
    }
}
