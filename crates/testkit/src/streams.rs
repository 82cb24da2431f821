//! The law of streams: a stream method gives the same bits as the scalar method for every ray.

use whitstone_core::stream::{
    Colors, HitStream, LANES, Lanes, RayStream, SampleStreams, SurfaceStream, Vectors,
};
use whitstone_core::{
    Accelerator, BsdfFlags, Camera, DVec2, DVec3, Geometry, IncidentLight, Integrator, Interval, Light,
    LightFlags, LightSample, LightSamples, Material, PreliminaryIntersection, Ray, Rgb, Scene, Scratch,
    SelfHitFilter, SpecularRay, SpecularRayKind, SpecularRayStream, SpecularRayStreams, SpecularRays,
    SurfaceAttributes, SurfaceInteraction, Texture,
};

type Checked = Result<(), String>;

/// A ray, the end of its interval and the skipped primitive.
pub(crate) type Query = (Ray, f64, SelfHitFilter);

fn law(holds: bool, text: impl FnOnce() -> String) -> Checked {
    if holds {
        Ok(())
    } else {
        Err(format!(
            "a stream must give the same bits as single calls: {}",
            text()
        ))
    }
}

/// The same bits; all NaNs are equal.
fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}

fn same_vectors(a: DVec3, b: DVec3) -> bool {
    (0..3).all(|i| same(a[i], b[i]))
}

fn same_colors(a: Rgb, b: Rgb) -> bool {
    let (a, b) = (a.to_array(), b.to_array());
    (0..3).all(|i| same(a[i], b[i]))
}

/// Fills the used lanes with the queries and the others with meaningless values.
fn stream_of(queries: &[Query]) -> RayStream {
    let mut rays = RayStream::default();
    for lane in 0..LANES {
        let nonsense = (
            Ray::new(DVec3::NAN, DVec3::ZERO),
            f64::NAN,
            SelfHitFilter::NOTHING,
        );
        let (ray, limit, skip) = *queries.get(lane).unwrap_or(&nonsense);
        rays.set(lane, ray, limit, skip);
    }
    rays.len = queries.len();
    rays
}

/// Checks nearest hits and occlusion of an accelerator.
pub(crate) fn accelerator_streams(accelerator: &dyn Accelerator, queries: &[Query]) -> Checked {
    let mut hits = HitStream::default();
    for queries in chunks(queries) {
        let rays = stream_of(queries);
        accelerator.intersect_stream(&rays, &mut hits);
        let mut hidden: Lanes<bool> = [true; LANES];
        accelerator.occluded_stream(&rays, &mut hidden);
        for (lane, (ray, limit, skip)) in queries.iter().enumerate() {
            let expected = accelerator.intersect(ray, Interval::up_to(*limit), *skip);
            let found = hits.get(lane);
            let place = || format!("{ray:?} up to {limit}, {skip:?}: expected {expected:?}, found {found:?}");
            law(same_hits(&expected, &found), place)?;
            law(hidden[lane] == expected.is_some(), || {
                format!("{ray:?}: occluded is {}", hidden[lane])
            })?;
        }
    }
    Ok(())
}

fn same_hits(a: &Option<PreliminaryIntersection>, b: &Option<PreliminaryIntersection>) -> bool {
    match (a, b) {
        (None, None) => true,
        (Some(a), Some(b)) => {
            a.id() == b.id()
                && same(a.t, b.t)
                && same(a.prim_uv.x, b.prim_uv.x)
                && same(a.prim_uv.y, b.prim_uv.y)
        }
        _ => false,
    }
}

/// Checks the surface points of the only shape of a geometry, at these hits.
pub(crate) fn surface_streams(geometry: &Geometry, hits: &[(Ray, PreliminaryIntersection)]) -> Checked {
    for hits in chunks(hits) {
        let queries: Vec<Query> = hits
            .iter()
            .map(|(ray, _)| (*ray, f64::INFINITY, SelfHitFilter::NOTHING))
            .collect();
        let rays = stream_of(&queries);
        let mut stream = HitStream::default();
        for (lane, (_, hit)) in hits.iter().enumerate() {
            stream.set(lane, hit);
        }
        for needs in [
            SurfaceAttributes::NOTHING,
            SurfaceAttributes::SHADING_NORMAL,
            SurfaceAttributes::UV,
        ] {
            let mut points = SurfaceStream::default();
            geometry.surface_stream(0, &rays, &stream, needs, &mut points);
            for (lane, (ray, hit)) in hits.iter().enumerate() {
                let (expected, found) = (geometry.surface(ray, hit, needs), points.get(lane));
                law(same_points(&expected, &found, needs), || {
                    format!("{ray:?}, {hit:?}: expected {expected:?}, found {found:?}")
                })?;
            }
        }
    }
    Ok(())
}

fn same_points(a: &SurfaceInteraction, b: &SurfaceInteraction, needs: SurfaceAttributes) -> bool {
    same_vectors(a.position, b.position)
        && same(a.error, b.error)
        && same_vectors(a.n_g, b.n_g)
        && same_vectors(a.n_s, b.n_s)
        && (!needs.contains(SurfaceAttributes::UV) || (same(a.uv.x, b.uv.x) && same(a.uv.y, b.uv.y)))
}

pub(crate) fn camera_streams(camera: &dyn Camera, raster: &[DVec2]) -> Checked {
    for raster in chunks(raster) {
        let mut lanes: Lanes<DVec2> = [DVec2::NAN; LANES];
        lanes[..raster.len()].copy_from_slice(raster);
        let mut rays = stream_of(&[]);
        rays.len = raster.len();
        camera.ray_stream(&lanes, &mut rays);
        for (lane, raster) in raster.iter().enumerate() {
            same_rays(&camera.ray(*raster), &rays.ray(lane), *raster)?;
        }
        for point in 0..camera.lens_points() {
            camera.lens_stream(&lanes, point, &mut rays);
            for (lane, raster) in raster.iter().enumerate() {
                same_rays(&camera.lens_ray(*raster, point), &rays.ray(lane), *raster)?;
            }
        }
    }
    Ok(())
}

fn same_rays(expected: &Ray, found: &Ray, raster: DVec2) -> Checked {
    let right =
        same_vectors(expected.origin, found.origin) && same_vectors(expected.direction, found.direction);
    law(right, || {
        format!("through {raster}: expected {expected:?}, found {found:?}")
    })
}

pub(crate) fn light_streams(light: &dyn Light, points: &[DVec3]) -> Checked {
    for points in chunks(points) {
        let mut positions = Vectors::default();
        for (lane, point) in points.iter().enumerate() {
            positions.set(lane, *point);
        }
        let mut samples = SampleStreams::default();
        samples.add().irradiance.fill(LANES, Rgb::WHITE);
        light.samples_stream(points.len(), &positions, &mut samples);
        let mut seen = Colors::default();
        light.background_stream(points.len(), &positions, &mut seen);
        for (lane, point) in points.iter().enumerate() {
            let mut expected = Vec::new();
            light.samples(*point, &mut expected);
            expected.retain(|sample| !sample.irradiance.is_black());
            let lit = samples.iter().skip(1).map(|stream| stream.get(lane));
            let found: Vec<LightSample> = lit.filter(|sample| !sample.irradiance.is_black()).collect();
            let right = expected.len() == found.len()
                && expected.iter().zip(&found).all(|(a, b)| {
                    same_vectors(a.direction, b.direction)
                        && same(a.distance, b.distance)
                        && same_colors(a.irradiance, b.irradiance)
                });
            law(right, || {
                format!("at {point}: expected {expected:?}, found {found:?}")
            })?;
            let (expected, found) = (light.background(*point), seen.get(lane));
            let right = same_colors(expected, found) || !light.flags().contains(LightFlags::BACKGROUND);
            law(right, || {
                format!("towards {point}: expected {expected:?}, found {found:?}")
            })?;
        }
    }
    Ok(())
}

fn points_of(points: &[(SurfaceInteraction, DVec3)]) -> SurfaceStream {
    let mut stream = SurfaceStream::default();
    for (lane, (point, view)) in points.iter().enumerate() {
        stream.vertex.turn_on();
        stream.set(lane, point);
        stream.view.set(lane, *view);
        stream.footprint.turn_on().set(lane, &point.footprint);
    }
    stream.len = points.len();
    stream
}

pub(crate) fn texture_streams(texture: &dyn Texture, points: &[SurfaceInteraction]) -> Checked {
    for points in chunks(points) {
        let with_view: Vec<_> = points.iter().map(|point| (*point, DVec3::Z)).collect();
        let mut found = Colors::default();
        texture.value_stream(&points_of(&with_view), &mut found);
        for (lane, point) in points.iter().enumerate() {
            let (expected, found) = (texture.value(point), found.get(lane));
            law(same_colors(expected, found), || {
                format!("at {}: expected {expected:?}, found {found:?}", point.uv)
            })?;
        }
    }
    Ok(())
}

/// Checks points with directions to their viewers. The light comes from around the shading normal,
/// in some directions only.
pub(crate) fn material_streams(material: &dyn Material, points: &[(SurfaceInteraction, DVec3)]) -> Checked {
    for points in chunks(points) {
        let stream = points_of(points);
        let mut lights = SampleStreams::default();
        for number in 0..3_usize {
            let light = lights.add();
            for (lane, (point, view)) in points.iter().enumerate() {
                let n = point.n_towards(*view);
                let direction = (n + 0.7 * n.any_orthonormal_vector() * number as f64).normalize();
                let irradiance = [Rgb::BLACK, Rgb::new(0.3, 2.0, 7.0)][usize::from((lane + number) % 3 != 0)];
                let distance = 1.0 + number as f64;
                light.set(
                    lane,
                    &LightSample {
                        direction,
                        distance,
                        irradiance,
                    },
                );
            }
        }
        let ambient = Rgb::new(0.1, 0.0, 0.4);
        let mut local = Colors::default();
        material.local_illumination_stream(&stream, ambient, &lights, &mut local);
        let mut emission = Colors::default();
        material.emission_stream(&stream, &mut emission);
        let mut split = SpecularRayStreams::default();
        material.specular_rays_stream(&stream, &mut split);
        for (lane, (point, view)) in points.iter().enumerate() {
            let lit = lights.iter().map(|light| light.get(lane));
            let incoming: Vec<IncidentLight> = lit
                .filter(|sample| !sample.irradiance.is_black())
                .map(
                    |LightSample {
                         direction,
                         irradiance,
                         ..
                     }| IncidentLight {
                        direction,
                        irradiance,
                    },
                )
                .collect();
            let light = LightSamples {
                ambient,
                lights: &incoming,
            };
            let (expected, found) = (material.local_illumination(point, *view, &light), local.get(lane));
            let place = format!("{point:?}, view {view}");
            law(same_colors(expected, found), || {
                format!("{place}: expected the local radiance {expected:?}, found {found:?}")
            })?;
            let (expected, found) = (material.emission(point, *view), emission.get(lane));
            law(same_colors(expected, found), || {
                format!("{place}: expected the emission {expected:?}, found {found:?}")
            })?;
            let mut branches = SpecularRays::default();
            material.specular_rays(point, *view, &mut branches);
            let of = |reflects: bool| {
                let mut all = branches.iter();
                all.find(|branch| (branch.kind == SpecularRayKind::Reflection) == reflects)
                    .copied()
            };
            for (expected, found) in [(of(true), &split.reflection), (of(false), &split.transmission)] {
                let absorption = split.absorption.get(lane);
                // Read only for materials with this flag.
                let straight = material.flags().contains(BsdfFlags::NULL) && split.undeviated.0[lane];
                law(same_branch(expected, found, lane, absorption, straight), || {
                    let found = (found.direction.get(lane), found.weight.get(lane), absorption);
                    format!("{place}: expected the specular ray {expected:?}, found {found:?}")
                })?;
            }
        }
    }
    Ok(())
}

fn same_branch(
    expected: Option<SpecularRay>,
    found: &SpecularRayStream,
    lane: usize,
    absorption: Rgb,
    straight: bool,
) -> bool {
    let weight = found.weight.get(lane);
    let Some(expected) = expected.filter(|branch| !branch.weight.is_black()) else {
        return weight.is_black();
    };
    let medium = match expected.kind {
        SpecularRayKind::Reflection => true,
        SpecularRayKind::Transmission { absorption: expected } => {
            !straight && same_colors(expected, absorption)
        }
        SpecularRayKind::Null => straight,
    };
    same_vectors(expected.direction, found.direction.get(lane))
        && same_colors(expected.weight, weight)
        && medium
}

pub(crate) fn integrator_streams(integrator: &dyn Integrator, scene: &Scene, rays: &[Ray]) -> Checked {
    let (mut together, mut single) = (Scratch::default(), Scratch::default());
    for rays in chunks(rays) {
        let queries: Vec<Query> = rays
            .iter()
            .map(|ray| (*ray, f64::INFINITY, SelfHitFilter::NOTHING))
            .collect();
        let mut found = Colors::default();
        integrator.radiance_stream(scene, &stream_of(&queries), &mut together, &mut found);
        for (lane, ray) in rays.iter().enumerate() {
            let (expected, found) = (integrator.radiance(scene, ray, &mut single), found.get(lane));
            law(same_colors(expected, found), || {
                format!("{ray:?}: expected {expected:?}, found {found:?}")
            })?;
        }
        law(together.counters == single.counters, || {
            format!(
                "expected the counts {:?}, found {:?}",
                single.counters, together.counters
            )
        })?;
    }
    Ok(())
}

/// Splits the items into streams of several lengths, full ones and others.
fn chunks<T>(items: &[T]) -> impl Iterator<Item = &[T]> {
    let first = items.len().min(LANES / 3);
    let (head, tail) = items.split_at(first);
    std::iter::once(head)
        .chain(tail.chunks(LANES))
        .filter(|chunk| !chunk.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{Aabb, BsdfFlags, LoweredShape, Shape, ShapeHit, Statistics};

    /// A plugin of every family whose stream differs from its scalar method in one bit of one lane.
    struct Wrong;

    const LANE: usize = 40; // within the first chunk

    fn off(x: f64, lane: usize) -> f64 {
        if lane == LANE { x.next_up() } else { x }
    }

    impl Camera for Wrong {
        fn ray(&self, raster: DVec2) -> Ray {
            Ray::new(raster.extend(0.0), DVec3::Z)
        }

        fn ray_stream(&self, raster: &Lanes<DVec2>, rays: &mut RayStream) {
            for lane in 0..rays.len {
                let ray = self.ray(DVec2::new(off(raster[lane].x, lane), raster[lane].y));
                rays.set(lane, ray, f64::INFINITY, SelfHitFilter::NOTHING);
            }
        }
    }

    impl Texture for Wrong {
        fn needs(&self) -> SurfaceAttributes {
            SurfaceAttributes::UV
        }

        fn value(&self, point: &SurfaceInteraction) -> Rgb {
            Rgb::splat(point.uv.x)
        }

        fn value_stream(&self, points: &SurfaceStream, out: &mut Colors) {
            for lane in 0..points.len {
                out.set(lane, Rgb::splat(off(points.get(lane).uv.x, lane)));
            }
        }
    }

    impl Light for Wrong {
        fn flags(&self) -> LightFlags {
            LightFlags::SAMPLES | LightFlags::BACKGROUND
        }

        fn background(&self, _: DVec3) -> Rgb {
            Rgb::WHITE
        }

        fn background_stream(&self, len: usize, _: &Vectors, out: &mut Colors) {
            for lane in 0..len {
                out.set(lane, Rgb::splat(off(1.0, lane)));
            }
        }
    }

    /// A material that is faulty in one of three ways.
    struct WrongMaterial(u8);

    impl Material for WrongMaterial {
        fn flags(&self) -> BsdfFlags {
            BsdfFlags::LOCAL | BsdfFlags::TRANSMISSION
        }

        fn needs(&self) -> SurfaceAttributes {
            SurfaceAttributes::NOTHING
        }

        fn local_illumination(&self, _: &SurfaceInteraction, _: DVec3, _: &LightSamples<'_>) -> Rgb {
            Rgb::WHITE
        }

        fn specular_rays(&self, _: &SurfaceInteraction, view: DVec3, out: &mut SpecularRays) {
            out.push(SpecularRay {
                direction: -view,
                weight: Rgb::WHITE,
                kind: SpecularRayKind::Transmission {
                    absorption: Rgb::WHITE,
                },
            });
        }

        fn local_illumination_stream(
            &self,
            points: &SurfaceStream,
            _: Rgb,
            _: &SampleStreams,
            out: &mut Colors,
        ) {
            for lane in 0..points.len {
                out.set(lane, Rgb::splat(if self.0 == 0 { off(1.0, lane) } else { 1.0 }));
            }
        }

        fn specular_rays_stream(&self, points: &SurfaceStream, out: &mut SpecularRayStreams) {
            for lane in 0..points.len {
                out.clear(lane);
                out.transmission.direction.set(lane, -points.view.get(lane));
                out.transmission
                    .weight
                    .set(lane, Rgb::splat(if self.0 == 1 { off(1.0, lane) } else { 1.0 }));
                out.absorption
                    .set(lane, Rgb::splat(if self.0 == 2 { off(1.0, lane) } else { 1.0 }));
            }
        }
    }

    impl Accelerator for Wrong {
        fn intersect(&self, _: &Ray, _: Interval, _: SelfHitFilter) -> Option<PreliminaryIntersection> {
            None
        }

        fn occluded(&self, _: &Ray, _: Interval, _: SelfHitFilter) -> bool {
            false
        }

        fn occluded_stream(&self, rays: &RayStream, hidden: &mut Lanes<bool>) {
            hidden[..rays.len].fill(false);
            hidden[LANE] = true;
        }

        fn statistics(&self) -> Statistics {
            Statistics::new()
        }
    }

    impl Shape for Wrong {
        fn bounds(&self) -> Aabb {
            Aabb::EVERYTHING
        }

        fn intersect(&self, _: &Ray, _: Interval, _: Option<u32>) -> Option<ShapeHit> {
            Some(ShapeHit {
                t: 1.0,
                primitive: 0,
                prim_uv: DVec2::ZERO,
            })
        }

        fn surface(
            &self,
            ray: &Ray,
            _: &PreliminaryIntersection,
            _: SurfaceAttributes,
        ) -> SurfaceInteraction {
            SurfaceInteraction::new(ray.origin, 0.0, DVec3::Z)
        }

        fn surface_stream(
            &self,
            rays: &RayStream,
            _: &HitStream,
            _: SurfaceAttributes,
            points: &mut SurfaceStream,
        ) {
            for lane in 0..rays.len {
                points.set(
                    lane,
                    &SurfaceInteraction::new(rays.ray(lane).origin, off(0.0, lane), DVec3::Z),
                );
            }
        }
    }

    impl Integrator for Wrong {
        fn follows_branches(&self) -> bool {
            false
        }

        fn radiance(&self, _: &Scene, _: &Ray, scratch: &mut Scratch) -> Rgb {
            scratch.counters.closest += 1;
            Rgb::WHITE
        }

        fn radiance_stream(&self, _: &Scene, rays: &RayStream, _: &mut Scratch, out: &mut Colors) {
            out.fill(rays.len, Rgb::WHITE);
        }
    }

    #[test]
    fn one_bit_of_one_lane_is_found() {
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let ray = Ray::new(DVec3::ZERO, DVec3::Z);
        let hit = ShapeHit {
            t: 1.0,
            primitive: 0,
            prim_uv: DVec2::ZERO,
        };
        let hit = hit.of_shape(whitstone_core::InstanceId::TOP_LEVEL, 0);
        let geometry = Geometry::new(vec![LoweredShape::Custom(Box::new(Wrong))]);
        let views = [(point, DVec3::Z); 50];
        let scene = crate::world_of_walls(&[], crate::Lamp::default());
        let found = [
            camera_streams(&Wrong, &[DVec2::ONE; 50]),
            texture_streams(&Wrong, &[point; 50]),
            light_streams(&Wrong, &[DVec3::X; 50]),
            material_streams(&WrongMaterial(0), &views),
            material_streams(&WrongMaterial(1), &views),
            material_streams(&WrongMaterial(2), &views),
            accelerator_streams(&Wrong, &[(ray, f64::INFINITY, SelfHitFilter::NOTHING); 50]),
            surface_streams(&geometry, &[(ray, hit); 50]),
            integrator_streams(&Wrong, &scene, &[ray; 50]),
        ];
        for (number, found) in found.into_iter().enumerate() {
            assert!(found.is_err(), "check {number} does not find a wrong lane");
        }
        assert_eq!(material_streams(&WrongMaterial(3), &views), Ok(()));
    }
}
