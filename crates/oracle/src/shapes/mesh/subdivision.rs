//! Loop subdivision: section 9 of the model.

use super::Mesh;
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;
use whitstone_core::DVec3;

/// A triangle: the indices of its points, and their texture coordinates.
pub(super) type Face = ([usize; 3], Option<[[f64; 2]; 3]>);

/// A mesh in which vertices at equal positions are one point.
pub(super) struct Joined {
    pub(super) points: Vec<DVec3>,
    pub(super) faces: Vec<Face>,
}

impl Joined {
    /// The mesh of level 0. Drops triangles with two corners at the same point.
    pub(super) fn new(mesh: &Mesh) -> Self {
        let mut numbers: BTreeMap<[u64; 3], usize> = BTreeMap::new();
        let mut points: Vec<DVec3> = Vec::new();
        let mut faces: Vec<Face> = Vec::new();
        for (triangle, uvs) in mesh.triangles.iter().zip(&mesh.uvs) {
            let corners = triangle.map(|corner| {
                // -0 and 0 are equal.
                *numbers
                    .entry(corner.map(|x| (x + 0.0).to_bits()))
                    .or_insert_with(|| {
                        points.push(corner.into());
                        points.len() - 1
                    })
            });
            let [a, b, c] = corners;
            if a != b && b != c && c != a {
                faces.push((corners, *uvs));
            }
        }
        Self { points, faces }
    }

    /// The mesh after `levels` further levels.
    pub(super) fn subdivided(mut self, levels: u32) -> Self {
        for _ in 0..levels {
            (self.points, self.faces) = level(&self.points, &self.faces);
        }
        self
    }

    /// The unit normal of each point; zero if it has none.
    pub(super) fn normals(&self) -> Vec<DVec3> {
        let mut normals = vec![DVec3::ZERO; self.points.len()];
        for (corners, _) in &self.faces {
            let [a, b, c] = corners.map(|corner| self.points[corner]);
            for corner in corners {
                normals[*corner] += (b - a).cross(c - a);
            }
        }
        normals.into_iter().map(DVec3::normalize_or_zero).collect()
    }

    /// The triangles with the normals of their points.
    pub(super) fn mesh(&self) -> Mesh {
        let normals = self.normals();
        let corners_of = |of: &[DVec3], corners: &[usize; 3]| corners.map(|corner| of[corner].to_array());
        Mesh {
            triangles: (self.faces.iter())
                .map(|(corners, _)| corners_of(&self.points, corners))
                .collect(),
            normals: (self.faces.iter())
                .map(|(corners, _)| Some(corners_of(&normals, corners)))
                .collect(),
            uvs: self.faces.iter().map(|(_, uvs)| *uvs).collect(),
            ..Mesh::default()
        }
    }
}

fn level(points: &[DVec3], faces: &[Face]) -> (Vec<DVec3>, Vec<Face>) {
    let edge = |a: usize, b: usize| (a.min(b), a.max(b));
    // The points opposite each edge; a smooth edge has two.
    let mut opposite: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
    for ([a, b, c], _) in faces {
        for (p, q, r) in [(*a, *b, *c), (*b, *c, *a), (*c, *a, *b)] {
            opposite.entry(edge(p, q)).or_default().push(r);
        }
    }
    let mut around: Vec<BTreeSet<usize>> = vec![BTreeSet::new(); points.len()];
    let mut sharp: Vec<Vec<usize>> = vec![Vec::new(); points.len()];
    for ((a, b), others) in &opposite {
        around[*a].insert(*b);
        around[*b].insert(*a);
        if others.len() != 2 {
            sharp[*a].push(*b);
            sharp[*b].push(*a);
        }
    }
    let moved = |a: usize| {
        let sum = |of: &mut dyn Iterator<Item = &usize>| of.map(|other| points[*other]).sum::<DVec3>();
        match sharp[a].len() {
            0 if around[a].is_empty() => points[a],
            0 => {
                let k = around[a].len() as f64;
                let part = 3.0 / 8.0 + (TAU / k).cos() / 4.0;
                let beta = (5.0 / 8.0 - part * part) / k;
                points[a] * (1.0 - k * beta) + sum(&mut around[a].iter()) * beta
            }
            2 => points[a] * 0.75 + sum(&mut sharp[a].iter()) * 0.125,
            _ => points[a],
        }
    };
    let mut next: Vec<DVec3> = (0..points.len()).map(moved).collect();
    let mut middles: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    for ((a, b), others) in &opposite {
        let ends = points[*a] + points[*b];
        next.push(match others[..] {
            [c, d] => ends * 0.375 + (points[c] + points[d]) * 0.125,
            _ => ends * 0.5,
        });
        middles.insert((*a, *b), next.len() - 1);
    }
    let four = faces.iter().flat_map(|([a, b, c], uvs)| {
        let [ab, bc, ca] = [(*a, *b), (*b, *c), (*c, *a)].map(|(p, q)| middles[&edge(p, q)]);
        let corners = [[*a, ab, ca], [ab, *b, bc], [ca, bc, *c], [ab, bc, ca]];
        let uvs = uvs.map(|[a, b, c]| {
            let mean = |p: [f64; 2], q: [f64; 2]| [0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1])];
            let (ab, bc, ca) = (mean(a, b), mean(b, c), mean(c, a));
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        });
        (0..4).map(move |k| (corners[k], uvs.map(|uvs| uvs[k])))
    });
    (next, four.collect())
}
