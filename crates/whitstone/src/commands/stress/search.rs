//! `stress --search`: a random search for the worst case of each family.

use super::Arguments;
use crate::terminal::{Exit, Failure, progress};
use std::time::{Duration, Instant};
use whitstone_core::Registry;
use whitstone_stress::search::{Worst, search, traces_rays};
use whitstone_stress::{Family, Lab};

/// Questions of a family that traces single rays for one of any other family, whose questions take
/// longer.
const WEIGHT: u64 = 10;
/// Queries of one step of a family that traces no single rays.
const RAYS: usize = 20;

pub(super) fn run(
    arguments: &Arguments,
    families: &[&'static dyn Family],
    registry: &Registry,
) -> Result<Exit, Failure> {
    let lab = Lab::new(registry, None, RAYS);
    let weights = families.iter().map(|family| match traces_rays(*family) {
        true => WEIGHT,
        false => 1,
    });
    let weights: Vec<u64> = weights.collect();
    let sum: u64 = weights.iter().sum();
    let bar = progress(families.len() as u64, "search");
    let (mut all, mut broken, mut wrong) = (0, 0, 0);
    println!(
        "{:<20} {:>9} {:>6} {:>12}  worst case",
        "family", "questions", "wrong", "error/promise"
    );
    for (family, weight) in families.iter().zip(weights) {
        let name = family.about().name;
        bar.set_message(name);
        let worst = match arguments.seconds {
            Some(seconds) => {
                let end = Instant::now() + Duration::from_secs(seconds) / families.len() as u32;
                search(*family, &lab, arguments.seed, &|_| Instant::now() >= end)
            }
            None => {
                let quota = (arguments.questions * weight).div_ceil(sum);
                search(*family, &lab, arguments.seed, &|questions| questions >= quota)
            }
        };
        let worst = worst.map_err(Failure::environment)?;
        bar.inc(1);
        bar.suspend(|| println!("{}", line(name, &worst)));
        all += worst.questions;
        wrong += worst.wrong;
        broken += u32::from(worst.breaks_promise());
    }
    bar.finish_and_clear();
    println!("questions: {all}, wrong: {wrong}, families that break their promise: {broken}");
    Ok(if broken == 0 { Exit::Pass } else { Exit::Differs })
}

/// All numbers are printed with all digits, so that the case can be repeated.
fn line(name: &str, worst: &Worst) -> String {
    let ray = worst.ray.map_or_else(String::new, |ray| format!(", ray {ray:?}"));
    let verdict = if worst.breaks_promise() {
        "  BREAKS ITS PROMISE"
    } else {
        ""
    };
    format!(
        "{name:<20} {:>9} {:>6} {:>12.3}  at {:?}{ray}{verdict}",
        worst.questions, worst.wrong, worst.judged.share, worst.parameter
    )
}
