//! Cameras.

use super::import::{Importer, shortest};
use crate::document::{numbers, table};
use toml::{Table, Value};
use whitstone_core::{DAffine3, FormatError};
use whitstone_gltf::Document;

/// Pixels of the longer side of the film.
const LONGER_SIDE: f64 = 512.0;

impl Importer<'_> {
    /// Adds a camera that stands at a place, and a film of its shape.
    pub(crate) fn add_camera(
        &mut self,
        index: usize,
        world: &DAffine3,
        place: &str,
    ) -> Result<(), FormatError> {
        let root = &self.document.root;
        let pointer = || format!("{place}/camera");
        let camera = Document::item(&root.cameras, index, "cameras", pointer).map_err(self.told())?;
        let at = format!("/cameras/{index}");
        let matrix = &world.matrix3;
        let (up, backwards) = (matrix.y_axis.try_normalize(), matrix.z_axis.try_normalize());
        let (Some(up), Some(backwards)) = (up, backwards) else {
            self.note("nodes without volume", place);
            return Ok(());
        };
        if matrix.determinant() < 0.0 {
            self.note("mirrored cameras", place);
        }
        let origin = world.translation;
        let look_at = table([
            ("origin", numbers(origin.to_array())),
            ("target", numbers((origin - backwards).to_array())),
            ("up", numbers(up.to_array())),
        ]);
        let mut keys = table([("look_at", Value::Table(look_at))]);
        let near = |keys: &mut Table, near: f32| {
            if near > 0.0 {
                keys.insert("near".into(), Value::Float(shortest(near)));
            }
        };
        let aspect = match (&camera.perspective, &camera.orthographic) {
            (Some(perspective), None) => {
                let fov = shortest(perspective.yfov).to_degrees();
                if !(fov > 0.0 && fov < 180.0) {
                    let message = format!("expected an angle between 0 and pi, found {}", perspective.yfov);
                    return Err(FormatError::at(format!("{at}/perspective/yfov"), message));
                }
                keys.insert("type".into(), Value::String("perspective".into()));
                keys.insert("fov".into(), Value::Float(fov));
                keys.insert("fov_axis".into(), Value::String("y".into()));
                near(&mut keys, perspective.znear);
                if perspective.zfar.is_some() {
                    self.note("far limit", &at);
                }
                perspective.aspect_ratio.map_or(1.0, shortest)
            }
            (None, Some(orthographic)) => {
                let [x, y] = [orthographic.xmag, orthographic.ymag].map(|size| shortest(size).abs());
                if !(x > 0.0 && y > 0.0) {
                    let message = "expected `xmag` and `ymag` other than 0";
                    return Err(FormatError::at(format!("{at}/orthographic"), message));
                }
                if orthographic.xmag < 0.0 || orthographic.ymag < 0.0 {
                    self.note("mirrored cameras", &at);
                }
                let window =
                    [("l", -x), ("r", x), ("b", -y), ("t", y)].map(|(key, size)| (key, Value::Float(size)));
                keys.insert("type".into(), Value::String("orthographic".into()));
                keys.insert("window".into(), Value::Table(table(window)));
                near(&mut keys, orthographic.znear);
                self.note("far limit", &at);
                x / y
            }
            _ => {
                let message = "expected either `perspective` or `orthographic`";
                return Err(FormatError::at(at, message));
            }
        };
        if !(aspect > 0.0 && aspect.is_finite()) {
            let message = format!("expected an aspect ratio above 0, found {aspect}");
            return Err(FormatError::at(at, message));
        }
        let side = |part: f64| Value::Integer((LONGER_SIDE * part.min(1.0)).round().max(1.0) as i64);
        let film = table([("width", side(aspect)), ("height", side(1.0 / aspect))]);
        self.scene.single.push(("film", film));
        self.scene.single.push(("camera", keys));
        Ok(())
    }
}
