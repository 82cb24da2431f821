//! Files of meshes and rays, which the Embree program reads too.
//!
//! `NAME.tri` = "TRI1", vertices and triangles (u32), coordinates (f32), indices (u32).
//! `NAME_SET.rays` = "RAY1", number (u32), origin, smallest parameter, direction, largest parameter
//! (8 f32). Little endian.

use std::fs;
use std::path::Path;
use whitstone::core::stream::LANES;
use whitstone::core::{DVec3, Interval, Ray, TriangleMesh};

fn words(path: &Path, magic: &[u8; 4]) -> Result<Vec<[u8; 4]>, String> {
    let bytes = fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    match bytes.strip_prefix(magic) {
        Some(rest) => Ok(rest.as_chunks().0.to_vec()),
        None => Err(format!("{}: does not begin with {magic:?}", path.display())),
    }
}

/// Reads a mesh.
pub(super) fn mesh(path: &Path) -> Result<TriangleMesh, String> {
    let words = words(path, b"TRI1")?;
    let short = || format!("{}: the file is too short", path.display());
    let [vertices, triangles, rest @ ..] = &words[..] else {
        return Err(short());
    };
    let count = |word: &[u8; 4]| u32::from_le_bytes(*word) as usize;
    let (vertices, triangles) = (count(vertices), count(triangles));
    if rest.len() < 3 * (vertices + triangles) {
        return Err(short());
    }
    let (points, indices) = rest.split_at(3 * vertices);
    let coordinate = |word| f64::from(f32::from_le_bytes(word));
    let mesh = TriangleMesh {
        positions: points
            .as_chunks()
            .0
            .iter()
            .map(|p: &[_; 3]| DVec3::from_array(p.map(coordinate)))
            .collect(),
        triangles: indices
            .as_chunks()
            .0
            .iter()
            .take(triangles)
            .map(|t: &[_; 3]| t.map(u32::from_le_bytes))
            .collect(),
        orientation: 1.0,
        ..TriangleMesh::default()
    };
    if mesh
        .triangles
        .as_flattened()
        .iter()
        .any(|&i| i as usize >= vertices)
    {
        return Err(format!("{}: a vertex index is too large", path.display()));
    }
    Ok(mesh)
}

/// Writes a mesh.
pub(super) fn write_mesh(path: &Path, mesh: &TriangleMesh) -> Result<(), String> {
    let mut bytes = b"TRI1".to_vec();
    bytes.extend((mesh.positions.len() as u32).to_le_bytes());
    bytes.extend((mesh.triangles.len() as u32).to_le_bytes());
    let coordinates = mesh.positions.iter().flat_map(|p| p.to_array());
    bytes.extend(coordinates.flat_map(|x| (x as f32).to_le_bytes()));
    bytes.extend(mesh.triangles.as_flattened().iter().flat_map(|i| i.to_le_bytes()));
    fs::write(path, bytes).map_err(|error| format!("{}: {error}", path.display()))
}

/// A ray and its parameter interval.
pub(super) type Query = (Ray, Interval);

/// Reads the rays of every `stride`th block of 256.
pub(super) fn rays(path: &Path, stride: usize) -> Result<Vec<Query>, String> {
    let words = words(path, b"RAY1")?;
    let (rays, _) = words.get(1..).unwrap_or_default().as_chunks::<8>();
    let blocks = rays.chunks(LANES).step_by(stride.max(1));
    let rays: Vec<Query> = blocks.flatten().map(query).collect();
    // Streams count hits from 0 on, and both modes must trace the same rays.
    match rays.iter().any(|(_, interval)| interval.min != 0.0) {
        true => Err(format!("{}: a ray's smallest parameter is not 0", path.display())),
        false => Ok(rays),
    }
}

fn query(words: &[[u8; 4]; 8]) -> Query {
    let [ox, oy, oz, min, dx, dy, dz, max] = words.map(|word| f64::from(f32::from_le_bytes(word)));
    let ray = Ray::new(DVec3::new(ox, oy, oz), DVec3::new(dx, dy, dz));
    (ray, Interval { min, max })
}

/// Writes rays.
pub(super) fn write_rays(path: &Path, rays: &[Query]) -> Result<(), String> {
    let mut bytes = b"RAY1".to_vec();
    bytes.extend((rays.len() as u32).to_le_bytes());
    for (ray, interval) in rays {
        let (o, d) = (ray.origin, ray.direction);
        let numbers = [o.x, o.y, o.z, interval.min, d.x, d.y, d.z, interval.max];
        bytes.extend(numbers.map(|x| x as f32).iter().flat_map(|x| x.to_le_bytes()));
    }
    fs::write(path, bytes).map_err(|error| format!("{}: {error}", path.display()))
}
