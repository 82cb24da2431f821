use crate::simd;
use crate::stream::{GROUP, HitStream, LANES, Lanes, RayStream, SurfaceStream};
use crate::triangle::{ShearedRay, ShearedStream, TriangleHit};
use crate::{
    Aabb, Instance, InstanceId, Interval, LimitReached, LoweredShape, MeshAttributes,
    PreliminaryIntersection, Ray, SelfHitFilter, ShapeHit, SurfaceAttributes, SurfaceInteraction,
};
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;

/// An indexed triangle mesh, in the space of the scene or of its group.
#[derive(Clone, Debug)]
pub struct TriangleMesh {
    /// Vertex positions in metres.
    pub positions: Vec<DVec3>,
    /// Unit vertex normals, as many as positions, or none.
    pub normals: Vec<DVec3>,
    /// Texture coordinates, as many as positions, or none (then they are zero).
    pub uvs: Vec<DVec2>,
    /// Three vertex indices per triangle, each less than the number of positions.
    pub triangles: Vec<[u32; 3]>,
    /// -1 if the transform that was applied to the positions mirrors, otherwise 1. The winding
    /// defines the outside in object space.
    pub orientation: f64,
    /// Further attributes, if the mesh has any.
    pub attributes: Option<Box<MeshAttributes>>,
}

impl Default for TriangleMesh {
    /// No triangles, and an orientation of 1.
    fn default() -> Self {
        Self {
            positions: Vec::new(),
            normals: Vec::new(),
            uvs: Vec::new(),
            triangles: Vec::new(),
            orientation: 1.0,
            attributes: None,
        }
    }
}

impl TriangleMesh {
    /// The corners of a triangle.
    #[inline]
    pub fn corners(&self, triangle: u32) -> [DVec3; 3] {
        let [a, b, c] = self.triangles[triangle as usize];
        let corner = |i: u32| self.positions[i as usize];
        [corner(a), corner(b), corner(c)]
    }

    /// The hit of a sheared ray with a triangle.
    #[inline]
    pub fn intersect(&self, ray: &ShearedRay, triangle: u32) -> Option<TriangleHit> {
        let [a, b, c] = self.corners(triangle);
        ray.intersect(a, b, c)
    }

    /// Intersects a stream with all triangles; `shape` is the number of this mesh. Nearer hits
    /// replace those already in `hits`.
    pub fn intersect_stream(&self, shape: u32, rays: &RayStream, hits: &mut HitStream) {
        let sheared = ShearedStream::new(rays);
        simd::dispatch(
            #[inline(always)]
            || {
                for triangle in 0..self.triangles.len() as u32 {
                    let corners = self.corners(triangle);
                    for start in rays.groups() {
                        let mut t = [0.0; GROUP];
                        let (mut u, mut v) = (t, t);
                        for k in 0..GROUP {
                            let hit = sheared.intersect(rays, start + k, corners);
                            (t[k], u[k], v[k]) = (hit.t, hit.u, hit.v);
                        }
                        for k in 0..GROUP {
                            let counts = !rays.skip.names(start + k, shape, triangle);
                            let prim_uv = DVec2::new(u[k], v[k]);
                            let hit = ShapeHit {
                                t: t[k],
                                primitive: triangle,
                                prim_uv,
                            };
                            hits.offer(start + k, counts, shape, &hit);
                        }
                    }
                }
            },
        );
    }

    /// Sets the lanes whose rays hit any triangle inside their intervals.
    pub fn occluded_stream(&self, shape: u32, rays: &RayStream, hidden: &mut Lanes<bool>) {
        let sheared = ShearedStream::new(rays);
        simd::dispatch(
            #[inline(always)]
            || {
                for triangle in 0..self.triangles.len() as u32 {
                    let corners = self.corners(triangle);
                    for lane in 0..rays.len.min(LANES) {
                        let t = sheared.intersect(rays, lane, corners).t;
                        let counts = !rays.skip.names(lane, shape, triangle);
                        hidden[lane] |= counts & (t > 0.0) & (t < rays.limit[lane]);
                    }
                }
            },
        );
    }

    pub(crate) fn surface(
        &self,
        hit: &PreliminaryIntersection,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction {
        let indices = self.triangles[hit.primitive as usize];
        let [a, b, c] = self.corners(hit.primitive);
        let DVec2 { x: u, y: v } = hit.prim_uv;
        let weights = [1.0 - u - v, u, v];
        let position = weights[0] * a + weights[1] * b + weights[2] * c;
        // Pharr, Jakob, Humphreys, PBR (4th ed.), 6.8.4: gamma(7) times the sum of the absolute
        // products. The weights are at most 1; one more unit covers the rounding of the spawned
        // ray's origin.
        let largest = a.abs().max(b.abs()).max(c.abs()).max_element();
        let error = 8.0 * f64::EPSILON * largest;
        let n_g = (b - a).cross(c - a).normalize() * self.orientation;
        let mut point = SurfaceInteraction::new(position, error, n_g);
        let blend =
            |values: [DVec3; 3]| weights[0] * values[0] + weights[1] * values[1] + weights[2] * values[2];
        if needs.contains(SurfaceAttributes::SHADING_NORMAL) && !self.normals.is_empty() {
            let n_s = blend(indices.map(|i| self.normals[i as usize]));
            // Opposite vertex normals can cancel: fall back to the geometric normal.
            point.n_s = n_s.try_normalize().unwrap_or(n_g);
        }
        if needs.contains(SurfaceAttributes::UV) && !self.uvs.is_empty() {
            point.uv = blend(indices.map(|i| self.uvs[i as usize].extend(0.0))).truncate();
        }
        if let Some(attributes) = &self.attributes {
            point.vertex = attributes.at(hit.primitive as usize, indices, weights, needs);
        }
        point
    }

    /// See [`crate::Shape::surface_at_offset`].
    pub(crate) fn surface_at_offset(
        &self,
        hit: &PreliminaryIntersection,
        q: DVec3,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction {
        let [a, b, c] = self.corners(hit.primitive);
        let (e, f) = (b - a, c - a);
        let across = e.cross(f);
        let per = (q - a) / across.length_squared();
        let prim_uv = DVec2::new(per.cross(f).dot(across), e.cross(per).dot(across));
        self.surface(&PreliminaryIntersection { prim_uv, ..*hit }, needs)
    }
}

/// An item that an accelerator stores.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Element {
    /// A triangle of a mesh.
    Triangle {
        /// Number of the shape.
        shape: u32,
        /// Number of the triangle in the shape.
        triangle: u32,
    },
    /// A whole shape; also an instance of a group.
    Custom {
        /// Number of the shape.
        shape: u32,
    },
}

/// All shapes of a scene or of a group, by number. Accelerators are built over its elements.
pub struct Geometry {
    shapes: Vec<LoweredShape>,
    /// The instances: first path of each, ascending, and index of its shape.
    instances: Vec<(u32, u32)>,
    /// Number of instance paths, [`InstanceId::TOP_LEVEL`] included.
    paths: u64,
}

impl Default for Geometry {
    fn default() -> Self {
        Self::new(Vec::new())
    }
}

impl Geometry {
    /// Builds the geometry from the shapes in scene order.
    pub fn new(mut shapes: Vec<LoweredShape>) -> Self {
        let mut instances = Vec::new();
        let mut paths = 1u64;
        for (shape, place) in shapes.iter_mut().zip(0..) {
            if let LoweredShape::Instance(instance) = shape {
                instance.first_path = InstanceId(paths as u32);
                instances.push((paths as u32, place));
                paths = paths.saturating_add(instance.paths());
            }
        }
        Self {
            shapes,
            instances,
            paths,
        }
    }

    /// The shapes whose search for hits reached its limit so far, by their number in the scene;
    /// see [`crate::Shape::search_limit`].
    pub fn search_limits(&self) -> BTreeMap<u32, LimitReached> {
        let mut all = BTreeMap::new();
        self.add_search_limits(0, &mut all);
        all
    }

    /// A sentence about each of [`Self::search_limits`].
    pub fn search_limit_notes(&self) -> Vec<String> {
        let limits = self.search_limits().into_iter();
        limits
            .map(|(shape, reached)| format!("shape {shape}: {reached}; hits may be missing there"))
            .collect()
    }

    fn add_search_limits(&self, first: u32, all: &mut BTreeMap<u32, LimitReached>) {
        for (shape, number) in self.shapes.iter().zip(first..) {
            match shape {
                LoweredShape::Triangles(_) => {}
                LoweredShape::Custom(shape) => {
                    all.extend(shape.search_limit().map(|reached| (number, reached)));
                }
                LoweredShape::Instance(instance) => {
                    let group = instance.group();
                    group.geometry().add_search_limits(group.first_shape(), all);
                }
            }
        }
    }

    /// Number of instance paths ([`InstanceId`]), [`InstanceId::TOP_LEVEL`] included. The
    /// pipeline rejects scenes with more than `u32::MAX`.
    pub fn paths(&self) -> u64 {
        self.paths
    }

    /// The numbers of the instance shapes along a path, outermost first.
    pub fn placed_by(&self, path: InstanceId) -> Vec<u32> {
        let Some((shape, instance)) = self.instance(path) else {
            return Vec::new();
        };
        let group = instance.group();
        let mut inside = group
            .geometry()
            .placed_by(InstanceId(path.0 - instance.first_path.0));
        // The deeper ones already have scene-wide numbers.
        if let Some(first) = inside.first_mut() {
            *first += group.first_shape();
        }
        inside.insert(0, shape);
        inside
    }

    /// The instance that a path leads through, and the number of its shape.
    pub(crate) fn instance(&self, path: InstanceId) -> Option<(u32, &Instance)> {
        let after = self.instances.partition_point(|(first, _)| *first <= path.0);
        let (_, shape) = self.instances.get(after.checked_sub(1)?)?;
        match &self.shapes[*shape as usize] {
            LoweredShape::Instance(instance) => Some((*shape, instance)),
            _ => None,
        }
    }

    /// The surface at a hit of this ray on an instance.
    #[cold]
    #[inline(never)]
    pub(crate) fn instanced(
        &self,
        ray: &Ray,
        hit: &PreliminaryIntersection,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction {
        let (_, instance) = self
            .instance(hit.instance)
            .expect("the hit belongs to an instance");
        instance.surface(ray, hit, needs)
    }

    /// The shapes by number, by value, to modify and rebuild.
    pub fn into_shapes(self) -> Vec<LoweredShape> {
        self.shapes
    }

    /// The shapes by number.
    pub fn shapes(&self) -> &[LoweredShape] {
        &self.shapes
    }

    /// All elements by shape, then by triangle. With instances this is not the order of ties:
    /// compare hits with [`PreliminaryIntersection::is_nearer_than`].
    pub fn elements(&self) -> impl Iterator<Item = Element> + '_ {
        self.shapes.iter().zip(0u32..).flat_map(|(part, shape)| {
            let count = match part {
                LoweredShape::Triangles(mesh) => mesh.triangles.len(),
                LoweredShape::Custom(_) | LoweredShape::Instance(_) => 1,
            };
            (0..count as u32).map(move |triangle| match part {
                LoweredShape::Triangles(_) => Element::Triangle { shape, triangle },
                LoweredShape::Custom(_) | LoweredShape::Instance(_) => Element::Custom { shape },
            })
        })
    }

    /// Bounds of an element. By rounding, a hit may lie outside of them: an accelerator must widen
    /// its boxes or rays. `docs/accelerators.md`, "Why no box that contains a hit is rejected",
    /// says by how much.
    pub fn bounds(&self, element: Element) -> Aabb {
        match (element, &self.shapes[element.shape() as usize]) {
            (Element::Triangle { triangle, .. }, LoweredShape::Triangles(mesh)) => {
                Aabb::around(mesh.corners(triangle))
            }
            (_, LoweredShape::Custom(primitive)) => primitive.bounds(),
            (_, LoweredShape::Instance(instance)) => instance.bounds(),
            (Element::Custom { .. }, LoweredShape::Triangles(mesh)) => {
                Aabb::around(mesh.positions.iter().copied())
            }
        }
    }

    /// The hit of a ray with one element inside the interval. `sheared` must be built from `ray`.
    #[inline]
    pub fn intersect(
        &self,
        element: Element,
        ray: &Ray,
        sheared: &ShearedRay,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<PreliminaryIntersection> {
        let shape = element.shape();
        let origin_primitive = skip.of_shape(InstanceId::TOP_LEVEL, shape);
        let hit = match (element, &self.shapes[shape as usize]) {
            (Element::Triangle { triangle, .. }, LoweredShape::Triangles(mesh)) => {
                if origin_primitive == Some(triangle) {
                    return None;
                }
                let TriangleHit { t, u, v } = mesh.intersect(sheared, triangle)?;
                ShapeHit {
                    t,
                    primitive: triangle,
                    prim_uv: DVec2::new(u, v),
                }
            }
            (_, LoweredShape::Custom(primitive)) => primitive.intersect(ray, interval, origin_primitive)?,
            (_, LoweredShape::Instance(instance)) => return instance.intersect(ray, interval, skip),
            (Element::Custom { .. }, LoweredShape::Triangles(_)) => return None,
        };
        interval
            .contains(hit.t)
            .then(|| hit.of_shape(InstanceId::TOP_LEVEL, shape))
    }

    /// The surface at a hit of this ray.
    pub fn surface(
        &self,
        ray: &Ray,
        hit: &PreliminaryIntersection,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction {
        match self.shapes.get(hit.shape as usize) {
            Some(LoweredShape::Triangles(mesh)) => mesh.surface(hit, needs),
            Some(LoweredShape::Custom(primitive)) => primitive.surface(ray, hit, needs),
            // Shapes of groups are numbered after all shapes of the scene.
            Some(LoweredShape::Instance(_)) | None => self.instanced(ray, hit, needs),
        }
    }

    /// See [`crate::Shape::surface_at_offset`]; `point` is in the space of this geometry.
    pub fn surface_at_offset(
        &self,
        point: &SurfaceInteraction,
        hit: &PreliminaryIntersection,
        q: DVec3,
        needs: SurfaceAttributes,
    ) -> Option<SurfaceInteraction> {
        match self.shapes.get(hit.shape as usize) {
            Some(LoweredShape::Triangles(mesh)) => Some(mesh.surface_at_offset(hit, q, needs)),
            Some(LoweredShape::Custom(primitive)) => primitive.surface_at_offset(point, hit, q, needs),
            Some(LoweredShape::Instance(_)) | None => self
                .instance(hit.instance)?
                .1
                .surface_at_offset(point, hit, q, needs),
        }
    }

    /// [`Self::surface`] for every ray of a stream, all of which hit this shape.
    pub fn surface_stream(
        &self,
        shape: u32,
        rays: &RayStream,
        hits: &HitStream,
        needs: SurfaceAttributes,
        points: &mut SurfaceStream,
    ) {
        match self.shapes.get(shape as usize) {
            Some(LoweredShape::Triangles(mesh)) => {
                for lane in 0..rays.len {
                    points.set(lane, &mesh.surface(&hits.hit(lane), needs));
                }
            }
            Some(LoweredShape::Custom(primitive)) => primitive.surface_stream(rays, hits, needs, points),
            Some(LoweredShape::Instance(_)) | None => {
                for lane in 0..rays.len {
                    points.set(lane, &self.instanced(&rays.ray(lane), &hits.hit(lane), needs));
                }
            }
        }
    }
}

impl Element {
    /// Number of the shape that the element belongs to.
    pub fn shape(self) -> u32 {
        match self {
            Self::Triangle { shape, .. } | Self::Custom { shape } => shape,
        }
    }
}
