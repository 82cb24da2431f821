//! The layers of path classes.
//!
//! They are rendered after the image, by tracing its samples again, one ray at a time and with the
//! state of the path automaton on each. The image does not depend on them, and images without them
//! do not pay for them.

use crate::render::Region;
use crate::{Film, Pipeline, Progress};
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use whitstone_core::{PathClasses, Rgb, Scratch};

/// Rows that are rendered before their values move to the film.
const ROWS: u32 = 16;

impl Pipeline {
    /// Renders the layers of the path classes, the last ones of the film. `positions`: the number
    /// of sampler positions of each pixel of the region, if it is not that of the sampler.
    /// `moment`: see [`Self::moment`].
    pub(crate) fn split_paths(
        &self,
        classes: &Arc<PathClasses>,
        region: Region,
        positions: Option<&[u32]>,
        moment: u32,
        film: &mut Film,
        progress: Option<Progress<'_>>,
    ) {
        let count = 3 * classes.names.len();
        let first = film.layers.len() - count;
        let total = u64::from(region.width) * u64::from(region.height);
        let stopped = AtomicBool::new(false);
        let limits = self.tree_limits(rayon::current_num_threads());
        for top in (0..region.height).step_by(ROWS as usize) {
            let rows = ROWS.min(region.height - top);
            let start = region.place([region.x, region.y + top]);
            let mut values = vec![0.0; (region.width * rows) as usize * count];
            values.par_chunks_mut(count).enumerate().for_each_init(
                || Scratch::splitting(limits, classes.clone()),
                |scratch, (place, values)| {
                    if stopped.load(Ordering::Relaxed) {
                        return;
                    }
                    let (x, y) = (place as u32 % region.width, place as u32 / region.width);
                    let positions = positions.map_or(self.sampler.count(), |all| all[start + place]);
                    let pixel = [region.x + x, region.y + top + y];
                    let means = self.classes_of(pixel, positions, moment, scratch);
                    let channels = means.iter().flat_map(|mean| mean.to_array());
                    for (value, mean) in values.iter_mut().zip(channels) {
                        *value = mean as f32;
                    }
                    if x == 0
                        && let Some(progress) = progress
                        && progress(total, total).is_break()
                    {
                        stopped.store(true, Ordering::Relaxed);
                    }
                },
            );
            if stopped.load(Ordering::Relaxed) {
                film.is_complete = false;
                return;
            }
            for (pixel, values) in values.chunks_exact(count).enumerate() {
                for ((_, layer), value) in film.layers[first..].iter_mut().zip(values) {
                    layer[start + pixel] = *value;
                }
            }
        }
    }

    /// The mean of each class over the samples of a pixel; for an adaptive sampler, over those of
    /// its first positions at one time.
    fn classes_of(&self, pixel: [u32; 2], positions: u32, moment: u32, scratch: &mut Scratch) -> Vec<Rgb> {
        let samples = match self.sampler.refinement() {
            None => 0..self.samples(),
            Some(_) => {
                let earlier = moment * self.moment_samples();
                earlier..earlier + positions * self.camera.lens_points()
            }
        };
        let count = samples.len() as f64;
        if let Some(paths) = &mut scratch.paths {
            paths.sums.fill(Rgb::BLACK);
        }
        for sample in samples {
            self.radiance_of(pixel, sample, scratch);
        }
        let sums = scratch.paths.iter().flat_map(|paths| &paths.sums);
        sums.map(|sum| *sum * (1.0 / count)).collect()
    }
}
