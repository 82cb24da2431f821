//! Connected components of a set of pixels: a fault fills an area, noise is scattered.

use crate::mask::Mask;
use serde::Serialize;

/// A connected component of a set of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Area {
    /// Number of its pixels, at least 1.
    pub pixels: usize,
    /// First column and row of its bounding rectangle.
    pub from: [usize; 2],
    /// Last column and row of its bounding rectangle.
    pub to: [usize; 2],
}

/// The largest connected component; `None` for an empty set. Among equal ones, the one with the
/// uppermost and then leftmost pixel. Pixels that share a side or a corner are connected.
#[must_use]
pub fn largest(mask: &Mask) -> Option<Area> {
    let mut rest = mask.clone();
    let mut largest: Option<Area> = None;
    for (x, y) in mask.pixels() {
        if rest.contains(x, y) {
            let area = take(&mut rest, x, y);
            if largest.is_none_or(|largest| area.pixels > largest.pixels) {
                largest = Some(area);
            }
        }
    }
    largest
}

/// Removes the component that contains a pixel from the set.
fn take(rest: &mut Mask, x: usize, y: usize) -> Area {
    let mut area = Area {
        pixels: 0,
        from: [x, y],
        to: [x, y],
    };
    rest.set(x, y, false);
    let mut open = vec![[x, y]];
    while let Some([x, y]) = open.pop() {
        area.pixels += 1;
        area.from = [area.from[0].min(x), area.from[1].min(y)];
        area.to = [area.to[0].max(x), area.to[1].max(y)];
        for near_y in y.saturating_sub(1)..=y + 1 {
            for near_x in x.saturating_sub(1)..=x + 1 {
                if rest.contains(near_x, near_y) {
                    rest.set(near_x, near_y, false);
                    open.push([near_x, near_y]);
                }
            }
        }
    }
    area
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(rows: &[&str]) -> Mask {
        Mask::from_fn(rows[0].len(), rows.len(), |x, y| rows[y].as_bytes()[x] == b'#')
    }

    #[test]
    fn corners_connect_and_the_first_of_equal_areas_is_returned() {
        let found = largest(&mask(&["#..##", ".#.#.", "..#..", "....."])).unwrap();
        assert_eq!(found.pixels, 6, "the diagonal touches the two at the top");
        assert_eq!((found.from, found.to), ([0, 0], [4, 2]));
        let found = largest(&mask(&["##...", ".....", "...##"])).unwrap();
        assert_eq!((found.pixels, found.from, found.to), (2, [0, 0], [1, 0]));
        assert_eq!(largest(&Mask::new(4, 4)), None);
    }

    #[test]
    fn a_ring_and_its_hole_are_separate_and_a_full_image_is_one_area() {
        let found = largest(&mask(&["#####", "#...#", "#.#.#", "#...#", "#####"])).unwrap();
        assert_eq!(found.pixels, 16);
        let all = Mask::from_fn(1000, 1000, |_, _| true);
        assert_eq!(largest(&all).unwrap().pixels, 1_000_000);
    }
}
