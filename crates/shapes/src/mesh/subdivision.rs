//! Loop subdivision of triangle meshes.
//!
//! Loop, *Smooth subdivision surfaces based on triangles*, 1987; borders use the cubic spline of
//! Hoppe et al., *Piecewise smooth surface reconstruction*, 1994, section 3. Normals are
//! area-weighted sums of the triangle normals; unlike the tangents of the limit surface they need
//! no border rules.

use super::Triangles;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use toml::Spanned;
use whitstone_core::config::IntegerIn;
use whitstone_core::{Context, DVec2, DVec3, SceneError, SceneErrors};

/// Maximum number of triangles, as in a heightfield.
const MAX_TRIANGLES: u64 = 1 << 27;

/// How to refine a mesh.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Subdivision {
    /// Subdivision scheme.
    #[allow(dead_code, reason = "there is one scheme so far")]
    scheme: Scheme,
    /// Number of levels; each divides every triangle into four.
    #[schemars(with = "IntegerIn<1, 8>")]
    levels: Spanned<IntegerIn<1, 8>>,
}

impl Subdivision {
    /// Number of levels; each divides every triangle into four.
    pub(super) fn levels(&self) -> u32 {
        self.levels.get_ref().get()
    }
}

/// Subdivision schemes.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Scheme {
    /// Loop's scheme, for triangles.
    Loop,
}

/// An edge: its end points and the opposite vertices.
struct Edge {
    ends: [u32; 2],
    /// The opposite vertices in its first two triangles.
    opposite: [u32; 2],
    /// Number of triangles that it belongs to.
    sides: u32,
}

impl Edge {
    /// Whether the surface is smooth across the edge.
    fn smooth(&self) -> bool {
        self.sides == 2
    }
}

/// Subdivides a surface; all errors of the request are reported before anything is built.
pub(super) fn subdivide(
    surface: &mut Surface,
    how: &Subdivision,
    context: &mut dyn Context,
) -> Result<(), SceneErrors> {
    let levels = how.levels();
    if surface.sides.is_empty() {
        let message = "all triangles are degenerate: there is nothing to subdivide";
        return Err(SceneError::at(how.levels.span(), message).into());
    }
    let triangles = (surface.sides.len() as u64) << (2 * levels);
    if triangles > MAX_TRIANGLES {
        let message = format!("{levels} levels make {triangles} triangles, more than {MAX_TRIANGLES}");
        return Err(SceneError::at(how.levels.span(), message).into());
    }
    context.reserve(surface.bytes(levels))?;
    for _ in 0..levels {
        surface.refine();
    }
    Ok(())
}

/// Triangles as point indices, and as indices of texture coordinates.
pub(super) struct Surface {
    pub(super) points: Vec<DVec3>,
    /// Three point indices per triangle.
    pub(super) sides: Vec<[u32; 3]>,
    /// Texture coordinates, and three indices of them per triangle; both empty if the mesh has
    /// none.
    pub(super) uvs: Vec<DVec2>,
    pub(super) corners: Vec<[u32; 3]>,
}

impl Surface {
    /// Merges corners at equal positions into one point; triangles that become degenerate are
    /// dropped.
    pub(super) fn new(mesh: Triangles) -> Self {
        let mut points = Vec::new();
        let mut known: HashMap<[u64; 3], u32> = HashMap::new();
        let of_vertex: Vec<u32> = mesh
            .positions
            .iter()
            .map(|position| {
                // Adding zero turns -0 into +0.
                let key = (*position + 0.0).to_array().map(f64::to_bits);
                *known.entry(key).or_insert_with(|| {
                    points.push(*position);
                    points.len() as u32 - 1
                })
            })
            .collect();
        let (mut sides, mut corners) = (Vec::new(), Vec::new());
        for triangle in mesh.triangles {
            let [a, b, c] = triangle.map(|vertex| of_vertex[vertex as usize]);
            if a != b && b != c && c != a {
                sides.push([a, b, c]);
                corners.push(triangle);
            }
        }
        if mesh.uvs.is_empty() {
            corners.clear();
        }
        Self {
            points,
            sides,
            uvs: mesh.uvs,
            corners,
        }
    }

    /// Upper bound on the memory for subdivision, in bytes.
    fn bytes(&self, levels: u32) -> u64 {
        let [points, triangles] = self.size_after(levels);
        // The last level reads a quarter of the triangles and writes all of them; points get
        // normals at the end.
        let point = size_of::<[DVec3; 2]>() + size_of::<DVec2>();
        let triangle = 2 * size_of::<[u32; 3]>() + size_of::<[u64; 3]>();
        points * point as u64 + triangles * triangle as u64
    }

    /// Upper bounds on points and triangles: each level splits every edge in two and adds three per
    /// triangle.
    pub(super) fn size_after(&self, levels: u32) -> [u64; 2] {
        let (mut points, mut triangles) = (self.points.len() as u64, self.sides.len() as u64);
        let mut edges = 3 * triangles;
        for _ in 0..levels {
            (points, edges, triangles) = (points + edges, 2 * edges + 3 * triangles, 4 * triangles);
        }
        [points, triangles]
    }

    fn refine(&mut self) {
        let (edges, numbers) = edges_of(&self.sides);
        let points = divided_points(&self.points, &edges);
        let first_new = self.points.len() as u32;
        let divided = divide(&self.sides, &numbers, first_new);
        if !self.corners.is_empty() {
            let (edges, numbers) = edges_of(&self.corners);
            let first_new = self.uvs.len() as u32;
            let middles = edges.iter().map(|edge| {
                let [a, b] = edge.ends.map(|end| self.uvs[end as usize]);
                0.5 * (a + b)
            });
            let middles: Vec<DVec2> = middles.collect();
            self.uvs.extend(middles);
            self.corners = divide(&self.corners, &numbers, first_new);
        }
        (self.points, self.sides) = (points, divided);
    }

    /// The sum at each point of its triangles' normals, each as long as twice the triangle's area.
    pub(super) fn normals(&self) -> Vec<DVec3> {
        let mut normals = vec![DVec3::ZERO; self.points.len()];
        for triangle in &self.sides {
            let [a, b, c] = triangle.map(|point| self.points[point as usize]);
            let normal = (b - a).cross(c - a);
            for point in triangle {
                normals[*point as usize] += normal;
            }
        }
        normals
    }

    /// Converts to vertices, each with a position, a normal and texture coordinates.
    pub(super) fn finish(self) -> Triangles {
        let normals = self.normals();
        if self.corners.is_empty() {
            return Triangles {
                positions: self.points,
                normals,
                triangles: self.sides,
                ..Triangles::default()
            };
        }
        // One vertex per texture coordinate: all its corners are at one point.
        let mut point_of = vec![0; self.uvs.len()];
        for (corners, points) in self.corners.iter().zip(&self.sides) {
            for (corner, point) in corners.iter().zip(points) {
                point_of[*corner as usize] = *point as usize;
            }
        }
        Triangles {
            positions: point_of.iter().map(|point| self.points[*point]).collect(),
            normals: point_of.iter().map(|point| normals[*point]).collect(),
            uvs: self.uvs,
            triangles: self.corners,
            ..Triangles::default()
        }
    }
}

/// The edges, sorted by their end points, and for each triangle (a, b, c) the indices of ab, bc and
/// ca.
fn edges_of(triangles: &[[u32; 3]]) -> (Vec<Edge>, Vec<[u32; 3]>) {
    let mut sides: Vec<(u64, u32, u8)> = Vec::with_capacity(3 * triangles.len());
    for (triangle, number) in triangles.iter().zip(0..) {
        for side in 0..3_u8 {
            let [a, b] = [triangle[side as usize], triangle[(side as usize + 1) % 3]];
            sides.push((u64::from(a.min(b)) << 32 | u64::from(a.max(b)), number, side));
        }
    }
    sides.sort_unstable();
    let mut edges = Vec::new();
    let mut numbers = vec![[0; 3]; triangles.len()];
    for same in sides.chunk_by(|a, b| a.0 == b.0) {
        let (key, ..) = same[0];
        let mut opposite = [0; 2];
        for (opposite, &(_, triangle, side)) in opposite.iter_mut().zip(same) {
            *opposite = triangles[triangle as usize][(side as usize + 2) % 3];
        }
        for &(_, triangle, side) in same {
            numbers[triangle as usize][side as usize] = edges.len() as u32;
        }
        edges.push(Edge {
            ends: [(key >> 32) as u32, key as u32],
            opposite,
            sides: same.len() as u32,
        });
    }
    (edges, numbers)
}

/// The new points: vertex points, then edge points.
fn divided_points(points: &[DVec3], edges: &[Edge]) -> Vec<DVec3> {
    /// The neighbours of a point.
    #[derive(Clone, Copy, Default)]
    struct Around {
        sum: DVec3,
        count: u32,
        /// The sum of the neighbours across sharp edges.
        sharp_sum: DVec3,
        sharp_count: u32,
    }
    let mut around = vec![Around::default(); points.len()];
    for edge in edges {
        let [a, b] = edge.ends;
        for (here, there) in [(a, b), (b, a)] {
            let there = points[there as usize];
            let around = &mut around[here as usize];
            around.sum += there;
            around.count += 1;
            if !edge.smooth() {
                around.sharp_sum += there;
                around.sharp_count += 1;
            }
        }
    }
    let vertex_points = points.iter().zip(&around).map(|(&point, around)| match around {
        // A point without triangles.
        Around { count: 0, .. } => point,
        Around {
            sharp_count: 0,
            sum,
            count,
            ..
        } => {
            let k = f64::from(*count);
            let beta = weight(k);
            (1.0 - k * beta) * point + beta * *sum
        }
        Around {
            sharp_count: 2,
            sharp_sum,
            ..
        } => 0.75 * point + 0.125 * *sharp_sum,
        _ => point,
    });
    let edge_points = edges.iter().map(|edge| {
        let ends: DVec3 = edge.ends.iter().map(|end| points[*end as usize]).sum();
        if edge.smooth() {
            let opposite: DVec3 = edge.opposite.iter().map(|point| points[*point as usize]).sum();
            0.375 * ends + 0.125 * opposite
        } else {
            0.5 * ends
        }
    });
    vertex_points.chain(edge_points).collect()
}

/// Loop's weight of each of the k neighbours of a point.
fn weight(k: f64) -> f64 {
    let middle = 0.375 + 0.25 * libm::cos(std::f64::consts::TAU / k);
    (0.625 - middle * middle) / k
}

/// Splits each triangle into four: one at each corner and one in the middle. Edge points are
/// numbered from `first`.
fn divide(triangles: &[[u32; 3]], edges: &[[u32; 3]], first: u32) -> Vec<[u32; 3]> {
    let four = |(triangle, edges): (&[u32; 3], &[u32; 3])| {
        let ([a, b, c], [ab, bc, ca]) = (*triangle, edges.map(|edge| first + edge));
        [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
    };
    triangles.iter().zip(edges).flat_map(four).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refined(positions: &[[f64; 3]], triangles: &[[u32; 3]], levels: usize) -> Triangles {
        let mut surface = Surface::new(Triangles {
            positions: positions.iter().map(|p| DVec3::from(*p)).collect(),
            triangles: triangles.to_vec(),
            ..Triangles::default()
        });
        for _ in 0..levels {
            surface.refine();
        }
        surface.finish()
    }

    const OCTAHEDRON: [[f64; 3]; 6] = [
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [-1.0, 0.0, 0.0],
        [0.0, -1.0, 0.0],
        [0.0, 0.0, -1.0],
    ];
    const EIGHT: [[u32; 3]; 8] = [
        [0, 1, 2],
        [1, 3, 2],
        [3, 4, 2],
        [4, 0, 2],
        [1, 0, 5],
        [3, 1, 5],
        [4, 3, 5],
        [0, 4, 5],
    ];

    #[test]
    fn an_octahedron_by_hand() {
        let mesh = refined(&OCTAHEDRON, &EIGHT, 1);
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (18, 32));
        // Four neighbours that cancel: 1 - 4 beta with beta = (5/8 - 9/64)/4.
        assert!((mesh.positions[0] - DVec3::X * (33.0 / 64.0)).length() < 1e-15);
        // The edge of x and y, opposite to +z and -z.
        let [a, ab, ca] = mesh.triangles[0];
        assert_eq!(a, 0);
        assert_eq!(mesh.positions[ab as usize], DVec3::new(0.375, 0.375, 0.0));
        assert_eq!(mesh.positions[ca as usize], DVec3::new(0.375, 0.0, 0.375));
        assert_eq!(mesh.triangles[3][0], ab);
        for (position, normal) in mesh.positions.iter().zip(&mesh.normals) {
            let off = normal.normalize() - position.normalize();
            assert!(off.length() < 0.06, "{position} {normal}");
        }
    }

    #[test]
    fn weights_are_those_of_loop() {
        assert!((weight(3.0) - 3.0 / 16.0).abs() < 1e-15);
        assert!((weight(6.0) - 1.0 / 16.0).abs() < 1e-15);
    }

    /// A flat border becomes the cubic spline of its points; a corner with a single triangle has
    /// two sharp edges.
    #[test]
    fn borders_are_splines() {
        let mesh = refined(&[[0.0; 3], [8.0, 0.0, 0.0], [0.0, 8.0, 0.0]], &[[0, 1, 2]], 1);
        assert_eq!(mesh.positions[0], DVec3::new(1.0, 1.0, 0.0));
        assert_eq!(mesh.positions[1], DVec3::new(6.0, 1.0, 0.0));
        let [_, ab, _] = mesh.triangles[0];
        assert_eq!(mesh.positions[ab as usize], DVec3::new(4.0, 0.0, 0.0));
    }

    /// Three triangles at one edge make it sharp; its ends have four or more sharp edges and do not
    /// move.
    #[test]
    fn what_is_no_surface_stays() {
        let positions = [
            [0.0; 3],
            [0.0, 0.0, 4.0],
            [4.0, 0.0, 0.0],
            [0.0, 4.0, 0.0],
            [-4.0, 0.0, 0.0],
        ];
        let mesh = refined(&positions, &[[0, 1, 2], [0, 1, 3], [0, 1, 4]], 1);
        assert_eq!(mesh.positions[0], DVec3::ZERO);
        assert_eq!(mesh.positions[1], DVec3::new(0.0, 0.0, 4.0));
    }

    #[test]
    fn seams_of_texture_coordinates_do_not_open() {
        // Two triangles with a common edge, whose texture coordinates differ between the triangles.
        let corners = [
            [0.0, 0.0],
            [1.0, 0.0],
            [0.0, 1.0],
            [1.0, 0.0],
            [1.0, 1.0],
            [0.0, 1.0],
        ];
        let positions = corners.map(|[x, y]| DVec3::new(x, y, 0.0)).to_vec();
        let uvs = (0..6)
            .map(|k| DVec2::new(f64::from(k), f64::from(k * k)))
            .collect();
        let triangles = vec![[0, 1, 2], [3, 4, 5], [0, 0, 1], [1, 3, 4]];
        let mut surface = Surface::new(Triangles {
            positions,
            uvs,
            triangles,
            ..Triangles::default()
        });
        assert_eq!((surface.points.len(), surface.sides.len()), (4, 2));
        surface.refine();
        let mesh = surface.finish();
        let at = |triangle: usize, corner: usize| {
            let vertex = mesh.triangles[triangle][corner] as usize;
            (mesh.positions[vertex], mesh.uvs[vertex])
        };
        // Edge bc of the first triangle and ca of the second.
        let (here, there) = (at(1, 2), at(4, 2));
        assert_eq!(here.0, there.0);
        assert_eq!(here.1, DVec2::new(1.5, 2.5));
        assert_eq!(there.1, DVec2::new(4.0, 17.0));
        assert_eq!(mesh.positions.len(), mesh.normals.len());
    }

    /// Convergence: on a sphere-like surface the vertices move less with each level.
    #[test]
    fn levels_converge() {
        let radius = |levels| {
            let mesh = refined(&OCTAHEDRON, &EIGHT, levels);
            assert_eq!(mesh.triangles.len(), 8 << (2 * levels));
            mesh.positions[0].length()
        };
        let steps = [1, 2, 3, 4, 5].map(radius);
        for k in 1..4 {
            assert!((steps[k] - steps[k + 1]).abs() < 0.5 * (steps[k - 1] - steps[k]).abs());
        }
    }
}
