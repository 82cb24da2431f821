//! One level of grid cells, and the walk through it.

use crate::support::elements::{Elements, WideRay, overlaps};
use crate::support::elements::{MARGIN, PAD};
use whitstone_core::{Aabb, DVec3, Geometry};

/// Equal cells of a box, with the elements of each.
pub(super) struct Cells {
    bounds: Aabb,
    /// Edge lengths of a cell; zero where the box is flat.
    size: DVec3,
    /// Cells per unit of length; infinite where the box is flat.
    scale: DVec3,
    /// Cells along each axis.
    resolution: [usize; 3],
    /// For each cell, the start of its references; one more entry at the end.
    starts: Vec<u32>,
    references: Vec<u32>,
}

impl Cells {
    /// Cells for some of the elements in a box: about `density` per element, and fewer if there
    /// would be more than `most` references per element on average.
    pub(super) fn new(
        geometry: &Geometry,
        elements: &Elements,
        held: &[u32],
        bounds: Aabb,
        density: f64,
        most: usize,
    ) -> Self {
        // Larger than the padding of rays that start nearby.
        let smallest = 16.0 * PAD * elements.reach;
        let mut cells = Self {
            bounds,
            size: DVec3::ZERO,
            scale: DVec3::ZERO,
            // Cells are numbered in 32 bits.
            resolution: resolution(
                bounds.extent(),
                (density * held.len() as f64).min(f64::from(1u32 << 31)),
                smallest,
            ),
            starts: Vec::new(),
            references: Vec::new(),
        };
        loop {
            cells.set_size();
            let boxes = held.iter().map(|&i| &elements.items[i as usize].aabb);
            let counts = boxes.map(|aabb| cells.range(aabb).map(|(low, high)| high - low + 1));
            let references: usize = counts.map(|[x, y, z]| x * y * z).sum();
            if references <= most * held.len() || cells.resolution == [1; 3] {
                break;
            }
            cells.resolution = cells.resolution.map(|n| n.div_ceil(2));
        }
        cells.fill(geometry, elements, held);
        cells
    }

    fn set_size(&mut self) {
        let count = DVec3::from_array(self.resolution.map(|n| n as f64));
        let extent = self.bounds.extent();
        (self.size, self.scale) = (extent / count, count / extent);
    }

    /// Refers to every element from the cells that it lies in.
    fn fill(&mut self, geometry: &Geometry, elements: &Elements, held: &[u32]) {
        let mut pairs = Vec::with_capacity(2 * held.len());
        for &number in held {
            let item = &elements.items[number as usize];
            let [x, y, z] = self.range(&item.aabb);
            let one = x.0 == x.1 && y.0 == y.1 && z.0 == z.1;
            let corners = if one { None } else { item.corners(geometry) };
            for z in z.0..=z.1 {
                for y in y.0..=y.1 {
                    for x in x.0..=x.1 {
                        let cell = self.index([x, y, z]);
                        let margin = MARGIN * elements.reach;
                        if corners.is_none_or(|corners| overlaps(&corners, &self.cell(cell), margin)) {
                            pairs.push((cell as u32, number));
                        }
                    }
                }
            }
        }
        // Counting sort, which keeps the elements of a cell in their order.
        self.starts = vec![0; self.count() + 1];
        for (cell, _) in &pairs {
            self.starts[*cell as usize + 1] += 1;
        }
        for i in 1..self.starts.len() {
            self.starts[i] += self.starts[i - 1];
        }
        let mut next = self.starts.clone();
        self.references = vec![0; pairs.len()];
        for (cell, number) in pairs {
            let place = &mut next[cell as usize];
            self.references[*place as usize] = number;
            *place += 1;
        }
    }

    /// The first and last cell that a box overlaps, along each axis.
    fn range(&self, aabb: &Aabb) -> [(usize, usize); 3] {
        [0, 1, 2].map(|axis| {
            let low = self.coordinate(axis, aabb.min[axis]);
            (low, self.coordinate(axis, aabb.max[axis]).max(low))
        })
    }

    /// The cell of a position along an axis, clamped to the grid. The conversion saturates, and
    /// turns the NaN of a flat box into 0.
    fn coordinate(&self, axis: usize, x: f64) -> usize {
        let cell = ((x - self.bounds.min[axis]) * self.scale[axis]) as usize;
        cell.min(self.resolution[axis] - 1)
    }

    fn plane(&self, axis: usize, number: usize) -> f64 {
        self.bounds.min[axis] + number as f64 * self.size[axis]
    }

    #[inline]
    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.resolution[1] + y) * self.resolution[0] + x
    }

    /// The box of a cell.
    pub(super) fn cell(&self, index: usize) -> Aabb {
        let [nx, ny, _] = self.resolution;
        let at = [index % nx, index / nx % ny, index / nx / ny];
        let corner = |more: usize| DVec3::from_array([0, 1, 2].map(|axis| self.plane(axis, at[axis] + more)));
        Aabb {
            min: corner(0),
            max: corner(1),
        }
    }

    /// The elements of a cell.
    #[inline]
    pub(super) fn held(&self, cell: usize) -> &[u32] {
        &self.references[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }

    pub(super) fn bounds(&self) -> &Aabb {
        &self.bounds
    }

    pub(super) fn resolution(&self) -> [usize; 3] {
        self.resolution
    }

    pub(super) fn count(&self) -> usize {
        self.resolution.iter().product()
    }

    pub(super) fn empty(&self) -> usize {
        (0..self.count())
            .filter(|&cell| self.held(cell).is_empty())
            .count()
    }

    pub(super) fn references(&self) -> usize {
        self.references.len()
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.starts) + size_of_val(&*self.references)
    }

    /// Visits the cells that the ray touches between `min` and the limit, in order of entry.
    /// `visit` receives the limit and returns the new one, or `None` to stop.
    #[inline]
    pub(super) fn walk(
        &self,
        ray: &WideRay,
        min: f64,
        mut limit: f64,
        visit: &mut impl FnMut(usize, f64) -> Option<f64>,
    ) -> Option<f64> {
        let Some((near, far)) = ray.inside(&self.bounds, min, limit) else {
            return Some(limit);
        };
        if (0..3).any(|axis| self.resolution[axis] > 1 && self.size[axis] < 4.0 * ray.pad) {
            // The padded ray may touch more than two adjacent cells.
            for cell in 0..self.count() {
                limit = visit(cell, limit)?;
            }
            return Some(limit);
        }
        let mut steps = [0, 1, 2].map(|axis| Steps::new(self, ray, axis, near));
        limit = self.touched(&steps, near, None, limit, visit)?;
        loop {
            let [x, y, z] = [steps[0].arrives, steps[1].arrives, steps[2].arrives];
            let axis = match (x <= y, x <= z, y <= z) {
                (true, true, _) => 0,
                (false, _, true) => 1,
                _ => 2,
            };
            let t = steps[axis].arrives;
            if !(t <= far && t <= limit) || t == f64::INFINITY {
                return Some(limit);
            }
            steps[axis].advance(self, ray, axis);
            limit = self.touched(&steps, t, Some(axis), limit, visit)?;
        }
    }

    /// Visits the cell that the ray has just entered along the axis `arrived`, and the adjacent
    /// ones that it has not left along the other axes.
    #[inline]
    fn touched(
        &self,
        steps: &[Steps; 3],
        t: f64,
        arrived: Option<usize>,
        mut limit: f64,
        visit: &mut impl FnMut(usize, f64) -> Option<f64>,
    ) -> Option<f64> {
        let both = [0, 1, 2].map(|axis| arrived != Some(axis) && t <= steps[axis].leaves);
        if both == [false; 3] {
            return visit(self.index([0, 1, 2].map(|axis| steps[axis].cell)), limit);
        }
        for choice in 0..8 {
            let back = [0, 1, 2].map(|axis| choice >> axis & 1 == 1);
            if (0..3).all(|axis| both[axis] || !back[axis]) {
                let cell = [0, 1, 2].map(|axis| {
                    let Steps { cell, before, .. } = steps[axis];
                    if back[axis] { before } else { cell }
                });
                limit = visit(self.index(cell), limit)?;
            }
        }
        Some(limit)
    }
}

/// Number of cells along each axis, for about `count` cells in total, as cubic as possible, none
/// with an edge shorter than `smallest`.
fn resolution(extent: DVec3, count: f64, smallest: f64) -> [usize; 3] {
    let extent = extent.to_array();
    let mut divided = extent.map(|e| e > 0.0);
    loop {
        let axes = divided.iter().filter(|&&divided| divided).count();
        if axes == 0 || count < 1.0 {
            return [1; 3];
        }
        let edges = (0..3).filter(|&axis| divided[axis]).map(|axis| extent[axis]);
        // Uses logarithms, because a product of edges may overflow.
        let size = libm::exp((edges.map(libm::log).sum::<f64>() - libm::log(count)) / axes as f64);
        let size = size.max(smallest);
        // An axis along which the box is thinner than a cell is not divided; the other axes get its
        // cells.
        let thin = (0..3).find(|&axis| divided[axis] && extent[axis] < size);
        let Some(thin) = thin else {
            return [0, 1, 2].map(|axis| {
                if divided[axis] {
                    ((extent[axis] / size).round() as usize).clamp(1, 1 << 20)
                } else {
                    1
                }
            });
        };
        divided[thin] = false;
    }
}

/// The walk along one axis.
struct Steps {
    /// The cell that the ray entered last, and the one before it.
    cell: usize,
    before: usize,
    /// Where the ray enters the next cell; infinity if there is none.
    arrives: f64,
    /// Where the ray leaves `before`; minus infinity if there is none.
    leaves: f64,
}

impl Steps {
    #[inline]
    fn new(cells: &Cells, ray: &WideRay, axis: usize, near: f64) -> Self {
        let guess = ray.ray.origin[axis] + near * ray.ray.direction[axis];
        let last = cells.resolution[axis] - 1;
        // The number of a cell, counted in the direction of the ray.
        let mirrored = |cell: usize| {
            if ray.near_side[axis] == 0 {
                cell
            } else {
                last - cell
            }
        };
        let arrived = |number: usize| ray.arrives(axis, cells.entry(ray, axis, number)) <= near;
        let mut number = mirrored(cells.coordinate(axis, guess));
        while number < last && arrived(number + 1) {
            number += 1;
        }
        while number > 0 && !arrived(number) {
            number -= 1;
        }
        let mut steps = Self {
            cell: mirrored(number),
            before: 0,
            arrives: f64::INFINITY,
            leaves: f64::NEG_INFINITY,
        };
        if number > 0 {
            steps.before = mirrored(number - 1);
            steps.leaves = ray.leaves(axis, cells.entry(ray, axis, number));
        }
        steps.aim(cells, ray, axis, number);
        steps
    }

    /// Computes where the ray enters the next cell.
    #[inline]
    fn aim(&mut self, cells: &Cells, ray: &WideRay, axis: usize, number: usize) {
        self.arrives = f64::INFINITY;
        if number + 1 < cells.resolution[axis] {
            // NaN means that the ray is parallel to the next cell and touches it only with the
            // border of its padding; `min` ignores it.
            self.arrives = self
                .arrives
                .min(ray.arrives(axis, cells.entry(ray, axis, number + 1)));
        }
    }

    #[inline]
    fn advance(&mut self, cells: &Cells, ray: &WideRay, axis: usize) {
        self.before = self.cell;
        let number = if ray.near_side[axis] == 0 {
            self.cell += 1;
            self.cell
        } else {
            self.cell -= 1;
            cells.resolution[axis] - 1 - self.cell
        };
        self.leaves = ray.leaves(axis, cells.entry(ray, axis, number));
        self.aim(cells, ray, axis, number);
    }
}

impl Cells {
    /// The plane through which a ray enters a cell, counted in the ray's direction.
    #[inline]
    fn entry(&self, ray: &WideRay, axis: usize, number: usize) -> f64 {
        if ray.near_side[axis] == 0 {
            self.plane(axis, number)
        } else {
            self.plane(axis, self.resolution[axis] - number)
        }
    }
}
