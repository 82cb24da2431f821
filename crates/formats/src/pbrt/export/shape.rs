//! Shapes and their meshes.

use super::{Area, Exporter, Pattern, floats, integers, list, parameter, quoted, rgb, table, text};
use crate::files::save;
use crate::triangles::{self, Missing};
use toml::{Table, Value};
use whitstone_core::{DAffine3, DVec3, FormatError};

/// Half the side in metres of the square that replaces an infinite plane.
const PLANE: f64 = 1e5;

/// The model's rectangle.
pub(super) const RECTANGLE: &str = "\"bilinearmesh\" \"point3 P\" [-1 -1 0  1 -1 0  -1 1 0  1 1 0]";

impl<'a> Exporter<'a> {
    /// Writes a shape; `areas`: the lights that may be on it, none in a group.
    pub(super) fn shape(&mut self, shape: &'a Table, name: &str, areas: Option<&mut Vec<Area<'a>>>) {
        let kind = table::kind(shape);
        let map = table::transform(shape);
        if shape.get("casts_shadow").and_then(Value::as_bool) == Some(false) {
            self.note("[[shape]] without a shadow", name);
        }
        if shape.contains_key("materials") {
            self.note("[[shape]] materials of an instance", name);
        }
        if shape.contains_key("motion") {
            self.note("[[shape]] motion", name);
        }
        if kind == "instance" {
            return self.instance(shape, &map, name, areas.is_none());
        }
        let material = shape.get("material");
        let textured = material.is_some_and(|material| self.is_textured(material));
        // Every surface with the transform of its own.
        let surfaces = match kind {
            "sphere" => {
                let center = table::vector(shape, "center").unwrap_or(DVec3::ZERO);
                let radius = table::number(shape, "radius").unwrap_or(1.0);
                let moved = DAffine3::from_translation(center);
                vec![(moved, format!("\"sphere\" {}", floats("radius", &[radius])))]
            }
            "rectangle" => vec![(DAffine3::IDENTITY, RECTANGLE.to_owned())],
            "disk" => {
                if textured {
                    self.note("[[shape]] disk, polygon or plane with a texture", name);
                }
                vec![(DAffine3::IDENTITY, "\"disk\"".to_owned())]
            }
            "plane" => {
                self.note("[[shape]] plane", name);
                if textured {
                    self.note("[[shape]] disk, polygon or plane with a texture", name);
                }
                let scale = DVec3::new(PLANE, PLANE, 1.0);
                vec![(DAffine3::from_scale(scale), RECTANGLE.to_owned())]
            }
            "box" => vec![(DAffine3::IDENTITY, cube())],
            "cylinder" => cylinder(shape),
            "triangle" => vec![(DAffine3::IDENTITY, triangle(shape))],
            "polygon" => match polygon(shape) {
                Some(text) => {
                    if textured {
                        self.note("[[shape]] disk, polygon or plane with a texture", name);
                    }
                    vec![(DAffine3::IDENTITY, text)]
                }
                None => return self.note("[[shape]] polygon that is not convex", name),
            },
            "mesh" => {
                if shape.contains_key("displacement") {
                    self.note("[[shape]] mesh with displacement", name);
                }
                if shape.contains_key("vertex_colors") {
                    self.note("[[shape]] mesh with colors", name);
                }
                match self.mesh_file(shape) {
                    Some(file) => vec![(
                        DAffine3::IDENTITY,
                        format!("\"plymesh\" {}", text("filename", &file)),
                    )],
                    None => return,
                }
            }
            "heightfield" if table::has_texture(shape, "height") => {
                return self.note("[[shape]] heightfield with a texture", name);
            }
            "heightfield" => match self.mesh_file(shape) {
                Some(file) => vec![(
                    DAffine3::IDENTITY,
                    format!("\"plymesh\" {}", text("filename", &file)),
                )],
                None => return,
            },
            _ => return self.note("[[shape]] of another type", name),
        };
        let (named, alpha) = match material {
            Some(material) => {
                let (named, alpha) = self.material(material, name);
                (Some(named), alpha)
            }
            None => (None, None),
        };
        let light = material.and_then(|material| self.light_of(shape, material, &map, name, areas));
        self.line("AttributeBegin");
        self.place(&map);
        if let Some(named) = named {
            self.line(format!("NamedMaterial {}", quoted(&named)));
        }
        if let Some(light) = light {
            self.line(light);
        }
        let alpha = alpha.map_or(String::new(), |alpha| {
            format!(" {}", parameter("alpha", &alpha, true))
        });
        for (map, surface) in surfaces {
            let moved = map != DAffine3::IDENTITY;
            if moved {
                self.line("TransformBegin");
                self.place(&map);
            }
            self.line(format!("Shape {surface}{alpha}"));
            if moved {
                self.line("TransformEnd");
            }
        }
        self.line("AttributeEnd\n");
    }

    /// The area light of a shape that emits.
    fn light_of(
        &mut self,
        shape: &'a Table,
        material: &'a Value,
        map: &DAffine3,
        name: &str,
        areas: Option<&mut Vec<Area<'a>>>,
    ) -> Option<String> {
        let emission = self.emission(material)?;
        let Some(areas) = areas else {
            self.note("[material] emissive in a group", name);
            return None;
        };
        let unit = match table::kind(shape) {
            "sphere" => {
                let center = table::vector(shape, "center").unwrap_or(DVec3::ZERO);
                let radius = table::number(shape, "radius").unwrap_or(1.0);
                *map * DAffine3::from_translation(center) * DAffine3::from_scale(DVec3::splat(radius))
            }
            _ => *map,
        };
        let size = 1e-9 * (1.0 + unit.translation.abs().max_element());
        let turned = unit * DAffine3::from_scale(DVec3::new(1.0, 1.0, -1.0));
        let mut matched = false;
        for area in areas.iter_mut().filter(|area| !area.used) {
            let other = table::transform(area.table);
            let same = other.abs_diff_eq(unit, size) || emission.back && other.abs_diff_eq(turned, size);
            if same
                && area.kind == table::kind(shape)
                && table::text(area.table, "file") == table::text(shape, "file")
            {
                area.used = true;
                matched = true;
                self.notes
                    .add(super::FEATURES, "[[light]] area", area.name.clone());
            }
        }
        if !matched {
            self.note("[material] emissive", name);
        }
        let radiance = match emission.radiance {
            None => [1.0; 3],
            Some(value) => match self.texture(value, false, name) {
                Pattern::Color(color) => color,
                Pattern::Named(_) => {
                    self.note("[material] texture of a radiance", name);
                    [1.0; 3]
                }
            },
        };
        let mut line = String::new();
        if !emission.front {
            line.push_str("ReverseOrientation\n");
        }
        line.push_str(&format!("AreaLightSource \"diffuse\" {}", rgb("L", radiance)));
        if emission.front && emission.back {
            line.push_str(" \"bool twosided\" true");
        }
        Some(line)
    }

    fn instance(&mut self, shape: &'a Table, map: &DAffine3, name: &str, nested: bool) {
        let Some(id) = table::text(shape, "group") else {
            return;
        };
        if nested {
            return self.note("[[shape]] instance in a group", name);
        }
        if self.groups.insert(id.to_owned()) {
            let group = table::table(self.document, "group").and_then(|groups| table::table(groups, id));
            let shapes = group
                .map(|group| table::tables(group, "shape"))
                .unwrap_or_default();
            // Materials that are made inside of an object are known outside.
            self.line(format!("ObjectBegin {}", quoted(id)));
            for (place, inner) in shapes.into_iter().enumerate() {
                self.shape(inner, &format!("group.{id}.shape[{place}]"), None);
            }
            self.line("ObjectEnd\n");
        }
        self.line("AttributeBegin");
        self.place(map);
        self.line(format!("ObjectInstance {}", quoted(id)));
        self.line("AttributeEnd\n");
    }

    /// The name of a PLY file with the triangles of a shape, without displacement; none if there is
    /// an error.
    pub(super) fn mesh_file(&mut self, shape: &Table) -> Option<String> {
        let mut shape = shape.clone();
        for key in ["id", "material", "transform", "motion", "displacement"] {
            shape.remove(key);
        }
        let key = shape.to_string();
        if let Some(known) = self.meshes.get(&key) {
            return Some(known.clone());
        }
        let file = table::text(&shape, "file").unwrap_or_default().to_owned();
        let plain = shape.keys().all(|key| ["type", "file"].contains(&key.as_str()));
        let written = if plain && file.to_lowercase().ends_with(".ply") {
            self.copied(&file)
        } else {
            match triangles::built(&shape, self.base) {
                Ok(mesh) => {
                    let written = format!("{}-mesh{}.ply", self.stem, self.meshes.len() + 1);
                    if let Err(error) = save(&self.folder.join(&written), &triangles::ply(&mesh)) {
                        self.errors.push(error);
                    }
                    written
                }
                Err(Missing::Curved) => return None,
                Err(Missing::Faulty(message)) => {
                    self.errors.push(FormatError::anywhere(message));
                    return None;
                }
            }
        };
        self.meshes.insert(key, written.clone());
        Some(written)
    }
}

/// The model's box: its faces in their order, with (u, v) along the next two axes.
fn cube() -> String {
    let (mut points, mut uvs) = (Vec::new(), Vec::new());
    for face in 0..6 {
        let axis = face / 2;
        let sign = if face % 2 == 1 { 1.0 } else { -1.0 };
        let (u, v) = (DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]);
        let middle = DVec3::AXES[axis] * sign;
        let mut corners = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)];
        if sign < 0.0 {
            // The normal points outward.
            corners.swap(1, 2);
        }
        for (x, y) in corners {
            points.extend((middle + x * u + y * v).to_array());
            uvs.extend([(x + 1.0) / 2.0, (y + 1.0) / 2.0]);
        }
    }
    let indices: Vec<i64> = (0..24).collect();
    format!(
        "\"bilinearmesh\" \"point3 P\" {} \"point2 uv\" {} {}",
        list(&points),
        list(&uvs),
        integers("indices", &indices)
    )
}

/// The side of a cylinder and its caps.
fn cylinder(shape: &Table) -> Vec<(DAffine3, String)> {
    let radius = table::number(shape, "radius").unwrap_or(1.0);
    let [low, high] = match shape.get("z").and_then(table::numbers).as_deref() {
        Some([low, high]) => [*low, *high],
        _ => [-1.0, 1.0],
    };
    let side = format!(
        "\"cylinder\" {} {} {}",
        floats("radius", &[radius]),
        floats("zmin", &[low]),
        floats("zmax", &[high])
    );
    let mut surfaces = vec![(DAffine3::IDENTITY, side)];
    if shape.get("caps").and_then(Value::as_bool) != Some(false) {
        for (z, up) in [(low, -1.0), (high, 1.0)] {
            let map = DAffine3::from_translation(DVec3::new(0.0, 0.0, z))
                * DAffine3::from_scale(DVec3::new(1.0, 1.0, up));
            surfaces.push((map, format!("\"disk\" {}", floats("radius", &[radius]))));
        }
    }
    surfaces
}

/// The numbers of a list of lists.
fn rows(shape: &Table, key: &str) -> Option<Vec<f64>> {
    let rows = shape.get(key)?.as_array()?;
    let rows: Option<Vec<Vec<f64>>> = rows.iter().map(table::numbers).collect();
    Some(rows?.concat())
}

fn triangle(shape: &Table) -> String {
    let points = rows(shape, "vertices").unwrap_or_default();
    let uvs = rows(shape, "uvs").unwrap_or(vec![0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let mut line = format!(
        "\"trianglemesh\" \"point3 P\" {} \"point2 uv\" {}",
        list(&points),
        list(&uvs)
    );
    if let Some(normals) = rows(shape, "normals") {
        line.push_str(&format!(" \"normal N\" {}", list(&normals)));
    }
    line
}

/// A polygon as a patch or as triangles; none if it is not convex.
fn polygon(shape: &Table) -> Option<String> {
    let numbers = rows(shape, "vertices")?;
    let triples: &[[f64; 3]] = numbers.as_chunks().0;
    let points: Vec<DVec3> = triples.iter().map(|triple| DVec3::from(*triple)).collect();
    let n = points.len();
    if n < 3 {
        return None;
    }
    let normal: DVec3 = (1..n - 1)
        .map(|k| (points[k] - points[0]).cross(points[k + 1] - points[0]))
        .sum();
    let turns = |k: usize| {
        let [a, b, c] = [points[k], points[(k + 1) % n], points[(k + 2) % n]];
        (b - a).cross(c - b).dot(normal)
    };
    // Every fan triangle must face the same way, too: a star turns to one side all the time.
    let fans = |k: usize| {
        (points[k] - points[0])
            .cross(points[k + 1] - points[0])
            .dot(normal)
    };
    let convex = (0..n).all(|k| turns(k) >= 0.0) && (1..n - 1).all(|k| fans(k) >= 0.0);
    if !convex {
        return None;
    }
    if n == 4 {
        let order = [0, 1, 3, 2].map(|k| points[k].to_array()).concat();
        return Some(format!("\"bilinearmesh\" \"point3 P\" {}", list(&order)));
    }
    let indices: Vec<i64> = (1..n as i64 - 1).flat_map(|k| [0, k, k + 1]).collect();
    Some(format!(
        "\"trianglemesh\" \"point3 P\" {} {}",
        list(&numbers),
        integers("indices", &indices)
    ))
}
