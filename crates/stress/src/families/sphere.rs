//! Spheres that are far away, huge, tangent to rays, or just in front of the camera.

use crate::lab::single;
use crate::rays::{RayFamily, Shown, clear, past, past_in_double};
use crate::{About, decades};
use whitstone_core::{DVec3, Ray};

/// Distances in radii beyond which coordinates in single precision cannot describe a sphere and a
/// ray that meets it. Beyond it, the rays are exact in double precision only.
const SINGLE: f64 = 1e8;

const ULPS: &str = "8 ulp x condition, no wrong class";

/// A distant unit sphere: a naive discriminant loses all digits where t² is much larger than r².
pub(crate) static DISTANCE: RayFamily = RayFamily {
    about: About {
        name: "sphere_distance",
        catalogue: &[1],
        parameter: "distance over radius",
        measure: "error of t, in radii",
        promise: ULPS,
        pass: 8.0,
        usable: 1e-3,
        reach: 2e7,
        floor: 4.0,
        limit: None,
    },
    parameters: || {
        decades(0, 16)
            .into_iter()
            .map(|distance| 2.0 * distance)
            .collect()
    },
    scene: |_| "[[shape]]\ntype = \"sphere\"\n".to_owned(),
    ray: |distance, random| {
        let origin = distance * random.direction();
        let (miss, center) = (clear(random), DVec3::ZERO);
        match distance > SINGLE {
            true => past_in_double(center, origin, miss, 1.0, random),
            false => past(center, origin, miss, 1.0, random),
        }
    },
    unit: |_, _| 1.0,
    one_measure: false,
    shown: Shown::Whole,
};

/// A planet of any radius, seen from two units above it.
pub(crate) static PLANET: RayFamily = RayFamily {
    about: About {
        name: "planet",
        catalogue: &[2],
        parameter: "radius over half of the height of the camera",
        measure: "relative error of t",
        promise: ULPS,
        pass: 8.0,
        usable: 1e-3,
        reach: 1e8,
        floor: 4.0,
        limit: None,
    },
    parameters: || decades(0, 19),
    scene: |radius| {
        format!(
            "[[shape]]\ntype = \"sphere\"\ncenter = [0, {:?}, 0]\nradius = {radius:?}\n",
            -radius
        )
    },
    ray: |radius, random| {
        // The camera at (0, 2, 0), the centre and the radius are exact in single precision.
        let (center, miss) = (-radius * DVec3::Y, 0.95 * random.unit() * radius);
        past(center, 2.0 * DVec3::Y, miss, radius, random)
    },
    unit: |_, t| t,
    one_measure: false,
    shown: Shown::Whole,
};

/// Rays that pass just above or below the top of a sphere. Their height is exact in single
/// precision, because the sphere lies below the origin.
pub(crate) static TANGENT: RayFamily = RayFamily {
    about: About {
        name: "tangent",
        catalogue: &[2],
        parameter: "distance of the ray from tangency, in radii",
        measure: "error of t, in radii",
        promise: ULPS,
        pass: 8.0,
        usable: 1e-1,
        reach: 1e-14,
        floor: 4.0,
        limit: None,
    },
    parameters: || decades(-1, -19),
    scene: |_| "[[shape]]\ntype = \"sphere\"\ncenter = [0, -1, 0]\n".to_owned(),
    ray: |height, random| {
        let side = if random.below(3) == 0 { 1.0 } else { -1.0 };
        let origin = DVec3::new(-3.0 - random.unit(), side * height * (1.0 + random.unit()), 0.0);
        Some(single(origin, DVec3::X))
    },
    unit: |_, _| 1.0,
    one_measure: false,
    shown: Shown::Close,
};

/// The camera just above a sphere, looking down at it.
pub(crate) static NEAR: RayFamily = RayFamily {
    about: About {
        name: "near_surface",
        catalogue: &[18],
        parameter: "height of the camera above a unit sphere",
        measure: "error of t, over the height",
        promise: ULPS,
        pass: 8.0,
        usable: 1e-3,
        reach: 1e-9,
        floor: 4.0,
        limit: None,
    },
    parameters: || decades(-1, -19),
    scene: |_| "[[shape]]\ntype = \"sphere\"\ncenter = [0, -1, 0]\n".to_owned(),
    ray: |height, random| {
        let direction = random.direction();
        let down = DVec3::new(direction.x, -direction.y.abs() - 0.5, direction.z).normalize();
        Some(single(height * DVec3::Y, down))
    },
    unit: |height, _| height,
    one_measure: false,
    shown: Shown::Whole,
};

/// A sphere at a position that is exact in single precision, seen from nearby.
pub(crate) static OFFSET: RayFamily = RayFamily {
    about: About {
        name: "world_offset",
        catalogue: &[3],
        parameter: "distance of the scene from the origin, in radii",
        measure: "error of t, in radii",
        promise: ULPS,
        pass: 8.0,
        usable: 1e-3,
        reach: 1e8,
        floor: 4.0,
        limit: None,
    },
    parameters: || decades(0, 17),
    scene: |offset| {
        let [x, y, z] = place(offset).to_array();
        format!("[[shape]]\ntype = \"sphere\"\ncenter = [{x:?}, {y:?}, {z:?}]\n")
    },
    ray: |offset, random| {
        let center = place(offset);
        // Coordinates that are exact in single precision: at 1e8 it holds every eighth integer.
        let origin = center + 16.0 * random.direction();
        if offset > SINGLE {
            let ray = past_in_double(center, origin, clear(random), 1.0, random);
            return ray.filter(|ray| (ray.origin - center).length() > 1.5);
        }
        let origin = origin.as_vec3().as_dvec3();
        let outside = (origin - center).length() > 1.5;
        let ray: Option<Ray> = past(center, origin, clear(random), 1.0, random);
        ray.filter(|_| outside)
    },
    unit: |_, _| 1.0,
    one_measure: false,
    shown: Shown::Whole,
};

fn place(offset: f64) -> DVec3 {
    DVec3::new(offset, -offset, 0.5 * offset).as_vec3().as_dvec3()
}
