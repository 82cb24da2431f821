//! The integer hash of all procedural content, identical in every renderer (section 9 of the
//! model).

/// `lowbias32` (C. Wellons, *Prospecting for hash functions*, 2018): flipping one input bit flips
/// about half of the output bits.
#[inline(always)]
pub const fn mix(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}
