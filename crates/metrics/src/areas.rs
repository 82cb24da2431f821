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

/// Removes the component that contains a pixel from the set, run by run.
fn take(rest: &mut Mask, x: usize, y: usize) -> Area {
    let mut area = Area {
        pixels: 0,
        from: [x, y],
        to: [x, y],
    };
    let [last_x, last_y] = [rest.width() - 1, rest.height() - 1];
    let mut open = vec![[x, y]];
    while let Some([x, y]) = open.pop() {
        let row = rest.row_mut(y);
        if !row[x] {
            continue;
        }
        let left = row[..x].iter().rposition(|member| !member).map_or(0, |x| x + 1);
        let right = row[x..]
            .iter()
            .position(|member| !member)
            .map_or(last_x, |run| x + run - 1);
        row[left..=right].fill(false);
        area.pixels += right + 1 - left;
        area.from = [area.from[0].min(left), area.from[1].min(y)];
        area.to = [area.to[0].max(right), area.to[1].max(y)];
        // One pixel of each run above and below, corners included.
        let (left, right) = (left.saturating_sub(1), (right + 1).min(last_x));
        for near in [y.checked_sub(1), (y < last_y).then_some(y + 1)]
            .into_iter()
            .flatten()
        {
            let row = rest.row_mut(near);
            let starts = (left..=right).filter(|&x| row[x] && (x == left || !row[x - 1]));
            open.extend(starts.map(|x| [x, near]));
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

    /// Filling by runs finds the same areas as filling by pixels.
    #[test]
    fn areas_are_those_of_single_pixels() {
        let (width, height) = (23, 17);
        for seed in 0..200_usize {
            let member =
                |x: usize, y: usize| (x * 7919 + y * 104_729 + seed * 31 + x * y * (seed + 3)) % 5 < 2;
            let mask = Mask::from_fn(width, height, member);
            let mut rest: Vec<[usize; 2]> = mask.pixels().map(|(x, y)| [x, y]).collect();
            let mut best = 0;
            while let Some(first) = rest.pop() {
                let mut area = vec![first];
                let mut next = 0;
                while next < area.len() {
                    let [x, y] = area[next];
                    next += 1;
                    let (near, far): (Vec<[usize; 2]>, _) =
                        (rest.iter().copied()).partition(|[a, b]| a.abs_diff(x) <= 1 && b.abs_diff(y) <= 1);
                    area.extend(near);
                    rest = far;
                }
                best = best.max(area.len());
            }
            assert_eq!(largest(&mask).map_or(0, |area| area.pixels), best, "{seed}");
        }
    }

    #[test]
    fn a_ring_and_its_hole_are_separate_and_a_full_image_is_one_area() {
        let found = largest(&mask(&["#####", "#...#", "#.#.#", "#...#", "#####"])).unwrap();
        assert_eq!(found.pixels, 16);
        let all = Mask::from_fn(1000, 1000, |_, _| true);
        assert_eq!(largest(&all).unwrap().pixels, 1_000_000);
    }
}
