//! Measures the reference's own error in a scene (its floor).
//!
//! The reference computes in single precision and avoids self-intersection by offsetting ray
//! origins. Its own error shows when these are varied: another spawn offset, the other traversal,
//! rays perturbed by units in the last place, and mesh vertices rounded differently. A limit below
//! this error would be arbitrary.

use crate::protocol::Setting;
use whitstone_image::Image;
use whitstone_metrics::{CompareError, CompareOptions, Tolerance, compare, metrics};

/// Lower bound of the floor (2^-21): a few roundings of single precision, which every shading
/// formula has. It applies even if a scene's variations happen to cancel.
pub(crate) const SMALLEST_FLOOR: f64 = 4.8e-7;
/// Maximum limit of a scene with textures, whose coordinates the reference stores in single
/// precision.
const LARGEST_LIMIT_TEXTURED: f64 = 2e-4;

/// The variations that measure the floor.
pub(crate) fn settings() -> [Setting; 4] {
    let base = Setting::default();
    [
        Setting {
            k: 4.0 * base.k,
            ..base
        },
        Setting {
            robust: !base.robust,
            ..base
        },
        perturbed(1),
        perturbed(2),
    ]
}

/// Perturbs every number of the reference, both rays and vertices. Vertices have a rounding error
/// of their own, and it turns the facets of a fine mesh by far more than the error of a ray.
fn perturbed(seed: u32) -> Setting {
    Setting {
        ulps: 2.0,
        vertices: true,
        seed,
        ..Setting::default()
    }
}

/// The variations for POV-Ray: vertices rounded differently, longer guards against
/// self-intersection, and other roundings to half precision. Without meshes the first variation
/// changes nothing, and the driver still has its images.
pub(crate) fn settings_of_povray() -> [Setting; 3] {
    let base = Setting::default();
    [
        Setting {
            vertices: true,
            seed: 1,
            ..base
        },
        Setting {
            k: 4.0 * base.k,
            ..base
        },
        Setting {
            exposure: 1.3,
            ..base
        },
    ]
}

/// The difference between two images of the same reference.
pub(crate) struct Difference {
    /// The relative error, without the pixels in which an edge moved.
    pub(crate) error: f64,
    /// The number of pixels in which an edge moved.
    pub(crate) moved: usize,
}

/// Compares two images by the same reference.
pub(crate) fn between(reference: &Image, varied: &Image) -> Result<Difference, CompareError> {
    let edges = metrics::over_tolerance(varied, reference, Tolerance::default())?;
    let options = CompareOptions {
        exclude: Some(&edges),
        ..CompareOptions::default()
    };
    let measured = compare(varied, reference, &options)?;
    Ok(Difference {
        error: measured.rel_rmse_interior.unwrap_or(0.0),
        moved: edges.count(),
    })
}

/// The largest `rel_rmse_interior` that passes: twice the floor, but at most `cap`.
pub(crate) fn limit(floor: f64, cap: f64) -> f64 {
    (2.0 * floor).min(cap)
}

/// The largest bias of a block that passes. The bias of the whole image is at most its RMS error,
/// and a few pixels may all err in the same direction.
pub(crate) fn bias_limit(floor: f64, cap: f64) -> f64 {
    (4.0 * floor).min(cap)
}

/// The upper bound of all limits, however inaccurate the reference is. `untextured` is that of a
/// scene without textures, which depends on the renderer.
pub(crate) fn cap(untextured: f64, textured: bool) -> f64 {
    if textured {
        LARGEST_LIMIT_TEXTURED
    } else {
        untextured
    }
}
