//! Triangles in the image: projection of vertices, clipping, filling and the depth buffer.
//!
//! A vertex is (x w, y w, depth, w) and appears at (x, y) in the image, in pixels. Three such rows,
//! without the depth, span a triangle as a cone from the camera. A pixel is inside where (x, y, 1)
//! is on the inner side of the three planes that bound the cone. This test needs no division and no
//! vertices created by clipping; only the bounds of a triangle need both. Triangles that share an
//! edge share its plane up to the sign, and the fill rule assigns pixels exactly on it to one of
//! them.

use whitstone_core::simd::{self, select};
use whitstone_core::stream::{GROUP, HitStream, LANES, Lanes, NO_SHAPE, RayStream};
use whitstone_core::triangle::ShearedRay;
use whitstone_core::{
    DMat4, DVec2, DVec3, DVec4, Geometry, InstanceId, LoweredShape, PreliminaryIntersection, TriangleMesh,
};

/// Margin of clipping around the image in pixels, for rounding errors.
const MARGIN: f64 = 1.0;

/// Upper bound of the rounding error of a projected vertex, in pixels.
const ROUNDING: f64 = 1e-6;

/// The projected vertices of all meshes, by shape number.
pub(super) struct Projected(Vec<Vec<DVec4>>);

/// Projects every vertex once.
pub(super) fn project(geometry: &Geometry, to_image: &DMat4) -> Projected {
    let vertices = |shape: &LoweredShape| match shape {
        LoweredShape::Triangles(mesh) => {
            let all = mesh.positions.iter();
            all.map(|position| *to_image * position.extend(1.0)).collect()
        }
        _ => Vec::new(),
    };
    Projected(geometry.shapes().iter().map(vertices).collect())
}

impl Projected {
    /// The projected corners of a triangle.
    #[inline(always)]
    pub(super) fn corners(&self, mesh: &TriangleMesh, shape: u32, triangle: u32) -> [DVec4; 3] {
        mesh.triangles[triangle as usize].map(|vertex| self.0[shape as usize][vertex as usize])
    }
}

/// Bounds of a triangle in the image; `None` if it is outside.
#[inline(always)]
pub(super) fn outline(corners: [DVec4; 3], film: DVec2) -> Option<[DVec2; 2]> {
    let in_front = corners.iter().all(|corner| corner.w > 0.0);
    if !in_front {
        return clipped(corners, film);
    }
    let [a, b, c] = corners.map(|corner| DVec2::new(corner.x, corner.y) / corner.w);
    within(a.min(b).min(c) - ROUNDING, a.max(b).max(c) + ROUNDING, film)
}

/// [`outline`] of a triangle that is partly behind the camera, clipped to the half space in front
/// of it and to the image.
#[cold]
#[inline(never)]
fn clipped(corners: [DVec4; 3], film: DVec2) -> Option<[DVec2; 2]> {
    let sides = [
        DVec4::W,
        DVec4::new(1.0, 0.0, 0.0, MARGIN),
        DVec4::new(-1.0, 0.0, 0.0, film.x + MARGIN),
        DVec4::new(0.0, 1.0, 0.0, MARGIN),
        DVec4::new(0.0, -1.0, 0.0, film.y + MARGIN),
    ];
    // Sutherland and Hodgman, *Reentrant polygon clipping*, 1974: each side adds at most one
    // corner.
    let mut polygon = corners.to_vec();
    for side in sides {
        let before = std::mem::take(&mut polygon);
        for (k, here) in before.iter().enumerate() {
            let next = before[(k + 1) % before.len()];
            let (d_here, d_next) = (here.dot(side), next.dot(side));
            if d_here >= 0.0 {
                polygon.push(*here);
            }
            if (d_here < 0.0) != (d_next < 0.0) {
                polygon.push(*here + d_here / (d_here - d_next) * (next - *here));
            }
        }
    }
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for corner in &polygon {
        let at = DVec2::new(corner.x, corner.y) / corner.w;
        if !at.is_finite() {
            // A corner at the camera itself may project anywhere.
            return Some([DVec2::ZERO, film]);
        }
        (low, high) = (low.min(at - MARGIN), high.max(at + MARGIN));
    }
    within(low, high, film)
}

/// Clips bounds to the image. NaN compares false, so such bounds cover the whole image.
#[inline(always)]
fn within(low: DVec2, high: DVec2, film: DVec2) -> Option<[DVec2; 2]> {
    let beside = low.cmpgt(film).any() || high.cmplt(DVec2::ZERO).any() || low.cmpgt(high).any();
    (!beside).then(|| [low.max(DVec2::ZERO), high.min(film)])
}

/// A triangle that is ready to be filled.
struct TriangleSetup {
    /// The planes opposite to its corners, positive inside.
    planes: [DVec3; 3],
    /// Whether pixels exactly on a plane belong to the triangle: those on left edges and on
    /// horizontal top edges do.
    owns: [bool; 3],
    /// Depths of the corners.
    depths: DVec3,
}

impl TriangleSetup {
    /// `None` if the triangle is edge-on or not finite.
    #[inline(always)]
    fn new([a, b, c]: [DVec4; 3]) -> Option<Self> {
        let flat = |q: DVec4| DVec3::new(q.x, q.y, q.w);
        let (p, q, r) = (flat(a), flat(b), flat(c));
        let planes = [q.cross(r), r.cross(p), p.cross(q)];
        let volume = p.dot(planes[0]);
        if !(volume.abs() > 0.0 && volume.abs() < f64::INFINITY) {
            return None;
        }
        let planes = planes.map(|plane| plane * volume.signum());
        let owns = planes.map(|plane| plane.x > 0.0 || (plane.x == 0.0 && plane.y > 0.0));
        let depths = DVec3::new(a.z, b.z, c.z);
        Some(Self { planes, owns, depths })
    }

    /// Depth at a pixel (NaN outside) and the perspective-correct weights of the second and third
    /// corner.
    #[inline(always)]
    fn at(&self, x: f64, y: f64) -> DVec3 {
        let [e0, e1, e2] = self.planes.map(|plane| plane.x * x + plane.y * y + plane.z);
        let within = |e: f64, owns: bool| (e > 0.0) | (owns & (e == 0.0));
        let inside = within(e0, self.owns[0]) & within(e1, self.owns[1]) & within(e2, self.owns[2]);
        let sum = e0 + e1 + e2;
        let depth = (e0 * self.depths.x + e1 * self.depths.y + e2 * self.depths.z) / sum;
        DVec3::new(select(inside, depth, f64::NAN), e1 / sum, e2 / sum)
    }
}

/// The depth buffer of the pixels of a stream.
pub(super) struct Depths {
    len: usize,
    x: Lanes<f64>,
    y: Lanes<f64>,
    /// Depth where camera rays start; nearer surfaces are invisible.
    start: Lanes<f64>,
    nearest: Lanes<f64>,
    shape: Lanes<u32>,
    triangle: Lanes<u32>,
    /// Weights of the second and third corner.
    second: Lanes<f64>,
    third: Lanes<f64>,
    /// Bounds in the image of each group of lanes.
    groups: [[DVec2; 2]; LANES / GROUP],
}

impl Depths {
    pub(super) fn new(raster: &Lanes<DVec2>, rays: &RayStream, to_image: &DMat4) -> Self {
        let len = rays.len.min(LANES);
        let mut depths = Self {
            len,
            x: [f64::NAN; LANES],
            y: [f64::NAN; LANES],
            start: [0.0; LANES],
            nearest: [f64::INFINITY; LANES],
            shape: [NO_SHAPE; LANES],
            triangle: [0; LANES],
            second: [0.0; LANES],
            third: [0.0; LANES],
            groups: [[DVec2::INFINITY, DVec2::NEG_INFINITY]; LANES / GROUP],
        };
        let depth = to_image.row(2);
        for (lane, at) in raster.iter().enumerate().take(len) {
            (depths.x[lane], depths.y[lane]) = (at.x, at.y);
            depths.start[lane] = depth.dot(rays.origin.get(lane).extend(1.0));
            let [low, high] = &mut depths.groups[lane / GROUP];
            (*low, *high) = (low.min(*at), high.max(*at));
        }
        depths
    }

    /// Bounds of all pixels in the image.
    pub(super) fn bounds(&self) -> (DVec2, DVec2) {
        let start = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let all = self.groups.iter();
        all.fold(start, |(low, high), group| {
            (low.min(group[0]), high.max(group[1]))
        })
    }

    /// Draws triangles. Of several at the same depth, the first stays.
    pub(super) fn draw(
        &mut self,
        shapes: &[LoweredShape],
        projected: &Projected,
        film: DVec2,
        triangles: &[(u32, u32)],
    ) {
        simd::dispatch(
            #[inline(always)]
            || {
                for &(shape, triangle) in triangles {
                    let LoweredShape::Triangles(mesh) = &shapes[shape as usize] else {
                        continue;
                    };
                    let corners = projected.corners(mesh, shape, triangle);
                    let Some(filled) = TriangleSetup::new(corners) else {
                        continue;
                    };
                    let Some([low, high]) = outline(corners, film) else {
                        continue;
                    };
                    for group in 0..self.len.div_ceil(GROUP) {
                        let [least, most] = self.groups[group];
                        if least.cmple(high).all() && most.cmpge(low).all() {
                            self.fill(group * GROUP, &filled, shape, triangle);
                        }
                    }
                }
            },
        );
    }

    /// Fills the pixels of a group of lanes.
    #[inline(always)]
    fn fill(&mut self, first: usize, filled: &TriangleSetup, shape: u32, triangle: u32) {
        for lane in first..first + GROUP {
            let found = filled.at(self.x[lane], self.y[lane]);
            let nearer = (found.x > self.start[lane]) & (found.x < self.nearest[lane]);
            self.nearest[lane] = select(nearer, found.x, self.nearest[lane]);
            self.second[lane] = select(nearer, found.y, self.second[lane]);
            self.third[lane] = select(nearer, found.z, self.third[lane]);
            self.shape[lane] = select(nearer, shape, self.shape[lane]);
            self.triangle[lane] = select(nearer, triangle, self.triangle[lane]);
        }
    }

    /// The visible surfaces as hits of the camera rays. The shaded point is the intersection of ray
    /// and triangle. If rounding makes the ray miss, it is the point from the depth buffer.
    pub(super) fn hits(&self, geometry: &Geometry, rays: &RayStream) -> Box<HitStream> {
        let mut hits = Box::<HitStream>::default();
        hits.clear(rays);
        for lane in 0..self.len {
            let (shape, primitive) = (self.shape[lane], self.triangle[lane]);
            let Some(LoweredShape::Triangles(mesh)) = geometry.shapes().get(shape as usize) else {
                continue;
            };
            let ray = rays.ray(lane);
            let met = mesh.intersect(&ShearedRay::new(&ray), primitive);
            let (t, u, v) = match met {
                Some(hit) if hit.t > 0.0 => (hit.t, hit.u, hit.v),
                _ => {
                    let (u, v) = (self.second[lane], self.third[lane]);
                    let [a, b, c] = mesh.corners(primitive);
                    let point = (1.0 - u - v) * a + u * b + v * c;
                    (
                        (point - ray.origin).dot(ray.direction).max(f64::MIN_POSITIVE),
                        u,
                        v,
                    )
                }
            };
            hits.set(
                lane,
                &PreliminaryIntersection {
                    t,
                    prim_uv: DVec2::new(u, v),
                    instance: InstanceId::TOP_LEVEL,
                    shape,
                    primitive,
                },
            );
        }
        hits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{Camera, Ray};
    use whitstone_testkit::Random;

    /// As many pixels as a stream has rays.
    const FILM: DVec2 = DVec2::splat(16.0);

    /// A pinhole camera with a window of two metres at a distance of one metre.
    struct Pinhole {
        eye: DVec3,
        axes: [DVec3; 3],
    }

    impl Pinhole {
        fn random(random: &mut Random) -> Self {
            let (forward, other) = (random.direction(), random.direction());
            let right = forward.cross(other).normalize();
            let axes = [right, right.cross(forward), forward];
            let eye = random.cube();
            Self { eye, axes }
        }

        fn to_image(&self) -> DMat4 {
            let [right, up, depth] = self.axes.map(|axis| axis.extend(-axis.dot(self.eye)));
            let x = 0.5 * FILM.x * (right + depth);
            let y = 0.5 * FILM.y * (depth - up);
            DMat4::from_cols(x, y, depth, depth).transpose()
        }
    }

    impl Camera for Pinhole {
        fn ray(&self, raster: DVec2) -> Ray {
            let [a, c] = (2.0 * raster / FILM - 1.0).to_array();
            let [right, up, forward] = self.axes;
            Ray::new(self.eye, (a * right - c * up + forward).normalize())
        }
    }

    fn geometry(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Geometry {
        Geometry::new(vec![LoweredShape::Triangles(TriangleMesh {
            positions,
            triangles,
            orientation: 1.0,
            ..TriangleMesh::default()
        })])
    }

    /// Random triangles around the camera, including behind it and across its plane.
    fn soup(random: &mut Random, count: u32) -> Geometry {
        let corner = |_| 3.0 * random.cube();
        let positions = (0..3 * count).map(corner).collect();
        geometry(
            positions,
            (0..count).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(),
        )
    }

    struct Stream {
        raster: Box<Lanes<DVec2>>,
        rays: Box<RayStream>,
    }

    impl Stream {
        fn of(camera: &dyn Camera) -> Self {
            let mut raster = Box::new([DVec2::ZERO; LANES]);
            let mut rays = Box::<RayStream>::default();
            rays.len = LANES;
            for (lane, raster) in raster.iter_mut().enumerate() {
                *raster = DVec2::new((lane % 16) as f64, (lane / 16) as f64) + 0.5;
                let ray = camera.ray(*raster);
                rays.origin.set(lane, ray.origin);
                rays.direction.set(lane, ray.direction);
            }
            Self { raster, rays }
        }

        /// The rasterized hits; `change` modifies the projected vertices.
        fn drawn(
            &self,
            geometry: &Geometry,
            to_image: &DMat4,
            change: impl Fn(DVec4) -> DVec4,
        ) -> Box<HitStream> {
            let mut projected = project(geometry, to_image);
            for vertex in projected.0.iter_mut().flatten() {
                *vertex = change(*vertex);
            }
            let mut depths = Depths::new(&self.raster, &self.rays, to_image);
            let LoweredShape::Triangles(mesh) = &geometry.shapes()[0] else {
                unreachable!()
            };
            let triangles: Vec<(u32, u32)> = (0..mesh.triangles.len() as u32).map(|k| (0, k)).collect();
            depths.draw(geometry.shapes(), &projected, FILM, &triangles);
            depths.hits(geometry, &self.rays)
        }

        /// The hits found by ray casting.
        fn cast(&self, geometry: &Geometry) -> Vec<Option<PreliminaryIntersection>> {
            let LoweredShape::Triangles(mesh) = &geometry.shapes()[0] else {
                unreachable!()
            };
            let mut hits = Box::<HitStream>::default();
            hits.clear(&self.rays);
            mesh.intersect_stream(0, &self.rays, &mut hits);
            (0..LANES).map(|lane| hits.get(lane)).collect()
        }
    }

    /// Number of pixels in random scenes where rasterization with changed vertices differs from ray
    /// casting.
    fn differences(scenes: u64, change: impl Fn(DVec4) -> DVec4 + Copy) -> usize {
        let mut count = 0;
        for seed in 0..scenes {
            let mut random = Random::new(seed);
            let camera = Pinhole::random(&mut random);
            let geometry = soup(&mut random, 1 + (seed % 40) as u32);
            let stream = Stream::of(&camera);
            let drawn = stream.drawn(&geometry, &camera.to_image(), change);
            let cast = stream.cast(&geometry);
            count += (0..LANES).filter(|lane| drawn.get(*lane) != cast[*lane]).count();
        }
        count
    }

    const SCENES: u64 = if cfg!(debug_assertions) { 200 } else { 4_000 };

    #[test]
    fn what_is_drawn_is_what_rays_meet_to_the_bit() {
        assert_eq!(differences(SCENES, |vertex| vertex), 0);
    }

    /// The test is not vacuous. Dividing vertices before clipping against the camera plane mirrors
    /// them, and interpolating depth without perspective puts the wrong triangle in front.
    #[test]
    fn divided_vertices_differ_from_rays() {
        let divided = |v: DVec4| DVec4::new(v.x / v.w, v.y / v.w, v.z, 1.0);
        assert!(differences(50, divided) > 1_000, "{}", differences(50, divided));
        // They also differ if everything is in front of the camera: two large triangles intersect
        // away from the middle of their edges.
        let camera = Pinhole {
            eye: DVec3::ZERO,
            axes: [DVec3::X, DVec3::Y, DVec3::NEG_Z],
        };
        let at = |x: f64, y: f64, depth: f64| DVec3::new(x, y, -1.0) * depth;
        let corners = vec![
            at(-1.5, -1.2, 1.0),
            at(1.5, -1.2, 10.0),
            at(0.0, 1.7, 3.0),
            at(-1.5, -1.3, 3.0),
            at(1.5, -1.3, 3.0),
            at(0.0, 1.8, 3.1),
        ];
        let geometry = geometry(corners, vec![[0, 1, 2], [3, 4, 5]]);
        let stream = Stream::of(&camera);
        let cast = stream.cast(&geometry);
        let count = |hits: &HitStream| (0..LANES).filter(|lane| hits.get(*lane) != cast[*lane]).count();
        assert_eq!(
            count(&stream.drawn(&geometry, &camera.to_image(), |vertex| vertex)),
            0
        );
        assert!(count(&stream.drawn(&geometry, &camera.to_image(), divided)) > 10);
    }

    /// Parallel rays: edges run exactly through pixel centres, and every pixel belongs to one
    /// triangle.
    #[test]
    fn pixels_on_a_shared_edge_belong_to_one_triangle() {
        let to_image = DMat4::from_cols(DVec4::X, DVec4::Y, DVec4::Z, DVec4::W);
        // Around (8.5, 8.5): horizontal, vertical and diagonal edges, and the border of a square.
        let rim = [
            [2.5, 2.5],
            [8.5, 2.5],
            [14.5, 2.5],
            [14.5, 8.5],
            [14.5, 14.5],
            [8.5, 14.5],
            [2.5, 14.5],
            [2.5, 8.5],
        ];
        let mut positions: Vec<DVec3> = rim.iter().map(|[x, y]| DVec3::new(*x, *y, 1.0)).collect();
        positions.push(DVec3::new(8.5, 8.5, 1.0));
        for reversed in [false, true] {
            let mut owners = [0; LANES];
            for k in 0..8 {
                let (a, b) = (k, (k + 1) % 8);
                let triangle = if reversed { [8, b, a] } else { [8, a, b] };
                let geometry = geometry(positions.clone(), vec![triangle]);
                let projected = project(&geometry, &to_image);
                let LoweredShape::Triangles(mesh) = &geometry.shapes()[0] else {
                    unreachable!()
                };
                let filled = TriangleSetup::new(projected.corners(mesh, 0, 0)).unwrap();
                for (lane, owners) in owners.iter_mut().enumerate() {
                    let found = filled.at((lane % 16) as f64 + 0.5, (lane / 16) as f64 + 0.5);
                    *owners += u32::from(!found.x.is_nan());
                }
            }
            for (lane, owners) in owners.into_iter().enumerate() {
                let (x, y) = (lane % 16, lane / 16);
                // The left and upper border of the square is inside, the right and lower one
                // outside.
                let inside = (2..14).contains(&x) && (2..14).contains(&y);
                assert_eq!(owners, u32::from(inside), "{x} {y}");
            }
        }
    }

    #[test]
    fn outlines_hold_what_is_seen_and_leave_out_what_is_behind() {
        let behind = [DVec4::new(1.0, 1.0, -1.0, -1.0); 3];
        assert_eq!(outline(behind, FILM), None);
        let beside = [-3.0, -4.0, -5.0].map(|x| DVec4::new(x, 2.0, 1.0, 1.0));
        assert_eq!(outline(beside, FILM), None);
        let at_the_camera = [
            DVec4::ZERO,
            DVec4::new(4.0, 4.0, 1.0, 1.0),
            DVec4::new(4.0, 5.0, 1.0, 1.0),
        ];
        assert_eq!(outline(at_the_camera, FILM), Some([DVec2::ZERO, FILM]));
        let through = [
            DVec4::new(8.0, 8.0, 1.0, 1.0),
            DVec4::new(9.0, 8.0, 1.0, 1.0),
            DVec4::new(-8.0, -80.0, -1.0, -1.0),
        ];
        let [low, high] = outline(through, FILM).unwrap();
        // It extends to the top of the image. With a division before clipping, its third corner
        // would be far down.
        assert!(low.y == 0.0 && high.y < 10.0 && low.x < 8.0, "{low} {high}");
    }
}
