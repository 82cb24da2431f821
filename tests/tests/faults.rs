//! Faults that are put in on purpose: each must be found.
//!
//! Faults are tried against the stored references, and against a live Mitsuba where its environment
//! is there (`cargo xtask validate` makes it) or a live POV-Ray where that is installed; otherwise
//! the live tests are listed as ignored. Where a fault can be tried in both ways, each eighth one
//! is tried live, and the others are not unless asked for, since all of them take minutes:
//! `cargo test --profile ci -p whitstone-tests --test faults -- --include-ignored`.

use libtest_mimic::{Arguments, Failed, Trial};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use whitstone::core::{
    Aabb, Accelerator, Accelerators, Context, Geometry, Interval, LoweredShape, Plugin,
    PreliminaryIntersection, Ray, Registry, Rgb, SceneErrors, SelfHitFilter, Shape, ShapeHit, Shapes,
    Statistics, SurfaceAttributes, SurfaceInteraction, Texture, Textures, Transform,
};
use whitstone::image::{Image, Limits, Raster, exr_io, texels};
use whitstone::validate::environment::Environment;
use whitstone::validate::{CaseResult, Installation, Mode, Options, REFERENCES, Renderer, Status, Validator};
use whitstone_accelerators::brute_force::{self, BruteForce};
use whitstone_shapes::sphere::{self, Sphere};
use whitstone_textures::image;

/// Changes our image before it is compared.
type Tamper = fn(&mut Image);

struct Fault {
    name: &'static str,
    reference: Renderer,
    scene: &'static str,
    /// `--set` of our side only.
    overrides: fn() -> Vec<String>,
    tamper: Tamper,
    /// What the result must show.
    found: fn(&CaseResult) -> bool,
}

/// Every how many faults one is tried live, where both ways are possible.
const IN_TURN: usize = 8;

const CLASSIC: &str = "scenes/showcase/classic.toml";

fn unexplained(case: &CaseResult) -> bool {
    case.unexplained > 0
}

fn none() -> Vec<String> {
    Vec::new()
}

fn set(text: &str) -> Vec<String> {
    vec![text.to_owned()]
}

const FAULTS: [Fault; 41] = [
    Fault {
        reference: Renderer::MITSUBA,
        name: "a mixture of both sides of an edge",
        scene: CLASSIC,
        overrides: none,
        tamper: mix_an_edge,
        found: |case| case.ambiguous + case.unexplained == 1,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "light 1% brighter",
        scene: CLASSIC,
        overrides: || set("light[0].intensity=60.6"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "normal of the glass flipped",
        scene: CLASSIC,
        overrides: || set("shape.glass.type=flipped_sphere"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "image shifted by one pixel",
        scene: CLASSIC,
        overrides: none,
        tamper: shift,
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "index of refraction 1.501 for 1.5",
        scene: CLASSIC,
        overrides: || set("shape.glass.material.interior_ior=1.501"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "spawn offset a thousand times that of the reference",
        scene: CLASSIC,
        overrides: || set("accelerator.type=far_spawn"),
        tamper: |_| {},
        found: |case| case.unexplained().is_over() || case.interior().is_over(),
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "one NaN",
        scene: CLASSIC,
        overrides: none,
        tamper: |image| poke(image, 5000, f32::NAN),
        found: |case| case.nonfinite == 1,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "one infinity",
        scene: CLASSIC,
        overrides: none,
        tamper: |image| poke(image, 7000, f32::INFINITY),
        found: |case| case.nonfinite == 1,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "one wrong texel",
        scene: "scenes/showcase/textured_mesh.toml",
        overrides: || vec![format!("texture.picture.file='{}'", wrong_picture().display())],
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "levels of a pyramid off by 0.02",
        scene: "scenes/showcase/horizon_trilinear.toml",
        overrides: || set("texture.ground.type=biased_image"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "levels of ellipses off by 0.02",
        scene: "scenes/showcase/horizon_ewa.toml",
        overrides: || set("texture.ground.type=biased_image"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "one shape casts no shadow",
        scene: CLASSIC,
        overrides: || set("accelerator.type=no_shadow"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "one wrong pixel",
        scene: CLASSIC,
        overrides: none,
        tamper: |image| poke(image, 150 * 192 + 96, 0.123),
        found: |case| case.unexplained == 1,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "a bias below the tolerance in one block",
        scene: CLASSIC,
        overrides: none,
        tamper: bias,
        found: |case| {
            case.unexplained == 0
                && case
                    .signed_block_bias
                    .is_some_and(|block| block.bias.abs() > case.bias_limit)
        },
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "emission 1% brighter",
        scene: "scenes/materials/emissive.toml",
        overrides: || set("shape.lamp.material.radiance=[1.515, 1.212, 0.606]"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "k of a metal off by 1%",
        scene: "scenes/materials/conductor.toml",
        overrides: || set("shape.patterned.material.k=[2.02, 1.01, 3.03]"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "a pane of index 1.34 for 1.33",
        scene: "scenes/materials/thin_dielectric.toml",
        overrides: || set("shape.bubble.material.interior_ior=1.34"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "a mask without its holes",
        scene: "scenes/materials/mask.toml",
        overrides: || set("shape.ghost.material.opacity=1"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "a mix of 0.21 for 0.2",
        scene: "scenes/materials/mix.toml",
        overrides: || set("shape.varnished.material.weight=0.21"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "the back like the front",
        scene: "scenes/materials/two_sided.toml",
        overrides: || set("shape.sheet.material.back={ type = 'matte', reflectance = [0.1, 0.5, 0.2] }"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "shadows that are not filtered",
        scene: "scenes/showcase/filtered_shadows.toml",
        overrides: || set("integrator.shadows=opaque"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "a filter off by 1%",
        scene: "scenes/showcase/filtered_shadows.toml",
        overrides: || set("shape.lectures.material.k_refr=[0.9, 0.404, 0.7]"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "a tangent off by half a degree",
        scene: "scenes/materials/normal_map.toml",
        overrides: || set("shape.wall.material.tangent=[1, 0.01, 0]"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "bumps 2% higher",
        scene: "scenes/materials/bump.toml",
        overrides: || set("shape.orange.material.scale=0.0306"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "a reflection traced, not looked up",
        scene: "scenes/materials/reflection_map.toml",
        overrides: || set("shape.looked_up.material={ type = 'mirror', reflectance = [1, 0.9, 0.8] }"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "vectors of a displacement 2% longer",
        scene: "scenes/showcase/displacement_vectors.toml",
        overrides: || set("shape.ball.displacement.scale=0.357"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "vectors of bumps 2% longer",
        scene: "scenes/showcase/bump_vectors.toml",
        overrides: || set("shape.voxels.material.scale=0.408"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "an entry of a BRDF's table 5% larger",
        scene: "scenes/materials/tabulated.toml",
        overrides: || set("shape.cloth.material.values.1.1=0.063"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "a lobe of exponent 61 for 60",
        scene: "scenes/materials/glossy.toml",
        overrides: || set("shape.brushed.material.exponent=61"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "rough glass of exponent 408 for 400",
        scene: "scenes/materials/rough.toml",
        overrides: || set("shape.ground.material.exponent=408"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "a coat of index 1.505 for 1.5",
        scene: "scenes/materials/plastic.toml",
        overrides: || set("shape.smooth.material.interior_ior=1.505"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA,
        name: "an area light with 25 points for 16",
        scene: "scenes/lights/area.toml",
        overrides: || set("light[0].samples=5"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::POVRAY,
        name: "a colour wrong by 1%",
        scene: "scenes/showcase/lecture_phong.toml",
        overrides: || set("shape.dull.material.k_d=[0.707, 0.2, 0.15]"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::POVRAY,
        name: "a sphere shifted by a millimetre",
        scene: "scenes/showcase/lecture_phong.toml",
        overrides: || set("shape.shiny.center=[0.151, 0.6, -0.6]"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::POVRAY,
        name: "an exponent of 204 for 200",
        scene: "scenes/showcase/lecture_phong.toml",
        overrides: || set("shape.shiny.material.exponent=204"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::POVRAY,
        name: "an index of refraction of 1.501 for 1.5",
        scene: "scenes/materials/dielectric.toml",
        overrides: || set("shape.clear.material.interior_ior=1.501"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::POVRAY,
        name: "one wrong pixel",
        scene: "scenes/materials/dielectric.toml",
        overrides: none,
        tamper: |image| poke(image, 50 * 128 + 64, 0.123),
        found: |case| case.unexplained == 1,
    },
    Fault {
        reference: Renderer::MITSUBA_STOCK,
        name: "a reflectance wrong by 1%",
        scene: "scenes/materials/matte.toml",
        overrides: || set("shape.coloured.material.reflectance=[0.808, 0.303, 0.101]"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA_STOCK,
        name: "a trace of absorption in clear glass",
        scene: "scenes/showcase/furnace.toml",
        overrides: || set("shape.glass.material.absorption=0.02"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA_STOCK,
        name: "a mirror brighter by 0.4%",
        scene: "scenes/showcase/furnace.toml",
        overrides: || set("shape.floor.material.reflectance=[0.703, 0.753, 0.803]"),
        tamper: |_| {},
        found: unexplained,
    },
    Fault {
        reference: Renderer::MITSUBA_STOCK,
        name: "absorption stronger by 10%",
        scene: "scenes/showcase/absorption.toml",
        overrides: || {
            vec![
                "shape.green.material.absorption=[1.32, 0.22, 0.99]".to_owned(),
                "shape.bubble.material.exterior_absorption=[1.32, 0.22, 0.99]".to_owned(),
                "shape.amber.material.absorption=[0.11, 0.88, 2.75]".to_owned(),
                "shape.water.material.absorption=[0.88, 0.33, 0.11]".to_owned(),
                "shape.glass_in_water.material.exterior_absorption=[0.88, 0.33, 0.11]".to_owned(),
            ]
        },
        tamper: |_| {},
        found: unexplained,
    },
];

fn poke(image: &mut Image, index: usize, value: f32) {
    if let Some(samples) = image.channel_mut("G") {
        samples[index] = value;
    }
}

fn shift(image: &mut Image) {
    for name in ["R", "G", "B"] {
        if let Some(samples) = image.channel_mut(name) {
            samples.rotate_left(1);
        }
    }
}

fn bias(image: &mut Image) {
    let width = image.width();
    for name in ["R", "G", "B"] {
        if let Some(samples) = image.channel_mut(name) {
            for (index, sample) in samples.iter_mut().enumerate() {
                if (160..176).contains(&(index / width)) && (96..112).contains(&(index % width)) {
                    *sample *= 1.0002;
                }
            }
        }
    }
}

/// The picture of the textured scene with one texel changed by a twentieth.
fn wrong_picture() -> PathBuf {
    let texels = texels::read("scenes/assets/corners.png", Limits::TEXTURE).expect("the picture is there");
    let encode = |value: f32| (value * 255.0).round() as u8;
    let mut raster = Raster::from_fn(texels.width, texels.height, |x, y| {
        texels.data[y * texels.width + x].map(encode)
    });
    let (x, y) = (texels.width / 2, texels.height / 2);
    let color = raster.pixel(x, y).expect("the middle is inside");
    raster.set(x, y, color.map(|c| if c > 128 { c - 13 } else { c + 13 }));
    let folder = std::path::absolute("target/whitstone/faults").expect("there is a working folder");
    std::fs::create_dir_all(&folder).expect("target/ is writable");
    let path = folder.join("wrong.png");
    raster.write_png(&path).expect("target/ is writable");
    path
}

/// Sets the pixel in which the stored reference varies most to the middle of its range, which
/// neither side of the edge has.
fn mix_an_edge(image: &mut Image) {
    let stored = Path::new("references/images/showcase/classic/mitsuba.exr");
    let stored = exr_io::read(stored, Limits::IMAGE).expect("the stored reference");
    let channel = |name: &str| stored.channel(name).expect("a range").to_vec();
    let (low, high) = (channel("min.G"), channel("max.G"));
    let width = |index: &usize| high[*index] - low[*index];
    let index = (0..low.len())
        .max_by(|a, b| width(a).total_cmp(&width(b)))
        .expect("a pixel");
    poke(image, index, 0.5 * (low[index] + high[index]));
}

/// A sphere whose outside is inside.
struct FlippedSphere(Box<dyn Shape>);

impl Plugin<Shapes> for FlippedSphere {
    const TYPE: &'static str = "flipped_sphere";
    type Config = sphere::Config;

    fn build(
        config: Self::Config,
        transform: Transform,
        context: &mut dyn Context,
    ) -> Result<LoweredShape, SceneErrors> {
        match <Sphere as Plugin<Shapes>>::build(config, transform, context)? {
            LoweredShape::Custom(primitive) => Ok(LoweredShape::Custom(Box::new(Self(primitive)))),
            other => Ok(other),
        }
    }
}

impl Shape for FlippedSphere {
    fn bounds(&self) -> Aabb {
        self.0.bounds()
    }
    fn intersect(&self, ray: &Ray, interval: Interval, origin_primitive: Option<u32>) -> Option<ShapeHit> {
        self.0.intersect(ray, interval, origin_primitive)
    }
    fn surface(
        &self,
        ray: &Ray,
        hit: &PreliminaryIntersection,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction {
        let point = self.0.surface(ray, hit, needs);
        SurfaceInteraction {
            n_g: -point.n_g,
            n_s: -point.n_s,
            ..point
        }
    }
}

/// A picture that counts footprints as larger than they are, so that it is looked up at a coarser
/// level: by 0.02.
struct BiasedImage(Arc<dyn Texture>);

impl Plugin<Textures> for BiasedImage {
    const TYPE: &'static str = "biased_image";
    type Config = image::Config;

    fn build(
        config: Self::Config,
        (): (),
        context: &mut dyn Context,
    ) -> Result<Arc<dyn Texture>, SceneErrors> {
        let inner = <image::Image as Plugin<Textures>>::build(config, (), context)?;
        Ok(Arc::new(Self(inner)))
    }
}

impl Texture for BiasedImage {
    fn needs(&self) -> SurfaceAttributes {
        self.0.needs()
    }
    fn value(&self, point: &SurfaceInteraction) -> Rgb {
        let larger = 0.02_f32.exp2();
        let mut point = *point;
        point.footprint.uv = point.footprint.uv.map(|step| step * larger);
        point.footprint.position = point.footprint.position.map(|step| step * larger);
        self.0.value(&point)
    }
}

/// An accelerator with a fault, around one without.
struct Faulty<const KIND: usize>(Box<dyn Accelerator>);

const FAR_SPAWN: usize = 0;
const NO_SHADOW: usize = 1;

impl<const KIND: usize> Plugin<Accelerators> for Faulty<KIND> {
    const TYPE: &'static str = ["far_spawn", "no_shadow"][KIND];
    type Config = brute_force::Config;

    fn build(
        config: Self::Config,
        geometry: Arc<Geometry>,
        context: &mut dyn Context,
    ) -> Result<Box<dyn Accelerator>, SceneErrors> {
        let inner = <BruteForce as Plugin<Accelerators>>::build(config, geometry, context)?;
        Ok(Box::new(Self(inner)))
    }
}

impl<const KIND: usize> Faulty<KIND> {
    /// Spawned rays start a thousand times as far along as those of the reference: 4000 units of
    /// 2^-24.
    fn ray(&self, ray: &Ray, skip: SelfHitFilter) -> Ray {
        if KIND == FAR_SPAWN && skip != SelfHitFilter::NOTHING {
            let far = 4000.0 * (-24.0_f64).exp2() * (1.0 + ray.origin.abs().max_element());
            return Ray::new(ray.at(far), ray.direction);
        }
        *ray
    }
}

impl<const KIND: usize> Accelerator for Faulty<KIND> {
    fn intersect(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<PreliminaryIntersection> {
        self.0.intersect(&self.ray(ray, skip), interval, skip)
    }
    fn occluded(&self, ray: &Ray, interval: Interval, skip: SelfHitFilter) -> bool {
        let ray = self.ray(ray, skip);
        match self.0.intersect(&ray, interval, skip) {
            // Shape 3 of the classic scene is the matte ball.
            Some(hit) => KIND != NO_SHADOW || hit.shape != 3,
            None => false,
        }
    }
    fn statistics(&self) -> Statistics {
        self.0.statistics()
    }
}

fn registry() -> Registry {
    let mut registry = whitstone::registry();
    registry
        .add::<Shapes, FlippedSphere>("faults")
        .expect("a new type");
    registry
        .add::<Textures, BiasedImage>("faults")
        .expect("a new type");
    registry
        .add::<Accelerators, Faulty<FAR_SPAWN>>("faults")
        .expect("a new type");
    registry
        .add::<Accelerators, Faulty<NO_SHADOW>>("faults")
        .expect("a new type");
    registry
}

/// A fault in code that our tracer shares with the oracle, which then looks right to both.
struct SharedFault {
    name: &'static str,
    scene: &'static str,
    overrides: fn() -> Vec<String>,
}

const SHARED_FAULTS: [SharedFault; 4] = [
    SharedFault {
        name: "an image decoded with a wrong texel",
        scene: "scenes/showcase/textured_mesh.toml",
        overrides: || vec![format!("texture.picture.file='{}'", wrong_picture().display())],
    },
    SharedFault {
        name: "an image decoded as linear",
        scene: "scenes/showcase/textured_mesh.toml",
        overrides: || set("texture.picture.color_space=linear"),
    },
    SharedFault {
        name: "a rotation wrong by a hundredth of a degree",
        scene: "scenes/showcase/textured_mesh.toml",
        overrides: || {
            let steps =
                "[{ rotate = { axis = [1, 0, 0], degrees = -35.01 } }, { translate = [0, 0.9, 0.4] }]";
            vec![format!("shape.torus.transform={steps}")]
        },
    },
    SharedFault {
        name: "a colour of the file read wrong by 1%",
        scene: "scenes/showcase/lecture_phong.toml",
        overrides: || set("shape.dull.material.k_d=[0.707, 0.2, 0.15]"),
    },
];

fn options(renderer: Renderer, mode: Mode) -> Options {
    Options {
        scenes: PathBuf::from("scenes"),
        references: PathBuf::from(REFERENCES),
        installation: Installation::default(),
        target: PathBuf::from("target/whitstone"),
        renderer,
        mode,
        reuse: true,
        threads: 0,
        overrides: Vec::new(),
        ours_overrides: Vec::new(),
        shared_overrides: Vec::new(),
        time_limit: Duration::from_secs(120),
        program: "whitstone".to_owned(),
        flags: String::new(),
    }
}

/// The oracle takes the side of the fault: the verdict must not.
fn run_shared(fault: &SharedFault, mode: Mode) -> Result<(), Failed> {
    let registry = registry();
    let options = Options {
        shared_overrides: (fault.overrides)(),
        ..options(Renderer::MITSUBA, mode)
    };
    let mut validator = Validator::new(&registry, options, &|_| {})?;
    let case = validator.validate(Path::new(fault.scene));
    let sided = case.opinion.as_ref().is_some_and(|opinion| opinion.ours > 0);
    if sided && case.status == Some(Status::Undecided) {
        Ok(())
    } else {
        Err(format!("the verdict is {:?}: {case:#?}", case.status).into())
    }
}

/// The scenes, references and modes that pass without a fault.
static SOUND: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());

fn run(fault: &Fault, mode: Mode) -> Result<(), Failed> {
    let registry = registry();
    let options = |ours_overrides| Options {
        ours_overrides,
        ..options(fault.reference, mode)
    };
    let validate = |ours_overrides: Vec<String>, tamper: Tamper| -> Result<CaseResult, Failed> {
        let mut validator = Validator::new(&registry, options(ours_overrides), &|_| {})?;
        Ok(validator.validate_tampered(Path::new(fault.scene), &tamper))
    };
    // Once for all faults of a scene: each validation starts a driver.
    let mut sound = SOUND.lock().unwrap_or_else(PoisonError::into_inner);
    let key = format!("{} {} {mode:?}", fault.scene, fault.reference);
    if !sound.contains(&key) {
        let case = validate(Vec::new(), |_| {})?;
        if case.status != Some(Status::Pass) {
            return Err(format!("the scene fails without the fault: {:?}", case.problems).into());
        }
        sound.insert(key);
    }
    drop(sound);
    let faulty = validate((fault.overrides)(), fault.tamper)?;
    if faulty.status == Some(Status::Fail) && (fault.found)(&faulty) {
        Ok(())
    } else {
        Err(format!("the fault was not found: {faulty:#?}").into())
    }
}

/// Whether POV-Ray is installed, and a Python that drives it.
fn has_povray() -> bool {
    let program = std::env::var_os("WHITSTONE_POVRAY").unwrap_or_else(|| "povray".into());
    let mut version = Command::new(program);
    version
        .arg("--version")
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    version.status().is_ok() && Environment::of_povray(&Installation::default()).is_ok()
}

fn main() {
    let arguments = Arguments::from_args();
    // Cargo runs tests in the folder of their package; scenes are named from the repository.
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("the package is in the repository");
    std::env::set_current_dir(root).expect("the repository is there");
    let mitsuba = Environment::existing(&Installation::default()).is_some();
    let trials = FAULTS
        .iter()
        .enumerate()
        .flat_map(|(number, fault)| {
            let missing = if fault.reference == Renderer::POVRAY {
                !has_povray()
            } else {
                !mitsuba
            };
            let in_turn = fault.reference.can_be_stored() && !missing;
            let stored = fault.reference.can_be_stored().then(|| {
                let name = format!("stored {}: {}", fault.reference, fault.name);
                Trial::test(name, move || run(fault, Mode::Stored))
                    .with_ignored_flag(in_turn && number % IN_TURN == 0)
            });
            let live = Trial::test(format!("live {}: {}", fault.reference, fault.name), move || {
                run(fault, Mode::Live)
            });
            let ignored = missing || in_turn && number % IN_TURN != 0;
            stored.into_iter().chain([live.with_ignored_flag(ignored)])
        })
        .chain(SHARED_FAULTS.iter().flat_map(|fault| {
            [
                Trial::test(
                    format!("stored, shared with the oracle: {}", fault.name),
                    move || run_shared(fault, Mode::Stored),
                ),
                Trial::test(
                    format!("live, shared with the oracle: {}", fault.name),
                    move || run_shared(fault, Mode::Live),
                )
                .with_ignored_flag(!mitsuba),
            ]
        }))
        .collect();
    libtest_mimic::run(&arguments, trials).exit();
}
