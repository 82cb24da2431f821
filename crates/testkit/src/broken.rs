//! A broken law, and the check that finds it.

use std::fmt;
use whitstone_core::Ray;

/// The law that is broken, and where.
#[derive(Clone, Debug, PartialEq)]
pub struct Broken {
    /// Description and place.
    pub law: String,
    /// The ray that demonstrates it, if there is one.
    pub ray: Option<Ray>,
}

impl Broken {
    /// Demonstrated by a ray.
    pub(crate) fn at(ray: &Ray, law: String) -> Self {
        Self { law, ray: Some(*ray) }
    }

    /// Prefixes the message with the object under test.
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

/// Fails with `text` if a law does not hold.
pub(crate) fn law(holds: bool, text: &str) -> Result<(), String> {
    if holds { Ok(()) } else { Err(text.to_owned()) }
}
