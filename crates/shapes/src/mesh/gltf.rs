//! A primitive of a mesh of a glTF file.

use super::{FileError, Triangles};
use std::path::Path;
use whitstone_core::{DVec2, DVec3, MeshAttributes};
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
    let found = Primitive::read(&document, request).map_err(told)?;
    let mut uvs = found.uvs.into_iter().map(|set| {
        let set = set.unwrap_or_default();
        set.into_iter().map(DVec2::from_array).collect::<Vec<_>>()
    });
    let vectors = |list: Vec<[f64; 3]>| list.into_iter().map(DVec3::from_array).collect::<Vec<_>>();
    let (first, second) = (uvs.next().unwrap_or_default(), uvs.next().unwrap_or_default());
    let mut attributes = MeshAttributes {
        colors: found.colors.unwrap_or_default(),
        second_uvs: second,
        ..MeshAttributes::default()
    };
    for color in attributes.colors.iter_mut().flatten() {
        *color = color.max(0.0);
    }
    if let Some(tangents) = found.tangents {
        let sign = |[a, _, _]: &[u32; 3]| {
            if tangents[*a as usize][3] < 0.0 { -1.0 } else { 1.0 }
        };
        attributes.handedness = found.triangles.iter().map(sign).collect();
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
