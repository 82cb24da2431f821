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

/// Single-precision numbers and 32-bit words, `N` at once.
///
/// An implementation is a token: holding one proves that the processor supports its instructions.
/// Code generic over it is a [`Kernel`]; every function in between must be `#[inline(always)]`.
///
/// Implementations may round differently ([`Lanes::mul_add`]), so use them only to compute bounds.
pub trait Lanes<const N: usize>: Copy {
    /// A vector of `N` numbers.
    type Floats: Copy;
    /// A vector of `N` words.
    type Words: Copy;

    /// `x` in every lane.
    fn splat(self, x: f32) -> Self::Floats;
    /// Loads from memory.
    fn load(self, from: &[f32; N]) -> Self::Floats;
    /// Loads from memory.
    fn load_words(self, from: &[u32; N]) -> Self::Words;
    /// Stores to memory.
    fn store(self, x: Self::Floats) -> [f32; N];
    /// `a * b + c`, rounded once or twice.
    fn mul_add(self, a: Self::Floats, b: Self::Floats, c: Self::Floats) -> Self::Floats;
    /// The smaller; `b` if either is NaN.
    fn min(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// The larger; `b` if either is NaN.
    fn max(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// A mask: bit i is set if `a[i] <= b[i]`; clear if either is NaN.
    fn at_most(self, a: Self::Floats, b: Self::Floats) -> u32;
    /// An entry of a list of [`pack_order`]s, for [`Self::permute`].
    fn order(self, packed: &[u32; N], entry: usize) -> Self::Words;
    /// Lane i of the result is lane `order[i]` of `x`.
    fn permute(self, x: Self::Floats, order: Self::Words) -> Self::Floats;
    /// Lane i of the result is lane `order[i]` of `x`.
    fn permute_words(self, x: Self::Words, order: Self::Words) -> Self::Words;
    /// Stores the lanes of `x` and `y` that the mask selects, without gaps, and then unspecified
    /// values.
    fn compress(self, mask: u32, x: Self::Floats, y: Self::Words, to: (&mut [f32; N], &mut [u32; N]));
}

/// Packs an order of `N` lanes (8 or 16) as entry `entry` (below 8) of a list of eight.
pub fn pack_order<const N: usize>(order: [usize; N], packed: &mut [u32; N], entry: usize) {
    // Sixteen lanes take two words. Even lanes are in the first one and odd lanes in the second, so
    // that a vector that repeats the two has each lane's number in the word of that lane.
    let words = N / 8;
    let packed = &mut packed[words * entry..][..words];
    packed.fill(0);
    for (i, lane) in order.into_iter().enumerate() {
        packed[i % words] |= (lane as u32) << (4 * (i / words));
    }
}

/// Double-precision numbers, [`Self::LANES`] at once: all or a part of eight.
///
/// All implementations round alike.
pub trait Doubles: Copy {
    /// Number of lanes; it divides 8.
    const LANES: usize;
    /// A vector of this many numbers.
    type Vector: Copy;

    /// `x` in every lane.
    fn splat(self, x: f64) -> Self::Vector;
    /// Loads part `part` of eight numbers.
    fn load(self, from: &[f64; 8], part: usize) -> Self::Vector;
    /// Loads part `part` of eight single-precision numbers.
    fn widen(self, from: &[f32; 8], part: usize) -> Self::Vector;
    /// `a + b`.
    fn add(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a - b`.
    fn sub(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a * b`.
    fn mul(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a / b`.
    fn div(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a` if `a < b`, else `b`.
    fn min(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a` if `a > b`, else `b`.
    fn max(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// The absolute value.
    fn abs(self, x: Self::Vector) -> Self::Vector;
    /// A mask: bit i is set if `a[i] < b[i]`.
    fn less(self, a: Self::Vector, b: Self::Vector) -> u32;
    /// A mask: bit i is set if `a[i] <= b[i]`.
    fn at_most(self, a: Self::Vector, b: Self::Vector) -> u32;
    /// The number in a lane.
    fn lane(self, x: Self::Vector, lane: usize) -> f64;
}

/// Four double-precision numbers: the coordinates of a point and one more.
///
/// All implementations round alike.
pub trait Quad: Copy {
    /// A vector of four numbers.
    type Vector: Copy;

    /// `x` in every lane.
    fn splat(self, x: f64) -> Self::Vector;
    /// Loads from memory.
    fn load(self, from: [f64; 4]) -> Self::Vector;
    /// Stores to memory.
    fn store(self, x: Self::Vector) -> [f64; 4];
    /// Stores to memory in single precision.
    fn store_rounded(self, x: Self::Vector) -> [f32; 4];
    /// `a + b`.
    fn add(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a - b`.
    fn sub(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a * b`.
    fn mul(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a / b`.
    fn div(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a` if `a > b`, else `b`.
    fn max(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// The absolute value.
    fn abs(self, x: Self::Vector) -> Self::Vector;
    /// The absolute value of `x` with the sign of `y`.
    fn copy_sign(self, x: Self::Vector, y: Self::Vector) -> Self::Vector;
    /// A mask: bit i is set if `a[i] == b[i]`.
    fn equal(self, a: Self::Vector, b: Self::Vector) -> u32;
    /// A mask: bit i is set if the sign of `x[i]` is negative.
    fn signs(self, x: Self::Vector) -> u32;
    /// Lane i of the result is lane `order[i]` of `x`.
    fn permute(self, x: Self::Vector, order: &QuadOrder) -> Self::Vector;
}

/// An order of the lanes of a [`Quad`].
#[derive(Clone, Copy, Debug)]
pub struct QuadOrder([u32; 8]);

impl QuadOrder {
    /// The order of these lanes.
    pub const fn new(lanes: [usize; 4]) -> Self {
        // Both halves of each number.
        let mut halves = [0; 8];
        let mut i = 0;
        while i < 8 {
            halves[i] = (2 * lanes[i / 2] + i % 2) as u32;
            i += 1;
        }
        Self(halves)
    }
}

/// The vector units of a processor.
pub trait Machine<const N: usize>: Lanes<N> {
    /// Double precision.
    type Doubles: Doubles;
    /// Double precision, four at a time.
    type Quad: Quad;

    /// The token for double precision.
    fn doubles(self) -> Self::Doubles;
    /// The token for four at a time.
    fn quad(self) -> Self::Quad;
}

/// A computation that is generic over the vector units.
pub trait Kernel<const N: usize> {
    /// Its result.
    type Output;

    /// Runs it. Mark this `#[inline(always)]`.
    fn run<M: Machine<N>>(self, machine: M) -> Self::Output;
}

/// Runs a kernel of eight lanes with the best vector units of this processor, up to `limit`.
#[inline(always)]
pub fn with_eight_lanes<K: Kernel<8>>(limit: Level, kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    match limit.min(Level::current()) {
        Level::Baseline => {}
        // SAFETY: the processor supports `Level::current` and all levels below.
        Level::Avx2 => return unsafe { x86::avx2(kernel) },
        // SAFETY: as above.
        Level::Avx512 => return unsafe { x86::avx512(kernel) },
    }
    let _ = limit;
    portable(kernel)
}

/// Runs a kernel of sixteen lanes with AVX-512 if the processor has it; otherwise it is slow.
#[inline(always)]
pub fn with_sixteen_lanes<K: Kernel<16>>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    if Level::current() == Level::Avx512 {
        // SAFETY: the processor supports `Level::current`.
        return unsafe { x86::avx512(kernel) };
    }
    portable(kernel)
}

/// Never inlined: otherwise the caller would reserve its stack space even if it is not called.
#[inline(never)]
fn portable<const N: usize, K: Kernel<N>>(kernel: K) -> K::Output {
    kernel.run(Portable)
}

/// Arrays of numbers, for processors without wider registers.
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

impl<const N: usize> Lanes<N> for Portable {
    type Floats = [f32; N];
    type Words = [u32; N];

    #[inline(always)]
    fn splat(self, x: f32) -> [f32; N] {
        [x; N]
    }
    #[inline(always)]
    fn load(self, from: &[f32; N]) -> [f32; N] {
        *from
    }
    #[inline(always)]
    fn load_words(self, from: &[u32; N]) -> [u32; N] {
        *from
    }
    #[inline(always)]
    fn store(self, x: [f32; N]) -> [f32; N] {
        x
    }
    #[inline(always)]
    fn mul_add(self, a: [f32; N], b: [f32; N], c: [f32; N]) -> [f32; N] {
        each!(|a, b, c| a * b + c)
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
    fn at_most(self, a: [f32; N], b: [f32; N]) -> u32 {
        (0..N).fold(0, |mask, i| mask | u32::from(a[i] <= b[i]) << i)
    }
    #[inline(always)]
    fn order(self, packed: &[u32; N], entry: usize) -> [u32; N] {
        let words = N / 8;
        std::array::from_fn(|i| packed[(words * entry + i % words) % N] >> (4 * (i / words)) & 15)
    }
    #[inline(always)]
    fn permute(self, x: [f32; N], order: [u32; N]) -> [f32; N] {
        each!(|order| x[order as usize % N])
    }
    #[inline(always)]
    fn permute_words(self, x: [u32; N], order: [u32; N]) -> [u32; N] {
        each!(|order| x[order as usize % N])
    }
    #[inline(always)]
    fn compress(self, mask: u32, x: [f32; N], y: [u32; N], to: (&mut [f32; N], &mut [u32; N])) {
        let mut count = 0;
        for i in 0..N {
            (to.0[count % N], to.1[count % N]) = (x[i], y[i]);
            count += (mask >> i & 1) as usize;
        }
    }
}

impl Doubles for Portable {
    const LANES: usize = 4;
    type Vector = [f64; 4];

    #[inline(always)]
    fn splat(self, x: f64) -> [f64; 4] {
        [x; 4]
    }
    #[inline(always)]
    fn load(self, from: &[f64; 8], part: usize) -> [f64; 4] {
        from.as_chunks::<4>().0[part % 2]
    }
    #[inline(always)]
    fn widen(self, from: &[f32; 8], part: usize) -> [f64; 4] {
        from.as_chunks::<4>().0[part % 2].map(f64::from)
    }
    #[inline(always)]
    fn add(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        each!(|a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        each!(|a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        each!(|a, b| a * b)
    }
    #[inline(always)]
    fn div(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        each!(|a, b| a / b)
    }
    #[inline(always)]
    fn min(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        each!(|a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        each!(|a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn abs(self, x: [f64; 4]) -> [f64; 4] {
        each!(|x| x.abs())
    }
    #[inline(always)]
    fn less(self, a: [f64; 4], b: [f64; 4]) -> u32 {
        (0..4).fold(0, |mask, i| mask | u32::from(a[i] < b[i]) << i)
    }
    #[inline(always)]
    fn at_most(self, a: [f64; 4], b: [f64; 4]) -> u32 {
        (0..4).fold(0, |mask, i| mask | u32::from(a[i] <= b[i]) << i)
    }
    #[inline(always)]
    fn lane(self, x: [f64; 4], lane: usize) -> f64 {
        x[lane % 4]
    }
}

impl Quad for Portable {
    type Vector = [f64; 4];

    #[inline(always)]
    fn splat(self, x: f64) -> [f64; 4] {
        [x; 4]
    }
    #[inline(always)]
    fn load(self, from: [f64; 4]) -> [f64; 4] {
        from
    }
    #[inline(always)]
    fn store(self, x: [f64; 4]) -> [f64; 4] {
        x
    }
    #[inline(always)]
    fn store_rounded(self, x: [f64; 4]) -> [f32; 4] {
        each!(|x| x as f32)
    }
    #[inline(always)]
    fn add(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        each!(|a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        each!(|a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        each!(|a, b| a * b)
    }
    #[inline(always)]
    fn div(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        each!(|a, b| a / b)
    }
    #[inline(always)]
    fn max(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        each!(|a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn abs(self, x: [f64; 4]) -> [f64; 4] {
        each!(|x| x.abs())
    }
    #[inline(always)]
    fn copy_sign(self, x: [f64; 4], y: [f64; 4]) -> [f64; 4] {
        each!(|x, y| x.copysign(y))
    }
    #[inline(always)]
    fn equal(self, a: [f64; 4], b: [f64; 4]) -> u32 {
        (0..4).fold(0, |mask, i| mask | u32::from(a[i] == b[i]) << i)
    }
    #[inline(always)]
    fn signs(self, x: [f64; 4]) -> u32 {
        (0..4).fold(0, |mask, i| mask | ((x[i].to_bits() >> 63) as u32) << i)
    }
    #[inline(always)]
    fn permute(self, x: [f64; 4], order: &QuadOrder) -> [f64; 4] {
        std::array::from_fn(|i| x[order.0[2 * i] as usize / 2 % 4])
    }
}

impl<const N: usize> Machine<N> for Portable {
    type Doubles = Self;
    type Quad = Self;

    #[inline(always)]
    fn doubles(self) -> Self {
        self
    }
    #[inline(always)]
    fn quad(self) -> Self {
        self
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Doubles, Kernel, Lanes, Machine, Quad, QuadOrder};
    use std::arch::x86_64::*;

    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    pub(super) fn avx2<K: Kernel<8>>(kernel: K) -> K::Output {
        kernel.run(Avx2(()))
    }

    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    pub(super) fn avx512<const N: usize, K: Kernel<N>>(kernel: K) -> K::Output
    where
        Avx512: Machine<N>,
    {
        kernel.run(Avx512(()))
    }

    /// Constructed only where `avx2` or `avx512` above were called.
    #[derive(Clone, Copy)]
    pub(super) struct Avx2(());

    /// Constructed only by `avx512` above.
    #[derive(Clone, Copy)]
    pub(super) struct Avx512(());

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

    /// For each mask of eight lanes, the numbers of the lanes that it selects.
    static SELECTED: [[u8; 8]; 256] = {
        let mut table = [[0; 8]; 256];
        let mut mask = 0;
        while mask < 256 {
            let (mut lane, mut count) = (0, 0);
            while lane < 8 {
                if mask >> lane & 1 == 1 {
                    table[mask][count] = lane as u8;
                    count += 1;
                }
                lane += 1;
            }
            mask += 1;
        }
        table
    };

    /// For eight numbers AVX-512 adds nothing here; the compiler uses its masks and registers where
    /// they help.
    macro_rules! eight {
        ($token:ident) => {
            impl Lanes<8> for $token {
                type Floats = __m256;
                type Words = __m256i;

                operations! {
                    splat(x: f32) -> __m256 = _mm256_set1_ps(x);
                    load(from: &[f32; 8]) -> __m256 = _mm256_loadu_ps(from.as_ptr());
                    load_words(from: &[u32; 8]) -> __m256i = _mm256_loadu_si256(from.as_ptr().cast());
                    store(x: __m256) -> [f32; 8] = std::mem::transmute::<__m256, [f32; 8]>(x);
                    mul_add(a: __m256, b: __m256, c: __m256) -> __m256 = _mm256_fmadd_ps(a, b, c);
                    min(a: __m256, b: __m256) -> __m256 = _mm256_min_ps(a, b);
                    max(a: __m256, b: __m256) -> __m256 = _mm256_max_ps(a, b);
                    at_most(a: __m256, b: __m256) -> u32 =
                        _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(a, b)) as u32;
                    // Permutations read the lowest three bits of each lane.
                    order(packed: &[u32; 8], entry: usize) -> __m256i = _mm256_srlv_epi32(
                        _mm256_set1_epi32(packed[entry % 8] as i32),
                        _mm256_setr_epi32(0, 4, 8, 12, 16, 20, 24, 28)
                    );
                    permute(x: __m256, order: __m256i) -> __m256 = _mm256_permutevar8x32_ps(x, order);
                    permute_words(x: __m256i, order: __m256i) -> __m256i =
                        _mm256_permutevar8x32_epi32(x, order);
                    compress(mask: u32, x: __m256, y: __m256i, to: (&mut [f32; 8], &mut [u32; 8])) -> () = {
                        let selected = SELECTED[mask as usize % 256].as_ptr().cast();
                        let order = _mm256_cvtepu8_epi32(_mm_loadl_epi64(selected));
                        _mm256_storeu_ps(to.0.as_mut_ptr(), _mm256_permutevar8x32_ps(x, order));
                        let y = _mm256_permutevar8x32_epi32(y, order);
                        _mm256_storeu_si256(to.1.as_mut_ptr().cast(), y);
                    };
                }
            }
        };
    }

    eight!(Avx2);
    eight!(Avx512);

    impl Lanes<16> for Avx512 {
        type Floats = __m512;
        type Words = __m512i;

        operations! {
            splat(x: f32) -> __m512 = _mm512_set1_ps(x);
            load(from: &[f32; 16]) -> __m512 = _mm512_loadu_ps(from.as_ptr());
            load_words(from: &[u32; 16]) -> __m512i = _mm512_loadu_si512(from.as_ptr().cast());
            store(x: __m512) -> [f32; 16] = std::mem::transmute::<__m512, [f32; 16]>(x);
            mul_add(a: __m512, b: __m512, c: __m512) -> __m512 = _mm512_fmadd_ps(a, b, c);
            min(a: __m512, b: __m512) -> __m512 = _mm512_min_ps(a, b);
            max(a: __m512, b: __m512) -> __m512 = _mm512_max_ps(a, b);
            at_most(a: __m512, b: __m512) -> u32 = u32::from(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b));
            // Permutations read the lowest four bits of each lane.
            order(packed: &[u32; 16], entry: usize) -> __m512i = _mm512_srlv_epi32(
                _mm512_set1_epi64(
                    packed.as_ptr().cast::<i64>().add(entry % 8).read_unaligned()
                ),
                _mm512_setr_epi32(0, 0, 4, 4, 8, 8, 12, 12, 16, 16, 20, 20, 24, 24, 28, 28)
            );
            permute(x: __m512, order: __m512i) -> __m512 = _mm512_permutexvar_ps(order, x);
            permute_words(x: __m512i, order: __m512i) -> __m512i = _mm512_permutexvar_epi32(order, x);
            compress(mask: u32, x: __m512, y: __m512i, to: (&mut [f32; 16], &mut [u32; 16])) -> () = {
                let mask = mask as u16;
                _mm512_storeu_ps(to.0.as_mut_ptr(), _mm512_maskz_compress_ps(mask, x));
                let y = _mm512_maskz_compress_epi32(mask, y);
                _mm512_storeu_si512(to.1.as_mut_ptr().cast(), y);
            };
        }
    }

    impl Doubles for Avx2 {
        const LANES: usize = 4;
        type Vector = __m256d;

        operations! {
            splat(x: f64) -> __m256d = _mm256_set1_pd(x);
            load(from: &[f64; 8], part: usize) -> __m256d =
                _mm256_loadu_pd(from.as_chunks::<4>().0[part % 2].as_ptr());
            widen(from: &[f32; 8], part: usize) -> __m256d =
                _mm256_cvtps_pd(_mm_loadu_ps(from.as_chunks::<4>().0[part % 2].as_ptr()));
            add(a: __m256d, b: __m256d) -> __m256d = _mm256_add_pd(a, b);
            sub(a: __m256d, b: __m256d) -> __m256d = _mm256_sub_pd(a, b);
            mul(a: __m256d, b: __m256d) -> __m256d = _mm256_mul_pd(a, b);
            div(a: __m256d, b: __m256d) -> __m256d = _mm256_div_pd(a, b);
            min(a: __m256d, b: __m256d) -> __m256d = _mm256_min_pd(a, b);
            max(a: __m256d, b: __m256d) -> __m256d = _mm256_max_pd(a, b);
            abs(x: __m256d) -> __m256d = _mm256_andnot_pd(_mm256_set1_pd(-0.0), x);
            less(a: __m256d, b: __m256d) -> u32 =
                _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LT_OQ>(a, b)) as u32;
            at_most(a: __m256d, b: __m256d) -> u32 =
                _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LE_OQ>(a, b)) as u32;
            lane(x: __m256d, lane: usize) -> f64 =
                std::mem::transmute::<__m256d, [f64; 4]>(x)[lane % 4];
        }
    }

    impl Doubles for Avx512 {
        const LANES: usize = 8;
        type Vector = __m512d;

        operations! {
            splat(x: f64) -> __m512d = _mm512_set1_pd(x);
            load(from: &[f64; 8], _part: usize) -> __m512d = _mm512_loadu_pd(from.as_ptr());
            widen(from: &[f32; 8], _part: usize) -> __m512d =
                _mm512_cvtps_pd(_mm256_loadu_ps(from.as_ptr()));
            add(a: __m512d, b: __m512d) -> __m512d = _mm512_add_pd(a, b);
            sub(a: __m512d, b: __m512d) -> __m512d = _mm512_sub_pd(a, b);
            mul(a: __m512d, b: __m512d) -> __m512d = _mm512_mul_pd(a, b);
            div(a: __m512d, b: __m512d) -> __m512d = _mm512_div_pd(a, b);
            min(a: __m512d, b: __m512d) -> __m512d = _mm512_min_pd(a, b);
            max(a: __m512d, b: __m512d) -> __m512d = _mm512_max_pd(a, b);
            abs(x: __m512d) -> __m512d = _mm512_abs_pd(x);
            less(a: __m512d, b: __m512d) -> u32 = u32::from(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b));
            at_most(a: __m512d, b: __m512d) -> u32 =
                u32::from(_mm512_cmp_pd_mask::<_CMP_LE_OQ>(a, b));
            lane(x: __m512d, lane: usize) -> f64 =
                _mm512_cvtsd_f64(_mm512_maskz_compress_pd(1 << (lane % 8), x));
        }
    }

    impl Quad for Avx2 {
        type Vector = __m256d;

        operations! {
            splat(x: f64) -> __m256d = _mm256_set1_pd(x);
            load(from: [f64; 4]) -> __m256d = _mm256_setr_pd(from[0], from[1], from[2], from[3]);
            store(x: __m256d) -> [f64; 4] = std::mem::transmute::<__m256d, [f64; 4]>(x);
            store_rounded(x: __m256d) -> [f32; 4] =
                std::mem::transmute::<__m128, [f32; 4]>(_mm256_cvtpd_ps(x));
            add(a: __m256d, b: __m256d) -> __m256d = _mm256_add_pd(a, b);
            sub(a: __m256d, b: __m256d) -> __m256d = _mm256_sub_pd(a, b);
            mul(a: __m256d, b: __m256d) -> __m256d = _mm256_mul_pd(a, b);
            div(a: __m256d, b: __m256d) -> __m256d = _mm256_div_pd(a, b);
            max(a: __m256d, b: __m256d) -> __m256d = _mm256_max_pd(a, b);
            abs(x: __m256d) -> __m256d = _mm256_andnot_pd(_mm256_set1_pd(-0.0), x);
            copy_sign(x: __m256d, y: __m256d) -> __m256d = {
                let sign = _mm256_set1_pd(-0.0);
                _mm256_or_pd(_mm256_andnot_pd(sign, x), _mm256_and_pd(sign, y))
            };
            equal(a: __m256d, b: __m256d) -> u32 =
                _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_EQ_OQ>(a, b)) as u32;
            signs(x: __m256d) -> u32 = _mm256_movemask_pd(x) as u32;
            permute(x: __m256d, order: &QuadOrder) -> __m256d = {
                let order = _mm256_loadu_si256(order.0.as_ptr().cast());
                _mm256_castps_pd(_mm256_permutevar8x32_ps(_mm256_castpd_ps(x), order))
            };
        }
    }

    macro_rules! machines {
        ($($token:ident: $lanes:literal),+) => {
            $(
                impl Machine<$lanes> for $token {
                    type Doubles = Self;
                    type Quad = Avx2;

                    #[inline(always)]
                    fn doubles(self) -> Self {
                        self
                    }
                    #[inline(always)]
                    fn quad(self) -> Avx2 {
                        // Processors with AVX-512 have AVX2.
                        Avx2(())
                    }
                }
            )+
        };
    }

    machines!(Avx2: 8, Avx512: 8, Avx512: 16);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Results as bits, and masks.
    type Found = (Vec<u64>, Vec<u32>);

    fn bits(x: f64) -> u64 {
        if x.is_nan() {
            f64::NAN.to_bits()
        } else {
            x.to_bits()
        }
    }

    /// All operations on N numbers.
    fn singles<const N: usize, L: Lanes<N>>(l: L, [a, b, c]: [[f32; N]; 3], found: &mut Found) {
        let mut packed = [0; N];
        for entry in 0..8 {
            pack_order(std::array::from_fn(|i| (i * 5 + entry) % N), &mut packed, entry);
        }
        let words = l.load_words(&std::array::from_fn(|i| 100 + i as u32));
        let (a, b, c) = (l.load(&a), l.load(&b), l.load(&c));
        let order = l.order(&packed, 3);
        let values = [
            l.splat(0.5),
            l.mul_add(a, b, c),
            l.min(a, b),
            l.max(a, b),
            l.permute(c, order),
        ];
        found.0.extend(
            values
                .into_iter()
                .flat_map(|x| l.store(x))
                .map(|x| bits(f64::from(x))),
        );
        let mask = l.at_most(a, b);
        let (mut x, mut y) = ([0.0; N], [0; N]);
        l.compress(mask, c, l.permute_words(words, order), (&mut x, &mut y));
        let count = mask.count_ones() as usize;
        found.0.extend(x[..count].iter().map(|x| bits(f64::from(*x))));
        found.1.push(mask);
        found.1.extend(&y[..count]);
    }

    /// All operations on eight numbers.
    fn doubles<D: Doubles>(d: D, [a, b]: [[f64; 8]; 2], found: &mut Found) {
        let (mut values, mut masks) = ([const { Vec::new() }; 10], [0, 0]);
        for part in 0..8 / D::LANES {
            let wide = d.widen(&a.map(|x| x as f32), part);
            let (a, b) = (d.load(&a, part), d.load(&b, part));
            let of_part = [
                wide,
                d.splat(1.5),
                d.add(a, b),
                d.sub(a, b),
                d.mul(a, b),
                d.div(a, b),
                d.min(a, b),
                d.max(a, b),
                d.abs(a),
                b,
            ];
            for (values, x) in values.iter_mut().zip(of_part) {
                values.extend((0..D::LANES).map(|lane| bits(d.lane(x, lane))));
            }
            masks[0] |= d.less(a, b) << (part * D::LANES);
            masks[1] |= d.at_most(a, b) << (part * D::LANES);
        }
        found.0.extend(values.into_iter().flatten());
        found.1.extend(masks);
    }

    /// All operations on four numbers.
    fn quads<Q: Quad>(q: Q, [a, b]: [[f64; 8]; 2], found: &mut Found) {
        let four = |x: [f64; 8]| q.load(std::array::from_fn(|i| x[i + 2]));
        let (a, b) = (four(a), four(b));
        let values = [
            q.splat(1.5),
            q.add(a, b),
            q.sub(a, b),
            q.mul(a, b),
            q.div(a, b),
            q.max(a, b),
            q.abs(a),
            q.copy_sign(a, b),
            q.permute(a, &const { QuadOrder::new([2, 3, 1, 2]) }),
        ];
        found
            .0
            .extend(values.into_iter().flat_map(|x| q.store(x)).map(bits));
        found.0.extend(q.store_rounded(a).map(|x| bits(f64::from(x))));
        found.1.extend([q.equal(a, b), q.signs(q.sub(a, b))]);
    }

    struct Everything<const N: usize>([[f32; N]; 3], [[f64; 8]; 2]);

    impl<const N: usize> Kernel<N> for Everything<N> {
        type Output = Found;

        #[inline(always)]
        fn run<M: Machine<N>>(self, m: M) -> Found {
            let mut found = Found::default();
            singles(m, self.0, &mut found);
            doubles(m.doubles(), self.1, &mut found);
            quads(m.quad(), self.1, &mut found);
            found
        }
    }

    #[test]
    fn every_level_computes_the_same_where_single_precision_is_exact() {
        let a = [1.0, -2.0, 3.0, 0.0, f32::INFINITY, 7.0, -0.0, 1.5];
        let b = [2.0, -2.0, 0.5, -0.0, 1.0, f32::NAN, 0.0, -4.0];
        let c = std::array::from_fn(|i| i as f32 - 2.0);
        let wide = |x: [f32; 8]| std::array::from_fn(|i| if i < 8 { x[i] } else { x[(3 * i + 1) % 8] });
        let in_double = [a.map(|x| f64::from(x) / 3.0), b.map(|x| f64::from(x) / 7.0)];
        let eight = || Everything([a, b, c], in_double);
        let sixteen = || Everything([wide(a), wide(b), wide(c)], in_double);
        let expected = eight().run(Portable);
        assert_eq!(expected.1[0], 0b0100_1011);
        for level in [Level::Baseline, Level::Avx2, Level::Avx512] {
            assert_eq!(with_eight_lanes(level, eight()), expected, "{level:?}");
        }
        assert_eq!(with_sixteen_lanes(sixteen()), sixteen().run(Portable));
    }

    #[test]
    fn an_order_is_read_as_it_was_packed() {
        let order = std::array::from_fn(|i| (i * 7 + 3) % 16);
        let mut packed = [0; 16];
        pack_order(order, &mut packed, 5);
        assert_eq!(Portable.order(&packed, 5).map(|i| i as usize), order);
    }
}
