//! Pages on the loopback interface: the live view, on which a scene is seen while it is edited, and
//! the review, on which images are accepted as references.
//!
//! | module | contents |
//! |---|---|
//! | `gate` | the server, and the requests that it refuses |
//! | `review` | the review; all other modules belong to the live view |
//! | `scene` | the built scene, and the camera, size and sampler of a picture |
//! | `renderer` | pictures of the scene that become better |
//! | `state` | what all threads share: the wish of the page, and the last picture |
//! | `http` | requests that are answered |
//! | `watch` | changes of files |
//! | `pixel` | value, layers and ray tree of a pixel |
//! | `heat` | numbers of work per pixel |
//! | `reference` | a live Mitsuba, and the comparison with it |
//! | `tev` | the viewer tev |
//! | `camera` | where a camera is and looks |
//!
//! The page, its script and its style are in `src/page`, and part of the program.

#![forbid(unsafe_code)]

mod camera;
mod gate;
pub mod heat;
mod http;
mod pixel;
mod reference;
mod renderer;
mod review;
mod scene;
mod state;
mod tev;
mod watch;

pub use gate::StartError;
pub use review::{Pairs, Review, Standing};

use gate::{Gate, start};
use scene::Origin;
use state::Shared;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use whitstone_core::Registry;
use whitstone_validate::{Installation, Stop};

/// Threads that answer requests: one waits for news, and others must not wait for it.
const THREADS: usize = 4;

/// Time between two attempts to reach tev.
const TEV_INTERVAL: Duration = Duration::from_secs(2);

/// What is viewed, and how.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The scene file.
    pub scene: PathBuf,
    /// Changes of the scene, as `PATH=VALUE`.
    pub overrides: Vec<String>,
    /// Camera of a file of another format, by name or index; by default the first.
    pub camera: Option<String>,
    /// The folder that must contain all files of the scene; by default they may be anywhere.
    pub root: Option<PathBuf>,
    /// Memory limit in bytes; by default the available memory.
    pub max_memory: Option<u64>,
    /// Maximum number of rays into which a camera ray may branch; by default that of `render`.
    pub max_tree_rays: Option<u32>,
    /// The port on the loopback interface; 0 for any free one.
    pub port: u16,
    /// `HOST:PORT` of a running tev, which also gets the pictures.
    pub tev: Option<String>,
    /// Folder of the stored references.
    pub references: PathBuf,
    /// Folder for temporary files, data that takes long to compute, and the answers of a live
    /// Mitsuba.
    pub target: PathBuf,
    /// Whether data of earlier runs is computed again.
    pub fresh: bool,
    /// Where the drivers and the Python environment of Mitsuba are.
    pub installation: Installation,
}

/// A view whose port is open.
pub struct View<'r> {
    options: Options,
    registry: &'r Registry,
    gate: Gate,
}

impl<'r> View<'r> {
    /// Opens the port. Nothing is answered before [`Self::run`].
    ///
    /// # Errors
    /// If the port is in use, or an option is wrong.
    pub fn open(options: Options, registry: &'r Registry) -> Result<Self, StartError> {
        if let Some(address) = &options.tev {
            tev::check(address).map_err(StartError::Tev)?;
        }
        let gate = Gate::open(options.port)?;
        Ok(Self {
            options,
            registry,
            gate,
        })
    }

    /// The address of the page. Whoever knows it can see the scene.
    pub fn url(&self) -> String {
        self.gate.url()
    }

    /// Serves the page until `stop` is requested. `say` receives the problems of the scene, for a
    /// terminal.
    ///
    /// # Errors
    /// A thread cannot be started.
    pub fn run(&self, stop: &Stop, say: &(dyn Fn(&str) + Sync)) -> Result<(), StartError> {
        let shared = Shared::default();
        let options = &self.options;
        let origin = Origin {
            path: options.scene.clone(),
            overrides: options.overrides.clone(),
            camera: options.camera.clone(),
            root: options.root.clone(),
            max_memory: options.max_memory,
            max_tree_rays: options.max_tree_rays,
            cache: (options.target.join("kept"), !options.fresh),
        };
        let name = options.scene.display().to_string();
        let page = http::page(&name, self.gate.token());
        let site = http::Site {
            shared: &shared,
            registry: self.registry,
            page: &page,
        };
        let source = reference::Source {
            shared: &shared,
            registry: self.registry,
            origin: &origin,
            installation: &options.installation,
            target: &options.target,
            stop: stop.clone(),
        };
        shared.change(|state| state.watched.push(options.scene.clone()));
        std::thread::scope(|scope| {
            let start_all = || -> Result<(), StartError> {
                start(scope, || {
                    renderer::Renderer::new(&shared, self.registry, &origin, &options.references, say).run();
                })?;
                start(scope, || watch::run(&shared))?;
                start(scope, || source.run())?;
                if let Some(address) = &options.tev {
                    start(scope, || send_to_tev(address, &name, &shared, say))?;
                }
                (0..THREADS).try_for_each(|_| start(scope, || site.serve(&self.gate)))
            };
            let started = start_all();
            while started.is_ok() && !stop.is_requested() {
                std::thread::sleep(Duration::from_millis(50));
            }
            shared.change(|state| state.ended = true);
            started
        })
    }
}

/// Sends every picture of full size to tev, until the view ends.
fn send_to_tev(address: &str, name: &str, shared: &Shared, say: &(dyn Fn(&str) + Sync)) {
    let mut tev = tev::Tev::new(address);
    let mut sent = 0;
    let mut failed: Option<Instant> = None;
    loop {
        let (frame, number) = {
            let state = shared.wait(TEV_INTERVAL, |state| state.frame_number != sent);
            if state.ended {
                return;
            }
            (state.frame.clone(), state.frame_number)
        };
        let may_try = failed.is_none_or(|at| at.elapsed() >= TEV_INTERVAL);
        let Some(frame) = frame.filter(|_| number != sent && may_try) else {
            // A condition that holds does not wait.
            std::thread::sleep(Duration::from_millis(20));
            continue;
        };
        let full = &frame.facts["full"];
        let is_full = full[0] == frame.size[0] && full[1] == frame.size[1];
        if frame.rgb.is_empty() || !is_full {
            sent = number;
            continue;
        }
        let remark = match tev.show(name, frame.size, &frame.rgb) {
            Ok(()) => {
                sent = number;
                failed = None;
                format!("pictures are sent to tev at {address}")
            }
            Err(error) => {
                let remark = format!("tev at {address} cannot be reached, and is tried again: {error}");
                if failed.is_none() {
                    say(&format!("warning: {remark}"));
                }
                failed = Some(Instant::now());
                remark
            }
        };
        shared.change(|state| {
            if state.tev.as_ref() != Some(&remark) {
                state.tev = Some(remark);
                state.news += 1;
            }
        });
    }
}
