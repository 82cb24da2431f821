use crate::adaptive::Adaptive;
use crate::{Aov, Pipeline};
use std::ops::Range;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;
use whitstone_core::stream::{Colors, HitStream, LANES, Lanes, Optional, RayStream};
use whitstone_core::{
    Counters, DVec2, PreliminaryIntersection, Ray, RayDifferential, Rgb, Scratch, SurfaceAttributes,
};
use whitstone_image::{Image, ImageError};

/// Side of the square tiles that are distributed to threads, in pixels.
const TILE: u32 = 16;
const _: () = assert!((TILE * TILE) as usize <= LANES);

/// Side of the squares within a tile, in pixels.
const SQUARE: u32 = 4;

/// A rendered image.
pub struct Film {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Radiance in W/(m² sr), linear Rec. 709, row by row from the top.
    pub rgb: Vec<[f32; 3]>,
    /// Layers by EXR channel name, each `width * height` values in the same order.
    pub layers: Vec<(String, Vec<f32>)>,
    /// Samples per pixel.
    pub samples: u32,
    /// Rays traced for the radiance.
    pub counters: Counters,
    /// Wall time of the rendering in seconds.
    pub render_seconds: f64,
}

/// Called with the number of finished pixels and the total, from any thread.
pub type Progress<'a> = &'a (dyn Fn(u64, u64) + Sync);

/// Options of the rendering. They do not affect the image.
#[derive(Clone, Copy, Default)]
pub struct RenderOptions<'a> {
    /// Threads; 0 means one per core.
    pub threads: usize,
    /// Called after each tile.
    pub progress: Option<Progress<'a>>,
}

struct Tile {
    x: u32,
    y: u32,
    width: u32,
    height: u32,
}

impl Tile {
    /// The pixels relative to the tile's corner, ordered in small squares, so that the rays of one
    /// register stay close together.
    fn order(&self, order: &mut Vec<[u32; 2]>) {
        let square = |k: u32| [k % (TILE / SQUARE) * SQUARE, k / (TILE / SQUARE) * SQUARE];
        let squares = (0..(TILE / SQUARE).pow(2)).map(square);
        let all =
            squares.flat_map(|[x, y]| (0..SQUARE * SQUARE).map(move |k| [x + k % SQUARE, y + k / SQUARE]));
        order.clear();
        order.extend(all.filter(|[x, y]| *x < self.width && *y < self.height));
    }
}

/// Working memory of one thread, and the tile that it rendered last.
#[derive(Default)]
struct TileScratch {
    /// The pixels relative to the tile's corner, in the order of the lanes.
    order: Vec<[u32; 2]>,
    /// The tile size for which `order` was computed.
    ordered: [u32; 2],
    /// The pixels of the image, in the same order.
    pixels: Vec<[u32; 2]>,
    rgb: Vec<[f32; 3]>,
    /// All channels of the first pixel, then those of the next one.
    layers: Vec<f32>,
    memory: SampleMemory,
}

/// Working memory for the samples of as many pixels as a stream has lanes.
#[derive(Default)]
pub(crate) struct SampleMemory {
    pub scratch: Scratch,
    rays: Box<RayStream>,
    /// The offset camera rays, for ray differentials.
    neighbours: Optional<[RayStream; 2]>,
    raster: Box<Raster>,
    radiance: Box<Colors>,
    hits: Box<HitStream>,
}

struct Raster(Lanes<DVec2>);

impl Default for Raster {
    fn default() -> Self {
        Self([DVec2::ZERO; LANES])
    }
}

impl TileScratch {
    /// Sets the pixels to those of a tile.
    fn enter(&mut self, tile: &Tile) {
        let size = [tile.width, tile.height];
        if self.ordered != size {
            tile.order(&mut self.order);
            self.ordered = size;
        }
        self.pixels.clear();
        self.pixels
            .extend(self.order.iter().map(|[x, y]| [tile.x + x, tile.y + y]));
    }

    /// Writes the pixels and counters since the last call to the film.
    fn write(&mut self, film: &mut Film) {
        film.counters
            .add(std::mem::take(&mut self.memory.scratch.counters));
        let channels = film.layers.len();
        for (lane, [x, y]) in self.pixels.iter().enumerate() {
            let place = *y as usize * film.width as usize + *x as usize;
            // None if the pixel is not finished.
            if let Some(rgb) = self.rgb.get(lane) {
                film.rgb[place] = *rgb;
            }
            for (channel, (_, layer)) in film.layers.iter_mut().enumerate() {
                layer[place] = self.layers[lane * channels + channel];
            }
        }
    }
}

fn pixel_corner(pixel: [u32; 2]) -> DVec2 {
    DVec2::new(f64::from(pixel[0]), f64::from(pixel[1]))
}

impl Aov {
    /// EXR channels of the layer.
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            Self::Depth => &["depth.Z"],
            Self::Normal => &["normal.X", "normal.Y", "normal.Z"],
            Self::Uv => &["uv.U", "uv.V"],
            Self::ShapeId => &["shape_id.I"],
            Self::PrimitiveId => &["primitive_id.I"],
        }
    }

    fn needs(self) -> SurfaceAttributes {
        match self {
            Self::Normal => SurfaceAttributes::SHADING_NORMAL,
            Self::Uv => SurfaceAttributes::UV,
            Self::Depth | Self::ShapeId | Self::PrimitiveId => SurfaceAttributes::NOTHING,
        }
    }
}

impl Pipeline {
    /// Renders the image. The result does not depend on the number of threads, because a pixel
    /// depends only on the scene.
    pub fn render(&self, options: RenderOptions<'_>) -> Film {
        if options.threads == 0 {
            return self.render_on_current_pool(options.progress);
        }
        match rayon::ThreadPoolBuilder::new()
            .num_threads(options.threads)
            .build()
        {
            Ok(pool) => pool.install(|| self.render_on_current_pool(options.progress)),
            // Threads only affect the speed, so the existing ones are used instead.
            Err(_) => self.render_on_current_pool(options.progress),
        }
    }

    fn render_on_current_pool(&self, progress: Option<Progress<'_>>) -> Film {
        let start = Instant::now();
        let size = self.film.size;
        let total = u64::from(size.width) * u64::from(size.height);
        let done = AtomicU64::new(0);
        let tiles: Vec<Tile> = (0..size.height.div_ceil(TILE))
            .flat_map(|row| (0..size.width.div_ceil(TILE)).map(move |column| (column * TILE, row * TILE)))
            .map(|(x, y)| Tile {
                x,
                y,
                width: TILE.min(size.width - x),
                height: TILE.min(size.height - y),
            })
            .collect();
        let film = Mutex::new(Film {
            width: size.width,
            height: size.height,
            rgb: vec![[0.0; 3]; total as usize],
            layers: self
                .film
                .aovs
                .iter()
                .flat_map(|aov| aov.channels())
                .map(|name| ((*name).to_owned(), vec![0.0; total as usize]))
                .collect(),
            samples: self.samples(),
            counters: Counters::default(),
            render_seconds: 0.0,
        });
        let adaptive = self.sampler.refinement().map(|rule| Adaptive::new(rule, size));
        let first = adaptive.as_ref().map_or(self.sampler.count(), Adaptive::first);
        // Each thread takes the next tile when it finishes one, because a fixed division of the
        // image would take unequal times.
        let next = AtomicUsize::new(0);
        rayon::broadcast(|_| {
            let mut scratch = TileScratch::default();
            while let Some(tile) = tiles.get(next.fetch_add(1, Ordering::Relaxed)) {
                self.render_tile(tile, first, adaptive.as_ref(), &mut scratch);
                scratch.write(&mut film.lock().unwrap_or_else(PoisonError::into_inner));
                let pixels = u64::from(tile.width) * u64::from(tile.height);
                let so_far = done.fetch_add(pixels, Ordering::Relaxed) + pixels;
                if let Some(progress) = progress
                    && adaptive.is_none()
                {
                    progress(so_far, total);
                }
            }
        });
        let mut film = film.into_inner().unwrap_or_else(PoisonError::into_inner);
        if let Some(adaptive) = adaptive {
            let mut scratch = TileScratch::default();
            let pixels = tiles.iter().flat_map(|tile| {
                scratch.enter(tile);
                scratch.pixels.clone()
            });
            adaptive.refine(self, pixels.collect(), &mut film, progress);
        }
        film.render_seconds = start.elapsed().as_secs_f64();
        film
    }

    /// Renders a tile with the first `positions` of each pixel.
    fn render_tile(
        &self,
        tile: &Tile,
        positions: u32,
        adaptive: Option<&Adaptive>,
        scratch: &mut TileScratch,
    ) {
        scratch.enter(tile);
        let TileScratch {
            pixels,
            rgb,
            layers,
            memory,
            ..
        } = scratch;
        rgb.clear();
        match adaptive {
            None => {
                let mut sums = [Rgb::BLACK; LANES];
                self.sample(pixels, 0..positions, memory, |lane, radiance| {
                    sums[lane] += radiance
                });
                let count = f64::from(positions * self.camera.lens_points());
                rgb.extend(sums[..pixels.len()].iter().map(|sum| {
                    let mean = *sum * (1.0 / count);
                    mean.to_array().map(|c| c as f32)
                }));
            }
            Some(adaptive) => adaptive.start(self, pixels, memory),
        }
        layers.clear();
        if self.film.aovs.is_empty() {
            return;
        }
        let SampleMemory {
            rays, raster, hits, ..
        } = memory;
        for (raster, pixel) in raster.0.iter_mut().zip(&*pixels) {
            *raster = pixel_corner(*pixel) + 0.5;
        }
        self.camera.ray_stream(&raster.0, rays);
        self.scene.accelerator.intersect_stream(rays, hits);
        for lane in 0..pixels.len() {
            let (ray, hit) = (rays.ray(lane), hits.get(lane));
            let near = self.camera.near(raster.0[lane]);
            for aov in &self.film.aovs {
                layers.extend(
                    self.layer_values(*aov, &ray, near, hit.as_ref())
                        .iter()
                        .map(|v| *v as f32),
                );
            }
        }
    }

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
            scratch,
            rays,
            neighbours,
            raster,
            radiance,
            ..
        } = memory;
        let lens = self.camera.lens_points();
        rays.len = pixels.len();
        for sample in positions.start * lens..positions.end * lens {
            for (raster, pixel) in raster.0.iter_mut().zip(pixels) {
                *raster = self.raster(*pixel, sample / lens);
            }
            self.camera.lens_stream(&raster.0, sample % lens, rays);
            if let Some(scale) = self.sample_distance() {
                rays.differential_from_camera(&*self.camera, &raster.0, sample % lens, scale, neighbours);
            }
            match &self.object_order {
                None => self
                    .integrator
                    .radiance_stream(&self.scene, rays, scratch, radiance),
                Some(objects) => objects.radiance_stream(&self.scene, &raster.0, rays, scratch, radiance),
            }
            for lane in 0..pixels.len() {
                tell(lane, radiance.get(lane));
            }
        }
    }

    /// Maximum number of samples per pixel: each position of the sampler, through each point of the
    /// camera's lens. Samples of one position are consecutive.
    pub fn samples(&self) -> u32 {
        self.sampler.count() * self.camera.lens_points()
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
        let lens = self.camera.lens_points();
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
        let lens = self.camera.lens_points();
        let raster = self.raster(pixel, sample / lens);
        self.camera.lens_ray(raster, sample % lens)
    }

    /// The value of a single pixel, the mean of its samples. Equal to its value in the image.
    pub fn pixel(&self, pixel: [u32; 2], scratch: &mut Scratch) -> Rgb {
        if let Some(rule) = self.sampler.refinement() {
            return Adaptive::new(rule, self.film.size).pixel(self, pixel, scratch);
        }
        let count = self.samples();
        let sum: Rgb = (0..count)
            .map(|sample| self.radiance_of(pixel, sample, scratch))
            .sum();
        sum * (1.0 / f64::from(count))
    }

    /// The radiance of a single sample of a pixel.
    pub(crate) fn radiance_of(&self, pixel: [u32; 2], sample: u32, scratch: &mut Scratch) -> Rgb {
        scratch.differential = self.camera_differential(pixel, sample);
        self.integrator
            .radiance(&self.scene, &self.camera_ray(pixel, sample), scratch)
    }

    /// The values of a layer for a ray that starts at `near` in front of the camera.
    fn layer_values(
        &self,
        aov: Aov,
        ray: &Ray,
        near: f64,
        hit: Option<&PreliminaryIntersection>,
    ) -> Vec<f64> {
        let Some(hit) = hit else {
            return match aov {
                Aov::ShapeId | Aov::PrimitiveId => vec![-1.0],
                _ => vec![0.0; aov.channels().len()],
            };
        };
        let surface = || self.scene.geometry.surface(ray, hit, aov.needs());
        match aov {
            Aov::Depth => vec![near + hit.t],
            Aov::Normal => surface().n_s.to_array().to_vec(),
            Aov::Uv => surface().uv.to_array().to_vec(),
            Aov::ShapeId => vec![f64::from(hit.shape)],
            Aov::PrimitiveId => vec![f64::from(hit.primitive)],
        }
    }
}

impl Film {
    /// Number of pixels whose radiance the image cannot represent: it overflows `f32`, or is NaN.
    pub fn not_finite(&self) -> usize {
        let unfit = |rgb: &&[f32; 3]| !rgb.iter().all(|value| value.is_finite());
        self.rgb.iter().filter(unfit).count()
    }

    /// Converts to an image with all layers and provenance attributes.
    pub fn to_image(&self, scene_hash: &str) -> Result<Image, ImageError> {
        let mut image = Image::from_rgb(self.width as usize, self.height as usize, &self.rgb)?;
        for (name, values) in &self.layers {
            image.add_channel(name, values.clone())?;
        }
        image.set_attribute("scene_hash", scene_hash)?;
        image.set_attribute("samples", self.samples.to_string())?;
        image.set_attribute("version", env!("CARGO_PKG_VERSION"))?;
        Ok(image)
    }
}
