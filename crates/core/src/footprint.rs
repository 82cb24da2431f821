//! How far apart neighbouring rays are, and what they see of a surface together: for textures that
//! are filtered.
//!
//! Igehy, *Tracing ray differentials*, SIGGRAPH 1999. Where a ray goes on, its equations 9 to 17
//! are not written out for each material: a material is asked again for the branches of a neighbour
//! that is nearer by [`STEP`], and a camera for its ray, so that whatever bends rays spreads them
//! too. All of it only filters: single precision is enough, and no ray goes elsewhere for it.

use crate::simd::{self, select};
use crate::stream::{LANES, Lanes, Optional, RayStream};
use crate::{Branches, Camera, Geometry, Inside, Needs, PathLetter, RawHit, Ray, SurfacePoint, World};
use glam::{DVec2, DVec3, Vec2, Vec3};

/// The step of the forward differences, as a part of the distance to the next sample: a power of 2.
/// Their truncation error is of the order of the step times the curvature; at 1/256 it was ten
/// times the error of the rest of an image. Their rounding error is 2^-36 of a coordinate, in
/// sample distances.
pub const STEP: f64 = 1.0 / (1 << 17) as f64;

/// The least cosine between a ray and the normal by which a footprint is prolonged.
const GRAZING: f64 = 1.0 / (1 << 20) as f64;

/// The most that a branch may spread, in radians a sample: at the critical angle there would be no
/// bound.
const WIDEST: f64 = 1.0;

/// How the rays of the next sample to the right and of the next one below lie beside a ray: first
/// derivatives, scaled to the distance of samples.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spread {
    /// Of the origins, in metres.
    pub origin: [Vec3; 2],
    /// Of the unit directions.
    pub direction: [Vec3; 2],
}

/// What a ray and its neighbours see of a surface: how far the neighbours' points are. Zero where
/// it is not known, so that textures show their finest level.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Footprint {
    /// In metres, in the tangent plane.
    pub position: [Vec3; 2],
    /// In texture coordinates.
    pub uv: [Vec2; 2],
}

impl Footprint {
    /// A point, or not known.
    pub const NONE: Self = Self {
        position: [Vec3::ZERO; 2],
        uv: [Vec2::ZERO; 2],
    };
}

// Pairs are written out below: arrays that are mapped become calls, which take longer than what is
// called.

/// The derivative from values that are [`STEP`] apart.
#[inline(always)]
fn slope(here: DVec3, beside: DVec3, scale: f64) -> Vec3 {
    ((beside - here) * (scale / STEP)).as_vec3()
}

/// The spread of a camera ray whose neighbours are these.
#[inline(always)]
fn between(ray: &Ray, right: &Ray, below: &Ray, scale: f64) -> Spread {
    Spread {
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

impl Spread {
    /// Of the camera ray through `raster` from a point of the lens, whose neighbours are `scale`
    /// pixels away.
    pub fn of_camera(camera: &dyn Camera, raster: DVec2, point: u32, scale: f64) -> Self {
        let at = |raster| camera.lens_ray(raster, point);
        let (right, below) = (at(raster + DVec2::X * STEP), at(raster + DVec2::Y * STEP));
        between(&at(raster), &right, &below, scale)
    }

    /// How far the neighbours are in the plane across `normal` at the point `t` of the ray, in
    /// metres (equations 10 to 12): prolonged by no more than the reciprocal of `GRAZING`.
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

    /// What is seen at the hit of a ray; texture coordinates only where `needs` names them.
    pub fn footprint(
        &self,
        geometry: &Geometry,
        ray: &Ray,
        hit: &RawHit,
        point: &SurfacePoint,
        needs: Needs,
    ) -> Footprint {
        let [right, below] = self.meet(ray, hit.t, point.n_g);
        let uv = |step: DVec3| {
            let beside = geometry.beside(point, hit, point.position + STEP * step, Needs::UV);
            beside.map_or(Vec2::ZERO, |beside| ((beside.uv - point.uv) / STEP).as_vec2())
        };
        Footprint {
            uv: if needs.contains(Needs::UV) {
                [uv(right), uv(below)]
            } else {
                [Vec2::ZERO; 2]
            },
            position: [right.as_vec3(), below.as_vec3()],
        }
    }
}

impl World {
    /// How a branch in unit direction `direction` spreads at a point as it is seen by its ray: by
    /// what the same material does to the neighbours of the ray. Surfaces that do not tell how they
    /// go on count as flat. `inside` are the bodies that the ray is in.
    #[allow(clippy::too_many_arguments, reason = "all that a branch depends on")]
    pub fn spread_of_branch(
        &self,
        spread: &Spread,
        ray: &Ray,
        hit: &RawHit,
        point: &SurfacePoint,
        (letter, direction): (PathLetter, DVec3),
        inside: Inside,
    ) -> Spread {
        let position = spread.meet(ray, hit.t, point.n_g);
        let turned = [0, 1].map(|side| {
            let mut beside = *point;
            beside.position += STEP * position[side];
            let there = self
                .geometry
                .beside(point, hit, beside.position, self.needs_of(hit.shape));
            if let Some(there) = there {
                beside.uv = there.uv;
                // Rule S has been applied to the point, not to what is beside it.
                let same = there.n_s.dot(point.n_s) >= 0.0;
                beside.n_s = select(same, 1.0, -1.0) * there.n_s;
            }
            let view = -(ray.direction + STEP * spread.direction[side].as_dvec3()).normalize();
            let mut branches = Branches::default();
            self.branches(hit.shape, inside, &beside, view, &mut branches);
            // Beyond the critical angle there is none: then as if the ray went straight on.
            let found = branches
                .iter()
                .find(|branch| PathLetter::from(branch.kind) == letter);
            let change = found.map_or(spread.direction[side].as_dvec3(), |branch| {
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
        Spread {
            origin: position.map(|step| step.as_vec3()),
            direction: turned.map(|change| change.as_vec3()),
        }
    }
}

/// Numbers in single precision side by side: a row for each component.
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

    /// As [`crate::stream::Vectors::gather`].
    pub(crate) fn gather(&mut self, start: usize, from: &Self, lanes: &[u16]) {
        for (to, from) in self.0.iter_mut().zip(&from.0) {
            crate::stream::gather(to, start, from, lanes);
        }
    }
}

/// The spreads of the rays of a stream.
pub type SpreadStream = Rows<12>;

/// The footprints of the points of a stream.
pub type FootprintStream = Rows<10>;

impl SpreadStream {
    /// The spread of a lane.
    #[inline(always)]
    pub fn get(&self, lane: usize) -> Spread {
        Spread {
            origin: [self.vector(0, lane), self.vector(3, lane)],
            direction: [self.vector(6, lane), self.vector(9, lane)],
        }
    }

    /// Replaces the spread of a lane.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, spread: &Spread) {
        self.put(0, lane, spread.origin[0]);
        self.put(3, lane, spread.origin[1]);
        self.put(6, lane, spread.direction[0]);
        self.put(9, lane, spread.direction[1]);
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
    /// [`Spread::of_camera`] of every ray, which a camera has given for these positions. `beside`
    /// is working memory.
    pub fn spread_from_camera(
        &mut self,
        camera: &dyn Camera,
        raster: &Lanes<DVec2>,
        point: u32,
        scale: f64,
        beside: &mut Optional<[RayStream; 2]>,
    ) {
        let [right, below] = beside.turn_on();
        let mut moved = *raster;
        for (axis, rays) in [(DVec2::X, &mut *right), (DVec2::Y, &mut *below)] {
            for (to, from) in moved.iter_mut().zip(raster).take(self.len) {
                *to = *from + axis * STEP;
            }
            rays.len = self.len;
            camera.lens_stream(&moved, point, rays);
        }
        let spreads = self.spread.turn_on();
        simd::dispatch(
            #[inline(always)]
            || {
                for lane in 0..self.len.min(LANES) {
                    let ray = Ray::new(self.origin.get(lane), self.direction.get(lane));
                    spreads.set(lane, &between(&ray, &right.ray(lane), &below.ray(lane), scale));
                }
            },
        );
    }
}
