//! The families of test cases.

mod ball;
mod camera;
mod coincident;
mod denormals;
mod floor_lamp;
mod footprint;
mod gaps;
mod glass_stack;
mod horizon;
mod intensity;
mod optics;
mod relief;
mod scale;
mod shapes;
mod sky;
mod solids;
mod sphere;
mod twist;

use crate::Family;

/// All families, in the order of the catalogue.
pub static FAMILIES: [&dyn Family; 43] = [
    &sphere::DISTANCE,
    &sphere::PLANET,
    &sphere::TANGENT,
    &sphere::OFFSET,
    &solids::TINY,
    &scale::PowerOfTwo,
    &scale::ENLARGED,
    &scale::SHRUNK,
    &shapes::SLIVER,
    &gaps::Leaks,
    &gaps::ShadowGap,
    &coincident::Coincident,
    &gaps::ThinPane,
    &solids::Shell,
    &twist::TWIST,
    &optics::IndexNearOne,
    &optics::CriticalAngle,
    &gaps::ParallelMirrors,
    &ball::InsideBall,
    &ball::GrazingGallery,
    &sphere::NEAR,
    &camera::WideView,
    &camera::Telephoto,
    &optics::PhongExponent,
    &optics::NearLamp,
    &floor_lamp::LightOnSurface,
    &intensity::IntensityRange,
    &horizon::Horizon,
    &footprint::FilterFootprint,
    &shapes::CONDITION,
    &shapes::THIN_CYLINDER,
    &shapes::APEX,
    &shapes::THIN_TORUS,
    &shapes::FAR_TORUS,
    &shapes::INSTANCE,
    &glass_stack::GlassStack,
    &shapes::LENGTH,
    &denormals::ALMOST_ZERO,
    &denormals::ALMOST_NOTHING,
    &optics::Absorption,
    &sky::POLE,
    &sky::SEAM,
    &relief::Relief,
];

/// Cases of the catalogue without a parameter to sweep: number, title, and the file with their
/// tests.
pub const ELSEWHERE: [(u32, &str, &str); 19] = [
    (
        8,
        "double hits at edges and vertices",
        "crates/testkit/src/solids.rs",
    ),
    (
        9,
        "rays along axes in the planes of faces",
        "crates/accelerators/tests/degenerate.rs",
    ),
    (
        10,
        "rays that leave a surface do not meet it again",
        "crates/testkit/src/shapes.rs",
    ),
    (
        12,
        "among coplanar surfaces the lowest number is hit",
        "crates/testkit/src/accelerators.rs",
    ),
    (
        28,
        "Lipschitz bounds, true and false",
        "crates/shapes/src/implicit.rs",
    ),
    (29, "depth of fractals", "crates/shapes/src/fractal.rs"),
    (
        30,
        "densities close to the iso value",
        "crates/shapes/src/isosurface.rs",
    ),
    (
        31,
        "patches with a degenerate edge or a cusp",
        "crates/shapes/src/patch/tests.rs",
    ),
    (
        32,
        "rays through the corners of cells",
        "crates/accelerators/tests/degenerate.rs",
    ),
    (
        33,
        "all splits in one plane",
        "crates/accelerators/tests/degenerate.rs",
    ),
    (
        34,
        "a million primitives at one place",
        "crates/accelerators/tests/degenerate.rs",
    ),
    (
        35,
        "sizes from 1e-6 to 1e6 in one scene",
        "crates/accelerators/tests/identity.rs",
    ),
    (
        37,
        "singular and mirrored instances",
        "crates/shapes/src/instance.rs",
    ),
    (
        41,
        "NaN and infinity in meshes and scenes",
        "tests/tests/bad_scenes.rs",
    ),
    (
        42,
        "empty scenes, meshes and solids",
        "crates/accelerators/tests/degenerate.rs",
    ),
    (45, "any number of threads", "tests/tests/determinism.rs"),
    (
        46,
        "all accelerators on random scenes",
        "crates/accelerators/tests/identity.rs",
    ),
    (47, "white furnace tests", "crates/testkit/src/materials.rs"),
    (
        22,
        "radiance is linear in the lights",
        "crates/testkit/src/materials.rs",
    ),
];

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use std::path::Path;

    #[test]
    fn every_case_of_the_catalogue_has_its_place() {
        let here = FAMILIES.iter().flat_map(|family| family.about().catalogue);
        let here: BTreeSet<u32> = here.copied().collect();
        let elsewhere = ELSEWHERE.iter().map(|(number, ..)| *number);
        let mut all: Vec<u32> = here.into_iter().chain(elsewhere).collect();
        all.sort_unstable();
        assert_eq!(all, (1..=47).collect::<Vec<_>>());
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        for (_, what, file) in ELSEWHERE {
            assert!(root.join(file).is_file(), "{what}: {file}");
        }
    }

    #[test]
    fn names_are_unique_and_parameters_are_monotonic() {
        let names: BTreeSet<_> = FAMILIES.iter().map(|family| family.about().name).collect();
        assert_eq!(names.len(), FAMILIES.len());
        for family in FAMILIES {
            let parameters = family.parameters();
            let rises = parameters.is_sorted_by(|a, b| a < b);
            assert!(
                parameters.len() > 3 && (rises || parameters.is_sorted_by(|a, b| a > b)),
                "{}",
                family.about().name
            );
        }
    }
}
