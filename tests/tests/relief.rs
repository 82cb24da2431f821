//! A relief that is there beside one in the shading only: what bump mapping shows as well as
//! displacement, and what it cannot.

use whitstone::core::DVec3;
use whitstone::core::{Rgb, Scratch};
use whitstone::render::Pipeline;
use whitstone_tests::{load, root};

fn built(scene: &str, overrides: &[&str]) -> Pipeline {
    let path = root().join("scenes/showcase").join(scene);
    let overrides: Vec<String> = overrides.iter().map(|text| (*text).to_owned()).collect();
    load(&path, &overrides, &whitstone::registry()).unwrap_or_else(|report| panic!("{report}"))
}

/// What a pixel shows: the number of the first shape, where it is, and the radiance.
struct Seen {
    shape: i64,
    place: DVec3,
    radiance: Rgb,
}

const FLOOR: i64 = 0;
const BALL: i64 = 1;

fn seen(pipeline: &Pipeline) -> Vec<Seen> {
    let size = pipeline.film.size;
    let all = (0..size.height).flat_map(|y| (0..size.width).map(move |x| [x, y]));
    all.map(|pixel| {
        let mut scratch = Scratch::recording();
        let radiance = pipeline.pixel(pixel, &mut scratch);
        let nodes = scratch.record.unwrap();
        let first = nodes.iter().find(|node| node.path.is_empty()).unwrap();
        Seen {
            shape: first.shape,
            place: first.position,
            radiance,
        }
    })
    .collect()
}

/// How two pictures of the ball differ.
struct Difference {
    /// Root of the mean squared difference over the mean, in the middle of the ball: within 60
    /// degrees of the view.
    interior: f64,
    /// Pixels of which one shows the ball and the other what is behind it.
    outline: usize,
    /// Pixels of the floor that are in the shadow of one ball and not of the other.
    shadow: usize,
}

fn difference(a: &Pipeline, b: &Pipeline) -> Difference {
    let eye = DVec3::new(0.0, 1.6, 5.0).normalize();
    let (a, b) = (seen(a), seen(b));
    let (mut squares, mut sum, mut count) = (0.0, 0.0, 0.0);
    let mut found = Difference {
        interior: 0.0,
        outline: 0,
        shadow: 0,
    };
    for (a, b) in a.iter().zip(&b) {
        if a.shape != b.shape {
            found.outline += usize::from(a.shape == BALL || b.shape == BALL);
        } else if a.shape == FLOOR {
            let (least, most) = (a.radiance.g.min(b.radiance.g), a.radiance.g.max(b.radiance.g));
            found.shadow += usize::from(least < 0.5 * most);
        } else if a.shape == BALL && b.place.normalize().dot(eye) > 0.5 {
            squares += (a.radiance.g - b.radiance.g).powi(2);
            sum += b.radiance.g;
            count += 1.0;
        }
    }
    found.interior = (squares / count).sqrt() / (sum / count);
    found
}

/// The numbers of the documentation of bump.
#[test]
fn bump_mapping_fails_at_outlines_and_in_shadows() {
    let displaced = built("displacement.toml", &[]);
    let bumped = built("bump_sphere.toml", &[]);
    let smooth = built("displacement.toml", &["shape.ball.displacement.scale=0"]);
    let Difference {
        interior,
        outline,
        shadow,
    } = difference(&bumped, &displaced);
    let without = difference(&smooth, &displaced);
    println!(
        "interior {interior:.3}, without a relief {:.3}; outline {outline}, shadow {shadow}",
        without.interior
    );
    // The shading is nearly that of the relief, ...
    assert!(interior < 0.4 * without.interior);
    // ... the outline and the shadow are those of the smooth ball.
    assert_eq!((outline, shadow), (without.outline, without.shadow));
    let none = difference(&bumped, &smooth);
    assert_eq!((none.outline, none.shadow), (0, 0));
    let text = std::fs::read_to_string(root().join("crates/materials/src/bump.rs")).unwrap();
    let words: Vec<&str> = text.split_whitespace().collect();
    let told = format!(
        "differs by {:.0}% of the mean in the middle of the ball; a smooth ball differs from the displaced one by {:.0}%. With bumps, {outline} of the {} x {} pixels are wrong at the silhouette, and {shadow} in the shadow",
        100.0 * interior,
        100.0 * without.interior,
        bumped.film.size.width,
        bumped.film.size.height,
    );
    let one_line = words.join(" ").replace(" /// ", " ");
    assert!(one_line.contains(&told), "bump.rs does not say: {told}");
}
