//! Properties of the teapot's control points: size, symmetry, and that the patches join.

use std::collections::BTreeMap;
use toml::Value;

type Point = [f64; 3];

fn numbers(value: &Value) -> Vec<f64> {
    let number = |x: &Value| x.as_float().or(x.as_integer().map(|i| i as f64)).unwrap();
    value.as_array().unwrap().iter().map(number).collect()
}

/// The control points of a curve as bits, so that curves can be counted.
fn key(points: [Point; 4]) -> [[u64; 3]; 4] {
    let forward = points.map(|p| p.map(|c| (c + 0.0).to_bits()));
    let mut backward = forward;
    backward.reverse();
    forward.min(backward)
}

#[test]
fn patches_join_where_they_should() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/showcase/teapot.toml");
    let scene: toml::Table = std::fs::read_to_string(path).unwrap().parse().unwrap();
    let shapes = scene["shape"].as_array().unwrap();
    let teapot = shapes
        .iter()
        .find(|shape| shape["type"].as_str() == Some("patch"))
        .unwrap();
    let list = |key: &str| teapot[key].as_array().unwrap().iter().map(numbers);
    let vertices: Vec<Point> = list("vertices").map(|p| p.try_into().unwrap()).collect();
    let patches: Vec<[Point; 16]> = list("patches")
        .map(|patch| std::array::from_fn(|k| vertices[patch[k] as usize]))
        .collect();
    assert_eq!((vertices.len(), patches.len()), (290, 32));
    for (axis, low, high) in [(0, -3.0, 3.525), (1, -2.0, 2.0), (2, 0.0, 3.15)] {
        let along = || vertices.iter().map(|p| p[axis]);
        assert_eq!(along().fold(f64::MAX, f64::min), low);
        assert_eq!(along().fold(f64::MIN, f64::max), high);
    }
    // The left side is the mirror image of the right one.
    assert!(
        vertices
            .iter()
            .all(|[x, y, z]| vertices.contains(&[*x, -y + 0.0, *z]))
    );
    let mut curves: BTreeMap<_, (usize, Point)> = BTreeMap::new();
    let mut collapsed = 0;
    for patch in &patches {
        for ends in [[0, 1, 2, 3], [12, 13, 14, 15], [0, 4, 8, 12], [3, 7, 11, 15]] {
            let curve = ends.map(|k| patch[k]);
            if curve.iter().all(|p| *p == curve[0]) {
                collapsed += 1;
            } else {
                curves.entry(key(curve)).or_insert((0, curve[0])).0 += 1;
            }
        }
    }
    // The tip of the lid and the center of the bottom are collapsed. Rim and lid are open, with
    // four curves each, as are both ends of handle and spout.
    assert_eq!(collapsed, 8);
    let joined = curves.values().filter(|(count, _)| *count == 2).count();
    let open: Vec<Point> = curves
        .values()
        .filter(|(count, _)| *count == 1)
        .map(|curve| curve.1)
        .collect();
    assert_eq!((joined, open.len()), (52, 16));
    let round = open.iter().filter(|p| p[2] == 2.4 && p[0].hypot(p[1]) < 1.45);
    assert_eq!(round.count(), 8);
}
