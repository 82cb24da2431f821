//! `bench`: benchmarks Whitstone against other renderers, with the same rays in the same run.

mod accelerators;
mod backend;
mod chart;
mod choice;
mod culling;
mod data;
mod efficiency;
mod fetch;
mod growth;
mod import;
pub(crate) mod light_paths;
mod lights;
pub(crate) mod machine;
mod motion;
mod picture;
pub(crate) mod plugins;
mod povray;
mod prepare;
mod rasterizer;
mod rays;
pub(crate) mod scale;
mod scaling;
mod shapes;
mod shapes_mitsuba;
mod sizes;
mod worst_cases;

use clap::{Args, Subcommand};
use whitstone::core::Registry;
use whitstone::core::simd::Level;
use whitstone::{Exit, Failure};

/// Benchmark whole scenes with Whitstone and Mitsuba, interleaved, and print medians and ratios
///
/// The subcommands are benchmarks of single parts.
#[derive(Args, Debug)]
#[command(
    args_conflicts_with_subcommands = true,
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  cargo xtask bench\n  taskset -c 0 cargo xtask bench --povray\n  cargo xtask bench --fps\n  taskset -c 0 cargo xtask bench accelerators --quick"
)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    what: Option<What>,
    #[command(flatten)]
    picture: picture::Arguments,
}

#[derive(Subcommand, Debug)]
enum What {
    Accelerators(accelerators::Arguments),
    Culling(culling::Arguments),
    Efficiency(efficiency::Arguments),
    Growth(growth::Arguments),
    Import(import::Arguments),
    LightPaths(light_paths::Arguments),
    Lights(lights::Arguments),
    Motion(motion::Arguments),
    Plugins(plugins::Arguments),
    Rasterizer(rasterizer::Arguments),
    Scale(scale::Arguments),
    Scaling(scaling::Arguments),
    Shapes(shapes::Arguments),
    Sizes(sizes::Arguments),
    WorstCases(worst_cases::Arguments),
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    Level::wanted().map_err(Failure::usage)?;
    match &arguments.what {
        None => picture::run(&arguments.picture, registry),
        Some(What::Accelerators(arguments)) => accelerators::run(arguments, registry),
        Some(What::Culling(arguments)) => culling::run(arguments, registry),
        Some(What::Efficiency(arguments)) => efficiency::run(arguments, registry),
        Some(What::Growth(arguments)) => growth::run(arguments, registry),
        Some(What::Import(arguments)) => import::run(arguments, registry),
        Some(What::LightPaths(arguments)) => light_paths::run(arguments, registry),
        Some(What::Lights(arguments)) => lights::run(arguments, registry),
        Some(What::Motion(arguments)) => motion::run(arguments, registry),
        Some(What::Plugins(arguments)) => plugins::run(arguments, registry),
        Some(What::Rasterizer(arguments)) => rasterizer::run(arguments, registry),
        Some(What::Scale(arguments)) => scale::run(arguments, registry),
        Some(What::Scaling(arguments)) => scaling::run(arguments, registry),
        Some(What::Shapes(arguments)) => shapes::run(arguments, registry),
        Some(What::Sizes(arguments)) => sizes::run(arguments, registry),
        Some(What::WorstCases(arguments)) => worst_cases::run(arguments, registry),
    }
}

/// NaN for an empty slice.
fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => values[n / 2],
        n => 0.5 * (values[n / 2 - 1] + values[n / 2]),
    }
}
