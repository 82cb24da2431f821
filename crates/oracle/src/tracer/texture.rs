//! Section 10, and the texture coordinates of section 9.

use serde::Deserialize;
use std::f64::consts::{PI, TAU};
use whitstone_core::config::{Color, PluginRef, TextureRef, TextureValue, decode};
use whitstone_core::{DVec2, DVec3, Rgb, SceneError, SceneErrors};
use whitstone_scene::{Description, PluginTable};

/// A colour parameter.
pub(super) enum Texture {
    Constant(Rgb),
    Checker {
        a: Rgb,
        b: Rgb,
        scale: DVec2,
        offset: DVec2,
    },
}

/// A number or two.
#[derive(Clone, Copy, Deserialize)]
#[serde(untagged)]
enum Pair {
    One(f64),
    Two([f64; 2]),
}

impl Pair {
    fn get(self) -> DVec2 {
        match self {
            Self::One(both) => DVec2::splat(both),
            Self::Two(pair) => pair.into(),
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Checker {
    a: Option<Color>,
    b: Option<Color>,
    scale: Option<Pair>,
    offset: Option<Pair>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Constant {
    value: Color,
}

/// The table of a material or texture that is named or written where it is used.
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
    /// `kind` is the shape that it lies on.
    pub(super) fn new(
        description: &Description<'_>,
        reference: &TextureRef,
        kind: &str,
    ) -> Result<Self, SceneErrors> {
        let unknown = |what: String| {
            let span = reference.span.clone().unwrap_or_default();
            SceneErrors::from(SceneError::at(span, format!("the oracle does not know {what}")))
        };
        let plugin = match &reference.value {
            TextureValue::Constant(color) => return Ok(Self::Constant(*color)),
            TextureValue::Plugin(plugin) => table(description, &description.textures, plugin),
        };
        let plugin = plugin.ok_or_else(|| unknown("this texture".to_owned()))?;
        match &*plugin.name {
            "constant" => Ok(Self::Constant(decode::<Constant>(&plugin.table)?.value.get())),
            "checker" if has_uv(kind) => {
                let Checker { a, b, scale, offset } =
                    decode(&plugin.table).map_err(|_| unknown("where this texture lies".to_owned()))?;
                Ok(Self::Checker {
                    a: a.map_or(Rgb::splat(0.8), Color::get),
                    b: b.map_or(Rgb::splat(0.2), Color::get),
                    scale: scale.map_or(DVec2::ONE, Pair::get),
                    offset: offset.map_or(DVec2::ZERO, Pair::get),
                })
            }
            "checker" => Err(unknown(format!("the texture coordinates of \"{kind}\""))),
            other => Err(unknown(format!("the texture \"{other}\""))),
        }
    }

    pub(super) fn at(&self, uv: DVec2) -> Rgb {
        match self {
            Self::Constant(color) => *color,
            Self::Checker { a, b, scale, offset } => {
                let cell = (uv * *scale + *offset).floor();
                if (cell.x + cell.y).rem_euclid(2.0) == 0.0 {
                    *a
                } else {
                    *b
                }
            }
        }
    }
}

/// Shapes whose texture coordinates are in [`uv_of`].
fn has_uv(kind: &str) -> bool {
    ["sphere", "plane", "rectangle", "disk", "box"].contains(&kind)
}

/// Texture coordinates of a point in object space; of a sphere the point must be relative to its centre.
pub(super) fn uv_of(kind: &str, p: DVec3, primitive: u32) -> DVec2 {
    let around = {
        let phi = p.y.atan2(p.x);
        (if phi < 0.0 { phi + TAU } else { phi }) / TAU
    };
    match kind {
        "sphere" => {
            let theta = p.x.hypot(p.y).atan2(p.z);
            DVec2::new(around, (PI - theta) / PI)
        }
        "plane" => DVec2::new(p.x, p.y),
        "rectangle" => DVec2::new(0.5 * (p.x + 1.0), 0.5 * (p.y + 1.0)),
        "disk" => DVec2::new(p.x.hypot(p.y), around),
        "box" => {
            let axis = (primitive / 2) as usize;
            let [b, c] = [(axis + 1) % 3, (axis + 2) % 3].map(|k| 0.5 * (p[k] + 1.0));
            DVec2::new(b, c)
        }
        _ => DVec2::ZERO,
    }
}
