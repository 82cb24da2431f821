//! Shapes of an outline: the prism as the planes of its faces, the lathe as the quadrics of its
//! segments. Glassner (ed.) 1989, ch. 2, 3.2 and 5.

use super::conic::Conic;
use super::{Real, Roots, Textbook, Vector, at};
use crate::shapes::lathe::Lathe as ExactLathe;
use crate::shapes::prism::Prism as ExactPrism;

fn sorted<R: Real>(mut roots: Roots<R>) -> Roots<R> {
    roots.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    roots
}

fn first<R: Real>(roots: &[R]) -> Option<R> {
    roots.iter().copied().find(|t| *t > R::of(0.0))
}

pub(super) struct Prism<R> {
    /// Both ends (x, z) of each edge.
    edges: Vec<[[R; 2]; 2]>,
    heights: [R; 2],
}

impl<R: Real> Prism<R> {
    pub(super) fn new(shape: &ExactPrism) -> Self {
        let edges = shape.edges().map(|(p, q)| [p, q].map(|point| point.map(R::of)));
        Self {
            edges: edges.collect(),
            heights: shape.y.map(R::of),
        }
    }

    fn contains(&self, [x, _, z]: Vector<R>) -> bool {
        self.edges.iter().fold(false, |inside, [p, q]| {
            let crosses = (p[1] > z) != (q[1] > z) && x < (q[0] - p[0]) * (z - p[1]) / (q[1] - p[1]) + p[0];
            inside ^ crosses
        })
    }
}

impl<R: Real> Textbook<R> for Prism<R> {
    fn intersect(&self, o: Vector<R>, d: Vector<R>) -> Option<R> {
        first(&self.roots(o, d))
    }

    fn roots(&self, o: Vector<R>, d: Vector<R>) -> Roots<R> {
        let (zero, one) = (R::of(0.0), R::of(1.0));
        let mut roots = Roots::new();
        for [p, q] in &self.edges {
            let [e, f] = [q[0] - p[0], q[1] - p[1]];
            let t = (f * (p[0] - o[0]) - e * (p[1] - o[2])) / (f * d[0] - e * d[2]);
            let hit = at(o, d, t);
            let along = (e * (hit[0] - p[0]) + f * (hit[2] - p[1])) / (e * e + f * f);
            if along >= zero && along < one && hit[1] >= self.heights[0] && hit[1] <= self.heights[1] {
                roots.push(t);
            }
        }
        for height in self.heights {
            let t = (height - o[1]) / d[1];
            if self.contains(at(o, d, t)) {
                roots.push(t);
            }
        }
        sorted(roots)
    }
}

pub(super) struct Lathe<R> {
    /// The segments that are not flat, about the z axis.
    cones: Vec<Conic<R>>,
    /// Height, inner and outer radius of the others.
    rings: Vec<[R; 3]>,
}

impl<R: Real> Lathe<R> {
    pub(super) fn new(shape: &ExactLathe) -> Self {
        let (mut cones, mut rings) = (Vec::new(), Vec::new());
        for ends in shape.outline.windows(2) {
            let [[r, y], [s, z]] = [ends[0], ends[1]];
            if y == z {
                rings.push([y, r.min(s), r.max(s)].map(R::of));
            } else {
                cones.push(Conic::cone(&ExactLathe::cone([ends[0], ends[1]])));
            }
        }
        Self { cones, rings }
    }
}

impl<R: Real> Textbook<R> for Lathe<R> {
    fn intersect(&self, o: Vector<R>, d: Vector<R>) -> Option<R> {
        first(&self.roots(o, d))
    }

    fn roots(&self, o: Vector<R>, d: Vector<R>) -> Roots<R> {
        let turned = |v: Vector<R>| [v[2], v[0], v[1]];
        let (o, d) = (turned(o), turned(d));
        let mut roots = Roots::new();
        for cone in &self.cones {
            roots.extend(cone.roots(o, d));
        }
        for [height, inner, outer] in &self.rings {
            let t = (*height - o[2]) / d[2];
            let [x, y, _] = at(o, d, t);
            let square = x * x + y * y;
            if square >= *inner * *inner && square <= *outer * *outer {
                roots.push(t);
            }
        }
        sorted(roots)
    }
}
