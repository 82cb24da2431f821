//! Flat shapes.

use super::{Real, Roots, Textbook, Vector, at, cross, dot, minus, vector};

/// The plane z = 0.
pub(super) struct Plane;

#[inline]
fn meet<R: Real>(o: Vector<R>, d: Vector<R>) -> Option<(R, Vector<R>)> {
    let t = -o[2] / d[2];
    (t > R::of(0.0)).then(|| (t, at(o, d, t)))
}

impl<R: Real> Textbook<R> for Plane {
    fn intersect(&self, o: Vector<R>, d: Vector<R>) -> Option<R> {
        meet(o, d).map(|(t, _)| t)
    }

    fn roots(&self, o: Vector<R>, d: Vector<R>) -> Roots<R> {
        std::iter::once(-o[2] / d[2]).collect()
    }

    fn starts_inside(&self, _: Vector<R>, d: Vector<R>) -> bool {
        d[2] > R::of(0.0)
    }
}

pub(super) struct Rectangle;

impl<R: Real> Textbook<R> for Rectangle {
    fn intersect(&self, o: Vector<R>, d: Vector<R>) -> Option<R> {
        let (t, p) = meet(o, d)?;
        let one = R::of(1.0);
        (p[0].abs() <= one && p[1].abs() <= one).then_some(t)
    }
}

pub(super) struct Disk;

impl<R: Real> Textbook<R> for Disk {
    fn intersect(&self, o: Vector<R>, d: Vector<R>) -> Option<R> {
        let (t, p) = meet(o, d)?;
        (p[0] * p[0] + p[1] * p[1] <= R::of(1.0)).then_some(t)
    }
}

/// Möller and Trumbore, *Fast, minimum storage ray/triangle intersection*, Journal of Graphics
/// Tools 2(1), 1997.
pub(super) struct Triangles<R>(Vec<[Vector<R>; 3]>);

impl<R: Real> Triangles<R> {
    pub(super) fn new(corners: impl Iterator<Item = [[f64; 3]; 3]>) -> Self {
        Self(corners.map(|corners| corners.map(vector)).collect())
    }
}

impl<R: Real> Textbook<R> for Triangles<R> {
    fn intersect(&self, o: Vector<R>, d: Vector<R>) -> Option<R> {
        let (zero, one) = (R::of(0.0), R::of(1.0));
        let mut best: Option<R> = None;
        for [a, b, c] in &self.0 {
            let (e1, e2) = (minus(*b, *a), minus(*c, *a));
            let p = cross(d, e2);
            let inverse = one / dot(e1, p);
            let s = minus(o, *a);
            let u = dot(s, p) * inverse;
            if !(u >= zero && u <= one) {
                continue;
            }
            let q = cross(s, e1);
            let v = dot(d, q) * inverse;
            if v < zero || u + v > one {
                continue;
            }
            let t = dot(e2, q) * inverse;
            if t > zero && best.is_none_or(|best| t < best) {
                best = Some(t);
            }
        }
        best
    }
}

/// Intersects the plane, then counts the edges that cross a half-line. Glassner (ed.) 1989, ch. 2,
/// 3.2.
pub(super) struct Polygon<R> {
    vertices: Vec<Vector<R>>,
    normal: Vector<R>,
    axes: [usize; 2],
}

impl<R: Real> Polygon<R> {
    pub(super) fn new(vertices: Vec<[f64; 3]>) -> Self {
        let mut normal = [0.0; 3];
        for (p, q) in vertices.iter().zip(vertices.iter().cycle().skip(1)) {
            let part = cross(minus(*p, vertices[0]), minus(*q, vertices[0]));
            normal = at(normal, part, 1.0);
        }
        let largest = (0..3).max_by(|i, j| normal[*i].abs().total_cmp(&normal[*j].abs()));
        let axis = largest.unwrap_or(2);
        Self {
            vertices: vertices.into_iter().map(vector).collect(),
            normal: vector(normal),
            axes: [(axis + 1) % 3, (axis + 2) % 3],
        }
    }
}

impl<R: Real> Textbook<R> for Polygon<R> {
    fn intersect(&self, o: Vector<R>, d: Vector<R>) -> Option<R> {
        let t = dot(self.normal, minus(self.vertices[0], o)) / dot(self.normal, d);
        let ahead = t > R::of(0.0);
        if !ahead {
            return None;
        }
        let hit = at(o, d, t);
        let [b, c] = self.axes;
        let mut inside = false;
        let mut p = self.vertices[self.vertices.len() - 1];
        for q in &self.vertices {
            if (p[c] > hit[c]) != (q[c] > hit[c])
                && hit[b] < (q[b] - p[b]) * (hit[c] - p[c]) / (q[c] - p[c]) + p[b]
            {
                inside = !inside;
            }
            p = *q;
        }
        inside.then_some(t)
    }
}
