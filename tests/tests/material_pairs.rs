//! Every blend of two materials of another renderer, and each with holes, becomes a material that
//! Whitstone has: exactly, or with a note that says what stands for it.

use std::fmt::Write;
use std::fs;
use std::path::Path;
use whitstone::core::{Registry, Treatment};
use whitstone::scene::Sources;
use whitstone_tests::build;

/// Materials of Mitsuba.
const BSDFS: [(&str, &str); 11] = [
    ("diffuse", ""),
    ("dielectric", ""),
    ("thindielectric", ""),
    ("roughdielectric", ""),
    ("conductor", ""),
    ("roughconductor", ""),
    ("plastic", ""),
    ("roughplastic", ""),
    ("null", ""),
    ("mask", "<bsdf type=\"conductor\"/>"),
    ("twosided", "<bsdf type=\"roughconductor\"/>"),
];

/// Materials of pbrt, with their parameters.
const MATERIALS: [(&str, &str); 9] = [
    ("diffuse", ""),
    ("dielectric", ""),
    ("thindielectric", ""),
    ("conductor", "\"float roughness\" 0"),
    ("conductor", "\"float roughness\" 0.3"),
    ("coatedconductor", ""),
    ("coateddiffuse", "\"float roughness\" 0"),
    ("diffusetransmission", ""),
    ("interface", ""),
];

/// Reads and builds a scene; returns the approximated features.
fn approximated(path: &Path, text: &str, registry: &Registry) -> Vec<&'static str> {
    fs::write(path, text).unwrap();
    let sources = Sources::load(path, &[], registry)
        .unwrap_or_else(|error| panic!("{}\n{text}", error.sources.report(&error.errors, false)));
    build(&sources, registry).unwrap_or_else(|report| panic!("{report}\n{text}"));
    let notes = sources.notes().iter().flat_map(|(_, notes)| notes);
    let features = notes.map(|note| note.feature);
    let features = features.filter(|feature| feature.treatment == Treatment::Approximated);
    features.map(|feature| feature.name).collect()
}

fn xml(bsdf: &str) -> String {
    format!(
        "<scene version=\"3.0.0\"><sensor type=\"perspective\"/>\
         <emitter type=\"point\"/><shape type=\"sphere\">{bsdf}</shape></scene>"
    )
}

#[test]
fn all_blends_and_masks_of_mitsuba_can_be_imported() {
    let registry = whitstone::registry();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.xml");
    let bsdf = |(name, inner): (&str, &str)| format!("<bsdf type=\"{name}\">{inner}</bsdf>");
    let (mut exact, mut parts) = (0, 0);
    for a in BSDFS {
        for b in BSDFS {
            let weight = "<float name=\"weight\" value=\"0.7\"/>";
            let text = xml(&format!(
                "<bsdf type=\"blendbsdf\">{weight}{}{}</bsdf>",
                bsdf(a),
                bsdf(b)
            ));
            match approximated(&path, &text, &registry).contains(&"blendbsdf of two directions") {
                true => parts += 1,
                false => exact += 1,
            }
        }
        for opacity in ["0.3", "0.7"] {
            let opacity = format!("<float name=\"opacity\" value=\"{opacity}\"/>");
            let text = xml(&format!("<bsdf type=\"mask\">{opacity}{}</bsdf>", bsdf(a)));
            let told = approximated(&path, &text, &registry).contains(&"mask of glass");
            assert_eq!(told, ["dielectric", "roughdielectric"].contains(&a.0), "{text}");
        }
    }
    assert!(
        exact > parts && parts > 0,
        "{exact} exact, {parts} as their larger part"
    );
}

#[test]
fn all_mixes_of_pbrt_can_be_imported() {
    let registry = whitstone::registry();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.pbrt");
    let (mut exact, mut parts) = (0, 0);
    for (a, of_a) in MATERIALS {
        for (b, of_b) in MATERIALS {
            let mut text = "Camera \"perspective\"\nWorldBegin\nLightSource \"point\"\n".to_owned();
            for (name, material, parameters) in [("a", a, of_a), ("b", b, of_b)] {
                writeln!(
                    text,
                    "MakeNamedMaterial \"{name}\" \"string type\" \"{material}\" {parameters}"
                )
                .unwrap();
            }
            text += "Material \"mix\" \"string materials\" [\"a\" \"b\"] \"float amount\" 0.7\n\
                     Shape \"sphere\" \"float alpha\" 0.5\n";
            match approximated(&path, &text, &registry).contains(&"Material mix of two directions") {
                true => parts += 1,
                false => exact += 1,
            }
        }
    }
    assert!(
        exact > parts && parts > 0,
        "{exact} exact, {parts} as their larger part"
    );
}

/// What remains is the larger part.
#[test]
fn the_larger_part_remains() {
    let registry = whitstone::registry();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.xml");
    for (weight, kept, left) in [("0.3", "mirror", "glossy"), ("0.7", "glossy", "mirror")] {
        let parts = "<bsdf type=\"conductor\"/><bsdf type=\"roughconductor\"/>";
        let weight = format!("<float name=\"weight\" value=\"{weight}\"/>");
        let bsdf = format!("<bsdf type=\"twosided\"><bsdf type=\"blendbsdf\">{weight}{parts}</bsdf></bsdf>");
        fs::write(&path, xml(&bsdf)).unwrap();
        let sources =
            Sources::load(&path, &[], &registry).unwrap_or_else(|error| panic!("{:?}", error.errors));
        let imported = whitstone::scene::Description::parse(&sources)
            .into_result()
            .unwrap();
        let text = imported.flattened.text;
        assert!(text.contains(kept) && !text.contains(left), "{text}");
    }
}
