//! Sets of pixels.

use rayon::prelude::*;

/// A set of pixels of an image of `width * height`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    width: usize,
    height: usize,
    members: Vec<bool>,
}

impl Mask {
    /// The empty set.
    #[must_use]
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            members: vec![false; width.saturating_mul(height)],
        }
    }

    /// The set of the pixels `(x, y)` for which `member(x, y)` holds.
    #[must_use]
    pub fn from_fn(width: usize, height: usize, mut member: impl FnMut(usize, usize) -> bool) -> Self {
        let members = (0..height)
            .flat_map(|y| (0..width).map(move |x| (x, y)))
            .map(|(x, y)| member(x, y))
            .collect();
        Self {
            width,
            height,
            members,
        }
    }

    /// The set of the pixels whose flags `row(y, flags)` sets, in parallel. They are `false`
    /// before.
    #[must_use]
    pub fn from_rows(width: usize, height: usize, row: impl Fn(usize, &mut [bool]) + Sync) -> Self {
        let mut mask = Self::new(width, height);
        mask.members
            .par_chunks_mut(width.max(1))
            .enumerate()
            .for_each(|(y, flags)| row(y, flags));
        mask
    }

    /// Columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Whether the pixel is in the set; `false` outside the image.
    #[must_use]
    pub fn contains(&self, x: usize, y: usize) -> bool {
        x < self.width && y < self.height && self.members[y * self.width + x]
    }

    /// Adds or removes a pixel. Outside the image this does nothing and returns `false`.
    pub fn set(&mut self, x: usize, y: usize, member: bool) -> bool {
        let inside = x < self.width && y < self.height;
        if inside {
            self.members[y * self.width + x] = member;
        }
        inside
    }

    /// The flags of a row of the image.
    pub(crate) fn row_mut(&mut self, y: usize) -> &mut [bool] {
        &mut self.members[y * self.width..(y + 1) * self.width]
    }

    /// Number of pixels in the set.
    #[must_use]
    pub fn count(&self) -> usize {
        self.members.iter().filter(|&&member| member).count()
    }

    /// The pixels `(x, y)` of the set, row by row from the top.
    pub fn pixels(&self) -> impl Iterator<Item = (usize, usize)> {
        let width = self.width;
        self.members
            .iter()
            .enumerate()
            .filter(|&(_, &member)| member)
            .map(move |(index, _)| (index % width, index / width))
    }

    /// One flag for each pixel, row-major, top row first.
    #[must_use]
    pub fn as_slice(&self) -> &[bool] {
        &self.members
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_of_pixels() {
        let mut mask = Mask::from_fn(4, 3, |x, y| x == 3 && y == 1);
        assert!(mask.contains(3, 1) && !mask.contains(1, 3) && !mask.contains(4, 0));
        assert!(mask.set(0, 2, true));
        assert!(!mask.set(0, 3, true));
        assert_eq!(mask.pixels().collect::<Vec<_>>(), [(3, 1), (0, 2)]);
        assert_eq!(mask.count(), 2);
        assert_eq!(Mask::new(0, 5).pixels().count(), 0);
    }
}
