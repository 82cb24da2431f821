//! Implicit surfaces that wind faster and faster.

use crate::rays::{RayFamily, Shown};
use crate::{About, decades};
use whitstone_core::Ray;

/// A bar that is twisted into a screw thread: a ray passes many turns, and must stop at the first
/// that it meets. More turns than an implementation can follow must be refused.
pub(crate) static TWIST: RayFamily = RayFamily {
    about: About {
        name: "twist",
        catalogue: &[],
        parameter: "twist of an implicit bar of two metres, in degrees per metre",
        measure: "error of t, in metres; a ray that skips a turn is off by more",
        promise: "4 ulp x condition, no wrong class",
        pass: 4.0,
        usable: 1e-6,
        reach: 3e5,
        floor: 4.0,
        limit: None,
    },
    parameters: || {
        let mut all = decades(1, 6);
        all.insert(5, 3e5);
        all
    },
    scene: |rate| {
        format!(
            "[[shape]]\ntype = \"implicit\"\n\
             field.twist = {{ degrees_per_metre = {rate:?}, of = {{ box = {{ half = [0.8, 0.1, 1] }} }} }}\n"
        )
    },
    ray: |_, random| {
        let origin = 2.0 * random.direction();
        Some(Ray::new(origin, random.cube() - origin))
    },
    unit: |_, _| 1.0,
    one_measure: false,
    shown: Shown::Whole,
};
