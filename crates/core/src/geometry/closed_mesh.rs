//! A triangle mesh as a solid.

use crate::solid::{self, Spans};
use crate::triangle::ShearedRay;
use crate::{
    Aabb, Interval, LoweredShape, PreliminaryIntersection, Ray, Shape, ShapeHit, SurfaceAttributes,
    SurfaceInteraction, TriangleMesh,
};
use glam::{DVec2, DVec3};
use std::collections::HashMap;
use std::fmt;
use std::ops::Range;

/// Maximum number of triangles in a leaf.
const LEAF: usize = 4;

/// A mesh that bounds a volume: a point is inside if the winding number of the mesh around it is
/// positive.
///
/// The crossings of any line pair up ([`ShearedRay::pierce`]); crossings inside another part of the
/// mesh are ignored. Triangles are found with a bounding volume hierarchy, split at the median of
/// the longest axis.
pub struct ClosedMesh {
    mesh: TriangleMesh,
    /// Triangle ids, ordered by leaf.
    order: Vec<u32>,
    /// In depth-first order: every node precedes its descendants.
    nodes: Vec<Node>,
}

struct Node {
    bounds: Aabb,
    /// Index of the first node after this subtree.
    next: usize,
    /// Of a leaf: a range of `order`.
    triangles: Range<usize>,
}

/// Why a mesh bounds no volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NotClosed {
    /// This many edges are not traversed equally often in both directions.
    Edges(usize),
    /// The triangles face inwards.
    InsideOut,
}

impl fmt::Display for NotClosed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Edges(1) => f.write_str(
                "one of its edges belongs to only one triangle, or to two triangles of opposite orientation",
            ),
            Self::Edges(count) => {
                write!(
                    f,
                    "{count} of its edges belong to only one triangle, or to two triangles of opposite orientation"
                )
            }
            Self::InsideOut => f.write_str("its triangles face inwards"),
        }
    }
}

impl LoweredShape {
    /// The shape as an operand of constructive solid geometry. Fails if it bounds no volume; for a
    /// mesh the error says why.
    pub fn into_solid(self) -> Result<Box<dyn Shape>, Option<NotClosed>> {
        match self {
            Self::Custom(primitive) if primitive.is_solid() => Ok(primitive),
            Self::Triangles(mesh) => Ok(Box::new(ClosedMesh::new(mesh)?)),
            _ => Err(None),
        }
    }
}

impl ClosedMesh {
    /// Fails if the mesh has no inside. Vertices at the same position count as one.
    pub fn new(mesh: TriangleMesh) -> Result<Self, NotClosed> {
        let open = open_edges(&mesh);
        if open > 0 {
            return Err(NotClosed::Edges(open));
        }
        if volume(&mesh).is_sign_negative() {
            return Err(NotClosed::InsideOut);
        }
        let mut order: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
        let mut nodes = Vec::new();
        let end = order.len();
        build(&mesh, &mut order, 0..end, &mut nodes);
        Ok(Self { mesh, order, nodes })
    }

    /// Upper bound on the bytes that [`Self::new`] allocates, without the mesh itself.
    pub fn bytes(mesh: &TriangleMesh) -> u64 {
        // At least two triangles per leaf, so at most one node per triangle. A mesh has 1.5 edges
        // per triangle; when their hash table, which is at most 7/8 full, doubles, the old and the
        // new one together have room for 1.5 * 3 * 8/7 = 5.1.
        let each = size_of::<u32>() + size_of::<Node>() + 6 * size_of::<([[u64; 3]; 2], i64)>();
        mesh.triangles.len() as u64 * each as u64
    }

    /// Calls `visit` for all triangles near the line.
    fn near(&self, ray: &Ray, mut visit: impl FnMut(u32)) {
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            if is_near(ray, &node.bounds) {
                for triangle in &self.order[node.triangles.clone()] {
                    visit(*triangle);
                }
                at += 1;
            } else {
                at = node.next;
            }
        }
    }
}

impl TriangleMesh {
    /// Whether the mesh bounds a volume: every edge is traversed equally often in both directions.
    /// Vertices at the same position count as one.
    pub fn is_closed(&self) -> bool {
        open_edges(self) == 0
    }
}

/// Number of edges whose traversals do not cancel.
fn open_edges(mesh: &TriangleMesh) -> usize {
    // Adding 0 turns -0 into +0: both are the same position.
    let place = |vertex: u32| {
        (mesh.positions[vertex as usize] + 0.0)
            .to_array()
            .map(f64::to_bits)
    };
    let mut balance = HashMap::new();
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(place);
        for (from, to) in [(a, b), (b, c), (c, a)] {
            if from < to {
                *balance.entry((from, to)).or_insert(0_i64) += 1;
            } else if to < from {
                *balance.entry((to, from)).or_insert(0) -= 1;
            }
        }
    }
    balance.values().filter(|sum| **sum != 0).count()
}

/// Six times the signed volume, positive if triangles face outwards.
fn volume(mesh: &TriangleMesh) -> f64 {
    let center = bounds(mesh, 0..mesh.triangles.len() as u32).center();
    let parts = (0..mesh.triangles.len() as u32).map(|triangle| {
        let [a, b, c] = mesh.corners(triangle).map(|corner| corner - center);
        a.dot(b.cross(c))
    });
    parts.sum::<f64>() * mesh.orientation
}

fn bounds(mesh: &TriangleMesh, triangles: impl IntoIterator<Item = u32>) -> Aabb {
    Aabb::around(triangles.into_iter().flat_map(|triangle| mesh.corners(triangle)))
}

/// Appends the subtree for a range of triangles. The depth is logarithmic.
fn build(mesh: &TriangleMesh, order: &mut [u32], range: Range<usize>, nodes: &mut Vec<Node>) {
    let own = nodes.len();
    let bounds = bounds(mesh, order[range.clone()].iter().copied());
    let is_leaf = range.len() <= LEAF;
    nodes.push(Node {
        bounds,
        next: 0,
        triangles: if is_leaf { range.clone() } else { 0..0 },
    });
    if !is_leaf {
        let extent = bounds.extent();
        let longest = |a: &usize, b: &usize| extent[*a].total_cmp(&extent[*b]);
        let axis = (0..3).max_by(longest).unwrap_or(0);
        let middle = range.len() / 2;
        let place = |triangle: u32| -> f64 {
            mesh.corners(triangle)
                .map(|corner| corner[axis] / 3.0)
                .iter()
                .sum()
        };
        order[range.clone()]
            .select_nth_unstable_by(middle, |a, b| place(*a).total_cmp(&place(*b)).then(a.cmp(b)));
        build(mesh, order, range.start..range.start + middle, nodes);
        build(mesh, order, range.start + middle..range.end, nodes);
    }
    nodes[own].next = nodes.len();
}

/// False only if the line certainly misses the box as [`ShearedRay::shear`] transforms it.
fn is_near(ray: &Ray, bounds: &Aabb) -> bool {
    let (low, high) = (bounds.min - ray.origin, bounds.max - ray.origin);
    // Sheared positions have rounding errors relative to their distance from the line's origin.
    let off = DVec3::splat(8.0 * f64::EPSILON * low.abs().max(high.abs()).max_element());
    let (one, other) = ((low - off) / ray.direction, (high + off) / ray.direction);
    // 0/0 is NaN; `max` and `min` ignore it.
    let near = one
        .min(other)
        .to_array()
        .into_iter()
        .fold(f64::NEG_INFINITY, f64::max);
    let far = one
        .max(other)
        .to_array()
        .into_iter()
        .fold(f64::INFINITY, f64::min);
    near <= far + 4.0 * f64::EPSILON * far.abs().min(f64::MAX)
}

impl Shape for ClosedMesh {
    fn bounds(&self) -> Aabb {
        self.nodes.first().map_or(Aabb::EMPTY, |root| root.bounds)
    }

    fn intersect(&self, ray: &Ray, interval: Interval, origin_primitive: Option<u32>) -> Option<ShapeHit> {
        let mut spans = Spans::new();
        self.spans(ray, &mut spans);
        let inside = origin_primitive.map(|primitive| self.goes_inside(ray, primitive));
        solid::first_end(&spans, interval, inside)
    }

    fn surface(
        &self,
        _: &Ray,
        hit: &PreliminaryIntersection,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction {
        self.mesh.surface(hit, needs)
    }

    fn surface_at_offset(
        &self,
        _: &SurfaceInteraction,
        hit: &PreliminaryIntersection,
        q: DVec3,
        needs: SurfaceAttributes,
    ) -> Option<SurfaceInteraction> {
        Some(self.mesh.surface_at_offset(hit, q, needs))
    }

    fn is_solid(&self) -> bool {
        true
    }

    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        let sheared = ShearedRay::new(ray);
        let mut crossings = Vec::new();
        self.near(ray, |triangle| {
            let [a, b, c] = self.mesh.corners(triangle);
            if let Some(found) = sheared.pierce(a, b, c) {
                let end = ShapeHit {
                    t: found.at.t,
                    primitive: triangle,
                    prim_uv: DVec2::new(found.at.u, found.at.v),
                };
                crossings.push((end, found.from_front == (self.mesh.orientation > 0.0)));
            }
        });
        crossings.sort_by(|(a, _), (b, _)| a.t.total_cmp(&b.t).then(a.primitive.cmp(&b.primitive)));
        let (mut around, mut entered) = (0_i64, None);
        for (end, enters) in crossings {
            let was = around;
            around += if enters { 1 } else { -1 };
            match (was, around) {
                (0, 1) => entered = Some(end),
                (1, 0) => {
                    if let Some(enter) = entered.take() {
                        solid::push(spans, enter, end);
                    }
                }
                _ => {}
            }
        }
    }

    fn primitives(&self) -> u32 {
        self.mesh.triangles.len() as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// An octahedron around the origin with displaced corners.
    fn octahedron(moved: [DVec3; 6]) -> TriangleMesh {
        let corners = [
            DVec3::X,
            DVec3::Y,
            DVec3::Z,
            DVec3::NEG_X,
            DVec3::NEG_Y,
            DVec3::NEG_Z,
        ];
        let mut triangles = Vec::new();
        for (x, y, z) in [(0, 1, 2), (3, 4, 2), (3, 1, 5), (0, 4, 5)] {
            triangles.push([x, y, z]);
        }
        for (x, y, z) in [(3, 1, 2), (0, 4, 2), (0, 1, 5), (3, 4, 5)] {
            triangles.push([y, x, z]);
        }
        TriangleMesh {
            positions: std::array::from_fn::<_, 6, _>(|i| corners[i] + moved[i]).to_vec(),
            triangles,
            orientation: 1.0,
            ..TriangleMesh::default()
        }
    }

    fn spans(solid: &ClosedMesh, ray: &Ray) -> Spans {
        let mut spans = Spans::new();
        solid.spans(ray, &mut spans);
        spans
    }

    #[test]
    fn open_meshes_are_rejected() {
        let whole = octahedron([DVec3::ZERO; 6]);
        assert!(ClosedMesh::new(whole.clone()).is_ok());
        let mut open = whole.clone();
        open.triangles.pop();
        assert_eq!(ClosedMesh::new(open).err(), Some(NotClosed::Edges(3)));
        let mut turned = whole.clone();
        turned.triangles[0].swap(0, 1);
        assert_eq!(ClosedMesh::new(turned).err(), Some(NotClosed::Edges(3)));
        let mirrored = TriangleMesh {
            orientation: -1.0,
            ..whole.clone()
        };
        assert_eq!(ClosedMesh::new(mirrored).err(), Some(NotClosed::InsideOut));
        // Unshared vertices: every triangle has its own.
        let split = TriangleMesh {
            positions: (0..8).flat_map(|triangle| whole.corners(triangle)).collect(),
            triangles: (0..8).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
            ..whole
        };
        assert!(ClosedMesh::new(split).is_ok());
    }

    #[test]
    fn lines_run_through_it_from_face_to_face() {
        let solid = ClosedMesh::new(octahedron([DVec3::ZERO; 6])).unwrap();
        // From inside; through two corners; through two edges; a miss.
        let found = |origin: [f64; 3], direction: [f64; 3]| {
            let spans = spans(&solid, &Ray::new(origin.into(), direction.into()));
            spans
                .iter()
                .map(|span| (span.enter.t, span.exit.t))
                .collect::<Vec<_>>()
        };
        assert_eq!(found([0.25, 0.25, 0.0], [0.0, 0.0, -1.0]), [(-0.5, 0.5)]);
        assert_eq!(found([0.0, 0.0, 3.0], [0.0, 0.0, -1.0]), [(2.0, 4.0)]);
        assert_eq!(found([0.5, 3.0, 0.0], [0.0, -1.0, 0.0]), [(2.5, 3.5)]);
        assert_eq!(found([2.0, 0.0, 3.0], [0.0, 0.0, -1.0]), []);
    }

    proptest! {
        /// Lines through corners, edges and along faces: crossings pair up, and the middle of a
        /// span is inside.
        #[test]
        fn crossings_pair_up(
            moved in prop::array::uniform6(prop::array::uniform3(-0.2..0.2f64)),
            eye in prop::array::uniform3(-10.0..10.0f64),
            (corner, next, along) in (0usize..6, 1usize..6, prop_oneof![Just(0.0), Just(0.5), 0.0..1.0f64]),
        ) {
            let mesh = octahedron(moved.map(DVec3::from));
            let other = (corner + next) % 6;
            let solid = ClosedMesh::new(mesh.clone()).unwrap();
            let target = mesh.positions[corner].lerp(mesh.positions[other], along);
            let eye = if along == 0.5 { target + (mesh.positions[other] - mesh.positions[corner]) } else { DVec3::from(eye) };
            let ray = Ray::new(eye, target - eye);
            let sheared = ShearedRay::new(&ray);
            let (mut front, mut back) = (0, 0);
            for triangle in 0..8 {
                let [a, b, c] = mesh.corners(triangle);
                match sheared.pierce(a, b, c) {
                    Some(found) if found.from_front => front += 1,
                    Some(_) => back += 1,
                    None => {}
                }
            }
            prop_assert_eq!(front, back);
            let all = spans(&solid, &ray);
            prop_assert!(all.len() <= front);
            for span in all {
                prop_assert!(span.enter.t < span.exit.t);
                let middle = ray.at(0.5 * (span.enter.t + span.exit.t));
                let cut = spans(&solid, &Ray::new(middle, DVec3::new(0.3, -0.5, 0.8)));
                // A line may run along an edge or a face, where either answer is correct.
                let on_surface = (0..8).any(|triangle| {
                    let [a, b, c] = mesh.corners(triangle);
                    (b - a).cross(c - a).normalize().dot(middle - a).abs() < 1e-9
                });
                prop_assert!(on_surface || cut.iter().any(|s| s.enter.t < 0.0 && s.exit.t > 0.0));
            }
        }
    }
}
