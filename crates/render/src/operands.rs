//! Operands: shapes that are written inside another shape, as parts of it.

use whitstone_core::config::SolidRef;
use whitstone_core::{LoweredShape, SceneError, SceneErrors, Shape, Transform};
use whitstone_scene::{PluginTable, parse_transform};

/// Maximum nesting of operands: each ray descends to the innermost ones.
const MAX_NESTING: usize = 16;

/// Keys of shapes that operands do not have, and the reasons.
const FORBIDDEN_KEYS: [(&str, &str); 5] = [
    ("material", "the whole shape has one material"),
    ("id", "only the whole shape can have an id"),
    ("group", "an instance of a group bounds no volume"),
    ("casts_shadow", "only the whole shape can cast no shadow"),
    ("motion", "only the whole shape can move"),
];

/// The nesting depth of the operand that is being built.
#[derive(Debug, Default)]
pub(crate) struct Operands {
    nesting: usize,
}

impl Operands {
    /// The table of an operand without its transform, and its object-to-world transform. If this
    /// succeeds, [`Self::leave`] must follow.
    pub(crate) fn enter<'s>(
        &mut self,
        table: &PluginTable<'s>,
        operand: &SolidRef,
        around: &Transform,
    ) -> Result<(PluginTable<'s>, Transform), SceneErrors> {
        if self.nesting == MAX_NESTING {
            let message = format!("operands are nested more than {MAX_NESTING} deep");
            return Err(SceneError::at(operand.span.clone(), message).into());
        }
        let mut plugin = table.clone();
        let mut errors = SceneErrors::default();
        for (key, why) in FORBIDDEN_KEYS {
            if let Some((found, _)) = plugin.table.get_mut().remove_entry(key) {
                let error = SceneError::at(found.span(), format!("an operand must not have the key `{key}`"));
                errors.0.push(error.with_help(why));
            }
        }
        let value = plugin.table.get_mut().remove("transform");
        let own = match &value {
            None => Some(Transform::IDENTITY),
            Some(value) => errors.take(parse_transform(value)),
        };
        let placed = own.and_then(|own| {
            let placed = around.after(&own);
            if placed.is_none() {
                let span = value.as_ref().map_or(operand.span.clone(), |value| value.span());
                let message = "the transform is singular when combined with that of the whole shape";
                errors.0.push(SceneError::at(span, message));
            }
            placed
        });
        let placed = errors.into_result(placed)?.ok_or_else(SceneErrors::default)?;
        self.nesting += 1;
        Ok((plugin, placed))
    }

    pub(crate) fn leave(&mut self) {
        self.nesting -= 1;
    }
}

/// The error that an operand must be written inline.
pub(crate) fn no_id(operand: &SolidRef) -> SceneError {
    let error = SceneError::at(operand.span.clone(), "expected a shape, found a string");
    error.with_help("write the operand as an inline table: { type = \"sphere\" }")
}

/// The built shape, if it bounds a volume.
pub(crate) fn solid(shape: LoweredShape, plugin: &PluginTable<'_>) -> Result<Box<dyn Shape>, SceneErrors> {
    if let LoweredShape::Triangles(mesh) = &shape
        && mesh.attributes.is_some()
    {
        let message = "an operand has no vertex colours, tangents or second texture coordinates";
        return Err(SceneError::at(plugin.name_span.clone(), message).into());
    }
    shape.into_solid().map_err(|why| {
        let why = why.map_or(String::new(), |why| format!(": {why}"));
        let message = format!(
            "this {} bounds no volume, so it cannot be an operand{why}",
            plugin.name
        );
        let error = SceneError::at(plugin.name_span.clone(), message);
        let help = "operands are closed shapes (sphere, box, a cylinder with caps, a closed mesh, a level set that its box does not cut), the half-space below a plane, and csg";
        error.with_help(help).into()
    })
}
