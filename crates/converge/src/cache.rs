//! What is finished is kept, so that a run that was broken off goes on where it stopped.

use crate::errors::Measured;
use crate::usage::Ticks;
use serde::{Deserialize, Serialize};
use std::cell::RefCell;
use std::collections::HashSet;
use std::path::PathBuf;
use whitstone_image::{Image, Limits, atomic, exr_io};

/// What is known of one configuration, perhaps not yet all of its times.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Record {
    /// Building the scene, in seconds.
    pub build_s: f64,
    /// Wall times of the rendering, in seconds, in the order in which they were taken.
    pub times: Vec<f64>,
    /// Processor times of all threads, beside the wall times.
    pub cpu: Vec<f64>,
    /// Rays traced in one rendering.
    pub rays: u64,
    /// Samples a pixel.
    pub samples: u32,
    /// Triangles and other primitives; of Mitsuba not known.
    pub primitives: Option<u64>,
    /// Bytes that building and rendering took at most, where the system tells.
    pub memory: Option<u64>,
    /// Processor time of the machine meanwhile.
    #[serde(default)]
    pub used: Ticks,
    /// How many repeats are enough.
    pub repeats: usize,
    /// How many the time that is allowed has room for.
    pub affordable: usize,
    /// Renderings in each of them.
    pub batch: u32,
    /// Beside the truth.
    pub errors: Measured,
}

impl Record {
    /// Whether nothing is left to be measured.
    pub fn is_complete(&self) -> bool {
        self.times.len() >= self.repeats
    }
}

/// A folder of records and of images that are taken for true.
#[derive(Debug)]
pub struct Cache {
    folder: PathBuf,
    /// Whether what an earlier run has left there is used.
    reuse: bool,
    /// What this run has kept.
    kept: RefCell<HashSet<String>>,
}

impl Cache {
    /// In a folder that is made when it is needed.
    pub fn new(folder: PathBuf, reuse: bool) -> Self {
        Self {
            folder,
            reuse,
            kept: RefCell::default(),
        }
    }

    fn is_used(&self, key: &str) -> bool {
        self.reuse || self.kept.borrow().contains(key)
    }

    /// A name for what all of these texts determine.
    pub fn key(parts: &[&str]) -> String {
        let mut hasher = blake3::Hasher::new();
        for part in parts {
            hasher
                .update(&(part.len() as u64).to_le_bytes())
                .update(part.as_bytes());
        }
        hasher.finalize().to_hex()[..24].to_owned()
    }

    /// What is known; a file that cannot be read is as good as none.
    pub fn record(&self, key: &str) -> Option<Record> {
        let bytes = std::fs::read(self.folder.join(format!("{key}.json"))).ok();
        bytes
            .filter(|_| self.is_used(key))
            .and_then(|bytes| serde_json::from_slice(&bytes).ok())
    }

    /// Keeps it.
    ///
    /// # Errors
    ///
    /// If it cannot be written.
    pub fn keep(&self, key: &str, record: &Record) -> Result<(), String> {
        let text = serde_json::to_vec(record).map_err(|error| error.to_string())?;
        self.make()?;
        let path = self.folder.join(format!("{key}.json"));
        atomic::write_bytes(path, &text).map_err(|error| error.to_string())?;
        self.kept.borrow_mut().insert(key.to_owned());
        Ok(())
    }

    /// An image of an earlier run.
    pub fn image(&self, key: &str) -> Option<Image> {
        let path = self.folder.join(format!("{key}.exr"));
        let found = self.is_used(key) && path.is_file();
        exr_io::read(path, Limits::IMAGE).ok().filter(|_| found)
    }

    /// Keeps it.
    ///
    /// # Errors
    ///
    /// As [`Self::keep`].
    pub fn keep_image(&self, key: &str, image: &Image) -> Result<(), String> {
        self.make()?;
        let path = self.folder.join(format!("{key}.exr"));
        exr_io::write(path, image).map_err(|error| error.to_string())?;
        self.kept.borrow_mut().insert(key.to_owned());
        Ok(())
    }

    /// The folder, made if it is not there.
    ///
    /// # Errors
    ///
    /// If it cannot be made.
    pub fn make(&self) -> Result<&std::path::Path, String> {
        std::fs::create_dir_all(&self.folder)
            .map_err(|error| format!("{}: {error}", self.folder.display()))?;
        Ok(&self.folder)
    }
}
