//! Quilting: Efros and Freeman 2001, section 2.

use super::codes::{Codes, difference, differences};
use whitstone_core::hash::mix;

/// Parameters of a quilt.
#[derive(Debug)]
pub(super) struct Quilt {
    pub(super) size: [usize; 2],
    pub(super) block: usize,
    pub(super) overlap: usize,
    pub(super) tolerance: f64,
    pub(super) seed: u32,
}

impl Quilt {
    /// Number of blocks along an axis.
    fn count(&self, axis: usize) -> usize {
        1 + self.size[axis]
            .saturating_sub(self.block)
            .div_ceil(self.block - self.overlap)
    }

    /// Size in texels of all blocks along an axis.
    fn extent(&self, axis: usize) -> usize {
        self.block + (self.count(axis) - 1) * (self.block - self.overlap)
    }

    /// Upper bound of channel comparisons.
    pub(super) fn steps(&self, sample: &Codes) -> u64 {
        let places = (sample.width - self.block + 1) as u64 * (sample.height - self.block + 1) as u64;
        let strip = (self.overlap * (2 * self.block - self.overlap)) as u64;
        // At most 2^28 * 2^16 * 2^24: the last product may overflow.
        (3 * strip * places).saturating_mul((self.count(0) * self.count(1)) as u64)
    }

    /// Memory of the canvas and of the image cut from it, in bytes.
    pub(super) fn bytes(&self) -> u64 {
        3 * (self.extent(0) * self.extent(1) + self.size[0] * self.size[1]) as u64
    }

    pub(super) fn make(&self, sample: &Codes) -> Codes {
        let (width, height) = (self.extent(0), self.extent(1));
        let mut canvas = Codes {
            width,
            height,
            data: vec![[0; 3]; width * height],
        };
        for r in 0..self.count(1) {
            for c in 0..self.count(0) {
                self.place(&mut canvas, sample, c, r);
            }
        }
        let [columns, rows] = self.size;
        Codes {
            width: columns,
            height: rows,
            data: (0..rows)
                .flat_map(|j| canvas.row(0, j, columns).to_vec())
                .collect(),
        }
    }

    /// Places a piece at column c and row r of the blocks.
    fn place(&self, canvas: &mut Codes, sample: &Codes, c: usize, r: usize) {
        let step = self.block - self.overlap;
        let corner = [c * step, r * step];
        let (from_left, from_top) = (c > 0, r > 0);
        let [x, y] = self.choose(canvas, sample, corner, [c, r]);
        let error = |i: usize, j: usize| {
            let old = canvas.data[(corner[1] + j) * canvas.width + corner[0] + i];
            difference(old, sample.data[(y + j) * sample.width + x + i])
        };
        let left = from_left.then(|| self.seam(|along, across| error(across, along)));
        let top = from_top.then(|| self.seam(error));
        for j in 0..self.block {
            for i in 0..self.block {
                let inside = left.as_ref().is_none_or(|seam| i >= seam[j])
                    && top.as_ref().is_none_or(|seam| j >= seam[i]);
                if inside {
                    let at = (corner[1] + j) * canvas.width + corner[0] + i;
                    canvas.data[at] = sample.data[(y + j) * sample.width + x + i];
                }
            }
        }
    }

    /// Chooses a piece of the sample and returns its top left corner.
    fn choose(&self, canvas: &Codes, sample: &Codes, corner: [usize; 2], [c, r]: [usize; 2]) -> [usize; 2] {
        let columns = sample.width - self.block + 1;
        let rows = sample.height - self.block + 1;
        let mut errors = Vec::with_capacity(columns * rows);
        for y in 0..rows {
            for x in 0..columns {
                let mut sum = 0;
                for j in 0..self.block {
                    let length = match (r > 0 && j < self.overlap, c > 0) {
                        (true, _) => self.block,
                        (false, true) => self.overlap,
                        (false, false) => break,
                    };
                    let old = canvas.row(corner[0], corner[1] + j, length);
                    sum += u64::from(differences(old, sample.row(x, y + j, length)));
                }
                errors.push(sum);
            }
        }
        // The least nonzero error. An exact match, where the sample continues in the same way,
        // would be the only candidate.
        let least = errors.iter().copied().filter(|e| *e > 0).min().unwrap_or(0);
        let most = least as f64 * (1.0 + self.tolerance);
        let fits = |e: &u64| *e as f64 <= most;
        let count = errors.iter().filter(|e| fits(e)).count();
        let hash = mix(mix(mix(self.seed).wrapping_add(r as u32)).wrapping_add(c as u32));
        let chosen = hash as usize % count;
        let at = (0..errors.len())
            .filter(|at| fits(&errors[*at]))
            .nth(chosen)
            .expect("one of those that were counted");
        [at % columns, at / columns]
    }

    /// The seam with the least sum of differences: for each step along a strip, the first texel
    /// across it that belongs to the new piece.
    fn seam(&self, error: impl Fn(usize, usize) -> u32) -> Vec<usize> {
        // The least sum up to each texel, by dynamic programming.
        let mut sums: Vec<Vec<u32>> = Vec::with_capacity(self.block);
        let around = |across: usize| across.saturating_sub(1)..(across + 2).min(self.overlap);
        for along in 0..self.block {
            let row = (0..self.overlap)
                .map(|across| {
                    let before = sums.last().map_or(0, |sums| {
                        sums[around(across)]
                            .iter()
                            .copied()
                            .min()
                            .expect("at least itself")
                    });
                    before + error(along, across)
                })
                .collect();
            sums.push(row);
        }
        // `min_by_key` returns the first minimum.
        let lowest = |sums: &[u32], among: std::ops::Range<usize>| {
            among.min_by_key(|across| sums[*across]).expect("at least one")
        };
        let mut seam = vec![0; self.block];
        let mut among = 0..self.overlap;
        for along in (0..self.block).rev() {
            seam[along] = lowest(&sums[along], among);
            among = around(seam[along]);
        }
        seam
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::tests::noise;
    use super::*;

    pub(in super::super) fn quilt(seed: u32) -> Quilt {
        Quilt {
            size: [41, 30],
            block: 8,
            overlap: 3,
            tolerance: 0.2,
            seed,
        }
    }

    #[test]
    fn every_texel_is_one_of_the_sample_and_seeds_differ() {
        let from = noise(20, 17);
        let made = [0, 1].map(|seed| quilt(seed).make(&from));
        assert_eq!((made[0].width, made[0].height), (41, 30));
        assert!(made[0] != made[1]);
        assert_eq!(made[0], quilt(0).make(&from));
        assert!(made[0].data.iter().all(|texel| from.data.contains(texel)));
    }

    #[test]
    fn neighbours_agree() {
        // Smooth waves: neighbouring texels differ where pieces do not match.
        let wave = |x: usize, y: usize| {
            (128.0 + 60.0 * (0.7 * x as f64).sin() + 60.0 * (0.5 * y as f64).cos()) as u8
        };
        let from = Codes {
            width: 20,
            height: 20,
            data: (0..400).map(|at| [wave(at % 20, at / 20); 3]).collect(),
        };
        let roughness = |tolerance: f64| -> u32 {
            let made = Quilt {
                tolerance,
                ..quilt(5)
            }
            .make(&from);
            (0..30)
                .map(|j| differences(&made.row(0, j, 41)[1..], made.row(0, j, 40)))
                .sum()
        };
        let (chosen, random) = (roughness(0.0), roughness(1e9));
        assert!(3 * chosen < 2 * random, "{chosen}, at random {random}");
    }

    /// A quilt of small pieces, and a canvas for it with an exact copy of a part of the sample.
    fn small(tolerance: f64, seed: u32) -> (Quilt, Codes, Codes) {
        let quilt = Quilt {
            size: [8, 8],
            block: 5,
            overlap: 2,
            tolerance,
            seed,
        };
        let sample = noise(12, 11);
        let mut canvas = Codes {
            width: 8,
            height: 8,
            data: noise(9, 9).data[3..67].to_vec(),
        };
        for j in 0..5 {
            for i in 0..5 {
                canvas.data[(3 + j) * 8 + 3 + i] = sample.data[(6 + j) * 12 + 7 + i];
            }
        }
        (quilt, sample, canvas)
    }

    #[test]
    fn pieces_are_chosen_among_the_best() {
        for [c, r] in [[0, 0], [1, 0], [0, 1], [1, 1]] {
            for tolerance in [0.0, 0.5] {
                // The errors of all places, texel by texel.
                let (quilt, sample, canvas) = small(tolerance, 0);
                let overlaps = |i: usize, j: usize| (c > 0 && i < 2) || (r > 0 && j < 2);
                let error = |x: usize, y: usize| -> u64 {
                    let texels = (0..25).map(|at| (at % 5, at / 5));
                    let overlap = texels.filter(|&(i, j)| overlaps(i, j));
                    let texel = |(i, j)| {
                        let old = canvas.data[(3 * r + j) * 8 + 3 * c + i];
                        u64::from(difference(old, sample.data[(y + j) * 12 + x + i]))
                    };
                    overlap.map(texel).sum()
                };
                let places = || (0..8 * 7).map(|at| [at % 8, at / 8]);
                let errors = || places().map(|[x, y]| error(x, y));
                let least = errors().filter(|error| *error > 0).min().unwrap_or(0);
                let most = least as f64 * (1.0 + tolerance);
                let best: Vec<_> = places().filter(|[x, y]| error(*x, *y) as f64 <= most).collect();
                let all = if [c, r] == [0, 0] { 56 } else { 1 };
                assert!(best.len() >= all);
                let chosen = (0..2000).map(|seed| {
                    let quilt = Quilt {
                        seed,
                        ..small(tolerance, 0).0
                    };
                    quilt.choose(&canvas, &sample, [3 * c, 3 * r], [c, r])
                });
                let chosen: std::collections::BTreeSet<_> = chosen.collect();
                assert_eq!(
                    chosen,
                    best.into_iter().collect(),
                    "{c}, {r}, {tolerance}: {quilt:?}"
                );
            }
        }
    }

    #[test]
    fn pieces_are_cut_along_their_seams() {
        for [c, r] in [[0, 0], [1, 0], [0, 1], [1, 1]] {
            for seed in 0..20 {
                let (quilt, sample, before) = small(1e9, seed);
                let [x, y] = quilt.choose(&before, &sample, [3 * c, 3 * r], [c, r]);
                let old = |i: usize, j: usize| before.data[(3 * r + j) * 8 + 3 * c + i];
                let new = |i: usize, j: usize| sample.data[(y + j) * 12 + x + i];
                let left = quilt.seam(|j, i| difference(old(i, j), new(i, j)));
                let top = quilt.seam(|i, j| difference(old(i, j), new(i, j)));
                let (_, _, mut after) = small(1e9, seed);
                quilt.place(&mut after, &sample, c, r);
                for at in 0..64 {
                    let (i, j) = (at % 8, at / 8);
                    let is_new = (3 * c..3 * c + 5).contains(&i)
                        && (3 * r..3 * r + 5).contains(&j)
                        && (c == 0 || i - 3 * c >= left[j - 3 * r])
                        && (r == 0 || j - 3 * r >= top[i - 3 * c]);
                    let expected = if is_new {
                        new(i - 3 * c, j - 3 * r)
                    } else {
                        before.data[at]
                    };
                    assert_eq!(after.data[at], expected, "{c}, {r}, seed {seed}: {i}, {j}");
                }
            }
        }
    }

    #[test]
    fn seams_are_the_cheapest_paths() {
        let quilt = Quilt {
            block: 6,
            overlap: 3,
            ..quilt(0)
        };
        for case in 0..50 {
            let error = |along: usize, across: usize| mix(case * 1000 + (along * 3 + across) as u32) % 16;
            let cost = |seam: &[usize]| -> u32 { (0..6).map(|along| error(along, seam[along])).sum() };
            // Exhaustive search over all paths.
            let least = (0..3usize.pow(6))
                .map(|number| (0..6).map(|k| number / 3usize.pow(k) % 3).collect::<Vec<_>>())
                .filter(|seam| seam.windows(2).all(|pair| pair[0].abs_diff(pair[1]) <= 1))
                .map(|seam| cost(&seam))
                .min()
                .unwrap();
            let found = quilt.seam(error);
            assert!(found.windows(2).all(|pair| pair[0].abs_diff(pair[1]) <= 1));
            assert_eq!(cost(&found), least);
        }
    }

    #[test]
    fn steps_are_counted() {
        let huge = Quilt {
            size: [4096, 4096],
            block: 2,
            overlap: 1,
            ..quilt(0)
        };
        assert!(huge.steps(&noise(512, 512)) > 1 << 33);
        // 8 x 6 blocks at a distance of 5 texels.
        let quilt = quilt(0);
        assert_eq!([0, 1].map(|axis| quilt.count(axis)), [8, 6]);
        assert_eq!([0, 1].map(|axis| quilt.extent(axis)), [43, 33]);
        // Channels of the overlap of a block, places in the sample, blocks.
        let overlap = 3 * 16 - 3 * 3;
        assert_eq!(quilt.steps(&noise(20, 17)), 3 * overlap * 13 * 10 * 48);
        assert_eq!(quilt.bytes(), 3 * (43 * 33 + 41 * 30));
    }
}
