//! A point light that projects an image (a slide) into a pyramid.
//!
//! A projective texture as in Segal, Korobkin, van Widenfelt, Foran, Haeberli, *Fast shadows and
//! lighting effects using texture mapping*, 1992, used as a light. It illuminates the surfaces that
//! a pinhole camera at its position would see through the slide. The intensity grows with the angle
//! from the axis, as 1/cos³, so that a slide of one colour illuminates a screen perpendicular to
//! the axis evenly.
//!
//! - Twin: hosted by the Mitsuba driver: a Python emitter looks up the image; the native
//!   `projector` inside it gives the frame and the falloff.
//! - Example: `scenes/lights/projector.toml`.

use crate::support::emission::{self, Falloff};
use crate::support::projection::{image_axes, image_color};
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::{Color, Finite, TextureRef, Vector3};
use whitstone_core::stream::{SampleStreams, Vectors};
use whitstone_core::{
    Aabb, ColorSource, Context, DVec2, DVec3, Light, LightBounds, LightFlags, LightSample, Lights, Plugin,
    Rgb, SceneError, SceneErrors,
};

/// Default angle of the image, in degrees.
const DEFAULT_FOV: f64 = 45.0;

/// A point light that projects an image (a slide) into a pyramid.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Position in metres.
    position: Vector3,
    /// A point on the axis, at the centre of the projected image, in metres; must differ from the
    /// position.
    #[schemars(with = "Vector3")]
    target: Spanned<Vector3>,
    /// Direction that is up in the image, of any length and not parallel to the axis.
    #[serde(default)]
    #[schemars(extend("default" = [0, 1, 0]), with = "Vector3")]
    up: Option<Spanned<Vector3>>,
    /// Full horizontal angle of the image in degrees, between 0 and 180.
    #[serde(default)]
    #[schemars(with = "Finite", extend("default" = DEFAULT_FOV, "exclusiveMinimum" = 0, "exclusiveMaximum" = 180))]
    fov: Option<Spanned<Finite>>,
    /// Width divided by height of the projected image, from 0.001 to 1000. The texture is stretched
    /// to it.
    #[serde(default)]
    #[schemars(with = "Finite", extend("default" = 1, "minimum" = 0.001, "maximum" = 1000))]
    aspect: Option<Spanned<Finite>>,
    /// The projected image, as a factor on the intensity: a texture with (0, 0) at the bottom left
    /// corner, or a colour.
    image: TextureRef,
    /// Radiant intensity in W/sr along the axis where the slide is 1; equals the irradiance in W/m²
    /// on a screen perpendicular to the axis at 1 m.
    intensity: Color,
}

/// The `projector` light; see the module documentation.
pub struct Projector {
    position: DVec3,
    /// Unit vector to the right in the image, as seen by the projector.
    right: DVec3,
    /// Unit vector, up in the image.
    up: DVec3,
    /// Unit vector along the axis, away from the light.
    axis: DVec3,
    /// Half the width and height of the image at distance 1.
    half: DVec2,
    image: ColorSource,
    intensity: Rgb,
}

impl Plugin<Lights> for Projector {
    const TYPE: &'static str = "projector";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Light>, SceneErrors> {
        let mut errors = SceneErrors::default();
        let image = errors.take(context.texture(&config.image));
        let position = config.position.get();
        let axis = emission::direction_and_length(config.target.get_ref().get() - position);
        if axis.is_none() {
            let error = SceneError::at(config.target.span(), "`target` equals `position`");
            let help = "the light shines from `position` to `target`: move one of them";
            errors.0.push(error.with_help(help));
        }
        let half = errors.take(half_size(&config));
        let axes = axis
            .and_then(|(axis, _)| errors.take(image_axes(axis, config.up.as_ref(), config.target.span())));
        let (Some(image), Some((axis, _)), Some(half), Some([right, up])) = (image, axis, half, axes) else {
            return Err(errors);
        };
        errors.into_result(Arc::new(Self {
            position,
            right,
            up,
            axis,
            half,
            image,
            intensity: config.intensity.get(),
        }))
    }
}

/// Half the width and height of the image at distance 1.
fn half_size(config: &Config) -> Result<DVec2, SceneErrors> {
    let mut errors = SceneErrors::default();
    let value = |number: &Spanned<Finite>| number.get_ref().get();
    let fov = config.fov.as_ref().map_or(DEFAULT_FOV, value);
    if let Some(angle) = &config.fov
        && !(fov > 0.0 && fov < 180.0)
    {
        let message = format!("expected an angle greater than 0 and less than 180 degrees, found {fov}");
        errors.0.push(SceneError::at(angle.span(), message));
    }
    let aspect = config.aspect.as_ref().map_or(1.0, value);
    if let Some(ratio) = &config.aspect
        && !(0.001..=1000.0).contains(&aspect)
    {
        let message = format!("expected a ratio of width to height from 0.001 to 1000, found {aspect}");
        errors.0.push(SceneError::at(ratio.span(), message));
    }
    let width = libm::tan(0.5 * fov.to_radians());
    errors.into_result(DVec2::new(width, width / aspect))
}

impl Light for Projector {
    fn flags(&self) -> LightFlags {
        LightFlags::SAMPLES
    }

    fn samples(&self, point: DVec3, out: &mut Vec<LightSample>) {
        let sample = emission::sample(self.position, point, self.intensity, Falloff::InverseSquare);
        out.extend(sample.and_then(|sample| {
            let irradiance = self.through_image(&sample)?;
            Some(LightSample { irradiance, ..sample })
        }));
    }

    fn samples_stream(&self, len: usize, points: &Vectors, out: &mut SampleStreams) {
        let falloff = Falloff::InverseSquare;
        emission::sample_stream(self.position, len, points, self.intensity, falloff, out);
        let samples = out.stream(out.len() - 1);
        for lane in 0..len {
            let irradiance = self.through_image(&samples.get(lane)).unwrap_or(Rgb::BLACK);
            samples.irradiance.set(lane, irradiance);
        }
    }

    /// Tests the bounding sphere of the box against the four side planes of the pyramid and the
    /// plane through the light perpendicular to the axis.
    fn affects_bounds(&self, bounds: &Aabb) -> bool {
        let (center, radius) = emission::ball_around(bounds);
        let out = center - self.position;
        let (x, y, depth) = (self.right.dot(out), self.up.dot(out), self.axis.dot(out));
        // Signed distance of the centre from a side plane with the slope `half`; positive outside.
        let beyond = |across: f64, half: f64| (across.abs() - half * depth) / libm::hypot(half, 1.0);
        let farthest = beyond(x, self.half.x).max(beyond(y, self.half.y)).max(-depth);
        // False if a distance is NaN: the light is assumed to reach the box.
        let misses = farthest > radius + 1e-9 * (out.length() + radius);
        !(self.intensity.is_black() || self.image.is_black() || misses)
    }

    /// Brightest in the corners, where d/z is largest.
    fn bounds(&self) -> Option<LightBounds> {
        let stretch = (1.0 + self.half.length_squared()).sqrt().powi(3);
        let intensity = (self.intensity * self.image.constant()?).max_component();
        emission::bounds(&[self.position], intensity * stretch, Falloff::InverseSquare)
    }
}

impl Projector {
    /// The irradiance after the slide; `None` outside of the image.
    #[inline]
    fn through_image(&self, sample: &LightSample) -> Option<Rgb> {
        let travel = -sample.direction;
        let cosine = self.axis.dot(travel);
        let at = DVec2::new(self.right.dot(travel), self.up.dot(travel));
        let edge = self.half * cosine;
        // Also false if the direction is NaN.
        let inside = cosine > 0.0 && at.x.abs() <= edge.x && at.y.abs() <= edge.y;
        if !inside {
            return None;
        }
        let uv = 0.5 + 0.5 * at / edge;
        let stronger = 1.0 / (cosine * cosine * cosine);
        let irradiance = sample.irradiance * image_color(&self.image, uv);
        Some(irradiance.map(|e| (e * stronger).min(f64::MAX)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{SurfaceAttributes, SurfaceInteraction, Texture};
    use whitstone_testkit::{TestContext, build_in, light_laws, light_near_laws};

    /// A texture whose red and green are (u, v), and whose blue is a function of the position.
    struct Ramp;

    impl Texture for Ramp {
        fn needs(&self) -> SurfaceAttributes {
            SurfaceAttributes::UV
        }

        fn value(&self, point: &SurfaceInteraction) -> Rgb {
            Rgb::new(point.uv.x, point.uv.y, point.position.x + 2.0 * point.position.y)
        }
    }

    fn projector(text: &str) -> Result<Arc<dyn Light>, SceneErrors> {
        let mut context = TestContext::default().with_texture("ramp", Ramp);
        build_in::<Lights, Projector>(text, (), &mut context)
    }

    fn irradiance(light: &dyn Light, point: DVec3) -> Rgb {
        let mut samples = Vec::new();
        light.samples(point, &mut samples);
        samples.first().map_or(Rgb::BLACK, |sample| sample.irradiance)
    }

    #[test]
    fn laws() {
        for more in [
            "image = [1, 2, 3]",
            "image = \"ramp\"\nfov = 179.9\naspect = 0.25",
            "image = 1\nfov = 1e-6\nup = [0, -3, 1]",
            "image = 1\nfov = 179.999999\naspect = 1000",
        ] {
            let text = format!("position = [0, 2, 0]\ntarget = [0, 0, 0.1]\nintensity = 1\n{more}");
            light_laws(&*projector(&text).unwrap());
        }
        let text = "position = [0, 0, 0]\ntarget = [3, 0, 4]\nintensity = 2\nimage = 1";
        let light = projector(text).unwrap();
        light_near_laws(&*light, DVec3::ZERO, Rgb::splat(2.0), DVec3::new(0.6, 0.0, 0.8));
    }

    /// Orientation of the image and the position of its edges, to a nanometre.
    #[test]
    fn the_slide_is_where_the_model_says() {
        let text = "position = [0, 0, 0]\ntarget = [0, 0, -5]\nintensity = 1\nimage = \"ramp\"\nfov = 90\naspect = 2";
        let light = projector(text).unwrap();
        // At depth 2 the image is 4 wide and 2 high.
        for (x, y, u, v) in [
            (0.0, 0.0, 0.5, 0.5),
            (1.0, 0.5, 0.75, 0.75),
            (-2.0 + 1e-9, -0.5, 0.0, 0.25),
        ] {
            let p = DVec3::new(x, y, -2.0);
            // The irradiance is 1/z² on a screen perpendicular to the axis, and larger by 1/cosine
            // on a surface that faces the light.
            let cosine = 2.0 / p.length();
            let found = irradiance(&*light, p) * (4.0 * cosine);
            for (found, expected) in found.to_array().into_iter().zip([u, v, u + 2.0 * v]) {
                assert!((found - expected).abs() < 1e-8, "{p}: {found}, not {expected}");
            }
        }
        for (x, y, z) in [
            (2.0 + 1e-9, 0.0, -2.0),
            (0.0, -1.0 - 1e-9, -2.0),
            (0.0, 0.0, 2.0),
            (1.0, 0.2, 2.0),
        ] {
            assert!(irradiance(&*light, DVec3::new(x, y, z)).is_black(), "{x} {y} {z}");
        }
    }

    /// A slide of one colour illuminates a screen evenly: the flux is the area of the screen times
    /// the irradiance.
    #[test]
    fn a_screen_is_lit_evenly_and_spheres_receive_the_flux() {
        let text = "position = [0, 0, 0]\ntarget = [0, 0, -1]\nintensity = 3\nimage = 1\nfov = 90";
        let light = projector(text).unwrap();
        for (x, y) in [(0.0, 0.0), (0.9, 0.2), (-0.99, 0.99)] {
            let p = DVec3::new(x, y, -1.0);
            let found = irradiance(&*light, p).g / p.length();
            assert!((found - 3.0).abs() < 1e-12, "{p}: {found}");
        }
        // The flux through the unit sphere, which faces the light everywhere, equals that through
        // the screen: 3 times 2 times 2.
        let n = 400;
        let mut flux = 0.0;
        for k in 0..n * n {
            let middle = |k: i32| (f64::from(k) + 0.5) / f64::from(n) * 2.0 - 1.0;
            // Points of the screen, each with its solid angle.
            let p = DVec3::new(middle(k % n), middle(k / n), -1.0);
            let solid_angle = 4.0 / f64::from(n * n) / p.length().powi(3);
            flux += irradiance(&*light, p.normalize()).g * solid_angle;
        }
        assert!((flux - 12.0).abs() < 1e-9, "{flux}");
    }

    #[test]
    fn boxes_beside_the_pyramid_are_not_reached() {
        let text =
            "position = [0, 0, 0]\ntarget = [0, 0, -1]\nintensity = 3\nimage = 1\nfov = 90\naspect = 2";
        let light = projector(text).unwrap();
        let around = |x: f64, y: f64, z: f64| {
            let center = DVec3::new(x, y, z);
            Aabb::around([center - 0.1, center + 0.1])
        };
        for (x, y, z, reached) in [
            (0.0, 0.0, -3.0, true),
            (2.9, 1.4, -3.0, true),
            (3.5, 0.0, -3.0, false),
            (0.0, 2.0, -3.0, false),
            (0.0, 0.0, 0.3, false),
            (0.0, 0.0, 0.05, true),
        ] {
            assert_eq!(light.affects_bounds(&around(x, y, z)), reached, "{x} {y} {z}");
        }
        // On a side plane, beyond it by less and by more than rounding; a ball behind the light.
        for (center, radius, reached) in [
            ([3.0, 0.0, -3.0], 0.0, true),
            ([1e3 + 1e-7, 0.0, -1e3], 0.0, true),
            ([1e3 + 1e-5, 0.0, -1e3], 0.0, false),
            ([0.0, 0.0, 1.0 + 1.5e-9], 1.0, true),
        ] {
            let cube = emission::cube_in_ball(center, radius);
            assert_eq!(light.affects_bounds(&cube), reached, "{center:?} {radius}");
        }
        // Brightest in the corners, by the third power of 1.5.
        let bounds = light.bounds().unwrap();
        assert_eq!((bounds.bounds.min, bounds.bounds.max), (DVec3::ZERO, DVec3::ZERO));
        assert!((bounds.max_intensity - 3.0 * 3.375).abs() < 1e-14);
        assert!(light.affects_bounds(&Aabb::EVERYTHING));
        assert!(
            !projector(&text.replace("image = 1", "image = 0"))
                .unwrap()
                .affects_bounds(&Aabb::EVERYTHING)
        );
    }

    #[test]
    fn all_faults_are_reported_at_their_places() {
        let faults = |text: &str| {
            let errors = projector(text).err().unwrap();
            let found = errors.0.iter().map(|e| text[e.span.clone().unwrap()].to_owned());
            found.collect::<Vec<_>>()
        };
        let text =
            "position = [0, 1, 0]\ntarget = [0, 1, 0]\nintensity = 1\nimage = 1\nfov = 180\naspect = 0";
        assert_eq!(faults(text), ["[0, 1, 0]", "180", "0"]);
        assert_eq!(
            faults(&text.replace("fov = 180", "fov = 0.0")),
            ["[0, 1, 0]", "0.0", "0"]
        );
        let text = "position = [0, 1, 0]\ntarget = [0, 5, 0]\nintensity = 1\nimage = 1";
        assert_eq!(faults(text), ["[0, 5, 0]"]);
        assert_eq!(faults(&format!("{text}\nup = [0, -2, 0]")), ["[0, -2, 0]"]);
        assert_eq!(faults(&format!("{text}\nup = [0, 0, 0]")), ["[0, 0, 0]"]);
        assert!(projector(&format!("{text}\nup = [0, 1, 1]")).is_ok());
    }
}
