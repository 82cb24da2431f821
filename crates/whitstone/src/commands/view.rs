//! `view`: shows a scene in the browser while it is edited.

use super::{Drivers, SceneArguments};
use crate::interrupt;
use crate::terminal::{Exit, Failure};
use clap::Args;
use std::path::PathBuf;
use whitstone_core::Registry;
use whitstone_validate::REFERENCES;
use whitstone_view::{Options, StartError, View};

/// Show a scene in the browser while it is edited: orbit the camera, click for the rays of a pixel,
/// compare with Mitsuba
///
/// Prints the address of a page and serves it until Ctrl-C. The page is on the loopback interface
/// only, and its address has a random token: it is not reachable from the network, and other pages
/// cannot read it. One page is served at a time.
///
/// The picture appears at low resolution first and becomes the one that `render` writes. When any
/// file of the scene changes, it is built again; errors are shown at their line, also those that
/// the scene has at the start. Drag to orbit, drag with Shift or the right button to pan, turn the
/// wheel to dolly. A click shows the value, layers and ray tree of a pixel, draws its rays and
/// steps through them. Other choices of the page: a heat map of traversal steps, element tests or
/// rays, another accelerator, and a comparison with the stored reference or a live Mitsuba.
///
/// Exit code 2 for a wrong command line or a scene file that does not exist, 3 if the port is in
/// use, 130 after Ctrl-C.
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Examples:\n  whitstone view scenes/showcase/classic.toml\n  whitstone view scenes/showcase/classic.toml --set film.width=640 --set film.height=360\n  whitstone view scenes/showcase/classic.toml --tev 127.0.0.1:14158"
)]
pub struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// Port of the page on 127.0.0.1; 0 means any free one
    #[arg(long, value_name = "PORT", default_value_t = 0)]
    port: u16,
    /// Also send the pictures to a running tev, whose default is 127.0.0.1:14158
    #[arg(long, value_name = "HOST:PORT")]
    tev: Option<String>,
    /// Folder of the stored references
    #[arg(long, default_value = REFERENCES, value_name = "DIR")]
    references: PathBuf,
    #[command(flatten)]
    drivers: Drivers,
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let scene = &arguments.scene;
    // A file with errors can be mended while the page is open; a wrong name cannot.
    if let Err(error) = std::fs::metadata(&scene.scene) {
        return Err(Failure::usage(format!("{}: {error}", scene.scene.display())));
    }
    let options = Options {
        scene: scene.scene.clone(),
        overrides: scene.overrides.clone(),
        camera: scene.camera.clone(),
        root: scene.root.clone(),
        max_memory: scene.max_memory,
        max_tree_rays: Some(scene.max_tree_rays),
        port: arguments.port,
        tev: arguments.tev.clone(),
        references: arguments.references.clone(),
        target: scene.target.folder().to_owned(),
        fresh: scene.fresh,
        installation: arguments.drivers.installation(&scene.target),
    };
    let view = View::open(options, registry).map_err(|error| match error {
        StartError::Tev(_) => Failure::usage(error),
        StartError::Port { .. } | StartError::Server(_) => Failure::environment(error),
    })?;
    println!("{}", view.url());
    eprintln!("open this address in a browser on this machine; Ctrl-C ends the view");
    // Nothing has to be kept, so a signal ends the process at once.
    view.run(interrupt::stop(), &|text| eprintln!("{text}"))
        .map_err(Failure::environment)?;
    Ok(Exit::Pass)
}
