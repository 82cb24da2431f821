//! Shared code of the structures in `f64`: which elements have a box, how rays are padded, and the
//! nearest-hit and any-hit searches.
//!
//! **Why rays are padded.** A hit is where an element's own test puts it, and that test rounds: the
//! point at `t` may lie slightly outside the element's box. The slab and plane tests of a structure
//! round too. So a structure treats each ray as if it extended by `pad` in all directions, and
//! visits every box, cell or half-space that the padded ray touches. Then, for every hit, some
//! visited cell holds the element: the hit point lies within `pad` of a point of the element, and
//! that point lies in some cell.
//!
//! **When a search may end.** Cells come roughly front to back. A hit found in a cell may lie
//! beyond it, so it does not end the search. A cell is skipped only if the ray enters it strictly
//! behind the best hit.

use crate::support::oversized::oversized;
use std::sync::Arc;
use std::time::Instant;
use whitstone_core::triangle::ShearedRay;
use whitstone_core::{
    Aabb, Accelerator, DAffine3, DVec3, DebugBounds, Element, Geometry, Interval, LoweredShape,
    PreliminaryIntersection, Ray, SceneError, SceneErrors, SelfHitFilter, Statistics, TraversalStatistics,
};

/// Boxes that reach farther are treated as unbounded: their areas would overflow.
const FARTHEST: f64 = 1e150;

/// The padding of rays, relative to the largest coordinate of ray origin and boxes.
///
/// The test of a box or plane itself errs by a few roundings, 2^-53 each. The triangle test errs by
/// about 8 roundings times the ratio of the triangle's longest edge to its smallest height. So this
/// padding keeps hits on triangles with ratios up to a thousand inside their boxes; [`needle_pad`]
/// covers thinner triangles (slivers).
pub(crate) const PAD: f64 = 1.0 / (1u64 << 40) as f64;

/// [`PAD`]; tests reduce it to check that the accelerator laws then fail.
#[cfg(not(test))]
fn width() -> f64 {
    PAD
}
#[cfg(test)]
use tests::width;

/// The padding of the box of an element, for a structure whose rays are padded relative to each box
/// by [`PAD`] times the largest distance, along an axis, from the origin to a plane of the box.
///
/// The error of the triangle test is relative to just these distances: its first step subtracts the
/// origin from the corners. Other shapes may transform the ray, so their errors are relative to the
/// coordinates: |o| + |b|, of the origin and of the box. As |o| <= |b - o| + |b|, it takes twice
/// the largest coordinate of the box besides.
pub(crate) fn relative_pad(item: &Item) -> f64 {
    match item.element {
        Element::Triangle { .. } => 0.0,
        Element::Custom { .. } => 2.0 * width() * item.aabb.min.abs().max(item.aabb.max.abs()).max_element(),
    }
}

/// Allowance for a structure's own rounding when it clips elements, relative to the largest
/// coordinate: many roundings, yet far below the padding of rays.
pub(crate) const MARGIN: f64 = 1.0 / (1u64 << 46) as f64;

/// Exclusive upper bound on the number of elements: elements, references to them and nodes have
/// 32-bit indices.
pub(crate) const MAX_ELEMENTS: usize = 1 << 28;

/// Fails if a geometry does not have fewer than `most` elements.
pub(crate) fn check_count(geometry: &Geometry, most: usize) -> Result<(), SceneError> {
    let count = |shape: &LoweredShape| match shape {
        LoweredShape::Triangles(mesh) => mesh.triangles.len(),
        _ => 1,
    };
    let count: usize = geometry.shapes().iter().map(count).sum();
    if count < most {
        return Ok(());
    }
    let message =
        format!("the scene has {count} triangles and shapes; an accelerator holds fewer than {most}");
    Err(SceneError::anywhere(message).with_help("use a coarser mesh"))
}

/// An element with a box.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Item {
    /// Bounds, including the extra padding of slivers.
    pub(crate) aabb: Aabb,
    /// Center of the bounds.
    pub(crate) center: DVec3,
    pub(crate) element: Element,
    /// Index in the order of the geometry; makes sorting deterministic.
    pub(crate) number: u32,
    /// Whether the box has extra padding: such a triangle (a sliver) must not be clipped by its
    /// corners.
    pub(crate) sliver: bool,
}

impl Item {
    /// The corners of a triangle that may be clipped; `None` for slivers and other shapes.
    pub(crate) fn corners(&self, geometry: &Geometry) -> Option<[DVec3; 3]> {
        (!self.sliver).then(|| corners(geometry, self.element)).flatten()
    }

    /// Points whose convex hull holds the element: the corners of the triangle or of the box.
    pub(crate) fn hull(&self, geometry: &Geometry) -> impl Iterator<Item = DVec3> {
        let corners = self.corners(geometry);
        let count = if corners.is_some() { 3 } else { 8 };
        let aabb = self.aabb;
        (0..count).map(move |i| match corners {
            Some(corners) => corners[i],
            None => DVec3::new(
                [aabb.min, aabb.max][i & 1].x,
                [aabb.min, aabb.max][i >> 1 & 1].y,
                [aabb.min, aabb.max][i >> 2].z,
            ),
        })
    }
}

/// The elements of a geometry.
pub(crate) struct Elements {
    /// Elements with a box, in the order of the geometry.
    pub(crate) items: Vec<Item>,
    /// Largest absolute coordinate of any box.
    pub(crate) reach: f64,
    /// Elements without a box of reasonable size, and those of oversized shapes .
    unbounded: Vec<Element>,
    /// Number of triangles with two coincident corners, which nothing can hit.
    degenerate: usize,
}

impl Elements {
    fn of(geometry: &Geometry) -> Self {
        let mut found = Self {
            items: Vec::new(),
            reach: 0.0,
            unbounded: Vec::new(),
            degenerate: 0,
        };
        // A single shape is never oversized.
        let oversized = match geometry.shapes().len() {
            0 | 1 => Vec::new(),
            _ => oversized(&boxes(geometry)),
        };
        for (element, number) in geometry.elements().zip(0..) {
            if corners(geometry, element).is_some_and(|[a, b, c]| a == b || b == c || c == a) {
                found.degenerate += 1;
                continue;
            }
            let aabb = geometry.bounds(element);
            let far = aabb.min.abs().max(aabb.max.abs()).max_element();
            let oversized = oversized.binary_search(&element.shape()).is_ok();
            if oversized || aabb.is_empty() || far.is_nan() || far > FARTHEST {
                found.unbounded.push(element);
                continue;
            }
            found.reach = found.reach.max(far);
            found.items.push(Item {
                aabb,
                center: aabb.center(),
                element,
                number,
                sliver: false,
            });
        }
        for item in &mut found.items {
            let pad = needle_pad(geometry, item.element, found.reach);
            item.sliver = pad > 0.0;
            item.aabb = item.aabb.padded(pad);
        }
        found
    }
}

/// For each shape, the box around its elements of reasonable size, and its number of elements.
fn boxes(geometry: &Geometry) -> Vec<(Aabb, usize)> {
    let mut boxes = vec![(Aabb::EMPTY, 0); geometry.shapes().len()];
    for element in geometry.elements() {
        let (aabb, count) = &mut boxes[element.shape() as usize];
        let found = geometry.bounds(element);
        // Written so that NaN does not pass.
        if found.min.abs().max(found.max.abs()).max_element() <= FARTHEST {
            *aabb = aabb.union(found);
        }
        *count += 1;
    }
    boxes
}

fn corners(geometry: &Geometry, element: Element) -> Option<[DVec3; 3]> {
    match (element, &geometry.shapes()[element.shape() as usize]) {
        (Element::Triangle { triangle, .. }, LoweredShape::Triangles(mesh)) => Some(mesh.corners(triangle)),
        _ => None,
    }
}

/// Extra padding for the box of a sliver: the error of the triangle test, by which a hit may seem
/// to lie outside the box. It is at most the longest edge, and 0 if the triangle is no sliver.
fn needle_pad(geometry: &Geometry, element: Element, reach: f64) -> f64 {
    let Some([a, b, c]) = corners(geometry, element) else {
        return 0.0;
    };
    let longest = (b - a).length().max((c - b).length()).max((a - c).length());
    let height = (b - a).cross(c - a).length() / longest;
    if longest <= 256.0 * height || longest == 0.0 {
        return 0.0;
    }
    // 64 roundings of coordinates up to eight times as far as the geometry reaches.
    let error = 512.0 * f64::EPSILON * reach * (longest / height);
    error.min(longest)
}

/// The smallest box around all items.
pub(crate) fn bounds(items: &[Item]) -> Aabb {
    items.iter().fold(Aabb::EMPTY, |aabb, item| aabb.union(item.aabb))
}

/// Whether a triangle and a box overlap, up to a margin; false only if some axis separates them.
///
/// Akenine-Möller, *Fast 3D triangle-box overlap testing*, 2001: the axes are the normal of the
/// triangle and the cross products of its edges with those of the box. The face normals of the box
/// are left to the caller.
pub(crate) fn overlaps(corners: &[DVec3; 3], cell: &Aabb, margin: f64) -> bool {
    let center = cell.center();
    let half = 0.5 * cell.extent() + margin;
    let [a, b, c] = corners.map(|corner| corner - center);
    let edges = [b - a, c - b, a - c];
    let separates = |axis: DVec3| {
        let (a, b, c) = (axis.dot(a), axis.dot(b), axis.dot(c));
        let radius = axis.abs().dot(half);
        a.min(b).min(c) > radius || a.max(b).max(c) < -radius
    };
    let products = edges.into_iter().flat_map(|e| {
        [
            DVec3::new(0.0, -e.z, e.y),
            DVec3::new(e.z, 0.0, -e.x),
            DVec3::new(-e.y, e.x, 0.0),
        ]
    });
    !separates(edges[0].cross(edges[1])) && !products.into_iter().any(separates)
}

/// A padded ray, prepared for tests against boxes and axis-parallel planes.
pub(crate) struct WideRay {
    pub(crate) ray: Ray,
    /// Padding along each axis: how far from the line a hit may seem to lie.
    pub(crate) pad: f64,
    /// The padding relative to the largest coordinate.
    pub(crate) width: f64,
    /// Origin for entry tests: moved forward by the padding, so that the ray enters early.
    pub(crate) near_origin: DVec3,
    /// Origin for exit tests: moved back by the padding, so that the ray exits late.
    pub(crate) far_origin: DVec3,
    /// 1 / direction; infinite, with the direction's sign, where a component is zero.
    pub(crate) reciprocal: DVec3,
    /// For each axis, whether the side of smallest coordinates is the near (0) or the far one (1).
    pub(crate) near_side: [usize; 3],
}

impl WideRay {
    #[inline]
    fn new(ray: &Ray, width: f64, reach: f64) -> Self {
        let pad = width * (ray.origin.abs().max_element() + reach);
        let near_side = ray
            .direction
            .to_array()
            .map(|d| usize::from(d.is_sign_negative()));
        let forward = DVec3::ONE.copysign(ray.direction) * pad;
        Self {
            ray: *ray,
            pad,
            width,
            near_origin: ray.origin + forward,
            far_origin: ray.origin - forward,
            reciprocal: ray.direction.recip(),
            near_side,
        }
    }

    /// Parameter from which the padded ray touches the far side of a plane. NaN, from zero times
    /// infinity, means that the ray runs exactly along the border; `f64::max` and `f64::min` then
    /// ignore it.
    #[inline]
    pub(crate) fn arrives(&self, axis: usize, plane: f64) -> f64 {
        (plane - self.near_origin[axis]) * self.reciprocal[axis]
    }

    /// Parameter up to which the padded ray touches the near side of a plane; NaN as in
    /// [`Self::arrives`].
    #[inline]
    pub(crate) fn leaves(&self, axis: usize, plane: f64) -> f64 {
        (plane - self.far_origin[axis]) * self.reciprocal[axis]
    }

    /// The interval within `min` to `limit` in which the padded ray touches a box, if there is one.
    #[inline]
    pub(crate) fn inside(&self, aabb: &Aabb, min: f64, limit: f64) -> Option<(f64, f64)> {
        let (mut near, mut far) = (min, limit);
        for axis in 0..3 {
            let planes = [aabb.min[axis], aabb.max[axis]];
            near = near.max(self.arrives(axis, planes[self.near_side[axis]]));
            far = far.min(self.leaves(axis, planes[1 - self.near_side[axis]]));
        }
        (near <= far).then_some((near, far))
    }
}

/// A padded ray, projected onto the normal of planes.
#[derive(Clone, Copy)]
pub(crate) struct Along {
    near_origin: f64,
    far_origin: f64,
    reciprocal: f64,
    /// Whether the ray runs against the normal.
    pub(crate) backwards: bool,
}

impl WideRay {
    /// Projects the ray onto a normal. The dot products are rounded; within the geometry, the
    /// resulting error in distance is far below the padding.
    #[inline]
    pub(crate) fn along(&self, normal: DVec3) -> Along {
        let (origin, direction) = (normal.dot(self.ray.origin), normal.dot(self.ray.direction));
        let width = self.pad * (normal.x.abs() + normal.y.abs() + normal.z.abs());
        let forward = width.copysign(direction);
        Along {
            near_origin: origin + forward,
            far_origin: origin - forward,
            reciprocal: direction.recip(),
            backwards: direction.is_sign_negative(),
        }
    }
}

impl Along {
    /// As [`WideRay::arrives`].
    #[inline]
    pub(crate) fn arrives(&self, plane: f64) -> f64 {
        (plane - self.near_origin) * self.reciprocal
    }

    /// As [`WideRay::leaves`].
    #[inline]
    pub(crate) fn leaves(&self, plane: f64) -> f64 {
        (plane - self.far_origin) * self.reciprocal
    }

    /// The part of a ray interval between two planes, the first with the smaller coordinate; empty
    /// if its start is beyond its end.
    #[inline]
    pub(crate) fn between(&self, min: f64, max: f64, (near, far): (f64, f64)) -> (f64, f64) {
        let (first, last) = if self.backwards { (max, min) } else { (min, max) };
        // NaN is ignored.
        (near.max(self.arrives(first)), far.min(self.leaves(last)))
    }
}

/// The elements that a ray was tested against most recently, so that an element in several cells is
/// seldom tested twice ("inverse mailboxing": Shevtsov, Soupikov, Kapustin, *Highly parallel fast
/// kd-tree construction*, 2007). It belongs to the ray, so threads share no state.
pub(crate) struct Mailbox([u32; Self::SIZE]);

impl Mailbox {
    const SIZE: usize = 16;

    pub(crate) fn new() -> Self {
        Self([u32::MAX; Self::SIZE])
    }

    /// Whether an element was not tested before, as far as the mailbox remembers.
    #[inline]
    pub(crate) fn is_new(&mut self, number: u32) -> bool {
        std::mem::replace(&mut self.0[number as usize % Self::SIZE], number) != number
    }
}

/// Callbacks for the nodes and elements that a search visits.
pub(crate) trait Visitor {
    /// Called for an inner node or a cell.
    fn step(&mut self) {}

    /// Called for an element. Returns the new limit, or `None` to stop.
    fn test(&mut self, element: Element) -> Option<f64>;
}

impl<F: FnMut(Element) -> Option<f64>> Visitor for F {
    #[inline(always)]
    fn test(&mut self, element: Element) -> Option<f64> {
        self(element)
    }
}

/// Counts the calls to another visitor.
struct Counting<V> {
    effort: TraversalStatistics,
    visitor: V,
}

impl<V: Visitor> Visitor for Counting<V> {
    fn step(&mut self) {
        self.effort.steps += 1;
    }

    fn test(&mut self, element: Element) -> Option<f64> {
        self.effort.tests += 1;
        self.visitor.test(element)
    }
}

/// An acceleration structure over items; [`Searched`] adds the searches.
pub(crate) trait Structure: Send + Sync + Sized + 'static {
    /// Calls the visitor for every element that may be hit with `min` < t <= `limit`, roughly front
    /// to back. The visitor returns the new limit, or `None` to stop; so does this method.
    fn visit(&self, ray: &WideRay, min: f64, limit: f64, visitor: &mut impl Visitor) -> Option<f64>;

    /// The same structure around moved elements, as in [`Accelerator::refitted`].
    fn refitted(
        &self,
        _geometry: &Geometry,
        _elements: &Elements,
        _rigid: Option<&DAffine3>,
    ) -> Option<Self> {
        None
    }

    /// Statistics of the structure, with `bytes`, but without those that all structures share.
    fn statistics(&self) -> Statistics;

    /// The volumes down to a level, as in [`Accelerator::debug_bounds`]; none if there are no
    /// elements.
    fn debug_bounds(&self, deepest: usize) -> Vec<DebugBounds>;
}

/// A structure, with the nearest-hit and any-hit searches.
pub(crate) struct Searched<S> {
    geometry: Arc<Geometry>,
    /// Unbounded elements, tested for every ray.
    unbounded: Vec<Element>,
    /// Largest absolute coordinate of any box.
    reach: f64,
    /// Padding of rays, relative to the largest coordinate.
    width: f64,
    structure: S,
    /// Number of elements with a box.
    bounded: usize,
    degenerate: usize,
    build_seconds: f64,
}

impl<S: Structure> Searched<S> {
    /// Builds a structure over all elements that have a box. Fails if there are too many elements.
    pub(crate) fn new(
        geometry: Arc<Geometry>,
        build: impl FnOnce(&Geometry, Elements) -> S,
    ) -> Result<Self, SceneErrors> {
        let start = Instant::now();
        check_count(&geometry, MAX_ELEMENTS)?;
        let mut elements = Elements::of(&geometry);
        let unbounded = std::mem::take(&mut elements.unbounded);
        let (bounded, reach, degenerate) = (elements.items.len(), elements.reach, elements.degenerate);
        let structure = build(&geometry, elements);
        Ok(Self {
            geometry,
            unbounded,
            reach,
            width: width(),
            structure,
            bounded,
            degenerate,
            build_seconds: start.elapsed().as_secs_f64(),
        })
    }

    #[inline]
    fn visit(&self, ray: &Ray, interval: Interval, visitor: &mut impl Visitor) -> Option<f64> {
        let mut limit = interval.max;
        for &element in &self.unbounded {
            limit = visitor.test(element)?;
        }
        if !(ray.origin.is_finite() && ray.direction.is_finite()) {
            return Some(limit);
        }
        let wide = WideRay::new(ray, self.width, self.reach);
        self.structure.visit(&wide, interval.min, limit, visitor)
    }

    /// A visitor that keeps the nearest hit of the elements that it is given.
    #[inline]
    fn nearest(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
        best: &mut Option<PreliminaryIntersection>,
    ) -> impl FnMut(Element) -> Option<f64> {
        let sheared = ShearedRay::new(ray);
        let mut open = interval;
        move |element| {
            if let Some(hit) = self.geometry.intersect(element, ray, &sheared, open, skip)
                && best.is_none_or(|best| hit.is_nearer_than(&best))
            {
                *best = Some(hit);
                // Hits at the same distance still count: a lower index wins the tie.
                open.max = hit.t.next_up();
            }
            Some(best.map_or(interval.max, |best| best.t))
        }
    }
}

impl<S: Structure> Accelerator for Searched<S> {
    fn intersect(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<PreliminaryIntersection> {
        let mut best = None;
        self.visit(ray, interval, &mut self.nearest(ray, interval, skip, &mut best));
        best
    }

    fn refitted(&self, geometry: &Arc<Geometry>, rigid: Option<&DAffine3>) -> Option<Box<dyn Accelerator>> {
        let start = Instant::now();
        let elements = Elements::of(geometry);
        if elements.unbounded != self.unbounded || elements.items.len() != self.bounded {
            return None;
        }
        Some(Box::new(Self {
            geometry: geometry.clone(),
            unbounded: self.unbounded.clone(),
            reach: elements.reach,
            width: self.width,
            structure: self.structure.refitted(geometry, &elements, rigid)?,
            bounded: self.bounded,
            degenerate: elements.degenerate,
            build_seconds: start.elapsed().as_secs_f64(),
        }))
    }

    fn traversal_statistics(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<TraversalStatistics> {
        let mut best = None;
        let mut counting = Counting {
            effort: TraversalStatistics::default(),
            visitor: self.nearest(ray, interval, skip, &mut best),
        };
        self.visit(ray, interval, &mut counting);
        Some(counting.effort)
    }

    fn occluded(&self, ray: &Ray, interval: Interval, skip: SelfHitFilter) -> bool {
        let sheared = ShearedRay::new(ray);
        let mut until_hit = |element: Element| {
            let hit = self.geometry.intersect(element, ray, &sheared, interval, skip);
            hit.is_none().then_some(interval.max)
        };
        self.visit(ray, interval, &mut until_hit).is_none()
    }

    fn statistics(&self) -> Statistics {
        let mut statistics = self.structure.statistics();
        *statistics.entry("bytes").or_default() += size_of_val(&*self.unbounded) as f64;
        statistics.extend([
            ("elements", (self.bounded + self.unbounded.len()) as f64),
            ("unbounded", self.unbounded.len() as f64),
            ("degenerate", self.degenerate as f64),
            ("build_seconds", self.build_seconds),
        ]);
        statistics
    }

    fn debug_bounds(&self, deepest: usize) -> Option<Vec<DebugBounds>> {
        Some(self.structure.debug_bounds(deepest))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    thread_local! {
        static WIDTH: Cell<f64> = const { Cell::new(PAD) };
    }

    pub(super) fn width() -> f64 {
        WIDTH.get()
    }

    #[cfg(feature = "all")]
    #[test]
    fn rays_without_width_break_the_law_in_every_structure() {
        use crate::{bsp::Bsp, bvh2::Bvh2, grid::Grid, obb_bvh::ObbBvh};
        use crate::{octree::Octree, slab_bvh::SlabBvh};
        use whitstone_testkit::accelerator_laws;

        WIDTH.set(0.0);
        for (name, laws) in [
            ("bsp", accelerator_laws::<Bsp> as fn(&str)),
            ("bvh2", accelerator_laws::<Bvh2>),
            ("bvh2, relative", accelerator_laws::<crate::bvh2::tests::Relative>),
            ("grid", accelerator_laws::<Grid>),
            ("obb_bvh", accelerator_laws::<ObbBvh>),
            ("octree", accelerator_laws::<Octree>),
            ("slab_bvh", accelerator_laws::<SlabBvh>),
        ] {
            assert!(std::panic::catch_unwind(|| laws("")).is_err(), "{name}");
        }
    }

    #[test]
    fn a_triangle_that_only_its_box_brings_near_does_not_overlap() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let cell = |low: f64, high: f64| Aabb::around([DVec3::splat(low), DVec3::splat(high)]);
        assert!(overlaps(&corners, &cell(-1.0, 0.0), 0.0));
        assert!(overlaps(&corners, &cell(0.0, 0.1), 0.0));
        let beyond = Aabb::around([DVec3::new(0.6, 0.6, -1.0), DVec3::ONE]);
        assert!(!overlaps(&corners, &beyond, 0.0));
        assert!(overlaps(&corners, &beyond, 0.11));
        let above = Aabb::around([DVec3::new(0.0, 0.0, 0.1), DVec3::ONE]);
        assert!(!overlaps(&corners, &above, 0.09));
        assert!(overlaps(&corners, &above, 0.1));
    }

    #[test]
    fn more_elements_than_can_be_numbered_are_refused() {
        let mesh = |count: usize| {
            LoweredShape::Triangles(whitstone_core::TriangleMesh {
                triangles: vec![[0; 3]; count],
                ..Default::default()
            })
        };
        let geometry = Geometry::new(vec![mesh(5), mesh(0), mesh(2)]);
        assert!(check_count(&geometry, 8).is_ok());
        let error = check_count(&geometry, 7).unwrap_err();
        let expected = "the scene has 7 triangles and shapes; an accelerator holds fewer than 7";
        assert_eq!(error.message, expected);
        assert!(check_count(&Geometry::default(), 1).is_ok());
    }

    #[test]
    fn triangles_with_two_corners_in_one_place_are_left_out() {
        let mesh = whitstone_core::TriangleMesh {
            positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::X],
            triangles: vec![[0, 1, 2], [0, 1, 3], [2, 2, 2]],
            ..Default::default()
        };
        let elements = Elements::of(&Geometry::new(vec![LoweredShape::Triangles(mesh)]));
        assert_eq!((elements.items.len(), elements.degenerate), (1, 2));
    }
}
