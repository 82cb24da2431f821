use crate::{Aov, Pipeline};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;
use whitstone_core::{Counters, DVec2, Interval, Needs, RawHit, Ray, Rgb, Scratch, Skip};
use whitstone_image::{Image, ImageError};

/// Edge length of the square tiles that threads share out, in pixels.
const TILE: u32 = 16;

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
    /// Samples a pixel.
    pub samples: u32,
    /// Rays traced for the radiance.
    pub counters: Counters,
    /// Wall time of the rendering.
    pub render_seconds: f64,
}

/// Told the number of pixels done and the number in all, from any thread.
pub type Progress<'a> = &'a (dyn Fn(u64, u64) + Sync);

/// How to render; what is rendered does not depend on it.
#[derive(Clone, Copy, Default)]
pub struct RenderOptions<'a> {
    /// Threads; 0 for one a core.
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

struct RenderedTile {
    rgb: Vec<[f32; 3]>,
    layers: Vec<Vec<f32>>,
    counters: Counters,
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

    fn needs(self) -> Needs {
        match self {
            Self::Normal => Needs::SHADING_NORMAL,
            Self::Uv => Needs::UV,
            Self::Depth | Self::ShapeId | Self::PrimitiveId => Needs::NOTHING,
        }
    }
}

impl Pipeline {
    /// Renders the image. The result is the same for any number of threads: a pixel depends on nothing
    /// but the scene.
    pub fn render(&self, options: RenderOptions<'_>) -> Film {
        if options.threads == 0 {
            return self.render_on_current_pool(options.progress);
        }
        match rayon::ThreadPoolBuilder::new()
            .num_threads(options.threads)
            .build()
        {
            Ok(pool) => pool.install(|| self.render_on_current_pool(options.progress)),
            // Threads are a matter of speed only: go on with those that there are.
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
        let rendered: Vec<RenderedTile> = tiles
            .par_iter()
            .map_init(Scratch::default, |scratch, tile| {
                let rendered = self.render_tile(tile, scratch);
                let pixels = u64::from(tile.width) * u64::from(tile.height);
                let so_far = done.fetch_add(pixels, Ordering::Relaxed) + pixels;
                if let Some(progress) = progress {
                    progress(so_far, total);
                }
                rendered
            })
            .collect();
        let mut film = Film {
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
            samples: self.sampler.count(),
            counters: Counters::default(),
            render_seconds: 0.0,
        };
        for (tile, part) in tiles.iter().zip(&rendered) {
            film.counters.add(part.counters);
            for row in 0..tile.height {
                let from = (row * tile.width) as usize..((row + 1) * tile.width) as usize;
                let to = ((tile.y + row) as usize * size.width as usize) + tile.x as usize;
                let to = to..to + tile.width as usize;
                film.rgb[to.clone()].copy_from_slice(&part.rgb[from.clone()]);
                for ((_, layer), values) in film.layers.iter_mut().zip(&part.layers) {
                    layer[to.clone()].copy_from_slice(&values[from.clone()]);
                }
            }
        }
        film.render_seconds = start.elapsed().as_secs_f64();
        film
    }

    fn render_tile(&self, tile: &Tile, scratch: &mut Scratch) -> RenderedTile {
        let pixels = (tile.width * tile.height) as usize;
        let channels = self.film.aovs.iter().map(|aov| aov.channels().len()).sum();
        let mut rendered = RenderedTile {
            rgb: Vec::with_capacity(pixels),
            layers: vec![Vec::with_capacity(pixels); channels],
            counters: Counters::default(),
        };
        let before = scratch.counters;
        for y in tile.y..tile.y + tile.height {
            for x in tile.x..tile.x + tile.width {
                let color = self.pixel([x, y], scratch);
                rendered.rgb.push(color.to_array().map(|c| c as f32));
                if channels > 0 {
                    self.layers([x, y], &mut rendered.layers);
                }
            }
        }
        rendered.counters = Counters {
            closest: scratch.counters.closest - before.closest,
            shadow: scratch.counters.shadow - before.shadow,
        };
        rendered
    }

    /// The camera ray of a sample of a pixel.
    pub fn camera_ray(&self, pixel: [u32; 2], sample: u32) -> Ray {
        let corner = DVec2::new(f64::from(pixel[0]), f64::from(pixel[1]));
        self.camera.ray(corner + self.sampler.position(pixel, sample))
    }

    /// The value of one pixel: the mean over its samples.
    pub fn pixel(&self, pixel: [u32; 2], scratch: &mut Scratch) -> Rgb {
        let count = self.sampler.count();
        let sum: Rgb = (0..count)
            .map(|sample| {
                self.integrator
                    .radiance(&self.world, &self.camera_ray(pixel, sample), scratch)
            })
            .sum();
        sum * (1.0 / f64::from(count))
    }

    fn layers(&self, pixel: [u32; 2], out: &mut [Vec<f32>]) {
        let raster = DVec2::new(f64::from(pixel[0]) + 0.5, f64::from(pixel[1]) + 0.5);
        let ray = self.camera.ray(raster);
        let hit = self
            .world
            .accelerator
            .closest(&ray, Interval::FORWARD, Skip::NOTHING);
        let mut values = out.iter_mut();
        for aov in &self.film.aovs {
            for value in self.layer_values(*aov, &ray, hit.as_ref()) {
                if let Some(layer) = values.next() {
                    layer.push(value as f32);
                }
            }
        }
    }

    fn layer_values(&self, aov: Aov, ray: &Ray, hit: Option<&RawHit>) -> Vec<f64> {
        let Some(hit) = hit else {
            return match aov {
                Aov::ShapeId | Aov::PrimitiveId => vec![-1.0],
                _ => vec![0.0; aov.channels().len()],
            };
        };
        let surface = || self.world.geometry.surface(ray, hit, aov.needs());
        match aov {
            Aov::Depth => vec![hit.t],
            Aov::Normal => surface().n_s.to_array().to_vec(),
            Aov::Uv => surface().uv.to_array().to_vec(),
            Aov::ShapeId => vec![f64::from(hit.shape)],
            Aov::PrimitiveId => vec![f64::from(hit.primitive)],
        }
    }
}

impl Film {
    /// As an image with all layers and the attributes that say where it comes from.
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
