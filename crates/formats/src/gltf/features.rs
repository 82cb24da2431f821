use whitstone_core::Feature;

/// What happens to each part of a glTF file.
pub(crate) const FEATURES: &[Feature] = features! {
    Kept "scenes and nodes": "One scene is imported, by default that of `scene`; matrices and translation, rotation, scale; negative scales.";
    Kept "instances": "A mesh that several nodes use becomes a group with instances.";
    Kept "EXT_mesh_gpu_instancing": "Each instance becomes an instance of a group.";
    Kept "invisible nodes": "Nodes that KHR_node_visibility hides are left out, with everything below them.";
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
    Kept "KHR_lights_punctual": "Numbers as they are: candela as W/sr, lux as W/m2; with `photometric` divided by 683 lm/W.";
    Kept "KHR_texture_transform": "As the transform of the texture's mapping.";
    Kept "EXT_texture_webp": "The WebP image is used.";
    Kept "KHR_materials_unlit": "An emissive material.";
    Kept "KHR_materials_emissive_strength": "It multiplies the emissive factor.";
    Kept "alpha mode BLEND": "A mask whose opacity is alpha; rays pass through up to 32 layers, unless they contribute less than 0.001.";
    Kept "alpha mode MASK": "A mask whose opacity is alpha cut at the cutoff; rays pass through up to 32 layers.";
    Kept "images": "PNG, JPEG and WebP; in files, data URIs and buffer views.";
    Kept "no material": "The default material of the specification.";
    Kept "no camera": "A camera that shows the whole scene is added.";
    Kept "no lights": "A directional light, an ambient light and a grey background are added.";
    Kept "Whitstone scene": "The scene that `extras` of an exported file hold is imported as it was, except that the meshes of files have single precision.";
    Kept "[[shape]] mesh": "In single precision, also normals and texture coordinates; polygons and strips become triangles.";
    Kept "[scene]": "`extras` of the file hold the whole scene for Whitstone.";
    Kept "[scene] files next to a .glb": "What glTF cannot embed, such as EXR images, faces of a sky, and meshes that are lights or operands, is copied to a folder next to the file.";
    Approximated "metallic-roughness": "A `whitted` material: diffuse, a highlight, and below a roughness of 0.5 mirror reflection.";
    Approximated "roughness texture": "The roughness factor alone is used.";
    Approximated "mip maps": "Trilinear filtering over the footprint of a sample.";
    Approximated "filters that differ": "The magnification filter is used for both.";
    Approximated "tangents from texture coordinates": "Means over the triangles at a vertex instead of MikkTSpace.";
    Approximated "KHR_materials_transmission": "Mixed with the surface by factor, texture and metalness; a pane without thickness, unless it has a volume; roughness does not blur it.";
    Approximated "KHR_materials_volume": "A dielectric with absorption; the mesh must be closed.";
    Approximated "base colour of a volume": "It is absorbed over the stated thickness; a texture is left out.";
    Approximated "KHR_materials_ior": "The reflectance at normal incidence, and refraction with a volume.";
    Approximated "KHR_materials_specular": "Its factor and colour scale the reflectance; its textures are dropped.";
    Approximated "single-sided materials": "Back faces are visible.";
    Approximated "spot light falloff": "Linear in the angle between the inner and the outer cone.";
    Approximated "mirrored cameras": "The image is neither mirrored nor turned.";
    Approximated "Whitstone scene, changed": "Another program has changed the file: it is imported like those of other programs.";
    Approximated "Whitstone scene, in parts": "Selected parts, stretched scenes and turned environments are imported like those of other programs.";
    Approximated "[[shape]] mesh far from its own origin": "Single precision may move its vertices by more than a millionth of its size.";
    Approximated "[[shape]] mesh with displacement": "Other programs show it without; it is kept for Whitstone.";
    Approximated "[camera] thin_lens": "Other programs see a pinhole camera; it is kept for Whitstone.";
    Approximated "[camera] near_kind": "Other programs have a plane as near limit; it is kept for Whitstone.";
    Approximated "[camera] negative near": "Other programs see from the perspective camera on; it is kept for Whitstone.";
    Approximated "[camera] window that is not centred": "Other programs see a centred window of the same size; it is kept for Whitstone.";
    Approximated "[[light]] falloff none": "In other programs lights fall off with the squared distance; it is kept for Whitstone.";
    Approximated "[[light]] image of a spot": "Other programs see the light without it; it is kept for Whitstone.";
    Approximated "[material] phong, blinn_phong, whitted": "The base colour is pi k_d, at most 1, plus k_refl; the exponent becomes a roughness; it is kept for Whitstone.";
    Approximated "[material] glossy": "A metal of the same width of reflection; it is kept for Whitstone.";
    Approximated "[material] conductor": "A metal with the reflectance at normal incidence; it is kept for Whitstone.";
    Approximated "[material] priority": "Other programs do not order overlapping bodies; it is kept for Whitstone.";
    Approximated "[material] mirror": "A metal, which reflects everything at grazing angles; it is kept for Whitstone.";
    Approximated "[material] refraction below 1": "An index of 1, the smallest that glTF has; it is kept for Whitstone.";
    Approximated "[material] exterior_absorption": "Nothing is absorbed outside; it is kept for Whitstone.";
    Approximated "[material] mix": "One material with parameters in between; it is kept for Whitstone.";
    Approximated "[material] reflection_map": "Its material, which traces reflections; it is kept for Whitstone.";
    Approximated "[material] two_sided": "The front on both sides; it is kept for Whitstone.";
    Approximated "[material] mask": "An opacity that is not the alpha of the base colour's image is constant; it is kept for Whitstone.";
    Approximated "[texture] product": "At most one image times a constant; it is kept for Whitstone.";
    Approximated "[texture] ewa": "Trilinear; it is kept for Whitstone.";
    Dropped "third texture coordinates": "A material uses at most two sets; textures of the others are left out.";
    Dropped "textures without an image": "They count as white.";
    Dropped "morph targets of colours and texture coordinates": "Only positions, normals and tangents are morphed.";
    Dropped "occlusion textures": "Shadows are computed.";
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
    Dropped "EXT_lights_image_based": "Its light is left out.";
    Dropped "unknown extensions": "They have no effect.";
    Dropped "[[shape]] without triangles": "Other programs do not show curved and infinite shapes and csg; they are kept for Whitstone.";
    Dropped "[[shape]] that is not written": "Other programs do not show it; it is kept for Whitstone with its file.";
    Dropped "[[shape]] instance beyond the limit": "Other programs show at most 200,000 nodes; it is kept for Whitstone.";
    Dropped "[[shape]] materials of an instance": "Other programs see the materials of the group; they are kept for Whitstone.";
    Dropped "[[shape]] without a shadow": "Other programs may show its shadow; it is kept for Whitstone.";
    Dropped "[[shape]] motion": "Other programs see it where its first keyframe places it; it is kept for Whitstone.";
    Dropped "[camera] of another type": "Other programs see no camera; it is kept for Whitstone.";
    Dropped "[[light]] of another type": "Other programs see point, directional and spot lights; it is kept for Whitstone.";
    Dropped "[material] of another type": "Other programs see grey; it is kept for Whitstone.";
    Dropped "[material] bump": "Other programs see tangent-space normal maps of meshes only; it is kept for Whitstone.";
    Dropped "[texture] of another type": "Other programs see the mean of a and b, or grey; it is kept for Whitstone.";
    Dropped "[texture] image": "Other programs see grey instead of channels, EXR images, and images that are not mapped by texture coordinates; it is kept for Whitstone.";
    Dropped "[texture] mapping": "Other programs see the image without a transform that shears; it is kept for Whitstone.";
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
