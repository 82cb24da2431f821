//! The samples of a pixel: their positions, their camera rays and their radiance.

use crate::Pipeline;
use std::ops::Range;
use whitstone_core::stream::{Colors, HitStream, LANES, Lanes, Optional, RayStream, SurfaceStream};
use whitstone_core::{DVec2, Ray, RayDifferential, Rgb, Scene, Scratch, TooLarge, TreeLimits};

/// Working memory for the samples of as many pixels as a stream has lanes.
#[derive(Default)]
pub(crate) struct SampleMemory {
    /// The time at which they are seen; see [`Pipeline::moment`].
    pub moment: u32,
    pub scratch: Scratch,
    pub rays: Box<RayStream>,
    /// The offset camera rays, for ray differentials.
    neighbours: Optional<[RayStream; 2]>,
    pub raster: Box<Raster>,
    radiance: Box<Colors>,
    pub hits: Box<HitStream>,
    /// The surfaces at the hits, for layers.
    pub points: Box<SurfaceStream>,
}

impl SampleMemory {
    /// Working memory for trees within these limits, at this time.
    pub(crate) fn new(limits: TreeLimits, moment: u32) -> Self {
        Self {
            moment,
            scratch: Scratch::within(limits),
            ..Self::default()
        }
    }

    /// A tree that exceeded its limits, and its pixel.
    pub(crate) fn too_large(&self, pixels: &[[u32; 2]]) -> Option<([u32; 2], TooLarge)> {
        let tree = self.scratch.too_large?;
        Some((*pixels.get(tree.lane)?, tree))
    }
}

/// Raster coordinates of the lanes, in pixels.
pub(crate) struct Raster(pub Lanes<DVec2>);

impl Default for Raster {
    fn default() -> Self {
        Self([DVec2::ZERO; LANES])
    }
}

/// The corner of a pixel with the smallest raster coordinates.
pub(crate) fn pixel_corner(pixel: [u32; 2]) -> DVec2 {
    DVec2::new(f64::from(pixel[0]), f64::from(pixel[1]))
}

impl Pipeline {
    /// Radiance at some positions of some pixels (at most as many as a stream has lanes), through
    /// each point of the lens. Reports the values lane by lane, one sample after another.
    #[inline]
    pub(crate) fn sample(
        &self,
        pixels: &[[u32; 2]],
        positions: Range<u32>,
        memory: &mut SampleMemory,
        mut tell: impl FnMut(usize, Rgb),
    ) {
        let SampleMemory {
            moment,
            scratch,
            rays,
            neighbours,
            raster,
            radiance,
            ..
        } = memory;
        let (scene, object_order) = self.moment(*moment);
        let lens = self.camera.lens_points();
        rays.len = pixels.len();
        for sample in positions.start * lens..positions.end * lens {
            self.sampler.raster_stream(pixels, sample / lens, &mut raster.0);
            self.camera.lens_stream(&raster.0, sample % lens, rays);
            if let Some(scale) = self.sample_distance() {
                rays.differential_from_camera(&*self.camera, &raster.0, sample % lens, scale, neighbours);
            }
            match object_order {
                None => self.integrator.radiance_stream(scene, rays, scratch, radiance),
                Some(objects) => objects.radiance_stream(scene, &raster.0, rays, scratch, radiance),
            }
            for lane in 0..pixels.len() {
                tell(lane, radiance.get(lane));
            }
            if scratch.too_large.is_some() {
                return;
            }
        }
    }

    /// Whether the only sample of each of these pixels is the ray of its layers, through its
    /// centre.
    pub(crate) fn samples_are_centers(&self, pixels: &[[u32; 2]]) -> bool {
        let center = |pixel: &[u32; 2]| self.sampler.position(*pixel, 0) == DVec2::splat(0.5);
        self.samples() == 1
            && self.sampler.refinement().is_none()
            && self.object_order.is_none()
            && pixels.iter().all(center)
    }

    /// Radiance through the centres of some pixels at the first time, from `memory.rays` and their
    /// hits, which [`Self::trace_centers`] has found.
    pub(crate) fn shade_centers(&self, memory: &mut SampleMemory, mut tell: impl FnMut(usize, Rgb)) {
        let SampleMemory {
            scratch,
            rays,
            neighbours,
            raster,
            radiance,
            hits,
            ..
        } = memory;
        if let Some(scale) = self.sample_distance() {
            rays.differential_from_camera(&*self.camera, &raster.0, 0, scale, neighbours);
        }
        self.integrator
            .shade_stream(&self.scene, rays, hits, scratch, radiance);
        for lane in 0..rays.len {
            tell(lane, radiance.get(lane));
        }
    }

    /// Finds the nearest hits through the centres of some pixels at the first time.
    pub(crate) fn trace_centers(&self, pixels: &[[u32; 2]], memory: &mut SampleMemory) {
        let SampleMemory {
            rays, raster, hits, ..
        } = memory;
        for (raster, pixel) in raster.0.iter_mut().zip(pixels) {
            *raster = pixel_corner(*pixel) + 0.5;
        }
        rays.len = pixels.len();
        self.camera.ray_stream(&raster.0, rays);
        self.scene.accelerator.intersect_stream(rays, hits);
    }

    /// Maximum number of samples per pixel: each position of the sampler, through each point of the
    /// camera's lens, at each time of the film. Samples of one time are consecutive, and within it
    /// those of one position.
    pub fn samples(&self) -> u32 {
        self.moments() * self.moment_samples()
    }

    /// Maximum number of samples per pixel at one time.
    pub(crate) fn moment_samples(&self) -> u32 {
        self.sampler.count() * self.camera.lens_points()
    }

    /// The scene that a sample sees.
    pub fn scene_of(&self, sample: u32) -> &Scene {
        self.moment(sample / self.moment_samples()).0
    }

    /// The raster coordinates of a sampler position.
    fn raster(&self, pixel: [u32; 2], position: u32) -> DVec2 {
        pixel_corner(pixel) + self.sampler.position(pixel, position)
    }

    /// Distance of the samples in pixels, as if they lay on a grid; `None` if no texture needs it.
    fn sample_distance(&self) -> Option<f64> {
        let refined = || self.sampler.refinement().map(|rule| rule.initial_samples);
        let count = || f64::from(refined().unwrap_or_else(|| self.sampler.count()));
        self.scene.reads_footprints().then(|| 1.0 / count().sqrt())
    }

    /// Ray differential of a camera ray to its neighbouring samples, if any texture needs it.
    pub fn camera_differential(&self, pixel: [u32; 2], sample: u32) -> Option<RayDifferential> {
        let (lens, sample) = (self.camera.lens_points(), sample % self.moment_samples());
        let raster = self.raster(pixel, sample / lens);
        let scale = self.sample_distance()?;
        Some(RayDifferential::of_camera(
            &*self.camera,
            raster,
            sample % lens,
            scale,
        ))
    }

    /// The camera ray of a sample of a pixel.
    pub fn camera_ray(&self, pixel: [u32; 2], sample: u32) -> Ray {
        let (lens, sample) = (self.camera.lens_points(), sample % self.moment_samples());
        let raster = self.raster(pixel, sample / lens);
        self.camera.lens_ray(raster, sample % lens)
    }

    /// The radiance of a single sample of a pixel.
    pub(crate) fn radiance_of(&self, pixel: [u32; 2], sample: u32, scratch: &mut Scratch) -> Rgb {
        scratch.differential = self.camera_differential(pixel, sample);
        self.integrator
            .radiance(self.scene_of(sample), &self.camera_ray(pixel, sample), scratch)
    }
}
