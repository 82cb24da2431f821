//! Adaptive sampling: takes more samples in the pixels that need them.
//!
//! Whitted 1980 subdivides a pixel if the colours at its corners differ. Here the number of samples
//! of a pixel doubles as long as its own samples, or the first ones of its neighbours, differ by
//! more than a threshold. Section 5 of `docs/whitted-model.md`.

use crate::render::Region;
use crate::samples::SampleMemory;
use crate::{Film, Pipeline, Progress};
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use whitstone_core::stream::{GROUP, LANES};
use whitstone_core::{FilmSize, Refinement, Rgb, Scratch};

/// The samples of a pixel so far.
#[derive(Clone, Copy)]
struct Tally {
    sum: Rgb,
    least: Rgb,
    most: Rgb,
    /// Range of the first samples.
    first_range: f64,
}

impl Tally {
    const NOTHING: Self = Self {
        sum: Rgb::BLACK,
        least: Rgb::splat(f64::INFINITY),
        most: Rgb::splat(f64::NEG_INFINITY),
        first_range: 0.0,
    };

    #[inline(always)]
    fn add(&mut self, radiance: Rgb) {
        let (a, b) = (self.least, self.most);
        self.sum += radiance;
        self.least = Rgb::new(a.r.min(radiance.r), a.g.min(radiance.g), a.b.min(radiance.b));
        self.most = Rgb::new(b.r.max(radiance.r), b.g.max(radiance.g), b.b.max(radiance.b));
    }

    /// The range of the channel with the largest range.
    fn range(&self) -> f64 {
        (self.most + self.least * -1.0).max_component()
    }
}

/// The state of an image during refinement.
pub(crate) struct Adaptive {
    rule: Refinement,
    size: FilmSize,
    /// The time of the image; see [`Pipeline::moment`].
    moment: u32,
    /// The pixels that have a tally: those of the region, and their neighbours.
    window: Region,
    /// Of the pixels of the window, row by row.
    tallies: Mutex<Vec<Tally>>,
}

impl Adaptive {
    /// The state of the pixels of a region at a time.
    pub(crate) fn new(rule: Refinement, size: FilmSize, region: Region, moment: u32) -> Self {
        Self {
            rule,
            size,
            moment,
            window: region.with_border(size),
            tallies: Mutex::default(),
        }
    }

    /// Number of sample positions that every pixel takes.
    pub(crate) fn first(&self) -> u32 {
        self.rule.initial_samples
    }

    /// Takes the first samples of some pixels.
    pub(crate) fn start(&self, pipeline: &Pipeline, pixels: &[[u32; 2]], memory: &mut SampleMemory) {
        let mut found = [Tally::NOTHING; LANES];
        pipeline.sample(pixels, 0..self.rule.initial_samples, memory, |lane, radiance| {
            found[lane].add(radiance);
        });
        let mut tallies = self.tallies.lock().unwrap_or_else(PoisonError::into_inner);
        if tallies.is_empty() {
            let window = self.window;
            tallies.resize(window.width as usize * window.height as usize, Tally::NOTHING);
        }
        for (pixel, tally) in pixels.iter().zip(found) {
            tallies[self.place(*pixel)] = Tally {
                first_range: tally.range(),
                ..tally
            };
        }
    }

    /// Takes all further samples and computes the colours of the pixels. `positions` receives the
    /// number of positions that each pixel of the region took.
    pub(crate) fn refine(
        self,
        pipeline: &Pipeline,
        mut active: Vec<[u32; 2]>,
        region: Region,
        film: &mut Film,
        mut positions: Option<&mut Vec<u32>>,
        progress: Option<Progress<'_>>,
    ) {
        if let Some(positions) = &mut positions {
            positions.resize(active.len(), 0);
        }
        let tallies = std::mem::take(&mut *self.tallies.lock().unwrap_or_else(PoisonError::into_inner));
        let nears: Vec<f64> = (active.iter())
            .map(|pixel| self.near(*pixel, |neighbour| tallies[self.place(neighbour)].first_range))
            .collect();
        let mut near = vec![0.0; tallies.len()];
        for (pixel, range) in active.iter().zip(nears) {
            near[self.place(*pixel)] = range;
        }
        let (lens, total) = (pipeline.camera.lens_points(), active.len() as u64);
        let mut taken = self.rule.initial_samples;
        let state = Mutex::new((tallies, film));
        // One per thread, for all rounds.
        let threads = rayon::current_num_threads();
        let limits = pipeline.tree_limits(threads);
        let memories: Vec<Mutex<SampleMemory>> =
            std::iter::repeat_with(|| Mutex::new(SampleMemory::new(limits, self.moment)))
                .take(threads)
                .collect();
        loop {
            {
                let (tallies, film) = &mut *state.lock().unwrap_or_else(PoisonError::into_inner);
                let last = taken == pipeline.sampler.count();
                active.retain(|pixel| {
                    let place = self.place(*pixel);
                    let tally = &tallies[place];
                    let continues = !last && self.rule.continues(taken * lens, tally.range(), near[place]);
                    if !continues {
                        let mean = tally.sum * (1.0 / f64::from(taken * lens));
                        film.rgb[region.place(*pixel)] = mean.to_array().map(|c| c as f32);
                        if let Some(positions) = &mut positions {
                            positions[region.place(*pixel)] = taken;
                        }
                    }
                    continues
                });
            }
            let finished = total - active.len() as u64;
            let stops = || progress.is_some_and(|progress| progress(finished, total).is_break());
            let stopped = AtomicBool::new(stops());
            if active.is_empty() {
                return;
            }
            let until = taken.saturating_mul(2).min(pipeline.sampler.count());
            let share = active.len().div_ceil(4 * rayon::current_num_threads());
            let chunks: Vec<&[[u32; 2]]> = active.chunks(share.next_multiple_of(GROUP).min(LANES)).collect();
            let next = AtomicUsize::new(0);
            rayon::broadcast(|thread| {
                let memory = &mut *memories[thread.index()]
                    .lock()
                    .unwrap_or_else(PoisonError::into_inner);
                while !stopped.load(Ordering::Relaxed)
                    && let Some(pixels) = chunks.get(next.fetch_add(1, Ordering::Relaxed))
                {
                    let mut found = [Tally::NOTHING; LANES];
                    {
                        let (tallies, _) = &*state.lock().unwrap_or_else(PoisonError::into_inner);
                        for (tally, pixel) in found.iter_mut().zip(*pixels) {
                            *tally = tallies[self.place(*pixel)];
                        }
                    }
                    pipeline.sample(pixels, taken..until, memory, |lane, radiance| {
                        found[lane].add(radiance);
                    });
                    let (tallies, film) = &mut *state.lock().unwrap_or_else(PoisonError::into_inner);
                    for (tally, pixel) in found.iter().zip(*pixels) {
                        tallies[self.place(*pixel)] = *tally;
                    }
                    film.counters.add(std::mem::take(&mut memory.scratch.counters));
                    let too_large = memory.too_large(pixels);
                    film.stop_at(too_large);
                    if too_large.is_some() || stops() {
                        stopped.store(true, Ordering::Relaxed);
                    }
                }
            });
            if stopped.into_inner() {
                let (_, film) = &mut *state.lock().unwrap_or_else(PoisonError::into_inner);
                film.is_complete = false;
                return;
            }
            taken = until;
        }
    }

    /// The colour of a single pixel.
    pub(crate) fn pixel(&self, pipeline: &Pipeline, pixel: [u32; 2], scratch: &mut Scratch) -> Rgb {
        let lens = pipeline.camera.lens_points();
        let earlier = self.moment * pipeline.moment_samples();
        let tally_of = |pixel, samples: Range<u32>, mut tally: Tally, scratch: &mut Scratch| {
            for sample in samples {
                tally.add(pipeline.radiance_of(pixel, earlier + sample, scratch));
            }
            tally
        };
        let first = 0..self.rule.initial_samples * lens;
        // Rays of the neighbours do not count as rays of this pixel.
        let mut aside = Scratch::within(scratch.limits);
        let near = self.near(pixel, |neighbour| {
            tally_of(neighbour, first.clone(), Tally::NOTHING, &mut aside).range()
        });
        scratch.too_large = aside.too_large;
        let mut tally = tally_of(pixel, first, Tally::NOTHING, scratch);
        let (mut taken, count) = (self.rule.initial_samples, pipeline.sampler.count());
        while taken < count && self.rule.continues(taken * lens, tally.range(), near) {
            let until = taken.saturating_mul(2).min(count);
            tally = tally_of(pixel, taken * lens..until * lens, tally, scratch);
            taken = until;
        }
        tally.sum * (1.0 / f64::from(taken * lens))
    }

    fn place(&self, pixel: [u32; 2]) -> usize {
        self.window.place(pixel)
    }

    /// The largest value of the up to eight neighbours of a pixel.
    fn near(&self, [x, y]: [u32; 2], mut value: impl FnMut([u32; 2]) -> f64) -> f64 {
        let mut largest = 0.0_f64;
        for j in y.saturating_sub(1)..=(y + 1).min(self.size.height - 1) {
            for i in x.saturating_sub(1)..=(x + 1).min(self.size.width - 1) {
                if [i, j] != [x, y] {
                    largest = largest.max(value([i, j]));
                }
            }
        }
        largest
    }
}
