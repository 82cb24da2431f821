//! Recursive ray tracing: local illumination, plus a reflected and a refracted ray where the
//! material has them.
//!
//! Whitted 1980, *An improved illumination model for shaded display*. The ray tree is traversed
//! depth first, reflection before transmission. The stack is explicit, because recursion over a
//! hundred thousand bounces would exhaust the thread's stack. Of the two branches of a hit, one is
//! traced next and the other is pushed. Without glossy surfaces the stack therefore never holds
//! more than `max_depth` rays; a hit on a glossy surface with n² reflection rays can push n².
//! `rules` traces single rays, `wave` traces streams.
//!
//! - Twin: the Mitsuba driver, which traverses the same tree level by level.
//! - Example: `scenes/integrators/whitted.toml`.

use crate::rules::{Beyond, Limits, Rules, zero};
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::config::{IntegerIn, NonNegative};
use whitstone_core::stream::{Colors, HitStream, RayStream};
use whitstone_core::{
    Context, DirectLighting, Integrator, Integrators, Plugin, Ray, Rgb, Scene, SceneErrors, Scratch,
    ShadowMode,
};

/// Recursive ray tracing: local illumination, plus a reflected and a refracted ray where the
/// material has them.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Maximum number of branches (reflected, transmitted or undeviated) along a path from the
    /// camera.
    #[serde(default = "six")]
    max_depth: IntegerIn<0, 100_000>,
    /// Branches whose throughput is below this in every channel are not traced.
    #[serde(default = "zero")]
    min_contribution: NonNegative,
    /// Radiance of branches beyond `max_depth`: "background" or "black".
    #[serde(default)]
    at_max_depth: Beyond,
    /// "opaque": surfaces block light, except in the holes of the material `mask` and on shapes
    /// with `casts_shadow = false`; "filtered": transparent surfaces also let light pass straight
    /// through, attenuated; "none": no shadows.
    #[serde(default)]
    shadows: ShadowMode,
    /// A light sample (a light, or a point of an area light) does not count where its irradiance is
    /// below this in every channel, in W/m².
    #[serde(default = "zero")]
    light_cutoff: NonNegative,
}

fn six() -> IntegerIn<0, 100_000> {
    IntegerIn::new(6).expect("6 is in range")
}

/// The `whitted` integrator; see the module documentation.
pub struct Whitted {
    rules: Rules,
}

impl Plugin<Integrators> for Whitted {
    const TYPE: &'static str = "whitted";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Box<dyn Integrator>, SceneErrors> {
        Ok(Box::new(Self {
            rules: Rules {
                lighting: DirectLighting {
                    shadows: config.shadows,
                    light_cutoff: config.light_cutoff.get(),
                },
                branches: Some(Limits {
                    max_depth: config.max_depth.get(),
                    min_contribution: config.min_contribution.get(),
                    beyond: config.at_max_depth,
                }),
            },
        }))
    }
}

impl Integrator for Whitted {
    fn follows_branches(&self) -> bool {
        true
    }

    fn splits_paths(&self) -> bool {
        true
    }

    fn max_split_depth(&self, directions: u32) -> u32 {
        let Some(limits) = &self.rules.branches else {
            return 0;
        };
        let (mut bounces, mut share) = (0, 1.0 / f64::from(directions));
        // The loop ends at `max_depth`, or earlier when the share falls below the minimum or to 0.
        while bounces < limits.max_depth && share >= limits.min_contribution && share > 0.0 {
            bounces += 1;
            share /= f64::from(directions);
        }
        bounces
    }

    fn radiance(&self, scene: &Scene, ray: &Ray, scratch: &mut Scratch) -> Rgb {
        self.rules.radiance(scene, ray, scratch)
    }

    fn radiance_stream(&self, scene: &Scene, rays: &RayStream, scratch: &mut Scratch, out: &mut Colors) {
        self.rules.radiance_stream(scene, rays, scratch, out);
    }

    fn shade_stream(
        &self,
        scene: &Scene,
        rays: &RayStream,
        hits: &mut Box<HitStream>,
        scratch: &mut Scratch,
        out: &mut Colors,
    ) {
        if scene.requires_scalar_tracing() {
            self.radiance_stream(scene, rays, scratch, out);
        } else {
            scratch.counters.closest += rays.len as u64;
            self.rules.shade_stream(scene, rays, hits, scratch, out);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ops::Range;
    use std::sync::Arc;
    use whitstone_core::stream::LANES;
    use whitstone_core::{Counters, DVec3, Light, SelfHitFilter, TreeLimits, TreeNode};
    use whitstone_testkit::{Lamp, Simple, Wall, build, floor, integrator_laws, world_of_walls};

    const SKY: Lamp = Lamp {
        background: Rgb::WHITE,
        ambient: Rgb::WHITE,
        lamp: None,
    };

    fn render(text: &str, scene: &Scene, direction: DVec3) -> (Rgb, Scratch) {
        let mut scratch = Scratch::default();
        let integrator = build::<Integrators, Whitted>(text, ()).unwrap();
        let ray = Ray::new(DVec3::new(0.0, 0.5, 0.0), direction);
        (integrator.radiance(scene, &ray, &mut scratch), scratch)
    }

    /// Two mirrors that face each other at y = 0 and y = 1 and also have local radiance.
    fn corridor(diffuse: f64, reflect: f64) -> Scene {
        let material = Simple {
            diffuse,
            reflect: Rgb::splat(reflect),
            ..Simple::default()
        };
        let ceiling = Wall {
            point: DVec3::Y,
            normal: DVec3::NEG_Y,
        };
        world_of_walls(&[(floor(0.0), material), (ceiling, material)], SKY)
    }

    #[test]
    fn laws() {
        for (text, shadows) in [("", true), ("shadows = \"none\"", false)] {
            integrator_laws(&*build::<Integrators, Whitted>(text, ()).unwrap(), shadows);
        }
    }

    #[test]
    fn bounces_are_counted_from_zero() {
        // The sum of 0.5^k up to the limit, plus the background beyond. The ray goes up at odd
        // depths.
        for depth in 0..8 {
            let (found, scratch) = render(&format!("max_depth = {depth}"), &corridor(1.0, 0.5), DVec3::NEG_Y);
            let local: f64 = (0..=depth).map(|k| f64::powi(0.5, k)).sum();
            let beyond = f64::powi(0.5, depth + 1) * if depth % 2 == 0 { 1.0 } else { 0.5 };
            assert_eq!(found, Rgb::splat(local + beyond), "depth {depth}");
            assert_eq!(scratch.counters.closest, depth as u64 + 1);
        }
        let text = "max_depth = 2\nat_max_depth = \"black\"";
        assert_eq!(
            render(text, &corridor(1.0, 0.5), DVec3::NEG_Y).0,
            Rgb::splat(1.75)
        );
    }

    #[test]
    fn a_hundred_thousand_bounces_need_no_memory_and_lose_no_energy() {
        let text = "max_depth = 100000\nat_max_depth = \"background\"";
        let (found, scratch) = render(text, &corridor(0.0, 0.9999), DVec3::NEG_Y);
        // 0.9999^100001, to 20 digits by mpmath from the exact binary value of 0.9999. The last
        // branch goes up.
        let expected = 0.000045372696235615253296;
        assert!(
            (found.g / expected - 1.0).abs() < 1e-11,
            "{}",
            found.g / expected - 1.0
        );
        assert_eq!(scratch.counters.closest, 100_001);
        assert!(scratch.pending.capacity() < 16);
    }

    /// Panes one above the other that all reflect and transmit.
    fn panes() -> Scene {
        panes_at(-20..20, [0.5, 0.5])
    }

    fn panes_at(heights: Range<i32>, [reflect, transmit]: [f64; 2]) -> Scene {
        let material = Simple {
            reflect: Rgb::splat(reflect),
            transmit: Rgb::splat(transmit),
            ..Simple::default()
        };
        let walls: Vec<_> = heights
            .map(|height| (floor(f64::from(height) + 0.25), material))
            .collect();
        world_of_walls(&walls, SKY)
    }

    /// Two rays hit the pane below and two the one above; their reflections all hit the pane
    /// between. The rays that it transmits come before those that the first panes have transmitted.
    #[test]
    fn the_ray_that_waits_last_goes_on_first() {
        let scene = panes_at(-2..4, [0.3, 0.7]);
        let integrator = build::<Integrators, Whitted>("max_depth = 9", ()).unwrap();
        let mut stream = RayStream::default();
        let mut expected = Vec::new();
        for (lane, (height, slope)) in [(0.5, -1.0), (0.5, -0.9), (1.5, 1.0), (1.5, 0.9)]
            .into_iter()
            .enumerate()
        {
            let ray = Ray::new(DVec3::new(0.0, height, 0.0), DVec3::new(0.1, slope, 0.0));
            stream.set(lane, ray, f64::INFINITY, SelfHitFilter::NOTHING);
            expected.push(integrator.radiance(&scene, &ray, &mut Scratch::default()));
        }
        stream.len = expected.len();
        let mut found = Colors::default();
        integrator.radiance_stream(&scene, &stream, &mut Scratch::default(), &mut found);
        for (lane, expected) in expected.into_iter().enumerate() {
            assert_eq!(found.get(lane), expected);
        }
    }

    /// Both rays first hit the same pane, one from above and one from below. Few panes are below.
    /// While one pixel traces its many rays above the pane, the other one, which has finished those
    /// below, waits: there are more waves than either has rays.
    #[test]
    fn rays_that_wait_for_others_are_not_counted() {
        let scene = panes_at(-3..20, [0.5, 0.5]);
        let integrator = build::<Integrators, Whitted>("max_depth = 12", ()).unwrap();
        let pair = [(0.5, DVec3::NEG_Y), (-0.5, DVec3::Y)]
            .map(|(height, direction)| Ray::new(DVec3::new(0.0, height, 0.0), direction));
        let mut stream = RayStream::default();
        let (mut expected, mut counters, mut most) = (Vec::new(), Counters::default(), 0);
        for (lane, ray) in pair.into_iter().enumerate() {
            stream.set(lane, ray, f64::INFINITY, SelfHitFilter::NOTHING);
            let mut scratch = Scratch::default();
            expected.push(integrator.radiance(&scene, &ray, &mut scratch));
            counters.add(scratch.counters);
            most = most.max(scratch.counters.closest as u32);
        }
        stream.len = pair.len();
        for (rays, exceeded) in [(most, None), (most - 1, Some(true))] {
            let limits = TreeLimits {
                rays,
                ..TreeLimits::default()
            };
            let mut scratch = Scratch::within(limits);
            let mut found = Colors::default();
            integrator.radiance_stream(&scene, &stream, &mut scratch, &mut found);
            assert_eq!(scratch.too_large.map(|tree| tree.by_rays), exceeded);
            if exceeded.is_none() {
                assert_eq!([found.get(0), found.get(1)], expected[..]);
                assert_eq!(scratch.counters, counters);
            }
            let mut scratch = Scratch::within(limits);
            let mut hits = Box::default();
            scene.accelerator.intersect_stream(&stream, &mut hits);
            integrator.shade_stream(&scene, &stream, &mut hits, &mut scratch, &mut found);
            assert_eq!(scratch.too_large.map(|tree| tree.by_rays), exceeded);
            if exceeded.is_none() {
                assert_eq!([found.get(0), found.get(1)], expected[..]);
                assert_eq!(scratch.counters, counters);
            }
        }
    }

    #[test]
    fn trees_that_exceed_a_limit_are_told() {
        let scene = panes();
        let integrator = build::<Integrators, Whitted>("max_depth = 12", ()).unwrap();
        let ray = Ray::new(DVec3::new(0.0, 0.5, 0.0), DVec3::NEG_Y);
        // A tree of 2^13 - 1 rays, of which at most 12 wait.
        let (all, most) = ((1 << 13) - 1, 12);
        for (rays, pending, exceeded) in [
            (all, 2 * most, None),
            (all - 1, 2 * most, Some(true)),
            (all, most - 1, Some(false)),
        ] {
            let limits = TreeLimits { rays, pending };
            let told = |scratch: &Scratch| scratch.too_large.map(|tree| tree.by_rays);
            let mut single = Scratch::within(limits);
            integrator.radiance(&scene, &ray, &mut single);
            assert_eq!(told(&single), exceeded, "{limits:?}");
            // The first ray misses, so that only the second one, in lane 1, has a tree.
            let mut stream = RayStream::default();
            let up = Ray::new(DVec3::new(0.0, 30.0, 0.0), DVec3::Y);
            for (lane, ray) in [up, ray].into_iter().enumerate() {
                stream.set(lane, ray, f64::INFINITY, SelfHitFilter::NOTHING);
            }
            stream.len = 2;
            let mut scratch = Scratch::within(limits);
            let mut found = Colors::default();
            integrator.radiance_stream(&scene, &stream, &mut scratch, &mut found);
            assert_eq!(told(&scratch), exceeded, "{limits:?}");
            let lane = scratch.too_large.map(|tree| tree.lane);
            assert_eq!(lane, exceeded.map(|_| 1), "{limits:?}");
            // What was pending is forgotten.
            scratch.limits = TreeLimits::default();
            scratch.too_large = None;
            integrator.radiance_stream(&scene, &stream, &mut scratch, &mut found);
            assert_eq!(
                found.get(1),
                integrator.radiance(&scene, &ray, &mut Scratch::default())
            );
        }
    }

    /// The stack holds the pending rays: with two branches everywhere, one per level.
    #[test]
    fn two_branches_do_not_fill_the_stack() {
        let scene = panes();
        let (found, scratch) = render("max_depth = 12", &scene, DVec3::NEG_Y);
        assert_eq!(scratch.counters.closest, (1 << 13) - 1);
        assert!(scratch.pending.capacity() <= 16, "{}", scratch.pending.capacity());
        assert!(found.g > 0.5 && found.g < 1.0);
    }

    /// The record of a pixel must be complete: it includes branches beyond the limit and hits that
    /// absorption hides.
    #[test]
    fn the_record_sums_to_the_radiance() {
        let glass = |absorption| Simple {
            diffuse: 0.25,
            reflect: Rgb::new(0.5, 0.25, 0.125),
            transmit: Rgb::new(0.25, 0.5, 0.5),
            absorption,
            ..Simple::default()
        };
        let ceiling = Wall {
            point: DVec3::Y,
            normal: DVec3::NEG_Y,
        };
        let cases = [
            (1.0, "max_depth = 3", 8, 0),
            (1.0, "max_depth = 3\nat_max_depth = \"black\"", 0, 0),
            // exp(-2000) is 0: surfaces a metre below the floor are hit and add nothing.
            (2000.0, "max_depth = 3", 2, 2),
        ];
        for (absorption, text, limits, hidden) in cases {
            let material = glass(Rgb::splat(absorption));
            let below = Wall {
                point: DVec3::NEG_Y,
                normal: DVec3::NEG_Y,
            };
            let walls = [(floor(0.0), material), (ceiling, material), (below, material)];
            let scene = world_of_walls(&walls, SKY);
            let mut scratch = Scratch::recording();
            let integrator = build::<Integrators, Whitted>(text, ()).unwrap();
            let ray = Ray::new(DVec3::new(0.0, 0.5, 0.0), DVec3::NEG_Y);
            let found = integrator.radiance(&scene, &ray, &mut scratch);
            let nodes = scratch.record.unwrap();
            let sum: Rgb = nodes.iter().map(|node| node.throughput * node.local).sum();
            let off = (found + sum * -1.0).map(f64::abs).max_component();
            assert!(off <= 1e-15, "{text}: {found:?} is not {sum:?}");
            let count = |what: fn(&TreeNode) -> bool| nodes.iter().filter(|node| what(node)).count();
            assert_eq!(count(|node| node.limit), limits, "{text}, {absorption}");
            assert_eq!(
                count(|node| node.shape >= 0 && node.throughput.is_black()),
                hidden,
                "{text}, {absorption}"
            );
        }
    }

    #[test]
    fn branches_below_the_minimum_are_left_out() {
        let count = |minimum: &str| {
            let text = format!("max_depth = 50\nmin_contribution = {minimum}");
            render(&text, &corridor(1.0, 0.5), DVec3::NEG_Y)
                .1
                .counters
                .closest
        };
        assert_eq!(count("0.25"), 3);
        assert_eq!(count("0.2500001"), 2);
        assert_eq!(count("0"), 51);
    }

    #[test]
    fn media_absorb_the_segments_inside_them() {
        // A slab between y = 0.25 and y = 0, seen from above; the floor under it is far away.
        let material = Simple {
            transmit: Rgb::WHITE,
            absorption: Rgb::new(0.0, 1.0, 8.0),
            ..Simple::default()
        };
        let bottom = Wall {
            point: DVec3::ZERO,
            normal: DVec3::NEG_Y,
        };
        let white = Simple {
            diffuse: 1.0,
            ..Simple::default()
        };
        let scene = world_of_walls(
            &[
                (floor(0.25), material),
                (bottom, material),
                (floor(-100.0), white),
            ],
            SKY,
        );
        let (found, _) = render("", &scene, DVec3::NEG_Y);
        assert_eq!(found, Rgb::new(1.0, (-0.25_f64).exp(), (-2.0_f64).exp()));
        // Without a bottom, the medium is endless, both beyond the depth limit and before it.
        let scene = world_of_walls(&[(floor(0.25), material)], SKY);
        for text in ["", "max_depth = 0"] {
            assert_eq!(render(text, &scene, DVec3::NEG_Y).0, Rgb::new(0.5, 0.0, 0.0));
        }
    }

    /// Undeviated rays through a pane in an absorbing medium stay in that medium, and emission is
    /// seen through the pane and the medium.
    #[test]
    fn rays_straight_on_stay_in_their_medium() {
        let absorption = Rgb::new(0.0, 1.0, 8.0);
        let water = Simple {
            transmit: Rgb::WHITE,
            absorption,
            ..Simple::default()
        };
        let pane = Simple {
            transmit: Rgb::splat(0.5),
            straight: true,
            ..Simple::default()
        };
        let glow = Simple {
            emission: Rgb::splat(4.0),
            ..Simple::default()
        };
        let walls = [(floor(0.25), water), (floor(0.0), pane), (floor(-0.25), glow)];
        let scene = world_of_walls(&walls, SKY);
        let (found, _) = render("", &scene, DVec3::NEG_Y);
        let through = absorption.transmittance(0.25);
        assert_eq!(found, through * 0.5 * through * Rgb::splat(4.0));
        let rays: Vec<Ray> = (0..300)
            .map(|k| Ray::new(DVec3::new(0.0, 0.5, f64::from(k)), DVec3::NEG_Y))
            .collect();
        same_in_streams("", &scene, &rays);
    }

    fn same_in_streams(text: &str, scene: &Scene, rays: &[Ray]) {
        let integrator = build::<Integrators, Whitted>(text, ()).unwrap();
        let mut scratch = Scratch::default();
        for rays in rays.chunks(LANES) {
            let mut stream = RayStream::default();
            for (lane, ray) in rays.iter().enumerate() {
                stream.set(lane, *ray, f64::INFINITY, SelfHitFilter::NOTHING);
            }
            stream.len = rays.len();
            let mut found = Colors::default();
            integrator.radiance_stream(scene, &stream, &mut scratch, &mut found);
            for (lane, ray) in rays.iter().enumerate() {
                let single = integrator.radiance(scene, ray, &mut Scratch::default());
                assert_eq!(found.get(lane), single, "{lane}");
            }
        }
    }

    /// A lamp above two surfaces above a floor: the transmittance of each surface and the
    /// cut-off.
    #[test]
    fn shadow_rays_go_through_holes_and_filters() {
        let white = Simple {
            diffuse: 1.0,
            ..Simple::default()
        };
        let light = Lamp {
            lamp: Some((DVec3::new(0.0, 8.0, 0.0), 1.0)),
            ..Lamp::default()
        };
        let lit = |text: &str, above: Simple, below: Simple| {
            let walls = [(floor(4.0), above), (floor(2.0), below), (floor(0.0), white)];
            let scene = world_of_walls(&walls, light);
            let rays: Vec<Ray> = (0..300)
                .map(|k| Ray::new(DVec3::new(f64::from(k % 20) * 1e-3, 1.0, 0.0), DVec3::NEG_Y))
                .collect();
            same_in_streams(text, &scene, &rays);
            let integrator = build::<Integrators, Whitted>(text, ()).unwrap();
            let ray = Ray::new(DVec3::new(0.0, 1.0, 0.0), DVec3::NEG_Y);
            integrator.radiance(&scene, &ray, &mut Scratch::default())
        };
        let filtered = "shadows = \"filtered\"";
        let hole = |share: f64| Simple {
            hole: Rgb::new(share, 0.5, 0.0),
            ..Simple::default()
        };
        let glass = |absorption| Simple {
            filter: Rgb::splat(0.5),
            absorption: Rgb::splat(absorption),
            ..Simple::default()
        };
        let opaque = Simple::default();
        for text in ["", filtered] {
            assert_eq!(lit(text, hole(1.0), hole(0.25)), Rgb::new(0.25, 0.25, 0.0));
            assert_eq!(lit(text, hole(1.0), opaque), Rgb::BLACK);
        }
        assert_eq!(lit("", glass(0.0), hole(1.0)), Rgb::BLACK);
        assert_eq!(lit(filtered, glass(0.0), hole(1.0)), Rgb::new(0.5, 0.25, 0.0));
        assert_eq!(lit("shadows = \"none\"", opaque, opaque), Rgb::WHITE);
        // Transmittance below 0.002 counts as 0. It is compared at each surface, not only at the
        // end of the shadow ray.
        assert_eq!(lit("", hole(0.004), hole(0.5)).r, 0.002);
        let thin = Simple {
            hole: Rgb::splat(0.0019),
            ..Simple::default()
        };
        assert_eq!(lit("", thin, hole(1.0)), Rgb::BLACK);
    }

    /// Streams hold the samples of some thousands of lights; those of more are gathered point by
    /// point.
    #[test]
    fn thousands_of_lights_are_the_same_in_streams() {
        let white = Simple {
            diffuse: 1.0,
            ..Simple::default()
        };
        let mut scene = world_of_walls(&[(floor(0.0), white), (floor(-1.0), white)], Lamp::default());
        scene.lights = (0..5000)
            .map(|k| -> Arc<dyn Light> {
                Arc::new(Lamp {
                    lamp: Some((DVec3::new(f64::from(k) * 1e-3, 3.0, 0.0), 1e-3)),
                    ..Lamp::default()
                })
            })
            .collect();
        let rays: Vec<Ray> = (0..30)
            .map(|k| Ray::new(DVec3::new(f64::from(k), 1.0, 0.0), DVec3::NEG_Y))
            .collect();
        same_in_streams("", &scene, &rays);
        let lit = |text: &str| render(text, &scene, DVec3::NEG_Y).0.g;
        assert!(lit("") > 1.0);
        assert_eq!(lit("light_cutoff = 1e-3"), lit(""));
        assert_eq!(lit("light_cutoff = 1.1e-3"), 0.0);
    }

    #[test]
    fn faults_are_refused_at_their_places() {
        let text = "max_depth = 100001\nmin_contribution = -1\nlight_cutoff = -2\nat_max_depth = \"grey\"\nshadows = \"soft\"";
        let errors = build::<Integrators, Whitted>(text, ()).err().unwrap();
        let mut found: Vec<&str> = errors.0.iter().map(|e| &text[e.span.clone().unwrap()]).collect();
        found.sort_unstable();
        assert_eq!(found, ["\"grey\"", "\"soft\"", "-1", "-2", "100001"]);
    }
}
