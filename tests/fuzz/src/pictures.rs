//! The fuzz target of pictures, which are decoded in memory.
//!
//! It is a program of its own because libFuzzer looks at the counters of the whole program after
//! each input: beside the rest of Whitstone, an input takes several times as long.
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
