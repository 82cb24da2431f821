//! Integrator, sensor, sampler and emitters.

use super::material::{LIT, TRACED};
use super::node::{Item, Node};
use super::texture::is_bitmap;
use super::{Exporter, PLAIN, looking, table};
use crate::image_size::image_size;
use std::collections::BTreeSet;
use std::f64::consts::PI;
use toml::{Table, Value};
use whitstone_core::transform_steps::rotation;
use whitstone_core::{DAffine3, DMat3, DVec3};

/// Distance of the near clip plane in metres, which Mitsuba needs.
const NEAR: f64 = 1e-3;
/// Distance of the far clip plane in metres: there is none in the model.
const FAR: f64 = 1e7;
/// Fewest samples of a pixel: Mitsuba's are random.
const FEWEST_SAMPLES: i64 = 16;

impl<'a> Exporter<'a> {
    /// The types of all materials that shapes use.
    fn material_types(&self) -> BTreeSet<&'a str> {
        let mut shapes = table::tables(self.document, "shape");
        for group in table::table(self.document, "group")
            .into_iter()
            .flat_map(|groups| groups.values())
        {
            shapes.extend(
                group
                    .as_table()
                    .into_iter()
                    .flat_map(|group| table::tables(group, "shape")),
            );
        }
        let mut found = BTreeSet::new();
        let mut pending = Vec::new();
        for shape in shapes {
            match shape.get("material") {
                Some(value) => pending.push((value, 0)),
                None if table::kind(shape) == "instance" => {}
                None => drop(found.insert("matte")),
            }
        }
        let mut seen = BTreeSet::new();
        while let Some((value, depth)) = pending.pop() {
            if let Value::String(id) = value
                && !seen.insert(id.as_str())
            {
                continue;
            }
            let Some(material) = self.plugin("material", value) else {
                continue;
            };
            found.insert(table::kind(material));
            let reflects = |key: &str| {
                material
                    .get(key)
                    .is_some_and(|k| table::as_color(k) != Some([0.0; 3]))
            };
            if reflects("k_refl") || reflects("k_refr") {
                found.insert("mirror");
            }
            if depth < 16 {
                let keys = ["material", "a", "b", "front", "back"];
                pending.extend(
                    keys.into_iter()
                        .filter_map(|key| material.get(key))
                        .map(|inner| (inner, depth + 1)),
                );
            }
        }
        found
    }

    pub(super) fn integrator(&mut self) -> Option<Node> {
        let empty = Table::new();
        let settings = table::table(self.document, "integrator").unwrap_or(&empty);
        let kind = match table::kind(settings) {
            "" => "whitted",
            kind => kind,
        };
        match table::text(settings, "shadows") {
            Some("filtered") => self.note("[integrator] shadows", "filtered"),
            Some("none") => self.note("[integrator] shadows", "none"),
            _ => {}
        }
        if table::number(settings, "light_cutoff").is_some_and(|cutoff| cutoff > 0.0) {
            self.note("[integrator] light_cutoff", "integrator");
        }
        let types = self.material_types();
        let lit = types.iter().any(|kind| LIT.contains(kind));
        self.lit = lit;
        let traced = types.iter().any(|kind| TRACED.contains(kind));
        if kind != "whitted" || !traced {
            if kind == "rasterizer" {
                self.note("[integrator] rasterizer", "integrator");
            }
            return Some(Node::new("integrator", "direct"));
        }
        if lit {
            self.note("[integrator] whitted", "integrator");
        }
        let depth = table::number(settings, "max_depth").unwrap_or(6.0) as i64 + 2;
        let plugin = if self.media { "volpathmis" } else { "path" };
        let node = Node::new("integrator", plugin)
            .with("max_depth", Item::Integer(depth))
            .with("rr_depth", Item::Integer(depth + 1));
        Some(node)
    }

    fn sampler(&mut self) -> Node {
        let empty = Table::new();
        let settings = table::table(self.document, "sampler").unwrap_or(&empty);
        self.note("[sampler]", "sampler");
        let whole =
            |key: &str, default: i64| table::number(settings, key).map_or(default, |value| value as i64);
        let count = match table::kind(settings) {
            "grid" | "stratified" => whole("samples_per_axis", 2).pow(2),
            "sobol" => whole("samples", 4),
            "adaptive" => whole("samples", 256),
            _ => 1,
        };
        Node::new("sampler", "independent").with("sample_count", Item::Integer(count.max(FEWEST_SAMPLES)))
    }

    pub(super) fn sensor(&mut self) -> Option<Node> {
        let film = table::table(self.document, "film");
        let size = |key: &str| film.and_then(|film| table::number(film, key)).unwrap_or(512.0);
        let (width, height) = (size("width"), size("height"));
        if film.is_some_and(|film| film.contains_key("aovs") || film.contains_key("paths")) {
            self.note("[film] layers", "film");
        }
        let camera = table::table(self.document, "camera")?;
        let kind = table::kind(camera);
        if !["perspective", "thin_lens", "orthographic"].contains(&kind) {
            self.note("[camera] environment", "camera");
            return None;
        }
        let look_at = table::table(camera, "look_at")?;
        let origin = table::vector(look_at, "origin")?;
        let target = table::vector(look_at, "target")?;
        let up = table::vector(look_at, "up").unwrap_or(DVec3::Y);
        let forward = (target - origin).try_normalize()?;
        let right = forward.cross(up).try_normalize()?;
        // Mitsuba's cameras have +x to the left.
        let axes = DMat3::from_cols(-right, right.cross(forward), forward);
        let near = table::number(camera, "near").unwrap_or(0.0);
        if table::text(camera, "near_kind") == Some("spherical") && near > 0.0 {
            self.note("[camera] near_kind", "camera");
        }
        let [l, r, b, t, d] = window(camera, kind, width, height);
        let square = ((r - l) * height - (t - b) * width).abs() <= 1e-9 * (r - l) * height;
        let aperture = table::number(camera, "aperture").unwrap_or(0.0);
        let mut node = if kind == "orthographic" {
            let centre = DAffine3::from_translation(DVec3::new(-(l + r) / 2.0, (b + t) / 2.0, 0.0));
            let scale = DVec3::new((r - l) / 2.0, (t - b) / 2.0 * width / height, 1.0);
            // The rays start where the model's do.
            let start = origin + forward * (near - NEAR);
            let world = DAffine3::from_mat3_translation(axes, start) * centre * DAffine3::from_scale(scale);
            Node::new("sensor", "orthographic")
                .with("near_clip", Item::Float(NEAR))
                .with("to_world", Item::Transform(world))
        } else {
            if !square {
                self.note("[camera] pixels that are not square", "camera");
            }
            if near < 0.0 {
                self.note("[camera] negative near", "camera");
            }
            let lens = kind == "thin_lens" && aperture > 0.0;
            let near = if lens || near <= 0.0 { NEAR } else { near };
            let fov = 2.0 * libm::atan((r - l) / 2.0 / d).to_degrees();
            let mut node = Node::new("sensor", if lens { "thinlens" } else { "perspective" })
                .with("fov", Item::Float(fov))
                .with("fov_axis", Item::Text("x".into()))
                .with("near_clip", Item::Float(near))
                .with(
                    "to_world",
                    Item::Transform(DAffine3::from_mat3_translation(axes, origin)),
                );
            let (x, y) = ((l + r) / 2.0 / (r - l), -(b + t) / 2.0 / (t - b));
            if lens {
                let distance = table::number(camera, "focus_distance").unwrap_or(1.0);
                node.push("aperture_radius", Item::Float(aperture));
                node.push("focus_distance", Item::Float(distance));
                if x != 0.0 || y != 0.0 {
                    self.note("[camera] window of a lens", "camera");
                }
            } else if x != 0.0 || y != 0.0 {
                node.push("principal_point_offset_x", Item::Float(x));
                node.push("principal_point_offset_y", Item::Float(y));
            }
            node
        };
        node.push("far_clip", Item::Float(FAR));
        let film = Node::new("film", "hdrfilm")
            .with("width", Item::Integer(width as i64))
            .with("height", Item::Integer(height as i64))
            .with("pixel_format", Item::Text("rgb".into()))
            .with("component_format", Item::Text("float32".into()))
            .containing(Node::new("rfilter", "box"));
        let sampler = self.sampler();
        Some(node.containing(film).containing(sampler))
    }

    /// All lights but area lights. Call it after [`Self::integrator`].
    pub(super) fn emitters(&mut self) -> Vec<Node> {
        let lights = table::tables(self.document, "light");
        let mut nodes = Vec::new();
        // Mitsuba has at most one emitter at infinity that is no `directional`.
        let mut constant: Option<[f64; 3]> = None;
        let mut map = None;
        for (place, light) in lights.into_iter().enumerate() {
            let name = format!("light[{place}]");
            let color = match table::kind(light) {
                "background" => Some(table::color(light, "radiance", [0.0; 3])),
                "environment" => light.get("radiance").and_then(table::as_color),
                _ => None,
            };
            match (table::kind(light), color) {
                (kind, Some(color)) => {
                    if kind == "environment" {
                        self.note("[[light]] environment", &name);
                    } else if self.lit && color != [0.0; 3] {
                        self.note("[[light]] background", &name);
                    }
                    let sum = constant.unwrap_or([0.0; 3]);
                    constant = Some([0, 1, 2].map(|channel| sum[channel] + color[channel]));
                }
                ("environment", None) if map.is_some() => self.note("[[light]] several environments", &name),
                ("environment", None) => map = self.environment(light, &name),
                _ => nodes.extend(self.emitter(light, &name)),
            }
        }
        let constant = constant.filter(|color| *color != [0.0; 3]);
        match (map, constant) {
            (Some(map), constant) => {
                if constant.is_some() {
                    self.note("[[light]] several environments", "backgrounds");
                }
                nodes.push(map);
            }
            (None, Some(color)) => {
                nodes.push(Node::new("emitter", "constant").with("radiance", Item::Color(color)));
            }
            (None, None) => {}
        }
        nodes
    }

    fn emitter(&mut self, light: &'a Table, name: &str) -> Option<Node> {
        let color = |key: &str| Item::Color(table::color(light, key, [1.0; 3]));
        let falloff = table::text(light, "falloff") == Some("none");
        let position = table::vector(light, "position").unwrap_or(DVec3::ZERO);
        let target = table::vector(light, "target").unwrap_or(position + DVec3::Z);
        match table::kind(light) {
            "point" | "spot" if falloff => {
                self.note("[[light]] falloff none", name);
                None
            }
            "point" => Some(
                Node::new("emitter", "point")
                    .with("position", Item::Point(position))
                    .with("intensity", color("intensity")),
            ),
            "directional" => Some(
                Node::new("emitter", "directional")
                    .with("direction", Item::Vector(table::vector(light, "direction")?))
                    .with("irradiance", color("irradiance")),
            ),
            "spot" => {
                let cutoff = table::number(light, "cutoff_angle").unwrap_or(20.0);
                let beam = table::number(light, "beam_width").unwrap_or(0.75 * cutoff);
                let mut world = looking(position, target - position);
                let mut intensity = table::color(light, "intensity", [1.0; 3]);
                let mut texture = None;
                if let Some(image) = light.get("image") {
                    let up = table::vector(light, "up").unwrap_or(DVec3::Y);
                    let forward = (target - position).try_normalize()?;
                    let right = forward.cross(up).try_normalize()?;
                    // Mitsuba's u grows along x, its v along y, and v of its images points down.
                    let axes = DMat3::from_cols(right, forward.cross(right), forward);
                    world = DAffine3::from_mat3_translation(axes, position);
                    let flipped = super::Sides {
                        flip_v: true,
                        ..PLAIN
                    };
                    match self.texture(image, flipped, name) {
                        Item::Color(tint) => intensity = [0, 1, 2].map(|k| intensity[k] * tint[k]),
                        item => texture = Some(item),
                    }
                }
                let mut node = Node::new("emitter", "spot")
                    .with("to_world", Item::Transform(world))
                    .with("intensity", Item::Color(intensity))
                    .with("cutoff_angle", Item::Float(cutoff))
                    .with("beam_width", Item::Float(beam));
                if let Some(texture) = texture {
                    node.push("texture", texture);
                }
                Some(node)
            }
            "projector" => self.projector(light, name, position, target - position),
            "area" => None,
            "ambient" => {
                self.note("[[light]] ambient", name);
                None
            }
            _ => {
                self.note("[*] plugins of third parties", name);
                None
            }
        }
    }

    fn projector(&mut self, light: &'a Table, name: &str, position: DVec3, forward: DVec3) -> Option<Node> {
        let up = table::vector(light, "up").unwrap_or(DVec3::Y);
        let forward = forward.try_normalize()?;
        let right = forward.cross(up).try_normalize()?;
        let aspect = table::number(light, "aspect").unwrap_or(1.0);
        let image = light.get("image")?;
        let file = self
            .plugin("texture", image)
            .and_then(|texture| table::text(texture, "file"));
        let size = file.and_then(|file| image_size(&self.base.join(file)));
        let own = size.map_or(1.0, |(width, height)| f64::from(width) / f64::from(height));
        // Mitsuba's frame has the shape of the image; v of its images points down.
        let axes = DMat3::from_cols(-right, right.cross(forward) * (own / aspect), forward);
        let flipped = super::Sides {
            flip_v: true,
            ..PLAIN
        };
        let texture = self.texture(image, flipped, name);
        let intensity = table::color(light, "intensity", [1.0; 3]);
        if intensity.iter().any(|value| *value != intensity[0]) {
            self.note("[[light]] projector with a coloured intensity", name);
        }
        let mean = intensity.iter().sum::<f64>() / 3.0;
        let node = Node::new("emitter", "projector")
            .with("irradiance", texture)
            .with("scale", Item::Float(mean / PI))
            .with("fov", Item::Float(table::number(light, "fov").unwrap_or(45.0)))
            .with(
                "to_world",
                Item::Transform(DAffine3::from_mat3_translation(axes, position)),
            );
        Some(node)
    }

    fn environment(&mut self, light: &'a Table, name: &str) -> Option<Node> {
        self.note("[[light]] environment", name);
        let radiance = light.get("radiance");
        let texture = radiance.and_then(|value| self.plugin("texture", value));
        let plain = |texture: &Table| {
            let keys = ["scale", "offset", "mapping", "channel"];
            table::kind(texture) == "image" && keys.iter().all(|key| !texture.contains_key(*key))
        };
        let Some(file) = texture
            .filter(|texture| plain(texture))
            .and_then(|texture| table::text(texture, "file"))
            .filter(|file| is_bitmap(file))
        else {
            self.note("[[light]] environment that is no plain image", name);
            return None;
        };
        // The model has -z in the middle of the image, Mitsuba at its borders.
        let turn = DAffine3::from_mat3(rotation(DVec3::Y, 180.0));
        let node = Node::new("emitter", "envmap")
            .with("filename", Item::Text(self.file(file)))
            .with("to_world", Item::Transform(turn));
        Some(node)
    }
}

/// l, r, b, t and d of a camera.
fn window(camera: &Table, kind: &str, width: f64, height: f64) -> [f64; 5] {
    if let Some(window) = table::table(camera, "window") {
        let key = |key: &str, default: f64| table::number(window, key).unwrap_or(default);
        return [
            key("l", -1.0),
            key("r", 1.0),
            key("b", -1.0),
            key("t", 1.0),
            key("d", 1.0),
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
    [-half_x, half_x, -half_y, half_y, 1.0]
}
