//! Ray trees of one sample, ours and the reference's, and where they part.

use serde::Deserialize;
use whitstone_core::{Scratch, TreeNode};
use whitstone_scene::Pipeline;

/// A node of the reference's tree, as the driver tells it.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Node {
    /// "" for the camera ray, then a letter for each branch: R or T.
    pub path: String,
    /// Number of the shape; -1 for a miss.
    pub shape: i64,
    /// Number of the primitive.
    #[serde(default)]
    pub primitive: Option<i64>,
    /// Distance.
    #[serde(default)]
    pub t: Option<f64>,
    /// Shading normal.
    #[serde(default)]
    pub n_s: Option<[f64; 3]>,
    /// Factor on the node's radiance in the pixel.
    #[serde(default)]
    pub throughput: Option<[f64; 3]>,
    /// Radiance that the node adds by itself.
    #[serde(default)]
    pub local: Option<[f64; 3]>,
}

/// Our tree for a sample of a pixel.
pub fn ours(pipeline: &Pipeline, pixel: [usize; 2], sample: u32) -> Vec<TreeNode> {
    let mut scratch = Scratch {
        record: Some(Vec::new()),
        ..Scratch::default()
    };
    let ray = pipeline.camera_ray(pixel.map(|p| p as u32), sample);
    pipeline.integrator.radiance(&pipeline.world, &ray, &mut scratch);
    scratch.record.unwrap_or_default()
}

/// The first node, by depth, at which hit, distance, normal or weights differ by more than single
/// precision accounts for.
pub fn first_difference(ours: &[TreeNode], theirs: &[Node]) -> Option<String> {
    let mut paths: Vec<&str> = ours
        .iter()
        .map(|node| node.path.as_str())
        .chain(theirs.iter().map(|node| node.path.as_str()))
        .collect();
    paths.sort_by_key(|path| (path.len(), path.to_owned()));
    paths.dedup();
    paths.into_iter().find_map(|path| {
        let name = if path.is_empty() {
            "camera ray".to_owned()
        } else {
            format!("ray {path}")
        };
        let mine = ours.iter().find(|node| node.path == path);
        let other = theirs.iter().find(|node| node.path == path);
        match (mine, other) {
            (Some(_), None) => Some(format!("{name}: only ours goes on")),
            (None, Some(_)) => Some(format!("{name}: only the reference goes on")),
            (Some(mine), Some(other)) => difference(mine, other).map(|what| format!("{name}: {what}")),
            (None, None) => None,
        }
    })
}

fn difference(ours: &TreeNode, theirs: &Node) -> Option<String> {
    let hit = |shape: i64, primitive: i64| match shape {
        -1 => "nothing".to_owned(),
        _ => format!("shape {shape}, primitive {primitive}"),
    };
    let primitive = theirs.primitive.unwrap_or(ours.primitive);
    if (ours.shape, ours.primitive) != (theirs.shape, primitive) {
        return Some(format!(
            "ours hits {}, the reference {}",
            hit(ours.shape, ours.primitive),
            hit(theirs.shape, primitive)
        ));
    }
    let far = |a: f64, b: f64, scale: f64| (a - b).abs() > 1e-4 * scale.max(1e-6);
    if let Some(t) = theirs.t
        && ours.shape >= 0
        && far(ours.t, t, t.abs())
    {
        return Some(format!("at distance {} in ours, {t} in the reference", ours.t));
    }
    let vectors = [
        ("shading normal", ours.n_s.to_array(), theirs.n_s, 1.0),
        ("throughput", ours.throughput.to_array(), theirs.throughput, 0.0),
        ("local radiance", ours.local.to_array(), theirs.local, 0.0),
    ];
    vectors.into_iter().find_map(|(name, a, b, least_scale)| {
        let b = b?;
        let scale = b.iter().fold(least_scale, |scale: f64, v| scale.max(v.abs()));
        let differs = a.iter().zip(&b).any(|(a, b)| far(*a, *b, scale));
        // A miss has no normal.
        let compared = ours.shape >= 0 || name != "shading normal";
        (differs && compared).then(|| format!("{name} {a:?} in ours, {b:?} in the reference"))
    })
}
