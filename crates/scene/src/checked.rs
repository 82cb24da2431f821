//! Results of steps that continue after errors.

use whitstone_core::SceneErrors;

/// The result of a step, made of the valid parts of the scene, with all errors found on the way.
///
/// Later steps work on it too, so that one pass through the steps reports the errors of all of
/// them.
#[derive(Debug)]
pub struct Checked<T> {
    /// The result; `None` if the errors leave none.
    pub value: Option<T>,
    /// The errors of this step.
    pub errors: SceneErrors,
}

impl<T> Checked<T> {
    /// The result if there are no errors.
    pub fn into_result(self) -> Result<T, SceneErrors> {
        match self.value {
            Some(value) => self.errors.into_result(value),
            None => Err(self.errors),
        }
    }
}
