//! What the threads of the view share: the picture that is wanted, and the one that there is.

use crate::camera::LookAt;
use crate::heat::Shown;
use crate::scene::{Aspect, Loaded, Problem, Version};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};
use whitstone_image::Image;

/// A page that has not asked for anything for this long is gone.
const PAGE_GONE: Duration = Duration::from_secs(12);

/// What the page wants to see.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Wish {
    /// The camera's view, if it is not the scene's own.
    pub(crate) look_at: Option<LookAt>,
    /// The accelerator, if it is not the scene's own.
    pub(crate) accelerator: Option<String>,
    /// What is shown of each pixel.
    pub(crate) shown: Shown,
    /// Increases whenever a file has changed.
    pub(crate) files: u64,
}

impl Wish {
    /// The version of the scene that it needs, if the build depends on the camera or does not.
    pub(crate) fn version(&self, depends_on_camera: bool) -> Version {
        Version {
            files: self.files,
            accelerator: self.accelerator.clone(),
            look_at: self.look_at.filter(|_| depends_on_camera),
        }
    }
}

/// A picture for the page.
#[derive(Default)]
pub(crate) struct Frame {
    /// Facts about it, as JSON.
    pub(crate) facts: Value,
    /// Half floats of R, G, B of each pixel, or 32-bit floats of a heat map.
    pub(crate) bytes: Vec<u8>,
    pub(crate) size: [u32; 2],
    /// The radiance, empty in a heat map.
    pub(crate) rgb: Vec<[f32; 3]>,
    /// Whether it equals the picture that `render` writes.
    pub(crate) is_final: bool,
    /// What it shows: see [`State::key`].
    pub(crate) key: String,
}

/// The image of the reference renderer.
#[derive(Clone, Default)]
pub(crate) enum Reference {
    /// There is none yet.
    #[default]
    None,
    /// The renderer is at work; with what it is doing.
    Working(String),
    /// It could not be rendered, and why.
    Failed(String),
    /// It is there.
    Ready {
        image: Arc<Image>,
        /// The renderer, and whether the image was stored.
        source: String,
        /// The picture that it is the reference of.
        key: String,
    },
}

/// The state of the view.
#[derive(Default)]
pub(crate) struct State {
    pub(crate) wish: Wish,
    /// Increases with every change of the wish.
    pub(crate) wishes: u64,
    pub(crate) frame: Option<Arc<Frame>>,
    /// The number of the frame.
    pub(crate) frame_number: u64,
    /// Increases with every change that the page must know.
    pub(crate) news: u64,
    pub(crate) problems: Vec<Problem>,
    /// Facts about the scene, as JSON.
    pub(crate) scene: Value,
    pub(crate) reference: Reference,
    /// Whether a live reference of the wish is wanted.
    pub(crate) asks_for_reference: bool,
    /// A remark on what is shown, such as a map that does not exist.
    pub(crate) remark: Option<String>,
    /// A remark on tev.
    pub(crate) tev: Option<String>,
    /// The files whose changes matter.
    pub(crate) watched: Vec<PathBuf>,
    /// When they began to be read.
    pub(crate) read_at: Option<SystemTime>,
    /// The page that is served, and when it asked last.
    page: Option<(u64, Instant)>,
    pages: u64,
    pub(crate) ended: bool,
}

impl State {
    /// Changes the wish, which makes the renderer start again.
    pub(crate) fn wish(&mut self, change: impl FnOnce(&mut Wish)) {
        let before = self.wish.clone();
        change(&mut self.wish);
        if self.wish != before {
            self.wishes += 1;
        }
    }

    /// The facts that the page shows, without those of a frame.
    pub(crate) fn facts(&self) -> Value {
        let (state, message) = match &self.reference {
            Reference::None => ("none", String::new()),
            Reference::Working(what) => ("working", what.clone()),
            Reference::Failed(why) => ("failed", why.clone()),
            Reference::Ready { source, .. } => ("ready", source.clone()),
        };
        let key = match &self.reference {
            Reference::Ready { key, .. } => Some(key),
            _ => None,
        };
        json!({
            "news": self.news,
            "scene": self.scene,
            "problems": self.problems,
            "remark": self.remark,
            "tev": self.tev,
            "wish": { "look_at": self.wish.look_at, "accelerator": self.wish.accelerator, "shown": self.wish.shown },
            "reference": { "state": state, "message": message, "key": key },
        })
    }

    /// Opens a page: the only one at a time. Returns its number, or `None` if there is another one
    /// and the new one does not take over.
    pub(crate) fn open(&mut self, takes_over: bool) -> Option<u64> {
        let other = self.page.is_some_and(|(_, seen)| seen.elapsed() < PAGE_GONE);
        if other && !takes_over {
            return None;
        }
        self.pages += 1;
        self.page = Some((self.pages, Instant::now()));
        self.news += 1;
        Some(self.pages)
    }

    /// Whether this page is the one that is served; it then counts as seen.
    pub(crate) fn see(&mut self, page: u64) -> bool {
        match &mut self.page {
            Some((number, seen)) if *number == page => {
                *seen = Instant::now();
                true
            }
            _ => false,
        }
    }

    /// Closes a page.
    pub(crate) fn close(&mut self, page: u64) {
        if self.page.is_some_and(|(number, _)| number == page) {
            self.page = None;
        }
    }
}

/// The state, its changes, and the scene.
#[derive(Default)]
pub(crate) struct Shared {
    state: Mutex<State>,
    changed: Condvar,
    scene: Mutex<Option<Loaded>>,
    /// How many others than the renderer wait for the scene.
    waiting: AtomicUsize,
}

impl Shared {
    pub(crate) fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the state and wakes all that wait for it.
    pub(crate) fn change<T>(&self, change: impl FnOnce(&mut State) -> T) -> T {
        let result = change(&mut self.state());
        self.changed.notify_all();
        result
    }

    /// Waits until a condition holds, or for a time; returns the state.
    pub(crate) fn wait(&self, limit: Duration, holds: impl Fn(&State) -> bool) -> MutexGuard<'_, State> {
        let result = self
            .changed
            .wait_timeout_while(self.state(), limit, |state| !holds(state) && !state.ended);
        result.unwrap_or_else(PoisonError::into_inner).0
    }

    /// Whether the renderer should give the scene away.
    pub(crate) fn is_wanted(&self) -> bool {
        self.waiting.load(Ordering::SeqCst) > 0
    }

    /// The scene, for the renderer.
    pub(crate) fn scene(&self) -> MutexGuard<'_, Option<Loaded>> {
        // It waits until the others have what they want, because a lock is not fair.
        while self.is_wanted() {
            std::thread::sleep(Duration::from_millis(1));
        }
        self.scene.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Calls `work` with the scene while the renderer waits. `None` if there is no scene.
    pub(crate) fn with_scene<T>(&self, work: impl FnOnce(&mut Loaded) -> T) -> Option<T> {
        self.waiting.fetch_add(1, Ordering::SeqCst);
        let mut scene = self.scene.lock().unwrap_or_else(PoisonError::into_inner);
        let result = scene.as_mut().map(work);
        drop(scene);
        self.waiting.fetch_sub(1, Ordering::SeqCst);
        result
    }
}

/// The picture of a scene with a view: two pictures with one key are equal.
pub(crate) fn key(scene: &Loaded, aspect: &Aspect) -> String {
    let view = aspect.look_at.or(scene.look_at);
    format!(
        "{} {}",
        scene.version.files,
        view.map_or_else(String::new, |view| view.to_toml().to_string())
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_page_is_served_at_a_time() {
        let mut state = State::default();
        let first = state.open(false).unwrap();
        assert_eq!(state.open(false), None);
        assert!(state.see(first));
        let second = state.open(true).unwrap();
        assert!(!state.see(first) && state.see(second));
        state.close(first);
        assert_eq!(state.open(false), None, "a page can close only itself");
        state.close(second);
        assert!(state.open(false).is_some());
    }

    #[test]
    fn only_another_wish_starts_the_renderer_again() {
        let mut state = State::default();
        state.wish(|wish| wish.accelerator = None);
        assert_eq!(state.wishes, 0);
        state.wish(|wish| wish.accelerator = Some("bvh".to_owned()));
        assert_eq!(state.wishes, 1);
    }
}
