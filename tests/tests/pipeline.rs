//! What the pipeline makes of the parts of a scene.

use std::path::Path;
use whitstone::core::Lobes;
use whitstone::scene::{Pipeline, Sources};
use whitstone_tests::build;

fn pipeline(text: &str) -> Pipeline {
    let camera = "[camera]\ntype = \"perspective\"\nlook_at = { origin = [0, 0, 5], target = [0, 0, 0] }\n";
    let sources = Sources::from_text("scene.toml", &format!("{camera}{text}"), Path::new("."), &[]);
    build(&sources.unwrap(), &whitstone::registry()).unwrap_or_else(|report| panic!("{report}"))
}

#[test]
fn constant_textures_are_colours() {
    let black = "[texture.black]\ntype = \"constant\"\nvalue = 0\n";
    for (k_refl, lobes) in [
        ("\"black\"", Lobes::LOCAL),
        ("{ type = \"constant\", value = 0 }", Lobes::LOCAL),
        (
            "{ type = \"constant\", value = 0.5 }",
            Lobes::LOCAL | Lobes::REFLECTION,
        ),
        // What a checker's squares are is not looked at.
        (
            "{ type = \"checker\", a = 0, b = 0 }",
            Lobes::LOCAL | Lobes::REFLECTION,
        ),
    ] {
        let shape = format!(
            "[[shape]]\ntype = \"sphere\"\nmaterial = {{ type = \"whitted\", k_d = 0.5, k_refl = {k_refl} }}\n"
        );
        let built = pipeline(&format!("{black}{shape}"));
        assert_eq!(built.world.materials[0].lobes(), lobes, "{k_refl}");
        let traces = !built.left_out.iter().any(|part| part.what == "reflected rays");
        assert_eq!(traces, lobes.contains(Lobes::REFLECTION), "{k_refl}");
    }
}
