//! A small ray tracer, written from docs/whitted-model.md alone, that stands for the renderer of a
//! stranger: `small-tracer SCENE OUTPUT.pfm [FAULT]...`. It renders a part of the model in double
//! precision, and ends with exit code 77 for everything else. Each fault is one that renderers
//! have.

use std::path::Path;
use std::process::ExitCode;
use toml::{Table, Value};
use whitstone::image::{Image, Limits, Transfer, picture};

type Vector = [f64; 3];
type Problem = Box<dyn std::error::Error>;

fn add(a: Vector, b: Vector) -> Vector {
    [0, 1, 2].map(|k| a[k] + b[k])
}

fn scaled(a: Vector, s: f64) -> Vector {
    a.map(|x| s * x)
}

fn from(a: Vector, b: Vector) -> Vector {
    add(b, scaled(a, -1.0))
}

fn dot(a: Vector, b: Vector) -> f64 {
    (0..3).map(|k| a[k] * b[k]).sum()
}

fn cross(a: Vector, b: Vector) -> Vector {
    [0, 1, 2].map(|k| a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3])
}

fn unit(a: Vector) -> Vector {
    scaled(a, 1.0 / dot(a, a).sqrt())
}

/// An affine map: the images of the unit vectors, and of the origin.
#[derive(Clone, Copy)]
struct Map([Vector; 4]);

const IDENTITY: Map = Map([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0; 3]]);

impl Map {
    fn vector(&self, v: Vector) -> Vector {
        let [x, y, z, _] = self.0;
        add(add(scaled(x, v[0]), scaled(y, v[1])), scaled(z, v[2]))
    }

    fn point(&self, p: Vector) -> Vector {
        add(self.vector(p), self.0[3])
    }

    fn after(&self, first: &Self) -> Self {
        let [x, y, z, origin] = first.0;
        Self([self.vector(x), self.vector(y), self.vector(z), self.point(origin)])
    }

    /// The coordinates of a vector in the images of the unit vectors.
    fn back(&self, v: Vector) -> Vector {
        let [x, y, z, _] = self.0;
        let volume = dot(x, cross(y, z));
        [
            dot(v, cross(y, z)) / volume,
            dot(v, cross(z, x)) / volume,
            dot(v, cross(x, y)) / volume,
        ]
    }
}

/// The end of a scene that is not supported.
fn unsupported(what: &str) -> ! {
    println!("{what} is not supported");
    std::process::exit(77)
}

fn number(value: &Value) -> f64 {
    let whole = value.as_integer().map(|whole| whole as f64);
    value
        .as_float()
        .or(whole)
        .unwrap_or_else(|| unsupported("a value that is no number"))
}

fn vector(value: &Value) -> Vector {
    match value.as_array() {
        Some(parts) if parts.len() == 3 => [0, 1, 2].map(|k| number(&parts[k])),
        _ => [number(value); 3],
    }
}

/// The value of a key, or a default.
fn get<T>(table: &Table, key: &str, read: impl Fn(&Value) -> T, default: T) -> T {
    table.get(key).map_or(default, read)
}

fn text<'a>(table: &'a Table, key: &str, default: &'a str) -> &'a str {
    table.get(key).and_then(Value::as_str).unwrap_or(default)
}

fn only(table: &Table, what: &str, known: &[&str]) {
    for key in table.keys() {
        if !known.contains(&key.as_str()) {
            unsupported(&format!("{what} with the key {key}"));
        }
    }
}

/// The faults of this run. `single` is none: it rounds the numbers of the scene, hits and points to
/// single precision, and moves shadow rays in proportion to the coordinates.
struct Faults(Vec<String>);

impl Faults {
    fn has(&self, name: &str) -> bool {
        self.0.iter().any(|fault| fault == name)
    }

    fn rounded(&self, vector: Vector) -> Vector {
        if self.has("single") {
            vector.map(|value| f64::from(value as f32))
        } else {
            vector
        }
    }
}

/// Rounds all numbers of a document to single precision.
fn round_numbers(value: &mut Value) {
    match value {
        Value::Float(float) => *float = f64::from(*float as f32),
        Value::Array(parts) => parts.iter_mut().for_each(round_numbers),
        Value::Table(table) => table.iter_mut().for_each(|(_, value)| round_numbers(value)),
        _ => {}
    }
}

fn map_of(table: &Table, faults: &Faults) -> Map {
    let steps = match table.get("transform") {
        None => return IDENTITY,
        Some(Value::Array(steps)) => steps.clone(),
        Some(step) => vec![step.clone()],
    };
    let maps = steps
        .iter()
        .filter_map(Value::as_table)
        .flatten()
        .map(|(kind, value)| {
            let mut map = IDENTITY;
            match kind.as_str() {
                "translate" => map.0[3] = vector(value),
                "scale" => {
                    for (k, factor) in vector(value).into_iter().enumerate() {
                        map.0[k][k] = factor;
                    }
                }
                "rotate" => {
                    let axis = unit(vector(&value["axis"]));
                    let sign = if faults.has("clockwise") { -1.0 } else { 1.0 };
                    let (sin, cos) = (sign * number(&value["degrees"]).to_radians()).sin_cos();
                    for (k, e) in IDENTITY.0.into_iter().take(3).enumerate() {
                        // Rodrigues' formula.
                        let along = scaled(axis, dot(axis, e) * (1.0 - cos));
                        map.0[k] = add(add(scaled(e, cos), scaled(cross(axis, e), sin)), along);
                    }
                }
                _ => unsupported("a transform with a matrix"),
            }
            map
        });
    let maps: Vec<Map> = maps.collect();
    match faults.has("reverse-order") {
        false => maps.iter().fold(IDENTITY, |total, map| map.after(&total)),
        true => maps.iter().rev().fold(IDENTITY, |total, map| map.after(&total)),
    }
}

enum Paint {
    Color(Vector),
    Texture { image: Image },
}

enum Material {
    Matte(Paint),
    Glass(f64),
}

enum Shape {
    Sphere(Vector, f64),
    Rectangle(Map),
}

struct Light {
    is_point: bool,
    place: Vector,
    power: Vector,
    falls_off: bool,
    /// Of a spot: its axis, its cutoff and its beam, in radians.
    cone: Option<(Vector, [f64; 2])>,
}

struct Hit {
    t: f64,
    normal: Vector,
    uv: [f64; 2],
    object: usize,
}

struct Scene {
    objects: Vec<(Shape, Material)>,
    lights: Vec<Light>,
    ambient: Vector,
    background: Vector,
    max_depth: i64,
    faults: Faults,
}

impl Scene {
    fn read(path: &Path, document: &Table, faults: Faults) -> Result<Self, Problem> {
        let folder = path.parent().unwrap_or(Path::new("."));
        let list = |key: &str| -> Vec<Table> {
            let entries = document.get(key).and_then(Value::as_array).into_iter().flatten();
            entries.filter_map(|entry| entry.as_table().cloned()).collect()
        };
        let integrator = document.get("integrator").and_then(Value::as_table).cloned();
        let integrator = integrator.unwrap_or_default();
        only(&integrator, "an integrator", &["type", "max_depth", "shadows"]);
        if text(&integrator, "type", "whitted") != "whitted"
            || text(&integrator, "shadows", "opaque") != "opaque"
        {
            unsupported("another integrator");
        }
        only(
            document,
            "a scene",
            &[
                "film",
                "camera",
                "integrator",
                "light",
                "shape",
                "expect",
                "accelerator",
            ],
        );
        let mut scene = Self {
            objects: Vec::new(),
            lights: Vec::new(),
            ambient: [0.0; 3],
            background: [0.0; 3],
            max_depth: get(
                &integrator,
                "max_depth",
                |value| value.as_integer().unwrap_or(6),
                6,
            ),
            faults,
        };
        if scene.faults.has("headlight") {
            scene.ambient = [0.1; 3];
        }
        for light in list("light") {
            let kind = text(&light, "type", "").to_owned();
            match kind.as_str() {
                "ambient" => scene.ambient = add(scene.ambient, vector(&light["radiance"])),
                "background" => scene.background = add(scene.background, vector(&light["radiance"])),
                "point" | "spot" => {
                    let place = vector(&light["position"]);
                    let lumen = match kind.as_str() {
                        "point" if scene.faults.has("lumen") => 0.25 / std::f64::consts::PI,
                        "spot" if scene.faults.has("spot-lumen") => 1.0 / std::f64::consts::PI,
                        _ => 1.0,
                    };
                    let cone = (kind == "spot").then(|| {
                        let cutoff = get(&light, "cutoff_angle", number, 20.0);
                        let beam = get(&light, "beam_width", number, 0.75 * cutoff);
                        let faults = &scene.faults;
                        let [cutoff, beam] = match () {
                            () if faults.has("hard-spot") => [cutoff, cutoff],
                            () if faults.has("beam-is-cutoff") => [beam, beam],
                            () if faults.has("no-beam") => [cutoff, 0.0],
                            () if faults.has("default-beam") => [cutoff, 0.75 * cutoff],
                            () => [cutoff, beam],
                        };
                        let whole = match () {
                            () if faults.has("whole-spot") => 0.5,
                            () if faults.has("double-spot") => 2.0,
                            () => 1.0,
                        };
                        let axis = unit(from(place, vector(&light["target"])));
                        (axis, [cutoff, beam].map(|angle| whole * angle.to_radians()))
                    });
                    scene.lights.push(Light {
                        is_point: true,
                        cone,
                        place,
                        power: scaled(get(&light, "intensity", vector, [1.0; 3]), lumen),
                        falls_off: text(&light, "falloff", "inverse_square") != "none"
                            && !(kind == "point" && scene.faults.has("no-falloff"))
                            && !(kind == "spot" && scene.faults.has("spot-no-falloff")),
                    });
                }
                "directional" => {
                    let sign = if scene.faults.has("light-from") { 1.0 } else { -1.0 };
                    scene.lights.push(Light {
                        is_point: false,
                        place: scaled(unit(vector(&light["direction"])), sign),
                        power: get(&light, "irradiance", vector, [1.0; 3]),
                        falls_off: false,
                        cone: None,
                    });
                }
                _ => unsupported("another light"),
            }
        }
        for table in list("shape") {
            let map = map_of(&table, &scene.faults);
            let shape = match text(&table, "type", "") {
                "sphere" if !table.contains_key("transform") => Shape::Sphere(
                    get(&table, "center", vector, [0.0; 3]),
                    get(&table, "radius", number, 1.0),
                ),
                "rectangle" => Shape::Rectangle(map),
                other => unsupported(&format!("the shape {other}")),
            };
            let material = match table.get("material") {
                None => Material::Matte(Paint::Color([0.5; 3])),
                Some(Value::Table(material)) => scene.material(material, folder)?,
                Some(_) => unsupported("a shared material"),
            };
            scene.objects.push((shape, material));
        }
        Ok(scene)
    }

    fn material(&self, table: &Table, folder: &Path) -> Result<Material, Problem> {
        match text(table, "type", "") {
            "matte" => Ok(Material::Matte(match table.get("reflectance") {
                None => Paint::Color([0.5; 3]),
                Some(Value::Table(texture)) => {
                    only(texture, "a texture", &["type", "file"]);
                    if text(texture, "type", "") != "image" {
                        unsupported("another texture");
                    }
                    let mut image =
                        picture::read(folder.join(text(texture, "file", "")), Limits::IMAGE)?.image;
                    if !self.faults.has("linear-texture") {
                        Transfer::Srgb.apply(&mut image);
                    }
                    Paint::Texture { image }
                }
                Some(color) => Paint::Color(vector(color)),
            })),
            "dielectric" => {
                only(table, "glass", &["type", "interior_ior"]);
                let default = if self.faults.has("water") { 1.33 } else { 1.5 };
                Ok(Material::Glass(get(table, "interior_ior", number, default)))
            }
            other => unsupported(&format!("the material {other}")),
        }
    }

    fn intersect(&self, origin: Vector, direction: Vector, least: f64) -> Option<Hit> {
        let mut nearest: Option<Hit> = None;
        for (index, (shape, _)) in self.objects.iter().enumerate() {
            let found = match shape {
                Shape::Sphere(center, radius) => {
                    let way = from(*center, origin);
                    let (b, c) = (dot(way, direction), dot(way, way) - radius * radius);
                    let root = (b * b - c).max(0.0).sqrt();
                    let q = if b < 0.0 { root - b } else { -root - b };
                    let mut both = [q, c / q];
                    both.sort_by(f64::total_cmp);
                    let t = both.into_iter().find(|&t| t > least).filter(|_| b * b > c);
                    t.map(|t| {
                        let point = add(origin, scaled(direction, t));
                        (t, unit(from(*center, point)), [0.0; 2])
                    })
                }
                Shape::Rectangle(map) => {
                    let (o, d) = (map.back(from(map.0[3], origin)), map.back(direction));
                    let t = -o[2] / d[2];
                    let [x, y] = [0, 1].map(|k| o[k] + t * d[k]);
                    let is_hit = t > least && x.abs() <= 1.0 && y.abs() <= 1.0;
                    is_hit.then(|| {
                        let normal = unit(cross(map.0[0], map.0[1]));
                        (t, normal, [0.5 * (x + 1.0), 0.5 * (y + 1.0)])
                    })
                }
            };
            if let Some((t, normal, uv)) = found
                && nearest.as_ref().is_none_or(|hit| t < hit.t)
            {
                nearest = Some(Hit {
                    t,
                    normal,
                    uv,
                    object: index,
                });
            }
        }
        nearest
    }

    fn beyond(&self, direction: Vector) -> Vector {
        if self.faults.has("sky") {
            let t = 0.5 * (direction[1] + 1.0);
            return add(scaled([1.0; 3], 1.0 - t), scaled([0.5, 0.7, 1.0], t));
        }
        self.background
    }

    fn radiance(&self, origin: Vector, direction: Vector, least: f64, depth: i64) -> Vector {
        let Some(hit) = self.intersect(origin, direction, least) else {
            return self.beyond(direction);
        };
        let point = self.faults.rounded(add(origin, scaled(direction, hit.t)));
        let is_outside = dot(direction, hit.normal) < 0.0;
        let normal = if is_outside {
            hit.normal
        } else {
            scaled(hit.normal, -1.0)
        };
        match &self.objects[hit.object].1 {
            Material::Matte(paint) => {
                let color = match paint {
                    Paint::Color(color) => *color,
                    Paint::Texture { image } => self.texel(image, hit.uv),
                };
                let mut sum = self.ambient;
                for light in &self.lights {
                    sum = add(
                        sum,
                        scaled(self.light(light, point, normal), std::f64::consts::FRAC_1_PI),
                    );
                }
                [0, 1, 2].map(|k| color[k] * sum[k])
            }
            Material::Glass(index) => {
                let eta = if is_outside { 1.0 / index } else { *index };
                let cos = -dot(direction, normal);
                let squared = eta * eta * (1.0 - cos * cos);
                let mirrored = add(direction, scaled(normal, 2.0 * cos));
                let next = |to: Vector, weight: f64| {
                    let seen = match depth == self.max_depth {
                        true => self.beyond(to),
                        false => self.radiance(point, to, 1e-9, depth + 1),
                    };
                    scaled(seen, weight)
                };
                if squared >= 1.0 {
                    return next(mirrored, 1.0);
                }
                let inside = (1.0 - squared).sqrt();
                let [s, p] = [
                    (eta * cos - inside) / (eta * cos + inside),
                    (cos - eta * inside) / (cos + eta * inside),
                ];
                let reflected = 0.5 * (s * s + p * p);
                let to = add(scaled(direction, eta), scaled(normal, eta * cos - inside));
                add(next(mirrored, reflected), next(to, (1.0 - reflected) * eta * eta))
            }
        }
    }

    /// The irradiance from a light.
    fn light(&self, light: &Light, point: Vector, normal: Vector) -> Vector {
        let way = if light.is_point {
            from(point, light.place)
        } else {
            light.place
        };
        let squared = dot(way, way);
        let toward = unit(way);
        let cos = dot(toward, normal);
        if cos <= 0.0 {
            return [0.0; 3];
        }
        let (least, start) = match () {
            () if self.faults.has("epsilon") => (1e-3, point),
            () if self.faults.has("bias") => (1e-9, add(point, scaled(normal, 1e-3))),
            () if self.faults.has("small-bias") => (1e-9, add(point, scaled(normal, 1e-4))),
            () if self.faults.has("single") => {
                let largest = point.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
                let offset = 8.0 * f64::from(f32::EPSILON) * largest;
                (0.0, self.faults.rounded(add(point, scaled(normal, offset))))
            }
            () => (1e-9, point),
        };
        let shadowed = !self.faults.has("no-shadows")
            && (self.intersect(start, toward, least))
                .is_some_and(|hit| !light.is_point || hit.t < squared.sqrt());
        let falloff = if light.falls_off { squared } else { 1.0 };
        let part = light.cone.map_or(1.0, |(axis, [cutoff, beam])| {
            let angle = (-dot(toward, axis)).clamp(-1.0, 1.0).acos();
            match angle <= beam {
                true => 1.0,
                // As in glTF; by a sixth power, which is no hypothesis.
                false if self.faults.has("cosine-spot") || self.faults.has("steep-spot") => {
                    let from_edge = (angle.cos() - cutoff.cos()) / (beam.cos() - cutoff.cos());
                    let power = if self.faults.has("cosine-spot") { 2 } else { 6 };
                    from_edge.clamp(0.0, 1.0).powi(power)
                }
                false => ((cutoff - angle) / (cutoff - beam)).clamp(0.0, 1.0),
            }
        });
        scaled(light.power, if shadowed { 0.0 } else { part * cos / falloff })
    }

    fn texel(&self, image: &Image, [u, v]: [f64; 2]) -> Vector {
        let size = [image.width(), image.height()];
        let v = if self.faults.has("flipped-v") { v } else { 1.0 - v };
        let half = if self.faults.has("texel-corners") {
            0.0
        } else {
            0.5
        };
        let place = [u * size[0] as f64 - half, v * size[1] as f64 - half];
        let first = place.map(f64::floor);
        let part = [place[0] - first[0], place[1] - first[1]];
        let mut sum = [0.0; 3];
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let weight = [part[0], 1.0 - part[0]][1 - dx] * [part[1], 1.0 - part[1]][1 - dy];
            let at = |axis: usize, d: usize| {
                (first[axis] as i64 + d as i64).rem_euclid(size[axis] as i64) as usize
            };
            let index = at(1, dy) * size[0] + at(0, dx);
            let color =
                ["R", "G", "B"].map(|name| f64::from(image.channel(name).map_or(0.0, |plane| plane[index])));
            sum = add(sum, scaled(color, weight));
        }
        sum
    }
}

/// What is seen through a place of the image, in pixels from the top left corner.
fn seen(scene: &Scene, camera: &Table, [width, height]: [f64; 2], [x, y]: [f64; 2]) -> Vector {
    let view = camera
        .get("look_at")
        .and_then(Value::as_table)
        .cloned()
        .unwrap_or_default();
    let (origin, target) = (vector(&view["origin"]), vector(&view["target"]));
    let w = unit(from(target, origin));
    let u = unit(cross(get(&view, "up", vector, [0.0, 1.0, 0.0]), w));
    let v = cross(w, u);
    let [left, right, bottom, top] = match camera.get("window").and_then(Value::as_table) {
        Some(window) => {
            ["l", "r", "b", "t"].map(|side| number(&window[side]) / get(window, "d", number, 1.0))
        }
        None => {
            let half = (0.5 * get(camera, "fov", number, 45.0).to_radians()).tan();
            let along_y = text(camera, "fov_axis", "x") == "y" || scene.faults.has("fov-y");
            let [x, y] = match along_y {
                true => [half * width / height, half],
                false => [half, half * height / width],
            };
            [-x, x, -y, y]
        }
    };
    let [a, c] = [
        left + (right - left) * x / width,
        top - (top - bottom) * y / height,
    ];
    let direction = unit(add(add(scaled(u, a), scaled(v, c)), scaled(w, -1.0)));
    let near = if scene.faults.has("near-1") {
        1.0
    } else {
        get(camera, "near", number, 0.0)
    };
    let near = near / -dot(direction, w);
    if scene.faults.has("far-1000")
        && (scene.intersect(origin, direction, near)).is_some_and(|hit| -hit.t * dot(direction, w) > 1000.5)
    {
        return scene.beyond(direction);
    }
    scene.radiance(origin, direction, near, 0)
}

fn run(arguments: &[String]) -> Result<(), Problem> {
    let [source, output, faults @ ..] = arguments else {
        return Err("expected SCENE OUTPUT.pfm [FAULT]...".into());
    };
    let source = Path::new(source);
    let mut document: Table = std::fs::read_to_string(source)?.parse()?;
    if faults.iter().any(|fault| fault == "single") {
        document.iter_mut().for_each(|(_, value)| round_numbers(value));
    }
    let empty = Table::new();
    let table = |key: &str| document.get(key).and_then(Value::as_table).unwrap_or(&empty);
    let (film, camera) = (table("film"), table("camera"));
    only(
        camera,
        "a camera",
        &[
            "type",
            "look_at",
            "fov",
            "fov_axis",
            "window",
            "near",
            "near_kind",
        ],
    );
    if text(camera, "type", "") != "perspective" || text(camera, "near_kind", "planar") != "planar" {
        unsupported("another camera");
    }
    let scene = Scene::read(source, &document, Faults(faults.to_vec()))?;
    let side = |key: &str| get(film, key, |value| value.as_integer().unwrap_or(512), 512) as usize;
    let size = [side("width"), side("height")];
    let at = |x: f64, y: f64| seen(&scene, camera, size.map(|side| side as f64), [x, y]);
    let shift = match () {
        () if scene.faults.has("corner") => [0.0, 0.0],
        () if scene.faults.has("row") => [0.5, 1.5],
        () => [0.5, 0.5],
    };
    let mut random = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)?
        .as_nanos() as u64
        | 1;
    let mut jitter = || {
        // Marsaglia 2003, xorshift.
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        (random >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut rows = vec![vec![[0.0; 3]; size[0]]; size[1]];
    for (j, row) in rows.iter_mut().enumerate() {
        for (i, pixel) in row.iter_mut().enumerate() {
            let place = [i as f64 + shift[0], j as f64 + shift[1]];
            *pixel = match () {
                () if scene.faults.has("random") => at(i as f64 + jitter(), j as f64 + jitter()),
                () if scene.faults.has("gaussian") => {
                    // Standard deviation 1/2, cut at 3/2 pixels.
                    let (mut sum, mut total) = ([0.0; 3], 0.0);
                    for a in -6..=6 {
                        for b in -6..=6 {
                            let [x, y] = [f64::from(a) / 4.0, f64::from(b) / 4.0];
                            let weight = (-2.0 * (x * x + y * y)).exp();
                            sum = add(sum, scaled(at(place[0] + x, place[1] + y), weight));
                            total += weight;
                        }
                    }
                    scaled(sum, 1.0 / total)
                }
                () => at(place[0], place[1]),
            };
        }
    }
    if scene.faults.has("columns") {
        rows.iter_mut().for_each(|row| row.reverse());
    }
    // The last row comes first in a PFM file.
    if !scene.faults.has("rows") {
        rows.reverse();
    }
    let mut bytes = format!("PF\n{} {}\n-1.0\n", size[0], size[1]).into_bytes();
    for mut color in rows.into_iter().flatten() {
        if scene.faults.has("bgr") {
            color.reverse();
        }
        if scene.faults.has("srgb") {
            color = color.map(|c| {
                if c <= 0.003_130_8 {
                    12.92 * c
                } else {
                    1.055 * c.powf(1.0 / 2.4) - 0.055
                }
            });
        }
        if scene.faults.has("no-pi") {
            color = scaled(color, std::f64::consts::PI);
        }
        color
            .into_iter()
            .for_each(|value| bytes.extend((value as f32).to_le_bytes()));
    }
    std::fs::write(output, bytes)?;
    Ok(())
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("{problem}");
            ExitCode::FAILURE
        }
    }
}
