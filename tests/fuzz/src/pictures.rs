//! The fuzz target of pictures, which are decoded in memory.
//!
//! It is a separate program because libFuzzer scans the counters of the whole program after each
//! input. In a program with all of Whitstone, that takes several times as long as decoding.
//!
//! An input may be refused with an error. A panic, a hang, too much memory, or an error without a
//! message is a finding.

#![no_main]

use libfuzzer_sys::fuzz_target;
use whitstone_image::{Limits, picture};

/// Decoding many pixels shows nothing that decoding few does not.
const LIMITS: Limits = Limits {
    max_bytes: 1 << 20,
    ..Limits::IMAGE
};

fuzz_target!(|data: &[u8]| {
    if let Err(error) = picture::decode(data, LIMITS) {
        assert!(!error.to_string().is_empty());
    }
});
