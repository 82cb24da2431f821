//! A height over the surface that is seen in the shading only.
//!
//! Blinn 1978, *Simulation of wrinkled surfaces*: the normal is that of the surface raised by the height, of which only the slope is
//! taken over. Here the height is a function of the place in the world (Perlin 1985, *An image synthesizer*, section "Texture"), so no
//! tangents are asked of shapes; its slope is the difference quotient that the model says, so that two programs agree.
//!
//! - Twin: through the driver, which turns the frame that Mitsuba's materials see.
//! - Example: `scenes/materials/bump.toml`.

use crate::detail::{Detail, Detailed};
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::{Finite, MaterialRef, Positive, TextureRef};
use whitstone_core::{
    ColorSource, Context, DVec3, Material, Materials, Needs, Plugin, SceneError, SceneErrors, SurfacePoint,
};

/// A height over the surface that is seen in the shading only.
///
/// Outlines and shadows stay those of the smooth surface. Of the showcase's `bump_sphere` and `displacement`, which has the same relief in its triangles,
/// the shades differ by 11% of the mean in the middle of the ball, by 29% where there is no bump; 156 pixels at the outline and 77 in the shadow are wrong.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The height: a texture that lies by the place in the world, of which the first channel counts.
    height: TextureRef,
    /// Metres for a height of 1.
    #[serde(default = "one")]
    scale: Finite,
    /// How far to either side the height is looked up for its slope, in metres.
    #[serde(default = "millimetre")]
    step: Positive,
    /// What is shaded by it.
    material: MaterialRef,
}

fn one() -> Finite {
    Finite::new(1.0).expect("1 is finite")
}

fn millimetre() -> Positive {
    Positive::new(1e-3).expect("it is positive")
}

/// See the module.
pub struct Bump {
    height: ColorSource,
    scale: f64,
    step: f64,
}

impl Plugin<Materials> for Bump {
    const TYPE: &'static str = "bump";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        let mut errors = SceneErrors::default();
        let height = errors.take(context.texture(&config.height));
        let inner = errors.take(context.material(&config.material));
        if let Some(height) = &height
            && height.needs().contains(Needs::UV)
        {
            let mut error = SceneError::anywhere("this texture lies by (u, v), and only shapes know where that is")
                .with_help("let it lie by the place in the world: mapping = { projection = \"planar\" }, or \"solid\", \"spherical\", ...");
            error.span = config.height.span.clone();
            errors.0.push(error);
        }
        match (height, inner) {
            // A constant height has no slope.
            (Some(ColorSource::Constant(_)), Some(inner)) => errors.into_result(inner),
            (Some(height), Some(inner)) => {
                let (scale, step) = (config.scale.get(), config.step.get());
                let detail = Self { height, scale, step };
                errors.into_result(Arc::new(Detailed { detail, inner }))
            }
            _ => Err(errors),
        }
    }
}

impl Detail for Bump {
    fn needs(&self) -> Needs {
        self.height.needs()
    }

    fn normal(&self, point: &SurfacePoint) -> Option<DVec3> {
        let height = |offset: DVec3| {
            let beside = SurfacePoint {
                position: point.position + offset,
                ..*point
            };
            self.height.value(&beside).r
        };
        let along = |axis: DVec3| height(axis * self.step) - height(-axis * self.step);
        let slopes = DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z));
        let gradient = slopes * (self.scale / (2.0 * self.step));
        let n = point.n_s;
        (n - (gradient - gradient.dot(n) * n)).try_normalize()
    }
}

#[cfg(all(test, feature = "all"))]
mod tests {
    use super::*;
    use crate::{matte::Matte, mirror::Mirror};
    use whitstone_core::{Branches, Lobes, Rgb, Texture};
    use whitstone_testkit::{TestContext, build_in, sided_material_laws};

    /// A height that rises along x.
    struct Slope(f64);

    impl Texture for Slope {
        fn needs(&self) -> Needs {
            Needs::NOTHING
        }

        fn value(&self, point: &SurfacePoint) -> Rgb {
            Rgb::splat((5.0 + self.0 * point.position.x).max(0.0))
        }
    }

    /// One of (u, v).
    struct Flat;

    impl Texture for Flat {
        fn needs(&self) -> Needs {
            Needs::UV
        }

        fn value(&self, point: &SurfacePoint) -> Rgb {
            Rgb::splat(point.uv.x)
        }
    }

    fn bump(text: &str) -> Result<Arc<dyn Material>, SceneErrors> {
        let mut context = TestContext::default()
            .with_material::<Matte>("matte", "")
            .with_material::<Mirror>("mirror", "")
            .with_texture("slope", Slope(0.75))
            .with_texture("flat", Flat);
        build_in::<Materials, Bump>(text, (), &mut context)
    }

    #[test]
    fn laws() {
        for text in [
            "height = \"slope\"\nmaterial = \"matte\"",
            "height = \"slope\"\nscale = -40\nmaterial = \"mirror\"",
            "height = \"slope\"\nscale = 1e300\nmaterial = \"mirror\"",
            "height = 0.5\nmaterial = \"matte\"",
        ] {
            sided_material_laws(&*bump(text).unwrap());
        }
    }

    #[test]
    fn a_slope_of_three_quarters() {
        let material = bump("height = \"slope\"\nmaterial = \"mirror\"\nstep = 0.5").unwrap();
        let point = SurfacePoint::new(DVec3::ZERO, 0.0, DVec3::Z);
        let mut branches = Branches::default();
        material.branches(&point, DVec3::Z, &mut branches);
        // The normal is (-0.6, 0, 0.8).
        let found = branches.iter().next().unwrap().direction;
        assert!((found - DVec3::new(-0.96, 0.0, 0.28)).length() < 1e-15, "{found}");
        assert!(material.lobes().contains(Lobes::OWN_NORMAL));
        let none = bump("height = 3\nmaterial = \"mirror\"").unwrap();
        assert_eq!(none.lobes(), Lobes::REFLECTION);
    }

    #[test]
    fn what_lies_by_uv_is_refused_at_its_place() {
        for (text, place) in [
            ("height = \"flat\"\nmaterial = \"matte\"", "\"flat\""),
            ("height = \"slope\"\nmaterial = \"matte\"\nstep = 0", "0"),
            ("height = \"slope\"\nmaterial = \"gold\"", "\"gold\""),
        ] {
            let error = bump(text).err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], place);
        }
    }
}
