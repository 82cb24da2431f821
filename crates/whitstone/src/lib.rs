//! Whitstone: a modular Whitted ray tracer, and the harness that validates it against Mitsuba 3.
//!
//! This crate connects the plugin families to the scene loader and holds the command line, which a
//! third party can extend with its own plugins (`Cli`). Without its features it contains only what
//! slim binaries need ([`slim`]).

// First, because its macros replace the standard ones, which panic.
#[macro_use]
mod terminal;
#[cfg(feature = "cli")]
pub mod commands;
#[cfg(feature = "cli")]
mod interrupt;
#[cfg(feature = "cluster")]
mod jobs;
mod library;
#[cfg(feature = "cli")]
pub mod picture;
pub mod slim;
#[cfg(feature = "cli")]
pub mod wireframe;

#[cfg(feature = "cli")]
pub use commands::Cli;
#[cfg(feature = "cli")]
pub use interrupt::watch as watch_signals;
pub use library::{Change, Error, Problem, Scene, SceneOptions};
#[cfg(feature = "cli")]
pub use terminal::progress;
pub use terminal::{Exit, Failure, finish};
pub use whitstone_core as core;
pub use whitstone_image as image;
#[cfg(feature = "cli")]
pub use whitstone_metrics as metrics;
#[cfg(feature = "stress")]
pub use whitstone_oracle as oracle;
pub use whitstone_render as render;
pub use whitstone_scene as scene;
#[cfg(feature = "cli")]
pub use whitstone_validate as validate;
#[cfg(feature = "view")]
pub use whitstone_view as view;

#[cfg(feature = "plugins")]
use whitstone_core::{DuplicateType, Registry};

#[cfg(feature = "plugins")]
/// Registers all built-in plugins: those of the families, and the backends whose features are on.
pub fn register(registry: &mut Registry) -> Result<(), DuplicateType> {
    whitstone_cameras::register(registry)?;
    whitstone_shapes::register(registry)?;
    whitstone_accelerators::register(registry)?;
    #[cfg(any(feature = "embree", feature = "obvhs"))]
    whitstone_backends::register(registry)?;
    whitstone_materials::register(registry)?;
    whitstone_textures::register(registry)?;
    whitstone_lights::register(registry)?;
    whitstone_samplers::register(registry)?;
    whitstone_integrators::register(registry)?;
    #[cfg(feature = "formats")]
    whitstone_formats::register(registry);
    #[cfg(feature = "cli")]
    registry.add_format(whitstone_validate::PovRayFormat::default());
    Ok(())
}

#[cfg(feature = "plugins")]
/// A registry with all built-in plugins.
pub fn registry() -> Registry {
    let mut registry = Registry::default();
    register(&mut registry).expect("the families of the workspace have distinct types");
    registry
}
