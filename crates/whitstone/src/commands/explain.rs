//! `explain`: shows how the pipeline renders a scene, and which rays make up one pixel.

use super::names::Names;
use super::pixel::{PixelArguments, PixelTree};
use super::{SceneArguments, build_with};
use crate::terminal::{Exit, Failure, write_json};
use crate::wireframe;
use clap::Args;
use serde_json::{Value, json};
use std::borrow::Cow;
use std::path::PathBuf;
use std::sync::Arc;
use whitstone_core::{Counters, Geometry, Registry, SurfaceAttributes};
use whitstone_gltf::Usage;
use whitstone_render::{Cost, Pipeline, RenderOptions};

/// Show what Whitstone builds for a scene and what it omits; with --pixel, print the ray tree of a
/// pixel and compare it with Mitsuba's
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Examples:\n  whitstone explain scenes/showcase/classic.toml\n  whitstone explain scenes/showcase/classic.toml --pixel 256,300"
)]
pub struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    #[command(flatten)]
    pixel: PixelArguments,
    /// Write the scene's picture with the boxes of its accelerator drawn over it, as PNG; colours
    /// by level: white for the root, then orange, blue, yellow, green, red, pink
    #[arg(long, value_name = "FILE")]
    draw_bounds: Option<PathBuf>,
    /// Deepest level of boxes to draw
    #[arg(long, value_name = "N", default_value_t = 4, requires = "draw_bounds")]
    bounds_depth: usize,
    /// Also render the scene, and count its rays
    #[arg(long)]
    measure: bool,
    /// Write everything, with the whole ray tree, to this file as JSON; - means standard output
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let (pipeline, names) = build_with(&arguments.scene, registry, None, Names::of)?;
    let tree = arguments.pixel.trace(&pipeline, &arguments.scene, registry)?;
    let measure = || {
        let film = pipeline.render(RenderOptions::default());
        film.check().map(|()| film.counters)
    };
    let counted = arguments
        .measure
        .then(measure)
        .transpose()
        .map_err(Failure::usage)?;
    print_pipeline(&pipeline, &names);
    if let Some(counted) = counted {
        let Counters {
            closest,
            shadow,
            shaded,
            uv,
            textured,
        } = counted;
        println!("counted        {closest} closest-hit rays, {shadow} shadow rays");
        println!(
            "               {shaded} shaded points, {uv} with texture coordinates, {textured} with textures"
        );
    }
    if let Some(tree) = &tree {
        println!();
        tree.print(&pipeline, &names);
    }
    for limit in pipeline.scene.geometry.search_limit_notes() {
        println!("warning: {limit}");
    }
    if let Some(path) = &arguments.json {
        write_json(path, &report(&pipeline, &names, tree.as_ref(), counted))?;
    }
    if let Some(path) = &arguments.draw_bounds {
        let picture = wireframe::picture(&pipeline, arguments.bounds_depth)?;
        picture.write_png(path).map_err(Failure::environment)?;
    }
    Ok(Exit::Pass)
}

fn elements(pipeline: &Pipeline) -> usize {
    geometries(pipeline)
        .map(|geometry| geometry.elements().count())
        .sum()
}

/// The geometry of the scene, then those of its groups.
fn geometries(pipeline: &Pipeline) -> impl Iterator<Item = &Geometry> {
    let groups = pipeline.groups.iter().map(|built| &**built.group.geometry());
    std::iter::once(&*pipeline.scene.geometry).chain(groups)
}

/// The number of distinct materials; shapes share them.
fn materials(pipeline: &Pipeline) -> usize {
    let mut places: Vec<*const ()> = pipeline
        .scene
        .materials
        .iter()
        .map(|material| Arc::as_ptr(material).cast())
        .collect();
    places.sort_unstable();
    places.dedup();
    places.len()
}

/// The maximum numbers of reflected and of transmitted rays per hit.
fn rays_per_hit(pipeline: &Pipeline) -> [u32; 2] {
    let all = pipeline.scene.materials.iter();
    all.fold([1, 1], |[reflected, transmitted], material| {
        [
            reflected.max(material.reflections()),
            transmitted.max(material.transmissions()),
        ]
    })
}

/// The memory in use while the scene renders, as far as it is reported.
fn bytes(costs: &[Cost]) -> u64 {
    costs.iter().filter_map(|cost| cost.bytes).sum()
}

/// The memory of the parts of this name.
fn bytes_of(costs: &[Cost], part: &str) -> u64 {
    costs
        .iter()
        .filter(|cost| cost.part == part)
        .filter_map(|cost| cost.bytes)
        .sum()
}

fn needs(pipeline: &Pipeline) -> Vec<&'static str> {
    let all = [
        (SurfaceAttributes::SHADING_NORMAL, "interpolated normals"),
        (SurfaceAttributes::UV, "texture coordinates"),
        (SurfaceAttributes::FOOTPRINT, "footprints of rays"),
    ];
    let needed = all
        .into_iter()
        .filter(|(need, _)| pipeline.scene.needs().contains(*need));
    needed.map(|(_, name)| name).collect()
}

/// Maximum number of pairs of coincident surfaces that are printed.
const MAX_COINCIDENT: usize = 20;

fn print_pipeline(pipeline: &Pipeline, names: &Names) {
    let row = |name: &str, text: &str| println!("{name:<14} {text}");
    let or_none = |list: Vec<&str>| {
        if list.is_empty() {
            "none".to_owned()
        } else {
            list.join(", ")
        }
    };
    let size = pipeline.film.size;
    let layers: Vec<Cow<'_, str>> = pipeline.film.channels().collect();
    let layers = layers.iter().map(AsRef::as_ref).collect();
    let samples = pipeline.samples();
    row(
        "film",
        &format!("{} x {}, layers: {}", size.width, size.height, or_none(layers)),
    );
    let times = &pipeline.film.times;
    if pipeline.moments() > 1 {
        let (first, last) = (times[0], times[times.len() - 1]);
        let text = format!(
            "{}, from {first} s to {last} s; the rows below are about the first",
            times.len()
        );
        row("times", &text);
    }
    if let Some(paths) = &pipeline.film.paths {
        let sum = if paths.classes.is_partition() {
            "every path is in exactly one, so that they sum to the image"
        } else {
            "they do not sum to the image: a path is in none of them, or in several"
        };
        row("path classes", &format!("{}; {sum}", paths.classes.names.len()));
    }
    row("camera", &names.camera);
    row(
        "sampler",
        &format!("{}, {samples} samples per pixel", names.sampler),
    );
    row("integrator", &names.integrator);
    let (accelerator, why) = &pipeline.accelerator;
    row("accelerator", &format!("{accelerator} ({why})"));
    if let Some(approximation_note) = pipeline.scene.accelerator.approximation_note() {
        println!("  {approximation_note}, so the image depends on the accelerator");
    }
    for (name, value) in pipeline.scene.accelerator.statistics() {
        println!("  {name:<20} {value}");
    }
    let (shapes, elements) = (names.shapes.len(), elements(pipeline));
    row(
        "shapes",
        &format!("{shapes}, lowered to {elements} elements (triangles and whole shapes)"),
    );
    for built in &pipeline.groups {
        let (accelerator, why) = &built.accelerator;
        row("group", &format!("\"{}\": {accelerator} ({why})", built.id));
        for (name, value) in built.group.accelerator().statistics() {
            println!("  {name:<20} {value}");
        }
    }
    let instances = pipeline.scene.geometry.paths() - 1;
    if instances > 0 {
        row(
            "instances",
            &format!("{instances}, including instances inside instances"),
        );
    }
    let used: Vec<&str> = pipeline.used.iter().map(|(_, name)| *name).collect();
    row("plugins", &used.join(", "));
    let lights: Vec<&str> = names.lights.iter().map(String::as_str).collect();
    row("lights", &format!("{}: {}", lights.len(), or_none(lights)));
    row(
        "materials",
        &format!("{} for the {shapes} shapes", materials(pipeline)),
    );
    for (number, defects) in pipeline.scene.open_refracting_meshes() {
        let name = names.shapes.get(number as usize).map_or("", String::as_str);
        row(
            "not closed",
            &format!("shape {number} ({name}) refracts and has {defects}"),
        );
    }
    let [reflections, transmissions] = rays_per_hit(pipeline);
    if reflections > 1 {
        let text = format!("up to {reflections} reflection rays per hit; rays are traced one by one");
        row("reflections", &text);
    }
    if transmissions > 1 {
        let text = format!("up to {transmissions} transmitted rays per hit; rays are traced one by one");
        row("transmissions", &text);
    }
    row("needs", &or_none(needs(pipeline)));
    let costs = pipeline.costs();
    println!("costs: bytes, and the expected work");
    for Cost { part, bytes, work } in &costs {
        let bytes = bytes.map_or_else(|| "not reported".to_owned(), |bytes| bytes.to_string());
        println!("  {part:<28} {bytes:>12}  {work}");
    }
    row("bytes", &format!("{} in total (reported items)", bytes(&costs)));
    row("built in", &format!("{:.6} s", pipeline.build_seconds));
    row("scene hash", &pipeline.scene_hash);
    for pair in pipeline.coincident.iter().take(MAX_COINCIDENT) {
        row("coincident", &pair.to_string());
    }
    let more = pipeline.coincident.len().saturating_sub(MAX_COINCIDENT);
    if more > 0 {
        row("coincident", &format!("{more} more pairs; --json lists all"));
    }
    for why in &pipeline.coincident_unknown {
        row("coincident", &format!("not examined: {why}"));
    }
    println!("omitted, because the scene does not need it");
    for part in &pipeline.omitted {
        println!("  {}: {}", part.what, part.why);
    }
    for (file, Usage { bytes, decoded }) in whitstone_gltf::usage() {
        let saved = bytes.saturating_sub(decoded);
        if saved > 0 {
            println!(
                "  {saved} of {bytes} bytes of accessors and images: nothing reads them in {}",
                file.display()
            );
        }
    }
}

fn report(pipeline: &Pipeline, names: &Names, tree: Option<&PixelTree>, counted: Option<Counters>) -> Value {
    let size = pipeline.film.size;
    let omitted = pipeline
        .omitted
        .iter()
        .map(|part| json!({ "what": part.what, "why": part.why }));
    let used = pipeline
        .used
        .iter()
        .map(|(family, name)| json!({ "family": family.singular(), "type": name }));
    let [reflections, transmissions] = rays_per_hit(pipeline);
    let costs = pipeline.costs();
    json!({
        "used": used.collect::<Vec<_>>(),
        "bytes_estimated": bytes(&costs),
        "costs": costs,
        "counters": counted.map(|rays| json!({
            "closest": rays.closest, "shadow": rays.shadow, "shaded": rays.shaded, "uv": rays.uv,
            "textured": rays.textured,
        })),
        "width": size.width,
        "height": size.height,
        "layers": pipeline.film.channels().collect::<Vec<_>>(),
        "times": pipeline.film.times,
        "camera": names.camera,
        "sampler": names.sampler,
        "samples": pipeline.samples(),
        "integrator": names.integrator,
        "accelerator": {
            "type": pipeline.accelerator.0,
            "reason": pipeline.accelerator.1,
            "approximation_note": pipeline.scene.accelerator.approximation_note(),
            "statistics": pipeline.scene.accelerator.statistics(),
        },
        "shapes": names.shapes,
        "open_refracting_meshes": pipeline.scene.open_refracting_meshes().iter().map(|(number, defects)| json!({
            "shape": number,
            "border_edges": defects.border_edges,
            "crowded_edges": defects.crowded_edges,
            "flipped_edges": defects.flipped_edges,
            "duplicate_faces": defects.duplicate_faces,
        })).collect::<Vec<_>>(),
        "elements": elements(pipeline),
        "groups": pipeline.groups.iter().map(|built| json!({
            "id": built.id,
            "first_shape": built.group.first_shape(),
            "type": built.accelerator.0,
            "reason": built.accelerator.1,
            "statistics": built.group.accelerator().statistics(),
        })).collect::<Vec<_>>(),
        "instances": pipeline.scene.geometry.paths() - 1,
        "lights": names.lights,
        "materials": materials(pipeline),
        "reflections": reflections,
        "transmissions": transmissions,
        "needs": needs(pipeline),
        "bytes": { "meshes": bytes_of(&costs, "meshes"), "film": bytes_of(&costs, "film") },
        "build_s": pipeline.build_seconds,
        "scene_hash": pipeline.scene_hash,
        "omitted": omitted.collect::<Vec<_>>(),
        "gltf": whitstone_gltf::usage().iter().map(|(file, usage)| json!({
            "file": file, "bytes": usage.bytes, "decoded": usage.decoded,
        })).collect::<Vec<_>>(),
        "coincident": pipeline.coincident.iter().map(|pair| json!({
            "shapes": pair.shapes,
            "form": pair.form,
            "place": pair.place.to_array(),
            "gap": pair.gap,
        })).collect::<Vec<_>>(),
        "coincident_unknown": pipeline.coincident_unknown,
        "pixel": tree.map(PixelTree::report),
    })
}
