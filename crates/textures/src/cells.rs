//! Numbers of cells, for patterns that repeat in space.

/// How far borders are moved, in cells: a surface that lies exactly on a border shows one colour,
/// where otherwise rounding errors would choose.
pub(crate) const SHIFT: f64 = 1.0 / 4096.0;

/// The number of the cell that a coordinate is in.
#[inline(always)]
pub(crate) fn cell(x: f64) -> f64 {
    (x + SHIFT).floor()
}

/// 1 in cells with odd numbers, else 0; NaN where there is no cell.
#[inline(always)]
pub(crate) fn odd(x: f64) -> f64 {
    let cell = cell(x);
    // Exact for every finite number.
    cell - 2.0 * (0.5 * cell).floor()
}

#[cfg(test)]
mod tests {
    use super::odd;

    #[test]
    fn borders_belong_to_the_cell_above() {
        for (x, expected) in [
            (0.0, 0.0),
            (-1e-9, 0.0),
            (1e-9, 0.0),
            (-1e-3, 1.0),
            (1.0, 1.0),
            (1.0 - 1e-9, 1.0),
            (1.0 - 1e-3, 0.0),
            (-1.0, 1.0),
            (-1.0 - 1e-9, 1.0),
            (-1.5, 0.0),
            (9007199254740993.0, 0.0),
        ] {
            assert_eq!(odd(x), expected, "{x}");
        }
    }
}
