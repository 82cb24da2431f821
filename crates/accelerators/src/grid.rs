//! A uniform grid: space is divided into equal cells, and a ray walks from cell to cell.
//!
//! - Build: `density` cells per element, as cubic as possible (Cleary and Wyvill, *Analysis of an
//!   algorithm for fast ray tracing using uniform space subdivision*, 1988; Pharr, Jakob,
//!   Humphreys, *PBR*, 2nd ed., section 4.3). `levels = 2` gives every cell that holds many
//!   elements its own grid (Jevans and Wyvill, *Adaptive voxel subdivision for ray tracing*, 1989;
//!   Kalojanov, Billeter, Slusallek, *Two-level grids for ray tracing on GPUs*, 2011); see `cells`.
//! - Traversal: Amanatides and Woo, *A fast voxel traversal algorithm for ray tracing*, 1987. The
//!   ray is widened to cover rounding errors (see `elements`), so it crosses each plane twice: it
//!   first enters the cell beyond, and slightly later leaves the cell before. In between, both
//!   cells are visited. Distances to planes are computed from the planes' coordinates, not
//!   accumulated, so that errors do not grow along the ray.
//! - An element in several cells is seldom tested twice: `Mailbox`.
//! - Cost model: a ray through a grid of c³ cells visits at most about 3 c of them, and about c
//!   on average. Each step takes about half the time of a test (`STEP_COST`). A cell of a grid of N
//!   equal cells is crossed with the probability A_cell / A, the ratio of surface areas, so that a
//!   ray without a hit costs the sum over all cells of A_cell (0.5 + elements) / A. More cells mean
//!   fewer tests and more steps; the two balance at a few cells per element if the elements are
//!   spread evenly. If they are not (the teapot in the stadium), one cell holds nearly all of them
//!   and nothing is gained. A second level fixes one such jump in scale (18,000 tests a ray become
//!   46). Memory: `density` cells per element, and at most 16 references per element on average;
//!   the cells are enlarged otherwise. Build: O(n), the fastest of all.
//! - If the origin is so far away that the widened ray is half a cell wide (10^11 cell widths), the
//!   ray visits every cell.
//!
//! - Twin: none needed; the image does not depend on it.
//! - Example: `scenes/accelerators/grid.toml`.

mod cells;

use crate::support::elements::{Elements, Mailbox, Searched, Structure, Visitor, WideRay, bounds};
use cells::Cells;
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::IntegerIn;
use whitstone_core::{
    Accelerator, Accelerators, Context, DebugBounds, Element, Geometry, Plugin, SceneErrors, Statistics,
};

/// A uniform grid of one or two levels: fast to build, suited to evenly distributed elements.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Number of cells per element.
    #[serde(default = "four")]
    density: IntegerIn<1, 64>,
    /// Number of levels; 2 gives each cell that holds many elements its own grid.
    #[serde(default = "one")]
    levels: IntegerIn<1, 2>,
}

fn four() -> IntegerIn<1, 64> {
    IntegerIn::new(4).expect("4 is in range")
}

fn one() -> IntegerIn<1, 2> {
    IntegerIn::new(1).expect("1 is in range")
}

/// With two levels, the density of the first level is `density` divided by this.
const COARSER: f64 = 32.0;

/// With two levels, cells of at least this many elements get their own grid.
const CROWD: usize = 8;

/// Cost of a step to the next cell in element tests.
const STEP_COST: f64 = 0.5;

/// Maximum number of references per element, on average; with two levels, its square root on each.
const MAX_REFERENCES: usize = 16;

/// The grid.
pub struct Grid {
    cells: Cells,
    /// For each cell, the index of its inner grid, or `NONE`; empty with one level.
    inner_of: Vec<u32>,
    inner: Vec<Cells>,
    elements: Vec<Element>,
}

/// No inner grid.
const NONE: u32 = u32::MAX;

impl Plugin<Accelerators> for Grid {
    const TYPE: &'static str = "grid";
    type Config = Config;

    fn build(
        config: Config,
        geometry: Arc<Geometry>,
        _: &mut dyn Context,
    ) -> Result<Box<dyn Accelerator>, SceneErrors> {
        let density = f64::from(config.density.get());
        let two = config.levels.get() == 2;
        Ok(Box::new(Searched::new(geometry, |geometry, elements| {
            Self::new(geometry, &elements, density, two)
        })?))
    }
}

impl Grid {
    fn new(geometry: &Geometry, elements: &Elements, density: f64, two: bool) -> Self {
        let items = &elements.items;
        let all: Vec<u32> = (0..items.len() as u32).collect();
        let (coarse, most) = if two {
            (density / COARSER, MAX_REFERENCES.isqrt())
        } else {
            (density, MAX_REFERENCES)
        };
        let whole = bounds(items);
        let cells = Cells::new(geometry, elements, &all, whole, coarse, most);
        let mut grid = Self {
            elements: items.iter().map(|item| item.element).collect(),
            inner_of: Vec::new(),
            inner: Vec::new(),
            cells,
        };
        if two {
            for cell in 0..grid.cells.count() {
                let held = grid.cells.held(cell);
                if held.len() < CROWD {
                    grid.inner_of.push(NONE);
                    continue;
                }
                let boxes = held.iter().map(|&i| items[i as usize].aabb);
                let all = boxes.reduce(|a, b| a.union(b)).unwrap_or(whole);
                let mut part = grid.cells.cell(cell);
                (part.min, part.max) = (part.min.max(all.min), part.max.min(all.max));
                // Rounding may invert a flat box.
                let part = part.including(part.min.min(part.max));
                grid.inner_of.push(grid.inner.len() as u32);
                grid.inner
                    .push(Cells::new(geometry, elements, held, part, density, most));
            }
        }
        grid
    }
}

impl Grid {
    /// Expected cost of a ray that crosses the grid without a hit, in element tests.
    fn cost(&self) -> f64 {
        let own = |cells: &Cells, counts: &dyn Fn(usize) -> bool| {
            let held = (0..cells.count()).filter(|&cell| counts(cell));
            let tests: usize = held.map(|cell| cells.held(cell).len()).sum();
            // All cells have the same area.
            cells.cell(0).half_area() * (STEP_COST * cells.count() as f64 + tests as f64)
        };
        let tested = |cell: usize| self.inner_of.get(cell).is_none_or(|&inner| inner == NONE);
        let inner = self.inner.iter().map(|inner| own(inner, &|_| true));
        let all = own(&self.cells, &tested) + inner.sum::<f64>();
        // Normalized by the area of the whole grid, which may be zero.
        all / self.cells.bounds().half_area().max(f64::MIN_POSITIVE)
    }
}

impl Structure for Grid {
    #[inline]
    fn visit(&self, ray: &WideRay, min: f64, limit: f64, visitor: &mut impl Visitor) -> Option<f64> {
        let mut mailbox = Mailbox::new();
        let mut try_all = |held: &[u32], mut limit: f64| {
            visitor.step();
            for &element in held {
                if mailbox.is_new(element) {
                    limit = visitor.test(self.elements[element as usize])?;
                }
            }
            Some(limit)
        };
        if self.inner.is_empty() {
            let cells = &self.cells;
            return cells.walk(ray, min, limit, &mut |cell, limit| {
                try_all(cells.held(cell), limit)
            });
        }
        self.cells.walk(
            ray,
            min,
            limit,
            &mut |cell, limit| match self.inner.get(self.inner_of[cell] as usize) {
                Some(inner) => {
                    let limit = try_all(&[], limit)?;
                    inner.walk(ray, min, limit, &mut |cell, limit| {
                        try_all(inner.held(cell), limit)
                    })
                }
                None => try_all(self.cells.held(cell), limit),
            },
        )
    }

    fn statistics(&self) -> Statistics {
        let all = || self.inner.iter().chain([&self.cells]);
        let sum = |f: fn(&Cells) -> usize| all().map(f).sum::<usize>() as f64;
        let own = size_of_val(&*self.inner_of) + size_of_val(&*self.inner) + size_of_val(&*self.elements);
        let [x, y, z] = self.cells.resolution().map(|n| n as f64);
        Statistics::from([
            ("cells", sum(Cells::count)),
            ("cells_x", x),
            ("cells_y", y),
            ("cells_z", z),
            ("inner_grids", self.inner.len() as f64),
            ("empty_cells", sum(Cells::empty)),
            ("references", sum(Cells::references)),
            ("depth", if self.inner.is_empty() { 1.0 } else { 2.0 }),
            ("sah_cost", self.cost()),
            ("bytes", own as f64 + sum(Cells::bytes)),
        ])
    }

    /// The whole grid, then its non-empty cells, then those of the inner grids.
    fn debug_bounds(&self, deepest: usize) -> Vec<DebugBounds> {
        if self.elements.is_empty() {
            return Vec::new();
        }
        let whole = DebugBounds::of_box(0, self.cells.bounds());
        let occupied = |cells: &Cells, depth: usize| -> Vec<DebugBounds> {
            let numbers = (0..cells.count()).filter(|&cell| depth <= deepest && !cells.held(cell).is_empty());
            numbers
                .map(|cell| DebugBounds::of_box(depth, &cells.cell(cell)))
                .collect()
        };
        let inner = self.inner.iter().flat_map(|inner| occupied(inner, 2));
        [whole]
            .into_iter()
            .chain(occupied(&self.cells, 1))
            .chain(inner)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::accelerator_laws;

    #[test]
    fn obeys_the_laws_of_accelerators() {
        for text in [
            "",
            "density = 1",
            "density = 64",
            "levels = 2",
            "levels = 2\ndensity = 1",
            "levels = 2\ndensity = 64",
        ] {
            accelerator_laws::<Grid>(text);
        }
    }
}
