//! Mitsuba 3's XML.
//!
//! Source: Mitsuba 3.9.1 (`src/core/parser.cpp` and the plugins), and the driver in
//! `references/mitsuba`, which renders each type of this program by Mitsuba's plugins.

mod light;
mod material;
mod sensor;
mod shape;
mod texture;
mod translate;
mod xml;

use crate::files::Folder;
use std::path::Path;
use translate::Translator;
use whitstone_core::{Feature, FormatErrors, ImportOptions, Imported, SceneFormat, Treatment};

/// Mitsuba 3's XML.
pub struct Mitsuba;

use Treatment::{Approximated, Dropped, Kept};

const fn feature(name: &'static str, treatment: Treatment, how: &'static str) -> Feature {
    Feature { name, treatment, how }
}

/// What happens to Mitsuba's plugins and parameters. Plugins that are not listed are errors.
const FEATURES: &[Feature] = &[
    feature("default, alias, ref, include, path", Kept, "They are resolved."),
    feature(
        "to_world of a sensor that mirrors",
        Approximated,
        "The image is not mirrored.",
    ),
    feature(
        "film hdrfilm",
        Kept,
        "Width, height and crop window; the format of the file has no effect.",
    ),
    feature(
        "rfilter",
        Approximated,
        "Pixels are means over their square: a box filter.",
    ),
    feature(
        "sampler",
        Approximated,
        "sobol with the same number of samples, at most 64.",
    ),
    feature(
        "integrator direct",
        Approximated,
        "appel: lights are points, and mirrors and glass are black.",
    ),
    feature(
        "integrator path",
        Approximated,
        "whitted: diffuse surfaces do not light each other.",
    ),
    feature("integrator volpath", Approximated, "As path, without media."),
    feature(
        "integrator aov",
        Approximated,
        "Its nested integrator; no additional channels.",
    ),
    feature(
        "unlimited max_depth",
        Approximated,
        "16 bounces, without rays that contribute less than 0.001.",
    ),
    feature("hide_emitters", Dropped, "Lights behind the scene stay visible."),
    feature(
        "sensor perspective",
        Kept,
        "perspective; near_clip is its near limit.",
    ),
    feature("sensor orthographic", Kept, "orthographic."),
    feature("sensor thinlens", Kept, "thin_lens with 16 points of the lens."),
    feature("near_clip of a lens", Dropped, "thin_lens has no near limit."),
    feature("far_clip", Dropped, "There is no far limit."),
    feature("shutter_open, shutter_close", Dropped, "Nothing moves."),
    feature("srf", Dropped, "There are no spectra."),
    feature("emitter point", Kept, "point."),
    feature("emitter directional", Kept, "directional."),
    feature("emitter spot", Kept, "spot."),
    feature("texture of a spot", Dropped, "spot has no image; projector has."),
    feature(
        "emitter projector",
        Kept,
        "projector, with pi times the scale as intensity.",
    ),
    feature(
        "emitter constant",
        Approximated,
        "An environment that lights from 32 directions.",
    ),
    feature(
        "emitter envmap",
        Approximated,
        "An environment that lights from 32 directions; what is visible is the same.",
    ),
    feature(
        "envmap of unknown size",
        Approximated,
        "The rows are not moved by half a texel.",
    ),
    feature(
        "emitter area",
        Approximated,
        "An area light of 16 points, and a shape that emits on one side.",
    ),
    feature(
        "emitter area without a light",
        Approximated,
        "The surface is visible, but lights no other surface.",
    ),
    feature("shape sphere", Kept, "sphere."),
    feature("shape rectangle", Kept, "rectangle."),
    feature("shape disk", Kept, "disk."),
    feature("shape cube", Kept, "box, or six rectangles if it has a texture."),
    feature("shape cylinder", Kept, "cylinder without caps."),
    feature("shape obj, shape ply", Kept, "mesh."),
    feature(
        "mesh without normals",
        Approximated,
        "It is flat: Mitsuba computes normals, unless face_normals is true.",
    ),
    feature("shape shapegroup, shape instance", Kept, "A group and instances."),
    feature("shape merge", Kept, "Its shapes."),
    feature("medium", Dropped, "Media do not scatter."),
    feature(
        "bsdf diffuse",
        Kept,
        "matte; black from behind, unless it is in a twosided.",
    ),
    feature("bsdf dielectric", Kept, "dielectric."),
    feature("bsdf thindielectric", Kept, "thin_dielectric."),
    feature("bsdf conductor", Kept, "conductor, or mirror without a material."),
    feature(
        "bsdf roughconductor",
        Approximated,
        "glossy with the reflectance at normal incidence: point lights give no highlight.",
    ),
    feature("bsdf roughdielectric", Approximated, "dielectric: it is smooth."),
    feature(
        "bsdf plastic",
        Approximated,
        "whitted: the reflection is that at normal incidence.",
    ),
    feature(
        "bsdf roughplastic",
        Approximated,
        "blinn_phong: the highlight is that at normal incidence.",
    ),
    feature("bsdf twosided", Kept, "The material itself, or two_sided."),
    feature("bsdf mask", Kept, "mask."),
    feature("bsdf blendbsdf", Kept, "mix."),
    feature("bsdf normalmap", Kept, "normal_map; on a mesh with its tangents."),
    feature(
        "normalmap without tangents",
        Dropped,
        "On disks and in groups only meshes have tangents.",
    ),
    feature(
        "bsdf bumpmap",
        Dropped,
        "A height map by texture coordinates has no counterpart; its material is kept.",
    ),
    feature("bsdf null", Kept, "A mask that is open."),
    feature(
        "specular_reflectance, specular_transmittance",
        Dropped,
        "Glass is clear.",
    ),
    feature(
        "texture of alpha",
        Approximated,
        "The roughness is 0.1 everywhere.",
    ),
    feature("texture bitmap", Kept, "image."),
    feature("texture checkerboard", Kept, "checker."),
];

impl SceneFormat for Mitsuba {
    fn name(&self) -> &'static str {
        "mitsuba"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["xml"]
    }

    fn features(&self) -> &'static [Feature] {
        FEATURES
    }

    fn import(&self, path: &Path, options: &ImportOptions) -> Option<Result<Imported, FormatErrors>> {
        Some(import(path, options))
    }
}

fn import(path: &Path, options: &ImportOptions) -> Result<Imported, FormatErrors> {
    let folder = Folder::of(path, options);
    let scene = xml::load(path, &folder)?;
    Translator::new(&scene, &folder, options).translate()
}

#[cfg(test)]
mod tests;
