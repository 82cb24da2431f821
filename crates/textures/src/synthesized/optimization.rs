//! Texture optimisation: Kwatra, Essa, Bobick and Kwatra 2005, sections 3 and 3.1.
//!
//! The energy of an image is the sum over its neighbourhoods of the squared error to the nearest
//! piece of the sample. Searching these pieces lowers it. So does setting each texel to the mean of
//! the pieces that cover it: the code nearest to the mean has the least sum of squares.

use super::codes::{Codes, differences};
use whitstone_core::simd;

/// Parameters of the optimisation.
#[derive(Debug)]
pub(super) struct Optimization {
    /// Side of the square neighbourhoods, in texels.
    pub(super) side: usize,
    pub(super) iterations: u32,
}

impl Optimization {
    /// Start positions of neighbourhoods along an axis of `length` texels: a quarter of a side
    /// apart, the last one at the end.
    fn starts(&self, length: usize) -> impl Iterator<Item = usize> + Clone {
        let last = length - self.side;
        (0..last).step_by((self.side / 4).max(1)).chain([last])
    }

    /// Top left texels of all neighbourhoods.
    fn squares(&self, [width, height]: [usize; 2]) -> impl Iterator<Item = [usize; 2]> {
        let columns = self.starts(width);
        self.starts(height)
            .flat_map(move |y| columns.clone().map(move |x| [x, y]))
    }

    /// Upper bound of channel comparisons.
    pub(super) fn steps(&self, sample: &Codes, [width, height]: [usize; 2]) -> u64 {
        let places = (sample.width - self.side + 1) as u64 * (sample.height - self.side + 1) as u64;
        let squares = (self.starts(width).count() * self.starts(height).count()) as u64;
        let each = 3 * (self.side * self.side) as u64;
        // At most 2^18 * 2^28, times 2^24 * 2^6: the last product may overflow.
        (each * places).saturating_mul(squares * u64::from(self.iterations))
    }

    /// Memory of sums, counts and positions, in bytes.
    pub(super) fn bytes(&self, [width, height]: [usize; 2]) -> u64 {
        let texels = (width * height * size_of::<Sum>()) as u64;
        let squares = (self.starts(width).count() * self.starts(height).count()) as u64;
        texels + 2 * squares * size_of::<usize>() as u64
    }

    /// Runs all iterations; stops early once nothing changes.
    pub(super) fn improve(&self, picture: &mut Codes, sample: &Codes) {
        let mut nearest = Vec::new();
        for _ in 0..self.iterations {
            let found = self.search(picture, sample, &nearest);
            if found == nearest {
                break;
            }
            self.blend(picture, sample, &found);
            nearest = found;
        }
    }

    /// The nearest piece of the sample for each neighbourhood; `known` are the results of the
    /// previous iteration, if any.
    fn search(&self, picture: &Codes, sample: &Codes, known: &[usize]) -> Vec<usize> {
        let find = |(number, square)| {
            let known = known.get(number).copied();
            simd::dispatch(
                #[inline(always)]
                || self.nearest(picture, sample, square, known).1,
            )
        };
        self.squares([picture.width, picture.height])
            .enumerate()
            .map(find)
            .collect()
    }

    /// The least error, and the first piece that has it.
    #[inline(always)]
    fn nearest(
        &self,
        picture: &Codes,
        sample: &Codes,
        square: [usize; 2],
        known: Option<usize>,
    ) -> (u64, usize) {
        let [columns, rows] = [sample.width, sample.height].map(|side| side - self.side + 1);
        // Stops once the error is known to exceed `most`.
        let error = |place: usize, most: u64| {
            let mut sum = 0;
            for j in 0..self.side {
                let old = picture.row(square[0], square[1] + j, self.side);
                let new = sample.row(place % columns, place / columns + j, self.side);
                sum += u64::from(differences(old, new));
                if sum > most {
                    break;
                }
            }
            sum
        };
        let mut best = known.map_or((u64::MAX, 0), |place| (error(place, u64::MAX), place));
        for place in 0..columns * rows {
            best = best.min((error(place, best.0), place));
        }
        best
    }

    /// Sets each texel to the mean of the pieces of its neighbourhoods, halves rounded up.
    fn blend(&self, picture: &mut Codes, sample: &Codes, nearest: &[usize]) {
        let columns = sample.width - self.side + 1;
        let mut sums = vec![Sum::default(); picture.data.len()];
        let squares = self.squares([picture.width, picture.height]);
        for ([x, y], place) in squares.zip(nearest) {
            for j in 0..self.side {
                let new = sample.row(place % columns, place / columns + j, self.side);
                let start = (y + j) * picture.width + x;
                for (sum, texel) in sums[start..].iter_mut().zip(new) {
                    sum.add(*texel);
                }
            }
        }
        for (texel, sum) in picture.data.iter_mut().zip(&sums) {
            *texel = sum.mean();
        }
    }
}

/// Sum of the texels that are averaged into one: fewer than a hundred, because sides are at most 7
/// times as long as the spacing of neighbourhoods.
#[derive(Clone, Copy, Default)]
struct Sum {
    codes: [u32; 3],
    count: u32,
}

impl Sum {
    fn add(&mut self, texel: [u8; 3]) {
        for (sum, code) in self.codes.iter_mut().zip(texel) {
            *sum += u32::from(code);
        }
        self.count += 1;
    }

    /// The mean of at least one texel.
    fn mean(self) -> [u8; 3] {
        self.codes
            .map(|sum| ((2 * sum + self.count) / (2 * self.count)) as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::super::quilt::Quilt;
    use super::super::tests::noise;
    use super::*;

    fn quilted(sample: &Codes) -> Codes {
        let quilt = Quilt {
            size: [37, 29],
            block: 8,
            overlap: 3,
            tolerance: 0.3,
            seed: 2,
        };
        quilt.make(sample)
    }

    fn energy(how: &Optimization, picture: &Codes, sample: &Codes) -> u64 {
        let squares = how.squares([picture.width, picture.height]);
        squares
            .map(|square| how.nearest(picture, sample, square, None).0)
            .sum()
    }

    /// Each half of an iteration minimises the energy over its own variables.
    #[test]
    fn the_energy_falls_with_each_iteration_until_it_rests() {
        let sample = noise(22, 19);
        for side in [4, 7, 9, 16] {
            let start = quilted(&sample);
            let energies: Vec<u64> = (0..8)
                .map(|iterations| {
                    let how = Optimization { side, iterations };
                    let mut picture = start.clone();
                    how.improve(&mut picture, &sample);
                    energy(&how, &picture, &sample)
                })
                .collect();
            assert!(energies[1] < energies[0], "{side}: {energies:?}");
            assert!(energies.is_sorted_by(|a, b| a >= b), "{side}: {energies:?}");
        }
    }

    #[test]
    fn without_iterations_it_is_the_quilt_and_the_sample_is_left_as_it_is() {
        let sample = noise(22, 19);
        let start = quilted(&sample);
        let mut picture = start.clone();
        let how = |iterations| Optimization { side: 8, iterations };
        how(0).improve(&mut picture, &sample);
        assert_eq!(picture, start);
        how(1).improve(&mut picture, &sample);
        assert!(picture != start);
        let mut same = sample.clone();
        how(5).improve(&mut same, &sample);
        assert_eq!(same, sample);
    }

    /// Known results and early termination only shorten the search.
    #[test]
    fn the_nearest_piece_is_the_first_of_those_with_the_least_error() {
        // Every piece occurs several times.
        let tile = noise(5, 5);
        let sample = Codes {
            width: 15,
            height: 15,
            data: (0..225).map(|at| tile.data[at / 15 % 5 * 5 + at % 5]).collect(),
        };
        let picture = quilted(&noise(22, 19));
        let how = Optimization {
            side: 6,
            iterations: 1,
        };
        for square in how.squares([37, 29]) {
            let whole = |place: usize| -> u64 {
                let row = |j: usize| {
                    let old = picture.row(square[0], square[1] + j, 6);
                    u64::from(differences(old, sample.row(place % 10, place / 10 + j, 6)))
                };
                (0..6).map(row).sum()
            };
            let expected = (0..100).map(|place| (whole(place), place)).min().unwrap();
            for known in [None, Some(0), Some(expected.1), Some(expected.1 + 5), Some(99)] {
                assert_eq!(how.nearest(&picture, &sample, square, known), expected);
            }
        }
    }

    #[test]
    fn neighbourhoods_cover_everything_and_means_are_rounded() {
        for side in 4..20 {
            let how = Optimization { side, iterations: 1 };
            for length in side..60 {
                let mut covered = vec![0; length];
                for start in how.starts(length) {
                    covered[start..start + side].iter_mut().for_each(|n| *n += 1);
                }
                assert!(covered.iter().all(|n| (1..=9).contains(n)), "{side} of {length}");
            }
        }
        let mut sum = Sum::default();
        for texel in [[1, 0, 255], [2, 0, 255], [2, 1, 255], [1, 0, 255]] {
            sum.add(texel);
        }
        // The means of 3/2, 1/4 and 255.
        assert_eq!(sum.mean(), [2, 0, 255]);
    }
}
