//! `--review`: approval of each image on a page that is served locally.

use super::accept::{acceptable, write};
use super::{Arguments, Files, page};
use crate::interrupt;
use crate::terminal::Failure;
use clap::Args;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use whitstone_image::atomic;
use whitstone_validate::counted;
use whitstone_validate::report::{ReviewRow, review_page};
use whitstone_view::{Pairs, Review, Standing};

/// The arguments of a review.
#[derive(Args, Debug)]
pub(super) struct ReviewArguments {
    /// Serve a page on which images that differ can be looked at and accepted one by one, until
    /// its button "Done" or Ctrl-C. Only the reference next to a pressed button is written. The
    /// exit code is that of the images that were not accepted. No page is served if nothing differs
    #[arg(long, conflicts_with = "accept")]
    review: bool,
    /// Port of the page of --review on 127.0.0.1; 0 means any free one
    #[arg(long, value_name = "PORT", default_value_t = 0, requires = "review")]
    port: u16,
}

impl ReviewArguments {
    /// Whether a review was requested.
    pub(super) fn is_wanted(&self) -> bool {
        self.review
    }
}

/// A hash of the contents of a file; `None` if it cannot be read.
type Fingerprint = Option<blake3::Hash>;

fn fingerprint(path: &Path) -> Fingerprint {
    let mut hasher = blake3::Hasher::new();
    let mut file = std::fs::File::open(path).ok()?;
    std::io::copy(&mut file, &mut hasher).ok()?;
    Some(hasher.finalize())
}

/// What the two files of a pair contained when they were compared.
#[derive(Clone, Copy, Default, PartialEq)]
pub(super) struct Seen {
    ours: Fingerprint,
    reference: Fingerprint,
}

impl Seen {
    /// To be called before the files are compared, so that a later change is noticed.
    pub(super) fn of(ours: &Path, reference: &Path) -> Self {
        Self {
            ours: fingerprint(ours),
            reference: fingerprint(reference),
        }
    }
}

/// A pair of the review.
pub(super) struct Item<'a> {
    pub(super) name: &'a str,
    pub(super) files: Files,
    /// The contents of ours and of the first reference.
    pub(super) seen: Seen,
    /// Whether there is a comparison.
    pub(super) comparable: bool,
    /// Each limit that is exceeded, or why there is no comparison.
    pub(super) problems: Vec<String>,
}

impl Item<'_> {
    fn passes(&self) -> bool {
        self.comparable && self.problems.is_empty()
    }

    /// The file that accepting writes; none if there is nothing to accept.
    fn target(&self) -> Option<&Path> {
        let differs = !self.passes() && self.seen.ours.is_some();
        differs.then(|| self.files.reference())
    }
}

/// How an accepted reference is restored.
struct Undo {
    /// Its contents before; `None` if it did not exist.
    before: Option<Vec<u8>>,
    /// Folders that were created for it, the innermost first.
    created: Vec<PathBuf>,
}

struct Session<'a> {
    arguments: &'a Arguments,
    items: &'a [Item<'a>],
    /// By item; present if it was accepted.
    accepted: Mutex<Vec<Option<Undo>>>,
}

/// Serves the page, and returns which of the items were accepted.
pub(super) fn run(arguments: &Arguments, items: &[Item<'_>]) -> Result<Vec<bool>, Failure> {
    let session = Session {
        arguments,
        items,
        accepted: Mutex::new(items.iter().map(|_| None).collect()),
    };
    if items.iter().all(Item::passes) {
        println!("nothing to review");
        return Ok(vec![false; items.len()]);
    }
    let _watching = interrupt::Watching::new();
    let review = Review::open(arguments.review.port).map_err(Failure::environment)?;
    println!("{}", review.url());
    eprintln!(
        "open this address in a browser on this machine; its button \"Done\" or Ctrl-C ends the review"
    );
    review
        .run(&session, interrupt::stop())
        .map_err(Failure::environment)?;
    let accepted: Vec<bool> = session.accepted().iter().map(Option::is_some).collect();
    let count = accepted.iter().filter(|accepted| **accepted).count();
    println!(
        "review ended: {} accepted, {} left",
        counted(count, "image"),
        session.standing(0, &session.accepted()).left
    );
    Ok(accepted)
}

impl Session<'_> {
    fn accepted(&self) -> MutexGuard<'_, Vec<Option<Undo>>> {
        self.accepted.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn standing(&self, pair: usize, accepted: &[Option<Undo>]) -> Standing {
        let is_right = |index: usize| self.items[index].passes() || accepted[index].is_some();
        Standing {
            word: match (accepted[pair].is_some(), &self.items[pair]) {
                (true, _) => "accepted",
                (false, item) if item.passes() => "pass",
                (false, item) if item.comparable => "differs",
                (false, _) => "not comparable",
            },
            is_right: is_right(pair),
            left: (0..self.items.len()).filter(|&index| !is_right(index)).count(),
        }
    }

    fn put(&self, pair: usize) -> Result<Undo, String> {
        let item = &self.items[pair];
        let target = item.target().ok_or("there is nothing to accept")?;
        let ours = &item.files.ours;
        let changed = |path: &Path| {
            format!(
                "{} has changed since it was compared; run the command again",
                path.display()
            )
        };
        let bytes = acceptable(ours, target).map_err(Failure::problem)?;
        if Some(blake3::hash(&bytes)) != item.seen.ours {
            return Err(changed(ours));
        }
        let before = match std::fs::read(target) {
            Ok(bytes) => Some(bytes),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
            Err(error) => return Err(format!("{}: {error}", target.display())),
        };
        if before.as_deref().map(blake3::hash) != item.seen.reference {
            return Err(changed(target));
        }
        let created = write(target, &bytes).map_err(Failure::problem)?;
        println!(
            "accepted: {} now has the contents of {}",
            target.display(),
            ours.display()
        );
        Ok(Undo { before, created })
    }

    fn restore(&self, pair: usize, undo: &Undo) -> Result<(), String> {
        let item = &self.items[pair];
        let target = item.files.reference();
        if fingerprint(target) != item.seen.ours {
            return Err(format!(
                "{} has changed since it was accepted; it stays as it is",
                target.display()
            ));
        }
        if let Some(bytes) = &undo.before {
            atomic::write_bytes(target, bytes).map_err(|error| error.to_string())?;
            println!("undone: {} has its former contents", target.display());
        } else {
            std::fs::remove_file(target).map_err(|error| format!("{}: {error}", target.display()))?;
            // Folders that are used for something else by now stay.
            let _ = undo.created.iter().try_for_each(std::fs::remove_dir);
            println!("undone: {} is removed", target.display());
        }
        Ok(())
    }
}

impl Pairs for Session<'_> {
    fn count(&self) -> usize {
        self.items.len()
    }

    fn page(&self, nonce: &str) -> String {
        let accepted = self.accepted();
        let row = |(pair, item)| {
            let standing = self.standing(pair, &accepted);
            let item: &Item<'_> = item;
            ReviewRow {
                name: item.name,
                word: standing.word,
                is_right: standing.is_right,
                problems: &item.problems,
                writes: item.target().map(|path| path.display().to_string()),
                accepted: accepted[pair].is_some(),
                details: "",
            }
        };
        let rows: Vec<ReviewRow<'_>> = self.items.iter().enumerate().map(row).collect();
        review_page(&page::title(self.arguments), &rows, nonce)
    }

    fn details(&self, pair: usize) -> String {
        let item = &self.items[pair];
        let mut notes = Vec::new();
        // An accepted reference has changed on purpose.
        let accepted = self.accepted()[pair].is_some();
        if accepted {
            notes.push("The reference was accepted; undo it to see the former one.".to_owned());
        } else if Seen::of(&item.files.ours, item.files.reference()) != item.seen {
            notes.push("The files have changed since they were compared; run the command again.".to_owned());
        }
        let compared = item.files.compare(self.arguments).ok();
        page::details(self.arguments, &item.files, compared.as_ref(), notes)
    }

    fn accept(&self, pair: usize) -> Result<Standing, String> {
        let mut accepted = self.accepted();
        if accepted[pair].is_none() {
            accepted[pair] = Some(self.put(pair)?);
        }
        Ok(self.standing(pair, &accepted))
    }

    fn undo(&self, pair: usize) -> Result<Standing, String> {
        let mut accepted = self.accepted();
        let undo = accepted[pair].as_ref().ok_or("it was not accepted")?;
        self.restore(pair, undo)?;
        accepted[pair] = None;
        Ok(self.standing(pair, &accepted))
    }
}
