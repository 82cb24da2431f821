//! How exact the reference itself is in a scene.
//!
//! The reference computes in single precision and guards against self-intersection by moving ray
//! origins. Its own error shows when these are varied: another spawn offset, the other traversal,
//! rays perturbed by units in the last place, and vertices of meshes rounded otherwise. A limit
//! below that would test luck.

use crate::driver::Setting;
use crate::renderer::Renderer;
use whitstone_image::{CompareError, CompareOptions, Image, Tolerance, compare, metrics};

/// A few roundings of single precision, which every shading formula has (2^-21): no floor is taken
/// to be below it, even if a scene's variations happen to cancel.
pub(crate) const SMALLEST_FLOOR: f64 = 4.8e-7;
/// Largest limit of a scene with textures, whose coordinates the reference has in single precision.
const LARGEST_LIMIT_TEXTURED: f64 = 2e-4;

/// The variations that the floor is measured with.
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

/// Every number of the reference moved: those of rays, and those of vertices, which have an error
/// of their own. Facets of a fine mesh turn with it by far more than a ray does.
fn perturbed(seed: u32) -> Setting {
    Setting {
        ulps: 2.0,
        vertices: true,
        seed,
        ..Setting::default()
    }
}

/// Those of POV-Ray: vertices rounded otherwise, longer guards against self-intersection, and other
/// roundings to half precision. The first, where nothing is a mesh, are the images that its driver
/// still has.
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

/// What two images by the same reference differ in.
pub(crate) struct Difference {
    /// The relative error, without the pixels where an edge moved.
    pub(crate) error: f64,
    /// How many pixels these are.
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

/// The largest `rel_rmse_interior` that passes: twice the floor, and never above the cap.
pub(crate) fn limit(floor: f64, cap: f64) -> f64 {
    (2.0 * floor).min(cap)
}

/// The largest bias of a block that passes: that of the whole image is at most its RMS error, and a
/// few pixels may all err to the same side.
pub(crate) fn bias_limit(floor: f64, cap: f64) -> f64 {
    (4.0 * floor).min(cap)
}

/// What no limit exceeds, however inexact the reference.
pub(crate) fn cap(renderer: Renderer, textured: bool) -> f64 {
    if textured {
        LARGEST_LIMIT_TEXTURED
    } else {
        renderer.largest_limit()
    }
}
