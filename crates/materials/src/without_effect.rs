//! Materials around others, with parameters that make them have no effect: every response is that
//! of the material inside.

use crate::support::detail::{Detail, Detailed};
use crate::{
    conductor::Conductor, dielectric::Dielectric, emissive::Emissive, glossy::Glossy, mask::Mask,
    matte::Matte, mix::Mix, rough::Rough, thin_dielectric::ThinDielectric, two_sided::TwoSided,
    whitted::Whitted,
};
use std::sync::Arc;
use whitstone_core::config::MaterialRef;
use whitstone_core::{DVec3, Material, Materials, Plugin, Resources, SurfaceAttributes, SurfaceInteraction};
use whitstone_testkit::{TestContext, build_in, materials_agree};

/// Materials with every kind of response: local illumination, emission, holes, sharp and spread
/// reflection and refraction.
const INSIDE: [&str; 9] = [
    "matte", "lamp", "net", "gold", "glossy", "pane", "glass", "frosted", "varnish",
];

fn context() -> TestContext {
    TestContext::default()
        .with_material::<Matte>("matte", "reflectance = 0.5")
        .with_material::<Emissive>("lamp", "radiance = 3\nmaterial = \"matte\"")
        .with_material::<Mask>("net", "material = \"lamp\"\nopacity = 0.25")
        .with_material::<Conductor>("gold", "metal = \"Au\"")
        .with_material::<Glossy>("glossy", "samples = 3")
        .with_material::<ThinDielectric>("pane", "tint = 0.5")
        .with_material::<Dielectric>("glass", "absorption = 2\nexterior_absorption = 3")
        .with_material::<Rough>("frosted", "material = \"glass\"\nsamples = 4")
        .with_material::<Whitted>("varnish", "")
}

fn build<P: Plugin<Materials>>(text: &str) -> Arc<dyn Material> {
    build_in::<Materials, P>(text, (), &mut context()).unwrap()
}

/// The material with this name.
fn inside(name: &str) -> Arc<dyn Material> {
    let reference = MaterialRef {
        span: 0..0,
        material: name.into(),
    };
    context().material(&reference).unwrap()
}

fn refracts(name: &str) -> bool {
    ["glass", "frosted", "varnish"].contains(&name)
}

#[test]
fn one_that_emits_nothing() {
    for name in INSIDE {
        let found = build::<Emissive>(&format!("radiance = 0\nmaterial = \"{name}\""));
        materials_agree(&*found, &*inside(name));
    }
}

#[test]
fn one_without_holes() {
    for name in INSIDE.into_iter().filter(|name| !refracts(name)) {
        let found = build::<Mask>(&format!("opacity = 1\nmaterial = \"{name}\""));
        materials_agree(&*found, &*inside(name));
    }
}

#[test]
fn a_mixture_of_one() {
    for name in INSIDE {
        let expected = inside(name);
        for (order, weight) in [(["lamp", name], 1), ([name, "lamp"], 0)] {
            let [a, b] = order;
            let found = build::<Mix>(&format!("a = \"{a}\"\nb = \"{b}\"\nweight = {weight}"));
            assert_eq!(found.flags(), expected.flags());
            materials_agree(&*found, &*expected);
        }
    }
}

#[test]
fn equal_sides() {
    for name in INSIDE {
        let found = build::<TwoSided>(&format!("front = \"{name}\"\nback = \"{name}\""));
        materials_agree(&*found, &*inside(name));
    }
}

/// The normal that is there already.
struct Unchanged;

impl Detail for Unchanged {
    fn needs(&self) -> SurfaceAttributes {
        SurfaceAttributes::NOTHING
    }

    fn normal(&self, point: &SurfaceInteraction) -> Option<DVec3> {
        Some(point.n_s)
    }
}

#[test]
fn a_normal_that_is_there_already() {
    for name in INSIDE {
        let inner = inside(name);
        let found = Detailed {
            detail: Unchanged,
            inner: inner.clone(),
        };
        materials_agree(&found, &*inner);
    }
}
