//! The integer hash of generated shapes, the same on every machine.

/// `lowbias32` (C. Wellons, *Prospecting for hash functions*, 2018).
pub(crate) fn mix(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}
