//! Ray trees of one sample, ours and the reference's, and their first difference.

use crate::protocol::{number, numbers};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use whitstone_core::{Scratch, TreeNode};
use whitstone_render::Pipeline;

/// A smaller throughput may be 0 in single precision, so that nodes below it cannot be compared.
const LEAST_THROUGHPUT: f64 = f32::MIN_POSITIVE as f64;

/// Distances that differ by at most this many units in the last place of single precision are
/// equal.
const COINCIDENT_ULPS: f64 = 4.0;

/// A node of the reference's tree, as the driver reports it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Node {
    /// "" for the camera ray, then a letter for each branch, R or T. Two digits after an R number
    /// one of several reflections.
    pub path: String,
    /// Number of the shape; -1 for a miss.
    pub shape: i64,
    /// Number of the primitive; -1 for a miss.
    pub primitive: i64,
    /// Distance; infinite for a miss, which JSON represents as null.
    #[serde(deserialize_with = "number")]
    pub t: f64,
    /// Shading normal.
    #[serde(deserialize_with = "numbers")]
    pub n_s: [f64; 3],
    /// Factor of the node's radiance in the pixel.
    #[serde(deserialize_with = "numbers")]
    pub throughput: [f64; 3],
    /// Radiance that the node itself adds.
    #[serde(deserialize_with = "numbers")]
    pub local: [f64; 3],
    /// Whether it stands for a branch beyond the depth limit.
    #[serde(default)]
    pub limit: bool,
}

/// Our tree for a sample of a pixel.
pub fn ours(pipeline: &Pipeline, pixel: [usize; 2], sample: u32) -> Vec<TreeNode> {
    let mut scratch = Scratch::within(pipeline.tree_limits(1));
    scratch.record = Some(Vec::new());
    let pixel = pixel.map(|p| p as u32);
    let ray = pipeline.camera_ray(pixel, sample);
    scratch.differential = pipeline.camera_differential(pixel, sample);
    let scene = pipeline.scene_of(sample);
    pipeline.integrator.radiance(scene, &ray, &mut scratch);
    let mut nodes = scratch.record.unwrap_or_default();
    for node in nodes.iter_mut().filter(|node| node.shape >= 0) {
        node.shape = i64::from(scene.shape_id(node.shape as u32));
    }
    nodes
}

/// A ray that at least one of the two trees has.
#[derive(Clone, Debug)]
pub struct Pair<'a> {
    /// The path, as in the trees.
    pub path: &'a str,
    /// Ours.
    pub ours: Option<&'a TreeNode>,
    /// The reference's.
    pub theirs: Option<&'a Node>,
    /// The quantity that differs by more than single precision explains: hit, distance, normal or
    /// weights.
    pub difference: Option<String>,
}

impl Pair<'_> {
    /// A readable name of the ray.
    pub fn name(&self) -> String {
        match self.path {
            "" => "camera ray".to_owned(),
            path => format!("ray {path}"),
        }
    }
}

/// The number of branches that lead to a ray.
pub fn depth(path: &str) -> usize {
    path.bytes().filter(u8::is_ascii_alphabetic).count()
}

/// The rays of both trees by depth, reflections before transmissions.
pub fn pairs<'a>(ours: &'a [TreeNode], theirs: &'a [Node]) -> Vec<Pair<'a>> {
    let empty = |path: &'a str| Pair {
        path,
        ours: None,
        theirs: None,
        difference: None,
    };
    let mut found: BTreeMap<(usize, &str), Pair<'a>> = BTreeMap::new();
    let mut pair_of = |path: &'a str, fill: &dyn Fn(&mut Pair<'a>)| {
        fill(found.entry((depth(path), path)).or_insert_with(|| empty(path)));
    };
    for node in ours {
        pair_of(&node.path, &|pair| pair.ours = Some(node));
    }
    for node in theirs {
        pair_of(&node.path, &|pair| pair.theirs = Some(node));
    }
    let mut pairs: Vec<Pair<'a>> = found.into_values().collect();
    for pair in &mut pairs {
        pair.difference = match (pair.ours, pair.theirs) {
            (Some(ours), None) => {
                matters(ours.throughput.to_array()).then(|| "exists only in our ray tree".to_owned())
            }
            (None, Some(theirs)) => {
                matters(theirs.throughput).then(|| "exists only in the reference's ray tree".to_owned())
            }
            (Some(ours), Some(theirs)) => difference(ours, theirs),
            (None, None) => None,
        };
    }
    pairs
}

/// A description of the first ray, by depth, that differs.
pub fn first_difference(ours: &[TreeNode], theirs: &[Node]) -> Option<String> {
    pairs(ours, theirs).iter().find_map(|pair| {
        let what = pair.difference.as_ref()?;
        Some(format!("{}: {what}", pair.name()))
    })
}

/// Whether a node can contribute. One with a NaN throughput can.
fn matters(throughput: [f64; 3]) -> bool {
    !throughput.iter().all(|v| v.abs() <= LEAST_THROUGHPUT)
}

/// A note that both hit different surfaces at the same distance, within single precision.
fn coincident(ours: &TreeNode, theirs: &Node) -> Option<String> {
    let same = (ours.t - theirs.t).abs() <= COINCIDENT_ULPS * f64::from(f32::EPSILON) * theirs.t.abs();
    let what = if ours.shape == theirs.shape {
        "a common edge or coincident surfaces"
    } else {
        "coincident surfaces"
    };
    (ours.shape >= 0 && theirs.shape >= 0 && same).then(|| {
        format!(
            ", both at distance {}; {what}: rounding decides which one is hit",
            theirs.t
        )
    })
}

fn difference(ours: &TreeNode, theirs: &Node) -> Option<String> {
    if !matters(ours.throughput.to_array()) && !matters(theirs.throughput) {
        return None;
    }
    let hit = |shape: i64, primitive: i64, limit: bool| match (limit, shape) {
        (true, _) => "is at the depth limit".to_owned(),
        (false, -1) => "hits nothing".to_owned(),
        _ => format!("hits shape {shape}, primitive {primitive}"),
    };
    let mine = (ours.shape, ours.primitive, ours.limit);
    let other = (theirs.shape, theirs.primitive, theirs.limit);
    if mine != other {
        return Some(format!(
            "ours {}, the reference {}{}",
            hit(mine.0, mine.1, mine.2),
            hit(other.0, other.1, other.2),
            coincident(ours, theirs).unwrap_or_default(),
        ));
    }
    // Not `>`, so that NaN counts as a difference.
    let far = |a: f64, b: f64, scale: f64| {
        let near = (a - b).abs() <= 1e-4 * scale.max(1e-6);
        !near
    };
    let is_hit = ours.shape >= 0;
    if is_hit && far(ours.t, theirs.t, theirs.t.abs()) {
        return Some(format!(
            "at distance {} in ours, {} in the reference",
            ours.t, theirs.t
        ));
    }
    let vectors = [
        ("shading normal", ours.n_s.to_array(), theirs.n_s, 1.0),
        ("throughput", ours.throughput.to_array(), theirs.throughput, 0.0),
        ("local radiance", ours.local.to_array(), theirs.local, 0.0),
    ];
    vectors.into_iter().find_map(|(name, a, b, least_scale)| {
        let scale = b.iter().fold(least_scale, |scale: f64, v| scale.max(v.abs()));
        let differs = a.iter().zip(&b).any(|(a, b)| far(*a, *b, scale));
        // A miss has no normal.
        let compared = is_hit || name != "shading normal";
        (differs && compared).then(|| format!("{name} {a:?} in ours, {b:?} in the reference"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use whitstone_core::{DVec3, Ray, Rgb};

    fn mine(path: &str, shape: i64) -> TreeNode {
        TreeNode {
            path: path.to_owned(),
            ray: Ray::new(DVec3::ZERO, DVec3::Z),
            shape,
            primitive: if shape < 0 { -1 } else { 0 },
            instance: 0,
            t: if shape < 0 { f64::INFINITY } else { 2.0 },
            position: DVec3::ZERO,
            n_s: DVec3::Y,
            throughput: Rgb::splat(0.5),
            local: Rgb::splat(0.25),
            limit: false,
        }
    }

    /// The same node as the driver writes it.
    fn other(node: &TreeNode) -> Node {
        let t = if node.shape < 0 {
            json!("inf")
        } else {
            json!(node.t)
        };
        serde_json::from_value(json!({
            "path": node.path, "shape": node.shape, "primitive": node.primitive, "t": t, "p": [0, 0, 0],
            "n_g": [0, 1, 0], "n_s": node.n_s.to_array(), "uv": [0, 0], "lights": [],
            "throughput": node.throughput.to_array(), "local": node.local.to_array(), "limit": node.limit,
        }))
        .unwrap()
    }

    fn parted(ours: &[TreeNode], change: impl Fn(&mut Vec<Node>)) -> Option<String> {
        let mut theirs: Vec<Node> = ours.iter().map(other).collect();
        change(&mut theirs);
        first_difference(ours, &theirs)
    }

    #[test]
    fn the_numbers_of_reflections_are_no_depth() {
        assert_eq!(["", "R", "R07", "R07TR12"].map(depth), [0, 1, 1, 3]);
    }

    #[test]
    fn a_miss_is_read_and_equal_trees_agree() {
        let tree = [mine("", 0), mine("R", -1)];
        assert_eq!(other(&tree[1]).t, f64::INFINITY);
        assert_eq!(parted(&tree, |_| {}), None);
        assert!(serde_json::from_value::<Node>(json!({ "path": "", "shape": -1 })).is_err());
    }

    #[test]
    fn every_difference_is_told_at_the_least_depth() {
        let mut limit = mine("T", -1);
        limit.limit = true;
        let tree = [mine("", 0), mine("R", 1), limit];
        type Change = fn(&mut Vec<Node>);
        let changes: [(Change, &str); 9] = [
            (
                |nodes| nodes[1].shape = 2,
                "ray R: ours hits shape 1, primitive 0, the reference hits shape 2",
            ),
            (
                |nodes| nodes[0].t = 2.001,
                "camera ray: at distance 2 in ours, 2.001",
            ),
            (
                |nodes| nodes[0].t = f64::NAN,
                "camera ray: at distance 2 in ours, NaN",
            ),
            (
                |nodes| nodes[0].n_s = [0.0, 0.0, 1.0],
                "camera ray: shading normal",
            ),
            (|nodes| nodes[1].throughput[2] = 0.51, "ray R: throughput"),
            (|nodes| nodes[1].local[0] = f64::NAN, "ray R: local radiance"),
            (
                |nodes| nodes[2].limit = false,
                "ray T: ours is at the depth limit, the reference hits nothing",
            ),
            (|nodes| drop(nodes.pop()), "ray T: exists only in our ray tree"),
            (
                |nodes| {
                    let mut node = nodes[1].clone();
                    node.path = "RR".into();
                    nodes.push(node)
                },
                "ray RR: exists only in the reference's ray tree",
            ),
        ];
        for (change, expected) in changes {
            let found = parted(&tree, change).unwrap_or_default();
            assert!(found.starts_with(expected), "{found} is not {expected}");
        }
    }

    #[test]
    fn coincident_surfaces_are_named() {
        let tree = [mine("", 4)];
        let hint = |shape, t| {
            parted(&tree, |nodes| {
                nodes[0].shape = shape;
                nodes[0].primitive = 1;
                nodes[0].t = t;
            })
            .unwrap()
        };
        assert!(hint(5, 2.0000005).ends_with("coincident surfaces: rounding decides which one is hit"));
        assert!(hint(4, 2.0).contains("a common edge or coincident surfaces"));
        for apart in [hint(5, 2.000002), hint(-1, 2.0), hint(5, f64::NAN)] {
            assert!(!apart.contains("coincident"), "{apart}");
        }
    }

    /// Absorption takes our throughput to 1e-300 and that of single precision to 0.
    #[test]
    fn what_single_precision_has_lost_is_not_compared() {
        let mut faint = mine("T", 3);
        faint.throughput = Rgb::splat(1e-300);
        let tree = [mine("", 0), faint];
        assert_eq!(parted(&tree, |nodes| drop(nodes.pop())), None);
        assert_eq!(
            parted(&tree, |nodes| {
                nodes[1].throughput = [0.0; 3];
                nodes[1].local = [9.0; 3]
            }),
            None
        );
        assert!(parted(&tree, |nodes| nodes[1].throughput = [1e-3; 3]).is_some());
    }
}
