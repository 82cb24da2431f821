//! The names of plugins and shapes that `explain` prints.

use whitstone_scene::{Plan, PluginTable};

/// Names from the scene description, which the pipeline does not keep.
pub(super) struct Names {
    pub(super) camera: String,
    pub(super) sampler: String,
    pub(super) integrator: String,
    pub(super) lights: Vec<String>,
    /// For each shape by number, its id or its type; shapes of groups come last.
    pub(super) shapes: Vec<String>,
}

impl Names {
    pub(super) fn of(plan: &Plan<'_, '_>) -> Self {
        let description = plan.description;
        let name = |table: &Option<PluginTable<'_>>| {
            table
                .as_ref()
                .map_or_else(String::new, |table| table.name.clone())
        };
        let shapes = plan.shapes().into_iter().map(|shape| {
            let kind = &shape.plugin.name;
            shape
                .id
                .as_ref()
                .map_or_else(|| kind.clone(), |id| format!("{kind} \"{id}\""))
        });
        Self {
            camera: description.camera.name.clone(),
            sampler: name(&plan.sampler),
            integrator: name(&plan.integrator),
            lights: description
                .lights
                .iter()
                .map(|light| light.name.clone())
                .collect(),
            shapes: shapes.collect(),
        }
    }

    /// The name of a shape by number.
    pub(super) fn shape(&self, number: i64) -> &str {
        let name = usize::try_from(number)
            .ok()
            .and_then(|number| self.shapes.get(number));
        name.map_or("?", String::as_str)
    }
}
