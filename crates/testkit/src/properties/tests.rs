//! Faulty plugins of every family: they are found, shrunk, and fail again in the printed scene.

use super::*;
use crate::ball::Ball;
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::{
    Aabb, Accelerator, Accelerators, BsdfFlags, Camera, Cameras, Context, DVec2, DVec3, Element, FilmSize,
    Geometry, Interval, Light, LightFlags, LightSample, LightSamples, Lights, LoweredShape, Material,
    Materials, PreliminaryIntersection, Ray, Rgb, SceneErrors, SelfHitFilter, Shape, ShapeHit, Shapes,
    Statistics, SurfaceAttributes, SurfaceInteraction, Texture, Textures, Transform, triangle::ShearedRay,
};

/// Correct up to a limit, faulty above.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Config {
    amount: f64,
}

/// Configurations from 1 to 9; the limit is 5.
const TEXT: &str = "amount = 1.0..9";
const LIMIT: f64 = 5.0;

/// Checks that the law is found broken at an amount slightly above the limit, and that the printed
/// scene breaks it again, but not if the amount is below the limit.
fn finds_fault<F: Lawful, P: Plugin<F>>(law: &str, laws: &[fn(&F::Product)]) -> toml::Table {
    let found = first_failure::<F, P>(TEXT, laws).expect_err("the law is broken");
    assert!(found.law.contains(law), "{found}");
    assert!(found.to_string().contains(&found.scene), "{found}");
    let (table, _) = F::read(&found.scene.parse().expect("the scene is TOML"), P::TYPE)
        .expect("the scene contains the plugin");
    let amount = table["amount"].as_float().expect("it is a number");
    assert!((LIMIT..LIMIT + 0.1).contains(&amount), "not shrunk: {found}");
    assert_eq!(holds_in::<F, P>(&found.scene, laws), Err(found.law.clone()));
    let right = found
        .scene
        .replace(&format!("amount = {amount:?}"), "amount = 2.5");
    assert_ne!(right, found.scene);
    assert_eq!(holds_in::<F, P>(&right, laws), Ok(()));
    found.scene.parse().expect("the scene is TOML")
}

struct Wrong;

/// Its normals are too long above the limit.
struct WrongBall(Ball, f64);

impl Plugin<Shapes> for Wrong {
    const TYPE: &'static str = "wrong_ball";
    type Config = Config;
    fn build(config: Config, place: Transform, _: &mut dyn Context) -> Result<LoweredShape, SceneErrors> {
        let ball = Ball {
            center: place.world_from_object().translation,
            radius: 1.0,
        };
        Ok(LoweredShape::Custom(Box::new(WrongBall(ball, config.amount))))
    }
}

impl Shape for WrongBall {
    fn bounds(&self) -> Aabb {
        self.0.bounds()
    }
    fn intersect(&self, ray: &Ray, interval: Interval, origin_primitive: Option<u32>) -> Option<ShapeHit> {
        self.0.intersect(ray, interval, origin_primitive)
    }
    fn surface(
        &self,
        ray: &Ray,
        hit: &PreliminaryIntersection,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction {
        let mut point = self.0.surface(ray, hit, needs);
        if self.1 > LIMIT {
            point.n_s *= 1.0 + 1e-9;
        }
        point
    }
}

#[test]
fn a_wrong_shape() {
    let scene = finds_fault::<Shapes, Wrong>("normals must have unit length", &[]);
    // The camera looks along the ray. The shape is untransformed, since that is the simplest place.
    assert!(scene["camera"]["look_at"]["origin"].is_array());
    assert_eq!(
        scene["shape"][0]["transform"]["matrix"][0][0].as_float(),
        Some(1.0)
    );
}

/// Ignores the last element if there are more elements than the limit.
struct Forgetful(Arc<Geometry>, f64);

impl Plugin<Accelerators> for Wrong {
    const TYPE: &'static str = "wrong_accelerator";
    type Config = Config;
    fn build(
        config: Config,
        geometry: Arc<Geometry>,
        _: &mut dyn Context,
    ) -> Result<Box<dyn Accelerator>, SceneErrors> {
        Ok(Box::new(Forgetful(geometry, config.amount)))
    }
}

impl Accelerator for Forgetful {
    fn intersect(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<PreliminaryIntersection> {
        let sheared = ShearedRay::new(ray);
        let mut elements: Vec<Element> = self.0.elements().collect();
        if self.1 > LIMIT {
            elements.truncate(3);
        }
        let hits = elements.into_iter();
        let hits = hits.filter_map(|element| self.0.intersect(element, ray, &sheared, interval, skip));
        hits.reduce(|best, hit| if hit.is_nearer_than(&best) { hit } else { best })
    }
    fn occluded(&self, ray: &Ray, interval: Interval, skip: SelfHitFilter) -> bool {
        self.intersect(ray, interval, skip).is_some()
    }
    fn statistics(&self) -> Statistics {
        Statistics::new()
    }
}

#[test]
fn a_wrong_accelerator_is_shown_with_the_fewest_shapes() {
    let scene = finds_fault::<Accelerators, Wrong>("expected", &[]);
    assert_eq!(scene["shape"].as_array().map(Vec::len), Some(4), "{scene}");
}

/// NaN at grazing incidence above the limit.
struct Grazing(f64);

impl Plugin<Materials> for Wrong {
    const TYPE: &'static str = "wrong_material";
    type Config = Config;
    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        Ok(Arc::new(Grazing(config.amount)))
    }
}

impl Material for Grazing {
    fn flags(&self) -> BsdfFlags {
        BsdfFlags::LOCAL
    }
    fn needs(&self) -> SurfaceAttributes {
        SurfaceAttributes::SHADING_NORMAL
    }
    fn local_illumination(&self, point: &SurfaceInteraction, view: DVec3, light: &LightSamples<'_>) -> Rgb {
        let cosine = point.n_towards(view).dot(view);
        let odd = if self.0 > LIMIT && cosine < 1e-9 {
            f64::NAN
        } else {
            1.0
        };
        light.ambient * odd
    }
}

#[test]
fn a_wrong_material() {
    finds_fault::<Materials, Wrong>("finite and not negative", &[]);
    // Another law instead of the default ones.
    let law: fn(&Arc<dyn Material>) = |_| {};
    assert_eq!(first_failure::<Materials, Wrong>(TEXT, &[law]), Ok(()));
}

/// Negative at negative coordinates above the limit.
struct Negative(f64);

impl Plugin<Textures> for Wrong {
    const TYPE: &'static str = "wrong_texture";
    type Config = Config;
    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Texture>, SceneErrors> {
        Ok(Arc::new(Negative(config.amount)))
    }
}

impl Texture for Negative {
    fn needs(&self) -> SurfaceAttributes {
        SurfaceAttributes::UV
    }
    fn value(&self, point: &SurfaceInteraction) -> Rgb {
        Rgb::splat(if self.0 > LIMIT && point.uv.x < 0.0 {
            -1.0
        } else {
            1.0
        })
    }
}

#[test]
fn a_wrong_texture() {
    finds_fault::<Textures, Wrong>("finite and not negative", &[]);
}

/// Mirrored above the limit.
struct Mirrored(f64, DVec2);

impl Plugin<Cameras> for Wrong {
    const TYPE: &'static str = "wrong_camera";
    type Config = Config;
    fn build(config: Config, film: FilmSize, _: &mut dyn Context) -> Result<Box<dyn Camera>, SceneErrors> {
        let size = DVec2::new(f64::from(film.width), f64::from(film.height));
        Ok(Box::new(Mirrored(config.amount, size)))
    }
}

impl Camera for Mirrored {
    fn ray(&self, raster: DVec2) -> Ray {
        let at = raster / self.1 - 0.5;
        let across = if self.0 > LIMIT { -at.x } else { at.x };
        Ray::new(DVec3::ZERO, DVec3::new(across, -at.y, -1.0).normalize())
    }
}

#[test]
fn a_wrong_camera() {
    finds_fault::<Cameras, Wrong>("must not be mirrored", &[]);
}

/// Negative light above the limit.
struct Dark(f64);

impl Plugin<Lights> for Wrong {
    const TYPE: &'static str = "wrong_light";
    type Config = Config;
    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Light>, SceneErrors> {
        Ok(Arc::new(Dark(config.amount)))
    }
}

impl Light for Dark {
    fn flags(&self) -> LightFlags {
        LightFlags::SAMPLES
    }
    fn samples(&self, _: DVec3, out: &mut Vec<LightSample>) {
        out.push(LightSample {
            direction: DVec3::Y,
            distance: f64::INFINITY,
            irradiance: Rgb::splat(if self.0 > LIMIT { -1.0 } else { 1.0 }),
        });
    }
}

#[test]
fn a_wrong_light() {
    finds_fault::<Lights, Wrong>("finite and >= 0", &[]);
}

#[test]
#[should_panic(expected = "cannot be built from any configuration")]
fn a_text_that_is_always_rejected_fails() {
    hold::<Lights, Wrong>(&["amount = 1.0..2\nunknown = 3"], &[]);
}

#[test]
fn scenes_without_the_plugin_are_rejected() {
    let error = holds_in::<Lights, Wrong>("[[light]]\ntype = \"point\"", &[]).unwrap_err();
    assert_eq!(error, "the scene contains no light \"wrong_light\"");
}
