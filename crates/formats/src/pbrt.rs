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
mod spectrum;
mod texture;
mod token;

use crate::files::Folder;
use std::path::Path;
use whitstone_core::{
    ExportScene, Feature, FormatErrors, ImportOptions, Imported, Note, SceneFormat, Treatment,
};

/// pbrt-v4's scene files.
pub struct Pbrt;

use Treatment::{Approximated, Dropped, Kept};

const fn feature(name: &'static str, treatment: Treatment, how: &'static str) -> Feature {
    Feature { name, treatment, how }
}

/// What happens to pbrt's directives, plugins and parameters when they are imported, and to the
/// parts of a scene when they are exported: the latter begin with a bracket. Imported plugins and
/// parameters that are not listed are errors.
const FEATURES: &[Feature] = &[
    feature(
        "this format",
        Kept,
        "Experimental: what cannot be read is an error with its line and column.",
    ),
    feature(
        "directives",
        Kept,
        "Transforms, attributes, coordinate systems, Include, Import, Attribute and objects are resolved.",
    ),
    feature(
        "left-handed camera",
        Kept,
        "A scene without Scale -1 1 1 before its camera is mirrored, so that the image is the same.",
    ),
    feature(
        "ActiveTransform, TransformTimes",
        Dropped,
        "Nothing moves: transforms are those of the time at which the shutter opens.",
    ),
    feature(
        "MakeNamedMedium, MediumInterface",
        Dropped,
        "There are no participating media.",
    ),
    feature("Option forcediffuse", Dropped, "Materials are as in the file."),
    feature(
        "Film gbuffer, spectral",
        Approximated,
        "As rgb, without additional channels.",
    ),
    feature(
        "iso, shutteropen, shutterclose",
        Kept,
        "All lights are multiplied by the exposure.",
    ),
    feature(
        "sensor, whitebalance",
        Dropped,
        "The image is linear RGB as of the sensor cie1931.",
    ),
    feature(
        "PixelFilter",
        Approximated,
        "Pixels are means over their square: a box filter of radius 0.5.",
    ),
    feature(
        "Sampler",
        Approximated,
        "sobol with at most 64 samples; stratified and sobol are kept.",
    ),
    feature(
        "Integrator",
        Approximated,
        "whitted with maxdepth - 1 bounces: diffuse surfaces do not light each other.",
    ),
    feature(
        "Camera perspective",
        Kept,
        "perspective, or thin_lens with a lensradius.",
    ),
    feature("Camera orthographic", Kept, "orthographic."),
    feature(
        "Camera spherical",
        Kept,
        "environment; only the equirectangular mapping.",
    ),
    feature(
        "lensradius of an orthographic camera",
        Dropped,
        "Everything is in focus.",
    ),
    feature("spectra rgb", Kept, "Linear sRGB."),
    feature(
        "blackbody",
        Approximated,
        "Its linear RGB with luminance 1; channels below 0 are 0.",
    ),
    feature("sampled spectra", Approximated, "Their linear RGB."),
    feature(
        "named glasses",
        Approximated,
        "Their index of refraction at 587.6 nm: there is no dispersion.",
    ),
    feature("LightSource point", Kept, "point."),
    feature("LightSource distant", Kept, "directional."),
    feature(
        "LightSource spot",
        Approximated,
        "spot, whose falloff is linear in the angle instead of smooth in its cosine.",
    ),
    feature(
        "LightSource infinite",
        Approximated,
        "An environment of one colour that lights from 32 directions; images are errors.",
    ),
    feature(
        "AreaLightSource",
        Approximated,
        "An area light of 16 points, or one of each triangle of a mesh, and a shape that emits.",
    ),
    feature(
        "twosided",
        Approximated,
        "Both sides of spheres and meshes are visible, but only the outside lights.",
    ),
    feature(
        "area light without a light",
        Approximated,
        "The surface is visible, but lights no other surface.",
    ),
    feature(
        "area light on an interface",
        Dropped,
        "As in pbrt, the shape is not visible and does not light.",
    ),
    feature("Shape sphere", Kept, "sphere; parts of it are errors."),
    feature("Shape disk", Kept, "disk; parts of it are errors."),
    feature(
        "Shape cylinder",
        Kept,
        "cylinder without caps; parts of it are errors.",
    ),
    feature(
        "Shape trianglemesh",
        Kept,
        "A triangle each, at most 64; larger ones are errors.",
    ),
    feature("Shape plymesh", Kept, "mesh."),
    feature(
        "Shape bilinearmesh",
        Kept,
        "A rectangle or polygon each, at most 32; patches that are not flat are errors.",
    ),
    feature("N of bilinearmesh", Dropped, "The patches are flat."),
    feature("(u, v) of a disk or patch", Approximated, "Those of the model."),
    feature("displacement of plymesh", Dropped, "The mesh of the file."),
    feature("ObjectBegin, ObjectInstance", Kept, "A group and instances."),
    feature("alpha", Kept, "mask; a light that is not visible with 0."),
    feature(
        "alpha of a dielectric",
        Dropped,
        "A material that refracts has no holes.",
    ),
    feature("Material diffuse", Kept, "matte."),
    feature("Material dielectric", Kept, "dielectric."),
    feature("Material thindielectric", Kept, "thin_dielectric."),
    feature("Material conductor", Kept, "conductor."),
    feature("Material mix", Kept, "mix, or mask with an interface."),
    feature("Material interface", Kept, "The shape is not in the scene."),
    feature(
        "Material coateddiffuse",
        Approximated,
        "whitted, or blinn_phong if it is rough: the reflection is that at normal incidence.",
    ),
    feature(
        "Material coatedconductor",
        Approximated,
        "The conductor without its coating.",
    ),
    feature(
        "Material diffusetransmission",
        Dropped,
        "matte: nothing is transmitted.",
    ),
    feature("roughness of dielectric", Dropped, "It is smooth."),
    feature(
        "roughness of conductor",
        Approximated,
        "glossy with the reflectance at normal incidence: point lights give no highlight.",
    ),
    feature(
        "texture of roughness",
        Approximated,
        "The roughness is 0.1 everywhere.",
    ),
    feature(
        "texture of the reflectance of a conductor",
        Approximated,
        "mirror: the reflectance is the same at all angles.",
    ),
    feature(
        "displacement, normalmap of a material",
        Dropped,
        "Normals are those of the shape.",
    ),
    feature("Texture constant, scale, mix", Kept, "A colour, product, mix."),
    feature("Texture imagemap", Kept, "image."),
    feature("Texture checkerboard", Kept, "checker or checker3d."),
    feature(
        "float imagemap",
        Approximated,
        "Each channel by itself instead of their mean.",
    ),
    feature("encoding gamma", Approximated, "As sRGB."),
    feature("wrap black", Approximated, "clamp."),
    feature("mapping uv, planar, cylindrical", Kept, "The same mapping."),
    feature("[film] aovs", Dropped, "The image has no additional channels."),
    feature("[camera] near", Dropped, "pbrt's cameras have no near limit."),
    feature(
        "[camera] thin_lens",
        Approximated,
        "perspective with a lensradius, through random points of the lens.",
    ),
    feature("[sampler] adaptive", Approximated, "sobol with the most samples."),
    feature(
        "[integrator]",
        Approximated,
        "path with max_depth + 1 vertices, or 1: diffuse surfaces also light each other.",
    ),
    feature("[integrator] shadows", Approximated, "Shadows are opaque."),
    feature("[[light]] falloff", Dropped, "pbrt's lights have a falloff."),
    feature(
        "[[light]] spot",
        Approximated,
        "spot, whose falloff is smooth in the cosine of the angle.",
    ),
    feature(
        "[[light]] area",
        Approximated,
        "An area light, which lights from random points; without a visible surface its alpha is 0.",
    ),
    feature("[[light]] ambient", Dropped, "pbrt has no ambient light."),
    feature("[[light]] projector", Dropped, "It is not written."),
    feature(
        "[[light]] background, environment",
        Approximated,
        "infinite: it lights from all directions.",
    ),
    feature(
        "[[light]] environment with an image",
        Dropped,
        "pbrt's maps have an equal-area mapping.",
    ),
    feature("[[shape]] plane", Approximated, "A square of 200 km."),
    feature(
        "[[shape]] disk, polygon or plane with a texture",
        Approximated,
        "The texture has the coordinates of pbrt's shape.",
    ),
    feature(
        "[[shape]] polygon that is not convex",
        Dropped,
        "Only convex polygons are written.",
    ),
    feature(
        "[[shape]] mesh of another format",
        Dropped,
        "PLY files are copied, and OBJ files are written as PLY.",
    ),
    feature(
        "[[shape]] mesh with subdivision or displacement",
        Approximated,
        "The mesh of the file.",
    ),
    feature(
        "[[shape]] mesh with a skin or colors",
        Approximated,
        "The mesh of the file without them.",
    ),
    feature(
        "[[shape]] mesh with flat shading",
        Approximated,
        "pbrt uses the normals of a PLY file.",
    ),
    feature(
        "[[shape]] instance in a group",
        Dropped,
        "pbrt's objects cannot contain instances.",
    ),
    feature("[[shape]] of another type", Dropped, "pbrt has no such shape."),
    feature(
        "[material] mirror",
        Approximated,
        "A conductor with this reflectance at normal incidence.",
    ),
    feature(
        "[material] glossy",
        Approximated,
        "A rough conductor of the same width.",
    ),
    feature(
        "[material] phong, blinn_phong, whitted",
        Approximated,
        "diffuse with pi k_d, mixed with a conductor of k_refl; no highlight.",
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
        "The default of the parameter.",
    ),
    feature("[material] texture of a radiance", Dropped, "The radiance is 1."),
    feature(
        "[material] coloured weight",
        Approximated,
        "The mean of its channels.",
    ),
    feature("[material] tint", Dropped, "Metals and panes have no tint."),
    feature("[material] absorption", Dropped, "Glass is clear."),
    feature("[material] priority", Dropped, "pbrt's bodies must not overlap."),
    feature("[material] two_sided", Dropped, "The front on both sides."),
    feature(
        "[material] normal_map, bump",
        Dropped,
        "The material without them.",
    ),
    feature(
        "[material] mask in another material",
        Dropped,
        "Only whole shapes have an alpha.",
    ),
    feature(
        "[material] emissive",
        Approximated,
        "An area light: it lights other surfaces also without an area light in the scene.",
    ),
    feature(
        "[material] emissive in a group",
        Dropped,
        "pbrt's objects cannot contain lights.",
    ),
    feature(
        "[texture] mapping",
        Dropped,
        "Only mappings by (u, v) and in a plane: the mean of a and b.",
    ),
    feature(
        "[texture] of another type",
        Dropped,
        "The mean of a and b, or grey.",
    ),
    feature(
        "[texture] image of another format",
        Dropped,
        "Grey: images of glTF files and WebP.",
    ),
    feature("[texture] image with a channel", Dropped, "Grey."),
    feature(
        "[texture] product",
        Dropped,
        "A texture times a number: other textures and the tint are not written.",
    ),
    feature(
        "[texture] color_space",
        Dropped,
        "JPEG is sRGB and EXR is linear.",
    ),
    feature(
        "[texture] wrap",
        Approximated,
        "That along u, or repeat instead of mirror.",
    ),
    feature("plugins of third parties", Dropped, "They are not known."),
];

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
