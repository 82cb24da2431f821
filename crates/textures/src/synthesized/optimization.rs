//! Texture optimisation: Kwatra, Essa, Bobick and Kwatra 2005, section 3.
//!
//! The energy of an image is the sum over its neighbourhoods of the squared error to the nearest
//! piece of the sample. Searching these pieces lowers it. So does setting each texel to the mean of
//! the pieces that cover it: the code nearest to the mean has the least sum of squares. Robust
//! optimisation lowers the sum of the errors to the power of 0.8 instead, by iteratively reweighted
//! least squares. Sides of neighbourhoods, and resolutions, follow each other (section 3.2).

use super::codes::{Codes, differences};
use whitstone_core::simd;

/// The optimisation with all neighbourhoods, at all resolutions.
#[derive(Debug)]
pub(super) struct Optimization {
    /// Sides of the neighbourhoods in texels, in this order at each resolution.
    pub(super) sides: Vec<usize>,
    /// The coarsest first; each has half the texels along a side of the next.
    pub(super) resolutions: u32,
    /// For each side at each resolution.
    pub(super) iterations: u32,
    /// Whether weights make neighbourhoods that match badly count less.
    pub(super) robust: bool,
}

impl Optimization {
    /// What is done at a resolution (0 is the finest), in order: with the sides that fit.
    fn stages(&self, resolution: u32, sample: &Codes, size: [usize; 2]) -> impl Iterator<Item = Stage> {
        let most = smallest(sample, size) >> resolution;
        let fit = self.sides.iter().filter(move |side| **side <= most);
        fit.map(|side| Stage {
            side: *side,
            iterations: self.iterations,
            robust: self.robust,
        })
    }

    /// Upper bound of channel comparisons.
    pub(super) fn steps(&self, sample: &Codes, size: [usize; 2]) -> u64 {
        let at = |resolution: u32| {
            let coarse = [sample.width >> resolution, sample.height >> resolution];
            let stages = self.stages(resolution, sample, size);
            stages
                .map(|stage| stage.steps(coarse, size.map(|n| n >> resolution)))
                .fold(0, u64::saturating_add)
        };
        (0..self.resolutions).map(at).fold(0, u64::saturating_add)
    }

    /// Memory of sums, positions and coarser images, in bytes.
    pub(super) fn bytes(&self, sample: &Codes, size: [usize; 2]) -> u64 {
        let stages = self.stages(0, sample, size);
        let most = stages.map(|stage| stage.bytes(size)).max().unwrap_or(0);
        // A copy of the sample with three bytes a texel; all coarser images together have a third
        // of the texels.
        most + (4 * sample.data.len() + size[0] * size[1]) as u64
    }

    /// Runs all iterations.
    pub(super) fn improve(&self, picture: &mut Codes, sample: &Codes) {
        let size = [picture.width, picture.height];
        let mut samples = vec![sample.clone()];
        for _ in 1..self.resolutions {
            samples.extend(samples.last().map(Codes::halved));
            *picture = picture.halved();
        }
        for (resolution, coarse) in samples.iter().enumerate().rev() {
            let now = size.map(|n| n >> resolution);
            if [picture.width, picture.height] != now {
                *picture = picture.doubled(now);
            }
            for stage in self.stages(resolution as u32, sample, size) {
                stage.improve(picture, coarse);
            }
        }
    }
}

/// The smallest side of sample and image.
pub(super) fn smallest(sample: &Codes, size: [usize; 2]) -> usize {
    sample.width.min(sample.height).min(size[0]).min(size[1])
}

/// The weight of a neighbourhood with this error: its power -0.6 as an integer, so that it
/// is the same on every machine.
fn weight(error: u64) -> u64 {
    let cube = u128::from(error).pow(3);
    // Errors are below 2^34: rounding is off by one at most.
    let mut root = libm::pow(error as f64, 0.6) as u128;
    while root.pow(5) > cube {
        root -= 1;
    }
    while (root + 1).pow(5) <= cube {
        root += 1;
    }
    (1 << 32) / root.max(1) as u64
}

/// The optimisation with one side of neighbourhoods at one resolution.
#[derive(Clone, Copy, Debug)]
struct Stage {
    side: usize,
    iterations: u32,
    robust: bool,
}

impl Stage {
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
    fn steps(&self, sample: [usize; 2], [width, height]: [usize; 2]) -> u64 {
        let [columns, rows] = sample.map(|n| (n - self.side + 1) as u64);
        let places = columns * rows;
        let squares = (self.starts(width).count() * self.starts(height).count()) as u64;
        let each = 3 * (self.side * self.side) as u64;
        // At most 2^18 * 2^28, times 2^24 * 2^6: the last product may overflow.
        (each * places).saturating_mul(squares * u64::from(self.iterations))
    }

    /// Memory of sums and positions, in bytes.
    fn bytes(&self, [width, height]: [usize; 2]) -> u64 {
        let texels = (width * height * size_of::<Sum>()) as u64;
        let squares = (self.starts(width).count() * self.starts(height).count()) as u64;
        texels + 2 * squares * size_of::<(u64, usize)>() as u64
    }

    /// Runs all iterations; stops early once nothing changes.
    fn improve(&self, picture: &mut Codes, sample: &Codes) {
        let mut nearest: Vec<(u64, usize)> = Vec::new();
        for _ in 0..self.iterations {
            let found = self.search(picture, sample, &nearest);
            // Errors change weights.
            let same = |((new, at), (old, before)): (&(u64, usize), &(u64, usize))| {
                at == before && (new == old || !self.robust)
            };
            if found.len() == nearest.len() && found.iter().zip(&nearest).all(same) {
                break;
            }
            self.blend(picture, sample, &found);
            nearest = found;
        }
    }

    /// The nearest piece of the sample for each neighbourhood, with its error; `known` are the
    /// results of the previous iteration, if any.
    fn search(&self, picture: &Codes, sample: &Codes, known: &[(u64, usize)]) -> Vec<(u64, usize)> {
        let find = |(number, square)| {
            let known = known.get(number).map(|(_, place)| *place);
            simd::dispatch(
                #[inline(always)]
                || self.nearest(picture, sample, square, known),
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
    fn blend(&self, picture: &mut Codes, sample: &Codes, nearest: &[(u64, usize)]) {
        let columns = sample.width - self.side + 1;
        let mut sums = vec![Sum::default(); picture.data.len()];
        let squares = self.squares([picture.width, picture.height]);
        for ([x, y], (error, place)) in squares.zip(nearest) {
            let weight = if self.robust { weight(*error) } else { 1 };
            for j in 0..self.side {
                let new = sample.row(place % columns, place / columns + j, self.side);
                let start = (y + j) * picture.width + x;
                for (sum, texel) in sums[start..].iter_mut().zip(new) {
                    sum.add(*texel, weight);
                }
            }
        }
        for (texel, sum) in picture.data.iter_mut().zip(&sums) {
            *texel = sum.mean();
        }
    }
}

/// Weighted sum of the texels that are averaged into one: fewer than a hundred, because sides are
/// at most 7 times as long as the spacing of neighbourhoods.
#[derive(Clone, Copy, Default)]
struct Sum {
    codes: [u64; 3],
    weights: u64,
}

impl Sum {
    fn add(&mut self, texel: [u8; 3], weight: u64) {
        for (sum, code) in self.codes.iter_mut().zip(texel) {
            *sum += weight * u64::from(code);
        }
        self.weights += weight;
    }

    /// The mean of at least one texel.
    fn mean(self) -> [u8; 3] {
        self.codes
            .map(|sum| ((2 * sum + self.weights) / (2 * self.weights)) as u8)
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

    fn stage(side: usize, iterations: u32, robust: bool) -> Stage {
        Stage {
            side,
            iterations,
            robust,
        }
    }

    /// Sums of the errors, and of their power 0.4.
    fn energy(how: Stage, picture: &Codes, sample: &Codes) -> [f64; 2] {
        let squares = how.squares([picture.width, picture.height]);
        squares
            .map(|square| how.nearest(picture, sample, square, None).0 as f64)
            .fold([0.0; 2], |[sum, robust], error| {
                [sum + error, robust + error.powf(0.4)]
            })
    }

    /// Each half of an iteration minimises the energy over its own variables.
    #[test]
    fn the_energy_falls_with_each_iteration_until_it_rests() {
        let sample = noise(22, 19);
        for side in [4, 7, 9, 16] {
            let start = quilted(&sample);
            for robust in [false, true] {
                let energies: Vec<f64> = (0..8)
                    .map(|iterations| {
                        let how = stage(side, iterations, robust);
                        let mut picture = start.clone();
                        how.improve(&mut picture, &sample);
                        energy(how, &picture, &sample)[usize::from(robust)]
                    })
                    .collect();
                assert!(energies[1] < energies[0], "{side}: {energies:?}");
                // Codes are rounded, which is the optimum of the plain energy only.
                let rounding = if robust { 1.001 } else { 1.0 };
                let falls = |a: &f64, b: &f64| *b <= rounding * a;
                assert!(energies.is_sorted_by(falls), "{side}: {energies:?}");
            }
        }
    }

    /// The integers are those of exact powers, rounded down.
    #[test]
    fn weights_are_the_integer_power_of_errors() {
        assert_eq!([0, 1, 2, 3].map(weight), [1 << 32; 4]);
        // 32^3 = 8^5, and 10^15 = (10^9)^(5/3).
        assert_eq!([31, 32, 33].map(weight), [(1 << 32) / 7, 1 << 29, 1 << 29]);
        let largest = 3 * 255 * 255 * 256 * 256;
        for error in [99_999, 100_000, 100_001, 1 << 30, largest - 1, largest] {
            let exact = 2f64.powi(32) * (error as f64).powf(-0.6);
            let found = weight(error) as f64;
            assert!(
                found >= exact - 1.0 && found <= exact * 1.002,
                "{error}: {found} {exact}"
            );
        }
        // Of two pieces that cover a texel, the one with an error of 32 counts 8 times less.
        let mut sum = Sum::default();
        sum.add([8, 0, 255], weight(0));
        sum.add([80, 9, 255], weight(32));
        assert_eq!(sum.mean(), [16, 1, 255]);
    }

    #[test]
    fn comparisons_and_memory_are_counted() {
        let how = Optimization {
            sides: vec![8, 4],
            resolutions: 2,
            iterations: 2,
            robust: false,
        };
        let (sample, size) = (noise(12, 10), [9, 8]);
        // Channels of a square, places in the sample, squares of the image, iterations; at the
        // coarser resolution only the smaller side fits.
        let of = |side: u64, places: u64, squares: u64| 3 * side * side * places * squares * 2;
        let expected = of(8, 5 * 3, 2) + of(4, 9 * 7, 6 * 5) + of(4, 3 * 2, 1);
        assert_eq!(how.steps(&sample, size), expected);
        let sums = 9 * 8 * size_of::<Sum>() as u64;
        let positions = 2 * (6 * 5) * 16;
        assert_eq!(how.bytes(&sample, size), sums + positions + 4 * 12 * 10 + 9 * 8);
    }

    #[test]
    fn resolutions_and_sides_follow_each_other() {
        let sample = noise(22, 19);
        let start = quilted(&sample);
        let how = Optimization {
            sides: vec![9, 5],
            resolutions: 3,
            iterations: 2,
            robust: true,
        };
        let mut found = start.clone();
        how.improve(&mut found, &sample);
        // 22 x 19, 11 x 9 and 5 x 4 texels: of the coarsest, not even 5 x 5 are there.
        let mut expected = start.halved().halved();
        assert_eq!((expected.width, expected.height), (9, 7));
        expected = expected.doubled([18, 14]);
        for (sides, last) in [([9, 5], false), ([9, 5], true)] {
            let sample = if last { sample.clone() } else { sample.halved() };
            if last {
                expected = expected.doubled([37, 29]);
            }
            for side in sides {
                stage(side, 2, true).improve(&mut expected, &sample);
            }
        }
        assert_eq!(found, expected);
        assert!(found != start);
        assert_eq!(
            noise(4, 2).halved().data,
            [0, 2].map(|x| {
                let from = noise(4, 2);
                let all = [from.row(x, 0, 2), from.row(x, 1, 2)].concat();
                [0, 1, 2].map(|c| {
                    let sum: u32 = all.iter().map(|texel| u32::from(texel[c])).sum();
                    (f64::from(sum) / 4.0).round() as u8
                })
            })
        );
    }

    #[test]
    fn without_iterations_it_is_the_quilt_and_the_sample_is_left_as_it_is() {
        let sample = noise(22, 19);
        let start = quilted(&sample);
        let mut picture = start.clone();
        let how = |iterations| stage(8, iterations, iterations % 2 == 1);
        how(0).improve(&mut picture, &sample);
        assert_eq!(picture, start);
        how(1).improve(&mut picture, &sample);
        assert!(picture != start);
        let mut same = sample.clone();
        how(5).improve(&mut same, &sample);
        assert_eq!(same, sample);
    }

    /// Ending once nothing changes only saves iterations.
    #[test]
    fn all_iterations_count_until_nothing_changes() {
        let sample = noise(22, 19);
        for (side, robust) in [(9, false), (9, true), (16, false), (16, true)] {
            let how = |iterations| stage(side, iterations, robust);
            let mut expected = quilted(&sample);
            let mut found = Vec::new();
            for iterations in 1..=10 {
                found = how(1).search(&expected, &sample, &found);
                how(1).blend(&mut expected, &sample, &found);
                if matches!(iterations, 3 | 10) {
                    let mut picture = quilted(&sample);
                    how(iterations).improve(&mut picture, &sample);
                    assert!(picture == expected, "{side} {robust} {iterations}");
                }
            }
        }
    }

    /// The same for images of two neighbourhoods, both of which find other pieces in the second
    /// iteration of the last image.
    #[test]
    fn iterations_go_on_while_all_neighbourhoods_change() {
        let sample = noise(22, 19);
        let starts = noise(20, 378);
        for start in starts.data.chunks(20).skip(350) {
            let start = Codes {
                width: 5,
                height: 4,
                data: start.to_vec(),
            };
            let how = |iterations| stage(4, iterations, false);
            let (mut expected, mut found) = (start.clone(), Vec::new());
            for iterations in 1..=5 {
                found = how(1).search(&expected, &sample, &found);
                how(1).blend(&mut expected, &sample, &found);
                let mut picture = start.clone();
                how(iterations).improve(&mut picture, &sample);
                assert!(picture == expected, "{iterations}");
            }
        }
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
        let how = stage(6, 1, false);
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
            let how = stage(side, 1, false);
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
            sum.add(texel, 1);
        }
        // The means of 3/2, 1/4 and 255.
        assert_eq!(sum.mean(), [2, 0, 255]);
    }
}
