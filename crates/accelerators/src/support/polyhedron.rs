//! Convex polygons and polyhedra, and their clipping by planes.

use std::cmp::Ordering;
use whitstone_core::{Aabb, DVec3};

/// A plane: the points whose dot product with the normal is `at`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Plane {
    /// Of unit length, up to rounding.
    pub(crate) normal: DVec3,
    pub(crate) at: f64,
}

impl Plane {
    /// Signed distance of a point above the plane.
    #[inline]
    pub(crate) fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.at
    }
}

/// The parts of a convex polygon below and above a plane (Sutherland and Hodgman, *Reentrant
/// polygon clipping*, 1974). Corners within the margin of the plane count as in it and belong to
/// both parts.
pub(crate) fn cut_polygon(corners: &[DVec3], plane: &Plane, margin: f64) -> [Vec<DVec3>; 2] {
    let mut parts = [const { Vec::new() }; 2];
    let heights = || corners.iter().map(|&corner| (corner, plane.height(corner)));
    for ((a, height_a), (b, height_b)) in heights().zip(heights().cycle().skip(1)) {
        if height_a <= margin {
            parts[0].push(a);
        }
        if height_a >= -margin {
            parts[1].push(a);
        }
        let crosses =
            height_a.abs() > margin && height_b.abs() > margin && (height_a < 0.0) != (height_b < 0.0);
        if crosses {
            // Independent of the polygon's orientation to the last bit, so that neighbours share
            // the point.
            let [(low, low_height), (high, high_height)] = if height_a < 0.0 {
                [(a, height_a), (b, height_b)]
            } else {
                [(b, height_b), (a, height_a)]
            };
            let point = low.lerp(high, low_height / (low_height - high_height));
            parts.iter_mut().for_each(|part| part.push(point));
        }
    }
    parts
}

fn area(polygon: &[DVec3]) -> f64 {
    let fan = |pair: &[DVec3]| (pair[0] - polygon[0]).cross(pair[1] - polygon[0]);
    let sum: DVec3 = polygon.windows(2).map(fan).sum();
    0.5 * sum.length()
}

/// A convex polyhedron, given by its faces. Used for areas and debug images, where rounding does
/// not matter.
#[derive(Clone, Debug, Default)]
pub(crate) struct Polyhedron {
    faces: Vec<Vec<DVec3>>,
}

impl Polyhedron {
    pub(crate) fn of_box(aabb: &Aabb) -> Self {
        let corner = |axis: usize, [a, b, c]: [usize; 3]| {
            let side = |which| [aabb.min, aabb.max][which];
            let (b_axis, c_axis) = ((axis + 1) % 3, (axis + 2) % 3);
            let mut point = side(a);
            (point[b_axis], point[c_axis]) = (side(b)[b_axis], side(c)[c_axis]);
            point
        };
        let face = |(axis, a)| [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[b, c]| corner(axis, [a, b, c]));
        let faces = (0..3).flat_map(|axis| [(axis, 0), (axis, 1)]);
        Self {
            faces: faces.map(|which| face(which).to_vec()).collect(),
        }
    }

    /// Half the surface area.
    pub(crate) fn half_area(&self) -> f64 {
        0.5 * self.faces.iter().map(|face| area(face)).sum::<f64>()
    }

    /// The end points of the edges, each edge once.
    pub(crate) fn edges(&self) -> Vec<[DVec3; 2]> {
        let order = |a: &DVec3, b: &DVec3| {
            let axes = a.to_array().into_iter().zip(b.to_array());
            axes.fold(Ordering::Equal, |order, (a, b)| order.then(a.total_cmp(&b)))
        };
        let around = |face: &Vec<DVec3>| face.clone().into_iter().cycle().skip(1).take(face.len());
        let pairs = self
            .faces
            .iter()
            .flat_map(|face| face.iter().copied().zip(around(face)));
        let mut edges: Vec<[DVec3; 2]> = pairs
            .map(|(a, b)| if order(&b, &a).is_lt() { [b, a] } else { [a, b] })
            .collect();
        edges.sort_by(|[a, b], [c, d]| order(a, c).then(order(b, d)));
        edges.dedup();
        edges
    }

    /// Whether the polyhedron reaches beyond the margin on both sides of a plane.
    pub(crate) fn is_on_both_sides(&self, plane: &Plane, margin: f64) -> bool {
        let heights = || self.faces.iter().flatten().map(|&corner| plane.height(corner));
        heights().any(|height| height < -margin) && heights().any(|height| height > margin)
    }

    /// The parts below and above a plane.
    pub(crate) fn cut(&self, plane: &Plane) -> [Self; 2] {
        let mut parts = [Self::default(), Self::default()];
        let mut rim: Vec<DVec3> = Vec::new();
        for face in &self.faces {
            let halves = cut_polygon(face, plane, 0.0);
            let both = halves.iter().all(|half| half.len() > 2);
            if both {
                // Corners that both halves share lie in the plane.
                rim.extend(halves[0].iter().filter(|corner| halves[1].contains(corner)));
            }
            for (part, half) in parts.iter_mut().zip(halves) {
                if half.len() > 2 {
                    part.faces.push(half);
                }
            }
        }
        if rim.len() > 2 {
            let lid = around(rim, plane.normal);
            parts.iter_mut().for_each(|part| part.faces.push(lid.clone()));
        }
        parts
    }
}

/// Sorts boundary points of a convex polygon with this normal by angle.
fn around(mut points: Vec<DVec3>, normal: DVec3) -> Vec<DVec3> {
    let middle = points.iter().sum::<DVec3>() / points.len() as f64;
    let u = normal.any_orthonormal_vector();
    let v = normal.cross(u);
    let angle = |point: &DVec3| libm::atan2((*point - middle).dot(v), (*point - middle).dot(u));
    points.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
    points.dedup();
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cube_that_is_cut_keeps_its_surface_and_gains_two_lids() {
        let cube = Polyhedron::of_box(&Aabb::around([DVec3::ZERO, DVec3::ONE]));
        assert_eq!((cube.half_area(), cube.edges().len()), (3.0, 12));
        // A regular hexagon through six edges.
        let normal = DVec3::ONE.normalize();
        let plane = Plane {
            normal,
            at: normal.dot(DVec3::splat(0.5)),
        };
        let halves = cube.cut(&plane);
        let hexagon = 0.75 * 3f64.sqrt();
        for half in &halves {
            assert!((half.half_area() - 0.5 * (3.0 + hexagon)).abs() < 1e-12);
            // Three edges of the cube, six halves, six of the lid, as Euler's formula gives for 10
            // corners and 7 faces.
            assert_eq!(half.edges().len(), 15);
        }
        // Once more, through the corners of the lid too.
        let plane = Plane {
            normal: DVec3::X,
            at: 0.5,
        };
        let [a, b] = halves[0].cut(&plane);
        let lids = a.half_area() + b.half_area() - halves[0].half_area();
        assert!((lids - 0.5).abs() < 1e-12, "{lids}");
        // Beyond it.
        let plane = Plane {
            normal: DVec3::X,
            at: 2.0,
        };
        let [all, nothing] = cube.cut(&plane);
        assert_eq!((all.half_area(), nothing.half_area()), (3.0, 0.0));
    }
}
