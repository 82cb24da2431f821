//! The renderer: loads the scene, and makes pictures of it that become better.

use crate::heat::{self, Shown};
use crate::scene::{Aspect, Loaded, Origin, Version};
use crate::state::{Frame, Reference, Shared, Wish, key};
use half::f16;
use half::slice::HalfFloatSliceExt as _;
use serde_json::{Value, json};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};
use whitstone_core::Registry;
use whitstone_render::{FilmError, Region, RenderOptions};
use whitstone_validate::stored::Stored;
use whitstone_validate::{Renderer as ReferenceRenderer, stored_folder};

/// Wall time that the first picture after a change may take, in seconds. The page gets it, draws it
/// and sends the next change in the rest of a tenth of a second.
const FIRST: f64 = 0.05;

/// Pictures that take longer are shown in parts, in seconds.
const IN_PARTS: f64 = 0.4;

/// Wall time of a part, in seconds.
const PART: f64 = 0.2;

/// Wall time of a sample of a pixel before any is measured, in seconds.
const UNKNOWN: f64 = 5e-7;

/// Divisors of the size of previews.
const DIVISORS: [u32; 4] = [1, 2, 4, 8];

/// The folder of the scenes, which stored references are named after.
const SCENES: &str = "scenes";

/// Largest finite half float.
const LARGEST: f32 = 65504.0;

pub(crate) struct Renderer<'a> {
    shared: &'a Shared,
    registry: &'a Registry,
    origin: &'a Origin,
    references: &'a Path,
    /// Contents of files, until one changes.
    contents: (u64, Arc<whitstone_render::Shared>),
    /// A version that cannot be built.
    failed: Option<Version>,
    /// Wall time of a sample of a pixel, in seconds, for each kind of picture.
    costs: [f64; 4],
    /// The number of the wish whose pictures are made, and how many of them are finished.
    made: (u64, usize),
    /// The version for which a stored reference was looked for.
    looked_for: Option<Version>,
    /// Reports problems to the terminal.
    say: &'a (dyn Fn(&str) + Sync),
}

/// Whether the wish is fulfilled.
#[derive(PartialEq, Eq)]
enum Outcome {
    Fulfilled,
    /// There is another wish, or another thread needed the scene.
    Interrupted,
}

impl<'a> Renderer<'a> {
    pub(crate) fn new(
        shared: &'a Shared,
        registry: &'a Registry,
        origin: &'a Origin,
        references: &'a Path,
        say: &'a (dyn Fn(&str) + Sync),
    ) -> Self {
        Self {
            shared,
            registry,
            origin,
            references,
            contents: Default::default(),
            failed: None,
            costs: [UNKNOWN; 4],
            made: (0, 0),
            looked_for: None,
            say,
        }
    }

    /// Fulfils wishes until the view ends.
    pub(crate) fn run(&mut self) {
        let mut fulfilled = None;
        loop {
            let (wish, number) = {
                let state = self
                    .shared
                    .wait(Duration::MAX, |state| fulfilled != Some(state.wishes));
                if state.ended {
                    return;
                }
                (state.wish.clone(), state.wishes)
            };
            if self.fulfil(&wish, number) == Outcome::Fulfilled {
                fulfilled = Some(number);
            }
        }
    }

    fn fulfil(&mut self, wish: &Wish, number: u64) -> Outcome {
        if self.made.0 != number {
            self.made = (number, 0);
        }
        if !self.load(wish) {
            return Outcome::Fulfilled;
        }
        let aspect = |scene: &Loaded, divisor, preview| Aspect {
            look_at: wish.look_at.filter(|_| !scene.depends_on_camera),
            divisor,
            preview,
        };
        let stages = {
            let scene = self.shared.scene();
            let Some(scene) = &*scene else {
                return Outcome::Fulfilled;
            };
            if wish.shown != Shown::Picture && !heat::is_counted(&scene.pipeline, wish.shown) {
                let kind = scene.pipeline.accelerator.0.clone();
                self.shared.change(|state| {
                    state.remark = Some(format!("the accelerator \"{kind}\" counts no traversal steps"));
                    state.news += 1;
                });
                return Outcome::Fulfilled;
            }
            self.stages(scene, wish.shown)
        };
        self.shared.change(|state| {
            if state.remark.take().is_some() {
                state.news += 1;
            }
        });
        for (index, &(divisor, preview)) in stages.iter().enumerate().skip(self.made.1) {
            let mut scene = self.shared.scene();
            let Some(scene) = scene.as_mut() else {
                return Outcome::Fulfilled;
            };
            let aspect = aspect(scene, divisor, preview);
            let refuse = |problem: String| {
                self.shared.change(|state| {
                    state.remark = Some(format!("this view is not possible: {problem}"));
                    state.news += 1;
                });
                Outcome::Fulfilled
            };
            if let Err(problem) = scene.prepare(aspect, &[], self.registry) {
                return refuse(problem);
            }
            // A first picture is finished, so that there are pictures while the camera moves.
            let first = index == 0;
            let is_final = index + 1 == stages.len();
            match self.picture(scene, wish, number, (aspect, first, is_final)) {
                Ok(true) => {}
                Ok(false) => return Outcome::Interrupted,
                Err(error) => return refuse(error.to_string()),
            }
            self.made.1 = index + 1;
            if self.shared.state().wishes != number {
                return Outcome::Interrupted;
            }
        }
        self.find_stored(wish);
        Outcome::Fulfilled
    }

    /// Builds the scene if the wish needs another version. Returns whether there is a scene to
    /// show.
    fn load(&mut self, wish: &Wish) -> bool {
        let mut depends = self
            .shared
            .scene()
            .as_ref()
            .is_some_and(|scene| scene.depends_on_camera);
        // Twice if only the build shows that it depends on the camera.
        for _ in 0..2 {
            let version = wish.version(depends);
            let scene = self.shared.scene();
            if scene.as_ref().is_some_and(|scene| scene.version == version) {
                drop(scene);
                // Those of another accelerator or view, which is no longer wanted.
                self.shared.change(|state| {
                    if !state.problems.is_empty() {
                        state.problems.clear();
                        state.news += 1;
                    }
                });
                return true;
            }
            drop(scene);
            if self.failed.as_ref() == Some(&version) {
                return false;
            }
            if self.contents.0 != version.files {
                self.contents = (version.files, Arc::default());
            }
            let read_at = Some(SystemTime::now());
            match self.origin.load(version.clone(), self.registry, &self.contents.1) {
                Ok(scene) => {
                    self.failed = None;
                    depends = scene.depends_on_camera;
                    let facts = scene_facts(&scene, self.registry);
                    let (files, warnings) = (scene.files.clone(), scene.warnings.clone());
                    let previous = self.shared.scene().replace(scene);
                    self.shared.change(|state| {
                        state.scene = facts;
                        state.watched = files;
                        state.read_at = read_at;
                        state.problems = Vec::new();
                        state.news += 1;
                    });
                    let known = previous.map(|scene| scene.warnings).unwrap_or_default();
                    for warning in warnings.iter().filter(|warning| !known.contains(warning)) {
                        (self.say)(&format!("warning: {}: {}", warning.place, warning.message));
                    }
                }
                Err(failed) => {
                    (self.say)(&failed.report);
                    self.failed = Some(version);
                    self.shared.change(|state| {
                        state.problems = failed.problems;
                        state.read_at = read_at;
                        for file in failed.files {
                            if !state.watched.contains(&file) {
                                state.watched.push(file);
                            }
                        }
                        state.news += 1;
                    });
                    return false;
                }
            }
        }
        true
    }

    /// The pictures to make, one after the other: divisor of the size, and whether one sample of
    /// each pixel is enough. The last is the picture that `render` writes.
    fn stages(&self, scene: &Loaded, shown: Shown) -> Vec<(u32, bool)> {
        if !scene.can_shrink() {
            return vec![(1, false)];
        }
        let previews = scene.has_previews();
        let samples = match previews {
            true => scene.pipeline.camera.lens_points(),
            false => scene.own_samples(),
        };
        let samples = if matches!(shown, Shown::Steps | Shown::Tests) {
            1
        } else {
            samples
        };
        let time = |divisor: u32| {
            let size = scene.size_at(divisor);
            self.costs[shown as usize] * f64::from(size.width) * f64::from(size.height) * f64::from(samples)
        };
        let fits = DIVISORS.into_iter().find(|&divisor| time(divisor) <= FIRST);
        let first = fits.unwrap_or(DIVISORS[DIVISORS.len() - 1]);
        let mut stages = vec![(first, previews)];
        if first > 2 && time(1) > IN_PARTS {
            stages.push((2, previews));
        }
        if first > 1 {
            stages.push((1, previews));
        }
        // These maps do not depend on samples.
        if previews && !matches!(shown, Shown::Steps | Shown::Tests) {
            stages.push((1, false));
        }
        stages
    }

    /// Makes a picture of the scene, which is prepared for it. Returns whether it is finished.
    fn picture(
        &mut self,
        scene: &Loaded,
        wish: &Wish,
        number: u64,
        (aspect, first, is_final): (Aspect, bool, bool),
    ) -> Result<bool, FilmError> {
        let start = Instant::now();
        let size = scene.pipeline.film.size;
        let samples = match wish.shown {
            Shown::Steps | Shown::Tests => 1,
            Shown::Picture | Shown::Rays => scene.pipeline.samples(),
        };
        let go_on = || {
            let state = self.shared.state();
            let same = state.wishes == number || (first && state.wish.files == wish.files);
            same && !state.ended && !self.shared.is_wanted()
        };
        let facts = |rays: Option<u64>| {
            json!({
                "shown": wish.shown,
                "width": size.width,
                "height": size.height,
                "full": [scene.size.width, scene.size.height],
                "samples": samples,
                "is_final": is_final,
                "rays": rays,
                "milliseconds": start.elapsed().as_secs_f64() * 1e3,
                "look_at": wish.look_at.or(scene.look_at),
                "key": key(scene, &Aspect { look_at: wish.look_at, ..aspect }),
            })
        };
        let key = key(
            scene,
            &Aspect {
                look_at: wish.look_at,
                ..aspect
            },
        );
        let side = [size.width, size.height];
        if wish.shown != Shown::Picture {
            let Some(numbers) = heat::numbers(&scene.pipeline, wish.shown, &go_on) else {
                return Ok(false);
            };
            self.measure(wish.shown, start, numbers.len(), samples);
            let bytes = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
            self.publish(Frame {
                facts: facts(None),
                bytes,
                size: side,
                rgb: Vec::new(),
                is_final: false,
                key,
            });
            return Ok(true);
        }
        let pixels = size.width as usize * size.height as usize;
        let expected = self.costs[0] * pixels as f64 * f64::from(samples);
        let parts = if expected > IN_PARTS {
            (expected / PART).ceil() as u32
        } else {
            1
        };
        // Whole rows of tiles, so that no tile is cut.
        let rows = size.height.div_ceil(parts).next_multiple_of(16);
        let mut rgb = self.enlarged(wish, number, side);
        let mut rays = 0;
        for y in (0..size.height).step_by(rows as usize) {
            let region = Region {
                x: 0,
                y,
                width: size.width,
                height: rows.min(size.height - y),
            };
            let film = scene.pipeline.render(RenderOptions {
                region: Some(region),
                progress: Some(&|_, _| match go_on() {
                    true => ControlFlow::Continue(()),
                    false => ControlFlow::Break(()),
                }),
                ..RenderOptions::default()
            });
            film.check()?;
            if !film.is_complete {
                return Ok(false);
            }
            rays += film.counters.total();
            let from = y as usize * size.width as usize;
            rgb[from..from + film.rgb.len()].copy_from_slice(&film.rgb);
            let is_last = y + region.height == size.height;
            if is_last {
                self.measure(Shown::Picture, start, pixels, samples);
            }
            let mut facts = facts(Some(rays));
            facts["is_final"] = (is_final && is_last).into();
            facts["is_part"] = (!is_last).into();
            self.publish(Frame {
                facts,
                bytes: halves(&rgb),
                size: side,
                rgb: rgb.clone(),
                is_final: is_final && is_last,
                key: key.clone(),
            });
        }
        Ok(true)
    }

    /// The pixels of the last picture of this wish in another size, to start from; black if there
    /// is none.
    fn enlarged(&self, wish: &Wish, number: u64, [width, height]: [u32; 2]) -> Vec<[f32; 3]> {
        let frame = self.shared.state().frame.clone();
        let black = || vec![[0.0; 3]; width as usize * height as usize];
        let Some(frame) = frame.filter(|frame| !frame.rgb.is_empty() && self.made.0 == number) else {
            return black();
        };
        if self.made.1 == 0 || wish.shown != Shown::Picture {
            return black();
        }
        let [from_width, from_height] = frame.size;
        let place = |to: u32, to_side: u32, side: u32| {
            (u64::from(to) * u64::from(side) / u64::from(to_side)) as usize
        };
        let pixel = |x: u32, y: u32| {
            let row = place(y, height, from_height) * from_width as usize;
            frame.rgb[row + place(x, width, from_width)]
        };
        (0..height)
            .flat_map(|y| (0..width).map(move |x| pixel(x, y)))
            .collect()
    }

    fn measure(&mut self, shown: Shown, start: Instant, pixels: usize, samples: u32) {
        let cost = start.elapsed().as_secs_f64() / (pixels as f64 * f64::from(samples)).max(1.0);
        // Small pictures have more overhead than work.
        if pixels >= 1024 {
            self.costs[shown as usize] = cost;
        }
    }

    fn publish(&self, frame: Frame) {
        self.shared.change(|state| {
            state.frame = Some(Arc::new(frame));
            state.frame_number += 1;
            state.news += 1;
        });
    }

    /// Looks for a stored reference of the picture, once for each version of the scene.
    fn find_stored(&mut self, wish: &Wish) {
        let found = {
            let scene = self.shared.scene();
            let Some(scene) = scene.as_ref().filter(|_| wish.look_at.is_none()) else {
                return;
            };
            if self.looked_for.as_ref() == Some(&scene.version) {
                return;
            }
            self.looked_for = Some(scene.version.clone());
            let folder: PathBuf = stored_folder(&self.origin.path, Path::new(SCENES), self.references);
            let key = key(
                scene,
                &Aspect {
                    look_at: None,
                    divisor: 1,
                    preview: false,
                },
            );
            let stored = Stored::read(&folder, ReferenceRenderer::MITSUBA, &scene.flattened.hash);
            stored.ok().map(|stored| (stored, key))
        };
        if let Some((stored, key)) = found {
            self.shared.change(|state| {
                state.reference = Reference::Ready {
                    image: Arc::new(stored.image),
                    source: format!("{} {}, stored", ReferenceRenderer::MITSUBA, stored.meta.version),
                    key,
                };
                state.news += 1;
            });
        }
    }
}

/// Half floats of all values, little-endian. Finite values stay finite.
pub(crate) fn halves(rgb: &[[f32; 3]]) -> Vec<u8> {
    let clamped: Vec<f32> = rgb
        .as_flattened()
        .iter()
        .map(|value| {
            if value.is_finite() {
                value.clamp(-LARGEST, LARGEST)
            } else {
                *value
            }
        })
        .collect();
    let mut halves = vec![f16::ZERO; clamped.len()];
    halves.convert_from_f32_slice(&clamped);
    halves.iter().flat_map(|half| half.to_le_bytes()).collect()
}

/// The facts about a scene that the page shows.
fn scene_facts(scene: &Loaded, registry: &Registry) -> Value {
    let (kind, reason) = &scene.pipeline.accelerator;
    let known = registry
        .entries()
        .filter(|entry| entry.family == whitstone_core::FamilyName::Accelerator)
        .map(|entry| entry.name);
    json!({
        "width": scene.size.width,
        "height": scene.size.height,
        "samples": scene.own_samples(),
        "look_at": scene.look_at,
        "accelerator": kind,
        "reason": reason,
        "statistics": scene.pipeline.scene.accelerator.statistics(),
        "accelerators": known.collect::<Vec<_>>(),
        "build_milliseconds": scene.seconds * 1e3,
        "warnings": scene.warnings,
        "shapes": scene.shapes.len(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_keep_finite_values_finite() {
        let bytes = halves(&[[1.0, 1e30, -1e30], [f32::NAN, f32::INFINITY, 0.5]]);
        let values: Vec<f32> = bytes
            .chunks_exact(2)
            .map(|pair| f16::from_le_bytes([pair[0], pair[1]]).to_f32())
            .collect();
        assert_eq!(values[..3], [1.0, LARGEST, -LARGEST]);
        assert!(values[3].is_nan() && values[4].is_infinite() && values[5] == 0.5);
    }
}
