//! The share of light that a surface gives back, at most all of it.

use whitstone_core::config::TextureRef;
use whitstone_core::{ColorSource, Context, SceneError, SceneErrors};

/// The colour or texture. A colour above 1 is an error at its value.
pub(crate) fn reflectance(
    reference: &TextureRef,
    context: &mut dyn Context,
) -> Result<ColorSource, SceneErrors> {
    let source = context.texture(reference)?;
    if let ColorSource::Constant(value) = source
        && value.max_component() > 1.0
    {
        let found = value.max_component();
        let mut error = SceneError::anywhere(format!("expected a reflectance from 0 to 1, found {found}"))
            .with_help("a surface cannot reflect more light than falls on it");
        error.span = reference.span.clone();
        return Err(error.into());
    }
    Ok(source)
}
