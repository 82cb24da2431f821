//! Accelerators named on the command line, with their quality.

use std::sync::Arc;
use whitstone::core::{Accelerator, Accelerators, Geometry, Registry};
use whitstone_testkit::TestContext;

/// An accelerator and its quality.
pub(super) struct Choice {
    pub(super) kind: String,
    /// Empty for the default.
    pub(super) quality: String,
}

impl Choice {
    /// Parses TYPE or TYPE:QUALITY.
    pub(super) fn parse(text: &str) -> Self {
        let (kind, quality) = text.split_once(':').unwrap_or((text, ""));
        Self {
            kind: kind.to_owned(),
            quality: quality.to_owned(),
        }
    }

    /// Type and quality, for tables.
    pub(super) fn label(&self) -> String {
        format!("{} {}", self.kind, self.quality)
    }
}

/// Builds the accelerator of this name.
pub(super) fn build(
    registry: &Registry,
    choice: &Choice,
    geometry: &Arc<Geometry>,
) -> Result<Box<dyn Accelerator>, String> {
    let Choice { kind, quality } = choice;
    let text = match quality.as_str() {
        "" => String::new(),
        quality => format!("quality = \"{quality}\""),
    };
    let table = toml::de::DeTable::parse(&text).map_err(|error| error.to_string())?;
    registry
        .build::<Accelerators>(kind, &table, geometry.clone(), &mut TestContext::default())
        .map_err(|error| format!("{kind}: {error}"))
}
