use super::*;
use std::fmt::Write;
use whitstone_testkit::{Random, build};

/// A wave over a square.
fn wave(height: f64) -> [DVec3; 16] {
    std::array::from_fn(|k| {
        let (j, i) = ((k % 4) as f64, (k / 4) as f64);
        let z = height * [0.3, -1.0, 0.8, -0.2][k % 4] * [1.0, 0.2, -0.9, 0.5][k / 4];
        DVec3::new(j / 1.5 - 1.0, i / 1.5 - 1.0, z)
    })
}

/// A quarter of a dome; its first row is collapsed to a point.
fn dome(tip: f64) -> [DVec3; 16] {
    let rows = [(0.0, 1.0), (0.6, tip), (1.0, 0.55), (1.0, 0.0)];
    let arc = [(1.0, 0.0), (1.0, 0.552), (0.552, 1.0), (0.0, 1.0)];
    std::array::from_fn(|k| {
        let ((r, z), (x, y)) = (rows[k / 4], arc[k % 4]);
        DVec3::new(r * x, r * y, z)
    })
}

/// A rolled-up sheet that rays hit up to five times.
fn roll() -> [DVec3; 16] {
    let line = [(0.0, 0.0), (6.0, 1.0), (-5.0, 1.5), (1.0, 0.2)];
    std::array::from_fn(|k| {
        let (x, z) = line[k % 4];
        DVec3::new(x, (k / 4) as f64 / 1.5 - 1.0, z + 0.2 * (k / 4) as f64)
    })
}

/// A patch with a cusp at u = 1/2, where the derivative along u vanishes.
fn cusp() -> [DVec3; 16] {
    let line = [(0.0, 0.0), (1.0, 1.0), (0.0, 1.0), (1.0, 0.0)];
    std::array::from_fn(|k| {
        let (x, z) = line[k % 4];
        DVec3::new(x, (k / 4) as f64 / 3.0, z)
    })
}

fn wild(random: &mut Random) -> [DVec3; 16] {
    std::array::from_fn(|_| random.cube())
}

fn text(points: &[DVec3; 16]) -> String {
    let mut text = String::from("points = [");
    for p in points {
        write!(text, "[{:?}, {:?}, {:?}],", p.x, p.y, p.z).unwrap();
    }
    text + "]"
}

fn patch(points: &[DVec3; 16]) -> Box<dyn Shape> {
    match build::<Shapes, Patch>(&text(points), Transform::IDENTITY) {
        Ok(LoweredShape::Custom(patch)) => patch,
        Ok(_) => unreachable!("a patch is a custom shape"),
        Err(error) => panic!("{error}"),
    }
}

fn size(points: &[DVec3; 16]) -> f64 {
    Aabb::around(*points).extent().length()
}

fn hit_of(patch: &dyn Shape, ray: &Ray, around: Interval) -> Option<(ShapeHit, SurfaceInteraction)> {
    let hit = patch.intersect(ray, around, None)?;
    let raw = hit.of_shape(whitstone_core::InstanceId::TOP_LEVEL, 0);
    Some((hit, patch.surface(ray, &raw, SurfaceAttributes::UV)))
}

/// The examples that must pass the shape laws.
pub(super) fn examples() -> [String; 3] {
    [wave(0.6), dome(1.0), roll()].map(|points| text(&points))
}

#[test]
fn a_flat_patch_is_where_its_points_say() {
    let flat = patch(&wave(0.0));
    for (x, y) in [(0.25, -0.5), (-1.0, 1.0), (1.0, 0.0), (0.0, 0.0)] {
        let ray = Ray::new(DVec3::new(x, y, 3.0), DVec3::new(0.0, 0.0, -2.0));
        let (hit, point) = hit_of(&*flat, &ray, Interval::FORWARD).unwrap();
        assert!((hit.t - 1.5).abs() < 1e-15, "{hit:?}");
        let uv = 0.5 * (DVec2::new(x, y) + 1.0);
        assert!((point.uv - uv).length() < 1e-14, "{point:?}");
        assert_eq!(point.n_g, DVec3::Z);
    }
    for (x, y) in [(1.0 + 1e-9, 0.0), (0.0, -1.0 - 1e-9)] {
        let ray = Ray::new(DVec3::new(x, y, 3.0), DVec3::NEG_Z);
        assert!(hit_of(&*flat, &ray, Interval::FORWARD).is_none());
    }
    // In its plane, from outside and from inside: any answer is allowed, but the search must end.
    for x in [-3.0, 0.1] {
        let ray = Ray::new(DVec3::new(x, 0.1, 0.0), DVec3::new(1.0, 0.3, 0.0));
        let _ = flat.intersect(&ray, Interval::FORWARD, None);
    }
}

/// Newton's method from nine starting points, without the guarantees of the plugin.
fn naive(net: &Net<DVec3>, ray: &Ray, near: f64) -> Vec<f64> {
    let sheared = ShearedRay::new(ray);
    let seen = net.map(|p| sheared.shear(p).truncate());
    let places = [0.2, 0.5, 0.8];
    let starts = places
        .iter()
        .flat_map(|u| places.iter().map(|v| DVec2::new(*u, *v)));
    let found = starts.filter_map(|start| {
        let at = roots::polished(&seen, start, near)?;
        Some((net.at(at.x, at.y).p - ray.origin).dot(ray.direction) / ray.direction.length_squared())
    });
    found.collect()
}

/// Every point of every patch is found by rays through it, and hits lie on the ray.
#[test]
fn no_root_is_missed_and_residuals_are_small() {
    let mut random = Random::new(31);
    let mut kinds: Vec<(&str, [DVec3; 16])> = vec![
        ("wave", wave(0.6)),
        ("dome", dome(1.0)),
        ("pointed dome", dome(0.7)),
        ("roll", roll()),
        ("cusp", cusp()),
    ];
    kinds.extend((0..4).map(|_| ("wild", wild(&mut random))));
    for (name, points) in kinds {
        let (net, surface, size) = (Net(points), patch(&points), size(&points));
        let (mut worst, mut naive_missed) = (0f64, 0);
        let mut count = 0;
        for i in 0..4_000 {
            // Inside, on the edges, and close to a collapsed edge.
            let at = match i % 4 {
                0 => DVec2::new(random.unit(), (random.below(2)) as f64),
                1 => DVec2::new(random.unit(), 10f64.powf(-8.0 * random.unit())),
                _ => DVec2::new(random.unit(), random.unit()),
            };
            let target = net.at(at.x, at.y).p;
            let mut from = random.direction();
            if i % 5 == 0 {
                // Nearly tangent to the surface.
                let Jet { u, v, .. } = net.at(at.x, at.y);
                from = (u + random.signed() * v + 1e-3 * from).normalize_or(from);
            }
            let distance = [0.1, 10.0, 1e3][i % 3] * size;
            let origin = target + distance * from;
            let ray = Ray::new(origin, (target - origin) / size);
            let t = (target - origin).dot(ray.direction) / ray.direction.length_squared();
            // At a grazing angle, a small distance from the ray is a large one along it.
            let cosine = normal(&net, at).dot(from).abs();
            let slack = 4.0 * NEAR * size / cosine.max(1e-6) / ray.direction.length();
            let around = Interval {
                min: (t - slack).max(0.0),
                max: t + slack,
            };
            let Some((hit, point)) = hit_of(&*surface, &ray, around) else {
                panic!("{name}: {at} is missed by {ray:?} (cosine {cosine})");
            };
            count += 1;
            let beside = point.position - origin;
            let residual = beside.cross(ray.direction.normalize()).length() / size;
            let rounding = 1e-16 * distance / size;
            worst = worst.max(residual - 4.0 * rounding);
            assert!((point.n_g.length() - 1.0).abs() < 1e-14 && hit.prim_uv.is_finite());
            let close = naive(&net, &ray, 2.0 * NEAR * size)
                .into_iter()
                .any(|found| (found - t).abs() <= slack);
            naive_missed += usize::from(!close);
        }
        println!(
            "{name}: {count} found, residual {worst:.1e} of the size; Newton alone misses {naive_missed}"
        );
        assert!(worst < 1e-11, "{name}: residual {worst}");
        if ["wild", "roll", "cusp"].contains(&name) {
            assert!(
                naive_missed > 20,
                "{name}: Newton's steps alone must miss some: {naive_missed}"
            );
        }
    }
}

#[test]
fn a_tip_has_the_normal_that_it_tends_to() {
    let round = patch(&dome(1.0));
    let ray = Ray::new(DVec3::new(0.0, 0.0, 3.0), DVec3::NEG_Z);
    let (hit, point) = hit_of(&*round, &ray, Interval::FORWARD).unwrap();
    assert!((hit.t - 2.0).abs() < 1e-12);
    assert!((point.n_g.z.abs() - 1.0).abs() < 1e-12, "{point:?}");
    for tip in [1.0, 0.7] {
        let net = Net(dome(tip));
        for u in [0.0, 0.3, 1.0] {
            let limit = normal(&net, DVec2::new(u, 0.0));
            let beside = normal(&net, DVec2::new(u, 1e-7));
            assert!(limit.distance(beside) < 1e-6, "{tip}, {u}: {limit} and {beside}");
            // From the other end, and along the other parameter.
            let turned = Net(std::array::from_fn(|k| net.0[15 - k]));
            assert!(normal(&turned, DVec2::new(1.0 - u, 1.0)).distance(limit) < 1e-12);
            let swapped = Net(std::array::from_fn(|k| net.0[4 * (k % 4) + k / 4]));
            assert!(normal(&swapped, DVec2::new(0.0, u)).distance(-limit) < 1e-12);
        }
    }
}

#[test]
fn of_two_patches_that_share_an_edge_one_is_hit_at_least() {
    let one = wave(0.6);
    let other: [DVec3; 16] = std::array::from_fn(|k| {
        let p = one[4 * (k / 4) + 3 - k % 4];
        DVec3::new(2.0 - p.x, p.y, p.z)
    });
    let (left, right) = (patch(&one), patch(&other));
    let mut random = Random::new(9);
    for i in 0..10_000 {
        let target = Net(one).at(1.0, random.unit()).p;
        let side = DVec3::new(random.signed(), random.signed(), 2.0);
        let origin = target + [1.0, 30.0, 1e5][i % 3] * side;
        let ray = Ray::new(origin, target - origin);
        let hits = [&left, &right].map(|patch| patch.intersect(&ray, Interval::FORWARD, None));
        assert!(hits.iter().any(Option::is_some), "{ray:?}");
    }
}

#[test]
fn several_patches_are_numbered_and_mirrors_keep_the_outside() {
    let shared = "vertices = [[0,0,0],[1,0,0],[2,0,0],[3,0,0],[0,1,0],[1,1,0],[2,1,0],[3,1,0],[0,2,0],
        [1,2,0],[2,2,0],[3,2,0],
        [0,3,0],[1,3,0],[2,3,0],[3,3,0],[0,0,1],[1,0,1],[2,0,1],[3,0,1]]
        patches = [[0,1,2,3,4,5,6,7,8,9,10,11,12,13,14,15], [0,1,2,3,0,1,2,3,16,17,18,19,16,17,18,19]]";
    for (scale, sign) in [(DVec3::ONE, 1.0), (DVec3::new(1.0, 1.0, -1.0), -1.0)] {
        let transform = Transform::new(whitstone_core::DAffine3::from_scale(scale)).unwrap();
        let Ok(LoweredShape::Custom(both)) = build::<Shapes, Patch>(shared, transform) else {
            panic!("patches are opaque")
        };
        let down = Ray::new(DVec3::new(1.5, 1.0, 0.5), DVec3::new(0.0, 0.0, -1.0));
        let up = Ray::new(DVec3::new(1.5, 1.0, -0.5), DVec3::new(0.0, 0.0, 1.0));
        let (hit, point) = hit_of(&*both, if sign > 0.0 { &down } else { &up }, Interval::FORWARD).unwrap();
        assert_eq!((hit.primitive, point.n_g), (0, sign * DVec3::Z));
        let ray = Ray::new(DVec3::new(1.5, 1.0, sign * 0.5), DVec3::NEG_Y);
        let (hit, point) = hit_of(&*both, &ray, Interval::FORWARD).unwrap();
        assert_eq!((hit.primitive, point.n_g), (1, DVec3::NEG_Y));
    }
}

#[test]
fn what_is_no_patch_is_refused() {
    let error = |text: &str| {
        build::<Shapes, Patch>(text, Transform::IDENTITY)
            .err()
            .unwrap()
            .0
            .remove(0)
            .message
    };
    assert_eq!(error(""), "this patch has no control points");
    assert_eq!(error("points = [[0, 0, 0]]"), "expected 16 points, found 1");
    assert_eq!(error("vertices = [[0, 0, 0]]"), "`vertices` need `patches`");
    assert_eq!(error("patches = [[0]]"), "`patches` need `vertices`");
    assert_eq!(
        error("vertices = [[0, 0, 0]]\npatches = [[0, 0]]"),
        "expected the numbers of 16 vertices, found 2"
    );
    let zeros = "vertices = [[0, 0, 0]]\npatches = [[0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, ";
    assert_eq!(error(&format!("{zeros}0]]")), "this patch has no area");
    assert_eq!(error(&format!("{zeros}1]]")), "there is no vertex 1: there are 1");
    assert_eq!(
        error("vertices = []\npatches = []"),
        "expected 1 to 65536 vertices, found 0"
    );
}

#[test]
fn a_search_without_pieces_is_not_complete() {
    let points = wave(1.0).map(|p| p.truncate() - DVec2::new(0.1, 0.2));
    let piece = Piece {
        net: Net(points),
        low: DVec2::ZERO,
        size: DVec2::ONE,
    };
    let mut found = 0;
    assert!(roots::roots(piece, 1e-12, roots::MAX_PIECES, |_| found += 1));
    assert_eq!(found, 1);
    // No known surface needs all of them.
    assert!(!roots::roots(piece, 1e-12, 0, |_| found += 1));
    assert_eq!(found, 1);
}
