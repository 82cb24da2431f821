//! Colours and textures of a scene: section 10 of the model.

use super::mapping::{Mapping, Place, Projection, TextureFunction};
use super::noise::{Noise, NoiseConfig, Worley, WorleyConfig};
use super::pattern::{
    Checker, CheckerConfig, Lines, LinesConfig, Picture, PictureConfig, Voxels, VoxelsConfig,
};
use super::repeated::{Cubes, CubesConfig, Layers, LayersConfig, Ramp, RampConfig};
use super::synthesized::{SynthesizedConfig, synthesized};
use serde::Deserialize;
use whitstone_core::config::{Color, PluginRef, TextureRef, TextureValue, decode};
use whitstone_core::{DVec3, Rgb, SceneError, SceneErrors};
use whitstone_scene::{Description, PluginTable};

/// A colour parameter: constant or textured.
pub(super) enum Texture {
    Constant(Rgb),
    Mapped(Mapping, Box<dyn TextureFunction>),
    Product(Vec<Texture>),
    /// Two colours and the weight of the second one.
    Mix(Box<[Texture; 3]>),
    Threshold(Box<Texture>, f64),
    VertexColor,
    VertexAlpha,
}

/// Upper bound on the nesting of textures.
const MAX_NESTING: u32 = 16;

/// Relative error of the input of a threshold up to which the result is undecided.
const NEAR_THRESHOLD: f64 = 1e-5;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Product {
    factors: Vec<TextureRef>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Mix {
    a: TextureRef,
    b: TextureRef,
    weight: Option<TextureRef>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Threshold {
    input: TextureRef,
    at: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct VertexColor {
    channel: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Constant {
    value: Color,
}

/// The table of a material or texture, either named or inline.
pub(super) fn table<'a, 's>(
    description: &'a Description<'s>,
    shared: &'a std::collections::BTreeMap<String, PluginTable<'s>>,
    reference: &PluginRef,
) -> Option<&'a PluginTable<'s>> {
    match reference {
        PluginRef::Shared(id) => shared.get(id),
        PluginRef::Inline(number) => description.inline.get(*number),
    }
}

impl Texture {
    /// Columns and rows, if it is an image.
    pub(super) fn size(&self) -> Option<[usize; 2]> {
        match self {
            Self::Mapped(_, pattern) => pattern.size(),
            _ => None,
        }
    }

    pub(super) fn new(description: &Description<'_>, reference: &TextureRef) -> Result<Self, SceneErrors> {
        Self::nested(description, reference, 0)
    }

    fn nested(
        description: &Description<'_>,
        reference: &TextureRef,
        depth: u32,
    ) -> Result<Self, SceneErrors> {
        let unknown = |what: String| {
            let span = reference.span.clone().unwrap_or_default();
            SceneErrors::from(SceneError::at(
                span,
                format!("the oracle does not support {what}"),
            ))
        };
        let plugin = match &reference.value {
            TextureValue::Constant(color) => return Ok(Self::Constant(*color)),
            TextureValue::Plugin(plugin) => table(description, &description.textures, plugin),
        };
        let plugin = plugin.ok_or_else(|| unknown("this texture".to_owned()))?;
        if depth > MAX_NESTING {
            return Err(unknown("textures nested this deep".to_owned()));
        }
        let inner = |reference: &TextureRef| Self::nested(description, reference, depth + 1);
        let keys = &plugin.table;
        let (mapping, pattern): (Mapping, Box<dyn TextureFunction>) = match &*plugin.name {
            "constant" => return Ok(Self::Constant(decode::<Constant>(keys)?.value.get())),
            "product" => {
                let factors = decode::<Product>(keys)?.factors;
                return Ok(Self::Product(
                    factors.iter().map(inner).collect::<Result<_, _>>()?,
                ));
            }
            "mix" => {
                let mix: Mix = decode(keys)?;
                let weight = mix.weight.unwrap_or(TextureRef::grey(0.5));
                return Ok(Self::Mix(Box::new([
                    inner(&mix.a)?,
                    inner(&mix.b)?,
                    inner(&weight)?,
                ])));
            }
            "threshold" => {
                let threshold: Threshold = decode(keys)?;
                let input = Box::new(inner(&threshold.input)?);
                return Ok(Self::Threshold(input, threshold.at.unwrap_or(0.5)));
            }
            "vertex_color" => {
                let channel = decode::<VertexColor>(keys)?.channel;
                return match channel.as_deref() {
                    None | Some("color") => Ok(Self::VertexColor),
                    Some("alpha") => Ok(Self::VertexAlpha),
                    Some(other) => Err(unknown(format!("the channel \"{other}\" of vertex colours"))),
                };
            }
            "checker" => {
                let mut config: CheckerConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Uv).map_err(unknown)?;
                (mapping, Box::new(Checker::new(&config)))
            }
            "grid_lines" => {
                let mut config: LinesConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Uv).map_err(unknown)?;
                (mapping, Box::new(Lines::new(&config)))
            }
            "checker3d" => {
                let mut config: CubesConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Solid).map_err(unknown)?;
                (mapping, Box::new(Cubes::new(&config)))
            }
            "stripes" | "rings" => {
                let mut config: LayersConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Solid).map_err(unknown)?;
                (mapping, Box::new(Layers::new(&config, &*plugin.name == "rings")))
            }
            "gradient" => {
                let mut config: RampConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Solid).map_err(unknown)?;
                (mapping, Box::new(Ramp::new(config)))
            }
            "image" => {
                let mut config: PictureConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Uv).map_err(unknown)?;
                let picture = Picture::new(&config, description.sources).map_err(unknown)?;
                (mapping, Box::new(picture))
            }
            "synthesized" => {
                let mut config: SynthesizedConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Uv).map_err(unknown)?;
                let picture = synthesized(&config, description.sources).map_err(unknown)?;
                (mapping, Box::new(picture))
            }
            "solid" => {
                let mut config: VoxelsConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Solid).map_err(unknown)?;
                let voxels = Voxels::new(config, description.sources).map_err(unknown)?;
                (mapping, Box::new(voxels))
            }
            "noise" => {
                let mut config: NoiseConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Solid).map_err(unknown)?;
                (mapping, Box::new(Noise::new(&config)))
            }
            "worley" => {
                let mut config: WorleyConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Solid).map_err(unknown)?;
                (mapping, Box::new(Worley::new(&config)))
            }
            other => return Err(unknown(format!("the texture \"{other}\""))),
        };
        Ok(Self::Mapped(mapping, pattern))
    }

    pub(super) fn at(&self, spot: &Place) -> Rgb {
        match self {
            Self::Constant(color) => *color,
            Self::Mapped(mapping, pattern) => mapping.look(&**pattern, spot),
            Self::Product(factors) => {
                let colors = factors.iter().map(|factor| factor.at(spot));
                colors.fold(Rgb::splat(1.0), |product, color| product * color)
            }
            Self::Mix(three) => {
                let [a, b, w] = three.each_ref().map(|texture| texture.at(spot));
                a * w.map(|w| 1.0 - w) + b * w
            }
            Self::Threshold(input, limit) => {
                let nudge = if input.is_constant() { 0.0 } else { spot.nudge };
                input.at(spot).map(|x| step(x, *limit, nudge))
            }
            Self::VertexColor => Rgb::from([spot.color[0], spot.color[1], spot.color[2]]),
            Self::VertexAlpha => Rgb::splat(spot.color[3]),
        }
    }

    /// Whether its value is a colour of the scene, or computed from such colours.
    fn is_constant(&self) -> bool {
        match self {
            Self::Constant(_) => true,
            Self::Product(factors) => factors.iter().all(Self::is_constant),
            Self::Mix(three) => three.iter().all(Self::is_constant),
            Self::Threshold(input, _) => input.is_constant(),
            _ => false,
        }
    }

    /// Whether it is known to be black everywhere.
    pub(super) fn is_black(&self) -> bool {
        matches!(self, Self::Constant(color) if *color == Rgb::splat(0.0))
    }
}

/// 1 if x is at least the limit, else 0. In single precision, renderers compute x with an error:
/// `nudge` is -1 or 1 to get the value on each side of it, else 0. They compute an x of 0 exactly.
fn step(x: f64, limit: f64, nudge: f64) -> f64 {
    let x = if x == 0.0 {
        x
    } else {
        (x + nudge * NEAR_THRESHOLD * x.max(1.0)).max(0.0)
    };
    if x as f32 >= limit as f32 { 1.0 } else { 0.0 }
}

/// The texture of a displacement map or a height field.
pub(crate) struct VertexTexture(Texture);

impl VertexTexture {
    pub(crate) fn new(description: &Description<'_>, reference: &TextureRef) -> Result<Self, SceneErrors> {
        Texture::new(description, reference).map(Self)
    }

    /// The colour at a point of the mesh, with its normal and the texture coordinates of a vertex.
    pub(crate) fn at(&self, p: DVec3, n: DVec3, uv: [f64; 2]) -> [f64; 3] {
        let place = Place {
            uv: uv.into(),
            p,
            n_s: n,
            ..Place::default()
        };
        self.0.at(&place).to_array()
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::{pixel, seen, shows};
    use crate::tracer::Value;

    /// A rectangle from -1 to 1 with this texture.
    fn rectangle(texture: &str) -> String {
        format!(
            "[[shape]]\ntype = \"rectangle\"\n\
            material = {{ type = \"matte\", reflectance = {texture} }}\n"
        )
    }

    /// Grows from 0 at x = -1 to 1 at x = 1.
    const RAMP: &str = "{ type = \"gradient\", scale = 0.5, offset = 0.5, a = 0, b = 1 }";

    #[test]
    fn products_and_mixes() {
        let product = format!("{{ type = \"product\", factors = [{RAMP}, [0.5, 1, 0.25], 0.5] }}");
        shows([0.5, 0.1], &rectangle(&product), &[], [0.1875, 0.375, 0.09375]);
        let mix = format!("{{ type = \"mix\", a = [1, 0, 0.5], b = 0.5, weight = {RAMP} }}");
        shows([-0.5, 0.1], &rectangle(&mix), &[], [0.875, 0.125, 0.5]);
        let half = "{ type = \"mix\", a = 1, b = 0.5 }";
        shows([-0.5, 0.1], &rectangle(half), &[], [0.75; 3]);
        let deep = (0..20).fold(RAMP.to_owned(), |inner, _| {
            format!("{{ type = \"product\", factors = [{inner}] }}")
        });
        assert!(pixel([0.0; 2], &rectangle(&deep), &[]).is_err());
    }

    #[test]
    fn thresholds_are_undecided_at_the_limit_only() {
        let threshold = |input: &str, at: f64| {
            rectangle(&format!(
                "{{ type = \"threshold\", input = {input}, at = {at:?} }}"
            ))
        };
        shows([0.5, 0.1], &threshold(RAMP, 0.74), &[], [1.0; 3]);
        shows([0.5, 0.1], &threshold(RAMP, 0.76), &[], [0.0; 3]);
        match pixel([0.5, 0.1], &threshold(RAMP, 0.75), &[]).unwrap() {
            Value::Known {
                uncertainty, seen, ..
            } => {
                assert!(uncertainty[0] >= 1.0);
                assert!(seen.contains(&[0.0; 3]) && seen.contains(&[1.0; 3]));
            }
            value @ Value::Unknown(_) => panic!("{value:?}"),
        }
        // Colours of the scene are exact, and so is 0.
        shows(
            [0.5, 0.1],
            &threshold("[0.5, 0.4999, 0.6]", 0.5),
            &[],
            [1.0, 0.0, 1.0],
        );
        let product = "{ type = \"product\", factors = [0.3, 0.5] }";
        shows([0.5, 0.1], &threshold(product, 0.15), &[], [1.0; 3]);
        let nothing = format!("{{ type = \"product\", factors = [{RAMP}, 0] }}");
        shows([0.5, 0.1], &threshold(&nothing, 0.0), &[], [1.0; 3]);
        shows([0.5, 0.1], &threshold(&nothing, 1e-6), &[], [0.0; 3]);
    }

    #[test]
    fn shapes_without_vertex_colors_are_white() {
        for channel in ["color", "alpha"] {
            let texture = format!("{{ type = \"vertex_color\", channel = \"{channel}\" }}");
            shows([0.5, 0.1], &rectangle(&texture), &[], [1.0; 3]);
        }
        let other = rectangle("{ type = \"vertex_color\", channel = \"red\" }");
        assert!(pixel([0.0; 2], &other, &[]).is_err());
    }

    /// Two texels: (255, 0, 51) and (0, 255, 102).
    const RGB: &str =
        "iVBORw0KGgoAAAANSUhEUgAAAAIAAAABCAIAAAB7QOjdAAAAD0lEQVR42mP4z2DM8D8NAAkxAphEFLRxAAAAAElFTkSuQmCC";
    /// The same with the alphas 128 and 0.
    const RGBA: &str = "iVBORw0KGgoAAAANSUhEUgAAAAIAAAABCAYAAAD0In+KAAAAEUlEQVR42mP4z2DcwPA/jQEAD3wDGCBxRP4AAAAASUVORK5CYII=";

    #[test]
    fn images_in_gltf_and_their_channels() {
        let json = format!(
            r#"{{ "asset": {{ "version": "2.0" }}, "images": [
                {{ "uri": "data:image/png;base64,{RGB}" }},
                {{ "uri": "data:image/png;base64,{RGBA}" }}, {{ "uri": "an%20image.png" }} ] }}"#
        );
        let png = {
            use base64::Engine as _;
            base64::engine::general_purpose::STANDARD.decode(RGB).unwrap()
        };
        // The same image in the binary chunk of a .glb file.
        let inner = format!(
            r#"{{ "asset": {{ "version": "2.0" }}, "buffers": [{{ "byteLength": {0} }}],
                "bufferViews": [{{ "buffer": 0, "byteOffset": 3, "byteLength": {1} }}],
                "images": [{{ "bufferView": 0, "mimeType": "image/png" }}] }}"#,
            png.len() + 3,
            png.len()
        );
        let mut binary = vec![0; 3];
        binary.extend_from_slice(&png);
        let glb = crate::testing::glb(&inner, &binary);
        let files = [
            ("i.gltf", json.as_bytes()),
            ("i.glb", &*glb),
            ("an image.png", &*png),
        ];
        let image = |keys: &str| rectangle(&format!("{{ type = \"image\", filter = \"nearest\", {keys} }}"));
        let gltf = |keys: &str| image(&format!("file = \"i.gltf\", {keys}"));
        let (left, right) = ([-0.5, 0.1], [0.5, 0.1]);
        let code = |code: f64| ((code / 255.0 + 0.055) / 1.055_f64).powf(2.4);
        shows(left, &gltf("image = 0"), &files, [1.0, 0.0, code(51.0)]);
        shows(right, &gltf("image = 2"), &files, [0.0, 1.0, code(102.0)]);
        shows(right, &image("file = \"i.glb\""), &files, [0.0, 1.0, code(102.0)]);
        let linear = "image = 1, color_space = \"linear\"";
        shows(left, &gltf(linear), &files, [1.0, 0.0, 0.2]);
        shows(
            left,
            &gltf(&format!("{linear}, channel = \"red\"")),
            &files,
            [1.0; 3],
        );
        shows(
            left,
            &gltf(&format!("{linear}, channel = \"green\"")),
            &files,
            [0.0; 3],
        );
        shows(
            left,
            &gltf(&format!("{linear}, channel = \"blue\"")),
            &files,
            [0.2; 3],
        );
        shows(right, &gltf("channel = \"blue\""), &files, [code(102.0); 3]);
        shows(
            left,
            &gltf("image = 1, channel = \"alpha\""),
            &files,
            [128.0 / 255.0; 3],
        );
        shows(left, &gltf("image = 0, channel = \"alpha\""), &files, [1.0; 3]);
        assert!(pixel(left, &gltf("image = 3"), &files).is_err());
        assert!(pixel(left, &image("file = \"an image.png\", image = 0"), &files).is_err());
        assert!(
            pixel(
                left,
                &image("file = \"an image.png\", channel = \"grey\""),
                &files
            )
            .is_err()
        );
        assert_eq!(seen([3.0, 0.0], &gltf("image = 0"), &files), Some([0.0; 3]));
    }
}
