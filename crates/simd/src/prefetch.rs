#![allow(unsafe_code, reason = "prefetch is an intrinsic")]

/// Bytes that the processor fetches at once.
const LINE: usize = 64;

/// Asks the processor to have so many lines of memory in its nearest cache soon. Does nothing else, wherever this
/// points to.
#[inline(always)]
pub fn prefetch<T>(from: *const T, lines: usize) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        for line in 0..lines {
            // SAFETY: a prefetch reads nothing that the program sees and never faults; every x86-64 processor has it.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(from.cast::<i8>().wrapping_add(LINE * line)) };
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (from, lines);
}
