//! Instruction counts, by callgrind, of the kernels in which rendering spends its time. They are
//! the same in every run, so a change of 1% is visible on any machine, however busy. They are not
//! times: callgrind models neither AVX-512 nor memory latency.
//!
//! ```text
//! cargo install gungraun-runner --version 0.20.0     # and valgrind
//! cargo bench -p whitstone-benches
//! ```
//!
//! Each benchmark traces a stream of 256 rays.

#![allow(
    missing_docs,
    unused_qualifications,
    reason = "the macros write public functions, and names in full"
)]

use gungraun::{library_benchmark, library_benchmark_group, main};
use std::hint::black_box;
use whitstone_benches::{Tile, Traced, closest_shape, closest_single, intersect};
use whitstone_core::{Accelerator, LoweredShape};

#[library_benchmark]
#[bench::node(whitstone_benches::node())]
#[bench::leaf(whitstone_benches::leaf())]
#[bench::hit(whitstone_benches::hit())]
fn single(traced: Traced<Box<dyn Accelerator>>) -> usize {
    black_box(closest_single(black_box(&traced)))
}

#[library_benchmark]
#[bench::node(whitstone_benches::node())]
#[bench::leaf(whitstone_benches::leaf())]
#[bench::hit(whitstone_benches::hit())]
fn stream(mut traced: Traced<Box<dyn Accelerator>>) -> usize {
    black_box(intersect(black_box(&mut traced), |bvh, rays, hits| {
        bvh.intersect_stream(rays, hits);
    }))
}

#[library_benchmark]
#[bench::sphere(whitstone_benches::sphere())]
#[bench::cuboid(whitstone_benches::cuboid())]
#[bench::triangle(whitstone_benches::triangle())]
fn shape(mut traced: Traced<LoweredShape>) -> usize {
    black_box(intersect(black_box(&mut traced), closest_shape))
}

#[library_benchmark]
#[bench::perspective(whitstone_benches::camera())]
fn camera(mut tile: Tile) -> f64 {
    tile.camera.ray_stream(black_box(&tile.raster), &mut tile.rays);
    black_box(tile.rays.direction.get(0).x)
}

library_benchmark_group!(name = kernels, benchmarks = [single, stream, shape, camera]);
main!(library_benchmark_groups = kernels);
