//! What the readable structures share: which elements have a box, how wide a ray is, and both
//! searches.
//!
//! **Why rays are wide.** A hit is where an element's own test says, and that test rounds: the
//! point at `t` may lie a little outside of the element's box. The slab and plane tests of a
//! structure round too. So a structure treats each ray as if it were `pad` wide in all directions,
//! and visits every box, cell or half-space that such a ray touches. With that, for every hit there
//! is a visited cell that holds the element: the point lies within `pad` of a point of the element,
//! and that one lies in some cell.
//!
//! **When a search may end.** Cells come roughly nearest first. A hit that was found in one may lie
//! beyond it, so it ends nothing; a cell is left out only if the ray enters it strictly behind the
//! best hit.

use crate::vast::vast;
use std::sync::Arc;
use std::time::Instant;
use whitstone_core::triangle::ShearedRay;
use whitstone_core::{
    Aabb, Accelerator, DVec3, Effort, Element, Geometry, Interval, Outline, RawHit, Ray, SceneError,
    SceneErrors, Shape, Skip, Statistics,
};

/// Boxes that reach farther are treated as endless: their areas would overflow.
const FARTHEST: f64 = 1e150;

/// The width of rays, relative to the largest coordinate of ray origin and boxes.
///
/// The test of a box or plane itself errs by a few roundings, 2^-53 each. The test of a triangle
/// errs by about 8 roundings times the ratio of its longest edge to its smallest height, so this
/// pad lets hits on triangles with ratios up to a thousand stay in their boxes; [`needle_pad`] sees
/// to the needles beyond.
pub(crate) const PAD: f64 = 1.0 / (1u64 << 40) as f64;

/// [`PAD`]; tests make rays thinner, to see that the laws then fail.
#[cfg(not(test))]
fn width() -> f64 {
    PAD
}
#[cfg(test)]
use tests::width;

/// What a structure may lose by its own rounding when it cuts elements, relative to the largest
/// coordinate: many roundings, and far below the pad.
pub(crate) const MARGIN: f64 = 1.0 / (1u64 << 46) as f64;

/// Fewer elements than this: they, what refers to them and the nodes over them are numbered in 32
/// bits.
pub(crate) const MOST_ELEMENTS: usize = 1 << 28;

/// Refuses a geometry that does not have fewer than `most` elements.
pub(crate) fn check_count(geometry: &Geometry, most: usize) -> Result<(), SceneError> {
    let count = |shape: &Shape| match shape {
        Shape::Triangles(mesh) => mesh.triangles.len(),
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
    /// Its bounds, with what a needle needs beyond the width of rays.
    pub(crate) aabb: Aabb,
    /// Middle of the bounds.
    pub(crate) center: DVec3,
    pub(crate) element: Element,
    /// Place in the order of the geometry: what makes sorting deterministic.
    pub(crate) number: u32,
    /// Whether the box was widened: such a triangle must not be cut by its corners.
    pub(crate) needle: bool,
}

impl Item {
    /// The corners of a triangle that may be cut by them.
    pub(crate) fn corners(&self, geometry: &Geometry) -> Option<[DVec3; 3]> {
        (!self.needle).then(|| corners(geometry, self.element)).flatten()
    }

    /// The points whose hull holds the element: the corners of the triangle or of the box.
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

/// What a structure is built over.
pub(crate) struct Elements {
    /// In the order of the geometry.
    pub(crate) items: Vec<Item>,
    /// Largest absolute coordinate of any box.
    pub(crate) reach: f64,
    /// Elements without a box of reasonable size, and those of vast shapes.
    unbounded: Vec<Element>,
    /// Triangles with two corners in one place, which nothing can hit.
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
        // Beside nothing, nothing is vast.
        let vast = match geometry.shapes().len() {
            0 | 1 => Vec::new(),
            _ => vast(&boxes(geometry)),
        };
        for (element, number) in geometry.elements().zip(0..) {
            if corners(geometry, element).is_some_and(|[a, b, c]| a == b || b == c || c == a) {
                found.degenerate += 1;
                continue;
            }
            let aabb = geometry.bounds(element);
            let far = aabb.min.abs().max(aabb.max.abs()).max_element();
            let vast = vast.binary_search(&element.shape()).is_ok();
            if vast || aabb.is_empty() || far.is_nan() || far > FARTHEST {
                found.unbounded.push(element);
                continue;
            }
            found.reach = found.reach.max(far);
            found.items.push(Item {
                aabb,
                center: aabb.center(),
                element,
                number,
                needle: false,
            });
        }
        for item in &mut found.items {
            let pad = needle_pad(geometry, item.element, found.reach);
            item.needle = pad > 0.0;
            item.aabb = item.aabb.padded(pad);
        }
        found
    }
}

/// The box of each shape, as far as it has one of reasonable size, and its number of elements.
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
        (Element::Triangle { triangle, .. }, Shape::Triangles(mesh)) => Some(mesh.corners(triangle)),
        _ => None,
    }
}

/// What the box of a needle needs beyond the width of rays: the error of the triangle test, up to
/// which a hit may seem to lie outside the box. It is never more than the longest edge.
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

/// Whether a triangle and a box have a point in common, up to a margin: it is false only if some
/// axis separates them.
///
/// Akenine-Möller, *Fast 3D triangle-box overlap testing*, 2001: the axes are the normal of the
/// triangle and the products of its edges with those of the box; the faces of the box are the
/// caller's concern.
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

/// A ray with its width, prepared for tests against boxes and axis-parallel planes.
pub(crate) struct WideRay {
    pub(crate) ray: Ray,
    /// How far from the line a hit may seem to lie, along each axis.
    pub(crate) pad: f64,
    /// The origin as planes see it where the ray arrives: moved forward, so that it arrives early.
    pub(crate) near_origin: DVec3,
    /// The origin as planes see it where the ray leaves: moved back, so that it leaves late.
    pub(crate) far_origin: DVec3,
    /// Infinite, with the right sign, along axes that the ray does not move in.
    pub(crate) reciprocal: DVec3,
    /// Whether the side of smallest coordinates is the near one (0) or the far one (1).
    pub(crate) near_side: [usize; 3],
}

impl WideRay {
    #[inline]
    fn new(ray: &Ray, pad: f64) -> Self {
        let near_side = ray
            .direction
            .to_array()
            .map(|d| usize::from(d.is_sign_negative()));
        let forward = DVec3::ONE.copysign(ray.direction) * pad;
        Self {
            ray: *ray,
            pad,
            near_origin: ray.origin + forward,
            far_origin: ray.origin - forward,
            reciprocal: ray.direction.recip(),
            near_side,
        }
    }

    /// From where the ray touches what is beyond a plane. A NaN, from zero times infinity, means
    /// that it runs in the very border: the methods `max` and `min` of numbers then ignore it.
    #[inline]
    pub(crate) fn arrives(&self, axis: usize, plane: f64) -> f64 {
        (plane - self.near_origin[axis]) * self.reciprocal[axis]
    }

    /// Up to where the ray touches what is before a plane; NaN as in [`Self::arrives`].
    #[inline]
    pub(crate) fn leaves(&self, axis: usize, plane: f64) -> f64 {
        (plane - self.far_origin[axis]) * self.reciprocal[axis]
    }

    /// The part from `min` to `limit` in which the ray touches a box, if there is one.
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

/// A wide ray as planes with one normal see it.
#[derive(Clone, Copy)]
pub(crate) struct Along {
    near_origin: f64,
    far_origin: f64,
    reciprocal: f64,
    /// Whether the ray runs against the normal.
    pub(crate) backwards: bool,
}

impl WideRay {
    /// Products with the normal are rounded, those of the direction too: on the way to a point of
    /// the geometry that is a distance far below the width.
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

    /// The part of an interval of the ray between two planes, the first with the smaller
    /// coordinate; empty if its start is beyond its end.
    #[inline]
    pub(crate) fn between(&self, min: f64, max: f64, (near, far): (f64, f64)) -> (f64, f64) {
        let (first, last) = if self.backwards { (max, min) } else { (min, max) };
        // NaN is ignored.
        (near.max(self.arrives(first)), far.min(self.leaves(last)))
    }
}

/// The elements that a ray was tested against last, so that one that lies in several cells is
/// seldom tested twice ("inverse mailboxing": Shevtsov, Soupikov, Kapustin, *Highly parallel fast
/// kd-tree construction*, 2007). It belongs to the ray, not to the elements, so threads share
/// nothing.
pub(crate) struct Mailbox([u32; Self::SIZE]);

impl Mailbox {
    const SIZE: usize = 16;

    pub(crate) fn new() -> Self {
        Self([u32::MAX; Self::SIZE])
    }

    /// Whether the element of this number is new, as far as can be remembered.
    #[inline]
    pub(crate) fn is_new(&mut self, number: u32) -> bool {
        std::mem::replace(&mut self.0[number as usize % Self::SIZE], number) != number
    }
}

/// What is done with what a search comes upon.
pub(crate) trait Visitor {
    /// An inner node or a cell.
    fn step(&mut self) {}

    /// An element; the new limit, or `None` to stop.
    fn test(&mut self, element: Element) -> Option<f64>;
}

impl<F: FnMut(Element) -> Option<f64>> Visitor for F {
    #[inline(always)]
    fn test(&mut self, element: Element) -> Option<f64> {
        self(element)
    }
}

/// Counts what another visitor is shown.
struct Counting<V> {
    effort: Effort,
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

/// A structure over items: what differs between the accelerators.
pub(crate) trait Structure: Send + Sync {
    /// Hands every element to the visitor that a hit with `min` < t <= `limit` may be on, nearer
    /// ones roughly first. The visitor returns the new limit, or `None` to stop; so does this.
    fn visit(&self, ray: &WideRay, min: f64, limit: f64, visitor: &mut impl Visitor) -> Option<f64>;

    /// What was built, with `bytes`; the rest is common to all.
    fn statistics(&self) -> Statistics;

    /// The volumes down to a level, as in [`Accelerator::outlines`]; none where there are no
    /// elements.
    fn outlines(&self, deepest: usize) -> Vec<Outline>;
}

/// A structure, and the two searches in it.
pub(crate) struct Searched<S> {
    geometry: Arc<Geometry>,
    /// Elements without a box of reasonable size, tried for every ray.
    unbounded: Vec<Element>,
    /// Largest absolute coordinate of any box.
    reach: f64,
    /// Of rays, relative to the largest coordinate.
    width: f64,
    structure: S,
    /// Elements with a box.
    bounded: usize,
    degenerate: usize,
    build_seconds: f64,
}

impl<S: Structure> Searched<S> {
    /// Builds over all elements that have a box.
    pub(crate) fn new(
        geometry: Arc<Geometry>,
        build: impl FnOnce(&Geometry, Elements) -> S,
    ) -> Result<Self, SceneErrors> {
        let start = Instant::now();
        check_count(&geometry, MOST_ELEMENTS)?;
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
        let wide = WideRay::new(ray, self.width * (ray.origin.abs().max_element() + self.reach));
        self.structure.visit(&wide, interval.min, limit, visitor)
    }

    /// Keeps the nearest hit of those elements that it is shown.
    #[inline]
    fn nearest(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: Skip,
        best: &mut Option<RawHit>,
    ) -> impl FnMut(Element) -> Option<f64> {
        let sheared = ShearedRay::new(ray);
        let mut open = interval;
        move |element| {
            if let Some(hit) = self.geometry.intersect(element, ray, &sheared, open, skip)
                && best.is_none_or(|best| hit.beats(&best))
            {
                *best = Some(hit);
                // Hits at the same distance still count: they may be lower in number.
                open.max = hit.t.next_up();
            }
            Some(best.map_or(interval.max, |best| best.t))
        }
    }
}

impl<S: Structure> Accelerator for Searched<S> {
    fn closest(&self, ray: &Ray, interval: Interval, skip: Skip) -> Option<RawHit> {
        let mut best = None;
        self.visit(ray, interval, &mut self.nearest(ray, interval, skip, &mut best));
        best
    }

    fn effort(&self, ray: &Ray, interval: Interval, skip: Skip) -> Option<Effort> {
        let mut best = None;
        let mut counting = Counting {
            effort: Effort::default(),
            visitor: self.nearest(ray, interval, skip, &mut best),
        };
        self.visit(ray, interval, &mut counting);
        Some(counting.effort)
    }

    fn occluded(&self, ray: &Ray, interval: Interval, skip: Skip) -> bool {
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

    fn outlines(&self, deepest: usize) -> Option<Vec<Outline>> {
        Some(self.structure.outlines(deepest))
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
            Shape::Triangles(whitstone_core::TriangleMesh {
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
        let elements = Elements::of(&Geometry::new(vec![Shape::Triangles(mesh)]));
        assert_eq!((elements.items.len(), elements.degenerate), (1, 2));
    }
}
