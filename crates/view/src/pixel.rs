//! One pixel: its value, its layers, and its ray tree with the places of the rays in the picture.

use crate::scene::{Aspect, LAYERS, Loaded};
use serde_json::{Value, json};
use whitstone_core::{DMat4, DVec3, Registry, Rgb, TreeNode};
use whitstone_render::{Region, RenderOptions};
use whitstone_validate::tree;

/// Maximum number of rays that are reported.
const MAX_RAYS: usize = 2000;

/// Length of a drawn ray that hits nothing, in distances of the camera from its target.
const MISS: f64 = 20.0;

/// The report on a pixel of the finished picture, from one of its samples.
///
/// # Errors
/// If there is no such pixel or sample.
pub(crate) fn report(
    scene: &mut Loaded,
    aspect: Aspect,
    pixel: [u32; 2],
    sample: u32,
    registry: &Registry,
) -> Result<Value, String> {
    scene.prepare(
        Aspect {
            divisor: 1,
            preview: false,
            ..aspect
        },
        &LAYERS,
        registry,
    )?;
    let [x, y] = pixel;
    let (size, samples) = (scene.size, scene.pipeline.samples());
    if x >= size.width || y >= size.height {
        return Err(format!(
            "pixel ({x}, {y}) is outside the picture of {} x {} pixels",
            size.width, size.height
        ));
    }
    if sample >= samples {
        return Err(format!(
            "sample {sample} does not exist: a pixel has {samples} samples, numbered from 0"
        ));
    }
    let region = Region {
        x,
        y,
        width: 1,
        height: 1,
    };
    let film = scene.pipeline.render(RenderOptions {
        region: Some(region),
        threads: 1,
        ..RenderOptions::default()
    });
    film.check().map_err(|error| error.to_string())?;
    let layers = film
        .layers
        .iter()
        .map(|(name, values)| json!([name, values.first()]));
    let layers: Vec<Value> = layers.collect();
    let nodes = tree::ours(&scene.pipeline, pixel.map(|side| side as usize), sample);
    let far = scene.look_at.map_or(1.0, |look_at| {
        DVec3::from(look_at.origin).distance(DVec3::from(look_at.target))
    });
    let mut sorted: Vec<&TreeNode> = nodes.iter().collect();
    sorted.sort_by(|a, b| a.path.cmp(&b.path));
    let rays = sorted
        .iter()
        .take(MAX_RAYS)
        .map(|node| ray(node, scene, MISS * far));
    Ok(json!({
        "x": x,
        "y": y,
        "sample": sample,
        "samples": samples,
        "value": film.rgb.first(),
        "layers": layers,
        "rays": rays.collect::<Vec<_>>(),
        "all_rays": nodes.len(),
        "is_drawn": scene.pipeline.camera.projection().is_some(),
    }))
}

fn ray(node: &TreeNode, scene: &Loaded, far: f64) -> Value {
    let hit = node.shape >= 0;
    let end = match (hit, node.limit) {
        (true, _) => Some(node.position),
        (false, false) => Some(node.ray.origin + far * node.ray.direction),
        (false, true) => None,
    };
    let projection = scene.pipeline.camera.projection();
    let line = |end: DVec3| project([node.ray.origin, end], &projection?);
    let tip = |end: DVec3| project([end, end + 0.1 * node.n_s], &projection?);
    let name = usize::try_from(node.shape)
        .ok()
        .and_then(|shape| scene.shapes.get(shape));
    let color = |of: Rgb| of.to_array();
    json!({
        "path": node.path,
        "depth": tree::depth(&node.path),
        "shape": node.shape,
        "name": name,
        "primitive": node.primitive,
        // Null for a miss: JSON has no infinity.
        "t": node.t,
        "origin": node.ray.origin.to_array(),
        "direction": node.ray.direction.to_array(),
        "position": node.position.to_array(),
        "n_s": node.n_s.to_array(),
        "throughput": color(node.throughput),
        "local": color(node.local),
        "limit": node.limit,
        "line": end.and_then(line),
        "normal": end.filter(|_| hit).and_then(tip),
    })
}

/// The part of a segment in front of the camera, in the picture. Clipped before the division (Blinn
/// and Newell, *Clipping using homogeneous coordinates*, 1978).
fn project(segment: [DVec3; 2], projection: &DMat4) -> Option<[[f64; 2]; 2]> {
    /// Smallest `w` of a point that is divided by it, relative to that of the other end.
    const NEAR: f64 = 1e-6;
    let [a, b] = segment.map(|end| *projection * end.extend(1.0));
    let least = NEAR * a.w.abs().max(b.w.abs());
    if a.w < least && b.w < least {
        return None;
    }
    let crossing = (least - a.w) / (b.w - a.w);
    let ends = match (a.w < least, b.w < least) {
        (true, _) => [a.lerp(b, crossing), b],
        (_, true) => [a, a.lerp(b, crossing)],
        _ => [a, b],
    };
    let ends = ends.map(|end| [end.x / end.w, end.y / end.w]);
    ends.as_flattened()
        .iter()
        .all(|part| part.is_finite())
        .then_some(ends)
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::DVec4;

    /// A pinhole at the origin that looks along -z, with w = -z.
    fn pinhole() -> DMat4 {
        DMat4::from_cols(
            DVec4::new(1.0, 0.0, 0.0, 0.0),
            DVec4::new(0.0, 1.0, 0.0, 0.0),
            DVec4::new(0.0, 0.0, -1.0, -1.0),
            DVec4::ZERO,
        )
    }

    #[test]
    fn a_segment_is_clipped_where_it_passes_the_camera() {
        let front = [DVec3::new(1.0, 0.0, -1.0), DVec3::new(1.0, 2.0, -2.0)];
        assert_eq!(project(front, &pinhole()), Some([[1.0, 0.0], [0.5, 1.0]]));
        let passing = [DVec3::new(1.0, 0.0, -1.0), DVec3::new(1.0, 0.0, 1.0)];
        let [from, to] = project(passing, &pinhole()).unwrap();
        assert_eq!(from, [1.0, 0.0]);
        assert!(to[0] > 1e5, "the far end is at {to:?}");
        let behind = [DVec3::new(1.0, 0.0, 1.0), DVec3::new(1.0, 0.0, 2.0)];
        assert_eq!(project(behind, &pinhole()), None);
    }
}
