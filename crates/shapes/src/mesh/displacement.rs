//! Displacement of vertices along their normals, or by vectors.
//!
//! Cook, *Shade trees*, 1984, section "Displacement maps": unlike bump mapping, which only perturbs
//! the normals, displacement moves the surface, so silhouettes and shadows show it too. The texture
//! is looked up at the vertices, in object space, so the mesh resolution limits the detail of the
//! relief. Vectors can also make overhangs, which heights cannot. All corners at one position move
//! together, so that no gap opens at a seam of texture coordinates.

use super::subdivision::Surface;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use toml::Spanned;
use whitstone_core::config::{Finite, TextureRef, Vector3};
use whitstone_core::{
    ColorSource, Context, DVec2, DVec3, Rgb, SceneError, SceneErrors, SurfaceAttributes, SurfaceInteraction,
    TangentField,
};

/// Moves each vertex along its unit normal by scale times (height - offset), or by scale times a
/// vector.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Displacement {
    /// The height: the first channel of a texture. It is looked up in object space at the
    /// undisplaced vertex, with its texture coordinates and normal.
    #[serde(default)]
    #[schemars(extend("x-default" = "none: this or `vector_map` is required"), with = "TextureRef")]
    height: Option<TextureRef>,
    /// Vectors instead of a height, looked up in the same way: 2 * colour - 1, so that mid grey
    /// (0.5) is the zero vector. Read images with `color_space = "linear"`.
    #[serde(default)]
    #[schemars(extend("x-default" = "none: this or `height` is required"), with = "TextureRef")]
    vector_map: Option<TextureRef>,
    /// Displacement in object-space metres for a height of 1, outward, or for a vector of length 1;
    /// may be negative.
    #[serde(default = "one")]
    #[schemars(with = "Finite")]
    scale: Spanned<Finite>,
    /// The height at which a vertex does not move.
    #[serde(default)]
    #[schemars(extend("default" = 0), with = "Finite")]
    offset: Option<Spanned<Finite>>,
    /// Axes of the vectors: "object" (the axes of object space) or "tangent" (tangent, bitangent
    /// and normal).
    #[serde(default)]
    #[schemars(extend("default" = "object"), with = "Space")]
    space: Option<Spanned<Space>>,
    /// For the space "tangent": an object-space direction, whose projection onto the tangent plane
    /// is the tangent.
    #[serde(default)]
    #[schemars(extend("x-default" = "[1, 0, 0] without `axis`"), with = "Vector3")]
    tangent: Option<Spanned<Vector3>>,
    /// For the space "tangent": an object-space axis, around which the tangents run in circles
    /// (axis x normal); replaces `tangent`.
    #[serde(default)]
    #[schemars(extend("x-default" = "none"), with = "Vector3")]
    axis: Option<Spanned<Vector3>>,
}

/// Axes that the components of a vector refer to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Space {
    /// Object axes.
    Object,
    /// Tangent, bitangent and normal.
    Tangent,
}

fn one() -> Spanned<Finite> {
    Spanned::new(0..0, Finite::new(1.0).expect("1 is finite"))
}

/// Additional memory for displacement after this many levels of subdivision: a normal and a mean
/// value per point, and the values that are averaged.
pub(super) fn bytes(surface: &Surface, levels: u32) -> u64 {
    let [points, _] = surface.size_after(levels);
    let point = size_of::<DVec3>() + size_of::<Mean>() + size_of::<Rgb>();
    let corner = size_of::<Rgb>() + size_of::<u32>();
    let corners = if surface.uvs.is_empty() { 0 } else { points };
    points * point as u64 + corners * corner as u64
}

/// What a texture value moves a vertex by.
enum Motion {
    /// Along the normal, by the height above this one.
    Height(f64),
    /// By vectors of object space.
    Object,
    /// By vectors of tangent space.
    Tangent(TangentField),
}

impl Motion {
    /// The displacement of a vertex with this unit normal for a texture value, before scaling.
    fn of(&self, value: Rgb, normal: DVec3) -> DVec3 {
        match self {
            Self::Height(offset) => (value.r - offset) * normal,
            Self::Object => value.to_vector(),
            Self::Tangent(field) => field.vector(value.to_vector(), normal).unwrap_or_default(),
        }
    }
}

impl Displacement {
    /// The texture, and what it means. `place` is the span of the table.
    fn motion(&self, place: Range<usize>) -> Result<(&TextureRef, Motion), SceneErrors> {
        let mut errors = SceneErrors::default();
        let (tangent, axis) = (self.tangent.as_ref(), self.axis.as_ref());
        let found = match (&self.height, &self.vector_map) {
            (Some(height), None) => {
                let spans = [
                    self.space.as_ref().map(Spanned::span),
                    tangent.map(Spanned::span),
                    axis.map(Spanned::span),
                ];
                for span in spans.into_iter().flatten() {
                    let message = "this key needs `vector_map`: a height has no directions";
                    errors.0.push(SceneError::at(span, message));
                }
                let offset = self.offset.as_ref().map_or(0.0, |offset| offset.get_ref().get());
                Some((height, Motion::Height(offset)))
            }
            (None, Some(vectors)) => {
                if let Some(offset) = &self.offset {
                    let message = "an offset needs `height`: mid grey (0.5) is the zero vector";
                    errors.0.push(SceneError::at(offset.span(), message));
                }
                let space = self.space.as_ref();
                let is_tangent = space.is_some_and(|space| *space.get_ref() == Space::Tangent);
                let field = errors.take(TangentField::of_space(is_tangent, tangent, axis));
                field.map(|field| (vectors, field.map_or(Motion::Object, Motion::Tangent)))
            }
            (Some(_), Some(vectors)) => {
                let span = vectors.span.clone().unwrap_or(place);
                let message = "either `height` or `vector_map`, not both";
                errors.0.push(SceneError::at(span, message));
                None
            }
            (None, None) => {
                let message = "a displacement needs `height` or `vector_map`";
                errors.0.push(SceneError::at(place, message));
                None
            }
        };
        match found {
            Some(found) => errors.into_result(found),
            None => Err(errors),
        }
    }
}

/// Displaces the points of a surface.
pub(super) fn displace(
    surface: &mut Surface,
    how: &Spanned<Displacement>,
    context: &mut dyn Context,
) -> Result<(), SceneErrors> {
    let table = how.span();
    let how = how.get_ref();
    let (reference, motion) = how.motion(table)?;
    let place = reference.span.clone().unwrap_or(0..0);
    let texture = context.texture(reference)?;
    let by_uv = texture.needs().contains(SurfaceAttributes::UV);
    if by_uv && surface.uvs.is_empty() {
        let error = SceneError::at(
            place,
            "this texture is mapped by (u, v), but the mesh has no texture coordinates",
        );
        let help = "map it by object-space position: mapping = { projection = \"solid\" }, or \"planar\", \"spherical\", ...";
        return Err(error.with_help(help).into());
    }
    if surface.sides.is_empty() {
        let message = "all triangles are degenerate: there is nothing to displace";
        return Err(SceneError::at(place, message).into());
    }
    // Zero where triangle normals cancel or there is no triangle; such points do not move.
    let mut normals = surface.normals();
    normals.par_iter_mut().for_each(|n| *n = n.normalize_or_zero());
    let relief = Relief {
        surface,
        normals: &normals,
        texture: &texture,
        of_vectors: !matches!(motion, Motion::Height(_)),
        place,
    };
    let values = if by_uv {
        relief.values_by_uv()?
    } else {
        relief.values()?
    };
    let scale = how.scale.get_ref().get();
    let moved = surface.points.par_iter_mut().zip(&normals).zip(&values);
    moved
        .filter(|((_, n), _)| **n != DVec3::ZERO)
        .for_each(|((point, n), value)| *point += scale * motion.of(*value, *n));
    if surface.points.iter().any(|point| !point.is_finite()) {
        let message = "this moves a vertex out of the range of double precision";
        return Err(SceneError::at(how.scale.span(), message).into());
    }
    Ok(())
}

/// A running mean.
#[derive(Clone, Copy, Default)]
struct Mean {
    sum: Rgb,
    count: u32,
}

/// Marks texture coordinates that no triangle uses.
const NOWHERE: u32 = u32::MAX;

/// The texture lookup.
struct Relief<'a> {
    surface: &'a Surface,
    /// Unit length, or zero.
    normals: &'a [DVec3],
    texture: &'a ColorSource,
    /// Whether all channels count, not the first one only.
    of_vectors: bool,
    /// Source span of the texture, for messages.
    place: Range<usize>,
}

impl Relief<'_> {
    /// The value at each point.
    fn values(&self) -> Result<Vec<Rgb>, SceneError> {
        let points = 0..self.surface.points.len();
        let values: Vec<Rgb> = points
            .into_par_iter()
            .map(|point| self.at(point, DVec2::ZERO))
            .collect();
        self.check(values.iter().copied().zip(0..))?;
        Ok(values)
    }

    /// The mean value of each point over its corners, each with its own texture coordinates.
    fn values_by_uv(&self) -> Result<Vec<Rgb>, SceneError> {
        let Surface {
            points,
            sides,
            uvs,
            corners,
        } = self.surface;
        let mut point_of = vec![NOWHERE; uvs.len()];
        for (corners, points) in corners.iter().zip(sides) {
            for (corner, point) in corners.iter().zip(points) {
                point_of[*corner as usize] = *point;
            }
        }
        let at = |(&point, &uv)| match point {
            NOWHERE => Rgb::BLACK,
            point => self.at(point as usize, uv),
        };
        let seen: Vec<Rgb> = point_of.par_iter().zip(uvs).map(at).collect();
        self.check(seen.iter().copied().zip(point_of.iter().copied()))?;
        let mut means = vec![Mean::default(); points.len()];
        for (corners, points) in corners.iter().zip(sides) {
            for (corner, point) in corners.iter().zip(points) {
                let mean = &mut means[*point as usize];
                mean.sum += seen[*corner as usize];
                mean.count += 1;
            }
        }
        // Points without a triangle have no normal to move along.
        let mean = |mean: &Mean| mean.sum.map(|sum| sum / f64::from(mean.count.max(1)));
        Ok(means.iter().map(mean).collect())
    }

    /// The value at one corner.
    fn at(&self, point: usize, uv: DVec2) -> Rgb {
        let (position, normal) = (self.surface.points[point], self.normals[point]);
        if normal == DVec3::ZERO {
            return Rgb::BLACK;
        }
        let mut there = SurfaceInteraction::new(position, 0.0, normal);
        there.uv = uv;
        self.texture.value(&there)
    }

    /// Checks that all values, each with its point, are finite in the channels that count.
    fn check(&self, mut values: impl Iterator<Item = (Rgb, u32)>) -> Result<(), SceneError> {
        let rest = |value: Rgb| !self.of_vectors || (value.g.is_finite() && value.b.is_finite());
        let finite = |value: Rgb| value.r.is_finite() && rest(value);
        let Some((value, point)) = values.find(|(value, _)| !finite(*value)) else {
            return Ok(());
        };
        let position = self.surface.points[point as usize];
        let Rgb { r, g, b } = value;
        let message = format!("the texture at the vertex {position} is [{r}, {g}, {b}], not finite");
        Err(SceneError::at(self.place.clone(), message))
    }
}

#[cfg(test)]
mod tests {
    use crate::mesh::Mesh;
    use std::sync::atomic::{AtomicU32, Ordering};
    use whitstone_core::config::decode;
    use whitstone_core::{
        DVec3, Diagnostics, LoweredShape, Plugin, Resources, Rgb, SceneError, SceneErrors, Shapes, Storage,
        SurfaceAttributes, SurfaceInteraction, Texture, Transform, TriangleMesh,
    };
    use whitstone_testkit::{TestContext, build_in, shape_laws};

    /// An arbitrary height function.
    struct Height(fn(&SurfaceInteraction) -> f64, SurfaceAttributes);

    impl Texture for Height {
        fn needs(&self) -> SurfaceAttributes {
            self.1
        }

        fn value(&self, point: &SurfaceInteraction) -> Rgb {
            // Only the first channel of a height counts.
            Rgb::new((self.0)(point), f64::NAN, f64::INFINITY)
        }
    }

    /// The position, shifted so that it is not negative.
    struct Position;

    impl Texture for Position {
        fn needs(&self) -> SurfaceAttributes {
            SurfaceAttributes::NOTHING
        }

        fn value(&self, point: &SurfaceInteraction) -> Rgb {
            Rgb::from(DVec3::ONE + point.position)
        }
    }

    const OCTAHEDRON: &str = "v 1 0 0\nv 0 1 0\nv 0 0 1\nv -1 0 0\nv 0 -1 0\nv 0 0 -1\n\
                              f 1 2 3\nf 2 4 3\nf 4 5 3\nf 5 1 3\nf 2 1 6\nf 4 2 6\nf 5 4 6\nf 1 5 6\n";

    fn load(file: &str, more: &str) -> Result<TriangleMesh, SceneErrors> {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let name = format!("whitstone-displacement-{}-{number}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("a.obj"), file).unwrap();
        let mut context = TestContext::in_folder(&folder)
            .with_texture("up", Height(|p| p.position.z, SurfaceAttributes::NOTHING))
            .with_texture(
                "out",
                Height(|p| p.n_s.z.abs(), SurfaceAttributes::SHADING_NORMAL),
            )
            .with_texture("position", Position)
            .with_texture("u", Height(|p| p.uv.x, SurfaceAttributes::UV))
            .with_texture(
                "nan",
                Height(|p| 1.0 / p.position.x.min(0.0), SurfaceAttributes::NOTHING),
            );
        let text = format!("file = \"a.obj\"\n{more}");
        let built = build_in::<Shapes, Mesh>(&text, Transform::IDENTITY, &mut context);
        std::fs::remove_dir_all(&folder).unwrap();
        match built? {
            LoweredShape::Triangles(mesh) => Ok(mesh),
            _ => Err(SceneError::anywhere("a mesh is triangles").into()),
        }
    }

    #[test]
    fn vertices_move_along_their_normals_and_normals_follow() {
        let more = "displacement = { height = \"up\", scale = 0.5, offset = 0.25 }";
        let mesh = load(OCTAHEDRON, more).unwrap();
        // Displaced by half of (z minus 1/4): the equator moves in, the upper tip out, the lower
        // tip in.
        let expected = [0.875, 0.875, 1.375, -0.875, -0.875, -0.375];
        for ((p, axis), length) in mesh.positions.iter().zip([0, 1, 2, 0, 1, 2]).zip(expected) {
            assert!((p[axis] - length).abs() < 1e-15, "{p}");
            assert!((p.length() - length.abs()).abs() < 1e-15, "{p}");
        }
        // The normal of the vertex at +x: two of its four triangles are flatter now.
        let (up, down) = (DVec3::new(1.375, 0.0, 0.875), DVec3::new(0.375, 0.0, 0.875));
        let expected = (DVec3::new(up.x, 0.0, up.z) + DVec3::new(down.x, 0.0, -down.z)).normalize();
        assert!(
            (mesh.normals[0] - expected).length() < 1e-15,
            "{}",
            mesh.normals[0]
        );
        shape_laws(LoweredShape::Triangles(mesh), 4_000);
    }

    #[test]
    fn a_constant_height_grows_a_sphere_and_none_leaves_the_mesh_as_it_is() {
        let divided = "subdivision = { scheme = \"loop\", levels = 3 }";
        let plain = load(OCTAHEDRON, divided).unwrap();
        let same = load(OCTAHEDRON, &format!("{divided}\ndisplacement = {{ height = 0 }}")).unwrap();
        assert_eq!(
            (&plain.positions, &plain.normals),
            (&same.positions, &same.normals)
        );
        let more = format!("{divided}\ndisplacement = {{ height = 0.5, scale = -0.5 }}");
        let smaller = load(OCTAHEDRON, &more).unwrap();
        for (k, (before, after)) in plain.positions.iter().zip(&smaller.positions).enumerate() {
            let expected = *before - 0.25 * plain.normals[k];
            assert!((*after - expected).length() < 1e-15);
        }
    }

    #[test]
    fn vectors_move_vertices_along_the_axes_of_the_object_or_the_surface() {
        // The vector (0.5, -0.25, 1).
        let vector = "displacement = { vector_map = [0.75, 0.375, 1], scale = 2";
        let moved = |more: &str| load(OCTAHEDRON, &format!("{vector}{more} }}")).unwrap().positions;
        let plain = load(OCTAHEDRON, "displacement = { height = 0 }")
            .unwrap()
            .positions;
        for (before, after) in plain.iter().zip(moved("")) {
            assert_eq!(after - *before, DVec3::new(1.0, -0.5, 2.0));
        }
        // At +y, whose normal is y: tangent x, bitangent -z. At +x the tangent has no direction.
        let along = moved(", space = \"tangent\"");
        assert_eq!(along[0], DVec3::X);
        assert!(
            (along[1] - DVec3::new(1.0, 3.0, 0.5)).length() < 1e-15,
            "{}",
            along[1]
        );
        // At +x: the tangent around y is -z, the bitangent y.
        let around = moved(", space = \"tangent\", axis = [0, 2, 0]");
        assert!(
            (around[0] - DVec3::new(3.0, -0.5, -1.0)).length() < 1e-15,
            "{}",
            around[0]
        );
        assert_eq!(around[1], DVec3::Y);
    }

    /// Overhangs: vectors that vary over the position move points sideways, and normals follow.
    #[test]
    fn solid_textures_of_vectors_move_points_by_their_position() {
        let divided = "subdivision = { scheme = \"loop\", levels = 3 }";
        let more = format!("{divided}\ndisplacement = {{ vector_map = \"position\", scale = 0.5 }}");
        let plain = load(OCTAHEDRON, divided).unwrap();
        let mesh = load(OCTAHEDRON, &more).unwrap();
        for (before, after) in plain.positions.iter().zip(&mesh.positions) {
            // 0.5 (2 (1 + p) - 1): each point moves by itself and a half.
            let expected = *before + 0.5 * (2.0 * (DVec3::ONE + *before) - DVec3::ONE);
            assert!((*after - expected).length() < 1e-15);
        }
        for (before, after) in plain.normals.iter().zip(&mesh.normals) {
            assert!((*after - *before).length() < 1e-14);
        }
        shape_laws(LoweredShape::Triangles(mesh), 4_000);
    }

    /// The two sides of a seam have different texture coordinates; the point moves by the mean of
    /// its three corners.
    #[test]
    fn seams_stay_closed() {
        let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 4 0\n\
                      f 1/1 2/2 3/1\nf 1/3 3/1 4/1\n";
        let mesh = load(square, "displacement = { height = \"u\" }").unwrap();
        let height = |x: f64, y: f64| {
            let there = mesh.positions.iter().filter(|p| (p.x, p.y) == (x, y));
            let heights: Vec<f64> = there.map(|p| p.z).collect();
            assert!(heights.windows(2).all(|two| two[0] == two[1]));
            heights[0]
        };
        assert_eq!(
            [height(0.0, 0.0), height(1.0, 0.0), height(1.0, 1.0)],
            [2.0, 1.0, 0.0]
        );
        assert_eq!(mesh.uvs.len(), mesh.positions.len());
    }

    /// Case 44 of the catalogue: a displaced ramp has the right normal, from nearly flat to a
    /// vertical wall, and folded surfaces still have normals.
    #[test]
    fn normals_follow_any_amplitude() {
        let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nf 1/1 2/2 3/2\nf 1/1 3/2 4/1\n";
        for decade in -12..=3 {
            let amplitude = 10f64.powi(decade);
            let more = format!("displacement = {{ height = \"u\", scale = {amplitude:e} }}");
            let expected = DVec3::new(-amplitude, 0.0, 1.0).normalize();
            for n in &load(square, &more).unwrap().normals {
                assert!((*n - expected).length() < 1e-15, "{amplitude:e}: {n}");
            }
            let more = format!(
                "subdivision = {{ scheme = \"loop\", levels = 3 }}\ndisplacement = {{ height = \"out\", scale = -{amplitude:e} }}"
            );
            let mesh = load(OCTAHEDRON, &more).unwrap();
            assert!(mesh.positions.iter().all(|p| p.is_finite()));
            assert!(
                mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-14),
                "{amplitude:e}"
            );
        }
    }

    #[test]
    fn heights_may_look_at_normals_and_flat_shading_forgets_them() {
        let more = "displacement = { height = \"out\" }\nshading = \"flat\"";
        let mesh = load(OCTAHEDRON, more).unwrap();
        assert!(mesh.normals.is_empty());
        assert!((mesh.positions[2].z - 2.0).abs() < 1e-15);
        assert!((mesh.positions[0].x - 1.0).abs() < 1e-15);
    }

    #[test]
    fn what_cannot_be_is_told_at_its_place() {
        let place = |more: &str, word: &str| {
            let error = load(OCTAHEDRON, more).err().unwrap().0.remove(0);
            let text = format!("file = \"a.obj\"\n{more}");
            let span = error.span.clone().unwrap();
            assert_eq!(&text[span], word, "{}", error.message);
            error.message
        };
        let message = place("displacement = { height = \"u\" }", "\"u\"");
        assert!(message.contains("the mesh has no texture coordinates"));
        let message = place("displacement = { height = \"nan\" }", "\"nan\"");
        assert_eq!(
            message,
            "the texture at the vertex [1, 0, 0] is [inf, NaN, inf], not finite"
        );
        // All channels of a vector count.
        let message = place("displacement = { vector_map = \"u\" }", "\"u\"");
        assert!(message.contains("no texture coordinates"), "{message}");
        let message = place("displacement = { vector_map = \"out\" }", "\"out\"");
        assert!(message.ends_with("NaN, inf], not finite"), "{message}");
        let message = place("displacement = { height = 1e300, scale = 1e300 }", "1e300");
        assert!(message.contains("out of the range of double precision"));
        place("displacement = { height = 1, scale = inf }", "inf");
        place("displacement = { height = -1 }", "-1");
        place("displacement = { height = 1, depth = 2 }", "depth");
        let message = place("displacement = { scale = 1 }", "{ scale = 1 }");
        assert_eq!(message, "a displacement needs `height` or `vector_map`");
        place("displacement = { height = 1, vector_map = 2 }", "2");
        place("displacement = { height = 1, space = \"object\" }", "\"object\"");
        place("displacement = { height = 1, axis = [0, 1, 0] }", "[0, 1, 0]");
        place("displacement = { vector_map = 1, offset = 0 }", "0");
        place("displacement = { vector_map = 1, axis = [0, 1, 0] }", "[0, 1, 0]");
        let tangent = "displacement = { vector_map = 1, space = \"tangent\"";
        place(&format!("{tangent}, axis = [0, 0, 0] }}"), "[0, 0, 0]");
        place(
            &format!("{tangent}, tangent = [1, 0, 0], axis = [0, 1, 0] }}"),
            "[0, 1, 0]",
        );
        let point = load(
            "v 0 0 0\nv 0 0 0\nv 1 0 0\nf 1 2 3\n",
            "displacement = { height = 1 }",
        );
        assert!(
            point.err().unwrap().0[0]
                .message
                .contains("all triangles are degenerate")
        );
    }

    #[test]
    fn memory_is_asked_for_before() {
        struct Stingy(TestContext, u64);
        impl Resources for Stingy {
            fn texture(
                &mut self,
                _: &whitstone_core::config::TextureRef,
            ) -> Result<whitstone_core::ColorSource, SceneErrors> {
                Err(SceneError::anywhere("too late").into())
            }
            fn file(
                &self,
                file: &whitstone_core::config::FilePath,
            ) -> Result<std::path::PathBuf, SceneError> {
                self.0.file(file)
            }
        }
        impl Storage for Stingy {
            fn reserve(&mut self, bytes: u64) -> Result<(), SceneErrors> {
                self.1 += bytes;
                match self.1 > 55_000 {
                    true => Err(SceneError::anywhere("no memory").into()),
                    false => Ok(()),
                }
            }
        }
        impl Diagnostics for Stingy {
            fn warn(&mut self, _: SceneError) {}
        }
        let folder =
            std::env::temp_dir().join(format!("whitstone-displacement-memory-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("a.obj"), OCTAHEDRON).unwrap();
        let message = |more: &str| {
            let mut context = Stingy(TestContext::in_folder(&folder), 0);
            let text = format!("file = \"a.obj\"\n{more}");
            let config = decode(&toml::de::DeTable::parse(&text).unwrap()).unwrap();
            let built = Mesh::build(config, Transform::IDENTITY, &mut context);
            built.err().map(|errors| errors.0[0].message.clone())
        };
        let divided = "subdivision = { scheme = \"loop\", levels = 3 }";
        assert_eq!(message(divided), None);
        let displaced = format!("{divided}\ndisplacement = {{ height = 1 }}");
        assert_eq!(message(&displaced).as_deref(), Some("no memory"));
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
