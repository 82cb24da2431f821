//! The meshes and images under `scenes/assets/`, all of which are generated here.
//!
//! To write them: `cargo run -p whitstone-testkit --example write_assets -- scenes/assets`.

use std::f64::consts::TAU;
use std::fmt::Write;
use whitstone_core::DVec3;

/// All assets: file names and contents, identical in every run.
pub fn generate() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("checker.png", checker()),
        ("corners.png", corners()),
        ("crystal.glb", crystal()),
        ("icosphere.ply", icosphere(3)),
        ("icosphere_0.ply", icosphere(0)),
        ("icosphere_1.ply", icosphere(1)),
        ("icosphere_2.ply", icosphere(2)),
        ("leaf.png", leaf()),
        ("sky_nx.png", sky(|s, t| [-1.0, t, -s])),
        ("sky_ny.png", sky(|s, t| [s, -1.0, -t])),
        ("sky_nz.png", sky(|s, t| [s, t, -1.0])),
        ("sky_px.png", sky(|s, t| [1.0, t, s])),
        ("sky_py.png", sky(|s, t| [s, 1.0, t])),
        ("sky_pz.png", sky(|s, t| [-s, t, 1.0])),
        ("star.obj", star().into_bytes()),
        ("stones.png", stones()),
        ("terrain.ply", terrain().into_bytes()),
        ("torus.obj", torus().into_bytes()),
    ]
}

/// A torus around the z axis with radii 0.7 and 0.3: an OBJ of quads with normals, texture
/// coordinates and a texture seam.
fn torus() -> String {
    const AROUND: usize = 32;
    const ACROSS: usize = 16;
    let mut text = String::from("# A torus about the z axis, radii 0.7 and 0.3.\no torus\n");
    let circle = |i: usize, n: usize| (TAU * i as f64 / n as f64).sin_cos();
    let (mut normals, mut uvs, mut faces) = (String::new(), String::new(), String::new());
    for i in 0..AROUND {
        let (sin, cos) = circle(i, AROUND);
        for j in 0..ACROSS {
            let (up, out) = circle(j, ACROSS);
            let normal = DVec3::new(out * cos, out * sin, up);
            let point = 0.7 * DVec3::new(cos, sin, 0.0) + 0.3 * normal;
            line(&mut text, "v", &point.to_array());
            line(&mut normals, "vn", &normal.to_array());
        }
    }
    for i in 0..=AROUND {
        for j in 0..=ACROSS {
            line(
                &mut uvs,
                "vt",
                &[i as f64 / AROUND as f64, j as f64 / ACROSS as f64],
            );
        }
    }
    for i in 0..AROUND {
        for j in 0..ACROSS {
            let corner = |i: usize, j: usize| {
                let point = 1 + (i % AROUND) * ACROSS + j % ACROSS;
                let uv = 1 + i * (ACROSS + 1) + j;
                format!(" {point}/{uv}/{point}")
            };
            let corners = [
                corner(i, j),
                corner(i + 1, j),
                corner(i + 1, j + 1),
                corner(i, j + 1),
            ];
            faces += &format!("f{}\n", corners.concat());
        }
    }
    text + &uvs + &normals + &faces
}

/// A scene in glTF: two crystals of one mesh with vertex colours, one mirrored and turned, over a
/// floor with an embedded picture; a camera and a light.
fn crystal() -> Vec<u8> {
    let mut binary: Vec<u8> = Vec::new();
    let mut views = String::new();
    let mut add = |bytes: Vec<u8>| {
        while !binary.len().is_multiple_of(4) {
            binary.push(0);
        }
        let comma = if views.is_empty() { "" } else { "," };
        let (offset, length) = (binary.len(), bytes.len());
        write!(
            views,
            "{comma}{{\"buffer\":0,\"byteOffset\":{offset},\"byteLength\":{length}}}"
        )
        .expect("a string can be written to");
        binary.extend(bytes);
    };
    let floats = |values: &[f32]| {
        values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect::<Vec<u8>>()
    };
    // Six sides between a low and a high point.
    let ring: Vec<[f32; 3]> = (0..6)
        .map(|k| {
            let (sin, cos) = (TAU * f64::from(k) / 6.0).sin_cos();
            [(0.35 * cos) as f32, 0.5, (0.35 * sin) as f32]
        })
        .collect();
    let mut points = vec![[0.0, 0.0, 0.0], [0.0, 1.4, 0.0]];
    points.extend(ring);
    let colors: [[u8; 4]; 8] = [
        [40, 10, 90, 255],
        [255, 240, 200, 255],
        [230, 60, 60, 255],
        [230, 160, 40, 255],
        [200, 220, 60, 255],
        [60, 200, 90, 255],
        [60, 150, 220, 255],
        [150, 80, 220, 255],
    ];
    let sides = (0..6u8).flat_map(|k| {
        let (here, next) = (2 + k, 2 + (k + 1) % 6);
        [[here, next, 0], [next, here, 1]]
    });
    add(floats(points.as_flattened()));
    add(colors.as_flattened().to_vec());
    add(sides.flatten().collect());
    add(floats(&[
        -2.0, 0.0, 2.0, 2.0, 0.0, 2.0, -2.0, 0.0, -2.0, 2.0, 0.0, -2.0,
    ]));
    add(vec![0, 0, 4, 0, 0, 4, 4, 4]);
    add(checker());
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0,1,2,3,4]}}],
"nodes":[{{"name":"floor","mesh":1}},
{{"name":"crystal","mesh":0,"translation":[-0.5,0,0]}},
{{"name":"mirrored crystal","mesh":0,"translation":[0.6,0,0.3],"rotation":[0,0,-0.2588190451,0.9659258263],"scale":[0.7,0.7,-0.7]}},
{{"name":"eye","camera":0,"translation":[0,1.2,3.6],"rotation":[-0.1305261922,0,0,0.9914448614]}},
{{"name":"lamp","translation":[1.5,3,2],"extensions":{{"KHR_lights_punctual":{{"light":0}}}}}}],
"cameras":[{{"type":"perspective","perspective":{{"yfov":0.7,"znear":0.01,"aspectRatio":1.3333334}}}}],
"extensionsUsed":["KHR_lights_punctual"],
"extensions":{{"KHR_lights_punctual":{{"lights":[{{"type":"point","intensity":40}}]}}}},
"meshes":[{{"name":"crystal","primitives":[{{"attributes":{{"POSITION":0,"COLOR_0":1}},"indices":2,"material":0}}]}},
{{"name":"floor","primitives":[{{"attributes":{{"POSITION":3,"TEXCOORD_0":4}},"mode":5,"material":1}}]}}],
"materials":[{{"name":"crystal","pbrMetallicRoughness":{{"metallicFactor":0.3,"roughnessFactor":0.2}}}},
{{"name":"floor","pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}},"metallicFactor":0}}}}],
"textures":[{{"source":0,"sampler":0}}],"samplers":[{{"magFilter":9728,"minFilter":9728}}],
"images":[{{"name":"checker","bufferView":5,"mimeType":"image/png"}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":8,"type":"VEC3","min":[-0.35,0,-0.3031089],"max":[0.35,1.4,0.3031089]}},
{{"bufferView":1,"componentType":5121,"normalized":true,"count":8,"type":"VEC4"}},
{{"bufferView":2,"componentType":5121,"count":36,"type":"SCALAR"}},
{{"bufferView":3,"componentType":5126,"count":4,"type":"VEC3","min":[-2,0,-2],"max":[2,0,2]}},
{{"bufferView":4,"componentType":5121,"count":4,"type":"VEC2"}}],
"bufferViews":[{views}],"buffers":[{{"byteLength":{}}}]}}"#,
        binary.len()
    );
    let mut json = json.into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let mut bytes = b"glTF".to_vec();
    let chunks: [(&[u8; 4], &[u8]); 2] = [(b"JSON", &json), (b"BIN\0", &binary)];
    let total = 12 + chunks.iter().map(|(_, chunk)| 8 + chunk.len()).sum::<usize>();
    bytes.extend(2u32.to_le_bytes());
    bytes.extend((total as u32).to_le_bytes());
    for (kind, chunk) in chunks {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    bytes
}

/// A coarse pot for subdivision: walls over a six-pointed star, with a bottom and without a lid. An
/// OBJ with texture coordinates, with seams at one vertical edge and at the bottom.
fn star() -> String {
    const AROUND: usize = 12;
    const HIGH: usize = 2;
    let mut text = String::from("# A pot over a star of six points, open at the top.\no star\n");
    let (mut uvs, mut faces) = (String::new(), String::new());
    for j in 0..=HIGH {
        for i in 0..AROUND {
            let (sin, cos) = (TAU * i as f64 / AROUND as f64).sin_cos();
            let radius = if i % 2 == 0 { 1.0 } else { 0.5 };
            line(&mut text, "v", &[radius * cos, radius * sin, 0.6 * j as f64]);
        }
    }
    line(&mut text, "v", &[0.0, 0.0, 0.0]);
    for j in 0..=HIGH {
        for i in 0..=AROUND {
            line(
                &mut uvs,
                "vt",
                &[i as f64 / AROUND as f64, j as f64 / HIGH as f64],
            );
        }
    }
    for j in 0..HIGH {
        for i in 0..AROUND {
            let corner =
                |i: usize, j: usize| format!(" {}/{}", 1 + j * AROUND + i % AROUND, 1 + j * (AROUND + 1) + i);
            let [a, b, c, d] = [
                corner(i, j),
                corner(i + 1, j),
                corner(i + 1, j + 1),
                corner(i, j + 1),
            ];
            faces += &format!("f{a}{b}{c}\nf{a}{c}{d}\n");
        }
    }
    for i in 0..AROUND {
        let (middle, next) = ((HIGH + 1) * AROUND + 1, 1 + (i + 1) % AROUND);
        faces += &format!("f {middle}/1 {next}/{} {}/{}\n", 2 + i, 1 + i, 1 + i);
    }
    text + &uvs + &faces
}

/// A unit sphere of 20 * 4^`levels` triangles: a little-endian PLY with normals.
fn icosphere(levels: usize) -> Vec<u8> {
    let (positions, triangles) = subdivided_icosahedron(levels);
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\ncomment a unit sphere from an icosahedron\n\
         element vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property float nx\nproperty float ny\nproperty float nz\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        positions.len(),
        triangles.len()
    )
    .into_bytes();
    for p in &positions {
        let position = p.to_array().map(|x| x as f32);
        for x in position.iter().chain(&position) {
            bytes.extend(x.to_le_bytes());
        }
    }
    for triangle in &triangles {
        bytes.push(3);
        for index in triangle {
            bytes.extend((*index as i32).to_le_bytes());
        }
    }
    bytes
}

/// An icosahedron whose triangles are split into four, `steps` times, with all vertices on the unit
/// sphere.
fn subdivided_icosahedron(steps: usize) -> (Vec<DVec3>, Vec<[usize; 3]>) {
    let golden = 0.5 * (1.0 + 5f64.sqrt());
    let mut positions = Vec::new();
    for (a, b) in [(-1.0, golden), (1.0, golden), (-1.0, -golden), (1.0, -golden)] {
        positions.extend([
            DVec3::new(a, b, 0.0),
            DVec3::new(0.0, a, b),
            DVec3::new(b, 0.0, a),
        ]);
    }
    for p in &mut positions {
        *p = p.normalize();
    }
    // Neighbours are vertices one edge length apart; faces are triples of neighbours.
    let edge = positions
        .iter()
        .map(|p| p.distance(positions[0]))
        .filter(|d| *d > 0.0)
        .fold(2.0, f64::min);
    let near = |a: usize, b: usize| (positions[a].distance(positions[b]) - edge).abs() < 1e-9;
    let mut triangles = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b) && near(b, c) && near(a, c) {
                    let [p, q, r] = [a, b, c].map(|i| positions[i]);
                    let outside = (q - p).cross(r - p).dot(p) > 0.0;
                    triangles.push(if outside { [a, b, c] } else { [a, c, b] });
                }
            }
        }
    }
    for _ in 0..steps {
        let mut middles = std::collections::BTreeMap::new();
        let mut finer = Vec::new();
        for &[a, b, c] in &triangles {
            let mut middle = |i: usize, j: usize| {
                *middles.entry((i.min(j), i.max(j))).or_insert_with(|| {
                    positions.push((positions[i] + positions[j]).normalize());
                    positions.len() - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    (positions, triangles)
}

/// Hills over the square -1 <= x, y <= 1, up to 0.3 high: an ASCII PLY of triangles without
/// normals.
fn terrain() -> String {
    const CELLS: usize = 32;
    let side = CELLS + 1;
    let mut text = format!(
        "ply\nformat ascii 1.0\ncomment hills over a square\nelement vertex {}\nproperty float x\n\
         property float y\nproperty float z\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        side * side,
        2 * CELLS * CELLS
    );
    let at = |i: usize| 2.0 * i as f64 / CELLS as f64 - 1.0;
    for j in 0..side {
        for i in 0..side {
            let (x, y) = (at(i), at(j));
            let hills = (5.0 * x + 1.0).sin() * (4.0 * y).cos() + 0.5 * (11.0 * x - 7.0 * y).sin();
            let words = [x, y, 0.2 * hills].map(decimal);
            text += &format!("{}\n", words.join(" "));
        }
    }
    for j in 0..CELLS {
        for i in 0..CELLS {
            let first = j * side + i;
            let [a, b, c, d] = [first, first + 1, first + side + 1, first + side];
            text += &format!("3 {a} {b} {c}\n3 {a} {c} {d}\n");
        }
    }
    text
}

/// An image of 32 x 32 pixels, 8-bit sRGB. Each corner has its own colour (red top left, green top
/// right, blue bottom left, white bottom right), so that a rotated or mirrored texture is obvious.
/// Between them is a ramp, dark at the left, with a grid of single texels.
fn corners() -> Vec<u8> {
    const SIZE: u32 = 32;
    let picture = image::RgbImage::from_fn(SIZE, SIZE, |x, y| {
        let (left, top) = (x < SIZE / 4, y < SIZE / 4);
        let (right, bottom) = (x >= SIZE - SIZE / 4, y >= SIZE - SIZE / 4);
        image::Rgb(match () {
            () if left && top => [230, 30, 30],
            () if right && top => [30, 200, 30],
            () if left && bottom => [40, 60, 240],
            () if right && bottom => [250, 250, 250],
            () if x % 4 == 0 && y % 4 == 0 => [20, 20, 20],
            () => [(60 + 5 * x) as u8, (60 + 4 * y) as u8, 120],
        })
    });
    png(&picture)
}

/// A checkerboard of 8 x 8 squares in 128 x 128 pixels, 8-bit sRGB, without pure black and white.
fn checker() -> Vec<u8> {
    const SIZE: u32 = 128;
    const SQUARE: u32 = 16;
    let picture = image::RgbImage::from_fn(SIZE, SIZE, |x, y| {
        let light = (x / SQUARE + y / SQUARE).is_multiple_of(2);
        image::Rgb(if light { [240; 3] } else { [30, 40, 60] })
    });
    png(&picture)
}

/// A leaf with a hole, 32 x 32 pixels, 8-bit sRGB and alpha (pixel coverage). The colour is green
/// everywhere, even where alpha is 0: it is not premultiplied.
fn leaf() -> Vec<u8> {
    const SIZE: u32 = 32;
    const PARTS: u32 = 8;
    let covers = |x: f64, y: f64| {
        let wide = 0.75 * (1.0 - y * y) * (1.0 - 0.35 * y);
        let teeth = 1.0 - 0.5 * (4.0 * y - (4.0 * y).floor());
        let hole = (x - 0.25) * (x - 0.25) + (y - 0.2) * (y - 0.2) < 0.02;
        (x.abs() < wide * teeth && !hole) || (x.abs() < 0.06 && y < 0.0)
    };
    let picture = image::RgbaImage::from_fn(SIZE, SIZE, |i, j| {
        let at =
            |k: u32, part: u32| (2.0 * f64::from(PARTS * k + part) + 1.0) / f64::from(PARTS * SIZE) - 1.0;
        let parts = (0..PARTS * PARTS).filter(|part| covers(at(i, part % PARTS), -at(j, part / PARTS)));
        let alpha = 255 * parts.count() as u32 / (PARTS * PARTS);
        let vein = i.abs_diff(SIZE / 2) < 1 || (i.abs_diff(SIZE / 2) + j) % 7 == 0;
        let green = if vein { 170 } else { 120 + 2 * j as u8 };
        image::Rgba([60, green, 40, alpha as u8])
    });
    png(&picture)
}

/// A stone wall in several tones with dark joints: a sample for texture synthesis.
fn stones() -> Vec<u8> {
    const SIZE: u32 = 48;
    const CELL: u32 = 12;
    let stone = |i: u32, j: u32| {
        let hash = whitstone_core::hash::mix(64 * j + i);
        let at = |cell: u32, bits: u32| (CELL * cell + bits % CELL) as i32;
        ([at(i, hash), at(j, hash >> 8)], (hash >> 16) % 80)
    };
    let picture = image::RgbImage::from_fn(SIZE, SIZE, |x, y| {
        // Include one more cell on each side.
        let (x, y) = ((x + CELL) as i32, (y + CELL) as i32);
        let mut near: Vec<(i32, u32)> = (0..SIZE / CELL + 2)
            .flat_map(|j| (0..SIZE / CELL + 2).map(move |i| stone(i, j)))
            .map(|([a, b], tone)| ((x - a).pow(2) + (y - b).pow(2), tone))
            .collect();
        near.sort_unstable();
        let tone = 90 + near[0].1 as i32 - near[0].0 / 4;
        let tone = if near[1].0 - near[0].0 < 14 { 35 } else { tone };
        image::Rgb([(tone + 20) as u8, tone as u8, (tone - 15) as u8])
    });
    png(&picture)
}

/// A cube map face of a sky, by the direction for (right, up) coordinates from -1 to 1: haze and a
/// sun over hills and fields. It differs all around, so that a rotated face does not match its
/// neighbours.
fn sky(direction: impl Fn(f64, f64) -> [f64; 3]) -> Vec<u8> {
    const SIZE: u32 = 48;
    let picture = image::RgbImage::from_fn(SIZE, SIZE, |i, j| {
        let at = |k: u32| (f64::from(k) + 0.5) / f64::from(SIZE) * 2.0 - 1.0;
        // Square roots and products only: sines differ between machines.
        let [x, y, z] = DVec3::from_array(direction(at(i), -at(j))).normalize().to_array();
        let sun = 0.48 * x + 0.6 * y - 0.64 * z;
        let hills = 0.06 + 0.1 * x * (1.0 - 4.0 * z * z) + 0.08 * z;
        let color = if y < -0.12 {
            // Fields on a ground plane.
            let (column, row) = ((4.0 * x / -y).floor(), (4.0 * z / -y).floor());
            let light = (column + row).rem_euclid(2.0) == 0.0;
            if light {
                [150.0, 160.0, 70.0]
            } else {
                [90.0, 115.0, 50.0]
            }
        } else if y < hills {
            [60.0, 80.0 + 200.0 * (hills - y), 70.0]
        } else if sun > 0.97 {
            [255.0, 250.0, 220.0]
        } else {
            let haze = (1.0 - y) * (1.0 - y);
            let glow = 60.0 * sun.max(0.0) * sun.max(0.0);
            [
                70.0 + 100.0 * haze + glow,
                120.0 + 70.0 * haze + 0.8 * glow,
                200.0 + 20.0 * haze,
            ]
        };
        image::Rgb(color.map(|c| c as u8))
    });
    png(&picture)
}

fn png<P>(picture: &image::ImageBuffer<P, Vec<u8>>) -> Vec<u8>
where
    P: image::PixelWithColorType<Subpixel = u8>,
{
    let mut bytes = std::io::Cursor::new(Vec::new());
    let written = picture.write_to(&mut bytes, image::ImageFormat::Png);
    written.expect("memory takes all that is written");
    bytes.into_inner()
}

fn line(text: &mut String, keyword: &str, numbers: &[f64]) {
    let words: Vec<String> = numbers.iter().copied().map(decimal).collect();
    writeln!(text, "{keyword} {}", words.join(" ")).expect("a string takes all that is written");
}

/// Five decimals, few enough to hide differences between the sines of different machines. Negative
/// zero becomes zero.
fn decimal(x: f64) -> String {
    let text = format!("{x:.5}");
    match text.as_str() {
        "-0.00000" => "0.00000".to_owned(),
        _ => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn assets_are_small_and_always_the_same() {
        let assets = generate();
        assert_eq!(assets, generate());
        for (name, bytes) in assets {
            assert!(
                (100..100_000).contains(&bytes.len()),
                "{name} has {} bytes",
                bytes.len()
            );
        }
    }

    #[test]
    fn the_icosphere_is_closed_and_faces_outward() {
        let (positions, triangles) = subdivided_icosahedron(3);
        assert_eq!((positions.len(), triangles.len()), (642, 1280));
        let mut edges = std::collections::BTreeSet::new();
        for [a, b, c] in triangles {
            let [p, q, r] = [a, b, c].map(|i| positions[i]);
            assert!((q - p).cross(r - p).dot(p) > 0.0);
            // Every edge occurs once in each direction.
            assert!(
                [(a, b), (b, c), (c, a)]
                    .into_iter()
                    .all(|edge| edges.insert(edge))
            );
        }
        assert!(edges.iter().all(|&(a, b)| edges.contains(&(b, a))));
    }
}
