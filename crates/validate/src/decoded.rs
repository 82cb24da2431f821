//! JPEG and WebP textures, decoded once for both sides.
//!
//! Decoders of JPEG differ by several codes: the standard leaves the interpolation of the colour
//! channels free. A comparison of renderers would then compare decoders, so the reference receives
//! the texels that our side has read, as PNG files.

use std::io::Read;
use std::path::{Path, PathBuf};
use toml::{Table, Value};
use whitstone_gltf::Document;
use whitstone_image::atomic;
use whitstone_image::limits::Limits;
use whitstone_image::texels;
use whitstone_scene::Flattened;

/// Replaces JPEG and WebP textures of the document by PNG files in a folder, and returns the names
/// of the replaced files. If any is replaced, the document has another hash.
///
/// # Errors
///
/// If a file cannot be written. Files that cannot be read stay, and are reported by those that use
/// them.
pub fn decode_textures(flattened: &mut Flattened, folder: &Path) -> Result<Vec<String>, String> {
    let mut replaced: Vec<Replaced> = Vec::new();
    let Ok(mut table) = flattened.text.parse::<Table>() else {
        return Ok(Vec::new());
    };
    let folder = std::path::absolute(folder).map_err(|error| error.to_string())?;
    for (_, value) in table.iter_mut() {
        visit(value, &flattened.base, &folder, &mut replaced)?;
    }
    let mut files: Vec<String> = replaced.iter().map(|replaced| replaced.file.clone()).collect();
    files.sort();
    files.dedup();
    if !replaced.is_empty() {
        flattened.text = toml::to_string(&table).map_err(|error| error.to_string())?;
        let mut hasher = blake3::Hasher::new();
        hasher.update(flattened.hash.as_bytes());
        for replaced in &replaced {
            hasher.update(replaced.name.as_bytes());
        }
        flattened.hash = hasher.finalize().to_hex()[..32].to_owned();
    }
    Ok(files)
}

/// A replaced texture.
struct Replaced {
    /// The file in the scene, for messages.
    file: String,
    /// Name of the PNG file: the hash of its bytes.
    name: String,
}

fn visit(value: &mut Value, base: &Path, folder: &Path, replaced: &mut Vec<Replaced>) -> Result<(), String> {
    match value {
        Value::Array(items) => items
            .iter_mut()
            .try_for_each(|item| visit(item, base, folder, replaced)),
        Value::Table(table) => {
            if table.get("type").and_then(Value::as_str) == Some("image") {
                image(table, base, folder, replaced)?;
            }
            table
                .iter_mut()
                .try_for_each(|(_, item)| visit(item, base, folder, replaced))
        }
        _ => Ok(()),
    }
}

/// Replaces the file of an `image` texture.
fn image(table: &mut Table, base: &Path, folder: &Path, replaced: &mut Vec<Replaced>) -> Result<(), String> {
    let Some(file) = table.get("file").and_then(Value::as_str).map(str::to_owned) else {
        return Ok(());
    };
    let path = base.join(&file);
    let index = table.get("image").and_then(Value::as_integer).unwrap_or(0);
    let Some(bytes) = bytes(&path, index) else {
        return Ok(());
    };
    let Some(Ok(png)) = texels::to_png(&bytes, Limits::TEXTURE) else {
        return Ok(());
    };
    let name = format!("{}.png", &blake3::hash(&png).to_hex()[..32]);
    let to: PathBuf = folder.join(&name);
    if !to.is_file() {
        std::fs::create_dir_all(folder).map_err(|error| error.to_string())?;
        atomic::write_bytes(&to, &png).map_err(|error| error.to_string())?;
    }
    let file = match table.remove("image") {
        Some(_) => format!("{file}, image {index}"),
        None => file,
    };
    replaced.push(Replaced { file, name });
    let to = to.to_string_lossy().replace('\\', "/");
    table.insert("file".into(), Value::String(to));
    Ok(())
}

/// The bytes of a JPEG or WebP file, or of an image in a glTF file.
fn bytes(path: &Path, index: i64) -> Option<Vec<u8>> {
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    if extension == "gltf" || extension == "glb" {
        return Document::open(path)
            .ok()?
            .image(usize::try_from(index).ok()?)
            .ok();
    }
    let within = std::fs::metadata(path).ok()?;
    if !within.is_file() {
        return None;
    }
    // Other images, which may be large, are not read for this.
    let mut file = std::fs::File::open(path).ok()?;
    let mut bytes = Vec::new();
    (&mut file).take(12).read_to_end(&mut bytes).ok()?;
    if !texels::is_jpeg_or_webp(&bytes) {
        return None;
    }
    file.read_to_end(&mut bytes).ok()?;
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_lossy_textures_are_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let base = folder.path().join("scene");
        std::fs::create_dir(&base).unwrap();
        // A WebP file of one red pixel, lossless.
        let webp =
            b"RIFF\x1c\0\0\0WEBPVP8L\x0f\0\0\0\x2f\0\0\0\x10\x07\x10\xfd\x8f\xfe\x07\x22\xa2\xff\x01\0";
        std::fs::write(base.join("a.webp"), webp).unwrap();
        std::fs::write(base.join("b.png"), b"no picture").unwrap();
        let text = "[texture.a]\nfile = \"a.webp\"\ntype = \"image\"\n\n[texture.b]\nfile = \"b.png\"\ntype = \"image\"\n";
        let mut flattened = Flattened {
            text: text.into(),
            base,
            hash: String::new(),
            files: Vec::new(),
        };
        let replaced = decode_textures(&mut flattened, &folder.path().join("decoded")).unwrap();
        assert_eq!(replaced, ["a.webp"]);
        let table: Table = flattened.text.parse().unwrap();
        let file = table["texture"]["a"]["file"].as_str().unwrap();
        assert!(file.ends_with(".png"));
        let found = texels::read(file, Limits::TEXTURE).unwrap();
        assert_eq!((found.width, found.height, found.data.len()), (1, 1, 1));
        assert_eq!(table["texture"]["b"]["file"].as_str(), Some("b.png"));
    }
}
