//! Makes images under test the references.

use super::{input, variants_of};
use crate::terminal::Failure;
use std::path::{Path, PathBuf};
use whitstone_image::planes::RGB;
use whitstone_image::{Transfer, atomic};
use whitstone_metrics::range::Ranges;

/// Replaces a reference by an image under test, atomically; creates it if it does not exist.
pub(super) fn accept(ours: &Path, reference: &Path) -> Result<(), Failure> {
    let bytes = acceptable(ours, reference)?;
    write(reference, &bytes)?;
    Ok(())
}

/// The contents of an image under test, if it may become the reference.
pub(super) fn acceptable(ours: &Path, reference: &Path) -> Result<Vec<u8>, Failure> {
    let refused = |why: String| Failure::usage(format!("{} is not accepted: {why}", ours.display()));
    let extension = |path: &Path| path.extension().map(|extension| extension.to_ascii_lowercase());
    if extension(ours) != extension(reference) {
        return Err(refused(format!("{} has another extension", reference.display())));
    }
    let image = input::read(ours, None, Transfer::Linear)?.linear();
    // Layers such as depth may be infinite.
    let colors = image.channels().filter(|(name, _)| RGB.contains(name));
    let not_finite = colors
        .flat_map(|(_, plane)| plane)
        .filter(|value| !value.is_finite())
        .count();
    if not_finite > 0 {
        return Err(refused(format!("it has {not_finite} values that are not finite")));
    }
    if variants_of(reference).exists() || has_variation(reference) {
        return Err(refused(format!(
            "{} is a stored reference of `validate`, which `reference --accept` renders again",
            reference.display()
        )));
    }
    std::fs::read(ours).map_err(|error| Failure::usage(format!("{}: {error}", ours.display())))
}

/// Writes a reference atomically. Returns the folders that were created for it, the innermost
/// first.
pub(super) fn write(reference: &Path, bytes: &[u8]) -> Result<Vec<PathBuf>, Failure> {
    let mut created = Vec::new();
    if let Some(folder) = reference.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        let missing = folder
            .ancestors()
            .take_while(|folder| !folder.as_os_str().is_empty() && !folder.exists());
        created = missing.map(Path::to_owned).collect();
        let told = |error: std::io::Error| Failure::environment(format!("{}: {error}", folder.display()));
        std::fs::create_dir_all(folder).map_err(told)?;
    }
    atomic::write_bytes(reference, bytes).map_err(Failure::environment)?;
    Ok(created)
}

/// Whether a reference records the values that it takes under variations.
fn has_variation(reference: &Path) -> bool {
    let image = input::read(reference, None, Transfer::Linear);
    image.is_ok_and(|found| Ranges::of(&found.linear()).is_ok_and(|ranges| ranges.is_some()))
}
