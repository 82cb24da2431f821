//! Shares of light, at most all of it.

use whitstone_core::config::TextureRef;
use whitstone_core::{ColorSource, Context, SceneError, SceneErrors};

/// The colour or texture. A colour above 1 is an error at its value.
pub(crate) fn reflectance(
    reference: &TextureRef,
    context: &mut dyn Context,
) -> Result<ColorSource, SceneErrors> {
    share(reference, "a reflectance", context).map_err(|mut errors| {
        for error in &mut errors.0 {
            if error.message.starts_with("expected a reflectance") {
                error.help = Some("a surface cannot reflect more light than falls on it".to_owned());
            }
        }
        errors
    })
}

/// Likewise, called `what` in the message.
pub(crate) fn share(
    reference: &TextureRef,
    what: &str,
    context: &mut dyn Context,
) -> Result<ColorSource, SceneErrors> {
    let source = context.texture(reference)?;
    if let ColorSource::Constant(value) = source
        && value.max_component() > 1.0
    {
        let found = value.max_component();
        let mut error = SceneError::anywhere(format!("expected {what} from 0 to 1, found {found}"));
        error.span = reference.span.clone();
        return Err(error.into());
    }
    Ok(source)
}
