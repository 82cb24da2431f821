//! Leaves and their elements, with a conservative single-precision filter for triangles.
//!
//! A structure refers to leaves of up to eight elements. The corners of triangles are stored in
//! local coordinates (`frame`), and eight triangles are tested at once (`filter`). The tests in
//! `f64` decide whatever this filter cannot, and compute every hit that is returned (`state`).
//! Proof that no hit is missed: `docs/accelerators.md`.

pub(crate) mod child;
pub(crate) mod filter;
pub(crate) mod frame;
pub(crate) mod items;
pub(crate) mod state;

use child::{Child, Kind, WIDTH};
use filter::{NUMBERS, WINDOW};
use frame::Frame;
use glam::{Vec3A, Vec4, Vec4Swizzles};
use std::sync::Arc;
use whitstone_core::triangle::Axis;
use whitstone_core::{Aabb, DVec3, Element, Geometry, LoweredShape};
use whitstone_simd::prefetch;

/// All leaves of a structure.
pub(crate) struct Leaves {
    pub(crate) geometry: Arc<Geometry>,
    pub(crate) frame: Frame,
    /// Elements without a box of reasonable size, tested for every ray.
    pub(crate) unbounded: Vec<Element>,
    /// Elements of all leaves, concatenated.
    pub(crate) slots: Vec<Slot>,
    /// The corners of the triangles of `slots` in local coordinates; see `filter`.
    pub(crate) numbers: Vec<f32>,
    /// Factor that turns `numbers` into the exact world coordinates of corners; 0 if there is none.
    pub(crate) exact: f64,
    /// The corners in the world instead of `numbers`, for double-precision leaves without such a
    /// factor.
    pub(crate) doubles: Vec<f64>,
}

impl Leaves {
    /// The leaves with these slots; the numbers of each leaf are in the order of [`by_coordinate`].
    pub(crate) fn new(
        geometry: Arc<Geometry>,
        frame: Frame,
        unbounded: Vec<Element>,
        slots: Vec<Slot>,
        numbers: Vec<f32>,
    ) -> Self {
        Self {
            geometry,
            frame,
            unbounded,
            slots,
            numbers,
            exact: frame.exact().unwrap_or(0.0),
            doubles: Vec::new(),
        }
    }

    /// Fetches the usual size of a leaf into the cache, whatever its own size is: a loop over that
    /// would be hard to predict. Of leaves in double precision only the slots.
    #[inline(always)]
    pub(crate) fn prefetch(&self, leaf: Child) {
        let first = leaf.index();
        if let Some(numbers) = self.numbers.get(NUMBERS * first..) {
            prefetch(numbers.first_chunk::<64>().map_or(&[], |numbers| numbers));
        }
        if let Some(slots) = self.slots.get(first..) {
            prefetch(&slots[..slots.len().min(1)]);
        }
    }

    /// Size in memory, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        let numbers = size_of_val(&*self.numbers) + size_of_val(&*self.doubles);
        size_of_val(&*self.slots) + numbers + size_of_val(&*self.unbounded)
    }

    /// Bounds of all elements that have a box.
    pub(crate) fn bounds(&self) -> Aabb {
        let elements = self.slots.iter().map(|slot| slot.element());
        elements.fold(Aabb::EMPTY, |whole, element| {
            whole.union(self.geometry.bounds(element))
        })
    }

    /// The corners of a triangle of a leaf, where the factor `exact` exists.
    #[inline(always)]
    fn exact_corners(&self, first: usize, count: usize, lane: usize) -> [DVec3; 3] {
        self.exact_along(&[Axis::X, Axis::Y, Axis::Z], first, count, lane)
            .map(DVec3::from_array)
    }

    /// The same, with coordinates along these axes.
    #[inline(always)]
    fn exact_along(&self, axes: &[Axis; 3], first: usize, count: usize, lane: usize) -> [[f64; 3]; 3] {
        let Some(numbers) = self.numbers[NUMBERS * first..].first_chunk::<WINDOW>() else {
            return [[0.0; 3]; 3];
        };
        // This changes neither, but lets the compiler omit bounds checks.
        let (count, lane) = (count.min(WIDTH), lane % WIDTH);
        let along = |i: usize| 3 * axes[i] as usize * count + lane;
        let [x, y, z] = [along(0), along(1), along(2)];
        let number = |i: usize| f64::from(numbers[i]) * self.exact;
        let corner = |by: usize| [number(x + by), number(y + by), number(z + by)];
        [corner(0), corner(count), corner(2 * count)]
    }

    /// The slot at a place of a leaf of triangles, and the triangle's corners in the world.
    #[inline(always)]
    pub(crate) fn triangle(&self, leaf: Child, lane: usize) -> (Slot, [DVec3; 3]) {
        let slot = self.slots[leaf.index() + lane];
        let corners = match leaf.kind() {
            Kind::Triangles(first, count) if self.exact != 0.0 => self.exact_corners(first, count, lane),
            _ => match &self.geometry.shapes()[slot.shape as usize] {
                LoweredShape::Triangles(mesh) => mesh.corners(slot.triangle),
                _ => [DVec3::ZERO; 3],
            },
        };
        (slot, corners)
    }
}

/// A coordinate of a corner: in `f32` in local coordinates, in `f64` in the world.
pub(crate) trait Number: Copy + Default + Send + Sync {
    /// A corner, given in the world.
    fn corner(frame: &Frame, p: DVec3) -> [Self; 3];
    /// The corners of a triangle in local coordinates, rounded.
    fn local(frame: &Frame, corners: &[Self; NUMBERS]) -> [Vec3A; 3];
}

impl Number for f32 {
    #[inline(always)]
    fn corner(frame: &Frame, p: DVec3) -> [Self; 3] {
        frame.point(p).as_vec3().to_array()
    }
    #[inline(always)]
    fn local(_: &Frame, corners: &[Self; NUMBERS]) -> [Vec3A; 3] {
        let four = |start: usize| Vec4::from_slice(&corners[start..start + 4]);
        [four(0), four(3), four(5).yzww()].map(Vec3A::from_vec4)
    }
}

impl Number for f64 {
    #[inline(always)]
    fn corner(_: &Frame, p: DVec3) -> [Self; 3] {
        p.to_array()
    }
    #[inline(always)]
    fn local(frame: &Frame, corners: &[Self; NUMBERS]) -> [Vec3A; 3] {
        [0, 3, 6].map(|i| frame.point(DVec3::from_slice(&corners[i..])).as_vec3a())
    }
}

/// Transposes the numbers of a leaf: from triangle by triangle to rows of one number of every
/// triangle, axis by axis, corner by corner.
pub(crate) fn by_coordinate<T: Number>(numbers: &mut [T], count: usize) {
    let mut old = [T::default(); NUMBERS * WIDTH];
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
