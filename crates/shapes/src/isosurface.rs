//! An isosurface of a density on a grid.
//!
//! The density is trilinear between eight values, so along a ray it is a cubic in each cell.
//! Marmitt, Kleer, Wald, Friedrich, Slusallek, *Fast and accurate ray-voxel intersection techniques
//! for iso-surface ray tracing*, VMV 2004, split the cubic at its extrema. Here the cubic is in
//! Bernstein form. By multilinearity its outer coefficients are the density at the ends of the
//! segment, and each inner one is the mean of the density at three points that mix the coordinates
//! of both ends. Neighbouring cells therefore compute identical bits on their common face. Cells
//! are traversed as in Amanatides and Woo, *A fast voxel traversal algorithm*, Eurographics 1987.
//! Blocks of cells whose values do not span the level are skipped at once.
//!
//! - Twin: POV-Ray `isosurface` with the interpolation as nested functions.
//! - Example: `scenes/shapes/isosurface.toml`.

mod cubic;
mod density;

use crate::support::crossings::Crossing;
use crate::support::level::{Level, Sample, Segment, whole};
use cubic::{Cubic, lerp, trilinear};
use density::Values;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use toml::Spanned;
use whitstone_core::config::{FilePath, Finite, IntegerIn};
use whitstone_core::{
    Aabb, Context, DVec2, DVec3, Interval, LoweredShape, Plugin, PreliminaryIntersection, Ray, SceneError,
    SceneErrors, Shape, ShapeHit, Shapes, Spans, SurfaceAttributes, SurfaceInteraction, Transform,
};

/// Maximum number of values: one gigabyte.
const MAX_VALUES: u64 = 1 << 27;
/// Number of cells along the edge of a block.
const BLOCK: usize = 8;

/// Default number of metaballs.
const DEFAULT_BALLS: u32 = 8;

/// Default density at the surface.
const DEFAULT_ISO_VALUE: f64 = 0.5;

/// The surface where a density on a grid over [-1, 1]³ equals a level; its normals point towards
/// lower density.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Number of values along x, y and z; at most 2^27 in total.
    size: [IntegerIn<2, 2048>; 3],
    /// The density at the grid vertices; x varies fastest, z slowest.
    #[serde(default)]
    #[schemars(extend("x-default" = "none: one of `values`, `file` and `generator` is required"), with = "Values")]
    values: Option<Spanned<Values>>,
    /// A raw file of these values, without a header.
    #[serde(default)]
    #[schemars(extend("x-default" = "none: one of `values`, `file` and `generator` is required"))]
    file: Option<FilePath>,
    /// The number format of the file.
    #[serde(default)]
    #[schemars(extend("default" = "f32"), with = "Format")]
    format: Option<Spanned<Format>>,
    /// Generates the density instead of reading values.
    #[serde(default)]
    #[schemars(extend("x-default" = "none: one of `values`, `file` and `generator` is required"), with = "Generator")]
    generator: Option<Spanned<Generator>>,
    /// Seed of the generator.
    #[serde(default)]
    #[schemars(extend("default" = 0), with = "IntegerIn<0, { u32::MAX }>")]
    seed: Option<Spanned<IntegerIn<0, { u32::MAX }>>>,
    /// Number of metaballs of the generator.
    #[serde(default)]
    #[schemars(extend("default" = DEFAULT_BALLS), with = "IntegerIn<1, 64>")]
    balls: Option<Spanned<IntegerIn<1, 64>>>,
    /// Density at the surface.
    #[serde(default)]
    #[schemars(extend("default" = DEFAULT_ISO_VALUE), with = "Finite")]
    iso_value: Option<Spanned<Finite>>,
}

/// Number format of a file.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema, PartialEq)]
#[serde(rename_all = "snake_case")]
enum Format {
    /// 32-bit floats, little-endian.
    #[default]
    F32,
    /// Bytes, from 0 to 255.
    U8,
}

/// Procedural densities.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema, PartialEq)]
#[serde(rename_all = "snake_case")]
enum Generator {
    /// Metaballs: soft spheres that blend into one another.
    Metaballs,
    /// An independent random number from 0 to 1 at each vertex.
    Noise,
}

/// The isosurface in its object space.
pub struct Isosurface {
    level: Level,
    grid: Grid,
}

/// Level minus density at the vertices: negative inside.
struct Grid {
    size: [usize; 3],
    values: Vec<f64>,
    /// Whether a block contains a cell whose values span the level.
    active: Vec<bool>,
    blocks: [usize; 3],
    /// The range of cells that contains all roots: inclusive start, exclusive end.
    first: [usize; 3],
    last: [usize; 3],
}

impl Plugin<Shapes> for Isosurface {
    const TYPE: &'static str = "isosurface";
    type Config = Config;

    fn build(
        config: Config,
        transform: Transform,
        context: &mut dyn Context,
    ) -> Result<LoweredShape, SceneErrors> {
        let size = config.size.map(|n| n.get() as usize);
        let count = size.iter().map(|n| *n as u64).product::<u64>();
        if count > MAX_VALUES {
            let [x, y, z] = size;
            let message = format!("{x} x {y} x {z} is more than {MAX_VALUES} values");
            return Err(SceneError::anywhere(message).into());
        }
        context.reserve(2 * count * size_of::<f64>() as u64)?;
        let level = config
            .iso_value
            .as_ref()
            .map_or(DEFAULT_ISO_VALUE, |level| level.get_ref().get());
        let place = config.iso_value.as_ref().map(Spanned::span);
        let mut values = density::read(config, size, context)?;
        let range = values
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
                (v.min(low), v.max(high))
            });
        let seen = range.0 <= level && level < range.1;
        if !seen {
            let message = format!(
                "the surface is empty: the density ranges from {} to {}, `iso_value` is {level}",
                range.0, range.1
            );
            context.warn(SceneError {
                span: place,
                ..SceneError::anywhere(message).with_help("choose an `iso_value` between them")
            });
        }
        for value in &mut values {
            *value = -(*value - level);
        }
        Ok(LoweredShape::Custom(Box::new(Self::new(
            Grid::new(size, values),
            transform,
        ))))
    }
}

impl Grid {
    fn new(size: [usize; 3], values: Vec<f64>) -> Self {
        let blocks = size.map(|n| (n - 1).div_ceil(BLOCK));
        let mut grid = Self {
            active: vec![false; blocks.iter().product()],
            first: size,
            last: [0; 3],
            size,
            values,
            blocks,
        };
        for z in 0..size[2] - 1 {
            for y in 0..size[1] - 1 {
                for x in 0..size[0] - 1 {
                    let cell = [x, y, z];
                    if straddles(&grid.corners(cell)) {
                        let block = grid.block(cell);
                        grid.active[block] = true;
                        for axis in 0..3 {
                            grid.first[axis] = grid.first[axis].min(cell[axis]);
                            grid.last[axis] = grid.last[axis].max(cell[axis] + 1);
                        }
                    }
                }
            }
        }
        for axis in 0..3 {
            // One more cell on each side, except at the border of the grid: a ray that enters the
            // box one rounding late must still start outside the set, also where the surface lies
            // on a face.
            grid.first[axis] = grid.first[axis].saturating_sub(1);
            grid.last[axis] = (grid.last[axis] + 1).min(grid.size[axis] - 1);
            // If no value spans the level, any cell will do.
            grid.first[axis] = grid.first[axis].min(grid.last[axis] - 1);
        }
        grid
    }

    /// Whether the whole border of the grid is outside of the set.
    fn is_closed(&self) -> bool {
        let [nx, ny, nz] = self.size;
        let inner = |i: usize, n: usize| i > 0 && i < n - 1;
        self.values.iter().enumerate().all(|(at, value)| {
            *value >= 0.0 || inner(at % nx, nx) && inner(at / nx % ny, ny) && inner(at / nx / ny, nz)
        })
    }

    fn block(&self, cell: [usize; 3]) -> usize {
        let [x, y, z] = cell.map(|c| c / BLOCK);
        x + self.blocks[0] * (y + self.blocks[1] * z)
    }

    /// Values at the corners of a cell, x fastest.
    #[inline]
    fn corners(&self, [x, y, z]: [usize; 3]) -> [f64; 8] {
        let (line, plane) = (self.size[0], self.size[0] * self.size[1]);
        let at = x + line * y + plane * z;
        [
            0,
            1,
            line,
            line + 1,
            plane,
            plane + 1,
            plane + line,
            plane + line + 1,
        ]
        .map(|o| self.values[at + o])
    }

    fn cell_number(&self, [x, y, z]: [usize; 3]) -> usize {
        x + (self.size[0] - 1) * (y + (self.size[1] - 1) * z)
    }

    fn cell(&self, number: usize) -> [usize; 3] {
        let (nx, ny) = (self.size[0] - 1, self.size[1] - 1);
        [
            number % nx,
            number / nx % ny,
            (number / nx / ny).min(self.size[2] - 2),
        ]
    }

    /// Transforms an object-space point to grid coordinates, in cells.
    fn coordinates(&self, p: DVec3) -> DVec3 {
        (p + 1.0) * self.cells_per_unit()
    }

    fn cells_per_unit(&self) -> DVec3 {
        DVec3::from_array(self.size.map(|n| 0.5 * (n - 1) as f64))
    }

    /// The cell that contains a point, or the nearest one.
    fn cell_at(&self, coordinates: DVec3) -> [usize; 3] {
        std::array::from_fn(|axis| (coordinates[axis].max(0.0) as usize).min(self.size[axis] - 2))
    }

    /// Value and gradient of the trilinear function of a cell, extrapolated beyond it.
    fn sample(&self, cell: [usize; 3], p: DVec3) -> Sample {
        let corners = self.corners(cell);
        let local = self.coordinates(p) - DVec3::from_array(cell.map(|c| c as f64));
        let [x, y, z] = local.to_array();
        let c = |i: usize| corners[i];
        let mix = |a: f64, b: f64, c: f64, d: f64, s: f64, t: f64| lerp(lerp(a, b, s), lerp(c, d, s), t);
        let gradient = DVec3::new(
            mix(c(1) - c(0), c(3) - c(2), c(5) - c(4), c(7) - c(6), y, z),
            mix(c(2) - c(0), c(3) - c(1), c(6) - c(4), c(7) - c(5), x, z),
            mix(c(4) - c(0), c(5) - c(1), c(6) - c(2), c(7) - c(3), x, y),
        ) * self.cells_per_unit();
        let largest = corners
            .iter()
            .fold(0.0_f64, |largest, value| largest.max(value.abs()));
        Sample {
            value: trilinear(&corners, local),
            gradient,
            error: 8.0 * f64::EPSILON * largest,
        }
    }

    /// Visits all crossings of a segment in order, with their cell, until `visit` breaks. The
    /// number of cells is at most the sum of the three grid dimensions; each has at most three
    /// roots.
    fn walk(&self, segment: &Segment, mut visit: impl FnMut(Crossing, [usize; 3]) -> ControlFlow<()>) {
        let origin = self.coordinates(segment.origin);
        let direction = segment.direction * self.cells_per_unit();
        let (first, last) = (self.first, self.last);
        let mut cell: [usize; 3] =
            std::array::from_fn(|axis| (origin[axis].max(0.0) as usize).clamp(first[axis], last[axis] - 1));
        let (mut s, mut entry) = (0.0, origin);
        let mut inside = None;
        loop {
            let active = self.active[self.block(cell)];
            let low = if active {
                cell
            } else {
                cell.map(|c| c / BLOCK * BLOCK)
            };
            let high = if active {
                cell.map(|c| c + 1)
            } else {
                low.map(|c| c + BLOCK)
            };
            // The ray leaves the cell through the nearest plane.
            let (mut exit, mut axis) = (f64::INFINITY, 3);
            for k in 0..3 {
                let plane = if direction[k] > 0.0 { high[k] } else { low[k] } as f64;
                let at = (plane - origin[k]) / direction[k];
                if direction[k] != 0.0 && at < exit {
                    (exit, axis) = (at, k);
                }
            }
            let next = exit.clamp(s, 1.0);
            let whole = |c: [usize; 3]| DVec3::from_array(c.map(|c| c as f64));
            let mut leaving = (origin + next * direction).clamp(whole(low), whole(high));
            if exit < 1.0 && axis < 3 {
                // Exactly on the face through which the ray enters the next cell.
                leaving[axis] = if direction[axis] > 0.0 {
                    high[axis]
                } else {
                    low[axis]
                } as f64;
            }
            if active {
                let corners = self.corners(cell);
                if straddles(&corners) {
                    let corner = whole(cell);
                    let from = (entry - corner).clamp(DVec3::ZERO, DVec3::ONE);
                    let cubic = Cubic::new(&corners, from, leaving - corner);
                    let starts_inside = cubic.0[0] < 0.0;
                    // Cells agree on a common face; a sign change that rounding causes at an edge
                    // is reported here.
                    let jumps = inside.is_some_and(|inside| inside != starts_inside);
                    let mut cross = |local: f64, enters: bool| {
                        let s = s + local * (next - s);
                        visit(Crossing { s, enters }, cell)
                    };
                    if jumps && cross(0.0, starts_inside).is_break() {
                        return;
                    }
                    if cubic.crossings(&mut cross).is_break() {
                        return;
                    }
                    inside = Some(cubic.0[3] < 0.0);
                }
            }
            if exit >= 1.0 || axis == 3 {
                return;
            }
            for k in 0..3 {
                let (low, high) = (low[k].max(first[k]), high[k].min(last[k]));
                cell[k] = (leaving[k] as usize).clamp(low, high - 1);
            }
            cell[axis] = if direction[axis] > 0.0 {
                high[axis]
            } else {
                low[axis].wrapping_sub(1)
            };
            if !(first[axis]..last[axis]).contains(&cell[axis]) {
                return;
            }
            (s, entry) = (next, leaving);
        }
    }
}

/// Whether some corners are inside and some outside.
#[inline]
fn straddles(corners: &[f64; 8]) -> bool {
    corners.iter().any(|value| *value < 0.0) && !corners.iter().all(|value| *value < 0.0)
}

impl Isosurface {
    fn new(grid: Grid, transform: Transform) -> Self {
        let corner = |cells: [usize; 3]| {
            let cells = DVec3::from_array(cells.map(|c| c as f64));
            (cells / grid.cells_per_unit() - 1.0).clamp(DVec3::NEG_ONE, DVec3::ONE)
        };
        Self {
            level: Level::new(transform, corner(grid.first), corner(grid.last)),
            grid,
        }
    }

    /// Derivative of level minus density along an object-space ray, at its origin.
    fn slope(&self, ray: &Ray) -> f64 {
        let cell = self.grid.cell_at(self.grid.coordinates(ray.origin));
        self.grid.sample(cell, ray.origin).gradient.dot(ray.direction)
    }

    /// The parameters of a hit in a cell.
    fn prim_uv(&self, cell: [usize; 3]) -> DVec2 {
        DVec2::new(self.grid.cell_number(cell) as f64, 0.0)
    }
}

impl Shape for Isosurface {
    fn bounds(&self) -> Aabb {
        self.level.bounds()
    }

    fn intersect(&self, ray: &Ray, interval: Interval, origin_primitive: Option<u32>) -> Option<ShapeHit> {
        let ray = self.level.ray(ray);
        let segment = self.level.clip(&ray)?;
        let origin_primitive = origin_primitive.map(|_| self.slope(&ray));
        let mut filter = self.level.filter(&ray, &segment, origin_primitive, interval.min);
        let mut found = None;
        self.grid.walk(&segment, |crossing, cell| match filter(crossing) {
            Some(t) => {
                found = Some((t, cell));
                ControlFlow::Break(())
            }
            None => ControlFlow::Continue(()),
        });
        let (t, cell) = found?;
        whole(t, interval, self.prim_uv(cell))
    }

    fn surface(&self, ray: &Ray, hit: &PreliminaryIntersection, _: SurfaceAttributes) -> SurfaceInteraction {
        let cell = self.grid.cell(hit.prim_uv.x as usize);
        let p = self.level.ray(ray).at(hit.t);
        self.level.surface(ray, p, |p| self.grid.sample(cell, p))
    }

    fn is_solid(&self) -> bool {
        self.grid.is_closed()
    }

    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        self.level.spans(&self.level.ray(ray), spans, |segment, tell| {
            self.grid.walk(segment, |crossing, cell| {
                tell(crossing, self.prim_uv(cell));
                ControlFlow::Continue(())
            });
        });
    }

    fn goes_inside(&self, ray: &Ray, _: u32) -> bool {
        self.slope(&self.level.ray(ray)) < 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{Random, TestContext, build, build_in, shape_laws_everywhere};

    const CUBE: &str = "size = [2, 2, 2]\nvalues = [0, 1, 0, 1, 0, 1, 0, 1]\n";
    const CORNER: &str = "size = [2, 2, 2]\nvalues = [1, 1, 1, 1, 1, 1, 1, 0]\niso_value = 0.9";

    fn iso(text: &str) -> Box<dyn Shape> {
        match build::<Shapes, Isosurface>(text, Transform::IDENTITY).unwrap() {
            LoweredShape::Custom(shape) => shape,
            _ => unreachable!("an isosurface is a custom shape"),
        }
    }

    fn of_values(size: [usize; 3], values: Vec<f64>) -> Isosurface {
        Isosurface::new(Grid::new(size, values), Transform::IDENTITY)
    }

    /// All crossings of a ray in order, one query per hit, each starting at the previous hit.
    fn all(shape: &Isosurface, ray: &Ray) -> Vec<f64> {
        let mut found = Vec::new();
        let mut min = 0.0;
        let beyond = |min| Interval {
            min,
            ..Interval::FORWARD
        };
        while let Some(hit) = shape.intersect(ray, beyond(min), None) {
            found.push(hit.t);
            min = hit.t;
            assert!(found.len() < 1000);
        }
        found
    }

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws_everywhere::<Isosurface>(CORNER, 2_000);
        shape_laws_everywhere::<Isosurface>(
            "size = [17, 12, 20]\ngenerator = \"metaballs\"\nballs = 40\niso_value = 0.1",
            2_000,
        );
        shape_laws_everywhere::<Isosurface>(
            "size = [5, 4, 6]\ngenerator = \"noise\"\niso_value = 0.6",
            2_000,
        );
    }

    #[test]
    fn half_of_a_cell_is_cut_by_a_plane() {
        let shape = iso(CUBE);
        let ray = Ray::new(DVec3::new(-3.0, 0.25, 0.5), DVec3::X);
        let hit = shape.intersect(&ray, Interval::FORWARD, None).unwrap();
        assert_eq!(hit.t, 3.0);
        let point = shape.surface(
            &ray,
            &hit.of_shape(whitstone_core::InstanceId::TOP_LEVEL, 0),
            SurfaceAttributes::NOTHING,
        );
        assert_eq!(
            (point.position, point.n_g),
            (DVec3::new(0.0, 0.25, 0.5), DVec3::NEG_X)
        );
        // The box itself is not a surface.
        let back = Ray::new(DVec3::new(0.5, 0.0, 0.0), DVec3::X);
        assert_eq!(shape.intersect(&back, Interval::FORWARD, None), None);
    }

    /// Exact crossings of an axis-parallel ray at dyadic coordinates: the density is exact in
    /// double precision, or rounded in the last place, and linear between nodes.
    fn exact_crossings(size: [usize; 3], values: &[f64], axis: usize, [u, v]: [f64; 2]) -> Vec<f64> {
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
        let node = |i: usize| {
            let mut sum = 0.0;
            for (j, wj) in [(u.floor(), 1.0 - u.fract()), (u.floor() + 1.0, u.fract())] {
                for (k, wk) in [(v.floor(), 1.0 - v.fract()), (v.floor() + 1.0, v.fract())] {
                    let mut at = [0; 3];
                    at[axis] = i;
                    at[b] = (j as usize).min(size[b] - 1);
                    at[c] = (k as usize).min(size[c] - 1);
                    sum += wj * wk * values[at[0] + size[0] * (at[1] + size[1] * at[2])];
                }
            }
            sum
        };
        let mut found = Vec::new();
        for i in 1..size[axis] {
            let (before, after) = (node(i - 1), node(i));
            if (before < 0.0) != (after < 0.0) {
                found.push((i - 1) as f64 + before / (before - after));
            }
        }
        // Leaving and entering at the same place is one hit.
        found.dedup_by(|a, b| *a - *b < 1e-12);
        found
    }

    /// Rays through plateaus: values of 0, -1 and ±2^-k, also constant over whole cells, with the
    /// level exactly at 0.
    #[test]
    fn no_root_is_missed_where_the_density_is_the_level_all_over_cells() {
        let mut random = Random::new(30);
        let (mut rays, mut roots, mut naive_misses) = (0, 0, 0);
        for case in 0..400 {
            let size = [2 + random.below(12), 2 + random.below(6), 2 + random.below(20)];
            let count = size.iter().product();
            // Half of all values equal the level exactly; in some grids a third are very close to
            // it.
            let small = 0.5f64.powi(case % 50);
            let values: Vec<f64> = (0..count)
                .map(|_| [0.0, 0.0, 0.0, small, -small, -1.0][random.below(6)])
                .collect();
            let shape = of_values(size, values.clone());
            for _ in 0..40 {
                let axis = random.below(3);
                let eighths = |n: usize, random: &mut Random| random.below(8 * (n - 1) + 1) as f64 / 8.0;
                let across = [
                    eighths(size[(axis + 1) % 3], &mut random),
                    eighths(size[(axis + 2) % 3], &mut random),
                ];
                let expected = exact_crossings(size, &values, axis, across);
                // Converting to object space rounds unless the number of cells along the axis is a
                // power of two, so roots are compared up to rounding.
                let unit = shape.grid.cells_per_unit();
                let mut cells = DVec3::ZERO;
                cells[(axis + 1) % 3] = across[0];
                cells[(axis + 2) % 3] = across[1];
                let mut origin = cells / unit - 1.0;
                if shape.grid.coordinates(origin) != cells {
                    continue;
                }
                origin[axis] = -2.0;
                let ray = Ray::new(origin, DVec3::AXES[axis]);
                let mut found: Vec<f64> = all(&shape, &ray).iter().map(|t| (t - 1.0) * unit[axis]).collect();
                found.dedup_by(|a, b| *a - *b < 1e-12);
                let near = |a: &[f64], b: &[f64]| {
                    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12)
                };
                assert!(near(&found, &expected), "{found:?} {expected:?} {size:?} {ray:?}");
                rays += 1;
                roots += expected.len();
                // A test for opposite signs at the ends of a cell misses the ends of plateaus.
                let ends: Vec<f64> = (0..size[axis])
                    .map(|i| {
                        let mut at = cells;
                        at[axis] = i as f64;
                        let cell = shape.grid.cell_at(at);
                        trilinear(
                            &shape.grid.corners(cell),
                            at - DVec3::from_array(cell.map(|c| c as f64)),
                        )
                    })
                    .collect();
                let opposite = ends.windows(2).filter(|pair| pair[0] * pair[1] < 0.0).count();
                naive_misses += usize::from(opposite < expected.len());
            }
        }
        assert!(rays > 5_000 && roots > 5_000, "{rays} {roots}");
        assert!(naive_misses > 1_000, "{naive_misses} of {rays}");
    }

    /// The density, computed independently of the plugin.
    fn density(size: [usize; 3], values: &[f64], p: DVec3) -> f64 {
        let mut sum = 0.0;
        for (i, value) in values.iter().enumerate() {
            let at = [i % size[0], i / size[0] % size[1], i / size[0] / size[1]];
            let weight = (0..3).map(|k| {
                let cells = (p[k] + 1.0) / 2.0 * (size[k] - 1) as f64;
                (1.0 - (cells - at[k] as f64).abs()).max(0.0)
            });
            sum += weight.product::<f64>() * value;
        }
        sum
    }

    #[test]
    fn no_root_is_missed_along_oblique_rays_and_none_is_invented() {
        let mut random = Random::new(31);
        let (mut roots, mut several_in_a_cell) = (0, 0);
        for case in 0..150 {
            let size = [2 + random.below(4), 2 + random.below(4), 2 + random.below(12)];
            let values: Vec<f64> = (0..size.iter().product::<usize>())
                .map(|_| random.signed())
                .collect();
            let shape = of_values(size, values.clone());
            for _ in 0..20 {
                let from = 3.0 * random.direction();
                let mut to = random.cube();
                // Through vertices and edges of the grid.
                if case % 3 == 0 {
                    for k in 0..3 {
                        to[k] = 2.0 * random.below(size[k]) as f64 / (size[k] - 1) as f64 - 1.0;
                    }
                }
                let ray = Ray::new(from, to - from);
                let found = all(&shape, &ray);
                let value = |t: f64| density(size, &values, ray.at(t));
                for (i, t) in found.iter().enumerate() {
                    assert!(value(*t).abs() < 1e-12, "{t}");
                    several_in_a_cell += usize::from(i > 0 && t - found[i - 1] < 0.02);
                }
                // The sign is constant between two roots, and changes at each root.
                let segment = shape.level.clip(&ray).map_or((0.0, 0.0), |s| (s.begin, s.end));
                let ends: Vec<f64> = [segment.0]
                    .into_iter()
                    .chain(found.clone())
                    .chain([segment.1])
                    .collect();
                let mut sign = None;
                for pair in ends.windows(2) {
                    let signs: Vec<bool> = (1..40)
                        .map(|i| value(pair[0] + (pair[1] - pair[0]) * f64::from(i) / 40.0))
                        .filter(|v| v.abs() > 1e-12)
                        .map(|v| v < 0.0)
                        .collect();
                    assert!(signs.windows(2).all(|s| s[0] == s[1]), "{ray:?} {found:?}");
                    if let (Some(before), Some(now)) = (sign, signs.first()) {
                        assert_ne!(before, *now, "{ray:?} {found:?}");
                    }
                    sign = signs.first().copied().or(sign.map(|s: bool| !s));
                }
                roots += found.len();
            }
        }
        assert!(
            roots > 2_000 && several_in_a_cell > 20,
            "{roots} {several_in_a_cell}"
        );
    }

    #[test]
    fn three_roots_in_one_cell_are_found() {
        // The cubic along the diagonal of a cell with these corners has three roots.
        let values = vec![-0.1, 1.0, 1.0, -1.0, 1.0, -1.0, -1.0, 0.1];
        let shape = of_values([2, 2, 2], values);
        let ray = Ray::new(DVec3::splat(-1.5), DVec3::ONE);
        let found = all(&shape, &ray);
        assert_eq!(found.len(), 3, "{found:?}");
        assert!((found[1] - 1.5).abs() < 1e-15);
    }

    #[test]
    fn wrong_values_are_refused_and_a_level_out_of_reach_is_told() {
        let error = |text: &str| {
            build::<Shapes, Isosurface>(text, Transform::IDENTITY)
                .err()
                .unwrap()
                .0
                .remove(0)
        };
        let text = "size = [2, 2, 2]\nvalues = [0, 1, 0, 1, 0, nan, 0, 1]";
        let found = error(text);
        assert_eq!(
            (found.message.as_str(), &text[found.span.unwrap()]),
            ("expected a finite number, found NaN", "nan")
        );
        let message = |text: &str| error(text).message;
        assert_eq!(
            message("size = [2, 2, 3]\nvalues = [1]"),
            "expected 12 values for a grid of 2 x 2 x 3, found 1"
        );
        assert!(message("size = [2, 2, 2]").starts_with("no values"));
        assert!(
            message("size = [2, 2, 2]\nvalues = []\ngenerator = \"noise\"")
                .starts_with("more than one source")
        );
        assert!(message("size = [2, 2, 2]\ngenerator = \"noise\"\nballs = 3").contains("metaballs"));
        assert!(message("size = [2048, 2048, 2048]\ngenerator = \"noise\"").contains("more than"));
        assert!(message("size = [1, 2, 2]\nvalues = [1, 2, 3, 4]").contains("an integer from 2 to 2048"));

        let mut context = TestContext::default();
        let shape = build_in::<Shapes, Isosurface>(
            &format!("{CUBE}iso_value = 1"),
            Transform::IDENTITY,
            &mut context,
        );
        assert_eq!(context.warnings.len(), 1);
        let Ok(LoweredShape::Custom(shape)) = shape else {
            panic!("it is built")
        };
        let ray = Ray::new(DVec3::new(-3.0, 0.25, 0.5), DVec3::X);
        assert_eq!(shape.intersect(&ray, Interval::FORWARD, None), None);
    }
}
