//! Binning: the triangles that may be visible in each square tile of the image, so that tiles can
//! be drawn independently by any thread.

use super::fill::{Projected, outline};
use whitstone_core::{DVec2, FilmSize, Geometry, LoweredShape};

/// Side of a tile in pixels.
const SIDE: f64 = 16.0;

/// Triangles by tile, as (shape, triangle), in scene order.
pub(super) struct Bins {
    columns: usize,
    rows: usize,
    /// Index of the first entry of each tile, plus the total at the end.
    starts: Vec<usize>,
    entries: Vec<(u32, u32)>,
}

impl Bins {
    /// An estimate: small triangles lie in one tile, sometimes in four.
    pub(super) const BYTES_A_TRIANGLE: usize = 2 * size_of::<(u32, u32)>();

    pub(super) fn new(geometry: &Geometry, projected: &Projected, film: FilmSize) -> Self {
        let size = DVec2::new(f64::from(film.width), f64::from(film.height));
        let count = |length: f64| (length / SIDE).ceil() as usize;
        let (columns, rows) = (count(size.x), count(size.y));
        let mut bins = Self {
            columns,
            rows,
            starts: vec![0; columns * rows + 1],
            entries: Vec::new(),
        };
        // First pass counts, so that all lists share one allocation.
        each(geometry, projected, size, |low, high, _| {
            for square in bins.squares(low, high) {
                bins.starts[square + 1] += 1;
            }
        });
        for square in 0..columns * rows {
            bins.starts[square + 1] += bins.starts[square];
        }
        let mut next = bins.starts.clone();
        let mut entries = vec![(0, 0); bins.starts[columns * rows]];
        each(geometry, projected, size, |low, high, name| {
            for square in bins.squares(low, high) {
                entries[next[square]] = name;
                next[square] += 1;
            }
        });
        bins.entries = entries;
        bins
    }

    /// The lists of all tiles that overlap this part of the image.
    pub(super) fn around(&self, low: DVec2, high: DVec2) -> impl Iterator<Item = &[(u32, u32)]> {
        let list = |square: usize| &self.entries[self.starts[square]..self.starts[square + 1]];
        self.squares(low, high).map(list)
    }

    /// Indices of the tiles that overlap this part of the image.
    fn squares(&self, low: DVec2, high: DVec2) -> impl Iterator<Item = usize> + use<> {
        // Casts saturate, and NaN becomes 0.
        let place = |x: f64, count: usize| ((x / SIDE) as usize).min(count - 1);
        let (columns, across) = (
            self.columns,
            place(low.x, self.columns)..=place(high.x, self.columns),
        );
        let down = place(low.y, self.rows)..=place(high.y, self.rows);
        down.flat_map(move |row| across.clone().map(move |column| row * columns + column))
    }
}

/// Visits each triangle that may be visible, with its bounds in the image.
fn each(
    geometry: &Geometry,
    projected: &Projected,
    size: DVec2,
    mut tell: impl FnMut(DVec2, DVec2, (u32, u32)),
) {
    for (shape, number) in geometry.shapes().iter().zip(0..) {
        let LoweredShape::Triangles(mesh) = shape else {
            continue;
        };
        for triangle in 0..mesh.triangles.len() as u32 {
            if let Some([low, high]) = outline(projected.corners(mesh, number, triangle), size) {
                tell(low, high, (number, triangle));
            }
        }
    }
}
