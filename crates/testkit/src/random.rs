//! Pseudo-random numbers, the same in every run.

use whitstone_core::DVec3;

/// SplitMix64 (Steele, Lea, Flood, OOPSLA 2014): good enough to aim rays.
pub struct Random {
    state: u64,
    first: std::vec::IntoIter<u64>,
}

impl Random {
    /// Equal seeds give equal sequences.
    pub fn new(seed: u64) -> Self {
        Self::beginning_with(Vec::new(), seed)
    }

    /// First these bits, then those of [`Self::new`]: a search varies them one by one.
    pub fn beginning_with(first: Vec<u64>, seed: u64) -> Self {
        Self {
            state: seed,
            first: first.into_iter(),
        }
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        if let Some(bits) = self.first.next() {
            return bits;
        }
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// In [-1, 1).
    pub fn signed(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    /// Below `count`, which is not 0.
    pub fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }

    /// In the cube [-1, 1)³.
    pub fn cube(&mut self) -> DVec3 {
        DVec3::new(self.signed(), self.signed(), self.signed())
    }

    /// A unit vector, uniform over the sphere.
    pub fn direction(&mut self) -> DVec3 {
        loop {
            let v = self.cube();
            if (1e-4..=1.0).contains(&v.length_squared()) {
                return v.normalize();
            }
        }
    }
}
