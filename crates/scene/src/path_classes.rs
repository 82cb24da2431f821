//! The path classes of `[film]`.

#[cfg(feature = "paths")]
mod compile;

#[cfg(feature = "paths")]
pub(crate) use compile::compile;
use whitstone_core::SourceSpan;
#[cfg(not(feature = "paths"))]
use whitstone_core::{PathClasses, SceneError, SceneErrors};

/// A class as it is written in the scene.
pub(crate) struct Expression {
    pub(crate) name: String,
    pub(crate) text: String,
    /// Place of the text, in quotes.
    pub(crate) span: SourceSpan,
}

/// Refuses all classes: a slim binary links no parser for scenes that have none.
#[cfg(not(feature = "paths"))]
pub(crate) fn compile(expressions: &[Expression]) -> Result<PathClasses, SceneErrors> {
    let message = "this program is built without path classes";
    Err(match expressions {
        [] => SceneError::anywhere(message).into(),
        [Expression { name, text, span }, ..] => {
            SceneError::at(span.clone(), format!("{message}: {name} = {text:?} is not read")).into()
        }
    })
}
