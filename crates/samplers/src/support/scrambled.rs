//! Sobol' points with Owen scrambling.
//!
//! The first two dimensions of the sequence of Sobol' 1967 (van der Corput's, and that of x + 1,
//! whose matrix is Pascal's triangle modulo 2); Owen 1995, *Randomly permuted (t,m,s)-nets and
//! (t,s)-sequences*; Burley 2020, *Practical hash-based Owen scrambling*, Journal of Computer
//! Graphics Techniques 9(4), listing 2, with the permutation of Laine and Karras. No library is
//! used: the model must specify the exact points, and libraries use their own hashes.

use crate::hash_of_pixel;
use whitstone_core::DVec2;
use whitstone_core::hash::mix;

/// Point `index` of a pixel, in `[0, 1)²`.
pub(crate) fn position(seed: u32, pixel: [u32; 2], index: u32) -> DVec2 {
    let h = hash_of_pixel(seed, pixel);
    let place = |reversed: u32, dimension: u32| {
        let bits = permute(reversed, mix(h.wrapping_add(dimension))).reverse_bits();
        f64::from(bits) / 4_294_967_296.0
    };
    DVec2::new(place(index, 1), place(second(index), 2))
}

/// The second dimension with its bits reversed, as the permutation expects. For the first
/// dimension, that is the index itself.
pub(crate) fn second(index: u32) -> u32 {
    let mut direction = 1_u32;
    let mut sum = 0;
    for bit in 0..32 {
        if index >> bit & 1 == 1 {
            sum ^= direction;
        }
        direction ^= direction << 1;
    }
    sum
}

/// Laine and Karras's permutation: flips each bit by a hash of the bits below it.
fn permute(x: u32, seed: u32) -> u32 {
    const FACTORS: [u32; 4] = [0x6c50_b47c, 0xb82f_1e52, 0xc7af_e638, 0x8d22_f6e6];
    FACTORS
        .iter()
        .fold(x.wrapping_add(seed), |x, factor| x ^ x.wrapping_mul(*factor))
}
