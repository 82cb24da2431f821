//! Cache of finished measurements, so that an interrupted run continues where it stopped.

use crate::errors::Measured;
use crate::usage::Ticks;
use serde::{Deserialize, Serialize};
use std::cell::RefCell;
use std::collections::HashSet;
use std::path::PathBuf;
use whitstone_image::{Image, Limits, atomic, exr_io};
use whitstone_validate::hashed;

/// The measurements of one configuration; some times may still be missing.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Record {
    /// Time to build the scene, in seconds.
    pub build_s: f64,
    /// Wall-clock times of the rendering, in seconds, in the order of measurement.
    pub times: Vec<f64>,
    /// Processor times of all threads, in seconds, one for each wall-clock time.
    pub cpu: Vec<f64>,
    /// Rays traced in one rendering.
    pub rays: u64,
    /// Samples per pixel.
    pub samples: u32,
    /// Number of triangles and other primitives; unknown for Mitsuba.
    pub primitives: Option<u64>,
    /// Peak memory of building and rendering in bytes, if the system reports it.
    pub memory: Option<u64>,
    /// Processor time of the machine during the measurements.
    #[serde(default)]
    pub used: Ticks,
    /// Number of repeats that are needed.
    pub repeats: usize,
    /// Number of repeats that fit in the time budget.
    pub affordable: usize,
    /// Renderings per repeat.
    pub batch: u32,
    /// Errors compared with the truth.
    pub errors: Measured,
}

impl Record {
    /// Whether all repeats have been measured.
    pub fn is_complete(&self) -> bool {
        self.times.len() >= self.repeats
    }
}

/// A folder of records and truth images.
#[derive(Debug)]
pub struct Cache {
    folder: PathBuf,
    /// Whether results of earlier runs are used.
    reuse: bool,
    /// Keys that this run has written.
    kept: RefCell<HashSet<String>>,
}

impl Cache {
    /// A cache in this folder, which is created when it is needed.
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

    /// A key that identifies the combination of these texts.
    pub fn key(parts: &[&str]) -> String {
        let mut hasher = blake3::Hasher::new();
        for part in parts {
            hasher
                .update(&(part.len() as u64).to_le_bytes())
                .update(part.as_bytes());
        }
        hasher.finalize().to_hex()[..24].to_owned()
    }

    /// The record that this run has stored.
    pub fn record_of_this_run(&self, key: &str) -> Option<Record> {
        self.record(key).filter(|_| self.kept.borrow().contains(key))
    }

    /// The stored record; a file that cannot be read or is damaged counts as missing.
    pub fn record(&self, key: &str) -> Option<Record> {
        let bytes = std::fs::read(self.folder.join(format!("{key}.json"))).ok();
        bytes
            .filter(|_| self.is_used(key))
            .and_then(|bytes| hashed::from_bytes(&bytes))
    }

    /// Stores a record.
    ///
    /// # Errors
    ///
    /// If it cannot be written.
    pub fn keep(&self, key: &str, record: &Record) -> Result<(), String> {
        let text = hashed::to_bytes(record).map_err(|error| error.to_string())?;
        self.make()?;
        let path = self.folder.join(format!("{key}.json"));
        atomic::write_bytes(path, &text).map_err(|error| error.to_string())?;
        self.kept.borrow_mut().insert(key.to_owned());
        Ok(())
    }

    /// The stored image.
    pub fn image(&self, key: &str) -> Option<Image> {
        let path = self.folder.join(format!("{key}.exr"));
        let found = self.is_used(key) && path.is_file();
        exr_io::read(path, Limits::IMAGE).ok().filter(|_| found)
    }

    /// Stores an image.
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

    /// The folder, created if it does not exist.
    ///
    /// # Errors
    ///
    /// If it cannot be created.
    pub fn make(&self) -> Result<&std::path::Path, String> {
        std::fs::create_dir_all(&self.folder)
            .map_err(|error| format!("{}: {error}", self.folder.display()))?;
        Ok(&self.folder)
    }
}
