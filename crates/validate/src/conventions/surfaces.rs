//! The probes of surfaces, and the conventions that each can show.

use super::choices::{Alternative, Choice, Number, Others};
use super::probe::{BALL, Camera, Probe, TEXELS};
use super::spot::{Edge, Spot};
use whitstone_image::Transfer;

/// A ball, as a sphere or as a mesh.
fn ball(is_mesh: bool, center: [f64; 3], radius: f64, material: &str) -> String {
    let shape = match is_mesh {
        true => format!(
            "type = \"mesh\"\nfile = \"{BALL}\"\nshading = \"flat\"\ntransform = [{{ scale = {radius:?} }}, {{ translate = {center:?} }}]"
        ),
        false => format!("type = \"sphere\"\ncenter = {center:?}\nradius = {radius:?}"),
    };
    format!("[[shape]]\n{shape}\nmaterial = {{ {material} }}\n")
}

fn rectangle(transform: &str, material: &str) -> String {
    format!("[[shape]]\ntype = \"rectangle\"\ntransform = [{transform}]\nmaterial = {{ {material} }}\n")
}

fn matte(reflectance: [f64; 3]) -> String {
    format!("type = \"matte\", reflectance = {reflectance:?}")
}

/// The convention of shadows, and the change of a scene without them.
pub(super) const SHADOWS: &str = "shadows";
pub(super) const WITHOUT_SHADOWS: &str = "integrator={type=\"whitted\",shadows=\"none\"}";

const UP: [f64; 3] = [0.0, 1.0, 0.0];
const DIRECTIONAL: &str = "[[light]]\ntype = \"directional\"\ndirection = [2, -0.5, -3]\nirradiance = 2\n";
const POINT: &str = "[[light]]\ntype = \"point\"\nposition = [-3, 2, 4]\nintensity = 40\n";
/// The colours of the first two probes.
const COLORS: [[f64; 3]; 3] = [[0.8, 0.5, 0.3], [0.3, 0.7, 0.5], [0.4, 0.4, 0.9]];
const WALL: &str = "{ rotate = { axis = [1, 0.4, 0], degrees = -25 } }, { translate = [0.5, 0.3, -2] }";

/// Balls and a wall without any symmetry, in directional light and in that of a point, which cast
/// shadows on the wall.
pub(super) fn light(is_mesh: bool, is_point: bool) -> Probe {
    let body = [
        ball(is_mesh, [-1.0, 0.4, 0.0], 0.8, &matte(COLORS[0])),
        ball(is_mesh, [0.9, -0.5, 0.5], 0.6, &matte(COLORS[1])),
        rectangle(WALL, &matte(COLORS[2])),
    ];
    let (name, folder, lights) = match is_point {
        false => ("a directional light", "directional", DIRECTIONAL),
        true => ("a point light", "point", POINT),
    };
    Probe {
        name,
        folder,
        camera: Camera {
            origin: [0.3, 0.5, 5.0],
            target: [0.0; 3],
            up: UP,
            fov: 50.0,
        },
        body: body.concat(),
        lights: lights.to_owned(),
        exactly: None,
    }
}

/// What may be otherwise in these probes.
pub(super) fn of_light(is_point: bool) -> Vec<Choice> {
    let decoded: Vec<String> = (COLORS.iter().enumerate())
        .map(|(index, color)| {
            let color = color.map(|part| Transfer::Srgb.decode(part));
            format!("shape.{index}.material.reflectance={color:?}")
        })
        .collect();
    let decoded: Vec<&str> = decoded.iter().map(String::as_str).collect();
    let wall =
        |steps: &str, sentence: &str| Alternative::new(&[&format!("shape.2.transform=[{steps}]")], sentence);
    let mut choices = vec![
        Choice::words(
            SHADOWS,
            vec![Alternative::new(&[WITHOUT_SHADOWS], "surfaces cast no shadows")],
        ),
        Choice::words(
            "colours",
            vec![Alternative::new(
                &decoded,
                "the colours of the scene are decoded from sRGB, although they are linear",
            )],
        ),
        Choice::words(
            "transforms",
            vec![
                wall(
                    "{rotate={axis=[1,0.4,0],degrees=25}},{translate=[0.5,0.3,-2]}",
                    "rotations turn the other way: they are counter-clockwise when looking against the axis",
                ),
                wall(
                    "{translate=[0.5,0.3,-2]},{rotate={axis=[1,0.4,0],degrees=-25}}",
                    "the steps of a transform are applied in the reverse order",
                ),
                wall(
                    "{rotate={axis=[1,0.4,0],degrees=-1432.394488}},{translate=[0.5,0.3,-2]}",
                    "the degrees of a rotation are taken as radians",
                ),
            ],
        ),
    ];
    choices.push(match is_point {
        false => Choice::words(
            "light direction",
            vec![Alternative::new(
                &["light.0.direction=[-2,0.5,3]"],
                "a directional light comes from its `direction`: it must shine along it",
            )],
        ),
        true => Choice::words(
            "falloff",
            vec![Alternative::new(
                &["light.0.falloff=\"none\""],
                "the light of a point does not fall off with the squared distance",
            )],
        ),
    });
    choices
}

/// A wall, with a ball before it, in the light of a spot whose whole edge is seen.
pub(super) fn spot(is_mesh: bool) -> Probe {
    let body = [
        ball(is_mesh, [0.5, 0.3, 0.5], 0.5, &matte(COLORS[0])),
        rectangle(
            "{ scale = 6 }, { rotate = { axis = [1, 0.4, 0], degrees = -12 } }, { translate = [0, 0, -1] }",
            &matte(COLORS[2]),
        ),
    ];
    Probe {
        name: "a spot",
        folder: "spot",
        camera: Camera {
            origin: [0.3, 0.5, 5.0],
            target: [0.0; 3],
            up: UP,
            fov: 50.0,
        },
        body: body.concat(),
        lights: Spot::STATED.light(),
        exactly: Some("spot"),
    }
}

pub(super) fn of_spot() -> Vec<Choice> {
    const CUTOFF: f64 = Spot::STATED.cutoff;
    const BEAM: f64 = Spot::STATED.beam;
    let cone = |cutoff: f64, beam: f64, sentence: &str| {
        Alternative::of_spot(move |spot| Spot { cutoff, beam, ..spot }, sentence)
    };
    let edge = |edge: Edge, words: &str| {
        let sentence = format!(
            "the light of a spot falls off {words}: between `beam_width` and the cutoff it must be linear in the angle"
        );
        Alternative::of_spot(move |spot| Spot { edge, ..spot }, sentence)
    };
    // The model has no edge without a width.
    let just_below = |angle: f64| angle * (1.0 - 1e-9);
    vec![
        Choice::words(
            "cone of a spot",
            vec![
                cone(
                    0.5 * CUTOFF,
                    0.5 * BEAM,
                    "the angles of a spot are taken as whole ones: they are from the axis to the edge",
                ),
                cone(
                    2.0 * CUTOFF,
                    2.0 * BEAM,
                    "the angles of a spot are twice as large as stated",
                ),
                cone(
                    CUTOFF,
                    just_below(CUTOFF),
                    "a spot has a hard edge at its cutoff: its light must fall off from `beam_width` on",
                ),
                cone(
                    BEAM,
                    just_below(BEAM),
                    "a spot ends at its `beam_width`: its light must fall off from there to the cutoff",
                ),
                cone(
                    CUTOFF,
                    0.0,
                    "the light of a spot falls off from its axis on: it must be constant up to `beam_width`",
                ),
                cone(
                    CUTOFF,
                    0.75 * CUTOFF,
                    "the `beam_width` of a spot is three quarters of its cutoff, whatever is stated",
                ),
            ],
        ),
        Choice::words(
            "edge of a spot",
            vec![
                edge(Edge::Cosine, "linearly with the cosine of the angle"),
                edge(
                    Edge::SquaredCosine,
                    "with the square of a linear function of the cosine",
                ),
                edge(Edge::SmoothCosine, "by a smooth step of the cosine of the angle"),
                edge(Edge::SmoothAngle, "by a smooth step of the angle"),
            ],
        ),
        Choice::words(
            "falloff of spots",
            vec![Alternative::of_spot(
                |spot| Spot {
                    has_falloff: false,
                    ..spot
                },
                "the light of a spot does not fall off with the squared distance",
            )],
        ),
    ]
}

/// A wall with an image of 8 x 8 texels.
pub(super) fn texture() -> Probe {
    let paint = format!(
        "type = \"matte\", reflectance = {{ type = \"image\", file = \"{}\" }}",
        TEXELS.0
    );
    Probe {
        name: "a texture",
        folder: "texture",
        camera: Camera {
            origin: [0.4, 0.3, 4.0],
            target: [0.0; 3],
            up: UP,
            fov: 42.0,
        },
        body: rectangle("{ scale = [1.3, 0.9, 1] }", &paint),
        lights: "[[light]]\ntype = \"directional\"\ndirection = [0.2, -0.3, -1]\nirradiance = 3\n".to_owned(),
        exactly: None,
    }
}

pub(super) fn of_texture() -> Vec<Choice> {
    const KEY: &str = "shape.0.material.reflectance";
    let turned = |rows: &str, sentence: &str| {
        Alternative::new(
            &[&format!(
                "{KEY}.mapping={{transform={{matrix=[{rows},[0,0,1,0]]}}}}"
            )],
            sentence,
        )
    };
    let half = 0.5 / TEXELS.1 as f64;
    let moved = |x: f64, y: f64| {
        let words = |value: f64, before: &str, after: &str| match value {
            0.0 => None,
            value if value < 0.0 => Some(before.to_owned()),
            _ => Some(after.to_owned()),
        };
        let parts = [words(x, "to the left", "to the right"), words(y, "up", "down")];
        let place = parts.into_iter().flatten().collect::<Vec<String>>().join(" and ");
        // The offset takes the place on the surface to the place in the image.
        Alternative::new(
            &[&format!("{KEY}.offset=[{:?},{:?}]", -x * half, y * half)],
            format!("the centres of texels are half a texel off, {place} in the image file"),
        )
    };
    let mut centers = Vec::new();
    for y in [-1.0, 0.0, 1.0] {
        for x in [-1.0, 0.0, 1.0] {
            if [x, y] != [0.0; 2] {
                centers.push(moved(x, y));
            }
        }
    }
    let inner = 1.0 - 2.0 * half;
    centers.push(Alternative::new(
        &[
            &format!("{KEY}.scale={inner:?}"),
            &format!("{KEY}.offset=[{half:?},{half:?}]"),
        ],
        "the centres of the first and the last texels are at the edges of the texture: u and v are multiplied by the number of texels less 1",
    ));
    vec![
        Choice::words(
            "texture origin",
            vec![
                turned(
                    "[1,0,0,0],[0,-1,0,1]",
                    "textures are upside down: v = 0 must be the bottom row of an image file",
                ),
                turned("[-1,0,0,1],[0,1,0,0]", "the columns of textures are reversed"),
                turned("[-1,0,0,1],[0,-1,0,1]", "textures are turned by 180 degrees"),
                turned("[0,1,0,0],[1,0,0,0]", "u and v of textures are exchanged"),
                turned(
                    "[0,1,0,0],[-1,0,0,1]",
                    "textures are turned by 90 degrees, counter-clockwise",
                ),
                turned(
                    "[0,-1,0,1],[1,0,0,0]",
                    "textures are turned by 90 degrees, clockwise",
                ),
                turned(
                    "[0,-1,0,1],[-1,0,0,1]",
                    "u and v of textures are exchanged and reversed",
                ),
            ],
        ),
        Choice::words("texel centres", centers),
        Choice::words(
            "texture filter",
            vec![Alternative::new(
                &[&format!("{KEY}.filter=\"nearest\"")],
                "textures show the nearest texel, and are not interpolated",
            )],
        ),
        Choice::words(
            "texture colours",
            vec![Alternative::new(
                &[&format!("{KEY}.color_space=\"linear\"")],
                "the codes of a texture are taken as linear values: colours in PNG files are sRGB",
            )],
        ),
        Choice::words(
            "texture wrapping",
            vec![
                Alternative::new(
                    &[&format!("{KEY}.wrap=\"clamp\"")],
                    "textures end in their last texel instead of being repeated",
                ),
                Alternative::new(
                    &[&format!("{KEY}.wrap=\"mirror\"")],
                    "textures are mirrored instead of being repeated",
                ),
            ],
        ),
    ]
}

/// The index that a probe states.
const STATED_INDEX: f64 = 1.8;
/// The default of the model.
const DEFAULT_INDEX: f64 = 1.5;

/// Two balls of glass before coloured balls and a wall: the left one without a stated index.
pub(super) fn glass(is_mesh: bool) -> Probe {
    let mut body = vec![
        ball(is_mesh, [-1.0, 0.1, 1.5], 0.8, "type = \"dielectric\""),
        ball(
            is_mesh,
            [1.0, -0.1, 1.5],
            0.8,
            &format!("type = \"dielectric\", interior_ior = {STATED_INDEX}"),
        ),
    ];
    for (center, radius, color) in [
        ([-2.2, 1.1, -1.0], 0.7, [0.8, 0.3, 0.2]),
        ([-0.9, -1.3, -1.4], 0.6, [0.2, 0.7, 0.3]),
        ([0.3, 1.0, -1.2], 0.6, [0.2, 0.3, 0.8]),
        ([1.4, -1.0, -1.0], 0.5, [0.8, 0.8, 0.2]),
        ([2.4, 0.7, -1.3], 0.7, [0.7, 0.2, 0.7]),
    ] {
        body.push(ball(is_mesh, center, radius, &matte(color)));
    }
    body.push(rectangle(
        "{ scale = 12 }, { translate = [0, 0, -3] }",
        &matte([0.5; 3]),
    ));
    Probe {
        name: "glass",
        folder: "glass",
        camera: Camera {
            origin: [0.0, 0.2, 6.0],
            target: [0.0, 0.0, 1.5],
            up: UP,
            fov: 50.0,
        },
        body: body.concat(),
        lights: "[[light]]\ntype = \"directional\"\ndirection = [-0.3, -0.4, -1]\nirradiance = 3\n"
            .to_owned(),
        exactly: None,
    }
}

pub(super) fn of_glass() -> Vec<Choice> {
    // Water, acrylic, crown glasses, heavier ones, diamond; and sides that are exchanged.
    let tried = || {
        vec![
            1.0,
            1.0 / DEFAULT_INDEX,
            1.0 / STATED_INDEX,
            1.2,
            1.33,
            1.4,
            1.45,
            1.5,
            1.52,
            1.6,
            1.7,
            1.8,
            2.0,
            2.42,
        ]
    };
    let index = |shape: usize, sentence: Box<dyn Fn(f64) -> String>| {
        Others::Number(Number {
            tried: tried(),
            changes: Box::new(move |index| vec![format!("shape.{shape}.material.interior_ior={index:?}")]),
            sentence,
        })
    };
    vec![
        Choice {
            convention: "default index",
            others: index(
                0,
                Box::new(|index| {
                    format!(
                        "glass without a stated index of refraction has the index {index:.3} instead of {DEFAULT_INDEX}"
                    )
                }),
            ),
        },
        Choice {
            convention: "stated index",
            others: index(
                1,
                Box::new(|index| {
                    let inverse = match (index * STATED_INDEX - 1.0).abs() < 5e-3 {
                        true => ": inside and outside are exchanged",
                        false => "",
                    };
                    format!(
                        "glass with the stated index of refraction {STATED_INDEX} has the index {index:.3}{inverse}"
                    )
                }),
            ),
        },
        Choice::words(
            "shadows of glass",
            vec![Alternative::new(
                &["shape.0.casts_shadow=false", "shape.1.casts_shadow=false"],
                "glass casts no shadow: every surface must hide a light",
            )],
        ),
    ]
}

/// Two walls next to the line of sight, from 2 cm to 10 m before the camera, and what is behind.
/// The view is turned a little, so that no edge passes through the centres or the corners of
/// pixels.
pub(super) fn near() -> Probe {
    const TURN: &str = "{ rotate = { axis = [0, 1, 0], degrees = 90 } }";
    let body = [
        rectangle(
            &format!("{{ scale = [5, 1.5, 1] }}, {TURN}, {{ translate = [-0.01, 1.5, -5] }}"),
            &matte([0.8, 0.4, 0.3]),
        ),
        rectangle(
            &format!("{{ scale = [5, 0.2, 1] }}, {TURN}, {{ translate = [-0.2, -0.2, -5] }}"),
            &matte([0.3, 0.7, 0.4]),
        ),
        rectangle(
            "{ scale = [3, 5, 1] }, { rotate = { axis = [1, 0, 0], degrees = -90 } }, { translate = [0, -0.4, -5] }",
            &matte([0.4, 0.5, 0.8]),
        ),
        rectangle("{ scale = 6 }, { translate = [0, 0, -10] }", &matte([0.6; 3])),
    ];
    Probe {
        name: "near surfaces",
        folder: "near",
        camera: Camera {
            origin: [0.0; 3],
            target: [0.013, 0.007, -1.0],
            up: UP,
            fov: 50.0,
        },
        body: body.concat(),
        lights: "[[light]]\ntype = \"directional\"\ndirection = [-1, -1, -0.5]\nirradiance = 3\n".to_owned(),
        exactly: None,
    }
}

pub(super) fn of_near() -> Vec<Choice> {
    let number = |kind: &'static str, what: &'static str| Choice {
        convention: "near clip",
        others: Others::Number(Number {
            tried: vec![0.02, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0],
            changes: Box::new(move |near| {
                vec![
                    format!("camera.near={near:?}"),
                    format!("camera.near_kind=\"{kind}\""),
                ]
            }),
            sentence: Box::new(move |near| {
                format!(
                    "surfaces nearer to the camera than {near:.3} m, measured {what}, are not seen (a near clip)"
                )
            }),
        }),
    };
    vec![
        number("planar", "along the view"),
        number("spherical", "along the ray"),
    ]
}

/// The distances of the surfaces of the probe of far ones, in metres.
const FAR: [f64; 12] = [
    12.0, 25.0, 50.0, 100.0, 200.0, 500.0, 1e3, 2e3, 5e3, 1e4, 3e4, 1e5,
];

/// Rectangles that look alike, at growing distances. The light comes from so far above that none
/// has its shadow on another one that is seen.
pub(super) fn far() -> Probe {
    let body = FAR.iter().enumerate().map(|(index, distance)| {
        let [column, row] = [index % 4, index / 4].map(|part| part as f64);
        let [x, y] = [0.2 * (column - 1.5), 0.2 * (1.0 - row)].map(|part| part * distance);
        let [a, b] = [0.075, 0.06].map(|half| half * distance);
        let color = COLORS[index % 3].map(|part| part * (1.0 - 0.02 * index as f64));
        rectangle(
            &format!(
                "{{ scale = [{a:?}, {b:?}, {a:?}] }}, {{ translate = [{x:?}, {y:?}, {:?}] }}",
                -distance
            ),
            &matte(color),
        )
    });
    Probe {
        name: "far surfaces",
        folder: "far",
        camera: Camera {
            origin: [0.0; 3],
            target: [0.0, 0.0, -1.0],
            up: UP,
            fov: 50.0,
        },
        body: body.collect(),
        lights: "[[light]]\ntype = \"directional\"\ndirection = [0, -1, -1]\nirradiance = 4\n".to_owned(),
        exactly: None,
    }
}

pub(super) fn of_far() -> Vec<Choice> {
    // The model has no far clip: surfaces go behind the camera.
    let ends = |first: usize| {
        let hidden: Vec<String> = (first..FAR.len())
            .map(|index| format!("shape.{index}.transform=[{{scale=1e-3}},{{translate=[0,0,10]}}]"))
            .collect();
        let hidden: Vec<&str> = hidden.iter().map(String::as_str).collect();
        let seen = match first {
            0 => String::new(),
            first => format!(", and those at {} m are", FAR[first - 1]),
        };
        Alternative::new(
            &hidden,
            format!("surfaces at {} m are not seen{seen} (a far clip)", FAR[first]),
        )
    };
    vec![Choice::words("far clip", (0..FAR.len()).map(ends).collect())]
}
