//! Numbers of work per pixel, for heat maps.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicBool, Ordering};
use whitstone_core::{DVec2, Interval, Scratch, SelfHitFilter};
use whitstone_render::Pipeline;

/// What a picture shows of each pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Shown {
    /// Its radiance.
    #[default]
    Picture,
    /// Inner nodes, or cells, that the ray through its centre visits.
    Steps,
    /// Elements that the ray through its centre is tested with.
    Tests,
    /// Rays traced for it: camera, specular and shadow rays of all its samples.
    Rays,
}

/// The numbers of all pixels, row by row; `None` if the accelerator counts none, or if `go_on`
/// became false.
pub fn numbers(pipeline: &Pipeline, shown: Shown, go_on: &(dyn Fn() -> bool + Sync)) -> Option<Vec<f32>> {
    let size = pipeline.film.size;
    let missing = AtomicBool::new(false);
    let limits = pipeline.tree_limits(rayon::current_num_threads());
    let rows: Vec<Vec<f32>> = (0..size.height)
        .into_par_iter()
        .map_init(
            || Scratch::within(limits),
            |scratch, y| {
                if missing.load(Ordering::Relaxed) {
                    return Vec::new();
                }
                if !go_on() {
                    missing.store(true, Ordering::Relaxed);
                }
                let numbers = (0..size.width).map(|x| number(pipeline, shown, [x, y], scratch));
                let numbers: Option<Vec<f32>> = numbers.collect();
                numbers.unwrap_or_else(|| {
                    missing.store(true, Ordering::Relaxed);
                    Vec::new()
                })
            },
        )
        .collect();
    (!missing.into_inner()).then(|| rows.concat())
}

/// Whether the accelerator counts what a map shows.
pub(crate) fn is_counted(pipeline: &Pipeline, shown: Shown) -> bool {
    let mut scratch = Scratch::within(pipeline.tree_limits(1));
    number(pipeline, shown, [0, 0], &mut scratch).is_some()
}

fn number(pipeline: &Pipeline, shown: Shown, [x, y]: [u32; 2], scratch: &mut Scratch) -> Option<f32> {
    let visited = || {
        let center = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let ray = pipeline.camera.ray(center);
        pipeline
            .scene
            .accelerator
            .traversal_statistics(&ray, Interval::FORWARD, SelfHitFilter::NOTHING)
    };
    match shown {
        Shown::Picture => None,
        Shown::Steps => visited().map(|counted| counted.steps as f32),
        Shown::Tests => visited().map(|counted| counted.tests as f32),
        Shown::Rays => {
            let before = scratch.counters.total();
            pipeline.pixel([x, y], scratch);
            Some((scratch.counters.total() - before) as f32)
        }
    }
}
