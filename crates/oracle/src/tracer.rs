//! An independent Whitted tracer: decides pixels in which two renderers differ.
//!
//! It is deliberately simple: it tests every shape for every ray and follows the ray tree by plain
//! recursion. Intersections are found in arbitrary precision ([`crate::Oracle`]). The hit point is
//! the double vector nearest to the intersection. From there on it evaluates the formulas of
//! `docs/whitted-model.md` in double precision, in their plainest form.
//!
//! The uncertainty of a value is estimated by stochastic arithmetic (Vignes 1993, *A stochastic
//! arithmetic for reliable scientific computation*). The tree is traced several times, with every
//! point and direction perturbed at random by a few units in the last place. The spread of these
//! values is the uncertainty. A pixel with a large uncertainty is ill-posed.
//!
//! It reports everything that it does not support or cannot decide. A scene with an unsupported
//! part has no tracer. A ray whose hit no precision decides has no value.

mod camera;
mod coincident;
mod footprint;
mod light;
mod mapping;
mod material;
mod motion;
mod noise;
mod pattern;
mod place;
mod pyramid;
mod repeated;
mod sampler;
mod scene;
mod sky;
mod synthesized;
pub(crate) mod tangent;
pub(crate) mod texture;
mod wrap;

use camera::Camera;
use footprint::Differential;
use light::Lights;
use material::medium::MediumState;
use material::{At, SpecularRay};
use sampler::Sampler;
use scene::{Hit, Scene};
use serde::Deserialize;
use std::time::{Duration, Instant};
use whitstone_core::config::decode;
use whitstone_core::{DVec3, Ray, Rgb, SceneError, SceneErrors};
use whitstone_scene::{Description, PluginTable};

/// The uncertainty is this factor times the largest deviation that was seen.
const SAFETY: f64 = 4.0;

/// The number of perturbed runs of a pixel, and the size of the perturbation.
#[derive(Clone, Copy, Debug)]
pub struct Care {
    /// Number of perturbed runs.
    pub repeats: u64,
    /// Size of the perturbation of points and directions, in units in the last place.
    pub ulps: f64,
}

impl Care {
    /// Enough to detect that a pixel is ill-posed.
    pub const USUAL: Self = Self {
        repeats: 4,
        ulps: 2.0,
    };
    /// Enough to see the values that an ill-posed pixel can take: for pixels that touch an edge,
    /// and those where another renderer's value differs.
    pub const GREAT: Self = Self {
        repeats: 32,
        ulps: 8.0,
    };
}

/// A pixel according to the oracle.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// The value within an uncertainty.
    Known {
        /// Linear R, G, B.
        rgb: [f64; 3],
        /// Bound on the error by channel.
        uncertainty: [f64; 3],
        /// All values that were seen, including those of perturbed runs. Where a single yes-or-no
        /// test is undecided, the true value is one of them and nothing in between.
        seen: Vec<[f64; 3]>,
    },
    /// The oracle cannot decide; the reason as text.
    Unknown(String),
}

/// The first surface on a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FirstHit {
    /// The ray certainly hits a surface.
    Hit {
        /// The ray parameter: the double nearest to the exact value.
        t: f64,
        /// The double vector nearest to the exact point.
        point: DVec3,
        /// The geometric normal, of unit length.
        normal: DVec3,
    },
    /// The ray certainly hits nothing.
    Miss,
    /// The ray touches a surface, or meets two surfaces at one point.
    Unknown,
}

/// Why a ray has no value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Unsure {
    /// A ray touches a surface, or two surfaces coincide.
    Touch,
    /// The ray tree is too large.
    Long,
    /// The deadline has passed.
    Late,
}

/// Upper bound on the rays of a tree.
const MAX_RAYS: u32 = 20_000;
/// Shadow rays from the corner of a triangle start this part of the way to its middle.
const INWARDS: f64 = 1.0 / (1u64 << 30) as f64;
/// Upper bound on the bounces of a path; each is a nested call.
const MAX_BOUNCES: u32 = 500;

/// Traces pixels of one scene.
pub struct Tracer {
    scene: Scene,
    camera: Camera,
    lights: Lights,
    rules: Rules,
    sampler: Sampler,
    /// Size of the image in pixels.
    size: [u32; 2],
    /// The sample distance in pixels, if a texture needs footprints.
    apart: Option<f64>,
    /// If shapes move: a tracer for each time of the film. The rest is then the scene at the first.
    moments: Vec<Tracer>,
}

/// The table `[integrator]`.
struct Rules {
    max_depth: u32,
    min_contribution: f64,
    black_at_max_depth: bool,
    shadows: Shadows,
    light_cutoff: f64,
    specular_rays: bool,
    /// Whether colours are computed at the vertices of triangles (Gouraud shading).
    at_corners: bool,
}

#[derive(Clone, Copy, PartialEq)]
enum Shadows {
    None,
    Opaque,
    Filtered,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Whitted {
    #[serde(default = "six")]
    max_depth: u32,
    #[serde(default)]
    min_contribution: f64,
    at_max_depth: Option<String>,
    shadows: Option<String>,
    #[serde(default)]
    light_cutoff: f64,
    interpolation: Option<String>,
}

fn six() -> u32 {
    6
}

impl Rules {
    /// Section 6 of the model: without a table, `whitted` with its defaults.
    fn new(plugin: Option<&PluginTable<'_>>) -> Result<Self, SceneErrors> {
        let default = PluginTable::named("whitted");
        let plugin = plugin.unwrap_or(&default);
        if !["whitted", "appel", "rasterizer"].contains(&&*plugin.name) {
            return Err(unknown(plugin, "integrator"));
        }
        let Whitted {
            max_depth,
            min_contribution,
            at_max_depth,
            shadows,
            light_cutoff,
            interpolation,
        } = decode(&plugin.table)?;
        let shadows = match shadows.as_deref() {
            Some("none") => Shadows::None,
            Some("filtered") => Shadows::Filtered,
            _ => Shadows::Opaque,
        };
        Ok(Self {
            max_depth,
            min_contribution,
            black_at_max_depth: at_max_depth.as_deref() == Some("black"),
            shadows,
            light_cutoff,
            specular_rays: plugin.name == "whitted",
            at_corners: interpolation.as_deref() == Some("gouraud"),
        })
    }
}

/// The error "the oracle does not support the light "x"", located in the file.
pub(crate) fn unknown(plugin: &PluginTable<'_>, family: &str) -> SceneErrors {
    let message = format!("the oracle does not support the {family} \"{}\"", plugin.name);
    SceneError::at(plugin.name_span.clone(), message).into()
}

/// The same error for a part of a plugin.
pub(crate) fn unknown_part(plugin: &PluginTable<'_>, what: &str) -> SceneErrors {
    SceneError::at(
        plugin.name_span.clone(),
        format!("the oracle does not support {what}"),
    )
    .into()
}

/// Pseudo-random perturbations by splitmix64 (Steele, Lea and Flood 2014); zero in the first run.
struct Jitter {
    state: Option<u64>,
    ulps: f64,
}

impl Jitter {
    fn next(&mut self) -> f64 {
        let Some(state) = &mut self.state else {
            return 0.0;
        };
        *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = *state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        (z >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// Moves each coordinate by up to `ulps` units in the last place of the largest one.
    fn point(&mut self, p: DVec3) -> DVec3 {
        let size = p.abs().max_element() * f64::EPSILON * self.ulps;
        p + DVec3::new(self.next(), self.next(), self.next()) * size
    }

    fn direction(&mut self, d: DVec3) -> DVec3 {
        self.point(d).normalize()
    }
}

/// Shadow rays with less transmittance than this count as blocked.
const LEAST_LIGHT: f64 = 0.002;
/// This many surfaces block a light, whatever they are.
const MAX_FILTERS: usize = 1000;

/// The state of tracing one tree.
struct Walk {
    jitter: Jitter,
    /// The side on which undecided thresholds fall in this run, as in [`Place`](mapping::Place).
    nudge: f64,
    rays: u32,
    deadline: Option<Instant>,
}

/// A ray to be traced.
struct Arriving {
    ray: Ray,
    /// The primitive that it leaves.
    from: Option<(usize, u32)>,
    throughput: Rgb,
    medium: MediumState,
    depth: u32,
    differential: Option<Differential>,
}

/// Offset of the neighbours of a camera ray for its differential, in pixels.
const MOVED: f64 = 1.0 / 256.0;

/// Whether any texture is filtered by footprints.
fn filters(description: &Description<'_>) -> bool {
    let written = description.textures.values().chain(&description.inline);
    let filter = |plugin: &PluginTable<'_>| {
        Some(
            plugin
                .table
                .get_ref()
                .get("filter")?
                .get_ref()
                .as_str()?
                .to_owned(),
        )
    };
    let mut pictures = written.filter(|plugin| ["image", "synthesized"].contains(&&*plugin.name));
    pictures.any(|plugin| matches!(filter(plugin).as_deref(), Some("trilinear" | "ewa")))
}

impl Tracer {
    /// A tracer for a scene that the planner accepts.
    ///
    /// # Errors
    /// Every part of the scene that the oracle does not support.
    pub fn new(description: &Description<'_>) -> Result<Self, SceneErrors> {
        // First: its errors have places.
        let still = Self::still(description)?;
        Ok(Self {
            moments: motion::tracers(description)?,
            ..still
        })
    }

    /// A tracer for a scene without motion.
    fn still(description: &Description<'_>) -> Result<Self, SceneErrors> {
        let sampler = Sampler::new(description.sampler.as_ref())?;
        let apart = filters(description).then(|| 1.0 / (sampler.at_first() as f64).sqrt());
        Ok(Self {
            scene: Scene::new(description)?,
            camera: Camera::new(&description.camera, &description.film)?,
            lights: Lights::new(description)?,
            rules: Rules::new(description.integrator.as_ref())?,
            sampler,
            apart,
            moments: Vec::new(),
            size: [description.film.size.width, description.film.size.height],
        })
    }

    /// The first hit of a ray, in front of its origin, at the first time of the film. Every shape
    /// is tested.
    pub fn first_hit(&self, ray: &Ray) -> FirstHit {
        match self.scene.nearest(ray, None, f64::INFINITY) {
            Ok(Some(Hit { t, point, normal, .. })) => FirstHit::Hit { t, point, normal },
            Ok(None) => FirstHit::Miss,
            Err(_) => FirstHit::Unknown,
        }
    }

    /// The longest time that a ray has taken so far.
    pub fn slowest_ray(&self) -> Duration {
        let moments = self.moments.iter().map(Self::slowest_ray);
        moments.fold(self.scene.slowest(), Duration::max)
    }

    /// The value of a pixel, given as column and row from the top left.
    pub fn pixel(&self, pixel: [u32; 2]) -> Value {
        self.value(pixel, Care::USUAL, None)
    }

    /// The same with the given care; unknown if it is not done by `deadline`.
    pub fn pixel_before(&self, pixel: [u32; 2], care: Care, deadline: Instant) -> Value {
        self.value(pixel, care, Some(deadline))
    }

    fn value(&self, pixel: [u32; 2], care: Care, deadline: Option<Instant>) -> Value {
        if self.moments.is_empty() {
            return self.still_value(pixel, care, deadline);
        }
        let moments = self.moments.iter();
        motion::mean(
            moments
                .map(|still| still.still_value(pixel, care, deadline))
                .collect(),
        )
    }

    fn still_value(&self, pixel: [u32; 2], care: Care, deadline: Option<Instant>) -> Value {
        let ulps = care.ulps;
        let exact = match self.once(pixel, Jitter { state: None, ulps }, deadline) {
            Err(unsure) if unsure != Unsure::Touch => return Value::Unknown(unsure.reason().to_owned()),
            exact => exact,
        };
        let repeats = match exact {
            // The ray hits an edge: find all values that the pixel can take.
            Err(_) => Care::GREAT.repeats.max(care.repeats),
            Ok(_) => care.repeats,
        };
        let mut seen: Vec<[f64; 3]> = exact.iter().map(|value| value.to_array()).collect();
        let mut touched = 0;
        for seed in 1..=repeats {
            let state = Some(seed);
            match self.once(pixel, Jitter { state, ulps }, deadline) {
                Ok(value) => seen.push(value.to_array()),
                Err(Unsure::Touch) => touched += 1,
                Err(unsure) => return Value::Unknown(unsure.reason().to_owned()),
            }
            // Coincident surfaces, not an edge that is hit by chance.
            if 2 * touched > repeats {
                return Value::Unknown(Unsure::Touch.reason().to_owned());
            }
        }
        let Some(&rgb) = seen.first() else {
            return Value::Unknown(Unsure::Touch.reason().to_owned());
        };
        let uncertainty = std::array::from_fn(|c| {
            let deviations = seen.iter().map(|other| (rgb[c] - other[c]).abs());
            SAFETY * deviations.fold(0.0, f64::max)
        });
        Value::Known {
            rgb,
            uncertainty,
            seen,
        }
    }

    fn once(&self, pixel: [u32; 2], jitter: Jitter, deadline: Option<Instant>) -> Result<Rgb, Unsure> {
        let nudge = match jitter.state {
            None => 0.0,
            Some(seed) if seed % 2 == 0 => 1.0,
            Some(_) => -1.0,
        };
        let mut walk = Walk {
            jitter,
            nudge,
            rays: 0,
            deadline,
        };
        let positions = self.sampler.positions(pixel);
        let mut values = Vec::new();
        if let Sampler::Adaptive { first, threshold, .. } = self.sampler {
            let mut around = 0.0_f64;
            for other in self.neighbours(pixel) {
                let mut there = Vec::new();
                let positions = self.sampler.positions(other);
                self.samples(other, &positions[..first], &mut there, &mut walk)?;
                around = around.max(range(&there));
                walk.rays = 0;
            }
            let (mut taken, mut next) = (0, first);
            while next > taken {
                self.samples(pixel, &positions[taken..next], &mut values, &mut walk)?;
                taken = next;
                let n = values.len() as f64;
                let doubt = (0.3 * range(&values) / n.powf(0.75)).max(0.15 * around / n);
                if doubt > threshold {
                    next = (2 * taken).min(positions.len());
                }
            }
        } else {
            self.samples(pixel, &positions, &mut values, &mut walk)?;
        }
        let sum = values.iter().fold(Rgb::splat(0.0), |sum, value| sum + *value);
        Ok(sum * (1.0 / values.len() as f64))
    }

    /// The up to eight neighbours of a pixel.
    fn neighbours(&self, [x, y]: [u32; 2]) -> impl Iterator<Item = [u32; 2]> {
        let [width, height] = self.size;
        let places = (0..9).filter(|k| *k != 4).map(move |k| (x + k % 3, y + k / 3));
        // Coordinates are shifted by one, so that none is negative.
        places
            .filter(move |(x, y)| *x >= 1 && *y >= 1 && *x <= width && *y <= height)
            .map(|(x, y)| [x - 1, y - 1])
    }

    /// Radiances at positions in a pixel, one for each lens sample.
    fn samples(
        &self,
        [x, y]: [u32; 2],
        positions: &[[f64; 2]],
        values: &mut Vec<Rgb>,
        walk: &mut Walk,
    ) -> Result<(), Unsure> {
        for position in positions {
            let place = [f64::from(x) + position[0], f64::from(y) + position[1]];
            let neighbours = self.apart.map(|_| {
                let offsets = [[-MOVED, 0.0], [MOVED, 0.0], [0.0, -MOVED], [0.0, MOVED]];
                offsets.map(|[a, b]| self.camera.rays([place[0] + a, place[1] + b]))
            });
            for (number, ray) in self.camera.rays(place).into_iter().enumerate() {
                let differential = neighbours.as_ref().zip(self.apart).map(|(neighbours, apart)| {
                    Differential::between(neighbours.each_ref().map(|rays| &rays[number]), MOVED, apart)
                });
                let arriving = Arriving {
                    ray: Ray {
                        direction: walk.jitter.direction(ray.direction),
                        ..ray
                    },
                    from: None,
                    throughput: Rgb::splat(1.0),
                    medium: MediumState::default(),
                    depth: 0,
                    differential,
                };
                values.push(self.radiance(&arriving, walk)?);
            }
        }
        Ok(())
    }

    /// The radiance along a ray: section 6 of the model.
    fn radiance(&self, arriving: &Arriving, walk: &mut Walk) -> Result<Rgb, Unsure> {
        walk.rays += 1;
        if walk.rays > MAX_RAYS || arriving.depth > MAX_BOUNCES {
            return Err(Unsure::Long);
        }
        in_time(walk.deadline)?;
        let Some(hit) = self.scene.nearest(&arriving.ray, arriving.from, f64::INFINITY)? else {
            return Ok(
                self.lights.background(arriving.ray.direction) * arriving.medium.transmittance_to_infinity()
            );
        };
        let transmittance = arriving.medium.transmittance(hit.t);
        let throughput = arriving.throughput * transmittance;
        let point = walk.jitter.point(hit.point);
        let viewer = -arriving.ray.direction;
        if self.rules.at_corners {
            return self.at_corners(&hit, &arriving.ray, walk);
        }
        let material = match &arriving.differential {
            None => self.scene.material(&hit, viewer, walk.nudge),
            Some(differential) => (self.scene).material_over(&hit, &arriving.ray, differential, walk.nudge),
        };
        let (deadline, nudge) = (walk.deadline, walk.nudge);
        let shadow = |l, distance| {
            in_time(deadline)?;
            self.shadow_transmittance(&hit, point, l, distance, arriving.medium, nudge)
        };
        let mut sum = self.local_illumination(&material, hit.normal, point, viewer, &shadow)?;
        if self.rules.specular_rays {
            let specular_rays = material.specular_rays(arriving.medium);
            let differentials = arriving
                .differential
                .map(|arrived| material.differentials(&specular_rays, &arrived, arriving.medium));
            for (number, specular_ray) in specular_rays.iter().enumerate() {
                let differential = differentials.as_ref().map(|all| all[number]);
                let left = (point, differential);
                sum +=
                    self.specular_ray(specular_ray, &hit, left, viewer, throughput, arriving.depth, walk)?;
            }
        }
        Ok(sum * transmittance)
    }

    /// Local illumination: section 8 of the model. Sums the emission and the reflected light;
    /// `shadow` gives the transmittance to a light.
    fn local_illumination(
        &self,
        material: &At<'_>,
        n_g: DVec3,
        point: DVec3,
        viewer: DVec3,
        shadow: &dyn Fn(DVec3, f64) -> Result<Rgb, Unsure>,
    ) -> Result<Rgb, Unsure> {
        let mut sum = material.emission() + material.ambient(self.lights.ambient);
        for light in &self.lights.all {
            let Some((l, distance, e)) = light.at(point) else {
                continue;
            };
            // Rule G of the model, and the light must be on the viewer's side of the shading
            // normal.
            let counts = n_g.dot(l) * n_g.dot(viewer) > 0.0 && material.n().dot(l) > 0.0;
            if counts && e.max_component() >= self.rules.light_cutoff {
                sum += material.eval(l) * e * shadow(l, distance)?;
            }
        }
        Ok(sum)
    }

    /// Gouraud shading: section 6 of the model.
    fn at_corners(&self, hit: &Hit, ray: &Ray, walk: &Walk) -> Result<Rgb, Unsure> {
        let (deadline, nudge) = (walk.deadline, walk.nudge);
        let mut sum = Rgb::splat(0.0);
        let corners = self.scene.corners(hit, ray.origin, nudge);
        let middle = corners.iter().map(|(_, p, _)| *p).sum::<DVec3>() / corners.len().max(1) as f64;
        for (weight, p, material) in corners {
            // Next to the corner: at it, shadow rays would touch all triangles that share it.
            let start = p + INWARDS * (middle - p);
            let viewer = (ray.origin - p).normalize();
            let shadow = |l, distance| {
                in_time(deadline)?;
                self.shadow_transmittance(hit, start, l, distance, MediumState::default(), nudge)
            };
            sum += self.local_illumination(&material, hit.normal, p, viewer, &shadow)? * weight;
        }
        Ok(sum)
    }

    #[expect(clippy::too_many_arguments, reason = "the state of a specular ray")]
    fn specular_ray(
        &self,
        specular_ray: &SpecularRay,
        hit: &Hit,
        (point, differential): (DVec3, Option<Differential>),
        viewer: DVec3,
        throughput: Rgb,
        depth: u32,
        walk: &mut Walk,
    ) -> Result<Rgb, Unsure> {
        // Rule G of the model.
        let side = hit.normal.dot(specular_ray.direction) * hit.normal.dot(viewer);
        let allowed = if specular_ray.transmitted {
            side < 0.0
        } else {
            side > 0.0
        };
        let next = throughput * specular_ray.weight;
        let most = next.max_component();
        if !allowed || most == 0.0 || most < self.rules.min_contribution {
            return Ok(Rgb::splat(0.0));
        }
        if depth >= self.rules.max_depth {
            return Ok(match self.rules.black_at_max_depth {
                true => Rgb::splat(0.0),
                false => {
                    specular_ray.weight
                        * self.lights.background(specular_ray.direction)
                        * specular_ray.medium.transmittance_to_infinity()
                }
            });
        }
        let arriving = Arriving {
            ray: Ray {
                origin: point,
                direction: walk.jitter.direction(specular_ray.direction),
            },
            from: Some((hit.shape, hit.primitive)),
            throughput: next,
            medium: specular_ray.medium,
            depth: depth + 1,
            differential,
        };
        Ok(specular_ray.weight * self.radiance(&arriving, walk)?)
    }

    /// Transmittance between a point and a light, excluding both ends.
    fn shadow_transmittance(
        &self,
        hit: &Hit,
        point: DVec3,
        l: DVec3,
        distance: f64,
        medium: MediumState,
        nudge: f64,
    ) -> Result<Rgb, Unsure> {
        let all = Rgb::splat(1.0);
        let filtered = match self.rules.shadows {
            Shadows::None => return Ok(all),
            Shadows::Opaque => false,
            Shadows::Filtered => true,
        };
        let ray = Ray {
            origin: point,
            direction: l,
        };
        // Section 7: a shadow ray ends 8 units in the last place before the light.
        let size = point.abs().max_element() + distance;
        let end = if distance.is_finite() {
            distance - 8.0 * f64::EPSILON * size
        } else {
            distance
        };
        let from = Some((hit.shape, hit.primitive));
        if !filtered && !self.scene.has_holes {
            let is_hidden = self.scene.nearest(&ray, from, end)?.is_some();
            return Ok(if is_hidden { Rgb::splat(0.0) } else { all });
        }
        let mut left = all;
        let (mut medium, mut passed) = (medium, 0.0);
        let hits = self.scene.all(&ray, from, end)?;
        for (number, hit) in hits.iter().enumerate() {
            let (transmittance, behind) = if self.scene.casts_shadow(hit) {
                let material = self.scene.material(hit, -l, nudge);
                material.transmittance(filtered, medium)
            } else {
                (all, None)
            };
            if filtered {
                left *= medium.transmittance(hit.t - passed);
            }
            left *= transmittance;
            if left.max_component() < LEAST_LIGHT || number + 1 >= MAX_FILTERS {
                return Ok(Rgb::splat(0.0));
            }
            passed = hit.t;
            medium = behind.unwrap_or(medium);
        }
        if filtered {
            left *= match distance.is_finite() {
                true => medium.transmittance(distance - passed),
                false => medium.transmittance_to_infinity(),
            };
        }
        Ok(left)
    }
}

/// Fails after the deadline.
fn in_time(deadline: Option<Instant>) -> Result<(), Unsure> {
    match deadline {
        Some(deadline) if Instant::now() >= deadline => Err(Unsure::Late),
        _ => Ok(()),
    }
}

/// The largest range of values of any channel.
fn range(values: &[Rgb]) -> f64 {
    let of = |channel: usize| {
        let all = values.iter().map(|value| value.to_array()[channel]);
        let [low, high] = all.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| {
            [low.min(value), high.max(value)]
        });
        high - low
    };
    (0..3).map(of).fold(0.0, f64::max)
}

impl Unsure {
    fn reason(self) -> &'static str {
        match self {
            Self::Touch => "a ray touches a surface or an edge, or two surfaces coincide",
            Self::Long => "the ray tree is too large",
            Self::Late => "the time limit was reached",
        }
    }
}
