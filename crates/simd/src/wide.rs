#![allow(
    unsafe_code,
    reason = "intrinsics are called from functions that are inlined where the processor has them"
)]

use crate::lanes::{Lanes, Portable};

/// Sixteen single-precision numbers and 32-bit words at once, with permutations.
pub trait Sixteen: Lanes<16> {
    /// A vector of sixteen words.
    type Words: Copy;

    /// Loads from memory.
    fn load_words(self, from: &[u32; 16]) -> Self::Words;
    /// An entry of a list of [`pack_order`]s, for [`Self::permute`].
    fn order(self, packed: &[u32; 16], entry: usize) -> Self::Words;
    /// Lane i of the result is lane `order[i]` of `x`.
    fn permute(self, x: Self::Floats, order: Self::Words) -> Self::Floats;
    /// Lane i of the result is lane `order[i]` of `x`.
    fn permute_words(self, x: Self::Words, order: Self::Words) -> Self::Words;
    /// Stores the lanes of `x` and `y` that the mask selects, without gaps, and then unspecified
    /// values.
    fn compress(self, mask: u32, x: Self::Floats, y: Self::Words, to: (&mut [f32; 16], &mut [u32; 16]));
}

/// Packs an order of sixteen lanes as entry `entry` (below 8) of a list of eight.
pub fn pack_order(order: [usize; 16], packed: &mut [u32; 16], entry: usize) {
    // Even lanes are in the first word and odd lanes in the second, so that a vector that repeats
    // the two has each lane's number in the word of that lane.
    let packed = &mut packed[2 * entry..][..2];
    packed.fill(0);
    for (i, lane) in order.into_iter().enumerate() {
        packed[i % 2] |= (lane as u32) << (4 * (i / 2));
    }
}

/// The lane at a place of an order that [`pack_order`] packed.
#[inline(always)]
pub fn unpack_order(packed: &[u32; 16], entry: usize, place: usize) -> usize {
    let [even, odd] = packed.as_chunks().0[entry % 8];
    let both = u64::from(even) | u64::from(odd) << 32;
    (both >> (place << 5 & 32 | place << 1 & 28)) as usize & 15
}

/// Eight double-precision numbers at once. All implementations round alike.
pub trait Doubles: Copy {
    /// A vector of eight numbers.
    type Vector: Copy;

    /// `x` in every lane.
    fn splat(self, x: f64) -> Self::Vector;
    /// Loads from memory.
    fn load(self, from: &[f64; 8]) -> Self::Vector;
    /// Loads single-precision numbers.
    fn widen(self, from: &[f32; 8]) -> Self::Vector;
    /// `a + b`.
    fn add(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a - b`.
    fn sub(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a * b`.
    fn mul(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a / b`.
    fn div(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a * b - c`, where the product must be exact: then it makes no difference whether it is
    /// rounded.
    fn exact_mul_sub(self, a: Self::Vector, b: Self::Vector, c: Self::Vector) -> Self::Vector;
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
    /// A mask: bit i is set if the sign of `x[i]` is negative.
    fn signs(self, x: Self::Vector) -> u32;
    /// The absolute value of `x` with the sign of `y`.
    fn copy_sign(self, x: Self::Vector, y: Self::Vector) -> Self::Vector;
    /// `a` in the lanes that the mask selects, else `b`.
    fn select(self, mask: u32, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// The number in a lane.
    fn lane(self, x: Self::Vector, lane: usize) -> f64;
    /// Stores to memory.
    fn store(self, x: Self::Vector, to: &mut [f64; 8]);
    /// Stores to memory in single precision.
    fn round(self, x: Self::Vector, to: &mut [f32; 8]);
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
    /// `a` if `a < b`, else `b`.
    fn min(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a` if `a > b`, else `b`.
    fn max(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// The absolute value.
    fn abs(self, x: Self::Vector) -> Self::Vector;
    /// `-x`.
    fn negate(self, x: Self::Vector) -> Self::Vector;
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

/// The vector units of a processor with AVX-512.
pub trait WideMachine: Sixteen {
    /// Eight doubles.
    type Doubles: Doubles;
    /// Four doubles.
    type Quad: Quad;

    /// The token for eight doubles.
    fn doubles(self) -> Self::Doubles;
    /// The token for four doubles.
    fn quad(self) -> Self::Quad;
}

/// A computation that is generic over [`WideMachine`].
pub trait WideKernel {
    /// Its result.
    type Output;

    /// Runs it. Mark this `#[inline(always)]`.
    fn run<M: WideMachine>(self, machine: M) -> Self::Output;
}

/// Runs a kernel with AVX-512 if the processor has it; otherwise it is slow.
#[inline(always)]
pub fn with_wide_lanes<K: WideKernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    if crate::Level::current() == crate::Level::Avx512 {
        // SAFETY: the processor supports the current level.
        return unsafe { x86::avx512(kernel) };
    }
    portable(kernel)
}

/// Never inlined: otherwise the caller would reserve its stack space even if it is not called.
#[inline(never)]
fn portable<K: WideKernel>(kernel: K) -> K::Output {
    kernel.run(Portable)
}

macro_rules! each {
    (|$($x:ident),+| $value:expr) => {
        std::array::from_fn(|i| {
            $(let $x = $x[i];)+
            $value
        })
    };
}

impl Sixteen for Portable {
    type Words = [u32; 16];

    #[inline(always)]
    fn load_words(self, from: &[u32; 16]) -> [u32; 16] {
        *from
    }
    #[inline(always)]
    fn order(self, packed: &[u32; 16], entry: usize) -> [u32; 16] {
        std::array::from_fn(|i| packed[(2 * entry + i % 2) % 16] >> (4 * (i / 2)) & 15)
    }
    #[inline(always)]
    fn permute(self, x: [f32; 16], order: [u32; 16]) -> [f32; 16] {
        each!(|order| x[order as usize % 16])
    }
    #[inline(always)]
    fn permute_words(self, x: [u32; 16], order: [u32; 16]) -> [u32; 16] {
        each!(|order| x[order as usize % 16])
    }
    #[inline(always)]
    fn compress(self, mask: u32, x: [f32; 16], y: [u32; 16], to: (&mut [f32; 16], &mut [u32; 16])) {
        let mut count = 0;
        for i in 0..16 {
            (to.0[count % 16], to.1[count % 16]) = (x[i], y[i]);
            count += (mask >> i & 1) as usize;
        }
    }
}

impl Doubles for Portable {
    type Vector = [f64; 8];

    #[inline(always)]
    fn splat(self, x: f64) -> [f64; 8] {
        [x; 8]
    }
    #[inline(always)]
    fn load(self, from: &[f64; 8]) -> [f64; 8] {
        *from
    }
    #[inline(always)]
    fn widen(self, from: &[f32; 8]) -> [f64; 8] {
        from.map(f64::from)
    }
    #[inline(always)]
    fn add(self, a: [f64; 8], b: [f64; 8]) -> [f64; 8] {
        each!(|a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, a: [f64; 8], b: [f64; 8]) -> [f64; 8] {
        each!(|a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, a: [f64; 8], b: [f64; 8]) -> [f64; 8] {
        each!(|a, b| a * b)
    }
    #[inline(always)]
    fn div(self, a: [f64; 8], b: [f64; 8]) -> [f64; 8] {
        each!(|a, b| a / b)
    }
    #[inline(always)]
    fn exact_mul_sub(self, a: [f64; 8], b: [f64; 8], c: [f64; 8]) -> [f64; 8] {
        each!(|a, b, c| a * b - c)
    }
    #[inline(always)]
    fn min(self, a: [f64; 8], b: [f64; 8]) -> [f64; 8] {
        each!(|a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, a: [f64; 8], b: [f64; 8]) -> [f64; 8] {
        each!(|a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn abs(self, x: [f64; 8]) -> [f64; 8] {
        each!(|x| x.abs())
    }
    #[inline(always)]
    fn less(self, a: [f64; 8], b: [f64; 8]) -> u32 {
        (0..8).fold(0, |mask, i| mask | u32::from(a[i] < b[i]) << i)
    }
    #[inline(always)]
    fn at_most(self, a: [f64; 8], b: [f64; 8]) -> u32 {
        (0..8).fold(0, |mask, i| mask | u32::from(a[i] <= b[i]) << i)
    }
    #[inline(always)]
    fn signs(self, x: [f64; 8]) -> u32 {
        (0..8).fold(0, |mask, i| mask | u32::from(x[i].is_sign_negative()) << i)
    }
    #[inline(always)]
    fn copy_sign(self, x: [f64; 8], y: [f64; 8]) -> [f64; 8] {
        each!(|x, y| x.copysign(y))
    }
    #[inline(always)]
    fn select(self, mask: u32, a: [f64; 8], b: [f64; 8]) -> [f64; 8] {
        std::array::from_fn(|i| if mask >> i & 1 == 1 { a[i] } else { b[i] })
    }
    #[inline(always)]
    fn store(self, x: [f64; 8], to: &mut [f64; 8]) {
        *to = x;
    }
    #[inline(always)]
    fn round(self, x: [f64; 8], to: &mut [f32; 8]) {
        *to = x.map(|x| x as f32);
    }
    #[inline(always)]
    fn lane(self, x: [f64; 8], lane: usize) -> f64 {
        x[lane % 8]
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
    fn negate(self, x: [f64; 4]) -> [f64; 4] {
        each!(|x| -x)
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

impl WideMachine for Portable {
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
    use super::{Doubles, Quad, QuadOrder, Sixteen, WideKernel, WideMachine};
    use crate::lanes::x86::{Avx512, operations};
    use std::arch::x86_64::*;

    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    pub(super) fn avx512<K: WideKernel>(kernel: K) -> K::Output {
        kernel.run(Avx512::new())
    }

    impl Sixteen for Avx512 {
        type Words = __m512i;

        operations! {
            load_words(from: &[u32; 16]) -> __m512i = _mm512_loadu_si512(from.as_ptr().cast());
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

    impl Doubles for Avx512 {
        type Vector = __m512d;

        operations! {
            splat(x: f64) -> __m512d = _mm512_set1_pd(x);
            load(from: &[f64; 8]) -> __m512d = _mm512_loadu_pd(from.as_ptr());
            widen(from: &[f32; 8]) -> __m512d =
                _mm512_cvtps_pd(_mm256_loadu_ps(from.as_ptr()));
            add(a: __m512d, b: __m512d) -> __m512d = _mm512_add_pd(a, b);
            sub(a: __m512d, b: __m512d) -> __m512d = _mm512_sub_pd(a, b);
            mul(a: __m512d, b: __m512d) -> __m512d = _mm512_mul_pd(a, b);
            div(a: __m512d, b: __m512d) -> __m512d = _mm512_div_pd(a, b);
            exact_mul_sub(a: __m512d, b: __m512d, c: __m512d) -> __m512d = _mm512_fmsub_pd(a, b, c);
            min(a: __m512d, b: __m512d) -> __m512d = _mm512_min_pd(a, b);
            max(a: __m512d, b: __m512d) -> __m512d = _mm512_max_pd(a, b);
            abs(x: __m512d) -> __m512d = _mm512_abs_pd(x);
            less(a: __m512d, b: __m512d) -> u32 = u32::from(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b));
            at_most(a: __m512d, b: __m512d) -> u32 =
                u32::from(_mm512_cmp_pd_mask::<_CMP_LE_OQ>(a, b));
            signs(x: __m512d) -> u32 = u32::from(_mm512_movepi64_mask(_mm512_castpd_si512(x)));
            copy_sign(x: __m512d, y: __m512d) -> __m512d = {
                let sign = _mm512_set1_pd(-0.0);
                _mm512_or_pd(_mm512_andnot_pd(sign, x), _mm512_and_pd(sign, y))
            };
            select(mask: u32, a: __m512d, b: __m512d) -> __m512d =
                _mm512_mask_blend_pd(mask as u8, b, a);
            store(x: __m512d, to: &mut [f64; 8]) -> () = _mm512_storeu_pd(to.as_mut_ptr(), x);
            round(x: __m512d, to: &mut [f32; 8]) -> () =
                _mm256_storeu_ps(to.as_mut_ptr(), _mm512_cvtpd_ps(x));
            lane(x: __m512d, lane: usize) -> f64 =
                _mm512_cvtsd_f64(_mm512_maskz_compress_pd(1 << (lane % 8), x));
        }
    }

    impl Quad for Avx512 {
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
            min(a: __m256d, b: __m256d) -> __m256d = _mm256_min_pd(a, b);
            max(a: __m256d, b: __m256d) -> __m256d = _mm256_max_pd(a, b);
            abs(x: __m256d) -> __m256d = _mm256_andnot_pd(_mm256_set1_pd(-0.0), x);
            negate(x: __m256d) -> __m256d = _mm256_xor_pd(x, _mm256_set1_pd(-0.0));
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

    impl WideMachine for Avx512 {
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

    /// All operations on sixteen numbers.
    fn sixteen<L: Sixteen>(l: L, [a, b, c]: [[f32; 16]; 3], found: &mut Found) {
        let mut packed = [0; 16];
        for entry in 0..8 {
            pack_order(std::array::from_fn(|i| (i * 5 + entry) % 16), &mut packed, entry);
        }
        let words = l.load_words(&std::array::from_fn(|i| 100 + i as u32));
        let (a, b, c) = (l.load(&a), l.load(&b), l.load(&c));
        let order = l.order(&packed, 3);
        let permuted = l.store(l.permute(c, order));
        found.0.extend(permuted.map(|x| bits(f64::from(x))));
        let mask = l.at_most(a, b);
        let (mut x, mut y) = ([0.0; 16], [0; 16]);
        l.compress(mask, c, l.permute_words(words, order), (&mut x, &mut y));
        let count = mask.count_ones() as usize;
        found.0.extend(x[..count].iter().map(|x| bits(f64::from(*x))));
        found.1.push(mask);
        found.1.extend(&y[..count]);
    }

    /// All operations on eight numbers.
    fn doubles<D: Doubles>(d: D, [a, b]: [[f64; 8]; 2], found: &mut Found) {
        let wide = d.widen(&a.map(|x| x as f32));
        let (a, b) = (d.load(&a), d.load(&b));
        let values = [
            wide,
            d.splat(1.5),
            d.add(a, b),
            d.sub(a, b),
            d.mul(a, b),
            d.div(a, b),
            d.exact_mul_sub(wide, d.splat(0.25), b),
            d.min(a, b),
            d.max(a, b),
            d.abs(a),
            d.copy_sign(a, b),
            d.select(0b0110_1010, a, b),
        ];
        for x in values {
            let (mut all, mut rounded) = ([0.0; 8], [0.0; 8]);
            d.store(x, &mut all);
            d.round(x, &mut rounded);
            found.0.extend(all.map(bits));
            found.0.extend(rounded.map(|x| bits(f64::from(x))));
            found.0.extend((0..8).map(|lane| bits(d.lane(x, lane))));
        }
        found.1.extend([d.less(a, b), d.at_most(a, b), d.signs(b)]);
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
        let stored = values.into_iter().flat_map(|x| q.store(x));
        found.0.extend(stored.map(bits));
        found.0.extend(q.store_rounded(a).map(|x| bits(f64::from(x))));
        found.1.extend([q.equal(a, b), q.signs(q.sub(a, b))]);
    }

    struct Everything([[f32; 16]; 3], [[f64; 8]; 2]);

    impl WideKernel for Everything {
        type Output = Found;

        #[inline(always)]
        fn run<M: WideMachine>(self, m: M) -> Found {
            let mut found = Found::default();
            sixteen(m, self.0, &mut found);
            doubles(m.doubles(), self.1, &mut found);
            quads(m.quad(), self.1, &mut found);
            found
        }
    }

    #[test]
    fn every_level_computes_the_same() {
        let a = [1.0, -2.0, 3.0, 0.0, f32::INFINITY, 7.0, -0.0, 1.5];
        let b = [2.0, -2.0, 0.5, -0.0, 1.0, f32::NAN, 0.0, -4.0];
        let wide = |x: [f32; 8]| std::array::from_fn(|i| if i < 8 { x[i] } else { x[(3 * i + 1) % 8] });
        let c = std::array::from_fn(|i| i as f32 - 2.0);
        let in_double = [a.map(|x| f64::from(x) / 3.0), b.map(|x| f64::from(x) / 7.0)];
        let all = || Everything([wide(a), wide(b), c], in_double);
        let expected = all().run(Portable);
        assert_eq!(expected.1[0] & 255, 0b0100_1011);
        assert_eq!(with_wide_lanes(all()), expected);
    }

    #[test]
    fn an_order_is_read_as_it_was_packed() {
        let order = std::array::from_fn(|i| (i * 7 + 3) % 16);
        let mut packed = [0; 16];
        pack_order(order, &mut packed, 5);
        assert_eq!(Portable.order(&packed, 5).map(|i| i as usize), order);
        let places: [usize; 16] = std::array::from_fn(|i| i);
        assert_eq!(places.map(|place| unpack_order(&packed, 5, place)), order);
    }
}
