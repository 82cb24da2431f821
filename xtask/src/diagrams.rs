//! The pictures of the documentation that explain something. They are small, so that
//! `readme --check` can render all of them.

use crate::readme::{build, render};
use crate::work;
use std::path::{Path, PathBuf};
use whitstone::core::{DebugBounds, Registry};
use whitstone::image::{Raster, ToneMap};
use whitstone::validate::tree;
use whitstone::{Failure, wireframe};

/// The pixel whose rays are drawn, the side from which the scene is seen then, and the length that
/// is drawn of a ray that hits nothing, in metres.
const PIXEL: [usize; 2] = [130, 80];
const SIDE: &str = "camera.look_at={ origin = [8.5, 4.5, 5.5], target = [0, 0.9, 1.6] }";
const ESCAPED: f64 = 3.0;

/// The pictures, as PNG files.
pub(crate) fn all(registry: &Registry) -> Result<Vec<(PathBuf, Vec<u8>)>, Failure> {
    let pictures = [
        ("horizon-filters", filters(registry)?),
        ("depths", depths(registry)?),
        ("shadings", shadings(registry)?),
        ("ray-tree", ray_tree(registry)?),
        ("work", work::picture(registry)?),
    ];
    let file = |(name, raster): (&str, Raster)| {
        let bytes = raster.to_png().map_err(Failure::environment)?;
        Ok((PathBuf::from(format!("docs/images/{name}.png")), bytes))
    };
    pictures.into_iter().map(file).collect()
}

/// The gap between the pictures of a grid, in pixels.
pub(crate) const GAP: usize = 4;

/// Equal pictures in rows, with a gap between them.
pub(crate) fn grid(pictures: &[Raster], columns: usize) -> Raster {
    let (width, height) = (pictures[0].width() + GAP, pictures[0].height() + GAP);
    let rows = pictures.len().div_ceil(columns);
    let mut all = Raster::filled(columns * width - GAP, rows * height - GAP, [255; 3]);
    for (k, picture) in pictures.iter().enumerate() {
        all.draw(picture, k % columns * width, k / columns * height);
    }
    all
}

/// A scene with overrides.
pub(crate) fn picture(registry: &Registry, scene: &str, overrides: &[String]) -> Result<Raster, Failure> {
    let (film, hash) = render(registry, Path::new(scene), overrides)?;
    let image = film.to_image(&hash).map_err(Failure::usage)?;
    Raster::preview(&image, ToneMap::default()).map_err(Failure::usage)
}

/// The override of the size of an image.
pub(crate) fn size(width: u32, height: u32) -> String {
    format!("film={{ width = {width}, height = {height} }}")
}

/// One sample per pixel of the same plane, by each filter of the texture.
fn filters(registry: &Registry) -> Result<Raster, Failure> {
    let of = |filter: &str| {
        let filter = format!("texture.ground.filter=\"{filter}\"");
        picture(registry, "studies/scenes/horizon.toml", &[size(200, 150), filter])
    };
    let pictures: Result<Vec<Raster>, Failure> = ["nearest", "bilinear", "trilinear", "ewa"]
        .map(of)
        .into_iter()
        .collect();
    Ok(grid(&pictures?, 4))
}

/// Glass with a maximum depth from 0 to 8.
fn depths(registry: &Registry) -> Result<Raster, Failure> {
    let of = |depth: u32| {
        let overrides = [
            size(232, 174),
            "sampler={ type = \"grid\", samples_per_axis = 2 }".to_owned(),
            format!("integrator.max_depth={depth}"),
        ];
        picture(registry, "scenes/showcase/nested_dielectrics.toml", &overrides)
    };
    let pictures: Result<Vec<Raster>, Failure> = (0..=8).map(of).collect();
    Ok(grid(&pictures?, 3))
}

/// Flat, Gouraud and Phong shading.
fn shadings(registry: &Registry) -> Result<Raster, Failure> {
    let of = |name: &str| {
        let overrides = [
            size(240, 180),
            "sampler={ type = \"grid\", samples_per_axis = 2 }".to_owned(),
        ];
        picture(
            registry,
            &format!("scenes/showcase/shading_{name}.toml"),
            &overrides,
        )
    };
    let pictures: Result<Vec<Raster>, Failure> = ["flat", "gouraud", "phong"].map(of).into_iter().collect();
    Ok(grid(&pictures?, 3))
}

/// The rays of one pixel of the classic scene, seen from the side; colours by the number of
/// bounces.
fn ray_tree(registry: &Registry) -> Result<Raster, Failure> {
    let scene = Path::new("scenes/showcase/classic.toml");
    let nodes = tree::ours(&build(registry, scene, &[])?, PIXEL, 0);
    let segments = nodes.iter().filter(|node| !node.limit).map(|node| DebugBounds {
        depth: node.path.len(),
        segments: vec![[
            node.ray.origin,
            match node.shape {
                -1 => node.ray.origin + ESCAPED * node.ray.direction,
                _ => node.position,
            },
        ]],
    });
    let segments: Vec<DebugBounds> = segments.collect();
    let overrides = [
        size(640, 400),
        "sampler={ type = \"grid\", samples_per_axis = 2 }".to_owned(),
        SIDE.to_owned(),
    ];
    wireframe::lines(&build(registry, scene, &overrides)?, &segments)
}
