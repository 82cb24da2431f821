//! A bounding volume hierarchy over parts of patches.
//!
//! A patch is halved in its least even direction until its control points are nearly those of a
//! flat piece, or the limit on halvings is reached. The boxes bound the control points, and hence
//! the surface (Farin, 14.3). The hierarchy is built by splitting lists of parts at the median.

use super::net::{Net, Way};
use whitstone_core::{Aabb, DVec2, DVec3};

/// A part is even enough if its second differences are less than this fraction of its length.
const EVEN: f64 = 0.08;

/// Maximum number of halvings of a patch.
const MAX_HALVINGS: u32 = 8;

/// Marks the absence of a second child or of a leaf.
const NONE: u32 = u32::MAX;

/// A part of a patch.
pub(super) struct Leaf {
    pub(super) net: Net<DVec3>,
    pub(super) patch: u32,
    /// Parameter range in the patch.
    pub(super) low: DVec2,
    pub(super) size: DVec2,
}

struct Node {
    bounds: Aabb,
    /// The second child of an inner node (the first one is the next node), or [`NONE`].
    second: u32,
    leaf: u32,
}

pub(super) struct Tree {
    origin_primitive: Vec<Leaf>,
    nodes: Vec<Node>,
}

/// A ray prepared for box tests.
pub(super) struct Slabs {
    pub(super) origin: DVec3,
    pub(super) inverse: DVec3,
}

impl Slabs {
    /// Entry into and exit from a box; the entry lies behind the exit if the ray misses.
    fn cut(&self, aabb: &Aabb) -> (f64, f64) {
        let a = (aabb.min - self.origin) * self.inverse;
        let b = (aabb.max - self.origin) * self.inverse;
        // NaN (the ray runs within the plane of a face) has no effect.
        let low = |k: usize| {
            if a[k].is_nan() || b[k].is_nan() {
                f64::NEG_INFINITY
            } else {
                a[k].min(b[k])
            }
        };
        let high = |k: usize| {
            if a[k].is_nan() || b[k].is_nan() {
                f64::INFINITY
            } else {
                a[k].max(b[k])
            }
        };
        (low(0).max(low(1)).max(low(2)), high(0).min(high(1)).min(high(2)))
    }
}

/// Splits a patch into parts.
pub(super) fn parts(net: &Net<DVec3>, patch: u32) -> Vec<Leaf> {
    let whole = Leaf {
        net: *net,
        patch,
        low: DVec2::ZERO,
        size: DVec2::ONE,
    };
    let mut found = Vec::new();
    let mut waiting = vec![(whole, 0)];
    while let Some((leaf, halvings)) = waiting.pop() {
        let uneven = [Way::U, Way::V].map(|way| {
            let long = leaf.net.longest(way, DVec3::length);
            leaf.net.unevenness(way, DVec3::length) / long.max(f64::MIN_POSITIVE)
        });
        let (way, most) = if uneven[0] >= uneven[1] {
            (Way::U, uneven[0])
        } else {
            (Way::V, uneven[1])
        };
        if most <= EVEN || halvings == MAX_HALVINGS {
            found.push(leaf);
            continue;
        }
        let (step, half) = match way {
            Way::U => (DVec2::new(0.5, 0.0), DVec2::new(0.5, 1.0)),
            Way::V => (DVec2::new(0.0, 0.5), DVec2::new(1.0, 0.5)),
        };
        for (k, low) in [(0.0, leaf.low), (0.5, leaf.low + step * leaf.size)] {
            let part = Leaf {
                net: leaf.net.part(way, k, k + 0.5),
                patch,
                low,
                size: half * leaf.size,
            };
            waiting.push((part, halvings + 1));
        }
    }
    found
}

impl Tree {
    /// Builds a tree over parts; each box is padded by `padding`.
    pub(super) fn new(origin_primitive: Vec<Leaf>, padding: f64) -> Self {
        let boxes: Vec<Aabb> = origin_primitive
            .iter()
            .map(|leaf| Aabb::around(leaf.net.0).padded(padding))
            .collect();
        let mut order: Vec<u32> = (0..origin_primitive.len() as u32).collect();
        let mut tree = Self {
            origin_primitive,
            nodes: Vec::with_capacity(2 * boxes.len()),
        };
        tree.build(&mut order, &boxes);
        tree
    }

    fn build(&mut self, order: &mut [u32], boxes: &[Aabb]) {
        let of = |leaf: &u32| boxes[*leaf as usize];
        let bounds = order.iter().map(of).fold(Aabb::EMPTY, Aabb::union);
        let number = self.nodes.len();
        let leaf = if order.len() == 1 { order[0] } else { NONE };
        self.nodes.push(Node {
            bounds,
            second: NONE,
            leaf,
        });
        if order.len() < 2 {
            return;
        }
        let centers = Aabb::around(order.iter().map(|leaf| of(leaf).center()));
        let extent = centers.extent();
        let axis = (0..3).fold(0, |most, k| if extent[k] > extent[most] { k } else { most });
        let middle = order.len() / 2;
        order.select_nth_unstable_by(middle, |p, q| {
            let [a, b] = [p, q].map(|leaf| of(leaf).center()[axis]);
            a.total_cmp(&b).then(p.cmp(q))
        });
        let (first, second) = order.split_at_mut(middle);
        self.build(first, boxes);
        self.nodes[number].second = self.nodes.len() as u32;
        self.build(second, boxes);
    }

    pub(super) fn bounds(&self) -> Aabb {
        self.nodes[0].bounds
    }

    /// Calls `visit` for every part whose box the ray meets between two parameters, nearer boxes
    /// first. The return value is the new far end.
    pub(super) fn walk(&self, ray: &Slabs, near: f64, far: f64, mut visit: impl FnMut(&Leaf) -> f64) {
        let mut far = far;
        let meets = |(enters, origin_primitive): (f64, f64), far: f64| {
            enters <= origin_primitive && origin_primitive >= near && enters <= far
        };
        // Median splits give a tree of at most 32 levels.
        let mut waiting = [(0u32, f64::NEG_INFINITY); 40];
        let mut count = usize::from(meets(ray.cut(&self.nodes[0].bounds), far));
        while count > 0 {
            count -= 1;
            let (number, enters) = waiting[count];
            if enters > far {
                continue;
            }
            let node = &self.nodes[number as usize];
            if node.leaf != NONE {
                far = visit(&self.origin_primitive[node.leaf as usize]);
                continue;
            }
            let mut children = [number + 1, node.second].map(|child| {
                let cut = ray.cut(&self.nodes[child as usize].bounds);
                (child, cut.0, meets(cut, far))
            });
            if children[0].1 < children[1].1 {
                children.swap(0, 1);
            }
            for (child, enters, meets) in children {
                if meets {
                    waiting[count] = (child, enters);
                    count += 1;
                }
            }
        }
    }
}
