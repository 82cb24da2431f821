//! Pictures of a live Mitsuba, in the background, and the comparison with them.

use crate::scene::{Aspect, Failed, Origin};
use crate::state::{Reference, Shared, key};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use whitstone_core::Registry;
use whitstone_image::{Image, Limits, atomic, exr_io};
use whitstone_metrics::flip;
use whitstone_metrics::metrics::{mean_reference, relative_residual};
use whitstone_validate::driver::{SceneText, Setting};
use whitstone_validate::environment::Environment;
use whitstone_validate::{Installation, Live, Renderer, Stop, decode_textures};

/// Time limit for one answer of the driver.
const TIME_LIMIT: Duration = Duration::from_secs(300);

/// What the live reference needs.
pub(crate) struct Source<'a> {
    pub(crate) shared: &'a Shared,
    pub(crate) registry: &'a Registry,
    pub(crate) origin: &'a Origin,
    pub(crate) installation: &'a Installation,
    pub(crate) target: &'a Path,
    pub(crate) stop: Stop,
}

impl Source<'_> {
    /// Renders references whenever the page asks for one, until the view ends. The driver keeps
    /// running in between.
    pub(crate) fn run(&self) {
        let mut live = None;
        loop {
            let asked = {
                let mut state = self.shared.wait(Duration::MAX, |state| state.asks_for_reference);
                if state.ended {
                    return;
                }
                state.asks_for_reference = false;
                state.wish.clone()
            };
            let result = self.render(&mut live, &asked);
            self.tell(match result {
                Ok(found) => found,
                Err(problem) => Reference::Failed(problem),
            });
        }
    }

    fn tell(&self, reference: Reference) {
        self.shared.change(|state| {
            state.reference = reference;
            state.news += 1;
        });
    }

    fn render(&self, live: &mut Option<Live>, wish: &crate::state::Wish) -> Result<Reference, String> {
        let working = |what: &str| self.tell(Reference::Working(what.to_owned()));
        let key = self.shared.with_scene(|scene| {
            let aspect = Aspect {
                look_at: wish.look_at,
                divisor: 1,
                preview: false,
            };
            (scene.version.files == wish.files).then(|| key(scene, &aspect))
        });
        let key = key.flatten().ok_or("the scene cannot be built")?;
        if live.is_none() {
            working("starting Mitsuba");
            let environment =
                Environment::ensure(self.installation, &working).map_err(|error| error.to_string())?;
            let environment = environment
                .with_twins(self.registry, self.target)
                .map_err(|error| error.to_string())?;
            let cache = self.target.join("live");
            let mut started = Live::start(Renderer::MITSUBA, environment, cache, true, TIME_LIMIT)
                .map_err(|error| error.to_string())?;
            started.set_stop(self.stop.clone());
            *live = Some(started);
        }
        working("Mitsuba is rendering");
        // With the camera's view, also if our build does not depend on it.
        let version = wish.version(true);
        let mut flattened = self
            .origin
            .flatten(&version, self.registry)
            .map_err(|Failed { report, .. }| report)?;
        decode_textures(&mut flattened, &self.target.join("decoded"))?;
        let folder = std::fs::create_dir_all(self.target)
            .and_then(|()| atomic::TemporaryFolder::new_in(self.target))
            .map_err(|error| format!("{}: {error}", self.target.display()))?;
        let out: PathBuf =
            std::path::absolute(folder.path().join("image.exr")).map_err(|error| error.to_string())?;
        let scene = SceneText {
            text: &flattened.text,
            base: &flattened.base,
        };
        let Some(started) = live else {
            return Err("Mitsuba was not started".to_owned());
        };
        let rendered = started
            .driver()
            .and_then(|driver| driver.render(scene, &out, Setting::default(), 0));
        let rendered = match rendered {
            Ok(rendered) => rendered,
            Err(error) => {
                // The next request starts another one.
                *live = None;
                return Err(error.to_string());
            }
        };
        let image = exr_io::read(&out, Limits::IMAGE).map_err(|error| error.to_string())?;
        Ok(Reference::Ready {
            image: Arc::new(image),
            source: format!("{}, live, {:.1} s", Renderer::MITSUBA, rendered.seconds.trace),
            key,
        })
    }
}

/// The pixels of an image.
pub(crate) fn pixels(image: &Image) -> Result<Vec<[f32; 3]>, String> {
    let planes = image.rgb().map_err(|error| error.to_string())?;
    let pixel = |index| planes.map(|plane| plane[index]);
    Ok((0..image.pixel_count()).map(pixel).collect())
}

/// The difference of each pixel, as three planes of 32-bit floats: the relative residual and the
/// difference, of the channel in which they are largest, and FLIP.
pub(crate) fn errors(
    [width, height]: [u32; 2],
    ours: &[[f32; 3]],
    reference: &Image,
) -> Result<Vec<u8>, String> {
    let problem = |error: &dyn std::fmt::Display| error.to_string();
    let ours = Image::from_rgb(width as usize, height as usize, ours).map_err(|error| problem(&error))?;
    let mean = mean_reference(reference).map_err(|error| problem(&error))?;
    if [ours.width(), ours.height()] != [reference.width(), reference.height()] {
        return Err(format!(
            "the reference has {} x {} pixels, the picture {width} x {height}",
            reference.width(),
            reference.height()
        ));
    }
    // FLIP is not defined where a value is not finite.
    let seen = flip(&ours, reference).map_or_else(|_| vec![f64::NAN; ours.pixel_count()], |flip| flip.map);
    let [a, b] = [&ours, reference].map(Image::rgb);
    let (a, b) = (
        a.map_err(|error| problem(&error))?,
        b.map_err(|error| problem(&error))?,
    );
    let count = ours.pixel_count();
    let largest = |of: &dyn Fn(f64, f64) -> f64, index: usize| {
        let values = [0, 1, 2].map(|channel| of(f64::from(a[channel][index]), f64::from(b[channel][index])));
        // NaN wins.
        let worse = |worst: f64, next: f64| if next.abs() <= worst.abs() { worst } else { next };
        values.into_iter().reduce(worse).unwrap_or_default() as f32
    };
    let relative = (0..count).map(|index| largest(&|a, b| relative_residual(a, b, mean), index));
    let absolute = (0..count).map(|index| largest(&|a, b| a - b, index));
    let planes = relative
        .chain(absolute)
        .chain(seen.into_iter().map(|value| value as f32));
    Ok(planes.flat_map(f32::to_le_bytes).collect())
}
