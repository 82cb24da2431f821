//! A primitive of a mesh of a glTF file.

use super::{FileError, Triangles, tangents};
use std::path::Path;
use whitstone_core::{DVec2, DVec3, MeshAttributes};
use whitstone_gltf::json::mesh::Semantic;
use whitstone_gltf::json::validation::Checked;
use whitstone_gltf::{Document, Error, Primitive, Request};

/// Reads a primitive; `reserve` is told the memory that it needs before it is read.
pub(super) fn read<E>(
    path: &Path,
    request: &Request<'_>,
    reserve: impl FnOnce(u64) -> Result<(), E>,
) -> Result<Result<Triangles, E>, FileError> {
    let told = |error: Error| FileError::anywhere(error.to_string());
    let document = Document::open(path).map_err(told)?;
    if let Err(refused) = reserve(Primitive::bytes(&document, request)) {
        return Ok(Err(refused));
    }
    // Only a skin makes a difference between tangents computed before and after.
    let compute = |primitive: &Primitive| {
        let mut object = Triangles {
            positions: vectors(primitive.positions.clone()),
            uvs: first_uvs(primitive),
            triangles: primitive.triangles.clone(),
            ..Triangles::default()
        };
        tangents::add(&mut object);
        let tangents = object.attributes.tangents.into_iter();
        tangents.map(|t| [t.x, t.y, t.z, 1.0]).collect()
    };
    let own = own_tangents(&document, request);
    let request = Request {
        compute_tangents: request.skin.is_some().then_some(&compute as _),
        ..request.clone()
    };
    let found = Primitive::read(&document, &request).map_err(told)?;
    let mut uvs = found.uvs.into_iter().map(|set| {
        let set = set.unwrap_or_default();
        set.into_iter().map(DVec2::from_array).collect::<Vec<_>>()
    });
    let (first, second) = (uvs.next().unwrap_or_default(), uvs.next().unwrap_or_default());
    let mut attributes = MeshAttributes {
        colors: found.colors.unwrap_or_default(),
        second_uvs: second,
        ..MeshAttributes::default()
    };
    if let Some(tangents) = found.tangents {
        attributes.handedness = if own {
            let sign = |[a, _, _]: &[u32; 3]| if tangents[*a as usize][3] < 0.0 { -1.0 } else { 1.0 };
            found.triangles.iter().map(sign).collect()
        } else {
            tangents::handedness(&first, &found.triangles)
        };
        attributes.tangents = tangents.iter().map(|t| DVec3::new(t[0], t[1], t[2])).collect();
    }
    Ok(Ok(Triangles {
        positions: vectors(found.positions),
        normals: found.normals.map(vectors).unwrap_or_default(),
        uvs: first,
        triangles: found.triangles,
        attributes,
    }))
}

fn vectors(list: Vec<[f64; 3]>) -> Vec<DVec3> {
    list.into_iter().map(DVec3::from_array).collect()
}

/// The first requested set of texture coordinates.
fn first_uvs(primitive: &Primitive) -> Vec<DVec2> {
    let set = primitive.uvs.first().cloned().flatten().unwrap_or_default();
    set.into_iter().map(DVec2::from_array).collect()
}

/// Whether the file has tangents of this primitive, which count only with normals.
fn own_tangents(document: &Document, request: &Request<'_>) -> bool {
    let mesh = document.root.meshes.get(request.mesh);
    let primitive = mesh.and_then(|mesh| mesh.primitives.get(request.primitive));
    primitive.is_some_and(|primitive| {
        let has = |semantic| primitive.attributes.contains_key(&Checked::Valid(semantic));
        has(Semantic::Tangents) && has(Semantic::Normals)
    })
}
