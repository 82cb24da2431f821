//! Film, camera, sampler and integrator.
//!
//! pbrt's camera space has +x to the right, +y up and looks along +z.

use super::params::{Args, Kind};
use super::scene::Importer;
use crate::document::{numbers, table, typed};
use toml::{Table, Value};
use whitstone_core::DAffine3;

/// Most samples of a pixel for samplers that need many for noise, of which there is none here.
const MAX_SAMPLES: i64 = 64;
/// Relative error of the axes of a camera, which may be written with few digits.
const TOLERANCE: f64 = 1e-3;

/// The size of the film and the part of it that is rendered, in pixels from the left top.
struct Film {
    size: [f64; 2],
    /// x0, x1, y0, y1.
    crop: [f64; 4],
}

impl Film {
    fn is_cropped(&self) -> bool {
        self.crop != [0.0, self.size[0], 0.0, self.size[1]]
    }

    /// The rendered part of the window l, r, b, t.
    fn cut(&self, [l, r, b, t]: [f64; 4]) -> [f64; 4] {
        let [x0, x1, y0, y1] = self.crop;
        let x = |pixel: f64| l + (r - l) * pixel / self.size[0];
        let y = |pixel: f64| t - (t - b) * pixel / self.size[1];
        [x(x0), x(x1), y(y1), y(y0)]
    }
}

impl Importer<'_> {
    /// The factor of the image that follows from the shutter and the sensitivity of the film.
    pub(super) fn exposure_of(&mut self, camera: &Args, film: &Args) -> f64 {
        let (mut camera, mut film) = (camera.clone(), film.clone());
        let open = self.number(&mut camera, "shutteropen", 0.0);
        let close = self.number(&mut camera, "shutterclose", 1.0);
        let iso = self.number(&mut film, "iso", 100.0);
        let exposure = (close - open) * iso / 100.0;
        if exposure > 0.0 && exposure.is_finite() {
            return exposure;
        }
        self.error(
            camera.at,
            "the exposure, of \"shutteropen\", \"shutterclose\" and \"iso\", must be above 0",
        );
        1.0
    }

    fn film(&mut self, (plugin, mut args): (String, Args)) -> Film {
        match plugin.as_str() {
            "rgb" => {}
            "gbuffer" | "spectral" => self.note("Film gbuffer, spectral", args.at),
            _ => self.unknown_plugin("film", &plugin, &["rgb", "gbuffer", "spectral"], args.at),
        }
        args.ignore(&[
            "filename",
            "diagonal",
            "savefp16",
            "maxcomponentvalue",
            "iso",
            "coordinatesystem",
            "nbuckets",
            "lambdamin",
            "lambdamax",
        ]);
        let sensor = self.optional_text(&mut args, "sensor");
        if self.number(&mut args, "whitebalance", 0.0) != 0.0
            || sensor.is_some_and(|sensor| sensor != "cie1931")
        {
            self.note("sensor, whitebalance", args.at);
        }
        let mut size = [("xresolution", 1280), ("yresolution", 720)].map(|(name, default)| {
            let pixels = self.integer(&mut args, name, default);
            if !(1..=65536).contains(&pixels) {
                self.error(
                    args.at,
                    format!("expected 1 to 65536 as \"{name}\", found {pixels}"),
                );
            }
            pixels.clamp(1, 65536) as f64
        });
        let mut film = Film {
            size,
            crop: [0.0, size[0], 0.0, size[1]],
        };
        if let Some(bounds) = self.list(&mut args, "pixelbounds", &[Kind::Integer]) {
            match <[f64; 4]>::try_from(bounds) {
                Ok(bounds) => film.crop = bounds,
                Err(_) => self.error(args.at, "\"pixelbounds\" must have four values"),
            }
        }
        if let Some(window) = self.list(&mut args, "cropwindow", &[Kind::Float]) {
            match <[f64; 4]>::try_from(window) {
                Ok([x0, x1, y0, y1]) => {
                    let [w, h] = size;
                    film.crop = [(w * x0).ceil(), (w * x1).ceil(), (h * y0).ceil(), (h * y1).ceil()];
                }
                Err(_) => self.error(args.at, "\"cropwindow\" must have four values"),
            }
        }
        let [x0, x1, y0, y1] = film.crop;
        if !(0.0 <= x0 && x0 < x1 && x1 <= size[0] && 0.0 <= y0 && y0 < y1 && y1 <= size[1]) {
            self.error(args.at, "the crop window is empty or not on the film");
            film.crop = [0.0, size[0], 0.0, size[1]];
        } else {
            size = [x1 - x0, y1 - y0];
        }
        self.done(args);
        let pixels = |pixels: f64| Value::Integer(pixels as i64);
        let result = table([("width", pixels(size[0])), ("height", pixels(size[1]))]);
        self.document.single.push(("film", result));
        film
    }

    pub(super) fn add_camera(
        &mut self,
        (plugin, mut args, camera_from_world): (String, Args, DAffine3),
        film: (String, Args),
        filter: (String, Args),
    ) {
        let film = self.film(film);
        self.filter(filter);
        args.ignore(&["shutteropen", "shutterclose"]);
        let at = args.at;
        let world = self.world_map() * camera_from_world.inverse();
        let axes = [world.matrix3.x_axis, world.matrix3.y_axis, world.matrix3.z_axis];
        let [x, y, z] = axes.map(|axis| axis.normalize_or_zero());
        let [sx, sy, sz] = axes.map(|axis| axis.length());
        if [x.dot(y), y.dot(z), z.dot(x)]
            .iter()
            .any(|cosine| cosine.abs() > TOLERANCE)
        {
            self.error(at, "the transform of a camera must not shear it");
        }
        let frame = self.number(&mut args, "frameaspectratio", film.size[0] / film.size[1]);
        let square = frame == film.size[0] / film.size[1];
        if frame <= 0.0 {
            self.error(at, "\"frameaspectratio\" must be above 0");
        }
        let (mut screen, mut simple) = if frame > 1.0 {
            ([-frame, frame, -1.0, 1.0], square)
        } else {
            ([-1.0, 1.0, -1.0 / frame, 1.0 / frame], square)
        };
        if let Some(window) = self.list(&mut args, "screenwindow", &[Kind::Float]) {
            simple = false;
            match <[f64; 4]>::try_from(window) {
                Ok(window) if window[0] < window[1] && window[2] < window[3] => screen = window,
                _ => self.error(
                    at,
                    "\"screenwindow\" must have four values: left, right, bottom and top",
                ),
            }
        }
        let simple = simple && !film.is_cropped();
        let equal = |a: f64, b: f64| (a - b).abs() <= 1e-6 * b;
        let lens = self.number(&mut args, "lensradius", 0.0);
        let focus = self.number(&mut args, "focaldistance", 1e6);
        let mut forward = z;
        let mut camera = match plugin.as_str() {
            "perspective" => {
                let fov = self.number(&mut args, "fov", 90.0);
                if !(fov > 0.0 && fov < 180.0) {
                    self.error(
                        at,
                        format!("expected a field of view between 0 and 180 degrees, found {fov}"),
                    );
                }
                let mut camera = if simple && equal(sx, sz) && equal(sy, sz) {
                    let axis = ("fov_axis", Value::String("smaller".into()));
                    typed("perspective", [("fov", Value::Float(fov)), axis])
                } else {
                    let half = libm::tan((fov / 2.0).to_radians());
                    let [l, r, b, t] = film.cut(screen);
                    let window = [
                        l * half * sx / sz,
                        r * half * sx / sz,
                        b * half * sy / sz,
                        t * half * sy / sz,
                    ];
                    typed("perspective", [("window", window_table(window))])
                };
                if lens > 0.0 {
                    camera.insert("type".to_owned(), Value::String("thin_lens".into()));
                    camera.insert("aperture".to_owned(), Value::Float(lens * sx));
                    camera.insert("focus_distance".to_owned(), Value::Float(focus * sz));
                }
                camera
            }
            "orthographic" => {
                if lens > 0.0 {
                    self.note("lensradius of an orthographic camera", at);
                }
                let [l, r, b, t] = film.cut(screen);
                let [l, r, b, t] = [l * sx, r * sx, b * sy, t * sy];
                let [width, height] = [film.crop[1] - film.crop[0], film.crop[3] - film.crop[2]];
                let square = ((r - l) * height - (t - b) * width).abs() <= 1e-12 * (r - l) * height;
                if square && l == -r && b == -t {
                    typed("orthographic", [("width", Value::Float(r - l))])
                } else {
                    typed("orthographic", [("window", window_table([l, r, b, t]))])
                }
            }
            "spherical" => {
                let mapping = self
                    .optional_text(&mut args, "mapping")
                    .unwrap_or("equalarea".to_owned());
                if mapping != "equirectangular" {
                    self.error(
                        at,
                        "only the mapping \"equirectangular\" of a spherical camera is supported",
                    );
                }
                if film.is_cropped() {
                    self.error(at, "a spherical camera must not be cropped");
                }
                // The middle of the image looks along -x.
                forward = -x;
                typed("environment", [])
            }
            _ => {
                let known = ["perspective", "orthographic", "spherical"];
                self.unknown_plugin("camera", &plugin, &known, at);
                args.ignore_all();
                Table::new()
            }
        };
        let origin = world.translation;
        let look_at = table([
            ("origin", numbers(origin.to_array())),
            ("target", numbers((origin + forward).to_array())),
            ("up", numbers(y.to_array())),
        ]);
        if !origin.is_finite() || x == y || origin + forward == origin {
            self.error(at, "the camera is too far away from the origin");
        }
        camera.insert("look_at".to_owned(), Value::Table(look_at));
        self.done(args);
        self.document.single.push(("camera", camera));
    }

    fn filter(&mut self, (plugin, mut args): (String, Args)) {
        let known = ["box", "gaussian", "mitchell", "sinc", "triangle"];
        if !known.contains(&plugin.as_str()) {
            self.unknown_plugin("filter", &plugin, &known, args.at);
        }
        let radius = ["xradius", "yradius"].map(|name| self.number(&mut args, name, 0.5));
        args.ignore(&["sigma", "B", "C", "tau"]);
        if plugin != "box" || radius != [0.5; 2] {
            self.note("PixelFilter", args.at);
        }
        self.done(args);
    }

    pub(super) fn add_sampler(&mut self, (plugin, mut args): (String, Args)) {
        let at = args.at;
        args.ignore(&["seed", "randomization"]);
        let known = [
            "halton",
            "independent",
            "paddedsobol",
            "pmj02bn",
            "sobol",
            "stratified",
            "zsobol",
        ];
        let count = if plugin == "stratified" {
            let [x, y] = ["xsamples", "ysamples"].map(|name| self.integer(&mut args, name, 4));
            let jitter = self.boolean(&mut args, "jitter", true);
            if x == y && (1..=64).contains(&x) {
                self.done(args);
                let axis = ("samples_per_axis", Value::Integer(x));
                let sampler = match (jitter, x) {
                    (false, 1) => typed("center", []),
                    (false, _) => typed("grid", [axis]),
                    (true, _) => typed("stratified", [axis]),
                };
                return self.document.single.push(("sampler", sampler));
            }
            x.saturating_mul(y)
        } else {
            if !known.contains(&plugin.as_str()) {
                self.unknown_plugin("sampler", &plugin, &known, at);
            }
            self.integer(&mut args, "pixelsamples", 16)
        };
        if plugin != "sobol" || !(1..=MAX_SAMPLES).contains(&count) {
            self.note("Sampler", at);
        }
        self.done(args);
        let samples = Value::Integer(count.clamp(1, MAX_SAMPLES));
        self.document
            .single
            .push(("sampler", typed("sobol", [("samples", samples)])));
    }

    pub(super) fn add_integrator(&mut self, (plugin, mut args): (String, Args)) {
        let at = args.at;
        let known = [
            "path",
            "volpath",
            "simplepath",
            "simplevolpath",
            "bdpt",
            "mlt",
            "sppm",
            "lightpath",
            "randomwalk",
        ];
        if known.contains(&plugin.as_str()) {
            self.note("Integrator", at);
        } else {
            self.unknown_plugin("integrator", &plugin, &known, at);
        }
        let depth = self.integer(&mut args, "maxdepth", 5);
        args.ignore(&[
            "lightsampler",
            "regularize",
            "samplelights",
            "samplebsdf",
            "visualizestrategies",
            "visualizeweights",
            "bootstrapsamples",
            "chains",
            "mutationsperpixel",
            "largestepprobability",
            "sigma",
            "photonsperiteration",
            "radius",
            "seed",
        ]);
        self.done(args);
        let depth = (depth - 1).clamp(0, 100_000);
        let mut integrator = typed(
            "whitted",
            [
                ("max_depth", Value::Integer(depth)),
                ("at_max_depth", Value::String("black".into())),
            ],
        );
        if depth >= 16 {
            integrator.insert("min_contribution".to_owned(), Value::Float(1e-3));
        }
        self.document.single.push(("integrator", integrator));
    }
}

fn window_table([l, r, b, t]: [f64; 4]) -> Value {
    Value::Table(table([
        ("l", Value::Float(l)),
        ("r", Value::Float(r)),
        ("b", Value::Float(b)),
        ("t", Value::Float(t)),
    ]))
}
