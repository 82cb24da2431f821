//! Textures that are computed from other textures.

use whitstone_core::config::TextureRef;
use whitstone_core::{ColorSource, Context, SceneErrors, SurfaceAttributes};

/// The textures and colours that a texture is made of.
pub(crate) fn parts(
    references: &[TextureRef],
    context: &mut dyn Context,
) -> Result<Vec<ColorSource>, SceneErrors> {
    let mut errors = SceneErrors::default();
    let built: Vec<_> = references
        .iter()
        .filter_map(|reference| errors.take(context.texture(reference)))
        .collect();
    // A texture that could not be built has told why where it was built first, and nothing here.
    if built.len() < references.len() {
        return Err(errors);
    }
    errors.into_result(built)
}

/// What all of them read.
pub(crate) fn needs(parts: &[ColorSource]) -> SurfaceAttributes {
    let each = parts.iter().map(ColorSource::needs);
    each.fold(SurfaceAttributes::NOTHING, |all, needs| all | needs)
}

/// A texture of (u, v) for tests: a left of u = 0.5, else black.
#[cfg(test)]
pub(crate) struct Halves(pub(crate) whitstone_core::Rgb);

#[cfg(test)]
impl whitstone_core::Texture for Halves {
    fn needs(&self) -> SurfaceAttributes {
        SurfaceAttributes::UV
    }

    fn value(&self, point: &whitstone_core::SurfaceInteraction) -> whitstone_core::Rgb {
        if point.uv.x < 0.5 {
            self.0
        } else {
            whitstone_core::Rgb::BLACK
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;
    use whitstone_core::config::FilePath;
    use whitstone_core::{Diagnostics, Resources, SceneError, Storage};

    /// Textures that could not be built, and have told why before.
    struct Told;

    impl Resources for Told {
        fn texture(&mut self, _: &TextureRef) -> Result<ColorSource, SceneErrors> {
            Err(SceneErrors::default())
        }

        fn file(&self, file: &FilePath) -> Result<PathBuf, SceneError> {
            Err(SceneError::at(file.span.clone(), "no files"))
        }
    }

    impl Storage for Told {}

    impl Diagnostics for Told {
        fn warn(&mut self, _: SceneError) {}
    }

    #[test]
    fn a_part_that_is_missing_fails_the_whole_without_another_error() {
        let found = parts(&[TextureRef::grey(0.5)], &mut Told);
        assert!(found.is_err_and(|errors| errors.0.is_empty()));
    }
}
