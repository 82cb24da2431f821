//! Film, camera, sampler and integrator.

use super::{Exporter, floats, integers, list, matrix, quoted, table, text};
use toml::Table;
use whitstone_core::{DAffine3, DMat3, DVec3};

impl Exporter<'_> {
    pub(super) fn view(&mut self) {
        let film = table::table(self.document, "film");
        let size = |key: &str| film.and_then(|film| table::number(film, key)).unwrap_or(512.0);
        let (width, height) = (size("width"), size("height"));
        if film.is_some_and(|film| film.contains_key("aovs") || film.contains_key("paths")) {
            self.note("[film] layers", "film");
        }
        if let Some(camera) = table::table(self.document, "camera") {
            self.camera(camera, width, height);
        }
        let image = format!("{}.exr", self.stem);
        self.line(format!(
            "Film \"rgb\" {} {} \"bool savefp16\" false {}",
            integers("xresolution", &[width as i64]),
            integers("yresolution", &[height as i64]),
            text("filename", &image)
        ));
        self.line("PixelFilter \"box\" \"float xradius\" [0.5] \"float yradius\" [0.5]");
        self.sampler();
        self.integrator();
    }

    fn camera(&mut self, camera: &Table, width: f64, height: f64) {
        let look = table::table(camera, "look_at");
        let vector =
            |key: &str, default: DVec3| look.and_then(|look| table::vector(look, key)).unwrap_or(default);
        let (origin, target) = (vector("origin", DVec3::ZERO), vector("target", DVec3::NEG_Z));
        let up = vector("up", DVec3::Y);
        let kind = table::kind(camera);
        if table::number(camera, "near").is_some_and(|near| near != 0.0) {
            self.note("[camera] near", "camera");
        }
        let look_at = || {
            let three = |v: DVec3| format!("{:?} {:?} {:?}", v.x, v.y, v.z);
            // pbrt's camera space is left-handed.
            format!(
                "Scale -1 1 1\nLookAt {}  {}  {}",
                three(origin),
                three(target),
                three(up)
            )
        };
        let [l, r, b, t] = window(camera, kind, width, height);
        let plain = !camera.contains_key("window");
        match kind {
            "perspective" | "thin_lens" => {
                self.line(look_at());
                let fov = table::number(camera, "fov").unwrap_or(45.0);
                let shorter = match table::text(camera, "fov_axis").unwrap_or("x") {
                    "x" => width <= height,
                    "y" => height <= width,
                    "smaller" => true,
                    _ => width == height,
                };
                let mut line = "Camera \"perspective\" ".to_owned();
                if plain {
                    // pbrt's fov is along the shorter axis.
                    let half = r.min(t);
                    let fov = if shorter {
                        fov
                    } else {
                        2.0 * libm::atan(half).to_degrees()
                    };
                    line.push_str(&floats("fov", &[fov]));
                } else {
                    line.push_str(&format!(
                        "\"float fov\" [90] \"float screenwindow\" {}",
                        list(&[l, r, b, t])
                    ));
                }
                let aperture = table::number(camera, "aperture").unwrap_or(0.0);
                if kind == "thin_lens" && aperture > 0.0 {
                    self.note("[camera] thin_lens", "camera");
                    let distance = table::number(camera, "focus_distance").unwrap_or(1.0);
                    line.push_str(&format!(
                        " {} {}",
                        floats("lensradius", &[aperture]),
                        floats("focaldistance", &[distance])
                    ));
                }
                self.line(line);
            }
            "orthographic" => {
                self.line(look_at());
                self.line(format!(
                    "Camera \"orthographic\" \"float screenwindow\" {}",
                    list(&[l, r, b, t])
                ));
            }
            "environment" => {
                let forward = (target - origin).normalize_or(DVec3::NEG_Z);
                let right = forward.cross(up).normalize_or(DVec3::X);
                // The middle of pbrt's image looks along -x, and its left along z.
                let axes = DMat3::from_cols(-forward, right.cross(forward), -right);
                let camera_from_world = DAffine3::from_mat3_translation(axes, origin).inverse();
                self.line(format!("Transform {}", matrix(&camera_from_world)));
                self.line(format!(
                    "Camera \"spherical\" {}",
                    text("mapping", "equirectangular")
                ));
            }
            other => {
                self.note("[*] plugins of third parties", other);
            }
        }
    }

    fn sampler(&mut self) {
        let empty = Table::new();
        let settings = table::table(self.document, "sampler").unwrap_or(&empty);
        let whole =
            |key: &str, default: i64| table::number(settings, key).map_or(default, |value| value as i64);
        let kind = table::kind(settings);
        let line = match kind {
            "" | "center" | "grid" | "stratified" => {
                let n = if matches!(kind, "grid" | "stratified") {
                    whole("samples_per_axis", 2)
                } else {
                    1
                };
                format!(
                    "\"stratified\" {} {} \"bool jitter\" {}",
                    integers("xsamples", &[n]),
                    integers("ysamples", &[n]),
                    kind == "stratified"
                )
            }
            "sobol" => format!("\"sobol\" {}", integers("pixelsamples", &[whole("samples", 4)])),
            _ => {
                self.note("[sampler] adaptive", "sampler");
                format!("\"sobol\" {}", integers("pixelsamples", &[whole("samples", 256)]))
            }
        };
        self.line(format!("Sampler {line}"));
    }

    fn integrator(&mut self) {
        let empty = Table::new();
        let settings = table::table(self.document, "integrator").unwrap_or(&empty);
        if let Some(shadows @ ("filtered" | "none")) = table::text(settings, "shadows") {
            self.note("[integrator] shadows", shadows);
        }
        if table::number(settings, "light_cutoff").is_some_and(|cutoff| cutoff > 0.0) {
            self.note("[integrator] light_cutoff", "integrator");
        }
        self.note("[integrator]", "integrator");
        let depth = match table::kind(settings) {
            "" | "whitted" => table::number(settings, "max_depth").unwrap_or(6.0) as i64 + 1,
            _ => 1,
        };
        self.line(format!(
            "Integrator {} {}",
            quoted("path"),
            integers("maxdepth", &[depth])
        ));
    }
}

/// l, r, b and t of a camera at the distance 1.
fn window(camera: &Table, kind: &str, width: f64, height: f64) -> [f64; 4] {
    if let Some(window) = table::table(camera, "window") {
        let key = |key: &str, default: f64| table::number(window, key).unwrap_or(default);
        let d = if kind == "orthographic" {
            1.0
        } else {
            key("d", 1.0)
        };
        return [
            key("l", -1.0) / d,
            key("r", 1.0) / d,
            key("b", -1.0) / d,
            key("t", 1.0) / d,
        ];
    }
    let half_x = if kind == "orthographic" {
        table::number(camera, "width").unwrap_or(2.0) / 2.0
    } else {
        let half = libm::tan((table::number(camera, "fov").unwrap_or(45.0) / 2.0).to_radians());
        let along_y = match table::text(camera, "fov_axis") {
            Some("y") => true,
            Some("smaller") => height < width,
            Some("larger") => height > width,
            _ => false,
        };
        if along_y { half * width / height } else { half }
    };
    let half_y = half_x * height / width;
    [-half_x, half_x, -half_y, half_y]
}
