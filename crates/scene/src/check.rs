//! All that is wrong with a scene.

use crate::{BuildOptions, Description, Pipeline, Plan, Sources};
use whitstone_core::{Registry, SceneErrors};

/// Every error of every step. [`Description::parse`], [`Plan::new`] and [`Pipeline::build`] each
/// report all their own errors, but the first of them that fails leaves those of the next ones
/// unknown; this goes on with what is right. Empty exactly if the three succeed.
pub fn all_errors(sources: &Sources, registry: &Registry) -> SceneErrors {
    all_errors_with(sources, registry, BuildOptions::default())
}

/// As [`all_errors`], for [`Pipeline::build_with`].
pub fn all_errors_with(sources: &Sources, registry: &Registry, options: BuildOptions<'_>) -> SceneErrors {
    let (description, mut errors) = Description::parse_partly(sources);
    let Some(description) = description else {
        return errors;
    };
    let (plan, found) = Plan::new_partly(&description, registry);
    errors.0.extend(found.0);
    let (_, found) = Pipeline::build_partly(&plan, registry, options);
    // An unknown type is found by the plan, and again by what builds it.
    for error in found.0 {
        if !errors.0.contains(&error) {
            errors.0.push(error);
        }
    }
    errors
}
