//! Run-time choice of vector instructions.
//!
//! Whitstone is compiled for the plain instruction set of its target and needs no `-C target-cpu`.
//! Loops that are worth it are compiled once more for each [`Level`], and [`dispatch`] runs the
//! best version that the processor has. What is computed does not depend on it: Rust never fuses
//! `a * b + c` by itself, and every other operation is rounded the same way in vector registers.
//!
//! Where loops do not come out well, a [`Kernel`] is written in [`Lanes`] instead.

mod dispatch;
mod lanes;

pub use dispatch::{Level, dispatch};
pub use lanes::{Kernel, Lanes, Machine, Portable, prefetch, with_lanes};

/// One of two values, both computed: unlike `if`, never a jump, which would keep a loop out of
/// vector registers.
#[inline(always)]
pub fn select<T>(condition: bool, yes: T, no: T) -> T {
    std::hint::select_unpredictable(condition, yes, no)
}
