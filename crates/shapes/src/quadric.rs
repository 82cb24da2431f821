//! An arbitrary quadric, clipped by a box.
//!
//! The symmetric matrix is diagonalised once, about the center of the box, by Jacobi rotations
//! (Golub, Van Loan, *Matrix Computations*, 4th ed., 8.5); rays are then intersected as in
//! `conic.rs`. Bounds and emptiness follow from bounds on the function over recursively subdivided
//! boxes: its value at the center, plus or minus the contributions of the gradient and the squares.
//!
//! - Twin: hosted by the Mitsuba driver, in double precision; POV-Ray `quadric`, cut (native).
//! - Example: `scenes/shapes/quadric.toml`.

use crate::support::conic::{Clipped, Conic, Mapping};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;
use whitstone_core::config::{Finite, Vector3};
use whitstone_core::{
    Aabb, Context, DMat3, DVec2, DVec3, LoweredShape, Plugin, SceneError, SceneErrors, Shapes, Transform,
};

/// A quadric clipped by a box, both in object space; its outside is where its function is greater
/// than 0.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The rows of a symmetric 4x4 matrix M: the quadric is p M p = 0 for p = (x, y, z, 1).
    #[schemars(extend("x-default" = "none: this or `coefficients` is required"))]
    matrix: Option<Matrix>,
    /// Alternative to `matrix`: the coefficients of x², y², z², xy, xz, yz, x, y, z and 1.
    #[schemars(extend("x-default" = "none: this or `matrix` is required"))]
    coefficients: Option<Coefficients>,
    /// The minimum and maximum corner of the box, in metres.
    #[serde(default = "unit_box", rename = "box")]
    clip: Corners,
    /// Whether box faces close the quadric where its inside is clipped.
    #[serde(default = "yes")]
    caps: bool,
}

fn unit_box() -> Corners {
    Corners(DVec3::NEG_ONE, DVec3::ONE)
}

fn yes() -> bool {
    true
}

/// The function `p Q p + 2 b p + c`.
#[derive(Clone, Copy, Debug)]
struct Function {
    q: DMat3,
    b: DVec3,
    c: f64,
}

#[derive(Debug)]
struct Matrix(Function);

#[derive(Debug)]
struct Coefficients(Function);

#[derive(Debug)]
struct Corners(DVec3, DVec3);

impl Function {
    /// Scales the coefficients to at most 1. Errors: a constant function, or one without real
    /// zeros.
    fn normalised(self) -> Result<Self, &'static str> {
        let [x, y, z] = [self.q.x_axis, self.q.y_axis, self.q.z_axis].map(|v| v.abs().max_element());
        let largest = x.max(y).max(z).max(self.b.abs().max_element());
        if largest == 0.0 {
            return Err("a function of x, y and z, found a constant");
        }
        let largest = largest.max(self.c.abs());
        // Divide instead of multiplying by the reciprocal, which is infinite for the smallest
        // numbers.
        let scale = |x: f64| x / largest;
        let scaled = Self {
            q: DMat3::from_cols_array(&self.q.to_cols_array().map(scale)),
            b: DVec3::from_array(self.b.to_array().map(scale)),
            c: scale(self.c),
        };
        if scaled.is_nowhere_zero() {
            return Err("a quadric with real points, found one without");
        }
        Ok(scaled)
    }

    fn at(&self, p: DVec3) -> f64 {
        p.dot(self.q * p) + 2.0 * self.b.dot(p) + self.c
    }

    /// Whether the function has no real zeros: all squares have the sign of the constant, and no
    /// linear term remains.
    fn is_nowhere_zero(&self) -> bool {
        let (turn, squares) = diagonal(self.q);
        let along = turn * self.b;
        let mut constant = self.c;
        for axis in 0..3 {
            match squares[axis] {
                0.0 if along[axis] != 0.0 => return false,
                0.0 => {}
                square => constant -= along[axis] * along[axis] / square,
            }
        }
        // The constant has the rounding errors of completing the squares.
        let certain = constant.abs() > 1e-12;
        let positive = squares.cmpge(DVec3::ZERO).all() && constant > 0.0;
        let negative = squares.cmple(DVec3::ZERO).all() && constant < 0.0;
        certain && (positive || negative)
    }

    /// The same function about another origin.
    fn seen_from(&self, origin: DVec3) -> Self {
        Self {
            q: self.q,
            b: self.b + self.q * origin,
            c: self.at(origin),
        }
    }

    /// The parts of a box, down to 1/32 of its edges, in which the function may be zero or, if
    /// `inside` is set, less than zero.
    fn parts(&self, min: DVec3, max: DVec3, inside: bool) -> Vec<(DVec3, DVec3)> {
        let mut parts = vec![(min, max)];
        for level in 0..=5 {
            let near = |(min, max): &(DVec3, DVec3)| {
                let (middle, half) = (0.5 * (*min + *max), 0.5 * (*max - *min));
                let (value, size) = (self.at(middle), self.size(middle));
                let slope = 2.0 * (self.q * middle + self.b).abs().dot(half);
                let spread = slope + half.dot(self.q.abs() * half) + 16.0 * f64::EPSILON * size;
                value <= spread && (inside || value >= -spread)
            };
            parts.retain(near);
            if level < 5 {
                parts = parts
                    .into_iter()
                    .flat_map(|(min, max)| eighths(min, max))
                    .collect();
            }
        }
        parts
    }

    /// Sum of the absolute terms at a point.
    fn size(&self, p: DVec3) -> f64 {
        let p = p.abs();
        p.dot(self.q.abs() * p) + 2.0 * self.b.abs().dot(p) + self.c.abs()
    }
}

fn eighths(min: DVec3, max: DVec3) -> impl Iterator<Item = (DVec3, DVec3)> {
    let middle = 0.5 * (min + max);
    (0..8).map(move |corner| {
        let upper = |axis: usize| corner >> axis & 1 == 1;
        let pick = |low: DVec3, high: DVec3| {
            let of = |axis| if upper(axis) { high[axis] } else { low[axis] };
            DVec3::new(of(0), of(1), of(2))
        };
        (pick(min, middle), pick(middle, max))
    })
}

/// Orthonormal rows R and values l such that Q = R' diag(l) R. Values at rounding level relative to
/// the largest are set to zero.
fn diagonal(q: DMat3) -> (DMat3, DVec3) {
    let mut a = [0, 1, 2].map(|row| q.row(row).to_array());
    let mut turn = [0, 1, 2].map(|row| DMat3::IDENTITY.row(row).to_array());
    // Convergence is quadratic: each sweep squares the off-diagonal elements. About
    // five sweeps suffice; twelve are a safe limit, and elements that are already 0 are skipped.
    for (i, j) in [(0, 1), (0, 2), (1, 2)].into_iter().cycle().take(3 * 12) {
        if a[i][j] == 0.0 {
            continue;
        }
        let theta = (a[j][j] - a[i][i]) / (2.0 * a[i][j]);
        let t = 1f64.copysign(theta) / (theta.abs() + libm::hypot(theta, 1.0));
        let c = 1.0 / libm::hypot(t, 1.0);
        let s = t * c;
        let rotated = |x: f64, y: f64| (c * x - s * y, s * x + c * y);
        for k in 0..3 {
            (a[i][k], a[j][k]) = rotated(a[i][k], a[j][k]);
            (turn[i][k], turn[j][k]) = rotated(turn[i][k], turn[j][k]);
        }
        for row in &mut a {
            (row[i], row[j]) = rotated(row[i], row[j]);
        }
        (a[i][j], a[j][i]) = (0.0, 0.0);
    }
    let rows = turn.map(DVec3::from_array).map(DVec3::normalize);
    let squares = DVec3::new(a[0][0], a[1][1], a[2][2]);
    let noise = 8.0 * f64::EPSILON * squares.abs().max_element();
    let clean = |x: f64| if x.abs() <= noise { 0.0 } else { x };
    let squares = DVec3::new(clean(squares.x), clean(squares.y), clean(squares.z));
    (DMat3::from_cols(rows[0], rows[1], rows[2]).transpose(), squares)
}

impl<'de> Deserialize<'de> for Matrix {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let m = <[[Finite; 4]; 4]>::deserialize(deserializer)?.map(|row| row.map(Finite::get));
        for (i, row) in m.iter().enumerate() {
            if let Some(j) = (0..i).find(|j| row[*j] != m[*j][i]) {
                let message = format!(
                    "expected a symmetric matrix, found {} and {} on either side of the diagonal",
                    m[j][i], row[j]
                );
                return Err(serde::de::Error::custom(message));
            }
        }
        let column = |k: usize| DVec3::new(m[k][0], m[k][1], m[k][2]);
        let function = Function {
            q: DMat3::from_cols(column(0), column(1), column(2)),
            b: column(3),
            c: m[3][3],
        };
        let function = function.normalised();
        function
            .map(Self)
            .map_err(|what| serde::de::Error::custom(format!("expected {what}")))
    }
}

impl<'de> Deserialize<'de> for Coefficients {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let [xx, yy, zz, xy, xz, yz, x, y, z, c] =
            <[Finite; 10]>::deserialize(deserializer)?.map(Finite::get);
        let (xy, xz, yz) = (0.5 * xy, 0.5 * xz, 0.5 * yz);
        let function = Function {
            q: DMat3::from_cols(
                DVec3::new(xx, xy, xz),
                DVec3::new(xy, yy, yz),
                DVec3::new(xz, yz, zz),
            ),
            b: 0.5 * DVec3::new(x, y, z),
            c,
        };
        let function = function.normalised();
        function
            .map(Self)
            .map_err(|what| serde::de::Error::custom(format!("expected {what}")))
    }
}

impl Serialize for Corners {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        [self.0.to_array(), self.1.to_array()].serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Corners {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let [min, max] = <[Vector3; 2]>::deserialize(deserializer)?.map(Vector3::get);
        if min.cmplt(max).all() && (max - min).is_finite() {
            return Ok(Self(min, max));
        }
        let message = format!("expected the smallest and the largest corner of a box, found {min} and {max}");
        Err(serde::de::Error::custom(message))
    }
}

macro_rules! numbers {
    ($($name:ident, $schema:tt;)*) => {$(
        impl JsonSchema for $name {
            fn schema_name() -> Cow<'static, str> {
                stringify!($name).into()
            }
            fn inline_schema() -> bool {
                true
            }
            fn json_schema(_: &mut SchemaGenerator) -> Schema {
                json_schema!($schema)
            }
        }
    )*};
}

numbers! {
    Matrix, {
        "type": "array", "minItems": 4, "maxItems": 4,
        "items": { "type": "array", "items": { "type": "number" }, "minItems": 4, "maxItems": 4 }
    };
    Coefficients, { "type": "array", "items": { "type": "number" }, "minItems": 10, "maxItems": 10 };
    Corners, {
        "type": "array", "minItems": 2, "maxItems": 2,
        "items": { "type": "array", "items": { "type": "number" }, "minItems": 3, "maxItems": 3 }
    };
}

/// Lowers to a quadric in canonical form.
pub struct Quadric;

/// Texture coordinates: relative x and y in the box.
#[derive(Clone)]
struct InBox {
    min: DVec3,
    extent: DVec3,
}

impl Mapping for InBox {
    fn uv(&self, p: DVec3, _: u32) -> DVec2 {
        ((p - self.min) / self.extent).truncate()
    }
}

impl Plugin<Shapes> for Quadric {
    const TYPE: &'static str = "quadric";
    type Config = Config;

    fn build(config: Config, transform: Transform, _: &mut dyn Context) -> Result<LoweredShape, SceneErrors> {
        let function = match (config.matrix, config.coefficients) {
            (Some(Matrix(function)), None) | (None, Some(Coefficients(function))) => function,
            _ => {
                let error = SceneError::anywhere("expected one of `matrix` and `coefficients`");
                return Err(error
                    .with_help("a sphere has coefficients = [1, 1, 1, 0, 0, 0, 0, 0, 0, -1]")
                    .into());
            }
        };
        let Corners(min, max) = config.clip;
        let parts = function.parts(min, max, config.caps);
        if parts.is_empty() {
            let error = SceneError::anywhere("no point of the quadric lies in its box");
            return Err(error
                .with_help("the default `box` is from [-1, -1, -1] to [1, 1, 1]")
                .into());
        }
        let conic = canonical(&function, min, max, config.caps);
        let mapping = InBox {
            min,
            extent: max - min,
        };
        let quadric = Clipped::new(transform, conic, mapping, |frame| {
            let around = |(min, max)| frame.around_box(min, max);
            parts.into_iter().map(around).fold(Aabb::EMPTY, Aabb::union)
        })?;
        Ok(LoweredShape::Custom(Box::new(quadric)))
    }
}

fn canonical(function: &Function, min: DVec3, max: DVec3, caps: bool) -> Conic {
    let (middle, reach) = (0.5 * (min + max), 0.5 * (max - min).length());
    let function = function.seen_from(middle);
    let (turn, square) = diagonal(function.q);
    let (mut linear, mut constant) = (turn * function.b, function.c);
    let mut center = DVec3::ZERO;
    for axis in 0..3 {
        // Complete the square unless the center would be so distant that digits are lost.
        if linear[axis].abs() <= 16.0 * square[axis].abs() * reach && square[axis] != 0.0 {
            center[axis] = -linear[axis] / square[axis];
            constant -= linear[axis] * linear[axis] / square[axis];
            linear[axis] = 0.0;
        }
    }
    Conic {
        turn,
        center: middle + turn.transpose() * center,
        square,
        linear,
        constant,
        min,
        max,
        caps,
        first_face: 0,
        tip: DVec3::Z,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{Interval, Ray, Shape};
    use whitstone_testkit::{Random, build, shape_laws_everywhere};

    fn quadric(text: &str) -> Result<Box<dyn Shape>, SceneErrors> {
        match build::<Shapes, Quadric>(text, Transform::IDENTITY)? {
            LoweredShape::Custom(primitive) => Ok(primitive),
            _ => unreachable!("a quadric is a custom shape"),
        }
    }

    #[test]
    fn obeys_the_laws_of_shapes() {
        for text in [
            // A clipped sphere, a saddle (closed and open), a tilted paraboloid, a hyperboloid of
            // two sheets, a plane, a double cone and another saddle.
            "coefficients = [1, 1, 1, 0, 0, 0, 0, 0, 0, -1.2]",
            "coefficients = [1, -1, 0, 0, 0, 0, 0, 0, -1, 0]",
            "coefficients = [1, -1, 0, 0, 0, 0, 0, 0, -1, 0]\ncaps = false",
            "coefficients = [2, 2, 2, 2, 2, -2, 0.1, 0, 0, -0.3]\nbox = [[-1, -2, -1], [1, 1, 1]]",
            "coefficients = [1, 1, -1, 0, 0.3, 0, 0, 0, 0, 0.1]\ncaps = false",
            "coefficients = [0, 0, 0, 0, 0, 0, 1, 2, 3, 0.1]",
            "matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 0]]",
            "matrix = [[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, 0, -1], [0, 0, -1, 0.2]]\nbox = [[2, 2, 2], [4, 3, 9]]",
        ] {
            eprintln!("{text}");
            shape_laws_everywhere::<Quadric>(text, 2_000);
        }
    }

    #[test]
    fn the_matrix_is_what_its_diagonal_form_says() {
        let mut random = Random::new(3);
        for _ in 0..200 {
            let [a, b, c] = [random.cube(), random.cube(), random.cube()];
            let q = DMat3::from_cols(a, b, c) + DMat3::from_cols(a, b, c).transpose();
            let (turn, squares) = diagonal(q);
            let back = turn.transpose() * DMat3::from_diagonal(squares) * turn;
            assert!(back.abs_diff_eq(q, 8e-15), "{q}");
            assert!(
                (turn * turn.transpose()).abs_diff_eq(DMat3::IDENTITY, 2e-15),
                "{q}"
            );
        }
    }

    #[test]
    fn bounds_are_those_of_what_is_there() {
        let sphere = quadric("coefficients = [1, 1, 1, 0, 0, 0, 0, 0, 0, -0.25]")
            .unwrap()
            .bounds();
        assert!(
            sphere.max.max_element() < 0.5 + 2.0 / 31.0 && sphere.max.min_element() >= 0.5,
            "{sphere:?}"
        );
    }

    #[test]
    fn what_has_no_points_is_refused() {
        for (text, expected) in [
            (
                "coefficients = [1, 1, 1, 0, 0, 0, 0, 0, 0, 1e-9]",
                "expected a quadric with real points",
            ),
            (
                "coefficients = [1, 1, 0, 2, 0, 0, 0, 0, 0, 1]",
                "expected a quadric with real points",
            ),
            (
                "coefficients = [-1, -1, -1, 0, 0, 0, 0, 0, 0, -1]",
                "expected a quadric with real points",
            ),
            (
                "coefficients = [0, 0, 0, 0, 0, 0, 0, 0, 0, 0]",
                "expected a function",
            ),
            (
                "coefficients = [0, 0, 0, 0, 0, 0, 0, 0, 0, 1]",
                "expected a function",
            ),
            (
                "coefficients = [1, 1, 1, 0, 0, 0, 0, 0, 0, -9]\ncaps = false",
                "no point of the quadric",
            ),
            (
                "coefficients = [1, 1, 1, 0, 0, 0, 20, 0, 0, 90]",
                "no point of the quadric",
            ),
            (
                "matrix = [[1, 2, 0, 0], [1, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
                "expected a symmetric",
            ),
            ("", "expected one of"),
            (
                "coefficients = [1, 1, 1, 0, 0, 0, 0, 0, 0, -1]\nbox = [[0, 0, 0], [1, 0, 1]]",
                "expected the smallest",
            ),
        ] {
            let errors = quadric(text).err().unwrap_or_else(|| panic!("{text}"));
            assert!(errors.to_string().starts_with(expected), "{text}: {errors}");
        }
    }

    /// Rays to points on a rotated ellipsoid of condition number 1e6, given by its matrix: hits are
    /// as accurate as the rounded coefficients allow.
    #[test]
    fn a_stretched_ellipsoid_is_hit_where_it_is() {
        let mut random = Random::new(8);
        let turn = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 1.0);
        let q = turn * DMat3::from_diagonal(DVec3::new(1.0, 1e3, 1e6)) * turn.transpose();
        let [x, y, z] = [q.x_axis, q.y_axis, q.z_axis];
        let text = format!(
            "coefficients = [{:?}, {:?}, {:?}, {:?}, {:?}, {:?}, 0, 0, 0, -1]",
            x.x,
            y.y,
            z.z,
            2.0 * x.y,
            2.0 * x.z,
            2.0 * y.z
        );
        let shape = quadric(&text).unwrap();
        for _ in 0..200 {
            let on_sphere = random.direction();
            let p = turn * (on_sphere / DVec3::new(1.0, 1e3f64.sqrt(), 1e3));
            let n = turn * (on_sphere * DVec3::new(1.0, 1e3f64.sqrt(), 1e3));
            let direction = (n.normalize() + 0.3 * random.direction()).normalize();
            let ray = Ray::new(p + 100.0 * direction, -direction);
            let hit = shape
                .intersect(&ray, Interval::FORWARD, None)
                .expect("it is there");
            let expected = 100.0;
            assert!((hit.t - expected).abs() < 1e-11, "{hit:?}");
        }
    }
}
