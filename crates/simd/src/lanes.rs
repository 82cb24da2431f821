#![allow(
    unsafe_code,
    reason = "intrinsics are called from functions that are inlined where the processor has them"
)]

use crate::Level;

/// Prefetches data that will be read soon into the cache.
#[inline(always)]
pub fn prefetch<T>(soon: &[T]) {
    #[cfg(target_arch = "x86_64")]
    for line in 0..size_of_val(soon).div_ceil(64) {
        let start = soon.as_ptr().cast::<i8>().wrapping_add(64 * line);
        // SAFETY: a prefetch has no observable effect and accepts any address.
        unsafe { std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T0 }>(start) }
    }
}

/// Arithmetic on `N` single-precision numbers at once.
///
/// An implementation is a token: holding one proves that the processor supports its instructions.
/// Code generic over it is a [`Kernel`]; every function in between must be `#[inline(always)]`.
///
/// Implementations may round differently ([`Lanes::mul_add`]), so use them only to compute bounds.
pub trait Lanes<const N: usize>: Copy {
    /// A vector of `N` numbers.
    type Floats: Copy;

    /// `x` in every lane.
    fn splat(self, x: f32) -> Self::Floats;
    /// Loads from memory.
    fn load(self, from: &[f32; N]) -> Self::Floats;
    /// Stores to memory.
    fn store(self, x: Self::Floats) -> [f32; N];
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
    /// The absolute value.
    fn abs(self, x: Self::Floats) -> Self::Floats;
    /// A mask: bit i is set if `a[i] <= b[i]`; clear if either is NaN.
    fn at_most(self, a: Self::Floats, b: Self::Floats) -> u32;
    /// The minimum of all lanes; unspecified if one is NaN.
    fn smallest(self, x: Self::Floats) -> f32;
    /// The maximum of all lanes; unspecified if one is NaN.
    fn largest(self, x: Self::Floats) -> f32;
}

/// The vector units of a processor: eight lanes and sixteen lanes.
pub trait Machine: Lanes<8> {
    /// Sixteen lanes.
    type Wide: Lanes<16>;

    /// The token for sixteen lanes.
    fn wide(self) -> Self::Wide;
}

/// A computation that is generic over the vector units.
pub trait Kernel {
    /// Its result.
    type Output;

    /// Runs it. Mark this `#[inline(always)]`.
    fn run<M: Machine>(self, machine: M) -> Self::Output;
}

/// Runs a kernel with the best vector units of this processor, up to `limit`.
#[inline(always)]
pub fn with_lanes<K: Kernel>(limit: Level, kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    match limit.min(Level::current()) {
        Level::Baseline => {}
        // SAFETY: the processor supports `Level::current` and all levels below.
        Level::Avx2 => return unsafe { x86::avx2(kernel) },
        // SAFETY: as above.
        Level::Avx512 => return unsafe { x86::avx512(kernel) },
    }
    portable(kernel)
}

/// Never inlined: otherwise the caller would reserve its stack space even if it is not called.
#[inline(never)]
fn portable<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Portable)
}

/// Arrays of numbers, for processors without wider registers.
#[derive(Clone, Copy, Debug)]
pub struct Portable;

/// Loops, not closures, here and below: in large kernels closures are not inlined, and each number
/// would take a call.
macro_rules! each {
    (|$($x:ident),+| $value:expr) => {{
        let mut values = [0.0; N];
        for (i, value) in values.iter_mut().enumerate() {
            $(let $x = $x[i];)+
            *value = $value;
        }
        values
    }};
}

/// Reduces all numbers, whose number is a power of two, to one by halving.
macro_rules! halve {
    ($x:expr, |$a:ident, $b:ident| $value:expr) => {{
        let mut x = $x;
        let mut half = N / 2;
        while half > 0 {
            for i in 0..half {
                let ($a, $b) = (x[i], x[i + half]);
                x[i] = $value;
            }
            half /= 2;
        }
        x[0]
    }};
}

impl<const N: usize> Lanes<N> for Portable {
    type Floats = [f32; N];

    #[inline(always)]
    fn splat(self, x: f32) -> [f32; N] {
        [x; N]
    }
    #[inline(always)]
    fn load(self, from: &[f32; N]) -> [f32; N] {
        *from
    }
    #[inline(always)]
    fn store(self, x: [f32; N]) -> [f32; N] {
        x
    }
    #[inline(always)]
    fn add(self, a: [f32; N], b: [f32; N]) -> [f32; N] {
        each!(|a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, a: [f32; N], b: [f32; N]) -> [f32; N] {
        each!(|a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, a: [f32; N], b: [f32; N]) -> [f32; N] {
        each!(|a, b| a * b)
    }
    #[inline(always)]
    fn div(self, a: [f32; N], b: [f32; N]) -> [f32; N] {
        each!(|a, b| a / b)
    }
    #[inline(always)]
    fn mul_add(self, a: [f32; N], b: [f32; N], c: [f32; N]) -> [f32; N] {
        each!(|a, b, c| a * b + c)
    }
    #[inline(always)]
    fn neg_mul_add(self, a: [f32; N], b: [f32; N], c: [f32; N]) -> [f32; N] {
        each!(|a, b, c| c - a * b)
    }
    #[inline(always)]
    fn min(self, a: [f32; N], b: [f32; N]) -> [f32; N] {
        each!(|a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, a: [f32; N], b: [f32; N]) -> [f32; N] {
        each!(|a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn abs(self, x: [f32; N]) -> [f32; N] {
        each!(|x| x.abs())
    }
    #[inline(always)]
    fn at_most(self, a: [f32; N], b: [f32; N]) -> u32 {
        let mut mask = 0;
        for (i, (a, b)) in a.iter().zip(&b).enumerate() {
            mask |= u32::from(a <= b) << i;
        }
        mask
    }
    #[inline(always)]
    fn smallest(self, x: [f32; N]) -> f32 {
        halve!(x, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn largest(self, x: [f32; N]) -> f32 {
        halve!(x, |a, b| if a > b { a } else { b })
    }
}

impl Machine for Portable {
    type Wide = Self;

    #[inline(always)]
    fn wide(self) -> Self {
        self
    }
}

#[cfg(target_arch = "x86_64")]
pub(crate) mod x86 {
    use super::{Kernel, Lanes, Machine};
    use std::arch::x86_64::*;

    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    pub(super) fn avx2<K: Kernel>(kernel: K) -> K::Output {
        kernel.run(Avx2(()))
    }

    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    pub(super) fn avx512<K: Kernel>(kernel: K) -> K::Output {
        kernel.run(Avx512::new())
    }

    /// Constructed only by `avx2` above.
    #[derive(Clone, Copy)]
    pub(super) struct Avx2(());

    /// Constructed only where the processor supports AVX-512.
    #[derive(Clone, Copy)]
    pub(crate) struct Avx512(());

    impl Avx512 {
        #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
        #[inline]
        pub(crate) fn new() -> Self {
            Self(())
        }
    }

    macro_rules! operations {
        ($($name:ident($($x:ident: $type:ty),+) -> $result:ty = $value:expr;)+) => {
            $(
                #[inline(always)]
                fn $name(self, $($x: $type),+) -> $result {
                    // SAFETY: this token exists only if the processor supports AVX2 and FMA, or
                    // AVX-512. Loads and stores access a reference of the same size and need no
                    // alignment.
                    unsafe { $value }
                }
            )+
        };
    }
    pub(crate) use operations;

    /// Reduces four numbers to one in two halving steps.
    macro_rules! reduce {
        ($x:expr, $choose:ident) => {{
            let x = $x;
            let x = $choose(x, _mm_permute_ps::<0b01_00_11_10>(x));
            _mm_cvtss_f32($choose(x, _mm_permute_ps::<0b10_11_00_01>(x)))
        }};
    }

    macro_rules! halves {
        ($x:expr, $choose:ident) => {
            $choose(_mm256_castps256_ps128($x), _mm256_extractf128_ps::<1>($x))
        };
    }

    /// For eight numbers AVX-512 adds nothing here; the compiler uses its masks and registers where
    /// they help.
    macro_rules! eight {
        ($token:ident) => {
            impl Lanes<8> for $token {
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
                    smallest(x: __m256) -> f32 = reduce!(halves!(x, _mm_min_ps), _mm_min_ps);
                    largest(x: __m256) -> f32 = reduce!(halves!(x, _mm_max_ps), _mm_max_ps);
                }
            }
        };
    }

    eight!(Avx2);
    eight!(Avx512);

    impl Machine for Avx2 {
        type Wide = Twice<Self>;

        #[inline(always)]
        fn wide(self) -> Twice<Self> {
            Twice(self)
        }
    }

    impl Machine for Avx512 {
        type Wide = Self;

        #[inline(always)]
        fn wide(self) -> Self {
            self
        }
    }

    /// Sixteen numbers as two halves of eight.
    #[derive(Clone, Copy)]
    pub(super) struct Twice<T>(T);

    macro_rules! twice {
        ($($name:ident($($x:ident),+);)+) => {
            $(
                #[inline(always)]
                fn $name(self, $($x: Self::Floats),+) -> Self::Floats {
                    [self.0.$name($($x[0]),+), self.0.$name($($x[1]),+)]
                }
            )+
        };
    }

    impl<T: Lanes<8>> Lanes<16> for Twice<T> {
        type Floats = [T::Floats; 2];

        #[inline(always)]
        fn splat(self, x: f32) -> Self::Floats {
            [self.0.splat(x); 2]
        }
        #[inline(always)]
        fn load(self, from: &[f32; 16]) -> Self::Floats {
            let (halves, _) = from.as_chunks::<8>();
            [self.0.load(&halves[0]), self.0.load(&halves[1])]
        }
        #[inline(always)]
        fn store(self, x: Self::Floats) -> [f32; 16] {
            let (a, b) = (self.0.store(x[0]), self.0.store(x[1]));
            std::array::from_fn(|i| if i < 8 { a[i] } else { b[i - 8] })
        }
        twice! {
            add(a, b);
            sub(a, b);
            mul(a, b);
            div(a, b);
            mul_add(a, b, c);
            neg_mul_add(a, b, c);
            min(a, b);
            max(a, b);
            abs(a);
        }
        #[inline(always)]
        fn at_most(self, a: Self::Floats, b: Self::Floats) -> u32 {
            self.0.at_most(a[0], b[0]) | self.0.at_most(a[1], b[1]) << 8
        }
        #[inline(always)]
        fn smallest(self, x: Self::Floats) -> f32 {
            self.0.smallest(self.0.min(x[0], x[1]))
        }
        #[inline(always)]
        fn largest(self, x: Self::Floats) -> f32 {
            self.0.largest(self.0.max(x[0], x[1]))
        }
    }

    impl Lanes<16> for Avx512 {
        type Floats = __m512;

        operations! {
            splat(x: f32) -> __m512 = _mm512_set1_ps(x);
            load(from: &[f32; 16]) -> __m512 = _mm512_loadu_ps(from.as_ptr());
            store(x: __m512) -> [f32; 16] = std::mem::transmute::<__m512, [f32; 16]>(x);
            add(a: __m512, b: __m512) -> __m512 = _mm512_add_ps(a, b);
            sub(a: __m512, b: __m512) -> __m512 = _mm512_sub_ps(a, b);
            mul(a: __m512, b: __m512) -> __m512 = _mm512_mul_ps(a, b);
            div(a: __m512, b: __m512) -> __m512 = _mm512_div_ps(a, b);
            mul_add(a: __m512, b: __m512, c: __m512) -> __m512 = _mm512_fmadd_ps(a, b, c);
            neg_mul_add(a: __m512, b: __m512, c: __m512) -> __m512 = _mm512_fnmadd_ps(a, b, c);
            min(a: __m512, b: __m512) -> __m512 = _mm512_min_ps(a, b);
            max(a: __m512, b: __m512) -> __m512 = _mm512_max_ps(a, b);
            abs(x: __m512) -> __m512 = _mm512_abs_ps(x);
            at_most(a: __m512, b: __m512) -> u32 = u32::from(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b));
            smallest(x: __m512) -> f32 = reduce!(
                halves!(
                    _mm256_min_ps(_mm512_castps512_ps256(x), _mm512_extractf32x8_ps::<1>(x)),
                    _mm_min_ps
                ),
                _mm_min_ps
            );
            largest(x: __m512) -> f32 = reduce!(
                halves!(
                    _mm256_max_ps(_mm512_castps512_ps256(x), _mm512_extractf32x8_ps::<1>(x)),
                    _mm_max_ps
                ),
                _mm_max_ps
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All operations on N numbers: the results, and the masks.
    fn everything<const N: usize, L: Lanes<N>>(l: L, [a, b, c]: [[f32; N]; 3]) -> (Vec<[f32; N]>, u32) {
        let (a, b, c) = (l.load(&a), l.load(&b), l.load(&c));
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
            l.splat(l.smallest(c)),
            l.splat(l.largest(c)),
        ];
        (values.map(|x| l.store(x)).to_vec(), l.at_most(a, b))
    }

    fn bits<const N: usize>((values, mask): (Vec<[f32; N]>, u32)) -> (Vec<u32>, u32) {
        let bits = |x: f32| {
            if x.is_nan() {
                f32::NAN.to_bits()
            } else {
                x.to_bits()
            }
        };
        (values.into_iter().flatten().map(bits).collect(), mask)
    }

    struct Everything([[f32; 8]; 3], [[f32; 16]; 3]);

    impl Kernel for Everything {
        type Output = [(Vec<u32>, u32); 2];

        #[inline(always)]
        fn run<M: Machine>(self, m: M) -> Self::Output {
            [bits(everything(m, self.0)), bits(everything(m.wide(), self.1))]
        }
    }

    #[test]
    fn every_level_computes_the_same_where_nothing_is_rounded() {
        let a = [1.0, -2.0, 3.0, 0.0, f32::INFINITY, 7.0, -0.0, 1.5];
        let b = [2.0, -2.0, 0.5, -0.0, 1.0, f32::NAN, 0.0, -4.0];
        for least in 0..8 {
            let c = std::array::from_fn(|i| ((i + least) % 8) as f32 - 2.0);
            let eight = [a, b, c];
            // The upper half holds another operand, in reverse order.
            let wide = |k: usize| {
                std::array::from_fn(|i| {
                    if i < 8 {
                        eight[k][i]
                    } else {
                        eight[(k + 1) % 2][15 - i]
                    }
                })
            };
            let c_wide = std::array::from_fn(|i| ((i + 2 * least) % 16) as f32 - 5.0);
            let all = || Everything(eight, [wide(0), wide(1), c_wide]);
            let expected = all().run(Portable);
            assert_eq!(expected[0].1, 0b0100_1011);
            assert_eq!(expected[1].1, 0b0111_1011 << 8 | 0b0100_1011);
            for level in [Level::Baseline, Level::Avx2, Level::Avx512] {
                assert_eq!(with_lanes(level, all()), expected, "{level:?}");
            }
        }
    }
}
