//! Normal mapping: shading normals from the colours of a texture.
//!
//! Cohen, Olano and Manocha 1998, *Appearance-preserving simplification* (tangent-space normals
//! encoded as colours). The scene defines the tangent frame by a world-space direction or an axis
//! of rotation, which are exact for every shape, or takes the tangents of a mesh.
//!
//! - Twin: hosted by the Mitsuba driver, which rotates the shading frame that Mitsuba's BSDFs see.
//! - Example: `scenes/materials/normal_map.toml`.

use crate::support::detail::{Detail, Detailed, Frame, Tangent};
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::{Finite, MaterialRef, TextureRef, Vector3};
use whitstone_core::{
    ColorSource, Context, DVec3, Material, Materials, Plugin, SceneErrors, SurfaceAttributes,
    SurfaceInteraction,
};

/// Normal mapping: shading normals from the colours of a texture, for any material.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// 2 * colour - 1 gives the components along tangent, bitangent and normal. Read images with
    /// `color_space = "linear"`.
    map: TextureRef,
    /// World-space direction of the tangent, projected onto the surface; or "mesh": the tangents
    /// of a mesh with `tangents = true`, as for maps that were made for it.
    #[serde(default)]
    #[schemars(extend("x-default" = "[1, 0, 0] without `axis`"), with = "Tangent")]
    tangent: Option<Spanned<Tangent>>,
    /// Axis around which the tangent runs, as on a globe; replaces `tangent`.
    #[serde(default)]
    #[schemars(extend("x-default" = "none"), with = "Vector3")]
    axis: Option<Spanned<Vector3>>,
    /// Factor on the components along tangent and bitangent.
    #[serde(default = "one")]
    strength: Finite,
    /// Material that is shaded with the mapped normal.
    material: MaterialRef,
}

fn one() -> Finite {
    Finite::new(1.0).expect("1 is finite")
}

/// The `normal_map` material; see the module documentation.
pub struct NormalMap {
    map: ColorSource,
    frame: Frame,
    strength: f64,
}

impl Plugin<Materials> for NormalMap {
    const TYPE: &'static str = "normal_map";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        let mut errors = SceneErrors::default();
        let map = errors.take(context.texture(&config.map));
        let inner = errors.take(context.material(&config.material));
        let frame = errors.take(Frame::new(config.tangent, config.axis.as_ref()));
        match (map, inner, frame) {
            (Some(map), Some(inner), Some(frame)) => {
                let strength = config.strength.get();
                let detail = Self { map, frame, strength };
                errors.into_result(Arc::new(Detailed { detail, inner }))
            }
            _ => Err(errors),
        }
    }
}

impl Detail for NormalMap {
    fn needs(&self) -> SurfaceAttributes {
        self.map.needs() | self.frame.needs()
    }

    fn normal(&self, point: &SurfaceInteraction) -> Option<DVec3> {
        self.frame
            .vector(&self.map, self.strength, point)?
            .try_normalize()
    }
}

#[cfg(all(test, feature = "all"))]
mod tests {
    use super::*;
    use crate::{matte::Matte, mirror::Mirror};
    use whitstone_core::{Rgb, SpecularRays, TangentField};
    use whitstone_testkit::{TestContext, build_in, sided_material_laws};

    fn normal_map(text: &str) -> Result<Arc<dyn Material>, SceneErrors> {
        let mut context = TestContext::default()
            .with_material::<Matte>("matte", "")
            .with_material::<Mirror>("mirror", "");
        build_in::<Materials, NormalMap>(text, (), &mut context)
    }

    #[test]
    fn laws() {
        for text in [
            "map = [0.7, 0.4, 0.9]\nmaterial = \"matte\"",
            "map = [0.1, 0.8, 0.6]\naxis = [0, 1, 0]\nmaterial = \"mirror\"",
            "map = 0.5\nmaterial = \"mirror\"",
            "map = 0\ntangent = [1e-9, 1, 2]\nmaterial = \"matte\"",
        ] {
            sided_material_laws(&*normal_map(text).unwrap());
        }
    }

    #[test]
    fn colours_are_parts_of_the_normal() {
        // n_s = z. The projected tangent is y, so the bitangent is -x.
        for frame in ["tangent = [0, 3, 7]", "axis = [-1, 0, 0]"] {
            let normal = |map: [f64; 3]| {
                let frame = if frame.starts_with('t') {
                    Frame::Field(TangentField::Along(DVec3::new(0.0, 3.0, 7.0)))
                } else {
                    // At z the tangent around x is -y, and around -x it is y.
                    Frame::Field(TangentField::Around(DVec3::NEG_X))
                };
                let map = ColorSource::Constant(Rgb::from(map));
                let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
                NormalMap {
                    map,
                    frame,
                    strength: 1.0,
                }
                .normal(&point)
                .unwrap()
            };
            assert_eq!(normal([0.5, 0.5, 1.0]), DVec3::Z, "{frame}");
            assert_eq!(normal([1.0, 0.5, 0.5]), DVec3::Y, "{frame}");
            assert_eq!(normal([0.5, 1.0, 0.5]), DVec3::NEG_X, "{frame}");
        }
    }

    #[test]
    fn a_normal_that_looks_away_is_not_taken() {
        let material = normal_map("map = [0.5, 0.5, 0]\nmaterial = \"mirror\"").unwrap();
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let view = DVec3::new(0.6, 0.0, 0.8);
        let mut branches = SpecularRays::default();
        material.specular_rays(&point, view, &mut branches);
        let found = branches.iter().next().unwrap().direction;
        assert!((found - DVec3::new(-0.6, 0.0, 0.8)).length() < 1e-15);
        // (0.8, 0, -0.6) looks away only a little, and (1, 0, 0) sees the viewer edge-on.
        for map in ["[0.9, 0.5, 0.2]", "[1, 0.5, 0.5]"] {
            let material = normal_map(&format!("map = {map}\nmaterial = \"mirror\"")).unwrap();
            branches = SpecularRays::default();
            material.specular_rays(&point, DVec3::Z, &mut branches);
            assert_eq!(branches.iter().next().unwrap().direction, DVec3::Z, "{map}");
        }
    }

    #[test]
    fn a_left_handed_mesh_turns_the_bitangent() {
        let mut point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        point.vertex.tangent = DVec3::X;
        for (handedness, expected) in [(1.0, DVec3::Y), (-1.0, DVec3::NEG_Y)] {
            point.vertex.handedness = handedness;
            let map = NormalMap {
                map: ColorSource::Constant(Rgb::new(0.5, 1.0, 0.5)),
                frame: Frame::Mesh,
                strength: 3.0,
            };
            assert_eq!(map.normal(&point), Some(expected));
        }
    }

    #[test]
    fn the_tangents_of_a_mesh_are_declared() {
        let needs = |text: &str| {
            normal_map(&format!("map = 0.5\nmaterial = \"matte\"\n{text}"))
                .unwrap()
                .needs()
        };
        assert!(needs("tangent = \"mesh\"").contains(SurfaceAttributes::TANGENT));
        assert!(!needs("").contains(SurfaceAttributes::TANGENT));
    }

    #[test]
    fn bad_frames_are_refused_at_their_places() {
        for (text, place) in [
            ("map = 1\nmaterial = \"matte\"\ntangent = [0, 0, 0]", "[0, 0, 0]"),
            (
                "map = 1\nmaterial = \"matte\"\ntangent = [1, 0, 0]\naxis = [0, 1, 0]",
                "[0, 1, 0]",
            ),
            ("map = -1\nmaterial = \"matte\"", "-1"),
        ] {
            let error = normal_map(text).err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], place);
        }
    }
}
