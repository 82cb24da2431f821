//! The render loop: tiles of pixels, distributed to threads.

use crate::adaptive::Adaptive;
use crate::samples::SampleMemory;
use crate::{Film, Pipeline, Progress};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;
use whitstone_core::stream::{LANES, NO_SHAPE};
use whitstone_core::{FilmSize, Rgb, Scratch, SurfaceAttributes, TreeLimits};
use whitstone_scene::Aov;

/// Side of the square tiles that are distributed to threads, in pixels, by default.
const TILE: u32 = 16;

/// Largest side of the blocks that a tile is rendered in, in pixels: their rays fill a stream.
const BLOCK: u32 = 16;
const _: () = assert!((BLOCK * BLOCK) as usize <= LANES);

/// Side of the squares within a block, in pixels.
const SQUARE: u32 = 4;

/// A part of the image, in pixels from its upper left corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Region {
    /// The part that lies in an image of a size.
    pub(crate) fn within(self, size: FilmSize) -> Self {
        let (x, y) = (self.x.min(size.width), self.y.min(size.height));
        Self {
            x,
            y,
            width: self.width.min(size.width - x),
            height: self.height.min(size.height - y),
        }
    }

    fn contains(self, [x, y]: [u32; 2]) -> bool {
        (self.x..self.x + self.width).contains(&x) && (self.y..self.y + self.height).contains(&y)
    }

    /// The place of a pixel of the image in the film of the region.
    pub(crate) fn place(self, [x, y]: [u32; 2]) -> usize {
        (y - self.y) as usize * self.width as usize + (x - self.x) as usize
    }

    /// The region with the pixels of an image around it.
    pub(crate) fn with_border(self, size: FilmSize) -> Self {
        let (x, y) = (self.x.saturating_sub(1), self.y.saturating_sub(1));
        Self {
            x,
            y,
            width: (self.x + self.width + 1).min(size.width) - x,
            height: (self.y + self.height + 1).min(size.height) - y,
        }
    }

    /// The pixels of an image around the region.
    fn neighbours(self, size: FilmSize) -> Vec<[u32; 2]> {
        let all = self.with_border(size);
        let (columns, rows) = (all.x..all.x + all.width, all.y..all.y + all.height);
        rows.flat_map(|y| columns.clone().map(move |x| [x, y]))
            .filter(|pixel| !self.contains(*pixel))
            .collect()
    }
}

/// Options of the rendering. They do not affect the values of pixels.
#[derive(Clone, Copy, Default)]
pub struct RenderOptions<'a> {
    /// The part of the image to render; by default all of it. Its pixels have the values that they
    /// have in the whole image.
    pub region: Option<Region>,
    /// Threads; 0 means one per core.
    pub threads: usize,
    /// Side of the square tiles that threads take, in pixels; 0 means 16. Above 16 it is
    /// rounded up to a multiple of 16.
    pub tile: u32,
    /// Called after each tile; can stop the rendering.
    pub progress: Option<Progress<'a>>,
}

impl Region {
    /// Squares with this side that cover the region, cut at its border, column by column.
    fn squares(self, side: u32) -> Vec<Self> {
        let rows = self.height.div_ceil(side);
        let corners = (0..self.width.div_ceil(side))
            .flat_map(|column| (0..rows).map(move |row| (column * side, row * side)));
        let square = |(x, y)| Self {
            x: self.x + x,
            y: self.y + y,
            width: side.min(self.width - x),
            height: side.min(self.height - y),
        };
        corners.map(square).collect()
    }

    /// The pixels of a block relative to its corner, ordered in small squares, so that the rays of
    /// one register stay close together.
    fn order(&self, order: &mut Vec<[u32; 2]>) {
        let square = |k: u32| [k % (BLOCK / SQUARE) * SQUARE, k / (BLOCK / SQUARE) * SQUARE];
        let squares = (0..(BLOCK / SQUARE).pow(2)).map(square);
        let all =
            squares.flat_map(|[x, y]| (0..SQUARE * SQUARE).map(move |k| [x + k % SQUARE, y + k / SQUARE]));
        order.clear();
        order.extend(all.filter(|[x, y]| *x < self.width && *y < self.height));
    }
}

/// Working memory of one thread, and the block that it rendered last.
#[derive(Default)]
struct BlockScratch {
    /// The pixels relative to the block's corner, in the order of the lanes.
    order: Vec<[u32; 2]>,
    /// The block size for which `order` was computed.
    ordered: [u32; 2],
    /// The pixels of the image, in the same order.
    pixels: Vec<[u32; 2]>,
    rgb: Vec<[f32; 3]>,
    /// All values of the first channel of the layers, then those of the next one.
    layers: Vec<f32>,
    memory: SampleMemory,
}

impl BlockScratch {
    fn new(limits: TreeLimits, moment: u32) -> Self {
        Self {
            memory: SampleMemory::new(limits, moment),
            ..Self::default()
        }
    }

    /// Sets the pixels to those of a block.
    fn enter(&mut self, block: &Region) {
        let size = [block.width, block.height];
        if self.ordered != size {
            block.order(&mut self.order);
            self.ordered = size;
        }
        self.pixels.clear();
        self.pixels
            .extend(self.order.iter().map(|[x, y]| [block.x + x, block.y + y]));
    }

    /// Writes the pixels to their band of a film.
    fn write(&self, band: &mut Band<'_>, region: Region) {
        // The first pixel of a block is in the first row of its band.
        let first = self
            .pixels
            .first()
            .map_or(0, |[_, y]| region.place([region.x, *y]));
        let place = |pixel: &[u32; 2]| region.place(*pixel) - first;
        let values = self.layers.chunks_exact(self.pixels.len().max(1));
        // A row of a square lies side by side, unless the block is cut.
        let width = self.ordered[0];
        if width.is_multiple_of(SQUARE) {
            let rows: Vec<usize> = self.pixels.iter().step_by(SQUARE as usize).map(place).collect();
            copy_rows(band.rgb, &self.rgb, &rows);
            for (layer, values) in band.layers.iter_mut().zip(values) {
                copy_rows(layer, values, &rows);
            }
            return;
        }
        // Without values if the pixels are not finished.
        for (pixel, rgb) in self.pixels.iter().zip(&self.rgb) {
            band.rgb[place(pixel)] = *rgb;
        }
        for (layer, values) in band.layers.iter_mut().zip(values) {
            for (pixel, value) in self.pixels.iter().zip(values) {
                layer[place(pixel)] = *value;
            }
        }
    }
}

/// Copies each row of the squares of a block to its place. `values` is empty if the pixels are not
/// finished.
fn copy_rows<T: Copy>(to: &mut [T], values: &[T], places: &[usize]) {
    let rows = values.as_chunks::<{ SQUARE as usize }>().0;
    for (place, row) in places.iter().zip(rows) {
        to[*place..][..row.len()].copy_from_slice(row);
    }
}

/// The rows of a film that one row of blocks covers.
struct Band<'f> {
    rgb: &'f mut [[f32; 3]],
    layers: Vec<&'f mut [f32]>,
}

impl<'f> Band<'f> {
    /// The bands of a film with this number of rows, from the top.
    fn all(film: &'f mut Film, rows: u32) -> Vec<Mutex<Self>> {
        let size = (film.width as usize * rows as usize).max(1);
        let rgb = film.rgb.chunks_mut(size);
        let mut bands: Vec<Self> = rgb
            .map(|rgb| Self {
                rgb,
                layers: Vec::new(),
            })
            .collect();
        for (_, layer) in &mut film.layers {
            for (band, layer) in bands.iter_mut().zip(layer.chunks_mut(size)) {
                band.layers.push(layer);
            }
        }
        bands.into_iter().map(Mutex::new).collect()
    }
}

impl Pipeline {
    /// Renders the image. The result does not depend on the number of threads, because a pixel
    /// depends only on the scene.
    pub fn render(&self, options: RenderOptions<'_>) -> Film {
        let mut film = Film::default();
        self.render_into(options, &mut film);
        film
    }

    /// Renders the image into a film, whose buffers serve again if they are large enough. All that
    /// it contained is replaced.
    pub fn render_into(&self, options: RenderOptions<'_>, film: &mut Film) {
        if options.threads == 0 {
            return self.render_on_current_pool(options, film);
        }
        let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads);
        match pool.build() {
            Ok(pool) => pool.install(|| self.render_on_current_pool(options, film)),
            // Threads only affect the speed, so the existing ones are used instead.
            Err(_) => self.render_on_current_pool(options, film),
        }
    }

    fn render_on_current_pool(&self, options: RenderOptions<'_>, film: &mut Film) {
        let start = Instant::now();
        if self.later.is_empty() || self.sampler.refinement().is_none() {
            self.render_pass(0, options, film);
        } else {
            self.render_moments(options, film);
        }
        film.render_seconds = start.elapsed().as_secs_f64();
    }

    /// Renders the image of an adaptive sampler, which refines the image at each time by itself, as
    /// the mean of those images.
    fn render_moments(&self, options: RenderOptions<'_>, film: &mut Film) {
        let count = self.moments();
        let first_layer = self.film.channels().count() - self.path_channels();
        let mut mean = Mean::default();
        let mut other = Film::default();
        for moment in 0..count {
            let within = |done: u64, total: u64| match options.progress {
                // As if each image finished its share of the pixels.
                Some(progress) => progress((u64::from(moment) * total + done) / u64::from(count), total),
                None => ControlFlow::Continue(()),
            };
            let options = RenderOptions {
                progress: Some(&within),
                ..options
            };
            // The layers of the first one stay.
            let here = if moment == 0 { &mut *film } else { &mut other };
            self.render_pass(moment, options, here);
            mean.add(here, first_layer);
            if moment > 0 {
                film.counters.add(other.counters);
                film.is_complete = other.is_complete;
                film.stop_at(other.too_large);
            }
            if !film.is_complete {
                break;
            }
        }
        film.samples = self.samples();
        mean.write(film, first_layer);
    }

    /// Number of channels of path classes, the last ones of the film.
    fn path_channels(&self) -> usize {
        let paths = self.film.paths.iter();
        paths.map(|paths| paths.classes.channels().len()).sum()
    }

    /// Renders the image at one time for an adaptive sampler, else at all times. AOVs only at the
    /// first.
    fn render_pass(
        &self,
        moment: u32,
        RenderOptions {
            region,
            tile,
            progress,
            ..
        }: RenderOptions<'_>,
        film: &mut Film,
    ) {
        let size = self.film.size;
        let all = Region {
            x: 0,
            y: 0,
            width: size.width,
            height: size.height,
        };
        let region = region.map_or(all, |region| region.within(size));
        let total = u64::from(region.width) * u64::from(region.height);
        let done = AtomicU64::new(0);
        // Column by column: threads that work side by side then write to different bands. The first
        // write to a page of the film takes as long as some rays; with one lock for the whole film,
        // sixteen threads were only 5.8 times as fast as one.
        let side = match tile {
            0 => TILE,
            // Each row of blocks has its own rows of the film.
            BLOCK.. => tile.min(65_536).next_multiple_of(BLOCK),
            _ => tile,
        };
        let rows = side.min(BLOCK);
        let tiles: Vec<Vec<Region>> = region
            .squares(side)
            .into_iter()
            .map(|tile| tile.squares(rows))
            .collect();
        film.prepare([region.width, region.height], self.film.channels());
        film.samples = self.samples();
        let adaptive = self
            .sampler
            .refinement()
            .map(|rule| Adaptive::new(rule, size, region, moment));
        let first = adaptive.as_ref().map_or(self.sampler.count(), Adaptive::first);
        // Each thread takes the next tile when it finishes one, because a fixed division of the
        // image would take unequal times.
        let next = AtomicUsize::new(0);
        let stopped = AtomicBool::new(false);
        let too_large = Mutex::new(None);
        let bands = Band::all(film, rows);
        let limits = self.tree_limits(rayon::current_num_threads());
        let counters = rayon::broadcast(|_| {
            let mut scratch = BlockScratch::new(limits, moment);
            let taken = std::iter::from_fn(|| tiles.get(next.fetch_add(1, Ordering::Relaxed)));
            for block in taken.flatten() {
                if stopped.load(Ordering::Relaxed) {
                    break;
                }
                self.render_block(block, first, adaptive.as_ref(), &mut scratch);
                if let Some(tree) = scratch.memory.too_large(&scratch.pixels) {
                    *too_large.lock().unwrap_or_else(PoisonError::into_inner) = Some(tree);
                    stopped.store(true, Ordering::Relaxed);
                    break;
                }
                if let Some(band) = bands.get(((block.y - region.y) / rows) as usize) {
                    let mut band = band.lock().unwrap_or_else(PoisonError::into_inner);
                    scratch.write(&mut band, region);
                }
                let pixels = u64::from(block.width) * u64::from(block.height);
                let so_far = done.fetch_add(pixels, Ordering::Relaxed) + pixels;
                // The first samples of an adaptive sampler finish no pixel.
                let finished = if adaptive.is_none() { so_far } else { 0 };
                if let Some(progress) = progress
                    && progress(finished, total).is_break()
                {
                    stopped.store(true, Ordering::Relaxed);
                }
            }
            scratch.memory.scratch.counters
        });
        drop(bands);
        for counted in counters {
            film.counters.add(counted);
        }
        // The number of positions that each pixel of the region takes, if that differs.
        let mut taken = (adaptive.is_some() && self.film.paths.is_some()).then(Vec::new);
        if stopped.into_inner() {
            // The last tile may have been finished before.
            film.is_complete = adaptive.is_none() && done.into_inner() == total;
        } else if let Some(adaptive) = adaptive {
            let mut scratch = BlockScratch::new(limits, moment);
            // Pixels of the region take as many samples as in the whole image.
            for pixels in region.neighbours(size).chunks(LANES) {
                adaptive.start(self, pixels, &mut scratch.memory);
                film.stop_at(scratch.memory.too_large(pixels));
            }
            let pixels = tiles.iter().flatten().flat_map(|block| {
                scratch.enter(block);
                scratch.pixels.clone()
            });
            if film.too_large.is_none() {
                adaptive.refine(self, pixels.collect(), region, film, taken.as_mut(), progress);
            }
        }
        film.stop_at(too_large.into_inner().unwrap_or_else(PoisonError::into_inner));
        if let Some(paths) = &self.film.paths
            && film.is_complete
        {
            self.split_paths(&paths.classes, region, taken.as_deref(), moment, film, progress);
        }
    }

    /// Renders a block with the first `positions` of each pixel.
    fn render_block(
        &self,
        block: &Region,
        positions: u32,
        adaptive: Option<&Adaptive>,
        scratch: &mut BlockScratch,
    ) {
        scratch.enter(block);
        let BlockScratch {
            pixels,
            rgb,
            layers,
            memory,
            ..
        } = scratch;
        rgb.clear();
        layers.clear();
        let has_layers = !self.film.aovs.is_empty() && memory.moment == 0;
        if has_layers {
            self.trace_centers(pixels, memory);
            self.layers(pixels.len(), memory, layers);
        }
        match adaptive {
            None => {
                let mut sums = [Rgb::BLACK; LANES];
                let mut add = |lane: usize, radiance| sums[lane] += radiance;
                if has_layers && self.samples_are_centers(pixels) {
                    self.shade_centers(memory, add);
                } else {
                    for moment in 0..self.moments() {
                        memory.moment = moment;
                        self.sample(pixels, 0..positions, memory, &mut add);
                        if memory.scratch.too_large.is_some() {
                            break;
                        }
                    }
                    memory.moment = 0;
                }
                let count = f64::from(self.samples());
                rgb.extend(sums[..pixels.len()].iter().map(|sum| {
                    let mean = *sum * (1.0 / count);
                    mean.to_array().map(|c| c as f32)
                }));
            }
            Some(adaptive) => adaptive.start(self, pixels, memory),
        }
    }

    /// The layers of the hits of a stream of rays.
    fn layers(&self, len: usize, memory: &mut SampleMemory, layers: &mut Vec<f32>) {
        let aovs = &self.film.aovs;
        let needs = aovs
            .iter()
            .fold(SurfaceAttributes::NOTHING, |all, aov| all | needs(*aov));
        if aovs.iter().any(|aov| matches!(aov, Aov::Normal | Aov::Uv)) {
            self.surfaces(len, memory, needs);
        }
        let SampleMemory {
            raster, hits, points, ..
        } = &*memory;
        let shape = &hits.id.shape[..len];
        let mut put = Columns { len, layers };
        for aov in aovs {
            match aov {
                Aov::Depth => put.column(|lane| match shape[lane] {
                    NO_SHAPE => 0.0,
                    _ => (self.camera.near(raster.0[lane]) + hits.t.0[lane]) as f32,
                }),
                Aov::Normal => {
                    for axis in 0..3 {
                        put.column(|lane| match shape[lane] {
                            NO_SHAPE => 0.0,
                            _ => points.n_s.get(lane)[axis] as f32,
                        });
                    }
                }
                Aov::Uv => {
                    for values in [&points.u, &points.v] {
                        put.column(|lane| match shape[lane] {
                            NO_SHAPE => 0.0,
                            _ => values.0[lane] as f32,
                        });
                    }
                }
                Aov::ShapeId => put.column(|lane| match shape[lane] {
                    NO_SHAPE => -1.0,
                    shape => self.scene.shape_id(shape) as f32,
                }),
                Aov::PrimitiveId => put.column(|lane| match shape[lane] {
                    NO_SHAPE => -1.0,
                    _ => hits.id.primitive[lane] as f32,
                }),
            }
        }
    }

    /// The surfaces at the hits of `memory.rays`; lanes without a hit are arbitrary.
    fn surfaces(&self, len: usize, memory: &mut SampleMemory, needs: SurfaceAttributes) {
        let SampleMemory {
            rays, hits, points, ..
        } = memory;
        let (geometry, first) = (&self.scene.geometry, hits.id.shape[0]);
        if first != NO_SHAPE && hits.id.shape[..len].iter().all(|shape| *shape == first) {
            geometry.surface_stream(first, rays, hits, needs, points);
            return;
        }
        for lane in 0..len {
            if let Some(hit) = hits.get(lane) {
                points.set_geometry(lane, &geometry.surface(&rays.ray(lane), &hit, needs));
            }
        }
    }

    /// The value of a single pixel, the mean of its samples. Equal to its value in the image.
    pub fn pixel(&self, pixel: [u32; 2], scratch: &mut Scratch) -> Rgb {
        if let Some(rule) = self.sampler.refinement() {
            let [x, y] = pixel;
            let alone = Region {
                x,
                y,
                width: 1,
                height: 1,
            };
            let mut at = |moment| {
                let adaptive = Adaptive::new(rule, self.film.size, alone, moment);
                adaptive.pixel(self, pixel, scratch)
            };
            if self.later.is_empty() {
                return at(0);
            }
            let count = self.moments();
            // Rounded as the images of which the image is the mean.
            let rounded = |value: Rgb| Rgb::from(value.to_array().map(|c| f64::from(c as f32)));
            let sum: Rgb = (0..count).map(|moment| rounded(at(moment))).sum();
            return sum * (1.0 / f64::from(count));
        }
        let count = self.samples();
        let sum: Rgb = (0..count)
            .map(|sample| self.radiance_of(pixel, sample, scratch))
            .sum();
        sum * (1.0 / f64::from(count))
    }
}

/// Appends the channels of layers.
struct Columns<'a> {
    len: usize,
    layers: &'a mut Vec<f32>,
}

impl Columns<'_> {
    fn column(&mut self, value: impl Fn(usize) -> f32) {
        self.layers.extend((0..self.len).map(value));
    }
}

/// The mean of images.
#[derive(Default)]
struct Mean {
    count: u32,
    /// Of the radiance, then of the layers of path classes.
    sums: Vec<f64>,
}

impl Mean {
    /// Adds a finished film, with its layers from a number on.
    fn add(&mut self, film: &Film, first_layer: usize) {
        if !film.is_complete {
            return;
        }
        self.count += 1;
        let layers = film.layers[first_layer..].iter().flat_map(|(_, values)| values);
        let values = film.rgb.iter().flatten().chain(layers);
        self.sums
            .resize((3 + film.layers.len() - first_layer) * film.rgb.len(), 0.0);
        for (sum, value) in self.sums.iter_mut().zip(values) {
            *sum += f64::from(*value);
        }
    }

    /// Writes the mean, unless there is none.
    fn write(&self, film: &mut Film, first_layer: usize) {
        if self.count == 0 {
            return;
        }
        let layers = film.layers[first_layer..]
            .iter_mut()
            .flat_map(|(_, values)| values);
        let values = film.rgb.iter_mut().flatten().chain(layers);
        let factor = 1.0 / f64::from(self.count);
        for (value, sum) in values.zip(&self.sums) {
            *value = (sum * factor) as f32;
        }
    }
}

/// What a hit must provide for a layer.
fn needs(aov: Aov) -> SurfaceAttributes {
    match aov {
        Aov::Normal => SurfaceAttributes::SHADING_NORMAL,
        Aov::Uv => SurfaceAttributes::UV,
        Aov::Depth | Aov::ShapeId | Aov::PrimitiveId => SurfaceAttributes::NOTHING,
    }
}
