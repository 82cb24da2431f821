//! Where both have the shape, our largest error against the oracle is never above Mitsuba's. No
//! harness, as the process must end by [`Mitsuba::exit`]. Where there is no environment for Mitsuba
//! and none can be made, it says so and compares nothing.

use std::fmt::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use whitstone::core::{Aabb, DVec3, Interval, Ray, SelfHitFilter, Transform};
use whitstone::validate::Installation;
use whitstone::validate::environment::Environment;
use whitstone_mitsuba::Mitsuba;
use whitstone_oracle::agreement::{Errors, Subject};
use whitstone_oracle::cases::CASES;
use whitstone_testkit::{Aim, Random, placements};

/// Rays of one case at one place; of a patch, for which the oracle takes some hundredth of a second
/// each, a tenth.
const RAYS: u32 = 600;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Numbers that single precision has, and unit length as far as it goes: the same ray for everyone.
fn rounded(ray: &Ray) -> Ray {
    let [origin, direction] = [ray.origin, ray.direction.normalize()].map(|v| v.as_vec3().as_dvec3());
    Ray::new(origin, direction)
}

/// Errors of one set of rays: ours, those of the textbook form in single precision, and Mitsuba's.
struct Compared {
    name: String,
    ours: Errors,
    textbook: Errors,
    mitsuba: Errors,
}

fn compare(mitsuba: &Mitsuba, scene: &str, name: String, count: u32) -> Option<Compared> {
    let registry = whitstone::registry();
    let scenes = repository().join("scenes");
    let subject = Subject::new(scene, &scenes, &registry).ok()?;
    let world = &subject.pipeline.scene;
    let elements = world
        .geometry
        .elements()
        .map(|element| world.geometry.bounds(element));
    let aim = Aim::at(elements.fold(Aabb::EMPTY, Aabb::union));
    let mut random = Random::new(41);
    let rays: Vec<Ray> = (0..count)
        .map(|number| rounded(&aim.ray(number, &mut random)))
        .collect();
    let camera =
        "camera = { type = \"perspective\", look_at = { origin = [0, 0, 9], target = [0, 0, 0] } }\n";
    let found = mitsuba
        .intersect(&format!("{camera}{scene}"), &scenes, &rays)
        .expect("Mitsuba answers")?;
    let mut compared = Compared {
        name,
        ours: Errors::default(),
        textbook: Errors::default(),
        mitsuba: Errors::default(),
    };
    for (ray, theirs) in rays.iter().zip(found) {
        let truth = subject.oracle.nearest(ray, Interval::FORWARD);
        let ours = world
            .accelerator
            .intersect(ray, Interval::FORWARD, SelfHitFilter::NOTHING);
        compared.ours.add(&truth, ours.map(|hit| hit.t));
        let [o, d] = [ray.origin, ray.direction].map(|v: DVec3| v.as_vec3().to_array());
        compared
            .textbook
            .add(&truth, subject.textbook_f32.intersect(o, d).map(f64::from));
        compared.mitsuba.add(&truth, theirs);
    }
    Some(compared)
}

fn is_worse(one: &Errors, other: &Errors) -> bool {
    one.most_ulps > other.most_ulps || one.wrong_class > other.wrong_class
}

fn main() {
    let environment = match Environment::ensure(&Installation::default(), &|what| println!("{what}")) {
        Ok(environment) => environment,
        Err(error) => {
            println!("skipped: {error}");
            return;
        }
    };
    let mitsuba = Mitsuba::start(&environment).expect("Python starts");
    // Whatever comes of it, the process must not end by itself.
    let passed = catch_unwind(AssertUnwindSafe(|| compare_all(&mitsuba))).is_ok();
    mitsuba.exit(u8::from(!passed))
}

fn compare_all(mitsuba: &Mitsuba) {
    let places: Vec<(&str, Transform)> = placements();
    let mut all = Vec::new();
    for case in CASES {
        for (place, transform) in &places {
            let name = format!(
                "{} ({}), {place}",
                case.shape,
                case.keys.lines().next().unwrap_or_default()
            );
            let scene = case.scene(transform.world_from_object());
            let count = if case.shape == "patch" { RAYS / 10 } else { RAYS };
            all.extend(compare(mitsuba, &scene, name, count));
        }
    }
    let mut table = String::new();
    for Compared {
        name,
        ours,
        textbook,
        mitsuba,
    } in &all
    {
        let part = |errors: &Errors| format!("{:.2e} ulp, {} wrong", errors.most_ulps, errors.wrong_class);
        let _ = writeln!(
            table,
            "{name}: {}; textbook {}; Mitsuba {}",
            part(ours),
            part(textbook),
            part(mitsuba)
        );
    }
    println!("{table}");
    assert!(all.len() > 30, "{} sets of rays", all.len());
    let worse: Vec<&str> = all
        .iter()
        .filter(|set| is_worse(&set.ours, &set.mitsuba))
        .map(|set| set.name.as_str())
        .collect();
    assert_eq!(worse, Vec::<&str>::new(), "{table}");
    // The textbook form in our place would not pass.
    let count = all
        .iter()
        .filter(|set| is_worse(&set.textbook, &set.mitsuba))
        .count();
    assert!(count > 5, "{table}");
    println!(
        "{} sets of rays: ours is never worse than Mitsuba, the textbook form in {count}",
        all.len()
    );
}
