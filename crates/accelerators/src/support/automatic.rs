//! Chooses the accelerator of a scene that leaves the choice.

use crate::support::elements::{MAX_ELEMENTS, check_count};
use whitstone_core::{Element, FamilyName, Geometry, LoweredShape, Registry};

/// Maximum cost, in tests of whole shapes, for which testing every element is faster than any
/// acceleration structure. Measured with random spheres, boxes and triangles: the rates cross at
/// about 160 whole shapes or 40 triangles.
const BRUTE_FORCE_LIMIT: usize = 128;

/// Cost of a triangle, in tests of whole shapes.
const TRIANGLE_COST: usize = 4;

/// Cost of an instance of a group: mostly the test of its box.
const INSTANCE_COST: usize = 4;

/// The type to use, and the reason.
pub(crate) fn choose(geometry: &Geometry, registry: &Registry) -> (String, String) {
    let cost = |element: Element| match (element, &geometry.shapes()[element.shape() as usize]) {
        (Element::Triangle { .. }, _) => TRIANGLE_COST,
        (_, LoweredShape::Instance(_)) => INSTANCE_COST,
        (Element::Custom { .. }, _) => 1,
    };
    let elements = geometry.elements().take(BRUTE_FORCE_LIMIT + 1);
    let cost: usize = elements.map(cost).sum();
    let few = cost <= BRUTE_FORCE_LIMIT;
    let available = |name: &str| registry.get(FamilyName::Accelerator, name).is_ok();
    // Where there are too many elements to number, the accelerator reports it.
    let ask = !few && available("bvh2") && check_count(geometry, MAX_ELEMENTS).is_ok();
    let obstacle = if ask { obstacle(geometry) } else { None };
    let (wanted, why) = if few {
        (
            "brute_force",
            "few elements: testing each one is fastest".to_owned(),
        )
    } else if let Some(why) = obstacle {
        ("bvh2", why)
    } else {
        ("bvh", "too many elements to test each one".to_owned())
    };
    let other = if few { "bvh" } else { "brute_force" };
    if !available(wanted) && available(other) {
        (
            other.to_owned(),
            format!("this program was built without \"{wanted}\""),
        )
    } else {
        (wanted.to_owned(), why)
    }
}

#[cfg(feature = "bvh")]
use crate::support::precision::obstacle;
#[cfg(not(feature = "bvh"))]
fn obstacle(_: &Geometry) -> Option<String> {
    None
}
