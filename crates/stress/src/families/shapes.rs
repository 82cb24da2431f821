//! Slivers, thin cylinders, thin tori and stretched instances.

use crate::lab::single;
use crate::rays::{RayFamily, Shown, clear, past, past_in_double};
use crate::{About, decades};
use whitstone_core::{DMat3, DVec3, Ray};
use whitstone_testkit::Random;

/// A triangle of length 1 and almost no width, anywhere in space.
pub(crate) static SLIVER: RayFamily = RayFamily {
    about: About {
        name: "sliver",
        catalogue: &[6],
        parameter: "length of a triangle over its width",
        measure: "relative error of t",
        promise: "16 ulp x condition, no wrong class",
        pass: 16.0,
        usable: 1e-3,
        reach: 1e8,
        floor: 4.0,
        limit: None,
    },
    parameters: || decades(0, 17),
    scene: |aspect| {
        let [a, b, c] = sliver(aspect).map(|corner| format!("{:?}", corner.to_array()));
        format!("[[shape]]\ntype = \"triangle\"\nvertices = [{a}, {b}, {c}]\n")
    },
    ray: |aspect, random| {
        let [a, b, c] = sliver(aspect);
        let inside = 0.2 + 0.2 * random.unit();
        let along = 0.5 + 0.1 * random.signed();
        let foot = a + along * (b - a);
        let target = foot + inside * (c - a - 0.5 * (b - a));
        let origin = (target + 3.0 * random.direction()).as_vec3().as_dvec3();
        let ray = single(origin, target - origin);
        // A ray almost in the plane of the triangle has no clear class.
        let normal = (b - a).cross(c - a).normalize();
        (normal.dot(ray.direction).abs() > 0.5).then_some(ray)
    },
    unit: |_, t| t,
    one_measure: false,
    shown: Shown::Nothing,
};

/// Vertices that are exact in single precision, up to the aspect ratio at which it would make them
/// collinear.
fn sliver(aspect: f64) -> [DVec3; 3] {
    let turn = DMat3::from_axis_angle(DVec3::new(1.0, -2.0, 0.5).normalize(), 0.7);
    let corners = [DVec3::ZERO, DVec3::X, DVec3::new(0.5, 1.0 / aspect, 0.0)];
    corners.map(|corner| {
        let corner = turn * corner + DVec3::new(0.3, 0.2, -0.1);
        if aspect > 1e8 {
            corner
        } else {
            corner.as_vec3().as_dvec3()
        }
    })
}

/// A thin cylinder, hit from the side.
pub(crate) static THIN_CYLINDER: RayFamily = RayFamily {
    about: About {
        name: "thin_cylinder",
        catalogue: &[25],
        parameter: "radius of a cylinder over half of its length",
        measure: "error of t, in radii",
        promise: "8 ulp x condition, no wrong class",
        pass: 8.0,
        usable: 1e-1,
        reach: 1e-8,
        floor: 4.0,
        limit: None,
    },
    parameters: || decades(-1, -18),
    scene: |radius| {
        let radius = f64::from(radius as f32);
        format!("[[shape]]\ntype = \"cylinder\"\ncaps = false\nradius = {radius:?}\nz = [-1, 1]\n")
    },
    ray: |radius, random| {
        let side = if random.below(2) == 0 { 1.0 } else { -1.0 };
        let origin = DVec3::new(
            side * clear(random) * radius,
            -3.0 - random.unit(),
            0.3 * random.signed(),
        );
        Some(single(origin, DVec3::new(0.0, 1.0, 0.1 * random.signed())))
    },
    unit: |radius, _| radius,
    one_measure: false,
    shown: Shown::Nothing,
};

/// Close to the apex of a cone, where both of its nappes meet.
pub(crate) static APEX: RayFamily = RayFamily {
    about: About {
        name: "cone_apex",
        catalogue: &[25],
        parameter: "distance of the ray from the apex of a cone",
        measure: "error of t, over the distance",
        promise: "8 ulp x condition, no wrong class",
        pass: 8.0,
        usable: 1e-1,
        reach: 1e-12,
        floor: 4.0,
        limit: None,
    },
    parameters: || decades(-1, -18),
    scene: |_| "[[shape]]\ntype = \"cone\"\ncaps = false\nradii = [1, 0]\nz = [-1, 0]\n".to_owned(),
    ray: |distance, random| {
        // Below the apex at the origin the cone is as wide as it is deep; a third of the rays pass
        // above.
        let height = if random.below(3) == 0 { 0.5 } else { -0.5 } * distance * (1.0 + random.unit());
        Some(single(
            DVec3::new(0.25 * height * random.signed(), -3.0 - random.unit(), height),
            DVec3::Y,
        ))
    },
    unit: |distance, _| distance,
    one_measure: false,
    shown: Shown::Close,
};

/// A torus with a very thin tube.
pub(crate) static THIN_TORUS: RayFamily = RayFamily {
    about: About {
        name: "torus_wire",
        catalogue: &[26],
        parameter: "minor over major radius of a torus",
        measure: "error of t, in minor radii",
        promise: "1e-6 minor radii, no wrong class",
        pass: 1e-6,
        usable: 1e-1,
        reach: 5e-6,
        floor: 4.0 * f64::EPSILON,
        limit: None,
    },
    parameters: || decades(0, -17).into_iter().map(|tube| 0.5 * tube).collect(),
    scene: |tube| torus(f64::from(tube as f32)),
    ray: |tube, random| at_torus(4.0, tube, random),
    unit: |tube, _| tube,
    one_measure: true,
    shown: Shown::Whole,
};

/// The same torus at a large distance.
pub(crate) static FAR_TORUS: RayFamily = RayFamily {
    about: About {
        name: "torus_distance",
        catalogue: &[26],
        parameter: "distance of a torus, in major radii",
        measure: "error of t, in minor radii of 0.25",
        promise: "1e-6 minor radii, no wrong class",
        pass: 1e-6,
        usable: 1e-2,
        reach: 4e6,
        floor: 4.0 * f64::EPSILON,
        limit: None,
    },
    parameters: || {
        decades(0, 14)
            .into_iter()
            .map(|distance| 4.0 * distance)
            .collect()
    },
    scene: |_| torus(0.25),
    ray: |distance, random| at_torus(distance, 0.25, random),
    unit: |_, _| 0.25,
    one_measure: true,
    shown: Shown::Whole,
};

fn torus(tube: f64) -> String {
    format!("[[shape]]\ntype = \"torus\"\nmajor_radius = 1\nminor_radius = {tube:?}\n")
}

/// A ray from above, aimed at the centre line of a torus' tube or past it.
fn at_torus(distance: f64, tube: f64, random: &mut Random) -> Option<Ray> {
    let turn = std::f64::consts::TAU * random.unit();
    let middle = DVec3::new(turn.cos(), turn.sin(), 0.0);
    let mut from = random.direction();
    from.z = from.z.abs() + 0.6;
    let origin = middle + distance * from.normalize();
    if distance > 1e7 {
        // In single precision, no ray would meet the torus.
        return past_in_double(middle, origin, 0.9 * tube * random.unit(), tube, random);
    }
    let origin = origin.as_vec3().as_dvec3();
    // At most 0.9 tube radii from the centre line: a hit. A ray that passes at a larger distance
    // may hit the other side; the oracle decides.
    past(middle, origin, 0.9 * tube * random.unit(), tube, random)
}

/// An ellipsoid, stretched and flattened.
pub(crate) static CONDITION: RayFamily = RayFamily {
    about: About {
        name: "ellipsoid_condition",
        catalogue: &[24],
        parameter: "largest over smallest semi-axis",
        measure: "relative error of t",
        promise: "16 ulp x condition, no wrong class",
        pass: 16.0,
        usable: 1e-3,
        reach: 1e12,
        floor: 4.0,
        limit: None,
    },
    parameters: || decades(0, 18),
    scene: |condition| {
        let root = condition.sqrt();
        format!(
            "[[shape]]\ntype = \"ellipsoid\"\nradii = [{root:?}, 1, {:?}]\ntransform = {{ rotate = {{ axis = [1, 2, 3], degrees = 40 }} }}\n",
            1.0 / root
        )
    },
    ray: |condition, random| {
        let turn = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 40f64.to_radians());
        let root = condition.sqrt();
        // Through a point inside.
        let inside = DVec3::new(0.7 * root * random.signed(), 0.5 * random.signed(), 0.0);
        let origin = 100.0 * random.direction() * DVec3::new(0.1, 0.1, 1.0);
        let origin = origin + DVec3::new(inside.x, 0.0, 100f64.copysign(origin.z));
        Some(single(turn * origin, turn * (inside - origin).normalize()))
    },
    unit: |_, t| t,
    one_measure: false,
    shown: Shown::Whole,
};

/// An instance of a sphere, stretched along one axis and flattened along another.
pub(crate) static INSTANCE: RayFamily = RayFamily {
    about: About {
        name: "instance_scale",
        catalogue: &[36],
        parameter: "scale factor of an instance along x, its inverse along z",
        measure: "relative error of t",
        promise: "16 ulp x condition, no wrong class",
        pass: 16.0,
        usable: 1e-3,
        reach: 1e6,
        floor: 4.0,
        limit: None,
    },
    parameters: || decades(0, 16),
    scene: |factor| {
        format!(
            "[[group.ball.shape]]\ntype = \"sphere\"\n[[shape]]\ntype = \"instance\"\ngroup = \"ball\"\ntransform = {{ scale = [{factor:?}, 1, {:?}] }}\n",
            1.0 / factor
        )
    },
    ray: |factor, random| {
        // Through a point inside the instance, or past its widest part.
        let miss = random.below(4) == 0;
        let y = if miss {
            1.2 + random.unit()
        } else {
            0.5 * random.signed()
        };
        let inside = DVec3::new(0.5 * factor * random.signed(), y, 0.0);
        let direction = DVec3::new(0.3 * random.signed(), 0.0, -1.0);
        Some(single(inside - 4.0 * direction, direction))
    },
    unit: |_, t| t,
    one_measure: false,
    shown: Shown::Whole,
};

/// Directions of any length, which is the unit of t.
pub(crate) static LENGTH: RayFamily = RayFamily {
    about: About {
        name: "direction_length",
        catalogue: &[38],
        parameter: "length of the ray direction, or its inverse",
        measure: "relative error of t",
        promise: "8 ulp x condition, no wrong class",
        pass: 8.0,
        usable: 1e-3,
        reach: 1e30,
        floor: 4.0,
        limit: None,
    },
    parameters: || {
        // Squares of later lengths overflow.
        let all = [
            1e0, 1e5, 1e10, 1e15, 1e20, 1e25, 1e30, 1e60, 1e100, 1e150, 1e160, 1e200,
        ];
        all.to_vec()
    },
    scene: |_| "[[shape]]\ntype = \"sphere\"\n".to_owned(),
    ray: |length, random| {
        let ray = past(DVec3::ZERO, 4.0 * random.direction(), clear(random), 1.0, random)?;
        let factor = if random.below(2) == 0 {
            length
        } else {
            1.0 / length
        };
        // Single precision has no such lengths.
        let direction = ray.direction * factor;
        Some(match length > 1e30 {
            true => Ray::new(ray.origin, direction),
            false => single(ray.origin, direction),
        })
    },
    unit: |_, t| t,
    one_measure: false,
    shown: Shown::Nothing,
};
