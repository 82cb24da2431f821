//! The transforms of nodes.

use crate::document::{Document, Error};
use crate::json;
use whitstone_core::{DAffine3, DMat3, DVec3};

/// Maximum depth of the tree of nodes.
pub const MAX_NODE_DEPTH: usize = 256;

/// The number with the fewest digits that rounds to this one in single precision: mostly that of
/// the file, which the JSON types round.
pub fn shortest(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::NAN)
}

/// The transform of a node relative to its parent. The last row of a matrix is ignored.
pub fn local_transform(node: &json::Node) -> DAffine3 {
    if let Some(m) = node.matrix {
        let column =
            |k: usize| DVec3::new(shortest(m[4 * k]), shortest(m[4 * k + 1]), shortest(m[4 * k + 2]));
        return DAffine3 {
            matrix3: DMat3::from_cols(column(0), column(1), column(2)),
            translation: column(3),
        };
    }
    let vector = |v: [f32; 3]| DVec3::from_array(v.map(shortest));
    let scale = vector(node.scale.unwrap_or([1.0; 3]));
    let translation = vector(node.translation.unwrap_or_default());
    let rotation = rotation(node.rotation.unwrap_or_default().0.map(shortest));
    DAffine3::from_mat3_translation(rotation * DMat3::from_diagonal(scale), translation)
}

/// The rotation of a quaternion (x, y, z, w), which need not have unit length; the identity if its
/// length is zero.
pub fn rotation([x, y, z, w]: [f64; 4]) -> DMat3 {
    let length = (x * x + y * y + z * z + w * w).sqrt();
    if length == 0.0 {
        return DMat3::IDENTITY;
    }
    let [x, y, z, w] = [x, y, z, w].map(|part| part / length);
    DMat3::from_cols(
        DVec3::new(
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y + w * z),
            2.0 * (x * z - w * y),
        ),
        DVec3::new(
            2.0 * (x * y - w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z + w * x),
        ),
        DVec3::new(
            2.0 * (x * z + w * y),
            2.0 * (y * z - w * x),
            1.0 - 2.0 * (x * x + y * y),
        ),
    )
}

/// The parent of each node.
///
/// # Errors
///
/// If a node has two parents, or a child that does not exist.
pub fn parents(document: &Document) -> Result<Vec<Option<usize>>, Error> {
    let nodes = &document.root.nodes;
    let mut parents = vec![None; nodes.len()];
    for (number, node) in nodes.iter().enumerate() {
        for (place, child) in node.children.iter().flatten().enumerate() {
            let pointer = || format!("/nodes/{number}/children/{place}");
            Document::item(nodes, child.value(), "nodes", pointer)?;
            if let Some(other) = parents[child.value()].replace(number) {
                let message = format!("node {} is already a child of node {other}", child.value());
                return Err(Error::at(pointer(), message));
            }
        }
    }
    Ok(parents)
}

/// The transform of a node relative to the scene.
///
/// # Errors
///
/// If the node is below more than [`MAX_NODE_DEPTH`] others, as in a cycle.
pub fn world_transform(
    document: &Document,
    parents: &[Option<usize>],
    node: usize,
) -> Result<DAffine3, Error> {
    let mut world = DAffine3::IDENTITY;
    let mut next = Some(node);
    for _ in 0..=MAX_NODE_DEPTH {
        match next {
            None => return Ok(world),
            Some(node) => {
                world = local_transform(&document.root.nodes[node]) * world;
                next = parents[node];
            }
        }
    }
    Err(Error::at(
        format!("/nodes/{node}"),
        format!("is a cycle, or is nested more than {MAX_NODE_DEPTH} deep"),
    ))
}
