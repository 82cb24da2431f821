//! Loop's subdivision. Section 9.

use super::Mesh;
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;
use whitstone_core::DVec3;

/// A triangle: the points of its corners, and their texture coordinates.
type Face = ([usize; 3], Option<[[f64; 2]; 3]>);

/// The mesh after so many levels, with normals at its points.
pub(super) fn subdivided(mesh: &Mesh, levels: u32) -> Mesh {
    let mut numbers: BTreeMap<[u64; 3], usize> = BTreeMap::new();
    let mut points: Vec<DVec3> = Vec::new();
    let mut faces: Vec<Face> = Vec::new();
    for (triangle, uvs) in mesh.triangles.iter().zip(&mesh.uvs) {
        let corners = triangle.map(|corner| {
            // Zeros of both signs are one number.
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
    for _ in 0..levels {
        (points, faces) = level(&points, &faces);
    }
    let mut normals = vec![DVec3::ZERO; points.len()];
    for (corners, _) in &faces {
        let [a, b, c] = corners.map(|corner| points[corner]);
        for corner in corners {
            normals[*corner] += (b - a).cross(c - a);
        }
    }
    let normal = |corner: usize| normals[corner].normalize_or_zero().to_array();
    Mesh {
        triangles: faces
            .iter()
            .map(|(corners, _)| corners.map(|corner| points[corner].to_array()))
            .collect(),
        normals: faces
            .iter()
            .map(|(corners, _)| Some(corners.map(normal)))
            .collect(),
        uvs: faces.iter().map(|(_, uvs)| *uvs).collect(),
    }
}

fn level(points: &[DVec3], faces: &[Face]) -> (Vec<DVec3>, Vec<Face>) {
    let edge = |a: usize, b: usize| (a.min(b), a.max(b));
    // The points opposite to each edge: two of a smooth one.
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
