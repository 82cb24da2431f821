//! `bench motion`: refitting `bvh` and `obb_bvh` to moved triangles, compared with a new build.
//!
//! The triangles are those of balls on a grid. They move in three ways by a growing amount: each
//! ball in a direction of its own, all twisted about an axis, and all as one rigid body.

use super::choice::{self, Choice};
use super::data::Query;
use super::machine::{date, load, processor, processor_time};
use super::median;
use super::rays::{Mode, Rays};
use crate::pages;
use clap::Args;
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::sync::Arc;
use whitstone::core::simd::Level;
use whitstone::core::{
    Accelerator, DAffine3, DVec3, Geometry, Interval, LoweredShape, Ray, Registry, TriangleMesh,
};
use whitstone::{Exit, Failure};

/// The page with the table.
const PAGE: &str = "docs/motion.md";
const MARKERS: [&str; 2] = [
    "<!-- motion: written by `cargo xtask bench motion --page` -->",
    "<!-- end of motion -->",
];
/// The accelerators that can be refitted.
const ACCELERATORS: [&str; 2] = ["bvh", "obb_bvh"];
/// Times per ray that differ by less than this factor count as equal.
const NOISE: f64 = 1.1;
/// Distance of neighbouring balls, in radii.
const SPACING: f64 = 3.0;
/// Quads of a ball around its axis, and along it.
const QUADS: [u32; 2] = [16, 10];

/// Measure the refit of hierarchies to moved triangles, compared with a new build
///
/// For each motion and amount: processor times of refit and build, the SAH cost and the time per
/// ray of both hierarchies, and the number of rays whose answers differ.
///
/// Exit code 1 if an answer differs.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  taskset -c 0 cargo xtask bench motion\n  taskset -c 0 cargo xtask bench motion --page"
)]
pub(crate) struct Arguments {
    /// Number of balls along each of three sides of the grid
    #[arg(long, value_name = "COUNT", default_value_t = 7)]
    balls: u32,
    /// Number of rays
    #[arg(long, value_name = "COUNT", default_value_t = 50_000)]
    rays: u32,
    /// Number of rounds; each measures everything once
    #[arg(long, value_name = "COUNT", default_value_t = 5)]
    rounds: usize,
    /// Write the table into docs/motion.md
    #[arg(long)]
    page: bool,
}

/// How the balls move.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Motion {
    /// Each in its own direction; the amount is in distances of neighbours.
    Apart,
    /// About the vertical axis; the amount is in turns from the bottom to the top.
    Twist,
    /// As a rigid body; the amount is in turns.
    Turn,
}

/// The motions, each with its amounts.
const MOTIONS: [(Motion, &str, &[f64]); 3] = [
    (
        Motion::Apart,
        "apart, by neighbour distances",
        &[0.0, 0.1, 0.5, 1.0, 2.0, 4.0],
    ),
    (Motion::Twist, "twist, by turns", &[0.05, 0.25, 1.0]),
    (Motion::Turn, "rigid, by turns", &[0.05, 0.125]),
];

impl Motion {
    /// The rotation of all points, if it is one.
    fn rigid(self, amount: f64) -> Option<DAffine3> {
        let axis = DVec3::new(1.0, 2.0, 3.0).normalize();
        (self == Self::Turn).then(|| DAffine3::from_axis_angle(axis, TAU * amount))
    }

    /// The place of a point of a ball.
    fn apply(self, amount: f64, ball: u32, height: f64, p: DVec3) -> DVec3 {
        match self {
            Self::Apart => p + amount * SPACING * direction(ball),
            Self::Twist => {
                let (sin, cos) = (TAU * amount * p.y / height).sin_cos();
                DVec3::new(cos * p.x + sin * p.z, p.y, cos * p.z - sin * p.x)
            }
            Self::Turn => self.rigid(amount).map_or(p, |rigid| rigid.transform_point3(p)),
        }
    }
}

/// Pseudo-random numbers from 0 to 1: the hash of the model's height fields.
fn random(number: u32) -> f64 {
    let mut x = number.wrapping_add(0x9e37_79b9);
    x = (x ^ x >> 16).wrapping_mul(0x7feb_352d);
    x = (x ^ x >> 15).wrapping_mul(0x846c_a68b);
    f64::from(x ^ x >> 16) / f64::from(u32::MAX)
}

/// A direction, evenly distributed.
fn direction(number: u32) -> DVec3 {
    let (z, angle) = (2.0 * random(2 * number) - 1.0, TAU * random(2 * number + 1));
    let radius = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(radius * angle.cos(), radius * angle.sin(), z)
}

/// Half the side of the grid.
fn half(balls: u32) -> f64 {
    0.5 * SPACING * f64::from(balls)
}

/// The moved balls, as one mesh.
fn geometry(balls: u32, motion: Motion, amount: f64) -> Arc<Geometry> {
    let [around, along] = QUADS;
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for ball in 0..balls.pow(3) {
        let place = |k: u32| SPACING * (f64::from(k % balls) + 0.5) - half(balls);
        let center = DVec3::new(place(ball), place(ball / balls), place(ball / balls / balls));
        let first = positions.len() as u32;
        for j in 0..=along {
            for i in 0..=around {
                // Without poles: a triangle there would have no area.
                let (phi, theta) = (
                    TAU * f64::from(i) / f64::from(around),
                    0.5 * TAU * (f64::from(j) + 0.5) / f64::from(along + 1),
                );
                let out = DVec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin());
                positions.push(motion.apply(amount, ball, 2.0 * half(balls), center + out));
            }
        }
        for j in 0..along {
            for i in 0..around {
                let corner = first + j * (around + 1) + i;
                let [a, b, c, d] = [corner, corner + 1, corner + around + 1, corner + around + 2];
                triangles.extend([[a, b, c], [d, c, b]]);
            }
        }
    }
    Arc::new(Geometry::new(vec![LoweredShape::Triangles(TriangleMesh {
        positions,
        triangles,
        orientation: 1.0,
        ..TriangleMesh::default()
    })]))
}

/// Rays from all sides to points among the balls.
fn rays(count: u32, balls: u32) -> Rays {
    let half = half(balls);
    let ray = |number: u32| {
        let origin = 4.0 * half * direction(1_000_000 + number);
        let place = |axis: u32| half * (2.0 * random(10_000_000 + 3 * number + axis) - 1.0);
        let target = DVec3::new(place(0), place(1), place(2));
        (Ray::new(origin, (target - origin).normalize()), Interval::FORWARD)
    };
    Rays::new((0..count).map(ray).collect::<Vec<Query>>(), false)
}

/// Seconds of processor time, and the result.
fn timed<T>(work: impl FnOnce() -> T) -> (f64, T) {
    let start = processor_time();
    let result = work();
    (processor_time() - start, result)
}

/// What is measured of one accelerator at one place: of the refit, then of the build.
#[derive(Debug, Default)]
struct Measured {
    seconds: [f64; 2],
    cost: [f64; 2],
    nanoseconds: [f64; 2],
    /// Rays whose answers differ.
    wrong: usize,
}

fn measure(
    registry: &Registry,
    kind: &str,
    (motion, amount): (Motion, f64),
    rays: &Rays,
    arguments: &Arguments,
) -> Result<Measured, Failure> {
    let choice = Choice::parse(kind);
    let build = |geometry: &Arc<Geometry>| choice::build(registry, &choice, geometry).map_err(Failure::usage);
    let old = build(&geometry(arguments.balls, motion, 0.0))?;
    let moved = geometry(arguments.balls, motion, amount);
    let rigid = motion.rigid(amount);
    let mut seconds = [Vec::new(), Vec::new()];
    let mut tracing = [Vec::new(), Vec::new()];
    let mut measured = Measured::default();
    // The first round touches pages.
    for round in 0..=arguments.rounds.max(1) {
        let (refit, refitted) = timed(|| old.refitted(&moved, rigid.as_ref()));
        let (rebuild, built) = timed(|| build(&moved));
        let Some(refitted) = refitted else {
            return Err(Failure::usage(format!("{kind} cannot be refitted")));
        };
        let both: [Box<dyn Accelerator>; 2] = [refitted, built?];
        if round == 0 {
            let cost = |of: &dyn Accelerator| of.statistics().get("sah_cost").copied().unwrap_or(f64::NAN);
            measured.cost = [cost(&*both[0]), cost(&*both[1])];
            let expected = rays.answers(&*both[1], Mode::Single);
            for mode in Mode::ALL {
                measured.wrong += rays.difference(&*both[0], mode, &expected).mismatches;
            }
            continue;
        }
        for (of, time) in seconds.iter_mut().zip([refit, rebuild]) {
            of.push(time);
        }
        for (of, accelerator) in tracing.iter_mut().zip(&both) {
            let (time, _) = timed(|| rays.pass(&**accelerator, Mode::Single));
            of.push(1e9 * time / rays.len() as f64);
        }
    }
    measured.seconds = seconds.map(|mut of| median(&mut of));
    measured.nanoseconds = tracing.map(|mut of| median(&mut of));
    Ok(measured)
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let balls = arguments.balls.clamp(1, 32);
    let arguments = &Arguments { balls, ..*arguments };
    let rays = rays(arguments.rays.max(1), balls);
    let triangles = 2 * QUADS[0] * QUADS[1] * balls.pow(3);
    let mut text = format!(
        "{}, {}, {}.\n{triangles} triangles of {} balls, {} rays. Processor times, medians of {} rounds. Load {:.1}.\n\n\
         | motion | amount | accelerator | refit | build | SAH cost after refit | after build | ns/ray after refit | after build | rays from which a build pays | wrong answers |\n\
         |---|---|---|---|---|---|---|---|---|---|---|",
        processor().unwrap_or_else(|| "unknown processor".to_owned()),
        Level::current(),
        date(),
        balls.pow(3),
        rays.len(),
        arguments.rounds.max(1),
        load(),
    );
    let mut wrong = 0;
    for (motion, name, amounts) in MOTIONS {
        for &amount in amounts {
            for kind in ACCELERATORS {
                let found = measure(registry, kind, (motion, amount), &rays, arguments)?;
                let [refit, build] = found.seconds;
                let [slow, fast] = found.nanoseconds;
                let pays = 1e9 * (build - refit) / (slow - fast);
                wrong += found.wrong;
                let _ = write!(
                    text,
                    "\n| {name} | {amount} | `{kind}` | {:.1} ms | {:.1} ms | {:.1} | {:.1} | {slow:.0} | {fast:.0} | {} | {} |",
                    1e3 * refit,
                    1e3 * build,
                    found.cost[0],
                    found.cost[1],
                    if slow > NOISE * fast {
                        format!("{:.0} thousand", pays / 1e3)
                    } else {
                        "–".to_owned()
                    },
                    found.wrong,
                );
            }
        }
    }
    println!("{text}");
    if wrong > 0 {
        return Ok(Exit::Differs);
    }
    if arguments.page {
        pages::between(PAGE, MARKERS, &text)?;
    }
    Ok(Exit::Pass)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Refits give the answers of builds, and are worse where the balls mix.
    #[test]
    fn refits_answer_as_builds_do() {
        let registry = whitstone::registry();
        let arguments = Arguments {
            balls: 3,
            rays: 500,
            rounds: 1,
            page: false,
        };
        let rays = rays(arguments.rays, arguments.balls);
        for kind in ACCELERATORS {
            for (motion, _, amounts) in MOTIONS {
                let amount = amounts[amounts.len() - 1];
                let found = measure(&registry, kind, (motion, amount), &rays, &arguments).unwrap();
                assert_eq!(found.wrong, 0, "{kind} {motion:?}");
                let [refit, build] = found.cost;
                assert!(refit > 0.0 && build > 0.0);
                if motion == Motion::Apart {
                    assert!(refit > 1.2 * build, "{kind}: {refit} and {build}");
                }
            }
        }
        assert!(
            rays.pass(
                &*choice::build(&registry, &Choice::parse("bvh"), &geometry(3, Motion::Turn, 0.1)).unwrap(),
                Mode::Single
            ) > 100
        );
    }
}
