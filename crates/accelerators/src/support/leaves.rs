//! Leaves and their elements, with a test of several triangles at once.
//!
//! A structure refers to leaves of up to eight elements. Boxes are in single precision and local
//! coordinates (`frame`). The corners of triangles are in world coordinates, and the test in double
//! precision handles a vector of them at once (`search`).

pub(crate) mod child;
pub(crate) mod frame;
pub(crate) mod items;
pub(crate) mod search;

use child::WIDTH;
use frame::Frame;
use glam::{DVec3, Vec3A, Vec4, Vec4Swizzles};
use std::sync::Arc;
use whitstone_core::{Aabb, Element, Geometry};
use whitstone_simd::Doubles;

/// All leaves of a structure.
pub(crate) struct Leaves {
    pub(crate) geometry: Arc<Geometry>,
    pub(crate) frame: Frame,
    /// Elements without a box of reasonable size, tested for every ray.
    pub(crate) unbounded: Vec<Element>,
    /// Elements of all leaves, concatenated.
    pub(crate) slots: Vec<Slot>,
    /// The corners of the triangles of `slots`.
    pub(crate) corners: Corners,
}

/// The corners of the triangles of all leaves in the world, [`NUMBERS`] for each, and padding. The
/// numbers of a leaf are in the order of [`by_coordinate`].
pub(crate) enum Corners {
    /// If every vertex is exact in single precision.
    Single(Vec<f32>),
    Double(Vec<f64>),
}

/// Numbers of a triangle: three corners of three coordinates.
pub(crate) const NUMBERS: usize = 9;

/// This many numbers can be read from the start of any leaf; those past its end are arbitrary.
pub(crate) const WINDOW: usize = NUMBERS * WIDTH;

/// A number of [`Corners`].
pub(crate) trait Number: Copy + Default + Send + Sync {
    fn from_double(x: f64) -> Self;
    fn corners(numbers: Vec<Self>) -> Corners;
    /// The corners of a triangle in local coordinates, rounded.
    fn local(frame: &Frame, corners: &[Self; NUMBERS]) -> [Vec3A; 3];
    /// Part of eight numbers.
    fn lanes<D: Doubles>(d: D, from: &[Self; 8], part: usize) -> D::Vector;
}

impl Number for f32 {
    #[inline(always)]
    fn from_double(x: f64) -> Self {
        x as f32
    }
    fn corners(numbers: Vec<Self>) -> Corners {
        Corners::Single(numbers)
    }
    #[inline(always)]
    fn local(frame: &Frame, corners: &[Self; NUMBERS]) -> [Vec3A; 3] {
        if !frame.is_exact() {
            return f64::local(frame, &corners.map(f64::from));
        }
        let four = |start: usize| Vec4::from_slice(&corners[start..start + 4]);
        let scale = frame.length(1.0) as f32;
        [four(0), four(3), four(5).yzww()].map(|corner| Vec3A::from_vec4(corner) * scale)
    }
    #[inline(always)]
    fn lanes<D: Doubles>(d: D, from: &[Self; 8], part: usize) -> D::Vector {
        d.widen(from, part)
    }
}

impl Number for f64 {
    #[inline(always)]
    fn from_double(x: f64) -> Self {
        x
    }
    fn corners(numbers: Vec<Self>) -> Corners {
        Corners::Double(numbers)
    }
    #[inline(always)]
    fn local(frame: &Frame, corners: &[Self; NUMBERS]) -> [Vec3A; 3] {
        [0, 3, 6].map(|i| frame.point(DVec3::from_slice(&corners[i..])).as_vec3a())
    }
    #[inline(always)]
    fn lanes<D: Doubles>(d: D, from: &[Self; 8], part: usize) -> D::Vector {
        d.load(from, part)
    }
}

impl Leaves {
    /// Size in memory, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        let corners = match &self.corners {
            Corners::Single(numbers) => size_of_val(&**numbers),
            Corners::Double(numbers) => size_of_val(&**numbers),
        };
        size_of_val(&*self.slots) + corners + size_of_val(&*self.unbounded)
    }

    /// Bounds of all elements that have a box.
    pub(crate) fn bounds(&self) -> Aabb {
        let elements = self.slots.iter().map(|slot| slot.element());
        elements.fold(Aabb::EMPTY, |whole, element| {
            whole.union(self.geometry.bounds(element))
        })
    }
}

/// Transposes the numbers of a leaf: from triangle by triangle to rows of one number of every
/// triangle, axis by axis, corner by corner.
pub(crate) fn by_coordinate<T: Number>(numbers: &mut [T], count: usize) {
    let mut old = [T::default(); WINDOW];
    let old = &mut old[..numbers.len()];
    old.copy_from_slice(numbers);
    for (i, triangle) in old.as_chunks::<NUMBERS>().0.iter().enumerate() {
        for (k, &number) in triangle.iter().enumerate() {
            let (corner, axis) = (k / 3, k % 3);
            numbers[(3 * axis + corner) * count + i] = number;
        }
    }
}

/// An element in a leaf.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Slot {
    pub(crate) shape: u32,
    /// The triangle, or [`Slot::CUSTOM`].
    pub(crate) triangle: u32,
}

impl Slot {
    const CUSTOM: u32 = u32::MAX;

    pub(crate) fn new(element: Element) -> Self {
        match element {
            Element::Triangle { shape, triangle } => Self { shape, triangle },
            Element::Custom { shape } => Self {
                shape,
                triangle: Self::CUSTOM,
            },
        }
    }

    pub(crate) fn is_custom(self) -> bool {
        self.triangle == Self::CUSTOM
    }

    #[inline]
    pub(crate) fn element(self) -> Element {
        let Self { shape, triangle } = self;
        if self.is_custom() {
            Element::Custom { shape }
        } else {
            Element::Triangle { shape, triangle }
        }
    }
}
