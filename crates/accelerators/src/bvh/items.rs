//! What a hierarchy is built over: boxes in single precision, rounded outward.

use super::frame::Frame;
use glam::Vec4;
use rayon::prelude::*;
use whitstone_core::{Aabb, DVec3, Element, Geometry, Shape};

/// Boxes that reach farther are treated as endless: squares of their sizes would overflow.
const FARTHEST: f64 = 1e150;

/// A box in own coordinates; the fourth components say nothing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Box4 {
    pub(super) min: Vec4,
    pub(super) max: Vec4,
}

impl Box4 {
    pub(super) const EMPTY: Self = Self {
        min: Vec4::INFINITY,
        max: Vec4::NEG_INFINITY,
    };

    #[inline(always)]
    pub(super) fn union(self, other: Self) -> Self {
        Self {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
        }
    }

    #[inline(always)]
    pub(super) fn including(self, point: Vec4) -> Self {
        Self {
            min: self.min.min(point),
            max: self.max.max(point),
        }
    }

    #[inline(always)]
    pub(super) fn half_area(&self) -> f32 {
        let e = (self.max - self.min).max(Vec4::ZERO);
        e.x * e.y + e.y * e.z + e.z * e.x
    }

    pub(super) fn intersection(self, other: Self) -> Self {
        Self {
            min: self.min.max(other.min),
            max: self.max.min(other.max),
        }
    }

    /// Moved outward on every side.
    pub(super) fn padded(self, distance: f32) -> Self {
        Self {
            min: self.min - distance,
            max: self.max + distance,
        }
    }

    /// Whether the box holds nothing.
    pub(super) fn is_empty(&self) -> bool {
        let less = self.min.cmple(self.max);
        !(less.test(0) && less.test(1) && less.test(2))
    }

    /// The axis along which the box is longest.
    pub(super) fn longest_axis(&self) -> usize {
        let e = self.max - self.min;
        (0..3).fold(0, |best, axis| if e[axis] > e[best] { axis } else { best })
    }
}

/// The box of an element, or of a part of one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Item {
    /// The fourth component of `min` holds the number of the element, as bits.
    aabb: Box4,
}

impl Item {
    /// Above all numbers; with it, they are the bits of normal floats. Others are slow to compute with, even
    /// where nobody looks at the result.
    const NORMAL: u32 = 1 << 28;

    pub(super) fn new(aabb: Box4, number: u32) -> Self {
        let min = aabb.min.truncate().extend(f32::from_bits(number | Self::NORMAL));
        Self {
            aabb: Box4 { min, ..aabb },
        }
    }

    /// What is in another box of the same element.
    pub(super) fn part(&self, aabb: Box4) -> Self {
        Self::new(aabb, self.number())
    }

    #[inline(always)]
    pub(super) fn aabb(&self) -> Box4 {
        self.aabb
    }

    /// Place of the element in the order of the geometry.
    #[inline(always)]
    pub(super) fn number(&self) -> u32 {
        self.aabb.min.w.to_bits() ^ Self::NORMAL
    }

    /// Twice the center.
    #[inline(always)]
    pub(super) fn center(&self) -> Vec4 {
        self.aabb.min + self.aabb.max
    }
}

/// The elements of a geometry.
pub(super) struct Items {
    pub(super) frame: Frame,
    pub(super) items: Vec<Item>,
    /// Elements without a box of reasonable size.
    pub(super) unbounded: Vec<Element>,
    /// The number of the first element of each shape.
    starts: Vec<u32>,
}

impl Items {
    /// All elements of a geometry, of which there are fewer than 2^28.
    pub(super) fn new(geometry: &Geometry) -> Self {
        let mut starts = Vec::new();
        let mut unbounded = Vec::new();
        let mut total = 0u32;
        let mut whole = Aabb::EMPTY;
        for (part, shape) in geometry.shapes().iter().zip(0..) {
            starts.push(total);
            match part {
                Shape::Triangles(mesh) => {
                    total += mesh.triangles.len() as u32;
                    whole = whole.union(bounded_part(geometry, shape, mesh.triangles.len() as u32));
                }
                _ => {
                    total += 1;
                    let aabb = geometry.bounds(Element::Opaque { shape });
                    whole = if bounded(&aabb) { whole.union(aabb) } else { whole };
                }
            }
        }
        if whole.is_empty() {
            whole = Aabb::around([DVec3::ZERO]);
        }
        let unmoved = Frame::unmoved(&whole).filter(|_| in_single_precision(geometry));
        let mut items = Self {
            frame: unmoved.unwrap_or_else(|| Frame::around(&whole)),
            items: Vec::new(),
            unbounded: Vec::new(),
            starts,
        };
        let item = |number: u32| {
            let element = items.element(geometry, number);
            let aabb = geometry.bounds(element);
            let padded = || aabb.padded(needle_pad(geometry, element, &items.frame));
            bounded(&aabb).then(|| Item::new(items.local(&padded()), number))
        };
        let kept: Vec<Item> = (0..total)
            .into_par_iter()
            .with_min_len(4096)
            .filter_map(item)
            .collect();
        if kept.len() < total as usize {
            let all = (0..total).map(|number| items.element(geometry, number));
            unbounded.extend(all.filter(|&element| !bounded(&geometry.bounds(element))));
        }
        items.items = kept;
        items.unbounded = unbounded;
        items
    }

    /// The element of a number.
    pub(super) fn element(&self, geometry: &Geometry, number: u32) -> Element {
        let shape = self.starts.partition_point(|&start| start <= number) - 1;
        match &geometry.shapes()[shape] {
            Shape::Triangles(_) => Element::Triangle {
                shape: shape as u32,
                triangle: number - self.starts[shape],
            },
            _ => Element::Opaque { shape: shape as u32 },
        }
    }

    /// The corners of each element in own coordinates; not a number for what is no triangle, and for needles,
    /// whose hits may lie beside them.
    pub(super) fn corners(&self, geometry: &Geometry) -> Vec<[Vec4; 3]> {
        let total: usize = geometry.elements().count();
        let all = (0..total as u32)
            .into_par_iter()
            .with_min_len(4096)
            .map(|number| {
                let element = self.element(geometry, number);
                match (element, &geometry.shapes()[element.shape() as usize]) {
                    (Element::Triangle { triangle, .. }, Shape::Triangles(mesh))
                        if needle_pad(geometry, element, &self.frame) == 0.0 =>
                    {
                        let corner = |p| self.frame.point(p).as_vec3().extend(0.0);
                        mesh.corners(triangle).map(corner)
                    }
                    _ => [Vec4::NAN; 3],
                }
            });
        all.collect()
    }

    /// A box in own coordinates, rounded outward.
    fn local(&self, aabb: &Aabb) -> Box4 {
        let down = |x: f64| {
            let rounded = x as f32;
            if f64::from(rounded) > x {
                rounded.next_down()
            } else {
                rounded
            }
        };
        let min = self.frame.point(aabb.min).to_array().map(down);
        let max = self.frame.point(aabb.max).to_array().map(|x| -down(-x));
        Box4 {
            min: Vec4::new(min[0], min[1], min[2], 0.0),
            max: Vec4::new(max[0], max[1], max[2], 0.0),
        }
    }
}

/// The bounds of the triangles of a shape that have any.
fn bounded_part(geometry: &Geometry, shape: u32, triangles: u32) -> Aabb {
    let one = |triangle| {
        let aabb = geometry.bounds(Element::Triangle { shape, triangle });
        if bounded(&aabb) { aabb } else { Aabb::EMPTY }
    };
    let all = (0..triangles).into_par_iter().with_min_len(4096).map(one);
    all.reduce(|| Aabb::EMPTY, Aabb::union)
}

/// Whether every vertex is a point in `f32`.
fn in_single_precision(geometry: &Geometry) -> bool {
    let exact = |x: f64| f64::from(x as f32) == x && (x == 0.0 || x.abs() > 1e-18);
    geometry.shapes().iter().all(|shape| match shape {
        Shape::Triangles(mesh) => mesh.positions.iter().all(|p| p.to_array().into_iter().all(exact)),
        _ => true,
    })
}

fn bounded(aabb: &Aabb) -> bool {
    let far = aabb.min.abs().max(aabb.max.abs()).max_element();
    // Written so that NaN does not pass.
    !aabb.is_empty() && far <= FARTHEST
}

/// What the box of a needle needs beyond the pad of every ray: the error of the triangle test, up to
/// which a hit may seem to lie outside the box. It is never more than the longest edge.
fn needle_pad(geometry: &Geometry, element: Element, frame: &Frame) -> f64 {
    let (Element::Triangle { shape, triangle }, shapes) = (element, geometry.shapes()) else {
        return 0.0;
    };
    let Shape::Triangles(mesh) = &shapes[shape as usize] else {
        return 0.0;
    };
    let [a, b, c] = mesh.corners(triangle);
    let longest = (b - a)
        .length_squared()
        .max((c - b).length_squared())
        .max((a - c).length_squared());
    let twice_area = (b - a).cross(c - a).length_squared();
    // The height on the longest edge is twice the area over that edge.
    if longest * longest <= 2f64.powi(16) * twice_area || longest == 0.0 {
        return 0.0;
    }
    let ratio = longest / twice_area.sqrt();
    let longest = longest.sqrt();
    // 64 roundings of coordinates up to eight times as far as the structure reaches.
    let error = 512.0 * f64::EPSILON * ratio / frame.length(1.0);
    error.min(longest)
}
