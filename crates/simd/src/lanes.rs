#![allow(
    unsafe_code,
    reason = "intrinsics are called from functions that are inlined where the processor has them"
)]

use crate::Level;

/// Arithmetic on eight `f32` at once.
///
/// An implementation is a token: to hold one is to know that the processor has its instructions. Code
/// that is generic over it is a [`Kernel`]; every function in between must be `#[inline(always)]`.
///
/// What is computed may differ by rounding between implementations ([`Lanes::mul_add`]), so use it where
/// only a bound counts.
pub trait Lanes: Copy {
    /// Eight numbers.
    type Floats: Copy;

    /// Eight times the same number.
    fn splat(self, x: f32) -> Self::Floats;
    /// From memory.
    fn load(self, from: &[f32; 8]) -> Self::Floats;
    /// To memory.
    fn store(self, x: Self::Floats) -> [f32; 8];
    /// `a + b`.
    fn add(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// `a - b`.
    fn sub(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// `a * b`.
    fn mul(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// `a / b`.
    fn div(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// `a * b + c`, rounded once or twice.
    fn mul_add(self, a: Self::Floats, b: Self::Floats, c: Self::Floats) -> Self::Floats;
    /// `c - a * b`, rounded once or twice.
    fn neg_mul_add(self, a: Self::Floats, b: Self::Floats, c: Self::Floats) -> Self::Floats;
    /// The smaller; `b` if either is NaN.
    fn min(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// The larger; `b` if either is NaN.
    fn max(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// Without the sign.
    fn abs(self, x: Self::Floats) -> Self::Floats;
    /// Bit i says whether `a[i] <= b[i]`; not if either is NaN.
    fn at_most(self, a: Self::Floats, b: Self::Floats) -> u32;
    /// Of the lanes named by `mask` (bits) one with the least number, up to the last three bits; any if there are
    /// none. Numbers must be finite.
    fn least(self, x: Self::Floats, mask: u32) -> usize;
    /// The lanes named by the lowest eight bits of `mask` in their order, then anything.
    fn pack(self, x: Self::Floats, mask: u32) -> Self::Floats;
    /// The same for any words.
    fn pack_words(self, x: &[u32; 8], mask: u32) -> [u32; 8];
}

/// A computation on whatever lanes the processor has.
pub trait Kernel {
    /// Its result.
    type Output;

    /// Runs it. Mark this `#[inline(always)]`.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

/// Runs a kernel with the best lanes of this processor, but none better than `limit`.
#[inline(always)]
pub fn with_lanes<K: Kernel>(limit: Level, kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    match limit.min(Level::current()) {
        Level::Baseline => {}
        // SAFETY: the processor has the features of `Level::current` and of the levels below.
        Level::Avx2 => return unsafe { x86::avx2(kernel) },
        // SAFETY: as above.
        Level::Avx512 => return unsafe { x86::avx512(kernel) },
    }
    kernel.run(Portable)
}

/// Eight numbers in an array, for processors without wider registers.
#[derive(Clone, Copy, Debug)]
pub struct Portable;

/// By mask: the places of the bits that are set, in order.
static PACKED: [[u8; 8]; 256] = {
    let mut table = [[0; 8]; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut place, mut count) = (0, 0);
        while place < 8 {
            if mask >> place & 1 != 0 {
                table[mask][count] = place as u8;
                count += 1;
            }
            place += 1;
        }
        mask += 1;
    }
    table
};

macro_rules! each {
    (|$($x:ident),+| $value:expr) => {
        std::array::from_fn(|i| {
            $(let $x = $x[i];)+
            $value
        })
    };
}

impl Lanes for Portable {
    type Floats = [f32; 8];

    #[inline(always)]
    fn splat(self, x: f32) -> [f32; 8] {
        [x; 8]
    }
    #[inline(always)]
    fn load(self, from: &[f32; 8]) -> [f32; 8] {
        *from
    }
    #[inline(always)]
    fn store(self, x: [f32; 8]) -> [f32; 8] {
        x
    }
    #[inline(always)]
    fn add(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        each!(|a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        each!(|a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        each!(|a, b| a * b)
    }
    #[inline(always)]
    fn div(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        each!(|a, b| a / b)
    }
    #[inline(always)]
    fn mul_add(self, a: [f32; 8], b: [f32; 8], c: [f32; 8]) -> [f32; 8] {
        each!(|a, b, c| a * b + c)
    }
    #[inline(always)]
    fn neg_mul_add(self, a: [f32; 8], b: [f32; 8], c: [f32; 8]) -> [f32; 8] {
        each!(|a, b, c| c - a * b)
    }
    #[inline(always)]
    fn min(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        each!(|a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        each!(|a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn abs(self, x: [f32; 8]) -> [f32; 8] {
        each!(|x| x.abs())
    }
    #[inline(always)]
    fn at_most(self, a: [f32; 8], b: [f32; 8]) -> u32 {
        (0..8).fold(0, |mask, i| mask | u32::from(a[i] <= b[i]) << i)
    }
    #[inline(always)]
    fn least(self, x: [f32; 8], mask: u32) -> usize {
        let tagged = |i: usize| f32::from_bits(x[i].to_bits() & !7 | i as u32);
        let named = (0..8).filter(|i| mask >> i & 1 != 0);
        let least = named.map(tagged).fold(f32::MAX, f32::min);
        least.to_bits() as usize % 8
    }
    #[inline(always)]
    fn pack(self, x: [f32; 8], mask: u32) -> [f32; 8] {
        PACKED[mask as usize % 256].map(|place| x[usize::from(place) % 8])
    }
    #[inline(always)]
    fn pack_words(self, x: &[u32; 8], mask: u32) -> [u32; 8] {
        PACKED[mask as usize % 256].map(|place| x[usize::from(place) % 8])
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Kernel, Lanes};
    use std::arch::x86_64::*;

    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    pub(super) fn avx2<K: Kernel>(kernel: K) -> K::Output {
        kernel.run(Avx2(()))
    }

    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    pub(super) fn avx512<K: Kernel>(kernel: K) -> K::Output {
        kernel.run(Avx2(()))
    }

    #[inline]
    #[target_feature(enable = "avx2")]
    fn least(x: __m256, mask: u32) -> usize {
        let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
        let named = _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32(mask as i32), bits), bits);
        let places = _mm256_castsi256_ps(_mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7));
        let tagged = _mm256_or_ps(
            _mm256_andnot_ps(_mm256_castsi256_ps(_mm256_set1_epi32(7)), x),
            places,
        );
        let x = _mm256_blendv_ps(_mm256_set1_ps(f32::MAX), tagged, _mm256_castsi256_ps(named));
        let x = _mm_min_ps(_mm256_castps256_ps128(x), _mm256_extractf128_ps::<1>(x));
        let x = _mm_min_ps(x, _mm_permute_ps::<0b01_00_11_10>(x));
        let x = _mm_min_ps(x, _mm_permute_ps::<0b10_11_00_01>(x));
        _mm_cvtsi128_si32(_mm_castps_si128(x)) as usize % 8
    }

    #[inline]
    #[target_feature(enable = "avx2")]
    fn pack(x: __m256i, mask: u32) -> __m256i {
        let places = u64::from_le_bytes(super::PACKED[mask as usize % 256]);
        let places = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(places as i64));
        _mm256_permutevar8x32_epi32(x, places)
    }

    /// Made in the two functions above only. With AVX-512 the compiler uses its masks and registers.
    #[derive(Clone, Copy)]
    pub(super) struct Avx2(());

    macro_rules! operations {
        ($($name:ident($($x:ident: $type:ty),+) -> $result:ty = $value:expr;)+) => {
            $(
                #[inline(always)]
                fn $name(self, $($x: $type),+) -> $result {
                    // SAFETY: this token is made only where the processor has AVX2 and FMA. Loads and
                    // stores are those of a reference to as many bytes, and need no alignment.
                    unsafe { $value }
                }
            )+
        };
    }

    impl Lanes for Avx2 {
        type Floats = __m256;

        operations! {
            splat(x: f32) -> __m256 = _mm256_set1_ps(x);
            load(from: &[f32; 8]) -> __m256 = _mm256_loadu_ps(from.as_ptr());
            store(x: __m256) -> [f32; 8] = std::mem::transmute::<__m256, [f32; 8]>(x);
            add(a: __m256, b: __m256) -> __m256 = _mm256_add_ps(a, b);
            sub(a: __m256, b: __m256) -> __m256 = _mm256_sub_ps(a, b);
            mul(a: __m256, b: __m256) -> __m256 = _mm256_mul_ps(a, b);
            div(a: __m256, b: __m256) -> __m256 = _mm256_div_ps(a, b);
            mul_add(a: __m256, b: __m256, c: __m256) -> __m256 = _mm256_fmadd_ps(a, b, c);
            neg_mul_add(a: __m256, b: __m256, c: __m256) -> __m256 = _mm256_fnmadd_ps(a, b, c);
            min(a: __m256, b: __m256) -> __m256 = _mm256_min_ps(a, b);
            max(a: __m256, b: __m256) -> __m256 = _mm256_max_ps(a, b);
            abs(x: __m256) -> __m256 = _mm256_andnot_ps(_mm256_set1_ps(-0.0), x);
            at_most(a: __m256, b: __m256) -> u32 =
                _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(a, b)) as u32;
            least(x: __m256, mask: u32) -> usize = least(x, mask);
            pack(x: __m256, mask: u32) -> __m256 = _mm256_castsi256_ps(pack(_mm256_castps_si256(x), mask));
            pack_words(x: &[u32; 8], mask: u32) -> [u32; 8] =
                std::mem::transmute::<__m256i, [u32; 8]>(pack(_mm256_loadu_si256(x.as_ptr().cast()), mask));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Everything([f32; 8], [f32; 8], [f32; 8]);

    impl Kernel for Everything {
        type Output = (Vec<[f32; 8]>, u32);

        #[inline(always)]
        fn run<L: Lanes>(self, l: L) -> Self::Output {
            let (a, b, c) = (l.load(&self.0), l.load(&self.1), l.load(&self.2));
            let values = [
                l.splat(0.5),
                l.add(a, b),
                l.sub(a, b),
                l.mul(a, b),
                l.div(a, b),
                l.mul_add(a, b, c),
                l.neg_mul_add(a, b, c),
                l.min(a, b),
                l.max(a, b),
                l.abs(a),
            ];
            (values.map(|x| l.store(x)).to_vec(), l.at_most(a, b))
        }
    }

    #[test]
    fn every_level_computes_the_same_where_nothing_is_rounded() {
        let a = [1.0, -2.0, 3.0, 0.0, f32::INFINITY, 7.0, -0.0, 1.5];
        let b = [2.0, -2.0, 0.5, -0.0, 1.0, f32::NAN, 0.0, -4.0];
        let c = [0.0, 1.0, -2.0, 3.0, 4.0, 5.0, -6.0, 7.0];
        let bits = |(values, mask): (Vec<[f32; 8]>, u32)| {
            let bits = |x: f32| {
                if x.is_nan() {
                    f32::NAN.to_bits()
                } else {
                    x.to_bits()
                }
            };
            (values.iter().map(|v| v.map(bits)).collect::<Vec<_>>(), mask)
        };
        let expected = bits(Everything(a, b, c).run(Portable));
        for level in [Level::Baseline, Level::Avx2, Level::Avx512] {
            assert_eq!(
                bits(with_lanes(level, Everything(a, b, c))),
                expected,
                "{level:?}"
            );
        }
        assert_eq!(expected.1, 0b0100_1011);
    }

    struct Choice([f32; 8], u32);

    impl Kernel for Choice {
        type Output = (usize, Vec<f32>, Vec<u32>);

        #[inline(always)]
        fn run<L: Lanes>(self, l: L) -> Self::Output {
            let Self(numbers, mask) = self;
            let count = mask.count_ones() as usize;
            let x = l.load(&numbers);
            let words = l.pack_words(&numbers.map(f32::to_bits), mask);
            let packed = l.store(l.pack(x, mask));
            (
                l.least(x, mask),
                packed[..count].to_vec(),
                words[..count].to_vec(),
            )
        }
    }

    #[test]
    fn every_level_finds_the_least_and_packs_in_order() {
        let numbers = [3.0f32, -1.0, 8.0, 0.0, -1.5, 7.0, -0.5, 1e30];
        for mask in 1..256u32 {
            let named: Vec<usize> = (0..8).filter(|i| mask >> i & 1 != 0).collect();
            let least = named
                .iter()
                .copied()
                .min_by(|&a, &b| numbers[a].total_cmp(&numbers[b]));
            let packed: Vec<f32> = named.iter().map(|&i| numbers[i]).collect();
            let words = packed.iter().map(|x| x.to_bits()).collect();
            let expected = (least.unwrap(), packed, words);
            assert_eq!(Choice(numbers, mask).run(Portable), expected);
            for level in [Level::Baseline, Level::Avx2, Level::Avx512] {
                assert_eq!(
                    with_lanes(level, Choice(numbers, mask)),
                    expected,
                    "{level:?} {mask}"
                );
            }
        }
    }
}
