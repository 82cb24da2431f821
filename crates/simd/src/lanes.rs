#![allow(
    unsafe_code,
    reason = "intrinsics are called from functions that are inlined where the processor has them"
)]

use crate::Level;

/// Arithmetic on eight `f32` at once, and some on sixteen.
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

    /// Sixteen numbers.
    type Wide: Copy;

    /// Sixteen times the same number.
    fn splat_wide(self, x: f32) -> Self::Wide;
    /// From memory.
    fn load_wide(self, from: &[f32; 16]) -> Self::Wide;
    /// `a * b + c`, rounded once or twice.
    fn mul_add_wide(self, a: Self::Wide, b: Self::Wide, c: Self::Wide) -> Self::Wide;
    /// The smaller; `b` if either is NaN.
    fn min_wide(self, a: Self::Wide, b: Self::Wide) -> Self::Wide;
    /// The larger; `b` if either is NaN.
    fn max_wide(self, a: Self::Wide, b: Self::Wide) -> Self::Wide;
    /// Bit i says whether `a[i] <= b[i]`; not if either is NaN.
    fn at_most_wide(self, a: Self::Wide, b: Self::Wide) -> u32;
    /// The smallest of all sixteen; if one is NaN, anything.
    fn smallest(self, x: Self::Wide) -> f32;
    /// The largest of all sixteen; if one is NaN, anything.
    fn largest(self, x: Self::Wide) -> f32;
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

    type Wide = [f32; 16];

    #[inline(always)]
    fn splat_wide(self, x: f32) -> [f32; 16] {
        [x; 16]
    }
    #[inline(always)]
    fn load_wide(self, from: &[f32; 16]) -> [f32; 16] {
        *from
    }
    #[inline(always)]
    fn mul_add_wide(self, a: [f32; 16], b: [f32; 16], c: [f32; 16]) -> [f32; 16] {
        each!(|a, b, c| a * b + c)
    }
    #[inline(always)]
    fn min_wide(self, a: [f32; 16], b: [f32; 16]) -> [f32; 16] {
        each!(|a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max_wide(self, a: [f32; 16], b: [f32; 16]) -> [f32; 16] {
        each!(|a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn at_most_wide(self, a: [f32; 16], b: [f32; 16]) -> u32 {
        (0..16).fold(0, |mask, i| mask | u32::from(a[i] <= b[i]) << i)
    }
    #[inline(always)]
    fn smallest(self, x: [f32; 16]) -> f32 {
        x.iter().copied().fold(f32::INFINITY, f32::min)
    }
    #[inline(always)]
    fn largest(self, x: [f32; 16]) -> f32 {
        x.iter().copied().fold(f32::NEG_INFINITY, f32::max)
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
        kernel.run(Avx512(()))
    }

    /// Made in the first function above only.
    #[derive(Clone, Copy)]
    pub(super) struct Avx2(());

    /// Made in the second function above only.
    #[derive(Clone, Copy)]
    pub(super) struct Avx512(());

    macro_rules! operations {
        ($($name:ident($($x:ident: $type:ty),+) -> $result:ty = $value:expr;)+) => {
            $(
                #[inline(always)]
                fn $name(self, $($x: $type),+) -> $result {
                    // SAFETY: this token is made only where the processor has AVX2 and FMA, or AVX-512. Loads
                    // and stores are those of a reference to as many bytes, and need no alignment.
                    unsafe { $value }
                }
            )+
        };
    }

    /// On eight numbers AVX-512 has nothing better; where it helps the compiler uses its masks and registers.
    macro_rules! eight {
        () => {
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
            }
        };
    }

    /// A number of eight by halving three times.
    macro_rules! reduce {
        ($x:expr, $choose:ident) => {{
            let x = $choose(_mm256_castps256_ps128($x), _mm256_extractf128_ps::<1>($x));
            let x = $choose(x, _mm_permute_ps::<0b01_00_11_10>(x));
            _mm_cvtss_f32($choose(x, _mm_permute_ps::<0b10_11_00_01>(x)))
        }};
    }

    impl Lanes for Avx2 {
        eight!();

        type Wide = [__m256; 2];

        operations! {
            splat_wide(x: f32) -> [__m256; 2] = [_mm256_set1_ps(x); 2];
            load_wide(from: &[f32; 16]) -> [__m256; 2] =
                [_mm256_loadu_ps(from.as_ptr()), _mm256_loadu_ps(from[8..].as_ptr())];
            mul_add_wide(a: [__m256; 2], b: [__m256; 2], c: [__m256; 2]) -> [__m256; 2] =
                [_mm256_fmadd_ps(a[0], b[0], c[0]), _mm256_fmadd_ps(a[1], b[1], c[1])];
            min_wide(a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] =
                [_mm256_min_ps(a[0], b[0]), _mm256_min_ps(a[1], b[1])];
            max_wide(a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] =
                [_mm256_max_ps(a[0], b[0]), _mm256_max_ps(a[1], b[1])];
            at_most_wide(a: [__m256; 2], b: [__m256; 2]) -> u32 =
                (_mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(a[0], b[0]))
                    | _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(a[1], b[1])) << 8) as u32;
            smallest(x: [__m256; 2]) -> f32 = reduce!(_mm256_min_ps(x[0], x[1]), _mm_min_ps);
            largest(x: [__m256; 2]) -> f32 = reduce!(_mm256_max_ps(x[0], x[1]), _mm_max_ps);
        }
    }

    impl Lanes for Avx512 {
        eight!();

        type Wide = __m512;

        operations! {
            splat_wide(x: f32) -> __m512 = _mm512_set1_ps(x);
            load_wide(from: &[f32; 16]) -> __m512 = _mm512_loadu_ps(from.as_ptr());
            mul_add_wide(a: __m512, b: __m512, c: __m512) -> __m512 = _mm512_fmadd_ps(a, b, c);
            min_wide(a: __m512, b: __m512) -> __m512 = _mm512_min_ps(a, b);
            max_wide(a: __m512, b: __m512) -> __m512 = _mm512_max_ps(a, b);
            at_most_wide(a: __m512, b: __m512) -> u32 = u32::from(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b));
            smallest(x: __m512) -> f32 =
                reduce!(_mm256_min_ps(_mm512_castps512_ps256(x), _mm512_extractf32x8_ps::<1>(x)), _mm_min_ps);
            largest(x: __m512) -> f32 =
                reduce!(_mm256_max_ps(_mm512_castps512_ps256(x), _mm512_extractf32x8_ps::<1>(x)), _mm_max_ps);
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

    struct Sixteen([f32; 16], [f32; 16]);

    impl Kernel for Sixteen {
        type Output = ([u32; 4], [f32; 4]);

        #[inline(always)]
        fn run<L: Lanes>(self, l: L) -> Self::Output {
            let (a, b) = (l.load_wide(&self.0), l.load_wide(&self.1));
            let fused = l.mul_add_wide(a, b, l.splat_wide(2.0));
            let (min, max) = (l.min_wide(a, b), l.max_wide(a, b));
            let masks = [(a, b), (b, a), (min, b), (fused, max)].map(|(a, b)| l.at_most_wide(a, b));
            (
                masks,
                [
                    l.smallest(min),
                    l.largest(max),
                    l.smallest(fused),
                    l.largest(fused),
                ],
            )
        }
    }

    #[test]
    fn every_level_computes_the_same_on_sixteen() {
        for shift in 0..16 {
            let a = std::array::from_fn(|i| ((i * 7 + shift) % 16) as f32 - 5.0);
            let b = std::array::from_fn(|i| ((i * 5 + 3 * shift) % 16) as f32 - 9.0);
            let expected = Sixteen(a, b).run(Portable);
            assert_eq!(expected.1[..2], [-9.0, 10.0]);
            for level in [Level::Baseline, Level::Avx2, Level::Avx512] {
                assert_eq!(with_lanes(level, Sixteen(a, b)), expected, "{level:?} {shift}");
            }
        }
    }
}
