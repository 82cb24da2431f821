//! Run-time selection of vector instructions.
//!
//! Whitstone is compiled for the baseline instruction set of its target and needs no
//! `-C target-cpu`. Performance-critical loops are also compiled for each [`Level`], and
//! [`dispatch`] runs the best version that the processor supports. The results do not depend on it:
//! Rust never fuses `a * b + c` by itself, and all other operations round identically in vector
//! registers.
//!
//! Where the compiler does not vectorise a loop well, a [`Kernel`] uses [`Lanes`] instead, or a
//! [`WideKernel`] the wider vectors and the permutations of AVX-512.

mod dispatch;
mod lanes;
mod wide;

pub use dispatch::{Level, dispatch};
pub use lanes::{Kernel, Lanes, Machine, Portable, prefetch, with_lanes};
pub use wide::{
    Doubles, Quad, QuadOrder, Sixteen, WideKernel, WideMachine, pack_order, unpack_order, with_wide_lanes,
};

/// Selects one of two computed values: unlike `if`, never a branch, which would prevent
/// vectorisation.
#[inline(always)]
pub fn select<T>(condition: bool, yes: T, no: T) -> T {
    std::hint::select_unpredictable(condition, yes, no)
}
