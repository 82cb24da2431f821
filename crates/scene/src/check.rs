//! Collects all errors of a scene.

use crate::{BuildOptions, Description, Pipeline, Plan, Sources};
use whitstone_core::{Registry, SceneErrors};

/// All errors of all steps. [`Description::parse`], [`Plan::new`] and [`Pipeline::build`] each
/// report all their own errors, but the first that fails hides those of the later steps. This
/// function continues with the valid parts of the scene. The result is empty exactly if all three
/// succeed.
pub fn all_errors(sources: &Sources, registry: &Registry) -> SceneErrors {
    all_errors_with(sources, registry, BuildOptions::default())
}

/// Like [`all_errors`], for [`Pipeline::build_with`].
pub fn all_errors_with(sources: &Sources, registry: &Registry, options: BuildOptions<'_>) -> SceneErrors {
    let (description, mut errors) = Description::parse_partly(sources);
    let Some(description) = description else {
        return errors;
    };
    let (plan, found) = Plan::new_partly(&description, registry);
    errors.0.extend(found.0);
    let (_, found) = Pipeline::build_partly(&plan, registry, options);
    // The plan reports an unknown type, and the build reports it again.
    for error in found.0 {
        if !errors.0.contains(&error) {
            errors.0.push(error);
        }
    }
    errors
}
