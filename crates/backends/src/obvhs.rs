//! The crate obvhs: compressed wide BVHs for single-precision triangles.
//!
//! - Ylitie, Karras, Laine, *Efficient incoherent ray traversal on GPUs through compressed wide
//!   BVHs*, HPG 2017.
//! - Its boxes are widened by absolute amounts (1e-4), and its triangle test is that of Möller and
//!   Trumbore, without a guarantee at edges: it misses more on models of small units.
//!
//! - Example: `--set accelerator.type=obvhs` with any scene.

use crate::single::{Single, SingleHit, SingleRay, TriangleId, Triangles, meshes, others};
use glam::Vec3A;
use obvhs::BvhBuildParams;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use std::time::{Duration, Instant};
use whitstone_core::{
    Accelerator, Accelerators, Context, Geometry, Plugin, SceneError, SceneErrors, Statistics,
};

/// The crate obvhs in single precision, for comparison.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Which of its structures to use.
    #[serde(default)]
    structure: Structure,
    /// Its build quality.
    #[serde(default)]
    quality: Quality,
}

/// Which of its structures to use.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Structure {
    /// Eight children a node, compressed.
    #[default]
    Cwbvh,
    /// Two children a node.
    Bvh2,
}

/// Its build quality.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Quality {
    /// Fastest build.
    Fastest,
    /// Without splits.
    Medium,
    /// With splits.
    Slow,
    /// Fastest ray tracing.
    #[default]
    VerySlow,
}

/// The plugin.
pub struct Obvhs {
    hierarchy: Hierarchy,
    /// In the order of `ids`.
    triangles: Vec<Triangle>,
    ids: Vec<TriangleId>,
}

enum Hierarchy {
    Wide(CwBvh),
    Binary(Bvh2),
}

/// Maximum depth: the traversal of obvhs has a stack of 32.
const DEEPEST: usize = 31;

/// Largest coordinate: squares of lengths are multiplied by lengths.
const FARTHEST: f64 = 1e9;

impl Plugin<Accelerators> for Obvhs {
    const TYPE: &'static str = "obvhs";
    type Config = Config;

    fn build(
        config: Config,
        geometry: Arc<Geometry>,
        _: &mut dyn Context,
    ) -> Result<Box<dyn Accelerator>, SceneErrors> {
        let start = Instant::now();
        let mut backend = Self {
            hierarchy: Hierarchy::Binary(Bvh2::zeroed(0)),
            triangles: Vec::new(),
            ids: Vec::new(),
        };
        for (number, mesh) in meshes(&geometry, FARTHEST)? {
            for triangle in 0..mesh.triangles.len() as u32 {
                let [v0, v1, v2] = mesh.corners(triangle).map(|p| Vec3A::from(p.as_vec3()));
                backend.triangles.push(Triangle { v0, v1, v2 });
                backend.ids.push((number, triangle));
            }
        }
        if !backend.ids.is_empty() {
            backend.hierarchy = build(config.structure, config.quality, &backend.triangles)?;
        }
        let others = others(&geometry);
        let own = size_of_val(&*backend.triangles) + size_of_val(&*backend.ids) + size_of_val(&*others);
        let statistics = Statistics::from([
            ("elements", geometry.elements().count() as f64),
            ("others", others.len() as f64),
            ("nodes", backend.hierarchy.nodes() as f64),
            ("bytes", (own + backend.hierarchy.bytes()) as f64),
            ("build_seconds", start.elapsed().as_secs_f64()),
        ]);
        Ok(Box::new(Single {
            geometry,
            triangles: backend,
            others,
            statistics,
            approximation_note: "obvhs finds triangles in single precision".to_owned(),
        }))
    }
}

fn build(structure: Structure, quality: Quality, triangles: &[Triangle]) -> Result<Hierarchy, SceneError> {
    let parameters = match quality {
        Quality::Fastest => BvhBuildParams::fastest_build(),
        Quality::Medium => BvhBuildParams::medium_build(),
        Quality::Slow => BvhBuildParams::slow_build(),
        Quality::VerySlow => BvhBuildParams::very_slow_build(),
    };
    let mut time = Duration::ZERO;
    match structure {
        Structure::Bvh2 => Ok(Hierarchy::Binary(build_bvh2_from_tris(
            triangles, parameters, &mut time,
        ))),
        Structure::Cwbvh => {
            let wide = build_cwbvh_from_tris(triangles, parameters, &mut time);
            match depth(&wide) {
                0..=DEEPEST => Ok(Hierarchy::Wide(wide)),
                deep => Err(SceneError::anywhere(format!(
                    "expected at most {DEEPEST} levels, found {deep}: the hierarchy that obvhs builds exceeds its traversal stack"
                ))
                .with_help("choose structure = \"bvh2\", or another accelerator")),
            }
        }
    }
}

/// Number of levels below the root.
fn depth(wide: &CwBvh) -> usize {
    let mut deepest = 0;
    let mut open = vec![(0, 0)];
    while let Some((node, depth)) = open.pop() {
        deepest = deepest.max(depth);
        if let Some(node) = wide.nodes.get(node) {
            let children = node.imask.count_ones() as usize;
            let first = node.child_base_idx as usize;
            open.extend((first..first + children).map(|child| (child, depth + 1)));
        }
    }
    deepest
}

impl Hierarchy {
    fn nodes(&self) -> usize {
        match self {
            Self::Wide(wide) => wide.nodes.len(),
            Self::Binary(binary) => binary.nodes.len(),
        }
    }

    fn bytes(&self) -> usize {
        match self {
            Self::Wide(wide) => size_of_val(&*wide.nodes) + size_of_val(&*wide.primitive_indices),
            Self::Binary(binary) => size_of_val(&*binary.nodes) + size_of_val(&*binary.primitive_indices),
        }
    }

    /// Index of the triangle at a place of the hierarchy.
    #[inline]
    fn triangle(&self, place: usize) -> usize {
        let indices = match self {
            Self::Wide(wide) => &wide.primitive_indices,
            Self::Binary(binary) => &binary.primitive_indices,
        };
        indices[place] as usize
    }
}

impl Obvhs {
    /// Distance of the hit; infinity for a miss.
    #[inline]
    fn test(&self, ray: &Ray, place: usize, skip: Option<TriangleId>) -> f32 {
        let triangle = self.hierarchy.triangle(place);
        match skip {
            Some(skip) if self.ids[triangle] == skip => f32::INFINITY,
            _ => self.triangles[triangle].intersect(ray),
        }
    }
}

fn theirs(ray: &SingleRay) -> Ray {
    let (origin, direction) = (Vec3A::from(ray.origin), Vec3A::from(ray.direction));
    Ray::new(origin, direction, ray.min, ray.max)
}

/// Barycentric weights of the second and third vertex where a ray meets the plane of a triangle.
fn weights(triangle: &Triangle, ray: &SingleRay) -> [f32; 2] {
    let (origin, direction) = (Vec3A::from(ray.origin), Vec3A::from(ray.direction));
    let (e1, e2) = (triangle.v1 - triangle.v0, triangle.v2 - triangle.v0);
    // Möller, Trumbore, *Fast, minimum storage ray/triangle intersection*, 1997.
    let p = direction.cross(e2);
    let s = origin - triangle.v0;
    let q = s.cross(e1);
    [s.dot(p), direction.dot(q)].map(|weight| (weight / e1.dot(p)).clamp(0.0, 1.0))
}

impl Triangles for Obvhs {
    #[inline]
    fn intersect(&self, ray: &SingleRay, skip: Option<TriangleId>) -> Option<SingleHit> {
        if self.ids.is_empty() {
            return None;
        }
        let mut hit = RayHit::none();
        let test = |ray: &Ray, place: usize| self.test(ray, place, skip);
        let found = match &self.hierarchy {
            Hierarchy::Wide(wide) => wide.ray_traverse(theirs(ray), &mut hit, test),
            Hierarchy::Binary(binary) => binary.ray_traverse(theirs(ray), &mut hit, test),
        };
        let triangle = found.then(|| self.hierarchy.triangle(hit.primitive_id as usize))?;
        Some(SingleHit {
            id: self.ids[triangle],
            t: hit.t,
            uv: weights(&self.triangles[triangle], ray),
        })
    }

    #[inline]
    fn occluded(&self, ray: &SingleRay, skip: Option<TriangleId>) -> bool {
        let test = |ray: &Ray, place: usize| self.test(ray, place, skip);
        !self.ids.is_empty()
            && match &self.hierarchy {
                Hierarchy::Wide(wide) => !wide.ray_traverse_miss(theirs(ray), test),
                Hierarchy::Binary(binary) => !binary.ray_traverse_miss(theirs(ray), test),
            }
    }
}
