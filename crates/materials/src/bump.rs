//! Bump mapping: perturbs the shading normal by a height or by vectors that are added to it.
//!
//! Blinn 1978, *Simulation of wrinkled surfaces*: the shading normal is the normal of the surface
//! displaced by the height. Only the slope of the height matters. The height is a function of the
//! world-space position (Perlin 1985, *An image synthesizer*, section "Texture"), of the texture
//! coordinates, or of both. Its derivatives are the central differences that the model specifies,
//! so that independent programs agree. The differences along u and v are multiplied by the surface
//! gradients of u and v. This is Blinn's formula, valid for tangents of any length and angle.
//!
//! The lecture notes instead use "a 2D or 3D array of vectors which are added to the normals at the
//! points for which we do shading calculations". With `vector_map`, these vectors are the colours
//! of an image, a voxel grid or any other texture.
//!
//! - Twin: hosted by the Mitsuba driver, which rotates the shading frame that Mitsuba's BSDFs see.
//! - Example: `scenes/materials/bump.toml`.

use crate::support::detail::{Detail, Detailed};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::{Finite, MaterialRef, Positive, TextureRef, Vector3};
use whitstone_core::{
    ColorSource, Context, DVec2, DVec3, Material, Materials, Plugin, SceneError, SceneErrors,
    SurfaceAttributes, SurfaceInteraction, TangentField,
};

/// Default of `step`, in metres.
const DEFAULT_STEP: f64 = 1e-3;

/// Bump mapping: perturbs the shading normal by a height or by vectors that are added to it.
///
/// Only the shading changes: silhouettes and shadows are those of the smooth surface. The showcase
/// scenes `bump_sphere` and `displacement` have the same relief, as bumps and as triangles. Their
/// shading differs by 11% of the mean in the middle of the ball; a smooth ball differs from the
/// displaced one by 29%. With bumps, 156 of the 160 x 120 pixels are wrong at the silhouette, and
/// 77 in the shadow.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The height: the first channel of a texture that is mapped by world-space position or by
    /// (u, v). On shapes without derivatives of (u, v), such as `fractal`, (u, v) gives no bumps.
    #[serde(default)]
    #[schemars(extend("x-default" = "none: this or `vector_map` is required"), with = "TextureRef")]
    height: Option<TextureRef>,
    /// Vectors instead of a height: 2 * colour - 1, so that mid grey (0.5) is the zero vector. Read
    /// images with `color_space = "linear"`. No 8-bit value is exactly 0.5, so an 8-bit image
    /// contains no exact zero vector.
    #[serde(default)]
    #[schemars(extend("x-default" = "none: this or `height` is required"), with = "TextureRef")]
    vector_map: Option<TextureRef>,
    /// Axes of the vectors: "world" (the world axes) or "tangent" (tangent, bitangent and shading
    /// normal).
    #[serde(default)]
    #[schemars(extend("default" = "world"), with = "Space")]
    space: Option<Spanned<Space>>,
    /// For the space "tangent": a world-space direction, whose projection onto the tangent plane is
    /// the tangent, as for `normal_map`.
    #[serde(default)]
    #[schemars(extend("x-default" = "[1, 0, 0] without `axis`"), with = "Vector3")]
    tangent: Option<Spanned<Vector3>>,
    /// For the space "tangent": a world-space axis, around which the tangents run in circles
    /// (axis x normal); replaces `tangent`.
    #[serde(default)]
    #[schemars(extend("x-default" = "none"), with = "Vector3")]
    axis: Option<Spanned<Vector3>>,
    /// Height in metres of the texture value 1. With `vector_map`, the factor on the vectors before
    /// they are added to the unit normal.
    #[serde(default = "one")]
    scale: Finite,
    /// Step of the central differences: the height is sampled at this distance to both sides of the
    /// point, along each world axis in metres, and along u and v in texture coordinates.
    #[serde(default)]
    #[schemars(extend("default" = DEFAULT_STEP), with = "Positive")]
    step: Option<Spanned<Positive>>,
    /// Material that is shaded with the perturbed normal.
    material: MaterialRef,
}

fn one() -> Finite {
    Finite::new(1.0).expect("1 is finite")
}

/// Axes that the components of a vector refer to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Space {
    /// World axes.
    World,
    /// Tangent, bitangent and shading normal.
    Tangent,
}

/// The `bump` material; see the module documentation.
pub struct Bump;

/// Perturbs the normal by the gradient of a height.
struct Height {
    height: ColorSource,
    scale: f64,
    step: f64,
    /// Whether the height depends on (u, v).
    by_uv: bool,
}

/// Perturbs the normal by adding vectors.
struct Vectors {
    vectors: ColorSource,
    scale: f64,
    /// Tangent frame; `None` for the world axes.
    frame: Option<TangentField>,
}

impl Plugin<Materials> for Bump {
    const TYPE: &'static str = "bump";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        let mut errors = SceneErrors::default();
        let inner = errors.take(context.material(&config.material));
        let scale = config.scale.get();
        match (&config.height, &config.vector_map) {
            (Some(height), None) => {
                let detail = errors.take(Height::new(height, &config, context));
                match (detail, inner) {
                    // A constant height has no slope.
                    (
                        Some(Height {
                            height: ColorSource::Constant(_),
                            ..
                        }),
                        Some(inner),
                    ) => errors.into_result(inner),
                    (Some(detail), Some(inner)) => errors.into_result(Arc::new(Detailed { detail, inner })),
                    _ => Err(errors),
                }
            }
            (None, Some(vectors)) => {
                let vectors = errors.take(context.texture(vectors));
                let frame = errors.take(frame(&config));
                match (vectors, frame, inner) {
                    (Some(vectors), Some(frame), Some(inner)) => {
                        let detail = Vectors {
                            vectors,
                            scale,
                            frame,
                        };
                        errors.into_result(Arc::new(Detailed { detail, inner }))
                    }
                    _ => Err(errors),
                }
            }
            (Some(_), Some(vectors)) => {
                let mut error = SceneError::anywhere("either `height` or `vector_map`, not both");
                error.span = vectors.span.clone();
                errors.0.push(error);
                Err(errors)
            }
            (None, None) => {
                errors
                    .0
                    .push(SceneError::anywhere("a bump map needs `height` or `vector_map`"));
                Err(errors)
            }
        }
    }
}

impl Height {
    fn new(height: &TextureRef, config: &Config, context: &mut dyn Context) -> Result<Self, SceneErrors> {
        let mut errors = SceneErrors::default();
        let found = errors.take(context.texture(height));
        if let Some(found) = &found
            && found.needs().contains(SurfaceAttributes::SECOND_UV)
        {
            let mut error = SceneError::anywhere("a height cannot use the second texture coordinates: their gradients are not computed")
                .with_help("map it by the first ones, with the projection \"uv\", or by position: \"planar\", \"solid\", ...");
            error.span = height.span.clone();
            errors.0.push(error);
        }
        let space = config.space.as_ref().map(Spanned::span);
        let directions = [&config.tangent, &config.axis].map(|given| given.as_ref().map(Spanned::span));
        for span in directions.into_iter().chain([space]).flatten() {
            errors.0.push(SceneError::at(
                span,
                "this key needs `vector_map`: a height has no directions",
            ));
        }
        match found {
            Some(height) => errors.into_result(Self {
                by_uv: height.needs().contains(SurfaceAttributes::UV),
                height,
                scale: config.scale.get(),
                step: config
                    .step
                    .as_ref()
                    .map_or(DEFAULT_STEP, |step| step.get_ref().get()),
            }),
            None => Err(errors),
        }
    }
}

/// The tangent frame of the vectors; `None` for the world axes.
fn frame(config: &Config) -> Result<Option<TangentField>, SceneErrors> {
    let mut errors = SceneErrors::default();
    if let Some(step) = &config.step {
        let message = "a step needs `height`: vectors are looked up at one point";
        errors.0.push(SceneError::at(step.span(), message));
    }
    let space = config.space.as_ref();
    let is_tangent = space.is_some_and(|space| *space.get_ref() == Space::Tangent);
    let (tangent, axis) = (config.tangent.as_ref(), config.axis.as_ref());
    let frame = errors.take(TangentField::of_space(is_tangent, tangent, axis));
    errors.into_result(frame.flatten())
}

impl Detail for Height {
    fn needs(&self) -> SurfaceAttributes {
        let gradients = match self.by_uv {
            true => SurfaceAttributes::UV_GRADIENT,
            false => SurfaceAttributes::NOTHING,
        };
        self.height.needs() | gradients
    }

    fn normal(&self, point: &SurfaceInteraction) -> Option<DVec3> {
        let height = |position: DVec3, uv: DVec2| {
            let beside = SurfaceInteraction {
                position: point.position + position,
                uv: point.uv + uv,
                ..*point
            };
            self.height.value(&beside).r
        };
        let along =
            |axis: DVec3| height(axis * self.step, DVec2::ZERO) - height(-axis * self.step, DVec2::ZERO);
        let mut differences = DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z));
        if self.by_uv {
            let along =
                |axis: DVec2| height(DVec3::ZERO, axis * self.step) - height(DVec3::ZERO, -axis * self.step);
            let [u, v] = point.uv_gradient;
            differences += along(DVec2::X) * u + along(DVec2::Y) * v;
        }
        let gradient = differences * (self.scale / (2.0 * self.step));
        let n = point.n_s;
        (n - (gradient - gradient.dot(n) * n)).try_normalize()
    }
}

impl Detail for Vectors {
    fn needs(&self) -> SurfaceAttributes {
        self.vectors.needs()
    }

    fn normal(&self, point: &SurfaceInteraction) -> Option<DVec3> {
        let vector = match &self.frame {
            None => self.vectors.value(point).to_vector(),
            Some(frame) => frame.vector(self.vectors.value(point).to_vector(), point.n_s)?,
        };
        (point.n_s + self.scale * vector).try_normalize()
    }
}

#[cfg(all(test, feature = "all"))]
mod tests {
    use super::*;
    use crate::{matte::Matte, mirror::Mirror};
    use whitstone_core::{BsdfFlags, Rgb, SpecularRays, Texture};
    use whitstone_testkit::{TestContext, build_in, sided_material_laws};

    /// A height that rises along x.
    struct Slope(f64);

    impl Texture for Slope {
        fn needs(&self) -> SurfaceAttributes {
            SurfaceAttributes::NOTHING
        }

        fn value(&self, point: &SurfaceInteraction) -> Rgb {
            Rgb::splat((5.0 + self.0 * point.position.x).max(0.0))
        }
    }

    /// A texture over the second texture coordinates.
    struct Second;

    impl Texture for Second {
        fn needs(&self) -> SurfaceAttributes {
            SurfaceAttributes::SECOND_UV
        }

        fn value(&self, point: &SurfaceInteraction) -> Rgb {
            Rgb::splat(point.vertex.second_uv.x)
        }
    }

    /// A texture over (u, v).
    struct Flat;

    impl Texture for Flat {
        fn needs(&self) -> SurfaceAttributes {
            SurfaceAttributes::UV
        }

        fn value(&self, point: &SurfaceInteraction) -> Rgb {
            Rgb::splat(point.uv.x)
        }
    }

    fn bump(text: &str) -> Result<Arc<dyn Material>, SceneErrors> {
        let mut context = TestContext::default()
            .with_material::<Matte>("matte", "")
            .with_material::<Mirror>("mirror", "")
            .with_texture("slope", Slope(0.75))
            .with_texture("second", Second)
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
            "height = \"flat\"\nscale = 3\nmaterial = \"mirror\"",
            "vector_map = [0.9, 0.1, 0.6]\nmaterial = \"matte\"",
            "vector_map = \"slope\"\nscale = -3\nmaterial = \"mirror\"",
            "vector_map = \"flat\"\nscale = 1e300\nspace = \"tangent\"\naxis = [0, 1, 0]\nmaterial = \"mirror\"",
        ] {
            sided_material_laws(&*bump(text).unwrap());
        }
    }

    #[test]
    fn a_slope_of_three_quarters() {
        let material = bump("height = \"slope\"\nmaterial = \"mirror\"\nstep = 0.5").unwrap();
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let mut branches = SpecularRays::default();
        material.specular_rays(&point, DVec3::Z, &mut branches);
        // The normal is (-0.6, 0, 0.8).
        let found = branches.iter().next().unwrap().direction;
        assert!((found - DVec3::new(-0.96, 0.0, 0.28)).length() < 1e-15, "{found}");
        assert!(material.flags().contains(BsdfFlags::NORMAL_MAPPED));
        let none = bump("height = 3\nmaterial = \"mirror\"").unwrap();
        assert_eq!(none.flags(), BsdfFlags::REFLECTION);
    }

    /// The perturbed normal, computed from the reflection of a view direction along the normal +z.
    fn bent(text: &str) -> DVec3 {
        let material = bump(&format!("{text}\nmaterial = \"mirror\"")).unwrap();
        let mut point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        point.uv.x = 0.5;
        let mut branches = SpecularRays::default();
        material.specular_rays(&point, DVec3::Z, &mut branches);
        (branches.iter().next().unwrap().direction + DVec3::Z).normalize()
    }

    #[test]
    fn vectors_are_added_to_the_normal() {
        let near = |text: &str, expected: [f64; 3]| {
            let expected = DVec3::from_array(expected).normalize();
            assert!((bent(text) - expected).length() < 1e-15, "{text}: {}", bent(text));
        };
        near("vector_map = 0.5", [0.0, 0.0, 1.0]);
        near("vector_map = [1, 0.5, 0.5]\nscale = 0.75", [0.75, 0.0, 1.0]);
        near("vector_map = [0, 0.75, 0.75]", [-1.0, 0.5, 1.5]);
        // The tangent is y and the bitangent z x y = -x.
        let tangent = "vector_map = [1, 0.75, 0.5]\nspace = \"tangent\"\ntangent = [0, 3, 7]";
        near(tangent, [-0.5, 1.0, 1.0]);
        near(
            &tangent.replace("tangent = [0, 3, 7]", "axis = [-2, 0, 0]"),
            [-0.5, 1.0, 1.0],
        );
        near(
            "vector_map = [1, 0.75, 0.5]\nspace = \"tangent\"",
            [1.0, 0.5, 1.0],
        );
        // Vectors may be mapped by (u, v).
        near("vector_map = \"flat\"\nscale = 4", [0.0, 0.0, 1.0]);
        // Normals that face away from the viewer or have zero length are not used.
        near("vector_map = [0.5, 0.5, 0]\nscale = 2", [0.0, 0.0, 1.0]);
        near("vector_map = [0.5, 0.5, 0]", [0.0, 0.0, 1.0]);
    }

    /// A texture over v.
    struct Upwards;

    impl Texture for Upwards {
        fn needs(&self) -> SurfaceAttributes {
            SurfaceAttributes::UV
        }

        fn value(&self, point: &SurfaceInteraction) -> Rgb {
            Rgb::splat(point.uv.y)
        }
    }

    #[test]
    fn a_height_over_uv_rises_along_the_gradient_of_v() {
        let mut context = TestContext::default()
            .with_material::<Mirror>("mirror", "")
            .with_texture("upwards", Upwards);
        let text = "height = \"upwards\"\nscale = 0.25\nmaterial = \"mirror\"";
        let material = build_in::<Materials, Bump>(text, (), &mut context).unwrap();
        let mut point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        point.uv_gradient = [DVec3::X, DVec3::new(0.0, 3.0, 7.0)];
        let mut branches = SpecularRays::default();
        material.specular_rays(&point, DVec3::Z, &mut branches);
        let found = branches.iter().next().unwrap().direction;
        assert!((found - DVec3::new(0.0, -0.96, 0.28)).length() < 1e-12, "{found}");
    }

    #[test]
    fn vectors_need_what_their_texture_needs() {
        let needs = |text: &str| bump(&format!("{text}\nmaterial = \"mirror\"")).unwrap().needs();
        assert!(needs("vector_map = \"flat\"").contains(SurfaceAttributes::UV));
        assert!(!needs("vector_map = 0.5").contains(SurfaceAttributes::UV));
    }

    /// The height rises by `u`; the gradient of u is neither a unit vector nor in the plane.
    #[test]
    fn a_height_over_uv_rises_along_the_gradient_of_u() {
        let material = bump("height = \"flat\"\nscale = 0.25\nmaterial = \"mirror\"").unwrap();
        assert!(material.needs().contains(SurfaceAttributes::UV_GRADIENT));
        let mut point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        point.uv = DVec2::new(0.5, 0.25);
        point.uv_gradient = [DVec3::new(0.0, 3.0, 7.0), DVec3::X];
        let mut branches = SpecularRays::default();
        material.specular_rays(&point, DVec3::Z, &mut branches);
        // The normal is (0, -0.6, 0.8).
        let found = branches.iter().next().unwrap().direction;
        assert!((found - DVec3::new(0.0, -0.96, 0.28)).length() < 1e-12, "{found}");
        let by_position = bump("height = \"slope\"\nmaterial = \"mirror\"").unwrap();
        assert!(!by_position.needs().contains(SurfaceAttributes::UV_GRADIENT));
    }

    #[test]
    fn keys_that_do_not_go_together_are_refused_at_their_places() {
        for (text, place) in [
            ("height = \"slope\"\nvector_map = 0.25", "0.25"),
            ("vector_map = 0.25\nstep = 0.125", "0.125"),
            ("vector_map = 0.25\ntangent = [1, 0, 0]", "[1, 0, 0]"),
            (
                "vector_map = 0.25\nspace = \"tangent\"\naxis = [0, 0, 0]",
                "[0, 0, 0]",
            ),
            ("vector_map = 0.25\nspace = \"object\"", "\"object\""),
            ("height = \"slope\"\nspace = \"world\"", "\"world\""),
            ("height = \"slope\"\naxis = [0, 1, 0]", "[0, 1, 0]"),
        ] {
            let text = format!("{text}\nmaterial = \"matte\"");
            let error = bump(&text).err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], place);
        }
        assert!(bump("material = \"matte\"").is_err());
    }

    #[test]
    fn a_height_without_a_slope_is_refused_at_its_place() {
        for (text, place) in [
            ("height = \"second\"\nmaterial = \"matte\"", "\"second\""),
            ("height = \"slope\"\nmaterial = \"matte\"\nstep = 0", "0"),
            ("height = \"slope\"\nmaterial = \"gold\"", "\"gold\""),
        ] {
            let error = bump(text).err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], place);
        }
    }
}
