//! `bench light-paths`: which share of the paths that start at the lights reaches the image.
//!
//! Paths start at the point lights, in directions uniform over the sphere, and are scattered by the
//! materials of the scene: at each surface along one of its specular rays, or diffusely. A path
//! reaches the image if it goes through the aperture of the camera and lands in the window. That is
//! so rare that it cannot be counted. Instead, each diffuse surface adds the probability with which
//! the light that it scatters reaches the image: its response towards the aperture, times the solid
//! angle of the aperture, if nothing is between and the surface is in the image.

use clap::Args;
use std::f64::consts::PI;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;
use whitstone::core::{
    BsdfFlags, DVec2, DVec3, DVec4, IncidentLight, Interval, LightSamples, MediumStack, Ray, Registry, Rgb,
    Scene, SelfHitFilter, SpecularRayKind, SpecularRays, SurfaceInteraction,
};
use whitstone::render::{BuildOptions, Pipeline};
use whitstone::scene::{Description, Sources};
use whitstone::{Exit, Failure};
use whitstone_testkit::Random;

/// The page that `xtask readme` writes.
pub(crate) const PAGE: &str = "docs/light-paths.md";
/// The scenes of the page.
const SCENES: [&str; 4] = [
    "scenes/integrators/whitted.toml",
    "scenes/showcase/classic.toml",
    "scenes/showcase/cornell.toml",
    "scenes/showcase/glass_mesh.toml",
];
/// Image sizes of the page.
const SIZES: [[u32; 2]; 3] = [[64, 48], [640, 480], [1920, 1080]];
/// Radius of the aperture on the page, in metres: that of an eye's pupil.
const APERTURE: f64 = 0.002;
/// Light paths for each scene of the page.
const PATHS: u32 = 200_000;
/// Surfaces of a path; later ones do not count.
const MAX_SURFACES: usize = 8;

/// Measure which share of the light paths that start at point lights reaches the image
///
/// Prints, for each scene, the share for a camera with a small aperture; through a pinhole it is 0.
/// Its inverse times the number of pixels is the number of light paths for one per pixel on
/// average, where ray tracing from the camera takes one path per pixel.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  cargo xtask bench light-paths\n  cargo xtask bench light-paths scenes/shapes/sphere.toml --aperture 0.01"
)]
pub(crate) struct Arguments {
    /// Scene files (TOML) with point lights and a perspective camera
    #[arg(value_name = "SCENE", default_values = SCENES)]
    scenes: Vec<PathBuf>,
    /// Number of light paths for each scene
    #[arg(long, value_name = "COUNT", default_value_t = PATHS, value_parser = clap::value_parser!(u32).range(1..))]
    paths: u32,
    /// Radius of the aperture in metres
    #[arg(long, value_name = "METRES", default_value_t = APERTURE)]
    aperture: f64,
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    if !(arguments.aperture.is_finite() && arguments.aperture > 0.0) {
        let message = format!("--aperture: expected a number > 0, found {}", arguments.aperture);
        return Err(Failure::usage(message));
    }
    for scene in &arguments.scenes {
        let start = Instant::now();
        let found = measure(scene, arguments.paths, arguments.aperture, registry)?;
        println!(
            "{}: share {:.2e}, {:.2} surfaces per path, {} light paths in {:.2} s",
            scene.display(),
            found.share,
            found.surfaces,
            arguments.paths,
            start.elapsed().as_secs_f64()
        );
        for [width, height] in SIZES {
            let pixels = f64::from(width) * f64::from(height);
            println!(
                "  {width} x {height}: {:.1e} light paths for one per pixel",
                pixels / found.share
            );
        }
    }
    Ok(Exit::Pass)
}

/// The page, of the scenes of the repository.
pub(crate) fn page(registry: &Registry) -> Result<String, Failure> {
    let mut text = String::from(
        "# Why not trace from the lights?\n\n<!-- Written by `cargo xtask readme`. -->\n\n\
         The lecture notes answer (003): infinitely many rays leave a light, and only a few land on the\n\
         viewport. `cargo xtask bench light-paths` measures how few. Paths start at the point lights, in\n\
         all directions, and are reflected, refracted and scattered by the surfaces. The share is that of\n\
         the paths, or the mean number of times that a path, goes through the aperture of the camera and\n\
         lands in the image. The probability of each surface is added in closed form; a path has at most\n",
    );
    let _ = writeln!(
        text,
        "{MAX_SURFACES} surfaces. Through a pinhole the share is 0, so the camera has an aperture with a radius of {} mm,\n\
         as an eye.\n",
        1e3 * APERTURE
    );
    let _ = write!(text, "| scene | surfaces per path | share |");
    for [width, height] in SIZES {
        let _ = write!(text, " light paths for {width} x {height} |");
    }
    let _ = writeln!(text, "\n|---|---|---|{}", "---|".repeat(SIZES.len()));
    for scene in SCENES {
        let found = measure(Path::new(scene), PATHS, APERTURE, registry)?;
        let _ = write!(
            text,
            "| [{}](../{scene}) | {:.1} | {:.0e} |",
            Path::new(scene).file_stem().unwrap_or_default().display(),
            found.surfaces,
            found.share
        );
        for [width, height] in SIZES {
            let pixels = f64::from(width) * f64::from(height);
            let _ = write!(text, " {:.0e} |", pixels / found.share);
        }
        text.push('\n');
    }
    text += "\nThe last columns are the light paths for one per pixel, on average. From the camera, one path per\n\
             pixel is enough: 3072, 307 200 and 2 073 600 of them. The share does not depend on the image\n\
             size, so both grow with the number of pixels, and their ratio is the inverse of the share.\n";
    Ok(text)
}

/// What was measured.
struct Found {
    /// Mean number of times that a path reaches the image.
    share: f64,
    /// Mean number of surfaces of a path.
    surfaces: f64,
}

fn measure(scene: &Path, paths: u32, aperture: f64, registry: &Registry) -> Result<Found, Failure> {
    let sources = Sources::load(scene, &[], registry)
        .map_err(|error| Failure::usage(error.sources.report(&error.errors, false)))?;
    study(&sources, paths, aperture, registry)
}

fn study(sources: &Sources, paths: u32, aperture: f64, registry: &Registry) -> Result<Found, Failure> {
    let report = |errors| Failure::usage(sources.report(&errors, false));
    let pipeline = Pipeline::load(sources, registry, BuildOptions::default()).map_err(report)?;
    let lamps = point_lights(sources)?;
    let total: f64 = lamps.iter().map(|(_, intensity)| intensity).sum();
    let eye = Eye::new(&pipeline, aperture)?;
    let mut random = Random::new(1);
    let mut found = Found {
        share: 0.0,
        surfaces: 0.0,
    };
    for _ in 0..paths {
        let mut left = random.unit() * total;
        let (origin, _) = lamps
            .iter()
            .find(|(_, intensity)| {
                left -= intensity;
                left < 0.0
            })
            .unwrap_or(&lamps[0]);
        let ray = Ray::new(*origin, random.direction());
        follow(&pipeline.scene, &eye, ray, &mut random, &mut found);
    }
    found.share /= f64::from(paths);
    found.surfaces /= f64::from(paths);
    Ok(found)
}

/// Positions and intensities of the point lights.
fn point_lights(sources: &Sources) -> Result<Vec<(DVec3, f64)>, Failure> {
    let description = Description::parse(sources);
    let text = description.value.map(|description| description.flattened.text);
    let root: toml::Table = text.unwrap_or_default().parse().map_err(Failure::usage)?;
    let number = |value: &toml::Value| value.as_float().or_else(|| Some(value.as_integer()? as f64));
    let lights = root.get("light").and_then(toml::Value::as_array);
    let points = lights.into_iter().flatten().filter_map(|light| {
        (light.get("type")?.as_str()? == "point").then_some(())?;
        let position: Vec<f64> = light
            .get("position")?
            .as_array()?
            .iter()
            .filter_map(number)
            .collect();
        let intensity = light.get("intensity")?;
        let intensity = match intensity.as_array() {
            Some(rgb) => rgb.iter().filter_map(number).sum::<f64>() / 3.0,
            None => number(intensity)?,
        };
        Some((
            DVec3::new(*position.first()?, *position.get(1)?, *position.get(2)?),
            intensity,
        ))
    });
    let points: Vec<_> = points.filter(|(_, intensity)| *intensity > 0.0).collect();
    if points.is_empty() {
        let message = format!(
            "{}: expected a scene with point lights, found none",
            sources.name()
        );
        return Err(Failure::usage(message));
    }
    Ok(points)
}

/// The aperture of the camera.
struct Eye<'p> {
    pipeline: &'p Pipeline,
    origin: DVec3,
    /// Unit vector along the view.
    forward: DVec3,
    /// Area of the aperture in m².
    area: f64,
}

impl<'p> Eye<'p> {
    fn new(pipeline: &'p Pipeline, aperture: f64) -> Result<Self, Failure> {
        let size = pipeline.film.size;
        let middle = DVec2::new(f64::from(size.width), f64::from(size.height)) / 2.0;
        let [axis, corner] = [middle, DVec2::ZERO].map(|raster| pipeline.camera.ray(raster));
        if pipeline.camera.projection().is_none() || axis.origin.distance(corner.origin) > 1e-9 {
            return Err(Failure::usage(
                "expected a perspective camera without a near limit",
            ));
        }
        Ok(Self {
            pipeline,
            origin: axis.origin,
            forward: axis.direction,
            area: PI * aperture * aperture,
        })
    }

    /// Whether a point is in the image, if nothing is before it.
    fn sees(&self, point: DVec3) -> bool {
        let Some(matrix) = self.pipeline.camera.projection() else {
            return false;
        };
        let DVec4 { x, y, w, .. } = matrix * point.extend(1.0);
        let size = self.pipeline.film.size;
        let inside = |at: f64, side: u32| (0.0..f64::from(side)).contains(&(at / w));
        (point - self.origin).dot(self.forward) > 0.0 && inside(x, size.width) && inside(y, size.height)
    }
}

/// One path from a light, with weight 1.
fn follow(scene: &Scene, eye: &Eye<'_>, mut ray: Ray, random: &mut Random, found: &mut Found) {
    let mut skip = SelfHitFilter::NOTHING;
    for _ in 0..MAX_SURFACES {
        let Some(hit) = scene.accelerator.intersect(&ray, Interval::FORWARD, skip) else {
            return;
        };
        found.surfaces += 1.0;
        let light = -ray.direction;
        let point = scene.surface(&ray, &hit);
        skip = SelfHitFilter::leaving(&hit);
        found.share += to_eye(scene, eye, &point, hit.shape, light, skip);
        let mut branches = SpecularRays::default();
        let seen = point.seen_from(light);
        if scene.flags_of(hit.shape).intersects(BsdfFlags::SPECULAR) {
            scene.specular_rays(hit.shape, MediumStack::NOTHING, &seen, light, &mut branches);
        }
        // Radiance is scaled by the squared relative index where it is refracted; light is not.
        let reflected = branches
            .iter()
            .find(|branch| branch.kind == SpecularRayKind::Reflection);
        let reflected = reflected.map_or(0.0, |branch| mean(branch.weight));
        let mut left = random.unit();
        let mut next = None;
        for branch in branches.iter() {
            let share = match branch.kind {
                SpecularRayKind::Transmission { .. } => mean(branch.weight).min(1.0 - reflected),
                _ => mean(branch.weight),
            };
            if next.is_none() && left < share {
                next = Some(branch.direction);
            }
            left -= share;
        }
        // Otherwise diffusely: a direction about the normal by the cosine, whose probability is
        // pi times the response.
        if next.is_none() {
            let n = if seen.n_g.dot(light) < 0.0 {
                -seen.n_g
            } else {
                seen.n_g
            };
            let direction = (n + random.direction() * (1.0 - 1e-9)).normalize();
            if left >= PI * response(scene, &point, hit.shape, light, direction) {
                return;
            }
            next = Some(direction);
        }
        let Some(direction) = next else {
            return;
        };
        ray = Ray::new(seen.spawn_origin(direction), direction);
    }
}

/// Probability with which the light that a surface scatters diffusely reaches the image.
fn to_eye(
    scene: &Scene,
    eye: &Eye<'_>,
    point: &SurfaceInteraction,
    shape: u32,
    light: DVec3,
    skip: SelfHitFilter,
) -> f64 {
    if !scene.flags_of(shape).contains(BsdfFlags::LOCAL) || !eye.sees(point.position) {
        return 0.0;
    }
    let distance = point.position.distance(eye.origin);
    let view = (eye.origin - point.position) / distance;
    let cosine = point.n_g.dot(view).abs() * -view.dot(eye.forward);
    let share = response(scene, point, shape, light, view) * cosine * eye.area / (distance * distance);
    if share <= 0.0 {
        return 0.0;
    }
    let seen = point.seen_from(view);
    let ray = Ray::new(seen.spawn_origin(view), view);
    let between = Interval::up_to(distance);
    if scene.accelerator.intersect(&ray, between, skip).is_some() {
        return 0.0;
    }
    share
}

/// The response of a surface to light from `light` in the direction `view`, per steradian: radiance
/// by irradiance. The mean of the channels.
fn response(scene: &Scene, point: &SurfaceInteraction, shape: u32, light: DVec3, view: DVec3) -> f64 {
    let cosine = point.n_g.dot(light).abs();
    if point.n_g.dot(light) * point.n_g.dot(view) <= 0.0 || cosine < 1e-9 {
        return 0.0;
    }
    let incident = [IncidentLight {
        direction: light,
        irradiance: Rgb::WHITE,
    }];
    let light = LightSamples {
        ambient: Rgb::BLACK,
        lights: &incident,
    };
    let material = &scene.materials[shape as usize];
    mean(material.local_illumination(&point.seen_from(view), view, &light)) / cosine
}

fn mean(color: Rgb) -> f64 {
    (color.r + color.g + color.b) / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn share(scene: &str, aperture: f64) -> f64 {
        let sources = Sources::from_text("scene.toml", scene, Path::new("."), &[]).unwrap();
        study(&sources, 200_000, aperture, &whitstone::registry())
            .unwrap()
            .share
    }

    /// A floor with reflectance r, a light at the height h above it and an eye at the light: the
    /// integral of `h/(4 pi s³) r/pi h²/s² A/s²` over the floor, with `s² = h² + x² + y²`, is
    /// `r A/(10 pi h²)`.
    #[test]
    fn the_share_of_a_floor_has_a_closed_form() {
        for (reflectance, height) in [(0.5, 2.0), (0.9, 0.5)] {
            let scene = format!(
                "[camera]\ntype = \"perspective\"\nfov = 175\n\
                 look_at = {{ origin = [0, {height}, 0], target = [0, 0, 0], up = [0, 0, 1] }}\n\
                 [[light]]\ntype = \"point\"\nposition = [0, {height}, 0]\nintensity = 7\n\
                 [[shape]]\ntype = \"plane\"\nmaterial = {{ type = \"matte\", reflectance = {reflectance} }}\n\
                 transform = {{ rotate = {{ axis = [1, 0, 0], degrees = -90 }} }}\n"
            );
            let aperture = 0.01;
            let expected = reflectance * PI * aperture * aperture / (10.0 * PI * height * height);
            let found = share(&scene, aperture);
            assert!(
                (found / expected - 1.0).abs() < 0.02,
                "{found:e} is not {expected:e}"
            );
            // Twice the radius is four times the area.
            let ratio = share(&scene, 2.0 * aperture) / found;
            assert!((ratio - 4.0).abs() < 1e-9, "{ratio}");
            // A lid between floor and eye hides all of it.
            let lid = format!(
                "{scene}[[shape]]\ntype = \"disk\"\ntransform = [{{ scale = 0.01 }}, \
                 {{ rotate = {{ axis = [1, 0, 0], degrees = -90 }} }}, {{ translate = [0, {}, 0] }}]\n\
                 material = {{ type = \"mirror\", reflectance = 0 }}\n",
                height - 1e-4
            );
            assert_eq!(share(&lid, aperture), 0.0);
        }
    }
}
