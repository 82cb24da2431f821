//! Samples where they are needed: fewer rays for the same error.

use whitstone::render::{Film, RenderOptions};
use whitstone_tests::{load, root};

fn rendered(sampler: &str) -> Film {
    let overrides = [
        "film.width=64",
        "film.height=48",
        &format!("sampler={{ {sampler} }}"),
    ]
    .map(str::to_owned);
    let scene = root().join("scenes/samplers/adaptive.toml");
    let pipeline =
        load(&scene, &overrides, &whitstone::registry()).unwrap_or_else(|report| panic!("{report}"));
    pipeline.render(RenderOptions::default())
}

fn rmse(a: &Film, b: &Film) -> f64 {
    let pairs = a.rgb.as_flattened().iter().zip(b.rgb.as_flattened());
    let sum: f64 = pairs.map(|(x, y)| f64::from(x - y).powi(2)).sum();
    (sum / (3 * a.rgb.len()) as f64).sqrt()
}

#[test]
fn with_nothing_to_refine_they_are_the_first_ones() {
    let first = rendered("type = \"sobol\", samples = 4");
    let refined = rendered("type = \"adaptive\", samples = 256, initial_samples = 4, threshold = 1e9");
    assert!(first.rgb == refined.rgb);
    assert_eq!(first.counters.closest, refined.counters.closest);
}

#[test]
fn fewer_rays_reach_the_error_of_many() {
    let truth = rendered("type = \"grid\", samples_per_axis = 48");
    let all = rendered("type = \"sobol\", samples = 64");
    let some = rendered("type = \"adaptive\", samples = 1024, threshold = 3e-3");
    let (all_error, some_error) = (rmse(&all, &truth), rmse(&some, &truth));
    assert!(some_error < all_error, "{some_error}, of all {all_error}");
    let (rays, of_all) = (some.counters.closest, all.counters.closest);
    assert!(rays < of_all, "{rays} rays, of all {of_all}");
    // It shows that the rest is where it is needed: without it, the error is another.
    let first = rendered("type = \"sobol\", samples = 8");
    assert!(rmse(&first, &truth) > 2.0 * some_error, "{some_error}");
}
