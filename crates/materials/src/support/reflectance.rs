//! Textures and colours that are shares of light, from 0 to 1.

use whitstone_core::config::TextureRef;
use whitstone_core::{ColorSource, Context, SceneError, SceneErrors};

/// Resolves a reflectance. A constant colour above 1 is an error at its place in the scene.
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

/// Like [`reflectance`], named `what` in the error message.
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
