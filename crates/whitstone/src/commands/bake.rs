//! `bake`: files of what a plugin shows, for another one that reads files.

use crate::terminal::{Exit, Failure, progress};
use clap::{Args, Subcommand};
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use whitstone_core::{DVec3, Registry, Rgb, SceneErrors};
use whitstone_image::{Image, atomic, exr_io};
use whitstone_scene::{Description, Pipeline, Plan, Sources};

/// Write files of what a plugin shows, for another one that reads files
#[derive(Args, Debug)]
#[command(arg_required_else_help = true)]
pub struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    Cubemap(Cubemap),
}

/// Turn a sky by latitude and longitude into the six faces of a cube, which the light `environment`
/// takes as `faces`
///
/// FOLDER gets px.exr, nx.exr, py.exr, ny.exr, pz.exr and nz.exr, with linear values, and
/// faces.toml, a scene with this light alone: to use it, write `include = ["FOLDER/faces.toml"]` at
/// the top of a scene, or copy the light, which is printed too. What was there under these names is
/// replaced.
///
/// A texel is the mean of the sky at points of its square that are no further apart than the texels
/// of the picture. What the faces show differs from what the picture shows by less than 1.1 h G: h
/// = 2/SIZE is the distance of texels in the middle of a face in radians, where they are widest
/// apart, and G the greatest change of the sky per radian. Where the sky is smooth it is about h^2
/// times its curvature, but for half a texel along the edges of the cube, where faces are not
/// blended with their neighbours.
#[derive(Args, Debug)]
#[command(after_help = "Example:\n  whitstone bake cubemap sky.exr --size 256 -o sky")]
struct Cubemap {
    /// A picture by latitude and longitude, twice as wide as high: PNG, JPEG (both sRGB) or EXR
    /// (linear); -z is in its middle, +x to the right of it, +y at its top
    #[arg(value_name = "PICTURE")]
    picture: PathBuf,
    /// Side of the faces in texels [default: a quarter of the picture's width, which is as fine as
    /// the picture at its horizon]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=4096))]
    size: Option<u32>,
    /// The folder for the files, made if it is not there [default: the picture's name without its
    /// ending, in the working folder]
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    match &arguments.what {
        What::Cubemap(cubemap) => cubemap.bake(registry),
    }
}

/// The faces: name, where it looks, and what is up there, as section 7 of the model has them.
const FACES: [(&str, DVec3, DVec3); 6] = [
    ("px", DVec3::X, DVec3::Y),
    ("nx", DVec3::NEG_X, DVec3::Y),
    ("py", DVec3::Y, DVec3::Z),
    ("ny", DVec3::NEG_Y, DVec3::NEG_Z),
    ("pz", DVec3::Z, DVec3::Y),
    ("nz", DVec3::NEG_Z, DVec3::Y),
];

impl Cubemap {
    fn bake(&self, registry: &Registry) -> Result<Exit, Failure> {
        let Self { picture, output, .. } = self;
        let sky = sky(picture, registry)?;
        let size = sky.textures.first().and_then(|(_, texture)| texture.size());
        let [width, height] = size.unwrap_or([4, 2]);
        if width != 2 * height {
            eprintln!(
                "warning: {} is {width} x {height}: expected a picture twice as wide as high",
                picture.display()
            );
        }
        let fine = width.div_ceil(4);
        let size = self.size.map_or(fine.min(4096), |size| size as usize);
        // The picture's texels are 2 pi/width radians apart, those in the middle of a face 2/size.
        let parts = (width.max(2 * height) as f64 / (PI * size as f64)).ceil() as usize;
        let folder = match output {
            Some(folder) => folder.clone(),
            None => PathBuf::from(picture.file_stem().unwrap_or_default()),
        };
        std::fs::create_dir_all(&folder)
            .map_err(|error| Failure::usage(format!("{}: {error}", folder.display())))?;
        let bar = progress(6 * size as u64, "baking");
        for (name, forward, up) in FACES {
            let row = |j| {
                bar.inc(1);
                (0..size).map(move |i| [i, j])
            };
            let texels = (0..size).flat_map(row).map(|texel| {
                let seen = |direction| sky.world.background(direction);
                mean(texel, size, parts, |a, c| {
                    seen((forward + a * forward.cross(up) + c * up).normalize())
                })
            });
            let texels: Vec<[f32; 3]> = texels.collect();
            let image = Image::from_rgb(size, size, &texels).map_err(Failure::usage)?;
            exr_io::write(folder.join(format!("{name}.exr")), &image).map_err(Failure::environment)?;
        }
        bar.finish_and_clear();
        let light = snippet();
        atomic::write_bytes(folder.join("faces.toml"), light.as_bytes()).map_err(Failure::environment)?;
        println!(
            "{}: six faces of {size} x {size} texels, and faces.toml:\n",
            folder.display()
        );
        crate::terminal::out(format_args!("{light}"));
        Ok(Exit::Pass)
    }
}

/// A scene of nothing but the picture all around.
fn sky(picture: &Path, registry: &Registry) -> Result<Pipeline, Failure> {
    let name = picture.file_name().and_then(|name| name.to_str());
    let Some(name) = name else {
        return Err(Failure::usage(format!(
            "{}: no name of a picture",
            picture.display()
        )));
    };
    // A text of JSON is one of TOML.
    let text = format!(
        "[camera]\ntype = \"perspective\"\nlook_at = {{ origin = [0, 0, 1], target = [0, 0, 0] }}\n[[light]]\ntype = \"environment\"\n\
         radiance = {{ type = \"image\", file = {}, wrap = [\"repeat\", \"clamp\"] }}\n",
        serde_json::Value::from(name)
    );
    let folder = picture.parent().unwrap_or(Path::new(""));
    // What is wrong is wrong with the picture: the scene around it is of no interest.
    let told = |errors: SceneErrors| Failure::usage(errors);
    let sources = Sources::from_text("sky", &text, folder, &[]).map_err(|error| told(error.errors))?;
    let description = Description::parse(&sources).map_err(told)?;
    let plan = Plan::new(&description, registry).map_err(told)?;
    Pipeline::build(&plan, registry).map_err(told)
}

/// Of a texel by column and row, over `parts` x `parts` points of its square; `seen` is the sky by
/// the place on the face, from -1 to 1 to the right and up.
fn mean([i, j]: [usize; 2], size: usize, parts: usize, seen: impl Fn(f64, f64) -> Rgb) -> [f32; 3] {
    let at =
        |texel: usize, part: usize| (2 * (texel * parts + part) + 1) as f64 / (size * parts) as f64 - 1.0;
    let all = (0..parts * parts).map(|part| seen(at(i, part % parts), -at(j, part / parts)));
    let mean = all.sum::<Rgb>() * (1.0 / (parts * parts) as f64);
    mean.to_array().map(|value| value as f32)
}

/// The light.
fn snippet() -> String {
    let faces = FACES.map(|(name, ..)| format!("faces.{name}.file = \"{name}.exr\"\n"));
    format!("[[light]]\ntype = \"environment\"\n{}", faces.concat())
}
