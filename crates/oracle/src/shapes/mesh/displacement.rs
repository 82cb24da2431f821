//! Displacement mapping: section 9 of the model.

use super::subdivision::Joined;
use crate::tracer::texture::Height;
use serde::Deserialize;
use whitstone_core::config::TextureRef;
use whitstone_core::{DVec3, SceneErrors};
use whitstone_scene::Description;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Config {
    height: TextureRef,
    scale: Option<f64>,
    offset: Option<f64>,
}

/// Displaces all points along their normals.
pub(super) fn displace(
    mesh: &mut Joined,
    config: &Config,
    description: &Description<'_>,
) -> Result<(), SceneErrors> {
    let height = Height::new(description, &config.height)?;
    let normals = mesh.normals();
    // For each point, the sum of the heights of its corners, and their number.
    let mut heights = vec![(0.0, 0.0); mesh.points.len()];
    for (corners, uvs) in &mesh.faces {
        let uvs = uvs.unwrap_or_default();
        for (corner, uv) in corners.iter().zip(uvs) {
            let (sum, count) = &mut heights[*corner];
            *sum += height.at(mesh.points[*corner], normals[*corner], uv);
            *count += 1.0;
        }
    }
    let (scale, offset) = (config.scale.unwrap_or(1.0), config.offset.unwrap_or(0.0));
    for ((point, normal), (sum, count)) in mesh.points.iter_mut().zip(normals).zip(heights) {
        if normal != DVec3::ZERO {
            *point += normal * (scale * (sum / count - offset));
        }
    }
    Ok(())
}
