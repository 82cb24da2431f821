//! A spot light: a point light restricted to a cone, optionally with an image.
//!
//! The angle from the axis is the arc tangent of the length of the cross product over the dot
//! product. An arc cosine would lose half the digits in a narrow beam. The image is a factor on the
//! intensity, as the `texture` of Mitsuba's `spot`: unlike that of a `projector` it does not light
//! a screen evenly. `scenes/showcase/gobo.toml` has images.
//!
//! - Twin: Mitsuba `spot` (native); hosted for `falloff = "none"`, and for an `image`, because
//!   Mitsuba's `texture` shows only textures of (u, v), turned by 180 degrees.
//! - Example: `scenes/lights/spot.toml`.

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

/// Default half angle of the cone, in degrees.
const DEFAULT_CUTOFF: f64 = 20.0;

/// A spot light: a point light restricted to a cone with a soft edge.
///
/// The intensity is constant up to `beam_width`, and from there falls linearly with the angle to 0
/// at `cutoff_angle`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Position in metres.
    position: Vector3,
    /// A point on the axis of the cone, in metres; must differ from the position.
    #[schemars(with = "Vector3")]
    target: Spanned<Vector3>,
    /// Radiant intensity in W/sr inside the beam (see `beam_width`).
    intensity: Color,
    /// Half angle of the cone in degrees, greater than 0 and less than 90.
    #[serde(default)]
    #[schemars(with = "Finite", extend("default" = DEFAULT_CUTOFF, "exclusiveMinimum" = 0, "exclusiveMaximum" = 90))]
    cutoff_angle: Option<Spanned<Finite>>,
    /// Half angle in degrees of the beam with full intensity, at least 0 and less than
    /// `cutoff_angle`.
    #[serde(default)]
    #[schemars(with = "Finite", extend("x-default" = "3/4 of `cutoff_angle`", "minimum" = 0, "exclusiveMaximum" = 90))]
    beam_width: Option<Spanned<Finite>>,
    /// Falloff of the irradiance with the distance d: "inverse_square" (I/d²), or "none": then
    /// `intensity` is the irradiance itself, in W/m², at any distance.
    #[serde(default)]
    falloff: Falloff,
    /// An image that is projected into the cone, as a factor on the intensity: a texture with
    /// (0, 0) at the bottom left corner, or a colour. The edge of the cone is the circle inscribed
    /// in the image.
    #[serde(default)]
    #[schemars(extend("x-default" = "none"), with = "TextureRef")]
    image: Option<TextureRef>,
    /// With an `image` only: the direction that is up in it, of any length and not parallel to the
    /// axis.
    #[serde(default)]
    #[schemars(extend("default" = [0, 1, 0]), with = "Vector3")]
    up: Option<Spanned<Vector3>>,
}

/// The `spot` light, with angles in radians; see the module documentation.
pub struct Spot {
    position: DVec3,
    /// Unit vector along the axis, in the direction of emission.
    axis: DVec3,
    intensity: Rgb,
    cutoff: f64,
    cos_cutoff: f64,
    beam: f64,
    cos_beam: f64,
    falloff: Falloff,
    image: Option<Image>,
}

/// The image of a spot light.
struct Image {
    /// Unit vectors to the right and up in the image, as seen from the light.
    axes: [DVec3; 2],
    /// Half the width and height of the image at distance 1.
    half: f64,
    color: ColorSource,
}

/// Well above the rounding error of a cosine of unit vectors.
const COSINE_MARGIN: f64 = 1e-12;

/// Well above the rounding error of an angle, in radians.
const ANGLE_MARGIN: f64 = 1e-9;

impl Plugin<Lights> for Spot {
    const TYPE: &'static str = "spot";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Light>, SceneErrors> {
        let mut errors = SceneErrors::default();
        let color = match &config.image {
            None => None,
            Some(image) => errors.take(context.texture(image)),
        };
        let position = config.position.get();
        let axis = emission::direction_and_length(config.target.get_ref().get() - position);
        if axis.is_none() {
            let error = SceneError::at(config.target.span(), "`target` equals `position`");
            errors
                .0
                .push(error.with_help("the light shines from `position` to `target`: move one of them"));
        }
        let value = |angle: &Spanned<Finite>| angle.get_ref().get();
        let cutoff = config.cutoff_angle.as_ref().map_or(DEFAULT_CUTOFF, value);
        if let Some(angle) = &config.cutoff_angle
            && !(cutoff > 0.0 && cutoff < 90.0)
        {
            let message =
                format!("expected an angle greater than 0 and less than 90 degrees, found {cutoff}");
            errors.0.push(SceneError::at(angle.span(), message));
        }
        let beam = config.beam_width.as_ref().map_or(0.75 * cutoff, value);
        if let Some(angle) = &config.beam_width
            && !(beam >= 0.0 && beam < cutoff)
        {
            let message = format!(
                "expected an angle of at least 0 and less than the cutoff of {cutoff} degrees, found {beam}"
            );
            errors.0.push(SceneError::at(angle.span(), message));
        }
        if let (None, Some(up)) = (&config.image, &config.up) {
            let error = SceneError::at(up.span(), "`up` has no effect without an `image`");
            errors.0.push(error.with_help("remove it, or add an `image`"));
        }
        let Some((axis, _)) = axis else {
            return Err(errors);
        };
        let (cutoff, beam) = (cutoff.to_radians(), beam.to_radians());
        let axes = match config.image {
            None => None,
            Some(_) => errors.take(image_axes(axis, config.up.as_ref(), config.target.span())),
        };
        let half = libm::tan(cutoff);
        let image = color.zip(axes).map(|(color, axes)| Image { axes, half, color });
        errors.into_result(Arc::new(Self {
            position,
            axis,
            intensity: config.intensity.get(),
            cutoff,
            cos_cutoff: libm::cos(cutoff),
            beam,
            cos_beam: libm::cos(beam),
            falloff: config.falloff,
            image,
        }))
    }
}

impl Light for Spot {
    fn flags(&self) -> LightFlags {
        LightFlags::SAMPLES
    }

    fn samples(&self, point: DVec3, out: &mut Vec<LightSample>) {
        let sample = emission::sample(self.position, point, self.intensity, self.falloff);
        out.extend(sample.and_then(|sample| {
            let irradiance = self.irradiance(&sample)?;
            Some(LightSample { irradiance, ..sample })
        }));
    }

    fn samples_stream(&self, len: usize, points: &Vectors, out: &mut SampleStreams) {
        emission::sample_stream(self.position, len, points, self.intensity, self.falloff, out);
        let samples = out.stream(out.len() - 1);
        for lane in 0..len {
            let irradiance = self.irradiance(&samples.get(lane)).unwrap_or(Rgb::BLACK);
            samples.irradiance.set(lane, irradiance);
        }
    }

    /// Tests the cone against the bounding sphere of the box.
    fn affects_bounds(&self, bounds: &Aabb) -> bool {
        let (center, radius) = emission::ball_around(bounds);
        let out = center - self.position;
        let (along, across) = (self.axis.dot(out), self.axis.cross(out).length());
        // The sphere misses the cone if its centre lies outside the cone by more than the angular
        // radius of the sphere. If an angle is NaN, the light is assumed to reach the box.
        let beyond = libm::atan2(across, along) - self.cutoff - ANGLE_MARGIN;
        let misses = beyond > 0.0 && libm::asin(radius / out.length()) < beyond;
        let dark = self.image.as_ref().is_some_and(|image| image.color.is_black());
        !(self.intensity.is_black() || dark || misses)
    }

    fn bounds(&self) -> Option<LightBounds> {
        let brightest = match &self.image {
            None => Rgb::WHITE,
            Some(image) => image.color.constant()?,
        };
        let intensity = (self.intensity * brightest).max_component();
        emission::bounds(&[self.position], intensity, self.falloff)
    }
}

impl Image {
    /// The colour in the direction `travel`, which leaves the light inside the cone.
    fn color(&self, axis: DVec3, travel: DVec3) -> Rgb {
        let [x, y] = self.axes.map(|across| across.dot(travel));
        let uv = 0.5 + 0.5 * DVec2::new(x, y) / (self.half * axis.dot(travel));
        image_color(&self.color, uv)
    }
}

impl Spot {
    /// The irradiance inside the cone, with the image; `None` outside.
    #[inline]
    fn irradiance(&self, sample: &LightSample) -> Option<Rgb> {
        let irradiance = self.inside_cone(sample)?;
        Some(match &self.image {
            None => irradiance,
            Some(image) => {
                let lit = irradiance * image.color(self.axis, -sample.direction);
                lit.map(|e| e.min(f64::MAX))
            }
        })
    }

    /// The irradiance inside the cone; `None` outside.
    #[inline]
    fn inside_cone(&self, sample: &LightSample) -> Option<Rgb> {
        let travel = -sample.direction;
        let cosine = self.axis.dot(travel);
        // The angle is expensive. It is needed only in the soft edge, and where rounding makes the
        // cosine unreliable.
        if cosine > self.cos_beam + COSINE_MARGIN {
            return Some(sample.irradiance);
        }
        if cosine < self.cos_cutoff - COSINE_MARGIN {
            return None;
        }
        let angle = libm::atan2(self.axis.cross(travel).length(), cosine);
        if angle >= self.cutoff {
            None
        } else if angle > self.beam {
            let share = (self.cutoff - angle) / (self.cutoff - self.beam);
            Some(sample.irradiance * share)
        } else {
            Some(sample.irradiance)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{SurfaceAttributes, SurfaceInteraction, Texture};
    use whitstone_testkit::{TestContext, build, build_in, light_laws, light_near_laws};

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

    fn with_image(text: &str) -> Result<Arc<dyn Light>, SceneErrors> {
        let mut context = TestContext::default().with_texture("ramp", Ramp);
        build_in::<Lights, Spot>(text, (), &mut context)
    }

    fn irradiance(light: &dyn Light, point: DVec3) -> f64 {
        let mut samples = Vec::new();
        light.samples(point, &mut samples);
        samples.first().map_or(0.0, |sample| sample.irradiance.g)
    }

    #[test]
    fn laws() {
        for angles in ["", "cutoff_angle = 89.9\nbeam_width = 0", "cutoff_angle = 1e-6"] {
            let text = format!("position = [0, 2, 0]\ntarget = [0, 0, 0.1]\nintensity = 1\n{angles}");
            light_laws(&*build::<Lights, Spot>(&text, ()).unwrap());
        }
        let text = "position = [0, 0, 0]\ntarget = [3, 0, 4]\nintensity = 2";
        let light = build::<Lights, Spot>(text, ()).unwrap();
        light_near_laws(&*light, DVec3::ZERO, Rgb::splat(2.0), DVec3::new(0.6, 0.0, 0.8));
        for more in [
            "image = \"ramp\"",
            "image = [1, 2, 3]\ncutoff_angle = 89.9\nbeam_width = 0\nfalloff = \"none\"",
            "image = \"ramp\"\ncutoff_angle = 1e-6\nup = [0, -3, 1]",
        ] {
            let text = format!("position = [0, 2, 0]\ntarget = [0, 0, 0.1]\nintensity = 1\n{more}");
            light_laws(&*with_image(&text).unwrap());
        }
        let light = with_image(&format!("{text}\nimage = 1")).unwrap();
        light_near_laws(&*light, DVec3::ZERO, Rgb::splat(2.0), DVec3::new(0.6, 0.0, 0.8));
    }

    /// Orientation and size of the image, and its product with the falloff and the soft edge.
    #[test]
    fn the_image_is_where_the_model_says() {
        let text = "position = [0, 0, 0]\ntarget = [0, 0, -5]\nintensity = [8, 4, 2]\nimage = \"ramp\"\n\
            cutoff_angle = 45\nbeam_width = 25";
        for (more, up) in [("", 1.0), ("up = [0, -2, 1]", -1.0)] {
            let light = with_image(&format!("{text}\n{more}")).unwrap();
            // At depth 2 the image is 4 wide and high.
            for (x, y) in [(0.0, 0.0), (0.5, 0.25), (-0.8, -0.2), (0.0, 1.5), (-1.2, 1.1)] {
                let p = DVec3::new(x, y, -2.0);
                let (u, v) = (0.5 + up * x / 4.0, 0.5 + up * y / 4.0);
                let angle = (p.truncate().length() / 2.0).atan().to_degrees();
                let share = ((45.0 - angle) / 20.0).clamp(0.0, 1.0) / p.length_squared();
                let mut samples = Vec::new();
                light.samples(p, &mut samples);
                let found = samples[0].irradiance.to_array();
                let expected = [8.0 * u, 4.0 * v, 2.0 * (u + 2.0 * v)].map(|e| e * share);
                for (found, expected) in found.into_iter().zip(expected) {
                    assert!((found - expected).abs() < 1e-13, "{p}: {found}, not {expected}");
                }
            }
            assert_eq!(irradiance(&*light, DVec3::new(1.5, 1.5, -2.0)), 0.0);
            assert_eq!(irradiance(&*light, DVec3::new(0.0, 0.1, 2.0)), 0.0);
        }
        let none = format!("{text}\nfalloff = \"none\"");
        let light = with_image(&none).unwrap();
        for distance in [0.1, 1.0, 1e6] {
            let found = irradiance(&*light, distance * DVec3::new(0.0, 0.25, -1.0));
            assert!((found - 4.0 * 0.625).abs() < 1e-13, "{distance}: {found}");
        }
        let dark = text.replace("\"ramp\"", "0");
        assert!(!with_image(&dark).unwrap().affects_bounds(&Aabb::EVERYTHING));
    }

    #[test]
    fn the_edge_is_linear_in_the_angle() {
        let text = "position = [0, 0, 0]\ntarget = [0, 0, -5]\nintensity = 8\ncutoff_angle = 30\n\
            beam_width = 10\nfalloff = \"none\"";
        let light = build::<Lights, Spot>(text, ()).unwrap();
        for (degrees, expected) in [
            (0.0, 8.0),
            (9.9, 8.0),
            (15.0, 6.0),
            (20.0, 4.0),
            (29.0, 0.4),
            (30.1, 0.0),
            (180.0, 0.0),
        ] {
            let (sin, cos) = f64::to_radians(degrees).sin_cos();
            let found = irradiance(&*light, 7.0 * DVec3::new(0.6 * sin, 0.8 * sin, -cos));
            assert!((found - expected).abs() < 1e-13, "{degrees} degrees: {found}");
        }
    }

    #[test]
    fn boxes_beside_the_cone_are_not_reached() {
        let light = |more: &str| {
            let text = format!(
                "position = [0.5, 0, 2]\ntarget = [0.5, 0, -8]\nintensity = 2\ncutoff_angle = 45\n{more}"
            );
            with_image(&text).unwrap()
        };
        let plain = light("");
        for (center, radius, reached) in [
            ([0.5, 0.0, 0.0], 0.1, true),
            // The centre is 11.3 degrees outside the cone.
            ([3.5, 0.0, 0.0], 0.0, false),
            ([3.5, 0.0, 0.0], 0.5, false),
            ([3.5, 0.0, 0.0], 1.0, true),
            // Behind the light, and around it.
            ([0.5, 0.0, 4.0], 1.0, false),
            ([0.5, 0.0, 4.0], 3.0, true),
            // By half of the margin, and by twice the margin.
            ([0.5 + 1.0 + ANGLE_MARGIN, 0.0, 1.0], 0.0, true),
            ([0.5 + 1.0 + 4.0 * ANGLE_MARGIN, 0.0, 1.0], 0.0, false),
        ] {
            let found = plain.affects_bounds(&emission::cube_in_ball(center, radius));
            assert_eq!(found, reached, "{center:?} {radius}");
        }
        assert!(!light("image = 0").affects_bounds(&Aabb::EVERYTHING));
        let bounds = light("image = [1, 2, 3]").bounds().unwrap();
        let position = DVec3::new(0.5, 0.0, 2.0);
        assert_eq!((bounds.bounds.min, bounds.bounds.max), (position, position));
        assert_eq!(bounds.max_intensity, 6.0);
    }

    #[test]
    fn a_beam_of_a_millionth_of_a_degree_keeps_its_edge() {
        let text =
            "position = [0, 0, 0]\ntarget = [0, 0, -1]\nintensity = 1\ncutoff_angle = 1e-6\nbeam_width = 0";
        let light = build::<Lights, Spot>(text, ()).unwrap();
        let half = 0.5e-6_f64.to_radians();
        assert!((irradiance(&*light, DVec3::new(half, 0.0, -1.0)) - 0.5).abs() < 1e-14);
    }

    #[test]
    fn all_faults_are_reported_at_their_places() {
        let text =
            "position = [0, 1, 0]\ntarget = [0, 1, 0]\nintensity = 1\ncutoff_angle = 90\nbeam_width = 95";
        let errors = build::<Lights, Spot>(text, ()).err().unwrap();
        let found: Vec<&str> = errors.0.iter().map(|e| &text[e.span.clone().unwrap()]).collect();
        assert_eq!(found, ["[0, 1, 0]", "90", "95"]);
        let text = "position = [0, 1, 0]\ntarget = [0, 0, 0]\nintensity = 1\ncutoff_angle = 0.0";
        let error = build::<Lights, Spot>(text, ()).err().unwrap().0.remove(0);
        assert_eq!(&text[error.span.unwrap()], "0.0");
        let text = "position = [0, 1, 0]\ntarget = [0, 0, 0]\nintensity = 1\nbeam_width = 20";
        assert!(build::<Lights, Spot>(text, ()).is_err());
        let text = "position = [0, 1, 0]\ntarget = [0, 5, 0]\nintensity = 1";
        for (more, place) in [
            ("up = [1, 0, 0]", "[1, 0, 0]"),
            ("image = 1", "[0, 5, 0]"),
            ("image = 1\nup = [0, -2, 0]", "[0, -2, 0]"),
            ("image = 1\nup = [0, 0, 0]", "[0, 0, 0]"),
            ("image = -1\nup = [0, 1, 1]", "-1"),
        ] {
            let text = format!("{text}\n{more}");
            let error = with_image(&text).err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], place, "{}", error.message);
        }
        let both = with_image(&format!("{text}\nimage = \"none\"\nup = [0, 0, 0]"));
        assert_eq!(both.err().unwrap().0.len(), 2);
        assert!(with_image(&format!("{text}\nimage = 1\nup = [0, 1, 1]")).is_ok());
    }
}
