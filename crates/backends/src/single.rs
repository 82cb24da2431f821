//! Shared code of the backends: triangles in single precision, all other elements in double
//! precision.

use std::sync::Arc;
use whitstone_core::triangle::ShearedRay;
use whitstone_core::{
    Accelerator, DVec2, Element, Geometry, InstanceId, Interval, LoweredShape, PreliminaryIntersection, Ray,
    SceneError, SceneErrors, SelfHitFilter, Statistics, TriangleMesh,
};

/// Numbers of a shape and of a triangle in it.
pub(crate) type TriangleId = (u32, u32);

/// A ray in single precision.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SingleRay {
    pub(crate) origin: [f32; 3],
    pub(crate) direction: [f32; 3],
    pub(crate) min: f32,
    pub(crate) max: f32,
}

/// A hit in single precision.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SingleHit {
    pub(crate) id: TriangleId,
    pub(crate) t: f32,
    /// Barycentric weights of the second and third vertex.
    pub(crate) uv: [f32; 2],
}

/// Ray-triangle queries of a backend.
pub(crate) trait Triangles: Send + Sync {
    /// The nearest hit of a triangle other than `skip`.
    fn intersect(&self, ray: &SingleRay, skip: Option<TriangleId>) -> Option<SingleHit>;

    /// Whether a triangle other than `skip` is hit.
    fn occluded(&self, ray: &SingleRay, skip: Option<TriangleId>) -> bool;
}

/// The triangles of a backend, and all elements that are not triangles.
pub(crate) struct Single<T> {
    pub(crate) geometry: Arc<Geometry>,
    pub(crate) triangles: T,
    /// Elements that are not triangles, tested one by one.
    pub(crate) others: Vec<Element>,
    pub(crate) statistics: Statistics,
    pub(crate) approximation_note: String,
}

/// The elements that are not triangles.
pub(crate) fn others(geometry: &Geometry) -> Vec<Element> {
    let is_other = |element: &Element| !matches!(element, Element::Triangle { .. });
    geometry.elements().filter(is_other).collect()
}

/// The meshes with their shape numbers. Fails if a coordinate exceeds `limit`: single precision
/// holds up to about 10^38, and backends multiply coordinates.
pub(crate) fn meshes(geometry: &Geometry, limit: f64) -> Result<Vec<(u32, &TriangleMesh)>, SceneErrors> {
    let shapes = geometry.shapes().iter().zip(0u32..);
    let meshes: Vec<_> = shapes
        .filter_map(|(shape, number)| match shape {
            LoweredShape::Triangles(mesh) if !mesh.triangles.is_empty() => Some((number, mesh)),
            _ => None,
        })
        .collect();
    let is_near = |mesh: &TriangleMesh| mesh.positions.iter().all(|p| p.abs().max_element() <= limit);
    match meshes.iter().find(|(_, mesh)| !is_near(mesh)) {
        None => Ok(meshes),
        Some((number, _)) => Err(SceneError::anywhere(format!(
            "expected coordinates of at most {limit:e}, since this accelerator uses single precision; shape {number} exceeds this"
        ))
        .with_help("choose another accelerator, such as \"bvh\"")
        .into()),
    }
}

/// Converts a ray to single precision; `None` if it is out of range.
fn single(ray: &Ray, interval: Interval, skip: SelfHitFilter) -> Option<SingleRay> {
    let (origin, direction) = (ray.origin.as_vec3(), ray.direction.as_vec3());
    if !(origin.is_finite() && direction.is_finite()) {
        return None;
    }
    // Rounding may put the origin of a spawned ray on either side of its surface, and of all
    // triangles nearby: hits within that rounding do not count.
    let rounding = match skip.id() {
        Some(_) => 8.0 * f32::EPSILON * origin.abs().max_element(),
        None => 0.0,
    };
    Some(SingleRay {
        origin: origin.to_array(),
        direction: direction.to_array(),
        min: (interval.min as f32).max(rounding),
        max: interval.max as f32,
    })
}

/// The triangle that the ray starts from.
fn left(skip: SelfHitFilter) -> Option<TriangleId> {
    let (instance, shape, triangle) = skip.id()?;
    (instance == InstanceId::TOP_LEVEL).then_some((shape, triangle))
}

impl<T: Triangles> Single<T> {
    fn nearest_other(
        &self,
        ray: &Ray,
        mut interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<PreliminaryIntersection> {
        let mut best: Option<PreliminaryIntersection> = None;
        if self.others.is_empty() {
            return None;
        }
        let sheared = ShearedRay::new(ray);
        let mut open = interval;
        for &element in &self.others {
            if let Some(hit) = self.geometry.intersect(element, ray, &sheared, open, skip)
                && best.is_none_or(|best| hit.is_nearer_than(&best))
            {
                best = Some(hit);
                // Elements at the same distance are no longer found: the first one, of the lowest
                // number, stays.
                interval.max = hit.t;
                open = interval;
            }
        }
        best
    }
}

impl<T: Triangles> Accelerator for Single<T> {
    fn intersect(
        &self,
        ray: &Ray,
        mut interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<PreliminaryIntersection> {
        let other = self.nearest_other(ray, interval, skip);
        interval.max = other.map_or(interval.max, |hit| hit.t);
        let triangle = single(ray, interval, skip)
            .and_then(|ray| self.triangles.intersect(&ray, left(skip)))
            .filter(|hit| interval.contains(f64::from(hit.t)));
        match triangle {
            None => other,
            Some(hit) => Some(PreliminaryIntersection {
                t: f64::from(hit.t),
                prim_uv: DVec2::from_array(hit.uv.map(f64::from)),
                instance: InstanceId::TOP_LEVEL,
                shape: hit.id.0,
                primitive: hit.id.1,
            }),
        }
    }

    fn occluded(&self, ray: &Ray, interval: Interval, skip: SelfHitFilter) -> bool {
        single(ray, interval, skip).is_some_and(|ray| self.triangles.occluded(&ray, left(skip)))
            || self.nearest_other(ray, interval, skip).is_some()
    }

    fn statistics(&self) -> Statistics {
        self.statistics.clone()
    }

    fn approximation_note(&self) -> Option<&str> {
        Some(&self.approximation_note)
    }
}
