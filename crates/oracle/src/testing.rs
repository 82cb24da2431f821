//! Helpers of tests.

use crate::tracer::{Tracer, Value};
use whitstone_scene::{Description, Sources};

/// Bytes as the base64 of a data URI.
pub(crate) fn base64(bytes: &[u8]) -> String {
    use base64::Engine as _;
    base64::engine::general_purpose::STANDARD.encode(bytes)
}

/// A .glb file of these two chunks.
pub(crate) fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let mut body = Vec::new();
    for (kind, bytes, fill) in [(b"JSON", json.as_bytes(), b' '), (b"BIN\0", binary, 0)] {
        let padded = bytes.len().next_multiple_of(4);
        body.extend_from_slice(&(padded as u32).to_le_bytes());
        body.extend_from_slice(kind);
        body.extend_from_slice(bytes);
        body.resize(body.len() + padded - bytes.len(), fill);
    }
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend_from_slice(&(body.len() as u32 + 12).to_le_bytes());
    file.extend_from_slice(&body);
    file
}

/// The pixel that sees the point (x, y, 0) along -z, from z = 5, with an ambient light of 1. The
/// files are next to the scene.
pub(crate) fn pixel([x, y]: [f64; 2], text: &str, files: &[(&str, &[u8])]) -> Result<Value, String> {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    let head = format!(
        "[film]\nwidth = 3\nheight = 3\n\
        [camera]\ntype = \"perspective\"\nfov = 20\n\
        look_at = {{ origin = [{x:?}, {y:?}, 5], target = [{x:?}, {y:?}, 0] }}\n\
        [[light]]\ntype = \"ambient\"\nradiance = 1\n"
    );
    let sources = Sources::from_text("scene.toml", &(head + text), folder.path(), &[]).unwrap();
    let description = Description::parse(&sources).into_result().unwrap();
    let tracer = Tracer::new(&description).map_err(|errors| errors.0[0].message.clone())?;
    Ok(tracer.pixel([1, 1]))
}

/// The value of a pixel, if it is certain.
pub(crate) fn seen(at: [f64; 2], text: &str, files: &[(&str, &[u8])]) -> Option<[f64; 3]> {
    match pixel(at, text, files).unwrap() {
        Value::Known { rgb, uncertainty, .. } if uncertainty.iter().all(|x| *x < 1e-9) => Some(rgb),
        _ => None,
    }
}

/// Asserts that the pixel has this value.
#[track_caller]
pub(crate) fn shows(at: [f64; 2], text: &str, files: &[(&str, &[u8])], expected: [f64; 3]) {
    let found = seen(at, text, files).unwrap_or([f64::NAN; 3]);
    let near = (0..3).all(|c| (found[c] - expected[c]).abs() < 1e-9);
    assert!(near, "{found:?} instead of {expected:?} at {at:?}: {text}");
}
