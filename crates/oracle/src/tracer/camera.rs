//! Section 4.

use super::{unknown, unknown_part};
use serde::Deserialize;
use whitstone_core::config::decode;
use whitstone_core::{DVec3, Ray, SceneErrors};
use whitstone_scene::{FilmTable, PluginTable};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LookAt {
    origin: [f64; 3],
    target: [f64; 3],
    #[serde(default = "y")]
    up: [f64; 3],
}

fn y() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Window {
    l: f64,
    r: f64,
    b: f64,
    t: f64,
    #[serde(default = "one")]
    d: f64,
}

fn one() -> f64 {
    1.0
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Config {
    look_at: LookAt,
    fov: Option<f64>,
    fov_axis: Option<String>,
    width: Option<f64>,
    window: Option<Window>,
    near: Option<f64>,
    #[serde(rename = "near_kind")]
    _near_kind: Option<String>,
}

/// Perspective or orthographic.
pub(super) struct Camera {
    origin: DVec3,
    axes: [DVec3; 3],
    window: Window,
    size: [f64; 2],
    parallel: bool,
}

impl Camera {
    pub(super) fn new(plugin: &PluginTable<'_>, film: &FilmTable) -> Result<Self, SceneErrors> {
        let parallel = match &*plugin.name {
            "perspective" => false,
            "orthographic" => true,
            _ => return Err(unknown(plugin, "camera")),
        };
        let config: Config = decode(&plugin.table)?;
        if config.near.is_some_and(|near| near != 0.0) {
            return Err(unknown_part(plugin, "near limits"));
        }
        let [origin, target, up] =
            [config.look_at.origin, config.look_at.target, config.look_at.up].map(DVec3::from_array);
        let w = (origin - target).normalize();
        let u = up.cross(w).normalize();
        let size = [f64::from(film.size.width), f64::from(film.size.height)];
        let [width, height] = size;
        let window = config.window.unwrap_or_else(|| {
            let (across, along) = if parallel {
                (0.5 * config.width.unwrap_or(2.0), width)
            } else {
                let axis = config.fov_axis.as_deref().unwrap_or("x");
                let by_x = match axis {
                    "y" => false,
                    "smaller" => width <= height,
                    "larger" => width >= height,
                    _ => true,
                };
                let half = 0.5 * config.fov.unwrap_or(45.0).to_radians();
                (half.tan(), if by_x { width } else { height })
            };
            let [r, t] = size.map(|side| across * side / along);
            Window {
                l: -r,
                r,
                b: -t,
                t,
                d: 1.0,
            }
        });
        Ok(Self {
            origin,
            axes: [u, w.cross(u), w],
            window,
            size,
            parallel,
        })
    }

    /// Through raster coordinates.
    pub(super) fn ray(&self, [x, y]: [f64; 2]) -> Ray {
        let Window { l, r, b, t, d } = self.window;
        let [u, v, w] = self.axes;
        let across = u * (l + (r - l) * x / self.size[0]) + v * (t - (t - b) * y / self.size[1]);
        if self.parallel {
            Ray {
                origin: self.origin + across,
                direction: -w,
            }
        } else {
            Ray {
                origin: self.origin,
                direction: (across - w * d).normalize(),
            }
        }
    }
}
