//! `bake`: converts assets for file-based plugins.

use crate::terminal::{Exit, Failure, color, progress};
use clap::{Args, Subcommand};
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use whitstone_core::{DVec3, Registry, Rgb, SceneErrors};
use whitstone_image::{Image, atomic, exr_io};
use whitstone_render::{BuildOptions, Pipeline, RenderOptions};
use whitstone_scene::Sources;

/// Convert assets for file-based plugins, such as a sky or a scene for the light `environment`
#[derive(Args, Debug)]
#[command(
    arg_required_else_help = true,
    help_template = super::HELP_TEMPLATE,
    after_help = "Examples:\n  whitstone bake cubemap sky.exr --size 256 -o sky\n  whitstone bake cubemap scenes/showcase/room.toml --at 0 1 0"
)]
pub struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    Cubemap(Cubemap),
}

/// Convert a sky, or a scene seen from a point, to the six cube faces of the light `environment`
/// (`faces`)
///
/// FOLDER gets px.exr, nx.exr, py.exr, ny.exr, pz.exr and nz.exr with linear values, and
/// faces.toml, a scene with only this light. To use it, write `include = ["FOLDER/faces.toml"]` at
/// the top of a scene, or copy the light, which is also printed. Existing files of these names are
/// replaced.
///
/// With --at, the faces are six renderings of a scene from this point. Each texel is the mean over
/// n x n positions, where n is the value of --samples. A reflection that is looked up in the faces
/// is that of a surface at this point; at another place it is shifted. --near hides the object that
/// reflects them.
///
/// Of a sky, each texel is the mean of the sky over points of its square that are no further apart
/// than the texels of the picture. The faces differ from the picture by less than 1.1 h G, where h
/// = 2/SIZE is the distance of texels in the middle of a face in radians (the largest distance),
/// and G is the greatest change of the sky per radian. Where the sky is smooth, the difference is
/// about h^2 times its curvature, except within half a texel of the cube's edges, where a face is
/// not blended with its neighbours.
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Examples:\n  whitstone bake cubemap sky.exr --size 256 -o sky\n  whitstone bake cubemap scenes/showcase/room.toml --at 0 1 0 --near 0.5 -o room"
)]
struct Cubemap {
    /// Latitude-longitude picture, twice as wide as high: PNG, JPEG (both sRGB) or EXR (linear). -z
    /// is at its middle, +x to the right of it, +y at its top. With --at: a scene file
    #[arg(value_name = "PICTURE")]
    picture: PathBuf,
    /// The point in world space from which a scene is seen
    #[arg(long, num_args = 3, value_names = ["X", "Y", "Z"], allow_negative_numbers = true)]
    at: Option<Vec<f64>>,
    /// Surfaces of the scene that are nearer to the point than this, in metres, are not seen
    #[arg(long, value_name = "METRES", default_value_t = 0.0, requires = "at")]
    near: f64,
    /// Samples of each texel along a side, 1 to 64
    #[arg(long, value_name = "COUNT", default_value_t = 4, requires = "at", value_parser = clap::value_parser!(u32).range(1..=64))]
    samples: u32,
    /// Width and height of each face in texels, at most 4096 [default: a quarter of the picture's
    /// width, which matches the picture's resolution at its horizon; of a scene 256]
    #[arg(long, value_name = "TEXELS", value_parser = clap::value_parser!(u32).range(1..=4096))]
    size: Option<u32>,
    /// Folder for the files, created if needed [default: the picture's name without its extension,
    /// in the working folder]
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    match &arguments.what {
        What::Cubemap(cubemap) => cubemap.bake(registry),
    }
}

/// The faces: name, viewing direction, and up direction, as in section 7 of the model.
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
        let folder = match &self.output {
            Some(folder) => folder.clone(),
            None => PathBuf::from(self.picture.file_stem().unwrap_or_default()),
        };
        let size = match self.at.as_deref() {
            Some(&[x, y, z]) => {
                let view = SceneView {
                    at: DVec3::new(x, y, z),
                    near: self.near,
                    size: self.size.unwrap_or(256),
                    samples: self.samples,
                };
                view.bake(&self.picture, &folder, registry)?;
                view.size as usize
            }
            _ => self.bake_sky(&folder, registry)?,
        };
        println!(
            "{}: six faces of {size} x {size} texels, and faces.toml:\n",
            folder.display()
        );
        crate::terminal::out(format_args!("{}", snippet()));
        Ok(Exit::Pass)
    }

    /// Returns the size of the faces.
    fn bake_sky(&self, folder: &Path, registry: &Registry) -> Result<usize, Failure> {
        let picture = &self.picture;
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
        create(folder)?;
        let bar = progress(6 * size as u64, "baking");
        for (name, forward, up) in FACES {
            let row = |j| {
                bar.inc(1);
                (0..size).map(move |i| [i, j])
            };
            let texels = (0..size).flat_map(row).map(|texel| {
                let seen = |direction| sky.scene.background(direction);
                mean(texel, size, parts, |a, c| {
                    seen((forward + a * forward.cross(up) + c * up).normalize())
                })
            });
            write_face(folder, name, size, &texels.collect::<Vec<_>>())?;
        }
        bar.finish_and_clear();
        write_light(folder)?;
        Ok(size)
    }
}

fn create(folder: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).map_err(|error| Failure::usage(format!("{}: {error}", folder.display())))
}

fn write_face(folder: &Path, name: &str, size: usize, texels: &[[f32; 3]]) -> Result<(), Failure> {
    let image = Image::from_rgb(size, size, texels).map_err(Failure::usage)?;
    exr_io::write(folder.join(format!("{name}.exr")), &image).map_err(Failure::environment)
}

/// Writes the scene that contains only the light.
fn write_light(folder: &Path) -> Result<(), Failure> {
    atomic::write_bytes(folder.join("faces.toml"), snippet().as_bytes()).map_err(Failure::environment)
}

/// How the faces of a cube see a scene.
pub struct SceneView {
    /// The middle of the cube in world space.
    pub at: DVec3,
    /// Surfaces nearer to it than this, in metres, are not seen; >= 0.
    pub near: f64,
    /// Width and height of a face in texels.
    pub size: u32,
    /// Samples of a texel along each side, 1 to 64.
    pub samples: u32,
}

impl SceneView {
    /// Renders a scene by six cameras and writes the faces and `faces.toml` to a folder, which is
    /// created if needed.
    ///
    /// # Errors
    ///
    /// If the point or `near` is not finite, if the scene is wrong, or if a file cannot be written.
    pub fn bake(&self, scene: &Path, folder: &Path, registry: &Registry) -> Result<(), Failure> {
        let Self {
            at,
            near,
            size,
            samples,
        } = *self;
        if !(at.is_finite() && near.is_finite() && near >= 0.0) {
            let message = "--at: expected three finite numbers, and --near: a finite number of at least 0";
            return Err(Failure::usage(message));
        }
        let bar = progress(6, "rendering");
        for (number, (name, forward, up)) in FACES.into_iter().enumerate() {
            // So far away that it differs from the point.
            let target = at + (1.0 + at.abs().max_element()) * forward;
            let list = |v: DVec3| format!("[{:?}, {:?}, {:?}]", v.x, v.y, v.z);
            let overrides = [
                format!("film={{ width = {size}, height = {size} }}"),
                format!("sampler={{ type = \"grid\", samples_per_axis = {samples} }}"),
                format!(
                    "camera={{ type = \"perspective\", fov = 90, near = {near:?}, near_kind = \"spherical\", \
                     look_at = {{ origin = {}, target = {}, up = {} }} }}",
                    list(at),
                    list(target),
                    list(up)
                ),
            ];
            let sources = Sources::load(scene, &overrides, registry)
                .map_err(|error| Failure::usage(error.sources.report(&error.errors, color())))?;
            let pipeline = Pipeline::load(&sources, registry, BuildOptions::default())
                .map_err(|errors| Failure::usage(sources.report(&errors, color())))?;
            if number == 0 {
                create(folder)?;
            }
            let film = pipeline.render(RenderOptions::default());
            write_face(folder, name, size as usize, &film.rgb)?;
            bar.inc(1);
        }
        bar.finish_and_clear();
        write_light(folder)
    }
}

/// A scene that contains only the picture as its environment.
fn sky(picture: &Path, registry: &Registry) -> Result<Pipeline, Failure> {
    let name = picture.file_name().and_then(|name| name.to_str());
    let Some(name) = name else {
        return Err(Failure::usage(format!(
            "{}: expected the path of an image file",
            picture.display()
        )));
    };
    // JSON strings are valid TOML strings.
    let text = format!(
        "[camera]\ntype = \"perspective\"\nlook_at = {{ origin = [0, 0, 1], target = [0, 0, 0] }}\n[[light]]\ntype = \"environment\"\n\
         radiance = {{ type = \"image\", file = {}, wrap = [\"repeat\", \"clamp\"] }}\n",
        serde_json::Value::from(name)
    );
    let folder = picture.parent().unwrap_or(Path::new(""));
    // An error is an error of the picture: the user has not written the scene around it.
    let failure = |errors: SceneErrors| Failure::usage(errors);
    let sources = Sources::from_text("sky", &text, folder, &[]).map_err(|error| failure(error.errors))?;
    Pipeline::load(&sources, registry, BuildOptions::default()).map_err(failure)
}

/// The mean of `seen` over `parts` x `parts` points of the texel at a column and row. `seen`
/// returns the sky for a position on the face, from -1 to 1 to the right and up.
fn mean([i, j]: [usize; 2], size: usize, parts: usize, seen: impl Fn(f64, f64) -> Rgb) -> [f32; 3] {
    let at =
        |texel: usize, part: usize| (2 * (texel * parts + part) + 1) as f64 / (size * parts) as f64 - 1.0;
    let all = (0..parts * parts).map(|part| seen(at(i, part % parts), -at(j, part / parts)));
    let mean = all.sum::<Rgb>() * (1.0 / (parts * parts) as f64);
    mean.to_array().map(|value| value as f32)
}

/// The TOML text of the light.
fn snippet() -> String {
    let faces = FACES.map(|(name, ..)| format!("faces.{name}.file = \"{name}.exr\"\n"));
    format!("[[light]]\ntype = \"environment\"\n{}", faces.concat())
}
