//! Colours and textures of a scene: section 10 of the model.

use super::footprint::Footprint;
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
            Self::Constant(_) => None,
            Self::Mapped(_, pattern) => pattern.size(),
        }
    }

    pub(super) fn new(description: &Description<'_>, reference: &TextureRef) -> Result<Self, SceneErrors> {
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
        let keys = &plugin.table;
        let (mapping, pattern): (Mapping, Box<dyn TextureFunction>) = match &*plugin.name {
            "constant" => return Ok(Self::Constant(decode::<Constant>(keys)?.value.get())),
            "checker" => {
                let mut config: CheckerConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Uv);
                (mapping, Box::new(Checker::new(&config)))
            }
            "grid_lines" => {
                let mut config: LinesConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Uv);
                (mapping, Box::new(Lines::new(&config)))
            }
            "checker3d" => {
                let mut config: CubesConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Solid);
                (mapping, Box::new(Cubes::new(&config)))
            }
            "stripes" | "rings" => {
                let mut config: LayersConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Solid);
                (mapping, Box::new(Layers::new(&config, &*plugin.name == "rings")))
            }
            "gradient" => {
                let mut config: RampConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Solid);
                (mapping, Box::new(Ramp::new(config)))
            }
            "image" => {
                let mut config: PictureConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Uv);
                let picture = Picture::new(&config, description.sources.base()).map_err(unknown)?;
                (mapping, Box::new(picture))
            }
            "synthesized" => {
                let mut config: SynthesizedConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Uv);
                let picture = synthesized(&config, description.sources.base()).map_err(unknown)?;
                (mapping, Box::new(picture))
            }
            "solid" => {
                let mut config: VoxelsConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Solid);
                let voxels = Voxels::new(config, description.sources.base()).map_err(unknown)?;
                (mapping, Box::new(voxels))
            }
            "noise" => {
                let mut config: NoiseConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Solid);
                (mapping, Box::new(Noise::new(&config)))
            }
            "worley" => {
                let mut config: WorleyConfig = decode(keys)?;
                let mapping = Mapping::new(config.mapping.take(), Projection::Solid);
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
        }
    }

    /// Whether it is known to be black everywhere.
    pub(super) fn is_black(&self) -> bool {
        matches!(self, Self::Constant(color) if *color == Rgb::splat(0.0))
    }
}

/// The texture of a displacement map.
pub(crate) struct Height(Texture);

impl Height {
    pub(crate) fn new(description: &Description<'_>, reference: &TextureRef) -> Result<Self, SceneErrors> {
        Texture::new(description, reference).map(Self)
    }

    /// The height at a point of the mesh, with its normal and the texture coordinates of a vertex.
    pub(crate) fn at(&self, p: DVec3, n: DVec3, uv: [f64; 2]) -> f64 {
        let place = Place {
            uv: uv.into(),
            p,
            n_s: n,
            footprint: Footprint::default(),
        };
        self.0.at(&place).to_array()[0]
    }
}
