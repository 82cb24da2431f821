//! Collects the parts of surfaces that lie near other shapes.

use crate::box_tree::BoxTree;
use std::cell::{Cell, OnceCell};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use whitstone_core::{Aabb, DVec3, Element, Geometry, LoweredShape, SurfacePart, Transform, TriangleMesh};

/// Maximum number of parts near other shapes that are compared.
const MAX: usize = 10_000;

/// Maximum number of triangles and shapes that are visited inside instances.
const MAX_VISITED: usize = 8_000_000;

/// Maximum distance of near boxes, relative to the largest coordinate.
const NEAR: f64 = 64.0 * f64::EPSILON;

/// Up to this many neighbours of a shape are stored separately.
const FEW: usize = 16;

/// Maximum number of comparisons of the bounds of shapes.
const MAX_COMPARED: usize = 300_000_000;

/// A part of the surface of a shape.
pub(super) struct Part<'a> {
    /// Number of the shape; for a shape in a group, that of the instance.
    pub(super) shape: usize,
    pub(super) surface: SurfacePart,
    pub(super) aabb: Aabb,
    pub(super) owner: Owner<'a>,
}

/// Determines whether a part belongs to a solid.
#[derive(Clone, Copy)]
pub(super) enum Owner<'a> {
    Custom { solid: bool },
    Mesh(&'a TriangleMesh),
}

/// All parts near other shapes, in the order of the shapes.
pub(super) struct Parts<'a> {
    pub(super) all: Vec<Part<'a>>,
    /// Number of elements of each shape.
    pub(super) sizes: Vec<usize>,
    closed: OnceCell<BTreeMap<usize, bool>>,
}

impl Parts<'_> {
    /// Whether a part belongs to a solid.
    pub(super) fn solid(&self, part: usize) -> bool {
        let key = |mesh: &TriangleMesh| std::ptr::from_ref(mesh) as usize;
        match self.all[part].owner {
            Owner::Custom { solid } => solid,
            Owner::Mesh(mesh) => {
                let all = || {
                    let mut closed = BTreeMap::new();
                    for part in &self.all {
                        if let Owner::Mesh(mesh) = part.owner {
                            closed.entry(key(mesh)).or_insert_with(|| mesh.is_closed());
                        }
                    }
                    closed
                };
                self.closed.get_or_init(all)[&key(mesh)]
            }
        }
    }
}

/// The bounds of a shape.
struct Body {
    number: usize,
    aabb: Aabb,
    /// Set if it consists only of infinite planes.
    planes: Vec<(DVec3, DVec3)>,
}

/// The bounds of the other shapes nearby.
#[derive(Default)]
struct Others {
    /// At most [`FEW`]; one around all if there are more.
    boxes: Vec<Aabb>,
    planes: Vec<(DVec3, DVec3)>,
    /// Set if there are more than [`FEW`] shapes.
    one_box: bool,
    /// Set if there are more than [`FEW`] planes, which are not stored then.
    everywhere: bool,
}

impl Others {
    fn is_empty(&self) -> bool {
        self.boxes.is_empty() && self.planes.is_empty() && !self.everywhere
    }

    fn add(&mut self, body: &Body) {
        if body.planes.is_empty() {
            if self.one_box {
                self.boxes[0] = self.boxes[0].union(body.aabb);
                return;
            }
            self.boxes.push(body.aabb);
            if self.boxes.len() > FEW {
                self.boxes = vec![self.boxes.drain(..).fold(Aabb::EMPTY, Aabb::union)];
                self.one_box = true;
            }
        } else if self.everywhere || self.planes.len() + body.planes.len() > FEW {
            self.planes.clear();
            self.everywhere = true;
        } else {
            self.planes.extend_from_slice(&body.planes);
        }
    }

    /// Whether they are near every part of this box, whatever else is near it.
    fn covers(&self, aabb: &Aabb) -> bool {
        self.one_box && self.boxes[0].min.cmple(aabb.min).all() && self.boxes[0].max.cmpge(aabb.max).all()
    }

    fn near(&self, aabb: &Aabb) -> bool {
        self.everywhere
            || self.boxes.iter().any(|other| overlap(other, aabb))
            || self.planes.iter().any(|plane| crosses(*plane, aabb))
    }
}

fn reach(aabb: &Aabb) -> f64 {
    aabb.min.abs().max(aabb.max.abs()).max_element()
}

fn overlap(a: &Aabb, b: &Aabb) -> bool {
    let near = NEAR * reach(a).min(reach(b));
    let (low, high) = (a.min.max(b.min), a.max.min(b.max));
    (low - near).cmple(high).all()
}

/// Whether a plane passes through a box or touches it.
fn crosses((point, normal): (DVec3, DVec3), aabb: &Aabb) -> bool {
    if !aabb.is_finite() {
        return true;
    }
    let (center, half) = (aabb.center(), 0.5 * aabb.extent());
    let rounding = NEAR * (reach(aabb) + point.abs().max_element());
    (center - point).dot(normal).abs() <= normal.abs().dot(half) + rounding
}

/// The parts that are near other shapes, or why they were not collected.
pub(super) fn collect(geometry: &Geometry) -> Result<Parts<'_>, String> {
    let shapes = geometry.shapes();
    let mut bodies = Vec::new();
    for (shape, number) in shapes.iter().zip(0..) {
        let mut planes = Vec::new();
        if let LoweredShape::Custom(primitive) = shape {
            let parts = primitive.parts();
            if parts.is_empty() {
                continue;
            }
            planes.extend(parts.iter().filter_map(|part| match part {
                SurfacePart::Plane { point, normal } => Some((*point, *normal)),
                _ => None,
            }));
        }
        let element = Element::Custom { shape: number as u32 };
        let aabb = geometry.bounds(element);
        if !aabb.is_empty() {
            bodies.push(Body { number, aabb, planes });
        }
    }
    let others = neighbours(&mut bodies)?;
    let mut collected = Collected {
        parts: Vec::new(),
        visited: 0,
        most: MAX,
    };
    let mut sizes = vec![0; shapes.len()];
    let mut counted = 0;
    for (body, others) in bodies.iter().zip(others) {
        if others.is_empty() {
            continue;
        }
        sizes[body.number] = size(&shapes[body.number], &mut counted);
        collected.add(body.number, &shapes[body.number], None, &others)?;
    }
    Ok(Parts {
        all: collected.parts,
        sizes,
        closed: OnceCell::new(),
    })
}

/// Maximum number of shapes whose elements are counted, because nested groups multiply them.
const MAX_COUNTED: usize = 50_000;

/// Cost of a visited shape inside an instance, in triangles.
const SHAPE_COST: usize = 64;

/// Number of elements, including those of instances, of at most [`MAX_COUNTED`] shapes.
fn size(shape: &LoweredShape, visited: &mut usize) -> usize {
    *visited += 1;
    match shape {
        LoweredShape::Triangles(mesh) => mesh.triangles.len(),
        LoweredShape::Instance(instance) => {
            let mut sum = 0_usize;
            for inside in instance.group().geometry().shapes() {
                if *visited > MAX_COUNTED {
                    return usize::MAX;
                }
                sum = sum.saturating_add(size(inside, visited));
            }
            sum
        }
        _ => 1,
    }
}

/// The nearby shapes of each body, or why they were not searched. Sorts the bodies along x.
fn neighbours(bodies: &mut [Body]) -> Result<Vec<Others>, String> {
    bodies.sort_by(|a, b| {
        a.aabb
            .min
            .x
            .total_cmp(&b.aabb.min.x)
            .then(a.number.cmp(&b.number))
    });
    let mut others: Vec<Others> = bodies.iter().map(|_| Others::default()).collect();
    let (boxed, endless): (Vec<usize>, Vec<usize>) =
        (0..bodies.len()).partition(|body| bodies[*body].planes.is_empty());
    let boxes: Vec<Aabb> = boxed.iter().map(|body| bodies[*body].aabb).collect();
    let tree = BoxTree::new(&boxes);
    let compared = Cell::new(0);
    let count = |more: usize| compared.set(compared.get() + more);
    let exhausted = || compared.get() > MAX_COMPARED;
    for ((start, &body), aabb) in boxed.iter().enumerate().zip(&boxes) {
        let near = NEAR * reach(aabb).min(f64::MAX);
        // Many boxes overlap where shapes are crowded. Those around a shape soon cover it, so that
        // the others make no difference.
        let _ = tree.visit_from(
            start,
            |other| {
                count(1);
                (aabb.min.max(other.min) - near)
                    .cmple(aabb.max.min(other.max))
                    .all()
            },
            |other| {
                if other != start && overlap(aabb, &boxes[other]) {
                    others[body].add(&bodies[boxed[other]]);
                }
                if exhausted() || others[body].covers(aabb) {
                    ControlFlow::Break(())
                } else {
                    ControlFlow::Continue(())
                }
            },
        );
        if exhausted() {
            break;
        }
    }
    for &body in &endless {
        for &other in &endless {
            if other != body && !others[body].everywhere {
                others[body].add(&bodies[other]);
            }
        }
        for (&other, aabb) in boxed.iter().zip(&boxes) {
            // Others cannot become nearer than everywhere.
            if exhausted() || (others[body].everywhere && others[other].everywhere) {
                continue;
            }
            count(bodies[body].planes.len());
            if bodies[body].planes.iter().any(|plane| crosses(*plane, aabb)) {
                others[body].add(&bodies[other]);
                others[other].add(&bodies[body]);
            }
        }
    }
    if exhausted() {
        return Err(format!(
            "more than {MAX_COMPARED} pairs of shapes lie near each other"
        ));
    }
    Ok(others)
}

struct Collected<'a> {
    parts: Vec<Part<'a>>,
    visited: usize,
    most: usize,
}

impl<'a> Collected<'a> {
    fn add(
        &mut self,
        number: usize,
        shape: &'a LoweredShape,
        placed: Option<&Transform>,
        others: &Others,
    ) -> Result<(), String> {
        let visited = match shape {
            LoweredShape::Triangles(mesh) if placed.is_some() => mesh.triangles.len(),
            _ if placed.is_some() => SHAPE_COST,
            _ => 1,
        };
        self.visited += visited;
        if self.visited > MAX_VISITED {
            return Err(format!(
                "instances near other shapes contain more than {MAX_VISITED} triangles"
            ));
        }
        match shape {
            LoweredShape::Triangles(mesh) => {
                let place = |p: DVec3| placed.map_or(p, |placed| placed.point_to_world(p));
                let mirrors =
                    placed.is_some_and(|placed| placed.world_from_object().matrix3.determinant() < 0.0);
                let side = if mirrors {
                    -mesh.orientation
                } else {
                    mesh.orientation
                };
                for triangle in 0..mesh.triangles.len() as u32 {
                    let corners = mesh.corners(triangle).map(place);
                    let aabb = Aabb::around(corners);
                    if !others.near(&aabb) {
                        continue;
                    }
                    let [a, b, c] = corners;
                    let Some(normal) = (b - a).cross(c - a).try_normalize() else {
                        continue;
                    };
                    self.push(Part {
                        shape: number,
                        surface: SurfacePart::Polygon {
                            normal: side * normal,
                            corners: corners.to_vec(),
                            filled: true,
                        },
                        aabb,
                        owner: Owner::Mesh(mesh),
                    })?;
                }
            }
            LoweredShape::Custom(primitive) => {
                let solid = primitive.is_solid() && primitive.bounds().is_finite();
                for part in primitive.parts() {
                    let surface = match placed {
                        None => Some(part),
                        Some(placed) => part.transformed(placed),
                    };
                    let Some(surface) = surface else {
                        continue;
                    };
                    let aabb = surface.bounds();
                    if others.near(&aabb) {
                        self.push(Part {
                            shape: number,
                            surface,
                            aabb,
                            owner: Owner::Custom { solid },
                        })?;
                    }
                }
            }
            LoweredShape::Instance(instance) => {
                let own = match placed {
                    None => Some(*instance.transform()),
                    Some(placed) => placed.after(instance.transform()),
                };
                if let Some(own) = own {
                    for inside in instance.group().geometry().shapes() {
                        self.add(number, inside, Some(&own), others)?;
                    }
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn push(&mut self, part: Part<'a>) -> Result<(), String> {
        if self.parts.len() == self.most {
            return Err(format!("more than {} faces lie near other shapes", self.most));
        }
        self.parts.push(part);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn searched(boxes: impl Iterator<Item = (DVec3, f64)>) -> Result<Vec<Others>, String> {
        let body = |(number, (center, half)): (usize, (DVec3, f64))| Body {
            number,
            aabb: Aabb::around([center - half, center + half]),
            planes: Vec::new(),
        };
        let mut bodies: Vec<Body> = boxes.enumerate().map(body).collect();
        neighbours(&mut bodies)
    }

    /// Each has 1.25 billion pairs of shapes that overlap along the x axis.
    #[test]
    fn rows_and_crowds_of_shapes_are_searched_without_comparing_all_pairs() {
        let n = 50_000;
        let row = searched((0..n).map(|i| (f64::from(i) * DVec3::Y, 0.5))).unwrap();
        // Neighbours touch.
        assert!(row[1..row.len() - 1].iter().all(|others| others.boxes.len() == 2));
        let part = |i: i32, of: i32| f64::from(i % of) / f64::from(of);
        let crowd = (0..n).map(|i| (DVec3::new(part(i, 499), part(i, 1009), part(i, 2003)), 3.0));
        assert!(searched(crowd).unwrap().iter().all(|others| others.one_box));
    }

    #[test]
    fn planes_are_near_the_boxes_that_they_cross_and_one_another() {
        let plane = |y: f64| (y * DVec3::Y, DVec3::Y);
        let body = |number: usize, aabb: Aabb, planes: Vec<(DVec3, DVec3)>| Body { number, aabb, planes };
        let cube = |y: f64| Aabb::around([DVec3::new(0.0, y, 0.0), DVec3::new(1.0, y + 1.0, 1.0)]);
        let mut bodies = vec![
            body(0, cube(0.0), vec![]),
            body(1, cube(5.0), vec![]),
            body(2, Aabb::EVERYTHING, vec![plane(0.5)]),
            body(3, Aabb::EVERYTHING, vec![plane(-7.0)]),
        ];
        let found = neighbours(&mut bodies).unwrap();
        let of = |number: usize| {
            let at = bodies.iter().position(|body| body.number == number).unwrap();
            (found[at].boxes.len(), found[at].planes.len())
        };
        assert_eq!([0, 1, 2, 3].map(of), [(0, 1), (0, 0), (1, 1), (0, 1)]);
    }
}
