//! Gouraud shading: colours at the corners of triangles, interpolated.
//!
//! Gouraud, *Continuous shading of curved surfaces*, 1971, with perspective-correct weights: those
//! of the point in world space.

use crate::local_illumination::local_illumination;
use whitstone_core::{
    BsdfFlags, DVec2, DirectLighting, LoweredShape, MediumState, PathState, PreliminaryIntersection, Ray,
    Rgb, Scene, Scratch, SelfHitFilter,
};

/// Radiance along a camera ray that starts at the viewer.
pub(super) fn radiance(
    lighting: DirectLighting,
    scene: &Scene,
    ray: &Ray,
    hit: Option<PreliminaryIntersection>,
    scratch: &mut Scratch,
) -> Rgb {
    let path = PathState::camera(*ray);
    let Some(hit) = hit else {
        let background = scene.background(ray.direction);
        scratch.note(&path, None, Rgb::WHITE, background);
        return background;
    };
    // Other shapes have no corners and are shaded at the hit.
    let triangle = matches!(
        scene.geometry.shapes().get(hit.shape as usize),
        Some(LoweredShape::Triangles(_))
    );
    let DVec2 { x: u, y: v } = hit.prim_uv;
    let corners = [(1.0 - u - v, DVec2::ZERO), (u, DVec2::X), (v, DVec2::Y)];
    let here = [(1.0, hit.prim_uv)];
    let mut sum = Rgb::BLACK;
    for &(weight, prim_uv) in if triangle { &corners[..] } else { &here[..] } {
        let corner = PreliminaryIntersection { prim_uv, ..hit };
        let point = scene.surface(ray, &corner);
        let view = if triangle {
            (ray.origin - point.position).normalize()
        } else {
            -ray.direction
        };
        let point = point.seen_from(view);
        scene.count_shaded(hit.shape, 1, &mut scratch.counters);
        if scene.flags_of(hit.shape).intersects(BsdfFlags::LOCAL_OR_EMISSIVE) {
            let (skip, medium) = (SelfHitFilter::leaving(&hit), MediumState::absorbing(Rgb::BLACK));
            sum +=
                local_illumination(lighting, scene, hit.shape, &point, view, skip, medium, scratch) * weight;
        }
    }
    let point = scene.surface(ray, &hit).seen_from(-ray.direction);
    scratch.note(&path, Some((&hit, &point)), Rgb::WHITE, sum);
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use whitstone_core::{
        Accelerator, DVec3, Geometry, Interval, Material, ShadowMode, Statistics, TriangleMesh,
        triangle::ShearedRay,
    };
    use whitstone_testkit::{Lamp, Simple};

    /// An accelerator over the only triangle of the geometry.
    struct One(Arc<Geometry>);

    impl Accelerator for One {
        fn intersect(
            &self,
            ray: &Ray,
            interval: Interval,
            skip: SelfHitFilter,
        ) -> Option<PreliminaryIntersection> {
            let element = self.0.elements().next()?;
            self.0
                .intersect(element, ray, &ShearedRay::new(ray), interval, skip)
        }

        fn occluded(&self, ray: &Ray, interval: Interval, skip: SelfHitFilter) -> bool {
            self.intersect(ray, interval, skip).is_some()
        }

        fn statistics(&self) -> Statistics {
            Statistics::default()
        }
    }

    /// Under a lamp close above the middle, the corners are dark, and so is the interpolated
    /// middle.
    #[test]
    fn the_middle_is_the_mean_of_the_corners() {
        let positions = vec![
            DVec3::new(-3.0, 0.0, 0.0),
            DVec3::new(3.0, 0.0, 3.0),
            DVec3::new(3.0, 0.0, -3.0),
        ];
        let middle = (positions[0] + positions[1] + positions[2]) / 3.0;
        let lamp = DVec3::new(1.0, 0.5, 0.0);
        let cosine = |p: &DVec3| (lamp - *p).normalize().y;
        let mean = positions.iter().map(cosine).sum::<f64>() / 3.0;
        let geometry = Arc::new(Geometry::new(vec![LoweredShape::Triangles(TriangleMesh {
            positions,
            triangles: vec![[0, 1, 2]],
            orientation: 1.0,
            ..TriangleMesh::default()
        })]));
        let material: Arc<dyn Material> = Arc::new(Simple {
            diffuse: 1.0,
            ..Simple::default()
        });
        let light = Lamp {
            lamp: Some((lamp, 2.0)),
            ..Lamp::default()
        };
        let scene = Scene::new(
            geometry.clone(),
            Box::new(One(geometry)),
            vec![material],
            vec![Arc::new(light)],
        );
        let eye = DVec3::new(0.0, 5.0, 1.0);
        let ray = Ray::new(eye, (middle - eye).normalize());
        let hit = scene
            .accelerator
            .intersect(&ray, Interval::FORWARD, SelfHitFilter::NOTHING);
        let unshadowed = DirectLighting {
            shadows: ShadowMode::None,
            light_cutoff: 0.0,
        };
        let found = radiance(unshadowed, &scene, &ray, hit, &mut Scratch::default());
        assert!((found.g - 2.0 * mean).abs() < 1e-14, "{found:?} {mean}");
        // Shaded directly, the middle would be bright.
        assert!(2.0 * cosine(&middle) > 3.0 * found.g, "{}", cosine(&middle));
    }
}
