//! A kernel for `stress --kernel` that tests every triangle: `small-kernel [FAULT]`. Without a
//! fault it is right; each fault is one that kernels have.

use serde_json::{Value, json};
use std::io::{BufRead, Write};

type Vector = [f64; 3];

fn from(a: Vector, b: Vector) -> Vector {
    [0, 1, 2].map(|k| b[k] - a[k])
}

fn dot(a: Vector, b: Vector) -> f64 {
    (0..3).map(|k| a[k] * b[k]).sum()
}

fn cross(a: Vector, b: Vector) -> Vector {
    [0, 1, 2].map(|k| a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3])
}

/// The triangles of an OBJ file.
fn load(path: &str) -> std::io::Result<Vec<[Vector; 3]>> {
    let text = std::fs::read_to_string(path)?;
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let number = |index: usize| words[index].parse::<f64>().unwrap_or(f64::NAN);
        match words.first() {
            Some(&"v") => vertices.push([number(1), number(2), number(3)]),
            Some(&"f") => triangles.push([1, 2, 3].map(|index| vertices[number(index) as usize - 1])),
            _ => {}
        }
    }
    Ok(triangles)
}

/// Distance and coordinates (Moeller and Trumbore 1997), with a border of rounding, so that there
/// are no gaps between triangles.
fn hit([a, b, c]: [Vector; 3], origin: Vector, direction: Vector) -> Option<[f64; 3]> {
    let [e, f] = [from(a, b), from(a, c)];
    let p = cross(direction, f);
    let determinant = dot(e, p);
    let s = from(a, origin);
    let q = cross(s, e);
    let [u, v, t] = [dot(s, p), dot(direction, q), dot(f, q)].map(|part| part / determinant);
    (u >= -1e-12 && v >= -1e-12 && u + v <= 1.0 + 1e-12).then_some([t, u, v])
}

fn answer(triangles: &[[Vector; 3]], request: &Value, fault: &str) -> Value {
    let numbers = |value: &Value| -> Vec<f64> {
        let parts = value.as_array().into_iter().flatten();
        parts.map(|part| part.as_f64().unwrap_or(f64::NAN)).collect()
    };
    let vectors = |key: &str| -> Vec<Vector> {
        let parts = request[key].as_array().into_iter().flatten();
        parts
            .map(|part| numbers(part).try_into().unwrap_or([f64::NAN; 3]))
            .collect()
    };
    let (origins, directions) = (vectors("origins"), vectors("directions"));
    let (least, most) = (numbers(&request["t_min"]), numbers(&request["t_max"]));
    if fault == "no-lower-end" && least.iter().any(|t| *t > 0.0) {
        return json!({ "ok": false, "kind": "unsupported", "error": "rays start at 0" });
    }
    let mut columns: [Vec<Value>; 4] = Default::default();
    for (ray, &origin) in origins.iter().enumerate() {
        let mut best: Option<([f64; 3], usize)> = None;
        for (index, triangle) in triangles.iter().enumerate() {
            let Some(mut found) = hit(*triangle, origin, directions[ray]) else {
                continue;
            };
            if fault == "gaps" && found[1] + found[2] > 0.9 {
                continue;
            }
            if fault == "shifted" && index % 64 == 0 {
                found[0] *= 1.001;
            }
            let is_far = fault != "all-distances" && found[0] >= most[ray];
            if found[0] <= least[ray] || is_far {
                continue;
            }
            let is_nearer = best.is_none_or(|(known, _)| (found[0] < known[0]) != (fault == "farthest"));
            if is_nearer {
                best = Some((found, index));
            }
        }
        let (found, index) = best.map_or(([f64::NAN; 3], -1), |(found, index)| (found, index as i64));
        let [t, u, v] = found;
        let [u, v] = if fault == "exchanged" { [v, u] } else { [u, v] };
        for (column, value) in columns
            .iter_mut()
            .zip([json!(t), json!(index), json!(u), json!(v)])
        {
            column.push(value);
        }
    }
    let [t, primitive, u, v] = columns;
    json!({ "ok": true, "t": t, "primitive": primitive, "u": u, "v": v })
}

fn main() -> std::io::Result<()> {
    let fault = std::env::args().nth(1).unwrap_or_default();
    let mut triangles = Vec::new();
    for line in std::io::stdin().lock().lines() {
        let request: Value = serde_json::from_str(&line?)?;
        let found = match request["op"].as_str() {
            Some("load") => {
                triangles = load(request["mesh"].as_str().unwrap_or_default())?;
                json!({ "ok": true })
            }
            _ if fault == "short" => json!({ "ok": true, "t": [], "primitive": [], "u": [], "v": [] }),
            _ if fault == "ends" => return Ok(()),
            _ if fault == "hangs" => loop {
                std::thread::sleep(std::time::Duration::from_secs(1));
            },
            _ => answer(&triangles, &request, &fault),
        };
        println!("{found}");
        std::io::stdout().flush()?;
    }
    Ok(())
}
