//! The shapes of a scene with their materials, and what a ray meets first of them.

use super::material::{At, Material};
use super::texture::uv_of;
use super::{Unsure, unknown_part};
use crate::interval::Undecided;
use crate::shapes::{self, Placed, Surface};
use crate::vector::Line;
use crate::{FIRST_BITS, MOST_BITS};
use serde::Deserialize;
use std::cmp::Ordering;
use whitstone_core::config::decode;
use whitstone_core::{DAffine3, DVec3, Ray, SceneErrors};
use whitstone_scene::{Description, ShapeTable};

/// Of a surface that a ray leaves, a root this near to its start is that surface itself, as a part of the coordinates.
const LEFT: f64 = 1e-11;

struct Part {
    placed: Placed,
    object_from_world: DAffine3,
    kind: String,
    material: Material,
}

/// All shapes.
pub(super) struct Scene {
    parts: Vec<Part>,
}

/// The first surface on a ray.
pub(super) struct Hit {
    pub(super) shape: usize,
    pub(super) primitive: u32,
    pub(super) t: f64,
    /// The double vector nearest to the place.
    pub(super) point: DVec3,
    /// The geometric normal, of unit length.
    pub(super) normal: DVec3,
}

/// Quads of a heightfield that it tries for every ray.
const MOST_QUADS: u64 = 1 << 16;

/// Keys that say what of a shape the tracer does not know.
#[derive(Deserialize)]
struct Keys {
    normals: Option<serde::de::IgnoredAny>,
    shading: Option<String>,
    columns: Option<u64>,
    rows: Option<u64>,
}

/// The tracer knows shapes whose shading normal is the geometric one.
fn check_normals(shape: &ShapeTable<'_>) -> Result<(), SceneErrors> {
    let plugin = &shape.plugin;
    match &*plugin.name {
        "triangle" | "mesh" | "heightfield" => {
            let Keys {
                normals,
                shading,
                columns,
                rows,
            } = decode(&plugin.table)?;
            if columns.unwrap_or(64).saturating_mul(rows.unwrap_or(64)) > MOST_QUADS {
                return Err(unknown_part(plugin, "so large a heightfield"));
            }
            let flat = plugin.name != "mesh" || shading.as_deref() == Some("flat");
            match normals.is_none() && flat {
                true => Ok(()),
                false => Err(unknown_part(plugin, "interpolated normals")),
            }
        }
        // Of their materials and of the normals of patches it is not told which.
        "instance" | "patch" => Err(unknown_part(plugin, &format!("pictures of \"{}\"", plugin.name))),
        _ => Ok(()),
    }
}

impl Scene {
    pub(super) fn new(description: &Description<'_>) -> Result<Self, SceneErrors> {
        let part = |shape: &ShapeTable<'_>| {
            check_normals(shape)?;
            let map = *shape.transform.world_from_object();
            Ok(Part {
                placed: Placed {
                    surface: shapes::surface(description, &shape.plugin)?,
                    map,
                },
                object_from_world: map.inverse(),
                material: Material::of_shape(description, shape)?,
                kind: shape.plugin.name.clone(),
            })
        };
        let parts: Result<Vec<Part>, SceneErrors> = description.shapes.iter().map(part).collect();
        Ok(Self { parts: parts? })
    }

    /// The nearest hit with 0 < t < end; `from` is the primitive that the ray starts on.
    pub(super) fn nearest(
        &self,
        ray: &Ray,
        from: Option<(usize, u32)>,
        end: f64,
    ) -> Result<Option<Hit>, Unsure> {
        let mut bits = FIRST_BITS;
        loop {
            match self.attempt(ray, from, end, bits) {
                Ok(hit) => return Ok(hit),
                Err(Undecided) if bits >= MOST_BITS => return Err(Unsure::Touch),
                Err(Undecided) => bits *= 2,
            }
        }
    }

    fn attempt(
        &self,
        ray: &Ray,
        from: Option<(usize, u32)>,
        end: f64,
        bits: usize,
    ) -> Result<Option<Hit>, Undecided> {
        let line = Line::of(ray, bits);
        let zero = line.number(0.0);
        let last = end.is_finite().then(|| line.number(end));
        let near = LEFT * (1.0 + ray.origin.abs().max_element());
        let mut first: Option<(usize, crate::Root)> = None;
        for (number, part) in self.parts.iter().enumerate() {
            for root in part.placed.meet(&line)?.all {
                let left = from == Some((number, root.primitive)) && root.t.nearest().abs() <= near;
                if left || root.t.compare(&zero)? != Ordering::Greater {
                    continue;
                }
                if let Some(last) = &last
                    && root.t.compare(last)? != Ordering::Less
                {
                    continue;
                }
                let nearer = match &first {
                    None => true,
                    // Two primitives of a shape meet at their edges: the place is one, and so is the shape.
                    Some((shape, other)) => match root.t.compare(&other.t) {
                        Ok(order) => order == Ordering::Less,
                        Err(Undecided) if *shape == number && bits >= MOST_BITS => false,
                        Err(Undecided) => return Err(Undecided),
                    },
                };
                if nearer {
                    first = Some((number, root));
                }
            }
        }
        let Some((shape, root)) = first else {
            return Ok(None);
        };
        if !root.t.is_narrow() {
            return Err(Undecided);
        }
        Ok(Some(Hit {
            shape,
            primitive: root.primitive,
            t: root.t.nearest(),
            point: line.at(&root.t).nearest(),
            normal: root.normal.normalize(),
        }))
    }

    /// The material of a hit, as the viewer sees it.
    pub(super) fn material(&self, hit: &Hit, viewer: DVec3) -> At<'_> {
        let part = &self.parts[hit.shape];
        let object = part.object_from_world.transform_point3(hit.point);
        let uv = uv_of(&part.kind, object - part.material.center(), hit.primitive);
        part.material.at(uv, hit.normal, viewer)
    }
}
