use crate::Description;
use std::collections::BTreeSet;
use whitstone_core::config::PluginRef;
use whitstone_core::{FamilyName, Registry, SceneErrors};

/// What a scene needs built, and what it can do without.
pub struct Plan<'d, 's> {
    /// The scene.
    pub description: &'d Description<'s>,
    /// Ids of the shared materials that shapes name.
    pub materials: BTreeSet<&'d str>,
    /// What will not be built, loaded or run.
    pub left_out: Vec<LeftOut>,
}

/// A thing that a scene mentions or could have, and that is not built for it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeftOut {
    /// What.
    pub what: String,
    /// Why.
    pub why: String,
}

impl<'d, 's> Plan<'d, 's> {
    /// Looks up every plugin by its type, and follows the references of shapes to materials.
    pub fn new(description: &'d Description<'s>, registry: &Registry) -> Result<Self, SceneErrors> {
        let (plan, errors) = Self::new_partly(description, registry);
        errors.into_result(plan)
    }

    /// As [`Self::new`], with the plan for what is right.
    pub(crate) fn new_partly(description: &'d Description<'s>, registry: &Registry) -> (Self, SceneErrors) {
        use FamilyName::{Accelerator, Camera, Integrator, Light, Material, Sampler, Shape, Texture};
        let mut errors = SceneErrors::default();
        let plugins = [
            (Camera, &description.camera),
            (Sampler, &description.sampler),
            (Integrator, &description.integrator),
        ]
        .into_iter()
        .chain((description.accelerator.name != "auto").then_some((Accelerator, &description.accelerator)))
        .chain(description.lights.iter().map(|plugin| (Light, plugin)))
        .chain(description.shapes.iter().map(|shape| (Shape, &shape.plugin)))
        .chain(description.materials.values().map(|plugin| (Material, plugin)))
        .chain(description.textures.values().map(|plugin| (Texture, plugin)));
        for (family, plugin) in plugins {
            if !description.faulty.tables.contains(family.singular())
                && let Err(mut error) = registry.get(family, &plugin.name)
            {
                error.span = Some(plugin.name_span.clone());
                errors.0.push(error);
            }
        }
        let materials: BTreeSet<&str> = description
            .shapes
            .iter()
            .filter_map(|shape| match &shape.material {
                Some((_, PluginRef::Shared(id))) => Some(id.as_str()),
                _ => None,
            })
            .collect();
        let left_out = description
            .materials
            .keys()
            .filter(|id| !materials.contains(id.as_str()))
            .map(|id| LeftOut {
                what: format!("material \"{id}\""),
                why: "no shape has it".to_owned(),
            })
            .collect();
        let plan = Self {
            description,
            materials,
            left_out,
        };
        (plan, errors)
    }
}
