//! Meshes of glTF 2.0 files: section 9 of the model, *Mesh files*.

use super::{Config, Corner, Mesh};
use crate::gltf::{Gltf, Numbers, number};
use serde_json::Value;
use std::path::Path;
use whitstone_core::{DAffine3, DMat3, DVec3, DVec4};

/// Parts of the names of extensions that change vertices or indices.
const CHANGING: [&str; 4] = ["draco", "meshopt", "compression", "gaussian"];

/// Largest deviation of the squared length of a quaternion from 1: the rotation of others depends
/// on the formula.
const UNIT: f64 = 1e-5;

/// Reads a primitive of a mesh.
pub(super) fn read(path: &Path, config: &Config) -> Result<Mesh, String> {
    let file = Gltf::read(path)?;
    for name in file.required() {
        let lower = name.to_lowercase();
        if CHANGING.iter().any(|part| lower.contains(part)) {
            return Err(format!("the extension {name}"));
        }
    }
    let mesh = file.element("meshes", config.mesh.unwrap_or(0))?;
    let index = config.primitive.unwrap_or(0);
    let primitive = mesh.get("primitives").and_then(|all| all.get(index));
    let primitive = primitive.ok_or_else(|| format!("no primitive {index}"))?;
    let weights = match &config.weights {
        Some(weights) => weights.clone(),
        None => numbers(mesh, "weights")?.unwrap_or_default(),
    };
    let source = Source {
        file: &file,
        primitive,
        weights,
    };
    source.mesh(config)
}

/// A list of numbers.
fn numbers(object: &Value, key: &str) -> Result<Option<Vec<f64>>, String> {
    let Some(list) = object.get(key) else {
        return Ok(None);
    };
    let list = list.as_array().and_then(|list| {
        let each = list.iter().map(Value::as_f64);
        each.collect::<Option<Vec<f64>>>()
    });
    list.map(Some).ok_or_else(|| format!("a malformed `{key}`"))
}

fn vector<const N: usize>(object: &Value, key: &str, default: [f64; N]) -> Result<[f64; N], String> {
    match numbers(object, key)? {
        None => Ok(default),
        Some(list) => list.try_into().map_err(|_| format!("a malformed `{key}`")),
    }
}

/// A primitive.
struct Source<'a> {
    file: &'a Gltf,
    primitive: &'a Value,
    weights: Vec<f64>,
}

impl Source<'_> {
    /// An attribute of a primitive or a target, if it is there; `count` is the number of vertices.
    fn attribute(
        &self,
        attributes: &Value,
        name: &str,
        count: Option<usize>,
    ) -> Result<Option<Numbers>, String> {
        if attributes.get(name).is_none() {
            return Ok(None);
        }
        let found = self.file.accessor(number(attributes, name, None)?)?;
        if count.is_some_and(|count| count != found.count()) {
            return Err(format!("{name} has another number of elements than POSITION"));
        }
        Ok(Some(found))
    }

    /// A vector of each vertex after morphing, if the primitive has it.
    fn morphed(&self, name: &str, count: Option<usize>) -> Result<Option<Vec<[f64; 3]>>, String> {
        let Some(base) = self.attribute(&self.primitive["attributes"], name, count)? else {
            return Ok(None);
        };
        let mut all = match base.width {
            // A tangent with its sign.
            4 => base
                .all::<4>()?
                .into_iter()
                .map(|[x, y, z, _]| [x, y, z])
                .collect(),
            _ => base.all::<3>()?,
        };
        let targets = self.primitive.get("targets").and_then(Value::as_array);
        for (target, weight) in targets.into_iter().flatten().zip(&self.weights) {
            let Some(change) = self.attribute(target, name, Some(all.len()))? else {
                continue;
            };
            for (sum, change) in all.iter_mut().zip(change.all::<3>()?) {
                *sum = [0, 1, 2].map(|k| sum[k] + weight * change[k]);
            }
        }
        Ok(Some(all))
    }

    /// The vertices of each triangle.
    fn triangles(&self, count: usize) -> Result<Vec<[usize; 3]>, String> {
        let vertices: Vec<usize> = match self.primitive.get("indices") {
            None => (0..count).collect(),
            Some(_) => {
                let indices = self.file.accessor(number(self.primitive, "indices", None)?)?;
                indices.indices::<1>()?.into_iter().map(|[index]| index).collect()
            }
        };
        if vertices.iter().any(|vertex| *vertex >= count) {
            return Err("an index out of range".to_owned());
        }
        let many = vertices.len().saturating_sub(2);
        let places: Vec<[usize; 3]> = match number(self.primitive, "mode", Some(4))? {
            4 if !vertices.len().is_multiple_of(3) => return Err("an incomplete triangle".to_owned()),
            4 => (0..vertices.len() / 3)
                .map(|i| [3 * i, 3 * i + 1, 3 * i + 2])
                .collect(),
            5 => (0..many).map(|i| [i, i + 1 + i % 2, i + 2 - i % 2]).collect(),
            6 => (0..many).map(|i| [i + 1, i + 2, 0]).collect(),
            other => return Err(format!("the mode {other}")),
        };
        if places.is_empty() {
            return Err("a primitive without triangles".to_owned());
        }
        Ok(places
            .iter()
            .map(|three| three.map(|place| vertices[place]))
            .collect())
    }

    /// Texture coordinates of a set.
    fn uvs(&self, set: u32, count: usize) -> Result<Option<Vec<[f64; 2]>>, String> {
        let name = format!("TEXCOORD_{set}");
        let found = self.attribute(&self.primitive["attributes"], &name, Some(count))?;
        let all = found.map(|found| found.all::<2>()).transpose()?;
        Ok(all.map(|all| all.into_iter().map(|[u, v]| [u, 1.0 - v]).collect()))
    }

    fn colors(&self, count: usize) -> Result<Option<Vec<[f64; 4]>>, String> {
        let found = self.attribute(&self.primitive["attributes"], "COLOR_0", Some(count))?;
        let Some(found) = found else { return Ok(None) };
        let mut all: Vec<[f64; 4]> = match found.width {
            3 => found
                .all::<3>()?
                .into_iter()
                .map(|[r, g, b]| [r, g, b, 1.0])
                .collect(),
            _ => found.all::<4>()?,
        };
        for part in all.iter_mut().flatten() {
            *part = part.clamp(0.0, 1.0);
        }
        Ok(Some(all))
    }

    fn mesh(&self, config: &Config) -> Result<Mesh, String> {
        let positions = self
            .morphed("POSITION", None)?
            .ok_or("a primitive without POSITION")?;
        let count = positions.len();
        let normals = self.morphed("NORMAL", Some(count))?;
        let sets = config.sets();
        let set = |number: usize| match sets.get(number) {
            Some(set) => self.uvs(*set, count),
            None => Ok(None),
        };
        let (uvs, second) = (set(0)?, set(1)?);
        let colors = self.colors(count)?;
        let corner = |vertex: usize| Corner {
            vertex,
            place: positions[vertex],
            normal: normals.as_ref().map(|all| all[vertex]),
            uv: uvs.as_ref().map(|all| all[vertex]),
            second: second.as_ref().map(|all| all[vertex]),
            color: colors.as_ref().map(|all| all[vertex]),
        };
        let mut mesh = Mesh::default();
        for triangle in self.triangles(count)? {
            mesh.add(&triangle.map(corner));
        }
        if config.tangents == Some(true) {
            let attributes = &self.primitive["attributes"];
            // TANGENT counts only next to NORMAL.
            let given = match &normals {
                Some(_) => self.attribute(attributes, "TANGENT", Some(count))?,
                None => None,
            };
            match given {
                None => mesh.add_tangents()?,
                Some(given) => {
                    let signs = given.all::<4>()?;
                    let along = self.morphed("TANGENT", Some(count))?.unwrap_or_default();
                    let of = |three: &[usize; 3]| {
                        let sign = if signs[three[0]][3] < 0.0 { -1.0 } else { 1.0 };
                        Some((three.map(|vertex| along[vertex]), sign))
                    };
                    mesh.tangents = mesh.vertices.iter().map(of).collect();
                }
            }
        }
        if let Some(skin) = config.skin {
            self.deform(&mut mesh, skin, count)?;
        }
        Ok(mesh)
    }

    /// Applies a skin.
    fn deform(&self, mesh: &mut Mesh, skin: usize, count: usize) -> Result<(), String> {
        let joints = self.joints(skin)?;
        let attributes = &self.primitive["attributes"];
        let mut matrices = vec![(DMat3::ZERO, DVec3::ZERO); count];
        for set in 0..2 {
            let [joint, weight] = ["JOINTS", "WEIGHTS"].map(|name| format!("{name}_{set}"));
            let joint = self.attribute(attributes, &joint, Some(count))?;
            let weight = self.attribute(attributes, &weight, Some(count))?;
            let (joint, weight) = match (joint, weight) {
                (Some(joint), Some(weight)) => (joint.indices::<4>()?, weight.all::<4>()?),
                (None, None) if set > 0 => break,
                _ => return Err("a skin without JOINTS or WEIGHTS".to_owned()),
            };
            for ((matrix, joint), weight) in matrices.iter_mut().zip(joint).zip(weight) {
                for k in 0..4 {
                    let map = joints.get(joint[k]).ok_or("a joint out of range")?;
                    matrix.0 += weight[k] * map.matrix3;
                    matrix.1 += weight[k] * map.translation;
                }
            }
        }
        // The matrices of normals.
        let mut turned = Vec::new();
        for (matrix, _) in &matrices {
            let volume: f64 = (0..3).map(|k| matrix.col(k).length()).product();
            let determinant = matrix.determinant();
            turned.push(match determinant.abs() {
                0.0 => None,
                small if small <= 1e-12 * volume => return Err("an almost singular skin".to_owned()),
                _ => Some(matrix.inverse().transpose()),
            });
        }
        for (t, vertices) in mesh.vertices.iter().enumerate() {
            for (k, vertex) in vertices.iter().enumerate() {
                let (matrix, translation) = matrices[*vertex];
                let place = &mut mesh.triangles[t][k];
                *place = (matrix * DVec3::from_array(*place) + translation).to_array();
                if let Some(normals) = &mut mesh.normals[t] {
                    let normal = turned[*vertex].map(|turn| turn * DVec3::from_array(normals[k]));
                    normals[k] = normal.unwrap_or(DVec3::ZERO).to_array();
                }
                if let Some(Some((along, _))) = mesh.tangents.get_mut(t) {
                    let tangent = turned[*vertex].map(|_| matrix * DVec3::from_array(along[k]));
                    along[k] = tangent.unwrap_or(DVec3::ZERO).to_array();
                }
            }
        }
        Ok(())
    }

    /// The matrix of each joint of a skin, times its inverse bind matrix.
    fn joints(&self, skin: usize) -> Result<Vec<DAffine3>, String> {
        let skin = self.file.element("skins", skin)?;
        let inverse = match skin.get("inverseBindMatrices") {
            None => None,
            Some(_) => {
                let matrices = self.file.accessor(number(skin, "inverseBindMatrices", None)?)?;
                Some(matrices.all::<16>()?)
            }
        };
        let joints = skin
            .get("joints")
            .and_then(Value::as_array)
            .ok_or("a malformed skin")?;
        let mut all = Vec::new();
        for (number, joint) in joints.iter().enumerate() {
            let joint = joint.as_u64().ok_or("a malformed skin")?;
            let place = self.standing(joint as usize)?;
            let bind = match &inverse {
                None => DAffine3::IDENTITY,
                Some(all) => matrix(*all.get(number).ok_or("too few inverse bind matrices")?)?,
            };
            all.push(place * bind);
        }
        Ok(all)
    }

    /// The matrix of a node, with those of all nodes above it.
    fn standing(&self, node: usize) -> Result<DAffine3, String> {
        let nodes = self.file.list("nodes");
        let mut at = node;
        let mut map = local(self.file.element("nodes", at)?)?;
        for _ in 0..nodes.len() {
            let is_child = |other: &&(usize, &Value)| {
                let children = other.1.get("children").and_then(Value::as_array);
                let mut children = children.into_iter().flatten();
                children.any(|child| child.as_u64() == Some(at as u64))
            };
            let every: Vec<_> = nodes.iter().enumerate().collect();
            let parents: Vec<_> = every.iter().filter(is_child).collect();
            match parents[..] {
                [] => return Ok(map),
                [(parent, node)] => {
                    map = local(node)? * map;
                    at = *parent;
                }
                _ => return Err("a node with several parents".to_owned()),
            }
        }
        Err("a cycle of nodes".to_owned())
    }
}

/// A matrix in columns.
fn matrix(m: [f64; 16]) -> Result<DAffine3, String> {
    if [m[3], m[7], m[11], m[15]] != [0.0, 0.0, 0.0, 1.0] {
        return Err("a matrix that is not affine".to_owned());
    }
    let column = |k: usize| DVec3::new(m[4 * k], m[4 * k + 1], m[4 * k + 2]);
    Ok(DAffine3::from_cols(column(0), column(1), column(2), column(3)))
}

/// The matrix of a node.
fn local(node: &Value) -> Result<DAffine3, String> {
    if let Some(given) = numbers(node, "matrix")? {
        return matrix(given.try_into().map_err(|_| "a malformed `matrix`")?);
    }
    let move_by = DVec3::from_array(vector(node, "translation", [0.0; 3])?);
    let scale = DVec3::from_array(vector(node, "scale", [1.0; 3])?);
    let turn = DVec4::from_array(vector(node, "rotation", [0.0, 0.0, 0.0, 1.0])?);
    if (turn.length_squared() - 1.0).abs() > UNIT {
        return Err("a rotation that is no unit quaternion".to_owned());
    }
    let turn = turn.normalize();
    let (axis, w) = (turn.truncate(), turn.w);
    // Rodrigues' formula for half the angle.
    let turned = |v: DVec3| v + 2.0 * axis.cross(axis.cross(v) + w * v);
    Ok(DAffine3::from_cols(
        turned(DVec3::X) * scale.x,
        turned(DVec3::Y) * scale.y,
        turned(DVec3::Z) * scale.z,
        move_by,
    ))
}
