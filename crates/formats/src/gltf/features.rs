use whitstone_core::Feature;
use whitstone_core::Treatment::{Approximated, Dropped, Kept};

macro_rules! features {
    ($($treatment:ident $name:literal: $how:literal;)*) => {
        &[$(Feature { name: $name, treatment: $treatment, how: $how }),*]
    };
}

/// What happens to each part of a glTF file.
pub(crate) const FEATURES: &[Feature] = features! {
    Kept "scenes and nodes": "One scene is imported, by default that of `scene`; matrices and translation, rotation, scale; negative scales.";
    Kept "instances": "A mesh that several nodes use becomes a group with instances.";
    Kept "EXT_mesh_gpu_instancing": "Each instance becomes an instance of a group.";
    Kept "accessors": "All component types, normalised, interleaved, sparse and zero-filled ones.";
    Kept "KHR_mesh_quantization": "Integers are converted to double precision.";
    Kept "triangles, strips and fans": "In the order of the specification.";
    Kept "normals": "Interpolated and normalised; a primitive without normals is flat.";
    Kept "texture coordinates": "All sets; a material uses at most two of them.";
    Kept "vertex colours": "They multiply the base colour.";
    Kept "tangents": "Interpolated, for normal maps.";
    Kept "morph targets": "With the weights of the node or of the mesh.";
    Kept "skins": "In the pose of the nodes in the file.";
    Kept "perspective and orthographic cameras": "The aspect ratio determines the shape of the film; `znear` is the near limit.";
    Kept "KHR_lights_punctual": "Numbers as they are: candela as W/sr, lux as W/m2.";
    Kept "KHR_texture_transform": "As the transform of the texture's mapping.";
    Kept "EXT_texture_webp": "The WebP image is used.";
    Kept "KHR_materials_unlit": "An emissive material.";
    Kept "KHR_materials_emissive_strength": "It multiplies the emissive factor.";
    Kept "alpha mode BLEND": "A mask whose opacity is alpha.";
    Kept "alpha mode MASK": "A mask whose opacity is alpha cut at the cutoff.";
    Kept "images": "PNG, JPEG and WebP; in files, data URIs and buffer views.";
    Kept "no material": "The default material of the specification.";
    Kept "no camera": "A camera that shows the whole scene is added.";
    Kept "no lights": "A directional light, an ambient light and a grey background are added.";
    Approximated "metallic-roughness": "A `whitted` material: diffuse, a highlight, and below a roughness of 0.5 mirror reflection.";
    Approximated "roughness texture": "The roughness factor alone is used.";
    Approximated "mip maps": "Trilinear filtering over the footprint of a sample.";
    Approximated "filters that differ": "The magnification filter is used for both.";
    Approximated "tangents from texture coordinates": "Means over the triangles at a vertex instead of MikkTSpace.";
    Approximated "KHR_materials_transmission": "A pane without thickness; roughness does not blur it.";
    Approximated "KHR_materials_volume": "A dielectric with absorption; the mesh must be closed.";
    Approximated "KHR_materials_ior": "The reflectance at normal incidence, and refraction with a volume.";
    Approximated "KHR_materials_specular": "Its factor and colour scale the reflectance; its textures are dropped.";
    Approximated "single-sided materials": "Back faces are visible.";
    Approximated "spot light falloff": "Linear in the angle between the inner and the outer cone.";
    Approximated "mirrored cameras": "The image is not mirrored.";
    Dropped "third texture coordinates": "A material uses at most two sets; textures of the others are left out.";
    Dropped "textures without an image": "They count as white.";
    Dropped "occlusion textures": "Shadows are computed.";
    Dropped "transmission texture": "The factor alone is used.";
    Dropped "alpha of refracting materials": "A refracting material has no opacity.";
    Dropped "points and lines": "They have no surface.";
    Dropped "nodes without volume": "A transform that flattens everything cannot be inverted.";
    Dropped "animations": "The scene is imported as the nodes stand in the file.";
    Dropped "light range": "Light has no limit.";
    Dropped "far limit": "Cameras have no far limit.";
    Dropped "other cameras": "A scene has one camera; the option `camera` selects it.";
    Dropped "KHR_materials_clearcoat": "There is no second layer.";
    Dropped "KHR_materials_sheen": "There is no model of cloth.";
    Dropped "KHR_materials_iridescence": "There are no thin films.";
    Dropped "KHR_materials_anisotropy": "Highlights are round.";
    Dropped "KHR_materials_dispersion": "Light has no wavelength.";
    Dropped "KHR_materials_diffuse_transmission": "Nothing scatters light through a surface.";
    Dropped "KHR_materials_pbrSpecularGlossiness": "The metallic-roughness values of the file are used instead.";
    Dropped "KHR_materials_variants": "The material of the primitive is used.";
    Dropped "unknown extensions": "They have no effect.";
};

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn names_are_distinct() {
        let names: BTreeSet<&str> = FEATURES.iter().map(|feature| feature.name).collect();
        assert_eq!(names.len(), FEATURES.len());
    }
}
