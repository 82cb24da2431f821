//! Whitstone: a modular Whitted ray tracer, and the harness that validates it against Mitsuba 3.
//!
//! This crate ties the plugin families to the scene loader and holds the command line, which a third
//! party can extend by its own plugins:
//!
//! ```no_run
//! # fn register(_: &mut whitstone::core::Registry) -> Result<(), whitstone::core::DuplicateType> { Ok(()) }
//! fn main() -> std::process::ExitCode {
//!     whitstone::Cli::new("whitstone").with(register).run()
//! }
//! ```

// First, because its macros take the place of those that panic.
#[macro_use]
mod terminal;
pub mod commands;
pub mod wireframe;

pub use commands::Cli;
pub use terminal::{Exit, Failure, finish, progress};
pub use whitstone_core as core;
pub use whitstone_image as image;
pub use whitstone_scene as scene;
pub use whitstone_validate as validate;

use whitstone_core::{DuplicateType, Registry};

/// All plugins that are built in: those of the families, and the peers whose features are on.
pub fn register(registry: &mut Registry) -> Result<(), DuplicateType> {
    whitstone_cameras::register(registry)?;
    whitstone_shapes::register(registry)?;
    whitstone_accelerators::register(registry)?;
    #[cfg(any(feature = "embree", feature = "obvhs"))]
    whitstone_peers::register(registry)?;
    whitstone_materials::register(registry)?;
    whitstone_textures::register(registry)?;
    whitstone_lights::register(registry)?;
    whitstone_samplers::register(registry)?;
    whitstone_integrators::register(registry)
}

/// A registry with all plugins that are built in.
pub fn registry() -> Registry {
    let mut registry = Registry::default();
    register(&mut registry).expect("the families of the workspace have distinct types");
    registry
}
