//! Numbers at the lower end of double precision: ray components that are nearly zero, and tiny
//! scenes.
//!
//! Below 2e-308 doubles lose precision bit by bit, and processors may take a hundred times as long
//! for them. The diagram shows whether all steps take about the same time.

use crate::About;
use crate::rays::{RayFamily, Several, Shown, clear, past};
use whitstone_core::{DVec3, Ray};
use whitstone_testkit::Random;

/// Rays that are almost parallel to an axis, at shapes with almost zero coordinates. In single
/// precision most of these numbers are zero.
pub(crate) static ALMOST_ZERO: Several = Several(&[
    almost_zero(|k| format!("[[shape]]\ntype = \"sphere\"\ncenter = [{k:?}, -{k:?}, {k:?}]\n")),
    almost_zero(|_| "[[shape]]\ntype = \"box\"\n".to_owned()),
    almost_zero(|_| "[[shape]]\ntype = \"rectangle\"\n".to_owned()),
    almost_zero(|k| {
        format!(
            "[[shape]]\ntype = \"triangle\"\nvertices = [[-1, -1, {k:?}], [1, -1, -{k:?}], [{k:?}, 1, {k:?}]]\n"
        )
    }),
    almost_zero(|_| "[[shape]]\ntype = \"mesh\"\nfile = \"assets/star.obj\"\n".to_owned()),
]);

const fn almost_zero(scene: fn(f64) -> String) -> RayFamily {
    RayFamily {
        about: About {
            name: "almost_zero",
            catalogue: &[39],
            parameter: "components of directions and coordinates that are almost zero",
            measure: "relative error of t",
            promise: "16 ulp x condition, no wrong class",
            pass: 16.0,
            usable: 1e-3,
            reach: 1e-320,
            floor: 4.0,
            limit: None,
        },
        parameters: || {
            let all = [
                1e-10, 1e-20, 1e-40, 1e-80, 1e-160, 1e-240, 1e-290, 1e-300, 1e-310, 1e-320,
            ];
            all.to_vec()
        },
        scene,
        ray: down,
        unit: |_, t| t,
        one_measure: false,
        shown: Shown::Nothing,
    }
}

/// Down along z with lateral components of this size.
fn down(size: f64, random: &mut Random) -> Option<Ray> {
    let mut place = [0, 1].map(|_| f64::from((1.3 * random.signed()) as f32));
    let mut across = [0, 1].map(|_| (size * (1.0 + random.unit())).copysign(random.signed()));
    // One ray in four runs in the plane of a box face, towards it. There, reciprocals of almost
    // zero components meet zeros.
    if random.below(4) == 0 {
        let axis = random.below(2);
        place[axis] = 1f64.copysign(random.signed());
        across[axis] = across[axis].copysign(-place[axis]);
    }
    let direction = DVec3::new(across[0], across[1], -1.0);
    Some(Ray::new(DVec3::new(place[0], place[1], 3.0), direction))
}

/// Tiny scenes. From 1e-77 m down, the square of a triangle's area underflows, and it counts as
/// degenerate. From 1e-154 m down, the square of a radius underflows, and the radius is refused.
pub(crate) static ALMOST_NOTHING: Several = Several(&[
    almost_nothing(|s| format!("[[shape]]\ntype = \"sphere\"\nradius = {s:?}\n")),
    almost_nothing(|s| format!("[[shape]]\ntype = \"box\"\ntransform = {{ scale = {s:?} }}\n")),
    almost_nothing(|s| {
        format!(
            "[[shape]]\ntype = \"triangle\"\nvertices = [[-{s:?}, -{s:?}, 0], [{s:?}, -{s:?}, 0], [0, {s:?}, 0]]\n"
        )
    }),
]);

const fn almost_nothing(scene: fn(f64) -> String) -> RayFamily {
    RayFamily {
        about: About {
            name: "almost_nothing",
            catalogue: &[39],
            parameter: "size of a scene, in metres",
            measure: "relative error of t",
            promise: "16 ulp x condition, no wrong class down to 1e-70 m; a triangle below 1e-77 m has no normal",
            pass: 16.0,
            usable: 1e-3,
            reach: 1e-70,
            floor: 4.0,
            limit: None,
        },
        parameters: || vec![1.0, 1e-10, 1e-20, 1e-30, 1e-40, 1e-50, 1e-60, 1e-70],
        scene,
        ray: |size, random| {
            // The ray for a scene of normal size, in single precision, scaled down.
            let ray = past(DVec3::ZERO, 4.0 * random.direction(), clear(random), 1.0, random)?;
            Some(Ray::new(size * ray.origin, ray.direction))
        },
        unit: |_, t| t,
        one_measure: false,
        shown: Shown::Whole,
    }
}
