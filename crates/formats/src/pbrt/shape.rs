//! Shapes, and the area lights on them.

use super::params::{Args, Kind};
use super::scene::{Area, Importer};
use super::token::At;
use crate::document::{color, numbers, transform, typed};
use crate::files::{self, shorten};
use crate::mesh_file;
use crate::mitsuba::shape::{similar, similar_disk};
use std::f64::consts::PI;
use toml::{Table, Value};
use whitstone_core::{DAffine3, DMat3, DVec3};

/// Most triangles that a `trianglemesh` or `bilinearmesh` has: each becomes a shape.
const MAX_TRIANGLES: usize = 64;
/// Largest mesh file in bytes.
const MAX_MESH_BYTES: u64 = 4 << 30;
/// Most triangles of a mesh that lights, by the model.
const MAX_LIGHT_TRIANGLES: u64 = 4096;
/// Relative distance below which corners count as those of a parallelogram or as in a plane.
const FLAT: f64 = 1e-6;

const SHAPES: [&str; 6] = [
    "sphere",
    "disk",
    "cylinder",
    "trianglemesh",
    "plymesh",
    "bilinearmesh",
];

/// A surface that lights.
struct Light {
    kind: &'static str,
    map: DAffine3,
    /// Its area in m², if it is known.
    area: Option<f64>,
}

/// The shapes of the result for a shape.
#[derive(Default)]
struct Pieces {
    tables: Vec<Table>,
    lights: Vec<Light>,
    /// Whether pbrt's normal is on the other side.
    reversed: bool,
    /// Whether (u, v) are not those of pbrt.
    other_uv: bool,
}

impl Importer<'_> {
    pub(super) fn shape(&mut self, plugin: &str, mut args: Args) {
        let at = args.at;
        let map = self.placed();
        if !self.can_invert(&map) {
            return self.error(at, "the transform of a shape cannot be inverted or is too large");
        }
        let pieces = match plugin {
            "sphere" => self.sphere(&mut args, &map),
            "disk" => self.disk(&mut args, &map),
            "cylinder" => self.cylinder(&mut args, &map),
            "trianglemesh" => self.triangles(&mut args, &map),
            "bilinearmesh" => self.patches(&mut args, &map),
            "plymesh" => self.ply(&mut args, &map),
            "loopsubdiv" => {
                let fault = self.fault(at, "the shape \"loopsubdiv\" is not supported");
                let help = "write the control mesh as a PLY file, and use a mesh with subdivision";
                return self.report(fault.with_help(help));
            }
            _ => return self.unknown_plugin("shape", plugin, &SHAPES, at),
        };
        let alpha = self.texture_or_number(&mut args, "alpha", 1.0);
        self.done(args);
        let Some(pieces) = pieces else {
            return;
        };
        let look = self.state.material.clone();
        // Without a material the surface has pbrt's default.
        if look.as_ref().is_some_and(|look| look.value.is_none()) {
            if let Some(area) = &self.state.area {
                let at = area.at;
                self.note("area light on an interface", at);
            }
            return;
        }
        let mut material = look.as_ref().and_then(|look| look.value.clone());
        if pieces.other_uv && look.as_ref().is_some_and(|look| look.uv) {
            self.note("(u, v) of a disk or patch", at);
        }
        if pieces.reversed {
            material = material.map(|value| self.reversed(value));
        }
        let area = self.state.area.clone();
        let visible = alpha.0 != Value::Float(0.0);
        if let Some(area) = &area {
            let radiance = self.add_area(area, &pieces, at);
            if visible {
                let emits_inside = pieces.reversed && !area.two_sided;
                material = Some(self.emissive(area, radiance, material));
                if emits_inside {
                    material = material.map(|value| self.inside_out(value));
                }
            }
        }
        if !visible {
            return;
        }
        let opaque = matches!(alpha.0, Value::Float(value) if value >= 1.0);
        if !opaque {
            material = Some(self.masked(material, alpha.0, at));
        }
        for mut table in pieces.tables {
            if let Some(material) = &material {
                table.insert("material".to_owned(), material.clone());
            }
            self.push_shape(table, at);
        }
    }

    /// A two-sided material with its sides swapped.
    fn inside_out(&mut self, value: Value) -> Value {
        let Value::String(id) = &value else {
            return value;
        };
        let Some(mut table) = self.tables.get(id).cloned() else {
            return value;
        };
        if let (Some(front), Some(back)) = (table.remove("front"), table.remove("back")) {
            table.insert("front".to_owned(), back);
            table.insert("back".to_owned(), front);
        }
        self.share_material("light", table)
    }

    /// Adds the lights of a surface; its radiance.
    fn add_area(&mut self, area: &Area, pieces: &Pieces, at: At) -> [f64; 3] {
        let mut radiance = area.radiance;
        if let Some(power) = area.power {
            let total: Option<f64> = pieces.lights.iter().map(|light| light.area).sum();
            // pbrt gives the power to each triangle or patch.
            let sides = if area.two_sided { 2.0 } else { 1.0 };
            match total.filter(|total| *total > 0.0 && pieces.tables.len() == 1) {
                Some(total) => radiance = radiance.map(|value| value * power / (total * PI * sides)),
                None => self.error(area.at, "\"power\" is supported on single shapes only"),
            }
        }
        if pieces.lights.is_empty() || self.group.is_some() || (pieces.reversed && !area.two_sided) {
            self.note("area light without a light", at);
            return radiance;
        }
        self.note("AreaLightSource", at);
        for light in &pieces.lights {
            let mut maps = vec![light.map];
            if area.two_sided {
                match light.kind {
                    "rectangle" | "disk" => {
                        maps.push(light.map * DAffine3::from_scale(DVec3::new(1.0, 1.0, -1.0)));
                    }
                    _ => self.note("twosided", at),
                }
            }
            for map in maps {
                let kind = ("shape", Value::String(light.kind.into()));
                let mut table = typed("area", [kind, ("radiance", color(radiance))]);
                if light.kind == "mesh"
                    && let Some(file) = pieces.tables.first().and_then(|table| table.get("file"))
                {
                    table.insert("file".to_owned(), file.clone());
                }
                if map != DAffine3::IDENTITY {
                    table.insert("transform".to_owned(), transform(&map));
                }
                self.push_light(table, at);
            }
        }
        radiance
    }

    /// Whether a quadric is whole.
    fn whole(&mut self, args: &mut Args, missing: bool) {
        let angle = self.number(args, "phimax", 360.0);
        if missing || angle < 360.0 {
            self.error(
                args.at,
                format!("a part of {} is not supported, only the whole", args.what),
            );
        }
    }

    fn radius(&mut self, args: &mut Args) -> f64 {
        let radius = self.number(args, "radius", 1.0);
        if radius <= 0.0 {
            self.error(args.at, "\"radius\" must be above 0");
            return 1.0;
        }
        radius
    }

    fn sphere(&mut self, args: &mut Args, map: &DAffine3) -> Option<Pieces> {
        let radius = self.radius(args);
        let low = self.number(args, "zmin", -radius);
        let high = self.number(args, "zmax", radius);
        self.whole(args, low > -radius || high < radius);
        let Some(matrix) = similar(&map.matrix3) else {
            self.error(args.at, "the transform of a sphere must scale all axes equally");
            return None;
        };
        let map = DAffine3::from_mat3_translation(matrix, map.translation);
        let mut table = typed("sphere", []);
        if radius != 1.0 {
            table.insert("radius".to_owned(), Value::Float(radius));
        }
        self.place(&mut table, &map, args.at);
        let unit = map * DAffine3::from_scale(DVec3::splat(radius));
        self.bound(&unit, DVec3::NEG_ONE, DVec3::ONE);
        let light = Light {
            kind: "sphere",
            map: unit,
            area: Some(4.0 * PI * unit.matrix3.x_axis.length_squared()),
        };
        Some(Pieces {
            tables: vec![table],
            lights: vec![light],
            reversed: self.state.reverse,
            other_uv: false,
        })
    }

    fn disk(&mut self, args: &mut Args, map: &DAffine3) -> Option<Pieces> {
        let radius = self.radius(args);
        let height = self.number(args, "height", 0.0);
        let inner = self.number(args, "innerradius", 0.0);
        self.whole(args, inner != 0.0);
        let Some(matrix) = similar_disk(&map.matrix3) else {
            self.error(args.at, "the transform of a disk must scale x and y equally");
            return None;
        };
        let map = DAffine3::from_mat3_translation(matrix, map.translation)
            * DAffine3::from_translation(DVec3::new(0.0, 0.0, height));
        let side = if self.state.reverse { -1.0 } else { 1.0 };
        let unit = map * DAffine3::from_scale(DVec3::new(radius, radius, side));
        let mut table = typed("disk", []);
        self.place(&mut table, &unit, args.at);
        self.bound(&unit, DVec3::new(-1.0, -1.0, 0.0), DVec3::new(1.0, 1.0, 0.0));
        let light = Light {
            kind: "disk",
            map: unit,
            area: Some(PI * unit.matrix3.x_axis.length_squared()),
        };
        Some(Pieces {
            tables: vec![table],
            lights: vec![light],
            reversed: false,
            other_uv: true,
        })
    }

    fn cylinder(&mut self, args: &mut Args, map: &DAffine3) -> Option<Pieces> {
        let radius = self.radius(args);
        let [a, b] = [("zmin", -1.0), ("zmax", 1.0)].map(|(name, default)| self.number(args, name, default));
        let (low, high) = (a.min(b), a.max(b));
        self.whole(args, false);
        if low == high {
            self.error(args.at, "\"zmin\" and \"zmax\" must differ");
        }
        let mut table = typed(
            "cylinder",
            [
                ("radius", Value::Float(radius)),
                ("z", numbers([low, high])),
                ("caps", Value::Boolean(false)),
            ],
        );
        self.place(&mut table, map, args.at);
        self.bound(
            map,
            DVec3::new(-radius, -radius, low),
            DVec3::new(radius, radius, high),
        );
        Some(Pieces {
            tables: vec![table],
            reversed: self.state.reverse,
            ..Pieces::default()
        })
    }

    /// `P` and `indices` in groups of `N` corners.
    fn corners<const N: usize>(&mut self, args: &mut Args) -> Option<(Vec<DVec3>, Vec<[usize; N]>)> {
        let points = self.points(args, "P", Kind::Point3);
        let indices = self.list(args, "indices", &[Kind::Integer]);
        let Some(points) = points else {
            self.error(args.at, format!("{} needs \"point3 P\"", args.what));
            return None;
        };
        let indices = match indices {
            Some(indices) => indices,
            None if points.len() == N => (0..N).map(|index| index as f64).collect(),
            None => {
                self.error(args.at, format!("{} needs \"integer indices\"", args.what));
                return None;
            }
        };
        let count = points.len();
        if !indices.len().is_multiple_of(N) {
            self.error(
                args.at,
                format!("the number of \"indices\" is not a multiple of {N}"),
            );
            return None;
        }
        if let Some(wrong) = indices.iter().find(|index| !(0.0..count as f64).contains(*index)) {
            self.error(
                args.at,
                format!("there is no point {wrong}: \"P\" has {count} points"),
            );
            return None;
        }
        let triangles = if N == 3 { 1 } else { 2 };
        if indices.len() / N * triangles > MAX_TRIANGLES {
            let message = format!("a mesh in the file has at most {MAX_TRIANGLES} triangles");
            let fault = self.fault(args.at, message);
            self.report(fault.with_help("write larger meshes as PLY files, for example with `pbrt --toply`"));
            return None;
        }
        let groups: &[[f64; N]] = indices.as_chunks().0;
        let groups = groups
            .iter()
            .map(|group| group.map(|index| index as usize))
            .collect();
        Some((points, groups))
    }

    /// Normals or texture coordinates, one for each point.
    fn per_point<T>(
        &mut self,
        args: &Args,
        values: Option<Vec<T>>,
        name: &str,
        count: usize,
    ) -> Option<Vec<T>> {
        let values = values?;
        if values.len() == count {
            return Some(values);
        }
        let message = format!(
            "expected {count} values of \"{name}\", one for each point, found {}",
            values.len()
        );
        self.error(args.at, message);
        None
    }

    fn normals_and_uvs(
        &mut self,
        args: &mut Args,
        count: usize,
    ) -> (Option<Vec<DVec3>>, Option<Vec<[f64; 2]>>) {
        let normals = self.points(args, "N", Kind::Normal);
        let uvs = self.list(args, "uv", &[Kind::Point2]);
        let uvs = uvs.map(|uvs| uvs.as_chunks().0.to_vec());
        args.ignore(&["S", "faceIndices"]);
        (
            self.per_point(args, normals, "N", count),
            self.per_point(args, uvs, "uv", count),
        )
    }

    fn triangles(&mut self, args: &mut Args, map: &DAffine3) -> Option<Pieces> {
        let (points, triangles) = self.corners::<3>(args)?;
        let (normals, uvs) = self.normals_and_uvs(args, points.len());
        let mut pieces = Pieces::default();
        // pbrt takes the side from the normals, if there are any, else from the winding.
        let reverse = self.state.reverse;
        let mut turned = Vec::new();
        for corners in triangles {
            let [a, b, c] = corners.map(|corner| points[corner]);
            let across = (b - a).cross(c - a);
            let shading: Option<[DVec3; 3]> = normals.as_ref().map(|normals| {
                corners.map(|corner| {
                    if reverse {
                        -normals[corner]
                    } else {
                        normals[corner]
                    }
                })
            });
            let outward = match &shading {
                Some(shading) => across.dot(shading.iter().sum()) >= 0.0,
                None => !reverse,
            };
            let order = if outward { [0, 1, 2] } else { [0, 2, 1] };
            let pick =
                |values: [DVec3; 3]| Value::Array(order.map(|i| numbers(values[i].to_array())).to_vec());
            let mut table = typed("triangle", [("vertices", pick([a, b, c]))]);
            if let Some(shading) = shading {
                if shading.iter().any(|normal| normal.try_normalize().is_none()) {
                    self.error(args.at, "a normal of a triangle must not have length zero");
                }
                table.insert("normals".to_owned(), pick(shading));
            }
            let uv = match &uvs {
                Some(uvs) => corners.map(|corner| uvs[corner]),
                None => [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]],
            };
            let uv = Value::Array(order.map(|i| numbers(uv[i])).to_vec());
            table.insert("uvs".to_owned(), uv);
            self.place(&mut table, map, args.at);
            for point in [a, b, c] {
                self.bound(map, point, point);
            }
            pieces.tables.push(table);
            turned.push(order.map(|i| [a, b, c][i]));
        }
        // Two triangles of a parallelogram light as a rectangle.
        if let [first, second] = turned[..]
            && let Some(rectangle) = parallelogram(&first, &second)
        {
            pieces.lights.push(flat(map * rectangle));
        }
        Some(pieces)
    }

    fn patches(&mut self, args: &mut Args, map: &DAffine3) -> Option<Pieces> {
        if args.has("emissionfilename") {
            args.ignore(&["emissionfilename"]);
            self.error(args.at, "\"emissionfilename\" is not supported");
        }
        let (points, patches) = self.corners::<4>(args)?;
        let (normals, uvs) = self.normals_and_uvs(args, points.len());
        let mut pieces = Pieces::default();
        if normals.is_some() {
            self.note("N of bilinearmesh", args.at);
        }
        for corners in patches {
            let [p00, p10, p01, p11] = corners.map(|corner| points[corner]);
            let size = (p11 - p00).length().max((p10 - p01).length());
            let uv = uvs.as_ref().map(|uvs| corners.map(|corner| uvs[corner]));
            let plain = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
            let swapped = [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]];
            let is_swapped = uv == Some(swapped);
            pieces.other_uv |= !is_swapped && uv.is_some_and(|uv| uv != plain);
            let (x, y) = ((p10 - p00) / 2.0, (p01 - p00) / 2.0);
            let Some(z) = x.cross(y).try_normalize() else {
                self.error(args.at, "a bilinear patch without an area is not supported");
                return None;
            };
            let side = if self.state.reverse { -1.0 } else { 1.0 };
            if (p10 + p01 - p00 - p11).length() <= FLAT * size {
                let matrix = if is_swapped {
                    DMat3::from_cols(y, x, z * side)
                } else {
                    DMat3::from_cols(x, y, z * side)
                };
                let rectangle = map * DAffine3::from_mat3_translation(matrix, (p10 + p01) / 2.0);
                let mut table = typed("rectangle", []);
                self.place(&mut table, &rectangle, args.at);
                pieces.tables.push(table);
                pieces.lights.push(flat(rectangle));
            } else if (p11 - p00).dot(z).abs() <= 1e-9 * size {
                pieces.other_uv = true;
                let mut order = [p00, p10, p11, p01];
                if self.state.reverse {
                    order.reverse();
                }
                let vertices = Value::Array(order.map(|point| numbers(point.to_array())).to_vec());
                let mut table = typed("polygon", [("vertices", vertices)]);
                self.place(&mut table, map, args.at);
                pieces.tables.push(table);
            } else {
                let fault = self.fault(args.at, "a bilinear patch that is not flat is not supported");
                self.report(fault.with_help("convert it to triangles in a PLY file"));
                return None;
            }
            for point in [p00, p10, p01, p11] {
                self.bound(map, point, point);
            }
        }
        // The lights of some patches would be those of all.
        if pieces.lights.len() != pieces.tables.len() {
            pieces.lights.clear();
        }
        Some(pieces)
    }

    fn ply(&mut self, args: &mut Args, map: &DAffine3) -> Option<Pieces> {
        if args.has("displacement") {
            args.ignore(&["displacement", "edgelength"]);
            self.note("displacement of plymesh", args.at);
        }
        let named = self.file(args, "filename")?;
        let extension = named.path.extension().unwrap_or_default();
        if !extension.eq_ignore_ascii_case("ply") {
            let fault = self.fault(args.at, "expected a file that ends in .ply");
            self.report(fault.with_help("uncompress .ply.gz files with gunzip"));
            return None;
        }
        let info = match self.meshes.get(&named.path) {
            Some(info) => *info,
            None => match files::read(&named.path, MAX_MESH_BYTES) {
                Ok(bytes) => {
                    let info = mesh_file::inspect_ply(&bytes);
                    self.meshes.insert(named.path.clone(), info);
                    info
                }
                Err(problem) => {
                    let name = shorten(&named.relative);
                    self.error(args.at, format!("cannot read \"{name}\": {problem}"));
                    return None;
                }
            },
        };
        let mut table = typed("mesh", [("file", Value::String(named.relative))]);
        self.place(&mut table, map, args.at);
        self.bound(map, info.part.low, info.part.high);
        let lights = info.triangles <= MAX_LIGHT_TRIANGLES;
        let light = Light {
            kind: "mesh",
            map: *map,
            area: None,
        };
        Some(Pieces {
            tables: vec![table],
            lights: Vec::from_iter(lights.then_some(light)),
            // As of triangles, the normals decide.
            reversed: self.state.reverse != info.turned,
            other_uv: false,
        })
    }
}

/// A rectangle that lights.
fn flat(map: DAffine3) -> Light {
    let [x, y] = [map.matrix3.x_axis, map.matrix3.y_axis];
    Light {
        kind: "rectangle",
        map,
        area: Some(4.0 * x.cross(y).length()),
    }
}

/// The rectangle shape that two triangles with one winding form, if they form a parallelogram.
fn parallelogram(first: &[DVec3; 3], second: &[DVec3; 3]) -> Option<DAffine3> {
    for start in 0..3 {
        // The corner opposite of the shared edge.
        let [a, b, c] = [0, 1, 2].map(|i| first[(start + i) % 3]);
        let size = (b - c).length();
        let fourth = second.iter().find(|point| **point != b && **point != c)?;
        let shares = second.contains(&b) && second.contains(&c);
        if !shares || (b + c - a - *fourth).length() > FLAT * size {
            continue;
        }
        let (x, y) = ((b - a) / 2.0, (c - a) / 2.0);
        let z = x.cross(y).try_normalize()?;
        let across = (second[1] - second[0]).cross(second[2] - second[0]);
        if across.dot(z) <= 0.0 {
            return None;
        }
        let matrix = DMat3::from_cols(x, y, z);
        return Some(DAffine3::from_mat3_translation(matrix, (b + c) / 2.0));
    }
    None
}
