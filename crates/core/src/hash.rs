//! One hash of integers, for whatever is generated: the same in every renderer, as section 9 of the
//! model states it.

/// `lowbias32` (C. Wellons, *Prospecting for hash functions*, 2018): changes about half of all bits
/// for each bit that differs.
#[inline(always)]
pub const fn mix(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}
