use crate::stream::{HitStream, LANES, Lanes, RayStream};
use crate::{
    Aabb, Accelerator, Element, Geometry, InstanceId, Interval, LoweredShape, PreliminaryIntersection, Ray,
    SceneError, SelfHitFilter, SourceSpan, SurfaceAttributes, SurfaceInteraction, Transform,
};
use glam::{DMat3, DVec3};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Deserializer};
use std::borrow::Cow;
use std::sync::Arc;
use toml::Spanned;

/// Unit roundoff: half the distance from 1 to the next number.
const UNIT: f64 = 0.5 * f64::EPSILON;

/// How far outside its bounds an element may appear to be hit, relative to the largest coordinate.
const PAD: f64 = 1.0 / (1u64 << 40) as f64;

/// Number of grid cells along each axis of the bounds of a group.
const CELLS: usize = 4;

/// Up to this condition number the width of rays covers the rounding of the transform: see
/// `docs/accelerators.md`. Instances with a larger one get infinite bounds and are tested for every
/// ray.
const MAX_CONDITION: f64 = 32.0;

/// The width of rays at the bounds of instances, relative to the largest coordinate. It is half of
/// the width that accelerators use, so that none culls what is a hit here.
const WIDTH: f64 = 1.0 / (1u64 << 41) as f64;

/// A group of shapes that is instanced any number of times, with its own space and accelerator.
pub struct Group {
    geometry: Arc<Geometry>,
    accelerator: Box<dyn Accelerator>,
    /// Scene-wide number of the first shape.
    first_shape: u32,
    /// Boxes whose union contains every point that a ray can hit.
    bounds: Vec<Aabb>,
}

impl Group {
    /// From shapes in the group's space, numbered in the scene from `first_shape` on. The
    /// accelerator must be built over the geometry.
    pub fn new(geometry: Arc<Geometry>, accelerator: Box<dyn Accelerator>, first_shape: u32) -> Self {
        Self {
            bounds: bounds(&geometry),
            geometry,
            accelerator,
            first_shape,
        }
    }

    /// The shapes, numbered from 0.
    pub fn geometry(&self) -> &Arc<Geometry> {
        &self.geometry
    }

    /// Built over the geometry.
    pub fn accelerator(&self) -> &dyn Accelerator {
        &*self.accelerator
    }

    /// Scene-wide number of the first shape.
    pub fn first_shape(&self) -> u32 {
        self.first_shape
    }
}

/// Bounds of the parts of a geometry in the cells of a coarse grid. Transformed, they contain less
/// empty space than a single box.
fn bounds(geometry: &Geometry) -> Vec<Aabb> {
    let all = || {
        geometry
            .elements()
            .map(|element| (element, geometry.bounds(element)))
    };
    let whole = all().fold(Aabb::EMPTY, |whole, (_, aabb)| whole.union(aabb));
    if whole.is_empty() || !whole.is_finite() {
        return vec![whole];
    }
    let reach = whole.min.abs().max(whole.max.abs()).max_element();
    let per_cell = CELLS as f64 / whole.extent().max(DVec3::splat(f64::MIN_POSITIVE));
    let mut cells = [Aabb::EMPTY; CELLS * CELLS * CELLS];
    for (element, aabb) in all() {
        let cell = ((aabb.center() - whole.min) * per_cell).as_usizevec3();
        let cell = cell.min(glam::USizeVec3::splat(CELLS - 1));
        let place = &mut cells[(cell.z * CELLS + cell.y) * CELLS + cell.x];
        *place = place.union(aabb.padded(sliver_pad(geometry, element, reach)));
    }
    let used = cells.into_iter().filter(|cell| !cell.is_empty());
    used.map(|cell| cell.padded(PAD * reach)).collect()
}

/// Additional padding for the box of a sliver triangle: the error of the triangle test, by which a
/// hit may appear outside the box. At most the longest edge.
fn sliver_pad(geometry: &Geometry, element: Element, reach: f64) -> f64 {
    let (Element::Triangle { shape, triangle }, shapes) = (element, geometry.shapes()) else {
        return 0.0;
    };
    let LoweredShape::Triangles(mesh) = &shapes[shape as usize] else {
        return 0.0;
    };
    let [a, b, c] = mesh.corners(triangle);
    let squares = [(b - a), (c - b), (a - c)].map(DVec3::length_squared);
    let longest = squares[0].max(squares[1]).max(squares[2]);
    let twice_area = (b - a).cross(c - a).length_squared();
    // The height above the longest edge is twice the area over that edge.
    if longest * longest <= 256.0 * twice_area || longest == 0.0 {
        return 0.0;
    }
    // 64 roundings of coordinates up to eight times the extent of the geometry.
    let error = 512.0 * f64::EPSILON * reach * (longest / twice_area.sqrt());
    error.min(longest.sqrt())
}

/// An instance of a group. Rays are transformed to the group's space without normalising their
/// directions, so that ray parameters are the same in both spaces.
pub struct Instance {
    group: Arc<Group>,
    transform: Transform,
    /// The path of this instance; nested instances follow.
    pub(crate) first_path: InstanceId,
    /// See [`Self::set_variants`]: (number of a shape, number of its variant here), ascending.
    variants: Vec<(u32, u32)>,
    bounds: Aabb,
    /// Bounds how far a hit lies off the surface, in the group's space: entry (i, j) is the offset
    /// along axis i per unit of coordinate j.
    tilt: DMat3,
}

impl Instance {
    /// A group with transform `world_from_group`.
    pub fn new(group: Arc<Group>, transform: Transform) -> Self {
        let forward = transform.world_from_object().matrix3;
        let inverse = transform.object_from_world().matrix3;
        // Points are transformed by the matrix, rays by its rounded inverse. The residual bounds
        // their disagreement; added are the rounding of the residual and of the origins of rays
        // that start here.
        let residual = inverse * forward - DMat3::IDENTITY;
        Self {
            bounds: world_bounds(&group.bounds, &transform),
            tilt: residual.abs() + 8.0 * UNIT * (inverse.abs() * forward.abs()),
            group,
            transform,
            first_path: InstanceId(1),
            variants: Vec::new(),
        }
    }

    /// Shows shapes of the group, given by their scene-wide numbers, under other numbers: hits have
    /// the second number of a pair instead of the first. Numbers are what materials are looked up
    /// by, so an instance can have materials of its own. The second numbers must ascend with the
    /// first ones, and be used nowhere else.
    pub fn set_variants(&mut self, mut variants: Vec<(u32, u32)>) {
        variants.sort_unstable();
        self.variants = variants;
    }

    /// From a scene-wide number in the group to that in the enclosing space.
    fn shown(&self, shape: u32) -> u32 {
        match self.variants.binary_search_by_key(&shape, |(from, _)| *from) {
            Ok(place) => self.variants[place].1,
            Err(_) => shape,
        }
    }

    /// The inverse of [`Self::shown`].
    fn hidden(&self, shape: u32) -> u32 {
        // Second numbers ascend with the first ones.
        match self.variants.binary_search_by_key(&shape, |(_, to)| *to) {
            Ok(place) => self.variants[place].0,
            Err(_) => shape,
        }
    }

    /// The instanced group.
    pub fn group(&self) -> &Arc<Group> {
        &self.group
    }

    /// From the group's space to the enclosing space.
    pub fn transform(&self) -> &Transform {
        &self.transform
    }

    /// A box that contains every point that a ray can hit.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// Number of instance paths: this one and those nested in the group.
    pub fn paths(&self) -> u64 {
        self.group.geometry.paths()
    }

    /// The nearest hit inside the interval.
    pub fn intersect(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<PreliminaryIntersection> {
        let interval = self.inside(ray, interval)?;
        let ray = self.transform.ray_to_object(ray);
        let hit = self
            .group
            .accelerator
            .intersect(&ray, interval, self.skip_inside(skip));
        hit.map(|hit| self.outside(hit))
    }

    /// Renumbers a hit from the group's numbering to that of the enclosing geometry.
    fn outside(&self, hit: PreliminaryIntersection) -> PreliminaryIntersection {
        let shape = match hit.instance {
            InstanceId::TOP_LEVEL => self.group.first_shape + hit.shape,
            // The nested instance has renumbered the shape already.
            _ => hit.shape,
        };
        let instance = InstanceId(self.first_path.0 + hit.instance.0);
        PreliminaryIntersection {
            instance,
            shape: self.shown(shape),
            ..hit
        }
    }

    /// The inverse of [`Self::outside`].
    fn within(&self, hit: &PreliminaryIntersection) -> PreliminaryIntersection {
        let instance = InstanceId(hit.instance.0 - self.first_path.0);
        let shape = self.hidden(hit.shape);
        let shape = match instance {
            InstanceId::TOP_LEVEL => shape - self.group.first_shape,
            _ => shape,
        };
        PreliminaryIntersection {
            instance,
            shape,
            ..*hit
        }
    }

    /// Whether anything is hit inside the interval.
    pub fn occluded(&self, ray: &Ray, interval: Interval, skip: SelfHitFilter) -> bool {
        let Some(interval) = self.inside(ray, interval) else {
            return false;
        };
        let ray = self.transform.ray_to_object(ray);
        self.group
            .accelerator
            .occluded(&ray, interval, self.skip_inside(skip))
    }

    /// The part of an interval in which a ray overlaps the box. Hits outside it do not count: if
    /// the group is smaller than the rounding error at the ray's origin, its own tests are
    /// meaningless.
    #[inline]
    fn inside(&self, ray: &Ray, interval: Interval) -> Option<Interval> {
        let Aabb { min, max } = self.bounds;
        let reach = min.abs().max(max.abs()).max(ray.origin.abs());
        let forward = DVec3::ONE.copysign(ray.direction) * (WIDTH * reach.max_element());
        let reciprocal = ray.direction.recip();
        // NaN (zero times infinity) means that the ray lies exactly in a box plane: `max` and `min`
        // ignore it.
        let to_min = [
            (min - ray.origin - forward) * reciprocal,
            (min - ray.origin + forward) * reciprocal,
        ];
        let to_max = [
            (max - ray.origin - forward) * reciprocal,
            (max - ray.origin + forward) * reciprocal,
        ];
        let (mut near, mut far) = (interval.min, interval.max);
        for axis in 0..3 {
            let backwards = ray.direction[axis].is_sign_negative();
            let (first, last) = if backwards {
                (to_max, to_min)
            } else {
                (to_min, to_max)
            };
            near = near.max(first[0][axis].next_down());
            far = far.min(last[1][axis].next_up());
        }
        (near <= far).then_some(Interval { min: near, max: far })
    }

    /// [`Self::intersect`] for every ray of a stream. Nearer hits replace those already in `hits`.
    pub fn intersect_stream(&self, rays: &RayStream, hits: &mut HitStream) {
        let mut inside = Inside::default();
        self.enter(rays, |lane| Some(hits.t.0[lane]), &mut inside);
        if inside.rays.len == 0 {
            return;
        }
        let mut found = HitStream::default();
        self.group.accelerator.intersect_stream(&inside.rays, &mut found);
        for to in 0..inside.rays.len {
            let lane = usize::from(inside.lanes[to]);
            let hit = match found.get(to) {
                // Stream rays start at 0, but hits before the box do not count.
                Some(hit) if hit.t <= inside.near[to] => {
                    let interval = Interval::up_to(hits.t.0[lane]);
                    self.intersect(&rays.ray(lane), interval, rays.skip.skip(lane))
                }
                Some(hit) => Some(self.outside(hit)),
                None => None,
            };
            if let Some(hit) = hit {
                hits.set(lane, &hit);
            }
        }
    }

    /// Sets the lanes of the rays that hit anything inside their intervals.
    pub fn occluded_stream(&self, rays: &RayStream, hidden: &mut Lanes<bool>) {
        let mut inside = Inside::default();
        self.enter(
            rays,
            |lane| (!hidden[lane]).then_some(rays.limit[lane]),
            &mut inside,
        );
        if inside.rays.len == 0 {
            return;
        }
        let mut found = [false; LANES];
        self.group.accelerator.occluded_stream(&inside.rays, &mut found);
        for to in (0..inside.rays.len).filter(|to| found[*to]) {
            let lane = usize::from(inside.lanes[to]);
            // Stream rays start at 0. If the box starts later, test again from there.
            hidden[lane] = inside.near[to] <= 0.0
                || self.occluded(&rays.ray(lane), rays.interval(lane), rays.skip.skip(lane));
        }
    }

    /// Collects the rays that overlap the box, transformed to the group's space.
    fn enter(&self, rays: &RayStream, limit: impl Fn(usize) -> Option<f64>, inside: &mut Inside) {
        for lane in 0..rays.len {
            let ray = rays.ray(lane);
            let touched = limit(lane).and_then(|limit| self.inside(&ray, Interval::up_to(limit)));
            if let Some(interval) = touched {
                let to = inside.rays.len;
                let skip = self.skip_inside(rays.skip.skip(lane));
                inside
                    .rays
                    .set(to, self.transform.ray_to_object(&ray), interval.max, skip);
                inside.lanes[to] = lane as u16;
                inside.near[to] = interval.min;
                inside.rays.len += 1;
            }
        }
    }

    /// The path relative to this instance: 0 for the group's own shapes; `None` if it does not lead
    /// through this instance.
    fn path_inside(&self, path: InstanceId) -> Option<InstanceId> {
        let inside = path.0.wrapping_sub(self.first_path.0);
        (u64::from(inside) < self.paths()).then_some(InstanceId(inside))
    }

    fn skip_inside(&self, skip: SelfHitFilter) -> SelfHitFilter {
        let Some((path, shape, primitive)) = skip.id() else {
            return SelfHitFilter::NOTHING;
        };
        let shape = self.hidden(shape);
        match self.path_inside(path) {
            None => SelfHitFilter::NOTHING,
            Some(InstanceId::TOP_LEVEL) => {
                SelfHitFilter::of(InstanceId::TOP_LEVEL, shape - self.group.first_shape, primitive)
            }
            Some(path) => SelfHitFilter::of(path, shape, primitive),
        }
    }

    /// The surface at a hit of this ray.
    ///
    /// Pharr, Jakob, Humphreys, PBR (4th ed.), 6.8.6: the error of a transformed point is the
    /// transformed error plus that of the transformation, here along the normal.
    pub fn surface(
        &self,
        ray: &Ray,
        hit: &PreliminaryIntersection,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction {
        let local = self.transform.ray_to_object(ray);
        let geometry = &self.group.geometry;
        let hit = self.within(hit);
        let point = match hit.instance {
            InstanceId::TOP_LEVEL => geometry.surface(&local, &hit, needs),
            _ => geometry.instanced(&local, &hit, needs),
        };
        let forward = self.transform.world_from_object();
        let across = self.transform.object_from_world().matrix3.transpose() * point.n_g;
        let length = across.length();
        let n_g = across / length;
        let p = point.position.abs();
        let terms = forward.translation.abs() + forward.matrix3.abs() * p;
        let of_group = (point.error + point.n_g.abs().dot(self.tilt * p)) / length;
        let n_s = if point.n_s == point.n_g {
            n_g
        } else {
            self.transform.normal_to_world(point.n_s)
        };
        SurfaceInteraction {
            position: self.transform.point_to_world(point.position),
            // Three products, three sums, and one more unit for the rounding of the spawned ray's
            // origin.
            error: of_group + 5.0 * UNIT * n_g.abs().dot(terms),
            n_g,
            n_s,
            uv: point.uv,
            uv_gradient: point.uv_gradient,
            footprint: point.footprint,
            vertex: point.vertex.transformed(&forward.matrix3),
        }
    }

    /// See [`crate::Shape::surface_at_offset`].
    pub(crate) fn surface_at_offset(
        &self,
        point: &SurfaceInteraction,
        hit: &PreliminaryIntersection,
        q: DVec3,
        needs: SurfaceAttributes,
    ) -> Option<SurfaceInteraction> {
        let hit = self.within(hit);
        let into = self.transform.object_from_world();
        let mut local = *point;
        local.position = into.transform_point3(point.position);
        let geometry = &self.group.geometry;
        let mut there = geometry.surface_at_offset(&local, &hit, into.transform_point3(q), needs)?;
        there.n_s = self.transform.normal_to_world(there.n_s);
        Some(there)
    }
}

/// The rays of a stream that overlap an instance, compacted.
struct Inside {
    rays: RayStream,
    /// Ray parameters at which they enter the box.
    near: Lanes<f64>,
    /// Their lanes in the original stream.
    lanes: Lanes<u16>,
}

impl Default for Inside {
    fn default() -> Self {
        Self {
            rays: RayStream::default(),
            near: [0.0; LANES],
            lanes: [0; LANES],
        }
    }
}

/// World-space bounds of boxes of the group's space, padded for rounding errors of hits.
fn world_bounds(parts: &[Aabb], transform: &Transform) -> Aabb {
    if parts.iter().all(Aabb::is_empty) {
        return Aabb::EMPTY;
    }
    let forward = transform.world_from_object();
    let condition = forward.matrix3.abs() * transform.object_from_world().matrix3.abs();
    let condition = (condition * DVec3::ONE).max_element();
    let finite = parts.iter().all(Aabb::is_finite);
    // Negated so that NaN takes this branch.
    if !(finite && condition <= MAX_CONDITION) {
        return Aabb::EVERYTHING;
    }
    let whole = parts.iter().fold(Aabb::EMPTY, |whole, part| {
        whole.union(transform.aabb_to_world(part))
    });
    // Rounding of the corners, and of rays that are transformed relative to the group's origin,
    // which may be far away.
    let reach = whole
        .min
        .abs()
        .max(whole.max.abs())
        .max(forward.translation.abs());
    let padded = whole.padded(64.0 * f64::EPSILON * condition * reach.max_element());
    if padded.is_finite() {
        padded
    } else {
        Aabb::EVERYTHING
    }
}

/// The id of a group of shapes, with its position in the source. Its key is always called `group`.
#[derive(Clone, Debug)]
pub struct GroupRef {
    /// Position in the source.
    pub span: SourceSpan,
    /// As in `[group.ID]`.
    pub id: String,
}

impl<'de> Deserialize<'de> for GroupRef {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let id = Spanned::<String>::deserialize(deserializer)?;
        Ok(Self {
            span: id.span(),
            id: id.into_inner(),
        })
    }
}

impl JsonSchema for GroupRef {
    fn schema_name() -> Cow<'static, str> {
        "GroupRef".into()
    }
    fn inline_schema() -> bool {
        true
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "string", "description": "id of a group of shapes" })
    }
}

impl GroupRef {
    /// The error that no group has this id.
    pub fn no_groups(&self) -> SceneError {
        SceneError::at(self.span.clone(), format!("no group has the id \"{}\"", self.id))
    }
}
