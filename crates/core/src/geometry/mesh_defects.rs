//! Defects of meshes that should bound a body: a refracted ray then enters without leaving, or
//! leaves twice.

use crate::{BsdfFlags, LoweredShape, Scene, TriangleMesh};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fmt;

/// The defects that keep a mesh from bounding a body. Vertices at the same position count as one.
/// Triangles with two corners at the same position are never hit and are ignored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MeshDefects {
    /// Edges with one face.
    pub border_edges: usize,
    /// Edges with more than two faces.
    pub crowded_edges: usize,
    /// Edges whose two faces have opposite orientation.
    pub flipped_edges: usize,
    /// Faces with the same three corners as an earlier face.
    pub duplicate_faces: usize,
}

impl MeshDefects {
    /// Counts the defects. A duplicate face is counted and then ignored: its edges are those of the
    /// first face.
    pub fn of(mesh: &TriangleMesh) -> Self {
        let mut places = HashMap::new();
        let mut faces = HashMap::new();
        // Per edge: the number of its faces, and the number of traversals in one direction minus
        // those in the other.
        let mut edges: HashMap<[usize; 2], (usize, i64)> = HashMap::new();
        let mut defects = Self::default();
        for triangle in &mesh.triangles {
            let corners = triangle.map(|vertex| {
                // Adding 0 turns -0 into +0: both are the same position.
                let place = (mesh.positions[vertex as usize] + 0.0).to_array();
                let next = places.len();
                *places.entry(place.map(f64::to_bits)).or_insert(next)
            });
            let [a, b, c] = corners;
            if a == b || b == c || c == a {
                continue;
            }
            let mut sorted = corners;
            sorted.sort_unstable();
            if faces.insert(sorted, ()).is_some() {
                defects.duplicate_faces += 1;
                continue;
            }
            for (from, to) in [(a, b), (b, c), (c, a)] {
                let (count, balance) = edges.entry([from.min(to), from.max(to)]).or_default();
                *count += 1;
                *balance += if from < to { 1 } else { -1 };
            }
        }
        for (count, balance) in edges.values() {
            match count {
                1 => defects.border_edges += 1,
                2 if *balance != 0 => defects.flipped_edges += 1,
                2 => {}
                _ => defects.crowded_edges += 1,
            }
        }
        defects
    }

    /// Whether there are no defects.
    pub fn is_empty(self) -> bool {
        self == Self::default()
    }
}

impl fmt::Display for MeshDefects {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let counts = [
            (self.border_edges, "border edge", "border edges"),
            (
                self.crowded_edges,
                "edge of more than two faces",
                "edges of more than two faces",
            ),
            (
                self.flipped_edges,
                "edge between faces of opposite orientation",
                "edges between faces of opposite orientation",
            ),
            (self.duplicate_faces, "duplicate face", "duplicate faces"),
        ];
        let parts: Vec<String> = counts
            .into_iter()
            .filter(|(count, ..)| *count > 0)
            .map(|(count, one, many)| format!("{count} {}", if count == 1 { one } else { many }))
            .collect();
        f.write_str(&parts.join(", "))
    }
}

impl Scene {
    /// The refracting meshes that do not bound a body, by the numbers of their shapes. Meshes in
    /// groups count once, however many instances there are.
    pub fn open_refracting_meshes(&self) -> Vec<(u32, MeshDefects)> {
        let mut found = BTreeMap::new();
        let refracting = (self.materials.iter().zip(0..))
            .filter(|(material, _)| material.flags().contains(BsdfFlags::TRANSMISSION))
            .map(|(_, number)| self.shape_id(number))
            .collect();
        find_open(self.geometry.shapes(), 0, &refracting, &mut found);
        found
            .into_iter()
            .filter(|(_, defects)| !defects.is_empty())
            .collect()
    }
}

fn find_open(
    shapes: &[LoweredShape],
    first: u32,
    refracting: &BTreeSet<u32>,
    found: &mut BTreeMap<u32, MeshDefects>,
) {
    for (shape, number) in shapes.iter().zip(first..) {
        match shape {
            LoweredShape::Triangles(mesh) => {
                if refracting.contains(&number) {
                    found.entry(number).or_insert_with(|| MeshDefects::of(mesh));
                }
            }
            LoweredShape::Instance(instance) => {
                let group = instance.group();
                find_open(group.geometry().shapes(), group.first_shape(), refracting, found);
            }
            LoweredShape::Custom(_) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DVec3;

    /// The surface of a box of `size`³ cubes; each square is two triangles.
    fn walls(size: i32) -> TriangleMesh {
        let mut mesh = TriangleMesh {
            orientation: 1.0,
            ..TriangleMesh::default()
        };
        for axis in 0..3 {
            for (side, turned) in [(0, true), (size, false)] {
                for (i, j) in (0..size).flat_map(|i| (0..size).map(move |j| (i, j))) {
                    let corner = |a: i32, b: i32| {
                        let mut p = [0.0; 3];
                        p[axis] = f64::from(side);
                        p[(axis + 1) % 3] = f64::from(i + a);
                        p[(axis + 2) % 3] = f64::from(j + b);
                        DVec3::from_array(p)
                    };
                    // Unshared vertices: each square has its own, as in files with vertex normals.
                    let first = mesh.positions.len() as u32;
                    mesh.positions
                        .extend([corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)]);
                    for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
                        let [b, c] = if turned { [c, b] } else { [b, c] };
                        mesh.triangles.push([first + a, first + b, first + c]);
                    }
                }
            }
        }
        mesh
    }

    #[test]
    fn a_closed_mesh_has_no_defects() {
        assert!(MeshDefects::of(&walls(4)).is_empty());
    }

    /// Ten duplicate faces and 26 border edges.
    #[test]
    fn holes_and_duplicates_are_counted() {
        let mut mesh = walls(6);
        for face in 0..10 {
            let mut again = mesh.triangles[7 * face];
            again.rotate_left(face % 3);
            mesh.triangles.push(again);
        }
        // On the last side: five isolated squares have 4 edges each, two adjacent ones have 6
        // together.
        let mut removed = [(1, 1), (1, 3), (3, 1), (3, 3), (5, 1), (5, 4), (5, 5)];
        removed.reverse();
        for (i, j) in removed {
            let square = 5 * 72 + 2 * (6 * i + j);
            mesh.triangles.drain(square..square + 2);
        }
        let defects = MeshDefects::of(&mesh);
        assert_eq!((defects.border_edges, defects.duplicate_faces), (26, 10));
        assert_eq!(defects.to_string(), "26 border edges, 10 duplicate faces");
    }

    #[test]
    fn flipped_faces_are_counted() {
        let mut mesh = walls(2);
        mesh.triangles[3].swap(0, 1);
        assert_eq!(MeshDefects::of(&mesh).flipped_edges, 3);
        // A wall through the middle of the box, connected to its sides.
        let mut mesh = walls(1);
        let first = mesh.positions.len() as u32;
        mesh.positions
            .extend([DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 1.0)]);
        mesh.triangles.push([first, first + 1, first + 2]);
        assert!(MeshDefects::of(&mesh).crowded_edges >= 1);
    }
}
