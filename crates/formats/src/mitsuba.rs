//! Mitsuba 3's XML.
//!
//! Source: Mitsuba 3.9.1 (`src/core/parser.cpp` and the plugins), and the driver in
//! `references/mitsuba`, which renders each type of this program by Mitsuba's plugins.

pub(crate) mod export;
mod light;
pub(crate) mod material;
mod sensor;
pub(crate) mod shape;
mod texture;
mod translate;
mod xml;

pub(crate) use material::{METALS, normal_reflectance};

use crate::files::Folder;
use std::path::Path;
use translate::Translator;
use whitstone_core::{
    ExportScene, Feature, FormatErrors, ImportOptions, Imported, Note, SceneFormat, Treatment,
};

/// Mitsuba 3's XML.
pub struct Mitsuba;

/// A dictionary for Mitsuba 3's `load_dict`, as a Python file; only written.
pub struct MitsubaPython;

use Treatment::{Approximated, Dropped, Kept};

const fn feature(name: &'static str, treatment: Treatment, how: &'static str) -> Feature {
    Feature { name, treatment, how }
}

/// What happens to Mitsuba's plugins and parameters when they are imported, and to the parts of a
/// scene when they are exported: the latter begin with a bracket. Imported plugins that are not
/// listed are errors.
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
    feature("[film] aovs", Dropped, "The image has no additional channels."),
    feature(
        "[camera] environment",
        Dropped,
        "Mitsuba has no panoramic sensor, and uses a default one.",
    ),
    feature("[camera] near_kind", Approximated, "The near limit is a plane."),
    feature(
        "[camera] pixels that are not square",
        Approximated,
        "They are square; the width of the view is kept.",
    ),
    feature("[camera] window of a lens", Approximated, "The view is centred."),
    feature(
        "[sampler]",
        Approximated,
        "independent with as many samples, at least 16: their positions are random.",
    ),
    feature(
        "[integrator] whitted",
        Approximated,
        "path: diffuse surfaces also light each other.",
    ),
    feature("[integrator] rasterizer", Approximated, "direct."),
    feature("[integrator] shadows", Approximated, "Shadows are opaque."),
    feature("[[light]] falloff", Dropped, "Mitsuba's lights have a falloff."),
    feature(
        "[[light]] projector with a coloured intensity",
        Approximated,
        "The mean of its channels.",
    ),
    feature(
        "[[light]] area",
        Approximated,
        "An emitter on a visible surface, which lights from random points.",
    ),
    feature("[[light]] ambient", Dropped, "Mitsuba has no ambient light."),
    feature(
        "[[light]] background",
        Approximated,
        "constant: it also lights diffuse surfaces.",
    ),
    feature(
        "[[light]] environment",
        Approximated,
        "envmap or constant: it lights from all directions, and its rows are stretched to the poles.",
    ),
    feature(
        "[[light]] several environments",
        Dropped,
        "Mitsuba has one: the first with an image.",
    ),
    feature(
        "[[light]] environment that is no plain image",
        Dropped,
        "Only a color or an image without keys of its mapping is an envmap.",
    ),
    feature(
        "[[shape]] plane with a texture",
        Approximated,
        "The texture has the coordinates of a disk.",
    ),
    feature(
        "[[shape]] cylinder that is stretched",
        Dropped,
        "Mitsuba's cylinders have circular sections.",
    ),
    feature(
        "[[shape]] mesh of another format",
        Dropped,
        "Mitsuba reads OBJ and PLY.",
    ),
    feature(
        "[[shape]] mesh with subdivision or displacement",
        Approximated,
        "The mesh of the file.",
    ),
    feature(
        "[[shape]] instance in a group",
        Dropped,
        "Mitsuba's groups cannot contain instances.",
    ),
    feature("[[shape]] of another type", Dropped, "Mitsuba has no such shape."),
    feature(
        "[material] phong, blinn_phong, whitted",
        Approximated,
        "diffuse with pi k_d, blended with a mirror of k_refl; no highlight.",
    ),
    feature("[material] k_refr", Dropped, "Nothing is transmitted."),
    feature(
        "[material] texture of k_d",
        Approximated,
        "It is the albedo, without the factor pi.",
    ),
    feature(
        "[material] texture of a highlight or reflection",
        Dropped,
        "There is no reflection.",
    ),
    feature(
        "[material] coloured weight",
        Approximated,
        "The mean of its channels.",
    ),
    feature(
        "[material] glossy",
        Approximated,
        "roughconductor of the same width.",
    ),
    feature(
        "[material] priority",
        Dropped,
        "Mitsuba's bodies must not overlap.",
    ),
    feature(
        "[material] two_sided that lets light through",
        Approximated,
        "The front on both sides.",
    ),
    feature(
        "[material] normal_map",
        Approximated,
        "normalmap with the tangents of Mitsuba's mesh.",
    ),
    feature(
        "[material] bump",
        Dropped,
        "bump, and normal_map with a tangent of its own: the material without it.",
    ),
    feature(
        "[material] emissive",
        Approximated,
        "An area emitter: it emits on the outside only, and lights other surfaces also without an area light.",
    ),
    feature(
        "[material] emissive in a group",
        Dropped,
        "Mitsuba's groups cannot contain emitters.",
    ),
    feature(
        "[texture] mapping",
        Dropped,
        "Only mappings by (u, v): the mean of a and b.",
    ),
    feature(
        "[texture] of another type",
        Dropped,
        "The mean of a and b, or grey.",
    ),
    feature("[texture] image with a channel", Dropped, "Grey."),
    feature("[texture] color_space", Dropped, "An EXR is linear."),
    feature("[texture] filter", Approximated, "bilinear."),
    feature("[texture] wrap", Approximated, "That along u in both directions."),
    feature("plugins of third parties", Dropped, "They are not known."),
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

    fn export(&self, scene: &ExportScene<'_>, path: &Path) -> Option<Result<Vec<Note>, FormatErrors>> {
        Some(export::export(scene, path, false))
    }
}

impl SceneFormat for MitsubaPython {
    fn name(&self) -> &'static str {
        "mitsuba-python"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["py"]
    }

    fn features(&self) -> &'static [Feature] {
        FEATURES
    }

    fn export(&self, scene: &ExportScene<'_>, path: &Path) -> Option<Result<Vec<Note>, FormatErrors>> {
        Some(export::export(scene, path, true))
    }
}

fn import(path: &Path, options: &ImportOptions) -> Result<Imported, FormatErrors> {
    let folder = Folder::of(path, options);
    let scene = xml::load(path, &folder)?;
    Translator::new(&scene, &folder, options).translate()
}

#[cfg(test)]
mod tests;
