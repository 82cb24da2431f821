//! The triangles of a primitive and the attributes of their vertices.

use crate::accessor::Numbers;
use crate::document::{Document, Error};
use crate::json;
use crate::json::accessor::Type;
use crate::json::mesh::{Mode, Semantic};
use crate::json::validation::Checked;
use crate::nodes::{parents, world_transform};
use whitstone_core::{DAffine3, DMat3, DVec3};

/// What to read of a primitive.
#[derive(Clone, Default)]
pub struct Request<'a> {
    /// Index of the mesh.
    pub mesh: usize,
    /// Index of the primitive in the mesh.
    pub primitive: usize,
    /// Whether to read normals.
    pub normals: bool,
    /// Sets of texture coordinates.
    pub uv_sets: &'a [u32],
    /// Whether to read vertex colours.
    pub colors: bool,
    /// Whether to read tangents.
    pub tangents: bool,
    /// Weights of the morph targets, instead of those of the mesh.
    pub weights: Option<&'a [f64]>,
    /// Index of the skin.
    pub skin: Option<usize>,
    /// Computes the tangents of a primitive that has none, before the skin deforms it.
    pub compute_tangents: Option<&'a ComputeTangents>,
}

/// Computes tangents of a primitive: direction and sign for each vertex.
pub type ComputeTangents = dyn Fn(&Primitive) -> Vec<[f64; 4]>;

/// The triangles of a primitive. Attributes have an element for each vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Primitive {
    /// Positions.
    pub positions: Vec<[f64; 3]>,
    /// Normals, if present; not normalised.
    pub normals: Option<Vec<[f64; 3]>>,
    /// The requested sets of texture coordinates that are present, v pointing up.
    pub uvs: Vec<Option<Vec<[f64; 2]>>>,
    /// Linear RGBA from 0 to 1, if present.
    pub colors: Option<Vec<[f64; 4]>>,
    /// Direction and sign, if the primitive has them and normals.
    pub tangents: Option<Vec<[f64; 4]>>,
    /// Vertices of each triangle.
    pub triangles: Vec<[u32; 3]>,
}

/// Whether a primitive consists of triangles, and not of points or lines.
pub fn has_triangles(primitive: &json::mesh::Primitive) -> bool {
    matches!(
        primitive.mode,
        Checked::Valid(Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)
    )
}

impl Primitive {
    /// Upper bound on the memory in bytes for reading a primitive; 0 if it is faulty.
    pub fn bytes(document: &Document, request: &Request<'_>) -> u64 {
        let count = |index: Option<usize>| {
            let accessor = index.and_then(|index| document.root.accessors.get(index));
            accessor.map_or(0, |accessor| accessor.count.0)
        };
        let meshes = &document.root.meshes;
        let primitive = meshes
            .get(request.mesh)
            .and_then(|mesh| mesh.primitives.get(request.primitive));
        let Some(primitive) = primitive else { return 0 };
        let position = primitive.attributes.get(&Checked::Valid(Semantic::Positions));
        let vertices = count(position.map(|index| index.value()));
        let indices = count(primitive.indices.map(|index| index.value()));
        // All attributes in double precision, twice while they are copied.
        vertices
            .saturating_mul(256)
            .saturating_add(indices.saturating_mul(24))
    }

    /// Reads a primitive.
    pub fn read(document: &Document, request: &Request<'_>) -> Result<Self, Error> {
        let meshes = &document.root.meshes;
        let mesh = Document::item(meshes, request.mesh, "meshes", || "/meshes".into())?;
        let of_mesh = format!("/meshes/{}", request.mesh);
        let primitive = Document::item(&mesh.primitives, request.primitive, "primitives", || {
            format!("{of_mesh}/primitives")
        })?;
        let at = format!("{of_mesh}/primitives/{}", request.primitive);
        let reader = Reader {
            document,
            primitive,
            at: &at,
        };
        reader.read(request, mesh.weights.as_deref().unwrap_or_default())
    }
}

struct Reader<'a> {
    document: &'a Document,
    primitive: &'a json::mesh::Primitive,
    /// Pointer of the primitive.
    at: &'a str,
}

impl Reader<'_> {
    fn read(&self, request: &Request<'_>, own_weights: &[f32]) -> Result<Primitive, Error> {
        if let Some(extensions) = &self.primitive.extensions
            && extensions.others.contains_key("KHR_draco_mesh_compression")
        {
            // The uncompressed accessors, if the file has any.
            let position = self.index(Semantic::Positions);
            let accessor = position.and_then(|index| self.document.root.accessors.get(index));
            if accessor.is_some_and(|accessor| accessor.buffer_view.is_none() && accessor.sparse.is_none()) {
                let place = format!("{}/extensions/KHR_draco_mesh_compression", self.at);
                return Err(Error::at(place, "compressed by Draco, which is not supported"));
            }
        }
        let Some(positions) = self.attribute(Semantic::Positions, "POSITION", &[Type::Vec3], None)? else {
            return Err(Error::at(
                format!("{}/attributes", self.at),
                "expected the attribute POSITION",
            ));
        };
        let count = positions.len();
        if count > u32::MAX as usize {
            return Err(Error::at(self.at, "has more than 2^32 vertices"));
        }
        let mut data = Primitive {
            positions: positions.arrays(0.0),
            ..Primitive::default()
        };
        let of_count = Some(count);
        if request.normals {
            let found = self.attribute(Semantic::Normals, "NORMAL", &[Type::Vec3], of_count)?;
            data.normals = found.map(|numbers| numbers.arrays(0.0));
        }
        // Without normals the specification has tangents ignored.
        if request.tangents && self.index(Semantic::Normals).is_some() {
            let found = self.attribute(Semantic::Tangents, "TANGENT", &[Type::Vec4], of_count)?;
            data.tangents = found.map(|numbers| numbers.arrays(0.0));
        }
        for set in request.uv_sets {
            let name = format!("TEXCOORD_{set}");
            let found = self.attribute(Semantic::TexCoords(*set), &name, &[Type::Vec2], of_count)?;
            let up = |uv: [f64; 2]| [uv[0], 1.0 - uv[1]];
            data.uvs
                .push(found.map(|numbers| numbers.arrays(0.0).into_iter().map(up).collect()));
        }
        if request.colors {
            let kinds = [Type::Vec3, Type::Vec4];
            let found = self.attribute(Semantic::Colors(0), "COLOR_0", &kinds, of_count)?;
            let limited = |color: [f64; 4]| color.map(|part| part.clamp(0.0, 1.0));
            data.colors = found.map(|numbers| numbers.arrays(1.0).into_iter().map(limited).collect());
        }
        data.triangles = self.triangles(count)?;
        self.morph(&mut data, request, own_weights)?;
        if request.tangents
            && data.tangents.is_none()
            && let Some(compute) = request.compute_tangents
        {
            data.tangents = Some(compute(&data));
        }
        if let Some(skin) = request.skin {
            self.skin(&mut data, skin)?;
        }
        Ok(data)
    }

    fn index(&self, semantic: Semantic) -> Option<usize> {
        let found = self.primitive.attributes.get(&Checked::Valid(semantic));
        found.map(|index| index.value())
    }

    /// An attribute, if the primitive has it; an error if it does not have `count` elements.
    fn attribute(
        &self,
        semantic: Semantic,
        name: &str,
        kinds: &[Type],
        count: Option<usize>,
    ) -> Result<Option<Numbers>, Error> {
        let Some(index) = self.index(semantic) else {
            return Ok(None);
        };
        let pointer = || format!("{}/attributes/{name}", self.at);
        self.document
            .numbers(index, kinds, &pointer)
            .and_then(|numbers| self.counted(numbers, count, &pointer))
            .map(Some)
    }

    fn counted(
        &self,
        numbers: Numbers,
        count: Option<usize>,
        pointer: &dyn Fn() -> String,
    ) -> Result<Numbers, Error> {
        match count {
            Some(count) if count != numbers.len() => {
                let message = format!("has {} elements, POSITION has {count}", numbers.len());
                Err(Error::at(pointer(), message))
            }
            _ => Ok(numbers),
        }
    }

    /// Adds the weighted morph targets.
    fn morph(&self, data: &mut Primitive, request: &Request<'_>, own: &[f32]) -> Result<(), Error> {
        let own: Vec<f64> = own.iter().map(|weight| f64::from(*weight)).collect();
        let weights = request.weights.unwrap_or(&own);
        let count = data.positions.len();
        for (number, target) in self.primitive.targets.iter().flatten().enumerate() {
            let weight = weights.get(number).copied().unwrap_or(0.0);
            if weight == 0.0 {
                continue;
            }
            let offsets = |index: Option<json::Index<json::Accessor>>, name: &str| {
                let Some(index) = index else { return Ok(None) };
                let pointer = || format!("{}/targets/{number}/{name}", self.at);
                let numbers = self.document.numbers(index.value(), &[Type::Vec3], &pointer)?;
                self.counted(numbers, Some(count), &pointer).map(Some)
            };
            if let Some(offsets) = offsets(target.positions, "POSITION")? {
                add(&mut data.positions, &offsets, weight);
            }
            if let Some(normals) = &mut data.normals
                && let Some(offsets) = offsets(target.normals, "NORMAL")?
            {
                add(normals, &offsets, weight);
            }
            if let Some(tangents) = &mut data.tangents
                && let Some(offsets) = offsets(target.tangents, "TANGENT")?
            {
                add(tangents, &offsets, weight);
            }
        }
        Ok(())
    }

    /// Transforms the vertices by a skin.
    fn skin(&self, data: &mut Primitive, number: usize) -> Result<(), Error> {
        let document = self.document;
        let skin = Document::item(&document.root.skins, number, "skins", || "/skins".into())?;
        let parents = parents(document)?;
        let mut joints = Vec::new();
        for (place, joint) in skin.joints.iter().enumerate() {
            let pointer = || format!("/skins/{number}/joints/{place}");
            Document::item(&document.root.nodes, joint.value(), "nodes", pointer)?;
            joints.push(world_transform(document, &parents, joint.value())?);
        }
        if let Some(index) = skin.inverse_bind_matrices {
            let pointer = || format!("/skins/{number}/inverseBindMatrices");
            let bind = document.numbers(index.value(), &[Type::Mat4], &pointer)?;
            if bind.len() < joints.len() {
                let message = format!(
                    "has {} matrices, but there are {} joints",
                    bind.len(),
                    joints.len()
                );
                return Err(Error::at(pointer(), message));
            }
            for (joint, m) in joints.iter_mut().zip(bind.rows()) {
                *joint *= DAffine3::from_cols_array(&[
                    m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10], m[12], m[13], m[14],
                ]);
            }
        }
        let count = data.positions.len();
        let mut matrices = vec![[0.0f64; 12]; count];
        for set in 0..2 {
            let names = [format!("JOINTS_{set}"), format!("WEIGHTS_{set}")];
            let vec4 = [Type::Vec4];
            let indices = self.attribute(Semantic::Joints(set), &names[0], &vec4, Some(count))?;
            let weights = self.attribute(Semantic::Weights(set), &names[1], &vec4, Some(count))?;
            let (Some(indices), Some(weights)) = (indices, weights) else {
                if set == 0 {
                    let message = "a mesh with a skin needs JOINTS_0 and WEIGHTS_0";
                    return Err(Error::at(format!("{}/attributes", self.at), message));
                }
                break;
            };
            for ((matrix, indices), weights) in matrices.iter_mut().zip(indices.rows()).zip(weights.rows()) {
                for (index, weight) in indices.iter().zip(weights) {
                    if *weight == 0.0 {
                        continue;
                    }
                    let joint = joints.get(*index as usize).ok_or_else(|| {
                        let message = format!("names joint {index}, but skin {number} has {}", joints.len());
                        Error::at(format!("{}/attributes/JOINTS_{set}", self.at), message)
                    })?;
                    for (sum, part) in matrix.iter_mut().zip(joint.to_cols_array()) {
                        *sum += weight * part;
                    }
                }
            }
        }
        let matrices: Vec<DAffine3> = matrices.iter().map(DAffine3::from_cols_array).collect();
        for (p, m) in data.positions.iter_mut().zip(&matrices) {
            *p = m.transform_point3(DVec3::from_array(*p)).to_array();
        }
        let regular = |m: &DMat3| {
            let determinant = m.determinant();
            determinant.is_normal().then_some(*m)
        };
        for (n, m) in data.normals.iter_mut().flatten().zip(&matrices) {
            let turned = regular(&m.matrix3).map(|m| m.inverse().transpose() * DVec3::from_array(*n));
            *n = turned.unwrap_or_default().to_array();
        }
        for (t, m) in data.tangents.iter_mut().flatten().zip(&matrices) {
            let turned = regular(&m.matrix3).map(|m| m * DVec3::new(t[0], t[1], t[2]));
            let turned = turned.unwrap_or_default();
            *t = [turned.x, turned.y, turned.z, t[3]];
        }
        Ok(())
    }

    fn triangles(&self, vertices: usize) -> Result<Vec<[u32; 3]>, Error> {
        let pointer = || format!("{}/indices", self.at);
        let indices: Vec<u32> = match self.primitive.indices {
            None => (0..vertices as u32).collect(),
            Some(index) => {
                let indices = self.document.indices(index.value(), &pointer)?;
                if let Some(place) = indices.iter().position(|index| *index as usize >= vertices) {
                    let message = format!(
                        "entry {place} is vertex {}, but POSITION has {vertices}",
                        indices[place]
                    );
                    return Err(Error::at(pointer(), message));
                }
                indices
            }
        };
        let mode = match self.primitive.mode {
            Checked::Valid(mode) => mode,
            Checked::Invalid => {
                return Err(Error::at(
                    format!("{}/mode", self.at),
                    "expected a number from 0 to 6",
                ));
            }
        };
        let count = indices.len();
        let corners = |pick: &dyn Fn(usize) -> [usize; 3], number: usize| {
            (0..number)
                .map(|i| pick(i).map(|corner| indices[corner]))
                .collect()
        };
        match mode {
            Mode::Triangles if count.is_multiple_of(3) => {
                Ok(corners(&|i| [3 * i, 3 * i + 1, 3 * i + 2], count / 3))
            }
            Mode::Triangles => Err(Error::at(
                self.at,
                format!("expected a multiple of 3 indices for triangles, found {count}"),
            )),
            Mode::TriangleStrip => Ok(corners(
                &|i| [i, i + 1 + i % 2, i + 2 - i % 2],
                count.saturating_sub(2),
            )),
            Mode::TriangleFan => Ok(corners(&|i| [i + 1, i + 2, 0], count.saturating_sub(2))),
            Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => Err(Error::at(
                format!("{}/mode", self.at),
                "expected triangles, found points or lines",
            )),
        }
    }
}

/// Adds the weighted offsets to the first three numbers of each element.
fn add<const N: usize>(values: &mut [[f64; N]], offsets: &Numbers, weight: f64) {
    for (value, offset) in values.iter_mut().zip(offsets.rows()) {
        for (part, offset) in value.iter_mut().zip(offset) {
            *part += weight * offset;
        }
    }
}
