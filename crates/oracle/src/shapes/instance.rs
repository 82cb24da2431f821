//! An instance of a group of shapes.

use super::{Placed, Surface, surface};
use crate::interval::Decided;
use crate::root::Roots;
use crate::vector::Line;
use serde::Deserialize;
use std::collections::BTreeMap;
use whitstone_core::config::GroupRef;
use whitstone_core::{MaterialRef, SceneError, SceneErrors};
use whitstone_scene::Description;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Config {
    pub(crate) group: GroupRef,
    /// By the ids of the shared materials that are replaced.
    #[serde(default)]
    pub(crate) materials: BTreeMap<String, MaterialRef>,
}

pub(crate) struct Instance(Vec<Placed>);

impl Instance {
    /// The scene must have passed the planner: then no group contains itself.
    pub(crate) fn new(description: &Description<'_>, config: &Config) -> Result<Self, SceneErrors> {
        let Some(group) = description.groups.get(&config.group.id) else {
            return Err(SceneError::at(config.group.span.clone(), "no such group").into());
        };
        let shapes = group.shapes.iter().map(|shape| {
            Ok(Placed {
                surface: surface(description, &shape.plugin)?,
                map: *shape.transform.world_from_object(),
            })
        });
        let shapes: Result<_, SceneErrors> = shapes.collect();
        Ok(Self(shapes?))
    }
}

impl Surface for Instance {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        let mut all = Vec::new();
        for shape in &self.0 {
            all.extend(shape.meet(line)?.all);
        }
        Ok(Roots::new(all))
    }
}
