//! Texture coordinates and shading normals of shapes: section 9 of the model.

use super::mapping::around;
use super::unknown_part;
use crate::shapes::csg;
use crate::shapes::heightfield::Heightfield;
use crate::shapes::lathe::Lathe;
use crate::shapes::mesh::{self, Mesh};
use crate::shapes::prism::Prism;
use serde::Deserialize;
use std::f64::consts::{PI, TAU};
use whitstone_core::config::decode;
use whitstone_core::{DAffine3, DMat3, DVec2, DVec3, SceneErrors};
use whitstone_scene::{Description, PluginTable};

/// The texture coordinates of a shape, computed in its object space.
pub(super) enum Coordinates {
    /// Always (0, 0).
    None,
    Plane,
    Rectangle,
    Disk,
    Box,
    /// Of a sphere or an ellipsoid.
    Round {
        center: DVec3,
        radii: DVec3,
    },
    /// Surface of revolution: the range along the axis, and the radii at both ends.
    Turned {
        z: [f64; 2],
        radii: [f64; 2],
    },
    /// The major radius.
    Torus(f64),
    /// The bounding box.
    Quadric([DVec3; 2]),
    /// The axes of its plane.
    Polygon([usize; 2]),
    /// The points (x, z) and both heights.
    Prism(Vec<DVec2>, [f64; 2]),
    /// The points (r, y).
    Lathe(Vec<DVec2>),
    Triangles(Box<Mesh>),
    /// The two surface parameters.
    Parameters,
    /// The operands, each in its own space.
    Operands(Vec<(DAffine3, Coordinates)>),
}

/// Keys of shapes that affect texture coordinates and normals.
#[derive(Deserialize)]
struct Keys {
    #[serde(default)]
    center: [f64; 3],
    radius: Option<f64>,
    radii: Option<Vec<f64>>,
    slope: Option<f64>,
    z: Option<[f64; 2]>,
    major_radius: Option<f64>,
    #[serde(rename = "box")]
    bounds: Option<[[f64; 3]; 2]>,
}

#[derive(Deserialize)]
struct Corners {
    vertices: Vec<[f64; 3]>,
    normals: Option<[[f64; 3]; 3]>,
    uvs: Option<[[f64; 2]; 3]>,
}

impl Coordinates {
    pub(super) fn new(description: &Description<'_>, plugin: &PluginTable<'_>) -> Result<Self, SceneErrors> {
        let keys = &plugin.table;
        Ok(match &*plugin.name {
            "heightfield" => {
                let triangles = decode::<Heightfield>(keys)?.triangles(description)?.0;
                Self::Triangles(Box::new(Mesh::of(triangles, None, None)))
            }
            "patch" => Self::Parameters,
            "csg" => {
                let operands = decode::<csg::Config>(keys)?.operands(description)?;
                let operands = operands.iter().map(|(plugin, map)| {
                    let operand = Self::new(description, plugin)?;
                    if operand.has_attributes() {
                        return Err(unknown_part(plugin, "attributes of meshes in a csg"));
                    }
                    Ok((map.inverse(), operand))
                });
                Self::Operands(operands.collect::<Result<_, SceneErrors>>()?)
            }
            "plane" => Self::Plane,
            "rectangle" => Self::Rectangle,
            "disk" => Self::Disk,
            "box" => Self::Box,
            "mesh" => Self::Triangles(Box::new(mesh::read(description, &decode(keys)?)?)),
            "triangle" => {
                let Corners {
                    vertices,
                    normals,
                    uvs,
                } = decode(keys)?;
                let triangle = <[[f64; 3]; 3]>::try_from(vertices);
                let uvs = uvs.unwrap_or([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
                let triangles = triangle.into_iter().collect();
                Self::Triangles(Box::new(Mesh::of(triangles, normals, Some(uvs))))
            }
            "polygon" => {
                let vertices = decode::<Corners>(keys)?.vertices;
                Self::Polygon(axes(
                    &vertices.into_iter().map(DVec3::from_array).collect::<Vec<_>>(),
                ))
            }
            "prism" => {
                let Prism { outline, y } = decode(keys)?;
                Self::Prism(outline.into_iter().map(DVec2::from_array).collect(), y)
            }
            "lathe" => {
                let points = decode::<Lathe>(keys)?.outline;
                Self::Lathe(points.into_iter().map(DVec2::from_array).collect())
            }
            "sphere" | "ellipsoid" | "cylinder" | "cone" | "paraboloid" | "hyperboloid" | "torus"
            | "quadric" => Self::of_keys(&plugin.name, decode(keys)?),
            // Level sets, and shapes that the oracle does not support.
            _ => Self::None,
        })
    }

    fn of_keys(name: &str, keys: Keys) -> Self {
        let radius = keys.radius;
        let turned = |z: [f64; 2], at: &dyn Fn(f64) -> f64| Self::Turned { z, radii: z.map(at) };
        match name {
            "sphere" => Self::Round {
                center: keys.center.into(),
                radii: DVec3::ONE,
            },
            "ellipsoid" => Self::Round {
                center: DVec3::ZERO,
                radii: keys.radii.map_or(DVec3::ONE, |radii| DVec3::from_slice(&radii)),
            },
            "cylinder" => turned(keys.z.unwrap_or([-1.0, 1.0]), &|_| radius.unwrap_or(1.0)),
            "cone" => {
                let radii = keys.radii.map_or([1.0, 0.0], |radii| [radii[0], radii[1]]);
                let z = keys.z.unwrap_or([0.0, 1.0]);
                Self::Turned { z, radii }
            }
            "paraboloid" => turned(keys.z.unwrap_or([0.0, 1.0]), &|z| {
                radius.unwrap_or(1.0) * z.sqrt()
            }),
            "hyperboloid" => {
                let (radius, slope) = (radius.unwrap_or(0.5), keys.slope.unwrap_or(1.0));
                turned(keys.z.unwrap_or([-1.0, 1.0]), &|z| radius.hypot(slope * z))
            }
            "torus" => Self::Torus(keys.major_radius.unwrap_or(1.0)),
            _ => {
                let bounds = keys.bounds.unwrap_or([[-1.0; 3], [1.0; 3]]);
                Self::Quadric(bounds.map(DVec3::from_array))
            }
        }
    }

    /// The triangles of the shape; empty if it has none.
    pub(super) fn triangles(&self) -> &[[[f64; 3]; 3]] {
        match self {
            Self::Triangles(mesh) => &mesh.triangles,
            _ => &[],
        }
    }

    /// Texture coordinates of a point of the shape. `primitive` is the number of its primitive;
    /// `parameters` are the surface parameters of a parametric shape.
    pub(super) fn uv(&self, p: DVec3, primitive: u32, parameters: Option<[f64; 2]>) -> DVec2 {
        let turn = around(p.x, p.y) / TAU;
        match self {
            Self::None => DVec2::ZERO,
            Self::Parameters => parameters.map_or(DVec2::ZERO, DVec2::from_array),
            Self::Operands(operands) => {
                let count = operands.len() as u32;
                let (map, operand) = &operands[(primitive % count) as usize];
                operand.uv(map.transform_point3(p), primitive / count, parameters)
            }
            Self::Plane => DVec2::new(p.x, p.y),
            Self::Rectangle => DVec2::new(0.5 * (p.x + 1.0), 0.5 * (p.y + 1.0)),
            Self::Disk => DVec2::new(p.x.hypot(p.y), turn),
            Self::Box => {
                let axis = (primitive / 2) as usize;
                let [b, c] = [(axis + 1) % 3, (axis + 2) % 3].map(|k| 0.5 * (p[k] + 1.0));
                DVec2::new(b, c)
            }
            Self::Round { center, radii } => {
                let q = (p - *center) / *radii;
                let theta = q.x.hypot(q.y).atan2(q.z);
                DVec2::new(around(q.x, q.y) / TAU, (PI - theta) / PI)
            }
            Self::Turned { z, radii } => match primitive {
                0 => DVec2::new(turn, (p.z - z[0]) / (z[1] - z[0])),
                cap => DVec2::new(p.x.hypot(p.y) / radii[(cap - 1) as usize], turn),
            },
            Self::Torus(major) => {
                let tube = around(p.x.hypot(p.y) - major, p.z) / TAU;
                DVec2::new(turn, tube)
            }
            Self::Quadric([min, max]) => ((p - *min) / (*max - *min)).truncate(),
            Self::Polygon([b, c]) => DVec2::new(p[*b], p[*c]),
            Self::Prism(points, [low, high]) => {
                let edge = primitive as usize;
                if edge >= points.len() {
                    return DVec2::new(p.z, p.x);
                }
                let ring: Vec<DVec2> = points.iter().chain(points.first()).copied().collect();
                let on = DVec2::new(p.x, p.z);
                DVec2::new(share_of_length(&ring, edge, on), (p.y - low) / (high - low))
            }
            Self::Lathe(points) => {
                let on = DVec2::new(p.x.hypot(p.z), p.y);
                let share = share_of_length(points, primitive as usize, on);
                DVec2::new(around(p.z, p.x) / TAU, share)
            }
            Self::Triangles(mesh) => {
                let Some(uvs) = mesh.uvs[primitive as usize] else {
                    return DVec2::ZERO;
                };
                let weights = barycentric(&mesh.triangles[primitive as usize], p);
                let parts = weights.into_iter().zip(uvs);
                parts.map(|(weight, uv)| weight * DVec2::from_array(uv)).sum()
            }
        }
    }

    /// The interpolated normal, of any length, in the space that `normals` leads to. `None` if it
    /// is the geometric one.
    pub(super) fn normal(&self, p: DVec3, primitive: u32, normals: &DMat3) -> Option<DVec3> {
        let mesh = match self {
            Self::Triangles(mesh) => mesh,
            Self::Operands(operands) => {
                // The maps lead from the space of the result to those of the operands.
                let count = operands.len() as u32;
                let (map, operand) = &operands[(primitive % count) as usize];
                let normals = *normals * map.matrix3.transpose();
                let n = operand.normal(map.transform_point3(p), primitive / count, &normals)?;
                return Some(n);
            }
            _ => return None,
        };
        let corners = mesh.normals[primitive as usize]?;
        let weights = barycentric(&mesh.triangles[primitive as usize], p);
        let parts = weights.into_iter().zip(corners);
        let sum: DVec3 = parts
            .map(|(weight, corner)| weight * (*normals * DVec3::from_array(corner)).normalize_or_zero())
            .sum();
        (sum != DVec3::ZERO).then_some(sum)
    }
}

/// Further attributes of the vertices of a mesh, interpolated.
#[derive(Clone, Copy)]
pub(super) struct Attributes {
    /// The second set of texture coordinates.
    pub(super) second: DVec2,
    pub(super) color: [f64; 4],
    /// The mesh tangent in object space, and the sign of the bitangent.
    pub(super) tangent: Option<(DVec3, f64)>,
}

impl Attributes {
    /// Those of shapes that have none.
    const NONE: Self = Self {
        second: DVec2::ZERO,
        color: [1.0; 4],
        tangent: None,
    };

    /// Those of a triangle, weighted.
    fn of(mesh: &Mesh, triangle: usize, weights: [f64; 3]) -> Self {
        let second = mesh.seconds(triangle).map_or(DVec2::ZERO, |uvs| {
            (0..3).map(|k| weights[k] * DVec2::from_array(uvs[k])).sum()
        });
        let color = mesh.colors(triangle).map_or([1.0; 4], |colors| {
            [0, 1, 2, 3].map(|c| (0..3).map(|k| weights[k] * colors[k][c]).sum())
        });
        let tangent = mesh.tangents(triangle).map(|(along, sign)| {
            let sum = (0..3).map(|k| weights[k] * DVec3::from_array(along[k])).sum();
            (sum, sign)
        });
        Self {
            second,
            color,
            tangent,
        }
    }
}

impl Coordinates {
    /// The further attributes at a point.
    pub(super) fn attributes(&self, p: DVec3, primitive: u32) -> Attributes {
        let place = primitive as usize;
        match self {
            Self::Triangles(mesh) => Attributes::of(mesh, place, barycentric(&mesh.triangles[place], p)),
            _ => Attributes::NONE,
        }
    }

    /// Whether it is a mesh with further attributes.
    fn has_attributes(&self) -> bool {
        matches!(self, Self::Triangles(mesh) if !mesh.is_plain())
    }
}

/// A vertex of the triangle that was hit.
pub(super) struct Corner {
    /// Its barycentric coordinate at the point.
    pub(super) weight: f64,
    pub(super) p: DVec3,
    /// Unit normal in the space that the map of normals leads to; `None` for the geometric one.
    pub(super) normal: Option<DVec3>,
    pub(super) uv: DVec2,
    pub(super) attributes: Attributes,
}

impl Coordinates {
    /// The vertices around a point; empty for shapes without triangles.
    pub(super) fn corners(&self, p: DVec3, primitive: u32, normals: &DMat3) -> Vec<Corner> {
        let Self::Triangles(mesh) = self else {
            return Vec::new();
        };
        let place = primitive as usize;
        let triangle = &mesh.triangles[place];
        let weights = barycentric(triangle, p);
        let corner = |k: usize| Corner {
            weight: weights[k],
            p: triangle[k].into(),
            normal: mesh.normals[place]
                .and_then(|corners| (*normals * DVec3::from_array(corners[k])).try_normalize()),
            uv: mesh.uvs[place].map_or(DVec2::ZERO, |uvs| uvs[k].into()),
            attributes: Attributes::of(
                mesh,
                place,
                [0, 1, 2].map(|other| if other == k { 1.0 } else { 0.0 }),
            ),
        };
        (0..3).map(corner).collect()
    }
}

/// The barycentric coordinates of a point of a triangle.
fn barycentric(corners: &[[f64; 3]; 3], p: DVec3) -> [f64; 3] {
    let [a, b, c] = corners.map(DVec3::from_array);
    let n = (b - a).cross(c - a);
    let part = |q: DVec3, r: DVec3| n.dot((q - p).cross(r - p)) / n.length_squared();
    [part(b, c), part(c, a), part(a, b)]
}

/// The length of a path up to a point on one of its segments, over its whole length.
fn share_of_length(path: &[DVec2], segment: usize, on: DVec2) -> f64 {
    let length = |path: &[DVec2]| -> f64 { path.windows(2).map(|ends| ends[0].distance(ends[1])).sum() };
    (length(&path[..=segment]) + path[segment].distance(on)) / length(path)
}

/// The two axes after the one along which the normal of a polygon is largest.
fn axes(vertices: &[DVec3]) -> [usize; 2] {
    let center = vertices.iter().sum::<DVec3>() / vertices.len() as f64;
    let edges = vertices.iter().zip(vertices.iter().cycle().skip(1));
    let normal: DVec3 = edges.map(|(p, q)| (*p - center).cross(*q - center)).sum();
    let n = normal.abs();
    let largest = (0..3)
        .find(|a| n[*a] >= n.max_element() * (1.0 - 1e-9))
        .unwrap_or(0);
    [(largest + 1) % 3, (largest + 2) % 3]
}
