//! Cameras: section 4 of the model.

use super::unknown;
use crate::vector::unit_and_length;
use serde::Deserialize;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};
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
    near_kind: Option<String>,
    aperture: Option<f64>,
    focus_distance: Option<f64>,
    lens_samples: Option<u32>,
}

enum Kind {
    Perspective,
    Orthographic,
    Environment,
    /// The focus distance, and the lens samples in metres along u and v.
    Lens(f64, Vec<[f64; 2]>),
}

/// Origins and directions of camera rays.
pub(super) struct Camera {
    kind: Kind,
    origin: DVec3,
    axes: [DVec3; 3],
    window: Window,
    size: [f64; 2],
    near: f64,
    spherical: bool,
}

impl Camera {
    pub(super) fn new(plugin: &PluginTable<'_>, film: &FilmTable) -> Result<Self, SceneErrors> {
        let config: Config = decode(&plugin.table)?;
        let kind = match &*plugin.name {
            "perspective" => Kind::Perspective,
            "orthographic" => Kind::Orthographic,
            "environment" => Kind::Environment,
            "thin_lens" => Kind::Lens(
                config.focus_distance.unwrap_or(1.0),
                lens(config.aperture.unwrap_or(0.0), config.lens_samples.unwrap_or(4)),
            ),
            _ => return Err(unknown(plugin, "camera")),
        };
        let parallel = matches!(kind, Kind::Orthographic);
        let [origin, target, up] =
            [config.look_at.origin, config.look_at.target, config.look_at.up].map(DVec3::from_array);
        let w = unit(origin - target);
        let u = unit(unit(up).cross(w));
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
            kind,
            origin,
            axes: [u, w.cross(u), w],
            window,
            size,
            near: config.near.unwrap_or(0.0),
            spherical: config.near_kind.as_deref() == Some("spherical"),
        })
    }

    /// Camera rays through a raster position: one, or one for each lens sample.
    pub(super) fn rays(&self, [x, y]: [f64; 2]) -> Vec<Ray> {
        let Window { l, r, b, t, d } = self.window;
        let [u, v, w] = self.axes;
        let across = u * (l + (r - l) * x / self.size[0]) + v * (t - (t - b) * y / self.size[1]);
        let begun = |origin: DVec3, direction: DVec3| Ray {
            origin: origin + direction * self.start(direction),
            direction,
        };
        match &self.kind {
            Kind::Orthographic => vec![begun(self.origin + across, -w)],
            Kind::Perspective => vec![begun(self.origin, unit(across - w * d))],
            Kind::Environment => {
                let phi = PI * (2.0 * x / self.size[0] - 1.0);
                let theta = PI * (0.5 - y / self.size[1]);
                let level = u * phi.sin() - w * phi.cos();
                vec![Ray {
                    origin: self.origin,
                    direction: (level * theta.cos() + v * theta.sin()).normalize(),
                }]
            }
            Kind::Lens(focus, points) => {
                let sharp = across - w * d;
                let through = points.iter().map(|[a, b]| {
                    let offset = u * *a + v * *b;
                    // Towards the point in focus. The factor that would overflow is not used.
                    let direction = match *focus > d {
                        true => sharp - offset * (d / focus),
                        false => sharp * (focus / d) - offset,
                    };
                    Ray {
                        origin: self.origin + offset,
                        direction: unit(direction),
                    }
                });
                through.collect()
            }
        }
    }

    /// The distance along the ray at which it starts (near limit).
    fn start(&self, direction: DVec3) -> f64 {
        if self.near == 0.0 {
            0.0
        } else if self.spherical {
            self.near
        } else {
            self.near / -direction.dot(self.axes[2])
        }
    }
}

fn unit(v: DVec3) -> DVec3 {
    unit_and_length(v).0
}

/// Lens samples, mapped to the disk by the concentric map of Shirley and Chiu 1997.
pub(super) fn lens(aperture: f64, n: u32) -> Vec<[f64; 2]> {
    let at = |k: u32| 2.0 * (f64::from(k) + 0.5) / f64::from(n) - 1.0;
    let point = |index: u32| {
        let (p, q) = (at(index % n), at(index / n));
        let (s, phi) = if p == 0.0 && q == 0.0 {
            (0.0, 0.0)
        } else if p.abs() > q.abs() {
            (p, FRAC_PI_4 * (q / p))
        } else {
            (q, FRAC_PI_2 - FRAC_PI_4 * (p / q))
        };
        [aperture * s * phi.cos(), aperture * s * phi.sin()]
    };
    (0..n * n).map(point).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_of_extreme_lenses_are_finite() {
        for focus in [1e-300, 1e-9, 1.0, 1e9, 1e300] {
            for aperture in [0.0, 1e-300, 1.0, 1e300] {
                let camera = Camera {
                    kind: Kind::Lens(focus, lens(aperture, 2)),
                    origin: DVec3::new(1.0, 2.0, 3.0),
                    axes: [DVec3::X, DVec3::Y, DVec3::Z],
                    window: Window {
                        l: -3.0,
                        r: 3.0,
                        b: -2.0,
                        t: 2.0,
                        d: 1.0,
                    },
                    size: [4.0, 3.0],
                    near: 0.0,
                    spherical: false,
                };
                for ray in camera.rays([0.5, 0.5]) {
                    let length = ray.direction.length();
                    assert!((length - 1.0).abs() < 1e-15, "{focus:e} {aperture:e} {ray:?}");
                    assert!(ray.origin.is_finite());
                }
            }
        }
    }
}
