//! What rays carry of their neighbours is where these neighbours go: through cameras, mirrors and
//! glass, on shapes of all kinds.

use schemars::JsonSchema;
use serde::Deserialize;
use std::path::Path;
use std::sync::Arc;
use whitstone::core::{
    Context, DVec2, Plugin, Registry, Rgb, SceneErrors, Scratch, SurfaceAttributes, SurfaceInteraction,
    Texture, Textures,
};
use whitstone::render::{Pipeline, RenderOptions};
use whitstone::scene::Sources;
use whitstone_tests::build;

/// Shows where it is looked up, or how far the neighbours are, with a factor that makes up for
/// their smallness.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Config {
    /// 0: the place; 1 and 2: the step to the right and down.
    show: u8,
}

struct Probe(u8);

const FACTOR: f64 = 1e3;

impl Plugin<Textures> for Probe {
    const TYPE: &'static str = "probe";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Texture>, SceneErrors> {
        Ok(Arc::new(Self(config.show)))
    }
}

impl Texture for Probe {
    fn needs(&self) -> SurfaceAttributes {
        SurfaceAttributes::UV | SurfaceAttributes::FOOTPRINT
    }

    /// The third channel tells what is left of it on the way to the camera.
    fn value(&self, point: &SurfaceInteraction) -> Rgb {
        let shown = match self.0 {
            0 => point.uv,
            side => FACTOR * point.footprint.uv[usize::from(side) - 1].as_dvec2(),
        };
        Rgb::new(shown.x, shown.y, 1.0)
    }
}

const CAMERA: &str =
    "type = \"perspective\"\nlook_at = { origin = [0.2, 0.3, 5], target = [0.1, 0, 0] }\nfov = 40\n";

fn pipeline(camera: &str, film: &str, scene: &str, show: u8) -> Pipeline {
    let mut registry: Registry = whitstone::registry();
    registry.add::<Textures, Probe>("tests").unwrap();
    let text = format!(
        "[film]\n{film}\n[camera]\n{camera}\n[[light]]\ntype = \"ambient\"\nradiance = 1\n\
         [texture.probe]\ntype = \"probe\"\nshow = {show}\n\
         [material.probe]\ntype = \"matte\"\nreflectance = \"probe\"\n{scene}"
    );
    let sources = Sources::from_text("scene.toml", &text, Path::new("."), &[]);
    build(&sources.unwrap(), &registry).unwrap_or_else(|report| panic!("{report}"))
}

/// The first two channels of a pixel, without what was lost on the way; none where the probe is not
/// seen.
fn shown(pipeline: &Pipeline, pixel: [u32; 2]) -> Option<DVec2> {
    let found = pipeline.pixel(pixel, &mut Scratch::default());
    (found.b > 0.0).then(|| DVec2::new(found.r, found.g) / found.b)
}

/// Compares steps with the differences between pixels, which are small: with 16000 of them across,
/// a step and the way to the next pixel differ by about as much as neighbouring pixels differ,
/// which is what `tolerance` is about.
fn agree(camera: &str, scene: &str, tolerance: f64) {
    let fine = "width = 16000\nheight = 16000";
    let [place, right, down] = [0, 1, 2].map(|show| pipeline(camera, fine, scene, show));
    let mut compared = 0;
    for k in 0..49 {
        let [x, y] = [k % 7, k / 7].map(|k| 3000 + 1571 * k);
        let at = |x, y| shown(&place, [x, y]);
        let (Some(here), Some(there), Some(below)) = (at(x, y), at(x + 1, y), at(x, y + 1)) else {
            continue;
        };
        for (told, beside) in [(&right, there), (&down, below)] {
            // Angles start anew after a turn.
            let change = beside - here;
            let change = change - change.round();
            let step = shown(told, [x, y]).unwrap() / FACTOR;
            // Pixels on either side of an edge are no neighbours.
            if change.length() > 100.0 * step.length() + 1e-3 {
                continue;
            }
            assert!(
                (step - change).length() <= tolerance * change.length() + 1e-10,
                "{scene}\nat {x}, {y}: told {step}, found {change}"
            );
            compared += 1;
        }
    }
    assert!(compared >= 20, "{scene}\nonly {compared} to compare");
}

fn shape(keys: &str) -> String {
    format!("[[shape]]\nmaterial = \"probe\"\n{keys}\n")
}

#[test]
fn camera_rays_on_shapes_of_all_kinds() {
    let turned = "{ rotate = { axis = [1, 2, 0], degrees = 35 } }";
    for keys in [
        "type = \"plane\"",
        "type = \"rectangle\"",
        "type = \"disk\"",
        "type = \"box\"",
        "type = \"sphere\"\nradius = 1.5",
        "type = \"ellipsoid\"\nradii = [1.5, 1, 1.2]",
        "type = \"cylinder\"",
        "type = \"cone\"",
        "type = \"torus\"",
        "type = \"prism\"\noutline = [[-1, -1], [1.2, -1], [0, 1.5]]\ny = [-1, 1]",
        "type = \"lathe\"\noutline = [[0, -1], [1.2, -0.8], [0.9, 0.9], [0, 1.1]]",
        "type = \"polygon\"\nvertices = [[-1, -1, 0], [2, -1, 0], [0, 2, 0]]",
        "type = \"triangle\"\nvertices = [[-1, -1, 0], [2, -1, 0], [0, 2, 0]]\nuvs = [[0, 0], [1, 0], [0.2, 1]]",
    ] {
        agree(CAMERA, &shape(&format!("{keys}\ntransform = [{turned}]")), 2e-2);
    }
    // Other cameras, and a copy that is stretched.
    let wall = shape(
        "type = \"rectangle\"\ntransform = [{ scale = 3 }, { rotate = { axis = [0, 1, 0], degrees = 60 } }]",
    );
    for camera in [
        "type = \"orthographic\"\nlook_at = { origin = [0, 0, 5], target = [0, 0.2, 0] }\nwidth = 3\n",
        "type = \"thin_lens\"\nlook_at = { origin = [0, 0, 5], target = [0, 0.2, 0] }\naperture = 0.1\nfocus_distance = 4\nlens_samples = 1\n",
    ] {
        agree(camera, &wall, 2e-2);
    }
    let copy = "[[group.ball.shape]]\ntype = \"sphere\"\nmaterial = \"probe\"\n[[shape]]\ntype = \"instance\"\ngroup = \"ball\"\n\
                transform = [{ scale = [1.6, 1, 1.2] }, { rotate = { axis = [1, 2, 0], degrees = 35 } }]\n";
    agree(CAMERA, copy, 2e-2);
}

#[test]
fn neighbours_stay_neighbours_in_mirrors_and_glass() {
    let wall = shape("type = \"rectangle\"\ntransform = [{ scale = 30 }, { translate = [0, 0, 20] }]");
    let floor = shape(
        "type = \"rectangle\"\ntransform = [{ scale = 30 }, { rotate = { axis = [1, 0, 0], degrees = -70 } }, { translate = [0, -9, 0] }]",
    );
    let mirror = "material = { type = \"mirror\", reflectance = 0.9 }";
    for bent in [
        "type = \"rectangle\"\ntransform = [{ scale = 2 }, { rotate = { axis = [1, 1, 0], degrees = 30 } }]",
        "type = \"sphere\"\nradius = 1.8",
        "type = \"ellipsoid\"\nradii = [2, 1.5, 1.1]",
        "type = \"torus\"\nmajor_radius = 1.4\nminor_radius = 0.5",
    ] {
        agree(
            CAMERA,
            &format!("{wall}{floor}[[shape]]\n{bent}\n{mirror}\n"),
            5e-2,
        );
    }
    let glass = "material = { type = \"dielectric\", interior_ior = 1.3 }";
    // The way straight through only.
    let through = "[integrator]\ntype = \"whitted\"\nmin_contribution = 0.5\n";
    let wall = shape("type = \"rectangle\"\ntransform = [{ scale = 30 }, { translate = [0, 0, -6] }]");
    for bent in [
        "type = \"box\"\ntransform = [{ rotate = { axis = [1, 1, 0], degrees = 30 } }]",
        "type = \"sphere\"\nradius = 1.8",
        "type = \"ellipsoid\"\nradii = [2, 1.5, 1.1]",
    ] {
        agree(
            CAMERA,
            &format!("{through}{wall}[[shape]]\n{bent}\n{glass}\n"),
            5e-2,
        );
    }
}

/// Streams give the same footprints as single rays, after as many bounces as there are, and so does
/// a world that leaves nothing out.
#[test]
fn streams_spread_as_single_rays_do() {
    let scene = shape("type = \"plane\"\ntransform = [{ translate = [0, 0, -4] }]")
        + &shape("type = \"rectangle\"\ntransform = [{ scale = 9 }, { translate = [0, 0, 9] }]")
        + "[[shape]]\ntype = \"sphere\"\nmaterial = { type = \"dielectric\" }\n\
           [[shape]]\ntype = \"sphere\"\ncenter = [1.6, 0.2, 0.4]\nradius = 0.7\nmaterial = { type = \"mirror\" }\n\
           [sampler]\ntype = \"grid\"\nsamples_per_axis = 2\n";
    let film = "width = 21\nheight = 17";
    let built = pipeline(CAMERA, film, &scene, 1);
    assert!(built.scene.reads_footprints());
    let rendered = built.render(RenderOptions::default());
    let mut scratch = Scratch::default();
    for (number, found) in (0..).zip(&rendered.rgb) {
        let single = built.pixel([number % 21, number / 21], &mut scratch);
        let expected = single.to_array().map(|c| c as f32);
        assert_eq!(found.map(f32::to_bits), expected.map(f32::to_bits), "{number}");
    }
    let mut whole = pipeline(CAMERA, film, &scene, 1);
    whole.scene = whole.scene.without_specialization();
    assert_eq!(whole.render(RenderOptions::default()).rgb, rendered.rgb);
    // More samples lie closer together.
    let more = scene.replace("samples_per_axis = 2", "samples_per_axis = 4");
    let sum = |pipeline: &Pipeline| pipeline.camera_differential([3, 4], 0).unwrap().direction[0].length();
    let ratio = sum(&built) / sum(&pipeline(CAMERA, film, &more, 1));
    assert!((ratio - 2.0).abs() < 1e-2, "{ratio}");
}

#[test]
fn rays_carry_nothing_where_no_texture_asks() {
    let text = "[camera]\ntype = \"perspective\"\nlook_at = { origin = [0, 0, 5], target = [0, 0, 0] }\n[[shape]]\ntype = \"plane\"\n\
                material = { type = \"matte\", reflectance = { type = \"checker\" } }\n";
    let sources = Sources::from_text("scene.toml", text, Path::new("."), &[]);
    let built = build(&sources.unwrap(), &whitstone::registry()).unwrap_or_else(|report| panic!("{report}"));
    assert!(!built.scene.reads_footprints());
    assert_eq!(built.camera_differential([0, 0], 0), None);
    assert!(built.omitted.iter().any(|part| part.what == "footprints of rays"));
}
