//! The camera of a subject that does not sample the centres of pixels.
//!
//! The film of the model has its samples at fixed places of a pixel. A camera whose window is
//! shifted sees the same as one that samples elsewhere, so the shift needs no change of the model.

use toml::{Table, Value};

/// The default of the film's width and height.
const FILM: i64 = 512;

/// The change of a flattened scene, as for `--set`, that shifts its camera by a part of a pixel to
/// the right and down.
pub(crate) fn shifted(scene: &str, offset: [f64; 2]) -> Result<String, String> {
    let scene: Table = scene
        .parse()
        .map_err(|error: toml::de::Error| error.to_string())?;
    let film = |key: &str| {
        let value = scene.get("film").and_then(|film| film.get(key));
        value.and_then(Value::as_integer).unwrap_or(FILM) as f64
    };
    let size = [film("width"), film("height")];
    let mut camera = (scene.get("camera").and_then(Value::as_table))
        .ok_or("the scene has no camera")?
        .clone();
    let kind = camera.get("type").and_then(Value::as_str).unwrap_or_default();
    let [left, right, bottom, top] = match (camera.get("window"), kind) {
        (Some(window), "perspective" | "thin_lens" | "orthographic") => sides(window)?,
        (None, "perspective" | "thin_lens") => of_angle(&camera, size)?,
        (None, "orthographic") => {
            let half = camera
                .get("width")
                .map_or(Some(2.0), number)
                .ok_or("its width is no number")?
                / 2.0;
            symmetric(half, half * size[1] / size[0])
        }
        (_, kind) => {
            return Err(format!(
                "a camera of type \"{kind}\" cannot be shifted by a part of a pixel"
            ));
        }
    };
    let dx = (right - left) * offset[0] / size[0];
    let dy = (top - bottom) * offset[1] / size[1];
    let mut window = camera
        .get("window")
        .and_then(Value::as_table)
        .cloned()
        .unwrap_or_default();
    for (key, side) in [
        ("l", left + dx),
        ("r", right + dx),
        ("b", bottom - dy),
        ("t", top - dy),
    ] {
        window.insert(key.to_owned(), Value::Float(side));
    }
    for key in ["fov", "fov_axis", "width"] {
        camera.remove(key);
    }
    camera.insert("window".to_owned(), Value::Table(window));
    // The display of a value, unlike that of a table, is an inline table.
    Ok(format!("camera={}", Value::Table(camera)))
}

fn number(value: &Value) -> Option<f64> {
    value.as_float().or_else(|| Some(value.as_integer()? as f64))
}

fn sides(window: &Value) -> Result<[f64; 4], String> {
    let side = |key: &str| window.get(key).and_then(number).ok_or("its window lacks a side");
    Ok([side("l")?, side("r")?, side("b")?, side("t")?])
}

fn symmetric(x: f64, y: f64) -> [f64; 4] {
    [-x, x, -y, y]
}

/// The window at distance 1 of a camera with a field of view.
fn of_angle(camera: &Table, [width, height]: [f64; 2]) -> Result<[f64; 4], String> {
    let angle = camera
        .get("fov")
        .map_or(Some(45.0), number)
        .ok_or("its fov is no number")?;
    let half = (angle.to_radians() / 2.0).tan();
    let along_x = match camera.get("fov_axis").and_then(Value::as_str).unwrap_or("x") {
        "x" => true,
        "y" => false,
        "smaller" => width <= height,
        "larger" => width >= height,
        other => return Err(format!("unknown fov_axis \"{other}\"")),
    };
    Ok(match along_x {
        true => symmetric(half, half * height / width),
        false => symmetric(half * width / height, half),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(scene: &str, offset: [f64; 2]) -> [f64; 4] {
        let change = shifted(scene, offset).unwrap();
        let scene: Table = change.parse().unwrap();
        let camera = &scene["camera"];
        assert!(
            camera.get("fov").is_none() && camera.get("width").is_none(),
            "{change}"
        );
        sides(&camera["window"]).unwrap()
    }

    #[test]
    fn a_window_is_shifted_by_parts_of_a_pixel() {
        let film = "[film]\nwidth = 4\nheight = 2\n[camera]\ntype = ";
        let close = |found: [f64; 4], expected: [f64; 4]| {
            let far = found.iter().zip(expected).any(|(a, b)| (a - b).abs() > 1e-15);
            assert!(!far, "{found:?} {expected:?}");
        };
        // 90 degrees along x: the window is 2 wide and 1 high, a pixel 0.5 by 0.5.
        let perspective = format!("{film}\"perspective\"\nfov = 90\n");
        close(window(&perspective, [0.5, 0.0]), [-0.75, 1.25, -0.5, 0.5]);
        close(window(&perspective, [0.0, 0.5]), [-1.0, 1.0, -0.75, 0.25]);
        let along_y = format!("{perspective}fov_axis = \"y\"\n");
        close(window(&along_y, [0.0, 0.0]), [-2.0, 2.0, -1.0, 1.0]);
        let orthographic = format!("{film}\"orthographic\"\n");
        close(window(&orthographic, [1.0, 0.0]), [-0.5, 1.5, -0.5, 0.5]);
        let given = format!("{film}\"perspective\"\nwindow = {{ l = 0, r = 4, b = 0, t = 1, d = 3 }}\n");
        close(window(&given, [-1.0, 1.0]), [-1.0, 3.0, -0.5, 0.5]);
        assert!(shifted(&given, [0.0; 2]).unwrap().contains("d = 3"));
    }

    #[test]
    fn a_panorama_cannot_be_shifted() {
        let error = shifted("[camera]\ntype = \"environment\"\n", [0.5, 0.5]).unwrap_err();
        assert!(error.contains("environment"));
    }
}
