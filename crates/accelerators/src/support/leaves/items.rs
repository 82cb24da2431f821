//! The input of a build: boxes in single precision, rounded outward.

use super::filter::{NUMBERS, WINDOW};
use super::frame::{Frame, ROUNDING};
use super::{Number, Slot};
use crate::support::oversized::oversized;
use glam::{Vec3A, Vec4};
use rayon::prelude::*;
use whitstone_core::{Aabb, DVec3, Element, Geometry, LoweredShape, TriangleMesh};

/// Minimum number of elements per parallel task.
pub(crate) const PARALLEL: usize = 4096;

/// Boxes that reach farther are treated as unbounded: squares of their sizes would overflow.
const FARTHEST: f64 = 1e150;

/// A box in local coordinates; the fourth components are ignored.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Box4 {
    pub(crate) min: Vec4,
    pub(crate) max: Vec4,
}

impl Box4 {
    pub(crate) const EMPTY: Self = Self {
        min: Vec4::INFINITY,
        max: Vec4::NEG_INFINITY,
    };

    #[inline(always)]
    pub(crate) fn union(self, other: Self) -> Self {
        Self {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
        }
    }

    #[inline(always)]
    pub(crate) fn including(self, point: Vec4) -> Self {
        Self {
            min: self.min.min(point),
            max: self.max.max(point),
        }
    }

    #[inline(always)]
    pub(crate) fn half_area(&self) -> f32 {
        let e = (self.max - self.min).max(Vec4::ZERO);
        e.x * e.y + e.y * e.z + e.z * e.x
    }

    pub(crate) fn intersection(self, other: Self) -> Self {
        Self {
            min: self.min.max(other.min),
            max: self.max.min(other.max),
        }
    }

    /// Moved outward on every side.
    pub(crate) fn padded(self, distance: f32) -> Self {
        Self {
            min: self.min - distance,
            max: self.max + distance,
        }
    }

    /// Whether the box holds nothing.
    pub(crate) fn is_empty(&self) -> bool {
        let less = self.min.cmple(self.max);
        !(less.test(0) && less.test(1) && less.test(2))
    }

    /// The axis along which the box is longest.
    pub(crate) fn longest_axis(&self) -> usize {
        let e = self.max - self.min;
        (0..3).fold(0, |best, axis| if e[axis] > e[best] { axis } else { best })
    }
}

/// The box of an element, or of a part of one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Item {
    /// The fourth component of `min` holds the number of the element, as bits.
    aabb: Box4,
}

impl Item {
    /// Or-ed into element numbers stored in the unused SIMD lane, so that their bit patterns are
    /// normal floats: denormals slow the instruction down even in an ignored lane.
    const NORMAL: u32 = 1 << 28;

    pub(crate) fn new(aabb: Box4, number: u32) -> Self {
        let min = aabb.min.truncate().extend(f32::from_bits(number | Self::NORMAL));
        Self {
            aabb: Box4 { min, ..aabb },
        }
    }

    /// The part of the same element in another box.
    pub(crate) fn part(&self, aabb: Box4) -> Self {
        Self::new(aabb, self.number())
    }

    #[inline(always)]
    pub(crate) fn aabb(&self) -> Box4 {
        self.aabb
    }

    /// Index of the element in the order of the geometry.
    #[inline(always)]
    pub(crate) fn number(&self) -> u32 {
        self.aabb.min.w.to_bits() ^ Self::NORMAL
    }

    /// Twice the center.
    #[inline(always)]
    pub(crate) fn center(&self) -> Vec4 {
        self.aabb.min + self.aabb.max
    }
}

/// The elements of a geometry, prepared for a build.
pub(crate) struct Items<'a> {
    geometry: &'a Geometry,
    pub(crate) frame: Frame,
    /// Box around twice the centers of the elements' boxes, in the world.
    centers: Aabb,
    /// Elements without a box of reasonable size, and those of oversized shapes.
    pub(crate) unbounded: Vec<Element>,
    /// Numbers of the oversized shapes; see [`oversized`](crate::support::oversized).
    oversized: Vec<u32>,
    /// The index of the first element of each shape, then the total number of elements.
    starts: Vec<u32>,
}

/// Triangles of padding after the last leaf, so that a whole window can be read from its start.
const BEHIND: usize = WINDOW / NUMBERS;

/// Number of elements that are fetched together.
const BLOCK: usize = 128;

/// Placeholder vertex for elements without vertices.
const ORIGIN: &[DVec3] = &[DVec3::ZERO];

/// Contents of all leaves, concatenated.
pub(crate) struct Contents<T> {
    pub(crate) slots: Vec<Slot>,
    /// The corners of triangles, followed by padding of zeros.
    pub(crate) corners: Vec<[T; NUMBERS]>,
}

impl<'a> Items<'a> {
    /// All elements of a geometry, which must be fewer than 2^28.
    pub(crate) fn new(geometry: &'a Geometry) -> Self {
        let mut starts = vec![0];
        let mut parts = Vec::new();
        for (part, shape) in geometry.shapes().iter().zip(0..) {
            let (count, part) = match part {
                LoweredShape::Triangles(mesh) => (mesh.triangles.len() as u32, Extent::of_mesh(mesh)),
                _ => {
                    let aabb = geometry.bounds(Element::Custom { shape });
                    (1, Extent::default().including(&aabb))
                }
            };
            starts.push(starts[starts.len() - 1] + count);
            parts.push((part, count));
        }
        let boxes: Vec<_> = parts
            .iter()
            .map(|(part, count)| (part.whole, *count as usize))
            .collect();
        let oversized = oversized(&boxes);
        let mut extent = Extent {
            unbounded: !oversized.is_empty(),
            ..Extent::default()
        };
        for ((part, _), shape) in parts.into_iter().zip(0..) {
            if oversized.binary_search(&shape).is_err() {
                extent = extent.union(part);
            }
        }
        let whole = if extent.whole.is_empty() {
            Aabb::around([DVec3::ZERO])
        } else {
            extent.whole
        };
        let unmoved = Frame::unmoved(&whole).filter(|_| in_single_precision(geometry));
        let mut items = Self {
            geometry,
            frame: unmoved.unwrap_or_else(|| Frame::around(&whole)),
            centers: extent.centers,
            unbounded: Vec::new(),
            oversized,
            starts,
        };
        if extent.unbounded {
            let all = geometry.elements();
            items.unbounded = all.filter(|&element| !items.is_bounded(element)).collect();
        }
        items
    }

    /// Applies `of` to the number of each element with a box of reasonable size, in order.
    pub(crate) fn each<T: Send>(&self, of: impl Fn(u32) -> T + Sync + Send) -> Vec<T> {
        let all = (0..self.starts[self.starts.len() - 1])
            .into_par_iter()
            .with_min_len(PARALLEL);
        if self.unbounded.is_empty() {
            return all.map(of).collect();
        }
        let is_bounded = |number: &u32| self.is_bounded(self.element(*number));
        all.filter(is_bounded).map(of).collect()
    }

    /// Whether an element is part of the structure.
    fn is_bounded(&self, element: Element) -> bool {
        self.oversized.binary_search(&element.shape()).is_err() && bounded(&self.geometry.bounds(element))
    }

    /// The element with this number.
    fn element(&self, number: u32) -> Element {
        let shape = self.starts.partition_point(|&start| start <= number) - 1;
        match &self.geometry.shapes()[shape] {
            LoweredShape::Triangles(_) => Element::Triangle {
                shape: shape as u32,
                triangle: number - self.starts[shape],
            },
            _ => Element::Custom { shape: shape as u32 },
        }
    }

    /// The corners of an element in the world, if it is a triangle.
    #[inline(always)]
    fn triangle(&self, element: Element) -> Option<[DVec3; 3]> {
        match (element, &self.geometry.shapes()[element.shape() as usize]) {
            (Element::Triangle { triangle, .. }, LoweredShape::Triangles(mesh)) => {
                Some(mesh.corners(triangle))
            }
            _ => None,
        }
    }

    /// The number of the element of a slot; `None` if the geometry has no such element.
    pub(crate) fn number(&self, slot: Slot) -> Option<u32> {
        match (slot.element(), self.geometry.shapes().get(slot.shape as usize)?) {
            (Element::Triangle { triangle, .. }, LoweredShape::Triangles(mesh)) => ((triangle as usize)
                < mesh.triangles.len())
            .then(|| self.starts[slot.shape as usize] + triangle),
            (Element::Custom { .. }, LoweredShape::Triangles(_)) | (Element::Triangle { .. }, _) => None,
            (Element::Custom { .. }, _) => Some(self.starts[slot.shape as usize]),
        }
    }

    /// The box around the results of `center`.
    pub(crate) fn centers(&self) -> &Aabb {
        &self.centers
    }

    /// Twice the center of an element's box, in the world.
    #[inline(always)]
    pub(crate) fn center(&self, number: u32) -> DVec3 {
        let element = self.element(number);
        match self.triangle(element) {
            Some([a, b, c]) => a.min(b).min(c) + a.max(b).max(c),
            None => {
                let aabb = self.geometry.bounds(element);
                aabb.min + aabb.max
            }
        }
    }

    /// The box of an element, in the world.
    pub(crate) fn bounds(&self, number: u32) -> Aabb {
        self.geometry.bounds(self.element(number))
    }

    /// Whether an element is a triangle with two equal corners.
    pub(crate) fn is_flat(&self, number: u32) -> bool {
        let corners = self.triangle(self.element(number));
        corners.is_some_and(|[a, b, c]| a == b || b == c || c == a)
    }

    /// The item of an element.
    pub(crate) fn item(&self, number: u32) -> Item {
        let element = self.element(number);
        let aabb = match self.triangle(element) {
            Some(corners) => {
                let own = corners.map(|p| self.frame.point(p).as_vec3a());
                if let Some(aabb) = self.quick_box(own) {
                    return Item::new(aabb, number);
                }
                Aabb::around(corners).padded(needle_pad(corners, &self.frame))
            }
            None => self.geometry.bounds(element),
        };
        Item::new(self.local(&aabb), number)
    }

    /// The box of the element with this number and these corners, as in [`Contents`].
    #[inline(always)]
    pub(crate) fn aabb<T: Number>(&self, number: u32, corners: &[T; NUMBERS]) -> Box4 {
        let own = T::local(&self.frame, corners);
        self.quick_box(own).unwrap_or_else(|| self.item(number).aabb())
    }

    /// The box of a triangle with these corners in local coordinates; `None` if the corners do not
    /// suffice to compute it. The three corners coincide for an element that is not a triangle.
    #[inline(always)]
    fn quick_box(&self, own: [Vec3A; 3]) -> Option<Box4> {
        let [a, b, c] = own;
        let aabb = Box4 {
            min: a.min(b).min(c).extend(0.0),
            max: a.max(b).max(c).extend(0.0),
        };
        // Half a unit in the last place of a coordinate is at most 2^-25.
        let exact = self.frame.exact().is_some();
        let (error, aabb) = if exact {
            (0.0, aabb)
        } else {
            (2f32.powi(-25), aabb.padded(2f32.powi(-23)))
        };
        is_no_needle(own, error).then_some(aabb)
    }

    /// The contents of leaves that hold the elements with these numbers, in this order.
    pub(crate) fn contents<T: Number, I: Sync>(
        &self,
        all: &[I],
        number: impl Fn(&I) -> u32 + Sync + Send,
    ) -> Contents<T> {
        let slots = all.par_iter().with_min_len(PARALLEL);
        let slots = slots.map(|one| Slot::new(self.element(number(one)))).collect();
        let length = all.len() + BEHIND;
        let block = |i: usize| {
            let block = all.chunks(BLOCK).nth(i).unwrap_or_default();
            // Two short loops instead of one long one keep many loads in flight; each load takes
            // longer than everything else here.
            let mut sources = [(ORIGIN, [0; 3]); BLOCK];
            for (source, one) in sources.iter_mut().zip(block) {
                *source = self.source(self.element(number(one)));
            }
            let mut corners = [[T::default(); NUMBERS]; BLOCK];
            for ((corners, _), (positions, indices)) in corners.iter_mut().zip(block).zip(sources) {
                let of = |i: u32| T::corner(&self.frame, positions[i as usize]);
                let [[a, b, c], [d, e, f], [g, h, i]] = indices.map(of);
                *corners = [a, b, c, d, e, f, g, h, i];
            }
            corners
        };
        let blocks = (0..length.div_ceil(BLOCK)).into_par_iter();
        let blocks: Vec<_> = blocks.with_min_len(PARALLEL / BLOCK).map(block).collect();
        let mut corners = blocks.into_flattened();
        corners.truncate(length);
        Contents { slots, corners }
    }

    /// The vertices, and the indices of the three corners of an element.
    #[inline(always)]
    fn source(&self, element: Element) -> (&[DVec3], [u32; 3]) {
        match (element, &self.geometry.shapes()[element.shape() as usize]) {
            (Element::Triangle { triangle, .. }, LoweredShape::Triangles(mesh)) => {
                (&mesh.positions, mesh.triangles[triangle as usize])
            }
            _ => (ORIGIN, [0; 3]),
        }
    }

    /// The corners of each element.
    pub(crate) fn corners(&self) -> Corners {
        let all = 0..self.starts[self.starts.len() - 1];
        let all = all.into_par_iter().with_min_len(PARALLEL).map(|number| {
            let corners = self.triangle(self.element(number));
            let corners = corners.filter(|&corners| needle_pad(corners, &self.frame) == 0.0);
            let corner = |p| self.frame.point(p).as_vec3().extend(0.0);
            corners.map_or([Vec4::NAN; 3], |corners| corners.map(corner))
        });
        Corners(all.collect())
    }

    /// A world box in local coordinates, rounded outward.
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

/// The corners of each element in local coordinates, by its number. NaN for elements that can only
/// be clipped by their boxes: those that are not triangles, and slivers, whose hits may lie outside
/// of them.
pub(crate) struct Corners(Vec<[Vec4; 3]>);

impl Corners {
    /// Bound on the rounding error of a clipped part of a triangle, in local coordinates.
    pub(crate) const ROUNDING: f32 = 16.0 * ROUNDING;

    /// The box of the part of an item between two planes.
    pub(crate) fn between(&self, item: &Item, axis: usize, low: f32, high: f32) -> Box4 {
        let corners = &self.0[item.number() as usize];
        let heights = corners.map(|corner| corner[axis]);
        let borders = crossed(corners, heights, low).union(crossed(corners, heights, high));
        part(item, corners, (axis, heights), [low, high], borders)
    }

    /// Clips an item by ascending split planes and passes the bounds of each slice to `take`.
    #[inline(always)]
    pub(crate) fn slices(
        &self,
        item: &Item,
        axis: usize,
        planes: impl Iterator<Item = f32>,
        mut take: impl FnMut(Box4),
    ) {
        let corners = &self.0[item.number() as usize];
        let heights = corners.map(|corner| corner[axis]);
        let (mut low, mut below) = (f32::NEG_INFINITY, Box4::EMPTY);
        for high in planes {
            let above = crossed(corners, heights, high);
            take(part(
                item,
                corners,
                (axis, heights),
                [low, high],
                below.union(above),
            ));
            (low, below) = (high, above);
        }
        take(part(item, corners, (axis, heights), [low, f32::INFINITY], below));
    }
}

/// The box around the points where the edges of a triangle cross a plane; `heights` are the
/// coordinates of its corners along the plane's axis.
#[inline(always)]
fn crossed(corners: &[Vec4; 3], heights: [f32; 3], plane: f32) -> Box4 {
    let mut found = Box4::EMPTY;
    for i in 0..3 {
        let j = (i + 1) % 3;
        if (heights[i] < plane) != (heights[j] < plane) {
            let along = (plane - heights[i]) / (heights[j] - heights[i]);
            found = found.including(corners[i] + along.clamp(0.0, 1.0) * (corners[j] - corners[i]));
        }
    }
    found
}

/// The box of the part of an item between two planes; `borders` is the box of its intersections
/// with them.
#[inline(always)]
fn part(
    item: &Item,
    corners: &[Vec4; 3],
    (axis, heights): (usize, [f32; 3]),
    [low, high]: [f32; 2],
    borders: Box4,
) -> Box4 {
    let aabb = item.aabb();
    let across = Vec4::AXES[axis].cmpeq(Vec4::ONE);
    let slab = Box4 {
        min: Vec4::select(across, aabb.min.max(Vec4::splat(low)), aabb.min),
        max: Vec4::select(across, aabb.max.min(Vec4::splat(high)), aabb.max),
    };
    if heights[0].is_nan() {
        return slab;
    }
    let mut found = borders;
    for (corner, height) in corners.iter().zip(heights) {
        if height >= low && height <= high {
            found = found.including(*corner);
        }
    }
    if found.is_empty() {
        return Box4::EMPTY;
    }
    found.padded(Corners::ROUNDING).intersection(slab)
}

/// Extent of a set of elements.
struct Extent {
    /// Box around the elements that have a box of reasonable size.
    whole: Aabb,
    /// Box around twice the centers of their boxes.
    centers: Aabb,
    /// Whether there are other elements.
    unbounded: bool,
}

impl Default for Extent {
    fn default() -> Self {
        Self {
            whole: Aabb::EMPTY,
            centers: Aabb::EMPTY,
            unbounded: false,
        }
    }
}

impl Extent {
    fn of_mesh(mesh: &TriangleMesh) -> Self {
        let corners = |triangle: &[u32; 3]| triangle.map(|i| mesh.positions[i as usize]);
        let all = mesh.triangles.par_iter().with_min_len(PARALLEL);
        let parts = all.fold(Self::default, |extent, triangle| {
            extent.including(&Aabb::around(corners(triangle)))
        });
        parts.reduce(Self::default, Self::union)
    }

    #[inline(always)]
    fn including(self, aabb: &Aabb) -> Self {
        if !bounded(aabb) {
            return Self {
                unbounded: true,
                ..self
            };
        }
        Self {
            whole: self.whole.union(*aabb),
            centers: self.centers.including(aabb.min + aabb.max),
            ..self
        }
    }

    fn union(self, other: Self) -> Self {
        Self {
            whole: self.whole.union(other.whole),
            centers: self.centers.union(other.centers),
            unbounded: self.unbounded | other.unbounded,
        }
    }
}

/// Whether every vertex is exact in `f32`.
fn in_single_precision(geometry: &Geometry) -> bool {
    let exact = |x: f64| f64::from(x as f32) == x && (x == 0.0 || x.abs() > 1e-18);
    geometry.shapes().iter().all(|shape| match shape {
        LoweredShape::Triangles(mesh) => {
            let all = mesh.positions.par_iter().with_min_len(PARALLEL);
            all.all(|p| p.to_array().into_iter().all(exact))
        }
        _ => true,
    })
}

fn bounded(aabb: &Aabb) -> bool {
    let far = aabb.min.abs().max(aabb.max.abs()).max_element();
    // Written so that NaN does not pass.
    !aabb.is_empty() && far <= FARTHEST
}

/// Whether a triangle with these corners, whose coordinates err by at most `error`, certainly needs
/// no [`needle_pad`]. It requires more height than necessary, and rejects triangles so small that
/// squares could underflow or errors matter.
#[inline(always)]
fn is_no_needle([a, b, c]: [Vec3A; 3], error: f32) -> bool {
    let edges = [b - a, c - b, a - c];
    let longest = edges.map(Vec3A::length_squared).into_iter().fold(0.0, f32::max);
    let twice_area = edges[0].cross(edges[2]).length_squared();
    let enough = (2f32.powi(-15) * longest).max(256.0 * error * error);
    longest > 1e-16 && enough * longest <= twice_area
}

/// Extra padding for the box of a sliver: the error of the triangle test, by which a hit may seem
/// to lie outside the box. It is at most the longest edge, and 0 if the triangle is no sliver.
fn needle_pad([a, b, c]: [DVec3; 3], frame: &Frame) -> f64 {
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
