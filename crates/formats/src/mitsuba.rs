//! Mitsuba 3's XML.
//!
//! Source: Mitsuba 3.9.1 (`src/core/parser.cpp` and the plugins), and the driver in
//! `references/mitsuba`, which maps the plugins of Whitstone to Mitsuba's where Mitsuba has them.

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
use whitstone_core::{ExportScene, Feature, FormatErrors, ImportOptions, Imported, Note, SceneFormat};

/// Mitsuba 3's XML.
pub struct Mitsuba;

/// A dictionary for Mitsuba 3's `load_dict`, as a Python file; only written.
pub struct MitsubaPython;

/// What happens to Mitsuba's plugins and parameters when they are imported, and to the parts of a
/// scene when they are exported: the latter begin with a bracket and come last. Imported plugins
/// that are not listed are errors.
const FEATURES: &[Feature] = features! {
    Kept "default, alias, ref, include, path": "They are resolved.";
    Dropped "sensors after the first": "A scene has one camera; the option `camera` selects it.";
    Approximated "to_world of a sensor that mirrors": "The image is not mirrored.";
    Kept "film hdrfilm": "Width, height and crop window; the format of the file has no effect.";
    Approximated "rfilter": "Pixels are means over their square: a box filter.";
    Approximated "sampler": "sobol with the same number of samples, at most 64.";
    Approximated "integrator direct": "appel: lights are points, and mirrors and glass are black.";
    Approximated "integrator path": "whitted with max_depth - 2 bounces, or max_depth - 1 in surroundings that shine: diffuse surfaces do not light each other.";
    Approximated "max_depth below 2": "No surface is lit; lamps and surroundings stay visible.";
    Approximated "integrator volpath": "As path, without media.";
    Approximated "integrator aov": "Its nested integrator; no additional channels.";
    Approximated "unlimited max_depth": "16 bounces, without rays that contribute less than 0.001.";
    Dropped "hide_emitters": "Emitters stay visible.";
    Kept "sensor perspective": "perspective; near_clip is its near limit.";
    Kept "sensor orthographic": "orthographic.";
    Kept "sensor thinlens": "thin_lens with 16 points of the lens.";
    Dropped "near_clip of a lens": "thin_lens has no near limit.";
    Dropped "far_clip": "There is no far limit.";
    Dropped "shutter_open, shutter_close": "Nothing moves.";
    Dropped "srf": "There are no spectra.";
    Approximated "spectrum of wavelengths": "Its colour, that of a reflectance under daylight (D65).";
    Kept "emitter point": "point.";
    Kept "emitter directional": "directional.";
    Kept "emitter spot": "spot; its texture is the image.";
    Kept "emitter projector": "projector, with pi times the scale as intensity.";
    Approximated "emitter constant": "An environment that lights from 32 directions.";
    Approximated "emitter envmap": "An environment that lights from 32 directions; what is visible is the same.";
    Approximated "envmap of unknown size": "The shift of Mitsuba's rows by half a texel is ignored, since it depends on the size.";
    Approximated "emitter area": "An area light of 16 points, and a shape that emits on one side.";
    Approximated "emitter area without a light": "The surface is visible, but lights no other surface.";
    Kept "shape sphere": "sphere.";
    Kept "shape rectangle": "rectangle.";
    Kept "shape disk": "disk.";
    Kept "shape cube": "box, or six rectangles if it has a texture.";
    Kept "shape cylinder": "cylinder without caps.";
    Kept "shape obj, shape ply": "mesh.";
    Approximated "mesh without normals": "It is flat: Mitsuba computes normals, unless face_normals is true.";
    Kept "shape shapegroup, shape instance": "A group and instances.";
    Kept "shape merge": "Its shapes.";
    Dropped "medium": "Media do not scatter.";
    Kept "bsdf diffuse": "matte; black from behind, unless it is in a twosided.";
    Kept "bsdf dielectric": "dielectric.";
    Kept "bsdf thindielectric": "thin_dielectric.";
    Kept "bsdf conductor": "conductor, or mirror without a material.";
    Approximated "bsdf roughconductor": "glossy with the reflectance at normal incidence, which shows no highlights of point lights.";
    Approximated "bsdf roughdielectric": "dielectric: it is smooth.";
    Kept "bsdf plastic": "plastic, with the exact diffuse reflectance of the coat.";
    Dropped "specular_reflectance of plastic": "The coat is clear.";
    Approximated "nonlinear plastic with a texture": "The texture is scaled as grey of 0.5 is.";
    Approximated "bsdf roughplastic": "blinn_phong: the highlight is that at normal incidence.";
    Kept "bsdf twosided": "The material itself, or two_sided.";
    Kept "bsdf mask": "mask; its opacity is the mean of the channels of a colour.";
    Approximated "holes in path and direct": "Light passes through holes; in Mitsuba they block the light of points and directions.";
    Approximated "opacity or weight by a bitmap": "Each channel has its own; Mitsuba takes the luminance of a coloured bitmap.";
    Approximated "mask of glass": "The larger of the two: glass without holes, or nothing.";
    Kept "bsdf blendbsdf": "mix.";
    Approximated "blendbsdf of two directions": "The larger part: a ray would be reflected, or pass, in two directions.";
    Kept "bsdf normalmap": "normal_map.";
    Approximated "normalmap on a mesh": "Tangents are those of the vertices, and the bitangent grows with v; in Mitsuba both follow u of each triangle.";
    Dropped "normalmap without tangents": "On a disk or in a group, only a mesh has tangents.";
    Dropped "use_shadowing_function": "Mitsuba darkens surfaces with a normal map or a bump map at grazing light, unless this is false.";
    Approximated "bsdf bumpmap": "bump; its height is the first channel of the texture, and its slope a difference over 0.0002 of (u, v).";
    Kept "bsdf null": "A mask that is open.";
    Dropped "specular_reflectance, specular_transmittance of glass": "A dielectric has no tint; a thin one has none for reflection.";
    Approximated "texture of alpha": "The roughness is 0.1 everywhere.";
    Kept "texture bitmap": "image.";
    Kept "texture checkerboard": "checker.";
    Dropped "[film] layers": "The image has no additional channels.";
    Dropped "[camera] environment": "Mitsuba has no panoramic sensor, and uses a default one.";
    Approximated "[camera] near_kind": "The near limit is a plane.";
    Dropped "[camera] negative near": "Rays start at a perspective camera, not behind it.";
    Approximated "[camera] pixels that are not square": "They are square; the width of the view is kept.";
    Approximated "[camera] window of a lens": "The view is centred.";
    Approximated "[sampler]": "independent with as many samples, at least 16: their positions are random.";
    Approximated "[integrator] whitted": "path: diffuse surfaces also light each other.";
    Approximated "[integrator] rasterizer": "direct.";
    Approximated "[integrator] shadows": "Shadows are opaque.";
    Approximated "[integrator] light_cutoff": "All lights count, however faint.";
    Dropped "[[light]] falloff none": "Lights in Mitsuba always fall off with the squared distance.";
    Approximated "[[light]] projector with a coloured intensity": "The mean of its channels.";
    Approximated "[[light]] area": "An emitter on a visible surface, which lights from random points.";
    Dropped "[[light]] ambient": "Mitsuba has no ambient light.";
    Approximated "[[light]] background": "constant: it also lights diffuse surfaces.";
    Approximated "[[light]] environment": "envmap or constant: it lights from all directions, and its rows are stretched to the poles.";
    Dropped "[[light]] several environments": "Mitsuba has one: the first with an image.";
    Dropped "[[light]] environment that is no plain image": "Only a colour, or an image that is not turned or transformed, is written.";
    Approximated "[texture] image of another format": "The mean of the colours, since Mitsuba reads neither WebP nor images in glTF files.";
    Approximated "[[shape]] plane with a texture": "The texture has the coordinates of a disk.";
    Dropped "[[shape]] cylinder that is stretched": "Mitsuba's cylinders have circular sections.";
    Kept "[[shape]] triangles": "Meshes of glTF and STL, subdivided meshes and height fields are written as PLY.";
    Approximated "[[shape]] mesh with displacement": "The mesh without it.";
    Dropped "[[shape]] heightfield with a texture": "Only heights of noise or of one number are written.";
    Dropped "[[shape]] instance in a group": "Mitsuba's groups cannot contain instances.";
    Dropped "[[shape]] materials of an instance": "Its shapes have the materials of their group.";
    Dropped "[[shape]] without a shadow": "Every surface casts shadows.";
    Dropped "[[shape]] motion": "It stands still, where its first keyframe places it.";
    Dropped "[[shape]] of another type": "Mitsuba has no such shape.";
    Approximated "[material] phong, blinn_phong, whitted": "diffuse with pi k_d, blended with a mirror of k_refl; no highlight.";
    Dropped "[material] k_refr": "Nothing is transmitted.";
    Approximated "[material] texture of k_d": "It is the albedo, without the factor pi.";
    Dropped "[material] texture of a highlight or reflection": "There is no reflection.";
    Approximated "[material] coloured weight": "The mean of its channels.";
    Approximated "[material] glossy": "roughconductor of the same width.";
    Approximated "[material] plastic with samples": "plastic: its reflections are sharp.";
    Approximated "[material] rough": "Rough metal or glass of the same width, which shows highlights; other materials are smooth.";
    Dropped "[material] tabulated": "It is replaced by diffuse grey.";
    Dropped "[material] priority": "Mitsuba's bodies must not overlap.";
    Approximated "[material] reflection_map": "Its material, which traces reflections.";
    Approximated "[material] two_sided that lets light through": "The front on both sides.";
    Approximated "[material] normal_map": "normalmap with the tangents of Mitsuba's mesh.";
    Approximated "[material] bump by an image over uv": "bumpmap: the height is the luminance, and its slope a derivative between the texels.";
    Dropped "[material] bump": "The material without it; the same for a normal_map that states its tangent.";
    Approximated "[material] emissive": "An area emitter: it emits on the outside only, and lights other surfaces also without an area light.";
    Dropped "[material] emissive in a group": "Mitsuba's groups cannot contain emitters.";
    Dropped "[texture] mapping": "A texture with another mapping than (u, v) is replaced by one colour: the mean of its keys `a` and `b`, or grey.";
    Dropped "[texture] of another type": "It is replaced by one colour: the mean of its keys `a` and `b`, or grey.";
    Dropped "[texture] image with a channel": "Grey.";
    Dropped "[texture] color_space": "An EXR is linear.";
    Approximated "[texture] filter": "bilinear.";
    Approximated "[texture] wrap": "That along u in both directions.";
    Dropped "[*] plugins of third parties": "The exporter does not know them.";
};

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
        crate::features::exported(FEATURES)
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
