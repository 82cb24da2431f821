//! An environment map: a texture on the sphere of directions, visible behind everything and in
//! reflections, and optionally a light.
//!
//! Blinn and Newell, *Texture and reflection in computer generated images*, 1976
//! (latitude-longitude maps); Greene, *Environment mapping and other applications of world
//! projections*, 1986 (also cube maps). Its illumination is a fixed quadrature over directions
//! placed by luminance (`sky.rs`). `scenes/showcase/cube_map.toml` uses a cube map.
//!
//! - Twin: a formula of the Mitsuba driver, which looks up the same texture.
//! - Example: `scenes/lights/environment.toml`.

use crate::support::sky;
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer};
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::{IntegerIn, TextureRef};
use whitstone_core::direction_map::{DirectionMap, Faces};
use whitstone_core::stream::{SampleStreams, Vectors};
use whitstone_core::{Context, DVec3, Light, LightFlags, LightSample, Lights, Plugin, Rgb, SceneErrors};

/// An environment map: visible behind everything, and optionally a light.
#[derive(Debug, JsonSchema)]
#[schemars(try_from = "Keys")]
pub struct Config(Keys);

impl<'de> Deserialize<'de> for Config {
    /// Checks the required keys here, so that a missing one is reported together with other errors.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let keys = Keys::deserialize(deserializer)?;
        if keys.radiance.is_none() && keys.faces.is_none() {
            return Err(serde::de::Error::missing_field("radiance or faces"));
        }
        Ok(Self(keys))
    }
}

/// An environment map: visible behind everything, and optionally a light.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Keys {
    /// Radiance in W/(m² sr) as a texture on the sphere of directions, such as a latitude-longitude
    /// map, or a colour.
    #[serde(default)]
    #[schemars(extend("x-default" = "none: this or `faces` is required"), with = "TextureRef")]
    radiance: Option<TextureRef>,
    /// Radiance in W/(m² sr) as a cube map: six square images of the same size.
    #[serde(default)]
    #[schemars(extend("x-default" = "none: this or `radiance` is required"), with = "Faces")]
    faces: Option<Spanned<Faces>>,
    /// The map illuminates surfaces from up to 2 samples² directions, placed by luminance; each
    /// costs a shadow ray per surface point. 0: the map is visible but illuminates nothing.
    #[serde(default = "zero")]
    samples: IntegerIn<0, 32>,
}

fn zero() -> IntegerIn<0, 32> {
    IntegerIn::new(0).expect("0 is in range")
}

/// The `environment` light; see the module documentation.
pub struct Environment {
    map: DirectionMap,
    /// Directions of illumination, with their irradiance.
    samples: Vec<LightSample>,
}

impl Plugin<Lights> for Environment {
    const TYPE: &'static str = "environment";
    type Config = Config;

    fn build(Config(keys): Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Light>, SceneErrors> {
        let map = DirectionMap::new(keys.radiance.as_ref(), keys.faces.as_ref(), context)?;
        let n = keys.samples.get() as usize;
        let samples = match n {
            0 => Vec::new(),
            _ => sky::directions(2 * n * n, parts(&map), |uv, direction| map.at(uv, direction)),
        };
        Ok(Arc::new(Self { map, samples }))
    }
}

/// Number of lookups along each axis of a cell of the illumination table.
fn parts(map: &DirectionMap) -> usize {
    match (map, map.size()) {
        (_, None) => 1,
        (DirectionMap::Sphere(_), Some(size)) => sky::parts_of_picture(size),
        (DirectionMap::Cube(_), Some([side, _])) => sky::parts_of_cube(side),
    }
}

impl Light for Environment {
    fn flags(&self) -> LightFlags {
        if self.samples.is_empty() {
            LightFlags::BACKGROUND
        } else {
            LightFlags::BACKGROUND | LightFlags::SAMPLES
        }
    }

    fn samples(&self, _: DVec3, out: &mut Vec<LightSample>) {
        out.extend_from_slice(&self.samples);
    }

    fn samples_stream(&self, len: usize, _: &Vectors, out: &mut SampleStreams) {
        for sample in &self.samples {
            let stream = out.add();
            for lane in 0..len {
                stream.set(lane, sample);
            }
        }
    }

    fn background(&self, direction: DVec3) -> Rgb {
        self.map.value(direction)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;
    use whitstone_core::ColorSource;
    use whitstone_core::{SurfaceAttributes, SurfaceInteraction, Texture};
    use whitstone_testkit::{TestContext, build_in, light_laws};

    /// A texture with (u, v) as red and green.
    struct Ramp;

    impl Texture for Ramp {
        fn needs(&self) -> SurfaceAttributes {
            SurfaceAttributes::UV
        }

        fn value(&self, point: &SurfaceInteraction) -> Rgb {
            Rgb::new(point.uv.x, point.uv.y, 0.0)
        }
    }

    /// An image of the given size in texels, with (u, v) as red and green and the face number as
    /// blue.
    struct Marked(f64, [usize; 2]);

    impl Texture for Marked {
        fn needs(&self) -> SurfaceAttributes {
            SurfaceAttributes::UV
        }

        fn value(&self, point: &SurfaceInteraction) -> Rgb {
            Rgb::new(point.uv.x, point.uv.y, self.0)
        }

        fn size(&self) -> Option<[usize; 2]> {
            Some(self.1)
        }
    }

    const NAMES: [&str; 6] = ["px", "nx", "py", "ny", "pz", "nz"];

    /// A scene table with six faces, each in the file of its name except `odd`.
    fn faces(odd: &str, file: &str) -> String {
        let file = |name| if name == odd { file } else { name };
        NAMES
            .map(|name| format!("faces.{name}.file = \"{}\"\n", file(name)))
            .concat()
    }

    fn environment(text: &str) -> Result<Arc<dyn Light>, SceneErrors> {
        let mut context = TestContext::default().with_texture("ramp", Ramp);
        for (name, number) in NAMES.into_iter().zip(0..) {
            context = context.with_picture(name, Marked(f64::from(number), [8, 8]));
        }
        context = context
            .with_picture("wide", Marked(0.0, [8, 4]))
            .with_picture("small", Marked(0.0, [4, 4]));
        build_in::<Lights, Environment>(text, (), &mut context)
    }

    #[test]
    fn laws() {
        for text in [
            "radiance = [1, 2, 3]",
            "radiance = \"ramp\"",
            "radiance = \"ramp\"\nsamples = 3",
        ] {
            light_laws(&*environment(text).unwrap());
        }
        light_laws(&*environment(&format!("{}samples = 2", faces("", ""))).unwrap());
    }

    /// The table of the sky has 1024 x 512 cells. Images with more texels are looked up several
    /// times in each.
    #[test]
    fn large_images_are_looked_up_at_every_other_texel() {
        let image = |size: [usize; 2]| Arc::new(Marked(0.0, size));
        let sphere = |size| parts(&DirectionMap::Sphere(ColorSource::Texture(image(size))));
        assert_eq!(sphere([8, 4]), 1);
        assert_eq!(sphere([4096, 2048]), 2);
        assert_eq!(sphere([4097, 2048]), 3);
        assert_eq!(sphere([8, 4097]), 5);
        let cube = |side| {
            parts(&DirectionMap::Cube(std::array::from_fn(|_| {
                image([side; 2]) as _
            })))
        };
        assert_eq!((cube(8), cube(1024), cube(1025)), (1, 2, 3));
        assert_eq!(parts(&DirectionMap::Sphere(ColorSource::Constant(Rgb::WHITE))), 1);
    }

    /// Each face is the view of a camera that looks along its axis: right is forward x up.
    #[test]
    fn faces_are_what_cameras_see() {
        let light = environment(&faces("", "")).unwrap();
        let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
        for (number, forward, up) in [
            (0.0, x, y),
            (1.0, -x, y),
            (2.0, y, z),
            (3.0, -y, -z),
            (4.0, z, y),
            (5.0, -z, y),
        ] {
            for (a, c) in [(0.0, 0.0), (0.9, 0.2), (-0.4, 0.7), (0.3, -0.99)] {
                let direction = (forward + a * forward.cross(up) + c * up).normalize();
                let expected = Rgb::new(0.5 + 0.5 * a, 0.5 + 0.5 * c, number);
                let found = light.background(direction);
                let off = (found + expected * -1.0).map(f64::abs).max_component();
                assert!(off < 1e-15, "{number} {a} {c}: {found:?}");
            }
        }
        // On an edge or a corner, the face of the first axis is used.
        assert_eq!(
            light.background(DVec3::new(1.0, 1.0, -1.0)),
            Rgb::new(0.0, 1.0, 0.0)
        );
        assert_eq!(
            light.background(DVec3::new(0.0, -1.0, 1.0)),
            Rgb::new(0.5, 0.0, 3.0)
        );
    }

    #[test]
    fn faces_that_do_not_fit_together_are_refused_at_their_places() {
        let missing = faces("", "").replace("faces.pz.file = \"pz\"\n", "");
        assert!(environment(&missing).err().unwrap().0[0].message.contains("pz"));
        for (odd, file, message) in [
            ("nx", "none", "the test context has no such image"),
            ("py", "wide", "expected a square image, found 8 x 4"),
            (
                "nz",
                "small",
                "expected an image of 8 x 8 pixels like the other faces, found 4 x 4",
            ),
        ] {
            let text = faces(odd, file);
            let errors = environment(&text).err().unwrap();
            assert_eq!(errors.0.len(), 1);
            assert_eq!(errors.0[0].message, message);
            assert_eq!(text[errors.0[0].span.clone().unwrap()], format!("\"{file}\""));
        }
        assert!(environment(&format!("radiance = 1\n{}", faces("", ""))).is_err());
    }

    #[test]
    fn directions_have_places() {
        let light = environment("radiance = \"ramp\"").unwrap();
        for (direction, u, v) in [
            (DVec3::NEG_Z, 0.5, 0.5),
            (DVec3::X, 0.75, 0.5),
            (DVec3::NEG_X, 0.25, 0.5),
            (DVec3::new(0.0, 0.6, -0.6), 0.5, 0.75),
        ] {
            let found = light.background(direction);
            assert!(
                (found.r - u).abs() < 1e-15 && (found.g - v).abs() < 1e-15,
                "{direction}: {found:?}"
            );
        }
        assert_eq!(light.background(DVec3::Y).g, 1.0);
        assert_eq!(light.background(DVec3::NEG_Y).g, 0.0);
    }

    /// A uniform sky gives pi times its radiance. Its energy is that of the whole sphere for any
    /// number of directions.
    #[test]
    fn an_even_sky() {
        for n in [1, 4, 31] {
            let mut samples = Vec::new();
            environment(&format!("radiance = 2\nsamples = {n}"))
                .unwrap()
                .samples(DVec3::ZERO, &mut samples);
            assert_eq!(samples.len(), 2 * n * n);
            let total: f64 = samples.iter().map(|sample| sample.irradiance.g).sum();
            assert!((total / (8.0 * PI) - 1.0).abs() < 1e-12);
            let up: f64 = samples
                .iter()
                .map(|s| s.irradiance.g * s.direction.y.max(0.0))
                .sum();
            let tolerance = 1.0 / (n * n) as f64;
            assert!((up / (2.0 * PI) - 1.0).abs() <= tolerance, "{n}: {up}");
        }
    }

    #[test]
    fn a_black_sky_lights_nothing() {
        let mut samples = Vec::new();
        let black = environment("radiance = 0\nsamples = 3").unwrap();
        black.samples(DVec3::ZERO, &mut samples);
        assert!(samples.is_empty());
        // Sums of the largest finite radiances stay finite.
        let bright = environment("radiance = 1e308\nsamples = 3").unwrap();
        bright.samples(DVec3::ZERO, &mut samples);
        assert!(
            samples
                .iter()
                .all(|s| s.irradiance.g.is_finite() && s.direction.is_normalized())
        );
    }

    #[test]
    fn bad_values_are_refused_at_their_places() {
        let text = "radiance = -1\nsamples = 100";
        assert_eq!(environment(text).err().unwrap().0.len(), 2);
        // Missing keys are reported together with invalid ones, and an invalid key is not reported
        // as missing.
        for (text, expected) in [
            ("samples = 1", &["missing key `radiance` or `faces`"][..]),
            (
                "samples = 33",
                &[
                    "expected an integer from 0 to 32, found 33",
                    "missing key `radiance` or `faces`",
                ],
            ),
            (
                "sample = 2",
                &["unknown key `sample`", "missing key `radiance` or `faces`"],
            ),
            ("radiance = -1", &["expected a colour of at least 0, found -1"]),
            (
                "faces = 1\nsamples = 2",
                &["wrong type: integer `1`, expected a table of six faces: px, nx, py, ny, pz, nz"],
            ),
        ] {
            let errors = environment(text).err().unwrap().0;
            let messages: Vec<&str> = errors.iter().map(|error| error.message.as_str()).collect();
            assert_eq!(messages, expected, "{text}");
        }
    }
}
