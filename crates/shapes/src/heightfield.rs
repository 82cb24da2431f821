//! A landscape: a grid of up to 2^26 quads. Its heights are noise, or those of a texture.
//!
//! Value noise in octaves on an integer hash (`lowbias32`: C. Wellons, *Prospecting for hash
//! functions*, 2018), so the result is the same on every machine. Coordinates are rounded to single
//! precision, as in most mesh files. A texture is looked up once per vertex, in object space;
//! `scenes/showcase/height_map.toml` has one.
//!
//! - Twin: Mitsuba mesh (native) with the same vertices.
//! - Example: `scenes/shapes/heightfield.toml`.

use crate::support::lower::{Triangles, lower};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::Deserialize;
use std::ops::Range;
use toml::Spanned;
use whitstone_core::config::{Finite, IntegerIn, NonNegative, TextureRef};
use whitstone_core::hash::mix;
use whitstone_core::{
    ColorSource, Context, DVec2, DVec3, LoweredShape, Plugin, SceneError, SceneErrors, Shapes,
    SurfaceInteraction, Transform,
};

/// Maximum number of quads: twice as many triangles still fit the indices of the accelerators.
const MAX_QUADS: u64 = 1 << 26;

/// A landscape over the square from -1 to 1 in x and y, with z up: a mesh with two triangles per
/// quad. Its heights are noise, or those of the texture `height`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Quads along x; columns times rows is at most 2^26.
    #[serde(default = "size")]
    columns: IntegerIn<1, 65536>,
    /// Quads along y.
    #[serde(default = "size")]
    rows: IntegerIn<1, 65536>,
    /// Of noise: amplitude of the first octave in metres; it halves with each octave.
    #[serde(default)]
    #[schemars(extend("default" = AMPLITUDE), with = "NonNegative")]
    amplitude: Option<Spanned<NonNegative>>,
    /// Of noise: lattice cells ("hills") per side in the first octave; they double with each
    /// octave.
    #[serde(default)]
    #[schemars(extend("default" = HILLS), with = "IntegerIn<1, 1024>")]
    hills: Option<Spanned<IntegerIn<1, 1024>>>,
    /// Of noise: number of octaves.
    #[serde(default)]
    #[schemars(extend("default" = OCTAVES), with = "IntegerIn<1, 16>")]
    octaves: Option<Spanned<IntegerIn<1, 16>>>,
    /// Of noise: its seed.
    #[serde(default)]
    #[schemars(extend("default" = 0), with = "IntegerIn<0, { u32::MAX }>")]
    seed: Option<Spanned<IntegerIn<0, { u32::MAX }>>>,
    /// The height instead of noise: the first channel of a texture, or a colour. It is looked up in
    /// object space, at z = 0 and with (u, v) from (0, 0) at x = y = -1 to (1, 1) at x = y = 1.
    #[serde(default)]
    #[schemars(extend("x-default" = "none: noise"), with = "TextureRef")]
    height: Option<TextureRef>,
    /// With `height`: metres along z for a height of 1; may be negative.
    #[serde(default)]
    #[schemars(extend("default" = 1), with = "Finite")]
    scale: Option<Spanned<Finite>>,
    /// With `height`: the value of the texture that becomes z = 0. A vertex is at z = `scale`
    /// (value - `offset`).
    #[serde(default)]
    #[schemars(extend("default" = 0), with = "Finite")]
    offset: Option<Spanned<Finite>>,
}

const AMPLITUDE: f64 = 0.2;
const HILLS: u32 = 4;
const OCTAVES: u32 = 8;

fn size() -> IntegerIn<1, 65536> {
    IntegerIn::new(64).expect("in range")
}

/// Lowers to triangles in world space.
pub struct Heightfield;

impl Plugin<Shapes> for Heightfield {
    const TYPE: &'static str = "heightfield";
    type Config = Config;

    fn build(
        config: Config,
        transform: Transform,
        context: &mut dyn Context,
    ) -> Result<LoweredShape, SceneErrors> {
        let (columns, rows) = (config.columns.get(), config.rows.get());
        let quads = u64::from(columns) * u64::from(rows);
        if quads > MAX_QUADS {
            let message = format!("{columns} x {rows} is more than {MAX_QUADS} quads");
            return Err(SceneError::anywhere(message).into());
        }
        check_keys(&config)?;
        context.reserve(quads * (size_of::<DVec3>() + 2 * size_of::<[u32; 3]>()) as u64)?;
        let object = match &config.height {
            None => grid([columns, rows], Noise::new(&config).heights([columns, rows])),
            Some(height) => {
                let relief = Relief::new(&config, height, context)?;
                let object = grid([columns, rows], |vertex| relief.height(vertex, [columns, rows]));
                relief.check(&object)?;
                object
            }
        };
        let beyond = || {
            SceneError::anywhere(
                "a vertex is out of the range of double precision: the transform or the amplitude is too large",
            )
        };
        Ok(LoweredShape::Triangles(
            lower(object, &transform).ok_or_else(beyond)?.mesh,
        ))
    }
}

/// Refuses keys of noise with a texture, and those of a texture without.
fn check_keys(config: &Config) -> Result<(), SceneErrors> {
    fn given<T>(key: &Option<Spanned<T>>) -> Option<Range<usize>> {
        key.as_ref().map(Spanned::span)
    }
    let of_noise = [
        given(&config.amplitude),
        given(&config.hills),
        given(&config.octaves),
        given(&config.seed),
    ];
    let of_texture = [given(&config.scale), given(&config.offset)];
    let (wrong, message): (&[_], _) = match config.height {
        Some(_) => (&of_noise, "this key is for noise, which `height` replaces"),
        None => (&of_texture, "this key needs `height`"),
    };
    let errors: Vec<SceneError> = wrong
        .iter()
        .flatten()
        .map(|span| SceneError::at(span.clone(), message))
        .collect();
    if errors.is_empty() {
        Ok(())
    } else {
        Err(SceneErrors(errors))
    }
}

/// x and y of a vertex, before they are rounded.
fn place(vertex: [u32; 2], quads: [u32; 2]) -> DVec2 {
    let across = |k: usize| 2.0 * f64::from(vertex[k]) / f64::from(quads[k]) - 1.0;
    DVec2::new(across(0), across(1))
}

/// The triangles of a grid with these heights.
fn grid([columns, rows]: [u32; 2], height: impl Fn([u32; 2]) -> f64 + Sync) -> Triangles {
    let mut positions = vec![DVec3::ZERO; (columns as usize + 1) * (rows as usize + 1)];
    let lines = positions.par_chunks_mut(columns as usize + 1);
    lines.zip(0..rows + 1).for_each(|(line, j)| {
        for (position, i) in line.iter_mut().zip(0..=columns) {
            let at = place([i, j], [columns, rows]);
            *position = at.extend(height([i, j])).as_vec3().as_dvec3();
        }
    });
    let mut triangles = vec![[0; 3]; 2 * columns as usize * rows as usize];
    let lines = triangles.par_chunks_mut(2 * columns as usize);
    lines.zip(0..rows).for_each(|(line, j)| {
        for (pair, i) in line.chunks_exact_mut(2).zip(0..columns) {
            let a = j * (columns + 1) + i;
            let (b, d) = (a + 1, a + columns + 1);
            let c = d + 1;
            pair[0] = [a, b, c];
            pair[1] = [a, c, d];
        }
    });
    Triangles {
        positions,
        triangles,
        ..Triangles::default()
    }
}

/// The texture that gives the heights.
struct Relief {
    height: ColorSource,
    scale: f64,
    offset: f64,
    /// Source span of the texture, for messages.
    span: Range<usize>,
}

impl Relief {
    fn new(config: &Config, height: &TextureRef, context: &mut dyn Context) -> Result<Self, SceneErrors> {
        let value = |key: &Option<Spanned<Finite>>, default| {
            key.as_ref().map_or(default, |number| number.get_ref().get())
        };
        Ok(Self {
            height: context.texture(height)?,
            scale: value(&config.scale, 1.0),
            offset: value(&config.offset, 0.0),
            span: height.span.clone().unwrap_or(0..0),
        })
    }

    fn height(&self, vertex: [u32; 2], quads: [u32; 2]) -> f64 {
        let mut there = SurfaceInteraction::new(place(vertex, quads).extend(0.0), 0.0, DVec3::Z);
        let [u, v] = [0, 1].map(|k| f64::from(vertex[k]) / f64::from(quads[k]));
        there.uv = DVec2::new(u, v);
        self.scale * (self.height.value(&there).r - self.offset)
    }

    /// Checks that all heights are finite in single precision.
    fn check(&self, object: &Triangles) -> Result<(), SceneErrors> {
        let Some(vertex) = object.positions.iter().find(|vertex| !vertex.is_finite()) else {
            return Ok(());
        };
        let [x, y] = [vertex.x, vertex.y];
        let message = format!("the height at x = {x}, y = {y} is not finite in single precision");
        Err(SceneError::at(self.span.clone(), message).into())
    }
}

/// The noise that gives the heights.
struct Noise(Vec<Octave>);

impl Noise {
    fn new(config: &Config) -> Self {
        let amplitude = config.amplitude.as_ref().map_or(AMPLITUDE, |a| a.get_ref().get());
        let hills = config.hills.as_ref().map_or(HILLS, |hills| hills.get_ref().get());
        let octaves = config.octaves.as_ref().map_or(OCTAVES, |n| n.get_ref().get());
        let seed = config.seed.as_ref().map_or(0, |seed| seed.get_ref().get());
        let octave = |k| Octave {
            hills: u64::from(hills) << k,
            amplitude: amplitude * 0.5f64.powi(k as i32),
            seed: mix(seed.wrapping_add(mix(k))),
        };
        Self((0..octaves).map(octave).collect())
    }

    /// The height of each vertex of a grid with this many quads.
    fn heights(self, quads: [u32; 2]) -> impl Fn([u32; 2]) -> f64 {
        move |vertex| self.0.iter().map(|octave| octave.height(vertex, quads)).sum()
    }
}

/// One octave of noise.
struct Octave {
    /// Lattice cells per side.
    hills: u64,
    amplitude: f64,
    seed: u32,
}

impl Octave {
    /// The height at a vertex of a grid with this many quads.
    fn height(&self, vertex: [u32; 2], quads: [u32; 2]) -> f64 {
        // The product is exact, so there is only one rounding.
        let at = |k: usize| (u64::from(vertex[k]) * self.hills) as f64 / f64::from(quads[k]);
        let (x, y) = (at(0), at(1));
        let (cell_x, cell_y) = (x.floor(), y.floor());
        let (u, v) = (ease(x - cell_x), ease(y - cell_y));
        let corner = |dx: u32, dy: u32| {
            let row = mix(self.seed.wrapping_add(cell_y as u32).wrapping_add(dy));
            let hash = mix(row.wrapping_add(cell_x as u32).wrapping_add(dx));
            f64::from(hash) / 2f64.powi(31) - 1.0
        };
        let between = |a: f64, b: f64, t: f64| a + t * (b - a);
        let near = between(corner(0, 0), corner(1, 0), u);
        let far = between(corner(0, 1), corner(1, 1), u);
        self.amplitude * between(near, far, v)
    }
}

fn ease(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{Rgb, SurfaceAttributes, Texture};
    use whitstone_testkit::{TestContext, build, build_in, shape_laws, shape_laws_everywhere};

    /// An arbitrary height function.
    struct Height(fn(&SurfaceInteraction) -> f64);

    impl Texture for Height {
        fn needs(&self) -> SurfaceAttributes {
            SurfaceAttributes::UV | SurfaceAttributes::SHADING_NORMAL
        }

        fn value(&self, point: &SurfaceInteraction) -> Rgb {
            // Only the first channel counts.
            Rgb::new((self.0)(point), 77.0, 77.0)
        }
    }

    fn with_textures(text: &str, transform: Transform) -> Result<LoweredShape, SceneErrors> {
        let mut context = TestContext::default()
            .with_texture("uv", Height(|p| p.uv.x + 10.0 * p.uv.y))
            .with_texture(
                "place",
                Height(|p| p.position.x + 10.0 * p.position.y + p.n_s.z + p.position.z),
            )
            .with_texture("nan", Height(|p| f64::NAN * p.position.x));
        build_in::<Shapes, Heightfield>(text, transform, &mut context)
    }

    fn mesh(text: &str) -> whitstone_core::TriangleMesh {
        match build::<Shapes, Heightfield>(text, Transform::IDENTITY) {
            Ok(LoweredShape::Triangles(mesh)) => mesh,
            _ => panic!("a heightfield is triangles"),
        }
    }

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws_everywhere::<Heightfield>("columns = 5\nrows = 4\nhills = 2\namplitude = 0.6", 2_000);
    }

    #[test]
    fn vertices_and_quads_are_where_the_model_says() {
        let mesh = mesh("columns = 2\nrows = 1\nseed = 7\noctaves = 1\nhills = 1\namplitude = 1");
        let flat: Vec<[f64; 2]> = mesh.positions.iter().map(|p| [p.x, p.y]).collect();
        assert_eq!(
            flat,
            [
                [-1.0, -1.0],
                [0.0, -1.0],
                [1.0, -1.0],
                [-1.0, 1.0],
                [0.0, 1.0],
                [1.0, 1.0]
            ]
        );
        assert_eq!(mesh.triangles, [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]]);
        // At a lattice point the height is the hash; halfway it is the mean of two.
        let hash = |x: u32, y: u32| mix(mix(mix(7 + mix(0)).wrapping_add(y)).wrapping_add(x));
        let value = |x, y| f64::from(hash(x, y)) / 2f64.powi(31) - 1.0;
        assert_eq!(mesh.positions[0].z, f64::from(value(0, 0) as f32));
        assert_eq!(
            mesh.positions[4].z,
            f64::from((value(0, 1) + 0.5 * (value(1, 1) - value(0, 1))) as f32)
        );
        assert_eq!(mix(1), 0x6889_90c0);
    }

    /// Textures see (u, v) from 0 to 1, and object space whatever the transform is.
    #[test]
    fn heights_are_those_of_the_texture() {
        let turned = Transform::new(
            whitstone_core::DAffine3::from_rotation_x(0.5)
                * whitstone_core::DAffine3::from_translation(DVec3::new(3.0, 4.0, 5.0)),
        )
        .unwrap();
        for (texture, expected) in [
            ("uv", [0.0, 0.5, 1.0, 10.0, 10.5, 11.0]),
            ("place", [-10.0, -9.0, -8.0, 10.0, 11.0, 12.0]),
        ] {
            let text = format!("columns = 2\nrows = 1\nheight = \"{texture}\"\nscale = 0.3\noffset = 0.1");
            let Ok(LoweredShape::Triangles(mesh)) = with_textures(&text, turned) else {
                panic!("a heightfield is triangles");
            };
            for (p, h) in mesh.positions.iter().zip(expected) {
                let z = turned.world_from_object().inverse().transform_point3(*p).z;
                let expected = f64::from((0.3 * (h - 0.1)) as f32);
                assert!((z - expected).abs() < 1e-12, "{texture}: {z}, not {expected}");
            }
            assert_eq!(mesh.triangles, [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]]);
            shape_laws(LoweredShape::Triangles(mesh), 2_000);
        }
        let LoweredShape::Triangles(flat) =
            with_textures("height = 0.75\noffset = 0.25", Transform::IDENTITY).unwrap()
        else {
            panic!("a heightfield is triangles");
        };
        assert_eq!(flat.positions.len(), 65 * 65);
        assert!(flat.positions.iter().all(|p| p.z == 0.5));
    }

    #[test]
    fn keys_of_the_other_kind_are_refused_at_their_places() {
        for (text, places) in [
            (
                "height = 1\namplitude = 2\nhills = 3\noctaves = 4\nseed = 5",
                &["2", "3", "4", "5"][..],
            ),
            ("scale = 2\noffset = 3", &["2", "3"]),
            ("height = -1", &["-1"]),
            ("height = \"nan\"", &["\"nan\""]),
            ("height = 1e30\nscale = 1e30", &["1e30"]),
        ] {
            let errors = with_textures(text, Transform::IDENTITY).err().unwrap();
            let found: Vec<&str> = errors.0.iter().map(|e| &text[e.span.clone().unwrap()]).collect();
            assert_eq!(found, places, "{text}");
        }
    }

    #[test]
    fn too_many_quads_are_refused() {
        let error = build::<Shapes, Heightfield>("columns = 65536\nrows = 65536", Transform::IDENTITY);
        let message = error.err().unwrap().0.remove(0).message;
        assert_eq!(message, "65536 x 65536 is more than 67108864 quads");
    }
}
