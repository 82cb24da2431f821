//! Displacement mapping: section 9 of the model.

use super::subdivision::Joined;
use crate::tracer::tangent::Tangent;
use crate::tracer::texture::VertexTexture;
use serde::Deserialize;
use whitstone_core::config::TextureRef;
use whitstone_core::{DVec3, SceneError, SceneErrors};
use whitstone_scene::Description;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Config {
    height: Option<TextureRef>,
    vector_map: Option<TextureRef>,
    scale: Option<f64>,
    offset: Option<f64>,
    space: Option<String>,
    tangent: Option<[f64; 3]>,
    axis: Option<[f64; 3]>,
}

/// Displaces all points along their normals, or by vectors.
pub(super) fn displace(
    mesh: &mut Joined,
    config: &Config,
    description: &Description<'_>,
) -> Result<(), SceneErrors> {
    let missing = || SceneError::anywhere("a displacement without a texture");
    let by_vectors = config.vector_map.is_some();
    let reference = config.vector_map.as_ref().or(config.height.as_ref());
    let texture = VertexTexture::new(description, reference.ok_or_else(missing)?)?;
    let normals = mesh.normals();
    // For each point, the sum of the colours of its corners, and their number.
    let mut colors = vec![([0.0; 3], 0.0); mesh.points.len()];
    for (corners, uvs) in &mesh.faces {
        let uvs = uvs.unwrap_or_default();
        for (corner, uv) in corners.iter().zip(uvs) {
            let (sum, count) = &mut colors[*corner];
            let color = texture.at(mesh.points[*corner], normals[*corner], uv);
            *sum = std::array::from_fn(|k| sum[k] + color[k]);
            *count += 1.0;
        }
    }
    let (scale, offset) = (config.scale.unwrap_or(1.0), config.offset.unwrap_or(0.0));
    let in_tangent_space = config.space.as_deref() == Some("tangent");
    let tangent = in_tangent_space.then(|| Tangent::new(config.tangent, config.axis));
    for ((point, normal), (sum, count)) in mesh.points.iter_mut().zip(normals).zip(colors) {
        if normal == DVec3::ZERO {
            continue;
        }
        let color = sum.map(|sum| sum / count);
        let vector = color.map(|c| 2.0 * c - 1.0);
        let w = match &tangent {
            _ if !by_vectors => (color[0] - offset) * normal,
            None => DVec3::from_array(vector),
            Some(tangent) => tangent.at_vertex(normal, vector).unwrap_or(DVec3::ZERO),
        };
        *point += scale * w;
    }
    Ok(())
}
