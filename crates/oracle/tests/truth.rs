//! Tests the oracle against closed forms, against an independent evaluation, and against textbook
//! formulas that must fail.

use dashu_float::FBig;
use std::path::Path;
use whitstone_core::{DVec3, Interval, Ray};
use whitstone_oracle::agreement::{Agreement, Errors};
use whitstone_oracle::naive::{Textbook, textbook};
use whitstone_oracle::{Nearest, Oracle};
use whitstone_scene::{Description, Sources};
use whitstone_testkit::{Aim, Random};

fn with<T>(text: &str, use_it: impl FnOnce(&Description<'_>) -> T) -> T {
    let camera = "camera = { type = \"perspective\" }\n";
    let sources = Sources::from_text("test", &format!("{camera}{text}"), Path::new("."), &[]).unwrap();
    use_it(&Description::parse(&sources).into_result().unwrap())
}

fn oracle(keys: &str) -> Oracle {
    with(&format!("[[shape]]\n{keys}"), |description| {
        Oracle::new(description, 0).unwrap()
    })
}

fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
    Ray::new(origin.into(), direction.into())
}

/// The doubles nearest to all roots; `None` if they are undecided.
fn roots(keys: &str, origin: [f64; 3], direction: [f64; 3]) -> Option<Vec<f64>> {
    let roots = oracle(keys).roots(&ray(origin, direction))?;
    Some(roots.iter().map(|root| root.t.nearest()).collect())
}

const TO_X: [f64; 3] = [1.0, 0.0, 0.0];
const DOWN: [f64; 3] = [0.0, 0.0, -1.0];

#[test]
fn round_shapes_are_met_where_closed_forms_say() {
    let sphere = "type = \"sphere\"";
    assert_eq!(roots(sphere, [-3.0, 0.6, 0.0], TO_X), Some(vec![2.2, 3.8]));
    // A tangent line, and one that misses by one unit in the last place.
    assert_eq!(roots(sphere, [-3.0, 1.0, 0.0], TO_X), None);
    assert_eq!(roots(sphere, [-3.0, 1.0f64.next_up(), 0.0], TO_X), Some(vec![]));
    let inside = roots(sphere, [-3.0, 1.0f64.next_down(), 0.0], TO_X).unwrap();
    // sqrt(1 - (1 - 2^-53)²).
    let half = (2f64.powi(-52) - 2f64.powi(-106)).sqrt();
    assert_eq!(inside, [3.0 - half, 3.0 + half]);
    // From a point on the surface: t = 0 is no hit.
    match oracle(sphere).nearest(&ray([-1.0, 0.0, 0.0], TO_X), Interval::FORWARD) {
        Nearest::Hit { t, condition, .. } => {
            assert_eq!(t.nearest(), 2.0);
            assert!((1.0..4.0).contains(&condition), "{condition}");
        }
        other => panic!("{other:?}"),
    }
    // A viewer two metres above a planet.
    let planet = "type = \"sphere\"\nradius = 1e8\ncenter = [0, 0, -1e8]";
    assert_eq!(roots(planet, [0.0, 0.0, 2.0], DOWN), Some(vec![2.0, 2e8 + 2.0]));

    let torus = "type = \"torus\"\nmajor_radius = 2\nminor_radius = 0.5";
    assert_eq!(
        roots(torus, [-4.0, 0.0, 0.0], TO_X),
        Some(vec![1.5, 2.5, 5.5, 6.5])
    );
    assert_eq!(roots(torus, [0.0, 0.0, 9.0], DOWN), Some(vec![]));
    assert_eq!(roots(torus, [2.0, 0.0, 9.0], DOWN), Some(vec![8.5, 9.5]));
    assert_eq!(roots(torus, [-9.0, 0.0, 0.5], TO_X), None);
    assert_eq!(roots(torus, [-9.0, 0.0, 0.5f64.next_up()], TO_X), Some(vec![]));
    assert_eq!(
        roots(torus, [-9.0, 0.0, 0.5f64.next_down()], TO_X).map(|all| all.len()),
        Some(4)
    );
}

#[test]
fn flat_shapes_are_closed_and_lines_in_them_are_not_decided() {
    for (shape, edge) in [("rectangle", 1.0), ("disk", 1.0)] {
        let keys = format!("type = \"{shape}\"");
        assert_eq!(roots(&keys, [edge, 0.0, 2.0], DOWN), Some(vec![2.0]), "{shape}");
        assert_eq!(
            roots(&keys, [f64::next_up(edge), 0.0, 2.0], DOWN),
            Some(vec![]),
            "{shape}"
        );
        assert_eq!(roots(&keys, [-2.0, 0.0, 0.0], TO_X), None);
        assert_eq!(roots(&keys, [-2.0, 0.0, 1e-300], TO_X), Some(vec![]));
    }
    let cube = "type = \"box\"";
    // In a face, along an edge, through corners, and next to them.
    assert_eq!(roots(cube, [-2.0, 1.0, 0.5], TO_X), Some(vec![1.0, 3.0]));
    assert_eq!(roots(cube, [-2.0, 1.0, 1.0], TO_X), Some(vec![1.0, 3.0]));
    assert_eq!(roots(cube, [-2.0, 1.0f64.next_up(), 1.0], TO_X), Some(vec![]));
    assert_eq!(
        roots(cube, [2.0, 0.0, 1.0], [-1.0, 1.0, 0.0]),
        Some(vec![1.0, 1.0])
    );
    assert_eq!(
        roots(cube, [-3.0, -3.0, -3.0], [2.0, 2.0, 2.0]),
        Some(vec![1.0, 2.0])
    );
    let triangle = "type = \"triangle\"\nvertices = [[0, 0, 0], [3, 0, 0], [0, 3, 0]]";
    for (x, y, hit) in [
        (1.0, 1.0, true),
        (1.5, 1.5, true),
        (0.0, 0.0, true),
        (1.5, 1.6, false),
    ] {
        let expected = if hit { vec![2.0] } else { vec![] };
        assert_eq!(roots(triangle, [x, y, 4.0], [0.0, 0.0, -2.0]), Some(expected));
    }
    let arrow = "type = \"polygon\"\nvertices = [[0, 0, 0], [2, 1, 0], [0, 2, 0], [1, 1, 0]]";
    assert_eq!(roots(arrow, [0.5, 1.0, 1.0], DOWN), Some(vec![]));
    assert_eq!(roots(arrow, [1.5, 1.0, 1.0], DOWN), Some(vec![1.0]));
    let ground = "type = \"heightfield\"\namplitude = 0\ncolumns = 3\nrows = 2";
    assert_eq!(roots(ground, [0.1, 0.2, 0.75], DOWN), Some(vec![0.75]));
}

#[test]
fn prisms_and_lathes_have_the_roots_of_their_outlines() {
    let away = [0.0, -1.0, 0.0];
    // The letter U, open towards +z.
    let letter = "type = \"prism\"\noutline = [[0, 0], [3, 0], [3, 2], [2, 2], [2, 1], [1, 1], [1, 2], [0, 2]]\ny = [1, 3]";
    assert_eq!(
        roots(letter, [-1.0, 2.0, 1.5], TO_X),
        Some(vec![1.0, 2.0, 3.0, 4.0])
    );
    assert_eq!(roots(letter, [-1.0, 2.0, 0.5], TO_X), Some(vec![1.0, 4.0]));
    assert_eq!(roots(letter, [-1.0, 3.5, 0.5], TO_X), Some(vec![]));
    assert_eq!(roots(letter, [0.5, 5.0, 1.5], away), Some(vec![2.0, 4.0]));
    assert_eq!(roots(letter, [1.5, 5.0, 1.5], away), Some(vec![]));
    // In through a cap, out through a side.
    assert_eq!(
        roots(letter, [2.25, 4.0, 1.5], [1.0, -2.0, 0.0]),
        Some(vec![0.5, 0.75])
    );
    // In a face, and along an edge.
    assert_eq!(roots(letter, [-1.0, 2.0, 0.0], TO_X), None);
    assert_eq!(roots(letter, [2.0, 5.0, 2.0], away), None);

    // A pot: its bottom has the radius 2, its inside the radius 1.
    let pot = "type = \"lathe\"\noutline = [[0, 0], [2, 0], [2, 4], [1, 4], [1, 1], [0, 1]]";
    assert_eq!(roots(pot, [-5.0, 2.0, 0.0], TO_X), Some(vec![3.0, 4.0, 6.0, 7.0]));
    assert_eq!(roots(pot, [-5.0, 0.5, 0.0], TO_X), Some(vec![3.0, 7.0]));
    assert_eq!(roots(pot, [0.5, 5.0, 0.0], away), Some(vec![4.0, 5.0]));
    assert_eq!(roots(pot, [0.0, 5.0, 1.5], away), Some(vec![1.0, 5.0]));
    assert_eq!(roots(pot, [0.0, 5.0, 2.5], away), Some(vec![]));
    // An open cone with the apex below.
    let funnel = "type = \"lathe\"\noutline = [[0, 0], [3, 4]]";
    assert_eq!(roots(funnel, [-5.0, 2.0, 0.0], TO_X), Some(vec![3.5, 6.5]));
    assert_eq!(roots(funnel, [1.5, 5.0, 0.0], away), Some(vec![3.0]));
    // A solid is entered and left in turn, in either sense of the outline.
    for shape in [
        letter.to_owned(),
        pot.to_owned(),
        letter.replace(
            "[0, 0], [3, 0], [3, 2], [2, 2], [2, 1], [1, 1], [1, 2], [0, 2]",
            "[0, 2], [1, 2], [1, 1], [2, 1], [2, 2], [3, 2], [3, 0], [0, 0]",
        ),
        pot.replace(
            "[0, 0], [2, 0], [2, 4], [1, 4], [1, 1], [0, 1]",
            "[0, 1], [1, 1], [1, 4], [2, 4], [2, 0], [0, 0]",
        ),
    ] {
        let oracle = oracle(&shape);
        let mut random = Random::new(31);
        let mut checked = 0;
        for _ in 0..300 {
            let origin = 6.0 * random.cube();
            let line = Ray::new(origin, DVec3::new(1.0, 1.5, 1.0) + 2.0 * random.cube() - origin);
            let Some(mut found) = oracle.roots(&line) else {
                continue;
            };
            found.sort_by(|a, b| a.t.nearest().total_cmp(&b.t.nearest()));
            for (number, root) in found.iter().enumerate() {
                assert_eq!(root.enters, number % 2 == 0, "{shape}: {line:?}");
            }
            checked += usize::from(!found.is_empty());
        }
        assert!(checked > 100, "{shape}: {checked}");
    }
}

#[test]
fn quadrics_are_cut_and_closed() {
    let tube = "type = \"cylinder\"\nradius = 2\nz = [0, 3]";
    assert_eq!(roots(tube, [-5.0, 0.0, 1.0], TO_X), Some(vec![3.0, 7.0]));
    assert_eq!(roots(tube, [1.0, 0.0, 5.0], DOWN), Some(vec![2.0, 5.0]));
    assert_eq!(roots(tube, [-5.0, 0.0, 3.5], TO_X), Some(vec![]));
    // In through the side, out through a cap.
    assert_eq!(
        roots(tube, [-4.0, 0.0, 0.0], [1.0, 0.0, 1.0]),
        Some(vec![2.0, 3.0])
    );
    let open = "type = \"cylinder\"\nradius = 2\nz = [0, 3]\ncaps = false";
    assert_eq!(roots(open, [1.0, 0.0, 5.0], DOWN), Some(vec![]));
    let cone = "type = \"cone\"\nradii = [1, 0]\nz = [0, 1]";
    assert_eq!(roots(cone, [-2.0, 0.0, 0.5], TO_X), Some(vec![1.5, 2.5]));
    assert_eq!(roots(cone, [0.25, 0.0, 3.0], DOWN), Some(vec![2.25, 3.0]));
    let bowl = "type = \"paraboloid\"\nradius = 2\nz = [0, 4]";
    assert_eq!(roots(bowl, [2.0, 0.0, 5.0], DOWN), Some(vec![1.0, 4.0]));
    let waist = "type = \"hyperboloid\"\nradius = 3\nslope = 4\nz = [-1, 1]";
    assert_eq!(
        roots(waist, [-9.0, 0.0, 1.0f64.next_down()], TO_X).map(|all| all.len()),
        Some(2)
    );
    assert_eq!(roots(waist, [-9.0, 0.0, 0.0], TO_X), Some(vec![6.0, 12.0]));
    let egg = "type = \"ellipsoid\"\nradii = [4, 1, 0.25]";
    assert_eq!(roots(egg, [0.0, 0.0, 1.0], DOWN), Some(vec![0.75, 1.25]));
    // x y = 0 in the unit box: two planes.
    let planes = "type = \"quadric\"\ncoefficients = [0, 0, 0, 1, 0, 0, 0, 0, 0, 0]\ncaps = false";
    assert_eq!(
        roots(planes, [-2.0, -1.5, 0.0], [1.0, 1.0, 0.0]),
        Some(vec![1.5, 2.0])
    );
}

#[test]
fn composites_follow_from_their_parts() {
    let moon = "type = \"csg\"\noperation = \"difference\"\noperands = [{ type = \"sphere\" }, { type = \"sphere\", center = [1, 0, 0] }]";
    assert_eq!(roots(moon, [-3.0, 0.0, 0.0], TO_X), Some(vec![2.0, 3.0]));
    let whole = oracle(moon).roots(&ray([-3.0, 0.0, 0.0], TO_X)).unwrap();
    assert_eq!(
        whole
            .iter()
            .map(|root| (root.primitive, root.enters))
            .collect::<Vec<_>>(),
        [(0, true), (1, false)]
    );
    // A shape minus itself is empty, whatever the line.
    let nothing = "type = \"csg\"\noperation = \"difference\"\noperands = [{ type = \"sphere\" }, { type = \"sphere\" }]";
    let nothing = oracle(nothing);
    let mut random = Random::new(3);
    for _ in 0..50 {
        let line = Ray::new(3.0 * random.cube(), random.direction());
        let found = nothing.nearest(&line, Interval::FORWARD);
        // Irrational roots of both cannot be told apart, so Unknown is right, too.
        assert!(matches!(found, Nearest::Miss | Nearest::Unknown), "{found:?}");
    }
    let half =
        "type = \"csg\"\noperation = \"intersection\"\noperands = [{ type = \"box\" }, { type = \"plane\" }]";
    assert_eq!(roots(half, [0.5, 0.25, 5.0], DOWN), Some(vec![5.0, 6.0]));
    let copies = "[[group.pair.shape]]\ntype = \"sphere\"\n[[group.pair.shape]]\ntype = \"sphere\"\ncenter = [5, 0, 0]\n[[shape]]\ntype = \"instance\"\ngroup = \"pair\"\ntransform = { scale = [2, 1, 1] }";
    let copies = with(copies, |description| Oracle::new(description, 0).unwrap());
    let found = copies.roots(&ray([-4.0, 0.0, 0.0], TO_X)).unwrap();
    assert_eq!(
        found.iter().map(|root| root.t.nearest()).collect::<Vec<_>>(),
        [2.0, 6.0, 12.0, 16.0]
    );
    let grid: Vec<String> = (0..16)
        .map(|k| format!("[{}, {}, {}]", k % 4, k / 4, k % 4))
        .collect();
    let flat = format!("type = \"patch\"\npoints = [{}]", grid.join(", "));
    // z = x over the square from 0 to 3.
    assert_eq!(roots(&flat, [1.2, 2.0, 4.0], DOWN).map(|all| all.len()), Some(1));
    assert!((roots(&flat, [1.2, 2.0, 4.0], DOWN).unwrap()[0] - 2.8).abs() < 1e-15);
    assert_eq!(roots(&flat, [3.1, 2.0, 4.0], DOWN), Some(vec![]));
}

type Number = FBig;

type Function = fn([Number; 3]) -> Number;

/// The exact number: sums and products have unlimited precision.
fn exactly(x: f64) -> Number {
    Number::try_from(x).unwrap().with_precision(0).value()
}

/// Functions of x, y and z that are zero on the surface, in exact arithmetic that is independent of
/// the oracle's.
const FUNCTIONS: [(&str, Function); 6] = [
    ("type = \"sphere\"\nradius = 1.5", |[x, y, z]| {
        &x * &x + &y * &y + &z * &z - exactly(2.25)
    }),
    ("type = \"ellipsoid\"\nradii = [2, 0.5, 1]", |[x, y, z]| {
        &x * &x + exactly(16.0) * &y * &y + exactly(4.0) * &z * &z - exactly(4.0)
    }),
    (
        "type = \"cone\"\nradii = [2, 0]\nz = [0, 2]\ncaps = false",
        |[x, y, z]| {
            let r = exactly(2.0) - z;
            &x * &x + &y * &y - &r * &r
        },
    ),
    ("type = \"paraboloid\"\ncaps = false\nz = [0, 2]", |[x, y, z]| {
        &x * &x + &y * &y - z
    }),
    ("type = \"hyperboloid\"\ncaps = false", |[x, y, z]| {
        &x * &x + &y * &y - &z * &z - exactly(0.25)
    }),
    ("type = \"torus\"", |[x, y, z]| {
        let around = &x * &x + &y * &y;
        let k = &around + &z * &z + exactly(1.0 - 0.0625);
        &k * &k - exactly(4.0) * around
    }),
];

#[test]
fn exact_values_change_sign_at_every_root() {
    let mut random = Random::new(17);
    for (keys, function) in FUNCTIONS {
        let (oracle, mut checked) = (oracle(keys), 0);
        for _ in 0..300 {
            let origin = 4.0 * random.cube();
            let line = Ray::new(origin, 1.2 * random.cube() - origin);
            let Some(roots) = oracle.roots(&line) else {
                continue;
            };
            let (o, d) = (
                line.origin.to_array().map(exactly),
                line.direction.to_array().map(exactly),
            );
            for root in roots {
                let value = |t: f64| {
                    let t = exactly(t);
                    function([0, 1, 2].map(|i| &o[i] + &t * &d[i]))
                };
                let (before, behind) = (value(root.t.below()), value(root.t.above()));
                let zero = exactly(0.0);
                assert!(
                    (before > zero) == root.enters && (behind < zero) == root.enters,
                    "{keys}: {line:?}"
                );
                assert!(root.t.above() <= root.t.below().next_up().next_up());
                checked += 1;
            }
        }
        assert!(checked > 100, "{keys}: {checked}");
    }
}

/// Errors of the textbook formulas in both precisions, over rays from around, near and far.
fn textbook_errors(keys: &str) -> [Errors; 2] {
    with(&format!("[[shape]]\n{keys}"), |description| {
        let oracle = Oracle::new(description, 0).unwrap();
        let single: Box<dyn Textbook<f32>> = textbook(description, 0).unwrap();
        let double: Box<dyn Textbook<f64>> = textbook(description, 0).unwrap();
        let aim = Aim::at(whitstone_core::Aabb::around([
            DVec3::splat(-1.2),
            DVec3::splat(1.2),
        ]));
        let mut random = Random::new(23);
        let mut errors = [Errors::default(); 2];
        for number in 0..400 {
            let line = aim.ray(number, &mut random);
            let truth = oracle.nearest(&line, Interval::FORWARD);
            let [o, d] = [line.origin, line.direction].map(|v| v.as_vec3().to_array());
            errors[0].add(&truth, single.intersect(o, d).map(f64::from));
            errors[1].add(
                &truth,
                double.intersect(line.origin.to_array(), line.direction.to_array()),
            );
        }
        errors
    })
}

/// The oracle finds the large errors of textbook formulas.
#[test]
fn textbook_forms_are_found_wrong() {
    for keys in [
        "type = \"sphere\"",
        "type = \"ellipsoid\"",
        "type = \"cylinder\"",
        "type = \"cone\"",
        "type = \"paraboloid\"",
        "type = \"hyperboloid\"",
        "type = \"torus\"",
        "type = \"lathe\"\noutline = [[0, -1], [0.9, -0.5], [0.5, 0.8], [0, 1]]",
        "type = \"quadric\"\ncoefficients = [1, 1, 1, 0, 0, 0, 0, 0, 0, -1]",
        "type = \"csg\"\noperation = \"union\"\noperands = [{ type = \"sphere\", radius = 1.2 }, { type = \"cone\" }]",
    ] {
        let [single, double] = textbook_errors(keys);
        assert!(
            single.wrong_class > 3 && single.most_ulps > 1e9,
            "{keys}: {single:?}"
        );
        assert!(double.most_ulps > 1e3, "{keys}: {double:?}");
    }
    for keys in [
        "type = \"plane\"",
        "type = \"rectangle\"",
        "type = \"disk\"",
        "type = \"box\"",
        "type = \"triangle\"\nvertices = [[-1, -1, 0], [1, -1, 0], [0, 1, 0.5]]",
        "type = \"polygon\"\nvertices = [[-1, -1, 0], [1, -1, 0], [0, 1, 0]]",
        "type = \"prism\"\noutline = [[-1, -1], [1, -1], [0, 1]]\ny = [-1, 1]",
    ] {
        let [single, double] = textbook_errors(keys);
        assert!(single.most_ulps > 1e7, "{keys}: {single:?}");
        assert!(
            double.wrong_class < 3 && double.most_ulps < 1e9,
            "{keys}: {double:?}"
        );
    }
}

/// A textbook formula in double precision exceeds the bound of 16 ulp times the condition number.
#[test]
fn agreement_bites() {
    let keys = "[[shape]]\ntype = \"torus\"\nminor_radius = 0.01";
    let agreement = with(keys, |description| {
        let oracle = Oracle::new(description, 0).unwrap();
        let ferrari: Box<dyn Textbook<f64>> = textbook(description, 0).unwrap();
        let bounds = whitstone_core::Aabb::around([DVec3::splat(-1.01), DVec3::splat(1.01)]);
        let aim = Aim::at(bounds);
        let mut random = Random::new(29);
        let mut agreement = Agreement::default();
        for number in 0..300 {
            let line = aim.ray(number, &mut random);
            let found = ferrari.intersect(line.origin.to_array(), line.direction.to_array());
            agreement.add(&oracle, &line, found, &bounds);
        }
        agreement
    });
    assert!(agreement.wrong > 3, "{agreement}");
}

/// Rays in a plane of grid points whose values are the iso value, or one unit in the last place
/// away from it: the function is 0, or almost 0, along the whole line. Such a ray need not have an
/// answer, but the oracle must stop.
#[test]
fn rays_in_a_plateau_end_soon() {
    let level = 0.1_f64;
    for plateau in [level, level.next_up(), level.next_down()] {
        let value = |n: usize| match (n / 5 % 5, n % 2) {
            (2, _) => plateau,
            (_, 0) => 0.4,
            _ => -0.2,
        };
        let values: Vec<f64> = (0..125).map(value).collect();
        let keys =
            format!("type = \"isosurface\"\nsize = [5, 5, 5]\niso_value = {level}\nvalues = {values:?}");
        let oracle = oracle(&keys);
        for direction in [
            [1.0, 0.0, 0.0],
            [1.0, 0.0, 0.3],
            [1.0, 1e-13, 0.3],
            [0.6, 1e-6, -0.8],
        ] {
            for z in [0.0, 0.1] {
                let start = std::time::Instant::now();
                let ray = ray(
                    [-3.0 * direction[0], -3.0 * direction[1], z - 3.0 * direction[2]],
                    direction,
                );
                let found = oracle.nearest(&ray, Interval::FORWARD);
                let seconds = start.elapsed().as_secs_f64();
                println!("{plateau:?} {direction:?} {z}: {seconds:.2} s, {found:?}");
                // No measure of speed: without an end it takes minutes.
                assert!(seconds < 30.0, "{seconds} s for {ray:?}");
            }
        }
    }
}
