//! Laws of integrators, and small scenes to check them.

use crate::streams::integrator_streams;
use std::sync::Arc;
use whitstone_core::{
    Aabb, Accelerator, BsdfFlags, DVec2, DVec3, Geometry, IncidentLight, Integrator, Interval, Light,
    LightFlags, LightSample, LightSamples, LoweredShape, Material, PathState, PreliminaryIntersection, Ray,
    Rgb, Scene, Scratch, SelfHitFilter, Shape, ShapeHit, SpecularRay, SpecularRayKind, SpecularRays,
    Statistics, SurfaceAttributes, SurfaceInteraction, Transmittance, triangle::ShearedRay,
};

/// An infinite plane through a point; the normal points outside.
#[derive(Clone, Copy, Debug)]
pub struct Wall {
    /// A point of the plane.
    pub point: DVec3,
    /// Unit normal.
    pub normal: DVec3,
}

impl Shape for Wall {
    fn bounds(&self) -> Aabb {
        Aabb::EVERYTHING
    }

    fn intersect(&self, ray: &Ray, interval: Interval, origin_primitive: Option<u32>) -> Option<ShapeHit> {
        let t = (self.point - ray.origin).dot(self.normal) / ray.direction.dot(self.normal);
        (origin_primitive.is_none() && interval.contains(t)).then_some(ShapeHit {
            t,
            primitive: 0,
            prim_uv: DVec2::ZERO,
        })
    }

    fn surface(&self, ray: &Ray, hit: &PreliminaryIntersection, _: SurfaceAttributes) -> SurfaceInteraction {
        SurfaceInteraction::new(ray.at(hit.t), 0.0, self.normal)
    }
}

/// A material with each term that integrators distinguish, simple enough to sum by hand.
#[derive(Clone, Copy, Debug, Default)]
pub struct Simple {
    /// Local radiance: this times (ambient + sum of `E n·l`).
    pub diffuse: f64,
    /// Weight of the mirror reflection.
    pub reflect: Rgb,
    /// Weight of the undeviated transmission.
    pub transmit: Rgb,
    /// Medium that the transmitted ray enters from outside; none when it leaves.
    pub absorption: Rgb,
    /// If set, the transmitted ray stays in its current medium.
    pub straight: bool,
    /// Emitted radiance.
    pub emission: Rgb,
    /// Transmittance of shadow rays, filtered or not.
    pub hole: Rgb,
    /// Transmittance of filtered shadow rays. They enter `absorption` from outside and leave it
    /// from inside.
    pub filter: Rgb,
    /// If set, the reflection goes into the surface and the transmission back, in violation of rule
    /// G.
    pub wrong_sides: bool,
}

impl Material for Simple {
    fn flags(&self) -> BsdfFlags {
        let when = |there: bool, lobe| if there { lobe } else { BsdfFlags::NOTHING };
        BsdfFlags::LOCAL
            | BsdfFlags::REFLECTION
            | when(!self.straight, BsdfFlags::TRANSMISSION)
            | when(self.straight, BsdfFlags::NULL)
            | when(!self.emission.is_black(), BsdfFlags::EMISSION)
            | when(!self.hole.is_black(), BsdfFlags::CUT_OUTS)
            | when(!self.filter.is_black(), BsdfFlags::TRANSPARENT_SHADOWS)
    }

    fn needs(&self) -> SurfaceAttributes {
        SurfaceAttributes::NOTHING
    }

    fn local_illumination(&self, point: &SurfaceInteraction, view: DVec3, light: &LightSamples<'_>) -> Rgb {
        let n = point.n_towards(view);
        let term = |light: &IncidentLight| light.irradiance * n.dot(light.direction);
        (light.ambient + light.lights.iter().map(term).sum()) * self.diffuse
    }

    fn emission(&self, _: &SurfaceInteraction, _: DVec3) -> Rgb {
        self.emission
    }

    fn shadow_transmittance(
        &self,
        point: &SurfaceInteraction,
        direction: DVec3,
        filtered: bool,
    ) -> Transmittance {
        if !filtered {
            return Transmittance::straight(self.hole);
        }
        let entering = point.n_g.dot(direction) < 0.0;
        Transmittance {
            weight: self.hole + self.filter,
            medium: Some(if entering { self.absorption } else { Rgb::BLACK }),
        }
    }

    fn specular_rays(&self, point: &SurfaceInteraction, view: DVec3, out: &mut SpecularRays) {
        let n = point.n_towards(view);
        let entering = point.n_g.dot(view) > 0.0;
        let (mirrored, through) = (2.0 * n.dot(view) * n - view, -view);
        let (reflected, transmitted) = if self.wrong_sides {
            (through, mirrored)
        } else {
            (mirrored, through)
        };
        let absorption = if entering { self.absorption } else { Rgb::BLACK };
        let reflection = SpecularRay {
            direction: reflected,
            weight: self.reflect,
            kind: SpecularRayKind::Reflection,
        };
        let kind = if self.straight {
            SpecularRayKind::Null
        } else {
            SpecularRayKind::Transmission { absorption }
        };
        out.push(reflection);
        out.push(SpecularRay {
            direction: transmitted,
            weight: self.transmit,
            kind,
        });
    }
}

/// Background, ambient light and a point light in one.
#[derive(Clone, Copy, Debug, Default)]
pub struct Lamp {
    /// Radiance of the background where y > 0, half of it elsewhere.
    pub background: Rgb,
    /// Ambient radiance.
    pub ambient: Rgb,
    /// Position and irradiance at any distance.
    pub lamp: Option<(DVec3, f64)>,
}

impl Light for Lamp {
    fn flags(&self) -> LightFlags {
        LightFlags::SAMPLES | LightFlags::AMBIENT | LightFlags::BACKGROUND
    }

    fn samples(&self, point: DVec3, out: &mut Vec<LightSample>) {
        if let Some((position, irradiance)) = self.lamp {
            let (direction, distance) = (position - point).normalize_and_length();
            out.push(LightSample {
                direction,
                distance,
                irradiance: Rgb::splat(irradiance),
            });
        }
    }

    fn ambient(&self) -> Rgb {
        self.ambient
    }

    fn background(&self, direction: DVec3) -> Rgb {
        if direction.y > 0.0 {
            self.background
        } else {
            self.background * 0.5
        }
    }
}

/// Tests every element in order.
struct TestAll(Arc<Geometry>);

impl Accelerator for TestAll {
    fn intersect(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<PreliminaryIntersection> {
        let sheared = ShearedRay::new(ray);
        self.0
            .elements()
            .filter_map(|element| self.0.intersect(element, ray, &sheared, interval, skip))
            .reduce(|best, hit| if hit.is_nearer_than(&best) { hit } else { best })
    }

    fn occluded(&self, ray: &Ray, interval: Interval, skip: SelfHitFilter) -> bool {
        self.intersect(ray, interval, skip).is_some()
    }

    fn statistics(&self) -> Statistics {
        Statistics::new()
    }
}

/// A scene of a few walls and a light.
pub fn world_of_walls(walls: &[(Wall, Simple)], light: Lamp) -> Scene {
    let shapes = walls
        .iter()
        .map(|(wall, _)| LoweredShape::Custom(Box::new(*wall)))
        .collect();
    let geometry = Arc::new(Geometry::new(shapes));
    let accelerator = Box::new(TestAll(geometry.clone()));
    let materials = walls
        .iter()
        .map(|(_, material)| Arc::new(*material) as Arc<dyn Material>)
        .collect();
    Scene::new(geometry, accelerator, materials, vec![Arc::new(light)])
}

/// A wall at this height that faces up.
pub fn floor(height: f64) -> Wall {
    Wall {
        point: DVec3::new(0.0, height, 0.0),
        normal: DVec3::Y,
    }
}

fn radiance(integrator: &dyn Integrator, scene: &Scene, ray: Ray) -> Rgb {
    let mut clean = Scratch::default();
    let found = integrator.radiance(scene, &ray, &mut clean);
    assert!(clean.counters.closest >= 1, "a camera ray must be counted");
    let mut recording = Scratch::recording();
    let recorded = integrator.radiance(scene, &ray, &mut recording);
    assert_eq!(found, recorded, "recording must not change the radiance");
    let nodes = recording.record.unwrap_or_default();
    let sum: Rgb = nodes.iter().map(|node| node.throughput * node.local).sum();
    let scale = found.max_component().max(1.0);
    assert!(
        (found + sum * -1.0).map(f64::abs).max_component() <= 1e-12 * scale,
        "the record must sum to {found:?}, found {sum:?}"
    );
    let rays: Vec<Ray> = (0..400)
        .map(|k| {
            let aside = DVec3::new(0.011, 0.0, 0.007) * f64::from(k);
            let direction = if k % 7 == 3 { -ray.direction } else { ray.direction };
            Ray::new(ray.origin + aside, direction)
        })
        .collect();
    let broken = integrator_streams(integrator, scene, &rays).err();
    assert_eq!(
        broken, None,
        "streams must give the same radiance as single calls"
    );
    // State left behind by another ray.
    let lost = PathState::camera(Ray::new(DVec3::ONE, DVec3::NEG_Y));
    let mut used = Scratch::default();
    used.pending.push(lost);
    used.incoming.push(IncidentLight {
        direction: DVec3::Y,
        irradiance: Rgb::WHITE,
    });
    used.samples.push(LightSample {
        direction: DVec3::Y,
        distance: 1.0,
        irradiance: Rgb::WHITE,
    });
    let again = integrator.radiance(scene, &ray, &mut used);
    assert_eq!(
        again, found,
        "radiance must depend on the scene and the ray only, not on the working memory"
    );
    found
}

/// Checks the laws of integrators:
///
/// - Rays that hit nothing return the background.
/// - Surfaces return their local radiance, with shadows if and only if `shadows`; lights on the
///   other side of the geometry contribute nothing.
/// - Specular rays are followed if and only if the integrator declares it, and none on the wrong
///   side of the geometry.
/// - The result depends on nothing else.
/// - If rays are recorded, the record sums to the result.
///
/// The integrator must be in its default configuration, except for shadows.
///
/// # Panics
///
/// If the integrator breaks one of these laws; the message says which and where.
pub fn integrator_laws(integrator: &dyn Integrator, shadows: bool) {
    let sky = Rgb::new(1.0, 2.0, 4.0);
    let down = Ray::new(DVec3::Y, DVec3::NEG_Y);
    let up = Ray::new(DVec3::Y, DVec3::Y);
    let matte = Simple {
        diffuse: 0.5,
        ..Simple::default()
    };

    let empty = world_of_walls(
        &[],
        Lamp {
            background: sky,
            ..Lamp::default()
        },
    );
    assert_eq!(
        radiance(integrator, &empty, up),
        sky,
        "an empty scene must show the background"
    );
    assert_eq!(
        radiance(integrator, &empty, down),
        sky * 0.5,
        "the background must depend on the ray's direction"
    );
    let dark = world_of_walls(&[], Lamp::default());
    assert_eq!(
        radiance(integrator, &dark, up),
        Rgb::BLACK,
        "a scene without a background must be black"
    );

    // A light 5 m above the floor, and a wall that may be in between.
    let lit = |wall: Option<f64>| {
        let mut walls = vec![(floor(0.0), matte)];
        walls.extend(wall.map(|height| (floor(height), matte)));
        let ambient = Rgb::splat(0.25);
        let lamp = Some((DVec3::new(0.0, 5.0, 0.0), 3.0));
        let scene = world_of_walls(
            &walls,
            Lamp {
                background: sky,
                ambient,
                lamp,
            },
        );
        radiance(integrator, &scene, down)
    };
    let (bright, shaded) = (Rgb::splat(0.5 * 3.25), Rgb::splat(0.5 * 0.25));
    assert_eq!(lit(None), bright, "ambient light and a lamp");
    assert_eq!(
        lit(Some(2.0)),
        if shadows { shaded } else { bright },
        "a wall in front of the lamp"
    );
    assert_eq!(lit(Some(6.0)), bright, "a wall behind the lamp must not hide it");
    assert_eq!(
        lit(Some(5.0)),
        bright,
        "a wall that contains the lamp must not hide it"
    );
    assert_eq!(
        lit(Some(-5.0)),
        bright,
        "a wall below the floor must not hide the lamp"
    );
    let below = Lamp {
        lamp: Some((DVec3::new(0.0, -5.0, 0.0), 3.0)),
        ..Lamp::default()
    };
    let found = radiance(integrator, &world_of_walls(&[(floor(0.0), matte)], below), down);
    assert_eq!(
        found,
        Rgb::BLACK,
        "a lamp below the floor must not illuminate its upper side"
    );

    let light = Lamp {
        background: sky,
        ..Lamp::default()
    };
    let mirror = Simple {
        reflect: Rgb::new(0.5, 0.25, 0.0),
        ..Simple::default()
    };
    let glass = Simple {
        transmit: Rgb::splat(0.5),
        ..Simple::default()
    };
    let follows = integrator.follows_branches();
    let if_follows = |color| if follows { color } else { Rgb::BLACK };
    let seen = |material| {
        radiance(
            integrator,
            &world_of_walls(&[(floor(0.0), material)], light),
            down,
        )
    };
    assert_eq!(
        seen(mirror),
        if_follows(Rgb::new(0.5, 0.5, 0.0)),
        "a mirror must show the background above"
    );
    assert_eq!(
        seen(glass),
        if_follows(sky * 0.25),
        "a pane must show the background below"
    );
    let wrong = Simple {
        reflect: Rgb::WHITE,
        transmit: Rgb::WHITE,
        wrong_sides: true,
        ..Simple::default()
    };
    assert_eq!(
        seen(wrong),
        Rgb::BLACK,
        "specular rays on the wrong side of the geometry must not be followed"
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{DirectLighting, MediumState, ShadowMode};

    /// A recursive integrator with one bounce and a switch for each fault.
    #[derive(Default)]
    struct Made {
        claims_branches: bool,
        forgets_shadows: bool,
        forgets_sides: bool,
        reads_scratch: bool,
        forgets_background: bool,
        forgets_record: bool,
    }

    impl Integrator for Made {
        fn follows_branches(&self) -> bool {
            self.claims_branches
        }

        fn radiance(&self, scene: &Scene, ray: &Ray, scratch: &mut Scratch) -> Rgb {
            scratch.counters.closest += 1;
            let left_over = if self.reads_scratch {
                scratch.pending.len() as f64
            } else {
                0.0
            };
            let Some(hit) = scene
                .accelerator
                .intersect(ray, Interval::FORWARD, SelfHitFilter::NOTHING)
            else {
                let background = if self.forgets_background {
                    Rgb::BLACK
                } else {
                    scene.background(ray.direction)
                };
                scratch.note(&PathState::camera(*ray), None, Rgb::WHITE, background);
                return background;
            };
            let view = -ray.direction;
            let point = scene.surface(ray, &hit).seen_from(view);
            let material = &scene.materials[hit.shape as usize];
            let shadows = if self.forgets_shadows {
                ShadowMode::None
            } else {
                ShadowMode::Opaque
            };
            scene.gather_lights(
                &point,
                view,
                SelfHitFilter::leaving(&hit),
                DirectLighting {
                    shadows,
                    light_cutoff: 0.0,
                },
                MediumState::absorbing(Rgb::BLACK),
                scratch,
            );
            let light = LightSamples {
                ambient: scene.ambient,
                lights: &scratch.incoming,
            };
            let mut sum = material.local_illumination(&point, view, &light) + Rgb::splat(left_over);
            if self.claims_branches {
                let mut branches = SpecularRays::default();
                material.specular_rays(&point, view, &mut branches);
                for branch in branches.iter() {
                    let right = match branch.kind {
                        SpecularRayKind::Reflection => point.same_side(view, branch.direction),
                        _ => point.opposite_sides(view, branch.direction),
                    };
                    if right || self.forgets_sides {
                        sum += branch.weight * scene.background(branch.direction);
                    }
                }
            }
            if !self.forgets_record {
                let path = PathState::camera(*ray);
                scratch.note(&path, Some((&hit, &point)), Rgb::WHITE, sum);
            }
            sum
        }
    }

    #[test]
    fn correct_integrators_pass() {
        integrator_laws(&Made::default(), true);
        integrator_laws(
            &Made {
                claims_branches: true,
                ..Made::default()
            },
            true,
        );
        integrator_laws(
            &Made {
                forgets_shadows: true,
                ..Made::default()
            },
            false,
        );
    }

    #[test]
    #[should_panic(expected = "a wall in front of the lamp")]
    fn missing_shadows_are_found() {
        integrator_laws(
            &Made {
                forgets_shadows: true,
                ..Made::default()
            },
            true,
        );
    }

    #[test]
    #[should_panic(expected = "wrong side of the geometry")]
    fn specular_rays_on_the_wrong_side_are_found() {
        integrator_laws(
            &Made {
                claims_branches: true,
                forgets_sides: true,
                ..Made::default()
            },
            true,
        );
    }

    #[test]
    #[should_panic(expected = "not on the working memory")]
    fn stale_working_memory_is_found() {
        integrator_laws(
            &Made {
                reads_scratch: true,
                ..Made::default()
            },
            true,
        );
    }

    #[test]
    #[should_panic(expected = "the record must sum to")]
    fn a_missing_record_is_found() {
        integrator_laws(
            &Made {
                forgets_record: true,
                ..Made::default()
            },
            true,
        );
    }

    #[test]
    #[should_panic(expected = "an empty scene must")]
    fn a_missing_background_is_found() {
        integrator_laws(
            &Made {
                forgets_background: true,
                ..Made::default()
            },
            true,
        );
    }
}
