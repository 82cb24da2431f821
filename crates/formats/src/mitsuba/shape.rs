//! Shapes, and the area lights on them.

use super::material::{Look, black};
use super::translate::{Fields, Translator};
use super::xml::{Data, basis};
use crate::document::{color, numbers, transform, typed};
use crate::files::{self, Named};
use crate::mesh_file::{self, MeshInfo};
use crate::obj;
use crate::part::Part;
use toml::{Table, Value};
use whitstone_core::{DAffine3, DMat3, DVec3};

/// Largest mesh file in bytes.
const MAX_MESH_BYTES: u64 = 4 << 30;
/// Most triangles of a mesh that lights, by the model.
const MAX_LIGHT_TRIANGLES: u64 = 4096;

/// Plugins that depend on texture coordinates.
const BY_UV: &[&str] = &["bitmap", "checkerboard", "normalmap"];
/// Plugins that depend on the tangent.
const NORMAL_MAPS: &[&str] = &["normalmap"];

/// The box around a rectangle or disk.
const FLAT_LOW: DVec3 = DVec3::new(-1.0, -1.0, 0.0);
const FLAT_HIGH: DVec3 = DVec3::new(1.0, 1.0, 0.0);

/// What a shape has besides its geometry.
struct Common {
    /// `to_world`, after the transform of the options.
    world: DAffine3,
    flip_normals: bool,
    bsdf: Option<usize>,
    emitter: Option<usize>,
    id: Option<String>,
    in_group: bool,
}

/// One shape of the result.
struct Piece {
    table: Table,
    /// If it is an area light: types of the surfaces and their transforms; they emit on +z or
    /// outside.
    lights: Vec<(&'static str, DAffine3)>,
    look: Look,
}

impl<'a> Translator<'a> {
    /// Adds the shapes of a shape to a list, and their lights.
    pub(super) fn shape(&mut self, index: usize, base: &DAffine3, in_group: bool, out: &mut Vec<Table>) {
        let mut fields = self.fields(index);
        let plugin = fields.object.plugin.as_str();
        let at = fields.at();
        match plugin {
            // Instances place it.
            "shapegroup" if !in_group => return,
            "merge" => {
                if self.enter(index) {
                    for (_, child) in self.children(&mut fields, &["shape"]) {
                        self.shape(child, base, in_group, out);
                    }
                    self.leave();
                }
                return self.finish(fields);
            }
            "sphere" | "rectangle" | "disk" | "cube" | "cylinder" | "obj" | "ply" | "instance" => {}
            _ => return self.unknown(index),
        }
        fields.take("silhouette_sampling_weight");
        let world = *base * self.transform(&mut fields, "to_world");
        let mut common = Common {
            world,
            flip_normals: self.boolean(&mut fields, "flip_normals", false),
            bsdf: None,
            emitter: None,
            id: fields.object.id.clone(),
            in_group,
        };
        if plugin == "instance" {
            self.instance(&mut fields, &common, out);
            return self.finish(fields);
        }
        for (entry, child) in self.children(&mut fields, &["bsdf", "emitter", "medium"]) {
            match self.scene.objects[child].family {
                "bsdf" => common.bsdf = Some(child),
                "emitter" => common.emitter = Some(child),
                _ => self.note("medium", entry.at),
            }
        }
        let pieces = match plugin {
            "sphere" => self.sphere(&mut fields, &common),
            "rectangle" => {
                self.bound(&world, FLAT_LOW, FLAT_HIGH);
                vec![flat("rectangle", &common)]
            }
            "disk" => {
                self.bound(&world, FLAT_LOW, FLAT_HIGH);
                match similar_disk(&world.matrix3) {
                    Some(matrix) => common.world.matrix3 = matrix,
                    None => self.error(at, "the transform of a disk must scale x and y equally"),
                }
                vec![flat("disk", &common)]
            }
            "cube" => self.cube(&common),
            "cylinder" => self.cylinder(&mut fields, &common),
            _ => self.mesh(&mut fields, &common),
        };
        self.finish(fields);
        if let Some(emitter) = common.emitter
            && self.scene.objects[emitter].plugin != "area"
        {
            self.unknown(emitter);
            common.emitter = None;
        }
        let single = pieces.len() == 1;
        // Without a normal map, all shapes share a material.
        let mapped = common.bsdf.is_some_and(|bsdf| self.contains(bsdf, NORMAL_MAPS));
        for mut piece in pieces {
            piece.look.tangent = piece.look.tangent.filter(|_| mapped);
            let material = match (common.bsdf, common.emitter.is_some()) {
                (Some(bsdf), _) => Some(self.bsdf(bsdf, &piece.look)),
                (None, true) => None,
                (None, false) => {
                    // Mitsuba's default is a diffuse bsdf of 0.5.
                    let matte = Value::Table(typed("matte", [("reflectance", Value::Float(0.5))]));
                    Some(sides(matte, Value::Table(black()), piece.look.flip))
                }
            };
            let material = match common.emitter {
                None => material,
                Some(index) => Some(self.emissive(index, material, &piece.look)),
            };
            if let Some(material) = material {
                piece.table.insert("material".to_owned(), material);
            }
            if let (true, Some(id)) = (single, &common.id) {
                let id = format!("{}{id}", self.options.prefix);
                piece.table.insert("id".to_owned(), Value::String(id));
            }
            if let Some(emitter) = common.emitter {
                self.area(emitter, &common, &piece);
            }
            out.push(piece.table);
        }
    }

    /// The material of a surface that emits on Mitsuba's front side.
    fn emissive(&mut self, emitter: usize, material: Option<Value>, look: &Look) -> Value {
        let mut fields = self.fields(emitter);
        fields.take("to_world");
        let radiance = self.texture_or_color(&mut fields, "radiance", [1.0; 3], look);
        self.finish(fields);
        let mut emissive = typed("emissive", [("radiance", radiance)]);
        if let Some(material) = &material {
            emissive.insert("material".to_owned(), material.clone());
        }
        let back = material.unwrap_or_else(|| Value::Table(black()));
        sides(Value::Table(emissive), back, look.flip)
    }

    /// Adds the light of an emitting shape.
    fn area(&mut self, emitter: usize, common: &Common, piece: &Piece) {
        if !self.options.lights {
            return;
        }
        let at = self.scene.objects[emitter].at;
        let radiance = self.scene.objects[emitter]
            .entries
            .iter()
            .find(|entry| entry.name == "radiance");
        let radiance = match radiance.map(|entry| &entry.value) {
            None => Some([1.0; 3]),
            Some(Data::Color(value)) => Some(*value),
            Some(Data::Float(value)) => Some([*value; 3]),
            Some(Data::Integer(value)) => Some([*value as f64; 3]),
            Some(Data::Object(texture)) => self.constant_texture(*texture),
            Some(_) => return,
        };
        let Some(radiance) = radiance.filter(|_| !common.in_group && !piece.lights.is_empty()) else {
            return self.note("emitter area without a light", at);
        };
        self.note("emitter area", at);
        for (kind, map) in &piece.lights {
            let kind = ("shape", Value::String((*kind).into()));
            let mut light = typed("area", [kind, ("radiance", color(radiance))]);
            if let Some(file) = piece.table.get("file") {
                light.insert("file".to_owned(), file.clone());
            }
            if *map != DAffine3::IDENTITY {
                light.insert("transform".to_owned(), transform(map));
            }
            self.document.lights.push(light);
        }
    }

    fn sphere(&mut self, fields: &mut Fields<'a>, common: &Common) -> Vec<Piece> {
        let center = self.vector(fields, "center").unwrap_or(DVec3::ZERO);
        let radius = self.number(fields, "radius", 1.0);
        let Some(matrix) = similar(&common.world.matrix3) else {
            self.error(
                fields.at(),
                "the transform of a sphere must scale all axes equally",
            );
            return Vec::new();
        };
        let world = DAffine3::from_mat3_translation(matrix, common.world.translation);
        let mut table = typed("sphere", []);
        if center != DVec3::ZERO {
            table.insert("center".to_owned(), numbers(center.to_array()));
        }
        if radius != 1.0 {
            table.insert("radius".to_owned(), Value::Float(radius));
        }
        place(&mut table, &world);
        let unit = world * DAffine3::from_translation(center) * DAffine3::from_scale(DVec3::splat(radius));
        self.bound(&unit, DVec3::NEG_ONE, DVec3::ONE);
        let flip = common.flip_normals != (matrix.determinant() < 0.0);
        let piece = Piece {
            table,
            lights: Vec::from_iter((!flip).then_some(("sphere", unit))),
            look: Look {
                flip_v: true,
                flip,
                tangent: around(common, matrix.z_axis),
                ..Look::default()
            },
        };
        vec![piece]
    }

    fn cube(&mut self, common: &Common) -> Vec<Piece> {
        self.bound(&common.world, DVec3::NEG_ONE, DVec3::ONE);
        let parts = [common.bsdf, common.emitter];
        let textured = parts
            .into_iter()
            .flatten()
            .any(|index| self.contains(index, BY_UV));
        // Directions of increasing u and v on each face, as Mitsuba lays them.
        let faces = [
            (DVec3::Z, DVec3::X, DVec3::NEG_Y),
            (DVec3::NEG_X, DVec3::NEG_Z, DVec3::Y),
            (DVec3::Y, DVec3::NEG_Z, DVec3::X),
            (DVec3::Y, DVec3::X, DVec3::Z),
            (DVec3::Y, DVec3::Z, DVec3::NEG_X),
            (DVec3::NEG_Y, DVec3::X, DVec3::NEG_Z),
        ];
        let pieces: Vec<Piece> = faces
            .into_iter()
            .map(|(x, y, z)| {
                let face = DAffine3::from_mat3_translation(DMat3::from_cols(x, y, z), z);
                let placed = Common {
                    world: common.world * face,
                    id: None,
                    ..*common
                };
                flat("rectangle", &placed)
            })
            .collect();
        if textured {
            return pieces;
        }
        let mut table = typed("box", []);
        place(&mut table, &common.world);
        let piece = Piece {
            table,
            // The faces light, and the box is visible.
            lights: pieces.into_iter().flat_map(|piece| piece.lights).collect(),
            look: Look {
                flip: common.flip_normals,
                ..Look::default()
            },
        };
        vec![piece]
    }

    fn cylinder(&mut self, fields: &mut Fields<'a>, common: &Common) -> Vec<Piece> {
        let p0 = self.vector(fields, "p0").unwrap_or(DVec3::ZERO);
        let p1 = self.vector(fields, "p1").unwrap_or(DVec3::Z);
        let radius = self.number(fields, "radius", 1.0);
        let length = (p1 - p0).length();
        let axis = (p1 - p0).try_normalize().unwrap_or_else(|| {
            self.error(fields.at(), "\"p0\" and \"p1\" must differ");
            DVec3::Z
        });
        let frame = DAffine3::from_mat3_translation(basis(axis), p0);
        let world = common.world * frame;
        let mut table = typed(
            "cylinder",
            [
                ("radius", Value::Float(radius)),
                ("z", numbers([0.0, length])),
                ("caps", Value::Boolean(false)),
            ],
        );
        place(&mut table, &world);
        self.bound(
            &world,
            DVec3::new(-radius, -radius, 0.0),
            DVec3::new(radius, radius, length),
        );
        vec![Piece {
            table,
            lights: Vec::new(),
            look: Look {
                flip: common.flip_normals,
                tangent: around(common, world.matrix3.z_axis),
                ..Look::default()
            },
        }]
    }

    fn mesh(&mut self, fields: &mut Fields<'a>, common: &Common) -> Vec<Piece> {
        let at = fields.at();
        let is_obj = fields.object.plugin == "obj";
        let flat = self.boolean(fields, "face_normals", false);
        let flip_v = self.boolean(fields, "flip_tex_coords", is_obj);
        let Some(named) = self.file(fields, "filename") else {
            return Vec::new();
        };
        let extension = named
            .path
            .extension()
            .unwrap_or_default()
            .to_string_lossy()
            .to_ascii_lowercase();
        if extension != fields.object.plugin {
            self.error(
                at,
                format!("expected a file that ends in .{}", fields.object.plugin),
            );
        }
        let info = match self.mesh_info(&named, is_obj) {
            Ok(info) => info,
            Err(message) => {
                self.error(at, message);
                return Vec::new();
            }
        };
        if !flat && !info.normals {
            self.note("mesh without normals", at);
        }
        let mut table = typed("mesh", [("file", Value::String(named.relative))]);
        if flat && info.normals {
            table.insert("shading".to_owned(), Value::String("flat".into()));
        }
        let parts = [common.bsdf, common.emitter];
        if parts
            .into_iter()
            .flatten()
            .any(|index| self.contains(index, NORMAL_MAPS))
        {
            table.insert("tangents".to_owned(), Value::Boolean(true));
        }
        place(&mut table, &common.world);
        self.bound(&common.world, info.part.low, info.part.high);
        // Mitsuba takes the side from the normals. Without them it takes it from the winding, which
        // turns when mirrored.
        let mirrors = common.world.matrix3.determinant() < 0.0;
        let turned = if flat || !info.normals {
            mirrors
        } else {
            info.turned
        };
        let flip = common.flip_normals != turned;
        let lights = !flip && info.triangles <= MAX_LIGHT_TRIANGLES;
        vec![Piece {
            table,
            lights: Vec::from_iter(lights.then_some(("mesh", common.world))),
            look: Look {
                flip_v,
                flip,
                tangent: Some(("tangent", Value::String("mesh".into()))),
                ..Look::default()
            },
        }]
    }

    fn mesh_info(&mut self, named: &Named, is_obj: bool) -> Result<MeshInfo, String> {
        if let Some(info) = self.meshes.get(&named.path) {
            return Ok(*info);
        }
        let bytes = files::read(&named.path, MAX_MESH_BYTES)
            .map_err(|problem| format!("cannot read \"{}\": {problem}", files::shorten(&named.relative)))?;
        let info = if is_obj {
            obj::inspect(&bytes)
        } else {
            mesh_file::inspect_ply(&bytes)
        };
        self.meshes.insert(named.path.clone(), info);
        Ok(info)
    }

    fn instance(&mut self, fields: &mut Fields<'a>, common: &Common, out: &mut Vec<Table>) {
        let at = fields.at();
        let groups = self.children(fields, &["shape"]);
        let [(_, group)] = groups[..] else {
            return self.error(
                at,
                format!("expected one shapegroup in an instance, found {}", groups.len()),
            );
        };
        if self.scene.objects[group].plugin != "shapegroup" {
            return self.error(at, "an instance must place a shapegroup");
        }
        let Some((id, bounds)) = self.group(group) else {
            return;
        };
        let mut table = typed("instance", [("group", Value::String(id))]);
        place(&mut table, &common.world);
        if let Some(id) = &common.id {
            let id = format!("{}{id}", self.options.prefix);
            table.insert("id".to_owned(), Value::String(id));
        }
        self.bound(&common.world, bounds.low, bounds.high);
        out.push(table);
    }

    /// The id and the bounds of a group.
    fn group(&mut self, index: usize) -> Option<(String, Part)> {
        if let Some(known) = self.groups.get(&index) {
            return Some(known.clone());
        }
        if !self.enter(index) {
            return None;
        }
        let outer = std::mem::replace(&mut self.bounds, Part::EMPTY);
        let mut fields = self.fields(index);
        let mut shapes = Vec::new();
        for (_, child) in self.children(&mut fields, &["shape"]) {
            self.shape(child, &DAffine3::IDENTITY, true, &mut shapes);
        }
        let object = fields.object;
        self.finish(fields);
        self.leave();
        let bounds = std::mem::replace(&mut self.bounds, outer);
        if shapes.is_empty() {
            self.error(object.at, "a shapegroup needs a shape");
            return None;
        }
        let id = self.group_ids.unique(object.id.as_deref().unwrap_or("group"));
        self.document.groups.push((id.clone(), shapes));
        let known = (id, bounds);
        self.groups.insert(index, known.clone());
        Some(known)
    }

    /// Adds a box, in the space of a shape, to the bounds.
    fn bound(&mut self, world: &DAffine3, low: DVec3, high: DVec3) {
        let placed = Part { low, high }.transformed(world);
        self.bounds.add(placed.low);
        self.bounds.add(placed.high);
    }
}

/// A rectangle or disk. Its z axis is turned where Mitsuba's normal is, which changes nothing else.
fn flat(kind: &'static str, common: &Common) -> Piece {
    let turn = DVec3::new(1.0, 1.0, if common.flip_normals { -1.0 } else { 1.0 });
    let world = common.world * DAffine3::from_scale(turn);
    let mut table = typed(kind, []);
    place(&mut table, &world);
    let tangent = world.matrix3.x_axis.try_normalize();
    let tangent = tangent.filter(|_| kind == "rectangle" && !common.in_group);
    Piece {
        table,
        lights: vec![(kind, world)],
        look: Look {
            tangent: tangent.map(|tangent| ("tangent", numbers(tangent.to_array()))),
            ..Look::default()
        },
    }
}

/// The tangent of a surface of revolution, in world space.
fn around(common: &Common, axis: DVec3) -> Option<(&'static str, Value)> {
    let axis = axis.try_normalize().filter(|_| !common.in_group)?;
    Some(("axis", numbers(axis.to_array())))
}

fn place(table: &mut Table, world: &DAffine3) {
    if *world != DAffine3::IDENTITY {
        table.insert("transform".to_owned(), transform(world));
    }
}

fn sides(front: Value, back: Value, flip: bool) -> Value {
    let (front, back) = if flip { (back, front) } else { (front, back) };
    Value::Table(typed("two_sided", [("front", front), ("back", back)]))
}

/// Relative difference from a similarity that files with few digits may have.
const TOLERANCE: f64 = 1e-3;

/// Whether vectors are equally long and perpendicular within [`TOLERANCE`].
fn equal_and_perpendicular(columns: &[DVec3]) -> bool {
    let lengths: Vec<f64> = columns.iter().map(|column| column.length()).collect();
    columns.iter().zip(&lengths).enumerate().all(|(i, (a, length))| {
        let mut others = columns.iter().zip(&lengths).skip(i + 1);
        (length - lengths[0]).abs() <= TOLERANCE * lengths[0]
            && others.all(|(b, other)| a.dot(*b).abs() <= TOLERANCE * length * other)
    })
}

/// The nearby similarity, exact as the model requires it; none if there is none.
pub(crate) fn similar(matrix: &DMat3) -> Option<DMat3> {
    if !equal_and_perpendicular(&[matrix.x_axis, matrix.y_axis, matrix.z_axis]) {
        return None;
    }
    if *matrix == DMat3::IDENTITY {
        return Some(*matrix);
    }
    let determinant = matrix.determinant();
    let scale = libm::cbrt(determinant.abs());
    let x = matrix.x_axis.normalize();
    let y = matrix.y_axis.reject_from_normalized(x).normalize();
    let z = x.cross(y) * determinant.signum();
    Some(DMat3::from_cols(x * scale, y * scale, z * scale))
}

/// The nearby matrix whose first two columns are equally long and perpendicular.
pub(crate) fn similar_disk(matrix: &DMat3) -> Option<DMat3> {
    if !equal_and_perpendicular(&[matrix.x_axis, matrix.y_axis]) {
        return None;
    }
    let scale = (matrix.x_axis.length() * matrix.y_axis.length()).sqrt();
    let x = matrix.x_axis.normalize();
    let y = matrix.y_axis.reject_from_normalized(x).normalize();
    Some(DMat3::from_cols(x * scale, y * scale, matrix.z_axis))
}
