//! A law that something breaks.

use std::fmt;
use whitstone_core::Ray;

/// Which law, and where.
#[derive(Clone, Debug, PartialEq)]
pub struct Broken {
    /// In words, with the place.
    pub law: String,
    /// The ray that shows it, if it is one.
    pub ray: Option<Ray>,
}

impl Broken {
    /// Shown by a ray.
    pub(crate) fn at(ray: &Ray, law: String) -> Self {
        Self { law, ray: Some(*ray) }
    }

    /// On what, in front of the message.
    pub(crate) fn within(self, what: &str) -> Self {
        let law = format!("{what}: {}", self.law);
        Self { law, ..self }
    }
}

impl From<String> for Broken {
    fn from(law: String) -> Self {
        Self { law, ray: None }
    }
}

impl fmt::Display for Broken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.law)
    }
}
