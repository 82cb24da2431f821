//! What the pipeline makes of the parts of a scene.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use whitstone::core::{Aabb, BsdfFlags, DVec3, Light, LightBounds, LightFlags, LightSample, Rgb};
use whitstone::render::{BuildOptions, Film, Pipeline, Region, RenderOptions};
use whitstone::scene::Sources;
use whitstone_tests::{bits, build, load, root};

fn pipeline(text: &str) -> Pipeline {
    let camera = "[camera]\ntype = \"perspective\"\nlook_at = { origin = [0, 0, 5], target = [0, 0, 0] }\n";
    let sources = Sources::from_text("scene.toml", &format!("{camera}{text}"), Path::new("."), &[]);
    build(&sources.unwrap(), &whitstone::registry()).unwrap_or_else(|report| panic!("{report}"))
}

#[test]
fn constant_textures_are_colours() {
    let black = "[texture.black]\ntype = \"constant\"\nvalue = 0\n";
    for (k_refl, lobes) in [
        ("\"black\"", BsdfFlags::LOCAL),
        ("{ type = \"constant\", value = 0 }", BsdfFlags::LOCAL),
        (
            "{ type = \"constant\", value = 0.5 }",
            BsdfFlags::LOCAL | BsdfFlags::REFLECTION,
        ),
        // What a checker's squares are is not looked at.
        (
            "{ type = \"checker\", a = 0, b = 0 }",
            BsdfFlags::LOCAL | BsdfFlags::REFLECTION,
        ),
    ] {
        let shape = format!(
            "[[shape]]\ntype = \"sphere\"\nmaterial = {{ type = \"whitted\", k_d = 0.5, k_refl = {k_refl} }}\n"
        );
        let built = pipeline(&format!("{black}{shape}"));
        assert_eq!(built.scene.materials[0].flags(), lobes, "{k_refl}");
        let traces = !built.omitted.iter().any(|part| part.what == "reflected rays");
        assert_eq!(traces, lobes.contains(BsdfFlags::REFLECTION), "{k_refl}");
    }
}

/// How fast the accelerator is built depends on the number of rays, and no value of the image does.
#[test]
fn few_rays_are_traced_through_a_structure_that_is_built_fast() {
    let shape = "[[shape]]\ntype = \"heightfield\"\nheight = { type = \"checker\", a = 0, b = 1, scale = 8 }\n\
                 columns = 64\nrows = 64\n[accelerator]\ntype = \"bvh\"\n";
    let camera = "[camera]\ntype = \"perspective\"\nlook_at = { origin = [0, 2, 5], target = [0, 0, 0] }\n";
    let built = |single_image: bool, sampler: &str, light: &str| {
        let text = format!("{camera}{shape}[film]\nwidth = 64\nheight = 48\n{sampler}{light}");
        let sources = Sources::from_text("scene.toml", &text, Path::new("."), &[]).unwrap();
        let options = BuildOptions {
            single_image,
            ..BuildOptions::default()
        };
        Pipeline::load(&sources, &whitstone::registry(), options)
            .unwrap_or_else(|errors| panic!("{}", sources.report(&errors, false)))
    };
    let nodes = |pipeline: &Pipeline| pipeline.scene.accelerator.statistics()["nodes"];
    let (fast, usual) = (built(true, "", ""), built(false, "", ""));
    assert_ne!(nodes(&fast), nodes(&usual));
    assert_eq!(bits(&fast, 1), bits(&usual, 1));
    // 3,072 pixels, and 32 rays for each of 8,192 triangles.
    let sampler = "[sampler]\ntype = \"grid\"\nsamples_per_axis = ";
    assert_eq!(nodes(&built(true, &format!("{sampler}9\n"), "")), nodes(&fast));
    assert_eq!(nodes(&built(true, &format!("{sampler}10\n"), "")), nodes(&usual));
    let light = "[[light]]\ntype = \"point\"\nposition = [0, 9, 0]\nintensity = 1\n";
    assert_eq!(
        nodes(&built(true, &format!("{sampler}7\n"), light)),
        nodes(&usual)
    );
}

/// Shines up, and says that it reaches nothing.
struct Shy;

impl Light for Shy {
    fn flags(&self) -> LightFlags {
        LightFlags::SAMPLES
    }
    fn samples(&self, _: DVec3, out: &mut Vec<LightSample>) {
        out.push(LightSample {
            direction: DVec3::Z,
            distance: f64::INFINITY,
            irradiance: Rgb::WHITE,
        });
    }
    fn affects_bounds(&self, _: &Aabb) -> bool {
        false
    }
}

/// Of many lights only those are asked for samples that may reach a stream of points: the picture
/// is the same, but for a light that does not say the truth.
#[test]
fn many_lights_are_culled() {
    let mut text = String::from(
        "[film]\nwidth = 48\nheight = 32\n[[shape]]\ntype = \"rectangle\"\nmaterial = { type = \"whitted\", k_d = 0.5, k_refl = 0.25 }\n\
         transform = { scale = [3, 3, 1] }\n[[shape]]\ntype = \"sphere\"\nmaterial = { type = \"phong\" }\n",
    );
    for number in 0..12 {
        let (sin, cos) = f64::from(number).sin_cos();
        text += &format!(
            "[[light]]\ntype = \"spot\"\nposition = [{}, {}, 2]\ntarget = [{}, {}, 0]\nintensity = 3\ncutoff_angle = 15\n",
            2.0 * cos,
            2.0 * sin,
            2.5 * cos,
            2.5 * sin
        );
    }
    let render = |culls: bool, lies: bool| {
        let mut built = pipeline(&text);
        if lies {
            built.scene.lights.push(Arc::new(Shy));
        }
        assert!(built.scene.culls_lights, "there are many");
        built.scene.culls_lights = culls;
        let film = built.render(RenderOptions::default());
        (film.rgb, film.counters)
    };
    let all = render(false, false);
    assert_eq!(render(true, false), all);
    assert_eq!(
        render(true, true),
        all,
        "what says that it does not reach is not asked"
    );
    assert_ne!(render(false, true), all);
}

/// A bulb that says that it is a million times fainter than it is.
struct Modest;

impl Light for Modest {
    fn flags(&self) -> LightFlags {
        LightFlags::SAMPLES
    }
    fn samples(&self, point: DVec3, out: &mut Vec<LightSample>) {
        let (direction, distance) = (DVec3::new(0.0, 0.0, 4.0) - point).normalize_and_length();
        out.push(LightSample {
            direction,
            distance,
            irradiance: Rgb::splat(100.0 / (distance * distance)),
        });
    }
    fn bounds(&self) -> Option<LightBounds> {
        Some(LightBounds {
            bounds: Aabb::around([DVec3::new(0.0, 0.0, 4.0)]),
            max_intensity: 1e-4,
        })
    }
}

/// With `light_cutoff` the hierarchy over the lights changes no image, except for a light with
/// wrong bounds; and the cutoff changes it by less than what it cuts off.
#[test]
fn faint_lights_do_not_count() {
    const COUNT: u32 = 300;
    let scene = |cutoff: f64, more: &str| {
        let mut text = format!(
            "[film]\nwidth = 48\nheight = 32\n[integrator]\ntype = \"whitted\"\nlight_cutoff = {cutoff:e}\n\
             [[shape]]\ntype = \"rectangle\"\nmaterial = {{ type = \"whitted\", k_d = 0.5, k_refl = 0.25 }}\n\
             transform = {{ scale = [3, 3, 1] }}\n\
             [[shape]]\ntype = \"sphere\"\nmaterial = {{ type = \"matte\", reflectance = 0.5 }}\n{more}"
        );
        for number in 0..COUNT {
            let place = |step: u32| f64::from(number * step % 101) / 101.0 * 6.0 - 3.0;
            text += &format!(
                "[[light]]\ntype = \"point\"\nposition = [{}, {}, 0.4]\nintensity = [0.01, 0.02, {}]\n",
                place(37),
                place(58),
                0.001 * f64::from(number % 7)
            );
        }
        pipeline(&text)
    };
    let render = |mut built: Pipeline, culls: bool, lies: bool| {
        if lies {
            built.scene.lights.push(Arc::new(Modest));
        }
        built.scene.culls_lights &= culls;
        let film = built.render(RenderOptions::default());
        (film.rgb, film.counters)
    };
    let cutoff = 0.05;
    let exact = render(scene(0.0, ""), true, false);
    let found = render(scene(cutoff, ""), true, false);
    assert!(render(scene(cutoff, ""), false, false) == found);
    assert!(2 * found.1.shadow < exact.1.shadow, "{:?} {:?}", found.1, exact.1);
    assert!(found.0 != exact.0);
    // Each light that does not count would have added at most the cutoff times 0.5, twice with the
    // reflection.
    let most = 0.5 * cutoff * 1.25 * f64::from(COUNT);
    for (found, exact) in found.0.iter().flatten().zip(exact.0.iter().flatten()) {
        let lost = f64::from(exact - found);
        assert!((-1e-6..most).contains(&lost), "{lost}");
    }
    assert!(render(scene(1e-300, ""), true, false) == exact);
    // One at a time: a nested dielectric, even if no ray meets it.
    let glass = "[[shape]]\ntype = \"sphere\"\ncenter = [0, 0, 90]\nmaterial = { type = \"dielectric\", priority = 1 }\n";
    let singly = scene(cutoff, glass);
    assert!(singly.scene.requires_scalar_tracing());
    assert!(render(singly, true, false) == found);
    // The bounds of a light are believed.
    let believed = render(scene(cutoff, ""), true, true);
    assert!(believed.0 == found.0);
    assert!(render(scene(cutoff, ""), false, true).0 != found.0);
}

/// What is left out is what would have been black: the picture is the same as with the light in
/// place.
#[test]
fn lights_that_reach_nothing_are_left_out() {
    let scene = |lights: &str, material: &str| {
        pipeline(&format!(
            "[film]\nwidth = 16\nheight = 16\n{lights}\n[[shape]]\ntype = \"sphere\"\nmaterial = {{ type = \"{material}\" }}\n"
        ))
    };
    let point = "[[light]]\ntype = \"point\"\nposition = [3, 3, 3]\nintensity = 20\n";
    let spot = |target: &str| {
        format!(
            "[[light]]\ntype = \"spot\"\nposition = [0, 3, 0]\ntarget = {target}\nintensity = 9\ncutoff_angle = 30\n"
        )
    };
    let area = |degrees: f64| {
        format!(
            "[[light]]\ntype = \"area\"\nradiance = 3\nsamples = 2\n\
             transform = [{{ rotate = {{ axis = [1, 0, 0], degrees = {degrees} }} }}, {{ translate = [0, 3, 0] }}]\n"
        )
    };
    for (light, kept) in [
        (spot("[0, 0, 0]"), 2),
        // The ball around the box ends 35.3 degrees from the middle: a cone 63 degrees aside
        // reaches it, one 67 degrees aside does not.
        (spot("[5.9, 0, 0]"), 2),
        (spot("[7.1, 0, 0]"), 1),
        (spot("[0, 6, 0]"), 1),
        (area(90.0), 2),
        (area(-90.0), 1),
        (
            "[[light]]\ntype = \"directional\"\ndirection = [0, -1, 0]\nirradiance = 0\n".to_owned(),
            1,
        ),
        (
            "[[light]]\ntype = \"point\"\nposition = [0, 9, 0]\nintensity = 0\n".to_owned(),
            1,
        ),
    ] {
        let built = scene(&format!("{point}{light}"), "matte");
        assert_eq!(built.scene.lights.len(), kept, "{light}");
        let told = built
            .omitted
            .iter()
            .any(|part| part.what.starts_with("light 2 ("));
        assert_eq!(told, kept == 1, "{light}");
        if kept == 1 {
            let alone = scene(point, "matte");
            let options = RenderOptions::default();
            assert_eq!(built.render(options).rgb, alone.render(options).rgb, "{light}");
        }
    }
    let mirror = scene(point, "mirror");
    assert_eq!(mirror.scene.lights.len(), 0);
    let why = mirror.omitted.iter().find(|part| part.what == "light 1 (point)");
    assert_eq!(why.unwrap().why, "no material in use has local illumination");
}

/// Heights are read while a mesh is built, and a slide only by the light that shows it: neither is
/// kept, nor told as what shading reads.
#[test]
fn textures_that_nothing_looks_up_any_more_are_told_and_not_kept() {
    let built = |more: &str| {
        let mesh = "type = \"mesh\"\nfile = \"icosphere_1.ply\"\ndisplacement = { height = \"relief\", scale = 0.1 }";
        let text = format!(
            "[camera]\ntype = \"perspective\"\nlook_at = {{ origin = [0, 0, 5], target = [0, 0, 0] }}\n[[light]]\ntype = \"ambient\"\nradiance = 1\n\
             [texture.relief]\ntype = \"noise\"\n[texture.spare]\ntype = \"noise\"\n[texture.white]\ntype = \"constant\"\nvalue = 1\n\
             [[shape]]\n{mesh}\n{more}"
        );
        let folder = root().join("scenes/assets");
        let sources = Sources::from_text("test", &text, &folder, &[]).unwrap();
        build(&sources, &whitstone::registry()).unwrap_or_else(|report| panic!("{report}"))
    };
    let kinds = |pipeline: &Pipeline| -> Vec<String> {
        let kinds = pipeline.textures.iter().map(|(kind, _)| kind.clone());
        kinds.collect()
    };
    let why = |pipeline: &Pipeline, what: &str| {
        let part = pipeline.omitted.iter().find(|part| part.what == what);
        part.map(|part| part.why.clone())
    };
    let read = Some("not used after the scene is built".to_owned());
    let plain = built("material = { type = \"matte\", reflectance = \"white\" }");
    assert!(kinds(&plain).is_empty());
    assert_eq!(why(&plain, "texture \"relief\""), read);
    assert_eq!(
        why(&plain, "texture \"spare\"").as_deref(),
        Some("nothing in use refers to it")
    );
    assert_eq!(why(&plain, "texture \"white\""), None);
    assert!(plain.costs().iter().all(|cost| cost.part != "textures"));
    let shaded = built("material = { type = \"matte\", reflectance = \"relief\" }");
    assert_eq!(
        (kinds(&shaded), why(&shaded, "texture \"relief\"")),
        (vec!["noise".to_owned()], None)
    );
    let other = built(
        "material = { type = \"matte\", reflectance = { type = \"checker\" } }\n[[light]]\ntype = \"projector\"\nposition = [0, 0, 9]\n\
         target = [0, 0, 10]\nintensity = 1\nimage = { type = \"worley\" }",
    );
    assert_eq!(kinds(&other), ["checker"]);
    assert_eq!(why(&other, "a texture, worley"), read);
    let cost = other.costs().into_iter().find(|cost| cost.part == "textures");
    assert!(cost.unwrap().work.starts_with("checker: looked up at hits"));
}

/// The bits of the pixels of a film, and of its layers.
fn bits_of(film: &Film, region: Region, width: u32) -> Vec<u32> {
    let place = |x: u32, y: u32| (y * width + x) as usize;
    let pixels = (region.y..region.y + region.height)
        .flat_map(|y| (region.x..region.x + region.width).map(move |x| place(x, y)));
    let layers: Vec<&Vec<f32>> = film.layers.iter().map(|(_, values)| values).collect();
    pixels
        .flat_map(|k| {
            let layers = layers.iter().map(move |values| values[k]);
            film.rgb[k]
                .into_iter()
                .chain(layers)
                .map(f32::to_bits)
                .collect::<Vec<_>>()
        })
        .collect()
}

#[test]
fn a_region_has_the_pixels_of_the_whole_image() {
    let registry = whitstone::registry();
    for (scene, changes) in [
        ("showcase/classic.toml", vec![]),
        ("samplers/adaptive.toml", vec![]),
        ("integrators/rasterizer.toml", vec![]),
        (
            "cameras/thin_lens.toml",
            vec!["film.aovs=['depth','shape_id']".to_owned()],
        ),
    ] {
        let pipeline = load(&root().join("scenes").join(scene), &changes, &registry).unwrap();
        let size = pipeline.film.size;
        let whole = pipeline.render(RenderOptions::default());
        let region = |x, y, width, height| Region { x, y, width, height };
        for part in [
            region(0, 0, size.width, size.height),
            region(17, 5, 33, 18),
            region(size.width - 1, size.height - 1, 1, 1),
            region(3, 0, 1, size.height),
        ] {
            let film = pipeline.render(RenderOptions {
                region: Some(part),
                ..RenderOptions::default()
            });
            assert_eq!((film.width, film.height), (part.width, part.height), "{scene}");
            let alone = Region { x: 0, y: 0, ..part };
            assert_eq!(
                bits_of(&film, alone, part.width),
                bits_of(&whole, part, size.width),
                "{scene}: {part:?}"
            );
        }
        // What lies outside of the image is cut off.
        let outside = pipeline.render(RenderOptions {
            region: Some(region(size.width + 5, 0, 10, 10)),
            ..RenderOptions::default()
        });
        assert!(outside.rgb.is_empty());
    }
}

#[test]
fn a_film_serves_again() {
    let registry = whitstone::registry();
    let scene = root().join("scenes/showcase/classic.toml");
    let load = |changes: &[&str]| {
        let changes: Vec<String> = changes.iter().map(|change| (*change).to_owned()).collect();
        load(&scene, &changes, &registry).unwrap()
    };
    let large = load(&["film.aovs=['depth','normal']"]);
    let small = load(&["film.width=40", "film.aovs=['shape_id']"]);
    let mut film = large.render(RenderOptions::default());
    let memory = film.rgb.as_ptr();
    for pipeline in [&small, &large, &small] {
        pipeline.render_into(RenderOptions::default(), &mut film);
        let fresh = pipeline.render(RenderOptions::default());
        let whole = |film: &Film| {
            let all = Region {
                x: 0,
                y: 0,
                width: film.width,
                height: film.height,
            };
            bits_of(film, all, film.width)
        };
        assert_eq!(whole(&film), whole(&fresh));
        assert_eq!(film.counters.closest, fresh.counters.closest);
        let names =
            |film: &Film| -> Vec<String> { film.layers.iter().map(|(name, _)| name.clone()).collect() };
        assert_eq!(names(&film), names(&fresh));
        assert_eq!(film.rgb.as_ptr(), memory, "the buffer serves again");
    }
}

#[test]
fn progress_can_stop_a_rendering() {
    let registry = whitstone::registry();
    for scene in ["showcase/classic.toml", "samplers/adaptive.toml"] {
        let pipeline = load(&root().join("scenes").join(scene), &[], &registry).unwrap();
        let whole = pipeline.render(RenderOptions::default());
        assert!(whole.is_complete);
        let calls = AtomicUsize::new(0);
        let film = pipeline.render(RenderOptions {
            threads: 1,
            progress: Some(&|_, _| match calls.fetch_add(1, Ordering::Relaxed) {
                2 => ControlFlow::Break(()),
                _ => ControlFlow::Continue(()),
            }),
            ..RenderOptions::default()
        });
        assert!(!film.is_complete);
        assert_eq!(calls.into_inner(), 3);
        // Finished pixels are those of the whole image, and the others are black.
        let equal = film
            .rgb
            .iter()
            .zip(&whole.rgb)
            .all(|(part, whole)| part == whole || *part == [0.0; 3]);
        assert!(equal, "{scene}");
        let image = film.to_image("").unwrap();
        assert_eq!(
            image.attributes().get("unfinished").map(String::as_str),
            Some("true")
        );
    }
}
