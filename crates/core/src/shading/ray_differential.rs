//! Ray differentials and footprints, for texture filtering.
//!
//! Igehy, *Tracing ray differentials*, SIGGRAPH 1999. Equations 9 to 17 (reflection and refraction)
//! are not implemented per material. Instead, the material computes the specular rays of a
//! neighbouring ray, offset by [`STEP`], and the camera its ray: every material and camera has
//! differentials without extra code. They only affect filtering: single precision is enough, and no
//! ray changes direction.

use crate::simd::{self, select};
use crate::stream::{LANES, Lanes, Optional, RayStream};
use crate::{
    Camera, Geometry, MediumStack, PathLetter, PreliminaryIntersection, Ray, Scene, SpecularRays,
    SurfaceAttributes, SurfaceInteraction,
};
use glam::{DVec2, DVec3, Vec2, Vec3};

/// Step of the forward differences, relative to the distance to the next sample: a power of 2. The
/// truncation error is of the order of the step times the curvature; at 1/256 it was ten times the
/// other errors of an image. The rounding error is 2^-36 of a coordinate, in sample distances.
pub const STEP: f64 = 1.0 / (1 << 17) as f64;

/// Lower bound on the cosine between ray and normal: limits how far a footprint is stretched.
const GRAZING: f64 = 1.0 / (1 << 20) as f64;

/// Upper bound on the differential of a specular ray's direction, in radians per sample. At the
/// critical angle it would be unbounded.
const WIDEST: f64 = 1.0;

/// The ray differentials: first derivatives of a ray towards the next sample to the right and the
/// next sample below, scaled to the sample distance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RayDifferential {
    /// Derivatives of the origin, in metres.
    pub origin: [Vec3; 2],
    /// Derivatives of the unit direction.
    pub direction: [Vec3; 2],
}

/// The offsets from a hit to the hits of the two neighbouring rays on the surface. Zero if unknown:
/// textures then use their finest level.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Footprint {
    /// In metres, in the tangent plane.
    pub position: [Vec3; 2],
    /// In texture coordinates.
    pub uv: [Vec2; 2],
}

impl Footprint {
    /// A point, or unknown.
    pub const NONE: Self = Self {
        position: [Vec3::ZERO; 2],
        uv: [Vec2::ZERO; 2],
    };
}

// The code for both neighbours is written out below: mapping over arrays compiles to calls, which
// cost more than the work they do.

/// The derivative from two values that are [`STEP`] apart.
#[inline(always)]
fn slope(here: DVec3, neighbour: DVec3, scale: f64) -> Vec3 {
    ((neighbour - here) * (scale / STEP)).as_vec3()
}

/// The differentials of a camera ray from its two neighbours.
#[inline(always)]
fn between(ray: &Ray, right: &Ray, below: &Ray, scale: f64) -> RayDifferential {
    RayDifferential {
        origin: [
            slope(ray.origin, right.origin, scale),
            slope(ray.origin, below.origin, scale),
        ],
        direction: [
            slope(ray.direction, right.direction, scale),
            slope(ray.direction, below.direction, scale),
        ],
    }
}

impl RayDifferential {
    /// The differentials of the camera ray through `raster` from a lens point; neighbours are
    /// `scale` pixels away.
    pub fn of_camera(camera: &dyn Camera, raster: DVec2, point: u32, scale: f64) -> Self {
        let at = |raster| camera.lens_ray(raster, point);
        let (right, below) = (at(raster + DVec2::X * STEP), at(raster + DVec2::Y * STEP));
        between(&at(raster), &right, &below, scale)
    }

    /// The offsets of the neighbours in the plane across `normal` at parameter `t` of the ray, in
    /// metres (equations 10 to 12). They are stretched by at most 1/`GRAZING`.
    #[inline]
    pub fn meet(&self, ray: &Ray, t: f64, normal: DVec3) -> [DVec3; 2] {
        let cosine = ray.direction.dot(normal);
        let cosine = cosine.abs().max(GRAZING).copysign(cosine);
        let step = |side: usize| {
            let moved = self.origin[side].as_dvec3() + t * self.direction[side].as_dvec3();
            moved - (moved.dot(normal) / cosine) * ray.direction
        };
        [step(0), step(1)]
    }

    /// The footprint at the hit of a ray; texture coordinates only if `needs` contains them.
    pub fn footprint(
        &self,
        geometry: &Geometry,
        ray: &Ray,
        hit: &PreliminaryIntersection,
        point: &SurfaceInteraction,
        needs: SurfaceAttributes,
    ) -> Footprint {
        let [right, below] = self.meet(ray, hit.t, point.n_g);
        let uv = |step: DVec3| {
            let neighbour =
                geometry.surface_at_offset(point, hit, point.position + STEP * step, SurfaceAttributes::UV);
            neighbour.map_or(Vec2::ZERO, |neighbour| {
                ((neighbour.uv - point.uv) / STEP).as_vec2()
            })
        };
        Footprint {
            uv: if needs.contains(SurfaceAttributes::UV) {
                [uv(right), uv(below)]
            } else {
                [Vec2::ZERO; 2]
            },
            position: [right.as_vec3(), below.as_vec3()],
        }
    }
}

impl Scene {
    /// The differentials of a specular ray in unit direction `direction`, found by applying the
    /// material to the neighbours of the ray. `point` is after rule S. Surfaces without derivatives
    /// count as flat. `inside` is the set of bodies that the ray is in.
    #[allow(
        clippy::too_many_arguments,
        reason = "everything that a specular ray depends on"
    )]
    pub fn differential_of_branch(
        &self,
        differential: &RayDifferential,
        ray: &Ray,
        hit: &PreliminaryIntersection,
        point: &SurfaceInteraction,
        (letter, direction): (PathLetter, DVec3),
        inside: MediumStack,
    ) -> RayDifferential {
        let position = differential.meet(ray, hit.t, point.n_g);
        let turned = [0, 1].map(|side| {
            let mut neighbour = *point;
            neighbour.position += STEP * position[side];
            let there =
                self.geometry
                    .surface_at_offset(point, hit, neighbour.position, self.needs_of(hit.shape));
            if let Some(there) = there {
                neighbour.uv = there.uv;
                // Rule S has been applied to `point`, but not to `there`.
                let same = there.n_s.dot(point.n_s) >= 0.0;
                neighbour.n_s = select(same, 1.0, -1.0) * there.n_s;
            }
            let view = -(ray.direction + STEP * differential.direction[side].as_dvec3()).normalize();
            let mut branches = SpecularRays::default();
            self.specular_rays(hit.shape, inside, &neighbour, view, &mut branches);
            // Beyond the critical angle the neighbour has no such ray: use the differential of
            // the ray.
            let found = branches
                .iter()
                .find(|branch| PathLetter::from(branch.kind) == letter);
            let change = found.map_or(differential.direction[side].as_dvec3(), |branch| {
                (branch.direction - direction) / STEP
            });
            let length = change.length();
            let change = if length <= WIDEST {
                change
            } else {
                change * (WIDEST / length)
            };
            if change.is_finite() { change } else { DVec3::ZERO }
        });
        RayDifferential {
            origin: position.map(|step| step.as_vec3()),
            direction: turned.map(|change| change.as_vec3()),
        }
    }
}

/// Columns of single-precision numbers: one for each component.
#[derive(Clone)]
#[repr(align(64))]
pub struct Rows<const N: usize>([Lanes<f32>; N]);

impl<const N: usize> Default for Rows<N> {
    fn default() -> Self {
        Self([[0.0; LANES]; N])
    }
}

impl<const N: usize> Rows<N> {
    #[inline(always)]
    fn vector(&self, row: usize, lane: usize) -> Vec3 {
        Vec3::new(self.0[row][lane], self.0[row + 1][lane], self.0[row + 2][lane])
    }

    #[inline(always)]
    fn put(&mut self, row: usize, lane: usize, value: Vec3) {
        self.0[row][lane] = value.x;
        self.0[row + 1][lane] = value.y;
        self.0[row + 2][lane] = value.z;
    }

    /// See [`crate::stream::Vectors::gather`].
    pub(crate) fn gather(&mut self, start: usize, from: &Self, lanes: &[u16]) {
        for (to, from) in self.0.iter_mut().zip(&from.0) {
            crate::stream::gather(to, start, from, lanes);
        }
    }
}

/// The ray differentials of a stream of rays.
pub type RayDifferentialStream = Rows<12>;

/// The footprints of a stream of points.
pub type FootprintStream = Rows<10>;

impl RayDifferentialStream {
    /// The differentials of a lane.
    #[inline(always)]
    pub fn get(&self, lane: usize) -> RayDifferential {
        RayDifferential {
            origin: [self.vector(0, lane), self.vector(3, lane)],
            direction: [self.vector(6, lane), self.vector(9, lane)],
        }
    }

    /// Replaces the differentials of a lane.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, differential: &RayDifferential) {
        self.put(0, lane, differential.origin[0]);
        self.put(3, lane, differential.origin[1]);
        self.put(6, lane, differential.direction[0]);
        self.put(9, lane, differential.direction[1]);
    }
}

impl FootprintStream {
    /// The footprint of a lane.
    #[inline(always)]
    pub fn get(&self, lane: usize) -> Footprint {
        Footprint {
            position: [self.vector(0, lane), self.vector(3, lane)],
            uv: [
                Vec2::new(self.0[6][lane], self.0[7][lane]),
                Vec2::new(self.0[8][lane], self.0[9][lane]),
            ],
        }
    }

    /// Replaces the footprint of a lane.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, footprint: &Footprint) {
        self.put(0, lane, footprint.position[0]);
        self.put(3, lane, footprint.position[1]);
        let [right, below] = footprint.uv;
        for (row, value) in [right.x, right.y, below.x, below.y].into_iter().enumerate() {
            self.0[6 + row][lane] = value;
        }
    }
}

impl RayStream {
    /// [`RayDifferential::of_camera`] for every ray; the camera has generated the rays from these
    /// positions. `neighbours` is working memory.
    pub fn differential_from_camera(
        &mut self,
        camera: &dyn Camera,
        raster: &Lanes<DVec2>,
        point: u32,
        scale: f64,
        neighbours: &mut Optional<[RayStream; 2]>,
    ) {
        let [right, below] = neighbours.turn_on();
        let mut moved = *raster;
        for (axis, rays) in [(DVec2::X, &mut *right), (DVec2::Y, &mut *below)] {
            for (to, from) in moved.iter_mut().zip(raster).take(self.len) {
                *to = *from + axis * STEP;
            }
            rays.len = self.len;
            camera.lens_stream(&moved, point, rays);
        }
        let differentials = self.differential.turn_on();
        simd::dispatch(
            #[inline(always)]
            || {
                for lane in 0..self.len.min(LANES) {
                    let ray = Ray::new(self.origin.get(lane), self.direction.get(lane));
                    differentials.set(lane, &between(&ray, &right.ray(lane), &below.ray(lane), scale));
                }
            },
        );
    }
}
