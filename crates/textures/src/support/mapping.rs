//! Texture mapping: the point of texture space for a surface point.
//!
//! A texture is a [`TextureFunction`], a function of a point of texture space only. A [`Mapping`]
//! computes that point from the surface's (u, v) or from its world-space position. Each texture is
//! therefore written once and works with every mapping, and only a mapping that reads (u, v) makes
//! shapes compute it. The solid textures of Peachey 1985 and Perlin 1985 are patterns that use all
//! three coordinates; the projections are those of Bier and Sloan, *Two-part texture mappings*,
//! 1986. The triplanar one is a mean of three planar ones weighted by the normal (Geiss,
//! *Generating complex procedural terrains using the GPU*, GPU Gems 3, 2007, section 1.5).

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::{IntegerIn, Positive, TransformSteps};
use whitstone_core::stream::{Colors, LANES, SurfaceStream};
use whitstone_core::{
    DAffine3, DMat3, DVec3, Rgb, SceneError, SceneErrors, SurfaceAttributes, SurfaceInteraction, Texture,
    TextureBytes, Transform, simd,
};

/// A texture function: a colour for each point of texture space.
pub(crate) trait TextureFunction: Send + Sync {
    /// The linear value at a point; finite and not negative for every point. Mark branchless
    /// implementations `#[inline(always)]`.
    fn at(&self, q: DVec3) -> Rgb;

    /// Whether [`Self::filtered`] filters over the footprint of a sample.
    #[inline(always)]
    fn filters(&self) -> bool {
        false
    }

    /// The filtered value of a sample with these steps to its neighbours; the value at the point if
    /// the steps are zero. Finite and not negative for all steps.
    fn filtered(&self, q: DVec3, steps: [DVec3; 2]) -> Rgb {
        let _ = steps;
        self.at(q)
    }

    /// Memory that grows with the size of the texture data.
    fn bytes(&self) -> TextureBytes {
        TextureBytes::default()
    }

    /// Columns and rows of an image.
    fn size(&self) -> Option<[usize; 2]> {
        None
    }
}

/// Default exponent of the weights of a triplanar projection.
const DEFAULT_SHARPNESS: f64 = 4.0;

/// Mapping from surfaces to texture space.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Mapping {
    /// "uv": the texture coordinates of the shape. "solid": the world-space position. "planar",
    /// "spherical", "cylindrical", "cube": a projection of the world-space position. "triplanar":
    /// the mean of three projections along the axes. The default is "uv" for textures of (u, v),
    /// and "solid" for solid ones.
    #[serde(default)]
    #[schemars(extend("x-default" = "that of the texture"))]
    projection: Option<Projection>,
    /// Transform from (u, v, 0) of the shape, or from world space, to the space of the texture or
    /// of the projection: one step, or steps in the order in which they are applied.
    #[serde(default = "none")]
    transform: TransformSteps,
    /// For "uv": 1 to use the second set of texture coordinates of a mesh, see its `uv_sets`.
    #[serde(default)]
    #[schemars(extend("default" = 0), with = "IntegerIn<0, 1>")]
    uv_set: Option<Spanned<IntegerIn<0, 1>>>,
    /// For "triplanar": exponent of the normal's components in the weights of the projections.
    #[serde(default)]
    #[schemars(extend("default" = DEFAULT_SHARPNESS), with = "Positive")]
    sharpness: Option<Spanned<Positive>>,
}

const fn none() -> TransformSteps {
    TransformSteps::NONE
}

/// Projection to texture space; see [`Mapping`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Projection {
    /// The texture coordinates of the shape.
    Uv,
    /// The world-space position itself.
    Solid,
    /// Parallel projection along z.
    Planar,
    /// Projection from the origin onto a sphere with poles on the z axis.
    Spherical,
    /// Projection from the z axis onto a cylinder.
    Cylindrical,
    /// Projection from the origin onto the faces of a cube.
    Cube,
    /// Parallel projection along each axis, weighted by the normal.
    Triplanar,
}

impl Default for Mapping {
    fn default() -> Self {
        Self {
            projection: None,
            transform: TransformSteps::NONE,
            uv_set: None,
            sharpness: None,
        }
    }
}

impl Mapping {
    /// Maps `pattern` to surfaces; `usual` is the default projection.
    ///
    /// # Errors
    ///
    /// If a key has no effect.
    pub(crate) fn put<P: TextureFunction + 'static>(
        self,
        usual: Projection,
        pattern: P,
    ) -> Result<Arc<dyn Texture>, SceneErrors> {
        let transform = self.transform.get();
        let projection = self.projection.unwrap_or(usual);
        if let Some(sharpness) = &self.sharpness
            && projection != Projection::Triplanar
        {
            let message = "only the projection \"triplanar\" has this key";
            return Err(SceneError::at(sharpness.span(), message).into());
        }
        if let Some(set) = &self.uv_set
            && projection != Projection::Uv
        {
            let message = "only the projection \"uv\" has this key";
            return Err(SceneError::at(set.span(), message).into());
        }
        let map = *transform.world_from_object();
        Ok(Arc::new(Mapped {
            pattern,
            projection,
            second: self.uv_set.is_some_and(|set| set.get_ref().get() == 1),
            moved: (transform != Transform::IDENTITY).then_some(map),
            turned: map.matrix3.inverse().transpose(),
            sharpness: self
                .sharpness
                .map_or(DEFAULT_SHARPNESS, |sharpness| sharpness.into_inner().get()),
        }))
    }
}

/// A pattern mapped to surfaces.
struct Mapped<P> {
    pattern: P,
    projection: Projection,
    /// Whether the second set of texture coordinates is used.
    second: bool,
    /// The transform, unless it is the identity.
    moved: Option<DAffine3>,
    /// The transform of normals. This and the next field are for "triplanar" only.
    turned: DMat3,
    sharpness: f64,
}

impl<P: TextureFunction> Mapped<P> {
    #[inline(always)]
    fn place(&self, point: &SurfaceInteraction) -> DVec3 {
        self.projection.project(self.moved(self.source(point)))
    }

    /// The point before the transform.
    #[inline(always)]
    fn source(&self, point: &SurfaceInteraction) -> DVec3 {
        match self.projection {
            Projection::Uv if self.second => point.vertex.second_uv.extend(0.0),
            Projection::Uv => point.uv.extend(0.0),
            _ => point.position,
        }
    }

    #[inline(always)]
    fn moved(&self, source: DVec3) -> DVec3 {
        match self.moved {
            Some(map) => map.transform_point3(source),
            None => source,
        }
    }

    /// The steps to the neighbours of a point, transformed but not projected.
    fn steps(&self, point: &SurfaceInteraction) -> [DVec3; 2] {
        let step = |side: usize| {
            let step = match self.projection {
                // The footprint is known only in the first set.
                Projection::Uv if self.second => DVec3::ZERO,
                Projection::Uv => point.footprint.uv[side].as_dvec2().extend(0.0),
                _ => point.footprint.position[side].as_dvec3(),
            };
            self.moved.map_or(step, |map| map.matrix3 * step)
        };
        [step(0), step(1)]
    }

    /// The filtered value over the footprint of a point.
    fn filtered(&self, point: &SurfaceInteraction) -> Rgb {
        let q = self.moved(self.source(point));
        let [right, below] = self.steps(point);
        let steps = [self.projection.step(q, right), self.projection.step(q, below)];
        self.pattern.filtered(self.projection.project(q), steps)
    }

    /// The weighted mean of the projections along the axes.
    fn triplanar(&self, point: &SurfaceInteraction) -> Rgb {
        let q = self.moved(point.position);
        let plane = |q: DVec3, a: usize| DVec3::new(q[(a + 1) % 3], q[(a + 2) % 3], 0.0);
        let along = |a: usize| {
            if self.pattern.filters() {
                let steps = self.steps(point).map(|step| plane(step, a));
                self.pattern.filtered(plane(q, a), steps)
            } else {
                self.pattern.at(plane(q, a))
            }
        };
        let normal = (self.turned * point.n_s).abs();
        // Relative to the largest component, so that not all powers underflow.
        let shares = (normal / normal.max_element())
            .to_array()
            .map(|x| libm::pow(x, self.sharpness));
        let (mut sum, mut total) = (Rgb::BLACK, 0.0);
        for (a, share) in shares.into_iter().enumerate() {
            // Projections with weight 0 are not evaluated.
            if share > 0.0 {
                sum += along(a) * share;
                total += share;
            }
        }
        // After a transform that overflows, the normal may be NaN.
        if total > 0.0 {
            sum * (1.0 / total)
        } else {
            along(2)
        }
    }

    /// The values at the points of a stream, with `place` mapping each point to texture space.
    #[inline(always)]
    fn stream(&self, points: &SurfaceStream, out: &mut Colors, place: impl Fn(&SurfaceInteraction) -> DVec3) {
        simd::dispatch(
            #[inline(always)]
            || {
                for lane in 0..points.len.min(LANES) {
                    out.set(lane, self.pattern.at(place(&points.get(lane))));
                }
            },
        );
    }
}

impl Projection {
    #[inline(always)]
    fn project(self, q: DVec3) -> DVec3 {
        match self {
            Self::Uv | Self::Solid | Self::Triplanar => q,
            Self::Planar => DVec3::new(q.x, q.y, 0.0),
            Self::Spherical => {
                // The arc tangent is accurate near the poles; the arc cosine is not.
                let theta = libm::atan2(q.truncate().length(), q.z);
                DVec3::new(turn(q), (PI - theta) / PI, 0.0)
            }
            Self::Cylindrical => DVec3::new(turn(q), q.z, 0.0),
            Self::Cube => {
                let size = q.abs();
                let (far, b, c) = match cube_face(q) {
                    0 => (size.x, q.y, q.z),
                    1 => (size.y, q.z, q.x),
                    _ => (size.z, q.x, q.y),
                };
                DVec3::new((b / far + 1.0) / 2.0, (c / far + 1.0) / 2.0, 0.0)
            }
        }
    }
}

impl Projection {
    /// The image of a small step from q in texture space; not finite where the projection is not
    /// differentiable.
    #[inline]
    fn step(self, q: DVec3, step: DVec3) -> DVec3 {
        let turn = || (q.x * step.y - q.y * step.x) / (TAU * q.truncate().length_squared());
        match self {
            Self::Uv | Self::Solid | Self::Triplanar => step,
            Self::Planar => DVec3::new(step.x, step.y, 0.0),
            Self::Spherical => {
                let r = q.truncate().length();
                let away = q.truncate().dot(step.truncate()) / r;
                let down = (q.z * away - r * step.z) / q.length_squared();
                DVec3::new(turn(), -down / PI, 0.0)
            }
            Self::Cylindrical => DVec3::new(turn(), step.z, 0.0),
            Self::Cube => {
                let a = cube_face(q);
                let (b, c) = ((a + 1) % 3, (a + 2) % 3);
                let (far, farther) = (q[a].abs(), step[a] * q[a].signum());
                let along = |b: usize| (step[b] - q[b] * farther / far) / (2.0 * far);
                DVec3::new(along(b), along(c), 0.0)
            }
        }
    }
}

/// The axis of the largest component of q by magnitude; the lowest axis if several are equal.
#[inline(always)]
fn cube_face(q: DVec3) -> usize {
    let size = q.abs();
    if size.x >= size.y && size.x >= size.z {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    }
}

/// The angle around z from the x axis, as a fraction of a turn from 0 to 1.
fn turn(q: DVec3) -> f64 {
    let phi = libm::atan2(q.y, q.x);
    (if phi < 0.0 { phi + TAU } else { phi }) / TAU
}

impl<P: TextureFunction> Texture for Mapped<P> {
    fn needs(&self) -> SurfaceAttributes {
        let of_filter = if self.pattern.filters() {
            SurfaceAttributes::FOOTPRINT
        } else {
            SurfaceAttributes::NOTHING
        };
        let of_place = match self.projection {
            Projection::Uv if self.second => SurfaceAttributes::SECOND_UV,
            Projection::Uv => SurfaceAttributes::UV,
            Projection::Triplanar => SurfaceAttributes::SHADING_NORMAL,
            _ => SurfaceAttributes::NOTHING,
        };
        of_filter | of_place
    }

    fn bytes(&self) -> Option<TextureBytes> {
        Some(self.pattern.bytes())
    }

    fn size(&self) -> Option<[usize; 2]> {
        self.pattern.size()
    }

    fn value(&self, point: &SurfaceInteraction) -> Rgb {
        match self.projection {
            Projection::Triplanar => self.triplanar(point),
            _ if self.pattern.filters() => self.filtered(point),
            _ => self.pattern.at(self.place(point)),
        }
    }

    fn value_stream(&self, points: &SurfaceStream, out: &mut Colors) {
        if self.pattern.filters() {
            for lane in 0..points.len.min(LANES) {
                out.set(lane, self.value(&points.get(lane)));
            }
            return;
        }
        // Selected once per stream, so that the choice does not prevent the vectorisation of the
        // loops.
        match (self.projection, self.moved) {
            (Projection::Uv, None) if !self.second => self.stream(points, out, |point| point.uv.extend(0.0)),
            (Projection::Solid, None) => self.stream(points, out, |point| point.position),
            (Projection::Triplanar, _) => {
                for lane in 0..points.len.min(LANES) {
                    out.set(lane, self.triplanar(&points.get(lane)));
                }
            }
            _ => self.stream(points, out, |point| self.place(point)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::DVec2;
    use whitstone_core::config::decode;
    use whitstone_testkit::texture_laws;

    /// A pattern that shows the magnitudes of its point's coordinates as a colour.
    struct Place;

    impl TextureFunction for Place {
        fn at(&self, q: DVec3) -> Rgb {
            let keep = |x: f64| if x.is_finite() { x.abs() } else { 0.0 };
            Rgb::new(keep(q.x), keep(q.y), keep(q.z))
        }
    }

    fn mapping(text: &str) -> Mapping {
        decode(&toml::de::DeTable::parse(text).unwrap()).unwrap()
    }

    fn put(text: &str) -> Arc<dyn Texture> {
        mapping(text).put(Projection::Uv, Place).unwrap()
    }

    /// An image that shows the magnitudes of the steps to its neighbours.
    struct Steps;

    impl TextureFunction for Steps {
        fn at(&self, _: DVec3) -> Rgb {
            Rgb::BLACK
        }

        fn filters(&self) -> bool {
            true
        }

        fn filtered(&self, _: DVec3, [right, below]: [DVec3; 2]) -> Rgb {
            Rgb::new(right.x.abs(), right.y.abs(), below.x.abs() + 10.0 * below.y.abs())
        }

        fn bytes(&self) -> TextureBytes {
            TextureBytes {
                texels: 12,
                ..TextureBytes::default()
            }
        }

        fn size(&self) -> Option<[usize; 2]> {
            Some([3, 4])
        }
    }

    #[test]
    fn patterns_have_no_size_unless_they_say_so() {
        let (plain, image) = (put(""), mapping("").put(Projection::Uv, Steps).unwrap());
        assert_eq!((plain.size(), image.size()), (None, Some([3, 4])));
        let texels = |texture: &dyn Texture| texture.bytes().unwrap().texels;
        assert_eq!((texels(&*plain), texels(&*image)), (0, 12));
        assert_eq!(Place.filtered(DVec3::X, [DVec3::Y; 2]), Rgb::new(1.0, 0.0, 0.0));
    }

    #[test]
    fn footprints_are_mapped_as_points_are() {
        let mut point = SurfaceInteraction::new(DVec3::new(1.0, 2.0, 3.0), 0.0, DVec3::Z);
        point.footprint.uv = [[0.25, 0.5], [0.125, 1.0]].map(|step| DVec2::from(step).as_vec2());
        point.footprint.position =
            [[2.0, 4.0, 8.0], [0.5, 0.25, 0.0]].map(|step| DVec3::from(step).as_vec3());
        for (text, expected) in [
            ("", [0.25, 0.5, 10.125]),
            // A translation moves no step.
            (
                "transform = [{ translate = [9, 9, 9] }, { scale = [2, 4, 1] }]",
                [0.5, 2.0, 40.25],
            ),
            // The footprint of the second set is not known.
            ("uv_set = 1", [0.0; 3]),
            ("projection = \"planar\"", [2.0, 4.0, 3.0]),
            // Along z, which the normal selects.
            ("projection = \"triplanar\"", [2.0, 4.0, 3.0]),
        ] {
            let texture = mapping(text).put(Projection::Uv, Steps).unwrap();
            assert!(texture.needs().contains(SurfaceAttributes::FOOTPRINT));
            assert_eq!(texture.value(&point).to_array(), expected, "{text}");
        }
    }

    /// A step is the derivative of the projection.
    #[test]
    fn steps_are_differences_of_points() {
        for projection in [
            Projection::Uv,
            Projection::Solid,
            Projection::Planar,
            Projection::Spherical,
            Projection::Cylindrical,
            Projection::Cube,
        ] {
            for i in 1..50 {
                let spread = DVec3::new(0.618, 0.755, 0.57) * f64::from(i);
                let q = spread.fract() - 0.5;
                let step = (1.7 * spread).fract() - 0.5;
                let at = |t: f64| projection.project(q + t * step);
                let expected = (at(1e-6) - at(-1e-6)) / 2e-6;
                // Where the projection jumps there is no derivative.
                if expected.length() > 100.0 {
                    continue;
                }
                let found = projection.step(q, step);
                let error = (found - expected).length() / expected.length();
                assert!(error < 1e-6, "{projection:?} at {q}: {found}, not {expected}");
            }
        }
    }

    #[test]
    fn ties_of_a_cube_belong_to_the_first_face() {
        for (q, face) in [
            ([1.0, -1.0, 1.0], 0),
            ([1.0, 0.5, -1.0], 0),
            ([0.5, 1.0, 1.0], 1),
            ([0.5, -2.0, 1.0], 1),
            ([0.5, 1.0, -2.0], 2),
            ([2.0, 1.0, -3.0], 2),
        ] {
            let q = DVec3::from_array(q);
            assert_eq!(cube_face(q), face, "{q}");
            let (b, c) = ((face + 1) % 3, (face + 2) % 3);
            let expected = DVec3::new(q[b], q[c], 0.0) / (2.0 * q[face].abs());
            assert_eq!(Projection::Cube.project(q), expected + DVec3::new(0.5, 0.5, 0.0));
        }
    }

    fn at(text: &str, position: [f64; 3]) -> DVec3 {
        let mut point = SurfaceInteraction::new(position.into(), 0.0, DVec3::Z);
        point.uv = DVec2::new(0.25, 0.75);
        put(text).value(&point).to_array().into()
    }

    #[test]
    fn every_projection_obeys_the_laws() {
        texture_laws(&*put("uv_set = 1"));
        for projection in [
            "uv",
            "solid",
            "planar",
            "spherical",
            "cylindrical",
            "cube",
            "triplanar",
        ] {
            for transform in [
                "",
                "transform = [{ scale = [2, 3, 4] }, { translate = [1, 0, 0] }]",
            ] {
                texture_laws(&*put(&format!("projection = \"{projection}\"\n{transform}")));
            }
        }
    }

    #[test]
    fn only_what_reads_uv_needs_it() {
        assert_eq!(put("").needs(), SurfaceAttributes::UV);
        assert_eq!(
            put("projection = \"spherical\"").needs(),
            SurfaceAttributes::NOTHING
        );
    }

    #[test]
    fn three_projections_count_by_the_normal() {
        let seen = |text: &str, normal: [f64; 3]| -> DVec3 {
            let normal = DVec3::from_array(normal).normalize();
            let point = SurfaceInteraction::new(DVec3::new(1.0, 2.0, 4.0), 0.0, normal);
            put(&format!("projection = \"triplanar\"\n{text}"))
                .value(&point)
                .to_array()
                .into()
        };
        let [x, y, z] = [[2.0, 4.0, 0.0], [4.0, 1.0, 0.0], [1.0, 2.0, 0.0]].map(DVec3::from_array);
        let near = |a: DVec3, b: DVec3| assert!(a.abs_diff_eq(b, 1e-14), "{a}, not {b}");
        // A normal along an axis selects one projection, the same for both signs.
        near(seen("", [1.0, 0.0, 0.0]), x);
        near(seen("", [0.0, -1.0, 0.0]), y);
        near(seen("", [1.0, 1.0, 1.0]), (x + y + z) / 3.0);
        near(seen("", [0.0, 1.0, 2.0]), (y + 16.0 * z) / 17.0);
        near(seen("sharpness = 1", [0.0, -1.0, 2.0]), (y + 2.0 * z) / 3.0);
        near(seen("sharpness = 1e300", [0.0, 1.0, 2.0]), z);
        near(seen("sharpness = 1e300", [0.0, 2.0, 1.0]), y);
        near(seen("", [f64::NAN; 3]), z);
        // Stretched by 2 along z, which makes the transformed normals flatter.
        let long = "sharpness = 1\ntransform = { scale = [1, 1, 2] }";
        let y2 = DVec3::new(8.0, 1.0, 0.0);
        near(seen(long, [0.0, 1.0, 2.0]), (y2 + z) / 2.0);
        assert_eq!(
            put("projection = \"triplanar\"").needs(),
            SurfaceAttributes::SHADING_NORMAL
        );
    }

    #[test]
    fn keys_without_effect_are_refused_at_their_places() {
        for (text, place) in [
            ("projection = \"cube\"\nsharpness = 2", "2"),
            ("projection = \"solid\"\nuv_set = 1", "1"),
        ] {
            let error = mapping(text)
                .put(Projection::Uv, Place)
                .err()
                .unwrap()
                .0
                .remove(0);
            assert_eq!(&text[error.span.unwrap()], place);
        }
        assert_eq!(put("uv_set = 1").needs(), SurfaceAttributes::SECOND_UV);
        let mut point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        point.vertex.second_uv = DVec2::new(2.0, 4.0);
        assert_eq!(put("uv_set = 1").value(&point), Rgb::new(2.0, 4.0, 0.0));
        assert_eq!(put("uv_set = 0").needs(), SurfaceAttributes::UV);
    }

    #[test]
    fn points_are_where_the_model_says() {
        let half = 0.5f64.sqrt();
        for (text, position, expected) in [
            ("", [5.0, 6.0, 7.0], [0.25, 0.75, 0.0]),
            ("transform = { scale = 4 }", [5.0, 6.0, 7.0], [1.0, 3.0, 0.0]),
            ("projection = \"solid\"", [5.0, 6.0, 7.0], [5.0, 6.0, 7.0]),
            ("projection = \"planar\"", [5.0, 6.0, 7.0], [5.0, 6.0, 0.0]),
            (
                "projection = \"planar\"\ntransform = [{ translate = [1, 0, 0] }, { scale = 2 }]",
                [5.0, 6.0, 7.0],
                [12.0, 12.0, 0.0],
            ),
            ("projection = \"spherical\"", [0.0, 0.0, 3.0], [0.0, 1.0, 0.0]),
            ("projection = \"spherical\"", [0.0, 2.0, 2.0], [0.25, 0.75, 0.0]),
            ("projection = \"spherical\"", [0.0, -2.0, 0.0], [0.75, 0.5, 0.0]),
            (
                "projection = \"cylindrical\"",
                [-half, -half, 9.0],
                [0.625, 9.0, 0.0],
            ),
            ("projection = \"cube\"", [-4.0, 2.0, 0.0], [0.75, 0.5, 0.0]),
            ("projection = \"cube\"", [1.0, 4.0, 2.0], [0.75, 0.625, 0.0]),
            ("projection = \"cube\"", [2.0, 0.0, -4.0], [0.75, 0.5, 0.0]),
        ] {
            let found = at(text, position);
            assert!(
                found.abs_diff_eq(expected.into(), 1e-15),
                "{text} {position:?}: {found}"
            );
        }
    }
}
