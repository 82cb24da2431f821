//! Renders a turntable: one scene, of which each frame moves the camera.

use std::error::Error;
use std::f64::consts::TAU;
use std::ops::ControlFlow;
use whitstone::core::{DuplicateType, Registry};
use whitstone::image::exr_io;
use whitstone::render::{Film, Region, RenderOptions};
use whitstone::{Change, Scene, SceneOptions};

const SCENE: &str = r#"
film = { width = 160, height = 120 }
camera = { type = "perspective", look_at = { origin = [0, 2, 6], target = [0, 1, 0] } }
shape = [
    { type = "sphere", center = [0, 1, 0], material = { type = "dielectric", interior_ior = 1.5 } },
    { type = "plane", transform = { rotate = { axis = [1, 0, 0], degrees = -90 } }, material = "floor" },
]
light = [
    { type = "point", position = [3, 5, 4], intensity = 60 },
    { type = "background", radiance = [0.3, 0.5, 0.8] },
]
material = { floor = { type = "matte", reflectance = { type = "checker" } } }
"#;

const FRAMES: u32 = 4;

/// Only the plugins whose features `Cargo.toml` names exist in this program.
fn plugins() -> Result<Registry, DuplicateType> {
    let mut registry = Registry::default();
    whitstone_accelerators::register(&mut registry)?;
    whitstone_cameras::register(&mut registry)?;
    whitstone_integrators::register(&mut registry)?;
    whitstone_lights::register(&mut registry)?;
    whitstone_materials::register(&mut registry)?;
    whitstone_samplers::register(&mut registry)?;
    whitstone_shapes::register(&mut registry)?;
    whitstone_textures::register(&mut registry)?;
    Ok(registry)
}

fn main() -> Result<(), Box<dyn Error>> {
    let options = SceneOptions::with_registry(plugins()?);
    let scene = Scene::parse_with(SCENE, ".", &[], options)?;
    // Its buffers serve for every frame.
    let mut film = Film::default();
    for frame in 0..FRAMES {
        let (sin, cos) = (TAU * f64::from(frame) / f64::from(FRAMES)).sin_cos();
        let origin = vec![6.0 * sin, 2.0, 6.0 * cos];
        let turned = scene.with(&[Change::new("camera.look_at.origin", origin)])?;
        let options = RenderOptions {
            progress: Some(&|done, total| {
                if done == total {
                    eprintln!("frame {frame}: {total} pixels");
                }
                ControlFlow::Continue(())
            }),
            ..RenderOptions::default()
        };
        turned.render_into(options, &mut film);
        exr_io::write(format!("frame-{frame}.exr"), &film.to_image("")?)?;
    }

    // A part of the image has the pixels of the whole.
    let whole = scene.render()?;
    let region = Region {
        x: 70,
        y: 50,
        width: 20,
        height: 20,
    };
    let part = scene.render_with(RenderOptions {
        region: Some(region),
        ..RenderOptions::default()
    });
    let [red, ..] = whole.rgb()?;
    assert_eq!(part.rgb[0][0].to_bits(), red[50 * 160 + 70].to_bits());

    // A plugin that is not in this program is an error that says so.
    let error = scene.with(&[Change::parse("shape.0={type='torus'}")]);
    println!("{}", error.err().ok_or("the torus is not here")?);
    Ok(())
}
