//! Textures of materials: an image, its sampler and its transform.

use super::import::{Importer, shortest};
use crate::document::{table, transform};
use toml::{Table, Value};
use whitstone_core::{DAffine3, DMat3, DVec3, FormatError};
use whitstone_gltf::Document;
use whitstone_gltf::json::extensions::texture::TextureTransform;
use whitstone_gltf::json::texture::{MagFilter, MinFilter, WrappingMode};
use whitstone_gltf::json::validation::Checked;

/// What the reader puts in the place of a missing `source`.
const NO_IMAGE: usize = u32::MAX as usize;

/// A reference to a texture in a material.
pub(crate) struct TextureUse {
    /// Index of the texture.
    pub(crate) texture: usize,
    /// Set of texture coordinates.
    pub(crate) tex_coord: u32,
    pub(crate) transform: Option<TextureTransform>,
    /// JSON pointer of the reference.
    pub(crate) pointer: String,
}

impl TextureUse {
    /// The set of texture coordinates, which the extension may replace.
    pub(crate) fn set(&self) -> u32 {
        self.transform
            .as_ref()
            .and_then(|transform| transform.tex_coord)
            .unwrap_or(self.tex_coord)
    }
}

impl Importer<'_> {
    /// The id of the shared texture for a channel of a texture. `sets` are the sets of texture
    /// coordinates that the material uses; none if the texture's set is not among them.
    pub(crate) fn texture(
        &mut self,
        used: &TextureUse,
        channel: &str,
        color_space: Option<&str>,
        sets: &[u32],
    ) -> Result<Option<Value>, FormatError> {
        let root = &self.document.root;
        let pointer = || format!("{}/index", used.pointer);
        let texture =
            Document::item(&root.textures, used.texture, "textures", pointer).map_err(self.told())?;
        let Some(place) = sets.iter().position(|set| *set == used.set()) else {
            self.note("third texture coordinates", &used.pointer);
            return Ok(None);
        };
        let webp = texture
            .extensions
            .as_ref()
            .and_then(|extensions| extensions.others.get("EXT_texture_webp"))
            .and_then(|webp| webp.get("source"))
            .and_then(serde_json_index);
        let source = webp.unwrap_or(texture.source.value());
        if source == NO_IMAGE {
            self.note(
                "textures without an image",
                &format!("/textures/{}", used.texture),
            );
            return Ok(None);
        }
        let pointer = || format!("/textures/{}/source", used.texture);
        Document::item(&root.images, source, "images", pointer).map_err(self.told())?;

        if let Some(file) = self.document.image_file(source)
            && let Err(error) = self.document.folder().join(&file).metadata()
        {
            let message = format!("cannot read \"{}\": {error}", file.display());
            return Err(FormatError::at(format!("/images/{source}/uri"), message));
        }
        let mut keys = table([("type", Value::String("image".into()))]);
        match self.document.image_file(source) {
            // Alpha is 1 in an image without it, which only the rule for glTF says.
            Some(file) if channel != "alpha" => {
                let file = file.to_string_lossy().replace('\\', "/");
                keys.insert("file".into(), Value::String(file));
            }
            _ => {
                keys.insert("file".into(), Value::String(self.file.clone()));
                keys.insert("image".into(), Value::Integer(source as i64));
            }
        }
        if channel != "color" {
            keys.insert("channel".into(), Value::String(channel.into()));
        }
        if let Some(space) = color_space {
            keys.insert("color_space".into(), Value::String(space.into()));
        }
        let sampler = match texture.sampler {
            None => None,
            Some(sampler) => {
                let pointer = || format!("/textures/{}/sampler", used.texture);
                let list = &root.samplers;
                Some(Document::item(list, sampler.value(), "samplers", pointer).map_err(self.told())?)
            }
        };
        if let Some(sampler) = sampler {
            let place = texture.sampler.map_or(0, |sampler| sampler.value());
            let place = format!("/samplers/{place}");
            let wraps = [&sampler.wrap_s, &sampler.wrap_t].map(|mode| match mode {
                Checked::Valid(WrappingMode::ClampToEdge) => "clamp",
                Checked::Valid(WrappingMode::MirroredRepeat) => "mirror",
                Checked::Valid(WrappingMode::Repeat) | Checked::Invalid => "repeat",
            });
            if wraps != ["repeat", "repeat"] {
                let wraps = wraps.map(|wrap| Value::String(wrap.into()));
                keys.insert("wrap".into(), Value::Array(wraps.to_vec()));
            }
            let valid = |filter: Option<Checked<MinFilter>>| match filter {
                Some(Checked::Valid(filter)) => Some(filter),
                _ => None,
            };
            let nearest = matches!(sampler.mag_filter, Some(Checked::Valid(MagFilter::Nearest)));
            let min = valid(sampler.min_filter);
            let filter = match min {
                _ if nearest => Some("nearest"),
                Some(
                    MinFilter::NearestMipmapNearest
                    | MinFilter::LinearMipmapNearest
                    | MinFilter::NearestMipmapLinear
                    | MinFilter::LinearMipmapLinear,
                ) => Some("trilinear"),
                Some(MinFilter::Nearest | MinFilter::Linear) | None => None,
            };
            match (nearest, min) {
                (_, None) | (true, Some(MinFilter::Nearest)) | (false, Some(MinFilter::Linear)) => {}
                (false, Some(MinFilter::Nearest)) | (true, Some(_)) => {
                    self.note("filters that differ", &place);
                }
                (false, Some(_)) => self.note("mip maps", &place),
            }
            if let Some(filter) = filter {
                keys.insert("filter".into(), Value::String(filter.into()));
            }
        }
        let mut mapping = Table::new();
        if place == 1 {
            mapping.insert("uv_set".into(), Value::Integer(1));
        }
        if let Some(map) = used.transform.as_ref().map(texture_map)
            && map != DAffine3::IDENTITY
        {
            if !map.is_finite() {
                let message = "the transform of the texture is not finite";
                return Err(FormatError::at(
                    format!("{}/extensions/KHR_texture_transform", used.pointer),
                    message,
                ));
            }
            mapping.insert("transform".into(), transform(&map));
        }
        if !mapping.is_empty() {
            mapping.insert("projection".into(), Value::String("uv".into()));
            keys.insert("mapping".into(), Value::Table(mapping));
        }
        let name = texture
            .name
            .clone()
            .or_else(|| root.images[source].name.clone())
            .unwrap_or_else(|| format!("texture{}", used.texture));
        Ok(Some(self.shared_texture(&name, keys)))
    }
}

/// An index in the JSON of an extension.
fn serde_json_index(value: &whitstone_gltf::json::Value) -> Option<usize> {
    value.as_u64().and_then(|index| usize::try_from(index).ok())
}

/// The transform of texture coordinates with v up.
///
/// In the file, with v down: offset, times rotation, times scale. The rotation is the one of the
/// Khronos sample renderer: counter-clockwise on the screen.
fn texture_map(given: &TextureTransform) -> DAffine3 {
    let [x, y] = given.offset.0.map(shortest);
    let [sx, sy] = given.scale.0.map(shortest).map(not_zero);
    let (sin, cos) = libm::sincos(shortest(given.rotation.0));
    let linear = DMat3::from_cols(
        DVec3::new(cos * sx, -sin * sx, 0.0),
        DVec3::new(sin * sy, cos * sy, 0.0),
        DVec3::Z,
    );
    let down = DAffine3::from_mat3_translation(linear, DVec3::new(x, y, 0.0));
    let flip = DAffine3::from_mat3_translation(
        DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0)),
        DVec3::new(0.0, 1.0, 0.0),
    );
    flip * down * flip
}

/// Replaces a scale near 0 by 1e-6, so that the transform can be inverted. All points then still
/// show one texel.
fn not_zero(scale: f64) -> f64 {
    let least = 1e-6;
    if scale.abs() < least {
        least.copysign(scale)
    } else {
        scale
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_of_zero_shows_one_texel() {
        let text = "{\"offset\": [0.5, 0.25], \"scale\": [0, 0], \"rotation\": 1}";
        let map = texture_map(&whitstone_gltf::json::deserialize::from_str(text).unwrap());
        assert!(map.inverse().is_finite());
        for corner in [DVec3::ZERO, DVec3::ONE] {
            let found = map.transform_point3(corner);
            let from = found - DVec3::new(0.5, 0.75, corner.z);
            assert!(from.abs().max_element() < 1e-5, "{found}");
        }
    }

    #[test]
    fn offset_and_scale_count_from_the_top() {
        let given: TextureTransform =
            whitstone_gltf::json::deserialize::from_str("{\"offset\": [0.5, 0.25], \"scale\": [0.5, 0.5]}")
                .unwrap();
        let map = texture_map(&given);
        // The top left corner of the mesh shows (0.5, 0.25) from the top left of the image.
        let found = map.transform_point3(DVec3::new(0.0, 1.0, 0.0));
        assert!(found.abs_diff_eq(DVec3::new(0.5, 0.75, 0.0), 1e-15), "{found}");
        let found = map.transform_point3(DVec3::new(1.0, 0.0, 0.0));
        assert!(found.abs_diff_eq(DVec3::new(1.0, 0.25, 0.0), 1e-15), "{found}");
    }
}
