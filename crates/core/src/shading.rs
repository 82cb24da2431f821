//! What happens to light: cameras, lights, materials, textures, integrators and the scene that they
//! share.

pub(crate) mod camera;
pub(crate) mod color;
pub mod direction_map;
pub(crate) mod glossy_lobe;
pub(crate) mod integrator;
pub(crate) mod light;
pub(crate) mod light_tree;
pub(crate) mod material;
pub(crate) mod nested_dielectrics;
pub(crate) mod object_order;
pub(crate) mod path;
pub(crate) mod path_classes;
pub mod ray_differential;
pub(crate) mod sampler;
pub(crate) mod shadow;
pub(crate) mod tangent_field;
pub(crate) mod texture;
