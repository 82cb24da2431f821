//! `stress --kernel`: judges the ray-triangle kernel of another program.

use super::Arguments;
use crate::interrupt;
use crate::terminal::{Exit, Failure, set_message, spinner, write_json};
use serde_json::json;
use std::ffi::OsString;
use std::process::Command;
use std::time::Duration;
use whitstone_core::Registry;
use whitstone_stress::{KernelReport, Lab, judge_kernel};

/// Runs the command.
pub(super) fn run(
    arguments: &Arguments,
    registry: &Registry,
    program: &OsString,
    rest: &[OsString],
) -> Result<Exit, Failure> {
    let rays = arguments.rays as usize;
    let lab = Lab::new(registry, None, rays);
    let mut command = Command::new(program);
    command.args(rest);
    let bar = spinner("kernel");
    let stage = |text: &str| set_message(&bar, text);
    let limit = Duration::from_secs(arguments.time_limit);
    let folder = arguments.target.folder().join("kernel");
    // The kernel has a process group of its own, which a signal to this process does not reach.
    let watching = interrupt::Watching::new();
    let reports = judge_kernel(&lab, command, limit, interrupt::stop(), &folder, rays, &stage);
    drop(watching);
    bar.finish_and_clear();
    if let Some(signal) = interrupt::signal() {
        let kept = "the kernel was stopped".to_owned();
        return Err(Failure::Interrupted { signal, kept });
    }
    let reports = reports.map_err(Failure::environment)?;
    print(&reports);
    if let Some(path) = &arguments.json {
        write_json(path, &json!({ "kernel": reports }))?;
    }
    Ok(match reports.iter().all(KernelReport::is_right) {
        true => Exit::Pass,
        false => Exit::Differs,
    })
}

fn print(reports: &[KernelReport]) {
    println!(
        "{:<10} {:>9} {:>9} {:>9} {:>7} {:>10} {:>10} {:>13} {:>9}",
        "mesh",
        "triangles",
        "rays",
        "hits",
        "holes",
        "wrong hits",
        "near edges",
        "largest error",
        "us per ray"
    );
    for report in reports {
        println!(
            "{:<10} {:>9} {:>9} {:>9} {:>7} {:>10} {:>10} {:>13.1e} {:>9.2}",
            report.mesh,
            report.triangles,
            report.rays,
            report.hits,
            report.holes,
            report.wrong_hits,
            report.near_edges,
            report.largest_error,
            1e6 * report.seconds / report.rays.max(1) as f64
        );
        for example in &report.examples {
            println!("  {example}");
        }
        if let Some(why) = &report.skipped {
            println!("  some rays were skipped: {why}");
        }
    }
    let wrong: usize = reports
        .iter()
        .map(|report| report.holes + report.wrong_hits)
        .sum();
    match wrong {
        0 => println!("pass"),
        wrong => println!("DIFFERS: {wrong} wrong answers"),
    }
}
