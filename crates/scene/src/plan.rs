use crate::groups::{self, Appearances, PlannedGroup};
use crate::{AUTO, Checked, Description, PluginTable, ShapeTable};
use std::collections::BTreeSet;
use whitstone_core::{FamilyName, Registry, SceneErrors};

/// The parts of a scene that need to be built, and those that do not.
pub struct Plan<'d, 's> {
    /// The scene.
    pub description: &'d Description<'s>,
    /// The sampler, also if the scene has no table for it; `None` if the registry has no default
    /// either.
    pub sampler: Option<PluginTable<'s>>,
    /// The integrator, likewise.
    pub integrator: Option<PluginTable<'s>>,
    /// The instantiated groups, each after the groups that it instantiates itself.
    pub groups: Vec<PlannedGroup<'d>>,
    /// All shapes and their variants.
    pub appearances: Appearances<'d, 's>,
    /// The parts that are not built, loaded or run.
    pub omitted: Vec<Omitted>,
    /// Every plugin that the scene names, whether or not it is built. A scene is rejected if one of
    /// them is missing.
    pub named: BTreeSet<(FamilyName, &'static str)>,
}

/// A part that a scene mentions or could have, and that is not built for it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Omitted {
    /// The part.
    pub what: String,
    /// The reason.
    pub why: String,
}

impl<'d, 's> Plan<'d, 's> {
    /// Looks up every plugin by its type, and finds the groups in use. There is always a plan, of
    /// the valid parts.
    pub fn new(description: &'d Description<'s>, registry: &Registry) -> Checked<Self> {
        use FamilyName::{Accelerator, Camera, Integrator, Light, Material, Sampler, Shape, Texture};
        let mut errors = SceneErrors::default();
        let mut or_default = |table: &Option<PluginTable<'s>>, family| match table {
            Some(table) => Some(table.clone()),
            None => errors.take(registry.default_type(family)).map(PluginTable::named),
        };
        let sampler = or_default(&description.sampler, Sampler);
        let integrator = or_default(&description.integrator, Integrator);
        let mut named = BTreeSet::new();
        let plugins = [
            (Camera, Some(&description.camera)),
            (Sampler, sampler.as_ref()),
            (Integrator, integrator.as_ref()),
        ]
        .into_iter()
        .filter_map(|(family, table)| Some((family, table?)))
        .chain((description.accelerator.name != AUTO).then_some((Accelerator, &description.accelerator)))
        .chain(description.lights.iter().map(|plugin| (Light, plugin)))
        .chain(description.shapes.iter().map(|shape| (Shape, &shape.plugin)))
        .chain(description.groups.values().flat_map(|group| {
            let named = (group.accelerator.name != AUTO).then_some((Accelerator, &group.accelerator));
            named
                .into_iter()
                .chain(group.shapes.iter().map(|shape| (Shape, &shape.plugin)))
        }))
        .chain(description.materials.values().map(|plugin| (Material, plugin)))
        .chain(description.textures.values().map(|plugin| (Texture, plugin)));
        for (family, plugin) in plugins {
            if description.faulty.tables.contains(family.singular()) {
                continue;
            }
            match registry.get(family, &plugin.name) {
                Ok(entry) => {
                    named.insert((family, entry.name));
                }
                Err(mut error) => {
                    error.span = Some(plugin.name_span.clone());
                    errors.0.push(error);
                }
            }
        }
        let groups = groups::plan(description, &mut errors);
        let placed: BTreeSet<&str> = groups.iter().map(|group| group.id).collect();
        let unplaced = |id: &&String| !placed.contains(id.as_str());
        let omitted = description
            .groups
            .keys()
            .filter(unplaced)
            .map(|id| Omitted {
                what: format!("group \"{id}\""),
                why: "no instance uses it".to_owned(),
            })
            .collect();
        let shapes = shapes_by_number(description, &groups);
        let appearances = Appearances::new(description, shapes, &groups, &mut errors);
        let plan = Self {
            description,
            appearances,
            sampler,
            integrator,
            groups,
            omitted,
            named,
        };
        Checked {
            value: Some(plan),
            errors,
        }
    }

    /// All shapes that are used, by number; those of groups come last.
    pub fn shapes(&self) -> Vec<&'d ShapeTable<'s>> {
        shapes_by_number(self.description, &self.groups)
    }
}

pub(crate) fn shapes_by_number<'d, 's>(
    description: &'d Description<'s>,
    groups: &[PlannedGroup<'d>],
) -> Vec<&'d ShapeTable<'s>> {
    let mut groups = groups.to_vec();
    groups.sort_unstable_by_key(|group| group.first_shape);
    let of_groups = groups
        .iter()
        .flat_map(|group| &description.groups[group.id].shapes);
    description.shapes.iter().chain(of_groups).collect()
}
