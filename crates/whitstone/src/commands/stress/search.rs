//! `stress --search`: a random search for the worst case of each family.

use super::Arguments;
use crate::terminal::{Exit, Failure, progress};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};
use whitstone_core::Registry;
use whitstone_stress::search::{Worst, search, traces_rays};
use whitstone_stress::{Family, Lab};

/// Questions of a family that traces single rays for one of any other family, whose questions take
/// longer.
const WEIGHT: u64 = 10;
/// Queries of one step of a family that traces no single rays.
const RAYS: usize = 20;

/// Questions after which a search begins anew, with the next seed: no search stays for long at a
/// local maximum, and a large number of questions keeps all cores busy.
const PART: u64 = 2_000;

pub(super) fn run(
    arguments: &Arguments,
    families: &[&'static dyn Family],
    registry: &Registry,
) -> Result<Exit, Failure> {
    let lab = Lab::new(registry, None, RAYS);
    let threads = thread::available_parallelism().map_or(1, usize::from);
    let parts = parts(arguments, families, threads);
    let bar = progress(parts.len() as u64, "search");
    let next = AtomicUsize::new(0);
    let found: Mutex<BTreeMap<usize, Worst>> = Mutex::new(BTreeMap::new());
    let search_parts = || -> Result<(), String> {
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            let Some(part) = parts.get(number) else {
                return Ok(());
            };
            let start = Instant::now();
            let is_done = |questions| match part.limit {
                Limit::Questions(limit) => questions >= limit,
                Limit::Time(limit) => start.elapsed() >= limit,
            };
            let worst = search(families[part.family], &lab, part.seed, &is_done)?;
            let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
            found.insert(number, worst);
            bar.inc(1);
        }
    };
    thread::scope(|scope| {
        let threads: Vec<_> = (0..threads).map(|_| scope.spawn(search_parts)).collect();
        let ends = threads.into_iter().map(|thread| {
            thread
                .join()
                .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        });
        ends.collect::<Result<(), String>>()
    })
    .map_err(Failure::environment)?;
    bar.finish_and_clear();
    // In the order of the parts, so that threads do not decide between equally bad cases.
    let mut of_family: BTreeMap<usize, Worst> = BTreeMap::new();
    for (number, worst) in found.into_inner().unwrap_or_else(PoisonError::into_inner) {
        of_family
            .entry(parts[number].family)
            .and_modify(|all| *all = all.merged(worst))
            .or_insert(worst);
    }
    println!(
        "{:<20} {:>9} {:>6} {:>12}  worst case",
        "family", "questions", "wrong", "error/promise"
    );
    for (family, worst) in &of_family {
        println!("{}", line(families[*family].about().name, worst));
    }
    let questions: u64 = of_family.values().map(|worst| worst.questions).sum();
    let wrong: u64 = of_family.values().map(|worst| worst.wrong).sum();
    let broken = of_family.values().filter(|worst| worst.breaks_promise()).count();
    println!("questions: {questions}, wrong: {wrong}, families that break their promise: {broken}");
    Ok(if broken == 0 { Exit::Pass } else { Exit::Differs })
}

/// When a part ends.
#[derive(Clone, Copy)]
enum Limit {
    Questions(u64),
    Time(Duration),
}

/// One search.
struct Part {
    /// Index of its family.
    family: usize,
    seed: u64,
    limit: Limit,
}

/// The searches whose questions or times add up to what is asked for.
fn parts(arguments: &Arguments, families: &[&'static dyn Family], threads: usize) -> Vec<Part> {
    let weights = families.iter().map(|family| match traces_rays(*family) {
        true => WEIGHT,
        false => 1,
    });
    let weights: Vec<u64> = weights.collect();
    let sum: u64 = weights.iter().sum();
    let mut parts = Vec::new();
    for (family, weight) in weights.into_iter().enumerate() {
        let part = |number: u64, limit| Part {
            family,
            seed: arguments.seed.wrapping_add(number),
            limit,
        };
        match arguments.seconds {
            Some(seconds) => {
                // On fewer threads than families, each thread searches several in turn.
                let share = Duration::from_secs(seconds) * threads as u32 / families.len() as u32;
                parts.push(part(0, Limit::Time(share.min(Duration::from_secs(seconds)))));
            }
            None => {
                let quota = (arguments.questions * weight).div_ceil(sum);
                let number = quota.div_ceil(PART);
                let limit = Limit::Questions(quota.div_ceil(number.max(1)));
                parts.extend((0..number).map(|number| part(number, limit)));
            }
        }
    }
    parts
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
