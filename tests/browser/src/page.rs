//! A report of which everything is known.

use std::path::{Path, PathBuf};
use whitstone_image::Image;
use whitstone_plot::{Axis, Figure, LEFT, SECOND, TOP};
use whitstone_validate::explain::Reason;
use whitstone_validate::report::{Diagram, Extras, html};
use whitstone_validate::{CaseResult, Pictures, Provenance, Results, Status, Summary, WorstPixel};

/// Columns and rows of the pictures.
pub const SIZE: [usize; 2] = [64, 48];
/// A pixel at which ours is twice the reference.
pub const UNEXPLAINED: [usize; 2] = [10, 20];
/// A pixel at an edge.
const EDGE: [usize; 2] = [50, 40];
/// What the second dot of the diagram says, and its command.
pub const DOT: [&str; 2] = [
    "grid, sampler.samples_per_axis=2: RMSE 1.00e-3, 1.00e-1 s",
    "whitstone render scene.toml --set sampler.samples_per_axis=2",
];

/// Ours and the reference: a gradient, of which ours is 1e-5 brighter on the left and darker on the
/// right.
pub fn images() -> [Image; 2] {
    let reference = |x: usize, y: usize| {
        let [u, v] = [x as f32 / SIZE[0] as f32, y as f32 / SIZE[1] as f32];
        [0.1 + 0.5 * u, 0.1 + 0.5 * v, 0.3]
    };
    let factor = |x: usize, y: usize| match [x, y] {
        UNEXPLAINED => 2.0,
        EDGE => 1.05,
        _ if x < SIZE[0] / 2 => 1.0 + 1e-5,
        _ => 1.0 - 1e-5,
    };
    let ours = |x, y| reference(x, y).map(|value| value * factor(x, y));
    let image = |of: &dyn Fn(usize, usize) -> [f32; 3]| {
        Image::from_fn(SIZE[0], SIZE[1], of).expect("the size is one that images may have")
    };
    [image(&ours), image(&reference)]
}

fn case(scene: &str, plugins: &[&str], failed: bool) -> CaseResult {
    let [ours, reference] = images();
    let edge = Reason::Shift { radius_px: 1e-3 };
    let judged = [(UNEXPLAINED, None), (EDGE, Some(edge))];
    let worst = |([x, y], reason): ([usize; 2], Option<Reason>)| {
        let at = |image: &Image| {
            let planes = image.rgb().expect("it is made of R, G and B");
            planes.map(|plane| plane[y * SIZE[0] + x])
        };
        WorstPixel {
            x,
            y,
            ours: at(&ours),
            reference: at(&reference),
            reason,
            between: None,
            tried: None,
            first_difference: None,
            oracle: None,
        }
    };
    CaseResult {
        scene: scene.to_owned(),
        config: "default".to_owned(),
        width: SIZE[0],
        height: SIZE[1],
        samples: 1,
        compared: true,
        rmse: Some(1e-5),
        rel_rmse_interior: Some(1e-5),
        limit: 2e-5,
        mean_reference: Some(0.3),
        bias_limit: 1e-4,
        pixels_over_tolerance: 2,
        explained: 1,
        explained_limit: 8,
        unexplained: usize::from(failed),
        status: Some(if failed { Status::Fail } else { Status::Pass }),
        worst: judged.into_iter().map(worst).collect(),
        plugins: plugins.iter().map(|&plugin| plugin.to_owned()).collect(),
        command: format!("whitstone validate scenes/{scene}.toml"),
        pictures: Pictures::new(&ours, &reference, judged.into_iter()),
        ..CaseResult::default()
    }
}

fn diagram() -> Diagram {
    let (across, up) = (
        Axis::around([0.01, 1.0].into_iter(), LEFT, LEFT + 420.0),
        Axis::around([1e-4, 1e-2].into_iter(), TOP + 260.0, TOP),
    );
    let mut figure = Figure::new("samples", "samples", 1);
    figure.panel(LEFT, &across, &up, "seconds");
    figure.panel(SECOND, &across, &up, "samples");
    figure.dot(
        [across.at(0.02), up.at(5e-3)],
        "#0072b2",
        true,
        "grid, sampler.samples_per_axis=1: RMSE 5.00e-3, 2.00e-2 s\nwhitstone render scene.toml",
    );
    figure.dot([across.at(0.1), up.at(1e-3)], "#0072b2", true, &DOT.join("\n"));
    Diagram {
        name: "samples".to_owned(),
        title: "Samples a pixel".to_owned(),
        about: "Of a test.".to_owned(),
        verdict: "pass".to_owned(),
        svg: figure.finish(),
    }
}

/// Writes the report into a folder, and says where.
pub fn page(folder: &Path) -> std::io::Result<PathBuf> {
    let cases = vec![
        case("materials/mirror", &["material/mirror", "shape/sphere"], false),
        case("shapes/sphere", &["material/matte", "shape/sphere"], true),
        case("shapes/box", &["material/matte", "shape/box"], false),
    ];
    let results = Results {
        summary: Summary::of(&cases, "live".to_owned(), 1.0),
        provenance: Provenance {
            whitstone: "0.1.0".to_owned(),
            threads: 1,
            mitsuba: None,
            povray: None,
        },
        results: cases,
        matrix: Vec::new(),
        skipped: Vec::new(),
    };
    let extras = Extras {
        diagrams: vec![diagram()],
        stress: Vec::new(),
        sensitivity: std::collections::BTreeMap::new(),
        changes: None,
    };
    let path = folder.join("index.html");
    std::fs::write(&path, html(&results, &extras))?;
    Ok(path)
}
