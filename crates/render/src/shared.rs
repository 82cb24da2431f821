//! Data that plugins share: the contents of files.

use std::any::Any;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Data that plugins share by key, such as the texels of a file. Builds of scenes that read the
/// same files can have one in common; it must not outlive the contents of the files.
#[derive(Default)]
pub struct Shared(Mutex<BTreeMap<String, Arc<dyn Any + Send + Sync>>>);

impl Shared {
    pub(crate) fn get(&self, key: &str) -> Option<Arc<dyn Any + Send + Sync>> {
        let data = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        data.get(key).cloned()
    }

    pub(crate) fn insert(&self, key: String, value: Arc<dyn Any + Send + Sync>) {
        let mut data = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        data.insert(key, value);
    }
}
