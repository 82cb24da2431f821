//! pbrt-v4's scene files. Experimental: common scenes are read and written.
//!
//! Source: the file format documentation of pbrt-v4 (<https://pbrt.org/fileformat-v4>), and its
//! parser where the documentation leaves something open.

mod camera;
mod export;
mod light;
mod material;
mod params;
mod scene;
mod shape;
mod texture;
mod token;

use crate::files::Folder;
use std::path::Path;
use whitstone_core::{ExportScene, Feature, FormatErrors, ImportOptions, Imported, Note, SceneFormat};

/// pbrt-v4's scene files.
pub struct Pbrt;

/// What happens to pbrt's directives, plugins and parameters when they are imported, and to the
/// parts of a scene when they are exported: the latter begin with a bracket and come last. Imported
/// plugins and parameters that are not listed are errors.
const FEATURES: &[Feature] = features! {
    Kept "this format": "Experimental: what cannot be read is an error with its line and column.";
    Kept "directives": "Transforms, attributes, coordinate systems, Include, Import, Attribute and objects are resolved.";
    Kept "left-handed camera": "pbrt is left-handed: the scene is mirrored, unless the file itself flips x before its camera.";
    Dropped "ActiveTransform, TransformTimes": "Nothing moves: transforms are those of the time at which the shutter opens.";
    Dropped "MakeNamedMedium, MediumInterface": "There are no participating media.";
    Dropped "Option forcediffuse": "Materials are as in the file.";
    Approximated "Film gbuffer, spectral": "As rgb, without additional channels.";
    Kept "iso, shutteropen, shutterclose": "All lights are multiplied by the exposure.";
    Dropped "sensor, whitebalance": "The image is linear RGB as of the sensor cie1931.";
    Approximated "PixelFilter": "Pixels are means over their square: a box filter of radius 0.5.";
    Approximated "Sampler": "sobol with at most 64 samples; stratified and sobol are kept.";
    Approximated "Integrator": "whitted with maxdepth - 1 bounces: diffuse surfaces do not light each other.";
    Kept "Camera perspective": "perspective, or thin_lens with a lensradius.";
    Kept "Camera orthographic": "orthographic.";
    Kept "Camera spherical": "environment; only the equirectangular mapping.";
    Dropped "lensradius of an orthographic camera": "Everything is in focus.";
    Kept "spectra rgb": "Linear sRGB.";
    Approximated "blackbody": "Its linear RGB with luminance 1; channels below 0 are 0.";
    Approximated "sampled spectra": "Their linear RGB.";
    Approximated "named glasses": "Their index of refraction at 587.6 nm: there is no dispersion.";
    Kept "LightSource point": "point.";
    Kept "LightSource distant": "directional.";
    Approximated "LightSource spot": "spot, whose falloff is linear in the angle instead of smooth in its cosine.";
    Approximated "LightSource infinite": "An environment of one colour that lights from 32 directions; images are errors.";
    Approximated "AreaLightSource": "An area light of 16 points, or one of each triangle of a mesh, and a shape that emits.";
    Approximated "twosided": "Both sides of spheres and meshes are visible, but only the outside lights.";
    Approximated "area light without a light": "The surface is visible, but lights no other surface.";
    Kept "area light on an interface": "As in pbrt, the shape is not visible and does not light.";
    Kept "Shape sphere": "sphere; parts of it are errors.";
    Kept "Shape disk": "disk; parts of it are errors.";
    Kept "Shape cylinder": "cylinder without caps; parts of it are errors.";
    Kept "Shape trianglemesh": "Each triangle becomes a shape. More than 64 triangles are an error: they belong into a PLY file.";
    Kept "Shape plymesh": "mesh.";
    Kept "Shape bilinearmesh": "Each patch becomes a rectangle or polygon, at most 32; patches that are not flat are errors.";
    Dropped "N of bilinearmesh": "The patches are flat.";
    Approximated "(u, v) of a disk or patch": "They follow Whitstone's definition instead of pbrt's.";
    Dropped "displacement of plymesh": "The mesh of the file.";
    Kept "ObjectBegin, ObjectInstance": "A group and instances.";
    Kept "alpha": "mask; an area light with the alpha 0 is not visible, but lights.";
    Approximated "alpha of a dielectric": "The larger of the two: glass without holes, or nothing.";
    Kept "Material diffuse": "matte.";
    Kept "Material dielectric": "dielectric.";
    Kept "Material thindielectric": "thin_dielectric.";
    Kept "Material conductor": "conductor.";
    Kept "Material mix": "mix, or mask with an interface.";
    Approximated "Material mix of two directions": "The larger part: a ray would be reflected, or pass, in two directions.";
    Kept "Material interface": "The shape is not in the scene.";
    Approximated "Material coateddiffuse": "plastic, of one factor for a texture; blinn_phong with the reflection at normal incidence if it is rough. Its coat is thin and clear.";
    Approximated "Material coatedconductor": "The conductor without its coating.";
    Dropped "Material diffusetransmission": "matte: nothing is transmitted.";
    Dropped "roughness of dielectric": "It is smooth.";
    Approximated "roughness of conductor": "glossy with the reflectance at normal incidence, which shows no highlights of point lights.";
    Approximated "texture of roughness": "The roughness is 0.1 everywhere.";
    Approximated "texture of the reflectance of a conductor": "mirror: the reflectance is the same at all angles.";
    Approximated "displacement of a material": "bump: its slope is a difference over 0.002, in metres and in (u, v).";
    Dropped "normalmap of a material": "Normals are those of the shape.";
    Kept "Texture constant, scale, mix": "A colour, product, mix.";
    Kept "Texture imagemap": "image.";
    Kept "Texture checkerboard": "checker or checker3d.";
    Approximated "scale above 1": "Of an imagemap: products above 1 stay, where pbrt takes 1 as a reflectance.";
    Approximated "float imagemap": "Each channel by itself instead of their mean.";
    Approximated "encoding gamma": "As sRGB.";
    Approximated "wrap black": "clamp.";
    Kept "mapping uv, planar, cylindrical": "The same mapping.";
    Dropped "[film] layers": "The image has no additional channels.";
    Dropped "[camera] near": "pbrt's cameras have no near limit.";
    Approximated "[camera] thin_lens": "perspective with a lensradius, through random points of the lens.";
    Approximated "[sampler] adaptive": "sobol with the most samples.";
    Approximated "[integrator]": "path with max_depth + 1 vertices, or 1: diffuse surfaces also light each other.";
    Approximated "[integrator] shadows": "Shadows are opaque.";
    Approximated "[integrator] light_cutoff": "All lights count, however faint.";
    Dropped "[[light]] falloff none": "Lights in pbrt always fall off with the squared distance.";
    Approximated "[[light]] spot": "spot, whose falloff is smooth in the cosine of the angle.";
    Dropped "[[light]] image of a spot": "The light is written without it.";
    Approximated "[[light]] area": "An area light, which lights from random points; without a visible surface its alpha is 0.";
    Dropped "[[light]] ambient": "pbrt has no ambient light.";
    Dropped "[[light]] projector": "It is not written.";
    Approximated "[[light]] background, environment": "infinite: it lights from all directions.";
    Dropped "[[light]] environment with an image": "pbrt's maps have an equal-area mapping.";
    Approximated "[[shape]] plane": "A square of 200 km.";
    Approximated "[[shape]] disk, polygon or plane with a texture": "The texture has the coordinates of pbrt's shape.";
    Dropped "[[shape]] polygon that is not convex": "Only convex polygons are written.";
    Kept "[[shape]] triangles": "PLY files are copied; other meshes and height fields are written as PLY.";
    Approximated "[[shape]] mesh with displacement": "The mesh without it.";
    Approximated "[[shape]] mesh with colors": "The mesh without them.";
    Dropped "[[shape]] heightfield with a texture": "Only heights of noise or of one number are written.";
    Dropped "[[shape]] instance in a group": "pbrt's objects cannot contain instances.";
    Dropped "[[shape]] materials of an instance": "Its shapes have the materials of their group.";
    Dropped "[[shape]] without a shadow": "Every surface casts shadows.";
    Dropped "[[shape]] motion": "It stands still, where its first keyframe places it.";
    Dropped "[[shape]] of another type": "pbrt has no such shape.";
    Approximated "[material] mirror": "A conductor with this reflectance at normal incidence.";
    Approximated "[material] glossy": "A rough conductor of the same width.";
    Approximated "[material] phong, blinn_phong, whitted": "diffuse with pi k_d, mixed with a conductor of k_refl; no highlight.";
    Dropped "[material] k_refr": "Nothing is transmitted.";
    Approximated "[material] texture of k_d": "It is the albedo, without the factor pi.";
    Dropped "[material] texture of a highlight or reflection": "The default of the parameter.";
    Dropped "[material] texture of a radiance": "The radiance is 1.";
    Approximated "[material] coloured weight": "The mean of its channels.";
    Dropped "[material] tint": "Metals and panes have no tint.";
    Dropped "[material] absorption": "Glass is clear.";
    Approximated "[material] plastic": "coateddiffuse, whose light is scattered at random; a texture is the albedo of the base.";
    Approximated "[material] rough": "A rough conductor or dielectric of the same width; other materials are smooth.";
    Dropped "[material] tabulated": "It is replaced by diffuse grey.";
    Dropped "[material] priority": "pbrt's bodies must not overlap.";
    Approximated "[material] reflection_map": "Its material, which traces reflections.";
    Dropped "[material] two_sided": "The front on both sides.";
    Dropped "[material] normal_map, bump": "The material without them.";
    Dropped "[material] mask in another material": "Only whole shapes have an alpha.";
    Approximated "[material] emissive": "An area light: it lights other surfaces also without an area light in the scene.";
    Dropped "[material] emissive in a group": "pbrt's objects cannot contain lights.";
    Dropped "[texture] mapping": "A texture with another mapping than (u, v) or a plane's is replaced by one colour: the mean of its keys `a` and `b`, or grey.";
    Dropped "[texture] of another type": "It is replaced by one colour: the mean of its keys `a` and `b`, or grey.";
    Dropped "[texture] image of another format": "Grey: images of glTF files and WebP.";
    Dropped "[texture] image with a channel": "Grey.";
    Dropped "[texture] product": "A texture times a number: other textures and the tint are not written.";
    Dropped "[texture] color_space": "JPEG is sRGB and EXR is linear.";
    Approximated "[texture] wrap": "That along u, or repeat instead of mirror.";
    Dropped "[*] plugins of third parties": "The exporter does not know them.";
};

impl SceneFormat for Pbrt {
    fn name(&self) -> &'static str {
        "pbrt"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["pbrt"]
    }

    fn features(&self) -> &'static [Feature] {
        FEATURES
    }

    fn import(&self, path: &Path, options: &ImportOptions) -> Option<Result<Imported, FormatErrors>> {
        let folder = Folder::of(path, options);
        Some(scene::Importer::new(&folder, options).import(path))
    }

    fn export(&self, scene: &ExportScene<'_>, path: &Path) -> Option<Result<Vec<Note>, FormatErrors>> {
        Some(export::export(scene, path))
    }
}

#[cfg(test)]
mod tests;
