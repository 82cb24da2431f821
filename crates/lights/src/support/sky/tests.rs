use super::*;
use std::path::Path;
use whitstone_image::{Limits, exr_io};

/// The 26 directions to the faces, edges and corners of a cube.
fn normals() -> Vec<DVec3> {
    let all = (0..27).map(|i| DVec3::new(f64::from(i % 3), f64::from(i / 3 % 3), f64::from(i / 9)) - 1.0);
    all.filter(|n| *n != DVec3::ZERO).map(DVec3::normalize).collect()
}

/// Unshadowed irradiance for each normal by the midpoint rule over rows and columns of (u, v).
fn truth(look: &impl Fn(DVec2, DVec3) -> Rgb, rows: usize) -> Vec<Rgb> {
    let normals = normals();
    let mut sums = vec![Rgb::splat(0.0); normals.len()];
    for row in 0..rows {
        let edge = |row: usize| (PI * (row as f64 / rows as f64 - 0.5)).sin();
        let solid_angle = (edge(row + 1) - edge(row)) * PI / rows as f64;
        for column in 0..2 * rows {
            let uv = DVec2::new(
                (column as f64 + 0.5) / (2 * rows) as f64,
                (row as f64 + 0.5) / rows as f64,
            );
            let d = towards(uv.x, uv.y);
            let l = look(uv, d) * solid_angle;
            for (sum, normal) in sums.iter_mut().zip(&normals) {
                *sum += l * normal.dot(d).max(0.0);
            }
        }
    }
    sums
}

/// Directions without luminance placement: equal parts of the sphere.
fn equal(n: usize, look: &impl Fn(DVec2, DVec3) -> Rgb) -> Vec<LightSample> {
    let sample = |index: usize| {
        let y = 1.0 - 2.0 * ((index / (2 * n)) as f64 + 0.5) / n as f64;
        let u = ((index % (2 * n)) as f64 + 0.5) / (2 * n) as f64;
        let direction = towards(u, 0.5 + y.asin() / PI);
        LightSample {
            direction,
            distance: f64::INFINITY,
            irradiance: look(DVec2::new(u, 0.5 + y.asin() / PI), direction) * (TAU / (n * n) as f64),
        }
    };
    (0..2 * n * n).map(sample).collect()
}

/// The largest relative error of the irradiance, measured by luminance.
fn bias(samples: &[LightSample], truth: &[Rgb]) -> f64 {
    let errors = normals().into_iter().zip(truth).map(|(normal, truth)| {
        let light = |s: &LightSample| luminance(s.irradiance) * s.direction.dot(normal).max(0.0);
        let found: f64 = samples.iter().map(light).sum();
        (found / luminance(*truth) - 1.0).abs()
    });
    errors.fold(0.0, f64::max)
}

#[test]
fn skies_of_one_channel_are_lit_by_all_directions() {
    for (channel, luminance_of_it) in [(0, 0.2126), (1, 0.7152), (2, 0.0722)] {
        let mut light = [0.0; 3];
        light[channel] = 1.0;
        assert_eq!(luminance(Rgb::from(light)), luminance_of_it);
        let samples = directions(8, 1, |_, _| Rgb::from(light));
        let sum: f64 = samples
            .iter()
            .map(|sample| sample.irradiance.to_array()[channel])
            .sum();
        assert!((sum / (2.0 * TAU) - 1.0).abs() < 1e-9, "{channel}: {sum}");
    }
}

#[test]
fn pieces_are_the_parts_of_cells_in_an_interval() {
    let edges = [0.0, 1.0, 2.0, 3.0, 4.0];
    for (interval, expected) in [
        (
            [0.0, 4.0],
            vec![(0, [0.0, 1.0]), (1, [1.0, 2.0]), (2, [2.0, 3.0]), (3, [3.0, 4.0])],
        ),
        (
            [0.5, 2.5],
            vec![(0, [0.5, 1.0]), (1, [1.0, 2.0]), (2, [2.0, 2.5])],
        ),
        ([1.0, 2.0], vec![(1, [1.0, 2.0])]),
        // Rounding may leave an interval empty, or end it after the last edge.
        ([1.0, 1.0], vec![(1, [1.0, 1.0])]),
        ([4.0, 4.0], vec![(3, [4.0, 4.0])]),
        ([3.5, 5.0], vec![(3, [3.5, 4.0])]),
    ] {
        let found = pieces(&edges, interval);
        assert_eq!(found.len(), expected.len());
        assert_eq!(found.collect::<Vec<_>>(), expected);
    }
}

/// Divides a part of a sky by the rule of the model, given the integral of the weight over a part.
/// A part is the range of the sine of the latitude, and that of the longitude.
fn divide(part: [f64; 4], count: usize, integral: &dyn Fn([f64; 4]) -> f64, parts: &mut Vec<[f64; 4]>) {
    if count == 1 {
        return parts.push(part);
    }
    let [y0, y1, phi0, phi1] = part;
    let widest = match (y0 < 0.0, y1 > 0.0) {
        (true, true) => 1.0,
        (true, false) => y1.asin().cos(),
        (false, _) => y0.asin().cos(),
    };
    let cut = |at: f64| match 0.65 * widest * (phi1 - phi0) > y1.asin() - y0.asin() {
        true => [[y0, y1, phi0, at], [y0, y1, at, phi1]],
        false => [[y0, at, phi0, phi1], [at, y1, phi0, phi1]],
    };
    let share = integral(part) * (count / 2) as f64 / count as f64;
    let (mut low, mut high) = (y0.min(phi0), y1.max(phi1));
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if integral(cut(middle)[0]) < share {
            low = middle;
        } else {
            high = middle;
        }
    }
    let [a, b] = cut(0.5 * (low + high));
    divide(a, count / 2, integral, parts);
    divide(b, count - count / 2, integral, parts);
}

#[test]
fn a_sky_is_divided_as_the_model_says() {
    let even = |_: f64, _: f64| 1.0;
    // 3^(7/4) has the weight 3.
    let uneven = |u: f64, v: f64| 1.0 + 5.0 * u + if v > 0.75 { 3f64.powf(1.75) } else { 0.0 };
    for (counts, value) in [
        (&[1, 2, 8, 13, 64, 300][..], &even as &dyn Fn(f64, f64) -> f64),
        (&[2, 3, 7], &uneven),
    ] {
        let look = |uv: DVec2| value(uv.x, uv.y);
        let cells = (0..ROWS).flat_map(|row| (0..COLUMNS).map(move |column| (row, column)));
        let cells: Vec<([f64; 4], f64)> = cells
            .map(|(row, column)| {
                let uv = DVec2::new(
                    (column as f64 + 0.5) / COLUMNS as f64,
                    (row as f64 + 0.5) / ROWS as f64,
                );
                let edges = [
                    row_edge(row),
                    row_edge(row + 1),
                    column_edge(column),
                    column_edge(column + 1),
                ];
                (edges, look(uv))
            })
            .collect();
        // An even sky needs no sum over cells.
        let sum = |[y0, y1, phi0, phi1]: [f64; 4], of: &dyn Fn(f64) -> f64| -> f64 {
            if counts.contains(&300) {
                return of(1.0) * (y1 - y0) * (phi1 - phi0);
            }
            let cell = |([a, b, c, d], value): &([f64; 4], f64)| {
                let (height, width) = (b.min(y1) - a.max(y0), d.min(phi1) - c.max(phi0));
                of(*value) * height.max(0.0) * width.max(0.0)
            };
            cells.iter().map(cell).sum()
        };
        let sphere = [-1.0, 1.0, -PI, PI];
        let floor = 0.01 * sum(sphere, &|l| l.powf(4.0 / 7.0)) / (2.0 * TAU);
        let integral = |part: [f64; 4]| sum(part, &|l| l.powf(4.0 / 7.0) + floor);
        for &count in counts {
            let mut parts = Vec::new();
            divide(sphere, count, &integral, &mut parts);
            let samples = directions(count, 1, |uv, _| Rgb::splat(look(uv)));
            assert_eq!(samples.len(), count);
            for (sample, part) in samples.iter().zip(parts) {
                let energy = sum(part, &|l| l);
                let found = sample.irradiance.r / energy;
                assert!((found - 1.0).abs() < 1e-9, "{count}: {found}");
                let [y0, y1, phi0, phi1] = part;
                let d = sample.direction;
                let phi = d.x.atan2(-d.z);
                let inside = y0 < d.y && d.y < y1 && phi0 < phi && phi < phi1;
                // The centroid of the whole sphere is its centre.
                assert!(inside || count == 1, "{count}: {d} {part:?}");
            }
        }
    }
}

/// A blue sky above dark ground, with a sun of 1 degree that gives half of the light.
fn sunny(_: DVec2, d: DVec3) -> Rgb {
    let sun = DVec3::new(0.3, 0.5, -0.7).normalize();
    let sky = if d.y > 0.0 {
        Rgb::new(0.3, 0.5, 1.0) * (1.0 + 2.0 * (1.0 - d.y).powi(4))
    } else {
        Rgb::new(0.12, 0.1, 0.08)
    };
    let part = ((d.dot(sun) - 1f64.to_radians().cos()) / 2e-5).clamp(0.0, 1.0);
    sky + Rgb::new(6000.0, 5000.0, 4000.0) * part
}

#[test]
fn a_small_sun_is_lit_without_bias() {
    let truth = truth(&sunny, 2048);
    for (n, limit) in [(4, 0.2), (8, 0.05), (16, 0.01), (32, 0.005)] {
        // 8 x 8 lookups per cell: the sun's disk is three cells wide, and its edge would otherwise
        // be the largest error.
        let found = bias(&directions(2 * n * n, 8, sunny), &truth);
        let before = bias(&equal(n, &sunny), &truth);
        println!("n = {n}: {found:.4}, equal parts of the sphere {before:.4}");
        assert!(found <= limit, "n = {n}: bias {found}");
        // The measure detects the difference.
        assert!(before > 5.0 * found, "n = {n}: {before}");
    }
}

/// The directory `WHITSTONE_SKIES` contains latitude-longitude maps (EXR).
#[test]
fn measured_skies() {
    let Some(folder) = std::env::var_os("WHITSTONE_SKIES") else {
        eprintln!("SKIPPED measured_skies: WHITSTONE_SKIES names no folder of skies (EXR)");
        return;
    };
    let mut files: Vec<_> = std::fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "exr"))
        .collect();
    files.sort();
    assert!(
        !files.is_empty(),
        "no EXR file in {}",
        Path::new(&folder).display()
    );
    for file in files {
        let image = exr_io::read(&file, Limits::TEXTURE).unwrap();
        let (width, height) = (image.width(), image.height());
        let planes = image.rgb().unwrap();
        let texel = |x: i64, y: i64| {
            let index = y.clamp(0, height as i64 - 1) as usize * width + x.rem_euclid(width as i64) as usize;
            // Scenes reject negative radiance, which some measured skies have.
            Rgb::from(planes.map(|plane| f64::from(plane[index]).max(0.0)))
        };
        let look = |uv: DVec2, _: DVec3| {
            let at = DVec2::new(uv.x * width as f64 - 0.5, (1.0 - uv.y) * height as f64 - 0.5);
            let (start, f) = (at.floor(), at - at.floor());
            let (x, y) = (start.x as i64, start.y as i64);
            let row = |y| texel(x, y) * (1.0 - f.x) + texel(x + 1, y) * f.x;
            row(y) * (1.0 - f.y) + row(y + 1) * f.y
        };
        let truth = truth(&look, 4 * height.min(512));
        let parts = parts_of_picture([width, height]);
        for n in [2, 4, 8, 16, 32] {
            let found = bias(&directions(2 * n * n, parts, look), &truth);
            let before = bias(&equal(n, &look), &truth);
            println!(
                "{} n = {n}: {:.2} %, equal parts of the sphere {:.1} %",
                file.display(),
                100.0 * found,
                100.0 * before
            );
            if n >= 16 {
                assert!(found <= 0.01, "{} n = {n}: {found}", file.display());
            }
        }
    }
}

/// A small change of the radiance moves no direction far, even if half of the sky is black and cuts
/// are ambiguous.
#[test]
fn rounding_does_not_move_directions() {
    let half = |_: DVec2, d: DVec3| Rgb::splat(if d.x > 0.0 { 1.0 } else { 0.0 });
    for look in [&half as &dyn Fn(DVec2, DVec3) -> Rgb, &sunny, &|_, _| {
        Rgb::splat(1.0)
    }] {
        for n in [3, 16] {
            let noisy = |uv: DVec2, d: DVec3| look(uv, d) * (1.0 + 1e-7 * (1e4 * uv.x + 3e4 * uv.y).sin());
            let (a, b) = (directions(2 * n * n, 1, look), directions(2 * n * n, 1, noisy));
            assert_eq!(a.len(), b.len());
            for (a, b) in a.iter().zip(&b) {
                let brightest = a.irradiance.max_component();
                let off = (a.irradiance + b.irradiance * -1.0).map(f64::abs).max_component();
                assert!(off <= 1e-5 * brightest + 1e-9, "n = {n}: {off}");
                assert!(a.direction.distance(b.direction) < 1e-4 || brightest < 1e-5);
            }
        }
    }
}
