//! Cell numbers of patterns that repeat in space.

/// Shift of all cell borders, in cells. A surface exactly on a border then shows one colour;
/// without the shift, rounding errors would choose.
pub(crate) const SHIFT: f64 = 1.0 / 4096.0;

/// The number of the cell that contains a coordinate.
#[inline(always)]
pub(crate) fn cell(x: f64) -> f64 {
    (x + SHIFT).floor()
}

/// 1 in cells with odd numbers, else 0; NaN if the cell is NaN.
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
